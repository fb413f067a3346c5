r"""From the separation to the launch range: the pendulum of Eqs. (16)-(17), and what causes change about it.

Without losses the energy gives the range. With :math:`h = v^2/2g` and the swing begun at the distance :math:`s` from
the pendulum's lowest point, at the height :math:`h_s = l - \sqrt{l^2 - s^2}`,

.. math:: L_r = \sqrt{H (2l - H)} - x_0, \qquad H = h + h_s ,

and this is what a vibrometer reads: the ball's displacement from its rest at the apex of the first hop. A flight that
the tip ends before its apex is no hop; `stepper` sees to that. A ball that makes none reads the highest place to which
the tip carried it. The study leaves the place at separation out (:math:`h_s = 0`), and so does the baseline.

The form keeps its digits for microscopic swings. Losses (`Term.deceleration`, friction) are integrated with the
fifth-order method of Dormand and Prince in steps of at most a fortieth of the rise, with an error of 1e-10, or of a
twelfth, with one of 3e-8, where that will do; the last step's length is found by Newton's method.
"""

from __future__ import annotations

import math

from psafit.simulate.callbacks import call_deceleration
from psafit.simulate.closed_form import LAUNCHED
from psafit.simulate.compiled import compiled

STEPS, FEW_STEPS = 40, 12


@compiled
def _loss(x, v, rub, loss_at, loss_p, theta_at):  # type: ignore[no-untyped-def]
    """Deceleration by friction and by the functions of all causes."""
    total = rub
    for k in range(len(loss_at)):
        total += call_deceleration(loss_at[k], x, v, theta_at + loss_p[k])
    return total


@compiled
def _slow(x, v, angle, length, g, rub, loss_at, loss_p, theta_at):  # type: ignore[no-untyped-def]
    """Rate of the speed along the arc."""
    return -g * math.sin(angle + x / length) - _loss(x, v, rub, loss_at, loss_p, theta_at)


@compiled
def _step(x, v, h, angle, length, g, rub, loss_at, loss_p, theta_at):  # type: ignore[no-untyped-def]
    """One step of Dormand and Prince's fifth-order method (J. Comp. Appl. Math. 6 (1980) 19)."""
    a1 = _slow(x, v, angle, length, g, rub, loss_at, loss_p, theta_at)
    v2 = v + h * a1 / 5.0
    a2 = _slow(x + h * v / 5.0, v2, angle, length, g, rub, loss_at, loss_p, theta_at)
    v3 = v + h * (3.0 * a1 + 9.0 * a2) / 40.0
    a3 = _slow(x + h * (3.0 * v + 9.0 * v2) / 40.0, v3, angle, length, g, rub, loss_at, loss_p, theta_at)
    v4 = v + h * (44.0 * a1 - 168.0 * a2 + 160.0 * a3) / 45.0
    a4 = _slow(
        x + h * (44.0 * v - 168.0 * v2 + 160.0 * v3) / 45.0, v4, angle, length, g, rub, loss_at, loss_p, theta_at
    )
    v5 = v + h * (19372.0 * a1 - 76080.0 * a2 + 64448.0 * a3 - 1908.0 * a4) / 6561.0
    x5 = x + h * (19372.0 * v - 76080.0 * v2 + 64448.0 * v3 - 1908.0 * v4) / 6561.0
    a5 = _slow(x5, v5, angle, length, g, rub, loss_at, loss_p, theta_at)
    v6 = v + h * (9017.0 / 3168.0 * a1 - 355.0 / 33.0 * a2 + 46732.0 / 5247.0 * a3 + 49.0 / 176.0 * a4
                  - 5103.0 / 18656.0 * a5)  # fmt: skip
    x6 = x + h * (9017.0 / 3168.0 * v - 355.0 / 33.0 * v2 + 46732.0 / 5247.0 * v3 + 49.0 / 176.0 * v4
                  - 5103.0 / 18656.0 * v5)  # fmt: skip
    a6 = _slow(x6, v6, angle, length, g, rub, loss_at, loss_p, theta_at)
    w1, w3, w4, w5, w6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
    return (
        x + h * (w1 * v + w3 * v3 + w4 * v4 + w5 * v5 + w6 * v6),
        v + h * (w1 * a1 + w3 * a3 + w4 * a4 + w5 * a5 + w6 * a6),
    )


@compiled
def _rise(v, start, length, g, rub, loss_at, loss_p, theta_at, n_steps):  # type: ignore[no-untyped-def]
    """Angle at which a swing with losses turns back; at most a right angle."""
    angle = math.asin(min(max(start / length, -1.0), 1.0))
    # No longer than the free pendulum's quarter period, nor than the loss alone needs to stop the ball.
    span = 0.5 * math.pi * math.sqrt(length / g)
    slow = -_slow(0.0, v, angle, length, g, rub, loss_at, loss_p, theta_at)
    if slow > 0.0:
        span = min(span, 2.0 * v / slow)
    h = span / n_steps
    x = 0.0
    for _ in range(100 * n_steps):
        new_x, new_v = _step(x, v, h, angle, length, g, rub, loss_at, loss_p, theta_at)
        if new_v <= 0.0:
            last = h
            for _ in range(20):
                slope = _slow(new_x, new_v, angle, length, g, rub, loss_at, loss_p, theta_at)
                change = new_v / slope
                if not abs(change) > 1e-10 * h:
                    break
                last = min(max(last - change, 0.0), 2.0 * h)
                new_x, new_v = _step(x, v, last, angle, length, g, rub, loss_at, loss_p, theta_at)
            return min(angle + new_x / length, 0.5 * math.pi)
        x, v = new_x, new_v
        if angle + x / length >= 0.5 * math.pi:
            return 0.5 * math.pi
    return angle + x / length


@compiled
def _turning(x, v, h, angle, length, g, rub, loss_at, loss_p, theta_at):  # type: ignore[no-untyped-def]
    """Time within a step of `h` after which a ball turns back, and where it is then: Newton's method."""
    last = h
    new_x, new_v = _step(x, v, last, angle, length, g, rub, loss_at, loss_p, theta_at)
    for _ in range(40):
        change = new_v / _slow(new_x, new_v, angle, length, g, rub, loss_at, loss_p, theta_at)
        last = min(max(last - change, 0.0), 2.0 * h)
        new_x, new_v = _step(x, v, last, angle, length, g, rub, loss_at, loss_p, theta_at)
        if not abs(change) > 1e-12 * h:
            break
    return last, new_x


@compiled
def follow(when, speed, place, status, length, g, lean, rub, loss_at, loss_p, theta, moments, n_steps, seen):  # type: ignore[no-untyped-def]
    """Write place from rest and speed of a flying ball into what is to be `seen` at moments after its launch.

    The pendulum swings on, in steps of at most a part `n_steps` of its quarter period. Losses oppose the motion, and
    hold a ball that turns where they exceed gravity; a cause's count the way from the launch, or from the last turn.
    """
    stride = 8 * theta.shape[1]
    first = theta.ctypes.data
    for i in range(speed.shape[0]):
        at = first + i * stride
        l = length[i]
        quarter = 0.5 * math.pi * math.sqrt(l / g[i])
        for j in range(speed.shape[1]):
            if status[i, j] != LAUNCHED:
                continue
            # The angle where this way began, seen in its direction, and how far and fast the ball is since.
            side, angle = 1.0, math.asin(min(max((lean[i] + place[i, j]) / l, -1.0), 1.0))
            x, v, t, held = 0.0, speed[i, j], when[i, j], False
            slow = -_slow(0.0, v, angle, l, g[i], rub[i], loss_at, loss_p, at)
            longest = (min(quarter, 2.0 * v / slow) if slow > 0.0 else quarter) / n_steps
            for k in range(moments.shape[1]):
                if moments[j, k] == math.inf:
                    break
                if moments[j, k] <= when[i, j]:
                    continue
                while t < moments[j, k] and not held:
                    h = min(longest, moments[j, k] - t)
                    new_x, new_v = _step(x, v, h, angle, l, g[i], rub[i], loss_at, loss_p, at)
                    if new_v > 0.0:
                        x, v, t = new_x, new_v, t + h
                        continue
                    h, x = _turning(x, v, h, angle, l, g[i], rub[i], loss_at, loss_p, at)
                    t, v, longest = t + h, 0.0, quarter / n_steps
                    side, angle, x = -side, -(angle + x / l), 0.0
                    held = _slow(0.0, 0.0, angle, l, g[i], rub[i], loss_at, loss_p, at) <= 0.0
                now = angle + x / l
                seen[i, j, k, 0] = side * l * math.sin(now) - lean[i]
                seen[i, j, k, 1] = side * v * math.cos(now)


@compiled
def swing(speed, place, status, length, g, lean, rub, weight, loss_at, loss_p, theta, n_steps, out):  # type: ignore[no-untyped-def]
    """Launch ranges, m, (n_sets, n_points), into `out`; see the module."""
    stride = 8 * theta.shape[1]
    first = theta.ctypes.data
    for i in range(speed.shape[0]):
        l, x_0 = length[i], lean[i]
        for j in range(speed.shape[1]):
            v = speed[i, j]
            start = 0.0
            if x_0 > 0.0:
                start = x_0 + place[i, j]
            elif weight[i] > 0.0:
                start = math.sqrt(weight[i]) * place[i, j]
            start = min(max(start, -l), l)
            if status[i, j] != LAUNCHED:
                # No hop: what the tip carried the ball to, where the place counts.
                out[i, j] = max(start - x_0, 0.0)
                continue
            # Causes at their neutral values lose nothing, to the last digit.
            if _loss(0.0, v, rub[i], loss_at, loss_p, first + i * stride) != 0.0:
                top = _rise(v, start, l, g[i], rub[i], loss_at, loss_p, first + i * stride, n_steps)
                out[i, j] = l * math.sin(top) - x_0
            else:
                low = start * start / (l + math.sqrt(l * l - start * start))
                height = min(v * v / (2.0 * g[i]), l - low)
                gained = height * (2.0 * (l - low) - height)
                top = math.sqrt(start * start + gained)
                # What the ball gains beyond its rest keeps its digits next to a long lean.
                moved = start - x_0
                out[i, j] = top if x_0 == 0.0 else (moved * (2.0 * x_0 + moved) + gained) / (top + x_0)

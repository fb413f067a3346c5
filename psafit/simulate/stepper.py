r"""The path for whatever has no closed form: nonlinear contact, drive and hysteresis.

Between two events the unknowns are the values of the contact force at the eight nodes of a collocation step
(`collocation`), which fill one register (`compiled`). The linear stack and the ball answer a force exactly as the
method prescribes, by matrices that depend on the step's length alone,

.. math::
    a = S\,(r - f), \quad S = (m I + h c_s A + h^2 k_s A^2)^{-1}, \qquad
    d = \alpha - h^2 A^2 (S + I/M) f, \quad \dot d = \beta - h A (S + I/M) f,

so that one scalar law :math:`f = F(d, \dot d)` remains at every node; Newton's method solves it. Steps are powers of
two, so their matrices are made once for all measurement points of a parameter set. A wall that gives way (mass
:math:`M_w`, :math:`Q_w = h c_w A + h^2 k_w A^2`) is eliminated before: with :math:`Q = h c_s A + h^2 k_s A^2` and
:math:`B = (M_w I + Q + Q_w)^{-1}` the stack answers by :math:`S = (m I + Q B (M_w I + Q_w))^{-1}`.

The drive is known in advance (`drive`). A step may look past the end of a piece, or past an event, with all
formulas carried on smoothly; it is then cut there. Events are the first zeros of the step's polynomials, searched in
Bernstein's form, which cannot overlook one. The error of a step is judged by the last Legendre coefficients of the
force and of the stack's acceleration, relative to the largest speed the ball has had; a ball that is much slower in the
end is followed again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.physics.term import Setup
from psafit.simulate import drive as _drive
from psafit.simulate.callbacks import call_branch, call_law, call_stack_factor
from psafit.simulate.closed_form import AT_REST, HORIZON, HORIZON_PERIODS, LAUNCHED, NO_SEPARATION
from psafit.simulate.collocation import (
    A2,
    AT_BEGIN,
    DEGREE,
    EXTRAPOLATE,
    NODES,
    ONCE_TO_BERNSTEIN,
    RATIOS,
    TO_LEGENDRE,
    VALUES_TO_BERNSTEIN,
    A,
    C,
    basis,
)
from psafit.simulate.command import COMMAND, FREQUENCY, IDLE, JUMPS, LENGTH, REACH, driven
from psafit.simulate.compiled import compiled, last, least, load, prange, size, solve, splat, store, times, total
from psafit.simulate.design import Design

# Error admitted in one step, relative to the ball's speed: see docs/numerics.md for what it does to the launch range.
TOLERANCE = 3e-6

_MOST_BRANCHES = 8
_LEVELS = 96
_FINEST = -70  # 2^-70 s
MOST_STEPS = 20_000
"""Steps after which a trajectory ends: contacts that last for hundreds of periods, and balls that chatter to rest."""
_NEWTON = 10
_WORTH_THREADS = 16
_FIRST_RATIO, _LAST_RATIO = RATIOS[0], RATIOS[-1]
_FIRST_NODE = float(C[0])

FREE, PUSH, PULL, BOND = 0, 1, 2, 3
# Length of the first step in units of the fastest mode's time.
_FIRST_STEP = 6.0
_LENGTH = 2.0 ** np.arange(_FINEST, _FINEST + _LEVELS)  # s
# Errors below which a step grows by a level, by another, and so on.
_GROW = tuple(2.0 ** (-(NODES + 1.0) * (k + 0.1)) for k in range(1, 5))
# Disagreement of law and polynomial where the contact ends, as an impulse, admitted in units of a step's error.
_LAST_FORCE = 0.02
# The same of the force over the time to the contact's end, below which a step may go across.
_LAST_IMPULSE = 10.0
# A swing about zero counts if it is this many times the step's error.
_RESOLVED = 10.0
# The error is scaled for this part of the usual speed, until the ball has been faster.
_PART = 0.03
# What Newton's method may leave of the force, as the square of its last change, in units of a step's error.
_NEWTON_REST = 0.003
# A ball slower than this, relative to the speed the error was scaled for, is followed again.
_SLOW = 0.1
# An error of a step that rounding alone makes, in units of stroke times frequency.
_ROUNDING = 1e-15
# Launched, but found to be so much slower than the error was scaled for that the run must be repeated.
_TOO_SLOW = 9


@compiled
def _make_level(level, m, ball, c_s, k_s, mass, damping, stiffness, S, T1, T2, U1, U2, wall):  # type: ignore[no-untyped-def]
    """Matrices of steps of length ``2^(level + finest)``; last the wall's mass, damping and stiffness, and its own."""
    h = 2.0 ** (level + _FINEST)
    # Scaled by the largest of its three parts, so that the inverse exists for every length.
    own = (h * c_s) * A + (h * h * k_s) * A2
    matrix = np.eye(NODES) * m + own
    if mass > 0.0:
        back = np.eye(NODES) * mass + (h * damping) * A + (h * h * stiffness) * A2
        answer = np.linalg.inv(back + own)
        passed = own @ answer
        matrix = np.eye(NODES) * m + passed @ back
        wall[0, level], wall[1, level], wall[2, level] = answer.T, passed.T, own.T
    inverse = np.linalg.inv(matrix)
    once = h * (A @ inverse)
    twice = h * (A @ once)
    # All by columns.
    S[level], T1[level], T2[level] = inverse.T, once.T, twice.T
    U1[level] = (once + (h / ball) * A).T
    U2[level] = (twice + (h * h / ball) * A2).T


@compiled
def _make_linear(G, which, level, k_c, U2, c_c, U1):  # type: ignore[no-untyped-def]
    """Matrix that a linear law's force comes from at once."""
    G[which, level] = np.linalg.inv(np.eye(NODES) + k_c * U2[level] + c_c * U1[level])


@compiled(borrows=True)
def _split(coefficients, low, high, n):  # type: ignore[no-untyped-def]
    """Halve a polynomial in Bernstein's form (de Casteljau)."""
    for i in range(n + 1):
        high[i] = coefficients[i]
    low[0] = coefficients[0]
    for k in range(1, n + 1):
        for i in range(n + 1 - k):
            high[i] = 0.5 * (high[i] + high[i + 1])
        low[k] = high[0]


@compiled(borrows=True)
def _first_root(coefficients, n, floor, stack):  # type: ignore[no-untyped-def]
    """First place in (0, 1] where a polynomial, not negative at 0, turns negative; 2 where none."""
    negative = False
    for i in range(n + 1):
        if coefficients[i] < -floor:
            negative = True
    if not negative:
        return 2.0
    begin, width = 0.0, 1.0
    current = stack[0]
    for i in range(n + 1):
        current[i] = coefficients[i]
    depth = 0
    while True:
        # The rest of the interval behind `begin` waits in stack[1..depth], the nearest last.
        changes, last = 0, 0.0
        for i in range(n + 1):
            value = current[i]
            if abs(value) > floor:
                if last != 0.0 and value * last < 0.0:
                    changes += 1
                last = value
        first_negative = False
        for i in range(n + 1):
            if abs(current[i]) > floor:
                first_negative = current[i] < 0.0
                break
        if first_negative:
            return begin
        if changes == 0:
            if depth == 0:
                return 2.0
            begin += width
            for i in range(n + 1):
                current[i] = stack[depth, i]
            # Intervals on the stack double in width from the nearest to the farthest.
            depth -= 1
            width = stack[depth + 1, n + 1]
            continue
        if changes == 1 and last < 0.0:
            return begin + width * _only_root(current, n)
        if width < 1e-13 or depth + 2 >= len(stack):
            return begin
        depth += 1
        _split(current, stack[len(stack) - 1], stack[depth], n)
        width *= 0.5
        stack[depth, n + 1] = width
        for i in range(n + 1):
            current[i] = stack[len(stack) - 1, i]


@compiled(borrows=True)
def _only_root(b, n):  # type: ignore[no-untyped-def]
    """The one sign change of a polynomial in Bernstein's form: false position with Newton's help, to the last digit."""
    low, high = 0.0, 1.0
    x = 0.5
    for _ in range(80):
        value, slope = _bernstein(b, n, x)
        if value == 0.0:
            return x
        if value > 0.0:
            low = x
        else:
            high = x
        step = -value / slope if slope != 0.0 else 0.0
        new = x + step
        if not (low < new < high) or slope >= 0.0:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 * (1.0 + x) or new in (low, high):
            return new
        x = new
    return x


@compiled(borrows=True)
def _bernstein(b, n, x):  # type: ignore[no-untyped-def]
    """Value and slope of a polynomial in Bernstein's form (Horner with binomials)."""
    y = 1.0 - x
    if x <= 0.5:
        ratio, weight = x / y, y**n
        value, slope = b[0], 0.0
        power, binomial = 1.0, 1.0
        for i in range(1, n + 1):
            power *= ratio
            binomial *= (n - i + 1.0) / i
            value += binomial * power * b[i]
        value *= weight
    else:
        ratio, weight = y / x, x**n
        value = b[n]
        power, binomial = 1.0, 1.0
        for i in range(1, n + 1):
            power *= ratio
            binomial *= (n - i + 1.0) / i
            value += binomial * power * b[n - i]
        value *= weight
    # The slope is the polynomial of the differences.
    slope = 0.0
    power, binomial = 1.0, 1.0
    if x <= 0.5:
        weight = y ** (n - 1)
        for i in range(n):
            slope += binomial * power * (b[i + 1] - b[i])
            power *= ratio
            binomial *= (n - 1.0 - i) / (i + 1.0)
    else:
        weight = x ** (n - 1)
        for i in range(n):
            slope += binomial * power * (b[n - i] - b[n - i - 1])
            power *= ratio
            binomial *= (n - 1.0 - i) / (i + 1.0)
    return value, slope * weight * n


@compiled(inside=True)
def _force(d, rate, k_c, c_c, law_at, law_p, theta_at, out, out_at):  # type: ignore[no-untyped-def]
    """Contact force and its two derivatives."""
    out[0], out[1], out[2] = k_c * d, k_c, 0.0
    out[3], out[4], out[5] = c_c * rate, 0.0, c_c
    for i in range(len(law_at)):
        call_law(law_at[i], d, rate, theta_at + law_p[i], out_at)
    return out[0] + out[3], out[1] + out[4], out[2] + out[5]


@compiled(borrows=True)
def _seat(press, k_c, c_c, law_at, law_p, theta_at, out, out_at):  # type: ignore[no-untyped-def]
    """Indentation at rest under a constant press: Newton's method from above on a growing force."""
    d = press / k_c
    for _ in range(200):
        force, slope, _ = _force(d, 0.0, k_c, c_c, law_at, law_p, theta_at, out, out_at)
        if not slope > 0.0:
            break
        new = d - (force - press) / slope
        if new <= 0.0:
            new = 0.1 * d
        if abs(new - d) <= 1e-15 * d:
            return new
        d = new
    return d


@compiled(inside=True)
def _strokes(piece, t, q, settled, theta_at, calls, mem_z, mem_u, scratch):  # type: ignore[no-untyped-def]
    """Return the free stack's stroke at eight times, as the drive has it, from where it rested."""
    _, _, factor_at, factor_p, branch_at, branch_p = calls
    u = _drive.voltages(piece, t, scratch)
    if len(factor_at) == 0 and len(branch_at) == 0:
        return u * q - settled
    sign = piece[_drive.SIGN]
    store(scratch, 0, u)
    for i in range(NODES):
        u_i = scratch[i]
        stroke = q * u_i
        for k in range(len(factor_at)):
            size_i = sign * u_i if sign != 0.0 else abs(u_i)
            stroke *= call_stack_factor(factor_at[k], size_i, theta_at + factor_p[k])
        for k in range(len(branch_at)):
            stroke -= call_branch(branch_at[k], mem_z[k], mem_u[k], u_i, q, theta_at + branch_p[k])
        scratch[i] = stroke - settled
    return load(scratch, 0)


@compiled(inside=True)
def _contact(F, alpha, beta, kappa, U1, U2, at, k_c, c_c, theta_at, calls, nodes, enough):  # type: ignore[no-untyped-def]
    """Newton's method for the contact force at the nodes; returns it, and whether it was found."""
    law_at, law_p = calls[0], calls[1]
    out, d_node, w_node, force, Fd, Fw = nodes
    out_at = out.ctypes.data
    for _ in range(_NEWTON):
        store(d_node, 0, alpha - times(U2, at, F) * kappa)
        store(w_node, 0, beta - times(U1, at, F) * kappa)
        for i in range(NODES):
            force[i], Fd[i], Fw[i] = _force(d_node[i], w_node[i], k_c, c_c, law_at, law_p, theta_at, out, out_at)
        change = solve(U2, at, load(Fd, 0) * kappa, U1, at, load(Fw, 0) * kappa, load(force, 0) - F)
        F = F + change
        moved = total(size(change)) / NODES
        if not math.isfinite(moved):
            break
        # Newton squares the error.
        if moved * moved <= enough * total(size(F)) / NODES:
            return F, True
    return F, False


@compiled(inside=True)
def _tail(v):  # type: ignore[no-untyped-def]
    """Sum of the geometric series that the last two Legendre coefficients begin."""
    first = abs(total(load(TO_LEGENDRE, (NODES - 1) * NODES) * v))
    second = abs(total(load(TO_LEGENDRE, (NODES - 2) * NODES) * v))
    return first * first / max(second - first, 0.1 * first) if first > 0.0 else 0.0


@compiled(inside=True)
def _add(value, lost, change):  # type: ignore[no-untyped-def]
    """Kahan's sum: a slow ball's speed is a small rest of what the contact gave and took."""
    change -= lost
    new = value + change
    return new, (new - value) - change


@compiled(inside=True)
def _crossing(d, swing, threshold, side, fresh, slip, bern, stack):  # type: ignore[no-untyped-def]
    """First place where the indentation passes a threshold, 2 where none; also the noise in it.

    Its coefficients are `d` and `swing`; it begins above the threshold, or below where `side` is -1. A `fresh` step
    begins on the zero that ended the one before; `slip` is its error.
    """
    first, rest = side * (d - threshold), (swing - threshold) * side
    scale = max(abs(first), -least(size(rest) * -1.0))
    floor = 4e-16 * (scale + abs(d))
    if fresh:
        floor = max(floor, 1e-13 * scale, slip)
        if abs(first) < 1e-9 * scale:
            first = 0.0
    if first >= -floor and least(rest) >= -floor:
        return 2.0, floor
    bern[0] = first
    store(bern, 1, rest)
    return _first_root(bern, DEGREE, floor, stack), floor


@compiled(borrows=True)
def _is_noise(bern, n, theta, resolved):  # type: ignore[no-untyped-def]
    """Whether what begins on a zero and returns to it at `theta` does not rise above the step's error in between."""
    middle, _ = _bernstein(bern, n, 0.5 * theta)
    return middle < resolved


@compiled(inside=True)
def _top(speed, push, h, ball, bern, stack):  # type: ignore[no-untyped-def]
    """How far the ball gets in a step in which it turns back."""
    bern[0] = speed
    store(bern, 1, times(ONCE_TO_BERNSTEIN, 0, push) * (h / ball) + speed)
    theta = min(_first_root(bern, DEGREE, 0.0, stack), 1.0)
    _, once = basis(theta)
    return h * (theta * speed + h * total(times(A, 0, once) * push) / ball)


@compiled(borrows=True)
def _fly(rig, theta_at, rows, point, calls, cache, work, tolerance, reference, grows):  # type: ignore[no-untyped-def]
    """Follow one trajectory to the launch.

    Returns (outcome, time, speed of the ball, its place, steps taken); the place is the highest where it is not
    launched.
    """
    k_c, c_s, c_c, m, ball, k_s, q = rig[0], rig[1], rig[2], rig[3], rig[4], rig[5], rig[6]
    length, g, phase, lag, inverse_slew = rig[7], rig[8], rig[9], rig[10], rig[11]
    gap, lean, bond, pull, cycles, hold = rig[12], rig[13], rig[14], rig[15], rig[16], rig[17]
    wall_mass, wall_k, wall_c = rig[21], rig[22], rig[23]
    walled = wall_mass > 0.0
    law_at, law_p, factor_at, factor_p, branch_at, branch_p = calls
    S, T1, T2, U1, U2, G, made, made_linear, wall = cache
    piece, nodes, bern, stack, mem_z, mem_u = work
    law_out, scratch = nodes[0], nodes[3]
    out_at = law_out.ctypes.data
    n_branch, n_factor, n_law = len(branch_at), len(factor_at), len(law_at)

    split = n_branch > 0 or n_factor > 0
    if not _drive.first_piece(piece, rows, point, phase, lag, inverse_slew, split):
        return NO_SEPARATION, math.nan, 0.0, 0.0, 0
    f, idle = point[FREQUENCY], point[IDLE]
    # Where the stack rests: what the idle voltage, once it was reached from 0 V, has made of it.
    settled = q * idle
    for k in range(n_factor):
        settled *= call_stack_factor(factor_at[k], abs(idle), theta_at + factor_p[k])
    for k in range(n_branch):
        mem_z[k], mem_u[k] = 0.0, idle
        if idle != 0.0:
            mem_z[k] = call_branch(branch_at[k], 0.0, 0.0, idle, q, theta_at + branch_p[k])
            settled -= mem_z[k]

    press, grip = ball * g * lean / length, ball * hold
    # Friction holds the ball until a force exceeds its grip; then `load` is what opposes the motion, in its direction.
    stuck, way, opposed = grip > 0.0, 0.0, press
    x1 = v1 = x2 = v2 = w = xw = vw = 0.0
    lost_d = lost_v2 = 0.0  # what the sums lack of these
    d = -gap
    t = piece[_drive.BEGIN]
    if lean > 0.0:
        d = _seat(press, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
        if walled:
            xw = -press / wall_k
        x1 = xw - press / k_s
        x2 = x1 - d
        regime = PUSH
    elif gap > 0.0 or piece[_drive.AWAY] <= 0.0:
        regime = FREE
    else:
        regime = PUSH
    rest, highest = x2, 0.0
    release = -bond / k_c
    separated_once = False
    last_time, last_speed, last_place = math.nan, 0.0, 0.0
    waiting = point[LENGTH] + HORIZON_PERIODS / f
    horizon = max(waiting, min(4.0 * math.pi * math.sqrt(ball / k_c), HORIZON))
    window = cycles / f  # until when a launched ball may be struck again
    fractions = load(C, 0)
    F = kept = back = splat(0.0)

    # The first step resolves the fastest mode; where that does not matter the steps grow at once.
    rate = c_s / m + c_c * (1.0 / m + 1.0 / ball) + math.sqrt((k_s + k_c) / m + k_c / ball)
    level = math.floor(math.log2(min(0.1 / f, _FIRST_STEP / rate))) - _FINEST
    level = min(max(level, 0), _LEVELS - 1)
    rough = False  # whether the law has spoilt a step across the end of the contact
    carried = False  # whether `kept` holds the force of the step before, ready to be carried on
    previous = level
    new_piece = True
    begun, first_level = True, level  # whether the next step is a piece's first; the length that suited the last such
    fresh = True  # first step after the regime changed

    for step in range(MOST_STEPS):  # noqa: B007
        if new_piece:
            new_piece = False
            now = _drive.voltage(piece, t)
            for k in range(n_branch):
                mem_z[k] = call_branch(branch_at[k], mem_z[k], mem_u[k], now, q, theta_at + branch_p[k])
                mem_u[k] = now
            carried = False
            begun = True
            level = min(level, first_level)
        room = piece[_drive.END] - t
        if room < math.inf:
            # The shortest step that reaches the piece's end, or shorter.
            while level > 0 and _LENGTH[level - 1] >= room:
                level -= 1
        if rough and w < 0.0 and d > 0.0 and abs(last(F) * d) > _LAST_IMPULSE * tolerance * ball * reference * -w:
            # Not across the contact's end before what is left of the force no longer matters.
            level = max(min(level, math.floor(math.log2(-d / w)) - _FINEST), 0)
        if not made[level]:
            _make_level(level, m, ball, c_s, k_s, wall_mass, wall_c, wall_k, S, T1, T2, U1, U2, wall)
            made[level] = True
        h = _LENGTH[level]
        at = level * NODES * NODES

        # What is known of the motion without the contact force.
        elapsed = fractions * h
        stroke = _strokes(piece, elapsed + t, q, settled, theta_at, calls, mem_z, mem_u, scratch)
        r = (stroke - (elapsed * v1 + x1)) * k_s - c_s * v1
        if walled:
            still = elapsed * vw + xw
            r = r + (still * k_s + c_s * vw)
            back = still * -wall_k - (r + wall_c * vw)
            r = r + times(wall, (_LEVELS + level) * NODES * NODES, back)
        # A ball that is held does not answer the force.
        V1, V2 = (T1, T2) if stuck else (U1, U2)
        against = 0.0 if stuck else opposed / ball
        alpha = times(T2, at, r) + ((elapsed * (0.5 * against) + w) * elapsed + d)
        beta = times(T1, at, r) + (elapsed * against + w)

        failed = False
        kappa = pull if regime == PULL else 1.0
        if regime == FREE:
            F, kappa = splat(0.0), 0.0
        elif n_law == 0:
            # A linear law needs no iteration: f = G (k_c alpha + c_c beta).
            which = (1 if regime == PULL else 0) + (2 if stuck else 0)
            if not made_linear[which, level]:
                _make_linear(G, which, level, kappa * k_c, V2, kappa * c_c, V1)
                made_linear[which, level] = True
            F = times(G, (which * _LEVELS + level) * NODES * NODES, alpha * k_c + beta * c_c)
        else:
            ratio = level - previous
            if carried and _FIRST_RATIO <= ratio <= _LAST_RATIO:
                F = times(EXTRAPOLATE, (ratio - _FIRST_RATIO) * NODES * NODES, kept)
            else:
                start, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                F = splat(start)
            F, found = _contact(
                F, alpha, beta, kappa, V1, V2, at, k_c, c_c, theta_at, calls, nodes,
                _NEWTON_REST * tolerance * ball * reference / h,
            )  # fmt: skip
            failed = not found
        if fresh and n_law > 0 and regime != FREE and not failed and level > 0:
            # The same at the beginning of a contact, where a law may have no derivatives either.
            at_begin = total(load(AT_BEGIN, 0) * F)
            law, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
            if abs(law - at_begin) * h > _LAST_FORCE * tolerance * ball * reference:
                level = max(level - 2, 0)
                continue
        push = F
        reached = reference
        # Error: what the ends of the series of ball's and stack's acceleration leave out.
        acceleration = times(S, at, r - F * kappa)
        w_node = beta - times(V1, at, F) * kappa
        swing = times(ONCE_TO_BERNSTEIN, 0, w_node) * h + d
        error = 1e6
        if not failed:
            push = splat(0.0) if stuck else F * kappa - opposed
            if grows:
                reached = max(reference, abs(v2 + h * total(load(A, (NODES - 1) * NODES) * push) / ball))
            error = h * (_tail(F) * kappa / ball + _tail(acceleration)) / (tolerance * reached)
        if error > 1.0 and level > 0:
            down = math.ceil(math.log2(error) / (NODES + 1.0) + 0.1)
            level = max(level - min(max(down, 1), 8), 0)
            carried = False
            rough = rough or (n_law > 0 and regime != FREE and w < 0.0 and not failed and last(swing) < 0.0)
            continue

        # Events: the first of them cuts the step.
        cut = 2.0
        event = -1
        if room <= h:
            cut = room / h
            event = 9
        side = -1.0 if regime == FREE else 1.0
        threshold = release if regime == BOND else 0.0
        slip = error * tolerance * reached * h
        theta, floor = _crossing(d, swing, threshold, side, fresh, slip, bern, stack)
        if theta < cut:
            if fresh and level > 0 and _is_noise(bern, DEGREE, theta, _RESOLVED * slip + floor):
                level = max(level - 3, 0)
                continue
            if regime != FREE and n_law > 0:
                # A law may have no derivatives where the contact ends: the polynomial, carried on past that place, must
                # still agree with the law there. If not, the place is approached in shorter steps.
                values, _ = basis(theta)
                at_end, w_end = total(values * F), total(values * w_node)
                law, _, _ = _force(threshold, w_end, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                if abs(law - at_end) * theta * h > _LAST_FORCE * tolerance * ball * reference and level > 0:
                    level = max(min(level - 1, math.floor(math.log2(max(theta, 1e-3) * h)) - _FINEST), 0)
                    carried = False
                    continue
            cut, event = theta, 0
        if pull != 1.0 and regime in (PUSH, PULL):
            side = 1.0 if regime == PUSH else -1.0
            coefficients = times(VALUES_TO_BERNSTEIN, 0, F) * side
            store(bern, 0, coefficients)
            scale = -least(size(coefficients) * -1.0)
            floor = 1e-11 * scale
            if fresh:
                # A force that has only begun, as the fourth power of time behind a lag, is noise in its first
                # coefficients: of what the step does not resolve no sign is taken.
                floor = max(floor, _RESOLVED * error * tolerance * reached * ball / h)
                if abs(bern[0]) < 1e-5 * scale:
                    bern[0] = 0.0
            theta = _first_root(bern, NODES - 1, floor, stack)
            if fresh and theta < _FIRST_NODE:
                # Nor does a law without derivatives there have one before the first node, where it is known: a change
                # that is real shows at the nodes of a shorter step.
                store(scratch, 0, F * side)
                if least(F * side) > 0.0:
                    theta = 2.0
                elif scratch[0] > 0.0 and level > 0:
                    level = max(level - 3, 0)
                    continue
            if theta < cut:
                resolved = _RESOLVED * error * tolerance * reference * ball / h
                if fresh and level > 0 and _is_noise(bern, NODES - 1, theta, resolved + floor):
                    level = max(level - 3, 0)
                    continue
                cut, event = theta, 1
        if regime == BOND and pull != 1.0:
            # Back to contact proper: only the law's exception for d >= 0 changes there.
            theta, floor = _crossing(d, swing, 0.0, -1.0, fresh, slip, bern, stack)
            if theta < cut:
                if fresh and level > 0 and _is_noise(bern, DEGREE, theta, _RESOLVED * slip + floor):
                    level = max(level - 3, 0)
                    continue
                cut, event = theta, 2

        if grip > 0.0 and not stuck:
            # The ball comes to rest.
            gained = times(ONCE_TO_BERNSTEIN, 0, push) * (h / ball)
            theta, floor = _crossing(v2, gained + v2, 0.0, way, fresh, slip / h, bern, stack)
            if theta < cut:
                if fresh and level > 0 and _is_noise(bern, DEGREE, theta, _RESOLVED * slip / h + floor):
                    level = max(level - 3, 0)
                    continue
                cut, event = theta, 3
        elif grip > 0.0 and regime != FREE:
            # The force tears it off.
            for side in (1.0, -1.0):
                margin = (F * kappa - press) * -side + grip
                floor = 1e-11 * -least(size(margin) * -1.0)
                if fresh:
                    floor = max(floor, _RESOLVED * error * tolerance * reached * ball / h)
                store(bern, 0, times(VALUES_TO_BERNSTEIN, 0, margin))
                theta = _first_root(bern, NODES - 1, floor, stack)
                if theta < cut:
                    cut, event, way = theta, 4, side

        # Advance to the end of the step or to the cut.
        whole = cut > 1.0
        if whole:
            cut = 1.0
            once, twice = load(A, (NODES - 1) * NODES), load(A2, (NODES - 1) * NODES)
        else:
            _, once = basis(cut)
            twice = times(A, 0, once)
        before, x2_before = v2, x2
        x1 += h * (cut * v1 + h * total(twice * acceleration))
        x2 += h * (cut * v2 + h * total(twice * push) / ball)
        v1 += h * total(once * acceleration)
        if walled:
            back = back + times(wall, (2 * _LEVELS + level) * NODES * NODES, acceleration)
            back = times(wall, at, back)
            xw += h * (cut * vw + h * total(twice * back))
            vw += h * total(once * back)
        v2, lost_v2 = _add(v2, lost_v2, h * total(once * push) / ball)
        d, lost_d = _add(d, lost_d, h * total(once * w_node))
        if grows:
            reference = max(reference, abs(v2))
        if before > 0.0 >= v2 and not separated_once:
            highest = max(highest, _top(before, push, h, ball, bern, stack) + x2_before - rest)
        w = v1 - v2
        t = t + cut * h
        if t > (waiting if regime == FREE else horizon):
            break  # what the step met was beyond
        fresh = False
        if whole or event == 9:
            previous = level
            kept = F
            carried = whole and regime != FREE
            for limit in _GROW:
                if error < limit:
                    level = min(level + 1, _LEVELS - 1)
            if begun:
                begun = False
                first_level = level
            if event == 9:
                now = _drive.voltage(piece, piece[_drive.END])
                for k in range(n_branch):
                    mem_z[k] = call_branch(branch_at[k], mem_z[k], mem_u[k], now, q, theta_at + branch_p[k])
                    mem_u[k] = now
                t = piece[_drive.END]
                _drive.next_piece(piece, now, rows, point, phase, lag, inverse_slew, split)
                new_piece = True
        else:
            carried = False
            fresh = True
            lost_d = 0.0
            if event == 3:
                if not separated_once:
                    highest = max(highest, x2 - rest)
                if separated_once and regime == FREE:
                    break  # the hop is over
                v2 = lost_v2 = 0.0
                force = 0.0
                if regime != FREE:
                    values, _ = basis(cut)
                    force = kappa * total(values * F)
                w = v1
                stuck = abs(force - press) <= grip
                way = math.copysign(1.0, force - press)
                opposed = press + way * grip
            elif event == 4:
                stuck = False
                opposed = press + way * grip
            elif event == 0 and regime == FREE:
                if separated_once and t > window:
                    break
                d = 0.0
                regime = PUSH
                start, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                if start < 0.0 and pull != 1.0:
                    regime = PULL
            elif event == 0 and regime != BOND and bond > 0.0:
                d = 0.0
                regime = BOND
            elif event == 0:
                d = release
                regime = FREE
                if v2 > 0.0:
                    separated_once = True
                    last_time, last_speed, last_place = t, v2, x2 - rest
                    if cycles == 0.0:
                        break
                    # Beyond the apex the hop is over: what strikes the ball then is another launch.
                    window = cycles / f if opposed <= 0.0 else min(cycles / f, t + v2 * ball / opposed)
            elif event == 1:
                regime = PULL if regime == PUSH else PUSH
            else:
                d = 0.0
                start, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                regime = PULL if start < 0.0 else PUSH
        if separated_once and regime == FREE and t > window:
            break
        if t > (waiting if regime == FREE else horizon):
            break
    if separated_once:
        # Of the launch that counts alone: the next impact makes up for one before it that was slow.
        slow = last_speed < _SLOW * reference and tolerance * reference > _ROUNDING * q * point[REACH] * f
        outcome = _TOO_SLOW if slow and step < MOST_STEPS - 1 else LAUNCHED
        return outcome, last_time, last_speed, last_place, step
    return NO_SEPARATION, math.nan, 0.0, max(highest, x2 - rest), step


@compiled(borrows=True)
def _usual_speed(rig, theta_at, point, calls, out):  # type: ignore[no-untyped-def]
    """About the speed of the ball that one period of a simple contact, as stiff as the stroke makes it, launches."""
    k_c, c_c, ball, k_s, q = rig[0], rig[2], rig[4], rig[5], rig[6]
    f, volt = point[FREQUENCY], point[REACH]
    force, _, _ = _force(q * volt, 0.0, k_c, c_c, calls[0], calls[1], theta_at, out, out.ctypes.data)
    stiffness = max(force / (q * volt), 1e-12 * k_c)
    stiffness *= k_s / (stiffness + k_s)
    w = 2.0 * math.pi * f
    own = math.sqrt(stiffness / ball)
    own = math.sqrt(own * own + c_c / ball * max(w, own))
    return q * volt * (own / (1.0 + w / own) if point[JUMPS] != 0.0 else w / (1.0 + (w / own) ** 2))


@compiled
def _one_set(rig, theta_at, wanted, rows, points, calls, tolerance, when, speed, place, status, steps):  # type: ignore[no-untyped-def]
    n = NODES
    cache = (
        np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)),
        np.empty((_LEVELS, n, n)), np.empty((4, _LEVELS, n, n)), np.zeros(_LEVELS, np.bool_),
        np.zeros((4, _LEVELS), np.bool_), np.empty((3 if rig[21] > 0.0 else 0, _LEVELS, n, n)),
    )  # fmt: skip
    nodes = (np.empty(6), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    work = (
        np.empty(_drive.PIECE), nodes, np.empty(n + 1), np.empty((50, n + 3)), np.empty(_MOST_BRANCHES),
        np.empty(_MOST_BRANCHES),
    )  # fmt: skip
    point = np.empty(COMMAND)
    for j in range(len(points)):
        driven(points[j], rig[19], rig[20], point)
        if point[REACH] == 0.0 or not wanted[j]:
            when[j], speed[j], place[j], status[j], steps[j] = 0.0, 0.0, 0.0, AT_REST, 0
            continue
        reference = _PART * _usual_speed(rig, theta_at, point, calls, nodes[0])
        total_steps = 0
        for k in range(12):
            outcome, t, v, x, count = _fly(rig, theta_at, rows, point, calls, cache, work, tolerance, reference, k == 0)
            total_steps += count
            if outcome != _TOO_SLOW:
                break
            reference = max(v, _ROUNDING * rig[6] * point[REACH] * point[FREQUENCY] / tolerance)
        when[j], speed[j], place[j], status[j], steps[j] = t, v, x, outcome, total_steps


def _all_sets(rigs, theta, wanted, rows, points, calls, tolerance, when, speed, place, status, steps):  # type: ignore[no-untyped-def]
    stride = 8 * theta.shape[1]
    first = theta.ctypes.data
    for i in prange(len(theta)):
        _one_set(
            rigs[i], first + i * stride, wanted[i], rows, points, calls, tolerance,
            when[i], speed[i], place[i], status[i], steps[i],
        )  # fmt: skip


_serial = compiled(_all_sets)
_parallel = compiled(_all_sets, parallel=True)


@dataclass(frozen=True)
class Calls:
    """Addresses of the causes' functions, and where in a row of `theta` each one's parameters begin (in bytes)."""

    law: tuple[tuple[int, int], ...] = ()
    stack_factor: tuple[tuple[int, int], ...] = ()
    branch: tuple[tuple[int, int], ...] = ()

    def arrays(self) -> tuple[NDArray[np.int64], ...]:
        """As the compiled engine takes them."""
        pairs = [np.array(kind, np.int64).reshape(-1, 2).T for kind in (self.law, self.stack_factor, self.branch)]
        return tuple(np.ascontiguousarray(row) for pair in pairs for row in pair)


def separation(
    design: Design,
    rig: Setup,
    theta: FloatArray,
    calls: Calls,
    tolerance: float = TOLERANCE,
    wanted: NDArray[np.bool_] | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int8], NDArray[np.int64]]:
    """Time (s), ball speed (m/s) and place (m) at the launch, what happened, and steps taken; (n_sets, n_points).

    Places count from the ball's rest. Without a launch it is the highest place to which the tip carried the ball.

    Parameters
    ----------
    design : Design
        Measurement conditions.
    rig : Setup
    theta : (n_sets, n_parameters) array
        What the causes' functions read their parameters from.
    calls : Calls
        At most eight causes with a `branch`.
    tolerance : float
        Error admitted in one step, relative to the ball's speed.
    wanted : (n_sets, n_points) bool array, optional
        Which trajectories to follow; all of them by default.
    """
    shape = (len(theta), design.n_points)
    found = tuple(np.empty(shape, kind) for kind in (float, float, float, np.int8, np.int64))
    if len(calls.branch) > _MOST_BRANCHES:
        raise ValueError(f"{len(calls.branch)} causes with a memory; at most {_MOST_BRANCHES}")
    run = _parallel if len(theta) > 1 and found[0].size > _WORTH_THREADS else _serial
    run(
        rig.stack(), np.ascontiguousarray(theta), np.ones(shape, bool) if wanted is None else wanted,
        *design.commands, calls.arrays(), tolerance, *found,
    )  # fmt: skip
    return found  # type: ignore[return-value]

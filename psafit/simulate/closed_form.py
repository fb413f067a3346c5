r"""Whatever stays linear while in contact, in closed form: no time step, hence no step error.

During contact the baseline is linear. Eliminating the stack and the ball from Eqs. (2), (8)-(12) of the study
leaves the indentation :math:`d = x_1 - x_2` as the response to the drive voltage :math:`u`,

.. math::
    D(s) = \frac{k_s q M s^2}{P(s)} U(s), \qquad
    P(s) = (m s^2 + c_s s + k_s)(M s^2 + c_c s + k_c) + M s^2 (c_c s + k_c),

so that :math:`d(t) = \operatorname{Re} \sum_k a_k e^{s_k t}` over the four poles of :math:`1/P` and, for a sine,
the pole :math:`i\omega` of the drive. A jump or corner of the drive restarts the sum. At the separation
:math:`d = 0`, so the damper has given back what it took and the ball's speed is that of the spring's impulse,
:math:`v = (k_c/M) \int_0^{t} d`: positive whenever there is a separation at all.

Causes that keep this form: other masses and stiffnesses; a lagging amplifier, :math:`U(s)/(1 + \tau s)`, one more
pole; a starting phase, another numerator of :math:`U`; and a constant force :math:`P` that presses the ball on the
tip, or a bond that breaks at the elastic pull :math:`F`: the rest position moves, and with it the level that :math:`d`
must cross, to :math:`-(P + F)/k_c` below the static indentation.

A tip that first draws back from the ball moves by the modes of the stack alone, :math:`m s^2 + c_s s + k_s`, until it
comes back. Its speed there is an impulse on the tip, with which the contact's modes begin.

The separation is the first zero of :math:`d`. Let :math:`B_2` and :math:`B_3` bound :math:`|d''|` and
:math:`|d'''|` on :math:`[t, \infty)` (sums of moduli that only decay). Then

.. math:: d(t+h) \ge d + d' h - B_2 h^2/2, \qquad d(t+h) \ge d + d' h + d'' h^2/2 - B_3 h^3/6,

and marching by the largest `h` that either bound keeps positive cannot step over a zero. Near a simple
zero the march turns into Newton's method from the left, with quadratic convergence; past a near touch it
slips in a geometric sequence of steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import ComplexArray, FloatArray
from psafit.physics.term import Setup
from psafit.simulate.command import (
    BEGIN,
    BIAS,
    COMMAND,
    COUNT,
    FIRST,
    FREQUENCY,
    IDLE,
    LAST,
    LENGTH,
    LEVEL,
    OMEGA,
    PERIOD,
    RATE,
    REACH,
    SCALE,
    SLOPE,
    TURN,
    command,
    driven,
    first_move,
    first_row,
    phase_of,
)
from psafit.simulate.compiled import WIDTH, compiled, load, size, splat, store, total
from psafit.simulate.design import Design
from psafit.simulate.threads import n_threads, share

# A command that begins this close to its idle voltage, relative to its size, begins there.
_ROUNDING = 2 * np.finfo(float).eps
_ROUNDED = 512 * np.finfo(float).eps
# Bounds lose to rounding: below this fraction of the summed amplitudes a positive value means nothing.
_NOISE = 8 * np.finfo(float).eps

# Contact always ends in the baseline (the integral of the indentation over a transient is zero), in all of the prior
# range within milliseconds to seconds; the horizon, s, only stops a hopeless search. A ball that is pressed on the tip
# may never leave it: then the drive's periods count.
HORIZON = 100.0
HORIZON_PERIODS = 3.0

LAUNCHED, AT_REST, NO_SEPARATION, DRAWN_BACK = range(4)


@dataclass(frozen=True)
class PoleSettings:
    """How poles are summed that nearly coincide.

    Parameters
    ----------
    close : float
        Poles closer than this (relative) lose digits to cancellation when summed singly: eps/close for two of them.
    nodes : int
        They are replaced by this many nodes of the trapezoid rule on a circle around them. Its error falls as (r/R)^n,
        with r the spread of the cluster and R the circle, and again with R and the next pole outside.
    clearance : float
        Radius of the circle in units of the spread, and distance of other poles in units of the radius.
    radius : float
        The circle's least radius, relative to its centre.
    """

    close: float = 1e-3
    nodes: int = 24
    clearance: float = 3.0
    radius: float = 0.01


class Modes(NamedTuple):
    """Poles and weights of one linear phase for a batch of parameter sets.

    Complex pairs are kept once, with the weight doubled; unused slots have weight zero.

    Parameters
    ----------
    pole : (n_sets, n_modes) complex array, 1/s
    weight : (n_sets, n_modes) complex array
        Residue of ``D(s)/U(s)``, m/(V s).
    lead : (n_sets,) array
        ``k_s q / m``: initial acceleration of the tip per volt, m/(s^2 V); with a lag, over its time constant.
    roots : (n_sets, n_roots) complex array, 1/s
        The roots of ``P``, both members of each pair, and the lag's.
    """

    pole: ComplexArray
    weight: ComplexArray
    lead: FloatArray
    roots: ComplexArray


def contact_polynomial(rig: Setup) -> FloatArray:
    """Coefficients of the monic ``P(s)``, from ``s^3`` down to ``s^0``; shape (n_sets, 4)."""
    k_c, c_s, c_c, m, M, k_s = rig.k_c, rig.c_s, rig.c_c, rig.m, rig.M, rig.k_s
    return np.stack(
        [
            (M * (c_s + c_c) + m * c_c) / (m * M),
            (M * (k_s + k_c) + m * k_c + c_s * c_c) / (m * M),
            (c_s * k_c + c_c * k_s) / (m * M),
            k_s * k_c / (m * M),
        ],
        axis=1,
    )


def poles(coefficients: FloatArray) -> ComplexArray:
    """Roots of monic real quartics, to nearly full relative accuracy each.

    The companion matrix yields starting values. They are grouped into two real quadratic factors, the
    closest two real roots together, and Newton's method on the factors' coefficients restores
    the small roots' digits next to large ones; a double root inside a factor does no harm there.

    Parameters
    ----------
    coefficients : (n_sets, 4) array
        From the cubic coefficient down to the constant; positive.

    Returns
    -------
    (n_sets, 4) complex array
        Conjugate pairs stand side by side, positive imaginary part first.
    """
    scale = coefficients[:, 3:] ** 0.25  # makes the product of the roots one
    scaled = coefficients / scale ** np.arange(1, 5)
    companion = np.zeros((len(scaled), 4, 4))
    companion[:, 0, :] = -scaled
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    start = np.linalg.eigvals(companion).astype(complex)
    return _polish(scaled, start) * scale


@compiled
def _polish(coefficients, start):  # type: ignore[no-untyped-def]
    roots = np.empty((len(start), 4), np.complex128)
    z, size, row, system = np.empty(4, np.complex128), np.empty(4), np.empty(4), np.empty((4, 5))
    for i in range(len(start)):
        b = coefficients[i]
        for k in range(4):
            row[k] = b[k] if b[k] > 0.0 else 1.0  # undamped: the odd coefficients vanish
        _pair(start[i], z)
        p1, q1 = -(z[0] + z[1]).real, (z[0] * z[1]).real
        p2, q2 = -(z[2] + z[3]).real, (z[2] * z[3]).real
        for _ in range(4):
            size[0], size[1], size[2], size[3] = abs(p1) + math.sqrt(q1), q1, abs(p2) + math.sqrt(q2), q2
            # The Jacobian, and the remainder behind it.
            system[:] = 0.0
            system[0, 0] = system[0, 2] = system[1, 1] = system[1, 3] = 1.0
            system[1, 0], system[1, 2] = p2, p1
            system[2, 0], system[2, 1], system[2, 2], system[2, 3] = q2, p2, q1, p1
            system[3, 1], system[3, 3] = q2, q1
            system[0, 4], system[1, 4] = p1 + p2 - b[0], q1 + q2 + p1 * p2 - b[1]
            system[2, 4], system[3, 4] = p1 * q2 + p2 * q1 - b[2], q1 * q2 - b[3]
            # Columns and rows scaled to one: the factors may differ by ten orders of magnitude.
            for j in range(4):
                for k in range(4):
                    system[j, k] *= size[k] / row[j]
                system[j, 4] /= row[j]
            if not abs(_eliminate(system)) >= 1e-14:
                break  # the factors share a root: the companion values stand as they are
            p1, q1 = p1 - size[0] * system[0, 4], q1 - size[1] * system[1, 4]
            p2, q2 = p2 - size[2] * system[2, 4], q2 - size[3] * system[3, 4]
            if max(abs(system[0, 4]), abs(system[1, 4]), abs(system[2, 4]), abs(system[3, 4])) < 1e-9:
                break  # the next step would be its square
        roots[i, 0], roots[i, 1] = _quadratic(p1, q1)
        roots[i, 2], roots[i, 3] = _quadratic(p2, q2)
    return roots


@compiled(borrows=True)
def _eliminate(system):  # type: ignore[no-untyped-def]
    """Solve equations, the right hand side in the last column, in place there; the determinant."""
    n, determinant = len(system), 1.0
    for k in range(n):
        top = k
        for j in range(k + 1, n):
            if abs(system[j, k]) > abs(system[top, k]):
                top = j
        if top != k:
            determinant = -determinant
            for m in range(k, n + 1):
                system[k, m], system[top, m] = system[top, m], system[k, m]
        determinant *= system[k, k]
        for j in range(k + 1, n):
            factor = system[j, k] / system[k, k]
            for m in range(k + 1, n + 1):
                system[j, m] -= factor * system[k, m]
    for k in range(n - 1, -1, -1):
        for m in range(k + 1, n):
            system[k, n] -= system[k, m] * system[m, n]
        system[k, n] /= system[k, k]
    return determinant


@compiled(borrows=True)
def _pair(roots, z):  # type: ignore[no-untyped-def]
    """Order four roots so that the first two and the last two belong to real quadratics."""
    n = 0
    for k in range(4):
        if roots[k].imag > 0.0:
            z[n], z[n + 1] = roots[k], roots[k].conjugate()
            n += 2
    first = n
    for k in range(4):
        if roots[k].imag == 0.0:
            # The real ones, ascending.
            at = n
            while at > first and z[at - 1].real > roots[k].real:
                z[at] = z[at - 1]
                at -= 1
            z[at] = roots[k]
            n += 1
    # All real and negative: the two middle ones share a factor when they are the closest.
    if first == 0:
        a, b, c, d = z[0], z[1], z[2], z[3]
        if b.real / c.real < min(a.real / b.real, c.real / d.real):
            z[0], z[1], z[2], z[3] = b, c, a, d


@compiled
def _quadratic(p, q):  # type: ignore[no-untyped-def]
    """Roots of s^2 + p s + q without cancellation."""
    discriminant = 0.25 * p * p - q
    root = math.sqrt(abs(discriminant))
    if discriminant < 0.0:
        return complex(-0.5 * p, root), complex(-0.5 * p, -root)
    big = -(0.5 * p + math.copysign(root, p))
    return complex(big, 0.0), complex(q / big, 0.0)


def _circle_around_clusters(roots: ComplexArray, how: PoleSettings) -> tuple[ComplexArray, ComplexArray]:
    """Poles and weights of ``1/prod(s - roots)`` where some roots nearly coincide.

    The sum of residues of a cluster is a contour integral around it; the trapezoid rule on a circle
    has the form of a sum over poles, and no cancellation.
    """
    free = list(roots[roots.imag >= 0])
    places: list[complex] = []
    weights: list[complex] = []
    while free:
        members = [free.pop(0)]
        grown = True
        while grown:
            centre = sum(members) / len(members)
            spread = max(abs(z - centre) for z in members)
            # Alone: nothing to do unless a neighbour, a conjugate included, is too close.
            radius = max(how.clearance * spread, how.radius * abs(centre))
            reach = how.close * abs(centre) if len(members) == 1 else how.clearance * radius
            near = [z for z in free if abs(z - centre) < reach]
            if any(0 < z.imag < 0.5 * reach for z in members):  # meets its own conjugate: a real centre
                near += [z.conjugate() for z in members if z.conjugate() not in members and z.imag > 0]
            grown = bool(near)
            members += near
            free = [z for z in free if z not in near]
        if len(members) == 1:
            z = members[0]
            others = np.delete(roots, np.argmin(np.abs(roots - z)))
            places.append(z)
            weights.append((2.0 if z.imag > 0 else 1.0) / np.prod(z - others))
            continue
        angle = (np.arange(how.nodes) + 0.5) * (2 * np.pi / how.nodes)
        offset = radius * np.exp(1j * angle)
        real = abs(centre.imag) < radius
        if real:
            centre, offset = complex(centre.real), offset[: how.nodes // 2]
        for z in centre + offset:
            places.append(z)
            weights.append(2.0 * (z - centre) / how.nodes / np.prod(z - roots))
    return np.array(places), np.array(weights)


def modes(rig: Setup, settings: PoleSettings | None = None) -> Modes:
    """Poles and weights for each parameter set; all of the sets have a lag, or none."""
    return _modes(rig, poles(contact_polynomial(rig)), 1.0, 2, settings or PoleSettings())


def tip_modes(rig: Setup) -> Modes:
    """Poles and weights of how far the tip is behind the ball's rest, while it touches no ball.

    As `modes`, of ``-k_s q/(m s^2 + c_s s + k_s)``.
    """
    roots = np.array([_quadratic(*pq) for pq in zip(rig.c_s / rig.m, rig.k_s / rig.m, strict=True)])
    return _modes(rig, roots, -1.0, 0, PoleSettings())


def _modes(rig: Setup, roots: ComplexArray, sign: float, zeros: int, how: PoleSettings) -> Modes:
    """Poles and weights of ``sign k_s q/m s^zeros/prod(s - roots)``, behind the lag where there is one."""
    lead = sign * rig.k_s * rig.q / rig.m
    if rig.lag[0] > 0.0:
        roots = np.concatenate([roots, -1.0 / rig.lag[:, None]], axis=1)
        lead = lead / rig.lag
    n = roots.shape[1]
    pole, weight, close = _residues(roots, how.close)
    crowded = np.flatnonzero(close)
    if crowded.size:
        replaced = [_circle_around_clusters(roots[i], how) for i in crowded]
        width = max(n, *(len(place) for place, _ in replaced))
        pole = np.pad(pole, ((0, 0), (0, width - n)))
        weight = np.pad(weight, ((0, 0), (0, width - n)))
        for i, (place, value) in zip(crowded, replaced, strict=True):
            pole[i], weight[i] = 0.0, 0.0
            pole[i, : len(place)], weight[i, : len(place)] = place, value
    return Modes(pole, lead[:, None] * pole**zeros * weight, lead, roots)


@compiled
def _residues(roots, least):  # type: ignore[no-untyped-def]
    """Poles, of pairs one, and weights of ``1/prod(s - roots)``; and where two roots are nearly one, by `least`."""
    pole, weight, close = np.zeros_like(roots), np.zeros_like(roots), np.zeros(len(roots), np.bool_)
    for i in range(len(roots)):
        for j in range(roots.shape[1]):
            z, product = roots[i, j], 1.0 + 0.0j
            for k in range(roots.shape[1]):
                if k != j:
                    product *= z - roots[i, k]
                    close[i] |= abs(z - roots[i, k]) < least * abs(z)
            if z.imag >= 0.0:
                # Of a double root there is none; what is close is replaced.
                pole[i, j], weight[i, j] = z, (2.0 if z.imag > 0.0 else 1.0) / product if product != 0.0 else 0.0j
    return pole, weight, close


@compiled(inside=True)
def _modulus(z):  # type: ignore[no-untyped-def]
    """Modulus without the guards of `abs`: zero below 1e-162, which no voltage comes to."""
    return math.sqrt(z.real * z.real + z.imag * z.imag)


@compiled(borrows=True)
def _tabulate(place, amplitude, n, table):  # type: ignore[no-untyped-def]
    """What the march needs of each mode, in real numbers, so that no modulus is taken twice."""
    for k in range(n):
        modulus, rate = _modulus(amplitude[k]), _modulus(place[k])
        table[k, 0], table[k, 1] = place[k].real, place[k].imag
        table[k, 2], table[k, 3] = amplitude[k].real, amplitude[k].imag
        table[k, 4], table[k, 5], table[k, 6] = modulus, modulus * rate**2, modulus * rate**3


@compiled(borrows=True)
def _evaluate(table, n, t):  # type: ignore[no-untyped-def]
    """Value, two derivatives, and the bounds on |d''|, |d'''| from `t` on."""
    d0 = d1 = d2 = b2 = b3 = noise = 0.0
    for k in range(n):
        re, im = table[k, 0], table[k, 1]
        decay = re * t
        if decay < -700.0:
            continue
        size = 1.0 if re == 0.0 else math.exp(decay)
        ar, ai = table[k, 2] * size, table[k, 3] * size
        noise += table[k, 4] * size
        b2 += table[k, 5] * size
        b3 += table[k, 6] * size
        if im == 0.0:
            d0 += ar
            d1 += ar * re
            d2 += ar * re * re
        else:
            c, s = math.cos(im * t), math.sin(im * t)
            zr, zi = ar * c - ai * s, ar * s + ai * c
            d0 += zr
            d1 += zr * re - zi * im
            d2 += zr * (re * re - im * im) - 2.0 * zi * re * im
    return d0, d1, d2, b2, b3, noise


@compiled
def _first_root(d0, d1, curvature):  # type: ignore[no-untyped-def]
    """Positive root of ``d0 + d1 h - curvature h^2/2`` for positive `d0` and `curvature`, without cancellation."""
    root = math.sqrt(d1 * d1 + 2.0 * curvature * d0)
    return 2.0 * d0 / (root - d1) if d1 < 0.0 else (d1 + root) / curvature


@compiled
def safe_step(d0, d1, d2, b2, b3):  # type: ignore[no-untyped-def]
    """Largest step found over which the bounds keep the indentation positive."""
    safe = _first_root(d0, d1, b2)
    trial = safe
    for _ in range(60):
        trial *= 1.6
        curvature = b3 * trial / 3.0 - d2  # d(t+h) >= d0 + d1 h - curvature h^2/2 for all h <= trial
        if curvature > 0.0:
            reach = _first_root(d0, d1, curvature)
        else:
            under = d1 * d1 + 2.0 * curvature * d0
            reach = trial if d1 >= 0.0 or under < 0.0 else 2.0 * d0 / (-d1 + math.sqrt(under))
        if reach < trial:
            return max(safe, reach)
        safe = trial
    return safe


@compiled(borrows=True)
def _impulse(place, amplitude, n, t):  # type: ignore[no-untyped-def]
    """Integral of the indentation over [0, t]; expm1 keeps the digits of slow poles."""
    total = 0.0
    for k in range(n):
        grow = math.expm1(place[k].real * t)
        if place[k].imag == 0.0:
            total += amplitude[k].real * grow / place[k].real
            continue
        half = 0.5 * place[k].imag * t
        c, s = math.cos(half), math.sin(half)
        growth = complex(grow * (c * c - s * s) - 2.0 * s * s, (1.0 + grow) * 2.0 * s * c)  # exp(place t) - 1
        total += (amplitude[k] * growth / place[k]).real
    return total


@compiled(borrows=True)
def _twice(place, amplitude, n, t):  # type: ignore[no-untyped-def]
    """Integral of the integral of the indentation over [0, t]."""
    total = 0.0
    for k in range(n):
        z = place[k] * t
        rest = np.exp(z) - 1.0 - z
        if abs(z) < 1e-3:  # the remainder loses its digits where its series is short
            rest = z * z * (0.5 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z / 120.0)))
        total += (amplitude[k] * rest / (place[k] * place[k])).real
    return total


@compiled(borrows=True)
def _march(table, n, t, end, rising, lift, drift, most=2_000_000):  # type: ignore[no-untyped-def]
    """First zero of the modes' sum plus ``lift + drift t`` in (t, end], infinity if none.

    Also whether it has yet to rise. NaN after `most` steps.
    """
    for _ in range(most):
        d0, d1, d2, b2, b3, noise = _evaluate(table, n, t)
        above = lift + drift * t
        if drift >= 0.0 and noise < above:
            return math.inf, rising  # too little motion is left
        d0 += above
        d1 += drift
        floor = _NOISE * (noise + abs(above))
        if d0 <= floor:
            # Indistinguishable from contact at zero: on the way down it is the separation. What falls below zero before
            # it has risen at all, as behind a jump far smaller than the swing that follows, has separated on the way.
            if d0 < -floor or (d1 <= 0.0 and not rising):
                return t, rising
            d0 = floor
            d1 = max(d1, 0.0)
        else:
            rising = False
        if b2 == 0.0 and d1 >= 0.0:
            return math.inf, rising
        step = safe_step(d0, d1, d2, b2, b3)
        if t + step == t or (d1 < 0.0 and step <= 2e-16 * t):
            return t, rising
        t += step
        if t > end:
            return math.inf, rising
    return math.nan, rising


@compiled(borrows=True)
def _highest(place, amplitude, n, end, spring, damper, force, table, best, peak=1e-11, most=2_000_000):  # type: ignore[no-untyped-def]
    """Largest ``spring d + damper d'`` over [0, end], or `best` if that is larger.

    A step is as long as the bounds show that the force rises throughout, so that its end is its highest, or that it
    stays below the highest so far. A force counts as higher if it is by the part `peak`.
    """
    for k in range(n):
        force[k] = amplitude[k] * (spring + damper * place[k])
    _tabulate(place, force, n, table)
    t = 0.0
    for _ in range(most):
        f0, f1, f2, b2, b3, noise = _evaluate(table, n, t)
        best = max(best, f0)
        if t >= end or b2 == 0.0:
            return best
        step = safe_step(best * (1.0 + peak) - f0 + _NOISE * noise, -f1, -f2, b2, b3)
        if f1 > 0.0:
            # f'(t + h) >= f1 - b2 h, and >= f1 + f2 h - b3 h^2/2
            step = max(step, f1 / b2, (f2 + math.sqrt(f2 * f2 + 2.0 * b3 * f1)) / b3)
        t = min(t + step, end)
    return math.nan


@compiled
def _aside(s, drive, apart=1e-7):  # type: ignore[no-untyped-def]
    """The pole itself, or one next to the drive's where they coincide: `apart` from it, relative to it.

    It costs the square of (cycles in contact x this), and eps over it.
    """
    shift = apart * _modulus(drive)
    return drive - shift if _modulus(s - drive) < shift else s


@compiled(borrows=True)
def _start(place, amplitude, n, order, lowest):  # type: ignore[no-untyped-def]
    """Time until which the indentation is positive for sure, its first derivative that does not vanish being given."""
    bound = 0.0
    for k in range(n):
        bound += _modulus(amplitude[k]) * _modulus(place[k]) ** (order + 1)
    return (order + 1) * lowest / bound


@compiled(borrows=True)
def _watched(  # type: ignore[no-untyped-def]
    place, amplitude, n, begin, reached, lift, drift, once, twice, spring, damper, behind, moments, k, seen
):  # fmt: skip
    """Write ball, its speed and tip, from rest, at the moments from number `k` on that a piece holds; the next one's.

    The piece began at `begin` and is followed for the time `reached`; `once` and `twice` are the integral of the
    indentation until its beginning, and that one's. The modes may be those of a tip that is `behind`, and of no ball.
    """
    while k < len(moments) and moments[k] < math.inf and moments[k] <= begin + reached:
        t = max(moments[k] - begin, 0.0)
        d = ball = speed = 0.0
        for j in range(n):
            d += (amplitude[j] * np.exp(place[j] * t)).real
        if behind:
            d = -(d + lift + drift * t)
        else:
            single = once + _impulse(place, amplitude, n, t)
            ball = spring * (twice + once * t + _twice(place, amplitude, n, t)) + damper * single
            speed = spring * single + damper * d
        seen[k, 0], seen[k, 1], seen[k, 2] = ball, speed, ball + d
        k += 1
    return k


@compiled(inside=True)
def _jump(da, dC, reach):  # type: ignore[no-untyped-def]
    """By how much a command jumps whose level and phasor change by so much; zero within rounding of its `reach`."""
    value = da + dC.imag
    return value if abs(value) > _ROUNDED * (abs(da) + abs(dC.real) + abs(dC.imag) + reach) else 0.0


@compiled(inside=True)
def _leading(da, db, dC, omega, reach):  # type: ignore[no-untyped-def]
    """First derivative of the command, from a rest, that does not vanish: its order and value; zero if none."""
    value = _jump(da, dC, reach)
    if value != 0.0:
        return 0, value
    rate = db + omega * dC.real
    if abs(rate) > _ROUNDED * (abs(db) + omega * (abs(dC.real) + abs(dC.imag))):
        return 1, rate
    return 2, -omega * omega * dC.imag


@compiled(inside=True)
def _answer(s, value, da, db, dC, omega):  # type: ignore[no-untyped-def]
    """`s` times the Laplace transform of a change of the command: its level, slope and phasor change by so much.

    What is fast compared with the drive sees the level and the swing's value together, and the two may cancel.
    """
    found = db / s if db != 0.0 else 0j
    below = s * s + omega * omega
    if _modulus(s) > omega:
        return found + value + omega * (dC.real * s - omega * dC.imag) / below
    return found + da + s * (omega * dC.real + s * dC.imag) / below


@compiled(borrows=True)
def _grown(place, n, span, before, end, grow, growth):  # type: ignore[no-untyped-def]
    """What a mode is multiplied by within a piece of this length, and its integral; for which length they are.

    They stay where the piece is as long as the one `before`: samples at equal distances differ by roundings of the
    time, up to `end`.
    """
    if abs(span - before) <= _ROUNDING * end:
        return before
    for k in range(n):
        z = place[k] * span
        grow[k] = np.exp(z)
        growth[k] = (grow[k] - 1.0) / place[k]
        if abs(z) < 1e-2:  # the difference loses its digits where its series is short
            growth[k] = span * (1.0 + z / 2 * (1.0 + z / 3 * (1.0 + z / 4 * (1.0 + z / 5 * (1.0 + z / 6)))))
    return span


@compiled(inside=True)
def _is_apart(place, amplitude, n, span, lift, drift):  # type: ignore[no-untyped-def]
    """Whether a bound on the curvature alone shows that the indentation stays above zero for so long."""
    d0, d1, b2, size = lift, drift, 0.0, abs(lift)
    for k in range(n):
        s, a = place[k], amplitude[k]
        modulus = abs(a.real) + abs(a.imag)
        d0 += a.real
        d1 += (a * s).real
        b2 += modulus * (s.real * s.real + s.imag * s.imag)
        size += modulus
    return d0 + min(d1, 0.0) * span - 0.5 * b2 * span * span > _NOISE * size


@compiled(borrows=True)
def _follow(n, rows, point, index, a, b, before, horizon, above, still, work):  # type: ignore[no-untyped-def]
    """Go on from the end of one line of a table, through others as long, while a bound holds the tip at the ball.

    As `_separate` does it, with a mode in each lane. `index` is that line's number, from the start of the first period;
    `a` and `b` are level and slope at its end. Returns how many lines, the integral of the indentation over them, and
    level, slope and time at the end of the last.
    """
    place, amplitude, by_level, by_slope, grow, growth, _, _, held = work
    first, count, rate, scale = int(point[FIRST]), int(point[COUNT]), point[RATE], point[SCALE]
    number = index % count
    origin, limit = (index // count) * point[PERIOD] - point[TURN], min(horizon, point[LAST])
    for k in range(WIDTH):
        s, g, c = (place[k], grow[k], growth[k]) if k < n else (0j, 0j, 0j)
        p, q, z = (amplitude[k], by_level[k], by_slope[k]) if k < n else (0j, 0j, 0j)
        held[0, k], held[1, k], held[2, k], held[3, k] = p.real, p.imag, g.real, g.imag
        held[4, k], held[5, k], held[6, k], held[7, k] = q.real, q.imag, z.real, z.imag
        held[8, k], held[9, k], held[10, k], held[11, k] = s.real, s.imag, c.real, c.imag
    real, imag = load(held, 0), load(held, WIDTH)
    turn, fade = load(held, 2 * WIDTH), load(held, 3 * WIDTH)
    level_real, level_imag = load(held, 4 * WIDTH), load(held, 5 * WIDTH)
    slope_real, slope_imag = load(held, 6 * WIDTH), load(held, 7 * WIDTH)
    s_real, s_imag = load(held, 8 * WIDTH), load(held, 9 * WIDTH)
    c_real, c_imag = load(held, 10 * WIDTH), load(held, 11 * WIDTH)
    square = s_real * s_real + s_imag * s_imag
    swept = splat(0.0)
    done, now = 0, (origin + rows[first + number + 1, BEGIN]) / rate if number + 1 < count else math.inf
    while number + 1 < count:
        at = first + number + 1
        end = (origin + (rows[at + 1, BEGIN] if number + 2 < count else point[PERIOD])) / rate
        span = end - now
        if end > limit or abs(span - before) > _ROUNDING * end:
            break
        level, slope = point[BIAS] + scale * rows[at, LEVEL], scale * rows[at, SLOPE] * rate
        da, db = level - a, slope - b
        new_real = real * turn - imag * fade + level_real * da + slope_real * db
        new_imag = real * fade + imag * turn + level_imag * da + slope_imag * db
        modulus = size(new_real) + size(new_imag)
        most = total(modulus)
        lift = above + still[0] * (level - point[IDLE]) + still[1] * slope
        falls = min(total(new_real * s_real - new_imag * s_imag) + still[0] * slope, 0.0) * span
        left = total(new_real) + lift + falls - 0.5 * total(modulus * square) * span * span
        if not left > _NOISE * (most + abs(lift)):
            break
        real, imag = new_real, new_imag
        swept = swept + (real * c_real - imag * c_imag)
        a, b, now = level + slope * span, slope, end
        number, done = number + 1, done + 1
    store(held, 0, real)
    store(held, WIDTH, imag)
    for k in range(n):
        amplitude[k] = complex(held[0, k], held[1, k])
    return done, total(swept), a, b, now


@compiled(inside=True)
def _commanded(rows, point, row, k, phase, now):  # type: ignore[no-untyped-def]
    """End of a command's piece, and its level, slope and phasor from `now` on."""
    anchor, end, level, slope, swing, psi = command(rows, point, row, k, phase)
    if slope != 0.0:
        level += slope * (now - anchor)
    phasor = 0j
    if swing != 0.0:
        angle = psi + point[OMEGA] * now
        phasor = complex(swing * math.cos(angle), swing * math.sin(angle))
    return end, level, slope, phasor


@compiled(inside=True)
def _at_rest(modes, drive, work):  # type: ignore[no-untyped-def]
    """Write the poles of some modes, at rest, and their answers to a level.

    Returns how many they are, and the lasting answers: to a swing, and to a level and a slope.
    """
    pole, weight, lead, roots, zeros = modes
    place, amplitude, by_level, _, grow, _, _, _, _ = work
    n = 0
    for k in range(len(pole)):
        if weight[k] != 0:
            s = _aside(pole[k], drive) if drive != 0.0 else pole[k]
            place[n], amplitude[n], by_level[n], grow[n] = s, 0.0, weight[k] / s, 1.0
            n += 1
    steady = lead + 0j
    if drive != 0.0:
        place[n] = drive
        for _ in range(zeros):
            steady *= drive
        product = 1.0 + 0j
        for k in range(len(roots)):
            product *= drive - _aside(roots[k], drive)
        steady /= product
    level = slope = 0.0
    if zeros == 0:  # of s in the numerator
        product, level = 1.0 + 0j, lead
        for s in roots:
            product *= -s
            slope += (1.0 / s).real
        level /= product.real
    return n, steady, (level, level * slope)


@compiled(borrows=True)
def _struck(modes, tip, rate, bend, n, work):  # type: ignore[no-untyped-def]
    """Give the modes of a contact, at rest, the speed with which the tip comes back, and the state of the lag.

    The equations are :math:`D = (v + (a + v c_s/m)/(s + r)) s^2/P` with the tip's speed and acceleration `v`, `a` and
    one over the lag `r`. Without a lag the fraction in the brackets is absent.
    """
    _, _, lead, _, _ = modes
    _, _, _, roots, _ = tip
    place, amplitude, by_level, _, _, _, _, _, _ = work
    rates = 0.0
    for s in roots:
        rates -= s.real  # c_s/m + r
    for j in range(n):
        s = place[j]
        state = rate + 0j if len(roots) == 2 else rate * (s + rates) + bend
        amplitude[j] = by_level[j] * s * state / lead


@compiled(inside=True)
def _separate(  # type: ignore[no-untyped-def]  # noqa: C901, PLR0915
    contact, tip, rows, point, phase, lift, pressed, horizon, waiting, again, placed, forced, spring, damper, work,
    moments, seen, accuracy=1e-9,
):  # fmt: skip
    """Separation under a command: (time, integral of the indentation until then, integral of that, highest force).

    What is to be `seen` at some moments until then is written there, as by `_watched`.

    The force is the contact's beyond that at rest, over the ball's mass.

    A tip that first draws back is followed until it comes back, by the time `waiting`; the contact then has until
    `again`. The time is negative without modes of the tip, and where the tip's place, a small rest of slow modes, has
    lost the `accuracy` in units of the mean indentation.

    The time is infinite without a separation.
    """
    place, amplitude, by_level, by_slope, grow, growth, force, table, _ = work
    swings = point[OMEGA] != 0.0
    drive = 1j * point[OMEGA]
    row = first_row(rows, point, phase)
    k, start = first_move(rows, point, row, phase)
    if start == math.inf:
        return start, 0.0, 0.0, 0.0
    now = start
    end, level, slope, phasor = _commanded(rows, point, row, k, phase, now)
    order, lowest = _leading(level - point[IDLE], slope, phasor, point[OMEGA], point[REACH])
    behind = lowest < 0.0 and not pressed
    if behind and len(tip[0]) == 0:
        return -1.0, 0.0, 0.0, 0.0
    modes = tip if behind else contact
    n_modes, steady, still = _at_rest(modes, drive, work)
    order, lowest = len(modes[3]) - modes[4] + order, modes[2] * lowest
    above, until = (0.0, waiting) if behind else (lift, horizon)
    # The command just before: level, slope and phasor of the swing.
    a, b, C = point[IDLE], 0.0, 0j
    once = twice = top = rounded = 0.0
    before = -1.0
    rising, begins, ramps, moved = True, True, False, False  # the last: whether the command is to be asked again
    watched = 0
    while watched < len(moments) and moments[watched] <= now:
        seen[watched] = 0.0
        watched += 1
    while True:
        if moved:
            end, level, slope, phasor = _commanded(rows, point, row, k, phase, now)
        moved, span = True, end - now
        da, db, dC = level - a, slope - b, phasor - C
        if db != 0.0 and not ramps:
            ramps = True
            for j in range(n_modes):
                by_slope[j] = by_level[j] / place[j]
        value = _jump(da, dC, point[REACH]) if swings else 0.0
        for j in range(n_modes):
            amplitude[j] *= grow[j]
            if swings:
                amplitude[j] += by_level[j] * _answer(place[j], value, da, db, dC, point[OMEGA])
            else:
                amplitude[j] += by_level[j] * da
                if db != 0.0:
                    amplitude[j] += by_slope[j] * db
        n = n_modes
        if swings:
            amplitude[n] = steady * complex(phasor.imag, -phasor.real)
            n += 1
        rest, drift = above + still[0] * (level - point[IDLE]) + still[1] * slope, still[0] * slope
        t = 0.0
        if begins:
            begins = False
            if lowest > 0.0:
                t = min(_start(place, amplitude, n, order, lowest), span)
        elif (
            not (swings or placed or forced or rising)
            and end <= until
            and _is_apart(place, amplitude, n, span, rest, drift)
        ):
            before = _grown(place, n, span, before, end, grow, growth)
            for j in range(n):
                once += (amplitude[j] * growth[j]).real
            a, b, now, k = level + slope * span, slope, end, k + 1
            if ramps and phase == 0.0 and n <= WIDTH:
                more, swept, a, b, later = _follow(n, rows, point, row + k - 1, a, b, before, until, above, still, work)
                if more:
                    once, now, k = once + swept, later, k + more
            continue
        _tabulate(place, amplitude, n, table)
        # Infinity, whether there is no zero or too little motion for one, ends this piece only.
        t, rising = _march(table, n, t, min(span, until - now), rising, rest, drift)
        reached = span if math.isinf(t) else t
        if watched < len(moments):
            watched = _watched(
                place, amplitude, n, now, reached, rest, drift, once, twice, spring, damper, behind, moments, watched,
                seen,
            )  # fmt: skip
        if math.isinf(reached):
            return reached, once, twice, top
        if behind and not math.isinf(t):
            _, rate, bend, _, _, noise = _evaluate(table, n, t)
            speed = -(rate + drift)
            rounded = _NOISE * (noise + abs(rest + drift * t))
            n_modes, steady, still = _at_rest(contact, drive, work)
            _struck(contact, tip, speed, -bend, n_modes, work)
            order, lowest, above, until, behind = 1, speed, lift, again, False
            a, b, C, now = point[IDLE], 0.0, 0j, now + t
            start = now
            once = twice = 0.0
            before, rising, begins, ramps = -1.0, True, True, False
            continue
        if placed:
            twice += once * reached + _twice(place, amplitude, n, reached)
        if forced and not behind:
            top = _highest(place, amplitude, n, reached, spring, damper, force, table, top)
        if not math.isinf(t):
            once += _impulse(place, amplitude, n, reached)
            found = now + t if rounded * (now + t - start) <= accuracy * once else -1.0
            return found, once, twice, top
        if end > until:
            return math.inf, once, twice, top
        before = _grown(place, n_modes, span, before, end, grow, growth)
        if swings:
            once += _impulse(place, amplitude, n, reached)
        else:
            for j in range(n):
                once += (amplitude[j] * growth[j]).real
        a, b = level + slope * span, slope
        angle = point[OMEGA] * span
        C = phasor * complex(math.cos(angle), math.sin(angle)) if swings else 0j
        now, k = end, k + 1


@compiled
def _launch(  # type: ignore[no-untyped-def]
    begin, stop, contact, tip, spring, damper, lift, lean, phase, scale, idle, horizon, placed, forced, rows, points,
    moments, when, speed, where, status, peak, seen,
):  # fmt: skip
    n_points = when.shape[1]
    first = tip.pole.shape[1] == 0  # a tip that draws back is but noted
    for i in range(begin, stop):
        width = max(contact.pole.shape[1], tip.pole.shape[1]) + 1
        lines = np.empty((7, width), np.complex128)
        held = np.empty((12, WIDTH))
        work = lines[0], lines[1], lines[2], lines[3], lines[4], lines[5], lines[6], np.empty((width, 7)), held
        point = np.empty(COMMAND)
        touching = contact.pole[i], contact.weight[i], contact.lead[i], contact.roots[i], 2
        alone = tip.pole[i], tip.weight[i], tip.lead[i], tip.roots[i], 0
        for j in range(n_points):
            if not first and status[i, j] != DRAWN_BACK:
                continue
            driven(points[j], scale[i], idle[i], point)
            when[i, j], speed[i, j], where[i, j], status[i, j], peak[i, j] = 0.0, 0.0, 0.0, AT_REST, math.nan
            if point[REACH] == 0.0:
                seen[i, j] = 0.0
                continue
            waiting, last = point[LENGTH] + HORIZON_PERIODS / point[FREQUENCY], 0.0
            for k in range(moments.shape[1]):
                seen[i, j, k] = math.nan
                if moments[j, k] < math.inf:
                    last = moments[j, k]
            waiting = max(waiting, last)
            again = max(horizon[i], waiting)
            t, once, twice, top = _separate(
                touching, alone, rows, point, phase_of(point, phase[i]), lift[i], lean[i] > 0.0,
                again if lift[i] > 0.0 else max(HORIZON, last), waiting, again, placed, forced, spring[i], damper[i],
                work, moments[j], seen[i, j],
            )  # fmt: skip
            if t < 0.0:
                when[i, j], speed[i, j], status[i, j] = math.nan, 0.0, DRAWN_BACK
                continue
            if not math.isfinite(t):
                when[i, j], status[i, j] = math.nan, NO_SEPARATION
                continue
            when[i, j] = t
            speed[i, j] = spring[i] * once - damper[i] * lift[i]
            where[i, j] = spring[i] * twice + damper[i] * once
            status[i, j] = LAUNCHED if speed[i, j] > 0.0 else DRAWN_BACK
            peak[i, j] = top


def contact_horizon(k_c: FloatArray, ball: FloatArray) -> FloatArray:
    """Time, s, after which a ball still in contact counts as not launched, unless that is `HORIZON_PERIODS` off."""
    return np.minimum(4 * np.pi * np.sqrt(ball / k_c), HORIZON)


def separation(
    design: Design,
    rig: Setup,
    placed: bool = False,
    forced: bool = False,
    seen: FloatArray | None = None,
    *,
    parted: bool = True,
    threads_from: int = 1000,
    together: int = 512,
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int8], FloatArray]:
    """Time (s), ball speed (m/s) and place (m) at the first separation, what happened, and the highest force (N).

    Each is (n_sets, n_points).

    Parameters
    ----------
    design : Design
        Measurement conditions.
    rig : Setup
        ``k_c > 0``, dampings >= 0; no gap, no slew limit, ``0 <= phase <= pi/2``, ``pull = 1``, ``cycles = 0``,
        ``rub = 0``.
    placed : bool
        Whether the ball's place is needed; it is meaningless otherwise.
    forced : bool
        Whether the contact's highest force is; likewise.
    seen : (n_sets, n_points, n_moments, 3) array, optional
        Is filled with the ball's place from rest (m), its speed (m/s) and the tip's place (m) at the design's moments,
        as far as the ball is in contact; NaN behind. It takes the places to be needed.
    parted : bool
        Whether a tip that first draws back is followed until it strikes the ball; else that is `DRAWN_BACK`, as where
        a ball separates inwards.
    threads_from : int
        Trajectories above which it is worth waking threads: that costs about as much as so many.
    together : int
        Sets that are followed at once: more leave the cache and gain nothing.
    """
    n_sets = len(rig.k_c)
    shape = (n_sets, design.n_points)
    every = tuple(np.empty(shape, kind) for kind in (float, float, float, np.int8, float))
    when = every[0]
    moments = np.empty((design.n_points, 0)) if seen is None else design.moments
    threads = n_threads() if when.size > threads_from else 1
    lags = rig.lag > 0.0
    for kind in np.unique(lags):
        chosen = np.flatnonzero(lags == kind)
        for first in range(0, len(chosen), together):
            part = chosen[first : first + together]
            one = rig if len(part) == n_sets else rig.take(part)
            batch = modes(one)
            press = one.M * one.g * one.lean / one.l
            found = tuple(np.empty((len(part), design.n_points), kind.dtype) for kind in every)
            here = np.empty((*found[0].shape, moments.shape[1], 3))
            rest = (
                one.k_c / one.M, one.c_c / one.M, (press + one.bond) / one.k_c, one.lean, one.phase, one.scale,
                one.idle, contact_horizon(one.k_c, one.M), placed or seen is not None, forced, *design.commands,
                moments, *found, here,
            )  # fmt: skip
            none = np.empty((len(part), 0), complex)
            share(_launch, len(part), (batch, Modes(none, none, batch.lead, none), *rest), threads=threads)
            if parted and (found[3] == DRAWN_BACK).any():
                share(_launch, len(part), (batch, tip_modes(one), *rest), threads=threads)
            if forced:
                found[-1][:] = found[-1] * one.M[:, None] + press[:, None]
            for target, values in zip(every, found, strict=True):
                target[part] = values
            if seen is not None:
                seen[part] = here
    return every  # type: ignore[return-value]

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
from typing import NamedTuple

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
    EVENLY,
    EXTRAPOLATE,
    NODES,
    ONCE_TO_BERNSTEIN,
    RATIOS,
    TO_LEGENDRE,
    TWICE_TO_BERNSTEIN,
    VALUES_TO_BERNSTEIN,
    A,
    C,
    basis,
)
from psafit.simulate.command import COMMAND, FREQUENCY, IDLE, JUMPS, LENGTH, REACH, driven
from psafit.simulate.compiled import compiled, last, least, load, size, solve, splat, store, times, total
from psafit.simulate.design import Design
from psafit.simulate.threads import n_threads, share

# Error admitted in one step, relative to the ball's speed: see docs/numerics.md for what it does to the launch range.
TOLERANCE = 3e-6

_MOST_BRANCHES = 8
_LEVELS = 96
_FINEST = -70  # 2^-70 s
_LENGTH = 2.0 ** np.arange(_FINEST, _FINEST + _LEVELS)  # s
_FIRST_RATIO, *_, _LAST_RATIO = RATIOS

# Errors below which a step grows by a level, by another, and so on.
_GROW = tuple(2.0 ** (-(NODES + 1.0) * (k + 0.1)) for k in range(1, 5))

FREE, PUSH, PULL, BOND = range(4)
# What ends a step: the contact, a change of the force's sign, the way back from a bond, the ball at rest, the ball torn
# off, the drive's piece.
_ENDS, _TURNS, _RETURNS, _RESTS, _TEARS, _PIECE = range(6)
# Launched, but found to be so much slower than the error was scaled for that the run must be repeated.
_TOO_SLOW = 9


class StepSettings(NamedTuple):
    """How steps are chosen, apart from the error that is admitted in one.

    Parameters
    ----------
    most_steps : int
        After which a trajectory ends: contacts that last for hundreds of periods, and balls that chatter to rest.
    parts : int
        Steps that it may take in addition for each piece of the command behind it, as a recording has many: more parts
        than a piece is divided into where an amplifier's limit begins and ends, and where the voltage turns or passes
        zero.
    most_runs : int
        How often a trajectory is followed, each time with smaller errors, for a launch that was too slow for them.
    iterations : int
        Of Newton's method for the contact force.
    force_error : float
        What Newton's method may leave of the force, as the square of its last change, in units of a step's error.
    first_step : float
        Length of the first step in units of the fastest mode's time.
    last_force : float
        Disagreement of law and polynomial where the contact ends, as an impulse, admitted in units of a step's error.
    last_impulse : float
        The same of the force over the time to the contact's end, below which a step may go across.
    resolved : float
        A swing about zero counts if it is this many times the step's error.
    usual_part : float
        The error is scaled for this part of the usual speed, until the ball has been faster.
    slow : float
        A ball slower than this, relative to the speed the error was scaled for, is followed again.
    rounding : float
        A speed that rounding alone makes, in units of stroke times frequency.
    """

    most_steps: int = 20_000
    parts: int = 8
    most_runs: int = 12
    iterations: int = 10
    force_error: float = 0.003
    first_step: float = 6.0
    last_force: float = 0.02
    last_impulse: float = 10.0
    resolved: float = 10.0
    usual_part: float = 0.03
    slow: float = 0.1
    rounding: float = 1e-15


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
def _first_root(coefficients, n, floor, stack):  # type: ignore[no-untyped-def]  # noqa: C901
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
def _force(d, rate, law):  # type: ignore[no-untyped-def]
    """Contact force and its two derivatives."""
    k_c, c_c, law_at, law_p, theta_at, out, out_at = law
    out[0], out[1], out[2] = k_c * d, k_c, 0.0
    out[3], out[4], out[5] = c_c * rate, 0.0, c_c
    for i in range(len(law_at)):
        call_law(law_at[i], d, rate, theta_at + law_p[i], out_at)
    return out[0] + out[3], out[1] + out[4], out[2] + out[5]


@compiled(borrows=True)
def _seat(press, law):  # type: ignore[no-untyped-def]
    """Indentation at rest under a constant press: Newton's method from above on a growing force."""
    d = press / law[0]
    for _ in range(200):
        force, slope, _ = _force(d, 0.0, law)
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
def _contact(F, alpha, beta, kappa, U1, U2, at, law, nodes, iterations, enough):  # type: ignore[no-untyped-def]
    """Newton's method for the contact force at the nodes; returns it, and whether it was found."""
    _, d_node, w_node, force, Fd, Fw = nodes
    for _ in range(iterations):
        store(d_node, 0, alpha - times(U2, at, F) * kappa)
        store(w_node, 0, beta - times(U1, at, F) * kappa)
        for i in range(NODES):
            force[i], Fd[i], Fw[i] = _force(d_node[i], w_node[i], law)
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
def _highest(b, n, end, best, stack, peak=1e-10):  # type: ignore[no-untyped-def]
    """Largest value over [0, end] of a Bernstein polynomial, or `best` where none is larger by the part `peak`."""
    first = stack[0]
    for i in range(n + 1):
        first[i] = b[i]
    for k in range(1, n + 1 if end < 1.0 else 0):  # the part before `end` (de Casteljau)
        for i in range(n, k - 1, -1):
            first[i] = (1.0 - end) * first[i - 1] + end * first[i]
    depth = 0
    while depth >= 0:
        part = stack[depth]
        best = max(best, part[0], part[n])
        bound = best
        for i in range(n + 1):
            bound = max(bound, part[i])
        if bound <= best * (1.0 + peak) or depth + 1 == len(stack):
            depth -= 1
            continue
        _split(part, stack[depth + 1], part, n)
        depth += 1
    return best


@compiled(inside=True)
def _peak(F, kappa, end, best, bern, stack):  # type: ignore[no-untyped-def]
    """Largest contact force of a step up to its cut, or `best` if that is larger."""
    store(bern, 0, times(VALUES_TO_BERNSTEIN, 0, F) * kappa)
    return _highest(bern, NODES - 1, end, best, stack)


@compiled(borrows=True)
def _is_noise(bern, n, theta, resolved):  # type: ignore[no-untyped-def]
    """Whether what begins on a zero and returns to it at `theta` does not rise above the step's error in between."""
    middle, _ = _bernstein(bern, n, 0.5 * theta)
    return middle < resolved


@compiled(inside=True)
def _top(place, speed, push, h, end, ball, best, bern, stack):  # type: ignore[no-untyped-def]
    """Highest place, m, of the ball in a step of `h` s up to its part `end`, or `best` if that is higher.

    It begins at a place with a speed, m/s; `push` are the forces on it at the nodes, N.
    """
    bern[0] = place
    store(bern, 1, (times(TWICE_TO_BERNSTEIN, 0, push) * (h / ball) + load(EVENLY, 0) * speed) * h + place)
    return _highest(bern, DEGREE, end, best, stack)


@compiled(inside=True)
def _remember(now, q, theta_at, calls, mem_z, mem_u):  # type: ignore[no-untyped-def]
    """Let what has a memory follow the voltage to where it is now."""
    branch_at, branch_p = calls[4], calls[5]
    for k in range(len(branch_at)):
        mem_z[k] = call_branch(branch_at[k], mem_z[k], mem_u[k], now, q, theta_at + branch_p[k])
        mem_u[k] = now


@compiled(inside=True)
def _settled(q, idle, theta_at, calls, mem_z, mem_u):  # type: ignore[no-untyped-def]
    """Stroke at which the stack rests: what the idle voltage, once it was reached from 0 V, has made of it."""
    _, _, factor_at, factor_p, branch_at, branch_p = calls
    stroke = q * idle
    for k in range(len(factor_at)):
        stroke *= call_stack_factor(factor_at[k], abs(idle), theta_at + factor_p[k])
    for k in range(len(branch_at)):
        mem_z[k], mem_u[k] = 0.0, idle
        if idle != 0.0:
            mem_z[k] = call_branch(branch_at[k], 0.0, 0.0, idle, q, theta_at + branch_p[k])
            stroke -= mem_z[k]
    return stroke


@compiled(inside=True)
def _at_rest(lean, gap, press, k_s, wall_k, away, law):  # type: ignore[no-untyped-def]
    """Places of wall, tip and ball before the drive begins, the indentation, and the regime that it begins with.

    A wall that does not give way has no stiffness here.
    """
    if lean > 0.0:
        d = _seat(press, law)
        xw = -press / wall_k if wall_k > 0.0 else 0.0
        x1 = -press / k_s
        return xw, x1 + xw, x1 - d + xw, d, PUSH
    return 0.0, 0.0, 0.0, -gap, FREE if gap > 0.0 or away <= 0.0 else PUSH


@compiled(inside=True)
def _level_for(level, room, rough, w, d, F, allowed):  # type: ignore[no-untyped-def]
    """Level of the shortest step that reaches the end of a piece, or of a shorter one."""
    if room < math.inf:
        while level > 0 and _LENGTH[level - 1] >= room:
            level -= 1
    if rough and w < 0.0 and d > 0.0 and abs(last(F) * d) > allowed * -w:
        # Not across the contact's end before what is left of the force no longer matters.
        level = max(min(level, math.floor(math.log2(-d / w)) - _FINEST), 0)
    return level


@compiled(inside=True)
def _pressed(alpha, beta, d, w, contact, answer, step, kept, cache, law, nodes, iterations, enough):  # type: ignore[no-untyped-def]
    """Contact force at the nodes, that of the law at the step's beginning, and whether the first was found."""
    regime, stuck, kappa = contact
    V1, V2 = answer
    level, previous, carried = step
    at = level * NODES * NODES
    if regime == FREE:
        return splat(0.0), 0.0, True
    if len(law[2]) == 0:
        # A linear law needs no iteration: f = G (k_c alpha + c_c beta).
        G, made_linear = cache[5], cache[7]
        which = (1 if regime == PULL else 0) + (2 if stuck else 0)
        if not made_linear[which, level]:
            _make_linear(G, which, level, kappa * law[0], V2, kappa * law[1], V1)
            made_linear[which, level] = True
        F = times(G, (which * _LEVELS + level) * NODES * NODES, alpha * law[0] + beta * law[1])
        return F, 0.0, True
    ratio = level - previous
    start = 0.0
    if carried and _FIRST_RATIO <= ratio <= _LAST_RATIO:
        F = times(EXTRAPOLATE, (ratio - _FIRST_RATIO) * NODES * NODES, kept)
    else:
        start, _, _ = _force(d, w, law)
        F = splat(start)
    F, found = _contact(F, alpha, beta, kappa, V1, V2, at, law, nodes, iterations, enough)
    return F, start, found


@compiled(inside=True)
def _unforced(stroke, x1, v1, d, w, against, k_s, c_s, wall, T1, T2, at, h):  # type: ignore[no-untyped-def]
    """What is known of the motion without the contact force: the stack's load, the wall's, indentation and its rate."""
    elapsed = load(C, 0) * h
    r = (stroke - (elapsed * v1 + x1)) * k_s - c_s * v1
    back = splat(0.0)
    mass, stiffness, damping, xw, vw, answers = wall
    if mass > 0.0:
        still = elapsed * vw + xw
        r = r + (still * k_s + c_s * vw)
        back = still * -stiffness - (r + damping * vw)
        r = r + times(answers, _LEVELS * NODES * NODES + at, back)
    alpha = times(T2, at, r) + ((elapsed * (0.5 * against) + w) * elapsed + d)
    return r, back, alpha, times(T1, at, r) + (elapsed * against + w)


@compiled(inside=True)
def _judged(r, F, kappa, beta, V1, S, at, h, found, stuck, opposed, v2, ball, tolerance, reference, grows):  # type: ignore[no-untyped-def]
    """Motion under a contact force, the speed that errors are relative to, and the error.

    It is what the ends of the series of ball's and stack's acceleration leave out.
    """
    acceleration = times(S, at, r - F * kappa)
    w_node = beta - times(V1, at, F) * kappa
    if not found:
        return acceleration, w_node, F, reference, 1e6
    push = splat(0.0) if stuck else F * kappa - opposed
    if grows:
        reference = max(reference, abs(v2 + h * total(load(A, (NODES - 1) * NODES) * push) / ball))
    error = h * (_tail(F) * kappa / ball + _tail(acceleration)) / (tolerance * reference)
    return acceleration, w_node, push, reference, error


@compiled(inside=True)
def _integrals(cut):  # type: ignore[no-untyped-def]
    """Where a step ends, its end or a place before, and the weights of the nodes in the two integrals up to there."""
    if cut > 1.0:
        return 1.0, load(A, (NODES - 1) * NODES), load(A2, (NODES - 1) * NODES)
    _, once = basis(cut)
    return cut, once, times(A, 0, once)


@compiled(inside=True)
def _wall_moved(wall, back, acceleration, cut, at, h):  # type: ignore[no-untyped-def]
    """Place and speed of the wall at the end of a step, or where it is cut."""
    mass, _, _, xw, vw, answers = wall
    if mass == 0.0:
        return xw, vw
    cut, once, twice = _integrals(cut)
    own = times(answers, at, back + times(answers, 2 * _LEVELS * NODES * NODES + at, acceleration))
    return xw + h * (cut * vw + h * total(twice * own)), vw + h * total(once * own)


@compiled(inside=True)
def _moved(x1, v1, x2, v2, lost_v2, d, lost_d, acceleration, push, w_node, cut, h, ball):  # type: ignore[no-untyped-def]
    """Places, speeds and indentation at the end of a step, or where it is cut."""
    cut, once, twice = _integrals(cut)
    x1 += h * (cut * v1 + h * total(twice * acceleration))
    x2 += h * (cut * v2 + h * total(twice * push) / ball)
    v1 += h * total(once * acceleration)
    v2, lost_v2 = _add(v2, lost_v2, h * total(once * push) / ball)
    d, lost_d = _add(d, lost_d, h * total(once * w_node))
    return x1, v1, x2, v2, lost_v2, d, lost_d


@compiled(inside=True)
def _last_of(trace):  # type: ignore[no-untyped-def]
    """The last moment of a trace; minus infinity where there is none."""
    found = -math.inf
    for moment in trace[0]:
        if moment < math.inf:
            found = moment
    return found


@compiled(inside=True)
def _watched(trace, k, begin, end, state, acceleration, push, h, ball, rest):  # type: ignore[no-untyped-def]
    """Write ball, its speed and tip, from rest, at a trace's moments from number `k` on until `end`; the next one's.

    They lie in a step that began at `begin` with some `state`, or before the first step.
    """
    moments, _, seen = trace
    x1, v1, x2, v2 = state
    while k < len(moments) and moments[k] <= end:
        theta = min(max((moments[k] - begin) / h, 0.0), 1.0)
        _, once = basis(theta)
        twice = times(A, 0, once)
        seen[k, 0] = x2 + h * (theta * v2 + h * total(twice * push) / ball) - rest[1]
        seen[k, 1] = v2 + h * total(once * push) / ball
        seen[k, 2] = x1 + h * (theta * v1 + h * total(twice * acceleration)) - rest[0]
        k += 1
    return k


@compiled(inside=True)
def _above_noise(first, swing, threshold, side, slip, noise, cut, level, fresh, bern, stack):  # type: ignore[no-untyped-def]
    """Where something passes a threshold before the place `cut`, and the level of a step that shows that it does."""
    theta, floor = _crossing(first, swing, threshold, side, fresh, slip, bern, stack)
    if theta < cut and fresh and level > 0 and _is_noise(bern, DEGREE, theta, noise + floor):
        level = max(level - 3, 0)
    return theta, level


@compiled(inside=True)
def _agreed(theta, threshold, F, w_node, h, level, allowed, law):  # type: ignore[no-untyped-def]
    """The level of a step across a contact's end on which law and polynomial agree there.

    A law may have no derivatives where the contact ends: the polynomial, carried on past that place, must still agree
    with the law there. If not, the place is approached in shorter steps.
    """
    values, _ = basis(theta)
    at_end, w_end = total(values * F), total(values * w_node)
    force, _, _ = _force(threshold, w_end, law)
    if abs(force - at_end) * theta * h > allowed and level > 0:
        return max(min(level - 1, math.floor(math.log2(max(theta, 1e-3) * h)) - _FINEST), 0)
    return level


@compiled(inside=True)
def _turned(F, side, unsure, resolved, cut, level, fresh, bern, stack, scratch):  # type: ignore[no-untyped-def]
    """Where the contact force changes its sign before `cut`, and the level of a step that shows that it does."""
    coefficients = times(VALUES_TO_BERNSTEIN, 0, F) * side
    store(bern, 0, coefficients)
    scale = -least(size(coefficients) * -1.0)
    floor = 1e-11 * scale
    if fresh:
        # A force that has only begun, as the fourth power of time behind a lag, is noise in its first coefficients: of
        # what the step does not resolve no sign is taken.
        floor = max(floor, unsure)
        if abs(bern[0]) < 1e-5 * scale:
            bern[0] = 0.0
    theta = _first_root(bern, NODES - 1, floor, stack)
    if fresh and theta < C[0]:
        # Nor does a law without derivatives there have one before the first node, where it is known: a change that is
        # real shows at the nodes of a shorter step.
        store(scratch, 0, F * side)
        if least(F * side) > 0.0:
            theta = 2.0
        elif scratch[0] > 0.0 and level > 0:
            return theta, max(level - 3, 0)
    if theta < cut and fresh and level > 0 and _is_noise(bern, NODES - 1, theta, resolved + floor):
        level = max(level - 3, 0)
    return theta, level


@compiled(inside=True)
def _torn_off(load_on_ball, grip, unsure, cut, fresh, bern, stack):  # type: ignore[no-untyped-def]
    """Where the force exceeds the grip of friction before `cut`, and in which direction."""
    way = 0.0
    for side in (1.0, -1.0):
        margin = load_on_ball * -side + grip
        floor = 1e-11 * -least(size(margin) * -1.0)
        if fresh:
            floor = max(floor, unsure)
        store(bern, 0, times(VALUES_TO_BERNSTEIN, 0, margin))
        theta = _first_root(bern, NODES - 1, floor, stack)
        if theta < cut:
            cut, way = theta, side
    return cut, way


@compiled(inside=True)
def _first_event(motion, d, v2, forces, errors, held, law, bern, stack, scratch):  # type: ignore[no-untyped-def]
    """The first event within a step, which is cut there.

    Returns (place, or 2 for none; which; way; level; whether law and polynomial disagree). A level below the step's
    asks for a shorter step instead.
    """
    regime, stuck, way, fresh, level, h, room = motion
    F, kappa, push, w_node, swing = forces
    slip, noise, unsure, resolved, allowed = errors
    press, grip, pull, release, ball = held
    cut, event = (room / h, _PIECE) if room <= h else (2.0, -1)
    side = -1.0 if regime == FREE else 1.0
    threshold = release if regime == BOND else 0.0
    theta, shorter = _above_noise(d, swing, threshold, side, slip, noise, cut, level, fresh, bern, stack)
    if shorter < level:
        return cut, event, way, shorter, False
    if theta < cut:
        if regime != FREE and len(law[2]) > 0:
            shorter = _agreed(theta, threshold, F, w_node, h, level, allowed, law)
            if shorter < level:
                return cut, event, way, shorter, True
        cut, event = theta, _ENDS
    if pull != 1.0 and regime in (PUSH, PULL):
        side = 1.0 if regime == PUSH else -1.0
        theta, shorter = _turned(F, side, unsure, resolved, cut, level, fresh, bern, stack, scratch)
        if theta < cut:
            cut, event = theta, _TURNS
    elif pull != 1.0 and regime == BOND:
        # Back to contact proper: only the law's exception for d >= 0 changes there.
        theta, shorter = _above_noise(d, swing, 0.0, -1.0, slip, noise, cut, level, fresh, bern, stack)
        if theta < cut:
            cut, event = theta, _RETURNS
    if shorter < level:
        return cut, event, way, shorter, False
    if grip > 0.0 and not stuck:
        gained = times(ONCE_TO_BERNSTEIN, 0, push) * (h / ball)
        theta, shorter = _above_noise(v2, gained + v2, 0.0, way, slip / h, noise / h, cut, level, fresh, bern, stack)
        if theta < cut:
            cut, event = theta, _RESTS
    elif grip > 0.0 and regime != FREE:
        theta, torn = _torn_off(F * kappa - press, grip, unsure, cut, fresh, bern, stack)
        if torn != 0.0:
            cut, event, way = theta, _TEARS, torn
    return cut, event, way, shorter, False


@compiled(inside=True)
def _regime_after(event, regime, d, w, bond, pull, release, law):  # type: ignore[no-untyped-def]
    """The regime behind an event of the contact, and the indentation that it begins with."""
    if event == _TURNS:
        return PULL if regime == PUSH else PUSH, d
    if event == _RETURNS or regime == FREE:
        start, _, _ = _force(0.0, w, law)
        return PULL if start < 0.0 and pull != 1.0 else PUSH, 0.0
    if regime != BOND and bond > 0.0:
        return BOND, 0.0
    return FREE, release


@compiled(inside=True)
def _held(force, press, grip):  # type: ignore[no-untyped-def]
    """Whether friction holds a ball against a force; else which way it moves, and against what."""
    way = math.copysign(1.0, force - press)
    return abs(force - press) <= grip, way, press + way * grip


@compiled(inside=True)
def _grown(level, error):  # type: ignore[no-untyped-def]
    """The level that suits a step after one of this error."""
    for limit in _GROW:
        if error < limit:
            level = min(level + 1, _LEVELS - 1)
    return level


@compiled(inside=True)
def _first_level(c_s, c_c, m, ball, k_s, k_c, f, first_step):  # type: ignore[no-untyped-def]
    """Level of the first step, which resolves the fastest mode; where that does not matter the steps grow at once."""
    rate = c_s / m + c_c * (1.0 / m + 1.0 / ball) + math.sqrt((k_s + k_c) / m + k_c / ball)
    level = math.floor(math.log2(min(0.1 / f, first_step / rate))) - _FINEST
    return min(max(level, 0), _LEVELS - 1)


@compiled(inside=True)
def _ready(level, rig, cache):  # type: ignore[no-untyped-def]
    """Make the matrices of steps of a length that were not needed before."""
    S, T1, T2, U1, U2, _, made, _, answers = cache
    if not made[level]:
        _make_level(
            level, rig.m, rig.M, rig.c_s, rig.k_s, rig.wall_mass, rig.wall_damping, rig.wall_stiffness, S, T1, T2, U1,
            U2, answers,
        )  # fmt: skip
        made[level] = True


@compiled(inside=True)
def _finer(level, error):  # type: ignore[no-untyped-def]
    """The level at which a step with too large an error is tried again."""
    return max(level - min(max(math.ceil(math.log2(error) / (NODES + 1.0) + 0.1), 1), 8), 0)


@compiled(inside=True)
def _passed(rig, theta_at, rows, point, calls, work):  # type: ignore[no-untyped-def]
    """Go on to the drive's next piece; the time at which it begins."""
    piece, _, _, _, mem_z, mem_u = work
    now = _drive.voltage(piece, piece[_drive.END])
    _remember(now, rig.q, theta_at, calls, mem_z, mem_u)
    t = piece[_drive.END]
    split = len(calls[2]) > 0 or len(calls[4]) > 0
    _drive.next_piece(piece, now, rows, point, rig.phase, rig.lag, rig.inverse_slew, split)
    return t


@compiled(inside=True)
def _allowed(how, piece):  # type: ignore[no-untyped-def]
    """Steps that a trajectory may take until this piece of the drive."""
    return how.most_steps + how.parts * piece[_drive.NUMBER]


@compiled(borrows=True)
def _tip_alone(rig, theta_at, rows, point, calls, cache, work, tolerance, how, reference, settled, trace, tip):  # type: ignore[no-untyped-def]
    """Follow the tip, from which the ball has gone for good, to the last moment of a trace that wants it."""
    moments, tipped, seen = trace
    if not tipped:
        return
    c_s, k_s, q = rig.c_s, rig.k_s, rig.q
    wall_mass, wall_k, wall_c = rig.wall_mass, rig.wall_stiffness, rig.wall_damping
    S, T1, T2, _, _, _, _, _, answers = cache
    piece, nodes, _, _, mem_z, mem_u = work
    t, x1, v1, xw, vw, tip_rest, level, watched, new_piece = tip
    step = 0
    while step < _allowed(how, piece):
        step += 1
        if watched == len(moments) or moments[watched] == math.inf:
            break
        if t >= piece[_drive.END]:
            t, new_piece = _passed(rig, theta_at, rows, point, calls, work), True
        if new_piece:
            new_piece = False
            _remember(_drive.voltage(piece, t), q, theta_at, calls, mem_z, mem_u)
        room = piece[_drive.END] - t
        level = _level_for(level, room, False, 0.0, 0.0, splat(0.0), 0.0)
        _ready(level, rig, cache)
        h = _LENGTH[level]
        at = level * NODES * NODES
        stroke = _strokes(piece, load(C, 0) * h + t, q, settled, theta_at, calls, mem_z, mem_u, nodes[3])
        wall = (wall_mass, wall_k, wall_c, xw, vw, answers)
        r, back, _, _ = _unforced(stroke, x1, v1, 0.0, 0.0, 0.0, k_s, c_s, wall, T1, T2, at, h)
        acceleration = times(S, at, r)
        reference = max(reference, abs(v1))
        error = h * _tail(acceleration) / (tolerance * reference)
        if error > 1.0 and level > 0:
            level = _finer(level, error)
            continue
        cut = min(room / h, 1.0)
        end = piece[_drive.END] if room <= h else t + h
        while watched < len(moments) and moments[watched] <= end:
            theta = min(max((moments[watched] - t) / h, 0.0), cut)
            _, once = basis(theta)
            seen[watched, 2] = x1 + h * (theta * v1 + h * total(times(A, 0, once) * acceleration)) - tip_rest
            watched += 1
        _, once = basis(cut)
        xw, vw = _wall_moved(wall, back, acceleration, cut, at, h)
        x1 += h * (cut * v1 + h * total(times(A, 0, once) * acceleration))
        v1 += h * total(once * acceleration)
        t = end
        level = _grown(level, error)


@compiled(inside=True)
def _scale(slow_ones, ends, usual):  # type: ignore[no-untyped-def]
    """Speed that errors are relative to behind some of the contact's ends, and whether it grows with the ball's."""
    reference, grows = usual, True
    for k in range(len(slow_ones)):
        if slow_ones[k, 0] > ends:
            reference, grows = min(reference, slow_ones[k, 1]), False
    return reference, grows


@compiled(borrows=True)
def _fly(rig, theta_at, rows, point, calls, cache, work, tolerance, how, usual, slow_ones, forced, trace):  # type: ignore[no-untyped-def]  # noqa: C901, PLR0915
    """Follow one trajectory to the launch, and beyond where a trace (moments, whether of the tip, what is seen) does.

    `slow_ones` are launches that runs before found too slow: which of the contact's ends each was, and the speed that
    errors until then are relative to. Returns (outcome, time, speed of the ball, its place, highest force until then,
    which of the contact's ends it was, steps taken); the place is the highest where it is not launched.
    """
    k_c, c_s, c_c, m, ball, k_s, q = rig.k_c, rig.c_s, rig.c_c, rig.m, rig.M, rig.k_s, rig.q
    length, g, phase, lag, inverse_slew = rig.l, rig.g, rig.phase, rig.lag, rig.inverse_slew
    gap, lean, bond, pull, cycles, hold = rig.gap, rig.lean, rig.bond, rig.pull, rig.cycles, rig.grip
    wall_mass, wall_k, wall_c = rig.wall_mass, rig.wall_stiffness, rig.wall_damping
    S, T1, T2, U1, U2, _, _, _, answers = cache
    piece, nodes, bern, stack, mem_z, mem_u = work
    law = (k_c, c_c, calls[0], calls[1], theta_at, nodes[0], nodes[0].ctypes.data)
    linear, split = len(calls[0]) == 0, len(calls[2]) > 0 or len(calls[4]) > 0
    if not _drive.first_piece(piece, rows, point, phase, lag, inverse_slew, split):
        return NO_SEPARATION, math.nan, 0.0, 0.0, math.nan, 0, 0
    f = point[FREQUENCY]
    settled = _settled(q, point[IDLE], theta_at, calls, mem_z, mem_u)
    press, grip, release = ball * g * lean / length, ball * hold, -bond / k_c
    # Friction holds the ball until a force exceeds its grip; then `opposed` opposes the motion, in its direction.
    stuck, way, opposed = grip > 0.0, 0.0, press
    gives = wall_k if wall_mass > 0.0 else 0.0
    xw, x1, x2, d, regime = _at_rest(lean, gap, press, k_s, gives, piece[_drive.AWAY], law)
    v1 = v2 = w = vw = lost_d = lost_v2 = 0.0  # the last two: what the sums lack of speed and indentation
    t = piece[_drive.BEGIN]
    rest, highest, peak, separated_once = x2, 0.0, 0.0, False
    tip_rest, watched, ends, launch = x1, 0, 0, (math.nan, 0.0, 0.0, 0.0, 0, 0.0)
    waiting = max(point[LENGTH] + HORIZON_PERIODS / f, _last_of(trace))
    horizon = max(waiting, min(4.0 * math.pi * math.sqrt(ball / k_c), HORIZON))
    window = cycles / f  # until when a launched ball may be struck again
    F = kept = splat(0.0)
    level = previous = first_level = _first_level(c_s, c_c, m, ball, k_s, k_c, f, how.first_step)
    reference, grows = _scale(slow_ones, 0, usual)
    still = how.rounding * q * point[REACH] * f  # a ball that is not faster is not launched
    rough = False  # whether the law has spoilt a step across the end of the contact
    carried = False  # whether `kept` holds the force of the step before, ready to be carried on
    new_piece = begun = True  # whether the next step is a piece's first; `first_level` suited the last such
    fresh, step = True, -1  # whether it is the first step after the regime changed
    while step + 1 < _allowed(how, piece):
        step += 1
        if new_piece:
            new_piece, carried, begun = False, False, True
            _remember(_drive.voltage(piece, t), q, theta_at, calls, mem_z, mem_u)
            level = min(level, first_level)
        room = piece[_drive.END] - t
        level = _level_for(level, room, rough, w, d, F, how.last_impulse * tolerance * ball * reference)
        _ready(level, rig, cache)
        h, at = _LENGTH[level], level * NODES * NODES

        # A ball that is held does not answer the force.
        V1, V2 = (T1, T2) if stuck else (U1, U2)
        stroke = _strokes(piece, load(C, 0) * h + t, q, settled, theta_at, calls, mem_z, mem_u, nodes[3])
        against, wall = 0.0 if stuck else opposed / ball, (wall_mass, wall_k, wall_c, xw, vw, answers)
        r, back, alpha, beta = _unforced(stroke, x1, v1, d, w, against, k_s, c_s, wall, T1, T2, at, h)
        kappa = 0.0 if regime == FREE else pull if regime == PULL else 1.0
        F, start, found = _pressed(
            alpha, beta, d, w, (regime, stuck, kappa), (V1, V2), (level, previous, carried), kept, cache, law, nodes,
            how.iterations, how.force_error * tolerance * ball * reference / h,
        )  # fmt: skip
        allowed = how.last_force * tolerance * ball * reference
        # Where a contact begins, a law may have no derivatives either.
        unlike = found and not linear and regime != FREE and abs(start - total(load(AT_BEGIN, 0) * F)) * h > allowed
        if fresh and unlike and level > 0:
            level = max(level - 2, 0)
            continue

        acceleration, w_node, push, reached, error = _judged(
            r, F, kappa, beta, V1, S, at, h, found, stuck, opposed, v2, ball, tolerance, reference, grows
        )
        swing = times(ONCE_TO_BERNSTEIN, 0, w_node) * h + d
        if error > 1.0 and level > 0:
            level, carried = _finer(level, error), False
            rough = rough or (not linear and regime != FREE and w < 0.0 and found and last(swing) < 0.0)
            continue

        slip, unsure = error * tolerance * reached * h, how.resolved * error * tolerance
        cut, event, way, shorter, disagreed = _first_event(
            (regime, stuck, way, fresh, level, h, room), d, v2, (F, kappa, push, w_node, swing),
            (slip, how.resolved * slip, unsure * reached * ball / h, unsure * reference * ball / h, allowed),
            (press, grip, pull, release, ball), law, bern, stack, nodes[3],
        )  # fmt: skip
        if shorter < level:
            level = shorter
            carried = carried and not disagreed
            continue

        # Advance to the end of the step or to the cut.
        whole, part, limit = cut > 1.0, min(cut, 1.0), waiting if regime == FREE else horizon
        if forced and regime != FREE:
            peak = _peak(F, kappa, part, peak, bern, stack)
        if not separated_once:
            highest = _top(x2 - rest, v2, push, h, min(part, (limit - t) / h), ball, highest, bern, stack)
        watched = _watched(
            trace, watched, t, t + part * h, (x1, v1, x2, v2), acceleration, push, h, ball, (tip_rest, rest)
        )
        x1, v1, x2, v2, lost_v2, d, lost_d = _moved(
            x1, v1, x2, v2, lost_v2, d, lost_d, acceleration, push, w_node, cut, h, ball
        )
        xw, vw = _wall_moved(wall, back, acceleration, cut, at, h)
        cut = part
        reference = max(reference, abs(v2)) if grows else reference
        w, t = v1 - v2, t + cut * h
        if t > limit:
            break  # what the step met was beyond
        if whole or event == _PIECE:
            previous, kept = level, F
            fresh, carried = False, whole and regime != FREE
            level = _grown(level, error)
            begun, first_level = False, level if begun else first_level
            if event == _PIECE:
                t, new_piece = _passed(rig, theta_at, rows, point, calls, work), True
        else:
            carried, fresh, lost_d = False, True, 0.0
            if event == _RESTS:
                if separated_once and regime == FREE:
                    break  # the hop is over
                v2, lost_v2, w = 0.0, 0.0, v1
                values, _ = basis(cut)
                stuck, way, opposed = _held(0.0 if regime == FREE else kappa * total(values * F), press, grip)
            elif event == _TEARS:
                stuck, opposed = False, press + way * grip
            else:
                if event == _ENDS and regime == FREE and separated_once and t > window:
                    break
                regime, d = _regime_after(event, regime, d, w, bond, pull, release, law)
                ends += regime == FREE
                if regime == FREE and v2 > still:
                    separated_once, launch = True, (t, v2, x2 - rest, peak, ends, reference)
                    if cycles == 0.0:
                        break
                    # Beyond the apex the hop is over: what strikes the ball then is another launch.
                    window = cycles / f if opposed <= 0.0 else min(cycles / f, t + v2 * ball / opposed)
                if regime == FREE and not grows:
                    # Resolved, a slow launch may be none, and a faster one may follow.
                    reference, grows = _scale(slow_ones, ends, usual)
        if (separated_once and regime == FREE and t > window) or t > (waiting if regime == FREE else horizon):
            break
    unspent = step + 1 < _allowed(how, piece)
    tip = (t, x1, v1, xw, vw, tip_rest, level, watched, new_piece)
    _tip_alone(rig, theta_at, rows, point, calls, cache, work, tolerance, how, reference, settled, trace, tip)
    if separated_once:
        # Of the launch that counts alone: the next impact makes up for one before it that was slow.
        when, speed, place, top, end, scale = launch
        slow = speed < how.slow * scale and tolerance * scale > still and unspent
        return _TOO_SLOW if slow else LAUNCHED, when, speed, place, top, end, step
    return NO_SEPARATION, math.nan, 0.0, highest, math.nan, 0, step


@compiled(borrows=True)
def _usual_speed(rig, theta_at, point, calls, out):  # type: ignore[no-untyped-def]
    """About the speed of the ball that one period of a simple contact, as stiff as the stroke makes it, launches."""
    k_c, c_c, ball, k_s, q = rig.k_c, rig.c_c, rig.M, rig.k_s, rig.q
    f, volt = point[FREQUENCY], point[REACH]
    force, _, _ = _force(q * volt, 0.0, (k_c, c_c, calls[0], calls[1], theta_at, out, out.ctypes.data))
    stiffness = max(force / (q * volt), 1e-12 * k_c)
    stiffness *= k_s / (stiffness + k_s)
    w = 2.0 * math.pi * f
    own = math.sqrt(stiffness / ball)
    own = math.sqrt(own * own + c_c / ball * max(w, own))
    return q * volt * (own / (1.0 + w / own) if point[JUMPS] != 0.0 else w / (1.0 + (w / own) ** 2))


@compiled
def _one_set(  # type: ignore[no-untyped-def]
    rig, theta_at, wanted, rows, points, calls, tolerance, how, forced, moments, tipped, when, speed, place, status,
    peak, steps, seen,
):  # fmt: skip
    n = NODES
    cache = (
        np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)),
        np.empty((_LEVELS, n, n)), np.empty((4, _LEVELS, n, n)), np.zeros(_LEVELS, np.bool_),
        np.zeros((4, _LEVELS), np.bool_), np.empty((3 if rig.wall_mass > 0.0 else 0, _LEVELS, n, n)),
    )  # fmt: skip
    nodes = (np.empty(6), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    work = (
        np.empty(_drive.PIECE), nodes, np.empty(n + 1), np.empty((50, n + 3)), np.empty(_MOST_BRANCHES),
        np.empty(_MOST_BRANCHES),
    )  # fmt: skip
    point = np.empty(COMMAND)
    slow_ones = np.empty((how.most_runs, 2))
    for j in range(len(points)):
        driven(points[j], rig.scale, rig.idle, point)
        if point[REACH] == 0.0 or not wanted[j]:
            when[j], speed[j], place[j], status[j], peak[j], steps[j] = 0.0, 0.0, 0.0, AT_REST, math.nan, 0
            seen[j] = 0.0
            continue
        seen[j] = math.nan
        usual = how.usual_part * _usual_speed(rig, theta_at, point, calls, nodes[0])
        total_steps = 0
        slow_ones[:] = 0.0
        for k in range(how.most_runs):
            outcome, t, v, x, top, end, count = _fly(
                rig, theta_at, rows, point, calls, cache, work, tolerance, how, usual, slow_ones, forced,
                (moments[j], tipped, seen[j]),
            )  # fmt: skip
            total_steps += count
            if outcome != _TOO_SLOW:
                break
            slow_ones[k, 0] = end
            slow_ones[k, 1] = max(v, how.rounding * rig.q * point[REACH] * point[FREQUENCY] / tolerance)
        when[j], speed[j], place[j], status[j], peak[j], steps[j] = t, v, x, outcome, top, total_steps


@compiled
def all_sets(  # type: ignore[no-untyped-def]
    begin, stop, rigs, theta, wanted, rows, points, calls, tolerance, how, forced, moments, tipped, when, speed, place,
    status, peak, steps, seen,
):  # fmt: skip
    """Follow the trajectories of some sets of a batch."""
    stride = 8 * theta.shape[1]
    first = theta.ctypes.data
    for i in range(begin, stop):
        _one_set(
            rigs[i], first + i * stride, wanted[i], rows, points, calls, tolerance, how, forced, moments, tipped,
            when[i], speed[i], place[i], status[i], peak[i], steps[i], seen[i],
        )  # fmt: skip


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
    settings: StepSettings | None = None,
    threads_from: int = 16,
    forced: bool = False,
    seen: FloatArray | None = None,
    tipped: bool = False,
) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int8], FloatArray, NDArray[np.int64]]:
    """Time (s), ball speed (m/s) and place (m) at the launch, what happened, highest force (N) until then, steps taken.

    Each is (n_sets, n_points).

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
    settings : StepSettings, optional
    threads_from : int
        Trajectories above which it is worth waking threads.
    forced : bool
        Whether the contact's highest force is needed; it is meaningless otherwise.
    seen : (n_sets, n_points, n_moments, 3) array, optional
        Is filled with the ball's place from rest (m), its speed (m/s) and the tip's place (m) at the design's moments;
        what the ball does after the launch that counts is meaningless, or NaN.
    tipped : bool
        Whether the tip is followed after that, too.
    """
    shape = (len(theta), design.n_points)
    found = tuple(np.empty(shape, kind) for kind in (float, float, float, np.int8, float, np.int64))
    if len(calls.branch) > _MOST_BRANCHES:
        raise ValueError(f"{len(calls.branch)} causes with a memory; at most {_MOST_BRANCHES}")
    moments = np.empty((design.n_points, 0)) if seen is None else design.moments
    watched = np.empty((*shape, 0, 3)) if seen is None else seen
    arguments = (
        rig.records(), np.ascontiguousarray(theta), np.ones(shape, bool) if wanted is None else wanted,
        *design.commands, calls.arrays(), tolerance, settings or StepSettings(), forced, moments,
        tipped, *found, watched,
    )  # fmt: skip
    share(all_sets, len(theta), arguments, threads=n_threads() if found[0].size > threads_from else 1)
    return found  # type: ignore[return-value]

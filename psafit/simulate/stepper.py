r"""The path for whatever has no closed form: nonlinear contact, drive and hysteresis.

Between two events the unknowns are the values of the contact force at the nodes of a collocation step
(`collocation`). The linear stack and the ball answer a force exactly as the method prescribes, by matrices that depend
on the step's length alone,

.. math::
    a = S\,(r - f), \quad S = (m I + h c_s A + h^2 k_s A^2)^{-1}, \qquad
    d = \alpha - h^2 A^2 (S + I/M) f, \quad \dot d = \beta - h A (S + I/M) f,

so that one scalar law :math:`f = F(d, \dot d)` remains at every node; Newton's method solves it. Steps are powers of
two, so their matrices are made once for all measurement points of a parameter set.

The drive is known in advance (`drive`). A step may look past the end of a piece, or past an event, with all
formulas carried on smoothly; it is then cut there. Events are the first zeros of the step's polynomials, searched in
Bernstein's form, which cannot overlook one. The error of a step is judged by the last Legendre coefficients of the
force and of the stack's acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psafit.physics.term import Setup
from psafit.simulate import drive as _drive
from psafit.simulate.callbacks import call_branch, call_law, call_stack_factor
from psafit.simulate.closed_form import AT_REST, HORIZON, HORIZON_PERIODS, LAUNCHED, NO_SEPARATION
from psafit.simulate.collocation import (
    A2,
    DEGREE,
    EXTRAPOLATE,
    NODES,
    ONCE_TO_BERNSTEIN,
    RATIOS,
    TO_LEGENDRE,
    VALUES_TO_BERNSTEIN,
    A,
    C,
)
from psafit.simulate.compiled import compiled, prange
from psafit.simulate.design import SQUARE, Design

FloatArray = NDArray[np.float64]

# Error admitted in one step, relative to the ball's speed: see docs/numerics.md for what it does to the launch range.
TOLERANCE = 1e-5

_MOST_BRANCHES = 8
_LEVELS = 96
_FINEST = -70  # 2^-70 s
_MAX_STEPS = 20_000
_NEWTON = 10
_WORTH_THREADS = 16
_FIRST_RATIO, _LAST_RATIO = RATIOS[0], RATIOS[-1]

FREE, PUSH, PULL, BOND = 0, 1, 2, 3
# Length of the first step in units of the fastest mode's time.
_FIRST_STEP = 6.0
# Levels by which a step may grow at once.
_GROW = 4
# Disagreement of law and polynomial where the contact ends, as an impulse, admitted in units of a step's error.
_LAST_FORCE = 0.02
# The same of the force over the time to the contact's end, below which a step may go across.
_LAST_IMPULSE = 10.0
# A swing about zero counts if it is this many times the step's error.
_RESOLVED = 10.0
# A ball slower than this, relative to the speed the error was scaled for, is followed again.
_SLOW = 0.1
# Launched, but found to be so much slower than the error was scaled for that the run must be repeated.
_TOO_SLOW = 9


@compiled
def _solve(matrix, b, n):  # type: ignore[no-untyped-def]
    """Gauss elimination with row exchanges, in place; the solution replaces `b`. False if singular."""
    for k in range(n):
        best, at = abs(matrix[k, k]), k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > best:
                best, at = abs(matrix[i, k]), i
        if not best > 0.0:
            return False
        if at != k:
            for j in range(k, n):
                matrix[k, j], matrix[at, j] = matrix[at, j], matrix[k, j]
            b[k], b[at] = b[at], b[k]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, n):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, n):
                    matrix[i, j] -= factor * matrix[k, j]
                b[i] -= factor * b[k]
    for k in range(n - 1, -1, -1):
        total = b[k]
        for j in range(k + 1, n):
            total -= matrix[k, j] * b[j]
        b[k] = total / matrix[k, k]
    return True


@compiled
def _make_level(level, m, ball, c_s, k_s, S, T1, T2, U1, U2):  # type: ignore[no-untyped-def]
    """Matrices of steps of length ``2^(level + finest)``."""
    h = 2.0 ** (level + _FINEST)
    # Scaled by the largest of its three parts, so that the inverse exists for every length.
    matrix = np.eye(NODES) * m + (h * c_s) * A + (h * h * k_s) * A2
    inverse = np.linalg.inv(matrix)
    S[level] = inverse
    T1[level] = h * (A @ inverse)
    T2[level] = h * (A @ T1[level])
    U1[level] = T1[level] + (h / ball) * A
    U2[level] = T2[level] + (h * h / ball) * A2


@compiled
def _split(coefficients, low, high, n):  # type: ignore[no-untyped-def]
    """Halve a polynomial in Bernstein's form (de Casteljau)."""
    for i in range(n + 1):
        high[i] = coefficients[i]
    low[0] = coefficients[0]
    for k in range(1, n + 1):
        for i in range(n + 1 - k):
            high[i] = 0.5 * (high[i] + high[i + 1])
        low[k] = high[0]


@compiled
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


@compiled
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


@compiled
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


@compiled
def _weights(theta, out):  # type: ignore[no-untyped-def]
    """Integrals from 0 to theta of the nodes' Lagrange polynomials."""
    x = 2.0 * theta - 1.0
    for j in range(NODES):
        out[j] = 0.0
    before, now = 1.0, x
    integral = theta
    for k in range(NODES):
        for j in range(NODES):
            out[j] += integral * TO_LEGENDRE[k, j]
        after = ((2.0 * k + 3.0) * x * now - (k + 1.0) * before) / (k + 2.0)
        integral = (after - before) / (2.0 * (2.0 * k + 3.0))
        before, now = now, after


@compiled
def _force(d, rate, k_c, c_c, law_at, law_p, theta_at, out, out_at):  # type: ignore[no-untyped-def]
    """Contact force and its two derivatives."""
    out[0], out[1], out[2] = k_c * d, k_c, 0.0
    out[3], out[4], out[5] = c_c * rate, 0.0, c_c
    for i in range(len(law_at)):
        call_law(law_at[i], d, rate, theta_at + law_p[i], out_at)
    return out[0] + out[3], out[1] + out[4], out[2] + out[5]


@compiled
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


@compiled
def _fly(rig, theta_at, square, f, volt, calls, cache, work, tolerance, reference):  # type: ignore[no-untyped-def]
    """Follow one trajectory to the launch.

    Returns (outcome, time, speed of the ball, its place, steps taken).
    """
    k_c, c_s, c_c, m, ball, k_s, q = rig[0], rig[1], rig[2], rig[3], rig[4], rig[5], rig[6]
    length, g, phase, lag, inverse_slew = rig[7], rig[8], rig[9], rig[10], rig[11]
    gap, lean, bond, pull, cycles = rig[12], rig[13], rig[14], rig[15], rig[16]
    law_at, law_p, factor_at, factor_p, branch_at, branch_p = calls
    S, T1, T2, U1, U2, G, made, made_linear = cache
    piece, law_out, r, alpha, beta, F, Fd, Fw, acc, d_node, w_node, jac, rhs, bern, stack, wa, mem_z, mem_u, vn = work
    out_at = law_out.ctypes.data
    n_branch, n_factor, n_law = len(branch_at), len(factor_at), len(law_at)

    split = n_branch > 0 or n_factor > 0
    _drive.first_piece(piece, square, volt, f, phase, lag, inverse_slew, split)
    for k in range(n_branch):
        mem_z[k], mem_u[k] = 0.0, 0.0

    press = ball * g * lean / length
    x1 = v1 = x2 = v2 = w = 0.0
    d = -gap
    t = 0.0
    if lean > 0.0:
        d = _seat(press, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
        x1 = -press / k_s
        x2 = x1 - d - gap
        regime = PUSH
    elif gap > 0.0 or piece[_drive.SIGN] <= 0.0:
        regime = FREE
    else:
        regime = PUSH
    release = -bond / k_c
    separated_once = False
    last_time, last_speed, last_place = math.nan, 0.0, 0.0
    newton = 0.1 * math.sqrt(tolerance)
    waiting = HORIZON_PERIODS / f
    horizon = max(waiting, min(4.0 * math.pi * math.sqrt(ball / k_c), HORIZON))
    window = cycles / f
    u = 0.0

    # The first step resolves the fastest mode; where that does not matter the steps grow at once.
    rate = c_s / m + c_c * (1.0 / m + 1.0 / ball) + math.sqrt((k_s + k_c) / m + k_c / ball)
    level = math.floor(math.log2(min(0.1 / f, _FIRST_STEP / rate))) - _FINEST
    level = min(max(level, 0), _LEVELS - 1)
    rough = False  # whether the law has spoilt a step across the end of the contact
    carried = False  # whether F holds the force of the step before, ready to be carried on
    previous = level
    new_piece = True
    fresh = True  # first step after the regime changed

    for step in range(_MAX_STEPS):
        if new_piece:
            new_piece = False
            now = _drive.voltage(piece, t)
            for k in range(n_branch):
                mem_z[k] = call_branch(branch_at[k], mem_z[k], mem_u[k], now, q, theta_at + branch_p[k])
                mem_u[k] = now
            carried = False
        room = piece[_drive.END] - t
        if room < math.inf:
            top = math.ceil(math.log2(room)) - _FINEST
            level = max(min(level, top), 0)
        if rough and w < 0.0 and d > 0.0 and abs(F[NODES - 1] * d) > _LAST_IMPULSE * tolerance * ball * reference * -w:
            # Not across the contact's end before what is left of the force no longer matters.
            level = max(min(level, math.floor(math.log2(-d / w)) - _FINEST), 0)
        if not made[level]:
            _make_level(level, m, ball, c_s, k_s, S, T1, T2, U1, U2)
            made[level] = True
        h = 2.0 ** (level + _FINEST)

        # The drive's force at the nodes, and what is known of the motion without the contact force.
        sign = piece[_drive.SIGN]
        for i in range(NODES):
            at = C[i] * h
            u = _drive.voltage(piece, t + at)
            stroke = q * u
            for k in range(n_factor):
                stroke *= call_stack_factor(factor_at[k], sign * u if sign != 0.0 else abs(u), theta_at + factor_p[k])
            for k in range(n_branch):
                stroke -= call_branch(branch_at[k], mem_z[k], mem_u[k], u, q, theta_at + branch_p[k])
            r[i] = k_s * (stroke - x1 - at * v1) - c_s * v1
        t1, t2, u1, u2, s_ = T1[level], T2[level], U1[level], U2[level], S[level]
        for i in range(NODES):
            one = two = 0.0
            for j in range(NODES):
                one += t1[i, j] * r[j]
                two += t2[i, j] * r[j]
            at = C[i] * h
            beta[i] = w + one + press / ball * at
            alpha[i] = d + at * w + two + press / ball * 0.5 * at * at

        failed = False
        if regime == FREE:
            for i in range(NODES):
                F[i] = 0.0
                d_node[i], w_node[i] = alpha[i], beta[i]
            kappa = 0.0
        elif n_law == 0:
            # A linear law needs no iteration: f = G (k_c alpha + c_c beta).
            kappa = pull if regime == PULL else 1.0
            which = 1 if regime == PULL else 0
            if not made_linear[which, level]:
                G[which, level] = np.linalg.inv(np.eye(NODES) + kappa * (k_c * u2 + c_c * u1))
                made_linear[which, level] = True
            g_ = G[which, level]
            for i in range(NODES):
                rhs[i] = k_c * alpha[i] + c_c * beta[i]
            for i in range(NODES):
                total = 0.0
                for j in range(NODES):
                    total += g_[i, j] * rhs[j]
                F[i] = total
        else:
            kappa = pull if regime == PULL else 1.0
            if carried:
                ratio = level - previous
                if ratio < _FIRST_RATIO or ratio > _LAST_RATIO:
                    carried = False
                else:
                    table = EXTRAPOLATE[ratio - _FIRST_RATIO]
                    for i in range(NODES):
                        total = 0.0
                        for j in range(NODES):
                            total += table[i, j] * acc[j]
                        F[i] = total
            if not carried:
                start, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                for i in range(NODES):
                    F[i] = start
            failed = True
            for _ in range(_NEWTON):
                for i in range(NODES):
                    dd, ww = alpha[i], beta[i]
                    for j in range(NODES):
                        dd -= kappa * u2[i, j] * F[j]
                        ww -= kappa * u1[i, j] * F[j]
                    d_node[i], w_node[i] = dd, ww
                    force, fd, fw = _force(dd, ww, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                    rhs[i] = force - F[i]
                    Fd[i], Fw[i] = kappa * fd, kappa * fw
                for i in range(NODES):
                    for j in range(NODES):
                        jac[i, j] = Fd[i] * u2[i, j] + Fw[i] * u1[i, j]
                    jac[i, i] += 1.0
                if not _solve(jac, rhs, NODES):
                    break
                change = size = 0.0
                for i in range(NODES):
                    F[i] += rhs[i]
                    change = max(change, abs(rhs[i]))
                    size = max(size, abs(F[i]))
                if not math.isfinite(change):
                    break
                # Newton squares the error: what is left after a change this small is a hundredth of the tolerance.
                if change <= newton * size or change * h < 0.01 * tolerance * ball * reference:
                    failed = False
                    break
        if fresh and n_law > 0 and regime != FREE and not failed and level > 0:
            # The same at the beginning of a contact, where a law may have no derivatives either.
            at_begin = 0.0
            for j in range(NODES):
                at_begin += VALUES_TO_BERNSTEIN[0, j] * F[j]
            law, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
            if abs(law - at_begin) * h > _LAST_FORCE * tolerance * ball * reference:
                level = max(level - 2, 0)
                continue
        if regime != FREE and not failed:
            for i in range(NODES):
                dd, ww = alpha[i], beta[i]
                for j in range(NODES):
                    dd -= kappa * u2[i, j] * F[j]
                    ww -= kappa * u1[i, j] * F[j]
                d_node[i], w_node[i] = dd, ww

        # Error: the geometric series that the last two coefficients of ball's and stack's acceleration begin.
        if not failed:
            tail = 0.0
            b1 = b2 = a1 = a2 = 0.0
            for i in range(NODES):
                total = 0.0
                for j in range(NODES):
                    total += s_[i, j] * (r[j] - kappa * F[j])
                vn[i] = total
                b1 += TO_LEGENDRE[NODES - 1, i] * F[i]
                b2 += TO_LEGENDRE[NODES - 2, i] * F[i]
            for i in range(NODES):
                a1 += TO_LEGENDRE[NODES - 1, i] * vn[i]
                a2 += TO_LEGENDRE[NODES - 2, i] * vn[i]
            b1, b2 = abs(b1) * kappa / ball, abs(b2) * kappa / ball
            a1, a2 = abs(a1), abs(a2)
            tail = 0.0
            if b1 > 0.0:
                tail += b1 * b1 / max(b2 - b1, 0.1 * b1)
            if a1 > 0.0:
                tail += a1 * a1 / max(a2 - a1, 0.1 * a1)
            error = h * tail / (tolerance * reference)
        else:
            error = 1e6
        if error > 1.0 and level > 0:
            down = math.ceil(math.log2(error) / (NODES + 1.0) + 0.1)
            level = max(level - min(max(down, 1), 8), 0)
            carried = False
            rough = rough or (n_law > 0 and w < 0.0 and not failed and d_node[NODES - 1] < 0.0)
            continue

        # Events: the first of them cuts the step.
        cut = 2.0
        event = -1
        if room <= h:
            cut = room / h
            event = 9
        side = -1.0 if regime == FREE else 1.0
        for i in range(DEGREE + 1):
            total = 0.0
            for j in range(NODES):
                total += ONCE_TO_BERNSTEIN[i, j] * w_node[j]
            bern[i] = d + h * total
        if regime == FREE:
            threshold = 0.0
        elif regime == BOND:
            threshold = release
        else:
            threshold = 0.0
        scale = 0.0
        for i in range(DEGREE + 1):
            bern[i] = side * (bern[i] - threshold)
            scale = max(scale, abs(bern[i]))
        floor = 4e-16 * (scale + abs(d))
        if fresh:
            # The step begins on the zero that ended the one before.
            floor = max(floor, 1e-13 * scale, error * tolerance * reference * h)
            if abs(bern[0]) < 1e-9 * scale:
                bern[0] = 0.0
        theta = _first_root(bern, DEGREE, floor, stack)
        if theta < cut:
            if fresh and level > 0:
                # Begun on a zero: a return to it that does not rise above the step's error is none.
                middle, _ = _bernstein(bern, DEGREE, 0.5 * theta)
                if middle < _RESOLVED * error * tolerance * reference * h + floor:
                    level = max(level - 3, 0)
                    continue
            if regime != FREE and n_law > 0:
                # A law may have no derivatives where the contact ends: the polynomial, carried on past that place, must
                # still agree with the law there. If not, the place is approached in shorter steps.
                at_end = w_end = 0.0
                for j in range(NODES):
                    basis = 1.0
                    for k in range(NODES):
                        if k != j:
                            basis *= (theta - C[k]) / (C[j] - C[k])
                    at_end += basis * F[j]
                    w_end += basis * w_node[j]
                law, _, _ = _force(threshold, w_end, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                if abs(law - at_end) * theta * h > _LAST_FORCE * tolerance * ball * reference and level > 0:
                    level = max(min(level - 1, math.floor(math.log2(max(theta, 1e-3) * h)) - _FINEST), 0)
                    carried = False
                    continue
            cut, event = theta, 0
        if pull != 1.0 and regime in (PUSH, PULL):
            side = 1.0 if regime == PUSH else -1.0
            scale = 0.0
            for i in range(NODES):
                total = 0.0
                for j in range(NODES):
                    total += VALUES_TO_BERNSTEIN[i, j] * F[j]
                bern[i] = side * total
                scale = max(scale, abs(bern[i]))
            floor = 1e-11 * scale
            if fresh and abs(bern[0]) < 1e-5 * scale:
                bern[0] = 0.0
            theta = _first_root(bern, NODES - 1, floor, stack)
            if theta < cut:
                if fresh and level > 0:
                    middle, _ = _bernstein(bern, NODES - 1, 0.5 * theta)
                    if middle < _RESOLVED * error * tolerance * reference * ball / h + floor:
                        level = max(level - 3, 0)
                        continue
                cut, event = theta, 1
        if regime == BOND and pull != 1.0 and d_node[NODES - 1] > 0.0 and not fresh and cut > 1.0:
            # Back to contact proper: only the law's exception for d >= 0 changes there.
            for i in range(DEGREE + 1):
                total = 0.0
                for j in range(NODES):
                    total += ONCE_TO_BERNSTEIN[i, j] * w_node[j]
                bern[i] = -(d + h * total)
            theta = _first_root(bern, DEGREE, floor, stack)
            if theta < cut:
                cut, event = theta, 2

        # Advance to the end of the step or to the cut.
        whole = cut > 1.0
        if whole:
            cut = 1.0
            for j in range(NODES):
                wa[j] = A[NODES - 1, j]
        else:
            _weights(cut, wa)
        dx1 = dv1 = dx2 = dv2 = dd = 0.0
        for i in range(NODES):
            vb = va = 0.0
            for j in range(NODES):
                va += A[i, j] * vn[j]
                vb += A[i, j] * (kappa * F[j] - press)
            dx1 += wa[i] * (v1 + h * va)
            dx2 += wa[i] * (v2 + h * vb / ball)
            dv1 += wa[i] * vn[i]
            dv2 += wa[i] * (kappa * F[i] - press)
            dd += wa[i] * w_node[i]
        x1 += h * dx1
        v1 += h * dv1
        x2 += h * dx2
        v2 += h * dv2 / ball
        d += h * dd
        w = v1 - v2
        t = t + cut * h
        fresh = False
        if whole or event == 9:
            previous = level
            for i in range(NODES):
                acc[i] = F[i]
            carried = whole and regime != FREE
            if error < 1.0:
                up = math.floor(-math.log2(max(error, 1e-30)) / (NODES + 1.0) - 0.1)
                level = min(level + min(max(up, 0), _GROW), _LEVELS - 1)
            if event == 9:
                now = _drive.voltage(piece, piece[_drive.END])
                for k in range(n_branch):
                    mem_z[k] = call_branch(branch_at[k], mem_z[k], mem_u[k], now, q, theta_at + branch_p[k])
                    mem_u[k] = now
                t = piece[_drive.END]
                _drive.next_piece(piece, now, square, volt, f, phase, lag, inverse_slew, split)
                new_piece = True
        else:
            carried = False
            fresh = True
            if event == 0 and regime == FREE:
                if separated_once and t > window:
                    return LAUNCHED, last_time, last_speed, last_place, step
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
                    if abs(v2) < _SLOW * reference and tolerance * reference > 1e-16 * q * volt * f:
                        return _TOO_SLOW, t, v2, x2, step
                    separated_once = True
                    last_time, last_speed, last_place = t, v2, x2
                    if cycles == 0.0:
                        return LAUNCHED, t, v2, x2, step
            elif event == 1:
                regime = PULL if regime == PUSH else PUSH
            else:
                d = 0.0
                start, _, _ = _force(d, w, k_c, c_c, law_at, law_p, theta_at, law_out, out_at)
                regime = PULL if start < 0.0 else PUSH
        if separated_once and regime == FREE and t > window:
            return LAUNCHED, last_time, last_speed, last_place, step
        if t > (waiting if regime == FREE else horizon):
            if separated_once:
                return LAUNCHED, last_time, last_speed, last_place, step
            return NO_SEPARATION, math.nan, 0.0, x2, step
    return NO_SEPARATION, math.nan, 0.0, x2, _MAX_STEPS


@compiled
def _one_set(rig, theta_at, wanted, square, frequency, voltage, calls, tolerance, when, speed, place, status, steps):  # type: ignore[no-untyped-def]
    n = NODES
    cache = (
        np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)), np.empty((_LEVELS, n, n)),
        np.empty((_LEVELS, n, n)), np.empty((2, _LEVELS, n, n)), np.zeros(_LEVELS, np.bool_),
        np.zeros((2, _LEVELS), np.bool_),
    )  # fmt: skip
    work = (
        np.empty(_drive.PIECE), np.empty(6), np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n),
        np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty((n, n)), np.empty(n), np.empty(n + 2),
        np.empty((50, n + 3)), np.empty(n), np.empty(_MOST_BRANCHES), np.empty(_MOST_BRANCHES), np.empty(n),
    )  # fmt: skip
    for j in range(len(frequency)):
        if voltage[j] == 0.0 or not wanted[j]:
            when[j], speed[j], place[j], status[j], steps[j] = 0.0, 0.0, 0.0, AT_REST, 0
            continue
        # The stack's own fastest speed is the scale, until the ball is found to be much slower.
        reference = 0.3 * rig[6] * voltage[j] * frequency[j]
        total = 0
        for _ in range(12):
            outcome, t, v, x, count = _fly(
                rig, theta_at, square[j], frequency[j], voltage[j], calls, cache, work, tolerance, reference
            )
            total += count
            if outcome != _TOO_SLOW:
                break
            reference = v
        when[j], speed[j], place[j], status[j], steps[j] = t, v, x, outcome, total


def _all_sets(rigs, theta, wanted, square, frequency, voltage, calls, tolerance, when, speed, place, status, steps):  # type: ignore[no-untyped-def]
    stride = 8 * theta.shape[1]
    first = theta.ctypes.data
    for i in prange(len(theta)):
        _one_set(
            rigs[i], first + i * stride, wanted[i], square, frequency, voltage, calls, tolerance,
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
        design.waveform == SQUARE, design.frequency, design.amplitude,
        calls.arrays(), tolerance, *found,
    )  # fmt: skip
    return found  # type: ignore[return-value]

r"""Radau IIA collocation with nine stages and events: what the literal reference integrates its pieces with.

Order 17, stiffly accurate; one scheme for stiff and for oscillating motion. A step is accepted once the Legendre series
of its polynomial has converged to the tolerance, which holds inside the step as well as at its end. The last step of a
piece is solved anew until it ends at the event itself, with no stage beyond it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg.lapack import dgetrf, dgetrs
from scipy.optimize import brentq, minimize_scalar
from scipy.special import roots_jacobi

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError

EPS = float(np.finfo(float).eps)
TINY = 1e-290

_STAGES = 9


def _collocation(stages: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Nodes in (0, 1], matrix of Radau IIA, and the map from values at 0 and the nodes to Legendre coefficients."""
    x = np.append(roots_jacobi(stages - 1, 1.0, 0.0)[0], 1.0)
    p = legendre.legvander(x, stages)
    integrals = np.empty((stages, stages))
    integrals[:, 0] = x + 1.0
    for k in range(1, stages):
        integrals[:, k] = (p[:, k + 1] - p[:, k - 1]) / (2 * k + 1)
    matrix = np.asarray(0.5 * np.linalg.solve(p[:, :stages].T, integrals.T).T, dtype=np.float64)
    series = np.asarray(np.linalg.inv(legendre.legvander(np.append(-1.0, x), stages)), dtype=np.float64)
    return (x + 1.0) / 2.0, matrix, series


_NODES, _MATRIX, _SERIES = _collocation(_STAGES)
PLACES = np.append(0.0, _NODES)
"""Fractions of a step at which its values are solved for."""
GRID = np.linspace(0.0, 1.0, 25)
"""Fractions of a step at which it is looked at first."""
_ON_GRID = legendre.legvander(2.0 * GRID - 1.0, _STAGES) @ _SERIES


class System(Protocol):
    """First-order equations, smooth within a piece; times count from the start of the piece."""

    active: list[int]  # the components that move; the others are handed on unchanged

    def field(self, tau: float, y: list[float]) -> list[float]:
        """Rates."""
        ...

    def jacobian(self, tau: float, y: list[float]) -> list[list[float]]:
        """Derivatives of the rates, row by row."""
        ...

    def noise(self, size: FloatArray, h: float) -> FloatArray:
        """Rounding errors of the components within a step: no tolerance below these can be met."""
        ...


@dataclass
class Monitor:
    """A function of the state that keeps its sign within a piece.

    Parameters
    ----------
    name : str
    value : callable
        ``value(tau, row)``.
    sign : {-1, 0, 1}
        What it keeps; 0: what it shows once it leaves its noise.
    noise : float
        Values this small have no sign.
    clean : bool
        The function's own equation has no kink at its zero, so that a step too long still shows where it is.
    """

    name: str
    value: Callable[[float, list[float]], float]
    sign: int = 0
    noise: float = 0.0
    clean: bool = False


class Step:
    """One solved step: values at its start and at the nodes, and the Legendre series of the polynomial."""

    def __init__(self, tau: float, h: float, values: FloatArray) -> None:
        self.tau, self.h, self.values = tau, h, values
        self.series = _SERIES @ values

    def at(self, theta: float) -> list[float]:
        """State at a fraction of the step."""
        return np.asarray(legendre.legval(2.0 * theta - 1.0, self.series)).tolist()

    def watch(self, monitor: Monitor, theta: float) -> float:
        """A monitor at a fraction of the step."""
        return monitor.value(self.tau + theta * self.h, self.at(theta))


def _solve(system: System, tau: float, y: FloatArray, h: float, size: FloatArray) -> Step | None:
    """Solve the stages by Newton's method, with the Jacobian of each; None if it does not converge."""
    active = system.active
    n = len(active)
    times = (tau + h * _NODES).tolist()
    stages = np.tile(y, (_STAGES, 1))
    move = np.zeros((_STAGES, n))
    start = y[active]
    floor = system.noise(size, h)[active]
    factors = None
    unit = np.ones(n)
    previous = math.inf
    for iteration in range(25):
        rows = stages.tolist()
        slopes = np.array([system.field(t, row) for t, row in zip(times, rows, strict=True)])[:, active]
        if not np.all(np.isfinite(slopes)):
            return None
        if factors is None:
            jacobian = np.array([system.jacobian(t, row) for t, row in zip(times, rows, strict=True)])
            jacobian = jacobian[:, active][:, :, active]
            # Every component in a unit of its own: the solution's rounding errors are then relative to each.
            unit = np.maximum(
                np.maximum(size[active], np.abs(stages[:, active]).max(axis=0)), h * np.abs(slopes).max(axis=0)
            )
            unit = np.where(unit > 0.0, unit, h * np.abs(jacobian).max(axis=0) @ unit)
            unit = np.where(unit > TINY, unit, 1.0)
            blocks = -h * _MATRIX[:, None, :, None] * (jacobian * unit / unit[:, None]).transpose(1, 0, 2)[None]
            matrix = blocks.reshape(_STAGES * n, _STAGES * n)
            matrix.flat[:: _STAGES * n + 1] += 1.0
            if not np.all(np.isfinite(matrix)):
                return None
            lu, pivots, info = dgetrf(matrix, overwrite_a=True)
            if info != 0:
                return None
            factors = lu, pivots
        residual = (h * (_MATRIX @ slopes) - move) / unit
        change = unit * dgetrs(*factors, residual.ravel())[0].reshape(_STAGES, n)
        move += change
        stages[:, active] = start + move
        scale = np.maximum(np.maximum(size[active], np.abs(stages[:, active]).max(axis=0)), TINY)
        norm = float((np.abs(change) / scale).max())
        if not math.isfinite(norm):
            return None
        ratio = norm / previous if previous > 0.0 else 0.0
        if norm <= 1e-15:
            break
        if ratio > 0.3 and np.all(np.abs(change) <= 1e-13 * scale + floor):
            break  # rounding errors: it will not become better
        if iteration > 3 and ratio > 2.0:
            return None
        if ratio > 1e-3:
            factors = None
        previous = norm
    else:
        return None
    return Step(tau, h, np.vstack([y, stages]))


def _badness(system: System, step: Step, size: FloatArray, rtol: float) -> float:
    """Last coefficients of the series over what is allowed: acceptable up to 1."""
    scale = np.maximum(size, np.abs(step.values).max(axis=0))
    allowed = rtol * scale + system.noise(scale, step.h) + TINY
    tail = np.maximum(np.abs(step.series[-1]), 0.03 * np.abs(step.series[-2]))
    return float((tail / allowed)[system.active].max())


def _first_crossing(step: Step, monitors: list[Monitor], fresh: bool) -> tuple[float, Monitor] | None:
    """Fraction of the step at which the first monitor changes its sign; 0: it starts with the wrong one, or none."""
    if not monitors:
        return None
    rows = (_ON_GRID @ step.values).tolist()
    times = (step.tau + step.h * GRID).tolist()
    best: tuple[float, Monitor] | None = None
    for monitor in monitors:
        g = [monitor.value(t, row) for t, row in zip(times, rows, strict=True)]
        first = 1 if fresh else 0  # a piece often begins where a monitor is zero
        sign = monitor.sign
        if sign == 0:
            clear = [i for i in range(first, len(g)) if abs(g[i]) > monitor.noise]
            if not clear:
                continue
            first = clear[0]
            sign = 1 if g[first] > 0.0 else -1
        theta = _fall(step, monitor, [sign * value for value in g], sign, first)
        if theta is not None and (best is None or theta < best[0]):
            best = theta, monitor
    return best


def _fall(step: Step, monitor: Monitor, g: list[float], sign: int, first: int) -> float | None:
    """First fraction of the step, from grid point `first` on, at which `g`, the monitor with its sign, falls to 0.

    Where it first lies below its noise, it fell after the last grid point above zero. 0 if there is none: the caller
    looks closer, or ends the piece here.
    """

    def at(theta: float) -> float:
        return sign * step.watch(monitor, theta)

    def zero(high: float) -> float:
        if above is None:
            return 0.0
        low = float(GRID[above])
        if at(low) <= 0.0:
            return low
        return float(brentq(at, low, high, xtol=1e-16, rtol=4 * EPS)) if at(high) < 0.0 else high

    noise, above = monitor.noise, None
    for i in range(first, len(g)):
        if g[i] < -noise:
            return zero(float(GRID[i]))
        # A dip between grid points: where the parabola through three of them falls below zero, look closely.
        if first < i < len(g) - 1 and g[i] <= g[i - 1] and g[i] <= g[i + 1]:
            bend = g[i - 1] - 2.0 * g[i] + g[i + 1]
            lean = 0.5 * (g[i + 1] - g[i - 1])
            if bend > 0.0 and g[i] - 0.6 * lean * lean / bend < -noise:
                low, high = float(GRID[i - 1]), float(GRID[i + 1])
                found = minimize_scalar(at, bounds=(low, high), method="bounded", options={"xatol": 1e-10})
                if found.fun < -noise:
                    return zero(float(found.x))
        if g[i] > 0.0:
            above = i
    return None


def _land(system: System, step: Step, theta: float, monitor: Monitor, size: FloatArray) -> Step | None:
    """Solve the step anew so that it ends where the monitor is zero; None if that does not converge."""
    tau, y = step.tau, step.values[0]
    nudge = 1e-5
    previous = math.inf
    h = step.h * theta
    for _ in range(12):
        landed = _solve(system, tau, y, h, size)
        if landed is None:
            return None
        g, before = landed.watch(monitor, 1.0), landed.watch(monitor, 1.0 - nudge)
        if g == 0.0 or g == before:
            return landed
        off = -g * nudge / (g - before)
        if abs(off) <= 4 * EPS or (abs(off) < 1e-7 and abs(off) >= 0.5 * previous):
            return landed
        if abs(off) > 0.5:
            return None
        previous = abs(off)
        h *= 1.0 + off
    return landed if previous < 1e-7 else None


@dataclass
class Clock:
    """What lives on from piece to piece: the step to try, the largest values so far, the steps taken and allowed.

    `watch`, where there is one, is called with every step that is taken.
    """

    step: float
    size: FloatArray
    rtol: float
    taken: int = 0
    most_steps: int = 400_000
    watch: Callable[[Step], None] | None = None


def advance(
    system: System, y: FloatArray, end: float, clock: Clock, monitors: list[Monitor]
) -> tuple[float, FloatArray, str]:
    """Integrate one piece up to `end` or to the first monitor's zero, whose name comes back (or "")."""
    tau, fresh, earliest = 0.0, True, 1e-7
    opening = 0.0
    while tau < end:
        h = end - tau if tau + 1.01 * clock.step >= end else clock.step
        clock.taken += 1
        if clock.taken > clock.most_steps or (tau + h == tau and h < end - tau):
            raise ConvergenceError("time within a piece of the literal reference", reached=tau, required=end)
        step = _solve(system, tau, y, h, clock.size)
        if step is None:
            clock.step = 0.2 * h
            continue
        badness = _badness(system, step, clock.size, clock.rtol)
        found = _first_crossing(step, monitors, fresh)
        if found is not None and (badness <= 1.0 or (found[1].clean and found[0] > 0.0)):
            theta, monitor = found
            if theta == 0.0:
                if not fresh:
                    return tau, y, monitor.name  # it passed zero within its noise, or by rounding
                # Wrong from the first glance on: a piece of no length, unless a closer look shows otherwise.
                opening = opening or h
                if h < earliest * opening:
                    return tau, y, monitor.name
                clock.step = h / 30.0
                continue
            landed = _land(system, step, theta, monitor, clock.size)
            if landed is None:
                clock.step = 0.5 * h * theta
                continue
            badness = _badness(system, landed, clock.size, clock.rtol)
            if badness <= 1.0:
                clock.size = np.maximum(clock.size, np.abs(landed.values).max(axis=0))
                if clock.watch:
                    clock.watch(landed)
                return tau + landed.h, landed.values[-1].copy(), monitor.name
            h = landed.h
        if badness > 1.0:
            clock.step = h * max(0.1, 0.85 * badness ** (-1.0 / _STAGES))
            continue
        clock.size = np.maximum(clock.size, np.abs(step.values).max(axis=0))
        if clock.watch:
            clock.watch(step)
        tau, y, fresh = tau + h, step.values[-1].copy(), False
        grown = h * min(5.0, 0.85 * max(badness, 1e-12) ** (-1.0 / _STAGES))
        clock.step = max(grown, clock.step) if h < clock.step else grown  # a piece's last step was cut short
    return end, y, ""

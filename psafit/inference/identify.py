"""What the data determine, and what they do not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from psafit.inference.optimise import gradient
from psafit.inference.problem import Problem
from psafit.records import ProfilePoint

FloatArray = NDArray[np.float64]

# Half the 90 % point of chi-square with one degree of freedom (Wilks): the drop of log likelihood at either end of a
# 90 % interval, hence at a single limit that holds with 95 %.
DROP_90 = 1.353
# Beyond this drop a side is closed; a little above DROP_90, so that the limit can be interpolated.
_CLOSED = 3.0
# Neighbouring points of a profile differ by no more than this in height, unless it jumps between coordinates this
# close; and there are at least so many across it.
_SMOOTH, _JUMP, _ACROSS = 0.35, 5e-3, 12
# Below this contraction of the variance the posterior is the prior with another name.
_INFORMED = 0.5


def _maximise(problem: Problem, start: FloatArray, fixed: int) -> tuple[FloatArray, float]:
    """Highest log likelihood with one coordinate held; from `start`."""
    free = np.arange(problem.n_dim) != fixed
    low, high = problem.bounds[free].T
    margin = 2e-4

    def place(rows: FloatArray) -> FloatArray:
        full = np.empty((len(rows), problem.n_dim))
        full[:, free] = rows
        full[:, fixed] = start[fixed]
        return full

    def value(rows: FloatArray) -> FloatArray:
        return -problem.log_likelihood(place(rows))

    result = minimize(
        lambda v: float(value(v[None, :])[0]),
        np.clip(start[free], low + margin, high - margin),
        jac=lambda v: gradient(value, v, problem.bounds[free]),
        method="L-BFGS-B",
        bounds=np.column_stack([low + margin, high - margin]),
        options={"maxiter": 60, "ftol": 1e-8},
    )
    return place(result.x[None, :])[0], -float(result.fun)


def profile(problem: Problem, top: FloatArray, index: int) -> list[ProfilePoint]:
    """Profile likelihood of one parameter, walked outwards from the top until both sides close or a bound is met.

    Parameters
    ----------
    problem : Problem
    top : (n_dim,) array
        Sampling coordinates near the highest likelihood.
    index : int
        Column of the parameter.

    Returns
    -------
    list of ProfilePoint
        Ascending in the value; `drop` is zero at the highest point of all.
    """
    parameter = problem.parameters[index]
    low, high = problem.bounds[index]
    centre, _ = _maximise(problem, top, index)
    points: list[tuple[FloatArray, float]] = []
    highest = -math.inf
    for side in (-1.0, 1.0):
        here = centre.copy()
        step, drop = 0.05 * side, 0.0
        while True:
            moved, height = _maximise(problem, here, index)
            highest = max(highest, height)
            points.append((moved, height))
            drop, previous = highest - height, drop
            if drop > _CLOSED or here[index] in (low, high):
                break
            # Steps that change the drop by a fifth of what closes a side, or less.
            step *= 2.0 if abs(drop - previous) < 0.1 else 1.0 if abs(drop - previous) < 0.6 else 0.5
            here = moved.copy()
            here[index] = np.clip(here[index] + step, low, high)
    while True:
        points.sort(key=lambda point: (float(point[0][index]), point[1]))
        inside = [float(u[index]) for u, height in points if height > highest - _CLOSED]
        widest = max((max(inside) - min(inside)) / _ACROSS, _JUMP)
        coarse = [
            0.5 * (a + b)
            for (a, height), (b, other) in itertools.pairwise(points)
            if max(height, other) > highest - _CLOSED
            and (b[index] - a[index] > widest or (abs(height - other) > _SMOOTH and b[index] - a[index] > _JUMP))
        ]
        if not coarse:
            break
        points += [_maximise(problem, u, index) for u in coarse]
        highest = max(height for _, height in points)
    profiled = dict.fromkeys((float(parameter.to_physical(u[index])), highest - h) for u, h in points)
    return [ProfilePoint(*pair) for pair in profiled]


def limits(points: list[ProfilePoint]) -> tuple[float | None, float | None]:
    """Values where the profile has dropped by `DROP_90`; None where a side stays open."""
    value = np.array([p.value for p in points])
    drop = np.array([p.drop for p in points])
    top = int(np.argmin(drop))

    def crossing(order: NDArray[np.intp]) -> float | None:
        for inner, outer in itertools.pairwise(order):
            if drop[outer] >= DROP_90 > drop[inner]:
                share = (DROP_90 - drop[inner]) / (drop[outer] - drop[inner])
                return float(value[inner] + share * (value[outer] - value[inner]))
        return None

    return crossing(np.arange(top, -1, -1)), crossing(np.arange(top, len(points)))


def verdict(points: list[ProfilePoint], contraction: float) -> str:
    """One of "determined", "bounded above", "bounded below", "not determined"."""
    if not points:
        return "determined" if contraction >= _INFORMED else "not determined"
    lower, upper = limits(points)
    if lower is not None and upper is not None:
        return "determined"
    if upper is not None:
        return "bounded above"
    return "bounded below" if lower is not None else "not determined"


def significant(value: float, spread: float) -> str:
    """A number with as many digits as its spread supports (two of the spread).

    >>> significant(142537.0, 812.0)
    '1.4254e5'
    """
    if not (math.isfinite(value) and math.isfinite(spread)) or value == 0:
        return f"{value:g}"
    digits = 4
    if spread > 0:
        digits = min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2, 1), 8)
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    tens = int(exponent)
    return f"{float(f'{value:.{digits}g}'):g}" if -4 <= tens < 5 else f"{mantissa}e{tens}"


def describe(
    name: str, unit: str, median: float, interval: tuple[float, float], points: list[ProfilePoint], word: str
) -> str:
    """The value as far as the data support it, in words."""
    unit = "" if unit == "1" else f" {unit}"
    spread = (interval[1] - interval[0]) / 2
    if word == "determined":
        lower, upper = (significant(end, spread) for end in interval)
        return f"{name} = {significant(median, spread)}{unit} (90 %: {lower} to {upper})"
    if word == "not determined":
        why = "neither side of its profile closes" if points else "its interval is little narrower than the prior's"
        return f"{name} is not determined by these data; {why}"
    lower_limit, upper_limit = limits(points)
    if upper_limit is not None:
        return f"{name} at most {significant(upper_limit, upper_limit)}{unit} (95 %); the data set no lower limit"
    assert lower_limit is not None  # bounded below
    return f"{name} at least {significant(lower_limit, lower_limit)}{unit} (95 %); the data set no upper limit"


def profiles(
    problem: Problem, top: FloatArray, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[list[ProfilePoint]]:
    """Profiles of all physical parameters; see `profile`."""
    result = []
    for index in range(problem.n_physical):
        result.append(profile(problem, top, index))
        progress(index + 1, problem.n_physical)
    return result

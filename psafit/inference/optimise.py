"""Best parameter values by lmfit, from many starts.

Three stages. Quasi-random draws of the prior are simulated, and each is judged by its posterior density at the best
scatter for it. From the best draws that lie apart, least squares on residuals stabilised with that scatter finds the
basins of the physical parameters. From each distinct basin, the posterior density of all parameters, scatter included,
is climbed to its top.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import lmfit
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution, minimize
from scipy.stats import qmc

from psafit.errors import ConvergenceError
from psafit.inference import noise
from psafit.inference.problem import Problem

FloatArray = NDArray[np.float64]

# Difference steps in sampling coordinates of order one: cube root of the simulator's relative error (1e-12).
_STEP = 1e-4
# Two end points are one minimum when every physical coordinate agrees to five times this and the height does.
_SAME_PLACE, _SAME_HEIGHT = 0.05, 0.5
# Draws of the prior looked at for every start, and how far apart starts lie (in units of the prior's width).
_DRAWS_PER_START, _APART = 64, 0.25
# Basins this far below the best (log posterior, at the best scatter for each) are not climbed; at most so many are.
_PROMISING, _MOST_BASINS = 40.0, 6
# Differential evolution: members and generations.
_CROWD, _GENERATIONS = 48, 60
# Scatter tried for a prediction: quantiles of each parameter's prior.
_SCATTER = (0.02, 0.15, 0.35, 0.55, 0.75, 0.9, 0.985)
_TAILS = (0.2, 0.8)
# What stands for a residual or a height that is not finite: worse than any, and its square still a number.
_WORST = 1e12


@dataclass(frozen=True)
class Minimum:
    """One local optimum of the posterior.

    Parameters
    ----------
    values : (n_dim,) array
        In the parameters' units.
    log_posterior : float
        In the sampling coordinate.
    starts : int
        Starts that ended here.
    """

    values: FloatArray
    log_posterior: float
    starts: int


@dataclass(frozen=True)
class Optimum:
    """What the search found.

    Parameters
    ----------
    minima : tuple of Minimum
        Best first.
    covariance : (n_minima, n_dim, n_dim) array
        Inverse curvature at each minimum, in the sampling coordinate (Laplace approximation).
    n_starts : int
        Starts followed, the best of many more draws of the prior.
    n_failed : int
        Starts that ended where the model cannot be evaluated.
    n_evaluations : int
        Parameter sets simulated.
    report : str
        lmfit's report of the last climb.
    """

    minima: tuple[Minimum, ...]
    covariance: FloatArray
    n_starts: int
    n_failed: int
    n_evaluations: int
    report: str

    @property
    def best(self) -> Minimum:
        """The highest of them."""
        return self.minima[0]


def _finite(x: FloatArray) -> FloatArray:
    return np.nan_to_num(x, nan=_WORST, posinf=_WORST, neginf=-_WORST)


def _lmfit_parameters(problem: Problem, u: FloatArray, n: int) -> lmfit.Parameters:
    """The first `n` sampling coordinates as lmfit parameters, with the values themselves as expressions."""
    parameters = lmfit.Parameters()
    for p, value in zip(problem.parameters[:n], u, strict=True):
        b = p.sampling_bounds
        margin = 1e-9 * (b.upper - b.lower)  # lmfit's bound transform is singular at the bound itself
        value = float(np.clip(value, b.lower + margin, b.upper - margin))
        if p.prior.coordinate == "log":
            parameters.add(f"ln_{p.name}", value=value, min=b.lower, max=b.upper)
            parameters.add(p.name, expr=f"exp(ln_{p.name})")
        else:
            parameters.add(p.name, value=value, min=b.lower, max=b.upper)
    return parameters


def _coordinates(parameters: lmfit.Parameters) -> FloatArray:
    return np.array([p.value for p in parameters.values() if p.expr is None])


def _minimize(*arguments: Any, **options: Any) -> lmfit.minimizer.MinimizerResult:
    with warnings.catch_warnings():
        # lmfit ends with roots of an inverse curvature that on a flat top is no covariance; we never read them.
        warnings.filterwarnings("ignore", category=RuntimeWarning, module="lmfit")
        return lmfit.minimize(*arguments, calc_covar=False, **options)


def gradient(f: Callable[[FloatArray], FloatArray], u: FloatArray, bounds: FloatArray) -> FloatArray:
    """Central differences of a batched function at one point, in one batch, one-sided at a bound; (n_dim, ...)."""
    u = np.clip(u, bounds[:, 0], bounds[:, 1])
    steps = _STEP * np.eye(u.size)
    above, below = np.minimum(u + steps, bounds[:, 1]), np.maximum(u - steps, bounds[:, 0])
    both = f(np.concatenate([above, below]))
    width = np.diag(above - below).reshape(-1, *[1] * (both.ndim - 1))
    return (both[: u.size] - both[u.size :]) / width


def hessian(f: Callable[[FloatArray], FloatArray], u: FloatArray, step: float = 3e-3) -> FloatArray:
    """Central second differences of a batched scalar function at one point, in one batch; (n_dim, n_dim)."""
    n = u.size
    steps = step * np.eye(n)
    i, j = np.triu_indices(n)
    plus, minus = steps[i] + steps[j], steps[i] - steps[j]
    values = f(np.concatenate([u + plus, u - plus, u + minus, u - minus])).reshape(4, -1)
    second = (values[0] + values[1] - values[2] - values[3]) / (4 * step * step)
    result = np.empty((n, n))
    result[i, j] = result[j, i] = second
    return result


def laplace_covariance(problem: Problem, u: FloatArray) -> FloatArray:
    """Inverse of the negative curvature of the log posterior, made positive where the top is flat or at a bound."""
    curvature = -hessian(problem.log_posterior, _inside(problem, u, 7e-3))
    if not np.isfinite(curvature).all():
        curvature = np.diag(np.full(u.size, 1.0))
    values, vectors = np.linalg.eigh(curvature)
    width = np.ptp(problem.bounds, axis=1).min()
    values = np.maximum(values, (4.0 / width) ** 2)  # nowhere wider than a quarter of the narrowest bounds
    return (vectors / values) @ vectors.T


def _inside(problem: Problem, u: FloatArray, margin: float) -> FloatArray:
    return np.clip(u, problem.bounds[:, 0] + margin, problem.bounds[:, 1] - margin)


def _scatter(problem: Problem, predicted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Log density of the readings at the best scatter on a grid, its prior included, and that scatter.

    Parameters
    ----------
    problem : Problem
    predicted : (n_sets, n_points) array, um

    Returns
    -------
    (n_sets,) array and (n_sets, 3) array of sampling coordinates
    """
    n = problem.n_model
    grid = np.array(np.meshgrid(_SCATTER, _SCATTER, _TAILS)).reshape(3, -1).T
    u = np.stack([p.prior_quantile(grid[:, i]) for i, p in enumerate(noise.PARAMETERS)], axis=1)
    values = np.stack([p.to_physical(u[:, i]) for i, p in enumerate(noise.PARAMETERS)], axis=1)
    prior = np.sum([p.log_prior(u[:, i]) for i, p in enumerate(problem.parameters[n:])], axis=0)
    height = np.empty((len(predicted), len(grid)))
    for k, one in enumerate(values):
        scatter = np.broadcast_to(one, (len(predicted), 3))
        height[:, k] = noise.log_density(problem.observed, predicted, scatter, problem.known_sigma).sum(axis=1)
    height += prior
    best = np.argmax(np.where(np.isfinite(height), height, -np.inf), axis=1)
    return height[np.arange(len(height)), best], u[best]


def _screen(problem: Problem, seed: int, n_starts: int) -> tuple[FloatArray, int]:
    """Starts: the best of many draws of the prior, no two of them close; (n_starts, n_dim), and draws simulated."""
    power = math.ceil(math.log2(n_starts * _DRAWS_PER_START))
    quantiles = qmc.Sobol(problem.n_dim, rng=np.random.default_rng(seed)).random_base2(power)
    draws = problem.prior_transform(np.clip(quantiles, 1e-3, 1 - 1e-3))
    n = problem.n_model
    height = problem.log_prior(draws) - np.sum(
        [p.log_prior(draws[:, n + i]) for i, p in enumerate(problem.parameters[n:])], axis=0
    )
    for part in np.array_split(np.arange(len(draws)), math.ceil(len(draws) / 1024)):
        likelihood, draws[part, n:] = _scatter(problem, problem.predict(draws[part]))
        height[part] += likelihood
    width = np.ptp(problem.prior_transform(np.array([[0.16] * problem.n_dim, [0.84] * problem.n_dim])), axis=0)[:n]
    left = np.argsort(np.where(np.isfinite(height), -height, np.inf), kind="stable")
    chosen: list[int] = []
    # Far apart first; where that does not yield enough starts, closer.
    for apart in (_APART, 0.5 * _APART, 0.0):
        for k in left:
            if len(chosen) == n_starts:
                break
            if k in chosen or not np.isfinite(height[k]):
                continue
            if all(np.abs((draws[k, :n] - draws[c, :n]) / width).max() > apart for c in chosen):
                chosen.append(int(k))
    return draws[chosen], len(draws)


def _basin(problem: Problem, start: FloatArray) -> tuple[FloatArray, float, int]:
    """Least squares on variance-stabilised residuals: (coordinates, height at the best scatter, sets simulated)."""
    n = problem.n_model
    relative, absolute = (float(p.to_physical(u)) for p, u in zip(noise.PARAMETERS[:2], start[n : n + 2], strict=True))

    def stabilise(y: FloatArray) -> FloatArray:
        return np.arcsinh(y * relative / absolute) / relative

    target = stabilise(problem.observed)

    def batch(u: FloatArray) -> FloatArray:
        full = np.concatenate([u, np.broadcast_to(start[n:], (len(u), problem.n_dim - n))], axis=1)
        return _finite(stabilise(problem.predict(full)) - target)

    result = _minimize(
        lambda q: batch(_coordinates(q)[None, :])[0],
        _lmfit_parameters(problem, start[:n], n),
        method="least_squares",
        jac=lambda q: gradient(batch, _coordinates(q), problem.bounds[:n]).T,
        loss="soft_l1",
        f_scale=3.0,
        max_nfev=60,
        ftol=1e-4,
        xtol=1e-4,
    )
    u = np.concatenate([_coordinates(result.params), start[n:]])
    likelihood, u[n:] = (x[0] for x in _scatter(problem, problem.predict(u[None, :])))
    own = float(np.sum([p.log_prior(u[i]) for i, p in enumerate(problem.parameters[:n])]))
    return u, float(likelihood) + own, int(result.nfev) * (1 + 2 * n) + 1


def _widened(problem: Problem, nested: Optimum) -> FloatArray:
    """The best point of the model without causes as a point of the model with them: strengths neutral, else medians."""
    u = problem.prior_transform(np.full(problem.n_dim, 0.5))
    known = dict(zip((p.name for p in replace(problem, terms=()).parameters), nested.best.values, strict=True))
    for i, p in enumerate(problem.parameters):
        value = known.get(p.name, p.neutral)
        if value is not None and p.bounds.lower <= value <= p.bounds.upper:
            u[i] = p.to_sampling(value)
    return _inside(problem, u, 1e-3)


def _evolve(problem: Problem, crowd: FloatArray, seed: int) -> tuple[FloatArray, int]:
    """Best of a crowd after some generations of differential evolution, which kinks and narrow ridges do not stop.

    The first separation jumps from one dip of the indentation to another as parameters vary; the posterior has kinks
    there, at which climbing by gradients ends.
    """
    size = min(len(crowd), _CROWD)
    result = differential_evolution(
        lambda x: _finite(-problem.log_posterior(x.T)),
        list(problem.bounds),
        init=np.clip(crowd[:size], problem.bounds[:, 0], problem.bounds[:, 1]),
        strategy="randtobest1bin",
        maxiter=_GENERATIONS,
        mutation=(0.4, 0.9),
        recombination=0.9,
        tol=1e-4,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng([seed, 3]),
    )
    return np.asarray(result.x), int(result.nfev)


def climb(problem: Problem, start: FloatArray) -> tuple[FloatArray, float, lmfit.minimizer.MinimizerResult]:
    """Top of the posterior near `start`, all parameters free: (coordinates, height, lmfit's result)."""

    def depth(rows: FloatArray) -> FloatArray:
        return _finite(-problem.log_posterior(rows))

    result = _minimize(
        lambda q: float(depth(_coordinates(q)[None, :])[0]),
        _lmfit_parameters(problem, start, problem.n_dim),
        method="bfgs",
        jac=lambda q: gradient(depth, _coordinates(q), problem.bounds),
        options={"gtol": 1e-4},
    )
    # A simplex goes on where a kink has stopped the gradient.
    u, here = _coordinates(result.params), float(result.residual[0])
    simplex = u + 0.02 * np.vstack([np.zeros(u.size), np.eye(u.size)])
    polished = minimize(
        lambda v: float(depth(v[None, :])[0]),
        u,
        method="Nelder-Mead",
        bounds=problem.bounds,
        options={
            "initial_simplex": np.clip(simplex, *problem.bounds.T),
            "maxfev": 60 * u.size,
            "fatol": 1e-3,
            "xatol": 1e-3,
        },
    )
    if polished.fun < here:
        u = np.asarray(polished.x)
    return u, float(problem.log_posterior(u[None, :])[0]), result


def _report(problem: Problem, top: FloatArray, result: lmfit.minimizer.MinimizerResult) -> str:
    """Table of the parameters as lmfit prints it, with standard errors from the curvature of the posterior."""
    errors = iter(np.sqrt(np.diag(laplace_covariance(problem, top))))
    free = {name: float(next(errors)) for name, p in result.params.items() if p.expr is None}
    for name, p in result.params.items():
        p.stderr = free[name] if name in free else p.value * free[f"ln_{name}"]
    return f"{result.method}: {result.message}\n{lmfit.fit_report(result.params, show_correl=False)}"


def _merge(
    ends: list[tuple[FloatArray, float, int]], n_physical: int, height: float
) -> list[tuple[FloatArray, float, int]]:
    """Unite end points (coordinates, height, starts) that agree; highest first."""
    distinct: list[tuple[FloatArray, float, int]] = []
    for u, value, count in sorted(ends, key=lambda e: -e[1]):
        for k, (v, other, n) in enumerate(distinct):
            near = np.abs(u - v)[:n_physical].max() < _SAME_PLACE * 5
            if near and abs(value - other) < height:
                distinct[k] = (v, other, n + count)
                break
        else:
            distinct.append((u, value, count))
    return distinct


def optimise(
    problem: Problem,
    *,
    seed: int,
    n_starts: int = 32,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Optimum:
    """Search for the top of the posterior from the `n_starts` best of many quasi-random draws of the prior.

    Parameters
    ----------
    problem : Problem
    seed : int
        Of the scrambled Sobol sequence the starts come from.
    n_starts : int
    progress : callable
        Called with (starts done, starts in all).

    Returns
    -------
    Optimum

    Raises
    ------
    ConvergenceError
        If not one start led to a finite posterior.
    """
    starts, evaluations = _screen(problem, seed, n_starts)
    if problem.terms:
        # The model without its causes lies within it: what fits there is a start here, too.
        nested = optimise(replace(problem, terms=()), seed=seed, n_starts=max(n_starts // 4, 4))
        evaluations += nested.n_evaluations
        starts = np.concatenate([starts[: n_starts - 1], _widened(problem, nested)[None, :]])
    ends: list[tuple[FloatArray, float, int]] = []
    failed = n_starts - len(starts)
    for k, start in enumerate(starts):
        u, height, used = _basin(problem, start)
        evaluations += used
        if np.isfinite(height):
            ends.append((u, height, 1))
        else:
            failed += 1
        progress(k + 1, n_starts)
    if not ends:
        raise ConvergenceError("search for a starting point with finite posterior", reached=0, required=1)
    basins = _merge(ends, problem.n_physical, height=1.0)
    promising = [b for b in basins if b[1] > basins[0][1] - _PROMISING][:_MOST_BASINS]
    if problem.terms:
        crowd = np.array([e[0] for e in sorted(ends, key=lambda e: -e[1])] + list(starts))
        evolved, used = _evolve(problem, crowd, seed)
        evaluations += used
        promising.append((evolved, 0.0, 0))
    tops: list[tuple[FloatArray, float, int]] = []
    report = ""
    for u, _, count in promising:
        top, value, result = climb(problem, u)
        evaluations += int(result.nfev) * (1 + 2 * problem.n_dim)
        if np.isfinite(value):
            if not tops or value > max(t[1] for t in tops):
                report = _report(problem, top, result)
            tops.append((top, value, count))
    if not tops:
        raise ConvergenceError("search for a starting point with finite posterior", reached=0, required=1)
    distinct = _merge(tops, problem.n_physical, _SAME_HEIGHT)
    # Basins that were not climbed still are minima; their starts count, so that the share of the best is honest.
    minima = tuple(Minimum(problem.to_physical(u), value, count) for u, value, count in distinct)
    covariance = np.stack([laplace_covariance(problem, u) for u, _, _ in distinct])
    return Optimum(minima, covariance, n_starts, failed, evaluations, report)


def improve(problem: Problem, optimum: Optimum, start: FloatArray) -> Optimum:
    """Put the top that lies above `start` before the minima found, all of which are lower than `start`.

    Parameters
    ----------
    problem : Problem
    optimum : Optimum
    start : (n_dim,) array
        Sampling coordinates.

    Returns
    -------
    Optimum
        The new minimum counts no starts.
    """
    top, value, result = climb(problem, start)
    height = float(problem.log_posterior(start[None, :])[0])
    if not value > height:
        top, value = start, height
    return replace(
        optimum,
        minima=(Minimum(problem.to_physical(top), value, 0), *optimum.minima),
        covariance=np.concatenate([laplace_covariance(problem, top)[None], optimum.covariance]),
        n_evaluations=optimum.n_evaluations + int(result.nfev) * (1 + 2 * problem.n_dim),
        report=_report(problem, top, result),
    )

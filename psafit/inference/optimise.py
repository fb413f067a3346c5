"""Best parameter values by lmfit, from many starts.

Two stages. From quasi-random draws of the prior, least squares on variance-stabilised residuals finds the
basins of the physical parameters; from each distinct basin, the posterior density of all parameters, scatter
included, is climbed to its top.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import lmfit
import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from psafit.errors import ConvergenceError
from psafit.inference import noise
from psafit.inference.problem import Problem

FloatArray = NDArray[np.float64]

# Difference steps in sampling coordinates of order one: cube root of the simulator's relative error (1e-12).
_STEP = 1e-4
# Two end points are one minimum when every physical coordinate agrees to this (2 % of a factor e) and the height does.
_SAME_PLACE, _SAME_HEIGHT = 0.02, 0.05
# Basins whose least-squares cost is within this factor of the best are climbed; the rest cannot win.
_PROMISING, _MOST_BASINS = 3.0, 6


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
        Starts tried.
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


def gradient(f: Callable[[FloatArray], FloatArray], u: FloatArray) -> FloatArray:
    """Central differences of a batched function at one point, in one batch; (n_dim, ...)."""
    steps = _STEP * np.eye(u.size)
    both = f(np.concatenate([u + steps, u - steps]))
    return (both[: u.size] - both[u.size :]) / (2 * _STEP)


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


def _basin(problem: Problem, start: FloatArray) -> tuple[FloatArray, float, int]:
    """Least squares on variance-stabilised residuals: (coordinates, cost, sets simulated)."""
    relative, absolute = (float(p.to_physical(p.prior_quantile(0.5))) for p in noise.PARAMETERS[:2])
    n = problem.n_physical
    medians = problem.prior_transform(np.full(problem.n_dim, 0.5))

    def stabilise(y: FloatArray) -> FloatArray:
        return np.arcsinh(y * relative / absolute) / relative

    target = stabilise(problem.observed)

    def batch(u: FloatArray) -> FloatArray:
        full = np.concatenate([u, np.broadcast_to(medians[n:], (len(u), problem.n_dim - n))], axis=1)
        return stabilise(problem.predict(full)) - target

    result = lmfit.minimize(
        lambda q: batch(_coordinates(q)[None, :])[0],
        _lmfit_parameters(problem, start[:n], n),
        method="least_squares",
        jac=lambda q: gradient(batch, _coordinates(q)).T,
        loss="soft_l1",
        f_scale=5.0,
        max_nfev=150,
        ftol=1e-6,
        xtol=1e-6,
        calc_covar=False,
    )
    u = _coordinates(result.params)
    residual = batch(u[None, :])[0]
    cost = float(np.sum(25.0 * (np.sqrt(1 + (residual / 5.0) ** 2) - 1)))
    return u, cost, int(result.nfev) * (1 + 2 * n)


def climb(problem: Problem, start: FloatArray) -> tuple[FloatArray, float, lmfit.minimizer.MinimizerResult]:
    """Top of the posterior near `start`, all parameters free: (coordinates, height, lmfit's result)."""
    result = lmfit.minimize(
        lambda q: float(-problem.log_posterior(_coordinates(q)[None, :])[0]),
        _lmfit_parameters(problem, start, problem.n_dim),
        method="bfgs",
        jac=lambda q: -gradient(problem.log_posterior, _inside(problem, _coordinates(q), 2 * _STEP)),
        options={"gtol": 1e-4},
        calc_covar=False,
    )
    u = _coordinates(result.params)
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
    n_starts: int = 48,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Optimum:
    """Search for the top of the posterior from `n_starts` quasi-random draws of the prior.

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
    power = max(1, math.ceil(math.log2(n_starts)))
    quantiles = qmc.Sobol(problem.n_dim, rng=np.random.default_rng(seed)).random_base2(power)[:n_starts]
    starts = problem.prior_transform(np.clip(quantiles, 1e-3, 1 - 1e-3))
    medians = problem.prior_transform(np.full(problem.n_dim, 0.5))
    ends: list[tuple[FloatArray, float, int]] = []
    evaluations = failed = 0
    for k, start in enumerate(starts):
        u, cost, used = _basin(problem, start)
        evaluations += used
        if np.isfinite(cost):
            ends.append((np.concatenate([u, medians[problem.n_physical :]]), -cost, 1))
        else:
            failed += 1
        progress(k + 1, n_starts)
    basins = _merge(ends, problem.n_physical, height=max(1.0, 0.01 * abs(max(e[1] for e in ends)))) if ends else []
    promising = [b for b in basins if -b[1] <= _PROMISING * -basins[0][1] + 10][:_MOST_BASINS]
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

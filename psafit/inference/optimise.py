"""Best parameter values by lmfit, from many starts.

Four stages. Quasi-random draws of the prior are simulated, and each is judged by its posterior density at the best
scatter for it. From the best draws that lie apart, all at once, Fisher scoring climbs the posterior of all parameters,
scatter included (`psafit.inference.ascent`). A population looks for what those climbs have missed behind cliffs
(`psafit.inference.evolution`). Each distinct top is polished by lmfit: a gradient's climb, and a simplex where a kink
has stopped it.
"""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import lmfit
import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference import noise
from psafit.inference.ascent import ascend
from psafit.inference.evolution import evolved
from psafit.inference.problem import Problem
from psafit.physics import baseline

# Difference steps in sampling coordinates of order one: cube root of the simulator's relative error (1e-12).
_STEP = 1e-4
# Two end points are one minimum when every physical coordinate agrees to five times this and the height does.
_SAME_PLACE, _SAME_HEIGHT = 0.05, 0.5
# Draws of the prior looked at for every start, and how far apart starts lie (in units of the prior's width).
_DRAWS_PER_START, _APART = 32, 0.25
# Iterations after which the lower half of the starts is given up, and iterations for the rest.
_TRIAL, _REST = 6, 60
# Tops this far below the best (nats) are not polished; at most so many are.
_PROMISING, _MOST_BASINS = 20.0, 3
# Quantiles of a strength's prior at which a smaller model's optimum is a start for a larger one.
_STRENGTHS = (0.05, 0.25, 0.5, 0.75, 0.95)
# Scatter tried for a prediction: quantiles of each parameter's prior. The last is for a model that misses the readings
# by far: it may fit best where they are nothing but scatter, and no climb from a small one comes there.
_SCATTER = (0.02, 0.15, 0.35, 0.55, 0.75, 0.9, 0.985, 0.99999)
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
        Starts that ended here; none where a population or the posterior's draws led here.
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
        Parameter sets simulated: draws of the prior, the population, and climbs but for the simplices that end them;
        those of the search without the causes, too.
    report : str
        How lmfit's climb to the best minimum ended, and lmfit's table of that minimum, with errors from the curvature.
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


def starts_of(
    problem: Problem, seed: int, n_starts: int, n_draws: int, known: FloatArray | None = None
) -> tuple[FloatArray, int]:
    """Starts: the best of many draws of the prior, no two of them close.

    Parameters
    ----------
    problem : Problem
    seed : int
    n_starts, n_draws : int
    known : (n, n_dim) array, optional
        Good places in sampling coordinates. In three quarters of the draws each baseline parameter, and each cause
        with all that belongs to it, is with even chances that of one of these: where causes hold each other in place,
        no draw of all of them comes near.

    Returns
    -------
    (n_starts, n_dim) array and int
        The second is the number of draws simulated.
    """
    power = math.ceil(math.log2(n_draws))
    quantiles = qmc.Sobol(problem.n_dim, rng=np.random.default_rng(seed)).random_base2(power)
    draws = problem.prior_transform(np.clip(quantiles, 1e-3, 1 - 1e-3))
    n = problem.n_model
    # Data may want a cause where its prior hardly goes: half of the draws of each such parameter span its bounds.
    for i in range(len(baseline.PARAMETERS), problem.n_physical):
        q, (low, high) = quantiles[:, i], problem.bounds[i]
        prior = problem.parameters[i].prior_quantile(np.clip(2 * q, 1e-3, 1 - 1e-3))
        draws[:, i] = np.where(q < 0.5, prior, low + np.clip(2 * q - 1, 1e-3, 1 - 1e-3) * (high - low))
    if known is not None and len(known):
        rng = np.random.default_rng([seed, 5])
        crossed = np.flatnonzero(np.arange(len(draws)) % 4)
        keep = rng.random((crossed.size, problem.blocks[-1] + 1))[:, problem.blocks] < 0.5
        draws[crossed] = np.where(keep, known[crossed % len(known)], draws[crossed])
    height = problem.log_prior(draws) - np.sum(
        [p.log_prior(draws[:, n + i]) for i, p in enumerate(problem.parameters[n:])], axis=0
    )
    for part in np.array_split(np.arange(len(draws)), math.ceil(len(draws) / 1024)):
        likelihood, draws[part, n:] = _scatter(problem, problem.predict(draws[part]))
        height[part] += likelihood
    width = np.ptp(problem.prior_transform(np.array([[0.16] * problem.n_dim, [0.84] * problem.n_dim])), axis=0)[:n]
    left = np.argsort(np.where(np.isfinite(height), -height, np.inf), kind="stable")
    if problem.terms:
        # A cause's far end has its best draws, too, though nearer ones look better until all else is fitted to them.
        strengths = [problem.names.index(t.strength.name) for t in problem.terms]
        low, width_of = problem.bounds[strengths, 0], np.ptp(problem.bounds[strengths], axis=1)
        quarter = np.minimum(((draws[:, strengths] - low) / width_of * 4).astype(int), 3)
        rank: Counter[tuple[int, ...]] = Counter()
        place = np.empty(len(draws), int)
        for k in left:
            place[k] = rank[tuple(quarter[k])]
            rank[tuple(quarter[k])] += 1
        half = np.argsort(place[left], kind="stable")
        left = np.array([k for pair in zip(left, left[half], strict=True) for k in pair])
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


def widened(problem: Problem, nested: FloatArray, names: Sequence[str]) -> FloatArray:
    """A point of a model as points of one with more causes.

    Parameters
    ----------
    problem : Problem
        The larger model.
    nested : array
        Values of the smaller one, in the parameters' units.
    names : sequence of str
        Its parameters.

    Returns
    -------
    (n, n_dim) array
        Sampling coordinates: first with what is new at neutral values, where it has any, else at the prior's median;
        then with each new strength in turn at quantiles of its prior.
    """
    known = dict(zip(names, nested, strict=True))
    u = problem.prior_transform(np.full(problem.n_dim, 0.5))
    for i, p in enumerate(problem.parameters):
        value = known.get(p.name, p.neutral)
        if value is not None and p.bounds.lower <= value <= p.bounds.upper:
            u[i] = p.to_sampling(value)
    rows = [u]
    for term in problem.terms:
        if term.strength.name not in known:
            i = problem.names.index(term.strength.name)
            own = [problem.names.index(p.name) for p in term.parameters[1:]]
            for q in _STRENGTHS:
                row = u.copy()
                row[own] = [problem.parameters[j].prior_quantile(0.5) for j in own]
                row[i] = term.strength.prior_quantile(q)
                rows.append(row)
    return _inside(problem, np.array(rows), 1e-3)


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
    errors = np.sqrt(np.diag(laplace_covariance(problem, top)))
    # The climb went on from where lmfit's part of it ended.
    free = [p for p in result.params.values() if p.expr is None]
    for p, value, error in zip(free, top, errors, strict=True):
        p.value, p.stderr = float(value), float(error)
    for name, p in result.params.items():
        if p.expr is not None:
            p.stderr = p.value * result.params[f"ln_{name}"].stderr
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
    known: FloatArray | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Optimum:
    """Search for the top of the posterior from the `n_starts` best of many quasi-random draws of the prior.

    Parameters
    ----------
    problem : Problem
    seed : int
        Of the scrambled Sobol sequence the starts come from.
    n_starts : int
    known : (n, n_dim) array, optional
        Places that are known to be good, in sampling coordinates: they take the place of as many draws.
    progress : callable
        Called with (iterations done, iterations in all) of the climbs.

    Returns
    -------
    Optimum

    Raises
    ------
    ConvergenceError
        If not one start led to a finite posterior.
    """
    starts, evaluations = starts_of(problem, seed, n_starts, n_starts * _DRAWS_PER_START)
    given = np.empty((0, problem.n_dim)) if known is None else np.clip(known, *problem.bounds.T)
    if problem.terms:
        # The model without its causes lies within it: what fits there is a start here, too.
        plain = replace(problem, terms=())
        nested = optimise(plain, seed=seed, n_starts=max(n_starts // 4, 4))
        evaluations += nested.n_evaluations
        given = np.concatenate([given, widened(problem, nested.best.values, plain.names)])
    given = given[:n_starts]
    starts = np.concatenate([starts[: n_starts - len(given)], given])
    climbed = ascend(problem, starts, schedule=((_TRIAL, max(n_starts // 2, 1)), (_REST, n_starts)), progress=progress)
    evaluations += climbed.n_sets
    found = np.isfinite(climbed.height)
    ends = [(u, float(h), 1) for u, h in zip(climbed.u[found], climbed.height[found], strict=True)]
    failed = n_starts - len(starts) + int((~found).sum())
    if not ends:
        raise ConvergenceError("search for a starting point with finite posterior", reached=0, required=1)
    basins = _merge(ends, problem.n_physical, height=1.0)
    promising = [b for b in basins if b[1] > basins[0][1] - _PROMISING][:_MOST_BASINS]
    beyond = evolved(problem, climbed.u[[climbed.best]], seed=seed)
    evaluations += beyond.n_sets
    # Beside the starts' ends, none of which it may keep from being polished; one place where they agree.
    other = [(u, float(h), 0) for u, h in zip(beyond.u, beyond.height, strict=True) if np.isfinite(h)]
    promising = _merge([*promising, *other], problem.n_physical, height=1.0)
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

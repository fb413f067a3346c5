"""Starts of optimisations: quasi-random draws of the prior, simulated and judged, or what is known.

Each draw is judged by its posterior density at the best scatter for it; the best that lie apart are starts
(`psafit.inference.candidate.fit` goes on from them).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from psafit.arrays import FloatArray
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.inference.scan import ScanSettings, halved
from psafit.physics import baseline


def _scatter(
    problem: Problem,
    predicted: FloatArray,
    quantiles: Sequence[float] = (0.02, 0.15, 0.35, 0.55, 0.75, 0.9, 0.985, 0.99999),
    tails: Sequence[float] = (0.2, 0.8),
    memories: Sequence[float] = (0.15, 0.5, 0.85),
) -> tuple[FloatArray, FloatArray]:
    """Log density of the readings at the best scatter on a grid, its prior included, and that scatter.

    Parameters
    ----------
    problem : Problem
    predicted : (n_sets, n_points) array
        Each in the unit of its reading.
    quantiles, tails, memories : sequence of float
        The grid: quantiles of the priors of both widths, of the degrees of freedom, and of a trace's correlation time.
        The last width is for a model that misses the readings by far: it may fit best where they are nothing but
        scatter, and no optimisation from a small one comes there.

    Returns
    -------
    (n_sets,) array and (n_sets, n_dim - n_model) array of sampling coordinates
    """
    total, at = np.zeros(len(predicted)), []
    for own, here in zip(problem.scatter_at, problem.rows_of_scatter, strict=True):
        parameters = problem.scatter[own]
        axes = (quantiles, quantiles, tails, memories)[: len(parameters)]
        grid = np.array(np.meshgrid(*axes)).reshape(len(axes), -1).T
        u = np.stack([p.prior_quantile(grid[:, i]) for i, p in enumerate(parameters)], axis=1)
        values = np.stack([p.to_physical(u[:, i]) for i, p in enumerate(parameters)], axis=1)
        prior = np.sum([p.log_prior(u[:, i]) for i, p in enumerate(parameters)], axis=0)
        known = None if problem.known_sigma is None else problem.known_sigma[here]
        log_posterior = np.empty((len(predicted), len(grid)))
        for k, one in enumerate(values):
            scatter = noise.along(one[None], problem.design.elapsed[here])
            density = noise.log_density(problem.observed[here], predicted[:, here], scatter, known)
            log_posterior[:, k] = density.sum(axis=1)
        log_posterior += prior
        best = np.argmax(np.where(np.isfinite(log_posterior), log_posterior, -np.inf), axis=1)
        total += log_posterior[np.arange(len(log_posterior)), best]
        at.append(u[best])
    return total, np.concatenate(at, axis=1)


def starts_of(
    problem: Problem,
    seed: int,
    n_starts: int,
    n_draws: int,
    known: FloatArray | None = None,
    *,
    apart: float = 0.25,
    halvings: float = ScanSettings.halvings,
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
    apart : float
        How far apart starts lie, in units of the prior's width, where that yields enough of them.

    Returns
    -------
    (n_starts, n_dim) array and int
        The second is the number of draws simulated.
    """
    power = math.ceil(math.log2(n_draws))
    quantiles = qmc.Sobol(problem.n_dim, rng=np.random.default_rng(seed)).random_base2(power)
    draws = problem.prior_transform(np.clip(quantiles, 1e-3, 1 - 1e-3))
    n, rows = problem.n_model, np.arange(len(draws))
    # Data may want a cause where its prior hardly goes: a third of the draws of each strength approach its neutral
    # value from its bounds by halves, and a third, of any other parameter half, span the bounds.
    scanned = {t.strength.name for t in problem.terms}
    for i in range(len(baseline.PARAMETERS), problem.n_physical):
        p, of = problem.parameters[i], 3 if problem.parameters[i].name in scanned else 2
        which, there = np.divmod(quantiles[:, i] * of, 1.0)
        there = np.clip(there, 1e-3, 1 - 1e-3)
        drawn = [p.prior_quantile(there), problem.bounds[i, 0] + there * np.ptp(problem.bounds[i])]
        if of == 3:
            sides = halved(p, halvings * there)
            drawn.append(np.where(rows % len(sides), sides[-1], sides[0]))
        draws[:, i] = np.choose(which.astype(int), drawn)
    if known is not None and len(known):
        rng = np.random.default_rng([seed, 5])
        crossed = np.flatnonzero(np.arange(len(draws)) % 4)
        keep = rng.random((crossed.size, problem.blocks[-1] + 1))[:, problem.blocks] < 0.5
        draws[crossed] = np.where(keep, known[crossed % len(known)], draws[crossed])
    log_posterior = problem.log_prior(draws) - np.sum(
        [p.log_prior(draws[:, n + i]) for i, p in enumerate(problem.parameters[n:])], axis=0
    )
    for part in np.array_split(np.arange(len(draws)), math.ceil(len(draws) / 1024)):
        likelihood, draws[part, n:] = _scatter(problem, problem.predict(draws[part]))
        log_posterior[part] += likelihood
    width = problem.prior_widths[:n]
    left = np.argsort(np.where(np.isfinite(log_posterior), -log_posterior, np.inf), kind="stable")
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
    left = left[np.isfinite(log_posterior[left])]
    return draws[_far_apart(draws[:, :n], width, left, n_starts, apart)], len(draws)


def _far_apart(places: FloatArray, width: FloatArray, ranked: NDArray[np.intp], n: int, apart: float) -> list[int]:
    """The first `n` by rank that lie far apart; where that does not yield enough, closer."""
    chosen: list[int] = []
    for distance in (apart, 0.5 * apart, 0.0):
        for k in ranked.tolist():
            if len(chosen) == n:
                break
            if k not in chosen and all(np.abs((places[k] - places[c]) / width).max() > distance for c in chosen):
                chosen.append(k)
    return chosen


def joined_values(problem: Problem, values: Mapping[str, float]) -> FloatArray:
    """A point of a model at known values of some of its parameters.

    Parameters
    ----------
    problem : Problem
    values : mapping
        Values by parameter, in the parameters' units.

    Returns
    -------
    (n_dim,) array
        Sampling coordinates. What is not known is at its neutral value, where it has any, else at its prior's median.
    """
    u = problem.medians
    for i, p in enumerate(problem.parameters):
        value = values.get(p.name, p.neutral)
        if value is not None and p.bounds.lower <= value <= p.bounds.upper:
            u[i] = p.to_sampling(value)
    return np.clip(u, *problem.bounds.T)

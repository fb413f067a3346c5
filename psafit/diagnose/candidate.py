r"""A model under judgement: the baseline with some causes, fitted to some groups, and how much speaks for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import arviz
import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, log_ndtr, logsumexp
from scipy.stats import multivariate_t, qmc

from psafit.experiment import Experiment, Group
from psafit.inference.ascent import Ascent, ascend, expansion, slopes
from psafit.inference.optimise import starts_of, widened
from psafit.inference.problem import Problem
from psafit.physics.term import Term

FloatArray = NDArray[np.float64]

# Climbs: iterations on a third of the readings, then on all of them, and how many go on after each.
_TRIAL, _MIDDLE, _REST = (4, 5), (5, 2), (30, 2)
# ... and of a model that all others are built on, all on all readings.
_THOROUGH = ((4, 24), (8, 12), (30, 6))
# Fewer readings than this are not thinned.
_THIN, _MANY = 3, 150
# Modes this far below the best (nats) are forgotten; two are one where all coordinates of the model agree to this.
_FORGOTTEN, _SAME = 12.0, 0.1
# Pareto's k up to which importance sampling is trusted (A. Vehtari et al., J. Mach. Learn. Res. 25 (2024) 72), draws
# below which it has hardly begun, and what an evidence may be off by (nats) in either case: seen in longer runs.
_TRUSTED, _FEW, _DOUBTS = 0.7, 30.0, (2.0, 5.0)
# Importance sampling: degrees of freedom of the proposal, its widening (over the number of dimensions), draws a round
# (a power of two; twice as many in more dimensions than this), and effective draws wanted.
_TAILS, _WIDER, _ROUND, _MANY_DIMENSIONS, _EFFECTIVE = 6.0, 1.8, 256, 8, 120.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted model.

    Parameters
    ----------
    problem : Problem
    modes : (n_modes, n_dim) array
        Optima, in sampling coordinates, best first.
    heights : (n_modes,) array
        Log posteriors there.
    predicted : (n_points,) array, um
        Launch ranges at the best.
    slope : (n_model, n_points) array, um
        Their derivatives by the sampling coordinates of the model.
    curvature : (n_modes, n_dim, n_dim) array
        Expected curvature of the log posterior at the modes.
    laplace : float
        Log evidence by Laplace's approximation, bounds respected.
    n_sets : int
        Parameter sets simulated to find it.
    """

    problem: Problem
    modes: FloatArray
    heights: FloatArray
    predicted: FloatArray
    slope: FloatArray
    curvature: FloatArray
    laplace: float
    n_sets: int

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its causes."""
        return self.problem.terms

    @property
    def ids(self) -> tuple[str, ...]:
        """Their identifiers."""
        return tuple(t.id for t in self.problem.terms)

    @property
    def height(self) -> float:
        """Log posterior of the best mode."""
        return float(self.heights[0])

    @property
    def values(self) -> FloatArray:
        """Parameters of the best mode, in their units."""
        return self.problem.to_physical(self.modes[0])

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the best mode."""
        return self.height - float(self.problem.log_prior(self.modes[:1])[0])


def thinned(experiment: Experiment, every: int) -> Experiment:
    """Every so many-th reading of each group; the least group keeps all of eight."""

    def part(g: Group) -> Group:
        rows = slice(None, None, every if g.n_points >= 8 * every else max(g.n_points // 8, 1))
        return replace(
            g,
            frequency_hz=g.frequency_hz[rows],
            amplitude_v=g.amplitude_v[rows],
            launch_range_um=g.launch_range_um[rows],
            sigma_um=None if g.sigma_um is None else g.sigma_um[rows],
        )

    return replace(experiment, groups=tuple(part(g) for g in experiment.groups))


def fit(
    problem: Problem,
    nested: Sequence[Candidate],
    *,
    seed: int,
    extra: FloatArray | None = None,
    draws: int = 256,
    most: int = 12,
) -> Candidate:
    """Fit a model from the optima of smaller ones and from draws of the prior.

    Parameters
    ----------
    problem : Problem
    nested : sequence of Candidate
        Models within this one, on the same readings.
    seed : int
    extra : (n, n_dim) array, optional
        More starts.
    draws : int
        Draws of the prior that are looked at for starts.
    most : int
        Starts taken from them.

    Returns
    -------
    Candidate
        The problem's own optimum is never below that of a nested model by more than a strength off its neutral value
        costs.
    """
    rows = [widened(problem, c.problem.to_physical(u), c.problem.names) for c in nested for u in c.modes[:2]]
    # A cause at its neutral value is a ridge that climbs may leave and not find again: the first is followed to the
    # end.
    neutral = np.vstack([r[:1] for r in rows[:2]]) if nested else np.empty((0, problem.n_dim))
    if extra is not None and len(extra):
        # These know better than fixed strengths where to begin.
        rows = [rows[0], *(r[:1] for r in rows[1:]), extra] if len(nested) == 1 else [*(r[:1] for r in rows), extra]
    thorough = not nested
    thin = 1 if thorough or problem.observed.size < _MANY else _THIN
    coarse = replace(problem, experiment=thinned(problem.experiment, thin)) if thin > 1 else problem
    n_sets = 0
    if draws and most:
        screened, used = starts_of(coarse, seed, most, draws)
        rows.append(screened)
        n_sets += used // thin
    starts = np.vstack(rows)
    if thorough:
        full = ascend(problem, starts, schedule=_THOROUGH)
        return settle(problem, full, n_sets + full.n_sets)
    trial = ascend(coarse, starts, schedule=(_TRIAL,))
    full = ascend(problem, np.vstack([neutral, trial.u]), schedule=(_MIDDLE, _REST))
    return settle(problem, full, n_sets + trial.n_sets // thin + full.n_sets)


def settle(problem: Problem, end: Ascent, n_sets: int) -> Candidate:
    """Turn the ends of climbs into a candidate."""
    order = np.argsort(-end.height, kind="stable")
    modes: list[int] = []
    for k in order:
        near = any(np.abs(end.u[k] - end.u[m])[: problem.n_physical].max() < _SAME for m in modes)
        if not near and end.height[k] > end.height[order[0]] - _FORGOTTEN:
            modes.append(int(k))
    u, predicted = end.u[modes], end.predicted[modes]
    slope = slopes(problem, u, predicted)
    observed = np.broadcast_to(problem.observed, predicted.shape)
    gradient, curvature = expansion(problem, u, predicted, slope, observed)
    parts = [_laplace(problem, u[k], float(end.height[m]), gradient[k], curvature[k]) for k, m in enumerate(modes)]
    return Candidate(
        problem, u, end.height[modes], predicted[0], slope[0], curvature, float(logsumexp(parts)), n_sets
    )  # fmt: skip


def _laplace(problem: Problem, u: FloatArray, height: float, gradient: FloatArray, curvature: FloatArray) -> float:
    """Log mass of a mode: normal, cut at the bounds coordinate by coordinate."""
    low, high = u - problem.bounds[:, 0], problem.bounds[:, 1] - u
    # No coordinate is wider than its bounds, though the curvature may say nothing of it.
    curvature = curvature + np.diag((3.5 / np.ptp(problem.bounds, axis=1)) ** 2)
    covariance = np.linalg.inv(curvature)
    total = height + 0.5 * (u.size * math.log(2 * math.pi) - np.linalg.slogdet(curvature)[1])
    for i in range(u.size):
        c = 1.0 / max(covariance[i, i], 1e-300)
        # At a bound the slope is not zero: exp(-g x - c x^2 / 2) over the half line, over the whole normal's mass.
        near, g = (low[i], -gradient[i]) if low[i] < high[i] else (high[i], gradient[i])
        if near < 1e-6:
            total += math.log(0.5 * erfcx(max(g, 0.0) / math.sqrt(2 * c)) + 1e-300)
        else:
            total += float(log_ndtr(near * math.sqrt(c)))
    return total


# --- evidence -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Weighed:
    """Weighted draws of a posterior, and the evidence they give.

    Parameters
    ----------
    draws : (n, n_dim) array
        Sampling coordinates.
    weights : (n,) array
        Normalised.
    log_evidence, error : float
        Natural logarithm, and its standard error.
    effective : float
        Effective number of draws.
    pareto_k : float
        Shape of the weights' tail (Vehtari et al.): above 0.7 the evidence is not to be trusted.
    n_sets : int
    """

    draws: FloatArray
    weights: FloatArray
    log_evidence: float
    error: float
    effective: float
    pareto_k: float
    n_sets: int

    @property
    def doubt(self) -> float:
        """Standard error of the log evidence; nats where the weights' tail makes that error meaningless."""
        if self.pareto_k < _TRUSTED:
            return self.error
        return max(self.error, _DOUBTS[int(self.effective < _FEW)])

    def quantiles(self, values: FloatArray, q: Sequence[float]) -> FloatArray:
        """Weighted quantiles of `values` (n, ...) along the first axis; (len(q), ...)."""
        order = np.argsort(values, axis=0)
        mass = np.cumsum(self.weights[order], axis=0) - 0.5 * self.weights[order]
        ordered = np.take_along_axis(values, order, axis=0)
        flat_mass, flat = mass.reshape(len(mass), -1), ordered.reshape(len(mass), -1)
        found = [np.interp(q, flat_mass[:, i], flat[:, i]) for i in range(flat.shape[1])]
        return np.array(found).T.reshape(len(q), *values.shape[1:])

    def resampled(self, n: int) -> FloatArray:
        """Equally weighted draws, by systematic resampling; (n, n_dim)."""
        positions = (np.arange(n) + 0.5) / n
        chosen = np.searchsorted(np.cumsum(self.weights), positions)
        return self.draws[np.minimum(chosen, len(self.draws) - 1)]


def weigh(candidate: Candidate, *, seed: int, rounds: int = 12, effective: float = _EFFECTIVE) -> Weighed:
    """Evidence and posterior by adaptive importance sampling.

    The proposal is a mixture of Student densities, first at the modes with Laplace's covariances, then at the
    weighted draws so far; the weights of all rounds are those of the mixture of all proposals (J.-M. Cornuet et al.,
    Scand. J. Stat. 39 (2012) 798).

    Parameters
    ----------
    candidate : Candidate
    seed : int
    rounds : int
        At most so many, of 256 or 512 draws each.
    effective : float
        Effective draws at which it is enough.
    """
    problem = candidate.problem
    d = problem.n_dim
    n_round = _ROUND * (1 if d <= _MANY_DIMENSIONS else 2)
    wider = (1 + _WIDER / d) ** 2
    width = np.ptp(problem.bounds, axis=1)
    components: list[tuple[FloatArray, FloatArray, float]] = []
    masses = np.exp(candidate.heights - candidate.heights[0])
    for u, curvature, mass in zip(candidate.modes, candidate.curvature, masses, strict=True):
        covariance = _positive(np.linalg.pinv(curvature, hermitian=True), width)
        components.append((u, covariance * wider, max(float(mass), 0.02)))
    all_draws: list[FloatArray] = []
    all_heights: list[FloatArray] = []
    proposals: list[list[tuple[FloatArray, FloatArray, float]]] = []
    weights = np.empty(0)
    sobol = qmc.Sobol(d + 2, rng=np.random.default_rng([seed, 5]))
    value, error, count, k_hat = -math.inf, math.inf, 0.0, math.inf
    n_sets = 0
    for _ in range(rounds):
        proposals.append(components)
        draws = _draw(components, sobol.random(n_round), d)
        inside = ((draws >= problem.bounds[:, 0]) & (draws <= problem.bounds[:, 1])).all(axis=1)
        height = np.full(len(draws), -np.inf)
        if inside.any():
            height[inside] = problem.log_posterior(draws[inside])
        n_sets += int(inside.sum())
        all_draws.append(draws)
        all_heights.append(np.where(np.isfinite(height), height, -np.inf))
        u, h = np.concatenate(all_draws), np.concatenate(all_heights)
        density = logsumexp([_log_density(p, u) for p in proposals], axis=0) - math.log(len(proposals))
        log_weight = h - density
        value = float(logsumexp(log_weight) - math.log(len(u)))
        weights = np.exp(log_weight - logsumexp(log_weight))
        count = float(1 / np.sum(weights**2))
        error = float(np.sqrt(max(1 / count - 1 / len(u), 0.0)))
        if count > effective:
            break
        components = _adapted(u, weights, width, wider, components)
    finite = np.isfinite(log_weight)
    if finite.sum() > 25:
        k_hat = float(np.asarray(arviz.psislw(log_weight[finite])[1]))
    kept = weights > 0
    return Weighed(u[kept], weights[kept], value, error, count, k_hat, n_sets)


def _positive(covariance: FloatArray, width: FloatArray) -> FloatArray:
    """Covariance with no direction wider than the bounds and none without any width."""
    scale = width / 3
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    clipped = (vectors * np.clip(values, 1e-10, 1.0)) @ vectors.T
    return np.asarray(clipped * np.outer(scale, scale))


def _adapted(
    u: FloatArray,
    weights: FloatArray,
    width: FloatArray,
    wider: float,
    before: list[tuple[FloatArray, FloatArray, float]],
) -> list[tuple[FloatArray, FloatArray, float]]:
    """Components around the weighted draws: the heaviest draws as centres, each with its neighbours' covariance."""
    # Tempered until some tens of draws count: a handful would collapse the proposal onto themselves.
    power = 1.0
    tempered = weights
    while 1 / np.sum(tempered**2) < min(60, 0.2 * len(u)) and power > 0.05:
        power *= 0.8
        tempered = np.where(weights > 0, np.maximum(weights, 1e-300) ** power, 0.0)
        tempered /= tempered.sum()
    mean = tempered @ u
    centred = u - mean
    covariance = _positive((centred * tempered[:, None]).T @ centred + 1e-9 * np.diag(width**2), width)
    whole = (mean, covariance * wider, 1.0)
    parts = []
    left = tempered.copy()
    for _ in range(3):
        k = int(np.argmax(left))
        offset = u - u[k]
        near = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset) < 0.5 * u.shape[1]
        share = float(tempered[near].sum())
        if near.sum() > 4 * u.shape[1] and share > 0.02:
            w = tempered * near / share
            c = w @ u
            local = _positive(((u - c) * w[:, None]).T @ (u - c) + 1e-9 * np.diag(width**2), width)
            parts.append((c, local * wider, share))
        left = np.where(near, 0.0, left)
        if not left.any():
            break
    first = [(m, c, 0.1 * w) for m, c, w in before]
    return [whole, *parts, *first][:8]


def _draw(components: list[tuple[FloatArray, FloatArray, float]], points: FloatArray, d: int) -> FloatArray:
    """Quasi-random draws of a mixture of Student densities."""
    from scipy.special import ndtri
    from scipy.stats import chi2

    share = np.cumsum([w for _, _, w in components])
    which = np.minimum(np.searchsorted(share / share[-1], points[:, 0]), len(components) - 1)
    clipped = np.clip(points, 1e-9, 1 - 1e-9)
    normal = ndtri(clipped[:, 2:])
    stretch = np.sqrt(_TAILS / chi2.ppf(clipped[:, 1], _TAILS))
    result = np.empty((len(points), d))
    for k, (mean, covariance, _) in enumerate(components):
        rows = which == k
        result[rows] = mean + stretch[rows, None] * (normal[rows] @ np.linalg.cholesky(covariance).T)
    return result


def _log_density(components: list[tuple[FloatArray, FloatArray, float]], u: FloatArray) -> FloatArray:
    total = sum(w for _, _, w in components)
    parts = [
        math.log(w / total) + multivariate_t.logpdf(u, mean, covariance, df=_TAILS)
        for mean, covariance, w in components
    ]
    return np.asarray(logsumexp(parts, axis=0))

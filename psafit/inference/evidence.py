r"""Evidence and posterior of a fitted model, by importance sampling from an emulated posterior.

In ten and more dimensions a normal or Student density is a poor picture of a posterior: bounds cut it, the scatter and
the strengths bend it. Simulations are dear, but launch ranges are smooth in the parameters almost everywhere. So the
draws already simulated give an emulator, for every reading a polynomial in the model's parameters; the
posterior that goes with it costs nothing to sample, and its draws are simulated next. Whatever the emulator is worth,
the weights are those of importance sampling, with the densities of all rounds as a mixture (J.-M. Cornuet et al.,
Scand. J. Stat. 39 (2012) 798): a poor emulator costs draws, it does not bias.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp, ndtri
from scipy.stats import chi2, qmc

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference import store
from psafit.inference.ascent import heights
from psafit.inference.candidate import Candidate, hills, settle_at, within_bounds
from psafit.physics import baseline

TRUSTED = 0.7
"""Pareto's k up to which importance sampling is trusted (A. Vehtari et al., J. Mach. Learn. Res. 25 (2024) 72)."""

# Draws below which it has hardly begun, and what an evidence may be off by (nats) in either case: seen in longer runs.
_FEW, _DOUBTS = 30.0, (2.0, 5.0)
# Student densities: degrees of freedom, widening (over the number of dimensions), most in a mixture.
_TAILS, _WIDER, _MOST = 6.0, 1.8, 8
# Draws a round, rounds at least (the first emulators may not know all of a bent posterior yet) and at most, effective
# draws wanted; and the same for the emulated posterior.
_ROUND, _LEAST, ROUNDS, EFFECTIVE = 256, 4, 12, 150.0
# Draws after which none will lie within the bounds, and those made at a time.
_PATIENCE, _BLOCK = 1 << 18, 1 << 13
_ROUND_EMULATED, _EFFECTIVE_EMULATED, _ROUNDS_EMULATED = 2048, 800.0, 10
# Share of the draws that do not come from the emulated posterior, for its tails may be too light. (A quarter of a power
# of two is one, as quasi-random draws want.)
_CAUTION = 0.25
# Draws that inform an emulator most lie this many nats per dimension below the best. What its coefficients of each
# degree, in the whitened coordinate and in units of the scatter, may differ by from what was known; and draws wanted
# for each of them in degrees above two.
_NEAR, _FREEDOM, _DRAWS_PER_COEFFICIENT = 1.5, np.array([10.0, 3.0, 1.0, 0.3, 0.1]), 5
# Places at which each parameter of a cause is looked at over its prior, nats below the mode within which it has company
# there, and what lies so many widths away that the curvature says nothing of it.
_PLACES, _COMPANY, _AWAY = 32, 4.0, 4.0
# An emulator is not believed much further out than its better draws: nats that are lost at twice that distance.
_BEYOND, _DISTRUST = 1.2, 20.0
# Metropolis steps in an emulated posterior between two in the posterior itself (few where the emulator is poor), and
# their length in its widths (over the root of the number of dimensions: G. O. Roberts, A. Gelman and W. R. Gilks, Ann.
# Appl. Probab. 7 (1997) 110).
_STRIDES, _JUMP = (1, 3, 10, 30), 1.7


Region = Callable[[FloatArray], NDArray[np.bool_]]
"""Which rows of coordinates lie in it."""


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
    top : (n_dim,) array
        The draw of the highest posterior density.
    height : float
        Its log posterior.
    """

    draws: FloatArray
    weights: FloatArray
    log_evidence: float
    error: float
    effective: float
    pareto_k: float
    top: FloatArray
    height: float

    @property
    def doubt(self) -> float:
        """Standard error of the log evidence; nats where the weights' tail makes that error meaningless."""
        if self.pareto_k < TRUSTED:
            return self.error
        return max(self.error, _DOUBTS[int(self.effective < _FEW)])

    def quantiles(self, values: FloatArray, q: Sequence[float]) -> FloatArray:
        """Weighted quantiles of `values` (n, ...) along the first axis; (len(q), ...)."""
        return quantiles(values, self.weights, q)

    def resampled(self, n: int) -> FloatArray:
        """Equally weighted draws, by systematic resampling; (n, n_dim)."""
        return self.draws[_systematic(self.weights, n)]

    def mean_of(self, log_factor: FloatArray) -> float:
        """Log of the mean of a factor over the posterior; `log_factor` is (n,)."""
        return float(logsumexp(log_factor + np.log(self.weights)))


def quantiles(values: FloatArray, weights: FloatArray, q: Sequence[float]) -> FloatArray:
    """Weighted quantiles of `values` (n, ...) along the first axis; (len(q), ...)."""
    flat = values.reshape(len(values), -1)
    order = np.argsort(flat, axis=0)
    mass = np.cumsum(weights[order], axis=0) - 0.5 * weights[order]
    ordered = np.take_along_axis(flat, order, axis=0)
    found = [np.interp(q, mass[:, i], ordered[:, i]) for i in range(flat.shape[1])]
    return np.array(found).T.reshape(len(q), *values.shape[1:])


def _systematic(weights: FloatArray, n: int, first: float = 0.5) -> NDArray[np.intp]:
    positions = (np.arange(n) + first) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), positions), len(weights) - 1)


def weigh(candidate: Candidate, *, seed: int, rounds: int = ROUNDS, effective: float = EFFECTIVE) -> Weighed:
    """Evidence and posterior of a fitted model.

    Hills of the posterior that lie apart are sampled one by one, each where it is the nearest, and added: no polynomial
    emulates two.

    Parameters
    ----------
    candidate : Candidate
    seed : int
    rounds : int
        At most so many on each hill, of 256 simulated draws each.
    effective : float
        Effective draws at which it is enough.
    """
    random = np.random.default_rng([seed, 5])
    pools = [
        _importance(_on_plateaus(hill), random, rounds, effective, region)[0] for hill, region in _hills(candidate)
    ]
    return _Pool.together(pools).weighed()


def emulate(candidate: Candidate, *, seed: int, rounds: int = ROUNDS, effective: float = EFFECTIVE) -> Emulated:
    """Emulate the posterior of a fitted model; arguments as of `weigh`."""
    random = np.random.default_rng([seed, 5])
    candidate = _on_plateaus(candidate)
    pool, simulated = _importance(candidate, random, rounds, effective)
    return Emulated(candidate, pool, simulated, _laplace_mixture(candidate).around(pool, _width(candidate)), random)


def _everywhere(u: FloatArray) -> NDArray[np.bool_]:
    return np.ones(len(u), bool)


def _hills(candidate: Candidate) -> list[tuple[Candidate, Region]]:
    """The model on each of its hills, and where that hill's density is the highest.

    Whatever the regions are worth, they leave out nothing and count nothing twice.
    """
    leaders = hills(candidate)
    if len(leaders) == 1:
        return [(candidate, _everywhere)]
    known = _laplace_mixture(candidate)
    centre, inverse = known.centre[leaders], known.inverse[leaders]

    def nearest(u: FloatArray) -> NDArray[np.intp]:
        return np.asarray(np.argmax(student_log_density(u, centre, inverse, _TAILS), axis=0))

    def region(k: int) -> Region:
        return lambda u: nearest(u) == k

    own = nearest(candidate.modes)
    own[leaders] = np.arange(len(leaders))
    return [(settle_at(candidate.problem, candidate.modes[own == k]), region(k)) for k in range(len(leaders))]


def _importance(
    candidate: Candidate,
    random: np.random.Generator,
    rounds: int,
    effective: float,
    region: Region = _everywhere,
) -> tuple[_Pool, FloatArray]:
    """Simulated draws with their weights, and their launch ranges; what lies outside the region weighs nothing."""
    problem = candidate.problem
    simulated: list[FloatArray] = []

    def height(u: FloatArray) -> FloatArray:
        found = problem.predict(u)
        simulated.append(found)
        return np.where(region(u), heights(problem, u, found, problem.observed), -np.inf)

    def next_one(pool: _Pool, before: _Density) -> _Density:
        return Emulated(candidate, pool, np.concatenate(simulated), before.mixture, random)

    first = _laplace_mixture(candidate)
    pool = _sample(height, problem.bounds, first, next_one, random, _ROUND, rounds, effective)
    return pool, np.concatenate(simulated)


def _on_plateaus(candidate: Candidate) -> Candidate:
    """The same with its best mode in the middle of where a parameter may lie, if that is wider than its curvature says.

    What acts by thresholds changes nothing between two of them. A climb ends anywhere there, often at an edge, and
    draws around that place shrink to the few that are right.
    """
    problem = candidate.problem
    for k in range(len(baseline.PARAMETERS), problem.n_physical):
        mode, curvature = candidate.modes[0], candidate.curvature[0]
        place = problem.parameters[k].prior_quantile((np.arange(_PLACES) + 0.5) / _PLACES)
        rows = np.repeat(mode[None], _PLACES, axis=0)
        rows[:, k] = place
        found = problem.predict(rows)
        height = heights(problem, rows, found, problem.observed)
        company = height > candidate.heights[0] - _COMPANY
        if candidate.slope[k].any():
            company &= np.abs(place - mode[k]) > _AWAY / math.sqrt(max(curvature[k, k], 1e-300))
        if not company.any():
            continue
        step = np.gradient(place)
        mass = np.where(company, np.exp(height - candidate.heights[0]) * step, 0.0)
        mass /= mass.sum()
        middle = int(np.argmin(np.where(company, np.abs(place - mass @ place), np.inf)))
        spread = float(mass @ ((place - place[middle]) ** 2 + step**2 / 12))
        apart, slope = curvature.copy(), candidate.slope.copy()
        apart[k], apart[:, k], slope[k] = 0.0, 0.0, 0.0
        apart[k, k] = 1.0 / spread
        candidate = replace(
            candidate,
            modes=np.vstack([rows[middle], candidate.modes]),
            heights=np.append(height[middle], candidate.heights),
            predicted=found[middle],
            slope=slope,
            curvature=np.concatenate([apart[None], candidate.curvature]),
        )
    return candidate


def _width(candidate: Candidate) -> FloatArray:
    return np.asarray(np.ptp(candidate.problem.bounds, axis=1))


# --- adaptive importance sampling -----------------------------------------------------------------------------------


class _Density(Protocol):
    """What can be drawn from, and evaluated."""

    @property
    def mixture(self) -> _Mixture:
        """Student densities that resemble it."""

    def draw(self, n: int, random: np.random.Generator) -> FloatArray: ...

    def log_density(self, u: FloatArray) -> FloatArray: ...


@dataclass(frozen=True, eq=False)
class _Pool:
    """Draws inside the bounds, with the log of the function and the log weights; `n` counts those outside, too."""

    u: FloatArray
    height: FloatArray
    log_weight: FloatArray
    n: int

    @classmethod
    def together(cls, pools: Sequence[_Pool]) -> _Pool:
        """Draws of regions that do not overlap, as draws of all of them."""
        n = sum(p.n for p in pools)
        weight = [p.log_weight + math.log(n / p.n) for p in pools]
        u, height = np.concatenate([p.u for p in pools]), np.concatenate([p.height for p in pools])
        return cls(u, height, np.concatenate(weight), n)

    @property
    def weights(self) -> FloatArray:
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def log_evidence(self) -> float:
        return float(logsumexp(self.log_weight) - math.log(self.n))

    @property
    def effective(self) -> float:
        return float(1 / np.sum(self.weights**2))

    def weighed(self) -> Weighed:
        weights, count = self.weights, self.effective
        finite = np.isfinite(self.log_weight)
        k_hat = store.pareto_k(self.log_weight[finite]) if finite.sum() > 25 else math.inf
        error = float(np.sqrt(max(1 / count - 1 / self.n, 0.0)))
        kept = weights > 0
        best = int(np.argmax(self.height))
        return Weighed(
            self.u[kept], weights[kept], self.log_evidence, error, count, k_hat, self.u[best], float(self.height[best])
        )  # fmt: skip


def _sample(
    height: Callable[[FloatArray], FloatArray],
    bounds: FloatArray,
    first: _Density,
    adapted: Callable[[_Pool, _Density], _Density],
    random: np.random.Generator,
    n_round: int,
    rounds: int,
    effective: float,
) -> _Pool:
    """Rounds of draws, each from what those before suggest; weights by the mixture of all."""
    proposals, rounds_of = [first], []  # and how many rounds' draws each of them has given
    u, h, n = np.empty((0, len(bounds))), np.empty(0), 0
    density = np.empty((0, 0))  # of every draw under every proposal
    while True:
        draws, drawn = _drawn_inside(proposals[-1], bounds, n_round, random)
        n += drawn
        rounds_of.append(drawn / n_round)
        density = np.vstack([density, proposals[-1].log_density(u)[None]]) if len(u) else np.empty((len(proposals), 0))
        density = np.hstack([density, [p.log_density(draws) for p in proposals]])
        u, h = np.concatenate([u, draws]), np.concatenate([h, height(draws)])
        share = np.array(rounds_of)[:, None]
        pool = _Pool(u, h, h - logsumexp(density, axis=0, b=share) + math.log(share.sum()), n)
        if len(proposals) == rounds or (len(proposals) >= _LEAST and pool.effective > effective):
            return pool
        proposals.append(adapted(pool, proposals[-1]))


def _drawn_inside(density: _Density, bounds: FloatArray, n: int, random: np.random.Generator) -> tuple[FloatArray, int]:
    """Draws inside the bounds, some at least, and how many were drawn for them.

    Of a mode in a corner, at the bounds of ten parameters, hardly one draw in a thousand is.
    """
    found, drawn = np.empty((0, len(bounds))), 0
    while len(found) < 2 * len(bounds) and drawn < _PATIENCE:
        draws = density.draw(max(n, min(drawn, _BLOCK)), random)  # as many again: they want powers of two
        drawn += len(draws)
        inside = ((draws >= bounds[:, 0]) & (draws <= bounds[:, 1])).all(axis=1)
        found = np.concatenate([found, draws[inside]])
    if not len(found):
        raise ConvergenceError("draws within the bounds around a mode", reached=0, required=1)
    return found, drawn


# --- mixtures of Student densities ----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Mixture:
    """Student densities: centres (k, d), lower roots of their scale matrices (k, d, d), shares (k,)."""

    centre: FloatArray
    root: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, parts: Sequence[tuple[FloatArray, FloatArray, float]]) -> _Mixture:
        """From (centre, covariance, weight)."""
        centre, covariance, weight = zip(*parts, strict=True)
        share = np.array(weight)
        return cls(np.array(centre), np.linalg.cholesky(np.array(covariance)), share / share.sum())

    @cached_property
    def inverse(self) -> FloatArray:
        return np.asarray(np.linalg.inv(self.root))

    @property
    def mixture(self) -> _Mixture:
        return self

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Quasi-random draws."""
        d = self.centre.shape[1]
        points = np.clip(qmc.Sobol(d + 2, rng=random).random(n), 1e-9, 1 - 1e-9)
        which = np.minimum(np.searchsorted(np.cumsum(self.share), points[:, 0]), len(self.share) - 1)
        normal = ndtri(points[:, 2:]) * np.sqrt(_TAILS / chi2.ppf(points[:, 1], _TAILS))[:, None]
        return np.asarray(self.centre[which] + (self.root[which] @ normal[:, :, None])[:, :, 0])

    def scatter(self, n: int, random: np.random.Generator) -> FloatArray:
        """Independent draws."""
        which = random.choice(len(self.share), n, p=self.share)
        normal = random.standard_normal((n, self.centre.shape[1]))
        normal /= np.sqrt(random.chisquare(_TAILS, (n, 1)) / _TAILS)
        return np.asarray(self.centre[which] + (self.root[which] @ normal[:, :, None])[:, :, 0])

    def log_density(self, u: FloatArray) -> FloatArray:
        parts = student_log_density(u, self.centre, self.inverse, _TAILS) + np.log(self.share)[:, None]
        return np.asarray(logsumexp(parts, axis=0))

    def around(self, pool: _Pool, width: FloatArray) -> _Mixture:
        """A mixture around a pool's draws: all of them, and the heaviest with their neighbours."""
        u, weights = pool.u, _tempered(pool.weights)
        d = u.shape[1]
        wider = (1 + _WIDER / d) ** 2
        mean, covariance = _moments(u, weights, width)
        parts = [(mean, covariance * wider, 1.0)]
        inverse = np.linalg.inv(covariance)
        left = weights.copy()
        for _ in range(3):
            offset = u - u[np.argmax(left)]
            near = np.sum((offset @ inverse) * offset, axis=1) < 0.5 * d
            share = float(weights[near].sum())
            if near.sum() > 4 * d and share > 0.02:
                centre, local = _moments(u[near], weights[near] / share, width)
                parts.append((centre, local * wider, share))
            left = np.where(near, 0.0, left)
            if not left.any():
                break
        old = [
            (c, r @ r.T, 0.1 * float(w)) for c, r, w in zip(self.centre, self.root, self.share, strict=True)
        ]  # fmt: skip
        return _Mixture.of([*parts, *old][:_MOST])


def student_log_density(u: FloatArray, centre: FloatArray, inverse: FloatArray, tails: float) -> FloatArray:
    """Log of several Student densities at the rows of `u`.

    Parameters
    ----------
    u : (n, d) array
    centre : (k, d) array
    inverse : (k, d, d) array
        Inverses of the lower roots of the scale matrices.
    tails : float
        Degrees of freedom.

    Returns
    -------
    (k, n) array
    """
    d = u.shape[1]
    z = inverse @ (u.T - centre[:, :, None])  # (k, d, n)
    constant = gammaln((tails + d) / 2) - gammaln(tails / 2) - 0.5 * d * math.log(tails * math.pi)
    constant = constant + np.log(np.diagonal(inverse, axis1=1, axis2=2)).sum(axis=1)
    return np.asarray(constant[:, None] - 0.5 * (tails + d) * np.log1p(np.square(z).sum(axis=1) / tails))


def _laplace_mixture(candidate: Candidate) -> _Mixture:
    """Student densities at the modes with the expected curvature."""
    width = _width(candidate)
    wider = (1 + _WIDER / candidate.problem.n_dim) ** 2
    covariance = np.linalg.inv(within_bounds(candidate.problem, candidate.curvature))
    masses = np.maximum(np.exp(candidate.heights - candidate.heights[0]), 0.02)
    return _Mixture.of(
        [
            (u, _positive(own, width) * wider, float(mass))
            for u, own, mass in zip(candidate.modes, covariance, masses, strict=True)
        ]
    )


def _tempered(weights: FloatArray) -> FloatArray:
    """Weights to a power at which some tens of draws count: a handful would collapse what is made of them."""
    power, result = 1.0, weights
    while 1 / np.sum(result**2) < min(60, 0.2 * len(weights)) and power > 0.05:
        power *= 0.8
        result = np.where(weights > 0, np.maximum(weights, 1e-300) ** power, 0.0)
        result /= result.sum()
    return result


def _moments(u: FloatArray, weights: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ u
    centred = u - mean
    return mean, _positive((centred * weights[:, None]).T @ centred + 1e-9 * np.diag(width**2), width)


def _positive(covariance: FloatArray, width: FloatArray) -> FloatArray:
    """Covariance with no direction wider than the bounds and none without any width."""
    scale = width / 3
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    clipped = (vectors * np.clip(values, 1e-10, 1.0)) @ vectors.T
    return np.asarray(clipped * np.outer(scale, scale))


def _powers(n: int, n_draws: int) -> list[tuple[int, ...]]:
    """Monomials in so many variables, as the indices of their factors, of the highest degree that the draws allow."""
    found: list[tuple[int, ...]] = []
    for degree in range(len(_FREEDOM)):
        more = list(itertools.combinations_with_replacement(range(n), degree))
        if degree > 2 and _DRAWS_PER_COEFFICIENT * (len(found) + len(more)) > n_draws:
            break
        found += more
    return found


# --- the emulated posterior -----------------------------------------------------------------------------------------


class Emulated:
    """The posterior of a model whose launch ranges are polynomials in its parameters, fitted to simulated draws.

    Ranges are emulated in the coordinate in which the fitted scatter has unit width, so that all readings have equal
    rights and none becomes negative. Linear terms start from the slopes at the mode; what the draws do not tell stays
    there.
    """

    def __init__(
        self, candidate: Candidate, pool: _Pool, simulated: FloatArray, before: _Mixture, random: np.random.Generator
    ) -> None:
        problem = candidate.problem
        self._problem = problem
        k = problem.n_model
        self._relative, self._absolute = problem.noise_values(candidate.modes[:1])[0, :2]
        self._mean, covariance = _moments(pool.u, _tempered(pool.weights), _width(candidate))
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance[:k, :k]))
        # Known beforehand: the mode, and the slopes there.
        mode = candidate.modes[0, :k]
        here = self._scaled(candidate.predicted)
        slope = candidate.slope / np.hypot(self._absolute, self._relative * candidate.predicted)
        unwhiten = np.linalg.inv(self._whiten)
        self._powers = _powers(k, len(pool.u))
        column = {p: i for i, p in enumerate(self._powers)}
        self._products = [(column[p[:-1]], p[-1]) for p in self._powers[1:]]
        start = np.zeros((len(self._powers), here.size))
        start[1 : 1 + k] = unwhiten.T @ slope
        start[0] = here + (self._mean[:k] - mode) @ slope
        # Far from the posterior nothing need be right.
        usable = np.isfinite(pool.height)
        depth = (pool.height[usable].max() - pool.height[usable]) / (_NEAR * problem.n_dim)
        weight = 1 / (1 + depth**2)
        # ... and one draw that is far above all others is no width: then what the mixture has stands for one.
        self._reach = max(_BEYOND * float(self._distance(pool.u[usable, :k])[depth < 1].max()), 1.0)
        features = np.vstack([self._features(pool.u[usable, :k]), self._features(mode[None])])
        target = np.vstack([self._scaled(simulated[usable]), here]) - features @ start
        root = np.sqrt(np.append(weight, 1.0))[:, None]
        scale = _FREEDOM[[len(p) for p in self._powers]]
        # Ridge: each coefficient may differ from what was known by about `scale`, each draw from the polynomial by a
        # tenth of the scatter.
        a = np.vstack([root * features * scale, 0.1 * np.eye(scale.size)])
        y = np.vstack([root * target, np.zeros_like(start)])
        self._coefficients = start + scale[:, None] * np.linalg.lstsq(a, y, rcond=None)[0]
        self._jump = np.linalg.cholesky(covariance) * (_JUMP / math.sqrt(problem.n_dim))
        width = _width(candidate)
        first = before.around(pool, width)

        def wider(found: _Pool, last: _Density) -> _Density:
            return last.mixture.around(found, width)

        self._simulated = pool
        self._pool = _sample(
            self._height, problem.bounds, first, wider, random, _ROUND_EMULATED, _ROUNDS_EMULATED, _EFFECTIVE_EMULATED
        )
        self.mixture = first.around(self._pool, width)

    def scattered(self, n: int, random: np.random.Generator | np.random.RandomState) -> FloatArray:
        """Simulated draws to begin a chain from, each once, by weights to a power at which some tens of them count.

        Fewer where there are not so many. They are spread like the posterior around the modes known, and wider where
        the emulator is poor.
        """
        weights = _tempered(self._simulated.weights)
        # Without replacement: the greatest of log weights with Gumbel's noise.
        with np.errstate(divide="ignore"):
            key = np.log(weights) + random.gumbel(size=weights.size)
        key[~np.isfinite(self._simulated.height)] = -np.inf
        chosen = np.argsort(-key, kind="stable")[:n]
        return self._simulated.u[chosen[np.isfinite(key[chosen])]]

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draws, some of them from a mixture of Student densities instead."""
        careful = round(_CAUTION * n)
        chosen = _systematic(self._pool.weights, n - careful, random.uniform())
        return np.concatenate([self._pool.u[chosen], self.mixture.draw(careful, random)])

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log density of such draws."""
        own = math.log1p(-_CAUTION) + self._height(u) - self._pool.log_evidence
        return np.logaddexp(own, math.log(_CAUTION) + self.mixture.log_density(u))

    def wander(self, u: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Take a few Metropolis steps in the emulated posterior from each row of `u`.

        The steps are reversible in it, so that the end is accepted as a step in the posterior `p` with probability
        ``p(u') q(u) / p(u) q(u')``, where `q` is the emulated density (J. S. Liu, Monte Carlo Strategies in Scientific
        Computing, Springer 2001, section 9.4.3: the surrogate transition method). Whatever the emulator is worth, the
        chain is exact.

        Parameters
        ----------
        u : (n, n_dim) array
        random : Generator

        Returns
        -------
        (n, n_dim) array and (n,) array
            Where the steps end, and ``ln q(u) - ln q(u')``.
        """
        here, height = u, self._height(u)
        begun = height
        n, d = u.shape
        for _ in range(random.choice(_STRIDES)):
            # One kind of step for all, chosen by chance: a fixed order of kinds would not be reversible.
            if random.uniform() < 0.5:
                there = here + random.standard_normal((n, d)) @ self._jump.T
                ratio = np.zeros(n)
            else:
                there = self.mixture.scatter(n, random)
                ratio = self.mixture.log_density(here) - self.mixture.log_density(there)
            found = self._height(there)
            with np.errstate(invalid="ignore"):
                accepted = np.log(random.uniform(size=n)) < found - height + ratio
            here, height = np.where(accepted[:, None], there, here), np.where(accepted, found, height)
        with np.errstate(invalid="ignore"):
            gone = begun - height
        return here, np.where(np.isnan(gone), -np.inf, gone)

    def _scaled(self, ranges: FloatArray) -> FloatArray:
        return np.asarray(np.arcsinh(ranges * (self._relative / self._absolute)) / self._relative)

    def _features(self, u: FloatArray) -> FloatArray:
        x = (u - self._mean[: u.shape[1]]) @ self._whiten.T
        # Beyond the draws ranges stay as they are at their edge: no polynomial is to be trusted there.
        x *= np.minimum(1.0, self._reach / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300))
        result = np.empty((len(x), len(self._powers)))
        result[:, 0] = 1.0
        for column, (shorter, last) in enumerate(self._products, start=1):
            np.multiply(result[:, shorter], x[:, last], out=result[:, column])
        return result

    def _distance(self, u: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm((u - self._mean[: u.shape[1]]) @ self._whiten.T, axis=1))

    def _height(self, u: FloatArray) -> FloatArray:
        """Log posterior of the emulated model, less what distrusts it far out; minus infinity outside the bounds."""
        k = self._problem.n_model
        result = np.full(len(u), -np.inf)
        for part in np.array_split(np.arange(len(u)), max(len(u) // 1024, 1)):
            scaled = self._features(u[part, :k]) @ self._coefficients
            ranges = np.sinh(np.clip(scaled * self._relative, -30, 30)) * (self._absolute / self._relative)
            result[part] = heights(self._problem, u[part], np.maximum(ranges, 0.0), self._problem.observed)
        far = np.maximum(self._distance(u[:, :k]) / self._reach - 1, 0.0)
        return result - _DISTRUST * far**2

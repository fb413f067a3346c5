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
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference import store
from psafit.inference.candidate import Candidate, candidate_at, places_along, separate_modes
from psafit.inference.mixture import StudentMixture, moments, positive, tempered, widening
from psafit.inference.optimiser import log_posteriors
from psafit.inference.problem import Problem
from psafit.physics import baseline

TRUSTED = 0.7
"""Pareto's k up to which importance sampling is trusted (A. Vehtari et al., J. Mach. Learn. Res. 25 (2024) 72)."""

_Density: TypeAlias = "StudentMixture | Emulated"


@dataclass(frozen=True)
class RoundSettings:
    """How rounds of importance sampling go on.

    Parameters
    ----------
    draws : int
        Of a round.
    least, most : int
        Rounds: at least, for the first proposals may not know all of a bent posterior yet, and at most.
    effective, tail : float
        Effective draws at which it is enough, where Pareto's k of the weights is below `tail`, too.
    """

    draws: int = 128
    least: int = 4
    most: int = 24
    effective: float = 150.0
    tail: float = TRUSTED

    def enough(self, pool: Pool) -> bool:
        """Whether draws in a pool need no further round."""
        return pool.effective > self.effective and (math.isinf(self.tail) or pool.pareto_k < self.tail)


@dataclass(frozen=True)
class EmulatorSettings:
    """How an emulated posterior is made, and how far it is believed.

    Parameters
    ----------
    rounds : RoundSettings
        By which it is sampled.
    caution : float
        Share of the draws that do not come from it, for its tails may be too light. (A quarter of a power of two is
        one, as quasi-random draws want.)
    near : float, nats
        Draws that inform it most lie this many per dimension below the best.
    freedom : tuple of float
        What its coefficients of each degree, in the whitened coordinate and in units of the scatter, may differ by
        from what was known.
    draws_per_coefficient : float
        Draws wanted for each of them in degrees above two.
    beyond : float
        It is not believed further out than so many times its better draws.
    distrust : float, nats
        Lost at twice that distance.
    """

    rounds: RoundSettings = RoundSettings(draws=2048, least=2, most=10, effective=800.0, tail=math.inf)
    caution: float = 0.25
    near: float = 1.5
    freedom: tuple[float, ...] = (10.0, 3.0, 1.0, 0.3, 0.1)
    draws_per_coefficient: float = 5.0
    beyond: float = 1.2
    distrust: float = 20.0


@dataclass(frozen=True, eq=False)
class ImportanceSample:
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
    log_posterior : float
        Its log posterior.
    """

    draws: FloatArray
    weights: FloatArray
    log_evidence: float
    error: float
    effective: float
    pareto_k: float
    top: FloatArray
    log_posterior: float

    @property
    def standard_error(self) -> float:
        """Standard error of the log evidence; nats where the weights' tail makes that error meaningless."""
        return self.judged_error()

    def judged_error(self, *, few: float = 30.0, begun: float = 2.0, hardly: float = 5.0) -> float:
        """Standard error of the log evidence, nats.

        Parameters
        ----------
        few : float
            Effective draws below which importance sampling has hardly begun.
        begun, hardly : float, nats
            What an evidence may be off by where the weights' tail makes the usual error meaningless, with more
            effective draws and with fewer: seen in longer runs.
        """
        if self.pareto_k < TRUSTED:
            return self.error
        return max(self.error, hardly if self.effective < few else begun)

    def quantiles(self, values: FloatArray, q: Sequence[float]) -> FloatArray:
        """Weighted quantiles of `values` (n, ...) along the first axis; (len(q), ...)."""
        return quantiles(values, self.weights, q)

    def resampled(self, n: int) -> FloatArray:
        """Equally weighted draws, by systematic resampling; (n, n_dim)."""
        return self.draws[systematic(self.weights, n)]

    def distinct(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draws, each once, by weights to a power at which some tens of them count; (n, n_dim).

        Spread as the posterior is, and wider where few draws count. From the first again where there are not so many.
        """
        # What resampling has left several times is one draw with the weight of all.
        _, first, of = np.unique(self.draws, axis=0, return_index=True, return_inverse=True)
        weights = np.asarray(np.bincount(of.ravel(), self.weights), float)[np.argsort(first)]
        with np.errstate(divide="ignore"):
            key = np.log(tempered(weights)) + random.gumbel(size=weights.size)
        return self.draws[np.sort(first)][np.resize(np.argsort(-key, kind="stable"), n)]

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


def systematic(weights: FloatArray, n: int, first: float = 0.5) -> NDArray[np.intp]:
    """Rows of weighted draws for `n` equally weighted ones, by systematic resampling."""
    positions = (np.arange(n) + first) / n
    return np.minimum(np.searchsorted(np.cumsum(weights), positions), len(weights) - 1)


def importance_sample(
    candidate: Candidate, *, seed: int, rounds: int = RoundSettings.most, effective: float = RoundSettings.effective
) -> ImportanceSample:
    """Evidence and posterior of a fitted model.

    Modes of the posterior that lie apart are sampled one by one, each where it is the nearest, and added: no polynomial
    emulates two.

    Parameters
    ----------
    candidate : Candidate
    seed : int
    rounds : int
        At most so many on each mode, each of `RoundSettings.draws` simulated draws.
    effective : float
        Effective draws at which it is enough.
    """
    random, how = np.random.default_rng([seed, 5]), RoundSettings(most=rounds, effective=effective)
    parts, nearest = separated(candidate)

    def drawn(k: int) -> Pool:
        mode = on_plateaus(parts[k])

        def emulated(pool: Pool, simulated: FloatArray, before: _Density) -> _Density:
            return Emulated(mode, pool, simulated, before.mixture, random)

        first = laplace_mixture(mode)
        return simulated_in_rounds(mode.problem, first, emulated, random, how, lambda u: nearest(u) == k)[0]

    return Pool.together([drawn(k) for k in range(len(parts))]).sample()


def separated(candidate: Candidate) -> tuple[list[Candidate], Callable[[FloatArray], NDArray[np.intp]]]:
    """The model on each of its modes, and which of them is nearest to rows of coordinates.

    Nearest is the one whose density is the highest. Whatever these regions are worth, they leave out nothing and count
    nothing twice.
    """
    tops = separate_modes(candidate)
    if len(tops) == 1:
        return [candidate], lambda u: np.zeros(len(u), np.intp)
    known = laplace_mixture(candidate)

    def nearest(u: FloatArray) -> NDArray[np.intp]:
        return np.asarray(np.argmax(known.each(u)[tops], axis=0))

    own = nearest(candidate.modes)
    own[tops] = np.arange(len(tops))
    return [candidate_at(candidate.problem, candidate.modes[own == k]) for k in range(len(tops))], nearest


def on_plateaus(candidate: Candidate, *, places: int = 32, company: float = 4.0, away: float = 4.0) -> Candidate:
    """Move the best mode to the middle of where a parameter may lie, if its curvature does not say how wide that is.

    What acts by thresholds changes nothing between two of them. An optimisation ends anywhere there, often at an edge,
    and draws around that place shrink to the few that are right.

    Parameters
    ----------
    candidate : Candidate
    places : int
        At which each parameter of a cause is looked at over its prior, as well as at those of `places_along` the mode.
    company : float, nats
        Below the mode, within which it has company there.
    away : float
        Of what lies so many widths away the curvature says nothing.
    """
    problem = candidate.problem
    for k in range(len(baseline.PARAMETERS), problem.n_physical):
        mode, curvature = candidate.modes[0], candidate.curvature[0]
        evenly = problem.parameters[k].prior_quantile((np.arange(places) + 0.5) / places)
        place = np.unique([*evenly, *places_along(problem, mode, k)])
        rows = np.repeat(mode[None], place.size, axis=0)
        rows[:, k] = place
        found = problem.predict(rows)
        log_posterior = log_posteriors(problem, rows, found, problem.observed)
        near = log_posterior > candidate.log_posteriors[0] - company
        if candidate.slope[k].any():
            near &= np.abs(place - mode[k]) > away / math.sqrt(max(curvature[k, k], 1e-300))
        if not near.any():
            continue
        step = np.gradient(place)
        mass = np.where(near, np.exp(log_posterior - candidate.log_posteriors[0]) * step, 0.0)
        mass /= mass.sum()
        middle = int(np.argmin(np.where(near, np.abs(place - mass @ place), np.inf)))
        spread = float(mass @ ((place - place[middle]) ** 2 + step**2 / 12))
        apart, slope = curvature.copy(), candidate.slope.copy()
        apart[k], apart[:, k], slope[k] = 0.0, 0.0, 0.0
        apart[k, k] = 1.0 / spread
        candidate = replace(
            candidate,
            modes=np.vstack([rows[middle], candidate.modes]),
            log_posteriors=np.append(log_posterior[middle], candidate.log_posteriors),
            predicted=found[middle],
            slope=slope,
            curvature=np.concatenate([apart[None], candidate.curvature]),
            log_width=np.vstack(
                [np.where(np.arange(len(mode)) == k, np.nan, candidate.log_width[0]), candidate.log_width]
            ),
            mass=np.append(candidate.mass[0], candidate.mass),
            starts=np.append(0, candidate.starts),
        )
    return candidate


# --- adaptive importance sampling -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Pool:
    """Draws inside the bounds, with the log of the function and the log weights; `n` counts those outside, too.

    `unsure` is the standard error of the log evidence by the norms of the densities that they were drawn from.
    """

    u: FloatArray
    log_posterior: FloatArray
    log_weight: FloatArray
    n: int
    unsure: float = 0.0

    @classmethod
    def together(cls, pools: Sequence[Pool]) -> Pool:
        """Draws of regions that do not overlap, as draws of all of them."""
        n = sum(p.n for p in pools)
        weight = [p.log_weight + math.log(n / p.n) for p in pools]
        u, log_posterior = np.concatenate([p.u for p in pools]), np.concatenate([p.log_posterior for p in pools])
        mass = softmax([p.log_evidence for p in pools])
        return cls(u, log_posterior, np.concatenate(weight), n, float(np.linalg.norm(mass * [p.unsure for p in pools])))

    @property
    def weights(self) -> FloatArray:
        """Normalised weights of the draws."""
        return np.asarray(np.exp(self.log_weight - logsumexp(self.log_weight)))

    @property
    def log_evidence(self) -> float:
        """Natural logarithm of the function's integral."""
        return float(logsumexp(self.log_weight) - math.log(self.n))

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return float(1 / np.sum(self.weights**2))

    @property
    def pareto_k(self) -> float:
        """Shape of the weights' tail."""
        finite = np.isfinite(self.log_weight)
        return store.pareto_k(self.log_weight[finite]) if finite.sum() > 25 else math.inf

    @property
    def error(self) -> float:
        """Standard error of the log evidence."""
        return math.hypot(math.sqrt(max(1 / self.effective - 1 / self.n, 0.0)), self.unsure)

    def sample(self) -> ImportanceSample:
        """The draws of any weight, and the evidence."""
        weights, count, error = self.weights, self.effective, self.error
        kept = weights > 0
        best = int(np.argmax(self.log_posterior))
        top = float(self.log_posterior[best])
        return ImportanceSample(
            self.u[kept], weights[kept], self.log_evidence, error, count, self.pareto_k, self.u[best], top
        )


def sample_in_rounds(
    log_posterior: Callable[[FloatArray], FloatArray],
    bounds: FloatArray,
    first: _Density,
    adapted: Callable[[Pool, _Density], _Density],
    random: np.random.Generator,
    how: RoundSettings,
) -> Pool:
    """Rounds of draws, each from what those before suggest; weights by the mixture of all."""
    proposals, rounds_of = [first], []  # and how many rounds' draws each of them has given
    u, h, n = np.empty((0, len(bounds))), np.empty(0), 0
    density = np.empty((0, 0))  # of every draw under every proposal
    while True:
        draws, drawn = drawn_inside(proposals[-1], bounds, how.draws, random)
        n += drawn
        rounds_of.append(drawn / how.draws)
        density = np.vstack([density, proposals[-1].log_density(u)[None]]) if len(u) else np.empty((len(proposals), 0))
        density = np.hstack([density, [p.log_density(draws) for p in proposals]])
        u, h = np.concatenate([u, draws]), np.concatenate([h, log_posterior(draws)])
        share = np.array(rounds_of)[:, None]
        both = logsumexp(density, axis=0, b=share)
        pool = Pool(u, h, h - both + math.log(share.sum()), n)
        if len(proposals) == how.most or (len(proposals) >= how.least and how.enough(pool)):
            # What each proposal accounts for of the evidence is off by as much as its density is.
            part = (share * np.exp(density - both)) @ pool.weights
            return replace(pool, unsure=float(np.linalg.norm(part * [p.error for p in proposals])))
        proposals.append(adapted(pool, proposals[-1]))


def simulated_in_rounds(
    problem: Problem,
    first: _Density,
    adapted: Callable[[Pool, FloatArray, _Density], _Density],
    random: np.random.Generator,
    how: RoundSettings,
    region: Callable[[FloatArray], NDArray[np.bool_]] = lambda u: np.ones(len(u), bool),
) -> tuple[Pool, FloatArray]:
    """Rounds of draws of a posterior, with what they predict, which `adapted` sees, too.

    What lies outside the region has no weight.
    """
    simulated: list[FloatArray] = []

    def log_posterior(u: FloatArray) -> FloatArray:
        found = problem.predict(u)
        simulated.append(found)
        return np.where(region(u), log_posteriors(problem, u, found, problem.observed), -np.inf)

    def next_one(pool: Pool, before: _Density) -> _Density:
        return adapted(pool, np.concatenate(simulated), before)

    pool = sample_in_rounds(log_posterior, problem.bounds, first, next_one, random, how)
    return pool, np.concatenate(simulated)


def drawn_about(candidate: Candidate, random: np.random.Generator, how: RoundSettings) -> tuple[Pool, FloatArray]:
    """Draws of a fitted model's posterior, with what they predict.

    From Student densities at the modes, then about the draws before, weighted by the posterior.
    """
    problem = candidate.problem

    def about(pool: Pool, simulated: FloatArray, before: _Density) -> _Density:
        return before.mixture.around(pool.u, pool.weights, problem.widths)

    return simulated_in_rounds(problem, laplace_mixture(candidate), about, random, how)


def drawn_inside(
    density: _Density,
    bounds: FloatArray,
    n: int,
    random: np.random.Generator,
    patience: int = 1 << 18,
    block: int = 1 << 13,
) -> tuple[FloatArray, int]:
    """Draws inside the bounds, some at least, and how many were drawn for them.

    Of a mode in a corner, at the bounds of ten parameters, hardly one draw in a thousand is. They are made a `block` at
    a time, and given up after `patience`.
    """
    found, drawn = np.empty((0, len(bounds))), 0
    while len(found) < 2 * len(bounds) and drawn < patience:
        draws = density.draw(max(n, min(drawn, block)), random)  # as many again: they want powers of two
        drawn += len(draws)
        inside = ((draws >= bounds[:, 0]) & (draws <= bounds[:, 1])).all(axis=1)
        found = np.concatenate([found, draws[inside]])
    if not len(found):
        raise ConvergenceError("draws within the bounds around a mode", reached=0, required=1)
    return found, drawn


def laplace_mixture(candidate: Candidate) -> StudentMixture:
    """Student densities at the modes with Laplace's widths, each with what its normal density holds.

    A high and narrow mode may hold less than one that is several nats lower. Laplace's approximation may be off by
    nats: no mode gets less than 2 % of the greatest.
    """
    width, wider = candidate.problem.widths, widening(candidate.problem.n_dim)
    covariance = [positive(own, width) for own in candidate.covariance]
    log_share = candidate.log_posteriors + 0.5 * np.linalg.slogdet(covariance)[1]
    share = np.maximum(np.exp(log_share - log_share.max()), 0.02).tolist()
    return StudentMixture.of(list(zip(candidate.modes, np.array(covariance) * wider, share, strict=True)))


def _powers(n: int, n_draws: int, how: EmulatorSettings) -> list[tuple[int, ...]]:
    """Monomials in so many variables, as the indices of their factors, of the highest degree that the draws allow."""
    found: list[tuple[int, ...]] = []
    for degree in range(len(how.freedom)):
        more = list(itertools.combinations_with_replacement(range(n), degree))
        if degree > 2 and how.draws_per_coefficient * (len(found) + len(more)) > n_draws:
            break
        found += more
    return found


# --- the emulated posterior -----------------------------------------------------------------------------------------


class Emulated:
    """The posterior of a model whose launch ranges are polynomials in its parameters, fitted to simulated draws.

    Ranges are emulated in the coordinate in which the fitted scatter has unit width, so that all readings have equal
    rights and none becomes negative. Linear terms start from the slopes at the mode; what the draws do not determine
    stays there.
    """

    def __init__(
        self,
        candidate: Candidate,
        pool: Pool,
        simulated: FloatArray,
        before: StudentMixture,
        random: np.random.Generator,
    ) -> None:
        self._how = how = EmulatorSettings()
        problem = candidate.problem
        self._problem = problem
        k = problem.n_model
        self._relative, self._absolute = problem.noise_values(candidate.modes[:1])[0, :2]
        self._mean, covariance = moments(pool.u, tempered(pool.weights), candidate.problem.widths)
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance[:k, :k]))
        # Known beforehand: the mode, and the slopes there.
        mode = candidate.modes[0, :k]
        here = self._scaled(candidate.predicted)
        slope = candidate.slope / np.hypot(self._absolute, self._relative * candidate.predicted)
        unwhiten = np.linalg.inv(self._whiten)
        self._powers = _powers(k, len(pool.u), how)
        column = {p: i for i, p in enumerate(self._powers)}
        self._products = [(column[p[:-1]], p[-1]) for p in self._powers[1:]]
        start = np.zeros((len(self._powers), here.size))
        start[1 : 1 + k] = unwhiten.T @ slope
        start[0] = here + (self._mean[:k] - mode) @ slope
        # Far from the posterior nothing need be right.
        usable = np.isfinite(pool.log_posterior)
        depth = (pool.log_posterior[usable].max() - pool.log_posterior[usable]) / (how.near * problem.n_dim)
        weight = 1 / (1 + depth**2)
        # A single dominant draw gives no scale: then it is one, the scale of the draws' own covariance.
        self._reach = max(how.beyond * float(self._distance(pool.u[usable, :k])[depth < 1].max()), 1.0)
        features = np.vstack([self._features(pool.u[usable, :k]), self._features(mode[None])])
        target = np.vstack([self._scaled(simulated[usable]), here]) - features @ start
        root = np.sqrt(np.append(weight, 1.0))[:, None]
        scale = np.array(how.freedom)[[len(p) for p in self._powers]]
        # Ridge: each coefficient may differ from what was known by about `scale`, each draw from the polynomial by a
        # tenth of the scatter.
        a = np.vstack([root * features * scale, 0.1 * np.eye(scale.size)])
        y = np.vstack([root * target, np.zeros_like(start)])
        self._coefficients = start + scale[:, None] * np.linalg.lstsq(a, y, rcond=None)[0]
        width = candidate.problem.widths
        first = before.around(pool.u, pool.weights, width)

        def wider(found: Pool, last: _Density) -> _Density:
            return last.mixture.around(found.u, found.weights, width)

        self._pool = sample_in_rounds(self.log_posterior, problem.bounds, first, wider, random, how.rounds)
        self.mixture = first.around(self._pool.u, self._pool.weights, width).stretched(k, width)

    @cached_property
    def log_evidence(self) -> float:
        """Log evidence of the emulated posterior."""
        return self._pool.log_evidence

    @property
    def error(self) -> float:
        """Standard error of the log norm of its draws' density; that of the Student densities among them is known."""
        return (1 - self._how.caution) * self._pool.error

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draws, some of them from a mixture of Student densities instead."""
        careful = round(self._how.caution * n)
        return np.concatenate([self.resampled(n - careful, random), self.mixture.draw(careful, random)])

    def resampled(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draws of the emulated posterior alone, one of them several times where its weight is large."""
        return np.asarray(self._pool.u[systematic(self._pool.weights, n, random.uniform())])

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log density of such draws."""
        own = math.log1p(-self._how.caution) + self.log_posterior(u) - self.log_evidence
        return np.logaddexp(own, math.log(self._how.caution) + self.mixture.log_density(u))

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

    def log_posterior(self, u: FloatArray) -> FloatArray:
        """Log posterior of the emulated model, less what distrusts it far out; minus infinity outside the bounds."""
        k = self._problem.n_model
        result = np.full(len(u), -np.inf)
        for part in np.array_split(np.arange(len(u)), max(len(u) // 1024, 1)):
            scaled = self._features(u[part, :k]) @ self._coefficients
            ranges = np.sinh(np.clip(scaled * self._relative, -30, 30)) * (self._absolute / self._relative)
            result[part] = log_posteriors(
                self._problem, u[part], np.maximum(ranges, self._problem.floor), self._problem.observed
            )
        far = np.maximum(self._distance(u[:, :k]) / self._reach - 1, 0.0)
        return result - self._how.distrust * far**2

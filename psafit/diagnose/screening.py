r"""What each cause could add to a fitted model: score tests at finite strengths, by expansion of the fit.

At quantiles :math:`q` of a cause's prior its launch ranges are simulated at the fitted parameters; everything else,
scatter included, is then refitted in the expansion of the model, which costs no simulation. The gains :math:`\Delta_q`
in log posterior give the three answers of a score test at once: the best of them the statistic, the place where it lies
the expected strength, and their mean over the prior,

.. math:: B \approx \sum_q w_q e^{\Delta_q},

the evidence that the cause would add, where :math:`w_q` is the part of the prior that is nearest to :math:`q`; the
neutral value, which gains nothing, is one of them. Where gains change steeply, quantiles between are tried, too. How
much of the statistic is luck is simulated: scatter alone, standard normal in units of the fitted one and without what a
refit takes up, is put before the same effects, and `chance` is what one in twenty such readings gains. No table would
do, since a strength ends at its neutral value, and what acts in several shapes has more luck.

The page reports these numbers: what each cause would gain, and whether it could have been seen. The search does not use
them, since an expansion is blind to what lies behind another parameter that has taken a cause's place.

Slopes at the neutral value would not do: that of :math:`\sqrt{L^2+b^2}` is zero there, others are infinite, and a
boundary makes the law of the usual statistic a mixture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.optimiser import maximise_linearly
from psafit.inference.problem import Problem
from psafit.parameters import Parameter
from psafit.physics.term import Term
from psafit.simulate.sensitivity import plausible

# Gain (nats) from which a cause counts as explaining part of the misfit alone, if luck does not gain as much: ln 20,
# odds of twenty to one.
PRESENT = 3.0


@dataclass(frozen=True)
class ScreenSettings:
    """Which strengths of a cause are tried, and against how much luck.

    Parameters
    ----------
    quantiles : tuple of float
        Strengths tried first, as quantiles of the prior.
    iterations : int
        Of a refit in the expansion.
    steep, promising : float, nats
        Between quantiles whose gains differ by more than `steep`, the better of them within `promising` of the best,
        another one is tried: a cause that acts by thresholds helps in a narrow range only.
    halvings, most_halved : int
        Rounds of such trials, and trials in each.
    n_simulated : int
        Readings of scatter alone.
    chance : float
        How often they may gain as much as `Screened.chance`.
    """

    quantiles: tuple[float, ...] = (0.02, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.98)
    iterations: int = 12
    steep: float = 3.0
    promising: float = 15.0
    halvings: int = 9
    most_halved: int = 3
    n_simulated: int = 400
    chance: float = 0.05


@dataclass(frozen=True, eq=False)
class Screened:
    """What one cause could add to a fitted model.

    Parameters
    ----------
    term : Term
    strength : (n,) array
        Values tried, in the parameter's unit.
    gain : (n,) array, nats
        Of the log posterior, after a refit in the expansion; the strength's own prior is left out.
    log_bayes : float
        Evidence it would add.
    chance : float, nats
        What scatter alone gains once in twenty times.
    visible : float
        Size of the effect of a plausible strength (the prior's median) after a refit of everything else, in standard
        deviations of the fitted scatter. Where sessions have values of their own, its root mean square over these.
    """

    term: Term
    strength: FloatArray
    gain: FloatArray
    log_bayes: float
    chance: float
    visible: float

    @property
    def best(self) -> int:
        """Index of the most promising strength."""
        return int(np.argmax(self.gain))


def extended(problem: Problem, term: Term, catalogue: Sequence[Term]) -> Problem:
    """The problem with one more cause, in the catalogue's order: the same model whichever cause came first."""
    return replace(problem, terms=tuple(t for t in catalogue if t in (*problem.terms, term)))


def screen(candidate: Candidate, catalogue: Sequence[Term]) -> list[Screened]:
    """Screen the causes that a fitted model does not have yet, in the catalogue's order."""
    settings = ScreenSettings()
    # A fit may stop at a discontinuity, where its expansion still rises whatever the cause. So gains are measured from
    # the expansion's own optimum.
    alone = maximise_linearly(
        candidate.problem, candidate.modes[:1], candidate.predicted[None], candidate.relative_slope,
        iterations=settings.iterations,
    )  # fmt: skip
    top = float(alone.log_posterior[0])
    white = np.random.default_rng(0).standard_normal((settings.n_simulated, candidate.predicted.size))
    nothing = candidate.project_out(candidate.scatter * noise.correlated(white, candidate.noise))
    return [_screen(candidate, top, nothing, term, catalogue) for term in catalogue if term not in candidate.terms]


def _screen(candidate: Candidate, top: float, nothing: FloatArray, term: Term, catalogue: Sequence[Term]) -> Screened:
    """One cause added to a model whose own expansion ends at a log posterior `top`; `nothing` is simulated scatter."""
    settings, large = ScreenSettings(), extended(candidate.problem, term, catalogue)
    at, shared = candidate.within(large)
    own = [large.names.index(p.name) for p in term.parameters]
    latent = [i for i in range(large.n_dim) if i not in own and i not in shared]
    neutral = float(sum(large.parameters[i].log_prior(at[i]) for i in latent))
    luck = np.zeros(len(nothing))
    traced = large.design.traced
    least = np.where(traced, -np.inf, 1e-9)

    def predicted(rows: FloatArray) -> FloatArray:
        """Readings at some places, and with each latent a tenth of its prior further; (1 + n_latent, n, n_points)."""
        found = large.predict(np.vstack([rows, *(rows + 0.1 * np.eye(large.n_dim)[i] for i in latent)]))
        return np.maximum(found.reshape(1 + len(latent), len(rows), -1), least)

    def changes(found: FloatArray) -> list[FloatArray]:
        """What a refit does not take up: of the whole, and for each latent of as much as its prior is wide."""
        moved = [candidate.project_out((one - found[0]) / 0.1) for one in found[1:]]
        return [candidate.project_out(found[0] - candidate.predicted), *moved]

    def refitted(quantiles: FloatArray) -> FloatArray:
        """Gain in log posterior, nats, of refits at these quantiles of the strength."""
        rows = np.repeat(at[None, :], len(quantiles), axis=0)
        rows[:, own[0]] = term.strength.prior_quantile(quantiles)
        found = predicted(rows)
        slope = np.zeros((len(rows), large.n_model, found.shape[2]))
        slope[:, shared[: candidate.problem.n_model]] = candidate.relative_slope
        for k, i in enumerate(latent, start=1):
            slope[:, i] = (found[k] - found[0]) / (0.1 * np.where(traced, 1.0, found[0]))
        effect, *moved = changes(found)
        np.maximum(luck, gains_by_luck(effect, moved, nothing), out=luck)
        end = maximise_linearly(large, rows, found[0], slope, frozen=own, iterations=settings.iterations)
        # The cause's own prior is not a gain or loss here; that of its latents is.
        prior = np.sum([p.log_prior(end.u[:, i]) for p, i in zip(term.parameters, own, strict=True)], axis=0)
        gain = end.log_posterior - prior - neutral - top
        return np.where(np.isfinite(gain), gain, -1e3)

    q = np.array(settings.quantiles)
    gain = refitted(q)
    for _ in range(settings.halvings):
        between = unclear_strengths(*with_neutral(term.strength, q, gain))
        if not between.size:
            break
        more = refitted(between)
        order = np.argsort(np.concatenate([q, between]))
        q, gain = np.concatenate([q, between])[order], np.concatenate([gain, more])[order]
    # Each quantile stands for what is nearer to it than to its neighbours.
    places, gains = with_neutral(term.strength, q, gain)
    share = np.diff(np.concatenate([[0.0], 0.5 * (places[1:] + places[:-1]), [1.0]]))
    # Never quite neutral: a path that changes there would be another model.
    shown = at.copy()
    shown[own] = [p.to_sampling(v) for p, v in zip(term.parameters, plausible(term), strict=True)]
    return Screened(
        term=term,
        strength=term.strength.to_physical(term.strength.prior_quantile(q)),
        gain=gain,
        log_bayes=float(logsumexp(gains, b=share)),
        chance=float(np.quantile(luck, 1 - settings.chance)),
        visible=float(np.linalg.norm(changes(predicted(shown[None, :])))),
    )


def gains_by_luck(effects: FloatArray, moved: Sequence[FloatArray], nothing: FloatArray) -> FloatArray:
    """What scatter alone gains by the best of some effects.

    Parameters
    ----------
    effects : (n, n_points) array
        Of as many strengths, in units of the scatter and after a refit.
    moved : sequence of (n, n_points) arrays
        How they change with each quantity that the cause draws anew, in units of its prior.
    nothing : (n_simulated, n_points) array

    Returns
    -------
    (n_simulated,) array
    """
    best = np.full(len(nothing), -np.inf)
    for k, effect in enumerate(effects):
        left = nothing - effect
        gain = 0.5 * (np.sum(nothing**2, axis=1) - np.sum(left**2, axis=1))
        if moved:
            columns = np.array([m[k] for m in moved])
            pulled = left @ columns.T
            gain += 0.5 * np.sum(pulled * np.linalg.solve(np.eye(len(moved)) + columns @ columns.T, pulled.T).T, axis=1)
        np.maximum(best, gain, out=best)
    return best


def with_neutral(strength: Parameter, q: FloatArray, gain: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Quantiles and gains with the neutral value among them, which gains nothing.

    Where every strength tried is far too much, what helps is nearer to neutral.
    """
    if strength.neutral is None:
        return q, gain
    ends = {strength.bounds.lower: 0.0, strength.bounds.upper: 1.0}
    neutral = ends.get(strength.neutral, strength.prior_share(strength.neutral))
    place = int(np.searchsorted(q, neutral))
    return np.insert(q, place, neutral), np.insert(gain, place, 0.0)


def unclear_strengths(q: FloatArray, gain: FloatArray) -> FloatArray:
    """Quantiles half way between neighbours whose gains differ so much that more may hide there than at either."""
    settings = ScreenSettings()
    end = np.maximum(gain[1:], gain[:-1])
    wanted = np.flatnonzero((np.abs(np.diff(gain)) > settings.steep) & (end > gain.max() - settings.promising))
    wanted = wanted[np.argsort(-end[wanted], kind="stable")[: settings.most_halved]]
    return np.asarray(0.5 * (q[wanted] + q[wanted + 1]))

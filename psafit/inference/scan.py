"""Starts for causes that come to a model that is fitted already: scanned, and judged by what a refit would leave.

A new cause at the right place fits worse than none as long as the others stay where they were. So each place is judged
after a linear refit of the known parameters, which costs no simulation: with the readings' residual `r` and the change
`e` that the cause makes, in units of the scatter, and `P` what no known parameter can do, it gains
``(|P r|^2 - |P (r - e)|^2)/2`` nats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from psafit.arrays import FloatArray
from psafit.inference import noise
from psafit.inference.optimiser import FisherSettings, slopes
from psafit.inference.problem import Problem
from psafit.parameters import Parameter
from psafit.physics.term import Term


@dataclass(frozen=True)
class ScanSettings:
    """How the places of a new cause are scanned.

    Parameters
    ----------
    halvings : float
        Strengths are spread evenly over so many halvings of the way from a bound to the neutral value.
    draws : int
        Places of a cause with one parameter; of one with more, twice as many for each further.
    promising : int
        Places at which the strength is changed to what a linear effect would want, and that are simulated again.
    starts : int
        Places to begin from at most.
    cosine : float
        Cosine of the angle between what two places do, refits apart, above which only the better is a start.
    reach : float
        Factor by which a strength is changed at most.
    least : float, nats
        What a place to begin from must promise.
    off : float
        How far off their bounds all that is new begins once more: at a neutral value some have no slope, and the known
        point may be so narrow that it is lost there.
    """

    halvings: float = 24.0
    draws: int = 64
    promising: int = 16
    starts: int = 4
    cosine: float = 0.95
    reach: float = 8.0
    least: float = 1e-3
    off: float = 1e-3


def halved(parameter: Parameter, halvings: FloatArray) -> FloatArray:
    """Coordinates of a strength that approach its neutral value by halves: from each bound, `halvings` times.

    Strengths differ by orders of magnitude in what they do; how far the readings want one, no prior says.

    Returns
    -------
    (n_sides, n) array
        A side for each bound that is not the neutral value itself.
    """
    assert parameter.neutral is not None, parameter.name
    bounds, neutral = parameter.sampling_bounds, float(parameter.to_sampling(parameter.neutral))
    ends = [end for end in (bounds.lower, bounds.upper) if end != neutral]
    return np.array([neutral + (end - neutral) * 0.5**halvings for end in ends])


def widened(
    problem: Problem, known: FloatArray, new: Sequence[Term], *, seed: int = 0, settings: ScanSettings | None = None
) -> FloatArray:
    """Starts at which each of some causes comes to a known point.

    Parameters
    ----------
    problem : Problem
    known : (n_dim,) array
        Sampling coordinates, the new causes at neutral values.
    new : sequence of Term
    seed : int
        Of the places that are scanned.
    settings : ScanSettings, optional

    Returns
    -------
    (n, n_dim) array
        The known point first, and a little off it. Then of each cause its priors' medians, from where it can go even if
        it moves nothing by itself, as a gain does whose sessions are all at their mean; and places, best first, the
        known parameters refitted linearly.
    """
    s, rows = settings or ScanSettings(), [known[None]]
    if not new:
        return known[None]
    at_known = problem.predict(known[None])
    values = problem.noise_values(known[None])
    scatter = noise.scale(at_known, values, problem.known_sigma)

    def in_scatter(change: FloatArray) -> FloatArray:
        return noise.whitened((change / scatter)[None], values)[0]

    def changed(places: FloatArray) -> FloatArray:
        return in_scatter(problem.predict(places) - at_known)

    added = {p.name for term in new for p in term.parameters}
    is_new = [name in added for name in problem.names]
    rows.append(np.where(is_new, problem.inside(known, s.off), known)[None])
    old = [i for i in range(problem.n_model) if problem.names[i] not in added]
    slope = in_scatter(slopes(problem, known[None], at_known)[0, old])
    residual = in_scatter(problem.observed - at_known)[0]
    answer = np.linalg.pinv(slope, rcond=1e-6)  # (n_points, n_old): the refit's steps
    basis = slope.T @ answer.T  # what the known parameters can do of any change

    def left(change: FloatArray) -> FloatArray:
        return change - change @ basis.T

    wanted = left(residual)
    for term in new:
        strength = problem.names.index(term.strength.name)
        (neutral, *_) = halved(term.strength, np.array([np.inf]))[:, 0]
        rows.append(known[None].copy())
        for p in term.parameters:
            rows[-1][0, problem.names.index(p.name)] = p.prior_middle[1]
        places = _scanned(problem, known, term, s, seed)
        change = changed(places)
        effect = left(change)
        size = np.einsum("np,np->n", effect, effect)
        along = effect @ wanted
        with np.errstate(all="ignore"):
            scaled = np.clip(np.nan_to_num(along / size), 1.0 / s.reach, s.reach)
        hoped = scaled * (along - 0.5 * scaled * size)
        best = np.argsort(-np.nan_to_num(hoped, nan=-np.inf), kind="stable")[: s.promising]
        again = places[best]
        again[:, strength] = neutral + scaled[best] * (again[:, strength] - neutral)
        again = np.clip(again, problem.bounds[:, 0], problem.bounds[:, 1])
        places = np.vstack([places, again])
        change = np.vstack([change, changed(again)])
        effect = left(change)
        gain = np.nan_to_num(effect @ wanted - 0.5 * np.einsum("np,np->n", effect, effect), nan=-np.inf)
        ranked = [k for k in np.argsort(-gain, kind="stable").tolist() if gain[k] > s.least]
        chosen = _unlike(effect, ranked, s)
        starts = places[chosen]
        refit = (residual - change[chosen]) @ answer
        longest = FisherSettings.longest
        starts[:, old] += np.clip(refit, -longest, longest)
        rows.append(np.clip(starts, problem.bounds[:, 0], problem.bounds[:, 1]))
    return np.vstack(rows)


def _scanned(problem: Problem, known: FloatArray, term: Term, s: ScanSettings, seed: int) -> FloatArray:
    """Places of a cause: its strength by halves from each bound, the rest from its priors."""
    n = s.draws * 2 ** (len(term.parameters) - 1)
    quantiles = qmc.Sobol(len(term.parameters), rng=np.random.default_rng(seed)).random(n)
    places = np.repeat(known[None], n, axis=0)
    for p, quantile in zip(term.parameters, np.clip(quantiles.T, 1e-3, 1 - 1e-3), strict=True):
        if p is term.strength:
            sides = halved(p, s.halvings * quantile)
            drawn = sides[np.arange(n) % len(sides), np.arange(n)]
        else:
            drawn = p.prior_quantile(quantile)
        places[:, problem.names.index(p.name)] = drawn
    return places


def _unlike(effect: FloatArray, ranked: Sequence[int], s: ScanSettings) -> list[int]:
    """The first by rank of which none does what another does."""
    chosen: list[int] = []
    for k in ranked:
        size = np.linalg.norm(effect[[k, *chosen]], axis=1)
        if len(chosen) < s.starts and (effect[k] @ effect[chosen].T < s.cosine * size[0] * size[1:]).all():
            chosen.append(k)
    return chosen

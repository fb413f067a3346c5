"""Starts for causes that come to a model that is fitted already: scanned, and judged by what a refit would leave.

A new cause at the right place fits worse than none as long as the others stay where they were. So each place is judged
as it is, and after a linear refit of the known parameters, which costs no simulation: with the readings' residual `r`
and the change `e` that the cause makes, in units of the scatter, and `P` what no known parameter can do, it gains
``(|P r|^2 - |P (r - e)|^2)/2`` nats.

What acts by thresholds may do nothing at one strength, and far too much at the next. Between the two another one is
simulated, where the change promises more than at either if it grows evenly, or where one of them is as good as any.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
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
        Strengths between known ones that are simulated in a round at most.
    rounds : int
        Of these; each halves what lies between two.
    worth : float, nats
        What a strength must promise beyond its neighbours to be simulated.
    edges : int
        Strengths simulated in a round, at most, for no promise: next to one that is as good as any, and does something
        else than its neighbour.
    near : float, nats
        What one that is as good as any is below the best at most.
    starts : int
        Places to begin from at most, as they are and refitted each.
    cosine : float
        Cosine of the angle between what two places do, refits apart, above which only the better is a start.
    reach : float
        Factor by which a strength may exceed the largest on its line that was scanned.
    least : float, nats
        What a place to begin from must promise.
    off : float
        How far off their bounds all that is new begins once more: at a neutral value some have no slope, and the known
        point may be so narrow that it is lost there.
    """

    halvings: float = 24.0
    draws: int = 32
    promising: int = 8
    rounds: int = 8
    worth: float = 0.5
    edges: int = 4
    near: float = 3.0
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
        it moves nothing by itself, as a gain does whose sessions are all at their mean; and places, best first: those
        that gain by a linear refit of the known parameters, and those that gain as they are.
    """
    s, rows = settings or ScanSettings(), [known[None]]
    if not new:
        return known[None]
    at_known = problem.predict(known[None])
    values = problem.noise_values(known[None])
    scatter = noise.scale(at_known, values, problem.known_sigma)

    def in_scatter(change: FloatArray) -> FloatArray:
        return noise.whitened((change / scatter)[None], values)[0]

    def log_likelihood(predicted: FloatArray) -> FloatArray:
        return noise.log_density(problem.observed, predicted, values, problem.known_sigma).sum(axis=1)

    before = log_likelihood(at_known)

    def simulated(places: FloatArray) -> tuple[FloatArray, FloatArray]:
        predicted = problem.predict(places)
        return in_scatter(predicted - at_known), log_likelihood(predicted) - before

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
        rows.append(known[None].copy())
        for p in term.parameters:
            rows[-1][0, problem.names.index(p.name)] = p.prior_middle[1]
        scanned = _scanned(problem, known, term, s, seed)
        u, change, value = _with_more_between(problem, term, scanned, simulated, left, wanted, s)
        effect = left(change)
        chosen = _unlike(effect, _gained(effect, wanted), s)
        starts = u[chosen]
        longest = FisherSettings.longest
        starts[:, old] += np.clip((residual - change[chosen]) @ answer, -longest, longest)
        as_they_are = u[_unlike(change, value, s)]
        rows.append(np.clip(np.vstack([starts, as_they_are]), problem.bounds[:, 0], problem.bounds[:, 1]))
    return np.vstack(rows)


def _with_more_between(
    problem: Problem,
    term: Term,
    scanned: tuple[FloatArray, NDArray[np.intp]],
    simulated: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    left: Callable[[FloatArray], FloatArray],
    wanted: FloatArray,
    s: ScanSettings,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places of a cause, those scanned and those between; what each changes, and what it gains as it is, nats.

    Parameters
    ----------
    problem : Problem
    term : Term
    scanned : (n, n_dim) and (n,) array
        As of `_scanned`.
    simulated : callable
        From places, (n, n_dim), to their changes, (n, n_points), and what they gain, (n,).
    left : callable
        What a refit leaves of changes.
    wanted : (n_points,) array
    s : ScanSettings
    """
    (u, line), strength = scanned, problem.names.index(term.strength.name)
    bounds, (neutral, *_) = problem.bounds[strength], halved(term.strength, np.array([np.inf]))[:, 0]
    change, value = simulated(u)
    first = np.ones(len(u), bool)
    for _ in range(s.rounds):
        of, at = _Nodes(neutral, u[:, strength], line, first, left(change), value).between(wanted, bounds, s)
        if not of.size:
            break
        more = u[of]
        more[:, strength] = at
        changes, gained = simulated(more)
        u, line, first = np.vstack([u, more]), np.append(line, line[of]), np.append(first, np.zeros(len(more), bool))
        change, value = np.vstack([change, changes]), np.append(value, gained)
    return u, change, value


def _gained(effect: FloatArray, wanted: FloatArray) -> FloatArray:
    return effect @ wanted - 0.5 * np.einsum("np,np->n", effect, effect)


class _Nodes(NamedTuple):
    """Strengths of a cause that were simulated, on lines along which nothing else differs.

    Parameters
    ----------
    neutral : float
        The strength that does nothing; it is on every line.
    strength : (n,) array
    line : (n,) array of int
        Which each is on.
    scanned : (n,) array of bool
        Whether it was scanned, and not tried between others.
    effect : (n, n_points) array
        What each does, refits apart.
    value : (n,) array
        What each gains as it is, nats.
    """

    neutral: float
    strength: FloatArray
    line: NDArray[np.intp]
    scanned: NDArray[np.bool_]
    effect: FloatArray
    value: FloatArray

    def between(self, wanted: FloatArray, bounds: FloatArray, s: ScanSettings) -> tuple[NDArray[np.intp], FloatArray]:
        """Return strengths between neighbours that are to be simulated, or beyond the last.

        Between two that were scanned, a strength is where the change is hoped to be best; where one was tried already
        it is in the middle, for the change does not grow evenly.

        Parameters
        ----------
        wanted : (n_points,) array
        bounds : (2,) array
            Of the strength.
        s : ScanSettings

        Returns
        -------
        (k,) array of int and (k,) array
            A node on the same line, and the new strength.
        """
        order = np.lexsort((np.abs(self.strength - self.neutral), self.line))
        x, e, value = (a[order] for a in (self.strength, self.effect, self.value))
        line = self.line[order]
        last = np.append(line[1:] != line[:-1], True)
        first = np.roll(last, 1)
        low, at_low = np.where(first, self.neutral, np.roll(x, 1)), np.where(first[:, None], 0.0, np.roll(e, 1, axis=0))
        own = self.scanned[order]
        tried = np.append(~own | np.where(first, False, np.roll(~own, 1)), ~own[last])
        # Beyond the last the change is taken to go on as it has grown.
        away = np.abs(x - self.neutral)
        farthest = s.reach * np.maximum.reduceat(np.where(own, away, 0.0), np.flatnonzero(first))
        side = np.sign(x[last] - self.neutral)
        beyond = np.clip(self.neutral + side * np.maximum(farthest, away[last]), *bounds)
        low, high = np.append(low, x[last]), np.append(x, beyond)
        with np.errstate(all="ignore"):
            grown = e[last] * (np.abs(beyond - self.neutral) / away[last])[:, None]
            at_low, at_high = np.vstack([at_low, e[last]]), np.vstack([e, grown])
            step = at_high - at_low
            size = np.einsum("np,np->n", step, step)
            part = np.clip(np.nan_to_num(np.einsum("np,np->n", wanted - at_low, step) / size), 0.0, 1.0)
            hoped = _gained(at_low + part[:, None] * step, wanted)
            known = np.fmax(_gained(at_low, wanted), np.append(_gained(e, wanted), np.full(last.sum(), -np.inf)))
            hoped = np.where(hoped > known + s.worth, hoped, -np.inf)
        best = np.argsort(-hoped, kind="stable")[: s.promising]
        best = best[hoped[best] > s.least]
        # Next to the best as they are, if they differ by a standard deviation. Their values take neither the scatter to
        # be normal nor a refit to be linear.
        value = np.nan_to_num(value, nan=-np.inf)
        either = np.maximum(np.where(first, 0.0, np.roll(value, 1)), value)
        unknown = np.where(either > max(value.max(), 0.0) - s.near, np.nan_to_num(size[: x.size]), 0.0)
        edge = np.argsort(-unknown, kind="stable")[: s.edges]
        edge = np.setdiff1d(edge[unknown[edge] > 1.0], best)
        chosen, halves = np.append(best, edge), np.append(tried[best], np.ones(edge.size, bool))
        share = np.where(halves, 0.5, part[chosen])
        return np.append(order, order[last])[chosen], low[chosen] + share * (high[chosen] - low[chosen])


def _scanned(
    problem: Problem, known: FloatArray, term: Term, s: ScanSettings, seed: int
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Places of a cause, its strength by halves from each bound, the rest from its priors; and the line each is on."""
    n = s.draws * 2 ** (len(term.parameters) - 1)
    quantiles = qmc.Sobol(len(term.parameters), rng=np.random.default_rng(seed)).random(n)
    places = np.repeat(known[None], n, axis=0)
    for p, quantile in zip(term.parameters, np.clip(quantiles.T, 1e-3, 1 - 1e-3), strict=True):
        if p is term.strength:
            sides = halved(p, s.halvings * quantile)
            side = np.arange(n) % len(sides)
            drawn = sides[side, np.arange(n)]
        else:
            drawn = p.prior_quantile(quantile)
        places[:, problem.names.index(p.name)] = drawn
    return places, side if len(term.parameters) == 1 else np.arange(n)


def _unlike(effect: FloatArray, gain: FloatArray, s: ScanSettings) -> list[int]:
    """Those that gain most, of which none does what another does."""
    chosen: list[int] = []
    gain = np.nan_to_num(gain, nan=-np.inf)
    for k in np.argsort(-gain, kind="stable"):
        if len(chosen) == s.starts or gain[k] <= s.least:
            break
        size = np.linalg.norm(effect[[k, *chosen]], axis=1)
        if (effect[k] @ effect[chosen].T < s.cosine * size[0] * size[1:]).all():
            chosen.append(int(k))
    return chosen

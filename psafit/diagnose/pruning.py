r"""Search from above: every cause at once, then one after the other taken away.

A search that grows a model goes through smaller ones, and where several causes hold each other in place, the small
models of a good large one may all be bad. From above there is no such gap: with all causes of the catalogue in the
model, kept in bounds by their priors alone, climbs from draws of the prior go to where the readings are explained in
one way or another; the cause whose absence costs least then goes, and the rest is fitted anew, until few are left.
(Backward elimination, and forward again from what it leads to: T. Zhang, IEEE Trans. Inf. Theory 57 (2011) 4689, on why
both directions are wanted.)

What the absence of a cause costs is estimated by taking it away and refitting the rest in the expansion of the fit.
While there are many, a quarter of the readings is enough to see that, and several that cost nothing go at once. Of few
those that seem to cost least are taken away in earnest, and the evidence of what is left decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.ascent import Ascent, ascend, ascend_linearly, heights
from psafit.inference.candidate import ENOUGH, Candidate, coarse, settle, within_bounds
from psafit.inference.problem import Problem
from psafit.physics.term import Term

Ids = tuple[str, ...]

# Draws of the prior that are looked at, and climbs from the best of them on some of the readings. Slopes are carried
# over long: what matters here is to be on the hill.
_DRAWS, _STARTS = 400, 24
_ROUGHLY, _LASTING = ((5, 12), (5, 8), (15, 3)), 8
# Gain (nats) below which a climb on the way ends.
_STILL = 0.3
# Nats that a cause may cost to go together with others, and climbs then.
_NOTHING, _THIN = 0.5, ((5, 1),)
# Causes that are taken away from a model in earnest, and climbs after that: to see what it costs, and to go on.
_LIKELY = 3
_LOOK, _GO_ON = ((8, 1),), ((12, 1),)
# Parts of the way to where the expansion has the rest that are tried, and iterations there.
_PARTS, _ITERATIONS = (0.3, 1.0), 12
# Of so many draws around a fit, so many times as wide as its posterior, the best are climbed from.
_SHAKES, _SHAKEN, _SHAKE = 32, 3, 1.5
_ON_ALL = ((8, 2), (30, 1))
# A start this far (nats) below a model's fit may lead above it.
_WITHIN_REACH = 100.0


def prune(
    problem: Problem,
    catalogue: Sequence[Term],
    *,
    seed: int,
    least: int,
    most: int,
    few: int = 12,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> list[Candidate]:
    """Models that a search from above leads through.

    Parameters
    ----------
    problem : Problem
        The readings, with no cause.
    catalogue : sequence of Term
    seed : int
        Of the draws of the prior.
    least, most : int
        Causes of a model.
    few : int
        Causes from which on all readings are looked at.
    progress : callable
        Called with (what, done, total).

    Returns
    -------
    list of Candidate
        From each hill.
    """
    rough = coarse(replace(problem, terms=tuple(catalogue)))
    progress("all causes at once", 0, 1)
    quantiles = np.random.default_rng([seed, 23]).uniform(0.02, 0.98, (_DRAWS, rough.n_dim))
    draws = rough.prior_transform(quantiles)
    height = rough.log_posterior(draws)
    best = [k for k in np.argsort(-height, kind="stable")[:_STARTS] if np.isfinite(height[k])]
    if not best:
        return []
    tops = ascend(rough, draws[best], schedule=_ROUGHLY, lasting=_LASTING, still_below=_STILL, unite=True)
    hills = []
    for k in range(len(tops.u)):
        progress(f"what can go, hill {k + 1}", k, len(tops.u))
        top = Ascent(tops.u[k : k + 1], tops.height[k : k + 1], tops.predicted[k : k + 1], 0)
        hills.append(_thinned_out(settle(rough, top), few))
    # Where hills have met, the highest stays.
    hills.sort(key=lambda c: c.height)
    beam = {c.ids: (replace(problem, terms=c.terms), c.modes[0]) for c in hills}
    rng = np.random.default_rng([seed, 29])
    found: list[list[Candidate]] = []
    while True:
        now = [_climbed(one, u[None], _GO_ON) for one, u in beam.values()]
        size = len(now[0].terms)  # all hills have lost as many
        progress(f"one by one, {size} are left", few - size, few - least)
        if size <= most:
            now = [_shaken(c, rng) for c in now]
            found.append(now)
        if size <= least:
            return _up(found)
        beam = {c.ids: (c.problem, c.modes[0]) for c in _smaller(now)[: len(hills)]}


def _smaller(beam: Sequence[Candidate]) -> list[Candidate]:
    """Models with one cause less: the best of each hill first, and where hills have met the next best of all."""
    found: dict[Ids, Candidate] = {}
    own: list[Ids] = []
    for c in beam:
        tried = [_climbed(one.problem, one.u[None], _LOOK) for one in _by_worth(c)[:_LIKELY]]
        own.append(max(tried, key=lambda one: one.laplace).ids)
        for one in tried:
            if one.ids not in found or one.laplace > found[one.ids].laplace:
                found[one.ids] = one
    return sorted(found.values(), key=lambda c: (c.ids not in own, -c.laplace))


def _thinned_out(now: Candidate, few: int) -> Candidate:
    """Take causes away, as the expansion tells, until few are left."""
    while len(now.terms) > few:
        order = _by_worth(now)
        here = _mass(now.problem, now.height, now.curvature[0])
        idle = [one.gone for one in order if one.worth > here - _NOTHING][: max((len(order) - few) // 2, 1)]
        rest, u = order[0].problem, order[0].u
        if len(idle) > 1:
            rest, kept = now.problem.without(*idle)
            u = now.modes[0][kept]
        now = _climbed(rest, u[None], _THIN)
    return now


@dataclass(frozen=True, eq=False)
class _Left:
    """What is left when a cause is taken away: the model, where its fit is begun, and how much it holds (nats)."""

    gone: Term
    problem: Problem
    u: FloatArray
    worth: float


def _by_worth(now: Candidate) -> list[_Left]:
    """What is left without each cause, that whose absence costs least first."""
    return sorted((_without(now, t) for t in now.terms), key=lambda one: -one.worth)


def _without(now: Candidate, gone: Term) -> _Left:
    """Take a cause away and refit the rest in the expansion of the fit."""
    problem, kept = now.problem.without(gone)
    at = now.modes[0][kept]
    here = problem.predict(at[None])
    slope = now.relative_slope[kept[: problem.n_model]]
    end = ascend_linearly(problem, at[None], np.maximum(here, 1e-9), slope, iterations=_ITERATIONS).u[0]
    further = np.array([at + part * (end - at) for part in _PARTS])
    rows, predicted = np.vstack([at, further]), np.vstack([here, problem.predict(further)])
    height = heights(problem, rows, predicted, problem.observed)
    best = int(np.argmax(height))
    return _Left(gone, problem, rows[best], _mass(problem, float(height[best]), now.curvature[0][np.ix_(kept, kept)]))


def _mass(problem: Problem, height: float, curvature: FloatArray) -> float:
    """Log mass of a normal hill: heights of models with other numbers of parameters cannot be compared."""
    volume = len(curvature) * np.log(2 * np.pi) - np.linalg.slogdet(within_bounds(problem, curvature))[1]
    return height + 0.5 * float(volume)


def _shaken(now: Candidate, rng: np.random.Generator) -> Candidate:
    """Climb on from places around a fit: climbs stop at cliffs, on either side of which the way may go up."""
    problem = now.problem
    curvature = within_bounds(problem, now.curvature[0])
    around = rng.multivariate_normal(now.modes[0], _SHAKE**2 * np.linalg.inv(curvature), _SHAKES)
    around = np.clip(around, *problem.bounds.T)
    best = np.argsort(-problem.log_posterior(around), kind="stable")[:_SHAKEN]
    return _climbed(problem, np.vstack([now.modes[:1], around[best]]), _ON_ALL, ENOUGH)


def _up(found: Sequence[Sequence[Candidate]]) -> list[Candidate]:
    """Climb the larger models from the smaller ones' fits, too: none may be worse than a part of it."""
    better: list[Candidate] = []
    for level in reversed(found):
        for c in level:
            for part in [p for p in better if set(p.ids) < set(c.ids) and len(p.ids) == len(c.ids) - 1]:
                start = part.widened(c.problem)[0]
                height = c.problem.log_posterior(start)
                if height.max() > c.height - _WITHIN_REACH:
                    best = start[np.argsort(-height, kind="stable")[:2]]
                    c = _climbed(c.problem, np.vstack([c.modes[:1], best]), _ON_ALL, ENOUGH)
            better.append(c)
    return better


def _climbed(
    problem: Problem, starts: FloatArray, schedule: tuple[tuple[int, int], ...], still_below: float = _STILL
) -> Candidate:
    return settle(problem, ascend(problem, starts, schedule=schedule, still_below=still_below, unite=True))

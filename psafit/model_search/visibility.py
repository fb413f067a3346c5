"""Whether a cause shows: whether its effect, less what a refit takes up, exceeds what the scatter hides.

Any truth has supersets whose further causes are too weak to be seen. Nobody can refute them, and together they have as
much probability as the truth itself. So each draw of a model's posterior is asked which of its causes show in it. Where
one does not, the draw is counted with the model without that cause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample, RoundSettings, drawn_about
from psafit.inference.memory import Arrays
from psafit.inference.problem import Problem
from psafit.model_search.loop import Ids, reduced

VISIBLE = 2.5
"""Size of an effect, after the refit and in standard deviations of the scatter, below which it does not show.

The power to see that is one half for a gain of two and a half standard deviations.
"""

UNASKED = 1e-3
"""Share of a probability, or of a model's draws, that is not asked about."""


@dataclass(frozen=True, eq=False)
class Effects:
    """What the causes of a model do, over draws of its posterior.

    Parameters
    ----------
    weights : (n,) array
        Of the draws, normalised.
    size : (n, n_causes) array
        Of each cause's effect, less what a refit of the other parameters takes up, in standard deviations of the
        scatter; infinite where the model without it was not fitted, or is so improbable that no draw can be like it.
    """

    weights: FloatArray
    size: FloatArray


Effective = Callable[[Sequence[Ids]], Mapping[Ids, Effects]]
"""Works out the effects in some of the sets that were fitted."""


def effects(
    problem: Problem,
    candidate: Candidate,
    draws: ImportanceSample | None,
    parts: Sequence[Candidate | None],
    seed: int,
    rounds: RoundSettings,
) -> Arrays:
    """Work out the effects of a model's causes, as arrays named like the fields of `Effects`.

    Parameters
    ----------
    problem : Problem
    candidate : Candidate
        The model.
    draws : ImportanceSample, optional
        Of its posterior. Without them it is drawn from Student densities at the modes, then about the draws before;
        where no draw lies within the bounds, all causes count as visible.
    parts : sequence of Candidate or None
        The model without each of its causes, in their order; None for what counts as visible in all draws.
    seed : int
    rounds : RoundSettings
        Of the draws; of `draws` so many are taken as all rounds have.
    """
    if draws is not None:
        n = rounds.draws * rounds.most
        u, weights = draws.resampled(n), np.full(n, 1.0 / n)
        predicted = problem.predict(u)
    else:
        try:
            pool, predicted = drawn_about(candidate, np.random.default_rng([seed, 43]), rounds)
        except ConvergenceError:
            return {"weights": np.ones(1), "size": np.full((1, len(parts)), np.inf)}
        u, weights = pool.u, pool.weights
    size = np.full((len(weights), len(parts)), np.inf)
    for k, (term, part) in enumerate(zip(candidate.terms, parts, strict=True)):
        if part is not None:
            # A refit goes on in a straight line: from the best of the model without the cause and, where the cause
            # shows then, from the draw without it. The nearer counts. In units of the model's own scatter: the part's
            # has taken some of the effect up.
            size[:, k] = _left(candidate, predicted - part.predicted, part)
            far = size[:, k] >= VISIBLE
            if far.any():
                without = part.problem.predict(u[far][:, problem.without(term)[1]])
                size[far, k] = np.fmin(size[far, k], _left(candidate, predicted[far] - without, part))
    return {"weights": weights, "size": size}


def _left(candidate: Candidate, effect: FloatArray, part: Candidate) -> FloatArray:
    """What a refit of a part leaves of changes of the ranges, (n, n_points), in standard deviations of the scatter."""
    return np.asarray(np.linalg.norm(candidate.project_out(effect, slope=part.slope), axis=1))


def may_hide(part: float, whole: float, error: float) -> bool:
    """Whether more than a few of a model's draws may be like those of a part.

    A cause of which the readings want an effect of r standard deviations makes the evidence better by ``r**2 / 2`` nats
    at most. Its effect over the draws is normal about r: a share ``Phi(VISIBLE - r)`` of them does not show.

    Parameters
    ----------
    part, whole : float
        Log evidences.
    error : float
        What the difference may be smaller by, nats.
    """
    wanted = math.sqrt(2.0 * max(whole - part - error, 0.0))
    return bool(ndtr(VISIBLE - wanted) > UNASKED)


def shown(
    share: Mapping[Ids, float],
    mass: Mapping[Ids, float],
    effects: Effective,
    *,
    unasked: float = UNASKED,
) -> dict[Ids, float]:
    """Probability of each set of causes to be at work visibly, and no other.

    A draw in which a cause does not show becomes a draw of the model without that cause, like all others of it.

    Parameters
    ----------
    share : mapping
        Probability of each set to be at work.
    mass : mapping
        Its logarithm, not normalised: of several models that lack a cause which does not show, a draw goes to the most
        probable one.
    effects : callable
        Asked for sets of one number of causes at a time, the largest first.
    unasked : float
        Sets of one number of causes that have no more than this together are taken as they are.
    """
    left = dict(share)
    for n in sorted({len(ids) for ids in share if ids}, reverse=True):
        rising = sorted((ids for ids in share if len(ids) == n), key=lambda ids: left[ids])
        together = np.cumsum([left[ids] for ids in rising])
        wanted = [ids for ids, p in zip(rising, together, strict=True) if p > unasked]
        for ids, found in effects(wanted).items():
            parts = reduced(ids)
            hidden = found.size < VISIBLE
            weight = np.array([mass.get(part, -np.inf) for part in parts])
            goes_to = np.where(hidden.any(axis=1), np.argmax(np.where(hidden, weight, -np.inf), axis=1), -1)
            moved = left[ids] * np.array([found.weights[goes_to == k].sum() for k in range(len(parts))])
            for part, p in zip(parts, moved.tolist(), strict=True):
                if p:
                    left[part] += p
            left[ids] = max(left[ids] - float(moved.sum()), 0.0)
    return left

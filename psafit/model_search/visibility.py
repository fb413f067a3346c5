"""Whether a cause shows: whether its effect, less what a refit takes up, exceeds what the scatter hides.

Any truth has supersets whose further causes are too weak to be seen. Nobody can refute them, and together they have as
much probability as the truth itself. So each draw of a model's posterior is asked which of its causes show in it. Where
one does not, the draw is counted with the model without that cause.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample, RoundSettings, laplace_mixture, simulated_in_rounds
from psafit.inference.memory import Arrays
from psafit.inference.problem import Problem
from psafit.model_search.loop import Ids

VISIBLE = 2.5
"""Size of an effect, after the refit and in standard deviations of the scatter, below which it does not show.

The power to see that is one half for a gain of two and a half standard deviations.
"""


@dataclass(frozen=True, eq=False)
class Effects:
    """What the causes of a model do, over draws of its posterior.

    Parameters
    ----------
    weights : (n,) array
        Of the draws, normalised.
    size : (n, n_causes) array
        Of each cause's effect next to the model without it, refitted, in standard deviations of the scatter; infinite
        where that model was not fitted.
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
        Of its posterior. Without them it is drawn from Student densities at the modes, then about the draws before.
    parts : sequence of Candidate or None
        The model without each of its causes, in their order, where it was fitted.
    seed : int
    rounds : RoundSettings
        Of the draws; of `draws` so many are taken as one round has.
    """
    if draws is None:
        pool, predicted = simulated_in_rounds(
            problem, laplace_mixture(candidate),
            lambda found, simulated, before: before.mixture.around(found.u, found.weights, problem.widths),
            np.random.default_rng([seed, 43]), rounds,
        )  # fmt: skip
        weights = pool.weights
    else:
        predicted = problem.predict(draws.resampled(rounds.draws))
        weights = np.full(rounds.draws, 1.0 / rounds.draws)
    size = np.full((len(weights), len(parts)), np.inf)
    for k, part in enumerate(parts):
        if part is not None:
            size[:, k] = np.linalg.norm(part.project_out(predicted - part.predicted), axis=1)
    return {"weights": weights, "size": size}


def shown(
    share: Mapping[Ids, float], mass: Mapping[Ids, float], found: Mapping[Ids, Effects], visible: float = VISIBLE
) -> dict[Ids, float]:
    """Probability of each set of causes to be at work visibly, and no other.

    Parameters
    ----------
    share : mapping
        Probability of each set to be at work.
    mass : mapping
        Its logarithm, not normalised: of several models that lack a cause which does not show, a draw goes to the most
        probable one.
    found : mapping
        Effects in the sets that matter. All causes of the others count as visible.
    visible : float
        Size from which an effect shows.
    """
    left = dict(share)
    for ids in sorted(found, key=len, reverse=True):
        parts = [tuple(other for other in ids if other != id) for id in ids]
        hidden = found[ids].size < visible
        weight = np.array([mass.get(part, -np.inf) for part in parts])
        goes_to = np.where(hidden.any(axis=1), np.argmax(np.where(hidden, weight, -np.inf), axis=1), -1)
        whole = left[ids]
        for k, part in enumerate(parts):
            moved = whole * float(found[ids].weights[goes_to == k].sum())
            if moved:
                left[part] += moved
                left[ids] -= moved
        left[ids] = max(left[ids], 0.0)
    return left

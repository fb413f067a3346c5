r"""Which readings a cause lives on, and which readings the adopted model leans on.

Of a reading :math:`y_i` that is left out, a model with draws :math:`\theta_s` of its posterior expects

.. math:: \ln p(y_i | y_{-i}) \approx \ln \sum_s w_{is}\, p(y_i | \theta_s), \qquad w_{is} \propto 1/p(y_i|\theta_s),

with weights smoothed by Pareto's law (PSIS; A. Vehtari, A. Gelman and J. Gabry, Stat. Comput. 27 (2017) 1413). What the
adopted model expects more of a reading than the same model without a cause does, is what that reading gives the cause.
The shape of the weights' tail says how far a reading alone moves the posterior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.experiment import GroupId
from psafit.inference.store import smoothed
from psafit.model_search import Ids, ModelSet


@dataclass(frozen=True)
class Carried:
    """What readings give a cause.

    Parameters
    ----------
    cause : str
    nats : list of float
        By reading, one group after the other: of the expected log predictive density.
    total : float, nats
    half : int
        Readings that give most, so many that half of what speaks for the cause is theirs.
    groups : list of (group id, float)
        Nats by group, the most first.
    """

    cause: str
    nats: list[float]
    total: float
    half: int
    groups: list[tuple[GroupId, float]]


@dataclass(frozen=True)
class Influence:
    """Which readings an answer rests on.

    Parameters
    ----------
    causes : list of Carried
        Of what is named.
    tail : list of float
        By reading: shape of the weights' tail (Pareto k) by the adopted model. Above 0.7 this reading alone moves
        the posterior far, and its nats are not to be trusted.
    """

    causes: list[Carried]
    tail: list[float]


def influence(model_set: ModelSet, named: Ids, *, seed: int, draws: int = 400) -> Influence | None:
    """Ask which readings the causes of the best model live on; None where none are named.

    Parameters
    ----------
    model_set : ModelSet
    named : tuple of str
        Causes of the best model, in the order in which they are reported.
    seed : int
    draws : int
        Of each model's posterior.
    """
    if not named:
        return None
    expected, tail = _left_out(model_set, model_set.best_model.ids, seed, draws)
    problem = model_set.best_model.problem
    found = []
    for id in named:
        rest = tuple(other for other in model_set.best_model.ids if other != id)
        if rest in model_set.log_evidence:
            nats = expected - _left_out(model_set, rest, seed, draws)[0]
            each = [(g, float(nats[problem.design.group == k].sum())) for k, g in enumerate(problem.group_ids)]
            groups = sorted(each, key=lambda item: -item[1])
            found.append(Carried(id, nats.tolist(), float(nats.sum()), carrying_half(nats), groups))
    return Influence(found, tail.tolist())


def carrying_half(nats: Sequence[float] | FloatArray) -> int:
    """Fewest readings that give half of what speaks for a cause."""
    gains = np.sort(np.maximum(np.asarray(nats), 0.0))[::-1]
    return int(np.searchsorted(np.cumsum(gains), 0.5 * gains.sum())) + 1 if gains.any() else 0


def _left_out(model_set: ModelSet, ids: Ids, seed: int, draws: int) -> tuple[FloatArray, FloatArray]:
    """Log density that a model expects of each reading without it, and the tails of the weights; (n_points,) each."""
    problem = model_set.of(ids).problem
    each = problem.pointwise_log_likelihood(model_set.draws(ids, seed).resampled(draws)).T
    weights, tail = smoothed(-each)
    return np.asarray(logsumexp(weights + each, axis=1)), tail

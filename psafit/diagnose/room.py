"""The largest effect that the readings leave to a cause that is not named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from psafit.errors import ConvergenceError
from psafit.inference.evidence import TRUSTED, RoundSettings, drawn_about, quantiles
from psafit.model_search import Ids, ModelSet
from psafit.physics.term import Term


@dataclass(frozen=True)
class Room:
    """What the readings leave a cause.

    Parameters
    ----------
    share : float
        Largest change of a reading, as a share of it.
    size : float
        Of its effect on all readings, in standard deviations of their scatter, less what a refit takes up.
    row : int
        The reading of which the largest change is left, as a row of the design.
    """

    share: float
    size: float
    row: int


def room(
    model_set: ModelSet, adopted: Ids, term: Term, *, seed: int, draws: int = 128, rounds: int = 12, limit: float = 0.95
) -> Room | None:
    """Return what a cause may do given what is adopted.

    The model with the cause was fitted by the search as a neighbour of the adopted one. What draws of its posterior
    predict is compared with what the adopted model does, less what its parameters could do in the cause's place, at the
    reading where that is largest.
    Readings are counted from the offset of `log_rmse` below zero: what is lost in the rest motion is no effect.

    Parameters
    ----------
    model_set : ModelSet
    adopted : tuple of str
        Causes of the model that is adopted.
    term : Term
        A cause that is not among them.
    seed : int
    draws, rounds : int
        Draws of a round, from Student densities at the modes, then about the draws before, weighted by the posterior;
        and rounds at most, until as many count as the quantile needs: one beyond it.
    limit : float
        Quantile of the posterior.

    Returns
    -------
    Room or None
        None where the model was not fitted, as of a set that is as large as a search goes, no draw lies within its
        bounds, or the weights are not to be trusted.
    """
    larger = {*adopted, term.id}
    fitted = next((c for c in model_set.candidates if {*c.ids} == larger), None)
    if fitted is None:
        return None
    needed = RoundSettings(draws=draws, least=1, most=rounds, effective=1.0 / (1.0 - limit))
    try:
        pool, predicted = drawn_about(fitted, np.random.default_rng([seed, 31]), needed)
    except ConvergenceError:
        return None
    found = pool.sample()
    if found.effective < needed.effective or found.pareto_k > TRUSTED:
        return None
    plain = model_set.of(adopted)
    effect = plain.project_out(predicted - plain.predicted)
    size = np.linalg.norm(effect, axis=1)
    changed = np.abs(effect) * plain.scatter / (np.abs(plain.predicted) + plain.problem.offset)
    each = np.column_stack([changed.max(axis=1), size, changed])
    share, most, *by_reading = quantiles(each, pool.weights, [limit])[0].tolist()
    return Room(share, most, int(np.argmax(by_reading)))

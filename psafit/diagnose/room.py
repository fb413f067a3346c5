"""The largest effect that the readings leave to a cause that is not named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from psafit.inference.evidence import TRUSTED, laplace_mixture, quantiles
from psafit.inference.optimiser import log_posteriors
from psafit.inference.store import pareto_k
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
    """

    share: float
    size: float


def room(
    model_set: ModelSet, adopted: Ids, term: Term, *, seed: int, draws: int = 128, most: int = 1024, limit: float = 0.95
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
    draws, most : int
        From Student densities at the modes, weighted by the posterior. While Pareto's k distrusts the weights, they are
        doubled, up to `most`.
    limit : float
        Quantile of the posterior.

    Returns
    -------
    Room or None
        None where the model was not fitted, as of a set that is as large as a search goes, or the weights are not to be
        trusted.
    """
    larger = {*adopted, term.id}
    fitted = next((c for c in model_set.candidates if {*c.ids} == larger), None)
    if fitted is None:
        return None
    problem, rng = fitted.problem, np.random.default_rng([seed, 31])
    proposal = laplace_mixture(fitted)
    predicted, log_weight = np.empty((0, problem.observed.size)), np.empty(0)
    while log_weight.size < 2 or pareto_k(log_weight) > TRUSTED:
        if draws > most:
            return None
        u = proposal.scatter(draws, rng)
        u = u[((u >= problem.bounds[:, 0]) & (u <= problem.bounds[:, 1])).all(axis=1)]
        predicted = problem.predict(u)
        log_weight = log_posteriors(problem, u, predicted, problem.observed) - proposal.log_density(u)
        draws *= 2
    weights = np.exp(log_weight - logsumexp(log_weight))
    plain = model_set.of(adopted)
    effect = plain.project_out(predicted - plain.predicted)
    size = np.linalg.norm(effect, axis=1)
    largest = np.max(np.abs(effect) * plain.scatter / (np.abs(plain.predicted) + plain.problem.offset), axis=1)
    return Room(*(float(quantiles(each, weights, [limit])[0]) for each in (largest, size)))

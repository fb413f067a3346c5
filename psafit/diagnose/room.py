"""The largest effect that the readings leave to a cause that is not named."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from psafit.inference.ascent import heights
from psafit.inference.evidence import laplace_mixture, quantiles
from psafit.model_search import Ids, Ladder
from psafit.physics.term import Term


def room(ladder: Ladder, adopted: Ids, term: Term, *, seed: int, draws: int = 128, limit: float = 0.95) -> float | None:
    """Return the largest change of a reading, as a share of it, that a cause may make beside what is adopted.

    The model with the cause was fitted by the search as a neighbour of the adopted one. What draws of its posterior
    predict is compared with what the adopted model does, less what its parameters could do in the cause's place, at the
    reading where that is largest.
    Readings are counted from the offset of `log_rmse` below zero: what is lost in the rest motion is no effect.

    Parameters
    ----------
    ladder : Ladder
    adopted : tuple of str
        Causes of the model that is adopted.
    term : Term
        A cause that is not among them.
    seed : int
    draws : int
        From Student densities at the modes, weighed by the posterior.
    limit : float
        Quantile of the posterior.

    Returns
    -------
    float or None
        None where the model was not fitted, as of a set that is as large as a search goes, or no draw is possible.
    """
    larger = {*adopted, term.id}
    fitted = next((c for c in ladder.candidates if {*c.ids} == larger), None)
    if fitted is None:
        return None
    problem, rng = fitted.problem, np.random.default_rng([seed, 31])
    proposal = laplace_mixture(fitted)
    u = proposal.scatter(draws, rng)
    u = u[((u >= problem.bounds[:, 0]) & (u <= problem.bounds[:, 1])).all(axis=1)]
    if not len(u):
        return None
    predicted = problem.predict(u)
    log_weight = heights(problem, u, predicted, problem.observed) - proposal.log_density(u)
    weights = np.exp(log_weight - logsumexp(log_weight))
    plain = ladder.of(adopted)
    effect = plain.beside(predicted - plain.predicted) * plain.scatter
    largest = np.max(np.abs(effect) / (plain.predicted + plain.problem.offset), axis=1)
    return float(quantiles(largest, weights, [limit])[0])

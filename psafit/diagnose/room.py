"""The largest effect that the readings leave to a cause that is not named."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from psafit.inference.ascent import heights
from psafit.inference.candidate import within_bounds
from psafit.inference.evidence import quantiles
from psafit.model_search import Ids, Ladder
from psafit.physics.term import Term
from psafit.validate import OFFSET_UM


def room(ladder: Ladder, adopted: Ids, term: Term, *, seed: int, draws: int = 128, limit: float = 0.95) -> float | None:
    """Return the largest change of a launch range, as a share of it, that a cause may make beside what is adopted.

    The model with the cause was fitted by the search as a neighbour of the adopted one. What draws of its posterior
    predict is compared with what the adopted model does, less what its parameters could do in the cause's place, at the
    reading where that is largest.
    Ranges are counted from 0.3 um below zero, as in `log_rmse`: what is lost in the rest motion is no effect.

    Parameters
    ----------
    ladder : Ladder
    adopted : tuple of str
        Causes of the model that is adopted.
    term : Term
        A cause that is not among them.
    seed : int
    draws : int
        From the normals at the modes, weighed by the posterior.
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
    share = np.exp(fitted.mass - logsumexp(fitted.mass))
    parts = [
        multivariate_normal(u, np.linalg.inv(within_bounds(problem, curvature)))
        for u, curvature in zip(fitted.modes, fitted.curvature, strict=True)
    ]
    which = rng.choice(len(parts), draws, p=share)
    u = np.array([parts[k].rvs(random_state=rng) for k in which])
    u = u[((u >= problem.bounds[:, 0]) & (u <= problem.bounds[:, 1])).all(axis=1)]
    if not len(u):
        return None
    proposed = logsumexp([p.logpdf(u) + np.log(s) for p, s in zip(parts, share, strict=True)], axis=0)
    predicted = problem.predict(u)
    log_weight = heights(problem, u, predicted, problem.observed) - proposed
    weights = np.exp(log_weight - logsumexp(log_weight))
    plain = ladder.of(adopted)
    effect = plain.beside(predicted - plain.predicted) * plain.scatter
    largest = np.max(np.abs(effect) / (plain.predicted + OFFSET_UM), axis=1)
    return float(quantiles(largest, weights, [limit])[0])

"""Evidence by nautilus, an importance nested sampler: slow, and independent of fits, curvatures and emulators.

J. U. Lange, Mon. Not. R. Astron. Soc. 525 (2023) 3181. It begins from the prior alone, so that it would also find a
posterior's part that all climbs have missed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.inference.problem import Problem

# Points that bound the likelihood's shells, points simulated at once, and effective draws at the end. The evidence's
# error is far below the half nat that matters.
_LIVE, _BATCH, _EFFECTIVE = 1000, 256, 2000
# What the logarithm of an impossible likelihood is called: minus infinity would end the sampler.
_IMPOSSIBLE = -1e30


@dataclass(frozen=True)
class NestedEvidence:
    """What the nested sampler says of a model.

    Parameters
    ----------
    log_evidence : float
    effective_draws : float
    calls : int
        Parameter sets simulated.
    """

    log_evidence: float
    effective_draws: float
    calls: int


def require() -> Any:
    """Nautilus's sampler.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        from nautilus import Sampler
    except ImportError as error:
        raise InputError("nautilus is not installed", "pip install nautilus-sampler") from error
    return Sampler


def nested_evidence(
    problem: Problem,
    *,
    seed: int,
    n_live: int = _LIVE,
    effective: float = _EFFECTIVE,
    progress: Callable[[int], None] = lambda calls: None,
) -> NestedEvidence:
    """Evidence of a model by nested sampling.

    Parameters
    ----------
    problem : Problem
    seed : int
    n_live : int
        Live points.
    effective : float
        Effective draws at the end.
    progress : callable
        Called with the number of sets simulated so far.

    Returns
    -------
    NestedEvidence

    Raises
    ------
    InputError
        If nautilus is not installed.
    """
    calls = 0

    def log_likelihood(u: FloatArray) -> FloatArray:
        nonlocal calls
        calls += len(u)
        progress(calls)
        value = problem.log_likelihood(u)
        return np.where(np.isfinite(value), value, _IMPOSSIBLE)

    def prior(quantiles: FloatArray) -> FloatArray:
        return problem.prior_transform(np.clip(quantiles, 1e-12, 1 - 1e-12))

    sampler = require()(
        prior, log_likelihood, n_dim=problem.n_dim, n_live=n_live, n_batch=_BATCH, vectorized=True, pass_dict=False,
        seed=seed,
    )  # fmt: skip
    sampler.run(n_eff=effective, verbose=False)
    return NestedEvidence(float(sampler.log_z), float(sampler.n_eff), calls)

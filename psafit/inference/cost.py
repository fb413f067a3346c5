"""What a fit takes on this machine: measured on some of its readings, before it begins."""

from __future__ import annotations

import math
import os
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from psafit.inference.problem import Problem
from psafit.inference.starts import starts_of


@dataclass(frozen=True)
class Cost:
    """What a fit takes.

    Parameters
    ----------
    seconds : float
    memory : float
        Of its arrays at most, bytes.
    """

    seconds: float
    memory: float


def cost(
    problem: Problem,
    *,
    drawn: int = 32_000,
    optimised: int = 6_000,
    judged: int = 1024,
    sample: int = 500,
    draws: int = 64,
    batch: int = 16,
) -> Cost:
    """Estimate what a fit takes: both grow in proportion to the readings, and some of them are enough to measure it.

    The likelihood is timed where the sampler will be: at the best of some draws of the prior, in small batches. It is
    evaluated at every draw, and by the optimisations of the search. Memory is largest where the search judges its
    draws.

    Parameters
    ----------
    problem : Problem
    drawn : int
        Parameter sets that the sampler simulates until it has converged: 25,600 to 40,000 of the baseline, as a rule.
    optimised : int
        Parameter sets that optimisations, hops and profiles simulate: about 6000 of the baseline where two looks agree.
    judged : int
        Draws of the prior that the search judges at once.
    sample : int
        Readings on which it is measured, about.
    draws : int
        Of the prior.
    batch : int
        Sets that the sampler simulates at once.
    """
    n = problem.observed.size
    some = replace(problem, experiment=problem.experiment.thinned(max(n // sample, 1)))
    more = n / some.observed.size
    u = some.prior_transform(np.random.default_rng(0).random((draws, problem.n_dim)))
    log_posterior = some.log_posterior(u)  # compiles, too
    best = u[np.argsort(-np.where(np.isfinite(log_posterior), log_posterior, -np.inf), kind="stable")[:batch]]
    each = min(_timed(lambda: some.log_posterior(best)) for _ in range(3)) / len(best)
    search = _timed(lambda: starts_of(some, 0, 1, draws)) / draws
    tracemalloc.start()
    try:
        starts_of(some, 0, 1, draws)
        peak = tracemalloc.get_traced_memory()[1] / draws
    finally:
        tracemalloc.stop()
    return Cost(more * (each * (drawn + optimised) + search * judged), more * peak * judged)


def machine_memory() -> float:
    """Memory of this machine, bytes; infinite where it does not say."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def _timed(work: Callable[[], object]) -> float:
    begun = time.perf_counter()
    work()
    return time.perf_counter() - begun

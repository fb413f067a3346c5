"""From a model to its modes, the draws of its posterior, and its evidence: what all else trusts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from psafit.inference.ascent import ascend
from psafit.inference.candidate import Candidate, fit, principal, settle_at
from psafit.inference.evidence import Weighed, weigh
from psafit.inference.problem import Problem
from psafit.model_search.settings import SearchSettings


def sample(
    problem: Problem, known: Sequence[Candidate] = (), *, seed: int, settings: SearchSettings | None = None
) -> tuple[Candidate, Weighed]:
    """Fit a model, look for its other modes, and draw from its posterior.

    Two fits look for modes: one from what is known, the other from draws of the prior alone (of a model with many
    causes, from what is known with another seed). What the second adds to the first may be lacking once more, up to as
    much again as was found: it is a part of the error. A draw that lies above every mode says that the fits had not
    arrived: the model is fitted again from there, and drawn from again, as long as that leads higher.

    Parameters
    ----------
    problem : Problem
    known : sequence of Candidate
        Fits of the same model, or of parts of it, to begin from.
    seed : int
    settings : SearchSettings, optional

    Returns
    -------
    Candidate and Weighed
        The standard error of the log evidence holds what the second fit has added.
    """
    s = settings or SearchSettings()
    one, other = (look(problem, known, seed=seed, settings=s) for look in (first, second))
    return joined(problem, one, other, seed=seed, settings=s)


def first(problem: Problem, known: Sequence[Candidate], *, seed: int, settings: SearchSettings) -> Candidate:
    """Look for modes from what is known; parameters as of `sample`."""
    return fit(problem, known, seed=seed, draws=settings.draws, most=settings.starts)


def second(problem: Problem, known: Sequence[Candidate], *, seed: int, settings: SearchSettings) -> Candidate:
    """Look for modes once more, without `first`; parameters as of `sample`."""
    again = known if len(problem.terms) > settings.from_prior else ()
    return fit(problem, again, seed=seed + 1, draws=settings.draws, most=settings.starts)


def joined(
    problem: Problem, one: Candidate, other: Candidate, *, seed: int, settings: SearchSettings
) -> tuple[Candidate, Weighed]:
    """Put two looks for modes together, and draw from the posterior; see `sample`."""
    found = principal(settle_at(problem, np.vstack([one.modes, other.modes])))
    added = min(max(found.laplace_apart - one.laplace_apart, 0.0), math.log(2.0))
    draws = weigh(found, seed=seed)
    while draws.height > found.height + settings.better:
        higher = principal(settle_at(problem, ascend(problem, np.vstack([found.modes, draws.top[None]])).u))
        if higher.height <= found.height + settings.better:
            added = math.log(2.0)  # that draw is of a mode that cannot be climbed
            break
        found, draws = higher, weigh(higher, seed=seed)
    return found, replace(draws, error=math.hypot(draws.error, added))

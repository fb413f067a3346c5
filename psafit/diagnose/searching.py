"""The search as a diagnosis makes it: wherever one is compared with another, it is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from psafit.diagnose.misfit import passes
from psafit.inference.problem import Problem
from psafit.model_search import ModelSet, search_models
from psafit.physics.term import Term


def searched(problem: Problem, catalogue: Sequence[Term], *, seed: int, **options: Any) -> ModelSet:
    """Search the catalogue, with the tests of misfit to say whether the baseline fails.

    Parameters
    ----------
    problem : Problem
        The readings, with no cause.
    catalogue : sequence of Term
    seed : int
    **options
        Others of `psafit.model_search.search_models`.
    """
    catalogue = replace(problem, terms=tuple(catalogue)).terms  # with the priors that the experiment states
    judge = partial(passes, catalogue=catalogue, seed=seed)
    return search_models(problem, catalogue, seed=seed, passes=judge, **options)

"""The search among sets of causes: one reliable fit, one loop, and what was looked at; see `loop`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial

from psafit.errors import InputError
from psafit.inference.candidate import Candidate
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.model_search.fitter import Fitted, ProblemFitter
from psafit.model_search.loop import Ids, Model, Searched, search
from psafit.model_search.model_set import ModelSet, beliefs, log_prior, rank
from psafit.model_search.settings import SearchSettings
from psafit.physics.term import Term
from psafit.text import set_name
from psafit.workers import processes

__all__ = ["Ids", "ModelSet", "SearchSettings", "search_models"]


def search_models(
    problem: Problem,
    catalogue: Sequence[Term],
    *,
    seed: int,
    settings: SearchSettings | None = None,
    memory: Memory | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    starts: Sequence[Candidate] = (),
    held: Sequence[str] = (),
    passes: Callable[[Candidate], bool] = lambda candidate: True,
    progress: Callable[[str], None] = lambda what: None,
) -> ModelSet:
    """Search the catalogue for what explains the readings.

    Parameters
    ----------
    problem : Problem
        The readings, with no cause.
    catalogue : sequence of Term
    seed : int
    settings : SearchSettings, optional
    memory : Memory, optional
        Where fits are kept; those already there are not repeated.
    jobs : int
        Processes that share the fits. The result does not depend on it.
    scheduler : str, optional
        Address of a Dask scheduler whose workers share them instead; see `psafit.workers.processes`.
    starts : sequence of Candidate
        Models, fitted to other readings, that are fitted before all else, in addition to the one without causes.
    held : sequence of str
        Causes that somebody holds to be at work: what is named is sampled with them, too.
    passes : callable
        Whether the readings pass the tests of misfit by a model.
    progress : callable
        Called with what leads and what is being worked out, whenever there is news.

    Returns
    -------
    ModelSet
    """
    settings, believed = settings or SearchSettings(), beliefs(catalogue)
    if settings.most_causes < 1:
        raise InputError(f"most_causes = {settings.most_causes}", "choose 1 or more")
    with processes(jobs, scheduler) as usable:
        so_far = ""
        latest: list[ModelSet] = []

        def reached(what: str) -> None:
            nonlocal so_far
            so_far = what
            progress(what)

        def doing(what: str) -> None:
            progress(f"{so_far}; {what}" if so_far else what)

        def tested(model: Model[Fitted]) -> bool:
            doing(f"testing {set_name(model.ids)}")
            return passes(model.content.candidate)

        fitter = ProblemFitter(problem, catalogue, settings, seed, memory or Memory(None), usable, starts, doing)

        def decisive(found: Searched[Fitted]) -> tuple[Ids, ...]:
            latest[:] = [rank(found, believed, settings, partial(fitter.effects, found.models), held=held)]
            return latest[0].decisive

        with closing(fitter):
            search(
                [t.id for t in catalogue], fitter, lambda ids: log_prior(ids, believed), settings,
                starts=[c.ids for c in starts], passes=tested, decisive=decisive, progress=reached,
            )  # fmt: skip
            return latest[0]  # of what was found in the end

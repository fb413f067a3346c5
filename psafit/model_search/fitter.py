"""Fits and samples the models of one problem: what the search knows of readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import PsafitError
from psafit.inference.candidate import Candidate, FitSettings, candidate_at, candidate_of, fit, raced, subsampled
from psafit.inference.evidence import ImportanceSample
from psafit.inference.hopping import hopped
from psafit.inference.memory import Arrays, Memory
from psafit.inference.problem import Problem
from psafit.inference.sample import SampleSettings, first, joined, second
from psafit.inference.scan import widened
from psafit.inference.starts import joined_values
from psafit.model_search.loop import Foreseen, Ids, Model, reduced
from psafit.model_search.settings import SearchSettings
from psafit.model_search.visibility import Effects, effects, may_hide
from psafit.physics.term import Term
from psafit.text import set_name
from psafit.workers import unordered


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted model.

    Parameters
    ----------
    candidate : Candidate
    draws : ImportanceSample, optional
        Of its posterior, if it was sampled.
    begun : Candidate, optional
        The fit from which it was fitted in earnest.
    top : float
        The highest log posterior that was ever seen of it: what does not exceed that is no news.
    """

    candidate: Candidate
    draws: ImportanceSample | None = None
    top: float = -math.inf
    begun: Candidate | None = None


Known = Model[Fitted]


@dataclass(frozen=True, eq=False)
class ProblemFitter:
    """Models of a problem's readings, fitted within `psafit.workers.processes`.

    The fields are as of `psafit.model_search.search_models`, but `progress`: it is called with what is worked out.
    """

    problem: Problem
    catalogue: Sequence[Term]
    settings: SearchSettings
    seed: int
    memory: Memory
    jobs: int = 1
    starts: Sequence[Candidate] = ()
    progress: Callable[[str], None] = lambda what: None

    def short(self, wanted: Sequence[Ids], known: Mapping[Ids, Known]) -> list[Known]:
        """Fit models from their highest parts, from a few draws of the prior, and from where they are known."""
        tasks = list(self._short(wanted, known))
        found = self._done(tasks, "short fits")
        return [_estimated(_candidate(t.problem, a)) for t, a in zip(tasks, found, strict=True)]

    def carried(self, wanted: Sequence[Ids], known: Mapping[Ids, Known]) -> list[Known]:
        """Fit models from the optima of two that together have all their causes."""
        tasks = list(self._carried(wanted, known))
        found = self._done(tasks, "fits that begin at others' best values")
        return [_estimated(candidate_at(t.problem, a["u"])) for t, a in zip(tasks, found, strict=True)]

    def again(self, known: Sequence[Known], origin: Known) -> list[Known]:
        """Optimise models from where a neighbour has its optimum; only those that rise come back.

        Where no start has reached a mode of the neighbour, theirs may lie behind a hop, too.
        """
        own, there = [model.content.candidate for model in known], origin.content.candidate
        seed = self.seed if origin.sampled and not there.starts.all() else None
        tasks = [self._optimise(c.problem, (c, there), seed=seed) for c in own]
        risen = []
        for model, end in zip(known, self._done(tasks, "fits that begin at another's best values"), strict=True):
            before = model.content.candidate
            if end["height"][0] > max(before.log_posterior, model.content.top) + self.settings.better:
                risen.append(_estimated(candidate_at(before.problem, np.vstack([end["u"], before.modes])), model))
        return risen

    def earnest(self, model: Known, foreseen: Foreseen[Fitted] | None = None) -> Known:
        """Fit a model as one that is sampled."""
        short, look = model.content.candidate, self._looks(model)[0]
        (found,) = self._done([look], _looking(model), self._ahead(foreseen or _NOTHING))
        estimated = _estimated(_candidate(look.problem, found), model)
        return replace(estimated, earnest=True, content=replace(estimated.content, begun=short))

    def sample(self, model: Known, foreseen: Foreseen[Fitted] | None = None) -> Known:
        """Fit a model in earnest, look for other modes, and draw from its posterior.

        The first two looks for modes are taken side by side; processes that are idle meanwhile work ahead on what is
        foreseen.
        """
        short, looks = model.content.candidate, self._looks(model)
        problem, ahead = looks[0].problem, foreseen or _NOTHING
        # The look from the prior alone takes longest.
        other, one = (_candidate(problem, a) for a in self._done(looks[::-1], _looking(model), self._ahead(ahead)))
        drawing = f"{set_name(model.ids)} sampled"
        (kept,) = self._done([self._joined(model, one, other)], drawing, self._ahead(ahead))
        known = ("modes", "starts")
        values: dict[str, Any] = {name: a if a.ndim else float(a) for name, a in kept.items() if name not in known}
        draws, found = ImportanceSample(**values), candidate_at(problem, kept["modes"], kept["starts"].astype(np.intp))
        top = max(model.content.top, short.log_posterior, found.log_posterior)
        off = found.laplace_of_one - draws.log_evidence
        return Model(short.ids, draws.log_evidence, found.log_posterior, True, Fitted(found, draws, top), off, True)

    def effects(self, models: Mapping[Ids, Known], wanted: Sequence[Ids]) -> dict[Ids, Effects]:
        """Work out what the causes of some of the models do, over draws of their posteriors."""
        tasks = [self._effects(models[ids], models) for ids in wanted]
        return {
            ids: Effects(**found)
            for ids, found in zip(wanted, self._done(tasks, "sets asked how far each cause shows"), strict=True)
        }

    @cached_property
    def _starting(self) -> Iterator[None]:
        """Calls that end when the processes have started."""
        return unordered(self.jobs, _ready, [()] * self.jobs if self.jobs > 1 else ())

    def close(self) -> None:
        """Wait for processes that were begun and are not there yet."""
        if "_starting" in vars(self):
            for _ in self._starting:
                pass

    # --- pieces of work ---

    def _task(self, kind: str, problem: Problem, about: object, work: Callable[..., Arrays], *rest: Any) -> Task:
        return Task(self.memory.key(kind, problem, about), problem, work, rest)

    def _short(self, wanted: Sequence[Ids], known: Mapping[Ids, Known]) -> Iterator[Task]:
        """Short fits, each begun from the highest of the parts that lack one cause."""
        fitted, s = _highest_first(known), self.settings
        for ids in wanted:
            problem, best = self._shortly(ids), _parts(ids, fitted)
            own = [known[ids].content.candidate.modes] if ids in known else []
            rows = [c.placed(problem, len(c.modes)) for c in self.starts if c.ids == ids]
            extra = np.vstack([*own, *rows]) if own or rows else None
            begun = [[c.modes[:2].tolist() for c in best], [] if extra is None else extra.tolist()]
            about = [self.seed, s.short_draws, s.short_starts, s.short_climbs, s.from_prior, begun]
            yield self._task("short", problem, about, _short, best, extra, s, self.seed)

    def _carried(self, wanted: Sequence[Ids], known: Mapping[Ids, Known]) -> Iterator[Task]:
        """Optimise from the highest part, and from the model that has most of what it lacks, and then of the rest."""
        fitted = _highest_first(known)
        for ids in wanted:
            problem, (part,) = self._shortly(ids), _part(ids, fitted)
            lacking = {*ids} - {*part.ids}
            shared = [(len(lacking & {*c.ids}), len({*ids} & {*c.ids})) for c in fitted]
            nearest = fitted[shared.index(max(shared))]
            yield self._optimise(problem, (part, nearest), (nearest, part))

    def _shortly(self, ids: Ids) -> Problem:
        terms = tuple(t for t in self.catalogue if t.id in ids)
        return replace(self.problem, terms=terms, tolerance=self.settings.short_tolerance)

    def _optimise(self, problem: Problem, *pairs: tuple[Candidate, Candidate], seed: int | None = None) -> Task:
        """Optimise as long as a short fit does from the optima of two models, the second's first; hop if seeded."""
        s, begun = self.settings, [[c.modes[0].tolist() for c in pair] for pair in pairs]
        hopping = [] if seed is None else [seed, s.better]
        about = [s.carried_trial, s.carried_climbs, [[c.ids for c in pair] for pair in pairs], begun, *hopping]
        return self._task("optimised", problem, about, _optimised, pairs, s, seed)

    def _looks(self, model: Known) -> list[Task]:
        """The first two looks for the modes of a model that is to be sampled."""
        short, s = model.content.begun or model.content.candidate, self.settings
        problem = replace(short.problem, tolerance=s.tolerance)
        # A look from the prior alone is the same whatever is known.
        known = {"first": short.modes.tolist(), "second": short.modes.tolist() if len(short.ids) > s.from_prior else []}
        return [
            self._task(kind, problem, [*self._how, begun], _look, kind, short, s, self.seed)
            for kind, begun in known.items()
        ]

    def _joined(self, model: Known, one: Candidate, other: Candidate) -> Task:
        """The draws of a model that was looked at."""
        about = [*self._how, one.modes.tolist(), other.modes.tolist()]
        return self._task("sample", one.problem, about, _joined, one, other, self.settings, self.seed)

    def _effects(self, model: Known, models: Mapping[Ids, Known]) -> Task:
        own, draws, s = model.content.candidate, model.content.draws, self.settings
        known = [models.get(ids) for ids in reduced(own.ids)]
        parts = [one.content.candidate if one is not None and self._may_hide(one, model) else None for one in known]
        about = [
            *self._how, asdict(s.effects), own.modes.tolist(), None if draws is None else draws.top.tolist(),
            [None if one is None else [one.problem.tolerance, one.modes[0].tolist()] for one in parts],
        ]  # fmt: skip
        return self._task("effects", own.problem, about, effects, own, draws, parts, self.seed, s.effects)

    def _may_hide(self, part: Known, whole: Known) -> bool:
        s = self.settings
        errors = [m.content.draws.standard_error if m.content.draws else s.doubt for m in (part, whole)]
        low = 0.0 if part.sampled or part.earnest else s.short_by
        return may_hide(part.log_evidence, whole.log_evidence, 2.0 * math.hypot(*errors) + low)

    @property
    def _how(self) -> list[object]:
        """What looks and draws depend on besides a model."""
        return [self.seed, *(getattr(self.settings, field.name) for field in fields(SampleSettings))]

    def _ahead(self, foreseen: Foreseen[Fitted]) -> Iterator[Task]:
        """What is foreseen and not done yet: models to sample as far as that can begin, then short fits."""
        for model in foreseen.models:
            looks = self._looks(model)
            found = [self.memory.look(t.key) for t in looks]
            if None not in found:
                one, other = (_candidate(looks[0].problem, a) for a in found if a is not None)
                looks = [self._joined(model, one, other)]
            yield from (t for t in looks[::-1] if not self.memory.holds(t.key))
        yield from (t for t in self._carried(foreseen.sets, foreseen.known) if not self.memory.holds(t.key))

    def _done(self, tasks: Sequence[Task], what: str, ahead: Iterator[Task] | None = None) -> list[Arrays]:
        """Results of pieces of work, looked up or worked out; whoever is idle until the last of them works ahead."""
        found = {t.key: kept for t in tasks if (kept := self.memory.look(t.key)) is not None}
        left = {t.key: t for t in tasks if t.key not in found}

        total = len(found) + len(left)

        def reached() -> None:
            self.progress(f"{len(found)} of {total} {what}")

        if left:
            reached()
            more = next(ahead, None) if ahead and self.jobs > 1 else None
            # The model without causes is fitted here, while the processes start.
            shared = (len(left) > 1 or more is not None) and any(t.problem.terms for t in left.values())
            starting = self._starting
            for _ in starting if shared else ():
                pass
            idle = chain([more], ahead or ()) if more else ()
            for key, made in unordered(
                self.jobs if shared else 1, worked, _calls(left, found, idle), waiting=int(more is None)
            ):
                if made is not None:
                    kept = self.memory.keep(key, made)
                    found |= {key: kept} if key in left else {}
                    reached()
        return [found[t.key] for t in tasks]


@dataclass(frozen=True, eq=False)
class Task:
    """A piece of work that any process may do, and the name of its result; `work` gets the problem and `rest`."""

    key: str
    problem: Problem
    work: Callable[..., Arrays]
    rest: tuple[Any, ...]


_NOTHING: Foreseen[Fitted] = Foreseen((), (), {})


def _looking(model: Known) -> str:
    return f"thorough fits of {set_name(model.ids)}"


# Looks for the modes of a model, by the names of their results.
_LOOKS = {"first": first, "second": second}


def _ready() -> None:
    """Do nothing: what takes a new process its time is to import this module."""


def _calls(
    needed: Mapping[str, Task], done: Mapping[str, Arrays], ahead: Iterable[Task]
) -> Iterator[tuple[Task, bool]]:
    """What is needed, and then what is ahead until all that is needed is done; and whether it is needed."""
    yield from ((t, True) for t in needed.values())
    with suppress(PsafitError):  # what cannot be begun now is left to whoever needs it
        for t in ahead:
            if all(key in done for key in needed):
                return
            yield t, False


def worked(task: Task, needed: bool) -> tuple[str, Arrays | None]:
    """A piece of work; what fails and is not needed yet is left to whoever needs it."""
    try:
        return task.key, task.work(task.problem, *task.rest)
    except PsafitError:
        if needed:
            raise
        return task.key, None


def _arrays(candidate: Candidate) -> Arrays:
    # In one order of memory, wherever they were worked out: another adds up to other last digits.
    return {f.name: np.ascontiguousarray(getattr(candidate, f.name)) for f in fields(candidate) if f.name != "problem"}


def _candidate(problem: Problem, arrays: Mapping[str, Any]) -> Candidate:
    return Candidate(problem, **arrays)


def _short(
    problem: Problem, parts: Sequence[Candidate], extra: FloatArray | None, settings: SearchSettings, seed: int
) -> Arrays:
    """Fit a model shortly."""
    s, few = settings, len(problem.terms) <= settings.from_prior
    how: dict[str, Any] = {"draws": s.short_draws, "most": s.short_starts, "fresh": few}
    return _arrays(fit(problem, parts, seed=seed, extra=extra, settings=FitSettings(full=s.short_climbs), **how))


def _optimised(
    problem: Problem,
    pairs: Sequence[tuple[Candidate, Candidate]],
    settings: SearchSettings,
    seed: int | None,
) -> Arrays:
    """Where optimisations end, and hops if there is a seed.

    A strength that only the first of a pair knows is scanned with the second, too.
    """
    how = FitSettings(trial=settings.carried_trial, full=settings.carried_climbs)
    trial, known = subsampled(problem, how), []
    for pair in pairs:
        new = [t for t in problem.terms if t.id not in pair[1].ids]
        start = merged(problem, *pair)
        if not np.isfinite(trial.log_posterior(start[None])[0]):
            # Between two optima there may be nothing to simulate; at the second there is.
            start = pair[1].placed(problem)[0]
        known.append(widened(trial, start, new))
    starts = np.vstack(known)
    end, _ = raced(problem, trial, starts, [(starts, how.trial)], how)
    if seed is None or not np.isfinite(end.log_posterior).any():
        return {"u": end.u, "height": end.log_posterior}
    found = hopped(candidate_of(problem, end), seed=seed, better=settings.better)
    return {"u": found.modes, "height": found.log_posteriors}


def _look(problem: Problem, which: str, short: Candidate, settings: SearchSettings, seed: int) -> Arrays:
    """Look for the modes of a model."""
    return _arrays(_LOOKS[which](problem, [short], seed=seed, settings=settings))


def _joined(problem: Problem, one: Candidate, other: Candidate, settings: SearchSettings, seed: int) -> Arrays:
    """Draw from the posterior of a model that was looked at."""
    found, draws = joined(one, other, seed=seed, settings=settings)
    drawn = {name: np.asarray(value, float) for name, value in vars(draws).items()}
    return {"modes": found.modes, "starts": found.starts, **drawn}


def _highest_first(known: Mapping[Ids, Known]) -> list[Candidate]:
    return sorted((m.content.candidate for m in known.values()), key=lambda c: -c.log_posterior)


def _part(ids: Ids, fitted: Sequence[Candidate]) -> list[Candidate]:
    """The first model within a set, if there is one."""
    return [c for c in fitted if {*c.ids} < {*ids}][:1]


def _parts(ids: Ids, fitted: Sequence[Candidate], most: int = 2) -> list[Candidate]:
    """The first models that lack one cause of a set; where none does, the first that lacks more."""
    return [c for c in fitted if {*c.ids} < {*ids} and len(c.ids) + 1 == len(ids)][:most] or _part(ids, fitted)


def merged(problem: Problem, *candidates: Candidate) -> FloatArray:
    """A point of a model at the best modes of others; where several know a parameter, the last one's."""
    values: dict[str, float] = {}
    for c in candidates:
        values |= zip(c.problem.names, c.values.tolist(), strict=True)
    return joined_values(problem, values)


def _estimated(candidate: Candidate, before: Known | None = None) -> Known:
    """A model that was fitted, with Laplace's evidence; one that has risen has no less evidence than `before`."""
    estimate, least, top = candidate.laplace_of_one, -math.inf, candidate.log_posterior
    if before is not None:
        least, top = before.log_evidence if before.sampled else before.least, max(top, before.content.top)
        estimate = estimate if before.sampled else max(estimate, before.log_evidence)
    return Model(candidate.ids, estimate, candidate.log_posterior, False, Fitted(candidate, None, top), least=least)

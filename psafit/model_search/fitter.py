"""Fits and samples the models of one problem: what the search knows of readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.ascent import ascend
from psafit.inference.candidate import Candidate, fit, settle_at
from psafit.inference.evidence import Weighed
from psafit.inference.memory import Arrays, Memory
from psafit.inference.optimise import widened
from psafit.inference.problem import Problem
from psafit.inference.sample import sample
from psafit.model_search.loop import Ids, Model
from psafit.model_search.settings import SearchSettings
from psafit.physics.term import Term
from psafit.workers import unordered


@dataclass(frozen=True, eq=False)
class Fitted:
    """A fitted model.

    Parameters
    ----------
    candidate : Candidate
    draws : Weighed, optional
        Of its posterior, if it was sampled.
    top : float
        The highest log posterior that was ever seen of it: what does not exceed that is no news.
    """

    candidate: Candidate
    draws: Weighed | None = None
    top: float = -math.inf


Known = Model[Fitted]


@dataclass(frozen=True, eq=False)
class ProblemFitter:
    """Models of a problem's readings.

    Parameters
    ----------
    problem : Problem
        The readings, with no cause.
    catalogue : sequence of Term
    settings : SearchSettings
    seed : int
    memory : Memory
        Where fits are kept; those already there are not repeated.
    jobs : int
        Processes that share short fits (within `psafit.workers.processes`). The result does not depend on it.
    starts : sequence of Candidate
        Fits of other readings; the same models begin there.
    """

    problem: Problem
    catalogue: Sequence[Term]
    settings: SearchSettings
    seed: int
    memory: Memory
    jobs: int = 1
    starts: Sequence[Candidate] = ()

    def short(self, wanted: Sequence[Ids], known: Mapping[Ids, Known], origin: Known | None = None) -> list[Known]:
        """Fit models from the highest of their parts, and from a few draws of the prior."""
        fitted = sorted((m.content.candidate for m in known.values()), key=lambda c: -c.height)
        calls = [(k, *self._begun(ids, fitted)) for k, ids in enumerate(wanted)]
        modes = self._shared(_short, calls)
        return [_estimated(settle_at(call[1], modes[k]), origin) for k, call in enumerate(calls)]

    def again(self, known: Sequence[Known], origin: Known) -> list[Known]:
        """Optimise models from where a neighbour has its optimum; only those that rise come back."""
        starts = [_embedded(model.content.candidate, origin.content.candidate) for model in known]
        calls = [
            (k, model.content.candidate.problem, start, self.memory)
            for k, (model, start) in enumerate(zip(known, starts, strict=True))
        ]
        ends = self._shared(_again, calls)
        risen = []
        for k, model in enumerate(known):
            before, end = model.content.candidate, ends[k]
            if end["height"][0] > max(before.height, model.content.top) + self.settings.better:
                risen.append(_estimated(settle_at(before.problem, np.vstack([end["u"], before.modes])), origin, model))
        return risen

    def sample(self, model: Known) -> Known:
        """Fit a model in earnest, look for other modes, and draw from its posterior."""
        short, s = model.content.candidate, self.settings
        problem = replace(short.problem, tolerance=s.tolerance)

        def make() -> dict[str, FloatArray]:
            found, draws = sample(problem, [short], seed=self.seed, settings=s)
            return {"modes": found.modes, **{name: np.asarray(value, float) for name, value in vars(draws).items()}}

        about = [self.seed, s.draws, s.starts, s.from_prior, s.better, short.modes.tolist()]
        kept = self.memory.recall("sample", problem, about, make)
        values: dict[str, Any] = {name: a if a.ndim else float(a) for name, a in kept.items() if name != "modes"}
        draws, found = Weighed(**values), settle_at(problem, kept["modes"])
        top = max(model.content.top, short.height, found.height)
        return Model(short.ids, draws.log_evidence, True, Fitted(found, draws, top))

    def _shared(self, work: Callable[..., tuple[int, Any]], calls: Sequence[tuple[Any, ...]]) -> dict[int, Any]:
        """Results of calls that processes share, by their numbers."""
        return dict(unordered(max(min(self.jobs, len(calls)), 1), work, calls))

    def _begun(self, ids: Ids, fitted: Sequence[Candidate]) -> tuple[Problem, list[Candidate], FloatArray | None, Any]:
        """All that a short fit is begun from."""
        own = set(ids)
        terms = tuple(t for t in self.catalogue if t.id in own)
        problem = replace(self.problem, terms=terms, tolerance=self.settings.short_tolerance)
        best = [c for c in fitted if set(c.ids) < own][:1]
        extra = [rows[:1] for c in self.starts if c.ids == ids for rows in c.widened(problem, len(c.modes))]
        return problem, best, np.vstack(extra) if extra else None, (self.memory, self.settings, self.seed)


def _short(
    k: int,
    problem: Problem,
    parts: Sequence[Candidate],
    extra: FloatArray | None,
    how: tuple[Memory, SearchSettings, int],
) -> tuple[int, FloatArray]:
    """Modes of a short fit, and which of several it is."""
    memory, s, seed = how

    def make() -> dict[str, FloatArray]:
        found = fit(
            problem, parts, seed=seed, extra=extra, draws=s.short_draws, most=s.short_starts,
            fresh=len(problem.terms) <= s.from_prior, full=s.short_climbs,
        )  # fmt: skip
        return {"modes": found.modes}

    begun = [[c.modes[:2].tolist() for c in parts], [] if extra is None else extra.tolist()]
    about = [seed, s.short_draws, s.short_starts, s.short_climbs, s.from_prior, begun]
    return k, memory.recall("short", problem, about, make)["modes"]


def _again(k: int, problem: Problem, start: FloatArray, memory: Memory) -> tuple[int, Arrays]:
    """Where a climb ends, and which of several it is."""

    def make() -> dict[str, FloatArray]:
        end = ascend(problem, start[None])
        return {"u": end.u, "height": end.height}

    return k, memory.recall("again", problem, start.tolist(), make)


def _embedded(own: Candidate, origin: Candidate) -> FloatArray:
    """The best mode of a neighbour in a model's coordinates; what the neighbour lacks stays where the model has it."""
    values = dict(zip(own.problem.names, own.values, strict=True))
    there = dict(zip(origin.problem.names, origin.values, strict=True))
    values |= {name: value for name, value in there.items() if name in values}
    return widened(own.problem, np.array(list(values.values())), list(values))[0]


def _estimated(candidate: Candidate, origin: Known | None, before: Known | None = None) -> Known:
    """A model that was fitted, with Laplace's evidence.

    What sampling has shown that estimate to be off by in the model next to it, it is likely to be off by here. A model
    that has risen has no less evidence than `before`.
    """
    off = 0.0 if origin is None else origin.log_evidence - origin.content.candidate.laplace_apart
    least, top = (-math.inf, -math.inf) if before is None else (before.log_evidence, before.content.top)
    estimate = max(candidate.laplace_apart + off, least)
    return Model(candidate.ids, estimate, False, Fitted(candidate, None, max(candidate.height, top)))

"""How far long work is, how long the whole of it still takes, and a file that says so to others.

Work is planned as stages, each with a share of it. What the stages so far have taken, by what their shares were, is the
pace; the pace and the shares to come give the time left. Before a stage has been measured nothing is said.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from psafit.errors import InputError
from psafit.records import read_json, write_json

FIT = {"search": 1.0, "sample": 8.0, "profile": 0.5}
PAGE = {"validate": 0.8, "report": 2.0}
"""Shares of a fit's stages, in units of its search, and of what the command does after it.

Geometric means of three fits, next to other work on two cores, in seconds (search, sample, profile, validate, report):
the study's group 1 (3.4, 33, 2.4, 6, 10), its groups 2, 3 and 5 (5.3, 49, 2.3, 4, 19), group 1 with `flight_friction`
(21, 142, 9, 9, 19). A sampler that mixes slowly takes twenty times its share, so that a fit's own counts take their
place as soon as there are any.
"""
DIAGNOSIS = {
    "search": 1.0,
    "again": 0.5,
    "tests": 0.05,
    "proposals": 0.1,
    "others": 0.18,
    "gain": 0.15,
    "sampler": 0.3,
    "null": 0.5,
    "nautilus": 0.5,
}
"""Shares of a diagnosis' parts, in units of one search among causes over all groups.

Tests, proposals and what other causes could do: geometric means of three quick diagnoses of one cause, 58 to 77 sets,
in seconds (56, 3.0, 6.0, 11.5; 52, 1.4, 3.9, 5.9; 24, 1.8, 2.9, 5.8; 30 November 2026). The longer the search, the less
they matter.

The rest is from two diagnoses next to other work on two cores. A rig of three groups with nothing hidden and four
causes, one process: 102 a search, again from its parts 88, tests 10, proposals 2, nested gain 16. One with a cause
hidden and two causes: 61 a search, again 0.4, tests 6, a sampler 63 and 30. `null`, a search where nothing is hidden,
is half of one that finds a cause in the campaigns of docs/challenge.md; `nautilus` is a guess. (Measured with the
search of version 0.1.0.) The searches are measured within the run before any of this is used.
"""
OPEN = ("sample", "adopted extension", "strict extension")
"""Parts that end by a rule of their own: what a chain takes is known from below, as its autocorrelation time is."""
COUNTED = ("sample", "profile", "significance", "calibration")
"""Stages whose counts run from nought to the end."""

PROGRESS = "progress.json"
"""In the folder of work under way or interrupted; removed at its end."""


class Watcher(Protocol):
    """Whoever shows the progress of a run."""

    def stage(self, name: str) -> None:
        """Begin a stage."""

    def update(self, done: float, total: float | None, note: str = "") -> None:
        """Report how far the stage is; `total` is None where nobody can know."""

    def part(self, name: str, fraction: float | None = None) -> None:
        """Report which part of the whole this is, and how much of that is done where the stage's counts do not say."""

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        """Report the time left of the whole; None where nothing is known of it."""


class Silent:
    """A watcher that shows nothing."""

    def stage(self, name: str) -> None:
        """Do nothing."""

    def update(self, done: float, total: float | None, note: str = "") -> None:
        """Do nothing."""

    def part(self, name: str, fraction: float | None = None) -> None:
        """Do nothing."""

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        """Do nothing."""


@dataclass(frozen=True)
class Progress:
    """`progress.json`: how far work is.

    Parameters
    ----------
    kind : {"fit", "diagnosis"}
    identity : str
        SHA-256 of all that determines the result.
    stage : str
    done, total : float, optional
        Counts of the stage.
    note : str
        What is counted.
    seconds : dict
        Spent on each part of the plan, earlier sessions included.
    left : float, optional, s
        Of the whole; None where nothing is known of it.
    written : float
        Seconds since the epoch.
    """

    kind: str
    identity: str
    stage: str
    done: float | None
    total: float | None
    note: str
    seconds: dict[str, float]
    left: float | None
    written: float


def progress_of(folder: Path) -> Progress | None:
    """What work under way or interrupted in a folder has said of itself; None where there is nothing to read."""
    try:
        return read_json(folder / PROGRESS, Progress)
    except InputError:
        return None


class Forecast:
    """Time left of a plan.

    Parameters
    ----------
    plan : mapping of str to float
        Share of each part, in the order in which they come; of what is skipped nothing is counted.
    earlier : mapping of str to float, s
        Spent on parts by earlier sessions of the same work.
    """

    def __init__(self, plan: Mapping[str, float], earlier: Mapping[str, float] | None = None) -> None:
        self._plan = dict(plan)
        self._earlier = dict(earlier or {})
        self._spent = dict(self._earlier)
        self._worked = {name: self._plan[name] for name in self._spent if name in self._plan}
        self._part: str | None = None
        self._begun = 0.0
        self._reached: tuple[float, float] | None = None  # what is done, and the total as far as it is known
        self._first: tuple[float, float] | None = None  # what was done at the first count of this session, and when

    def begin(self, part: str, now: float) -> None:
        """Begin a part; the one before it is done."""
        if self._part is not None:
            self._spent = self.seconds(now)
            found = self._first[0] if self._first and self._part not in self._earlier else 0.0
            done = 1.0 - (found / self._reached[1] if self._reached else 0.0)
            self._worked[self._part] = self._plan.get(self._part, 0.0) * done
        self._part, self._begun, self._reached, self._first = part, now, None, None

    def reach(self, done: float, now: float, total: float = 1.0) -> None:
        """Say how much of the part is done; its total may grow, and another count may begin."""
        if self._reached and self._first and done < self._reached[0] and total != self._reached[1]:
            # A part has several counts: what the one before has done is kept, in the unit of this one.
            scale = total / self._reached[1]
            self._first = self._first[0] * scale, self._first[1]
            self._reached = self._reached[0] * scale, total
        self._first = self._first or (done, now)
        before = self._reached[0] if self._reached else 0.0
        self._reached = max(done, before), total  # some read back what others have counted

    @property
    def is_open(self) -> bool:
        """Whether what is left is known from below only."""
        names = list(self._plan)
        here = names.index(self._part) if self._part in names else 0
        return any(name in OPEN for name in names[here:])

    def seconds(self, now: float) -> dict[str, float]:
        """Time spent on each part so far."""
        if self._part is None:
            return dict(self._spent)
        return self._spent | {self._part: self._spent.get(self._part, 0.0) + now - self._begun}

    def left(self, now: float) -> float | None:
        """Seconds until all is done; None before anything has been measured."""
        names = list(self._plan)
        if self._part not in names:
            return None
        place = names.index(self._part)
        before = [n for n in names[:place] if n in self._spent]
        took, worked = sum(self._spent[n] for n in before), sum(self._worked[n] for n in before)
        spent, own = self.seconds(now)[self._part], None
        # A session that goes on where another stopped has not drawn what it finds; what that took may be on record.
        first, since = (0.0, now - spent) if self._part in self._earlier else self._first or (0.0, now)
        if self._reached and self._reached[0] > first and now > since:
            done, total = self._reached
            own = (now - since) * (total - done) / (done - first)
            took, worked = took + now - since, worked + self._plan[self._part] * (done - first) / total
        if not (took > 0 and worked > 0):
            return None
        pace = took / worked
        if own is None:
            own = max(pace * self._plan[self._part] - spent, 0.0)
        return own + pace * sum(self._plan[n] for n in names[place + 1 :])


class Reporter:
    """A watcher that passes on what it hears, adds the time left of the whole, and keeps `progress.json`.

    Parameters
    ----------
    inner : Watcher
        Who shows it.
    folder : Path
        Of the work.
    kind, identity : str
        See `Progress`.
    plan : mapping of str to float
        See `Forecast`.
    counted : collection of str
        Stages whose counts say how much of them is done.
    every : float, s
        Least time between writes of the file.
    """

    def __init__(
        self,
        inner: Watcher,
        folder: Path,
        kind: str,
        identity: str,
        plan: Mapping[str, float],
        counted: Collection[str] = (),
        every: float = 2.0,
    ) -> None:
        self._inner, self._file = inner, folder / PROGRESS
        self._kind, self._identity, self._counted, self._every = kind, identity, counted, every
        self._plan = plan
        before = progress_of(folder)
        same = before is not None and (before.kind, before.identity) == (kind, identity)
        self._forecast = Forecast(plan, before.seconds if before and same else None)
        self._stage = ""
        self._counts: tuple[float | None, float | None, str] = None, None, ""
        self._written = -every

    def stage(self, name: str) -> None:
        """Begin a stage, and the part of the plan that has its name."""
        self._inner.stage(name)
        self._stage, self._counts = name, (None, None, "")
        if name in self._plan:
            self.part(name)
        self._say(at_once=True)

    def part(self, name: str, fraction: float | None = None) -> None:
        """Begin a part of the plan, or say how much of it is done."""
        now = time.monotonic()
        if fraction is None:
            self._forecast.begin(name, now)
        else:
            self._forecast.reach(fraction, now)

    def update(self, done: float, total: float | None, note: str = "") -> None:
        """Report how far the stage is."""
        self._counts = done, total, note
        if total and self._stage in self._counted:
            self._forecast.reach(done, time.monotonic(), total)
        self._say()
        self._inner.update(done, total, note)

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        """Pass on what somebody else knows of the whole."""
        self._inner.whole(seconds, at_least=at_least)

    def _say(self, *, at_once: bool = False) -> None:
        now = time.monotonic()
        left = self._forecast.left(now)
        self._inner.whole(left, at_least=self._forecast.is_open)
        if at_once or now - self._written >= self._every:
            self._written = now
            seconds = {name: round(s, 3) for name, s in self._forecast.seconds(now).items()}
            record = Progress(self._kind, self._identity, self._stage, *self._counts, seconds, left, time.time())
            with suppress(InputError):  # a full disk ends the work where its result is written, not here
                write_json(self._file, record)


@contextmanager
def reporting(
    watcher: Watcher, folder: Path, kind: str, identity: str, plan: Mapping[str, float], counted: Collection[str] = ()
) -> Iterator[Watcher]:
    """Report work to a watcher and in its folder; what is part of larger work reports as that."""
    if isinstance(watcher, Reporter):
        yield watcher
        return
    yield Reporter(watcher, folder, kind, identity, plan, counted)
    with suppress(OSError):
        (folder / PROGRESS).unlink(missing_ok=True)

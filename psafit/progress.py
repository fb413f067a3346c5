"""Progress of long work on standard error: bars on a terminal, one line a stage elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from psafit.forecast import Silent, Watcher
from psafit.heartbeat import repeated

TITLES = {
    "search": "search for minima (lmfit)",
    "weigh": "sample the posterior by importance",
    "sample": "sample the posterior",
    "climb": "optimisation to a minimum that the search missed (lmfit)",
    "profile": "profile the likelihood",
    "validate": "validate on all groups",
    "reproduce": "recompute the study",
    "parts": "search the causes, without some of the groups",
    "causes": "search the causes",
    "tests": "test the baseline and its best extension",
    "next experiment": "look for the best next measurement",
    "other causes": "see what the other causes could still do",
    "isolability": "compare what causes would do",
    "significance": "repeat the search where nothing is hidden",
    "calibration": "diagnose data sets drawn from the answer",
    "nautilus": "evidence by a nested sampler",
    "strict gain": "strict gain: causes from the training groups alone",
    "nested gain": "nested gain: causes without each group in turn",
    "report": "write the report",
}


def duration(seconds: float) -> str:
    """A time that is known roughly, in the unit that suits it."""
    minutes, hours = seconds / 60, seconds / 3600
    return f"{seconds:.0f} s" if seconds < 100 else f"{minutes:.0f} min" if minutes < 100 else f"{hours:.0f} h"


def counted(done: float, total: float | None, note: str) -> str:
    """How far a stage is, in words."""
    return note if total is None or total <= 1 else f"{done:.0f} of {total:.0f} {note}"


def _left(seconds: float | None, what: str = "in all", *, at_least: bool = False) -> str:
    """What is left; nothing where that is not known, or an estimate has run out."""
    how = "at least" if at_least else "about"
    return "" if seconds is None or round(seconds) < 1 else f"{how} {duration(seconds)} left {what}"


def _end(seconds: float | None) -> float | None:
    """When what takes so many seconds from now will be done: they pass while nothing else is heard."""
    return None if seconds is None else time.monotonic() + seconds


def _until(end: float | None, at_least: bool) -> str:
    return _left(None if end is None else end - time.monotonic(), at_least=at_least)


class _Whole(ProgressColumn):
    """What is left of the whole."""

    def render(self, task: Task) -> Text:
        return Text(_until(task.fields["end"], task.fields["at_least"]))


class _Cut(TextColumn):
    """A text in a line, of which the end gives way where there is little room."""

    def render(self, task: Task) -> Text:
        text = super().render(task)
        text.no_wrap, text.overflow = True, "ellipsis"
        return text


class _Bars(Silent):
    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._task: TaskID | None = None
        self._end: float | None = None
        self._at_least = False

    def stage(self, name: str) -> None:
        self.finish()
        self._task = self._bars.add_task(TITLES[name], total=None, note="", end=self._end, at_least=self._at_least)

    def update(self, done: float, total: float | None, note: str = "") -> None:
        if self._task is not None:
            self._bars.tasks[self._task].total = total  # an update takes None for no news
            self._bars.update(self._task, completed=done, note=counted(done, total, note))

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        self._end, self._at_least = _end(seconds), at_least
        if self._task is not None:
            self._bars.update(self._task, end=self._end, at_least=at_least)

    def finish(self) -> None:
        if self._task is not None:
            task = self._bars.tasks[self._task]
            total = task.total or 1.0
            self._bars.update(self._task, completed=total, total=total, end=None)


class _Lines(Silent):
    """For logs: a line when a stage begins, and one whenever `say` is called."""

    def __init__(self) -> None:
        self._begun = time.monotonic()
        self._stage = ""
        self._first: tuple[float, float] | None = None  # what was done when, where the count began
        self._latest: tuple[float, float | None, str, float] | None = None  # what was reported last, and when
        self._end: float | None = None
        self._at_least = False

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        self._end, self._at_least = _end(seconds), at_least

    def stage(self, name: str) -> None:
        self._stage, self._first, self._latest = TITLES[name], None, None
        self._print(self._stage)

    def update(self, done: float, total: float | None, note: str = "") -> None:
        now = time.monotonic()
        if self._first is None or self._latest is None or done < self._latest[0]:  # a stage may count more than once
            self._first = (done, now)
        self._latest = done, total, note, now

    def say(self) -> None:
        """Print what was reported last; the stage again, where it has not reported yet; nothing before the first."""
        state, this = self._stage, None
        if self._latest and self._first:
            done, total, note, heard = self._latest
            state = counted(done, total, note)
            if total is not None and done > self._first[0]:
                this = (heard - self._first[1]) / (done - self._first[0]) * (total - done)
                this -= time.monotonic() - heard
        left = ", ".join(filter(None, (_left(this, "of this"), _until(self._end, self._at_least))))
        if state:
            self._print("  " + "; ".join(filter(None, (state, left))))

    def _print(self, text: str) -> None:
        print(f"[{time.monotonic() - self._begun:5.1f} s] {text}", file=sys.stderr, flush=True)


@contextmanager
def watcher(quiet: bool, every: float = 10.0) -> Iterator[Watcher]:
    """Show progress the way standard error allows, or not at all; in a log every so many seconds."""
    if quiet or sys.stderr is None:  # nobody's, where it was closed
        yield Silent()
    elif sys.stderr.isatty():
        columns = (
            _Cut("{task.description}", table_column=Column()),
            BarColumn(bar_width=8, table_column=Column(no_wrap=True)),
            TimeElapsedColumn(table_column=Column(no_wrap=True)),
            TimeRemainingColumn(table_column=Column(no_wrap=True)),
            _Whole(table_column=Column(no_wrap=True)),
            _Cut("{task.fields[note]}", style="dim", table_column=Column()),
        )
        with Progress(*columns, console=Console(stderr=True)) as bars:
            show = _Bars(bars)
            yield show
            show.finish()
    else:
        lines = _Lines()
        with repeated(lines.say, every):
            yield lines

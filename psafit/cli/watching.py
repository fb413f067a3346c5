"""`psafit watch`: how far a running fit or diagnosis is."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from psafit.cli.common import (
    DONE,
    JSON,
    QUIET,
    Command,
    Place,
    escaped,
    write_result,
)
from psafit.errors import InputError
from psafit.text import fixed

if TYPE_CHECKING:
    from rich.table import Table

    from psafit.watch import DiagnosisState, State


@click.command(cls=Command, short_help="Show how far a fit or diagnosis is.")
@click.argument("run", metavar="RUN", type=Place("input"))
@click.option("--once", is_flag=True, help="Say how far it is, and end.")
@click.option(
    "--every", type=click.FloatRange(0.1, 86400), default=2.0, show_default=True, help="Seconds between looks."
)
@QUIET
@JSON
def watch(run: Path, once: bool, every: float, quiet: bool, json_file: Path | None) -> int:
    """Show how far a running fit or diagnosis is, until it has ended.

    It only reads: nothing in the folder is changed or locked. Ctrl-C ends the watching, not the work.
    """
    import sys

    from psafit.watch import look

    if math.isnan(every):
        raise InputError("--every nan is no time", "give seconds")
    state = look(run)
    if once or state.finished:
        if not quiet:
            click.echo(_line(state))
    else:
        show = _looks if quiet else _live if sys.stdout.isatty() else _lines
        with suppress(KeyboardInterrupt):
            for found in show(run, state, every):
                state = found
    write_result(json_file, state)
    return DONE


def _looks(run: Path, state: State | DiagnosisState, every: float) -> Any:
    """One state after the other, until nothing more will come."""
    from psafit.watch import look

    while True:
        yield state
        if state.finished:
            return
        time.sleep(every)
        state = look(run, state)


def _lines(run: Path, state: State | DiagnosisState, every: float) -> Any:
    """A line whenever something has changed."""
    said = ""
    for found in _looks(run, state, every):
        if (line := _line(found)) != said:
            said = line
            click.echo(line)
        yield found


def _live(run: Path, state: State | DiagnosisState, every: float) -> Any:
    """A table that stays in its place."""
    from rich.live import Live

    with Live(auto_refresh=False) as live:
        for found in _looks(run, state, every):
            live.update(table_of(run, found), refresh=True)
            yield found


_STAGES = {
    "search": "searching for minima; sampling has not begun",
    "sample": "sampling",
    "profile": "the chain is long enough; describing the posterior",
    "done": "done",
    "gave up": "gave up before it converged; repeat the psafit fit command to draw on",
}


def _facts_of(state: State | DiagnosisState) -> tuple[str, list[tuple[str, str]]]:
    """What it does, and the facts to report, each with its goal and unit."""
    from psafit.watch import State

    return (_stage(state), _facts(state)) if isinstance(state, State) else (_doing(state), _counts(state))


def _doing(state: DiagnosisState) -> str:
    """What a diagnosis does."""
    from psafit.progress import TITLES

    if state.finished:
        return f"done; {state.headline}"
    if state.running is False:
        return "interrupted: nothing works in this folder now; repeat the psafit diagnose command to go on"
    return TITLES.get(state.stage, "under way")


def _counts(state: DiagnosisState) -> list[tuple[str, str]]:
    """How far it is."""
    from psafit.progress import counted, duration

    facts = []
    if not state.finished and state.done is not None and (text := counted(state.done, state.total, state.note)):
        facts.append(("stage", text))
    facts.append(("models fitted on all readings" if state.finished else "short fits kept", f"{state.models}"))
    if state.seconds is not None:
        facts.append(("time spent", duration(state.seconds)))
    if state.whole_left is not None and state.running is not False:
        facts.append(("time left", f"about {duration(state.whole_left)} in all"))
    return facts


def _stage(state: State) -> str:
    if state.running is False and not state.finished:
        return "interrupted: nothing works in this folder now; repeat the psafit fit command to go on"
    if state.stalled:
        return "no new checkpoint for long: has it been stopped? Repeat the psafit fit command to go on"
    if state.stage == "sample" and state.steps is None:
        return "sampling; no checkpoint yet"
    return _STAGES[state.stage]


def _facts(state: State) -> list[tuple[str, str]]:
    """How far a fit is, each with its goal and unit."""
    from psafit.inference.store import rounded_r_hat
    from psafit.progress import duration

    s = state
    facts = []
    if s.steps is not None:
        facts.append(("steps", f"{s.steps} of each of {s.walkers} walkers" if s.walkers else f"{s.steps}"))
    if s.acceptance is not None:
        facts.append(("acceptance", f"{fixed(s.acceptance, per_cent=True)} %"))
    if s.autocorrelation_times is not None and s.autocorrelation_time is not None:
        length = f"{math.floor(s.autocorrelation_times)} autocorrelation times of {s.autocorrelation_time:.0f} steps"
        facts.append(("length", length + (f" (goal {s.wanted_times:.0f})" if s.wanted_times is not None else "")))
    if s.r_hat is not None and s.wanted_r_hat is not None:
        facts.append(("R-hat", f"{rounded_r_hat(s.r_hat, s.wanted_r_hat)} (goal {s.wanted_r_hat:g})"))
    if s.log_posterior is not None and s.best_minimum is not None:
        facts.append(("best log posterior", f"{fixed(s.log_posterior, 2)} (the search's {fixed(s.best_minimum, 2)})"))
    elif s.best_minimum is not None:
        facts.append(("best log posterior", f"{fixed(s.best_minimum, 2)}, of the search"))
    if s.seconds_left is not None and not s.stalled:
        # A short chain makes the autocorrelation time too short.
        long = (s.autocorrelation_times or 0.0) >= 0.5 * (s.wanted_times or 0.0)
        facts.append(("time left", f"{'about' if long else 'at least'} {duration(s.seconds_left)}"))
    if s.whole_left is not None:
        facts.append(("time left of the whole", f"about {duration(s.whole_left)}"))
    return facts


def _line(state: State | DiagnosisState) -> str:
    stage, facts = _facts_of(state)
    return escaped("; ".join([stage, *(f"{name} {text}" for name, text in facts)]))


def table_of(run: Path, state: State | DiagnosisState) -> Table:
    """What is known of work under way, as rows for a terminal."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    stage, facts = _facts_of(state)
    table.add_row(Text(escaped(run.name), style="bold"), Text(escaped(stage)))
    done, total = getattr(state, "autocorrelation_times", None), getattr(state, "wanted_times", None)
    if done is not None and total is not None:
        table.add_row("", ProgressBar(total=total, completed=done, width=40))
    for name, text in facts:
        table.add_row(Text(name, style="dim"), Text(escaped(text)))
    return table

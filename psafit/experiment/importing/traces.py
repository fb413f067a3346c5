"""Samples of traces as psafit counts them: from the start of the drive, from rest, and one in so many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from statistics import mean

import numpy as np

from psafit.drives import Drive
from psafit.errors import Faults, InputError
from psafit.experiment.importing.blocks import blocks, runs_on
from psafit.experiment.importing.chosen import VOLTAGE
from psafit.experiment.importing.clock import early, less
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.recorded import at_amplitude, drive_of
from psafit.experiment.importing.records import Options, file_of
from psafit.experiment.importing.values import Reading
from psafit.experiment.records import CONDITION_COLUMNS, Group
from psafit.experiment.table import CellFault, RowFaults
from psafit.experiment.trace_table import TIME, TRACES, out_of_order, possible


@dataclass(frozen=True)
class Trace:
    """The samples of one trace that are used, and its drive."""

    samples: tuple[Reading, ...]
    drive: Drive


@dataclass(frozen=True)
class Sampled:
    """Traces, the lines of samples before the start, and what was subtracted, by psafit's columns."""

    traces: tuple[Trace, ...]
    before: frozenset[int]
    zeros: dict[str, float]


def from_start(grid: Grid, found: Sequence[Reading], options: Options) -> Sampled:
    """Count the samples of traces from the start of the drive, and from rest where that is asked for.

    Parameters
    ----------
    grid : Grid
    found : sequence of Reading
        Of one table, on the clock of the instrument.
    options : Options

    Raises
    ------
    InputError
        Where times lie before 0 and no start is given, are out of order or run on from trace to trace; where samples
        are too few or too many.
    """
    faults, traces, lines = Faults(), [], set()
    start = options.start_us or 0.0
    zeros = {TIME: start} if start else {}
    parts = [part for part in _apart(grid, found) if _motion(part)]
    short = [part for part in parts if _n_kept(part, start, options) < options.least_samples]
    for part in parts:
        before = early(grid, part, options)
        lines |= {r.line for r in before}
        column = _motion(part)
        zero = 0.0
        if options.from_rest and not before:
            what, remedy = "no sample lies before the start of the drive", "leave out --from-rest, or say --start"
            raise InputError(what, remedy, file=grid.file, line=part[0].line)
        if options.from_rest:
            zero = float(mean(Decimal(repr(v)) for r in before if (v := dict(r.values).get(column)) is not None))
            if sum(column == _motion(p) for p in parts) == 1:
                zeros[column] = zero
        with faults.kept():
            rows = [less(reading, {TIME: start, column: zero}) for reading in part]
            read = [r for r in rows[len(before) :] if column in dict(r.values)]
            _check(grid, read, len(rows) - len(before), options)
            samples, drive = read[:: options.every], drive_of(grid, rows, options)
            traces.append(Trace(tuple(at_amplitude(grid, samples, drive)), drive))
    if short and not len(faults):
        faults.add(_too_few(grid, short, len(parts), start, options))
    faults.end()
    return Sampled(tuple(traces), frozenset(lines), zeros)


def _motion(part: Sequence[Reading]) -> str:
    """The column of a trace's motion; empty where none of its samples has one."""
    return next((name for r in part for name, _ in r.values if name in TRACES), "")


def _apart(grid: Grid, found: Sequence[Reading]) -> list[list[Reading]]:
    """The samples of each trace, in the order of their first rows.

    Raises
    ------
    InputError
        Where a time goes on from one condition to the next.
    """
    columns: dict[int, list[Reading]] = {}
    for reading in found:
        columns.setdefault(reading.place, []).append(reading)
    apart: list[list[Reading]] = []
    for samples in columns.values():
        values = [dict(r.values) for r in samples]
        keys = [
            (r.drive, r.group, r.session, *(v[n] for n in CONDITION_COLUMNS))
            for r, v in zip(samples, values, strict=True)
        ]
        times = [v[TIME] for v in values]
        parts = blocks(keys, times)
        if (at := runs_on(parts, times)) is not None:
            what = f"{TIME} goes on to {times[at]:g} where another trace begins, and its drive starts at a time unknown"
            remedy = "count the time of each trace from the start of its own drive"
            remedy = remedy if grid.counts is None else "give each trace a column or a file of its own"
            raise InputError(what, remedy, file=grid.file, line=samples[at].line)
        apart += [[samples[k] for k in part] for part in parts]
    return sorted(apart, key=lambda part: (part[0].line, part[0].place))


def _n_kept(part: Sequence[Reading], start: float, options: Options) -> int:
    samples = (dict(r.values) for r in part)
    return -(-sum(s[TIME] >= start and not TRACES.keys().isdisjoint(s) for s in samples) // options.every)


def _too_few(
    grid: Grid, short: Sequence[Sequence[Reading]], n_traces: int, start: float, options: Options
) -> InputError:
    n = _n_kept(short[0], start, options)
    what = f"{n} sample{'s' * (n != 1)} after the start of the drive; a trace has at least {options.least_samples}"
    remedy = "record more, or keep more of them"
    if n_traces > 1:
        what = f"{what}, and {len(short)} of {n_traces} traces have fewer"
        remedy = (
            f"{remedy}; sort the rows by trace and time; a column that changes within a trace is no condition of it"
        )
    return InputError(what, remedy, file=grid.file, line=short[0][0].line)


def _check(grid: Grid, samples: Sequence[Reading], n_after: int, options: Options) -> None:
    """The samples of one trace are possible and in order; those kept, and those of a drive, are not too many."""
    faults, times = RowFaults(grid.file), [dict(reading.values)[TIME] for reading in samples]
    for k, (reading, time) in enumerate(zip(samples, times, strict=True)):
        try:
            possible(time, TIME, f"{time:g} us")
            if k and time < times[k - 1]:
                raise CellFault(*out_of_order(times[k - 1], time))
            if k and k % options.every == 0 and time == times[k - options.every]:
                rounded = "of a rounded clock say --column HEADING=ignore and --step TIME"
                raise CellFault(f"{time:g} comes twice", f"give each time once; {rounded}")
        except CellFault as fault:
            faults.add(TIME, fault.what, fault.remedy, reading.line)
    faults.end(len(samples))
    recorded = bool(samples) and VOLTAGE in dict(samples[0].values)
    n = n_after if recorded else -(-len(samples) // options.every)
    if n > options.most_samples:
        every = -(-len(samples) // options.most_samples)
        remedy = "leave out the end of the record" if recorded else f"keep one in so many: --every {every}"
        what = f"{n} samples after the start of the drive; a trace has at most {options.most_samples}"
        raise InputError(what, remedy, file=grid.file, line=samples[0].line)


def trace_of(number: int, trace: Trace) -> Group:
    """The samples of one trace as a group."""
    part = trace.samples
    values = {name: np.array([dict(r.values)[name] for r in part]) for name, _ in part[0].values}
    (column,) = TRACES.keys() & values.keys()
    drive = trace.drive
    return Group(
        number,
        replace(drive, file=f"drive{number}.csv") if drive.recorded and not drive.file else drive,
        file_of(number),
        values["frequency_hz"],
        values["amplitude_v"],
        time_us=values[TIME],
        measured=np.full(len(part), TRACES[column], np.int8),
        reading=values[column],
        session=part[0].session,
    )

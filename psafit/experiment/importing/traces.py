"""Samples of traces as psafit counts them: from the start of the drive, from rest, and one in so many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from statistics import mean

import numpy as np

from psafit.errors import Faults, InputError
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.values import Reading, groups_of
from psafit.experiment.records import Group
from psafit.experiment.table import CellFault, RowFaults
from psafit.experiment.trace_table import TIME, TRACES, out_of_order, possible


@dataclass(frozen=True)
class Sampled:
    """Samples that are used, the lines of those before the start, and what was subtracted, by psafit's columns."""

    found: tuple[Reading, ...]
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
        Where times lie before 0 and no start is given, or are out of order; where samples are too few or too many.
    """
    faults, kept, lines = Faults(), [], set()
    start = options.start_us or 0.0
    zeros = {TIME: start} if start else {}
    for part in groups_of(found).values():
        before = [r for r in part if dict(r.values)[TIME] < start]
        lines |= {r.line for r in before}
        if before and options.start_us is None:
            what = f"{TIME} begins at {dict(before[0].values)[TIME]:g}, before the start of the drive"
            remedy = "say --start 0 where that is at 0, or when it is: --start 1.5:ms; what lies before is left out"
            faults.add(InputError(what, remedy, file=grid.file, line=before[0].line))
            continue
        (column,) = TRACES.keys() & dict(part[0].values).keys()
        zero = 0.0
        if options.from_rest and not before:
            what, remedy = "no sample lies before the start of the drive", "leave out --from-rest, or say --start"
            faults.add(InputError(what, remedy, file=grid.file, line=part[0].line))
        elif options.from_rest:
            zero = zeros[column] = float(mean(Decimal(repr(dict(r.values)[column])) for r in before))
        with faults.kept():
            rows = part[len(before) :: options.every]
            kept += _shifted(grid, rows, {TIME: start, column: zero}, options)
    faults.end()
    return Sampled(tuple(kept), frozenset(lines), zeros)


def _shifted(grid: Grid, part: Sequence[Reading], zeros: dict[str, float], options: Options) -> list[Reading]:
    """The samples of one trace, less what is to be subtracted; checked."""
    rows, faults = [], RowFaults(grid.file)
    last = -1.0
    for reading in part:
        values = {name: _less(value, zeros.get(name, 0.0)) for name, value in reading.values}
        rows.append(replace(reading, values=tuple(values.items())))
        try:
            possible(values[TIME], TIME, f"{values[TIME]:g} us")
            if values[TIME] <= last:
                raise CellFault(*out_of_order(last, values[TIME]))
        except CellFault as fault:
            faults.add(TIME, fault.what, fault.remedy, reading.line)
        last = values[TIME]
    faults.end(len(part))
    few, many = len(part) < options.least_samples, len(part) > options.most_samples
    if few or many:
        limit = f"at least {options.least_samples}" if few else f"at most {options.most_samples}"
        remedy = (
            f"keep one in so many: --every {-(-len(part) // 1000)}" if many else "record more, or keep more of them"
        )
        what = f"{len(part)} samples after the start of the drive; a trace has {limit}"
        raise InputError(what, remedy, file=grid.file, line=part[0].line if part else None)
    return rows


def _less(value: float, zero: float) -> float:
    """A difference in decimal digits, as people would write it."""
    return float(Decimal(repr(value)) - Decimal(repr(zero))) if zero else value


def trace_of(number: int, part: Sequence[Reading]) -> Group:
    """The samples of one trace as a group."""
    values = {name: np.array([dict(r.values)[name] for r in part]) for name, _ in part[0].values}
    (column,) = TRACES.keys() & values.keys()
    return Group(
        number,
        part[0].drive,
        f"group{number}.csv",
        values["frequency_hz"],
        values["amplitude_v"],
        time_us=values[TIME],
        measured=np.full(len(part), TRACES[column], np.int8),
        reading=values[column],
    )

"""The voltage that an oscilloscope recorded, as the drive of what is imported."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal

import numpy as np

from psafit.drives import Table
from psafit.errors import Faults, InputError
from psafit.experiment.importing.chosen import VOLTAGE, Column, option
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.layout import Head, body, names
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.units import factor_of
from psafit.experiment.importing.values import notation_of
from psafit.experiment.table import CellFault, RowFaults
from psafit.experiment.text import listed
from psafit.experiment.trace_table import TIME, out_of_order

_UNITS = {TIME: "us", VOLTAGE: "V"}


def recorded(grid: Grid, head: Head, options: Options, least_rows: int = 10) -> Table:
    """Read a voltage over time, from the start of the drive on.

    Parameters
    ----------
    grid : Grid
    head : Head
    options : Options
        `start_us`, `every` and `period_us` say from when, how closely and until when.
    least_rows : int
        A drive of fewer samples is none.

    Returns
    -------
    Table
        Means of `every` samples. With a period, one period per volt of its largest voltage; else as recorded.

    Raises
    ------
    InputError
        Where time or voltage are not known, cannot be read, or do not reach over the period.
    """
    columns = _columns(grid, head, options)
    rows = body(grid, head, [c.place for c in columns], options.most_rows)
    notation = notation_of(grid, rows, columns, options)
    faults = RowFaults(grid.file)
    found: list[tuple[float, float]] = []
    for row in rows.rows:
        pair = []
        for column in columns:
            number = notation.number(row.cells[column.place]) if column.place < len(row.cells) else None
            if number is None:
                faults.add(column.column, "is not a number", "correct it, or delete the row", row.line)
            else:
                pair.append(float(number.value * _factor(grid, head, column)))
        if len(pair) == len(columns):
            if found and pair[0] <= found[-1][0]:
                fault = CellFault(*out_of_order(found[-1][0], pair[0]))
                faults.add(TIME, fault.what, fault.remedy, row.line)
            found.append((pair[0], pair[1]))
    faults.end(len(rows.rows))
    at, volts = np.array(found).reshape(-1, 2).T
    return _table(grid, at, volts, options, least_rows)


def _table(grid: Grid, at: np.ndarray, volts: np.ndarray, options: Options, least_rows: int) -> Table:
    start, period = options.start_us or 0.0, options.period_us
    end = at[-1] if period is None else start + period
    if at[0] < 0.0 and options.start_us is None:
        what, remedy = (
            f"the recording begins at {at[0]:g} us",
            "say when the drive starts: --start 0, or --start 1.5:ms",
        )
        raise InputError(what, remedy, file=grid.file)
    if not at[0] <= start < end <= at[-1]:
        what = f"the recording lasts from {at[0]:g} to {at[-1]:g} us, the drive from {start:g} to {end:g} us"
        raise InputError(what, "correct --start or --period, or record longer", file=grid.file)
    inside = (at > start) & (at < end)
    n = np.count_nonzero(inside) // options.every * options.every
    if n // options.every < least_rows:
        what = f"{n // options.every} rows are left of the drive, which has at least {least_rows}"
        raise InputError(what, "record more closely, or give a smaller --every", file=grid.file)
    means = [x[inside][:n].reshape(-1, options.every).mean(axis=1) for x in (at, volts)]
    edges = np.interp([start, end], at, volts)
    times, values = np.r_[start, means[0], end] - start, np.r_[edges[0], means[1], edges[1]]
    if period is None:
        return Table(times * 1e-6, values, recorded=True)
    largest = float(np.abs(values).max())
    if largest == 0.0:
        raise InputError("the recorded voltage is zero throughout", "give another channel", file=grid.file)
    return Table(times / period, values / largest, recorded=False)


def _columns(grid: Grid, head: Head, options: Options) -> Sequence[Column]:
    """The columns of time and voltage."""
    mapped = {place: m for m in options.columns for place in names(m, head.headings)}
    faults, found = Faults(), []
    for name, unit in _UNITS.items():
        said = [place for place, mapping in mapped.items() if mapping.column == name]
        could = said or [
            place
            for place, heading in enumerate(head.headings)
            if place not in mapped and (u := head.unit(place)) and u.kind == unit
        ]
        columns = [Column(place, head.headings[place], name, mapped[place].unit if said else None) for place in could]
        if len(columns) == 1:
            found += columns
            continue
        what = f"no {name} of the drive" if not columns else f"{listed(c.name for c in columns)} could all be {name}"
        remedy = f"say {option(columns[0].option if columns else 'NAME', name, '' if columns else unit)}"
        faults.add(InputError(what, remedy, file=grid.file, line=head.line or 1))
    faults.end()
    return found


def _factor(grid: Grid, head: Head, column: Column) -> Decimal:
    """Number that turns a cell into us or V; a scale is what a volt of the channel stands for."""
    target, heading = _UNITS[column.column], head.unit(column.place)
    unit = column.unit or heading
    factor = unit.factor(target) if unit else None
    if unit is None or factor is None:
        what = f"column {column.name} is in no unit of {column.column}"
        remedy = f"say {option(column.option, column.column, target)}"
        raise InputError(what, remedy, file=grid.file, line=head.line or 1)
    step = factor_of(heading.text, target) if heading and unit.scale is not None else None
    return factor * (step or 1)


def reach(table: Table) -> str:
    """What a drive's rows go through, for people."""
    low, high = float(table.value.min()), float(table.value.max())
    if table.recorded:
        return f"{table.at.size} rows, {table.at[-1] * 1e6:g} us, {low:.4g} to {high:.4g} V"
    return f"{table.at.size} rows, {low:.3g} to {high:.3g} per volt of amplitude_v"


__all__ = ["reach", "recorded"]

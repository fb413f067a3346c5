"""Which tables are traces, and what their columns of volts are: amplitudes, or the drive over time."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from psafit.errors import Faults
from psafit.experiment.importing.blocks import blocks, rising, runs_on
from psafit.experiment.importing.chosen import (
    AS_IT_STANDS,
    READ,
    VOLTAGE,
    WAVEFORM,
    Chosen,
    Column,
    cells,
    example,
    fault,
    in_volts,
    option,
    role,
)
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.layout import Head
from psafit.experiment.importing.numerals import Number, is_number, likeliest
from psafit.experiment.importing.quantities import COLUMNS, DRIVING, Quantity
from psafit.experiment.importing.records import IGNORED, LABELS, Options
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.trace_table import TIME, TRACES

OF_DAY = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?")
"""A time of the day, of itself or behind a date."""


# Volts in brackets, whatever else stands there: `(V, monitor 1:10)`.
_VOLTS = re.compile(r"[(\[]V\b")


@dataclass(frozen=True)
class _Timed:
    """Rows with a time, in any unit."""

    rows: tuple[Row, ...]
    times: tuple[float, ...]

    def sound(self, places: Sequence[int]) -> list[int]:
        """The rows that hold numbers in these columns, where most do; the others are refused later."""
        rows = list(range(len(self.rows)))
        for place in places:
            numbers = [k for k in rows if is_number(self.text(k, place))]
            rows = numbers if 2 * len(numbers) > len(rows) else rows
        return rows

    def parts(self, places: Sequence[int]) -> list[list[int]]:
        """The rows of each trace, whose conditions stand in these columns."""
        rows = self.sound(places)
        keys = [tuple(self.text(k, place) for place in places) for k in rows]
        return [[rows[i] for i in part] for part in blocks(keys, [self.times[k] for k in rows])]

    def text(self, k: int, place: int) -> str:
        """What stands in a column of a row."""
        texts = self.rows[k].texts
        return texts[place] if place < len(texts) else ""


def is_trace(grid: Grid, head: Head, mapped: Mapping[int, Column], options: Options, faults: Faults) -> bool:
    """Whether a table is motion over time, in the place of launches.

    A column that can only be a motion is one where conditions are constant over as many samples as a trace has. A
    velocity may be that of launches, and the time a clock: it is a trace where the time, unlike a clock, falls to where
    it starts again.
    """
    said = {c.column for c in mapped.values()}
    if not said.isdisjoint(TRACES):
        return True
    could = {k: h.over_time(head.units[k]) for k, h in enumerate(head.headings) if k not in mapped}
    columns = said | {q.column for each in could.values() for q in each}
    motions = [place for place, each in could.items() if any(q.role == "trace" for q in each)]
    if not motions or TIME not in columns:
        return False
    if "frequency_hz" not in columns:
        return True
    if any(_launched(each) for each in could.values()) or any(_launched([COLUMNS[c]]) for c in said if c in COLUMNS):
        return False
    if TIME in said:
        return True
    at = next(place for place, each in could.items() if any(q.column == TIME for q in each))
    timed = _timed(grid, head, at)
    parts = timed.parts(_conditions(head, mapped, could))
    n_long = sum(len(part) >= options.least_samples for part in parts)
    if not n_long or any(all(q.role == "trace" for q in could[place]) for place in motions):
        return n_long > 0
    if runs_on(parts, timed.times) is not None:
        return False
    if n_long < len(parts) or not any(b < a for a, b in pairwise(timed.times)):
        column = Column(motions[0], head.headings[motions[0]], "")
        other = next((q.column for q in could[motions[0]] if q.role == "reading"), IGNORED)
        motion = next(q.column for q in could[motions[0]] if q.role == "trace")
        what = f"column {column.name} may be a trace over time, or read of launches, and the time a clock"
        launches = f"{option(column.option, other)} {option(Column(at, head.headings[at], TIME).option, IGNORED)}"
        faults.add(fault(grid, head, what, f"say {option(column.option, motion)} or {launches}"))
    return True


def _launched(each: Sequence[Quantity]) -> bool:
    return bool(each) and all(q.role == "reading" for q in each)


def _conditions(head: Head, mapped: Mapping[int, Column], could: Mapping[int, Sequence[Quantity]]) -> list[int]:
    """Columns that hold conditions for sure: volts that are not counted may be the drive over time."""
    found = [place for place, c in mapped.items() if c.column in (*CONDITION_COLUMNS, WAVEFORM, *LABELS)]
    for place, each in could.items():
        heading, below = head.headings[place], head.units[place]
        counted = heading.volts or (below.volts if below else None)
        names = [q.column for q in each]
        if heading.is_waveform or names == ["frequency_hz"] or (names == ["amplitude_v"] and counted):
            found.append(place)
    return found


def _timed(grid: Grid, head: Head, place: int) -> _Timed:
    """The rows of a table that have a time in this column."""
    rows = [row for row in grid.rows[head.first :] if place < len(row.cells) and row.texts[place]]
    notation = likeliest([row.cells[place] for row in rows])
    numbers = [(row, number) for row in rows if (number := notation.number(row.cells[place])) is not None]
    return _Timed(tuple(row for row, _ in numbers), tuple(_microseconds(number) for _, number in numbers))


def _microseconds(number: Number) -> float:
    factor = number.unit.factor(COLUMNS[TIME].unit) if number.unit else None
    return float(number.value if factor is None else number.value * factor)


def clock(
    grid: Grid, head: Head, columns: Iterable[Column], options: Options, of_day: bool = True
) -> tuple[Column, str] | None:
    """The first column that counts time, in as many steps as a trace has, and the remedy that makes it the time.

    It is in a unit of time or, where those count, holds times of the day, and never falls.
    """
    for column in columns:
        below = cells(grid, head, column.place)
        days = [found for cell in below if (found := OF_DAY.search(str(cell)))]
        notation, unit = likeliest(below), head.unit(column.place)
        if len(days) == len(below) and of_day:
            times = [3600 * int(d[1]) + 60 * int(d[2]) + float((d[3] or "0").replace(",", ".")) for d in days]
            remedy = f"give column {column.name} in seconds"
        elif column.column == TIME or (unit and unit.kind == COLUMNS[TIME].unit):
            times = [_microseconds(number) for cell in below if (number := notation.number(cell)) is not None]
            plain = f", {AS_IT_STANDS}," if column.heading.altered else ""
            remedy = f"say {option(column.option, TIME)}{plain}"
        else:
            continue
        if len(set(times)) >= options.least_samples and all(a <= b for a, b in pairwise(times)):
            return column, remedy
    return None


def check_launches(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """Readings of which one condition was held, next to a clock, may be a recording of one launch.

    Next to a condition that is written in each row, times of the day are those of launches.
    """
    read = next((c for c in chosen.columns if role(c.column) == "reading"), None)
    written = [column for name in CONDITION_COLUMNS for column in chosen.of(name)]
    if read is None or any(len(set(cells(grid, head, column.place))) > 1 for column in written):
        return
    others = (c for c in chosen.unused if not c.mapped)
    if (found := clock(grid, head, others, options, of_day=not written)) is None:
        return
    time, remedy = found
    motion = next((q for q in COLUMNS.values() if (q.role, q.unit) == ("trace", COLUMNS[read.column].unit)), None)
    what = f"column {time.name} rises from row to row at one condition: {read.name} may be recorded over time"
    if motion:
        remedy = f"{remedy} with {option(read.option, motion.column)}"
    else:
        remedy = f"psafit reads no such recording: give {read.column} of each launch"
    faults.add(fault(grid, head, what, f"{remedy}, or {option(time.option, IGNORED)} if each row is a launch"))


def voltages(grid: Grid, head: Head, found: Sequence[Column], options: Options, faults: Faults) -> list[Column]:
    """Columns of a trace in which those of volts are `amplitude_v` where constant along each trace, else `voltage_v`.

    That volts over time are those of the drive must be said, by heading or by the user: they may be of a sensor, or
    come before an amplifier.
    """
    times = [c for c in found if c.column == TIME]
    unclear = [c for c in found if not c.mapped and _may_be_drive(c, head)]
    if not times or not unclear:
        return list(found)
    timed = _timed(grid, head, times[0].place)
    fixed = ["frequency_hz", WAVEFORM, *LABELS]
    held = [c.place for c in found if c.column in fixed or (c.mapped and c.column == "amplitude_v")]
    is_said = options.drive_file is not None or any(c.column == VOLTAGE for c in found)
    known: dict[int, Column] = {}
    for column in unclear:
        if _is_constant(timed, held, column.place, options):
            is_amplitude = column.column or column.heading.drives
            known[column.place] = replace(column, column="amplitude_v" if is_amplitude else "")
        elif column.heading.drives:
            known[column.place] = replace(column, column=VOLTAGE)
        else:
            known[column.place] = replace(column, column="")
            what = f"column {column.name} changes along a trace: it may be the drive over time, or another signal"
            remedy = f"say {as_drive(column, plain=bool(column.column))} or {option(column.option, IGNORED)}"
            remedy += f"; of launches, {option(times[0].option, IGNORED)}" if not times[0].mapped else ""
            if not is_said:
                faults.add(fault(grid, head, what, remedy))
    return [known.get(c.place, c) for c in found]


def as_drive(column: Column, *, plain: bool) -> str:
    """The option that makes a column the drive; `plain` is whether no more is said of it than that it is a voltage."""
    if plain:
        return option(column.option, VOLTAGE, "V")
    return f"{option(column.option, VOLTAGE, '20V/V')}, if one volt of it is 20 V at the stack,"


def _may_be_drive(column: Column, head: Head) -> bool:
    if column.column:
        return column.column == "amplitude_v"
    named = not DRIVING.isdisjoint(column.heading.name.split()) and _VOLTS.search(column.heading.text) is not None
    return named or column.heading.drives or in_volts(column, head)


def _is_constant(timed: _Timed, held: Sequence[int], place: int, options: Options) -> bool:
    """Whether a column is constant along each trace; where traces cannot be found without it, it is a condition."""
    parts, sound = timed.parts(held), set(timed.sound([place]))
    if all(len({timed.text(k, place) for k in part if k in sound}) <= 1 for part in parts):
        return True
    if rising(parts, timed.times) and runs_on(parts, timed.times) is None:
        return False
    parts = timed.parts([*held, place])
    n_long = sum(len(part) >= options.least_samples for part in parts)
    return 2 * n_long > len(parts) and rising(parts, timed.times) and runs_on(parts, timed.times) is None


def check_trace(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """A trace has a motion, a frequency and an amplitude: in columns, or given."""
    for column in () if chosen.readings else chosen.unused:
        could = column.heading.over_time(head.units[column.place])
        if motion := next((q for q in could if q.role == "trace"), None):
            what = f"column {column.name} could be {' or '.join(q.column for q in could)}"
            remedy = f"say which, with its unit: {option(column.option, motion.column, motion.unit)}"
            faults.add(fault(grid, head, what, remedy))
    if missing := missing_conditions(grid, head, chosen, options, faults):
        what = f"a trace over time, and nothing says {' and '.join(missing)} of its drive"
        faults.add(fault(grid, head, what, f"say {' '.join(f'--set {example(n)}' for n in missing)}"))


def missing_conditions(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> list[str]:
    """The conditions that nothing says; each stands in a column, in the headings of all that was read, or is given."""
    missing, read = [], [c for c in chosen.columns if role(c.column) in READ]
    for name in CONDITION_COLUMNS:
        columns = chosen.of(name)
        at = [c for c in read if any(a.column == name for a in c.at)]
        if (columns or at) and name in options.held and chosen.traced:
            column = (columns or at)[0]
            what = f"{name} is given, and {'column' if columns else 'heading'} {column.name} holds it"
            instead = f"say {option(column.option, IGNORED)}" if columns else "give the heading without it"
            faults.add(fault(grid, head, what, f"leave out --set, or {instead}"))
        elif columns and at:
            what = f"column {columns[0].name} and heading {at[0].name} both hold {name}"
            remedy = f"say {option(columns[0].option, IGNORED)}, or give the heading without it"
            faults.add(fault(grid, head, what, remedy))
        elif at and len(at) < len(read):
            other = next(c for c in read if c not in at)
            what = f"heading {at[0].name} holds {name}, and heading {other.name} does not"
            faults.add(fault(grid, head, what, f"write it into each heading, or say {option(other.option, IGNORED)}"))
        elif not columns and not at and name not in options.held:
            missing.append(name)
        if name == "amplitude_v" and at:
            _check_volts(grid, head, at[0], options, faults)
    return missing


def _check_volts(grid: Grid, head: Head, column: Column, options: Options, faults: Faults) -> None:
    """Refuse volts of which nobody says how they are counted."""
    if any(a.column == "amplitude_v" and not (a.volts or options.volts) for a in column.at):
        what = f"heading {column.name}: whether volts are zero to peak, peak to peak or RMS is not said"
        faults.add(fault(grid, head, what, f"say {options.volts_asked}, or write Vpp"))


__all__ = ["as_drive", "check_launches", "check_trace", "clock", "is_trace", "missing_conditions", "voltages"]

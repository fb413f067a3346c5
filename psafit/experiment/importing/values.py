"""Cells as values in psafit's units, row by row."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import zip_longest

from psafit.drives import TABLE, WAVEFORMS, Drive, from_zero, instead, peak_to_peak
from psafit.errors import InputError
from psafit.experiment.definition import id_of
from psafit.experiment.drive_table import level
from psafit.experiment.importing.chosen import (
    BIAS,
    ERROR_OF,
    IDLE,
    SETTINGS,
    SIGNALS,
    VOLTAGE,
    WAVEFORM,
    Chosen,
    Column,
    option,
)
from psafit.experiment.importing.grid import Cell, Grid, Row, text_of
from psafit.experiment.importing.layout import Body, Head, names_condition, waveform, word
from psafit.experiment.importing.numerals import NOTATIONS, Notation, Number, in_both
from psafit.experiment.importing.over_time import OF_DAY
from psafit.experiment.importing.quantities import COLUMNS, SIGMA, VOLTS, Volts, words
from psafit.experiment.importing.records import GROUPS, IGNORED, SESSIONS, Options
from psafit.experiment.plausible import is_usual
from psafit.experiment.records import CONDITION_COLUMNS, GroupId
from psafit.experiment.table import CellFault, RowFaults, within
from psafit.experiment.text import shown
from psafit.experiment.trace_table import TIME, TRACES, possible


@dataclass(frozen=True)
class Reading:
    """One reading: where it stands, which group and session it is of, and the values of psafit's columns.

    Of a trace also its column, and how its amplitude was counted in the file.
    """

    line: int
    drive: Drive
    group: str
    values: tuple[tuple[str, float], ...]
    place: int = 0
    counted: Volts = "peak"
    session: GroupId | None = None


def readings(
    grid: Grid, head: Head, chosen: Chosen, body: Body, options: Options, waveform: str
) -> tuple[list[Reading], str]:
    """Read every row.

    Parameters
    ----------
    grid : Grid
    head : Head
    chosen : Chosen
    body : Body
    options : Options
    waveform : str
        Of rows whose waveform stands in no column.

    Returns
    -------
    list of Reading
        In the order of the file; repetitions one after the other.
    str
        The decimal mark.

    Raises
    ------
    InputError
        On every cell that cannot be read or is impossible, and on numbers that can be read in two ways.
    """
    quantities = [c for c in chosen.columns if c.column in COLUMNS]
    notation = notation_of(grid, body, quantities, options)
    if grid.separator == ",":
        _check_decimals(grid, body, chosen)
    faults = RowFaults(grid.file)
    held, settings, read_columns = chosen.held(options), chosen.settings(options), chosen.readings
    found, times = [], _together(chosen)
    repeated = {c for time in times for c in time}
    errors = dict.fromkeys(c.column for c in quantities if c.column in ERROR_OF)
    for row in body.rows:
        before = faults.count
        drive = options.drive_of(_waveform(row, chosen, waveform, options, faults), settings)
        values = {c: _value(row, c, notation, drive, faults) for c in quantities}
        own = {c.column: v for c in quantities if c.column in SETTINGS and (v := values.pop(c)) is not None}
        drive = _at_rest(grid, row, drive, chosen, settings | own, options)
        label = " ".join(text_of(_cell(row, c)) for c in chosen.of(GROUPS))
        if chosen.of(GROUPS) and not label:
            faults.add(GROUPS, "has no label", "write it into each row, also where cells were merged", row.line)
        session = _session(row, chosen, options, faults)
        repetitions = _repetitions(values, times, chosen)
        if faults.count == before and not repetitions:
            what, remedy = "is empty", "enter the value, or delete the row if nothing was read"
            faults.add(read_columns[0], what, remedy, row.line)
        others = {c.column: v for c, v in values.items() if c not in repeated and v is not None}
        for name in errors if faults.count == before else ():
            known_in = [{c.column for c in read} | others.keys() for read in repetitions]
            if any(ERROR_OF[name] in there and name not in there for there in known_in):
                faults.add(name, "is empty", "enter the known error of the reading, or ignore the column", row.line)
        for read in repetitions if faults.count == before else ():
            known = _held(held, drive, options) | others
            known |= {c.column: v for c, v in read.items() if v is not None}
            first = next(iter(read))
            known = _named(grid, head, first, drive, options) | known if first.heading.at else known
            counted = _counted(row, chosen, first, notation, options)
            _check_effective(grid, row, drive, counted)
            place = first.place if chosen.traced else 0
            found.append(Reading(row.line, drive, label, tuple(known.items()), place, counted, session))
            if not chosen.of(VOLTAGE):
                check_ends(grid, found[-1], drive)
            for c, v in read.items():
                if v is not None and v < 0 and not chosen.traced:
                    faults.below.setdefault(c.column, []).append((row.line, text_of(_cell(row, c)), known))
    faults.end(len(body.rows))
    return found, notation.decimal


def _at_rest(grid: Grid, row: Row, drive: Drive, chosen: Chosen, settings: dict[str, float], options: Options) -> Drive:
    """The drive of a row with its own voltages.

    Raises
    ------
    InputError
        Where it has a bias, and nothing says whether that is there before the start, too; or where a column gives one
        to a waveform that is on one side of zero already, as if a generator's offset had made it so.
    """
    drive = options.drive_of(drive.waveform, settings)
    form, offset = WAVEFORMS.get(drive.waveform), next((c for c in chosen.of(BIAS) if not c.mapped), None)
    if form and offset and drive.bias_v and form.unipolar:
        other = next((shape for shape in WAVEFORMS if from_zero(shape) == form.id), "")
        what = f"{form.id} goes from 0 V by itself, and column {offset.name} adds {drive.bias_v:g} V"
        cell = "".join(text_of(_cell(row, column)) for column in chosen.of(WAVEFORM))
        say = "write " if cell else "say --waveform "
        if cell and _meant(cell, options) != cell:
            say = f"say --waveform {shlex.quote(cell)}="
        raised = f"{say}{other} if that raises a {other}, or " if other else ""
        once, both = option(offset.option, IGNORED), option(offset.option, BIAS)
        remedy = f"{raised}say {once} if it is counted twice, or {both} if both hold"
        raise InputError(what, remedy, file=grid.file, line=row.line)
    if drive.bias_v and IDLE not in settings:
        what = f"a bias of {drive.bias_v:g} V, and nothing says what the drive rests at before its start"
        remedy = f"say --set {IDLE}=0, or --set {IDLE}={drive.bias_v:g} if it rests at the bias"
        raise InputError(what, remedy, file=grid.file, line=row.line)
    return drive


def _counted(row: Row, chosen: Chosen, read: Column, notation: Notation, options: Options) -> Volts:
    """How the amplitude of a reading is counted: by its cell, its column, the heading of what was read, or --set."""
    for column in chosen.of("amplitude_v"):
        number = notation.number(_cell(row, column))
        return (number and number.unit and number.unit.volts) or column.volts or "peak"
    named = next((a for a in read.at if a.column == "amplitude_v"), None)
    if named:
        return named.volts or options.volts or "peak"
    return options.counted[0] if options.counted else "peak"


def _check_effective(grid: Grid, row: Row, drive: Drive, counted: Volts) -> None:
    """RMS volts of a drive on a bias are with it, as true RMS is, or without it, as behind a capacitor.

    Raises
    ------
    InputError
        Where volts are so.
    """
    if counted == "rms" and drive.bias_v:
        what = f"volts are RMS, on a bias of {drive.bias_v:g} V, which may be in them or not"
        remedy = f"give them zero to peak, {float(peak('rms', drive)):.5g} times the RMS without the bias"
        raise InputError(what, remedy, file=grid.file, line=row.line)


def _held(held: dict[str, float], drive: Drive, options: Options) -> dict[str, float]:
    """Conditions that were held, the amplitude zero to peak.

    Raises
    ------
    InputError
        Where the peak of that drive does not follow.
    """
    volts = options.counted[0] if options.counted else "peak"
    if "amplitude_v" not in held or volts == "peak":
        return held
    try:
        return held | {"amplitude_v": float(Decimal(repr(held["amplitude_v"])) * peak(volts, drive))}
    except CellFault as fault:
        raise InputError(f"--set amplitude_v: {fault.what}", fault.remedy) from fault


def _named(grid: Grid, head: Head, column: Column, drive: Drive, options: Options) -> dict[str, float]:
    """The conditions that the heading of what was read names.

    Raises
    ------
    InputError
        Where one is impossible.
    """
    found = {}
    try:
        for a in column.at:
            volts = (a.volts or options.volts or "peak") if a.column == "amplitude_v" else "peak"
            found[a.column] = within(float(a.value * peak(volts, drive)), a.column, column.option)
    except CellFault as fault:
        raise InputError(f"heading {fault.what}", fault.remedy, file=grid.file, line=head.line or 1) from fault
    return found


def _together(chosen: Chosen) -> list[list[Column]]:
    """The columns that were read together, time after time, with a known error of each. Each column of a trace is one.

    Columns whose headings name other conditions were not read together.
    """
    columns = [chosen.of(name) for name in chosen.readings]
    if chosen.traced:
        return [[c] for same in columns for c in same]
    conditions = dict.fromkeys(c.at for same in columns for c in same)
    together = (zip_longest(*([c for c in same if c.at == at] for same in columns)) for at in conditions)
    errors = {name: chosen.of(name) for name in ERROR_OF if len(chosen.of(name)) > 1}
    error = {c: e for name, same in errors.items() for c, e in zip(chosen.of(ERROR_OF[name]), same, strict=True)}
    times = (list(filter(None, time)) for each in together for time in each)
    return [[*time, *(error[c] for c in time if c in error)] for time in times]


def _repetitions(
    values: dict[Column, float | None], times: Sequence[Sequence[Column]], chosen: Chosen
) -> list[dict[Column, float | None]]:
    """What was read in a row, time after time; a cell that is empty was not read.

    The drive that was recorded next to a trace was read where the trace was not, too.
    """
    every = [{c: values[c] for c in time} for time in times]
    read = [{c: v for c, v in time.items() if v is not None} for time in every]
    read = [time for time in read if any(c.column not in ERROR_OF for c in time)]
    return every if read and chosen.traced and chosen.of(VOLTAGE) else [dict(time) for time in read]


def _cell(row: Row, column: Column) -> Cell:
    return row.cells[column.place] if column.place < len(row.cells) else ""


def notation_of(grid: Grid, body: Body, columns: Sequence[Column], options: Options) -> Notation:
    """How numbers are written in the whole file; asked for where that makes a difference and cannot be known.

    Raises
    ------
    InputError
        Where it cannot be known, or where some are written in one way only and some in the other.
    """
    cells = [(row.line, cell) for row in body.rows for c in columns if text_of(cell := _cell(row, c))]
    read = [(line, cell, *in_both(cell)) for line, cell in cells]
    point = next(((line, cell) for line, cell, one, other in read if one and not other), None)
    comma = next(((line, cell) for line, cell, one, other in read if other and not one), None)
    if point and comma:
        said = [f"{shown(str(cell))} (line {line})" for line, cell in (point, comma)]
        what = f"the numbers mix decimal marks: {said[0]} has a point, and {said[1]} a comma"
        raise InputError(what, "write all numbers in one way", file=grid.file, line=max(point[0], comma[0]))
    if options.decimal:
        return NOTATIONS[options.decimal]
    both = [(line, cell, one.value, other.value) for line, cell, one, other in read if one and other]
    if len(both) == len(read) and (two := next((b for b in both if b[2] != b[3]), None)):
        line, cell, *values = two
        what = f"{shown(str(cell))} may be {values[0]:f} or {values[1]:f}, and no other number of the file shows which"
        raise InputError(what, "say --decimal . or --decimal ,", file=grid.file, line=line)
    notation = NOTATIONS["," if comma else "."]
    for column in columns if point or comma else ():
        _check_thousands(grid, body, column, notation)
    return notation


def _check_thousands(grid: Grid, body: Body, column: Column, notation: Notation, digits: int = 3) -> None:
    """Thousands in a column where no number has decimals, nor so many digits and no mark, may be decimals themselves.

    Raises
    ------
    InputError
        With the first of them, unless thousands are what such rigs have, and those decimals are not.
    """
    texts = [(row.line, cell) for row in body.rows if isinstance(cell := _cell(row, column), str)]
    if not any(mark in cell for _, cell in texts for mark in NOTATIONS if mark != notation.decimal):
        return
    read = [(line, cell, *in_both(cell)) for line, cell in texts]
    two = next(((line, cell) for line, cell, one, other in read if one and other and one.value != other.value), None)
    whole = any(cell.isdigit() and len(cell) >= digits for _, cell in texts)
    if not two or whole or any((one is None) != (other is None) for _, _, one, other in read):
        return
    line, cell = two
    found = {mark: number for mark, n in NOTATIONS.items() if (number := n.number(cell))}
    mine, other = (found[mark] for mark in sorted(found, key=lambda mark: mark != notation.decimal))
    usual = [is_usual(column.column, float(n.value * _factor_of(n, column))) for n in (mine, other)]
    if usual == [True, False]:
        return
    what = f"{shown(cell)} may be {mine.value:f} or {other.value:f}, and no other number of its column shows which"
    remedy = f"say --decimal {notation.decimal} if it is {mine.value:f}, else write all numbers in one way"
    raise InputError(what, remedy, file=grid.file, line=line)


def _factor_of(number: Number, column: Column) -> Decimal:
    """The factor of a number's own unit, or its column's; 1 where there is none."""
    said = number.unit or column.unit
    return (said.factor(COLUMNS[column.column].unit) if said and column.column in COLUMNS else None) or Decimal(1)


def _check_decimals(grid: Grid, body: Body, chosen: Chosen) -> None:
    """Decimals behind a comma would stand in the next column, and be taken for what is left out."""
    used = {c.place for c in chosen.columns} - {grid.counts}
    texts = [row.texts for row in body.rows]
    if any(mark in text for row in texts for place, text in enumerate(row) if place in used for mark in ".,"):
        return  # there are decimals, in quotes where they have commas
    for column in chosen.unused:
        cells = [row[column.place] if column.place < len(row) else "" for row in texts]
        if column.place - 1 == max(used) and not column.mapped and all(cell.isdigit() for cell in cells):
            what = f"the numbers in column {column.name} may be the decimals of those before them"
            remedy = f"if they are not, say {option(column.option, IGNORED)}; else export with another separator"
            raise InputError(what, remedy, file=grid.file, line=body.rows[0].line)


def _waveform(row: Row, chosen: Chosen, given: str, options: Options, faults: RowFaults) -> str:
    """The waveform of a row."""
    column = next(iter(chosen.of(WAVEFORM)), None)
    text = given if column is None else _meant(text_of(_cell(row, column)), options)
    if column is None and given == TABLE:
        return TABLE
    try:
        return known_waveform(text, options)
    except CellFault as fault:
        faults.add(WAVEFORM, fault.what, fault.remedy, row.line)
        return next(iter(WAVEFORMS))


def _session(row: Row, chosen: Chosen, options: Options, faults: RowFaults) -> GroupId | None:
    """The session of a row, where a column names it, or else of its table."""
    if not (columns := chosen.of(SESSIONS)):
        return next(iter(options.sessions), None)
    text = " ".join(text_of(_cell(row, c)) for c in columns)
    name = session_of(text)
    if name is None:
        faults.add(
            SESSIONS, f"{shown(text)} is no name of a session", "write letters or digits into each row", row.line
        )
    return name


def session_of(text: str) -> GroupId | None:
    """A session by its name, None where it cannot be one; a number might be a group's id, so a word is before it."""
    name = id_of(text)
    return f"session{name}" if isinstance(name, int) else name


def _meant(text: str, options: Options) -> str:
    """What a cell's word for a waveform means, where that is said."""
    return next((name for said, name in options.meant if word(said) == word(text)), text)


def known_waveform(text: str, options: Options) -> str:
    """Psafit's waveform of this name, or that of a file of its own; a `CellFault` for any other."""
    if found := waveform(text):
        return found
    if words(text) == TABLE and options.drive_file is None:
        raise CellFault(f"{shown(text)} needs a voltage over time", "give it with --drive FILE")
    if words(text) == TABLE:
        return TABLE
    raise CellFault(f"{shown(text)} is no waveform that psafit knows", instead(text))


def _value(row: Row, column: Column, notation: Notation, drive: Drive, faults: RowFaults) -> float | None:
    """The value of a cell; None where it is empty, and may be, or where there is a fault."""
    cell = _cell(row, column)
    text = text_of(cell)
    if not text and COLUMNS[column.column].role in SIGNALS:
        return None  # a repetition that was left out
    try:
        number = notation.number(cell)
        if number is None:
            raise CellFault(*_no_number(cell, text, column, notation))
        value = float(number.value * _factor(number, column, drive, text))
        if column.column == TIME:  # on the clock of the instrument
            return value
        volts = (VOLTAGE, *SETTINGS)
        check = level if column.column in volts else possible if column.column in TRACES else within
        return check(value, column.column, text)
    except CellFault as fault:
        faults.add(column.column, fault.what, fault.remedy, row.line)
        return None


def _no_number(cell: Cell, text: str, column: Column, notation: Notation) -> tuple[str, str]:
    """What stands in the place of a number, and the remedy."""
    condition = column.column in CONDITION_COLUMNS
    into = "if the row says at what its columns were read, write that into each heading, such as Range at 5 Vpp (um)"
    if not text:
        remedy = "enter the value, or delete the row if nothing was read"
        return "is empty", f"{remedy}; {into}" if condition else remedy
    if condition and names_condition(text):
        return f"{shown(text)} is not a number", f"correct it; {into}, and delete it"
    if column.column == TIME and OF_DAY.search(text):
        remedy = f"give times in seconds, or of equal steps say {option(column.option, IGNORED)} --step 1:us"
        return f"{shown(text)} is a time of the day", remedy
    if not isinstance(cell, str):
        kind = "a truth value" if isinstance(cell, bool) else f"a {type(cell).__name__}"
        return f"{shown(text)} is no number but {kind}", "spreadsheets turn 1.2 into a date: enter it anew"
    other = next(n for n in NOTATIONS.values() if n is not notation)
    if other.number(cell) is not None:
        return (
            f"{shown(text)} is no number with {shown(notation.decimal)} as decimal mark, as the others have",
            f"write all numbers in one way, or say --decimal {other.decimal}",
        )
    if (known := SIGMA.get(column.column)) and re.search(r"±|\+/?-", text):
        return f"{shown(text)} is not a number", f"give the standard uncertainty a column of its own: {known}"
    unread = "; if it was not read, empty the cell, or delete the row if nothing was"
    return f"{shown(text)} is not a number", f"correct it{', or delete the row' if condition else unread}"


def _factor(number: Number, column: Column, drive: Drive, text: str) -> Decimal:
    """Number that turns a value into psafit's unit."""
    target = COLUMNS[column.column].unit
    unit = number.unit or column.unit
    if unit is None:
        said = shlex.quote(f"{column.option}={column.column}:{target}")
        raise CellFault(f"{shown(text)} has no unit, as others have", f"add it, or say --column {said}")
    factor = unit.factor(target)
    if factor is None:
        raise CellFault(f"{shown(text)} is in no unit of {column.column}", f"give it in {target}")
    if number.unit and column.unit and column.unit.factor(target) != factor:
        what = f"{shown(text)} has another unit than its column, {column.unit.text}"
        raise CellFault(what, "give it in the unit of the column")
    if column.column != "amplitude_v":
        return factor
    volts = number.unit.volts if number.unit and number.unit.volts else column.volts
    if volts and column.volts and volts != column.volts:
        what = f"{shown(text)} is {VOLTS[volts]}, and its column {VOLTS[column.volts]}"
        raise CellFault(what, "count all volts of the column in one way")
    if volts is None:
        raise CellFault(f"{shown(text)} may be zero to peak, peak to peak, or RMS", "say --volts peak, pp or rms")
    return factor * peak(volts, drive)


def check_ends(grid: Grid, reading: Reading, drive: Drive, reach: float = 0.98) -> None:
    """Volts from peak to peak are those of a recording that shows both ends, to within a factor, or a whole period.

    They are still counted by the drive of the reading.

    Raises
    ------
    InputError
        Where it may not show them.
    """
    table = drive.table
    if reading.counted != "pp" or table is None or not table.recorded:
        return
    values, span = dict(reading.values), float(table.at[-1])
    if span * values["frequency_hz"] >= 1.0:
        return
    low, high = min(drive.idle_v, float(table.value.min())), max(drive.idle_v, float(table.value.max()))
    stated = values["amplitude_v"] * peak_to_peak(reading.drive)
    if high - low < reach * stated:
        seen = f"{low:.4g} to {high:.4g} V in {1e6 * span:g} us, less than a period"
        what = f"{stated:g} V peak to peak, and the recorded drive goes from {seen}: it does not show both ends"
        raise InputError(what, "give amplitude_v zero to peak, in Vp", file=grid.file, line=reading.line)


def peak(volts: Volts, drive: Drive) -> Decimal:
    """Peak of a voltage that is 1 as it is counted."""
    if volts != "rms":
        # An amplitude is counted from zero, of a unipolar waveform, too. That of a drive that is recorded next to a
        # trace is half until its samples are read.
        return 1 / Decimal(peak_to_peak(drive)) if volts == "pp" else Decimal(1)
    form = WAVEFORMS.get(drive.waveform)
    if form is None or form.crest_squared is None:
        raise CellFault(f"volts are RMS, and the peak of {drive.waveform} does not follow", "give them zero to peak")
    return Decimal(form.crest_squared).sqrt()


def groups_of(found: Sequence[Reading]) -> list[list[Reading]]:
    """Readings by waveform, label and session, in the order of the file."""
    parts: dict[tuple[object, ...], list[Reading]] = {}
    for reading in found:
        parts.setdefault((reading.drive, reading.group, reading.session), []).append(reading)
    return list(parts.values())


__all__ = ["Reading", "check_ends", "groups_of", "known_waveform", "notation_of", "peak", "readings"]

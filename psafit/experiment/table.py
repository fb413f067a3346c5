"""Read one group's CSV file."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import Faults, InputError
from psafit.experiment.records import CONDITION_COLUMNS, READING_COLUMNS, SIGMA_COLUMNS
from psafit.experiment.text import listed, near_columns, read_text, shown
from psafit.observables import LAUNCH_RANGE, NUMBERED, OF_LAUNCHES, Observable

# Hard limits of each column, far beyond any rig, within which nothing overflows; a wrong unit is only warned of.
LIMITS = {
    "frequency_hz": (1e-3, 1e9),
    "amplitude_v": (0.0, 1e6),
    **{o.column: o.limits for o in OF_LAUNCHES},
    **dict.fromkeys(SIGMA_COLUMNS, (1e-9, 1e9)),
}

_POSITIVE = tuple(o.column for o in OF_LAUNCHES if o.blank)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([,' \u00a0\u202f]\d{3})+(\.\d*)?", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
IMPORT = "psafit import reads other forms"
_USUAL = (*CONDITION_COLUMNS, LAUNCH_RANGE.column)
_HEADER_REMEDY = (
    f"the first line must read {','.join(_USUAL)} (and {LAUNCH_RANGE.sigma_column} if known), or in the place of the"
    f" range, or next to it, {' or '.join(o.column for o in OF_LAUNCHES if o is not LAUNCH_RANGE)}"
)
_UNITS = {"frequency_hz": "Hz", "amplitude_v": "V"}
_UNITS |= {name: o.unit for o in OF_LAUNCHES for name in (o.column, o.sigma_column)}
_EMPTY = "is empty", "enter the value, or delete the row if nothing was read"
_BY_COLUMN = {o.column: o for o in OF_LAUNCHES}


def read_csv(
    file: Path,
    *,
    planned: bool = False,
    most_rows: int = 1_000_000,
    most_bytes: int = 2**27,
) -> dict[str, FloatArray]:
    """Read the columns of one CSV file, checked cell by cell; NaN where a cell of an observable may be empty.

    Rows without any content are left out: blank lines, and empty cells at the end, as spreadsheets leave them.

    Parameters
    ----------
    file : Path
    planned : bool
        Whether it may lack readings: their columns, or every cell of these.
    most_rows, most_bytes : int
        A larger file is refused: it is no sweep of launches.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    rows = csv_rows(file, most_bytes)
    empty: list[int] = []  # lines of rows of empty cells, a fault where readings stand on both sides
    line, cells = next(
        (row for row in rows if not _is_empty(row[1])),
        (1, InputError("the file is empty", _HEADER_REMEDY, file=file, line=1)),
    )
    if isinstance(cells, InputError):
        raise cells
    names = _header(cells, planned, file, line)
    blank = _may_be_blank(names)
    here = {o.column for o in OF_LAUNCHES if o.column in names}
    columns: list[list[float]] = [[] for _ in names]
    faults = RowFaults(file)
    n_rows = 0
    to_come: list[int] = []  # lines without any reading, of a plan that says what is to be read
    for line, cells in rows:
        if _is_empty(cells):
            empty.append(line)
            continue
        for gap in empty if n_rows else []:
            faults.add("", "the row is empty", "enter its values, or delete it", gap)
        empty, n_rows = [], n_rows + 1
        if n_rows > most_rows:
            faults.add("", f"more than {most_rows} rows", "split the file into several groups", line)
            break
        if isinstance(cells, InputError):
            faults.add("", cells.what, cells.remedy, line)
        elif len(cells) != len(names):
            faults.add("", *_miscounted(cells, names), line)
        else:
            values = dict.fromkeys(names, math.nan)
            row = list(map(str.strip, cells))
            absent = _absent(dict(zip(names, row, strict=True)), blank)
            if here and not any(row[names.index(name)] for name in here):
                to_come.append(line)
                absent = here
            for name, column, cell in zip(names, columns, row, strict=True):
                try:
                    values[name] = math.nan if name in absent else _number(cell, name)
                    column.append(values[name])
                except CellFault as fault:
                    faults.add(name, fault.what, fault.remedy, line)
            for name in filter(_BY_COLUMN.get, names):
                if values[name] < 0:
                    faults.below.setdefault(name, []).append((line, row[names.index(name)], values))
    if to_come and not (planned and len(to_come) == n_rows):
        faults.unread(next(name for name in names if name in here), to_come, n_rows)
    faults.end(n_rows)
    if not n_rows:
        raise InputError("no readings below the header", "add one row a measurement", file=file, line=1)
    return {name: np.array(column) for name, column in zip(names, columns, strict=True)}


def _may_be_blank(names: Sequence[str]) -> dict[str, str]:
    """Columns whose cells may be empty, with the observable's: those of observables that do not stand alone."""
    here = [o for o in OF_LAUNCHES if o.column in names]
    if len(here) < 2:
        return {}
    return {name: o.column for o in here for name in (o.column, o.sigma_column) if name in names}


def _absent(row: dict[str, str], blank: dict[str, str]) -> set[str]:
    """Columns that a row leaves out: observables that were not read, where another was, and their uncertainties."""
    gone = {name for name, column in blank.items() if not row[name] and not row[column]}
    return gone if any(row[column] for column in blank.values()) else set()


def readings_of(columns: dict[str, FloatArray]) -> dict[str, Any]:
    """What `psafit.experiment.Group` takes of a file's columns: each cell that holds a reading is a point of its own.

    Parameters
    ----------
    columns : dict of str to (n_rows,) array
        As `read_csv` returns them.

    Returns
    -------
    dict of str to (n_points,) array
        Without `reading` where no cell holds one: such a file is a plan, of what its empty columns are, launch ranges
        without any.
    """
    cells = [(k, o) for k, o in NUMBERED if o.column in columns]
    if not cells:
        sigma = {"sigma": columns["sigma_um"]} if "sigma_um" in columns else {}
        return {name: columns[name] for name in CONDITION_COLUMNS} | sigma
    rows = [np.flatnonzero(~np.isnan(columns[o.column])) for _, o in cells]
    to_come = not any(some.size for some in rows)
    if to_come:
        rows = [np.arange(len(columns["frequency_hz"]))] * len(cells)
    every = np.concatenate(rows)
    held = {name: columns[name][every] for name in CONDITION_COLUMNS}
    if not to_come:
        held["reading"] = np.concatenate([columns[o.column][some] for (_, o), some in zip(cells, rows, strict=True)])
    if any(o.sigma_column in columns for _, o in cells):
        stated = (columns.get(o.sigma_column, np.zeros(len(columns["frequency_hz"]))) for _, o in cells)
        held["sigma"] = np.concatenate([sigma[some] for sigma, some in zip(stated, rows, strict=True)])
    measured = np.repeat([k for k, _ in cells], [some.size for some in rows])
    return {**held, "measured": measured, "row": every}


def _is_empty(cells: list[str] | InputError) -> bool:
    return not isinstance(cells, InputError) and not any(map(str.strip, cells))


def csv_rows(file: Path, most_bytes: int) -> Iterator[tuple[int, list[str] | InputError]]:
    """Rows of a CSV file that have any cells, with the line where each begins: a quoted cell may span lines."""
    text = read_text(file, most_bytes, "CSV (UTF-8); psafit import reads other text, and workbooks")
    row: list[str] = []  # the lines of one

    def lines() -> Iterator[str]:
        for text_line in io.StringIO(text, newline=""):
            row.append(text_line)
            yield text_line

    reader = csv.reader(lines(), strict=True)
    while True:
        row.clear()
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            what, remedy = _unparsed("".join(row), error)
            yield line, InputError(what, remedy, file=file, line=line)
            continue
        if len(cells) > 1 or any(map(str.strip, cells)):
            yield line, cells


Rows = Iterator[tuple[int, list[str] | InputError]]


def headed(file: Path, most_bytes: int, remedy: str) -> tuple[int, list[str], Rows]:
    """Line and names of a file's header, and the rows below; the `remedy` is for a file without any."""
    rows = csv_rows(file, most_bytes)
    line, cells = next(rows, (1, InputError("the file is empty", remedy, file=file, line=1)))
    if isinstance(cells, InputError):
        raise cells
    return line, [cell.strip() for cell in cells], rows


def pairs(rows: Rows, faults: RowFaults, most_rows: int, what: str, remedy: str) -> Iterator[tuple[int, list[str]]]:
    """Rows of a table of two columns, counted, up to so many; what is none becomes a fault.

    `what` is what a row holds, more than one of them, and `remedy` is for too many.
    """
    for line, cells in rows:
        faults.n_rows += 1
        if faults.n_rows > most_rows:
            faults.add("", f"more than {most_rows} {what}", remedy, line)
            return
        if isinstance(cells, InputError):
            faults.add("", cells.what, cells.remedy, line)
        elif len(cells) != 2:
            faults.add("", f"{len(cells)} cells in the row, 2 in the header", "give one cell a column", line)
        else:
            yield line, [cell.strip() for cell in cells]


def _unparsed(row: str, error: csv.Error) -> tuple[str, str]:
    """What is wrong with a row that is no CSV, and the remedy."""
    if '"' not in row:  # nothing else than a cell's length ends the reading
        lengths = [len(cell) for cell in row.rstrip("\r\n").split(",")]
        longest = max(lengths)
        what = f"not valid CSV: cell {lengths.index(longest) + 1} of the row has {longest} characters"
        return what, "write one number a cell; line ends may be missing"
    if "field limit" in str(error) or "unexpected end" in str(error):
        what = f"not valid CSV: a quoted cell begins that does not end within {len(row)} characters"
        return what, "close the quotes, or write plain numbers, without quotes"
    return f"not valid CSV ({error})", "write plain numbers, without quotes"


class CellFault(Exception):
    """What is wrong with one cell, wherever it stands."""

    def __init__(self, what: str, remedy: str) -> None:
        self.what, self.remedy = what, remedy


@dataclass
class RowFaults:
    """Faults of the rows of a file: equal ones once, of each kind the first few, and how many there are."""

    file: Path
    most: int = 10
    n_rows: int = 0
    # Readings below zero by column: line, cell, values of the row.
    below: dict[str, list[tuple[int, str, dict[str, float]]]] = field(default_factory=dict)
    count: int = 0  # of faults, ranges below zero left out
    # Of each column and remedy what was wrong, and in which lines.
    _kinds: dict[tuple[str, str], dict[str, list[int]]] = field(default_factory=dict)

    def add(self, column: str, what: str, remedy: str, line: int) -> None:
        """Keep a fault; those of one column with one remedy are of a kind."""
        self.count += 1
        self._kinds.setdefault((column, remedy), {}).setdefault(f"{column} {what}".strip(), []).append(line)

    def unread(self, column: str, lines: Sequence[int], n_rows: int) -> None:
        """Keep rows without any reading; raise at once where there are no others, and nothing else is wrong."""
        if len(lines) == n_rows > 1 and not self.count:
            what = f"{column} is empty in all {n_rows} rows: the group waits for its readings"
            raise InputError(what, "enter them, or leave out its [[group]]", file=self.file, line=lines[0])
        for line in lines:
            self.add(column, *_EMPTY, line)

    def end(self, n_rows: int) -> None:
        """Raise what was found; a fault that all rows have, once."""
        faults = Faults(self.most)
        for column, below in self.below.items():
            if n_rows > 2 and 2 * len(below) > n_rows:
                line, cell, _ = below[0]
                what = (
                    f"{column} {shown(cell)} is negative, as {len(below)} of {n_rows} {_BY_COLUMN[column].plural} are"
                )
                remedy = "turn the sign if it is counted the other way, or see if this is another quantity's column"
                faults.add(InputError(what, remedy, file=self.file, line=line))
            else:
                self._negative(_BY_COLUMN[column], below)
        self._raise(faults, n_rows)

    def _negative(self, observable: Observable, below: list[tuple[int, str, dict[str, float]]]) -> None:
        """Keep each reading below zero, with what to do about it."""
        for line, cell, values in below:
            reach = max(observable.still, 3 * values.get(observable.sigma_column, 0.0))
            if -values[observable.column] <= reach:
                what = f"{shown(cell)} is negative, by no more than scatter"
                remedy = "enter 0, which is an ordinary reading, and keep the row: deleting it would select by outcome"
            else:
                what = f"{shown(cell)} is negative, by more than scatter (about {reach:g} {observable.unit})"
                remedy = "correct its sign or its value, or see if this is another quantity's column"
            self.add(observable.column, what, remedy, line)

    def _raise(self, faults: Faults, n_rows: int, many: int = 3) -> None:
        """Raise what was found; of `many` equal faults the first."""
        for (_, remedy), kinds in self._kinds.items():
            named = []
            for what, lines in kinds.items():
                if len(lines) >= many:
                    named.append((f"{what}, as in {len(lines)} rows", lines[0]))
                else:
                    named += [(what, line) for line in lines]
            if sum(map(len, kinds.values())) == n_rows >= many:
                what, lines = next(iter(kinds.items()))
                named = [(f"{what}, as in all {n_rows} rows", lines[0])]
            *others, last = (InputError(what, remedy, file=self.file, line=line) for what, line in named[: self.most])
            for fault in others:
                faults.add(fault)
            faults.add(last, more=max(0, len(named) - self.most))
        faults.end()


def _miscounted(cells: list[str], names: list[str]) -> tuple[str, str]:
    """What is wrong with a row that has more cells, or fewer, than there are columns, and the remedy."""
    what = f"{len(cells)} cell{'s' * (len(cells) != 1)} in the row, {len(names)} in the header"
    beyond = cells[len(names) :]
    if _other_separator(cells):
        return what, "separate cells by commas, not by semicolons or tabs"
    if beyond and not any(map(str.strip, beyond)):
        return (
            f"{what}: the row ends with {'a comma' if len(beyond) == 1 else 'commas'}",
            "delete what follows the last value",
        )
    return what, "give one cell a column: decimal points, no thousands separators, no comments, no row numbers"


def _other_separator(cells: Sequence[str]) -> str:
    """What stands in the place of commas in a row that has none; empty where nothing does."""
    marks = {";": "semicolons", "\t": "tabs"}
    return next((name for mark, name in marks.items() if len(cells) == 1 and mark in cells[0]), "")


def _foreign(names: Sequence[str]) -> tuple[str, str] | None:
    """What is wrong with a header that is none of launches at all, and the remedy."""
    if separator := _other_separator(names):
        return (
            f"columns are separated by {separator}", f"separate them with commas, and write decimal points; {IMPORT}"
        )  # fmt: skip
    if all(_NUMBER.fullmatch(name) for name in names):
        return f"unknown column {shown(names[0])}: the file begins with numbers, without a header", _HEADER_REMEDY
    if "time_us" in names:
        return "column time_us: these are samples of a trace", "name the file with trace in the place of file"
    return None


def _header(cells: list[str], planned: bool, file: Path, line: int) -> list[str]:
    names = [cell.strip() for cell in cells]
    known = (*CONDITION_COLUMNS, *READING_COLUMNS, *SIGMA_COLUMNS)
    faults = Faults()

    def add(what: str, remedy: str) -> None:
        faults.add(InputError(what, remedy, file=file, line=line))

    if foreign := _foreign(names):
        add(*foreign)
        faults.end()
    if not names[-1]:
        add("the header ends with a comma", "delete it, and the last comma of each row")
        while names and not names[-1]:
            del names[-1]
    if names and not names[0]:
        add(
            "the first column has no name: an index, as pandas writes it",
            "delete the column; from pandas, to_csv(..., index=False)",
        )
        del names[0]
    meant = set()
    strange = []
    for name in dict.fromkeys(n for n in names if n not in known):
        if near := near_columns(name, known):
            unit = _UNITS[near[0]]
            meant.add(near[0])
            more = not set(re.split(r"\W|_", name.lower())) <= set(near[0].split("_"))  # perhaps another unit
            other = f" {IMPORT}" if more else ""
            remedy = f"did you mean {near[0]}, in {unit}?{other}"
            add(f"unknown column {shown(name)}", remedy)
        else:
            strange.append(shown(name))
    needed = CONDITION_COLUMNS if planned or {*names, *meant} & {*READING_COLUMNS} else _USUAL
    missing = [shown(n) for n in needed if n not in names and n not in meant]
    for what, wrong in (
        ("unknown column", strange),
        ("missing column", missing if len(missing) > len(strange) else []),  # else one is the other, misnamed
        ("repeated column", [shown(n) for n in known if names.count(n) > 1]),
    ):
        if wrong:
            remedy = _HEADER_REMEDY
            if what == "unknown column":
                remedy += f"; {IMPORT}"
            if what == "missing column" and wrong == [shown("launch_range_um")]:
                remedy += "; without readings it is a plan, which psafit simulate takes"
            add(f"{what}{'s' * (len(wrong) > 1)} {listed(wrong[:5])}{', ...' * (len(wrong) > 5)}", remedy)
    for o in OF_LAUNCHES:
        of_ranges_to_come = planned and o is LAUNCH_RANGE and {*names}.isdisjoint(READING_COLUMNS)
        if o.sigma_column in names and o.column not in names and not of_ranges_to_come:
            add(f"{o.sigma_column} without {o.column}", "give what it is the uncertainty of, or delete the column")
    faults.end()
    return names


def within(value: float, name: str, cell: str) -> float:
    """A value within the limits of its column, or a `CellFault`; `cell` is what stands in the file.

    A range may be below zero, for whoever sees all of them.
    """
    value += 0.0  # no negative zero: it would change the fingerprint
    if not math.isfinite(value):
        raise CellFault(f"{shown(cell)} is too large", "correct the value")
    if (name in _POSITIVE or name == "frequency_hz" or name in SIGMA_COLUMNS) and value <= 0:
        raise CellFault(f"{shown(cell)} is not positive", "correct the value")
    if name == "amplitude_v" and value < 0:
        raise CellFault(f"{shown(cell)} is negative", "correct the value: an amplitude, zero to peak, has no sign")
    low, high = LIMITS[name]
    if not low <= value <= high and not -high <= value < 0:
        raise CellFault(f"{shown(cell)} is beyond the limits {low:g} to {high:g}", "correct the value or its unit")
    return value


def _number(cell: str, name: str) -> float:
    """The value of a cell within the limits of its column."""
    return within(plain(cell), name, cell)


def plain(cell: str) -> float:
    """The number in a cell, or a `CellFault`."""
    if _NUMBER.fullmatch(cell):  # float() alone would take "1_000", "nan" and other digits
        return float(cell)
    if not cell:
        raise CellFault(*_EMPTY)
    if _NOT_FINITE.fullmatch(cell):
        raise CellFault(f"{shown(cell)} is not finite", "enter the value, or delete the row if nothing was read")
    if _THOUSANDS.fullmatch(cell):
        raise CellFault(
            f"{shown(cell)} has a thousands separator",
            f"write the digits alone, with a decimal point if one is meant; {IMPORT}",
        )
    if "," in cell:
        raise CellFault(f"{shown(cell)} has a comma", f"write a decimal point; {IMPORT}")
    raise CellFault(f"{shown(cell)} is not a number", f"write the number alone, without a unit; {IMPORT}")

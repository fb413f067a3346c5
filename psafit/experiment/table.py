"""Read one group's CSV file."""

from __future__ import annotations

import csv
import difflib
import io
import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment.records import CONDITION_COLUMNS, OPTIONAL_COLUMNS, REQUIRED_COLUMNS
from psafit.experiment.text import read_text, shown

MAX_ROWS = 1_000_000
MAX_CSV_BYTES = 128 * 1024 * 1024


# Hard limits of each column, far beyond any rig, within which nothing overflows; a wrong unit is only warned of.
LIMITS = {
    "frequency_hz": (1e-3, 1e9),
    "amplitude_v": (0.0, 1e6),
    "launch_range_um": (0.0, 1e9),
    "sigma_um": (1e-9, 1e9),
}

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([,' \u00a0\u202f]\d{3})+(\.\d*)?", re.ASCII)
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE)
_HEADER_REMEDY = f"the first line must read {','.join(REQUIRED_COLUMNS)} (and {OPTIONAL_COLUMNS[0]} if known)"


def read_csv(file: Path, *, planned: bool = False) -> dict[str, FloatArray]:
    """Read the columns of one CSV file, checked cell by cell; a planned one may lack readings."""
    text = read_text(file, MAX_CSV_BYTES)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    names: list[str] = []
    columns: list[list[float]] = []
    while True:
        line = reader.line_num + 1  # where the row begins: a quoted cell may span lines
        try:
            cells = next(reader)
        except StopIteration:
            break
        except csv.Error as error:
            raise InputError(
                f"not valid CSV ({error})",
                "write plain numbers, without quotes",
                file=file,
                line=line,
            ) from error
        if not cells:  # blank line, as editors leave at the end
            continue
        if not names:
            names = _header(cells, CONDITION_COLUMNS if planned else REQUIRED_COLUMNS, file, line)
            columns = [[] for _ in names]
            continue
        if len(cells) != len(names):
            raise InputError(
                f"{len(cells)} cell{'s' * (len(cells) != 1)} in the row, {len(names)} in the header",
                "separate cells by commas, not by semicolons or tabs"
                if _other_separator(cells)
                else "give one cell a column: decimal points, no thousands separators, no comments",
                file=file,
                line=line,
            )
        if len(columns[0]) == MAX_ROWS:
            raise InputError(
                f"more than {MAX_ROWS} rows",
                "split the file into several groups",
                file=file,
                line=line,
            )
        for name, column, cell in zip(names, columns, cells, strict=True):
            column.append(_number(cell.strip(), name, file, line))
    if not names:
        raise InputError("the file is empty", _HEADER_REMEDY, file=file, line=1)
    if not columns[0]:
        raise InputError("no readings below the header", "add one row a measurement", file=file, line=1)
    return {name: np.array(column) for name, column in zip(names, columns, strict=True)}


def _other_separator(cells: list[str]) -> str:
    """What stands in the place of commas in a row that has none; empty where nothing does."""
    marks = {";": "semicolons", "\t": "tabs"}
    return next((name for mark, name in marks.items() if len(cells) == 1 and mark in cells[0]), "")


def _header(cells: list[str], needed: Sequence[str], file: Path, line: int) -> list[str]:
    names = [cell.strip() for cell in cells]
    if separator := _other_separator(names):
        raise InputError(
            f"columns are separated by {separator}",
            "separate them with commas, and write decimal points",
            file=file,
            line=line,
        )
    known = (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS)
    for what, wrong in (
        ("unknown column", [n for n in names if n not in known]),
        ("missing column", [n for n in needed if n not in names]),
        ("repeated column", [n for n in known if names.count(n) > 1]),
    ):
        if wrong:
            remedy = _HEADER_REMEDY
            if what == "unknown column" and (near := difflib.get_close_matches(wrong[0][:40], known, n=1)):
                unit = near[0].rpartition("_")[2]
                remedy = f"did you mean {near[0]}, in {unit.replace('hz', 'Hz').replace('v', 'V')}?"
            if what == "missing column" and wrong == ["launch_range_um"]:
                remedy += "; without readings it is a plan, which psafit simulate takes"
            raise InputError(f"{what} {shown(wrong[0])}", remedy, file=file, line=line)
    return names


def _number(cell: str, name: str, file: Path, line: int) -> float:
    def error(what: str, remedy: str) -> InputError:
        return InputError(f"{name} {what}", remedy, file=file, line=line)

    if _NUMBER.fullmatch(cell):  # float() alone would take "1_000", "nan" and other digits
        value = float(cell) + 0.0  # no negative zero: it would change the fingerprint
        if not math.isfinite(value):
            raise error(f"{shown(cell)} is too large", "correct the reading or delete the row")
        if name in ("frequency_hz", "sigma_um") and value <= 0:
            raise error(f"{shown(cell)} is not positive", "correct the value or delete the row")
        if value < 0:
            raise error(f"{shown(cell)} is negative", "correct the value or delete the row")
        low, high = LIMITS[name]
        if not low <= value <= high:
            raise error(
                f"{shown(cell)} is beyond the limits {low:g} to {high:g}", "correct the value or delete the row"
            )
        return value
    if not cell:
        raise error("is empty", "enter the value or delete the row")
    if _NOT_FINITE.fullmatch(cell):
        raise error(f"{shown(cell)} is not finite", "enter the value or delete the row")
    if _THOUSANDS.fullmatch(cell):
        raise error(
            f"{shown(cell)} has a thousands separator",
            "write the digits alone, with a decimal point if one is meant",
        )
    if "," in cell:
        raise error(f"{shown(cell)} has a comma", "write a decimal point")
    raise error(f"{shown(cell)} is not a number", "write the number alone, without a unit")

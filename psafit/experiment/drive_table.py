"""Read the CSV file of a drive: one period, or a recorded voltage."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from psafit.drives import Table
from psafit.errors import InputError
from psafit.experiment.table import CellFault, RowFaults, headed, pairs, plain
from psafit.experiment.text import listed, shown

PERIOD, RECORDED = ("phase", "level"), ("time_us", "voltage_v")
_HEADER = f"the first line must read {','.join(PERIOD)} (one period) or {','.join(RECORDED)} (a recording)"
LIMITS = {"phase": (0.0, 1.0), "level": (-1e3, 1e3), "time_us": (0.0, 1e12), "voltage_v": (-1e6, 1e6)}
"""Hard limits of each column, far beyond any rig."""
SETTING_LIMITS = {"bias_v": (-1e5, 1e5), "idle_v": (-1e5, 1e5), "phase_deg": (-360.0, 360.0), "cycles": (1e-3, 1e9)}
"""Hard limits of a group's keys."""


def read_drive(file: Path, *, least_rows: int = 10, most_rows: int = 100_000, most_bytes: int = 2**24) -> Table:
    """Read the voltage of a drive, linear between the rows.

    Parameters
    ----------
    file : Path
        Columns ``phase, level``, from phase 0 to 1, or ``time_us, voltage_v``, from the start of the drive.
    least_rows : int
        A recording of fewer samples is none; a period may have two.
    most_rows, most_bytes : int
        A larger file is refused.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    line, header, rows = headed(file, most_bytes, _HEADER)
    names = tuple(map(str.lower, header))
    if names not in (PERIOD, RECORDED):
        what = f"columns {listed(map(shown, names))} are not those of a drive"
        raise InputError(what, f"{_HEADER}; psafit import --drive reads other forms", file=file, line=line)
    faults = RowFaults(file)
    found: list[tuple[float, float]] = []
    for line, two in pairs(rows, faults, most_rows, "rows", "record fewer samples, or fewer periods"):
        row = [_value(name, cell, faults, line) for name, cell in zip(names, two, strict=True)]
        if found and row[0] < found[-1][0]:
            faults.add(names[0], f"{row[0]:g} comes after {found[-1][0]:g}", "sort the rows", line)
        if not math.isnan(sum(row)):
            found.append((row[0], row[1]))
    faults.end(faults.n_rows)
    recorded = names == RECORDED
    at, value = np.array(found).reshape(-1, 2).T
    fault = _whole(at, least_rows if recorded else 2, recorded)
    if fault:
        raise InputError(*fault, file=file)
    return Table(at * 1e-6 if recorded else at, value, recorded)


def level(number: float, name: str, cell: str) -> float:
    """A value within the limits of its column, or a `CellFault`; `cell` is what stands in the file."""
    low, high = LIMITS.get(name) or SETTING_LIMITS[name]
    if low <= number <= high:
        return number + 0.0
    remedy = "begin at 0, the start of the drive" if number < 0.0 == low else "correct the value or its unit"
    raise CellFault(f"{shown(cell)} is not between {low:g} and {high:g}", remedy)


def _value(name: str, cell: str, faults: RowFaults, line: int) -> float:
    try:
        return level(plain(cell), name, cell)
    except CellFault as fault:
        faults.add(name, fault.what, fault.remedy, line)
        return math.nan


def _whole(at: np.ndarray, least: int, recorded: bool) -> tuple[str, str] | None:
    """What is wrong with the rows together, and the remedy."""
    if at.size < least:
        return f"{at.size} row{'s' * (at.size != 1)}; a drive has at least {least}", "give the voltage at more places"
    if not recorded and (at[0] != 0.0 or at[-1] != 1.0):
        return f"phases run from {at[0]:g} to {at[-1]:g}", "begin one period at phase 0 and end it at 1"
    if at[-1] <= at[0]:
        return "the rows are all at one place", "give the voltage at more places"
    return None

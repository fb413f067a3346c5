"""Read the CSV file of a trace: what one launch shows over time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from psafit.errors import InputError
from psafit.experiment.table import IMPORT, CellFault, RowFaults, headed, pairs, plain
from psafit.experiment.text import listed, shown
from psafit.observables import OBSERVABLES

TIME = "time_us"
TRACES = {o.column: k for k, o in enumerate(OBSERVABLES) if o.traced}
"""Columns of traces, with the observables' numbers."""
LIMITS = {TIME: (0.0, 1e9), **{name: OBSERVABLES[k].limits for name, k in TRACES.items()}}
"""Hard limits of each column, far beyond any rig."""
_HEADER = f"the first line must read {TIME} and one of {listed(TRACES)}"


def read_trace(
    file: Path,
    frequency_hz: float,
    amplitude_v: float,
    *,
    planned: bool = False,
    least_rows: int = 10,
    most_rows: int = 100_000,
    most_bytes: int = 2**24,
) -> dict[str, Any]:
    """Read a trace: what `psafit.experiment.Group` takes of it, each sample a point at one condition.

    Parameters
    ----------
    file : Path
        Columns ``time_us``, from the start of the drive, and one of `TRACES`, from rest.
    frequency_hz, amplitude_v : float
        Of the drive.
    planned : bool
        Whether it may lack readings: every cell of their column.
    least_rows : int
        Fewer samples are no trace.
    most_rows, most_bytes : int
        A larger file is refused.

    Returns
    -------
    dict of str to (n_points,) array
        Without `reading` where no cell holds one.

    Raises
    ------
    InputError
        With every fault of the file.
    """
    line, names, rows = headed(file, most_bytes, _HEADER)
    column = _column(names, file, line)
    faults = RowFaults(file)
    found: list[tuple[float, float]] = []
    blank: list[int] = []
    for line, two in pairs(rows, faults, most_rows, "samples", "keep every second one, or every tenth"):
        by_name = dict(zip(names, two, strict=True))
        time = _value(TIME, by_name[TIME], faults, line)
        if found and time <= found[-1][0]:
            faults.add(TIME, *out_of_order(found[-1][0], time), line)
        if not by_name[column]:
            blank.append(line)
        reading = _value(column, by_name[column], faults, line) if by_name[column] else math.nan
        found.append((time, reading))
    n_rows = faults.n_rows
    to_come = planned and len(blank) == n_rows
    if not to_come:
        faults.unread(column, blank, n_rows)
    faults.end(n_rows)
    if n_rows < least_rows:
        what = f"{n_rows} sample{'s' * (n_rows != 1)} below the header; a trace has at least {least_rows}"
        raise InputError(what, "record more, or give a launch range with file", file=file, line=1)
    time_us, reading = np.array(found).T
    held: dict[str, Any] = {
        "frequency_hz": np.full(n_rows, frequency_hz),
        "amplitude_v": np.full(n_rows, amplitude_v),
        "measured": np.full(n_rows, TRACES[column]),
        "time_us": time_us,
    }
    return held if to_come else held | {"reading": reading}


def _column(names: list[str], file: Path, line: int) -> str:
    """The column that is read with the time; `InputError` where the header is not one of a trace."""
    here = [name for name in names if name in TRACES]
    if len(here) > 1:
        what = f"columns {listed(here)} in one trace"
        raise InputError(what, "give each its own file and its own group", file=file, line=line)
    unknown = [shown(name) for name in names if name != TIME and name not in TRACES]
    if TIME not in names:
        what = f"missing column {TIME}"
    elif not here:
        among = f" next to {listed(unknown)}" if unknown else ""
        what = f"missing column {' or '.join(TRACES)}{among}"
    elif len(names) > 2:
        what = f"unknown column{'s' * (len(unknown) > 1)} {listed(unknown)}" if unknown else f"repeated column {TIME}"
    else:
        return here[0]
    raise InputError(what, f"{_HEADER}; {IMPORT}", file=file, line=line)


def out_of_order(before: float, time: float) -> tuple[str, str]:
    """What is wrong where a time (us) does not come after the one before, and the remedy."""
    return f"{time:g} comes after {before:g}", "sort the rows by time, and give each time once"


def possible(number: float, name: str, cell: str) -> float:
    """A value within the limits of its column, or a `CellFault`; `cell` is what stands in the file."""
    low, high = LIMITS[name]
    if low <= number <= high:
        return number + 0.0
    remedy = "correct the value or its unit"
    if name == TIME and number < 0.0:
        remedy = "count time from the start of the drive, and leave out what was read before it"
    raise CellFault(f"{shown(cell)} is not between {low:g} and {high:g}", remedy)


def _value(name: str, cell: str, faults: RowFaults, line: int) -> float:
    try:
        return possible(plain(cell), name, cell)
    except CellFault as fault:
        faults.add(name, fault.what, fault.remedy, line)
        return math.nan

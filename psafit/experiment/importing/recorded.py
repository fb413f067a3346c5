"""The voltage that an oscilloscope recorded as a drive: in a file of its own, or next to a trace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from statistics import mean

import numpy as np

from psafit.arrays import FloatArray
from psafit.drives import TABLE, Drive, Table, peak_to_peak
from psafit.errors import InputError
from psafit.experiment.drive_table import level
from psafit.experiment.importing.chosen import IDLE, VOLTAGE, Chosen
from psafit.experiment.importing.clock import early, less
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.layout import Body, Head, body
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.values import Reading, check_ends, readings
from psafit.experiment.table import CellFault, RowFaults
from psafit.experiment.trace_table import TIME, out_of_order

ALL = "drive.csv"
"""The file, in an experiment folder, of a drive that all groups have."""


@dataclass(frozen=True)
class Recording:
    """A drive in a file of its own, as it is kept and with each of its samples; what it was read from.

    That is the rows of that file, all samples on the drive's clock, and the decimal mark.
    """

    drive: Drive
    whole: Drive
    body: Body
    samples: tuple[Reading, ...]
    decimal: str


def recorded(grid: Grid, head: Head, chosen: Chosen, options: Options) -> Recording:
    """Read a voltage over time from a file of its own.

    Parameters
    ----------
    grid : Grid
    head : Head
    chosen : Chosen
        What `choose_recording` says of its columns.
    options : Options
        `start_us`, `every` and `period_us` say from when, how closely and until when.

    Returns
    -------
    Recording
        Its drive has means of `every` samples: with a period one period, per volt of the largest voltage before means
        were taken; else as recorded.

    Raises
    ------
    InputError
        Where time or voltage cannot be read, or do not reach over the period.
    """
    rows = body(grid, head, [c.place for c in chosen.columns], options)
    found, decimal = readings(grid, head, chosen, rows, options, TABLE)
    early(grid, found, options)
    start, period = options.start_us or 0.0, options.period_us
    samples = [less(reading, {TIME: start}) for reading in found]
    time, volts = _over_time(grid, samples, options)
    end = float(time[-1]) if period is None else period
    if not time[0] <= 0.0 < end <= time[-1]:
        times = [f"{t + start:g}" for t in (time[0], time[-1], 0.0, end)]
        what = "the recording lasts from {} to {} us, the drive from {} to {} us".format(*times)
        raise InputError(what, "correct --start or --period, or record longer", file=grid.file)
    at, value = _cut(time, volts, end, options.every)
    if not options.least_samples <= at.size <= options.most_samples:
        what = f"{at.size} rows of the drive, which has {options.least_samples} to {options.most_samples}"
        few = at.size < options.least_samples
        remedy = "record more closely, or give a smaller --every" if few else "give a larger --every"
        raise InputError(what, remedy, file=grid.file)
    every, each = (at, value), _cut(time, volts, end, 1)
    if period is None:
        rest = _idle(grid, samples, volts, options)
        drive, whole = (
            Drive(TABLE, idle_v=rest, table=Table(at * 1e-6, value, recorded=True), file=ALL)
            for at, value in (every, each)
        )
        return Recording(drive, whole, rows, tuple(samples), decimal)
    largest = float(np.abs(each[1]).max())
    if largest == 0.0:
        raise InputError("the recorded voltage is zero throughout", "give another channel", file=grid.file)
    drive, whole = (
        Drive(TABLE, table=Table(at / period, value / largest, recorded=False), file=ALL) for at, value in (every, each)
    )
    return Recording(drive, whole, rows, tuple(samples), decimal)


def drive_of(grid: Grid, samples: Sequence[Reading], options: Options) -> Drive:
    """The drive of a trace: as it was recorded next to it, all of it; or the one that its rows have.

    Parameters
    ----------
    grid : Grid
    samples : sequence of Reading
        From the start of the drive; those before it count negative times.
    options : Options

    Raises
    ------
    InputError
        Where times fall, or what the drive rested at is not known, or it did not rest.
    """
    if VOLTAGE not in dict(samples[0].values):
        return samples[0].drive
    time, volts = _over_time(grid, samples, options)
    if time[-1] <= 0.0:
        what = "no sample lies after the start of the drive"
        raise InputError(what, "correct --start", file=grid.file, line=samples[-1].line)
    idle = _idle(grid, samples, volts, options)
    at, value = _cut(time, volts, float(time[-1]), 1)
    return Drive(TABLE, idle_v=idle, table=Table(at * 1e-6, value, recorded=True), file="")


def _over_time(grid: Grid, samples: Sequence[Reading], options: Options) -> tuple[FloatArray, FloatArray]:
    """Times, us, and voltages. Two samples may have one time, as rounded times do."""
    time, volts = np.array([[dict(r.values)[name] for name in (TIME, VOLTAGE)] for r in samples]).T
    faults, clock = RowFaults(grid.file), time + (options.start_us or 0.0)
    for k in np.flatnonzero(np.diff(time) < 0.0).tolist():
        faults.add(TIME, *out_of_order(clock[k], clock[k + 1]), samples[k + 1].line)
    try:
        level(max(0.0, float(time[-1])), TIME, f"{clock[-1]:g} us")
    except CellFault as fault:
        faults.add(TIME, fault.what, fault.remedy, samples[-1].line)
    faults.end(len(samples))
    return time, volts


def _cut(time: FloatArray, volts: FloatArray, end: float, every: int) -> tuple[FloatArray, FloatArray]:
    """Times and voltages from the start to `end`, linear between samples there; in between means of `every`."""
    inside = (time > 0.0) & (time <= end)
    n = np.count_nonzero(inside) // every
    at, value = (x[inside][: n * every].reshape(n, every).mean(axis=1) for x in (time, volts))
    if time[0] <= 0.0:
        at, value = np.append(0.0, at), np.append(np.interp(0.0, time, volts), value)
    if at[-1] < end:
        at, value = np.append(at, end), np.append(value, np.interp(end, time, volts))
    return at, value


def _idle(grid: Grid, samples: Sequence[Reading], volts: FloatArray, options: Options) -> float:
    """What the drive rested at before its start, V: the mean of what was recorded there, if nobody says it.

    Raises
    ------
    InputError
        Where neither shows it, or the drive did not rest.
    """
    if IDLE in dict(options.values):
        return options.held.get(IDLE, 0.0)
    least = options.most_at_rest * float(np.ptp(volts))
    before = volts[[dict(r.values)[TIME] < 0.0 for r in samples]]
    if before.size and np.ptp(before) <= least:
        return float(mean(Decimal(repr(v)) for v in before.tolist()))
    if before.size:
        what = f"{VOLTAGE} goes from {before.min():g} to {before.max():g} V before the start of the drive, where it"
        what, remedy = f"{what} should rest", f"say with --start when it begins, or what it rests at: --set {IDLE}=0"
    elif abs(first := float(volts[0])) > least:
        what = f"{VOLTAGE} begins at {first:g} V, and nothing says what the drive rested at before"
        remedy = f"say --set {IDLE}=0 or --set {IDLE}={first:g}"
    else:
        return 0.0
    raise InputError(what, remedy, file=grid.file, line=samples[0].line)


def at_amplitude(grid: Grid, samples: Sequence[Reading], drive: Drive) -> list[Reading]:
    """Samples whose amplitude, where it was counted peak to peak, is that of the drive that was recorded with them."""
    if not samples or VOLTAGE not in dict(samples[0].values):
        return list(samples)
    check_ends(grid, samples[0], drive)
    factor = peak_to_peak(samples[0].drive) / peak_to_peak(drive)
    return [_times(r, factor) if r.counted == "pp" else r for r in samples]


def _times(reading: Reading, factor: float) -> Reading:
    """A reading at its amplitude times a factor."""
    values = ((name, value * factor if name == "amplitude_v" else value) for name, value in reading.values)
    return replace(reading, values=tuple(values))


def reach(table: Table) -> str:
    """What a drive's rows go through, for people."""
    low, high = float(table.value.min()), float(table.value.max())
    if table.recorded:
        return f"{table.at.size} rows, {table.at[-1] * 1e6:g} us, {low:.4g} to {high:.4g} V"
    return f"{table.at.size} rows, {low:.3g} to {high:.3g} per volt of amplitude_v"


__all__ = ["at_amplitude", "drive_of", "reach", "recorded"]

"""Samples over time, counted from the start of the drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal

from psafit.errors import InputError
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.values import Reading
from psafit.experiment.trace_table import TIME


def early(grid: Grid, samples: Sequence[Reading], options: Options) -> list[Reading]:
    """Samples before the start of the drive.

    Raises
    ------
    InputError
        Where there are some before 0, or none near it, and no start is given.
    """
    times = [dict(r.values)[TIME] for r in samples]
    before = [r for r, time in zip(samples, times, strict=True) if time < (options.start_us or 0.0)]
    if options.start_us is not None:
        return before
    if before:
        what = f"{TIME} begins at {dict(before[0].values)[TIME]:g}, before the start of the drive"
        remedy = "say --start 0 where that is at 0, or when it is: --start 1.5:ms; what lies before is left out"
        raise InputError(what, remedy, file=grid.file, line=before[0].line)
    if len(times) < options.least_samples:
        return before
    begin = min(times)
    if begin > 10 * (max(times) - begin) / (len(times) - 1):
        what = f"{TIME} begins at {begin:g}, and nothing says when the drive starts"
        remedy = f"say --start {begin:.10g}:us if with the first sample, or --start 0 if times count from its start"
        raise InputError(what, remedy, file=grid.file, line=samples[0].line)
    return before


def less(reading: Reading, zeros: Mapping[str, float]) -> Reading:
    """A sample less what is to be subtracted, in decimal digits, as people would write it."""
    differences = (
        (name, float(Decimal(repr(value)) - Decimal(repr(zero))) if (zero := zeros.get(name, 0.0)) else value)
        for name, value in reading.values
    )
    return replace(reading, values=tuple(differences))


__all__ = ["early", "less"]

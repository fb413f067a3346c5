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
    before = [r for r in samples if dict(r.values)[TIME] < (options.start_us or 0.0)]
    if before and options.start_us is None:
        what = f"{TIME} begins at {dict(before[0].values)[TIME]:g}, before the start of the drive"
        remedy = "say --start 0 where that is at 0, or when it is: --start 1.5:ms; what lies before is left out"
        raise InputError(what, remedy, file=grid.file, line=before[0].line)
    times = sorted(dict(r.values)[TIME] for r in samples)
    few = len(times) < options.least_samples
    if options.start_us is None and not few and times[0] > 10 * (times[-1] - times[0]) / (len(times) - 1):
        what = f"{TIME} begins at {times[0]:g}, and nothing says when the drive starts"
        remedy = f"say --start {times[0]:.10g}:us if with the first sample, or --start 0 if times count from its start"
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

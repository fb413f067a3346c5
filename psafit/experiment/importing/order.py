"""Rows in which two columns have changed places, as far as their numbers show it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment.importing.chosen import READ, Column, role
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.numerals import numbers

Parts = tuple[NDArray[np.bool_], NDArray[np.bool_]]
"""Rows in which one of two columns is larger, and those in which the other one is."""


def check_order(grid: Grid, columns: Sequence[Column], rows: Sequence[Row]) -> None:
    """The columns of all rows are in one order, as far as the sizes of their numbers show it.

    Parameters
    ----------
    grid : Grid
    columns : sequence of Column
        Those that are used.
    rows : sequence of Row
        Those of readings.

    Raises
    ------
    InputError
        With the first two columns that seem to have changed places.
    """
    sizes = {column: _sizes(rows, column.place) for column in columns if role(column.column)}
    for pair in combinations(sorted(sizes, key=lambda c: c.place), 2):
        filled = np.flatnonzero(np.abs(sizes[pair[0]] - sizes[pair[1]]) > 0)
        both = np.array([sizes[column][filled] for column in pair])
        turned = (both[0] > both[1]) != (both[0] > both[1])[:1]
        if not turned.any() or not _changed(both, (~turned, turned)) or _as_set(pair, both, (~turned, turned)):
            continue
        what = f"columns {pair[0].name} and {pair[1].name} seem to have changed places from here on"
        remedy = "give such rows a file of their own; if they are in order, write one of both in another unit"
        n = f"{turned.sum()} row{'s' if turned.sum() > 1 else ''}"
        raise InputError(f"{what}, in {n}", remedy, file=grid.file, line=rows[filled[turned][0]].line)


def _sizes(rows: Sequence[Row], place: int) -> FloatArray:
    """The logarithms of the numbers in a column, whatever their signs; NaN where there is none, or 0."""
    cells = [row.cells[place] if place < len(row.cells) else "" for row in rows]
    sizes = np.array([abs(float(number.value)) if number else 0.0 for number in numbers(cells)])
    return np.log(sizes, where=(sizes > 0) & np.isfinite(sizes), out=np.full(sizes.shape, np.nan))


def _changed(
    both: FloatArray,
    parts: Parts,
    *,
    least: float = 25.0,
    near: float = 2.0,
    apart: float = 4.0,
    jump: float = 2.0,
    block: int = 4,
) -> bool:
    """Whether two columns have changed places: the rows fit each other better the other way round.

    Parameters
    ----------
    both : (2, n_rows) array
        Logarithms of the two.
    parts : Parts
    least : float
        By this factor the sizes are nearer the other way round, that of both columns together.
    near : float
        One of them is the same then, within this factor: a sweep is repeated at another amplitude, say.
    apart : float
        So far apart are the ratios of both in the two parts: numbers over time pass each other.
    jump : float
        By this factor both jump at the first row of the other order, in opposite ways: those of a sweep pass, too.
    block : int
        So many rows or more stand in one order, on average: conditions that were mixed do not.
    """
    there, here = (both[:, rows].mean(axis=1) for rows in parts)
    stays, changes = np.abs(here - there), np.abs(here[::-1] - there)
    between = sum(np.abs(both[0] - both[1])[rows].min() for rows in parts)
    first = int(parts[1].argmax())
    steps = both[:, first] - both[:, first - 1]
    return bool(
        stays.sum() - changes.sum() > math.log(least)
        and changes.min() <= math.log(near)
        and between >= math.log(apart)
        and steps.prod() < 0
        and np.abs(steps).min() >= math.log(jump)
        and np.count_nonzero(np.diff(parts[1])) <= max(2, parts[1].size / block)
    )


def _as_set(pair: Sequence[Column], both: FloatArray, parts: Parts) -> bool:
    """Whether a condition is in equal steps in both parts, and a reading in neither: each is in its own column."""
    read = [role(column.column) in READ for column in pair]
    regular = [[_regular(sizes[rows]) for rows in parts] for sizes in both]
    return read[0] != read[1] and all(regular[read.index(False)]) and not any(regular[read.index(True)])


def _regular(sizes: FloatArray, *, least: int = 3, within: float = 0.02) -> bool:
    """Whether numbers, of which these are the logarithms, are in equal steps or ratios.

    There are `least` of them, and each step is the mean one, `within` this part of it.
    """
    ratios = np.unique(sizes)
    steps = (np.diff(ratios), np.diff(np.exp(ratios)))
    return ratios.size >= least and any(np.abs(s - s.mean()).max() <= within * s.mean() for s in steps)


__all__ = ["check_order"]

"""The time of the first sample, as a file names it: times that are counted from that sample leave it out."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import takewhile

from psafit.errors import InputError
from psafit.experiment.importing.chosen import Chosen
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.layout import Head
from psafit.experiment.importing.numerals import NOTATIONS, is_number
from psafit.experiment.importing.quantities import COMMENTS, ORIGINS, words
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.units import factor_of
from psafit.experiment.importing.values import Reading
from psafit.experiment.text import shown
from psafit.experiment.trace_table import TIME

# A name and what is said of it; a number, its unit, and what is said of other channels. Cells are joined by "=",
# or by commas that may be decimal.
_SAYS = re.compile(r"\s*[=:;,|]\s*|\s+(?=[-+.]?\d)")
_VALUE = re.compile(r"([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d]+)?(?:[\s=;,|].*)?", re.ASCII)


def check_origin(grid: Grid, head: Head, chosen: Chosen, found: Sequence[Reading], options: Options) -> None:
    """The time that a file gives its first sample is not left out, where samples are counted and the drive starts at 0.

    Any other start is on the clock that begins with the first sample.

    Raises
    ------
    InputError
        Where the first sample has another time than the one that is named.
    """
    if options.start_us or not _is_counted(grid, chosen) or not found:
        return
    first = Decimal(repr(min(dict(r.values)[TIME] for r in found)))
    for line, text, origin in _origins(grid, head):
        if start := first - origin:
            what = f"{shown(text)} is the time of the first sample, and times count from that sample"
            remedy = f"say --start={start.normalize():f}:us if the drive starts at 0 of that clock, or write 0 into the"
            raise InputError(what, f"{remedy} file if it starts with that sample", file=grid.file, line=line)


def unread_origin(grid: Grid, head: Head, chosen: Chosen, options: Options) -> Iterator[tuple[int, str, str]]:
    """What gives the first sample another time, where the start that is given is not 0 of it: line, text and remedy."""
    start = Decimal(repr(options.start_us or 0.0))
    for line, text, origin in _origins(grid, head) if start and _is_counted(grid, chosen) else ():
        if origin and start != -origin:
            yield line, text, f"say --start={(start - origin).normalize():f}:us where yours is on that clock"


def _is_counted(grid: Grid, chosen: Chosen) -> bool:
    """Whether times are counts of samples."""
    return grid.counts is not None or any(c.unit and c.unit.scale is not None for c in chosen.of(TIME))


def _origins(grid: Grid, head: Head) -> Iterator[tuple[int, str, Decimal]]:
    """What names the time of the first sample, above the headings or next to them: line, text, and that time, us."""
    marks = "".join(COMMENTS) + " "
    rows = [*takewhile(lambda row: row.line <= head.line, grid.rows)] or grid.rows[: head.first]
    for row in rows:
        mark = "," if grid.separator == "," else "="
        whole = mark.join(text for text in row.texts if text.strip(marks)).lstrip(marks)
        for text in row.texts if row.line == head.line else (whole,):
            yield from _origin(row.line, text)
    if head.line:
        named, below = rows[-1], grid.rows[len(rows) : head.first + 1]
        for place, text in enumerate(named.texts):  # a number that stands once below its name
            numbers = [row.texts[place] for row in below if place < len(row.texts) and row.texts[place]]
            if len(numbers) == 1 and is_number(numbers[0]):
                yield from _origin(named.line, f"{text}={numbers[0]}")


def _origin(line: int, text: str) -> Iterator[tuple[int, str, Decimal]]:
    name, rest = (*_SAYS.split(text, maxsplit=1), "")[:2]
    value = _VALUE.fullmatch(rest) if words(name) in ORIGINS else None
    numbers = {v for notation in NOTATIONS.values() if value and (v := notation.value(value[1])) is not None}
    factor = factor_of(value[2] or "s", "us") if value else None
    if len(numbers) == 1 and factor is not None:
        yield line, " ".join(text.replace("=", " = ").split()), numbers.pop() * factor


__all__ = ["check_origin", "unread_origin"]

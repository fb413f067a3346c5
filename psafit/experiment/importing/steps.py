"""Samples without times: their step, as a header or the user gives it, and a column that counts them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import pairwise

from psafit.errors import InputError
from psafit.experiment.importing.chosen import (
    AS_IT_STANDS,
    VOLTAGE,
    Column,
    all_headings,
    cells,
    fault,
    nearest,
    option,
)
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.headings import Heading, heading
from psafit.experiment.importing.layout import Head, body, names
from psafit.experiment.importing.numerals import NOTATIONS, counts_rows, is_number, whole
from psafit.experiment.importing.over_time import clock
from psafit.experiment.importing.quantities import BLANKS, CLOCK_UNITS, COLUMNS, COMMENTS, STEPS, THINNED, Quantity
from psafit.experiment.importing.records import IGNORED, Mapping, Options
from psafit.experiment.importing.units import Unit, spacing, unit
from psafit.experiment.text import listed, shown
from psafit.experiment.trace_table import TIME

STEP = "--step"
"""What a column of counts is called, where that option gives the step."""
# A name and what is said of it; a number and its unit. Cells are joined by "=".
_SAYS = re.compile(r"\s*[=:;,|]\s*|\s+(?=[+.]?\d)")
_VALUE = re.compile(r"\+?([\d.,]*\d(?:[eE][+-]?\d+)?)[\s=;,|]*(\D.*)?", re.ASCII)


def with_counts(grid: Grid, head: Head, options: Options, *, recording: bool = False) -> tuple[Grid, Head, Options]:
    """Give samples without times a column that counts them, mapped to the time; a time the unit that a header names.

    Parameters
    ----------
    grid : Grid
    head : Head
    options : Options
    recording : bool
        Whether the file is said to hold a recorded drive.

    Raises
    ------
    InputError
        Where nothing says the step, or when the drive starts; where a sample is missing, or may be a launch.
    """
    head = _with_clock(grid, head)
    could = _could(grid, head, options)
    places = _recorded(head, could) if recording else _moving(grid, head, options, could)
    if not places:
        return grid, head, options
    name, step = (STEP, options.step_us) if options.step_us else _stated(grid, head, places, options)
    if options.start_us is None:
        what = "the samples have no times, and nothing says when the drive starts"
        raise fault(grid, head, what, "say --start 0 if with the first of them, or how much later: --start 1.5:ms")
    rows = body(grid, head, places, options).rows
    _check_header(grid, head, rows, min(places), options)
    _check_counter(grid, head, rows, [k for k, each in enumerate(could) if not each], options, step)
    for above, below in pairwise(rows):
        if below.line != above.line + 1:
            what, remedy = "no sample stands here, between others without times", "delete the line if none is missing"
            raise InputError(what, remedy, file=grid.file, line=above.line + 1)
    place, number = len(head.headings), {row.line: str(k) for k, row in enumerate(rows)}
    counted = (
        Row(r.line, (*r.cells, *[""] * (place - len(r.cells)), number[r.line]), place + 1) if r.line in number else r
        for r in grid.rows
    )
    headings = (*head.headings, Heading(name, "", None, None, None))
    columns = (*options.columns, Mapping(name, TIME, Unit("us", scale=step)))
    return (
        replace(grid, rows=tuple(counted), counts=place),
        replace(head, headings=headings, units=(*head.units, None)),
        replace(options, columns=columns),
    )


def _check_header(grid: Grid, head: Head, rows: Sequence[Row], first: int, options: Options) -> None:
    """A word before the number of a sample, where most samples have none, is of a header: no sample stands there."""
    ignored = {place for m in options.columns if m.column == IGNORED for place in names(m, head.headings)}
    before = [[t for k, t in enumerate(row.texts[:first]) if t and k not in ignored] for row in rows]
    said = [(row, texts[0]) for row, texts in zip(rows, before, strict=True) if texts and not is_number(texts[0])]
    if said and 2 * len(said) < len(rows):
        lines = f", as in {len(said)} lines" if len(said) > 1 else ""
        what = f"{shown(said[0][1])} stands before a number that would be a sample{lines}"
        columns = dict.fromkeys(row.texts.index(text) for row, text in said)
        ignore = " ".join(option(str(place + 1), IGNORED) for place in columns)
        remedy = f"put # before each such line if it is of a header, or say {ignore} if they are samples"
        raise InputError(what, remedy, file=grid.file, line=said[0][0].line)


def _check_counter(
    grid: Grid, head: Head, rows: Sequence[Row], others: Sequence[int], options: Options, step: Decimal
) -> None:
    """A column that counts samples counts the rows: where it does not, rows are missing, or are of other steps."""
    said = {place for m in options.columns for place in names(m, head.headings)}
    for place in (k for k in others if k not in said and head.unit(k) is None):
        counts = whole([row.texts[place] if place < len(row.texts) else "" for row in rows])
        if len(counts) < 2 or counts_rows(counts):
            continue
        ((usual, n),) = Counter(b - a for a, b in pairwise(counts)).most_common(1)
        if usual > 0 and 2 * n > len(counts):
            column = Column(place, head.headings[place], "")
            what = f"column {column.name} counts from {counts[0]} to {counts[-1]}, and there are {len(counts)} samples"
            alone = " without --step" if options.step_us else ""
            remedy = f"say {option(column.option, TIME, f'{step:f}us')}{alone}, if {step:f} us is a step of that count"
            remedy = f"{remedy}, or {option(column.option, IGNORED)} if it is from row to row"
            raise InputError(what, remedy, file=grid.file, line=rows[0].line)


def _could(grid: Grid, head: Head, options: Options) -> list[list[Quantity]]:
    """What each column may hold; one that the user names has that alone, and an empty one nothing."""
    said = {place: m.column for m in options.columns for place in names(m, head.headings)}
    could: list[list[Quantity]] = []
    for place, (named, below) in enumerate(zip(head.headings, head.units, strict=True)):
        if place in said:
            could.append([COLUMNS[said[place]]] if said[place] in COLUMNS else [])
        else:
            could.append(named.over_time(below) if cells(grid, head, place) else [])
    return could


def _moving(grid: Grid, head: Head, options: Options, could: Sequence[Sequence[Quantity]]) -> list[int]:
    """The columns of motion of a table without times.

    Raises
    ------
    InputError
        Where they may be launches.
    """
    columns = {q.column for each in could for q in each}
    roles = [{q.role for q in each} for each in could]
    motions = [k for k, of in enumerate(roles) if "trace" in of]
    said = {place for m in options.columns for place in names(m, head.headings)}
    if TIME in columns or said.intersection(motions):
        return [] if TIME in columns else sorted(said.intersection(motions))
    if not motions or {"reading"} in roles or ("frequency_hz" in columns and options.step_us is None):
        return []
    if options.step_us is not None or {"trace"} in roles:
        return motions
    n = sum(map(is_number, cells(grid, head, motions[0])))
    if "amplitude_v" not in columns and n >= options.least_samples:
        column = Column(motions[0], head.headings[motions[0]], "")
        launch = next(q.column for q in could[motions[0]] if q.role == "reading")
        what = f"column {column.name} may be a trace over time, or read of launches"
        others = [Column(k, h, "") for k, h in enumerate(head.headings) if k not in said and k not in motions]
        found = clock(grid, head, others, options)
        stated = list(_lines(grid, head))
        clear = all(step for _, _, step in stated)
        steps = {step: f"say --step {step:f}:us, as line {line} says" for line, _, step in stated if step and clear}
        unclear = f"say the step, which does not follow from {_cited(stated)}: --step NUMBER:us" if stated else ""
        remedy = (found and found[1]) or " or ".join(steps.values()) or unclear or "say its step, such as --step 1:us"
        raise fault(grid, head, what, f"{remedy.rstrip(',')}, or {option(column.option, launch)}")
    return []


def _recorded(head: Head, could: Sequence[Sequence[Quantity]]) -> list[int]:
    """The columns of volts of a recording without times; none of a table that has conditions."""
    units = [head.unit(k) for k in range(len(could))]
    known = {q.column for each in could for q in each} | {TIME for u in units if u and u.kind == "us"}
    said = [k for k, each in enumerate(could) if [q.column for q in each] == [VOLTAGE]]
    return [] if known & {TIME, "frequency_hz"} else said or [k for k, u in enumerate(units) if u and u.kind == "V"]


def _stated(grid: Grid, head: Head, places: Sequence[int], options: Options) -> tuple[str, Decimal]:
    """The line above the samples that says their step, and that step, us.

    Raises
    ------
    InputError
        Where there is none, or several say different ones.
    """
    said = list(_lines(grid, head))
    others = [Column(k, h, "") for k, h in enumerate(head.headings) if k not in places]
    near = nearest(others, head, TIME)
    if not near and len({step for _, _, step in said}) == 1 and (step := said[0][2]):
        return said[0][1], step
    what = f"samples, and no {TIME} among {all_headings(head)}"
    found = clock(grid, head, others, options)
    remedy = f"say {option(near.option if near else 'NAME', TIME, '' if near else 'us')}"
    if near:
        remedy = f"{remedy}, {AS_IT_STANDS}"
    elif found:
        remedy = f"{found[1]}, or of equal steps say --step 1:us"
    else:
        remedy = f"say their step, --step 1:us, or their rate, --step 1:MHz; of a time that is there {remedy[4:]}"
    if said and not near:
        what = f"{what}; their step does not follow from {_cited(said)}"
    raise fault(grid, head, what, remedy)


def _lines(grid: Grid, head: Head) -> Iterator[tuple[int, str, Decimal | None]]:
    """Line, text and step, us, where a line above the samples speaks of it; None where that is not clear."""
    clocks = _clock_units(grid, head)
    for row, named, rest in _above(grid, head):
        found = _VALUE.fullmatch(rest)
        values = {v for n in NOTATIONS.values() if found and (v := n.value(found[1])) is not None}
        if named.name in THINNED and values != {Decimal(1)}:
            yield row.line, " ".join(filter(None, row.texts)), None
        if named.name not in STEPS:
            continue
        units = {found[2]} if found and found[2] else {named.unit.text} if named.unit else clocks
        steps = {spacing(v, u, STEPS[named.name]) for v in values for u in units}
        yield row.line, " ".join(filter(None, row.texts)), steps.pop() if len(steps) == 1 else None


def _cited(said: Sequence[tuple[int, str, Decimal | None]]) -> str:
    return listed(f"{shown(text)} (line {line})" for line, text, _ in said)


def _above(grid: Grid, head: Head) -> list[tuple[Row, Heading, str]]:
    """The lines above the samples, what each is about, and what it says of that."""
    return [(row, *_parts(row, grid.separator)) for row in grid.rows[: head.first] if row.line != head.line]


def _clock_units(grid: Grid, head: Head) -> set[str]:
    """Units of the clock that lines above the samples name: ``Horizontal Units,s``."""
    return {rest for _, named, rest in _above(grid, head) if named.name in CLOCK_UNITS}


def _with_clock(grid: Grid, head: Head) -> Head:
    """Headings in which a time without a unit has the one that a line above them names."""
    said = {text: found for text in _clock_units(grid, head) if (found := unit(text)) and found.kind == "us"}
    times = [k for k, h in enumerate(head.headings) if [q.column for q in h.quantities(head.units[k])] == [TIME]]
    if len(said) != 1 or len(times) != 1 or head.unit(times[0]):
        return head
    (clock_unit,) = said.values()
    units = (clock_unit if k == times[0] else u for k, u in enumerate(head.units))
    return replace(head, units=tuple(units))


def _parts(row: Row, separator: str) -> tuple[Heading, str]:
    """What a line of a header is about, and what it says of it."""
    marks = "".join(COMMENTS)
    filled = (text for text in row.texts if text.strip(marks))
    text = (" " if separator in BLANKS else "=").join(filled).lstrip(marks + " ")
    name, rest = (*_SAYS.split(text, maxsplit=1), "")[:2]
    return heading(name), rest


__all__ = ["STEP", "with_counts"]

"""Samples without times: their step, as a header or the user gives it, and a column that counts them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import pairwise

from psafit.errors import InputError
from psafit.experiment.importing.chosen import VOLTAGE, Column, all_headings, cells, fault, nearest, option, role
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.headings import Heading, heading
from psafit.experiment.importing.layout import Head, body, names
from psafit.experiment.importing.numerals import NOTATIONS, is_number
from psafit.experiment.importing.over_time import clock
from psafit.experiment.importing.quantities import BLANKS, CLOCK_UNITS, COMMENTS, STEPS
from psafit.experiment.importing.records import Mapping, Options
from psafit.experiment.importing.units import Unit, spacing
from psafit.experiment.text import listed, shown
from psafit.experiment.trace_table import TIME

STEP = "--step"
"""What a column of counts is called, where that option gives the step."""
# A name and what is said of it; a number and its unit.
_SAYS = re.compile(r"\s*[=:;,|]\s*|\s+(?=[+.]?\d)")
_VALUE = re.compile(r"\+?([\d.,]*\d(?:[eE][+-]?\d+)?)[\s;,|]*(\D.*)?", re.ASCII)


@dataclass(frozen=True)
class _Said:
    """A line of a header that speaks of the step: the step, us, where that is clear, and how the user would say it."""

    row: Row
    step: Decimal | None
    example: str

    @property
    def text(self) -> str:
        return " ".join(filter(None, self.row.texts))


def counted(grid: Grid, head: Head, options: Options, *, recording: bool = False) -> tuple[Grid, Head, Options]:
    """Give samples without times a column that counts them, and say what a count is; leave any other table as it is.

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
    places = (_recorded if recording else _moving)(grid, head, options)
    if not places:
        return grid, head, options
    name, step = (STEP, options.step_us) if options.step_us else _stated(grid, head, places)
    if options.start_us is None:
        what = "the samples have no times, and nothing says when the drive starts"
        raise fault(grid, head, what, "say --start 0 if with the first of them, or how much later: --start 1.5:ms")
    rows = body(grid, head, places, options.most_rows).rows
    for above, below in pairwise(rows):
        if below.line != above.line + 1:
            what, remedy = "no sample stands here, between others without times", "delete the line if none is missing"
            raise InputError(what, remedy, file=grid.file, line=above.line + 1)
    place, number = len(head.headings), {row.line: str(k) for k, row in enumerate(rows)}

    def numbered(row: Row) -> Row:
        if row.line not in number:
            return row
        return Row(row.line, (*row.cells, *[""] * (place - len(row.cells)), number[row.line]), place + 1)

    headings = (*head.headings, Heading(name, "", None, None, None))
    grid = replace(grid, rows=tuple(map(numbered, grid.rows)), counts=place)
    columns = (*options.columns, Mapping(name, TIME, Unit("us", scale=step)))
    return grid, replace(head, headings=headings, units=(*head.units, None)), replace(options, columns=columns)


def _mapped(head: Head, options: Options) -> dict[int, str]:
    return {place: m.column for m in options.columns for place in names(m, head.headings)}


def _moving(grid: Grid, head: Head, options: Options) -> list[int]:
    """The columns of motion of a table without times.

    Raises
    ------
    InputError
        Where they may be launches.
    """
    mapped = _mapped(head, options)
    could = {k: h.over_time(head.units[k]) for k, h in enumerate(head.headings) if k not in mapped}
    columns = {*mapped.values(), *(q.column for each in could.values() for q in each)}
    said = [k for k, column in mapped.items() if role(column) == "trace"]
    motions = [k for k, each in could.items() if any(q.role == "trace" for q in each)]
    if TIME in columns or said or not motions:
        return [] if TIME in columns else said
    launched = any(role(c) == "reading" for c in mapped.values())
    launched = launched or any(each and all(q.role == "reading" for q in each) for each in could.values())
    if launched or ("frequency_hz" in columns and options.step_us is None):
        return []
    if options.step_us is not None or any(all(q.role == "trace" for q in could[k]) for k in motions):
        return motions
    n = sum(map(is_number, cells(grid, head, motions[0])))
    if "amplitude_v" not in columns and n >= options.least_samples:
        column = Column(motions[0], head.headings[motions[0]], "")
        launch = next(q.column for q in could[motions[0]] if q.role == "reading")
        what = f"column {column.name} may be a trace over time, or read of launches"
        others = [Column(k, h, "") for k, h in enumerate(head.headings) if k not in mapped and k not in motions]
        found = clock(grid, head, others, options)
        remedy = found[1] if found else "say its step, such as --step 1:us"
        raise fault(grid, head, what, f"{remedy}, or {option(column.option, launch)}")
    return []


def _recorded(grid: Grid, head: Head, options: Options) -> list[int]:
    """The columns of volts of a recording without times; none of a table that has conditions."""
    mapped = _mapped(head, options)
    others = [(k, h, head.unit(k)) for k, h in enumerate(head.headings) if k not in mapped]
    known = {*mapped.values(), *(q.column for k, h, _ in others for q in h.quantities(head.units[k]))}
    known |= {TIME for _, _, of in others if of and of.kind == "us"}
    if not known.isdisjoint((TIME, "frequency_hz")):
        return []
    said = [k for k, column in mapped.items() if column == VOLTAGE]
    return said or [k for k, _, of in others if of and of.kind == "V"]


def _stated(grid: Grid, head: Head, places: Sequence[int]) -> tuple[str, Decimal]:
    """The line above the samples that says their step, and that step, us.

    Raises
    ------
    InputError
        Where there is none, or several say different ones.
    """
    said = list(_lines(grid, head))
    others = [Column(k, h, "") for k, h in enumerate(head.headings) if k not in places]
    near = nearest(others, head, TIME)
    if not near and len({one.step for one in said}) == 1 and (step := said[0].step):
        return said[0].text, step
    what = f"samples, and no {TIME} among {all_headings(head) or 'the columns'}"
    remedy = "say their step, --step 1:us, or their rate, --step 1:MHz"
    remedy += f"; of a time that is there {option(others[0].option, TIME, 'us')}" if others else ""
    if near:
        remedy = f"say {option(near, TIME)}"
    elif said:
        lines = listed(f"{shown(one.text)} (line {one.row.line})" for one in said)
        what = f"{what}; their step does not follow from {lines}"
        remedy = f"say it with its unit, such as --step {said[0].example}"
    raise fault(grid, head, what, remedy)


def _lines(grid: Grid, head: Head) -> Iterator[_Said]:
    """What the lines above the samples say of their step."""
    above = [(row, *_parts(row, grid.separator)) for row in grid.rows[: head.first] if row.line != head.line]
    units = {rest for _, name, rest in above if heading(name).name in CLOCK_UNITS}
    for row, name, rest in above:
        named = heading(name)
        if named.name not in STEPS or named.number is not None:  # a number cut at its decimal comma
            continue
        found = _VALUE.fullmatch(rest)
        values = {v for n in NOTATIONS.values() if found and (v := n.value(found[1])) is not None}
        of = [found[2]] if found and found[2] else [named.unit.text] if named.unit else sorted(units)
        kind = STEPS[named.name]
        step = spacing(next(iter(values)), of[0], kind) if len(values) == len(of) == 1 else None
        number = found[1] if found and "," not in found[1] else "1"
        yield _Said(row, step, f"{number}:{'s' if kind == 'us' else kind}")


def _parts(row: Row, separator: str) -> tuple[str, str]:
    """What a line of a header is about, and what it says of it."""
    filled = [text for text in row.texts if text.strip("".join(COMMENTS))]
    if len(filled) > 1 and separator not in BLANKS:
        name, rest = filled[0], " ".join(filled[1:])
    else:
        name, rest = (*_SAYS.split(" ".join(filled), maxsplit=1), "")[:2]
    return name.lstrip("".join(COMMENTS) + " "), rest


__all__ = ["STEP", "counted"]

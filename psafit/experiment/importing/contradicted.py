"""Lines above the headings that say something else than columns and options: asked about, or shown as unread."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

from psafit.drives import TABLE, WAVEFORMS, Drive, from_zero
from psafit.errors import Faults, InputError
from psafit.experiment.importing.chosen import SETTINGS, Chosen, Column, option
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.headings import heading
from psafit.experiment.importing.layout import Head, named_waveform, rows_above, waveform
from psafit.experiment.importing.numerals import Number, in_both
from psafit.experiment.importing.quantities import COLUMNS, COMMENTS, COUNTED, SUFFIXES, VOLTAGES, VOLTS, Volts, words
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.units import Unit, unit
from psafit.experiment.importing.values import peak
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.table import CellFault
from psafit.experiment.text import shown

_NUMBER = r"([-\N{MINUS SIGN}]?\d+(?:[.,]\d+)?)"
_FROM_TO = re.compile(rf"{_NUMBER}\s*V?\s*(?:to|bis|à|\.\.\.?|…|[-–])\s*\+?{_NUMBER}\s*V\b")

# Words of a line whose voltages are from one amplitude to another, or of an instrument.
_OTHER_ENDS = frozenset(
    ("amplitude", "amplitudes", "sweep", "swept", "input", "output", "sensor", "scope", "laser", "adc", "channel")
)


@dataclass(frozen=True)
class _Line:
    """A line above the headings: its number, its cells, its text, what it is about, and what it says of that."""

    line: int
    cells: tuple[str, ...]
    text: str
    name: str
    value: str

    @property
    def waveforms(self) -> set[str]:
        """The waveforms that it consists of, but for what they are of: ``Drive: square``."""
        parts = (part.strip() for text in self.cells for part in re.split("[:=;,|]", text))
        return {found for part in parts if (found := waveform(part))}

    @property
    def counts(self) -> Volts | None:
        """How it says that voltages are counted; None where it says nothing, or of one voltage."""
        said = words(self.text)
        if VOLTAGES.isdisjoint(said.split()) or any(char.isdigit() for char in self.text):
            return None
        phrases = ((phrase, volts) for volts, names in COUNTED.items() for phrase in names if len(phrase) > 1)
        found = {phrase: volts for phrase, volts in phrases if f" {phrase} " in f" {said} "}
        return found[max(found, key=len)] if found else None

    def numbers(self) -> list[Number]:
        """The numbers that its value may be, in the unit that it names."""
        found = [number for number in in_both(self.value) if number]
        said = heading(self.name).unit
        return [Number(n.value, n.unit or said) for n in dict.fromkeys(found) if n.unit or said]


def check_above(grid: Grid, head: Head, chosen: Chosen, shape: str, options: Options) -> None:
    """No sheet and no line above the headings names another waveform, count of volts, or value of what was held.

    Parameters
    ----------
    grid : Grid
    head : Head
    chosen : Chosen
    shape : str
        The waveform; empty where a column says it.
    options : Options

    Raises
    ------
    InputError
        With each that does.
    """
    faults = Faults()
    named = named_waveform(heading(grid.sheet)) if grid.sheet and not chosen.recorded(options) else ""
    if named and shape not in ("", TABLE) and named != shape.removeprefix("unipolar_"):
        what = f"sheet {shown(grid.sheet)} names a waveform, and --waveform {shape} is given"
        remedy = f"say --waveform {named}, of several tables one for each, or give the sheet another name"
        faults.add(InputError(what, remedy, file=grid.file, line=head.line or 1))
    for said in _lines(grid, head):
        for what, remedy in (*_waveform(said, shape), *_counted(said, chosen), *_held(said, chosen, shape, options)):
            faults.add(InputError(f"{shown(said.text)} {what}", remedy, file=grid.file, line=said.line))
    faults.end()


def unread(grid: Grid, head: Head, chosen: Chosen, shape: str) -> Iterator[tuple[int, str, str]]:
    """Lines above the headings that speak of the waveform, of volts, or of a column's unit: line, text and remedy."""
    known = {name for c in chosen.columns for name in (c.column, *(a.column for a in c.at))}
    for said in _lines(grid, head):
        named = next(iter(said.waveforms), "") or named_waveform(heading(said.text))
        if "unipolar" in words(said.text).split():
            named = from_zero(shape) or named
        other = next(filter(None, (_in_other_unit(said, c) for c in chosen.columns)), "")
        of = next((n for n in CONDITION_COLUMNS if n in known and said.value and _is_of(said, n)), "")
        if named and named != shape and shape != TABLE:
            remedy = f"say --waveform {named}" if shape else "correct the waveforms of its rows"
            yield said.line, said.text, remedy
        elif said.counts and not any(c.volts == said.counts for c in chosen.columns):
            yield said.line, said.text, f"say --volts {said.counts}"
        elif other:
            yield said.line, said.text, f"say {other}"
        elif of and any(char.isdigit() for char in said.value):
            yield said.line, said.text, f"correct {of} in the rows"
        elif ends := _ends(said, shape):
            yield said.line, said.text, ends


def _ends(said: _Line, shape: str) -> str:
    """What to say where a line has voltages from one to another that the waveform does not go through."""
    form, found = WAVEFORMS.get(shape), _FROM_TO.search(said.text)
    if form is None or found is None or not _OTHER_ENDS.isdisjoint(words(said.text).split()):
        return ""
    low, high = (float(end.replace(",", ".").replace("\N{MINUS SIGN}", "-")) for end in found.groups())
    least, most = form.span
    if high <= low or abs(low * most - high * least) <= 0.01 * high:
        return ""
    raised = f"--waveform {from_zero(shape)}, or " if low == 0.0 and from_zero(shape) else ""
    middle = (low + high) / 2
    return f"if that is the drive, say {raised}--set bias_v={middle:g} --set idle_v=NUMBER, the amplitude from there"


def _lines(grid: Grid, head: Head) -> Iterator[_Line]:
    return map(_parts, rows_above(grid, head))


def _parts(row: Row) -> _Line:
    """A line in parts: cells, or what stands before and behind a colon."""
    filled = [*filter(None, row.texts)]
    text = " ".join(filled)
    name, colon, value = text.lstrip("".join(COMMENTS) + " ").partition(":" if ":" in text else "=")
    if not colon:
        name, value = filled[0].lstrip("".join(COMMENTS) + " "), " ".join(filled[1:])
    return _Line(row.line, row.texts, text, name.strip(), value.strip())


def _is_of(said: _Line, column: str) -> bool:
    """Whether a line is about a condition."""
    named = heading(said.name)
    return bool(named.name) and named.would_be(COLUMNS[column])


def _waveform(said: _Line, shape: str) -> Iterator[tuple[str, str]]:
    """A generator that was offset says the waveform without that, and a recording is taken as it is."""
    found = said.waveforms if said.cells[0] else set()  # else it is a label of columns
    if shape not in ("", TABLE) and found and found.isdisjoint((shape, shape.removeprefix("unipolar_"))):
        what = f"names a waveform, and --waveform {shape} is given"
        yield what, f"say --waveform {min(found)}, or correct that line"


def _counted(said: _Line, chosen: Chosen) -> Iterator[tuple[str, str]]:
    """A column of amplitudes of which the user does not say how its volts are counted."""
    counts = said.counts
    for c in chosen.of("amplitude_v") if counts else ():
        if not c.mapped and counts and c.volts and c.volts != counts:
            text = c.unit.text if c.unit else "V"
            either = (option(c.option, c.column, f"{text}{SUFFIXES[volts]}") for volts in (counts, c.volts))
            yield f"names volts, and column {c.name} is {VOLTS[c.volts]}", f"say {' or '.join(either)}, as it is"


def _held(said: _Line, chosen: Chosen, shape: str, options: Options, near: float = 0.01) -> Iterator[tuple[str, str]]:
    """A condition, or a setting of the drive, of which another value is given; rounded numbers are `near` it."""
    given = chosen.held(options) | chosen.settings(options)
    drive = options.drive_of(shape or "sine", {})
    for name in (n for n in (*CONDITION_COLUMNS, *SETTINGS) if n in given and _is_of(said, n)):
        numbers = [n for n in said.numbers() if n.unit and n.unit.factor(COLUMNS[name].unit) is not None]
        values = [value for number in numbers for value in _values(number, name, said, drive)]
        wanted = _held_peak(given[name], drive, options) if name == "amplitude_v" else given[name]
        if values and not any(abs(value - wanted) <= near * max(abs(value), abs(wanted)) for value in values):
            what = f"names another {name} than --set, which gives {given[name]:g} {COLUMNS[name].unit}"
            yield what, f"correct --set {name}, or that line"


def _values(number: Number, name: str, said: _Line, drive: Drive) -> Iterator[float]:
    """What a number of a line may be, in psafit's unit; volts that are not counted in each way that there is."""
    factor = number.unit.factor(COLUMNS[name].unit) if number.unit else None
    if factor is None:
        return
    counted = (number.unit.volts if number.unit else None) or heading(said.name).volts
    for volts in ((counted,) if counted else SUFFIXES) if name == "amplitude_v" else ("peak",):
        with suppress(CellFault):
            yield float(number.value * factor * (peak(volts, drive) if name == "amplitude_v" else 1))


def _held_peak(value: float, drive: Drive, options: Options) -> float:
    """The peak of an amplitude that was held, as far as it follows."""
    with suppress(CellFault):
        return value * float(peak(options.counted[0] if options.counted else "peak", drive))
    return value


def _in_other_unit(said: _Line, column: Column) -> str:
    """The option that gives a column the unit that a line names for it, ``Range in mm``; empty where it names none."""
    if column.column not in COLUMNS or column.unit is None or column.mapped:
        return ""
    named, target = heading(said.text.replace(":", " ").replace("=", " ")), COLUMNS[column.column].unit
    other: Unit | None = named.unit or unit(said.value)
    if not (other and named.would_be(COLUMNS[column.column])):
        return ""
    factor = other.factor(target)
    return option(column.option, column.column, other.text) if factor not in (None, column.unit.factor(target)) else ""


__all__ = ["check_above", "unread"]

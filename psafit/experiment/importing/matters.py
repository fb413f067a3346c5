"""Columns that matter to the rig or its drive, and that are not read by themselves: they are asked for."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import itemgetter

from psafit.errors import Faults, InputError
from psafit.experiment.importing.chosen import Chosen, Column, cells, fault, option
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.layout import Head, is_comment, rows_above
from psafit.experiment.importing.numerals import is_number, likeliest
from psafit.experiment.importing.quantities import CHANNELS, COLUMNS, COUNT, QUANTITIES, words
from psafit.experiment.importing.records import IGNORED, Options
from psafit.experiment.importing.units import factor_of, unit
from psafit.experiment.records import CONSTANT_UNITS
from psafit.experiment.text import shown
from psafit.experiment.writer import number_text


@dataclass(frozen=True)
class Matter:
    """What a column may hold besides readings and conditions.

    Parameters
    ----------
    names : tuple of str
        What it is called, in words of small letters.
    column : str
        psafit's column, or constant of the rig, that it would be; empty where there is none.
    nothing : float or None
        The number that changes nothing.
    usual : tuple of str
        Words, in small letters, that change nothing.
    kinds : tuple of str
        Units of psafit's that its own may be turned into, where it is no column of psafit's; empty for none.
    flag : bool
        Whether it marks readings, and has no other name.
    remedy : str
        What can be done, where it is no column of psafit's.
    """

    names: tuple[str, ...]
    column: str = ""
    nothing: float | None = None
    usual: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("",)
    flag: bool = False
    remedy: str = ""


_YES, _NO = ("yes", "y", "true", "ok", "valid", "good", "ja", "oui"), ("no", "n", "false", "off", "ok", "nein", "non")
_PERIODS = "give its periods, cycles, which are this time times the frequency"
MATTERS = (
    Matter(("phase shift", "phase", "phase angle", "phasenwinkel", "phasenlage"), "phase_deg", 0.0),
    Matter(
        (
            "dc", "v dc", "vdc", "u dc", "udc", "dc voltage", "dc level", "gleichspannung", "gleichanteil",
            "mean voltage", "v mean", "vmean", "preload voltage", "vorspannung", "tension continue",
        ),
        "bias_v",
        0.0,
    ),
    Matter(
        ("duty", "duty cycle", "duty ratio", "tastgrad", "tastverhältnis", "rapport cyclique"),
        nothing=50.0,
        remedy="give the voltage with --drive FILE, one period of it",
    ),
    Matter(
        (
            "gain", "amplifier", "amplifier gain", "amp gain", "hv amp", "hv amplifier", "amplification",
            "verstärkung", "verstärker",
        ),
        nothing=1.0,
        remedy="give volts behind the amplifier",
    ),
    Matter(
        ("attenuation", "attenuator", "probe attenuation", "probe atten", "probe factor"),
        nothing=1.0,
        remedy="give volts behind the attenuator",
    ),
    Matter(("voltage divider", "divider"), nothing=1.0, remedy="give volts as they are at the stack"),
    Matter(
        (
            "n burst", "burst cycles", "periods per burst", "cycles per burst", "burst length", "burst size", "pulses",
            "number of pulses",
        ),
        "cycles",
    ),
    Matter(("burst duration", "burst time", "on time"), kinds=("", "us"), remedy=_PERIODS),
    Matter(("burst", "bursts", "burst mode"), "cycles", usual=_NO),
    Matter(("burst", "burst length"), kinds=("us",), remedy=_PERIODS),
    Matter(
        ("polarity", "polarität", "polarité"),
        nothing=1.0,
        usual=("normal", "norm", "positive", "pos", "noninverted", "non inverted"),
        remedy="give the voltage with --drive FILE",
    ),
    Matter(
        (
            "inverted", "invert", "inverted output", "output inverted", "channel inverted", "invertiert", "inverse",
            "inversé",
        ),
        nothing=0.0,
        usual=_NO,
        remedy="turn the sign: volts of a drive with --drive FILE, a motion with a minus before its scale",
    ),
    Matter(
        ("magnification", "scale factor", "scaling factor", "vergrößerung", "vergrösserung", "skalierungsfaktor"),
        nothing=1.0,
        remedy="give numbers as they are at the rig",
    ),
    Matter(("symmetry", "symmetrie"), nothing=50.0, remedy="give the voltage with --drive FILE, one period of it"),
    Matter(("rise time", "anstiegszeit"), kinds=("", "us"), remedy="give the voltage with --drive FILE"),
    Matter(("valid", "gültig", "status", "flag", "ok", "use", "used", "quality"), nothing=1.0, usual=_YES, flag=True),
    Matter(
        ("excluded", "exclude", "saturated", "overrange", "overload", "outlier", "invalid", "ausreisser", "ausreißer"),
        nothing=0.0,
        usual=_NO,
        flag=True,
    ),
    Matter(
        ("string length", "length of string", "pendulum length", "fadenlänge", "pendellänge", "longueur du fil"), "l"
    ),
    Matter(("ball mass", "mass of ball", "kugelmasse", "masse de la bille"), "M"),
    Matter(("stack mass", "mass of stack", "stapelmasse"), "m"),
)  # fmt: skip


_PROBE = re.compile(r"\bprobe\W*(?:[x×]\s?\d|(?!1\s?[x×])\d+\s?[x×]|1:\d)", re.IGNORECASE)
_DELAY = re.compile(r"(?:^|[;:,]\s*)(?:\w+ )?(?:delay|verzögerung)\W+\d[\d.,]*\s?[nmuµμ]?s\b", re.IGNORECASE)
# What a header calls the moment of the trigger on the clock of its samples.
_TRIGGER = Matter(
    (
        "trigger offset", "trigger delay", "trigger position", "trigger point", "trigger time", "horizontal offset",
        "horizontal position", "horizontal delay", "hoffset", "x offset", "delay time", "pretrigger", "pre trigger",
    ),
    nothing=0.0,
)  # fmt: skip


def check_matters(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """A column that is not used, and of which it matters what it holds, is asked for."""
    for column in (c for c in chosen.unused if not c.mapped):
        for matter in (m for m in MATTERS if m.column not in options.held):
            said = _unit(column, head, matter)
            numbers = _numbers(grid, head, column) if said is not None else []
            wordy = said is not None and (matter.usual or not matter.column)
            texts = _texts(grid, head, column) if wordy else []
            if any(number != matter.nothing for number in numbers) or not set(texts).issubset(matter.usual):
                faults.add(fault(grid, head, *_asked(column, matter, said or "", numbers)))


def above(grid: Grid, head: Head, chosen: Chosen, options: Options) -> Iterator[tuple[int, str, str]]:
    """Lines above the headings that begin with the name of what matters to the drive: line, text and remedy.

    What is given, stands in a column, or changes nothing is left aside. Constants of the rig are asked for by
    themselves.
    """
    given = (*CONSTANT_UNITS, *options.held, *(c.column for c in chosen.columns if c.column))
    every = (*(Matter(q.names, q.column, 0.0) for q in QUANTITIES if q.role == "drive"), *MATTERS)
    shown_lines = set()
    for line, text, matter in _named_above(grid, head, every):
        if not (matter.flag or matter.column in given or line in shown_lines):
            shown_lines.add(line)
            said = f":{_target(matter)}" if _target(matter) != COUNT else ""
            yield line, text, f"say --set {matter.column}=NUMBER{said}" if matter.column else matter.remedy
    for row in rows_above(grid, head):
        text = " ".join(filter(None, row.texts))
        if row.line not in shown_lines and _PROBE.search(text):
            yield row.line, text, "give volts behind the attenuator"


def check_trigger(grid: Grid, head: Head, options: Options) -> None:
    """A line above a trace that speaks of its trigger may say when the drive starts, if nobody does.

    Raises
    ------
    InputError
        With the first such line.
    """
    if options.start_us is not None:
        return
    triggers = [(line, text) for line, text, _ in _named_above(grid, head, (_TRIGGER,))]
    lines = [(row.line, "; ".join(filter(None, row.texts))) for row in rows_above(grid, head)]
    for line, text in (*triggers, *(one for one in lines if _DELAY.search(one[1]))):
        what = f"{shown(text)} may say when the drive starts, and times may count from there or not"
        remedy = "say --start 0 if the drive starts at time 0, or its time: --start 1.5:ms"
        raise InputError(what, remedy, file=grid.file, line=line)


def _named_above(grid: Grid, head: Head, every: Sequence[Matter]) -> Iterator[tuple[int, str, Matter]]:
    """Lines above the headings with a clause that begins with the name of a matter, unless it changes nothing."""
    for row in rows_above(grid, head):
        text = " ".join(filter(None, row.texts))
        yield from ((row.line, text, found) for clause in _clauses(row) if (found := _named(clause, every)))


def _clauses(row: Row) -> Iterator[list[str]]:
    """What a line says of one thing and another: what is named, and its values; what a value names, too."""
    filled = [*filter(None, row.texts)]
    if len(filled) > 1 and not any(mark in cell for cell in filled for mark in ":="):
        yield filled
    for clause in (part for text in (" ".join(filled), *filled) for part in re.split(r"[;,]\s+", text)):
        said = [text.strip() for text in re.split("[:=]", clause)]
        for k in range(len(said)):
            number = re.fullmatch(r"(\D+?)\s+([x×]?\d.*)", said[k])  # of one name and number, as `gain x20`
            if number and (k or len(said) == 1):
                yield [*number.groups()]
            elif k == 0 and (len(said) > 1 or len(filled) == 1):
                yield said


def _named(clause: Sequence[str], every: Sequence[Matter]) -> Matter | None:
    """The matter of which a clause says what changes something; of several of one name that of the value's unit."""
    first, *values = clause
    found = [(likeliest([value]).number(value.strip("x×X")), unit(value)) for value in values]
    kinds = {said.kind for number, alone in found if (said := (number and number.unit) or alone)}
    whole = words(first)
    of_channel = " ".join(word for word in whole.split() if word.rstrip("0123456789") not in CHANNELS)
    named = [
        (len(name), kinds <= {_target(m), *m.kinds}, m)
        for m in every
        for name in m.names
        if any(f"{begins} ".startswith(f"{name} ") for begins in (whole, of_channel))
    ]
    *_, matter = max(named, key=itemgetter(0, 1), default=(None,))
    nothing = matter and _changes_nothing(matter, values, [float(number.value) for number, _ in found if number])
    return None if nothing else matter


def _changes_nothing(matter: Matter, values: Sequence[str], numbers: Sequence[float]) -> bool:
    """Whether a line of a header gives what changes nothing: that number, or such a word."""
    if numbers:
        return all(value == matter.nothing for value in numbers)
    return any(values) and all(words(value) in matter.usual for value in values if value)


def _target(matter: Matter) -> str:
    return CONSTANT_UNITS.get(matter.column) or (COLUMNS[matter.column].unit if matter.column else "")


def _unit(column: Column, head: Head, matter: Matter) -> str | None:
    """The unit of a column that is called so, empty where none is said; None where it is another quantity."""
    said, target = head.unit(column.place), _target(matter)
    whole = matter.flag or "" not in matter.kinds
    for name in (n for n in matter.names if f"{column.heading.name} ".startswith(f"{n} ")):
        rest = column.heading.name.removeprefix(name).strip() or (said.text if said else "")
        of_kind = (said.kind if said else "") in matter.kinds and (not whole or name == column.heading.name)
        if (not rest or factor_of(rest, target) is not None) if target else of_kind:
            return rest
    return None


def _numbers(grid: Grid, head: Head, column: Column) -> list[float]:
    below = cells(grid, head, column.place)
    notation = likeliest(below)
    return [float(number.value) for cell in below if (number := notation.number(cell)) is not None]


def _texts(grid: Grid, head: Head, column: Column) -> list[str]:
    """The words of a column, in small letters."""
    below = (str(cell) for cell in cells(grid, head, column.place) if not is_number(cell))
    return [said for cell in below if not is_comment(cell) and (said := words(cell))]


def _asked(column: Column, matter: Matter, unit: str, numbers: Sequence[float]) -> tuple[str, str]:
    """What is said of a column that matters, and the remedy."""
    ignored, target = option(column.option, IGNORED), _target(matter)
    if matter.column in CONSTANT_UNITS:
        what = f"column {column.name} is {matter.column} of the rig, which is no column of psafit's"
        if len(set(numbers)) > 1:
            return what, f"say {ignored}, and write constants = {{ {matter.column} = ... }}, {target}, into its group"
        return what, f"say {ignored} --set {matter.column}={number_text(numbers[0])}:{unit or target}"
    if matter.column:
        what = f"column {column.name} may be {matter.column} of the drive, or another quantity"
        unsaid = "" if unit or target == COUNT else target
        return what, f"say {option(column.option, matter.column, unsaid)}, or {ignored}"
    if matter.flag:
        what = f"column {column.name} marks some readings, and psafit takes all"
        return what, f"delete the rows that are not to count and say {ignored}"
    return f"column {column.name} is of the drive, and psafit has no such setting", f"{matter.remedy}, or say {ignored}"


__all__ = ["above", "check_matters", "check_trigger"]

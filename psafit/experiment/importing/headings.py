"""What the headings of columns say: which quantity, in which unit, which of several repetitions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from psafit.experiment.importing.quantities import (
    COLUMNS,
    COUNTED,
    GENERIC,
    NEUTRAL,
    QUANTITIES,
    WAVEFORM_NAMES,
    Quantity,
    Volts,
    words,
)
from psafit.experiment.importing.units import Unit, counted, unit

_BRACKETS = re.compile(r"[(\[<{]([^()\[\]<>{}]*)[)\]>}]")
_BETWEEN = re.compile(r"\s+in\s+|\s*[/,_:]\s*|\s+")
_GLUED = re.compile(r"([vu])(pp|pkpk|ss|rms|eff|pk|p)")


@dataclass(frozen=True)
class Heading:
    """A heading, taken apart.

    Parameters
    ----------
    text : str
        As it is written.
    name : str
        Its words, without the unit and the number.
    unit : Unit or None
    volts : {"peak", "pp", "rms"} or None
        How volts are counted.
    number : int or None
        Which repetition.
    own : str
        psafit's column of this very name.
    """

    text: str
    name: str
    unit: Unit | None
    volts: Volts | None
    number: int | None
    own: str = ""

    @property
    def is_waveform(self) -> bool:
        """Whether waveforms stand in the column."""
        return self.name in WAVEFORM_NAMES and self.unit is None

    def quantities(self, below: Unit | None = None) -> list[Quantity]:
        """What the column may hold; `below` is the unit in a row of its own, where the heading has none."""
        if self.own:
            return [COLUMNS[self.own]]
        said = self.unit or below
        found = [q for q in QUANTITIES if self._called(q, said) and (said is None or said.kind == q.unit)]
        if not found and said and self.volts is None and self.name in GENERIC:
            found = [q for q in QUANTITIES if q.role == "reading" and q.unit == said.kind][:1]
        return found

    def _called(self, quantity: Quantity, said: Unit | None) -> bool:
        bare = " ".join(w for w in self.name.split() if w not in NEUTRAL)
        if not bare:  # a unit alone says what it is of
            return "" in quantity.names and said is not None
        return bare in quantity.names or self.name in quantity.names


@lru_cache(maxsize=4096)
def heading(text: str) -> Heading:
    """Take a heading apart.

    Parameters
    ----------
    text : str
        Such as ``Frequency (kHz)``, ``U_pp / V``, ``launch_range_um`` or ``Launch range 2 [µm]``.

    Returns
    -------
    Heading
    """
    text = " ".join(text.split())
    if text in COLUMNS:  # to the letter: "Amplitude_V" is somebody else's
        own = COLUMNS[text]
        return Heading(text, words(text), Unit(own.unit), "peak" if own.unit == "V" else None, None, own.column)
    if len(text) > 200 or not text.isprintable():  # prose, or damaged
        return Heading(text, words(text), None, None, None)
    rest, found = text, None
    for inside in _BRACKETS.finditer(text):
        if found := unit(inside[1]):
            rest = f"{text[: inside.start()]} {text[inside.end() :]}"
            break
    if found is None:
        found, rest = _at_the_end(rest)
    name, number = _numbered(rest)
    name, volts = _counted(name, found)
    return Heading(text, name, found, volts, number)


def _at_the_end(text: str) -> tuple[Unit | None, str]:
    """The unit without brackets that a heading ends in, or consists of, and what stands before it."""
    whole = unit(text)
    if whole and (len(text) > 1 or text == "V"):  # N, m and s have other meanings
        return whole, ""
    for between in _BETWEEN.finditer(text):
        found = unit(text[between.end() :])
        if found and text[: between.start()].strip():
            return found, text[: between.start()]
    return None, text


def _numbered(text: str) -> tuple[str, int | None]:
    """Words of a name, and the number that they end in: ``range 2``, ``R2``."""
    said = words(text)
    found = re.fullmatch(r"(.*?[^\W\d]) ?(\d{1,3})", said)
    return (found[1], int(found[2])) if found else (said, None)


def _counted(name: str, found: Unit | None) -> tuple[str, Volts | None]:
    """A name without the words that say how volts are counted, and what they say."""
    volts = found.volts if found else None
    if found and found.kind != "V":
        return name, None
    said = " ".join(" ".join(glued.groups()) if (glued := _GLUED.fullmatch(w)) else w for w in name.split())
    for phrases in COUNTED.values():
        for phrase in phrases:
            less = re.sub(rf"(?:^| ){re.escape(phrase)}(?= |$)", "", said).strip()
            if less != said and _may_be_volts(less):
                return less, volts or counted(phrase)
    return name, volts


def _may_be_volts(name: str) -> bool:
    """Whether a name without `peak` and the like is that of a voltage."""
    left = " ".join(w for w in name.split() if w not in NEUTRAL)
    return left in COLUMNS["amplitude_v"].names

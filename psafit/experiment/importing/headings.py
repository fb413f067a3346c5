"""What the headings of columns say: which quantity, in which unit, which of several repetitions."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cache, lru_cache

from psafit.experiment.importing.numerals import NOTATIONS
from psafit.experiment.importing.quantities import (
    CHANNELS,
    COLUMNS,
    COUNT,
    COUNTED,
    DRIVING,
    GENERIC,
    LEVELS,
    NEUTRAL,
    PARTS,
    PERIODS,
    QUANTITIES,
    SPEAKS,
    SPREADS,
    WAVEFORM_NAMES,
    Quantity,
    Volts,
    words,
)
from psafit.experiment.importing.units import LOGARITHMS, Unit, counted, foreign, unit

_BRACKETS = re.compile(r"[(\[<{]([^()\[\]<>{}]*)[)\]>}]")
_BETWEEN = re.compile(r"\s+in\s+|\s*[/,_:]\s*|\s+")
# A number with its unit; a unit of many, such as 2 V/div, is none.
_AT = re.compile(
    r"(?:\b(?:at|bei|à)\s+|@\s*)?(?<![A-Za-z0-9.,])(\d+(?:[.,]\d+)?)\s*([A-Za-zµμ]+(?:-[a-z]+)?)(?![A-Za-z0-9/])"
)
# A reading that was taken again: `2nd range`, `Range (um) repeat`.
_ORDINAL = re.compile(r"(?<!\w)(\d{1,3})(?:st|nd|rd|th)(?!\w)", re.IGNORECASE)
_AGAIN_WORDS = "|".join(sorted({*GENERIC, "again", "repeated", "duplicate", "copy", "wiederholung"}))
_REPEATED = re.compile(rf"(?:(?:first|second|third) )?(.+?)(?: (?:{_AGAIN_WORDS}))*")
# As pandas and R, and as MATLAB, write a heading that comes again: `range_um.1`, `range_um_1`.
_AGAIN = re.compile(r"(.*\S)[._](\d{1,3})")
_SPREAD = re.compile(r"\s*(?:±|\+/-|[us]\s*\([^\d()]+\))")
_GLUED = re.compile(r"([vu])(pp|pkpk|ss|rms|eff|0pk|0p|pk|p)")
# What stands in a heading for a unit or a condition: a word.
_SET = "at"
# A heading that says no more than words, each with a number or none: every sign but separators says something else.
_LETTER = r"[^\W\d_²³¹⁰-₟¼-¾]"
_NUMBER = r"(?:(?<=[^\W\d_])[.-]|\.?[\s_#(\[{]+)\d{1,3}(?![^\W_])"
_WORD = rf"(?:0[- ](?=(?:to|p|pk|peak)\b))?(?!(?<=[\s_)\]}}])x\d){_LETTER}(?:{_LETTER}|\d)*(?:{_NUMBER})?"
_APART = r"(?:[\s_#()\[\]{}.,:;'’°]|(?<=\w)[-‐‑–—−](?=\w)|(?<=\s)[-‐‑–—−](?=\s))"
_PLAIN = re.compile(rf"[\s_#(\[{{]*(?:{_WORD}(?:{_APART}+{_WORD})*)?[\s_()\[\]{{}}.,:;]*", re.IGNORECASE)


@dataclass(frozen=True)
class Condition:
    """A condition that a heading names: its column, its value in the unit of that, and how its volts are counted."""

    column: str
    value: Decimal
    volts: Volts | None


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
        Of no kind where it is one that psafit does not read.
    volts : {"peak", "pp", "rms"} or None
        How volts are counted.
    number : int or None
        Which repetition.
    own : str
        psafit's column of this very name.
    at : tuple of Condition
        Those that it names, such as ``Displacement 1.2 kHz, 20 Vp (um)``; they are in its name, too.
    bare : str
        Its text without them.
    repeats : bool
        Whether another column has the same.
    altered : str
        All but its unit, where that says more than words and a number: ``Vpp/2``, ``-Velocity``, ``Range^2``.
    """

    text: str
    name: str
    unit: Unit | None
    volts: Volts | None
    number: int | None
    own: str = ""
    at: tuple[Condition, ...] = ()
    bare: str = ""
    repeats: bool = False
    altered: str = ""

    @property
    def without_conditions(self) -> Heading:
        """The heading of what was read at the conditions that it names."""
        if not self.at:
            return self
        return replace(
            heading(self.bare), text=self.text, at=self.at, bare=self.bare, repeats=self.repeats, altered=self.altered
        )

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that it names, if the rest of it is understood: ``Laser, filter 10 kHz`` may name none."""
        if not self.at:
            return ()
        rest = heading(self.bare)
        said = {word.rstrip("0123456789") for word in rest.name.split()} - {""}
        understood = said <= CHANNELS | NEUTRAL | GENERIC | PARTS["ball"] | PARTS["tip"]
        called = any(rest.would_be(q) for q in QUANTITIES if q.role in ("reading", "trace"))
        return self.at if not rest.altered and (understood or called) else ()

    @property
    def is_ordinal(self) -> bool:
        """Whether it says which one, and not of what: ``2nd (um)``."""
        return self.number is not None and not self.name

    @property
    def numbers_a_part(self) -> bool:
        """Whether its number is that of a part of the rig, not of a repetition: ``Range ball 2``."""
        return self.number is not None and self.name.rpartition(" ")[2] in set().union(*PARTS.values())

    @property
    def is_waveform(self) -> bool:
        """Whether waveforms stand in the column."""
        return self.name in WAVEFORM_NAMES and self.unit is None

    @property
    def counts(self) -> Volts | None:
        """How its volts are counted, if it is an amplitude, whatever else its name says: ``Generator Vpp``."""
        return None if self.altered else self.volts or _counting(self.name)

    @property
    def ways(self) -> tuple[Volts, ...]:
        """How its volts may be counted, what its words speak for first: ``Scheitelspannung``; else peak to peak."""
        said = _unglued(self.name)
        every: tuple[Volts, ...] = ("pp", "rms", "peak")
        named = (v for v in every if any(len(p) > 1 and _without(p, said) != said for p in COUNTED[v]))
        spoken = [v for v, pattern in SPEAKS.items() if any(map(pattern.fullmatch, said.split()))]
        both = spoken[:1] if "pp" in spoken else []  # `peak above trough` has a word of another way
        upper: tuple[Volts, ...] = ("peak",) if self.name in LEVELS[0] else ()
        counted: tuple[Volts, ...] = (self.volts,) if self.volts else ()
        return tuple(dict.fromkeys((*counted, *both, *named, *spoken, *upper, "pp", "peak", "rms")))

    @property
    def spreads(self) -> bool:
        """Whether it may be the known error of a reading: ``± (um)``, ``u(L)``, ``SD range``."""
        if _SPREAD.match(self.text):
            return True
        names = [n for q in QUANTITIES if q.role == "reading" for n in ("", *q.names)]
        return not self.altered and any(
            self.name in (f"{s} {n}".strip(), f"{n} {s}".strip()) for s in SPREADS for n in names
        )

    @property
    def of_tip(self) -> bool:
        """Whether its words name the stack or its end, and so no motion of the ball."""
        return not PARTS["tip"].isdisjoint(self.name.split())

    @property
    def drives(self) -> bool:
        """Whether its words are those of the drive's voltage and of nothing else, such as ``CH1 (V) drive``."""
        said = {word.rstrip("0123456789") for word in self.name.split()} - {""}
        return not (self.volts or self.altered or said.isdisjoint(DRIVING)) and said <= DRIVING | CHANNELS | NEUTRAL

    def quantities(self, below: Unit | None = None) -> list[Quantity]:
        """What the column may hold; `below` is the unit in a row of its own, where the heading has none."""
        if self.altered:
            return []
        if self.own:
            return [COLUMNS[self.own]]
        said = self.unit or below
        found = [q for q in QUANTITIES if self._called(q, said) and (said is None or said.kind == q.unit)]
        if not found and said and self.volts is None and self.name in GENERIC:
            found = [q for q in QUANTITIES if q.role == "reading" and q.unit == said.kind][:1]
        if not found and said and self.is_ordinal:
            found = [
                q for q in QUANTITIES if q.role in ("reading", "trace") and (q.part, q.unit) == ("ball", said.kind)
            ]
        return found

    def over_time(self, below: Unit | None = None) -> list[Quantity]:
        """What the column may hold; with conditions in its heading also a motion or a reading at these."""
        found = self.quantities(below)
        at = self.without_conditions.quantities(below) if self.at and not found else []
        return found or [q for q in at if q.role in ("trace", "reading")]

    def would_be(self, quantity: Quantity) -> bool:
        """Whether it is called so, whatever its unit."""
        return self._called(quantity, None) or (quantity.column == "frequency_hz" and self.name in PERIODS)

    def sounds(self, quantity: Quantity) -> bool:
        """Whether it has a word that is in the names of this quantity and of no other that is like it."""
        counts = quantity.column == "amplitude_v" and self.counts is not None
        own = not _own_words(quantity).isdisjoint(self.name.split())
        return (counts or own) and self.of_tip == (quantity.part == "tip")

    def _called(self, quantity: Quantity, said: Unit | None) -> bool:
        bare = quantity.bare(self.name)
        if bare is None:
            return False
        if not bare:  # a unit alone says what it is of
            return "" in quantity.names and said is not None
        if quantity.role == "reading" and (again := _REPEATED.fullmatch(bare)):
            bare = again[1]
        return bare in quantity.names or self.name in quantity.names


@cache
def _own_words(quantity: Quantity) -> frozenset[str]:
    """The words in the names of a quantity that are in those of no other that is like it."""
    others = [q for q in QUANTITIES if q.role not in ("trace", "error", "other") and q != quantity]
    taken = {word for q in others for name in q.names for word in name.split()}
    return frozenset(word for name in quantity.names for word in name.split()) - taken


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
        volts: Volts | None = "peak" if own.column == "amplitude_v" else None
        return Heading(text, words(text), Unit(own.unit), volts, None, own.column)
    if len(text) > 200 or not text.isprintable():  # prose, or damaged
        return Heading(text, words(text), None, None, None)
    if again := _AGAIN.fullmatch(text):
        first_one: Heading = heading(again[1])
        of_settings = first_one.own and COLUMNS[first_one.own].role not in ("reading", "error")
        if first_one.unit and first_one.number is None and not of_settings:
            return replace(first_one, text=text, number=int(again[2]))
    if which := _ORDINAL.search(text):
        any_of_them: Heading = heading(_ORDINAL.sub(" ", text, count=1))
        if any_of_them.number is None:
            return replace(any_of_them, text=text, number=int(which[1]))
    found, rest = _in_brackets(text)
    if found is None:
        found, rest = _at_the_end(text)
    name, number = _numbered(rest)
    name, volts = _counted(name, found)
    first, _, others = name.partition(" ")
    if first in LOGARITHMS and others:
        name, found = others, Unit(f"{first} {found.text if found else ''}".strip())
    return Heading(text, name, found, volts, number, "", *_conditions(text), altered=_altered(text))


def _altered(text: str) -> str:
    """A heading without its unit, in which another word stands for a condition; empty where it is plain."""
    for said in [number[0] for number in _AT.finditer(text) if _condition(number)]:
        text = text.replace(said, _SET, 1)
    found, rest = _in_brackets(text, _SET)
    if found is None:
        rest = _at_the_end(text)[1]
    return "" if _PLAIN.fullmatch(rest) else " ".join((rest if found is None else _in_brackets(text)[1]).split())


def _condition(number: re.Match[str]) -> Condition | None:
    """The condition that a number with a unit is, if it is one."""
    said = unit(number[2])
    column = {"Hz": "frequency_hz", "V": "amplitude_v"}.get(said.kind if said else "", "")
    values = {value for n in NOTATIONS.values() if (value := n.value(number[1])) is not None}
    factor = said.factor(COLUMNS[column].unit) if said and column else None
    if said is None or factor is None or len(values) != 1:
        return None
    return Condition(column, values.pop() * factor, said.volts)


def _conditions(text: str) -> tuple[tuple[Condition, ...], str]:
    """Frequency and amplitude that a heading names, each once, and its text without them."""
    found: dict[str, Condition] = {}
    rest = text
    for number in _AT.finditer(text):
        condition = _condition(number)
        if condition is None or condition.column in found:
            continue
        found[condition.column] = condition
        rest = rest.replace(number[0], " ")
    return tuple(found.values()), " ".join(rest.split()) if found else ""


def _in_brackets(text: str, instead: str = " ") -> tuple[Unit | None, str]:
    """The unit in brackets of a heading, and the text with something else in its place."""
    for known in (unit, foreign):
        for inside in _BRACKETS.finditer(text):
            if found := known(inside[1]):
                return found, f"{text[: inside.start()]} {instead}{text[inside.end() :]}"
    return None, text


def _at_the_end(text: str) -> tuple[Unit | None, str]:
    """The unit without brackets that a heading ends in, or consists of, and what stands before it."""
    whole = unit(text.removeprefix("in "))
    if whole and whole.kind != COUNT and (len(text) > 1 or text == "V"):  # N, m and s have other meanings
        return whole, ""
    for between in _BETWEEN.finditer(text):
        found = unit(text[between.end() :]) or _foreign(text[between.end() :])
        if found and found.kind != COUNT and text[: between.start()].strip():
            return found, text[: between.start()]
    return None, text


def _foreign(text: str) -> Unit | None:
    """A unit of no kind without brackets; ``U/V`` is none, but a name and its unit."""
    above = words(text.partition("/")[0])
    return None if len(above) == 1 or any(above in q.names for q in QUANTITIES if above) else foreign(text)


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
    said = _unglued(name)
    for phrases in COUNTED.values():
        for phrase in phrases:
            less = _without(phrase, said)
            if less != said and _may_be_volts(less):
                said_twice = volts not in (None, counted(phrase))  # "rms voltage (Vpp)"
                return (name, None) if said_twice else (less, counted(phrase))
    return name, volts


def _unglued(name: str) -> str:
    """A name with ``v pp`` for ``vpp``."""
    return " ".join(" ".join(glued.groups()) if (glued := _GLUED.fullmatch(w)) else w for w in name.split())


def _without(phrase: str, name: str) -> str:
    return re.sub(rf"(?:^| ){re.escape(phrase)}(?= |$)", "", name).strip()


def _counting(name: str) -> Volts | None:
    """How a name with any other words counts volts; None where it says nothing, or two things.

    A word of a longer phrase, such as `peak`, says nothing among words that are not known: ``peak above trough``.
    """
    left, found = _unglued(name), set()
    parts = {word for phrases in COUNTED.values() for phrase in phrases if " " in phrase for word in phrase.split()}
    for phrase in sorted((p for phrases in COUNTED.values() for p in phrases), key=len, reverse=True):
        if phrase not in parts and _without(phrase, left) != left:
            left = _without(phrase, left)
            found.add(counted(phrase))
    return found.pop() if len(found) == 1 else None


def _may_be_volts(name: str) -> bool:
    """Whether a name without `peak` and the like is that of a voltage."""
    return COLUMNS["amplitude_v"].bare(name) in COLUMNS["amplitude_v"].names

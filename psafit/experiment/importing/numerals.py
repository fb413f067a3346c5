"""Numbers as text, with a decimal point or comma and thousands, units behind them or not."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

from psafit.experiment.importing.grid import Cell
from psafit.experiment.importing.units import Unit, unit

_SPACES = " \u00a0\u202f\u2009"
_QUOTES = "'’"
_MINUS = "\N{MINUS SIGN}"  # as typesetters write it
_WITH_UNIT = re.compile(r"([+\-−]?[\d.,].*?)\s*([A-Za-zµμ][A-Za-zµμ/^\d²³ .-]*)?")


@dataclass(frozen=True)
class Number:
    """A number, exactly as it is written, and the unit behind it."""

    value: Decimal
    unit: Unit | None = None


class Notation:
    """A way to write numbers: the decimal mark; in thousands stand the other mark, blanks or apostrophes."""

    def __init__(self, decimal: str) -> None:
        self.decimal = decimal
        marks = re.escape(f"{'.' if decimal == ',' else ','}{_SPACES}{_QUOTES}")
        mark = re.escape(decimal)
        exponent = r"(?:[eE][+-]?\d{1,3}|[dD][+-]\d{1,3})?"  # Fortran writes D
        self._plain = re.compile(rf"[+-]?(?:\d+(?:{mark}\d*)?|{mark}\d+){exponent}", re.ASCII)
        self._grouped = re.compile(rf"[+-]?[1-9]\d{{0,2}}([{marks}])\d{{3}}(?:\1\d{{3}})*(?:{mark}\d*)?", re.ASCII)

    def value(self, text: str) -> Decimal | None:
        """The value of a number; None where it is none in this notation."""
        text = text.replace(_MINUS, "-")
        if found := self._grouped.fullmatch(text):
            text = text.replace(found[1], "")
        elif not self._plain.fullmatch(text):
            return None
        try:
            return Decimal(text.replace(self.decimal, ".").upper().replace("D", "E"))
        except InvalidOperation:  # more digits than decimal numbers have
            return None

    def number(self, cell: Cell) -> Number | None:
        """The number in a cell; None where there is none."""
        if isinstance(cell, int | float) and not isinstance(cell, bool):
            return Number(Decimal(repr(cell))) if math.isfinite(cell) else None
        if not isinstance(cell, str):
            return None
        if (value := self.value(cell)) is not None:
            return Number(value)
        if not (parts := _WITH_UNIT.fullmatch(cell)) or not parts[2]:
            return None
        value, said = self.value(parts[1]), unit(parts[2])
        return None if value is None or said is None else Number(value, said)


NOTATIONS = {".": Notation("."), ",": Notation(",")}


def is_number(cell: Cell) -> bool:
    """Whether a cell holds a number in some notation."""
    return any(notation.number(cell) is not None for notation in NOTATIONS.values())


def in_both(cell: Cell) -> tuple[Number | None, Number | None]:
    """What a cell is with a decimal point, and with a decimal comma; None where it is no number."""
    return NOTATIONS["."].number(cell), NOTATIONS[","].number(cell)


def whole(texts: Sequence[str]) -> list[int]:
    """Texts as whole numbers; empty where one of them is none."""
    notation = likeliest(texts)
    values = [notation.value(text) for text in texts]
    found = [int(value) for value in values if value is not None and value == int(value)]
    return found if len(found) == len(values) else []


def count_on(numbers: Sequence[int]) -> bool:
    """Whether whole numbers follow one another, as those of repetitions or channels do."""
    return bool(numbers) and list(numbers) == list(range(numbers[0], numbers[0] + len(numbers)))


def counts_rows(numbers: Sequence[int]) -> bool:
    """Whether whole numbers are those of their rows, from 0 or 1."""
    return numbers[:1] in ([0], [1]) and count_on(numbers)


def numbers(cells: Sequence[Cell]) -> list[Number | None]:
    """What cells are in the notation in which most are numbers; None where one is none."""
    found = ([notation.number(cell) for cell in cells] for notation in NOTATIONS.values())
    return max(found, key=lambda each: sum(number is not None for number in each))


def likeliest(cells: Sequence[Cell]) -> Notation:
    """The notation in which most cells are numbers."""
    return max(NOTATIONS.values(), key=lambda n: sum(n.number(cell) is not None for cell in cells))

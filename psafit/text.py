"""Numbers as text: rounded half away from zero, and zero without a sign.

What is rounded is the decimal number that a float prints as. So 0.925 is 0.93 as a fraction and 93 in per cent;
Python's own formats round the binary numbers next to it, to 0.93 and 92.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import ROUND_HALF_UP, Context, Decimal
from typing import Final

# Exact for every float there is: the largest has 309 digits before the point.
_EXACT = Context(prec=400, rounding=ROUND_HALF_UP)
# Units that take prefixes, each below this size; and the prefixes.
_PREFIXED: Final = {"m": 1e-3, "s": 1.0, "N": 1e-2}
_SMALL: Final = ((1e3, "m"), (1e6, "u"), (1e9, "n"))


def fixed(value: float, digits: int = 0, *, sign: bool = False, per_cent: bool = False) -> str:
    """Format a number with so many digits behind the point.

    Parameters
    ----------
    value : float
    digits : int
    sign : bool
        Whether a positive number has its sign, too.
    per_cent : bool
        Whether a hundred times the number is meant.

    Returns
    -------
    str

    Examples
    --------
    >>> fixed(0.925, 2), fixed(0.925, per_cent=True), fixed(-0.004, 2), fixed(0.12, 1, sign=True)
    ('0.93', '93', '0.00', '+0.1')
    """
    if not math.isfinite(value):
        return f"{value:+f}" if sign else f"{value:f}"
    number = _decimal(value, per_cent).quantize(Decimal(1).scaleb(-digits), context=_EXACT)
    # "z": no negative zero, also of a number that only rounds to it.
    return f"{number:+zf}".replace("+", "" if not sign or not number else "+")


def significant(value: float, digits: int = 3, *, per_cent: bool = False, plain: int = 5) -> str:
    """Format a number with so many significant digits; without a power of ten up to `plain` places before the point.

    Examples
    --------
    >>> significant(0.0125, 2), significant(0.0125, 2, per_cent=True), significant(1612.0), significant(1234567.0)
    ('0.013', '1.3', '1610', '1.23e+06')
    """
    if not math.isfinite(value):
        return f"{value:g}"
    number = _decimal(value, per_cent)
    if number:
        number = number.quantize(Decimal(1).scaleb(number.adjusted() - digits + 1), context=_EXACT)
    places = number.adjusted() + 1
    return f"{float(number) + 0.0:.{max(digits, places) if places <= plain else digits}g}"


def resolved(value: float, spread: float) -> str:
    """A number with as many digits as its spread supports (two of the spread).

    >>> resolved(142537.0, 812.0)
    '1.4254e5'
    """
    if not (math.isfinite(value) and math.isfinite(spread)) or value == 0:
        return f"{value:g}"
    digits = 4
    if spread > 0:
        digits = min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2, 1), 8)
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    tens = int(exponent)
    return f"{float(f'{value:.{digits}g}'):g}" if -4 <= tens < 5 else f"{mantissa}e{tens}"


def prefixed(unit: str, *values: float) -> tuple[str, list[float]]:
    """Return a unit with the prefix that suits the largest of some values, and the values in it.

    >>> prefixed("m", 7.67e-5)
    ('um', [76.7])
    >>> prefixed("N/m", 1e-9)
    ('N/m', [1e-09])
    """
    largest = max((abs(v) for v in values if math.isfinite(v)), default=0.0)
    if unit in _PREFIXED and 0 < largest < _PREFIXED[unit]:
        factor, prefix = next(((f, p) for f, p in _SMALL if largest * f >= 1), (1.0, ""))
        # To fifteen digits: what was round stays round.
        return prefix + unit, [float(f"{v * factor:.15g}") for v in values]
    return unit, list(values)


def with_unit(text: str, unit: str) -> str:
    """Append a unit, if there is one.

    >>> with_unit("3", "um"), with_unit("3", "1")
    ('3 um', '3')
    """
    return text if unit == "1" else f"{text} {unit}"


def span_text(unit: str, ends: tuple[float, float]) -> str:
    """From one value to another, in the unit with the prefix that suits them.

    >>> span_text("m", (1e-6, 2.5e-5))
    '1 to 25 um'
    """
    unit, both = prefixed(unit, *ends)
    return with_unit(" to ".join(map(significant, both)), unit)


def percent(fraction: float) -> str:
    """Format a share in whole per cent; never 0 or 100 unless it is.

    >>> percent(0.005), percent(0.925), percent(1.0)
    ('under 1 %', '93 %', '100 %')
    """
    text = fixed(fraction, per_cent=True)
    if text == "0" and fraction > 0:
        text = "under 1"
    elif text == "100" and fraction < 1:
        text = "over 99"
    return f"{text} %"


def p_text(p: float, floor: float) -> str:
    """A p value: ``= 0.013``, or ``<= 0.005`` where it is the least that so many simulated data sets can give.

    >>> p_text(0.013, 0.005), p_text(0.005, 0.005)
    ('= 0.013', '<= 0.005')
    """
    return f"{'<=' if p <= floor else '='} {significant(p, 2)}"


def set_name(ids: Iterable[str], none: str = "the baseline") -> str:
    """The name of a set of causes: ``gap + preload``, or what an empty set is called."""
    return " + ".join(ids) or none


def series(items: Iterable[object]) -> str:
    """Some things in a sentence: ``a, b and c``."""
    shown = [str(item) for item in items]
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def count(n: int, noun: str) -> str:
    """A number of things: ``1 reading``, ``2 readings``."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _decimal(value: float, per_cent: bool) -> Decimal:
    return Decimal(repr(float(value))) * (100 if per_cent else 1)

"""Numbers, units, symbols and lists as a page shows them."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable, Sequence
from pathlib import PurePosixPath, PureWindowsPath
from typing import Final

from markupsafe import Markup, escape

from psafit.report.figures.axes import power_of_ten

_GREEK: Final = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "epsilon": "ε",
    "zeta": "ζ",
    "eta": "η",
    "theta": "θ",
    "kappa": "κ",
    "lambda": "λ",
    "mu": "µ",
    "nu": "ν",
    "xi": "ξ",
    "pi": "π",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "varphi": "φ",
    "chi": "χ",
    "psi": "ψ",
    "omega": "ω",
    "Delta": "Δ",
    "Omega": "Ω",
}
_MAX_LISTED = 9


def unit_text(unit: str) -> str:
    """Unit as shown: µm for um, nothing for a pure number."""
    return {"1": "", "um": "µm"}.get(unit, unit)


def symbol_html(latex: str) -> Markup:
    """LaTeX symbol as HTML: Greek letters, sub- and superscripts; braces vanish, everything else is escaped."""
    text = re.sub(r"\\(?:mathrm|text|mathit)\b", "", latex)
    text = re.sub(r"\\([A-Za-z]+) ?", lambda m: _GREEK.get(m[1], m[1]), text)
    html = str(escape(text))
    for mark, tag in (("_", "sub"), (r"\^", "sup")):
        html = re.sub(rf"{mark}\{{([^{{}}]*)\}}|{mark}(\w)", lambda m, t=tag: f"<{t}>{m[1] or m[2]}</{t}>", html)
    return Markup(f"<i>{html.replace('{', '').replace('}', '')}</i>")


def number(value: float, spread: float | None = None) -> str:
    """A number with as many digits as its spread supports (two of the spread), three without a spread.

    >>> number(3220596.8, 526000.0)
    '3.22 × 10⁶'
    >>> number(0.2, 0.056)
    '0.200'
    """
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    digits = 3
    if spread is not None and math.isfinite(spread) and spread > 0:
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(spread)) + 2
        digits = min(max(digits, 2), 6)
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -3 <= power < 5:
        text = f"{float(f'{mantissa}e{power}'):.{max(digits - 1 - power, 0)}f}"
    else:
        text = f"{mantissa} × {power_of_ten(power)}"
    return text.replace("-", "\N{MINUS SIGN}")


def interval(low: float, high: float, spread: float | None = None) -> str:
    """Two ends, in one power of ten where that is shorter."""
    ends = [number(x, spread) for x in (low, high)]
    parts = [end.split(" × ") for end in ends]
    if all(len(p) == 2 for p in parts) and parts[0][1] == parts[1][1]:
        return f"({parts[0][0]} to {parts[1][0]}) × {parts[0][1]}"
    return f"{ends[0]} to {ends[1]}"


def percent(fraction: float) -> str:
    """A fraction in whole per cent; never 0 or 100 unless it is."""
    if 0 < fraction < 0.005:
        return "under 1 %"
    if 0.995 < fraction < 1:
        return "over 99 %"
    return f"{100 * fraction:.0f} %"


def p_value(p: float) -> str:
    """A probability with the digits that matter."""
    if not math.isfinite(p):
        return "–"
    return "< 0.0001" if p < 1e-4 else f"{p:.4f}" if p < 0.01 else f"{p:.2f}"


def factor(log_error: float) -> str:
    """A logarithmic error as a factor."""
    value = math.exp(min(log_error, 700.0))
    return f"{value:.2f}" if value < 100 else number(value)


def count(n: int, noun: str) -> str:
    """A number of things: ``1 reading``, ``2 readings``."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def listed(items: Iterable[object]) -> Markup:
    """``a, b and c``, escaped; a long list ends in how many more there are."""
    shown = [escape(item) for item in items]
    if len(shown) > _MAX_LISTED:
        shown = [*shown[: _MAX_LISTED - 1], escape(f"{len(shown) - _MAX_LISTED + 1} more")]
    if len(shown) < 2:
        return Markup("").join(shown)
    return Markup(", ").join(shown[:-1]) + " and " + shown[-1]


def groups(ids: Sequence[object]) -> Markup:
    """``group 1``, ``groups 1 and 2``."""
    return Markup("group {}" if len(ids) == 1 else "groups {}").format(listed(ids))


_ABSOLUTE = re.compile(r"^(?:[/\\]|~|[A-Za-z]:[/\\])")


def without_paths(command: str) -> str:
    """A command line whose absolute paths are cut to their last part: the page says nothing of the machine."""
    try:
        words = shlex.split(command)
    except ValueError:  # an open quote
        words = command.split()

    def cut(word: str) -> str:
        head, equals, tail = word.partition("=")
        if equals and _ABSOLUTE.match(tail):
            return f"{head}={cut(tail)}"
        if not _ABSOLUTE.match(word):
            return word
        kind = PureWindowsPath if "\\" in word or word[1:2] == ":" else PurePosixPath
        return kind(word).name or word

    return shlex.join(cut(word) for word in words)

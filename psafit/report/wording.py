"""Numbers, units, symbols and lists as a page shows them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Final

from markupsafe import Markup, escape

from psafit.experiment import Group
from psafit.report.figures.axes import SUPERSCRIPT, power_of_ten
from psafit.text import fixed, prefixed
from psafit.text import percent as plain_percent

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
NBSP: Final = "\N{NO-BREAK SPACE}"
TIMES: Final = f"{NBSP}×{NBSP}"


def unit_text(unit: str) -> str:
    """Unit as shown: µm for um, m/s² for m/s^2, nothing for a pure number; it does not break."""
    raised = re.sub(r"\^(-?\d)", lambda m: m[1].translate(SUPERSCRIPT), unit)
    return {"1": "", "um": "µm", "us": "µs", "uN": "µN"}.get(unit, raised).replace(" ", NBSP)


def with_unit(text: str, unit: str) -> str:
    """Append a unit, if there is one, so that the line does not break before it."""
    return f"{text}{NBSP}{unit_text(unit)}" if unit_text(unit) else text


def span(values: Sequence[float], unit: str) -> str:
    """From the least to the greatest of some values, or the one that they are."""
    unit, (low, high) = prefixed(unit, min(values), max(values))
    text = number(low) if math.isclose(low, high) else interval(low, high)
    return with_unit(text, unit)


def offsets(groups: Iterable[Group]) -> str:
    """The offset of `log_rmse`; where several observables were read, that of each."""
    found = {g.observable.name: g.observable for g in groups}.values()
    each = [with_unit(f"{o.offset:g}", o.unit) + (f" for {o.titles}" if len(found) > 1 else "") for o in found]
    return str(listed(each))


def symbol_html(latex: str) -> Markup:
    """LaTeX symbol as HTML: Greek letters, sub- and superscripts; braces vanish, everything else is escaped."""
    roman = r"\\(?:mathrm|text|mathit)\{([^{}]*)\}"
    text = re.sub(roman, r"\1", re.sub(rf"(?<=[_^]){roman}", r"{\1}", latex)).replace("\\ ", " ")
    text = re.sub(r"\\([A-Za-z]+) ?", lambda m: _GREEK.get(m[1], m[1]), text)
    html = str(escape(text))
    for mark, tag in (("_", "sub"), (r"\^", "sup")):
        html = re.sub(rf"{mark}\{{([^{{}}]*)\}}", rf"<{tag}>\1</{tag}>", html)
        html = re.sub(rf"{mark}(\w)", rf"<{tag}>\1</{tag}>", html)
    return Markup(f"<i>{html.replace('{', '').replace('}', '')}</i>")


def number(value: float, spread: float | None = None, *, power: bool = False) -> str:
    """A number with as many digits as its spread supports (two of the spread), three without a spread.

    `power` forces a power of ten.

    >>> number(3220596.8, 526000.0).replace(NBSP, " ")
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
    tens = int(exponent)
    if -3 <= tens < 5 and not power:
        text = f"{float(f'{mantissa}e{tens}'):.{max(digits - 1 - tens, 0)}f}"
    else:
        text = f"{mantissa}{TIMES}{power_of_ten(tens)}"
    return text.replace("-", "\N{MINUS SIGN}")


def interval(low: float, high: float, spread: float | None = None) -> str:
    """Two ends, both with a power of ten or neither, and only one where both have the same.

    An end that everybody reads without a power keeps its form, even where the other needs one.

    >>> interval(23270.9, 4.297e7).replace(NBSP, " ")
    '2.33 × 10⁴ to 4.30 × 10⁷'
    >>> interval(-0.0006, 1.07, 0.53)
    '0 to 1.07'
    >>> interval(0.00006, 1.07, 0.53).replace(NBSP, " ")
    '6.0 × 10⁻⁵ to 1.07'
    """
    # An end that is nought to the last digit of the other one is nought.
    if spread is not None and 0 < spread < math.inf and low < 0 < high:
        least = 0.5 * 10.0 ** (math.floor(math.log10(spread)) - 1)
        low, high = (0.0 if abs(x) < least else x for x in (low, high))
    ends = [number(x, spread) for x in (low, high)]
    if sum("×" in end for end in ends) == 1 and not any(x == 0 or 0.01 <= abs(x) < 1000 for x in (low, high)):
        ends = [number(x, spread, power=True) for x in (low, high)]
    parts = [end.split(TIMES) for end in ends]
    if all(len(p) == 2 for p in parts) and parts[0][1] == parts[1][1]:
        return f"({parts[0][0]} to {parts[1][0]}){TIMES}{parts[0][1]}"
    return f"{ends[0]} to {ends[1]}"


def exact(value: float) -> str:
    """A number that somebody chose, without the digits of a measurement: 0.01, 1000, 10⁹."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{value + 0.0:.6g}".replace("-", "\N{MINUS SIGN}")
    mantissa, exponent = f"{value:.5e}".split("e")
    head = f"{float(mantissa):g}".replace("-", "\N{MINUS SIGN}")
    return power_of_ten(int(exponent)) if head == "1" else f"{head}{TIMES}{power_of_ten(int(exponent))}"


def rounded(value: float, digits: int = 2) -> str:
    """A number of which only the size matters."""
    return exact(float(f"{value:.{digits}g}")) if math.isfinite(value) else "–"


def percent(fraction: float) -> str:
    """A fraction in whole per cent; never 0 or 100 unless it is.

    >>> percent(0.005).replace(NBSP, " ")
    'under 1 %'
    """
    return plain_percent(fraction).replace("-", "\N{MINUS SIGN}").replace(" %", f"{NBSP}%")


def p_value(p: float, floor: float = 1e-3) -> str:
    """A probability with the digits that simulated data support; at their `floor`, a thousand of them by default, ≤."""
    if not math.isfinite(p):
        return "–"
    least = max(floor, 1e-3)
    return f"≤ {fixed(least, 3)}" if p <= least else fixed(p, 3 if p < 0.1 else 2)


def factor(log_error: float) -> str:
    """A logarithmic error as a factor."""
    value = math.exp(min(log_error, 700.0))
    return f"{value:.2f}" if 0.1 <= value < 100 else number(value)


def typeset(text: str) -> str:
    """Plain text as a page shows it: units, minus signs and powers of ten.

    >>> typeset("k_c = 3.22e6 N/m, -2 um").replace(NBSP, " ")
    'k_c = 3.22 × 10⁶ N/m, −2 µm'
    """
    text = re.sub(r"(?<=\d)e([+-]?\d+)\b", lambda m: f"{TIMES}{power_of_ten(int(m[1]))}", text)
    text = re.sub(r"(?<![\w.)])-(?=\d)", "\N{MINUS SIGN}", text)
    return re.sub(r"\bu([ms])\b", r"µ\1", text)


def noted(head: object, note: object) -> Markup:
    """Something with a note behind it."""
    return Markup("{} <span class='soft'>{}</span>").format(head, note)


def listed(items: Iterable[object], most: int = 9) -> Markup:
    """``a, b and c``, escaped; a list of more than `most` ends in how many more there are."""
    shown = [escape(item) for item in items]
    if len(shown) > most:
        shown = [*shown[: most - 1], escape(f"{len(shown) - most + 1} more")]
    if len(shown) < 2:
        return Markup("").join(shown)
    return Markup(", ").join(shown[:-1]) + " and " + shown[-1]


def groups(ids: Sequence[object]) -> Markup:
    """``group 1``, ``groups 1 and 2``."""
    return Markup("group {}" if len(ids) == 1 else "groups {}").format(listed(ids))


def compared(parameter: str, apart: float, by_chance: float, effective: float) -> str:
    """Whether the sampler's draws and those of importance sampling agree, in plain words.

    Parameters
    ----------
    parameter : str
        That differs most.
    apart, by_chance : float
        By how much, and by how much draws so few would, in widths of the 90 % interval.
    effective : float
        What the importance draws are worth.
    """
    difference = f"no median and no limit differs by more than {fixed(apart, 2)} of the 90 % interval's width"
    if apart <= 2 * by_chance:
        return f"the sampler and {effective:.0f} importance draws agree: {difference}"
    return (
        f"the sampler and {effective:.0f} importance draws disagree on {parameter}: a median or a limit differs by"
        f" {fixed(apart, 2)} of the 90 % interval's width, where {fixed(by_chance, 2)} would be chance; one of them has"
        " missed a part of the posterior, as a rule the importance draws: another seed, or --sampler nautilus, says"
        " which"
    )

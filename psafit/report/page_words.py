"""Words of sentences on a page: causes by their titles, parameters by their symbols, numbers as typeset."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from markupsafe import Markup

from psafit.diagnose.words import Words
from psafit.experiment import GroupId
from psafit.report.catalogue import TITLES, model, symbol
from psafit.report.wording import NBSP, groups, interval, listed, number, percent, span, typeset, with_unit
from psafit.text import prefixed


class PageWords(Words):
    """Causes by their titles, parameters by their symbols, numbers as typeset."""

    def put(self, template: str, *parts: object) -> Markup:
        return Markup(template).format(*parts)

    def causes(self, ids: Sequence[str]) -> str:
        return model(ids)

    def cause(self, id: str) -> str:
        return TITLES.get(id, id)

    def parameter(self, name: str) -> str:
        return symbol(name)

    def groups(self, ids: Sequence[GroupId]) -> str:
        return groups(ids)

    def listed(self, items: Iterable[object]) -> str:
        return listed(items)

    def joined(self, by: str, items: Iterable[object]) -> str:
        return Markup(by).join(items)  # type: ignore[arg-type]

    def choices(self, items: Sequence[object]) -> str:
        return Markup("").join(Markup('<span class="choice">{}</span>').format(item) for item in items)

    def number(self, text: str) -> str:
        return typeset(text.replace("+-", "±").replace("<=", "≤").replace(" %", f"{NBSP}%").replace(" V", f"{NBSP}V"))

    def code(self, text: str) -> str:
        return Markup("<code>{}</code>").format(text)

    def per_cent(self, fraction: float) -> str:
        return percent(fraction)

    def size(self, name: str, unit: str, median: float, ends: tuple[float, float] | None) -> str:
        return Markup("{} = {}").format(symbol(name), self.value(unit, median, ends))

    def value(self, unit: str, median: float, ends: tuple[float, float] | None) -> str:
        unit, (median, *both) = prefixed(unit, median, *(ends or ()))
        spread = (both[1] - both[0]) / 2 if both else 0.0
        error_text = interval(both[0], both[1], spread) if spread > 0 else ""
        error_text = f"({error_text})" if error_text and not error_text.startswith("(") else error_text
        middle = with_unit(number(median, spread if spread > 0 else None), unit)
        return Markup("{} {}").format(middle, error_text).strip()

    def span(self, unit: str, ends: tuple[float, float]) -> str:
        return span(ends, unit)


PAGE = PageWords()

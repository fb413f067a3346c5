"""What a diagnosis' page says in several places: numbers, groups, models, in the page's words."""

from __future__ import annotations

import math
from collections.abc import Iterable

from markupsafe import Markup

from psafit.compare import known
from psafit.diagnose.explanations import Kind
from psafit.diagnose.next_experiment import Proposal
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.models import CauseResult, Evidence, ParameterResult
from psafit.experiment import GroupId
from psafit.report.catalogue import declared
from psafit.report.wording import (
    groups,
    number,
    p_value,
    percent,
    typeset,
    with_unit,
)
from psafit.text import fixed, prefixed, significant

KINDS_MEAN: dict[Kind, str] = {
    "chance": "If it is nothing but chance, a repetition shows nothing.",
    "session": "If it belongs to sessions, a repetition shows something else: look at what was changed in between.",
    "frequency": "If it follows the frequency, it comes back at any amplitude: something swings along.",
    "amplitude": "If it follows the amplitude, it comes back at any frequency: look at the drive.",
    "size": "If it follows the size of what is read, it moves with amplitude, string and ball: look at the contact and"
    " at the instrument.",
}
"""What each thing that a misfit may do would mean."""


def nats(value: object) -> str:
    """A log likelihood or evidence with one digit behind the point, as far as there is something to say."""
    x = known(value)
    if not math.isfinite(x):
        return "–"
    return typeset(fixed(x, 1) if abs(x) < 1e5 else significant(x))


def signed(value: object) -> str:
    """A log likelihood or evidence with its sign; see `nats`."""
    text = nats(value)
    return text if text[0] in "–\N{MINUS SIGN}" or text == "0.0" else f"+{text}"


def share(value: object) -> str:
    """A probability in per cent."""
    x = known(value)
    return percent(x) if math.isfinite(x) else "–"


def group_ids(ids: Iterable[GroupId]) -> Markup:
    """Some groups' ids, or none."""
    found = list(ids)
    return groups(found) if found else Markup("none")


def best_model_of(result: Diagnosis) -> CauseResult | None:
    """The adopted model; its best fit alone, where it is not among the models of the record."""
    if result.best_model:
        return result.best_model
    shown = result.show.get("extended" if result.named else "baseline")
    found = {}
    for name, value in (shown.parameters if shown else {}).items():
        p = declared(name)
        found[name] = ParameterResult(value, None, None, p.unit if p else "1", p.description if p else "", math.nan)
    nothing = Evidence(math.nan, math.nan, math.nan, math.nan, "Laplace")
    return CauseResult(result.named, math.nan, found, nothing, []) if found else None


def p_text(p: float, floor: float) -> str:
    """``p = 0.01``, or that it is at most so much."""
    text = p_value(p, floor)
    return f"p {text}" if text.startswith("≤") else f"p = {text}"


def narrowing(proposal: Proposal) -> str:
    """A fall of the log standard deviation as a share of it, and the standard error of that."""
    text = share(-math.expm1(-proposal.separation))
    return f"{text} ± {share(math.exp(-proposal.separation) * proposal.error)}"


def estimate(p: ParameterResult) -> tuple[str, list[float]]:
    """Unit, and median, lower and upper end in it."""
    return prefixed(p.unit, p.median, known(p.lower), known(p.upper))


def quantity(value: float, unit: str) -> str:
    """A value with its unit."""
    unit, (value,) = prefixed(unit, value)
    return with_unit(number(value), unit)

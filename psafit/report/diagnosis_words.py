"""What a diagnosis' page says in several places: numbers, groups, models, in the page's words."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from psafit.compare import known
from psafit.diagnose.misfit import CHARACTERS
from psafit.diagnose.next_experiment import CLEAR
from psafit.diagnose.record import CauseResult, Diagnosis
from psafit.experiment import GroupId
from psafit.report.catalogue import declared, model, parameter
from psafit.report.wording import (
    groups,
    interval,
    listed,
    number,
    p_value,
    percent,
    prefixed,
    typeset,
    with_unit,
)
from psafit.text import fixed, significant


def nats(value: object) -> str:
    """A log likelihood or evidence with one digit behind the point, as far as there is something to say."""
    x = known(value)
    if not math.isfinite(x):
        return "–"
    return typeset(fixed(x, 1) if abs(x) < 1e5 else significant(x))


def signed(value: object) -> str:
    """The same with its sign."""
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


def of_group(group: GroupId, text: str) -> Markup:
    """A place in the record's words, the group's own name left as it is."""
    rest = text.removeprefix(f"group {group}, ")
    rest = re.sub(r"\b\d(?:\.\d+)?e\+04\b", lambda m: f"{float(m[0]):.0f}", rest)
    return Markup("<strong>Group {}</strong>: {}").format(group, typeset(rest))


def listed_leader(result: Diagnosis) -> CauseResult | None:
    """The adopted model, where it is among the models of the record."""
    return next((c for c in result.causes if c.terms == result.named), None)


def leader_of(result: Diagnosis) -> CauseResult | None:
    """The adopted model; its best fit alone, where it is not among the models of the record."""
    if listed_one := listed_leader(result):
        return listed_one
    values = result.show.get("extended" if result.named else "baseline", {}).get("parameters", {})
    found = {}
    for name, value in values.items():
        p = declared(name)
        about = {"unit": p.unit, "description": p.description} if p else {}
        found[name] = {"median": value, **about}
    return CauseResult(result.named, math.nan, found, {}, []) if found else None


def p_text(p: float) -> str:
    """``p = 0.01``, or that it is at most so much."""
    text = p_value(p)
    return f"p {text}" if text.startswith("≤") else f"p = {text}"


def character(tests: Mapping[str, Any]) -> str:
    """What the tests say is wrong, in words."""
    found = str(tests.get("character", "none"))
    return CHARACTERS.get(found, found)


def lead(proposal: Mapping[str, Any]) -> str:
    """An expected separation with its error; single log ratios count up to a limit."""
    x, error = known(proposal["separation"]), known(proposal["error"])
    return typeset(f"over {0.9 * CLEAR:.0f} nats" if x > 0.9 * CLEAR else f"{fixed(x, 1)} ± {fixed(error, 1)} nats")


def narrowing(separation: object, error: object = None) -> str:
    """A fall of the log standard deviation as a share of it, and the standard error of that."""
    text = share(-math.expm1(-known(separation)))
    return text if error is None else f"{text} ± {share(math.exp(-known(separation)) * known(error))}"


def estimate(p: Mapping[str, Any]) -> tuple[str, list[float]]:
    """Unit, and median, lower and upper end in it."""
    return prefixed(str(p.get("unit", "1")), *(known(p.get(k)) for k in ("median", "lower", "upper")))


def quantity(value: float, unit: str) -> str:
    """A value with its unit."""
    unit, (value,) = prefixed(unit, value)
    return with_unit(number(value), unit)


def about(text: str) -> Markup | str:
    """What proposals are for: the record names causes and parameters by their ids."""
    verb, _, what = text.partition(" ")
    if verb == "tells" and " from " in what:
        first, others = what.split(" from ", 1)
        sets = [split(ids) for ids in (first, *others.split(", "))]
        shared = set.intersection(*map(set, sets))
        if any(shared.issuperset(ids) for ids in sets):  # one holds nothing else
            shared = set()
        one, *rest = (model([id for id in ids if id not in shared]) for ids in sets)
        beside = " (beside what they share)" if shared else ""
        return Markup("tells {} from {}{}").format(one, listed(rest), beside)
    p = declared(what)
    return Markup("determines {}").format(parameter(what, p.description)) if verb and p else text


def split(ids: str) -> list[str]:
    """A set of causes as the record writes it in words."""
    return [] if ids in ("baseline", "the baseline") else ids.split(" + ")


def span(values: Sequence[float], unit: str) -> str:
    """From the least to the greatest of some values, or the one that they are."""
    low, high = min(values), max(values)
    text = number(low) if math.isclose(low, high) else interval(low, high)
    return with_unit(text, unit)

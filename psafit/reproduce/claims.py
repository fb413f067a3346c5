"""What the study printed, read from its file, and a verdict on each number."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import read_error
from psafit.physics import baseline
from psafit.reproduce.records import (
    NOT_REPRODUCED,
    ONLY_WITH_STEP,
    PUBLISHED,
    REPRODUCED,
    Claim,
    Verdict,
)
from psafit.reproduce.solutions import (
    Solution,
)
from psafit.simulate.reference import (
    ContactParameters,
    Point,
)


def _highest(values: FloatArray) -> int:
    if np.isnan(values).all():
        remedy = "give the scheme a longer total, and minimum_frequency one that was measured"
        raise InputError(f"{PUBLISHED}: the published scheme launches no ball in a sweep of a claim", remedy)
    return int(np.nanargmax(values))


def _launch_range(s: Solution, c: Mapping[str, Any]) -> float:
    return 1e6 * s.at(_point(c)).launch_range


def _largest(s: Solution, c: Mapping[str, Any]) -> tuple[float, float]:
    frequency, found = s.over(c)
    ranges = np.array([q.launch_range for q in found])
    if np.all(np.isnan(ranges)):
        return math.nan, math.nan
    best = _highest(ranges)
    return float(frequency[best]), 1e6 * float(ranges[best])


def _peak_launch_range(s: Solution, c: Mapping[str, Any]) -> float:
    # A curve with holes where the scheme overflowed has no known maximum.
    _, found = s.over(c)
    return math.nan if any(math.isnan(q.launch_range) for q in found) else _largest(s, c)[1]


def _peak_frequency(s: Solution, c: Mapping[str, Any]) -> float:
    return _largest(s, c)[0]


def _peak_error(s: Solution, c: Mapping[str, Any]) -> float:
    measured = float(s._experiment.group(c["group"]).reading.max())
    return 100.0 * abs(_peak_launch_range(s, c) - measured) / measured


def _largest_tip_time(s: Solution, c: Mapping[str, Any]) -> float:
    return 1e6 * s.at(_point(c)).largest_tip_time


def _peak_force_frequency(s: Solution, c: Mapping[str, Any]) -> float:
    frequency, found = s.over(c)
    return float(frequency[_highest(np.array([q.peak_force for q in found]))])


def _contact_time_rises(s: Solution, c: Mapping[str, Any]) -> float:
    _, found = s.over(c)
    return float(np.count_nonzero(np.diff([q.contact_time for q in found]) > 0))


def _restitution(s: Solution, c: Mapping[str, Any]) -> float:
    return s.at(_point(c)).restitution


def _restitution_somewhere(s: Solution, c: Mapping[str, Any]) -> float:
    _, found = s.over(c)
    values = np.array([q.restitution for q in found])
    return float(values[np.nanargmin(np.abs(values - c["published"]))])


def _restitution_ratio(s: Solution, c: Mapping[str, Any]) -> float:
    point = _point(c)
    other = point._replace(frequency=float(c["other_frequency"]))
    return s.at(point).restitution / s.at(other).restitution


class _Quantity(NamedTuple):
    """How a claimed quantity is computed, and which keys of the claim that takes."""

    value: Callable[[Solution, Mapping[str, Any]], float]
    needs: tuple[str, ...]


_AT_A_POINT = ("waveform", "frequency", "amplitude")


_QUANTITIES: Mapping[str, _Quantity] = {
    "launch_range": _Quantity(_launch_range, _AT_A_POINT),
    "peak_launch_range": _Quantity(_peak_launch_range, ("group",)),
    "peak_frequency": _Quantity(_peak_frequency, ("group",)),
    "peak_error": _Quantity(_peak_error, ("group",)),
    "largest_tip_time": _Quantity(_largest_tip_time, _AT_A_POINT),
    "peak_force_frequency": _Quantity(_peak_force_frequency, ("group",)),
    "contact_time_rises": _Quantity(_contact_time_rises, ("group",)),
    "restitution": _Quantity(_restitution, _AT_A_POINT),
    "restitution_somewhere": _Quantity(_restitution_somewhere, ("group",)),
    "restitution_ratio": _Quantity(_restitution_ratio, (*_AT_A_POINT, "other_frequency")),
}


def _point(claim: Mapping[str, Any]) -> Point:
    return Point(claim["waveform"], float(claim["frequency"]), float(claim["amplitude"]))


def judge(published: float, tolerance: float, study_step: float, converged: float) -> Verdict:
    """Verdict on one number; a value that is NaN matches nothing."""
    if abs(converged - published) <= tolerance:
        return REPRODUCED
    if abs(study_step - published) <= tolerance:
        return ONLY_WITH_STEP
    return NOT_REPRODUCED


def judged(claim: Mapping[str, Any], study: Solution, exact: Solution) -> Claim:
    """A claim of the file with both solutions' values and a verdict."""
    value = _QUANTITIES[claim["quantity"]].value
    published = float(claim["published"])
    tolerance = float(claim["tolerance"] if "tolerance" in claim else claim["tolerance_relative"] * published)
    stepped, converged = value(study, claim), value(exact, claim)
    return Claim(
        claim["id"], claim["place"], claim["statement"], claim["unit"], published, tolerance,
        claim["reason"], stepped, converged, judge(published, tolerance, stepped, converged),
        claim.get("note", ""),
    )  # fmt: skip


# What a study may state: as far as the simulator goes, and no longer than one waits.
_LIMITS: Mapping[str, tuple[float, float]] = {
    **{p.name: (p.bounds.lower if p.name == "k_c" else 0.0, p.bounds.upper) for p in baseline.PARAMETERS},
    "step": (1e-9, 1e-4),
    "total": (1e-3, 10.0),
    "frequency": (1e-2, 1e7),
    "amplitude": (1e-3, 1e6),
}


_MOST_STEPS = 1e7


def read_published(folder: str | Path) -> dict[str, Any]:
    """Read ``published.toml`` of an experiment folder.

    Returns
    -------
    dict
        Tables ``parameters`` and ``scheme``, and the list ``claim``.

    Raises
    ------
    InputError
        If the file is missing, is not TOML, or lacks something a claim needs.
    """
    file = Path(folder) / PUBLISHED
    remedy = "see experiments/psa/published.toml for the form"
    try:
        data = tomllib.loads(file.read_text("utf-8"))
    except OSError as error:
        remedy = "add this file to reproduce a study"
        raise read_error(error, file, "there are no published claims", remedy) from None
    except (ValueError, RecursionError) as error:  # also of digits or nesting without end
        raise InputError(f"cannot be read: {error}", remedy, file=file) from None
    numbers: tuple[tuple[str, tuple[str, ...]], ...] = (
        ("parameters", ContactParameters._fields),
        ("scheme", ("step", "total")),
    )
    if "rounding" in data:
        numbers += (("rounding", ContactParameters._fields),)
    for table, names in numbers:
        found = data.get(table)
        for name in names:
            low, high = _LIMITS[name]
            if table == "rounding":  # no further than to where a parameter ends
                low, high = 0.0, float(data["parameters"][name]) - low
            value = found.get(name) if isinstance(found, dict) else None
            if not (_usable(value, zero=low == 0) and low <= value <= high):
                raise InputError(f"[{table}] has no valid {name}, from {low:g} to {high:g}", remedy, file=file)
    if data["scheme"]["total"] > _MOST_STEPS * data["scheme"]["step"]:
        raise InputError(f"[scheme] asks for more than {_MOST_STEPS:g} steps", remedy, file=file)
    claims = data.get("claim", [])
    if not (isinstance(claims, list) and all(isinstance(claim, dict) for claim in claims)):
        raise InputError("the claims are not a list of [[claim]] tables", remedy, file=file)
    for position, claim in enumerate(claims, start=1):
        fault = _fault(claim)
        if fault is not None:
            name = claim.get("id", f"number {position}")
            raise InputError(f"claim {name} {fault}", remedy, file=file)
    return data


def _usable(number: object, *, zero: bool) -> TypeGuard[float]:
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    return 0 < number <= sys.float_info.max or (zero and number == 0)


def _fault(claim: Mapping[str, Any]) -> str | None:
    """What is wrong with a claim, or None."""
    for key in ("id", "place", "statement", "quantity", "unit", "reason"):
        if not (isinstance(claim.get(key), str) and claim[key]):
            return f"lacks {key!r}, a text"
    if claim["quantity"] not in _QUANTITIES:
        return f"has the unknown quantity {claim['quantity']!r}, not one of {', '.join(_QUANTITIES)}"
    if ("tolerance" in claim) == ("tolerance_relative" in claim):
        return "needs one of tolerance and tolerance_relative"
    needs = _QUANTITIES[claim["quantity"]].needs
    for key in ("published", *needs):
        if key not in claim:
            return f"lacks {key!r}"
    if claim.get("waveform", "sine") not in ("sine", "square"):
        return f"has the waveform {claim['waveform']!r}, neither sine nor square"
    if not isinstance(claim.get("group", 1), int | str):
        return f"has {claim['group']!r} for a group"
    positive = {"frequency", "other_frequency", "amplitude", "tolerance", "tolerance_relative"}
    for key in sorted(positive & claim.keys()):
        low, high = _LIMITS.get(key.removeprefix("other_"), (0.0, math.inf))
        if not (_usable(claim[key], zero=False) and low <= claim[key] <= high):
            return f"has {claim[key]!r} for {key}"
    if not isinstance(claim.get("note", ""), str):
        return "has a note that is no text"
    for key in ("published", "minimum_frequency"):
        if not _usable(claim.get(key, 0), zero=True):
            return f"has {claim[key]!r} for {key}"
    return None

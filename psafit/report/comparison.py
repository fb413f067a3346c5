"""The page of two results side by side: what differs between them, in what they saw, found and predict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from markupsafe import Markup

from psafit.compare import Comparison, Estimate, GroupPair, ParameterPair, Side
from psafit.experiment import Group
from psafit.observables import names
from psafit.report import figures
from psafit.report.catalogue import declared, model, parameter, symbol
from psafit.report.figures.groups import short, titled
from psafit.report.page import Picture, figure_data_uri, render, worst
from psafit.report.wording import (
    factor,
    groups,
    interval,
    listed,
    number,
    percent,
    typeset,
    with_unit,
)
from psafit.text import count, fixed

_LOOKS: Final = (("blue", False), ("vermillion", True))


@dataclass(frozen=True, eq=False)
class _Shown:
    name: str
    pair: GroupPair
    sweep: figures.Sweep
    group: Group
    curves: list[figures.Curve]


def write_comparison(first: Side, second: Side, found: Comparison, out_path: Path) -> Path:
    """Write the page of two results.

    Parameters
    ----------
    first, second : Side
    found : Comparison
        Of the two.
    out_path : Path
        The HTML file.

    Returns
    -------
    Path
    """
    shown = _shown(first, second, found)
    pictured = [shown[i] for i in worst([max(g.pair.log_rmse) for g in shown])]
    differing = [f for f in found.facts if f.first != f.second]
    apart = groups(left) if (left := _apart(first, second, found)) else None
    return render(
        "comparison.html.j2",
        out_path,
        title=f"{first.name} and {second.name} side by side",
        names=[first.name, second.name],
        verdict=_verdict(found),
        sentences=[_compared(first, second, found, apart), _better(first, second, found), what_differs(found)],
        tiles=_tiles(found),
        summary=_summary(pictured, found),
        parameters=[_parameter_row(p) for p in found.parameters],
        estimates=_estimates(found),
        scores=[_score_row(g, [short(name) for name in found.names]) for g in shown],
        explorable=[
            figures.explorable(f"Group {g.pair.group}: {g.sweep.held}", g.group, g.sweep, g.curves) for g in shown
        ],
        pictures=_pictures(pictured),
        left_out=len(shown) - len(pictured),
        zeros=any(figures.has_zeros(g.group, g.curves) for g in pictured),
        apart=apart,
        differing=[[f.what, f.first or "–", f.second or "–"] for f in differing],
        same=[[f.what, f.first] for f in found.facts if f.first == f.second],
        provenance={"first": first.name, "second": second.name, "psafit": first.facts.get("version of psafit", "?")},
    )


def _shown(first: Side, second: Side, found: Comparison) -> list[_Shown]:
    sides = [{t.key: t for t in side.predicted} for side in (first, second)]
    called = names((pair.group, pair.observable) for pair in found.groups)
    sweeps = figures.sweeps_of([sides[0][pair.key].group for pair in found.groups])
    shown = []
    for name_of_pair, pair, sweep in zip(called, found.groups, sweeps, strict=True):
        predicted = [side[pair.key] for side in sides]
        curves = [
            figures.Curve(name, color, t.median, (figures.Band(figures.READING_BAND, t.lower, t.upper),), dashed)
            for t, name, (color, dashed) in zip(predicted, found.names, _LOOKS, strict=True)
        ]
        shown.append(_Shown(name_of_pair, pair, sweep, predicted[0].group, curves))
    return shown


def _apart(first: Side, second: Side, found: Comparison) -> list[str]:
    """What is not compared: whole groups, and of those of which something is, what is read."""
    kept, partly = {g.key for g in found.groups}, {str(g.group) for g in found.groups}
    left = dict.fromkeys(t.key for t in (*first.predicted, *second.predicted) if t.key not in kept)
    called = dict(zip(left, names((*left, *kept)), strict=False))
    return list(dict.fromkeys(called[key] if key[0] in partly else key[0] for key in left))


# The first screen -----------------------------------------------------------------------------------------------


def _verdict(found: Comparison) -> dict[str, str]:
    if found.log_rmse is None or found.log_rmse_interval is None:
        return {"text": "no group to judge by", "kind": "warn"}
    winner = clear_winner(found.log_rmse, found.log_rmse_interval)
    if winner is None:
        return {"text": "no clear difference", "kind": "warn"}
    return {"text": f"{short(found.names[winner], 28)} predicts better", "kind": "good"}


def clear_winner(errors: Sequence[float], interval: Sequence[float], relevant: float = 0.01) -> int | None:
    """Which of two log RMSEs is smaller beyond doubt, and by one per cent of a reading: less makes nobody choose."""
    low, high = interval
    if low <= 0 <= high or abs(errors[1] - errors[0]) < relevant:
        return None
    return int(high < 0)


def _compared(first: Side, second: Side, found: Comparison, apart: Markup | None) -> Markup:
    def fitted(side: Side) -> Markup:
        return Markup("<strong>{}</strong> ({} of {}, {})").format(
            side.name, side.kind, groups(side.groups), model(side.terms)
        )

    return Markup("<strong>Compared:</strong> {} and {}, on {} in {} with the same readings{}.").format(
        fitted(first),
        fitted(second),
        count(sum(g.n_points for g in found.groups), "reading"),
        count(len({str(g.group) for g in found.groups}), "group"),
        Markup("; without {}").format(apart) if apart else "",
    )


def _better(first: Side, second: Side, found: Comparison) -> Markup:
    head = Markup("<strong>Which predicts better?</strong> ")
    if found.log_rmse is None or found.log_rmse_interval is None:
        return head + (
            "Nobody can say: there is no group that both could fail at and neither has fitted."
            " Fit both to the same groups, and leave one out."
        )
    low, high = found.log_rmse_interval
    winner = clear_winner(found.log_rmse, found.log_rmse_interval)
    clear = "no clear difference, or one below 1 % of a reading"
    if winner is not None:
        clear = f"{found.names[winner]} is better{_but(first, second, winner)}"
    return head + Markup(
        "On {}, which neither has fitted, {} is typically off by ×{} and {} by ×{}; change of the mean log RMSE {} to"
        " {} (90 %): {}."
    ).format(
        groups(found.judged), found.names[0], factor(found.log_rmse[0]), found.names[1], factor(found.log_rmse[1]),
        signed_text(low), signed_text(high), clear,
    )  # fmt: skip


def _but(first: Side, second: Side, winner: int) -> str:
    """What may be why one is better although its model is not: the readings that it was fitted to."""
    fitted = [{str(id) for id in side.groups} for side in (first, second)]
    if fitted[0] == fitted[1]:
        return ""
    seen = [
        sum(t.group.n_points for t in side.predicted if str(t.group.id) in ids)
        for side, ids in zip((first, second), fitted, strict=True)
    ]
    what = "more" if seen[winner] > seen[1 - winner] else "other"
    return f"; the runs were fitted to different groups, so {what} data alone may be why"


def what_differs(found: Comparison) -> Markup:
    """In what two runs differ, in a sentence."""
    what = [f.what for f in found.facts if f.first != f.second and f.what not in ("command", "posterior", "verdict")]
    shared = [p for p in found.parameters if p.overlap is not None]
    apart = [p for p in shared if p.overlap is not None and not _same(p.overlap)]
    text = Markup("{} in both").format(count(len(shared), "parameter"))
    if apart:
        text += Markup(", of which {} share less than half of the shorter interval").format(
            listed(symbol(p.name) for p in apart)
        )
    elif shared:
        text += ", the intervals of each overlapping"
    given = listed(what) if what else Markup("nothing in what they were given")
    return Markup("<strong>What differs?</strong> Given: {}. Found: {}.").format(given, text)


def signed_text(x: float) -> str:
    """A difference of errors, with its sign."""
    return typeset(fixed(x, 3, sign=True))


def _tiles(found: Comparison) -> list[dict[str, str]]:
    over = "mean over the groups that neither has fitted" if found.judged else "mean over the groups of both"
    tiles = []
    for k, name in enumerate(found.names):
        errors = [g.log_rmse[k] for g in found.groups if not found.judged or g.judged]
        spread = f"; ×{factor(min(errors))} to ×{factor(max(errors))}" if len(errors) > 1 else ""
        mean = math.fsum(errors) / len(errors)
        tiles.append({"value": f"×{factor(mean)}", "label": f"typical factor, {name}, {over}{spread}"})
    return tiles


def _summary(pictured: Sequence[_Shown], found: Comparison) -> Picture:
    rows = [
        figures.Row(
            g.pair.group,
            g.sweep.held,
            [
                figures.Mark(e, color, "s" if dashed else "o", hollow=dashed)
                for e, (color, dashed) in zip(g.pair.log_rmse, _LOOKS, strict=True)
            ],
        )
        for g in pictured
    ]
    ranked = sorted(pictured, key=lambda g: (not g.pair.judged, -abs(g.pair.log_rmse[1] - g.pair.log_rmse[0])))
    examples = [figures.Example(titled(g.pair.group), "ink", g.group, g.sweep, g.curves) for g in ranked[:2]]
    text = "; ".join(
        f"group {g.name} {factor(g.pair.log_rmse[0])} and {factor(g.pair.log_rmse[1])}" for g in pictured[:20]
    )
    legend = figures.handles([figures.Curve(c.name, c.color, c.middle, (), c.dashed) for c in pictured[0].curves])
    return Picture(
        figure_data_uri(figures.summary_figure(rows, examples, legend)),
        f"Typical factor between prediction and reading, {found.names[0]} and {found.names[1]}: {text}.",
        f"Above, how far {found.names[0]} (filled) and {found.names[1]} (hollow) are off in each group: ×1 would be"
        " perfect. Below, where they differ most. Lines: predicted medians. Bands: where 90 % of readings should fall.",
    )


# Parameters -----------------------------------------------------------------------------------------------------


def _value(e: Estimate | None) -> list[str]:
    """Median and interval, as far as they are on record and the data support them."""
    if e is None:
        return ["–"]
    if e.limit:
        return [typeset(e.limit)]
    spread = (e.upper - e.lower) / 2
    ends = [with_unit(interval(e.lower, e.upper, spread), e.unit)] if spread > 0 else []
    return [with_unit(number(e.median, spread), e.unit), *ends]


def _same(overlap: float, least: float = 0.5) -> bool:
    """Whether two intervals share at least this part of the shorter one; NaN, of one without width, parts none."""
    return not overlap < least


def _parameter_row(p: ParameterPair) -> list[Any]:
    about = p.first or p.second
    overlap: Any = "–"
    verdicts = [e.verdict for e in (p.first, p.second) if e and e.verdict]
    if p.overlap is not None and math.isfinite(p.overlap):
        kind = "good" if _same(p.overlap) else "warn" if p.overlap > 0 else "bad"
        if "not determined" in verdicts:  # a prior that overlaps confirms nothing
            kind = ""
        overlap = {"text": percent(p.overlap) if p.overlap > 0 else "apart", "kind": kind}
    return [
        parameter(p.name, about.description if about else ""),
        *(Markup("<br>").join(_value(e)) for e in (p.first, p.second)),
        overlap,
        " / ".join(dict.fromkeys((e.verdict if e else "") or "–" for e in (p.first, p.second))),
    ]


def _estimates(found: Comparison) -> Picture | None:
    drawn = [p for p in found.parameters if p.overlap is not None and math.isfinite(p.overlap)]
    if not drawn:
        return None
    rows = []
    for p in drawn:
        own = declared(p.name)
        estimates = [(e.median, e.lower, e.upper) for e in (p.first, p.second) if e]
        rows.append((figures.axis_label(own.symbol, own.unit) if own else p.name, estimates))
    figure = figures.estimates_figure(rows, found.names, [color for color, _ in _LOOKS])
    text = "; ".join(f"{p.name} {_value(p.first)[-1]} and {_value(p.second)[-1]}" for p in drawn)
    return Picture(
        figure_data_uri(figure),
        f"90 % intervals of the parameters in both: {text}.",
        f"Median and 90 % interval, {found.names[0]} above {found.names[1]}, each parameter on its own scale.",
    )


# Groups ---------------------------------------------------------------------------------------------------------


def _role(roles: Sequence[str]) -> str:
    words = {"fit": "fitted", "holdout": "unseen"}
    return " / ".join(dict.fromkeys(words[r] for r in roles))


def _score_row(shown: _Shown, results: Sequence[str]) -> list[Any]:
    g = shown.pair
    elpd = "–"
    if g.elpd_change is not None and g.elpd_interval is not None:
        low, high = g.elpd_interval
        elpd = typeset("{} ({} to {})".format(*(fixed(x, 1, sign=True) for x in (g.elpd_change, low, high))))
    low, high = g.log_rmse_interval
    winner = clear_winner(g.log_rmse, g.log_rmse_interval)
    better: Any = "no clear difference" if winner is None else {"text": results[winner], "kind": "good"}
    return [
        f"Group {shown.name}",
        _role(g.roles),
        *(f"{e:.3f} (×{factor(e)})" for e in g.log_rmse),
        f"{signed_text(g.log_rmse[1] - g.log_rmse[0])} ({signed_text(low)} to {signed_text(high)})",
        better,
        " / ".join(percent(c) for c in g.coverage_90),
        elpd,
    ]


def _pictures(pictured: Sequence[_Shown]) -> list[Picture]:
    found = []
    for g in pictured:
        text = " and ".join(f"×{factor(e)} ({c.name})" for e, c in zip(g.pair.log_rmse, g.curves, strict=True))
        read = g.group.observable.title.capitalize()
        figure = figures.group_figure(g.group, g.sweep, g.curves)
        found.append(
            Picture(
                figure_data_uri(figure, like=len(pictured)),
                f"{read} of group {g.pair.group}, {g.sweep.condition}: measured, and predicted by {text}.",
                f"Off by {text}.",
            )
        )
    return found

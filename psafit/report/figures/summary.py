"""The picture of a first screen: how far models are off in each group, above one or two groups as examples."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from psafit.experiment import Conditions
from psafit.report.figures.axes import label, reading_label
from psafit.report.figures.curves import (
    Curve,
    View,
    draw_curves,
    handles,
    magnified,
    zero_mark,
)
from psafit.report.figures.groups import short
from psafit.report.figures.sweep import AXIS, Sweep
from psafit.report.style import PALETTE, WIDTH, figure_style

_FACTORS = (1.0, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0, 1000.0)


@dataclass(frozen=True)
class Mark:
    """One model's error in a group: its log RMSE, and how it is drawn."""

    log_rmse: float
    color: str
    marker: str = "o"
    hollow: bool = False

    @property
    def look(self) -> dict[str, Any]:
        """Keyword arguments of `Axes.plot`."""
        color = PALETTE[self.color]
        face = "white" if self.hollow else color
        return {"color": color, "marker": self.marker, "ms": 6.5, "mfc": face, "mec": color, "mew": 1.5}


@dataclass(frozen=True)
class Row:
    """A group's line in the picture: what it holds, and several marks for what it goes through, in this order."""

    group: object
    condition: str
    marks: Sequence[Mark]


@dataclass(frozen=True)
class Example:
    """A group that is shown below; the `view` and what stands at the axis are those of the readings by default."""

    title: str
    color: str
    group: Conditions
    sweep: Sweep
    curves: Sequence[Curve]
    view: View | None = None
    over: str = ""

    @property
    def label(self) -> str:
        """What stands at the upright axis."""
        return reading_label(self.group, self.over)

    def magnified(self) -> Example:
        """The same against the first curve, where the others lie on it."""
        group, curves, view, over = magnified(self.group, self.curves)
        return replace(self, group=group, curves=curves, view=view, over=over) if over else self


def draw_factors(axes: Axes, rows: Sequence[Row]) -> None:
    """Typical factor between prediction and reading of each row, one below the other."""
    places = np.arange(len(rows))
    most = max((m.log_rmse for r in rows for m in r.marks), default=0.0)
    for place, row in zip(places, rows, strict=True):
        errors = [m.log_rmse for m in row.marks]
        if len(errors) > 1:
            axes.plot([min(errors), max(errors)], [place, place], color=PALETTE["faint"], lw=3, zorder=2)
        for mark in row.marks:
            if len(errors) == 1:
                axes.plot([0, mark.log_rmse], [place] * 2, color=PALETTE[mark.color], lw=1.6, alpha=0.45, zorder=2)
            axes.plot(mark.log_rmse, place, linestyle="none", zorder=3, **mark.look)
        axes.annotate(
            " → ".join(f"×{math.exp(e):.2f}" for e in errors), (max(errors, default=0.0), place), (7, 0),
            textcoords="offset points", va="center", fontsize=9.5, color=PALETTE["ink"],
        )  # fmt: skip
    axes.yaxis.set_major_locator(FixedLocator(list(places)))
    names, shared = row_names(rows)
    axes.yaxis.set_major_formatter(FixedFormatter(list(map(label, names))))
    if shared:
        axes.set_title(label(f"All groups: {shared}", 80), fontsize=10, fontweight="normal")
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    room = 1.22 if all(len(r.marks) == 1 for r in rows) else 1.85
    right = room * max(most, 0.05)
    axes.set_xlim(0, right)
    axes.set_xlabel("log RMSE (0 = perfect)")
    above = axes.secondary_xaxis("top")
    inside = [f for f in _FACTORS if math.log(f) < right]
    shown = [f for i, f in enumerate(inside) if all(math.log(g / f) > 0.17 * right for g in inside[i + 1 :])]
    above.xaxis.set_major_locator(FixedLocator([math.log(f) for f in shown]))
    above.xaxis.set_major_formatter(FixedFormatter([f"×{f:g}" for f in shown]))
    above.xaxis.set_minor_locator(NullLocator())


def row_names(rows: Sequence[Row], room: int = 30) -> tuple[list[str], str]:
    """Names that differ where the rows do, in so many characters, and the conditions that all rows share.

    Where they are too long, all go without what is in brackets, and then without what is neither first nor last, if
    they still differ. Groups that have names, and not numbers, may then go by these alone.
    """
    parts = [re.split(r", (?![^(]*\))", r.condition) for r in rows]
    shared = [p for p in parts[0] if all(p in one for one in parts)] if len(rows) > 1 else []
    groups = [short(row.group) for row in rows]
    held = [[p for p in own if p not in shared] for own in parts]
    plain = [[re.sub(r" \(.*?\)", "", p) for p in own] for own in held]
    ends = [own[:1] + own[1:][-1:] for own in plain]

    def fits(kept: list[list[str]]) -> bool:
        return all(len(g) + 2 + len(", ".join(own)) <= room for g, own in zip(groups, kept, strict=True))

    def apart(kept: list[list[str]]) -> int:
        return len({(g, *own) for g, own in zip(groups, kept, strict=True)})

    differ = [one for one in (held, plain, ends) if apart(one) == apart(held)]
    named = len({*groups}) == len(rows) and not any(g.isdigit() for g in groups)
    alone: list[list[str]] = [[] for _ in rows]
    kept = next(filter(fits, differ), alone if named else differ[-1])
    texts = zip(groups, map(", ".join, kept), strict=True)
    return [f"{g}: {short(text, room - len(g) - 2)}" if text else g for g, text in texts], ", ".join(shared)


def summary_figure(rows: Sequence[Row], examples: Sequence[Example], legend: Sequence[Artist]) -> Figure:
    """Error in every group above one or two examples.

    Parameters
    ----------
    rows : sequence of Row
        May be empty.
    examples : one or two of Example
    legend : sequence of artists
    """
    with figure_style():
        upper, lower = 0.95 + 0.24 * (len(rows) + bool(rows and row_names(rows)[1])), 2.85
        figure = Figure(figsize=(WIDTH + 0.2, (upper if rows else 0.0) + lower), layout="constrained")
        below: Any = figure
        if rows:  # neither sets the other's margins
            above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[upper, lower])[:, 0]
            above.suptitle("Typical factor between prediction and reading", fontsize=10)
            draw_factors(above.subplots(), rows)
        panels = below.subplots(1, len(examples), squeeze=False)[0]
        for column, (axes, e) in enumerate(zip(panels, examples, strict=True)):
            draw_curves(axes, e.group, e.sweep, e.curves, small=len(examples) > 1, view=e.view)
            axes.set_title(e.title, color=PALETTE[e.color])
            axes.set_xlabel(
                {"frequency": "Frequency (Hz)", "amplitude": "Amplitude (V)", "time": AXIS["time"]}.get(
                    e.sweep.variable, "Reading"
                )
            )
            if column == 0 or e.label != examples[0].label:
                axes.set_ylabel(e.label)
        zeros = zero_mark((e.group, e.curves) for e in examples)
        entries = [*legend, *handles([], measured=False, zeros=zeros)]
        long = sum(len(str(e.get_label())) for e in entries) > 44  # no line holds more
        below.legend(handles=entries, loc="outside lower center", ncols=2 if long else len(entries), columnspacing=1.1)
    return figure

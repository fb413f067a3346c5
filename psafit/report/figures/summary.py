"""The picture of the first screen: what was fitted, and does it predict what it never saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

from psafit.records import GroupScore
from psafit.report.figures.axes import label
from psafit.report.figures.groups import ROLE_COLOR, ROLE_MARKER, ROLE_TEXT, draw_group, short
from psafit.report.figures.sweep import Sweep
from psafit.report.style import MEASURED, PALETTE, WIDTH, figure_style

if TYPE_CHECKING:
    from psafit.validate import Prediction

_FACTORS = (1.0, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0, 1000.0)


def _dots(axes: Axes, scores: Sequence[GroupScore], sweeps: Sequence[Sweep]) -> None:
    rows = np.arange(len(scores))
    for row, s in zip(rows, scores, strict=True):
        color = ROLE_COLOR[s.role]
        axes.plot([0, s.log_rmse], [row, row], color=color, lw=1.6, alpha=0.45, zorder=2)
        axes.plot(s.log_rmse, row, ROLE_MARKER[s.role], color=color, ms=6.5, zorder=3)
        axes.annotate(
            f"×{math.exp(s.log_rmse):.2f}", (s.log_rmse, row), (7, 0), textcoords="offset points", va="center",
            fontsize=9.5, color=PALETTE["ink"],
        )  # fmt: skip
    names = [f"{short(s.group)}: {w.condition}" for s, w in zip(scores, sweeps, strict=True)]
    axes.yaxis.set_major_locator(FixedLocator(list(rows)))
    axes.yaxis.set_major_formatter(FixedFormatter([label(n, 24) for n in names]))
    axes.set_ylim(len(scores) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    right = 1.22 * max(max(s.log_rmse for s in scores), 0.05)
    axes.set_xlim(0, right)
    axes.set_xlabel("log RMSE (0 = perfect)")
    above = axes.secondary_xaxis("top")
    inside = [f for f in _FACTORS if math.log(f) < right]
    shown = [f for i, f in enumerate(inside) if all(math.log(g / f) > 0.17 * right for g in inside[i + 1 :])]
    above.xaxis.set_major_locator(FixedLocator([math.log(f) for f in shown]))
    above.xaxis.set_major_formatter(FixedFormatter([f"×{f:g}" for f in shown]))
    above.xaxis.set_minor_locator(NullLocator())


def summary_figure(
    scores: Sequence[GroupScore], sweeps: Sequence[Sweep], examples: Sequence[tuple[Prediction, Sweep]]
) -> Figure:
    """Score of every group above one or two examples.

    Parameters
    ----------
    scores : sequence of GroupScore
    sweeps : sequence of Sweep
        Of the same groups.
    examples : one or two (Prediction, Sweep)
        A fitted group, and one the fit never saw where there is one.
    """
    with figure_style():
        upper, lower = 0.95 + 0.24 * len(scores), 2.85
        figure = Figure(figsize=(WIDTH + 0.2, upper + lower), layout="constrained")
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[upper, lower])[
            :, 0
        ]  # neither sets the other's margins
        above.suptitle("Typical factor between prediction and reading", fontsize=10)
        _dots(above.subplots(), scores, sweeps)
        for column, (axes, (p, sweep)) in enumerate(
            zip(below.subplots(1, len(examples), squeeze=False)[0], examples, strict=True)
        ):
            draw_group(axes, p, sweep, small=len(examples) > 1)
            axes.set_title(f"Group {short(p.group.id)}", color=ROLE_COLOR[p.role])
            axes.set_xlabel(
                {"frequency": "Frequency (Hz)", "amplitude": "Amplitude (V)"}.get(sweep.variable, "Reading")
            )
            if column == 0:
                axes.set_ylabel("Launch range (µm)")
        handles = [Line2D([], [], **MEASURED, label="measured")] + [
            Line2D([], [], color=ROLE_COLOR[r], marker=ROLE_MARKER[r], ms=5.5, lw=1.5, label=ROLE_TEXT[r])
            for r in ("fit", "holdout")
            if any(s.role == r for s in scores)
        ]
        below.legend(handles=handles, loc="outside lower center", ncols=len(handles), columnspacing=1.1)
    return figure

"""One group of readings against its prediction: ranges, residuals, calibration."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

from psafit.arrays import FloatArray
from psafit.experiment import Conditions, Group
from psafit.report.figures.axes import label, range_label, reading_label, scale_sweep
from psafit.report.figures.curves import ROLE_COLOR, Curve, draw_curves, envelope, handles, magnified, zero_mark
from psafit.report.figures.sweep import NBSP, Sweep
from psafit.report.style import BAND, PALETTE, WIDTH, figure_style, new_figure

if TYPE_CHECKING:
    from psafit.validate import Prediction


ROLE_MARKER: Final = {"fit": "o", "holdout": "s"}
ROLE_TEXT: Final = {"fit": "fitted", "holdout": "not seen by the fit"}


def short(group_id: object, room: int = 14) -> str:
    """Name of a group, the middle left out where it is long: names of one experiment differ at their ends."""
    name = str(group_id)
    return name if len(name) <= room else f"{name[: room // 2 - 1]}…{name[-(room - room // 2) :]}"


def titled(group_id: object, room: int = 14) -> str:
    """A group at the head of a figure: a number needs the word before it, a name leaves no room for it."""
    name = str(group_id)
    return f"Group {name}" if len(name) <= 6 else short(name, room)


def title(axes: Axes, group_id: object, condition: str, role: str | None = None) -> None:
    """Title of at most two lines: the group and what is held; below it the role, in the role's colour."""
    text = f"{titled(group_id, 18)}: {condition}"
    text = text.replace(" = ", f"{NBSP}={NBSP}")  # a changed constant stays in one piece
    lines = textwrap.wrap(text, 36, max_lines=2, placeholder="…", break_on_hyphens=False)
    axes.set_title("\n".join(map(label, lines)), pad=20 if role else None)
    if role:
        axes.annotate(
            ROLE_TEXT[role], (0, 1), (0, 5), xycoords="axes fraction", textcoords="offset points",
            color=PALETTE[ROLE_COLOR[role]], fontsize=10, va="bottom",
        )  # fmt: skip


def group_figure(group: Group, sweep: Sweep, curves: Sequence[Curve], role: str | None = None) -> Figure:
    """Readings of a group, of one observable, against what models say.

    Parameters
    ----------
    group : Group
    sweep : Sweep
    curves : sequence of Curve
    role : {"fit", "holdout"}, optional
        Said in the title; without it the figure has no legend, which the page gives once for all.
    """
    with figure_style():
        figure, axes = new_figure(height=3.55 if role else 2.75)
        draw_curves(axes, group, sweep, curves)
        title(axes, group.id, sweep.condition, role)
        axes.set_xlabel(sweep.label)
        axes.set_ylabel(range_label(group))
        if role:
            entries = handles(curves, zeros=zero_mark([(group, curves)]))
            figure.legend(handles=entries, loc="outside lower center", ncols=2, columnspacing=1.2)
    return figure


def groups_figure(groups: Sequence[Conditions], sweeps: Sequence[Sweep], curves: Sequence[Sequence[Curve]]) -> Figure:
    """All groups side by side, three in a row: a picture that stands alone.

    Curves that lie on one another are drawn against the first.
    """
    columns = min(len(groups), 3)
    rows = math.ceil(len(groups) / columns)
    with figure_style():
        figure = Figure(figsize=(3.7 * columns + 0.3, 2.9 * rows + 0.4), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False, gridspec_kw={"hspace": 0.06}).ravel()
        for axes, group, sweep, drawn in zip(panels, groups, sweeps, curves, strict=False):
            shown, lines, view, over = magnified(group, drawn)
            draw_curves(axes, shown, sweep, lines, small=True, view=view)
            title(axes, group.id, sweep.condition)
            axes.set_xlabel(sweep.label)
            axes.set_ylabel(reading_label(group, over and "first model"))
        for axes in panels[len(groups) :]:
            axes.remove()
        measured = any(isinstance(group, Group) for group in groups)
        zeros = zero_mark(zip(groups, curves, strict=True))
        entries = handles(curves[0], measured=measured, zeros=zeros, room=64)
        # A letter of the legend takes a sixteenth of an inch, and a handle as much as six.
        fitting = int(16 * figure.get_figwidth() / (6 + max(len(str(e.get_label())) for e in entries)))
        figure.legend(handles=entries, loc="outside lower center", ncols=min(max(fitting, 1), 5))
    return figure


_FACTORS: Final = (
    (0.25, (0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.15, 1.2, 1.25)),
    (0.6, (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6, 1.8)),
    (1.6, (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)),
    (2.4, (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)),
    (3.7, (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)),
    (7.0, (0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)),
    (math.inf, (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9)),
)


def residual_view(errors: Sequence[FloatArray], reach: float = 4.0) -> tuple[float, float]:
    """Limits of the common axis of all residual figures: `reach` times what 90 % of the points keep to."""
    every = np.concatenate(list(errors))
    far = reach * float(np.quantile(np.abs(every), 0.9))
    low, high = max(float(every.min()), -far), min(float(every.max()), far)
    least = 0.5 * max(-low, high, 0.1)  # no side so narrow that the zero line is the frame
    return 1.08 * min(low, -least), 1.08 * max(high, least)


def residual_figure(
    p: Prediction,
    sweep: Sweep,
    error: FloatArray,
    band: tuple[FloatArray, FloatArray],
    others: Sequence[tuple[Sweep, FloatArray]],
    view: tuple[float, float],
) -> Figure:
    """Logarithmic error of a group, the other groups of the same variable behind it.

    Parameters
    ----------
    p : Prediction
    sweep : Sweep
        Of its group.
    error : (n_points,) array
        ``ln((predicted + offset)/(measured + offset))``.
    band : two (n_points,) arrays
        The same for the ends of the 90 % predictive interval.
    others : sequence of (Sweep, array)
        Sweeps of the same variable, with their errors.
    view : (float, float)
        Limits of the axis, common to all groups.
    """
    with figure_style():
        figure, axes = new_figure(height=2.5)
        at, low, high = envelope(sweep.values, *band)
        color = PALETTE[ROLE_COLOR[p.role]]
        if at.size > 1:
            axes.fill_between(at, np.maximum(low, 2 * view[0]), np.minimum(high, 2 * view[1]), color=color, **BAND)
        for other, values in others:
            order = np.argsort(other.values, kind="stable")
            order = order[other.values[order] > 0] if sweep.log else order
            axes.plot(other.values[order], values[order], color=PALETTE["grey"], lw=0.7, alpha=0.55, zorder=1.5)
        axes.axhline(0.0, color=PALETTE["ink"], lw=0.9, zorder=2)
        order = np.argsort(sweep.values, kind="stable")
        line = 0.0 if sweep.variable == "order" else 1.0
        axes.plot(sweep.values[order], error[order], color=color, lw=line, marker=ROLE_MARKER[p.role], ms=2.7, zorder=3)
        for beyond, mark, edge in ((error > view[1], "^", view[1]), (error < view[0], "v", view[0])):
            at = sweep.values[beyond]
            axes.plot(at, np.full(at.size, edge), mark, color=color, ms=5, clip_on=False, zorder=4)
        every = np.concatenate([sweep.values, *(other.values for other, _ in others)])
        every = every[every > 0] if sweep.log else every
        scale_sweep(axes, sweep, float(every.min()), float(every.max()))
        factors = next(ticks for until, ticks in _FACTORS if max(-view[0], view[1]) <= until)
        kept = [f for f in factors if view[0] <= math.log(f) <= view[1]]
        axes.yaxis.set_major_locator(FixedLocator([math.log(f) for f in kept]))
        axes.yaxis.set_major_formatter(FixedFormatter([f"×{f:g}" for f in kept]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(*view)
        title(axes, p.group.id, sweep.held, p.role)
        axes.set_xlabel(sweep.label)
        axes.set_ylabel("Predicted/measured")
    return figure


def pit_figure(p: Prediction, sweep: Sweep, pit: FloatArray, band: tuple[float, float], bins: int) -> Figure:
    """Histogram of a group's probability integral transforms.

    Parameters
    ----------
    p : Prediction
    sweep : Sweep
    pit : (n,) array
        Of the readings.
    band : (float, float)
        Where 90 % of the counts of a bin fall if the prediction is honest.
    bins : int
    """
    with figure_style():
        figure, axes = new_figure(width=WIDTH, height=2.4)
        color = PALETTE[ROLE_COLOR[p.role]]
        counts, _, _ = axes.hist(pit, bins=bins, range=(0.0, 1.0), color=color, alpha=0.65, rwidth=0.92)
        axes.axhspan(*band, color=PALETTE["ink"], alpha=0.11, lw=0, zorder=2)
        axes.axhline(pit.size / bins, color=PALETTE["ink"], lw=0.9, ls="--", zorder=2.5)
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1.12 * max(float(np.max(np.asarray(counts))), band[1], 1.0))
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        title(axes, p.group.id, sweep.held, p.role)
        axes.set_xlabel("Predicted probability of a smaller reading")
        axes.set_ylabel("Readings")
    return figure

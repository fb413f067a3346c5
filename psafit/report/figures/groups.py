"""One group of readings against its prediction: ranges, residuals, calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator
from numpy.typing import NDArray

from psafit.report.figures.axes import label, reading_range, scale_axis, widened
from psafit.report.figures.sweep import Sweep
from psafit.report.style import MEASURED, PALETTE, WIDTH, figure_style, new_figure

if TYPE_CHECKING:
    from psafit.validate import Prediction

FloatArray = NDArray[np.float64]

ROLE_COLOR: Final = {"fit": PALETTE["blue"], "holdout": PALETTE["vermillion"]}
ROLE_MARKER: Final = {"fit": "o", "holdout": "s"}
ROLE_TEXT: Final = {"fit": "fitted", "holdout": "not seen by the fit"}

_MODEL_BAND: Final[dict[str, Any]] = {"alpha": 0.42, "linewidth": 0.0, "zorder": 1.5}
_READING_BAND: Final[dict[str, Any]] = {"alpha": 0.17, "linewidth": 0.0, "zorder": 1}


def short(group_id: object, room: int = 14) -> str:
    """Name of a group, the middle left out where it is long: names of one experiment differ at their ends."""
    name = str(group_id)
    return name if len(name) <= room else f"{name[: room // 2 - 1]}…{name[-(room - room // 2) :]}"


def title(axes: Axes, group_id: object, sweep: Sweep, role: str) -> None:
    """Title in two lines: the group and what is held; its role in the role's colour."""
    axes.set_title(label(f"Group {short(group_id, 20)}: {sweep.condition}"), pad=20)
    axes.annotate(
        ROLE_TEXT[role], (0, 1), (0, 5), xycoords="axes fraction", textcoords="offset points",
        color=ROLE_COLOR[role], fontsize=10, va="bottom",
    )  # fmt: skip


def _envelope(x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Band over ascending distinct x; replicates share the widest."""
    order = np.argsort(x, kind="stable")
    distinct, first = np.unique(x[order], return_index=True)
    return distinct, np.minimum.reduceat(low[order], first), np.maximum.reduceat(high[order], first)


def draw_readings(axes: Axes, x: FloatArray, measured: FloatArray, bottom: float, *, log: bool, **look: Any) -> None:
    """Readings as circles; zeros, where a logarithmic axis has none, as triangles at its end."""
    look = {**MEASURED, **look}
    shown = measured > 0 if log else np.ones(measured.size, dtype=bool)
    axes.plot(x[shown], measured[shown], **look)
    if not shown.all():
        zeros = x[~shown]
        axes.plot(zeros, np.full(zeros.size, bottom), **{**look, "marker": "v", "clip_on": False})


def draw_group(axes: Axes, p: Prediction, sweep: Sweep, *, small: bool = False) -> None:
    """Readings, predicted median and both bands into given axes."""
    measured = p.group.launch_range_um
    x, color = sweep.values, ROLE_COLOR[p.role]
    bottom, top, log = reading_range(measured, p.median, p.upper)
    if len(np.unique(x)) == 1:  # a band needs a width: bars instead
        for low, high, look in ((p.lower, p.upper, _READING_BAND), (p.model_lower, p.model_upper, _MODEL_BAND)):
            axes.vlines(x, low, high, color=color, lw=9, alpha=look["alpha"])
        axes.plot(x, p.median, "_", ms=11, mew=2, color=color, zorder=2)
    else:
        for low, high, look in ((p.lower, p.upper, _READING_BAND), (p.model_lower, p.model_upper, _MODEL_BAND)):
            at, floor, ceiling = _envelope(x, low, high)
            axes.fill_between(at, np.maximum(floor, bottom), np.maximum(ceiling, bottom), color=color, **look)
        at, _, middle = _envelope(x, p.median, p.median)
        axes.plot(at, np.maximum(middle, bottom) if log else middle, color=color, lw=1.5, zorder=2)
    if p.group.sigma_um is not None:
        sigma = p.group.sigma_um
        shown = measured > 0 if log else np.ones(measured.size, dtype=bool)
        foot = np.minimum(sigma, measured - bottom) if log else np.minimum(sigma, measured)
        axes.errorbar(
            x[shown], measured[shown], np.maximum([foot[shown], sigma[shown]], 0.0), fmt="none",
            ecolor=PALETTE["ink"], elinewidth=0.7, zorder=2.5,
        )  # fmt: skip
    look = {"markersize": 3.0, "markeredgewidth": 0.7} if small else {}
    draw_readings(axes, x, measured, bottom, log=log, **look)
    scale_axis(axes, "y", bottom, top, log=log)
    _scale_x(axes, sweep, few=small)


def _scale_x(axes: Axes, sweep: Sweep, low: float | None = None, high: float | None = None, few: bool = False) -> None:
    low = float(sweep.values.min()) if low is None else low
    high = float(sweep.values.max()) if high is None else high
    scale_axis(axes, "x", *widened(low, high, 0.03, log=sweep.log), log=sweep.log, few=few)
    if sweep.variable == "order":
        ticks = MaxNLocator(5, integer=True).tick_values(low, high + 1)
        axes.xaxis.set_major_locator(FixedLocator([t for t in ticks if low <= t <= high and t == int(t)]))


def group_figure(p: Prediction, sweep: Sweep) -> Figure:
    """Measured launch ranges of a group against the prediction.

    Parameters
    ----------
    p : Prediction
    sweep : Sweep
        Of its group.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    with figure_style():
        figure, (axes,) = new_figure(height=3.55)
        draw_group(axes, p, sweep)
        title(axes, p.group.id, sweep, p.role)
        axes.set_xlabel(sweep.label)
        axes.set_ylabel("Launch range (µm)")
        color = ROLE_COLOR[p.role]
        handles: list[Any] = [
            Line2D([], [], **MEASURED, label="measured"),
            Line2D([], [], color=color, lw=1.5, label="predicted median"),
            Patch(color=color, alpha=0.6, lw=0, label="90 %: the model"),
            Patch(color=color, alpha=0.17, lw=0, label="90 %: a reading"),
        ]
        if axes.get_yscale() == "log" and bool((p.group.launch_range_um == 0).any()):
            handles.insert(1, Line2D([], [], **{**MEASURED, "marker": "v"}, label="measured: zero"))
        figure.legend(handles=handles, loc="outside lower center", ncols=2, columnspacing=1.2)
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


def residual_view(errors: Sequence[FloatArray]) -> tuple[float, float]:
    """Limits of the common axis of all residual figures."""
    low, high = min(float(np.min(e)) for e in errors), max(float(np.max(e)) for e in errors)
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
        ``ln((predicted + 0.3 um)/(measured + 0.3 um))``.
    band : two (n_points,) arrays
        The same for the ends of the 90 % predictive interval.
    others : sequence of (Sweep, array)
        Sweeps of the same variable, with their errors.
    view : (float, float)
        Limits of the axis, common to all groups.
    """
    with figure_style():
        figure, (axes,) = new_figure(height=2.5)
        at, low, high = _envelope(sweep.values, *band)
        color = ROLE_COLOR[p.role]
        if at.size > 1:
            axes.fill_between(
                at, np.maximum(low, 2 * view[0]), np.minimum(high, 2 * view[1]), color=color, **_READING_BAND
            )
        for other, values in others:
            order = np.argsort(other.values, kind="stable")
            order = order[other.values[order] > 0] if sweep.log else order
            axes.plot(other.values[order], values[order], color=PALETTE["grey"], lw=0.7, alpha=0.55, zorder=1.5)
        axes.axhline(0.0, color=PALETTE["ink"], lw=0.9, zorder=2)
        order = np.argsort(sweep.values, kind="stable")
        axes.plot(sweep.values[order], error[order], color=color, lw=1.0, marker=ROLE_MARKER[p.role], ms=2.7, zorder=3)
        every = np.concatenate([sweep.values, *(other.values for other, _ in others)])
        every = every[every > 0] if sweep.log else every
        _scale_x(axes, sweep, float(every.min()), float(every.max()))
        factors = next(ticks for until, ticks in _FACTORS if max(-view[0], view[1]) <= until)
        kept = [f for f in factors if view[0] <= math.log(f) <= view[1]]
        axes.yaxis.set_major_locator(FixedLocator([math.log(f) for f in kept]))
        axes.yaxis.set_major_formatter(FixedFormatter([f"×{f:g}" for f in kept]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.set_ylim(*view)
        title(axes, p.group.id, sweep, p.role)
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
        Of the readings above zero.
    band : (float, float)
        Where 90 % of the counts of a bin fall if the prediction is honest.
    bins : int
    """
    with figure_style():
        figure, (axes,) = new_figure(width=WIDTH, height=2.4)
        color = ROLE_COLOR[p.role]
        counts, _, _ = axes.hist(pit, bins=bins, range=(0.0, 1.0), color=color, alpha=0.65, rwidth=0.92)
        axes.axhspan(*band, color=PALETTE["ink"], alpha=0.11, lw=0, zorder=2)
        axes.axhline(pit.size / bins, color=PALETTE["ink"], lw=0.9, ls="--", zorder=2.5)
        axes.set_xlim(0, 1)
        axes.set_ylim(0, 1.12 * max(float(np.max(np.asarray(counts))), band[1], 1.0))
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        title(axes, p.group.id, sweep, p.role)
        axes.set_xlabel("Predicted probability of a smaller reading")
        axes.set_ylabel("Readings")
    return figure

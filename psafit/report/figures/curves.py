"""The curves of one group: readings, and what models say of them, for a picture or for the page to explore."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from psafit.arrays import FloatArray
from psafit.experiment import Conditions, Group
from psafit.report.figures.axes import (
    label,
    range_label,
    reading_range,
    scale_axis,
    scale_sweep,
    shown_unit,
    widened,
)
from psafit.report.figures.sweep import Sweep
from psafit.report.style import MEASURED, PALETTE

if TYPE_CHECKING:
    from psafit.validate import Prediction


ROLE_COLOR: Final = {"fit": "blue", "holdout": "vermillion"}
MODEL_BAND: Final = "90 % of the model"
READING_BAND: Final = "90 % of readings"
_ALPHA: Final = {MODEL_BAND: 0.42, READING_BAND: 0.17}
DASHES: Final = (0, (4, 2))
_WITHOUT: Final = ("green", "purple", "orange", "sky")


@dataclass(frozen=True, eq=False)
class Band:
    """A central 90 % interval about a curve; arrays (n_points,) in the unit and order of its readings."""

    name: str
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class Curve:
    """What one model says of a group.

    Parameters
    ----------
    name : str
    color : str
        A name of `psafit.report.style.PALETTE`.
    middle : (n_points,) array
        In the unit and order of the group's readings.
    bands : tuple of Band
        The widest first.
    dashed : bool
    line : pair of (n,) arrays, optional
        Swept values, ascending, and what it says there: the same between the readings, too.
    """

    name: str
    color: str
    middle: FloatArray
    bands: tuple[Band, ...] = ()
    dashed: bool = False
    line: tuple[FloatArray, FloatArray] | None = None


def curve_of(p: Prediction) -> Curve:
    """A posterior prediction as a curve whose colour says its role."""
    bands = (Band(READING_BAND, p.lower, p.upper), Band(MODEL_BAND, p.model_lower, p.model_upper))
    return Curve("predicted median", ROLE_COLOR[p.role], p.median, bands)


def without_curves(
    without: Mapping[str, FloatArray],
    titles: Mapping[str, str],
    lines: Mapping[str, tuple[FloatArray, FloatArray] | None] = MappingProxyType({}),
) -> list[Curve]:
    """Curves of a model with one cause, by identifier, taken out; `lines` as of `Curve`."""
    looks = itertools.cycle((color, dashed) for dashed in (False, True) for color in _WITHOUT)
    return [
        Curve(f"without: {titles.get(id, id)}", color, ranges, dashed=dashed, line=lines.get(id))
        for (id, ranges), (color, dashed) in zip(without.items(), looks, strict=False)
        if np.isfinite(ranges).all()  # no likelihood has judged a model without one of its causes
    ]


def envelope(x: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Band over ascending distinct x; replicates share the widest."""
    order = np.argsort(x, kind="stable")
    distinct, first = np.unique(x[order], return_index=True)
    return distinct, np.minimum.reduceat(low[order], first), np.maximum.reduceat(high[order], first)


def band_of(curve: Curve, band: Band, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A band with its places, ascending; where its curve is a line, as far from it between readings as at them."""
    at, low, high = envelope(x, band.low, band.high)
    if curve.line is None:
        return at, low, high
    between, um = curve.line
    middle = np.interp(at, between, um)
    some = middle > 0
    both = np.interp(between, at, some.astype(float)) == 1.0  # readings on either side that the curve reaches

    def along(end: FloatArray) -> FloatArray:
        ratio = np.interp(between, at, end / np.where(some, middle, 1.0))
        return np.where(both, um * ratio, np.interp(between, at, end))

    return between, along(low), along(high)


def readings_of(group: Conditions) -> FloatArray:
    """What was read; nothing of a planned group."""
    return group.reading if isinstance(group, Group) else np.empty(0)


def draw_readings(axes: Axes, x: FloatArray, measured: FloatArray, bottom: float, *, log: bool, **look: Any) -> None:
    """Readings as circles; zeros, where a logarithmic axis has none, as triangles at its end."""
    look = {**MEASURED, **look}
    shown = measured > 0 if log else np.ones(measured.size, dtype=bool)
    axes.plot(x[shown], measured[shown], **look)
    if not shown.all():
        zeros = x[~shown]
        axes.plot(zeros, np.full(zeros.size, bottom), **{**look, "marker": "v", "clip_on": False})


View = tuple[float, float, bool]
"""Lower and upper end of a picture, and whether its axis is logarithmic."""


def view_of(group: Conditions, curves: Sequence[Curve]) -> View:
    """What a picture of a group shows: see `reading_range`."""
    measured = readings_of(group)
    lines = [c.line[1] for c in curves if c.line is not None]
    middles = np.concatenate([*(c.middle for c in curves), *lines]) if curves else measured
    tops = np.concatenate([c.bands[0].high if c.bands else c.middle for c in curves]) if curves else measured
    if group.time_us is not None:
        every = np.concatenate([measured, middles])
        return *widened(float(every.min()), float(every.max()), 0.08, log=False), False
    return reading_range(measured, middles, tops)


def magnified(
    group: Conditions, curves: Sequence[Curve], least: float = 0.1
) -> tuple[Conditions, Sequence[Curve], View | None, str]:
    """Readings and curves against the first curve, if the others lie within a part `least` of the height of it.

    Returns
    -------
    group, curves, view, name
        The view is that of such a picture, and the name the first curve's; None and empty where all stays as it is.
    """
    positive = all((values > 0).all() for values in (readings_of(group), *(c.middle for c in curves)))
    if len(curves) < 2 or not (positive or group.time_us is not None) or apart(group, curves) >= least:
        return group, curves, None, ""
    group, moved = relative(group, curves)
    return group, moved, relative_view(group, moved), curves[0].name


def apart(group: Conditions, curves: Sequence[Curve]) -> float:
    """How far curves lie from the first at most, as a part of the height of their picture."""
    bottom, top, log = view_of(group, curves)
    height = math.log(top / bottom) if log else top - bottom
    first, *others = (np.maximum(c.middle, bottom) for c in curves)
    gaps = (np.log(c / first) if log else c - first for c in others)
    return max((float(np.abs(gap).max()) for gap in gaps), default=0.0) / height


def relative(group: Conditions, curves: Sequence[Curve]) -> tuple[Conditions, list[Curve]]:
    """Readings and curves over the first curve, which has to be positive; of a trace their differences from it."""
    first = curves[0]
    traced = group.time_us is not None

    def against(values: FloatArray, base: FloatArray) -> FloatArray:
        return values - base if traced else values / base

    def moved(c: Curve) -> Curve:
        bands = tuple(Band(b.name, against(b.low, first.middle), against(b.high, first.middle)) for b in c.bands)
        line = None
        if c.line and first.line and np.array_equal(c.line[0], first.line[0]) and (traced or (first.line[1] > 0).all()):
            line = c.line[0], against(c.line[1], first.line[1])
        return replace(c, middle=against(c.middle, first.middle), bands=bands, line=line)

    sigma = group.sigma if group.sigma is None or traced else group.sigma / first.middle
    group = replace(group, sigma=sigma)
    if isinstance(group, Group):
        group = replace(group, reading=against(group.reading, first.middle))
    return group, [moved(c) for c in curves]


def relative_view(group: Conditions, curves: Sequence[Curve]) -> View:
    """What a picture of that shows: readings and curves; bands may leave it."""
    log = group.time_us is None
    every = np.concatenate([readings_of(group), *(c.middle for c in curves)])
    return *widened(float(every.min()), float(every.max()), 0.25, log=log), log


def draw_curves(
    axes: Axes,
    group: Conditions,
    sweep: Sweep,
    curves: Sequence[Curve],
    *,
    small: bool = False,
    view: View | None = None,
) -> None:
    """Readings, if there are any, models and their bands into given axes, which are scaled to them or to a view."""
    measured, x = readings_of(group), sweep.values
    bottom, top, log = view or view_of(group, curves)
    single = len(np.unique(x)) == 1
    # Where nothing varies steadily, each reading has a piece of its own: a slope between two would suggest a trend.
    between: Any
    drawn, between = ("steps-mid", "mid") if sweep.variable == "order" else ("default", None)
    for place, curve in enumerate(curves):
        color = PALETTE[curve.color]
        for band in curve.bands:
            alpha = _ALPHA[band.name]
            if single:  # a band needs a width: bars instead
                axes.vlines(x, band.low, band.high, color=color, lw=9, alpha=alpha)
                continue
            at, floor, ceiling = band_of(curve, band, x)
            floor, ceiling = np.maximum(floor, bottom), np.maximum(ceiling, bottom)
            axes.fill_between(at, floor, ceiling, step=between, color=color, alpha=alpha, linewidth=0.0, zorder=1)
        if single:
            axes.plot(x, curve.middle, "_", ms=11, mew=2, color=color, zorder=2)
            continue
        at, line = curve.line or envelope(x, curve.middle, curve.middle)[::2]
        look: dict[str, Any] = {"color": color, "zorder": 2 + 0.1 * place}
        if log:
            # No launch breaks the line: at the foot of the axes it would read as a small range.
            none = np.unique(x[curve.middle <= 0])
            if none.size:
                axes.plot(none, np.full(none.size, bottom), "v", ms=3.0 if small else 4.5, clip_on=False, **look)
            line = np.where(line > 0, line, np.nan)
        axes.plot(at, line, lw=1.6, ls=DASHES if curve.dashed else "-", drawstyle=drawn, **look)
        if not measured.size:  # where a plan will read
            axes.plot(x, np.where(curve.middle > 0, curve.middle, np.nan) if log else curve.middle, ".", ms=5, **look)
    if isinstance(group, Group) and group.sigma is not None:
        shown = measured > 0 if log else np.ones(measured.size, dtype=bool)
        foot = np.minimum(group.sigma, measured - bottom if log else measured)
        axes.errorbar(
            x[shown], measured[shown], np.maximum([foot[shown], group.sigma[shown]], 0.0), fmt="none",
            ecolor=PALETTE["ink"], elinewidth=0.7, zorder=2.5,
        )  # fmt: skip
    if measured.size:
        dense = sweep.variable == "time"  # samples stand close together
        look = {"markersize": 2.0 if dense else 3.0, "markeredgewidth": 0.7} if small or dense else {}
        draw_readings(axes, x, measured, bottom, log=log, **look)
    scale_axis(axes, "y", bottom, top, log=log)
    scale_sweep(axes, sweep, few=small)


def has_zeros(group: Conditions, curves: Sequence[Curve]) -> bool:
    """Whether readings or curves hold zeros, which logarithmic axes show at their foot."""
    return bool(zero_mark([(group, curves)]))


def zero_mark(drawn: Iterable[tuple[Conditions, Sequence[Curve]]]) -> list[Artist]:
    """What a legend says of the zeros of some groups: the mark of a reading, or of a curve where no reading is zero."""
    from matplotlib.lines import Line2D

    looks: list[dict[str, Any]] = []
    for group, curves in drawn:
        if view_of(group, curves)[2]:
            if (readings_of(group) == 0).any():
                looks.insert(0, {**MEASURED, "marker": "v"})
            looks += [{"color": PALETTE[c.color], "marker": "v", "ls": "none"} for c in curves if (c.middle == 0).any()]
    return [Line2D([], [], label="zero", **{"markersize": MEASURED["markersize"], **look}) for look in looks[:1]]


def handles(
    curves: Sequence[Curve], *, measured: bool = True, zeros: Sequence[Artist] = (), room: int = 28
) -> list[Artist]:
    """What a legend says of readings, zeros (`zero_mark`) and curves; bands of the first curve only.

    A curve's name is cut to `room` letters.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found: list[Artist] = [Line2D([], [], **MEASURED, label="measured")] if measured else []
    found += zeros
    found += [
        Line2D([], [], color=PALETTE[c.color], lw=1.6, ls=DASHES if c.dashed else "-", label=label(c.name, room))
        for c in curves
    ]
    # Over the other one, the inner band is darker than its own alpha.
    darker = {MODEL_BAND: 0.6, READING_BAND: 0.17}
    found += [
        Patch(color=PALETTE[curves[0].color], alpha=darker[b.name], lw=0, label=b.name)
        for b in reversed(curves[0].bands if curves else ())
    ]
    return found


def explorable(
    title: str, group: Group, sweep: Sweep, curves: Sequence[Curve], more: Sequence[Curve] = ()
) -> dict[str, Any]:
    """A group's curves as numbers for the page's script, in the sweep's order, to five digits; `more` begins hidden."""
    order = np.argsort(sweep.values, kind="stable")

    def numbers(values: FloatArray) -> list[float]:
        return [float(f"{v:.5g}") for v in values]

    def column(values: FloatArray) -> list[float]:
        return numbers(values[order])

    return {
        "title": title,
        "label": sweep.label,
        "read": group.observable.title,
        "unit": shown_unit(group.observable.unit),
        "axis": range_label(group),
        "x": column(sweep.values),
        "frequency": column(group.frequency_hz),
        "amplitude": column(group.amplitude_v),
        "measured": column(group.reading),
        "sigma": None if group.sigma is None else column(group.sigma),
        "log": [sweep.log, view_of(group, curves)[2]],
        "curves": [
            {
                "name": c.name,
                "color": c.color,
                "dashed": c.dashed,
                "off": c in more,
                "middle": column(c.middle),
                "line": None if c.line is None else [*map(numbers, c.line)],
                "bands": [
                    {"name": b.name, "low": column(b.low), "high": column(b.high)}
                    | ({} if c.line is None else {"line": [*map(numbers, band_of(c, b, sweep.values)[1:])]})
                    for b in c.bands
                ],
            }
            for c in (*curves, *more)
        ],
    }

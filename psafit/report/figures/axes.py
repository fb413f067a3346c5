"""Axes that read well whatever they span: decades, a few per cent, zeros."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from psafit.arrays import FloatArray
from psafit.experiment import Conditions
from psafit.report.figures.sweep import Sweep

SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def power_of_ten(exponent: int) -> str:
    """10 to a power, as text."""
    return f"10{str(exponent).translate(SUPERSCRIPT)}"


def _tick(value: float, *, powers: bool) -> str:
    if value == 0 or (0.1 <= abs(value) < 1e3 if powers else 1e-3 <= abs(value) < 1e5):
        return f"{value:g}".replace("-", "\N{MINUS SIGN}")
    exponent = math.floor(math.log10(abs(value)) + 1e-9)
    mantissa = value / 10.0**exponent
    return power_of_ten(exponent) if math.isclose(mantissa, 1.0) else f"{mantissa:g}·{power_of_ten(exponent)}"


def label(text: str, room: int = 42) -> str:
    """Text for a figure: its end left out where it is long, and no dollar sign, which would start a formula."""
    return (text if len(text) <= room else f"{text[: room - 1]}…").replace("$", r"\$")


def widened(low: float, high: float, share: float, *, log: bool) -> tuple[float, float]:
    """A span with a share of itself added at either end."""
    margin = (high / low) ** share if log else share * (high - low)
    return (low / margin, high * margin) if log else (low - margin, high + margin)


def scale_axis(
    axes: Axes, which: str, low: float, high: float, *, log: bool, few: bool = False, decades: float = 0.8
) -> None:
    """Scale the x or y axis from `low` to `high` with plain numbers at its ticks.

    Parameters
    ----------
    axes : Axes
    which : {"x", "y"}
    low, high : float
        Limits of the view; positive where `log`.
    log : bool
    few : bool
        Whether there is room for half as many labels only.
    decades : float
        A logarithmic axis with fewer has too few powers of ten to be read.
    """
    axis = axes.xaxis if which == "x" else axes.yaxis
    count = (5 if which == "x" else 4) - 2 * few
    if not low < high:
        low, high = (low / 1.1, high * 1.1) if log and low > 0 else (low - 0.5, high + 0.5)
    (axes.set_xscale if which == "x" else axes.set_yscale)("log" if log else "linear")
    (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)
    shown = math.log10(high / low) if log else 0.0
    if not log or shown < decades:
        places = [MaxNLocator(n, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high) for n in (count, 4 * count)]
        ticks, between = ([t for t in at if low <= t <= high] for at in places)
        axis.set_major_locator(FixedLocator(ticks))
        # Between two labels of a logarithmic axis nobody guesses a value.
        axis.set_minor_locator(FixedLocator(between) if log else NullLocator())
    elif shown < (2.0 if few else 2.6):
        close = shown < (1.2 if few else 1.6)
        axis.set_major_locator(LogLocator(10, subs=(1.0, 2.0, 5.0) if close else (1.0, 3.0), numticks=20))
        axis.set_minor_locator(LogLocator(10, subs=tuple(range(2, 10)), numticks=20))
    else:
        # Where there is little room, every other of many decades.
        axis.set_major_locator(LogLocator(10, numticks=count + (0 if few and which == "x" else 3)))
    # One way of writing along one axis: 10⁴ and 10⁵, not 10000 and 10⁵.
    powers = max(abs(low), abs(high)) >= 1e5 or bool(log and low < 2e-4)
    axis.set_major_formatter(FuncFormatter(lambda value, _: _tick(value, powers=powers)))
    axis.set_minor_formatter(NullFormatter())


def scale_sweep(
    axes: Axes, sweep: Sweep, low: float | None = None, high: float | None = None, *, few: bool = False
) -> None:
    """Scale the x axis to a sweep, or to given ends."""
    low = float(sweep.values.min()) if low is None else low
    high = float(sweep.values.max()) if high is None else high
    scale_axis(axes, "x", *widened(low, high, 0.03, log=sweep.log), log=sweep.log, few=few)
    if sweep.variable == "order":
        ticks = MaxNLocator(5, integer=True).tick_values(low, high + 1)
        axes.xaxis.set_major_locator(FixedLocator([t for t in ticks if low <= t <= high and t == int(t)]))


def reading_range(measured: FloatArray, predicted: FloatArray, upper: FloatArray) -> tuple[float, float, bool]:
    """View of readings: lower and upper limit, in their unit, and whether the axis is logarithmic.

    It is where positive readings span a factor of five or more: errors of a launch range are factors. The view
    follows the readings: a prediction may leave it at the bottom by more than a decade, or at the top by its tail.
    """
    measured = measured if measured.size else predicted  # a plan: nothing else to follow
    top = max(float(np.max(measured)), float(np.max(predicted)))
    band = min(float(np.max(upper)), 3.0 * top)
    positive = measured[measured > 1e-12 * top]
    if positive.size == 0 or float(positive.max()) < 5.0 * float(positive.min()):
        return 0.0, 1.06 * max(band, top, 1e-9), False
    least = float(positive.min())
    seen = predicted[predicted > 0]
    low = min(least, max(float(seen.min()), least / 10)) if seen.size else least
    return 0.55 * low, 1.4 * max(band, top), True


def shown_unit(unit: str) -> str:
    """A unit as a picture shows it."""
    return {"um": "µm", "us": "µs"}.get(unit, unit)


def reading_label(group: Conditions, over: str) -> str:
    """The label of an axis that shows readings over what a model says of them, or along a trace their difference."""
    if not over:
        return range_label(group)
    o, traced = group.observable, group.time_us is not None
    how = f"\N{MINUS SIGN} {over} ({shown_unit(o.unit)})" if traced else f"/ {over}"
    return f"{o.title.capitalize()} {how}"


def range_label(group: Conditions) -> str:
    """The label of an axis: what is read, and its unit."""
    return f"{group.observable.title.capitalize()} ({shown_unit(group.observable.unit)})"

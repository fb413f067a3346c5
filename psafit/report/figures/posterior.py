"""What the data say of the parameters: corner plot, chains, prior and posterior, profile likelihood."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from psafit.arrays import FloatArray
from psafit.records import ParameterEntry, ProfilePoint
from psafit.report.figures.axes import label, scale_axis, shown_unit, widened
from psafit.report.style import PALETTE, WIDTH, figure_style, new_figure


@dataclass(frozen=True)
class Marginal:
    """One parameter's prior, posterior and profile likelihood, ready to be drawn.

    Parameters
    ----------
    entry : ParameterEntry
    log : bool
        Whether its coordinate is logarithmic.
    draws : (n_draws,) array
        In the parameter's unit.
    prior_value, prior_density : (n,) arrays
        The prior's density in the coordinate, over values in the parameter's unit.
    interval, prior_interval : (float, float)
        Central 90 %.
    verdict : str
    profile : sequence of ProfilePoint
    level : float
        Drop of log likelihood at the ends of the 90 % interval.
    """

    entry: ParameterEntry
    log: bool
    draws: FloatArray
    prior_value: FloatArray
    prior_density: FloatArray
    interval: tuple[float, float]
    prior_interval: tuple[float, float]
    verdict: str
    profile: Sequence[ProfilePoint]
    level: float

    @property
    def symbol(self) -> str:
        """The symbol for matplotlib's mathtext."""
        return _mathtext(self.entry.symbol)

    @property
    def label(self) -> str:
        """Symbol and unit."""
        return axis_label(self.entry.symbol, self.entry.unit)

    def coordinate(self, value: FloatArray) -> FloatArray:
        """Common logarithm where the coordinate is logarithmic, else the value."""
        return np.log10(value) if self.log else np.asarray(value, dtype=float)


def _mathtext(symbol: str) -> str:
    """A LaTeX symbol, words upright."""
    return "$" + re.sub(r"_\{([A-Za-z]{2,})\}", r"_{\\mathrm{\1}}", symbol) + "$"


def axis_label(symbol: str, unit: str) -> str:
    """Symbol and unit of a parameter."""
    return _mathtext(symbol) + ("" if unit == "1" else f" ({shown_unit(unit)})")


def _span(values: FloatArray) -> tuple[float, float]:
    low, high = (float(q) for q in np.quantile(values, [0.002, 0.998]))
    if low == high:
        low, high = low - 0.5, high + 0.5
    return widened(low, high, 0.06, log=False)


def _inner_ticks(span: tuple[float, float]) -> FixedLocator:
    """Two ticks whose labels stay clear of the neighbouring panel's."""
    low, high = span
    room = 0.14 * (high - low)
    for count in (3, 4, 5, 7):
        ticks = [t for t in MaxNLocator(count).tick_values(low, high) if low + room <= t <= high - room]
        if len(ticks) > 1:
            break
    return FixedLocator(ticks[:: max(1, len(ticks) - 1)])


def corner_figure(marginals: Sequence[Marginal], best: Sequence[float], *, contours_from: int = 1000) -> Figure:
    """Posterior of several parameters, singly and in pairs.

    Parameters
    ----------
    marginals : sequence of Marginal
    best : sequence of float
        The best optimum, in the parameters' units.
    contours_from : int
        Fewer draws than this make a scatter plot, not contours.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # importing corner imports ArviZ, which announces its next version
        from corner import corner

    n = len(marginals)
    draws = np.column_stack([m.coordinate(m.draws) for m in marginals])
    spans = [_span(column) for column in draws.T]
    labels = [m.label if not m.log else rf"$\log_{{10}}$ {m.label}" for m in marginals]
    many = len(draws) >= contours_from
    size = max(WIDTH, 1.32 * n + 0.5)
    with figure_style():
        mpl.rcParams["figure.constrained_layout.use"] = False  # corner places its panels itself
        figure = Figure(figsize=(size, size))
        corner(
            draws, bins=28, range=spans, labels=labels, fig=figure, color=PALETTE["blue"], max_n_ticks=3,
            labelpad=0.12, smooth=0.8 if many else None, plot_contours=many, plot_density=many,
            fill_contours=many, levels=(0.5, 0.9), plot_datapoints=not many,
            label_kwargs={"fontsize": 10}, hist_kwargs={"linewidth": 1.4},
        )  # fmt: skip
        grid = np.array(figure.axes).reshape(n, n)
        marks = [float(m.coordinate(np.array(b))) for m, b in zip(marginals, best, strict=True)]
        for i, m in enumerate(marginals):
            axes = grid[i, i]
            axes.axvspan(*m.coordinate(np.array(m.prior_interval)), color=PALETTE["grey"], alpha=0.16, lw=0, zorder=0)
            axes.axvline(marks[i], color=PALETTE["vermillion"], lw=1.1)
            axes.set_xlim(*spans[i])
            for j in range(i):
                grid[i, j].plot(marks[j], marks[i], "x", color=PALETTE["vermillion"], ms=6, mew=1.6, zorder=5)
                grid[i, j].set_xlim(*spans[j])
                grid[i, j].set_ylim(*spans[i])
        for i, j in ((row, column) for row in range(n) for column in range(row + 1)):
            axes = grid[i, j]
            axes.grid(visible=False)
            if i == n - 1:
                axes.xaxis.set_label_coords(0.5, -0.2)
            if j == 0 and i > 0:
                axes.yaxis.set_label_coords(-0.42, 0.5)
            axes.xaxis.set_major_locator(_inner_ticks(spans[j]))
            if i > j:
                axes.yaxis.set_major_locator(_inner_ticks(spans[i]))
            axes.tick_params(labelsize=9, labelrotation=0)
        figure.subplots_adjust(left=0.84 / size, bottom=0.52 / size, right=1 - 0.1 / size, top=1 - 0.06 / size,
                               wspace=0.08, hspace=0.08)  # fmt: skip
    return figure


def estimates_figure(
    rows: Sequence[tuple[str, Sequence[tuple[float, float, float]]]], names: Sequence[str], colors: Sequence[str]
) -> Figure:
    """Medians and intervals of several results, each parameter on its own scale.

    Parameters
    ----------
    rows : sequence of (str, sequence of (median, lower, upper))
        Label of a parameter, and its estimate in each result.
    names, colors : sequences of str
        Of the results; colours by their names in the palette.
    """
    from matplotlib.lines import Line2D

    with figure_style():
        figure = Figure(figsize=(WIDTH, 0.62 * len(rows) + 0.5), layout="constrained")
        for axes, (text, estimates) in zip(figure.subplots(len(rows), 1, squeeze=False)[:, 0], rows, strict=True):
            ends = np.array(estimates)
            log = bool(ends.min() > 0 and ends.max() >= 3 * ends.min())
            for place, ((median, low, high), color) in enumerate(zip(estimates, colors, strict=True)):
                axes.plot([low, high], [-place] * 2, color=PALETTE[color], lw=4, alpha=0.45)
                axes.plot(median, -place, "os"[place % 2], color=PALETTE[color], ms=5)
            scale_axis(axes, "x", *widened(float(ends.min()), float(ends.max()), 0.08, log=log), log=log)
            axes.set_ylim(-len(estimates) + 0.4, 0.6)
            axes.yaxis.set_major_locator(NullLocator())
            axes.set_ylabel(text, rotation=0, ha="right", va="center")
            axes.tick_params(labelsize=8.5)
        figure.legend(
            handles=[
                Line2D([], [], color=PALETTE[c], marker="os"[k % 2], ms=5, lw=3, label=label(name, 28))
                for k, (name, c) in enumerate(zip(names, colors, strict=True))
            ],
            loc="outside upper left", ncols=len(names),
        )  # fmt: skip
    return figure


def trace_figure(
    m: Marginal, values: FloatArray, thinning: int, *, most_walkers: int = 16, most_steps: int = 600
) -> Figure:
    """Chains of one parameter; of many walkers those whose medians lie furthest out, where a stuck one would be.

    Parameters
    ----------
    m : Marginal
    values : (n_walkers, n_draws) array
        In the parameter's unit.
    thinning : int
        Steps between draws.
    most_walkers, most_steps : int
        That are drawn.
    """
    medians = np.median(m.coordinate(values), axis=1)
    furthest = np.argsort(-np.abs(medians - np.median(medians)), kind="stable")
    walkers = values[furthest[:most_walkers]]
    stride = max(1, math.ceil(values.shape[1] / most_steps))
    step = np.arange(0, values.shape[1], stride) * thinning
    with figure_style():
        figure, axes = new_figure(height=2.0)
        axes.plot(step, walkers[:, ::stride].T, lw=0.5, alpha=0.45, color=PALETTE["blue"])
        limits = widened(float(values.min()), float(values.max()), 0.04, log=m.log)
        scale_axis(axes, "y", *limits, log=m.log)
        axes.set_xlim(0, max(int(step[-1]), 1))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.set_xlabel("Step after burn-in")
        axes.set_ylabel(m.label)
    return figure


def _density_panel(axes: Axes, m: Marginal, low: float, high: float) -> None:
    """Prior and posterior, each scaled to the same height."""
    coordinate = m.coordinate(m.draws)
    counts, edges = np.histogram(coordinate, bins=40)
    at = 10.0**edges if m.log else edges
    axes.fill_between(m.prior_value, m.prior_density / m.prior_density.max(), color=PALETTE["grey"], alpha=0.25, lw=0)
    axes.plot(m.prior_value, m.prior_density / m.prior_density.max(), color=PALETTE["grey"], lw=1.1)
    axes.stairs(counts / counts.max(), at, color=PALETTE["blue"], lw=1.4, fill=False, zorder=3)
    axes.stairs(counts / counts.max(), at, color=PALETTE["blue"], alpha=0.25, lw=0, fill=True, zorder=2)
    scale_axis(axes, "x", low, high, log=m.log)
    axes.set_ylim(0, 1.35)
    axes.yaxis.set_major_locator(NullLocator())
    axes.set_ylabel("Density")
    axes.set_xlabel(m.label)


def marginal_figure(m: Marginal) -> Figure:
    """Prior and posterior of one parameter, above its profile likelihood where there is one.

    Parameters
    ----------
    m : Marginal
    """
    from matplotlib.lines import Line2D

    low = min(float(m.prior_value.min()), float(m.draws.min()))
    high = max(float(m.prior_value.max()), float(m.draws.max()))
    low, high = max(low, m.entry.lower), min(high, m.entry.upper)
    with figure_style():
        figure = Figure(figsize=(WIDTH, 3.9 if m.profile else 2.3), layout="constrained")
        panels = figure.subplots(2 if m.profile else 1, 1, squeeze=False)[:, 0]
        _density_panel(panels[0], m, low, high)
        panels[0].set_title(f"{m.symbol}: {m.verdict}")
        panels[0].legend(
            handles=[
                Line2D([], [], color=PALETTE["grey"], lw=1.6, label="prior"),
                Line2D([], [], color=PALETTE["blue"], lw=1.6, label="posterior"),
            ],
            loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.03),
        )  # fmt: skip
        if m.profile:
            _profile_panel(panels[1], m)
    return figure


def _profile_panel(axes: Axes, m: Marginal) -> None:
    value = np.array([p.value for p in m.profile])
    drop = np.array([p.drop for p in m.profile])
    top = 2.2 * m.level
    axes.axhspan(-m.level, 0.4, color=PALETTE["green"], alpha=0.10, lw=0, zorder=0)
    axes.axhline(-m.level, color=PALETTE["ink"], lw=1.0, ls="--", zorder=1)
    axes.plot(value, -drop, color=PALETTE["green"], marker="o", ms=2.2, lw=1.4, zorder=3)
    axes.annotate(
        "95 %\nlimit" if m.verdict.startswith("bounded") else "90 %\ninterval", (1, -m.level), (4, 0),
        xycoords=("axes fraction", "data"), textcoords="offset points", va="center", fontsize=9,
    )  # fmt: skip
    low, high = float(value.min()), float(value.max())
    limits = widened(low, high, 0.04, log=m.log)
    scale_axis(axes, "x", *limits, log=m.log)
    for bound in (m.entry.lower, m.entry.upper):
        if limits[0] <= bound <= limits[1]:
            axes.axvline(bound, color=PALETTE["grey"], lw=2.5, zorder=2)
            axes.annotate(
                "bound", (bound, -top), (4 if bound < high else -4, 4), textcoords="offset points", fontsize=9,
                ha="left" if bound < high else "right", color=PALETTE["grey"],
            )  # fmt: skip
    axes.set_ylim(-top, 0.25)
    axes.set_ylabel("Log likelihood\nbelow its top")
    axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    axes.yaxis.set_major_formatter(lambda v, _: f"{v:g}".replace("-", "\N{MINUS SIGN}"))
    axes.set_xlabel(f"{m.label}, enlarged")

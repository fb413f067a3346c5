"""The figures of a diagnosis with their texts: image, what is to be seen, what it means."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from psafit.diagnose.record import ScreeningResult
from psafit.experiment import Group, GroupId
from psafit.report.figures import Sweep
from psafit.report.figures.axes import label, reading_range, scale_axis, widened
from psafit.report.figures.groups import draw_readings, short
from psafit.report.figures.sweep import AXIS, SWEPT
from psafit.report.page import SVG_LIMIT, Picture, figure_data_uri
from psafit.report.style import BAND, MEASURED, PALETTE, figure_style, new_figure
from psafit.report.wording import factor, number, percent

FloatArray = NDArray[np.float64]

_MAX_SVG = 12
_BASELINE: Final[dict[str, Any]] = {"color": PALETTE["grey"], "linestyle": (0, (4, 2)), "linewidth": 1.6, "zorder": 2}
_EXTENDED: Final[dict[str, Any]] = {"color": PALETTE["vermillion"], "linewidth": 1.9, "zorder": 2.5}
_VERDICT_COLOR: Final = {
    "present": PALETTE["vermillion"],
    "explains part alone": PALETTE["orange"],
    "not present": PALETTE["grey"],
    "could not have been seen": PALETTE["sky"],
}
_HATCH: Final = {"could not have been seen": "////"}
_SYMBOL: Final = {"frequency": "f", "amplitude": "V"}


@dataclass(frozen=True)
class Shown:
    """A group with what the models say of it.

    Parameters
    ----------
    group : Group
    sweep : Sweep
    baseline, extended : (n_points,) array, um, optional
        Predictions, in the group's order.
    baseline_error, extended_error : float, optional
        Root mean square of ln((predicted + 0.3 um)/(measured + 0.3 um)).
    """

    group: Group
    sweep: Sweep
    baseline: FloatArray | None
    extended: FloatArray | None
    baseline_error: float | None
    extended_error: float | None


def _uri(figure: Figure, n: int) -> str:
    """Image of one of `n` alike: PNG, the smaller format, where there are so many that the page would be heavy."""
    return figure_data_uri(figure, svg_limit=SVG_LIMIT if n <= _MAX_SVG else 0)


def _heading(axes: Axes, group_id: GroupId, condition: str) -> None:
    axes.set_title(label(f"Group {short(group_id, 18)}: {condition}"))


def _scale_x(axes: Axes, values: FloatArray, *, log: bool) -> None:
    limits = widened(float(np.min(values)), float(np.max(values)), 0.03, log=log)
    scale_axis(axes, "x", *limits, log=log)


def _swept(sweep: Sweep) -> str:
    return SWEPT.get(sweep.variable, "the number of the reading")


def _along(sweep: Sweep, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line in the order of the abscissa."""
    order = np.argsort(sweep.values, kind="stable")
    return sweep.values[order], values[order]


def overview_pictures(shown: Sequence[Shown]) -> list[Picture]:
    """Measured against baseline and extension: small multiples, one image each so that they reflow."""
    return [_overview(g, len(shown)) for g in shown]


def _overview(g: Shown, n: int) -> Picture:
    measured, x = g.group.launch_range_um, g.sweep.values
    models = [(m, look) for m, look in ((g.baseline, _BASELINE), (g.extended, _EXTENDED)) if m is not None]
    everything = np.concatenate([m for m, _ in models]) if models else measured
    with figure_style():
        figure, (axes,) = new_figure(height=2.75)
        bottom, top, log = reading_range(measured, everything, everything)
        for model, look in models:
            at, line = _along(g.sweep, np.maximum(model, bottom) if log else model)
            if np.unique(at).size == 1:
                axes.plot(at, line, "_", ms=12, mew=2, color=look["color"])
            else:
                axes.plot(at, line, **look)
        draw_readings(axes, x, measured, bottom, log=log)
        scale_axis(axes, "y", bottom, top, log=log)
        _scale_x(axes, x, log=g.sweep.log)
        axes.set_xlabel(g.sweep.label)
        axes.set_ylabel("Launch range (µm)")
        _heading(axes, g.group.id, g.sweep.condition)
    errors = [
        f"{word} off by ×{factor(error)}"
        for word, error in (("baseline", g.baseline_error), ("extended model", g.extended_error))
        if error is not None
    ]
    alt = (
        f"Launch range against {_swept(g.sweep)}, group {g.group.id}, {g.sweep.condition}:"
        f" measured {number(float(measured.min()))} to {number(float(measured.max()))} µm"
        + (", typically " + ", ".join(errors) if errors else "")
        + "."
    )
    text = "; ".join(errors)
    caption = f"{text[:1].upper()}{text[1:]}." if errors else "Readings alone."
    return Picture(_uri(figure, n), alt, caption)


def growth_pictures(
    baseline: Sequence[Mapping[str, Any]], extended: Sequence[Mapping[str, Any]], conditions: Mapping[str, str]
) -> list[Picture]:
    """Local exponents of each sweep, measured and predicted.

    Parameters
    ----------
    baseline, extended : sequences of dict
        `psafit.diagnose.show.Growth` as a dict, in the same order; the second empty without extension.
    conditions : dict
        What each group holds, by its id as text.
    """
    rest = {str(g["group"]): g for g in extended}
    drawn = [g for g in baseline if len(g["at"]) > 0]
    return [_growth(g, rest.get(str(g["group"])), conditions.get(str(g["group"]), ""), len(drawn)) for g in drawn]


def _growth(base: Mapping[str, Any], ext: Mapping[str, Any] | None, condition: str, n: int) -> Picture:
    ext = ext if ext is not None and len(ext["at"]) > 0 else None
    seen = ext or base  # the readings weighed by the scatter of the better model
    at, lower, upper = (np.asarray(seen[k], dtype=float) for k in ("at", "lower", "upper"))
    measured = np.asarray(seen["measured"], dtype=float)
    letter = _SYMBOL[base["variable"]]
    with figure_style():
        figure, (axes,) = new_figure(height=2.75)
        axes.axhline(0.0, color=PALETTE["faint"], lw=1.0, zorder=0.5)
        axes.fill_between(at, lower, upper, color=PALETTE["ink"], **{**BAND, "alpha": 0.16})
        axes.plot(at, measured, **MEASURED)
        axes.plot(base["at"], base["simulated"], **_BASELINE)
        if ext is not None:
            axes.plot(ext["at"], ext["simulated"], **_EXTENDED)
        lines = [measured, np.asarray(base["simulated"], dtype=float)]
        lines += [np.asarray(ext["simulated"], dtype=float)] if ext is not None else []
        values = np.concatenate(lines)
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        room = 0.25 * (high - low) + 0.1
        scale_axis(axes, "y", low - room, high + room, log=False)
        _scale_x(axes, at, log=bool(at.min() > 0 and at.max() >= 3 * at.min()))
        axes.set_xlabel(AXIS[base["variable"]])
        axes.set_ylabel(f"d ln L / d ln {letter}")
        _heading(axes, base["group"], condition)
    text = f"measured {_extent(seen['measured'])}, baseline {_extent(base['simulated'])}"
    if ext is not None:
        text += f", extended {_extent(ext['simulated'])}"
    alt = f"Local exponent of the launch range against {SWEPT[base['variable']]}, group {base['group']}: {text}."
    return Picture(_uri(figure, n), alt, f"Exponent: {text}.")


def _extent(values: Sequence[float]) -> str:
    low, high = (f"{x:.2f}".replace("-", "\N{MINUS SIGN}") for x in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def screening_pictures(
    screening: Sequence[ScreeningResult], titles: Mapping[str, str], named: Sequence[str]
) -> list[Picture]:
    """What each cause gains alone, and how probable it is that it is part of the truth: two bar charts.

    Parameters
    ----------
    screening : sequence of ScreeningResult
    titles : dict
        Of causes, by id.
    named : sequence of str
        Causes that were adopted.
    """
    if not screening:
        return []
    names = [titles.get(s.id, s.id) for s in screening]
    present = [name for name, s in zip(names, screening, strict=True) if s.verdict == "present"]
    gains = _bars(
        names, [s.refit_gain for s in screening], screening, named, "Gain, refitted (nats)", _nats, None
    )  # fmt: skip
    inclusion = _bars(
        names, [s.inclusion for s in screening], screening, named, "Inclusion probability", percent, (0.0, 1.0)
    )  # fmt: skip
    return [
        Picture(
            figure_data_uri(gains),
            f"Gain of the log likelihood when the baseline is refitted with one cause: most,"
            f" {number(screening[0].refit_gain)} nats, for {names[0]}; {len(screening)} causes.",
            "What each cause alone makes of the baseline, refitted. Bold: adopted.",
        ),
        Picture(
            figure_data_uri(inclusion),
            "Inclusion probability of each cause over all models: above one half for"
            f" {', '.join(present) if present else 'none'}.",
            "Summed over all models that contain the cause. A cause may gain much alone and yet not be needed beside"
            " another one.",
        ),
    ]


def _nats(value: float) -> str:
    text = f"{value:.0f}" if abs(value) >= 100 else f"{value:.1f}"
    text = "0.0" if text == "-0.0" else text.replace("-", "\N{MINUS SIGN}")
    return text if np.isfinite(value) else "–"


def _bars(
    names: Sequence[str], values: Sequence[float], screening: Sequence[ScreeningResult], adopted: Sequence[str],
    quantity: str,
    text: Callable[[float], str],
    limits: tuple[float, float] | None,
) -> Figure:  # fmt: skip
    with figure_style():
        figure, (axes,) = new_figure(height=1.25 + 0.235 * len(names))
        at = np.arange(len(names))[::-1]
        lengths = np.nan_to_num(np.asarray(values, dtype=float))
        for word, color in _VERDICT_COLOR.items():
            mine = np.array([s.verdict == word for s in screening])
            if mine.any():
                axes.barh(
                    at[mine], lengths[mine], height=0.68, color=color, hatch=_HATCH.get(word), edgecolor="white", lw=0
                )
        low, high = limits or (min(0.0, float(lengths.min())), max(float(lengths.max()), 1.0))
        span = high - low
        for y, value, length in zip(at, values, lengths, strict=True):
            axes.annotate(
                text(float(value)), (max(float(length), 0.0), float(y)), (3, 0), textcoords="offset points",
                va="center", fontsize=8.5, color=PALETTE["ink"],
            )  # fmt: skip
        scale_axis(axes, "x", low, high + 0.22 * span, log=False, few=True)
        axes.set_ylim(-0.7, len(names) - 0.3)
        axes.set_yticks(at, [label(n, 31) for n in names], fontsize=8.5)
        for tick, s in zip(axes.get_yticklabels(), screening, strict=True):
            tick.set_fontweight("bold" if s.id in adopted else "normal")
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(quantity)
        handles = [
            Patch(facecolor=c, hatch=_HATCH.get(w), edgecolor="white", lw=0, label=w) for w, c in _VERDICT_COLOR.items()
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=3, fontsize=8, columnspacing=0.9)
    return figure


def gain_picture(protocol: str, gain: Mapping[str, Any]) -> Picture:
    """Error of each unseen group, before and after."""
    rows = gain["groups"]
    before = np.array([r["log_rmse_before"] for r in rows], dtype=float)
    after = np.array([r["log_rmse_after"] for r in rows], dtype=float)
    with figure_style():
        figure, (axes,) = new_figure(height=1.35 + 0.32 * (len(rows) + 1))
        at = np.arange(len(rows) + 1)[::-1]
        means = (float(gain["log_rmse_before"]), float(gain["log_rmse_after"]))
        b, a = np.append(before, means[0]), np.append(after, means[1])
        axes.hlines(at, np.minimum(a, b), np.maximum(a, b), color=PALETTE["faint"], lw=3, zorder=1)
        axes.plot(b, at, "s", ms=6.5, mfc="white", mec=PALETTE["grey"], mew=1.6, label="before: baseline", zorder=3)
        axes.plot(a, at, "o", ms=7, color=PALETTE["vermillion"], label="after: extended", zorder=3)
        low, high = (means[0] + float(c) for c in gain["log_rmse_interval"])
        axes.plot([low, high], [0, 0], color=PALETTE["vermillion"], lw=2.2, alpha=0.5, zorder=2)
        axes.axhline(0.5, color=PALETTE["grey"], lw=0.8)
        axes.set_yticks(at, [*(label(f"group {short(r['group'])}") for r in rows), "mean, 90 %"])
        axes.set_ylim(-0.6, len(rows) + 0.4)
        scale_axis(axes, "x", 0.0, 1.08 * max(float(b.max()), float(a.max()), high, 0.1), log=False)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("Log RMSE of readings not seen (0 is perfect)")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    each = "; ".join(
        f"group {r['group']} {b:.3f} before, {a:.3f} after" for r, b, a in zip(rows, before, after, strict=True)
    )
    return Picture(
        figure_data_uri(figure),
        f"Log RMSE on unseen groups, {protocol} protocol: {each}.",
        f"The {protocol} protocol: error of each group that no choice had seen. Bar: 90 % interval of the mean after,"
        " from the bootstrap of the change.",
    )


def leftover_pictures(shown: Sequence[Shown], mean: FloatArray, sd: FloatArray) -> list[Picture]:
    """What no named cause describes, group by group.

    Parameters
    ----------
    shown : sequence of Shown
        All groups of the record, in its order.
    mean, sd : (n_points,) arrays
        ``ln(reading/prediction)`` of the discrepancy; `sd` is NaN where the readings say nothing.
    """
    parts, start = [], 0
    for g in shown:
        part = slice(start, start + g.group.n_points)
        start = part.stop
        if np.isfinite(sd[part]).any():
            parts.append((g, mean[part], sd[part]))
    if not parts:
        return []
    reach = float(np.clip(max(np.nanmax(np.abs(m) + 1.645 * s) for _, m, s in parts), 0.05, 3.0))
    return [_leftover(g, m, s, reach, len(parts)) for g, m, s in parts]


def _leftover(g: Shown, mean: FloatArray, sd: FloatArray, reach: float, n: int) -> Picture:
    heard = np.isfinite(sd)
    order = np.argsort(g.sweep.values[heard], kind="stable")
    x, m, s = (a[heard][order] for a in (g.sweep.values, mean, sd))
    with figure_style():
        figure, (axes,) = new_figure(height=2.5)
        axes.axhline(1.0, color=PALETTE["grey"], lw=1.0)
        axes.fill_between(x, np.exp(m - 1.645 * s), np.exp(m + 1.645 * s), color=PALETTE["purple"], **BAND)
        axes.plot(x, np.exp(m), color=PALETTE["purple"], marker="." if x.size < 3 else None)
        scale_axis(axes, "y", float(np.exp(-reach)), float(np.exp(reach)), log=True)
        _scale_x(axes, g.sweep.values, log=g.sweep.log)
        axes.set_xlabel(g.sweep.label)
        axes.set_ylabel("Reading / prediction")
        _heading(axes, g.group.id, g.sweep.condition)
    low, high = factor(float(m.min())), factor(float(m.max()))
    return Picture(
        _uri(figure, n),
        f"Leftover discrepancy against {_swept(g.sweep)}, group {g.group.id}:"
        f" readings ×{low} to ×{high} of the prediction.",
        f"×{low} to ×{high}; band: 90 %.",
    )

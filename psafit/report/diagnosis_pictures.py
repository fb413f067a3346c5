"""The figures of a diagnosis with their texts: image, what is to be seen, what it means."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.compare import known
from psafit.diagnose.gain import Gain
from psafit.diagnose.influence import Influence
from psafit.diagnose.record import NEAREST, NOT_EXCLUDED, UNSEEN, ScreeningResult
from psafit.diagnose.show import Growth
from psafit.experiment import Group
from psafit.report import figures
from psafit.report.catalogue import TITLES
from psafit.report.diagnosis_words import share
from psafit.report.figures.axes import label, scale_axis, scale_sweep, widened
from psafit.report.figures.curves import DASHES
from psafit.report.figures.groups import short, title, titled
from psafit.report.figures.influence import influence_figure
from psafit.report.figures.sweep import AXIS, SWEPT
from psafit.report.page import Picture, figure_data_uri
from psafit.report.style import BAND, MEASURED, PALETTE, figure_style, new_figure
from psafit.report.wording import count, factor, number, typeset, unit_text
from psafit.text import fixed

_BASELINE: Final[dict[str, Any]] = {"color": PALETTE["grey"], "linestyle": DASHES, "linewidth": 1.6, "zorder": 2}
_EXTENDED: Final[dict[str, Any]] = {"color": PALETTE["vermillion"], "linewidth": 1.6, "zorder": 2.5}
_VERDICT_COLOR: Final = {
    "present": PALETTE["vermillion"],
    NEAREST: PALETTE["vermillion"],
    "as good": PALETTE["vermillion"],
    "explains part alone": PALETTE["orange"],
    "not present": PALETTE["grey"],
    NOT_EXCLUDED: PALETTE["sky"],
    UNSEEN: PALETTE["sky"],
}
_HATCH: Final = {UNSEEN: "////", "as good": "...."}
_SYMBOL: Final = {"frequency": "f", "amplitude": "V"}


@dataclass(frozen=True, eq=False)
class Shown:
    """A group with what the models say of it.

    Parameters
    ----------
    group : Group
    sweep : Sweep
    curves : list of Curve
        Baseline and extended model, as far as they are on record.
    errors : list of float
        Of each: root mean square of ln((predicted + 0.3 um)/(measured + 0.3 um)).
    more : list of Curve
        What else is on record, to be switched on.
    rows : (n_points,) int array
        Places of its readings in what the record holds one group after the other.
    """

    group: Group
    sweep: figures.Sweep
    curves: list[figures.Curve]
    errors: list[float]
    more: list[figures.Curve]
    rows: NDArray[np.intp]

    @property
    def text(self) -> str:
        """By what factor each model is off."""
        return "; ".join(f"{c.name} off by ×{factor(e)}" for c, e in zip(self.curves, self.errors, strict=True))

    @property
    def title(self) -> str:
        """The group and what is held."""
        return f"Group {self.group.id}: {self.sweep.condition}"


def _uri(figure: Figure, n: int) -> str:
    """Image of one of `n` of a kind, which are simpler than those of a fit."""
    return figure_data_uri(figure, like=n, few=12)


def _scale_x(axes: Axes, values: FloatArray, *, log: bool) -> None:
    limits = widened(float(np.min(values)), float(np.max(values)), 0.03, log=log)
    scale_axis(axes, "x", *limits, log=log)


def _swept(sweep: figures.Sweep) -> str:
    return SWEPT.get(sweep.variable, "the number of the reading")


def summary_picture(pictured: Sequence[Shown]) -> Picture:
    """The picture of the first screen: the models' error in each group, and for each the group that it misses most."""
    rows = factor_rows(pictured)
    with_errors = [g for g in pictured if g.errors]
    # The one that the baseline misses most, and of the others the one that the last model does.
    worst = sorted(with_errors, key=lambda g: -g.errors[0])[:1] or list(pictured[:1])
    worst += sorted((g for g in with_errors if g is not worst[0]), key=lambda g: -g.errors[-1])[:1]
    examples = [figures.Example(titled(g.group.id), "ink", g.group, g.sweep, g.curves) for g in worst]
    legend = figures.handles([replace(c, bands=()) for c in pictured[0].curves])
    return Picture(
        figure_data_uri(figures.summary_figure(rows if with_errors else [], examples, legend)),
        "Typical factor between model and reading: "
        + "; ".join(f"group {g.group.id} {g.text or 'readings alone'}" for g in pictured[:20])
        + ".",
        "Above, how far the fitted models are off in each group: ×1 would be perfect."
        f" Below, {_missed(worst) if with_errors and len(pictured) > 1 else f'group {worst[0].group.id}'}.",
    )


def _missed(worst: Sequence[Shown]) -> str:
    """Which groups `summary_picture` has chosen, and why."""
    first, *others = worst
    text = f"group {first.group.id}, which the {first.curves[0].name} misses most"
    return text + "".join(
        f", and of the others the one that the {other.curves[-1].name} misses most, group {other.group.id}"
        if len(other.curves) > 1
        else f", and group {other.group.id}, which it misses most of the others"
        for other in others
    )


def factor_rows(shown: Sequence[Shown]) -> list[figures.Row]:
    """Each group's error by both models."""
    return [
        figures.Row(
            figures.row_name(g.group.id, g.sweep),
            [
                figures.Mark(e, c.color, "s" if c.dashed else "o", hollow=c.dashed)
                for c, e in zip(g.curves, g.errors, strict=True)
            ],
        )
        for g in shown
    ]


def overview_pictures(shown: Sequence[Shown]) -> list[Picture]:
    """Measured against baseline and extension: small multiples, one image each so that they reflow."""
    pictures = []
    for g in shown:
        measured, o = g.group.reading, g.group.observable
        alt = (
            f"{o.title.capitalize()} against {_swept(g.sweep)}, group {g.group.id}, {g.sweep.condition}:"
            f" measured {number(float(measured.min()))} to {number(float(measured.max()))} {unit_text(o.unit)};"
            f" {g.text}."
        )
        caption = f"{g.text[:1].upper()}{g.text[1:]}." if g.text else "Readings alone."
        pictures.append(Picture(_uri(figures.group_figure(g.group, g.sweep, g.curves), len(shown)), alt, caption))
    return pictures


def explorable(shown: Sequence[Shown]) -> list[dict[str, Any]]:
    """The curves of all groups as numbers for the page's script."""
    return [figures.explorable(g.title, g.group, g.sweep, g.curves, g.more) for g in shown]


def growth_pictures(
    baseline: Sequence[Growth],
    extended: Sequence[Growth],
    conditions: Mapping[str, str],
    zeros: Mapping[str, int],
) -> list[Picture]:
    """Local exponents of each sweep, measured and predicted.

    Parameters
    ----------
    baseline, extended : sequences of Growth
        In the same order; the second empty without extension.
    conditions, zeros : dict
        What each group holds, and how many readings of zero, which have no exponent; by its id as text.
    """
    rest = {str(g.group): g for g in extended}
    drawn = [(str(g.group), g) for g in baseline if g.at]
    return [_growth(g, rest.get(id), conditions.get(id, ""), zeros.get(id, 0), len(drawn)) for id, g in drawn]


def _growth(base: Growth, ext: Growth | None, condition: str, zeros: int, n: int) -> Picture:
    ext = ext if ext is not None and ext.at else None
    seen = ext or base  # the readings weighted by the scatter of the better model
    at, lower, upper = (np.array(x) for x in (seen.at, seen.lower, seen.upper))
    measured = np.array(seen.measured)
    letter = _SYMBOL[base.variable]
    with figure_style():
        figure, axes = new_figure(height=2.75)
        axes.axhline(0.0, color=PALETTE["faint"], lw=1.0, zorder=0.5)
        mark: dict[str, Any] = {}
        if at.size > 1:
            axes.fill_between(at, lower, upper, color=PALETTE["ink"], **{**BAND, "alpha": 0.16})
        else:  # a band and a line need a width: a bar and dashes instead
            axes.vlines(at, lower, upper, color=PALETTE["ink"], lw=9, alpha=0.16)
            mark = {"marker": "_", "markersize": 22, "markeredgewidth": 2}
        axes.plot(at, measured, **MEASURED)
        axes.plot(base.at, base.simulated, **_BASELINE, **mark)
        if ext is not None:
            axes.plot(ext.at, ext.simulated, **_EXTENDED, **mark)
        lines = [measured, np.array(base.simulated)]
        lines += [np.array(ext.simulated)] if ext is not None else []
        values = np.concatenate([*lines, *([lower, upper] if at.size == 1 else [])])
        low, high = float(np.nanmin(values)), float(np.nanmax(values))
        room = 0.25 * (high - low) + 0.1
        scale_axis(axes, "y", low - room, high + room, log=False)
        shown = at if at.size > 1 else at * np.array([0.5, 2.0])
        _scale_x(axes, shown, log=bool(shown.min() > 0 and shown.max() >= 3 * shown.min()))
        axes.set_xlabel(AXIS[base.variable])
        axes.set_ylabel(f"d ln L / d ln {letter}")
        title(axes, base.group, condition)
    text = f"measured {_extent(seen.measured)}, baseline {_extent(base.simulated)}"
    if ext is not None:
        text += f", extended {_extent(ext.simulated)}"
    if zeros:
        text += f"; without {count(zeros, 'reading')} of zero, which {'has' if zeros == 1 else 'have'} no logarithm"
    alt = f"Local exponent of the reading against {SWEPT[base.variable]}, group {base.group}: {text}."
    return Picture(_uri(figure, n), alt, f"Exponent: {text}.")


def _extent(values: Sequence[float]) -> str:
    low, high = (fixed(x, 2).replace("-", "\N{MINUS SIGN}") for x in (min(values), max(values)))
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
    present = [name for name, s in zip(names, screening, strict=True) if s.verdict in ("present", NEAREST)]
    shares = [np.nan if s.verdict == UNSEEN else s.inclusion for s in screening]
    gains = _bars(names, [s.refit_gain for s in screening], screening, named, "Gain, refitted (nats)", _nats, None)
    inclusion = _bars(names, shares, screening, named, "Inclusion probability", share, (0.0, 1.0))
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
            "Summed over all models that contain the cause. A cause may gain much alone and yet not be needed with"
            " another one; one whose evidence is less than 3 nats counts with the model without it. A dash: could not"
            " have been seen, so that nothing is known.",
        ),
    ]


def _nats(value: float) -> str:
    text = fixed(value, 0 if abs(value) >= 100 else 1).replace("-", "\N{MINUS SIGN}")
    return text if np.isfinite(value) else "–"


def _bars(
    names: Sequence[str], values: Sequence[float], screening: Sequence[ScreeningResult], adopted: Sequence[str],
    quantity: str,
    text: Callable[[float], str],
    limits: tuple[float, float] | None,
    stub: float = 0.02,
) -> Figure:  # fmt: skip
    with figure_style():
        figure, axes = new_figure(height=1.45 + 0.235 * len(names))
        at = np.arange(len(names))[::-1]
        lengths = np.nan_to_num(np.asarray(values, dtype=float))
        low, high = limits or (min(0.0, float(lengths.min())), max(float(lengths.max()), 1.0))
        span = high - low
        # A bar of no length still shows the colour of its verdict: it takes this share of the axis.
        drawn = np.where(np.abs(lengths) < stub * span, stub * span, lengths)
        for word, color in _VERDICT_COLOR.items():
            mine = np.array([s.verdict == word for s in screening])
            if mine.any():
                axes.barh(
                    at[mine], drawn[mine], height=0.68, color=color, hatch=_HATCH.get(word), edgecolor="white", lw=0
                )
        for y, value, length in zip(at, values, lengths, strict=True):
            axes.annotate(
                text(float(value)), (max(float(length), 0.0), float(y)), (3, 0), textcoords="offset points",
                va="center", fontsize=8.5, color=PALETTE["ink"],
            )  # fmt: skip
        scale_axis(axes, "x", low, high + 0.22 * span, log=False, few=True)
        axes.set_ylim(-0.7, len(names) - 0.3)
        wrapped = [textwrap.fill(n, 31, max_lines=2, placeholder="…", break_on_hyphens=False) for n in names]
        axes.set_yticks(at, [label(n, 64) for n in wrapped], fontsize=8.5, linespacing=0.9)
        for tick, s in zip(axes.get_yticklabels(), screening, strict=True):
            tick.set_fontweight("bold" if s.id in adopted else "normal")
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(quantity)
        handles = [
            Patch(facecolor=c, hatch=_HATCH.get(w), edgecolor="white", lw=0, label=w)
            for w, c in _VERDICT_COLOR.items()
            if any(s.verdict == w for s in screening)
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=2, fontsize=8.5)
    return figure


def gain_picture(gain: Gain) -> Picture:
    """Error of each unseen group, before and after."""
    rows, protocol = gain.groups, gain.protocol
    before = np.array([r.log_rmse_before for r in rows])
    after = np.array([r.log_rmse_after for r in rows])
    with figure_style():
        figure, axes = new_figure(height=1.35 + 0.32 * (len(rows) + 1))
        at = np.arange(len(rows) + 1)[::-1]
        means = (gain.log_rmse_before, gain.log_rmse_after)
        b, a = np.append(before, means[0]), np.append(after, means[1])
        axes.hlines(at, np.minimum(a, b), np.maximum(a, b), color=PALETTE["faint"], lw=3, zorder=1)
        axes.plot(b, at, "s", ms=6.5, mfc="white", mec=PALETTE["grey"], mew=1.6, label="before: baseline", zorder=3)
        axes.plot(a, at, "o", ms=7, color=PALETTE["vermillion"], label="after: extended", zorder=3)
        low, high = (means[0] + c for c in gain.log_rmse_interval)
        axes.plot([low, high], [0, 0], color=PALETTE["vermillion"], lw=2.2, alpha=0.5, zorder=2)
        axes.axhline(0.5, color=PALETTE["grey"], lw=0.8)
        axes.set_yticks(at, [*(label(f"group {short(r.group)}") for r in rows), "mean, 90 %"])
        axes.set_ylim(-0.6, len(rows) + 0.4)
        most = max(float(b.max()), float(a.max()), 0.1)
        scale_axis(axes, "x", 0.0, 1.08 * max(most, min(high, 1.5 * most)), log=False)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("Log RMSE of readings not seen (0 is perfect)")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    each = "; ".join(
        f"group {r.group} {b:.3f} before, {a:.3f} after" for r, b, a in zip(rows, before, after, strict=True)
    )
    return Picture(
        figure_data_uri(figure),
        f"Log RMSE on unseen groups, {protocol} protocol: {each}.",
        f"The {protocol} protocol: error of each group that no choice had seen. Bar: 90 % interval of the mean after,"
        " from the bootstrap of the change.",
    )


def discrepancy_pictures(shown: Sequence[Shown], mean: FloatArray, sd: FloatArray) -> list[Picture]:
    """What no named cause describes, group by group.

    Parameters
    ----------
    shown : sequence of Shown
        All groups of the record, in its order.
    mean, sd : (n_points,) arrays
        ``ln(reading/prediction)`` of the discrepancy; `sd` is NaN where the readings say nothing.
    """
    parts = [(g, mean[g.rows], sd[g.rows]) for g in shown if np.isfinite(sd[g.rows]).any()]
    if not parts:
        return []
    reach = float(np.clip(max(np.nanmax(np.abs(m) + 1.645 * s) for _, m, s in parts), 0.05, 3.0))
    return [_discrepancy(g, m, s, reach, len(parts)) for g, m, s in parts]


def influence_pictures(found: Influence, shown: Sequence[Shown]) -> list[Picture]:
    """For each cause, the readings by what they give it."""
    pictures = []
    for c in found.causes:
        nats = np.array([known(x) for x in c.nats])
        given = [nats[g.rows] for g in shown]
        alt = f"Readings of {count(len(shown), 'sweep')} coloured by what they give {TITLES.get(c.cause, c.cause)}."
        groups = "; ".join(f"group {g} {fixed(x, 1, sign=True)}" for g, x in c.groups)
        caption = f"{TITLES.get(c.cause, c.cause)}: {fixed(c.total, 1)} nats ({groups}). {count(c.half, 'reading')}"
        verb = "gives" if c.half == 1 else "give"
        caption += f" of {nats.size} {verb} half of what speaks for it. Blue readings speak against it."
        most = float(np.nanmax(np.abs(nats)))
        figure = influence_figure([g.group for g in shown], [g.sweep for g in shown], given, most=max(most, 1e-9))
        pictures.append(Picture(_uri(figure, len(found.causes)), alt, typeset(caption)))
    return pictures


def _discrepancy(g: Shown, mean: FloatArray, sd: FloatArray, reach: float, n: int) -> Picture:
    heard = np.isfinite(sd)
    order = np.argsort(g.sweep.values[heard], kind="stable")
    x, m, s = (a[heard][order] for a in (g.sweep.values, mean, sd))
    with figure_style():
        figure, axes = new_figure(height=2.5)
        axes.axhline(1.0, color=PALETTE["grey"], lw=1.0)
        axes.fill_between(x, np.exp(m - 1.645 * s), np.exp(m + 1.645 * s), color=PALETTE["purple"], **BAND)
        axes.plot(x, np.exp(m), color=PALETTE["purple"], marker="." if x.size < 3 else None)
        scale_axis(axes, "y", float(np.exp(-reach)), float(np.exp(reach)), log=True)
        scale_sweep(axes, g.sweep)
        axes.set_xlabel(g.sweep.label)
        axes.set_ylabel("Reading / prediction")
        title(axes, g.group.id, g.sweep.condition)
    low, high = factor(float(m.min())), factor(float(m.max()))
    return Picture(
        _uri(figure, n),
        f"Discrepancy against {_swept(g.sweep)}, group {g.group.id}: readings ×{low} to ×{high} of the prediction.",
        f"×{low} to ×{high}; band: 90 %.",
    )

"""What is wrong with the baseline, and where: a section of a diagnosis' page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from scipy.stats import norm

from psafit.arrays import FloatArray
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.misfit import Where
from psafit.diagnose.show import Corner, Growth, Offset
from psafit.experiment import Experiment
from psafit.observables import aside
from psafit.report import figures
from psafit.report.catalogue import declared, parameter
from psafit.report.diagnosis import words
from psafit.report.diagnosis.shown import image
from psafit.report.figures.axes import scale_axis, shown_unit, widened
from psafit.report.figures.curves import DASHES
from psafit.report.figures.groups import title
from psafit.report.figures.sweep import AXIS, SWEPT, UNITS
from psafit.report.page import Picture, first
from psafit.report.style import BAND, MEASURED, PALETTE, figure_style, new_figure
from psafit.report.wording import exact, factor, interval, number, percent, span, with_unit
from psafit.text import count, fixed

_BASELINE: Final[dict[str, Any]] = {"color": PALETTE["grey"], "linestyle": DASHES, "linewidth": 1.6, "zorder": 2}

_EXTENDED: Final[dict[str, Any]] = {"color": PALETTE["vermillion"], "linewidth": 1.6, "zorder": 2.5}

_SYMBOL: Final = {"frequency": "f", "amplitude": "V"}

_COVARIATES: Final = {**SWEPT, "range": "predicted reading", "order": "order in each group"}


def content(result: Diagnosis, experiment: Experiment) -> dict[str, Any]:
    """What is wrong with the baseline, and where."""
    return {
        "where": where(result.misfit.where),
        "where_after": where(result.misfit.extended.where or [] if result.misfit.extended else []),
        "growth": growth(result, experiment),
        "no_growth": without_growth(result),
        "rejected": result.misfit.p_value < ALPHA,
        "scatter": scatter(result),
        "drift": drift_rows(result),
        "corners": corner_rows(result),
        "sessions": session_rows(result.misfit.sessions),
    }


def where(places: Sequence[Where]) -> list[Markup]:
    """Stretches of sweeps in which a model errs to one side."""
    return [_place(w) for w in places]


def _place(w: Where) -> Markup:
    side = "too large" if w.log_bias > 0 else "too small"
    others = Markup("the prediction is {}, as there in {},").format(side, words.group_ids(w.together))
    return Markup("<strong>Group {}</strong>: {}{}: {} by a factor of {} ({:.1f} standard deviations)").format(
        w.group, span([w.start, w.to], shown_unit(UNITS[w.variable])), aside(w.observable),
        others if w.together else f"predictions {side}", factor(abs(w.log_bias)), abs(w.score),
    )  # fmt: skip


def growth(result: Diagnosis, experiment: Experiment) -> list[Picture]:
    """Pictures of local exponents."""
    before = first(result.show["baseline"].growth)
    after = result.show["extended"].growth if "extended" in result.show else []
    conditions = {str(g.id): figures.sweep_of(g).condition for g in experiment.groups}
    zeros = {str(g.id): int(np.count_nonzero(g.reading == 0)) for g in experiment.groups}
    return growth_pictures(before, after, conditions, zeros)


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
    return Picture(image(figure, n), alt, f"Exponent: {text}.")


def _scale_x(axes: Axes, values: FloatArray, *, log: bool) -> None:
    limits = widened(float(np.min(values)), float(np.max(values)), 0.03, log=log)
    scale_axis(axes, "x", *limits, log=log)


def _extent(values: Sequence[float]) -> str:
    low, high = (fixed(x, 2).replace("-", "\N{MINUS SIGN}") for x in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def without_growth(result: Diagnosis) -> Markup | None:
    """Groups of which no local exponent can be known."""
    none = [g.group for g in result.show["baseline"].growth if not g.at]
    return words.group_ids(none) if none else None


def scatter(result: Diagnosis, much: float = 0.9) -> str | None:
    """The relative scatter of the fitted baseline, where this share of its prior or more lies below it."""
    p = next((c.parameters.get("sigma_rel") for c in result.causes if not c.terms), None)
    return percent(p.median) if p and p.prior_share > much else None


def drift_rows(result: Diagnosis, most: int = 8) -> list[list[Any]]:
    """What letting one parameter drift would gain, `most` rows."""
    extended = result.show.get("extended")
    rest = {(d.parameter, d.variable): d.gain for d in (extended.drift if extended else [])}
    rows = []
    for d in result.show["baseline"].drift[:most]:
        p = declared(d.parameter)
        row = [
            parameter(d.parameter, p.description if p else ""),
            _COVARIATES.get(d.variable, d.variable),
            f"{words.nats(d.gain)} nats",
            _change(d.factor),
        ]
        if extended:
            left = rest.get((d.parameter, d.variable))
            row.append("–" if left is None else f"{words.nats(left)} nats")
        rows.append(row)
    return rows


def _change(value: float) -> str:
    """A factor of drift; the search for it ends at e to the power of nine."""
    if not value > 0:
        return "–"
    if abs(math.log(value)) > 8.9:
        return f"more than ×{exact(8000)}" if value > 1 else f"less than ×{exact(1 / 8000)}"
    return f"×{number(value)}"


def corner_rows(result: Diagnosis) -> list[list[Any]]:
    """Where growth changes: readings as the better model weighs them, baseline, and extension if there is one."""
    models = [
        {str(c.group): c for c in result.show[name].corners} for name in ("baseline", "extended") if name in result.show
    ]

    def cells(c: Corner | None, *, measured: bool) -> list[str]:
        at = None if c is None else c.measured if measured else c.simulated
        exponents = None if c is None else c.exponents if measured else c.simulated_exponents
        if c is None or at is None or exponents is None:
            return ["one line", "–"]
        text = number(at)
        if measured and c.lower is not None and c.upper is not None:
            text = f"{number(at, c.upper - c.lower)} ({interval(c.lower, c.upper)})"
        below, above = (fixed(x, 2).replace("-", "\N{MINUS SIGN}") for x in exponents)
        return [with_unit(text, "Hz" if c.variable == "frequency" else "V"), f"{below} → {above}"]

    rows = []
    for group in dict.fromkeys(id for of_model in models for id in of_model):
        found = [of_model.get(group) for of_model in models]
        measured = next((c for c in reversed(found) if c and c.measured is not None), None)
        row = [group, *cells(measured, measured=True)]
        for c in found:
            row += cells(c, measured=False)
        rows.append(row)
    return rows


def session_rows(sessions: Sequence[Offset]) -> list[list[Any]]:
    """How two sessions differ where both have readings."""
    rows = []
    for s in sessions:
        middle, low, high = s.factor, s.lower, s.upper
        # Of many pairs some lie outside their 90 % interval: half of a 99 % one by the width of that.
        apart = abs(math.log(middle)) > norm.ppf(0.995) / (2 * norm.ppf(0.95)) * math.log(high / low)
        badge = {"text": "differ", "kind": "warn"} if apart else {"text": "agree", "kind": "good"}
        where = count(s.n_conditions, "condition")
        pair = f"{s.second} over {s.first}{aside(s.observable)}"
        rows.append([pair, where, f"×{middle:.2f}", f"×{low:.2f} to ×{high:.2f}", badge])
    return rows

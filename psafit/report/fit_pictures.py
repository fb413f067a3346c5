"""The figures of the fit report with their texts: image, what is to be seen, what it means."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.lines import Line2D
from scipy.stats import binom

from psafit.arrays import FloatArray
from psafit.experiment import GroupId
from psafit.inference.identify import DROP_90
from psafit.inference.run_folder import Run
from psafit.observables import names
from psafit.records import GroupScore, Validation
from psafit.report import figures
from psafit.report.catalogue import TITLES
from psafit.report.figures.curves import ROLE_COLOR
from psafit.report.figures.groups import ROLE_MARKER, ROLE_TEXT, titled
from psafit.report.figures.sweep import UNITS
from psafit.report.page import Picture, figure_data_uri, worst
from psafit.report.style import MEASURED, PALETTE
from psafit.report.wording import factor, interval, number, percent, symbol_html, typeset, unit_text, with_unit
from psafit.text import count
from psafit.validate import Prediction, log_ratio


@dataclass(frozen=True)
class Shown:
    """Readings of a group as the page shows them, with their name, scores, prediction and abscissa."""

    name: str
    score: GroupScore
    prediction: Prediction
    sweep: figures.Sweep
    without: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def curves(self) -> list[figures.Curve]:
        """The curve of the group's prediction."""
        return [figures.curve_of(self.prediction)]


def shown_groups(
    validation: Validation,
    predictions: Sequence[Prediction],
    without: Callable[[GroupId], Mapping[str, FloatArray]] = lambda group: {},
) -> list[Shown]:
    """The groups of a validation with their predictions, in the same order."""
    sweeps = figures.sweeps_of([p.group for p in predictions])
    each = zip(names_of(validation), validation.groups, predictions, sweeps, strict=True)
    return [Shown(name, score, p, sweep, without(p.group.id)) for name, score, p, sweep in each]


def names_of(validation: Validation) -> list[str]:
    """What the page calls the readings of each score."""
    return names((s.group, s.observable) for s in validation.groups)


def pictured(shown: list[Shown]) -> list[Shown]:
    """The groups that get pictures, and in any case the first that was fitted."""
    first = next(i for i, g in enumerate(shown) if g.score.role == "fit")
    return [shown[i] for i in sorted({first, *worst([g.score.log_rmse for g in shown])})]


def summary_picture(pictured: Sequence[Shown]) -> Picture:
    """The picture of the first screen."""
    seen = [g for g in pictured if g.score.role == "fit"]
    unseen = sorted((g for g in pictured if g.score.role == "holdout"), key=lambda g: g.score.log_rmse)
    typical = unseen[len(unseen) // 2 :][:1]
    examples = [
        figures.Example(titled(g.score.group), ROLE_COLOR[g.score.role], g.prediction.group, g.sweep, g.curves)
        for g in [*seen[:1], *typical]
    ]
    listing = "; ".join(f"group {g.name} {ROLE_TEXT[g.score.role]} {factor(g.score.log_rmse)}" for g in pictured[:20])
    below = f"Below, fitted group {seen[0].name}"
    if typical:
        below += f" and, {middle_words(len(unseen))}, group {typical[0].name}"
    legend = [Line2D([], [], **MEASURED, label="measured")] + [
        Line2D([], [], color=PALETTE[ROLE_COLOR[r]], marker=ROLE_MARKER[r], ms=5.5, lw=1.5, label=ROLE_TEXT[r])
        for r in ("fit", "holdout")
        if any(g.score.role == r for g in pictured)
    ]
    return Picture(
        figure_data_uri(figures.summary_figure(factor_rows(pictured), examples, legend)),
        f"Typical factor between prediction and reading: {listing}.",
        f"Above, how far the prediction is off in each group: ×1 would be perfect. {below}. Line: predicted median."
        " Dark band: 90 % of the model. Light band: where 90 % of readings should fall.",
    )


def middle_words(n: int) -> str:
    """The one in the middle of `n` groups that the fit never saw, in words; of two in the middle the worse."""
    if n <= 2:
        return "of the two the fit never saw, the worse" if n == 2 else "the one the fit never saw"
    return "of those the fit never saw, the " + ("one of median score" if n % 2 else "worse of the two of middle score")


def factor_rows(shown: Sequence[Shown]) -> list[figures.Row]:
    """Each group's error, marked by its role."""
    return [
        figures.Row(
            g.score.group,
            g.sweep.held,
            [figures.Mark(g.score.log_rmse, ROLE_COLOR[g.score.role], ROLE_MARKER[g.score.role])],
        )
        for g in shown
    ]


def explorable(shown: Sequence[Shown]) -> list[dict[str, Any]]:
    """The curves of all groups as numbers for the page's script."""
    return [
        figures.explorable(
            f"Group {g.score.group}: {g.sweep.held} ({ROLE_TEXT[g.score.role]})",
            g.prediction.group, g.sweep, g.curves, figures.without_curves(g.without, TITLES),
        )
        for g in shown
    ]  # fmt: skip


def group_pictures(pictured: Sequence[Shown]) -> list[Picture]:
    """Measured against predicted, group by group."""
    pictures = []
    for g in pictured:
        s, p, w = g.score, g.prediction, g.sweep
        y, o = p.group.reading, p.group.observable
        zeros = int((y == 0).sum())
        alt = (
            f"{o.title.capitalize()} against {w.over}, group {s.group}, {w.condition}, {ROLE_TEXT[s.role]}: measured"
            f" {number(float(y.min()))} to {number(float(y.max()))} {unit_text(o.unit)}, predicted median"
            f" {number(float(p.median.min()))} to {number(float(p.median.max()))} {unit_text(o.unit)}."
        )
        caption = (
            f"{s.verdict[:1].upper()}{s.verdict[1:]}. Log RMSE {s.log_rmse:.3f} over {count(s.n_points, 'reading')}."
        )
        if zeros:
            caption += f" {zeros} of them {'is' if zeros == 1 else 'are'} zero."
        if p.group.sigma is not None:
            caption += " Bars: the readings’ own standard uncertainty."
        figure = figures.group_figure(p.group, w, g.curves, p.role)
        pictures.append(Picture(figure_data_uri(figure, like=len(pictured)), alt, caption))
    return pictures


def _metric(shown: Shown) -> tuple[float, bool]:
    return shown.prediction.group.observable.metric


def residual_pictures(pictured: Sequence[Shown]) -> list[Picture]:
    """Logarithmic errors, group by group, on one scale."""
    errors = [log_ratio(g.prediction.median, g.prediction.group.reading, *_metric(g)) for g in pictured]
    view = figures.residual_view(errors)
    pictures = []
    for g, error in zip(pictured, errors, strict=True):
        s, p, w = g.score, g.prediction, g.sweep
        others = [
            (o.sweep, e)
            for o, e in zip(pictured, errors, strict=True)
            if o is not g and o.sweep.variable == w.variable != "order"
        ]
        # Where readings should lie, seen as an error of the median.
        band = (log_ratio(p.median, p.upper, *_metric(g)), log_ratio(p.median, p.lower, *_metric(g)))
        worst = int(np.argmax(np.abs(error)))
        at = f"{w.values[worst]:g}"
        place = f"{at} {unit_text(UNITS[w.variable])}" if w.variable in UNITS else f"reading {at}"
        furthest = factor(float(error[worst]))
        pictures.append(
            Picture(
                figure_data_uri(figures.residual_figure(p, w, error, band, others, view), like=len(pictured)),
                f"Predicted over measured against {w.over}, group {g.name}, {ROLE_TEXT[s.role]}: mean"
                f" ×{factor(s.log_bias)}, furthest from one ×{furthest} at {place}.",
                f"On average ×{factor(s.log_bias)}; furthest off ×{furthest} at {place}.",
            )
        )
    return pictures


def pit_pictures(pictured: Sequence[Shown]) -> list[Picture]:
    """Calibration, group by group."""
    pictures = []
    for g in pictured:
        p = g.prediction
        pit = p.pit
        bins = 10 if pit.size >= 30 else 5
        low, high = (float(x) for x in binom.interval(0.9, pit.size, 1 / bins))
        edge = percent(float(np.mean((pit < 1 / bins) | (pit >= 1 - 1 / bins))))
        pictures.append(
            Picture(
                figure_data_uri(figures.pit_figure(p, g.sweep, pit, (low, high), bins), like=len(pictured)),
                f"Histogram of the probability integral transforms of group {g.name}, {ROLE_TEXT[p.role]}:"
                f" {edge} of {pit.size} readings in the two outermost of {bins} bins, {percent(2 / bins)} expected.",
                f"{edge} of {count(pit.size, 'reading')} in the two outermost bins, where {percent(2 / bins)} belong.",
            )
        )
    return pictures


def marginals(run: Run) -> list[figures.Marginal]:
    """Prior, posterior and profile of every parameter."""
    found = []
    p = np.linspace(0.001, 0.999, 400)
    for i, (parameter, e, s) in enumerate(
        zip(run.problem.parameters, run.fit.parameters, run.summary.parameters, strict=True)
    ):
        ends = parameter.prior_quantile(p[[0, -1]])
        u = np.linspace(float(ends[0]), float(ends[1]), 400)
        found.append(
            figures.Marginal(
                entry=e,
                log=parameter.prior.coordinate == "log",
                draws=run.draws.flat[:, i],
                prior_value=parameter.to_physical(u),
                prior_density=np.exp(parameter.log_prior(u)),
                interval=(s.lower, s.upper),
                prior_interval=(s.prior_lower, s.prior_upper),
                verdict=s.verdict,
                profile=s.profile,
                level=DROP_90,
            )
        )
    return found


def marginal_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> list[Picture]:
    """What is determined, parameter by parameter."""
    pictures = []
    for m, s in zip(marginals, run.summary.parameters, strict=True):
        unit = m.entry.unit
        pictures.append(
            Picture(
                figure_data_uri(figures.marginal_figure(m)),
                f"Prior and posterior density of {m.entry.description}: prior 90 % interval"
                f" {with_unit(interval(*m.prior_interval), unit)}, posterior {with_unit(interval(*m.interval), unit)};"
                f" {s.verdict}{', with the profile likelihood' if m.profile else ''}.",
                Markup("{}. {}{}.").format(
                    f"{m.entry.description[:1].upper()}{m.entry.description[1:]}",
                    symbol_html(m.entry.symbol),
                    typeset(s.text.removeprefix(s.name)),
                ),
            )
        )
    return pictures


def corner_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> dict[str, Picture]:
    """Corner plots under the keys "physical" and "scatter"."""
    n, best = run.fit.n_physical, run.fit.minima[0].values
    found = {}
    for key, part, what in (
        ("physical", marginals[:n], "the physical parameters"),
        ("scatter", marginals[n:], "the parameters of the scatter"),
    ):
        if not part:
            continue
        figure = figures.corner_figure(part, [best[m.entry.name] for m in part])
        pairs = "; ".join(
            f"{m.entry.name} {with_unit(interval(*m.interval, (m.interval[1] - m.interval[0]) / 2), m.entry.unit)}"
            for m in part
        )
        found[key] = Picture(
            figure_data_uri(figure),
            f"Corner plot of {what}, 90 % intervals: {pairs}.",
            f"Posterior of {what}, singly and in pairs; regions hold 50 and 90 % of the draws. Orange: the best"
            " optimum. Grey on the diagonal: the prior’s 90 % interval, where it reaches into view. A slanted region is"
            " a combination that the data fix better than either parameter.",
        )
    return found


def trace_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> list[Picture]:
    """Chains, parameter by parameter."""
    return [
        Picture(
            figure_data_uri(figures.trace_figure(m, run.draws.values[..., i], run.summary.thinning), svg_limit=0),
            f"Chains of {m.entry.description}: R-hat {s.r_hat:.4f},"
            f" autocorrelation time {s.autocorrelation_time:.0f} steps.",
            f"R-hat {s.r_hat:.4f}; autocorrelation time {s.autocorrelation_time:.0f} steps.",
        )
        for i, (m, s) in enumerate(zip(marginals, run.summary.parameters, strict=True))
    ]

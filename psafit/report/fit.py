"""The report of a fit: what was fitted, what it predicts, what the data do not determine."""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from scipy.stats import binom

from psafit.inference.identify import DROP_90, limits
from psafit.inference.run import Run
from psafit.records import GroupScore, ParameterSummary, Validation
from psafit.report import figures
from psafit.report.page import figure_data_uri, render
from psafit.report.wording import (
    count,
    factor,
    groups,
    interval,
    listed,
    number,
    p_value,
    percent,
    symbol_html,
    unit_text,
    without_paths,
)
from psafit.validate import Prediction, log_ratio

FloatArray = NDArray[np.float64]
REPORT = "report.html"

# The study integrated with this step, s.
STUDY_STEP = 1e-6
# As in `validate.verdict`: below the first the group is predicted well, below the second roughly followed.
GOOD, FAIR = 0.10, 0.30
_MAX_MINIMA = 8
_KINDS = {"determined": "good", "bounded above": "warn", "bounded below": "warn", "not determined": "bad"}


@dataclass(frozen=True)
class Picture:
    """A figure in the page: image, what is to be seen, what it means."""

    uri: str
    alt: str
    caption: str | Markup


def write_report(run: Run, validation: Validation, predictions: list[Prediction], *, command: str = "") -> Path:
    """Write `report.html` into the run's folder.

    Parameters
    ----------
    run : Run
    validation : Validation
    predictions : list of Prediction
        Of the same run, in the order of the validation's groups.
    command : str
        What the user typed; absolute paths in it are cut to their last part.

    Returns
    -------
    Path
        Of the page.
    """
    sweeps = [figures.sweep_of(p.group) for p in predictions]
    marginals = _marginals(run)
    content = {
        "title": f"Fit of {groups(run.fit.groups).unescape()}: {run.fit.title}",
        "warning": None if run.summary.converged else run.summary.message,
        "sentences": [
            _what_was_fitted(run, predictions, sweeps),
            _what_it_predicts(validation, predictions),
            _what_is_not_determined(run),
        ],
        "summary": _summary_picture(validation, predictions, sweeps),
        "parameters": _parameter_rows(run),
        "implausible": [s for s in run.summary.parameters if _implausible(s)],
        "minima": _minima(run),
        "marginals": _marginal_pictures(run, marginals),
        "group_pictures": _group_pictures(validation, predictions, sweeps),
        "residual_pictures": _residual_pictures(validation, predictions, sweeps),
        "scores": [_score_row(s) for s in validation.groups],
        "verdicts": [(f"Group {s.group}", _role_cell(s), s.verdict) for s in validation.groups],
        "holdout_log_rmse": validation.holdout_log_rmse,
        "n_draws": validation.n_draws,
        "pit_pictures": _pit_pictures(predictions, sweeps),
        "corners": _corner_pictures(run, marginals),
        "health": _health(run),
        "traces": _trace_pictures(run, marginals),
        "priors": _prior_rows(run),
        "lmfit_report": run.fit.lmfit_report,
        "numerics": _numerics(run),
        "data_warnings": run.problem.experiment.warnings,
        "facts": _facts(run, command),
        "provenance": {
            "psafit": run.fit.versions.get("psafit", "?"),
            "run": run.folder.name,
            "seed": run.fit.seed,
            "identity": run.fit.identity[:12],
        },
    }
    return render("fit.html.j2", run.folder / REPORT, **content)


# The first screen -----------------------------------------------------------------------------------------------


def _symbols(run: Run) -> dict[str, Markup]:
    return {e.name: symbol_html(e.symbol) for e in run.fit.parameters}


def _physical(run: Run) -> list[ParameterSummary]:
    return run.summary.parameters[: run.fit.n_physical]


def _what_was_fitted(run: Run, predictions: Sequence[Prediction], sweeps: Sequence[figures.Sweep]) -> Markup:
    fitted = [(p, s) for p, s in zip(predictions, sweeps, strict=True) if p.role == "fit"]
    readings = sum(p.group.n_points for p, _ in fitted)
    symbols = _symbols(run)
    names = listed(
        Markup("{} {}").format(e.description, symbols[e.name]) if run.fit.n_physical <= 4 else symbols[e.name]
        for e in run.fit.parameters[: run.fit.n_physical]
    )
    terms = Markup(" extended by {}").format(listed(run.fit.terms)) if run.fit.terms else ""
    where = listed(f"{p.group.id} ({s.condition}, {s.extent})" for p, s in fitted)
    return Markup(
        "<strong>Fitted:</strong> {} of the study’s model{}, and the scatter of a reading, to the {} of {} {}."
    ).format(names, terms, count(readings, "reading"), "group" if len(fitted) == 1 else "groups", where)


def _what_it_predicts(validation: Validation, predictions: Sequence[Prediction]) -> Markup:
    unseen = [s for s in validation.groups if s.role == "holdout"]
    seen = [s for s in validation.groups if s.role == "fit"]
    own = Markup("{}: ×{}").format(groups([s.group for s in seen]), listed(factor(s.log_rmse) for s in seen))
    if not unseen:
        return Markup(
            "<strong>Predicted:</strong> every group was fitted, so nothing is left to test the prediction on; the"
            " typical factor between fit and readings is {}."
        ).format(own)
    mean = validation.holdout_log_rmse
    assert mean is not None  # there are groups it is the mean of
    readings = sum(s.n_points for s in unseen)
    inside = sum(s.coverage_90 * s.n_points for s in unseen) / readings
    best = min(unseen, key=lambda s: s.log_rmse)
    worst = max(unseen, key=lambda s: s.log_rmse)
    how = "It predicts" if mean <= GOOD else "It roughly predicts" if mean <= FAIR else "It does not predict"
    which = groups([s.group for s in unseen])
    spread = (
        Markup(" (from ×{} for group {} to ×{} for group {})").format(
            factor(best.log_rmse), best.group, factor(worst.log_rmse), worst.group
        )
        if len(unseen) > 1
        else ""
    )
    return Markup(
        "<strong>Predicted:</strong> {} {}, which the fit never saw: typically a factor of {} off{}, where the fitted"
        " readings themselves are off by ×{}; {} of the {} unseen readings lie in the 90 % predictive band."
    ).format(
        how, which, factor(mean), spread, factor(_pooled(seen)), percent(inside), readings
    )  # fmt: skip


def _pooled(scores: Sequence[GroupScore]) -> float:
    """Mean of the groups' log RMSE, as `holdout_log_rmse` is."""
    return float(np.mean([s.log_rmse for s in scores]))


def _what_is_not_determined(run: Run) -> Markup:
    symbols = _symbols(run)
    physical = _physical(run)
    open_ones = [s for s in physical if s.verdict == "not determined"]
    parts: list[Markup] = []
    if open_ones:
        parts.append(Markup("the data say nothing of {}").format(listed(symbols[s.name] for s in open_ones)))
    parts += [
        Markup("{} has only {} limit ({})").format(
            symbols[s.name], "an upper" if s.verdict == "bounded above" else "a lower", _value(run, s)
        )
        for s in physical
        if s.verdict.startswith("bounded")
    ]
    if not parts:
        head = "all physical parameters are"
        parts.append(Markup(f"nothing among the physical parameters: {head} determined"))
    scatter = [s for s in run.summary.parameters[run.fit.n_physical :] if s.verdict == "not determined"]
    if scatter:
        parts.append(Markup("of the scatter, {} {} the prior").format(
            listed(symbols[s.name] for s in scatter), "follows" if len(scatter) == 1 else "follow"
        ))  # fmt: skip
    strange = [s for s in run.summary.parameters if _implausible(s)]
    if strange:
        parts.append(
            Markup("{} {} out at a value that the prior held implausible").format(
                listed(symbols[s.name] for s in strange), "comes" if len(strange) == 1 else "come"
            )
        )
    return Markup("<strong>Not determined:</strong> ") + Markup("; ").join(parts) + "."


def _summary_picture(
    validation: Validation, predictions: Sequence[Prediction], sweeps: Sequence[figures.Sweep]
) -> Picture:
    triples = list(zip(validation.groups, predictions, sweeps, strict=True))
    seen = [t for t in triples if t[0].role == "fit"]
    unseen = sorted((t for t in triples if t[0].role == "holdout"), key=lambda t: t[0].log_rmse)
    typical = unseen[len(unseen) // 2 : len(unseen) // 2 + 1]
    examples = [(p, s) for _, p, s in [*seen[:1], *typical]]
    listing = "; ".join(f"group {s.group} {_role_text(s)} {factor(s.log_rmse)}" for s in validation.groups[:20])
    below = (
        f"Below, fitted group {seen[0][0].group} and, of those the fit never saw, the one of median score,"
        f" group {typical[0][0].group}."
        if typical
        else f"Below, fitted group {seen[0][0].group}."
    )
    return Picture(
        figure_data_uri(figures.summary_figure(validation.groups, sweeps, examples)),
        f"Typical factor between prediction and reading: {listing}.",
        f"Above, how far the prediction is off in each group: ×1 would be perfect. {below} Line: predicted median."
        " Dark band: 90 % of the model. Light band: where 90 % of readings should fall.",
    )


# Parameters -----------------------------------------------------------------------------------------------------


def _implausible(s: ParameterSummary) -> bool:
    return not s.prior_lower <= s.median <= s.prior_upper


def _value(run: Run, s: ParameterSummary) -> str:
    """The value as far as the data support it."""
    unit = unit_text(next(e.unit for e in run.fit.parameters if e.name == s.name))
    low, high = limits(s.profile) if s.profile else (None, None)
    if s.verdict == "bounded above" and high is not None:
        text = f"at most {number(high, high)}"
    elif s.verdict == "bounded below" and low is not None:
        text = f"at least {number(low, low)}"
    elif s.verdict == "not determined":
        return "not determined"
    else:
        text = number(s.median, (s.upper - s.lower) / 2)
    return f"{text} {unit}".rstrip()


def _parameter_rows(run: Run) -> list[list[Any]]:
    rows: list[list[Any]] = []
    symbols = _symbols(run)
    for e, s in zip(run.fit.parameters, run.summary.parameters, strict=True):
        spread = (s.upper - s.lower) / 2
        rows.append(
            [
                Markup("{} <span class='soft'>{}</span>").format(symbols[s.name], e.description),
                _value(run, s),
                f"{interval(s.lower, s.upper, spread)} {unit_text(e.unit)}".rstrip(),
                f"{interval(s.prior_lower, s.prior_upper)} {unit_text(e.unit)}".rstrip(),
                {"text": s.verdict, "kind": _KINDS[s.verdict]},
                {"text": "implausible under the prior", "kind": "bad"} if _implausible(s) else "inside the prior",
                f"{s.r_hat:.3f}",
                f"{s.ess_bulk:.0f}",
                f"{s.ess_tail:.0f}",
            ]
        )
    return rows


def _marginals(run: Run) -> list[figures.Marginal]:
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


def _marginal_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> list[Picture]:
    pictures = []
    for m, s in zip(marginals, run.summary.parameters, strict=True):
        unit = unit_text(m.entry.unit)
        pictures.append(
            Picture(
                figure_data_uri(figures.marginal_figure(m)),
                f"Prior and posterior density of {m.entry.description}: prior 90 % interval"
                f" {interval(*m.prior_interval)} {unit}, posterior {interval(*m.interval)} {unit};"
                f" {s.verdict}{', with the profile likelihood' if m.profile else ''}.",
                f"{m.entry.description[:1].upper()}{m.entry.description[1:]}. {s.text.replace(' um', ' µm')}.",
            )
        )
    return pictures


def _minima(run: Run) -> dict[str, Any]:
    fit = run.fit
    best = fit.minima[0]
    symbols = _symbols(run)
    columns: list[Any] = [
        {"label": "Rank", "numeric": False},
        {"label": "Starts that ended here", "numeric": True},
        {"label": "Log posterior", "numeric": True},
        {"label": "Below the best", "numeric": True},
    ]
    for e in fit.parameters:
        unit = unit_text(e.unit)
        columns.append({"label": symbols[e.name] + (f" ({unit})" if unit else ""), "numeric": True})
    rows = [
        [
            f"{rank}",
            f"{m.starts} of {fit.n_starts}",
            f"{m.log_posterior:.2f}".replace("-", "\N{MINUS SIGN}"),
            f"{best.log_posterior - m.log_posterior:.2f}",
            *(number(m.values[e.name]) for e in fit.parameters),
        ]
        for rank, m in enumerate(fit.minima[:_MAX_MINIMA], 1)
    ]
    text = f"{count(fit.n_starts, 'start')} drawn from the prior ended in {len(fit.minima)} distinct"
    text += " minimum" if len(fit.minima) == 1 else " minima"
    text += f"; the best was reached {count(best.starts, 'time')}"
    if fit.n_failed:
        text += f", and {count(fit.n_failed, 'start')} failed"
    text += f" ({fit.n_evaluations} evaluations)."
    if len(fit.minima) > 1:
        gap = best.log_posterior - fit.minima[1].log_posterior
        text += (
            f" The next best lies {gap:.1f} lower in log posterior, so its density is smaller by a factor of"
            f" {number(math.exp(min(gap, 600.0)))}."
        )
    if best.starts < 3 < fit.n_starts:
        text += " So few starts found the best that a better one may have been missed."
    return {
        "text": text,
        "columns": columns,
        "rows": rows,
        "more": max(0, len(fit.minima) - _MAX_MINIMA),
    }


# Groups ---------------------------------------------------------------------------------------------------------


def _role_text(s: GroupScore | Prediction) -> str:
    return "fitted" if s.role == "fit" else "not seen by the fit"


def _role_cell(s: GroupScore) -> dict[str, str]:
    return {"text": "fitted" if s.role == "fit" else "unseen", "kind": s.role}


def _swept(sweep: figures.Sweep) -> str:
    return {"frequency": "drive frequency", "amplitude": "drive amplitude"}.get(sweep.variable, "reading")


def _group_pictures(
    validation: Validation, predictions: Sequence[Prediction], sweeps: Sequence[figures.Sweep]
) -> list[Picture]:
    pictures = []
    for s, p, w in zip(validation.groups, predictions, sweeps, strict=True):
        y, zeros = p.group.launch_range_um, int((p.group.launch_range_um == 0).sum())
        alt = (
            f"Launch range against {_swept(w)}, group {s.group}, {w.condition}, {_role_text(s)}: measured"
            f" {number(float(y.min()))} to {number(float(y.max()))} µm, predicted median"
            f" {number(float(p.median.min()))} to {number(float(p.median.max()))} µm."
        )
        caption = (
            f"{s.verdict[:1].upper()}{s.verdict[1:]}. Log RMSE {s.log_rmse:.3f} over {count(s.n_points, 'reading')}."
        )
        if zeros:
            caption += f" {zeros} of them {'is' if zeros == 1 else 'are'} zero."
        if p.group.sigma_um is not None:
            caption += " Bars: the readings’ own standard uncertainty."
        pictures.append(Picture(figure_data_uri(figures.group_figure(p, w)), alt, caption))
    return pictures


def _residual_pictures(
    validation: Validation, predictions: Sequence[Prediction], sweeps: Sequence[figures.Sweep]
) -> list[Picture]:
    errors = [log_ratio(p.median, p.group.launch_range_um) for p in predictions]
    limit = figures.residual_limit(errors)
    pictures = []
    for i, (s, p, w) in enumerate(zip(validation.groups, predictions, sweeps, strict=True)):
        others = [
            (sweeps[j], errors[j])
            for j in range(len(errors))
            if j != i and sweeps[j].variable == w.variable != "order" and sweeps[j].log == w.log
        ]
        # Where readings should lie, seen as an error of the median.
        band = (log_ratio(p.median, p.upper), log_ratio(p.median, p.lower))
        worst = int(np.argmax(np.abs(errors[i])))
        at = {"frequency": " Hz", "amplitude": " V"}.get(w.variable, "")
        place = f"{'reading ' if not at else ''}{w.values[worst]:g}{at}"
        ratio = f"×{factor(float(errors[i][worst]))}"
        pictures.append(
            Picture(
                figure_data_uri(figures.residual_figure(p, w, errors[i], band, others, limit)),
                f"Predicted over measured against {_swept(w)}, group {s.group}, {_role_text(s)}: mean ×"
                f"{factor(s.log_bias)}, furthest from one {ratio} at {place}.",
                f"On average ×{factor(s.log_bias)}; furthest off ×{factor(float(errors[i][worst]))} at {place}.",
            )
        )
    return pictures


def _score_row(s: GroupScore) -> list[Any]:
    return [
        f"Group {s.group}",
        _role_cell(s),
        str(s.n_points),
        f"{s.log_rmse:.3f}",
        f"×{factor(s.log_rmse)}",
        f"×{factor(s.log_bias)}",
        percent(s.coverage_50),
        percent(s.coverage_90),
        f"{s.crps_um:.2f} µm",
        f"{s.elpd_per_point:.2f}".replace("-", "\N{MINUS SIGN}"),
        p_value(s.pit_p_value),
    ]


def _pit_pictures(predictions: Sequence[Prediction], sweeps: Sequence[figures.Sweep]) -> list[Picture]:
    pictures = []
    for p, w in zip(predictions, sweeps, strict=True):
        pit = p.pit[p.group.launch_range_um > 0]
        if pit.size == 0:
            continue
        bins = 10 if pit.size >= 30 else 5
        low, high = (float(x) for x in binom.interval(0.9, pit.size, 1 / bins))
        edge = percent(float(np.mean((pit < 1 / bins) | (pit >= 1 - 1 / bins))))
        pictures.append(
            Picture(
                figure_data_uri(figures.pit_figure(p, w, pit, (low, high), bins)),
                f"Histogram of the probability integral transforms of group {p.group.id}, {_role_text(p)}:"
                f" {edge} of {pit.size} readings in the two outermost of {bins} bins, {percent(2 / bins)} expected.",
                f"{edge} of {count(pit.size, 'reading')} in the two outermost bins, where {percent(2 / bins)} belong.",
            )
        )
    return pictures


# Posterior and sampler ------------------------------------------------------------------------------------------


def _corner_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> dict[str, Picture]:
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
            f"{m.entry.name} {interval(*m.interval, (m.interval[1] - m.interval[0]) / 2)} {unit_text(m.entry.unit)}"
            for m in part
        )
        found[key] = Picture(
            figure_data_uri(figure),
            f"Corner plot of {what}, 90 % intervals: {pairs}.",
            f"Posterior of {what}, singly and in pairs; regions hold 50 and 90 % of the draws. Red: the best optimum."
            " Grey on the diagonal: the prior’s 90 % interval, where it reaches into view. A slanted region is a"
            " combination that the data fix better than either parameter.",
        )
    return found


def _trace_pictures(run: Run, marginals: Sequence[figures.Marginal]) -> list[Picture]:
    return [
        Picture(
            figure_data_uri(figures.trace_figure(m, run.draws.values[..., i], run.summary.thinning)),
            f"Chains of {m.entry.description}: R-hat {s.r_hat:.3f},"
            f" autocorrelation time {s.autocorrelation_time:.0f} steps.",
            f"R-hat {s.r_hat:.3f}; autocorrelation time {s.autocorrelation_time:.0f} steps.",
        )
        for i, (m, s) in enumerate(zip(marginals, run.summary.parameters, strict=True))
    ]


def _health(run: Run) -> list[list[Any]]:
    s = run.summary
    verdict = {"text": "converged" if s.converged else "not converged", "kind": "good" if s.converged else "bad"}
    return [
        ["Verdict", verdict, s.message],
        ["Walkers", str(s.n_walkers), "emcee: differential evolution and stretch moves"],
        ["Steps of each walker", f"{s.n_steps}", f"of which {s.burn_in} burn-in"],
        ["Acceptance", percent(s.acceptance), "moves accepted; 20 to 50 % is healthy"],
        ["Length after burn-in", f"{s.autocorrelation_times:.0f}", "autocorrelation times of the slowest parameter"],
        ["Kept", f"{run.draws.values.shape[0] * run.draws.values.shape[1]} draws", f"every {s.thinning}th step"
         if s.thinning > 1 else "every step"],
        ["Largest R-hat", f"{max(p.r_hat for p in s.parameters):.3f}", "rank-normalised split R-hat; 1 is mixed"],
        ["Smallest effective sample", f"{min(min(p.ess_bulk, p.ess_tail) for p in s.parameters):.0f}",
         "independent draws that the worst estimate is worth"],
    ]  # fmt: skip


def _prior_rows(run: Run) -> list[list[Any]]:
    symbols = _symbols(run)
    return [
        [
            Markup("{} <span class='soft'>{}</span>").format(symbols[e.name], e.description),
            unit_text(e.unit) or "–",
            e.prior,
            interval(e.lower, e.upper),
            e.source,
        ]
        for e in run.fit.parameters
    ]


# Numerics and provenance ----------------------------------------------------------------------------------------


def _numerics(run: Run) -> dict[str, Any]:
    limit = _explicit_step_limit(run)
    return {
        "engine": run.fit.engine,
        "exact": run.fit.engine == "closed form",
        "limit_us": None if limit is None else f"{1e6 * limit:.4g}",
        "study_us": f"{1e6 * STUDY_STEP:g}",
        "ratio": None if limit is None else f"{STUDY_STEP / limit:.3g}",
        "stable": limit is not None and limit >= STUDY_STEP,
    }


def _explicit_step_limit(run: Run) -> float | None:
    """Largest stable step of the study's integrator at the best optimum, s; None where this version cannot tell."""
    name = "psafit.simulate.stability"
    if importlib.util.find_spec(name) is None:
        return None
    best = run.fit.minima[0].values
    theta = np.array([best[e.name] for e in run.fit.parameters[: run.fit.n_physical]])
    return float(importlib.import_module(name).explicit_step_limit(run.problem.experiment.constants, theta))


def _facts(run: Run, command: str) -> list[list[str]]:
    facts = [
        ["Data", run.fit.title],
        ["Source", run.fit.source or "not given"],
        ["Run folder", run.folder.name],
        ["Seed", str(run.fit.seed)],
        ["Identity of the run (SHA-256)", run.fit.identity],
        ["Fingerprint of the data (SHA-256)", run.fit.fingerprint],
        ["Versions", ", ".join(f"{name} {version}" for name, version in run.fit.versions.items())],
    ]
    if command:
        facts.insert(2, ["Command", without_paths(command)])
    return facts

"""The report of a fit: what was fitted, what it predicts, what the data do not determine."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup, escape

from psafit.diagnose.answer.besides import Redefined
from psafit.inference.evidence import TRUSTED
from psafit.inference.identify import one_sided
from psafit.inference.run_folder import Run
from psafit.inference.samplers import sampler
from psafit.inference.summary import overdamped
from psafit.observables import LAUNCH_RANGE, named
from psafit.physics import redefined
from psafit.records import GroupScore, Numerics, ParameterSummary, SessionSummary, Validation
from psafit.report import figures, fit_pictures
from psafit.report.catalogue import TITLES
from psafit.report.fit_pictures import Shown
from psafit.report.page import render
from psafit.report.page_words import PAGE
from psafit.report.wording import (
    NBSP,
    compared,
    exact,
    factor,
    groups,
    interval,
    listed,
    noted,
    number,
    offsets,
    p_value,
    percent,
    rounded,
    span,
    symbol_html,
    typeset,
    unit_text,
    with_unit,
)
from psafit.text import count, fixed, prefixed
from psafit.validate import (
    Prediction,
    Predicts,
    caution,
    coverage,
    objection,
    predicts,
    shows_trends,
    some_draws,
    trends,
    without_each,
)

REPORT = "report.html"

_ONE_SIDED = {"bounded above": "no lower limit", "bounded below": "no upper limit"}
# How the page says whether the fit predicts what it has not seen: the verdict, its colour, and a sentence's beginning.
_PREDICTS: dict[Predicts, tuple[str, str, str]] = {
    "not tested": ("no group left to predict", "warn", ""),
    "yes": ("predicts", "good", "Yes: the fit predicts"),
    "not everywhere": (
        "comes near, not everywhere",
        "warn",
        "Not quite: the fit comes near, but not in every group, for",
    ),
    "too sure": ("comes near, too sure", "warn", "Not quite: the fit comes near, but is surer than it may be, for"),
    "too unsure": (
        "comes near, too unsure",
        "warn",
        "Not quite: the fit comes near, but is less sure than it may be, for",
    ),
    "misses a trend": ("comes near, misses a trend", "warn", "Not quite: the fit comes near, but misses a trend, for"),
    "roughly": ("roughly predicts", "warn", "Not quite: the fit roughly predicts"),
    "no": ("does not predict", "bad", "No: the fit does not predict"),
}
_KINDS = {"determined": "good", "bounded above": "warn", "bounded below": "warn", "not determined": "bad"}


def write_report(
    run: Run, validation: Validation, predictions: list[Prediction], numerics: Numerics, *, draws_without: int = 200
) -> Path:
    """Write `report.html` into the run's folder.

    Parameters
    ----------
    run : Run
    validation : Validation
    predictions : list of Prediction
        Of the same run, in the order of the validation's groups.
    draws_without : int
        Posterior draws that are looked at without each cause: a median of them is to be seen, not to be scored.

    Returns
    -------
    Path
        Of the page.
    """
    few = some_draws(run, draws_without)
    shown = fit_pictures.shown_groups(validation, predictions, lambda group: without_each(run.problem, few, [group]))
    pictured = fit_pictures.pictured(shown)
    marginals = fit_pictures.marginals(run)
    left = run.not_determined
    rows = list(zip(run.summary.parameters, parameter_rows(run, bool(caution(validation))), strict=True))
    content = {
        "offsets": offsets(g.prediction.group for g in shown),
        "title": f"Fit of {groups(run.fit.groups).unescape()}: {run.fit.title}",
        "warning": None if run.summary.converged else run.summary.message,
        "verdict": verdict_of(validation),
        "sentences": [what_was_fitted(run), what_it_predicts(validation), _what_is_wrong(run, validation)],
        "tiles": tiles_of(validation),
        "summary": fit_pictures.summary_picture(pictured),
        "explorable": fit_pictures.explorable(shown),
        "extended": bool(run.fit.terms),
        "parameters": [row for s, row in rows if s.name not in left],
        "open_parameters": [row for s, row in rows if s.name in left],
        "caution": caution(validation),
        "sessions": [_session_row(s) for s in run.summary.sessions or []],
        "implausible": [s for s in run.summary.parameters if s.implausible],
        "minima": _minima(run),
        "marginals": fit_pictures.marginal_pictures(run, marginals),
        "group_pictures": fit_pictures.group_pictures(pictured),
        "residual_pictures": fit_pictures.residual_pictures(pictured),
        "scores": [_score_row(g) for g in shown],
        "verdicts": [(f"Group {g.name}", _role_cell(g.score), g.score.verdict) for g in shown],
        "holdout_log_rmse": validation.holdout_log_rmse,
        "n_draws": validation.n_draws,
        "pit_pictures": fit_pictures.pit_pictures(pictured),
        "left_out": len(shown) - len(pictured),
        "corners": fit_pictures.corner_pictures(run, marginals),
        "health": _health(run),
        "importance": _importance(run),
        "traces": fit_pictures.trace_pictures(run, marginals) if sampler(run.fit.sampled_by).chained else [],
        "priors": _prior_rows(run),
        "lmfit_report": run.fit.lmfit_report,
        "numerics": numerics_content(numerics),
        "data_warnings": run.problem.experiment.warnings,
        "facts": _facts(run),
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


def what_was_fitted(run: Run) -> Markup:
    """The groups, the readings and the model, in a sentence."""
    fitted = run.problem.experiment.select(run.fit.groups)
    readings = sum(g.n_points for g in fitted)
    ranges = all(g.observables == (LAUNCH_RANGE,) for g in fitted)
    symbols = _symbols(run)
    names = listed(
        Markup("{} {}").format(e.description, symbols[e.name]) if run.fit.n_physical <= 4 else symbols[e.name]
        for e in run.fit.parameters[: run.fit.n_physical]
    )
    terms = Markup(" extended by {}").format(listed(run.fit.terms)) if run.fit.terms else ""
    where = listed(
        f"{g.id} ({sweep.condition}, {sweep.extent}{'' if ranges else f': {listed(o.titles for o in g.observables)}'})"
        for g, sweep in zip(fitted, map(figures.sweep_of, fitted), strict=True)
    )
    return Markup(
        "<strong>Fitted:</strong> {} of the baseline{}, and the scatter of a reading, to the {} of {} {}."
    ).format(names, terms, count(readings, "reading"), "group" if len(fitted) == 1 else "groups", where)


def what_it_predicts(validation: Validation) -> Markup:
    """How well unseen groups are predicted, in a sentence."""
    unseen, seen = _informative(validation, "holdout"), _informative(validation, "fit")
    name = dict(zip(validation.groups, fit_pictures.names_of(validation), strict=True))
    if not unseen:
        held_out = any(s.role == "holdout" for s in validation.groups)
        why = "there is no group that could show it" if held_out else "every group was fitted"
        return Markup(
            "<strong>Does it predict what it has not seen?</strong> Not tested: {}, so nothing is left to test the"
            " prediction on. The fitted readings themselves are typically off by {}."
        ).format(why, listed(f"×{factor(s.log_rmse)} for group {name[s]}" for s in seen))
    mean = validation.holdout_log_rmse
    assert mean is not None  # there are groups it is the mean of
    readings = sum(s.n_points for s in unseen)
    best = min(unseen, key=lambda s: s.log_rmse)
    worst = max(unseen, key=lambda s: s.log_rmse)
    word, against = predicts(validation)
    ids = list(dict.fromkeys(s.group for s in unseen))
    which = groups(ids) if len(ids) <= 6 else f"the {len(ids)} other groups"
    if against:
        which = Markup("{}. All that it has not seen").format(groups([name[s] for s in against]))
    spread = (
        Markup(", from ×{} for group {} to ×{} for group {}").format(
            factor(best.log_rmse), name[best], factor(worst.log_rmse), name[worst]
        )
        if len(unseen) > 1
        else ""
    )
    return Markup(
        "<strong>Does it predict what it has not seen?</strong> {} {}: typically a factor of {} off{}. The fitted"
        " readings themselves are off by ×{}. Of the {} unseen readings, {} lie in the 90 % predictive band."
    ).format(
        _PREDICTS[word][2], which, factor(mean), spread, factor(_mean_log_rmse(seen)), readings,
        percent(coverage(unseen)),
    )  # fmt: skip


def verdict_of(validation: Validation) -> dict[str, str]:
    """Whether the fit predicts what it never saw, in a word; never in green where its values may be off."""
    text, kind, _ = _PREDICTS[predicts(validation)[0]]
    if kind == "good" and caution(validation):
        return {"text": f"{text}, values in doubt", "kind": "warn"}
    return {"text": text, "kind": kind}


def _what_is_wrong(run: Run, validation: Validation) -> Markup:
    named = zip(fit_pictures.names_of(validation), validation.groups, strict=True)
    trending = trends(validation.groups)
    drifting = [name for name, s in named if s in trending]
    able = [s for s in validation.groups if shows_trends(s)]
    some = "" if len(able) == len(validation.groups) else f" ({len(able)} of {len(validation.groups)})"
    trend = Markup("{}; <code>psafit diagnose</code> looks for more than that.").format(
        f"Along no sweep that could show it{some} do the errors drift"
        if able
        else "No sweep has readings enough to show a drift of the errors"
    )
    if drifting:
        trend = Markup(
            "In {} the errors drift along the sweep: the model misses a trend, and <code>psafit diagnose</code> looks"
            " for its cause."
        ).format(groups(drifting))
    head = Markup("<strong>What is wrong?</strong>")
    said = [head, trend, *_on_all_readings(validation), _what_is_not_determined(run), *_what_is_implausible(run)]
    if lagging := overdamped(run.problem, run.summary.parameters):
        text = re.sub(r"\b[a-z]_[a-z]\b", lambda found: symbol_html(found[0]), escape(typeset(lagging.text)))
        said.append(Markup("{}.").format(Markup(text[:1].upper() + text[1:])))
    if other := redefined(run.problem.ids):
        said.append(Markup(Redefined(other).say(PAGE)))
    return Markup(" ").join(said)


def _on_all_readings(validation: Validation) -> list[Markup]:
    """What the tests of misfit say of the model, fitted to all groups, where they were made."""
    whole = validation.all_groups
    if whole is None:
        return []
    passes = f"fitted to all readings, the model passes the tests of misfit (p = {whole.p_value:.2f})"
    said = objection(validation) or passes
    return [Markup("{}.").format(said[0].upper() + said[1:])]


def _informative(validation: Validation, role: str) -> list[GroupScore]:
    """The groups of a role that enter means; all of them where none shows anything."""
    scores = [s for s in validation.groups if s.role == role]
    informative = [s for s in scores if s.informative]
    return informative if informative or role == "holdout" else scores


def _mean_log_rmse(scores: Sequence[GroupScore]) -> float:
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
        if s.verdict in _ONE_SIDED
    ]
    if not parts:
        parts.append(Markup("nothing among the physical parameters: if the model is right, the data fix them all"))
    first = run.problem.n_model
    for what, those in (
        ("what sessions have for themselves", run.summary.parameters[run.fit.n_physical : first]),
        ("the scatter", run.summary.parameters[first:]),
    ):
        undetermined = list(dict.fromkeys(symbols[s.name] for s in those if s.verdict == "not determined"))
        if undetermined:
            verb = "follows" if len(undetermined) == 1 else "follow"
            parts.append(Markup("of {}, {} {} the prior").format(what, listed(undetermined), verb))
    return Markup("Not determined: ") + Markup("; ").join(parts) + "."


def _what_is_implausible(run: Run) -> list[Markup]:
    symbols = _symbols(run)
    strange = [s for s in run.summary.parameters if s.implausible]
    if not strange:
        return []
    units = {e.name: e.unit for e in run.fit.parameters}
    text = Markup("{} (its prior expects {})")
    each = (text.format(symbols[s.name], span((s.prior_lower, s.prior_upper), units[s.name])) for s in strange)
    return [Markup("Implausible: {}.").format(listed(each))]


def tiles_of(validation: Validation) -> list[dict[str, str]]:
    """The three numbers of the first screen."""
    unseen, seen = _informative(validation, "holdout"), _informative(validation, "fit")
    tiles = [{"value": f"×{factor(_mean_log_rmse(seen))}", "label": "typical factor, fitted readings" + _spread(seen)}]
    if unseen:
        tiles.append(
            {"value": f"×{factor(_mean_log_rmse(unseen))}", "label": "typical factor, unseen groups" + _spread(unseen)}
        )
    label = f"of the {'unseen' if unseen else 'fitted'} readings in the 90{NBSP}% band; 90{NBSP}% belong there"
    return [*tiles, {"value": percent(coverage(unseen or seen)), "label": label}]


def _spread(scores: Sequence[GroupScore]) -> str:
    """Factors of the best and the worst group, in words; nothing where there is one group."""
    errors = [s.log_rmse for s in scores]
    return f"; ×{factor(min(errors))} to ×{factor(max(errors))}" if len(errors) > 1 else ""


# Parameters -----------------------------------------------------------------------------------------------------


def _value(run: Run, s: ParameterSummary) -> str:
    """The value as far as the data support it."""
    given = next(e.unit for e in run.fit.parameters if e.name == s.name)
    low, high = one_sided(s.profile, (s.lower, s.upper))
    unit, (median, lower, upper) = prefixed(given, s.median, s.lower, s.upper)
    if s.verdict == "bounded above" and high is not None:
        unit, (high,) = prefixed(given, high)
        text = f"at most {number(high, high)}"
    elif s.verdict == "bounded below" and low is not None:
        unit, (low,) = prefixed(given, low)
        text = f"at least {number(low, low)}"
    elif s.verdict == "not determined":
        return "not determined"
    else:
        text = number(median, (upper - lower) / 2)
    return with_unit(text, unit)


def _session_row(s: SessionSummary) -> list[str]:
    unit, (median, lower, upper) = prefixed(s.unit, s.median, s.lower, s.upper)
    spread = (upper - lower) / 2
    value, ends = with_unit(number(median, spread), unit), with_unit(interval(lower, upper, spread), unit)
    return [TITLES.get(s.cause, s.cause), f"{s.where[0].upper()}{s.where[1:]}", s.what, value, ends]


def parameter_rows(run: Run, doubted: bool) -> list[list[Any]]:
    """What the readings say of each parameter; what is determined is so if the model is right."""
    rows: list[list[Any]] = []
    symbols = _symbols(run)
    for e, s in zip(run.fit.parameters, run.summary.parameters, strict=True):
        unit, (_, lower, upper) = prefixed(e.unit, s.median, s.lower, s.upper)
        other, plausible = prefixed(e.unit, s.prior_lower, s.prior_upper)
        prior = Markup("{}").format(with_unit(interval(*plausible), other))
        if s.implausible:
            prior += Markup("<br><span class='badge bad'>implausible under the prior</span>")
        rows.append(
            [
                noted(symbols[s.name], e.description),
                _value(run, s),
                _ONE_SIDED.get(s.verdict) or with_unit(interval(lower, upper, (upper - lower) / 2), unit),
                prior,
                {"text": s.verdict, "kind": "warn" if doubted and s.verdict == "determined" else _KINDS[s.verdict]},
                f"{s.r_hat:.4f}",
                f"{s.ess_bulk:.0f} / {s.ess_tail:.0f}",
            ]
        )
    return rows


def _minima(run: Run, most: int = 8) -> dict[str, Any]:
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
            f"{m.starts} of {fit.n_followed}",
            fixed(m.log_posterior, 2).replace("-", "\N{MINUS SIGN}"),
            f"{best.log_posterior - m.log_posterior:.2f}",
            *(number(m.values[e.name]) for e in fit.parameters),
        ]
        for rank, m in enumerate(fit.minima[:most], 1)
    ]
    found = f"{len(fit.minima)} distinct {'minimum' if len(fit.minima) == 1 else 'minima'}"
    text = f"At least two looks with starts of their own find minima, and lmfit polishes them: {found}. "
    if best.starts or fit.n_missed:
        text += f"{best.starts} of {count(fit.n_followed, 'start')} reached the best"
    else:
        text += f"None of {count(fit.n_followed, 'start')} reached the best, but hops from where they ended did"
    text += "; starts that fell behind were given up"
    if fit.n_failed:
        text += f", and {fit.n_failed} failed"
    text += f" ({fit.n_evaluations} evaluations)."
    if len(fit.minima) > 1:
        gap = best.log_posterior - fit.minima[1].log_posterior
        text += (
            f" The next best lies {gap:.1f} lower in log posterior, so its density is smaller by a factor of"
            f" {number(math.exp(min(gap, 600.0)))}."
        )
    if fit.n_missed:
        text += f" The search had missed {count(fit.n_missed, 'better one')}, which the sampler then found."
    return {
        "text": text,
        "columns": columns,
        "rows": rows,
        "more": max(0, len(fit.minima) - most),
    }


# Groups ---------------------------------------------------------------------------------------------------------


def _role_cell(s: GroupScore) -> dict[str, str]:
    return {"text": "fitted" if s.role == "fit" else "unseen", "kind": s.role}


def _crps(s: GroupScore) -> str:
    """CRPS of a group with its unit, to a hundredth or so of the error metric's offset."""
    o = named(s.observable)
    return f"{fixed(s.crps, 1 - math.floor(math.log10(o.offset)))} {unit_text(o.unit)}"


def _score_row(shown: Shown) -> list[Any]:
    s = shown.score
    return [
        f"Group {shown.name}",
        _role_cell(s),
        str(s.n_points),
        f"{s.log_rmse:.3f}",
        f"×{factor(s.log_rmse)}",
        f"×{factor(s.log_bias)}",
        percent(s.coverage_50),
        percent(s.coverage_90),
        _crps(s),
        fixed(s.elpd_per_point, 2).replace("-", "\N{MINUS SIGN}"),
        p_value(s.pit_p_value),
        p_value(s.drift_p_value),
    ]


# Posterior and sampler ------------------------------------------------------------------------------------------


def _health(run: Run) -> list[list[Any]]:
    s = run.summary
    verdict = {"text": "converged" if s.converged else "not converged", "kind": "good" if s.converged else "bad"}
    used, kept = sampler(run.fit.sampled_by), f"{run.draws.values.shape[0] * run.draws.values.shape[1]} draws"
    rows = [["Sampler", run.fit.sampled_by, used.about], ["Kept", kept, ""]]
    if used.chained:
        rows = [
            ["Chains", str(s.n_walkers), used.about],
            ["Steps of each", f"{s.n_steps}", f"of which {s.burn_in} burn-in"],
            ["Acceptance", percent(s.acceptance), "proposals accepted; above 20 % is healthy"],
            ["Length after burn-in", f"{s.autocorrelation_times:.0f}",
             "autocorrelation times of the slowest parameter"],
            ["Kept", kept, f"one step in {s.thinning}" if s.thinning > 1 else "every step"],
            ["Largest R-hat", f"{max(p.r_hat for p in s.parameters):.4f}",
             "rank-normalised split R-hat over ensembles of different seeds; 1 is mixed"],
        ]  # fmt: skip
    return [
        ["Verdict", verdict, s.message],
        *rows,
        ["Smallest effective sample", f"{min(min(p.ess_bulk, p.ess_tail) for p in s.parameters):.0f}",
         "independent draws that the worst estimate is worth"],
    ]  # fmt: skip


def _importance(run: Run) -> dict[str, Any]:
    """The sampler's medians and limits, and those of importance sampling, where these are another way."""
    other = run.summary.importance
    found: dict[str, Any] = {
        "text": "The values of this page are these draws.",
        "rows": [],
        "trusted": other.pareto_k < TRUSTED,
        "evidence": f"{fixed(other.log_evidence, 2)} ± {fixed(other.standard_error, 2)}".replace("-", "\N{MINUS SIGN}"),
    }
    if not sampler(run.fit.sampled_by).checked:
        return found
    symbols, worst = _symbols(run), other.furthest
    for e, own, importance in zip(run.fit.parameters, run.summary.parameters, other.parameters, strict=True):
        cells: list[Any] = []
        for one in (own, importance):
            unit, (median, lower, upper) = prefixed(e.unit, one.median, one.lower, one.upper)
            width = (upper - lower) / 2
            cells += [with_unit(number(median, width), unit), with_unit(interval(lower, upper, width), unit)]
        found["rows"].append([symbols[own.name], *cells, fixed(importance.apart, 2)])
    words = compared(worst.name, worst.apart, other.by_chance, other.effective)
    return found | {"text": typeset(words[0].upper() + words[1:]) + "."}


def _prior_rows(run: Run) -> list[list[Any]]:
    symbols = _symbols(run)
    return [
        [
            noted(symbols[e.name], e.description),
            unit_text(e.unit) or "–",
            e.prior,
            f"{exact(e.lower)} to {exact(e.upper)}",
            e.source,
        ]
        for e in run.fit.parameters
    ]


# Numerics and provenance ----------------------------------------------------------------------------------------


def numerics_content(n: Numerics) -> dict[str, Any]:
    """How far the predictions are converged, and what a fixed step would have needed, as a page says it."""
    return {
        "engine": n.engine,
        "exact": n.engine == "closed form",
        "converged": n.converged,
        "error": rounded(n.error),
        "required": rounded(n.required),
        "n_sets": n.n_sets,
        "n_points": n.n_points,
        "rows": [
            [
                rounded(r.tolerance) + (" (used)" if r.tolerance == n.tolerance else ""),
                rounded(r.worst),
                rounded(r.median),
            ]
            for r in n.refinement
        ],
        "rate": rounded(n.fastest_rate),
        "limit_us": rounded(1e6 * n.stable_step, 4),
        "common_us": exact(1e6 * n.common_step),
        "growth": rounded(n.common_growth),
        "ratio": rounded(n.common_step / n.stable_step, 3),
        "stable": n.stable_step >= n.common_step,
    }


def _facts(run: Run) -> list[list[str]]:
    facts = [
        ["Data", run.fit.title],
        ["Source", run.fit.source or "not given"],
        ["Run folder", run.folder.name],
        ["Seed", str(run.fit.seed)],
        ["Identity of the run (SHA-256)", run.fit.identity],
        ["Fingerprint of the data (SHA-256)", run.fit.fingerprint],
        ["Versions", ", ".join(f"{name} {version}" for name, version in run.fit.versions.items())],
    ]
    if run.fit.command:
        facts.insert(2, ["Command", run.fit.command])
    return facts

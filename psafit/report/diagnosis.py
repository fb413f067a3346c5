"""The report of a diagnosis: what is wrong, which causes it has, what naming them is worth, what to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from psafit.arrays import FloatArray
from psafit.compare import Predicted, read_predictions
from psafit.diagnose.answer import Searched
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.record import PAGE, Diagnosis
from psafit.diagnose.show import Line
from psafit.diagnose.words import PLAIN
from psafit.experiment import Experiment
from psafit.inference.run import load
from psafit.numerics import audit
from psafit.report import diagnosis_answer as answer
from psafit.report import diagnosis_pictures, figures
from psafit.report import diagnosis_tables as tables
from psafit.report import diagnosis_words as words
from psafit.report.catalogue import TITLES, model
from psafit.report.diagnosis_pictures import Shown
from psafit.report.fit import numerics_content, write_report
from psafit.report.page import render, worst
from psafit.report.wording import (
    NBSP,
    compared,
    offsets,
    percent,
    typeset,
)
from psafit.validate import log_ratio, root_mean_square, validate

_LOOKS: Final = {"baseline": ("baseline", "grey"), "extended": ("extended model", "vermillion")}


def write_diagnosis(result: Diagnosis, experiment: Experiment, folder: Path) -> Path:
    """Write `diagnosis.html`, and the pages of the extension's runs next to it.

    Parameters
    ----------
    result : Diagnosis
    experiment : Experiment
        That was diagnosed.
    folder : Path
        Where the page goes.

    Returns
    -------
    Path
        Of the page.
    """
    for place in {run.folder for run in result.extension.values()}:
        if (folder / place).is_dir():
            extension = load(folder / place)
            write_report(extension, *validate(extension), audit(extension))
    shown = shown_groups(result, experiment, folder)
    # Those that the baseline misses most.
    pictured = [shown[i] for i in worst([max(g.errors, default=0.0) for g in shown])]
    best_model = words.best_model_of(result)
    content = {
        "title": f"Diagnosis: {result.title}",
        "verdict": {"text": result.verdict, "kind": answer.kind(result)},
        "sentences": answer.first_screen(result),
        "own_sentences": result.sentences,
        "searched": Searched(result.looked_at, result.settings.search.missed).say(PLAIN),
        "no_other": result.looked_at.no_other("set of causes").capitalize(),
        "tiles": answer.tiles(result, shown),
        "summary": diagnosis_pictures.summary_picture(pictured),
        "explorable": diagnosis_pictures.explorable(shown),
        "overview": diagnosis_pictures.overview_pictures(pictured),
        "left_out": len(shown) - len(pictured),
        "zeros": any(figures.has_zeros(g.group, g.curves) for g in pictured),
        "extended": "extended" in result.show,
        **_misfit(result, experiment),
        "models": tables.model_rows(result),
        "all_groups": ",".join(str(g) for g in result.groups),
        "best_model": None
        if best_model is None
        else {
            "name": model(best_model.terms),
            "rows": tables.parameter_rows(best_model),
            "options": ",".join(best_model.terms),
        },
        "other_models": [
            {"name": model(c.terms), "rows": tables.parameter_rows(c)} for c in result.causes if c is not best_model
        ],
        "influence": diagnosis_pictures.influence_pictures(result.influence, pictured) if result.influence else [],
        "leaning": tables.leaning(result, shown),
        "robustness": tables.robustness(result, best_model),
        "best_model_listed": best_model is result.best_model,
        "mostly_unnamed": result.mostly_unnamed,
        **_remaining(result, shown),
        "quick": result.quick,
        "gains": [tables.gain(one) for one in result.gain.values()],
        "extension": {"adopted": None, "strict": None}
        | {
            which: vars(run) | {"model": model(run.terms), "compared": typeset(compared(**vars(run.importance)))}
            for which, run in result.extension.items()
        },
        "ledger": tables.ledger(result.ledger),
        "begun": any(entry.led_to is not None for entry in result.ledger),
        **_next(result),
        "calibration": tables.calibration(result.calibration),
        "numerics": numerics_content(result.numerics),
        "data_warnings": experiment.warnings,
        "facts": _facts(result, experiment),
        "alpha": percent(ALPHA),
        "offsets": offsets(g.group for g in shown),
        "provenance": {
            "psafit": result.versions.get("psafit", "?"),
            "seed": result.seed,
            "data": result.fingerprint[:12],
        },
    }
    return render("diagnosis.html.j2", folder / PAGE, **content)


def _misfit(result: Diagnosis, experiment: Experiment) -> dict[str, Any]:
    """What is wrong with the baseline, and where."""
    return {
        "where": tables.where(result.misfit.where),
        "where_after": tables.where(result.misfit.extended.where or [] if result.misfit.extended else []),
        "growth": tables.growth(result, experiment),
        "no_growth": tables.without_growth(result),
        "rejected": result.misfit.p_value < ALPHA,
        "scatter": tables.scatter(result),
        "drift": tables.drift_rows(result),
        "corners": tables.corner_rows(result),
        "sessions": tables.session_rows(result.misfit.sessions),
    }


def _remaining(result: Diagnosis, shown: list[Shown]) -> dict[str, Any]:
    """What each cause could add, and what the named ones leave."""
    return {
        "screening_pictures": diagnosis_pictures.screening_pictures(result.screening, TITLES, result.named),
        "screening": tables.screening_rows(result.screening),
        "alternatives": tables.alternatives(result),
        "tests_before": tables.tests(result.misfit.baseline),
        "search": tables.search(result.misfit.search),
        "tests_after": tables.tests(result.misfit.extended) if result.misfit.extended else None,
        "discrepancy": tables.discrepancy(result, shown),
    }


def _next(result: Diagnosis) -> dict[str, Any]:
    """What to measure next, and how that would go."""
    return {
        "proposals": tables.proposals(result.next_experiment),
        "confusion": tables.rehearsal(result.confusion.repeated) if result.confusion.repeated else None,
        "confounded": tables.confounded(result.confusion.alike),
        "rehearsals": [tables.rehearsal(one) for one in result.next_experiment.rehearsals or []],
    }


def _predicted(path: Path, model: str | None = None) -> dict[str, Predicted]:
    """What a table next to the record says of each group; nothing where it is not there."""
    return {str(t.group.id): t for t in read_predictions(path, model)} if path.is_file() else {}


def _band(given: Predicted | None, n: int) -> tuple[figures.Band, ...]:
    return (figures.Band(figures.READING_BAND, given.lower, given.upper),) if given and given.lower.size == n else ()


def _line(given: Line | None, gone: str | None = None) -> tuple[FloatArray, FloatArray] | None:
    """What a record says between the readings of a group, with all causes or without one; a sweep of two is none."""
    if given is None:
        return None
    at, um = np.asarray(given.at), np.asarray(given.um if gone is None else given.without_um[gone], dtype=float)
    return (at, um) if np.isfinite(um).all() else None


def shown_groups(result: Diagnosis, experiment: Experiment, folder: Path) -> list[Shown]:
    """The groups of the record with the models' predictions, which the record holds one group after the other."""
    members = experiment.select(result.groups)
    n = sum(g.n_points for g in members)
    models = {name: np.asarray(model.predicted_um, dtype=float) for name, model in result.show.items()}
    adopted = _predicted(result.table(folder, result.predictions))
    strict = result.gain.get("strict")
    unseen = _predicted(result.table(folder, strict.predictions), "extended") if strict else {}
    extended = result.show.get("extended")
    each = {id: np.asarray(v, dtype=float) for id, v in (extended.without_um if extended else {}).items()}
    without = {id: ranges for id, ranges in each.items() if ranges.size == n}
    lines = {model: {str(line.group): line for line in show.lines} for model, show in result.show.items()}
    starts = np.cumsum([0, *(g.n_points for g in members)])
    found = []
    for whole, group in ((g, part) for g in members for part in g.parts):
        part = starts[members.index(whole)] + np.flatnonzero(whole.measured == group.measured[0])
        name = group.label  # the tables next to the record hold launch ranges
        looks = {model: _LOOKS.get(model, (model, "purple")) for model, values in models.items() if values.size == n}
        last = "extended" if "extended" in looks and result.verdict != "adequate" else "baseline"
        curves = {
            model: figures.Curve(
                *look,
                models[model][part],
                _band(adopted.get(name), group.n_points) if model == last else (),
                dashed=model == "baseline",
                line=_line(lines[model].get(name)),
            )
            for model, look in looks.items()
        }
        shown = [curve for model, curve in curves.items() if model in _LOOKS]
        more = [curve for model, curve in curves.items() if model not in _LOOKS]
        if band := _band(unseen.get(name), group.n_points):
            more.append(figures.Curve("extended model without this group", "blue", unseen[name].median, band))
        finer = {id: _line(lines["extended"].get(name), id) for id in without}
        more += figures.without_curves({id: ranges[part] for id, ranges in without.items()}, TITLES, finer)
        errors = [root_mean_square(log_ratio(c.middle, group.reading, *group.observable.metric)) for c in shown]
        found.append(Shown(group, figures.sweep_of(group), shown, errors, more, part))
    return found


def _facts(result: Diagnosis, experiment: Experiment) -> list[list[Any]]:
    facts: list[list[Any]] = [
        ["Data", result.title],
        ["Source", experiment.source or "not given"],
        ["Groups", words.group_ids(result.groups)],
        ["Training groups of the strict protocol", words.group_ids(result.training)],
        ["Seed", str(result.seed)],
        ["Kind of run", "quick: the verdict alone" if result.quick else "full"],
        ["Predictions of the adopted model", result.predictions],
        ["Fingerprint of the data (SHA-256)", result.fingerprint],
        ["Versions", ", ".join(f"{name} {version}" for name, version in result.versions.items())],
        ["Time taken", ", ".join(f"{name} {s:.1f}{NBSP}s" for name, s in result.seconds.items()) or "–"],
    ]
    if result.command:
        facts.insert(2, ["Command", result.command])
    if experiment.beliefs:
        stated = (f"{b.name}: {b.prior.describe()} ({b.source})" for b in experiment.beliefs)
        facts.insert(2, ["Priors that the experiment states", "; ".join(stated)])
    return facts

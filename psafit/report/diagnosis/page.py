"""The report of a diagnosis: what is wrong, which causes it has, what naming them is worth, what to measure next."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from psafit.diagnose.answer.grounds import Searched
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.record import PAGE, Diagnosis
from psafit.diagnose.retest import kept
from psafit.diagnose.words import PLAIN
from psafit.experiment import Experiment
from psafit.inference.run_folder import load
from psafit.numerics import audit
from psafit.observables import OBSERVABLES
from psafit.physics import label
from psafit.report.diagnosis import answer, causes, gain, misfit, next_experiment, overview, remaining, words
from psafit.report.diagnosis.shown import shown_groups
from psafit.report.fit import numerics_content, write_report
from psafit.report.page import render, worst
from psafit.report.wording import NBSP, offsets, percent
from psafit.validate import table_name, validate


def write_diagnosis(result: Diagnosis, experiment: Experiment, folder: Path) -> Path:
    """Write `diagnosis.html`, and the page of each of the extension's runs.

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
            write_report(extension, *validate(extension, retest=kept), audit(extension))
    shown = shown_groups(result, experiment, folder)
    # Those that the baseline misses most.
    pictured = [shown[i] for i in worst([max(g.errors, default=0.0) for g in shown])]
    content = {
        "title": f"Diagnosis: {result.title}",
        **answer.content(result, experiment.beliefs, shown),
        "own_sentences": result.sentences,
        "searched": Searched(result.looked_at, result.settings.search.missed).say(PLAIN),
        "no_alternative": causes.no_alternative(result),
        "extended": "extended" in result.show,
        "mostly_unnamed": result.mostly_unnamed,
        "quick": result.quick,
        "leaves_tied": result.leaves_tied,
        **overview.content(shown, pictured),
        **misfit.content(result, experiment),
        **causes.content(result, shown, pictured),
        **remaining.content(result, shown),
        **gain.content(result),
        **next_experiment.content(result),
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


def _tables(result: Diagnosis, experiment: Experiment) -> list[str]:
    """The tables of predictions that hold something: one for each observable that was read."""
    read = {o for g in experiment.select(result.groups) for o in g.observables}
    return [table_name(Path(result.predictions).stem, o) for o in OBSERVABLES if o in read]


def _facts(result: Diagnosis, experiment: Experiment) -> list[list[Any]]:
    facts: list[list[Any]] = [
        ["Data", result.title],
        ["Source", experiment.source or "not given"],
        ["Groups", words.group_ids(result.groups)],
        *([] if result.quick else [["Training groups of the strict protocol", words.group_ids(result.training)]]),
        ["Seed", str(result.seed)],
        ["Kind of run", "quick: the verdict alone" if result.quick else "full"],
        ["Predictions of the adopted model", ", ".join(_tables(result, experiment))],
        ["Fingerprint of the data (SHA-256)", result.fingerprint],
        ["Versions", ", ".join(f"{name} {version}" for name, version in result.versions.items())],
        ["Time taken", ", ".join(f"{name} {s:.1f}{NBSP}s" for name, s in result.seconds.items()) or "–"],
    ]
    if result.command:
        facts.insert(2, ["Command", result.command])
    for head, derived in (("Priors that the experiment states", False), ("Priors that follow from [rig]", True)):
        if known := [
            f"{label(b.name)}: {b.describe()} ({b.source})" for b in experiment.beliefs if b.derived == derived
        ]:
            facts.insert(2, [head, "; ".join(known)])
    return facts

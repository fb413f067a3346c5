"""`psafit check`, `fit`, `validate` and `reproduce`."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from psafit.cli.common import (
    CHECK_FAILED,
    DONE,
    EXPERIMENT,
    JSON,
    PLUGIN,
    QUIET,
    RUN,
    SEED,
    Command,
    Place,
    causes,
    costly,
    groups_of,
    plugin_words,
    print_scores,
    refuse_run_file,
    shown_path,
    unresolved,
    warn,
    write_result,
)
from psafit.errors import InputError
from psafit.inference.samplers import USUAL, names
from psafit.text import count

if TYPE_CHECKING:
    from psafit.inference.run_folder import Run
    from psafit.records import Numerics, SessionSummary


ENOUGH = 60
"""Readings that docs/own-rig.md asks for; it says what fewer show."""


@click.command(cls=Command)
@EXPERIMENT
@PLUGIN
@QUIET
@JSON
def check(experiment: Path, quiet: bool, json_file: Path | None) -> int:
    """Validate an experiment folder and say what is in it."""
    from psafit.experiment import changes_text, describe
    from psafit.observables import OBSERVABLES
    from psafit.physics import label
    from psafit.prior_check import read as read_folder

    data = read_folder(experiment)
    content = describe(data)
    largest = max(data.groups, key=lambda group: group.n_points)
    content["warnings"] += costly(data, [largest.id])
    write_result(json_file, content)
    if not quiet:
        n = content["n_points"]
        few = "" if n >= ENOUGH else f"; fewer than {ENOUGH} show strong effects only (docs/own-rig.md)"
        click.echo(f"{content['title']}: {count(len(content['groups']), 'group')}, {count(n, 'reading')}{few}")
        for group, of in zip(content["groups"], data.groups, strict=True):
            spans = (_span(group["frequency_hz"], "Hz"), _span(group["amplitude_v"], "V"))
            low, high = of.volts
            own = changes_text(of.changed) + (f", session {of.session}" if of.session is not None else "")
            read = ", ".join(f"{o.title} {_span(group[o.column], o.unit)}" for o in OBSERVABLES if o.column in group)
            click.echo(
                f"  group {group['id']}: {of.drive.label}, {count(group['n_points'], 'reading')}, "
                f"{spans[0]}, {spans[1]} ({low:g} to {high:g} V), {read}{own}"
            )
        named = dict.fromkeys(pair for g in data.groups for pair in g.named_instruments)
        for name in dict.fromkeys(name for _, name in named):
            titles = [o.titles for o in OBSERVABLES if (o.column, name) in named]
            click.echo(f"  instrument {name}: {' and '.join(titles)}")
        for known in content["priors"]:
            origin = ", from [rig]" if known["derived"] else ""
            click.echo(f"  prior of {label(known['name'])}{origin}: {known['prior']} ({known['source']})")
        if any("Cauchy" in known["prior"] for known in content["priors"]):
            click.echo("  (the tail is for values far beyond the plausible: they are flagged, not excluded)")
        for name, facts in content["lacking"].items():
            click.echo(f"  no prior of {name}, from [rig]: it needs {' and '.join(facts)}, too")
        warn(content["warnings"])
    return DONE


@click.command(cls=Command, short_help="Fit, sample, validate on the other groups, and report.")
@EXPERIMENT
@click.option("--group", "group", metavar="ID[,ID...]", help="Group or groups to fit.  [required]")
@click.option("--terms", default="", metavar="ID[,ID...]", help="Causes to add to the baseline.")
@click.option("--out", type=Place("folder"), help="Run folder; fits/<experiment>-group<id>[-<causes>] by default.")
@SEED
@click.option("--starts", type=click.IntRange(1, 4096), default=32, show_default=True, help="Starts of the search.")
@click.option("--sampler", type=click.Choice(names()), default=USUAL, show_default=True, help="Draws the posterior.")
@click.option("--no-report", is_flag=True, help="Stop after the posterior: no validation, no report.")
@PLUGIN
@QUIET
@JSON
def fit(
    experiment: Path,
    group: str | None,
    terms: str,
    out: Path | None,
    seed: int,
    starts: int,
    sampler: str,
    no_report: bool,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Fit, sample, validate on the other groups and write the report.

    An interrupted run goes on where it stopped when the same command is repeated, and one that has not
    converged draws on.
    """
    from psafit.experiment.text import listed
    from psafit.files import ensure_writable, usual_fit_folder
    from psafit.prior_check import read
    from psafit.progress import watcher

    data = read(experiment)
    if group is None:
        raise InputError("no group to fit", f"name one or more with --group: {listed(map(str, data.ids))}")
    ids = groups_of(group, data)
    chosen = causes(terms) if terms else ()
    folder = out or usual_fit_folder(experiment, ids, [t.id for t in chosen])
    if out is None:  # one that was given has been looked at
        ensure_writable(folder, "--out", folder=True, inputs=[experiment])
    refuse_run_file(json_file, folder)
    if not quiet:
        done = (folder / "posterior.json").exists()
        warn([*data.warnings, *([] if done else costly(data, ids, chosen))])
    with watcher(quiet) as show:
        from psafit.forecast import COUNTED, FIT, PAGE, reporting
        from psafit.inference import run as running
        from psafit.numerics import audit

        command = ["psafit", "fit", experiment, "--group", group, "--seed", seed, "--starts", starts]
        command += ["--terms", terms] if terms else []
        command += ["--sampler", sampler] if sampler != USUAL else []
        command += ["--out", out] if out else []
        command += plugin_words()
        with reporting(show, folder, "fit", "", FIT if no_report else FIT | PAGE, COUNTED) as whole:
            result = running.fit(
                data, ids, folder, terms=chosen, seed=seed, n_starts=starts, sampled_by=sampler, watcher=whole,
                command=command,
            )  # fmt: skip
            numerics = audit(result)
            if not no_report:
                whole.stage("validate")
                from psafit.diagnose.retest import retest
                from psafit.report.fit import write_report
                from psafit.validate import caution
                from psafit.validate import validate as check_predictions

                validation, predictions = check_predictions(result, retest=retest)
                whole.stage("report")
                page = write_report(result, validation, predictions, numerics)
    write_result(json_file, {"fit": result.fit, "posterior": result.summary})
    if not quiet:
        _say_fit(result, numerics)
        if not no_report:
            print_scores(validation, extended=bool(chosen))
            click.echo(f"report: {shown_path(page)}")
            if not chosen and caution(validation):
                click.echo(f"what is missing: psafit diagnose {shlex.quote(shown_path(experiment))} --quick")
    return DONE if result.summary.converged and numerics.converged else CHECK_FAILED


@click.command(cls=Command)
@RUN
@PLUGIN
@QUIET
@JSON
def validate(run: Path, quiet: bool, json_file: Path | None) -> int:
    """Check a run's posterior against the groups it never saw."""
    from psafit.diagnose.retest import retest
    from psafit.inference.run_folder import load
    from psafit.validate import validate as check_predictions

    refuse_run_file(json_file, run)
    loaded = load(run)
    validation, _ = check_predictions(loaded, retest=retest)
    write_result(json_file, validation)
    if not quiet:
        print_scores(validation, extended=bool(loaded.fit.terms))
    return DONE


@click.command(cls=Command, short_help="Recompute the study's published results.")
@click.argument("experiment", metavar="[EXP]", type=Place("input"), default=Path("experiments/psa"))
@click.option("--out", type=Place("folder"), default=Path("fits/reproduction"), show_default=True)
@QUIET
@JSON
def reproduce(experiment: Path, out: Path, quiet: bool, json_file: Path | None) -> int:
    """Recompute the study's published results, with its time step and without."""
    refuse_run_file(json_file, out)
    from psafit.progress import watcher

    with watcher(quiet) as show:
        show.stage("reproduce")
        from psafit.files import portable_command
        from psafit.inference.run_folder import versions
        from psafit.records import write_json
        from psafit.report.reproduction import claims_table, write_reproduction
        from psafit.reproduce import reproduce as recompute

        result = recompute(experiment)
        show.stage("report")
        used = ", ".join(f"{name} {version}" for name, version in versions().items())
        command = portable_command(["psafit", "reproduce", experiment, "--out", out])
        page = write_reproduction(result, out / "reproduction.html", {"Command": command, "Versions": used})
    content = result.to_dict()
    write_json(out / "reproduction.json", content)
    write_result(json_file, content)
    if not quiet:
        click.echo(claims_table(result))
        click.echo(f"report: {shown_path(page)}")
    return DONE


def _span(span: list[float], unit: str) -> str:
    return f"{span[0]:g} {unit}" if span[0] == span[1] else f"{span[0]:g}-{span[1]:g} {unit}"


def _by_session(sessions: Sequence[SessionSummary]) -> Iterator[tuple[str, list[str]]]:
    """What each session has, by the cause it is of: "group 1 0.772 (0.746 to 0.797)"."""
    from psafit.diagnose.words import PLAIN

    for cause, found in itertools.groupby(sessions, key=lambda s: s.cause):
        yield cause, [f"{s.where} {PLAIN.value(s.unit, s.median, (s.lower, s.upper))}" for s in found]


def _say_fit(result: Run, numerics: Numerics) -> None:
    """Say what a fit found, and whether it converged."""
    from psafit.diagnose.answer.besides import Redefined
    from psafit.diagnose.words import PLAIN
    from psafit.inference.identify import not_expected, profiled
    from psafit.inference.samplers import sampler
    from psafit.inference.summary import overdamped
    from psafit.physics import redefined
    from psafit.report.wording import compared

    best = result.fit.minima[0]
    minima = f"{len(result.fit.minima)} {'minimum' if len(result.fit.minima) == 1 else 'minima'}"
    click.echo(f"{minima}; {best.starts} of {count(result.fit.n_followed, 'start')} reached the best")
    if not (best.starts or result.fit.n_missed):
        click.echo("hops from where starts ended found the best; all starts were given up behind it or ended lower")
    if result.fit.n_missed:
        click.echo("the best minimum was found by the sampler, not by the search; the result is of it")
    left = result.not_determined
    for p, entry in zip(result.summary.parameters, result.fit.parameters, strict=True):
        if p.name not in left:
            also = profiled(entry.unit, p.profile, (p.lower, p.upper), p.verdict)
            if p.implausible and p.verdict != "not determined":
                also += not_expected(entry.unit, (p.prior_lower, p.prior_upper))
            click.echo(f"  {p.text}{also}")
    if left:
        click.echo(f"  not determined, of the scatter or of sessions: {', '.join(left)}")
    if meanings := redefined(result.problem.ids):
        click.echo(Redefined(meanings).say(PLAIN))
    for cause, sizes in _by_session(result.summary.sessions or []):
        click.echo(f"session by session, {cause}: {', '.join(sizes)}")
    if lagging := overdamped(result.problem, result.summary.parameters):
        click.echo(lagging.text)
    click.echo(f"posterior: {result.summary.message}")
    if sampler(result.fit.sampled_by).checked:
        other = result.summary.importance
        worst = other.furthest
        click.echo(f"posterior: {compared(worst.name, worst.apart, other.by_chance, other.effective)}")
    if not numerics.converged:
        click.echo(unresolved(numerics.error, numerics.required))

"""`psafit diagnose`, and how a diagnosis is reported."""

from __future__ import annotations

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
    SEED,
    Command,
    Place,
    causes,
    costly,
    from_here,
    groups_of,
    long_sweeps,
    plugin_words,
    refuse_both,
    refuse_run_file,
    shown_path,
    unresolved,
    warn,
    write_result,
)
from psafit.text import fixed, set_name

if TYPE_CHECKING:
    from psafit.diagnose.record import Diagnosis
    from psafit.diagnose.record.models import CauseResult
    from psafit.parameters import Belief


@click.command(cls=Command, short_help="Say what the simulation gets wrong, and name the cause.")
@EXPERIMENT
@click.option(
    "--group",
    "group",
    metavar="ID[,ID...]",
    help="Training groups of the strict gain (not used by --quick); the first group by default.",
)
@click.option(
    "--causes",
    "candidates",
    metavar="ID[,ID...]",
    help="Look at these causes only (psafit terms lists them); the answer says so. All by default.",
)
@click.option("--quick", is_flag=True, help="The verdict alone, by the same search: no measured gain.")
@click.option(
    "--nautilus", is_flag=True, help="Compute the finalists' evidence by a nested sampler, too: minutes a model."
)
@click.option(
    "--searches",
    type=click.IntRange(0, 9999),
    metavar="N",
    help="Repeat the whole search on N simulated baselines; by default a stored table of such searches is looked up.",
)
@click.option(
    "--calibrate",
    type=click.IntRange(0, 9999),
    default=0,
    metavar="N",
    help="Draw N data sets from the answer, diagnose each, and say how often that is right here: N searches.",
)
@click.option("--out", type=Place("folder"), help="Folder; fits/<experiment>-diagnosis by default.")
@SEED
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Processes that search side by side; one for every core by default. The result is the same.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler that shares the work out (psafit[cluster]).")
@click.option("--no-report", is_flag=True, help="Write the result only, no page.")
@PLUGIN
@QUIET
@JSON
def diagnose(
    experiment: Path,
    group: str | None,
    candidates: str | None,
    quick: bool,
    searches: int | None,
    nautilus: bool,
    calibrate: int,
    out: Path | None,
    seed: int,
    jobs: int | None,
    scheduler: str | None,
    no_report: bool,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Say what the simulation gets wrong, name the cause, and measure what the extended model gains.

    The verdict uses all groups; the gain never scores data that a choice has seen. An interrupted diagnosis goes
    on where it stopped when the same command is repeated.
    """
    from psafit.files import ensure_writable, usual_folder
    from psafit.prior_check import read
    from psafit.progress import watcher

    data = read(experiment)
    ids = [data.ids[0]] if group is None else groups_of(group, data)
    catalogue = None if candidates is None else causes(candidates, "--causes")
    folder = out or usual_folder(experiment, "diagnosis")
    if out is None:
        ensure_writable(folder, "--out", folder=True, inputs=[experiment])
    refuse_run_file(json_file, folder)
    refuse_both(jobs, scheduler)
    if not quiet:
        done = (folder / "diagnosis.json").exists()
        rest = "; a diagnosis takes that at least, without --quick many times that"
        warn([*data.warnings, *([] if done else [*costly(data, data.ids, rest=rest), *long_sweeps(data)])])
    command = ["psafit", "diagnose", experiment, *([] if group is None else ["--group", group]), "--seed", seed]
    command += [] if candidates is None else ["--causes", candidates]
    command += ["--quick"] if quick else []
    command += ["--searches", searches] if searches is not None else []
    command += ["--nautilus"] if nautilus else []
    command += ["--calibrate", calibrate] if calibrate else []
    command += ["--out", out] if out else []
    command += plugin_words()
    with watcher(quiet) as show:
        from psafit.diagnose import diagnose as examine
        from psafit.diagnose.record import PAGE

        result = examine(
            data,
            ids,
            folder,
            quick=quick,
            searches=searches,
            nautilus=nautilus,
            calibrate=calibrate,
            seed=seed,
            catalogue=catalogue,
            jobs=jobs,
            scheduler=scheduler,
            # Without its page a diagnosis was interrupted, however whole its record is.
            draw_on=no_report or (folder / PAGE).exists(),
            watcher=show,
            command=command,
        )
    write_result(json_file, result)
    page = None
    try:
        if not quiet:
            say_diagnosis(result, data.beliefs, experiment)
    finally:
        # The answer need not wait for its pictures, nor they for somebody who reads it.
        if not no_report:
            from psafit.report.diagnosis import write_diagnosis

            page = write_diagnosis(result, data, folder)
    if not quiet:
        _say_after(result, experiment, folder, page)
    return DONE if result.numerics.converged else CHECK_FAILED


def say_diagnosis(
    result: Diagnosis,
    beliefs: Sequence[Belief] = (),
    experiment: Path = Path("EXP"),
    *,
    most: int = 5,
    least: float = 1e-3,
) -> None:
    """Print a diagnosis; the beliefs are what the experiment states, or what follows from its rig.

    It lists the models that are reported and the baseline; of the others none below the probability `least`, and only
    while it has fewer than `most`.
    """
    from psafit.cli.terminal_words import TerminalWords
    from psafit.diagnose.answer import answer
    from psafit.diagnose.answer.findings import Sizes

    click.echo(result.headline)
    words = TerminalWords(_typed([experiment]), _typed(plugin_words()))
    said = [s for s in answer(result, beliefs) if not isinstance(s, Sizes)]  # they stand in the table

    def say(*, besides: bool) -> None:
        for statement in said:
            if (statement.topic in ("besides", "detail", "searched")) is besides:
                lines = (line.rstrip() for line in f"  {statement.say(words)}".splitlines())
                click.echo("\n".join(filter(None, lines)))

    say(besides=False)
    given_named = result.mostly_unnamed or result.verdict == "unexplained"
    if given_named:
        click.echo("  if the truth were in the catalogue:")
    rows: list[tuple[float, list[str]]] = []
    reported = [result.named, *result.alternatives]
    described: set[str] = set()
    for cause in result.causes:
        share = cause.evidence.share if given_named else cause.probability
        if cause.terms not in ([], *reported) and (share < least or len(rows) >= most):
            continue
        gain = f"log likelihood {fixed(cause.evidence.gain, 1, sign=True)} nats over the baseline's"
        head = f"{set_name(cause.terms)}, {gain}" if cause.terms else "no cause"
        sizes = _sizes(cause, described, whole=cause.terms == result.named) if cause.terms in reported else ()
        rows.append((share, [head, *sizes]))
    if not given_named and result.reports_unnamed:
        rows.append((result.unnamed, ["a discrepancy without a name"]))
    # What is named stands first, whatever its share.
    rows[1:] = sorted(rows[1:], key=lambda row: -row[0])
    for share, (head, *values) in rows:
        click.echo(f"  {share_text(share):>5} %  {head}")
        for line in values:
            click.echo(f"           {line}")
    for place in result.misfit.where[:5]:
        click.echo(f"  baseline, {place.text}")
    if not result.numerics.converged:
        click.echo(f"  {unresolved(result.numerics.error, result.numerics.required)}")
    for run in result.extension.values():
        if not run.converged:
            click.echo(f"  posterior of {' + '.join(run.terms)}: {run.message}")
    click.echo("what these readings say besides:")
    say(besides=True)


def _say_after(result: Diagnosis, experiment: Path, folder: Path, page: Path | None) -> None:
    """Print where the page is, if there is one, and how the proposed measurement becomes a folder for its readings."""
    from psafit.diagnose.record.models import UNSEEN

    if page is not None:
        click.echo(f"report: {shown_path(page)}")
    if result.next_experiment.recommended:
        plan = ["psafit", "plan", folder, "--out", f"{experiment.resolve().name}-next", *plugin_words()]
        click.echo(f"what to measure next, as a folder: {_typed(plan)}")
    if any(s.verdict == UNSEEN for s in result.screening):
        plan = ["psafit", "plan", experiment, "--isolability", *plugin_words()]
        click.echo(f"what would show causes that could not have been seen: {_typed(plan)}")


def _typed(command: Sequence[object]) -> str:
    """A command as it is typed."""
    return shlex.join(shown_path(from_here(word) if isinstance(word, Path) else str(word)) for word in command)


def share_text(fraction: float) -> str:
    """A fraction in per cent; never 0 or 100 unless it is."""
    text = fixed(fraction, 1, per_cent=True)
    return "<0.1" if text == "0.0" and fraction > 0 else ">99.9" if text == "100.0" and fraction < 1 else text


def _sizes(cause: CauseResult, described: set[str], *, whole: bool) -> Iterator[str]:
    """The values of a model's own causes, as the readings determine them; of the `whole` rig, if wanted.

    What is not yet among those `described` has its description, and is so from then on.
    """
    from psafit.inference.identify import describe, not_expected
    from psafit.physics import baseline, owner

    plain = {p.name for p in baseline.PARAMETERS}
    for name, p in cause.parameters.items():
        mine = owner(name) in cause.terms or (whole and name in plain)
        if mine and p.interval is not None:
            size = describe(name, p.unit, p.median, p.interval, [], "determined")
            if name not in described and p.description:
                size += f": {p.description}"
            described.add(name)
            yield size + (not_expected(p.unit, p.prior_interval) if name in cause.implausible else "")

"""`psafit challenge`: thin, and lazy like the command line it hangs on."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from psafit.challenge import Sizes
from psafit.cli.common import (
    CHECK_FAILED,
    DONE,
    JSON,
    QUIET,
    Group,
    Place,
    causes,
    refuse_both,
    refuse_run_file,
    shown_path,
    write_result,
)
from psafit.errors import LARGEST_SEED, InputError
from psafit.text import count, fixed

if TYPE_CHECKING:
    from psafit.challenge.score import Mean
    from psafit.experiment import Experiment

_SEED = click.option("--seed", type=click.IntRange(0, LARGEST_SEED), required=True, help="Everything is drawn from it.")
_COUNT = click.IntRange(0, 10_000)
_JOBS = click.option("--jobs", type=click.IntRange(1, 256), default=2, show_default=True, help="Processes.")
_DESIGN = click.option(
    "--experiment",
    type=Place("input"),
    default=Path("experiments/psa"),
    show_default=True,
    help="Whose conditions are simulated.",
)


def _asked(name: str) -> bool:
    """Whether an option stands on the command line: what has no effect there is refused, not dropped."""
    return click.get_current_context().get_parameter_source(name) is ParameterSource.COMMANDLINE


def _conditions(experiment: Path) -> Experiment:
    """The experiment whose conditions are simulated."""
    from psafit.experiment import read_experiment

    if not _asked("experiment") and not experiment.exists():
        raise InputError(f"there is no {experiment} here", "say whose conditions to simulate: --experiment EXP")
    return read_experiment(experiment)


@click.group(cls=Group, short_help="Hide effects, and measure how well a diagnosis finds them.")
def challenge() -> None:
    """Hide effects in simulated data, and measure how well a diagnosis finds them."""


@challenge.command(short_help="Write an experiment that hides something, and the answer.")
@_SEED
@click.option("--out", type=Place("folder"), required=True, help="Receives experiment/, answer.json, commitment.txt.")
@_DESIGN
@click.option("--drawn-design", is_flag=True, help="A random rig and random sweeps instead.")
@click.option("--kind", type=click.Choice(["nothing", "one", "two"]), help="What to hide; drawn by default.")
@click.option("--terms", "ids", default=None, metavar="ID[,ID]", help="Causes to hide; drawn by default.")
@click.option("--strength", type=float, metavar="NATS", help="Oracle gain of each cause; drawn from priors by default.")
@_JOBS
@QUIET
@JSON
def make(
    seed: int,
    out: Path,
    experiment: Path,
    drawn_design: bool,
    kind: Any,
    ids: str | None,
    strength: float | None,
    jobs: int,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Write an experiment with something hidden in it, and the sealed answer.

    What --json writes, and what is printed, does not give the answer away.
    """
    from psafit.challenge.answer import ANSWER, EXPERIMENT
    from psafit.challenge.hide import make as hide

    refuse_run_file(json_file, out)
    if drawn_design and _asked("experiment"):
        raise InputError("--experiment and --drawn-design are both given", "give one: whose conditions, or drawn ones")
    chosen = None if ids is None else [t.id for t in causes(ids)]
    design = None if drawn_design else _conditions(experiment)
    made = hide(seed, out, design_of=design, kind=kind, terms=chosen, strength=strength, jobs=jobs)
    content = {
        "experiment": str(made.folder / EXPERIMENT),
        "answer": str(made.folder / ANSWER),
        "commitment": made.commitment,
        "fingerprint": made.experiment.fingerprint,
    }
    write_result(json_file, content)
    if not quiet:
        click.echo(f"experiment: {shown_path(content['experiment'])}")
        click.echo(f"sealed answer, SHA-256 {made.commitment}")
        place, folder_shown = shown_path(content["experiment"]), shown_path(made.folder)
        answer = shown_path(made.folder / "diagnosis")
        click.echo(f"next: psafit diagnose {place} --quick --out {answer}")
        click.echo(f"then: psafit challenge score {folder_shown} --diagnosis {answer}")
    return DONE


@challenge.command()
@_SEED
@click.option("--out", type=Place("folder"), required=True, help="Receives the results; an interrupted one goes on.")
@_DESIGN
@click.option("--terms", "ids", default=None, metavar="ID[,ID...]", help="Causes to hide; all by default.")
@click.option("--each", type=_COUNT, default=Sizes.each, show_default=True, help="Of every cause and strength.")
@click.option("--nothing", type=_COUNT, default=Sizes.nothing, show_default=True, help="With nothing hidden.")
@click.option("--pairs", type=_COUNT, default=Sizes.pairs, show_default=True, help="With two causes.")
@click.option("--drawn", type=_COUNT, default=Sizes.drawn, show_default=True, help="As the priors expect them.")
@click.option(
    "--designs",
    type=_COUNT,
    default=Sizes.designs,
    show_default=True,
    help="One in so many has a drawn design; 0: none.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Dask scheduler that shares the work out (psafit[cluster]).")
@_JOBS
@QUIET
@JSON
def run(
    seed: int,
    out: Path,
    experiment: Path,
    ids: str | None,
    each: int,
    nothing: int,
    pairs: int,
    drawn: int,
    designs: int,
    scheduler: str | None,
    jobs: int,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Run a campaign: make, diagnose and judge many data sets.

    Repeat the same command to go on where it stopped.
    """
    from psafit.challenge.campaign import plan
    from psafit.challenge.campaign import run as run_campaign
    from psafit.files import portable_command
    from psafit.physics import TERMS

    refuse_run_file(json_file, out)
    refuse_both(jobs if _asked("jobs") else None, scheduler)
    data = _conditions(experiment)
    chosen = None if ids is None else [t.id for t in causes(ids)]
    if pairs and _asked("pairs") and len(chosen or TERMS) < 2:
        raise InputError("a pair of one cause is asked for", "name more with --terms, or give --pairs 0")
    specs = plan(seed, terms=chosen, each=each, nothing=nothing, pairs=pairs, drawn=drawn, designs=designs)
    if not specs:
        raise InputError("the campaign is empty", "ask for some data sets with --each, --nothing, --pairs or --drawn")
    words: list[object] = ["psafit", "challenge", "run", "--seed", seed, "--out", out, "--experiment", experiment]
    words += ["--each", each, "--nothing", nothing, "--pairs", pairs, "--drawn", drawn, "--designs", designs]
    words += ["--terms", ids] if ids else []
    words += ["--scheduler", scheduler] if scheduler else []

    def show(done: int, total: int, note: str) -> None:
        if not quiet:
            click.echo(f"{done} of {total} data sets {note}".rstrip(), err=True)

    results = run_campaign(
        specs,
        out,
        design_of=data,
        jobs=jobs,
        scheduler=scheduler,
        command=portable_command(words),
        progress=show,
    )
    failed = [r for r in results if r.status == "failed"]
    write_result(json_file, {"n": len(results), "failed": {r.spec.id: r.message for r in failed}})
    if not quiet:
        for r in failed:
            click.echo(f"failed: {r.spec.id}: {r.message}", err=True)
        click.echo(f"results: {shown_path(out)}")
    return CHECK_FAILED if failed else DONE


@challenge.command()
@click.argument("folder", metavar="FOLDER", type=Place("input"))
@click.option("--diagnosis", type=Place("input"), help="Folder of a diagnosis, where FOLDER is of challenge make.")
@click.option("--against", type=Place("input"), help="A campaign of the same data sets, by another version.")
@click.option("--out", type=Place("file"), help="HTML page; FOLDER/score.html by default for a campaign.")
@QUIET
@JSON
def score(
    folder: Path, diagnosis: Path | None, against: Path | None, out: Path | None, quiet: bool, json_file: Path | None
) -> int:
    """Score a campaign, or one diagnosis of a challenge.

    Ends with 1 where a target is missed.
    """
    from psafit.challenge.answer import ANSWER
    from psafit.challenge.campaign import CAMPAIGN, judge, load
    from psafit.challenge.score import gained, percent
    from psafit.challenge.score import score as judge_all
    from psafit.diagnose.record import RESULT
    from psafit.records import write_json
    from psafit.report.challenge import write_page

    refuse_run_file(json_file, folder)
    if out is not None and out.resolve() == (folder / "score.json").resolve():
        raise InputError("receives the numbers", "choose another place with --out", file=out)
    if diagnosis is None and (folder / ANSWER).exists() and not (folder / CAMPAIGN).exists():
        raise InputError("holds one challenge", "name its diagnosis: --diagnosis FOLDER", file=folder)
    if diagnosis is None:
        campaign, results = load(folder)
        if not results:
            raise InputError("has no result yet", "run psafit challenge run", file=folder / CAMPAIGN)
        found = judge_all(results)
        provenance = {"Version": campaign.version, "Command": campaign.command, "Data sets": f"{len(results)}"}
        provenance["Planned"] = f"{len(campaign.specs)}"
        page: Path | None = write_page(found, out or folder / "score.html", provenance)
        write_json(folder / "score.json", found)
    else:
        found = judge_all([judge(folder, diagnosis / RESULT if diagnosis.is_dir() else diagnosis)])
        page = write_page(found, out, {}) if out else None
    write_result(json_file, found)
    if not quiet:
        if diagnosis is None:
            for t in found.targets:
                click.echo(t.text)
            for kind, r in found.by_design.items():
                click.echo(f"right answers, {kind}: {percent(r.share)} ({r.k} of {r.n})")
            click.echo(f"log score of the printed probabilities: {_nats(found.log_score)}")
            if against is not None:
                click.echo(f"above that campaign's: {_nats(gained(found.rows, judge_all(load(against)[1]).rows))}")
        else:
            row = found.rows[0]
            click.echo(f"hidden: {row.truth}, {fixed(row.gain, 1)} nats; verdict {row.verdict}, named {row.named}")
            click.echo(f"truth {'in' if row.in_set else 'not in'} the reported set")
        if page is not None:
            click.echo(f"page: {shown_path(page)}")
    return CHECK_FAILED if diagnosis is None and any(t.holds is False for t in found.targets) else DONE


def _nats(of: Mean) -> str:
    """A mean of scores, with its interval."""
    if of.mean is None:
        return "no data set"
    wide = "" if of.lower is None or of.upper is None else f", {fixed(of.lower, 2)} to {fixed(of.upper, 2)}"
    return f"{fixed(of.mean, 2)} nats{wide} ({count(of.n, 'data set')})"


__all__ = ["challenge"]

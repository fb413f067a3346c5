"""`psafit new`, `plan` and `check-cause`: what somebody with a rig of their own begins and goes on with."""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from psafit import plugins
from psafit.cli.common import (
    CHECK_FAILED,
    DONE,
    JSON,
    PLUGIN,
    QUIET,
    SEED,
    Command,
    Place,
    escaped,
    say_idle,
    shown_path,
    unwritten,
    write_result,
)
from psafit.errors import InputError
from psafit.text import count, fixed

if TYPE_CHECKING:
    from psafit.diagnose.isolability import AlsoRead, Isolability, Shown
    from psafit.experiment import GroupId


@click.command(cls=Command)
@click.argument("folder", metavar="EXP", type=Place("input"))
@QUIET
def new(folder: Path, quiet: bool) -> int:
    """Begin an experiment folder.

    It gets a commented experiment.toml and example readings, to be replaced. EXP must not exist yet, or be empty.
    """
    from importlib.resources import files

    from psafit.experiment import DEFINITION
    from psafit.files import ensure_writable, filling, write_atomically

    ensure_writable(folder, "EXP", folder=True)
    # The definition comes last: a folder without it is no experiment.
    parts = sorted(files("psafit").joinpath("templates").iterdir(), key=lambda part: part.name == DEFINITION)
    with filling(folder):
        for part in parts:
            write_atomically(folder / part.name, part.read_bytes())
    if not quiet:
        for part in reversed(parts):
            click.echo(f"wrote {shown_path(folder / part.name)}")
        place = shown_path(folder)
        click.echo(f"put in your rig and readings, then: psafit check {place}; psafit diagnose {place} --quick")
    return DONE


@click.command(cls=Command, short_help="Plan a measurement: a proposed one, or what conditions can show.")
@click.argument("place", metavar="RUN|EXP", type=Place("input"))
@click.option("--out", type=Place("folder"), help="Receives the folder; must be new, or empty.")
@click.option("--proposal", type=click.IntRange(1), default=1, show_default=True, help="Which one, from the best on.")
@click.option("--experiment", type=Place("input"), metavar="EXP", help="Measurements of a diagnosis that keeps none.")
@click.option(
    "--isolability", is_flag=True, help="Say which causes the conditions of an experiment EXP can distinguish."
)
@click.option("--plot", type=Place("file"), metavar="FILE", help="Draw that as a matrix: .png, .svg or .pdf.")
@click.option("--json", "json_file", metavar="FILE", type=Place("file"), help="Write that to FILE as JSON.")
@PLUGIN
@QUIET
def plan(
    place: Path,
    out: Path | None,
    proposal: int,
    experiment: Path | None,
    isolability: bool,
    plot: Path | None,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Turn a measurement that a diagnosis RUN proposes into an experiment folder.

    It holds what was measured and one more group, whose file waits for its readings. With --isolability, say which
    causes the conditions of an experiment folder EXP can distinguish, which sweep would split those that are
    confounded, and what would show those that would not be seen. Its files need no readings.
    """
    if isolability:
        if out is not None:
            raise InputError("--isolability writes no folder", "leave --out out; --plot and --json take its answer")
        return _isolability(place, plot, json_file, quiet)
    if plot is not None or json_file is not None:
        raise InputError("--plot and --json belong to --isolability", "add --isolability, or leave them out")
    if out is None:
        raise InputError("no --out", "name the folder that receives the plan")
    return _planned(place, out, proposal, experiment, quiet)


def _isolability(folder: Path, plot: Path | None, json_file: Path | None, quiet: bool) -> int:
    """Say which causes conditions can distinguish."""
    from psafit.cli.simulating import PICTURES
    from psafit.diagnose.isolability import IsolabilitySettings, isolability
    from psafit.experiment import read_plan
    from psafit.observables import OBSERVABLES
    from psafit.physics import TERMS, informed, informed_scatter
    from psafit.physics.term import idle
    from psafit.progress import watcher

    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise InputError("is no kind of picture psafit writes", f"end its name in {' or '.join(PICTURES)}", file=plot)
    read = read_plan(folder)
    _, terms = informed(read.beliefs, TERMS)
    names = {b.name for b in read.beliefs if b.prior is not None}
    known = (p for o in OBSERVABLES for p in informed_scatter(read.beliefs, o))
    scatter = {p.name: p.prior_median for p in known if p.name in names}
    with watcher(quiet) as show:
        show.stage("isolability")
        found = isolability(
            read.title, read.constants, read.groups, read.limits, terms,
            readable=read.readable, settings=IsolabilitySettings(stated=scatter),
            progress=lambda k, n: show.update(k, n, "blocks of confounded causes"),
        )  # fmt: skip
    if plot is not None:
        from psafit.report.figures.isolability import isolability_figure
        from psafit.report.simulated import save

        save(isolability_figure(found), plot)
    write_result(json_file, found)
    if not quiet:
        click.echo(f"{found.readings} readings, {len(found.causes)} causes at plausible strengths, by linear refits")
        without = idle(terms, read.groups)
        if unseen := [id for id in found.unseen if id not in without]:
            click.echo(f"would not be seen: {', '.join(unseen)}")
        titles: dict[str | None, str] = {o.name: o.titles for o in OBSERVABLES}
        for one in found.shown:
            if causes := [id for id in one.causes if id in unseen]:
                sweep = one.sweep and f"{one.sweep.readings} readings more, {one.sweep.text}"
                click.echo(f"  {', '.join(causes)}: seen by {sweep or _also(one, titles)}")
        if rest := [id for id in unseen if not any(id in one.causes for one in found.shown)]:
            click.echo(f"  {', '.join(rest)}: by nothing that was tried")
        say_idle(without)
        for id, others in found.taken_for.items():
            click.echo(f"{id} may be taken for {', '.join(others)}")
        for block in found.blocks:
            click.echo(f"confounded: {', '.join(block.causes)}")
            if (s := block.split) is not None:
                what = "are separated by" if s.splits else "none separates all; the best is"
                click.echo(f"  {what} {s.readings} readings, {s.text} (the closest pair by {fixed(s.nats, 1)} nats)")
            if (other := block.also) is not None:
                pairs = "them all" if other.splits else ", ".join(" from ".join(pair) for pair in other.pairs)
                click.echo(f"  {_also(other, titles)}, would distinguish {pairs}")
        for line in _confounded_pairs(found):
            click.echo(line)
        if plot is not None:
            click.echo(f"picture: {shown_path(plot)}")
    return DONE


def _also(what: Shown | AlsoRead, titles: Mapping[str | None, str]) -> str:
    """Another observable, in words."""
    return what.trace.text if what.trace else f"{titles[what.observable]}, read of the same launches"


def _confounded_pairs(found: Isolability, most: int = 3) -> list[str]:
    """The pairs of causes that come nearest to a single one, or it to them, and how many more there are."""
    lines = [f"{' + '.join(one.truth)} may be taken for {' + '.join(one.rival)}" for one in found.pairs[:most]]
    more = len(found.pairs) - most
    return lines + ([f"{count(more, 'pair')} more may be taken for one cause, or it for them (--json)"] * (more > 0))


def _planned(run: Path, out: Path, proposal: int, experiment: Path | None, quiet: bool) -> int:
    """Turn a proposal into an experiment folder."""
    import psafit
    from psafit.diagnose.next_experiment import planned
    from psafit.diagnose.record import RESULT, is_diagnosis
    from psafit.experiment import DEFINITION, read_plan, write_experiment
    from psafit.files import filling

    if not is_diagnosis(run):
        raise InputError("is a fit, which proposes nothing", "give the folder of psafit diagnose", file=run)
    opened = psafit.load_diagnosis(run, experiment)
    found, measured = opened.record.next_experiment, opened.experiment
    offered = found.proposals
    if not offered:
        raise InputError("proposes no measurement", "drive the stack in some group, and diagnose again", file=run)
    if proposal > len(offered):
        raise InputError(f"--proposal {proposal}: there are {len(offered)}", "take one of those in its report")
    with unwritten(run / RESULT, "holds no proposal psafit could have made"):
        sweep = planned(offered[proposal - 1], unused_ids(measured.ids), measured)
        text = escaped(f"{offered[proposal - 1].text}; it {found.promise(offered[proposal - 1])}")
    with filling(out):
        write_experiment(measured, out, [sweep])
        read_plan(out)  # a ball twice as heavy may be beyond what an experiment can hold
    if not quiet:
        place, file, fitted = (shlex.quote(shown_path(p)) for p in (out, out / sweep.file, run))
        click.echo(f"group {sweep.id}: {text}")
        below = f'write session = "ID" below it in {shlex.quote(shown_path(out / DEFINITION))}'
        click.echo(f"it counts as a session of its own; if the rig stays as it was for another group, {below}:")
        click.echo("  that group's session, or its id if it has none")
        click.echo(f"what is expected: psafit simulate {place} --run {fitted} --plot plan.png")
        o = sweep.observable
        columns = o.column if sweep.sigma is None else f"{o.column} and your {o.sigma_column}"
        quick = " --quick" * opened.record.quick
        click.echo(f"once measured, fill the column {columns} of {file}, then: psafit diagnose {place}{quick}")
    return DONE


def unused_ids(ids: Sequence[GroupId]) -> GroupId:
    """An id that no group has, of the kind that they have."""
    if all(isinstance(i, int) for i in ids):
        return next(k for k in itertools.count(len(ids) + 1) if k not in ids)
    return next(name for k in itertools.count(1) if (name := f"next{k}") not in ids)


@click.command(cls=Command)
@click.argument("file", metavar="FILE", type=Place("input"))
@click.option("--experiment", type=Place("input"), help="Rig and conditions; the study's rig by default.")
@click.option(
    "--draws", type=click.IntRange(1, 10000), default=40, show_default=True, help="Compared with the reference."
)
@SEED
@PLUGIN
@QUIET
@JSON
def check_cause(file: Path, experiment: Path | None, draws: int, seed: int, quiet: bool, json_file: Path | None) -> int:
    """Test a cause of your own like the built-in ones.

    FILE declares it as TERM; docs/own-causes.md shows how. Ends with 1 where a check fails.
    """
    plugins.add([file])
    from psafit.experiment import read_experiment
    from psafit.physics.plugin import read
    from psafit.simulate import Design
    from psafit.simulate.contract import check

    cause = read(file.absolute())
    design = None
    if experiment is not None:
        data = read_experiment(experiment)
        design = Design.of(data.constants, data.groups)
    outcomes = []
    for outcome in check(cause, design, draws=draws, seed=seed):
        outcomes.append(outcome)
        if not quiet:
            click.echo(f"{'pass' if outcome.passed else 'FAIL'}  {outcome.check:<12} {outcome.text}")
    failed = [o.check for o in outcomes if not o.passed]
    result = {"id": cause.id, "plugin": cause.plugin, "passed": not failed, "checks": [asdict(o) for o in outcomes]}
    write_result(json_file, result)
    if not quiet:
        verdict = f"fails {', '.join(failed)}" if failed else "keeps the contract"
        click.echo(f"{cause.id} ({cause.plugin}) {verdict}")
    return CHECK_FAILED if failed else DONE


__all__ = ["check_cause", "new", "plan"]

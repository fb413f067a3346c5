"""`psafit new` and `psafit check-cause`: what somebody with a rig of their own begins with."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

import click

from psafit import plugins
from psafit.cli import CHECK_FAILED, DONE, JSON, PLUGIN, QUIET, SEED, Command, Place, shown_path, write_result
from psafit.errors import InputError


@click.command(cls=Command)
@click.argument("folder", metavar="EXP", type=Place("input"))
@QUIET
def new(folder: Path, quiet: bool) -> int:
    """Begin an experiment folder.

    It gets a commented experiment.toml and example readings, to be replaced. EXP must not exist yet, or be empty.
    """
    from importlib.resources import files

    from psafit.experiment import DEFINITION
    from psafit.files import ensure_writable, write_atomically

    ensure_writable(folder, "EXP", folder=True)
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError("holds something already", "give the name of a new folder", file=folder)
    # The definition comes last: a folder without it is no experiment.
    parts = sorted(files("psafit").joinpath("templates").iterdir(), key=lambda part: part.name == DEFINITION)
    with ExitStack() as undo:
        if not folder.exists():
            folder.mkdir(parents=True)
            undo.callback(folder.rmdir)
        for part in parts:
            undo.callback((folder / part.name).unlink, missing_ok=True)
            write_atomically(folder / part.name, part.read_bytes())
        undo.pop_all()
    if not quiet:
        for part in reversed(parts):
            click.echo(f"wrote {shown_path(folder / part.name)}")
        place = shown_path(folder)
        click.echo(f"put in your rig and readings, then: psafit check {place}; psafit diagnose {place} --quick")
    return DONE


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


__all__ = ["check_cause", "new"]

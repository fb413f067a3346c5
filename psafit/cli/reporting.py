"""`psafit report`: the page of a run again, or of two runs side by side."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

import psafit
from psafit.cli.common import (
    DONE,
    JSON,
    PLUGIN,
    QUIET,
    Command,
    Place,
    shown_path,
    unwritten,
    write_result,
)
from psafit.errors import InputError


@click.command(cls=Command)
@click.argument("run", metavar="RUN", type=Place("input"))
@click.argument("other", metavar="[RUN]", type=Place("input"), required=False)
@click.option("--experiment", type=Place("input"), metavar="EXP", help="Measurements of a diagnosis that keeps none.")
@click.option("--out", type=Place("file"), help="Page of two runs; comparison-<second>.html in the first by default.")
@PLUGIN
@QUIET
@JSON
def report(
    run: Path, other: Path | None, experiment: Path | None, out: Path | None, quiet: bool, json_file: Path | None
) -> int:
    """Write the page of a run again, or of two runs side by side.

    A run is a folder of psafit fit or psafit diagnose.
    """
    if other is not None:
        if experiment is not None:
            raise InputError("--experiment is of no use for two runs", "leave it out: they hold what is compared")
        page, record = _compared(run, other, out, json_file)
        write_result(json_file, record)
        pages = [page]
    else:
        if out is not None or json_file is not None:
            raise InputError("--out and --json are for two runs", "leave them out: the page goes into the run's folder")
        pages = list(_again(run, experiment))
    for page in pages if not quiet else ():
        click.echo(f"report: {shown_path(page)}")
    return DONE


def _compared(first: Path, second: Path, out: Path | None, json_file: Path | None) -> tuple[Path, Any]:
    from psafit.compare import compare, distinguished, read_side
    from psafit.files import encodable
    from psafit.report.comparison import write_comparison

    page = out or first / f"comparison-{encodable(second.resolve().name)}.html"
    if json_file is not None and json_file.resolve() == page.resolve():
        raise InputError("is the page itself", "choose another place with --json", file=json_file)
    a, b = distinguished(read_side(first), read_side(second))
    found = compare(a, b)
    return write_comparison(a, b, found, page), found


def _again(run: Path, experiment: Path | None) -> Iterator[Path]:
    from psafit.diagnose.record import RESULT, is_diagnosis

    if found := is_diagnosis(run):
        opened = psafit.load_diagnosis(run, experiment)
        with unwritten(run / RESULT, "holds what psafit could not have written"):
            yield opened.report()
    elif experiment is not None:
        raise InputError("--experiment is for a diagnosis", "leave it out: a fit keeps its measurements")
    if not found or (run / "fit.json").exists():
        yield psafit.load(run).report()

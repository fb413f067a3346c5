"""What all commands share: paths, options, and how results are reported."""

from __future__ import annotations

import logging
import math
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from psafit import plugins
from psafit.errors import LARGEST_SEED, InputError

if TYPE_CHECKING:
    from psafit.experiment import Experiment, GroupId
    from psafit.physics.term import Term

DONE, CHECK_FAILED, BAD_INPUT = 0, 1, 2
RUN_FILES = (
    "fit.json",
    "chain.h5",
    "posterior.nc",
    "posterior.json",
    "validation.json",
    "predictions.csv",
    "numerics.json",
    "report.html",
    "progress.json",
    "diagnosis.json",
    "diagnosis.html",
    "predictions-diagnosis.csv",
    "predictions-strict.csv",
    "predictions-nested.csv",
    "reproduction.html",
    "reproduction.json",
    "answer.json",
    "commitment.txt",
    "campaign.json",
    "score.html",
    "score.json",
)
"""What fit, diagnose, reproduce and challenge write into their folders."""


class Place(click.Path):
    """A path, and what the command does with it: "input", "file" or "folder" (to be written)."""

    def __init__(self, role: str) -> None:
        super().__init__(path_type=Path)
        self.role = role

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse an empty path, which would mean the folder one is in: more likely a shell variable is not set."""
        if value == "":
            self.fail("the path is empty", param, ctx)
        return super().convert(value, param, ctx)


class Command(click.Command):
    """A command that checks its options and places before it does anything."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse an option that is given twice, of which click would drop the first."""
        _, _, order = self.make_parser(ctx).parse_args(list(args))
        for param, n in Counter(order).items():
            if n > 1 and isinstance(param, click.Option) and not (param.multiple or param.is_flag):
                joined = f", its values joined by commas: {param.opts[0]} 1,2" if param.name == "group" else ""
                raise InputError(f"{param.opts[0]} is given {n} times", f"give it once{joined}")
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Refuse outputs that cannot be written or would overwrite an input, then run."""
        from psafit.files import ensure_writable

        places = [
            (p.type.role, p.opts[0], path)
            for p in self.params
            if p.name and isinstance(p.type, Place) and (given := ctx.params.get(p.name)) is not None
            for path in (given if isinstance(given, tuple) else (given,))
        ]
        inputs = [*(path for role, _, path in places if role == "input"), *plugins.files()]
        seen: dict[str, str] = {}
        for role, option, path in places:
            if role != "input":
                ensure_writable(path, option, folder=role == "folder", inputs=inputs)
                if (other := seen.setdefault(os.path.realpath(path), option)) != option:
                    raise InputError(f"{option} and {other} are the same place", "give each its own", file=path)
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:  # click would print an empty line
            raise click.Abort from error
        except BrokenPipeError:  # click would call it a failure
            discard_output()
            return DONE


class Group(click.Group):
    """A group of such commands."""

    command_class = Command


EXPERIMENT = click.argument("experiment", metavar="EXP", type=Place("input"))
RUN = click.argument("run", metavar="RUN", type=Place("input"))
SEED = click.option("--seed", type=click.IntRange(0, LARGEST_SEED), default=1, show_default=True)
STANDING_IN = ": these values may stand in for what the model lacks"


class _Spoken(logging.Handler):
    """Prints what is logged."""

    def emit(self, record: logging.LogRecord) -> None:
        click.echo(escaped(f"psafit: {record.getMessage()}"), err=True)


def _heard(_context: click.Context, _option: click.Parameter, quiet: bool) -> bool:
    log = logging.getLogger("psafit")
    log.setLevel(logging.WARNING if quiet else logging.INFO)
    if not log.handlers:
        log.addHandler(_Spoken())
    return quiet


QUIET = click.option("--quiet", is_flag=True, callback=_heard, help="Print nothing but errors.")
JSON = click.option("--json", "json_file", metavar="FILE", type=Place("file"), help="Write the result to FILE as JSON.")
PLUGIN = click.option(
    "--plugin",
    multiple=True,
    metavar="FILE",
    type=Place("input"),
    expose_value=False,
    callback=lambda ctx, param, value: plugins.add(value),
    help="A cause of your own; repeat.",
)


def warn(warnings: Iterable[str]) -> None:
    """Print warnings, a line each, on standard error."""
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)


def costly(
    experiment: Experiment,
    ids: Iterable[GroupId],
    terms: Iterable[Term] = (),
    *,
    minutes: float = 10.0,
    rest: str = "",
) -> list[str]:
    """A line that says what a fit to some groups takes, if that is much; nothing else.

    Parameters
    ----------
    experiment : Experiment
    ids : iterable of group ids
    terms : iterable of Term
    minutes : float
        Up to which nothing is said, unless more than half of the machine's memory is needed.
    rest : str
        What else is to be said then.
    """
    from psafit.experiment.text import listed, one_line
    from psafit.inference.cost import cost, machine_memory
    from psafit.inference.problem import Problem
    from psafit.progress import duration

    groups = tuple(group.id for group in experiment.select(ids))
    problem = Problem(experiment, groups, tuple(terms))
    found, there = cost(problem), machine_memory()
    scarce = found.memory > 0.5 * there
    if found.seconds < 60 * minutes and not scarce:
        return []
    fitted = f"a fit to group{'s' * (len(groups) > 1)} {listed(map(str, groups))} ({problem.observed.size} readings)"
    size = f"{found.memory / 1e9:.1f} GB of memory{f', of {there / 1e9:.1f} GB,' if scarce else ''}"
    return [
        one_line(f"{fitted} takes about {duration(found.seconds)} and {size} on this machine, with fewer less{rest}")
    ]


def long_sweeps(
    experiment: Experiment, *, minutes: float = 10.0, timed: tuple[int, float] = (600, 8.0), tests: int = 4
) -> list[str]:
    """A line for each sweep or trace whose tests in a diagnosis take long; see docs/limits.md.

    Parameters
    ----------
    experiment : Experiment
    minutes : float
        Up to which nothing is said.
    timed : (int, float)
        Readings of a sweep, and the seconds that a test for a discrepancy takes with them; the cost grows with the
        third power of the readings.
    tests : int
        Of a diagnosis: baseline and best model, and what other verdicts compare.
    """
    from psafit.progress import duration

    found = []
    for part in (part for group in experiment.groups for part in group.parts):
        seconds = tests * timed[1] * (part.n_points / timed[0]) ** 3
        if seconds > 60 * minutes:
            what = f"group {part.label}: tests for a discrepancy without a name take about {duration(seconds)} with"
            few = math.floor(timed[0] * (60 * minutes / (tests * timed[1])) ** (1 / 3) / 100) * 100
            found.append(f"{what} {part.n_points:,} readings in one sweep; {few:,} of them take {minutes:g} min")
    return found


def discard_output() -> None:
    """Let the interpreter end without complaint about output that nobody takes."""
    with suppress(OSError, AttributeError):  # no descriptor where somebody has replaced or closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def groups_of(text: str, experiment: Experiment) -> list[GroupId]:
    """The groups that ``--group`` names."""
    ids: list[GroupId] = [part.strip() for part in text.split(",")]
    if not all(ids) or len(set(ids)) < len(ids):
        raise InputError(f"--group {text!r} is not a list of different group ids", "write for example --group 1,2")
    experiment.select(ids)
    return ids


def causes(text: str, option: str = "--terms") -> tuple[Term, ...]:
    """Return the causes that an option names."""
    from psafit.physics import terms as catalogue

    ids = [part.strip() for part in text.split(",")]
    if not all(ids):
        raise InputError(f"{option} {text!r} is not a list of causes", f"write for example {option} amplifier_lag,gap")
    return catalogue(ids)


def plugin_words() -> list[object]:
    """The options that name the plugins at work, however they were named."""
    return [word for file in plugins.files() for word in ("--plugin", file)]


def print_scores(validation: Any, *, extended: bool) -> None:
    """Print how each group was predicted, and why the values of the fit may stand in for something else.

    Of a model that causes extend, a diagnosis may have said more.
    """
    from psafit.validate import caution, drifting

    if why := caution(validation):
        click.echo(f"{why}{STANDING_IN}")
    if extended and drifting(validation):
        click.echo(
            "a diagnosis weighs drifts more carefully: where one has named this model and found nothing left, go by it"
        )
    for s in validation.groups:
        click.echo(f"group {s.group}{s.of} ({s.role}): log_rmse {s.log_rmse:.3f}; {s.verdict}")
    if validation.holdout_log_rmse is not None:
        click.echo(f"mean log_rmse over held-out groups: {validation.holdout_log_rmse:.3f}")


def unresolved(error: float, required: float) -> str:
    """What is said of a simulation that has not converged."""
    return (
        f"the simulation has not converged at these parameters: ranges err by up to {error:.1g} (relative),"
        f" {required:.1g} would do; Numerics on the page says where"
    )


def from_here(path: Path) -> Path:
    """A path as it is typed in the current folder: one below that without what leads there."""
    here = Path.cwd()
    return path.relative_to(here) if path.is_relative_to(here) else path


def shown_path(path: str | Path) -> str:
    """A path for a line of the terminal, without what would steer that."""
    return escaped(click.format_filename(path))


def escaped(text: str) -> str:
    """Text in which every character can be seen."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def refuse_run_file(json_file: Path | None, folder: Path) -> None:
    """Refuse a ``--json`` file that the command itself writes into its folder, or into one in it."""
    if json_file is None:
        return
    real, place = json_file.resolve(), folder.resolve()
    if real.is_relative_to(place) and (real.parent != place or real.name in RUN_FILES):
        raise InputError("is a file of the run itself", "choose another place with --json", file=json_file)


def refuse_both(jobs: int | None, scheduler: str | None) -> None:
    """Refuse processes of this machine together with a Dask scheduler; neither is given where it is None."""
    if scheduler and jobs is not None:
        raise InputError("--jobs and --scheduler are both given", "give one: Dask's workers are set where they start")


@contextmanager
def unwritten(file: Path, what: str) -> Iterator[None]:
    """Refuse in one line what a record read from `file` holds that psafit could not have written there."""
    try:
        yield
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise InputError(what, "repeat the diagnosis", file=file) from error


def write_result(json_file: Path | None, record: Any) -> None:
    """Write what ``--json`` asks for."""
    if json_file is not None:
        from psafit.records import write_json

        write_json(json_file, record)


def say_idle(causes: Sequence[str], *, err: bool = False) -> None:
    """Print causes that do not act, if there are any."""
    if causes:
        click.echo(f"no effect on these drives and readings: {', '.join(causes)}", err=err)

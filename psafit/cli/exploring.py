"""`psafit simulate`, `report` and `watch`: thin, and lazy like the command line they hang on."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import psafit
from psafit.cli.common import (
    DONE,
    EXPERIMENT,
    JSON,
    PLUGIN,
    QUIET,
    Command,
    Place,
    causes,
    escaped,
    shown_path,
    write_result,
)
from psafit.errors import LARGEST_SEED, InputError

if TYPE_CHECKING:
    from rich.table import Table

    from psafit.arrays import FloatArray
    from psafit.experiment import Group, Plan
    from psafit.parameters import Parameter
    from psafit.physics.term import Term
    from psafit.watch import State

    _Model = tuple[tuple[Term, ...], dict[str, float]]

PICTURES = (".png", ".svg", ".pdf")
# Tied sets that a picture shows.
_DRAWN = 4


@click.command(cls=Command, short_help="Simulate the launch ranges of an experiment or a plan.")
@EXPERIMENT
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="A parameter in SI units; repeat.")
@click.option("--terms", "ids", default="", metavar="ID[,ID...]", help="Causes to add to the baseline.")
@click.option("--run", type=Place("input"), help="Take model and medians of this fit or diagnosis.")
@click.option(
    "--out", type=Place("file"), help="CSV file; by default standard output, unless something else is asked for."
)
@click.option("--plot", type=Place("file"), metavar="FILE", help="Draw every group: .png, .svg or .pdf.")
@click.option("--readings", type=Place("folder"), metavar="EXP", help="A new experiment folder with these readings.")
@click.option("--seed", type=click.IntRange(0, LARGEST_SEED), help="Scatter those readings, drawn from it.")
@PLUGIN
@QUIET
@JSON
def simulate(
    experiment: Path,
    values: tuple[str, ...],
    ids: str,
    run: Path | None,
    out: Path | None,
    plot: Path | None,
    readings: Path | None,
    seed: int | None,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Simulate the launch ranges at an experiment's conditions, measured or planned: EXP needs no readings.

    What neither --set nor --run gives has the median of its prior; the strength of a cause must be given. With
    --readings they become an experiment that can be diagnosed: exact or, with --seed, with scatter (--set sigma_rel,
    sigma_abs, nu) and sessions' own values drawn as the model has them. A picture of a diagnosis that ties
    several sets shows up to four of them, unless --set or --terms asks for one.
    """
    import numpy as np

    from psafit.experiment import Group, by_group, read_plan
    from psafit.files import write_atomically
    from psafit.inference import noise
    from psafit.simulate import Design
    from psafit.simulate import simulate as simulate_batch

    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise InputError("is no kind of picture psafit writes", f"end its name in {' or '.join(PICTURES)}", file=plot)
    if seed is not None and readings is None:
        raise InputError("--seed scatters what --readings writes", "add --readings FOLDER, or leave it out")
    if readings is not None:
        _refuse_within(readings, {"--out": out, "--plot": plot, "--json": json_file})
    plan = read_plan(experiment)
    groups = plan.groups
    chosen = causes(ids) if ids else ()
    given = asked = _assignments(values)
    tied: list[_Model] = []
    if run is not None:
        (first, *rivals), known = _models_of(run)
        tied = [] if ids or asked else rivals
        chosen = chosen or first[0]
        given = _of_sessions(plan, *first, known, quiet, seed is not None) | asked
    scatter = () if seed is None else noise.PARAMETERS
    theta = _completed(plan, chosen, given, asked, scatter, seed)
    model = list(theta.values())[: len(theta) - len(scatter)]
    result = simulate_batch(Design.of(plan.constants, groups), np.array(model), chosen)
    micrometres = result.read_um[0]
    each = by_group(groups, micrometres)
    curves = {}
    if plot is not None:  # of every model before anything is written: one may be refused
        models = [(chosen, model)]
        if tied:  # they differ by what they are, not by what a session happens to have
            models = [
                (
                    terms,
                    list(_completed(plan, terms, _of_sessions(plan, terms, medians, known, quiet=True), {}).values()),
                )
                for terms, medians in ((chosen, first[1]), *tied)
            ]
        names = _apart([terms for terms, _ in models]) if tied else ["simulated"]
        # Also between the conditions that were asked for.
        designs = [Design.of(plan.constants, members) for members in (groups, [g.filled() for g in groups])]
        for name, (terms, row) in zip(names, models, strict=True):
            curves[name] = [simulate_batch(d, np.array(row), terms).read_um[0] for d in designs]
    rows = ["group,waveform,frequency_hz,amplitude_v,launch_range_um,predicted_um"]
    for g, predicted in zip(groups, each, strict=True):
        measured = g.launch_range_um.tolist() if isinstance(g, Group) else [""] * g.n_points
        columns = (g.frequency_hz.tolist(), g.amplitude_v.tolist(), measured, predicted.tolist())
        rows += [f"{g.id},{g.waveform},{f!r},{v!r},{y},{p!r}" for f, v, y, p in zip(*columns, strict=True)]
    text = "\n".join(rows) + "\n"
    if out is not None:
        write_atomically(out, text.encode())
    elif not quiet and plot is None and readings is None:
        click.echo(text, nl=False)
    if readings is not None:
        _write_readings(plan, micrometres, chosen, theta, seed, readings)
        if not quiet:
            click.echo(f"experiment: {shown_path(readings)}")
            click.echo("made by: " + _values(theta))
    if plot is not None:
        from psafit.report.simulated import write_picture

        write_picture(groups, curves, plot)
        if not quiet:
            click.echo(f"picture: {shown_path(plot)}")
    write_result(
        json_file,
        {
            "terms": [t.id for t in chosen],
            "parameters": theta,
            "engine": result.engine,
            "predicted_um": micrometres,
        },
    )
    return DONE


def _refuse_within(folder: Path, others: dict[str, Path | None]) -> None:
    """Refuse an output in the folder of the readings, or on the way to it."""
    place = folder.resolve()
    for option, path in others.items():
        if path is not None and (place in path.resolve().parents or path.resolve() in place.parents):
            raise InputError(f"lies in --readings, or that in {option}", f"choose another {option}", file=path)


def _values(theta: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in theta.items())


def _write_readings(
    plan: Plan,
    ranges_um: FloatArray,
    chosen: Sequence[Term],
    theta: dict[str, float],
    seed: int | None,
    folder: Path,
) -> None:
    """An experiment folder whose readings are simulated ranges, (n_points,), scattered where there is a seed."""
    import numpy as np

    from psafit.experiment import read_experiment, write_experiment
    from psafit.files import filling
    from psafit.inference import noise
    from psafit.inference.problem import Problem

    model = "+".join(["baseline", *(t.id for t in chosen)])
    drawn_from = "exact" if seed is None else f"scatter of seed {seed}"
    source = f"not measured: simulated by psafit {psafit.__version__}, {model}, {drawn_from}: {_values(theta)}"
    made = plan.with_readings(ranges_um, source)
    if seed is not None:
        known = Problem(made, made.ids).known_sigma
        scatter = np.array([[theta[p.name] for p in noise.PARAMETERS]])
        drawn = noise.draw(ranges_um[None], scatter, known, np.random.default_rng(seed))[0]
        made = made.with_readings(np.maximum(drawn, 0.0))
    with filling(folder):
        write_experiment(made, folder)
        read_experiment(folder)  # ranges may be beyond what an experiment can hold


def _models_of(run: Path) -> tuple[list[_Model], tuple[Group, ...]]:
    """Causes and posterior medians of a run, and its readings.

    Of a diagnosis first those that it names (where it names none, its best), then those that it ties with them.
    """
    from psafit.diagnose.record import RESULT, Diagnosis, is_diagnosis
    from psafit.experiment import read_experiment
    from psafit.inference.run import load
    from psafit.physics import recorded
    from psafit.records import read_json

    if not is_diagnosis(run):
        fitted = load(run)
        medians = {p.name: p.median for p in fitted.summary.parameters}
        return [(fitted.problem.terms, medians)], fitted.problem.experiment.groups
    found = read_json(run / RESULT, Diagnosis, sealed=True, remedy="repeat the diagnosis")
    if not found.causes:  # somebody's own
        raise InputError("holds no model", "repeat the diagnosis", file=run / RESULT)
    tied = [c for c in found.causes[1:] if c.terms in found.alternatives][: _DRAWN - 1]
    models = [
        (recorded(c.terms, found.versions, run / RESULT), _medians(c.parameters, run / RESULT))
        for c in (found.causes[0], *tied)
    ]
    # Only what sessions have for themselves asks whose readings they are.
    latent = any(t.latent for terms, _ in models for t in terms)
    return models, read_experiment(run / "experiment").groups if latent else ()


def _medians(parameters: Mapping[str, Any], file: Path) -> dict[str, float]:
    try:
        return {name: float(p["median"]) for name, p in parameters.items()}
    except (KeyError, TypeError, ValueError) as error:  # somebody's own
        raise InputError("holds a parameter without a value", "repeat the diagnosis", file=file) from error


def _apart(sets: Sequence[Sequence[Term]]) -> list[str]:
    """What tells sets of causes apart, in words."""
    shared = set(sets[0]).intersection(*sets[1:])
    plain = "these alone" if shared else "the baseline"
    return [" + ".join(t.id for t in terms if t not in shared) or plain for terms in sets]


def _of_sessions(
    plan: Plan,
    terms: Sequence[Term],
    medians: dict[str, float],
    measured: Sequence[Group],
    quiet: bool,
    drawn: bool = False,
) -> dict[str, float]:
    """Medians without what sessions had for themselves, but of those whose very readings the plan holds.

    A session to come is another one, whatever its id is.
    """
    from psafit.experiment import Group, session_name

    known = {(g.id, g.launch_range_um.tobytes()) for g in measured}
    new = [g for g in plan.groups if not (isinstance(g, Group) and (g.id, g.launch_range_um.tobytes()) in known)]
    theirs = {session_name(t.latent.name, g.id) for t in terms if t.latent for g in new} & medians.keys()
    if theirs and not quiet:
        click.echo(
            f"sessions to come, not those of the run: {', '.join(sorted(theirs))} {'drawn' if drawn else '= 0'}",
            err=True,
        )
    return {name: value for name, value in medians.items() if name not in theirs}


def _assignments(values: tuple[str, ...]) -> dict[str, float]:
    given: dict[str, float] = {}
    for text in values:
        name, _, number = (part.strip() for part in text.partition("="))
        if name in given:
            raise InputError(f"--set gives {name} twice", "give each parameter once")
        try:
            if "_" in number or not number.isascii():
                raise ValueError("no digits of a CSV file")
            given[name] = float(number)
        except ValueError:
            raise InputError(f"--set {text!r} is not NAME=VALUE", "write for example --set k_c=1.4e5") from None
    return given


def _completed(
    plan: Plan,
    chosen: Sequence[Term],
    given: dict[str, float],
    asked: dict[str, float],
    scatter: Sequence[Parameter] = (),
    seed: int | None = None,
) -> dict[str, float]:
    """Every value the simulator takes, and those of the scatter behind them, if they are wanted.

    What is not given has its prior's median; a cause's strength must be given. What sessions have for themselves is
    drawn from its prior with a seed.
    """
    import numpy as np

    from psafit.experiment import session_name
    from psafit.experiment.text import meant
    from psafit.inference import noise
    from psafit.physics import informed, owner

    plain, chosen = informed(plan.beliefs, chosen)
    wanted: dict[str, tuple[Parameter, float | None]] = {p.name: (p, p.prior_median) for p in plain}
    for term in chosen:
        for p in term.parameters:
            wanted[p.name] = (p, None if p is term.strength else p.prior_median)
        if term.latent:
            own = np.zeros(len(plan.groups))
            if seed is not None:
                shares = np.random.default_rng([seed, 1]).uniform(size=len(plan.groups))
                own = term.latent.to_physical(term.latent.prior_quantile(shares))
            names = [session_name(term.latent.name, g.id) for g in plan.groups]
            wanted |= {name: (term.latent, float(z)) for name, z in zip(names, own, strict=True)}
    wanted |= {p.name: (p, p.prior_median) for p in scatter}
    unknown = sorted(asked.keys() - wanted.keys())
    if unknown:
        cause = owner(unknown[0])
        remedy = f"add --terms {cause}" if cause else meant(unknown[0], wanted)
        if unknown[0] in {p.name for p in noise.PARAMETERS}:
            remedy = "it is of the scatter: add --readings FOLDER --seed N"
        if hasattr(plan.constants, unknown[0]):
            remedy = "it is a constant of the rig: change [constants] in experiment.toml, or give one group its own"
        raise InputError(f"no parameter {unknown[0]}", remedy)
    theta = {}
    for name, (parameter, usual) in wanted.items():
        value = given.get(name, usual)
        if value is None:
            raise InputError(f"no value for {name}", f"add --set {name}=VALUE ({parameter.unit}) or --run RUN")
        low, high = parameter.bounds.lower, parameter.bounds.upper
        if not low <= value <= high:
            unit = "" if parameter.unit == "1" else f" {parameter.unit}"
            raise InputError(f"{name} = {value:g}{unit} is impossible", f"choose between {low:g} and {high:g}{unit}")
        theta[name] = value
    return theta


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
    from psafit.compare import compare, read_side, told_apart
    from psafit.files import encodable
    from psafit.report.comparison import write_comparison

    page = out or first / f"comparison-{encodable(second.resolve().name)}.html"
    if json_file is not None and json_file.resolve() == page.resolve():
        raise InputError("is the page itself", "choose another place with --json", file=json_file)
    a, b = told_apart(read_side(first), read_side(second))
    found = compare(a, b)
    return write_comparison(a, b, found, page), found


def _again(run: Path, experiment: Path | None) -> Iterator[Path]:
    from psafit.diagnose.record import RESULT, is_diagnosis

    if found := is_diagnosis(run):
        opened = psafit.load_diagnosis(run, experiment)
        try:
            yield opened.report()
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:  # somebody's own diagnosis.json
            raise InputError("holds what psafit could not have written", "diagnose again", file=run / RESULT) from error
    elif experiment is not None:
        raise InputError("--experiment is for a diagnosis", "leave it out: a fit keeps its measurements")
    if not found or (run / "fit.json").exists():
        yield psafit.load(run).report()


@click.command(cls=Command)
@click.argument("run", metavar="RUN", type=Place("input"))
@click.option("--once", is_flag=True, help="Say how far it is, and end.")
@click.option(
    "--every", type=click.FloatRange(0.1, 86400), default=2.0, show_default=True, help="Seconds between looks."
)
@QUIET
@JSON
def watch(run: Path, once: bool, every: float, quiet: bool, json_file: Path | None) -> int:
    """Show how far a running fit is, until it has ended.

    It only reads: nothing in the folder is changed or locked. Ctrl-C ends the watching, not the fit.
    """
    import sys

    from psafit.watch import look

    if math.isnan(every):
        raise InputError("--every nan is no time", "give seconds")
    state = look(run)
    if once or state.finished:
        if not quiet:
            click.echo(_line(state))
    else:
        show = _looks if quiet else _live if sys.stdout.isatty() else _lines
        with suppress(KeyboardInterrupt):
            for found in show(run, state, every):
                state = found
    write_result(json_file, state)
    return DONE


def _looks(run: Path, state: State, every: float) -> Any:
    """One state after the other, until nothing more will come."""
    from psafit.watch import look

    while True:
        yield state
        if state.finished:
            return
        time.sleep(every)
        state = look(run, state)


def _lines(run: Path, state: State, every: float) -> Any:
    """A line whenever something has changed."""
    said = ""
    for found in _looks(run, state, every):
        if (line := _line(found)) != said:
            said = line
            click.echo(line)
        yield found


def _live(run: Path, state: State, every: float) -> Any:
    """A table that stays in its place."""
    from rich.live import Live

    with Live(auto_refresh=False) as live:
        for found in _looks(run, state, every):
            live.update(_table(run, found), refresh=True)
            yield found


_STAGES = {
    "search": "searching for minima; sampling has not begun",
    "sample": "sampling",
    "profile": "the chain is long enough; describing the posterior",
    "done": "done",
    "gave up": "gave up before it converged; repeat the psafit fit command to draw on",
}


def _stage(state: State) -> str:
    if state.running is False and not state.finished:
        return "interrupted: nothing works in this folder now; repeat the psafit fit command to go on"
    if state.stalled:
        return "no new checkpoint for long: has it been stopped? Repeat the psafit fit command to go on"
    if state.stage == "sample" and state.steps is None:
        return "sampling; no checkpoint yet"
    return _STAGES[state.stage]


def _facts(state: State) -> list[tuple[str, str]]:
    """What there is to tell, each with its goal and unit."""
    from psafit.inference.store import told_r_hat
    from psafit.progress import duration

    s = state
    facts = []
    if s.steps is not None:
        facts.append(("steps", f"{s.steps} of each of {s.walkers} walkers"))
    if s.acceptance is not None:
        facts.append(("acceptance", f"{100 * s.acceptance:.0f} %"))
    if s.autocorrelation_times is not None and s.autocorrelation_time is not None:
        length = f"{math.floor(s.autocorrelation_times)} autocorrelation times of {s.autocorrelation_time:.0f} steps"
        facts.append(("length", f"{length} (goal {s.wanted_times:.0f})"))
    if s.r_hat is not None and s.wanted_r_hat is not None:
        facts.append(("R-hat", f"{told_r_hat(s.r_hat, s.wanted_r_hat)} (goal {s.wanted_r_hat:g})"))
    if s.log_posterior is not None:
        facts.append(("best log posterior", f"{s.log_posterior:.2f} (the search's {s.best_minimum:.2f})"))
    elif s.best_minimum is not None:
        facts.append(("best log posterior", f"{s.best_minimum:.2f}, of the search"))
    if s.seconds_left is not None and not s.stalled:
        # A short chain makes the autocorrelation time too short.
        long = (s.autocorrelation_times or 0.0) >= 0.5 * (s.wanted_times or 0.0)
        facts.append(("time left", f"{'about' if long else 'at least'} {duration(s.seconds_left)}"))
    return facts


def _line(state: State) -> str:
    return "; ".join([_stage(state), *(f"{name} {text}" for name, text in _facts(state))])


def _table(run: Path, state: State) -> Table:
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_row(Text(escaped(run.name), style="bold"), Text(_stage(state)))
    if state.autocorrelation_times is not None and state.wanted_times is not None:
        table.add_row("", ProgressBar(total=state.wanted_times, completed=state.autocorrelation_times, width=40))
    for name, text in _facts(state):
        table.add_row(Text(name, style="dim"), Text(text))
    return table

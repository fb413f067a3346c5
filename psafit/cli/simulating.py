"""`psafit simulate`: readings of a model at conditions measured or planned, as a table, a picture or an experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

import psafit
from psafit.cli.common import (
    DONE,
    EXPERIMENT,
    JSON,
    PLUGIN,
    QUIET,
    STANDING_IN,
    Command,
    Place,
    causes,
    say_idle,
    shown_path,
    write_result,
)
from psafit.errors import LARGEST_SEED, InputError
from psafit.text import set_name, with_unit

if TYPE_CHECKING:
    from psafit.arrays import FloatArray
    from psafit.diagnose.record import Diagnosis
    from psafit.experiment import Conditions, Group, Plan
    from psafit.inference.run_folder import Run
    from psafit.parameters import Parameter
    from psafit.physics.term import Term

    _Model = tuple[tuple[Term, ...], dict[str, float]]

PICTURES = (".png", ".svg", ".pdf")


@click.command(cls=Command, short_help="Simulate the readings of an experiment or a plan.")
@EXPERIMENT
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="A parameter in SI units; repeat.")
@click.option("--terms", "ids", default="", metavar="ID[,ID...]", help="Causes to add to the baseline.")
@click.option("--run", type=Place("input"), help="Take model and medians of this fit or diagnosis.")
@click.option(
    "--out", type=Place("file"), help="CSV file; by default standard output, unless something else is asked for."
)
@click.option(
    "--plot",
    type=Place("file"),
    metavar="FILE",
    help="Draw every group, a panel for each observable: .png, .svg or .pdf.",
)
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
    """Simulate what is read at an experiment's conditions, measured or planned: EXP needs no readings.

    What neither --set nor --run gives has the median of its prior; the strength of a cause must be given. With
    --readings they become an experiment that can be diagnosed: exact or, with --seed, with scatter (--set sigma_rel,
    sigma_abs, nu) and sessions' own values drawn as the model has them. A picture of a diagnosis that ties
    several sets shows up to four of them, unless --set or --terms asks for one. With the --run of a fit, and neither
    of these, each reading has its 90 % predictive interval, in the picture, too.
    """
    import numpy as np

    from psafit.experiment import read_plan
    from psafit.files import write_atomically
    from psafit.simulate import Design
    from psafit.simulate import readings as readings_of
    from psafit.simulate import simulate as simulate_batch

    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise InputError("is no kind of picture psafit writes", f"end its name in {' or '.join(PICTURES)}", file=plot)
    if seed is not None and readings is None:
        raise InputError("--seed scatters what --readings writes", "add --readings FOLDER, or leave it out")
    _refuse_within(readings, {"--out": out, "--plot": plot, "--json": json_file})
    plan = read_plan(experiment)
    groups = plan.groups
    chosen = causes(ids) if ids else ()
    given = asked = _assignments(values)
    said: tuple[list[_Model], dict[str, str], FloatArray | None] = [], {}, None
    if run is not None:
        opened = _opened(run)
        (first, *rivals), known = _models_of(run, opened)
        chosen = chosen or first[0]
        given = of_sessions(plan, *first, known, quiet, seed is not None) | asked
        if not (ids or asked):
            said = rivals, _standing(run, opened, quiet), _intervals(opened, plan)
    tied, standing, ends = said
    _say_of_conditions(chosen, groups, quiet)
    scatter = () if seed is None else _scatter(plan)
    theta = completed(plan, chosen, given, asked, scatter, seed)
    model = list(theta.values())[: len(theta) - len(scatter)]
    design = Design.of(plan.constants, groups)
    result = simulate_batch(design, np.array(model), chosen)
    predicted = readings_of(design, np.array(model), chosen)[0]
    if plot is not None:  # of every model before anything is written: one may be refused
        models = [(chosen, model)]
        if tied:  # they differ by what they are, not by what a session happens to have
            each = ((t, of_sessions(plan, t, medians, known, quiet=True)) for t, medians in ((chosen, first[1]), *tied))
            models = [(t, list(completed(plan, t, own, {}).values())) for t, own in each]
        curves = _curves(plan, groups, models, _apart([t for t, _ in models]) if tied else ["simulated"])
    text = _table(groups, predicted, ends)
    if out is not None:
        write_atomically(out, text.encode())
    elif not quiet and plot is None and readings is None:
        click.echo(text, nl=False)
    if readings is not None:
        _write_readings(plan, predicted, chosen, theta, seed, readings)
        if not quiet:
            click.echo(f"experiment: {shown_path(readings)}")
            click.echo("made by: " + _values(theta))
    if plot is not None:
        from psafit.report.simulated import write_picture

        write_picture(groups, curves, plot, ends)
        if not quiet:
            _say_of_picture(plot, {name: value for name, value in theta.items() if name not in given})
    content = {"terms": [t.id for t in chosen], "parameters": theta, "engine": result.engine, **standing}
    write_result(json_file, content | _predictions(groups, predicted, ends))
    return DONE


def _say_of_conditions(chosen: Sequence[Term], groups: Sequence[Conditions], quiet: bool) -> None:
    """Say which causes do nothing at these conditions, and which plans may be of another observable than meant."""
    if quiet:
        return
    from psafit.physics.term import idle

    say_idle(idle(chosen, groups), err=True)
    for line in _taken_for_ranges(groups):
        click.echo(line, err=True)


def _say_of_picture(plot: Path, usual: dict[str, float]) -> None:
    """Say where a picture is, and which parameters nobody gave."""
    click.echo(f"picture: {shown_path(plot)}")
    if usual:
        click.echo(f"by the medians of their priors: {_values(usual)}", err=True)


def _opened(run: Path) -> Run | Diagnosis:
    """The fit or the diagnosis in a folder."""
    from psafit.diagnose.record import RESULT, Diagnosis, is_diagnosis
    from psafit.inference.run_folder import load
    from psafit.records import read_json

    if not is_diagnosis(run):
        return load(run)
    return read_json(run / RESULT, Diagnosis, sealed=True, remedy="repeat the diagnosis")


def _standing(place: Path, run: Run | Diagnosis, quiet: bool) -> dict[str, str]:
    """What a run says of what it would predict: a diagnosis its verdict, a fit why not to rely on it, if anything."""
    from psafit.diagnose.retest import once
    from psafit.inference.run_folder import Run
    from psafit.validate import caution, scored

    if isinstance(run, Run):
        why = caution(scored(run, retest=once)[0])
        said = f"{why}{STANDING_IN}" if why else ""
    else:
        said = run.headline
        if run.causes and run.verdict in ("ambiguous", "unexplained"):
            said += f"; what is simulated is {' + '.join(run.causes[0].terms) or 'no cause'}"
    if said and not quiet:
        click.echo(f"{shown_path(place)}: {said}", err=True)
    return {"run": said} if said else {}


def _taken_for_ranges(groups: Sequence[Conditions]) -> list[str]:
    """A line for each planned group of launch ranges where launches were measured, and no range of any."""
    from psafit.experiment import Group
    from psafit.observables import LAUNCH_RANGE

    read = list(dict.fromkeys(o for g in groups if isinstance(g, Group) for o in g.observables if not o.traced))
    if not read or LAUNCH_RANGE in read:
        return []
    others, columns = (" and ".join(names) for names in ([o.titles for o in read], [o.column for o in read]))
    empty = f"empty columns {columns} ask" if len(read) > 1 else f"an empty column {columns} asks"
    return [
        f"group {g.id} is planned and read as {LAUNCH_RANGE.titles}, the measured groups as {others};"
        f" in {shown_path(g.file)}, {empty} for these"
        for g in groups
        if not isinstance(g, Group) and g.observables == (LAUNCH_RANGE,)
    ]


def _curves(
    plan: Plan, groups: Sequence[Conditions], models: Sequence[tuple[Sequence[Term], list[float]]], names: Sequence[str]
) -> dict[str, tuple[FloatArray, FloatArray]]:
    """What each model says at the conditions that were asked for, and between them."""
    import numpy as np

    from psafit.simulate import Design, readings

    here, between = (Design.of(plan.constants, members) for members in (groups, [g.filled() for g in groups]))
    return {
        name: (readings(here, np.array(row), terms)[0], readings(between, np.array(row), terms)[0])
        for name, (terms, row) in zip(names, models, strict=True)
    }


def _intervals(run: Run | Diagnosis, plan: Plan) -> FloatArray | None:
    """Ends of the 90 % intervals of the plan's readings, (2, n_points), by a fit; a diagnosis keeps no draws."""
    from psafit.inference.run_folder import Run
    from psafit.validate import intervals

    return intervals(run, plan) if isinstance(run, Run) else None


def _predictions(groups: Sequence[Conditions], predicted: FloatArray, ends: FloatArray | None) -> dict[str, object]:
    """Simulated readings for a result file, and where there are `ends`, (2, n_points), those of their 90 % intervals.

    Each is a list of launch ranges, or one of each observable by its column.
    """
    import numpy as np

    from psafit.observables import LAUNCH_RANGE, OBSERVABLES

    measured = np.concatenate([g.measured for g in groups])
    rows = {"predicted": predicted} | ({} if ends is None else dict(zip(("lower", "upper"), ends, strict=True)))
    kinds = [OBSERVABLES[k] for k in np.unique(measured)]
    if kinds == [LAUNCH_RANGE]:
        return {f"{name}_um": values for name, values in rows.items()}
    at = {o.column: measured == OBSERVABLES.index(o) for o in kinds}
    return {name: {column: values[here] for column, here in at.items()} for name, values in rows.items()}


def _table(groups: Sequence[Conditions], predicted: FloatArray, ends: FloatArray | None) -> str:
    """The CSV of simulated readings, (n_points,), one group after the other, with what was measured.

    Where there are `ends`, (2, n_points), the 90 % interval of a reading stands behind them.
    Where not all are of one observable, a column names it; where there are traces, one gives the time of their samples.
    """
    import numpy as np

    from psafit.experiment import Group, by_group
    from psafit.observables import OBSERVABLES
    from psafit.validate import columns_of

    kinds = dict.fromkeys(o for g in groups for o in g.observables)
    first, said = next(iter(kinds)), len(kinds) > 1
    names = columns_of(first)
    column = names[names.index(first.column) :][: 2 if ends is None else 4]
    named = ("observable", *("measured", "predicted", "lower", "upper")[: len(column)]) if said else column
    timed = any(g.time_us is not None for g in groups)
    rows = [",".join(("group,waveform,frequency_hz,amplitude_v", *(["time_us"] if timed else []), *named))]
    printed = predicted[:, None] if ends is None else np.column_stack([predicted, *ends])
    for g, values in zip(groups, by_group(groups, printed), strict=True):
        measured = g.reading.tolist() if isinstance(g, Group) else [""] * g.n_points
        of = [f"{OBSERVABLES[k].column}," if said else "" for k in g.measured]
        times = [""] * g.n_points if g.time_us is None else [repr(t) for t in g.time_us.tolist()]
        at = [f"{t}," if timed else "" for t in times]
        each = (",".join(map(repr, row)) for row in values.tolist())
        columns = (g.frequency_hz.tolist(), g.amplitude_v.tolist(), at, of, measured, each)
        rows += [f"{g.id},{g.waveform},{f!r},{v!r},{t}{o}{y},{p}" for f, v, t, o, y, p in zip(*columns, strict=True)]
    return "\n".join(rows) + "\n"


def _refuse_within(folder: Path | None, others: dict[str, Path | None]) -> None:
    """Refuse an output in the folder of the readings, if there is one, or on the way to it."""
    if folder is None:
        return
    place = folder.resolve()
    for option, path in others.items():
        if path is not None and (place in path.resolve().parents or path.resolve() in place.parents):
            raise InputError(f"lies in --readings, or that in {option}", f"choose another {option}", file=path)


def _values(theta: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in theta.items())


def _write_readings(
    plan: Plan,
    exact: FloatArray,
    chosen: Sequence[Term],
    theta: dict[str, float],
    seed: int | None,
    folder: Path,
) -> None:
    """An experiment folder whose readings are simulated readings, (n_points,), scattered where there is a seed."""
    import numpy as np

    from psafit.experiment import read_experiment, write_experiment
    from psafit.files import filling
    from psafit.inference import noise
    from psafit.inference.problem import Problem

    model = "+".join(["baseline", *(t.id for t in chosen)])
    drawn_from = "exact" if seed is None else f"scatter of seed {seed}"
    source = f"not measured: simulated by psafit {psafit.__version__}, {model}, {drawn_from}: {_values(theta)}"
    made = plan.with_readings(exact, source)
    if seed is not None:
        problem = Problem(made, made.ids)
        scatter = problem.noise_of(np.array([[theta[p.name] for p in problem.scatter]]), problem.design)
        drawn = noise.draw(exact[None], scatter, problem.known_sigma, np.random.default_rng(seed))[0]
        made = made.with_readings(np.maximum(drawn, problem.floor))
    with filling(folder):
        write_experiment(made, folder)
        read_experiment(folder)  # ranges may be beyond what an experiment can hold


def _models_of(place: Path, run: Run | Diagnosis, most: int = 4) -> tuple[list[_Model], tuple[Group, ...]]:
    """Causes and posterior medians of a run in a folder, of `most` models, and its readings.

    Of a diagnosis first those that it names (where it names none, its best), then those that it ties with them.
    """
    from psafit.diagnose.record import RESULT
    from psafit.experiment import read_experiment
    from psafit.inference.run_folder import Run
    from psafit.physics import recorded

    if isinstance(run, Run):
        medians = {p.name: p.median for p in run.summary.parameters}
        return [(run.problem.terms, medians)], run.problem.experiment.groups
    if not run.causes:  # somebody's own
        raise InputError("holds no model", "repeat the diagnosis", file=place / RESULT)
    tied = [c for c in run.causes[1:] if c.terms in run.alternatives][: most - 1]
    models = [
        (recorded(c.terms, run.versions, place / RESULT), {name: p.median for name, p in c.parameters.items()})
        for c in (run.causes[0], *tied)
    ]
    # Only what sessions have for themselves asks whose readings they are.
    latent = any(t.latent for terms, _ in models for t in terms)
    return models, read_experiment(place / "experiment").groups if latent else ()


def _scatter(plan: Plan) -> tuple[Parameter, ...]:
    """The parameters of the scatter of all that a plan reads."""
    from psafit.observables import OBSERVABLES
    from psafit.physics import informed_scatter

    kinds = sorted({int(k) for g in plan.groups for k in g.measured})
    return tuple(p for k in kinds for p in informed_scatter(plan.beliefs, OBSERVABLES[k]))


def _apart(sets: Sequence[Sequence[Term]], most: int = 2) -> list[str]:
    """Names of sets of causes that say what distinguishes them; what all share is counted if it is more than `most`."""
    shared = [t for t in sets[0] if all(t in terms for terms in sets)]
    counted = [f"the {len(shared)} shared causes"] if len(shared) > most else [t.id for t in shared]
    return [set_name((*counted, *(t.id for t in terms if t not in shared)), "the baseline") for terms in sets]


def of_sessions(
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
    from psafit.experiment import Occasions, known_sessions

    known = known_sessions(plan.groups, measured)
    new = Occasions.of(g for g in plan.groups if g.session_id not in known)
    theirs = {name for term in terms for name in term.latent_names(new)} & medians.keys()
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


def completed(
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

    from psafit.experiment import Occasions
    from psafit.experiment.text import did_you_mean, listed
    from psafit.observables import OBSERVABLES
    from psafit.physics import TERMS, informed, owner

    plain, chosen = informed(plan.beliefs, chosen)
    wanted: dict[str, tuple[Parameter, float | None]] = {p.name: (p, p.prior_median) for p in plain}
    occasions, random = Occasions.of(plan.groups), None if seed is None else np.random.default_rng([seed, 1])
    for term in chosen:
        for p in term.parameters:
            wanted[p.name] = (p, None if p is term.strength else p.prior_median)
        if term.latent:
            names = term.latent_names(occasions)
            own = np.zeros(len(names))
            if random is not None:
                shares = random.uniform(size=len(names))
                own = term.latent.to_physical(term.latent.prior_quantile(shares))
            wanted |= {name: (term.latent, float(z)) for name, z in zip(names, own, strict=True)}
    wanted |= {p.name: (p, p.prior_median) for p in scatter}
    unknown = sorted(asked.keys() - wanted.keys())
    if unknown:
        cause = owner(unknown[0])
        remedy = f"add --terms {cause}" if cause else did_you_mean(unknown[0], wanted)
        if unknown[0] in {p.name for o in OBSERVABLES for p in o.scatter}:
            here = f"that of these readings has {listed(p.name for p in scatter)}"
            remedy = here if scatter else "it is of the scatter: add --readings FOLDER --seed N"
        if of := [t for t in (*chosen, *TERMS) if t.id == unknown[0]]:
            every = ",".join(dict.fromkeys([*(t.id for t in chosen), of[0].id]))
            remedy = f"it is a cause: --terms {every} --set {of[0].strength.name}=VALUE ({of[0].strength.unit})"
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
            given_one, most = (with_unit(f"{x:g}", parameter.unit) for x in (value, high))
            raise InputError(f"{name} = {given_one} is impossible", f"choose between {low:g} and {most}")
        theta[name] = value
    return theta

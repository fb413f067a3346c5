"""The command line: thin, and lazy, since `psafit --help` must not wait for the numerical libraries."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import psafit
from psafit.errors import InputError, PsafitError

if TYPE_CHECKING:
    from psafit.experiment import GroupId

DONE, CHECK_FAILED, BAD_INPUT = 0, 1, 2
EXPERIMENT = click.argument("experiment", metavar="EXP", type=click.Path(path_type=Path))
RUN = click.argument("run", metavar="RUN", type=click.Path(path_type=Path))
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
JSON = click.option("--json", "json_file", type=click.Path(path_type=Path), help="Write the result to FILE as JSON.")


def main() -> None:
    """Run the command; turn what psafit raises on purpose into one line and an exit code."""
    try:
        code = commands.main(standalone_mode=False, prog_name="psafit")
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = DONE
    except click.ClickException as error:
        where = f"psafit {error.ctx.info_name}" if getattr(error, "ctx", None) and error.ctx.parent else "psafit"  # type: ignore[attr-defined]
        message = " ".join(error.format_message().split())
        click.echo(f"{where}: {message.rstrip('.')}; see {where} --help", err=True)
        code = BAD_INPUT
    except InputError as error:
        click.echo(f"psafit: {error}", err=True)
        code = BAD_INPUT
    except PsafitError as error:
        click.echo(f"psafit: {error}", err=True)
        code = CHECK_FAILED
    except (KeyboardInterrupt, click.Abort):
        click.echo("psafit: interrupted; repeat the same command to go on where it stopped", err=True)
        code = BAD_INPUT
    except BrokenPipeError:
        sys.stderr.close()
        code = DONE
    sys.exit(code if isinstance(code, int) else DONE)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(psafit.__version__, prog_name="psafit")
def commands() -> None:
    """Fit contact-impact drives, and find what the simulation gets wrong."""


@commands.command()
@EXPERIMENT
@QUIET
@JSON
def check(experiment: Path, quiet: bool, json_file: Path | None) -> int:
    """Validate an experiment folder and say what is in it."""
    from psafit.experiment import describe, read_experiment

    content = describe(read_experiment(experiment))
    _write(json_file, content)
    if not quiet:
        click.echo(f"{content['title']}: {len(content['groups'])} groups, {content['n_points']} readings")
        for group in content["groups"]:
            spans = (
                _span(group["frequency_hz"], "Hz"),
                _span(group["amplitude_v"], "V"),
                _span(group["launch_range_um"], "um"),
            )
            click.echo(
                f"  group {group['id']}: {group['waveform']}, {group['n_points']} readings, "
                f"{spans[0]}, {spans[1]}, launch range {spans[2]}"
            )
        for warning in content["warnings"]:
            click.echo(f"warning: {warning}", err=True)
    return DONE


@commands.command()
@EXPERIMENT
@click.option("--set", "values", multiple=True, metavar="NAME=VALUE", help="A parameter in SI units; repeat.")
@click.option("--run", type=click.Path(path_type=Path), help="Take the posterior medians of this run instead.")
@click.option("--out", type=click.Path(path_type=Path), help="CSV file; standard output by default.")
@QUIET
@JSON
def simulate(
    experiment: Path, values: tuple[str, ...], run: Path | None, out: Path | None, quiet: bool, json_file: Path | None
) -> int:
    """Simulate the launch ranges at an experiment's conditions."""
    import numpy as np

    from psafit.experiment import read_experiment
    from psafit.files import write_atomically
    from psafit.physics.baseline import PARAMETERS
    from psafit.simulate import Design
    from psafit.simulate import simulate as simulate_batch

    data = read_experiment(experiment)
    given = _assignments(values)
    if run is not None:
        from psafit.inference.run import load

        given = {p.name: p.median for p in load(run).summary.parameters} | given
    theta = []
    for p in PARAMETERS:
        if p.name not in given:
            raise InputError(f"no value for {p.name}", f"add --set {p.name}=VALUE ({p.unit}) or --run RUN")
        if not p.bounds.lower <= given[p.name] <= p.bounds.upper:
            raise InputError(
                f"{p.name} = {given[p.name]:g} {p.unit} is impossible",
                f"choose between {p.bounds.lower:g} and {p.bounds.upper:g} {p.unit}",
            )
        theta.append(given[p.name])
    unknown = set(_assignments(values)) - {p.name for p in PARAMETERS}
    if unknown:
        raise InputError(f"no parameter {sorted(unknown)[0]}", f"choose from {', '.join(p.name for p in PARAMETERS)}")
    result = simulate_batch(Design.of(data.constants, data.groups), np.array(theta))
    micrometres = (result.launch_range[0] * 1e6).tolist()
    rows = ["group,waveform,frequency_hz,amplitude_v,launch_range_um,predicted_um"]
    position = 0
    for g in data.groups:
        for f, v, y in zip(g.frequency_hz.tolist(), g.amplitude_v.tolist(), g.launch_range_um.tolist(), strict=True):
            rows.append(f"{g.id},{g.waveform},{f!r},{v!r},{y!r},{micrometres[position]!r}")
            position += 1
    text = "\n".join(rows) + "\n"
    if out is not None:
        write_atomically(out, text.encode())
    elif not quiet:
        click.echo(text, nl=False)
    _write(
        json_file,
        {
            "parameters": dict(zip([p.name for p in PARAMETERS], theta, strict=True)),
            "engine": result.engine,
            "predicted_um": micrometres,
        },
    )
    return DONE


@commands.command()
@EXPERIMENT
@click.option("--group", "group", required=True, metavar="ID[,ID...]", help="Group or groups to fit.")
@click.option("--terms", default="", metavar="ID[,ID...]", help="Causes to add to the baseline.")
@click.option("--out", type=click.Path(path_type=Path), help="Run folder; fits/<experiment>-group<id> by default.")
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=1, show_default=True)
@click.option("--starts", type=click.IntRange(1, 4096), default=48, show_default=True, help="Starts of the search.")
@click.option("--no-report", is_flag=True, help="Stop after the posterior: no validation, no report.")
@QUIET
@JSON
def fit(
    experiment: Path,
    group: str,
    terms: str,
    out: Path | None,
    seed: int,
    starts: int,
    no_report: bool,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Fit, sample, validate on the other groups and write the report.

    An interrupted run goes on where it stopped when the same command is repeated.
    """
    from psafit.experiment import read_experiment
    from psafit.progress import watcher

    data = read_experiment(experiment)
    ids = _groups(group)
    for group_id in ids:
        data.group(group_id)
    if terms:
        raise InputError(f"no cause {terms.split(',')[0]!r}", "see psafit terms for the causes there are")
    folder = out or Path("fits") / f"{experiment.resolve().name}-group{'-'.join(str(i) for i in ids)}"
    if not quiet:
        for warning in data.warnings:
            click.echo(f"warning: {warning}", err=True)
    with watcher(quiet) as show:
        from psafit.inference import run as running

        result = running.fit(data, ids, folder, seed=seed, n_starts=starts, watcher=show)
        if not no_report:
            show.stage("validate")
            from psafit.report.fit import write_report
            from psafit.validate import validate as check_predictions

            validation, predictions = check_predictions(result)
            show.stage("report")
            page = write_report(result, validation, predictions, command=_command())
    _write(json_file, {"fit": result.fit, "posterior": result.summary})
    if not quiet:
        best = result.fit.minima[0]
        click.echo(
            f"{len(result.fit.minima)} minima from {result.fit.n_starts} starts; the best was found {best.starts} times"
        )
        for p in result.summary.parameters:
            click.echo(f"  {p.text}")
        click.echo(f"posterior: {result.summary.message}")
        if not no_report:
            _print_scores(validation)
            click.echo(f"report: {page}")
    return DONE if result.summary.converged else CHECK_FAILED


@commands.command()
@RUN
@QUIET
@JSON
def validate(run: Path, quiet: bool, json_file: Path | None) -> int:
    """Check a run's posterior against the groups it never saw."""
    from psafit.inference.run import load
    from psafit.validate import validate as check_predictions

    validation, _ = check_predictions(load(run))
    _write(json_file, validation)
    if not quiet:
        _print_scores(validation)
    return DONE


@commands.command()
@RUN
@QUIET
def report(run: Path, quiet: bool) -> int:
    """Write a run's report.html again."""
    from psafit.inference.run import load
    from psafit.report.fit import write_report
    from psafit.validate import validate as check_predictions

    finished = load(run)
    page = write_report(finished, *check_predictions(finished), command=_command())
    if not quiet:
        click.echo(f"report: {page}")
    return DONE


@commands.command()
@click.argument("experiment", metavar="[EXP]", type=click.Path(path_type=Path), default=Path("experiments/psa"))
@click.option("--out", type=click.Path(path_type=Path), default=Path("fits/reproduction"), show_default=True)
@QUIET
@JSON
def reproduce(experiment: Path, out: Path, quiet: bool, json_file: Path | None) -> int:
    """Recompute the study's published results, with its time step and without."""
    from psafit.progress import watcher

    with watcher(quiet) as show:
        show.stage("reproduce")
        from psafit.inference.run import versions
        from psafit.records import write_json
        from psafit.report.reproduction import write_reproduction
        from psafit.reproduce import reproduce as recompute

        result = recompute(experiment)
        show.stage("report")
        used = ", ".join(f"{name} {version}" for name, version in versions().items())
        page = write_reproduction(result, out / "reproduction.html", {"Command": _command(), "Versions": used})
    write_json(out / "reproduction.json", result.to_dict())
    _write(json_file, result.to_dict())
    if not quiet:
        for c in result.claims:
            name = f"{c.place}, {c.statement} ({c.unit})"
            click.echo(f"{name}: published {c.published:g}, study's step {c.study_step:.4g}, "
                       f"converged {c.converged:.4g}: {c.verdict}")  # fmt: skip
        click.echo(f"report: {page}")
    return DONE


@commands.command()
@QUIET
@JSON
def terms(quiet: bool, json_file: Path | None) -> int:
    """List the causes that can be added to the baseline."""
    _write(json_file, [])
    if not quiet:
        click.echo("no causes in this version; the baseline's parameters are k_c, c_s and c_c")
    return DONE


def _groups(text: str) -> list[GroupId]:
    ids: list[GroupId] = [part.strip() for part in text.split(",")]
    if not all(ids) or len(set(ids)) < len(ids):
        raise InputError(f"--group {text!r} is not a list of different group ids", "write for example --group 1,2")
    return ids


def _assignments(values: tuple[str, ...]) -> dict[str, float]:
    given = {}
    for text in values:
        name, _, number = text.partition("=")
        try:
            given[name.strip()] = float(number)
        except ValueError:
            raise InputError(f"--set {text!r} is not NAME=VALUE", "write for example --set k_c=1.4e5") from None
    return given


def _span(span: list[float], unit: str) -> str:
    return f"{span[0]:g} {unit}" if span[0] == span[1] else f"{span[0]:g}-{span[1]:g} {unit}"


def _print_scores(validation: Any) -> None:
    for s in validation.groups:
        click.echo(f"group {s.group} ({s.role}): log_rmse {s.log_rmse:.3f}; {s.verdict}")
    if validation.holdout_log_rmse is not None:
        click.echo(f"mean log_rmse over held-out groups: {validation.holdout_log_rmse:.3f}")


def _write(json_file: Path | None, record: Any) -> None:
    if json_file is not None:
        from psafit.records import write_json

        write_json(json_file, record)


def _command() -> str:
    # Folders by name only: a report may leave the machine it was made on.
    return " ".join(["psafit", *(Path(a).name if "/" in a else a for a in sys.argv[1:])])

"""The command line: thin, and lazy, since `psafit --help` must not wait for the numerical libraries."""

from __future__ import annotations

import io
import itertools
import os
import re
import sys
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import psafit
from psafit import plugins
from psafit.errors import LARGEST_SEED, InputError, PsafitError

if TYPE_CHECKING:
    from psafit.diagnose.record import CauseResult, Diagnosis
    from psafit.experiment import Experiment, GroupId
    from psafit.physics.term import Term
    from psafit.records import CauseEntry, CauseParameterEntry

# Our matrices are small: threads of the linear algebra library only wait for each other there. Read when it is loaded.
for _library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

DONE, CHECK_FAILED, BAD_INPUT = 0, 1, 2
# Characters of a word above which a message shows its ends only: no path on a usual machine is longer.
_LONGEST_WORD = 300
RUN_FILES = (
    "fit.json",
    "chain.h5",
    "posterior.nc",
    "posterior.json",
    "validation.json",
    "predictions.csv",
    "numerics.json",
    "report.html",
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
            (p.type.role, p.opts[0], ctx.params[p.name])
            for p in self.params
            if p.name and isinstance(p.type, Place) and ctx.params.get(p.name) is not None
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
            _discard_output()
            return DONE


class Group(click.Group):
    """A group of such commands."""

    command_class = Command


EXPERIMENT = click.argument("experiment", metavar="EXP", type=Place("input"))
RUN = click.argument("run", metavar="RUN", type=Place("input"))
SEED = click.option("--seed", type=click.IntRange(0, LARGEST_SEED), default=1, show_default=True)
QUIET = click.option("--quiet", is_flag=True, help="Print nothing but errors.")
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


def _check_threads() -> None:
    """Numba reads its setting at import, and ends in a traceback where that is no number of threads."""
    try:
        usable = int(os.environ.get("NUMBA_NUM_THREADS") or 1) > 0
    except ValueError:
        usable = True  # Numba warns of it, and takes its default
    if not usable:
        raise InputError("NUMBA_NUM_THREADS is no positive number of threads", "set it to one or more, or not at all")


def main() -> None:
    """Run the command; turn what psafit raises on purpose into one line and an exit code."""
    os.environ["MPLBACKEND"] = "agg"  # no window is ever opened
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal may know fewer letters than a title has
            stream.reconfigure(errors="backslashreplace")
    try:
        _check_threads()
        code = commands.main(standalone_mode=False, prog_name="psafit")
        if sys.stdout is not None:  # nobody's, where it was closed
            sys.stdout.flush()  # a full disk is told of here, not at the interpreter's end
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        code = DONE
    except click.ClickException as error:
        where = _path(getattr(error, "ctx", None))
        message = " ".join(error.format_message().split())
        ended = f"{message} See" if message.endswith("?") else f"{message.rstrip('.')}; see"
        _say(f"{where}: {ended} {where} --help")
        code = BAD_INPUT
    except InputError as error:
        _say(f"psafit: {error}")
        code = BAD_INPUT
    except PsafitError as error:
        _say(f"psafit: {error}")
        code = CHECK_FAILED
    except (KeyboardInterrupt, click.Abort):
        typed = "\n" if sys.stderr is not None and sys.stderr.isatty() else ""  # the terminal shows ^C
        click.echo(f"{typed}psafit: interrupted; repeat the same command, which goes on from what is done", err=True)
        code = BAD_INPUT
    except BrokenPipeError:  # at the last flush
        _discard_output()
        code = DONE
    except MemoryError:
        _say("psafit: the memory of this machine does not suffice; close other programs, or give fewer --jobs")
        code = BAD_INPUT
    except Exception as error:
        if blamed := plugins.blamed(error):
            _say(f"psafit: {blamed}")
        elif isinstance(error, OSError):
            _discard_output()
            where = f"{error.filename}: " if error.filename else ""
            _say(f"psafit: {where}{error.strerror or error}; make room, or write elsewhere")
        else:
            raise
        code = BAD_INPUT
    sys.exit(code if isinstance(code, int) else DONE)


def _path(context: click.Context | None) -> str:
    """The command as it is typed: ``psafit challenge make``."""
    names: list[str] = []
    while context is not None and context.parent is not None:
        names.insert(0, str(context.info_name))
        context = context.parent
    return " ".join(["psafit", *names])


def _warn(warnings: Iterable[str]) -> None:
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)


def _say(message: str) -> None:
    """One line on standard error, without what would steer a terminal; of a word that fills screens, its ends."""
    words = (w if len(w) <= _LONGEST_WORD else f"{w[:100]}…{w[-40:]}" for w in escaped(message).split(" "))
    click.echo(" ".join(words), err=True)


def _discard_output() -> None:
    """Let the interpreter end without complaint about output that nobody takes."""
    with suppress(OSError, AttributeError):  # no descriptor where somebody has replaced or closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@click.group(cls=Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(psafit.__version__, prog_name="psafit")
def commands() -> None:
    """Fit contact-impact drives, and find what the simulation gets wrong."""


@commands.command()
@EXPERIMENT
@QUIET
@JSON
def check(experiment: Path, quiet: bool, json_file: Path | None) -> int:
    """Validate an experiment folder and say what is in it."""
    from psafit.experiment import changes_text, describe
    from psafit.inference.scale import read

    content = describe(read(experiment))
    write_result(json_file, content)
    if not quiet:
        click.echo(
            f"{content['title']}: {_count(len(content['groups']), 'group')}, {_count(content['n_points'], 'reading')}"
        )
        for group in content["groups"]:
            spans = (
                _span(group["frequency_hz"], "Hz"),
                _span(group["amplitude_v"], "V"),
                _span(group["launch_range_um"], "um"),
            )
            click.echo(
                f"  group {group['id']}: {group['waveform']}, {_count(group['n_points'], 'reading')}, "
                f"{spans[0]}, {spans[1]}, launch range {spans[2]}{changes_text(group['constants'].items())}"
            )
        for known in content["priors"]:
            click.echo(f"  prior of {known['name']}: {known['prior']} ({known['source']})")
        _warn(content["warnings"])
    return DONE


@commands.command(short_help="Fit, sample, validate on the other groups, and report.")
@EXPERIMENT
@click.option("--group", "group", metavar="ID[,ID...]", help="Group or groups to fit.  [required]")
@click.option("--terms", default="", metavar="ID[,ID...]", help="Causes to add to the baseline.")
@click.option("--out", type=Place("folder"), help="Run folder; fits/<experiment>-group<id> by default.")
@SEED
@click.option("--starts", type=click.IntRange(1, 4096), default=32, show_default=True, help="Starts of the search.")
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
    from psafit.inference.scale import read
    from psafit.progress import watcher

    data = read(experiment)
    if group is None:
        raise InputError("no group to fit", f"name one or more with --group: {listed(map(str, data.ids))}")
    ids = _groups(group, data)
    chosen = causes(terms) if terms else ()
    folder = out or usual_fit_folder(experiment, ids, [t.id for t in chosen])
    if out is None:  # one that was given has been looked at
        ensure_writable(folder, "--out", folder=True, inputs=[experiment])
    refuse_run_file(json_file, folder)
    if not quiet:
        _warn(data.warnings)
    with watcher(quiet) as show:
        from psafit.inference import run as running
        from psafit.numerics import audit

        command = ["psafit", "fit", experiment, "--group", group, "--seed", seed, "--starts", starts]
        command += ["--terms", terms] if terms else []
        command += ["--out", out] if out else []
        command += plugin_words()
        result = running.fit(data, ids, folder, terms=chosen, seed=seed, n_starts=starts, watcher=show, command=command)
        numerics = audit(result)
        if not no_report:
            show.stage("validate")
            from psafit.report.fit import write_report
            from psafit.validate import validate as check_predictions

            validation, predictions = check_predictions(result)
            show.stage("report")
            page = write_report(result, validation, predictions, numerics)
    write_result(json_file, {"fit": result.fit, "posterior": result.summary})
    if not quiet:
        best = result.fit.minima[0]
        minima = "minimum" if len(result.fit.minima) == 1 else "minima"
        ended = f"{_count(best.starts, 'climb')} ended at the best, the others were given up behind it or ended lower"
        if not (best.starts or result.fit.n_missed):
            ended = "a population found the best, all climbs were given up behind it or ended lower"
        click.echo(f"{len(result.fit.minima)} {minima} from {_count(result.fit.n_starts, 'start')}; {ended}")
        if result.fit.n_missed:
            click.echo("the best minimum was found by the sampler, not by the search; the result is of it")
        for p in result.summary.parameters:
            strange = p.implausible and p.verdict != "not determined"
            click.echo(f"  {p.text}" + ("; implausible under its prior" if strange else ""))
        click.echo(f"posterior: {result.summary.message}")
        if not numerics.converged:
            click.echo(_unresolved(numerics.error, numerics.required))
        if not no_report:
            _print_scores(validation)
            click.echo(f"report: {shown_path(page)}")
    return DONE if result.summary.converged and numerics.converged else CHECK_FAILED


def _unresolved(error: float, required: float) -> str:
    return (
        f"the simulation has not converged at these parameters: ranges err by up to {error:.1g} (relative),"
        f" {required:.1g} would do; Numerics on the page says where"
    )


@commands.command(short_help="Say what the simulation gets wrong, and name the cause.")
@EXPERIMENT
@click.option(
    "--group",
    "group",
    metavar="ID[,ID...]",
    help="Training groups of the strict gain (not used by --quick); the first group by default.",
)
@click.option("--quick", is_flag=True, help="The verdict alone: at most four causes, no measured gain.")
@click.option(
    "--nautilus", is_flag=True, help="Compute the finalists' evidence by a nested sampler, too: minutes a model."
)
@click.option(
    "--searches",
    type=click.IntRange(0, 9999),
    metavar="N",
    help="Repeat the whole search on N simulated baselines; 19 by default where a cause is named, 0 with --quick.",
)
@click.option("--out", type=Place("folder"), help="Folder; fits/<experiment>-diagnosis by default.")
@SEED
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Processes that search side by side; one for every core by default. The result is the same.",
)
@click.option("--no-report", is_flag=True, help="Write the result only, no page.")
@PLUGIN
@QUIET
@JSON
def diagnose(
    experiment: Path,
    group: str | None,
    quick: bool,
    searches: int | None,
    nautilus: bool,
    out: Path | None,
    seed: int,
    jobs: int | None,
    no_report: bool,
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Say what the simulation gets wrong, name the cause, and measure what the extended model gains.

    The verdict uses all groups; the gain never scores data that a choice has seen. An interrupted diagnosis goes
    on where it stopped when the same command is repeated.
    """
    from psafit.files import ensure_writable, usual_folder
    from psafit.inference.scale import read
    from psafit.progress import watcher

    data = read(experiment)
    ids = [data.ids[0]] if group is None else _groups(group, data)
    folder = out or usual_folder(experiment, "diagnosis")
    if out is None:
        ensure_writable(folder, "--out", folder=True, inputs=[experiment])
    refuse_run_file(json_file, folder)
    if not quiet:
        _warn(data.warnings)
    command = ["psafit", "diagnose", experiment, *([] if group is None else ["--group", group]), "--seed", seed]
    command += ["--quick"] if quick else []
    command += ["--searches", searches] if searches is not None else []
    command += ["--nautilus"] if nautilus else []
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
            seed=seed,
            jobs=jobs,
            # Without its page a diagnosis was interrupted, however whole its record is.
            draw_on=no_report or (folder / PAGE).exists(),
            watcher=show,
            command=command,
        )
    write_result(json_file, result)
    try:
        if not quiet:
            _tell(result)
    finally:
        # The answer need not wait for its pictures, nor they for somebody who reads it.
        if not no_report:
            from psafit.report.diagnosis import write_diagnosis

            page = write_diagnosis(result, data, folder)
    if not (quiet or no_report):
        click.echo(f"report: {shown_path(page)}")
    return DONE if result.numerics["converged"] else CHECK_FAILED


def _tell(result: Diagnosis) -> None:
    """Print a diagnosis."""
    click.echo(result.headline)
    for sentence in result.sentences:
        click.echo(f"  {sentence}")
    unnamed = result.mostly_unnamed
    if unnamed or result.verdict == "unexplained":
        click.echo("  if a model of the catalogue had to do:")
    for cause in result.causes[:5]:
        words = " + ".join(cause.terms) or "no cause"
        share = cause.evidence["share"] if unnamed else cause.probability
        gain = f"log likelihood {cause.evidence['gain']:+.1f} nats over the baseline's"
        click.echo(f"  {_share(share):>5} %  {words}, {gain}")
        if cause.terms == result.named or cause.terms in result.alternatives[:1]:
            for line in _sizes(cause):
                click.echo(f"           {line}")
    if not unnamed and result.tells_unnamed:
        click.echo(f"  {_share(result.unnamed):>5} %  a discrepancy without a name")
    for place in result.misfit["where"][:5]:
        click.echo(f"  baseline, {place['text']}")
    if not result.numerics["converged"]:
        click.echo(f"  {_unresolved(result.numerics['error'], result.numerics['required'])}")
    for run in result.extension.values():
        if not run["converged"]:
            click.echo(f"  posterior of {' + '.join(run['terms'])}: {run['message']}")


def _share(fraction: float) -> str:
    """A fraction in per cent; never 0 or 100 unless it is."""
    text = f"{100 * fraction:.1f}"
    return "<0.1" if text == "0.0" and fraction > 0 else ">99.9" if text == "100.0" and fraction < 1 else text


def _sizes(cause: CauseResult) -> Iterator[str]:
    """The values of a model's own causes, as the readings tell them."""
    from psafit.inference.identify import describe
    from psafit.physics import owner

    for name, p in cause.parameters.items():
        if owner(name) in cause.terms and p["lower"] is not None:
            size = describe(name, p["unit"], p["median"], (p["lower"], p["upper"]), [], "determined")
            yield size + ("; implausible under its prior" if name in cause.implausible else "")


@commands.command()
@RUN
@PLUGIN
@QUIET
@JSON
def validate(run: Path, quiet: bool, json_file: Path | None) -> int:
    """Check a run's posterior against the groups it never saw."""
    from psafit.inference.run import load
    from psafit.validate import validate as check_predictions

    refuse_run_file(json_file, run)
    validation, _ = check_predictions(load(run))
    write_result(json_file, validation)
    if not quiet:
        _print_scores(validation)
    return DONE


@commands.command(short_help="Recompute the study's published results.")
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
        from psafit.inference.run import versions
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


@commands.command(short_help="List causes and parameters, or tell all about one.")
@click.argument("id", metavar="[ID]", required=False)
@PLUGIN
@QUIET
@JSON
def terms(id: str | None, quiet: bool, json_file: Path | None) -> int:
    """List the baseline's parameters and the causes that can be added to it, or say all that ID declares.

    ID is a cause or a parameter.
    """
    from psafit.inference import noise
    from psafit.physics import TERMS, baseline, owner, term
    from psafit.simulate.catalogue import declaration, entry

    plain = [entry(p) for p in (*baseline.PARAMETERS, *noise.PARAMETERS)]
    if own := [p for p in plain if p.name == id]:
        write_result(json_file, own)
        if not quiet:
            click.echo("\n".join(_parameter(own[0])))
        return DONE
    id = (owner(id) or id) if id else id
    entries = [declaration(t) for t in ([term(id)] if id else TERMS)]
    write_result(json_file, entries)
    if not quiet:
        click.echo(_declaration(entries[0]) if id else _listing(entries, plain))
    return DONE


def _listing(entries: Sequence[CauseEntry], plain: Sequence[CauseParameterEntry]) -> str:
    """The baseline's parameters, and the causes slot by slot, one parameter a line."""
    rows: list[tuple[str, str, str]] = [("baseline", "", "")]
    rows += [("", p.description.partition(" (")[0], f"{p.name} ({p.unit})") for p in plain]
    for slot, members in itertools.groupby(entries, key=lambda e: e.slot):
        rows.append((slot, "", ""))
        for entry in members:
            # A parameter without a neutral value of its own does nothing where the first is neutral.
            told = [
                f"{p.name} ({p.unit})" + ("" if p.neutral is None else f", neutral {p.neutral:g}")
                for p in entry.parameters
            ]
            rows.append((f"  {entry.id}", entry.title + (" (plugin)" if entry.plugin else ""), told[0]))
            rows += [("", "", more) for more in told[1:]]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"{a:{widths[0]}}  {b:{widths[1]}}  {c}".rstrip() for a, b, c in rows]
    return "\n".join([*lines, "", "psafit terms ID says all about one of them, cause or parameter."])


def _declaration(entry: CauseEntry) -> str:
    """A cause's declaration for a terminal 88 columns wide."""
    lines = [f"{entry.id}: {entry.title} ({entry.slot})", ""]
    for block in re.sub(r":math:`([^`]*)`", r"\1", entry.description).replace("``", "`").split("\n\n"):
        # A displayed formula stays LaTeX, which a terminal cannot set; the catalogue's page does.
        formula = block.removeprefix(".. math::")
        shown = (
            textwrap.fill(block, 88, break_on_hyphens=False)
            if formula == block
            else textwrap.indent(textwrap.dedent(formula).strip(), "    ")
        )
        lines += [shown, ""]
    named = [("", p) for p in entry.parameters] + [("each session: ", p) for p in [entry.latent] if p]
    for kind, p in named:
        lines += _parameter(p, kind)
    s = entry.symptom
    sign = {1: "raises the range", -1: "lowers the range", 0: "raises or lowers the range"}[s.sign]
    lines.append(_wrapped("symptom", s.text))
    lines.append(
        _wrapped(
            "",
            f"{sign}; effect with frequency: {s.frequency}, with amplitude: {s.amplitude}; {' and '.join(s.waveforms)}",
        )
    )
    lines.append(_wrapped("reference", entry.reference))
    lines += [_wrapped("check" if i == 0 else "", check) for i, check in enumerate(entry.checks)]
    lines.append(_wrapped("simulated", f"by the {entry.path}"))
    lines += [_wrapped("plugin", f"SHA-256 {entry.plugin}...")] if entry.plugin else []
    return "\n".join(lines)


def _parameter(p: CauseParameterEntry, kind: str = "") -> list[str]:
    neutral = "" if p.neutral is None else f"neutral {p.neutral:g}; "
    return [
        _wrapped("parameter", f"{kind}{p.name} ({p.unit}): {p.description}"),
        _wrapped("", f"{neutral}possible {p.bounds[0]:g} to {p.bounds[1]:g}; prior {p.prior}"),
        _wrapped("", p.source),
    ]


def _wrapped(label: str, text: str) -> str:
    first = f"{label:<11}"
    return textwrap.fill(text, 88, initial_indent=first, subsequent_indent=11 * " ", break_on_hyphens=False)


def _groups(text: str, experiment: Experiment) -> list[GroupId]:
    ids: list[GroupId] = [part.strip() for part in text.split(",")]
    if not all(ids) or len(set(ids)) < len(ids):
        raise InputError(f"--group {text!r} is not a list of different group ids", "write for example --group 1,2")
    experiment.select(ids)
    return ids


def causes(text: str) -> tuple[Term, ...]:
    """The causes that ``--terms`` names."""
    from psafit.physics import terms as catalogue

    ids = [part.strip() for part in text.split(",")]
    if not all(ids):
        raise InputError(f"--terms {text!r} is not a list of causes", "write for example --terms amplifier_lag,gap")
    return catalogue(ids)


def plugin_words() -> list[object]:
    """The options that name the plugins at work, however they were named."""
    return [word for file in plugins.files() for word in ("--plugin", file)]


def _span(span: list[float], unit: str) -> str:
    return f"{span[0]:g} {unit}" if span[0] == span[1] else f"{span[0]:g}-{span[1]:g} {unit}"


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _print_scores(validation: Any) -> None:
    for s in validation.groups:
        click.echo(f"group {s.group} ({s.role}): log_rmse {s.log_rmse:.3f}; {s.verdict}")
    if validation.holdout_log_rmse is not None:
        click.echo(f"mean log_rmse over held-out groups: {validation.holdout_log_rmse:.3f}")


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


def write_result(json_file: Path | None, record: Any) -> None:
    """Write what ``--json`` asks for."""
    if json_file is not None:
        from psafit.records import write_json

        write_json(json_file, record)


def _attach() -> None:
    """Hang on the commands that are built from what stands above."""
    from psafit.cli_challenge import challenge
    from psafit.cli_explore import report, simulate, watch
    from psafit.cli_rig import check_cause, new, plan

    for command in (simulate, report, watch, challenge, check_cause, new, plan):
        commands.add_command(command)


_attach()

"""`psafit import`: what instruments and spreadsheets write, as an experiment folder."""

from __future__ import annotations

import itertools
import math
import re
import shlex
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from psafit.cli.common import DONE, JSON, QUIET, Command, Place, escaped, shown_path, warn, write_result
from psafit.drives import NAMES, from_zero
from psafit.errors import InputError
from psafit.text import count, series

if TYPE_CHECKING:
    from psafit.experiment import GroupId
    from psafit.experiment.importing import Imported, Mapping, Table
    from psafit.experiment.importing.quantities import Volts
    from psafit.experiment.importing.records import Held

_VOLTS = ("peak", "pp", "rms")
_WAVEFORM = (
    f"Of all tables, or one for each: {', '.join(NAMES)}; or what the words of a column mean: sine=unipolar_sine."
)
_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "blank": " ", "blanks": "  "}


@click.command("import", cls=Command, short_help="Make an experiment folder of what instruments write.")
@click.argument("files", metavar="FILE...", type=Place("input"), nargs=-1, required=True)
@click.option("--out", type=Place("folder"), required=True, help="Receives the folder; must be new, or empty.")
@click.option("--waveform", metavar="NAME[,NAME...]", help=_WAVEFORM)
@click.option(
    "--column",
    "columns",
    multiple=True,
    metavar="HEADING=COLUMN[:UNIT][,...]",
    help="What a column holds: 'Freq=frequency_hz:kHz', 'Note=ignore', 'CH1=voltage_v:20V/V'; or one for each table;"
    " repeat.",
)
@click.option(
    "--set",
    "values",
    multiple=True,
    metavar="NAME=VALUE[:UNIT]",
    help="A constant of the rig, or what was held: M=27:g, amplitude_v=40:Vpp, bias_v=10, cycles=5; repeat.",
)
@click.option(
    "--session",
    metavar="NAME[,NAME...]",
    help="Session of all tables, or of each: mon,mon,tue; blank: one for each of its groups.",
)
@click.option("--rig", type=Place("input"), metavar="EXP", help="Take constants, limits and priors of this experiment.")
@click.option("--volts", type=click.Choice(_VOLTS), help="How volts are counted where no heading says so.")
@click.option("--decimal", type=click.Choice([".", ","]), help="Decimal mark; detected by default.")
@click.option("--separator", type=click.Choice(list(_SEPARATORS)), help="Between cells; detected by default.")
@click.option("--encoding", metavar="NAME", help="Of text, such as cp850; detected by default.")
@click.option("--step", metavar="TIME[:UNIT]", help="Of samples without times, 1:us; or their rate, 1:MHz.")
@click.option(
    "--start", metavar="TIME:UNIT", help="When the drive starts, on the clock of a trace or of --drive: 1.5:ms."
)
@click.option("--from-rest", is_flag=True, help="Count a trace from the mean of its samples before the start.")
@click.option(
    "--every",
    metavar="N",
    type=click.IntRange(1),
    default=1,
    help="Keep one sample of a trace in N, and of a drive means of N.",
)
@click.option(
    "--drive",
    "drives",
    type=Place("input"),
    metavar="FILE",
    multiple=True,
    help="The drive: a recorded voltage, or one period by phase. Repeat, or give a folder: each group has its own.",
)
@click.option("--period", metavar="TIME[:UNIT]", help="Of that voltage: 1:ms; without it the drive is as recorded.")
@click.option("--sheet", "sheets", multiple=True, metavar="NAME", help="Sheet of a workbook, a group each; repeat.")
@QUIET
@JSON
def import_files(
    files: tuple[Path, ...],
    out: Path,
    waveform: str | None,
    columns: tuple[str, ...],
    values: tuple[str, ...],
    session: str | None,
    rig: Path | None,
    volts: Any,
    decimal: str | None,
    separator: str | None,
    encoding: str | None,
    step: str | None,
    start: str | None,
    from_rest: bool,
    every: int,
    drives: tuple[Path, ...],
    period: str | None,
    sheets: tuple[str, ...],
    quiet: bool,
    json_file: Path | None,
) -> int:
    """Make an experiment folder of what instruments and spreadsheets write.

    FILE is text with any separator, or a workbook (.xlsx, .xls, .ods). Each is a group; columns are recognised by
    name and unit. Time and displacement or velocity are a trace. Its conditions stand in columns or headings, or --set
    gives them; a voltage recorded with it is its drive. What was understood is printed. What may be understood in two
    ways is asked for.
    """
    from psafit.experiment import read_experiment
    from psafit.experiment.importing import Options, given, read_files, write_import
    from psafit.experiment.text import shown
    from psafit.files import filling

    if len({file.resolve() for file in files}) < len(files):
        raise InputError("a file is named twice", "name each once: its readings would count twice")
    constants, held, counted = _values(values)
    shapes = [] if waveform is None else [part.strip() for part in waveform.split(",")]
    options = Options(
        columns=tuple(itertools.chain.from_iterable(map(_mappings, columns))),
        values=held,
        counted=counted,
        waveforms=tuple(part for part in shapes if "=" not in part),
        sessions=() if session is None else tuple(map(_session, session.split(","))),
        meant=tuple((said.strip(), name.strip()) for said, _, name in (p.partition("=") for p in shapes if "=" in p)),
        volts=volts,
        decimal=decimal,
        separator=_SEPARATORS[separator] if separator else None,
        encoding=encoding,
        sheets=sheets,
        step_us=None if step is None else given.step(step, f"--step {shown(step)}"),
        start_us=None if start is None else given.moment(start, f"--start {shown(start)}"),
        from_rest=from_rest,
        every=every,
        period_us=None if period is None else given.moment(period, f"--period {shown(period)}"),
    )
    imported = _on_rig(read_files(files, options, drives=drives), constants, rig)
    with filling(out):
        write_import(imported, out)
        warnings = imported.warnings if imported.missing else read_experiment(out).warnings
        write_result(json_file, _result(imported, out, warnings))
    if not quiet:
        for line in itertools.chain.from_iterable(map(_table_text, imported.tables)):
            click.echo(escaped(line))
        warn(warnings)
        _next(imported, out)
    return DONE


def _on_rig(tables: Sequence[Table], constants: dict[str, float], rig: Path | None) -> Imported:
    """Tables, with what is known of the rig."""
    from psafit.experiment import read_plan
    from psafit.experiment.importing import Imported

    if rig is None:
        return Imported(tuple(tables), constants)
    plan = read_plan(rig)
    known = {f.name: getattr(plan.constants, f.name) for f in fields(plan.constants)}
    return Imported(tuple(tables), known | constants, plan.limits, plan.beliefs, plan.rig, plan.readable)


def _session(text: str) -> GroupId | None:
    """The session that ``--session`` gives a table, None where that is blank."""
    from psafit.experiment.importing.values import session_of
    from psafit.experiment.text import shown

    if not (name := text.strip()):
        return None
    if (session := session_of(name)) is None:
        raise InputError(f"--session: {shown(name)} is no name of a session", "write letters or digits: mon,mon,tue")
    return session


def _mappings(text: str) -> list[Mapping]:
    """What a ``--column`` says, of several tables perhaps of each."""
    heading, _, rest = text.rpartition("=")
    parts = [part.strip() for part in rest.split(",")]
    if not heading.strip() or len(parts) == 1 or not any(parts):
        return [_mapping(text)]
    said = ((k, _mapping(f"{heading}={part}")) for k, part in enumerate(parts) if part)
    return [replace(mapping, table=(k, len(parts))) for k, mapping in said]


def _mapping(text: str) -> Mapping:
    """What a ``--column`` says of all tables."""
    from psafit.experiment.importing import COLUMN_NAMES, Mapping
    from psafit.experiment.importing.chosen import SIGNALS
    from psafit.experiment.importing.quantities import COLUMNS
    from psafit.experiment.importing.units import scaled
    from psafit.experiment.importing.units import unit as parsed
    from psafit.experiment.text import did_you_mean, shown

    heading, equals, rest = text.rpartition("=")
    column, colon, unit = (part.strip() for part in rest.partition(":"))
    if not equals or not heading.strip():
        raise InputError(
            f"--column {shown(text)} is not HEADING=COLUMN:UNIT", "write for example --column 'Freq=frequency_hz:kHz'"
        )
    if column not in COLUMN_NAMES:
        near = did_you_mean(column, COLUMN_NAMES, columns=True)
        raise InputError(f"--column {shown(text)}: {shown(column)} is no column", near)
    signal = column in COLUMNS and COLUMNS[column].role in (*SIGNALS, "recording", "time")
    said = parsed(unit) or (scaled(unit) if signal else None) if colon else None
    if colon and said is None:
        usual = "um, or what a volt is, 5mm/s/V, 2um/V or 20V/V" if signal else "kHz, mV, Vpp or um"
        raise InputError(f"--column {shown(text)}: {shown(unit)} is no unit", f"write for example {usual}")
    return Mapping(heading.strip(), column, said)


def _values(
    given: Sequence[str],
) -> tuple[dict[str, float], tuple[tuple[str, Held], ...], tuple[Volts, ...]]:
    """Constants and conditions that ``--set`` gives, in SI and psafit's units; of several tables a condition each.

    How volts of the amplitude are counted comes last.
    """
    from psafit.experiment import CONSTANT_UNITS
    from psafit.experiment.importing import SETTABLE
    from psafit.experiment.importing.given import counted, value
    from psafit.experiment.text import did_you_mean, listed, shown

    constants: dict[str, float] = {}
    held: dict[str, Held] = {}
    volts: tuple[Volts, ...] = ()
    known = (*CONSTANT_UNITS, *SETTABLE)
    for text in given:
        name, _, number = (part.strip() for part in text.partition("="))
        if name not in known:
            near = did_you_mean(name, known) if name else f"choose from {listed(known)}"
            if counts := re.fullmatch(r"(amplitude_v)_?(pp|rms|p)", name):
                near = f"say for example {counts[1]}=40:V{counts[2]}"
            raise InputError(f"--set {shown(text)}: there is no {shown(name)}", near)
        if name in constants | held:
            raise InputError(f"--set gives {name} twice", "give each once")
        place = f"--set {shown(text)}"
        if name in CONSTANT_UNITS:
            constants[name] = value(name, number, place)
        else:
            parts = [part.strip() for part in number.split(",")]
            some = any(parts)  # a table that has none is left blank
            held[name] = tuple(value(name, part, place) if part or not some else None for part in parts)
            volts = tuple(map(counted, number.split(","))) if name == "amplitude_v" else volts
    return constants, tuple(held.items()), volts


def _table_text(table: Table) -> list[str]:
    """What was understood of a table, behind that of its drives' recordings; one that is read like another is named."""
    lines: list[str] = []
    first: dict[tuple[Any, ...], Table] = {}
    for one in table.recordings:
        like = first.setdefault((one.columns, one.separator, one.decimal, one.above, one.not_yet), one)
        lines += [f"{one.place}: read like {like.place}"] if like is not one else _columns_text(one)
    return [*lines, *_columns_text(table)]


def _columns_text(table: Table) -> list[str]:
    """What was understood of a table, as lines."""
    from psafit.experiment.importing.chosen import SETTINGS
    from psafit.experiment.importing.folder import less
    from psafit.experiment.importing.quantities import COLUMNS, SEPARATORS, VOLTS
    from psafit.experiment.importing.recorded import reach

    form = [f"headings in line {table.header_line}"] if table.header_line else ["no headings"]
    if not table.sheet:
        marks = {".": "decimal point", ",": "decimal comma"}
        separated = f"separated by {SEPARATORS[table.separator]}" if table.separator else "one column"
        form = [table.encoding.replace("_", "-"), separated, marks[table.decimal], *form]
    lines = [f"{table.place}: {', '.join(form)}"]
    width = 1 + max(len(column.column) for column in table.columns)
    for column in table.columns:
        if not column.headings:
            lines.append(f"  {column.column:<{width}} given")
            continue
        volts = f", {VOLTS[column.volts]}" if column.volts else ""
        headings = ", ".join(map(repr, column.headings))
        lines.append(
            f"  {column.column:<{width}} from {headings}, {column.unit or 'unit in each cell'}{volts}{less(column)}"
        )
    lines += [f"  not used: {', '.join(map(repr, table.unused))}"] if table.unused else []
    for heading, labels in table.labelled:
        grouped = shlex.quote(f"{heading}=group")
        lines.append(
            f"  {heading!r} has {labels} labels; --column {grouped} makes a group of each (with another --out)"
        )
    for heading, known in table.errors:
        said = shlex.quote(f"{heading}={known}")
        lines.append(f"  {heading!r} may hold the known error of each reading; if so, say --column {said}")
    for heading, reading in table.possible:
        said = shlex.quote(f"{heading}={reading}")
        lines.append(f"  {heading!r} may be {reading}; if so, say --column {said} (with another --out)")
    lines += [f"  not used: {heading!r} is {column}, which psafit cannot use yet" for heading, column in table.not_yet]
    lines += [f"  line {line} is not read: {text[:80]!r}; if it counts, {remedy}" for line, text, remedy in table.above]
    lines += [f"  line {line} left out: {text[:80]}" for line, text in table.left_out[:3]]
    if len(table.left_out) > 3:
        lines.append(f"  and {len(table.left_out) - 3} more lines left out")
    for example in table.examples:
        readings = "; ".join(
            ", ".join(
                f"{column.partition('_')[0] if column in SETTINGS else ''} {value:.10g} {COLUMNS[column].unit}".strip()
                for column, value in reading
            )
            for reading in example.readings
        )
        lines.append(f"  line {example.line}: {' | '.join(example.cells)[:80]}  ->  {readings}")
    for g, label in table.renamed_groups:
        read = count(g.n_points, "reading")
        if g.time_us is not None:
            read = f"{count(g.n_points, 'sample')} of the {g.observable.title}"
        low, high = g.volts
        drive = f"drive of {reach(g.drive.table)}" if g.drive.table else g.waveform
        swing = "" if g.drive.table else f", {low:.4g} to {high:.4g} V"
        bias = f" on {g.drive.bias_v:.4g} V" if g.drive.bias_v else ""
        at_rest = f" from {g.drive.idle_v:.4g} V" if g.drive.idle_v else ""
        phase = f" at {g.drive.phase_deg:g} degrees" if g.drive.phase_deg else ""
        lasts = f" for {g.drive.cycles:g} periods" if g.drive.cycles < math.inf else ""
        named = f" ({label!r})" if label else ""
        lines.append(f"  group {g.id}{named}: {drive}{bias}{at_rest}{phase}{lasts}{swing}, {read}, {g.file}")
    other = {g.waveform: raised for g in table.groups if not g.drive.bias_v and (raised := from_zero(g.waveform))}
    if other and any(column.volts == "pp" for column in table.columns):
        shape, raised = next(iter(other.items()))
        lines.append(
            f"  peak to peak is taken about 0 V; a drive that goes from 0 V is {' or '.join(other.values())}: say"
            f" --waveform {raised}, or {shape}={raised} of a column of waveforms"
        )
    return lines


def _next(imported: Imported, out: Path) -> None:
    """What to do with the folder."""
    from psafit.experiment import DEFINITION

    place, groups = shlex.quote(shown_path(out)), [g for t in imported.tables for g in t.groups]
    click.echo(f"wrote {shown_path(out / DEFINITION)} and {count(len(groups), 'group')}")
    if left := dict.fromkeys(heading for t in imported.tables for heading, _ in t.possible):
        click.echo(f"without {series(map(repr, left))}, which may be readings, too: see above")
    if varied := [g.id for g in groups if len({*g.frequency_hz}) > 1 and len({*g.amplitude_v}) > 1]:
        named = f"group{'' if len(varied) == 1 else 's'} {series(varied)}"
        which = "one group" if len(groups) == 1 else named
        click.echo(
            f"{which}, in which frequency and amplitude vary: if these are several sweeps, or of several sessions, give"
            " each its own file, or a label in a column that --column LABEL=group names; a fit to one group is judged"
            " by the others"
        )
    if len(groups) > 1 and not any(g.session for g in groups):
        click.echo(
            "each group counts as a session of its own, as if the rig had been set up anew for it; below groups of one"
            f' session write session = "NAME" in {shown_path(out / DEFINITION)}, or say --session mon,mon,tue,'
            " a name for each table, or --column LABEL=session"
        )
    then = f"psafit check {place}"
    if imported.missing:
        file = shown_path(out / DEFINITION)
        click.echo(f"not in the files: {', '.join(imported.missing)}; write what is missing into {file}, then: {then}")
    else:
        click.echo(f"go on with: {then}; psafit diagnose {place} --quick")


def _result(imported: Imported, out: Path, warnings: Sequence[str]) -> dict[str, Any]:
    """What ``--json`` holds."""
    return {
        "folder": str(out),
        "constants": dict(imported.constants),
        "missing_constants": list(imported.missing),
        "warnings": list(warnings),
        "tables": [_table_result(table) for table in imported.tables],
        "recordings": [_table_result(file) for table in imported.tables for file in table.recordings],
    }


def _table_result(table: Table) -> dict[str, Any]:
    columns = [
        {
            "column": c.column,
            "headings": list(c.headings),
            "unit": c.unit,
            "factor": c.factor,
            "volts": c.volts,
            "zero": c.zero,
        }
        for c in table.columns
    ]
    return {
        "file": str(table.file),
        "sheet": table.sheet,
        "encoding": table.encoding,
        "separator": table.separator,
        "decimal": table.decimal,
        "header_line": table.header_line,
        "columns": columns,
        "not_used": list(table.unused),
        "labelled": [{"heading": heading, "labels": labels} for heading, labels in table.labelled],
        "errors": [{"heading": heading, "column": column} for heading, column in table.errors],
        "not_yet": [{"heading": heading, "column": column} for heading, column in table.not_yet],
        "left_out": [{"line": line, "text": text} for line, text in table.left_out],
        "groups": [
            {
                "id": g.id,
                "label": label,
                "waveform": g.waveform,
                "file": g.file,
                "n_points": g.n_points,
                "drive": g.drive.file,
            }
            for g, label in table.labelled_groups
        ],
    }


__all__ = ["import_files"]

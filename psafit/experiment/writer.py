"""Write an experiment folder that `read_experiment` reads back to the same numbers.

What the experiment's own folder still holds unchanged is copied byte for byte: whoever wrote it knows it by its file
names, its comments and the way its numbers are written.
"""

from __future__ import annotations

import codecs
import math
import os
import tomllib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path, PurePosixPath

import numpy as np

from psafit.errors import InputError
from psafit.experiment.definition import Definition
from psafit.experiment.drive_table import PERIOD, RECORDED
from psafit.experiment.records import (
    CONDITION_COLUMNS,
    DEFINITION,
    READING_COLUMNS,
    SIGMA_COLUMNS,
    Conditions,
    Constants,
    Experiment,
    Group,
)
from psafit.experiment.rig import Rig
from psafit.experiment.table import read_csv, readings_of
from psafit.experiment.text import id_text, quoted
from psafit.experiment.trace_table import TIME, read_trace
from psafit.files import write_atomically
from psafit.observables import LAUNCH_RANGE
from psafit.parameters import Belief


def write_experiment(experiment: Experiment, folder: Path, planned: Sequence[Conditions] = ()) -> None:
    """Write `experiment.toml` and one CSV file a group; the definition comes last, so a half-written folder has none.

    Parameters
    ----------
    experiment : Experiment
    folder : Path
        Made if needed.
    planned : sequence of Conditions, optional
        Sweeps yet to be measured, behind the groups, each in its own file, which has no readings.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    groups = [*experiment.groups, *planned]
    names = _names(groups)
    written = [group_text(group, name) for group, name in zip(groups, names, strict=True)]
    head = _kept_definition(experiment) if names == [g.file for g in groups] else None
    if head is None:
        head = _definition(experiment)
    else:
        written = written[len(experiment.groups) :]
    for group, name in zip(groups, names, strict=True):
        content = _kept_table(experiment.folder / group.file, group) if isinstance(group, Group) else None
        write_atomically(folder / name, table_text(group).encode() if content is None else content)
    for name, text in drive_files(groups).items():
        write_atomically(folder / name, text.encode())
    write_atomically(folder / DEFINITION, "".join([head, *written]).encode())


def _names(groups: Sequence[Conditions]) -> list[str]:
    """Where each group's file goes: the names it has, if they can stand side by side in a folder."""
    names = [os.path.normpath(g.file).replace(os.sep, "/") if g.file else "" for g in groups]
    usable = (
        not PurePosixPath(n).is_absolute() and n.partition("/")[0] not in ("", ".", "..", DEFINITION) for n in names
    )
    if all(usable) and len({n.casefold() for n in names}) == len(names):
        return names
    return [f"group{number}.csv" for number in range(1, len(groups) + 1)]


def drive_files(groups: Sequence[Conditions]) -> dict[str, str]:
    """The CSV files of drives that are tables, by name."""
    found = {}
    for drive in (g.drive for g in groups if g.drive.table):
        table = drive.table
        assert table is not None
        names, place = (RECORDED, _microseconds) if table.recorded else (PERIOD, number_text)
        rows = zip(table.at.tolist(), table.value.tolist(), strict=True)
        lines = [",".join(names), *(f"{place(at)},{number_text(value)}" for at, value in rows)]
        found[drive.file] = "\n".join(lines) + "\n"
    return found


def _kept_table(file: Path, group: Group) -> bytes | None:
    """A group's file as somebody wrote it; None where there is none that holds these numbers."""
    try:
        raw = file.read_bytes()
        traced = group.time_us is not None
        condition = group.frequency_hz[0], group.amplitude_v[0]
        held = read_trace(file, *condition) if traced else readings_of(read_csv(file))
    except (InputError, OSError, ValueError):
        return None
    mine = {n: values for n in (*held, "sigma") if (values := getattr(group, n)) is not None}
    same = mine.keys() == held.keys() and all(np.array_equal(mine[n], held[n]) for n in mine)
    return raw if same else None


def _kept_definition(experiment: Experiment) -> str | None:
    """The definition as somebody wrote it, ready for more groups; None where there is none that says the same."""
    try:
        found = Definition(experiment.folder)
        text = found.file.read_bytes().removeprefix(codecs.BOM_UTF8).decode("utf-8")
        declared = [(g.id, g.session, g.drive, g.file, g.changed, g.traced) for g in found.groups(found.faults)]
        found.faults.end()
        same = (
            tomllib.loads(text) == found.data
            and found.constants() == experiment.constants
            and found.limits() == experiment.limits
            and found.readable() == experiment.readable
            and found.known(found.beliefs(), found.rig(), experiment.constants) == experiment.beliefs
            and found.rig() == experiment.rig
            and found.instruments() == experiment.instruments
            and found.text("title", experiment.title) == experiment.title
            and found.text("source", "") == experiment.source
            and declared == [(g.id, g.session, g.drive, g.file, g.changed, _condition(g)) for g in experiment.groups]
        )
        # Without a title it would be called after the new folder.
        text = text if "title" in found.data else f"title = {quoted(experiment.title)}\n{text}"
        tomllib.loads(f"{text}\n[[group]]\n")  # groups in an array of another form take no more behind them
    except (InputError, OSError, ValueError):
        return None
    return (text if text.endswith("\n") else text + "\n") if same else None


def _definition(experiment: Experiment) -> str:
    """The definition without its groups."""
    constants = [f"{f.name} = {number_text(getattr(experiment.constants, f.name))}\n" for f in fields(Constants)]
    head = head_text(experiment.title, experiment.source)
    return "".join(
        [
            head,
            "\n[constants]\n",
            *constants,
            rig_text(experiment.rig),
            instruments_text(experiment.instruments),
            limits_text(experiment.limits, experiment.readable),
            beliefs_text(experiment.beliefs),
        ]
    )


def head_text(title: str, source: str) -> str:
    """The first lines of a definition."""
    return f"title = {quoted(title)}\nsource = {quoted(source)}\n"


def limits_text(limits: Sequence[tuple[str, tuple[float, float]]], readable: Sequence[str]) -> str:
    """The table of limits, and of what may be read; empty where there are none."""
    lines = [f"{name} = [{number_text(low)}, {number_text(high)}]\n" for name, (low, high) in limits]
    lines += [f"read = [{', '.join(map(quoted, readable))}]\n"] if readable else []
    return "".join(["\n[limits]\n", *lines]) if lines else ""


def rig_text(rig: Rig | None) -> str:
    """The table of what a rig is made of; empty where nothing is known."""
    if rig is None:
        return ""
    facts = (f"{k} = {quoted(v) if isinstance(v, str) else number_text(v)}\n" for k, v in rig.given.items())
    return "".join(["\n[rig]\n", *facts])


def instruments_text(instruments: Sequence[tuple[str, str]]) -> str:
    """The table of columns with an instrument of their own; empty where there are none."""
    lines = [f"{column} = {quoted(name)}\n" for column, name in instruments]
    return "".join(["\n[instruments]\n", *lines]) if lines else ""


def beliefs_text(beliefs: Sequence[Belief]) -> str:
    """The tables of what is stated of parameters; what follows from the rig is not written."""
    text = ""
    for belief in beliefs:
        if belief.derived:
            continue
        names = [f.name for f in fields(belief.prior) if f.init] if belief.prior else []
        numbers = (f"{name} = {number_text(getattr(belief.prior, name))}\n" for name in names)
        text += f"\n[prior.{quoted(belief.name)}]\n{''.join(numbers)}source = {quoted(belief.source)}\n"
        text += f"probability = {number_text(belief.probability)}\n" if belief.probability else ""
    return text


def group_text(group: Conditions, file: str) -> str:
    """A group's part of the definition."""
    condition = _condition(group)
    key = "trace" if condition else "file"
    lines = [
        "", "[[group]]", f"id = {id_text(group.id)}",
        f"waveform = {quoted(group.waveform)}", f"{key} = {quoted(file)}",
    ]  # fmt: skip
    if condition:
        names = zip(CONDITION_COLUMNS, condition, strict=True)
        lines += [f"{name} = {number_text(value)}" for name, value in names]
    settings = group.drive.settings
    if group.drive.recorded or "bias_v" in settings:
        settings.setdefault("idle_v", group.drive.idle_v)  # left out, it is asked for
    for key, value in settings.items():
        lines.append(f"{key} = {quoted(value) if isinstance(value, str) else number_text(value)}")
    if group.session is not None:
        lines.append(f"session = {id_text(group.session)}")
    if group.changed:
        changed = ", ".join(f"{name} = {number_text(value)}" for name, value in group.changed)
        lines.append(f"constants = {{ {changed} }}")
    return "\n".join(lines) + "\n"


def _condition(group: Conditions) -> tuple[float, float] | None:
    """Frequency (Hz) and amplitude (V) of a trace; None where launches as a whole are read."""
    if group.time_us is None:
        return None
    return float(group.frequency_hz[0]), float(group.amplitude_v[0])


def number_text(value: float) -> str:
    """A number as people write it: whole ones without a point."""
    return repr(float(value)).removesuffix(".0")


def _microseconds(seconds: float) -> str:
    """A time as the shortest number of microseconds that is read as the same."""
    texts = (f"{seconds / 1e-6:.{digits}g}" for digits in range(6, 18))
    return number_text(next((float(text) for text in texts if float(text) * 1e-6 == seconds), seconds / 1e-6))


def table_text(group: Conditions) -> str:
    """The CSV file of a group: a row a launch, a cell left empty where an observable was not read; or of a trace."""
    if group.time_us is not None:
        read = group.reading if isinstance(group, Group) else np.full(group.n_points, np.nan)
        pairs = zip(group.time_us.tolist(), read.tolist(), strict=True)
        text = (f"{number_text(t)},{'' if math.isnan(y) else number_text(y)}" for t, y in pairs)
        return "\n".join([f"{TIME},{group.observable.column}", *text]) + "\n"
    rows: dict[int, dict[str, str]] = {}
    for part in group.parts:
        held = {"frequency_hz": part.frequency_hz, "amplitude_v": part.amplitude_v}
        if isinstance(part, Group):
            held[part.observable.column] = part.reading
        elif group.observables != (LAUNCH_RANGE,):  # an empty column says what is to be read
            held[part.observable.column] = np.full(part.n_points, np.nan)
        if part.sigma is not None and part.sigma.any():
            held[part.observable.sigma_column] = part.sigma
        for i, row in enumerate(part.row.tolist()):
            rows.setdefault(row, {}).update(
                {name: "" if np.isnan(column[i]) else number_text(column[i]) for name, column in held.items()}
            )
    every = (*CONDITION_COLUMNS, *READING_COLUMNS, *SIGMA_COLUMNS)
    names = [name for name in every if any(name in row for row in rows.values())]
    lines = (",".join(rows[row].get(name, "") for name in names) for row in sorted(rows))
    return "\n".join([",".join(names), *lines]) + "\n"

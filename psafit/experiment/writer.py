"""Write an experiment folder that `read_experiment` reads back to the same numbers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

from psafit.experiment.records import (
    DEFINITION,
    OPTIONAL_COLUMNS,
    REQUIRED_COLUMNS,
    Conditions,
    Experiment,
)
from psafit.files import write_atomically


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
    lines = [f"title = {_quoted(experiment.title)}", f"source = {_quoted(experiment.source)}", "", "[constants]"]
    lines += [f"{f.name} = {getattr(experiment.constants, f.name)!r}" for f in fields(experiment.constants)]
    if experiment.limits:
        lines += ["", "[limits]", *(f"{name} = [{low!r}, {high!r}]" for name, (low, high) in experiment.limits)]
    for belief in experiment.beliefs:
        numbers = [f"{f.name} = {getattr(belief.prior, f.name)!r}" for f in fields(belief.prior) if f.init]
        lines += ["", f"[prior.{_quoted(belief.name)}]", *numbers, f"source = {_quoted(belief.source)}"]
    for number, group in enumerate([*experiment.groups, *planned], 1):
        name = group.file if group in planned else f"group{number}.csv"
        write_atomically(folder / name, _table(group).encode())
        group_id = group.id if isinstance(group.id, int) else _quoted(group.id)
        lines += [
            "", "[[group]]", f"id = {group_id}", f"waveform = {_quoted(group.waveform)}", f"file = {_quoted(name)}",
        ]  # fmt: skip
        if group.changed:
            lines.append(f"constants = {{ {', '.join(f'{name} = {value!r}' for name, value in group.changed)} }}")
    write_atomically(folder / DEFINITION, ("\n".join(lines) + "\n").encode())


def _quoted(text: str) -> str:
    # A JSON string is a TOML basic string, but for the DEL character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _table(group: Conditions) -> str:
    names = [n for n in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS) if getattr(group, n, None) is not None]
    columns = [getattr(group, n).tolist() for n in names]
    rows = (",".join(repr(x) for x in row) for row in zip(*columns, strict=True))
    return "\n".join([",".join(names), *rows]) + "\n"

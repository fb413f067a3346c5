"""An experiment folder of what was imported."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib.resources import files
from pathlib import Path

from psafit.experiment.importing.quantities import COLUMNS, VOLTS
from psafit.experiment.importing.records import Table, Understood
from psafit.experiment.plausible import (
    disagreeing_groups,
    rescaled_groups,
    suspicious_readings,
    traced_together,
)
from psafit.experiment.records import DEFINITION, Constants
from psafit.experiment.rig import Rig
from psafit.experiment.text import one_line
from psafit.experiment.writer import (
    beliefs_text,
    drive_files,
    group_text,
    head_text,
    limits_text,
    number_text,
    rig_text,
    table_text,
)
from psafit.files import write_atomically
from psafit.parameters import Belief


@dataclass(frozen=True)
class Imported:
    """What a folder is to hold.

    Parameters
    ----------
    tables : tuple of Table
    constants : mapping of str to float
        Those of the rig that are known, SI. The others are left to be filled in.
    limits : tuple of (str, (float, float))
    beliefs : tuple of Belief
    rig : Rig, optional
        What it is made of.
    readable : tuple of str
        Columns that a next experiment may read besides what was read.
    """

    tables: tuple[Table, ...]
    constants: Mapping[str, float]
    limits: tuple[tuple[str, tuple[float, float]], ...] = ()
    beliefs: tuple[Belief, ...] = ()
    rig: Rig | None = None
    readable: tuple[str, ...] = ()

    @property
    def missing(self) -> tuple[str, ...]:
        """Constants that nobody gave."""
        return tuple(f.name for f in fields(Constants) if f.name not in self.constants)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What looks like another unit, as far as that can be known without the rig."""
        groups = [group for table in self.tables for group in table.groups]
        units = (line for group in groups for line in suspicious_readings(group, None))
        return (*units, *disagreeing_groups(groups), *rescaled_groups(groups), *traced_together(groups))


def write_import(imported: Imported, folder: Path) -> None:
    """Write an experiment folder; a constant that is missing is a comment that says what to fill in.

    Parameters
    ----------
    imported : Imported
    folder : Path
        Exists.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    source = "; ".join(dict.fromkeys(one_line(table.place) for table in imported.tables))
    parts = [head_text(one_line(folder.resolve().name) or "imported", source), "\n[constants]\n"]
    described = _descriptions()
    for f in fields(Constants):
        value = imported.constants.get(f.name)
        comment = described[f.name]
        parts.append(
            f"# {f.name} =   # {comment}\n" if value is None else f"{f.name} = {number_text(value)} # {comment}\n"
        )
    parts += [
        rig_text(imported.rig) or _optional("rig"),
        limits_text(imported.limits, imported.readable) or _optional("limits"),
        _optional("instruments"),
    ]
    parts.append(beliefs_text(imported.beliefs))
    for table in imported.tables:
        parts.append(f"\n# {one_line(table.place)}: {one_line('; '.join(map(_column_text, table.columns)))}\n")
        for group, label in table.renamed_groups:
            text = group_text(group, group.file).lstrip("\n")
            parts.append(text.replace("\n", f" # {one_line(label)}\n", 1) if label else text)
            write_atomically(folder / group.file, table_text(group).encode())
    for name, text in drive_files([group for table in imported.tables for group in table.groups]).items():
        write_atomically(folder / name, text.encode())
    write_atomically(folder / DEFINITION, "".join(parts).encode())


def _column_text(column: Understood) -> str:
    if not column.headings:
        return f"{column.column} was given"
    volts = f" {VOLTS[column.volts]}" if column.volts else ""
    unit = column.unit or "the unit of each cell"
    return f"{column.column} from {', '.join(column.headings)} in {unit}{volts}{less(column)}"


def less(column: Understood) -> str:
    """``, less 0.3 um``, as a message appends it where a zero was subtracted; else nothing."""
    return f", less {column.zero:.10g} {COLUMNS[column.column].unit}" if column.zero else ""


def _descriptions() -> dict[str, str]:
    """What the example of `psafit new` says of each constant."""
    return dict(re.findall(r"^(\w+) = \S+\s+# (.*)$", _example().partition("[constants]")[2], flags=re.MULTILINE))


def _optional(table: str) -> str:
    """The lines of comments with which that example proposes a table."""
    return next(f"\n{part}\n" for part in _example().split("\n\n") if f"\n# [{table}]\n" in part)


def _example() -> str:
    return files("psafit").joinpath("templates", DEFINITION).read_text("utf-8")

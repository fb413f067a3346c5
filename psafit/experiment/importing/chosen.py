"""The columns of a file that are used, and what each is."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import dataclass

from psafit.errors import InputError
from psafit.experiment.drive_table import RECORDED, SETTING_LIMITS
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.headings import Condition, Heading
from psafit.experiment.importing.layout import Head
from psafit.experiment.importing.quantities import COLUMNS, SIGMA, Quantity, Volts
from psafit.experiment.importing.records import Options
from psafit.experiment.importing.units import Unit
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.text import listed, shown

WAVEFORM = "waveform"
ERROR_OF = {error: reading for reading, error in SIGMA.items()}
"""Column of the reading that each known error is of."""
HELD = (*CONDITION_COLUMNS, *ERROR_OF)
"""What may be held, in the place of a column."""
BIAS, IDLE = "bias_v", "idle_v"
SETTINGS = tuple(SETTING_LIMITS)
"""What else there is of a group's drive: bias, idle voltage, phase and periods."""
VOLTAGE = RECORDED[1]
"""The column of a recorded drive."""
EXAMPLES = {"frequency_hz": ("kHz", "1.2"), "amplitude_v": ("Vpp", "40")}
"""Unit and number of a condition, as an example."""
AS_IT_STANDS = "if its numbers are that by their unit, with no further factor"
"""What is added where a column is proposed whose heading says more, or something else."""
READ = ("reading", "trace")
"""Roles of what is read."""
SIGNALS = (*READ, "error")
"""Roles of what a sensor's volts may be."""


@dataclass(frozen=True)
class Column:
    """A column of a file that is used.

    Parameters
    ----------
    place : int
        From 0.
    heading : Heading
    column : str
        psafit's, `"waveform"` or `"group"`.
    unit : Unit or None
        None where each cell has its own.
    volts : {"peak", "pp", "rms"} or None
    mapped : bool
        Whether the user says so.
    """

    place: int
    heading: Heading
    column: str
    unit: Unit | None = None
    volts: Volts | None = None
    mapped: bool = False

    @property
    def name(self) -> str:
        """What a message calls it."""
        return shown(self.heading.text) if self.heading.text else f"number {self.place + 1}"

    @property
    def at(self) -> tuple[Condition, ...]:
        """Conditions of what was read that its heading names."""
        return self.heading.conditions if role(self.column) in READ else ()

    @property
    def title(self) -> str:
        """Its heading, or its number where it has none."""
        return self.heading.text or str(self.place + 1)

    @property
    def option(self) -> str:
        """What ``--column`` calls it; of several with one heading all, if they are readings, else its number."""
        one = self.heading.repeats and role(self.column) not in SIGNALS
        number = "#" if self.heading.text.isdigit() else ""
        return f"{number}{self.place + 1}" if one or number else self.title


@dataclass(frozen=True)
class Chosen:
    """Columns that are used, and headings that are not: plain ones, and those psafit cannot use yet."""

    columns: tuple[Column, ...]
    unused: tuple[Column, ...]
    not_yet: tuple[Column, ...]
    traced: bool = False

    def held(self, options: Options) -> dict[str, float]:
        """Conditions that were held, of those that such a table takes and has no column of."""
        here = {c.column for c in self.columns} | {a.column for c in self.columns for a in c.at}
        takes = (*CONDITION_COLUMNS, *(e for e, reading in ERROR_OF.items() if reading in here))
        return {name: value for name, value in options.held.items() if name in takes and name not in here}

    def recorded(self, options: Options) -> bool:
        """Whether the drive was recorded, in a column or in a file of its own."""
        return bool(self.of(VOLTAGE)) or (options.drive is not None and options.drive.recorded)

    def settings(self, options: Options) -> dict[str, float]:
        """Voltages, phase and length of the drive that were held; a recorded one has all but the first in it."""
        takes = (IDLE,) if self.recorded(options) else SETTINGS
        return {name: options.held[name] for name in takes if name in options.held and not self.of(name)}

    def of(self, column: str) -> list[Column]:
        """The columns of the file that hold a column of psafit's."""
        return [c for c in self.columns if c.column == column]

    @property
    def readings(self) -> list[str]:
        """Psafit's columns of readings that are there; of a drive in a file of its own the voltage."""
        found = [c.column for c in self.columns if role(c.column) in READ]
        return list(dict.fromkeys(found or (c.column for c in self.of(VOLTAGE))))


def option(heading: str, column: str, unit: str = "") -> str:
    """A ``--column`` option as it is typed."""
    mapping = f"{heading}={column}:{unit}" if unit else f"{heading}={column}"
    return f"--column {shlex.quote(mapping)}"


def role(column: str) -> str:
    """What a column of psafit's is of an experiment; empty for the others that a mapping may name."""
    return COLUMNS[column].role if column in COLUMNS else ""


def fault(grid: Grid, head: Head, what: str, remedy: str) -> InputError:
    """A fault of a table's headings."""
    return InputError(what, remedy, file=grid.file, line=head.line or 1)


def cells(grid: Grid, head: Head, place: int) -> list[object]:
    """What stands in a column below the headings, empty cells left out."""
    return [row.cells[place] for row in grid.rows[head.first :] if place < len(row.cells) and row.texts[place]]


def in_volts(column: Column, head: Head) -> bool:
    """Whether heading or row of units give volts."""
    unit = head.unit(column.place)
    return unit is not None and unit.kind == "V"


def all_headings(head: Head) -> str:
    """All headings, for a message; the columns where there are none."""
    return listed(shown(h.text) for h in head.headings if h.text) or "the columns"


def example(column: str) -> str:
    """How a condition that was held is given."""
    unit, value = EXAMPLES[column]
    return f"{column}={value}:{unit}"


def nearest(columns: Iterable[Column], head: Head, column: str) -> Column | None:
    """The one column that has a unit of this quantity; None where there are several."""
    near = [c for c in columns if nearly(c, head, COLUMNS[column])]
    return near[0] if len(near) == 1 else None


def nearly(column: Column, head: Head, quantity: Quantity) -> bool:
    """Whether it has a unit of a quantity, and is not said to be of another part of the rig."""
    unit, other = head.unit(column.place), column.heading.of_tip != (quantity.part == "tip")
    return unit is not None and unit.kind == quantity.unit and not (other and quantity.part in ("ball", "tip"))

"""What is asked of an import, and what comes of it: frozen records."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import TypeVar

from psafit.drives import TABLE, WAVEFORMS, Drive
from psafit.errors import InputError
from psafit.experiment.drive_table import SETTING_LIMITS
from psafit.experiment.importing.quantities import VOLTS, Volts
from psafit.experiment.importing.units import Unit
from psafit.experiment.records import Group, GroupId
from psafit.experiment.text import shown

IGNORED = "ignore"
GROUPS, SESSIONS = LABELS = "group", "session"

_T = TypeVar("_T")
Held = float | tuple[float | None, ...]
"""What was held, of all tables or of each; None of a table that has none, or has it in a column."""


def file_of(group_id: GroupId) -> str:
    """The file of a group's readings."""
    return f"group{group_id}.csv" if isinstance(group_id, int) else f"group-{group_id}.csv"


@dataclass(frozen=True)
class Mapping:
    """What the user says of a column.

    Parameters
    ----------
    heading : str
        As it stands in the file, with or without its unit, or the number of the column, from 1.
    column : str
        psafit's column, `"waveform"`, `"group"` (a new label begins another group) or `"ignore"`.
    unit : Unit or None
        Unit of the values; None for the one of the heading.
    table : tuple of (int, int), optional
        The table of which alone this is said, from 0, and the number of those that were thought of.
    """

    heading: str
    column: str
    unit: Unit | None = None
    table: tuple[int, int] | None = None


@dataclass(frozen=True)
class Options:
    """What no file says, or says in two ways.

    Parameters
    ----------
    columns : tuple of Mapping
    values : tuple of (str, float or tuple of float)
        Conditions that were held: psafit's column, and its value in the unit of that; or one, or None, for each table.
        Others are `bias_v`, `idle_v`, `phase_deg` and `cycles` of the drive.
    counted : tuple of {"peak", "pp", "rms"}
        How the volts of an amplitude that was held are counted; one, or one for each table. Empty for zero to peak.
    waveforms : tuple of str
        One for all tables, or one for each; empty where a column says it.
    sessions : tuple of group ids
        The session of all tables, or one for each; None for a table of which each group is one.
    meant : tuple of (str, str)
        What words in such a column mean, where psafit's waveform of that name is not meant: word and waveform.
    volts : {"peak", "pp", "rms"} or None
        How volts are counted where no heading says so.
    decimal : {".", ","} or None
        Decimal mark; None for the one under which all numbers can be read.
    separator : str or None
        Between cells; None to detect it.
    encoding : str or None
        Of text; None to detect it.
    sheets : tuple of str
        Sheets of a workbook, each a group; empty where only one holds a table.
    step_us : Decimal or None
        From one sample to the next, of samples without times; None where a header says it.
    start_us : float or None
        When the drive starts, on the clock of a trace; samples before it are left out. None where none lie before 0.
    from_rest : bool
        Whether a trace counts from the mean of its samples before the start.
    every : int
        One sample of a trace in so many is kept; of a recorded drive the means of so many.
    drive_file : Path or None
        A voltage over time, which is the drive of the waveform `"table"`.
    period_us : float or None
        How long one period of it lasts; None for a voltage that is taken as it is.
    drive : psafit.drives.Drive or None
        Of that voltage, once it is read.
    least_samples, most_samples : int
        Of a trace, those that are kept: what `psafit.experiment.trace_table.read_trace` takes. Of a recorded drive all.
    most_at_rest : float
        A recorded drive rests before its start, where its voltage varies by no more than this part of its whole span.
    most_bytes, most_rows : int
        A larger file is refused: it is no sweep of launches.
    """

    columns: tuple[Mapping, ...] = ()
    values: tuple[tuple[str, Held], ...] = ()
    counted: tuple[Volts, ...] = ()
    waveforms: tuple[str, ...] = ()
    sessions: tuple[GroupId | None, ...] = ()
    meant: tuple[tuple[str, str], ...] = ()
    volts: Volts | None = None
    decimal: str | None = None
    separator: str | None = None
    encoding: str | None = None
    sheets: tuple[str, ...] = ()
    step_us: Decimal | None = None
    start_us: float | None = None
    from_rest: bool = False
    every: int = 1
    drive_file: Path | None = None
    period_us: float | None = None
    drive: Drive | None = None
    least_samples: int = 10
    most_samples: int = 100_000
    most_at_rest: float = 0.1
    most_bytes: int = 2**27
    most_rows: int = 1_000_000

    @property
    def held(self) -> dict[str, float]:
        """Conditions that were held, of options of one table."""
        return {name: value for name, value in self.values if not isinstance(value, tuple)}

    @property
    def volts_asked(self) -> str:
        """The options that say how volts are counted; a drive from 0 V has the same number zero to peak as in all."""
        offered = ", ".join(f"--volts {way}" for way in VOLTS)
        unipolar = {name for name, waveform in WAVEFORMS.items() if waveform.unipolar}
        same = self.waveforms and unipolar.issuperset(self.waveforms)
        return f"{offered} (the first two are the same number for a drive from 0 V)" if same else offered

    def drive_of(self, waveform: str, settings: dict[str, float]) -> Drive:
        """The drive of a waveform; `settings` are those of its keys that are known."""
        drive = Drive(waveform) if self.drive is None or waveform != TABLE else self.drive
        keys = {name: settings.get(name, getattr(drive, name)) for name in SETTING_LIMITS}
        return replace(drive, **keys)

    def of_table(self, number: int, n_tables: int) -> Options:
        """The options of one of several tables, counted from 0.

        Raises
        ------
        InputError
            If a condition, a heading or the session has neither one value nor one for each table.
        """
        remedy = "give one, or one for each, blank where there is none"

        def own_of(given: tuple[_T, ...]) -> tuple[_T, ...]:
            return given[number : number + 1] if len(given) > 1 else given

        for m in self.columns:
            if m.table and m.table[1] != n_tables:
                raise InputError(f"{m.table[1]} columns for {shown(m.heading)} and {n_tables} tables", remedy)
        own: list[tuple[str, float]] = []
        for name, given in self.values:
            each = given if isinstance(given, tuple) else (given,)
            if len(each) not in (1, n_tables):
                what = f"{len(each)} values of {name} for {n_tables} tables"
                raise InputError(what, f"{remedy}; a comma is no decimal mark")
            own += [(name, one) for one in own_of(each) if one is not None]
        if len(self.sessions) > 1 and len(self.sessions) != n_tables:
            raise InputError(f"{len(self.sessions)} sessions for {n_tables} tables", remedy)
        alone = (0, 1)  # the one table that these options are of
        said = (m for m in self.columns if m.table is None or m.table[0] == number)
        columns = tuple(replace(m, table=m.table and alone) for m in said)
        return replace(
            self, values=tuple(own), columns=columns, counted=own_of(self.counted),
            waveforms=own_of(self.waveforms), sessions=own_of(self.sessions),
        )  # fmt: skip


@dataclass(frozen=True)
class Understood:
    """How a column of psafit's came from the columns of a file.

    Parameters
    ----------
    column : str
    headings : tuple of str
        Those it was read from: several where readings were repeated, none where the value was given.
    unit : str
        As written; empty where each cell has its own.
    factor : float
        Number that the values were multiplied with; 1 where columns or cells have units of their own.
    volts : {"peak", "pp", "rms"} or None
    zero : float
        What was subtracted, in the unit of the column.
    """

    column: str
    headings: tuple[str, ...]
    unit: str
    factor: float
    volts: Volts | None = None
    zero: float = 0.0


@dataclass(frozen=True)
class Example:
    """A row of a file, and the readings that came of it, each the values of psafit's columns."""

    line: int
    cells: tuple[str, ...]
    readings: tuple[tuple[tuple[str, float], ...], ...]


@dataclass(frozen=True)
class Table:
    """A table of a file, understood.

    Parameters
    ----------
    file : Path
    sheet : str
        Of a workbook; empty for text.
    encoding, separator, decimal : str
        Of text; empty for a workbook, and where nothing hangs on it.
    header_line : int
        Line of the headings; 0 where there are none.
    columns : tuple of Understood
    examples : tuple of Example
        The first rows.
    unused : tuple of str
        Headings that were left out, since they are none of psafit's or were to be ignored.
    labelled : tuple of (str, int)
        Those of them that hold a label for each block of rows, and how many labels.
    errors : tuple of (str, str)
        Those of them that may hold the known error of a reading, and what `--column` would call them.
    possible : tuple of (str, str)
        Those of them that may hold another reading, and what `--column` would call them.
    not_yet : tuple of (str, str)
        Headings that were recognised as a quantity that psafit cannot use, and that quantity.
    above : tuple of (int, str, str)
        What stands above the headings, may be of the drive and is not read: line, text and remedy.
    left_out : tuple of (int, str)
        Rows that hold no reading: line and text.
    groups : tuple of Group
        What was read; `file` names the table that is to be written.
    labels : tuple of str
        What a column says of each group; empty where none does.
    recordings : tuple of Table
        Files of the drives, which have no groups; each with the first table that has it.
    """

    file: Path
    sheet: str
    encoding: str
    separator: str
    decimal: str
    header_line: int
    columns: tuple[Understood, ...]
    examples: tuple[Example, ...]
    unused: tuple[str, ...]
    labelled: tuple[tuple[str, int], ...]
    errors: tuple[tuple[str, str], ...]
    possible: tuple[tuple[str, str], ...]
    not_yet: tuple[tuple[str, str], ...]
    above: tuple[tuple[int, str, str], ...]
    left_out: tuple[tuple[int, str], ...]
    groups: tuple[Group, ...] = field(repr=False)
    labels: tuple[str, ...] = ()
    recordings: tuple[Table, ...] = ()

    @property
    def place(self) -> str:
        """File, and sheet where there is one."""
        return f"{self.file.name}, sheet {self.sheet}" if self.sheet else self.file.name

    @property
    def renamed_groups(self) -> list[tuple[Group, str]]:
        """Each group with its label, where that is not its id."""
        return [(group, label if label != str(group.id) else "") for group, label in self.labelled_groups]

    @property
    def labelled_groups(self) -> list[tuple[Group, str]]:
        """Each group with its label."""
        return list(zip(self.groups, self.labels or [""] * len(self.groups), strict=True))


__all__ = ["GROUPS", "IGNORED", "LABELS", "SESSIONS", "Example", "Mapping", "Options", "Table", "Understood"]

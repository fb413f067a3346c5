"""Which column of a table is which of psafit's: recognised by name and unit, or as the user says."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from psafit.errors import Faults, InputError
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.headings import Heading
from psafit.experiment.importing.layout import Head, names
from psafit.experiment.importing.numerals import is_number, likeliest
from psafit.experiment.importing.quantities import COLUMNS, QUANTITIES, VOLTS, Volts
from psafit.experiment.importing.records import GROUPS, IGNORED, Options
from psafit.experiment.importing.units import Unit, factor_of
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.text import listed, shown
from psafit.experiment.trace_table import TIME, TRACES
from psafit.observables import OF_LAUNCHES

WAVEFORM, VOLTAGE = "waveform", "voltage_v"
ERROR_OF = {o.sigma_column: o.column for o in OF_LAUNCHES}
"""Column of the reading that each known error is of."""
HELD = (*CONDITION_COLUMNS, *ERROR_OF)
"""What may be held, in the place of a column."""
READ = ("reading", "trace")
"""Roles of what is read."""
SIGNALS = (*READ, "error")
"""Roles of what a sensor's volts may be."""
_EXAMPLES = {"frequency_hz": ("kHz", "1.2"), "amplitude_v": ("Vpp", "40")}


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
    def option(self) -> str:
        """What ``--column`` calls it."""
        return self.heading.text or str(self.place + 1)


@dataclass(frozen=True)
class Chosen:
    """Columns that are used, and headings that are not: plain ones, and those psafit cannot use yet."""

    columns: tuple[Column, ...]
    unused: tuple[Column, ...]
    not_yet: tuple[Column, ...]
    traced: bool = False

    def held(self, options: Options) -> dict[str, float]:
        """Conditions that were held, of those that such a table takes and has no column of."""
        here = {c.column for c in self.columns}
        takes = (*CONDITION_COLUMNS, *(e for e, reading in ERROR_OF.items() if reading in here))
        return {name: value for name, value in options.held.items() if name in takes and name not in here}

    def of(self, column: str) -> list[Column]:
        """The columns of the file that hold a column of psafit's."""
        return [c for c in self.columns if c.column == column]

    @property
    def readings(self) -> list[str]:
        """Psafit's columns of readings that are there."""
        return list(dict.fromkeys(c.column for c in self.columns if _role(c.column) in READ))


def option(heading: str, column: str, unit: str = "") -> str:
    """A ``--column`` option as it is typed."""
    mapping = f"{heading}={column}:{unit}" if unit else f"{heading}={column}"
    return f"--column {shlex.quote(mapping)}"


def choose(grid: Grid, head: Head, options: Options) -> Chosen:
    """Say what each column holds.

    Raises
    ------
    InputError
        Where something needed is missing, or could be one of several: a line each, with the option that says it.
    """
    faults = Faults()
    mapped = _mapped(grid, head, options, faults)
    traced = _is_trace(head, mapped)
    found = _recognised(head, mapped, traced=traced)
    if not len(faults):
        _check_unnamed(grid, head, found, faults)
    faults.end()
    said = {c.column for c in found if c.mapped}
    used = [c for c in found if c.column not in ("", IGNORED, VOLTAGE) and (c.mapped or c.column not in said)]
    roles = ("condition", "time", "trace") if traced else ("condition", "reading", "error")
    usable = {q.column for q in QUANTITIES if q.usable} | {WAVEFORM, GROUPS}
    kept = [c for c in used if c.column in usable and _role(c.column) in (*roles, "")]
    not_yet = [c for c in used if c.column not in usable]
    _check_drive(grid, head, not_yet, faults)
    for column in dict.fromkeys(c.column for c in kept):
        _check_several(grid, head, [c for c in kept if c.column == column], faults)
    unused = [c for c in found if c not in kept and c not in not_yet]
    chosen = Chosen(tuple(kept), tuple(unused), tuple(not_yet), traced)
    (_check_trace if traced else _check_missing)(grid, head, chosen, options, faults)
    faults.end()
    counted = [_with_unit(grid, head, c, options, faults) for c in kept]
    faults.end()
    return replace(chosen, columns=tuple(counted))


def _role(column: str) -> str:
    return COLUMNS[column].role if column in COLUMNS else ""


def _error(grid: Grid, head: Head, what: str, remedy: str) -> InputError:
    return InputError(what, remedy, file=grid.file, line=head.line or 1)


def _mapped(grid: Grid, head: Head, options: Options, faults: Faults) -> dict[int, Column]:
    """The columns of which the user says what they are, by their places."""
    mapped: dict[int, Column] = {}
    for mapping in options.columns:
        places = names(mapping, head.headings)
        single = mapping.column in (*CONDITION_COLUMNS, TIME, WAVEFORM, GROUPS)
        if len(places) > 1 and single:
            what = f"{len(places)} columns are called {shown(mapping.heading)}"
            faults.add(_error(grid, head, what, f"give the number of one: {option('2', mapping.column)}"))
        for place in places:
            if place in mapped:
                what = f"column {mapped[place].name} is named twice"
                faults.add(_error(grid, head, what, "give --column once for each column"))
            said = mapping.unit
            mapped[place] = Column(
                place, head.headings[place], mapping.column, said, said.volts if said else None, mapped=True
            )
    return mapped


def _is_trace(head: Head, mapped: dict[int, Column]) -> bool:
    """Whether a table is a motion over time, in the place of launches: time and motion, and no frequency."""
    said = {c.column for c in mapped.values()}
    could = {
        q.column
        for place, heading in enumerate(head.headings)
        for q in ([] if place in mapped else heading.quantities(head.units[place]))
    }
    over_time = TIME in could | said and "frequency_hz" not in could | said
    return not said.isdisjoint(TRACES) or (over_time and not could.isdisjoint(TRACES))


def _recognised(head: Head, mapped: dict[int, Column], *, traced: bool) -> list[Column]:
    """Each column with what it is: empty for unknown, or `"ignore"`."""
    other = ("reading", "error") if traced else ("trace",)
    could = [
        [q for q in h.quantities(u) if q.role not in other] for h, u in zip(head.headings, head.units, strict=True)
    ]
    sure = {some[0].column for some in could if len(some) == 1} | {c.column for c in mapped.values()}
    found = []
    for place, heading in enumerate(head.headings):
        if place in mapped:
            found.append(mapped[place])
        elif heading.is_waveform:
            found.append(Column(place, heading, WAVEFORM))
        else:
            of_these = [q for q in could[place] if ERROR_OF.get(q.column, q.column) in sure or q.role != "error"]
            found.append(Column(place, heading, of_these[0].column if len(of_these) == 1 else ""))
    return found


def _cells(grid: Grid, head: Head, place: int) -> list[object]:
    """What stands in a column below the headings, empty cells left out."""
    return [row.cells[place] for row in grid.rows[head.first :] if place < len(row.cells) and row.texts[place]]


def _check_unnamed(grid: Grid, head: Head, found: Iterable[Column], faults: Faults) -> None:
    """A column of numbers without a name is no reading that may be left out, unless it numbers the rows."""
    for column in found:
        cells = _cells(grid, head, column.place)
        if column.heading.text or column.mapped or not head.line or not any(map(is_number, cells)):
            continue
        texts = [str(cell) for cell in cells]
        if column.place == 0 and texts in ([str(k + start) for k in range(len(texts))] for start in (0, 1)):
            continue
        number = str(column.place + 1)
        what = f"column {number} holds numbers and has no heading"
        faults.add(_error(grid, head, what, f"give it one, or say {option(number, IGNORED)}"))


def _check_drive(grid: Grid, head: Head, columns: Iterable[Column], faults: Faults) -> None:
    """What changes the drive cannot be left out, unless it is zero."""
    for column in columns:
        numbers = [likeliest([cell]).number(cell) for cell in _cells(grid, head, column.place)]
        if _role(column.column) == "drive" and any(n is not None and n.value != 0 for n in numbers):
            what = f"column {column.name} holds {column.column}, which is not zero and which psafit cannot use yet"
            remedy = f"a drive without it is another one; {option(column.option, IGNORED)} leaves it out all the same"
            faults.add(_error(grid, head, what, remedy))


def _check_several(grid: Grid, head: Head, columns: Sequence[Column], faults: Faults) -> None:
    """Several columns of one quantity are repetitions, if they are readings and numbered; else it is asked."""
    first = columns[0]
    if len(columns) == 1 or (_role(first.column) in READ and (first.mapped or _repeated(columns))):
        return
    what = f"columns {listed(c.name for c in columns)} could all be {first.column}"
    faults.add(_error(grid, head, what, f"say which: {option(columns[-1].option, first.column)}"))


def _repeated(columns: Sequence[Column]) -> bool:
    """Whether columns have one name, or one but for numbers from 0 or 1."""
    same_name = len({c.heading.name for c in columns}) == 1
    same = len({c.heading.text for c in columns}) == 1
    numbers = sorted(-1 if c.heading.number is None else c.heading.number for c in columns)
    return same_name and (same or numbers in ([k + first for k in range(len(columns))] for first in (0, 1)))


def _check_missing(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    held, there = options.held, _there(head)
    times = [c for c in chosen.unused if c.column == TIME]
    if times and not chosen.readings and not chosen.of("frequency_hz"):
        what = (
            f"no frequency_hz among {there}: column {times[0].name} looks like a trace over time, but none is a motion"
        )
        volts = [c.option for c in (*chosen.unused, *chosen.of("amplitude_v")) if _in_volts(c, head)]
        scale = option(volts[0] if volts else "NAME", "velocity_mm_s", "5mm/s/V")
        faults.add(_error(grid, head, what, f"say what one volt is, such as {scale} or 2um/V, of displacement_um"))
        return
    for column in CONDITION_COLUMNS:
        if not chosen.of(column) and column not in held:
            near = _nearest(chosen.unused, head, column)
            remedy = f"say {option(near or 'NAME', column, '' if near else _EXAMPLES[column][0])}"
            remedy = f"{remedy}, or --set {_example(column)} if held"
            faults.add(_error(grid, head, f"no {column} among {there}", remedy))
    if not chosen.readings:
        near = _nearest(chosen.unused, head, "launch_range_um")
        what, remedy = f"no launch_range_um among {there}", f"say {option(near or 'NAME', 'launch_range_um')}"
        if not near:
            remedy = f"{remedy}, or as one of {listed(ERROR_OF.values())}"
            volts = [c.option for c in chosen.unused if _in_volts(c, head)]
            scale = option(volts[0] if volts else "NAME", "launch_speed_mm_s", "5mm/s/V")
            remedy = f"{remedy}; a sensor's volts with their scale, {scale}"
        if chosen.not_yet:
            what = f"{what}, but {listed(f'{c.column} ({c.name})' for c in chosen.not_yet)}"
            remedy = "psafit cannot use that yet: give a file with launch ranges; it is no launch range"
        faults.add(_error(grid, head, what, remedy))


def _there(head: Head) -> str:
    return listed(shown(h.text) for h in head.headings if h.text)


def _in_volts(column: Column, head: Head) -> bool:
    unit = head.unit(column.place)
    return unit is not None and unit.kind == "V"


def _example(column: str) -> str:
    """How a condition that was held is given."""
    unit, value = _EXAMPLES[column]
    return f"{column}={value}:{unit}"


def _check_trace(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """A trace has a time, and one frequency and one amplitude, which it does not say."""
    if not chosen.of(TIME):
        near = _nearest(chosen.unused, head, TIME)
        what = f"a trace, and no {TIME} among {_there(head)}"
        faults.add(_error(grid, head, what, f"say {option(near or 'NAME', TIME, '' if near else 'ms')}"))
    for column in (c for name in CONDITION_COLUMNS for c in chosen.of(name)):
        what = f"a trace has one {column.column}, and column {column.name} may be it or the drive over time"
        remedy = f"say --set {_example(column.column)} and {option(column.option, IGNORED)}"
        if (times := chosen.of(TIME)) and not times[0].mapped:
            remedy = f"{remedy}; of launches, {option(times[0].option, IGNORED)}"
        faults.add(_error(grid, head, what, remedy))
    missing = [n for n in CONDITION_COLUMNS if n not in options.held and not chosen.of(n)]
    if missing:
        what = f"a trace over time, and nothing says {' and '.join(missing)} of its drive"
        faults.add(_error(grid, head, what, f"say {' '.join(f'--set {_example(n)}' for n in missing)}"))


def _nearest(columns: Iterable[Column], head: Head, column: str) -> str:
    """The one heading that has a unit of this quantity; empty where there are several."""
    near = [c.option for c in columns if (u := head.unit(c.place)) and u.kind == COLUMNS[column].unit]
    return near[0] if len(near) == 1 else ""


def _with_unit(grid: Grid, head: Head, column: Column, options: Options, faults: Faults) -> Column:
    """A column with its unit, and how its volts are counted."""
    if column.column not in COLUMNS:
        return column
    target = COLUMNS[column.column].unit
    unit = column.unit or head.unit(column.place)
    if column.unit and column.unit.scale is not None:
        unit = _on_scale(grid, head, column, column.unit, faults)
    cells = [cell for cell in _cells(grid, head, column.place) if is_number(cell)]
    own = not unit and bool(cells) and all(isinstance(c, str) and c[-1:].isalpha() for c in cells)
    below = head.units[column.place]
    if unit and below and not column.mapped and below.factor(target) != unit.factor(target):
        what = f"column {column.name} is in {shown(unit.text)}, and in {shown(below.text)} by the row of units"
        faults.add(_error(grid, head, what, f"say {option(column.option, column.column, target)}, or what it is in"))
    elif unit and unit.kind != target:
        what = f"column {column.name}: {shown(unit.text)} is no unit of {column.column}"
        faults.add(_error(grid, head, what, f"say {option(column.option, column.column, target)}"))
    elif not unit and not own:
        other = {"Hz": "kHz", "V": "mV", "um": "mm", "us": "ms", "mm/s": "m/s"}.get(target, target)
        what = f"column {column.name} gives no unit"
        remedy = f"say {option(column.option, column.column, target)}, or another unit such as {other}"
        faults.add(_error(grid, head, what, remedy))
    volts = None
    if target == "V":
        volts = _volts(grid, head, column, unit, options, own=own, faults=faults)
    return replace(column, unit=unit, volts=volts)


def _on_scale(grid: Grid, head: Head, column: Column, scale: Unit, faults: Faults) -> Unit:
    """The unit of a sensor's signal; where that is in mV by its heading, the scale is another."""
    target, said = COLUMNS[column.column].unit, head.unit(column.place)
    if said is None:
        return scale
    per_volt = factor_of(scale.text, f"{target}/V") is not None
    factor = factor_of(said.text, "V" if per_volt else target)
    if factor is None:
        what = f"column {column.name} is in {shown(said.text)}, and {shown(scale.said)} is no scale of it"
        faults.add(_error(grid, head, what, f"say {option(column.option, column.column)}, or give it another unit"))
        return scale
    return replace(scale, step=factor) if per_volt else scale


def _volts(
    grid: Grid, head: Head, column: Column, unit: Unit | None, options: Options, *, own: bool, faults: Faults
) -> Volts | None:
    """How the volts of a column are counted; where each cell says it by itself, that goes before."""
    below = head.units[column.place]
    said = {v for v in (column.heading.volts, unit.volts if unit else None, below.volts if below else None) if v}
    if column.mapped:
        return column.volts or (said.pop() if len(said) == 1 else options.volts or "peak")
    if len(said) == 1:
        return said.pop()
    if own or (options.volts and not said):
        return options.volts
    what = f"column {column.name}: whether volts are zero to peak, peak to peak or RMS is not said"
    remedy = f"say --volts {', --volts '.join(VOLTS)}, or {option(column.option, column.column, 'Vpp')}"
    faults.add(_error(grid, head, what, remedy))
    return None

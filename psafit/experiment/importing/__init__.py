"""Read what instruments and spreadsheets write, and make an experiment folder of it.

Everything that was understood is kept in records and printed; what can be understood in two ways is asked for by one
`InputError`, never guessed. Text is decoded by charset-normalizer, split by clevercsv and csv; workbooks are read by
calamine; units are pint's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np

from psafit.drives import WAVEFORMS, Drive
from psafit.errors import Faults, InputError
from psafit.experiment.importing.columns import WAVEFORM, choose
from psafit.experiment.importing.folder import Imported, write_import
from psafit.experiment.importing.grid import Grid, grids
from psafit.experiment.importing.layout import Head, body, find_head, names
from psafit.experiment.importing.quantities import BLANKS, COLUMNS, SEPARATORS
from psafit.experiment.importing.records import GROUPS, IGNORED, Example, Mapping, Options, Table, Understood
from psafit.experiment.importing.values import Reading, groups_of, known_waveform, readings
from psafit.experiment.records import Group
from psafit.experiment.table import CellFault, readings_of
from psafit.experiment.text import did_you_mean, listed, shown

COLUMN_NAMES = (*COLUMNS, WAVEFORM, GROUPS, IGNORED)
"""What `--column` may call a column."""

__all__ = ["COLUMN_NAMES", "Imported", "Mapping", "Options", "Table", "read_files", "write_import"]


def read_files(files: Sequence[Path], options: Options, examples: int = 3) -> list[Table]:
    """Read tables of measurements in whatever form.

    Parameters
    ----------
    files : sequence of Path
        Text with any separator, or workbooks.
    options : Options
    examples : int
        Rows of each table that are kept as they were understood.

    Returns
    -------
    list of Table
        One a file, or a sheet; the ids of their groups count from 1.

    Raises
    ------
    InputError
        Where something cannot be read, is impossible, or can be understood in two ways.
    """
    faults = Faults()
    found: list[list[tuple[Grid, Head]]] = []
    for file in files:
        with faults.kept():
            found += _tables(file, options)
    faults.end()
    _check_mappings([tries[0] for tries in found], options)
    shapes = _waveforms([tries[0] for tries in found], options)
    tables: list[Table] = []
    for tries, shape in zip(found, shapes, strict=True):
        first_id = sum(len(t.groups) for t in tables) + 1
        with faults.kept():
            tables.append(_readable(tries, options, shape, first_id, examples))
    faults.end()
    return tables


def _tables(file: Path, options: Options) -> list[list[tuple[Grid, Head]]]:
    """The tables of a file with their headings; a table of a text under each separator that it may have."""
    tries = [(grid, head) for grid in grids(file, options) if (head := find_head(grid, options))]
    if any(head.known > 1 and grid.separator not in BLANKS for grid, head in tries):  # blanks are within headings
        tries = [(grid, head) for grid, head in tries if grid.separator not in BLANKS]
    most = max((head.known for _, head in tries), default=0)
    best = [(grid, head) for grid, head in tries if head.known == most]
    if not best:
        raise InputError(
            "no column is recognised",
            "name the columns: --column 'Freq=frequency_hz:kHz', or by number: --column 1=frequency_hz:kHz",
            file=file,
            line=1,
        )
    if not best[0][0].sheet:
        return [best]
    if options.sheets:
        if missing := [s for s in options.sheets if s not in {grid.sheet for grid, _ in tries}]:
            raise InputError(f"sheet {shown(missing[0])} holds no table", "give another with --sheet", file=file)
        return [[one] for one in tries]
    tables = [grid.sheet for grid, head in tries if head.known > 1]
    if len(tables) > 1 or len(best) > 1:
        raise InputError(f"sheets {listed(tables)} hold tables", "say which: --sheet NAME; repeat", file=file)
    return [best]


def _readable(
    tries: Sequence[tuple[Grid, Head]], options: Options, waveform: str, first_id: int, examples: int
) -> Table:
    """The table of a file under the separator under which all of it can be read.

    Raises
    ------
    InputError
        Where there is none: what is wrong under the likeliest one; or several that differ.
    """
    tables, faults = [], []
    for grid, head in tries:
        try:
            tables.append(_understood(grid, head, options, waveform, first_id, examples))
        except InputError as fault:
            faults.append(fault)
    if not tables:
        raise faults[0]
    if len({_content(table) for table in tables}) > 1:
        marks = " and ".join(SEPARATORS.get(table.separator, repr(table.separator)) for table in tables)
        raise InputError(f"can be read with {marks} as separators", "say which: --separator", file=tables[0].file)
    return tables[0]


def _content(table: Table) -> tuple[object, ...]:
    """What was read, to be compared."""
    arrays = [(g.waveform, getattr(g, f.name)) for g in table.groups for f in fields(g)]
    return tuple((shape, array.tobytes()) for shape, array in arrays if isinstance(array, np.ndarray))


def _check_mappings(found: Sequence[tuple[Grid, Head]], options: Options) -> None:
    """Each mapping is about a column of some table."""
    faults = Faults()
    for mapping in options.columns:
        if not any(names(mapping, head.headings) for _, head in found):
            known = [h.text for _, head in found for h in head.headings if h.text]
            remedy = did_you_mean(mapping.heading, known) if known else "give the number of a column, from 1"
            place = found[0][0].file if len(found) == 1 else None
            faults.add(InputError(f"there is no column {shown(mapping.heading)}", remedy, file=place))
    faults.end()


def _waveforms(found: Sequence[tuple[Grid, Head]], options: Options) -> list[str]:
    """The waveform of each table; empty where a column says it."""
    faults = Faults()
    given = options.waveforms
    if len(given) > 1 and len(given) != len(found):
        raise InputError(f"{len(given)} waveforms for {len(found)} tables", "give one, or one for each")
    for name in given:
        with faults.kept():
            try:
                known_waveform(name)
            except CellFault as fault:
                raise InputError(f"--waveform {fault.what}", fault.remedy) from fault
    shapes = []
    for number, (grid, head) in enumerate(found):
        mapped = {place: m.column for m in options.columns for place in names(m, head.headings)}
        said = any(mapped.get(p, WAVEFORM if h.is_waveform else "") == WAVEFORM for p, h in enumerate(head.headings))
        shape = "" if not given else given[0] if len(given) == 1 else given[number]
        if said and shape:
            faults.add(
                InputError("a column gives the waveform", "leave out --waveform", file=grid.file, line=head.line)
            )
        if not said and not shape:
            remedy = f"say --waveform NAME, of {listed(WAVEFORMS)}; of several tables --waveform sine,square"
            faults.add(InputError("nothing says which waveform of the drive", remedy, file=grid.file))
        shapes.append(shape)
    faults.end()
    return shapes


def _understood(grid: Grid, head: Head, options: Options, waveform: str, first_id: int, examples: int) -> Table:
    """A table, read to its last cell."""
    chosen = choose(grid, head, options)
    rows = body(grid, head, [c.place for c in chosen.columns], options.most_rows)
    found, decimal = readings(grid, head, chosen, rows, options, waveform)
    columns = [Understood(name, (), COLUMNS[name].unit, 1.0) for name, _ in options.values if name in COLUMNS]
    for name in dict.fromkeys(c.column for c in chosen.columns if c.column in COLUMNS):
        same = chosen.of(name)
        units = {c.unit.text: c.unit.factor(COLUMNS[name].unit) for c in same if c.unit}
        factor = float(next(iter(units.values())) or 1) if len(units) == 1 else 1.0
        columns.append(Understood(name, tuple(c.option for c in same), ", ".join(units), factor, same[0].volts))
    columns.sort(key=lambda c: list(COLUMNS).index(c.column))
    cells = {row.line: row.texts for row in rows.rows}
    shown_rows = [
        Example(line, cells[line], tuple(_ordered(r, columns) for r in found if r.line == line))
        for line in list(cells)[:examples]
    ]
    parts = enumerate(groups_of(found).values(), first_id)
    return Table(
        file=grid.file,
        sheet=grid.sheet,
        encoding=grid.encoding,
        separator=grid.separator,
        decimal="" if grid.sheet else decimal,
        header_line=head.line,
        columns=tuple(columns),
        examples=tuple(shown_rows),
        unused=tuple(c.option for c in chosen.unused if c.heading.text),
        not_yet=tuple((c.option, c.column) for c in chosen.not_yet),
        left_out=rows.left_out,
        groups=tuple(_group(number, part) for number, part in parts),
    )


def _ordered(reading: Reading, columns: Sequence[Understood]) -> tuple[float, ...]:
    values = dict(reading.values)
    return tuple(values[c.column] for c in columns)


def _group(number: int, part: Sequence[Reading]) -> Group:
    """Readings as a group of its own."""
    names = dict.fromkeys(name for reading in part for name, _ in reading.values)
    columns = {name: np.array([dict(reading.values).get(name, np.nan) for reading in part]) for name in names}
    return Group(number, Drive(part[0].waveform), f"group{number}.csv", changed=(), **readings_of(columns))

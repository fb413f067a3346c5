"""Read what instruments and spreadsheets write, and make an experiment folder of it.

Everything that was understood is kept in records and printed; what can be understood in two ways is asked for by one
`InputError`, never guessed. Text is decoded by charset-normalizer, split by clevercsv and csv; workbooks are read by
calamine; units are pint's.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import groupby, product
from operator import itemgetter
from pathlib import Path
from typing import TypeVar

import numpy as np

from psafit.drives import NAMES, TABLE, Drive, from_zero
from psafit.errors import Faults, InputError, InputErrors
from psafit.experiment.definition import id_of
from psafit.experiment.drive_table import PERIOD, RECORDED, read_drive
from psafit.experiment.importing.chosen import ERROR_OF, HELD, SETTINGS, VOLTAGE, WAVEFORM, Chosen, option
from psafit.experiment.importing.columns import choose, choose_recording
from psafit.experiment.importing.contradicted import check_above, unread
from psafit.experiment.importing.driven import BY_COLUMN, all_used, by_label, called, in_folders, of_files
from psafit.experiment.importing.folder import Imported, write_import
from psafit.experiment.importing.grid import Grid, Row, grids
from psafit.experiment.importing.layout import (
    Body,
    Head,
    askew,
    body,
    clocked,
    columns_in_words,
    find_head,
    named_waveform,
    names,
    number_rows,
    two_columns,
    waveform_places,
    word,
    words_in,
)
from psafit.experiment.importing.matters import above, check_trigger
from psafit.experiment.importing.numerals import is_number
from psafit.experiment.importing.order import check_order
from psafit.experiment.importing.origin import check_origin, unread_origin
from psafit.experiment.importing.quantities import BLANKS, COLUMNS, QUANTITIES, SEPARATORS, SUFFIXES, VOLTS, words
from psafit.experiment.importing.recorded import ALL, recorded
from psafit.experiment.importing.records import (
    GROUPS,
    IGNORED,
    LABELS,
    SESSIONS,
    Example,
    Mapping,
    Options,
    Table,
    Understood,
    file_of,
)
from psafit.experiment.importing.steps import STEP, with_counts
from psafit.experiment.importing.traces import from_start, trace_of
from psafit.experiment.importing.values import Reading, groups_of, known_waveform, readings
from psafit.experiment.records import CONDITION_COLUMNS, Group
from psafit.experiment.table import CellFault, headed, readings_of
from psafit.experiment.text import did_you_mean, listed, shown
from psafit.experiment.trace_table import TIME, TRACES
from psafit.files import read_bytes
from psafit.observables import OF_LAUNCHES
from psafit.text import count

SETTABLE = (*HELD, *SETTINGS)
"""What may be given for a whole table."""
COLUMN_NAMES = (*(name for name, q in COLUMNS.items() if q.usable), WAVEFORM, *LABELS, IGNORED)
"""What `--column` may call a column."""

Read = TypeVar("Read")

__all__ = ["COLUMN_NAMES", "SETTABLE", "Imported", "Mapping", "Options", "Table", "read_files", "write_import"]


def read_files(
    files: Sequence[Path], options: Options, *, drives: Sequence[Path] = (), examples: int = 3
) -> list[Table]:
    """Read tables of measurements in whatever form.

    Parameters
    ----------
    files : sequence of Path
        Text with any separator, or workbooks.
    options : Options
    drives : sequence of Path
        Files of drives, or a folder of them. A single file is the drive of all tables. Otherwise each group has the one
        that is called as its label is; without labels each file has the one in its place, or of a folder that of its
        name.
    examples : int
        Rows of each table that are kept as they were understood.

    Returns
    -------
    list of Table
        One a file, or a sheet. The ids of their groups are their labels, or count from 1.

    Raises
    ------
    InputError
        Where something cannot be read, is impossible, or can be understood in two ways.
    """
    given, named = in_folders(drives), any(place.is_dir() for place in drives)
    if len(given) < 2 and not named:
        return _read(files, replace(options, drive_file=given[0] if given else options.drive_file), examples)
    apart = {drive.resolve() for drive in given}
    files = [file for file in files if file.resolve() not in apart] or files
    if any(mapping.column == GROUPS for mapping in options.columns):
        return by_label([_read(files, replace(options, drive_file=drive), examples) for drive in given], given)
    if named:
        own = [called([file.stem], given, file, otherwise=BY_COLUMN)[file.stem] for file in files]
        all_used(own, given)
    elif len(files) == len(given):
        own = given
    else:
        remedy = f"give one for each file in their order, or {BY_COLUMN}"
        raise InputError(f"{len(given)} recordings of --drive and {count(len(files), 'file')}", remedy)
    each = (replace(options.of_table(k, len(files)), drive_file=drive) for k, drive in enumerate(own))
    return of_files([_read([file], its, examples) for file, its in zip(files, each, strict=True)], own)


def _read(files: Sequence[Path], options: Options, examples: int) -> list[Table]:
    """Tables that have one drive at most in a file of its own."""
    faults = Faults()
    period = _own_period(options.drive_file, options) if options.drive_file else None
    if options.drive_file and period:  # no table, though it stands among them
        files = [file for file in files if file.resolve() != options.drive_file.resolve()] or files
    found: list[list[tuple[Grid, Head]]] = []
    for file in files:
        with faults.kept():
            found += _tables(file, options)
    faults.end()
    driven = _recordings(options.drive_file, options) if options.drive_file and not period else []
    sheets = {(grid.file, grid.sheet) for grid, *_ in driven}
    apart = [tries for tries in found if (tries[0][0].file, tries[0][0].sheet) not in sheets or _moves(tries, options)]
    found = apart or found
    _check_mappings([*(one for tries in found for one in tries), *((grid, head) for grid, head, _ in driven)], options)
    kept: tuple[Drive, Drive, Table] | None = None
    if period:
        options = replace(options, drive=period)
    if driven:
        reads = [(grid, partial(_drive, grid, head, chosen, options, examples)) for grid, head, chosen in driven]
        kept = _readable(reads, itemgetter(0))
        options = replace(options, drive=kept[1])  # how volts are counted follows from all of its samples
    shapes = _waveforms([tries[0] for tries in found], options)
    tables: list[Table] = []
    for number, (tries, shape) in enumerate(zip(found, shapes, strict=True)):
        first_id = sum(len(t.groups) for t in tables) + 1
        own = options.of_table(number, len(found))
        if shape not in ("", TABLE):  # a drive in a file of its own is that of the other tables
            own = replace(own, drive=None)
        with faults.kept():
            understood = [
                (grid, partial(_understood, grid, head, own, shape, first_id, examples)) for grid, head in tries
            ]
            tables.append(_readable(understood, _content))
    faults.end()
    _check_used(tables, options, [grid for grid, *_ in driven])
    tables = _named(tables)
    return _driven(tables, *kept) if kept else tables


def _moves(tries: Sequence[tuple[Grid, Head]], options: Options) -> bool:
    """Whether a column of a table is a motion, so that it is more than the drive of other tables."""
    said = any(m.column in TRACES and names(m, head.headings) for _, head in tries for m in options.columns)
    found = (q for _, head in tries for h, u in zip(head.headings, head.units, strict=True) for q in h.over_time(u))
    return said or any(q.role == "trace" for q in found)


def _named(tables: list[Table]) -> list[Table]:
    """Tables whose groups have their labels as ids, if each has one of its own that can be an id."""
    labels = [label for table in tables for _, label in table.labelled_groups]
    ids = {str(known).casefold(): known for label in labels if (known := id_of(label)) is not None}
    if len(ids) < len(labels):
        return tables
    next_id = iter(ids.values())
    return [
        replace(t, groups=tuple(replace(g, id=(known := next(next_id)), file=file_of(known)) for g in t.groups))
        for t in tables
    ]


def _driven(tables: Sequence[Table], kept: Drive, whole: Drive, recording: Table) -> list[Table]:
    """Tables whose groups have the drive as it is kept, in place of the whole recording; its file with the first."""
    done, first = [], True
    for table in tables:
        has = any(g.drive.table is whole.table for g in table.groups)
        groups = (
            replace(g, drive=replace(g.drive, table=kept.table)) if g.drive.table is whole.table else g
            for g in table.groups
        )
        done.append(replace(table, groups=tuple(groups), recordings=(recording,) if has and first else ()))
        first = first and not has
    return done


def _own_period(file: Path, options: Options) -> Drive | None:
    """The drive of a file in psafit's own form of one period; None where it has another form."""
    try:
        line, header, _ = headed(file, options.most_bytes, "")
    except InputError:
        return None
    if words(" ".join(header)) != " ".join(PERIOD):
        return None
    if tuple(map(str.lower, header)) != PERIOD:
        remedy = f"separate the cells by commas, decimals by points: {','.join(PERIOD)}"
        raise InputError("one period is read in psafit's own form alone", remedy, file=file, line=line)
    return Drive(TABLE, table=read_drive(file), file=ALL)


def _check_used(tables: Sequence[Table], options: Options, driven: Sequence[Grid]) -> None:
    """What is given for conditions and traces is used by some table, or by the recording in a file of its own.

    Raises
    ------
    InputError
        With each that is not.
    """
    faults = Faults()
    for name, _ in options.values:
        columns = [(table, c) for table in tables for c in table.columns if c.column == name]
        if all(c.headings for _, c in columns):
            what, place = f"{name} is given, and no table takes it", None
            remedy = "leave out --set"
            if columns:
                place, heading = columns[0][0], columns[0][1].headings[0]
                what = f"{name} is given, and column {shown(heading)} holds it"
                if not any(heading in c.headings for c in place.columns if c.column != name):  # a reading has it
                    remedy = f"{remedy}, or say {option(heading, IGNORED)}"
            file, line = (place.file, place.header_line or 1) if place else (None, None)
            faults.add(InputError(what, remedy, file=file, line=line))
    named = [m.heading for m in options.columns if m.column == SESSIONS]
    if named and any(options.sessions):
        what = f"--session is given, and column {shown(named[0])} names the sessions"
        faults.add(InputError(what, f"leave out --session, or say {option(named[0], IGNORED)}"))
    given = {"--start": options.start_us is not None, "--from-rest": options.from_rest, "--every": options.every != 1}
    groups = [group for table in tables for group in table.groups]
    counts = any(grid.counts is not None for grid in driven)
    if options.step_us and not (counts or any(STEP in c.headings for table in tables for c in table.columns)):
        faults.add(InputError("--step is of samples without times, and no table has such", "leave it out"))
    if options.drive and not any(group.drive.table for group in groups):
        what, remedy = "no table has it", f"say --waveform {TABLE}"
        if not options.waveforms:  # else it would be of all tables
            what, remedy = "a column gives other waveforms", f"say {option('HEADING', IGNORED)} of that column"
        faults.add(InputError(f"--drive is given, and {what}", f"{remedy}, or leave --drive out"))
    if options.period_us is not None and not driven:
        remedy = "leave it out: the file holds one period" if options.drive else "give it with --drive FILE"
        faults.add(InputError("--period is of a recorded drive, and there is none", remedy))
    counted = [(t, c) for t in tables for c in t.columns if c.column == "amplitude_v" and c.volts]
    if options.volts and counted and all(c.volts != options.volts for _, c in counted):
        place, column = counted[0]
        where = f"column {shown(column.headings[0])}" if column.headings else "--set amplitude_v"
        what = f"--volts {options.volts} is given, and {where} says {VOLTS[column.volts or 'peak']}"
        remedy = f"leave out --volts, or correct {'the heading' if column.headings else '--set'}"
        faults.add(InputError(what, remedy, file=place.file, line=place.header_line or 1))
    if not driven and not any(group.time_us is not None for group in groups):
        for name in (name for name, is_given in given.items() if is_given):
            faults.add(InputError(f"{name} is of traces, and no table is one", "leave it out"))
    faults.end()


def _heads(file: Path, options: Options, example: str, units: Sequence[str] = ()) -> list[tuple[Grid, Head]]:
    """The tables of a file with their headings; of a text under each separator that it may have.

    A column of these units is known by its unit alone.
    """
    found = grids(file, options)
    timed = any(m.column == TIME for m in options.columns)
    for line, what, remedy in filter(None, map(clocked, () if timed else found)):
        raise InputError(what, remedy, file=file, line=line)
    tries = [(grid, head) for grid in found if (head := find_head(grid, options, units))]
    if all(grid.separator in BLANKS for grid, _ in tries):
        tries = _nearly(found, options) or tries
    marked = [(grid, head) for grid, head in tries if grid.separator not in BLANKS]
    if any(head.known > 1 for _, head in marked):  # blanks are within headings
        tries = marked
    elif parted := [grid for grid in found if grid.separator not in BLANKS and number_rows(grid)]:
        tries = marked
        for line, what, remedy in filter(None, map(askew, parted)):
            raise InputError(what, remedy, file=file, line=line)
    tries = [(grid, head) for grid, head in tries if _is_filled(grid, head)] or tries
    if not tries and not read_bytes(file, "give another file").strip():
        raise InputError("the file is empty", "give one that holds readings below headings", file=file, line=1)
    if not tries:
        remedy = f"name the columns: --column 'NAME={example}', or by number: --column 1={example}"
        last = next((row for grid in found for row in reversed(grid.rows) if sum(map(is_number, row.cells)) > 1), None)
        if last:
            time, read, *_ = (place + 1 for place, cell in enumerate(last.cells) if is_number(cell))
            samples = option(str(time), TIME, "s"), option(str(read), "velocity_mm_s", "m/s")
            remedy = f"{remedy}; of samples over time {' '.join(samples)}"
        raise InputError("no column is recognised", remedy, file=file, line=1)
    return tries


def _nearly(found: Sequence[Grid], options: Options) -> list[tuple[Grid, Head]]:
    """Tables none of whose headings is known: those with units of conditions and readings, or words of their names."""
    units = [q.unit for q in QUANTITIES if q.role in ("condition", "reading")]
    heads = ((grid, find_head(grid, options, units, loosely=True)) for grid in found)
    return [(grid, head) for grid, head in heads if head and head.known > 1]


def _tables(file: Path, options: Options) -> list[list[tuple[Grid, Head]]]:
    """The tables of launches and traces of a file, each under the separators under which most is recognised."""
    tries = _heads(file, options, "frequency_hz:kHz")
    best = [(grid, head) for grid, head in tries if head.known == max(head.known for _, head in tries)]
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


def _recordings(file: Path, options: Options) -> list[tuple[Grid, Head, Chosen]]:
    """The recorded voltage of a file, under each separator; in a workbook it may stand next to other tables.

    Raises
    ------
    InputError
        Where there is none, or several sheets hold one.
    """
    found, faults = [], []
    units = [COLUMNS[name].unit for name in RECORDED]
    for grid, head in _heads(file, replace(options, sheets=()), "voltage_v:V", units):
        try:
            timed, headed, own = with_counts(grid, head, options, recording=True)
            found.append((timed, headed, choose_recording(timed, headed, own)))
        except InputError as fault:
            faults.append((head.known, fault))
    if not found:
        raise max(faults, key=itemgetter(0))[1]
    found = [one for one in found if one[0].sheet in options.sheets] or found
    if len(sheets := {grid.sheet for grid, *_ in found}) > 1:
        what = f"sheets {listed(sorted(sheets))} may hold the drive"
        raise InputError(what, "say which: --sheet NAME, or save that sheet in a file of its own", file=file)
    return found


def _is_filled(grid: Grid, head: Head) -> bool:
    """Whether blanks part rows as they part the headings; others part some row into no more cells than headings."""
    rows, n = (row.cells for row in grid.rows[head.first :]), len(head.headings)
    widths = (len(cells) for cells in rows if any(map(is_number, cells)))  # no comments, no footers
    return any(width == n if grid.separator in BLANKS else 0 < width <= n for width in widths)


def _of_sheet(grid: Grid, found: InputError) -> InputError:
    """What is wrong, with the sheet that its line belongs to."""
    if not grid.sheet:
        return found
    each = [
        InputError(f"sheet {shown(grid.sheet)}: {one.what}", one.remedy, file=one.file, line=one.line)
        for one in found.faults
    ]
    return InputErrors(each, found.more if isinstance(found, InputErrors) else 0) if len(each) > 1 else each[0]


def _readable(reads: Sequence[tuple[Grid, Callable[[], Read]]], content: Callable[[Read], Hashable]) -> Read:
    """What a file holds, read with the separator with which all of it can be read.

    Raises
    ------
    InputError
        Where there is none: what is wrong under the likeliest one; or several that differ in `content`.
    """
    found, faults = [], []
    for grid, read in reads:
        try:
            found.append((grid, read()))
        except InputError as fault:
            faults.append(_of_sheet(grid, fault))
    if not found:
        raise faults[0]
    if len({content(one) for _, one in found}) > 1:
        marks = " and ".join(SEPARATORS.get(grid.separator, "none") for grid, _ in found)
        raise InputError(f"can be read with {marks} as separators", "say which: --separator", file=found[0][0].file)
    return found[0][1]


def _content(table: Table) -> tuple[object, ...]:
    """What was read, to be compared."""
    arrays = [(g.drive, getattr(g, f.name)) for g in table.groups for f in fields(g)]
    return tuple((drive, array.tobytes()) for drive, array in arrays if isinstance(array, np.ndarray))


def _check_mappings(found: Sequence[tuple[Grid, Head]], options: Options) -> None:
    """Each mapping is about a column of some table."""
    faults = Faults()
    for mapping, (grid, head) in product(options.columns, found):
        if two := two_columns(mapping, head.headings):
            what = f"{shown(mapping.heading)} is the heading of column {two[0] + 1}, and the number of another"
            said = mapping.unit.said if mapping.unit else ""
            said += SUFFIXES[mapping.unit.volts] if mapping.unit and mapping.unit.volts else ""
            remedy = f"say {' or '.join(option(f'#{place + 1}', mapping.column, said) for place in two)}"
            faults.add(InputError(what, remedy, file=grid.file, line=head.line))
    for mapping in options.columns:
        if not any(names(mapping, head.headings) for _, head in found):
            known = list(dict.fromkeys(h.text for _, head in found for h in head.headings if h.text))
            remedy = did_you_mean(mapping.heading, known) if known else "give the number of a column, from 1"
            place = found[0][0].file if len({grid.file for grid, _ in found}) == 1 else None
            faults.add(InputError(f"there is no column {shown(mapping.heading)}", remedy, file=place))
    faults.end()


def _waveforms(found: Sequence[tuple[Grid, Head]], options: Options) -> list[str]:
    """The waveform of each table; empty where it is not given."""
    faults = Faults()
    given = options.waveforms
    if len(given) > 1 and len(given) != len(found):
        raise InputError(f"{len(given)} waveforms for {len(found)} tables", "give one, or one for each")
    _check_meant(options)
    shapes: list[str] = []
    used: list[str] = []
    for number, (grid, head) in enumerate(found):
        mapped = {place: m.column for m in options.columns for place in names(m, head.headings)}
        named = waveform_places(grid, head, options.meant)
        said = [p for p in named if p not in mapped] + [p for p, column in mapped.items() if column == WAVEFORM]
        aside = [p for p in named if p not in said and len(words_in(grid, head, p)) > 1]
        shape = "" if not given else given[0] if len(given) == 1 else given[number]
        if said and options.meant:
            shape = ""  # a name by itself is that of tables without such a column
        if options.drive and not said and not shape:
            shape = TABLE
        if shape and said:
            faults.add(_said_twice(grid, head, said[0]))
        elif shape and aside:
            faults.add(_said_twice(grid, head, aside[0], mapped[aside[0]]))
        used += [known for p in said for known in words_in(grid, head, p)]
        shapes.append(shape)
    for text, _ in options.meant if not options.drive else ():
        if word(text) not in used:
            remedy = did_you_mean(text, list(dict.fromkeys(used))) if used else "say --column HEADING=waveform"
            faults.add(InputError(f"no row has the waveform {shown(text)}", remedy))
    faults.end()
    return shapes


def _check_meant(options: Options) -> None:
    """No word means two waveforms, and each is one that psafit knows."""
    meant = [word(text) for text, _ in options.meant]
    if twice := [text for text, _ in options.meant if meant.count(word(text)) > 1]:
        raise InputError(f"--waveform says twice what {shown(twice[0])} means", "say it once")
    given = (*options.waveforms, *(name for _, name in options.meant))
    for name in (name for name in given if name != TABLE):
        try:
            known_waveform(name, options)
        except CellFault as fault:
            raise InputError(f"--waveform {fault.what}", fault.remedy) from fault


def _said_twice(grid: Grid, head: Head, place: int, aside: str = "") -> InputError:
    """A waveform is given, and a column has others; `aside` is what that column is said to be instead."""
    heading, there = head.headings[place].text, words_in(grid, head, place)
    column = heading or str(place + 1)
    what = f"a column gives the waveform, {shown(heading)}" if heading else "a column gives the waveform"
    unlike = ",".join(f"{known}={raised}" for known in there if (raised := from_zero(known)))
    remedy = f"leave out {option(column, aside)}" if aside else "leave out --waveform"
    if unlike:
        remedy += f"{', and' if aside else ', or'} say what its words mean, such as --waveform {unlike}"
    if len(there) == 1:
        remedy += f", or {option(column, IGNORED)}"
    return InputError(what, remedy, file=grid.file, line=head.line)


def _understood(grid: Grid, head: Head, options: Options, waveform: str, first_id: int, examples: int) -> Table:
    """A table, read to its last cell."""
    grid, head, options = with_counts(grid, head, options)
    chosen = choose(grid, head, options)
    if chosen.traced:
        check_trigger(grid, head, options)
    shape = _shape(grid, head, chosen, waveform, options)
    check_above(grid, head, chosen, shape, options)
    rows = body(grid, head, [c.place for c in chosen.columns], options)
    check_order(grid, chosen.columns, rows.rows)
    read, decimal = readings(grid, head, chosen, rows, options, shape)
    if chosen.traced:
        check_origin(grid, head, chosen, read, options)
    sampled = from_start(grid, read, options) if chosen.traced else None
    found = [r for t in sampled.traces for r in t.samples] if sampled else read
    columns = _columns(chosen, options, sampled.zeros if sampled else {})
    table = _table(grid, head, chosen, rows, decimal, columns, options)
    lines = {line: (line, text, remedy) for line, text, remedy in unread(grid, head, chosen, shape)}
    lines |= {line: (line, text, remedy) for line, text, remedy in table.above}
    table = replace(table, above=tuple(lines[line] for line in sorted(lines)))
    table = _with_rows(table, grid, rows, chosen, found, sampled.before if sampled else (), examples)
    if sampled:
        return replace(table, groups=tuple(trace_of(k, trace) for k, trace in enumerate(sampled.traces, first_id)))
    parts = groups_of(read)
    groups = (_group(k, part) for k, part in enumerate(parts, first_id))
    return replace(table, groups=tuple(groups), labels=tuple(part[0].group for part in parts))


def _drive(grid: Grid, head: Head, chosen: Chosen, options: Options, examples: int) -> tuple[Drive, Drive, Table]:
    """The drive in a file of its own, as it is kept and with each sample, and that file as it was understood."""
    check_trigger(grid, head, options)
    read = recorded(grid, head, chosen, options)
    check_origin(grid, head, chosen, read.samples, options)
    start, unset = options.start_us or 0.0, replace(options, values=(), drive=None)
    columns = _columns(chosen, unset, {TIME: start})
    table = _table(grid, head, chosen, read.body, read.decimal, columns, unset)
    after = [r for r in read.samples if dict(r.values)[TIME] >= 0.0]
    before = {r.line for r in read.samples} - {r.line for r in after}
    return read.drive, read.whole, _with_rows(table, grid, read.body, chosen, after, before, examples)


def _table(
    grid: Grid, head: Head, chosen: Chosen, rows: Body, decimal: str, columns: Sequence[Understood], options: Options
) -> Table:
    """A table as it was understood, but for its first rows and groups."""
    return Table(
        file=grid.file,
        sheet=grid.sheet,
        encoding=grid.encoding,
        separator=grid.separator,
        decimal="" if grid.sheet else decimal,
        header_line=head.line,
        columns=tuple(columns),
        examples=(),
        unused=tuple(c.title for c in chosen.unused if c.heading.text),
        labelled=tuple(_labelled(chosen, rows.rows)),
        errors=tuple(_errors(chosen, head)),
        possible=tuple(_possible(chosen, head)),
        not_yet=tuple((c.title, c.column) for c in chosen.not_yet),
        above=(*above(grid, head, chosen, options), *unread_origin(grid, head, chosen, options)),
        left_out=rows.left_out,
        groups=(),
    )


def _with_rows(
    table: Table,
    grid: Grid,
    rows: Body,
    chosen: Chosen,
    found: Sequence[Reading],
    before: Iterable[int],
    examples: int,
) -> Table:
    """A table with the first rows of what was found, and the lines of samples before the start."""
    order = list(COLUMNS)
    cells = {row.line: row.texts[: grid.counts] for row in rows.rows}
    first = list(dict.fromkeys(r.line for r in found[: 100 * examples]))[:examples]
    own = [c.column for c in chosen.columns if c.column in SETTINGS]
    shown_rows = (Example(line, cells[line], tuple(_values(found, line, own, order))) for line in first)
    early = ((line, " ".join(filter(None, cells[line]))) for line in sorted(before))
    return replace(table, examples=tuple(shown_rows), left_out=(*table.left_out, *early))


def _labelled(chosen: Chosen, rows: Sequence[Row], least: int = 2) -> Iterator[tuple[str, int]]:
    """Columns that are not used and hold a label for each block of rows, so many on average, and their labels' number.

    None where the rows are in groups by a column, or are samples.
    """
    for column in () if chosen.traced or chosen.of(GROUPS) else chosen.unused:
        labels = [row.texts[column.place] if column.place < len(row.texts) else "" for row in rows]
        blocks = [label for label, _ in groupby(labels)]
        in_blocks = len(blocks) == len(set(blocks)) > 1 and all(blocks) and least * len(blocks) <= len(labels)
        if in_blocks and column.heading.text and not column.mapped:
            yield column.option, len(blocks)


def _errors(chosen: Chosen, head: Head) -> Iterator[tuple[str, str]]:
    """Columns that are not used and may hold the known error of the one kind of reading in their unit."""
    missing = {of: name for name, of in ERROR_OF.items() if chosen.of(of) and not chosen.of(name)}
    for column in (c for c in chosen.unused if c.heading.spreads and not (c.mapped or c.heading.at)):
        said = head.unit(column.place)
        could = [of for of in missing if said is None or said.kind == COLUMNS[of].unit]
        if len(could) == 1:
            unit = "" if said else next((f":{c.unit.text}" for c in chosen.of(could[0]) if c.unit), "")
            yield column.option, f"{missing[could[0]]}{unit}"


def _possible(chosen: Chosen, head: Head) -> Iterator[tuple[str, str]]:
    """Columns that are not used and stand in the unit of an observable of launches that no column holds."""
    missing = {COLUMNS[o.column].unit: o.column for o in OF_LAUNCHES if not chosen.of(o.column)}
    for column in () if chosen.traced else chosen.unused:
        said = head.unit(column.place)
        if said and said.kind in missing and not (column.heading.spreads or column.mapped or column.heading.at):
            yield column.option, missing[said.kind]


def _shape(grid: Grid, head: Head, chosen: Chosen, given: str, options: Options) -> str:
    """The waveform of a table's rows; empty where a column says it.

    Raises
    ------
    InputError
        Where nothing says it, or a recorded drive is said to be another.
    """
    recorded, column = chosen.of(VOLTAGE), chosen.of(WAVEFORM)
    line = head.line or 1
    if recorded and (column or given not in ("", TABLE)):
        said = f"column {column[0].name}" if column else f"--waveform {given}"
        what = f"column {recorded[0].name} is the recorded drive, and {said} gives it a waveform"
        remedy = f"say --waveform {TABLE} for this table" if not column else f"say {option(column[0].option, IGNORED)}"
        remedy = f"{remedy}, or {option(recorded[0].option, IGNORED)} to leave out the recording"
        raise InputError(what, remedy, file=grid.file, line=line)
    if given == TABLE and not recorded and not options.drive:
        what, remedy = "no column is a recorded drive", f"say --drive FILE, or of a trace {option('CH1', VOLTAGE, 'V')}"
        raise InputError(what, remedy, file=grid.file, line=line)
    for c in chosen.columns if column or given not in ("", TABLE) else ():
        if c.column in COLUMNS and (said := named_waveform(c.heading)) and said != given:
            other = f"the waveform is {given}" if given else f"column {column[0].name} gives waveforms"
            what = f"column {c.name} is of a {said} by its heading, and {other}"
            alone = "" if given else f"{option(column[0].option, IGNORED)} "
            remedy = f"say {alone}--waveform {said}, or {option(c.option, IGNORED)}"
            raise InputError(what, f"{remedy}, and give each waveform a file of its own", file=grid.file, line=line)
    if not (recorded or column or given):
        used = {c.place for c in chosen.columns}
        in_words = {place: texts for place, texts in columns_in_words(grid, head).items() if place not in used}
        if few := {head.headings[k].text: texts for k, texts in in_words.items() if len(texts) <= len(NAMES)}:
            what = f"nothing says which waveform of the drive; {listed(map(shown, few))} may"
            each = shlex.quote(f"{next(iter(few.values()))[0]}=NAME")
            remedy = f"say what each word means, --waveform {each}, or --waveform NAME, of {listed(NAMES)}"
            raise InputError(what, remedy, file=grid.file, line=head.line)
        remedy = f"say --waveform NAME, of {listed(NAMES)}; of several tables --waveform sine,square"
        if chosen.traced:
            remedy = f"{remedy}; of a drive that was recorded {option('NAME', VOLTAGE, 'V')}"
        raise InputError("nothing says which waveform of the drive", remedy, file=grid.file)
    return TABLE if recorded else given


def _columns(chosen: Chosen, options: Options, zeros: dict[str, float]) -> list[Understood]:
    """How psafit's columns came from those of the file, in psafit's order."""
    held = [*chosen.held(options), *chosen.settings(options)]
    columns = [
        Understood(
            name, (), COLUMNS[name].unit, 1.0, (options.counted or (None,))[0] if name == "amplitude_v" else None
        )
        for name in held
    ]
    for name in CONDITION_COLUMNS:
        named = [c for c in chosen.columns if any(a.column == name for a in c.at)]
        ways = {a.volts or options.volts for c in named for a in c.at if a.column == name == "amplitude_v"}
        volts = ways.pop() if len(ways) == 1 else None
        columns += [Understood(name, tuple(c.title for c in named), COLUMNS[name].unit, 1.0, volts)] if named else []
    for name in dict.fromkeys(c.column for c in chosen.columns if c.column in COLUMNS):
        same = chosen.of(name)
        units = {c.unit.said: c.unit.factor(COLUMNS[name].unit) for c in same if c.unit}
        factor = float(next(iter(units.values())) or 1) if len(units) == 1 else 1.0
        zero = zeros.get(name, 0.0)
        columns.append(Understood(name, tuple(c.title for c in same), ", ".join(units), factor, same[0].volts, zero))
    order = list(COLUMNS)
    return sorted(columns, key=lambda c: order.index(c.column))


def _values(
    found: Sequence[Reading], line: int, own: Sequence[str], order: Sequence[str]
) -> Iterator[tuple[tuple[str, float], ...]]:
    """What was read in a line, with voltages of the drive that stand in it, each in the order of psafit's columns."""
    for reading in (r for r in found if r.line == line):
        values = (*reading.values, *((name, getattr(reading.drive, name)) for name in own))
        yield tuple(sorted(values, key=lambda pair: order.index(pair[0])))


def _group(number: int, part: Sequence[Reading]) -> Group:
    """Readings as a group of its own."""
    names = dict.fromkeys(name for reading in part for name, _ in reading.values)
    columns = {name: np.array([dict(reading.values).get(name, np.nan) for reading in part]) for name in names}
    return Group(number, part[0].drive, file_of(number), session=part[0].session, **readings_of(columns))

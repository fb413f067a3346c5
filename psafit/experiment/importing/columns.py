"""Which column of a table is which of psafit's: recognised by name and unit, or as the user says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from psafit.errors import Faults
from psafit.experiment.drive_table import RECORDED
from psafit.experiment.importing.chosen import (
    AS_IT_STANDS,
    ERROR_OF,
    EXAMPLES,
    READ,
    SIGNALS,
    VOLTAGE,
    WAVEFORM,
    Chosen,
    Column,
    all_headings,
    cells,
    example,
    fault,
    in_volts,
    nearest,
    nearly,
    option,
    role,
)
from psafit.experiment.importing.grid import Grid
from psafit.experiment.importing.layout import Head, labels_above, names, waveform_places
from psafit.experiment.importing.matters import check_matters
from psafit.experiment.importing.numerals import count_on, counts_rows, is_number, likeliest, whole
from psafit.experiment.importing.over_time import (
    as_drive,
    check_launches,
    check_trace,
    is_trace,
    missing_conditions,
    voltages,
)
from psafit.experiment.importing.quantities import (
    CHANNELS,
    COLUMNS,
    COUNT,
    DRIVING,
    GENERIC,
    LEVELS,
    MEANS,
    NEUTRAL,
    QUANTITIES,
    SUFFIXES,
    SUMMARIES,
    VOLTS,
    Quantity,
    Volts,
    words,
)
from psafit.experiment.importing.records import IGNORED, LABELS, Options
from psafit.experiment.importing.units import Unit, conversion, factor_of, related
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.text import listed, shown
from psafit.experiment.trace_table import TIME

_TABLES = {False: "launches", True: "a trace"}


def choose(grid: Grid, head: Head, options: Options) -> Chosen:
    """Say what each column holds.

    Raises
    ------
    InputError
        Where something needed is missing, or could be one of several: a line each, with the option that says it.
    """
    faults = Faults()
    mapped = _mapped(grid, head, options, faults)
    traced = is_trace(grid, head, mapped, options, faults)
    found = _recognised(head, mapped, waveform_places(grid, head, options.meant), traced=traced)
    if traced and not len(faults):
        found = voltages(grid, head, found, options, faults)
    if not len(faults):
        _check_unnamed(grid, head, found, faults)
    faults.end()
    said = {c.column for c in found if c.mapped}
    own = [c for c in found if c.column == VOLTAGE] if traced and options.drive_file else []
    for c in (c for c in own if not c.mapped):
        what = f"column {c.name} is the drive over time, and --drive gives another"
        remedy = f"say {as_drive(c, plain=True)} if it is that of this trace, or {option(c.option, IGNORED)}"
        faults.add(fault(grid, head, what, remedy))
    faults.end()
    given = (VOLTAGE,) if options.drive_file and not own else ()  # in a file of its own
    used = [c for c in found if c.column not in ("", IGNORED, *given) and (c.mapped or c.column not in said)]
    roles = ("condition", "time", "trace", "recording") if traced else ("condition", "reading", "error")
    roles = (*roles, "drive")
    usable = {q.column for q in QUANTITIES if q.usable} | {WAVEFORM, *LABELS}
    kept = [c for c in used if c.column in usable and role(c.column) in (*roles, "")]
    not_yet = [c for c in used if c.column not in usable]
    for c in (c for c in used if c.mapped and c not in kept and c not in not_yet):
        what = f"column {c.name} is said to be {c.column}, and the table is one of {_TABLES[traced]}"
        faults.add(fault(grid, head, what, f"leave that out, or say {option(c.option, IGNORED)}"))
    unused = [c for c in found if c not in kept and c not in not_yet]
    chosen = Chosen(tuple(kept), tuple(unused), tuple(not_yet), traced)
    if chosen.recorded(options):
        chosen = _without_settings(grid, head, chosen, faults)
    if not traced:
        _check_motion(grid, head, chosen, options, faults)
        check_launches(grid, head, chosen, options, faults)
        faults.end()
    _check_one_table(grid, head, chosen, faults)
    faults.end()
    for column in dict.fromkeys(c.column for c in chosen.columns if c.column not in ERROR_OF):
        _check_several(grid, head, chosen.of(column), options, faults)
    _check_errors(grid, head, chosen, faults)
    _check_numbers(grid, head, chosen, faults)
    _check_unread(grid, head, chosen, faults)
    _check_ends(grid, head, chosen, options, faults)
    check_matters(grid, head, chosen, options, faults)
    _check_bare(grid, head, chosen, faults)
    faults.end()
    (check_trace if traced else _check_missing)(grid, head, chosen, options, faults)
    faults.end()
    counted = [_with_unit(grid, head, c, options, faults) for c in chosen.columns]
    faults.end()
    return replace(chosen, columns=tuple(counted))


def choose_recording(grid: Grid, head: Head, options: Options) -> Chosen:
    """Say which columns hold the time and the voltage of a drive in a file of its own.

    A column is one as the user says, by its name, or by its unit, whichever comes first.

    Raises
    ------
    InputError
        Where one is missing, or could be one of several: a line each, with the option that says it.
    """
    faults, found = Faults(), []
    mapped = _mapped(grid, head, options, faults)
    for name in RECORDED:
        could = [c for c in mapped.values() if c.column == name] or _recording(head, mapped, name)
        if could:
            _check_several(grid, head, could, options, faults)
            if len(could) == 1:
                _check_plain(grid, head, could[0], faults)
            found.append(could[0])
        else:
            remedy = f"say {option('NAME', name, COLUMNS[name].unit)}"
            faults.add(fault(grid, head, f"no {name} of the drive among {all_headings(head)}", remedy))
    faults.end()
    columns = tuple(_with_unit(grid, head, c, options, faults) for c in found)
    faults.end()
    used = {c.place for c in columns}
    unused = (mapped.get(k, Column(k, h, "")) for k, h in enumerate(head.headings) if k not in used)
    return Chosen(columns, tuple(unused), (), traced=True)


def _recording(head: Head, mapped: Mapping[int, Column], name: str) -> list[Column]:
    """The columns that may be time or voltage of a drive: by name, else by unit; a bias or an idle voltage is none."""
    others = [
        Column(k, h, name)
        for k, h in enumerate(head.headings)
        if k not in mapped and not any(q.role == "drive" for q in h.quantities(head.units[k]))
    ]
    of_unit = [c for c in others if (u := head.unit(c.place)) and u.kind == COLUMNS[name].unit]
    if name == VOLTAGE and (drives := [c for c in of_unit if not DRIVING.isdisjoint(c.heading.name.split())]):
        plain = [c for c in drives if c.heading.drives]
        return drives if any(c.heading.altered for c in drives) else plain or of_unit
    return [c for c in others if COLUMNS[name] in c.heading.quantities(head.units[c.place])] or of_unit


def _check_plain(grid: Grid, head: Head, column: Column, faults: Faults) -> None:
    """A column whose heading says more than words, such as a factor or a sign, is the time or the drive if so said."""
    if column.mapped or not column.heading.altered:
        return
    what = f"column {column.name} may be {column.column} of the drive, or something made of that"
    remedy = f"say {option(column.option, column.column)}, {AS_IT_STANDS}"
    if column.column == VOLTAGE:
        plain = as_drive(column, plain=True)
        remedy = f"say {as_drive(column, plain=False)} or {plain}, {AS_IT_STANDS}"
    faults.add(fault(grid, head, what, remedy))


def _mapped(grid: Grid, head: Head, options: Options, faults: Faults) -> dict[int, Column]:
    """The columns of which the user says what they are, by their places."""
    mapped: dict[int, Column] = {}
    for mapping in options.columns:
        places = names(mapping, head.headings)
        if mapping.table and not places:
            what = f"there is no column {shown(mapping.heading)} among {all_headings(head)}"
            faults.add(fault(grid, head, what, "leave blank what --column says of this table"))
        single = mapping.column in (*CONDITION_COLUMNS, TIME, VOLTAGE, WAVEFORM, *LABELS)
        if len(places) > 1 and single:
            what = f"{len(places)} columns are called {shown(mapping.heading)}"
            faults.add(fault(grid, head, what, f"give the number of one: {option('2', mapping.column)}"))
        for place in places:
            if place in mapped:
                what = f"column {mapped[place].name} is named twice"
                faults.add(fault(grid, head, what, "give --column once for each column"))
            said = mapping.unit
            mapped[place] = Column(
                place, head.headings[place], mapping.column, said, said.volts if said else None, mapped=True
            )
    return mapped


def _recognised(head: Head, mapped: dict[int, Column], shaped: Sequence[int], *, traced: bool) -> list[Column]:
    """Each column with what it is: empty for unknown, or `"ignore"`."""
    other = ("reading", "error") if traced else ("trace",)
    could = [[q for q in h.over_time(u) if q.role not in other] for h, u in zip(head.headings, head.units, strict=True)]
    sure = {some[0].column for some in could if len(some) == 1} | {c.column for c in mapped.values()}
    found = []
    for place, heading in enumerate(head.headings):
        if place in mapped:
            found.append(mapped[place])
        elif place in shaped:
            found.append(Column(place, heading, WAVEFORM))
        else:
            of_these = [q for q in could[place] if ERROR_OF.get(q.column, q.column) in sure or q.role != "error"]
            if len(of_these) == 1 and not heading.quantities(head.units[place]):
                heading = heading.without_conditions
            found.append(Column(place, heading, of_these[0].column if len(of_these) == 1 else ""))
    return found


def _check_unnamed(grid: Grid, head: Head, found: Sequence[Column], faults: Faults) -> None:
    """Columns of numbers without a name are no readings that may be left out, unless one numbers the rows."""
    unnamed: list[list[Column]] = []
    for column in found if head.line else ():
        filled = cells(grid, head, column.place)
        named = column.column or (column.heading.text and not column.heading.is_ordinal)
        if named or column.mapped or not any(map(is_number, filled)):
            continue
        if column.place == 0 and counts_rows(whole([str(cell) for cell in filled])):
            continue
        if not (unnamed and column.place == unnamed[-1][-1].place + 1):
            unnamed.append([])
        unnamed[-1].append(column)
    for run in unnamed:
        numbers = [str(column.place + 1) for column in run]
        what, remedy = f"column {numbers[0]} holds numbers and has no heading that says what", "give it one"
        if len(run) > 1:
            what = f"columns {listed(numbers)} hold numbers and have no headings that say what"
            remedy = "give each one"
        before = found[run[0].place - 1] if run[0].place else None
        if before and role(before.column) in READ:  # a heading over several columns, as a merged cell leaves it
            said = unit.text if (unit := head.unit(before.place)) else ""
            each = " ".join(option(str(c.place + 1), before.column, said) for c in (before, *run))
            remedy = f"{remedy}, say {each} if they repeat {before.name}"
        ignored = " ".join(option(number, IGNORED) for number in numbers)
        faults.add(fault(grid, head, what, f"{remedy}, or say {ignored}"))


def _without_settings(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> Chosen:
    """A table whose drive was recorded: columns of a bias and the like are not used, and must be zero."""
    columns = [c for c in chosen.columns if role(c.column) == "drive"]
    for column in columns:
        numbers = [likeliest([cell]).number(cell) for cell in cells(grid, head, column.place)]
        if any(n is not None and n.value != 0 for n in numbers):
            what = f"column {column.name} holds {column.column}, and the drive is a recording, taken as it is"
            remedy = f"say {option(column.option, IGNORED)} if the recording has it in it"
            faults.add(fault(grid, head, what, remedy))
    kept = tuple(c for c in chosen.columns if c not in columns)
    return replace(chosen, columns=kept, unused=(*chosen.unused, *columns))


def _check_several(grid: Grid, head: Head, columns: Sequence[Column], options: Options, faults: Faults) -> None:
    """Several columns of one quantity are repetitions, if they are readings and numbered; else it is asked."""
    first = columns[0]
    if len({bool(c.at) for c in columns}) > 1:  # what is missing in a heading is said elsewhere
        return
    read, one_name = role(first.column) in READ, len({c.heading.text for c in columns}) == 1
    above = labels_above(grid, head, [c.place for c in columns]) if read and not first.at else []
    numbers = bool(above) and not any(label.strip("0123456789.,") for label in above)
    labels = above if one_name or all(is_number(label) or not label for label in above) else []
    settled = not numbers and _each_mapped(head, columns, options) if labels else first.mapped or _repeated(columns)
    if len(columns) == 1 or (read and settled):
        return
    what = f"columns {listed(c.name for c in columns)} could all be {first.column}"
    if not read and first.column != TIME and _in_blocks(head, [c.place for c in columns]):
        remedy = "save each as a file of its own, or ignore the columns of all but one"
        faults.add(fault(grid, head, f"{what}, each of a table next to the others", remedy))
        return
    last = columns[-1].option
    if read:
        what = f"{what}, and {listed(shown(label) for label in labels if label)} above part them" if labels else what
        last = str(columns[-1].place + 1) if columns[-1].heading.repeats else last
    remedy = f"say which: {option(last, first.column)}{'; of repetitions each' if read else ''}"
    if numbers:
        remedy = "write what these are into the headings, such as Range at 5 Vpp (um); put # before them if they are no"
        remedy = f"{remedy} conditions"
    remedy = f"{remedy}, if that alone is the voltage at the stack" if first.column == VOLTAGE else remedy
    apart = (
        "if each is of a trace of its own, save each with its trace in a file; else " if first.column == TIME else ""
    )
    faults.add(fault(grid, head, what, f"{apart}{remedy}"))


def _in_blocks(head: Head, places: Sequence[int]) -> bool:
    """Whether a column in the unit of a reading stands behind each of these, as in tables next to one another."""
    kinds, units = {q.unit for q in QUANTITIES if q.role in READ}, list(map(head.unit, range(len(head.headings))))
    ends = zip(places, [*places[1:], len(units)], strict=True)
    return all(any(unit and unit.kind in kinds for unit in units[begin:end]) for begin, end in ends)


def _each_mapped(head: Head, columns: Sequence[Column], options: Options) -> bool:
    """Whether the user names each of these columns by itself."""
    alone = {places[0] for m in options.columns if len(places := names(m, head.headings)) == 1}
    return alone.issuperset(c.place for c in columns)


def _check_errors(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> None:
    """A known error counts for all readings of a row, or each reading has one of its number and its condition."""
    for name in (name for name in ERROR_OF if chosen.of(name) and chosen.readings):
        errors, read = chosen.of(name), chosen.of(ERROR_OF[name])
        which, of_read = ([(c.heading.number, c.heading.at) for c in same] for same in (errors, read))
        plain = all(same == (None, ()) for same in which)
        if (
            which == of_read
            or (read and plain and len(which) in (1, len(read)))
            or (len(which) == len(read) == 1 and not which[0][1])
        ):
            continue
        are = f"column {errors[0].name} is" if len(errors) == 1 else f"columns {listed(c.name for c in errors)} are"
        what, remedy = f"{are} {name}, and none is {ERROR_OF[name]}", ""
        if read:
            what = f"{are} {name} of some readings, and would count for others"
            remedy = (
                f", or give {listed(c.name for c in read)} one each, with its number or condition, in the same order"
            )
        ignored = " ".join(dict.fromkeys(option(c.option, IGNORED) for c in errors))
        faults.add(fault(grid, head, what, f"say {ignored}{remedy}"))


def _check_numbers(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> None:
    """Columns that the user names may differ by conditions among words that psafit does not know, or without words."""
    read = [c for c in chosen.columns if role(c.column) in READ]
    unread = [c for c in read if c.heading.at != c.at]
    bare = [c for c in read if is_number(c.heading.text) and not c.at]
    if len({c.heading.at for c in unread}) < 2 and not count_on(whole([c.heading.text for c in bare])):
        unread = bare
    if len({c.heading.at or c.heading.text for c in unread}) > 1:
        what = f"{listed(c.name for c in unread)} name numbers that may be conditions, or something else"
        remedy = f"write conditions as in Range 1.2 kHz 40 Vpp (um), or say {option(unread[-1].option, IGNORED)}"
        remedy = f"{remedy}; of repetitions number them from 1" if unread is bare else remedy
        faults.add(fault(grid, head, what, remedy))


def _check_one_table(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> None:
    """Headings of a condition or a time that come again with others are those of another table, next to the first."""
    first = {c.heading.text: c.place for c in reversed(chosen.columns) if c.heading.text}
    again = [c for c in (*chosen.columns, *chosen.unused) if c.place > first.get(c.heading.text, c.place)]
    twice = {c.column for c in chosen.columns if c.heading.text in {a.heading.text for a in again}}
    if len(twice) < 2 or twice.isdisjoint((*CONDITION_COLUMNS, TIME)) or all(a.column == IGNORED for a in again):
        return
    at = min(again, key=lambda c: c.place)
    what = f"headings come again from column {at.place + 1} on, {at.name}: another table next to the first"
    others = (option(str(c.place + 1), IGNORED) for c in sorted(again, key=lambda c: c.place))
    faults.add(fault(grid, head, what, f"save each as a file of its own, or say {' '.join(others)}"))


def _repeated(columns: Sequence[Column]) -> bool:
    """Whether columns have one name, or one but for numbers from 0 or 1 that are of no part of the rig."""
    same_name = len({c.heading.name for c in columns}) == 1
    same = len({c.heading.text for c in columns}) == 1
    if all(c.at for c in columns) and len({(c.heading.bare, c.at) for c in columns}) == len(columns):
        return same_name
    first, *more = sorted(columns, key=lambda c: c.heading.number or 0)
    if {c.heading.text for c in more} in ({f"{first.heading.text}{s}{k + 1}" for k in range(len(more))} for s in "._"):
        return True
    numbers = sorted(-1 if c.heading.number is None else c.heading.number for c in columns)
    same_name = same_name and not any(c.heading.numbers_a_part for c in columns)
    return same_name and (same or numbers in ([k + first for k in range(len(columns))] for first in (0, 1)))


def _check_motion(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """What has a time, and no frequency and no reading, is a trace of which no column is known to be the motion."""
    times = [c for c in chosen.unused if c.column == TIME]
    if times and not chosen.readings and not chosen.of("frequency_hz"):
        looks = f"column {times[0].name} looks like a trace over time, but none is a motion"
        lacking = "motion" if "frequency_hz" in options.held else "frequency_hz"
        what = f"no {lacking} among {all_headings(head)}: {looks}"
        moving = {q: [c for c in chosen.unused if nearly(c, head, q)] for q in QUANTITIES if q.role == "trace"}
        near = [(c, q) for q, columns in moving.items() for c in columns]
        others = (c for c in (*chosen.unused, *chosen.of("amplitude_v")) if not c.heading.of_tip)
        volts = [c.option for c in others if in_volts(c, head)]
        if chosen.not_yet:
            what = f"{what} that psafit reads: {_not_yet(chosen)}"
            remedy = "give the tip's displacement, or a motion of the ball"
        elif near:
            remedy = "say " + " or ".join(
                f"{option(c.option, q.column)} if it is that of the {q.part}" for c, q in near
            )
            if any(q.column == "displacement_um" for _, q in near):
                remedy += " (that of the tip is tip_displacement_um)"
        elif volts:
            scale = option(volts[-1], "velocity_mm_s", "5mm/s/V")
            remedy = f"say what one volt is, such as {scale} or 2um/V, of displacement_um"
        else:
            scale = option("NAME", "velocity_mm_s", "5mm/s/V")
            remedy = f"say {option('NAME', 'displacement_um', 'um')}, or of a sensor's volts what one is, {scale}"
            remedy = f"{remedy}; psafit reads no acceleration: integrate it"
        faults.add(fault(grid, head, what, remedy))


def _not_yet(chosen: Chosen) -> str:
    """What psafit knows and cannot use."""
    return listed(f"{c.column} ({c.name})" for c in chosen.not_yet)


def _check_ends(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """The ends of a drive say where its middle is, which an amplitude does not."""
    named = [c for c in chosen.unused if not c.mapped and any(c.heading.name in called for called in LEVELS)]
    ends = [c for c in named if in_volts(c, head) or head.unit(c.place) is None]
    given = "amplitude_v" in options.held or chosen.of("amplitude_v")
    if ends and given and not (chosen.of("bias_v") or "bias_v" in options.held):
        are = "is an end" if len(ends) == 1 else "are the ends"
        what = f"{listed(c.name for c in ends)} {are} of the drive, whose middle no column gives"
        ignored = " ".join(option(c.option, IGNORED) for c in ends)
        faults.add(fault(grid, head, what, f"give it as bias_v, or say {ignored}, if it is 0 or the waveform's own"))


def _check_bare(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> None:
    """Headings that name a condition say what was read there, too."""
    bare = [c for c in chosen.unused if c.heading.at and not c.mapped and not words(c.heading.bare)]
    if bare and not chosen.readings:
        name = bare[0].heading.text
        what = (
            f"{listed(c.name for c in bare)} {'name conditions' if len(bare) > 1 else 'names a condition'}, and nothing"
        )
        remedy = f"write it into each heading, such as Range at {name} (um)"
        faults.add(fault(grid, head, f"{what} what was read there", remedy))


def _check_missing(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    known = all_headings(head)
    for column in missing_conditions(grid, head, chosen, options, faults):
        sound = [c for c in chosen.unused if not c.mapped and _sounds(grid, head, c, COLUMNS[column])]
        ends = [[c for c in chosen.unused if not c.mapped and c.heading.name in called] for called in LEVELS]
        upper = ends[0] if column == "amplitude_v" and not ends[1] else []
        near = nearest(chosen.unused, head, column) or next((c[0] for c in (sound, upper) if len(c) == 1), None)
        other = _in_other_unit(chosen, head, column)
        what, remedy = "", f"say {_called(near, head, column)}{f', {AS_IT_STANDS}' if near else ''}"
        if other:
            what, remedy = other
        if column == "amplitude_v" and all(ends):
            what = f", and {' and '.join(of[0].name for of in ends)} are the ends of the drive"
            remedy = "give amplitude_v (Vp), half of their difference, and bias_v, their mean"
            remedy = f"{remedy}; of a unipolar waveform the upper one is amplitude_v"
        remedy = f"{remedy}, or --set {example(column)} if held"
        faults.add(fault(grid, head, f"no {column} among {known}{what}", remedy))
    if not chosen.readings:
        _check_readings(grid, head, chosen, options, faults)


def _check_readings(grid: Grid, head: Head, chosen: Chosen, options: Options, faults: Faults) -> None:
    """Say which columns may be the readings of a table without any: by their units, else by their names."""
    readings = [q for q in QUANTITIES if q.role == "reading"]
    others = [c for c in chosen.unused if c.column != TIME and not (c.mapped or c.heading.spreads)]
    known = all_headings(head)
    what = f"no launch_range_um nor another reading among {known}"
    if not chosen.not_yet and (
        other := next(filter(None, (_in_other_unit(chosen, head, q.column) for q in readings)), None)
    ):
        faults.add(fault(grid, head, f"{what}{other[0]}", other[1]))
        return
    near = _each([(c, q) for q in readings for c in others if nearly(c, head, q)])
    named = _each([(c, q) for q in readings for c in others if _sounds(grid, head, c, q)])
    volts = [c.option for c in others if in_volts(c, head)]
    said = near or named or [option("NAME", "launch_range_um")]
    remedy = f"say {'of each that was read ' if len(said) > 1 else ''}{' '.join(said)}"
    remedy = f"{remedy}, with the unit behind a colon" if named and not near else remedy
    remedy = f"{remedy}, {AS_IT_STANDS}" if near or named else remedy
    if any(not MEANS.isdisjoint(c.heading.name.split()) for c in others):
        remedy = f"{remedy}; a mean counts as one reading: better give each that it is of"
    if not near and not named:
        remedy = f"{remedy}, or as one of {listed(name for name in ERROR_OF.values() if name != 'launch_range_um')}"
        scale = option(volts[0] if volts else "NAME", "launch_speed_mm_s", "5mm/s/V")
        remedy = f"{remedy}; a sensor's volts with their scale, {scale}"
    if any(c.column == TIME for c in chosen.unused):
        remedy = f"{remedy}; of traces, sort the rows by trace and time: each has {options.least_samples} or more"
    if chosen.not_yet:
        what = f"{what}, but {_not_yet(chosen)}"
        remedy = "psafit cannot use that yet: give a file with launch ranges; it is no launch range"
    faults.add(fault(grid, head, what, remedy))


def _each(found: Sequence[tuple[Column, Quantity]]) -> list[str]:
    """An option for each column that may be a reading; one or another where several of one quantity are no repetitions.

    A mean and its extremes, or a range and its half, are not read one after the other.
    """
    several: dict[str, list[Column]] = {}
    for column, quantity in found:
        several.setdefault(quantity.column, []).append(column)
    return [
        (" " if _repeated(columns) else " or ").join(option(c.option, name) for c in columns)
        for name, columns in several.items()
    ]


def _sounds(grid: Grid, head: Head, column: Column, quantity: Quantity) -> bool:
    """Whether a column of numbers without a unit has a word in its heading that no other quantity's names have."""
    filled = cells(grid, head, column.place)
    in_numbers = bool(filled) and all(map(is_number, filled)) and head.unit(column.place) is None
    return in_numbers and column.heading.sounds(quantity)


def _called(near: Column | None, head: Head, column: str) -> str:
    """The option that makes the nearest column a condition; of volts that are not counted with each way to count."""
    if near is None:
        units = {h.text or str(place + 1): head.unit(place) for place, h in enumerate(head.headings)}
        of_kind = [text for text, unit in units.items() if unit and unit.kind == COLUMNS[column].unit]
        several = [option(text, column) for text in of_kind] if column == "frequency_hz" else []
        return " or ".join(several) or option("NAME", column, EXAMPLES[column][0])
    unit = head.unit(near.place)
    upper = near.heading.name in LEVELS[0]
    if unit is None and not upper:
        return f"{option(near.option, column)} with the unit behind a colon"
    if column != "amplitude_v" or (unit and unit.volts) or near.heading.counts:
        return option(near.option, column)
    first, *others = (f"{unit.text if unit else 'V'}{SUFFIXES[way]}" for way in near.heading.ways)
    return f"{option(near.option, column, first)}, or {listed(others)}, as it is"


def _check_unread(grid: Grid, head: Head, chosen: Chosen, faults: Faults) -> None:
    """What need not be there is not left out for a unit that psafit does not read.

    That is a bias or a known error, and a reading or a motion next to others.
    """
    optional = [q for q in QUANTITIES if q.role == "drive" or (q.role == "error" and not chosen.traced)]
    others = "trace" if chosen.traced else "reading" if chosen.readings else None
    further = [q for q in QUANTITIES if q.role == others]
    unclear = (q for q in further if chosen.traced or {c.mapped for c in chosen.of(q.column)} == {False})
    for quantity in unclear:
        near = [c for c in chosen.unused if not c.mapped and _may_be(grid, head, c, quantity, traced=chosen.traced)]
        if near:
            what = f"{listed(c.name for c in near)} may be {quantity.column}, too"
            units = {c: quantity.unit for c in near if head.unit(c.place) is None}
            each = (*chosen.of(quantity.column), *near)
            remedy = " ".join(option(c.option, quantity.column, units.get(c, "")) for c in each)
            ignored = " ".join(option(c.option, IGNORED) for c in near)
            faults.add(fault(grid, head, what, f"say {remedy}, {AS_IT_STANDS}, or {ignored}"))
    for column in (c for c in chosen.unused if not c.mapped):
        could = optional if column.heading.altered else [*optional, *further]
        said, of = head.unit(column.place), next((q for q in could if column.heading.would_be(q)), None)
        if of and said and not said.kind:
            what = f"column {column.name} {_unread(said, of.column)}"
            faults.add(
                fault(grid, head, what, f"{_how(column, said, of.column)}, or say {option(column.option, IGNORED)}")
            )
        elif of and column.heading.altered:
            what = f"column {column.name} may be {of.column}, or something made of that"
            remedy = f"say {option(column.option, of.column)}, {AS_IT_STANDS}, or {option(column.option, IGNORED)}"
            faults.add(fault(grid, head, what, remedy))


def _may_be(grid: Grid, head: Head, column: Column, quantity: Quantity, *, traced: bool) -> bool:
    """Whether a column next to others of a quantity may be that, too, which its heading does not say for sure.

    Next to a motion it has the unit. Next to launches it also has a word of the quantity's, or no word but a channel's;
    what sums up the others, or is an error, is none.
    """
    named, said = column.heading, {word.rstrip("0123456789") for word in column.heading.name.split()} - {""}
    if named.spreads or any(q.role == "error" for q in named.quantities(head.units[column.place])):
        return False
    if traced:
        return nearly(column, head, quantity)
    if named.altered or not said.isdisjoint(SUMMARIES):
        return False
    called = named.sounds(quantity) or said <= CHANNELS | NEUTRAL | GENERIC
    return (nearly(column, head, quantity) and called) or _sounds(grid, head, column, quantity)


def _in_other_unit(chosen: Chosen, head: Head, name: str) -> tuple[str, str] | None:
    """What is said of a column that would be this one of psafit's but for its unit, and the remedy."""
    for column in (c for c in chosen.unused if not c.mapped and c.column != TIME):
        said, target = head.unit(column.place), COLUMNS[name].unit
        if said is None or said.kind == target:
            continue
        if column.heading.would_be(COLUMNS[name]) or related(said, target):
            return f": {column.name} {_unread(said, name)}", _how(column, said, name)
    return None


def _with_unit(grid: Grid, head: Head, column: Column, options: Options, faults: Faults) -> Column:
    """A column with its unit, and how its volts are counted."""
    if column.column not in COLUMNS:
        return column
    target = COLUMNS[column.column].unit
    unit = column.unit or column.heading.unit or head.units[column.place] or (Unit(COUNT) if target == COUNT else None)
    if column.unit and column.unit.scale is not None:
        unit = _on_scale(grid, head, column, column.unit, faults)
    numbers = [] if unit else [cell for cell in cells(grid, head, column.place) if is_number(cell)]
    own = bool(numbers) and all(isinstance(c, str) and c[-1:].isalpha() for c in numbers)
    below, alien = head.units[column.place], _other_kind(head, column, unit)
    if unit and below and not column.mapped and below.factor(target) != unit.factor(target):
        what = f"column {column.name} is in {shown(unit.text)}, and in {shown(below.text)} by the row of units"
        faults.add(fault(grid, head, what, f"say {option(column.option, column.column, target)}, or what it is in"))
    elif alien:
        faults.add(fault(grid, head, f"column {column.name} {_unread(alien, column.column)}", _how(column, alien)))
    elif not unit and not own and (numbers or not cells(grid, head, column.place)):
        other = {"Hz": "kHz", "V": "mV", "um": "mm", "us": "ms", "mm/s": "m/s", "N": "mN", "deg": "rad"}[target]
        what = f"column {column.name} gives no unit"
        if column.column == "amplitude_v" and not (column.heading.counts or options.volts):
            target, *others = (f"{target}{SUFFIXES[way]}" for way in column.heading.ways)
            other = listed(others)
        remedy = f"say {option(column.option, column.column, target)}, or another unit such as {other}"
        if column.column in options.held and not column.mapped:
            what = f"{column.column} is given, and column {column.name}, without a unit, may hold it"
            remedy = f"say {option(column.option, IGNORED)} if it does not, else leave out --set and {remedy}"
        faults.add(fault(grid, head, what, remedy))
    volts = None
    counted = (unit and unit.volts) or (None if column.mapped else column.heading.volts)
    if role(column.column) in ("recording", "drive") and unit and counted:
        of = "the drive over time" if column.column == VOLTAGE else column.column
        what = f"column {column.name} is {of}, and its volts are said to be {VOLTS[counted]}"
        faults.add(fault(grid, head, what, f"say {option(column.option, column.column, unit.text)}"))
    if column.column == "amplitude_v" and (unit or own) and not alien:
        volts = _volts(grid, head, column, unit, options, own=own, faults=faults)
    return replace(column, unit=unit, volts=volts)


def _other_kind(head: Head, column: Column, unit: Unit | None) -> Unit | None:
    """The unit that a column has, by heading or user, that is none of its quantity; one of a user hides no other."""
    target = COLUMNS[column.column].unit
    said = unit if unit and unit.scale is not None else column.heading.unit or head.units[column.place]
    return next((u for u in (said, unit) if u and u.kind != target), None)


def _unread(unit: Unit, column: str) -> str:
    return f"is in {shown(unit.text)}, which is no unit of {column}"


def _how(column: Column, unit: Unit, known: str = "") -> str:
    """The remedy of a unit of another kind; `known` is psafit's column, where that is not the column's yet."""
    name = known or column.column
    target = COLUMNS[name].unit
    if unit.kind == "V" and role(name) in SIGNALS:
        return f"say what one volt is: {option(column.option, name, f'5{target}/V')}"
    return conversion(unit, target) or f"give it in {target}, or correct its heading"


def _on_scale(grid: Grid, head: Head, column: Column, scale: Unit, faults: Faults) -> Unit:
    """The unit of a sensor's signal; where that is in mV by its heading, the scale is another."""
    target, said = COLUMNS[column.column].unit, head.unit(column.place)
    if said is None:
        return scale
    per_volt = scale.per_volt(target) is not None
    factor = factor_of(said.text, "V" if per_volt else target)
    if factor is None:
        what = f"column {column.name} is in {shown(said.text)}, and {shown(scale.said)} is no scale of it"
        faults.add(fault(grid, head, what, f"say {option(column.option, column.column)}, or give it another unit"))
        return scale
    return replace(scale, step=factor) if per_volt else scale


def _volts(
    grid: Grid, head: Head, column: Column, unit: Unit | None, options: Options, *, own: bool, faults: Faults
) -> Volts | None:
    """How the volts of a column are counted; where each cell says it by itself, that goes before."""
    below = head.units[column.place]
    named = column.heading.counts if column.mapped else column.heading.volts
    said = {v for v in (named, unit.volts if unit else None, below.volts if below else None) if v}
    if column.volts:
        return column.volts
    if len(said) == 1:
        return said.pop()
    if own or (options.volts and not said):
        return options.volts
    what = f"column {column.name}: whether volts are zero to peak, peak to peak or RMS is not said"
    remedy = f"say {options.volts_asked}"
    if unit and unit.scale is None:
        way = SUFFIXES[column.heading.ways[0]]
        remedy = f"{remedy}, or {option(column.option, column.column, f'{unit.text}{way}')}, as it is"
    faults.add(fault(grid, head, what, remedy))
    return None

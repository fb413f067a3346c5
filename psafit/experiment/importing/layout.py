"""Where in a file the table is: its headings, its row of units, its rows."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

from psafit.drives import WAVEFORMS
from psafit.errors import Faults, InputError
from psafit.experiment.importing.grid import Grid, Row
from psafit.experiment.importing.headings import Heading, heading
from psafit.experiment.importing.numerals import NOTATIONS, count_on, in_both, is_number, whole
from psafit.experiment.importing.quantities import (
    BLANKS,
    CELL_ERRORS,
    COLUMNS,
    COMMENTS,
    MEANS,
    MISSING,
    QUANTITIES,
    STEPS,
    sums_up,
    words,
)
from psafit.experiment.importing.records import IGNORED, Mapping, Options
from psafit.experiment.importing.units import Unit, foreign, spacing, unit
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.text import listed, shown

_WAVEFORMS = {words(name): w.id for w in WAVEFORMS.values() for name in (w.id, *w.names)}


@dataclass(frozen=True)
class Head:
    """The headings of a table.

    Parameters
    ----------
    line : int
        Where they stand; 0 where there are none.
    headings : tuple of Heading
    units : tuple of Unit or None
        Those of a row below the headings.
    first : int
        Index of the row that comes next.
    known : int
        Number of quantities that were recognised.
    """

    line: int
    headings: tuple[Heading, ...]
    units: tuple[Unit | None, ...]
    first: int
    known: int

    def unit(self, place: int) -> Unit | None:
        """The unit that heading or row of units give a column."""
        return self.headings[place].unit or self.units[place]


def names(mapping: Mapping, headings: Sequence[Heading]) -> list[int]:
    """Columns, from 0, that a mapping is about: those of this heading, with or without unit, or of this number.

    ``#3`` is the third column, whatever its heading; ``3`` the one that is called so, if there is one.
    """
    text = " ".join(mapping.heading.split()).casefold()
    if found := [place for place, h in enumerate(headings) if h.text.casefold() == text]:
        return found
    altered, said = heading(text).altered, words(text)
    could = {place: h for place, h in enumerate(headings) if h.altered.casefold() == altered and said}
    for same in (
        lambda h: words(h.text) == said,
        lambda h: h.number is not None and f"{h.name}{h.number}".replace(" ", "") == said.replace(" ", ""),
        lambda h: h.name == said,
    ):
        if found := [place for place, h in could.items() if same(h)]:
            return found
    return [k for k in _numbers([mapping]) if 0 <= k < len(headings)]


def _numbers(mappings: Sequence[Mapping]) -> list[int]:
    """The columns, from 0, that mappings name by their numbers."""
    found = (re.fullmatch(r"#?([0-9]{1,6})", m.heading.strip()) for m in mappings)
    return [int(number[1]) - 1 for number in found if number]


def two_columns(mapping: Mapping, headings: Sequence[Heading]) -> tuple[int, int] | None:
    """The column of this heading and the one of this number, from 0, where the other may be meant.

    None where they are one, or the latter has a name that psafit knows, of something else.
    """
    text = mapping.heading.strip()
    called, numbered = names(mapping, headings), names(replace(mapping, heading=f"#{text}"), headings)
    if not (text.isdigit() and called and numbered) or numbered[0] in called:
        return None
    could = headings[numbered[0]].over_time()
    other = could and mapping.column not in {IGNORED, *(q.column for q in could)}
    return None if other else (called[0], numbered[0])


def waveform_places(grid: Grid, head: Head, meant: Sequence[tuple[str, str]] = ()) -> list[int]:
    """The columns, from 0, of waveforms: they are called so, or each row has words, and some of them are known.

    Those are known that psafit knows, and those of which it is said what is meant.
    """
    known, in_words = {word(text) for text, _ in meant}, columns_in_words(grid, head)

    def says(place: int) -> bool:
        return any(waveform(text) or word(text) in known for text in in_words.get(place, ()))

    return [place for place, named in enumerate(head.headings) if named.is_waveform or says(place)]


def columns_in_words(grid: Grid, head: Head) -> dict[int, list[str]]:
    """The columns with a heading, from 0, of which each row has words, and what they say, each once."""
    every = _texts(grid, head)
    first = next(every, ())
    # Where the first row has no word, no column has one in each row.
    rows = [first, *every] if any(text and not is_number(text) for text in first) else [first]
    found = {}
    for place, named in enumerate(head.headings):
        said = dict.fromkeys(texts[place] if place < len(texts) else "" for texts in rows)
        if named.text and "" not in said and not any(map(is_number, said)):
            found[place] = list(said)
    return found


def words_in(grid: Grid, head: Head, place: int) -> list[str]:
    """What a column calls its waveforms, each once."""
    said = (texts[place] for texts in _texts(grid, head) if place < len(texts) and texts[place])
    return list(dict.fromkeys(map(word, said)))


def _texts(grid: Grid, head: Head) -> Iterator[Sequence[str]]:
    """The texts of each row below the headings that is neither blank nor a comment."""
    return (row.texts for row in grid.rows[head.first :] if not row.is_blank and not is_comment(row.texts[0]))


def word(text: str) -> str:
    """What a waveform is called: psafit's name of what it knows, or the words as they are compared."""
    return waveform(text) or words(text)


def waveform(text: str) -> str:
    """Psafit's waveform of this name; empty for any other, and where a sign changes it, as in ``|sin|``."""
    if re.search(r"(?<!\w)[-\u2212]|[|+*/^\u00b2]", text):
        return ""
    return _WAVEFORMS.get(words(text), "")


def named_waveform(named: Heading) -> str:
    """Psafit's waveform that a heading names among other words; empty where it names none."""
    found = [name for name in _WAVEFORMS if f" {name} " in f" {named.name} "]
    return _WAVEFORMS[max(found, key=len)] if found else ""


def labels_above(grid: Grid, head: Head, places: Sequence[int]) -> list[str]:
    """What stands in the next row above the headings over these columns, where that parts them; no units.

    A cell that is empty, as of cells that were merged, goes on to the left. Numbers that follow one another part none,
    unless a condition is named before them: they may be those of repetitions.
    """
    rows = (row for row in grid.rows[: head.first] if not row.is_blank and (row.line < head.line or not head.line))
    above = [row.texts for row in rows if not all(unit(text) or foreign(text) or not text for text in row.texts)]
    texts = above[-1] if above else ()
    if not texts or is_comment(texts[0]):
        return []
    if grid.separator in BLANKS and all(map(is_number, texts)):  # blanks part no cell that is empty
        texts = ("",) * (len(head.headings) - len(texts)) + texts
    said = [next(filter(None, reversed(texts[: place + 1])), "") for place in places]
    labels = list(dict.fromkeys("" if unit(text) or foreign(text) else text for text in said))
    before = (text for text in reversed(texts[: min(places)]) if text and not is_number(text))
    counts = count_on(whole([*filter(is_number, texts)])) and not names_condition(next(before, ""))
    return labels if len(labels) > 1 and not (counts and all(map(is_number, filter(None, labels)))) else []


def names_condition(text: str) -> bool:
    """Whether a text is the name or the unit of a condition."""
    named, said = heading(text), unit(text)
    of_kind = said is not None and said.kind in ("Hz", "V")
    return of_kind or any(named.would_be(COLUMNS[name]) for name in CONDITION_COLUMNS)


def rows_above(grid: Grid, head: Head) -> Iterator[Row]:
    """Rows above the headings that are not blank."""
    return takewhile(lambda row: row.line < head.line, (row for row in grid.rows if not row.is_blank))


def is_comment(text: str) -> bool:
    """Whether a row that begins with this text is a comment."""
    return text.startswith(COMMENTS) and text.upper() not in CELL_ERRORS


def find_head(
    grid: Grid, options: Options, of_unit: Sequence[str] = (), *, loosely: bool = False, most_lines: int = 300
) -> Head | None:
    """The row of a file in which most headings are recognised; None where none is.

    Parameters
    ----------
    grid : Grid
    options : Options
    of_unit : sequence of str
        Units, of psafit's, that make a column known by themselves.
    loosely : bool
        Whether a column without a unit is known by one word of its heading.
    most_lines : int
        How far down it is looked for.
    """
    best: tuple[tuple[int, int], Head] | None = None
    sure = False  # whether its headings are numbers, of channels
    begun = False  # whether a row above holds numbers where the user says by number that there are some
    for index, row in enumerate(grid.rows[:most_lines]):
        if best and index < best[1].first and all(unit(text) for text in row.texts):  # of those headings
            continue
        texts = _uncommented(row, grid.separator in BLANKS)
        channels = _channels(grid, index)
        if _goes_on(grid, index):
            continue
        if not channels and sum(map(is_number, row.cells)) > sum(bool(t) and not is_number(t) for t in texts):
            begun = begun or _holds(row, options)
            continue
        same = Counter(texts)
        shared = _shared_end(texts)
        headings = tuple(
            replace(heading(text.removesuffix(shared)), text=text, repeats=same[text] > 1) if text else heading("")
            for text in texts
        )
        units, first = _units(grid, headings, index + 1, options)
        if not any(units) and not (best and any(best[1].units) and best[1].first == index):  # of other headings
            units = _units_above(grid, len(headings), index - 1)
        below = next((r for r in grid.rows[first:] if not r.is_blank and not is_comment(r.texts[0])), None)
        mapped = {place: m.column for m in options.columns for place in names(m, headings)}
        if below is None or not (_holds(below, options) or _by_name(options)):
            mapped = {}  # columns of numbers are not below
        others = [(h, u) for k, (h, u) in enumerate(zip(headings, units, strict=True)) if k not in mapped]
        known = {could[0].column for h, u in others if (could := replace(h, altered="").over_time(u))}
        known |= {kind for h, u in others if (kind := _kind(h, u)) in of_unit}
        known |= {sound for h, u in others if loosely and not _kind(h, u) and (sound := _sound(h))}
        if _holds(row, options) and not channels:
            if begun or not known:
                continue
            begun = True
        known |= {f"{place} {column}" for place, column in mapped.items()}
        score = len(known), sum(map(is_number, below.cells)) if below else 0
        if known and (best is None or score > best[0]):
            best, sure = (score, Head(row.line, headings, units, first, len(known))), channels
    said = {m.heading if m.table else m.column for m in options.columns}  # of a table one column each
    if best is None or (not sure and best[1].known < max(2, len(said))):
        return _without_headings(grid, options) or (best and best[1])
    return best[1]


def _goes_on(grid: Grid, index: int) -> bool:
    """Whether a row has several numbers with decimals under some of the row above, as samples next to a header have."""
    row, before = grid.rows[index].texts, grid.rows[index - 1].texts if index else ()
    fractions = [[bool(text) and not text.isdigit() and is_number(text) for text in texts] for texts in (before, row)]
    return sum(both == (True, True) for both in zip(*fractions, strict=False)) > 1


def _shared_end(texts: Sequence[str]) -> str:
    """What all headings of a row end in behind a dash, such as the instrument: no column differs by it."""
    ends = {text[len(text.rpartition(" - ")[0]) :] for text in texts if text}
    end = ends.pop() if len(ends) == 1 and sum(map(bool, texts)) > 1 else ""
    said = heading(f"x{end}")
    matters = said.altered or said.at or said.unit or said.spreads or sums_up(end)
    return end if end.startswith(" - ") and not matters else ""


def _channels(grid: Grid, index: int) -> bool:
    """Whether a row is a name, or none, and different whole numbers, as of channels, above units or as many numbers."""
    row = grid.rows[index]
    numbered = len(row.cells) > 1 and len(set(row.texts)) == len(row.cells) and all(t.isdigit() for t in row.texts[1:])
    if not numbered or is_number(row.cells[0]):
        return False
    below = next((r for r in grid.rows[index + 1 :] if not r.is_blank), row)
    same = len(row.cells) == len(below.cells)
    return same and (all(map(is_number, below.cells)) or all(unit(text) for text in below.texts))


def _holds(row: Row, options: Options) -> bool:
    """Whether a row holds a number in each column that the user names by its number."""
    places = _numbers(_used(options))
    return bool(places) and all(0 <= p < len(row.cells) and is_number(row.cells[p]) for p in places)


def _by_name(options: Options) -> bool:
    """Whether the user names some column by its heading, or none."""
    named = _used(options)
    return len(_numbers(named)) < max(1, len(named))


def _used(options: Options) -> list[Mapping]:
    return [m for m in options.columns if m.column != IGNORED]


def _kind(named: Heading, below: Unit | None) -> str:
    """The unit of psafit's that a column's can be turned into; empty where there is none."""
    said = named.unit or below
    return said.kind if said else ""


def _sound(named: Heading) -> str:
    """The condition or reading that a heading sounds like; empty where it sounds like none."""
    could = (q.column for q in QUANTITIES if q.role in ("condition", "reading") and named.sounds(q))
    return next(could, "")


def _without_headings(grid: Grid, options: Options) -> Head | None:
    """A table whose columns are all named by the user, by their numbers."""
    named = _used(options)
    if _by_name(options):
        return None
    for index, row in enumerate(grid.rows):
        if _holds(row, options):
            width = len(row.cells)
            return Head(0, (heading(""),) * width, (None,) * width, index, len(named))
    return None


def _uncommented(row: Row, aligned: bool) -> tuple[str, ...]:
    """The cells of a row that may be a comment that holds the headings; `aligned` by blanks, a mark is a cell."""
    texts = row.texts
    if texts and is_comment(texts[0]):
        bare = texts[0].lstrip("".join(COMMENTS) + " ")
        return texts[1:] if aligned and not bare else (bare, *texts[1:])
    return texts


def _units(
    grid: Grid, headings: Sequence[Heading], first: int, options: Options
) -> tuple[tuple[Unit | None, ...], int]:
    """The units of a row below headings, and the index of the row behind that; none where it is no row of units.

    It holds no number in a column that the user names; elsewhere it may, such as the increment of a clock.
    """
    none = (None,) * len(headings)
    named = {place for m in _used(options) for place in names(m, headings)}
    for index in range(first, len(grid.rows)):
        row = grid.rows[index]
        if row.is_blank:
            continue
        texts = _uncommented(row, grid.separator in BLANKS)
        found = [unit(text) or foreign(text) for text in texts]
        gap = grid.separator in BLANKS and len(texts) < len(headings)  # which one has no unit cannot be known
        numbers = any(is_number(text) for place, text in enumerate(texts) if place in named or not named)
        parted = zip(headings, texts, found, strict=False)
        more = any(sums_up(text) and named.quantities() for named, text, known in parted if not known)  # headings
        if not any(found) or numbers or len(texts) > len(headings) or gap or more:
            return none, first
        return (*found, *none)[: len(headings)], index + 1
    return none, first


def _units_above(grid: Grid, n: int, index: int) -> tuple[Unit | None, ...]:
    """The units of a row, for so many headings; none where it has another word."""
    texts = _uncommented(grid.rows[index], grid.separator in BLANKS) if index >= 0 else ()
    found = [unit(text) or foreign(text) for text in texts]
    whole = len(texts) <= n and all(said or not text for said, text in zip(found, texts, strict=True))
    return (*(found if whole else ()), *(None,) * n)[:n]


def number_rows(grid: Grid, least: int = 2) -> list[Row]:
    """The rows of a text that a separator parts into numbers, but for what stands first in each.

    Empty unless they are as wide as each other, at least so many, and some row of that width begins with a word, or the
    first of them with an empty cell: blanks may part the text as well.
    """
    rows = [row for row in grid.rows if not row.is_blank and not is_comment(row.texts[0])]
    found = [row for row in rows if len(row.cells) > 1 and all(map(is_number, row.cells[1:]))]
    width = len(found[0].cells) if found else 0
    headed = any(len(row.cells) == width and any(c.isalpha() for c in row.texts[0]) for row in rows)
    headed = headed or (width > 2 and _cornered(found[0]))
    return found if headed and len(found) >= least and all(len(row.cells) == width for row in found) else []


def askew(grid: Grid) -> tuple[int, str, str] | None:
    """Line, fault and remedy of a table that has quantities in rows, or a reading for each pair of two conditions.

    None where it is neither.
    """
    rows = number_rows(grid)
    named = [row for row in rows if not is_number(row.cells[0])]
    if len(_quantities([row.texts[0] for row in named])) > 1:
        what = f"{listed(shown(row.texts[0]) for row in named[:3])} stand before rows of numbers, none above a column"
        return named[0].line, what, "turn the table, so that each of them stands above a column"
    kinds = {said.kind for row in named if (said := heading(row.texts[0]).unit)}
    above = len(named) == 1 and rows[0] is named[0] and len(rows[0].cells) > 2
    if above and (kinds & {"Hz", "V"} or _cornered(rows[0])):
        what = f"{shown(named[0].texts[0])} stands before" if kinds else f"the row of {shown(rows[0].texts[1])} holds"
        what = f"{what} numbers, and what was read at each of them is not said"
        remedy = "write above each column what it holds and where, such as Range at 10 Vpp (um) next to Frequency (Hz)"
        return named[0].line, what, remedy
    return None


def _cornered(row: Row) -> bool:
    """Whether a row begins with an empty cell before numbers that do not follow one another, as channels do."""
    return not row.texts[0] and not count_on(whole(row.texts[1:]))


def clocked(grid: Grid, most_lines: int = 300) -> tuple[int, str, str] | None:
    """Line, fault and remedy of samples that are numbered, whose clock stands once next to headings; None for others.

    Such as ``X,CH1,Start,Increment`` above ``Sequence,VOLT,-1e-5,5e-6``, in seconds.
    """
    rows = [row for row in grid.rows[:most_lines] if not row.is_blank]
    for row, once, below in zip(rows, rows[1:], rows[2:], strict=False):
        said = [words(text) for text in row.texts]
        at = [next((k for k, name in enumerate(said) if name in called), 0) for called in ({"start"}, STEPS)]
        given = [NOTATIONS["."].value(once.texts[k]) if k < len(once.texts) else None for k in at]
        if not all(at) or any(any(below.texts[k : k + 1]) for k in at):
            continue
        start, step = given
        if start is None or step is None or not (spaced := spacing(step, "s")):
            continue
        cells = " and ".join(shown(row.texts[k]) for k in at)
        what = f"{cells} hold a number next to the headings, and none in the rows of samples"
        column = shlex.quote(f"{row.texts[0]}=time_us:{spaced:f}us")
        begins = f"--start={(-start * 10**6).normalize():f}:us"
        remedy = f"say --column {column}, and {begins} if the drive starts at 0"
        return row.line, what, remedy
    return None


@dataclass(frozen=True)
class Body:
    """The rows of a table that hold readings, and those that do not, with line and text."""

    rows: tuple[Row, ...]
    left_out: tuple[tuple[int, str], ...]


def body(grid: Grid, head: Head, needed: Sequence[int], options: Options) -> Body:
    """Separate readings from comments, footers and the like.

    Parameters
    ----------
    grid : Grid
    head : Head
    needed : sequence of int
        Columns that hold something that is used.
    options : Options

    Raises
    ------
    InputError
        On rows that may be readings or not.
    """
    faults, rows, left_out = Faults(), [], []
    text_rows: list[tuple[int, str]] = []
    refusals: dict[tuple[str, str], list[int]] = {}
    again = tuple(h.text for h in head.headings)

    def fault(what: str, remedy: str, line: int) -> None:
        faults.add(InputError(what, remedy, file=grid.file, line=line))

    for row in grid.rows[head.first :]:
        texts = row.texts
        filled = [place for place, text in enumerate(texts) if text]
        used = [place for place in needed if place in filled]
        if not filled:
            continue
        if is_comment(texts[0]) and not is_number(row.cells[0]):
            left_out.append((row.line, " ".join(filter(None, texts))))
            continue
        if not used or (len(filled) == 1 and not is_number(row.cells[filled[0]])):
            if any(char.isalnum() for text in texts for char in text):
                text_rows.append((row.line, " ".join(filter(None, texts))))
            continue
        for line, text in text_rows:
            fault(f"{shown(text)} stands between readings", "put # before it, or give each table a file", line)
        text_rows = []
        if not any(char.isalnum() for text in texts for char in text):  # a rule
            left_out.append((row.line, " ".join(filter(None, texts))))
        elif refused := _no_reading(grid, head, texts):
            refusals.setdefault(refused, []).append(row.line)
        else:
            rows.append(row)
        if len(rows) > options.most_rows:
            fault(f"more than {options.most_rows} rows", "split the file", row.line)
            break
    refusals |= _no_readings(head, needed, rows, options) | _between(rows, left_out)
    for (what, remedy), lines in refusals.items():
        fault(f"{what}, as in {len(lines)} rows" if len(lines) > 1 else what, remedy, lines[0])
    wordy = [row for row in rows if head.line and not any(map(is_number, row.cells))]
    if wordy and len(wordy) < len(rows):
        others = f", nor do {len(wordy) - 1} others" if len(wordy) > 1 else ""
        what = f"{shown(' '.join(filter(None, wordy[0].texts)))} holds no number where other rows do{others}"
        fault(
            what, "put # before a remark, give another table a file of its own, or correct the numbers", wordy[0].line
        )
    faults.end()
    n = _in_rows(grid, head, options)
    if rows and head.line and not grid.sheet and (widest := max(row.width for row in rows)) < n:
        last = str(n) if head.headings[n - 1].repeats else again[n - 1]
        remedy = f"give each column one heading, or say --column {shlex.quote(f'{last}={IGNORED}')}"
        fault(f"{len(again)} headings, and no row of more than {widest} cells", remedy, head.line)
        faults.end()
    if not rows:
        raise InputError("no readings below the headings", "add them", file=grid.file, line=head.line or None)
    return Body(tuple(rows), (*left_out, *text_rows))


def _between(rows: Sequence[Row], left_out: Sequence[tuple[int, str]]) -> dict[tuple[str, str], list[int]]:
    """Comments between readings that may say what changes there: what, remedy, and lines."""
    found: dict[tuple[str, str], list[int]] = {}
    for line, text in left_out:
        if rows and rows[0].line < line < rows[-1].line and _says_what_changes(text):
            what = f"{shown(text)} between readings may say what changes"
            found.setdefault((what, "give each sweep a file, or delete it"), []).append(line)
    return found


def _says_what_changes(text: str) -> bool:
    """Whether a comment names a waveform, or a condition with its unit."""
    named = heading(text.lstrip("".join(COMMENTS) + " "))
    return bool(named.at or named_waveform(named))


def _no_readings(
    head: Head, needed: Sequence[int], rows: Sequence[Row], options: Options
) -> dict[tuple[str, str], list[int]]:
    """Rows that a word marks as none of readings, in a column of which the user says nothing: what, remedy, and lines.

    It sums up others, and does not stand in each row as a mean may; or it stands where most rows hold numbers.
    """
    found: dict[tuple[str, str], list[int]] = {}
    mapped = {place for m in options.columns for place in names(m, head.headings)}
    for place in range(max((len(row.cells) for row in rows), default=0)):
        held = [row for row in rows if place < len(row.cells) and row.texts[place]]
        wordy = [row for row in held if not is_number(row.cells[place]) and any(map(str.isalpha, row.texts[place]))]
        same = len({"".join(row.texts[place : place + 1]) for row in rows}) == 1
        if place in mapped or not wordy or (same and not _spreads(wordy[0].texts[place])):
            continue
        text = head.headings[place].text if place < len(head.headings) else ""
        numbers = sum(is_number(row.cells[place]) for row in held)
        stray = text and place not in needed and numbers > len(rows) / 2
        said = shlex.quote(f"{text if text and not head.headings[place].repeats else place + 1}={IGNORED}")
        counts = "" if place in needed else f"; if it is a reading, say --column {said}"
        for row in wordy:
            if sums_up(row.texts[place]):
                what, do = f"{shown(row.texts[place])} sums up readings and is none", "put # before it, or delete it"
                found.setdefault((what, f"{do}{counts}"), []).append(row.line)
            elif stray and words(row.texts[place]) not in MISSING:
                what = f"{shown(row.texts[place])} stands where other rows hold a number"
                found.setdefault((what, f"put # before that row if it is no reading{counts}"), []).append(row.line)
    return found


def _spreads(text: str) -> bool:
    """Whether a cell sums up others as no mean does."""
    return sums_up(text) and words(text).partition(" ")[0] not in MEANS


def _in_rows(grid: Grid, head: Head, options: Options) -> int:
    """The number of headings, less those at the end that the user ignores, or whose number is in the row of units."""
    n, once = len(head.headings), grid.rows[head.first - 1].cells if any(head.units) else ()
    ignored = {k for m in options.columns if m.column == IGNORED for k in names(m, head.headings)}
    while n - 1 in ignored or (0 < n <= len(once) and is_number(once[n - 1])):
        n -= 1
    return n


def _no_reading(grid: Grid, head: Head, texts: Sequence[str]) -> tuple[str, str] | None:
    """What is wrong with a row that is filled where readings are, and the remedy; None where nothing is."""
    again = tuple(h.text for h in head.headings)
    if head.line and texts == again:
        return "the headings once more: another table", "give each table a file of its own"
    if head.line and _are_headings(texts):
        return f"{listed(map(shown, texts))} are headings: another table", "give each table a file of its own"
    if grid.separator in BLANKS and len(texts) != len(again):
        what = f"{len(texts)} cells in the row, {len(again)} headings: which one is empty is not clear"
        return what, "fill it, quote headings of several words, or export with another separator"
    if head.line and len(texts) > len(again):
        comma = "; decimal commas need another separator" if grid.separator == "," else ""
        return f"{len(texts)} cells in the row, {len(again)} headings", f"give each column a heading{comma}"
    more = [text for text in texts if sums_up(text)] if not any(map(is_number, texts)) else _conditions(head, texts)
    if more:
        what = f"{listed(map(shown, more))} {'are' if len(more) > 1 else 'is'} more of headings"
        return what, "write each into the heading above it, and delete that line"
    return None


def _conditions(head: Head, texts: Sequence[str]) -> list[str]:
    """The conditions of which a row consists, below headings of other units; empty where it holds something else."""
    if not any(map(str.isalpha, "".join(texts))):  # no unit of a condition, as in almost all rows of a file
        return []
    numbers = {place: next(filter(None, in_both(text)), None) for place, text in enumerate(texts) if text}
    said = {place: number.unit.kind for place, number in numbers.items() if number and number.unit}
    other = all(
        kind in ("Hz", "V") and (above := head.unit(place)) and above.kind != kind for place, kind in said.items()
    )
    named = set(texts[:1]) - {texts[place] for place in said}  # before them may stand what they are
    rest = {text for place, text in enumerate(texts) if text and place not in said}
    return [texts[place] for place in said] if said and other and rest <= named else []


def _are_headings(texts: Sequence[str]) -> bool:
    """Whether several cells of a row are headings of one quantity each, and none holds a number."""
    return not any(map(is_number, texts)) and len(_quantities(texts)) > 1


def _quantities(texts: Sequence[str]) -> set[str]:
    """The columns of psafit's of which texts are headings for sure."""
    could = [{q.column for q in heading(text).quantities()} for text in texts if text]
    return {column for each in could if len(each) == 1 for column in each}

"""Traces at several conditions and recorded drives, as instruments write them, drawn at random; some of them damaged.

Traces stand one below the other, mixed by time, or in a column each whose heading names the condition; in text or in a
workbook. The drive has a name, or was recorded: next to the traces, in a file or a sheet of its own, or one period.
"""

from __future__ import annotations

import datetime
import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

from foreign import (
    FREQUENCIES,
    MOTIONS,
    NAMES,
    PEAKS,
    PREAMBLE,
    SETTINGS,
    STYLES,
    TIMES,
    WAVES,
    Foreign,
    Notation,
    Reading,
    driven,
    held_settings,
    some_of,
    text,
)

# A unit of volts that says how they are counted.
SAID = {"pp": "Vpp", "peak": "Vp", "rms": "Vrms"}
Pairs = list[tuple[Decimal, Decimal]]


@dataclass
class Sheet:
    """A table as it is written: headings, rows of cells, and what each column is."""

    notation: Notation
    heads: list[str]
    kinds: list[str]
    rows: list[list[Any]] = field(default_factory=list)

    def shuffled(self, rng: random.Random) -> Sheet:
        """Its columns in another order."""
        order = rng.sample(range(len(self.heads)), len(self.heads))
        heads, kinds = ([some[k] for k in order] for some in (self.heads, self.kinds))
        return Sheet(self.notation, heads, kinds, [[row[k] for k in order] for row in self.rows])


@dataclass(frozen=True)
class Clock:
    """When samples are taken, us on the clock of the instrument, and when the drive starts."""

    times: tuple[Decimal, ...]
    start: Decimal
    every: int
    unit: str

    @classmethod
    def drawn(cls, rng: random.Random) -> Clock:
        """Some samples before the start, which may lie between two; one in so many is kept."""
        step, early, every = Decimal(rng.randrange(1, 80)) / 10, rng.choice([0, 0, 1, 5]), rng.choice([1, 1, 1, 2, 3])
        n = every * rng.choice([12, 30])
        zero = step * rng.choice([0, 0, early, -3]) if early else Decimal(0)
        start = zero + (step / 2 if early and rng.random() < 0.3 else 0)
        return cls(tuple(zero + step * k for k in range(-early, n)), start, every, rng.choice(list(TIMES)))

    @property
    def early(self) -> int:
        """How many samples lie before the start."""
        return sum(t < self.start for t in self.times)

    @property
    def options(self) -> list[str]:
        """What is said of it."""
        said = ["--every", str(self.every)] if self.every > 1 else []
        return [*said, "--start", f"{self.start}:us"] if self.early or self.start else said


@dataclass(frozen=True)
class Trace:
    """A condition, its motion by samples, and the drive that was recorded next to it, if it was."""

    frequency: float
    amplitude: float
    motion: tuple[str, ...]
    volts: tuple[str, ...] = ()


def draw_traces(rng: random.Random, folder: Path, damaged: float = 0.0, more: float = 0.0) -> Foreign:
    """Write launches over time at several conditions.

    Parameters
    ----------
    rng : random.Random
    folder : Path
        Exists.
    damaged : float
        Probability that a cell, a heading or a row is damaged so that it must be noticed.
    more : float
        Probability of settings of the drive.

    Returns
    -------
    Foreign
    """
    notation, clock = _notation(rng), Clock.drawn(rng)
    column, names, units = rng.choice(MOTIONS)
    unit, workbook = rng.choice(list(units)), rng.random() < 0.3
    form = rng.choice(["below", "below", "parted", "mixed", "wide"])
    if form == "mixed" and column == "velocity_mm_s":  # which may be launch speeds with a clock
        form = "below"
    drive = rng.choice([*WAVES, "next", "next", "own", "own", "period"])
    traces, held = _traces(rng, notation, clock, drive, form)
    style = rng.choice(STYLES if form != "wide" else ["{} ({})", "{} [{}]", "{} / {}"])
    times = [notation.text(float(t / TIMES[clock.unit])) for t in clock.times]
    heads = (style.format(rng.choice(["Time", "t", "Zeit"]), clock.unit), rng.choice(names), unit)
    counts = WAVES[drive][1] if drive in WAVES else {"pp": Decimal("0.5"), "peak": Decimal(1)}
    counted = "peak" if drive in ("own", "period") else rng.choice(list(counts))
    counted = counted if form != "wide" or counted != "rms" else "pp"
    counted = "peak" if drive == "next" else counted  # of less than a period, volts peak to peak are asked about
    volts = {t.amplitude: notation.text(float(Decimal(repr(t.amplitude)) / counts[counted])) for t in traces}
    same = Form(notation, style, heads, times, traces, counted, {} if held else volts)
    sheet = _wide(same) if form == "wide" else _below(rng, same)
    recorded = drive in ("next", "own")
    drawn = some_of(rng, ["idle_v"] if recorded else SETTINGS) if rng.random() < more else []
    # Next to a recording a column of its idle voltage is asked about, and one of an offset next to a drive from 0 V.
    asked = drawn if recorded or form == "wide" else ["bias_v"] if "unipolar" in drive else []
    columns = [name for name in drawn if name not in asked and rng.random() < 0.5]
    settings, said = held_settings(rng, [name for name in drawn if name not in columns])
    own_settings = _with_settings(rng, same, sheet, columns)
    if form == "mixed":
        time = sheet.kinds.index("time")
        sheet.rows.sort(key=lambda row: notation.value(row[time]))
    amplitudes = {c: float(notation.value(volts[c]) * counts[counted]) for c in volts}
    options = clock.options
    options += ["--set", f"amplitude_v={notation.value(volts[held])}:{SAID[counted]}"] if held else []
    options += ["--waveform", drive] if drive in WAVES else []
    options += said
    seen = [notation.value(t) * TIMES[clock.unit] for t in times]
    others: list[tuple[str, Sheet]] = []
    rows: dict[Trace, dict[str, list[Decimal]]] = {}
    if drive in ("own", "period"):
        recording, table, said = _recording(rng, _notation(rng), clock, drive == "period")
        others, options = [("scope", recording)], [*options, *said]
        rows = dict.fromkeys(traces, table)
    elif drive == "next":
        rows = {t: _recorded(list(zip(seen, map(notation.value, t.volts), strict=True)), clock.start) for t in traces}
    for one in [sheet, *(other for _, other in others)] if workbook else []:
        one.rows = [[float(one.notation.value(cell)) if cell else "" for cell in row] for row in one.rows]
    if form == "parted":
        for k in range(len(traces) - 1, 0, -1):
            sheet.rows.insert(k * len(times), [])
    wrong = ""
    if rng.random() < damaged:
        wrong = _damage(rng, rng.choice([sheet, *(other for _, other in others)]), workbook, form == "wide")
    readings: list[Reading] = []
    for trace in traces:
        moved = [(t - clock.start, y) for t, y in zip(seen, trace.motion, strict=True) if t >= clock.start and y]
        kept = [(t, notation.value(y) * units[unit]) for t, y in moved][:: clock.every]
        found = rows.get(trace, {}) | {"time_us": [t for t, _ in kept], column: [y for _, y in kept]}
        rested = [float(x) for x in found.pop("idle_v", [])] or [0.0]
        own = {"idle_v": rested[0]} | settings | own_settings[trace]
        condition = driven(drive if drive in WAVES else "table", own), trace.frequency, amplitudes[trace.amplitude]
        readings += [(*condition, name, float(x), 0.0) for name, values in found.items() for x in values]
    files, said = _written(rng, folder, [("launches", sheet), *others], workbook)
    return Foreign(files[0], (*options, *said), tuple(readings), tuple(files[1:]), wrong)


def _notation(rng: random.Random) -> Notation:
    scientific = rng.random() < 0.2
    return Notation(rng.choice(".,"), "", 9 if scientific else None, scientific)


def _traces(
    rng: random.Random, notation: Notation, clock: Clock, drive: str, form: str
) -> tuple[list[Trace], float | None]:
    """Motions at two to four conditions, and the amplitude that was held, if it was."""
    held = rng.choice([None, float(rng.randrange(1, 40))])
    n, rest = len(clock.times), round(rng.uniform(-3, 3), 2) if clock.early else 0.0

    def drawn() -> tuple[str, ...]:
        return tuple(notation.text(x) for x in _voltage(rng, rest, clock.early or 1, n))

    volts = drawn()
    traces = []
    for f in rng.sample(range(1, 300), rng.choice([2, 3, 4])):
        cells = [notation.text(round(rng.uniform(-3, 40), 3)) for _ in range(n)]
        if form == "wide" and traces and rng.random() < 0.3:  # what was not read, next to the first trace
            cells[rng.randrange(n)] = ""
        motion = tuple(cells)
        own = () if drive != "next" else volts if form == "wide" else drawn()
        traces.append(Trace(f * 100.0, held or float(rng.randrange(1, 40)), motion, own))
    return traces, held


def _voltage(rng: random.Random, rest: float, early: int, n: int) -> list[float]:
    """A drive of `n` samples that rests for the first `early` and moves behind them."""
    return [*[rest] * early, *(round(rng.uniform(10, 40) * rng.choice([-1, 1]), 3) for _ in range(n - early))]


@dataclass(frozen=True)
class Form:
    """What tables of the same traces share: notation, style, times; names of time and motion; amplitudes as written."""

    notation: Notation
    style: str
    heads: tuple[str, str, str]
    times: list[str]
    traces: list[Trace]
    counted: str
    volts: dict[float, str]


def _below(rng: random.Random, form: Form) -> Sheet:
    """Traces one below the other, with columns of their conditions, and of the drive."""
    notation, style, heads, volts = form.notation, form.style, form.heads, form.volts
    f_unit = rng.choice(list(FREQUENCIES))
    frequency = style.format(rng.choice(NAMES["frequency"]), f_unit)
    sheet = Sheet(notation, [heads[0], frequency, style.format(*heads[1:])], ["time", "condition", "motion"])
    if volts:
        unit = rng.choice(PEAKS[form.counted]).format("V")
        sheet.heads.append(style.format(rng.choice(NAMES["volts"]), unit))
        sheet.kinds.append("condition")
    if form.traces[0].volts:
        sheet.heads.append(rng.choice(["CH1 (V) drive", "Drive [V]", "Piezo voltage (V)", "Antriebsspannung (V)"]))
        sheet.kinds.append("volts")
    for trace in form.traces:
        f = notation.text(float(Decimal(repr(trace.frequency)) / FREQUENCIES[f_unit]))
        amplitude = [volts[trace.amplitude]] if volts else []
        for k, (time, y) in enumerate(zip(form.times, trace.motion, strict=True)):
            sheet.rows.append([time, f, y, *amplitude, *trace.volts[k : k + 1]])
    return sheet.shuffled(rng)


def _with_settings(rng: random.Random, form: Form, sheet: Sheet, names: Sequence[str]) -> dict[Trace, dict[str, float]]:
    """Add columns of settings of the drive, constant along each trace; the settings of each."""
    found: dict[Trace, dict[str, float]] = {trace: {} for trace in form.traces}
    for name in names:
        called, units, bounds = SETTINGS[name]
        unit = rng.choice(list(units))
        head = rng.choice(called)
        sheet.heads.append(form.style.format(head, unit) if unit else head)
        sheet.kinds.append("setting")
        drawn = [round(rng.uniform(*bounds), 2) for _ in range(rng.choice([1, 2]))]
        for k, trace in enumerate(form.traces):
            cell = form.notation.text(float(Decimal(repr(rng.choice(drawn))) / units[unit]))
            found[trace][name] = float(form.notation.value(cell) * units[unit])
            for row in sheet.rows[k * len(form.times) : (k + 1) * len(form.times)]:
                row.append(cell)
    return found


def _wide(form: Form) -> Sheet:
    """Traces in a column each, whose heading names the condition, and one drive of them all."""
    notation, style, heads, volts = form.notation, form.style, form.heads, form.volts
    sheet = Sheet(notation, [heads[0]], ["time"], [[time] for time in form.times])
    for trace in form.traces:
        at = f"{trace.frequency / 1000:g} kHz"
        if volts:
            at += f", {float(notation.value(volts[trace.amplitude])):g} {SAID[form.counted]}"
        sheet.heads.append(style.format(f"{heads[1]} @ {at}", heads[2]))
        sheet.kinds.append("motion")
        for row, y in zip(sheet.rows, trace.motion, strict=True):
            row.append(y)
    if form.traces[0].volts:
        sheet.heads.append("Drive (V)")
        sheet.kinds.append("volts")
        for row, u in zip(sheet.rows, form.traces[0].volts, strict=True):
            row.append(u)
    return sheet


def _recording(
    rng: random.Random, notation: Notation, clock: Clock, period: bool
) -> tuple[Sheet, dict[str, list[Decimal]], list[str]]:
    """A drive in a file of its own, the rows that come of it, and what is said of it."""
    step, n = Decimal(rng.randrange(1, 80)) / 10, clock.every * rng.choice([14, 25])
    early = rng.choice([1, 4]) if clock.early or clock.start else 0
    rest = round(rng.uniform(-3, 3), 2) if early else 0.0
    first = clock.start - step * early + (step / 4 if early and rng.random() < 0.3 else 0)
    unit, scale = rng.choice(list(TIMES)), Decimal(rng.choice(["1", "1", "20", "-0.5"]))
    voltage = _voltage(rng, rest, max(early, 1), early + n)
    cells = [[notation.text(float((first + step * k) / TIMES[unit])), notation.text(u)] for k, u in enumerate(voltage)]
    name = rng.choice(["CH1", "Monitor", "U", "Drive"])
    sheet = Sheet(notation, [f"{rng.choice(['Time', 't', 'x'])} ({unit})", f"{name} (V)"], ["time", "volts"], cells)
    pairs = [(notation.value(a) * TIMES[unit], notation.value(b) * scale) for a, b in cells]
    said = [] if scale == 1 else ["--column", f"{name} (V)=voltage_v:{scale}V/V"]
    if not period:
        return sheet.shuffled(rng), _recorded(pairs, clock.start, clock.every), said
    lasts = pairs[-1][0] - clock.start - rng.choice([Decimal(0), step / 2])
    held = _recorded(pairs, clock.start, clock.every, lasts)
    largest = max(map(abs, _recorded(pairs, clock.start, 1, lasts)["voltage_v"]))
    phases = {"phase": [t / lasts for t in held["drive_us"]], "level": [u / largest for u in held["voltage_v"]]}
    return sheet.shuffled(rng), phases, [*said, "--period", f"{lasts}:us"]


def _recorded(pairs: Pairs, start: Decimal, every: int = 1, lasts: Decimal | None = None) -> dict[str, list[Decimal]]:
    """Times and voltages of a drive from its start, and what it rested at before."""
    pairs = [(t - start, u) for t, u in pairs]
    end = pairs[-1][0] if lasts is None else lasts
    inside = [pair for pair in pairs if 0 < pair[0] <= end]
    blocks = [inside[k : k + every] for k in range(0, len(inside) - every + 1, every)]
    rows = [(sum(t for t, _ in some) / every, sum(u for _, u in some) / every) for some in blocks]
    if pairs[0][0] <= 0:
        rows.insert(0, (Decimal(0), _between(pairs, Decimal(0))))
    if rows[-1][0] < end:
        rows.append((end, _between(pairs, end)))
    before = [u for t, u in pairs if t < 0]
    return {
        "drive_us": [t for t, _ in rows],
        "voltage_v": [u for _, u in rows],
        "idle_v": [sum(before, Decimal(0)) / max(len(before), 1)],
    }


def _between(pairs: Pairs, at: Decimal) -> Decimal:
    """The voltage at a time, linear between samples."""
    for (t, u), (later, v) in pairwise(pairs):
        if t <= at <= later:
            return u + (v - u) * (at - t) / (later - t)
    raise AssertionError("a time beyond the samples")


# --- damage -----------------------------------------------------------------------------------------------------------


def _damage(rng: random.Random, sheet: Sheet, workbook: bool, wide: bool) -> str:
    """Damage a table so that it must be refused; what was done."""
    how = rng.choice(["cell", "cell", "cell", "unit", "empty", "heading", "fall", "cut", "again"])
    place = rng.randrange(len(sheet.kinds))
    row = rng.choice([row for row in sheet.rows if row])
    time = sheet.kinds.index("time")
    left_out = ("empty", "heading") if wide else ("heading",)  # a sample, or a column that is
    if sheet.kinds[place] == ("motion" if wide else "setting") and how in left_out:
        place = time
    if how == "cell":
        words: list[Any] = ["over", "1.2.3", "NaN", "inf", "--", "0x1F", "1e9999", "１,,２"]
        # A workbook's errors are empty cells to its readers.
        words += [True, datetime.datetime(2026, 11, 3), datetime.time(1, 2)] if workbook else ["#N/A", "#DIV/0!"]
        row[place] = rng.choice(words)
        return f"{row[place]!r} in column {sheet.heads[place]}"
    if how == "unit":
        row[place] = f"{row[place]} parsec"
        return f"{row[place]!r} in column {sheet.heads[place]}"
    if how == "empty":
        row[place] = ""
        return f"an empty cell in column {sheet.heads[place]}"
    if how == "heading":  # velocities without a time would be launches
        sheet.heads[place] = "" if place == time else rng.choice(["", "note", "5"])
        return f"column {place + 1} of kind {sheet.kinds[place]} is called {sheet.heads[place]!r}"
    if how == "cut":
        first = max(time, 1)
        sheet.rows[-1][first:] = [""] * (len(sheet.heads) - first)
        return "the last row ends early"
    if how == "again":
        sheet.rows.insert(len(sheet.rows) // 2, list(sheet.heads))
        return "the headings once more"
    sheet.rows[-1][time] = sheet.rows[-3][time]  # which is refused, or of no sample that is kept
    return ""


# --- files ------------------------------------------------------------------------------------------------------------


def _written(
    rng: random.Random, folder: Path, tables: Sequence[tuple[str, Sheet]], workbook: bool
) -> tuple[list[Path], list[str]]:
    """The files of launches and, if it has one, of the drive, and the options that name sheet and drive."""
    above = [[line] for line in rng.sample(PREAMBLE, rng.choice([0, 0, 1, 3]))]
    grids = [(name, [*above, sheet.heads, *sheet.rows]) for name, sheet in tables]
    if not workbook:
        files = []
        for name, grid in grids:
            file = folder / f"{name}.csv"
            file.write_bytes(text(rng, grid, rng.choice(",;\t")))
            files.append(file)
        return files, ["--drive", files[1].name] if files[1:] else []
    if len(grids) == 2 and rng.random() < 0.5:  # of one workbook
        _write_workbook(folder / "book.xlsx", grids)
        return [folder / "book.xlsx"], ["--sheet", "launches", "--drive", "book.xlsx"]
    files = [folder / f"{name}.xlsx" for name, _ in grids]
    for file, grid in zip(files, grids, strict=True):
        _write_workbook(file, [grid])
    return files, ["--drive", files[1].name] if files[1:] else []


def _write_workbook(file: Path, grids: Sequence[tuple[str, list[list[Any]]]]) -> None:
    from openpyxl import Workbook

    book = Workbook()
    for name, grid in grids:
        sheet = book.create_sheet(name)
        for row in grid:
            sheet.append(row)
    del book["Sheet"]
    book.save(file)

"""Files as instruments and spreadsheets write them, drawn at random, with the readings that they hold.

Any waveform, or several in a column; any observable, or several; units, names and numbers as people write them.
Settings of the drive and known errors stand in columns, or are said next to the file.
"""

from __future__ import annotations

import csv
import io
import math
import random
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

from psafit.experiment import Group
from psafit.observables import OBSERVABLES, OF_LAUNCHES


class Driven(NamedTuple):
    """A drive: its waveform, and every setting that a group may have."""

    waveform: str
    bias_v: float = 0.0
    idle_v: float = 0.0
    phase_deg: float = 0.0
    cycles: float = math.inf


def driven(waveform: str, settings: Mapping[str, float]) -> Driven:
    """A drive with these settings, to 12 digits: an idle voltage may be a mean."""
    return Driven(waveform, **{name: float(f"{value:.12g}") for name, value in settings.items()})


# Drive, Hz, V zero to peak, psafit's column of what is read, the value in its unit, and its known error or 0.
Reading = tuple[Driven, float, float, str, float, float]

FREQUENCIES = {
    "Hz": Decimal(1), "kHz": Decimal(1000), "MHz": Decimal(10**6),
}  # fmt: skip
VOLTS = {"V": Decimal(1), "mV": Decimal("0.001"), "kV": Decimal(1000)}
# What may be read: psafit's column, names, and units with what turns a value into psafit's.
READ: dict[str, tuple[str, list[str], dict[str, Decimal]]] = {
    "range": (
        "launch_range_um",
        ["Launch range", "Range", "Wurfweite", "Launch distance", "Reading", "range"],
        {"um": Decimal(1), "µm": Decimal(1), "μm": Decimal(1), "mm": Decimal(1000), "nm": Decimal("0.001"),
         "m": Decimal(10**6), "micron": Decimal(1)},
    ),
    "speed": (
        "launch_speed_mm_s",
        ["Launch speed", "Velocity", "Geschwindigkeit", "Launch velocity", "speed"],
        {"mm/s": Decimal(1), "m/s": Decimal(1000), "um/s": Decimal("0.001"), "µm/s": Decimal("0.001")},
    ),
    "time": (
        "contact_time_us",
        ["Contact time", "contact duration", "Kontaktzeit"],
        {"us": Decimal(1), "µs": Decimal(1), "ms": Decimal(1000), "ns": Decimal("0.001"), "s": Decimal(10**6)},
    ),
    "force": (
        "peak_force_n",
        ["Peak force", "Contact force", "Kraft", "Force"],
        {"N": Decimal(1), "mN": Decimal("0.001"), "kN": Decimal(1000)},
    ),
}  # fmt: skip
SIGMA = {o.column: o.sigma_column for o in OF_LAUNCHES}
UNITS = {SIGMA[column]: units for column, _, units in READ.values()}
ERRORS = (0.01, 3.0)
"""Bounds of known errors, in psafit's units."""
# By waveform: names that instruments have for it, and what turns volts as they are counted into zero to peak.
BIPOLAR = {"pp": Decimal("0.5"), "peak": Decimal(1)}
WAVES: dict[str, tuple[list[str], dict[str, Decimal]]] = {
    "sine": (["sine", "SINE", "Sinus"], BIPOLAR | {"rms": Decimal(2).sqrt()}),
    "square": (["square", "Square", "Rechteck"], BIPOLAR | {"rms": Decimal(1)}),
    "triangle": (["triangle", "Dreieck"], BIPOLAR | {"rms": Decimal(3).sqrt()}),
    "unipolar_sine": (["unipolar sine", "haversine"], {"pp": Decimal(1), "peak": Decimal(1)}),
    "unipolar_square": (["unipolar square", "pulse", "TTL"], {"pp": Decimal(1), "peak": Decimal(1)}),
    "unipolar_triangle": (["unipolar triangle"], {"pp": Decimal(1), "peak": Decimal(1)}),
}
# By setting of a drive: what it is called, units with what turns a value into psafit's, and its bounds.
SETTINGS: dict[str, tuple[list[str], dict[str, Decimal], tuple[float, float]]] = {
    "bias_v": (["DC offset", "Offset", "Bias voltage", "DC bias"], VOLTS, (-20, 60)),
    "idle_v": (["Idle voltage", "Rest voltage", "Ruhespannung"], VOLTS, (-5, 20)),
    "phase_deg": (["Start phase", "Startphase", "Burst phase"], {"deg": Decimal(1), "°": Decimal(1)}, (-180, 360)),
    "cycles": (["Burst cycles", "N periods", "Zyklen"], {"": Decimal(1)}, (1, 50)),
}
NAMES = {
    "frequency": ["Frequency", "Freq.", "f", "Frequenz", "Drive frequency", "FREQUENCY"],
    "volts": ["Amplitude", "Voltage", "U", "Spannung", "Drive voltage", "Ampl"],
}
STYLES = ["{} ({})", "{} [{}]", "{}/{}", "{} / {}", "{} in {}", "{}, {}", "{}_{}", "{} <{}>"]
PEAKS = {
    "pp": ["{}pp", "{}p-p", "{}_pp", "{} pk-pk", "{}PP"],
    "peak": ["{}p", "{}pk", "{} peak"],
    "rms": ["{}rms", "{}RMS", "{}_rms", "{}eff"],
}
EXTRAS = ["Temperature (°C)", "Bemerkung", "Operator", "No.", "Humidity (%)", "Phase lag (deg)", "File"]
PREAMBLE = [
    "Model,DSOX2024A", "Record Length;41;points", "Datum: 3.11.2026", "Prüfer: M. Müller; Halle 2", "",
    "# made by logger 2.1, channel 1", "Serial number\tMY123,456", "Sample interval, 1.0e-6, s", "Launch tests",
]  # fmt: skip
FOOTERS = ["End of file", "# stopped by hand", "", "Müller", "-----"]


@dataclass(frozen=True)
class Foreign:
    """A file, the options that it needs, what it holds, files next to it, and what is wrong with it, if anything is."""

    file: Path
    options: tuple[str, ...]
    readings: tuple[Reading, ...]
    others: tuple[Path, ...] = ()
    wrong: str = ""


@dataclass(frozen=True)
class Side:
    """A column next to those of readings.

    Parameters
    ----------
    column, name, unit : str
        Psafit's name of it; what the file calls it, and in which unit.
    factor : Decimal
        Turns a value into psafit's unit.
    values : tuple of float
        Those that its cells have, in psafit's unit.
    of : tuple of int
        Of a known error the columns of readings that it is of.
    """

    column: str
    name: str
    unit: str
    factor: Decimal
    values: tuple[float, ...]
    of: tuple[int, ...] = ()


@dataclass(frozen=True)
class Form:
    """What a file holds, and how it is counted.

    Parameters
    ----------
    read : tuple of str
        Keys of `READ`; of one there may be repetitions.
    units : tuple of str
        Of frequency, volts and each of what is read.
    counted : {"pp", "peak", "rms"}
    waves : tuple of str
        Waveforms of the rows; in a column if there are several.
    n_repeats : int
    sides : tuple of Side
        Columns next to those of readings: settings of the drive and known errors.
    held : dict of str to float
        Those that no column has, by psafit's name and in its unit.
    said : tuple of str
        Options that say so.
    """

    read: tuple[str, ...]
    units: tuple[str, ...]
    counted: str
    waves: tuple[str, ...]
    n_repeats: int
    sides: tuple[Side, ...] = ()
    held: dict[str, float] = field(default_factory=dict)
    said: tuple[str, ...] = ()

    @property
    def columns(self) -> list[tuple[str, str, Decimal]]:
        """Of each column of readings: its key, unit, and what turns a value into psafit's unit."""
        each = [(key, unit, READ[key][2][unit]) for key, unit in zip(self.read, self.units[2:], strict=True)]
        return each * self.n_repeats


@dataclass(frozen=True)
class Notation:
    """How numbers are written."""

    decimal: str
    thousands: str
    digits: int | None  # behind the point; None for as many as needed
    scientific: bool

    def text(self, value: float) -> str:
        """A number as it is written."""
        if self.scientific:
            return f"{value:.{self.digits or 4}E}".replace(".", self.decimal)
        plain = f"{Decimal(repr(abs(value))):f}" if self.digits is None else f"{abs(value):.{self.digits}f}"
        whole, _, part = plain.partition(".")
        grouped = ("-" if value < 0 else "") + f"{int(whole):,}".replace(",", self.thousands)
        return f"{grouped}{self.decimal}{part}" if part else grouped

    def value(self, text: str) -> Decimal:
        """The number again."""
        text = text.replace(self.thousands, "") if self.thousands else text
        return Decimal(text.replace(self.decimal, "."))


def draw(rng: random.Random, folder: Path, more: float = 0.0) -> Foreign:
    """Write a file of some form.

    Parameters
    ----------
    rng : random.Random
    folder : Path
        Exists.
    more : float
        Probability of settings of the drive and known errors.

    Returns
    -------
    Foreign
    """
    workbook = rng.random() < 0.2
    separator = rng.choice(",;\t| ;,\t")
    notation = _notation(rng, separator)
    form = _form(rng)
    form = _with_more(rng, form) if rng.random() < more else form
    headings, unit_row, options = _headings(rng, form)
    volts = rng.uniform(2, 40) if rng.random() < 0.2 else None
    drawn = [_row(rng, form, notation, volts, workbook) for _ in range(rng.choice([1, 3, 8, 20]))]
    rows, readings = [row for row, _ in drawn], [one for _, held in drawn for one in held]
    grid = _arranged(rng, headings, unit_row, rows)
    if workbook:
        file = folder / "foreign.xlsx"
        _write_workbook(rng, grid, file)
    else:
        file = folder / "foreign.csv"
        file.write_bytes(text(rng, grid, separator))
    return Foreign(file, (*options, *form.said), tuple(readings))


TIMES = {"s": Decimal(10**6), "ms": Decimal(1000), "us": Decimal(1), "µs": Decimal(1), "ns": Decimal("0.001")}
# Of what a trace is: psafit's column, names, and units with what turns a value into psafit's.
MOTIONS: list[tuple[str, list[str], dict[str, Decimal]]] = [
    ("displacement_um", ["Displacement", "Auslenkung", "Position"], READ["range"][2]),
    ("velocity_mm_s", ["Velocity", "Geschwindigkeit", "Ball velocity"], READ["speed"][2]),
    ("tip_displacement_um", ["Tip displacement"], READ["range"][2]),
]


def draw_trace(rng: random.Random, folder: Path, more: float = 0.0) -> Foreign:
    """Write a launch over time, as vibrometers and oscilloscopes do, with times or without; arguments as of `draw`."""
    separator, scientific = rng.choice(",;\t"), rng.random() < 0.3
    notation = Notation(rng.choice(".,"), "", 9 if scientific else None, scientific)
    column, names, units = rng.choice(MOTIONS)
    unit, time_unit, style = rng.choice(list(units)), rng.choice(list(TIMES)), rng.choice(STYLES)
    heads = [style.format(rng.choice(["Time", "t", "Zeit"]), time_unit), style.format(rng.choice(names), unit)]
    factor, f, v = units[unit], float(rng.randrange(1, 300) * 100), float(rng.randrange(1, 40))
    options = ["--set", f"frequency_hz={f / 1000}:kHz", "--set", f"amplitude_v={2 * v}:Vpp", "--waveform", "sine"]
    if rng.random() < 0.3:  # the sensor's volts
        scale = Decimal(rng.choice(["5", "-2.5", "0.125"]))
        heads[1], factor = "CH1 (V)", factor * scale
        options += ["--column", f"CH1 (V)={column}:{scale}{unit}/V"]
    start = rng.choice([0, 0, 5, 12])  # samples before the drive
    step, given, said = _step(rng)
    n, timed, stated = rng.choice([12, 40]), rng.random() < 0.7, rng.random() < 0.5
    above = rng.sample(PREAMBLE, rng.choice([0, 0, 1, 3]))
    if not timed:
        options += ["--start", f"{start * step}:us", *([] if stated else ["--step", given])]
        above = [*(line for line in above if "interval" not in line), *([said] if stated else [])]
        options += ["--column", f"{heads[1]}={column}"] if heads[1] != "CH1 (V)" else []
    elif start:
        options += ["--start", "0"]
    settings, said_too = held_settings(rng, some_of(rng, SETTINGS) if rng.random() < more else [])
    drive = driven("sine", settings)
    rows, readings = [], []
    for k in range(-start, n):
        cells = [notation.text(float(k * step / TIMES[time_unit])), notation.text(round(rng.uniform(-3, 40), 3))]
        rows.append(cells[not timed :])
        time, value = (notation.value(cell) for cell in cells)
        if k >= 0:
            sample = {"time_us": time * TIMES[time_unit] if timed else k * step, column: value * factor}
            readings += [(drive, f, v, name, float(x), 0.0) for name, x in sample.items()]
    file = folder / "foreign.csv"
    file.write_bytes(text(rng, [*([line] for line in above), heads[not timed :], *rows], separator))
    return Foreign(file, (*options, *said_too), tuple(readings))


def _step(rng: random.Random) -> tuple[Decimal, str, str]:
    """A step of samples, us; and how a user and a header say it, as a time or as a rate."""
    mark = rng.choice([" = ", "=", ": ", ",", ";"])
    if rng.random() < 0.5:
        step = Decimal(rng.randrange(1, 80)) / 10
        return step, f"{step}:us", f"{rng.choice(['Sample interval', '# dt', 'Abtastintervall'])}{mark}{step} us"
    rate = rng.choice([125, 200, 500, 2000])
    unit = rng.choice(["kHz", "kSa/s", "kS/s"])
    return Decimal(1000) / rate, f"{rate}:kHz", f"{rng.choice(['SampleRate', 'Sampling rate'])}{mark}{rate} {unit}"


def _row(
    rng: random.Random, form: Form, notation: Notation, volts: float | None, workbook: bool
) -> tuple[list[Any], list[Reading]]:
    """A row of cells, and the readings in it; `volts` are those of all rows, if they were held."""
    f = rng.choice([rng.uniform(20, 30_000), float(rng.randrange(1, 300) * 100)])
    v = volts or rng.choice([rng.uniform(1, 40), float(rng.randrange(1, 40))])
    factors = [FREQUENCIES[form.units[0]], VOLTS[form.units[1]], *(factor for _, _, factor in form.columns)]
    factors += [side.factor for side in form.sides]
    values = [f, v, *(rng.uniform(0.05, 95) for _ in form.columns), *(rng.choice(side.values) for side in form.sides)]
    cells = [notation.text(float(Decimal(repr(x)) / factor)) for x, factor in zip(values, factors, strict=True)]
    numbers = [notation.value(cell) for cell in cells]
    if workbook:  # which keep 15 digits
        numbers = [Decimal(f"{n:.15g}") for n in numbers]
    positive = [True, False, *(key in ("time", "force") for key, _, _ in form.columns)]
    positive += [bool(side.of) or side.column == "cycles" for side in form.sides]
    for k in (k for k, n in enumerate(numbers) if n <= 0 and positive[k]):
        cells[k], numbers[k] = notation.text(1.0), Decimal(1)  # rounded to nothing: no frequency, and no time
    wave = rng.choice(form.waves)
    own = [float(n * factor) for n, factor in zip(numbers, factors, strict=True)]
    next_to = list(zip(form.sides, own[2 + len(form.columns) :], strict=True))
    settings = form.held | {side.column: value for side, value in next_to}
    drive = driven(wave, {name: value for name, value in settings.items() if name in SETTINGS})
    condition = drive, own[0], float(numbers[1] * factors[1] * WAVES[wave][1][form.counted])
    errors = {k: value for side, value in next_to for k in side.of}
    readings = []
    for k, (key, _, _) in enumerate(form.columns):
        error = errors.get(k, form.held.get(SIGMA[READ[key][0]], 0.0))
        readings.append((*condition, READ[key][0], own[2 + k], error))
    if form.n_repeats > 1 and rng.random() < 0.2:
        last = len(readings) - 1
        readings.pop()
        for k in (1 + len(form.columns), *(k for k, side in enumerate(form.sides, 3 + last) if side.of == (last,))):
            cells[k] = ""
    row: list[Any] = [float(n) if workbook and c else c for n, c in zip(numbers, cells, strict=True)]
    return [*row, *([rng.choice(WAVES[wave][0])] if len(form.waves) > 1 else [])], readings


def differ(found: Iterable[Reading], true: Iterable[Reading], within: float = 1e-9) -> bool:
    """Whether readings are others, by more than rounding."""

    def plain(readings: Iterable[Reading]) -> list[Reading]:
        return sorted((d, float(f"{f:.9g}"), float(f"{v:.9g}"), name, x, s) for d, f, v, name, x, s in readings)

    one, other = plain(found), plain(true)
    return [r[:4] for r in one] != [r[:4] for r in other] or any(
        not math.isclose(a[k], b[k], rel_tol=within, abs_tol=within)
        for a, b in zip(one, other, strict=True)
        for k in (4, 5)
    )


def held_by(groups: Iterable[Group]) -> list[Reading]:
    """What groups hold, as `Foreign.readings` has it, sorted; the times of samples stand among them."""
    found: list[Reading] = []
    for g in groups:
        drive = driven(g.waveform, {name: getattr(g.drive, name) for name in SETTINGS})
        errors = [0.0] * g.n_points if g.sigma is None else g.sigma.tolist()
        for i, (f, v, k, y) in enumerate(zip(g.frequency_hz, g.amplitude_v, g.measured, g.reading, strict=True)):
            condition = drive, float(f), float(v)
            found.append((*condition, OBSERVABLES[k].column, float(y), errors[i]))
            if g.time_us is not None:
                found.append((*condition, "time_us", float(g.time_us[i]), 0.0))
        if g.drive.table is not None:
            names, unit = (("drive_us", "voltage_v"), 1e6) if g.drive.recorded else (("phase", "level"), 1.0)
            for at, value in zip(g.drive.table.at, g.drive.table.value, strict=True):
                found += [(*condition, names[0], float(at) * unit, 0.0), (*condition, names[1], float(value), 0.0)]
    return sorted(found)


def some_of(rng: random.Random, names: Iterable[str]) -> list[str]:
    """Some settings of a drive; with a bias also what it rests at, which is asked for."""
    drawn = [name for name in names if rng.random() < 0.5]
    return [*drawn, *(["idle_v"] if "bias_v" in drawn and "idle_v" not in drawn else [])]


def held_settings(rng: random.Random, names: Iterable[str]) -> tuple[dict[str, float], list[str]]:
    """Settings and known errors that were held, in psafit's units, and the options that say so."""
    values: dict[str, float] = {}
    options: list[str] = []
    for name in names:
        _, units, bounds = SETTINGS.get(name) or ([], UNITS[name], ERRORS)
        unit = rng.choice(list(units))
        number = Decimal(repr(round(rng.uniform(*bounds), 2))) / units[unit]
        values[name] = float(number * units[unit])
        options += ["--set", f"{name}={number:f}" + (f":{unit}" if unit else "")]
    return values, options


def _with_more(rng: random.Random, form: Form) -> Form:
    """A form with settings of the drive and known errors, some of them in columns."""
    sides: list[Side] = []
    rest: list[str] = []
    for name in some_of(rng, SETTINGS):
        names, units, bounds = SETTINGS[name]
        if rng.random() < 0.3 or (name == "bias_v" and any("unipolar" in wave for wave in form.waves)):
            rest.append(name)  # an offset in a column next to a drive from 0 V is asked about
            continue
        unit = rng.choice(list(units))
        drawn = tuple(round(rng.uniform(*bounds), 2) for _ in range(rng.choice([1, 2, 3])))
        sides.append(Side(name, rng.choice(names), unit, units[unit], drawn))
    for key in (key for key in form.read if rng.random() < 0.4):
        column, units = READ[key][0], READ[key][2]
        of = [k for k, (other, _, _) in enumerate(form.columns) if other == key]
        if rng.random() < 0.3:
            rest.append(SIGMA[column])
            continue
        each = [tuple([k]) for k in of] if rng.random() < 0.5 else [tuple(of)]
        unit, name = rng.choice(list(units)), rng.choice(["Sigma", "sigma", "Standardunsicherheit"])
        for n, some in enumerate(each, 1):
            drawn = tuple(round(rng.uniform(*ERRORS), 3) for _ in range(3))
            called = f"{name} {n}" if len(each) > 1 else name
            sides.append(Side(SIGMA[column], called, unit, units[unit], drawn, some))
    values, said = held_settings(rng, rest)
    return replace(form, sides=tuple(sides), held=values, said=tuple(said))


def _form(rng: random.Random) -> Form:
    """What the file holds."""
    read: tuple[str, ...] = ("range",)
    if rng.random() < 0.4:
        read = tuple(rng.sample(list(READ), rng.choice([1, 1, 2, 3])))
    waves = ("sine",)
    if rng.random() < 0.4:
        waves = tuple(rng.sample(list(WAVES), rng.choice([1, 1, 2])))
    counts = set.intersection(*(set(WAVES[w][1]) for w in waves))
    counted = rng.choice([c for c in ["pp", "pp", "peak", "rms"] if c in counts])
    units = [rng.choice(list(FREQUENCIES)), rng.choice(list(VOLTS)), *(rng.choice(list(READ[k][2])) for k in read)]
    return Form(read, tuple(units), counted, waves, rng.choice([1, 1, 1, 2, 3]) if len(read) == 1 else 1)


def _notation(rng: random.Random, separator: str) -> Notation:
    decimal = rng.choice(".,")
    marks = ["", "", "", "," if decimal == "." else ".", "'", "\u00a0", " "]
    thousands = rng.choice([m for m in marks if separator != " " or m not in (" ", "\u00a0")])
    scientific = rng.random() < 0.1
    return Notation(decimal, "" if scientific else thousands, rng.choice([None, 1, 2, 3, 4]), scientific)


def _headings(rng: random.Random, form: Form) -> tuple[list[str], list[str] | None, list[str]]:
    """Headings of the columns, a row of units or none, and what is said next to them."""
    names = [rng.choice(NAMES[kind]) for kind in ("frequency", "volts")]
    options: list[str] = []
    volts = form.units[1]
    if rng.random() < 0.7:
        volts = rng.choice(PEAKS[form.counted]).format(form.units[1])
    elif rng.random() < 0.5 and form.counted == "pp":
        names[1] = rng.choice(["Upp", "Peak-to-peak voltage", "Pk-Pk(1)", "Amplitude pp"])
    else:
        options = ["--volts", form.counted]
    called = [rng.choice(READ[key][1]) for key in form.read]
    if form.n_repeats > 1:
        called = [f"{called[0]} {k}" for k in range(1, form.n_repeats + 1)]
    said = [form.units[0], volts, *(unit for _, unit, _ in form.columns), *(side.unit for side in form.sides)]
    heads = [*names, *called, *(side.name for side in form.sides)]
    last: list[str] = []
    if len(form.waves) > 1:
        last = [rng.choice(["Waveform", "Wave", "Signalform"])]
    else:
        options += ["--waveform", form.waves[0]]
    if rng.random() < 0.25:
        style = rng.choice(["{}", "({})", "[{}]"])
        return [*heads, *last], [*(style.format(unit) if unit else "" for unit in said), *("" for _ in last)], options
    style = rng.choice(STYLES)
    full = [style.format(name, unit) if unit else name for name, unit in zip(heads, said, strict=True)]
    return [*full, *last], None, options


def _arranged(
    rng: random.Random, headings: list[str], units: list[str] | None, rows: list[list[Any]]
) -> list[list[Any]]:
    """Columns in any order, with others between them; what stands above and below."""
    extras = rng.sample(EXTRAS, rng.choice([0, 0, 1, 2]))
    heads = [*headings, *extras]
    order = list(range(len(heads)))
    if rng.random() < 0.5:
        rng.shuffle(order)

    def row(cells: list[Any], others: list[Any]) -> list[Any]:
        both = [*cells, *others]
        return [both[k] for k in order]

    def other(name: str, k: int) -> Any:
        return {"Bemerkung": rng.choice(["ok", "", "laut"]), "Operator": "MM", "No.": str(k), "File": f"t{k}.dat"}.get(
            name, rng.choice(["21", "22", "20"])
        )

    grid = [row(headings, extras)]
    if units:
        grid.append(row(units, [""] * len(extras)))
    for k, cells in enumerate(rows, 1):
        grid.append(row(cells, [other(name, k) for name in extras]))
        if rng.random() < 0.05:
            grid.append(rng.choice([[], ["# drive retuned"]]))
    above = [[line] for line in rng.sample(PREAMBLE, rng.choice([0, 0, 1, 4]))]
    below = [[rng.choice(FOOTERS)] for _ in range(rng.choice([0, 0, 0, 1]))]
    return [*above, *grid, *below]


def text(rng: random.Random, grid: list[list[Any]], separator: str) -> bytes:
    """Rows as a text file of some encoding."""
    quoting = rng.choice([csv.QUOTE_MINIMAL, csv.QUOTE_MINIMAL, csv.QUOTE_ALL])
    end = rng.choice(["\n", "\r\n", "\r\n", "\r"])
    stream = io.StringIO()
    writer = csv.writer(stream, delimiter=separator, quoting=quoting, lineterminator=end)
    for row in grid:
        if len(row) == 1:  # as it is
            stream.write(f"{row[0]}{end}")
        else:
            writer.writerow(row)
    text = stream.getvalue()
    for encoding in rng.sample(["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"], 5):
        try:
            return text.encode(encoding)
        except UnicodeEncodeError:  # a Greek mu
            continue
    raise AssertionError("UTF-8 holds any text")


def _write_workbook(rng: random.Random, grid: list[list[Any]], file: Path) -> None:
    from openpyxl import Workbook

    book = Workbook()
    if rng.random() < 0.3:
        book.create_sheet("Notes", 0).append(["made by", "M. Müller"])
    sheet = book["Sheet"]
    for row in grid:
        sheet.append(row)
    book.save(file)

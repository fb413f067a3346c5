"""Files as instruments and spreadsheets write them, drawn at random, with the readings that they hold."""

from __future__ import annotations

import csv
import io
import random
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

Reading = tuple[float, float, float]  # Hz, V zero to peak, um

FREQUENCIES = {
    "Hz": Decimal(1), "kHz": Decimal(1000), "MHz": Decimal(10**6),
}  # fmt: skip
VOLTS = {"V": Decimal(1), "mV": Decimal("0.001"), "kV": Decimal(1000)}
LENGTHS = {
    "um": Decimal(1), "µm": Decimal(1), "μm": Decimal(1), "mm": Decimal(1000), "nm": Decimal("0.001"),
    "m": Decimal(10**6), "micron": Decimal(1),
}  # fmt: skip
COUNTED = {"pp": Decimal("0.5"), "peak": Decimal(1), "rms": Decimal(2).sqrt()}
NAMES = {
    "frequency": ["Frequency", "Freq.", "f", "Frequenz", "Drive frequency", "FREQUENCY"],
    "volts": ["Amplitude", "Voltage", "U", "Spannung", "Drive voltage", "Ampl"],
    "range": ["Launch range", "Range", "Wurfweite", "Launch distance", "Reading", "range"],
}
STYLES = ["{} ({})", "{} [{}]", "{}/{}", "{} / {}", "{} in {}", "{}, {}", "{}_{}", "{} <{}>"]
PEAKS = {
    "pp": ["{}pp", "{}p-p", "{}_pp", "{} pk-pk", "{}PP"],
    "peak": ["{}p", "{}pk", "{} peak"],
    "rms": ["{}rms", "{}RMS", "{}_rms", "{}eff"],
}
EXTRAS = ["Temperature (°C)", "Bemerkung", "Operator", "No.", "Humidity (%)", "Phase (deg)", "File"]
PREAMBLE = [
    "Model,DSOX2024A", "Record Length;41;points", "Datum: 3.11.2026", "Prüfer: M. Müller; Halle 2", "",
    "# made by logger 2.1, channel 1", "Serial number\tMY123,456", "Sample interval, 1.0e-6, s", "Launch tests",
]  # fmt: skip
FOOTERS = ["End of file", "# stopped by hand", "", "Müller", "-----"]


@dataclass(frozen=True)
class Foreign:
    """A file, the options that it needs with ``--waveform sine``, and what it holds."""

    file: Path
    options: tuple[str, ...]
    readings: tuple[Reading, ...]


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
        plain = f"{Decimal(repr(value)):f}" if self.digits is None else f"{value:.{self.digits}f}"
        whole, _, part = plain.partition(".")
        grouped = f"{int(whole):,}".replace(",", self.thousands)
        return f"{grouped}{self.decimal}{part}" if part else grouped

    def value(self, text: str) -> Decimal:
        """The number again."""
        text = text.replace(self.thousands, "") if self.thousands else text
        return Decimal(text.replace(self.decimal, "."))


def draw(rng: random.Random, folder: Path) -> Foreign:
    """Write a file of some form.

    Parameters
    ----------
    rng : random.Random
    folder : Path
        Exists.

    Returns
    -------
    Foreign
    """
    workbook = rng.random() < 0.2
    separator = rng.choice(",;\t| ;,\t")
    notation = _notation(rng, separator)
    units = rng.choice(list(FREQUENCIES)), rng.choice(list(VOLTS)), rng.choice(list(LENGTHS))
    counted = rng.choice(["pp", "pp", "peak", "rms"])
    n_repeats = rng.choice([1, 1, 1, 2, 3])
    headings, unit_row, options = _headings(rng, units, counted, n_repeats)
    rows, readings = [], []
    held = rng.random() < 0.2
    volts_held = rng.uniform(2, 40)
    for _ in range(rng.choice([1, 3, 8, 20])):
        f = rng.choice([rng.uniform(20, 30_000), float(rng.randrange(1, 300) * 100)])
        v = volts_held if held else rng.choice([rng.uniform(1, 40), float(rng.randrange(1, 40))])
        ranges = [rng.uniform(0.05, 95) for _ in range(n_repeats)]
        cells = [
            notation.text(float(Decimal(repr(x)) / factor))
            for x, factor in zip(
                [f, v, *ranges],
                [FREQUENCIES[units[0]], VOLTS[units[1]] * COUNTED[counted], *[LENGTHS[units[2]]] * n_repeats],
                strict=True,
            )
        ]
        numbers = [notation.value(cell) for cell in cells]
        if workbook:  # which keep 15 digits
            numbers = [Decimal(f"{n:.15g}") for n in numbers]
        if numbers[0] <= 0:  # rounded to nothing: no frequency
            cells[0] = notation.text(1.0)
            numbers[0] = Decimal(1)
        read = [float(x * LENGTHS[units[2]]) for x in numbers[2:]]
        if n_repeats > 1 and rng.random() < 0.2:
            cells[-1], read = "", read[:-1]
        volts = numbers[1] * VOLTS[units[1]] * COUNTED[counted]
        readings += [(float(numbers[0] * FREQUENCIES[units[0]]), float(volts), r) for r in read]
        rows.append([float(n) if workbook and c else c for n, c in zip(numbers, cells, strict=True)])
    grid = _arranged(rng, headings, unit_row, rows)
    if workbook:
        file = folder / "foreign.xlsx"
        _write_workbook(rng, grid, file)
    else:
        file = folder / "foreign.csv"
        file.write_bytes(_text(rng, grid, separator))
    return Foreign(file, tuple(options), tuple(readings))


def _notation(rng: random.Random, separator: str) -> Notation:
    decimal = rng.choice(".,")
    marks = ["", "", "", "," if decimal == "." else ".", "'", "\u00a0", " "]
    thousands = rng.choice([m for m in marks if separator != " " or m not in (" ", "\u00a0")])
    scientific = rng.random() < 0.1
    return Notation(decimal, "" if scientific else thousands, rng.choice([None, 1, 2, 3, 4]), scientific)


def _headings(
    rng: random.Random, units: tuple[str, str, str], counted: str, n_repeats: int
) -> tuple[list[str], list[str] | None, list[str]]:
    """Headings of frequency, volts and ranges, a row of units or none, and what is said next to them."""
    names = [rng.choice(NAMES[kind]) for kind in ("frequency", "volts", "range")]
    options: list[str] = []
    volts = units[1]
    if rng.random() < 0.7:
        volts = rng.choice(PEAKS[counted]).format(units[1])
    elif rng.random() < 0.5 and counted == "pp":
        names[1] = rng.choice(["Upp", "Peak-to-peak voltage", "Pk-Pk(1)", "Amplitude pp"])
    else:
        options = ["--volts", counted]
    ranges = [f"{names[2]} {k}" for k in range(1, n_repeats + 1)] if n_repeats > 1 else [names[2]]
    said = [units[0], volts, *[units[2]] * n_repeats]
    heads = [names[0], names[1], *ranges]
    if rng.random() < 0.25:
        form = rng.choice(["{}", "({})", "[{}]"])
        return heads, [form.format(unit) for unit in said], options
    style = rng.choice(STYLES)
    return [style.format(name, unit) for name, unit in zip(heads, said, strict=True)], None, options


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


def _text(rng: random.Random, grid: list[list[Any]], separator: str) -> bytes:
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

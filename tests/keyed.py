"""Experiment folders with every key that a group may have, drawn at random, and what they hold.

Drives of all kinds with their settings, periods and recordings in files of their own, any observables with blank cells
and known errors, facts of the rig; written in the ways that TOML and CSV allow. One folder in five has one thing that
must be refused.
"""

from __future__ import annotations

import csv
import random
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from psafit.drives import WAVEFORMS
from psafit.experiment import Experiment
from psafit.experiment.rig import MATERIALS
from psafit.observables import OF_LAUNCHES

CONSTANTS = {"M": 0.027, "m": 0.005, "q": 1.2e-7, "l": 0.09, "k_s": 4.89e7, "g": 9.81}
FACTS = {
    "ball_radius": (1e-3, 2e-2), "source_resistance": (1.0, 1e3), "capacity": (1e-8, 5e-6),
    "rated_voltage": (20.0, 1000.0), "rated_stroke": (1e-6, 1e-4), "layer_thickness": (2e-5, 2e-3),
}  # fmt: skip
SETTINGS = {"bias_v": (-100.0, 100.0), "idle_v": (-100.0, 100.0), "phase_deg": (-360.0, 360.0), "cycles": (0.5, 50.0)}
# A reading: frequency, amplitude, column, value, and its known error or None.
Cell = tuple[float, float, str, float, float | None]


@dataclass
class Held:
    """What a group holds; `rows` and `columns` are of the file of its drive."""

    waveform: str
    settings: dict[str, float] = field(default_factory=dict)
    rows: list[tuple[float, float]] = field(default_factory=list)
    columns: list[str] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)


@dataclass(frozen=True)
class Keyed:
    """A folder: what it holds, and what is wrong with it, if anything is."""

    groups: list[Held]
    rig: dict[str, Any]
    wrong: str


def draw(rng: random.Random, folder: Path) -> Keyed:
    """Write a folder of some kind.

    Parameters
    ----------
    rng : random.Random
    folder : Path
        Is made.

    Returns
    -------
    Keyed
    """
    folder.mkdir(parents=True)
    wrong = rng.choice(list(WRONG)) if rng.random() < 0.2 else ""
    lines = ['title = "drawn"', "[constants]", *(f"{k} = {v!r}" for k, v in CONSTANTS.items())]
    rig = _rig(rng) if rng.random() < 0.5 else {}
    lines += ["[rig]", *(f"{k} = {_toml(rng, v)}" for k, v in rig.items())] if rig else []
    groups = []
    for number in range(1, rng.choice([1, 1, 2, 3]) + 1):
        held, keys = _group(rng, folder, number, WRONG[wrong] if wrong and number == 1 else lambda keys, table: None)
        groups.append(held)
        rng.shuffle(keys)
        lines += ["[[group]]", *(f"{k}{rng.choice([' = ', '=', ' =  '])}{v}" for k, v in keys)]
    text = rng.choice(["\n", "\r\n"]).join([*lines, ""])
    (folder / "experiment.toml").write_bytes(text.encode(rng.choice(["utf-8", "utf-8", "utf-8-sig"])))
    return Keyed(groups, rig, wrong)


Keys = list[tuple[str, str]]
Lines = list[list[str]]


def _without(keys: Keys, *names: str) -> None:
    keys[:] = [pair for pair in keys if pair[0] not in names]


def _bias_of_a_recording(keys: Keys, table: Lines) -> None:
    _without(keys, "waveform", "drive", "bias_v", "phase_deg", "cycles")
    keys += [("waveform", '"table"'), ("drive", '"recording.csv"'), ("bias_v", "1.5")]


def _a_file_for_a_sine(keys: Keys, table: Lines) -> None:
    _without(keys, "waveform", "drive")
    keys += [("waveform", '"sine"'), ("drive", '"recording.csv"')]


def _no_file(keys: Keys, table: Lines) -> None:
    _without(keys, "waveform", "drive")
    keys.append(("waveform", '"table"'))


def _half_a_period(keys: Keys, table: Lines) -> None:
    _without(keys, "waveform", "drive")
    keys += [("waveform", '"table"'), ("drive", '"half.csv"')]


def _no_cycles(keys: Keys, table: Lines) -> None:
    _without(keys, "cycles")
    keys.append(("cycles", "0"))


def _a_bias_in_quotes(keys: Keys, table: Lines) -> None:
    _without(keys, "bias_v")
    keys.append(("bias_v", '"5"'))


def _misspelt(keys: Keys, table: Lines) -> None:
    keys.append(("bias", "5"))


def _another_unit(keys: Keys, table: Lines) -> None:
    table[0] = ["contact_time_ms" if i == len(table[0]) - 1 else name for i, name in enumerate(table[0])]


def _an_error_of_nothing(keys: Keys, table: Lines) -> None:
    names = [o.sigma_column for o in OF_LAUNCHES if o.column not in table[0] and o.sigma_column not in table[0]]
    for k, row in enumerate(table):
        row.append((names[0] if names else "sigma_s") if k == 0 else "0.1")


def _a_word(keys: Keys, table: Lines) -> None:
    table[-1][0] = "fast"


WRONG: dict[str, Callable[[Keys, Lines], None]] = {
    "a bias of a recording": _bias_of_a_recording,
    "a file for a sine": _a_file_for_a_sine,
    "a table without a file": _no_file,
    "half a period": _half_a_period,
    "no cycles": _no_cycles,
    "a bias in quotes": _a_bias_in_quotes,
    "a misspelt key": _misspelt,
    "another unit": _another_unit,
    "an error of nothing": _an_error_of_nothing,
    "a word": _a_word,
}


def _toml(rng: random.Random, value: Any) -> str:
    if isinstance(value, str):
        return rng.choice([f'"{value}"', f"'{value}'"])
    texts = [repr(value), f"{value!r} # as measured", f"+{value!r}" if value > 0 else repr(value), f"{value:.17e}"]
    return rng.choice([*texts, str(int(value))] if value == int(value) else texts)


def _rig(rng: random.Random) -> dict[str, Any]:
    facts: dict[str, Any] = {k: _number(rng, *FACTS[k]) for k in rng.sample(list(FACTS), rng.randrange(1, 5))}
    for name in ("ball_material", "face_material"):
        if rng.random() < 0.5:
            facts[name] = rng.choice(list(MATERIALS))
    return facts


def _number(rng: random.Random, low: float, high: float) -> float:
    value = rng.uniform(low, high)
    texts = [repr(value), f"{value:.3g}", f"{value:.1g}"]
    return rng.choice([x for x in map(float, texts) if low <= x <= high])


def _group(rng: random.Random, folder: Path, number: int, spoil: Callable[[Keys, Lines], None]) -> tuple[Held, Keys]:
    """A group's files, what it holds, and its keys."""
    waveform = rng.choice([*WAVEFORMS, "table", "table"])
    held, keys = Held(waveform), [("id", str(number)), ("waveform", f'"{waveform}"'), ("file", f'"g{number}.csv"')]
    recorded = waveform == "table" and rng.random() < 0.5
    names = ["idle_v"] if recorded else list(SETTINGS)
    held.settings = {k: _number(rng, *SETTINGS[k]) for k in names if rng.random() < 0.3}
    held.settings = {k: v for k, v in held.settings.items() if v or k != "cycles"}
    keys += [(k, _toml(rng, v)) for k, v in held.settings.items()]
    if waveform == "table":
        held.rows = _recording(rng) if recorded else _period(rng)
        head = ["time_us", "voltage_v"] if recorded else ["phase", "level"]
        _write(rng, folder / f"d{number}.csv", [head, *([repr(a), repr(b)] for a, b in held.rows)])
        keys.append(("drive", f'"d{number}.csv"'))
    held.cells, table = _readings(rng)
    spoil(keys, table)
    for name, rows in (("recording.csv", [(10.0 * k, k % 7) for k in range(20)]), ("half.csv", [(0.0, 0), (0.5, 1)])):
        if any(name in value for _, value in keys):
            head = ["time_us", "voltage_v"] if name == "recording.csv" else ["phase", "level"]
            _write(rng, folder / name, [head, *([repr(a), repr(b)] for a, b in rows)])
    _write(rng, folder / f"g{number}.csv", table)
    return held, keys


def _period(rng: random.Random) -> list[tuple[float, float]]:
    inner = sorted(_number(rng, 0.01, 0.99) for _ in range(rng.randrange(6)))
    places = [0.0, *(p for x in inner for p in ([x, x] if rng.random() < 0.3 else [x])), 1.0]
    return [(x, _number(rng, -1.0, 1.0)) for x in places]


def _recording(rng: random.Random) -> list[tuple[float, float]]:
    time, rows = rng.choice([0.0, 0.0, 12.5]), []
    for _ in range(rng.choice([10, 40, 300])):
        rows.append((time, _number(rng, -20.0, 120.0)))
        time = float(f"{time + rng.choice([1.0, 2.5, rng.uniform(0.1, 9.0)]):.6g}")
    return rows


def _readings(rng: random.Random) -> tuple[list[Cell], Lines]:
    """Cells of a table, and the table as it is written."""
    read = rng.sample(OF_LAUNCHES, rng.choice([1, 1, 2, 3]))
    stated = [o for o in read if rng.random() < 0.3 and sum(p.sigma_column == o.sigma_column for p in read) == 1]
    names = ["frequency_hz", "amplitude_v", *(o.column for o in read), *(o.sigma_column for o in stated)]
    order = names[:]
    if rng.random() < 0.5:
        rng.shuffle(order)
    cells: list[Cell] = []
    table = [order]
    for k in range(rng.choice([2, 5, 12])):
        f, v = _number(rng, 50.0, 2e4), _number(rng, 0.1, 150.0)
        row = {"frequency_hz": _text(rng, f), "amplitude_v": _text(rng, v)}
        gone = rng.choice(read) if len(read) > 1 and k and rng.random() < 0.3 else None
        for o in read:
            value, error = _number(rng, 0.05, 90.0), _number(rng, 0.01, 2.0) if o in stated else None
            row[o.column] = "" if o is gone else _text(rng, value)
            if o in stated:
                row[o.sigma_column] = "" if o is gone else repr(error)
            if o is not gone:
                cells.append((f, v, o.column, value, error))
        table.append([row[name] for name in order])
    return cells, table


def _text(rng: random.Random, value: float) -> str:
    return rng.choice([repr(value), repr(value), f" {value!r}", f"{value:.17e}", f"+{value!r}"])


def _write(rng: random.Random, file: Path, table: Lines) -> None:
    quote, end = rng.choice(["", "", '"']), rng.choice(["\n", "\r\n"])
    text = end.join(",".join(f"{quote}{cell}{quote}" for cell in row) for row in table)
    file.write_bytes((text + rng.choice([end, "", end * 2])).encode(rng.choice(["utf-8", "utf-8-sig"])))


# --- what is in a folder ------------------------------------------------------------------------------------------


def read_plainly(folder: Path) -> list[Held]:
    """The groups of a folder by the standard library alone, without a check of anything."""
    text = (folder / "experiment.toml").read_bytes().decode("utf-8-sig")
    found = []
    for keys in tomllib.loads(text)["group"]:
        held = Held(keys["waveform"].strip().lower())
        held.settings = {k: float(keys[k]) for k in SETTINGS if k in keys}
        if "drive" in keys:
            held.columns, *rows = _rows(folder / keys["drive"])
            held.rows = [(float(a), float(b)) for a, b in rows]
        head, *rows = _rows(folder / keys.get("file", keys.get("trace")))
        for row in rows:
            cell = dict(zip(head, row, strict=True))
            if "trace" in keys:
                condition = float(keys["frequency_hz"]), float(keys["amplitude_v"])
                held.cells += [(*condition, name, float(value), None) for name, value in cell.items()]
            for o in OF_LAUNCHES:
                if cell.get(o.column):
                    error = float(cell[o.sigma_column]) if cell.get(o.sigma_column) else None
                    held.cells.append(
                        (
                            float(cell["frequency_hz"]),
                            float(cell["amplitude_v"]),
                            o.column,
                            float(cell[o.column]),
                            error,
                        )
                    )
        found.append(held)
    return found


def _rows(file: Path) -> Lines:
    with file.open(encoding="utf-8-sig", newline="") as stream:
        rows = [[cell.strip() for cell in row] for row in csv.reader(stream)]
    return [row for row in rows if any(row)]


def differs(experiment: Experiment, groups: list[Held], rig: dict[str, Any] | None = None) -> str:
    """What an experiment holds that a folder does not, or the reverse; empty for nothing."""
    if len(experiment.groups) != len(groups):
        return f"{len(experiment.groups)} groups instead of {len(groups)}"
    if rig is not None and (experiment.rig.given if experiment.rig else {}) != rig:
        return f"another rig: {experiment.rig}"
    for g, held in zip(experiment.groups, groups, strict=True):
        drive, table = g.drive, g.drive.table
        settings = {k: getattr(drive, k) for k in held.settings}
        if (
            drive.waveform != held.waveform
            or settings != held.settings
            or set(drive.settings) - {"drive"} - set(settings)
        ):
            return f"group {g.id}: another drive: {drive}"
        unit = 1e-6 if drive.recorded else 1.0
        rows = [] if table is None else list(zip(table.at.tolist(), table.value.tolist(), strict=True))
        if rows != [(at * unit, value) for at, value in held.rows]:
            return f"group {g.id}: another table of its drive"
        errors = [None] * g.n_points if g.sigma is None else [s or None for s in g.sigma.tolist()]
        columns = (g.frequency_hz, g.amplitude_v, g.measured, g.reading)
        cells = [
            (f, v, OF_LAUNCHES[int(k)].column, y, s)
            for f, v, k, y, s in zip(*(c.tolist() for c in columns), errors, strict=True)
        ]
        if sorted(cells, key=repr) != sorted(held.cells, key=repr):
            return f"group {g.id}: other readings"
    return ""

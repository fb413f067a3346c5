"""Read `experiment.toml`."""

from __future__ import annotations

import math
import re
import stat
import tomllib
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from psafit.drives import NAMES, TABLE, Drive, Table, instead
from psafit.errors import Faults, InputError
from psafit.experiment.drive_table import SETTING_LIMITS, read_drive
from psafit.experiment.plausible import doubt
from psafit.experiment.records import CONDITION_COLUMNS, DEFINITION, Conditions, Constants, GroupId
from psafit.experiment.rig import ALIASES, MATERIALS, SEVERAL, Followed, Rig, material_named
from psafit.experiment.rig import beliefs as rig_beliefs
from psafit.experiment.table import LIMITS as COLUMN_LIMITS
from psafit.experiment.text import did_you_mean, id_text, listed, near_names, one_line, read_text, shown, unreadable
from psafit.observables import OBSERVABLES
from psafit.parameters import Belief, LogNormal, Normal

MAX_ID = 999_999_999
_GROUP_KEYS = ("id", "waveform", "file")
_TRACE_KEYS = ("trace", *CONDITION_COLUMNS)
_DRIVE_KEYS = ("bias_v", "idle_v", "phase_deg", "cycles", "drive")
_BRACKETS = "head each group with [[group]], in double brackets"
_CONSTANTS = tuple(f.name for f in fields(Constants))
# Hard limits of each constant, SI: far beyond any rig; a wrong unit is only warned of.
LIMITS = {
    "M": (1e-9, 1e6),
    "m": (1e-9, 1e6),
    "q": (1e-15, 1e3),
    "l": (1e-6, 1e6),
    "k_s": (1e-3, 1e15),
    "g": (1e-3, 1e6),
}
# The same of what a rig is made of.
FACT_LIMITS = {
    "ball_radius": (1e-6, 10.0),
    "source_resistance": (1e-6, 1e9),
    "capacity": (1e-15, 1e3),
    "rated_voltage": (1e-3, 1e6),
    "rated_stroke": (1e-12, 1.0),
    "layer_thickness": (1e-9, 1.0),
}
# What to do about a drive's number beyond its limits.
_DRIVE_REMEDY = {
    "bias_v": "give it in volts",
    "idle_v": "give it in volts",
    "phase_deg": "give the phase at the start in degrees",
    "cycles": "give how many periods the drive lasts, or leave it out if it runs on",
}
_PRIOR = (
    "write for example [prior.k_c] with median, factor (a value that may be zero: mean, sd; of a cause also"
    ' probability, alone or with them) and source = "..."'
)
_READ = "read"
_INSTRUMENT = 'write for example under [instruments]: launch_speed_mm_s = "laser"'
_LIMITED = "write for example under [limits]: frequency_hz = [100, 20000], or l = [0.06, 0.12]"
_FACT = "give it in SI units: ohm, F, V, m; leave out what is not known"
_HEADER = re.compile(r"\s*(\[\[?)([^\[\]#]+)\]")
_KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*[\w-]+)*)\s*=""")
_COMMA = re.compile(r"""(?:^|[{,])\s*([\w."'-]+)\s*=\s*([+-]?\d+),(\d+(?:[eE][+-]?\d+)?)\s*(?=$|[,}#])""")
_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,31}")


def id_of(label: str) -> GroupId | None:
    """The id of a group that a label comes to, accents and blanks aside; None where it comes to none."""
    plain = unicodedata.normalize("NFKD", label).encode("ascii", "ignore").decode()
    text = re.sub(r"[^A-Za-z0-9_-]+", "_", plain).strip("_-")
    if text.isdigit():
        return int(text) if str(int(text)) == text and int(text) <= MAX_ID else None
    return text if _ID.fullmatch(text) else None


def _key_lines(text: str) -> dict[tuple[str | int, ...], int]:
    """Line of each table and key, by a light scan: tomllib keeps none.

    It knows tables, arrays of tables and `key =` lines, which is how the format is written; a key
    inside an inline table is reported at the line of the table.
    """
    lines: dict[tuple[str | int, ...], int] = {}
    counts: dict[str, int] = {}
    table: tuple[str | int, ...] = ()
    closing = ""  # the quotes that end the multi-line string we are in
    for number, line in enumerate(text.split("\n"), 1):
        if closing:
            if closing in line:
                closing = ""
            continue
        if header := _HEADER.match(line):
            name, *rest = (part.strip(" \t\"'") for part in header[2].split("."))
            lines.setdefault((name,), number)
            if header[1] == "[[":
                counts[name] = counts.get(name, -1) + 1
            # In a table of an array, that of its last entry.
            table = (name, counts[name], *rest) if name in counts else (name, *rest)
            lines.setdefault(table, number)
        elif key := _KEY.match(line):
            parts = [part.strip(" \t\"'") for part in key[1].split(".")]
            lines.setdefault((*table, *parts), number)
        for quotes in ('"""', "'''"):
            if line.count(quotes) % 2:
                closing = quotes
    return lines


@dataclass(frozen=True)
class DeclaredGroup:
    """A group as it is declared, its file not read yet; that of a trace has its frequency (Hz) and amplitude (V)."""

    id: GroupId
    drive: Drive
    file: str
    path: Path
    changed: tuple[tuple[str, float], ...]
    traced: tuple[float, float] | None = None
    session: GroupId | None = None


class Definition:
    """`experiment.toml`, parsed, with the line of each key.

    Each method raises all faults of its part at once. `faults` holds those of the text itself that do not keep the rest
    from being read.
    """

    def __init__(self, folder: Path, most_bytes: int = 2**20) -> None:
        self.folder = folder
        self.faults = Faults()
        self.file = folder / DEFINITION
        try:
            exists = stat.S_ISREG(self.file.stat().st_mode)
        except PermissionError as error:  # a folder that may not be searched
            raise unreadable(self.file, error, "check the permissions of its folder") from error
        except (OSError, ValueError):  # a NUL in its name
            exists = False
        if not exists:
            raise InputError(
                "no such file",
                "give the folder that holds it, or begin one with psafit new",
                file=self.file,
            )
        text = read_text(self.file, most_bytes, "plain text (UTF-8)")
        try:
            self.data, text = self._parsed(text)
        except RecursionError as error:
            raise InputError(
                "nested too deeply", "use [constants] and [[group]] tables alone", file=self.file
            ) from error
        self.lines = _key_lines(text)

    def _parsed(self, text: str) -> tuple[dict[str, Any], str]:
        """The content, and the text it was read from: decimal commas are kept as faults, and read as points."""
        while True:
            try:
                return tomllib.loads(text), text
            except ValueError as error:  # syntax, or a number of thousands of digits
                place = re.search(r" \((?:at line (\d+), column \d+|at end of document)\)$", str(error))
                message = str(error)[: place.start()] if place else str(error)
                line = int(place[1]) if place and place[1] else text.count("\n") + 1 if place else None
                rows = text.split("\n")
                found = _COMMA.search(rows[line - 1].rstrip("\r")) if line else None
                if line is None or found is None:
                    remedy = "correct the syntax (text in quotes, one key = value a line)"
                    if line and rows[line - 1].split("#")[0].strip() == "[group]":
                        remedy = _BRACKETS
                    if line and re.search(r"\d,\d", rows[line - 1]):
                        remedy = "correct the syntax, and write decimal points, not commas"
                    self.faults.add(InputError(f"not valid TOML: {message}", remedy, file=self.file, line=line))
                    self.faults.end()
                    raise
                name, whole, part = found.groups()
                self.faults.add(
                    InputError(
                        f"not valid TOML: {shown(f'{name} = {whole},{part}')} has a decimal comma",
                        f"write a decimal point: {name[:40]} = {whole[:20]}.{part[:20]}",
                        file=self.file,
                        line=line,
                    )
                )
                row = rows[line - 1]
                rows[line - 1] = f"{row[: found.end(2)]}.{row[found.start(3) :]}"
                text = "\n".join(rows)

    def error(self, what: str, remedy: str, *path: str | int) -> InputError:
        """Error at the line of `path`, or of the nearest table around it."""
        return InputError(what, remedy, file=self.file, line=self._line(*path))

    def _line(self, *path: str | int) -> int | None:
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def unknown_keys(
        self, table: dict[str, Any], known: tuple[str, ...], *path: str | int
    ) -> tuple[list[InputError], set[str]]:
        """Faults of keys that mean nothing, since no typo may pass, and the known keys that they may stand for."""
        found, stands_for = [], set()
        for key in table:
            if key not in known:
                near = near_names(key, known, 1)
                stands_for |= set(near)
                remedy = f"did you mean {near[0]}?" if near else f"known keys: {listed(known)}"
                if near and key.rpartition("_")[0] == near[0].rpartition("_")[0] != "":
                    remedy += " Its name says its unit"
                if path == ("constants",):  # where none may be left out
                    missing = [name for name in known if name not in table]
                    if missing and not set(near) & set(missing):
                        remedy += f"; {listed(missing)} {'is' if len(missing) == 1 else 'are'} missing"
                        stands_for |= set(missing)
                    if key in _GROUP_KEYS:
                        remedy = "is a [[group]] line missing above it?"
                found.append(self.error(f"unknown key {shown(key)}", remedy, *path, key))
        return found, stands_for

    def known_keys(self, table: dict[str, Any], known: tuple[str, ...], *path: str | int) -> None:
        """Refuse keys that mean nothing."""
        faults = Faults()
        for fault in self.unknown_keys(table, known, *path)[0]:
            faults.add(fault)
        faults.end()

    def text(self, key: str, default: str) -> str:
        """One-line text of a top-level key."""
        value = self.data.get(key, default)
        if not isinstance(value, str):
            raise self.error(f"{key} is not text", f'write {key} = "..."', key)
        return one_line(value) or one_line(default)

    def constants(self) -> Constants:
        """The rig's constants, checked."""
        remedy = f"give {listed(_CONSTANTS)} in SI units under [constants]"
        table = self.data.get("constants")
        if not isinstance(table, dict):
            raise self.error("no [constants] table", remedy, "constants")
        if any(key in table for key in _GROUP_KEYS):  # all that follows is in the wrong table
            raise self.unknown_keys({k: v for k, v in table.items() if k in _GROUP_KEYS}, (), "constants")[0][0]
        faults = Faults()
        unknown, stands_for = self.unknown_keys(table, _CONSTANTS, "constants")
        for fault in unknown:
            faults.add(fault)
        missing = [name for name in _CONSTANTS if name not in table and name not in stands_for]
        if missing:
            what = f"constant {missing[0]} is" if len(missing) == 1 else f"constants {listed(missing)} are"
            faults.add(self.error(f"{what} missing", remedy, "constants"))
        values = {}
        for name in _CONSTANTS:
            with faults.kept():
                if name in table:
                    values[name] = self._constant(name, table[name], "constants")
        faults.end()
        return Constants(**values)

    def _constant(self, name: str, value: object, *path: str | int) -> float:
        def error(what: str, remedy: str) -> InputError:
            return self.error(f"constant {name} {what}", remedy, *path, name)

        number = _number(value)
        if number is None:
            raise error("is not a number", f"write {name} = a number, without quotes or unit")
        if not (math.isfinite(number) and number > 0):
            raise error(f"= {number:g} is not positive and finite", "give its value in SI units")
        if said := _beyond(number, LIMITS[name]):
            _, question = doubt(name, number) or ("", "give its value in SI units")
            raise error(said, question)
        return number

    def limits(self) -> tuple[tuple[str, tuple[float, float]], ...]:
        """Least and greatest of what a next experiment may use, in the order of the file."""
        table = self.data.get("limits", {})
        if not isinstance(table, dict):
            raise self.error("limits is no table", _LIMITED, "limits")
        known = (*CONDITION_COLUMNS, *_CONSTANTS)
        faults = Faults()
        with faults.kept():
            self.known_keys(table, (*known, _READ), "limits")
        found = []
        for name, ends in table.items():
            with faults.kept():
                if name in known:
                    found.append((name, self._limit(name, ends)))
        faults.end()
        return tuple(found)

    def readable(self) -> tuple[str, ...]:
        """Columns that a next experiment may read besides what was read; empty for all."""
        table = self.data.get("limits", {})
        if not isinstance(table, dict) or _READ not in table:
            return ()
        known, names, place = [o.column for o in OBSERVABLES], table[_READ], ("limits", _READ)
        if not (isinstance(names, list) and names and all(isinstance(name, str) for name in names)):
            raise self.error(f"{_READ} is no list of columns", f'write for example {_READ} = ["{known[0]}"]', *place)
        if strange := [name for name in names if name not in known]:
            near = did_you_mean(strange[0], known, columns=True)
            raise self.error(f"nothing is read as {shown(strange[0])}", near, *place)
        return tuple(dict.fromkeys(names))

    def instruments(self) -> tuple[tuple[str, str], ...]:
        """Columns that an instrument of their own reads, and its name, in the order of the file."""
        table, columns = self.data.get("instruments", {}), [o.column for o in OBSERVABLES]
        if not isinstance(table, dict):
            raise self.error("instruments is no table", _INSTRUMENT, "instruments")
        faults, found = Faults(), []
        for column, name in table.items():
            with faults.kept():
                if column not in columns:
                    near = did_you_mean(column, columns, columns=True)
                    raise self.error(f"nothing is read as {shown(column)}", near, "instruments", column)
                if not isinstance(name, str) or _ID.fullmatch(name) is None:
                    what = f"{shown(_value_text(name)[:40])} is no name of an instrument"
                    remedy = 'use letters, digits, "-" and "_", at most 32, in quotes: "laser"'
                    raise self.error(what, remedy, "instruments", column)
                found.append((column, name))
        faults.end()
        return tuple(found)

    def _limit(self, name: str, ends: object) -> tuple[float, float]:
        place = ("limits", name)
        numbers = [_number(end) for end in ends] if isinstance(ends, list) else []
        if len(numbers) != 2:
            commas = "write decimal points, not commas; " if len(numbers) == 4 else ""
            raise self.error(f"limits of {name} are not two numbers", commas + _LIMITED, *place)
        hard = (COLUMN_LIMITS | LIMITS)[name]
        low, high = (math.nan if x is None else x for x in numbers)
        if not (0 < low <= high < math.inf and hard[0] <= low and high <= hard[1]):
            what = (
                f"limits of {name} are not two positive numbers, the smaller first, within {hard[0]:g} to {hard[1]:g}"
            )
            raise self.error(what, "give them in the units of the CSV files, or SI", *place)
        return low, high

    def rig(self) -> Rig | None:
        """What the rig is made of; None where there is no such table."""
        if "rig" not in self.data:
            return None
        table, names = self.data["rig"], tuple(f.name for f in fields(Rig))
        if not isinstance(table, dict):
            raise self.error("rig is no table", f"write {listed(names)} under [rig], each optional", "rig")
        faults, facts = Faults(), dict[str, Any]()
        with faults.kept():
            self.known_keys(table, names, "rig")
        for name, value in table.items():
            with faults.kept():
                if name in names:
                    facts[name] = self._material(name, value) if name.endswith("material") else self._fact(name, value)
        faults.end()
        return Rig(**facts)

    def known(self, stated: Sequence[Belief], rig: Rig | None, constants: Constants) -> tuple[Belief, ...]:
        """What is known of parameters: what follows from the rig, and in its place what is stated.

        A stated prior says which values are plausible. What is possible follows from the rig nevertheless, and so does
        whether the cause is at work, where that is not stated as well. A probability alone leaves the values as they
        are.
        """
        followed = [self._placed(b) for b in (rig_beliefs(rig, constants) if rig else ())]
        of = {b.name: b for b in followed}
        both = ((b, b if b.prior is None else of.get(b.name, b)) for b in stated)
        own = [replace(b, probability=b.probability or f.probability, bounds=f.bounds) for b, f in both]
        names = {b.name for b in stated if b.prior is not None}
        return (*(b for b in followed if b.name not in names), *own)

    def _placed(self, belief: Followed) -> Followed:
        """What follows, with the line of the fact that is doubtful, or else of the first."""
        keys = [key for key, value in belief.facts if doubt(key, value)] + [key for key, _ in belief.facts]
        place = "constants" if keys[0] in _CONSTANTS else "rig"
        return replace(belief, file=self.file, line=self._line(place, keys[0]))

    def doubts(self) -> list[InputError]:
        """Constants and facts outside of what such rigs have, for whoever has faults to report anyway."""
        found = []
        for place, limits in (("constants", LIMITS), ("rig", FACT_LIMITS)):
            table = self.data.get(place)
            values = table.items() if isinstance(table, dict) else ()
            for name, number in ((name, _number(value)) for name, value in values if name in limits):
                if number is not None and not _beyond(number, limits[name]) and (said := doubt(name, number)):
                    found.append(self.error(*said, place, name))
        return found

    def jumps(self, groups: Sequence[Conditions], most_at_rest: float = 0.1) -> list[str]:
        """One line for each group with a bias, or a recording that begins off 0 V, that does not say what it rests at.

        Parameters
        ----------
        groups : sequence of Conditions
        most_at_rest : float
            Part of its swing by which a recorded voltage may begin off 0 V, as noise makes it.
        """
        silent = {table["id"] for table in self.data["group"] if "idle_v" not in table}
        found = []
        for group in groups:
            begin, noise = group.drive.bias_v, 0.0
            if group.drive.recorded and (table := group.drive.table):
                begin, noise = float(table.value[0]), most_at_rest * float(np.ptp(table.value))
            if abs(begin) > noise and group.id in silent:
                what = f"the drive jumps from 0 to {begin:g} V at its start"
                remedy = f"does it rest there? Then say idle_v = {begin:g}, else idle_v = 0"
                found.append(f"{DEFINITION}: group {group.id}: {what}; {remedy}")
        return found

    def _material(self, name: str, value: object) -> str:
        if not isinstance(value, str):
            raise self.error(f"{name} is no text", f"write it in quotes: {listed(MATERIALS)}", "rig", name)
        if known := material_named(value):
            return known
        near = did_you_mean(value.casefold(), [*MATERIALS, *ALIASES])
        if value.casefold().startswith(("ceramic", "keramik")):
            near = f"say which: {SEVERAL[name]}"
        raise self.error(f"{name} is {shown(value)}", f"{near}; or leave it out and state [prior.k_c]", "rig", name)

    def _fact(self, name: str, value: object) -> float:
        number = _number(value)
        if number is None or not 0 < number < math.inf:
            raise self.error(f"{name} is not a positive number", _FACT, "rig", name)
        if said := _beyond(number, FACT_LIMITS[name]):
            _, question = doubt(name, number) or ("", _FACT)
            raise self.error(f"{name} {said}", question, "rig", name)
        return number

    def beliefs(self) -> tuple[Belief, ...]:
        """What is said to be known of parameters; whether there are such parameters is not for this file to know."""
        tables = self.data.get("prior", {})
        if not isinstance(tables, dict):
            raise self.error("prior is no table", _PRIOR, "prior")
        faults, found = Faults(), []
        for name, table in tables.items():
            with faults.kept():
                found.append(self._belief(name, table))
        faults.end()
        return tuple(found)

    def _belief(self, name: str, table: object) -> Belief:
        place = ("prior", name)
        if not isinstance(table, dict):
            raise self.error(f"prior of {shown(name)} is no table", _PRIOR, *place)
        self.known_keys(table, ("median", "factor", "mean", "sd", "source", "probability"), *place)
        given = set(table) - {"source", "probability"}
        if given not in ({"median", "factor"}, {"mean", "sd"}) and (given or "probability" not in table):
            raise self.error(f"prior of {shown(name)} gives {listed(sorted(given)) or 'no numbers'}", _PRIOR, *place)
        source = table.get("source")
        if not isinstance(source, str) or not one_line(source):
            raise self.error(f"prior of {shown(name)} has no source", 'write source = "how it is known"', *place)
        numbers, faults = {}, Faults()
        for key in sorted(set(table) - {"source"}):
            with faults.kept():
                numbers[key] = self._belief_number(name, key, table[key])
        faults.end()
        probability = numbers.pop("probability", None)
        prior = None if not given else LogNormal(**numbers) if "median" in numbers else Normal(**numbers)
        return Belief(name, prior, one_line(source), self.file, self._line(*place), probability)

    def _belief_number(self, name: str, key: str, value: object) -> float:
        least = {"median": 0.0, "factor": 1.0, "sd": 0.0, "probability": 0.0}.get(key, -math.inf)
        most = 1.0 if key == "probability" else math.inf
        number = _number(value)
        if number is None or not (math.isfinite(number) and least < number < most):
            what = "a finite number" if math.isinf(least) else f"a finite number above {least:g}"
            what += f" and below {most:g}" if math.isfinite(most) else ""
            raise self.error(f"prior of {shown(name)}: {key} is not {what}", _PRIOR, "prior", name, key)
        return number

    def groups(self, faults: Faults) -> list[DeclaredGroup]:
        """The declared groups, in order; their tables are not read yet. A group with a fault is left out."""
        tables = self.data.get("group", [])
        if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
            raise self.error(
                "group is not an array of tables",
                _BRACKETS,
                "group",
            )
        if not tables:
            raise self.error("no groups", "add a [[group]] with id, waveform and file for each sweep", "group")
        declared: list[DeclaredGroup] = []
        names: set[str] = set()
        files: dict[Path, GroupId] = {}
        for i, table in enumerate(tables):
            with faults.kept():
                group = self._group(i, table)
                if str(group.id) in names:
                    raise self.error(
                        f"group id {group.id} is used twice", "give each group its own id", "group", i, "id"
                    )
                names.add(str(group.id))
                real = group.path.resolve()
                if real in files:
                    raise self.error(
                        f"groups {files[real]} and {group.id} read the same file {shown(group.file)}",
                        "give each group its own file, or its readings count twice",
                        "group",
                        i,
                        "file",
                    )
                files[real] = group.id
                declared.append(group)
        elsewhere = {str(g.id): g.session for g in declared if g.session is not None and str(g.session) != str(g.id)}
        for i, table in enumerate(tables):
            if "session" in table and (there := elsewhere.get(str(table["session"]))) is not None:
                what = f"session {table['session']} is the id of a group that was measured in session {there}"
                faults.add(self.error(what, f"write session = {id_text(there)}", "group", i, "session"))
        # 1 and "1" are one session, called as the group is.
        forms = {str(g.id): g.id for g in declared}
        return [
            g if g.session is None else replace(g, session=forms.setdefault(str(g.session), g.session))
            for g in declared
        ]

    def _group(self, i: int, table: dict[str, Any]) -> DeclaredGroup:
        faults = Faults()
        known = (*_GROUP_KEYS, *_DRIVE_KEYS, *_TRACE_KEYS, "constants", "session")
        unknown, stands_for = self.unknown_keys(table, known, "group", i)
        for fault in unknown:
            faults.add(fault)
        called = f"group {_value_text(table['id'])[:40]}" if "id" in table else f"group number {i + 1}"
        traced = "trace" in table
        needed = ("id", "waveform", *_TRACE_KEYS) if traced else _GROUP_KEYS
        missing = [key for key in needed if key not in table and key not in stands_for]
        if missing:
            what = f"group number {i + 1} has no {', no '.join(missing)}"
            faults.add(self.error(what, f"give {listed(needed)}", "group", i))
        if traced and "file" in table:
            what, remedy = f"{called}: both file and trace", "give launches with file, a trace in a group of its own"
            faults.add(self.error(what, remedy, "group", i, "trace"))
        for key in () if traced else (k for k in CONDITION_COLUMNS if k in table):
            what = f"{called}: {key} is a key of traces; launches have it as a column of their file"
            faults.add(self.error(what, f"leave out {key}, or give trace in the place of file", "group", i, key))
        if "id" in table:
            with faults.kept():
                group_id = self._id(i, table["id"])
        if "waveform" in table and "drive" not in stands_for:
            with faults.kept():
                drive = self._drive(i, called, table)
        key = "trace" if traced else "file"
        if key in table:
            with faults.kept():
                file, path = self._path(i, called, table[key], key)
        condition = []
        for name in CONDITION_COLUMNS if traced else ():
            with faults.kept():
                if name in table:
                    condition.append(self._condition(i, called, name, table[name]))
        with faults.kept():
            changed = self._changed(i, table)
        session = None
        with faults.kept():
            if "session" in table:
                session = self._id(i, table["session"], "session")
        faults.end()
        condition_of = (condition[0], condition[1]) if traced else None
        return DeclaredGroup(group_id, drive, file, path, changed, condition_of, session)

    def _condition(self, i: int, called: str, key: str, value: object) -> float:
        """Frequency or amplitude of a trace."""
        number, (low, high) = _number(value), COLUMN_LIMITS[key]
        if number is None or not low <= number <= high:
            what = f"{called}: {key} is not a number from {low:g} to {high:g}"
            raise self.error(what, f"write {key} = a number, without quotes or unit", "group", i, key)
        return number

    def _id(self, i: int, value: object, key: str = "id") -> GroupId:
        if type(value) is int and 0 <= value <= MAX_ID:
            return value
        if isinstance(value, str) and _ID.fullmatch(value):
            return value
        raise self.error(
            f"{'group id' if key == 'id' else key} {shown(_value_text(value))} cannot be used",
            f"use an integer from 0 to {MAX_ID}, or up to 32 letters, digits, _ or - that do not begin with -",
            "group",
            i,
            key,
        )

    def _drive(self, i: int, called: str, table: dict[str, Any]) -> Drive:
        """The drive of a group."""
        name, faults = self._waveform(i, called, table["waveform"]), Faults()
        numbers: dict[str, float] = {}
        for key in ("bias_v", "idle_v", "phase_deg", "cycles"):
            with faults.kept():
                if key in table:
                    numbers[key] = self._drive_number(i, called, key, table[key])
        rows: Table | None = None
        with faults.kept():
            if name == TABLE:
                rows = self._drive_table(i, called, table.get("drive"))
            elif "drive" in table:
                raise self.error(
                    f'{called}: drive is read with waveform = "{TABLE}" only',
                    f'write waveform = "{TABLE}" if that file is the drive, or leave out drive', "group", i, "drive",
                )  # fmt: skip
        if rows and rows.recorded:
            for key in numbers.keys() & {"bias_v", "phase_deg", "cycles"}:
                what = f"{called}: {key} has no meaning for a recorded voltage, which is taken as it is"
                faults.add(self.error(what, f"leave out {key}", "group", i, key))
        faults.end()
        return Drive(name, **numbers, table=rows, file=str(table["drive"]) if rows else "")

    def _waveform(self, i: int, called: str, value: object) -> str:
        """The waveform, whatever capitals and blanks it is written with."""
        name = value.strip().lower() if isinstance(value, str) else ""
        if name in NAMES:
            return name
        what = f"{called}: unknown waveform {shown(_value_text(value))}"
        raise self.error(what, instead(name), "group", i, "waveform")

    def _drive_number(self, i: int, called: str, key: str, value: object) -> float:
        number = _number(value)
        if number is None:
            raise self.error(
                f"{called}: {key} is not a number", f"write {key} = a number, without quotes or unit", "group", i, key
            )
        low, high = SETTING_LIMITS[key]
        if not low <= number <= high:
            what = f"{called}: {key} = {number:g} is not between {low:g} and {high:g}"
            raise self.error(what, _DRIVE_REMEDY[key], "group", i, key)
        return number

    def _drive_table(self, i: int, called: str, file: object) -> Table:
        """The rows of a drive that stands in a file."""
        if file is None:
            what = f'{called}: waveform "{TABLE}" needs drive'
            raise self.error(what, 'write drive = "name.csv", with phase, level or time_us, voltage_v', "group", i)
        _, path = self._path(i, called, file, "drive")
        return read_drive(path)

    def _changed(self, i: int, table: dict[str, Any]) -> tuple[tuple[str, float], ...]:
        """The constants that were others in one group."""
        place = ("group", i, "constants")
        changed = table.get("constants", {})
        if not isinstance(changed, dict):
            raise self.error("constants is no table", "write for example constants = { l = 0.06 }", *place)
        faults, found = Faults(), []
        with faults.kept():
            self.known_keys(changed, _CONSTANTS, *place)
        for name in _CONSTANTS:
            with faults.kept():
                if name in changed:
                    found.append((name, self._constant(name, changed[name], *place)))
        faults.end()
        return tuple(found)

    def _path(self, i: int, called: str, file: object, key: str = "file") -> tuple[str, Path]:
        """Name and place of a group's file."""
        if not isinstance(file, str) or not file.strip():
            what, remedy = f"{called}: {key} is not a file name", f'write {key} = "name.csv"'
            raise self.error(what, remedy, "group", i, key)

        def error(what: str, remedy: str) -> InputError:
            return self.error(f"{called}: {shown(file)} {what}", remedy, "group", i, key)

        absolute = PurePosixPath(file).is_absolute() or PureWindowsPath(file).anchor != ""
        path = self.folder / file
        try:
            if absolute or not path.resolve().is_relative_to(self.folder.resolve()):
                raise error(
                    "lies outside the experiment folder",
                    "copy it into the folder and name it relative to the folder",
                )
            exists, is_directory, is_file = path.exists(), path.is_dir(), path.is_file()
        except PermissionError as problem:  # in a folder that may not be searched
            raise error(f"cannot be read ({problem.strerror})", "check the permissions of its folder") from problem
        except (OSError, ValueError, RuntimeError) as problem:  # too long, NUL, loop of links
            raise error("cannot be a file name", "give the CSV file a plain name") from problem
        if not exists:
            raise error("does not exist", "correct the name, or add the file to the folder")
        if is_directory:
            raise error("is a directory", "name the CSV file itself")
        if not is_file:
            raise error("is not a regular file", "name a CSV file")
        return file, path


def _beyond(number: float, limits: tuple[float, float]) -> str:
    """What is wrong with a number that lies beyond its hard limits; nothing of others."""
    low, high = limits
    return "" if low <= number <= high else f"= {number:g} is beyond the limits {low:g} to {high:g}"


def _number(value: object) -> float | None:
    """A TOML number, infinite where it is beyond all floats (integers have no limit there); None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _value_text(value: object) -> str:
    """Text of a TOML value of any type, for a message."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int):  # str() of thousands of digits raises
        return str(value) if abs(value) <= 10 * MAX_ID else "an integer out of range"
    return str(value) if isinstance(value, str | float) else type(value).__name__

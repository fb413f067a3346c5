"""Read `experiment.toml`."""

from __future__ import annotations

import difflib
import math
import re
import stat
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from psafit.errors import InputError
from psafit.experiment.records import CONDITION_COLUMNS, DEFINITION, Constants, GroupId, Waveform
from psafit.experiment.table import LIMITS as COLUMN_LIMITS
from psafit.experiment.text import listed, one_line, read_text, shown, unreadable
from psafit.parameters import Belief, LogNormal, Normal

MAX_TOML_BYTES = 1024 * 1024
MAX_ID = 999_999_999
_GROUP_KEYS = ("id", "waveform", "file")
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
_PRIOR = 'write for example [prior.k_c] with median, factor (a value that may be zero: mean, sd) and source = "..."'
_LIMITED = "write for example under [limits]: frequency_hz = [100, 20000], or l = [0.06, 0.12]"
_HEADER = re.compile(r"\s*(\[\[?)([^\[\]#]+)\]")
_KEY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*[\w-]+)*)\s*=""")
_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,31}")


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
class _DeclaredGroup:
    id: GroupId
    waveform: Waveform
    file: str
    path: Path
    changed: tuple[tuple[str, float], ...]


class Definition:
    """`experiment.toml`, parsed, with the line of each key."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
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
        text = read_text(self.file, MAX_TOML_BYTES)
        try:
            self.data = tomllib.loads(text)
        except RecursionError as error:
            raise InputError(
                "nested too deeply", "use [constants] and [[group]] tables alone", file=self.file
            ) from error
        except ValueError as error:  # syntax, or a number of thousands of digits
            place = re.search(r" \((?:at line (\d+), column \d+|at end of document)\)$", str(error))
            message = str(error)[: place.start()] if place else str(error)
            line = text.count("\n") + 1 if place else None
            raise InputError(
                f"not valid TOML: {message}",
                "correct the syntax (text in quotes, one key = value a line)",
                file=self.file,
                line=int(place[1]) if place and place[1] else line,
            ) from error
        self.lines = _key_lines(text)

    def error(self, what: str, remedy: str, *path: str | int) -> InputError:
        """Error at the line of `path`, or of the nearest table around it."""
        return InputError(what, remedy, file=self.file, line=self._line(*path))

    def _line(self, *path: str | int) -> int | None:
        while path and path not in self.lines:
            path = path[:-1]
        return self.lines.get(path)

    def known_keys(self, table: dict[str, Any], known: tuple[str, ...], *path: str | int) -> None:
        """Refuse keys that mean nothing: a typo must not pass silently."""
        for key in table:
            if key not in known:
                near = difflib.get_close_matches(key[:40], known, n=1)
                remedy = f"did you mean {near[0]}?" if near else f"known keys: {listed(known)}"
                if path == ("constants",):  # where none may be left out
                    missing = [name for name in known if name not in table]
                    if missing and not set(near) & set(missing):
                        remedy += f"; {listed(missing)} {'is' if len(missing) == 1 else 'are'} missing"
                    if key in _GROUP_KEYS:
                        remedy = "is a [[group]] line missing above it?"
                raise self.error(f"unknown key {shown(key)}", remedy, *path, key)

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
        self.known_keys(table, _CONSTANTS, "constants")
        for name in _CONSTANTS:
            if name not in table:
                raise self.error(f"constant {name} is missing", remedy, "constants")
        return Constants(**{name: self._constant(name, table[name], "constants") for name in _CONSTANTS})

    def _constant(self, name: str, value: object, *path: str | int) -> float:
        def error(what: str, remedy: str) -> InputError:
            return self.error(f"constant {name} {what}", remedy, *path, name)

        number = _number(value)
        if number is None:
            raise error("is not a number", f"write {name} = a number, without quotes or unit")
        if not (math.isfinite(number) and number > 0):
            raise error(f"= {number:g} is not positive and finite", "give its value in SI units")
        low, high = LIMITS[name]
        if not low <= number <= high:
            raise error(f"= {number:g} is beyond the limits {low:g} to {high:g}", "give its value in SI units")
        return number

    def limits(self) -> tuple[tuple[str, tuple[float, float]], ...]:
        """Least and greatest of what a next experiment may use, in the order of the file."""
        table = self.data.get("limits", {})
        if not isinstance(table, dict):
            raise self.error("limits is no table", _LIMITED, "limits")
        self.known_keys(table, (*CONDITION_COLUMNS, *_CONSTANTS), "limits")
        return tuple((name, self._limit(name, ends)) for name, ends in table.items())

    def _limit(self, name: str, ends: object) -> tuple[float, float]:
        place = ("limits", name)
        numbers = [_number(end) for end in ends] if isinstance(ends, list) else []
        if len(numbers) != 2:
            raise self.error(f"limits of {name} are not two numbers", _LIMITED, *place)
        hard = (COLUMN_LIMITS | LIMITS)[name]
        low, high = (math.nan if x is None else x for x in numbers)
        if not (0 < low <= high < math.inf and hard[0] <= low and high <= hard[1]):
            what = (
                f"limits of {name} are not two positive numbers, the smaller first, within {hard[0]:g} to {hard[1]:g}"
            )
            raise self.error(what, "give them in the units of the CSV files, or SI", *place)
        return low, high

    def beliefs(self) -> tuple[Belief, ...]:
        """What is said to be known of parameters; whether there are such parameters is not for this file to know."""
        tables = self.data.get("prior", {})
        if not isinstance(tables, dict):
            raise self.error("prior is no table", _PRIOR, "prior")
        return tuple(self._belief(name, table) for name, table in tables.items())

    def _belief(self, name: str, table: object) -> Belief:
        place = ("prior", name)
        if not isinstance(table, dict):
            raise self.error(f"prior of {shown(name)} is no table", _PRIOR, *place)
        self.known_keys(table, ("median", "factor", "mean", "sd", "source"), *place)
        given = set(table) - {"source"}
        if given not in ({"median", "factor"}, {"mean", "sd"}):
            raise self.error(f"prior of {shown(name)} has {listed(sorted(given)) or 'no numbers'}", _PRIOR, *place)
        source = table.get("source")
        if not isinstance(source, str) or not one_line(source):
            raise self.error(f"prior of {shown(name)} has no source", 'write source = "how it is known"', *place)
        numbers = {key: self._belief_number(name, key, table[key]) for key in sorted(given)}
        prior = LogNormal(**numbers) if "median" in numbers else Normal(**numbers)
        return Belief(name, prior, one_line(source), self.file, self._line(*place))

    def _belief_number(self, name: str, key: str, value: object) -> float:
        least = {"median": 0.0, "factor": 1.0, "sd": 0.0}.get(key, -math.inf)
        number = _number(value)
        if number is None or not (math.isfinite(number) and number > least):
            what = "a finite number" if math.isinf(least) else f"a finite number above {least:g}"
            raise self.error(f"prior of {shown(name)}: {key} is not {what}", _PRIOR, "prior", name, key)
        return number

    def groups(self) -> list[_DeclaredGroup]:
        """The declared groups, in order; their tables are not read yet."""
        tables = self.data.get("group", [])
        if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
            raise self.error(
                "group is not an array of tables",
                "head each group with [[group]], in double brackets",
                "group",
            )
        if not tables:
            raise self.error("no groups", "add a [[group]] with id, waveform and file for each sweep", "group")
        declared = [self._group(i, table) for i, table in enumerate(tables)]
        names: set[str] = set()
        files: dict[Path, GroupId] = {}
        for i, group in enumerate(declared):
            if str(group.id) in names:
                raise self.error(
                    f"group id {group.id} is used twice",
                    "give each group its own id",
                    "group",
                    i,
                    "id",
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
        return declared

    def _group(self, i: int, table: dict[str, Any]) -> _DeclaredGroup:
        self.known_keys(table, (*_GROUP_KEYS, "constants"), "group", i)
        for key in _GROUP_KEYS:
            if key not in table:
                raise self.error(f"group number {i + 1} has no {key}", f"give {listed(_GROUP_KEYS)}", "group", i)
        group_id, waveform, file = (table[key] for key in _GROUP_KEYS)
        valid_int = type(group_id) is int and 0 <= group_id <= MAX_ID
        if not valid_int and not (isinstance(group_id, str) and _ID.fullmatch(group_id)):
            raise self.error(
                f"group id {shown(_value_text(group_id))} cannot be used",
                f"use an integer from 0 to {MAX_ID}, or up to 32 letters, digits, _ or - that do not begin with -",
                "group",
                i,
                "id",
            )
        if waveform not in ("sine", "square"):
            raise self.error(
                f"group {group_id}: unknown waveform {shown(_value_text(waveform))}",
                'write "sine" or "square"',
                "group",
                i,
                "waveform",
            )
        if not isinstance(file, str) or not file.strip():
            raise self.error(
                f"group {group_id}: file is not a file name",
                'write file = "name.csv"',
                "group",
                i,
                "file",
            )
        return _DeclaredGroup(group_id, waveform, file, self._path(i, group_id, file), self._changed(i, table))

    def _changed(self, i: int, table: dict[str, Any]) -> tuple[tuple[str, float], ...]:
        """The constants that were others in one group."""
        place = ("group", i, "constants")
        changed = table.get("constants", {})
        if not isinstance(changed, dict):
            raise self.error("constants is no table", "write for example constants = { l = 0.06 }", *place)
        self.known_keys(changed, _CONSTANTS, *place)
        return tuple((name, self._constant(name, changed[name], *place)) for name in _CONSTANTS if name in changed)

    def _path(self, i: int, group_id: GroupId, file: str) -> Path:
        def error(what: str, remedy: str) -> InputError:
            return self.error(f"group {group_id}: {shown(file)} {what}", remedy, "group", i, "file")

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
        return path


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

"""Tables whose groups have recordings of their own: which recording belongs to which group."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from psafit.errors import Faults, InputError
from psafit.experiment.definition import id_of
from psafit.experiment.importing.recorded import ALL
from psafit.experiment.importing.records import Table, file_of
from psafit.experiment.records import Group
from psafit.experiment.text import listed, shown
from psafit.text import count


def in_folders(given: Iterable[Path]) -> list[Path]:
    """Return files, and those in folders, by name.

    Raises
    ------
    InputError
        Where a folder is empty, or two have one name: they would be one file of the experiment.
    """
    found: list[Path] = []
    for place in given:
        if not place.is_dir():
            found.append(place)
        elif inside := sorted(file for file in place.iterdir() if file.is_file() and not file.name.startswith(".")):
            found += inside
        else:
            raise InputError("the folder holds no file", "give one with recordings", file=place)
    names = [str(id_of(drive.stem) or _plain(drive.stem)).casefold() for drive in found]
    if twice := [drive for drive, name in zip(found, names, strict=True) if names.count(name) > 1]:
        raise InputError(f"two recordings of --drive are called {shown(twice[0].stem)}", "rename one", file=twice[0])
    return found


BY_COLUMN = "say --column HEADING=group of a column that names the recordings"


def called(names: Iterable[str], drives: Sequence[Path], file: Path, *, otherwise: str = "") -> dict[str, Path]:
    """Return the drive of each name, which is that of its file, with the ending or without.

    Parameters
    ----------
    names : iterable of str
    drives : sequence of Path
    file : Path
        Whose names they are.
    otherwise : str
        What may be done instead of adding a recording.

    Raises
    ------
    InputError
        For each name that no drive has.
    """
    known = {_plain(text): drive for drive in drives for text in (drive.stem, drive.name)}
    faults, asked = Faults(), dict.fromkeys(names)
    for name in asked:
        if _plain(name) not in known:
            wanted = name if name.endswith(drives[0].suffix) else name + drives[0].suffix
            remedy = f"add {shown(wanted)}" + (f", or {otherwise}" if otherwise else "")
            faults.add(InputError(f"no recording of --drive is called {shown(name)}", remedy, file=file))
    faults.end()
    return {name: known[_plain(name)] for name in asked}


def all_used(used: Iterable[Path], drives: Sequence[Path]) -> None:
    """Refuse recordings that no group has."""
    names = [shown(drive.name) for drive in drives if drive not in {*used}]
    if names:
        what = f"{count(len(names), 'recording')} of --drive has no group: {listed(names[:3])}"
        raise InputError(what, "leave out, or take out of the folder, what has none")


def by_label(reads: Sequence[Sequence[Table]], drives: Sequence[Path]) -> list[Table]:
    """Return tables each of whose groups has the drive that is called as its label is, or as its file.

    Parameters
    ----------
    reads : sequence of sequence of Table
        The same tables, read with each drive for all groups.
    drives : sequence of Path
    """
    found: list[Table] = []
    used: list[Path] = []
    for number, table in enumerate(reads[0]):
        # A drive of another file was recorded next to a trace.
        name = {
            k: label or table.file.stem for k, (g, label) in enumerate(table.labelled_groups) if g.drive.file == ALL
        }
        drive_of = called(name.values(), drives, table.file)
        groups, recordings = list(table.groups), []
        for k, drive in ((k, drive_of[label]) for k, label in name.items()):
            read = reads[drives.index(drive)]
            groups[k] = _with(drive, drives, read[number].groups[k])
            recordings += [] if drive in used else [one for tables in read for one in tables.recordings]
            used.append(drive)
        found.append(replace(table, groups=tuple(groups), recordings=tuple(recordings)))
    all_used(used, drives)
    return found


def of_files(reads: Sequence[Sequence[Table]], drives: Sequence[Path]) -> list[Table]:
    """Return the tables of several files, each read with its own drive; their groups count from 1."""
    found: list[Table] = []
    for tables, drive in zip(reads, drives, strict=True):
        for table in tables:
            first = sum(len(before.groups) for before in found) + 1
            groups = (replace(g, id=k, file=file_of(k)) for k, g in enumerate(table.groups, first))
            own = tuple(_with(drive, drives, g) if g.drive.file == ALL else g for g in groups)
            found.append(replace(table, groups=own))
    return found


def _plain(text: str) -> str:
    return unicodedata.normalize("NFC", text).strip().casefold()


def _with(drive: Path, drives: Sequence[Path], group: Group) -> Group:
    """A group whose drive is a file of its own, named like the recording where any system takes that name."""
    name = id_of(drive.stem)
    file = f"drive-{name}.csv" if isinstance(name, str) else f"drive-{drives.index(drive) + 1}.csv"
    return replace(group, drive=replace(group.drive, file=file))


__all__ = ["BY_COLUMN", "all_used", "by_label", "called", "in_folders", "of_files"]

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


def called(names: Sequence[str], drives: Sequence[Path], file: Path) -> list[Path]:
    """Return the drive that each name is that of, with the file's ending or without.

    Raises
    ------
    InputError
        For each name that no drive has.
    """
    known = {_plain(text): drive for drive in drives for text in (drive.stem, drive.name)}
    faults = Faults()
    for name in dict.fromkeys(names):
        if _plain(name) not in known:
            wanted = name if name.endswith(drives[0].suffix) else name + drives[0].suffix
            faults.add(
                InputError(f"no recording of --drive is called {shown(name)}", f"add {shown(wanted)}", file=file)
            )
    faults.end()
    return [known[_plain(name)] for name in names]


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
    found, free = [], list(drives)
    for number, table in enumerate(reads[0]):
        lacking = [g.drive.file == ALL for g in table.groups]  # others were recorded next to a trace
        labels = [
            label or table.file.stem for (_, label), lacks in zip(table.labelled_groups, lacking, strict=True) if lacks
        ]
        own = iter(called(labels, drives, table.file))
        groups, recordings = [], []
        for k, group in enumerate(table.groups):
            if not lacking[k]:
                groups.append(group)
                continue
            drive = next(own)
            read = reads[drives.index(drive)]
            groups.append(_with(drive, drives, read[number].groups[k]))
            if drive in free:
                recordings += [one for tables in read for one in tables.recordings]
                free.remove(drive)
        found.append(replace(table, groups=tuple(groups), recordings=tuple(recordings)))
    all_used([drive for drive in drives if drive not in free], drives)
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


__all__ = ["all_used", "by_label", "called", "in_folders", "of_files"]

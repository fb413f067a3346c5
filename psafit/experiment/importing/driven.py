"""Tables whose groups have recordings of their own: which recording belongs to which group."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from psafit.errors import Faults, InputError
from psafit.experiment.importing.recorded import ALL
from psafit.experiment.importing.records import Table, file_of
from psafit.experiment.records import Group
from psafit.experiment.text import listed, shown
from psafit.text import count


def in_folders(given: Iterable[Path]) -> list[Path]:
    """Files, and those in folders, by name."""
    found: list[Path] = []
    for place in given:
        if not place.is_dir():
            found.append(place)
        elif inside := sorted(file for file in place.iterdir() if file.is_file() and not file.name.startswith(".")):
            found += inside
        else:
            raise InputError("the folder holds no file", "give one with recordings", file=place)
    return found


def named_apart(drives: Sequence[Path]) -> None:
    """Refuse recordings of one name: they would be one file of the experiment."""
    stems = [drive.stem.casefold() for drive in drives]
    if twice := [drive for drive, stem in zip(drives, stems, strict=True) if stems.count(stem) > 1]:
        raise InputError(f"two recordings of --drive are called {shown(twice[0].stem)}", "rename one", file=twice[0])


def by_label(reads: Sequence[Sequence[Table]], drives: Sequence[Path]) -> list[Table]:
    """Return tables each of whose groups has the drive whose file is called as its label is.

    Parameters
    ----------
    reads : sequence of sequence of Table
        The same tables, read with each drive for all groups.
    drives : sequence of Path

    Raises
    ------
    InputError
        Where a group has no drive, or a drive no group.
    """
    called = {drive.stem.casefold(): k for k, drive in enumerate(drives)}
    found, faults, free = [], Faults(), set(range(len(drives)))
    for number, table in enumerate(reads[0]):
        groups, recordings = [], []
        for k, (group, label) in enumerate(table.labelled_groups):
            which = called.get(label.strip().casefold())
            if group.drive.file != ALL:  # it was recorded next to a trace
                groups.append(group)
            elif which is None:
                remedy = f"name the recording {shown(label + drives[0].suffix)}"
                faults.add(InputError(f"no recording of --drive is called {shown(label)}", remedy, file=table.file))
            else:
                groups.append(_with(drives[which], reads[which][number].groups[k]))
                recordings += [one for read in reads[which] for one in read.recordings if which in free]
                free.discard(which)
        found.append(replace(table, groups=tuple(groups), recordings=tuple(recordings)))
    faults.end()
    if free:
        names = listed([shown(drives[k].name) for k in sorted(free)][:3])
        raise InputError(f"{count(len(free), 'recording')} of --drive has no group: {names}", "leave out what has none")
    return found


def in_order(reads: Sequence[Sequence[Table]], drives: Sequence[Path]) -> list[Table]:
    """Return tables of several files, each read with its own drive; their groups count from 1."""
    found: list[Table] = []
    for tables, drive in zip(reads, drives, strict=True):
        for table in tables:
            first = sum(len(before.groups) for before in found) + 1
            groups = (replace(g, id=k, file=file_of(k)) for k, g in enumerate(table.groups, first))
            found.append(replace(table, groups=tuple(_with(drive, g) if g.drive.file == ALL else g for g in groups)))
    return found


def _with(drive: Path, group: Group) -> Group:
    """A group whose drive is a file of its own."""
    return replace(group, drive=replace(group.drive, file=f"drive-{drive.stem}.csv"))


__all__ = ["by_label", "in_folders", "in_order", "named_apart"]

"""Tables whose groups have recordings of their own: which recording belongs to which group."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from psafit.errors import Faults, InputError
from psafit.experiment.importing.recorded import ALL
from psafit.experiment.importing.records import Table
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


def joined(reads: Sequence[Sequence[Table]], drives: Sequence[Path]) -> list[Table]:
    """Return tables each of whose groups has its own drive.

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
    stems = [drive.stem.casefold() for drive in drives]
    if twice := [drive for drive, stem in zip(drives, stems, strict=True) if stems.count(stem) > 1]:
        raise InputError(f"two recordings of --drive are called {shown(twice[0].stem)}", "rename one", file=twice[0])
    found, faults, free = [], Faults(), set(range(len(drives)))
    for number, table in enumerate(reads[0]):
        groups, recordings = [], []
        for k, (group, label) in enumerate(table.labelled_groups):
            if group.drive.file != ALL:  # it was recorded next to a trace
                groups.append(group)
                continue
            which = _called(label, drives) if label else number if len(reads[0]) == len(drives) else None
            if which is None:
                faults.add(_without(label, table, len(reads[0]), drives))
                continue
            own = replace(reads[which][number].groups[k].drive, file=f"drive-{drives[which].stem}.csv")
            groups.append(replace(group, drive=own))
            recordings += [one for read in reads[which] for one in read.recordings if which in free]
            free.discard(which)
        found.append(replace(table, groups=tuple(groups), recordings=tuple(recordings)))
    faults.end()
    if free:
        names = listed([shown(drives[k].name) for k in sorted(free)][:3])
        raise InputError(f"{count(len(free), 'recording')} of --drive has no group: {names}", "leave out what has none")
    return found


def _called(label: str, drives: Sequence[Path]) -> int | None:
    """The drive whose file is called as a label is."""
    return next((k for k, drive in enumerate(drives) if drive.stem.casefold() == label.strip().casefold()), None)


def _without(label: str, table: Table, n_tables: int, drives: Sequence[Path]) -> InputError:
    """What is wrong where a group has no drive of its own among several."""
    if label:
        what = f"no recording of --drive is called {shown(label)}"
        return InputError(what, f"name the recording {shown(label + drives[0].suffix)}", file=table.file)
    what = f"{len(drives)} recordings of --drive and {count(n_tables, 'table')}, without labels"
    remedy = (
        "give one for each file in their order, or say --column HEADING=group of a column with the recordings' names"
    )
    return InputError(what, remedy, file=table.file)


__all__ = ["in_folders", "joined"]

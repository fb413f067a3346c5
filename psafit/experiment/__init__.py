"""Read and check measurements.

The reader trusts nothing: whatever bytes an experiment folder holds, the outcome is a checked
`Experiment` or one `InputError` that names file, line and remedy. Values that are possible but look
like a wrong unit are kept, and named in `Experiment.warnings`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment.definition import DeclaredGroup, Definition
from psafit.experiment.plausible import (
    copied_groups,
    disagreeing_groups,
    doubtful_instruments,
    left_from_example,
    rescaled_groups,
    suspicious_constants,
    suspicious_facts,
    suspicious_readings,
    traced_together,
)
from psafit.experiment.records import (
    CONSTANT_UNITS,
    DEFINITION,
    Conditions,
    Constants,
    Experiment,
    Group,
    GroupId,
    Occasions,
    Swept,
    by_group,
    by_part,
    changes_text,
    describe,
    fingerprint,
    is_one_of,
    known_sessions,
    read_as,
    session_name,
    sessions_of,
)
from psafit.experiment.rig import Rig
from psafit.experiment.table import read_csv, readings_of
from psafit.experiment.text import unreadable
from psafit.experiment.trace_table import read_trace
from psafit.experiment.writer import write_experiment
from psafit.parameters import Belief

__all__ = [
    "CONSTANT_UNITS",
    "DEFINITION",
    "Conditions",
    "Constants",
    "Experiment",
    "Group",
    "GroupId",
    "Occasions",
    "Plan",
    "Swept",
    "by_group",
    "by_part",
    "changes_text",
    "describe",
    "fingerprint",
    "is_one_of",
    "known_sessions",
    "read_as",
    "read_experiment",
    "read_plan",
    "session_name",
    "sessions_of",
    "write_experiment",
]


def read_experiment(folder: str | Path) -> Experiment:
    """Read an experiment folder and check every value in it.

    Parameters
    ----------
    folder : path-like
        Folder that holds `experiment.toml` and the CSV files it names.

    Returns
    -------
    Experiment
        Frozen; its arrays are read-only, its rows in the order of the files.

    Raises
    ------
    InputError
        On anything unusable: a line for each fault with file, line where there is one, and remedy.
    """
    folder = Path(folder)
    plan, source, jumps = _read(folder, planned=False)
    title, constants = plan.title, plan.constants
    groups = tuple(g for g in plan.groups if isinstance(g, Group))
    rigs = dict.fromkeys([constants, *(g.rig(constants) for g in groups)])
    warnings = () if source else (f"{DEFINITION}: no source; say where the measurements come from",)
    return Experiment(
        title=title,
        source=source,
        constants=constants,
        groups=groups,
        folder=folder,
        fingerprint=fingerprint(constants, groups),
        limits=plan.limits,
        beliefs=plan.beliefs,
        rig=plan.rig,
        readable=plan.readable,
        warnings=(
            *warnings,
            *left_from_example(title, source, constants, groups),
            *dict.fromkeys(line for rig in rigs for line in suspicious_constants(rig)),
            *(suspicious_facts(plan.rig, constants, groups, plan.beliefs) if plan.rig else ()),
            *(line for group in groups for line in suspicious_readings(group, group.rig(constants))),
            *jumps,
            *copied_groups(groups),
            *disagreeing_groups(groups),
            *rescaled_groups(groups),
            *traced_together(groups),
            *doubtful_instruments(groups),
        ),
    )


@dataclass(frozen=True)
class Plan:
    """What an experiment folder says before anything is read: rig, conditions, what is known beforehand.

    Parameters
    ----------
    constants : Constants
    groups : tuple of Conditions
        A `Group` where there are readings.
    beliefs : tuple of Belief
    limits : tuple of (str, (float, float))
        What a next experiment may use.
    title : str
    rig : Rig, optional
        What it is made of; `beliefs` has what follows from it.
    readable : tuple of str
        Columns that a next experiment may read besides what was read; empty for all.
    """

    constants: Constants
    groups: tuple[Conditions, ...]
    beliefs: tuple[Belief, ...]
    limits: tuple[tuple[str, tuple[float, float]], ...] = ()
    title: str = ""
    rig: Rig | None = None
    readable: tuple[str, ...] = ()

    def with_readings(self, reading: FloatArray, source: str) -> Experiment:
        """An experiment of these conditions whose readings, (n_points,), one group after the other, come from `source`.

        It has no folder yet.
        """
        groups = read_as(self.groups, reading)
        known = fingerprint(self.constants, groups)
        title = f"{self.title.removesuffix(' (simulated)')} (simulated)"
        own = {name: getattr(self, name) for name in ("limits", "beliefs", "rig", "readable")}
        return Experiment(title, source, self.constants, groups, Path(), known, **own)


def read_plan(folder: str | Path) -> Plan:
    """Read an experiment folder for its conditions: groups whose files hold no readings are planned.

    Parameters
    ----------
    folder : path-like
        As of `read_experiment`, but CSV files need no column of readings.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        On anything unusable.
    """
    return _read(Path(folder), planned=True)[0]


def _read(folder: Path, *, planned: bool) -> tuple[Plan, str, list[str]]:
    """What an experiment folder holds, its source, and drives that jump; all faults that do not follow from others."""
    definition = _definition(folder)
    faults = definition.faults
    data = definition.data
    with faults.kept():
        definition.known_keys(data, ("title", "source", "constants", "group", "prior", "limits", "rig", "instruments"))
    if not {"constants", "group"} <= data.keys():
        faults.end()  # one of them, misspelt
    with faults.kept():
        constants = definition.constants()
    if not isinstance(data.get("constants"), dict) or "group" not in data:
        faults.end()  # what else there is, if anything, is in the wrong table
    with faults.kept():
        title = definition.text("title", folder.resolve().name)
    with faults.kept():
        source = definition.text("source", "")
    with faults.kept():
        limits = definition.limits()
    with faults.kept():
        readable = definition.readable()
    with faults.kept():
        stated = definition.beliefs()
    with faults.kept():
        rig = definition.rig()
    groups = []
    instruments: tuple[tuple[str, str], ...] = ()
    with faults.kept():
        instruments = definition.instruments()
    with faults.kept():
        for declared in definition.groups(faults):
            with faults.kept():
                groups.append(_sweep(declared, instruments, planned=planned))
    if len(faults):
        for fault in definition.doubts():
            faults.add(fault)
    faults.end()
    known = definition.known(stated, rig, constants)
    plan = Plan(constants, tuple(groups), known, limits, title, rig, readable)
    return plan, source, definition.jumps(groups)


def _sweep(declared: DeclaredGroup, instruments: tuple[tuple[str, str], ...], *, planned: bool) -> Conditions:
    """A declared group with the columns of its file: a `Group` where there are readings."""
    if declared.traced:
        held = read_trace(declared.path, *declared.traced, planned=planned)
    else:
        held = readings_of(read_csv(declared.path, planned=planned))
    kind = Group if "reading" in held else Conditions
    held |= {"session": declared.session, "instruments": instruments}
    return kind(declared.id, declared.drive, declared.file, changed=declared.changed, **held)


def _definition(folder: Path) -> Definition:
    try:
        is_folder, is_file = folder.is_dir(), folder.is_file()
    except PermissionError as error:  # it lies in a folder that may not be searched
        raise unreadable(folder, error, "check the permissions of the folders above it") from error
    except (OSError, ValueError):  # a name too long, or with a NUL
        is_folder = is_file = False
    if is_file:
        remedy = "give the folder that holds it" if folder.name == DEFINITION else "psafit import makes a folder of it"
        raise InputError("this is a file", remedy, file=folder)
    if not is_folder:
        raise InputError("no such experiment folder", f"give a folder that holds {DEFINITION}", file=folder)
    return Definition(folder)

"""Read and check measurements.

The reader trusts nothing: whatever bytes an experiment folder holds, the outcome is a checked
`Experiment` or one `InputError` that names file, line and remedy. Values that are possible but look
like a wrong unit are kept, and named in `Experiment.warnings`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment.definition import Definition
from psafit.experiment.plausible import left_from_example, suspicious_constants, suspicious_readings
from psafit.experiment.records import (
    CONSTANT_UNITS,
    DEFINITION,
    Conditions,
    Constants,
    Experiment,
    Group,
    GroupId,
    Waveform,
    by_group,
    changes_text,
    describe,
    fingerprint,
    read_as,
    session_name,
)
from psafit.experiment.table import read_csv
from psafit.experiment.text import unreadable
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
    "Plan",
    "Waveform",
    "by_group",
    "changes_text",
    "describe",
    "fingerprint",
    "read_as",
    "read_experiment",
    "read_plan",
    "session_name",
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
        On anything unusable: one line with file, line where there is one, and remedy.
    """
    folder = Path(folder)
    definition = _definition(folder)
    title = definition.text("title", folder.resolve().name)
    source = definition.text("source", "")
    constants = definition.constants()
    groups = tuple(Group(d.id, d.waveform, d.file, changed=d.changed, **read_csv(d.path)) for d in definition.groups())
    rigs = dict.fromkeys([constants, *(g.rig(constants) for g in groups)])
    warnings = () if source else (f"{DEFINITION}: no source; say where the measurements come from",)
    return Experiment(
        title=title,
        source=source,
        constants=constants,
        groups=groups,
        folder=folder,
        fingerprint=fingerprint(constants, groups),
        limits=definition.limits(),
        beliefs=definition.beliefs(),
        warnings=(
            *warnings,
            *left_from_example(title, source, constants, groups),
            *dict.fromkeys(line for rig in rigs for line in suspicious_constants(rig)),
            *(line for group in groups for line in suspicious_readings(group, group.rig(constants))),
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
    """

    constants: Constants
    groups: tuple[Conditions, ...]
    beliefs: tuple[Belief, ...]
    limits: tuple[tuple[str, tuple[float, float]], ...] = ()
    title: str = ""

    def with_readings(self, launch_range_um: FloatArray, source: str) -> Experiment:
        """An experiment of these conditions whose readings, (n_points,), one group after the other, come from `source`.

        It has no folder yet.
        """
        groups = read_as(self.groups, launch_range_um)
        known = fingerprint(self.constants, groups)
        title = f"{self.title.removesuffix(' (simulated)')} (simulated)"
        return Experiment(
            title, source, self.constants, groups, Path(), known, limits=self.limits, beliefs=self.beliefs
        )


def read_plan(folder: str | Path) -> Plan:
    """Read an experiment folder for its conditions: groups whose files hold no readings are planned.

    Parameters
    ----------
    folder : path-like
        As of `read_experiment`, but CSV files need no column ``launch_range_um``.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        On anything unusable.
    """
    folder = Path(folder)
    definition = _definition(folder)
    title = definition.text("title", folder.resolve().name)
    constants = definition.constants()
    groups = []
    for declared in definition.groups():
        columns = read_csv(declared.path, planned=True)
        kind = Group if "launch_range_um" in columns else Conditions
        names = {f.name for f in fields(kind)}
        held = {name: column for name, column in columns.items() if name in names}
        groups.append(kind(declared.id, declared.waveform, declared.file, changed=declared.changed, **held))
    return Plan(constants, tuple(groups), definition.beliefs(), definition.limits(), title)


def _definition(folder: Path) -> Definition:
    try:
        is_folder = folder.is_dir()
        is_definition = folder.name == DEFINITION and folder.is_file()
    except PermissionError as error:  # it lies in a folder that may not be searched
        raise unreadable(folder, error, "check the permissions of the folders above it") from error
    except (OSError, ValueError):  # a name too long, or with a NUL
        is_folder = is_definition = False
    if is_definition:
        raise InputError("this is a file", "give the folder that holds it", file=folder)
    if not is_folder:
        raise InputError("no such experiment folder", f"give a folder that holds {DEFINITION}", file=folder)
    definition = Definition(folder)
    definition.known_keys(definition.data, ("title", "source", "constants", "group", "prior", "limits"))
    return definition

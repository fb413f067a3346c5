"""What an experiment is, once read: frozen records with checked, read-only arrays."""

from __future__ import annotations

import hashlib
import math
import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.drives import Drive, span_of
from psafit.errors import InputError
from psafit.experiment.rig import Rig, lacking
from psafit.experiment.text import listed, one_line, shown
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, OF_LAUNCHES, Observable
from psafit.parameters import Belief

GroupId = int | str
Swept = Literal["frequency", "amplitude", "time"]

DEFINITION = "experiment.toml"
# A setting that drifts by less than this (relative) was meant to be held.
_HELD = 0.02
# Conditions of a sweep that is filled, and how many may come between two of its own.
_FILLED, _BETWEEN = 150, 8
CONDITION_COLUMNS = ("frequency_hz", "amplitude_v")
READING_COLUMNS = tuple(o.column for o in OF_LAUNCHES)
SIGMA_COLUMNS = tuple(dict.fromkeys(o.sigma_column for o in OF_LAUNCHES))
CONSTANT_UNITS = {"M": "kg", "m": "kg", "q": "m/V", "l": "m", "k_s": "N/m", "g": "m/s^2"}


@dataclass(frozen=True)
class Constants:
    """Known constants of the rig, SI units (Table 3 of the study).

    Parameters
    ----------
    M : float, kg
        Ball.
    m : float, kg
        Stack.
    q : float, m/V
        Free stroke per volt.
    l : float, m
        String.
    k_s : float, N/m
        Stack stiffness.
    g : float, m/s^2
        Gravity.
    """

    M: float
    m: float
    q: float
    l: float
    k_s: float
    g: float

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"constant {f.name} must be positive and finite, got {value}")


@dataclass(frozen=True, eq=False)  # arrays have no single truth value; compare fingerprints
class Conditions:
    """One sweep, measured or planned; arrays have shape (n_points,) and are read-only.

    Parameters
    ----------
    id : int or str
        Name of the group; 1 and "1" are the same group.
    drive : Drive
        Drive voltage; the name of a waveform stands for that one with nothing changed.
    file : str
        CSV file, relative to the experiment folder.
    frequency_hz, amplitude_v : (n_points,) array, Hz, V
        Drive frequency (> 0) and amplitude (>= 0).
    changed : tuple of (str, float)
        Constants of the rig that were others in this sweep, SI, in the order of `Constants`.
    sigma : (n_points,) array, optional
        Known standard uncertainty of each reading, in its unit; zero where a reading states none.
    measured : (n_points,) int array, optional
        What is read, or is to be, as `psafit.observables.OBSERVABLES` counts; launch ranges by default.
    row : (n_points,) int array, optional
        Row of the file that each reading stands in: those of one launch share it. By default each has its own.
    time_us : (n_points,) array, us, optional
        Of the samples of a trace, from the start of the drive; none where launches as a whole are read.
    session : int or str, optional
        The occasion on which it was measured, where others were measured on it, too: a name, or another group's id.
    instruments : tuple of (str, str), optional
        Columns that an instrument of their own reads, and its name; what reads the others is one instrument.

    Raises
    ------
    ValueError
        If the arrays differ in length, are empty, or hold an impossible value.
    """

    id: GroupId
    drive: Drive
    file: str
    frequency_hz: FloatArray
    amplitude_v: FloatArray
    changed: tuple[tuple[str, float], ...] = field(default=(), kw_only=True)
    sigma: FloatArray | None = field(default=None, kw_only=True)
    measured: NDArray[np.int8] = field(default_factory=lambda: np.zeros(0, np.int8), kw_only=True)
    row: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, np.intp), kw_only=True)
    time_us: FloatArray | None = field(default=None, kw_only=True)
    session: GroupId | None = field(default=None, kw_only=True)
    instruments: tuple[tuple[str, str], ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "drive", Drive.of(self.drive))
        for name in (*CONDITION_COLUMNS, "reading", "sigma", "time_us"):
            given = getattr(self, name, None)
            if given is None and name not in CONDITION_COLUMNS:
                continue
            array = np.array(given, dtype=np.float64)
            if array.ndim != 1 or array.size == 0 or array.shape != np.shape(self.frequency_hz):
                raise ValueError(f"group {self.id}: {name} has shape {array.shape}")
            positive = name == "frequency_hz"
            signed = name == "reading" and self.time_us is not None
            if not np.all(np.isfinite(array) & (signed | ((array > 0) if positive else (array >= 0)))):
                sign = "positive" if positive else "non-negative"
                raise ValueError(f"group {self.id}: {name} must be finite and {sign}")
            self._keep(name, array)
        n = np.size(self.frequency_hz)
        self._keep("measured", np.array(self.measured if self.measured.size else np.zeros(n), np.int8))
        self._keep("row", np.array(self.row if self.row.size else np.arange(n), np.intp))
        if self.measured.shape != (n,) or self.row.shape != (n,):
            raise ValueError(f"group {self.id}: measured and row must have {n} entries")

    def _keep(self, name: str, array: NDArray[Any]) -> None:
        array.setflags(write=False)
        object.__setattr__(self, name, array)

    def at(self, rows: Any) -> Self:
        """Some of its readings; `rows` indexes an array."""
        names = ("frequency_hz", "amplitude_v", "reading", "sigma", "measured", "row", "time_us")
        held = {name: array for name in names if (array := getattr(self, name, None)) is not None}
        return replace(self, **{name: array[rows] for name, array in held.items()})

    @property
    def volts(self) -> tuple[float, float]:
        """The least and the greatest voltage of all its launches, V."""
        drive = self.drive
        if drive.table is not None and drive.recorded:
            reached = [drive.idle_v, float(drive.table.value.min()), float(drive.table.value.max())]
            return min(reached), max(reached)
        reached = [drive.idle_v, *(drive.bias_v + level * float(self.amplitude_v.max()) for level in span_of(drive))]
        return min(reached), max(reached)

    @property
    def driven(self) -> NDArray[np.bool_]:
        """Which launches have a voltage that leaves rest, (n,)."""
        if self.drive.recorded:
            return np.full(self.amplitude_v.shape, any(v != self.drive.idle_v for v in self.volts))
        return (self.amplitude_v > 0) | (self.drive.bias_v != self.drive.idle_v)

    @property
    def floor(self) -> float:
        """Smallest reading possible: zero, of launches; none, along a trace."""
        return 0.0 if self.time_us is None else -math.inf

    @property
    def observables(self) -> tuple[Observable, ...]:
        """What is read, or is to be."""
        return tuple(OBSERVABLES[k] for k in np.unique(self.measured))

    @property
    def observable(self) -> Observable:
        """What is read, of a group that is one of `parts`."""
        return self.observables[0]

    @property
    def label(self) -> str:
        """The group's id, and what is read where that is not the launch range alone."""
        others = [o.title for o in self.observables if o is not LAUNCH_RANGE]
        return f"{self.id} ({' and '.join(others)})" if others else str(self.id)

    @property
    def parts(self) -> tuple[Self, ...]:
        """The readings of each observable, as groups of their own; itself where there is one."""
        kinds = np.unique(self.measured)
        return (self,) if kinds.size == 1 else tuple(self.at(self.measured == k) for k in kinds)

    @property
    def session_id(self) -> GroupId:
        """The occasion on which it was measured: its own id, where it had one for itself."""
        return self.id if self.session is None else self.session

    @property
    def instrument(self) -> str | None:
        """Name of what reads a group that is one of `parts`; None where it reads all that no other one does."""
        return dict(self.instruments).get(self.observable.column)

    @property
    def named_instruments(self) -> tuple[tuple[str, str], ...]:
        """Those of the columns that are read here, in the order of the observables."""
        of = dict(self.instruments)
        return tuple((o.column, of[o.column]) for o in self.observables if o.column in of)

    @property
    def readers(self) -> dict[int, GroupId]:
        """What reads each observable, as `measured` counts: the session, and the instrument where that has a name."""
        of = dict(self.named_instruments)
        columns = {kind: OBSERVABLES[kind].column for kind in np.unique(self.measured).tolist()}
        return {k: f"{self.session_id} {of[c]}" if c in of else self.session_id for k, c in columns.items()}

    @property
    def waveform(self) -> str:
        """Name of the drive's waveform."""
        return self.drive.waveform

    @property
    def n_points(self) -> int:
        """Number of readings."""
        return int(self.frequency_hz.size)

    @property
    def conditions(self) -> FloatArray:
        """Frequency, amplitude and observable of each point, (n_points, 3); of a trace its time, too, (n_points, 4)."""
        own: list[NDArray[Any]] = [self.frequency_hz, self.amplitude_v, self.measured]
        return np.column_stack(own if self.time_us is None else [*own, self.time_us])

    @property
    def swept(self) -> Swept:
        """The variable that a sweep varies: the one that spans the larger ratio; along a trace, time."""
        if self.time_us is not None:
            return "time"
        driven = self.amplitude_v[self.amplitude_v > 0]  # readings without a drive are no end of a sweep
        wider = driven.size and np.ptp(np.log(driven)) > np.ptp(np.log(self.frequency_hz))
        return "amplitude" if wider else "frequency"

    @property
    def in_sweep(self) -> NDArray[np.intp]:
        """Rows in the order of the sweep, whatever the order of the file; those of each observable together."""
        f, v, kind = self.frequency_hz, self.amplitude_v, self.measured
        if self.time_us is not None:
            return np.argsort(self.time_us)
        return np.lexsort((f, v, kind)) if self.swept == "amplitude" else np.lexsort((v, f, kind))

    @property
    def varied(self) -> tuple[Literal["frequency", "amplitude"], ...]:
        """What was not held."""
        both: dict[Literal["frequency", "amplitude"], FloatArray]
        both = {"frequency": self.frequency_hz, "amplitude": self.amplitude_v}
        return tuple(name for name, x in both.items() if np.ptp(x) > _HELD * np.max(x))

    @property
    def along(self) -> FloatArray | None:
        """What a sweep of one variable (Hz, V) or a trace (us) goes through; None where both were varied or neither."""
        if self.time_us is not None:
            return self.time_us
        if len(self.varied) != 1:
            return None
        return self.amplitude_v if self.varied == ("amplitude",) else self.frequency_hz

    def filled(self) -> Conditions:
        """The sweep with conditions between its own, ascending, to draw a curve through; as it is if it is none.

        A trace is a curve already. Of several observables, each has its own conditions.
        """
        held: dict[str, Any] = {"changed": self.changed, "session": self.session, "instruments": self.instruments}
        if len(self.parts) > 1:
            each = [part.filled() for part in self.parts]
            f, v, measured = (
                np.concatenate([getattr(p, name) for p in each]) for name in (*CONDITION_COLUMNS, "measured")
            )
            return Conditions(self.id, self.drive, self.file, f, v, **held, measured=measured)
        if self.along is None or self.time_us is not None:
            return self
        f, v = self.frequency_hz, self.amplitude_v
        _, first = np.unique(self.along, return_index=True)
        parts = min(max(_FILLED // first.size, 1), _BETWEEN)
        place = np.arange(parts * (first.size - 1) + 1) / parts

        def between(values: FloatArray) -> FloatArray:
            ratio = float(values.min()) > 0 and np.ptp(values) > 0
            found = np.interp(place, np.arange(values.size), np.log(values) if ratio else values)
            found = np.exp(found) if ratio else found
            found[::parts] = values
            return found

        f, v = between(f[first]), between(v[first])
        measured = np.full(f.size, self.measured[0])
        return Conditions(self.id, self.drive, self.file, f, v, **held, measured=measured)

    def rig(self, constants: Constants) -> Constants:
        """The rig's constants in this sweep."""
        return replace(constants, **dict(self.changed))


def changes_text(changed: Iterable[tuple[str, float]], space: str = " ") -> str:
    """Constants that were others, behind what else is said of a sweep: ``, l = 0.06 m``; `space` is before the unit."""
    return "".join(f", {name} = {value:g}{space}{CONSTANT_UNITS[name]}" for name, value in changed)


@dataclass(frozen=True, eq=False)
class Group(Conditions):
    """One measured sweep: its `Conditions`, and what was read.

    Parameters
    ----------
    reading : (n_points,) array
        What was read (>= 0), each in the unit of its observable.
    """

    reading: FloatArray

    @property
    def launch_range_um(self) -> FloatArray:
        """The launch ranges among the readings, um."""
        return self.reading[self.measured == OBSERVABLES.index(LAUNCH_RANGE)]


def by_group(groups: Iterable[Conditions], values: FloatArray) -> list[FloatArray]:
    """Values, (n_points,), one group after the other, as one array a group."""
    return np.split(values, np.cumsum([g.n_points for g in groups])[:-1])


def by_part(groups: Sequence[Conditions], values: FloatArray) -> list[FloatArray]:
    """Values, (n_points,), one group after the other, as one array for each of the groups' `parts`."""
    each = zip(groups, by_group(groups, values), strict=True)
    return [own[g.measured == kind] for g, own in each for kind in np.unique(g.measured)]


def read_as(groups: Sequence[Conditions], reading: FloatArray) -> tuple[Group, ...]:
    """Sweeps, measured or planned, with these readings, (n_points,), one group after the other."""
    kept = [f.name for f in fields(Conditions)]
    return tuple(
        Group(**{name: getattr(g, name) for name in kept}, reading=values)
        for g, values in zip(groups, by_group(groups, reading), strict=True)
    )


def is_one_of(group: Conditions, measured: Iterable[Group]) -> bool:
    """Whether a group is one of those measured, by its id, its session, its instruments and its very readings."""

    def known_by(g: Group) -> tuple[object, ...]:
        return g.id, g.session_id, g.named_instruments, g.reading.tobytes()

    return isinstance(group, Group) and known_by(group) in set(map(known_by, measured))


def known_sessions(groups: Iterable[Conditions], measured: Sequence[Group]) -> frozenset[GroupId]:
    """The sessions of which some groups are among those measured, as `is_one_of` has it."""
    return frozenset(g.session_id for g in groups if is_one_of(g, measured))


def sessions_of(groups: Iterable[Conditions]) -> tuple[GroupId, ...]:
    """The sessions in which groups were measured, in the order of their first groups."""
    return tuple(dict.fromkeys(g.session_id for g in groups))


@dataclass(frozen=True)
class Occasions:
    """When groups were measured, and by what.

    Parameters
    ----------
    sessions : tuple of group ids
        In the order of their first groups.
    readers : tuple of group ids
        The instruments, each in each session that it read in, as `Conditions.readers` names them; where none has a
        name, the sessions.
    read : tuple of frozenset of str
        Names of the observables that each of the readers has read.
    """

    sessions: tuple[GroupId, ...]
    readers: tuple[GroupId, ...]
    read: tuple[frozenset[str], ...]

    @classmethod
    def of(cls, groups: Iterable[Conditions]) -> Self:
        """Those of some groups."""
        every, read = list(groups), dict[GroupId, set[str]]()
        for kind, reader in (pair for g in every for pair in g.readers.items()):
            read.setdefault(reader, set()).add(OBSERVABLES[kind].name)
        return cls(sessions_of(every), tuple(read), tuple(map(frozenset, read.values())))

    @classmethod
    def one(cls, session: GroupId) -> Self:
        """A session with one instrument, that may read anything."""
        return cls((session,), (session,), (frozenset(o.name for o in OBSERVABLES),))

    def numbered(self, per: str) -> tuple[GroupId, ...]:
        """The sessions, or the readers, as a design numbers them; `per` names a field."""
        return self.sessions if per == "sessions" else self.readers


def session_name(name: str, id: GroupId) -> str:
    """Name of what one session has for itself, or an instrument in a session: `name`, and the session's or reader's id.

    It depends on the id alone: what a Python name cannot hold is replaced, and a checksum distinguishes such ids.
    """
    text = re.sub(r"\W", "_", str(id))
    return f"{name}_{text}" if text == str(id) else f"{name}_{text}_{zlib.crc32(str(id).encode()):08x}"


@dataclass(frozen=True, eq=False)
class Experiment:
    """A rig and its measured groups, as read from an experiment folder."""

    title: str
    source: str
    constants: Constants
    groups: tuple[Group, ...]
    folder: Path
    fingerprint: str  # SHA-256 of the numbers, so that a run knows the data it saw
    warnings: tuple[str, ...] = ()  # what `check` says of suspicious but usable values
    # What a next experiment may use, as (column or constant, (least, greatest)); without any, what was measured.
    limits: tuple[tuple[str, tuple[float, float]], ...] = ()
    beliefs: tuple[Belief, ...] = ()  # what is known of the rig's parameters beforehand, in the place of usual priors
    rig: Rig | None = None  # what it is made of; `beliefs` has what follows from it
    readable: tuple[str, ...] = ()  # columns that a next experiment may read besides what was read; empty for all

    @property
    def ids(self) -> tuple[GroupId, ...]:
        """Ids of the groups, in the order of the definition."""
        return tuple(group.id for group in self.groups)

    @property
    def occasions(self) -> Occasions:
        """When its groups were measured, and by what, as a design of all groups numbers it."""
        return Occasions.of(self.groups)

    @property
    def instruments(self) -> tuple[tuple[str, str], ...]:
        """Columns that an instrument of their own reads, and its name: those of its groups, which have the same."""
        found = {group.instruments for group in self.groups}
        if len(found) > 1:
            raise ValueError("groups of one experiment name different instruments")
        return next(iter(found), ())

    def group(self, group_id: GroupId) -> Group:
        """Return one group.

        Parameters
        ----------
        group_id : int or str
            Its id; 1 and "1" name the same group, since a command line knows text only.

        Raises
        ------
        InputError
            If there is no such group; the message names the ids there are.
        """
        for group in self.groups:
            if str(group.id) == str(group_id):
                return group
        raise InputError(
            f"there is no group {shown(str(group_id))}",
            f"choose one of {listed(str(i) for i in self.ids)}",
            file=self.folder / DEFINITION,
        )

    def thinned(self, every: int) -> Experiment:
        """Every so many-th reading of each group; the least group keeps all of eight."""
        steps = (every if g.n_points >= 8 * every else max(g.n_points // 8, 1) for g in self.groups)
        return replace(self, groups=tuple(g.at(slice(None, None, k)) for g, k in zip(self.groups, steps, strict=True)))

    def select(self, ids: Iterable[GroupId]) -> tuple[Group, ...]:
        """Return groups in the order asked for.

        Raises
        ------
        InputError
            If an id is unknown, or named twice: its readings would count twice.
        """
        chosen = tuple(self.group(i) for i in ids)
        if len({id(group) for group in chosen}) < len(chosen):
            raise InputError(
                f"a group is named twice in {listed(str(group.id) for group in chosen)}",
                "name each group once",
                file=self.folder / DEFINITION,
            )
        return chosen

    def with_readings(self, reading: FloatArray) -> Experiment:
        """The experiment with other readings, (n_points,), one group after the other."""
        groups = read_as(self.groups, reading)
        return replace(self, groups=groups, fingerprint=fingerprint(self.constants, groups))


def fingerprint(constants: Constants, groups: Iterable[Group]) -> str:
    """SHA-256 of the numbers: equal if and only if a run would see the same data.

    It covers the constants and, for each group in order, id, session, drive, instruments, changed constants and columns
    in row order (results are stored row by row). Titles, paths and the way a number is written do not enter.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for f in fields(constants):
        digest.update(f"{f.name}={float(getattr(constants, f.name)).hex()}\n".encode())
    for group in groups:
        digest.update(f"group={group.id} {group.waveform} {group.n_points}\n".encode())
        for key, setting in group.drive.settings.items():
            if key != "drive":  # a file's name: its numbers are what counts
                digest.update(f"{key}={float(setting).hex()}\n".encode())
        if table := group.drive.table:
            digest.update(
                b"%d" % table.recorded + table.at.astype("<f8").tobytes() + table.value.astype("<f8").tobytes()
            )
        if group.session is not None:
            digest.update(f"session={group.session}\n".encode())
        for of, instrument in group.named_instruments:
            digest.update(f"instrument={of} {instrument}\n".encode())
        for name, value in group.changed:
            digest.update(f"{name}={value.hex()}\n".encode())
        # The names are those of files that hold launch ranges alone: their fingerprints stay what they were.
        columns = (group.frequency_hz, group.amplitude_v, group.reading, group.sigma)
        for name, column in zip((*CONDITION_COLUMNS, "launch_range_um", "sigma_um"), columns, strict=True):
            if column is not None:
                digest.update(f"{name}\n".encode())
                digest.update(column.astype("<f8").tobytes())
        if group.observables != (LAUNCH_RANGE,):
            read = (OBSERVABLES[k].column for k in group.measured)
            digest.update("".join(f"{k} {name}\n" for k, name in zip(group.row, read, strict=True)).encode())
        if group.time_us is not None:
            digest.update(b"time_us\n" + group.time_us.astype("<f8").tobytes())
    return digest.hexdigest()


def describe(experiment: Experiment) -> dict[str, Any]:
    """Summarise an experiment for `psafit check`, in types that JSON has.

    Returns
    -------
    dict
        `title`, `source`, `folder`, `fingerprint`, `constants`, `n_points`, `warnings`, `priors` (those given: `name`,
        `prior` with the probability that its cause is at work where that is given, `source`, and whether it is
        `derived` from the rig), `lacking` (of each prior that nearly follows from the rig the facts that are missing),
        `instruments` if any is named (column to name), and `groups`: one dict each with `id`, `session` if it is
        stated, `waveform`, `file`, `n_points`, the spans `frequency_hz`, `amplitude_v`, of a trace `time_us`, and those
        of what is read, `launch_range_um` or another column, as [least, greatest], `constants` (those changed), `zeros`
        (readings of exactly 0), `replicates` (readings beyond the first at the same condition) and `has_sigma`.
    """
    known = {b.name for b in experiment.beliefs if b.prior is not None}
    return {
        "title": experiment.title,
        "source": experiment.source,
        "folder": str(experiment.folder),
        "fingerprint": experiment.fingerprint,
        "constants": {f.name: getattr(experiment.constants, f.name) for f in fields(Constants)},
        "n_points": sum(group.n_points for group in experiment.groups),
        "warnings": [*experiment.warnings, *map(_lone, (g for g in experiment.groups if g.n_points == 1))],
        "priors": [
            {"name": b.name, "prior": b.describe(), "source": b.source, "derived": b.derived}
            for b in experiment.beliefs
        ],
        "lacking": {name: list(facts) for name, facts in lacking(experiment.rig, known).items()},
        **({"instruments": dict(experiment.instruments)} if experiment.instruments else {}),
        "groups": [_describe_group(group) for group in experiment.groups],
    }


def _lone(group: Group) -> str:
    return one_line(f"{group.file}: group {group.id}: one reading is no sweep; it shows a level and no trend")


def _describe_group(group: Group) -> dict[str, Any]:
    names = CONDITION_COLUMNS if group.time_us is None else (*CONDITION_COLUMNS, "time_us")
    spans = {name: getattr(group, name) for name in names}
    spans |= {part.observable.column: part.reading for part in group.parts}
    return {
        "id": group.id,
        **({} if group.session is None else {"session": group.session}),
        "waveform": group.waveform,
        **group.drive.settings,
        "file": group.file,
        "n_points": group.n_points,
        "constants": dict(group.changed),
        **{name: [float(column.min()), float(column.max())] for name, column in spans.items()},
        "zeros": int(np.count_nonzero(group.reading == 0)),
        "replicates": group.n_points - len(np.unique(group.conditions, axis=0)),
        "has_sigma": group.sigma is not None,
    }

"""The conditions at which a simulation is evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.drives import NAMES, Drive
from psafit.experiment import Conditions, Constants, Occasions
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.physics.term import Term
from psafit.simulate.command import commands

_USUAL = (Drive("sine"), Drive("square"))
SINE, SQUARE = range(2)
MAX_FREQUENCY = 1e9  # Hz; no stack follows


class Counts(NamedTuple):
    """Number of sessions, and of readers: instruments, each in each session that it read in."""

    sessions: int = 1
    readers: int = 1

    def latents(self, term: Term) -> int:
        """Number of latent parameters that the simulator takes for a cause: one for each session, or reader."""
        return 0 if term.latent is None else self.sessions if term.per == "sessions" else self.readers


@dataclass(frozen=True)
class Design:
    """Measurement conditions: all that the simulator needs but the parameters.

    Parameters
    ----------
    constants : Constants
        Known constants of the rig, SI.
    others : tuple of Constants
        Of rigs with a constant changed, if there are points of such.
    rig : (n_points,) int array
        Whose each point is: 0 for `constants`, k for the k-th of `others`.
    drives : tuple of Drive
    drive : (n_points,) int array
        Which of `drives` each point has: by default `SINE` or `SQUARE`.
    measured : (n_points,) int8 array
        What is read at each point, as `psafit.observables.OBSERVABLES` counts; the launch range by default.
    frequency : (n_points,) array, Hz
    amplitude : (n_points,) array, V
    group : (n_points,) int array
        Sweep or trace that each point is of, numbered from 0.
    time : (n_points,) array, s
        Of a sample of a trace, from the start of the drive; NaN where the launch as a whole is read.
    moments : (n_points, n_moments) array, s
        At which the motion of each launch is to be followed, ascending, infinite behind the last; none by default.
    tipped : bool
        Whether the tip is followed after the launch, too, which takes the stepper.
    session : (n_points,) int array
        Session of each point, numbered from 0; causes that act per session use it. By default each group is one.
    reader : (n_points,) int array
        What reads each point, numbered from 0: an instrument in a session. By default each session has one.

    Raises
    ------
    ValueError
        If the arrays differ in length, or one holds an impossible value; the message names it.
    """

    constants: Constants
    drive: NDArray[np.int64]
    frequency: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    group: NDArray[np.int64]
    others: tuple[Constants, ...] = ()
    rig: NDArray[np.int64] = field(default_factory=lambda: np.zeros(1, np.int64))
    drives: tuple[Drive, ...] = _USUAL
    measured: NDArray[np.int8] = field(default_factory=lambda: np.zeros(1, np.int8))
    time: FloatArray = field(default_factory=lambda: np.full(1, np.nan))
    moments: FloatArray = field(default_factory=lambda: np.empty((1, 0)))
    tipped: bool = False
    session: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    reader: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def __post_init__(self) -> None:
        for name, usual in (("session", "group"), ("reader", "session")):
            if not np.size(getattr(self, name)):
                object.__setattr__(self, name, getattr(self, usual))
        for name, kind in (
            ("drive", np.int64),
            ("frequency", np.float64),
            ("amplitude", np.float64),
            ("group", np.int64),
            ("session", np.int64),
            ("reader", np.int64),
            ("rig", np.int64),
            ("measured", np.int8),
            ("time", np.float64),
            ("moments", np.float64),
        ):
            array = np.array(getattr(self, name), dtype=kind, ndmin=1)
            if name in ("rig", "measured", "time", "moments") and len(array) == 1:
                array = np.repeat(array, self.n_points, axis=0)
            if array.shape[:1] != (self.n_points,) or array.ndim != (2 if name == "moments" else 1):
                raise ValueError(f"{name} has shape {array.shape}, expected ({self.n_points},)")
            array.setflags(write=name == "moments")  # as the engines take an empty one: they are compiled once
            object.__setattr__(self, name, array)
        for name, sound, wanted in (
            ("drive", (self.drive >= 0) & (self.drive < len(self.drives)), f"0 to {len(self.drives) - 1}"),
            ("frequency", (self.frequency > 0) & (self.frequency <= MAX_FREQUENCY), f"in (0, {MAX_FREQUENCY:g}] Hz"),
            ("amplitude", (self.amplitude >= 0) & np.isfinite(self.amplitude), "finite and not negative (V)"),
        ):
            if not sound.all():
                raise ValueError(f"{name} must be {wanted}, got {getattr(self, name)[~sound][0]}")

    @property
    def n_points(self) -> int:
        """Number of measurement points."""
        return int(np.size(self.frequency))

    @property
    def counts(self) -> Counts:
        """How many sessions and readers it has points of, with those numbered before."""
        return Counts(int(self.session.max(initial=0)) + 1, int(self.reader.max(initial=0)) + 1)

    def occasion(self, per: str) -> NDArray[np.int64]:
        """Number of each point's session or reader: `per` is a field of `Counts`."""
        return self.session if per == "sessions" else self.reader

    def swept(self, variable: str) -> NDArray[np.float64]:
        """What "frequency" (Hz), "amplitude" (V) or "time" (us, along a trace) is at each point."""
        return {"amplitude": self.amplitude, "time": self.time * 1e6}.get(variable, self.frequency)

    def along(self, variable: str) -> NDArray[np.float64]:
        """Logarithm of what is swept; 0 V, which has none, stands at the smallest drive."""
        values = self.swept(variable)
        least = values[values > 0].min(initial=np.inf)
        return np.log(np.maximum(values, least if np.isfinite(least) else 1.0))

    def point(self, index: int) -> Design:
        """One of the conditions, as a design of its own."""
        return self.points(np.array([index]))

    def points(self, chosen: NDArray[np.intp]) -> Design:
        """Some of the conditions; those of one rig have its constants."""
        some = self.drive[chosen], self.frequency[chosen], self.amplitude[chosen], self.group[chosen]
        rig, when = self.rig[chosen], (self.session[chosen], self.reader[chosen])
        read = self.measured[chosen], self.time[chosen], self.moments[chosen], self.tipped
        if rig.size and (rig == rig[0]).all():
            return Design(self.rigs[rig[0]], *some, (), np.zeros(1, np.int64), self.drives, *read, *when)
        return Design(self.constants, *some, self.others, rig, self.drives, *read, *when)

    @cached_property
    def commands(self) -> tuple[FloatArray, FloatArray]:
        """What the engines read the drives from: see `psafit.simulate.command`."""
        return commands(self.drives, self.drive, self.frequency, self.amplitude)

    @property
    def waveform(self) -> NDArray[np.int64]:
        """Number of each point's waveform, in the order of the registry."""
        return np.array([NAMES.index(d.waveform) for d in self.drives])[self.drive]

    @cached_property
    def kinds(self) -> NDArray[np.intp]:
        """Number of each point's kind of drive: those that are called the same, as all recordings are, are one."""
        labels = list(dict.fromkeys(d.label for d in self.drives))
        number = np.array([labels.index(d.label) for d in self.drives])
        return np.unique(number[self.drive], return_inverse=True)[1]

    @property
    def used(self) -> tuple[Drive, ...]:
        """The drives that some point has."""
        return tuple(self.drives[k] for k in np.unique(self.drive))

    @cached_property
    def launches(self) -> tuple[Design, NDArray[np.intp]] | None:
        """Conditions without repetition, and which of them each point is; None where launch ranges alone are read.

        Readings of several observables stand at the same conditions, which one simulation serves.
        """
        if not self.measured.any():
            return None
        first, back = self.patterns()
        return self.points(first), back

    def patterns(self, chosen: NDArray[np.intp] | slice = slice(None)) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """One of some points at each of their conditions, and which of these each is at.

        It reads the launch range if any does: what an instrument does to that is simulated with the launch.
        """
        of = np.column_stack([self.group, self.rig, self.drive, self.frequency, self.amplitude])[chosen]
        order = np.argsort(self.measured[chosen], kind="stable")
        _, first, inverse = np.unique(of[order], axis=0, return_index=True, return_inverse=True)
        back = np.empty(order.size, np.intp)
        back[order] = inverse.ravel()
        return order[first], back

    @cached_property
    def traced(self) -> NDArray[np.bool_]:
        """Which points are samples of a trace."""
        return ~np.isnan(self.time)

    @property
    def usually_measured(self) -> int:
        """What readings to come are of: the first observable of launches, or else launch ranges."""
        return int(self.measured[~self.traced].min()) if not self.traced.all() else OBSERVABLES.index(LAUNCH_RANGE)

    @cached_property
    def elapsed(self) -> FloatArray:
        """Time since the sample before in the same trace, s, infinite where there is none; (n_points,)."""
        gap = np.full(self.n_points, np.inf)
        same = (np.diff(self.group) == 0) & (np.diff(self.measured) == 0) & (np.diff(self.time) > 0.0)
        gap[1:][same] = np.diff(self.time)[same]
        return gap

    @cached_property
    def launched_rows(self) -> tuple[Design, NDArray[np.intp]]:
        """The points that are no samples of a trace, as a design of their own, and which they are."""
        rows = np.flatnonzero(~self.traced)
        return self.points(rows), rows

    @cached_property
    def motions(self) -> tuple[Motions, ...]:
        """The launches whose motion is traced: those of the ball's, and those of the tip's."""
        found = []
        for tip in (False, True):
            of_tip = np.isin(self.measured, [k for k, o in enumerate(OBSERVABLES) if o.tip])
            rows = np.flatnonzero(self.traced & (of_tip == tip))
            if not rows.size:
                continue
            part = self.points(rows)
            first, back = part.patterns()
            times = [np.unique(part.time[back == k]) for k in range(first.size)]
            moments = np.full((first.size, max(map(len, times))), np.inf)
            column = np.empty(rows.size, np.intp)
            for k, own in enumerate(times):
                moments[k, : own.size] = own
                column[back == k] = np.searchsorted(own, part.time[back == k])
            launches = replace(part.points(first), moments=moments, tipped=tip)
            found.append(Motions(launches, rows, back, column))
        return tuple(found)

    @property
    def rigs(self) -> tuple[Constants, ...]:
        """Constants of each rig, as `rig` counts them."""
        return (self.constants, *self.others)

    def _split(self, label: NDArray[np.int64]) -> list[tuple[Design, NDArray[np.intp]]]:
        rows = [np.flatnonzero(label == k) for k in np.unique(label)]
        return [(self.points(some), some) for some in rows]

    @cached_property
    def of_rigs(self) -> list[tuple[Design, NDArray[np.intp]]]:
        """The points of each rig that has any, as a design of their own, and which they are."""
        return self._split(self.rig)

    @cached_property
    def of_sessions(self) -> list[tuple[Design, NDArray[np.intp]]]:
        """The points of each session of each rig, as a design of their own, and which they are."""
        return self._split(self.rig * self.counts.sessions + self.session)

    @classmethod
    def of(cls, constants: Constants, groups: Sequence[Conditions]) -> Design:
        """Conditions of groups, measured or planned, in the order given."""
        sizes = [g.frequency_hz.size for g in groups]
        rigs = list(dict.fromkeys([constants, *(g.rig(constants) for g in groups)]))
        drives = tuple(dict.fromkeys([*_USUAL, *(g.drive for g in groups)]))
        occasions = Occasions.of(groups)
        every = cls(
            constants,
            np.repeat([drives.index(g.drive) for g in groups], sizes),
            np.concatenate([g.frequency_hz for g in groups]),
            np.concatenate([g.amplitude_v for g in groups]),
            np.repeat(np.arange(len(groups)), sizes),
            tuple(rigs[1:]),
            np.repeat([rigs.index(g.rig(constants)) for g in groups], sizes),
            drives,
            np.concatenate([g.measured for g in groups]),
            np.concatenate([np.full(g.n_points, np.nan) if g.time_us is None else g.time_us * 1e-6 for g in groups]),
            session=np.repeat([occasions.sessions.index(g.session_id) for g in groups], sizes),
            reader=np.concatenate([_readers(g, occasions) for g in groups]),
        )
        return every.points(np.arange(every.n_points)) if rigs[1:] else every

    @classmethod
    def sweep(cls, constants: Constants, waveform: Drive | str, frequency: object, amplitude: object) -> Design:
        """One sweep of a drive or plain waveform; `frequency` (Hz) and `amplitude` (V) broadcast together."""
        f, v = np.broadcast_arrays(np.atleast_1d(np.asarray(frequency, float)), np.asarray(amplitude, float))
        one = Drive.of(waveform)
        if one.waveform not in NAMES:
            raise ValueError(f"waveform must be one of {', '.join(NAMES)}, got {one.waveform!r}")
        drives = tuple(dict.fromkeys([*_USUAL, one]))
        none = np.zeros(f.size, np.int64)
        return cls(constants, none + drives.index(one), f, v, none, drives=drives)


def _readers(group: Conditions, occasions: Occasions) -> NDArray[np.int64]:
    """Which of the readers each point of a group has."""
    number = {kind: occasions.readers.index(id) for kind, id in group.readers.items()}
    return np.array([number[kind] for kind in group.measured.tolist()])


@dataclass(frozen=True)
class Motions:
    """Launches whose motion is followed, and which moment of which each sample of some traces is.

    Parameters
    ----------
    launches : Design
        With `moments`.
    rows : (n_samples,) int array
        Points of the design that the samples are.
    launch, moment : (n_samples,) int arrays
        Launch of each sample, and which of its moments.
    """

    launches: Design
    rows: NDArray[np.intp]
    launch: NDArray[np.intp]
    moment: NDArray[np.intp]

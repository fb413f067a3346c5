"""Rigs and sweeps drawn at random: another stack, any drive, whatever can be read, many readings or few, traces.

What a drawn design may be, and how often, stands in `ConditionSettings`. Without its shares a design is one like the
study's: its stack, plain sines and squares, launch ranges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from psafit.arrays import FloatArray
from psafit.challenge.answer import DrawnDesign
from psafit.drives import TABLE, WAVEFORMS, Drive, Table
from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.observables import LAUNCH_RANGE, NUMBERED, OBSERVABLES
from psafit.physics.term import Term

# Streams of random numbers: of designs like the study's, of what departs from it, and of traces.
_SWEEPS, _DEPARTURES, _TRACES = 0, 5, 6

# The rig of the study, from which drawn designs depart.
_RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)


@dataclass(frozen=True)
class ConditionSettings:
    """What drawn designs are like: shares of designs, shares of their groups, and sizes.

    Parameters
    ----------
    few : float
        Share of designs with few readings.
    readings, few_readings : (int, int)
        Of a design, least and most; sweeps share them evenly, but for what is left over.
    groups, few_groups : (int, int)
        Sweeps of a design, least and most.
    size : float
        Ball and string are at most so many times heavier or lighter, longer or shorter than the study's.
    other_stack : float
        Share of designs with another stack than the study's.
    stack : float
        Its mass and its stiffness are at most so many times larger or smaller.
    stroke : float
        The free stroke at full voltage likewise.
    voltage : (float, float)
        The full voltage, as a multiple of the study's 20 V.
    other_drives : float
        Share of designs that are driven by `waveforms`, the others by plain sines and squares.
    waveforms : tuple of (str, float)
        Names and their odds in a group; ``recorded`` is a table of a recorded voltage, ``table`` one of a period. Every
        waveform that there is; twice as often a sine and those from 0 V, as stacks are driven.
    changed : float
        Share of the groups of these designs that have a bias; the same of an idle voltage, of a phase, and of a drive
        that lasts for some `cycles`.
    cycles : tuple of float
        Periods that such a drive may last.
    replicates : int
        Readings of a recorded drive, at most: each is the same launch again.
    other_reads : float
        Share of designs in which more is read than launch ranges, or something else.
    reads : tuple of (tuple of str, float)
        What is read in these, by name, and the odds.
    parted : float
        Share of the designs with several observables in which each group reads only some of them.
    traced : float
        Share of designs in which launches of some sweeps are followed over time, too, each in a group of its own.
    traces : (int, int)
        Of these designs, least and most.
    motions : tuple of (str, float)
        What a trace is of, by name, and the odds.
    samples : (int, int)
        Of a trace, least and most.
    length : (float, float)
        Of a trace from the start of the drive, in periods.
    """

    few: float = 0.4
    readings: tuple[int, int] = (200, 350)
    few_readings: tuple[int, int] = (34, 60)
    groups: tuple[int, int] = (4, 7)
    few_groups: tuple[int, int] = (2, 4)
    size: float = 1.5
    other_stack: float = 0.5
    stack: float = 3.0
    stroke: float = 2.0
    voltage: tuple[float, float] = (0.5, 10.0)
    other_drives: float = 0.6
    waveforms: tuple[tuple[str, float], ...] = (
        *((name, 2.0 if name == "sine" or form.unipolar else 1.0) for name, form in WAVEFORMS.items()),
        (TABLE, 1.0),
        ("recorded", 1.0),
    )
    changed: float = 0.25
    cycles: tuple[float, ...] = (0.5, 1.0, 2.0, 3.0)
    replicates: int = 12
    other_reads: float = 0.5
    reads: tuple[tuple[tuple[str, ...], float], ...] = (
        (("launch_speed",), 1.0),
        (("contact_time",), 1.0),
        (("peak_force",), 1.0),
        (("launch_range", "contact_time"), 2.0),
        (("launch_range", "launch_speed"), 1.0),
        (("launch_range", "peak_force"), 1.0),
        (("launch_speed", "contact_time"), 1.0),
        (("launch_range", "launch_speed", "contact_time", "peak_force"), 1.0),
    )
    parted: float = 0.3
    traced: float = 0.25
    traces: tuple[int, int] = (1, 3)
    motions: tuple[tuple[str, float], ...] = (("displacement", 2.0), ("velocity", 2.0), ("tip_displacement", 1.0))
    samples: tuple[int, int] = (40, 80)
    length: tuple[float, float] = (0.5, 1.5)

    @classmethod
    def like_the_study(cls) -> ConditionSettings:
        """Those of designs that depart from the study in the lengths of sweeps, the ball and the string alone."""
        return cls(few=0.0, other_stack=0.0, other_drives=0.0, other_reads=0.0, traced=0.0)


def drawn(
    seed: int,
    readings: int | None = None,
    *,
    causes: Sequence[Term] = (),
    ranges: bool = False,
    settings: ConditionSettings | None = None,
) -> Experiment:
    """Draw a rig and its sweeps; the readings are still zero.

    Parameters
    ----------
    seed : int
    readings : int, optional
        About so many of launches in all; drawn by default.
    causes : sequence of Term
        To be hidden: some group has a drive on which each of them acts, and reads what it changes.
    ranges : bool
        Whether some group must read launch ranges.
    settings : ConditionSettings, optional

    Returns
    -------
    Experiment
    """
    s = settings or ConditionSettings()
    sweeps, rng = (np.random.default_rng([seed, stream]) for stream in (_SWEEPS, _DEPARTURES))
    few = bool(rng.uniform() < s.few) and readings is None
    constants, scale = _rig(sweeps, rng, s)
    driven = bool(rng.uniform() < s.other_drives)
    read = _reads(rng, s, ranges, causes)
    parted = bool(rng.uniform() < s.parted)
    low, high = s.few_readings if few else s.readings
    n_groups = int(sweeps.integers(s.groups[0], s.groups[1] + 1))
    if few:
        n_groups = int(rng.integers(s.few_groups[0], s.few_groups[1] + 1))
    groups = []
    for number in range(1, n_groups + 1):
        n = (int(sweeps.integers(low, high + 1)) if readings is None else readings) // n_groups
        waveform = "square" if sweeps.uniform() < 0.35 else "sine"
        f, v = _sweep(sweeps, number == 1, n // len(read), scale)
        drive = Drive(waveform)
        if driven:
            drive = _drive(rng, number, float(v.max()), float(np.median(f)), s)
        if number == 1 and not all(t.acts_on(drive) for t in causes):
            drive = Drive("sine")  # on which every cause acts
        if drive.recorded:  # each launch is the same again
            f, v = np.full(min(f.size, s.replicates), np.median(f)), np.full(min(f.size, s.replicates), v.max())
        some = read if number == 1 or not parted else [k for k in read if rng.uniform() < 0.5] or read
        rows = np.tile(np.arange(f.size), len(some))
        kinds = np.repeat(some, f.size)
        groups.append(
            Group(number, drive, f"group{number}.csv", f[rows], v[rows], np.zeros(rows.size), measured=kinds, row=rows)
        )
    return blank(constants, (*groups, *_traces(np.random.default_rng([seed, _TRACES]), groups, s)))


def blank(constants: Constants, groups: tuple[Group, ...]) -> Experiment:
    """An experiment whose title says nothing."""
    return Experiment("Challenge", "simulated", constants, groups, Path(), fingerprint(constants, groups))


def nameless(given: Experiment) -> Experiment:
    """The conditions of an experiment, with titles and file names that say nothing."""
    drives = list(dict.fromkeys(g.drive for g in given.groups if g.drive.table))
    groups = []
    for k, g in enumerate(given.groups, 1):
        drive = replace(g.drive, file=f"drive{drives.index(g.drive) + 1}.csv") if g.drive.table else g.drive
        groups.append(replace(g, drive=drive, file=f"group{k}.csv", sigma=None))
    return blank(given.constants, tuple(groups))


def summary(experiment: Experiment) -> DrawnDesign:
    """What was drawn, for the answer."""
    return DrawnDesign(
        asdict(experiment.constants),
        sum(g.n_points for g in experiment.groups),
        {str(g.id): g.drive.label for g in experiment.groups},
        {str(g.id): [o.name for o in g.observables] for g in experiment.groups},
    )


def _rig(sweeps: np.random.Generator, rng: np.random.Generator, s: ConditionSettings) -> tuple[Constants, float]:
    """Constants of the rig, and its full voltage over the study's."""
    ball, string = _RIG.M * s.size ** sweeps.uniform(-1, 1), _RIG.l * s.size ** sweeps.uniform(-1, 1)
    m, k_s, q, scale = _RIG.m, _RIG.k_s, _RIG.q, 1.0
    if rng.uniform() < s.other_stack:
        m, k_s = m * s.stack ** rng.uniform(-1, 1), k_s * s.stack ** rng.uniform(-1, 1)
        scale = _rounded(np.exp(rng.uniform(*np.log(s.voltage))))
        q = q * s.stroke ** rng.uniform(-1, 1) / scale
    return Constants(**{k: _rounded(x) for k, x in dict(M=ball, m=m, q=q, l=string, k_s=k_s, g=_RIG.g).items()}), scale


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _sweep(rng: np.random.Generator, first: bool, n: int, scale: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies and amplitudes of a sweep of either."""
    if first or rng.uniform() < 0.5:
        low, high = rng.uniform(50.0, 400.0), rng.uniform(5e3, 25e3)
        return np.round(np.geomspace(low, high, n), 0), np.full(n, float(rng.choice([10.0, 15.0, 20.0])) * scale)
    f = np.full(n, float(round(rng.uniform(500.0, 4000.0), -2)))
    return f, np.round(scale * np.linspace(rng.uniform(1.0, 5.0), 20.0, n), 2)


def _reads(rng: np.random.Generator, s: ConditionSettings, ranges: bool, causes: Sequence[Term]) -> list[int]:
    """Numbers of the observables of a design, with what shows each cause that acts after the launch."""
    names: tuple[str, ...] = (LAUNCH_RANGE.name,)
    other, which = rng.uniform() < s.other_reads, rng.choice(len(s.reads), p=_odds([w for _, w in s.reads]))
    if other:
        names = s.reads[int(which)][0]
    for cause in causes:
        if cause.after_launch and cause.shown_in.isdisjoint(names):
            names = (*names, cause.reads[0])
    return [k for k, o in NUMBERED if o.name in names or (ranges and o is LAUNCH_RANGE)]


def _traces(rng: np.random.Generator, sweeps: Sequence[Group], s: ConditionSettings) -> list[Group]:
    """Launches of some sweeps over time, by the largest drive of each; none in most designs."""
    if rng.uniform() >= s.traced:
        return []
    found, first = [], len(sweeps) + 1
    for number in range(first, first + int(rng.integers(s.traces[0], s.traces[1] + 1))):
        sweep = sweeps[int(rng.integers(len(sweeps)))]
        f = float(rng.choice(np.sort(sweep.frequency_hz)[: max(sweep.n_points // 2, 1)]))  # where the ball moves far
        name = str(rng.choice([n for n, _ in s.motions], p=_odds([w for _, w in s.motions])))
        n = int(rng.integers(s.samples[0], s.samples[1] + 1))
        time_us = np.round(np.linspace(0.0, 1e6 * rng.uniform(*s.length) / f, n + 1)[1:], 2)
        kind = next(k for k, o in enumerate(OBSERVABLES) if o.name == name)
        found.append(
            Group(
                number, sweep.drive, f"group{number}.csv", np.full(n, f), np.full(n, sweep.amplitude_v.max()),
                np.zeros(n), measured=np.full(n, kind), time_us=time_us,
            )
        )  # fmt: skip
    return found


def _odds(weights: Sequence[float]) -> FloatArray:
    return np.array(weights) / np.sum(weights)


def _drive(rng: np.random.Generator, number: int, volts: float, frequency: float, s: ConditionSettings) -> Drive:
    """Any drive; the first group's is no recording, since its launches are all one."""
    names, weights = zip(*((w, p) for w, p in s.waveforms if number > 1 or w != "recorded"), strict=True)
    name = str(rng.choice(names, p=_odds(weights)))
    if name == "recorded":
        return Drive(TABLE, table=_recording(rng, volts, frequency), file=f"drive{number}.csv")
    bias, idle, phase, ends = rng.uniform(size=4) < s.changed
    bias_v = round(float(rng.uniform(0.3, 1.0)) * volts, 1) if bias else 0.0
    # A stack under bias may rest there; one without may be left at a voltage of either sign.
    idle_v = (bias_v or round(float(rng.uniform(-0.3, 0.3)) * volts, 1)) if idle else 0.0
    return Drive(
        name,
        bias_v,
        idle_v,
        float(rng.choice([90.0, 180.0, 270.0])) if phase else 0.0,
        float(rng.choice(s.cycles)) if ends else np.inf,
        _period(rng) if name == TABLE else None,
        f"drive{number}.csv" if name == TABLE else "",
    )


def _period(rng: np.random.Generator) -> Table:
    """A trapezoid: it rises to 1, stays, falls to a level below, stays."""
    corners = np.sort(np.round(rng.uniform(0.05, 0.95, 3), 3))
    low = round(float(rng.uniform(-1.0, 0.3)), 2)
    return Table(np.array([0.0, *corners, 1.0]), np.array([low, 1.0, 1.0, low, low]), False)


def _recording(rng: np.random.Generator, volts: float, frequency: float) -> Table:
    """Samples of a pulse of a period, rounded as instruments do, that decays with some ringing."""
    n = int(rng.integers(40, 200))
    time = np.linspace(0.0, 3.0 / frequency, n)
    ringing = 1.0 + rng.uniform(0.0, 0.3) * np.sin(2.0 * np.pi * rng.uniform(3.0, 8.0) * frequency * time)
    pulse = np.where(time < 1.0 / frequency, np.sin(np.pi * frequency * time) ** 2, 0.0)
    shape = pulse * ringing
    return Table(np.round(time * 1e6, 2) * 1e-6, np.round(volts * shape / shape.max(), 3), True)


__all__ = ["ConditionSettings", "blank", "drawn", "nameless", "summary"]

"""Effects that the catalogue does not hold: what a diagnosis must call unexplained, or locate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from psafit.challenge.answer import Place
from psafit.challenge.hide import Outside, Simulator
from psafit.experiment import Experiment
from psafit.experiment.records import by_group
from psafit.observables import CONTACT_TIME, LAUNCH_RANGE, LAUNCH_SPEED, OBSERVABLES, Observable
from psafit.physics.term import ReferenceRig
from psafit.simulate.reference import Point

FloatArray = NDArray[np.float64]
Rows = NDArray[np.intp]
Changed = tuple[FloatArray, list[Place]]


def usual(experiment: Experiment) -> Observable:
    """What the instrument reads that an effect of instruments befalls: launch ranges, if they are read."""
    return OBSERVABLES[min(int(g.measured.min()) for g in experiment.groups)]


def parts(experiment: Experiment) -> list[Rows]:
    """Which readings of each group are of the usual observable; there may be none."""
    kind = OBSERVABLES.index(usual(experiment))
    measured = np.concatenate([g.measured for g in experiment.groups])
    group = np.repeat(np.arange(len(experiment.groups)), [g.n_points for g in experiment.groups])
    return [np.flatnonzero((group == k) & (measured == kind)) for k in range(len(experiment.groups))]


def along(experiment: Experiment, name: str) -> FloatArray:
    """Frequency (Hz) or amplitude (V) of every reading."""
    return np.concatenate([getattr(g, name) for g in experiment.groups])


def places(experiment: Experiment, hit: NDArray[np.bool_]) -> list[Place]:
    """The range of what each group sweeps in which readings are hit."""
    found = []
    for g, own in zip(experiment.groups, by_group(experiment.groups, hit), strict=True):
        if own.any():
            name = "frequency" if np.ptp(g.frequency_hz) > 0 else "amplitude"
            x = (g.frequency_hz if name == "frequency" else g.amplitude_v)[own]
            found.append(Place(g.id, name, float(x.min()), float(x.max())))
    return found


def swung(experiment: Experiment, true: FloatArray, response: FloatArray, near: NDArray[np.bool_]) -> Changed:
    """What carries the stack swings with it: near its frequency the launch is stronger, and takes its time."""
    timed = np.concatenate([g.measured for g in experiment.groups]) == OBSERVABLES.index(CONTACT_TIME)
    hit = near & ~timed
    return np.where(hit, true * response, true), places(experiment, hit)


def frame_resonance(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """The frame that carries the stack swings with it: an oscillator's response on top of the drive."""
    own, damping, coupling = math.exp(rng.uniform(math.log(700), math.log(2000))), 0.08, 0.12
    ratio = along(experiment, "frequency_hz") / own
    response = np.abs(1 + coupling * ratio**2 / (1 - ratio**2 + 2j * damping * ratio))
    # Twice the half-width: beyond it the response is within some per cent of smooth.
    return swung(experiment, true, response, np.abs(np.log(ratio)) < 0.35)


def narrow_resonance(
    experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator
) -> Changed:
    """The mount swings, too, in so narrow a band that each sweep meets it with a few readings, if with any."""
    f = along(experiment, "frequency_hz")
    share, gain = rng.uniform(0.06, 0.12), rng.uniform(1.35, 1.6)
    swept = [g.frequency_hz for g in experiment.groups if np.ptp(g.frequency_hz) > 0] or [f]

    def met(centre: float) -> tuple[int, int]:
        """By how many sweeps, and how many readings."""
        inside = [int(np.sum(np.abs(x / centre - 1) < share)) for x in swept]
        return sum(n > 0 for n in inside), sum(inside)

    most = max(met(x)[0] for x in np.concatenate(swept))
    centre = float(rng.choice([x for x in np.concatenate(swept) if met(x)[0] == most]))
    off = (f / centre - 1) / share
    # Beyond three half-widths less than 5 % of the range is left of it.
    return swung(experiment, true, 1 + (gain - 1) / (1 + off**2), np.abs(off) < 3.0)


def clipping(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """The instrument's range ends: whatever is larger reads as its end."""
    rows = np.concatenate(parts(experiment))
    hit = np.zeros(true.size, bool)
    top = float(np.quantile(true[rows], rng.uniform(0.45, 0.6)))
    hit[rows] = true[rows] > top
    return np.where(hit, top, true), places(experiment, hit)


def drift(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """Something warms up in one session: the reading drifts from its first point to its last."""
    k = _one(experiment, true, rng)
    s = parts(experiment)[k]
    true[s] *= np.exp(rng.choice([-1, 1]) * 0.7 * np.linspace(0, 1, s.size) ** 2)
    return true, [Place(experiment.groups[k].id)]


def swapped_groups(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """Two sessions' readings are filed under each other's names; the longer list was thinned to fit."""
    rows = parts(experiment)
    there = [k for k, s in enumerate(rows) if s.size]
    pairs = [(i, j) for i in there for j in there if j < i]

    def differ(pair: tuple[int, int]) -> float:
        a, b = (true[rows[k]] for k in pair)
        offset = usual(experiment).offset
        return float(np.mean(np.abs(np.log((a + offset) / (_resampled(b, len(a)) + offset)))))

    i, j = max(pairs, key=differ)
    a, b = true[rows[i]].copy(), true[rows[j]].copy()
    true[rows[i]], true[rows[j]] = _resampled(b, len(a)), _resampled(a, len(b))
    return true, [Place(experiment.groups[i].id), Place(experiment.groups[j].id)]


def yielding_contact(
    experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator
) -> Changed:
    """A contact that yields: its force saturates, F = F_y tanh(k_c d/F_y)."""
    c = experiment.constants
    median = float(np.median(true[np.concatenate(parts(experiment))]))
    # Of the ball: what is read of it, or what the tip has at most.
    f, volts = (float(np.median(along(experiment, name))) for name in ("frequency_hz", "amplitude_v"))
    speeds = {LAUNCH_RANGE: median * 1e-6 * math.sqrt(c.g / c.l), LAUNCH_SPEED: median * 1e-3}
    speed = speeds.get(usual(experiment), 2 * math.pi * f * c.q * volts)

    def edit(rig: ReferenceRig, point: Point) -> None:
        # At a third of the force that brings the ball to its median speed within half a period of the contact.
        limit = 0.35 * speed * math.sqrt(rig.k_c * rig.M)
        rig.elastic = lambda d, rate: limit * math.tanh(rig.k_c * d / limit)

    return simulate(edit), []  # it acts everywhere: nobody can be said to have found where


def unit_error(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """One session is noted in another unit: root mean square, or from peak to peak."""
    k = _one(experiment, true, rng)
    true[parts(experiment)[k]] *= float(rng.choice([0.5, 1 / math.sqrt(2), 2.0]))
    return true, [Place(experiment.groups[k].id)]


def threshold(experiment: Experiment, true: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """A trigger that small excursions do not release: they read as zero."""
    rows = np.concatenate(parts(experiment))
    read = true[rows]
    low = float(np.quantile(read[read > usual(experiment).still], rng.uniform(0.2, 0.35)))
    hit = np.zeros(true.size, bool)
    hit[rows] = read < low
    return np.where(hit, 0.0, true), places(experiment, hit)


def _one(experiment: Experiment, true: FloatArray, rng: np.random.Generator) -> int:
    """A session with readings to speak of."""
    still = usual(experiment).still
    rich = [k for k, s in enumerate(parts(experiment)) if s.size and np.median(true[s]) > still]
    return int(rng.choice(rich))


def _resampled(values: FloatArray, n: int) -> FloatArray:
    return np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(values)), values)


_EFFECTS: Sequence[tuple[Callable[..., Changed], str]] = (
    (frame_resonance, "about the frame's own frequency"),
    (narrow_resonance, "in a narrow band of frequencies"),
    (clipping, "where ranges are large"),
    (drift, "in one session, more with every reading"),
    (swapped_groups, "in two sessions"),
    (yielding_contact, "everywhere"),
    (unit_error, "in one session"),
    (threshold, "where ranges are small"),
)
OUTSIDE = tuple(Outside(effect.__name__, effect, where) for effect, where in _EFFECTS)

"""Effects that the catalogue does not hold: what a diagnosis must call unexplained, or locate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from psafit.challenge.answer import Place
from psafit.challenge.hide import Outside, Simulator
from psafit.experiment import Experiment, Group
from psafit.physics.term import World
from psafit.simulate.reference import Point

FloatArray = NDArray[np.float64]
Changed = tuple[FloatArray, list[Place]]


def parts(experiment: Experiment) -> list[slice]:
    """Readings of each group."""
    ends = np.cumsum([g.n_points for g in experiment.groups])
    return [slice(int(end) - g.n_points, int(end)) for g, end in zip(experiment.groups, ends, strict=True)]


def span(group: Group, hit: NDArray[np.bool_]) -> list[Place]:
    """The range of what the group sweeps in which readings are hit."""
    if not hit.any():
        return []
    if np.ptp(group.frequency_hz) > 0:
        f = group.frequency_hz[hit]
        return [Place(group.id, "frequency", float(f.min()), float(f.max()))]
    v = group.amplitude_v[hit]
    return [Place(group.id, "amplitude", float(v.min()), float(v.max()))]


def frame_resonance(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """The frame that carries the stack swings with it: an oscillator's response on top of the drive."""
    f = np.concatenate([g.frequency_hz for g in experiment.groups])
    own, damping, coupling = math.exp(rng.uniform(math.log(700), math.log(2000))), 0.08, 0.12
    ratio = f / own
    response = np.abs(1 + coupling * ratio**2 / (1 - ratio**2 + 2j * damping * ratio))
    # Twice the half-width: beyond it the response is within some per cent of smooth.
    near = np.abs(np.log(ratio)) < 0.35
    changed = np.where(near, um * response, um)
    places = [p for g, s in zip(experiment.groups, parts(experiment), strict=True) for p in span(g, near[s])]
    return changed, places


def clipping(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """The instrument's range ends: whatever is larger reads as its end."""
    top = float(np.quantile(um, rng.uniform(0.45, 0.6)))
    places = [p for g, s in zip(experiment.groups, parts(experiment), strict=True) for p in span(g, um[s] > top)]
    return np.minimum(um, top), places


def drift(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """Something warms up in one session: the reading drifts from its first point to its last."""
    k = _one(experiment, um, rng)
    s = parts(experiment)[k]
    n = experiment.groups[k].n_points
    um[s] *= np.exp(rng.choice([-1, 1]) * 0.7 * np.linspace(0, 1, n) ** 2)
    return um, [Place(experiment.groups[k].id)]


def swapped_groups(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """Two sessions' readings are filed under each other's names; the longer list was thinned to fit."""
    slices = parts(experiment)
    pairs = [(i, j) for i in range(len(slices)) for j in range(i)]

    def differ(pair: tuple[int, int]) -> float:
        a, b = (um[slices[k]] for k in pair)
        return float(np.mean(np.abs(np.log((a + 0.3) / (_resampled(b, len(a)) + 0.3)))))

    i, j = max(pairs, key=differ)
    a, b = um[slices[i]].copy(), um[slices[j]].copy()
    um[slices[i]], um[slices[j]] = _resampled(b, len(a)), _resampled(a, len(b))
    return um, [Place(experiment.groups[i].id), Place(experiment.groups[j].id)]


def yielding_contact(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """A contact that yields: its force saturates, F = F_y tanh(k_c d/F_y)."""
    c = experiment.constants
    speed = float(np.median(um)) * 1e-6 * math.sqrt(c.g / c.l)

    def edit(world: World, point: Point) -> None:
        # At a third of the force that brings the ball to its median speed within half a period of the contact.
        limit = 0.35 * speed * math.sqrt(world.k_c * world.M)
        world.elastic = lambda d, rate: limit * math.tanh(world.k_c * d / limit)

    return simulate(edit), []  # it acts everywhere: nobody can be said to have found where


def unit_error(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """One session is noted in another unit: root mean square, or from peak to peak."""
    k = _one(experiment, um, rng)
    um[parts(experiment)[k]] *= float(rng.choice([0.5, 1 / math.sqrt(2), 2.0]))
    return um, [Place(experiment.groups[k].id)]


def threshold(experiment: Experiment, um: FloatArray, simulate: Simulator, rng: np.random.Generator) -> Changed:
    """A trigger that small excursions do not release: they read as zero."""
    low = float(np.quantile(um[um > 1.0], rng.uniform(0.2, 0.35)))
    hit = um < low
    places = [p for g, s in zip(experiment.groups, parts(experiment), strict=True) for p in span(g, hit[s])]
    return np.where(hit, 0.0, um), places


def _one(experiment: Experiment, um: FloatArray, rng: np.random.Generator) -> int:
    """A session with readings to speak of."""
    rich = [k for k, s in enumerate(parts(experiment)) if np.median(um[s]) > 1.0]
    return int(rng.choice(rich))


def _resampled(values: FloatArray, n: int) -> FloatArray:
    return np.interp(np.linspace(0, 1, n), np.linspace(0, 1, len(values)), values)


_EFFECTS: Sequence[tuple[Callable[..., Changed], str]] = (
    (frame_resonance, "about the frame's own frequency"),
    (clipping, "where ranges are large"),
    (drift, "in one session, more with every reading"),
    (swapped_groups, "in two sessions"),
    (yielding_contact, "everywhere"),
    (unit_error, "in one session"),
    (threshold, "where ranges are small"),
)
OUTSIDE = tuple(Outside(effect.__name__, effect, where) for effect, where in _EFFECTS)

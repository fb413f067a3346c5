"""Sweeps of a rig whose truth is the baseline with some causes, and what spoils them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from rigs import RIG

from psafit.experiment import Experiment, Group, fingerprint, read_experiment
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.model_search import SearchSettings
from psafit.physics import terms
from psafit.simulate import MICRO, Design, simulate

TRUTH = [1.5e6, 3e3, 60.0]
# Causes with a closed form: cheap, and of different kinds.
FEW = terms(["amplifier_lag", "stack_stiffness", "flight_friction", "reading_offset"])
# A search that looks a few times: for tests of what is done with one, not of what it finds.
CHEAP = SearchSettings(draws=64, starts=4, alone_draws=128, alone_starts=8, effective=60.0)


def experiment(ids=(), values=(), *, seed=0, n=24, spoil=None, relative=0.04, groups=("a", "b", "c")) -> Experiment:
    """Three sweeps of a rig whose truth is the baseline with some causes, and scatter."""
    rng = np.random.default_rng(seed)
    plan = [
        ("sine", np.geomspace(200, 2e4, n), np.full(n, 20.0)),
        ("sine", np.full(n, 1200.0), np.linspace(3, 20, n)),
        ("square", np.geomspace(200, 2e4, n), np.full(n, 12.0)),
    ][: len(groups)]
    made = []
    for name, (waveform, f, v) in zip(groups, plan, strict=True):
        design = Design.sweep(RIG, waveform, f, v)
        true = simulate(design, [*TRUTH, *values], terms(ids)).launch_range[0] * MICRO
        y = true * (1 + relative * rng.standard_normal(n)) + 0.05 * rng.standard_normal(n)
        if spoil:
            y = spoil(name, y)
        made.append(Group(name, waveform, f"{name}.csv", f, v, np.maximum(y, 0.0).round(3)))
    return Experiment("a rig", "a test", RIG, tuple(made), Path(), fingerprint(RIG, tuple(made)))


def problem(e: Experiment, groups=None) -> Problem:
    return Problem(e, groups or e.ids)


def bump(name, y):
    """A resonance that no cause describes, in one stretch of one sweep."""
    return y * (1 + 0.8 * np.exp(-(((np.arange(y.size) - 15) / 2.0) ** 2))) if name == "a" else y


def narrow(name, y):
    """A resonance that one reading of each frequency sweep meets."""
    z = y.copy()
    z[9] *= 1.4 if name in "ac" else 1.0
    return z


def unit(name, y):
    return 2.0 * y if name == "c" else y


def slip(name, y):
    """One misplaced decimal point."""
    z = y.copy()
    z[7] *= 10.0 if name == "b" else 1.0
    return z


def few(readings: list[float], amplitude: float = 20.0) -> Experiment:
    n = len(readings)
    one = Group("a", "sine", "a.csv", np.geomspace(500, 2000, n), np.full(n, amplitude), np.array(readings))
    return Experiment("a rig", "a test", RIG, (one,), Path(), fingerprint(RIG, (one,)))


def rig_with_two_modes(seed: int) -> tuple[Problem, np.ndarray]:
    """A hardly damped stack with a lossy contact, which reads like a damped one with a stiff contact; and its truth."""
    design = read_experiment(Path(__file__).parents[1] / "experiments" / "psa")
    p = Problem(design, design.ids)
    truth = p.to_sampling(np.array([7.7e6, 51.0, 7600.0, 0.16, 0.013, 60.0]))
    readings = noise.draw(p.predict(truth[None]), p.noise_values(truth[None]), None, np.random.default_rng(seed))[0]
    return replace(p, experiment=design.with_readings(np.maximum(readings, 0.0))), truth

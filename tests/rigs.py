"""Small rigs whose truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from psafit.experiment import Constants, Experiment, Group, fingerprint
from psafit.physics import terms
from psafit.simulate import Design, simulate

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
TRUTH = np.array([4.0e5, 9.0e3, 60.0])


def measure(
    rng: np.random.Generator,
    relative: float = 0.05,
    absolute: float = 0.05,
    readings: tuple[int, int, int] = (30, 20, 12),
) -> Experiment:
    """Three groups drawn from the baseline, with normal scatter (um)."""
    a, b, c = readings
    conditions = (
        ("sine", np.geomspace(100, 2e4, a), np.full(a, 20.0)),
        ("square", np.geomspace(50, 2e4, b), np.full(b, 15.0)),
        ("sine", np.full(c, 1500.0), np.linspace(2, 20, c)),
    )
    groups = []
    for number, (waveform, f, v) in enumerate(conditions, 1):
        true = simulate(Design.sweep(RIG, waveform, f, v), TRUTH).launch_range[0] * 1e6
        read = true * (1 + relative * rng.standard_normal(f.size)) + absolute * rng.standard_normal(f.size)
        groups.append(Group(number, waveform, f"{number}.csv", f, v, np.maximum(np.round(read, 2), 0.0)))  # type: ignore[arg-type]
    return Experiment("A rig with known truth", "drawn", RIG, tuple(groups), Path("known"), fingerprint(RIG, groups))


def rig(ids: list[str], values: list[float], seed: int, scatter: float = 0.02) -> Experiment:
    """Two sweeps by frequency and one by voltage, with causes at work."""
    frequency, amplitude = np.geomspace(200, 8000, 16), np.linspace(2, 20, 12)
    conditions = [(frequency, np.full(16, 20.0)), (frequency, np.full(16, 10.0)), (np.full(12, 1200.0), amplitude)]
    rng = np.random.default_rng(seed)
    groups = []
    for id, (f, v) in enumerate(conditions, start=1):
        design = Design.sweep(RIG, "sine", f, v)
        clean = simulate(design, [8e5, 3000.0, 150.0, *values], terms(ids)).launch_range[0] * 1e6
        read = np.maximum(clean * (1 + scatter * rng.standard_normal(f.size)), 0.0)
        groups.append(Group(id, "sine", f"g{id}.csv", f, v, read))
    return Experiment("made up", "a simulation", RIG, tuple(groups), Path("made-up"), fingerprint(RIG, groups))

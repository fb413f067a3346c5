"""Shared: a small rig whose truth is known."""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from types import ModuleType

# As the command line does: threads of the linear algebra library only wait for each other on our small matrices.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

from psafit.experiment import Constants, Experiment, Group, fingerprint, write_experiment
from psafit.simulate import Design, simulate

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
TRUTH = np.array([4.0e5, 9.0e3, 60.0])


def measure(rng: np.random.Generator, relative: float = 0.05, absolute: float = 0.05) -> Experiment:
    """Three groups drawn from the baseline, with normal scatter (um)."""
    conditions = (
        ("sine", np.geomspace(100, 2e4, 30), np.full(30, 20.0)),
        ("square", np.geomspace(50, 2e4, 20), np.full(20, 15.0)),
        ("sine", np.full(12, 1500.0), np.linspace(2, 20, 12)),
    )
    groups = []
    for number, (waveform, f, v) in enumerate(conditions, 1):
        true = simulate(Design.sweep(RIG, waveform, f, v), TRUTH).launch_range[0] * 1e6
        read = true * (1 + relative * rng.standard_normal(f.size)) + absolute * rng.standard_normal(f.size)
        groups.append(Group(number, waveform, f"{number}.csv", f, v, np.maximum(np.round(read, 2), 0.0)))  # type: ignore[arg-type]
    return Experiment("A rig with known truth", "drawn", RIG, tuple(groups), Path("known"), fingerprint(RIG, groups))


def loaded(script: Path) -> ModuleType:
    """A script of the docs, as a module."""
    spec = importlib.util.spec_from_file_location(script.stem, script)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def known() -> Experiment:
    return measure(np.random.default_rng(5))


@pytest.fixture(scope="session")
def known_folder(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "known"
    write_experiment(known, folder)
    return folder

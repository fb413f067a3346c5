"""A problem of two groups, and a finished run of it."""

from __future__ import annotations

import pytest

from psafit.experiment import Experiment
from psafit.inference import run as running
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.inference.samplers.emcee import Settings

QUICK = Settings(r_hat=1.03, max_steps=6000)


@pytest.fixture(scope="session")
def problem(known: Experiment) -> Problem:
    return Problem(known, (1, 2))


@pytest.fixture(scope="session")
def finished(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("run") / "r"
    return running.fit(known, [1, 2], folder, seed=4, n_starts=12, settings=QUICK)

"""Differential evolution: errors are the model's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import experiment, problem

from psafit.errors import ConvergenceError
from psafit.inference import optimiser
from psafit.inference.candidate import fit
from psafit.inference.evolution import evolved
from psafit.inference.problem import Problem


def test_what_a_model_raises_within_a_population_is_not_taken_for_scipys(monkeypatch):
    def fails(self, u):
        raise ValueError("out of the sensor's range")

    rig = problem(experiment(["amplifier_lag"], [8e-5], n=12, seed=3))
    known = rig.prior_transform(np.full((1, rig.n_dim), 0.5))
    monkeypatch.setattr(Problem, "log_posterior", fails)
    with pytest.raises(ValueError, match="sensor's range"):
        evolved(rig, known, seed=1)
    monkeypatch.setattr(Problem, "log_posterior", lambda self, u: np.full(len(u), -np.inf))
    monkeypatch.setattr(optimiser, "log_posteriors", lambda problem, u, *rest: np.full(len(u), -np.inf))
    with pytest.raises(ConvergenceError, match="finite posterior"):
        fit(replace(rig, terms=()), (), seed=1)

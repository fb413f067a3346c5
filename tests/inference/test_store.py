"""Diagnostics of chains and of weights."""

from __future__ import annotations

import numpy as np
import pytest

from psafit.inference import store
from psafit.inference.store import pareto_k, rounded_r_hat, smoothed


def test_pareto_k_is_that_of_the_weights():
    """Of weights with a Pareto law of index 2 it is one half; of their inverses, which are bounded, below zero."""
    log_weights = np.random.default_rng(1).exponential(0.5, 4000)
    assert pareto_k(log_weights) == pytest.approx(0.5, abs=0.15)
    assert pareto_k(-log_weights) < 0


def test_a_tail_beyond_all_floats_is_smoothed_without_a_warning() -> None:
    weights, tail = smoothed(np.linspace(-7000, 0, 1000))
    assert tail > 100 and np.exp(weights).sum() == pytest.approx(1) and weights[-1] == weights.max()


def test_an_r_hat_is_printed_on_its_side_of_the_goal() -> None:
    reported = [rounded_r_hat(value, 1.01) for value in (1.0099, 1.002, 1.00999, 1.01, 1.0100001, 1.9)]
    assert reported == ["1.0099", "1.0020", "1.00999", "1.0100", "1.0101", "1.9000"]


def test_diagnostics_separate_mixed_from_stuck() -> None:
    rng = np.random.default_rng(0)
    mixed = rng.standard_normal((8, 400, 1))
    stuck = mixed + 3 * np.arange(8)[:, None, None]
    assert store.r_hat(mixed)[0] < 1.01 < 1.5 < store.r_hat(stuck)[0]
    health = store.diagnostics(mixed)
    assert health["ess_bulk"][0] > 2000 and health["ess_tail"][0] > 1000

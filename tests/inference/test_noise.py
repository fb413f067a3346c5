"""The scatter of readings against SciPy's distributions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from psafit.inference import noise
from psafit.inference.problem import Problem


def test_noise_density_is_students(problem: Problem) -> None:
    observed, predicted = np.array([3.0, 0.0, 50.0]), np.array([[2.5, 0.01, 60.0]])
    values, known = np.array([[0.1, 0.05, 4.0]]), np.array([0.0, 0.02, 3.0])
    s = np.sqrt(0.05**2 + (0.1 * predicted) ** 2 + known**2)
    assert noise.log_density(observed, predicted, values, known) == pytest.approx(
        stats.t.logpdf(observed, 4, predicted, s), rel=1e-12
    )
    assert noise.cumulative(observed, predicted, values, known) == pytest.approx(
        stats.t.cdf(observed, 4, predicted, s), rel=1e-12
    )


def test_noise_draws_follow_the_density() -> None:
    rng = np.random.default_rng(1)
    predicted = np.full((20_000, 1), 5.0)
    values = np.tile([0.1, 0.2, 5.0], (20_000, 1))
    draws = noise.draw(predicted, values, None, rng)
    s = np.hypot(0.2, 0.5)
    assert stats.kstest(draws[:, 0], stats.t(5, 5.0, s).cdf).pvalue > 1e-4

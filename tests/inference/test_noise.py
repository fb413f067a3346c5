"""The scatter of readings against SciPy's distributions."""

from __future__ import annotations

from pathlib import Path

import mpmath
import numpy as np
import pytest
from rigs import RIG
from scipy import stats

from psafit.experiment import Experiment, Group, fingerprint
from psafit.inference import noise
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import terms
from psafit.simulate import Design, simulate


def test_noise_density_is_students() -> None:
    observed, predicted = np.array([3.0, 0.02, 50.0]), np.array([[2.5, 0.01, 60.0]])
    values, known = np.array([[0.1, 0.05, 4.0]]), np.array([0.0, 0.02, 3.0])
    s = np.sqrt(0.05**2 + (0.1 * predicted) ** 2 + known**2)
    assert noise.log_density(observed, predicted, values, known) == pytest.approx(
        stats.t.logpdf(observed, 4, predicted, s), rel=1e-12
    )
    assert noise.cumulative(observed, predicted, values, known) == pytest.approx(
        stats.t.cdf(observed, 4, predicted, s), rel=1e-12
    )


@pytest.mark.parametrize("nu", [2.0, 4.0, 100.0])
def test_a_zero_says_that_a_reading_was_zero_at_most(nu: float) -> None:
    """Its probability is what the law has below zero, into the far tail, and what remains is density."""
    predicted = np.array([[0.0, 0.1, 3.0, 1e3, 1e9]])
    found = noise.log_density(np.zeros(5), predicted, np.array([[1e-3, 0.1, nu]]), None)[0]
    s = np.hypot(1e-3 * predicted[0], 0.1)
    with mpmath.workdps(40):
        for p, size, value in zip(predicted[0], s, found, strict=True):
            x = mpmath.mpf(p) / mpmath.mpf(size)
            share = mpmath.betainc(nu / 2, 0.5, 0, nu / (nu + x * x), regularized=True) / 2
            assert value == pytest.approx(float(mpmath.log(share)), rel=1e-4)
    y = np.linspace(1e-9, 60, 400_001)
    density = noise.log_density(y, np.full((1, y.size), 0.1), np.array([[1e-3, 0.1, nu]]), None)[0]
    assert np.trapezoid(np.exp(density), y) + np.exp(found[1]) == pytest.approx(1.0, abs=1e-5)


def test_scores_are_derivatives_of_the_density() -> None:
    """By the predicted range, the scatter's size and its tails, for readings and for zeros."""
    observed, predicted = np.array([3.0, 0.0, 0.0, 0.0, 50.0]), np.array([[2.5, 0.0, 0.01, 4.0, 60.0]])

    def density(predicted, sigma_abs, nu):  # type: ignore[no-untyped-def]
        return noise.log_density(observed, predicted, np.array([[1e-9, sigma_abs, nu]]), None)

    z, nu, zero, by = (observed - predicted) / 0.5, np.array([[4.0]]), observed == 0, 1e-5
    pull = noise.pull(z, nu, zero)
    slope = (density(predicted + by, 0.5, 4.0) - density(predicted - by, 0.5, 4.0)) / (2 * by)
    assert pull / 0.5 == pytest.approx(slope, rel=1e-6)
    slope = (density(predicted, 0.5 * np.exp(by), 4.0) - density(predicted, 0.5 * np.exp(-by), 4.0)) / (2 * by)
    assert z * pull - ~zero == pytest.approx(slope, rel=1e-5, abs=1e-9)
    slope = (density(predicted, 0.5, 4.0 * np.exp(by)) - density(predicted, 0.5, 4.0 * np.exp(-by))) / (2 * by)
    assert noise.tail_score(z, nu, zero) == pytest.approx(slope, rel=1e-5, abs=1e-9)


def test_noise_draws_follow_the_density() -> None:
    rng = np.random.default_rng(1)
    predicted = np.full((20_000, 1), 5.0)
    values = np.tile([0.1, 0.2, 5.0], (20_000, 1))
    draws = noise.draw(predicted, values, None, rng)
    s = np.hypot(0.2, 0.5)
    assert stats.kstest(draws[:, 0], stats.t(5, 5.0, s).cdf).pvalue > 1e-4


def test_a_row_of_zeros_does_not_stand_for_a_perfect_instrument() -> None:
    """A ball behind a gap: failed launches read zero, the others scatter by 0.3 um and 4 %."""
    rng = np.random.default_rng(1)
    volt = np.linspace(1, 20, 30)
    design = Design.sweep(RIG, "sine", 800.0, volt)
    true = simulate(design, np.array([[1.2e6, 1.1e4, 60.0, 8e-7]]), terms(["gap"])).launch_range[0] * 1e6
    read = np.where(true > 0, true * (1 + 0.04 * rng.standard_normal(30)) + 0.3 * rng.standard_normal(30), 0.0)
    group = Group(1, "sine", "group1.csv", np.full(30, 800.0), volt, np.maximum(read, 0.0))
    assert 8 < np.sum(group.reading == 0) < 22
    experiment = Experiment("Gap", "drawn", RIG, (group,), Path(), fingerprint(RIG, (group,)))
    best = fit(Problem(experiment, (1,), terms(["gap"])), (), seed=1)
    assert 0.03 < best.noise[0, 1] < 1.0

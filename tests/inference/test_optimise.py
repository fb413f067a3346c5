"""The search for the best parameter values."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs import TRUTH, measure, rig

from psafit.errors import ConvergenceError
from psafit.experiment import Experiment, read_experiment
from psafit.inference import optimise as searching
from psafit.inference.optimise import gradient, hessian, laplace_covariance, optimise
from psafit.inference.problem import Problem
from psafit.physics import terms


def test_curvature_of_a_known_function() -> None:
    matrix = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, -0.2], [0.0, -0.2, 4.0]])
    found = hessian(lambda u: 0.5 * np.einsum("ni,ij,nj->n", u, matrix, u), np.array([0.3, -1.0, 2.0]))
    assert found == pytest.approx(matrix, abs=1e-6)


def test_search_finds_the_truth_from_any_seed(problem: Problem) -> None:
    for seed in (1, 2):
        optimum = optimise(problem, seed=seed, n_starts=12)
        assert optimum.best.values[:3] == pytest.approx(TRUTH, rel=0.35)
        assert sum(m.starts for m in optimum.minima) <= 12 and optimum.best.starts >= 1
        covariance = laplace_covariance(problem, problem.to_sampling(optimum.best.values))
        assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert "ln_k_c" in optimum.report


def test_the_report_is_of_the_best_wherever_lmfit_ended(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    best = optimise(problem, seed=1, n_starts=4)
    start = problem.to_sampling(best.best.values) + 0.05
    _, _, result = searching.climb(problem, start)
    monkeypatch.setattr(searching, "climb", lambda problem, start: (start, -np.inf, result))
    found = searching.improve(problem, best, start)
    told = {name: (float(x), float(s)) for name, x, s in re.findall(r"(\w+): +(\S+) \+/- (\S+)", found.report)}
    for i, name in enumerate(problem.names):
        sd = float(np.sqrt(found.covariance[0, i, i]))
        assert told[f"ln_{name}"] == pytest.approx((start[i], sd), rel=1e-6)
        assert told[name] == pytest.approx((np.exp(start[i]), np.exp(start[i]) * sd), rel=1e-6)


def test_a_search_begins_where_it_is_told_to(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Places that are known take the place of other starts; beyond the bounds they are at them."""
    best = optimise(problem, seed=1, n_starts=12).best
    begun: list[np.ndarray] = []
    own = searching.ascend
    monkeypatch.setattr(searching, "ascend", lambda p, starts, **k: begun.append(starts) or own(p, starts, **k))
    near = problem.to_sampling(best.values) + 0.3
    beyond = problem.bounds[:, 1] + 1
    found = optimise(problem, seed=5, n_starts=2, known=np.stack([near, beyond, near]))
    assert np.array_equal(begun[0], [near, problem.bounds[:, 1]])
    assert found.best.values == pytest.approx(best.values, rel=0.02)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_model_that_cannot_be_evaluated_ends_the_search_in_one_line(
    known: Experiment, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    monkeypatch.setattr(Problem, "predict", lambda self, u, *a: np.full((len(u), self.observed.size), value))
    with np.errstate(all="ignore"), pytest.raises(ConvergenceError, match="finite posterior"):
        optimise(Problem(known, (1,)), seed=1, n_starts=3)


def test_a_flat_top_makes_no_noise() -> None:
    """One amplitude sweep leaves a sheet of equal fits, on which lmfit's own error estimates are not finite."""
    psa = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    assert optimise(Problem(psa, (3,)), seed=1, n_starts=6).minima  # a warning would be an error


@pytest.mark.slow
def test_posteriors_are_calibrated() -> None:
    """Truths lie within the Laplace approximation about as often as it says; ranks among draws: benchmarks/sbc.py."""
    z = []
    for seed in range(24):
        experiment = measure(np.random.default_rng(1000 + seed))
        problem = Problem(experiment, (1, 2, 3))
        optimum = optimise(problem, seed=seed, n_starts=8)
        top = problem.to_sampling(optimum.best.values)
        sd = np.sqrt(np.diag(optimum.covariance[0]))
        z.append((top[:3] - np.log(TRUTH)) / sd[:3])
    spread = np.array(z)
    assert np.abs(spread.mean(axis=0)).max() < 4 / np.sqrt(24)
    assert ((spread**2).mean(axis=0) < 2.5).all() and ((spread**2).mean(axis=0) > 0.3).all()


@pytest.mark.parametrize(
    ("ids", "values"), [(["flight_friction"], [0.06]), pytest.param(["hertz_exponent"], [1.5], marks=pytest.mark.slow)]
)
def test_search_finds_the_cause_that_is_there(ids: list[str], values: list[float]) -> None:
    experiment = rig(ids, values, seed=5)
    problem = Problem(experiment, (1, 2), terms(ids))
    found = optimise(problem, seed=1, n_starts=8).best
    without = optimise(replace(problem, terms=()), seed=1, n_starts=8).best
    assert found.log_posterior > without.log_posterior + 10
    # The third group, never fitted, is predicted to its scatter.
    predicted = problem.predict(problem.to_sampling(found.values)[None, :], [3])[0]
    assert np.sqrt(np.mean(np.log(predicted / experiment.group(3).launch_range_um) ** 2)) < 0.06
    strength = found.values[problem.names.index(problem.terms[0].strength.name)]
    assert strength == pytest.approx(values[0], rel=0.5)


def test_a_cause_never_fits_worse_than_none() -> None:
    experiment = rig([], [], seed=2)
    nothing = optimise(Problem(experiment, (1,)), seed=1, n_starts=8).best.log_posterior
    for id in ("amplifier_lag", "preload"):
        problem = Problem(experiment, (1,), terms([id]))
        strength = problem.terms[0].strength
        neutral = float(strength.log_prior(strength.to_sampling(strength.neutral)))
        assert optimise(problem, seed=1, n_starts=8).best.log_posterior > nothing + neutral - 1.0


def test_gradient_is_one_sided_at_a_bound() -> None:
    slope = gradient(lambda u: np.sqrt(u[:, 0]) + 2 * u[:, 1], np.array([1.0, 0.0]), np.array([[0.0, 1.0], [0.0, 5.0]]))
    assert slope == pytest.approx([0.5, 2.0], rel=1e-3)

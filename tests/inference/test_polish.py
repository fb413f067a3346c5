"""The search for the best parameter values: many starts, and lmfit's polish of what they lead to."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs import TRUTH, measure, rig

from psafit.errors import ConvergenceError
from psafit.experiment import Experiment, read_experiment
from psafit.inference.candidate import Candidate, candidate_at, fit
from psafit.inference.polish import polish, report
from psafit.inference.problem import Problem
from psafit.physics import terms


def found(problem: Problem, seed: int = 1, most: int = 8) -> Candidate:
    """A fit from nothing; of a model with causes, from one without."""
    nested = [found(replace(problem, terms=()), seed, most)] if problem.terms else []
    return fit(problem, nested, seed=seed, draws=32 * most, most=most)


def test_search_finds_the_truth_from_any_seed(problem: Problem) -> None:
    for seed in (1, 2):
        best = found(problem, seed, 12)
        assert best.values[:3] == pytest.approx(TRUTH, rel=0.35)
        assert best.effort.begun == 12 and best.starts[0] >= 1 and best.starts.sum() <= 12
        assert (np.linalg.eigvalsh(best.covariance) > 0).all()


def test_lmfit_polishes_what_was_found(problem: Problem) -> None:
    """From a little next to the top it is led back; the report is of the best wherever its own part has ended."""
    best = found(problem)
    start = best.modes[0] + 0.05
    _, log_posterior, result = polish(problem, start)
    assert log_posterior == pytest.approx(best.log_posterior, abs=0.01) and result.nfev > 0
    there = candidate_at(problem, start[None])
    table = re.findall(r"(\w+): +(\S+) \+/- (\S+)", report(result, start, there.covariance[0]))
    reported = {name: (float(x), float(s)) for name, x, s in table}
    for i, name in enumerate(problem.names):
        sd = float(np.sqrt(there.covariance[0, i, i]))
        assert reported[f"ln_{name}"] == pytest.approx((start[i], sd), rel=1e-6)
        assert reported[name] == pytest.approx((np.exp(start[i]), np.exp(start[i]) * sd), rel=1e-6)


def test_a_search_begins_where_it_has_to_begin(problem: Problem) -> None:
    """Beyond the bounds, at them."""
    best = found(problem, most=12)
    near = candidate_at(problem, np.clip(np.stack([best.modes[0] + 0.3, problem.bounds[:, 1]]), *problem.bounds.T))
    again = fit(problem, [near], seed=5, draws=64, most=2, fresh=False)
    assert again.values == pytest.approx(best.values, rel=0.02)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_model_that_cannot_be_evaluated_ends_the_search_in_one_line(
    known: Experiment, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    monkeypatch.setattr(Problem, "predict", lambda self, u, *a: np.full((len(u), self.observed.size), value))
    with np.errstate(all="ignore"), pytest.raises(ConvergenceError, match="finite posterior"):
        found(Problem(known, (1,)), most=3)


def test_a_flat_top_makes_no_noise() -> None:
    """One amplitude sweep leaves a sheet of equal fits, on which lmfit's own error estimates are not finite."""
    psa = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    best = found(Problem(psa, (3,)), most=6)
    assert polish(best.problem, best.modes[0])[1] > best.log_posterior - 0.01  # a warning would be an error


@pytest.mark.slow
def test_posteriors_are_calibrated() -> None:
    """Truths lie within the Laplace approximation about as often as it says; ranks among draws: benchmarks/sbc.py."""
    z = []
    for seed in range(24):
        experiment = measure(np.random.default_rng(1000 + seed))
        best = found(Problem(experiment, (1, 2, 3)), seed)
        sd = np.sqrt(np.diag(best.covariance[0]))
        z.append((best.modes[0, :3] - np.log(TRUTH)) / sd[:3])
    spread = np.array(z)
    assert np.abs(spread.mean(axis=0)).max() < 4 / np.sqrt(24)
    assert ((spread**2).mean(axis=0) < 2.5).all() and ((spread**2).mean(axis=0) > 0.3).all()


@pytest.mark.parametrize(
    ("ids", "values"), [(["flight_friction"], [0.06]), pytest.param(["hertz_exponent"], [1.5], marks=pytest.mark.slow)]
)
def test_search_finds_the_cause_that_is_there(ids: list[str], values: list[float]) -> None:
    experiment = rig(ids, values, seed=5)
    problem = Problem(experiment, (1, 2), terms(ids))
    best = found(problem)
    assert best.log_posterior > found(replace(problem, terms=())).log_posterior + 10
    # The third group, never fitted, is predicted to its scatter.
    predicted = problem.predict(best.modes[:1], [3])[0]
    assert np.sqrt(np.mean(np.log(predicted / experiment.group(3).reading) ** 2)) < 0.06
    strength = best.values[problem.names.index(problem.terms[0].strength.name)]
    assert strength == pytest.approx(values[0], rel=0.5)


def test_a_cause_never_fits_worse_than_none() -> None:
    experiment = rig([], [], seed=2)
    nothing = found(Problem(experiment, (1,))).log_posterior
    for id in ("amplifier_lag", "preload"):
        problem = Problem(experiment, (1,), terms([id]))
        strength = problem.terms[0].strength
        neutral = float(strength.log_prior(strength.to_sampling(strength.neutral)))
        assert found(problem).log_posterior > nothing + neutral - 1.0

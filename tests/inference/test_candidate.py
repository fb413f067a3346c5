"""Fits of a model with causes, from several places."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp
from truths import FEW, TRUTH, experiment, problem

from psafit.challenge.hide import make
from psafit.experiment import read_experiment
from psafit.inference.candidate import (
    Candidate,
    FitSettings,
    across_steps,
    built_up,
    candidate_at,
    fit,
    optimised,
    separate_modes,
)
from psafit.inference.evidence import importance_sample
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.inference.starts import joined_values
from psafit.physics import terms


def test_what_acts_by_steps_is_found_a_step_away():
    """Nothing leads uphill from 1.3 periods: ranges stay as they are until the tip strikes once more, or less."""
    repeated = terms(["repeat_impacts"])
    whole = replace(problem(experiment(["repeat_impacts"], [1.05], n=60, relative=0.02)), terms=repeated)
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    for name, value in zip(("k_c", "c_s", "c_c", "repeat_cycles"), (*TRUTH, 1.05), strict=True):
        k = whole.names.index(name)
        truth[k] = whole.parameters[k].to_sampling(value)
    best = maximise(whole, truth[None])
    away = best.u.copy()
    away[0, whole.names.index("repeat_cycles")] = 1.3
    stuck = maximise(whole, away)
    assert stuck.u[0, whole.names.index("repeat_cycles")] == 1.3 and stuck.log_posterior[0] < best.log_posterior[0] - 10
    assert across_steps(whole, stuck, FitSettings()).log_posterior.max() > best.log_posterior[0] - 1


@pytest.mark.parametrize("cycles", [1.6, 2.3])
def test_the_evidence_of_a_plateau_has_its_own_width(cycles):
    """Readings leave the length of the drive a tenth of its bounds' width, or a thousandth, which is 2 and 7 nats.

    Places by halves find the width to a factor of two. A second end on the plateau, and one on a lower step, hold no
    more than there is.
    """
    data = experiment(["repeat_impacts"], [cycles], relative=0.01)
    whole = replace(problem(data), terms=terms(["repeat_impacts"]))
    truth = dict(zip(("k_c", "c_s", "c_c", "repeat_cycles", "sigma_rel"), (*TRUTH, cycles, 0.01), strict=True))
    found = optimised(whole, joined_values(whole, truth)[None])
    k = whole.names.index("repeat_cycles")
    assert not found.slope[k].any()
    line = np.repeat(found.modes[:1], 2001, axis=0)
    line[:, k] += np.linspace(-0.5, 0.5, len(line))
    width = np.exp(whole.log_posterior(line) - found.log_posterior).mean()
    assert 0.5 < math.sqrt(2 * math.pi * found.covariance[0, k, k]) / width < 2.0
    assert found.laplace_of_one == pytest.approx(importance_sample(found, seed=1).log_evidence, abs=0.7)
    ends = np.repeat(found.modes[:1], 3, axis=0)
    ends[1:, k] += np.array([0.3, 1.0]) * width
    assert candidate_at(whole, ends).laplace_apart == pytest.approx(found.laplace_of_one, abs=0.3)


@pytest.mark.slow
def test_a_baseline_that_fails_is_fitted_where_readings_are_scatter(tmp_path):
    """Friction leads away by 400 nats; the baseline's best mode has 20 um of scatter and another contact."""
    design = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    causes = ["hunt_crossley", "flight_friction"]
    make(2886276895, tmp_path, design_of=design, kind="two", terms=causes, believed=True)
    data = read_experiment(tmp_path / "experiment")
    plain = Problem(data, data.ids)
    there = plain.to_sampling(np.array([2.78e7, 4.15e4, 339.0, 0.0169, 19.5, 15.6]))
    top = maximise(plain, there[None]).log_posterior[0]
    assert fit(plain, (), seed=1, draws=1024, most=24).log_posterior > top - 0.5


@pytest.mark.slow
def test_ends_of_optimisations_at_one_mode_are_one_mode(hidden):
    one = candidate_at(hidden.best_model.problem, hidden.best_model.modes[:1])
    assert one.laplace_apart == pytest.approx(one.mass[0])
    width = 1 / np.sqrt(one.curvature[0, 0, 0])
    for steps, counted in ((0.0, 1.0), (0.3, 1.0), (30.0, 2.0)):
        away = np.vstack([one.modes, one.modes])
        away[1, 0] += steps * width
        log_posteriors, curvature, mass = (
            np.concatenate([x, x]) for x in (one.log_posteriors, one.curvature, one.mass)
        )
        two = replace(one, modes=away, log_posteriors=log_posteriors, curvature=curvature, mass=mass)
        assert logsumexp(two.mass) == pytest.approx(one.mass[0] + math.log(2))
        assert math.exp(two.laplace_apart - one.mass[0]) == pytest.approx(counted, rel=0.05)


class TwoTops:
    """A posterior of two normal tops half a unit apart, of standard deviation `width` each."""

    bounds = np.array([[-5.0, 5.0], [-5.0, 5.0]])

    def __init__(self, width: float) -> None:
        self.width = width

    def log_posterior(self, u: np.ndarray) -> np.ndarray:
        square = [np.sum((u - [x, 0.0]) ** 2, axis=1) / self.width**2 for x in (0.0, 0.5)]
        return np.asarray(np.logaddexp(-0.5 * square[0], -0.5 * square[1]))


@pytest.mark.parametrize(("width", "expected"), [(0.05, [0, 1]), (0.2, [0])])
def test_modes_lie_apart_by_their_own_widths(width, expected):
    """Half a unit is ten widths of narrow tops, with nothing between them, and one broad top's own."""
    problem = TwoTops(width)
    modes = np.array([[0.0, 0.0], [0.5, 0.0]])
    curvature = np.repeat(np.eye(2)[None] / width**2, 2, axis=0)
    nothing, log_posterior = np.empty(0), problem.log_posterior(modes)
    tops = Candidate(
        problem, modes, log_posterior, nothing, nothing, curvature, nothing, log_posterior, nothing, (0, 0, 0)
    )
    assert separate_modes(tops) == expected


def test_a_fit_without_fresh_starts_holds_what_is_within_it():
    """However few starts a short fit has, it holds the smaller model's optimum."""
    e = experiment(["amplifier_lag"], [8e-5], n=60, seed=3)  # enough readings for optimisations on a quarter of them
    plain = fit(problem(e), (), seed=1, draws=1024, most=16)
    for term in FEW:
        short = fit(replace(plain.problem, terms=(term,)), [plain], seed=1, draws=32, most=2, fresh=False)
        assert short.log_likelihood > plain.log_likelihood - 0.5


@pytest.mark.slow
def test_a_model_of_many_causes_is_built_up():
    """It ends no lower than an optimisation from the truth, and says how far it is."""
    ids, values = ["amplifier_lag", "preload", "flight_friction"], [4e-5, 2e-5, 0.02]
    e = experiment(ids, values, n=16)
    whole = replace(problem(e), terms=terms(ids))
    reported = []
    found = built_up(whole, seed=1, progress=lambda done, total: reported.append((done, total)))
    assert reported == [(k, 6) for k in range(1, 7)] and set(found.ids) == set(ids)
    at = dict(zip([p.name for p in whole.parameters[: whole.n_physical]], [*TRUTH, *values], strict=True))
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    truth[: whole.n_physical] = [p.to_sampling(at[p.name]) for p in whole.parameters[: whole.n_physical]]
    assert found.log_posterior > maximise(whole, truth[None]).log_posterior.max() - 0.5


def test_thinning_keeps_small_groups():
    e = experiment(n=24)
    assert [g.n_points for g in e.thinned(3).groups] == [8, 8, 8]
    assert [g.n_points for g in experiment(n=6).thinned(3).groups] == [6, 6, 6]

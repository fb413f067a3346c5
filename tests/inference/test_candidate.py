"""Fits of a model with causes, from several places."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from truths import FEW, TRUTH, experiment, problem, rig_with_two_hills

from psafit.challenge.hide import make
from psafit.diagnose.screening import screen
from psafit.experiment import read_experiment
from psafit.inference import noise
from psafit.inference.ascent import ascend
from psafit.inference.candidate import _across_steps, built_up, fit, hills, scouted, settle_at, thinned
from psafit.inference.evidence import weigh
from psafit.inference.problem import Problem
from psafit.physics import TERMS, terms


def test_what_acts_by_steps_is_found_a_step_away():
    """Nothing leads uphill from 1.3 periods: ranges stay as they are until the tip strikes once more, or less."""
    repeated = terms(["repeat_impacts"])
    whole = replace(problem(experiment(["repeat_impacts"], [1.05], n=60, relative=0.02)), terms=repeated)
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    for name, value in zip(("k_c", "c_s", "c_c", "repeat_cycles"), (*TRUTH, 1.05), strict=True):
        k = whole.names.index(name)
        truth[k] = whole.parameters[k].to_sampling(value)
    best = ascend(whole, truth[None])
    away = best.u.copy()
    away[0, whole.names.index("repeat_cycles")] = 1.3
    stuck = ascend(whole, away)
    assert stuck.u[0, whole.names.index("repeat_cycles")] == 1.3 and stuck.height[0] < best.height[0] - 10
    assert _across_steps(whole, stuck).height.max() > best.height[0] - 1


@pytest.mark.slow
def test_a_baseline_that_fails_is_fitted_where_readings_are_scatter(tmp_path):
    """Friction leads away by 400 nats; the baseline's best hill has 20 um of scatter and another contact."""
    design = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    causes = ["hunt_crossley", "flight_friction"]
    make(2886276895, tmp_path, design_of=design, kind="two", terms=causes, believed=True)
    data = read_experiment(tmp_path / "experiment")
    plain = Problem(data, data.ids)
    there = plain.to_sampling(np.array([2.78e7, 4.15e4, 339.0, 0.0169, 19.5, 15.6]))
    top = ascend(plain, there[None]).height[0]
    assert fit(plain, (), seed=1, draws=1024, most=24).height > top - 0.5


@pytest.mark.slow
def test_ends_of_climbs_on_one_hill_are_one_hill(hidden):
    one = settle_at(hidden.leader.problem, hidden.leader.modes[:1])
    assert one.laplace_apart == pytest.approx(one.laplace)
    width = 1 / np.sqrt(one.curvature[0, 0, 0])
    for steps, counted in ((0.0, 1.0), (0.3, 1.0), (30.0, 2.0)):
        away = np.vstack([one.modes, one.modes])
        away[1, 0] += steps * width
        heights, curvature, mass = (np.concatenate([x, x]) for x in (one.heights, one.curvature, one.mass))
        two = replace(one, modes=away, heights=heights, curvature=curvature, mass=mass)
        assert two.laplace == pytest.approx(one.laplace + math.log(2))
        assert math.exp(two.laplace_apart - one.laplace) == pytest.approx(counted, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_second_hill_of_the_baseline_is_not_lost(seed):
    """A look elsewhere finds it from any one hill; the posterior of all of them holds the truth."""
    rig, truth = rig_with_two_hills(seed)
    found = fit(rig, (), seed=1, draws=4096, most=48)
    assert np.abs(found.modes[:, 1] - truth[1]).min() < 1.5
    apart = found.modes[hills(found)]
    assert len(apart) > 1
    for k in range(len(apart)):
        alone = settle_at(rig, apart[[k]])
        assert hills(alone) == [0]
        again = scouted(alone, seed=1)
        assert np.abs(again.modes[:, :3] - truth[:3]).max(axis=1).min() < 1.5
        assert scouted(alone, seed=1).modes.tobytes() == again.modes.tobytes()
    lower, upper = (w := weigh(found, seed=1)).quantiles(rig.to_physical(w.draws), [0.05, 0.95])
    assert (lower[:3] < rig.to_physical(truth)[:3]).all() and (rig.to_physical(truth)[:3] < upper[:3]).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_a_top_behind_cliffs_is_found_by_a_population(seed):
    """A stack that hardly rings, and a lag that decides when the ball leaves: ranges jump, and climbs stop early."""
    design = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    p = Problem(design, design.ids, tuple(t for t in TERMS if t.id == "amplifier_lag"))
    truth = p.to_sampling(np.array([134594.6, 9937.6, 35.3157, 6.4217e-7, 0.0362, 0.0536, 60.0]))
    y = noise.draw(p.predict(truth[None]), p.noise_values(truth[None]), None, np.random.default_rng(seed))[0]
    rig = replace(p, experiment=design.with_readings(np.maximum(y, 0.0)))
    there = float(ascend(rig, truth[None]).height[0])
    plain = fit(replace(rig, terms=()), (), seed=1, draws=4096, most=48)
    (beside,) = screen(plain, rig.terms)
    climbed = fit(rig, [plain], seed=1, extra=beside.starts)
    assert climbed.height < there - 3
    found = scouted(climbed, seed=1)
    assert found.height > there - 0.5
    assert scouted(climbed, seed=1).modes.tobytes() == found.modes.tobytes()


def test_a_fit_without_fresh_starts_holds_what_is_within_it():
    """However few starts a short fit has, it holds the smaller model's optimum."""
    e = experiment(["amplifier_lag"], [8e-5], n=60, seed=3)  # enough readings for climbs on a quarter of them
    plain = fit(problem(e), (), seed=1, draws=1024, most=16)
    for term in FEW:
        short = fit(replace(plain.problem, terms=(term,)), [plain], seed=1, draws=32, most=2, fresh=False)
        assert short.log_likelihood > plain.log_likelihood - 0.5


@pytest.mark.slow
def test_a_model_of_many_causes_is_built_up():
    """It ends no lower than a climb from the truth, and tells how far it is."""
    ids, values = ["amplifier_lag", "preload", "flight_friction"], [4e-5, 2e-5, 0.02]
    e = experiment(ids, values, n=16)
    whole = replace(problem(e), terms=terms(ids))
    told = []
    found = built_up(whole, seed=1, progress=lambda done, total: told.append((done, total)))
    assert told == [(k, 6) for k in range(1, 7)] and set(found.ids) == set(ids)
    at = dict(zip([p.name for p in whole.parameters[: whole.n_physical]], [*TRUTH, *values], strict=True))
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    truth[: whole.n_physical] = [p.to_sampling(at[p.name]) for p in whole.parameters[: whole.n_physical]]
    assert found.height > ascend(whole, truth[None]).height.max() - 0.5


def test_thinning_keeps_small_groups():
    e = experiment(n=24)
    assert [g.n_points for g in thinned(e, 3).groups] == [8, 8, 8]
    assert [g.n_points for g in thinned(experiment(n=6), 3).groups] == [6, 6, 6]

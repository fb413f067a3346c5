"""Samples of a model: what all else trusts."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from truths import experiment, problem, rig_with_two_modes

from psafit.experiment import read_experiment
from psafit.inference import noise
from psafit.inference import sample as sampling
from psafit.inference.candidate import FitSettings, candidate_at, fit, optimised, separate_modes
from psafit.inference.evidence import importance_sample
from psafit.inference.hopping import hopped
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.inference.sample import SampleSettings, joined, sample
from psafit.model_search import SearchSettings
from psafit.physics import TERMS, terms


def test_a_sample_goes_on_to_what_its_draws_show() -> None:
    """Begun far below the top, it ends no lower than hops from a fit of many starts."""
    one = replace(problem(experiment(["amplifier_lag"], [4e-5])), terms=terms(["amplifier_lag"]))
    best = hopped(fit(one, (), seed=2, draws=1024, most=24), seed=2)
    found, draws = sample(one, seed=1)
    better = SearchSettings().better
    assert found.log_posterior > best.log_posterior - better
    assert draws.log_posterior <= found.log_posterior + better and draws.standard_error < 1.0


@pytest.mark.slow
def test_looks_from_the_prior_agree_on_a_narrow_plateau() -> None:
    """The readings know the length of the drive a thousand times better than the prior; no slope leads there."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    e = import_module("search_sets").get("campaign-0130-modal_mass-repeat_impacts").experiment
    one = Problem(e, e.ids, terms(["stack_stiffness", "repeat_impacts"]))
    known, s = fit(replace(one, terms=()), (), seed=1), SearchSettings()
    looks = [sampling.first(one, [known], seed=1, settings=s)]
    looks += [sampling.second(one, [known], seed=seed, settings=s) for seed in (1, 2)]
    found = [look.laplace_apart for look in looks]
    assert max(found) - min(found) < 1.0  # widths of plateaus are good to a factor of two


@pytest.mark.parametrize(("ids", "by_themselves"), [(["gap"], True), (["gap", "preload", "amplifier_lag"], False)])
def test_draws_of_the_prior_start_by_themselves_where_causes_are_few(ids: list[str], by_themselves: bool) -> None:
    """The others are half as many, and crossed with what is known."""
    one = replace(problem(experiment()), terms=terms(ids))
    known = fit(one, (), seed=2, draws=64, most=4)
    few, many = (
        sampling.first(one, [known], seed=1, settings=SampleSettings(draws=draws, starts=4)).effort.n_sets
        for draws in (64, 4096)
    )
    assert (many - few > 4096) is by_themselves


def test_looks_are_taken_until_two_agree(monkeypatch) -> None:
    """And where none agrees, the evidence has an error of as much as the best look is above the next."""
    rig = problem(experiment())
    look = sampling.first(rig, (), seed=1, settings=SampleSettings())
    poor = candidate_at(rig, look.modes[:1] + 0.3)
    taken = []

    def looks(*found):
        taken.clear()
        left = list(found)
        monkeypatch.setattr(sampling, "fit", lambda *args, **options: taken.append(1) or left.pop(0))
        monkeypatch.setattr(sampling, "hopped", lambda candidate, **options: candidate)

    looks()
    _, sure = joined(look, look, seed=1, settings=SampleSettings())
    assert not taken and sure.error < 0.1
    looks(poor, look)
    found, again = joined(look, poor, seed=1, settings=SampleSettings())
    assert len(taken) == 2 and again.error < 0.1
    assert found.effort.begun == 2 * look.effort.begun and found.starts.sum() == 2 * look.starts.sum()
    looks(poor, poor)
    _, doubtful = joined(poor, look, seed=1, settings=SampleSettings(looks=3))
    assert len(taken) == 1
    gap = look.laplace_apart - poor.laplace_apart
    assert doubtful.error == pytest.approx(min(gap, SampleSettings().lacking), rel=0.1)
    looks(poor)
    _, counted = joined(poor, look, seed=1, settings=SampleSettings(looks=3, lacking=math.inf))
    assert counted.error == pytest.approx(gap, rel=0.1)


def test_draws_above_all_looks_lead_on() -> None:
    """Looks that have stopped below the top say nothing wrong of the model."""
    rig = problem(experiment())
    top = sampling.first(rig, (), seed=1, settings=SampleSettings())
    low = candidate_at(rig, top.modes[:1] + 0.05)
    assert low.log_posterior < top.log_posterior - 1.0
    found, draws = joined(low, low, seed=1, settings=SampleSettings())
    assert found.log_posterior == pytest.approx(top.log_posterior, abs=0.1)
    assert draws.error >= min(found.laplace_apart - low.laplace_apart, SampleSettings().lacking)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_a_second_mode_of_the_baseline_is_not_lost(seed):
    """A look elsewhere finds it from any one mode; the posterior of all of them holds the truth."""
    rig, truth = rig_with_two_modes(seed)
    found = fit(rig, (), seed=1, draws=4096, most=48, settings=FitSettings(readings=rig.observed.size))
    assert np.abs(found.modes[:, 1] - truth[1]).min() < 1.5
    apart = found.modes[separate_modes(found)]
    assert len(apart) > 1
    for k in range(len(apart)):
        alone = candidate_at(rig, apart[[k]])
        assert separate_modes(alone) == [0]
        again = sample(rig, [alone], seed=1)[0]
        assert np.abs(again.modes[:, :3] - truth[:3]).max(axis=1).min() < 1.5
    lower, upper = (w := importance_sample(found, seed=1)).quantiles(rig.to_physical(w.draws), [0.05, 0.95])
    assert (lower[:3] < rig.to_physical(truth)[:3]).all() and (rig.to_physical(truth)[:3] < upper[:3]).all()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 6])
def test_a_mode_behind_discontinuities_is_found_by_hops(seed):
    """A stack that hardly rings, and a lag that decides when the ball leaves: ranges jump; optimisations stop early."""
    design = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")
    p = Problem(design, design.ids, tuple(t for t in TERMS if t.id == "amplifier_lag"))
    truth = p.to_sampling(np.array([134594.6, 9937.6, 35.3157, 6.4217e-7, 0.0362, 0.0536, 60.0]))
    y = noise.draw(p.predict(truth[None]), p.noise_values(truth[None]), None, np.random.default_rng(seed))[0]
    rig = replace(p, experiment=design.with_readings(np.maximum(y, 0.0)))
    there = float(maximise(rig, truth[None]).log_posterior[0])
    plain = fit(replace(rig, terms=()), (), seed=1, draws=4096, most=48)
    stopped = optimised(rig, plain.placed(rig))
    assert stopped.log_posterior < there - 3
    assert sample(rig, [stopped], seed=1)[0].log_posterior > there - 0.5
    assert fit(rig, [plain], seed=1, fresh=False).log_posterior > there - 0.5, "a scan of the lag finds it, too"

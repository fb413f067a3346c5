"""Hops to higher tops next to known ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from truths import experiment, problem

from psafit.inference.candidate import candidate_at, candidate_of, fit
from psafit.inference.hopping import hopped
from psafit.inference.optimiser import maximise
from psafit.physics import terms


def test_hops_lead_on_from_where_a_fit_has_stopped():
    rig = replace(problem(experiment(["amplifier_lag"], [4e-5])), terms=terms(["amplifier_lag"]))
    stopped = fit(rig, (), seed=1)
    found = hopped(stopped, seed=1)
    assert found.log_posterior > stopped.log_posterior + 2.0
    assert found.starts.sum() <= stopped.starts.sum()
    assert found.effort.n_sets > stopped.effort.n_sets and found.effort.begun == stopped.effort.begun
    assert hopped(stopped, seed=1).modes.tobytes() == found.modes.tobytes()


def test_a_smooth_posterior_leads_nowhere():
    rig = problem(experiment())
    smooth = fit(rig, (), seed=1)
    found = hopped(smooth, seed=1)
    assert np.array_equal(found.modes, smooth.modes)
    assert found.effort.n_sets > smooth.effort.n_sets


def test_low_ends_hop_where_a_high_one_rises() -> None:
    """An end that is no top, next to the top of a smooth posterior, and of one whose ranges jump."""
    smooth, jagged = problem(experiment()), problem(experiment(["amplifier_lag"], [4e-5]))
    for rig, hops in ((smooth, False), (replace(jagged, terms=terms(["amplifier_lag"])), True)):
        top = fit(rig, (), seed=1)
        begun = np.vstack([top.modes[:1], top.modes[:1] + 0.12 * (np.arange(rig.n_dim) == 0)])
        both = candidate_of(rig, maximise(rig, begun, schedule=((0, 2),)), forgotten=math.inf)
        alone = candidate_at(rig, top.modes[:1])
        more = [hopped(one, seed=1, n_modes=1, most=2).effort.n_sets for one in (alone, both)]
        assert len(both.modes) == 2 and (more[1] - more[0] >= 64) is hops
        assert hopped(both, seed=1, n_modes=2, most=2).effort.n_sets >= more[0] + 64, "where it is among the highest"

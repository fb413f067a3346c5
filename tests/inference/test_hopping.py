"""Hops to higher tops next to known ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from truths import experiment, problem

from psafit.inference.candidate import fit
from psafit.inference.hopping import hopped
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

"""A fit's model on all the readings that there are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from psafit.diagnose.retest import retest
from psafit.experiment import Experiment
from psafit.inference import run as running
from psafit.inference.run_folder import Run


def with_reading(run: Run, group: int, factor: np.ndarray) -> Run:
    e = run.problem.experiment
    groups = tuple(replace(g, reading=g.reading * factor) if g.id == group else g for g in e.groups)
    return replace(run, problem=replace(run.problem, experiment=replace(e, groups=groups)))


def test_a_model_is_tested_on_groups_that_its_fit_has_not_seen(known: Experiment, tmp_path: Path) -> None:
    """Every second reading of another group is off: no other value of a parameter takes that up."""
    run = running.fit(known, [1], tmp_path / "r", seed=1, n_starts=8, sampled_by="importance")
    right = retest(run)
    assert (right.objection, right.n_simulated) == ("", 199) and right.p_value > 0.02
    n = known.group(2).n_points
    wrong = retest(with_reading(run, 2, np.where(np.arange(n) < n / 2, 1.0, 1.8)))
    assert wrong.objection == "tests" and wrong.p_value == 0.005
    assert retest(run) == right

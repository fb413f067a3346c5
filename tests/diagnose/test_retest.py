"""A fit's model on all the readings that there are."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from psafit.diagnose.retest import kept, once, retest
from psafit.errors import ConvergenceError
from psafit.experiment import Experiment
from psafit.inference import run as running
from psafit.inference.run_folder import Run, load
from psafit.parameters import Belief, Normal
from psafit.physics import terms
from psafit.records import Retested
from psafit.validate import validate


def with_reading(run: Run, group: int, factor: np.ndarray) -> Run:
    e = run.problem.experiment
    groups = tuple(replace(g, reading=g.reading * factor) if g.id == group else g for g in e.groups)
    return replace(run, problem=replace(run.problem, experiment=replace(e, groups=groups)))


def test_a_model_is_tested_on_groups_that_its_fit_has_not_seen(known: Experiment, by_importance: Path) -> None:
    """From its middle on another group is off: no other value of a parameter takes that up."""
    run = load(by_importance)
    right = retest(run)
    assert right is not None and (right.objection, right.n_simulated) == ("", 199) and right.p_value > 0.02
    n = known.group(2).n_points
    wrong = retest(with_reading(run, 2, np.where(np.arange(n) < n / 2, 1.0, 1.8)))
    assert wrong is not None and wrong.objection == "tests" and wrong.p_value == 0.005
    assert retest(run) == right


def test_a_model_with_causes_of_which_something_is_known_is_tested(known: Experiment, tmp_path: Path) -> None:
    """Such a cause is none of the catalogue's own; so is one that a plugin has."""
    belief = Belief("reading_offset", Normal(0.0, 1e-6), "a data sheet")
    (offset,) = terms(["reading_offset"])
    own = replace(known, beliefs=(replace(belief, name=offset.parameters[0].name),))
    run = running.fit(own, [1], tmp_path / "r", terms=[offset], seed=1, n_starts=8, sampled_by="importance")
    found = retest(run)
    assert found is not None and found.objection == ""


def test_what_cannot_be_tested_is_not_said_to_pass(by_importance: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    run = load(shutil.copytree(by_importance, tmp_path / "r"))
    assert retest(run, most_readings=10) is None
    assert kept(run) is None
    validate(run, n_draws=50, retest=lambda one: Retested("", 0.4, 199))
    assert kept(run) == once(run) == Retested("", 0.4, 199)  # no other is made
    assert kept(replace(run, fit=replace(run.fit, identity="another"))) is None

    def fails(*_: object, **__: object) -> None:
        raise ConvergenceError("nowhere", reached=0.0, required=1.0)

    monkeypatch.setattr("psafit.diagnose.retest.fit", fails)
    assert retest(run) is None

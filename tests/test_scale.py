"""A wrong unit is seen in the scale of the readings, and a true rig is hardly ever warned of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from psafit.experiment import Experiment, GroupId, read_experiment
from psafit.inference.problem import Problem
from psafit.inference.scale import with_scale

STUDY = read_experiment("experiments/psa")


def scaled(experiment: Experiment, factor: float, only: Sequence[GroupId] = ()) -> Experiment:
    groups = (
        replace(g, launch_range_um=g.launch_range_um * factor) if g.id in (only or experiment.ids) else g
        for g in experiment.groups
    )
    return replace(experiment, groups=tuple(groups))


def test_the_study_has_the_scale_of_its_rigs() -> None:
    assert with_scale(STUDY) is STUDY or with_scale(STUDY).warnings == STUDY.warnings == ()


@pytest.mark.parametrize(("factor", "words"), [(1e-3, "given in mm or m"), (1e3, "given in nm")])
def test_all_readings_in_another_unit(factor: float, words: str) -> None:
    (warning,) = with_scale(scaled(STUDY, factor)).warnings
    assert "98 % of the rigs that the prior holds" in warning and words in warning


@pytest.mark.parametrize("group", STUDY.ids)
@pytest.mark.parametrize(("factor", "words"), [(1e-3, "below the other"), (1e3, "above the other")])
def test_one_group_in_another_unit(group: GroupId, factor: float, words: str) -> None:
    (warning,) = with_scale(scaled(STUDY, factor, [group])).warnings
    assert f"group {group}: " in warning and words in warning and warning.isprintable()


def test_of_two_groups_either_may_be_wrong() -> None:
    two = replace(STUDY, groups=STUDY.groups[:2])
    found = with_scale(scaled(two, 1e-3, [1])).warnings
    assert len(found) == 2
    assert "group 1: launch ranges lie below" in found[0] and "group 2: launch ranges lie above" in found[1]


def test_true_rigs_are_hardly_ever_warned_of() -> None:
    """Of rigs drawn from the prior one in fifty lies outside 98 % of it on either side; here fewer than one in five."""
    problem = Problem(STUDY, STUDY.ids)
    rng = np.random.default_rng(1)
    ranges = problem.predict(problem.prior_transform(rng.random((100, problem.n_dim))))
    warned = [bool(with_scale(STUDY.with_readings(r)).warnings) for r in ranges if (r > 0).all()]
    assert len(warned) > 50 and np.mean(warned) < 0.2


def test_nothing_launched_says_nothing() -> None:
    silent = STUDY.with_readings(np.zeros(sum(g.n_points for g in STUDY.groups)))
    assert with_scale(silent) is silent

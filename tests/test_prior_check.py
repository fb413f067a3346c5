"""A wrong unit is seen in the scale of the readings, and a true rig is hardly ever warned of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from psafit.drives import Drive
from psafit.experiment import Experiment, Group, GroupId, read_experiment
from psafit.experiment.rig import Rig
from psafit.inference.problem import Problem
from psafit.parameters import Belief, LogNormal
from psafit.prior_check import with_scale

STUDY = read_experiment("experiments/psa")


def scaled(experiment: Experiment, factor: float, only: Sequence[GroupId] = ()) -> Experiment:
    groups = (
        replace(g, reading=g.reading * factor) if g.id in (only or experiment.ids) else g for g in experiment.groups
    )
    return replace(experiment, groups=tuple(groups))


def test_the_study_has_the_scale_of_its_rigs() -> None:
    assert with_scale(STUDY) is STUDY or with_scale(STUDY).warnings == STUDY.warnings == ()


@pytest.mark.parametrize(
    ("factor", "ends", "words"),
    [
        (1e-3, "median 0.017 um, theirs at least", "given in mm or m, or as speeds in mm/s"),
        (1e3, "median 17000 um, theirs at most", "in um and taken for mm, 1000 times too large, or given in nm, are"),
    ],
)
def test_all_readings_in_another_unit(factor: float, ends: str, words: str) -> None:
    (warning,) = with_scale(scaled(STUDY, factor)).warnings
    assert f"98 % of the rigs that the prior holds ({ends} " in warning and words in warning
    median, limit = map(float, re.findall(r"([\d.]+) um[,)]", warning))
    assert (median < limit) == (factor < 1)


@pytest.mark.parametrize("factor", [1 / 5, 5])
def test_a_unit_is_not_blamed_where_it_would_lead_beyond_all_rigs(factor: float) -> None:
    """What is known of a rig may be wrong, too: a factor of five is not that of a unit."""
    stated = [("k_c", 3.7e6), ("c_s", 4.2e5), ("c_c", 6.2)]
    known = replace(STUDY, beliefs=tuple(Belief(name, LogNormal(median, 1.02), "x") for name, median in stated))
    assert with_scale(known).warnings == ()
    (warning,) = with_scale(scaled(known, factor)).warnings
    assert warning.endswith("; is a constant or a prior wrong?") and "1000" not in warning


def test_swapped_columns_may_be_the_cause() -> None:
    (warning,) = with_scale(scaled(STUDY, 1e3)).warnings
    assert "are columns swapped" in warning


SUSPICIOUS = {
    "kHz": lambda e: replace(e, groups=tuple(replace(g, frequency_hz=g.frequency_hz / 1e3) for g in e.groups)),
    "kV": lambda e: replace(e, groups=tuple(replace(g, amplitude_v=g.amplitude_v / 1e3) for g in e.groups)),
    "a stiffness in N/um": lambda e: replace(e, constants=replace(e.constants, k_s=e.constants.k_s / 1e6)),
    "a mass in g": lambda e: replace(e, constants=replace(e.constants, M=e.constants.M * 1e3)),
    "a radius": lambda e: replace(e, rig=Rig(ball_radius=9.4)),
}


@pytest.mark.parametrize("what", SUSPICIOUS)
def test_what_another_warning_explains_is_not_blamed_on_the_readings(what: str) -> None:
    """The readings are off the scale of these rigs, too."""
    assert with_scale(SUSPICIOUS[what](scaled(STUDY, 1e3))).warnings == ()


def test_a_group_whose_conditions_are_suspicious_leaves_the_others() -> None:
    first, *others = STUDY.groups
    odd = replace(STUDY, groups=(replace(first, frequency_hz=first.frequency_hz / 1e3), *others))
    assert with_scale(odd).warnings == ()
    (warning,) = with_scale(scaled(odd, 1e3, [3])).warnings
    assert "group 3: launch ranges lie above the other" in warning


@pytest.mark.parametrize("group", STUDY.ids)
@pytest.mark.parametrize(("factor", "words"), [(1e-3, "below the other"), (1e3, "above the other")])
def test_one_group_in_another_unit(group: GroupId, factor: float, words: str) -> None:
    (warning,) = with_scale(scaled(STUDY, factor, [group])).warnings
    assert f"group {group}: " in warning and words in warning and warning.isprintable()


@pytest.mark.parametrize("group", [1, 2])
@pytest.mark.parametrize(("factor", "way"), [(1e-3, "below"), (1e3, "above")])
def test_of_two_groups_the_one_that_no_rig_gives_is_named(group: GroupId, factor: float, way: str) -> None:
    two = replace(STUDY, groups=STUDY.groups[:2])
    (warning,) = with_scale(scaled(two, factor, [group])).warnings
    assert f"group {group}: launch ranges lie {way}" in warning


def test_of_two_groups_either_may_be_wrong() -> None:
    """Each is what some rig would give, but no rig gives both."""
    two = replace(STUDY, groups=STUDY.groups[:2])
    (warning,) = with_scale(scaled(scaled(two, 1 / 8, [1]), 8.0, [2])).warnings
    assert "group 1: launch ranges differ from those of group 2 by a factor" in warning


def test_a_reading_without_a_drive_gives_no_scale() -> None:
    first = STUDY.groups[0]
    rest = Group("rest", "sine", "rest.csv", np.full(5, 1e3), np.zeros(5), np.full(5, 0.05))
    assert with_scale(replace(STUDY, groups=(first, rest))).warnings == ()


def test_a_group_of_which_one_reading_counts_does_not_switch_the_check_off() -> None:
    first = STUDY.groups[0]
    rows = np.arange(2400) % first.n_points
    read = np.where(np.arange(2400) == 1, first.reading[1], 0.0)
    silent = Group("long", "sine", "long.csv", first.frequency_hz[rows], first.amplitude_v[rows], read)
    longer = scaled(replace(STUDY, groups=(*STUDY.groups, silent)), 1e-3, [3])
    (warning,) = with_scale(longer).warnings
    assert "group 3: launch ranges lie below" in warning


@pytest.mark.slow
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


def test_a_drive_that_launches_no_ball_is_named_as_that() -> None:
    """A bias of the wrong sign draws the tip back: no unit of the readings explains that."""
    drawn_back = replace(STUDY.groups[1], drive=Drive("sine", bias_v=-500.0))
    (warning,) = with_scale(replace(STUDY, groups=(STUDY.groups[0], drawn_back))).warnings
    assert "group 2: this drive launches no ball" in warning and "sign of the voltage" in warning

"""Laws that hold whatever the causes are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rigs import RIG
from truths import experiment, problem

from psafit.experiment import Experiment, Group, fingerprint
from psafit.inference.candidate import Candidate
from psafit.inference.laws import LawSettings, broken
from psafit.inference.problem import Problem
from psafit.physics import term, terms
from psafit.physics.term import Term
from psafit.simulate.contract import STUDY
from psafit.simulate.literal import energy, literal_launch
from psafit.simulate.reference import Point


def slow() -> Experiment:
    """A sweep at frequencies at which the tip carries the ball along."""
    f = np.array([10.0, 20.0, 50.0, 100.0])
    one = Group("slow", "sine", "slow.csv", f, np.full(f.size, 20.0), np.full(f.size, 2.0))
    return Experiment("a rig", "a test", RIG, (one,), Path(), fingerprint(RIG, (one,)))


def model(values: dict[str, float], *causes: Term, of: Experiment | None = None) -> Candidate:
    """A model at given values, as if they had been fitted; the others in the middle of their priors."""
    one: Problem = replace(problem(of or experiment([], [])), terms=causes)
    u = one.prior_transform(np.full(one.n_dim, 0.5))
    for name, value in values.items():
        i = one.names.index(name)
        u[i] = one.parameters[i].to_sampling(value)
    found: Any = SimpleNamespace(problem=one, modes=u[None], ids=one.ids, scatter=np.full(one.observed.size, 0.01))
    return found  # type: ignore[no-any-return]


def test_the_study_s_model_breaks_no_law() -> None:
    assert broken(model({"k_c": 1.425e5, "c_s": 13991.0, "c_c": 68.0})) == []


def test_a_ball_cannot_move_less_than_the_tip_carries_it() -> None:
    """A friction that takes nearly all of the swing, with a place at separation that counts and one that does not."""
    values = {"k_c": 1e6, "c_s": 500.0, "c_c": 50.0, "flight_friction_a": 1.0}
    without, within = terms(["flight_friction"]), terms(["flight_friction", "separation_height"])
    (found,) = broken(model(values, *without, of=slow()), LawSettings(margin=1.0))
    assert (found.law, found.terms) == ("carried", ["flight_friction"])
    assert found.limit - found.value > 0.03 and found.readings == 2
    assert f"group {found.group}" in found.text and "the tip carries the ball to" in found.text
    assert broken(model(values | {"separation_weight": 1.0}, *within, of=slow()), LawSettings(margin=1.0)) == []
    # A session that reads low breaks no law: it is the ball that is meant.
    gain = terms(["separation_height", "reading_gain"])
    assert broken(model({"separation_weight": 1.0, "reading_gain_spread": 0.5}, *gain, of=slow())) == []


def test_a_ball_cannot_gain_more_than_the_drive_gives() -> None:
    """A contact that pushes harder the faster it opens makes energy out of nothing."""

    def law(d: float, rate: float, p: Any, out: Any) -> None:
        out[3] = -out[3] * p[0]
        out[4] = -out[4] * p[0]
        out[5] = -out[5] * p[0]

    def literal(rig: Any, p: Any) -> None:
        damping = rig.damping
        rig.damping = lambda d, rate: -p[0] * damping(d, rate)

    cause = replace(term("hunt_crossley"), id="perpetual", law=law, literal=literal)
    values = {"k_c": 1e6, "c_s": 300.0, "c_c": 200.0, "hunt_crossley_lambda": 1.0}
    laws = {found.law: found for found in broken(model(values, cause))}
    assert laws["energy"].value > max(laws["energy"].limit, 0.0)


@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_the_work_of_the_drive_covers_what_the_rig_has_at_the_separation(waveform: Any) -> None:
    """The ball's energy, and that of the stack's spring, k_s x^2/2; with next to no damping there is little else."""
    point, pairs = Point(waveform, 1000.0, 20.0), [(term("modal_mass"), [0.02])]
    for damping, lost in ((20.0, 0.1), (2000.0, 1.0)):
        theta = [1e6, damping, 0.0]
        gained, given = energy(point, theta, pairs, STUDY)
        launch = literal_launch(point, theta, pairs, STUDY)
        spring = 0.5 * STUDY.k_s * launch.place**2
        assert gained == pytest.approx(0.5 * STUDY.M * launch.velocity**2, rel=1e-6)
        assert gained + spring < given
        if waveform == "sine":  # a jump leaves the stack ringing
            assert given < (gained + spring) * (1 + lost)

"""The oracle sees what was hidden, and nothing else."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from psafit.challenge.answer import EXPERIMENT, unseal
from psafit.challenge.conditions import ConditionSettings
from psafit.challenge.hide import make
from psafit.challenge.oracle import consult, find_rivals
from psafit.experiment import Experiment, read_experiment
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import term, terms


def test_an_oracle_sees_what_was_hidden(lagged: Path) -> None:
    experiment, answer = unseal(lagged)
    seen = consult(experiment, answer, seed=1)
    # The logarithm of the likelihood ratio scatters by about sqrt(2 x 30) about what is expected.
    assert abs(seen.gain - answer.expected_nats["amplifier_lag"]) < 5 * math.sqrt(60)
    # It is that of fits by another way.
    plain = fit(Problem(experiment, experiment.ids), (), seed=1, draws=512, most=8)
    right = fit(replace(plain.problem, terms=terms(["amplifier_lag"])), [plain], seed=1)
    assert seen.gain == pytest.approx(right.log_likelihood - plain.log_likelihood, abs=0.5)
    assert seen.gain > 0 and "amplifier_lag_tau" in seen.fitted and seen.without == {}


def test_an_oracle_sees_nothing_where_nothing_is(known: Experiment, tmp_path: Path) -> None:
    made = make(5, tmp_path, design_of=known, kind="nothing")
    assert consult(made.experiment, made.answer, seed=1).gain == 0.0


def test_a_rival_that_does_the_same_is_found(lagged: Path) -> None:
    """A copy of the cause by another name imitates it; a reading's offset does not imitate a lag of 30 nats."""
    experiment, answer = unseal(lagged)
    copy = replace(term("amplifier_lag"), id="lag_by_another_name")
    assert find_rivals(experiment, answer, [copy, term("reading_offset")]) == ["lag_by_another_name"]


@pytest.mark.slow
def test_what_a_cause_adds_is_seen_from_everywhere(tmp_path: Path) -> None:
    """What a cause adds is counted from the best fit without it, however far from the truth that lies."""
    like = ConditionSettings.like_the_study()
    made = make(
        2941797860, tmp_path, kind="two", terms=["slew_limit", "stack_stiffness"], strength=60.0, conditions=like
    )
    experiment = read_experiment(tmp_path / EXPERIMENT)
    found = consult(experiment, made.answer, seed=1)
    assert found.gain > 50 and found.without["slew_limit"] > 50
    plain, slow = (
        fit(Problem(experiment, experiment.ids, terms(ids)), (), seed=3, draws=2048, most=32)
        for ids in ([], ["slew_limit"])
    )
    alone = slow.log_likelihood - plain.log_likelihood
    assert found.without["stack_stiffness"] == pytest.approx(found.gain - alone, abs=0.5)

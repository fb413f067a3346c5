"""What a run says of its posterior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fits_by_hand import CONSTANTS, make_numerics, make_run

from psafit.cli.fitting import _say_fit
from psafit.inference.problem import Problem
from psafit.inference.summary import by_session, overdamped
from psafit.parameters import Belief, Normal
from psafit.physics import terms
from psafit.records import ParameterSummary, SessionSummary


def test_damping_beyond_the_critical_is_said_to_be_a_lag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Critical are 2 sqrt(25e6 x 0.107) = 3271 N s/m, with a quarter of the mass half of it."""
    run = make_run(tmp_path)
    assert (CONSTANTS.k_s, CONSTANTS.m) == (25e6, 0.107)
    _say_fit(run, make_numerics(run))
    assert "c_s is beyond critical damping (3300 N s/m)" in capsys.readouterr().out

    def with_lower(c_s: float) -> list[ParameterSummary]:
        return [replace(s, lower=c_s, median=5000.0) if s.name == "c_s" else s for s in run.summary.parameters]

    def said(problem: Problem, entries: list[ParameterSummary]) -> str:
        found = overdamped(problem, entries)
        assert found is not None
        return found.text

    assert overdamped(run.problem, with_lower(3270.0)) is None
    assert "lags by c_s/k_s, 200 us, and" in said(run.problem, with_lower(3272.0))
    light = replace(run.problem, terms=terms(["modal_mass"]))
    first, rest = with_lower(1636.0)[:3], run.summary.parameters[3:]
    mass = replace(first[0], name="modal_mass_ratio", median=0.25)
    assert "(1600 N s/m)" in said(light, [*first, mass, *rest])
    # What the experiment knows of times is what it may stand for, but of causes that the model has.
    known = (
        Belief("amplifier_lag_tau", Normal(6e-5, 1e-5), "a data sheet"),
        Belief("gap_width", Normal(0.0, 1e-6), "no time"),
    )
    informed = replace(run.problem, experiment=replace(run.problem.experiment, beliefs=known))
    assert said(informed, with_lower(3272.0)).endswith(
        "another lag, such as amplifier_lag_tau of 60 us, as the experiment states it"
    )
    lagging = replace(informed, terms=terms(["amplifier_lag"]))
    lag = replace(first[0], name="amplifier_lag_tau", median=6e-5)
    assert said(lagging, [*with_lower(3272.0)[:3], lag, *rest]).endswith("another lag")


def test_what_sessions_have_is_said_as_people_know_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A gain, and not a number of spreads; what scatter and sessions have by their priors takes one line."""
    run = make_run(tmp_path)
    problem = replace(run.problem, terms=terms(["reading_gain"]))
    values = dict(zip(problem.names, problem.to_physical(problem.medians), strict=True))
    values |= {"reading_gain_spread": 0.1} | {f"reading_gain_z_{g}": -2.0 for g in problem.group_ids}
    found = list(by_session(problem, np.array([list(values.values())])))
    assert [group.id for _, _, group, _ in found] == list(problem.group_ids)
    assert [float(gain[0]) for *_, gain in found] == pytest.approx([np.exp(-0.2)] * len(found))
    n = run.fit.n_physical
    last = [replace(p, verdict="not determined") for p in run.summary.parameters[n:]]
    gain = SessionSummary("reading_gain", 1, "gain", "1", 0.772, 0.746, 0.797)
    summary = replace(run.summary, parameters=[*run.summary.parameters[:n], *last], sessions=[gain])
    _say_fit(replace(run, summary=summary), make_numerics(run))
    said = capsys.readouterr().out
    assert "session by session, reading_gain: group 1 0.772 (0.746 to 0.797)\n" in said
    assert f"  not determined, of the scatter or of sessions: {', '.join(p.name for p in last)}\n" in said

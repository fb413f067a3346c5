"""What a run says of its posterior."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from fits_by_hand import CONSTANTS, make_numerics, make_run

from psafit.cli.fitting import _say_fit
from psafit.inference.problem import Problem
from psafit.inference.summary import overdamped
from psafit.physics import terms
from psafit.records import ParameterSummary


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

"""The search as a diagnosis makes it."""

from __future__ import annotations

from pathlib import Path

import pytest

from psafit.diagnose import searching
from psafit.experiment import read_experiment
from psafit.inference.problem import Problem
from psafit.physics import term

STUDY = Path(__file__).parents[2] / "experiments" / "psa"


def test_the_search_and_its_tests_hold_what_the_rig_states(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = Problem(read_experiment(STUDY), ("1",))
    catalogue = term("anchored_stroke"), term("gap")
    given = {}
    monkeypatch.setattr(searching, "search_models", lambda *args, **options: given.update(options, terms=args[1]))
    searching.searched(problem, catalogue, seed=1)
    stated = Problem(problem.experiment, ("1",), catalogue).terms
    assert given["terms"] == stated != catalogue
    assert given["passes"].keywords["catalogue"] == stated

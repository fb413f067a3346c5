"""What a fit takes is measured, and said where it is much; what cannot be fitted is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import run

from psafit.cli.common import costly, long_sweeps
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, write_experiment
from psafit.inference import cost as costs
from psafit.inference.cost import Cost, cost
from psafit.inference.problem import Problem, refuse_still
from psafit.inference.run import fit


def repeated(experiment: Experiment, times: int) -> Experiment:
    """The first group with its rows so many times."""
    g = experiment.groups[0]
    rows = np.tile(np.arange(g.n_points), times)
    return replace(experiment, groups=(replace(g.at(rows), sigma=None),))


def test_cost_grows_with_the_readings(known: Experiment) -> None:
    """It is measured on as many as there are, or on some of them: in proportion, whatever machine this is."""
    few, many = (Problem(e, e.ids) for e in (repeated(known, 25), repeated(known, 2500)))
    assert many.observed.size == 100 * few.observed.size
    small, large = cost(few), cost(many)
    assert large.memory / small.memory == pytest.approx(100, rel=0.5)
    assert 20 < large.seconds / small.seconds < 500
    assert small.memory > few.observed.size * 1024 * 8  # one array of the search


def test_what_takes_long_is_said(known: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    first = known.ids[:1]
    n = known.groups[0].n_points
    monkeypatch.setattr(costs, "machine_memory", lambda: 8e9)
    monkeypatch.setattr(costs, "cost", lambda problem: Cost(7200.0, 2e9))
    (said,) = costly(known, first, rest="; x")
    assert said.startswith(f"a fit to group {first[0]} ({n} readings) takes about 2 h and 2.0 GB of memory on this")
    assert said.endswith("; x") and said.isprintable()
    assert costly(known, first, minutes=121) == []
    monkeypatch.setattr(costs, "cost", lambda problem: Cost(7.0, 6e9))
    assert "6.0 GB of memory, of 8.0 GB," in costly(known, first)[0]
    monkeypatch.setattr(costs, "cost", lambda problem: Cost(599.0, 1e9))
    assert costly(known, first) == []


def test_commands_say_what_a_fit_takes(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before they begin: here each is ended by a folder that is another's."""
    write_experiment(known, tmp_path / "rig")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "fit.json").write_text("{}")
    monkeypatch.setattr(costs, "cost", lambda problem: Cost(7200.0, 2e9))
    assert run(monkeypatch, "check", tmp_path / "rig") == 0
    assert "takes about 2 h" in capsys.readouterr().err
    for command in (["fit", "--group", "1"], ["diagnose"]):
        run(monkeypatch, command[0], tmp_path / "rig", *command[1:], "--out", tmp_path / "out")
        said = capsys.readouterr().err
        assert "takes about 2 h" in said and ("a diagnosis takes that at least" in said) == (command == ["diagnose"])
        run(monkeypatch, command[0], tmp_path / "rig", *command[1:], "--out", tmp_path / "out", "--quiet")
        assert "takes about" not in capsys.readouterr().err


def test_a_diagnosis_says_which_sweep_is_long(known: Experiment) -> None:
    """The cost grows with the third power: 2,400 readings take 64 times what 600 take, 8 s, four times."""
    assert long_sweeps(known) == []
    first = known.groups[0]
    many = replace(known, groups=(first.at(np.resize(np.arange(first.n_points), 2400)),))
    (said,) = long_sweeps(many)
    assert "take about 34 min with 2,400 readings in one sweep; 1,500 of them take 10 min" in said
    assert long_sweeps(many, minutes=35) == []


def still(group: Group) -> Group:
    return replace(group, reading=np.zeros(group.n_points))


def test_zeros_alone_are_not_fitted(known: Experiment, tmp_path: Path) -> None:
    first, *others = known.groups
    one = replace(known, groups=(still(first), *others))
    with pytest.raises(InputError, match="every launch range is zero in group 1; choose other groups"):
        fit(one, [1], tmp_path / "run")
    assert not (tmp_path / "run").exists()
    refuse_still(one.groups)  # a group of zeros among others is data
    with pytest.raises(InputError, match="in groups 1, 2"):
        refuse_still(map(still, known.groups[:2]))

"""Records of an experiment check and describe themselves."""

from __future__ import annotations

import json
import math
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest
from folders import write

from psafit.drives import Drive, Table
from psafit.errors import InputError
from psafit.experiment import Conditions, Constants, Group, describe, read_experiment


def test_a_sweep_is_filled_between_its_conditions() -> None:
    """What was held stays as it was, replicates are one, and what is no sweep stays as it is."""
    f = np.array([4000.0, 100.0, 100.0, 1000.0])
    held = Conditions(1, "square", "a.csv", f, np.array([20.0, 20.1, 20.1, 20.0]), changed=(("l", 0.05),))
    found = held.filled()
    assert (found.id, found.waveform, found.changed) == (1, "square", (("l", 0.05),))
    assert (np.diff(found.frequency_hz) > 0).all() and set(f) < set(found.frequency_hz) and found.n_points == 17
    assert found.frequency_hz[4] == pytest.approx(math.sqrt(100 * 1000))  # even in the logarithm
    assert found.amplitude_v.max() == 20.1 and found.amplitude_v.min() == pytest.approx(20.0, rel=1e-15)
    still = Conditions(1, "sine", "a.csv", np.full(3, 700.0), np.array([0.0, 4.0, 8.0])).filled()
    assert still.amplitude_v.tolist() == [x / 2 for x in range(17)] and set(still.frequency_hz) == {700.0}
    many = Conditions(1, "sine", "a.csv", np.geomspace(100, 1e4, 400), np.full(400, 5.0))
    assert many.filled().n_points == 400
    for f, v in (([700.0, 800.0], [3.0, 5.0]), ([700.0, 700.0], [3.0, 3.0])):
        one = Conditions(1, "sine", "a.csv", np.array(f), np.array(v))
        assert one.filled() is one


def test_each_observable_of_a_sweep_is_filled_between_its_own_conditions() -> None:
    f, kinds = np.array([100.0, 1000.0, 100.0, 400.0, 700.0, 900.0]), np.array([0, 0, 1, 1, 1, 2], np.int8)
    parts = Conditions(1, "sine", "a.csv", f, np.full(6, 20.0), measured=kinds).filled().parts
    alone = [
        Conditions(1, "sine", "a.csv", f[kinds == k], np.full((kinds == k).sum(), 20.0)).filled() for k in range(3)
    ]
    assert [p.frequency_hz.tolist() for p in parts] == [a.frequency_hz.tolist() for a in alone]
    assert [p.observable.name for p in parts] == ["launch_range", "launch_speed", "contact_time"]
    assert [p.n_points for p in parts] == [9, 17, 1]


def test_records_cannot_be_changed(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(FrozenInstanceError):
        experiment.title = "x"  # type: ignore[misc]
    for array in (experiment.groups[0].frequency_hz, experiment.groups[0].reading):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_check_reports_a_sweep_that_is_none(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path, a="frequency_hz,amplitude_v,launch_range_um\n1200,1,0.4\n"))
    assert experiment.warnings == ()  # it is no reason to doubt the reading
    assert describe(experiment)["warnings"] == [
        "a.csv: group 1: one reading is no sweep; it shows a level and no trend"
    ]


def test_description_is_json(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    summary = json.loads(json.dumps(describe(experiment), allow_nan=False))
    assert summary["n_points"] == 6
    assert summary["fingerprint"] == experiment.fingerprint
    assert summary["constants"]["k_s"] == 4.89e7
    assert summary["groups"][1] == {
        "id": "late-2",
        "waveform": "square",
        "file": "b.csv",
        "n_points": 3,
        "constants": {},
        "frequency_hz": [1200.0, 1200.0],
        "amplitude_v": [1.0, 20.0],
        "launch_range_um": [0.37, 76.0],
        "zeros": 0,
        "replicates": 0,
        "has_sigma": False,
    }


def test_unknown_group_names_the_known(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(InputError, match="no group '7'; choose one of 1, late-2") as caught:
        experiment.group(7)
    assert caught.value.file == tmp_path / "experiment.toml"


def test_selecting_a_group_twice(tmp_path: Path) -> None:
    experiment = read_experiment(write(tmp_path))
    with pytest.raises(InputError, match="named twice"):
        experiment.select([1, "1"])


def test_group_checks_itself() -> None:
    one = np.ones(2)
    group = Group("x", "sine", "", one, one, one)
    one[0] = 5.0
    assert group.frequency_hz.tolist() == [1, 1]  # a copy: the caller's array stays the caller's
    for field, bad in (
        ("frequency_hz", [0.0, 1.0]),
        ("amplitude_v", [-1.0, 1.0]),
        ("reading", [np.nan, 1.0]),
        ("sigma", [-1.0, 1.0]),
        ("reading", [1.0]),
        ("measured", [0]),
    ):
        with pytest.raises(ValueError, match=field):
            replace(group, **{field: np.array(bad)})  # type: ignore[arg-type]


def test_constants_check_themselves() -> None:
    with pytest.raises(ValueError, match="constant g"):
        Constants(0.027, 0.005, 1.2e-7, 0.09, 4.89e7, -9.81)


def test_what_moves_is_driven_whatever_its_amplitude() -> None:
    """A step by a bias, and a recording, which is taken as it is; not a bias at which the stack rests."""
    f, v = np.full(2, 500.0), np.array([0.0, 5.0])

    def driven(drive: Drive) -> list[bool]:
        return Conditions("1", drive, "1.csv", f, v).driven.tolist()

    assert driven(Drive("sine")) == [False, True]
    assert driven(Drive("sine", bias_v=10.0, idle_v=10.0)) == [False, True]
    assert driven(Drive("square", bias_v=20.0)) == [True, True]
    for level, moves in ((3.0, True), (0.0, False)):
        table = Table(np.array([0.0, 1e-4, 2e-4]), np.array([0.0, level, 0.0]), True)
        assert driven(Drive("table", table=table, file="drive.csv")) == [moves, moves]

"""The picture of a simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas
import pytest
from commands import run
from diagnoses_by_hand import make_record

from psafit.diagnose.record import ParameterResult
from psafit.experiment import Experiment
from psafit.records import write_json
from psafit.report import simulated


def test_a_picture_shows_the_tied_sets(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    """What a measurement would look like under each of them; what is asked for by name stands alone."""
    record = make_record(diagnosis[1])
    both = {"hysteresis_strength": 0.2, "hysteresis_voltage": 15.0, "gap_width": 1e-6}
    sets = (["hysteresis"], ["gap", "hysteresis"], [])
    values = {n: ParameterResult(x, None, None, "1", "", 0.5) for n, x in both.items()}
    causes = [replace(record.causes[0], terms=ids, parameters=values) for ids in sets]
    tied = replace(record, verdict="ambiguous", named=sets[0], alternatives=[sets[1], ["preload"]], causes=causes)
    found, file = tmp_path / "found", tmp_path / "x.csv"
    found.mkdir()
    write_json(found / "diagnosis.json", tied, sealed=True)
    shown: list[dict[str, Any]] = []
    monkeypatch.setattr(simulated, "write_picture", lambda groups, curves, path: shown.append(curves))
    words = ("--run", found, "--plot", tmp_path / "x.png", "--out", file)
    assert run(monkeypatch, "simulate", known_folder, *words) == 0
    assert list(shown[0]) == ["these alone", "gap"]  # one of three sets was not fitted, the baseline is not tied
    (first, _), (second, _) = shown[0].values()
    assert first == pytest.approx(pandas.read_csv(file)["predicted_um"].to_numpy())
    assert (second != first).any()
    for more in (("--set", "k_c=2e6"), ("--terms", "hysteresis")):
        assert run(monkeypatch, "simulate", known_folder, *words, *more) == 0
        assert list(shown.pop()) == ["simulated"]
    write_json(found / "diagnosis.json", replace(tied, causes=[]), sealed=True)
    capsys.readouterr()
    assert run(monkeypatch, "simulate", known_folder, *words) == 2
    assert "diagnosis.json: holds no model; repeat the diagnosis" in capsys.readouterr().err

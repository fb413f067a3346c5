"""The picture of a simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from commands import run
from diagnoses_by_hand import make_record
from fits_by_hand import make_run, mixed_groups
from matplotlib.figure import Figure

from psafit.diagnose.record.models import ParameterResult
from psafit.experiment import Conditions, Experiment, write_experiment
from psafit.records import write_json
from psafit.report import simulated


def test_a_picture_has_a_panel_for_each_observable(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Each with the readings and the curve of its own, as the table has them; what a session has for itself, too."""
    write_experiment(make_run(tmp_path, mixed_groups(), (1,)).problem.experiment, tmp_path / "rig")
    drawn: list[Figure] = []
    monkeypatch.setattr(simulated, "save", lambda figure, path: drawn.append(figure))
    words = ("--terms", "reading_gain", "--set", "reading_gain_spread=0.1", "--set", "reading_gain_z_2=1.0")
    assert run(monkeypatch, "simulate", tmp_path / "rig", *words, "--plot", "x.png", "--out", tmp_path / "x.csv") == 0
    table = pandas.read_csv(tmp_path / "x.csv")
    panels = drawn[0].axes
    seen = [(panel.get_title(loc="left").split(":")[0], panel.get_ylabel()) for panel in panels]
    launches = ["Launch range (µm)", "Launch speed (mm/s)", "Contact time (µs)"]
    assert seen == [
        *(("Group 1", label) for label in launches), ("Group trace", "Velocity (mm/s)"),
        *(("Group 2", label) for label in launches),
    ]  # fmt: skip
    parts = [rows for _, rows in table.groupby(["group", "observable"], sort=False)]
    assert len(parts) == len(panels) == 7
    for rows, panel in zip(parts, panels, strict=True):
        line, circles = panel.lines
        x = rows["frequency_hz" if rows["time_us"].isna().all() else "time_us"].to_numpy()
        at = np.interp(x, line.get_xdata(), line.get_ydata())
        assert at == pytest.approx(rows["predicted"].to_numpy(), rel=1e-9)
        assert circles.get_ydata() == pytest.approx(rows["measured"].to_numpy())
    ranges = [rows["predicted"].to_numpy() for rows in parts if rows["observable"].iloc[0] == "launch_range_um"]
    assert (ranges[0] != ranges[1]).all()


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
    monkeypatch.setattr(simulated, "write_picture", lambda groups, curves, path, ends: shown.append(curves))
    words = ("--run", found, "--plot", tmp_path / "x.png", "--out", file)
    assert run(monkeypatch, "simulate", known_folder, *words) == 0
    # One of three sets was not fitted, the baseline is not tied.
    assert list(shown[0]) == ["hysteresis", "hysteresis + gap"]
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


def test_a_picture_shows_the_intervals_of_a_fit(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    drawn: list[Figure] = []
    monkeypatch.setattr(simulated, "save", lambda figure, path: drawn.append(figure))
    middle = np.concatenate([g.reading for g in known.groups])
    between = np.concatenate([g.filled().frequency_hz for g in known.groups])
    models = {"simulated": (middle, between)}
    simulated.write_picture(known.groups, models, tmp_path / "x.png", np.array([0.8 * middle, 1.3 * middle]))
    simulated.write_picture(known.groups, models, tmp_path / "x.png")
    bands = [[len(axes.collections) for axes in figure.axes] for figure in drawn]
    assert bands == [[1] * len(known.groups), [0] * len(known.groups)]
    assert [text.get_text() for text in drawn[0].legends[0].get_texts()][-1] == "90 % of readings"


def test_sets_that_lie_on_one_another_are_drawn_against_the_first(known: Experiment, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """As a factor; a planned group has no readings, and a group in which they differ stays as it is."""
    drawn: list[Figure] = []
    monkeypatch.setattr(simulated, "save", lambda figure, path: drawn.append(figure))
    first, second, third = known.groups
    groups = (first, second, Conditions(9, "sine", "9.csv", third.frequency_hz, third.amplitude_v))

    def level(factors: tuple[float, float, float]) -> list[np.ndarray[Any, Any]]:
        each = ([c.n_points for c in some] for some in (groups, [g.filled() for g in groups]))
        return [np.repeat([10.0 * f for f in factors], sizes) for sizes in each]

    models = {"one": level((1.0, 1.0, 1.0)), "other": level((1.01, 3.0, 0.99))}
    simulated.write_picture(groups, models, Path("x.png"))
    one, two, three = drawn[0].axes
    assert [a.get_ylabel() for a in (one, two, three)] == [
        "Launch range / first model", "Launch range (µm)", "Launch range / first model",
    ]  # fmt: skip
    for axes, factor in ((one, 1.01), (three, 0.99)):
        assert axes.lines[1].get_ydata() == pytest.approx(factor) or axes.lines[2].get_ydata() == pytest.approx(factor)

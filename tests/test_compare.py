"""Two results side by side."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import run
from reader import Reader
from sides import made

import psafit
from psafit.api import Diagnosed
from psafit.compare import compare, read_predictions, read_side
from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, write_experiment
from psafit.observables import LAUNCH_SPEED, OBSERVABLES, VELOCITY
from psafit.report.comparison import write_comparison
from psafit.validate import columns_of, prediction_rows, table_name, write_table


def test_the_better_one_is_named_and_overlap_is_measured() -> None:
    found = compare(made("a", 2.0), made("b", 1.1))
    assert found.judged == ["two"] and found.log_rmse is not None
    # 0.3 um added to the readings takes a little of the factor away.
    assert found.log_rmse == pytest.approx([np.log(2), np.log(1.1)], rel=0.05)
    low, high = found.log_rmse_interval or (0, 0)
    assert low <= found.log_rmse[1] - found.log_rmse[0] <= high < 0
    assert found.groups[1].elpd_change == pytest.approx(30 * 0.9)
    assert [f.what for f in found.facts if f.first != f.second] == ["seed"]
    assert found.parameters[0].overlap == 0
    assert compare(made("a", 1.0), made("b", 1.0)).parameters[0].overlap == pytest.approx(1)
    shifted = compare(made("a", 1.0), made("b", float(np.exp(0.1))))
    assert shifted.parameters[0].overlap == pytest.approx(0.5)


def test_a_difference_that_nobody_cares_for_has_no_winner() -> None:
    from psafit.report.comparison import clear_winner, signed_text

    assert clear_winner([0.3, 0.2], (-0.12, -0.08)) == 1 and clear_winner([0.2, 0.3], (0.08, 0.12)) == 0
    assert clear_winner([0.3, 0.2], (-0.3, 0.01)) is None and clear_winner([0.0502, 0.0499], (-0.001, -0.0001)) is None
    assert signed_text(-0.0001) == "0.000"


@pytest.mark.slow
def test_more_data_may_be_why_one_is_better(tmp_path: Path) -> None:
    one, other = made("a", 2.0), made("b", 1.1)
    third = replace(one.predicted[0], group=replace(one.predicted[0].group, id=3))
    for side in (one, other):
        side.predicted.append(third)

    def said(first: list[int], second: list[int]) -> str:
        sides = replace(one, groups=first), replace(other, groups=second)
        return Reader(write_comparison(*sides, compare(*sides), tmp_path / "c.html").read_text("utf-8")).first_screen

    assert "b is better; the runs were fitted to different groups, so more data alone may be why." in said([1], [1, 3])
    assert "different groups, so other data alone may be why." in said([1, 3], [1])
    assert "b is better." in said([1], [1])


def test_without_a_group_to_judge_by_nobody_wins(tmp_path: Path) -> None:
    one, other = made("a", 2.0, role="fit"), made("b", 1.1)
    found = compare(one, other)
    assert found.judged == [] and found.log_rmse is None
    page = Reader(write_comparison(one, other, found, tmp_path / "c.html").read_text("utf-8"))
    assert "no group to judge by" in page.text and "Nobody can say" in page.text


def test_what_is_not_determined_has_no_interval_next_to_another(tmp_path: Path) -> None:
    one, other = made("a", 2.0, spread=0.1), made("b", 1.1)
    open_ended = replace(one.parameters["k_c"], verdict="bounded above", limit="at most 7.7e6 N/m (95 %)")
    one.parameters["k_c"] = open_ended
    page = Reader(write_comparison(one, other, compare(one, other), tmp_path / "c.html").read_text("utf-8"))
    row = next(r for r in page.text.split("contact stiffness") if "bounded above" in r)
    assert "at most" in row and "2.2" not in row.split("/m")[0]
    one = made("a", 1.1)
    for verdict, badge in (("determined", "badge good"), ("not determined", "badge")):
        one.parameters["k_c"] = replace(one.parameters["k_c"], verdict=verdict)
        html = write_comparison(one, other, compare(one, other), tmp_path / "c.html").read_text("utf-8")
        assert f'<span class="{badge}">100\N{NO-BREAK SPACE}%</span></td>' in html  # a prior confirms nothing


def test_other_readings_are_not_compared() -> None:
    one, other = made("a", 2.0), made("b", 1.1)
    changed = replace(other.predicted[1].group, reading=other.predicted[1].group.reading + 1)
    other.predicted[1] = replace(other.predicted[1], group=changed)
    found = compare(one, other)
    assert [g.group for g in found.groups] == [1] and found.apart == ["two"]
    other.predicted.pop(0)
    with pytest.raises(InputError, match="no group with the same readings"):
        compare(one, other)


def test_the_page_of_two_fits(fitted: tuple[Path, Path], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    before = {p: p.read_bytes() for folder in fitted for p in folder.rglob("*") if p.is_file()}
    out = tmp_path / "c.html"
    assert run(monkeypatch, "report", *fitted, "--out", out, "--json", tmp_path / "c.json") == 0
    assert capsys.readouterr().out == f"report: {out}\n"
    page = Reader(out.read_text("utf-8"))
    assert page.headings == ["What differs", "Parameters", "Scores", "Predictions"]
    assert "Compared: one (fit of group 1, the baseline alone) and other" in page.first_screen
    assert "Given: seed" in page.first_screen and "contact stiffness" in page.text
    images = page.all("img")
    assert len(images) == 1 + 1 + 3 and all(len(i["alt"] or "") > 30 for i in images)
    assert not re.search(r"\b(nan|inf|None)\b|\bum\b", page.text)
    content = json.loads((tmp_path / "c.json").read_text())
    assert content["names"] == ["one", "other"] and len(content["groups"]) == 3
    for g in content["groups"]:
        assert f"{g['log_rmse'][0]:.3f}" in page.text
    assert {p: p.read_bytes() for p in before} == before  # the runs are only read


@pytest.mark.slow
def test_a_diagnosis_stands_next_to_a_fit_or_alone(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys
) -> None:
    folder, experiment = diagnosis
    side = read_side(folder)
    assert side.kind == "diagnosis" and side.terms == ["hysteresis"] and side.parameters["k_c"].unit == "N/m"
    assert [str(t.group.id) for t in side.predicted] == [str(i) for i in experiment.ids]
    assert run(monkeypatch, "report", folder, folder, "--out", tmp_path / "c.html") == 0
    write_experiment(experiment, tmp_path / "rig")
    assert run(monkeypatch, "report", folder, "--experiment", tmp_path / "rig", "--quiet") == 0
    assert "Diagnosis: Made-up rig" in (folder / "diagnosis.html").read_text("utf-8")
    capsys.readouterr()
    kept = shutil.copytree(folder, tmp_path / "kept")
    write_experiment(experiment, kept / "experiment")
    opened = psafit.load_diagnosis(kept)
    assert isinstance(opened, Diagnosed) and opened.experiment.fingerprint == experiment.fingerprint
    assert opened.verdict == psafit.load_diagnosis(str(folder), tmp_path / "rig").verdict == "ambiguous"
    assert run(monkeypatch, "report", kept) == 0 and capsys.readouterr().out == f"report: {kept / 'diagnosis.html'}\n"
    write_experiment(replace(experiment, groups=experiment.groups[:2]), tmp_path / "less")
    for words, said in (
        (["report", folder], "keeps no measurements; name them with --experiment EXP"),
        (["report", folder, "--experiment", tmp_path / "less"], "is not the experiment that was diagnosed"),
        (["report", folder, folder, "--experiment", tmp_path / "rig"], "is of no use for two runs"),
        (["report", folder, "--out", tmp_path / "x.html"], "are for two runs"),
        (["report", folder, tmp_path], "holds neither a finished fit nor a finished diagnosis"),
    ):
        assert run(monkeypatch, *words) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_an_edited_diagnosis_is_one_line(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys
) -> None:
    folder, experiment = shutil.copytree(diagnosis[0], tmp_path / "found"), diagnosis[1]
    write_experiment(experiment, tmp_path / "rig")
    record = json.loads((folder / "diagnosis.json").read_text("utf-8"))
    (folder / "diagnosis.html").unlink(missing_ok=True)
    record["show"]["baseline"]["drift"] = [{"nothing": 1}]
    (folder / "diagnosis.json").write_text(json.dumps(record), "utf-8")
    for words in (["report", folder, "--experiment", tmp_path / "rig"], ["report", folder, diagnosis[0]]):
        assert run(monkeypatch, *words) == 2
        error = capsys.readouterr().err
        assert "diagnosis.json: was changed after psafit wrote it; run psafit diagnose again" in error
        assert error.count("\n") == 1 and not (folder / "diagnosis.html").exists()


def test_other_observables_are_read_back_and_compared(tmp_path: Path) -> None:
    """Of launches and along a trace, below zero, too; other speeds are other readings."""
    f, v, read = np.full(3, 900.0), np.full(3, 20.0), np.array([0.3, 0.4, 0.2])
    kinds = [np.full(3, OBSERVABLES.index(o), np.int8) for o in (LAUNCH_SPEED, VELOCITY)]
    speeds = Group("1", Drive("sine"), "1.csv", f, v, reading=read, measured=kinds[0])
    trace = Group("2", Drive("sine"), "2.csv", f, v, reading=-read, measured=kinds[1], time_us=np.arange(3.0))
    for g in (speeds, trace):
        rows = prediction_rows(g, g.reading * 2, g.reading - 1 * (g is trace), g.reading * 3, "fit")
        write_table(tmp_path / table_name("predictions", g.observable), columns_of(g.observable), rows)
    found = read_predictions(tmp_path / "predictions.csv")
    assert [p.group.label for p in found] == ["1 (launch speed)", "2 (velocity)"]
    for p, g in zip(found, (speeds, trace), strict=True):
        np.testing.assert_array_equal(p.group.reading, g.reading)
        np.testing.assert_array_equal(p.median, 2 * g.reading)
    assert found[1].group.time_us is not None
    one = replace(made("a", 2.0), predicted=found)
    changed = [replace(p, group=replace(p.group, reading=p.group.reading + 1 * (p is found[0]))) for p in found]
    assert compare(one, replace(one, name="b", predicted=changed)).apart == ["1"]


def test_readings_under_another_drive_are_not_compared(tmp_path: Path) -> None:
    """Bias, idle voltage, phase, periods and table count; a file of predictions names the waveform alone."""
    one, other = made("a", 2.0), made("b", 1.1)
    for drive in (
        Drive("sine", bias_v=2.0),
        Drive("sine", idle_v=2.0),
        Drive("sine", phase_deg=9.0),
        Drive("sine", cycles=2.0),
    ):
        driven = [replace(t, group=replace(t.group, drive=drive)) if t.group.id == 1 else t for t in other.predicted]
        assert compare(one, replace(other, predicted=driven)).apart == [1]
        assert compare(replace(one, predicted=driven), replace(other, predicted=driven)).apart == []
        named = [replace(t, group=replace(t.group, drive=Drive("sine")), waveform_alone=True) for t in driven]
        assert compare(replace(one, predicted=named), replace(other, predicted=driven)).apart == []


def test_a_diagnosis_knows_the_drives_of_the_experiment_that_it_keeps(
    diagnosis: tuple[Path, Experiment], tmp_path: Path
) -> None:
    folder, experiment = shutil.copytree(diagnosis[0], tmp_path / "found"), diagnosis[1]
    assert all(t.waveform_alone for t in read_side(folder).predicted)
    biased = replace(experiment.groups[0], drive=Drive("sine", bias_v=2.0))
    write_experiment(replace(experiment, groups=(biased, *experiment.groups[1:])), folder / "experiment")
    kept = read_side(folder).predicted
    assert kept[0].group.drive == biased.drive and not any(t.waveform_alone for t in kept)


def test_damaged_predictions_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "p.csv"
    for text, said in ((None, "is missing"), ("a,b\n1,2\n", "does not hold predictions"), ("", "does not hold")):
        if text is not None:
            file.write_text(text)
        with pytest.raises(InputError, match=said):
            read_predictions(file)

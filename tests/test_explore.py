"""The front door: notebooks, two results side by side, a picture of a simulation, a fit that is watched."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas
import pytest
from reader import HOSTILE, Reader
from test_architecture import HEAVY
from test_report_diagnosis import make_experiment, make_record

import psafit
from psafit import cli, watch
from psafit.api import Diagnosed, Fitted, Rig
from psafit.cli import rig as of_rigs
from psafit.cli import simulating, watching
from psafit.compare import Estimate, Side, Told, compare, read_predictions, read_side
from psafit.errors import InputError
from psafit.experiment import (
    Conditions,
    Experiment,
    Group,
    Plan,
    read_experiment,
    read_plan,
    session_name,
    write_experiment,
    writer,
)
from psafit.files import sole, usual_fit_folder
from psafit.inference import emcee_adaptor
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.problem import Problem
from psafit.inference.run import fit, load
from psafit.inference.store import told_r_hat
from psafit.physics import terms
from psafit.records import write_json
from psafit.report import figures, simulated
from psafit.report.comparison import write_comparison
from psafit.report.figures import curves
from psafit.validate import COLUMNS, prediction_rows, write_table

ROOT = Path(__file__).resolve().parents[1]
SHORT = Settings(chunk=60, max_steps=60)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["psafit", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


@pytest.fixture(scope="module")
def fitted(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two fits of group 1, too short to converge: nothing here hangs on that."""
    folder = tmp_path_factory.mktemp("fits")
    for name, seed in (("one", 1), ("other", 2)):
        fit(known, [1], folder / name, seed=seed, n_starts=2, settings=SHORT)
    return folder / "one", folder / "other"


@pytest.fixture(scope="module")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Experiment]:
    """A made-up diagnosis with its predictions, beside the experiment it belongs to."""
    folder = tmp_path_factory.mktemp("diagnosis")
    experiment = make_experiment()
    record = make_record(experiment)
    write_json(folder / "diagnosis.json", record, sealed=True)
    rows = (
        row
        for g in experiment.groups
        for row in prediction_rows(g, 1.1 * g.launch_range_um, 0.8 * g.launch_range_um, 1.3 * g.launch_range_um, "fit")
    )
    write_table(folder / record.predictions, COLUMNS, rows)
    return folder, experiment


# The notebook ----------------------------------------------------------------------------------------------------


def test_import_is_light() -> None:
    heavy = (*HEAVY, "numpy", "jinja2", "rich", "click", "pydantic")
    code = f"import sys, psafit; psafit.open, psafit.load; print(*[m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_a_rig_in_a_notebook(known: Experiment, known_folder: Path) -> None:
    rig = psafit.open(known_folder)
    assert isinstance(rig, Rig) and rig.experiment.fingerprint == known.fingerprint
    assert list(rig.data.columns) == ["group", "waveform", "frequency_hz", "amplitude_v", "launch_range_um"]
    assert len(rig.data) == 62
    assert "A rig with known truth" in repr(rig) and "1500" in repr(rig)
    axes = rig.plot("3")
    assert axes.get_xlabel() == "Drive amplitude (V)" and axes.get_ylabel() == "Launch range (µm)"
    with pytest.raises(InputError, match="there is no group"):
        rig.plot(9)


def test_a_fit_in_a_notebook(known: Experiment, fitted: tuple[Path, Path]) -> None:
    from matplotlib.figure import Figure

    one = psafit.load(fitted[0])
    assert list(one.parameters.index[:3]) == ["k_c", "c_s", "c_c"]
    assert (one.parameters["lower_90"] < one.parameters["median"]).all()
    assert list(one.scores["role"]) == ["fit", "holdout", "holdout"] and len(one.predictions) == 62
    assert "fitted to group 1 of A rig with known truth" in " ".join(repr(one).split()) and "not converged" in repr(one)
    told = next(line for line in repr(one).splitlines() if line.startswith("c_c "))
    assert told.count("c_c") == 1 and re.search(r"\d\.\d{4}$", told)  # named once; R-hat to four decimals
    html = one._repr_html_()
    assert html.count("<table") == 2 and "k_c" in html and "N s/m" in html
    ax = Figure().subplots()
    assert one.plot(ax=ax) is ax and one.plot(2, ax=ax) is ax
    with pytest.raises(InputError, match="there is no group"):
        one.plot(9, ax)
    assert one.report() == fitted[0] / "report.html"


def test_the_notebook_uses_the_command_line_s_folders(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    from psafit import api

    asked: list[Path] = []

    def told(experiment, ids, folder, **options):  # type: ignore[no-untyped-def]
        asked.append(folder)
        raise InputError("enough", "stop")

    monkeypatch.setattr(api, "fit", told)
    monkeypatch.setattr(api, "diagnose", told)
    rig = Rig(known)
    for ask in (lambda: rig.fit(1, quiet=True), lambda: rig.fit([1, 2], terms=["preload", "gap"], quiet=True),
                lambda: rig.diagnose(quick=True, quiet=True)):  # fmt: skip
        with pytest.raises(InputError, match="enough"):
            ask()
    assert [p.name for p in asked] == ["known-group1", "known-group1-2-gap-preload", "known-diagnosis"]


def test_no_two_choices_of_groups_share_a_folder() -> None:
    choices = ([1, 2], ["1-2"], ["1-", 2], ["1--2"], ["a-b", "c"], ["a", "b-c"], ["a", "b", "c"], ["a-b-c"])
    names = [usual_fit_folder(Path("rig"), ids, []).name for ids in choices]
    assert len(set(names)) == len(choices) and names[0] == "rig-group1-2" and names[1] == "rig-group1--2"


def test_the_notebook_refuses_what_the_command_line_refuses(known_folder: Path, tmp_path: Path) -> None:
    rig = psafit.open(known_folder)
    for ask, said in (
        (lambda: rig.fit(1, out=tmp_path / "x", starts=0, quiet=True), "0 starts"),
        (lambda: rig.fit(1, out=tmp_path / "x", seed=-1, quiet=True), "seed -1"),
        (lambda: rig.fit([1, 1], out=tmp_path / "x", quiet=True), "named twice"),
        (lambda: rig.fit(1, out=known_folder, quiet=True), "lies in the input"),
        (lambda: rig.diagnose(1, out=known_folder / "in", quiet=True), "lies in the input"),
    ):
        with pytest.raises(InputError, match=said):
            ask()
    assert not (tmp_path / "x").exists() and not (known_folder / "in").exists()


def test_a_diagnosis_in_a_notebook(diagnosis: tuple[Path, Experiment]) -> None:
    from matplotlib.figure import Figure

    folder, experiment = diagnosis
    found = Diagnosed(make_record(experiment), experiment, folder)
    assert found.verdict == "ambiguous" and found.named == ["hysteresis"]
    assert found.causes.loc["hysteresis", "probability"] == 0.61
    assert (found.causes.index[-1], found.causes["probability"].iloc[-1]) == ("a discrepancy without a name", 0.03)
    few = Diagnosed(replace(found.record, unnamed=1e-4), experiment, folder)
    assert few.causes.index[-1] == "baseline"
    assert "ambiguous (hysteresis)" in repr(found) and "baseline" in found._repr_html_()
    ax = Figure().subplots()
    assert found.plot(ax=ax) is ax and found.plot(2, ax=ax) is ax
    assert found.report() == folder / "diagnosis.html"
    with pytest.raises(InputError, match=r"holds a diagnosis, not a fit; read it with psafit\.load_diagnosis"):
        psafit.load(folder)


def test_what_others_wrote_is_escaped(known: Experiment) -> None:
    groups = (replace(known.groups[0], id=HOSTILE),)
    html = Rig(replace(known, title=HOSTILE, groups=groups))._repr_html_()
    assert "<script" not in html and html.count("&lt;script&gt;") == 2


# Two results side by side ----------------------------------------------------------------------------------------


def made(name: str, factor: float, *, role: str = "holdout", spread: float = 0.1) -> Side:
    """A result whose predictions are all off by a factor."""
    f = np.geomspace(100, 1e4, 30)
    y = 20 * (f / 100) ** -0.3
    told = [
        Told(Group(id, "sine", "x.csv", f, np.full(30, 20.0), y), r, factor * y, factor * y / 2, factor * y * 2,
             np.full(30, -factor))
        for id, r in ((1, "fit"), ("two", role))
    ]  # fmt: skip
    low, high = np.exp(-spread) * factor, np.exp(spread) * factor
    parameters = {"k_c": Estimate(1e6 * factor, 1e6 * low, 1e6 * high, "N/m", "contact stiffness", "determined")}
    return Side(name, "fit", "Made up", [1], [], {"data": "same", "seed": name}, parameters, told)


def test_the_better_one_is_named_and_overlap_is_measured() -> None:
    found = compare(made("a", 2.0), made("b", 1.1))
    assert found.judged == ["two"] and found.log_rmse is not None
    # 0.3 um beside the readings takes a little of the factor away.
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
    from psafit.report.comparison import _signed, _winner

    assert _winner([0.3, 0.2], (-0.12, -0.08)) == 1 and _winner([0.2, 0.3], (0.08, 0.12)) == 0
    assert _winner([0.3, 0.2], (-0.3, 0.01)) is None and _winner([0.0502, 0.0499], (-0.001, -0.0001)) is None
    assert _signed(-0.0001) == "+0.000"


def test_more_data_may_be_why_one_is_better(tmp_path: Path) -> None:
    one, other = made("a", 2.0), made("b", 1.1)
    third = replace(one.told[0], group=replace(one.told[0].group, id=3))
    for side in (one, other):
        side.told.append(third)

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
    assert "no group to judge by" in page.text and "Nobody can tell" in page.text


def test_what_is_not_determined_has_no_interval_beside_another(tmp_path: Path) -> None:
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
    changed = replace(other.told[1].group, launch_range_um=other.told[1].group.launch_range_um + 1)
    other.told[1] = replace(other.told[1], group=changed)
    found = compare(one, other)
    assert [g.group for g in found.groups] == [1] and found.apart == ["two"]
    other.told.pop(0)
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


def test_hostile_names_are_escaped(tmp_path: Path) -> None:
    one, other = made(HOSTILE, 2.0), made(HOSTILE + "2", 1.1)
    for side in (one, other):
        side.told[1] = replace(side.told[1], group=replace(side.told[1].group, id=HOSTILE))
    page = Reader(write_comparison(one, other, compare(one, other), tmp_path / "c.html").read_text("utf-8"))
    assert page.foreign.lower().count("<script") == 1 and page.html.count("</style>") == 1
    assert page.all("script") == [{"type": "application/json"}, {}] and HOSTILE in page.text
    assert len(page.html) < 5e6


def test_a_diagnosis_stands_beside_a_fit_or_alone(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys
) -> None:
    folder, experiment = diagnosis
    side = read_side(folder)
    assert side.kind == "diagnosis" and side.terms == ["hysteresis"] and side.parameters["k_c"].unit == "N/m"
    assert [str(t.group.id) for t in side.told] == [str(i) for i in experiment.ids]
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


def test_damaged_predictions_are_one_line(tmp_path: Path) -> None:
    file = tmp_path / "p.csv"
    for text, said in ((None, "is missing"), ("a,b\n1,2\n", "does not hold predictions"), ("", "does not hold")):
        if text is not None:
            file.write_text(text)
        with pytest.raises(InputError, match=said):
            read_predictions(file)


# A picture of a simulation ---------------------------------------------------------------------------------------


def test_names_of_a_sessions_own_hold_its_id(known: Experiment) -> None:
    """What a fit prints is what `simulate --set` takes and a sealed answer holds, whichever groups were fitted."""
    groups = [replace(known.groups[0], id=id) for id in (7, "late show", "x_2")]
    late = session_name("reading_gain_z", "late show")
    experiment = replace(known, groups=tuple(groups))
    both = Problem(experiment, ("x_2", 7), terms(["reading_gain"]))
    assert both.names[-5:-3] == ("reading_gain_z_x_2", "reading_gain_z_7")
    values = both.to_physical(both.prior_transform(np.linspace(0.3, 0.7, both.n_dim))).tolist()
    given = dict(zip(both.names, values, strict=True))
    theta = simulating._completed(Plan(known.constants, experiment.groups, ()), both.terms, given, {})
    gains = {name: z for name, z in theta.items() if "_z_" in name}
    assert list(gains) == ["reading_gain_z_7", late, "reading_gain_z_x_2"]
    assert list(gains.values()) == [given["reading_gain_z_7"], 0.0, given["reading_gain_z_x_2"]]
    assert len({session_name("z", id) for id in (1, "a-b", "a_b", "a b", "ä-b")}) == 5 and late.isidentifier()


def test_simulate_takes_the_model_of_a_diagnosis(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], known_folder: Path, tmp_path: Path, monkeypatch
) -> None:
    record = make_record(diagnosis[1])
    values = {"k_c": 2e6, "hysteresis_strength": 0.2, "hysteresis_voltage": 15.0, "sigma_rel": 0.05}
    best = replace(record.causes[0], terms=["hysteresis"], parameters={n: {"median": x} for n, x in values.items()})
    write_json(tmp_path / "diagnosis.json", replace(record, causes=[best, *record.causes[1:]]), sealed=True)
    words = ("--set", "c_c=40", "--quiet", "--json", tmp_path / "it.json")
    assert run(monkeypatch, "simulate", known_folder, "--run", tmp_path, *words) == 0
    told = json.loads((tmp_path / "it.json").read_text("utf-8"))
    assert told["terms"] == ["hysteresis"]
    wanted = {"k_c": 2e6, "c_c": 40.0, "hysteresis_strength": 0.2, "hysteresis_voltage": 15.0}
    assert wanted.items() <= told["parameters"].items() and "sigma_rel" not in told["parameters"]


def test_a_ball_that_stays_behind_its_place_of_rest_reads_zero(
    known: Experiment, tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    """It leaned on the tip, leaves it, and comes nowhere: as a fit has it, and as an experiment can hold it."""
    write_experiment(known, tmp_path / "rig")
    lean = ("--terms", "preload", "--set", "k_c=7649.9", "--set", "c_s=418.3", "--set", "c_c=5.782")
    words = ("simulate", tmp_path / "rig", *lean, "--set", "preload_offset=2.7e-4")
    for seed in ((), ("--seed", 1)):
        out = tmp_path / f"readings{len(seed)}"
        assert run(monkeypatch, *words, "--readings", out, "--out", tmp_path / "s.csv", *seed) == 0, capsys.readouterr()
        told = pandas.read_csv(tmp_path / "s.csv")["predicted_um"].to_numpy()
        assert told.min() == 0.0 and (told > 0).any()
        assert min(g.launch_range_um.min() for g in read_experiment(out).groups) >= 0.0


def test_a_band_keeps_its_distance_from_a_curve_between_readings() -> None:
    """In proportion where the curve is above zero at both readings, straight where it is not."""
    x = np.array([1.0, 3.0, 5.0])
    line = np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.array([10.0, 2.0, 20.0, 7.0, 0.0])
    band = figures.Band("90 % of readings", np.array([9.0, 20.0, 0.0]), np.array([20.0, 30.0, 4.0]))
    curve = figures.Curve("model", "blue", np.array([10.0, 20.0, 0.0]), (band,), line=line)
    at, low, high = curves.band_of(curve, band, x)
    assert at.tolist() == [1, 2, 3, 4, 5]
    assert low == pytest.approx([9.0, 2.0 * 0.95, 20.0, 10.0, 0.0])
    assert high == pytest.approx([20.0, 2.0 * 1.75, 30.0, 17.0, 4.0])
    for one, straight in zip(curves.band_of(replace(curve, line=None), band, x), (x, band.low, band.high), strict=True):
        assert one == pytest.approx(straight)


def test_a_picture_shows_the_tied_sets(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    """What a measurement would look like under each of them; what is asked for by name stands alone."""
    record = make_record(diagnosis[1])
    both = {"hysteresis_strength": 0.2, "hysteresis_voltage": 15.0, "gap_width": 1e-6}
    sets = (["hysteresis"], ["gap", "hysteresis"], [])
    causes = [
        replace(record.causes[0], terms=ids, parameters={n: {"median": x} for n, x in both.items()}) for ids in sets
    ]
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


def test_a_session_to_come_has_no_gain_of_the_runs(known: Experiment, capsys) -> None:  # type: ignore[no-untyped-def]
    """Ids of other folders' groups are numbers like one's own: only a session's very readings are that session."""
    (gain,) = terms(["reading_gain"])
    own = known.groups[0]
    name = session_name("reading_gain_z", own.id)
    medians = {"k_c": 2e6, "reading_gain_spread": 0.1, name: 1.2}
    read_again = replace(own, launch_range_um=own.launch_range_um + 1.0)
    planned = Conditions(own.id, own.waveform, own.file, own.frequency_hz, own.amplitude_v)
    for group, kept in ((own, True), (read_again, False), (planned, False)):
        plan = Plan(known.constants, (group,), ())
        found = simulating._of_sessions(plan, (gain,), medians, [own], False)
        assert found == (medians if kept else {k: v for k, v in medians.items() if k != name})
        assert capsys.readouterr().err == ("" if kept else f"sessions to come, not those of the run: {name} = 0\n")


def test_simulate_draws_what_it_simulates(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    values = ["--set", "k_c=4e5", "--set", "c_s=9e3", "--set", "c_c=60"]
    for ending, magic in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        file = tmp_path / f"picture{ending}"
        assert run(monkeypatch, "simulate", known_folder, *values, "--plot", file) == 0
        assert capsys.readouterr().out == f"picture: {file}\n"
        first = file.read_bytes()
        assert first.startswith(magic)
        assert run(monkeypatch, "simulate", known_folder, *values, "--plot", file, "--out", tmp_path / "s.csv") == 0
        assert file.read_bytes() == first and (tmp_path / "s.csv").exists()
        capsys.readouterr()
    for name, said in (("x.jpg", "end its name in .png or .svg or .pdf"), ("x", "no kind of picture")):
        assert run(monkeypatch, "simulate", known_folder, *values, "--plot", tmp_path / name) == 2
        assert said in capsys.readouterr().err and not (tmp_path / name).exists()


def test_a_plan_needs_no_readings(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """A planned group is simulated like a measured one at the same conditions; only `simulate` takes it."""
    folder = tmp_path / "plan"
    shutil.copytree(known_folder, folder)
    measured, planned = read_experiment(folder).groups[:2]
    rows = zip(planned.frequency_hz.tolist(), planned.amplitude_v.tolist(), strict=True)
    conditions = "".join(f"{f!r},{v!r}\n" for f, v in rows)
    (folder / planned.file).write_text("frequency_hz,amplitude_v\n" + conditions, "utf-8")
    told = {}
    for place in (known_folder, folder):
        out, picture = tmp_path / "simulated.csv", tmp_path / "picture.svg"
        assert run(monkeypatch, "simulate", place, "--out", out, "--plot", picture) == 0
        told[place] = pandas.read_csv(out)
    with_readings, without = told.values()
    assert with_readings["predicted_um"].equals(without["predicted_um"])
    assert without["launch_range_um"].isna().equals(without["group"] == planned.id)
    assert (without["launch_range_um"][without["group"] == measured.id] == measured.launch_range_um).all()
    capsys.readouterr()
    assert run(monkeypatch, "check", folder) == 2 and "missing column 'launch_range_um'" in capsys.readouterr().err
    (folder / planned.file).write_text("frequency_hz\n100\n", "utf-8")
    assert run(monkeypatch, "simulate", folder) == 2 and "missing column 'amplitude_v'" in capsys.readouterr().err


def test_simulated_readings_are_an_experiment(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """What is written is what was simulated; a seed scatters it as the model says, and always alike."""
    noise = ("--set", "sigma_rel=0.04", "--set", "sigma_abs=1e-3", "--set", "nu=100")
    exact, drawn, again = (tmp_path / name for name in ("exact", "drawn", "again"))
    assert run(monkeypatch, "simulate", known_folder, "--readings", exact, "--out", tmp_path / "s.csv") == 0
    for place in (drawn, again):
        assert run(monkeypatch, "simulate", known_folder, "--readings", place, "--seed", 3, *noise) == 0
    capsys.readouterr()
    measured, simulated = read_experiment(known_folder), read_experiment(exact)
    assert np.concatenate([g.launch_range_um for g in simulated.groups]) == pytest.approx(
        pandas.read_csv(tmp_path / "s.csv")["predicted_um"].to_numpy()
    )
    assert "simulated" in simulated.title and simulated.constants == measured.constants
    for a, b in zip(measured.groups, simulated.groups, strict=True):
        assert (a.id, a.waveform) == (b.id, b.waveform) and (a.frequency_hz == b.frequency_hz).all()
    assert read_experiment(drawn).fingerprint == read_experiment(again).fingerprint != simulated.fingerprint
    both = zip(read_experiment(drawn).groups, simulated.groups, strict=True)
    ratio = np.concatenate([d.launch_range_um / e.launch_range_um for d, e in both])
    assert 0.03 < (ratio - 1).std() < 0.06 and abs(ratio.mean() - 1) < 0.02
    assert "k_c = " in read_experiment(drawn).source and "seed 3" in read_experiment(drawn).source
    for words, said in (
        (["--seed", 3], "--seed scatters what --readings writes"),
        (["--readings", tmp_path / "n", "--json", tmp_path / "n" / "group1.csv"], "lies in --readings"),
        (["--readings", tmp_path / "n" / "below", "--out", tmp_path / "n"], "lies in --readings, or that in --out"),
        (["--readings", exact], "holds something already"),
        (["--readings", tmp_path / "n", "--set", "nu=3"], "it is of the scatter: add --readings FOLDER --seed N"),
        (["--readings", tmp_path / "n", "--seed", 1, "--set", "nu=300"], "nu = 300 is impossible"),
    ):
        assert run(monkeypatch, "simulate", known_folder, *words) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1 and not (tmp_path / "n").exists()


def test_sessions_of_simulated_readings_have_their_own_gains(known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """With a seed as the model believes, but for those that are given; else none."""
    words = ["simulate", known_folder, "--quiet", "--terms", "reading_gain", "--set", "reading_gain_spread=0.5"]
    small = ("--set", "sigma_rel=0.001", "--set", "sigma_abs=0.001", "--set", "reading_gain_z_2=-1")
    assert run(monkeypatch, *words, "--readings", tmp_path / "none") == 0
    assert run(monkeypatch, *words, "--readings", tmp_path / "own", "--seed", 3, *small) == 0
    pairs = zip(*(read_experiment(tmp_path / name).groups for name in ("own", "none")), strict=True)
    gains = [float(np.median(own.launch_range_um / none.launch_range_um)) for own, none in pairs]
    assert gains[1] == pytest.approx(np.exp(-0.5), rel=0.01)
    assert min(abs(np.log(gains[k])) for k in (0, 2)) > 0.01 and gains[0] != pytest.approx(gains[2], rel=0.01)


def test_a_folder_that_cannot_be_filled_is_as_it_was(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    folder = shutil.copytree(diagnosis[0], tmp_path / "run")
    write_experiment(diagnosis[1], folder / "experiment")
    write = writer.write_atomically
    commands = (["plan", folder, "--out"], ["simulate", known_folder, "--readings"])
    for wrong in (InputError("cannot be written (No space left on device)", "make room"), KeyboardInterrupt()):

        def full(path: Path, content: bytes, wrong: BaseException = wrong) -> None:
            if path.suffix == ".toml":
                raise wrong
            write(path, content)

        with monkeypatch.context() as patch:
            patch.setattr(writer, "write_atomically", full)
            for words in commands:
                assert run(monkeypatch, *words, tmp_path / "deep" / "new") == 2 and not (tmp_path / "deep").exists()
    for words in commands:
        (tmp_path / words[0]).mkdir()
        (tmp_path / words[0] / ".group1.csv.7.tmp").write_text("killed")
        assert run(monkeypatch, *words, tmp_path / words[0]) == 0 and read_plan(tmp_path / words[0]).groups
    # What an experiment cannot hold is not left there either.
    far = ("--set", "k_c=1e9", "--readings", tmp_path / "far")
    text = (known_folder / "experiment.toml").read_text("utf-8")
    kite = shutil.copytree(known_folder, tmp_path / "kite")
    (kite / "experiment.toml").write_text(text.replace("l = 0.09", "l = 9e6").replace("q = 1.2e-07", "q = 1e-3"))
    capsys.readouterr()
    assert run(monkeypatch, "simulate", kite, *far) == 2 and not (tmp_path / "far").exists()
    assert capsys.readouterr().err.count("\n") == 1


def test_a_planned_group_keeps_its_uncertainty(known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    folder = shutil.copytree(known_folder, tmp_path / "plan")
    first = read_plan(folder).groups[0]
    (folder / first.file).write_text("frequency_hz,amplitude_v,sigma_um\n500,20,2\n900,20,3\n", "utf-8")
    assert run(monkeypatch, "simulate", folder, "--quiet", "--readings", tmp_path / "made", "--seed", 1) == 0
    made = read_experiment(tmp_path / "made").groups[0].sigma_um
    assert made is not None and made.tolist() == [2.0, 3.0]


def test_a_proposal_becomes_a_plan(diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Measured groups stay as they are; the proposed one waits for its readings, and for nothing else."""
    folder, experiment = shutil.copytree(diagnosis[0], tmp_path / "run"), diagnosis[1]
    write_experiment(experiment, folder / "experiment")
    assert run(monkeypatch, "plan", folder, "--out", tmp_path / "next") == 0
    said = capsys.readouterr().out
    plan = read_plan(tmp_path / "next")
    *old, new = plan.groups
    assert [g.id for g in old] == list(experiment.ids) and new.id not in experiment.ids and f"group {new.id}:" in said
    assert all(isinstance(g, Group) for g in old) and not isinstance(new, Group)
    assert new.waveform == "sine" and dict(new.changed) == {"l": 0.075} and new.frequency_hz.tolist() == [100.0, 2e4]
    file = tmp_path / "next" / new.file
    assert str(file) in said
    file.write_text("frequency_hz,amplitude_v,launch_range_um\n100,20,5\n20000,20,1\n", "utf-8")
    assert read_experiment(tmp_path / "next").group(new.id).rig(experiment.constants).l == 0.075
    assert run(monkeypatch, "plan", folder, "--proposal", 2, "--out", tmp_path / "other") == 0
    assert read_plan(tmp_path / "other").groups[-1].waveform == "square"
    spoilt, forged = (shutil.copytree(folder, tmp_path / name) for name in ("spoilt", "forged"))
    write_experiment(experiment.with_readings(np.concatenate([g.launch_range_um for g in experiment.groups]) + 1),
                     spoilt / "experiment")  # fmt: skip
    record = make_record(experiment)
    bad = {**record.next_experiment["proposals"][0], "frequency_hz": [-1.0, 5.0]}
    odd = replace(record, next_experiment=record.next_experiment | {"proposals": [bad]})
    write_json(forged / "diagnosis.json", odd, sealed=True)
    nothing = shutil.copytree(folder, tmp_path / "nothing")
    write_json(nothing / "diagnosis.json", replace(make_record(experiment), next_experiment={}), sealed=True)
    capsys.readouterr()
    for words, told in (
        ([folder, "--out", tmp_path / "next"], "holds something already"),
        ([folder, "--proposal", 3, "--out", tmp_path / "x"], "--proposal 3: there are 2"),
        ([nothing, "--out", tmp_path / "x"], "proposes no measurement"),
        ([diagnosis[0], "--out", tmp_path / "x"], "keeps no measurements; name them with --experiment EXP"),
        ([spoilt, "--out", tmp_path / "x"], "is not the experiment that was diagnosed"),
        ([forged, "--out", tmp_path / "x"], "holds no proposal psafit could have made"),
        ([tmp_path, "--out", tmp_path / "x"], "lies in the input"),
    ):
        assert run(monkeypatch, "plan", *words) == 2
        error = capsys.readouterr().err
        assert told in error and error.count("\n") == 1 and not (tmp_path / "x").exists()
    assert [of_rigs._unused(ids) for ids in ((1, 2), (1, 3), ("a", 1), ("next1",))] == [3, 4, "next1", "next2"]


def test_a_picture_of_a_plan_shows_no_readings() -> None:
    plan = [Conditions(1, "sine", "", np.geomspace(1e2, 1e4, 9), np.full(9, 20.0))]
    none = [[figures.Curve("simulated", "vermillion", np.r_[0.0, np.geomspace(0.5, 80.0, 8)])]]
    figure = figures.groups_figure(plan, [figures.sweep_of(g) for g in plan], none)
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["zero", "simulated"]
    assert (
        figure.axes[0].get_yscale() == "log" and len(figure.axes[0].lines) == 3
    )  # zeros at the foot, a line, what will be read


def test_measured_and_simulated_are_told_apart(known: Experiment) -> None:
    sweeps = [figures.sweep_of(g) for g in known.groups]
    curves = [[figures.Curve("simulated", "vermillion", 1.2 * g.launch_range_um)] for g in known.groups]
    figure = figures.groups_figure(known.groups, sweeps, curves)
    assert len(figure.axes) == 3
    for axes, group in zip(figure.axes, known.groups, strict=True):
        assert axes.get_ylabel() == "Launch range (µm)" and re.search(r"\((Hz|V)\)", axes.get_xlabel())
        line = next(x for x in axes.lines if x.get_linestyle() == "-")
        circles = next(x for x in axes.lines if x.get_marker() == "o")
        assert line.get_color() != circles.get_markeredgecolor() and line.get_marker() in (None, "None", "")
        assert len(circles.get_xdata()) == np.count_nonzero(group.launch_range_um > 0) or axes.get_yscale() == "linear"
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["measured", "simulated"]


def test_numbers_to_explore_are_those_of_the_curves(known: Experiment) -> None:
    group = known.groups[2]
    curve = figures.Curve("model", "blue", 2 * group.launch_range_um)
    told = figures.explorable("t", group, figures.sweep_of(group), [curve], [replace(curve, name="more")])
    order = np.argsort(group.amplitude_v, kind="stable")
    assert told["x"] == pytest.approx(group.amplitude_v[order], rel=1e-4)
    assert told["measured"] == pytest.approx(group.launch_range_um[order], rel=1e-4)
    assert told["curves"][0]["middle"] == pytest.approx(2 * group.launch_range_um[order], rel=1e-4)
    assert [c["off"] for c in told["curves"]] == [False, True]
    line = np.array([1.0, 2.0]), np.array([0.123456789, 4.0])
    (drawn,) = figures.explorable("t", group, figures.sweep_of(group), [replace(curve, line=line)])["curves"]
    assert drawn["line"] == [[1.0, 2.0], [0.12346, 4.0]] and told["curves"][0]["line"] is None


# A fit that is watched -------------------------------------------------------------------------------------------


@pytest.fixture
def running(fitted: tuple[Path, Path], tmp_path: Path) -> Iterator[Path]:
    """A fit in the middle of its chain."""
    folder = tmp_path / "running"
    shutil.copytree(fitted[0], folder)
    (folder / "posterior.json").unlink()
    begun = time.time() - 12
    os.utime(folder / "fit.json", (begun, begun))
    os.utime(folder / "chain.h5", (begun + 6, begun + 6))
    with sole(folder):
        yield folder


def test_a_finished_run_is_told(fitted: tuple[Path, Path], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    state = watch.look(fitted[0])
    assert (state.stage, state.steps, state.walkers) == ("gave up", 60, 32) and state.finished
    file = tmp_path / "w.json"
    assert run(monkeypatch, "watch", fitted[0], "--json", file) == 0  # does not wait for more
    line = capsys.readouterr().out
    assert line.startswith("gave up before it converged") and line.count("\n") == 1
    assert json.loads(file.read_text())["steps"] == 60


def test_one_that_gave_up_and_is_drawn_on_is_not_finished(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    folder = tmp_path / "again"
    shutil.copytree(fitted[0], folder)
    with sole(folder):
        state = watch.look(folder)
    assert (state.stage, state.steps) == ("sample", 60) and not state.finished
    assert watch.look(folder).stage == "gave up"


def test_a_running_one_is_told_of(running: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match="holds a run under way; psafit watch shows how far it is"):
        load(running)
    before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in running.rglob("*") if p.is_file()}
    state = watch.look(running)
    assert (state.stage, state.steps) == ("sample", 60) and not state.stalled
    assert state.seconds_per_step == pytest.approx(0.1) and (state.seconds_left or 0) >= 0.1 * SHORT.chunk
    assert state.log_posterior is not None and state.best_minimum is not None
    assert state.log_posterior <= state.best_minimum + 1
    assert watch.look(running, state) is state  # the same checkpoint is not read again
    assert run(monkeypatch, "watch", running, "--once") == 0
    line = capsys.readouterr().out
    words = ("sampling; steps 60", "acceptance", "autocorrelation times", "R-hat", "best log posterior", "time left")
    assert all(word in line for word in words)
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in before} == before


def test_the_pace_is_that_of_the_last_checkpoints(running: Path) -> None:
    state = watch.look(running)
    later = (state.written or 0) + 3
    with h5py.File(running / "chain.h5", "a") as f:
        group = f["psafit"]
        chain, height = group["chain"][:], group["log_prob"][:]
        for name, values in (("chain", chain), ("log_prob", height)):
            group[name].resize(2 * len(values), axis=0)
            group[name][len(values) :] = values
        group.attrs["iteration"] = 120
    os.utime(running / "chain.h5", (later, later))
    after = watch.look(running, state)
    assert after.steps == 120 and after.seconds_per_step == pytest.approx(3 / 60)
    long_ago = replace(after, written=time.time() - 3600)
    assert not long_ago.stalled and replace(long_ago, running=None).stalled


def test_a_long_chain_is_thinned(running: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    whole = watch.look(running)
    monkeypatch.setattr(watch, "_VALUES", 60 * 32 * 6 // 3)
    part = watch.look(running)
    assert part.steps == 60 and part.acceptance == pytest.approx(whole.acceptance)
    assert part.autocorrelation_time == pytest.approx(whole.autocorrelation_time, rel=0.8)


def test_a_file_that_is_written_is_neither_locked_nor_trusted(running: Path) -> None:
    hold = f"import h5py; f = h5py.File({str(running / 'chain.h5')!r}, 'a'); print('held', flush=True); input()"
    with subprocess.Popen([sys.executable, "-c", hold], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None and writer.stdout.readline() == b"held\n"
        with pytest.raises(OSError):
            h5py.File(running / "chain.h5", "r")
        assert watch.look(running).steps == 60
        writer.communicate(b"\n")
    content = (running / "chain.h5").read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"no HDF5 at all"):
        (running / "chain.h5").write_bytes(damaged)
        state = watch.look(running)
        assert (state.stage, state.steps) == ("sample", None)
    (running / "chain.h5").write_bytes(content)
    with h5py.File(running / "chain.h5", "a") as spoilt:
        spoilt["psafit/chain"][0, 0, 0] = np.nan
    assert watch.look(running).steps is None
    (running / "chain.h5").unlink()  # between a missed minimum and the next checkpoint
    assert watch.look(running).steps is None


def test_before_the_chain(fitted: tuple[Path, Path], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / ".psafit-run").write_text("ab")
    with sole(tmp_path):
        assert run(monkeypatch, "watch", tmp_path, "--once") == 0
        assert "searching for minima; sampling has not begun" in capsys.readouterr().out
        shutil.copy(fitted[0] / "fit.json", tmp_path)
        assert run(monkeypatch, "watch", tmp_path, "--once") == 0
        assert "sampling; no checkpoint yet; best log posterior" in capsys.readouterr().out
    assert run(monkeypatch, "watch", tmp_path, "--once") == 0
    assert capsys.readouterr().out.startswith("interrupted: nothing works in this folder now")


def test_an_r_hat_is_told_on_its_side_of_the_goal() -> None:
    told = [told_r_hat(value, 1.01) for value in (1.0099, 1.002, 1.00999, 1.01, 1.0100001, 1.9)]
    assert told == ["1.0099", "1.0020", "1.00999", "1.0100", "1.0101", "1.9000"]


def test_a_foreign_folder_is_one_line(diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "fit.json").write_text("{")
    for folder, said in (
        (tmp_path, "is not a run folder"),
        (tmp_path / "none", "is no folder"),
        (tmp_path / "damaged", "is damaged"),
        (diagnosis[0], "is a diagnosis, which draws no chain"),
    ):
        assert run(monkeypatch, "watch", folder, "--once") == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_a_chain_that_is_long_enough_is_being_described(running: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    real = emcee_adaptor.chain_of
    monkeypatch.setattr(emcee_adaptor, "chain_of", lambda *a: replace(real(*a), converged=True))
    state = watch.look(running)
    assert state.stage == "profile" and state.seconds_left is None


def test_watching_ends_with_the_run_or_with_the_watcher(  # type: ignore[no-untyped-def]
    fitted: tuple[Path, Path], running: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    looks = 0

    def pause(seconds: float) -> None:
        nonlocal looks
        looks += 1
        if looks == 3:
            shutil.copy(fitted[0] / "posterior.json", running)

    with monkeypatch.context() as ending:
        ending.setattr(watching.time, "sleep", pause)
        # The summary is written first, then the folder is let go.
        ending.setattr(watch, "in_use", lambda folder: looks < 4)
        assert run(ending, "watch", running) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and lines[0].startswith("sampling") and lines[1].startswith("gave up")

    def stop(seconds: float) -> None:
        raise KeyboardInterrupt

    (running / "posterior.json").unlink()
    monkeypatch.setattr(watching.time, "sleep", stop)
    assert run(monkeypatch, "watch", running) == 0
    told = capsys.readouterr()
    assert told.err == "" and told.out.startswith("sampling")


def test_a_terminal_gets_a_table(running: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from rich.console import Console

    console = Console(width=100, record=True, force_terminal=True)
    console.print(watching._table(running, watch.look(running)))
    text = console.export_text()
    assert "running" in text and "R-hat" in text and "━" in text and "60 of each of 32 walkers" in text


@pytest.mark.slow
def test_a_fit_is_watched_while_it_runs(known_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = [sys.executable, "-m", "psafit"]
    one = subprocess.Popen([*words, "fit", known_folder, "--group", "1", "--out", out, "--quiet", "--no-report"])
    until = time.monotonic() + 300
    while not (out / "fit.json").exists():
        assert one.poll() is None and time.monotonic() < until
        time.sleep(0.1)
    one.send_signal(signal.SIGSTOP)  # until the watcher is there
    watching = [*words, "watch", out, "--every", "0.3"]
    watcher = subprocess.Popen(watching, stdout=subprocess.PIPE, text=True)
    assert watcher.stdout is not None
    first = watcher.stdout.readline()
    one.send_signal(signal.SIGCONT)
    rest, _ = watcher.communicate(timeout=300)
    assert (one.wait(timeout=60), watcher.returncode) == (0, 0)
    lines = [first, *rest.splitlines()]
    assert len(lines) > 2 and lines[-1].startswith("done; steps ")
    assert any("time left a" in line for line in lines)  # about, or at least
    assert isinstance(psafit.load(out), Fitted)


def test_an_edited_fit_is_not_watched(fitted: tuple[Path, Path], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    folder = shutil.copytree(fitted[0], tmp_path / "edited")
    record = json.loads((folder / "fit.json").read_text("utf-8"))
    record["minima"] = []
    (folder / "fit.json").write_text(json.dumps(record), "utf-8")
    assert run(monkeypatch, "watch", folder) == 2
    assert "fit.json: was changed after psafit wrote it" in capsys.readouterr().err

"""The notebook."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from diagnoses_by_hand import make_record
from fits_by_hand import make_run, mixed_groups
from markupsafe import escape
from reader import HOSTILE
from test_architecture import HEAVY

import psafit
from psafit.api import Diagnosed, Fitted, Rig
from psafit.errors import InputError
from psafit.experiment import Experiment

ROOT = Path(__file__).resolve().parents[1]


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


@pytest.mark.slow
def test_a_fit_in_a_notebook(fitted: tuple[Path, Path]) -> None:
    from matplotlib.figure import Figure

    one = psafit.load(fitted[0])
    assert list(one.parameters.index[:3]) == ["k_c", "c_s", "c_c"]
    assert (one.parameters["lower_90"] < one.parameters["median"]).all()
    assert list(one.scores["role"]) == ["fit", "holdout", "holdout"] and len(one.predictions) == 62
    assert "fitted to group 1 of A rig with known truth" in " ".join(repr(one).split()) and "not converged" in repr(one)
    reported = next(line for line in repr(one).splitlines() if line.startswith("c_c "))
    assert reported.count("c_c") == 1 and re.search(r"\d\.\d{4}$", reported)  # named once; R-hat to four decimals
    html = one._repr_html_()
    assert html.count("<table") == 2 and "k_c" in html and "N s/m" in html
    ax = Figure().subplots()
    assert one.plot(ax=ax) is ax and one.plot(2, ax=ax) is ax
    with pytest.raises(InputError, match="there is no group"):
        one.plot(9, ax)
    assert one.report() == fitted[0] / "report.html"


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    """A fit to ranges, speeds and contact times of one sweep and a trace; another such sweep was held out."""
    return Fitted(make_run(tmp_path_factory.mktemp("mixed"), mixed_groups(), (1, "trace")))


def test_readings_of_several_observables_are_in_columns_of_their_own(mixed: Fitted) -> None:
    rig = Rig(mixed.run.problem.experiment)
    data = rig.data
    assert list(data.columns[4:]) == [
        "time_us", "launch_range_um", "launch_speed_mm_s", "contact_time_us", "velocity_mm_s",
    ]  # fmt: skip
    counts = data.count()[["time_us", "launch_range_um", "launch_speed_mm_s", "contact_time_us", "velocity_mm_s"]]
    assert counts.tolist() == [12, 10, 10, 10, 12]
    shown = rig._summary_parts()[2][0]
    assert shown.loc["1", ["launch range (um)", "launch speed (mm/s)", "contact time (us)"]].tolist() == [
        "20 to 30", "0.2 to 0.3", "150 to 400",
    ]  # fmt: skip
    assert shown.loc["trace", ["time (us)", "velocity (mm/s)"]].tolist() == ["0 to 110", "-0.5 to 10.5"]
    assert shown.loc["trace", ["launch range (um)"]].isna().all() and "NaN" not in repr(rig)


def test_a_picture_shows_one_observable(mixed: Fitted) -> None:
    rig = Rig(mixed.run.problem.experiment)
    for view in (rig, mixed):
        for asked, label in (
            (None, "Launch range (µm)"),
            ("launch_speed", "Launch speed (mm/s)"),
            ("contact_time", "Contact time (µs)"),
        ):
            ax = view.plot(1, observable=asked)
            assert ax.get_ylabel() == label and max(len(line.get_xdata()) for line in ax.lines) == 5
        assert view.plot("trace").get_ylabel() == "Velocity (mm/s)"
        with pytest.raises(InputError, match="group 1 has no velocity; choose launch_range or launch_speed or contact"):
            view.plot(1, observable="velocity")
    with pytest.raises(InputError, match="velocity of no group; name the group, too"):
        mixed.plot(observable="velocity")


def test_errors_are_named_by_what_is_read(mixed: Fitted) -> None:
    names = [tick.get_text() for tick in mixed.plot().get_yticklabels()]
    assert names[:3] == ["1: launch range, sine", "1: launch speed, sine", "1: contact time, sine"]
    assert names[3].startswith("trace: velocity, ")
    experiment = mixed.run.problem.experiment
    found = Diagnosed(make_record(experiment), experiment, mixed.run.folder)
    assert len({tick.get_text() for tick in found.plot().get_yticklabels()}) == 7


def test_a_diagnosis_shows_one_observable(mixed: Fitted, tmp_path: Path) -> None:
    experiment = mixed.run.problem.experiment
    found = Diagnosed(make_record(experiment), experiment, tmp_path)
    ax = found.plot(1, observable="launch_speed")
    assert ax.get_ylabel() == "Launch speed (mm/s)" and len(ax.lines[0].get_xdata()) == 5
    assert found.plot(1).get_ylabel() == "Launch range (µm)"
    part = Diagnosed(replace(found.record, groups=[1, "trace"]), experiment, tmp_path)
    with pytest.raises(InputError, match="group 2 is not of this diagnosis; choose one of 1, trace"):
        part.plot(2)


def test_predictions_of_several_observables_say_what_they_are(mixed: Fitted) -> None:
    table = mixed.predictions
    assert list(table.columns) == [
        "group", "waveform", "frequency_hz", "amplitude_v", "time_us", "observable", "unit", "measured", "predicted",
        "lower", "upper", "role",
    ]  # fmt: skip
    assert table.value_counts(["observable", "unit"]).to_dict() == {
        ("launch_range", "um"): 10, ("launch_speed", "mm/s"): 10, ("contact_time", "us"): 10, ("velocity", "mm/s"): 12,
    }  # fmt: skip
    group = mixed.run.problem.experiment.group(1)
    speeds = table[(table["group"] == 1) & (table["observable"] == "launch_speed")]
    assert speeds["measured"].tolist() == group.parts[1].reading.tolist() and speeds["time_us"].isna().all()
    assert (table["lower"] <= table["predicted"]).all() and table["time_us"].count() == 12
    scores = mixed.scores
    assert scores.loc[1, "observable"].tolist() == ["launch_range", "launch_speed", "contact_time"]
    assert scores.loc[1, "unit"].tolist() == ["um", "mm/s", "us"] and "contact_time" in repr(mixed)


def test_predictions_of_one_observable_are_as_in_its_file(mixed: Fitted, tmp_path: Path) -> None:
    for k, columns in ((0, ["launch_range_um", "predicted_um"]), (1, ["launch_speed_mm_s", "predicted_mm_s"])):
        groups = [mixed.run.problem.experiment.group(id).parts[k] for id in (1, 2)]
        one = Fitted(make_run(tmp_path / str(k), groups, (1,)))
        assert list(one.predictions.columns[4:6]) == columns and "observable" not in one.predictions
        assert ("launch_speed" in repr(one)) == (k == 1) and "time_us" not in Rig(one.run.problem.experiment).data


def test_the_notebook_uses_the_command_line_s_folders(known: Experiment, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    from psafit import api

    asked: list[Path] = []

    def reported(experiment, ids, folder, **options):  # type: ignore[no-untyped-def]
        asked.append(folder)
        raise InputError("enough", "stop")

    monkeypatch.setattr(api, "fit", reported)
    monkeypatch.setattr(api, "diagnose", reported)
    rig = Rig(known)
    for ask in (lambda: rig.fit(1, quiet=True), lambda: rig.fit([1, 2], terms=["preload", "gap"], quiet=True),
                lambda: rig.diagnose(quick=True, quiet=True)):  # fmt: skip
        with pytest.raises(InputError, match="enough"):
            ask()
    assert [p.name for p in asked] == ["known-group1", "known-group1-2-gap-preload", "known-diagnosis"]


def test_the_notebook_refuses_what_the_command_line_refuses(known_folder: Path, tmp_path: Path) -> None:
    rig = psafit.open(known_folder)
    for ask, said in (
        (lambda: rig.fit(1, out=tmp_path / "x", starts=0, quiet=True), "0 starts"),
        (lambda: rig.fit(1, out=tmp_path / "x", seed=-1, quiet=True), "seed -1"),
        (lambda: rig.fit([1, 1], out=tmp_path / "x", quiet=True), "named twice"),
        (lambda: rig.fit(1, out=tmp_path / "x", settings={"max_step": 9}, quiet=True), "did you mean max_steps?"),
        (lambda: rig.fit(1, out=tmp_path / "x", settings={"max_steps": 9.5}, quiet=True), "is 9.5; give a whole"),
        (lambda: rig.fit(1, out=tmp_path / "x", settings={"thin": -1}, quiet=True), "is -1; give a positive"),
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
    assert "baseline" in found._repr_html_() and f"<li>{escape(found.record.sentences[-1])}</li>" in found._repr_html_()
    lines = repr(found).splitlines()
    assert lines[0].startswith("verdict: ambiguous: hysteresis")
    assert sum(line.startswith("- ") for line in lines) == len(found.record.sentences)
    assert f"- {found.record.sentences[0]}" in " ".join(repr(found).split())
    ax = Figure().subplots()
    assert found.plot(ax=ax) is ax and found.plot(2, ax=ax) is ax
    assert found.report() == folder / "diagnosis.html"
    with pytest.raises(InputError, match=r"holds a diagnosis, not a fit; read it with psafit\.load_diagnosis"):
        psafit.load(folder)
    (folder / "extension-gap").mkdir()
    (folder / "extension-gap" / "fit.json").write_text("{}")
    with pytest.raises(InputError, match="or give the fit within it, extension-gap"):
        psafit.load(folder)


def test_what_others_wrote_is_escaped(known: Experiment) -> None:
    groups = (replace(known.groups[0], id=HOSTILE),)
    html = Rig(replace(known, title=HOSTILE, groups=groups))._repr_html_()
    assert "<script" not in html and html.count("&lt;script&gt;") == 2


def test_parameters_of_a_diagnosis(diagnosis: tuple[Path, Experiment]) -> None:
    folder, experiment = diagnosis
    found = Diagnosed(make_record(experiment), experiment, folder)
    table = found.parameters
    assert list(table.columns) == ["median", "lower_90", "upper_90", "unit", "implausible"]
    cause = found.record.causes[0]
    assert list(table.index) == list(cause.parameters) and table["implausible"].sum() == len(cause.implausible) == 1
    assert table["median"].tolist() == [p.median for p in cause.parameters.values()]
    for model in ("slew_limit + gap", ["gap", "slew_limit"]):
        assert list(found.parameters_of(model).index) == list(found.record.causes[1].parameters)
    assert found.parameters_of("baseline").equals(found.parameters_of([]))
    assert found.parameters_of("baseline")["lower_90"].isna().all()  # it was not sampled
    with pytest.raises(InputError, match="no model preload; choose one"):
        found.parameters_of("preload")


def test_a_diagnosis_prints_the_values_of_what_it_names(diagnosis: tuple[Path, Experiment]) -> None:
    folder, experiment = diagnosis
    found = Diagnosed(make_record(experiment), experiment, folder)
    cause = found.record.causes[0]
    text = repr(found)
    assert "parameter of hysteresis" in text and "90 %: " in text and "implausible under its prior" in text
    assert all(name in text for name in cause.parameters) and "parameter of hysteresis" in found._repr_html_()
    reported = repr(found.record)
    assert reported.startswith("Diagnosis(verdict='ambiguous', named=['hysteresis']") and "causes: 3" in reported
    assert len(reported) < 1000


def test_a_baseline_that_was_not_sampled_has_values_too(diagnosis: tuple[Path, Experiment]) -> None:
    folder, experiment = diagnosis
    found = Diagnosed(replace(make_record(experiment), named=[], verdict="adequate"), experiment, folder)
    assert "parameter of baseline" in repr(found) and "(not sampled)" in repr(found)

"""`psafit simulate`: tables, pictures and experiments."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas
import pytest
from commands import run
from diagnoses_by_hand import make_record
from fits_by_hand import make_run, mixed_groups

from psafit.cli import simulating
from psafit.diagnose.record.models import ParameterResult
from psafit.errors import InputError
from psafit.experiment import (
    Conditions,
    Experiment,
    Plan,
    read_experiment,
    read_plan,
    session_name,
    write_experiment,
    writer,
)
from psafit.inference.problem import Problem
from psafit.inference.run_folder import load
from psafit.observables import LAUNCH_SPEED, OBSERVABLES
from psafit.physics import terms
from psafit.physics.term import idle
from psafit.records import write_json
from psafit.validate import intervals, predict


def test_names_of_a_sessions_own_hold_its_id(known: Experiment) -> None:
    """What a fit prints is what `simulate --set` takes and a sealed answer holds, whichever groups were fitted."""
    groups = [replace(known.groups[0], id=id) for id in (7, "late show", "x_2")]
    late = session_name("reading_gain_z", "late show")
    experiment = replace(known, groups=tuple(groups))
    both = Problem(experiment, ("x_2", 7), terms(["reading_gain"]))
    assert both.names[-5:-3] == ("reading_gain_z_x_2", "reading_gain_z_7")
    values = both.to_physical(both.prior_transform(np.linspace(0.3, 0.7, both.n_dim))).tolist()
    given = dict(zip(both.names, values, strict=True))
    theta = simulating.completed(Plan(known.constants, experiment.groups, ()), both.terms, given, {})
    gains = {name: z for name, z in theta.items() if "_z_" in name}
    assert list(gains) == ["reading_gain_z_7", late, "reading_gain_z_x_2"]
    assert list(gains.values()) == [given["reading_gain_z_7"], 0.0, given["reading_gain_z_x_2"]]
    assert len({session_name("z", id) for id in (1, "a-b", "a_b", "a b", "ä-b")}) == 5 and late.isidentifier()


def test_simulate_takes_the_model_of_a_diagnosis(  # type: ignore[no-untyped-def]
    diagnosis: tuple[Path, Experiment], known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    """Of its own model it says the verdict first; of one that is changed that verdict says nothing."""
    record = make_record(diagnosis[1])
    values = {"k_c": 2e6, "hysteresis_strength": 0.2, "hysteresis_voltage": 15.0, "sigma_rel": 0.05}
    parameters = {n: ParameterResult(x, None, None, "1", "", 0.5) for n, x in values.items()}
    best = replace(record.causes[0], terms=["hysteresis"], parameters=parameters)
    write_json(tmp_path / "diagnosis.json", replace(record, causes=[best, *record.causes[1:]]), sealed=True)
    words = ("--set", "c_c=40", "--quiet", "--json", tmp_path / "it.json")
    assert run(monkeypatch, "simulate", known_folder, "--run", tmp_path, *words) == 0
    reported = json.loads((tmp_path / "it.json").read_text("utf-8"))
    assert reported["terms"] == ["hysteresis"]
    wanted = {"k_c": 2e6, "c_c": 40.0, "hysteresis_strength": 0.2, "hysteresis_voltage": 15.0}
    assert wanted.items() <= reported["parameters"].items() and "sigma_rel" not in reported["parameters"]
    assert "run" not in reported
    capsys.readouterr()
    assert run(monkeypatch, "simulate", known_folder, "--run", tmp_path, "--json", tmp_path / "said.json") == 0
    said = json.loads((tmp_path / "said.json").read_text("utf-8"))["run"]
    assert said.startswith(f"verdict: {record.verdict}: ") and said in capsys.readouterr().err
    assert said.endswith("; what is simulated is hysteresis") == (record.verdict == "ambiguous")


def test_a_ball_that_hardly_passes_its_place_of_rest_reads_no_less_than_zero(
    known: Experiment, tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    """It leans on a soft tip and hardly moves: as a fit has it, and as an experiment can hold it."""
    write_experiment(known, tmp_path / "rig")
    lean = ("--terms", "preload", "--set", "k_c=7649.9", "--set", "c_s=418.3", "--set", "c_c=5.782")
    words = ("simulate", tmp_path / "rig", *lean, "--set", "preload_offset=2.7e-4")
    for seed in ((), ("--seed", 1)):
        out = tmp_path / f"readings{len(seed)}"
        assert run(monkeypatch, *words, "--readings", out, "--out", tmp_path / "s.csv", *seed) == 0, capsys.readouterr()
        reported = pandas.read_csv(tmp_path / "s.csv")["predicted_um"].to_numpy()
        assert 0.0 <= reported.min() < 0.05 < reported.max()
        assert min(g.reading.min() for g in read_experiment(out).groups) >= 0.0


def test_a_session_to_come_has_no_gain_of_the_runs(known: Experiment, capsys) -> None:  # type: ignore[no-untyped-def]
    """Ids of other folders' groups are numbers like one's own: only a session's very readings are that session."""
    (gain,) = terms(["reading_gain"])
    own = known.groups[0]
    name = session_name("reading_gain_z", own.id)
    medians = {"k_c": 2e6, "reading_gain_spread": 0.1, name: 1.2}
    read_again = replace(own, reading=own.reading + 1.0)
    planned = Conditions(own.id, own.waveform, own.file, own.frequency_hz, own.amplitude_v)
    for group, kept in ((own, True), (read_again, False), (planned, False)):
        plan = Plan(known.constants, (group,), ())
        found = simulating.of_sessions(plan, (gain,), medians, [own], False)
        assert found == (medians if kept else {k: v for k, v in medians.items() if k != name})
        assert capsys.readouterr().err == ("" if kept else f"sessions to come, not those of the run: {name} = 0\n")


@pytest.mark.slow
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
    reported = {}
    for place in (known_folder, folder):
        out, picture = tmp_path / "simulated.csv", tmp_path / "picture.svg"
        capsys.readouterr()
        assert run(monkeypatch, "simulate", place, "--out", out, "--plot", picture) == 0
        assert "by the medians of their priors: k_c = " in capsys.readouterr().err
        reported[place] = pandas.read_csv(out)
    with_readings, without = reported.values()
    assert with_readings["predicted_um"].equals(without["predicted_um"])
    assert without["launch_range_um"].isna().equals(without["group"] == planned.id)
    assert (without["launch_range_um"][without["group"] == measured.id] == measured.reading).all()
    capsys.readouterr()
    assert run(monkeypatch, "check", folder) == 2 and "missing column 'launch_range_um'" in capsys.readouterr().err
    (folder / planned.file).write_text("frequency_hz\n100\n", "utf-8")
    assert run(monkeypatch, "simulate", folder) == 2 and "missing column 'amplitude_v'" in capsys.readouterr().err


def test_simulated_readings_are_an_experiment(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """What is written is what was simulated; a seed scatters it as the model says, and always the same."""
    noise = ("--set", "sigma_rel=0.04", "--set", "sigma_abs=1e-3", "--set", "nu=100")
    exact, drawn, again = (tmp_path / name for name in ("exact", "drawn", "again"))
    assert run(monkeypatch, "simulate", known_folder, "--readings", exact, "--out", tmp_path / "s.csv") == 0
    for place in (drawn, again):
        assert run(monkeypatch, "simulate", known_folder, "--readings", place, "--seed", 3, *noise) == 0
    capsys.readouterr()
    measured, simulated = read_experiment(known_folder), read_experiment(exact)
    assert np.concatenate([g.reading for g in simulated.groups]) == pytest.approx(
        pandas.read_csv(tmp_path / "s.csv")["predicted_um"].to_numpy()
    )
    assert "simulated" in simulated.title and simulated.constants == measured.constants
    for a, b in zip(measured.groups, simulated.groups, strict=True):
        assert (a.id, a.waveform) == (b.id, b.waveform) and (a.frequency_hz == b.frequency_hz).all()
    assert read_experiment(drawn).fingerprint == read_experiment(again).fingerprint != simulated.fingerprint
    both = zip(read_experiment(drawn).groups, simulated.groups, strict=True)
    ratio = np.concatenate([d.reading / e.reading for d, e in both])
    assert 0.03 < (ratio - 1).std() < 0.06 and abs(ratio.mean() - 1) < 0.02
    assert "k_c = " in read_experiment(drawn).source and "seed 3" in read_experiment(drawn).source
    for words, said in (
        (["--seed", 3], "--seed scatters what --readings writes"),
        (["--readings", tmp_path / "n", "--json", tmp_path / "n" / "group1.csv"], "lies in --readings"),
        (["--readings", tmp_path / "n" / "below", "--out", tmp_path / "n"], "lies in --readings, or that in --out"),
        (["--readings", exact], "holds something already"),
        (["--readings", tmp_path / "n", "--set", "nu=3"], "it is of the scatter: add --readings FOLDER --seed N"),
        (["--readings", tmp_path / "n", "--seed", 1, "--set", "nu=300"], "nu = 300 is impossible"),
        (
            ["--readings", tmp_path / "n", "--seed", 1, "--set", "sigma_rel_launch_speed=0.1"],
            "that of these readings has sigma_rel, sigma_abs, nu",
        ),
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
    gains = [float(np.median(own.reading / none.reading)) for own, none in pairs]
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
    lines = capsys.readouterr().err.splitlines()
    assert ["constant q" in lines[0], "constant l" in lines[1], len(lines)] == [True, True, 2]  # a line for each fault


def test_a_planned_group_keeps_its_uncertainty(known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    folder = shutil.copytree(known_folder, tmp_path / "plan")
    first = read_plan(folder).groups[0]
    (folder / first.file).write_text("frequency_hz,amplitude_v,sigma_um\n500,20,2\n900,20,3\n", "utf-8")
    assert run(monkeypatch, "simulate", folder, "--quiet", "--readings", tmp_path / "made", "--seed", 1) == 0
    made = read_experiment(tmp_path / "made").groups[0].sigma
    assert made is not None and made.tolist() == [2.0, 3.0]


def test_a_plan_taken_for_ranges_says_so(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Where what was measured has speeds and times alone; an empty column asks for these."""
    folder = shutil.copytree(known_folder, tmp_path / "plan")
    planned, *others = read_plan(folder).groups
    for group in others:
        header = "frequency_hz,amplitude_v,launch_speed_mm_s,contact_time_us\n"
        (folder / group.file).write_text(f"{header}500,20,0.3,200\n900,20,0.4,150\n", "utf-8")
    (folder / planned.file).write_text("frequency_hz,amplitude_v\n500,20\n900,20\n", "utf-8")
    assert run(monkeypatch, "simulate", folder) == 0
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [
        f"group {planned.id} is planned and read as launch ranges, the measured groups as launch speeds and contact"
        f" times; in {planned.file}, empty columns launch_speed_mm_s and contact_time_us ask for these"
    ]
    assert "launch_range_um" in printed.out
    (folder / planned.file).write_text("frequency_hz,amplitude_v,launch_speed_mm_s\n500,20,\n900,20,\n", "utf-8")
    assert run(monkeypatch, "simulate", folder) == 0
    printed = capsys.readouterr()
    assert not printed.err and "launch_range_um" not in printed.out
    ranges = shutil.copytree(known_folder, tmp_path / "ranges")
    (ranges / planned.file).write_text("frequency_hz,amplitude_v\n500,20\n", "utf-8")
    assert run(monkeypatch, "simulate", ranges) == 0 and not capsys.readouterr().err
    traces = tmp_path / "traces"  # a column of theirs has no place in a file of launches
    _, trace, _ = mixed_groups()
    write_experiment(make_run(tmp_path, (trace,), (trace.id,)).problem.experiment, traces)
    (traces / "p.csv").write_text("frequency_hz,amplitude_v\n500,20\n", "utf-8")
    with (traces / "experiment.toml").open("a", encoding="utf-8") as definition:
        definition.write('\n[[group]]\nid = 9\nwaveform = "sine"\nfile = "p.csv"\n')
    assert run(monkeypatch, "simulate", traces) == 0 and not capsys.readouterr().err


def test_simulate(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    values = ["--set", "k_c=4e5", "--set", "c_s=9e3", "--set", "c_c=60"]
    assert (
        run(monkeypatch, "simulate", known_folder, *values, "--out", tmp_path / "s.csv", "--json", tmp_path / "s.json")
        == 0
    )
    rows = (tmp_path / "s.csv").read_text().splitlines()
    assert len(rows) == 63
    measured, predicted = map(float, rows[1].split(",")[-2:])
    assert predicted == pytest.approx(measured, rel=0.3)
    assert json.loads((tmp_path / "s.json").read_text())["engine"] == "closed form"
    assert run(monkeypatch, "simulate", known_folder, "--quiet", "--json", tmp_path / "s.json") == 0  # prior medians
    assert json.loads((tmp_path / "s.json").read_text())["parameters"]["c_s"] > 0
    twice = ["--out", tmp_path / "t", "--json", tmp_path / "sub" / ".." / "t"]
    assert run(monkeypatch, "simulate", known_folder, *twice) == 2 and not (tmp_path / "t").exists()
    assert "--json and --out are the same place" in capsys.readouterr().err
    for bad, words in (
        (["--terms", "gap"], "no value for gap_width"),
        ([*values, "--set", "c_x=1"], "no parameter c_x"),
        (["--set", "K_c=1e5"], "no parameter K_c; did you mean k_c?"),
        (["--set", "gap=4e-7"], "no parameter gap; it is a cause: --terms gap --set gap_width=VALUE (m)"),
        ([*values, "--set", "k_c=2e5"], "--set gives k_c twice"),
        ([*values[:5], "c_c=-3"], "impossible"),
        ([*values[:5], "c_c=nan"], "impossible"),
        ([*values[:5], "c_c"], "not NAME=VALUE"),
    ):
        assert run(monkeypatch, "simulate", known_folder, *bad) == 2
        error = capsys.readouterr().err
        assert words in error and error.count("\n") == 1


def test_simulate_takes_the_medians_of_a_fit(fitted: Path, known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """They predict what the run's own file of predictions says, and --set goes before them."""
    words = ["simulate", known_folder, "--run", fitted, "--out", tmp_path / "s.csv", "--json", tmp_path / "s.json"]
    assert run(monkeypatch, *words, "--quiet") == 0
    reported = json.loads((tmp_path / "s.json").read_text())
    medians = {p["name"]: p["median"] for p in json.loads((fitted / "posterior.json").read_text())["parameters"]}
    assert reported["parameters"] == {name: medians[name] for name in reported["parameters"]}
    assert sorted(reported["parameters"]) == ["c_c", "c_s", "k_c"]
    here, there = (pandas.read_csv(file).predicted_um for file in (tmp_path / "s.csv", fitted / "predictions.csv"))
    assert here.tolist() == pytest.approx(there.tolist(), rel=0.05, abs=0.05)
    assert run(monkeypatch, *words, "--quiet", "--set", "k_c=1e6") == 0
    assert json.loads((tmp_path / "s.json").read_text())["parameters"] == reported["parameters"] | {"k_c": 1e6}


def test_a_fit_predicts_with_intervals(fitted: Path, known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Of conditions that were measured those that the fit itself has scored."""
    words = ["simulate", known_folder, "--run", fitted]
    assert run(monkeypatch, *words, "--out", tmp_path / "s.csv", "--json", tmp_path / "s.json") == 0
    table, kept = pandas.read_csv(tmp_path / "s.csv"), json.loads((tmp_path / "s.json").read_text("utf-8"))
    assert list(table.columns)[-4:] == ["launch_range_um", "predicted_um", "lower_um", "upper_um"]
    scored = predict(load(fitted))
    for name in ("lower", "upper"):
        usual = np.concatenate([getattr(p, name) for p in scored])
        assert table[f"{name}_um"].to_numpy() == pytest.approx(usual, rel=0.15, abs=0.3)
        assert kept[f"{name}_um"] == table[f"{name}_um"].tolist()
    assert ((table.lower_um <= table.predicted_um) & (table.predicted_um <= table.upper_um)).all()
    capsys.readouterr()
    assert run(monkeypatch, *words, "--set", "k_c=1e6") == 0
    assert "lower_um" not in capsys.readouterr().out, "no posterior has such a value"


def test_intervals_of_what_was_not_read_have_the_usual_scatter(fitted: Path, known: Experiment) -> None:
    group, fast = known.groups[0], OBSERVABLES.index(LAUNCH_SPEED)
    planned = Conditions(
        "to come", "sine", "", group.frequency_hz, group.amplitude_v, measured=np.full(group.n_points, fast)
    )
    lower, upper = intervals(load(fitted), Plan(known.constants, (planned, replace(group, id="again")), ()))
    n = group.n_points
    assert lower.shape == (2 * n,) and (upper > lower).all() and (lower >= 0).all()
    usual, *_ = (p.prior_median for p in LAUNCH_SPEED.scatter)
    assert (np.log(upper[:n] / lower[:n]) > 2 * 1.6 * usual).all(), "the usual scatter is in it"


def test_causes_that_do_not_act_are_said(known: Experiment) -> None:
    """A phase shifts no square wave, and what changes ranges alone no speed."""
    sine, square, _ = known.groups
    chosen = terms(["start_phase", "separation_height", "gap"])
    speed = replace(sine, measured=np.full(sine.n_points, OBSERVABLES.index(LAUNCH_SPEED)))
    assert idle(chosen, [sine, square]) == [] and idle(chosen, [square]) == ["start_phase"]
    assert idle(chosen, [speed]) == ["separation_height"]
    assert idle(chosen, [speed, square]) == []

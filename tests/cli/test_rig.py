"""`psafit new`, `plan` and `check-cause`."""

from __future__ import annotations

import json
import re
import shutil
import stat
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from commands import psafit, run
from diagnoses_by_hand import make_record
from sensors import SENSOR

from psafit import files
from psafit.cli import rig as of_rigs
from psafit.diagnose.next_experiment import NextExperiment
from psafit.errors import InputError
from psafit.experiment import Constants, Experiment, Group, read_experiment, read_plan, write_experiment
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.observables import OBSERVABLES
from psafit.physics import terms
from psafit.records import write_json
from psafit.report.diagnosis.next_experiment import proposals


def test_a_new_folder_passes_the_check_at_once(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "deep" / "rig"
    assert run(monkeypatch, "new", folder) == 0
    said = capsys.readouterr().out
    assert all(str(p) in said for p in folder.iterdir()) and "psafit check" in said
    assert run(monkeypatch, "check", folder) == 0
    reported = capsys.readouterr()
    assert reported.out.startswith("EXAMPLE, replace")
    # What is still the example's is said, and no longer once it is not.
    assert reported.err.count("\n") == 4 and "source is still that of the example" in reported.err
    assert all(f"example_{name}.csv: group {k}: these readings are the example's" in reported.err
               for k, name in ((1, "sine"), (2, "square")))  # fmt: skip
    assert "all six constants are the example's" in reported.err
    # The same numbers in another spelling are the same numbers.
    sine = folder / "example_sine.csv"
    before = sine.read_bytes()
    sine.write_bytes(before.replace(b"\n", b"\r\n"))
    assert run(monkeypatch, "check", folder) == 0 and capsys.readouterr().err.count("\n") == 4
    sine.write_bytes(before)
    made = read_experiment(folder)
    assert len(made.groups) == 2 and all(g.file.startswith("example_") for g in made.groups)
    # Everything there is to give has a line that explains it.
    text = (folder / "experiment.toml").read_text("utf-8")
    for f in fields(Constants):
        assert re.search(rf"^{f.name} = \S+ +# \S", text, flags=re.MULTILINE)
    for key in ("id", "waveform", "file"):
        assert re.search(rf"^{key} = \S+ +# \S", text, flags=re.MULTILINE)
    for column in (*CONDITION_COLUMNS, "launch_range_um", "sigma_um"):
        assert re.search(rf"^#   {column} +\S", text, flags=re.MULTILINE)
    assert all(o.column in text for o in OBSERVABLES)
    assert max(map(len, text.splitlines())) <= 120
    (folder / "experiment.toml").write_text(text.replace("EXAMPLE, replace: ", ""), "utf-8")
    for table in folder.glob("*.csv"):
        table.write_text(table.read_text("utf-8") + "1000,10,60\n", "utf-8")
    assert run(monkeypatch, "check", folder) == 0 and capsys.readouterr().err == ""
    # The facts that it proposes are those of its constants: q is rated stroke over rated voltage, and called so.
    assert re.search(r"^q = .*rated stroke over rated voltage", text, flags=re.MULTILINE)
    facts = re.search(r"^# \[rig\]\n(# \w+ = .*\n)+", text, flags=re.MULTILINE)
    assert facts
    stated = text.replace("EXAMPLE, replace: ", "").replace(
        facts[0], facts[0].replace("# ", "", 1).replace("\n# ", "\n")
    )
    (folder / "experiment.toml").write_text(stated, "utf-8")
    assert run(monkeypatch, "check", folder) == 0
    checked = capsys.readouterr()
    assert checked.err == "" and checked.out.count(", from [rig]: ") == 10


def test_new_is_quiet_and_takes_an_empty_folder(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, "new", ".", "--quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert read_experiment(tmp_path).groups
    modes = {stat.S_IMODE(p.stat().st_mode) for p in tmp_path.iterdir()}
    assert len(modes) == 1 and modes.pop() & stat.S_IRUSR


@pytest.mark.parametrize("kind", ["filled", "file", "under a file", "dangling link", "empty name"])
def test_new_refuses_what_is_there(kind: str, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "rig"
    if kind == "filled":
        folder.mkdir()
        (folder / "notes.txt").write_text("x")
    elif kind == "dangling link":
        folder.symlink_to(tmp_path / "nowhere")
    else:
        folder.write_text("x")
    before = sorted(tmp_path.rglob("*"))
    name = {"under a file": folder / "below", "empty name": ""}.get(kind, folder)
    assert run(monkeypatch, "new", name) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "; " in said.err
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("there", [True, False])
def test_new_leaves_nothing_half_written(there: bool, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "rig"
    if there:
        folder.mkdir()
    write = files.write_atomically

    def full(path: Path, content: bytes) -> None:
        if path.suffix == ".toml":
            raise InputError("cannot be written (No space left on device)", "make room", file=path)
        write(path, content)

    monkeypatch.setattr(files, "write_atomically", full)
    assert run(monkeypatch, "new", folder) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert folder.exists() is there and not (there and any(folder.iterdir()))


@pytest.mark.slow
def test_the_command_checks_a_cause(sensor: Path, tmp_path: Path) -> None:
    for source, code, last in (
        (SENSOR, 0, "keeps the contract"),
        (SENSOR.replace("sign=-1", "sign=0"), 1, "fails symptom"),
    ):
        sensor.write_text(source)
        done = psafit("check-cause", sensor.name, "--draws", 4, "--json", "c.json", cwd=tmp_path)
        lines = done.stdout.splitlines()
        assert done.returncode == code and done.stderr == "" and lines[-1].endswith(last)
        reported = json.loads((tmp_path / "c.json").read_text())
        assert (
            reported["id"] == "sensor_compression"
            and reported["passed"] is (code == 0)
            and len(reported["checks"]) == len(lines) - 1
        )
        assert [line[:4] for line in lines[:-1]] == ["pass" if c["passed"] else "FAIL" for c in reported["checks"]]


def test_what_conditions_can_distinguish_is_said_and_drawn(
    known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    few = terms(["amplifier_lag", "hunt_crossley", "swing_drag"])
    monkeypatch.setattr("psafit.physics.TERMS", few)
    picture, file = tmp_path / "m.png", tmp_path / "m.json"
    assert run(monkeypatch, "plan", known_folder, "--isolability", "--plot", picture, "--json", file) == 0
    reported, held = capsys.readouterr().out, json.loads(file.read_text("utf-8"))
    assert held["causes"] == [t.id for t in few] and len(held["nats"]) == 3 and picture.stat().st_size > 1000
    assert "swing_drag" in held["unseen"] and "would not be seen: " in reported
    for one in held["pairs"][:3]:
        assert f"{' + '.join(one['truth'])} may be taken for {' + '.join(one['rival'])}\n" in reported
    assert ("more may be taken" in reported) is (len(held["pairs"]) > 3)
    for words, said in (
        (["--isolability", "--out", tmp_path / "x"], "writes no folder"),
        (["--isolability", "--plot", tmp_path / "x.txt"], "no kind of picture"),
        (["--plot", picture, "--out", tmp_path / "x"], "belong to --isolability"),
        ([], "no --out"),
    ):
        assert run(monkeypatch, "plan", known_folder, *words) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1 and not (tmp_path / "x").exists()


def test_a_proposed_trace_becomes_a_plan(
    diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    """Its times stand in the file, next to a column that waits; the page says its length."""
    folder, experiment = shutil.copytree(diagnosis[0], tmp_path / "run"), diagnosis[1]
    write_experiment(experiment, folder / "experiment")
    record = make_record(experiment)
    times = [float(t) for t in range(10, 130, 10)]
    trace = replace(
        record.next_experiment.proposals[0], text="a trace of the ball's velocity", frequency_hz=[1200.0],
        amplitude_v=[20.0], constants={}, observable="velocity", time_us=times,
    )  # fmt: skip
    found = replace(record.next_experiment, proposals=[trace])
    write_json(folder / "diagnosis.json", replace(record, next_experiment=found), sealed=True)
    assert run(monkeypatch, "plan", folder, "--out", tmp_path / "next") == 0
    assert "fill the column velocity_mm_s of" in capsys.readouterr().out
    new = read_plan(tmp_path / "next").groups[-1]
    file = tmp_path / "next" / new.file
    assert new.time_us is not None and new.time_us.tolist() == times and set(new.frequency_hz) == {1200.0}
    file.write_text(file.read_text("utf-8").replace(",\n", ",0.5\n"), "utf-8")
    read = read_experiment(tmp_path / "next").group(new.id)
    assert read.observable.name == "velocity" and read.reading.tolist() == [0.5] * 12
    (first, *_), *_ = proposals(found)["rows"]
    assert first.unescape() == "sine, 12 samples over 120\N{NO-BREAK SPACE}µs of the ball's velocity"


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
    assert str(file) in said and said.endswith(f"then: psafit diagnose {tmp_path / 'next'}\n")
    toml = (tmp_path / "next" / "experiment.toml").read_text("utf-8")
    for id in map(str, experiment.ids):  # as the second line says
        other = tmp_path / f"with-{id}"
        shutil.copytree(tmp_path / "next", other)
        (other / "experiment.toml").write_text(f'{toml.rstrip()}\nsession = "{id}"\n', "utf-8")
        assert str(read_plan(other).groups[-1].session) == id and 'write session = "ID" below it in' in said
    file.write_text("frequency_hz,amplitude_v,launch_range_um\n100,20,5\n20000,20,1\n", "utf-8")
    assert read_experiment(tmp_path / "next").group(new.id).rig(experiment.constants).l == 0.075
    write_json(folder / "diagnosis.json", replace(make_record(experiment), quick=True), sealed=True)
    assert run(monkeypatch, "plan", folder, "--proposal", 2, "--out", tmp_path / "other") == 0
    assert capsys.readouterr().out.endswith(f"then: psafit diagnose {tmp_path / 'other'} --quick\n")
    assert read_plan(tmp_path / "other").groups[-1].waveform == "square"
    spoilt, forged = (shutil.copytree(folder, tmp_path / name) for name in ("spoilt", "forged"))
    write_experiment(experiment.with_readings(np.concatenate([g.reading for g in experiment.groups]) + 1),
                     spoilt / "experiment")  # fmt: skip
    record = make_record(experiment)
    bad = replace(record.next_experiment.proposals[0], frequency_hz=[-1.0, 5.0])
    odd = replace(record, next_experiment=replace(record.next_experiment, proposals=[bad]))
    write_json(forged / "diagnosis.json", odd, sealed=True)
    nothing = shutil.copytree(folder, tmp_path / "nothing")
    write_json(
        nothing / "diagnosis.json", replace(make_record(experiment), next_experiment=NextExperiment()), sealed=True
    )
    capsys.readouterr()
    for words, reported in (
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
        assert reported in error and error.count("\n") == 1 and not (tmp_path / "x").exists()
    assert [of_rigs.unused_ids(ids) for ids in ((1, 2), (1, 3), ("a", 1), ("next1",))] == [3, 4, "next1", "next2"]

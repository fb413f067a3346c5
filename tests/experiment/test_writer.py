"""Experiment folders that are written."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from psafit.experiment import Conditions, read_experiment, read_plan, write_experiment

ROOT = Path(__file__).parents[2]
SWEEP = Conditions("next", "sine", "planned.csv", np.array([100.0, 2e3]), np.array([20.0, 20.0]))


def own(folder: Path) -> Path:
    """A folder as somebody writes one."""
    folder.mkdir(parents=True)
    (folder / "experiment.toml").write_text(
        "# my rig\n[constants]\nM = 0.0270 # kg\nm = 5e-3\nq = 1.2e-7\nl = 0.09\nk_s = 30000000\ng = 9.81\n\n"
        '[[group]]\nid = 1\nwaveform = "sine"\nfile = "low volts.csv"\n'
        '[[group]]\nid = 2\nwaveform = "square"\nfile = "raw/high.csv"\n[limits]\nl = [0.05, 1]\n',
        "utf-8",
    )
    (folder / "raw").mkdir()
    (folder / "low volts.csv").write_bytes(b"frequency_hz, amplitude_v ,launch_range_um\r\n100,10,5.10\r\n200,10,4\r\n")
    (folder / "raw" / "high.csv").write_text("amplitude_v,frequency_hz,launch_range_um\n100,1000,7\n")
    return folder


def tables(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*.csv")}


def test_what_is_unchanged_is_copied_as_it_is(tmp_path: Path) -> None:
    for source in (own(tmp_path / "own"), ROOT / "experiments" / "psa"):
        measured, out = read_experiment(source), tmp_path / "out" / source.name
        write_experiment(measured, out, [SWEEP])
        assert tables(out).items() >= tables(source).items() and len(tables(out)) == len(tables(source)) + 1
        text = (source / "experiment.toml").read_text("utf-8")
        assert text in (out / "experiment.toml").read_text("utf-8")
        plan = read_plan(out)
        assert [g.id for g in plan.groups] == [*measured.ids, "next"] and plan.title == measured.title
        assert (out / "planned.csv").read_text() == "frequency_hz,amplitude_v\n100,20\n2000,20\n"
        write_experiment(measured, tmp_path / "again" / source.name)
        assert read_experiment(tmp_path / "again" / source.name).fingerprint == measured.fingerprint


def test_what_has_changed_is_written_anew_under_its_names(tmp_path: Path) -> None:
    source = own(tmp_path / "own")
    measured = read_experiment(source)
    other = measured.with_readings(np.array([5.1, 4.0, 8.0]))
    write_experiment(replace(other, source="simulated"), tmp_path / "new")
    assert tables(tmp_path / "new")["low volts.csv"] == tables(source)["low volts.csv"]
    assert tables(tmp_path / "new")["raw/high.csv"] == b"frequency_hz,amplitude_v,launch_range_um\n1000,100,8\n"
    text = (tmp_path / "new" / "experiment.toml").read_text("utf-8")
    assert "k_s = 30000000\n" in text and "l = [0.05, 1]" in text and "raw/high.csv" in text
    assert read_experiment(tmp_path / "new").fingerprint == other.fingerprint
    # The folder may have changed since it was read: what was read is written.
    (source / "raw" / "high.csv").write_text("amplitude_v,frequency_hz,launch_range_um\n100,1000,9\n")
    write_experiment(measured, tmp_path / "old")
    assert read_experiment(tmp_path / "old").fingerprint == measured.fingerprint


def test_files_that_cannot_stand_side_by_side_are_renamed(tmp_path: Path) -> None:
    measured = read_experiment(own(tmp_path / "own"))
    for names in (("a.csv", "A.csv"), ("../a.csv", "b.csv"), ("/a.csv", "b.csv"), ("experiment.toml", "b.csv")):
        groups = tuple(replace(g, file=name) for g, name in zip(measured.groups, names, strict=True))
        out = tmp_path / names[0].strip("./")
        write_experiment(replace(measured, groups=groups), out)
        assert set(tables(out)) == {"group1.csv", "group2.csv"} and not (tmp_path / "a.csv").is_file()
        shutil.rmtree(out)

"""A fit that is watched."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from commands import run

import psafit
from psafit import watch
from psafit.api import Fitted
from psafit.cli import watching
from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.files import locked
from psafit.forecast import Reporter, Silent, progress_of, reporting
from psafit.inference.run_folder import load
from psafit.inference.samplers import emcee as ensembles
from psafit.inference.samplers.emcee import Settings
from psafit.records import write_json

SHORT = Settings(chunk=60, max_steps=60, tuned=20)


@pytest.fixture
def running(fitted: tuple[Path, Path], tmp_path: Path) -> Iterator[Path]:
    """A fit in the middle of its chain."""
    folder = tmp_path / "running"
    shutil.copytree(fitted[0], folder)
    (folder / "posterior.json").unlink()
    begun = time.time() - 12
    os.utime(folder / "fit.json", (begun, begun))
    os.utime(folder / "chain.h5", (begun + 6, begun + 6))
    with locked(folder):
        yield folder


def test_a_finished_run_is_reported(fitted: tuple[Path, Path], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    state = watch.look(fitted[0])
    assert (state.stage, state.steps, state.walkers) == ("gave up", 60, 64) and state.finished
    file = tmp_path / "w.json"
    assert run(monkeypatch, "watch", fitted[0], "--json", file) == 0  # does not wait for more
    line = capsys.readouterr().out
    assert line.startswith("gave up before it converged") and line.count("\n") == 1
    assert json.loads(file.read_text())["steps"] == 60


def test_one_that_gave_up_and_is_drawn_on_is_not_finished(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    folder = tmp_path / "again"
    shutil.copytree(fitted[0], folder)
    with locked(folder):
        state = watch.look(folder)
    assert (state.stage, state.steps) == ("sample", 60) and not state.finished
    assert watch.look(folder).stage == "gave up"


def test_a_running_one_is_reported(running: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
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
        chain, log_posterior = group["chain"][:], group["log_prob"][:]
        for name, values in (("chain", chain), ("log_prob", log_posterior)):
            group[name].resize(2 * len(values), axis=0)
            group[name][len(values) :] = values
        group.attrs["iteration"] = 120
    os.utime(running / "chain.h5", (later, later))
    after = watch.look(running, state)
    assert after.steps == 120 and after.seconds_per_step == pytest.approx(3 / 60)
    long_ago = replace(after, written=time.time() - 3600)
    assert not long_ago.stalled and replace(long_ago, running=None).stalled


def test_a_long_chain_is_thinned(running: Path) -> None:
    whole = watch.look(running)
    part = watch.look(running, values=60 * 64 * 6 // 3)
    assert part.steps == 60 and part.acceptance == pytest.approx(whole.acceptance)
    # Of every third step no shorter time can be seen.
    assert part.autocorrelation_time == pytest.approx(max(whole.autocorrelation_time, 3.0), rel=0.8)


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
    with locked(tmp_path):
        assert run(monkeypatch, "watch", tmp_path, "--once") == 0
        assert "searching for minima; sampling has not begun" in capsys.readouterr().out
        shutil.copy(fitted[0] / "fit.json", tmp_path)
        assert run(monkeypatch, "watch", tmp_path, "--once") == 0
        assert "sampling; no checkpoint yet; best log posterior" in capsys.readouterr().out
    assert run(monkeypatch, "watch", tmp_path, "--once") == 0
    assert capsys.readouterr().out.startswith("interrupted: nothing works in this folder now")


def test_a_diagnosis_is_watched(diagnosis: tuple[Path, Experiment], tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Under way, interrupted, and finished."""
    file = tmp_path / "w.json"
    assert run(monkeypatch, "watch", diagnosis[0], "--json", file) == 0
    line = capsys.readouterr().out
    assert line.startswith("done; verdict: ambiguous: hysteresis, or gap + slew_limit")
    assert "; models fitted on all readings 164; " in line
    state = json.loads(file.read_text())
    assert (state["stage"], state["models"]) == ("done", 164)
    folder = tmp_path / "run"
    (folder / "steps").mkdir(parents=True)
    assert run(monkeypatch, "watch", folder, "--once") == 0
    assert capsys.readouterr().out.startswith(
        "interrupted: nothing works in this folder now; repeat the psafit diagnose"
    )
    plan = {"causes": 1.0, "tests": 0.5, "significance": 3.0}
    (folder / "steps" / "short-ab.npz").write_bytes(b"")
    shutil.copy(diagnosis[0] / "diagnosis.json", folder)  # of an earlier answer
    with (
        locked(folder),
        pytest.raises(KeyboardInterrupt),
        reporting(Silent(), folder, "diagnosis", "a", plan) as watcher,
    ):
        watcher.stage("causes")
        assert run(monkeypatch, "watch", folder, "--once") == 0
        line = capsys.readouterr().out
        assert "search the causes; short fits kept 1; time spent" in line
        assert "time left" not in line
        watcher.stage("tests")
        watcher.stage("significance")
        before = {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in folder.rglob("*") if p.is_file()}
        assert run(monkeypatch, "watch", folder, "--once") == 0
        assert "repeat the search where nothing is hidden; short fits kept" in (line := capsys.readouterr().out)
        assert "time left about" in line and "in all" in line and line.count("\n") == 1
        assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in before} == before
        state = watch.look(folder)
        assert isinstance(state, watch.DiagnosisState) and state.running and state.whole_left is not None
        raise KeyboardInterrupt
    assert run(monkeypatch, "watch", folder, "--once") == 0
    assert capsys.readouterr().out.startswith("interrupted")


def test_the_whole_of_a_fit_is_shown_with_its_stage(running: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    Reporter(Silent(), running, "fit", "a", {"search": 1.0, "sample": 2.0}).stage("search")
    record = replace(progress_of(running), left=3600.0)  # type: ignore[type-var]
    write_json(running / "progress.json", record)
    assert watch.look(running).whole_left == 3600.0
    assert run(monkeypatch, "watch", running, "--once") == 0
    assert "time left of the whole about 60 min" in capsys.readouterr().out


def test_a_foreign_folder_is_one_line(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "fit.json").write_text("{")
    for folder, said in (
        (tmp_path, "is not a run folder"),
        (tmp_path / "none", "is no folder"),
        (tmp_path / "damaged", "is damaged"),
    ):
        assert run(monkeypatch, "watch", folder, "--once") == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1


def test_a_chain_that_is_long_enough_is_being_described(running: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    real = ensembles.chain_of
    monkeypatch.setattr(ensembles, "chain_of", lambda *a: replace(real(*a), converged=True))
    state = watch.look(running)
    assert state.stage == "profile" and state.seconds_left is None


def test_watching_ends_with_the_run_or_with_the_watcher(  # type: ignore[no-untyped-def]
    fitted: tuple[Path, Path], running: Path, monkeypatch, capsys
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
    reported = capsys.readouterr()
    assert reported.err == "" and reported.out.startswith("sampling")


def test_a_terminal_gets_a_table(running: Path) -> None:  # type: ignore[no-untyped-def]
    from rich.console import Console

    console = Console(width=100, record=True, force_terminal=True)
    console.print(watching.table_of(running, watch.look(running)))
    text = console.export_text()
    assert "running" in text and "R-hat" in text and "━" in text and "60 of each of 64 walkers" in text


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

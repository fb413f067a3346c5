"""What all commands share: exit codes, one line a mistake, nothing half-written."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from commands import run

from psafit.files import locked


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["fit", "EXP", "--group", "9"], "there is no group '9'; choose one of 1, 2, 3"),
        (["fit", "EXP", "--group", "1,1"], "not a list of different group ids"),
        (["fit", "EXP", "--group", "1", "--terms", "magic"], "no cause 'magic'"),
        (["fit", "EXP", "--group", "1", "--seed", "-4"], "seed"),
        (["fit", "EXP", "--group", "1", "--out", "BLOCKED"], "is a file"),
        (["fit", "EXP", "--group", "1", "--out", "UNDER"], "cannot be written"),
        (["fit", "nowhere", "--group", "1"], "no such experiment folder"),
        (["check", "nowhere"], "no such experiment folder"),
        (["validate", "nowhere"], "is not a run folder"),
        (["validate", "EXP"], "fit.json: is missing"),
        (["report", "EXP"], "neither a finished fit nor a finished diagnosis; give a folder that psafit fit or psafit"),
        (["report", "EXP", "EXP"], "give a folder that psafit fit or psafit diagnose has written"),
        (["simulate", "EXP", "--run", "EXP"], "give a folder that psafit fit or psafit diagnose has written"),
        (
            ["simulate", "EXP", "--run", "nowhere"],
            "nowhere: is not a run folder; give a folder that psafit fit or",
        ),
        (["frobnicate"], "No such command"),
        (["diagnos"], "psafit: No such command 'diagnos'. Did you mean 'diagnose'? See psafit --help"),
        (["check", "EXP", "--wrong"], "No such option"),
        (["check", "EXP", "--json", "UNDER"], "choose a writable place with --json"),
        (["fit", "EXP", "--group", "1", "--json", "UNDER"], "choose a writable place with --json"),
        (["fit", "EXP", "--group", "1", "--group", "2"], "--group is given 2 times; give it once"),
        (["check", "EXP", "--json", "a", "--json", "b"], "--json is given 2 times"),
        (["check", "EXP", "--json", ""], "the path is empty"),
        (["check", "EXP", "--json", "."], "is a folder"),
        (["check", ""], "the path is empty"),
        (["fit", "EXP", "--group", "1", "--out", ""], "the path is empty"),
        (["simulate", "EXP", "--out", ""], "the path is empty"),
        (["check", "EXP", "--json", "TOML"], "is a file of the input"),
        (["simulate", "EXP", "--out", "TOML"], "is a file of the input"),
        (["fit", "EXP", "--group", "1", "--out", "WITHIN"], "lies in the input"),
        (["fit", "EXP", "--group", "1", "--out", "AROUND"], "the input in it"),
        (["fit", "EXP", "--group", "1", "--out", "run", "--json", "run/fit.json"], "is a file of the run itself"),
        (["diagnose", "EXP", "--group", "1", "--out", "d", "--json", "d/diagnosis.html"], "of the run itself"),
        (["diagnose", "EXP", "--group", "1", "--out", "d", "--json", "d/predictions-strict.csv"], "of the run itself"),
        (["reproduce", "EXP", "--out", "r", "--json", "r/reproduction.json"], "of the run itself"),
        (["challenge", "make", "--seed", "1", "--out", "c", "--json", "c/answer.json"], "of the run itself"),
        (["challenge", "run", "--seed", "1", "--out", "c", "--json", "c/campaign.json"], "of the run itself"),
        (["diagnose", "EXP", "--out", "d", "--json", "d/experiment/experiment.toml"], "of the run itself"),
        (["challenge", "make", "--seed", "1", "--out", "c", "--json", "c/experiment/x.csv"], "of the run itself"),
        (
            ["challenge", "run", "--seed", "1", "--out", "c", "--experiment", "EXP", "--scheduler", "foo://bar"],
            "no Dask scheduler answers",
        ),
        (["diagnose", "EXP", "--out", "d", "--scheduler", "foo://bar"], "no Dask scheduler answers at foo://bar"),
        (["diagnose", "EXP", "--out", "d", "--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "both given"),
        (["simulate", "EXP", "--set", "k_c=1_0e5"], "not NAME=VALUE"),
        (["fit", "EXP"], "name one or more with --group: 1, 2, 3"),
        (["watch", "EXP", "--every", "nan"], "is no time"),
        (["watch", "EXP", "--every", "inf"], "is not in the range"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(  # type: ignore[no-untyped-def]
    arguments: list[str], words: str, known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("x")
    places = {"EXP": known_folder, "BLOCKED": blocked, "UNDER": blocked / "below"}
    places |= {"TOML": known_folder / "experiment.toml", "WITHIN": known_folder / "run", "AROUND": known_folder.parent}
    before = {p.name: p.read_bytes() for p in known_folder.iterdir()}
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *(places.get(a, a) for a in arguments)) == 2
    said = capsys.readouterr()
    assert words in said.err and said.err.count("\n") == 1 and "Traceback" not in said.err
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    assert {p.name: p.read_bytes() for p in known_folder.iterdir()} == before


def test_a_link_stays_and_a_device_is_not_replaced(known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "link").symlink_to(tmp_path / "real.json")
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    for name in ("link", "pipe"):
        assert run(monkeypatch, "check", known_folder, "--quiet", "--json", tmp_path / name) == 0
    assert json.loads(os.read(reader, 1 << 16))["n_points"] == 62
    os.close(reader)
    assert (tmp_path / "link").is_symlink() and json.loads((tmp_path / "real.json").read_text())["n_points"] == 62
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link", "pipe", "real.json"]


@pytest.mark.slow
def test_a_closed_output_is_no_failure(known_folder: Path, tmp_path: Path) -> None:
    """Nor is one that knows fewer letters than a title has."""
    psafit = [sys.executable, "-m", "psafit"]
    command = " ".join(map(shlex.quote, map(str, [*psafit, "check", known_folder])))
    for closed, code in ((">&-", 0), (">&- 2>&-", 0)):
        done = subprocess.run(
            f"{command} {closed}", shell=True, capture_output=True, text=True, timeout=300, check=False
        )
        assert (done.returncode, done.stderr) == (code, ""), closed
    odd = tmp_path / "odd"
    shutil.copytree(known_folder, odd)
    toml = (odd / "experiment.toml").read_text("utf-8")
    (odd / "experiment.toml").write_text(re.sub("title = .*", 'title = "a → b"', toml), "utf-8")
    environment = os.environ | {"PYTHONIOENCODING": "latin-1", "MPLBACKEND": "none such"}
    words = [*psafit, "simulate", odd, "--plot", tmp_path / "x\x1b.png"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert done.returncode == 0 and r"x\x1b.png" in done.stdout and "\x1b" not in done.stdout
    words = [*psafit, "check", odd]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert done.returncode == 0 and r"a \u2192 b" in done.stdout
    environment = os.environ | {"NUMBA_NUM_THREADS": "0"}
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "NUMBA_NUM_THREADS" in done.stderr


def test_a_name_that_is_no_utf_8(known_folder: Path, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    odd = tmp_path / os.fsdecode(b"rig-\xff")
    shutil.copytree(known_folder, odd)
    toml = odd / "experiment.toml"
    toml.write_text("\n".join(toml.read_text("utf-8").splitlines()[1:]), "utf-8")  # no title: the folder's name is it
    assert run(monkeypatch, "check", odd, "--quiet", "--json", tmp_path / "c.json") == 0
    assert json.loads((tmp_path / "c.json").read_text("utf-8"))["folder"].endswith("rig-\N{REPLACEMENT CHARACTER}")


def test_too_little_memory_is_one_line(known_folder: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    def greedy(*args: object) -> None:
        raise MemoryError

    monkeypatch.setattr("psafit.prior_check.read", greedy)
    assert run(monkeypatch, "check", known_folder) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "memory" in said and "Traceback" not in said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk_is_one_line(known_folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-m", "psafit", "check", known_folder], stdout=full,
                              stderr=subprocess.PIPE, text=True, timeout=100, check=False)  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (2, 1) and "No space left" in done.stderr


def test_interrupt_is_one_line(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.inference import run as running

    def interrupted(*a: object, **k: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "sample", interrupted)
    assert run(monkeypatch, "fit", known_folder, "--group", "1", "--out", tmp_path / "o") == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "repeat the same command, which goes on" in said[1]  # below the stage's line


def test_help_lists_every_command(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("COLUMNS", "80")
    assert run(monkeypatch, "--help") == 0
    text = capsys.readouterr().out
    for name in ("check", "fit", "report", "reproduce", "simulate", "terms", "validate", "watch"):
        assert name in text
    assert "..." not in text.partition("Commands:")[2]  # every line is whole
    assert run(monkeypatch, "challenge", "--help") == 0
    assert "..." not in capsys.readouterr().out.partition("Commands:")[2]
    for name in ("check", "fit", "report", "reproduce", "simulate", "terms", "validate", "watch"):
        assert run(monkeypatch, name, "--help") == 0
        assert "PATH  Write" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "words",
    [
        ["fit", "EXP", "--group", "1", "--out", "OUT"],
        ["diagnose", "EXP", "--group", "1", "--out", "OUT"],
        ["challenge", "run", "--seed", "1", "--experiment", "EXP", "--out", "OUT"],
    ],
)
def test_a_folder_in_which_another_process_works_is_left_alone(
    words: list[str],
    known_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    places = {"EXP": known_folder, "OUT": out}
    with locked(out):
        assert run(monkeypatch, *(places.get(word, word) for word in words), "--quiet") == 2
        assert not list(out.iterdir())
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"{out}: another psafit works in this folder; wait until it has ended" in said


@pytest.mark.parametrize(("word", "said"), [("\u202ekcab", r"\u202ekcab"), ("\x1b[2J", r"\x1b[2J"), ("x" * 5000, "…")])
def test_a_hostile_word_does_not_steer_the_terminal(word: str, said: str, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    assert run(monkeypatch, "validate", "nowhere", word) == 2
    error = capsys.readouterr().err
    assert said in error and error.rstrip("\n").isprintable() and len(error) < 500

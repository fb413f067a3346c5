"""The command line: exit codes, one line a mistake, nothing half-written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from psafit import cli


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["psafit", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def test_check(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    assert run(monkeypatch, "check", known_folder, "--json", tmp_path / "c.json") == 0
    assert "group 2: square, 20 readings" in capsys.readouterr().out
    assert json.loads((tmp_path / "c.json").read_text())["n_points"] == 62
    assert run(monkeypatch, "check", known_folder, "--quiet") == 0
    assert capsys.readouterr().out == ""


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
    for bad, words in (
        (values[:4], "no value for c_c"),
        ([*values, "--set", "c_x=1"], "no parameter c_x"),
        ([*values[:5], "c_c=-3"], "impossible"),
        ([*values[:5], "c_c=nan"], "impossible"),
        ([*values[:5], "c_c"], "not NAME=VALUE"),
    ):
        assert run(monkeypatch, "simulate", known_folder, *bad) == 2
        error = capsys.readouterr().err
        assert words in error and error.count("\n") == 1


@pytest.fixture(scope="module")
def fitted(known_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cli") / "run"
    done = subprocess.run(
        [sys.executable, "-m", "psafit", "fit", known_folder, "--group", "1", "--out", out, "--starts", "6"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "minima from 6 starts" in done.stdout and "group 2 (holdout): log_rmse" in done.stdout
    assert "sample the posterior" in done.stderr
    return out


def test_fit_writes_the_run_folder(fitted: Path) -> None:
    assert {p.name for p in fitted.iterdir()} == {
        "fit.json", "posterior.nc", "posterior.json", "validation.json", "predictions.csv", "report.html", "chain.h5",
        "experiment",
    }  # fmt: skip
    assert json.loads((fitted / "fit.json").read_text())["schema"] == 1


def test_validate_and_report_again(fitted: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    before = (fitted / "validation.json").read_bytes()
    assert run(monkeypatch, "validate", fitted, "--json", tmp_path / "v.json") == 0
    assert "mean log_rmse over held-out groups" in capsys.readouterr().out
    assert (fitted / "validation.json").read_bytes() == before == (tmp_path / "v.json").read_bytes()
    (fitted / "report.html").unlink()
    assert run(monkeypatch, "report", fitted, "--quiet") == 0
    assert (fitted / "report.html").exists()


def test_terms(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    assert run(monkeypatch, "terms", "--json", tmp_path / "t.json") == 0
    assert isinstance(json.loads((tmp_path / "t.json").read_text()), list)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["fit", "EXP"], "Missing option '--group'"),
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
        (["report", "EXP"], "fit.json: is missing"),
        (["frobnicate"], "No such command"),
        (["check", "EXP", "--wrong"], "No such option"),
        (["check", "EXP", "--json", "UNDER"], "cannot be written"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(  # type: ignore[no-untyped-def]
    arguments: list[str], words: str, known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("x")
    places = {"EXP": known_folder, "BLOCKED": blocked, "UNDER": blocked / "below"}
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, *(places.get(a, a) for a in arguments)) == 2
    said = capsys.readouterr()
    assert words in said.err and said.err.count("\n") == 1 and "Traceback" not in said.err
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_interrupt_is_one_line(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.inference import run as running

    def interrupted(*a: object, **k: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "optimise", interrupted)
    assert run(monkeypatch, "fit", known_folder, "--group", "1", "--out", tmp_path / "o") == 2
    assert "repeat the same command to go on" in capsys.readouterr().err


def test_help_lists_every_command(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    assert run(monkeypatch, "--help") == 0
    text = capsys.readouterr().out
    for name in ("check", "fit", "report", "reproduce", "simulate", "terms", "validate"):
        assert name in text
        assert run(monkeypatch, name, "--help") == 0

"""`psafit check`, `fit`, `validate` and `reproduce`."""

from __future__ import annotations

import functools
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from commands import run
from diagnoses_by_hand import make_experiment, make_record

from psafit import cli, numerics
from psafit.experiment import read_experiment
from psafit.inference.samplers.emcee import Settings
from psafit.report.reproduction import claims_table
from psafit.reproduce import Reproduction

PSA = Path(__file__).parents[2] / "experiments" / "psa"


def test_check(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    assert run(monkeypatch, "check", known_folder, "--json", tmp_path / "c.json") == 0
    printed = capsys.readouterr().out
    assert "group 2: square, 20 readings" in printed and " V (-20 to 20 V), launch range" in printed
    assert json.loads((tmp_path / "c.json").read_text())["n_points"] == 62
    assert run(monkeypatch, "check", known_folder, "--quiet") == 0
    assert capsys.readouterr().out == ""
    lone = tmp_path / "lone"
    lone.mkdir()
    definition = (known_folder / "experiment.toml").read_text()
    (lone / "experiment.toml").write_text("[[group]]".join(definition.split("[[group]]")[:2]))
    data = read_experiment(known_folder).groups[0].file
    (lone / data).write_text("\n".join((known_folder / data).read_text().splitlines()[:2]) + "\n")
    assert run(monkeypatch, "check", lone) == 0
    assert ": 1 group, 1 reading; fewer than 60 show strong effects only" in capsys.readouterr().out
    known = '[prior.{}]\nmedian = 4e5\nfactor = 2\nsource = "Hertz"\n'
    (lone / "experiment.toml").write_text(definition + known.format("k_c"))
    for group in read_experiment(known_folder).groups:
        (lone / group.file).write_text((known_folder / group.file).read_text())
    assert run(monkeypatch, "check", lone) == 0
    assert "  prior of k_c (N/m): log-normal, median 400000, factor 2 for one sd (Hertz)\n" in capsys.readouterr().out
    rig = "[rig]\nsource_resistance = 50\ncapacity = 1.5e-6\n"
    (lone / "experiment.toml").write_text(definition + rig)
    assert run(monkeypatch, "check", lone) == 0
    printed = capsys.readouterr().out
    assert "  prior of amplifier_lag_tau (s), from [rig]: normal, mean 7.5e-05, sd 1.8" in printed
    assert "5 % in a Cauchy tail 3 times as wide; at work: 0.95 (50 ohm into 1.5e-06 F" in printed
    (lone / "experiment.toml").write_text(definition + known.format("k_c"))
    assert run(monkeypatch, "simulate", lone, "--json", tmp_path / "s.json", "--quiet") == 0
    assert json.loads((tmp_path / "s.json").read_text())["parameters"]["k_c"] == pytest.approx(4e5)
    (lone / "experiment.toml").write_text(definition + known.format('"k_\\u202e"'))
    assert run(monkeypatch, "check", lone) == 2
    said = capsys.readouterr().err
    assert "there is no parameter 'k_" in said and said.count("\n") == 1 and "\u202e" not in said
    (lone / "experiment.toml").write_text(definition.replace('"square"', '"unipolar_square"\nbias_v = 1'))
    assert run(monkeypatch, "check", lone) == 0
    assert re.search(r"V \(0 to \d+ V\), launch range", capsys.readouterr().out)


@pytest.mark.slow
def test_what_has_not_converged_ends_with_one(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """A chain that is too short, and a simulation whose error is more than would do; reported in a line each."""
    short = Settings(chunk=40, max_steps=40, tuned=15)
    monkeypatch.setattr(Settings, "of", classmethod(lambda cls, problem: short))
    words = ["fit", known_folder, "--group", 1, "--starts", 2, "--out", tmp_path / "r", "--no-report"]
    assert run(monkeypatch, *words) == 1
    said = capsys.readouterr().out
    assert "repeat the command" in said and "simulation" not in said
    strict = functools.partial(numerics.refine, required=0.0, of_scatter=0.0)
    monkeypatch.setattr(numerics, "refine", strict)
    assert run(monkeypatch, *words) == 1 and "the simulation has not converged" in capsys.readouterr().out


def test_fit_writes_the_run_folder(fitted: Path) -> None:
    assert {p.name for p in fitted.iterdir()} == {
        "fit.json", "posterior.nc", "posterior.json", "numerics.json", "validation.json", "predictions.csv",
        "report.html", "chain.h5", "experiment", "importance",
    }  # fmt: skip
    assert json.loads((fitted / "fit.json").read_text())["schema"] == 1


@pytest.mark.slow
def test_validate_and_report_again(fitted: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    before = (fitted / "validation.json").read_bytes()
    assert run(monkeypatch, "validate", fitted, "--json", tmp_path / "v.json") == 0
    assert "mean log_rmse over held-out groups" in capsys.readouterr().out
    assert (fitted / "validation.json").read_bytes() == before == (tmp_path / "v.json").read_bytes()
    page = (fitted / "report.html").read_bytes()
    (fitted / "report.html").unlink()
    assert run(monkeypatch, "report", fitted, "--quiet") == 0
    assert (fitted / "report.html").read_bytes() == page
    command = f"psafit fit known --group 1 --seed 1 --starts 6 --out {fitted.name}"  # the folders were absolute
    assert json.loads((fitted / "fit.json").read_text())["command"] == command
    assert command in page.decode()


def test_the_readme_s_python_runs_and_prints(fitted: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit import api
    from psafit.inference.run_folder import load

    text = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
    monkeypatch.chdir(Path(__file__).parents[2])
    monkeypatch.setattr(api, "fit", lambda *a, **k: load(fitted))
    monkeypatch.setattr(api, "diagnose", lambda *a, **k: make_record(make_experiment()))
    exec(text.split("```python\n")[1].split("```")[0], {})
    said = capsys.readouterr().out
    assert "k_c " in said and "holdout" in said and "verdict: ambiguous: hysteresis" in said


@pytest.mark.slow
@pytest.mark.parametrize("room", [20_000, 250_000])
def test_a_disk_that_fills_up_during_a_fit_is_one_line_and_loses_nothing(
    room: int, known_folder: Path, tmp_path: Path
) -> None:
    """Room for nothing, and for the search's record but not for a chain; HDF5 alone would end the process."""
    import resource

    command = [sys.executable, "-m", "psafit", "fit", str(known_folder), "--group", "1", "--starts", "4"]
    done = subprocess.run(
        [*command, "--quiet", "--no-report", "--out", "run"], cwd=tmp_path, stderr=subprocess.PIPE, text=True,
        check=False, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "cannot be written" in done.stderr
    assert not [p for p in (tmp_path / "run").rglob("*") if p.suffix == ".tmp"]
    assert json.loads((tmp_path / "run" / "fit.json").read_text("utf-8"))["n_starts"] == 4


@pytest.mark.slow
def test_the_command_writes_what_was_recomputed(result: Reproduction, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Recomputed above: here only what the command makes of it."""
    asked = []
    monkeypatch.setattr("psafit.reproduce.reproduce", lambda folder: asked.append(folder) or result)
    monkeypatch.setattr(sys, "argv", ["psafit", "reproduce", str(PSA), "--out", str(tmp_path / "r")])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    assert not caught.value.code and asked == [PSA]
    record = json.loads((tmp_path / "r" / "reproduction.json").read_text("utf-8"))
    assert [c["id"] for c in record["claims"]] == [c.id for c in result.claims]
    assert [c["verdict"] for c in record["claims"]] == [c.verdict for c in result.claims]
    printed = capsys.readouterr().out
    assert claims_table(result) in printed and "reproduction.html" in printed
    assert (tmp_path / "r" / "reproduction.html").exists()

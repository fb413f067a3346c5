"""The command line: exit codes, one line a mistake, nothing half-written."""

from __future__ import annotations

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from test_report_diagnosis import make_experiment, make_record

import psafit.diagnose
from psafit import cli, progress
from psafit.errors import InputError
from psafit.experiment import read_experiment
from psafit.files import sole
from psafit.inference.emcee_adaptor import Settings


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
    lone = tmp_path / "lone"
    lone.mkdir()
    definition = (known_folder / "experiment.toml").read_text()
    (lone / "experiment.toml").write_text("[[group]]".join(definition.split("[[group]]")[:2]))
    data = read_experiment(known_folder).groups[0].file
    (lone / data).write_text("\n".join((known_folder / data).read_text().splitlines()[:2]) + "\n")
    assert run(monkeypatch, "check", lone) == 0
    assert ": 1 group, 1 reading\n" in capsys.readouterr().out
    known = '[prior.{}]\nmedian = 4e5\nfactor = 2\nsource = "Hertz"\n'
    (lone / "experiment.toml").write_text(definition + known.format("k_c"))
    for group in read_experiment(known_folder).groups:
        (lone / group.file).write_text((known_folder / group.file).read_text())
    assert run(monkeypatch, "check", lone) == 0
    assert "  prior of k_c: log-normal, median 400000, factor 2 for one sd (Hertz)\n" in capsys.readouterr().out
    assert run(monkeypatch, "simulate", lone, "--json", tmp_path / "s.json", "--quiet") == 0
    assert json.loads((tmp_path / "s.json").read_text())["parameters"]["k_c"] == pytest.approx(4e5)
    (lone / "experiment.toml").write_text(definition + known.format('"k_\\u202e"'))
    assert run(monkeypatch, "check", lone) == 2
    said = capsys.readouterr().err
    assert "there is no parameter 'k_" in said and said.count("\n") == 1 and "\u202e" not in said


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
    told = json.loads((tmp_path / "s.json").read_text())
    medians = {p["name"]: p["median"] for p in json.loads((fitted / "posterior.json").read_text())["parameters"]}
    assert told["parameters"] == {name: medians[name] for name in told["parameters"]}
    assert sorted(told["parameters"]) == ["c_c", "c_s", "k_c"]
    here = [float(row.split(",")[-1]) for row in (tmp_path / "s.csv").read_text().splitlines()[1:]]
    with (fitted / "predictions.csv").open(newline="") as file:
        there = [float(row["predicted_um"]) for row in csv.DictReader(file)]
    assert here == pytest.approx(there, rel=0.05, abs=0.05)
    assert run(monkeypatch, *words, "--quiet", "--set", "k_c=1e6") == 0
    assert json.loads((tmp_path / "s.json").read_text())["parameters"] == told["parameters"] | {"k_c": 1e6}


@pytest.mark.slow
def test_a_campaign_by_command(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Run, taken up again without a second diagnosis, scored, shown."""
    out = tmp_path / "c"
    words = ["challenge", "run", "--seed", 5, "--experiment", known_folder, "--terms", "start_phase", "--each", 1]
    words += ["--nothing", 1, "--pairs", 0, "--drawn", 0, "--jobs", 1, "--out", out]
    assert run(monkeypatch, *words, "--json", tmp_path / "run.json") == 0
    told = capsys.readouterr()
    n = json.loads((tmp_path / "run.json").read_text())["n"]
    assert n >= 2 and f"{n} of {n} data sets" in told.err and "results: " in told.out
    kept = {file: file.read_bytes() for file in (out / "results").iterdir()}
    assert len(kept) == n
    monkeypatch.setattr("psafit.challenge.campaign.examine", None)
    assert run(monkeypatch, *words) == 0
    assert {file: file.read_bytes() for file in (out / "results").iterdir()} == kept
    capsys.readouterr()
    assert run(monkeypatch, "challenge", "score", out, "--json", tmp_path / "score.json") in (0, 1)
    assert "page: " in capsys.readouterr().out
    score = json.loads((tmp_path / "score.json").read_text())
    assert len(score["rows"]) == n and {row["truth"] for row in score["rows"]} <= {"nothing", "start_phase"}
    assert (out / "score.html").stat().st_size > 10_000


@pytest.fixture(scope="module")
def fitted(known_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("cli") / "run"
    done = subprocess.run(
        [sys.executable, "-m", "psafit", "fit", known_folder, "--group", "1", "--out", out, "--starts", "6"],
        capture_output=True, text=True, timeout=300, check=False, env=os.environ | {"XDG_CACHE_HOME": str(out.parent)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert " ended at the best, the others" in done.stdout and "group 2 (holdout): log_rmse" in done.stdout
    assert "sample the posterior" in done.stderr
    assert "Warning" not in done.stderr  # the first import of ArviZ has something to announce
    return out


def test_what_has_not_converged_ends_with_one(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """A chain that is too short, and a simulation whose error is more than would do; told in a line each."""
    short = Settings(n_walkers=16, chunk=40, max_steps=40)
    monkeypatch.setattr(Settings, "of", classmethod(lambda cls, problem: short))
    words = ["fit", known_folder, "--group", 1, "--starts", 2, "--out", tmp_path / "r", "--no-report"]
    assert run(monkeypatch, *words) == 1
    said = capsys.readouterr().out
    assert "repeat the command" in said and "simulation" not in said
    monkeypatch.setattr("psafit.numerics.REQUIRED", 0.0)
    monkeypatch.setattr("psafit.numerics._OF_SCATTER", 0.0)
    assert run(monkeypatch, *words) == 1 and "the simulation has not converged" in capsys.readouterr().out


def test_fit_writes_the_run_folder(fitted: Path) -> None:
    assert {p.name for p in fitted.iterdir()} == {
        "fit.json", "posterior.nc", "posterior.json", "numerics.json", "validation.json", "predictions.csv",
        "report.html", "chain.h5", "experiment",
    }  # fmt: skip
    assert json.loads((fitted / "fit.json").read_text())["schema"] == 1


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
    from psafit.inference.run import load

    text = (Path(__file__).parents[1] / "README.md").read_text("utf-8")
    monkeypatch.chdir(Path(__file__).parents[1])
    monkeypatch.setattr(api, "fit", lambda *a, **k: load(fitted))
    monkeypatch.setattr(api, "diagnose", lambda *a, **k: make_record(make_experiment()))
    exec(text.split("```python\n")[1].split("```")[0], {})
    said = capsys.readouterr().out
    assert "k_c " in said and "holdout" in said and "ambiguous (hysteresis)" in said


def test_terms(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.physics import TERMS

    assert run(monkeypatch, "terms", "--json", tmp_path / "t.json") == 0
    said = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in said) <= 120 and any("sigma_abs (um)" in line for line in said)
    assert [line.split()[0] for line in said if line.startswith("  ") and line[2] != " "] == [t.id for t in TERMS]
    listed = json.loads((tmp_path / "t.json").read_text())
    assert [entry["id"] for entry in listed] == [t.id for t in TERMS]
    by_id = {entry["id"]: entry for entry in listed}
    assert by_id["hysteresis"]["path"] == "stepper" and by_id["modal_mass"]["path"] == "closed form"
    assert [p["neutral"] for p in by_id["hysteresis"]["parameters"]] == [0.0, None]
    assert by_id["gap"]["parameters"][0]["unit"] == "m" and by_id["gap"]["parameters"][0]["bounds"] == [0.0, 2e-5]
    assert by_id["start_phase"]["symptom"]["waveforms"] == ["sine"] and by_id["start_phase"]["latent"] is None
    assert by_id["reading_gain"]["latent"]["symbol"] == "z"
    for entry in listed:
        assert all(entry[key] for key in ("title", "slot", "equation", "description", "reference", "checks"))
        assert all(p["prior"] and p["source"] and p["description"] for p in entry["parameters"])


def test_one_cause_in_full(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.physics import TERMS

    for t in TERMS:
        assert run(monkeypatch, "terms", t.id) == 0
        said = " ".join(capsys.readouterr().out.split())
        wanted = [t.title, t.symptom.text, t.reference, *(c.working for c in t.checks)]
        wanted += [text for p in t.parameters for text in (p.name, p.description, p.source, p.prior.describe())]
        assert all(" ".join(text.split()) in said for text in wanted)
        assert ":math:" not in said
    assert run(monkeypatch, "terms", "gap", "--quiet", "--json", tmp_path / "t.json") == 0
    assert capsys.readouterr().out == ""
    assert [entry["id"] for entry in json.loads((tmp_path / "t.json").read_text())] == ["gap"]
    assert run(monkeypatch, "terms", "gap_width") == 0 and capsys.readouterr().out.startswith("gap: ")
    assert run(monkeypatch, "terms", "k_c", "--json", tmp_path / "p.json") == 0
    assert "k_c (N/m): contact stiffness" in capsys.readouterr().out
    assert [entry["name"] for entry in json.loads((tmp_path / "p.json").read_text())] == ["k_c"]
    assert run(monkeypatch, "terms", "hertz") == 2
    assert "did you mean hertz_exponent" in capsys.readouterr().err


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

    monkeypatch.setattr("psafit.inference.scale.read", greedy)
    assert run(monkeypatch, "check", known_folder) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "memory" in said and "Traceback" not in said


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a full device")
def test_a_full_disk_is_one_line(known_folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-m", "psafit", "check", known_folder], stdout=full,
                              stderr=subprocess.PIPE, text=True, timeout=100, check=False)  # fmt: skip
    assert (done.returncode, done.stderr.count("\n")) == (2, 1) and "No space left" in done.stderr


def test_progress_in_a_log_says_what_is_awaited(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    clock = iter([0.0, 11.0, 12.0, 30.0, 31.0, 42.0, 600.0, 620.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    lines = progress._Lines()
    lines.update(500, None, "step 500 of at most 40000, R-hat 1.030 (goal 1.01)")
    lines.update(750, None, "too soon")
    lines.stage("profile")
    lines.update(3, 48, "profiles")
    lines.update(8, 48, "profiles")
    lines.update(0, 4, "of a second count")
    lines.update(1, 4, "of a second count")
    assert capsys.readouterr().err.splitlines() == [
        "[ 11.0 s]   step 500 of at most 40000, R-hat 1.030 (goal 1.01)", "[ 30.0 s] profile the likelihood",
        "[ 42.0 s]   8 of 48 profiles; about 88 s left of this", "[600.0 s]   0 of 4 of a second count",
        "[620.0 s]   1 of 4 of a second count; about 60 s left of this",
    ]  # fmt: skip


def test_interrupt_is_one_line(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    from psafit.inference import run as running

    def interrupted(*a: object, **k: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "optimise", interrupted)
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


def test_a_diagnosis_without_its_page_was_interrupted(known_folder, tmp_path, monkeypatch):  # type: ignore[no-untyped-def]
    """Chains are drawn on by the command after a finished one, and it is finished when its page is there."""
    told = []

    def examine(*args, draw_on, **options):  # type: ignore[no-untyped-def]
        told.append(draw_on)
        raise InputError("asked", "enough")

    monkeypatch.setattr(psafit.diagnose, "diagnose", examine)
    out = tmp_path / "found"
    for options in ([], ["--no-report"]):
        assert run(monkeypatch, "diagnose", known_folder, "--out", out, *options) == 2
    out.mkdir(exist_ok=True)
    (out / "diagnosis.html").touch()
    assert run(monkeypatch, "diagnose", known_folder, "--out", out) == 2
    assert told == [False, True, True]


@pytest.mark.slow
def test_diagnose(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    out = tmp_path / "found"
    for bad, words in (
        (["--group", "9"], "9"),
        (["--group", "1,1"], "not a list of different group ids"),
        (["--group", "1", "--json", out / "diagnosis.json"], "file of the run itself"),
    ):
        assert run(monkeypatch, "diagnose", known_folder, *bad, "--out", out) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert told.err.count("\n") == 1
        assert not out.exists()
    copy = tmp_path / "copy.json"
    assert run(monkeypatch, "diagnose", known_folder, "--group", "1", "--quick", "--out", out, "--json", copy) == 0
    told = capsys.readouterr().out
    assert "verdict: adequate" in told
    own = json.loads((out / "diagnosis.json").read_text())
    assert own.pop("sha256") and json.loads(copy.read_text()) == own
    assert (out / "diagnosis.html").exists()
    # Once more: the fits are kept.
    assert run(monkeypatch, "diagnose", known_folder, "--group", "1", "--quick", "--out", out, "--quiet") == 0
    assert capsys.readouterr().out == ""


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
    with sole(out):
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

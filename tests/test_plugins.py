"""Causes of one's own: the registry, processes, and what a run remembers."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import psafit, run
from rigs import measure
from sensors import CUBIC, SENSOR

from psafit import physics, plugins
from psafit.errors import InputError
from psafit.experiment import Experiment, read_experiment, write_experiment
from psafit.inference.run import fit
from psafit.inference.run_folder import load
from psafit.physics import TERMS, plugin
from psafit.physics.term import Term
from psafit.simulate import Design, simulate
from psafit.simulate.sensitivity import REFERENCE

ROOT = Path(__file__).parents[1]


def test_the_command_knows_the_plugin(sensor: Path, tmp_path: Path) -> None:
    listed = psafit("terms", "--plugin", "sensor_compression.py", "--json", "t.json", cwd=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "sensor compresses (plugin)" in listed.stdout
    entries = {e["id"]: e for e in json.loads((tmp_path / "t.json").read_text())}
    assert len(entries) == len(TERMS) + 1 and entries["gap"]["plugin"] == ""
    assert entries["sensor_compression"]["plugin"] == plugin.read(sensor).plugin
    slots = [e["slot"] for e in entries.values()]
    assert [slot for slot, _ in itertools.groupby(slots)] == ["drive", "stack", "contact", "flight", "reading"]


@pytest.mark.slow
def test_the_environment_names_plugins_too(sensor: Path, tmp_path: Path) -> None:
    cubic = tmp_path / "cubic.py"
    cubic.write_text(CUBIC)
    folder = ROOT / "experiments" / "psa"
    theta = [
        word for name, x in zip(("k_c", "c_s", "c_c"), REFERENCE, strict=True) for word in ("--set", f"{name}={x}")
    ]
    done = psafit(
        "simulate", folder, *theta, "--terms", "cubic,sensor_compression", "--set", "cubic_b=0.2", "--set",
        "sensor_kappa=900", "--json", "s.json", "--quiet", "--plugin", cubic, cwd=tmp_path,
        PSAFIT_PLUGINS=os.pathsep.join(["", "sensor_compression.py", ""]),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    psa = read_experiment(folder)
    chosen = [plugin.read(cubic), plugin.read(sensor)]
    expected = simulate(Design.of(psa.constants, psa.groups), [*REFERENCE, 0.2, 900], chosen).launch_range[0] * 1e6
    np.testing.assert_allclose(json.loads((tmp_path / "s.json").read_text())["predicted_um"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["terms", "--plugin", "no.py"], "no.py: no such plugin file"),
        (["terms", "--plugin", "sensor_compression.py", "--plugin", "other.py"], "is that of the plugin"),
        (["terms", "--plugin", "a:b.py"], "parts it from the next"),
        (["terms", "--plugin", "early.py"], "early.py:1: cannot be loaded (ImportError"),
        (["fit", "EXP", "--group", "1", "--plugin", "bad.py", "--out", "o"], "bad.py:1: cannot be loaded"),
        (["diagnose", "EXP", "--group", "1", "--plugin", "bad.py", "--out", "o"], "bad.py:1: cannot be loaded"),
        (["check-cause", "bad.py", "--json", "o"], "bad.py:1: cannot be loaded"),
        (["check-cause", "sensor_compression.py", "--plugin", "bad.py", "--json", "o"], "bad.py:1: cannot be loaded"),
        (["check-cause", "sensor_compression.py", "--json", "sensor_compression.py"], "is a file of the input"),
        (["terms", "--plugin", "sensor_compression.py", "--json", "sensor_compression.py"], "is a file of the input"),
        (["check-cause", "sensor_compression.py", "--experiment", "no"], "no such experiment folder"),
        (["fit", "EXP", "--group", "1", "--plugin", "wild.py", "--terms", "cubic", "--out", "o"],
         "wild.py:18: law cannot be compiled (TypingError"),
        (["simulate", "EXP", "--plugin", "raises.py", "--terms", "sensor_compression", "--set", "k_c=1e5", "--set",
          "c_s=1e4", "--set", "c_c=60", "--set", "sensor_kappa=9"], "raises.py:20: the cause fails (OSError: boo)"),
    ],
)  # fmt: skip
def test_a_bad_plugin_is_one_line_and_exit_2(arguments: list[str], words: str, sensor: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.py").write_text("import nosuchmodule\n")
    (tmp_path / "early.py").write_text("from psafit.physics import TERMS\n")
    (tmp_path / "other.py").write_text(SENSOR + "# another\n")
    (tmp_path / "wild.py").write_text(CUBIC.replace("    size = d / 1e-6\n", "    size = open(d) / 1e-6\n", 1))
    start = "    return L / (1.0 + p[:, :1] * L)"
    (tmp_path / "raises.py").write_text(
        SENSOR.replace(start, f"    if L.any():\n        raise OSError('boo')\n{start}")
    )
    before = {p.name for p in tmp_path.iterdir()}
    done = psafit(*[ROOT / "experiments" / "psa" if a == "EXP" else a for a in arguments], cwd=tmp_path)
    errors = [line for line in done.stderr.splitlines() if not line.startswith("[")]  # progress
    assert done.returncode == 2 and done.stdout == ""
    assert len(errors) == 1 and words in errors[0] and "Traceback" not in done.stderr
    assert sensor.read_text() == SENSOR
    assert {p.name for p in tmp_path.iterdir()} - before <= {"__pycache__", *(["o"] if "wild.py" in arguments else [])}


def test_a_plugin_that_comes_too_late_is_reported(sensor: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """In a process that has read the registry, as this one, it would not take part."""
    monkeypatch.setenv(plugins.VARIABLE, "")
    assert run(monkeypatch, "terms", "--plugin", sensor) == 2
    said = capsys.readouterr().err
    assert "has read its causes before" in said and said.count("\n") == 1
    assert plugins.files() == ()
    plugins.add([])


WORKER = """
import sys
import joblib
from psafit import plugins

def ask(function):
    return function.__module__, "psafit.simulate" in sys.modules, plugins.files()

if __name__ == "__main__":
    plugins.add(["sensor_compression.py"])
    from psafit.physics import term
    function = term("sensor_compression").reading
    reported = joblib.Parallel(2)(joblib.delayed(ask)(function) for _ in range(2))
    print(reported == 2 * [(function.__module__, False, plugins.files())])
"""


@pytest.mark.slow
def test_worker_processes_know_the_plugin(sensor: Path, tmp_path: Path) -> None:
    """They are sent a function of a file that only the environment names; and which they read themselves."""
    (tmp_path / "work.py").write_text(WORKER)
    done = subprocess.run([sys.executable, "work.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "True\n", done.stderr


@pytest.mark.slow
def test_a_challenge_hides_the_plugin(known_folder: Path, sensor: Path, tmp_path: Path) -> None:
    done = psafit(
        "challenge", "make", "--seed", 3, "--out", "hidden", "--terms", "sensor_compression", "--kind", "one",
        "--jobs", 2, "--experiment", known_folder, cwd=tmp_path, PSAFIT_PLUGINS=str(sensor),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "sensor_kappa" in json.loads((tmp_path / "hidden" / "answer.json").read_text())["parameters"]


@pytest.fixture(scope="module")
def term(tmp_path_factory: pytest.TempPathFactory) -> Term:
    file = tmp_path_factory.mktemp("plugin") / "sensor_compression.py"
    file.write_text(SENSOR)
    return plugin.read(file)


@pytest.fixture(scope="module")
def with_plugin(term: Term, known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(physics, "TERMS", (*TERMS, term))
        fit(known, [1], folder, terms=[term], n_starts=4, sampled_by="importance")
    return folder


@pytest.mark.slow
def test_a_run_records_its_plugin(with_plugin: Path, term: Term, monkeypatch: pytest.MonkeyPatch) -> None:
    record = json.loads((with_plugin / "fit.json").read_text())
    assert record["terms"] == ["sensor_compression"]
    assert record["versions"]["plugin sensor_compression"] == term.plugin
    assert "pytest" not in (with_plugin / "fit.json").read_text()  # no path: the file lies in pytest's folder
    monkeypatch.setattr(physics, "TERMS", (*TERMS, term))
    assert load(with_plugin).problem.terms == (term,)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda term: (), "was made with the plugin sensor_compression (SHA-256 {}), which is not here"),
        (
            lambda term: (replace(term, plugin="0" * 16),),
            "it was a plugin of SHA-256 {} and is now a plugin of SHA-256 0000",
        ),
        (lambda term: (replace(term, plugin=""),), "it was a plugin of SHA-256 {} and is now built in"),
    ],
)
def test_a_run_without_its_plugin_says_so(  # type: ignore[no-untyped-def]
    change: Callable[[Term], tuple[Term, ...]], words: str, with_plugin: Path, term: Term, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(physics, "TERMS", (*TERMS, *change(term)))
    before = {p.name: p.read_bytes() for p in with_plugin.glob("*.*")}
    for command in ("validate", "report"):
        assert run(monkeypatch, command, with_plugin) == 2
        said = capsys.readouterr().err
        assert words.format(term.plugin) in said and said.count("\n") == 1 and "fit.json" in said
    assert {p.name: p.read_bytes() for p in with_plugin.glob("*.*")} == before


def test_an_edited_plugin_is_another_run(
    with_plugin: Path, term: Term, known: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    edited = replace(term, plugin="0" * 16)
    monkeypatch.setattr(physics, "TERMS", (*TERMS, edited))
    with pytest.raises(InputError, match="holds another run \\(what differs: terms\\)"):
        fit(known, [1], with_plugin, terms=[edited], n_starts=4, sampled_by="importance")


@pytest.mark.slow
def test_the_command_fits_validates_and_refuses(known_folder: Path, sensor: Path, tmp_path: Path) -> None:
    words = ("--group", 1, "--starts", 4, "--sampler", "importance", "--out", "run", "--terms", "sensor_compression")
    words += ("--no-report", "--quiet")
    done = psafit("fit", known_folder, *words, "--plugin", "sensor_compression.py", cwd=tmp_path)
    assert done.returncode in (0, 1), done.stderr
    record = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert record["command"].endswith("--plugin sensor_compression.py")
    assert psafit("validate", "run", "--quiet", cwd=tmp_path, PSAFIT_PLUGINS="sensor_compression.py").returncode == 0
    assert psafit("report", "run", "--plugin", sensor, "--quiet", cwd=tmp_path).returncode == 0
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert record["versions"]["plugin sensor_compression"] in page and str(tmp_path) not in page
    sensor.write_text(SENSOR + "# edited\n")
    again = psafit("fit", known_folder, *words, "--plugin", sensor, cwd=tmp_path)
    assert again.returncode == 2 and "holds another run (what differs: terms)" in again.stderr


@pytest.mark.slow
def test_a_diagnosis_weighs_the_plugin(sensor: Path, tmp_path: Path) -> None:
    write_experiment(measure(np.random.default_rng(5), readings=(8, 6, 4)), tmp_path / "rig")
    words = ("--group", 1, "--quick", "--no-report", "--quiet", "--out", "found", "--plugin", sensor)
    words += ("--causes", "preload,sensor_compression")
    done = psafit("diagnose", "rig", *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    assert "sensor_compression" in [s["id"] for s in result["screening"]]
    assert result["versions"]["plugin sensor_compression"] and str(tmp_path) not in json.dumps(result)
    kept = len(list((tmp_path / "found" / "steps").iterdir()))
    sensor.write_text(SENSOR + "# edited\n")
    assert psafit("diagnose", "rig", *words, cwd=tmp_path).returncode == 0
    assert len(list((tmp_path / "found" / "steps").iterdir())) > kept  # what the old file gave is not taken

"""A rig and causes of one's own: the scaffold, plugins, their contract, and the pages that show them."""

from __future__ import annotations

import itertools
import json
import os
import re
import stat
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import loaded

from psafit import cli, files, physics, plugins
from psafit.errors import InputError
from psafit.experiment import Constants, Experiment, read_experiment
from psafit.experiment.records import OPTIONAL_COLUMNS, REQUIRED_COLUMNS
from psafit.inference import noise
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.run import fit, load
from psafit.physics import TERMS, plugin
from psafit.physics.term import Term
from psafit.simulate import Design, contract, simulate
from psafit.simulate.sensitivity import REFERENCE

ROOT = Path(__file__).parents[1]
QUICK = Settings(n_walkers=24, chunk=100, r_hat=1.5, effective_samples=50, autocorrelation_times=5, max_steps=300)


TUTORIAL = loaded(ROOT / "docs" / "make_tutorial.py")
SENSOR: str = TUTORIAL.example()
# A law, compiled: a contact that hardens with the square of the indentation.
CUBIC = (
    SENSOR.split("def reading")[0]
    + """
def law(d, rate, p, out):
    size = d / 1e-6
    factor = 1.0 + p[0] * size * size
    out[1] = out[1] * factor + out[0] * 2.0 * p[0] * size / 1e-6
    out[0] *= factor
    out[2] *= factor


def literal(world, p):
    elastic, strength = world.elastic, p[0]
    world.elastic = lambda d, rate: elastic(d, rate) * (1 + strength * (d / 1e-6) ** 2)


def _force(d, strength):
    out = [1e6 * d, 1e6, 0.0, 0.0, 0.0, 0.0]
    law(d, 0.0, [strength], out)
    return out[0]


TERM = Term(
    id="cubic", slot="contact", title="hardening contact", equation=r"F = k_c d (1 + b d^2)", description=__doc__,
    parameters=(
        Parameter("cubic_b", "b", "1", Bounds(0.0, 5.0), Normal(0.0, 0.5), "hardening", "made up", neutral=0.0),
    ),
    symptom=Symptom("deeper is harder", sign=0, frequency="mixed", amplitude="mixed"), reference="made up",
    checks=(Check("1 N/um at 2 um, b = 0.5: 2 N x 3 = 6 N", lambda: _force(2e-6, 0.5), 6.0),),
    literal=literal, law=law,
)
"""
)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["psafit", *map(str, arguments)])
    with pytest.raises(SystemExit) as caught:
        cli.main()
    return int(caught.value.code or 0)


def psafit(*arguments: object, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """In a process of its own: the registry is read once in each."""
    return subprocess.run(
        [sys.executable, "-m", "psafit", *map(str, arguments)], cwd=cwd, capture_output=True, text=True, timeout=300,
        check=False, env={k: v for k, v in os.environ.items() if k != plugins.VARIABLE} | environment,
    )  # fmt: skip


@pytest.fixture
def sensor(tmp_path: Path) -> Path:
    file = tmp_path / "sensor_compression.py"
    file.write_text(SENSOR)
    return file


# --- psafit new -----------------------------------------------------------------------------------------


def test_a_new_folder_passes_the_check_at_once(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    folder = tmp_path / "deep" / "rig"
    assert run(monkeypatch, "new", folder) == 0
    said = capsys.readouterr().out
    assert all(str(p) in said for p in folder.iterdir()) and "psafit check" in said
    assert run(monkeypatch, "check", folder) == 0
    told = capsys.readouterr()
    assert told.out.startswith("EXAMPLE, replace")
    # What is still the example's is said, and no longer once it is not.
    assert told.err.count("\n") == 4 and "source is still that of the example" in told.err
    assert all(f"example_{name}.csv: group {k}: these readings are the example's" in told.err
               for k, name in ((1, "sine"), (2, "square")))  # fmt: skip
    assert "all six constants are the example's" in told.err
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
    for column in (*REQUIRED_COLUMNS, *OPTIONAL_COLUMNS):
        assert re.search(rf"^#   {column} +\S", text, flags=re.MULTILINE)
    assert max(map(len, text.splitlines())) <= 120
    (folder / "experiment.toml").write_text(text.replace("EXAMPLE, replace: ", ""), "utf-8")
    for table in folder.glob("*.csv"):
        table.write_text(table.read_text("utf-8") + "1000,10,60\n", "utf-8")
    assert run(monkeypatch, "check", folder) == 0 and capsys.readouterr().err == ""


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


# --- files that are read --------------------------------------------------------------------------------

HOSTILE: dict[str, tuple[str | bytes, str, int | None]] = {
    "empty": ("", "declares no TERM", None),
    "syntax": ("x = (\n", "SyntaxError: '(' was never closed", 1),
    "import": ("import os\nimport nosuchmodule\n", "No module named 'nosuchmodule'", 2),
    "deep in a library": ("import json\n\njson.loads('{')\n", "JSONDecodeError", 3),
    "exit": ("\nraise SystemExit(3)\n", "SystemExit: 3", 2),
    "many lines": ("raise ValueError('one\\ntwo')\n", "(ValueError: one two)", 1),
    "endless text": ("raise ValueError('x' * 100000)\n", "xxx...", 1),
    "recursion": ("def f():\n    f()\nf()\n", "RecursionError", 2),
    "null bytes": (b"a = 1\0b", "null bytes", None),
    "no UTF-8": (b"x = '\xff'\n", "SyntaxError", None),
    "a dict": ("\nTERM = {'id': 1}\n", "TERM is a dict, not a Term", 2),
    "another slot": (SENSOR.replace('slot="reading"', 'slot="ether"'), "no slot 'ether'", 37),
    "no neutral value": (SENSOR.replace("neutral=0.0", "neutral=None"), "has no neutral value", 37),
    "capital letters": (SENSOR.replace('id="sensor', 'id="Sensor'), "not lower-case", 37),
    "a keyword": (SENSOR.replace('"sensor_kappa"', '"lambda"'), "'lambda' is not an identifier", None),
    "bounds": (SENSOR.replace("Bounds(0.0, 1e5)", "Bounds(1.0, 0.0)"), "bounds need finite lower < upper", None),
    "no function": (SENSOR.replace("    reading=reading,\n", ""), "nor fills a slot", 37),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_file_that_cannot_be_read_is_one_line(case: str, tmp_path: Path) -> None:
    content, words, line = HOSTILE[case]
    file = tmp_path / "mine.py"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    known = set(sys.modules)
    for _ in range(2):  # the second time, too
        with pytest.raises(InputError) as caught:
            plugin.read(file)
        said = str(caught.value)
        assert words in said and "\n" not in said and len(said) < 500 and caught.value.file == file
        assert line is None or caught.value.line == line
    if "TERM" not in said:
        assert not {m for m in set(sys.modules) - known if "plugin_" in m}


@pytest.mark.parametrize("kind", ["missing", "folder", "pipe"])
def test_what_is_no_file_is_not_waited_for(kind: str, tmp_path: Path) -> None:
    place = tmp_path / "mine.py"
    if kind == "folder":
        place.mkdir()
    elif kind == "pipe":
        os.mkfifo(place)
    with pytest.raises(InputError, match="no such plugin file"):
        plugin.read(place)


def test_what_a_file_prints_is_no_result(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "mine.py"
    file.write_text(SENSOR + "print('hello')\n")
    assert plugin.read(file).id == "sensor_compression"
    assert capsys.readouterr() == ("", "hello\n")


@pytest.mark.parametrize(
    ("old", "new", "words", "line"),
    [
        ('id="sensor_compression"', 'id="gap"', "the identifier 'gap' is that of the built-in cause gap", 38),
        ('"sensor_kappa"', '"gap_width"', "'gap_width' is that of the built-in cause gap", None),
        ('"sensor_kappa"', '"reading_gain_z"', "is that of the built-in cause reading_gain", None),
        ('"sensor_kappa"', '"k_c"', "the parameter name 'k_c' is that of the baseline", None),
        ('"sensor_kappa"', '"nu"', "the parameter name 'nu' is that of the scatter", None),
    ],
)
def test_names_that_are_taken(old: str, new: str, words: str, line: int | None, sensor: Path) -> None:
    assert SENSOR.count(old) == 1
    sensor.write_text(SENSOR.replace(old, new))
    with pytest.raises(InputError) as caught:
        plugin.refuse_clash(sensor, plugin.read(sensor), TERMS)
    assert words in str(caught.value)
    assert caught.value.line == (line or SENSOR[: SENSOR.index(old)].count("\n") + 1)


def test_the_scatter_s_names_are_known() -> None:
    assert tuple(p.name for p in noise.PARAMETERS) == plugin.SCATTER


def test_a_file_is_known_by_its_bytes(sensor: Path, tmp_path: Path) -> None:
    term, copy = plugin.read(sensor), tmp_path / "copy.py"
    copy.write_text(SENSOR)
    assert len(term.plugin) == 16 and term.signature == f"sensor_compression@{term.plugin}"
    assert plugin.read(copy).plugin == term.plugin  # without any path
    copy.write_text(SENSOR + "# edited\n")
    assert plugin.read(copy).plugin != term.plugin
    assert plugin.read(sensor).reading is term.reading
    assert TERMS[0].signature == TERMS[0].id


def test_machine_code_follows_the_file(tmp_path: Path) -> None:
    """Same place, same size, same function: what runs is what the file says now."""
    file = tmp_path / "cubic.py"
    point = Design.sweep(contract.STUDY, "sine", 1200.0, 20.0)
    found = []
    for scale in ("1e-6", "2e-6", "1e-6"):
        file.write_text(CUBIC.replace("size = d / 1e-6", f"size = d / {scale}"))
        found.append(simulate(point, [*REFERENCE, 0.5], [plugin.read(file)]).launch_range[0, 0])
    assert found[0] == found[2] != found[1]
    assert list((tmp_path / "__pycache__").glob("cubic.law-*"))  # compiled once for all processes


# --- the registry ---------------------------------------------------------------------------------------


def test_the_command_knows_the_plugin(sensor: Path, tmp_path: Path) -> None:
    listed = psafit("terms", "--plugin", "sensor_compression.py", "--json", "t.json", cwd=tmp_path)
    assert listed.returncode == 0, listed.stderr
    assert "sensor compresses (plugin)" in listed.stdout
    entries = {e["id"]: e for e in json.loads((tmp_path / "t.json").read_text())}
    assert len(entries) == len(TERMS) + 1 and entries["gap"]["plugin"] == ""
    assert entries["sensor_compression"]["plugin"] == plugin.read(sensor).plugin
    slots = [e["slot"] for e in entries.values()]
    assert [slot for slot, _ in itertools.groupby(slots)] == ["drive", "stack", "contact", "flight", "reading"]


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


def test_a_plugin_that_comes_too_late_is_told(sensor: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """In a process that has read the registry, as this one, it would not take part."""
    monkeypatch.setenv(plugins.VARIABLE, "")
    assert run(monkeypatch, "terms", "--plugin", sensor) == 2
    said = capsys.readouterr().err
    assert "has read its causes before" in said and said.count("\n") == 1
    assert plugins.files() == ()
    plugins.add([])


def _module(folder: Path, name: str, source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, name, raising=False)


def test_installed_packages_announce_causes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _module(tmp_path, "their_sensor", SENSOR, monkeypatch)
    points = [EntryPoint(n, v, plugin.ENTRY_POINTS) for n, v in (("b", "their_sensor:TERM"), ("a", "their_sensor"))]
    monkeypatch.setattr(plugin, "entry_points", lambda group: points if group == plugin.ENTRY_POINTS else [])
    monkeypatch.setenv(plugins.VARIABLE, str(tmp_path / "their_sensor.py"))
    ((file, term),) = plugin.discover()  # the same file three times
    assert file.name == "their_sensor.py" and term.plugin == plugin.read(file).plugin
    assert "sensor_compression" in [t.id for t in physics._with_plugins(TERMS)]


@pytest.mark.parametrize(
    ("value", "source", "words"),
    [
        ("their_broken", "import nosuchmodule\n", "nosuchmodule"),
        ("their_absent", None, "No module named 'their_absent'"),
        ("their_empty", "", "declares no TERM"),
        ("their_partial:TERM", "", "no attribute 'TERM'"),
        ("sys", None, "is no file"),
    ],
)
def test_a_broken_package_is_one_line(
    value: str, source: str | None, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if source is not None:
        _module(tmp_path, value.partition(":")[0], source, monkeypatch)
    monkeypatch.setattr(plugin, "entry_points", lambda group: [EntryPoint("theirs", value, group)])
    with pytest.raises(InputError) as caught:
        list(plugin.discover())
    assert words in str(caught.value) and "\n" not in str(caught.value)


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
    told = joblib.Parallel(2)(joblib.delayed(ask)(function) for _ in range(2))
    print(told == 2 * [(function.__module__, False, plugins.files())])
"""


def test_worker_processes_know_the_plugin(sensor: Path, tmp_path: Path) -> None:
    """They are sent a function of a file that only the environment names; and which they read themselves."""
    (tmp_path / "work.py").write_text(WORKER)
    done = subprocess.run([sys.executable, "work.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "True\n", done.stderr


@pytest.mark.slow
def test_a_challenge_hides_the_plugin(sensor: Path, tmp_path: Path) -> None:
    done = psafit(
        "challenge", "make", "--seed", 3, "--out", "hidden", "--terms", "sensor_compression", "--kind", "one",
        "--jobs", 2, "--experiment", ROOT / "experiments" / "psa", cwd=tmp_path, PSAFIT_PLUGINS=str(sensor),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "sensor_kappa" in json.loads((tmp_path / "hidden" / "answer.json").read_text())["parameters"]


# --- what a run remembers -------------------------------------------------------------------------------


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
        fit(known, [1], folder, terms=[term], n_starts=4, settings=QUICK)
    return folder


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
        fit(known, [1], with_plugin, terms=[edited], n_starts=4, settings=QUICK)


@pytest.mark.slow
def test_the_command_fits_validates_and_refuses(known_folder: Path, sensor: Path, tmp_path: Path) -> None:
    words = ("--group", 1, "--starts", 4, "--out", "run", "--terms", "sensor_compression", "--quiet")
    done = psafit("fit", known_folder, *words, "--plugin", "sensor_compression.py", cwd=tmp_path)
    assert done.returncode in (0, 1), done.stderr
    record = json.loads((tmp_path / "run" / "fit.json").read_text())
    assert record["command"].endswith("--plugin sensor_compression.py")
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert record["versions"]["plugin sensor_compression"] in page and str(tmp_path) not in page
    assert psafit("validate", "run", "--quiet", cwd=tmp_path, PSAFIT_PLUGINS="sensor_compression.py").returncode == 0
    assert psafit("report", "run", "--plugin", sensor, "--quiet", cwd=tmp_path).returncode == 0
    assert "which is not here" in psafit("validate", "run", cwd=tmp_path).stderr
    sensor.write_text(SENSOR + "# edited\n")
    changed = psafit("report", "run", "--plugin", sensor, cwd=tmp_path)
    assert changed.returncode == 2 and "was made with another cause" in changed.stderr
    again = psafit("fit", known_folder, *words, "--plugin", sensor, cwd=tmp_path)
    assert again.returncode == 2 and "holds another run (what differs: terms)" in again.stderr


@pytest.mark.slow
def test_a_diagnosis_weighs_the_plugin(known_folder: Path, sensor: Path, tmp_path: Path) -> None:
    words = ("--group", 1, "--quick", "--no-report", "--quiet", "--out", "found", "--plugin", sensor)
    done = psafit("diagnose", known_folder, *words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "found" / "diagnosis.json").read_text())
    assert "sensor_compression" in [s["id"] for s in result["screening"]]
    assert result["versions"]["plugin sensor_compression"] and str(tmp_path) not in json.dumps(result)
    kept = len(list((tmp_path / "found" / "steps").iterdir()))
    sensor.write_text(SENSOR + "# edited\n")
    assert psafit("diagnose", known_folder, *words, cwd=tmp_path).returncode == 0
    assert len(list((tmp_path / "found" / "steps").iterdir())) > kept  # what the old file gave is not taken


# --- the contract ---------------------------------------------------------------------------------------


def outcomes(source: str, folder: Path, **options: Any) -> dict[str, contract.Outcome]:
    file = folder / "mine.py"
    file.write_text(source)
    return {o.check: o for o in contract.check(plugin.read(file), **{"draws": 8, **options})}


@pytest.mark.parametrize("source", [SENSOR, CUBIC], ids=["reading", "law"])
def test_a_sound_cause_keeps_the_contract(source: str, tmp_path: Path) -> None:
    found = outcomes(source, tmp_path)
    assert [o for o in found.values() if not o.passed] == []
    assert len(found) == (12 if "def law" in source else 11)
    assert all(o.text and "\n" not in o.text for o in found.values())


def test_a_cause_is_held_to_the_contract_on_any_rig(known: Experiment, tmp_path: Path) -> None:
    design = Design.of(replace(known.constants, M=0.004, q=3e-7), known.groups)
    found = outcomes(SENSOR, tmp_path, design=design)
    assert all(o.passed for o in found.values()) and "x 62 readings" in found["neutral"].text


# What is broken in a sound file: by which words, and the checks that must fail for it.
_FAST = {"reference", "bounds", "in company"}
_IDLE = 'Parameter("sensor_idle", "x", "1", Bounds(0.0, 1.0), Normal(0.5, 0.1), "idle", "made up"),'
BROKEN: dict[str, tuple[str, str, str, set[str]]] = {
    "another literal": (SENSOR, "(1.0 + kappa * seen)", "(1.0 + 1.01 * kappa * seen)", _FAST),
    "forgets those before it": (SENSOR, "seen = before(L, group)", "seen = L", {"in company"}),
    "not neutral": (SENSOR, "return L / (1.0", "return L / (1.0 + 1e-8", {"by hand", "neutral", *_FAST}),
    "jumps": (SENSOR, "return L / (1.0", "return L / (1.0 + 1e-3 * (p[:, :1] > 0)", {"by hand", "continuous", *_FAST}),
    "wrong by hand": (SENSOR, "1e-3 / 11", "1e-4 / 11", {"by hand"}),
    "asks nobody": (SENSOR, "_read(4e-4, 2.5e3), 2e-4", "2e-4, 2e-4", {"by hand"}),
    "wrong sign": (SENSOR, "sign=-1", "sign=1", {"symptom"}),
    "wrong trend": (SENSOR, 'amplitude="grows"', 'amplitude="flat"', {"symptom"}),
    "nothing said": (SENSOR, 'reference="the sensor\'s calibration sheet"', 'reference=""', {"declaration"}),
    "LaTeX": (SENSOR, 'equation=r"L', 'equation=r"{L', {"declaration"}),
    "idle parameter": (SENSOR, "    ),\n    symptom=", f"        {_IDLE}\n    ),\n    symptom=", {"parameters"}),
    "raises": (SENSOR, "return L / (1.0", "raise OSError('boo')\n    return L / (1.0", {"by hand", "path", *_FAST}),
    "derivative": (CUBIC, "out[0] * 2.0 * p[0]", "out[0] * 2.1 * p[0]", {"derivatives"}),
    "derivative's sign": (CUBIC, "out[1] * factor + out[0]", "out[1] * factor - out[0]", {"derivatives"}),
    "beyond the array": (CUBIC, "    out[2] *= factor", "    out[6] = factor", {"by hand", "compiled"}),
    "before the array": (CUBIC, "    out[2] *= factor", "    out[-1] = factor", {"compiled"}),
    "another's parameter": (CUBIC, "1.0 + p[0] * size", "1.0 + p[1] * size", {"by hand", "compiled"}),
    "not to be compiled": (CUBIC, "size = d / 1e-6", "size = eval('d') / 1e-6", {"compiled"}),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_cause_fails_where_it_is_broken(case: str, tmp_path: Path) -> None:
    source, old, new, expected = BROKEN[case]
    assert source.count(old) == 1
    found = outcomes(source.replace(old, new), tmp_path)
    failed = {name for name, o in found.items() if not o.passed}
    assert expected <= failed and all("\n" not in o.text for o in found.values())
    # A function that does not compile, or writes where it must not, is not let near the simulator.
    assert ("neutral" in found) is ("compiled" not in failed)


def test_the_command_checks_a_cause(sensor: Path, tmp_path: Path) -> None:
    for source, code, last in (
        (SENSOR, 0, "keeps the contract"),
        (SENSOR.replace("sign=-1", "sign=0"), 1, "fails symptom"),
    ):
        sensor.write_text(source)
        done = psafit("check-cause", sensor.name, "--draws", 4, "--json", "c.json", cwd=tmp_path)
        lines = done.stdout.splitlines()
        assert done.returncode == code and done.stderr == "" and lines[-1].endswith(last)
        told = json.loads((tmp_path / "c.json").read_text())
        assert (
            told["id"] == "sensor_compression"
            and told["passed"] is (code == 0)
            and len(told["checks"]) == len(lines) - 1
        )
        assert [line[:4] for line in lines[:-1]] == ["pass" if c["passed"] else "FAIL" for c in told["checks"]]


# --- the pages ------------------------------------------------------------------------------------------


def blocks(name: str, kind: str = "python") -> list[str]:
    return re.findall(rf"```{kind}\n(.*?)```", (ROOT / "docs" / name).read_text("utf-8"), flags=re.DOTALL)


def test_the_page_s_python_reads_a_plugin(sensor: Path, tmp_path: Path) -> None:
    (code,) = blocks("own-causes.md")[1:]
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "sensor_kappa" in done.stdout, done.stderr


def test_what_the_pages_say_of_files(
    known: Experiment, known_folder: Path, tmp_path: Path, monkeypatch, capsys
) -> None:  # type: ignore[no-untyped-def]
    """docs/elsewhere.md, on a run of a small rig in the place of the study's."""
    from psafit.validate import validate

    monkeypatch.chdir(tmp_path)
    validation, _ = validate(fit(known, [1], Path("fits/psa-group1"), n_starts=4, settings=QUICK))
    Path("experiments").mkdir()
    Path("experiments/psa").symlink_to(known_folder)
    for code in blocks("elsewhere.md"):
        exec(code, {})
    said = capsys.readouterr().out
    assert "elpd_loo" in said and "overdamped with probability" in said
    recomputed, scores = re.findall(r"\{1: [^}]*\}", said)
    assert recomputed == scores
    predicted = re.findall(r"^(\d) (\w+) log_rmse ([\d.]+)", said, flags=re.MULTILINE)
    for (group, role, size), s in zip(predicted, validation.groups, strict=True):
        assert (group, role) == (str(s.group), s.role) and float(size) == pytest.approx(s.log_rmse, abs=0.02)


def test_the_pages_show_commands_that_have_said_something() -> None:
    for page in TUTORIAL.PAGES:
        found = TUTORIAL.BLOCK.findall(page.read_text("utf-8"))
        assert len(found) == len(blocks(page.name, "console"))
        assert all(told for command, told in found if "--measure" not in command)


@pytest.mark.slow
def test_the_pages_quote_what_the_commands_print(tmp_path: Path) -> None:
    """Those that take seconds; numbers may differ in their last digits from machine to machine."""

    def plain(text: str) -> str:
        return re.sub(r"\d+(\.\d+)?e[+-]\d+", "#", text)

    TUTORIAL.prepare(tmp_path)
    for page in TUTORIAL.PAGES:
        written = page.read_text("utf-8")
        assert plain(TUTORIAL.fill(written, tmp_path, quick=True)) == plain(written), "run python docs/make_tutorial.py"

"""Files and packages that bring a cause."""

from __future__ import annotations

import os
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from sensors import CUBIC, SENSOR

from psafit import physics, plugins
from psafit.errors import InputError
from psafit.inference import noise
from psafit.physics import TERMS, plugin
from psafit.simulate import Design, contract, simulate
from psafit.simulate.sensitivity import REFERENCE

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
    assert "sensor_compression" in [t.id for t in physics.with_plugins(TERMS)]


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

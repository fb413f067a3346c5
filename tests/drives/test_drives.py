"""Waveforms say the same twice, and a new one is one file."""

from __future__ import annotations

import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from keyed import CONSTANTS

from psafit import drives
from psafit.drives import NAMES, WAVEFORMS, Drive, Piece, Table, Waveform, instead

FORMULAS = {
    "sine": lambda x: np.sin(2 * np.pi * x),
    "square": lambda x: np.where(x < 0.5, 1.0, -1.0),
    "triangle": lambda x: 2 / np.pi * np.arcsin(np.sin(2 * np.pi * x)),
    "unipolar_sine": lambda x: (1 - np.cos(2 * np.pi * x)) / 2,
    "unipolar_square": lambda x: np.where(x < 0.5, 1.0, 0.0),
    "unipolar_triangle": lambda x: np.arccos(np.cos(2 * np.pi * x)) / np.pi,
}


def by_pieces(waveform: Waveform, x: float) -> float:
    piece = [p for p in waveform.pieces if p.begin <= x][-1]
    return piece.level + piece.slope * (x - piece.begin) + piece.swing * math.sin(2 * math.pi * x + piece.angle)


def by_parts(waveform: Waveform, x: float) -> tuple[float, float]:
    k = sum(corner <= x for corner in waveform.corners) - 1
    return waveform.value(k, x - waveform.corners[k]), waveform.rate(k, x - waveform.corners[k])


@pytest.mark.parametrize("name", WAVEFORMS)
def test_pieces_and_parts_are_the_formula(name: str) -> None:
    waveform, step = WAVEFORMS[name], 1e-6
    for x in np.random.default_rng(3).uniform(0, 1, 50):
        assert by_pieces(waveform, x) == pytest.approx(float(FORMULAS[name](x)), abs=1e-14)
        value, rate = by_parts(waveform, x)
        assert value == pytest.approx(float(FORMULAS[name](x)), abs=1e-14)
        slope = float(FORMULAS[name](x + step) - FORMULAS[name](x - step)) / (2 * step)
        if abs(slope) < 100:  # no jump within the step
            assert rate == pytest.approx(slope, abs=1e-3)


@pytest.mark.parametrize("name", WAVEFORMS)
def test_crest(name: str) -> None:
    waveform, x = WAVEFORMS[name], (np.arange(4000) + 0.5) / 4000
    if waveform.crest_squared:
        assert 1 / np.mean(FORMULAS[name](x) ** 2) == pytest.approx(waveform.crest_squared, rel=1e-5)
    assert waveform.span == (0.0 if name.startswith("unipolar") else -1.0, 1.0)


def test_what_there_is_not_leads_on() -> None:
    assert instead("unipolar-sin").startswith("did you mean unipolar_sine?")
    assert instead("Sinus").startswith("did you mean sine?")
    assert instead("Cosine").startswith("that is a sine with phase_deg = 90; there are sine,")
    assert instead("half-sine").startswith("that is none of psafit's: give one period as a table")
    for text in (instead("wobbly"), instead("sqare"), instead("burst")):
        assert all(name in text for name in NAMES)
    assert instead("Rechteck unipolar").startswith("did you mean unipolar_square?")
    assert instead("unipolar").startswith("did you mean unipolar_sine or unipolar_square or unipolar_triangle?")
    assert instead("triangle_unipolar").startswith("did you mean unipolar_triangle?")
    assert instead("offset sine").startswith("that is a sine with bias_v")
    assert instead("burst").startswith("that is a waveform with cycles")
    assert instead("sine 0-40V").startswith("that is a waveform from 0 V, such as unipolar_sine")
    assert instead("cosinus").startswith("that is a sine with phase_deg = 90")
    assert all(
        instead(text).startswith("that is unipolar_sine;") for text in ("1-cos", "(1 - cos(x))/2", "0.5*(1-cos)")
    )
    assert instead("unipolar ramp").startswith(
        "that is unipolar_triangle if it rises as long as it falls, else a table"
    )
    assert instead("|sin|").startswith("that is none of psafit's: give one period as a table")
    assert instead("single pulse").startswith("that is unipolar_square with cycles = 1")


@pytest.mark.parametrize(
    "wrong",
    [
        "abs_sine",
        "sin^2",
        "-sine",
        "sine 0 to V",
        "bipolar_square",
        "inverted sine",
        "",
        "-cos",
        "cos^2",
    ],
)
def test_a_word_that_changes_a_waveform_names_none(wrong: str) -> None:
    """What nearly has a waveform's name would be described by another's; no name is near to none."""
    assert instead(wrong).startswith("there are sine, square,")


@pytest.mark.parametrize(
    "settings",
    [{"cycles": 0.0}, {"bias_v": math.nan}, {"table": Table(np.array([0.0, 1.0]), np.zeros(2), False)}],
)
def test_impossible_drives_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        Drive("sine", **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "pieces", [(Piece(0.1, 1.0),), (Piece(0.0, 0.0, swing=1.0), Piece(0.5, 1.0)), (Piece(0.0, 1.0), Piece(1.0, 0.0))]
)
def test_wrong_waveforms_are_refused(pieces: tuple[Piece, ...]) -> None:
    with pytest.raises(ValueError, match="waveform wrong"):
        Waveform("wrong", "", pieces, (0.0,), lambda k, x: 1.0, lambda k, x: 0.0)


SAWTOOTH = """
from psafit.drives.waveform import Piece, Waveform

WAVEFORM = Waveform(
    id="sawtooth", title="0 to 1, and back at once", pieces=(Piece(0.0, level=0.0, slope=1.0),),
    corners=(0.0,), value=lambda k, x: x, rate=lambda k, x: 1.0,
)
"""
USE = r"""
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import psafit.drives
assert psafit.drives.__file__.startswith(sys.argv[1]), psafit.drives.__file__
import numpy as np
from psafit.drives import Drive
from psafit.experiment import Constants
from psafit.simulate import Design, simulate
from psafit.simulate.literal import literal_launch
from psafit.simulate.reference import Point

rig = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
theta = [4e5, 9e3, 60.0]
fast = simulate(Design.sweep(rig, "sawtooth", 800.0, 20.0), theta).launch_range[0, 0]
slow = literal_launch(Point(Drive("sawtooth"), 800.0, 20.0), theta, [], rig).launch_range
assert slow > 1e-7 and abs(fast - slow) < 1e-8 * slow, (fast, slow)

from psafit.physics import terms

(hertz,) = chosen = terms(["hertz_exponent"])
stepped = simulate(Design.sweep(rig, "sawtooth", 800.0, 20.0), [*theta, 1.5], chosen)
slow = literal_launch(Point(Drive("sawtooth"), 800.0, 20.0), theta, [(hertz, [1.5])], rig).launch_range
assert stepped.engine == "stepper" and abs(stepped.launch_range[0, 0] - slow) < 1e-6 * slow

from psafit.challenge.conditions import ConditionSettings
from psafit.errors import InputError
from psafit.experiment import read_experiment
from psafit.experiment.importing import Options, read_files

file, rests = Path(sys.argv[1], "sweep.csv"), (("idle_v", 0.0),)
file.write_text("Frequency (Hz);Amplitude (V);Range (um)\n800;20;30\n900;20;25\n", "utf-8")
(table,) = read_files([file], Options(waveforms=("sawtooth",), volts="peak"))
assert table.groups[0].drive == Drive("sawtooth")
file.write_text("Frequency (Hz);Amplitude (V);DC offset (V);Range (um)\n800;20;5;30\n900;20;5;25\n", "utf-8")
try:
    read_files([file], Options(waveforms=("sawtooth",), volts="peak", values=rests))
except InputError as error:
    assert "if it is counted twice" in str(error), error
else:
    raise AssertionError("an offset was added to what goes from 0 V by itself")
assert read_experiment(Path(sys.argv[1], "rig")).groups[0].drive == Drive("sawtooth")
assert "sawtooth" in dict(ConditionSettings().waveforms)
"""


@pytest.mark.slow
def test_a_drive_is_one_file(tmp_path: Path) -> None:
    """In a copy of the package a file adds a waveform: simulated by all three, read, imported, drawn; the engine stays
    compiled."""
    shutil.copytree(Path(drives.__file__).parents[1], tmp_path / "psafit")
    (tmp_path / "psafit" / "drives" / "sawtooth.py").write_text(SAWTOOTH)
    (tmp_path / "rig").mkdir()
    group = ["[[group]]", "id = 1", 'waveform = "sawtooth"', 'file = "a.csv"']
    lines = ['title = "t"', "[constants]", *(f"{k} = {v}" for k, v in CONSTANTS.items()), *group]
    (tmp_path / "rig" / "experiment.toml").write_text("\n".join(lines))
    (tmp_path / "rig" / "a.csv").write_text("frequency_hz,amplitude_v,launch_range_um\n800,20,30\n900,20,25\n")
    run = subprocess.run([sys.executable, "-c", USE, str(tmp_path)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr

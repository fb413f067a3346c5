"""Warnings of another unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from folders import HEADER, SIGMA, TOML, write

from psafit.experiment import read_experiment

CONSTANT_UNITS = {"M": 27.0, "m": 50.0, "q": 0.12, "l": 90.0, "k_s": 48.9, "g": 981.0}


@pytest.mark.parametrize("name", CONSTANT_UNITS)
def test_constant_in_another_unit_is_named(tmp_path: Path, name: str) -> None:
    lines = [
        f"{name} = {CONSTANT_UNITS[name]}" if line.startswith(f"{name} = ") else line for line in TOML.splitlines()
    ]
    warnings = read_experiment(write(tmp_path, "\n".join(lines))).warnings
    assert len(warnings) == 1
    assert f"constant {name} = {CONSTANT_UNITS[name]:g}" in warnings[0]
    assert "is it given in" in warnings[0]


SUSPICIOUS: dict[str, Callable[[float, float, float], tuple[float, float, float]]] = {
    "given in kHz": lambda f, v, r: (f / 1e3, v, r),
    "given in mHz": lambda f, v, r: (f * 1e3, v, r),
    "given in kV": lambda f, v, r: (f, v / 1e3, r),
    "given in mV": lambda f, v, r: (f, v * 1e3, r),
    "given in mm or m": lambda f, v, r: (f, v, r / 1e3),
    "given in nm": lambda f, v, r: (f, v, r * 1e4),
    "nothing drives the ball": lambda f, v, r: (f, 0, r),
    "nothing to fit": lambda f, v, r: (f, v, 0),
}


@pytest.mark.parametrize("words", SUSPICIOUS)
def test_readings_in_another_unit_are_named(tmp_path: Path, words: str) -> None:
    rows = [SUSPICIOUS[words](f, 20, r) for f, r in ((1200, 76), (3000, 34.4), (25000, 0.67))]
    csv = HEADER + "".join(f"{f},{v},{r}\n" for f, v, r in rows)
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert len(warnings) == 1
    assert warnings[0].startswith("a.csv: group 1: ")
    assert words in warnings[0]
    assert warnings[0].isprintable()


def test_sigma_in_another_unit_is_named(tmp_path: Path) -> None:
    csv = SIGMA + "1200,20,76,400\n3000,20,34,400\n"
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert ["every sigma_um exceeds" in line for line in warnings] == [True]


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (2.0, "2 times those of group 1 at one shared condition; are volts of one of them peak to peak?"),
        (0.5, "0.5 times those of group 1 at one shared condition; are volts of one of them peak to peak?"),
        (1.42, "1.42 times those of group 1 at one shared condition; are volts of one of them RMS?"),
        (1.3, ""),
    ],
)
def test_groups_that_share_a_condition_and_differ_are_named(tmp_path: Path, factor: float, said: str) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    first = HEADER + "1200,20,50\n1200,2,0.3\n1300,20,45\n"
    second = HEADER + f"1200,20,{50 * factor:.6g}\n1200,2,0.9\n1400,20,1\n"  # 0.3 against 0.9 is scatter
    warnings = read_experiment(write(tmp_path, toml, first, second)).warnings
    assert [w.partition("ranges are ")[2] for w in warnings] == [said] * bool(said)
    other = toml.replace('file = "b.csv"', 'file = "b.csv"\nconstants = { l = 0.06 }')
    assert not read_experiment(write(tmp_path, other, first, second)).warnings


def test_a_stack_of_three_kilograms_is_named(tmp_path: Path) -> None:
    (warning,) = read_experiment(write(tmp_path, TOML.replace("m = 0.005", "m = 3"))).warnings
    assert "constant m = 3 kg is outside" in warning

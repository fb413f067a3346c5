"""What a heading leaves open is asked for, and what the line proposes reads the file right."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from psafit.errors import InputError
from psafit.experiment.importing import Mapping, Options, Table, read_files
from psafit.experiment.importing.units import unit


def tables(folder: Path, content: str, **said: Any) -> list[Table]:
    file = folder / "in.csv"
    file.write_text(content, encoding="utf-8")
    return read_files([file], Options(**({"waveforms": ("sine",)} | said)))


def refused(folder: Path, content: str, **said: Any) -> str:
    """The one line that is said of a file."""
    with pytest.raises(InputError) as caught:
        tables(folder, content, **said)
    (line,) = str(caught.value).splitlines()
    assert line.isprintable() and len(line) < 500
    return line


def mapped(text: str) -> Mapping:
    """What ``--column`` makes of a text without scales."""
    heading, _, said = text.rpartition("=")
    column, _, named = said.partition(":")
    return Mapping(heading, column, unit(named) if named else None)


def proposed(line: str) -> list[Mapping]:
    """The columns that a line proposes."""
    words = shlex.split(re.sub(r"[,;](?= |$)", "", line.partition("; ")[2]))
    return [mapped(words[k + 1]) for k, word in enumerate(words) if word == "--column"]


# --- how volts are counted ----------------------------------------------------------------------------------------

COUNTED = {
    "Tension crête à crête (V)": 20.0, "Tension crete a crete (V)": 20.0, "Tension c-à-c [V]": 20.0,
    "Spannung Uss in mV": 0.02, "Spannung Spitze-Spitze (V)": 20.0, "Amplitude Vpp (V)": 20.0, "CH1 Pk-Pk (V)": 20.0,
    "Peak-to-valley (V)": 20.0, "Generator Vpp (V)": 20.0, "Tensión pico a pico (V)": 20.0,
    "CH1 RMS (V)": 40 * 2**0.5, "Tension efficace (V)": 40 * 2**0.5, "Effektivwert U (V)": 40 * 2**0.5,
    "U0p / V": 40.0, "amplitude_v": 40.0,
}  # fmt: skip


@pytest.mark.parametrize(("name", "peak"), COUNTED.items())
def test_a_column_is_counted_as_its_heading_says(name: str, peak: float, tmp_path: Path) -> None:
    """Known or named by the user."""
    content = f"f (Hz);{name};Range (um)\n1200;40;76\n1300;40;75\n"
    for said in ((mapped(f"{name}=amplitude_v"),), ()):
        try:
            (table,) = tables(tmp_path, content, columns=said)
        except InputError as fault:
            assert not said
            (table,) = tables(tmp_path, content, columns=tuple(proposed(str(fault))[:1]))
        assert table.groups[0].amplitude_v == pytest.approx([peak, peak], rel=1e-12)


@pytest.mark.parametrize(
    "name", ["Generator output (V)", "Vamp (V)", "Peak above trough (V)", "Level (mV)", "Pp RMS (V)"]
)
def test_an_amplitude_that_nobody_counts_is_asked_for(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);{name};Range (um)\n1200;40;76\n"
    for text in (f"{name}=amplitude_v", f"{name}=amplitude_v:V"):
        asked = refused(tmp_path, content, columns=(mapped(text),))
        assert "whether volts are zero to peak, peak to peak or RMS is not said" in asked
    asked = refused(tmp_path, content, columns=(mapped(f"{name}=amplitude_v"),))
    (as_said,) = proposed(asked)
    (table,) = tables(tmp_path, content, columns=(as_said,))
    assert table.groups[0].amplitude_v[0] == (0.02 if "mV" in name else 20.0)
    if "RMS" not in name:
        (table,) = tables(tmp_path, content, columns=(mapped(f"{name}=amplitude_v"),), volts="pp")
        assert table.groups[0].amplitude_v[0] == (0.02 if "mV" in name else 20.0)
        first = refused(tmp_path, content)
        assert f"=amplitude_v:{'mV' if 'mV' in name else 'V'}pp', or " in first


def test_an_amplitude_without_a_unit_is_asked_for_its_count_at_once(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (Hz);Level;Range (um)\n1200;40;76\n", columns=(mapped("Level=amplitude_v"),))
    assert "gives no unit; say --column Level=amplitude_v:Vpp, or another unit such as Vp, Vrms" in asked


@pytest.mark.parametrize(
    ("name", "column"), [("Vpp/2 (V)", "amplitude_v"), ("0.5*Vpp (V)", "amplitude_v"), ("f / 2 (Hz)", "frequency_hz")]
)
def test_a_quantity_over_a_number_is_not_computed(name: str, column: str, tmp_path: Path) -> None:
    other = {"amplitude_v": "f (Hz)", "frequency_hz": "Vp"}[column]
    content = f"{other};{name};Range (um)\n40;40;76\n"
    asked = refused(
        tmp_path, content, columns=(mapped(f"{name}=amplitude_v") if "Vpp" in name else mapped(f"{name}={column}"),)
    )
    assert "times or over a number" in asked
    (table,) = tables(tmp_path, content, columns=tuple(proposed(asked)))
    assert getattr(table.groups[0], column)[0] == 40.0


# --- whose motion it is -------------------------------------------------------------------------------------------

HELD: dict[str, Any] = {"values": (("frequency_hz", 1200.0), ("amplitude_v", 20.0))}


def recording(*headings: str, n: int = 12) -> str:
    lines = (";".join(str(k * k + place) for place, _ in enumerate(headings)) for k in range(n))
    return "\n".join([f"Time (us);{';'.join(headings)}", *(f"{5 * k};{line}" for k, line in enumerate(lines)), ""])


@pytest.mark.parametrize(
    "name",
    ["Stack displacement", "Piezo displacement", "Actuator position", "Tip displacement", "Aktor Auslenkung", "Tip"],
)
def test_a_displacement_of_the_stack_is_the_tips(name: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, recording(f"{name} (um)"), **HELD)
    assert [g.observable.column for g in table.groups] == ["tip_displacement_um"]
    (table,) = tables(tmp_path, recording("Ball displacement (um)", f"{name} (um)"), **HELD)
    assert [g.observable.column for g in table.groups] == ["displacement_um", "tip_displacement_um"]
    assert [g.reading[1] for g in table.groups] == [1.0, 2.0]


@pytest.mark.parametrize("name", ["Piezo velocity (mm/s)", "Stack speed (m/s)", "Tip velocity (mm/s)"])
def test_a_speed_of_the_stack_is_none_of_the_ball(name: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, recording(name), **HELD)
    assert f"none is a motion that psafit reads: tip_velocity_mm_s ('{name}')" in asked and "--column" not in asked
    asked = refused(tmp_path, f"f (Hz);Vp;{name}\n1200;20;5\n")
    assert f"but tip_velocity_mm_s ('{name}')" in asked and "--column" not in asked
    (table,) = tables(tmp_path, recording("Ball displacement (um)", name), **HELD)
    assert table.not_yet == ((name, "tip_velocity_mm_s"),)
    assert [g.observable.column for g in table.groups] == ["displacement_um"]


@pytest.mark.parametrize("name", ["Stack displacement (um)", "Drive distance (um)"])
def test_a_distance_of_the_stack_is_not_proposed_as_a_launch_range(name: str, tmp_path: Path) -> None:
    assert "=launch_range_um" not in refused(tmp_path, f"f (Hz);Vp;{name}\n1200;20;5\n").replace("NAME=", "")


def test_a_motion_that_could_be_two_is_asked_for(tmp_path: Path) -> None:
    asked = refused(tmp_path, recording("Vibrometer"), **HELD)
    assert "column 'Vibrometer' could be displacement_um or velocity_mm_s; say which, with its unit: " in asked
    (table,) = tables(tmp_path, recording("Vibrometer"), **HELD, columns=tuple(proposed(asked)))
    assert table.groups[0].observable.column == "displacement_um"

"""What a heading leaves open is asked for, and what the line proposes reads the file right."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run
from imported import refused, tables
from keyed import CONSTANTS

from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment import read_experiment
from psafit.experiment.importing import Imported, Mapping, Options, read_files, write_import
from psafit.experiment.importing.quantities import COLUMNS
from psafit.experiment.importing.units import Unit, unit


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


# --- headings that say more than words ----------------------------------------------------------------------------

ALTERED = {
    "launch_range_um": (
        "-Range (um)", "Range^2 (um)", "√Range (um)", "Range² (um)", "Range·10 (um)", "Range (um)·10", "Range: 10 (um)",
        "1/Range (um)", "2*Range (um)", "|Range| (um)", "(-) Range (um)", "−Range (um)", "Range x10 (um)",
        "Range 1:100 (um)", "Range, 10 (um)", "Range ÷ 2 (um)", "Range 0.1 (um)", "Range (um)/2", "2 Range (um)",
        "Half range (um)", "Normalized range (um)", "Predicted launch range (um)", "Launch range pk-pk (um)",
        "Range RMS (um)", "Range log10 (um)",
    ),
    "frequency_hz": ("f / 2 (Hz)", "Frequency·2 (Hz)", "Frequency:2 (Hz)", "Sample rate (Hz)"),
    "amplitude_v": (
        "Vpp/2 (V)", "0.5*Vpp (V)", "-Vp (V)", "Vpp:2 (V)", "Vp/√2 (V)", "Drive x10 (V)", "Monitor 1:100 (V)",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("column", "name"), [(column, name) for column, each in ALTERED.items() for name in each])
def test_what_is_made_of_a_quantity_is_none_by_itself(column: str, name: str, tmp_path: Path) -> None:
    """It is proposed with a condition, and taken as the user says."""
    headings = {"frequency_hz": "f (Hz)", "amplitude_v": "Vp", "launch_range_um": "Range (um)"} | {column: name}
    content = f"{';'.join(headings.values())}\n40;40;40\n41;40;39\n"
    asked = refused(tmp_path, content)
    assert f"{column}" in asked and ", if its numbers are that by their unit, with no further factor" in asked
    said = Mapping(name, column, Unit(COLUMNS[column].unit, "peak" if column == "amplitude_v" else None))
    (table,) = tables(tmp_path, content, columns=(said,))
    group = table.groups[0]
    assert {"frequency_hz": group.frequency_hz, "amplitude_v": group.amplitude_v}.get(column, group.reading)[0] == 40.0


def test_who_is_asked_how_volts_of_a_drive_from_0_v_are_counted_hears_that_two_ways_are_the_same(
    tmp_path: Path,
) -> None:
    content, same = "f (Hz);Amplitude (V);Range (um)\n1200;40;76\n1300;40;70\n", "(the first two are the same number"
    for waveforms, known in ((("unipolar_sine",), True), (("sine",), False), ((), False)):
        assert (same in refused(tmp_path, content, waveforms=waveforms)) is known
    tops = [tables(tmp_path, content, waveforms=("unipolar_sine",), volts=way)[0].groups[0] for way in ("peak", "pp")]
    assert tops[0].amplitude_v.tolist() == tops[1].amplitude_v.tolist() == [40.0, 40.0]


@pytest.mark.parametrize("name", ["Vpp/2 (V)", "-Vpp (V)"])
def test_volts_of_an_altered_heading_are_counted_by_the_user(name: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, f"f (Hz);{name};Range (um)\n1200;40;76\n", columns=(mapped(f"{name}=amplitude_v"),))
    assert "whether volts are zero to peak, peak to peak or RMS is not said" in asked


@pytest.mark.parametrize("name", ["-Velocity (mm/s)", "|Velocity| (mm/s)", "Velocity^2 (mm/s)", "−Displacement (um)"])
def test_what_is_made_of_a_motion_is_none_by_itself(name: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, recording(name), **HELD)
    assert "none is a motion" in asked and "if it is that of the ball" in asked
    assert ("(that of the tip is tip_displacement_um)" in asked) is ("Displacement" in name)
    (table,) = tables(tmp_path, recording(name), **HELD, columns=tuple(proposed(asked)))
    assert table.groups[0].reading[1] == 1.0


def test_a_time_in_other_steps_is_none_by_itself(tmp_path: Path) -> None:
    content = recording("Velocity (mm/s)").replace("Time (us)", "Time·10 (us)")
    assert ", if its numbers are that by their unit, with no further factor" in refused(
        tmp_path, content, **HELD, start_us=0.0
    )


@pytest.mark.parametrize("name", ["-Bias (V)", "Offset·2 (V)", "sigma^2 (um)", "√sigma (um)"])
def test_what_is_made_of_a_setting_or_an_error_is_asked_for(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);{name}\n1200;20;76;1\n1300;20;75;1\n"
    assert "or something made of that; say --column" in refused(tmp_path, content)
    (table,) = tables(tmp_path, content, columns=(Mapping(name, "ignore"),))
    assert table.groups[0].n_points == 2


def test_a_name_is_not_that_of_what_is_made_of_it(tmp_path: Path) -> None:
    content = "f (Hz);Vp;Range (um);-Range (um);√Range\n1200;20;76;5;6\n"
    for name, value in (("range", 76.0), ("-range", 5.0), ("√Range", 6.0)):
        (table,) = tables(tmp_path, content, columns=(mapped(f"{name}=launch_range_um:um"),))
        assert table.groups[0].reading.tolist() == [value]


@pytest.mark.parametrize(
    "name",
    [
        "Range (um).1", "Range-1 (um)", "Range #1 (um)", "Range (1) (um)", "Range, µm", "Range: um", "Range (um):",
        "Weite. (um)", "Range at 20 Vp (um)", "Range @ 20 Vp (um)", "Range - 20 Vp (um)", "Range (20 Vp) (um)",
        "Launch-Range_um", "Wurf 1 / µm",
    ],
)  # fmt: skip
def test_plain_separators_alter_nothing(name: str, tmp_path: Path) -> None:
    amplitude = () if "20 Vp" in name else (("amplitude_v", 20.0),)
    (table,) = tables(tmp_path, f"f (Hz);{name}\n1200;76\n1300;75\n", values=amplitude)
    assert table.groups[0].reading.tolist() == [76.0, 75.0]


def test_several_that_are_no_repetitions_are_one_or_another(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (Hz);Vp;Mean range (um);Min range (um)\n1200;20;76;5\n")
    assert "say --column 'Mean range (um)=launch_range_um' or --column 'Min range (um)=launch_range_um', if" in asked
    asked = refused(tmp_path, "f (Hz);Vp;Half range 1 (um);Half range 2 (um)\n1200;20;76;5\n")
    assert "1 (um)=launch_range_um' --column 'Half range 2" in asked


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


# --- what else a table says of the drive --------------------------------------------------------------------------

SETTINGS: dict[str, tuple[str, str, Drive]] = {
    "psafit's phase": ("phase_deg", "90", Drive("sine", phase_deg=90.0)),
    "a phase": ("Start phase (deg)", "90", Drive("sine", phase_deg=90.0)),
    "a phase with a sign": ("Starting phase (°)", "-30", Drive("sine", phase_deg=-30.0)),
    "radians": ("Burst phase (rad)", "0.5", Drive("sine", phase_deg=90 / np.pi)),
    "psafit's cycles": ("cycles", "3", Drive("sine", cycles=3.0)),
    "a burst": ("Burst cycles", "3", Drive("sine", cycles=3.0)),
    "periods": ("Number of periods", "2.5", Drive("sine", cycles=2.5)),
}


@pytest.mark.parametrize(("name", "cell", "drive"), SETTINGS.values(), ids=SETTINGS.keys())
def test_settings_of_the_drive_stand_in_columns(name: str, cell: str, drive: Drive, tmp_path: Path) -> None:
    """Each makes a group, and stands in its definition."""
    content = f"f (Hz);Vp;Range (um);{name}\n1200;20;76;{cell}\n1300;20;75;{cell}\n1300;20;75;1\n"
    (table,) = tables(tmp_path, content)
    first, second = (group.drive for group in table.groups)
    assert (first.phase_deg, first.cycles) == pytest.approx((drive.phase_deg, drive.cycles), rel=1e-12)
    assert second != first and [g.n_points for g in table.groups] == [2, 1]
    write_import(Imported((table,), CONSTANTS), tmp_path)
    assert read_experiment(tmp_path).groups[0].drive == first


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Start phase", "'Start phase=phase_deg:deg', or another unit such as rad"),
        ("Force", "Force=peak_force_n:N, or another unit such as mN"),
    ],
)
def test_a_unit_that_is_missing_is_one_of_two(name: str, said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, f"f (Hz);Vp;Range (um);{name}\n1200;20;76;3\n")


def test_settings_are_given_once(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (Hz);Vp;Range (um);cycles\n1200;20;76;3\n", values=(("cycles", 4.0),))
    assert "cycles is given, and column 'cycles' holds it" in asked


@pytest.fixture
def printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[str], str]:
    """What the command prints of a file."""

    def of(content: str) -> str:
        file = tmp_path / "in.csv"
        file.write_text(content, encoding="utf-8")
        assert run(monkeypatch, "import", file, "--out", tmp_path / "out", "--waveform", "sine") == 0
        return capsys.readouterr().out

    return of


def test_settings_are_printed(printed: Callable[[str], str]) -> None:
    shown = printed("f (Hz);Vp;Range (um);phase_deg;cycles\n1200;20;76;90;3\n")
    assert "phase 90 deg, cycles 3 periods" in shown
    assert "group 1: sine at 90 degrees for 3 periods, -20 to 20 V, 1 reading" in shown


MATTERS = {
    "a phase": ("Phase (deg)", "90", "0", "may be phase_deg of the drive, or another quantity"),
    "direct voltage": ("DC (V)", "10", "0", "may be bias_v of the drive"),
    "direct voltage in short": ("U_DC / V", "10", "0", "may be bias_v of the drive"),
    "without a unit": ("Vdc", "10", "0", "may be bias_v of the drive"),
    "duty": ("Duty (%)", "20", "50", "psafit has no such setting; give the voltage with --drive FILE"),
    "gain": ("Amplifier gain", "10", "1", "psafit has no such setting; give volts behind the amplifier"),
    **{
        name: (name, "4", "", "may be cycles of the drive")
        for name in ("N burst", "Periods per burst", "Burst length", "Pulses", "Burst")
    },
    **{
        name: (name, "3", "", "psafit has no such setting; give its periods")
        for name in ("Burst duration", "Burst (ms)", "On time", "Burst length (ms)")
    },
    "a polarity": ("Polarity", "inverted", "Normal", "give the voltage with --drive"),
    "a symmetry": ("Symmetry (%)", "20", "50", "psafit has no such setting"),
    "a rise time": ("Rise time (us)", "5", "", "psafit has no such setting"),
    "a phase shift": ("Phase shift (deg)", "90", "0", "may be phase_deg of the drive"),
    "an attenuation": ("Attenuation", "10", "1", "give volts behind the attenuator"),
    "an attenuator": ("Attenuator (dB)", "20", "", "give volts behind the attenuator"),
    **{
        f"{name} {cell}": (name, cell, nothing, "marks some readings, and psafit takes all; delete the rows")
        for name, cell, nothing in (
            ("Valid", "0", "1"),
            ("Valid", "no", "yes"),
            ("Excluded", "x", "-"),
            ("Saturated", "yes", "no"),
            ("Outlier", "1", "0"),
            ("Outlier", "TRUE", "FALSE"),
        )
    },
    "a string": ("String length (mm)", "60", "", "is l of the rig"),
    "a ball": ("Ball mass (g)", "27", "", "is M of the rig"),
}


@pytest.mark.parametrize(("name", "cell", "nothing", "said"), MATTERS.values(), ids=MATTERS.keys())
def test_what_matters_is_asked_for(name: str, cell: str, nothing: str, said: str, tmp_path: Path) -> None:
    content = "f (Hz);Vp;Range (um);{0}\n1200;20;76;{1}\n1300;20;75;{1}\n"
    asked = refused(tmp_path, content.format(name, cell))
    assert said in asked and proposed(asked)[-1] == Mapping(name, "ignore")
    for way in proposed(asked):
        (table,) = tables(tmp_path, content.format(name, cell), columns=(way,), values=(("idle_v", 0.0),))
        drive = table.groups[0].drive
        assert (drive == Drive("sine")) == (way.column == "ignore")
        assert way.column == "ignore" or getattr(drive, way.column) == float(cell)
    (table,) = tables(tmp_path, content.format(name, nothing))
    assert name in table.unused


@pytest.mark.parametrize("name", ["Phase shift (us)", "DC (A)", "Ball mass (pieces)", "Valid time (um)", "Burst No."])
def test_what_only_sounds_so_does_not_matter(name: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, f"f (Hz);Vp;Range (um);{name}\n1200;20;76;5\n")
    assert table.unused == (name,)


@pytest.mark.parametrize("cell", ["on", "A"])
def test_a_burst_in_words_matters(cell: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);Burst\n1200;20;76;{cell}\n1300;20;75;{cell}\n"
    assert refused(tmp_path, content).endswith("say --column Burst=cycles, or --column Burst=ignore")
    (table,) = tables(tmp_path, content.replace(f";{cell}", ";off"))
    assert table.unused == ("Burst",)


def test_a_constant_of_the_rig_goes_to_its_place(tmp_path: Path) -> None:
    content = "f (Hz);Vp;Range (um);String length (mm)\n1200;20;76;60\n1300;20;75;{}\n"
    assert refused(tmp_path, content.format(60)).endswith("--column 'String length (mm)=ignore' --set l=60:mm")
    assert refused(tmp_path, content.replace("60", "60.12345").format(60.12345)).endswith("--set l=60.12345:mm")
    assert "write constants = { l = ... }, m, into its group" in refused(tmp_path, content.format(90))


def test_words_that_may_be_waveforms_are_pointed_to(tmp_path: Path) -> None:
    """Where no column is called one, and psafit knows none of the words; the remedy does what it says."""
    content = "Drive;f (Hz);Vp;Range (um)\noffset sine;1200;20;76\noffset sine;1300;20;75\n"
    asked = refused(tmp_path, content, waveforms=())
    assert "nothing says which waveform of the drive; 'Drive' may" in asked
    assert "say what each word means, --waveform 'offset sine=NAME', or --waveform NAME, of sine" in asked
    times = "When;f (Hz);Vp;Range (um)\n" + "".join(f"at {k} h;{1200 + k};20;76\n" for k in range(9))
    assert "nothing says which waveform of the drive; say --waveform NAME" in refused(tmp_path, times, waveforms=())
    (table,) = tables(tmp_path, content, waveforms=(), meant=(("offset sine", "unipolar_sine"),))
    assert [g.waveform for g in table.groups] == ["unipolar_sine"]


@pytest.mark.parametrize("name", ["Function", "Kurve", "Signal", "Waveform type"])
def test_a_column_of_waveforms_is_one_whatever_its_name(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);{name}\n1200;20;76;SIN\n1300;20;75;Rechteck\n"
    asked = refused(tmp_path, content)
    assert f"a column gives the waveform, '{name}'; leave out --waveform, or say " in asked
    assert asked.endswith("such as --waveform sine=unipolar_sine,square=unipolar_square")
    (table,) = tables(tmp_path, content, waveforms=())
    assert [g.waveform for g in table.groups] == ["sine", "square"]
    for column in ("ignore", "group"):  # or two waveforms would be taken for one
        said = refused(tmp_path, content, columns=(Mapping(name, column, None),))
        assert f"; leave out --column {shlex.quote(f'{name}={column}')}, and say what its words mean" in said
    one = content.rpartition("1300")[0]
    (table,) = tables(tmp_path, one, columns=tuple(proposed(refused(tmp_path, one))))
    assert [g.waveform for g in table.groups] == ["sine"]
    assert "no waveform" in refused(tmp_path, content.replace("SIN", "noise"), waveforms=())


def test_words_of_a_column_mean_other_waveforms(tmp_path: Path) -> None:
    """A generator that is offset calls its waveform a sine; peak to peak its amplitude is then the top."""
    content = "f (Hz);Vpp;Range (um);Form\n1200;20;76;sine\n1300;20;75;Rechteck\n1400;20;75;saw\n"
    meant = (("Sinus", "unipolar_sine"), ("square", "unipolar_square"), ("saw", "triangle"))
    (table,) = tables(tmp_path, content, waveforms=(), meant=meant)
    assert [g.waveform for g in table.groups] == ["unipolar_sine", "unipolar_square", "triangle"]
    assert [g.amplitude_v.tolist() for g in table.groups] == [[20.0], [20.0], [10.0]]
    (table,) = tables(
        tmp_path, content.replace("sine", "saw").replace("Rechteck", "saw"), meant=meant[2:], waveforms=()
    )
    assert [g.waveform for g in table.groups] == ["triangle"], "words of which psafit knows none"
    twice = (("sin", "triangle"), *meant)
    assert "says twice what 'sin' means; say it once" in refused(tmp_path, content, waveforms=(), meant=twice)
    assert "no row has the waveform 'ramp'" in refused(
        tmp_path, content, waveforms=(), meant=(*meant, ("ramp", "sine"))
    )
    assert "'half' is no waveform" in refused(tmp_path, content, waveforms=(), meant=(("saw", "half"),))
    bare = "f (Hz);Vp;Range (um)\n1;2;3\n"
    assert "say --column HEADING=waveform" in refused(tmp_path, bare, waveforms=(), meant=meant[:1])
    offset = "f (Hz);Vpp;Range (um);Form;DC offset (V)\n1200;20;76;sine;5\n1300;20;75;Rechteck;5\n"
    rests = (("idle_v", (0.0,)),)
    asked = refused(tmp_path, offset, waveforms=(), meant=meant[:2], values=rests)
    assert "; say --waveform sine=sine if that raises a sine, or say --column " in asked, asked
    words = (meant[1], ("my burst", "unipolar_sine"))
    asked = refused(tmp_path, offset.replace("sine", "my burst"), waveforms=(), meant=words, values=rests)
    assert "; say --waveform 'my burst'=sine if that raises a sine, or say" in asked, "the row's own word"
    asked = refused(tmp_path, offset.replace("sine", "unipolar sine"), waveforms=(), meant=meant[1:2], values=rests)
    assert "; write sine if that raises a sine, or say" in asked, "no word with a meaning"
    # A name by itself is that of a file without such a column, as it stands.
    files = [tmp_path / name for name in ("column.csv", "bare.csv")]
    for file, text in zip(files, (content, bare), strict=True):
        file.write_text(text, encoding="utf-8")
    read = read_files(files, Options(meant=meant, waveforms=("square",)))
    assert [g.waveform for t in read for g in t.groups] == ["unipolar_sine", "unipolar_square", "triangle", "square"]


def test_a_shape_of_something_else_is_no_waveform(tmp_path: Path) -> None:
    (table,) = tables(tmp_path, "f (Hz);Vp;Range (um);Shape\n1200;20;76;sphere\n")
    assert table.unused == ("Shape",) and table.groups[0].waveform == "sine"


# --- conditions that headings of launches name --------------------------------------------------------------------

WIDE = {
    "amplitudes": "Frequency (Hz);Range at 10 Vpp (um);Range at 20 Vpp (um)",
    "with a sign": "Frequency (Hz);Range @ 10 Vpp (um);Range @ 20 Vpp (um)",
    "without brackets": "Frequency (Hz);Range_5Vp_um;Range_10Vp_um",
    "speeds": "Frequency (Hz);Speed at 10 Vpp (mm/s);Speed at 20 Vpp (mm/s)",
    "in German": "Frequenz (Hz);Wurfweite bei 10 Vss (um);Wurfweite bei 20 Vss (um)",
}


@pytest.mark.parametrize("head", WIDE.values(), ids=WIDE.keys())
def test_launches_are_read_at_the_conditions_of_their_headings(head: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, f"{head}\n1000;12.5;31\n1200;;36.5\n")
    (group,) = table.groups
    read = zip(group.frequency_hz, group.amplitude_v, group.reading, strict=True)
    assert sorted(map(tuple, read)) == [(1000, 5, 12.5), (1000, 10, 31), (1200, 10, 36.5)]


def test_frequencies_stand_in_headings_of_launches(tmp_path: Path) -> None:
    """Repetitions of one condition are numbered."""
    head = "Vp;Range 1 1 kHz (um);Range 2 1 kHz (um);Range 1 1.5 kHz (um);Range 2 1.5 kHz (um)"
    (table,) = tables(tmp_path, f"{head}\n10;1;2;3;4\n")
    assert table.groups[0].frequency_hz.tolist() == [1000, 1000, 1500, 1500]
    assert table.groups[0].reading.tolist() == [1, 2, 3, 4]


def test_readings_of_one_condition_are_together(tmp_path: Path) -> None:
    head = "f (Hz);Range 10 Vp (um);Launch speed 10 Vp (mm/s);Range 20 Vp (um);Launch speed 20 Vp (mm/s)"
    (table,) = tables(tmp_path, f"{head}\n1000;1;2;3;4\n")
    (group,) = table.groups
    read = zip(group.amplitude_v, group.measured, group.reading, strict=True)
    assert sorted(map(tuple, read)) == [(10, 0, 1), (10, 1, 2), (20, 0, 3), (20, 1, 4)]


def test_what_headings_of_launches_name_is_not_overridden(tmp_path: Path) -> None:
    content = "Frequency (Hz);Range at 10 Vpp (um);Range at 20 Vpp (um)\n1000;12;31\n"
    said = tuple(Mapping(h, "launch_range_um") for h in content.splitlines()[0].split(";")[1:])
    for columns in ((), said):
        asked = refused(tmp_path, content, columns=columns, values=(("amplitude_v", 20.0),))
        assert asked.endswith("amplitude_v is given, and column 'Range at 10 Vpp (um)' holds it; leave out --set")
    (table,) = tables(tmp_path, content, columns=said)
    assert table.groups[0].amplitude_v.tolist() == [5.0, 10.0]


def test_an_error_at_one_condition_is_not_that_of_others(tmp_path: Path) -> None:
    content = "f (Hz);Range at 10 Vp (um);Range at 20 Vp (um);sigma at 10 Vp (um)\n1000;12;31;0.1\n"
    asked = refused(tmp_path, content, columns=(mapped("sigma at 10 Vp (um)=sigma_um"),))
    assert "is sigma_um of some readings, and would count for others" in asked
    (table,) = tables(tmp_path, content, columns=tuple(proposed(asked)))
    assert table.groups[0].sigma is None


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("f (Hz);Range at 10 V (um);Range at 20 V (um)", "whether volts are zero to peak, peak to peak or RMS is not"),
        ("f (Hz);Range at 10 Vp (um);Range (um)", "heading 'Range at 10 Vp (um)' holds amplitude_v, and heading"),
        ("f (Hz);Vp;Range at 10 Vp (um)", "column 'Vp' and heading 'Range at 10 Vp (um)' both hold amplitude_v"),
        ("Vp;f (Hz);Range at 1 kHz (um)", "column 'f (Hz)' and heading 'Range at 1 kHz (um)' both hold frequency_hz"),
    ],
)  # fmt: skip
def test_headings_of_launches_that_say_too_little_or_much(head: str, said: str, tmp_path: Path) -> None:
    assert said in refused(tmp_path, f"{head}\n1000;12;31\n")


# --- traces that look like launches -------------------------------------------------------------------------------

LABVIEW = "Delta_X\t5.0E-6\nX_Value\tVoltage\tVelocity\n"


def labview(head: str = LABVIEW, *, times: bool = True) -> str:
    return head + "".join(f"{5e-6 * k if times else '':}\t{np.sin(k):.4f}\t{0.1 * k:.3f}\n" for k in range(14))


def test_a_recording_does_not_become_launches(tmp_path: Path) -> None:
    """Its voltage is no amplitude where that is given, and what is said of one column does not hide the time."""
    asked = refused(tmp_path, labview(), **HELD, separator="\t")
    assert "'Voltage' changes along a trace" in asked and "Voltage=amplitude_v" not in asked
    said = (Mapping("Voltage", "ignore"), mapped("Velocity=launch_speed_mm_s:mm/s"))
    asked = refused(tmp_path, labview(), **HELD, columns=said, separator="\t")
    assert "'X_Value' rises from row to row at one condition" in asked
    as_said = (mapped("X_Value=time_us:s"), mapped("Velocity=velocity_mm_s:mm/s"), said[0])
    (table,) = tables(tmp_path, labview(), **HELD, columns=as_said, separator="\t")
    assert table.groups[0].time_us == pytest.approx(5.0 * np.arange(14))
    launches = (*said, Mapping("X_Value", "ignore"))
    (table,) = tables(tmp_path, labview(), **HELD, columns=launches, separator="\t")
    assert table.groups[0].time_us is None


def test_an_empty_column_of_times_holds_none(tmp_path: Path) -> None:
    said = (Mapping("Voltage", "ignore"), mapped("Velocity=velocity_mm_s:mm/s"))
    content = labview(times=False)
    assert "Delta_X 5.0E-6" in refused(tmp_path, content, **HELD, columns=said, separator="\t", start_us=0.0)
    head = LABVIEW.replace("Delta_X\t5.0E-6", "Delta_X (us)\t5")
    (table,) = tables(tmp_path, labview(head, times=False), **HELD, columns=said, separator="\t", start_us=0.0)
    assert table.groups[0].time_us == pytest.approx(5.0 * np.arange(14))


def test_a_column_is_not_proposed_for_what_is_given(tmp_path: Path) -> None:
    content = "f (Hz);Voltage;Range (um)\n1000;3;12\n1200;5;18\n"
    asked = refused(tmp_path, content, values=(("amplitude_v", 20.0),))
    assert (
        "amplitude_v is given, and column 'Voltage', without a unit, may hold it; say --column Voltage=ignore" in asked
    )
    (table,) = tables(tmp_path, content, values=(("amplitude_v", 20.0),), columns=tuple(proposed(asked)[:1]))
    assert table.groups[0].amplitude_v.tolist() == [20.0, 20.0]


def test_a_clock_is_left_out_with_the_launches_next_to_it(tmp_path: Path) -> None:
    """What is proposed where a velocity may be either."""
    rows = "".join(f"1200;20;{5 * k};{k}\n" for k in range(12))
    asked = refused(tmp_path, f"f (Hz);Vp;t (us);velocity (mm/s)\n{rows}")
    trace, *launches = proposed(asked)
    (table,) = tables(tmp_path, f"f (Hz);Vp;t (us);velocity (mm/s)\n{rows}", columns=(trace,))
    assert table.groups[0].time_us is not None
    (table,) = tables(tmp_path, f"f (Hz);Vp;t (us);velocity (mm/s)\n{rows}", columns=tuple(launches))
    assert table.groups[0].time_us is None and table.groups[0].n_points == 12


# --- readings of other names --------------------------------------------------------------------------------------

NAMELESS = {
    "a force": ("Fmax (N)", "peak_force_n"),
    "a speed": ("Exit velocity (m/s)", "launch_speed_mm_s"),
    "a time": ("t_c (us)", "contact_time_us"),
    "a range": ("L/µm", "launch_range_um"),
    "a speed without a unit": ("Exit velocity", "launch_speed_mm_s"),
    "a force without a unit": ("Force max", "peak_force_n"),
}


@pytest.mark.parametrize(("name", "column"), NAMELESS.values(), ids=NAMELESS.keys())
def test_the_nearest_column_of_any_reading_is_proposed(name: str, column: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;{name};No.\n1200;20;5;1\n1300;20;4;2\n"
    asked = refused(tmp_path, content)
    (said,) = proposed(asked)
    assert (said.heading, said.column, said.unit) == (name, column, None)
    if "(" not in name and "/" not in name:
        assert asked.endswith(
            "with the unit behind a colon, if its numbers are that by their unit, with no further factor"
        )
        said = replace(said, unit=Unit(COLUMNS[column].unit))
    (table,) = tables(tmp_path, content, columns=(said,))
    assert table.groups[0].observable.column == column


FURTHER = [
    "Shot B (um)",
    "Range B (um)",
    "Range bis (um)",
    "Range (um) B",
    "Range_CH2 (um)",
    "CH2 (um)",
    "Range B",
    "Range bis",
]


@pytest.mark.parametrize("name", FURTHER)
def test_a_further_reading_is_not_left_out(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);{name}\n1200;20;76;75\n"
    asked = refused(tmp_path, content)
    assert f"'{name}' may be launch_range_um, too; say --column 'Range (um)=launch_range_um' --column " in asked
    *both, left = proposed(asked)
    (table,) = tables(tmp_path, content, columns=tuple(both))
    assert table.groups[0].reading.tolist() == [76.0, 75.0]
    (table,) = tables(tmp_path, content, columns=(left,))
    assert table.groups[0].reading.tolist() == [76.0]


@pytest.mark.parametrize("name", ["Mean range (um)", "Range max", "Wire (um)", "Range (V)", "SD range", "CH2"])
def test_what_is_no_further_reading_is_left_out(name: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, f"f (Hz);Vp;Range (um);{name}\n1200;20;76;3\n")
    assert table.groups[0].reading.tolist() == [76.0] and table.unused == (name,)


OF_DEVICES = [
    "Frequency_GEN (Hz);Amplitude_GEN (Vp);Range_CH1 (um)",
    "Frequency (Hz)_GEN;Amplitude (Vp)_GEN;Range (um)_CH1",
    "Frequency (Hz) - GEN;Amplitude (Vp) - GEN;Range (um) - CH1",
    "GEN Frequency (Hz);Amplitude (Vp);CH1 Range (um)",
    "Frequency_GEN;Amplitude_GEN;Range_CH1",
    "frequency_hz_GEN;amplitude_v_GEN;launch_range_um_CH1",
]


@pytest.mark.parametrize("head", OF_DEVICES)
def test_columns_of_devices_are_named_one_by_one(head: str, tmp_path: Path) -> None:
    """What each line proposes reads the file, with its unit where the heading has none."""
    content = f"{head}\n1200;20;76\n"
    with pytest.raises(InputError) as caught:
        tables(tmp_path, content)
    said = [proposed(line)[0] for line in str(caught.value).splitlines()]
    units = {"frequency_hz": Unit("Hz"), "amplitude_v": Unit("V", "peak"), "launch_range_um": Unit("um")}
    if "(" not in head:
        said = [replace(each, unit=units[each.column]) for each in said]
    (table,) = tables(tmp_path, content, columns=tuple(said))
    (group,) = table.groups
    assert (group.frequency_hz[0], group.amplitude_v[0], group.reading[0]) == (1200.0, 20.0, 76.0)


def test_each_column_that_may_be_a_reading_is_proposed(tmp_path: Path) -> None:
    content = "f (Hz);Vp;Fmax (N);t_c (us);L (um)\n1200;20;5;100;7\n"
    said = proposed(refused(tmp_path, content))
    assert {(m.heading, m.column) for m in said} == {
        ("Fmax (N)", "peak_force_n"), ("t_c (us)", "contact_time_us"), ("L (um)", "launch_range_um"),
    }  # fmt: skip
    (table,) = tables(tmp_path, content, columns=tuple(said))
    assert sorted(table.groups[0].reading.tolist()) == [5.0, 7.0, 100.0]


# --- files of another form ----------------------------------------------------------------------------------------

ASKEW = {
    "a matrix": ("f (Hz) \\ U (Vpp);10;20\n1000;12,1;31,0\n1200;18;36,9\n", 1, "what was read at each of"),
    "a matrix of volts": ("f (Hz);10 Vpp;20 Vpp\n1000;12,1;31,0\n1200;18;36,9\n", 1, "what was read at each of"),
    "a matrix below a title": ("Sweep 3\n\nf (Hz);10;20\n1000;12,1;31,0\n1200;18;3\n", 3, "what was read at each of"),
    "conditions alone": ("f (Hz);Day;10 Vpp;20 Vpp\n1000;Mo;12,1;31,0\n", 1, "write it into each heading, such"),
    "a sweep on its side": ("Frequency (Hz);1200;1300\nVpp;40;40\nRange (um);76;75\n", 1, "turn the table, so that"),
    "a trace on its side": ("Time (us);0;5;10\nDisplacement (um);0;1;2\n", 1, "turn the table, so that"),
    "one with commas": ("Frequency (Hz),1200,1300\nVpp,40,40\nRange (um),76,75\n", 1, "turn the table, so that"),
    "HTML": ("<html><table><tr><td>f (Hz)</td></tr></table></html>", 1, "HTML or XML, no table of text; open it"),
    "XML": ('<?xml version="1.0"?>\n<Workbook><Worksheet/></Workbook>', 1, "HTML or XML, no table of text"),
    "JSON": ('[{"frequency_hz": 1200, "amplitude_v": 20}]', 1, "JSON, no table of text"),
    "JSON lines": ('{"frequency_hz": 1200}\n{"frequency_hz": 1300}\n', 1, "JSON, no table of text"),
    "other headings": ("f (Hz);Vp;Range (um)\n1;2;3\n\nf (kHz);Vpp;Range (um)\n1;2;3\n", 4, "are headings"),
    "the same headings": ("f (Hz);Vp;Range (um)\n1;2;3\nf (Hz);Vp;Range (um)\n1;2;3\n", 3, "headings once more"),
    "a row of remarks": ("f\tVp\tRange\nHz\tV\tum\nsweep 1\tset\tlaser\n1\t2\t3\n", 3, "put # before a remark"),
    "two traces": (
        "t1 (us);x1 (um);t2 (us);x2 (um)\n" + "".join(f"{k};1;{k};1\n" for k in range(12)), 1, "save each with its",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "line", "said"), ASKEW.values(), ids=ASKEW.keys())
def test_a_file_of_another_form_is_one_clear_line(content: str, line: int, said: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, content)
    assert said in asked and f"in.csv:{line}: " in asked and "--column NAME" not in asked


def test_a_matrix_is_read_once_its_headings_are_whole(tmp_path: Path) -> None:
    """As the line says."""
    content = "Frequency (Hz);Range at 10 Vpp (um);Range at 20 Vpp (um)\n1000;12,1;31,0\n1200;18;36,9\n"
    (table,) = tables(tmp_path, content)
    assert sorted(table.groups[0].reading.tolist()) == [12.1, 18.0, 31.0, 36.9]


def test_brackets_alone_are_no_json(tmp_path: Path) -> None:
    (table,) = tables(tmp_path, "[Hz];[Vp];Range (um)\n1200;20;5\n", columns=(mapped("1=frequency_hz:Hz"),))
    assert table.groups[0].n_points == 1


def test_rules_are_left_out(tmp_path: Path) -> None:
    """Of Markdown, for example."""
    content = "| f (kHz) | Vpp | Range (um) |\n|---|:-:|--:|\n| 1.2 | 40 | 76 |\n| 1.3 | 40 | 75.5 |\n|---|---|---|\n"
    (table,) = tables(tmp_path, content)
    assert table.groups[0].frequency_hz.tolist() == [1200, 1300]
    assert [line for line, _ in table.left_out] == [2, 5]


@pytest.mark.parametrize("decimal", [".", ","])
def test_blanks_part_what_nothing_else_parts(decimal: str, tmp_path: Path) -> None:
    content = "f_Hz Vp range_um\n1200 20.5 76.0\n1300 20.5 75.5\n".replace(".", decimal)
    (table,) = tables(tmp_path, content)
    assert table.groups[0].reading.tolist() == [76.0, 75.5]


@pytest.mark.parametrize(("said", "factor"), [("Horizontal Units,s", 1e6), ("X Units,ms", 1e3)])
def test_the_unit_of_a_clock_stands_above_it(said: str, factor: float, tmp_path: Path) -> None:
    rows = "".join(f"{k / factor:.7e},{k * k}\n" for k in range(0, 60, 5))
    velocity = (mapped("CH1=velocity_mm_s:mm/s"),)
    for columns in (velocity, (*velocity, Mapping("TIME", "time_us"))):
        (table,) = tables(tmp_path, f"{said},,\nTIME,CH1\n{rows}", **HELD, columns=columns)
        assert table.groups[0].time_us == pytest.approx(np.arange(0.0, 60.0, 5.0), rel=1e-12)
    asked = refused(tmp_path, f"TIME,CH1\n{rows}", **HELD, columns=velocity)
    assert "column 'TIME' gives no unit" in asked


# --- known errors of other names ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["± (um)", "+/- (um)", "SD (um)", "Std", "Error (um)", "u(L)", "u(Range) (um)", "Range error (um)", "SD range"],
)
def test_what_may_be_a_known_error_is_proposed(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);{name}\n1200;20;76;0.5\n1300;20;75;1\n"
    (table,) = tables(tmp_path, content)
    assert table.unused == (name,) and table.groups[0].sigma is None
    ((heading, said),) = table.errors
    (as_said,) = tables(tmp_path, content, columns=(mapped(f"{heading}={said}"),))
    assert as_said.groups[0].sigma.tolist() == [0.5, 1.0] and not as_said.errors
    (ignored,) = tables(tmp_path, content, columns=(Mapping(name, "ignore"),))
    assert not ignored.errors


@pytest.mark.parametrize("name", ["SD (N)", "Std (Hz)", "Humidity (%)", "Mean (um)", "± at 10 Vp (um)"])
def test_what_is_no_known_error_is_not_proposed(name: str, tmp_path: Path) -> None:
    """In another unit, or of another name; nor is a second one."""
    (table,) = tables(tmp_path, f"f (Hz);Vp;Range (um);{name}\n1200;20;76;0.5\n")
    assert not table.errors
    (table,) = tables(tmp_path, "f (Hz);Vp;Range (um);sigma (um);SD (um)\n1200;20;76;0.5;1\n")
    assert not table.errors
    (table,) = tables(tmp_path, "f (Hz);Vp;Range (um);Force (N);Std\n1200;20;76;0.5;1\n")
    assert not table.errors


def test_a_known_error_is_proposed_in_print(printed: Callable[[str], str]) -> None:
    shown = printed("f (Hz);Vp;Range (um);SD\n1200;20;76;1\n")
    assert "'SD' may hold the known error of each reading; if so, say --column SD=sigma_um:um" in shown


@pytest.mark.parametrize(("name", "column"), [("contact us", "contact_time_us"), ("Fmax (N)", "peak_force_n")])
def test_what_may_be_another_reading_is_proposed(
    name: str, column: str, tmp_path: Path, printed: Callable[[str], str]
) -> None:
    content = f"f (Hz);Vp;Range (um);{name};Humidity (%)\n1200;20;76;120;40\n1300;20;75;130;41\n"
    (table,) = tables(tmp_path, content)
    assert table.possible == ((name, column),)
    (as_said,) = tables(tmp_path, content, columns=(mapped(f"{name}={column}"),))
    assert not as_said.possible and [o.column for o in as_said.groups[0].observables] == ["launch_range_um", column]
    (ignored,) = tables(tmp_path, content, columns=(Mapping(name, "ignore"),))
    assert not ignored.possible
    assert f"{name!r} may be {column}; if so, say --column '{name}={column}'" in printed(content)


# --- what a file says of its numbers ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("Sample Rate: 200 kHz", "say --step 5:us, as line 1 says, or"),
        ("# Sample period = 5e-6 s", "say --step 5:us, as line 1 says, or"),
        (
            "Sample period: 5",
            "say the step, which does not follow from 'Sample period: 5' (line 1): --step NUMBER:us, or",
        ),
        ("Run 3", "say its step, such as --step 1:us, or"),
    ],
)
def test_a_step_is_proposed_as_the_file_says_it(line: str, said: str, tmp_path: Path) -> None:
    content = f"{line}\nVelocity (mm/s)\n" + "".join(f"{k}\n" for k in range(12))
    assert said in refused(tmp_path, content, **HELD)


@pytest.mark.parametrize("decimal", [None, ".", ","])
@pytest.mark.parametrize("rows", ["20;76,5\n1300;20;75.25", "20.5;76,5\n1300;20.5;76,5"])
def test_mixed_decimal_marks_are_one_line(decimal: str | None, rows: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, f"f (Hz);Vp;Range (um)\n1200;{rows}\n", decimal=decimal)
    assert "the numbers mix decimal marks: " in asked and "'76,5' (line 2) a comma; write all" in asked


def test_a_clock_next_to_headings_is_one_line_with_a_remedy(tmp_path: Path) -> None:
    """Of a Rigol oscilloscope."""
    rows = "".join(f"{k},0.{k:02},0.0,\n" for k in range(20))
    content = f"X,CH1,CH2,Start,Increment,\nSequence,VOLT,VOLT,-1e-5,5e-6\n{rows}"
    for columns in ((), (mapped("X=ignore"),)):
        asked = refused(tmp_path, content, **HELD, columns=columns)
        assert "in.csv:1: 'Start' and 'Increment' hold a number next to the headings" in asked
        assert "say --column X=time_us:5us, and --start=10:us if" in asked
    said = (
        Mapping("X", "time_us", Unit("us", scale=Decimal(5))),
        Mapping("CH1", "velocity_mm_s", Unit("mm/s/V", scale=Decimal(5))),
    )
    (table,) = tables(tmp_path, content, **HELD, columns=said, start_us=10.0)
    assert table.groups[0].time_us[:3].tolist() == [0.0, 5.0, 10.0]
    assert table.groups[0].reading[:2] == pytest.approx([0.1, 0.15])


@pytest.mark.parametrize(
    ("heading", "first", "others"),
    [
        ("Amplitude Vpk (V)", "Vp", "Vpp, Vrms"),
        ("Scheitelspannung (V)", "Vp", "Vpp, Vrms"),
        ("V_max", "Vp", "Vpp, Vrms"),
        ("Max voltage (V)", "Vp", "Vpp, Vrms"),
        ("Tension de cr\u00eate (V)", "Vp", "Vpp, Vrms"),
        ("Effektivspannung (V)", "Vrms", "Vpp, Vp"),
        ("Generator level (V)", "Vpp", "Vp, Vrms"),
    ],
)
def test_the_first_way_to_count_volts_is_the_one_that_the_heading_speaks_for(
    heading: str, first: str, others: str, tmp_path: Path
) -> None:
    asked = refused(tmp_path, f"Frequency (Hz);{heading};Range (um)\n1200;20;76\n1300;20;75\n")
    assert f"{heading}=amplitude_v:{first}" in asked and f", or {others}, as it is" in asked

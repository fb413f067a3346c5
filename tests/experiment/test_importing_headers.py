"""What a file says of its clock, its drive and its units outside of its rows: used, asked about, or shown as unread."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from commands import run
from imported import refused, tables

from psafit.errors import InputError
from psafit.experiment.importing import Mapping, Options, Table, read_files
from psafit.experiment.importing.units import Unit, scaled

SWEEP = "Frequency (Hz);Vp;Range (um)\n1000;3;31\n"
RAMP = "".join(f"{50 * k};{3 * k}\n" for k in range(12))


def driven(folder: Path, text: str, **said: Any) -> Table:
    """A sweep whose drive stands in a file of its own."""
    file = folder / "drive.csv"
    file.write_text(text, encoding="utf-8")
    (table,) = tables(folder, SWEEP, **{"waveforms": (), "drive_file": file, "start_us": 0.0} | said)
    return table


@pytest.mark.parametrize("heading", ["-Drive (V)", "CH1/20 (V)", "Monitor 1:20 (V)", "Drive x20 (V)"])
def test_a_drive_with_a_factor_or_a_sign_is_asked_about(heading: str, tmp_path: Path) -> None:
    text = f"Time (us);{heading}\n{RAMP}"
    file = tmp_path / "drive.csv"
    file.write_text(text, encoding="utf-8")
    asked = refused(tmp_path, SWEEP, waveforms=(), drive_file=file, start_us=0.0)
    assert f"drive.csv:1: column '{heading}' may be voltage_v of the drive, or something made of that" in asked
    assert f"'{heading}=voltage_v:20V/V', if one volt of it is 20 V at the stack" in asked
    table = driven(tmp_path, text, columns=(Mapping(heading, "voltage_v", scaled("20V/V")),)).groups[0].drive.table
    assert table is not None and table.value[-1] == 20 * 33


def test_a_pair_of_voltages_is_asked_about(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    rows = "".join(f"{50 * k};{3 * k};{-3 * k}\n" for k in range(12))
    file.write_text(f"Time (us);Drive + (V);Drive - (V)\n{rows}", encoding="utf-8")
    asked = refused(tmp_path, SWEEP, waveforms=(), drive_file=file, start_us=0.0)
    assert "columns 'Drive + (V)', 'Drive - (V)' could all be voltage_v" in asked
    assert "if that alone is the voltage at the stack" in asked


def test_a_time_that_says_more_is_asked_about(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    file.write_text(f"Time/2 (us);CH1 (V)\n{RAMP}", encoding="utf-8")
    asked = refused(tmp_path, SWEEP, waveforms=(), drive_file=file, start_us=0.0)
    assert "column 'Time/2 (us)' may be time_us of the drive, or something made of that" in asked


def test_what_was_understood_of_a_drive_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text(SWEEP, encoding="utf-8")
    Path("scope.csv").write_text(f"Amplifier: x20\nProbe attenuation;10\nTime (us);CH1 (V)\n{RAMP}", encoding="utf-8")
    words = ["import", "sweep.csv", "--drive", "scope.csv", "--start", "50:us", "--set", "idle_v=0", "--out", "folder"]
    assert run(monkeypatch, *words) == 0
    said = capsys.readouterr().out
    first, _, second = said.partition("sweep.csv:")
    for line in (
        "scope.csv: ascii, separated by semicolons, decimal point, headings in line 3",
        "voltage_v  from 'CH1 (V)', V",
        "time_us    from 'Time (us)', us, less 50 us",
        "line 1 is not read: 'Amplifier: x20'; if it counts, give volts behind the amplifier",
        "line 2 is not read: 'Probe attenuation 10'; if it counts, give volts behind the attenuator",
        "line 4 left out: 0 0",
        "line 5: 50 | 3  ->  3 V, 0 us",
    ):
        assert line in first
    assert "group 1: drive of 11 rows" in second


HELD = {"values": (("frequency_hz", 1200.0), ("amplitude_v", 20.0))}
SAMPLES = [0.0, 0.0, 0.0, *(0.01 * k * k for k in range(1, 14))]
STEP = Decimal(10)
SCALE = scaled("10us")
ORIGINS: dict[str, tuple[str, dict[str, Any], str]] = {
    "next to the headings": (
        "Time(s),Velocity (mm/s),t0 =-3e-05, tInc = 1e-05,\n" + "".join(f",{v},,\n" for v in SAMPLES),
        {"step_us": STEP}, "in.csv:1: 't0 = -3e-05' is",
    ),
    "below a heading": (
        "X,CH1,Start,Increment\nSequence,Volt,-3e-05,1e-05\n" + "".join(f"{k},{v},\n" for k, v in enumerate(SAMPLES)),
        {"columns": (Mapping("X", "time_us", SCALE), Mapping("CH1", "velocity_mm_s", scaled("1mm/s/V")))},
        "in.csv:1: 'Start = -3e-05' is",
    ),
    "in a line above": (
        "X0\t-0,00003\t-0,00003\nDelta_X\t0,00001\nVelocity (mm/s)\n" + "".join(f"{v:.2f}\n" for v in SAMPLES),
        {"step_us": STEP}, "in.csv:1: 'X0 = -0,00003 = -0,00003' is",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "said", "where"), ORIGINS.values(), ids=ORIGINS.keys())
def test_the_time_of_the_first_sample_is_not_left_out(
    text: str, said: dict[str, Any], where: str, tmp_path: Path
) -> None:
    asked = refused(tmp_path, text, **HELD, start_us=0.0, **said)
    assert f"{where} the time of the first sample" in asked and "say --start=30:us if the drive starts at 0" in asked
    (table,) = tables(tmp_path, text, **HELD, start_us=30.0, **said)
    time, motion = table.groups[0].time_us, table.groups[0].reading
    assert time is not None and time[0] == 0.0 and motion[:2].tolist() == pytest.approx([0.01, 0.04])
    assert table.above == ()
    (table,) = tables(tmp_path, text, **HELD, start_us=10.0, **said)
    assert [remedy for *_, remedy in table.above] == ["say --start=40:us where yours is on that clock"]
    for origin in ("-3e-05", "-0,00003"):
        text = text.replace(origin, "0")
    (table,) = tables(tmp_path, text, **HELD, start_us=0.0, **said)
    assert table.groups[0].n_points == 16


def test_the_time_of_a_drives_first_sample(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    file.write_text("t0 = -50 us\nCH1 (V)\n" + "".join(f"{3 * k}\n" for k in range(14)), encoding="utf-8")
    asked = refused(tmp_path, SWEEP, waveforms=(), drive_file=file, start_us=0.0, step_us=Decimal(50))
    assert "drive.csv:1: 't0 = -50 us' is the time of the first sample" in asked and "say --start=50:us" in asked


TABLE = "Frequency (kHz);Vpp;Range (um)\n1.2;40;19\n1.3;40;18\n"
TRACE = "Time (us);Velocity (mm/s)\n" + "".join(f"{10 * k};{v}\n" for k, v in enumerate(SAMPLES))
AT_REST = (("frequency_hz", 1200.0), ("amplitude_v", 40.0), ("bias_v", 10.0), ("idle_v", 0.0))
CONTRADICTED = {
    "Waveform: square": "names a waveform, and --waveform sine is given; say --waveform square",
    "Waveform;SQU": "say --waveform square",
    "Rechteck": "say --waveform square",
    "Drive: square": "say --waveform square",
    "Voltages are RMS": "say --column Vpp=amplitude_v:Vrms or --column Vpp=amplitude_v:Vpp, as it is",
    "All voltages peak": "say --column Vpp=amplitude_v:Vp or --column Vpp=amplitude_v:Vpp, as it is",
}


@pytest.mark.parametrize(("line", "said"), CONTRADICTED.items())
def test_a_line_above_a_table_that_contradicts_is_asked_about(line: str, said: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, f"{line}\n{TABLE}")
    assert f"in.csv:1: '{line.replace(';', ' ')}' " in asked and said in asked
    if "amplitude_v" in said:
        for unit in (Unit("V", "rms"), Unit("V", "pp")):
            (table,) = tables(tmp_path, f"{line}\n{TABLE}", columns=(Mapping("Vpp", "amplitude_v", unit),))
            assert table.columns[1].volts == unit.volts


def test_what_a_line_says_as_well_is_not_asked_about(tmp_path: Path) -> None:
    above = "Waveform: Sine\nAll voltages pp\nRange in um\nInverted: off\nMagnification: 1x\n"
    (table,) = tables(tmp_path, above + TABLE)
    assert table.above == ()
    assert tables(tmp_path, "Waveform: Sine\n" + TABLE, waveforms=("unipolar_sine",))[0].groups


@pytest.mark.parametrize(
    ("line", "remedy"),
    [
        ("Range in mm", "'Range (um)=launch_range_um:mm'"),
        ("Frequency in Hz", "'Frequency (kHz)=frequency_hz:Hz'"),
        ("Frequency: 2 kHz", "correct frequency_hz in the rows"),
        ("Unipolar drive, from zero", "say --waveform unipolar_sine"),
        ("CH1 inverted", "turn the sign"),
        ("Inverted output: on", "turn the sign"),
        ("Magnification: 10x", "as they are at the rig"),
        ("Scale factor: 2", "as they are at the rig"),
    ],
)
def test_a_line_above_that_may_count_is_listed(line: str, remedy: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, f"{line}\n{TABLE}")
    ((number, text, how),) = table.above
    assert (number, text) == (1, line) and remedy in how


@pytest.mark.parametrize(
    ("line", "name"),
    [
        ("Frequency: 2 kHz", "frequency_hz"),
        ("Frequency (kHz);2", "frequency_hz"),
        ("Amplitude: 10 Vpp", "amplitude_v"),
        ("Offset: 5 V", "bias_v"),
        ("Frequency: 1200 Hz", ""),
        ("Frequency;1,2;kHz", ""),
        ("Amplitude: 40 Vpp", ""),
        ("Amplitude: 20 V", ""),
        ("Amplitude: 14.14 Vrms", ""),
        ("Offset: 10 V", ""),
        ("Sample rate: 1 MHz", ""),
    ],
)
def test_a_line_above_a_trace_that_names_another_value_is_asked_about(line: str, name: str, tmp_path: Path) -> None:
    said: dict[str, Any] = {"values": AT_REST, "counted": ("pp",), "start_us": 0.0}
    if name:
        asked = refused(tmp_path, f"{line}\n{TRACE}", **said)
        assert f"names another {name} than --set" in asked and f"correct --set {name}, or that line" in asked
    else:
        assert tables(tmp_path, f"{line}\n{TRACE}", **said)[0].groups[0].amplitude_v[0] == 20.0


def test_a_sheet_of_another_waveform_is_asked_about(tmp_path: Path) -> None:
    from openpyxl import Workbook

    book = Workbook()
    book.active.title = "Square"
    for row in (("Frequency (kHz)", "Vpp", "Range (um)"), (1.2, 40, 19), (1.3, 40, 18)):
        book.active.append(row)
    file = tmp_path / "in.xlsx"
    book.save(file)
    with pytest.raises(
        InputError, match="sheet 'Square' names a waveform, and --waveform sine is given; say --waveform s"
    ):
        read_files([file], Options(waveforms=("sine",)))
    for waveform in ("square", "unipolar_square"):
        assert read_files([file], Options(waveforms=(waveform,)))[0].groups

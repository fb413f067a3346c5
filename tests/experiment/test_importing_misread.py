"""Files that read as something else than they are: asked about in one line, with a remedy that reads them right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment.importing import Mapping, Options, Table, read_files

RESTS = (("idle_v", 0.0),)
OFFSET = "Frequency (Hz);Amplitude (Vpp);DC offset (V);Range (um)\n1200;20;10;76\n1300;20;10;75\n1400;20;10;73.5\n"


def tables(folder: Path, content: str, **said: Any) -> list[Table]:
    file = folder / "sweep.csv"
    file.write_text(content, encoding="utf-8")
    return read_files([file], Options(**({"waveforms": ("sine",)} | said)))


def refused(folder: Path, content: str, **said: Any) -> str:
    with pytest.raises(InputError) as caught:
        tables(folder, content, **said)
    (line,) = str(caught.value).splitlines()
    assert line.isprintable() and len(line) < 400
    return line


@pytest.mark.parametrize("waveform", ["unipolar_sine", "unipolar_square"])
def test_an_offset_that_makes_a_drive_unipolar_is_counted_once(waveform: str, tmp_path: Path) -> None:
    said: dict[str, Any] = {"waveforms": (waveform,), "values": RESTS}
    asked = refused(tmp_path, OFFSET, **said)
    plain = waveform.removeprefix("unipolar_")
    assert f"column 'DC offset (V)' adds 10 V; say --waveform {plain} " in asked
    assert "'DC offset (V)=ignore'" in asked and "'DC offset (V)=bias_v'" in asked
    for column, drive in (("ignore", Drive(waveform)), ("bias_v", Drive(waveform, bias_v=10.0))):
        (table,) = tables(tmp_path, OFFSET, **said, columns=(Mapping("DC offset (V)", column),))
        assert table.groups[0].drive == drive and table.groups[0].amplitude_v[0] == 20.0
    (table,) = tables(tmp_path, OFFSET, values=RESTS)
    assert table.groups[0].drive == Drive("sine", bias_v=10.0) and table.groups[0].amplitude_v[0] == 10.0
    (table,) = tables(tmp_path, OFFSET.replace(";10;", ";0;"), **said)
    assert table.groups[0].drive == Drive(waveform)


@pytest.mark.parametrize(("name", "said"), [("offset sine", "a sine with bias_v"), ("Cosine", "phase_deg = 90")])
def test_a_waveform_of_another_name_is_not_guessed(name: str, said: str, tmp_path: Path) -> None:
    rows = "".join(f"{name};{row}\n" for row in OFFSET.splitlines()[1:])
    asked = refused(tmp_path, f"Waveform;{OFFSET.splitlines()[0]}\n{rows}", waveforms=(), values=RESTS)
    assert said in asked


HELD: dict[str, Any] = {"values": (("frequency_hz", 1200.0), ("amplitude_v", 20.0))}
RECORDED = {
    "a force": ("Time (us)", "Force (N)", "{}", "psafit reads no such recording: give peak_force_n of each launch"),
    "a range": ("Time (us)", "Range (um)", "{}", "--column 'Range (um)=displacement_um'"),
    "a clock": ("Clock (s)", "Launch speed (mm/s)", "{}", "'Clock (s)=time_us' with --column 'Launch speed (mm/s)=vel"),
    "times of the day": ("Stamp", "Force (N)", "2026-11-03T10:00:{:02d}.5", "Stamp=ignore if each row is a launch"),
    "a time of another name": (
        "X_Value (s)",
        "Velocity (mm/s)",
        "{}",
        "say --column 'X_Value (s)=time_us', or --column",
    ),
    "dates": ("Stamp", "Velocity (mm/s)", "3.11.2026 10:00:{:02d},5", "give column 'Stamp' in seconds, or"),
}


def recording(time: str, motion: str, form: str, n: int = 12) -> str:
    return f"{time};{motion}\n" + "".join(f"{form.format(k)};{1 + k * k}\n" for k in range(n))


@pytest.mark.parametrize(("time", "motion", "form", "said"), RECORDED.values(), ids=RECORDED.keys())
def test_a_recording_is_not_many_launches_of_one_condition(
    time: str, motion: str, form: str, said: str, tmp_path: Path
) -> None:
    content = recording(time, motion, form)
    assert said in refused(tmp_path, content, **HELD)
    if "=ignore" in said or "Clock" in said:
        (table,) = tables(tmp_path, content, **HELD, columns=(Mapping(time, "ignore"),))
        assert table.groups[0].time_us is None and table.groups[0].n_points == 12
    if motion == "Range (um)":  # as it proposes
        (table,) = tables(tmp_path, content, **HELD, columns=(Mapping(motion, "displacement_um"),))
        assert table.groups[0].time_us is not None and table.groups[0].n_points == 12


def test_launches_with_a_clock_are_no_recording(tmp_path: Path) -> None:
    """Of other conditions, of few rows, or with a pause that falls."""
    swept = recording("Clock (s);f (Hz)", "Range (um)", "{0};1{0}")
    pauses = "Pause (s);Range (um)\n" + "".join(f"{9 - k % 2};{k * k}\n" for k in range(12))
    for content, held in (
        (swept, HELD["values"][1:]),
        (recording("Clock (s)", "Range (um)", "{}", 9), HELD["values"]),
        (pauses, HELD["values"]),
    ):
        (table,) = tables(tmp_path, content, values=held)
        assert table.groups[0].time_us is None

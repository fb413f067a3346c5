"""What a file says of its clock, its drive and its units outside of its rows: used, asked about, or shown as unread."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from commands import run
from imported import refused, tables

from psafit.experiment.importing import Mapping, Table
from psafit.experiment.importing.units import scaled

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

"""What `experiment.toml` says of a drive: read, refused with a remedy, written back."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from psafit.drives import NAMES, Drive
from psafit.errors import InputError
from psafit.experiment import read_experiment, write_experiment

RIG = "[constants]\nM = 0.027\nm = 0.005\nq = 1.2e-7\nl = 0.09\nk_s = 4.89e7\ng = 9.81\n"
SWEEP = "frequency_hz,amplitude_v,launch_range_um\n1000,20,31\n1500,20,24\n2000,20,17\n"
PERIOD = "phase,level\n0,0\n0.4,1\n1,0\n"
RECORD = "time_us,voltage_v\n" + "".join(f"{10 * k},{math.sin(0.05 * k)}\n" for k in range(60))


def folder(at: Path, drive: str, table: str = "") -> Path:
    at.mkdir(exist_ok=True)
    (at / "experiment.toml").write_text(f'source = "made up"\n{RIG}[[group]]\nid = 1\nfile = "1.csv"\n{drive}\n')
    (at / "1.csv").write_text(SWEEP)
    (at / "drive.csv").write_text(table)
    return at


def test_a_drive_is_read(tmp_path: Path) -> None:
    text = 'waveform = " Unipolar_Sine "\nbias_v = -1\nidle_v = 2.5\nphase_deg = 90\ncycles = 3'
    drive = read_experiment(folder(tmp_path, text)).groups[0].drive
    assert drive == Drive("unipolar_sine", -1.0, 2.5, 90.0, 3.0)
    assert drive.label == "unipolar sine (bias -1 V, idle 2.5 V, phase 90 deg, 3 periods)"


@pytest.mark.parametrize("table", [PERIOD, RECORD], ids=["period", "recorded"])
def test_a_table_is_read_and_written(tmp_path: Path, table: str) -> None:
    before = read_experiment(folder(tmp_path / "a", 'waveform = "table"\ndrive = "drive.csv"\nidle_v = 1', table))
    found = before.groups[0].drive
    assert found.table is not None and found.recorded == (table == RECORD)
    assert found.table.at[-1] == pytest.approx(590e-6 if found.recorded else 1.0)
    write_experiment(replace(before, folder=Path("gone")), tmp_path / "b")
    after = read_experiment(tmp_path / "b")
    assert after.groups[0].drive.idle_v == 1.0
    assert np.allclose(after.groups[0].drive.table.at, found.table.at, rtol=1e-15)  # type: ignore[union-attr]
    assert np.array_equal(after.groups[0].drive.table.value, found.table.value)  # type: ignore[union-attr]


def test_the_fingerprint_knows_the_drive(tmp_path: Path) -> None:
    texts = ['waveform = "sine"', 'waveform = "sine"\nbias_v = 1', 'waveform = "sine"\nidle_v = 1']
    texts += ['waveform = "table"\ndrive = "drive.csv"']
    tables = ["", "", "", PERIOD]
    found = [read_experiment(folder(tmp_path, *both)).fingerprint for both in zip(texts, tables, strict=True)]
    found.append(read_experiment(folder(tmp_path, texts[-1], PERIOD.replace("0.4", "0.5"))).fingerprint)
    assert len(set(found)) == 5
    assert read_experiment(folder(tmp_path, 'waveform = "sine"\nbias_v = 0\ncycles = 5')).fingerprint not in found


@pytest.mark.parametrize(
    ("drive", "table", "what", "remedy"),
    [
        ('waveform = "unipolar"', "", "unknown waveform 'unipolar'", "did you mean unipolar_s"),
        ('waveform = "chirp"', "", "unknown waveform 'chirp'", "any other voltage"),
        ('waveform = "sine"\nbias_v = "1"', "", "bias_v is not a number", "without quotes"),
        ('waveform = "sine"\ncycles = 0', "", "cycles = 0 is not between", "how many periods"),
        ('waveform = "sine"\nphase_deg = 400', "", "phase_deg = 400", "degrees"),
        ('waveform = "sine"\ndrive = "drive.csv"', "", "drive is read with", 'waveform = "table"'),
        ('waveform = "table"', "", "needs drive", "time_us, voltage_v"),
        ('waveform = "table"\ndrive = "no.csv"', "", "does not exist", "correct the name"),
        ('waveform = "table"\ndrive = "drive.csv"', "", "empty", "phase,level"),
        ('waveform = "table"\ndrive = "drive.csv"', "time,volt\n0,1\n", "not those of a drive", "time_us,voltage_v"),
        (
            'waveform = "table"\ndrive = "drive.csv"',
            "phase,level\n0,0\n0.9,1\n",
            "phases run from 0 to 0.9",
            "end it at 1",
        ),
        ('waveform = "table"\ndrive = "drive.csv"', "phase,level\n0,0\n1,x\n", "'x' is not a number", "number alone"),
        ('waveform = "table"\ndrive = "drive.csv"', "phase,level\n0,0\n0.5,1\n0.4,1\n1,0\n", "comes after", "sort"),
        ('waveform = "table"\ndrive = "drive.csv"', "time_us,voltage_v\n0,0\n1,1\n", "at least 10", "more places"),
        ('waveform = "table"\ndrive = "drive.csv"', RECORD.replace("\n0,", "\n-5,"), "'-5'", "begin at 0"),
        ('waveform = "table"\ndrive = "drive.csv"\nbias_v = 1', RECORD, "bias_v has no meaning", "leave out bias_v"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(tmp_path: Path, drive: str, table: str, what: str, remedy: str) -> None:
    with pytest.raises(InputError) as error:
        read_experiment(folder(tmp_path, drive, table))
    text = str(error.value)
    assert what in text and remedy in text and "\n" not in text


def test_an_unknown_waveform_is_answered_by_all_there_are(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        read_experiment(folder(tmp_path, 'waveform = "wobbly"'))
    assert all(name in str(error.value) for name in NAMES)

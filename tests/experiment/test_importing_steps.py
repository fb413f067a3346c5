"""Samples without times: their step is read from a header, given, or asked for in one clear line."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run

from psafit.errors import InputError
from psafit.experiment import Group
from psafit.experiment.importing import Mapping, Options, read_files
from psafit.experiment.importing.units import Unit, scaled

HELD = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
MOTION = np.round(0.01 * np.arange(12) ** 1.5, 3) + 0.5
SENSOR = {"columns": (Mapping("CH1 (V)", "velocity_mm_s", scaled("5mm/s/V")),)}


def column(*above: str, factor: float = 1.0, decimal: str = ".") -> str:
    """Lines above samples, and the samples, one a line."""
    return "\n".join([*above, *(f"{y / factor:.9g}".replace(".", decimal) for y in MOTION)]) + "\n"


def read(folder: Path, text: str, **options: Any) -> Group:
    file = folder / "trace.csv"
    file.write_text(text, encoding="utf-8")
    usual = {"waveforms": ("sine",), "values": HELD, "start_us": 0.0}
    (table,) = read_files([file], Options(**(usual | options)))
    (group,) = table.groups
    return group


READ: dict[str, tuple[str, dict[str, Any], float]] = {
    "a comment": (column("# vibrometer", "# dt = 2 us", "Displacement (um)"), {}, 2.0),
    "a decimal comma": (column("Abtastintervall: 2,5 us", "Auslenkung (µm)", decimal=","), {}, 2.5),
    "a unit with the name": (column("Sample Interval (s),1.0E-06", "CH1 (V)", factor=5), SENSOR, 1.0),
    "a unit of the clock": (
        column("Sample Interval,1.0E-06,,", "Vertical Units,V,,", "Horizontal Units,s,,", "CH1 (V)", factor=5), SENSOR,
        1.0,
    ),
    "a rate": (column("SampleRate=1000000 Hz", "CH1 (V)", factor=5), SENSOR, 1.0),
    "samples a second": (column("Sampling rate;0.5 MSa/s", "CH1 (V)", factor=5), SENSOR, 2.0),
    "twice the same": (column("Sample interval = 2 us", "Sample rate = 500 kHz", "Displacement (um)"), {}, 2.0),
    "given": (column("Displacement (um)"), {"step_us": Decimal("0.4")}, 0.4),
    "given, against a header": (column("# dt = 2 us", "Displacement (um)"), {"step_us": Decimal(3)}, 3.0),
    "no headings": (
        column(), {"step_us": Decimal(3), "columns": (Mapping("1", "displacement_um", Unit("um")),)}, 3.0,
    ),
    "a velocity": (column("Velocity (mm/s)"), {"step_us": Decimal(3)}, 3.0),
    "a footer": (column("# dt = 2 us", "Displacement (um)") + "\nEnd of file\n", {}, 2.0),
}  # fmt: skip


@pytest.mark.parametrize(("text", "options", "step"), READ.values(), ids=READ.keys())
def test_samples_are_counted(text: str, options: dict[str, Any], step: float, tmp_path: Path) -> None:
    group = read(tmp_path, text, **options)
    assert group.time_us is not None
    np.testing.assert_allclose(group.time_us, step * np.arange(MOTION.size), rtol=1e-12)
    np.testing.assert_allclose(group.reading, MOTION, rtol=1e-8)


def test_the_start_is_on_the_clock_of_the_count(tmp_path: Path) -> None:
    group = read(tmp_path, column("# dt = 2 us", "Displacement (um)"), start_us=3.0)
    assert group.time_us is not None and group.time_us.tolist() == [1.0 + 2 * k for k in range(10)]
    assert group.reading is not None and group.reading[0] == MOTION[2]


ASKED: dict[str, tuple[str, dict[str, Any], str]] = {
    "no step": (column("Displacement (um)"), {}, "say their step, --step 1:us, or their rate, --step 1:MHz"),
    "no unit": (
        column("Sample Interval,1.0E-06", "Displacement (um)"), {},
        "does not follow from 'Sample Interval 1.0E-06' (line 1); say their step, --step 1:us",
    ),
    "a unit of another kind": (
        column("Sample rate: 5 us", "Displacement (um)"), {}, "does not follow from 'Sample rate: 5 us' (line 1)",
    ),
    "two values": (column("# dt = 1,250 us", "Displacement (um)"), {}, "no time_us among"),
    "two steps": (
        column("# dt = 1 us", "# sample interval = 2 us", "Displacement (um)"), {},
        "from '# dt = 1 us' (line 1), '# sample interval = 2 us' (line 2)",
    ),
    "a time by its unit": (
        "# dt = 1 us\nClock (ms),Displacement (um)\n" + "".join(f"{k},{k}\n" for k in range(12)), {},
        "'Clock (ms)=time_us'",
    ),
    "no start": (column("# dt = 1 us", "Displacement (um)"), {"start_us": None}, "say --start 0 if with the first"),
    "launches, or not": (column("Velocity (mm/s)"), {}, "--step 1:us, or --column 'Velocity (mm/s)=launch_speed_mm_s'"),
    "a gap": (
        column("# dt = 1 us", "Displacement (um)").replace("0.51\n", "0.51\n\n"), {},
        "trace.csv:5: no sample stands here",
    ),
    "several, one below the other": (
        "f (Hz);Vp;Displacement (um)\n" + "".join(f"{f};20;{k}\n" for f in (1200, 1600) for k in range(12)),
        {"step_us": Decimal(1), "values": ()}, "give each trace a column or a file of its own",
    ),
    "a header in the columns of samples": (
        "Trace,Displacement\nVUnit,um\nBlockSize,12\nHOffset,0\n," + column().replace("\n", "\n,")[:-1],
        {"step_us": Decimal(5)}, ":3: 'BlockSize' stands before a number that would be a sample, as in 2 lines",
    ),
    "a word": (column("# dt = 1 us", "Displacement (um)").replace("0.51\n", "over\n"), {}, "'over' stands between"),
    "no use": (
        "Time (us),Velocity (mm/s)\n" + "".join(f"{k},{k}\n" for k in range(12)), {"step_us": Decimal(1)},
        "--step is of samples without times, and no table has such",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("text", "options", "said"), ASKED.values(), ids=ASKED.keys())
def test_what_is_not_said_is_asked_for(text: str, options: dict[str, Any], said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, **options)
    assert said in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_each_column_is_a_trace(tmp_path: Path) -> None:
    heads = ";".join(f"Displacement {f} kHz, 40 Vpp (um)" for f in ("1.2", "1.6"))
    file = tmp_path / "wide.csv"
    file.write_text(f"Sample rate;100 kHz\n{heads}\n" + "".join(f"{y};{y + 1}\n" for y in MOTION), encoding="utf-8")
    (table,) = read_files([file], Options(waveforms=("sine",), start_us=0.0))
    assert [(g.frequency_hz[0], g.amplitude_v[0]) for g in table.groups] == [(1200.0, 20.0), (1600.0, 20.0)]
    for group in table.groups:
        assert group.time_us is not None and group.time_us.tolist() == [10.0 * k for k in range(12)]


def test_launches_below_a_sample_interval_remain_launches(tmp_path: Path) -> None:
    text = "Sample interval, 1.0e-6, s\nf (Hz),Vp,Velocity (mm/s)\n" + "".join(f"{k},20,{k}\n" for k in range(1, 13))
    assert read(tmp_path, text, values=(), start_us=None).time_us is None
    few = "Velocity (mm/s)\n5\n6\n"  # fewer than a trace has
    assert read(tmp_path, few, start_us=None).time_us is None


VOLTS = [0, 0, 10, 20, 30, 40, 40, 40, 30, 20, 10, 5, 0, 0]


def driven(folder: Path, text: str, **options: Any) -> Group:
    drive = folder / "drive.csv"
    drive.write_text(text + "".join(f"{u}\n" for u in VOLTS), encoding="utf-8")
    sweep = "f (kHz);Vpp;Range (um)\n1,2;40;76,5\n"
    return read(folder, sweep, **({"waveforms": (), "values": (), "drive_file": drive} | options))


def test_a_recorded_drive_without_times(tmp_path: Path) -> None:
    table = driven(tmp_path, "Sample rate: 1 MHz\nCH1 (V)\n").drive.table
    assert table is not None and table.value.tolist() == VOLTS
    np.testing.assert_allclose(table.at, 1e-6 * np.arange(len(VOLTS)))
    given = driven(tmp_path, "CH1 (V)\n", step_us=Decimal(2), start_us=2.0).drive.table
    assert given is not None and given.at[-1] == pytest.approx(24e-6)
    with pytest.raises(InputError, match="--step 1:us, or their rate, --step 1:MHz"):
        driven(tmp_path, "CH1 (V)\n")


def test_the_drive_next_to_a_trace_without_times(tmp_path: Path) -> None:
    text = "dt;1;us\nBall (um);Drive (V)\n" + "".join(f"{k};{u}\n" for k, u in enumerate(VOLTS))
    group = read(tmp_path, text, waveforms=(), columns=(Mapping("Ball (um)", "displacement_um", Unit("um")),))
    assert group.drive.table is not None and group.drive.table.value.tolist() == VOLTS


@pytest.mark.parametrize(("said", "step"), [("0.5:us", 0.5), ("2:MHz", 0.5), ("500:kSa/s", 2.0), ("3", 3.0)])
def test_the_command_takes_a_step_or_a_rate(
    said: str, step: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.csv").write_text(column("Displacement (um)"), encoding="utf-8")
    drive = ("--waveform", "sine", "--set", "frequency_hz=1200", "--set", "amplitude_v=20", "--start", "0")
    assert run(monkeypatch, "import", "one.csv", "--out", "rig", "--step", said, *drive) == 0
    assert f"time_us          from '--step', {step:g} us" in capsys.readouterr().out
    assert Path("rig/group1.csv").read_text("utf-8").splitlines()[2] == f"{step:g},0.51"
    for bad in ("0:us", "-1:us", "1:mm", "soon", "1,5:us", ""):
        assert run(monkeypatch, "import", "one.csv", "--out", "other", "--step", bad, *drive) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "is no time between samples and no rate; write for example 1:us or 1:MHz" in line

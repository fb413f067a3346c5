"""Recorded voltages as drives, and readings in a sensor's volts: read right, or asked about in one clear line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run

from psafit.errors import Faults, InputError
from psafit.experiment import Group, read_experiment
from psafit.experiment.importing import Mapping, Options, read_files
from psafit.experiment.importing.units import Unit, scaled

RIG = [w for name in ("M=0.02", "m=0.008", "q=1.5e-7", "l=0.2", "k_s=3.5e7", "g=9.81") for w in ("--set", name)]
SWEEP = "f (kHz);Vpp;Range (um)\n1,2;40;76,5\n1,3;40;75\n"
CORNERS, VOLTS = [0.0, 100.0, 500.0, 600.0, 1000.0], [0.0, 60.0, 60.0, 0.0, 0.0]  # us, V: a trapezoid


def scope(head: str = "Model;DSO\nTime (ms);CH1 (V)\n", step: float = 5.0, factor: float = 1.0) -> str:
    """What an oscilloscope shows of the trapezoid, which starts at 0.2 ms on its clock."""
    times = np.arange(0.0, 1400.0 + step / 2, step)
    volts = np.interp(times - 200.0, CORNERS, VOLTS) / factor
    rows = (f"{t / 1000:.9g};{u:.9g}\n" for t, u in zip(times, volts, strict=True))
    return head + "".join(rows).replace(".", ",")


def options(folder: Path, text: str, **said: Any) -> Options:
    file = folder / "scope.csv"
    file.write_text(text, encoding="utf-8")
    return Options(**({"drive_file": file, "start_us": 200.0} | said))


def read(folder: Path, text: str, **said: Any) -> Group:
    sweep = folder / "sweep.csv"
    sweep.write_text(SWEEP, encoding="utf-8")
    (table,) = read_files([sweep], options(folder, text, **said))
    (group,) = table.groups
    return group


def test_a_recording_is_the_drive_as_it_is(tmp_path: Path) -> None:
    table = read(tmp_path, scope()).drive.table
    assert table is not None and table.recorded
    assert (table.at[0], table.at[-1]) == (0.0, pytest.approx(1.2e-3))
    corners = [0.0, 1e-4, 5e-4, 6e-4, 1e-3]
    np.testing.assert_allclose(np.interp(corners, table.at, table.value), VOLTS, atol=1e-6)


def test_what_it_rested_at_is_recorded_or_given(tmp_path: Path) -> None:
    raised = "Time (ms);CH1 (V)\n" + "".join(f"{k / 10};{10 + (k > 5) * k}\n" for k in range(20))
    assert read(tmp_path, raised, start_us=500.0).drive.idle_v == 10.0
    assert read(tmp_path, raised, start_us=500.0, values=(("idle_v", 9.0),)).drive.idle_v == 9.0
    period = read(tmp_path, raised, start_us=500.0, period_us=1300.0, values=(("idle_v", 9.0),))
    assert period.drive.idle_v == 9.0 and read(tmp_path, raised, start_us=500.0, period_us=1300.0).drive.idle_v == 0.0


@pytest.mark.parametrize("name", ["Rest voltage", "Bias", "DC offset"])
def test_what_a_drive_rests_at_is_no_recording_of_it(name: str, tmp_path: Path) -> None:
    """Though it is the only column of volts: such a column had been read twice, as a setting and as the drive."""
    with pytest.raises(InputError, match="no voltage_v of the drive among"):
        read(tmp_path, scope(f"Time (ms);{name} (V)\n"))


def test_samples_of_one_time_are_a_jump(tmp_path: Path) -> None:
    """Times that an instrument has rounded."""
    rounded = "Time (us);CH1 (V)\n" + "".join(f"{k // 2 * 100};{k}\n" for k in range(24))
    table = read(tmp_path, rounded, start_us=0.0).drive.table
    assert table is not None
    assert table.value.tolist() == [1.0, *range(2, 24)] and table.at[-2:].tolist() == pytest.approx([1.1e-3, 1.1e-3])


@pytest.mark.parametrize(("said", "volts"), [("40:Vpp", 40.0), ("40:Vp", 40.0), ("40", 40.0)])
def test_a_held_amplitude_is_counted_by_its_drive(
    said: str, volts: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a drive from 0 V, peak to peak is the peak; in a column as by --set."""
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text("f (kHz);Range (um)\n1,2;76,5\n1,3;75\n", encoding="utf-8")
    Path("scope.csv").write_text(scope(), encoding="utf-8")
    given = ["import", "sweep.csv", "--set", f"amplitude_v={said}", *RIG]
    own = ["--drive", "scope.csv", "--start", "0.2:ms"]
    for name, drive in (
        ("pulse", ["--waveform", "unipolar_sine"]),
        ("own", own),
        ("period", [*own, "--period", "1:ms"]),
    ):
        assert run(monkeypatch, *given, *drive, "--out", name) == 0
        assert read_experiment(name).groups[0].amplitude_v.tolist() == [volts, volts]


def test_rms_of_a_held_amplitude(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text("f (kHz);Range (um)\n1,2;76,5\n1,3;75\n", encoding="utf-8")
    given = ["import", "sweep.csv", "--set", "amplitude_v=10:Vrms"]
    assert run(monkeypatch, *given, "--waveform", "sine", "--out", "sine", *RIG) == 0
    np.testing.assert_allclose(read_experiment("sine").groups[0].amplitude_v, 10 * 2**0.5, rtol=1e-15)
    assert run(monkeypatch, *given, "--waveform", "unipolar_sine", "--out", "no") == 2
    assert "--set amplitude_v: volts are RMS, and the peak of unipolar_sine does not" in capsys.readouterr().err


def test_a_drive_in_another_sheet(tmp_path: Path) -> None:
    """Of the same workbook; where two sheets may hold it, it is asked for."""
    from openpyxl import Workbook

    book = Workbook()
    tables = {"sweep": [("f (kHz)", "Vp", "Range (um)"), (1.2, 40, 76), (1.3, 40, 75)]}
    tables["scope"] = [("t (ms)", "CH1 (V)"), *((k / 100, 2.0 * k) for k in range(20))]
    for name, rows in tables.items():
        sheet = book.create_sheet(name)
        for row in rows:
            sheet.append(row)
    file = tmp_path / "book.xlsx"
    book.save(file)
    asked = Options(sheets=("sweep",), drive_file=file)
    (table,) = read_files([file], asked)
    drive = table.groups[0].drive.table
    assert drive is not None and drive.value.tolist() == [2.0 * k for k in range(20)]
    book.copy_worksheet(book["scope"]).title = "again"
    book.save(file)
    with pytest.raises(InputError, match="sheets again, scope may hold the drive; say which: --sheet NAME"):
        read_files([file], asked)
    assert read_files([file], replace(asked, sheets=("sweep", "scope")))[0].groups[0].drive.table == drive


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (scope(), {}),
        (scope("x (ms);Monitor (V)\n"), {}),
        (scope(step=0.5), {"every": 10}),
        (scope("x;y\nms;mV\n", factor=1e-3), {}),
        (scope("Time (ms);monitor (V)\n", factor=20.0), {"columns": (Mapping("monitor", "voltage_v", scaled("20V")),)}),
        (scope("Time (ms);m (mV)\n", factor=20e-3), {"columns": (Mapping("m", "voltage_v", scaled("20V")),)}),
    ],
)
def test_a_period_is_scaled_to_its_largest_voltage(text: str, said: dict[str, Any], tmp_path: Path) -> None:
    group = read(tmp_path, text, period_us=1000.0, **said)
    table = group.drive.table
    assert table is not None and not table.recorded
    phases = [0.0, 0.05, 0.1, 0.3, 0.5, 0.55, 0.6, 1.0]
    levels = [0.0, 0.5, 1.0, 1.0, 1.0, 0.5, 0.0, 0.0]
    np.testing.assert_allclose(np.interp(phases, table.at, table.value), levels, atol=0.03)  # means round the corners
    assert group.amplitude_v.tolist() == [40.0, 40.0]  # of a drive from 0 V, peak to peak is the peak


@pytest.mark.parametrize("period_us", [1000.0, None])
def test_means_do_not_change_how_volts_are_counted(period_us: float | None, tmp_path: Path) -> None:
    """A triangle of 60 V, whose means of 20 samples reach 54 V."""
    sweep, times = tmp_path / "sweep.csv", np.arange(0, 1001, 5)
    sweep.write_text("Frequency (Hz);Vpp;Range (um)\n1000;90;31\n", encoding="utf-8")
    volts = np.interp(times, [0.0, 250.0, 750.0, 1000.0], [0.0, 60.0, -60.0, 0.0])
    triangle = "Time (us);CH1 (V)\n" + "".join(f"{t};{u:.6g}\n" for t, u in zip(times, volts, strict=True))
    (table,) = read_files([sweep], options(tmp_path, triangle, start_us=0.0, period_us=period_us, every=20))
    (group,) = table.groups
    assert group.amplitude_v[0] == pytest.approx(45.0) and group.drive.table is not None
    assert group.drive.table.at.size == 12
    assert np.abs(group.drive.table.value).max() == pytest.approx(0.9 if period_us else 54.0, abs=0.02 * 60)


@pytest.mark.parametrize(("low", "amplitude"), [(0.0, 40.0), (-40.0, 20.0), (40.0, 40.0)])
def test_one_recording_gives_one_amplitude(low: float, amplitude: float, tmp_path: Path) -> None:
    """Of 40 V peak to peak, recorded in a file of its own or next to a trace; a step up from rest, too."""
    volts = [low if k % 4 else 40.0 for k in range(16)]
    counted: dict[str, Any] = {"counted": ("pp",), "values": (("amplitude_v", 40.0), ("idle_v", 0.0)), "start_us": 0.0}
    sweep, trace = tmp_path / "sweep.csv", tmp_path / "trace.csv"
    sweep.write_text("Frequency (Hz);Range (um)\n1000;31\n", encoding="utf-8")
    drive = "Time (us);Drive (V)\n" + "".join(f"{10 * k};{u}\n" for k, u in enumerate(volts))
    (table,) = read_files([sweep], options(tmp_path, drive, **counted))
    held = counted["values"] + (("frequency_hz", 1000.0),)
    columns = (Mapping("Drive (V)", "voltage_v", Unit("V")),)
    rows = "".join(f"{10 * k};{u};{k}\n" for k, u in enumerate(volts))
    for heading, said in (
        ("Displacement (um)", {"values": held}),
        ("Displacement 40 Vpp (um)", {"values": held[1:], "counted": ()}),
    ):
        trace.write_text(f"Time (us);Drive (V);{heading}\n{rows}", encoding="utf-8")
        (next_to,) = read_files([trace], Options(**({**counted, "start_us": None, "columns": columns} | said)))
        assert table.groups[0].amplitude_v[0] == next_to.groups[0].amplitude_v[0] == amplitude


REFUSED: dict[str, tuple[str, dict[str, Any], str]] = {
    "before the start": (scope().replace("\n0;", "\n-0,1;"), {"start_us": None}, "--start 0"),
    "too short": (scope(), {"period_us": 2000.0}, "correct --start or --period, or record longer"),
    "too coarse": (scope(step=50.0), {"every": 9, "period_us": 1000.0}, "a smaller --every"),
    "no voltage": (scope("Time (ms);CH1 (N)\n"), {}, "no voltage_v of the drive"),
    "two voltages": (
        scope("Time (ms);CH1 (V);CH2 (V)\n").replace("\n0,", "\n0;0,"), {}, "'CH2 (V)' could all be voltage_v",
    ),
    "out of order": (scope() + "0,1;0\n", {}, "100 comes after 1400"),
    "a word": (scope() + "1,5;over\n", {}, "is not a number"),
    "a unit in a cell": (scope().replace("0,5;60", "0,5;60 mV"), {}, "'60 mV' has another unit than its column, V"),
    "volts that are counted": (scope("Time (ms);CH1 (Vpp)\n"), {}, "its volts are said to be peak to peak"),
    "volts beyond any rig": (scope(factor=1e-6), {}, "is not between -1e+06 and 1e+06"),
    "a time beyond any rig": (scope() + "1e12;0\n", {}, "is not between 0 and 1e+12"),
    "what it rested at": (scope(), {"start_us": 300.0}, "goes from 0 to 57 V before the start of the drive, where it"),
    "nothing before it": (
        "Time (us);CH1 (V)\n" + "".join(f"{t};{60 - t}\n" for t in range(12)), {"start_us": None},
        "say --set idle_v=0 or --set idle_v=60",
    ),
    "too long": (scope(), {"most_samples": 100}, "give a larger --every"),
    "another waveform": (scope(), {"waveforms": ("sine",)}, "--drive is given, and no table has it"),
    "RMS": (scope(), {"columns": (Mapping("Vpp", "amplitude_v", Unit("V", "rms")),)}, "the peak of table does not"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "said", "message"), REFUSED.values(), ids=REFUSED.keys())
def test_a_recording_that_is_none_is_refused(text: str, said: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, text, **said)
    assert message in str(caught.value)


def test_a_column_of_waveforms_next_to_a_drive_is_to_be_left_out(tmp_path: Path) -> None:
    """Once it is ignored, the drive is that of all readings."""
    (tmp_path / "scope.csv").write_text("phase,level\n0,0\n0.25,1\n1,0\n")
    (tmp_path / "sweep.csv").write_text("Signal;f (Hz);Vp;Range (um)\nsine;1000;20;76\nsine;1500;20;70\n")
    given = Options(drive_file=tmp_path / "scope.csv")
    with pytest.raises(InputError, match="a column gives other waveforms; say --column HEADING=ignore of that column"):
        read_files([tmp_path / "sweep.csv"], given)
    (table,) = read_files([tmp_path / "sweep.csv"], replace(given, columns=(Mapping("Signal", "ignore"),)))
    assert table.groups[0].drive.table is not None


def test_a_drive_is_that_of_the_tables_that_have_no_other(tmp_path: Path) -> None:
    """What is given for a waveform stays with it: a recorded drive has bias and phase in it."""
    for name, text in (("one", SWEEP), ("two", "Range (um)\n76,5\n75\n")):
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    held = {"bias_v": (5.0, None), "phase_deg": (90.0, None), "idle_v": (5.0, 0.0)}
    launch = {"frequency_hz": (None, 1000.0), "amplitude_v": (None, 60.0)}
    given = options(tmp_path, scope(), waveforms=("sine", "table"), values=tuple((held | launch).items()))
    one, two = (table.groups[0] for table in read_files([tmp_path / "one.csv", tmp_path / "two.csv"], given))
    assert (one.drive.waveform, one.drive.table, one.drive.bias_v, one.drive.phase_deg) == ("sine", None, 5.0, 90.0)
    assert two.drive.table is not None and two.drive.table.recorded and two.drive.bias_v == 0.0
    alone = (("frequency_hz", 1000.0), ("amplitude_v", 60.0))
    with pytest.raises(InputError, match="bias_v is given, and no table takes it"):
        read_files([tmp_path / "two.csv"], replace(given, waveforms=(), values=(("bias_v", 5.0), *alone)))


def test_a_trace_keeps_the_drive_that_was_recorded_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """--drive is that of the tables that have none; the file of the trace may be it, too."""
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text("f (kHz);Vp;Range (um)\n1,2;40;76\n1,3;40;75\n", encoding="utf-8")
    Path("other.csv").write_text(scope(), encoding="utf-8")
    for heading in ("CH1 (V)", "Drive (V)"):
        rows = "".join(f"{5 * k};{k / 2:g};{k * k}\n" for k in range(30))
        Path("scope.csv").write_text(f"Time (us);{heading};CH2 (mV)\n{rows}", encoding="utf-8")
        held = ["--set", "frequency_hz=,1.2:kHz", "--set", "amplitude_v=,20", "--start", "0:us", *RIG]
        mapped = ["--column", "CH2 (mV)=velocity_mm_s:5mm/s/V", "--column", f"{heading}=voltage_v:2V/V"]
        for drive in ("scope.csv", "other.csv"):
            words = ["import", "sweep.csv", "scope.csv", "--drive", drive, *held, "--out", f"{heading[0]}-{drive[:-4]}"]
            if (heading, drive) == ("Drive (V)", "other.csv"):
                assert run(monkeypatch, *words, *mapped[:2]) == 2
                said = capsys.readouterr().err
                assert "column 'Drive (V)' is the drive over time, and --drive gives another; say --column" in said
                assert "if it is that of this trace, or --column 'Drive (V)=ignore'" in said
            assert run(monkeypatch, *words, *mapped) == 0
            launches, trace = read_experiment(words[-1]).groups
            own = trace.drive.table
            assert own is not None and own.value.tolist() == [float(k) for k in range(30)]
            assert launches.drive.table is not None
            assert (launches.drive.table.value.tolist() == own.value.tolist()) is (drive == "scope.csv")


@pytest.mark.parametrize("own", [True, False])
def test_volts_peak_to_peak_are_counted_by_the_drive_that_a_trace_has(own: bool, tmp_path: Path) -> None:
    """Its own goes from -20 to 20 V, the other, which is a file of its own, from 0 to 40 V."""
    scopes = {}
    for name, least in (("own", -20.0), ("other", 0.0)):
        volts = [least + 20 + 20 * math.sin(k / 20) if k else 0.0 for k in range(200)]
        scopes[name] = [f"{u:.6f}" for u in (volts if name == "own" else [*volts[:1], *volts[1:]])]
    rows = "".join(f"{5 * k};{scopes['own'][k]};{k * k / 100}\n" for k in range(200))
    trace = tmp_path / "trace.csv"
    trace.write_text(f"Time (us);CH1 (V);Velocity (mm/s)\n{rows}", "utf-8")
    other = tmp_path / "other.csv"
    other.write_text("Time (us);CH1 (V)\n" + "".join(f"{5 * k};{u}\n" for k, u in enumerate(scopes["other"])), "utf-8")
    held = {"values": (("frequency_hz", 2000.0), ("amplitude_v", 40.0), ("idle_v", 0.0)), "counted": ("pp",)}
    mapped = Mapping("CH1", "voltage_v" if own else "ignore", scaled("1V/V") if own else None)
    options = Options(columns=(mapped,) if own else (), drive_file=other, start_us=0.0, **held)  # type: ignore[arg-type]
    if not own:
        trace.write_text(trace.read_text("utf-8").replace("CH1 (V)", "Note"), "utf-8")
    (table,) = read_files([trace], options)
    assert table.groups[0].amplitude_v[0] == pytest.approx(20.0 if own else 40.0, rel=1e-2)


def test_what_was_held_may_be_blank_for_a_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in "ab":
        Path(f"{name}.csv").write_text("f (kHz);Vp;Range (um)\n1,2;40;76\n1,3;40;75\n", encoding="utf-8")
    words = ["import", "a.csv", "b.csv", "--waveform", "sine", *RIG]
    assert run(monkeypatch, *words, "--set", "cycles=,3", "--out", "rig") == 0
    assert [g.drive.cycles for g in read_experiment("rig").groups] == [math.inf, 3.0]
    assert run(monkeypatch, *words, "--set", "cycles=,", "--out", "none") == 2
    assert run(monkeypatch, *words, "--set", "cycles=,3,", "--out", "none") == 2


def test_one_period_in_psafits_own_form_is_the_drive(tmp_path: Path) -> None:
    table = read(tmp_path, "Phase, Level\n0,0\n0.25,0.5\n1,0\n", start_us=None).drive.table
    assert table is not None and not table.recorded
    assert (table.at.tolist(), table.value.tolist()) == ([0.0, 0.25, 1.0], [0.0, 0.5, 0.0])
    both = [tmp_path / name for name in ("sweep.csv", "scope.csv")]
    assert len(read_files(both, Options(drive_file=both[1]))) == 1, "it is no table, though it is among them"
    for text, said, message in (
        ("phase;level\n0;0\n0,25;0,5\n1;0\n", {}, "separate the cells by commas, decimals by points: phase,level"),
        ("phase,level\n0,0\n0.25,x\n1,0\n", {}, "scope.csv:3: level 'x' is not a number"),
        ("phase,level\n0,0\n1,0\n", {"period_us": 1000.0}, "leave it out: the file holds one period"),
        ("phase,level\n0,0\n1,0\n", {"start_us": 1.0}, "--start is of traces"),
    ):
        with pytest.raises(InputError) as caught:
            read(tmp_path, text, **({"start_us": None} | said))
        assert message in str(caught.value)


LAUNCHES = "pulse;f (kHz);Vp;Range (um)\na;1,2;30;76,5\na;1,2;30;75\nb;1,2;60;175\n"


def recordings(folder: Path) -> Path:
    """A folder of two recordings, of 30 and of 60 V."""
    (folder / "scope").mkdir()
    for name, factor in (("a", 2.0), ("B", 1.0)):
        (folder / "scope" / f"{name}.csv").write_text(scope(factor=factor), encoding="utf-8")
    (folder / "scope" / ".hidden").write_text("no recording", encoding="utf-8")
    (folder / "launches.csv").write_text(LAUNCHES, encoding="utf-8")
    return folder / "scope"


def test_each_group_has_the_recording_that_is_called_as_it_is(tmp_path: Path) -> None:
    folder = recordings(tmp_path)
    said = Options(columns=(Mapping("pulse", "group", None),), start_us=200.0)
    (table,) = read_files([tmp_path / "launches.csv"], said, drives=[folder])
    assert [(g.id, g.drive.file, g.n_points) for g in table.groups] == [
        ("a", "drive-a.csv", 2),
        ("b", "drive-B.csv", 1),
    ]
    assert [float(g.drive.table.value.max()) for g in table.groups if g.drive.table] == pytest.approx([30.0, 60.0])
    assert [one.file.name for one in table.recordings] == ["a.csv", "B.csv"]


def test_recordings_that_are_read_the_same_way_are_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recordings(tmp_path)
    monkeypatch.chdir(tmp_path)
    words = ["import", "launches.csv", "--drive", "scope", "--column", "pulse=group", "--start", "0.2:ms", *RIG]
    assert run(monkeypatch, *words, "--out", "rig") == 0
    said = capsys.readouterr().out
    assert "a.csv: read like B.csv\n" not in said and "B.csv: read like a.csv\n" in said
    assert said.count("from 'Time (ms)'") == 1
    assert [g.drive.file for g in read_experiment("rig").groups] == ["drive-a.csv", "drive-B.csv"]


def test_each_file_has_the_recording_in_its_place(tmp_path: Path) -> None:
    folder, files = recordings(tmp_path), [tmp_path / name for name in ("one.csv", "two.csv")]
    for file in files:
        file.write_text(SWEEP, encoding="utf-8")
    said = Options(start_us=200.0, values=(("idle_v", (None, 1.5)),))
    groups = [g for table in read_files(files, said, drives=[folder / "B.csv", folder / "a.csv"]) for g in table.groups]
    assert [(g.id, g.file, g.drive.file) for g in groups] == [
        (1, "group1.csv", "drive-B.csv"), (2, "group2.csv", "drive-a.csv"),
    ]  # fmt: skip
    assert [g.drive.idle_v for g in groups] == [0.0, 1.5], "what is said of each table stays with it"
    (alone,) = read_files(files[:1], Options(start_us=200.0), drives=[folder / "a.csv"])
    assert alone.groups[0].drive.file == "drive.csv", "one recording is that of all groups"


def test_files_have_the_recording_of_their_name_in_a_folder(tmp_path: Path) -> None:
    """Names decide, not an order; a label may be the name of a file; one recording alone is no other group's."""
    folder = recordings(tmp_path)
    files = [tmp_path / name for name in ("b.csv", "a.csv")]
    for file in files:
        file.write_text(SWEEP, encoding="utf-8")
    tables = read_files(files, Options(start_us=200.0), drives=[folder])
    assert [g.drive.file for t in tables for g in t.groups] == ["drive-B.csv", "drive-a.csv"]
    grouped = Options(columns=(Mapping("pulse", "group", None),), start_us=200.0)
    launches = tmp_path / "launches.csv"
    launches.write_text(LAUNCHES.replace("\nb;", "\nb.csv;"), encoding="utf-8")
    (table,) = read_files([launches], grouped, drives=[folder])
    assert [g.drive.file for g in table.groups] == ["drive-a.csv", "drive-B.csv"]
    (folder / "B.csv").unlink()
    for file, said in ((launches, grouped), (files[0], Options(start_us=200.0))):
        with pytest.raises(InputError, match="no recording of --drive is called 'b"):
            read_files([file], said, drives=[folder])


def test_labelled_traces_have_the_recordings_of_their_files(tmp_path: Path) -> None:
    folder, names = recordings(tmp_path), ("b", "a")
    for name in names:
        rows = "".join(f"{50 * k};{k * k / 10};{name}\n".replace(".", ",") for k in range(12))
        (tmp_path / f"{name}.csv").write_text(f"t (us);x (um);pulse\n{rows}", encoding="utf-8")
    values = (("frequency_hz", 500.0), ("amplitude_v", 30.0))
    said = Options(columns=(Mapping("pulse", "group", None),), start_us=0.0, values=values)
    tables = read_files([tmp_path / f"{name}.csv" for name in names], said, drives=[folder])
    assert [g.drive.file for t in tables for g in t.groups] == ["drive-B.csv", "drive-a.csv"]


def test_recordings_without_a_group_and_groups_without_one_are_refused(tmp_path: Path) -> None:
    folder, file = recordings(tmp_path), tmp_path / "launches.csv"
    grouped = Options(columns=(Mapping("pulse", "group", None),), start_us=200.0)
    a, b, other = folder / "a.csv", folder / "B.csv", tmp_path / "a.txt"
    for copy in (other, folder / "c.csv"):
        copy.write_text(scope(), encoding="utf-8")
    (tmp_path / "empty").mkdir()
    for drives, said, message in (
        ([a, folder / "c.csv"], grouped, "no recording of --drive is called 'b'; add 'b.csv'"),
        ([folder], grouped, "1 recording of --drive has no group: 'c.csv'; leave out, or take out of the folder"),
        ([folder], replace(grouped, columns=()), "'launches'; add 'launches.csv', or say --column HEADING=group of a"),
        ([a, b], replace(grouped, columns=()), "2 recordings of --drive and 1 file; give one for each file"),
        ([a, other], grouped, "two recordings of --drive are called 'a'; rename one"),
        ([tmp_path / "empty"], grouped, "the folder holds no file"),
        (
            [tmp_path / "a b.csv", tmp_path / "a_b.csv"],
            grouped,
            "two recordings of --drive are called 'a b'; rename one",
        ),
    ):
        with pytest.raises(InputError) as caught:
            read_files([file], said, drives=drives)
        assert message in str(caught.value)


def test_the_command_writes_the_drive_and_check_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text(SWEEP, encoding="utf-8")
    Path("scope.csv").write_text(scope(), encoding="utf-8")
    assert run(monkeypatch, "import", "sweep.csv", "--waveform", "table", "--out", "rig") == 2
    assert "--drive FILE" in capsys.readouterr().err
    words = ["import", "sweep.csv", "--drive", "scope.csv", "--start", "0.2:ms", *RIG]
    assert run(monkeypatch, *words, "--period", "1:ms", "--out", "rig") == 0
    assert run(monkeypatch, "import", "sweep.csv", "--period", "1:ms", "--waveform", "sine", "--out", "no") == 2
    said = capsys.readouterr()
    assert "--period is of a recorded drive" in said.err
    assert "drive of 201 rows, 0 to 1 per volt of amplitude_v" in said.out
    assert run(monkeypatch, *words, "--out", "once") == 0
    assert "0 to 60 V" in capsys.readouterr().out
    assert read_experiment("rig").warnings == ()
    (warning,) = read_experiment("once").warnings
    assert "the simulation is the same for every row" in warning


def test_a_recording_of_one_row_is_no_drive(tmp_path: Path) -> None:
    """Next to a trace; it was a traceback."""
    file = tmp_path / "trace.csv"
    file.write_text("Time (us),Displacement (um),Drive (V)\n0,1,0\n", encoding="utf-8")
    with pytest.raises(InputError, match="no sample lies after the start of the drive"):
        held = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
        read_files([file], Options(values=held, columns=(Mapping("Drive (V)", "voltage_v", Unit("V")),)))


def test_readings_in_a_sensors_volts_have_their_known_errors(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("f (Hz);Vp;Launch (mV);Sigma (mV);Range (um);Sigma range (nm)\n1;20;3000;10;;\n2;20;;;76;2000\n")
    columns = tuple(
        Mapping(heading, name, scaled("5mm/s/V"))
        for heading, name in (("Launch", "launch_speed_mm_s"), ("Sigma (mV)", "sigma_mm_s"))
    )
    asked = Options(columns=columns, waveforms=("square",))
    (table,) = read_files([file], asked)
    (group,) = table.groups
    assert group.reading.tolist() == [76.0, 15.0] and group.sigma is not None
    assert group.sigma.tolist() == [2.0, 0.05]
    file.write_text(file.read_text().replace(";10;", ";;"))
    with pytest.raises(InputError, match=r"a\.csv:2: sigma_mm_s is empty; enter the known error"):
        read_files([file], asked)
    with pytest.raises(InputError, match="sigma_n is given, and no table takes it"):
        read_files([file], replace(asked, columns=columns[:1], values=(("sigma_n", 1.0),)))


def test_a_fault_that_two_groups_share_is_named_once() -> None:
    faults = Faults()
    for _ in range(2):
        faults.add(InputError("what", "remedy", file="drive.csv"))
    with pytest.raises(InputError, match=r"^drive\.csv: what; remedy$"):
        faults.end()

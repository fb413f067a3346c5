"""Traces at several conditions in one table, and drives recorded next to them: read right, or asked about."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commands import run
from keyed import CONSTANTS

from psafit.errors import InputError
from psafit.experiment import Conditions, Group, Plan, read_experiment
from psafit.experiment.importing import Mapping, Options, read_files
from psafit.experiment.importing.blocks import blocks, rising, runs_on
from psafit.experiment.importing.headings import heading
from psafit.experiment.importing.units import Unit, scaled
from psafit.experiment.plausible import suspicious_readings
from psafit.experiment.records import Constants
from psafit.observables import OBSERVABLES, VELOCITY
from psafit.simulate import Design, readings

HELD = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
RIG = [word for name, value in CONSTANTS.items() for word in ("--set", f"{name}={value}")]
TIMES = np.arange(12) * 5.0
MOTION = np.round(0.01 * TIMES**1.5, 3)
VOLTS = np.round(20 * np.sin(2e-6 * np.pi * 1200 * TIMES), 4)
THREE = ((1200.0, 20.0), (1300.0, 20.0), (1300.0, 30.0))
Row = tuple[float, ...]


def long(conditions: tuple[Row, ...] = THREE, later: float = 0.0) -> list[Row]:
    """Rows of frequency, amplitude, time and motion, each trace `later` than the one before."""
    return [(f, v, t + later * k, y) for k, (f, v) in enumerate(conditions) for t, y in zip(TIMES, MOTION, strict=True)]


def text(head: str, rows: list[Row], separator: str = ";", decimal: str = ".") -> str:
    lines = (separator.join(f"{x:.10g}".replace(".", decimal) for x in row) for row in rows)
    return "\n".join([head, *lines, ""])


def driven(times: np.ndarray = TIMES, volts: np.ndarray = VOLTS, motion: np.ndarray = MOTION) -> list[Row]:
    return [tuple(map(float, row)) for row in zip(times, volts, motion, strict=True)]


def read(folder: Path, content: str, **options: Any) -> tuple[Group, ...]:
    file = folder / "trace.csv"
    file.write_text(content, encoding="utf-8")
    (table,) = read_files([file], Options(**({"waveforms": ("sine",)} | options)))
    return table.groups


def refused(folder: Path, content: str, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        read(folder, content, **options)
    (line,) = str(caught.value).splitlines()
    assert line.isprintable() and "trace.csv" in line
    return line


# --- several conditions -------------------------------------------------------------------------------------------

HEAD = "f (Hz);U (V);t (us);displacement (um)"
PEAK = {"volts": "peak"}
MIXED = sorted(long(), key=lambda row: row[2])
SEVERAL: dict[str, tuple[str, dict[str, Any]]] = {
    "one below the other": (text(HEAD, long()), PEAK),
    "decimal commas": (text(HEAD, long(), decimal=","), PEAK),
    "tabs, peak to peak": (text("f (Hz)\tVpp\tt (us)\tx (um)", [(f, 2 * v, *r) for f, v, *r in long()], "\t"), {}),
    "other units": (
        text("f (kHz);U (Vp);t (ms);Auslenkung (mm)", [(f / 1e3, v, t / 1e3, y / 1e3) for f, v, t, y in long()]), {},
    ),
    "a row of units": (text("f;U;t;displacement\nHz;Vp;us;um", long()), {}),
    "columns in another order": (text("displacement (um);t (us);Vp;f (Hz)", [r[::-1] for r in long()]), {}),
    "mixed row by row, by time": (text(HEAD, MIXED), PEAK),
    "mapped": (text(HEAD, long()), PEAK | {"columns": (Mapping("displacement (um)", "displacement_um", Unit("um")),)}),
    "velocities, the time starting again": (text(HEAD.replace("displacement (um)", "velocity (mm/s)"), long()), PEAK),
    "samples before each start": (
        text(HEAD, [r for c in THREE for r in ((*c, -5.0, 0.0), *long((c,)))]), PEAK | {"start_us": 0.0},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options"), SEVERAL.values(), ids=SEVERAL.keys())
def test_traces_at_several_conditions_are_groups(content: str, options: dict[str, Any], tmp_path: Path) -> None:
    groups = read(tmp_path, content, **options)
    assert [(g.frequency_hz[0], g.amplitude_v[0]) for g in groups] == [pytest.approx(c) for c in THREE]
    assert [g.file for g in groups] == ["group1.csv", "group2.csv", "group3.csv"]
    for group in groups:
        assert group.time_us is not None and np.ptp(group.frequency_hz) == np.ptp(group.amplitude_v) == 0
        np.testing.assert_allclose(group.time_us, TIMES, rtol=1e-12)
        np.testing.assert_allclose(group.reading, MOTION, rtol=1e-12)


def test_a_trace_begins_where_the_time_starts_again(tmp_path: Path) -> None:
    """Repetitions of one condition, with a condition in between or none; a label may say it, too."""
    again = (THREE[0], THREE[1], THREE[0])
    assert [g.frequency_hz[0] for g in read(tmp_path, text(HEAD, long(again)), **PEAK)] == [1200, 1300, 1200]
    alone = [row[2:] for row in long()]
    assert len(read(tmp_path, text("t (us);x (um)", alone), values=HELD)) == 3
    labelled = [(k // 12, *row) for k, row in enumerate(alone)]
    label = (Mapping("Run", "group"),)
    assert len(read(tmp_path, text("Run;t (us);x (um)", labelled), values=HELD, columns=label)) == 3


def wide(*headings: str) -> str:
    return text(f"t (us);{';'.join(headings)}", [(t, *[y] * len(headings)) for t, y in zip(TIMES, MOTION, strict=True)])


TWO = ((1200.0, 20.0), (1300.0, 20.0))
WIDE: dict[str, tuple[str, dict[str, Any]]] = {
    "both": (wide("Displacement 1200 Hz, 20 Vp (um)", "Displacement 1.3 kHz, 40 Vpp (um)"), {}),
    "frequency": (wide("x @ 1,2 kHz (um)", "x @ 1,3 kHz (um)"), {"values": HELD[1:]}),
    "a row of units": (
        wide("x 1200 Hz", "x 1300 Hz").replace("t (us)", "t").replace("\n", "\nus;um;um\n", 1), {"values": HELD[1:]},
    ),
    "how volts are counted": (wide("x_1200Hz_40V_um", "x_1300Hz_40V_um"), {"volts": "pp"}),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options"), WIDE.values(), ids=WIDE.keys())
def test_headings_may_name_the_conditions(content: str, options: dict[str, Any], tmp_path: Path) -> None:
    groups = read(tmp_path, content, **options)
    assert [(g.frequency_hz[0], g.amplitude_v[0]) for g in groups] == [pytest.approx(c) for c in TWO]
    assert all(g.reading.tolist() == MOTION.tolist() for g in groups)


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ("x 1.2 kHz, 20 Vpp (um)", [("frequency_hz", 1200, None), ("amplitude_v", 20, "pp")]),
        ("x 1.200 Hz (um)", []),
        ("CH1 2 V/div (um)", []),
        ("x2 (um)", []),
        ("x 5 parsec (um)", []),
    ],
)
def test_conditions_of_a_heading(said: str, found: list[Any]) -> None:
    assert [(c.column, c.value, c.volts) for c in heading(said).at] == found


RUNNING = "time_us goes on to 120 where another trace begins"
SPEEDS = HEAD.replace("displacement (um)", "velocity (mm/s)")
UNSURE: dict[str, tuple[str, dict[str, Any], str]] = {
    "how volts are counted": (text(HEAD, long()), {}, "--volts peak, --volts pp"),
    "a clock that runs on": (text(HEAD.replace("U (V)", "Vp"), long(((1200, 20), (1300, 20), (1400, 20)), 60.0)), {},
                             RUNNING),
    "one sample more": (
        text(HEAD, [*long(), (1400.0, 20.0, 0.0, 0.0)]), PEAK, ":38: 1 sample after the start of the drive; a trace",
    ),
    "one sample each": (
        text(HEAD, [(1000 + t, v, t, y) for _, v, t, y in long(THREE[:1])]), PEAK, "sort the rows by trace and time",
    ),
    "one sample each, mapped": (
        text(HEAD, [(1000 + t, v, t, y) for _, v, t, y in long(THREE[:1])]),
        PEAK | {"columns": (Mapping("displacement (um)", "displacement_um"),)}, "and 12 of 12 traces have fewer",
    ),
    "samples before each start": (
        text(HEAD, [(f, v, t - 5, y) for f, v, t, y in long()]), PEAK, "time_us begins at -5, before the start of the",
    ),
    "out of order": (text(HEAD, [*long(THREE[:1]), (1200.0, 20.0, 3.0, 1.0)]), PEAK, "3 comes after 55"),
    "a condition that is no number": (
        text(SPEEDS, long()).replace("1300;30;25;", "over;30;25;"), PEAK, "frequency_hz 'over' is not a number",
    ),
    "an error of a spreadsheet": (
        text(HEAD, long()).replace("1300;30;25;", "#N/A;30;25;"), PEAK, "frequency_hz '#N/A' is not a number",
    ),
    "an amplitude that is no number": (
        text(HEAD, long()).replace(";30;25;", ";over;25;"), PEAK, "amplitude_v 'over' is not a number",
    ),
    "speeds at one condition": (
        text(SPEEDS, long(THREE[:1])), PEAK, "'velocity (mm/s)=velocity_mm_s' or --column 'velocity (mm/s)=launch_",
    ),
    "ranges at one condition": (
        text("Time (ms);f (Hz);Vp;Range (um)", [(t, f, v, 1 + y) for f, v, t, y in long(THREE[:1])]),
        {}, "'Range (um)=displacement_um', or --column 'Time (ms)=ignore' if each row is a launch",
    ),
    "forces at one condition": (
        text("Time (ms);f (Hz);Vp;Peak force (N)", [(t, f, v, 1 + y) for f, v, t, y in long(THREE[:1])]),
        {}, "psafit reads no such recording: give peak_force_n of each launch",
    ),
    "speeds at conditions by turns": (
        text(SPEEDS, [(f, v, 10.0 * k, y) for k, (f, v, _, y) in enumerate(MIXED)]), PEAK, "and the time a clock",
    ),
    "speeds mixed by time": (text(SPEEDS, MIXED), PEAK, "and the time a clock"),
    "a condition twice": (text(HEAD, long()), PEAK | {"values": HELD[:1]}, "frequency_hz is given, and column 'f"),
    "headings and --set": (wide("x 1200 Hz (um)", "x 1300 Hz (um)"), {"values": HELD}, "heading 'x 1200 Hz (um)'"),
    "one heading": (wide("x 1200 Hz (um)", "x (um)"), {"values": HELD[1:]}, "and heading 'x (um)' does not"),
    "volts of a heading": (wide("x 20 V (um)", "x 30 V (um)"), {"values": HELD[:1]}, "--volts peak"),
    "a filter": (wide("x lowpass 10 kHz (um)"), {"values": HELD}, "none is a motion"),
    "a frequency of nothing": (wide("x 0 Hz (um)"), {"values": HELD[1:]}, "heading 'x 0 Hz (um)' is not positive"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "said"), UNSURE.values(), ids=UNSURE.keys())
def test_conditions_that_are_not_clear_are_asked_for(
    content: str, options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    assert said in refused(tmp_path, content, **options)


CLOCKS = {
    "ranges": text("Time (s);f (Hz);Vp;Range (um)", [(t, f, v, 1 + y) for f, v, t, y in long()]),
    "speeds, sweep": text("Time (s);f (Hz);Vp;Velocity (mm/s)", [(t, f + t, v, y) for f, v, t, y in long(THREE[:1])]),
    "speeds, repeated": text("Time (s);f (Hz);Vp;Velocity (mm/s)", [(t, f, v, y) for f, v, t, y in long(later=60)]),
    "a displacement, too": text("Time (s);f (Hz);Vp;x (um);Range (um)", [(t, f, v, y, y) for f, v, t, y in long()]),
    "hours": "\n".join(["Time;f (Hz);Vp;Velocity (mm/s)", *(f"12:03:{k:02d};1200;20;{k}" for k in range(12)), ""]),
}


@pytest.mark.parametrize("content", CLOCKS.values(), ids=CLOCKS.keys())
def test_launches_with_a_clock_remain_launches(content: str, tmp_path: Path) -> None:
    (group,) = read(tmp_path, content)
    assert group.time_us is None and group.n_points == content.count("\n") - 1


def test_blocks() -> None:
    """By hand: where the time starts again, where a condition changes, mixed by time, and clocks that run on."""
    assert blocks("aaa", [0, 1, 2]) == [[0, 1, 2]]
    assert blocks("aaaa", [0, 1, 0, 1]) == [[0, 1], [2, 3]]
    assert blocks("aabb", [0, 1, 0.5, 2]) == [[0, 1], [2, 3]]
    assert blocks("abab", [0, 0, 1, 1]) == [[0, 2], [1, 3]]
    assert blocks("aaa", [0, 2, 1]) == [[0, 1, 2]] and not rising([[0, 1, 2]], [0, 2, 1])
    assert runs_on([[0, 1], [2, 3]], [0, 1, 2, 3]) == 2
    assert runs_on([[0, 1], [2, 3]], [0, 1, 0.5, 3]) is None
    assert runs_on([[0, 2], [1, 3]], [0, 0, 1, 1]) is None
    assert runs_on([[0, 1, 4, 5], [2, 3]], [0, 1, 2, 3, 4, 5]) == 2


# --- recorded drives ----------------------------------------------------------------------------------------------

CHANNELS = "Time (us);CH1 (V) drive;CH2 (mV) vibrometer"
SENSOR = Mapping("CH2 (mV) vibrometer", "velocity_mm_s", scaled("5mm/s/V"))
NOTHING_SAID: dict[str, Any] = {"waveforms": (), "values": HELD}
DRIVEN: dict[str, tuple[str, dict[str, Any], float]] = {
    "channels": (
        text(CHANNELS, driven(motion=200 * MOTION)), {"columns": (SENSOR,)}, 1.0,
    ),
    "by its channel, behind an amplifier": (
        text("Time (us);CH1 (mV);x (um)", driven(volts=1000 * VOLTS)),
        {"columns": (Mapping("CH1", "voltage_v", scaled("20V/V")),)}, 20.0,
    ),
    "in millivolts, by number": (
        text("Time (us);a;x (um)", driven(volts=1000 * VOLTS)),
        {"columns": (Mapping("2", "voltage_v", Unit("mV")),)}, 1.0,
    ),
    "turned": (
        text("Time (us);CH1 (V);x (um)", driven()), {"columns": (Mapping("CH1", "voltage_v", scaled("-1V/V")),)}, -1.0,
    ),
    "decimal commas, seconds": (
        text("Zeit (s);Antriebsspannung (V);Weg (µm)", driven(TIMES * 1e-6), decimal=","), {}, 1.0,
    ),
    "psafit's own": (text("time_us,voltage_v,displacement_um", driven(), ","), {}, 1.0),
    "called a table": (text("Time (us);Piezo voltage (V);x (um)", driven()), {"waveforms": ("table",)}, 1.0),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "factor"), DRIVEN.values(), ids=DRIVEN.keys())
def test_a_recorded_drive_is_that_of_the_group(
    content: str, options: dict[str, Any], factor: float, tmp_path: Path
) -> None:
    (group,) = read(tmp_path, content, **(NOTHING_SAID | options))
    assert (group.waveform, group.frequency_hz[0], group.amplitude_v[0]) == ("table", 1200, 20)
    table = group.drive.table
    assert table is not None and table.recorded and group.drive.settings == {"drive": "drive1.csv"}
    np.testing.assert_allclose(table.at, TIMES * 1e-6, rtol=1e-12)
    np.testing.assert_allclose(table.value, factor * VOLTS, rtol=1e-12)
    np.testing.assert_allclose(group.reading, MOTION, rtol=1e-9)


EARLY = np.array([-7.5, -5.0, -2.5])


def test_the_start_shifts_the_drive_as_well_and_every_thins_the_trace_alone(tmp_path: Path) -> None:
    """What the drive rested at is the mean before the start, whose voltage lies between two samples."""
    times, volts = np.append(EARLY, TIMES + 1.5), np.append([10.1, 10.0, 9.9], VOLTS + 10)
    content = text("t (us);drive (V);x (um)", driven(times, volts, np.append([0.2] * 3, MOTION + 0.2)))
    options = NOTHING_SAID | {"start_us": 0.5, "from_rest": True, "every": 3, "least_samples": 4}
    (group,) = read(tmp_path, content, **options)
    table = group.drive.table
    assert group.time_us is not None and table is not None
    np.testing.assert_allclose(group.time_us, TIMES[::3] + 1)
    np.testing.assert_allclose(group.reading, MOTION[::3], atol=1e-12)
    assert group.drive.idle_v == 10.0
    np.testing.assert_allclose(table.at * 1e6, np.append(0.0, TIMES + 1))
    np.testing.assert_allclose(table.value, np.append(9.9 + 0.1 * 3 / 4, VOLTS + 10))
    (group,) = read(tmp_path, content, **(options | {"values": (*HELD, ("idle_v", 0.0))}))
    assert group.drive.idle_v == 0.0


def test_each_condition_has_its_own_drive(tmp_path: Path) -> None:
    head = "f (Hz);t (us);drive voltage (V);x (um)"
    rows = [(f, t, v * f / 1000, y) for f in (1000.0, 1100.0) for t, v, y in driven()]
    first, second = read(tmp_path, text(head, rows), waveforms=(), values=HELD[1:])
    assert (first.drive.file, second.drive.file) == ("drive1.csv", "drive2.csv")
    assert first.drive.table is not None and second.drive.table is not None
    np.testing.assert_allclose(second.drive.table.value, 1.1 * first.drive.table.value)


def test_a_drive_has_the_samples_that_its_trace_lacks(tmp_path: Path) -> None:
    """Two motions and one drive; of one the reading at 25 us is missing."""
    rows = [(t, v, y, y) for t, v, y in driven()]
    head = "t (us);drive (V);x @ 1.2 kHz (um);x @ 1.3 kHz (um)"
    content = text(head, rows).replace(f"\n25;{VOLTS[5]:.10g};{MOTION[5]:.10g};", f"\n25;{VOLTS[5]:.10g};;")
    first, second = read(tmp_path, content, waveforms=(), values=HELD[1:])
    assert (first.n_points, second.n_points) == (11, 12) and first.drive == second.drive
    assert first.drive.table is not None and first.drive.table.value.tolist() == VOLTS.tolist()


DRIVE_TOO = text("Time (us);Drive (V);x (um)", driven())
UNSAID = text("Time (us);U (V);x (um)", driven())
ASKED: dict[str, tuple[str, dict[str, Any], str]] = {
    "which channel": (UNSAID, {}, "say --column 'U (V)=voltage_v:V' or --column 'U (V)=ignore'"),
    "a waveform": (DRIVE_TOO, {"waveforms": ("sine",)}, "say --waveform table for this table, or"),
    "no frequency": (DRIVE_TOO, {"values": ()}, "nothing says frequency_hz and amplitude_v of its drive"),
    "what it rested at": (
        text("t (us);drive (V);x (um)", driven(volts=VOLTS + 10)), {}, "say --set idle_v=0 or --set idle_v=10",
    ),
    "moving before its start": (DRIVE_TOO, {"start_us": 22.0, "least_samples": 3}, "before the start of the drive,"),
    "a time that falls": (DRIVE_TOO.replace("\n30;", "\n20;"), {}, "20 comes after 25"),
    "two channels": (
        text("t (us);drive (V);stack (V);x (um)", [(t, v, v, y) for t, v, y in driven()]), {}, "could all be voltage_v",
    ),
    "counted": (
        UNSAID, {"columns": (Mapping("U (V)", "voltage_v", Unit("V", "pp")),)}, "its volts are said to be peak to",
    ),
    "no recording": (text("t (us);x (um)", [r[::2] for r in driven()]), {"waveforms": ("table",)}, "no column is"),
    "no voltage": (DRIVE_TOO.replace("\n5;0.7538;", "\n5;;"), {}, "voltage_v is empty"),
    "too large": (text("t (us);drive (V);x (um)", driven(volts=1.3e5 * VOLTS)), {}, "is not between -1e+06 and 1e+06"),
    "too long": (DRIVE_TOO, {"every": 2, "most_samples": 11, "least_samples": 3}, "leave out the end of the record"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "said"), ASKED.values(), ids=ASKED.keys())
def test_a_drive_that_is_not_clear_is_asked_for(
    content: str, options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    assert said in refused(tmp_path, content, **(NOTHING_SAID | options))


def test_volts_of_launches_are_no_recording(tmp_path: Path) -> None:
    content = "f (Hz);Vp;Range (um);CH1 (V)\n1200;20;76;1\n"
    line = refused(tmp_path, content, columns=(Mapping("CH1", "voltage_v"),))
    assert "'CH1 (V)' is said to be voltage_v, and the table is one of launches" in line


@pytest.mark.parametrize(
    ("volts", "idle", "said"),
    [(20.0, 0, "never reaches"), (8.0, 0, ""), (2.0, 0, "beyond amplitude_v"), (8.0, 4, "never reaches"), (4.0, 4, "")],
)
def test_a_recording_is_held_against_the_amplitude(volts: float, idle: float, said: str, tmp_path: Path) -> None:
    """The recording goes from 0 to 8.06 V, from rest at either end or in between."""
    values = (HELD[0], ("amplitude_v", volts), ("idle_v", float(idle)))
    (group,) = read(tmp_path, DRIVE_TOO, **(NOTHING_SAID | {"values": values}))
    lines = [line for line in suspicious_readings(group, None) if "recorded drive" in line]
    assert [said in line for line in lines] == ([True] if said else [])


# --- the command ----------------------------------------------------------------------------------------------------


def _simulated(conditions: tuple[Row, ...], times: np.ndarray, scatter: float) -> list[Row]:
    """Rows of frequency, time, recorded drive and velocity of the ball, as psafit's own simulation has it."""
    from psafit.drives import Drive, Table

    rng, rows = np.random.default_rng(1), []
    for f, v in conditions:
        at = times * 1e-6
        table = Table(at, v * np.sin(2 * np.pi * f * at), recorded=True)
        drive = Drive("table", table=table, file="d.csv")
        n, kind = times.size, np.full(times.size, OBSERVABLES.index(VELOCITY))
        group = Conditions(1, drive, "a.csv", np.full(n, f), np.full(n, v), measured=kind, time_us=times)
        plan = Plan(Constants(**CONSTANTS), (group,), ())
        speed = readings(Design.of(plan.constants, plan.groups), np.array([[1e6, 1e3, 30.0]]))[0]
        rows += list(zip([f] * n, times, table.value, speed + rng.normal(0.0, scatter, n), strict=True))
    return [tuple(map(float, row)) for row in rows]


@pytest.mark.slow
def test_imported_traces_with_their_drives_are_fitted_and_diagnosed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two conditions in one table, each with its recorded drive: check, fit, diagnose."""
    from test_docs import set_up

    set_up(tmp_path, monkeypatch)
    rows = _simulated(((1200.0, 20.0), (1600.0, 20.0)), np.linspace(0.0, 300.0, 13), 0.02)
    Path("scope.csv").write_text(text("f (Hz);t (us);CH1 (V) drive;Velocity (mm/s)", rows), encoding="utf-8")
    words = ["import", "scope.csv", "--set", "amplitude_v=20", "--out", "rig", "--json", "import.json", *RIG]
    assert run(monkeypatch, *words) == 0
    out = capsys.readouterr().out
    assert "group 2: drive of 13 rows, 300 us, 0 to 19.96 V, 13 samples of the velocity, group2.csv" in out
    groups = json.loads(Path("import.json").read_text("utf-8"))["tables"][0]["groups"]
    assert [g["drive"] for g in groups] == ["drive1.csv", "drive2.csv"]
    assert sorted(p.name for p in Path("rig").iterdir()) == [
        "drive1.csv", "drive2.csv", "experiment.toml", "group1.csv", "group2.csv",
    ]  # fmt: skip
    assert run(monkeypatch, "check", "rig") == 0
    assert run(monkeypatch, "fit", "rig", "--group", "1", "--out", "fit", "--quiet", "--no-report") == 0
    assert run(monkeypatch, "validate", "fit", "--quiet") == 0
    assert run(monkeypatch, "diagnose", "rig", "--quick", "--out", "found", "--quiet", "--no-report") == 0
    assert json.loads(Path("found/diagnosis.json").read_text("utf-8"))["verdict"] == "adequate"


def test_what_is_written_is_read_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the same numbers, the drive's times among them."""
    monkeypatch.chdir(tmp_path)
    times = np.round(np.cumsum(np.random.default_rng(2).uniform(0.1, 9.0, 12)), 3)
    Path("scope.csv").write_text(text("t (us);drive (V);x (um)", driven(times)), encoding="utf-8")
    given = [word for name, value in HELD for word in ("--set", f"{name}={value}")]
    assert run(monkeypatch, "import", "scope.csv", "--out", "rig", *given, *RIG) == 0
    (group,) = read_experiment("rig").groups
    (made,) = read(tmp_path, Path("scope.csv").read_text("utf-8"), **NOTHING_SAID)
    assert group.drive == made.drive and group.drive.settings == made.drive.settings
    written = [float(line.split(",")[0]) for line in Path("rig/drive1.csv").read_text("utf-8").split()[1:]]
    assert written == times.tolist() and all(a < b for a, b in pairwise(written))

"""Traces as oscilloscopes and vibrometers write them: read right, or asked about in one clear line."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuzz
import numpy as np
import pytest
from commands import run
from foreign import Foreign, draw_trace, held_by
from recordings import draw_traces

from psafit.errors import InputError
from psafit.experiment import Group, read_experiment
from psafit.experiment.importing import Mapping, Options, read_files
from psafit.experiment.importing.units import Unit, scaled

DRIVE = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
RIG = [w for name in ("M=0.027", "m=0.005", "q=1.2e-7", "l=0.09", "k_s=4.89e7", "g=9.81") for w in ("--set", name)]
TIMES = np.arange(12) * 5.0
MOTION = np.round(0.01 * TIMES**1.5, 3)


def rows(
    time: float = 1.0, motion: float = 1.0, separator: str = ",", decimal: str = ".", first: str = "", shift: float = 0
) -> str:
    """Times, divided by `time`, and the motion, divided by `motion`, as text."""
    lines = (f"{(t + shift) / time:.9g}{separator}{y / motion:.9g}\n" for t, y in zip(TIMES, MOTION, strict=True))
    return first + "".join(lines).replace(".", decimal)


def read(folder: Path, content: str, **options: Any) -> tuple[Group, ...]:
    file = folder / "trace.csv"
    file.write_text(content, encoding="utf-8")
    (table,) = read_files([file], Options(**({"waveforms": ("sine",), "values": DRIVE} | options)))
    return table.groups


def column(heading: str, name: str, unit: str) -> dict[str, Any]:
    return {"columns": (Mapping(heading, name, scaled(unit) or Unit(unit)),)}


# Of an oscilloscope that writes it in the first columns, next to the samples.
PREAMBLE = (
    "Record Length,1.2e+01", "Sample Interval,5.0e-06", "Trigger Point,0", ",", "Source,CH1", "Vertical Units,V",
    "Vertical Scale,5.0e-01", "Horizontal Units,s", "Horizontal Scale,2.5e-05", *[","] * 3,
)  # fmt: skip
READ: dict[str, tuple[str, dict[str, Any], str]] = {
    "a vibrometer": (rows(1e3, first="Time (ms),Velocity (mm/s)\n"), {}, "velocity"),
    "another unit": (rows(1, 1e-3, first="t [us],Displacement [nm]\n"), {}, "displacement"),
    "a row of units": (rows(1e6, 1e3, first="Time,Velocity\ns,m/s\n"), {}, "velocity"),
    "a spreadsheet": (
        rows(1e3, 1, ";", ",", first="Prüfer;M. Müller\n\nZeit (ms);Auslenkung (µm)\n"), {}, "displacement",
    ),
    "comments": (
        rows(1e6, 1, "\t", first="# vibrometer\n# 41 points\nTime (s)\tTip displacement (um)\n"),
        {}, "tip_displacement",
    ),
    "volts": (
        rows(1e6, 5.0, first="Model,DSO\nTime (s),CH1 (V)\n"), column("CH1 (V)", "velocity_mm_s", "5mm/s/V"),
        "velocity",
    ),
    "millivolts": (
        rows(1e6, -2e-3, first="x-axis,1\nsecond,mV\n"), column("1", "displacement_um", "-2 um/V"), "displacement",
    ),
    "no headings": (
        rows(1e3, 2.0),
        {"columns": (Mapping("1", "time_us", Unit("ms")), Mapping("2", "displacement_um", scaled("2um/V")))},
        "displacement",
    ),
    "a preamble of units": (
        rows(1e6, 5.0, first="Horizontal Units,s\nVertical Units,V\nVertical Scale,5\n\nTIME (s),CH1\n"),
        column("CH1", "velocity_mm_s", "5mm/s/V"), "velocity",
    ),
    "units alone": (rows(1e6, 5.0, first="Second,Volt\n"), column("Volt", "velocity_mm_s", "5mm/s/V"), "velocity"),
    "a preamble next to it": (
        "".join(
            f"{said},,{line}\n"
            for said, line in zip(PREAMBLE, rows(1e6, 5.0).splitlines(), strict=True)
        ),
        {"columns": (Mapping("4", "time_us", Unit("s")), Mapping("5", "velocity_mm_s", scaled("5mm/s/V")))},
        "velocity",
    ),
    "a count of samples, the increment in the row of units": (
        "X,CH1,Start,Increment\nSequence,VOLT,0.0e+00,5.0e-06\n" + rows(5.0, 5.0).replace("\n", ",,\n"),
        {"columns": (Mapping("X", "time_us", scaled("5us")), Mapping("CH1", "velocity_mm_s", scaled("5mm/s/V")))},
        "velocity",
    ),
    "an instrument behind a dash": (rows(1, first="Time (us) - dev1,x (um) - dev1\n"), {}, "displacement"),
    "another clock": (rows(1, shift=5e5, first="Time (us),x (um)\n"), {"start_us": 5e5}, "displacement"),
    "a trigger": (rows(first="Trigger offset: 1.5 ms,\nTime (us),x (um)\n"), {"start_us": 0.0}, "displacement"),
    "no trigger": (rows(first="Trigger offset: 0,\nTime (us),x (um)\n"), {}, "displacement"),
    "a channel of the drive": (
        rows(1, first="Time (us),Displacement (um),U (V)\n").replace("\n", ",1\n").replace("(V),1", "(V)"),
        {"columns": (Mapping("U (V)", "ignore"),)},
        "displacement",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "name"), READ.values(), ids=READ.keys())
def test_a_trace_is_read_right(content: str, options: dict[str, Any], name: str, tmp_path: Path) -> None:
    (group,) = read(tmp_path, content, **options)
    assert [o.name for o in group.observables] == [name]
    assert set(group.frequency_hz) == {1200.0} and set(group.amplitude_v) == {20.0}
    assert group.time_us is not None
    np.testing.assert_allclose(group.time_us, TIMES, rtol=1e-8)
    np.testing.assert_allclose(group.reading, MOTION, rtol=1e-8)


HEAD = "Time (us),Velocity (mm/s)\n"
ASKED: dict[str, tuple[str, dict[str, Any], str]] = {
    "no drive": (rows(first=HEAD), {"values": ()}, "--set frequency_hz=1.2:kHz --set amplitude_v=40:Vpp"),
    "no amplitude": (rows(first=HEAD), {"values": DRIVE[:1]}, "nothing says amplitude_v of its drive"),
    "no waveform": (rows(first=HEAD), {"waveforms": ()}, "--waveform sine"),
    "no scale": (rows(first="Time (us),CH1 (V)\n"), {}, "--column 'CH1 (V)=velocity_mm_s:5mm/s/V'"),
    "a scale of another unit": (
        rows(first="Time (us),CH1 (N)\n"), column("CH1 (N)", "velocity_mm_s", "5mm/s/V"),
        "'5 mm/s/V' is no scale of it",
    ),
    "no unit": (rows(first="Time,Velocity (mm/s)\n"), {}, "--column Time=time_us:us"),
    "no time": (
        rows(first="a,b (um)\n"), column("b (um)", "displacement_um", "um"),
        "or their rate, --step 1:MHz; of a time that is there --column NAME=time_us:us",
    ),
    "the drive": (
        rows(first="Time (us),Displacement (um),U (V)\n").replace("\n", ",1\n").replace("(V),1", "(V)"), {},
        "'U (V)=ignore'",
    ),
    "before the start": (rows(first=HEAD, shift=-15), {}, "time_us begins at -15, before the start of the drive"),
    "another clock": (rows(first=HEAD, shift=5e5), {}, "say --start 500000:us if with the first sample, or --start 0"),
    "a trigger": (rows(first=f"Trigger offset: 1 ms,\n{HEAD}"), {}, "'Trigger offset: 1 ms' may say when the drive"),
    "another motion": (
        rows(first="Time (us),Tip (um),Ball (um)\n").replace("\n", ",1\n").replace("(um),1", "(um)"), {},
        "'Ball (um)' may be displacement_um, too; say --column 'Ball (um)=displacement_um', if its numbers",
    ),
    "the same twice": (
        rows(first="Time (us),x (um),Laser (um)\n").replace("\n", ",1\n").replace("(um),1", "(um)"), {},
        "say --column 'x (um)=displacement_um' --column 'Laser (um)=displacement_um', if",
    ),
    "rest unknown": (rows(first=HEAD), {"from_rest": True}, "no sample lies before the start"),
    "out of order": (rows(first=HEAD) + "3,1\n", {}, "3 comes after 55; sort the rows"),
    "out of order between those that are kept": (
        "Time (us),Velocity (mm/s)\n" + "".join(f"{75 if k == 5 else 20 * k},{k}\n" for k in range(24)),
        {"every": 2}, "75 comes after 80",
    ),
    "too few": (rows(first=HEAD), {"every": 4}, "3 samples after the start of the drive; a trace has at least 10"),
    "too many": (rows(first=HEAD), {"most_samples": 11}, "at most 11; keep one in so many: --every"),
    "a sweep": ("f (Hz),Vp,Range (um)\n1200,20,76\n", {"values": (), "every": 2}, "--every is of traces"),
    "an error given": (rows(first=HEAD), {"values": (*DRIVE, ("sigma_um", 1.0))}, "sigma_um is given, and no table"),
    "two drives": (
        rows(first=HEAD), {"values": (*DRIVE[:1], ("amplitude_v", (1.0, 5.0)))}, "2 values of amplitude_v for 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options", "said"), ASKED.values(), ids=ASKED.keys())
def test_what_a_trace_does_not_say_is_asked_for(
    content: str, options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        read(tmp_path, content, **options)
    assert said in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_the_clock_and_rest_of_an_instrument(tmp_path: Path) -> None:
    """Samples before the start are left out; their mean is rest; one in three is kept."""
    content = rows(first="Time (us),Displacement (um)\n-10,0.3\n-5,0.1\n").replace("\n55,", "\n57,")
    (group,) = read(tmp_path, content, start_us=10.0, from_rest=True, every=2, least_samples=3)
    assert group.time_us is not None and group.time_us.tolist() == [0, 10, 20, 30, 40]
    rest = np.mean([0.3, 0.1, *MOTION[:2]])
    np.testing.assert_allclose(group.reading, MOTION[2::2] - rest, rtol=1e-12)


def test_columns_and_files_are_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A sweep and traces in one folder, each trace with its own drive; the folder is read back to the same numbers."""
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text("f (Hz),Vp,Range (um)\n1200,20,76\n1300,20,75\n1400,20,70\n", encoding="utf-8")
    both = "".join(f"{t:g},{y:g},{1000 * y:g}\n" for t, y in zip(TIMES, MOTION, strict=True))
    Path("two.csv").write_text(f"Time (us),Displacement (um),Velocity (um/s)\n{both}", encoding="utf-8")
    Path("one.csv").write_text(rows(first=HEAD), encoding="utf-8")
    drive = ("--set", "frequency_hz=1,1.2:kHz,1.3:kHz", "--set", "amplitude_v=5,20,40:Vpp", "--waveform", "sine")
    where = ("--out", "rig", "--json", "out.json")
    assert run(monkeypatch, "import", "sweep.csv", "two.csv", "one.csv", *drive, *RIG, *where) == 0
    assert "group 2: sine, -20 to 20 V, 12 samples of the displacement, group2.csv" in capsys.readouterr().out
    data = read_experiment(Path("rig"))
    assert [g.observable.name for g in data.groups] == ["launch_range", "displacement", "velocity", "velocity"]
    assert [(g.frequency_hz[0], g.amplitude_v[0]) for g in data.groups[1:]] == [(1200, 20), (1200, 20), (1300, 20)]
    for group in data.groups[1:]:
        assert group.time_us is not None and group.time_us.tolist() == TIMES.tolist()
        np.testing.assert_allclose(group.reading, MOTION, rtol=1e-12)
    tables = json.loads(Path("out.json").read_text("utf-8"))["tables"]
    assert [c["column"] for c in tables[1]["columns"]][2:] == ["time_us", "displacement_um", "velocity_mm_s"]


@pytest.mark.parametrize(
    ("draw", "seed", "n", "most"),
    [(draw_trace, "trace", 100, 10), (draw_traces, "traces", 60, 6)],
    ids=["one", "several"],
)
def test_drawn_traces_are_read_right_or_asked_about(
    draw: Callable[[random.Random, Path], Foreign],
    seed: str,
    n: int,
    most: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of one condition, and of several in one table."""
    monkeypatch.chdir(tmp_path)
    asked = 0
    for number in range(n):
        made = draw(random.Random(f"{seed}-{number}"), tmp_path)
        code = run(monkeypatch, "import", made.file.name, "--out", f"rig{number}", *made.options, *RIG)
        said = capsys.readouterr().err  # or what is suspicious
        if code == 2:
            (line,) = said.splitlines()
            assert "--decimal" in line or "--column" in line, line
            asked += 1
            continue
        held, true = held_by(read_experiment(Path(f"rig{number}")).groups), sorted(made.readings)
        assert [h[:4] for h in held] == [t[:4] for t in true], number
        np.testing.assert_allclose([h[4] for h in held], [t[4] for t in true], rtol=1e-12)
    assert asked <= most


def test_files_of_one_heading_may_hold_different_quantities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A scope calls each signal CH1; what is said of a table must be of a column that it has."""
    monkeypatch.chdir(tmp_path)
    Path("sweep.csv").write_text("f (Hz),Vp,Range (um)\n1200,20,76\n1300,20,75\n1400,20,70\n", encoding="utf-8")
    for name in ("ball.csv", "tip.csv"):
        Path(name).write_text(rows(first="t (us),CH1 (um)\n"), encoding="utf-8")
    held = ("--set", "frequency_hz=,1200,1200", "--set", "amplitude_v=,20,20", "--waveform", "sine", *RIG)

    def said(column: str, *files: str) -> str:
        words = ("import", *files, *held, "--column", f"CH1 (um)={column}", "--out", "rig")
        assert run(monkeypatch, *words) == 2 and not Path("rig").exists()
        return capsys.readouterr().err

    every = ("sweep.csv", "ball.csv", "tip.csv")
    assert "sweep.csv:1: there is no column 'CH1 (um)' among" in said("displacement_um,,tip_displacement_um", *every)
    assert "2 columns for 'CH1 (um)' and 3 tables; give one" in said("displacement_um,tip_displacement_um", *every)
    assert "'tip' is no column" in said(",displacement_um,tip", *every)
    own = ("--column", "CH1 (um)=,displacement_um:um,tip_displacement_um")
    assert run(monkeypatch, "import", *every, *held, *own, "--out", "rig") == 0
    read = [g.observable.name for g in read_experiment(Path("rig")).groups]
    assert read == ["launch_range", "displacement", "tip_displacement"]


def test_hostile_files_end_in_readings_or_in_a_line(tmp_path: Path) -> None:
    """A part of `make fuzz`: files that are sound are read right, damaged ones named, spoilt ones never a traceback."""
    for number in range(40):
        place = tmp_path / str(number)
        place.mkdir()
        rng, kind = fuzz.case(number, 1, ["import"])
        result = fuzz.run(kind, fuzz.set_up(kind, rng, {}, place), place)
        assert not (fuzz.fault(result) or fuzz.misread_by(kind, place, result["code"])), number


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--start", "soon"), "--start 'soon': 'soon' is no time"),
        (("--start", "1:V"), "'1:V' is no time"),
        (("--every", "0"), "'--every'"),
        (("--column", "Velocity=velocity_mm_s:5"), "what a volt is, 5mm/s/V"),
        (("--column", "Velocity=amplitude_v:5mm/s/V"), "is no unit"),
    ],
)
def test_bad_options_of_traces(
    words: tuple[str, ...],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.csv").write_text(rows(first=HEAD), encoding="utf-8")
    assert run(monkeypatch, "import", "one.csv", "--out", "rig", "--waveform", "sine", *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and not Path("rig").exists()


@pytest.mark.parametrize(
    ("text", "kind", "factor"),
    [
        ("5mm/s/V", "mm/s", 5),
        ("-2 um/V", "um", -2),
        ("2um/mV", "um", 2000),
        ("0.5*m/s/V", "mm/s", 500),
        ("-1um", "um", -1),
    ],
)
def test_scales(text: str, kind: str, factor: float) -> None:
    found = scaled(text)
    assert found is not None and (found.kind, found.factor(kind)) == (kind, factor)
    assert scaled("5") is None and scaled("0mm/s/V") is None and scaled("5 parsec/V") is None

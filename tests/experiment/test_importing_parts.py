"""Headings and lines of which a part says something else: read right, or asked about with a remedy that works."""

from __future__ import annotations

import math
import re
import shlex
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from imported import refused, tables

from psafit.errors import InputError
from psafit.experiment import Group
from psafit.experiment.importing import Mapping, Options, read_files
from psafit.experiment.importing.units import Unit, scaled, unit

HELD: tuple[tuple[str, float | tuple[float, ...]], ...] = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
MOTION = [0.1 * k * k for k in range(12)]


def trace(head: str, *columns: Any, motion: str = "Displacement (um)", above: str = "") -> str:
    """Rows of samples; columns are formats of the row's number."""
    rows = (";".join([*(form(k) for form in columns), f"{y:.6g}"]) for k, y in enumerate(MOTION))
    return above + "\n".join([f"{head};{motion}" if head else motion, *rows, ""])


def one(folder: Path, content: str, **said: Any) -> Group:
    (table,) = tables(folder, content, **said)
    (group,) = table.groups
    return group


def proposed(line: str, which: int) -> Mapping:
    """One of the mappings that a line proposes."""
    said = re.findall(r"--column ('[^']+'|\S+)", line.replace(";", " ").replace(", ", " , "))[which]
    heading, _, rest = shlex.split(said)[0].rpartition("=")
    column, _, text = rest.partition(":")
    return Mapping(heading, column, (unit(text) or scaled(text)) if text else None)


# --- samples that are counted -------------------------------------------------------------------------------------

COUNTERS = {
    "by two": [2 * k for k in range(12)],
    "a gap": [*range(6), *range(9, 15)],
    "before the trigger": [k - 2 for k in range(12)],
    "from the middle of a record": [k + 500 for k in range(12)],
}


@pytest.mark.parametrize("name", ["Sample", "Index", ""])
@pytest.mark.parametrize("counts", COUNTERS.values(), ids=COUNTERS.keys())
@pytest.mark.parametrize("form", ["{}", "{}.0"])
def test_a_counter_that_does_not_count_the_rows_is_asked_about(
    name: str, counts: list[int], form: str, tmp_path: Path
) -> None:
    content = trace(name or " ", lambda k: form.format(counts[k]))
    said: dict[str, Any] = {"values": HELD, "start_us": 0.0}
    asked = refused(tmp_path, content, **said, step_us=Decimal(2))
    assert f"counts from {counts[0]} to {counts[-1]}, and there are 12 samples" in asked and "without --step" in asked
    by_count = one(tmp_path, content, **said, columns=(proposed(asked, 0),))
    assert by_count.time_us is not None
    assert by_count.time_us.tolist() == [2.0 * c for c in counts if c >= 0]
    by_row = one(tmp_path, content, **said, columns=(proposed(asked, 1),), step_us=Decimal(2))
    assert by_row.time_us is not None and by_row.time_us.tolist() == [2.0 * k for k in range(12)]


@pytest.mark.parametrize("form", ["{}", "{:03d}", "{}.0", "{:.3e}"])
@pytest.mark.parametrize("first", [0, 1])
def test_a_counter_of_the_rows_changes_nothing(first: int, form: str, tmp_path: Path) -> None:
    content = trace("Sample;Level", lambda k: f"{form.format(k + first)};{7 * (k % 2)}")
    group = one(tmp_path, content, values=HELD, start_us=0.0, step_us=Decimal(2))
    assert group.time_us is not None and group.time_us.tolist() == [2.0 * k for k in range(12)]


def test_frames_whose_counter_begins_again_are_traces_of_their_own(tmp_path: Path) -> None:
    content = trace("Sample", str) + "".join(f"{k};{y:.6g}\n" for k, y in enumerate(MOTION))
    said: dict[str, Any] = {"values": HELD, "start_us": 0.0}
    asked = refused(tmp_path, content, **said, step_us=Decimal(2))
    assert "counts from 0 to 11, and there are 24 samples" in asked
    (table,) = tables(tmp_path, content, **said, columns=(proposed(asked, 0),))
    assert [group.n_points for group in table.groups] == [12, 12]


@pytest.mark.parametrize("line", ["Decimation: 10", "Decimation;10", "# downsampling factor = 4"])
def test_a_step_of_samples_that_were_thinned_is_asked_for(line: str, tmp_path: Path) -> None:
    said: dict[str, Any] = {"values": HELD, "start_us": 0.0}
    content = trace("", above=f"{line}\nSample Rate: 100 kHz\n")
    asked = refused(tmp_path, content, **said)
    assert "does not follow from" in asked and "(line 1), 'Sample Rate: 100 kHz' (line 2); say their step" in asked
    speeds = refused(tmp_path, content.replace("Displacement (um)", "Velocity (mm/s)"), **said)
    assert "say the step, which does not follow from" in speeds and "(line 2): --step NUMBER:us, or" in speeds
    group = one(tmp_path, content, **said, step_us=Decimal(100))
    assert group.time_us is not None and group.time_us[1] == 100.0
    none = one(tmp_path, re.sub(r"\d+\n", "1\n", content, count=1), **said)
    assert none.time_us is not None and none.time_us[1] == 10.0
    assert one(tmp_path, trace("Time (us)", str, above=f"{line}\n"), values=HELD).n_points == 12


CLOCKS = ["12:00:00.{:03d}", "12:00:00.{:06d}", "2026-11-03 12:00:00.{:03d}", "2026-11-03T12:00:00,{:03d}"]


@pytest.mark.parametrize("form", CLOCKS)
@pytest.mark.parametrize("name", ["Time", "Time (s)", "Stamp"])
def test_a_time_of_the_day_is_no_clock_of_a_trace(name: str, form: str, tmp_path: Path) -> None:
    content = trace(name, form.format)
    said: dict[str, Any] = {"values": HELD, "start_us": 0.0}
    asked = refused(tmp_path, content, **said)
    assert "in seconds, or of equal steps say" in asked and "no unit" not in asked and asked.endswith("--step 1:us")
    left = (Mapping(name, "ignore"),) if "=ignore" in asked else ()
    group = one(tmp_path, content, **said, columns=left, step_us=Decimal(1))
    assert group.time_us is not None and group.time_us.tolist() == list(range(12))


# --- headings that say more ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("heading", "column"),
    [
        ("Range filter 10 kHz (um)", "launch_range_um"),
        ("Laser, bandwidth 20 kHz (um)", "launch_range_um"),
        ("Speed, full scale 10 Vp (mm/s)", "launch_speed_mm_s"),
    ],
)
def test_a_number_among_words_that_are_not_known_is_no_condition(heading: str, column: str, tmp_path: Path) -> None:
    content = f"f (Hz);U (Vp);{heading}\n1200;20;3\n1300;20;5\n"
    mapped = (Mapping(heading, column),)
    assert one(tmp_path, content, columns=mapped).frequency_hz.tolist() == [1200.0, 1300.0]
    without = f"{heading}\n3\n5\n"
    asked = refused(tmp_path, without, columns=mapped, values=HELD[:1] if "Vp" in heading else HELD[1:])
    assert f"no {'amplitude_v' if 'Vp' in heading else 'frequency_hz'} among" in asked


def test_numbers_among_such_words_that_differ_are_asked_about(tmp_path: Path) -> None:
    heads = ("Laser 1.2 kHz (um)", "Laser 1.3 kHz (um)")
    content = trace(f"t (us);{heads[0]}", str, str, motion=heads[1])
    mapped = tuple(Mapping(h, "displacement_um") for h in heads)
    asked = refused(tmp_path, content, columns=mapped, values=HELD)
    assert "name numbers that may be conditions, or something else; write conditions as in" in asked
    assert one(tmp_path, content, columns=(mapped[0], proposed(asked, 0)), values=HELD).n_points == 12
    (table,) = tables(tmp_path, content.replace("Laser", "CH1"), columns=tuple(
        Mapping(m.heading.replace("Laser", "CH1"), m.column) for m in mapped
    ), values=HELD[1:])  # fmt: skip
    assert [group.frequency_hz[0] for group in table.groups] == [1200.0, 1300.0]


@pytest.mark.parametrize("part", ["ball", "Kugel", "the ball"])
def test_numbers_of_balls_are_none_of_repetitions(part: str, tmp_path: Path) -> None:
    content = f"f (Hz);U (Vp);Range {part} 1 (um);Range {part} 2 (um)\n100;20;3;4\n"
    asked = refused(tmp_path, content)
    assert "could all be launch_range_um; say which" in asked and asked.endswith("; of repetitions each")
    assert one(tmp_path, content, columns=(proposed(asked, 0),)).reading.tolist() == [4.0]
    each = tuple(Mapping(f"Range {part} {k} (um)", "launch_range_um") for k in (1, 2))
    assert one(tmp_path, content, columns=each).reading.tolist() == [3.0, 4.0]


@pytest.mark.parametrize("heads", [("Range (um), sine", "Range (um), square"), ("Range sine (um)", "Range rect (um)")])
def test_a_waveform_of_a_heading_is_that_of_the_drive(heads: tuple[str, str], tmp_path: Path) -> None:
    content = f"f (Hz);U (Vp);{';'.join(heads)}\n100;20;3;4\n"
    each = tuple(Mapping(h, "launch_range_um") for h in heads)
    asked = refused(tmp_path, content, columns=each)
    assert f"column '{heads[1]}' is of a square by its heading, and the waveform is sine" in asked
    (group,) = tables(tmp_path, content, columns=(each[0], proposed(asked, 0)))[0].groups
    assert group.reading.tolist() == [3.0]
    assert one(tmp_path, content, columns=each[1:], waveforms=("square",)).waveform == "square"


def test_a_waveform_of_a_heading_goes_before_a_column_of_waveforms(tmp_path: Path) -> None:
    content = "f (Hz);U (Vp);Waveform;Range sine (um)\n100;20;square;3\n"
    mapped = (Mapping("Range sine (um)", "launch_range_um"),)
    asked = refused(tmp_path, content, columns=mapped, waveforms=())
    assert "is of a sine by its heading, and column 'Waveform' gives waveforms" in asked
    assert "say --column Waveform=ignore --waveform sine, or" in asked
    assert one(tmp_path, content, columns=(*mapped, proposed(asked, 0))).waveform == "sine"
    none = content.replace("Waveform", "Run").replace("square", "1")
    assert "nothing says which waveform" in refused(tmp_path, none, columns=mapped, waveforms=())


# --- known errors of repetitions ----------------------------------------------------------------------------------

PAIRED = {
    "numbered": ("Range 1 (um);Sigma 1 (um);Range 2 (um);Sigma 2 (um)", ()),
    "of one name": ("Range (um);Sigma (um);Range (um);Sigma (um)", ()),
    "said": ("Range 1 (um);SD 1 (um);Range 2 (um);SD 2 (um)", ("SD 1 (um)", "SD 2 (um)")),
    "without numbers": ("Range 1 (um);± (um);Range 2 (um);± (um)", ("± (um)",)),
}


@pytest.mark.parametrize(("heads", "said"), PAIRED.values(), ids=PAIRED.keys())
def test_each_repetition_has_its_known_error(heads: str, said: tuple[str, ...], tmp_path: Path) -> None:
    mapped = tuple(Mapping(h, "sigma_um") for h in said)
    content = f"f (Hz);U (Vp);{heads}\n100;20;3;0.1;4;0.2\n200;20;;0.3;5;0.4\n"
    group = one(tmp_path, content, columns=mapped)
    assert group.reading.tolist() == [3.0, 4.0, 5.0]
    assert group.sigma is not None and group.sigma.tolist() == [0.1, 0.2, 0.4]
    assert "in.csv:2: sigma_um is empty" in refused(tmp_path, content.replace(";0.2", ";"), columns=mapped)
    assert "in.csv:2: sigma_um 'x' is not a number" in refused(tmp_path, content.replace(";0.2", ";x"), columns=mapped)


def test_known_errors_at_conditions(tmp_path: Path) -> None:
    heads = "Range at 10 Vp (um);Sigma at 10 Vp (um);Range at 20 Vp (um);Sigma at 20 Vp (um)"
    mapped = tuple(Mapping(f"Sigma at {v} Vp (um)", "sigma_um") for v in (10, 20))
    group = one(tmp_path, f"f (Hz);{heads}\n100;3;0.1;4;0.2\n", columns=mapped)
    assert group.amplitude_v.tolist() == [10.0, 20.0]
    assert group.sigma is not None and group.sigma.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    "heads", ["Range 1 (um);Sigma 1 (um);Range 2 (um)", "Range 1 (um);Sigma 2 (um);Range 2 (um);Sigma 1 (um)"]
)
def test_a_known_error_of_one_reading_is_not_that_of_others(heads: str, tmp_path: Path) -> None:
    content = f"f (Hz);U (Vp);{heads}\n100;20;3;0.1;4;0.2\n".replace(";0.2", ";0.2" * ("Sigma 2" in heads))
    asked = refused(tmp_path, content)
    assert "sigma_um of some readings, and would count for others" in asked
    left = tuple(proposed(asked, k) for k in range(content.count("Sigma")))
    assert one(tmp_path, content, columns=left).sigma is None


@pytest.mark.parametrize("heads", ["SD (um)", "SD (um);SD (um)", "SD 1 (um)"])
def test_a_known_error_of_what_was_not_read_is_asked_about(heads: str, tmp_path: Path) -> None:
    content = f"f (Hz);U (Vp);Speed (mm/s);{heads}\n100;20;3;0.1;0.2\n".replace(";0.2", ";0.2" * heads.count(";"))
    asked = refused(tmp_path, content, columns=tuple({Mapping(h, "sigma_um") for h in heads.split(";")}))
    assert "sigma_um, and none is launch_range_um; say --column" in asked
    assert one(tmp_path, content, columns=(proposed(asked, 0),)).sigma is None


# --- volts next to a trace ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["Drive x10 (V)", "drive before 20x amplifier (V)", "Amp in (V)", "Monitor 1:100 (V)", "CH1 (V)"]
)
def test_volts_next_to_a_trace_are_asked_about_whatever_their_name(name: str, tmp_path: Path) -> None:
    content = trace(f"Time (us);{name}", str, lambda k: f"{k / 10}")
    for waveforms in ((), ("sine",)):
        asked = refused(tmp_path, content, waveforms=waveforms, values=HELD)
        assert "it may be the drive over time, or another signal" in asked and "if one volt of it is 20 V" in asked
    group = one(tmp_path, content, waveforms=(), values=HELD, columns=(proposed(asked, 0),))
    assert group.drive.table is not None and group.drive.table.value[-1] == 22.0
    assert one(tmp_path, content, values=HELD, columns=(proposed(asked, 1),)).waveform == "sine"
    constant = trace(f"Time (us);{name}", str, lambda k: "5")
    assert one(tmp_path, constant, values=HELD).amplitude_v[0] == 20.0


@pytest.mark.parametrize("name", ["Acceleration (m/s^2)", "Acceleration (g)", "Velocity (m/s²)"])
def test_an_acceleration_is_no_motion_that_is_read(name: str, tmp_path: Path) -> None:
    asked = refused(tmp_path, trace("Time (us)", str, motion=name), values=HELD)
    assert "none is a motion; say --column NAME=displacement_um:um, or of a sensor's volts" in asked
    assert asked.endswith("psafit reads no acceleration: integrate it")


def test_several_motions_of_other_names_are_proposed(tmp_path: Path) -> None:
    asked = refused(tmp_path, trace("Time (us);Laser A (um)", str, str, motion="Laser B (um)"), values=HELD)
    assert "'Laser A (um)=displacement_um' if it is that of the ball or --column 'Laser B (um)=displace" in asked


# --- rows of units, encodings, columns by their numbers -----------------------------------------------------------


def test_units_may_stand_above_the_headings(tmp_path: Path) -> None:
    group = one(tmp_path, "kHz;[Vpp];mm\nFrequency;Voltage;Range\n1;20;0.03\n2;20;0.04\n")
    assert group.frequency_hz.tolist() == [1000.0, 2000.0] and group.amplitude_v.tolist() == [10.0, 10.0]
    assert group.reading.tolist() == [30.0, 40.0]
    samples = one(tmp_path, trace("Time", lambda k: f"{k}e-6", motion="Displacement", above="s;um\n"), values=HELD)
    assert samples.time_us is not None and samples.time_us.tolist() == list(range(12))
    asked = refused(tmp_path, "ms;um\nTime (s);Displacement\n0;1\n", values=HELD)
    assert "is in 's', and in 'ms' by the row of units" in asked


def test_units_of_another_line_are_none(tmp_path: Path) -> None:
    said = (Mapping("Voltage", "amplitude_v", Unit("V", "peak")), Mapping("Range", "launch_range_um", Unit("um")))
    asked = refused(tmp_path, "Lab 3;Vpp;um\nFrequency;Voltage;Range\n1;20;0.03\n", columns=said)
    assert "'Frequency' gives no unit" in asked


def test_japanese_text_is_read_with_the_encoding_that_the_line_names(tmp_path: Path) -> None:
    file = tmp_path / "in.csv"
    file.write_bytes("測定,良好\nFrequency(kHz),Voltage(Vpp),Range(um)\n1.0,20,3\n".encode("cp932"))
    with pytest.raises(InputError, match="--encoding cp850, or cp932 of Japanese"):
        read_files([file], Options(waveforms=("sine",)))
    (table,) = read_files([file], Options(waveforms=("sine",), encoding="cp932"))
    assert table.groups[0].frequency_hz.tolist() == [1000.0]


def test_columns_of_one_quantity_by_their_numbers_keep_their_headings(tmp_path: Path) -> None:
    content = "Range 1 kHz 10 Vp (mm);Range 2 kHz 10 Vp (mm)\n0.003;0.004\n"
    mapped = tuple(Mapping(str(k), "launch_range_um") for k in (1, 2))
    group = one(tmp_path, content, columns=mapped)
    assert group.frequency_hz.tolist() == [1000.0, 2000.0] and group.reading.tolist() == [3.0, 4.0]
    bare = tuple(Mapping(str(k), "launch_range_um", Unit("um")) for k in (1, 2))
    assert one(tmp_path, "3;4\n5;6\n", columns=bare, values=HELD).reading.tolist() == [3.0, 4.0, 5.0, 6.0]
    assert "no frequency_hz among the columns; say" in refused(tmp_path, "3;4\n5;6\n", columns=bare, values=HELD[1:])


@pytest.mark.parametrize("above", ["x-axis,3,4\nsecond,Volt,Volt", "Time (s),3,4", "Clock,3,4", ",3,4"])
def test_a_number_that_is_a_heading_and_of_another_column_is_asked_about(above: str, tmp_path: Path) -> None:
    """What is proposed is read: the column of that heading, or the third one."""
    content = f"{above}\n" + "".join(f"{k}e-6,{y:.6g},{k % 5}\n" for k, y in enumerate(MOTION))
    time = Mapping("#1", "time_us", Unit("s"))
    motion = Mapping("3", "displacement_um", scaled("1um/V"))
    asked = refused(tmp_path, content, columns=(time, motion), values=HELD)
    assert "'3' is the heading of column 2, and the number of another; say --column '#2=" in asked
    for which, found in enumerate((MOTION, [k % 5 for k in range(12)])):
        other = Mapping(("4", "#2")[which], "ignore")
        group = one(tmp_path, content, columns=(time, proposed(asked, which), other), values=HELD)
        assert group.reading == pytest.approx(found, rel=1e-5) and group.time_us[1] == 1.0


def test_a_heading_that_is_a_number_is_no_number_of_what_has_a_name(tmp_path: Path) -> None:
    mapped = tuple(Mapping(k, "launch_range_um", Unit("um")) for k in "12")
    assert one(tmp_path, "f (Hz);Vp;1;2\n100;20;3;4\n", columns=mapped).reading.tolist() == [3.0, 4.0]


@pytest.mark.parametrize("rows", ["A;100;20;3\n;110;20;4\n", ";100;20;3\nB;110;20;4\n"])
def test_a_row_without_its_label_is_in_no_group(rows: str, tmp_path: Path) -> None:
    """As of cells that were merged, of which the first alone holds what all do."""
    asked = refused(tmp_path, f"Day;f (Hz);Vp;Range (um)\n{rows}", columns=(Mapping("Day", "group"),))
    assert asked.endswith("group has no label; write it into each row, also where cells were merged")


def test_units_below_headings_are_those_of_no_others(tmp_path: Path) -> None:
    """As in Origin, whose third row is a comment of each column; the units above it are of the headings."""
    content = trace("Time", lambda k: f"{k}e-6", motion="Displacement").replace("\n", "\ns;um\nRun 1;Trial 1\n", 1)
    asked = refused(tmp_path, content, values=HELD)
    assert "in.csv:3: 'Run 1 Trial 1' holds no number where other rows do; put # before a remark" in asked
    assert one(tmp_path, content.replace("Run 1", "# Run 1"), values=HELD).n_points == 12


BELOW_WORDS = {
    "an oscilloscope's": "Revision,0\nType,Raw\nPoints,12\nXInc,1e-6\nXUnits,Second\nMax Bandwidth,4e9\nData,\n",
    "a number in between": "Memory Length,12,\nSource,CH1,\nVertical Units,V,\nSampling Period,1e-6,\nWaveform Data,\n",
}


@pytest.mark.parametrize("above", BELOW_WORDS.values(), ids=BELOW_WORDS.keys())
def test_columns_by_their_numbers_begin_where_both_hold_numbers(above: str, tmp_path: Path) -> None:
    content = above + "".join(f"{k}e-6,{y:.6g}\n" for k, y in enumerate(MOTION))
    mapped = (Mapping("1", "time_us", Unit("s")), Mapping("2", "displacement_um", Unit("um")))
    group = one(tmp_path, content, values=HELD, columns=mapped)
    assert group.time_us is not None and group.time_us.tolist() == list(range(12))
    assert group.reading.tolist() == pytest.approx(MOTION)


def test_a_heading_without_cells_may_be_ignored(tmp_path: Path) -> None:
    """LabVIEW writes one for comments behind the last column."""
    content = trace("Time (us)", str, motion="Displacement (um);Comment")
    asked = refused(tmp_path, content, values=HELD)
    assert asked.endswith("or say --column Comment=ignore")
    assert one(tmp_path, content, values=HELD, columns=(proposed(asked, 0),)).n_points == 12


@pytest.mark.parametrize("heads", ["Comment;Note", "Note;Note", "Displacement (um);Displacement (um)"])
def test_several_headings_without_cells_may_be_ignored_one_by_one(heads: str, tmp_path: Path) -> None:
    content = trace("Time (us)", str, motion=f"Displacement (um);{heads}")
    said: tuple[Mapping, ...] = ()
    while len(said) < 2 and (asked := refused(tmp_path, content, values=HELD, columns=said)):
        said = (*said, proposed(asked, 0))
    assert one(tmp_path, content, values=HELD, columns=said).n_points == 12


def test_a_fault_of_all_rows_is_one_line(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (kHz),Upp (V),Range (um)\n1,2,40,76,5\n1,25,40,75,25\n")
    assert "in.csv:2: 5 cells in the row, 3 headings, as in 2 rows; give each column a heading; decimal" in asked


def test_a_unit_behind_in_is_a_heading(tmp_path: Path) -> None:
    content = trace("in s;CH1 in V", lambda k: f"{k}e-6", lambda k: f"{k / 10}", motion="CH2 in V")
    sensor = Mapping("CH2 in V", "displacement_um", scaled("2um/V"))
    group = one(tmp_path, content, waveforms=(), values=HELD, columns=(Mapping("CH1 in V", "voltage_v"), sensor))
    assert group.time_us is not None and group.time_us.tolist() == list(range(12))
    assert group.reading.tolist() == pytest.approx([2 * y for y in MOTION])


def test_what_a_trace_lacks_may_be_a_recorded_drive(tmp_path: Path) -> None:
    content = trace("Time (us);Amp monitor (V/10)", str, str)
    asked = refused(tmp_path, content, waveforms=(), values=HELD)
    assert asked.endswith("; of a drive that was recorded --column NAME=voltage_v:V")


@pytest.mark.parametrize("name", ["rms Voltage (Vpp)", "Amplitude (Vp), pk-pk", "Spannung Spitze-Spitze (Vrms)"])
def test_volts_that_are_counted_in_two_ways_are_asked_about(name: str, tmp_path: Path) -> None:
    content = f"f (Hz);{name};Range (um)\n100;20;3\n"
    asked = refused(tmp_path, content)
    assert f"no amplitude_v among 'f (Hz)', '{name}'" in asked
    again = refused(tmp_path, content, columns=(proposed(asked, 0),))
    assert "whether volts are zero to peak, peak to peak or RMS is not said" in again
    mapped = (Mapping(name, "amplitude_v", Unit("V", "pp")),)
    assert one(tmp_path, content, columns=mapped).amplitude_v.tolist() == [10.0]


LABELLED = [";Sine;;Square", ";Sine;;Square\n;;;", ";10 Vpp;;20 Vpp", "Ball A;;;Ball B", ";;;Square", ";day 1;;day 2"]


@pytest.mark.parametrize("labels", LABELLED)
def test_labels_above_the_headings_part_columns_of_one_name(labels: str, tmp_path: Path) -> None:
    """An empty cell, as of cells that were merged, goes on to the left."""
    content = f"{labels}\nf (Hz);Range (um);U (Vp);Range (um)\n100;3;20;4\n"
    asked = refused(tmp_path, content)
    assert "could all be launch_range_um, and '" in asked and "' above part them; say which: --column 4=" in asked
    assert one(tmp_path, content, columns=(proposed(asked, 0),)).reading.tolist() == [4.0]
    each = tuple(Mapping(str(k), "launch_range_um") for k in (2, 4))
    assert one(tmp_path, content, columns=each).reading.tolist() == [3.0, 4.0]


HEAD = "Frequency (Hz),Range (um),Range (um),Range (um)\n"
BARE = {
    "above words": f",5,10,20\n{HEAD}",
    "above words, named": f"Vpp,1,2,3\n{HEAD}",
    "above words, with units": f"Test 3\n,5,10,20\nHz,um,um,um\n{HEAD}",
    "above numbered words": ",0.5,1,2\nFrequency (Hz),Range 1 (um),Range 2 (um),Range 3 (um)\n",
    "above names": ",5,10,20\nfrequency,reading,reading,reading\n",
    "above an empty line": f",5.5,10,20\n,,,\n{HEAD}",
    "below words": f"{HEAD},5,10,20\n",
    "below words, named": f"{HEAD}Vpp,5,10,20\n",
    "below words, with units": f"{HEAD},5 V,10 V,20 V\n",
    "alone": ",5,10,20\n",
    "behind a word": "Frequency,5,10,20\n",
    "behind a word, no whole ones": "Frequency,0.5,1.5,2.5\n",
}


@pytest.mark.parametrize("bare", BARE.values(), ids=BARE.keys())
@pytest.mark.parametrize("mark", [",", "\t"])
def test_numbers_without_a_word_are_asked_about(bare: str, mark: str, tmp_path: Path) -> None:
    """With whatever is said of the columns: what they were read at is in these numbers."""
    content = f"{bare}100,1,2,3\n200,2,3,4\n300,1,2,3\n".replace(",", mark)
    read = tuple(Mapping(f"#{k}", "launch_range_um", Unit("um")) for k in (2, 3, 4))
    by_number = (Mapping("#1", "frequency_hz", Unit("Hz")), *read)
    by_name = (Mapping("frequency", "frequency_hz", Unit("Hz")), Mapping("reading", "launch_range_um", Unit("um")))
    for columns in ((), by_number, by_name if "reading" in bare else by_number):
        for values in ((), HELD[1:]):
            with pytest.raises(InputError):
                tables(tmp_path, content, columns=columns, values=values)


def test_what_bare_numbers_are_is_written_into_the_headings(tmp_path: Path) -> None:
    content = f"{BARE['above words']}100,1,2,3\n200,2,3,4\n"
    asked = refused(tmp_path, content, values=HELD[1:])
    assert "'5', '10', '20' above part them; write what these are into the headings" in asked
    named = content.partition("\n")[2]
    for volts in (5, 10, 20):
        named = named.replace("Range (um)", f"Range at {volts} Vp (um)", 1)
    group = one(tmp_path, named)
    assert group.amplitude_v.tolist() == [5, 10, 20] * 2 and group.reading.tolist() == [1, 2, 3, 2, 3, 4]
    assert one(tmp_path, f"#{content}", values=HELD[1:]).n_points == 6


@pytest.mark.parametrize("above", ["Run,1,2,3", ",1,2,3", ",0,1,2", "Shot,4,5,6", "Date,2026", "Lab,3"])
def test_numbers_that_follow_one_another_part_none(above: str, tmp_path: Path) -> None:
    assert one(tmp_path, f"{above}\n{HEAD}100,1,2,3\n", values=HELD[1:]).reading.tolist() == [1.0, 2.0, 3.0]


def test_lines_above_the_headings_that_matter_to_the_drive_are_shown(tmp_path: Path) -> None:
    """What is no such name, is given, or is a constant of the rig, which is asked for anyway, is not."""
    lines = "# Amplifier gain: 20\nBurst cycles;5\n# Coupling: DC\n# Ball mass: 3 g\nOffset;0\nGain;1\n"
    content = f"{lines}f (Hz);Range (um);U (Vp)\n100;3;20\n"
    volts = (1, "# Amplifier gain: 20", "give volts behind the amplifier")
    (found,) = tables(tmp_path, content)
    assert found.above == (volts, (2, "Burst cycles 5", "say --set cycles=NUMBER"))
    (found,) = tables(tmp_path, content, values=(("cycles", 5.0),))
    assert found.above == (volts,)
    for burst, remedy in (("5 cycles", "say --set cycles=NUMBER"), ("5 ms", "give its periods, cycles, which are")):
        (found,) = tables(tmp_path, f"Burst: {burst}\nf (Hz);Range (um);U (Vp)\n100;3;20\n")
        assert found.above[0][2].startswith(remedy)


@pytest.mark.parametrize("labels", ["Test 3;;;", "Hz;um;Vp;um", "Run;1;2;3", ";Ranges"])
def test_a_title_above_the_headings_parts_none(labels: str, tmp_path: Path) -> None:
    content = f"{labels}\nf (Hz);Range (um);U (Vp);Range (um)\n100;3;20;4\n"
    assert one(tmp_path, content).reading.tolist() == [3.0, 4.0]
    numbered = "Operator;Lab 3\nRange 1 (um);Range 2 (um)\n3;4\n"
    assert one(tmp_path, numbered, values=HELD).reading.tolist() == [3.0, 4.0]


@pytest.mark.parametrize(
    ("above", "remedy"),
    [
        ("Drive: 0-40 V", "if that is the drive, say --waveform unipolar_sine, or --set bias_v=20 --set idle_v=NUMBER"),
        ("Voltage range: 0 to 40 V", "if that is the drive, say --waveform unipolar_sine"),
        ("Ansteuerung 0 bis 40 V", "if that is the drive, say --waveform unipolar_sine"),
        ("Drive 5 ... 25 V", "if that is the drive, say --set bias_v=15"),
        ("Drive: -20 to 20 V", ""),
        ("Band 0.5-40 kHz", ""),
        ("HV amp: 20x", "give volts behind the amplifier"),
        ("Signal generator: 2 Vpp, gain x20", "give volts behind the amplifier"),
        ("probe 10x", "give volts behind the attenuator"),
        ("Drive: burst of 3 cycles", "say --set cycles=NUMBER"),
        ("Drive: as usual, gain x1", ""),
        ("Offset: 1 V, gain x20", "say --set bias_v=NUMBER"),
        ("Amplitude: 5-40 V", "correct amplitude_v in the rows"),
        ("Scope input range: 0-10 V", ""),
        ("Probe: laser", ""),
        ("Sensor: probe 2", ""),
        ("probe 1x", ""),
    ],
)
def test_a_clause_above_the_headings_that_matters_is_shown(above: str, remedy: str, tmp_path: Path) -> None:
    (found,) = tables(tmp_path, f"{above}\nf (Hz);Vp;Range (um)\n1000;20;25\n1200;20;28\n")
    assert [said.startswith(remedy) for _, text, said in found.above if text == above] == [True] * bool(remedy)


@pytest.mark.parametrize(
    ("above", "asked"),
    [
        ("Delay: 7 us", True),
        ("Signal delay: 7 us", True),
        ("Range: 100 mm/s/V; Delay 7 us", True),
        ("Delay between launches: 10 s", False),
        ("Averages 16, delay between shots 2 s", False),
    ],
)
def test_a_delay_above_a_trace_is_asked_about(above: str, asked: bool, tmp_path: Path) -> None:
    content = trace("Time (us)", lambda k: str(5 * k), above=f"{above}\n")
    if asked:
        assert "may say when the drive starts" in refused(tmp_path, content, values=HELD)
    else:
        assert one(tmp_path, content, values=HELD).n_points == len(MOTION)


def test_a_matter_that_is_given_hides_no_other_of_its_line(tmp_path: Path) -> None:
    above = "Offset: 1 V, gain x20"
    said = (("bias_v", 1.0), ("idle_v", 1.0))
    (found,) = tables(tmp_path, f"{above}\nf (Hz);Vp;Range (um)\n1000;20;25\n", values=said)
    assert found.above == ((1, above, "give volts behind the amplifier"),)


@pytest.mark.parametrize("column", ["Probe ID", "Probe no.", "Probe temperature (°C)"])
def test_a_probe_in_a_column_is_no_matter(column: str, tmp_path: Path) -> None:
    assert one(tmp_path, f"f (Hz);Vp;Range (um);{column}\n1000;20;25;7\n1200;20;28;8\n").n_points == 2


def test_tables_next_to_one_another_are_not_read_crosswise(tmp_path: Path) -> None:
    line = refused(tmp_path, "f1 (Hz),R1 (um),f2 (Hz),R2 (um)\n1000,25,1100,25.2\n1200,28,1300,28.3\n", values=HELD[1:])
    assert "'f1 (Hz)', 'f2 (Hz)' could all be frequency_hz, each of a table next to the others; save each" in line
    apart = refused(tmp_path, "f1 (Hz),R1 (um),,f2 (Hz),R2 (um)\n1000,25,,1100,25.2\n", values=HELD[1:])
    assert "each of a table next to the others" in apart
    other = refused(tmp_path, "Frequency A (Hz),Frequency B (Hz),Range (um)\n1000,1000,25\n", values=HELD[1:])
    assert "next to the others" not in other


def test_a_heading_over_several_columns_may_hold_for_each(tmp_path: Path) -> None:
    """As a merged cell leaves it; what the line proposes reads all of them."""
    content = "f (kHz);Vpp;Launch range (um);;;Note\n1;40;25;25,5;26;ok\n1,2;40;28;28,5;27;ok\n"
    line = refused(tmp_path, content)
    every = " ".join(f"--column {k}=launch_range_um:um" for k in (3, 4, 5))
    assert f"columns 4, 5 hold numbers and have no headings that say what; give each one, say {every} if they" in line
    mappings = tuple(proposed(line, k) for k in range(3))
    assert one(tmp_path, content, columns=mappings).reading.tolist() == [25.0, 25.5, 26.0, 28.0, 28.5, 27.0]


def test_the_option_that_is_proposed_has_the_unit_of_its_column(tmp_path: Path) -> None:
    content = "Set frequency (Hz),Actual frequency (Hz),Vpp (V),Range (um)\n1000,999.2,40,25.1\n"
    line = refused(tmp_path, content)
    assert "frequency_hz:kHz" not in line and "'Actual frequency (Hz)=frequency_hz'" in line
    mapping = proposed(line, 1)
    assert one(tmp_path, content, columns=(mapping,)).frequency_hz.tolist() == [999.2]


@pytest.mark.parametrize(("samples", "asked"), [(50, True), (130, True), (250, False)])
def test_a_recording_of_less_than_a_period_does_not_count_volts_peak_to_peak(
    samples: int, asked: bool, tmp_path: Path
) -> None:
    """A sine of 1 kHz and 20 V, every 5 us, whose rest comes before."""
    rows = [(5 * k, 20 * math.sin(2e-3 * math.pi * 5 * k), 0.01 * k * k) for k in range(samples)]
    content = "Time (us);Drive (V);Velocity (mm/s)\n" + "".join(f"{t};{u:.4f};{v:.4f}\n" for t, u, v in rows)
    said = {"values": (("frequency_hz", 1000.0), ("amplitude_v", 40.0)), "waveforms": (), "start_us": 0.0}
    if asked:
        line = refused(tmp_path, content, counted=("pp",), **said)
        assert "40 V peak to peak, and the recorded drive goes from" in line and "in Vp" in line
    else:
        assert one(tmp_path, content, counted=("pp",), **said).amplitude_v[0] == pytest.approx(20.0, rel=1e-3)
    peaks = said | {"values": (("frequency_hz", 1000.0), ("amplitude_v", 20.0))}
    assert one(tmp_path, content, counted=("peak",), **peaks).amplitude_v[0] == 20.0


@pytest.mark.parametrize(("value", "asked"), [(None, True), ("25.1", False)])
def test_a_formula_without_its_value_is_no_empty_cell(value: str | None, asked: bool, tmp_path: Path) -> None:
    """As a program writes it that does not calculate; a spreadsheet's has its value, which may be no text."""
    from zipfile import ZipFile

    from openpyxl import Workbook

    book = Workbook()
    for row in (("f (Hz)", "Vpp", "Range 1 (um)", "Range 2 (um)"), (1000, 40, 25, "=24+1.1"), (1200, 40, 30, 30.4)):
        book.worksheets[0].append(row)
    book.save(tmp_path / "made.xlsx")
    with ZipFile(tmp_path / "made.xlsx") as made, ZipFile(tmp_path / "in.xlsx", "w") as saved:
        for name in made.namelist():
            text = made.read(name)
            if value:
                text = re.sub(rb"</f><v ?/>|</f><v></v>", f"</f><v>{value}</v>".encode(), text)
            saved.writestr(name, text)
    options = Options(waveforms=("sine",))
    if asked:
        with pytest.raises(InputError, match="cell D2 of sheet 'Sheet' holds a formula without its value; open"):
            read_files([tmp_path / "in.xlsx"], options)
    else:
        assert read_files([tmp_path / "in.xlsx"], options)[0].groups[0].reading.tolist() == [25.0, 25.1, 30.0, 30.4]


def test_a_trace_without_a_sample_behind_its_start_is_one_clear_line(tmp_path: Path) -> None:
    line = refused(tmp_path, trace("Time (us)", lambda k: str(5 * k)), values=HELD, start_us=100.0)
    assert "0 samples after the start of the drive" in line


def test_samples_next_to_a_header_are_no_headings(tmp_path: Path) -> None:
    """As an oscilloscope of the nineties writes them; what the line proposes reads them."""
    header = ["Record Length,2.5e+03", "Sample Interval,4e-06", "Vertical Units,V", "Horizontal Units,s", "Model,TDS"]
    samples = [f",{4e-6 * k:.9f},{2e-3 * k * k:.5f}," for k in range(30)]
    content = "\n".join([*map("".join, zip([f"{h}," for h in header], samples, strict=False))] + [
        f",,{sample}" for sample in samples[len(header) :]
    ])  # fmt: skip
    line = refused(tmp_path, content, values=HELD)
    assert "of samples over time --column 4=time_us:s --column 5=velocity_mm_s:m/s" in line
    columns = tuple(proposed(line.partition("of samples")[2], k) for k in (0, 1))
    assert one(tmp_path, content, values=HELD, columns=columns).reading.tolist() == [
        pytest.approx(2.0 * k * k) for k in range(30)
    ]

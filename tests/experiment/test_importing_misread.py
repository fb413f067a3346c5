"""Files that read as something else than they are: asked about in one line, with a remedy that reads them right."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from imported import refused, tables

from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment.importing import Mapping
from psafit.experiment.importing.headings import heading
from psafit.experiment.importing.units import Unit

RESTS = (("idle_v", 0.0),)
OFFSET = "Frequency (Hz);Amplitude (Vpp);DC offset (V);Range (um)\n1200;20;10;76\n1300;20;10;75\n1400;20;10;73.5\n"


@pytest.mark.parametrize("waveform", ["unipolar_sine", "unipolar_square", "unipolar_triangle"])
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


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("offset sine", "a sine with bias_v"),
        ("Cosine", "phase_deg = 90"),
        ("|sin|", "none of psafit's"),
        ("-sine", "for any other voltage"),
        ("\u2212square", "for any other voltage"),
        ("sin\u00b2", "for any other voltage"),
    ],
)
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
        "Instant (s)",
        "Velocity (mm/s)",
        "{}",
        "say --column 'Instant (s)=time_us', or --column",
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


UNREAD = {
    "decibels of a volt": ("f (Hz)", "Level (dBV)", "Range (um)", 1, "10^(x/20) of each number x, in V RMS"),
    "decibels of a range": ("f (Hz)", "Vp", "Range (dB re 1 um)", 2, "times what 0 dB stands for"),
    "a field": ("f (Hz)", "Field (kV/mm)", "Range (um)", 1, "times the thickness of a layer"),
    "per cent": ("f (Hz)", "Amplitude [%]", "Range (um)", 1, "the part times what the whole is, in V"),
    "a period": ("Period (us)", "Vp", "Range (um)", 0, "give one over the period, in Hz"),
    "radians": ("omega / rad/s", "Vp", "Range (um)", 0, "give it over 2 pi, in Hz"),
    "a logarithm": ("log10 f (Hz)", "Vp", "Range (um)", 0, "give 10^x of each number x"),
    "a speed": ("f (Hz)", "Vp", "Range (mm/s)", 2, "give it in um, or correct its heading"),
    "volts": ("f (Hz)", "Vp", "Range (V)", 2, "say what one volt is: --column 'Range (V)=launch_range_um:5um/V'"),
}
NAMES = ("frequency_hz", "amplitude_v", "launch_range_um")


@pytest.mark.parametrize(("f", "u", "r", "place", "said"), UNREAD.values(), ids=UNREAD.keys())
def test_a_unit_of_another_kind_is_converted_by_its_owner(
    f: str, u: str, r: str, place: int, said: str, tmp_path: Path
) -> None:
    """Also where a row of units gives it, and where the user hides it behind one of psafit's."""
    headings = (f, u, r)
    content = ";".join(headings) + "\n2;20;30\n3;20;40\n"
    assert said in refused(tmp_path, content)
    unit = ("Hz", "V", "um")[place]
    hidden = Mapping(headings[place], NAMES[place], Unit(unit))
    assert said in refused(tmp_path, content, columns=(hidden,))


def test_a_row_of_units_hides_none_either(tmp_path: Path) -> None:
    content = "f;Amplitude;Range\nHz;dBV;um\n100;20;30\n"
    assert "in V RMS" in refused(tmp_path, content)
    assert "in V RMS" in refused(tmp_path, content, columns=(Mapping("2", "amplitude_v", Unit("V", "pp")),))


@pytest.mark.parametrize(("name", "column"), [("DC offset (%)", "bias_v"), ("Sigma (dB)", "sigma_um")])
def test_what_need_not_be_there_is_not_left_out_for_its_unit(name: str, column: str, tmp_path: Path) -> None:
    content = f"f (Hz);Vp;Range (um);{name}\n100;20;30;5\n"
    asked = refused(tmp_path, content)
    assert f"no unit of {column}; " in asked and asked.endswith(f"or say --column '{name}=ignore'")
    (table,) = tables(tmp_path, content, columns=(Mapping(name, "ignore"),))
    assert table.groups[0].n_points == 1


def test_traces_next_to_each_other_are_no_repetitions(tmp_path: Path) -> None:
    rows = "".join(f"{k};{k};{2 * k};{k}\n" for k in range(12))
    assert "another table next to the first" in refused(tmp_path, f"Time (us);x (um);Time (us);x (um)\n{rows}", **HELD)


def test_remarks_in_brackets_are_no_units(tmp_path: Path) -> None:
    content = "f (set);Amplitude (drive);Range (run 2);Humidity (%)\n100;40;30;50\n"
    units = (Unit("Hz"), Unit("V", "pp"), Unit("um"))
    said = tuple(Mapping(str(k), name, unit) for k, (name, unit) in enumerate(zip(NAMES, units, strict=True), 1))
    (table,) = tables(tmp_path, content, columns=said)
    assert table.groups[0].amplitude_v.tolist() == [20.0] and table.unused == ("Humidity (%)",)
    with pytest.raises(InputError) as caught:
        tables(tmp_path, content)
    assert "in '%'" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [("U/V", "V"), ("amp/V", "V"), ("omega / rad/s", "rad/s"), ("Field kV/mm", "kV/mm"), ("v/mm/s", "mm/s")],
)
def test_a_unit_without_brackets_is_whole(text: str, said: str) -> None:
    found = heading(text).unit
    assert found is not None and found.text == said


SIDE = "f (Hz);Vp;Range (um);;f (Hz);Vp;Range (um)\n100;20;1.5;;100;20;2\n150;20;4;;150;20;5.6\n"


def test_tables_next_to_each_other_are_no_repetitions(tmp_path: Path) -> None:
    """Also where numbers of columns choose the conditions of the first."""
    asked = refused(tmp_path, SIDE)
    others = [f"--column {k}=ignore" for k in (5, 6, 7)]
    assert asked.endswith(f"save each as a file of its own, or say {' '.join(others)}")
    first = (Mapping("1", "frequency_hz"), Mapping("2", "amplitude_v"))
    assert refused(tmp_path, SIDE, columns=first) == asked
    left = tuple(Mapping(str(k), "ignore") for k in (5, 6, 7))
    assert refused(tmp_path, SIDE, columns=left[:2]) == asked
    (table,) = tables(tmp_path, SIDE, columns=left)
    assert table.groups[0].reading.tolist() == [1.5, 4.0]


def test_one_of_several_columns_of_one_heading_is_named_by_its_number(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (Hz);f (Hz);Vp;Range (um)\n100;100;20;1.5\n")
    assert asked.endswith("say which: --column 2=frequency_hz")


def test_a_minus_of_typesetters_is_one(tmp_path: Path) -> None:
    content = OFFSET.replace(";10;", ";\N{MINUS SIGN}1.5e1;")
    (table,) = tables(tmp_path, content, values=RESTS)
    assert table.groups[0].drive.bias_v == -15.0


@pytest.mark.parametrize("heading", ["Vib Velocity", "Vibration velocity", "Measured velocity"])
def test_what_vibrometers_call_their_velocity(heading: str, tmp_path: Path) -> None:
    content = f"Signal:;Time Domain\n\nTime;{heading}\n[ s ];[ m/s ]\n" + "".join(f"{k}e-5;{k}\n" for k in range(12))
    (table,) = tables(tmp_path, content, **HELD, start_us=0.0)
    assert table.groups[0].observable.column == "velocity_mm_s" and table.groups[0].reading[1] == 1000.0


def test_one_column_in_a_unit_of_motion_is_proposed(tmp_path: Path) -> None:
    content = "Time (s);Laser (um);Status\n" + "".join(f"{k}e-5;{k};0\n" for k in range(12))
    assert "; say --column 'Laser (um)=displacement_um' if it is" in refused(tmp_path, content, **HELD)


def test_the_ends_of_a_drive_are_its_amplitude_and_bias(tmp_path: Path) -> None:
    asked = refused(tmp_path, "f (Hz);High level (V);Low level (V);Range (um)\n100;20;0;3\n")
    assert "give amplitude_v (Vp), half of their difference, and bias_v, their mean" in asked


# --- rows, columns and lines that are no readings, or more of them -------------------------------------------------

SWEEP = "Frequency (Hz);Amplitude (Vp);Range (um)"
NO_READINGS = {
    "statistics in rows": ("Frequency (Hz);Amplitude (Vp);What;Range (um)\n1200;20;mean;76\n1200;20;std;1\n", "'std'"),
    "a mean, marked behind": (f"{SWEEP};Remark\n1200;20;76;\n1300;20;75;\n1200;20;75.5;Mean of 2\n", "'Mean of 2'"),
    "a word among numbers": (f"Run;{SWEEP}\n1;1200;20;76\n2;1300;20;75\nX;1200;20;75.5\n", "'X' stands where other"),
    "a second row of headings": (
        "frequency_hz;amplitude_v;range_um;range_um\n;;mean;std\n1200;20;76;1\n",
        "'mean', 'std' are more of headings; write each into the heading above it",
    ),
    "deviations alone": (f"What;{SWEEP}\nstd;1200;20;76\nstd;1300;20;75\n", "'std' sums up readings"),
    "a condition without its name": (f"{SWEEP}\n1200;20;76\n# Set 2: 40 Vpp\n1200;20;75\n", "may say what changes"),
    "a waveform between": (f"{SWEEP}\n1200;20;76\n# square\n1200;20;75\n", "'# square' between readings may say what"),
    "a condition between": (f"{SWEEP}\n1200;20;76\n# f = 1.3 kHz\n1200;20;75\n", "give each sweep a file"),
    "an end of the drive": (f"{SWEEP};Low level (V)\n1200;20;76;0\n", "is an end of the drive, whose middle no column"),
    "a reading in another unit": (f"{SWEEP};Peak force (lbf/in)\n1200;20;76;1\n", "is in 'lbf/in', which is no unit"),
    **{
        f"{what} in another order": (
            f"{SWEEP}\n1200;20;76\n1300;20;75\n{rows}",
            f"columns '{which[0]}' and '{which[1]}' seem to have changed places from here on, in {n}",
        )
        for what, rows, which, n in (
            (
                "a block below an empty line",
                "\n20;1200;76\n20;1300;75\n",
                ("Frequency (Hz)", "Amplitude (Vp)"),
                "2 rows",
            ),
            ("a block", "40;1200;150\n40;1300;148\n", ("Frequency (Hz)", "Amplitude (Vp)"), "2 rows"),
            ("a block between", "76;20;1200\n75;20;1300\n1400;20;70\n", ("Frequency (Hz)", "Range (um)"), "2 rows"),
            ("a row", "20;1400;70\n1500;20;69\n", ("Frequency (Hz)", "Amplitude (Vp)"), "1 row"),
        )
    },
    "a repetition by another name": (
        f"{SWEEP};Range (um) repeat\n1200;20;76;75\n",
        "columns 'Range (um)', 'Range (um) repeat' could all be launch",
    ),
    "a second without its name": (f"{SWEEP};2nd (um)\n1200;20;76;75\n", "columns 'Range (um)', '2nd (um)' could all"),
    "a second without its unit": (f"{SWEEP};2nd\n1200;20;76;75\n", "has no heading that says what"),
    "a mean alone": (
        "Frequency (Hz);Amplitude (Vp);Mean range (um);SD (um)\n1200;20;76;1\n",
        "say --column 'Mean range (um)=launch_range_um', if its numbers are that by their unit, with no further factor"
        "; a mean counts as one reading: better give each that it is of",
    ),
    "a flag": (f"{SWEEP};Status\n1200;20;76;OK\n1300;20;75;OVERLOAD\n", "marks some readings, and psafit takes all"),
}


@pytest.mark.parametrize(("content", "said"), NO_READINGS.values(), ids=NO_READINGS.keys())
def test_what_is_no_reading_is_not_counted_as_one(content: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        tables(tmp_path, content)
    assert any(said in line for line in str(caught.value).splitlines()), caught.value


READ_SO = {
    "as pandas writes repetitions": "frequency_hz;amplitude_v;range_um;range_um.1\n1200;20;76;75\n",
    "as MATLAB writes repetitions": "frequency_hz;amplitude_v;range_um;range_um_1\n1200;20;76;75\n",
    "a block at conditions of its own": f"{SWEEP}\n1200;20;76\n\n1200;20;75\n",
    "first and second": "frequency_hz;amplitude_v;1st range (um);Range 2nd (um)\n1200;20;76;75\n",
    "means alone": "Frequency (Hz);Amplitude (Vp);What;Range (um)\n1200;20;mean;76\n1200;20;mean;75\n",
    "Fortran's exponents": f"{SWEEP}\n1.2D+03;2D+1;7.6D+01\n1.2D+03;2D+1;7.5D+01\n",
    "Spanish, thousandths of an inch": (
        "Frecuencia (kHz);Tensión pico a pico (V);Alcance (mils)\n1,2;40;2,9921259842519685\n1,2;40;2,952755905511811\n"
    ),
    "values that are missing": f"{SWEEP};Temp (C)\n1200;20;76;21\n1200;20;75;NaN\n",
    "remarks": f"{SWEEP};Remark\n1200;20;76;-\n1200;20;75;again\n",
    "remarks that are no conditions": f"{SWEEP}\n1200;20;76\n# f repeated at 12:30\n# Amp off for 5 min\n1200;20;75\n",
    "a name": f"{SWEEP};Operator\n1200;20;76;Anna\n1200;20;75;Max Weber\n",
    "another maximum": f"{SWEEP};Vmax (mm/s)\n1200;20;76;3\n1200;20;75;3\n",
    "a remark between": f"{SWEEP}\n1200;20;76\n# realigned\n1200;20;75\n",
}


@pytest.mark.parametrize("content", READ_SO.values(), ids=READ_SO.keys())
def test_what_is_a_reading_is_read(content: str, tmp_path: Path) -> None:
    (table,) = tables(tmp_path, content)
    (group,) = table.groups
    assert (group.frequency_hz.tolist(), group.amplitude_v.tolist()) == ([1200.0] * 2, [20.0] * 2)
    assert group.reading.tolist() == pytest.approx([76.0, 75.0], rel=1e-14)


IN_KHZ = "Frequency (kHz);Amplitude (Vp);Range (um)"
FAR_APART = {
    "other sizes": "0.1;20;76\n0.2;20;75\n10;20;1\n20;20;0.8\n",
    "sizes of each other, in equal steps": "0.1;20;20\n0.2;20;19\n0.3;20;12\n10;20;0.3\n20;20;0.2\n30;20;0.15\n",
    "mixed": "".join(f"{f};{a};{a}\n" for f, a in ((0.1, 20), (20, 0.1), (0.2, 20), (15, 0.2), (0.15, 30), (10, 0.1))),
}


@pytest.mark.parametrize("rows", FAR_APART.values(), ids=FAR_APART.keys())
def test_frequencies_far_apart_are_in_order(rows: str, tmp_path: Path) -> None:
    blocks = f"{IN_KHZ}\n{rows}".replace("\n10;", "\n\n10;", 1)
    for content in (f"{IN_KHZ}\n{rows}", blocks):
        (table,) = tables(tmp_path, content)
        said = [float(row.partition(";")[0]) for row in rows.splitlines()]
        assert table.groups[0].frequency_hz == pytest.approx([1000 * f for f in said])


def test_sizes_that_change_places_are_in_order_in_another_unit(tmp_path: Path) -> None:
    rows = [(0.1, 20, 30), (0.2, 20, 29), (20, 20, 0.2), (30, 20, 0.1)]
    asked = refused(tmp_path, "\n".join([IN_KHZ, *(f"{f};{a};{r}" for f, a, r in rows)]))
    assert asked.endswith("if they are in order, write one of both in another unit")
    (table,) = tables(tmp_path, "\n".join([f"{SWEEP}", *(f"{1000 * f};{a};{r}" for f, a, r in rows)]))
    assert table.groups[0].reading.tolist() == [r for *_, r in rows]


@pytest.mark.parametrize("name", ["Drive (V, monitor 1:10)", "Piezo voltage (V/10)"])
def test_a_drive_next_to_a_trace_is_asked_about_whatever_its_unit(name: str, tmp_path: Path) -> None:
    rows = "".join(f"{10 * k};{k % 4};0.{k}\n" for k in range(15))
    held = (("frequency_hz", 1200.0), ("amplitude_v", 20.0))
    asked = refused(tmp_path, f"Time (us);{name};Displacement (um)\n{rows}", values=held, start_us=0.0)
    assert "changes along a trace: it may be the drive over time, or another signal; say --column" in asked


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Frequency (Hz);Vrms;Range (um)\n1200;20;76\n", {"values": (("bias_v", 10.0), ("idle_v", 10.0))}),
        ("Frequency (Hz);Vrms;Bias (V);Range (um)\n1200;20;10;76\n", {"values": RESTS}),
        ("Frequency (Hz);U;Bias (V);Range (um)\n1200;20 Vrms;10;76\n", {"values": RESTS}),
        ("Frequency (Hz);Bias (V);Range at 20 Vrms (um)\n1200;10;76\n", {"values": RESTS}),
        (
            "Frequency (Hz);Range (um)\n1200;76\n",
            {"values": (("amplitude_v", 20.0), ("bias_v", 10.0), *RESTS), "counted": ("rms",)},
        ),
    ],
)
def test_effective_volts_on_a_bias_are_asked_about(text: str, said: dict[str, Any], tmp_path: Path) -> None:
    asked = refused(tmp_path, text, **said)
    assert "in.csv:2: volts are RMS, on a bias of 10 V, which may be in them or not" in asked
    assert "give them zero to peak, 1.4142 times the RMS without the bias" in asked
    for name in ("bias_v", "idle_v"):
        said["values"] = tuple((n, 0.0 if n == name else v) for n, v in said["values"])
    (table,) = tables(tmp_path, text.replace(";10;", ";0;"), **said)
    assert table.groups[0].amplitude_v[0] == pytest.approx(20 * 2**0.5)


def test_thousands_that_another_column_decides_are_asked_about(tmp_path: Path) -> None:
    text = "Frequency (kHz);Vpp;Range (um)\n1.000;40;76,0\n1.200;40;75,2\n"
    asked = refused(tmp_path, text)
    assert "in.csv:2: '1.000' may be 1000 or 1.000, and no other number of its column shows which" in asked
    assert "say --decimal , if it is 1000, else write all numbers in one way" in asked
    (table,) = tables(tmp_path, text.replace("kHz", "Hz"))  # 1 Hz drives no ball
    assert table.groups[0].frequency_hz.tolist() == [1000.0, 1200.0]
    (table,) = tables(tmp_path, text.replace("1.", "1,"))
    assert table.groups[0].frequency_hz.tolist() == [1000.0, 1200.0]
    for first in ("1.000,5", "950"):  # shown in the column itself
        (table,) = tables(tmp_path, text.replace("1.000", first))
        assert table.groups[0].frequency_hz[1] == 1.2e6
    asked = refused(tmp_path, "Frequency (Hz);Vpp;Range (um)\n1200,0;40;1.076\n1300,0;40;1.075\n")
    assert "'1.076' may be 1076 or 1.076" in asked

"""Warnings of another unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from folders import HEADER, SIGMA, TOML, write

from psafit.drives import Drive
from psafit.experiment import Group, read_experiment
from psafit.experiment.plausible import suspicious_readings
from psafit.experiment.writer import group_text

CONSTANT_UNITS = {"M": 27.0, "m": 50.0, "q": 0.12, "l": 90.0, "k_s": 48.9, "g": 981.0}


@pytest.mark.parametrize("name", CONSTANT_UNITS)
def test_constant_in_another_unit_is_named(tmp_path: Path, name: str) -> None:
    lines = [
        f"{name} = {CONSTANT_UNITS[name]}" if line.startswith(f"{name} = ") else line for line in TOML.splitlines()
    ]
    warnings = read_experiment(write(tmp_path, "\n".join(lines))).warnings
    assert len(warnings) == 1
    assert f"constant {name} = {CONSTANT_UNITS[name]:g}" in warnings[0]
    assert "is it given in" in warnings[0]


SUSPICIOUS: dict[str, Callable[[float, float, float], tuple[float, float, float]]] = {
    "given in kHz": lambda f, v, r: (f / 1e3, v, r),
    "given in Hz and taken for kHz, 1000 times too large, or given in mHz?": lambda f, v, r: (f * 1e3, v, r),
    "given in kV": lambda f, v, r: (f, v / 1e3, r),
    "given in V and taken for kV, 1000 times too large, or given in mV?": lambda f, v, r: (f, v * 1e3, r),
    "given in mm or m": lambda f, v, r: (f, v, r / 1e3),
    "given in um and taken for mm, 1000 times too large, or given in nm?": lambda f, v, r: (f, v, r * 1e4),
    "nothing drives the ball": lambda f, v, r: (f, 0, r),
    "nothing to fit": lambda f, v, r: (f, v, 0),
}


@pytest.mark.parametrize("words", SUSPICIOUS)
def test_readings_in_another_unit_are_named(tmp_path: Path, words: str) -> None:
    rows = [SUSPICIOUS[words](f, 20, r) for f, r in ((1200, 76), (3000, 34.4), (25000, 0.67))]
    csv = HEADER + "".join(f"{f},{v},{r}\n" for f, v, r in rows)
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert len(warnings) == 1
    assert warnings[0].startswith("a.csv: group 1: ")
    assert words in warnings[0]
    assert warnings[0].isprintable()


@pytest.mark.parametrize(
    ("column", "reading", "said"),
    [
        ("launch_speed_mm_s", 5e4, "given in mm/s and taken for m/s, 1000 times too large, or given in um/s?"),
        ("launch_speed_mm_s", 5e-4, "given in m/s, or in mm/s and taken for um/s, 1000 times too small?"),
        ("contact_time_us", 2e6, "given in us and taken for ms, 1000 times too large, or given in ns?"),
        ("contact_time_us", 0.2, "given in ms or s, or in us and taken for ns, 1000 times too small?"),
        ("peak_force_n", 2e4, "given in N and taken for kN, 1000 times too large, or given in mN?"),
        ("launch_range_um", 0.05, "given in mm or m, or as speeds in mm/s, or in um and taken for nm, 1000 times too"),
    ],
)
def test_a_unit_that_was_right_and_was_converted_is_asked_about(
    column: str, reading: float, said: str, tmp_path: Path
) -> None:
    """Readings a thousand times too large are seldom in a unit that is a thousand times smaller."""
    csv = f"frequency_hz,amplitude_v,{column}\n1200,20,{reading}\n3000,20,{0.9 * reading}\n"
    (warning,) = read_experiment(write(tmp_path, a=csv)).warnings
    assert said in warning


SWEEP = [(f, 20 + k, 76 - k) for k, f in enumerate((1200, 1300, 1400, 1500, 1600))]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([(v, f, r) for f, v, r in SWEEP], "frequencies end at 24 Hz, and amplitudes reach 1600 V; are their columns"),
        ([(f, r, 20) for f, _, r in SWEEP], "every launch range is 20 um at 5 conditions; are columns swapped?"),
        ([(f, r, 20) for f, _, r in SWEEP[:4]], ""),  # of fewer all may be equal
        ([(f, r, 0) for f, _, r in SWEEP], "every launch range is zero"),
        ([(f / 1e3, v, r) for f, v, r in SWEEP], "given in kHz?"),
    ],
)
def test_swapped_columns_are_asked_about(rows: list[tuple[float, float, float]], said: str, tmp_path: Path) -> None:
    csv = HEADER + "".join(f"{f},{v},{r}\n" for f, v, r in rows)
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert [said in w for w in warnings] == [True] * bool(said)


def test_sigma_in_another_unit_is_named(tmp_path: Path) -> None:
    csv = SIGMA + "1200,20,76,400\n3000,20,34,400\n"
    warnings = read_experiment(write(tmp_path, a=csv)).warnings
    assert ["every sigma_um exceeds" in line for line in warnings] == [True]


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (2.0, "2 times those of group 1 at one shared condition; are volts of one of them peak to peak?"),
        (0.5, "0.5 times those of group 1 at one shared condition; are volts of one of them peak to peak?"),
        (1.42, "1.42 times those of group 1 at one shared condition; are volts of one of them RMS?"),
        (
            2.83,
            "2.83 times those of group 1 at one shared condition; are volts of one of them peak to peak, and of"
            " the other RMS?",
        ),
        (25.4, "25.4 times those of group 1 at one shared condition; is one of them in another unit?"),
        (1.3, ""),
    ],
)
def test_groups_that_share_a_condition_and_differ_are_named(tmp_path: Path, factor: float, said: str) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    first = HEADER + "1200,20,50\n1200,2,0.3\n1300,20,45\n"
    second = HEADER + f"1200,20,{50 * factor:.6g}\n1200,2,0.9\n1400,20,1\n"  # 0.3 against 0.9 is scatter
    warnings = read_experiment(write(tmp_path, toml, first, second)).warnings
    assert [w.partition("ranges are ")[2] for w in warnings] == [said] * bool(said)
    other = toml.replace('file = "b.csv"', 'file = "b.csv"\nconstants = { l = 0.06 }')
    assert not read_experiment(write(tmp_path, other, first, second)).warnings


@pytest.mark.parametrize(
    ("waveform", "factor", "said"),
    [
        ("square", 1.42, "in another unit?"),  # its RMS is its peak
        ("square", 2.0, "peak to peak?"),
        ("triangle", 1.73, "RMS?"),
        ("unipolar_sine", 2.0, "in another unit?"),  # from 0 V both are the same
        ("unipolar_square", 1.42, "in another unit?"),
    ],
)
def test_how_volts_may_be_counted_depends_on_the_waveform(
    waveform: str, factor: float, said: str, tmp_path: Path
) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"').replace('"sine"', f'"{waveform}"')
    csv = [HEADER + f"1200,20,{50 * times:.6g}\n1300,20,45\n" for times in (1.0, factor)]
    (warning,) = read_experiment(write(tmp_path, toml, csv[0], csv[1].replace("1300", "1400"))).warnings
    assert warning.endswith(said)


def test_groups_under_a_constant_voltage_are_compared_too(tmp_path: Path) -> None:
    """Its command goes from nowhere to nowhere: volts are counted the same in every way."""
    (tmp_path / "period.csv").write_text("phase,level\n" + "".join(f"{k / 8},0.3\n" for k in range(9)))
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"').replace(
        'waveform = "sine"', 'waveform = "table"\ndrive = "period.csv"'
    )
    csv = [HEADER + f"1200,20,{reading}\n1300,20,45\n" for reading in (50, 100)]
    warnings = read_experiment(write(tmp_path, toml, csv[0], csv[1].replace("1300", "1400"))).warnings
    assert any("2 times those of group 1" in w and w.endswith("is one of them in another unit?") for w in warnings)


@pytest.mark.parametrize(("column", "step", "named"), [("velocity_mm_s", 10, True), ("velocity_mm_s", 20, False)])
def test_a_launch_that_was_traced_twice_is_no_news(column: str, step: int, named: bool, tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"').replace("file =", "trace =")
    toml = toml.replace("trace =", "frequency_hz = 1200\namplitude_v = 20\ntrace =")
    warnings = read_experiment(write(tmp_path, toml, traced(1.0), traced(2.0, column, step))).warnings
    assert any("its times are those of group 1; if both are of one launch" in w for w in warnings) is named


@pytest.mark.parametrize(("f", "v", "named"), [(1201, 20, True), (1200, 20.1, True), (1220, 20, False)])
def test_conditions_that_are_the_same_but_for_rounding_are_compared(
    f: float, v: float, named: bool, tmp_path: Path
) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    csv = [HEADER + "1200,20,50\n1400,20,45\n", HEADER + f"{f},{v},100\n1500,20,45\n"]
    warnings = read_experiment(write(tmp_path, toml, *csv)).warnings
    assert any("2 times those of group 1 at one shared condition" in w for w in warnings) is named


@pytest.mark.parametrize(
    ("volts", "column", "drive", "named"),
    [
        (40, "launch_range_um", "", True),
        (22, "launch_range_um", "", False),
        (40, "contact_time_us", "", False),
        (40, "launch_range_um", "bias_v = 200", False),
    ],
)
def test_a_sweep_measured_again_at_twice_the_volts_is_named(
    volts: float, column: str, drive: str, named: bool, tmp_path: Path
) -> None:
    """Though readings scatter. Not what need not grow with the voltage: a time, launches by a bias."""
    toml, rng = TOML.replace('waveform = "square"', 'waveform = "sine"'), np.random.default_rng(1)
    toml = toml.replace('waveform = "sine"', f'waveform = "sine"\n{drive}')
    csv = [
        f"frequency_hz,amplitude_v,{column}\n"
        + "".join(f"{f},{v},{(60 + f / 100) * (1 + 0.03 * rng.standard_normal()):.4g}\n" for f in range(800, 2000, 100))
        for v in (20, volts)
    ]
    warnings = read_experiment(write(tmp_path, toml, *csv)).warnings
    said = "readings are about those of group 1, and amplitudes are 2 times those there; are volts of one of them peak"
    assert any(said in w for w in warnings) is named


def test_readings_that_grow_are_not_named_for_launches_that_failed(tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    rows = [(f, max(f - 1400, 0) / 10) for f in range(800, 2000, 100)]
    csv = [HEADER + "".join(f"{f},{v},{x * k}\n" for f, x in rows) for v, k in ((20, 1), (40, 4))]
    assert not any("those of group 1, and" in w for w in read_experiment(write(tmp_path, toml, *csv)).warnings)


@pytest.mark.parametrize(("column", "plural"), [("launch_speed_mm_s", "speeds"), ("peak_force_n", "forces")])
def test_groups_whose_speeds_or_forces_differ_are_named(column: str, plural: str, tmp_path: Path) -> None:
    """A time does not grow with the voltage: one that is about the same is right at twice as many volts."""
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    header = f"frequency_hz,amplitude_v,{column},contact_time_us\n"
    warnings = read_experiment(write(tmp_path, toml, f"{header}1200,20,0.5,200\n", f"{header}1200,20,1,190\n")).warnings
    assert len(warnings) == 1
    said = f"{plural} are 2 times those of group 1 at one shared condition; are volts of one of them peak"
    assert said in warnings[0]


def test_a_constant_too_small_is_not_asked_for_the_unit_of_one_too_large(tmp_path: Path) -> None:
    """Nobody gives a string in mm and writes 0.09e-3."""
    (warning,) = read_experiment(write(tmp_path, TOML.replace("l = 0.09", "l = 0.09e-3"))).warnings
    assert warning.endswith("is outside 0.001 to 10; is a power of ten wrong?")


def test_a_stack_of_three_kilograms_is_named(tmp_path: Path) -> None:
    (warning,) = read_experiment(write(tmp_path, TOML.replace("m = 0.005", "m = 3"))).warnings
    assert "constant m = 3 kg is outside" in warning


SWEEP = HEADER + "".join(
    f"{f},20,{r}\n" for f, r in zip((800, 1200, 1700, 2400, 3500), (60, 76, 55, 41, 29), strict=True)
)


def test_a_copied_file_is_named(tmp_path: Path) -> None:
    """Its readings would count twice, and predict themselves."""
    warnings = read_experiment(write(tmp_path, a=SWEEP, b=SWEEP)).warnings
    assert len(warnings) == 1 and "those of group 1 to the last digit; was its file copied?" in warnings[0]
    measured_again = SWEEP.replace(",29", ",29.4")
    assert not read_experiment(write(tmp_path, a=SWEEP, b=measured_again)).warnings


def test_copied_rows_are_named(tmp_path: Path) -> None:
    rows = SWEEP.removeprefix(HEADER)
    warnings = read_experiment(write(tmp_path, a=SWEEP + rows)).warnings
    assert len(warnings) == 1 and "all 5 repeated readings equal the first" in warnings[0]
    assert not read_experiment(write(tmp_path, a=SWEEP + rows.replace(",29", ",30"))).warnings


@pytest.mark.parametrize(
    ("drive", "a", "said"),
    [
        ("".join(f"{i}e-5,{i}\n" for i in range(12)), HEADER + "1200,20,76\n" * 2, "ends after 0.00011 us"),
        ("".join(f"{10 * i},{1000 * i}\n" for i in range(12)), HEADER + "1200,20,76\n" * 2, "reaches 11000 V"),
        ("".join(f"{10 * i},{i}\n" for i in range(12)), SWEEP, "the frequency varies, but a recorded voltage"),
    ],
)
def test_a_recorded_drive_that_cannot_be_is_named(tmp_path: Path, drive: str, a: str, said: str) -> None:
    toml = TOML.replace('waveform = "sine"', 'waveform = "table"\ndrive = "drive.csv"')
    (tmp_path / "drive.csv").write_text("time_us,voltage_v\n" + drive)
    warnings = read_experiment(write(tmp_path, toml, a=a)).warnings
    # The voltages of these recordings are not those of the readings either.
    assert sum(said in text for text in warnings) == 1


def test_a_trace_in_seconds_is_named(tmp_path: Path) -> None:
    toml = TOML.replace('file = "a.csv"', 'trace = "a.csv"\nfrequency_hz = 1200\namplitude_v = 20')
    trace = "time_us,displacement_um\n" + "".join(f"{i}e-5,{i * i / 100}\n" for i in range(12))
    (said,) = read_experiment(write(tmp_path, toml, a=trace)).warnings
    assert "the trace ends after 0.00011 us; is its time given in s or ms?" in said


@pytest.mark.parametrize(("ranges", "asked"), [(range(2, 26, 2), True), (range(2, 18, 2), False), ([9, 11] * 6, False)])
def test_readings_of_one_condition_that_no_scatter_explains_are_named(
    ranges: list[int], asked: bool, tmp_path: Path
) -> None:
    csv = HEADER + "".join(f"1200,20,{r}\n" for r in ranges)
    said = "12 launch ranges of one condition go from 2 to 24 um; are they recorded over time"
    assert any(said in w for w in read_experiment(write(tmp_path, a=csv)).warnings) == asked


TRACED = TOML.replace('file = "a.csv"', 'trace = "a.csv"\nfrequency_hz = 1200\namplitude_v = 20')
TWICE = TRACED.replace('file = "b.csv"', 'trace = "b.csv"\nfrequency_hz = 1200\namplitude_v = 20').replace(
    '"square"', '"sine"'
)


def traced(factor: float, column: str = "displacement_um", step: int = 10) -> str:
    """A ball that leaves after 200 us."""
    rows = (f"{t},{factor * (0.001 * t + max(0, t - 200) / 50)}\n" for t in range(0, 601, step))
    return f"time_us,{column}\n" + "".join(rows)


@pytest.mark.parametrize(
    ("a", "asked"),
    [(traced(-1), True), (traced(1), False), (traced(-1, "tip_displacement_um"), False)],
    ids=["turned", "right", "the tip's"],
)
def test_a_trace_of_the_other_sign_is_named(a: str, asked: bool, tmp_path: Path) -> None:
    warnings = read_experiment(write(tmp_path, TRACED, a=a)).warnings
    assert [
        w.endswith("ends at -8.6 um: the ball is thrown to the negative side; is the sign turned?") for w in warnings
    ] == [True] * asked


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (2.0, "2 times those of group 1 at 21 shared samples; are volts of one of them peak to peak?"),
        (1e3, "1e+03 times those of group 1 at 21 shared samples; is one of them in another unit?"),
        (-1.0, "-1 times those of group 1 at 21 shared samples; is the sign of one of them turned?"),
        (1.2, ""),
    ],
)
def test_traces_of_one_condition_that_differ_are_named(factor: float, said: str, tmp_path: Path) -> None:
    """By hand: 0.021 t - 4 um is beyond half of 8.6 um from 400 us on: 21 times of the first."""
    warnings = read_experiment(write(tmp_path, TWICE, a=traced(1), b=traced(factor, step=15))).warnings
    assert [said in w for w in warnings if "those of group" in w] == [True] * bool(said)
    other = TWICE.replace("amplitude_v = 20", "amplitude_v = 10", 1)
    warnings = read_experiment(write(tmp_path, other, a=traced(1), b=traced(factor, step=15))).warnings
    assert not any("those of group" in w for w in warnings)


@pytest.mark.parametrize(
    ("factor", "asked"),
    [(1e3, "contact times are 1e+03 times those of group 1 at one shared condition; is one of them in another unit, or"
           " counted from another moment?"), (1.2, "")],
)  # fmt: skip
def test_contact_times_are_compared_but_volts_explain_none(factor: float, asked: str, tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    head = "frequency_hz,amplitude_v,contact_time_us\n"
    csv = [f"{head}1200,20,{150 * times:g}\n{f},20,{130 * times:g}\n" for f, times in ((1300, 1.0), (1400, factor))]
    warnings = read_experiment(write(tmp_path, toml, *csv)).warnings
    assert [asked in w for w in warnings if "those of group" in w] == [True] * bool(asked)


@pytest.mark.parametrize(
    ("noise", "length", "asked"),
    [(0.2, 1.0, True), (0.0, 1.5, False), (6.0, 1.0, False), (math.inf, 1.0, False)],
)
def test_recordings_of_one_drive_differ_by_noise(noise: float, length: float, asked: bool, tmp_path: Path) -> None:
    """Noise of a hundredth leaves it one drive; another length, much noise, or a burst that ends before, do not."""
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    csv = [HEADER + f"1200,20,{reading}\n1300,20,45\n" for reading in (50, 100)]
    rng = np.random.default_rng(1)
    for name, to, scale in (("a", 1.0, 0.0), ("b", length, noise)):
        table = f'"table"\ndrive = "{name}-u.csv"\nidle_v = {0.01 * (name == "b")}\nfile = "{name}.csv"'
        toml = toml.replace(f'"sine"\nfile = "{name}.csv"', table)
        volts = 20 * np.sin(np.arange(51) / 8)
        volts = np.where(np.arange(51) < 20, volts, 0.0) if math.isinf(scale) else volts + scale * rng.normal(size=51)
        rows = [f"{1000 * to * k / 50:g},{u:.5g}" for k, u in enumerate(volts)]
        (tmp_path / f"{name}-u.csv").write_text("\n".join(["time_us,voltage_v", *rows]) + "\n")
    warnings = read_experiment(write(tmp_path, toml, csv[0], csv[1].replace("1300", "1400"))).warnings
    assert any("2 times those of group 1" in w for w in warnings) is asked


@pytest.mark.parametrize(("keys", "asked"), [("bias_v = 10", True), ("bias_v = 10\nidle_v = 0", False)])
def test_a_bias_without_what_it_rests_at_is_named(keys: str, asked: bool, tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "sine"', f'waveform = "sine"\n{keys}')
    experiment = read_experiment(write(tmp_path / "a", toml))
    said = "group 1: the drive jumps from 0 to 10 V at its start; does it rest there? Then say idle_v = 10,"
    assert [said in w for w in experiment.warnings] == [True] * asked
    assert "\nbias_v = 10\nidle_v = 0\n" in group_text(experiment.groups[0], "a.csv")


@pytest.mark.parametrize(("first", "said"), [(20.0, "jumps from 0 to 20 V at its start"), (0.5, "")])
def test_a_recording_that_begins_off_zero_without_what_it_rests_at_is_named(
    first: float, said: str, tmp_path: Path
) -> None:
    """Noise is no jump. What is written again says what the drive rests at."""
    toml = TOML.replace('waveform = "sine"', 'waveform = "table"\ndrive = "drive.csv"')
    rows = [(0, first), *((10 * k, 20 + 20 * math.sin(k)) for k in range(1, 12))]
    (tmp_path / "drive.csv").write_text("time_us,voltage_v\n" + "".join(f"{t},{u:.3f}\n" for t, u in rows))
    experiment = read_experiment(write(tmp_path, toml))
    assert [said in w for w in experiment.warnings if "jumps" in w] == [True] * bool(said)
    assert "\nidle_v = 0\n" in group_text(experiment.groups[0], "a.csv")


@pytest.mark.parametrize(("top", "asked"), [(20.0, True), (1.2, False)])
def test_levels_in_volts_are_named(top: float, asked: bool, tmp_path: Path) -> None:
    toml = TOML.replace('waveform = "sine"', 'waveform = "table"\ndrive = "drive.csv"')
    (tmp_path / "drive.csv").write_text(f"phase,level\n0,0\n0.5,{top}\n1,0\n")
    warnings = read_experiment(write(tmp_path, toml)).warnings
    said = "reach 20, and a level is per volt of amplitude_v; are these volts? Then divide them by the amplitude"
    assert [w.endswith(said) for w in warnings] == [True] * asked


def test_a_step_by_a_bias_launches_at_no_amplitude() -> None:
    """As `Conditions.driven` says: a reading there is no offset, as one of a drive that rests is."""
    f, v, y = np.full(2, 500.0), np.array([0.0, 5.0]), np.array([3.0, 20.0])
    for bias, warned in ((20.0, False), (0.0, True)):
        found = suspicious_readings(Group("1", Drive("square", bias_v=bias), "1.csv", f, v, y), None)
        assert any("at 0 V" in said for said in found) is warned


@pytest.mark.parametrize("name", ["bias_v", "idle_v"])
def test_a_voltage_of_all_launches_beyond_any_stack_is_named(name: str, tmp_path: Path) -> None:
    keys = {"bias_v": 0.0, "idle_v": 0.0, name: 1e4}
    lines = "".join(f"\n{key} = {value}" for key, value in keys.items())
    warnings = read_experiment(write(tmp_path, TOML.replace('waveform = "sine"', f'waveform = "sine"{lines}'))).warnings
    (said,) = (w for w in warnings if "above 1 kV" in w)
    assert f"group 1: {name} = 10000 V, above 1 kV; given in V and taken for kV" in said


@pytest.mark.parametrize(
    ("hertz", "volts", "said"),
    [
        (1.0, 2.0, "amplitudes are 2 times those there; are volts of one of them peak to peak?"),
        (1.0, 0.70711, "amplitudes are 0.7071 times those there; are volts of one of them RMS?"),
        (math.tau, 1.0, "frequencies are 6.283 times those there; is one of them in rad/s?"),
        (1e-3 * 25, 1.0, "frequencies are 0.025 times those there; is one of them in another unit?"),
        (2.0, 2.0, ""),
        (1.0, 1.005, ""),
    ],
)
def test_groups_of_the_same_readings_at_other_conditions_are_named(
    hertz: float, volts: float, said: str, tmp_path: Path
) -> None:
    toml = TOML.replace('waveform = "square"', 'waveform = "sine"')
    rows = [(800, 20, 60), (1200, 20, 76), (1700, 25, 55), (2400, 20, 41), (3500, 20, 29)]
    first, other = (
        HEADER + "".join(f"{f * h:.6g},{v * u:.6g},{r}\n" for f, v, r in rows) for h, u in ((1, 1), (hertz, volts))
    )
    warnings = [w for w in read_experiment(write(tmp_path, toml, first, other)).warnings if "readings are those" in w]
    assert [w.endswith(f": readings are those of group 1, and {said}") for w in warnings] == [True] * bool(said)
    measured = other.replace(",76", ",70")
    warnings = [*read_experiment(write(tmp_path, toml, first, measured)).warnings]
    assert not any("readings are those" in w for w in warnings)


@pytest.mark.parametrize(
    ("shift", "scale", "said"),
    [
        (500, 1, "begins 500 us after the start of the drive, more than 10 samples; do its times count from there?"),
        (1e6, 1, "begins 1e+06 us after the start of the drive, more than 10 samples"),
        (0, 1e3, "samples are 1e+04 us apart, and a period of the drive lasts 833.3 us; given in us and taken for ms"),
        (90, 1, ""),
    ],
)
def test_the_clock_of_a_trace_is_asked_about(shift: float, scale: float, said: str, tmp_path: Path) -> None:
    head, *rows = traced(1).splitlines()
    moved = ((float(t) * scale + shift, y) for t, y in (row.split(",") for row in rows))
    trace = "\n".join([head, *(f"{t:.10g},{y}" for t, y in moved)]) + "\n"
    warnings = read_experiment(write(tmp_path, TRACED, a=trace)).warnings
    assert [said in w for w in warnings] == [True] * bool(said)

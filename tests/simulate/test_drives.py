"""Every drive on both engines against the reference, and against what is known of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from mpmath import mp
from rigs import RIG, TRUTH

from psafit.arrays import FloatArray
from psafit.drives import WAVEFORMS, Drive, Table
from psafit.physics import TERMS, term, terms
from psafit.physics.term import Setup
from psafit.simulate import Design, Simulation, closed_form, simulate
from psafit.simulate.command import COMMAND, driven
from psafit.simulate.contract import Draw, draw
from psafit.simulate.drive import BEGIN, END, PIECE, SIGN, first_piece, next_piece, voltage
from psafit.simulate.literal import LiteralLaunch
from psafit.simulate.reference import Point
from psafit.simulate.sensitivity import plausible

# Of what a drive makes of its command, every cause; one of each other slot.
OF_THE_DRIVE = tuple((t.id,) for t in TERMS if t.slot in ("drive", "stack"))
CAUSES = (
    (),
    *OF_THE_DRIVE,
    ("anchored_stroke", "repeat_impacts"),
    ("hertz_exponent",),
    ("sliding_support",),
    ("preload",),
)
CLOSED, STEPPED = 1e-8, 1e-6
ATOM = 1e-10  # m


def drives(rng: np.random.Generator, samples: int = 40) -> dict[str, Drive]:
    """One of every kind, with random settings; `samples` are those of the recorded one."""
    at = np.sort(np.r_[0.0, rng.uniform(0, 1, 6), 1.0])
    level = rng.uniform(-1, 1, 8)
    level[-1] = level[0]
    time = 1e-4 + np.linspace(0, 2e-3, samples)
    recorded = 1 + 10 * np.sin(2e3 * time) ** 2 + 0.1 * rng.standard_normal(samples)
    turn = float(rng.uniform(-90, 90))
    return {
        **{name: Drive(name) for name in WAVEFORMS},
        "bias and idle": Drive("sine", bias_v=8.0, idle_v=3.0, phase_deg=turn, cycles=2.0),
        "idle": Drive("unipolar_sine", idle_v=float(rng.uniform(-5, 5)), phase_deg=turn),
        "burst": Drive("triangle", bias_v=5.0, idle_v=5.0, phase_deg=30.0, cycles=1.5),
        "pulses": Drive("unipolar_square", idle_v=-2.0, phase_deg=200.0),
        "table": Drive("table", table=Table(at, level, False), phase_deg=turn),
        "recorded": Drive("table", idle_v=1.0, table=Table(time, recorded, True)),
    }


def apart(found: Simulation, true: LiteralLaunch) -> float:
    """Largest relative error of launch range, separation time and separation speed.

    The range is in proportion to the speed. The time is off by an error of the tip's place over the speed at which both
    part, which is of the order of the launch speed. So one tolerance does for all. A ball that swings by less than an
    atom has no separation to compare.
    """
    values = [(found.launch_range[0, 0], true.launch_range, ATOM)]
    if true.outcome == "launched" and true.velocity * math.sqrt(RIG.l / RIG.g) > ATOM:
        values.append((found.separation_time[0, 0], true.separation_time, 0.0))
        values.append((found.separation_speed[0, 0], true.velocity, 0.0))
    return float(np.max([abs(x - y) / max(abs(y), least) for x, y, least in values]))


def disagreement(one: Draw) -> float:
    """Of engine and reference, in units of what the engine is allowed."""
    found, true = one.simulated(), one.literal()
    # Where the place of a ball counts that is not launched, steps have followed it.
    allowed = CLOSED if found.engine == "closed form" and found.launched[0, 0] else STEPPED
    if apart(found, true) <= allowed or one.beyond_a_jump(found.launch_range[0, 0], true.launch_range):
        return 0.0
    # Steps of the usual tolerance err by more in ill-conditioned draws.
    return apart(one.simulated(1e-8), true) / allowed


@pytest.mark.slow
@pytest.mark.parametrize("kind", drives(np.random.default_rng(0)))
@pytest.mark.parametrize("causes", CAUSES, ids=lambda c: "+".join(c) or "baseline")
def test_engines_agree_with_the_reference(kind: str, causes: tuple[str, ...]) -> None:
    rng = np.random.default_rng([7, len(kind), len(causes)])
    for _ in range(1 if causes else 3):
        one = draw(rng, terms(causes))
        drive = drives(rng, 40 if causes else 1000)[kind]  # of a thousand with causes the reference takes half a minute
        point = Point(drive, one.point.frequency, one.point.amplitude)
        one = Draw(point, one.theta, one.causes, one.values, one.constants)
        assert disagreement(one) <= 1, one


@pytest.mark.parametrize("kind", drives(np.random.default_rng(0)))
def test_both_engines_and_the_reference_agree(kind: str) -> None:
    drive = drives(np.random.default_rng(1))[kind]
    design = Design.sweep(RIG, drive, [700.0, 2500.0], 12.0)
    closed = simulate(design, TRUTH)
    stepped = simulate(design, TRUTH, path="stepper")
    assert closed.engine == "closed form"
    assert np.allclose(stepped.launch_range, closed.launch_range, rtol=STEPPED, atol=1e-16)
    reference = Draw(Point(drive, 700.0, 12.0), TRUTH.tolist()).reference()
    assert closed.launch_range[0, 0] == pytest.approx(reference, rel=CLOSED, abs=1e-18)


def test_an_overdamped_contact_on_a_ramp_ends_where_that_turns() -> None:
    """By matrix exponentials of sixty digits: the indentation is positive until then, however small."""
    f, volt, theta = 54.74, 14.42, [2.4e6, 1378.0, 623.0]
    k_c, c_s, c_c = theta
    with mp.workdps(60):
        motion = mp.matrix(6, 6)  # of tip, its speed, ball, its speed, voltage, one
        motion[0, 1] = motion[2, 3] = 1
        for row, mass, sign in ((1, RIG.m, -1), (3, RIG.M, 1)):
            for column, value in enumerate((k_c, c_c, -k_c, -c_c)):
                motion[row, column] = sign * mp.mpf(value) / mp.mpf(mass)
        for column, value in ((0, -RIG.k_s), (1, -c_s), (4, RIG.k_s * RIG.q)):
            motion[1, column] += mp.mpf(value) / mp.mpf(RIG.m)
        motion[4, 5] = 2 * mp.mpf(f) * mp.mpf(volt)
        rest = mp.matrix([0, 0, 0, 0, 0, 1])
        for part in (0.1, 0.5, 0.9, 0.999):
            state = mp.expm(motion * (part / (2 * mp.mpf(f)))) * rest
            assert 0 < state[0] - state[2] < 1e-9
    found = simulate(Design.sweep(RIG, "unipolar_triangle", f, volt), theta)
    assert found.separation_time[0, 0] == pytest.approx(0.5 / f, rel=1e-7)


def drawn_back(rng: np.random.Generator) -> dict[str, Drive]:
    """Drives under which the tip first leaves the ball."""
    time = np.linspace(0, 2e-3, 200)
    sine = 10 * np.sin(5e3 * time)
    dip = sine + np.where((time > 0) & (time < 5e-5), -0.5, 0.0)
    return {
        "sine": Drive("sine", phase_deg=float(rng.uniform(180, 270))),
        "square": Drive("square", phase_deg=180.0),
        "triangle": Drive("triangle", phase_deg=180.0),
        "pulse": Drive("unipolar_square", idle_v=3.0, phase_deg=200.0),
        "recorded": Drive("table", table=Table(time, -sine, True)),
        "recorded, a dip": Drive("table", table=Table(time, dip + 0.01 * rng.standard_normal(200), True), idle_v=0.1),
    }


@pytest.mark.parametrize("causes", [(), ("amplifier_lag",)], ids=["baseline", "lag"])
@pytest.mark.parametrize("kind", drawn_back(np.random.default_rng(0)))
def test_a_tip_that_first_draws_back_takes_no_steps(kind: str, causes: tuple[str, ...]) -> None:
    rng = np.random.default_rng([5, len(kind), len(causes)])
    drive = drawn_back(rng)[kind]
    for _ in range(1 if causes else 3):
        one = draw(rng, terms(causes))
        point = Point(drive, float(np.exp(rng.uniform(4, 9))), 12.0)
        one = Draw(point, one.theta, one.causes, one.values, one.constants)
        fast, engine = one.fast()
        assert engine == "closed form"
        assert fast == pytest.approx(one.reference(), rel=CLOSED), one


@pytest.mark.parametrize("lag", [0.0, 2e-5])
def test_the_closed_form_itself_follows_a_tip_that_draws_back(lag: float) -> None:
    rig = Setup.of(RIG, np.array([TRUTH])).change(lag=np.array([lag]))
    for drive in drawn_back(np.random.default_rng(2)).values():
        design = Design.sweep(RIG, drive, 1500.0, 12.0)
        assert closed_form.separation(design, rig)[3] == closed_form.LAUNCHED
        assert closed_form.separation(design, rig, parted=False)[3] == closed_form.DRAWN_BACK


@pytest.mark.parametrize("off", [0.0, 1e-12, -1e-6, 1e-4])
def test_a_critically_damped_tip_comes_back(off: float) -> None:
    """Its two modes merge."""
    c_s = 2 * math.sqrt(RIG.k_s * RIG.m) * (1 + off)
    for drive in drawn_back(np.random.default_rng(2)).values():
        one = Draw(Point(drive, 1500.0, 12.0), [1e6, c_s, 50.0], constants=RIG)
        assert one.fast()[0] == pytest.approx(one.reference(), rel=CLOSED), drive


def test_what_is_seen_of_a_tip_that_draws_back_is_what_steps_see() -> None:
    for drive in drawn_back(np.random.default_rng(2)).values():
        design = Design.sweep(RIG, drive, 1500.0, 12.0)
        when = simulate(design, TRUTH).separation_time[0, 0]
        design = replace(design, moments=np.linspace(0, when, 20)[None, :-1])
        closed, stepped = (simulate(design, TRUTH, path=p, forces=True) for p in ("closed form", "stepper"))
        assert closed.motion is not None and stepped.motion is not None
        scale = np.abs(stepped.motion).max(axis=2, keepdims=True)
        assert np.allclose(closed.motion / scale, stepped.motion / scale, rtol=0, atol=STEPPED), drive
        assert np.allclose(closed.peak_force, stepped.peak_force, rtol=STEPPED)


def test_a_slow_tip_that_rounding_would_displace_takes_steps() -> None:
    """A ramp's answer in its slow mode is ten million times its way."""
    rng = np.random.default_rng(8)
    time = np.linspace(0, 1e-4, 64)
    volt = np.r_[0.0, -10 * np.sin(2e5 * time[1:]) - 10 * rng.uniform(0, 1, 63)]
    volt[40:] += 20.0
    for c_s in (2e5, 9e5):
        one = Draw(Point(Drive("table", table=Table(time, volt, True)), 4e4, 10.0), [5e7, c_s, 0.3], constants=RIG)
        assert one.fast()[0] == pytest.approx(one.reference(), rel=STEPPED)


def test_a_ball_from_which_the_tip_has_gone_for_good_is_not_launched() -> None:
    away = Drive("table", table=Table(np.array([0.0, 1e-4, 2e-3]), np.array([0.0, -5.0, -4.0]), True))
    assert not simulate(Design.sweep(RIG, away, 900.0, 5.0), TRUTH).launched.any()
    late = Drive("table", table=Table(np.array([0.0, 1e-4, 2e-3]), np.array([0.0, -5.0, 6.0]), True))
    one = Draw(Point(late, 900.0, 5.0), TRUTH.tolist(), constants=RIG)
    assert one.fast()[0] == pytest.approx(one.reference(), rel=CLOSED) and one.fast()[0] > 0.0


def test_a_bias_under_which_everything_rests_does_nothing() -> None:
    """The baseline is linear: only the way from the idle voltage counts."""
    frequency = np.geomspace(200, 5000, 5)
    plain = simulate(Design.sweep(RIG, "sine", frequency, 12.0), TRUTH).launch_range
    lifted = Drive("sine", bias_v=10.0, idle_v=10.0)
    assert np.allclose(simulate(Design.sweep(RIG, lifted, frequency, 12.0), TRUTH).launch_range, plain, rtol=1e-9)


def test_pulses_launch_like_half_a_square() -> None:
    """Until the first switch a pulse of V from 0 and a square of V are the same; so is a square of V/2 on V/2."""
    slow = 20.0  # Hz: the ball leaves before the switch
    found = [
        simulate(Design.sweep(RIG, drive, slow, volt), TRUTH).launch_range[0, 0]
        for drive, volt in (("square", 12.0), ("unipolar_square", 12.0), (Drive("square", bias_v=6.0), 6.0))
    ]
    assert found == pytest.approx([found[0]] * 3, rel=1e-12)


def test_a_table_of_a_waveform_is_that_waveform() -> None:
    at, level = np.array([0.0, 0.25, 0.75, 1.0]), np.array([0.0, 1.0, -1.0, 0.0])
    frequency = np.geomspace(200, 5000, 5)
    table = Design.sweep(RIG, Drive("table", table=Table(at, level, False)), frequency, 12.0)
    plain = simulate(Design.sweep(RIG, "triangle", frequency, 12.0), TRUTH).launch_range
    assert np.allclose(simulate(table, TRUTH).launch_range, plain, rtol=1e-12)


def test_a_recording_of_a_sine_tends_to_the_sine() -> None:
    """Linear between 2,000 samples a period: off by (2 pi/2000)^2/12 of the voltage."""
    time = np.arange(4001) / 2000 / 800.0
    record = Drive("table", table=Table(time, 12 * np.sin(2 * math.pi * 800 * time), True))
    plain = simulate(Design.sweep(RIG, "sine", 800.0, 12.0), TRUTH).launch_range
    # Amplitude and frequency of a recording are only what it is called.
    found = simulate(Design.sweep(RIG, record, 1000.0, 1.0), TRUTH).launch_range
    assert found[0, 0] == pytest.approx(plain[0, 0], rel=1e-4)


def test_a_recording_may_have_more_samples_than_a_trajectory_may_have_steps() -> None:
    """As many as a file may: its pieces are no sign of a contact that never ends."""
    for tipped in (False, True):
        found = []
        for n in (1_000, 100_000):
            time = np.linspace(0.0, 2e-3, n)
            drive = Drive("table", table=Table(time, 10 * (1 - np.cos(2 * math.pi * 500 * time)), True))
            design = replace(Design.sweep(RIG, drive, 500.0, 20.0), moments=np.array([[1e-3, 1.9e-3]]), tipped=tipped)
            found.append(simulate(design, [*TRUTH, 1.5], terms(["hertz_exponent"])))
        few, many = found
        assert few.launched.all() and many.launch_range == pytest.approx(few.launch_range, rel=1e-4)
        assert few.motion is not None and many.motion is not None
        if tipped:
            assert many.motion[..., 2] == pytest.approx(few.motion[..., 2], rel=1e-3, abs=1e-10)


def pieces(drive: Drive, f: float, volt: float, lag: float = 0.0, inverse_slew: float = 0.0) -> Iterator[FloatArray]:
    """The pieces of a drive, one after the other in the same record."""
    point, piece = np.empty(COMMAND), np.empty(PIECE)
    rows, points = Design.sweep(RIG, drive, f, volt).commands
    driven(points[0], 1.0, 0.0, point)
    first_piece(piece, rows, point, 0.0, lag, inverse_slew, True)
    yield piece
    while piece[END] < math.inf:
        next_piece(piece, voltage(piece, piece[END]), rows, point, 0.0, lag, inverse_slew, True)
        yield piece


def test_a_voltage_that_only_touches_zero_keeps_its_sign() -> None:
    """Rounding puts the touch on either side of zero; a piece ends where the voltage turns, at once and once."""
    rng = np.random.default_rng(3)
    for k in range(200):
        f, volt = float(np.exp(rng.uniform(4, 10))), float(rng.uniform(1, 100))
        drive = Drive("sine", bias_v=volt, idle_v=0.0, phase_deg=-90.0) if k % 2 else Drive("unipolar_sine")
        found = pieces(drive, f, volt)
        for half in range(1, 8):
            piece = next(found)
            assert piece[SIGN] == 1.0 and piece[END] * f == pytest.approx(half / 2, rel=1e-12)


@pytest.mark.parametrize("limited", [False, True])
def test_within_a_piece_the_voltage_goes_one_way_on_one_side_of_zero(limited: bool) -> None:
    """With lags and slew limits of any size, on drives that start flat, touch zero, jump or have corners."""
    rng = np.random.default_rng(4)
    for k in range(600):
        f, volt = float(np.exp(rng.uniform(4, 10))), float(rng.uniform(1, 100))
        touching = Drive("sine", bias_v=volt, phase_deg=-90.0)
        one = [*map(Drive, ("unipolar_sine", "sine", "unipolar_square", "triangle", "square")), touching][k % 6]
        lag = float(np.exp(rng.uniform(-25, 0))) / f
        slew = float(np.exp(rng.uniform(-5, 5))) / (math.pi * f * volt) if limited else 0.0
        for piece in itertools.islice(pieces(one, f, volt, lag, slew), 12):
            begin, end = piece[BEGIN], min(piece[END], piece[BEGIN] + 1 / f)
            u = np.array([voltage(piece, t) for t in np.linspace(begin, end, 65)])
            steps, rounded = np.diff(u), volt * (1e-11 + 1e-15 * end / lag)  # the latter by times
            assert max(piece[SIGN] * u.min(), piece[SIGN] * u.max()) >= 0.0
            assert (piece[SIGN] * u >= -rounded).all(), (one, f, volt, lag, slew)
            assert min(steps.max(), -steps.min()) <= rounded, (one, f, volt, lag, slew)


@pytest.mark.parametrize("limited", [False, True])
def test_a_long_contact_is_followed_piece_by_piece_to_its_end(limited: bool) -> None:
    """After hundreds of periods a rounding of the time is worth more than one of the phase: no piece ends at once."""
    rng = np.random.default_rng(5)
    for k in range(60):
        f, volt = float(np.exp(rng.uniform(4, 10))), float(rng.uniform(1, 100))
        one = [*map(Drive, ("unipolar_sine", "sine", "triangle", "square")), Drive("sine", bias_v=volt)][k % 5]
        lag = float(np.exp(rng.uniform(-12, 0))) / f if k % 3 else 0.0
        slew = float(np.exp(rng.uniform(-5, 8))) / (math.pi * f * volt) if limited else 0.0
        for n, piece in enumerate(pieces(one, f, volt, lag, slew)):
            if piece[END] * f >= 1000.0:
                break
            assert piece[END] > piece[BEGIN] and n < 12_000, (one, f, volt, lag, slew)


def test_a_ball_that_leans_for_hundreds_of_periods_ends_a_trajectory() -> None:
    """It is not launched; once the stepper took pieces without length there for ever."""
    theta = [11184.0427, 17637.2851, 1724.74285, 0.00589805660, 155.525552, 0.00159187865]
    found = simulate(Design.sweep(RIG, Drive("sine"), 2e4, 20.0), theta, terms(["anchored_stroke", "preload"]))
    assert not found.launched.any()


@pytest.mark.parametrize(
    "drive", [Drive("table", idle_v=2.0, table=Table(np.linspace(0, 1, 12), np.full(12, 2.0), True)), Drive("sine")]
)
def test_a_drive_that_does_not_move_launches_nothing(drive: Drive) -> None:
    design = Design.sweep(RIG, drive, 800.0, 0.0)
    for path in ("closed form", "stepper"):
        assert simulate(design, TRUTH, path=path).launch_range[0, 0] == 0.0
    assert Draw(Point(drive, 800.0, 0.0), TRUTH.tolist()).reference() == 0.0


def test_hysteresis_starts_from_where_the_idle_voltage_has_left_it() -> None:
    """After a rise to 10 V, one from there is the rest of that rise: the stack yields more of it."""
    hysteresis = terms(["hysteresis"])
    theta = [*TRUTH, 0.4, 5.0]
    ranges = [
        simulate(Design.sweep(RIG, Drive("unipolar_square", bias_v=v, idle_v=v), 50.0, 5.0), theta, hysteresis)
        for v in (0.0, 10.0)
    ]
    assert ranges[1].launch_range[0, 0] > 1.1 * ranges[0].launch_range[0, 0]


@pytest.mark.parametrize("id", [id for (id,) in OF_THE_DRIVE])
def test_a_cause_acts_on_the_drives_on_which_it_has_a_meaning(id: str) -> None:
    cause = term(id)
    strong = plausible(cause, 0.8)
    for kind, drive in drives(np.random.default_rng(1)).items():
        design = Design.sweep(RIG, drive, [900.0, 4000.0], 12.0)
        found, plain = (
            simulate(design, [*TRUTH, *more], chosen, tolerance=1e-9).launch_range
            for more, chosen in ((strong, [cause]), ([], []))
        )
        assert (np.abs(found - plain) > 1e-7 * plain).any() == cause.acts_on(drive), kind


def test_the_amplitude_s_factor_is_another_amplitude() -> None:
    """It leaves bias and idle level alone; of a stack that saturates it is no factor of the stroke."""
    biased, causes = Drive("sine", bias_v=6.0, idle_v=2.0), terms(["amplitude_scale", "drive_saturation"])
    frequency = np.array([300.0, 1500.0])
    half = simulate(Design.sweep(RIG, biased, frequency, 16.0), [*TRUTH, 0.5, 0.03], causes).launch_range
    plain = simulate(Design.sweep(RIG, biased, frequency, 8.0), [*TRUTH, 0.03], causes[1:]).launch_range
    assert half == pytest.approx(plain, rel=1e-9)
    stroke = simulate(Design.sweep(RIG, "sine", frequency, 16.0), [*TRUTH, 0.5], terms(["stroke_tolerance"]))
    scale = simulate(Design.sweep(RIG, "sine", frequency, 16.0), [*TRUTH, 0.5], causes[:1])
    assert scale.launch_range == pytest.approx(stroke.launch_range, rel=1e-12)


def test_an_idle_level_is_an_idle_voltage() -> None:
    """A square wave that rests at minus its amplitude kicks with twice the voltage."""
    idle = terms(["idle_level"])
    for drive in (Drive("square"), Drive("sine", bias_v=4.0, idle_v=1.0), Drive("triangle", cycles=1.5)):
        design = Design.sweep(RIG, drive, [200.0, 1500.0], 9.0)
        stated = Design.sweep(RIG, replace(drive, idle_v=drive.idle_v - 5.0), [200.0, 1500.0], 9.0)
        found = simulate(design, [*TRUTH, -5.0], idle).launch_range
        assert found == pytest.approx(simulate(stated, TRUTH).launch_range, rel=1e-12)
    slow = [simulate(Design.sweep(RIG, "square", 5.0, v), [*TRUTH, u], idle).launch_range[0, 0]
            for v, u in ((9.0, -9.0), (18.0, 0.0))]  # fmt: skip
    assert slow[0] == pytest.approx(slow[1], rel=1e-9)


def test_a_jump_far_smaller_than_the_swing_that_follows_is_over_at_once() -> None:
    """The ball separates within the rounding of its own motion, or is left behind and struck as without the jump."""
    jumps = np.exp(np.random.default_rng(6).uniform(-24, -8, 10))  # V
    theta = np.column_stack([np.tile(TRUTH, (10, 1)), -jumps])
    swing = Design.sweep(RIG, Drive("sine", phase_deg=180.0), [400.0], 20.0)
    found, plain = simulate(swing, theta, terms(["idle_level"])), simulate(swing, TRUTH)
    struck = np.isclose(found.launch_range, plain.launch_range, rtol=1e-4)
    assert (struck | ((found.separation_time < 1e-6) & (found.launch_range < 1e-18))).all()

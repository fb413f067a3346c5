"""The scalar reference of the extended model against the baseline's reference and against closed forms."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.experiment import Constants
from psafit.physics.term import ReferenceRig
from psafit.simulate.literal import jump, launch_in, literal_launch, reference_rig, swing
from psafit.simulate.reference import ContactParameters, Point, mp_launch, pendulum_range, tight_launch

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
THETA = (4e5, 9e3, 60.0)


def given(theta: tuple[float, float, float] = THETA, rig: Constants = RIG) -> ReferenceRig:
    return reference_rig(theta, [], rig)


def draw(rng: np.random.Generator) -> tuple[Point, ContactParameters]:
    theta = ContactParameters(10 ** rng.uniform(4, 8), 10 ** rng.uniform(1, 5.5), 10 ** rng.uniform(-1, 4))
    waveform = "sine" if rng.random() < 0.5 else "square"
    return Point(waveform, 10 ** rng.uniform(1, 4.3), rng.uniform(0.1, 20)), theta  # type: ignore[arg-type]


def agree_with_the_baseline(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(n):
        point, theta = draw(rng)
        baseline, found = tight_launch(point, theta, RIG), literal_launch(point, theta, [], RIG)
        assert (found.outcome == "launched") == (baseline.outcome == "launched"), (point, theta)
        if found.outcome == "launched":
            assert found.launch_range == pytest.approx(baseline.launch_range, rel=1e-12), (point, theta)
            assert found.separation_time == pytest.approx(baseline.separation_time, rel=1e-10), (point, theta)


# --- the baseline ---------------------------------------------------------------------------------


def test_without_causes_it_is_the_baseline() -> None:
    agree_with_the_baseline(25, 11)


@pytest.mark.slow
def test_without_causes_it_is_the_baseline_over_many_draws() -> None:
    agree_with_the_baseline(75, 12)


def test_a_strong_damper_costs_no_digits() -> None:
    point, theta = Point("square", 2945.2303, 9.413), ContactParameters(1.17e4, 1.66e3, 7.21e3)
    exact = mp_launch(point, theta, RIG, digits=30)
    assert literal_launch(point, theta, [], RIG).launch_range == pytest.approx(exact.launch_range, rel=1e-13)


def test_an_integration_that_does_not_end_is_reported() -> None:
    with pytest.raises(ConvergenceError, match="time within a piece of the literal reference"):
        literal_launch(Point("sine", 1000.0, 20.0), [4e5, 9e3, 60.0], [], RIG, most_steps=3)


def test_no_voltage_reads_as_a_range_of_zero() -> None:
    w = given()
    w.reading = lambda L, group: L + 1e-6 * group
    found = launch_in(w, Point("sine", 1000.0, 0.0), group=3)
    assert (found.outcome, found.launch_range) == ("no launch", 3e-6)
    assert math.isnan(found.separation_time)


@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_tighter_tolerance_changes_nothing(waveform: str) -> None:
    w = given((3e5, 2e3, 30.0))
    w.lag, w.slew, w.gap, w.lean, w.bond, w.pull, w.cycles = 1e-5, 4e5, 2e-7, 0.0, 0.01, 0.4, 2.0
    w.elastic = lambda d, rate: w.k_c * d * abs(d / 1e-6) ** 0.37 * (1 + 3 * rate)
    w.memories = [lambda z, u, du: 0.3 * w.q * du - abs(du) * z / 7.0]
    w.stroke = lambda u: w.q * u * (1 + 0.02 * abs(u))
    point = Point(waveform, 1700.0, 18.0)  # type: ignore[arg-type]
    coarse, fine = (launch_in(w, point, rtol=rtol) for rtol in (1e-9, 1e-14))
    usual = launch_in(w, point)
    assert usual.outcome == "launched"
    assert usual.launch_range == pytest.approx(fine.launch_range, rel=1e-10)
    assert coarse.launch_range == pytest.approx(fine.launch_range, rel=1e-6)


# --- the drive ------------------------------------------------------------------------------------


def tip_meets_ball(w: ReferenceRig, point: Point) -> tuple[float, float]:
    """Time and tip's speed at the first contact over a gap: the launch of a ball so soft that it stays where it is.

    With a contact a millionth as stiff as the stack and no damping, the tip does not feel the ball.
    """
    found = launch_in(w, point)
    assert found.outcome == "launched"
    return found.separation_time, found.velocity


def impulse(w: ReferenceRig, tip: Callable[[float], float], start: float, end: float) -> float:
    """Speed of a ball that a tip, moving on its own, indents by ``x1 - gap`` with the stiffness k_c."""
    total, _ = quad(lambda t: tip(t) - w.gap, start, end, epsabs=0.0, epsrel=1e-13, limit=200)
    return w.k_c * total / w.M


SOFT = (1e-9, 9e3, 0.0)  # the stack does not notice this contact


def lagging_tip(w: ReferenceRig, frequency: float, volt: float, lag: float) -> Callable[[float], float]:
    """Tip without a ball: ``x1'' = -c_s/m x1' - k_s/m x1 + k_s q u/m`` under the response of a lag to a sine."""
    omega = 2 * math.pi * frequency
    steady = volt / (1 + 1j * omega * lag)  # u = Im(steady exp(i w t)) + free exp(-t/lag)
    free = -steady.imag
    drive = w.k_s * w.q / w.m
    roots = np.roots([1.0, w.c_s / w.m, w.k_s / w.m]).astype(complex)
    swing_ = steady * drive / (-(omega**2) + 1j * omega * w.c_s / w.m + w.k_s / w.m)
    fade = free * drive / (1 / lag**2 - w.c_s / w.m / lag + w.k_s / w.m) if lag else 0.0
    rate = 1 / lag if lag else 0.0
    start = np.array([-swing_.imag - fade, -(1j * omega * swing_).imag + rate * fade])
    amplitude = np.linalg.solve(np.array([[1, 1], roots]), start.astype(complex))
    return lambda t: float(
        (swing_ * np.exp(1j * omega * t)).imag + fade * math.exp(-rate * t) + (amplitude @ np.exp(roots * t)).real
    )


@pytest.mark.parametrize(("lag", "gap"), [(0.0, 0.0), (4e-5, 0.0), (0.0, 1.1e-6), (4e-5, 0.9e-6)])
def test_free_tip_under_a_lagging_sine(lag: float, gap: float) -> None:
    w = given(SOFT)
    w.lag, w.gap = lag, gap
    tip = lagging_tip(w, 700.0, 12.0, lag)
    grid = np.linspace(1e-7, 1.4e-3, 4000)
    above = np.array([tip(t) > gap for t in grid])
    begin = int(np.argmax(above))
    finish = begin + int(np.argmax(~above[begin:]))
    reach = lambda t: tip(t) - gap  # noqa: E731
    t0 = brentq(reach, grid[begin - 1], grid[begin], xtol=1e-18) if gap else 0.0
    t1 = brentq(reach, grid[finish - 1], grid[finish], xtol=1e-18)
    when, speed = tip_meets_ball(w, Point("sine", 700.0, 12.0))
    assert when == pytest.approx(t1, rel=1e-10)
    assert speed == pytest.approx(impulse(w, tip, t0, t1), rel=1e-9)


def test_slew_limited_sine_is_a_sawtooth_that_meets_its_command() -> None:
    # A stack without inertia to speak of (k_s/m = 1e15 1/s^2, critically damped) shows the voltage itself. V w = 4 S:
    # u rises as S t until it meets the falling sine, then falls at S: zero at twice that time.
    rig = Constants(M=0.027, m=1e-12, q=1.2e-7, l=0.09, k_s=1e3, g=9.81)
    w = given((1e-9, 2 * math.sqrt(1e3 * 1e-12), 0.0), rig)
    point = Point("sine", 100.0, 10.0)
    omega = 2 * math.pi * point.frequency
    w.slew = point.amplitude * omega / 4
    meet = brentq(lambda t: point.amplitude * math.sin(omega * t) - w.slew * t, 1e-3, 6e-3, xtol=1e-18)
    assert point.amplitude * omega * math.cos(omega * meet) < -w.slew
    found = launch_in(w, point)
    delay = w.c_s / w.k_s  # of a second-order low pass behind a ramp
    assert found.separation_time == pytest.approx(2 * meet + delay, rel=1e-9)
    # The triangle's area, less nothing: the low pass keeps it but for the tail after the end.
    assert found.velocity == pytest.approx(w.k_c * w.q * w.slew * meet**2 / w.M, rel=1e-7)


def test_slew_limit_and_lag_rise_on_a_ramp_then_exponentially() -> None:
    # Square command: u' = S until V - u = S lag, then u = V - S lag exp(-(t - t1)/lag).
    rig = Constants(M=0.027, m=1e-12, q=1.2e-7, l=0.09, k_s=1e3, g=9.81)
    w = given((1e-9, 2 * math.sqrt(1e3 * 1e-12), 0.0), rig)
    point = Point("square", 100.0, 10.0)
    w.slew, w.lag = 1e4, 4e-4
    knee = 10.0 / w.slew - w.lag
    half = 0.5 / point.frequency
    short = w.slew * w.lag
    last = short * math.exp(-(half - knee) / w.lag)
    area = 0.5 * w.slew * knee**2 + 10.0 * (half - knee) - (short - last) * w.lag
    # After the edge u falls at S from V - last until zero.
    top = 10.0 - last
    found = launch_in(w, point)
    delay = w.c_s / w.k_s
    assert found.separation_time == pytest.approx(half + top / w.slew + delay, rel=1e-9)
    assert found.velocity == pytest.approx(w.k_c * w.q * (area + top**2 / (2 * w.slew)) / w.M, rel=1e-6)


def test_a_phase_of_a_half_turn_starts_away_from_the_ball() -> None:
    w = given()
    w.phase = math.pi
    late = launch_in(w, Point("sine", 1000.0, 10.0))
    assert late.separation_time > 0.5e-3
    w.phase = 2 * math.pi
    assert launch_in(w, Point("sine", 1000.0, 10.0)) == launch_in(given(), Point("sine", 1000.0, 10.0))


# --- the stack ------------------------------------------------------------------------------------


def bouc_wen(w: ReferenceRig, strength: float, scale: float) -> None:
    w.memories = [lambda z, u, du: strength * w.q * du - abs(du) * z / scale]


def test_hysteresis_state_after_jumps() -> None:
    w = given()
    bouc_wen(w, 0.4, 6.0)
    up = jump(w.memories[0], w.q, 0.0, 0.0, 15.0)
    assert up == pytest.approx(0.4 * w.q * 6.0 * (1 - math.exp(-15.0 / 6.0)), rel=1e-12)
    # Downwards z tends to -s q U: z = -s q U + (z0 + s q U) exp(-|du|/U).
    limit = 0.4 * w.q * 6.0
    assert jump(w.memories[0], w.q, up, 15.0, -15.0) == pytest.approx(
        -limit + (up + limit) * math.exp(-30.0 / 6.0), rel=1e-12
    )


@pytest.mark.parametrize("lag", [0.0, 2e-5])
def test_hysteresis_follows_its_branches_under_a_sine(lag: float) -> None:
    # A quasi-static stack: the tip is at q u - z. It crosses zero on the way down before the voltage does, where
    # q u = z on the downward branch z = -L + (z_top + L) exp(-(V - u)/U), L = s q U.
    rig = Constants(M=0.027, m=1e-12, q=1.2e-7, l=0.09, k_s=1e3, g=9.81)
    w = given((1e-9, 2 * math.sqrt(1e3 * 1e-12), 0.0), rig)
    strength, scale, volt, frequency = 0.5, 5.0, 12.0, 50.0
    bouc_wen(w, strength, scale)
    w.lag = lag
    omega = 2 * math.pi * frequency
    gain, slip = 1 / math.hypot(1, omega * lag), math.atan(omega * lag)
    top = volt * gain  # the transient of the lag has died out after 250 time constants
    limit = strength * w.q * scale
    z_top = limit * (1 - math.exp(-top / scale))
    down = lambda u: w.q * u + limit - (z_top + limit) * math.exp(-(top - u) / scale)  # noqa: E731
    u = brentq(down, -top, top, xtol=1e-16)
    when = (math.pi - math.asin(u / top) + slip) / omega
    found = launch_in(w, Point("sine", frequency, volt))
    slow = w.c_s / w.k_s
    assert found.separation_time == pytest.approx(when + slow, abs=3e-8 * when)


def test_stroke_that_bends_at_zero_volts() -> None:
    w = given()
    w.stroke = lambda u: w.q * u * (1 + 0.03 * abs(u))
    # Square: the voltage's size is constant until the edge, where the ball may be gone: a rig with a longer stroke.
    point = Point("square", 2000.0, 10.0)
    longer = given(THETA, Constants(**{**vars(RIG), "q": RIG.q * 1.3}))
    assert launch_in(w, point).launch_range == pytest.approx(launch_in(longer, point).launch_range, rel=1e-13)


# --- the contact ----------------------------------------------------------------------------------


def linear_motion(theta: tuple[float, float, float], point: Point) -> Callable[[float], FloatArray]:
    """The baseline under a sine, as if the contact held for ever: x1, x1', x2, x2' by eigenvalues."""
    k_c, c_s, c_c = theta
    omega = 2 * math.pi * point.frequency
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1
    a[1] = np.array([-(RIG.k_s + k_c), -(c_s + c_c), k_c, c_c]) / RIG.m
    a[3] = np.array([k_c, c_c, -k_c, -c_c]) / RIG.M
    push = np.array([0, RIG.k_s * RIG.q * point.amplitude / RIG.m, 0, 0])
    forced = np.linalg.solve(1j * omega * np.eye(4) - a, push)
    rates, modes = np.linalg.eig(a)
    free = np.linalg.solve(modes, -forced.imag.astype(complex))
    return lambda t: (modes @ (free * np.exp(rates * t))).real + (forced * np.exp(1j * omega * t)).imag


def first_fall(motion: Callable[[float], FloatArray], level: float, end: float) -> float:
    """When the indentation first falls to a level."""
    grid = np.linspace(0.0, end, 5000)[1:]
    indentation = lambda t: motion(t)[0] - motion(t)[2] - level  # noqa: E731
    first = int(np.argmax([indentation(t) < 0 for t in grid]))
    return float(brentq(indentation, grid[first - 1], grid[first], xtol=1e-18))


@pytest.mark.parametrize(("lean", "theta"), [(1e-3, (1e6, 9e3, 50.0)), (1e-4, (2e5, 500.0, 5.0))])
def test_preload_superposes_its_statics_on_the_motion(lean: float, theta: tuple[float, float, float]) -> None:
    # All is linear until the separation: statics plus the baseline's motion, which ends where the indentation falls
    # to minus the static one.
    point = Point("sine", 700.0, 10.0)
    motion = linear_motion(theta, point)
    w = given(theta)
    w.lean = lean
    push = w.M * w.g * lean / w.l
    when = first_fall(motion, -push / w.k_c, 2e-3)
    found = launch_in(w, point)
    assert found.outcome == "launched"
    assert found.separation_time == pytest.approx(when, rel=1e-9)
    assert found.velocity == pytest.approx(motion(when)[3], rel=1e-8)
    assert found.place == pytest.approx(motion(when)[2], rel=1e-8)  # from rest


def test_too_slow_a_drive_never_throws_a_leaning_ball() -> None:
    w = given((1e6, 9e3, 300.0))
    w.lean = 1e-3
    frequency = math.sqrt(0.5 * w.g * w.lean / w.l / (w.q * 10.0)) / (2 * math.pi)
    assert launch_in(w, Point("sine", frequency, 10.0)).outcome == "no launch"


@pytest.mark.parametrize("bond", [1e-3, 0.02])
def test_bond_stretches_the_contact(bond: float) -> None:
    theta, point = (4e5, 9e3, 20.0), Point("sine", 900.0, 10.0)
    motion = linear_motion(theta, point)
    w = given(theta)
    w.bond = bond
    when = first_fall(motion, -bond / w.k_c, 1e-3)
    found = launch_in(w, point)
    assert found.separation_time == pytest.approx(when, rel=1e-9)
    assert found.velocity == pytest.approx(motion(when)[3], rel=1e-8)
    assert found.place == pytest.approx(motion(when)[2], rel=1e-8)


def test_preload_indents_a_hertzian_contact_statically() -> None:
    # Under a microscopic voltage the ball rests throughout: the force of the start is that of the equilibrium.
    w = given()
    w.lean = 2e-3
    w.elastic = lambda d, rate: w.k_c * d * abs(d / 1e-6) ** 0.5
    found = launch_in(w, Point("square", 5e3, 1e-9))
    assert found.outcome == "no launch"


def test_contact_that_cannot_pull_frees_the_ball_at_no_force() -> None:
    # With pull = 0 the last stage of the contact adds no impulse: the ball leaves with the speed it had at F = 0,
    # which is the largest of the whole contact.
    w = given((4e5, 9e3, 200.0))
    w.pull = 0.0
    point = Point("sine", 1500.0, 10.0)
    found, whole = launch_in(w, point), launch_in(given((4e5, 9e3, 200.0)), point)
    assert found.velocity > whole.velocity
    w.pull = 1.0 - 1e-12
    assert launch_in(w, point).launch_range == pytest.approx(whole.launch_range, rel=1e-10)


def test_power_law_contact_bounces_in_its_closed_form_time() -> None:
    # A massive tip (1e6 kg) with next to no spring meets the ball at the speed V that it has gained over the gap, and
    # keeps it: Hertz's F = K d^(3/2) throws the ball at twice that speed, after
    # 2.9432 (5 M/(4 K))^(2/5) / V^(1/5) of contact (Hertz 1882).
    rig = Constants(M=0.027, m=1e6, q=1.0, l=0.09, k_s=1e-9, g=9.81)
    w = given((1e6, 0.0, 0.0), rig)
    w.gap = 1.0
    w.elastic = lambda d, rate: w.k_c * d * abs(d / 1e-6) ** 0.5
    point = Point("square", 1e-6, 1e12)  # a force of 1 kN: 1e-3 m/s^2 for a metre
    speed = math.sqrt(2 * 1e-3 * 1.0)
    touch = speed / 1e-3
    hertz = 1e6 / math.sqrt(1e-6)
    ratio = 4 / 5 * math.sqrt(math.pi) * math.gamma(2 / 5) / math.gamma(9 / 10)
    lasts = ratio * (5 * w.M / (4 * hertz)) ** 0.4 / speed**0.2
    found = launch_in(w, point)
    assert found.velocity == pytest.approx(2 * speed, rel=2e-5)  # the tip gains 1e-3 m/s^2 meanwhile
    assert found.separation_time - touch == pytest.approx(lasts, rel=2e-5)
    assert found.place == pytest.approx(speed * lasts, rel=2e-5)


def test_repeated_impacts_count_within_their_cycles() -> None:
    theta = (7.43e4, 104.0, 368.0)
    point = Point("square", 1314.0, 13.1)
    speeds, times = [], []
    for cycles in (0.0, 0.9, 1.3, 3.8):
        w = given(theta)
        w.cycles = cycles
        found = launch_in(w, point)
        speeds.append(found.velocity)
        times.append(found.separation_time)
    assert speeds == sorted(speeds)
    assert len(set(speeds)) >= 3
    assert times == sorted(times)


# --- the swing ------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [1e-9, 1e-3, 0.3, 1.0, 2.0])
def test_swing_of_the_baseline(speed: float) -> None:
    assert swing(given(), speed, 1e-6) == pytest.approx(pendulum_range(speed, RIG), rel=1e-14)


@pytest.mark.parametrize("speed", [1e-7, 1e-4, 0.3])
def test_a_vanishing_deceleration_integrates_to_the_closed_form(speed: float) -> None:
    for lean, weight in ((0.0, 0.0), (1e-4, 0.0), (0.0, 0.7)):
        w = given()
        w.lean, w.offset_weight = lean, weight
        closed = swing(w, speed, 1e-8)
        w.deceleration = lambda x, v: 1e-300
        assert swing(w, speed, 1e-8) == pytest.approx(closed, rel=2e-12)


def test_swing_with_dry_friction() -> None:
    # Small swings: energy v^2/2 = g x^2/(2 l) + a x.
    w = given()
    a, v = 0.03, 1e-3
    w.deceleration = lambda x, v: a
    exact = w.l / w.g * (-a + math.sqrt(a * a + v * v * w.g / w.l))
    assert swing(w, v, 0.0) == pytest.approx(exact, rel=1e-8)  # the arc's curvature: (L/l)^2
    assert swing(w, 1e-2 * v, 0.0) == pytest.approx(v**2 * 1e-4 / (2 * a), rel=1e-3)


@pytest.mark.parametrize("rate", [0.5, 20.0, 50.0])
def test_swing_with_linear_drag(rate: float) -> None:
    # x'' + c x' + w0^2 x = 0 from x = 0: largest where x' = 0.
    w = given()
    v, omega2 = 1e-4, w.g / w.l
    w.deceleration = lambda x, v: rate * v
    disc = omega2 - rate * rate / 4
    if disc > 0:
        omega = math.sqrt(disc)
        t = math.atan2(omega, rate / 2) / omega
        exact = v * math.exp(-rate * t / 2) * math.sin(omega * t) / omega
    else:
        s = math.sqrt(-disc)
        t = math.atanh(s / (rate / 2)) / s
        exact = v * math.exp(-rate * t / 2) * math.sinh(s * t) / s
    assert swing(w, v, 0.0) == pytest.approx(exact, rel=1e-8)


def test_swing_from_behind_the_equilibrium() -> None:
    # L = sqrt((x_0 + x_2)^2 + v^2 l/g) - x_0 for small angles.
    w = given()
    w.lean, x2, v = 3e-5, 4e-7, 2e-4
    small = math.sqrt((w.lean + x2) ** 2 + v * v * w.l / w.g) - w.lean
    assert swing(w, v, x2) == pytest.approx(small, rel=1e-6)
    w.lean, w.offset_weight = 0.0, 0.5
    assert swing(w, 1e-5, x2) == pytest.approx(math.sqrt(1e-10 * w.l / w.g + 0.5 * x2 * x2), rel=1e-9)


def test_swing_over_the_horizontal() -> None:
    w = given()
    w.lean = 0.01
    assert swing(w, 3.0, 0.0) == pytest.approx(w.l - 0.01)
    w.deceleration = lambda x, v: 0.1 * v
    assert swing(w, 3.0, 0.0) == pytest.approx(w.l - 0.01)

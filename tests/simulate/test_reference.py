"""The references against hand calculation, against each other and against many digits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from psafit.errors import ConvergenceError
from psafit.experiment import Constants, read_experiment
from psafit.simulate import Design, simulate
from psafit.simulate.reference import ContactParameters, Point, mp_launch, pendulum_range, rk4_launch, tight_launch

PSA = Path(__file__).parents[2] / "experiments" / "psa"
PUBLISHED = ContactParameters(1.425e5, 13991.0, 68.0)
UNIT = Constants(M=1.0, m=1.0, q=1e-3, l=1.0, k_s=1.0, g=9.81)


@pytest.fixture(scope="module")
def rig() -> Constants:
    return read_experiment(PSA).constants


def fast(point: Point, parameters: ContactParameters, constants: Constants) -> tuple[float, float]:
    found = simulate(Design.sweep(constants, *point), np.array(parameters))
    return float(found.separation_time[0, 0]), float(found.separation_speed[0, 0])


# --- by hand ------------------------------------------------------------------------------------


def test_two_undamped_unit_oscillators_match_their_golden_ratio_modes() -> None:
    # m = M = k_s = k_c = 1: the stiffness matrix [[2, -1], [-1, 1]] has the eigenvalues
    # (3 -+ sqrt 5)/2 with the vectors (1, phi) and (1, -1/phi). A constant force p on the stack
    # gives x = sum_i v_i v_i1 p (1 - cos w_i t)/(|v_i|^2 w_i^2).
    phi = (1 + math.sqrt(5)) / 2
    modes = [((3 - math.sqrt(5)) / 2, phi), ((3 + math.sqrt(5)) / 2, -1 / phi)]
    p = 1.0 * 1e-3 * 20.0

    def indentation(t: float) -> float:
        return sum((1 - y) * p / ((1 + y * y) * w2) * (1 - math.cos(math.sqrt(w2) * t)) for w2, y in modes)

    def ball_speed(t: float) -> float:
        return sum(y * p / ((1 + y * y) * math.sqrt(w2)) * math.sin(math.sqrt(w2) * t) for w2, y in modes)

    grid = np.linspace(0.05, 20.0, 4000)
    first = int(np.argmax([indentation(t) < 0 for t in grid]))
    when = brentq(indentation, grid[first - 1], grid[first], xtol=1e-15)
    point, parameters = Point("square", 1e-3, 20.0), ContactParameters(1.0, 0.0, 0.0)
    launches = (tight_launch(point, parameters, UNIT, 100.0), mp_launch(point, parameters, UNIT, 100.0))
    for launch in launches:
        assert launch.separation_time == pytest.approx(when, rel=1e-11)
        assert launch.velocity == pytest.approx(ball_speed(when), rel=1e-11)


def test_pendulum_of_one_micrometre_and_of_more_than_the_string() -> None:
    c = Constants(M=1, m=1, q=1, l=0.09, k_s=1, g=9.81)
    # Small swings: L = v sqrt(l/g) to a relative h/l.
    assert pendulum_range(1e-5, c) == pytest.approx(1e-5 * math.sqrt(0.09 / 9.81), rel=1e-10)
    # v^2 = g l lifts the ball by l/2: cos = 1/2, L = l sqrt(3)/2.
    assert pendulum_range(math.sqrt(9.81 * 0.09), c) == pytest.approx(0.09 * math.sqrt(0.75))
    assert pendulum_range(math.sqrt(2 * 9.81 * 0.09), c) == 0.09
    assert pendulum_range(5.0, c) == 0.09
    assert pendulum_range(0.0, c) == 0.0
    # Against Eq. (17) as printed, where it still has digits.
    h = 0.3**2 / (2 * 9.81)
    literal = 0.09 * math.sin(math.acos((0.09 - h) / 0.09))
    assert pendulum_range(0.3, c) == pytest.approx(literal, rel=1e-13)


@pytest.mark.slow
def test_momentum_of_the_ball_is_the_impulse_of_the_contact_force(rig: Constants) -> None:
    path = rk4_launch(Point("sine", 1200.0, 20.0), PUBLISHED, rig, 1e-7, path=True).path
    assert path is not None
    x1, v1, x2, v2 = path.state.T
    force = PUBLISHED.k_c * (x1 - x2) + PUBLISHED.c_c * (v1 - v2)
    assert np.trapezoid(force, path.time) == pytest.approx(rig.M * v2[-1], rel=1e-5)


# --- the study's scheme -------------------------------------------------------------------------


def test_rk4_states_converge_at_fourth_order(rig: Constants) -> None:
    parameters, point, end = ContactParameters(1.425e5, 500.0, 20.0), Point("sine", 1200.0, 20.0), 1.6e-4
    k_c, c_s, c_c = parameters
    omega = 2 * math.pi * 1200.0
    a = np.zeros((6, 6))  # Eq. (14), and the drive as (sin, cos)
    a[0, 1] = a[2, 3] = 1
    a[1, :4] = np.array([-(rig.k_s + k_c), -(c_s + c_c), k_c, c_c]) / rig.m
    a[1, 4] = rig.k_s * rig.q / rig.m
    a[3, :4] = np.array([k_c, c_c, -k_c, -c_c]) / rig.M
    a[4, 5], a[5, 4] = omega, -omega
    exact = (expm(a * end) @ [0, 0, 0, 0, 0, 20.0])[:4]
    errors = []
    for step in (4e-6, 2e-6, 1e-6):
        path = rk4_launch(point, parameters, rig, step, end, path=True).path
        assert path is not None
        assert path.time[-1] == pytest.approx(end)
        errors.append(abs(path.state[-1, 0] - exact[0]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([4.0, 4.0], abs=0.25)


def test_rk4_launch_approaches_the_tight_one_at_first_order(rig: Constants) -> None:
    # The separation is noticed at the end of a step, when the damper has slowed the ball.
    point = Point("sine", 1200.0, 20.0)
    exact = tight_launch(point, PUBLISHED, rig).launch_range
    for step in (8e-7, 2e-7, 5e-8, 1e-8):
        error = rk4_launch(point, PUBLISHED, rig, step).launch_range / exact - 1
        assert -0.012 * step / 1e-6 <= error <= 1e-9


def test_outcomes_that_are_no_launch(rig: Constants) -> None:
    rest = rk4_launch(Point("sine", 1200.0, 0.0), PUBLISHED, rig)
    assert (rest.outcome, rest.launch_range) == ("no separation", 0.0)
    overflow = rk4_launch(Point("square", 100.0, 20.0), PUBLISHED, rig)
    assert overflow.outcome == "diverged"
    assert math.isnan(overflow.launch_range)
    early = tight_launch(Point("sine", 1200.0, 20.0), PUBLISHED, rig, total=1e-4)
    assert (early.outcome, early.launch_range) == ("no separation", 0.0)
    assert tight_launch(Point("sine", 1200.0, 0.0), PUBLISHED, rig).outcome == "no separation"


def test_giving_up_says_how_far_it_came(rig: Constants) -> None:
    with pytest.raises(ConvergenceError) as caught:
        tight_launch(Point("sine", 1200.0, 20.0), PUBLISHED, rig, most_steps=5)
    assert 0 < caught.value.reached < caught.value.required


def test_cached_machine_code_of_the_march_runs_again(rig: Constants) -> None:
    # Every reading in one process: a recursive compiled helper once crashed when loaded from cache.
    for interpolate in (False, True):
        for point in (Point("sine", 1200.0, 16.0), Point("square", 1200.0, 16.0)):
            rk4_launch(point, PUBLISHED, rig, square="sign of sine", interpolate=interpolate)


# --- many digits --------------------------------------------------------------------------------


HARD = {
    "published": (Point("sine", 1200.0, 20.0), PUBLISHED),
    "published, square": (Point("square", 1200.0, 20.0), PUBLISHED),
    "square through switches": (Point("square", 3e4, 20.0), ContactParameters(1e5, 100.0, 1.0)),
    "no damping": (Point("sine", 1200.0, 20.0), ContactParameters(1e5, 0.0, 0.0)),
    "no damping, square": (Point("square", 1200.0, 20.0), ContactParameters(1e5, 0.0, 0.0)),
    "1 mHz": (Point("sine", 1e-3, 20.0), PUBLISHED),
    "1 mHz, hardly damped": (Point("sine", 1e-3, 150.0), ContactParameters(1e7, 1.0, 1e-2)),
    "10 MHz, most damped": (Point("sine", 1e7, 20.0), ContactParameters(1e3, 1e6, 1e5)),
    "stiffest contact": (Point("sine", 1200.0, 20.0), ContactParameters(1e9, 1.0, 1e-2)),
    "softest, most damped": (Point("sine", 1200.0, 20.0), ContactParameters(1e3, 1e6, 1e5)),
    "all largest": (Point("sine", 1200.0, 20.0), ContactParameters(1e9, 1e6, 1e5)),
}


@pytest.mark.parametrize("name", HARD)
def test_tight_and_fast_agree_with_many_digits(name: str, rig: Constants) -> None:
    point, parameters = HARD[name]
    true = mp_launch(point, parameters, rig)
    assert true.outcome == "launched"
    tight = tight_launch(point, parameters, rig)
    assert tight.launch_range == pytest.approx(true.launch_range, rel=1e-11)
    assert tight.separation_time == pytest.approx(true.separation_time, rel=1e-11)
    when, speed = fast(point, parameters, rig)
    assert when == pytest.approx(true.separation_time, rel=1e-11)
    assert speed == pytest.approx(true.velocity, rel=1e-11)


# Unit masses with poles (-1, -1, -2, -3), and (-1, -1, -1, -5): critical to rounding. Solved from
# c_s + 2 c_c = A, k_s + 2 k_c + c_s c_c = B, c_s k_c + c_c k_s = C, k_s k_c = D, the coefficients of
# the contact polynomial for m = M = 1.
CRITICAL = {
    "double pole": ((-1, -1, -2, -3), (0.61280927, 4.03215255, 1.48392372, 9.79097463)),
    "triple pole": ((-1, -1, -1, -5), (4.90447501, 2.71281149, 2.64359425, 1.01947711)),
}


@pytest.mark.parametrize("name", CRITICAL)
@pytest.mark.parametrize("waveform", ["sine", "square"])
def test_critical_damping(name: str, waveform: str) -> None:
    roots, (k_c, c_s, c_c, k_s) = CRITICAL[name]
    a, b, c, d = np.poly(roots)[1:]
    for _ in range(20):  # Newton: from the eight digits above to all of them
        rest = [c_s + 2 * c_c - a, k_s + 2 * k_c + c_s * c_c - b, c_s * k_c + c_c * k_s - c, k_s * k_c - d]
        slope = np.array([[0, 1, 2, 0], [2, c_c, c_s, 1], [c_s, k_c, k_s, c_c], [k_s, 0, 0, k_c]])
        k_c, c_s, c_c, k_s = np.array([k_c, c_s, c_c, k_s]) - np.linalg.solve(slope, rest)
    constants = Constants(M=1.0, m=1.0, q=1e-3, l=1.0, k_s=float(k_s), g=9.81)
    point, parameters = Point(waveform, 0.2, 20.0), ContactParameters(float(k_c), float(c_s), float(c_c))
    true = mp_launch(point, parameters, constants, 100.0)
    assert true.outcome == "launched"
    tight = tight_launch(point, parameters, constants, 100.0)
    assert tight.launch_range == pytest.approx(true.launch_range, rel=1e-11)
    when, speed = fast(point, parameters, constants)
    # The closed form spreads coinciding poles a little: see closed_form.
    assert when == pytest.approx(true.separation_time, rel=1e-8)
    assert speed == pytest.approx(true.velocity, rel=1e-8)


def test_all_three_agree_on_either_side_of_a_grazing_contact(rig: Constants) -> None:
    # Here a growing contact stiffness turns a near touch into the separation, 6 us earlier.
    point = Point("sine", 65048.0, 20.0)

    def at(k_c: float) -> ContactParameters:
        return ContactParameters(k_c, 412.5, 1.43)

    low, high = 2.4e7, 2.8e7
    late, early = fast(point, at(low), rig)[0], fast(point, at(high), rig)[0]
    assert late - early > 5e-6
    while high / low - 1 > 1e-9:
        middle = math.sqrt(low * high)
        if fast(point, at(middle), rig)[0] > (late + early) / 2:
            low = middle
        else:
            high = middle
    before, after = (mp_launch(point, at(k_c), rig, digits=25) for k_c in (low, high))
    assert before.separation_time - after.separation_time > 4e-6
    for k_c, true in ((low, before), (high, after)):
        tight, (when, speed) = tight_launch(point, at(k_c), rig), fast(point, at(k_c), rig)
        # At a touch the time moves like the square root of everything: half of the digits remain.
        assert tight.separation_time == pytest.approx(true.separation_time, rel=1e-7)
        assert when == pytest.approx(true.separation_time, rel=1e-7)
        assert tight.velocity == pytest.approx(true.velocity, rel=1e-7)
        assert speed == pytest.approx(true.velocity, rel=1e-7)


def test_tight_agrees_with_fast_on_random_draws(rig: Constants) -> None:
    rng = np.random.default_rng(20)
    for _ in range(15):
        parameters = ContactParameters(10 ** rng.uniform(3, 9), 10 ** rng.uniform(0, 4.5), 10 ** rng.uniform(-2, 3))
        waveform: str = "sine" if rng.random() < 0.5 else "square"
        point = Point(waveform, 10 ** rng.uniform(2, 4.7), rng.uniform(1, 150))
        tight, (when, speed) = tight_launch(point, parameters, rig), fast(point, parameters, rig)
        assert tight.separation_time == pytest.approx(when, rel=1e-9), (point, parameters)
        assert tight.velocity == pytest.approx(speed, rel=1e-9), (point, parameters)

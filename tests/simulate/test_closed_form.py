"""The closed form against references that share no code with it, over the whole prior range and at its edges."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest
from scipy.optimize import brentq

from psafit.drives import Drive, Table
from psafit.experiment import Constants
from psafit.physics.baseline import PARAMETERS
from psafit.physics.term import Setup
from psafit.simulate import Design, closed_form, contact, launch_range, simulate
from psafit.simulate.reference import ContactParameters, Point, mp_launch, tight_launch

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
PUBLISHED = np.array([1.425e5, 13991.0, 68.0])
LOW, HIGH = (np.log([getattr(p.bounds, side) for p in PARAMETERS]) for side in ("lower", "upper"))


def point(waveform: str, frequency: float, volt: float = 20.0) -> Design:
    return Design.sweep(RIG, waveform, [frequency], volt)


def fast(theta: np.ndarray, waveform: str, frequency: float, volt: float = 20.0) -> float:
    return float(simulate(point(waveform, frequency, volt), theta).launch_range[0, 0])


def exact(theta: tuple[float, ...] | np.ndarray, waveform: str, frequency: float, volt: float = 20.0) -> float:
    """Launch range from the many-digit reference, which looks for a zero at 40 moments of the contact or more."""
    found = simulate(point(waveform, frequency, volt), np.array(theta)).separation_time[0, 0]
    launch = mp_launch(
        Point(waveform, frequency, volt), ContactParameters(*theta), RIG, 10.0, digits=25, step=float(found) / 40
    )
    return launch.launch_range


def draw(rng: np.random.Generator) -> tuple[np.ndarray, str, float, float]:
    theta = np.exp(rng.uniform(LOW, HIGH))
    return theta, str(rng.choice(["sine", "square"])), float(10 ** rng.uniform(0, 5)), float(rng.uniform(0.5, 150))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(4))
def test_agrees_with_the_tight_reference_over_the_prior_range(part: int) -> None:
    """In all 400 parameter sets drawn from the prior, launch range to 1e-8 relative."""
    seed = int(os.environ.get("PSAFIT_SEED", "20240521")) + part
    rng = np.random.default_rng(seed)
    for _ in range(100):
        theta = np.array([float(p.to_physical(p.prior_quantile(rng.uniform()))) for p in PARAMETERS])
        _, waveform, frequency, volt = draw(rng)
        design = Point(waveform, frequency, volt)  # type: ignore[arg-type]
        reference = tight_launch(design, ContactParameters(*theta), RIG, 10.0).launch_range
        error = abs(fast(theta, waveform, frequency, volt) / reference - 1)
        assert error < 1e-8, f"seed {seed}: {error:.1e} at {theta}, {waveform}, {frequency} Hz, {volt} V"


def test_agrees_with_many_digits_over_the_prior_range() -> None:
    rng = np.random.default_rng(7)
    for _ in range(8):
        theta, waveform, frequency, volt = draw(rng)
        reference = exact(theta, waveform, frequency, volt)
        assert fast(theta, waveform, frequency, volt) == pytest.approx(reference, rel=1e-11), (
            theta,
            waveform,
            frequency,
        )


@pytest.mark.parametrize("waveform", ["sine", "square"])
@pytest.mark.parametrize("frequency", [1e-3, 1200.0, 1e5, pytest.param(1e7, marks=pytest.mark.slow)])
@pytest.mark.parametrize("theta", [(1.4e5, 0.0, 0.0), (1e7, 0.0, 10.0)])
def test_tiny_and_huge_frequencies_and_no_damping(theta: tuple[float, ...], frequency: float, waveform: str) -> None:
    reference = exact(theta, waveform, frequency)
    assert fast(np.array(theta), waveform, frequency) == pytest.approx(reference, rel=1e-9)


def _critical_dampings(k_c: float, c_s: float) -> list[float]:
    """Contact dampings at which two poles merge, to the last digit."""

    def n_complex(c_c: float) -> int:
        s = closed_form.poles(closed_form.contact_polynomial(Setup.of(RIG, np.array([[k_c, c_s, c_c]]))))
        return int((s.imag != 0).sum())

    grid = np.geomspace(1e-2, 1e5, 3000)
    counts = [n_complex(c) for c in grid]
    found = []
    for i in np.flatnonzero(np.diff(counts)):
        merge = brentq(lambda c, n=counts[i]: 1.0 if n_complex(c) == n else -1.0, grid[i], grid[i + 1], xtol=1e-16)
        found.append(float(merge))
    return found


@pytest.mark.parametrize("k_c, c_s", [(3273.0, 117371.0), (1.05e6, 416.9)])
def test_critical_damping(k_c: float, c_s: float) -> None:
    """Merging poles, exactly and within a hair: the sum over simple poles has no digits left there."""
    merges = _critical_dampings(k_c, c_s)
    assert merges
    for c_c in merges:
        for shift in (0.0, -1e-9):
            for waveform, frequency in (("square", 5e4),):
                theta = (k_c, c_s, c_c * (1 + shift))
                reference = exact(theta, waveform, frequency)
                assert fast(np.array(theta), waveform, frequency) == pytest.approx(reference, rel=1e-9), theta


def test_merging_poles_under_a_recorded_drive() -> None:
    """Where poles merge there are more modes than the lines of a table are followed with at once."""
    time = np.linspace(0, 1e-2, 400)
    drive = Drive("table", table=Table(time, 20 * np.sin(400 * time), True))
    for c_c in _critical_dampings(3273.0, 117371.0):
        design, theta = Design.sweep(RIG, drive, 60.0, 20.0), np.array([3273.0, 117371.0, c_c])
        closed, stepped = (simulate(design, theta, path=path, tolerance=1e-9) for path in (None, "stepper"))
        assert closed.launch_range == pytest.approx(stepped.launch_range, rel=1e-8)


def test_poles_keep_their_digits_next_to_large_ones() -> None:
    """Known roots spread over ten decades come back to 1e-13 each."""
    rng = np.random.default_rng(3)
    for _ in range(200):
        roots = -np.sort(10 ** rng.uniform(-2, 8, 4))
        found = closed_form.poles(np.poly(roots)[None, 1:])[0]
        assert np.sort(found.real) == pytest.approx(np.sort(roots), rel=1e-6)
        # The coefficients pin well separated roots down to rounding.
        if np.abs(np.diff(np.log(-roots))).min() > 0.5:
            assert np.sort(found.real) == pytest.approx(np.sort(roots), rel=1e-12)


def test_high_frequency_contact_nearly_touches_zero_many_times() -> None:
    """A fast sine makes the indentation almost vanish once a cycle; the first zero is still the first."""
    theta = np.array([1.0e4, 5.0, 0.05])
    for frequency in (2e4, 5e4, 2e5):
        when, _, _, status, _ = closed_form.separation(point("sine", frequency), Setup.of(RIG, theta[None, :]))
        assert status[0, 0] == closed_form.LAUNCHED
        seen = contact(point("sine", frequency), theta, n_times=20001)[0]
        assert (seen.indentation[1:-1] > 0).all()
        assert seen.contact_time == when[0, 0]


def test_no_voltage_no_launch() -> None:
    result = simulate(Design.sweep(RIG, "sine", [100.0, 1000.0], [0.0, 0.0]), PUBLISHED)
    assert (result.launch_range == 0).all() and not result.launched.any()


def test_roots_that_are_twice_the_same_stand_as_they_are() -> None:
    """No step of Newton's method leads on from them."""
    twice = np.array([[-0.5 + 0.75j, -0.5 - 0.75j, -0.5 + 0.75j, -0.5 - 0.75j]])
    found = closed_form._polish(np.poly(twice[0]).real[None, 1:], twice)
    assert found == pytest.approx(twice, abs=1e-12)


def test_a_pressed_ball_that_never_separates_ends_the_search() -> None:
    rig = Setup.of(RIG, PUBLISHED[None, :]).change(lean=np.array([4e-3]))
    for waveform in ("sine", "square"):
        when, speed, _, status, _ = closed_form.separation(point(waveform, 100.0, 0.01), rig)
        assert np.isnan(when[0, 0]) and speed[0, 0] == 0.0 and status[0, 0] == closed_form.NO_SEPARATION


@pytest.mark.usefixtures("all_threads")
def test_batch_equals_single_sets_and_any_number_of_threads() -> None:
    rng = np.random.default_rng(11)
    sets = np.exp(rng.uniform(LOW, HIGH, (40, 3)))
    design = Design.sweep(RIG, "sine", np.geomspace(1, 5e4, 23), 20.0)
    together = simulate(design, sets).launch_range  # threads
    alone = np.stack([simulate(design, s).launch_range[0] for s in sets])  # no threads
    assert np.array_equal(together, alone)


def test_pendulum() -> None:
    """By hand: h = v^2/2g = 0.045 m on a 0.09 m string is theta = 60 degrees, L = 0.09 sin 60."""
    v = np.sqrt(2 * 9.81 * 0.045)
    assert launch_range(v, 0.09, 9.81) == pytest.approx(0.09 * np.sqrt(3) / 2, rel=1e-14)
    assert launch_range(100.0, 0.09, 9.81) == 0.09
    # Tiny swings: L = v sqrt(l/g) (1 - v^2/8gl), where cos(theta) is one to rounding.
    assert launch_range(1e-9, 0.09, 9.81) == pytest.approx(1e-9 * np.sqrt(0.09 / 9.81), rel=1e-14)


def test_contact_by_hand() -> None:
    """A rigid, undamped stack under a step: the ball on a spring meets a moving base.

    With k_s, q large against k_c the tip jumps to q V(1 - cos(w_s t)); far above the contact's own frequency the ball
    sees the mean q V, and d = q V cos(w_c t) on average, so that it leaves after a quarter period at speed q V w_c.
    """
    rig = dataclasses.replace(RIG, k_s=4.89e11)
    theta = np.array([1e5, 2 * np.sqrt(4.89e11 * 0.005), 0.0])  # critically damped stack, rate 1e7 1/s
    result = simulate(Design.sweep(rig, "square", [1.0], 20.0), theta)
    w = np.sqrt(1e5 / 0.027)
    assert result.separation_time[0, 0] == pytest.approx(0.5 * np.pi / w, rel=1e-3)
    assert result.separation_speed[0, 0] == pytest.approx(1.2e-7 * 20 * w, rel=1e-3)


@pytest.mark.parametrize(
    "waveform, frequency",
    [
        ("sine", 1200.0),
        pytest.param("sine", 3500.0, marks=pytest.mark.slow),
        ("square", 500.0),
        pytest.param("square", 25000.0, marks=pytest.mark.slow),
    ],
)
def test_contact_obeys_newton(waveform: str, frequency: float) -> None:
    seen = contact(point(waveform, frequency), PUBLISHED, n_times=200_001)[0]
    impulse = np.trapezoid(seen.force, seen.time)
    assert seen.compression_impulse + seen.restitution_impulse == pytest.approx(RIG.M * seen.ball_speed[-1], rel=1e-12)
    assert impulse == pytest.approx(RIG.M * seen.ball_speed[-1], rel=2e-3)
    assert np.gradient(seen.ball, seen.time)[1000:-1000] == pytest.approx(seen.ball_speed[1000:-1000], rel=1e-4)
    assert np.gradient(seen.tip_speed, seen.time)[1000] * RIG.m == pytest.approx(
        -PUBLISHED[1] * seen.tip_speed[1000]
        - RIG.k_s * seen.tip[1000]
        + RIG.k_s * RIG.q * 20 * (1.0 if waveform == "square" else np.sin(2 * np.pi * frequency * seen.time[1000]))
        - seen.force[1000],
        rel=1e-3,
        abs=1e-4,
    )
    assert seen.peak_force == pytest.approx(seen.force.max(), rel=1e-3)
    assert seen.peak_force >= seen.force.max() * (1 - 1e-12)
    assert abs(seen.indentation[-1]) < 1e-12 * seen.indentation.max()
    speed = simulate(point(waveform, frequency), PUBLISHED).separation_speed[0, 0]
    assert seen.ball_speed[-1] == pytest.approx(speed, rel=1e-10)


def test_range_is_proportional_to_a_small_voltage() -> None:
    """The baseline is linear: an exact scaling law, whatever the parameters."""
    rng = np.random.default_rng(2)
    design = Design.sweep(RIG, "sine", [900.0] * 2, [1.0, 2.0])
    for _ in range(20):
        speed = simulate(design, np.exp(rng.uniform(LOW, HIGH))).separation_speed[0]
        assert speed[1] == pytest.approx(2 * speed[0], rel=1e-12)


@pytest.mark.parametrize(
    "theta", [np.ones((2, 4)), np.array([0.0, 1, 1]), np.array([1e5, -1, 1]), np.array([1e5, 1, np.nan])]
)
def test_impossible_parameters_are_refused(theta: np.ndarray) -> None:
    with pytest.raises(ValueError, match="theta"):
        simulate(point("sine", 1000.0), theta)


def test_contact_without_launch_says_so() -> None:
    with pytest.raises(ValueError, match="no launch at 1200 Hz"):
        contact(point("sine", 1200.0, 0.0), PUBLISHED)
    with pytest.raises(ValueError, match="no launch at 1200 Hz"):
        contact(Design.sweep(RIG, Drive("sine", phase_deg=180.0), 1200.0, 20.0), PUBLISHED)

"""The stepping path: against the closed form where there is one, smooth in the parameters, and free of side effects."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from psafit.drives import Drive
from psafit.experiment import Constants
from psafit.physics import TERMS, baseline, terms
from psafit.physics.term import Setup
from psafit.simulate import Design, columns, path_of, simulate, stepper
from psafit.simulate.batch import rig_of
from psafit.simulate.closed_form import NO_SEPARATION
from psafit.simulate.contract import Draw
from psafit.simulate.design import Counts
from psafit.simulate.literal import literal_launch
from psafit.simulate.reference import Point
from psafit.simulate.threads import set_n_threads

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
PUBLISHED = [1.425e5, 13991.0, 68.0]
FREQUENCIES = np.geomspace(100.0, 2e4, 12)


def sweeps() -> Design:
    sine = Design.sweep(RIG, "sine", FREQUENCIES, 20.0)
    square = Design.sweep(RIG, "square", FREQUENCIES, 12.0)
    return Design(
        RIG,
        np.concatenate([sine.waveform, square.waveform]),
        np.concatenate([sine.frequency, square.frequency]),
        np.concatenate([sine.amplitude, square.amplitude]),
        np.zeros(24, int),
    )


def prior_draws(n: int, ids: list[str], rng: np.random.Generator) -> np.ndarray:
    chosen = [*baseline.PARAMETERS, *(p for t in terms(ids) for p in t.parameters)]
    return np.stack([p.to_physical(p.prior_quantile(rng.uniform(0.02, 0.98, n))) for p in chosen], axis=1)


def test_steps_find_the_closed_form() -> None:
    """Two paths that share no formula, over the prior and a linear cause of every kind."""
    rng = np.random.default_rng(11)
    for ids in ([], ["amplifier_lag"], ["preload"], ["modal_mass", "stack_stiffness"], ["adhesion"]):
        chosen = terms(ids)
        theta = prior_draws(25, ids, rng)
        exact = simulate(sweeps(), theta, chosen)
        stepped = simulate(sweeps(), theta, chosen, path="stepper")
        assert (exact.engine, stepped.engine) == ("closed form", "stepper")
        assert (exact.launched == stepped.launched).all()
        error = np.abs(stepped.launch_range - exact.launch_range) / np.maximum(exact.launch_range, 1e-12)
        assert np.quantile(error, 0.99) < 1e-7 and error.max() < 1e-5, ids


@pytest.mark.slow
def test_no_pair_of_causes_loses_a_launch() -> None:
    """Every pair over its priors, drawn anew in every run, against hundredfold finer steps.

    Not even a grazing contact may come and go with the error of a step, but within that error of a bifurcation; see
    benchmarks/finer_steps.py for how rare those are.
    """
    seed = np.random.SeedSequence().entropy
    rng = np.random.default_rng(seed)
    differ = []
    for pair in itertools.combinations([t.id for t in TERMS if not t.latent], 2):
        theta, chosen = prior_draws(12, list(pair), rng), terms(pair)
        found = simulate(sweeps(), theta, chosen).launch_range
        finer = simulate(sweeps(), theta, chosen, path="stepper", tolerance=1e-2 * stepper.TOLERANCE).launch_range
        wrong = np.abs(found - finer) > 1e-3 * np.abs(finer) + 1e-11
        # What grazes does so at many frequencies: it is counted once.
        differ += [(pair, theta[k].tolist(), found[k], finer[k]) for k in np.flatnonzero(wrong.any(axis=1))]
    assert len(differ) <= 1, (seed, differ[:5])


def launch(point: Point, theta: list[float], **causes: list[float]) -> Draw:
    return Draw(point, theta, terms(causes), tuple(causes.values()), RIG)


STUCK = [101924.62352277276, 990.08304105643, 1.1601646504619127]
ASTRAY = {
    # A force that begins as a high power of time: its first coefficients are noise, and have no sign.
    "lag, 400 Hz": launch(Point("sine", 400.0, 20.0), STUCK, amplifier_lag=[8.25e-5], no_tension=[0.23166322809745765]),
    "lag, 600 Hz": launch(Point("sine", 600.0, 20.0), STUCK, amplifier_lag=[8.5e-5], no_tension=[0.23166322809745765]),
    # A damping that begins as a fraction of a power: no polynomial has its sign before the first node.
    "damping that grows": launch(
        Point("sine", 2300.0, 20.0),
        [167806.6484318505, 67.74759276621684, 1.1521822560948038],
        stroke_tolerance=[0.8391838023491425],
        indentation_damping=[0.21152405764071444],
        no_tension=[0.4582188537757643],
    ),
    # The slowest of repeated impacts is not what the error of the steps is measured by.
    "slow first impact": launch(
        Point("sine", 89.90116065738454, 14.944908852885654),
        [4523.715144379707, 37.32509760185949, 14.51972162187314],
        start_phase=[-0.16834391092716608],
        drive_saturation=[0.006567720021217756],
        hertz_exponent=[1.123398270157778],
        repeat_impacts=[3.8396012870076484],
        swing_drag=[0.06379563849630314],
    ),
    # A ball that is never launched reads its highest place: within a step, or at the horizon where it still rises.
    "top within a step": launch(
        Point("square", 4714.942062654642, 12.0),
        [244074.72321728006, 21.2942027929112, 495.60010075354495],
        start_phase=[-0.43712176050877016],
        preload=[0.005733587984928285],
    ),
    "rising at the horizon": launch(
        Point("square", 4714.942062654642, 12.0),
        [220473.64549703323, 86951.20841424746, 139.95186742598563],
        slew_limit=[2.353525051985649e-05],
        preload=[0.0008321743209515797],
    ),
    # The tip leaves a ball that friction holds, and comes back to push it farther.
    "held ball": launch(
        Point("sine", 262.0409046699977, 20.0),
        [27561.159539772, 2776.729448855937, 5.1067696410192145],
        preload=[0.007989662406135932],
        sliding_support=[2.079925891441067, 0.9559052146712843],
    ),
    # A bond that is compressed again for a part of a step, or just before a piece of the drive ends.
    "bond, sine": launch(
        Point("sine", 8000.0, 15.0),
        [12277.032218534261, 140.74265964707536, 71.80481694722167],
        amplifier_lag=[0.00018159681606563818],
        drive_saturation=[0.0014984488671233199],
        no_tension=[0.9694080202743841],
        adhesion=[0.006713269432165047],
    ),
    "bond, square": launch(
        Point("square", 21000.0, 20.0),
        [35305.32816885767, 2549.5555209224112, 2.6705488022767483],
        amplifier_lag=[2.859328851967111e-05],
        start_phase=[0.3159300274925447],
        no_tension=[0.07227156302991455],
        adhesion=[0.005534593075717546],
    ),
}


@pytest.mark.parametrize("case", ASTRAY.values(), ids=ASTRAY.keys())
def test_steps_that_once_went_astray(case: Draw) -> None:
    right = case.reference()
    for tolerance in (1e-4, 1e-5, 3e-6, 1e-6, 1e-7):
        assert case.fast(tolerance)[0] == pytest.approx(right, rel=1e-5, abs=1e-13), tolerance


NEVER_LAUNCHED = ("top within a step", "rising at the horizon", "held ball")


@pytest.mark.parametrize("case", [ASTRAY[name] for name in NEVER_LAUNCHED], ids=NEVER_LAUNCHED)
def test_the_highest_place_of_a_ball_that_is_never_launched(case: Draw) -> None:
    assert case.fast(stepper.TOLERANCE)[0] == pytest.approx(case.reference(), rel=1e-9)
    # It grows with the steps that are taken.
    theta = np.array([[*case.theta, *itertools.chain(*case.values)]])
    rig, design = rig_of(case.constants, theta, case.causes), Design.sweep(case.constants, *case.point)
    places = []
    for steps in (5, 50, 20_000):
        how = stepper.StepSettings(most_steps=steps)
        _, _, place, status, *_ = stepper.separation(design, rig, theta, stepper.Calls(), settings=how)
        assert status[0, 0] == NO_SEPARATION
        places.append(float(place[0, 0]))
    assert 0.0 <= places[0] <= places[1] <= places[2] == pytest.approx(case.reference(), rel=1e-9)


def test_error_falls_with_the_tolerance() -> None:
    exact = simulate(sweeps(), PUBLISHED).launch_range
    errors = []
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
        stepped = simulate(sweeps(), PUBLISHED, path="stepper", tolerance=tolerance).launch_range
        errors.append(np.abs(stepped / exact - 1).max())
    assert errors[0] < 1e-4 and errors[-1] < 1e-9
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))


@pytest.mark.parametrize(
    "ids", [["hertz_exponent"], ["slew_limit", "hunt_crossley", "hysteresis"], ["no_tension"], ["soft_layer"]]
)
def test_launch_range_is_smooth_in_the_parameters(ids: list[str]) -> None:
    """On short lines in parameter space nothing but a polynomial of degree five is left above 1e-6."""
    rng = np.random.default_rng(4)
    chosen = terms(ids)
    parameters = [*baseline.PARAMETERS, *(p for t in chosen for p in t.parameters)]
    t = np.linspace(-1, 1, 24)
    basis = np.polynomial.chebyshev.chebvander(t, 5)
    rest = np.eye(24) - basis @ np.linalg.pinv(basis)
    jitter = []
    for _ in range(40):
        centre = np.array([p.prior_quantile(rng.uniform(0.1, 0.9)) for p in parameters])
        direction = rng.normal(size=len(parameters))
        u = centre + 0.005 * t[:, None] * direction / np.linalg.norm(direction)
        theta = np.stack([p.to_physical(u[:, i]) for i, p in enumerate(parameters)], axis=1)
        ranges = simulate(sweeps(), theta, chosen).launch_range
        jitter.append(np.abs(rest @ ranges).max(axis=0) / np.maximum(ranges.min(axis=0), 1e-9))
    # The few that remain pass a true bifurcation: another dip of the indentation becomes the first to reach zero.
    assert np.mean(np.array(jitter) > 1e-6) < 0.01, ids
    assert np.median(jitter) < 1e-8


@pytest.mark.usefixtures("all_threads")
def test_neither_batch_nor_threads_change_a_bit() -> None:
    ids = ["hertz_exponent", "hysteresis"]
    theta = prior_draws(9, ids, np.random.default_rng(2))
    whole = simulate(sweeps(), theta, terms(ids)).launch_range
    single = np.concatenate([simulate(sweeps(), one, terms(ids)).launch_range for one in theta])
    assert (whole == single).all()
    set_n_threads(1)
    assert (simulate(sweeps(), theta, terms(ids)).launch_range == whole).all()


def test_choosing_causes_compiles_nothing() -> None:
    simulate(sweeps(), [*PUBLISHED, 1.5], terms(["hertz_exponent"]))
    before = len(stepper.all_sets.signatures)
    simulate(sweeps(), [*PUBLISHED, 20.0, 1e-7], terms(["gap", "hunt_crossley"]))
    simulate(sweeps(), [*PUBLISHED, 0.01], terms(["field_dependent_d33"]))
    assert len(stepper.all_sets.signatures) == before


def test_neutral_sets_of_a_batch_take_the_closed_form() -> None:
    chosen = terms(["hertz_exponent"])
    both = simulate(sweeps(), [[*PUBLISHED, 1.0], [*PUBLISHED, 1.4]], chosen)
    assert both.engine == "mixed"
    assert (both.launch_range[0] == simulate(sweeps(), PUBLISHED).launch_range[0]).all()
    assert simulate(sweeps(), [*PUBLISHED, 1.0], chosen).engine == "closed form"


def test_path_of_a_model() -> None:
    assert path_of(terms(["amplifier_lag", "preload", "swing_drag", "reading_gain"])) == "closed form"
    for id in ("slew_limit", "gap", "no_tension", "hertz_exponent", "hysteresis", "repeat_impacts"):
        assert path_of(terms([id])) == "stepper", id


def test_a_tip_that_does_not_reach_the_ball_launches_nothing() -> None:
    chosen = terms(["gap"])
    stroke = RIG.q * 20.0
    far = simulate(Design.sweep(RIG, "sine", [200.0], 20.0), [1e6, 1e3, 30.0, 3 * stroke], chosen)
    assert not far.launched.any() and (far.launch_range == 0).all() and np.isnan(far.separation_time).all()
    near = simulate(Design.sweep(RIG, "sine", [200.0], 20.0), [1e6, 1e3, 30.0, 0.5 * stroke], chosen)
    assert near.launched.all()


def test_a_ball_pressed_too_hard_stays() -> None:
    """Below the drive that outweighs the press there is no separation; it reads what the tip carried it to."""
    chosen = terms(["preload"])
    for path in ("closed form", "stepper"):
        held = simulate(Design.sweep(RIG, "sine", [100.0], 0.01), [1e6, 1e3, 30.0, 4e-3], chosen, path=path)
        assert not held.launched.any() and 0.95 < held.launch_range[0, 0] / (RIG.q * 0.01) < 1.25


def test_a_ball_drawn_after_the_tip_is_followed_to_its_launch() -> None:
    """Separated while moving inwards: the closed form hands over to the steps, which agree with the reference."""
    chosen = terms(["preload"])
    found = 0
    rng = np.random.default_rng(8)
    for _ in range(400):
        theta = [float(p.to_physical(p.prior_quantile(rng.uniform()))) for p in baseline.PARAMETERS]
        x_0, f, volt = float(rng.uniform(1e-4, 2e-3)), float(10 ** rng.uniform(2.5, 4)), float(rng.uniform(0.2, 5))
        design = Design.sweep(RIG, "sine", [f], volt)
        result = simulate(design, [*theta, x_0], chosen)
        if result.engine == "closed form" and result.launched.all() and result.separation_time[0, 0] * f > 1.2:
            reference = literal_launch(Point("sine", f, volt), theta, [(chosen[0], [x_0])], RIG)
            assert result.launch_range[0, 0] == pytest.approx(reference.launch_range, rel=1e-6)
            found += 1
        if found == 3:
            return
    assert found, "no such case drawn"


@pytest.mark.parametrize(
    ("theta", "f", "volt", "lean"),
    [
        ([568283.3615770173, 4946.8941795014325, 85.85205366466559], 12355.0, 20.0, 5.592183071867481e-05),
        ([302514.1895014263, 217.4827097612043, 35.91498173458466], 1500.0, 3.64, 2.071903383861296e-04),
        ([577248.6756654857, 1341.6255584914961, 49.10055513026848], 1500.0, 3.64, 1.9742452404181737e-04),
    ],
)
def test_a_leaning_ball_that_sinks_first_turns_within_the_noise_of_its_speed(
    theta: list[float], f: float, volt: float, lean: float
) -> None:
    """Its speed passes zero, where it starts, by less than rounding shows: a turn all the same."""
    chosen, own = terms(["start_phase", "preload"]), ([-2.045060921296211], [lean])
    reference = literal_launch(Point("sine", f, volt), theta, list(zip(chosen, own, strict=True)), RIG)
    fast = simulate(Design.sweep(RIG, "sine", [f], volt), [*theta, *own[0], *own[1]], chosen, tolerance=1e-6)
    assert fast.launch_range[0, 0] == pytest.approx(reference.launch_range, rel=1e-6)


@pytest.mark.parametrize("phase", [180.0, 200.0])
def test_a_tip_that_leaves_a_weightless_ball_comes_back_to_launch_it(phase: float) -> None:
    """Its first contact ends in 1e-12 to 1e-8 s by rounding alone: no launch, however often resolved."""
    chosen, drive = terms(["indentation_damping", "preload"]), Drive("sine", phase_deg=phase)
    rng = np.random.default_rng(1)
    for _ in range(15):
        theta = [float(p.to_physical(p.prior_quantile(rng.uniform()))) for p in baseline.PARAMETERS]
        f, power, lean = float(10 ** rng.uniform(2.3, 3.7)), float(rng.uniform(0.05, 1.5)), 10 ** rng.uniform(-15, -9)
        stepped = simulate(Design.sweep(RIG, drive, [f], 10.0), [*theta, power, lean], chosen, tolerance=1e-6)
        reference = literal_launch(Point(drive, f, 10.0), theta, list(zip(chosen, ([power], [lean]), strict=True)), RIG)
        assert stepped.launch_range[0, 0] == pytest.approx(reference.launch_range, rel=1e-6), (theta, f, power, lean)


def test_refuses_what_makes_no_sense() -> None:
    with pytest.raises(ValueError, match="no closed form"):
        simulate(sweeps(), [*PUBLISHED, 1.5], terms(["hertz_exponent"]), path="closed form")
    with pytest.raises(ValueError, match="hertz_n"):
        simulate(sweeps(), PUBLISHED, terms(["hertz_exponent"]))
    with pytest.raises(ValueError, match="no path"):
        simulate(sweeps(), PUBLISHED, path="fast")
    assert columns(terms(["reading_gain"]), Counts(2, 2))[-2:] == ["reading_gain_z_0", "reading_gain_z_1"]


@pytest.mark.parametrize("phase", [0.1, 0.49, 1.2])
@pytest.mark.parametrize("inverse_slew", [2e-9, 2e-10, 2e-12])
def test_a_slew_limit_too_fast_to_matter_does_not(phase, inverse_slew):
    """A sine that starts at a phase begins with a steep ramp, which must meet its command once and be left behind."""
    design = Design.sweep(RIG, "sine", np.array([100.0, 1200.0, 25e3]), 20.0)
    rig = [3.2e6, 3e5, 6.0]
    limited = simulate(design, [*rig, inverse_slew, phase], terms(["slew_limit", "start_phase"]))
    free = simulate(design, [*rig, phase], terms(["start_phase"]))
    assert limited.launched.all()
    # The ramp is over long before the ball moves.
    assert limited.launch_range == pytest.approx(free.launch_range, rel=1e-2)


def test_friction_holds_a_ball_that_is_pushed_too_little() -> None:
    """k_c q V = 0.12 mN against 27 mN: it does not move at all, and with friction enough to a tenth it does."""
    chosen = terms(["sliding_support", "separation_height"])
    low = Design.sweep(RIG, "sine", [100.0, 1000.0], 1e-3)
    held, free = (simulate(low, [1e6, 1e3, 30.0, a, 1.0, 1.0], chosen) for a in (1.0, 1e-4))
    assert held.launch_range.tolist() == [[0.0, 0.0]] and held.separation_place.tolist() == [[0.0, 0.0]]
    assert (free.launch_range > 0).all()


def test_a_ball_that_is_torn_off_slides_on() -> None:
    """Just torn off it hardly moves: that is no coming to rest, at which the same instant would come again for ever."""
    rig = Constants(M=0.012, m=0.003, q=8e-8, l=0.15, k_s=3e7, g=9.81)
    (cause,) = terms(["sliding_support"])
    theta = np.array([[9.378e5, 1.728e5, 3.746]])
    design = Design.sweep(rig, "sine", [200.0, 410.0, 4260.0], 10.0)
    setup = cause.setup(Setup.of(rig, theta), np.array([[4.653, 1.0]]))
    *_, steps = stepper.separation(design, setup, theta, stepper.Calls())
    assert (steps < 2000).all()


def test_the_first_hop_does_not_depend_on_how_long_the_drive_runs_on() -> None:
    """A leaning ball is struck again when it comes back; what is read is the flight that reached its apex before."""
    chosen = terms(["preload", "repeat_impacts"])
    design = Design.sweep(RIG, "sine", np.geomspace(100, 2000, 12), 20.0)
    ranges = [simulate(design, [1.1e6, 500.0, 60.0, 3e-3, n], chosen).launch_range[0] for n in (8.0, 10.0)]
    once = simulate(design, [1.1e6, 500.0, 60.0, 3e-3, 0.0], chosen).launch_range[0]
    assert ranges[0] == pytest.approx(ranges[1], rel=1e-6)
    # Where the hop of the first contact ends before the tip is back, it is that hop.
    assert np.mean(np.abs(ranges[0] / once - 1) < 1e-6) > 0.3


def test_a_top_behind_the_horizon_does_not_count() -> None:
    """A pressed ball that is never launched reads its highest place until the horizon, however long a step is."""
    point = Point("sine", 115.21126968311815, 21.74823072063209)
    theta = [175752.75441105544, 28.031291512202046, 2019.604251716704]
    draw = Draw(point, theta, tuple(terms(["preload"])), ([3.3899e-3],))
    assert not simulate(Design.sweep(draw.constants, *point[:3]), [*theta, 3.3899e-3], draw.causes).launched[0, 0]
    assert draw.disagreement() <= 1

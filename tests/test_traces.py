"""Traces: read, written, simulated, fitted and scored."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from folders import write
from scipy.stats import multivariate_normal

from psafit.arrays import FloatArray
from psafit.drives import Drive, Table
from psafit.errors import InputError
from psafit.experiment import Conditions, describe, read_experiment, read_plan, write_experiment
from psafit.inference import noise
from psafit.inference.candidate import optimised
from psafit.inference.optimiser import expansion, gradient, log_posteriors, slopes
from psafit.inference.problem import Problem
from psafit.observables import DISPLACEMENT, OBSERVABLES, TIP_DISPLACEMENT, VELOCITY
from psafit.physics import term
from psafit.prior_check import with_scale
from psafit.simulate import Design, readings, simulate
from psafit.simulate.contract import STUDY, Draw, draw
from psafit.simulate.literal import literal_motion
from psafit.validate import log_ratio, predictive, score

TRACES = [OBSERVABLES.index(o) for o in (DISPLACEMENT, VELOCITY, TIP_DISPLACEMENT)]
SI = np.array([[1e-6], [1e-3], [1e-6]])

DRIVES = (
    Drive("sine"),
    Drive("square"),
    Drive("unipolar_sine"),
    Drive("table", table=Table(np.array([0.0, 0.2, 0.5, 1.0]), np.array([0.0, 1.0, -0.5, 0.0]), False), file="d.csv"),
)
CAUSES = (
    (), ("amplifier_lag",), ("hysteresis",), ("hertz_exponent",), ("frame_compliance",), ("flight_friction",),
    ("repeat_impacts",), ("preload", "swing_drag"),
)  # fmt: skip


def traced(times_us: FloatArray, drive: Drive | str = "sine", f: float = 1200.0, v: float = 20.0) -> list[Conditions]:
    """One launch, traced in every quantity: a group each."""
    n = times_us.size
    every = np.full(n, f), np.full(n, v)
    return [
        Conditions(k, Drive.of(drive), f"{k}.csv", *every, measured=np.full(n, k), time_us=times_us) for k in TRACES
    ]


def both(one: Draw, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ball, its speed and tip of the fast path and of the literal reference, SI; (3, n_times) each."""
    row = np.array([[*one.theta, *(x for own in one.values for x in own)]])
    design = Design.of(STUDY, traced(times * 1e6, one.point.drive, one.point.frequency, one.point.amplitude))
    fast = readings(design, row, one.causes)[0].reshape(3, -1) * SI
    pairs = list(zip(one.causes, one.values, strict=True))
    return fast, literal_motion(one.point, one.theta, pairs, one.constants, times.tolist()).T


@pytest.mark.parametrize("ids", CAUSES, ids="+".join)
def test_fast_and_literal_motion_agree(ids: tuple[str, ...]) -> None:
    """Ball in contact and in flight, and the tip, which goes on without the ball, at random times."""
    rng = np.random.default_rng([len(ids), *map(len, ids)])
    causes = tuple(term(i) for i in ids)
    for drive in DRIVES:
        one = draw(rng, causes, drives=(drive,))
        f, v = one.point.frequency, one.point.amplitude
        row = np.array([*one.theta, *(x for own in one.values for x in own)])
        found = simulate(Design.sweep(STUDY, drive, f, v), row, causes)
        end = float(np.nan_to_num(found.separation_time[0, 0])) or 1.0 / f
        fast, literal = both(one, np.sort(rng.uniform(0.0, 3.0 * end, 8)))
        size = np.maximum(np.abs(literal).max(axis=1), [1e-10, 1e-8, 1e-10])
        closed = found.engine == "closed form" and found.launched[0, 0]
        error = np.abs(fast - literal).max(axis=1) / size
        assert (error <= [*[1e-8 if closed else 1e-6] * 2, 1e-6]).all(), (one, error)


def test_a_trace_ends_where_the_launch_says() -> None:
    """At the separation the ball has the launch's speed; its farthest place is the range with the place counted."""
    theta = np.array([[1e6, 1e3, 30.0]])
    launch = simulate(Design.sweep(STUDY, "sine", 1200.0, 20.0), theta)
    when, speed = launch.separation_time[0, 0] * 1e6, launch.separation_speed[0, 0] * 1e3
    times = np.sort(np.append(np.linspace(0.0, 2e5, 400), when))
    place, velocity, _ = readings(Design.of(STUDY, traced(times)), theta)[0].reshape(3, -1)
    at = int(np.searchsorted(times, when))
    assert velocity[at] == pytest.approx(speed, rel=1e-9)
    placed = simulate(
        Design.sweep(STUDY, "sine", 1200.0, 20.0), np.append(theta, 1.0), (term("separation_height"),)
    ).launch_range[0, 0]
    assert place.max() == pytest.approx(placed * 1e6, rel=1e-4)
    assert velocity[-1] < 0.0  # it swings back


def test_no_parameters_have_no_samples() -> None:
    times = np.linspace(0.0, 300.0, 5)
    for causes, n in (((), 3), ((term("hertz_exponent"),), 4)):
        assert readings(Design.of(STUDY, traced(times)), np.empty((0, n)), causes).shape == (0, 15)


def test_losses_hold_a_ball_that_turns() -> None:
    """Friction beyond gravity's pull: the ball stays where it stops, at its range."""
    friction = term("flight_friction")
    row = np.array([1e6, 1e3, 30.0, 2.0])
    times = np.linspace(0.0, 5e4, 60)
    place, velocity, _ = readings(Design.of(STUDY, traced(times)), row, (friction,))[0].reshape(3, -1)
    assert velocity[-1] == 0.0 and place[-1] == place[-5]
    counted = (friction, term("separation_height"))
    reach = simulate(Design.sweep(STUDY, "sine", 1200.0, 20.0), np.append(row, 1.0), counted).launch_range[0, 0] * 1e6
    assert place[-1] == pytest.approx(reach, rel=1e-6)


# --- files ---------------------------------------------------------------------------------------------------------

GOOD = "time_us,displacement_um\n" + "".join(f"{5 * k},{0.01 * k * k}\n" for k in range(40))
GROUP = '[[group]]\nid = 9\nwaveform = "sine"\ntrace = "ball.csv"\nfrequency_hz = 1200\namplitude_v = 20\n'
RANGES = "frequency_hz,amplitude_v,launch_range_um\n1000,20,30\n2000,20,25\n"


def folder(path: Path, text: str = GOOD, group: str = GROUP) -> Path:
    """An experiment of launch ranges and a trace."""
    made = write(path, a=RANGES)
    (made / "ball.csv").write_text(text)
    with (made / "experiment.toml").open("a") as file:
        file.write("\n" + group)
    return made


def test_a_trace_is_a_group_of_samples(tmp_path: Path) -> None:
    experiment = read_experiment(folder(tmp_path))
    group = experiment.group(9)
    assert group.observables == (DISPLACEMENT,) and group.swept == "time" and group.n_points == 40
    assert group.time_us is not None and group.time_us[:3].tolist() == [0, 5, 10]
    assert set(group.frequency_hz) == {1200} and group.drive.waveform == "sine"
    reported = describe(experiment)["groups"][-1]
    assert reported["time_us"] == [0, 195] and reported["displacement_um"] == [0, 15.21] and reported["replicates"] == 0


def test_a_trace_is_written_as_it_was(tmp_path: Path) -> None:
    experiment = read_experiment(folder(tmp_path / "old"))
    for name, one in (("kept", experiment), ("new", replace(experiment, folder=Path()))):
        write_experiment(one, tmp_path / name)
        again = read_experiment(tmp_path / name)
        assert again.fingerprint == experiment.fingerprint and again.group(9).file == "ball.csv"
    later = read_experiment(folder(tmp_path / "later", GOOD.replace("5,0.01\n", "6,0.01\n")))
    assert later.fingerprint != experiment.fingerprint  # times count


def test_a_planned_trace_has_times_alone(tmp_path: Path) -> None:
    plan = read_plan(folder(tmp_path, "time_us,velocity_mm_s\n" + "".join(f"{k},\n" for k in range(20))))
    assert plan.groups[-1].observables == (VELOCITY,) and plan.groups[-1].time_us is not None


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (GOOD.replace("\n10,", "\n4,"), 4, "time_us 4 comes after 5"),
        (GOOD.replace("\n10,", "\n5,"), 4, "give each time once"),
        (GOOD.replace("\n0,", "\n-5,"), 2, "count time from the start of the drive"),
        (GOOD.replace("time_us", "time_s"), 1, "missing column time_us"),
        (GOOD.replace("displacement_um", "force_n"), 1, "missing column displacement_um or velocity_mm_s"),
        ("time_us,displacement_um,velocity_mm_s\n0,1,2\n", 1, "its own file and its own group"),
        ("time_us,displacement_um,x\n0,1,2\n", 1, "unknown column 'x'"),
        ("".join(GOOD.splitlines(keepends=True)[:6]), 1, "5 samples below the header; a trace has at least 10"),
        (GOOD.replace("5,0.01\n", "5,\n"), 3, "displacement_um is empty"),
        (GOOD.replace("5,0.01\n", "5,up\n"), 3, "is not a number"),
        ("time_us,velocity_mm_s\n" + "".join(f"{k},\n" for k in range(64)), 2, "in all 64 rows: the group waits for"),
    ],
)
def test_faults_of_a_trace_name_line_and_remedy(tmp_path: Path, text: str, line: int, said: str) -> None:
    with pytest.raises(InputError) as caught:
        read_experiment(folder(tmp_path, text))
    assert said in str(caught.value) and f"ball.csv:{line}" in str(caught.value)


@pytest.mark.parametrize(
    ("group", "said"),
    [
        (GROUP + 'file = "a.csv"\n', "both file and trace"),
        (GROUP.replace("frequency_hz = 1200\n", ""), "has no frequency_hz"),
        (GROUP.replace("= 20", '= "20"'), "amplitude_v is not a number"),
        (GROUP.replace("trace", "file"), "frequency_hz is a key of traces"),
        (GROUP.replace("ball.csv", "bell.csv"), "does not exist"),
        (GROUP.replace("trace", "tracing"), "did you mean trace?"),
    ],
)
def test_faults_of_a_traces_group(tmp_path: Path, group: str, said: str) -> None:
    with pytest.raises(InputError, match=r"experiment\.toml") as caught:
        read_experiment(folder(tmp_path, GOOD, group))
    assert said in str(caught.value)


def test_a_trace_of_launches_is_pointed_to_its_key(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_experiment(write(tmp_path, a=GOOD))
    assert "a.csv:1" in str(caught.value) and "with trace in the place of file" in str(caught.value)


def test_what_is_suspicious_of_a_trace_is_reported(tmp_path: Path) -> None:
    many = "time_us,displacement_um\n" + "".join(f"{0.1 * k},{1e-6 * k * k}\n" for k in range(5000))
    assert any("one in 3 says nearly as much" in w for w in read_experiment(folder(tmp_path / "a", many)).warnings)
    off = "time_us,displacement_um\n" + "".join(f"{k},{50 + k}\n" for k in range(40))
    assert any("is it counted from rest?" in w for w in read_experiment(folder(tmp_path / "b", off)).warnings)
    shifted = "time_us,displacement_um\n" + "".join(f"{1 + k},{50 + k}\n" for k in range(40))
    assert any("is it counted from rest?" in w for w in read_experiment(folder(tmp_path / "e", shifted)).warnings)
    late = "time_us,displacement_um\n" + "".join(f"{30 * k},{3 * (-1) ** k}\n" for k in range(1, 40))
    assert not any("counted from rest" in w for w in read_experiment(folder(tmp_path / "d", late)).warnings)
    mm = "time_us,displacement_um\n" + "".join(f"{10 * k},{1e3 * k * k}\n" for k in range(40))
    assert any("displacements lie above" in w for w in with_scale(read_experiment(folder(tmp_path / "c", mm))).warnings)


# --- scatter -------------------------------------------------------------------------------------------------------


def memory(tau: float, times: FloatArray) -> FloatArray:
    return np.exp(-np.diff(times, prepend=-np.inf) / tau)


def test_a_wide_tail_is_an_ornstein_uhlenbeck_process() -> None:
    """At irregular times, and with a width that follows the prediction."""
    rng = np.random.default_rng(1)
    times = np.sort(rng.uniform(0, 100, 12))
    predicted, observed = rng.normal(0, 3, (1, 12)), rng.normal(0, 3, 12)
    observed = predicted[0] + 0.2 * observed
    values = np.stack([*(np.full(12, x) for x in (0.1, 0.5, 1e7)), memory(20.0, times)])[None]
    width = np.sqrt((0.1 * predicted[0]) ** 2 + 0.25)
    covariance = np.outer(width, width) * np.exp(-np.abs(times[:, None] - times) / 20.0)
    exact = multivariate_normal(predicted[0], covariance).logpdf(observed)
    assert noise.log_density(observed, predicted, values, None).sum() == pytest.approx(exact, rel=1e-5)
    root = np.linalg.cholesky(np.exp(-np.abs(times[:, None] - times) / 20.0))
    white = rng.standard_normal((1, 12))
    assert noise.correlated(white, values)[0] == pytest.approx(root @ white[0])
    assert noise.whitened(noise.correlated(white, values), values) == pytest.approx(white)


def test_draws_are_correlated_and_their_innovations_are_not() -> None:
    rng, n = np.random.default_rng(2), 400
    times = np.cumsum(rng.uniform(0.5, 1.5, n))
    values = np.stack([*(np.full(n, x) for x in (0.0, 1.0, 8.0)), memory(5.0, times)])[None]
    exact = np.zeros((200, n))
    drawn = noise.draw(exact, np.repeat(values, 200, axis=0), None, rng)
    lag = np.mean(drawn[:, 1:] * drawn[:, :-1]) / np.mean(drawn**2)
    assert lag == pytest.approx(np.exp(-1 / 5.0), abs=0.02)
    z = noise.innovations(drawn, exact, values, None)
    assert abs(np.mean(z[:, 1:] * z[:, :-1])) < 0.02 * np.mean(z**2)
    p = noise.cumulative(drawn, exact, values, None)
    assert np.quantile(p, [0.1, 0.5, 0.9]) == pytest.approx([0.1, 0.5, 0.9], abs=0.01)


def made(kinds: tuple[int, ...], n: int = 60, seed: int = 1, ranges: int = 0) -> Problem:
    """Traces of one launch, and some launch ranges, with scatter, at the prior's median of everything."""
    plan = [g for g in traced(np.linspace(0, 500, n)) if g.id in kinds]
    if ranges:
        f = np.geomspace(300, 6000, ranges)
        plan.append(Conditions(0, Drive("sine"), "0.csv", f, np.full(ranges, 20.0)))
    from psafit.experiment import Plan

    blank = Plan(STUDY, tuple(plan), ()).with_readings(np.ones(sum(g.n_points for g in plan)), "made")
    problem = Problem(blank, blank.ids)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    rng = np.random.default_rng(seed)
    drawn = noise.draw(problem.predict(u), problem.noise_values(u), None, rng)[0]
    experiment = blank.with_readings(np.maximum(drawn, problem.floor))
    return Problem(experiment, experiment.ids)


@pytest.mark.filterwarnings("error")
def test_a_correlation_time_beyond_its_bounds_is_no_scatter() -> None:
    problem = made((TRACES[0],))
    u = np.repeat(problem.prior_transform(np.full((1, problem.n_dim), 0.5)), 2, axis=0)
    u[0, -1] = problem.bounds[-1, 1] + 50.0  # samples would not scatter at all, given those before
    predicted = problem.predict(u)
    assert log_posteriors(problem, u, predicted, problem.observed).tolist() == [-np.inf, problem.log_posterior(u)[1]]


def test_the_gradient_is_that_of_the_log_posterior() -> None:
    problem = made((4, 5), ranges=8)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.45))
    predicted = problem.predict(u)
    observed = problem.observed[None]
    found, curvature = expansion(problem, u, predicted, slopes(problem, u, predicted, by=1e-5), observed)
    exact = gradient(problem.log_posterior, u[0], problem.bounds)
    assert found[0] == pytest.approx(exact, rel=2e-3, abs=2e-3 * np.abs(exact).max())
    assert (np.linalg.eigvalsh(curvature[0]) > 0).all()


def test_the_curvature_is_what_is_expected() -> None:
    """Squares of the scores, their mean over drawn traces."""
    problem = made((4,), n=40)
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    predicted, rng = problem.predict(u), np.random.default_rng(4)
    slope, many = slopes(problem, u, predicted), 4000
    rows = [np.repeat(a, many, axis=0) for a in (u, predicted, slope)]
    drawn = noise.draw(rows[1], problem.noise_values(rows[0]), None, rng)
    score, curvature = expansion(problem, *rows, drawn)
    prior = problem.prior_slopes(u)
    ours = [i for i, name in enumerate(problem.names) if not name.startswith("nu")]
    spread = np.sqrt(np.diag(curvature.mean(axis=0)))[ours]
    expected = (np.cov(score.T) + np.diag(prior[1][0]))[np.ix_(ours, ours)]
    apart = (curvature.mean(axis=0)[np.ix_(ours, ours)] - expected) / np.outer(spread, spread)
    assert np.abs(apart).max() < 0.15


def test_a_fit_finds_what_a_trace_was_made_with() -> None:
    problem = made((4, 5), n=80, ranges=10)
    best = optimised(problem, problem.prior_transform(np.full((1, problem.n_dim), 0.3)))
    truth = problem.to_sampling(problem.to_physical(problem.prior_transform(np.full((1, problem.n_dim), 0.5))))[0]
    off = (best.modes[0] - truth) / np.sqrt(np.diag(best.covariance[0]))
    assert np.abs(off).max() < 4.0


def test_a_trace_is_predicted_and_scored() -> None:
    problem = made((4,), n=60, ranges=6)
    draws = np.repeat(problem.prior_transform(np.full((1, problem.n_dim), 0.5)), 400, axis=0)
    for prediction in predictive(problem, draws, 1):
        scored = score(prediction)
        assert 0.7 < scored.coverage_90 <= 1.0 and scored.log_rmse < 0.2
        assert not scored.pit_p_value < 0.01 and not scored.drift_p_value < 0.01
        if prediction.group.observable is DISPLACEMENT:
            assert prediction.lower.min() < 0.0  # a trace may lie below rest


def test_the_error_of_a_trace_is_logarithmic_for_large_values_of_either_sign() -> None:
    assert log_ratio(np.array([110.0, -110.0]), np.array([100.0, -100.0]), *DISPLACEMENT.metric) == pytest.approx(
        [np.log(1.1), -np.log(1.1)], abs=1e-4
    )
    assert log_ratio(np.array([0.0, -0.01]), np.array([0.0, 0.01]), *DISPLACEMENT.metric) == pytest.approx(
        [0.0, -0.02 / 0.6], abs=1e-4
    )


def test_sessions_keep_their_columns_with_traces() -> None:
    """A cause with a value a session, where the traces are not the first groups."""
    problem = made((4,), n=20, ranges=5)
    gain = term("session_lean")
    large = replace(problem, terms=(gain,))
    u = large.prior_transform(np.full((2, large.n_dim), 0.5))
    assert np.isfinite(large.predict(u)).all()

"""The posterior density: columns, priors, likelihood, and what is known of a rig."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from rigs import rig
from scipy.stats import laplace

from psafit.errors import InputError
from psafit.experiment import Experiment, Group, read_experiment
from psafit.inference.problem import Problem
from psafit.inference.starts import starts_of
from psafit.observables import LAUNCH_SPEED, OBSERVABLES
from psafit.parameters import Belief, LogNormal, Normal
from psafit.physics import TERMS, terms
from psafit.simulate import simulate

EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")


def test_posterior_is_batched_and_bounded(problem: Problem) -> None:
    rng = np.random.default_rng(0)
    u = problem.prior_transform(rng.uniform(0.05, 0.95, (7, problem.n_dim)))
    together = problem.log_posterior(u)
    assert together == pytest.approx([problem.log_posterior(row[None])[0] for row in u], rel=1e-12)
    assert together == pytest.approx(problem.log_prior(u) + problem.log_likelihood(u))
    outside = u.copy()
    outside[:, 0] = problem.bounds[0, 1] + 1
    assert (problem.log_posterior(outside) == -np.inf).all()
    assert problem.to_sampling(problem.to_physical(u)) == pytest.approx(u)


def test_known_sigma_enters_per_group(known: Experiment) -> None:
    first = known.groups[0]
    with_sigma = Group(1, first.waveform, first.file, first.frequency_hz, first.amplitude_v, first.reading,
                       sigma=np.full(first.n_points, 0.5))  # fmt: skip
    mixed = Experiment("t", "s", known.constants, (with_sigma, known.groups[1]), known.folder, "f")
    sigma = Problem(mixed, (1, 2)).known_sigma
    assert sigma is not None
    assert (sigma[: first.n_points] == 0.5).all() and (sigma[first.n_points :] == 0).all()


@pytest.mark.parametrize(("stated", "usual"), [((1,), None), ((3,), None), ((1, 2), 0.5), ((1, 2, 3), 0.5), ((), None)])
def test_the_usual_uncertainty_is_one_that_most_readings_state(
    known: Experiment, stated: tuple[int, ...], usual: float | None
) -> None:
    """Of groups with 30, 20 and 12 readings."""
    sigma = {1: 0.5, 2: 0.2, 3: 0.9}
    groups = (replace(g, sigma=np.full(g.n_points, sigma[int(g.id)]) if g.id in stated else None) for g in known.groups)
    assert Problem(replace(known, groups=tuple(groups)), (1, 2, 3)).sigma_to_come(0) == usual
    half = replace(known.groups[0], sigma=np.full(30, 0.2))
    twin = replace(known.groups[0], id=4)
    assert Problem(replace(known, groups=(half, twin)), (1, 4)).sigma_to_come(0) is None


def test_what_is_known_of_a_rig_takes_the_place_of_usual_priors(known: Experiment) -> None:
    hertz, loop = LogNormal(4e6, 1.5), Normal(0.1, 0.05)
    reported = replace(
        known, beliefs=(Belief("k_c", hertz, "Hertz"), Belief("hysteresis_strength", loop, "data sheet"))
    )
    problem = Problem(reported, (1, 2), terms(["hysteresis"]))
    usual = Problem(known, (1, 2), terms(["hysteresis"]))
    changed = {p.name: p for p, q in zip(problem.parameters, usual.parameters, strict=True) if p != q}
    assert {name: (p.prior, p.source) for name, p in changed.items()} == {
        "k_c": (hertz, "Hertz"), "hysteresis_strength": (loop, "data sheet"),
    }  # fmt: skip
    assert problem.terms[0].strength is changed["hysteresis_strength"]  # what the diagnosis's screens look at
    middle = problem.to_physical(problem.prior_transform(np.full(problem.n_dim, 0.5)))
    assert middle[problem.names.index("k_c")] == pytest.approx(4e6)
    plain = replace(problem, terms=())
    assert [p for p, q in zip(plain.parameters, Problem(known, (1, 2)).parameters, strict=True) if p != q] == [
        changed["k_c"]
    ]
    with pytest.raises(InputError, match="there is no parameter 'k_cc' to know of; did you mean k_c"):
        Problem(replace(known, beliefs=(Belief("k_cc", hertz, "x"),)), (1,))
    for name, said in (("reading_gain_z", "what each session has by reading_gain; state the prior of its spread"),):
        with pytest.raises(InputError, match=said):
            Problem(replace(known, beliefs=(Belief(name, hertz, "x"),)), (1,))
    for name, prior, words in (
        ("k_c", Normal(1e6, 1e5), "it is given by median and factor"),
        ("k_c", LogNormal(1.0, 2.0), "it has its middle within 1000 to 1e.09 N/m"),
        ("k_c", LogNormal(1e6, 1.001), "it has a factor from 1.002"),
    ):
        with pytest.raises(InputError, match=words):
            Problem(replace(known, beliefs=(Belief(name, prior, "x"),)), (1,))


def test_what_is_known_of_the_scatter_takes_the_place_of_its_usual_prior(known: Experiment) -> None:
    """In fits, where they start, and for what was not read yet."""
    speed = OBSERVABLES.index(LAUNCH_SPEED)
    camera, laser = Belief("sigma_rel", LogNormal(0.03, 1.2), "x"), Belief("nu_launch_speed", LogNormal(30.0, 1.2), "y")
    problem, usual = Problem(replace(known, beliefs=(camera, laser)), (1, 2)), Problem(known, (1, 2))
    assert [p.name for p, q in zip(problem.scatter, usual.scatter, strict=True) if p != q] == ["sigma_rel"]
    assert problem.scatter[0].prior == camera.prior and problem.scatter[0].source == "x"
    u = starts_of(problem, 1, 8, 64)[0]
    assert np.ptp(problem.scatter[0].to_physical(u[:, problem.n_model])) < 0.06
    u = problem.medians[None]
    assert problem.scatter_to_come(u, 0)[0, 0] == pytest.approx(0.03)
    assert problem.scatter_to_come(u, speed)[0] == pytest.approx([*usual.scatter_to_come(u, speed)[0, :2], 30.0])
    held = replace(problem, usual_tails=True)
    assert held.scatter[0].prior == camera.prior and held.scatter[2].bounds.lower > problem.scatter[2].bounds.lower
    with pytest.raises(InputError, match="sigma_rel is of the model itself, which is always at work"):
        Problem(replace(known, beliefs=(replace(camera, probability=0.5),)), (1,))


def test_no_reading_is_predicted_below_zero(known: Experiment) -> None:
    """A leaning ball's range counts from its rest; below -0.3 um it would have no logarithm in the error metric."""
    leaning = Problem(known, (1, 2, 3), terms(["preload", "gap"]))
    u = leaning.prior_transform(np.random.default_rng(1).uniform(0.05, 0.95, (200, leaning.n_dim)))
    swings = simulate(leaning.design, leaning.to_physical(u)[:, : leaning.n_physical], leaning.terms).launch_range * 1e6
    assert np.array_equal(leaning.predict(u), np.maximum(swings, 0.0))


@dataclass(frozen=True)
class Laplace:
    """A prior as a plug-in may bring it, exponential to both sides of a median."""

    median: float
    coordinate: str = "log"

    def log_density(self, u, lower, upper):
        mass = 1 - 0.5 * np.exp(lower - np.log(self.median)) - 0.5 * np.exp(np.log(self.median) - upper)
        return -np.abs(u - np.log(self.median)) - np.log(2 * mass)

    def quantile(self, p, lower, upper):
        return np.clip(laplace.ppf(p, np.log(self.median)), lower, upper)

    def describe(self):
        return "exponential to both sides"


def test_log_prior_is_the_sum_of_the_parameters_own():
    """Over the whole prior range, beyond the bounds, and for a prior of another kind."""

    class Odd(Problem):
        @cached_property
        def parameters(self):
            first, *others = super().parameters
            return (replace(first, prior=Laplace(first.prior.median)), *others)

    for one in (Problem(EXPERIMENT, EXPERIMENT.ids, TERMS), Odd(EXPERIMENT, EXPERIMENT.ids)):
        rng = np.random.default_rng(1)
        u = one.prior_transform(rng.uniform(size=(200, one.n_dim)))
        u[100:] += rng.standard_normal((100, one.n_dim)) * (rng.random((100, one.n_dim)) < 0.1)
        u[0, 0] = np.nan
        with np.errstate(invalid="ignore"):
            each = np.sum([p.log_prior(u[:, i]) for i, p in enumerate(one.parameters)], axis=0)
        assert one.log_prior(u) == pytest.approx(each, rel=1e-12)
        assert np.isfinite(each).any() and not np.isfinite(each).all()
        first, second = one.prior_slopes(u[1:100])
        inside = np.clip(u[1:100], one.bounds[:, 0] + 1e-3, one.bounds[:, 1] - 1e-3)
        for i, p in enumerate(one.parameters):
            low, mid, high = (p.log_prior(inside[:, i] + d) for d in (-1e-3, 0.0, 1e-3))
            bent = np.maximum((2 * mid - low - high) / 1e-6, 0.0)
            assert second[:, i] == pytest.approx(bent, rel=1e-3, abs=1e-3)
            assert first[:, i] == pytest.approx(
                (high - low) / 2e-3 - bent * (u[1:100, i] - inside[:, i]), rel=5e-5, abs=5e-5
            )


def test_columns_are_baseline_causes_sessions_scatter() -> None:
    problem = Problem(rig([], [], 1), (1, 3), terms(["reading_gain", "gap"]))
    assert problem.names == (
        "k_c", "c_s", "c_c", "gap_width", "reading_gain_spread", "reading_gain_z_1", "reading_gain_z_3",
        "sigma_rel", "sigma_abs", "nu",
    )  # fmt: skip
    assert (problem.n_physical, problem.n_dim) == (5, 10)


def test_each_session_reads_with_its_own_gain() -> None:
    experiment = rig([], [], 1)
    problem = Problem(experiment, (1, 3), terms(["reading_gain"]))
    plain = Problem(experiment, (1, 3))
    u = problem.prior_transform(np.full((1, problem.n_dim), 0.5))
    x = problem.to_physical(u)
    x[0, problem.names.index("reading_gain_spread")] = 0.2
    x[0, problem.names.index("reading_gain_z_1")] = 1.0
    x[0, problem.names.index("reading_gain_z_3")] = -2.0
    u = problem.to_sampling(x)
    without = plain.predict(plain.to_sampling(x[:, [0, 1, 2, 6, 7, 8]]))
    ratio = problem.predict(u)[0] / without[0]
    assert ratio[:16] == pytest.approx(np.exp(0.2)) and ratio[16:] == pytest.approx(np.exp(-0.4))
    # A session never seen reads with a gain drawn from the prior, and with the median one where none is drawn.
    many = np.repeat(u, 4000, axis=0)
    unseen = problem.predict(many, [2], np.random.default_rng(3))[:, 0]
    assert np.std(np.log(unseen)) == pytest.approx(0.2, rel=0.05)
    assert np.ptp(problem.predict(many[:5], [2])[:, 0]) == 0

"""Fisher scoring of many optimisations at once, against finite differences and a trusted optimiser."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from psafit.experiment import read_experiment
from psafit.inference.optimiser import expansion, gradient, log_posteriors, maximise, maximise_linearly, slopes
from psafit.inference.polish import polish
from psafit.inference.problem import Problem
from psafit.inference.starts import starts_of
from psafit.physics import terms

EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")


@pytest.fixture(scope="module")
def problem():
    return Problem(EXPERIMENT, (EXPERIMENT.group(1).id,))


@pytest.mark.parametrize("ids", [[], ["amplifier_lag"], ["reading_gain"]])
def test_gradient_is_that_of_the_log_posterior(ids):
    one = Problem(EXPERIMENT, (EXPERIMENT.group(1).id, EXPERIMENT.group(3).id), terms(ids))
    u = one.prior_transform(np.full((1, one.n_dim), 0.45))
    predicted = one.predict(u)
    gradient, curvature = expansion(one, u, predicted, slopes(one, u, predicted), one.observed[None, :])
    h = 1e-5
    both = np.array([one.log_posterior(u + s * h * np.eye(one.n_dim)) for s in (1, -1)])
    # The forward differences of the ranges are good to a thousandth.
    assert gradient[0] == pytest.approx((both[0] - both[1]) / (2 * h), rel=5e-3, abs=0.5)
    assert np.linalg.eigvalsh(curvature[0]).min() > 0


class Jumping:
    """Ranges 10 + 2 u_0, and 5 more on one side of an edge; 10 + 3 u_1 where there is none."""

    n_model, known_sigma = 2, None
    bounds = np.array([[-1.0, 1.0], [-1.0, 1.0]])

    def __init__(self, edge: float, side: int) -> None:
        self.edge, self.side = edge, side

    def predict(self, u):
        jump = 5.0 * (self.side * (u[:, 0] - self.edge) > 0)
        return np.stack([10 + 2 * u[:, 0] + jump, 10 + 3 * u[:, 1]], axis=1)

    def noise_values(self, u):
        return np.tile([0.05, 0.1, 5.0], (len(u), 1))


@pytest.mark.parametrize("edge", [0.0, 4e-4, -4e-4])
@pytest.mark.parametrize("side", [1, -1])
def test_a_jump_is_no_slope(edge, side):
    """Optima lie at the edges of jumps, where a difference across the edge would be 5 um in a thousandth."""
    one, u = Jumping(edge, side), np.zeros((1, 2))
    assert slopes(one, u, one.predict(u))[0] == pytest.approx(np.array([[2.0, 0.0], [0.0, 3.0]]), abs=1e-9)


@pytest.mark.parametrize("side", [1, -1])
def test_where_nothing_can_be_simulated_is_no_slope(side):
    """The other side's is; where both fail, none is known and the other parameters keep theirs."""

    class Failing(Jumping):
        def predict(self, u):
            return np.where(
                self.side * (u[:, :1] - self.edge) > 0, np.nan, np.stack([10 + 2 * u[:, 0], 10 + 3 * u[:, 1]], 1)
            )

    one, u = Failing(4e-4 * side, side), np.zeros((1, 2))
    assert slopes(one, u, one.predict(u))[0] == pytest.approx(np.array([[2.0, 0.0], [0.0, 3.0]]), abs=1e-9)

    class Alone(Jumping):
        def predict(self, u):
            return np.where(np.abs(u[:, :1]) > 1e-6, np.nan, super().predict(u))

    one = Alone(1.0, 1)
    assert slopes(one, u, one.predict(u))[0] == pytest.approx(np.array([[0.0, 0.0], [0.0, 3.0]]), abs=1e-9)


def test_starts_near_what_is_known_keep_causes_together(problem):
    one = replace(problem, terms=terms(["hysteresis", "reading_gain"]))
    assert one.blocks.tolist() == [0, 1, 2, 3, 3, 4, 4, 5, 6, 7]
    assert len(one.blocks) == one.n_dim
    known = one.prior_transform(np.full((1, one.n_dim), 0.3))
    found, n_draws = starts_of(one, 3, 8, 64, known)
    assert n_draws == 64
    at = np.isclose(found, known)[:, : one.n_model]
    assert at.any(axis=1).sum() > 0
    # A cause is wholly there or wholly elsewhere.
    assert (at[:, 3] == at[:, 4]).all()


def test_log_posteriors_are_the_log_posterior_and_minus_infinity_outside(problem):
    u = problem.prior_transform(np.random.default_rng(1).uniform(0.1, 0.9, (5, problem.n_dim)))
    u[3, 0] = problem.bounds[0, 1] + 1
    found = log_posteriors(problem, u, problem.predict(np.clip(u, *problem.bounds.T)), problem.observed)
    assert found == pytest.approx(problem.log_posterior(u))
    assert found[3] == -np.inf


def test_many_optimisations_end_where_a_trusted_optimiser_does(problem):
    starts, _ = starts_of(problem, 3, 12, 512)
    end = maximise(problem, starts)
    _, trusted, _ = polish(problem, end.u[end.best])
    assert end.log_posterior[end.best] == pytest.approx(trusted, abs=0.05)
    assert end.log_posterior.max() == pytest.approx(-201.72, abs=0.05)


def test_an_optimisation_does_not_depend_on_its_company(problem):
    starts, _ = starts_of(problem, 3, 6, 256)
    together = maximise(problem, starts)
    alone = maximise(problem, starts[2:3])
    assert together.log_posterior[2] == pytest.approx(alone.log_posterior[0], abs=1e-6)


def test_each_optimisation_may_have_its_own_readings(problem):
    u = maximise(problem, starts_of(problem, 3, 4, 256)[0]).u[:1]
    # Twice the ranges everywhere want another fit; the first optimisation keeps its own.
    own = np.vstack([problem.observed, 2 * problem.observed])
    end = maximise(problem, np.repeat(u, 2, axis=0), own)
    assert end.u[0] == pytest.approx(u[0], abs=0.05)
    assert np.abs(end.u[1] - u[0]).max() > 0.3


def test_optimisations_that_agree_are_one(problem):
    starts = np.repeat(starts_of(problem, 1, 2, 64)[0], 3, axis=0)
    apart = maximise(problem, starts, schedule=((3, 6), (20, 6)))
    united = maximise(problem, starts, schedule=((3, 6), (20, 6)), unite=True)
    assert len(united.u) <= 2 < len(apart.u)
    assert united.log_posterior[united.best] == pytest.approx(apart.log_posterior[apart.best], abs=1e-9)
    assert united.effort.n_sets < apart.effort.n_sets


def test_survivors_are_the_highest(problem):
    starts, _ = starts_of(problem, 3, 10, 256)
    all_of_them = maximise(problem, starts, schedule=((2, 10),))
    some = maximise(problem, starts, schedule=((2, 3),))
    assert np.sort(some.log_posterior) == pytest.approx(np.sort(all_of_them.log_posterior)[-3:])


def test_expansion_fits_data_made_from_it(problem):
    """A shift small enough for the expansion is found by it, without a simulation."""
    u = maximise(problem, starts_of(problem, 3, 4, 256)[0])
    at, predicted = u.u[u.best], u.predicted[u.best]
    slope = slopes(problem, at[None, :], predicted[None, :])[0] / predicted
    moved = at.copy()
    moved[0] += 0.05
    target = predicted * np.exp((moved - at)[: problem.n_model] @ slope)
    quiet = at.copy()
    quiet[problem.n_model] = problem.bounds[problem.n_model, 0] + 0.7  # little scatter: the data speak
    end = maximise_linearly(problem, quiet[None, :], predicted[None, :], slope, target[None, :])
    assert end.effort.n_sets == 0
    assert end.predicted[0] == pytest.approx(target, rel=2e-3)


def test_frozen_coordinates_stay(problem):
    u = maximise(problem, starts_of(problem, 3, 4, 256)[0])
    at, predicted = u.u[u.best], u.predicted[u.best]
    slope = slopes(problem, at[None, :], predicted[None, :])[0] / predicted
    end = maximise_linearly(problem, at[None, :], predicted[None, :], slope, 1.3 * problem.observed, frozen=[0])
    assert end.u[0, 0] == at[0]
    assert np.abs(end.u[0, 1:] - at[1:]).max() > 1e-3


def test_a_coordinate_at_its_bound_is_held_there():
    # On group 1 nothing speaks for a loss that scales with the force: the optimisation ends at its neutral bound.
    one = Problem(EXPERIMENT, (EXPERIMENT.group(1).id,), terms(["hunt_crossley"]))
    base = replace(one, terms=())
    start = maximise(base, starts_of(base, 3, 4, 256)[0])
    row = one.prior_transform(np.full(one.n_dim, 0.5))
    row[:3], row[4:] = start.u[start.best][:3], start.u[start.best][3:]
    end = maximise(one, row[None, :])
    assert end.u[0, 3] == one.bounds[3, 0]
    assert end.log_posterior[0] >= start.log_posterior.max() - 3.0


def test_gradient_is_one_sided_at_a_bound() -> None:
    slope = gradient(lambda u: np.sqrt(u[:, 0]) + 2 * u[:, 1], np.array([1.0, 0.0]), np.array([[0.0, 1.0], [0.0, 5.0]]))
    assert slope == pytest.approx([0.5, 2.0], rel=1e-3)

"""Evidence against plain Monte Carlo and a nested sampler."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from truths import experiment, problem, rig_with_two_modes

from psafit.errors import ConvergenceError
from psafit.inference.candidate import FitSettings, candidate_at, candidate_of, fit, separate_modes
from psafit.inference.evidence import (
    Emulated,
    ImportanceSample,
    Pool,
    RoundSettings,
    drawn_inside,
    importance_sample,
    laplace_mixture,
    sample_in_rounds,
)
from psafit.inference.hopping import hopped
from psafit.inference.mixture import StudentMixture
from psafit.inference.optimiser import Effort, Optima
from psafit.inference.samplers.nautilus import nested_evidence
from psafit.physics import terms


def test_evidence_is_that_of_plain_monte_carlo():
    """Few, poor readings leave the prior wide enough for the mean likelihood of its draws to be the evidence."""
    e = experiment(n=4, relative=0.3, groups=("a",))
    one = problem(e)
    found = importance_sample(fit(one, (), seed=1, draws=256, most=8), seed=1, effective=400)
    draws = one.prior_transform(np.random.default_rng(0).uniform(size=(200_000, one.n_dim)))
    likelihood = one.log_likelihood(draws)
    plain = logsumexp(likelihood) - math.log(len(draws))
    error = math.sqrt(np.exp(logsumexp(2 * likelihood) - 2 * logsumexp(likelihood)))
    assert found.log_evidence == pytest.approx(plain, abs=4 * math.hypot(error, found.error))
    assert error < 0.06 and found.error < 0.1
    mean = found.weights @ found.draws
    weights = np.exp(likelihood - logsumexp(likelihood))
    other = weights @ draws
    spread = np.sqrt(weights @ (draws - other) ** 2)
    assert (np.abs(mean - other) < 6 * math.hypot(error, found.error) * spread).all()
    assert (np.abs(draws.mean(axis=0) - other) > 0.5 * spread).any()  # not the prior's


@pytest.fixture(scope="module")
def repeating():
    """A fit of readings to which a drive of three or four periods has led."""
    whole = problem(experiment(["repeat_impacts"], [3.4]))
    return fit(replace(whole, terms=terms(["repeat_impacts"])), [fit(whole, (), seed=1)], seed=1)


@pytest.mark.parametrize("place", [*(pytest.param(p, marks=pytest.mark.slow) for p in (2.2, 2.5, 4.9)), 2.4])
def test_evidence_knows_of_a_plateau_wherever_the_optimisation_ended(place, repeating):
    """Above 2.4 periods no reading knows how long the drive lasts, from 2.3 downwards many do."""
    fitted, one = repeating, repeating.problem
    k = one.names.index("repeat_cycles")
    scale = one.parameters[k].scale
    u = fitted.modes[:1].copy()
    u[0, k] = place / scale
    found = importance_sample(
        candidate_of(one, Optima(u, one.log_posterior(u), one.predict(u), np.zeros(1, int), Effort())), seed=1
    )
    # Of the other parameters all places above agree, so that a line gives the share of each.
    line = np.repeat(fitted.modes[:1], 501, axis=0)
    line[:, k] = np.linspace(0, 10, 501) / scale
    log_posterior = one.log_posterior(line)
    mass = np.exp(log_posterior - log_posterior.max())
    expected = np.interp([0.05, 0.5, 0.95], np.cumsum(mass) / mass.sum(), np.linspace(0, 10, 501))
    assert found.effective > 300
    # Three standard errors of a median of so many draws, evenly spread.
    error = 0.5 * (expected[2] - expected[0]) / 0.9 / np.sqrt(found.effective)
    assert found.quantiles(found.draws[:, k] * scale, [0.05, 0.5, 0.95]) == pytest.approx(expected, abs=3 * error)
    assert found.log_evidence == pytest.approx(importance_sample(fitted, seed=2).log_evidence, abs=0.2)


@pytest.mark.filterwarnings("error")
def test_one_draw_far_above_all_others_is_no_width(sound):
    """A first round that misses a narrow posterior but once: the emulator must still say something of other places."""
    mixture, random = laplace_mixture(sound), np.random.default_rng(0)
    u = np.vstack([sound.modes[:1], mixture.draw(256, random).clip(*sound.problem.bounds.T)])
    log_posterior = np.where(np.arange(len(u)) == 0, 0.0, -1e6)
    found = Emulated(sound, Pool(u, log_posterior, log_posterior, len(u)), sound.problem.predict(u), mixture, random)
    draws = found.draw(64, random)
    assert np.isfinite(found.log_density(draws)).sum() > 32
    assert np.ptp(draws, axis=0).min() > 0


def test_draws_go_to_modes_by_what_they_hold(sound):
    """A top three nats higher and a hundred times less wide in all its parameters holds a fifth of the other."""
    n = sound.problem.n_dim
    both = replace(
        sound,
        modes=np.repeat(sound.modes[:1], 2, axis=0),
        log_posteriors=sound.log_posteriors[0] + np.array([3.0, 0.0]),
        curvature=sound.curvature[0] * np.array([100.0 ** (2 / n), 1.0])[:, None, None],
        log_width=np.full((2, n), np.nan),
    )
    narrow, broad = laplace_mixture(both).share
    assert narrow / broad == pytest.approx(math.exp(3.0) / 100.0, rel=0.3)  # the bounds cut the broad one


def test_evidence_of_a_corner():
    """A mode at the bounds of eight parameters: of draws around it one in three hundred lies inside."""
    rate = np.linspace(2, 5, 8)
    bounds, width = np.repeat([[0.0, 1.0]], rate.size, axis=0), np.ones(rate.size)
    first = StudentMixture.of([(np.zeros(rate.size), 0.3**2 * np.eye(rate.size), 1.0)])

    def log_posterior(u):
        return np.sum(np.log(rate) - rate * u, axis=1)

    def adapted(found, last):
        return last.mixture.around(found.u, found.weights, width)

    assert (first.draw(256, np.random.default_rng(3)).min(axis=1) > 0).sum() < 4
    found = sample_in_rounds(
        log_posterior, bounds, first, adapted, np.random.default_rng(3), RoundSettings(effective=1e9)
    ).sample()
    assert found.log_evidence == pytest.approx(np.log1p(-np.exp(-rate)).sum(), abs=0.5)
    assert found.effective > 60
    with pytest.raises(ConvergenceError, match="within the bounds"):
        drawn_inside(first, bounds + 100.0, 256, np.random.default_rng(0))


def test_error_holds_that_of_a_density_whose_norm_is_not_sure():
    bounds, off = np.array([[-30.0, 30.0]] * 2), 0.3

    class Unsure:
        mixture = StudentMixture.of([(np.zeros(2), 1.5 * np.eye(2), 1.0)])
        error = off
        draw = mixture.draw

        def log_density(self, u):
            return self.mixture.log_density(u) + off

    def log_posterior(u):
        return -0.5 * np.sum(u**2, axis=1) - np.log(2 * np.pi)

    how = RoundSettings(draws=256, least=1, most=1)
    found = sample_in_rounds(log_posterior, bounds, Unsure(), lambda p, d: d, np.random.default_rng(3), how).sample()
    assert found.log_evidence == pytest.approx(-off, abs=0.05)
    assert off < found.error < off + 0.05


def test_resampling_keeps_the_weighted_mean(sound):
    found = importance_sample(sound, seed=1)
    assert found.effective > 100
    assert found.pareto_k < 0.7
    assert found.resampled(2000).mean(axis=0) == pytest.approx(found.weights @ found.draws, abs=0.02)


@pytest.mark.slow
def test_two_modes_get_the_weight_that_each_gets_alone_and_that_the_nested_sampler_finds():
    """Seven nats lower and far wider, the second mode holds most of the posterior."""
    pytest.importorskip("nautilus")
    rig, _ = rig_with_two_modes(1)
    plain = fit(rig, (), seed=1, draws=4096, most=48, settings=FitSettings(readings=rig.observed.size))
    top = hopped(candidate_at(rig, plain.modes[:1]), seed=1).modes[:1]
    found = candidate_at(rig, np.vstack([top, plain.modes[1:]]))
    tops = separate_modes(found)
    alone = [importance_sample(candidate_at(rig, found.modes[[k]]), seed=2).log_evidence for k in tops]
    assert found.log_posteriors[tops[1]] < found.log_posterior - 5 and alone[1] > alone[0] + 1
    whole = importance_sample(found, seed=2).log_evidence
    assert whole == pytest.approx(np.logaddexp.reduce(alone), abs=0.3)
    theirs = nested_evidence(rig, seed=2, n_live=300, effective=100, n_networks=1)
    assert whole == pytest.approx(theirs.log_evidence, abs=0.5)


def test_what_the_readings_hardly_determine_is_as_wide_as_its_bounds():
    """A slope of almost nothing is less than the others' rounding, and must not become a width of nothing."""
    one = replace(problem(experiment(n=8)), terms=terms(["separation_height"]))
    fitted = candidate_at(one, one.prior_transform(np.full((1, one.n_dim), 0.5)))
    k = one.names.index("separation_weight")
    curvature = fitted.curvature.copy()
    curvature[0, k], curvature[0, :, k] = 0.0, 0.0
    curvature[0, k, k] = 1e-16 * curvature.max()
    first = laplace_mixture(replace(fitted, curvature=curvature))
    spread = np.sqrt(np.diagonal(first.root[0] @ first.root[0].T))
    assert spread[k] > 0.25 * np.ptp(one.bounds[k])


def test_a_stretched_density_reaches_far_along_each_coordinate():
    """What goes along with a coordinate does so still; what is next to that stays as narrow as it was."""
    covariance = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [0.0, 0.0, 0.01]])
    width = np.array([36.0, 36.0, 12.0])
    one = StudentMixture.of([(np.zeros(3), covariance, 1.0)])
    found = one.stretched(2, width)
    assert found.share == pytest.approx([0.5, 0.25, 0.25])
    assert found.root[0] == pytest.approx(one.root[0])
    for j, root in enumerate(found.root[1:]):
        longer = root @ root.T
        assert math.sqrt(longer[j, j]) == pytest.approx(6.0)
        assert longer[1 - j, j] / longer[j, j] == pytest.approx(0.8)
        assert longer[1 - j, 1 - j] - longer[1 - j, j] ** 2 / longer[j, j] == pytest.approx(0.36)
        assert longer[2, 2] == pytest.approx(0.01)


def test_prior_width_survives_draws_of_hardly_any_weight():
    """Weights far below the rest, where the other prior is far above the first, are not divided by."""
    found = importance_sample(fit(problem(experiment(n=8)), (), seed=1, draws=256, most=4), seed=1)
    weights = np.r_[1e-310, np.full(len(found.weights) - 1, 1 / (len(found.weights) - 1))]
    factor = np.r_[700.0, np.zeros(len(weights) - 1)]
    assert replace(found, weights=weights).mean_of(factor) == pytest.approx(0.0, abs=1e-3)


def test_walkers_begin_at_distinct_places() -> None:
    """Draws that resampling has left several times are one place each: emcee's snooker divides by their distance."""
    rng = np.random.default_rng(0)
    few = rng.standard_normal((40, 3))
    rows = rng.integers(0, 40, 200)
    sample = SimpleNamespace(draws=few[rows], weights=np.full(200, 1 / 200))
    found = ImportanceSample.distinct(sample, 30, rng)  # type: ignore[arg-type]
    assert len(np.unique(found, axis=0)) == 30

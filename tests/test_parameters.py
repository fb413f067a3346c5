"""Priors against SciPy's distributions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

from psafit.inference import noise
from psafit.parameters import Bounds, LogNormal, Mixture, Normal, Parameter, Prior, Tailed, Uniform
from psafit.physics import baseline

DECLARED = baseline.PARAMETERS + noise.PARAMETERS


def parameter(prior: Prior, low: float, high: float) -> Parameter:
    return Parameter("x", "x", "1", Bounds(low, high), prior, "", "")


@pytest.mark.parametrize("p", DECLARED, ids=lambda p: p.name)
def test_declared_priors_integrate_to_one_and_invert(p: Parameter) -> None:
    b = p.sampling_bounds
    mass, _ = integrate.quad(lambda u: np.exp(float(p.log_prior(u))), b.lower, b.upper, epsabs=1e-12, limit=200)
    assert mass == pytest.approx(1, abs=1e-8)
    for q in (0.01, 0.3, 0.9):
        u = float(p.prior_quantile(q))
        below, _ = integrate.quad(lambda v: np.exp(float(p.log_prior(v))), b.lower, u, epsabs=1e-12, limit=200)
        assert below == pytest.approx(q, abs=1e-7)
    assert p.source and p.unit and p.description


def test_log_normal_is_scipys() -> None:
    p = parameter(LogNormal(2.0, 3.0), 0.1, 50.0)
    a, b = (np.log([0.1, 50.0]) - np.log(2)) / np.log(3)
    expected = stats.truncnorm(a, b, loc=np.log(2), scale=np.log(3))
    u = np.linspace(np.log(0.1), np.log(50), 31)
    assert p.log_prior(u) == pytest.approx(expected.logpdf(u), abs=1e-12)
    assert p.prior_quantile([0.2, 0.8]) == pytest.approx(expected.ppf([0.2, 0.8]), rel=1e-12)


def test_half_normal_far_tail_and_uniform() -> None:
    half = parameter(Normal(0.0, 1.0), 0.0, 5.0)
    assert half.log_prior(1.0) == pytest.approx(stats.truncnorm(0, 5).logpdf(1.0))
    tail = parameter(Normal(0.0, 1.0), 8.0, 12.0)
    assert tail.log_prior(9.0) == pytest.approx(stats.truncnorm(8, 12).logpdf(9.0), rel=1e-9)
    flat = parameter(Uniform("log"), 1.0, np.e)
    assert flat.log_prior(0.5) == 0.0
    assert flat.to_physical(flat.prior_quantile(0.5)) == pytest.approx(np.exp(0.5))


TAILED = [
    (Tailed(Normal(0.0, 4e-3)), 0.0, 0.045),
    (Tailed(LogNormal(2.0, 3.0), share=0.2, widening=5.0), 1e-3, 1e6),
    (Tailed(Normal(1.0, 0.05)), 0.0, 1.0),
]


@pytest.mark.parametrize(("prior", "low", "high"), TAILED)
def test_a_prior_with_a_broad_part_is_a_mixture_of_scipys(prior: Tailed, low: float, high: float) -> None:
    p = parameter(prior, low, high)
    (centre, sd), wide = prior.middle, prior.widening * prior.middle[1]
    ends = np.log([low, high]) if prior.coordinate == "log" else np.array([low, high])
    normal = stats.truncnorm(*(ends - centre) / sd, loc=centre, scale=sd)
    cauchy = stats.cauchy(centre, wide)
    mass = np.diff(cauchy.cdf(ends))[0]

    def share(x: np.ndarray) -> np.ndarray:
        part = (cauchy.cdf(x) - cauchy.cdf(ends[0])) / mass
        return (1 - prior.share) * normal.cdf(x) + prior.share * part

    x = np.linspace(*ends, 41)
    density = (1 - prior.share) * normal.pdf(x) + prior.share * cauchy.pdf(x) / mass
    assert p.log_prior(x / p.scale) == pytest.approx(np.log(density * p.scale), rel=1e-10)
    q = np.array([0.0, 1e-6, 0.3, 0.95, 0.999999, 1.0])
    assert share(np.asarray(p.prior_quantile(q)) * p.scale) == pytest.approx(q, abs=1e-14)


def test_what_is_far_from_plausible_costs_a_dozen_nats_and_a_flag() -> None:
    """A bond of 0.25 N where 5 mN is usual."""
    p = replace(parameter(Tailed(Normal(0.0, 5e-3)), 0.0, 1.0), neutral=0.0)
    cost = [float(p.log_prior(0.0) - p.log_prior(p.to_sampling(x))) for x in (0.015, 0.05, 0.25, 1.0)]
    assert 3 < cost[0] < 5 and 5 < cost[1] < cost[2] < 12 and cost[3] < 14
    assert [p.is_implausible(x) for x in (0.0, 5e-3, 0.015, 0.25)] == [False, False, True, True]


def test_a_mixture_holds_each_part_by_its_weight() -> None:
    prior = Mixture(((0.3, LogNormal(0.5, 1.05)), (0.7, LogNormal(2.0, 1.05))))
    p = parameter(prior, 0.1, 10.0)
    assert p.shape is None
    u = np.linspace(*np.log([0.1, 10.0]), 400_001)
    density = np.exp(p.log_prior(u))
    assert np.trapezoid(density, u) == pytest.approx(1.0, rel=1e-6)
    assert np.trapezoid(density[u < 0.0], u[u < 0.0]) == pytest.approx(0.3, rel=1e-4)
    shares = np.array([0.1, 0.29, 0.31, 0.9])
    below = [np.trapezoid(density[u < q], u[u < q]) for q in p.prior_quantile(shares)]
    assert below == pytest.approx(shares, abs=1e-4)
    assert [p.is_implausible(x) for x in (0.5, 1.0, 2.0)] == [False, True, False]
    for parts in ((), ((0.5, Normal(0, 1)), (0.4, Normal(1, 1))), ((0.5, Normal(0, 1)), (0.5, LogNormal(1, 2)))):
        with pytest.raises(ValueError, match="weights sum to one"):
            Mixture(parts)  # type: ignore[arg-type]


def test_outside_bounds_is_impossible() -> None:
    p = baseline.PARAMETERS[0]
    assert p.log_prior(p.to_sampling(p.bounds.upper) + 1e-9) == -np.inf
    assert p.log_prior(np.nan) == -np.inf


def test_bad_declarations_are_refused() -> None:
    with pytest.raises(ValueError, match="lower < upper"):
        Bounds(2.0, 1.0)
    with pytest.raises(ValueError, match="positive lower bound"):
        parameter(LogNormal(1.0, 2.0), 0.0, 1.0)
    with pytest.raises(ValueError, match="identifier"):
        Parameter("k c", "k", "1", Bounds(0, 1), Uniform(), "", "")


def test_one_value_in_twenty_is_implausible() -> None:
    """Where its prior is thinnest: in both tails, or in the one there is."""
    draws = np.linspace(0.0005, 0.9995, 1000)
    both = parameter(LogNormal(2.0, 3.0), 1e-4, 1e5)
    one = replace(parameter(Normal(0.0, 0.1), 0.0, 0.5), neutral=0.0)
    for p in (both, one):
        values = p.to_physical(p.prior_quantile(draws))
        assert np.mean([p.is_implausible(x) for x in values]) == pytest.approx(0.05, abs=0.003)
        assert [p.prior_share(float(x)) for x in values[::99]] == pytest.approx(draws[::99], abs=2e-3)
    assert not one.is_implausible(0.0) and one.is_implausible(0.5) and both.is_implausible(1e-4)
    off = replace(parameter(Normal(2.0, 0.7), 0.0, 10.0), neutral=0.0)
    assert [off.is_implausible(x) for x in (0.05, 0.7, 2.0, 3.0, 3.5)] == [True, False, False, False, True]
    most = replace(parameter(Normal(1.0, 0.1), 0.05, 1.0), neutral=1.0)
    assert [most.is_implausible(x) for x in (1.0, 0.9995, 0.9, 0.7, 0.3)] == [False, False, False, True, True]
    flat = parameter(Uniform(), 0.0, 1.0)
    assert not flat.is_implausible(0.5) and not flat.is_implausible(1.0)


def test_linear_coordinates_are_in_units_of_the_prior() -> None:
    p = Parameter("tau", "t", "s", Bounds(0.0, 1e-2), Normal(0.0, 1e-4), "", "", neutral=0.0)
    assert p.to_sampling(2e-4) == pytest.approx(2.0)
    assert p.to_physical(p.sampling_bounds.upper) == 1e-2
    u = np.linspace(0, 100, 200_001)
    assert np.trapezoid(np.exp(p.log_prior(u)), u) == pytest.approx(1.0, rel=1e-6)

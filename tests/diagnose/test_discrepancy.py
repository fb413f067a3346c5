"""The discrepancy."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigs import RIG
from truths import bump, experiment, problem

from psafit.diagnose.discrepancy import Discrepancy, Expansion, _remembered, discrepancy, stretch
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import terms
from psafit.simulate import Design


def test_a_reading_without_a_drive_does_not_turn_a_sweep_round():
    """A control at 0 V, of which nothing is launched."""
    e = experiment(spoil=bump, seed=3, groups=("a",))
    (g,) = e.groups
    extra = {"frequency_hz": 1000.0, "amplitude_v": 0.0, "reading": 0.0, "measured": 0, "row": g.n_points}
    more = replace(g, **{name: np.append(getattr(g, name), x) for name, x in extra.items()})
    assert more.swept == g.swept == "frequency"
    design = Design.of(RIG, [more])
    assert np.ptp(design.along("amplitude")) == 0.0
    assert np.exp(design.along("frequency")) == pytest.approx(design.frequency)
    assert np.isfinite(Design.sweep(RIG, "sine", 1e3, 0.0).along("amplitude")).all()
    found = [fit(Problem(replace(e, groups=(one,)), ("a",)), (), seed=1, draws=512, most=8) for one in (g, more)]
    a, b = (discrepancy(one).log_bayes for one in found)
    assert a > 3 and b == pytest.approx(a, abs=2)


def test_a_discrepancy_is_that_of_dense_matrices(sound):
    """By groups and with the parameters as least squares, against the readings' covariance as it is written."""
    around = Expansion.of(sound, 1 + 0.1 * np.arange(sound.problem.observed.size))
    group = sound.problem.design.group
    x = sound.problem.design.along("frequency").copy()
    x[group == 1] = sound.problem.design.along("amplitude")[group == 1]
    rng = np.random.default_rng(1)
    for _ in range(5):
        v = np.r_[rng.normal(-3, 1, 2), rng.normal(-1.5, 1, 2), rng.normal(-0.3, 0.5)]
        relative, absolute = around.scatter_at(v)
        a, b, reach = np.exp(v[2:])
        p = around.predicted
        noise = np.diag(around.stretch * ((relative * p) ** 2 + absolute**2))
        smooth = a**2 * np.exp(-0.5 * (x[:, None] - x) ** 2 / reach**2) + b**2
        kernel = np.where(group[:, None] == group, smooth, 0.0) * np.outer(p, p)
        whole = noise + kernel + around.free @ around.free.T
        found = around.whitened(v)
        assert found.squares == pytest.approx(around.residual @ np.linalg.solve(whole, around.residual), rel=1e-6)
        assert 2 * found.log_size == pytest.approx(np.linalg.slogdet(whole)[1], abs=1e-6)
        mean, variance = around.discrepancy(v)
        assert mean == pytest.approx(kernel @ np.linalg.solve(whole, around.residual), rel=1e-5, abs=1e-7 * p.max())
        left = np.diag(kernel - kernel @ np.linalg.solve(whole, kernel))
        assert variance == pytest.approx(left, rel=1e-4, abs=1e-8 * np.diag(kernel).max())


@pytest.mark.slow
@pytest.mark.parametrize("ids", [(), ("flight_friction",)])
def test_the_best_mode_of_a_discrepancy_is_found(ids):
    """Its scatter may be most of the misfit or hardly any: optimisations from many random places find none higher."""
    one = replace(problem(experiment(["hysteresis"], [0.5, 20.0], relative=0.03, seed=4)), terms=terms(ids))
    candidate = fit(one, [fit(problem(one.experiment), (), seed=1)] if ids else (), seed=1)
    found = discrepancy(candidate)
    around = Expansion.of(candidate, stretch(candidate))
    rng = np.random.default_rng(2)
    ends = [
        around.fitted(np.r_[rng.uniform(-6, 0, 2), rng.uniform(-4, 0.7, 2), rng.normal(-0.3, 0.6)], with_it=True)
        for _ in range(24)
    ]
    assert found.log_evidence > max(end.log_evidence for end in ends) + around.placed - 0.1


def test_a_session_not_seen_may_err_as_the_prior_says():
    """The level of a session is unknown when one was seen; three that agree say that it is small."""
    rng = np.random.default_rng(1)
    spreads = []
    for groups in (("a",), ("a", "b", "c")):
        e = experiment(groups=groups)
        candidate = fit(Problem(e, groups), (), seed=1, draws=256, most=8)
        spreads.append(np.median(discrepancy(candidate).elsewhere(np.full((2000, 1), 0.04), np.zeros(1, np.int8), rng)))
    assert 0.03 < spreads[0] < 0.3
    assert spreads[1] < 0.7 * spreads[0]


def test_only_the_scatter_of_what_was_fitted_stood_for_a_discrepancy():
    """That of contact times, half a per cent, says nothing of what launch ranges lacked, nor the other way round."""
    found = Discrepancy(0, 0, 0.1, 0.1, 0.7, {0: 0.01}, np.zeros(1), np.ones(1), np.full(5, -9.0), 1e-12 * np.eye(5))
    ranges, times = (
        found.elsewhere(np.full((3, 2), sigma), np.full(2, k, np.int8), np.random.default_rng(1))
        for sigma, k in ((0.006, 0), (0.005, 2))
    )
    assert ranges == pytest.approx(0.008, rel=1e-3) and (times < 2e-4).all()


def test_samples_far_apart_have_errors_of_their_own(sound):
    """So far that the correlation underflows; those before are as far from all of them."""
    noise = np.full((1, 4, 5), 0.05)
    noise[0, 3] = [np.nan, 0.5, 0.0, 0.5, 0.25]
    design = replace(sound.problem.design, time=np.zeros(sound.problem.design.n_points))
    traced = SimpleNamespace(noise=noise, problem=SimpleNamespace(design=design))
    correlation = _remembered(traced, np.arange(5))
    assert np.isfinite(np.linalg.cholesky(correlation)).all()
    assert correlation[0] == pytest.approx([1.0, 0.5, 0.0, 0.0, 0.0])
    assert correlation[2, 3:] == pytest.approx([0.5, 0.125])


def test_readings_that_say_nothing_do_not_dilute_a_discrepancy(sound):
    n = sound.problem.observed.size
    mean, sd = np.full(n, 0.5), np.full(n, 0.1)
    quiet = sound.problem.design.group == 1
    quiet[:20] = True
    mean[quiet], sd[quiet] = 0.0, np.inf
    found = Discrepancy(0.0, 0.0, 0.1, 0.1, 0.7, {0: 0.04}, mean, sd, np.zeros(5), np.eye(5)).largest(sound)
    assert [(g, read) for g, read, *_ in found] == [("a", None), ("b", None), ("c", None)]
    assert np.array_equal(
        [reported for _, _, *reported in found], [[0.5, 0.5], [np.nan, np.nan], [0.5, 0.5]], equal_nan=True
    )

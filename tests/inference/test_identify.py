"""What the data determine: profiles, limits and verdicts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.optimize
from rigs import TRUTH

from psafit.experiment import Experiment, Group, read_experiment
from psafit.inference import identify, noise
from psafit.inference.optimiser import Optima, maximise
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.physics import terms
from psafit.records import ProfilePoint
from psafit.text import resolved


def test_profile_of_a_determined_and_an_open_parameter(finished: Run) -> None:
    by_name = {p.name: p for p in finished.summary.parameters}
    k_c = by_name["k_c"]
    assert k_c.verdict == "determined" and "k_c = " in k_c.text
    drops = np.array([p.drop for p in k_c.profile])
    assert np.abs(np.diff(drops[drops < 2.5])).max() < 0.36, "smooth to the eye"
    low, high = identify.limits(k_c.profile)
    assert low is not None and high is not None and low < TRUTH[0] * 1.6 and high > TRUTH[0] / 1.6
    assert low == pytest.approx(k_c.lower, rel=0.25) and high == pytest.approx(k_c.upper, rel=0.25)
    # With one reading only, nothing is determined.
    one = finished.problem.experiment.groups[0]
    lone = Group(1, one.waveform, "x", one.frequency_hz[:1], one.amplitude_v[:1], one.reading[:1])
    poor = Problem(Experiment("t", "s", finished.problem.experiment.constants, (lone,), Path(), "f"), (1,))
    top = poor.prior_transform(np.full(poor.n_dim, 0.5))
    assert identify.verdict(identify.profiles(poor, top, columns=[1])[0]) != "determined"


def test_a_spread_of_sessions_has_no_profile(finished: Run) -> None:
    """The wider it is, the less improbable are the sessions' values in units of it: no point is the highest."""
    problem = replace(finished.problem, terms=terms(["reading_gain", "session_lean"]))
    own = [p.name for t in problem.terms for p in t.parameters]
    at = [problem.names.index(name) for name in ("k_c", *own)]
    stiffness, *others = identify.profiles(problem, problem.medians, columns=at)
    assert len(stiffness) > 3 and others == [[]] * len(own) and len(own) == 3


@pytest.mark.slow
def test_profile_is_what_another_optimiser_finds(finished: Run) -> None:
    problem = finished.problem
    top = problem.to_sampling(np.array(list(finished.fit.minima[0].values.values())))
    for index, points in enumerate(identify.profiles(problem, top)):
        free = np.arange(problem.n_dim) != index
        low, high = problem.bounds[free].T

        def depth(others: np.ndarray, at: np.ndarray, free: np.ndarray = free) -> float:
            at = at.copy()
            at[free] = others
            return -float(problem.log_likelihood(at[None])[0])

        log_posteriors = []
        near = [p for p in points if p.drop < 4.0]
        for point in near[:: max(len(near) // 4, 1)]:
            at = top.copy()
            at[index] = problem.parameters[index].to_sampling(point.value)
            found = scipy.optimize.minimize(
                depth, np.clip(top[free], low, high), (at,), "Nelder-Mead", bounds=list(zip(low, high, strict=True)),
                options={"maxfev": 2000, "fatol": 1e-4, "xatol": 1e-4},
            )  # fmt: skip
            log_posteriors.append(-found.fun + point.drop)
        # Every point lies as far below one and the same top.
        assert np.ptp(log_posteriors) < 0.05, (problem.names[index], log_posteriors)


def test_a_profile_does_not_lean_on_what_a_cause_cannot_be() -> None:
    """With flat priors for all, c_c = 180 N s/m came out best, next to a friction of thirty times its prior's width."""
    problem = Problem(read_experiment("experiments/psa"), (1,), terms(["flight_friction"]))
    near = {
        "k_c": 5.1e6,
        "c_s": 1.0e5,
        "c_c": 26.0,
        "flight_friction_a": 0.0185,
        "sigma_rel": 0.019,
        "sigma_abs": 1.94,
        "nu": 16,
    }
    top = problem.to_sampling(np.array([near[name] for name in problem.names]))
    limit = identify.limits(identify.profiles(problem, top, columns=[2])[0])[1]
    assert limit is not None and limit < 60


def test_a_refit_that_ends_early_leaves_no_dip(finished: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """One refit in five ends 10 nats too low: limits were those of the nearest, or of one that closed a side."""
    problem = finished.problem
    top = problem.to_sampling(np.array(list(finished.fit.minima[0].values.values())))
    (right,) = identify.profiles(problem, top, columns=[1])

    def early(*args: Any, **options: Any) -> Optima:
        end = maximise(*args, **options)
        low = 10.0 * (rng.random(len(end.u)) < (0.2 if "frozen" in options else 0.0))
        return replace(end, log_posterior=end.log_posterior - low)

    monkeypatch.setattr(identify, "maximise", early)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        (found,) = identify.profiles(problem, top, columns=[1])
        assert identify.limits(found) == pytest.approx(identify.limits(right), rel=0.1), seed


def test_words_for_each_verdict() -> None:
    def points(*pairs: tuple[float, float]) -> list[ProfilePoint]:
        return [ProfilePoint(*p) for p in pairs]

    closed = points((1, 4), (2, 0), (3, 4))
    above, below, flat = points((1, 0), (2, 0.1), (3, 4)), points((1, 4), (2, 0.1), (3, 0)), points((1, 0), (3, 0.2))
    assert [identify.verdict(p) for p in (closed, above, below, flat)] == [
        "determined", "bounded above", "bounded below", "not determined",
    ]  # fmt: skip
    assert identify.limits(closed)[0] == pytest.approx(2 - 1.353 / 4)
    assert identify.describe("c_c", "N s/m", 5.0, (1.0, 9.0), above, "bounded above").startswith(
        "c_c at most 2.3 N s/m"
    )
    assert "at most 2.3 N s/m (95 %)" in identify.describe("c_c", "N s/m", 5.0, (1.0, 9.0), above, "bounded above")
    assert "at least 1.7 (95 %)" in identify.describe("c_c", "1", 5.0, (1.0, 9.0), below, "bounded below")
    near = [replace(p, value=1.0 + 0.01 * p.value) for p in above]  # an exponent whose neutral value is 1
    assert "at most 1.023 (95 %)" in identify.describe("n", "1", 1.02, (1.003, 1.043), near, "bounded above")
    said = identify.profiled("N/m", above, (1.0, 9.0), "bounded above")
    assert said.endswith("by the profile likelihood; by the posterior, with its priors: 1 to 9 N/m (90 %)")
    plain = ((above, "determined"), (flat, "not determined"), ([], "bounded above"))
    assert not any(identify.profiled("1", points, (1.0, 9.0), word) for points, word in plain)
    lag = identify.describe("lag", "s", 9.3e-5, (6.9e-5, 1.32e-4), [], "determined")
    assert lag == "lag = 93 us (90 %: 69 to 132)"
    assert "at most 230 um (95 %)" in identify.describe(
        "gap", "m", 5e-4, (1e-4, 5e-3), [replace(p, value=0.0001 * p.value) for p in above], "bounded above"
    )
    assert identify.describe("c_c", "1", 5.0, (1.0, 9.0), flat, "not determined").endswith("of its profile closes")
    assert identify.describe("nu", "1", 5.0, (1.0, 9.0), [], "not determined").endswith("narrower than the prior's")
    assert resolved(142537.0, 812.0) == "1.4254e5"
    assert resolved(3219876.0, 526000.0) == "3.22e6"
    assert resolved(99999.0, 99999.0) == "1.0e5"
    assert resolved(0.2523, 0.05) == "0.252"


@pytest.mark.parametrize(
    ("name", "likelihood", "word"),
    [
        ("nu", lambda x: x > 60, "bounded below"),  # piled up at its bound
        ("nu", lambda x: np.exp(-0.5 * ((np.log(x) - 2.3) / 0.2) ** 2), "determined"),
        ("sigma_abs", lambda x: x < 0.02, "bounded above"),  # the prior alone keeps it from its lower bound
        ("sigma_rel", lambda x: np.exp(-0.5 * ((np.log(x) + 0.5) / 0.1) ** 2), "determined"),  # far beyond the prior
        ("sigma_rel", lambda x: np.exp(-0.5 * ((np.log(x) - np.log(2.0)) / 0.2) ** 2), "bounded below"),
        ("sigma_abs", lambda x: np.ones_like(x), "not determined"),
    ],
)
def test_what_has_no_profile_is_judged_by_what_the_readings_say(name, likelihood, word) -> None:  # type: ignore[no-untyped-def]
    parameter = next(p for p in noise.PARAMETERS if p.name == name)
    rng = np.random.default_rng(5)
    prior = parameter.prior_quantile(rng.uniform(size=200_000))
    x = np.linspace(*vars(parameter.sampling_bounds).values(), 20001)
    density = np.exp(parameter.log_prior(x)) * likelihood(parameter.to_physical(x))
    draws = np.interp(rng.uniform(size=4000), np.cumsum(density) / density.sum(), x)
    contraction = float(1 - np.var(draws) / np.var(prior))
    assert identify.verdict_of_draws(draws, parameter, contraction) == word
    if word == "bounded below":
        low, high = parameter.to_physical(np.quantile(draws, [0.05, 0.95]))
        text = identify.describe(name, "1", 0.5 * (low + high), (low, high), [], word)
        assert text == f"{name} at least {resolved(low, low)} (95 %); these readings give no upper limit"

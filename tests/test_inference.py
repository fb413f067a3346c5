"""Fit, sampler, identifiability and storage on data whose truth is known."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import emcee
import h5py
import numpy as np
import pytest
import scipy.optimize
from conftest import TRUTH, measure
from scipy import stats
from scipy.signal import lfilter

from psafit.errors import ConvergenceError, InputError
from psafit.experiment import Experiment, Group, read_experiment
from psafit.inference import emcee_adaptor, identify, noise, store
from psafit.inference import optimise as searching
from psafit.inference import run as running
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.optimise import Minimum, Optimum, hessian, laplace_covariance, optimise
from psafit.inference.problem import Problem
from psafit.parameters import Belief, LogNormal, Normal
from psafit.physics import terms
from psafit.records import Fit, ProfilePoint, read_json, write_json
from psafit.simulate import simulate

QUICK = Settings(n_walkers=24, r_hat=1.03, max_steps=6000)
SHORT = Settings(n_walkers=16, chunk=40, max_steps=80)


@pytest.fixture(scope="module")
def problem(known: Experiment) -> Problem:
    return Problem(known, (1, 2))


@pytest.fixture(scope="module")
def finished(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> running.Run:
    folder = tmp_path_factory.mktemp("run") / "r"
    return running.fit(known, [1, 2], folder, seed=4, n_starts=12, settings=QUICK)


def test_noise_density_is_students(problem: Problem) -> None:
    observed, predicted = np.array([3.0, 0.0, 50.0]), np.array([[2.5, 0.01, 60.0]])
    values, known = np.array([[0.1, 0.05, 4.0]]), np.array([0.0, 0.02, 3.0])
    s = np.sqrt(0.05**2 + (0.1 * predicted) ** 2 + known**2)
    assert noise.log_density(observed, predicted, values, known) == pytest.approx(
        stats.t.logpdf(observed, 4, predicted, s), rel=1e-12
    )
    assert noise.cumulative(observed, predicted, values, known) == pytest.approx(
        stats.t.cdf(observed, 4, predicted, s), rel=1e-12
    )


def test_noise_draws_follow_the_density() -> None:
    rng = np.random.default_rng(1)
    predicted = np.full((20_000, 1), 5.0)
    values = np.tile([0.1, 0.2, 5.0], (20_000, 1))
    draws = noise.draw(predicted, values, None, rng)
    s = np.hypot(0.2, 0.5)
    assert stats.kstest(draws[:, 0], stats.t(5, 5.0, s).cdf).pvalue > 1e-4


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
    with_sigma = Group(1, first.waveform, first.file, first.frequency_hz, first.amplitude_v, first.launch_range_um,
                       sigma_um=np.full(first.n_points, 0.5))  # fmt: skip
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
    groups = (
        replace(g, sigma_um=np.full(g.n_points, sigma[int(g.id)]) if g.id in stated else None) for g in known.groups
    )
    assert Problem(replace(known, groups=tuple(groups)), (1, 2, 3)).usual_sigma == usual
    half = replace(known.groups[0], sigma_um=np.full(30, 0.2))
    twin = replace(known.groups[0], id=4)
    assert Problem(replace(known, groups=(half, twin)), (1, 4)).usual_sigma is None


def test_what_is_known_of_a_rig_takes_the_place_of_usual_priors(known: Experiment) -> None:
    hertz, loop = LogNormal(4e6, 1.5), Normal(0.1, 0.05)
    told = replace(known, beliefs=(Belief("k_c", hertz, "Hertz"), Belief("hysteresis_strength", loop, "data sheet")))
    problem = Problem(told, (1, 2), terms(["hysteresis"]))
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
    for name, prior, words in (
        ("k_c", Normal(1e6, 1e5), "it is given by median and factor"),
        ("k_c", LogNormal(1.0, 2.0), "it has its middle within 1000 to 1e.09 N/m"),
        ("k_c", LogNormal(1e6, 1.001), "it has a factor from 1.002"),
    ):
        with pytest.raises(InputError, match=words):
            Problem(replace(known, beliefs=(Belief(name, prior, "x"),)), (1,))


def test_no_reading_is_predicted_below_zero(known: Experiment) -> None:
    """A leaning ball may swing to behind its rest; ranges below -0.3 um would have no logarithm in the error metric."""
    leaning = Problem(known, (1, 2, 3), terms(["preload", "gap"]))
    u = leaning.prior_transform(np.random.default_rng(1).uniform(0.05, 0.95, (200, leaning.n_dim)))
    swings = simulate(leaning.design, leaning.to_physical(u)[:, : leaning.n_physical], leaning.terms).launch_range * 1e6
    assert (swings < -0.3).any()
    assert np.array_equal(leaning.predict(u), np.maximum(swings, 0.0))


def test_groups_held_out_have_no_part_in_a_fit(known: Experiment, tmp_path: Path) -> None:
    """Search, draws and what is called determined are the same, whatever the other groups read."""
    others = (replace(g, launch_range_um=3 * g.launch_range_um) for g in known.groups[1:])
    changed = replace(known, groups=(known.groups[0], *others))
    one, two = (
        running.fit(data, [1], tmp_path / name, seed=1, n_starts=3, settings=SHORT)
        for name, data in (("as-read", known), ("changed", changed))
    )
    assert one.fit.minima == two.fit.minima and one.fit.lmfit_report == two.fit.lmfit_report
    assert (one.draws.values == two.draws.values).all()
    assert one.summary.parameters == two.summary.parameters


def test_curvature_of_a_known_function() -> None:
    matrix = np.array([[2.0, 0.3, 0.0], [0.3, 1.0, -0.2], [0.0, -0.2, 4.0]])
    found = hessian(lambda u: 0.5 * np.einsum("ni,ij,nj->n", u, matrix, u), np.array([0.3, -1.0, 2.0]))
    assert found == pytest.approx(matrix, abs=1e-6)


def test_search_finds_the_truth_from_any_seed(problem: Problem) -> None:
    for seed in (1, 2):
        optimum = optimise(problem, seed=seed, n_starts=12)
        assert optimum.best.values[:3] == pytest.approx(TRUTH, rel=0.35)
        assert sum(m.starts for m in optimum.minima) <= 12 and optimum.best.starts >= 1
        covariance = laplace_covariance(problem, problem.to_sampling(optimum.best.values))
        assert (np.linalg.eigvalsh(covariance) > 0).all()
    assert "ln_k_c" in optimum.report


def test_the_report_is_of_the_best_wherever_lmfit_ended(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    best = optimise(problem, seed=1, n_starts=4)
    start = problem.to_sampling(best.best.values) + 0.05
    _, _, result = searching.climb(problem, start)
    monkeypatch.setattr(searching, "climb", lambda problem, start: (start, -np.inf, result))
    found = searching.improve(problem, best, start)
    told = {name: (float(x), float(s)) for name, x, s in re.findall(r"(\w+): +(\S+) \+/- (\S+)", found.report)}
    for i, name in enumerate(problem.names):
        sd = float(np.sqrt(found.covariance[0, i, i]))
        assert told[f"ln_{name}"] == pytest.approx((start[i], sd), rel=1e-6)
        assert told[name] == pytest.approx((np.exp(start[i]), np.exp(start[i]) * sd), rel=1e-6)


def test_a_search_begins_where_it_is_told_to(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    """Places that are known take the place of other starts; beyond the bounds they are at them."""
    best = optimise(problem, seed=1, n_starts=12).best
    begun: list[np.ndarray] = []
    own = searching.ascend
    monkeypatch.setattr(searching, "ascend", lambda p, starts, **k: begun.append(starts) or own(p, starts, **k))
    near = problem.to_sampling(best.values) + 0.3
    beyond = problem.bounds[:, 1] + 1
    found = optimise(problem, seed=5, n_starts=2, known=np.stack([near, beyond, near]))
    assert np.array_equal(begun[0], [near, problem.bounds[:, 1]])
    assert found.best.values == pytest.approx(best.values, rel=0.02)


def _chain(draws: np.ndarray) -> emcee.backends.Backend:
    """A back-end with these draws, (n_steps, n_walkers, n_dim), in it."""
    backend = emcee.backends.Backend()
    backend.reset(*draws.shape[1:])
    backend.chain, backend.log_prob = draws, -0.5 * (draws**2).sum(axis=2)
    backend.accepted, backend.iteration, backend.initialized = np.full(draws.shape[1], len(draws)), len(draws), True
    return backend


def test_a_chain_is_long_enough_when_all_three_say_so() -> None:
    """Length, effective samples and R-hat, each of which can be what is missing."""
    assert Settings() == Settings(32, 250, 50.0, 1000.0, 1.01, 40_000)
    rng = np.random.default_rng(1)
    sound = rng.standard_normal((4000, 32, 2))
    assert emcee_adaptor.chain_of(_chain(sound), Settings()).converged
    slow = lfilter([1.0], [1.0, -0.95], sound[:800], axis=0)  # an autocorrelation time of 39 steps
    short = emcee_adaptor.chain_of(_chain(slow), replace(Settings(), r_hat=2.0, effective_samples=1.0))
    assert not short.converged and short.draws.shape[1] < 50 * short.autocorrelation_time.max()
    few = emcee_adaptor.chain_of(_chain(sound[:, :4]), replace(Settings(n_walkers=4), effective_samples=50_000.0))
    assert not few.converged and few.r_hat.max() < 1.01
    apart = sound + np.arange(32)[:, None] / 31  # walkers that do not mix
    stuck = emcee_adaptor.chain_of(_chain(apart), replace(Settings(), autocorrelation_times=0.0, effective_samples=0.0))
    assert not stuck.converged and stuck.r_hat.max() > 1.01


def test_a_fit_of_many_causes_begins_where_smaller_models_lead(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From three causes on, unless places are known."""

    class Begun(Exception):
        pass

    def begun(*args: object, known: np.ndarray | None, **options: object) -> None:
        raise Begun(0 if known is None else len(known))

    modes = Problem(known, (1,), terms(["gap", "preload", "swing_drag"])).prior_transform(np.full((2, 9), 0.5))
    monkeypatch.setattr(running, "optimise", begun)
    monkeypatch.setattr(running, "built_up", lambda problem, **options: SimpleNamespace(modes=modes))
    chosen = terms(["gap", "preload", "swing_drag"])
    for n, expected in ((2, 0), (3, 2)):
        with pytest.raises(Begun, match=str(expected)):
            running.fit(known, [1], tmp_path / str(n), terms=chosen[:n], n_starts=2, settings=SHORT)
    problem = Problem(known, (1,), chosen)
    place = dict(zip(problem.names, problem.to_physical(modes[:1])[0].tolist(), strict=True))
    with pytest.raises(Begun, match="1"):
        running.fit(known, [1], tmp_path / "k", terms=chosen, n_starts=2, settings=SHORT, known=[place])


def test_a_run_is_told_by_the_places_it_was_given(known: Experiment, tmp_path: Path) -> None:
    names = Problem(known, (1,)).names
    place = dict(zip(names, [*TRUTH, 0.05, 0.05, 6.0], strict=True))
    fitted = running.fit(known, [1], tmp_path / "r", n_starts=2, known=[place], settings=SHORT)
    assert fitted.fit.known == [place] and running.load(fitted.folder).fit.known == [place]
    place["k_c"] = int(place["k_c"])  # a whole number is no other place
    assert running.fit(known, [1], fitted.folder, n_starts=2, known=[place], settings=SHORT).fit.known == [place]
    for wrong, words in (({"k_d": 1.0}, "k_d"), ({"k_c": np.nan}, "k_c = nan"), ({"c_s": -1.0}, "c_s = -1")):
        with pytest.raises(InputError, match=words):
            running.fit(known, [1], tmp_path / "w", n_starts=2, known=[place | wrong], settings=SHORT)
    assert not (tmp_path / "w").exists()
    for other in ([], [place | {"k_c": 2e6}]):
        with pytest.raises(InputError, match="what differs: known places"):
            running.fit(known, [1], fitted.folder, n_starts=2, known=other, settings=SHORT)


def test_a_chain_begins_on_a_bent_ridge(known: Experiment, tmp_path: Path) -> None:
    """Draws from the curvature at the top lie far below a ridge that bends; simulated ones of the emulated do not."""
    bent = Problem(known, (1,), terms(["slew_limit", "soft_layer", "flight_friction"]))
    optimum = optimise(bent, seed=1, n_starts=8)
    settings = Settings(n_walkers=32, chunk=1, max_steps=1)
    chain = emcee_adaptor.sample(bent, optimum, seed=1, path=tmp_path / "c.h5", identity="x", settings=settings)
    drawn = emcee_adaptor.Proposal(bent, optimum).start(32, np.random.RandomState(1))
    below = optimum.best.log_posterior - np.array([bent.log_posterior(drawn), chain.log_posterior.ravel()])
    assert np.median(below[1]) < 3 * bent.n_dim
    assert np.quantile(below[1], 0.9) < 0.5 * np.quantile(below[0], 0.9)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_model_that_cannot_be_evaluated_ends_the_search_in_one_line(
    known: Experiment, monkeypatch: pytest.MonkeyPatch, value: float
) -> None:
    monkeypatch.setattr(Problem, "predict", lambda self, u, *a: np.full((len(u), self.observed.size), value))
    with np.errstate(all="ignore"), pytest.raises(ConvergenceError, match="finite posterior"):
        optimise(Problem(known, (1,)), seed=1, n_starts=3)


def test_a_flat_top_makes_no_noise() -> None:
    """One amplitude sweep leaves a sheet of equal fits, on which lmfit's own error estimates are not finite."""
    psa = read_experiment(Path(__file__).parents[1] / "experiments" / "psa")
    assert optimise(Problem(psa, (3,)), seed=1, n_starts=6).minima  # a warning would be an error


def test_posterior_covers_the_truth(finished: running.Run) -> None:
    assert finished.summary.converged, finished.summary.message
    for p, true in zip(finished.summary.parameters, [*TRUTH, 0.05], strict=False):
        spread = np.log(p.upper / p.lower) / 3.29
        assert abs(np.log(p.median / true)) < 4.5 * spread, p.text  # 4.5 sd: fails by chance once in 100,000
        assert p.r_hat < 1.05 and p.ess_bulk > 500
    assert finished.summary.autocorrelation_times >= 50


def test_sampler_draws_the_posterior_it_is_given(problem: Problem, finished: running.Run) -> None:
    """Importance weights of a Laplace approximation reproduce emcee's means."""
    top = problem.to_sampling(np.array([finished.fit.minima[0].values[n] for n in problem.names]))
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(1.5 * laplace_covariance(problem, top))
    z = rng.standard_t(5, (40_000, problem.n_dim))
    u = top + z @ root.T
    log_weight = problem.log_posterior(u) - stats.t(5).logpdf(z).sum(axis=1)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    assert 1 / np.sum(weight**2) > 500
    mean = weight @ u
    sd = np.sqrt(weight @ (u - mean) ** 2)
    draws = problem.to_sampling(finished.draws.flat)
    assert (draws.mean(axis=0) - mean) / sd == pytest.approx(0, abs=0.25)
    assert draws.std(axis=0) / sd == pytest.approx(1, abs=0.25)


def test_same_seed_same_draws_and_a_killed_chain_resumes(problem: Problem, tmp_path: Path) -> None:
    optimum = optimise(problem, seed=1, n_starts=4)

    def chain(name: str, steps: int) -> np.ndarray:
        emcee_adaptor.sample(
            problem, optimum, seed=9, path=tmp_path / name, identity="x",
            settings=Settings(n_walkers=16, chunk=20, max_steps=steps),
        )  # fmt: skip
        return emcee.backends.HDFBackend(str(tmp_path / name), name="psafit", read_only=True).get_chain()

    undisturbed = chain("a.h5", 60)
    assert chain("b.h5", 20).shape[0] == 20  # stopped after the first checkpoint
    assert np.array_equal(chain("b.h5", 60), undisturbed)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.h5"]  # nothing half-written stays


class TwoHills:
    """Two normal hills in the plane, 17 standard deviations apart, with masses 0.8 and 0.2, under a uniform prior."""

    n_dim, half, terms = 2, 40.0, ()
    centres, masses = np.array([[0.0, 0.0], [12.0, -12.0]]), np.array([0.8, 0.2])

    def to_sampling(self, x: np.ndarray) -> np.ndarray:
        return x

    def prior_transform(self, p: np.ndarray) -> np.ndarray:
        return self.half * (2 * p - 1)

    def log_prior(self, u: np.ndarray) -> np.ndarray:
        return np.where((np.abs(u) < self.half).all(axis=1), -2 * np.log(2 * self.half), -np.inf)

    def log_posterior(self, u: np.ndarray) -> np.ndarray:
        squares = ((u[:, None, :] - self.centres) ** 2).sum(axis=2)
        # A third, 21 nats lower, where no search has been.
        lost = 0.5 * ((u - [-20.0, -20.0]) ** 2).sum(axis=1)
        hills = np.logaddexp(np.log(self.masses) - 0.5 * squares, (-21.0 - lost)[:, None])
        return np.logaddexp(*hills.T) + self.log_prior(u)

    def optimum(self, *log_masses: float) -> Optimum:
        found = tuple(Minimum(c, m, 1) for c, m in zip(self.centres, log_masses, strict=True))
        return Optimum(found, np.tile(np.eye(2), (2, 1, 1)), 2, 0, 0, "")


def test_proposal_draws_the_density_it_claims() -> None:
    """Importance weights against the prior's box: the density integrates to one, and means agree with draws."""
    hills = TwoHills()
    proposal = emcee_adaptor.Proposal(hills, hills.optimum(0.0, -1.0))  # type: ignore[arg-type]
    draws = proposal.draw(200_000, np.random.RandomState(1))
    edges = np.linspace(-40, 40, 801)
    middle = (edges[1:] + edges[:-1]) / 2
    grid = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = np.exp(proposal.log_density(grid)).reshape(800, 800) * 0.01
    assert mass.sum() == pytest.approx(1, abs=2e-3)  # Student's tails leave the box
    counted, *_ = np.histogram2d(*draws.T, bins=[np.linspace(-40, 40, 41)] * 2)
    expected = mass.reshape(40, 20, 40, 20).sum(axis=(1, 3)) * len(draws)
    assert np.abs((counted - expected) / np.sqrt(expected + 1)).max() < 5


@pytest.fixture
def in_front() -> Iterator[object]:
    """Ctrl-C's usual handler: a shell lets what runs in the background ignore it, these tests among them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_chain_between_steps_without_a_traceback(  # type: ignore[no-untyped-def]
    tmp_path: Path, capfd, monkeypatch, in_front
) -> None:
    hills, calls = TwoHills(), []
    likelihood = hills.log_posterior

    def interrupted(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        if len(calls) > 5:
            os.kill(os.getpid(), signal.SIGINT)
        return likelihood(u)

    monkeypatch.setattr(hills, "log_posterior", interrupted)
    with pytest.raises(KeyboardInterrupt):
        emcee_adaptor.sample(
            hills, hills.optimum(0.0, -1.0), seed=1, path=tmp_path / "c.h5", identity="x",
            settings=Settings(n_walkers=20, max_steps=500),
        )  # type: ignore[arg-type]  # fmt: skip
    assert signal.getsignal(signal.SIGINT) is in_front
    assert len(calls) < 20 and capfd.readouterr() == ("", "")


def test_modes_get_their_own_weights_and_a_stuck_walker_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hills = TwoHills()
    begin = np.random.default_rng(0).standard_normal((20, 2))
    begin[0] = [-20.0, -20.0]  # alone where nobody else is
    monkeypatch.setattr(emcee_adaptor.Proposal, "start", lambda *a: begin)
    chain = emcee_adaptor.sample(
        hills, hills.optimum(-3.0, 0.0), seed=1, path=tmp_path / "c.h5", identity="x",  # Laplace masses 80 times off
        settings=Settings(n_walkers=20, r_hat=1.03, max_steps=8000),
    )  # type: ignore[arg-type]  # fmt: skip
    assert chain.converged, (chain.draws.shape, chain.r_hat)
    assert (chain.draws.min(axis=(0, 1)) > [-10.0, -20.0]).all()
    assert np.mean(chain.draws[..., 0] < 6) == pytest.approx(0.8, abs=0.05)


def test_negligible_minima_get_no_walker_and_the_others_at_least_a_scout(problem: Problem) -> None:
    hills = TwoHills()
    for drop, share in ((6.0, 0.9 * 0.01 / 1.01), (13.0, 0.0)):
        proposal = emcee_adaptor.Proposal(hills, hills.optimum(0.0, -drop))  # type: ignore[arg-type]
        draws = proposal.draw(20_000, np.random.RandomState(0))
        near = np.mean(np.linalg.norm(draws - hills.centres[1], axis=1) < 4)
        assert near == pytest.approx(share, abs=0.003)
    start = emcee_adaptor.Proposal(problem, optimise(problem, seed=1, n_starts=4)).start(40, np.random.RandomState(0))
    assert start.shape == (40, problem.n_dim) and np.isfinite(problem.log_posterior(start)).all()


def test_a_chain_between_several_places_says_so() -> None:
    r_hat, names = np.array([1.001, 1.03]), ["k_c", "c_c"]
    said = running._apart(names, [-10.0, -12.0, -14.9, -30.0], r_hat, 1.01)
    assert "c_c mixes least" in said and "in 3 places" in said
    assert running._apart(names, [-10.0, -16.0], r_hat, 1.01) == ""
    assert running._apart(names, [-10.0, -12.0], r_hat - 0.03, 1.01) == ""


def test_repeating_an_unconverged_run_draws_on(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)  # slow, and not the point
    first = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    assert not first.summary.converged and "repeat the command to draw on" in first.summary.message
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(identify, "profiles", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    more = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    at_once = running.fit(
        known, [1], tmp_path / "b", seed=2, n_starts=3, settings=replace(SHORT, max_steps=2 * SHORT.max_steps)
    )
    assert (first.summary.n_steps, more.summary.n_steps) == (SHORT.max_steps, 2 * SHORT.max_steps)
    assert more.fit == at_once.fit and np.array_equal(more.draws.values, at_once.draws.values)


def test_a_minimum_that_the_search_missed_is_added(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = Problem(known, (1,))
    true = optimise(problem, seed=1, n_starts=6)
    wrong = problem.to_sampling(true.best.values)
    wrong[:3] += [1.5, -1.0, 1.0]
    found = Minimum(problem.to_physical(wrong), float(problem.log_posterior(wrong[None])[0]), 3)
    assert found.log_posterior < true.best.log_posterior - 10
    poor = Optimum((found,), laplace_covariance(problem, wrong)[None], 3, 0, 10, "lmfit")
    monkeypatch.setattr(running, "optimise", lambda *a, **k: poor)
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    arguments: dict[str, Any] = {"seed": 2, "n_starts": 3, "settings": replace(SHORT, max_steps=400)}
    run = running.fit(known, [1], tmp_path / "a", **arguments)
    best = run.fit.minima[0]
    assert run.fit.n_missed >= 1 and best.starts == 0 and run.fit.minima[-1].starts == 3
    assert best.log_posterior > true.best.log_posterior - 1 and run.draws.log_posterior.max() <= best.log_posterior + 1
    assert read_json(tmp_path / "a" / "fit.json", Fit, sealed=True) == run.fit
    # Killed where it hurts most, between the chain and the record, it comes to the same.
    written = running.write_json

    def killed(path: Path, record: Any, **options: Any) -> None:
        if isinstance(record, Fit) and record.n_missed:
            raise KeyboardInterrupt
        written(path, record, **options)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(running, "write_json", killed)
        running.fit(known, [1], tmp_path / "b", **arguments)
    again = running.fit(known, [1], tmp_path / "b", **arguments)
    assert again.fit == run.fit and np.array_equal(again.draws.values, run.draws.values)


def test_many_readings_are_stored_thinned(known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    monkeypatch.setattr(running, "_LIKELIHOODS", 30 * 16 * 4)
    run = running.fit(known, [1], tmp_path / "a", seed=2, n_starts=3, settings=SHORT)
    with h5py.File(tmp_path / "a" / "posterior.nc") as f:
        stored = f["log_likelihood/launch_range_um"]
        assert stored.dtype == np.float32 and stored.shape[0] == 16 and stored.size <= 30 * 16 * 4
        u = run.problem.to_sampling(run.draws.values[:, 0])
        assert stored[:, 0] == pytest.approx(run.problem.pointwise_log_likelihood(u), rel=1e-5)


def test_a_run_killed_between_stages_goes_on(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = {"seed": 2, "n_starts": 3, "settings": SHORT}
    whole = running.fit(known, [1], tmp_path / "whole", **arguments)
    # The profile never closes the run: as if killed there.
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(identify, "profiles", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "cut", **arguments)
    with pytest.raises(InputError, match="interrupted run"):
        running.load(tmp_path / "cut")
    resumed = running.fit(known, [1], tmp_path / "cut", **arguments)
    assert np.array_equal(resumed.draws.values, whole.draws.values)
    assert resumed.summary == whole.summary
    assert not whole.summary.converged and "autocorrelation times" in whole.summary.message


def test_run_reads_back(finished: running.Run) -> None:
    again = running.load(finished.folder)
    assert again.fit == finished.fit and again.summary == finished.summary
    assert np.array_equal(again.draws.values, finished.draws.values)
    assert again.problem.experiment.fingerprint == finished.fit.fingerprint
    import arviz as az

    stored = az.from_netcdf(str(finished.folder / "posterior.nc"))
    assert set(finished.problem.names) <= set(stored["posterior"].data_vars)
    assert stored["log_likelihood"]["launch_range_um"].shape[-1] == finished.problem.observed.size


def test_repeating_a_finished_run_changes_nothing(finished: running.Run, known: Experiment) -> None:
    before = {p.name: p.read_bytes() for p in finished.folder.iterdir() if p.is_file()}
    running.fit(known, [1, 2], finished.folder, seed=4, n_starts=12, settings=QUICK)
    assert {p.name: p.read_bytes() for p in finished.folder.iterdir() if p.is_file()} == before


def _edit(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(path.read_text("utf-8"))
    change(content)
    path.write_text(json.dumps(content), "utf-8")


# Whatever is edited: the seal tells.
EDITS: dict[str, Callable[[dict[str, Any]], object]] = {
    "fit.json seed": lambda c: c.update(seed=-1),
    "fit.json value": lambda c: c["minima"][0]["values"].update(k_c=1.0),
    "fit.json no seal": lambda c: c.pop("sha256"),
    "posterior.json median": lambda c: c["parameters"][0].update(median=None),
    "posterior.json identity": lambda c: c.update(identity="0" * 64),
}


def _break(folder: Path, how: str) -> None:
    if how == "foreign json":
        (folder / "fit.json").write_text('{"hello": 1}')
    elif how == "truncated json":
        (folder / "fit.json").write_bytes((folder / "fit.json").read_bytes()[:200])
    elif how == "wrong type":
        content = json.loads((folder / "posterior.json").read_text())
        content["n_steps"] = "many"
        (folder / "posterior.json").write_text(json.dumps(content))
    elif how in EDITS:
        _edit(folder / how.split()[0], EDITS[how])
    elif how == "scaled draws":
        with h5py.File(folder / "posterior.nc", "r+") as f:
            f["posterior/k_c"][...] *= 3
    elif how == "no draws":
        (folder / "posterior.nc").unlink()
    elif how == "corrupt draws":
        (folder / "posterior.nc").write_bytes(b"not HDF5")
    elif how == "foreign draws":
        with h5py.File(folder / "posterior.nc", "w") as f:
            f["x"] = 1
    elif how == "changed data":
        table = folder / "experiment" / "group1.csv"
        lines = table.read_text().splitlines()
        table.write_text("\n".join([*lines[:-1], "123.0,20.0,4.0"]) + "\n")


@pytest.mark.parametrize(
    "how",
    ["foreign json", "truncated json", "wrong type", "no draws", "corrupt draws", "foreign draws", "changed data",
     "scaled draws", *EDITS],
)  # fmt: skip
def test_a_damaged_run_folder_gets_one_line(finished: running.Run, tmp_path: Path, how: str) -> None:
    folder = tmp_path / "damaged"
    shutil.copytree(finished.folder, folder)
    _break(folder, how)
    with pytest.raises(InputError, match="was changed after psafit wrote it" if how in EDITS else None) as caught:
        running.load(folder)
    assert "\n" not in str(caught.value) and caught.value.file is not None and caught.value.remedy


def test_a_posterior_of_another_run_is_told(finished: running.Run, tmp_path: Path) -> None:
    folder = tmp_path / "swapped"
    shutil.copytree(finished.folder, folder)
    write_json(folder / "posterior.json", replace(finished.summary, identity="0" * 64), sealed=True)
    with pytest.raises(InputError, match="belongs to another run"):
        running.load(folder)


def test_a_record_from_another_run_is_told(finished: running.Run, tmp_path: Path) -> None:
    """Well-formed and sealed, but not of these data, or not what its own identity says."""
    for number, (change, words) in enumerate((
        ({"fingerprint": "0" * 64}, "was changed after the fit"),
        ({"parameters": finished.fit.parameters[1:]}, r"is of another version of psafit \(priors differ\)"),
        ({"groups": [1]}, "contradicts itself"),
        ({"seed": 5}, "contradicts itself"),
        ({"n_starts": 5}, "contradicts itself"),
    )):  # fmt: skip
        folder = tmp_path / str(number)
        shutil.copytree(finished.folder, folder)
        write_json(folder / "fit.json", replace(finished.fit, **change), sealed=True)
        files = finished.summary.files | {"fit.json": running.sha256(folder / "fit.json")}
        write_json(folder / "posterior.json", replace(finished.summary, files=files), sealed=True)
        with pytest.raises(InputError, match=words):
            running.load(folder)


def test_what_is_not_a_number_reads_back_as_such(finished: running.Run, tmp_path: Path) -> None:
    first = replace(finished.summary.parameters[0], ess_tail=float("nan"))
    write_json(tmp_path / "p.json", replace(finished.summary, parameters=[first]))
    assert np.isnan(read_json(tmp_path / "p.json", type(finished.summary)).parameters[0].ess_tail)


def test_only_an_interrupted_run_of_ours_goes_on_in_a_folder_without_a_fit(
    known: Experiment, known_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identify, "profiles", lambda problem, *a: [[]] * problem.n_physical)
    arguments: dict[str, Any] = {"seed": 2, "n_starts": 3, "settings": SHORT}
    shutil.copytree(known_folder, tmp_path / "mine" / "experiment")
    before = {p.name: p.read_bytes() for p in (tmp_path / "mine" / "experiment").iterdir()}
    with pytest.raises(InputError, match="already holds other files"):
        running.fit(known, [1], tmp_path / "mine", **arguments)
    assert {p.name: p.read_bytes() for p in (tmp_path / "mine" / "experiment").iterdir()} == before
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(running, "optimise", lambda *a, **k: (_ for _ in ()).throw(KeyboardInterrupt))
        running.fit(known, [1], tmp_path / "cut", **arguments)
    (tmp_path / "cut" / ".fit.json.123.tmp").write_text("{")
    with pytest.raises(InputError, match="holds another run, interrupted"):
        running.fit(known, [2], tmp_path / "cut", **arguments)
    running.fit(known, [1], tmp_path / "cut", **arguments)
    assert not [p for p in (tmp_path / "cut").iterdir() if p.name.startswith(".")]
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / ".fit.json.123.tmp").write_text("{")
    running.fit(known, [1], tmp_path / "killed", **arguments)


def test_a_refusal_says_what_differs(known: Experiment, finished: running.Run) -> None:
    for change, words in (
        ({"seed": 5}, "seed"), ({"n_starts": 5}, "starts"), ({"settings": SHORT}, "sampler settings"),
    ):  # fmt: skip
        arguments: dict[str, Any] = {"seed": 4, "n_starts": 12, "settings": QUICK} | change
        with pytest.raises(InputError, match=rf"\(what differs: {words}\)"):
            running.fit(known, [1, 2], finished.folder, **arguments)
    told = replace(known, beliefs=(Belief("k_c", LogNormal(1e6, 2.0), "Hertz"),))
    with pytest.raises(InputError, match=r"\(what differs: priors\)"):
        running.fit(told, [1, 2], finished.folder, seed=4, n_starts=12, settings=QUICK)
    with pytest.raises(InputError, match=r"\(what differs: groups\)"):
        running.fit(known, [1], finished.folder, seed=4, n_starts=12, settings=QUICK)


def test_folders_of_others_are_left_alone(known: Experiment, finished: running.Run, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="already holds other files"):
        running.fit(known, [1], tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]
    with pytest.raises(InputError, match="holds another run"):
        running.fit(known, [1], finished.folder)
    with pytest.raises(InputError, match="is a file"):
        running.fit(known, [1], tmp_path / "notes.txt")


def test_a_foreign_checkpoint_is_refused(problem: Problem, tmp_path: Path) -> None:
    optimum = optimise(problem, seed=1, n_starts=2)
    path = tmp_path / "chain.h5"
    path.write_bytes(b"rubbish")
    with pytest.raises(InputError, match="not a chain"):
        emcee_adaptor.sample(problem, optimum, seed=1, path=path, identity="a", settings=SHORT)
    path.unlink()
    emcee_adaptor.sample(problem, optimum, seed=1, path=path, identity="a", settings=SHORT)
    with pytest.raises(InputError, match="belongs to another run"):
        emcee_adaptor.sample(problem, optimum, seed=1, path=path, identity="b", settings=SHORT)


@pytest.mark.parametrize("how", ["no random state", "bad random state", "wider", "short", "nan"])
def test_a_damaged_checkpoint_is_refused(how: str, tmp_path: Path) -> None:
    hills = TwoHills()

    def sample(steps: int) -> None:
        emcee_adaptor.sample(
            hills, hills.optimum(0.0, -1.0), seed=1, path=tmp_path / "c.h5", identity="x",
            settings=Settings(n_walkers=20, chunk=10, max_steps=steps),
        )  # type: ignore[arg-type]  # fmt: skip

    sample(20)
    with h5py.File(tmp_path / "c.h5", "r+") as f:
        group = f["psafit"]
        if how.endswith("random state"):
            for key in [k for k in group.attrs if k.startswith("random_state")]:
                del group.attrs[key]
            if how.startswith("bad"):
                group.attrs["random_state_0"] = "dice"
        elif how == "wider":
            group.attrs["ndim"] = 3
            wide = np.zeros((20, 20, 3))
            del group["chain"]
            group["chain"] = wide
        elif how == "short":
            cut = group["log_prob"][:10]
            del group["log_prob"]
            group["log_prob"] = cut
        else:
            group["chain"][3, 2, 0] = np.nan
    with pytest.raises(InputError, match="not a chain written by psafit, or damaged"):
        sample(40)


def test_profile_of_a_determined_and_an_open_parameter(finished: running.Run) -> None:
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
    lone = Group(1, one.waveform, "x", one.frequency_hz[:1], one.amplitude_v[:1], one.launch_range_um[:1])
    poor = Problem(Experiment("t", "s", finished.problem.experiment.constants, (lone,), Path(), "f"), (1,))
    top = poor.prior_transform(np.full(poor.n_dim, 0.5))
    assert identify.verdict(identify.profiles(poor, top, columns=[1])[0]) != "determined"


def test_profile_is_what_another_optimiser_finds(finished: running.Run) -> None:
    problem = finished.problem
    top = problem.to_sampling(np.array(list(finished.fit.minima[0].values.values())))
    for index, points in enumerate(identify.profiles(problem, top)):
        free = np.arange(problem.n_dim) != index
        low, high = problem.bounds[free].T

        def depth(others: np.ndarray, at: np.ndarray, free: np.ndarray = free) -> float:
            at = at.copy()
            at[free] = others
            return -float(problem.log_likelihood(at[None])[0])

        heights = []
        near = [p for p in points if p.drop < 4.0]
        for point in near[:: max(len(near) // 4, 1)]:
            at = top.copy()
            at[index] = problem.parameters[index].to_sampling(point.value)
            found = scipy.optimize.minimize(
                depth, np.clip(top[free], low, high), (at,), "Nelder-Mead", bounds=list(zip(low, high, strict=True)),
                options={"maxfev": 2000, "fatol": 1e-4, "xatol": 1e-4},
            )  # fmt: skip
            heights.append(-found.fun + point.drop)
        # Every point lies as far below one and the same top.
        assert np.ptp(heights) < 0.05, (problem.names[index], heights)


def test_a_profile_does_not_lean_on_what_a_cause_cannot_be() -> None:
    """With flat priors for all, c_c = 180 N s/m came out best, beside a lean of thirty times its prior's width."""
    problem = Problem(read_experiment("experiments/psa"), (1,), terms(["preload"]))
    near = {
        "k_c": 5.1e6,
        "c_s": 1.0e5,
        "c_c": 26.0,
        "preload_offset": 1.7e-4,
        "sigma_rel": 0.019,
        "sigma_abs": 1.94,
        "nu": 16,
    }
    top = problem.to_sampling(np.array([near[name] for name in problem.names]))
    limit = identify.limits(identify.profiles(problem, top, columns=[2])[0])[1]
    assert limit is not None and limit < 60


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
    assert identify.describe("c_c", "1", 5.0, (1.0, 9.0), flat, "not determined").endswith("of its profile closes")
    assert identify.describe("nu", "1", 5.0, (1.0, 9.0), [], "not determined").endswith("narrower than the prior's")
    assert identify.significant(142537.0, 812.0) == "1.4254e5"
    assert identify.significant(3219876.0, 526000.0) == "3.22e6"
    assert identify.significant(99999.0, 99999.0) == "1.0e5"
    assert identify.significant(0.2523, 0.05) == "0.252"


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
        assert text == f"{name} at least {identify.significant(low, low)} (95 %); the data set no upper limit"


def test_diagnostics_tell_mixed_from_stuck() -> None:
    rng = np.random.default_rng(0)
    mixed = rng.standard_normal((8, 400, 1))
    stuck = mixed + 3 * np.arange(8)[:, None, None]
    assert store.r_hat(mixed)[0] < 1.01 < 1.5 < store.r_hat(stuck)[0]
    health = store.diagnostics(mixed)
    assert health["ess_bulk"][0] > 2000 and health["ess_tail"][0] > 1000


@pytest.mark.slow
def test_posteriors_are_calibrated() -> None:
    """Truths lie within the Laplace approximation about as often as it says; ranks among draws: benchmarks/sbc.py."""
    z = []
    for seed in range(24):
        experiment = measure(np.random.default_rng(1000 + seed))
        problem = Problem(experiment, (1, 2, 3))
        optimum = optimise(problem, seed=seed, n_starts=8)
        top = problem.to_sampling(optimum.best.values)
        sd = np.sqrt(np.diag(optimum.covariance[0]))
        z.append((top[:3] - np.log(TRUTH)) / sd[:3])
    spread = np.array(z)
    assert np.abs(spread.mean(axis=0)).max() < 4 / np.sqrt(24)
    assert ((spread**2).mean(axis=0) < 2.5).all() and ((spread**2).mean(axis=0) > 0.3).all()

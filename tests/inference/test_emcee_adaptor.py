"""The sampler and its checkpoints."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import emcee
import h5py
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.inference import emcee_adaptor
from psafit.inference import run as running
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.optimise import Minimum, Optimum, laplace_covariance, optimise
from psafit.inference.problem import Problem
from psafit.physics import terms

SHORT = Settings(n_walkers=16, chunk=40, max_steps=80)


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


@pytest.mark.slow
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


@pytest.mark.slow
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

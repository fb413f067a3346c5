"""The sampler and its checkpoints."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import emcee
import h5py
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from truths import few

from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.inference.candidate import candidate_at
from psafit.inference.mixture import StudentMixture
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import emcee as ensembles
from psafit.inference.samplers.emcee import SAMPLER, History, Settings
from psafit.inference.sampling import Chain, Target
from psafit.inference.surrogate import Companions, IndependenceProposal
from psafit.physics import terms

SHORT = Settings(chunk=40, max_steps=80, tuned=30)
FEW = SampleSettings.of(8, 16)


def _history(draws: np.ndarray) -> History:
    """Steps, (n_steps, n_all, n_dim)."""
    return History(draws, -0.5 * (draws**2).sum(axis=2), np.full(draws.shape[1], len(draws)))


def test_chains_are_long_enough_when_all_three_say_so() -> None:
    """Length, effective samples and R-hat, each of which can be what is missing; and none before moves are tuned."""
    usual = Settings(n_walkers=8, ensembles=4, tuned=0)
    rng = np.random.default_rng(1)
    sound = rng.standard_normal((4000, 32, 2))
    assert ensembles.chain_of(_history(sound), usual, 0).converged
    assert not ensembles.chain_of(_history(sound), replace(usual, tuned=2500), 0).converged
    slow = lfilter([1.0], [1.0, -0.95], sound[:800], axis=0)  # an autocorrelation time of 39 steps
    short = ensembles.chain_of(_history(slow), replace(usual, r_hat=2.0, effective_samples=1.0), 0)
    assert not short.converged and short.draws.shape[1] < 50 * short.autocorrelation_time.max()
    few = ensembles.chain_of(_history(sound[:, :4]), replace(usual, n_walkers=1, effective_samples=50_000.0), 0)
    assert not few.converged and few.r_hat.max() < 1.01


def test_moves_are_tuned_again_by_what_walkers_reach_late() -> None:
    """All steps by which they were are burn-in, also where these are most of the chain."""
    usual = Settings(n_walkers=8, ensembles=4)
    at = (0, 49, 50, 149, 150, 449, 450, 5000)
    assert [usual.tuned_at(n) for n in at] == [0, 0, 50, 50, 150, 150, 450, 4050]
    assert [usual.until(n) for n in (0, 150, 300, 450, 1300)] == [50, 400, 450, 700, 1350]
    assert Settings(tuned=0, max_steps=500).tuned_at(5000) == 0
    assert Settings(max_steps=1400).tuned_at(1400) == 450  # at 1350 nothing would be left
    draws = np.random.default_rng(1).standard_normal((4000, 32, 2))
    found = ensembles.chain_of(_history(draws), usual, 3000)
    assert found.converged and found.burn_in == 3000 and found.draws.shape[1] == 1000


def test_an_ensemble_that_misses_a_mode_is_seen() -> None:
    """Its walkers agree with each other, so that only other ensembles can show it: one in four sees one mode of two."""
    rng = np.random.default_rng(2)
    draws = rng.standard_normal((2000, 32, 2))
    draws[:, :24, 0] += np.where(rng.uniform(size=(2000, 24)) < 0.2, 6.0, 0.0)
    usual = Settings(n_walkers=8, ensembles=4, tuned=0)
    found = ensembles.chain_of(_history(draws), usual, 0)
    assert found.r_hat[0] > 1.01 and found.r_hat[1] < 1.01 and not found.converged
    # Where all see both it is not.
    draws[:, 24:, 0] += np.where(rng.uniform(size=(2000, 8)) < 0.2, 6.0, 0.0)
    assert ensembles.chain_of(_history(draws), usual, 0).converged


def target(problem: Problem, path: Path, identity: str = "x", seed: int = 9) -> Target:
    """What a few starts find."""
    return Target(*sample(problem, seed=1, settings=FEW), seed, path, identity)


def silent(state: object) -> None:
    """No progress."""


@pytest.mark.slow
def test_chains_begin_on_a_bent_ridge(known: Experiment, tmp_path: Path) -> None:
    """Draws from the curvature at the top lie far below a ridge that bends; importance draws do not."""
    bent = Problem(known, (1,), terms(["slew_limit", "soft_layer", "flight_friction"]))
    one = target(bent, tmp_path / "c.h5")
    chain = SAMPLER.draw(one, replace(Settings.of(bent), chunk=1, max_steps=1), silent)
    below = one.found.log_posterior - chain.log_posterior.ravel()
    assert np.median(below) < 3 * bent.n_dim and np.quantile(below, 0.9) < 6 * bent.n_dim


@pytest.mark.slow
def test_sampler_draws_the_posterior_it_is_given(problem: Problem, finished: Run) -> None:
    """Importance weights of a Laplace approximation reproduce emcee's means."""
    top = problem.to_sampling(np.array([finished.fit.minima[0].values[n] for n in problem.names]))
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(1.5 * candidate_at(problem, top[None]).covariance[0])
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
    """Stopped anywhere, also between two tunings of the moves, it goes on as if it had not been."""
    one = target(problem, tmp_path / "a.h5")

    def chain(name: str, steps: int, **changed: int) -> np.ndarray:
        settings = replace(Settings(), chunk=20, tuned=45, max_steps=steps, **changed)
        SAMPLER.draw(replace(one, path=tmp_path / name), settings, silent)
        return emcee.backends.HDFBackend(str(tmp_path / name), name="psafit", read_only=True).get_chain()

    undisturbed = chain("a.h5", 100)
    assert undisturbed.shape == (100, 64, problem.n_dim)
    for stop in (10, 15, 33, 45):
        assert len(chain("b.h5", stop)) == stop
    assert np.array_equal(chain("b.h5", 100), undisturbed)
    assert not np.array_equal(undisturbed[:, :16], undisturbed[:, 16:32])  # each ensemble has its own seed
    assert not np.array_equal(chain("c.h5", 100, tuned_by=100), undisturbed)  # and the moves are tuned
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.h5", "c.h5"]  # nothing half-written stays


class TwoModes:
    """Two normal modes in the plane, 17 standard deviations apart, with masses 0.8 and 0.2, under a uniform prior."""

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
        modes = np.logaddexp(np.log(self.masses) - 0.5 * squares, (-21.0 - lost)[:, None])
        return np.logaddexp(*modes.T) + self.log_prior(u)

    def proposal(self, *shares: float) -> IndependenceProposal:
        parts = [(c, np.eye(2), s) for c, s in zip(self.centres, shares, strict=True)]
        return IndependenceProposal(self, StudentMixture.of(parts))  # type: ignore[arg-type]

    def run(
        self, path: Path, settings: Settings, *shares: float, begin: np.ndarray | None = None, tries: int = 1
    ) -> Chain:
        """Ensembles that move by differential evolution and independent draws."""
        moves = [
            (emcee.moves.DEMove(), 0.7),
            (ensembles.ResampledMove(self.proposal(*(shares or (0.7, 0.3))), tries), 0.3),
        ]
        start = self.proposal(1.0, 1.0).draw(settings.n_walkers, np.random.default_rng(0)) if begin is None else begin
        return ensembles.run(
            self.log_posterior, lambda random: start, lambda steps: lambda random: moves, n_dim=2, seed=1, path=path,
            identity="x", settings=settings,
        )  # fmt: skip


def test_proposal_draws_the_density_it_claims() -> None:
    """Importance weights against the prior's box: the density integrates to one, and means agree with draws."""
    modes = TwoModes()
    proposal = modes.proposal(0.7, 0.3)
    draws = proposal.draw(200_000, np.random.default_rng(1))
    edges = np.linspace(-40, 40, 801)
    middle = (edges[1:] + edges[:-1]) / 2
    grid = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(-1, 2)
    mass = np.exp(proposal.log_density(grid)).reshape(800, 800) * 0.01
    assert mass.sum() == pytest.approx(1, abs=2e-3)  # Student's tails leave the box
    counted, *_ = np.histogram2d(*draws.T, bins=[np.linspace(-40, 40, 41)] * 2)
    expected = mass.reshape(40, 20, 40, 20).sum(axis=(1, 3)) * len(draws)
    assert np.abs((counted - expected) / np.sqrt(expected + 1)).max() < 5


@pytest.mark.parametrize("tries", [1, 8])
def test_one_of_several_draws_is_taken_without_bias(tries: int) -> None:
    """Draws of the posterior remain draws of it, though nearly all of them move."""
    modes, rng = TwoModes(), np.random.default_rng(1)
    proposal, n = modes.proposal(0.3, 0.7), 20_000
    u = modes.centres[(rng.uniform(size=n) < 0.2).astype(int)] + rng.standard_normal((n, 2))
    drawn = proposal.draw(n * tries, rng)
    moved, value = proposal.resampled(u, modes.log_posterior(u), drawn, modes.log_posterior(drawn), rng)
    assert np.mean(moved[:, 0] < 6) == pytest.approx(0.8, abs=0.01)
    assert (moved[moved[:, 0] < 6]).std(axis=0) == pytest.approx([1.0, 1.0], abs=0.03)
    assert value == pytest.approx(modes.log_posterior(moved))
    assert np.mean(moved != u) > (0.25 if tries == 1 else 0.7)


def test_as_many_coordinates_move_as_chance_says_and_as_far_as_suits_them() -> None:
    rng, n, d = np.random.default_rng(1), 20_000, 4
    walkers, others = rng.standard_normal((n, d)), [rng.standard_normal((500, d))]
    move = ensembles.PartMove()
    move.setup(walkers)
    moved, factor = move.get_proposal(walkers, others, np.random.RandomState(1))
    step = moved - walkers
    count = (step != 0.0).sum(axis=1)
    assert not factor.any() and np.bincount(count)[1:] / n == pytest.approx(1 / d, abs=0.02)
    mean = (1 - 0.03**2) / (2 * np.log(1 / 0.03))  # square of a length whose logarithm is even from 0.03 to 1
    for k in range(1, d + 1):
        rows = step[count == k]
        # A difference of two walkers, by 2.38 over the root of twice the coordinates that move, or shorter.
        assert np.square(rows[rows != 0.0]).mean() == pytest.approx(2.38**2 / k * mean, rel=0.1)
        assert np.quantile(np.abs(rows[rows != 0.0]), [0.1, 0.9]) @ [-30.0, 1.0] > 0.0  # short ones and long ones


@pytest.mark.slow
def test_a_single_reading_leaves_a_bent_shell_that_chains_explore(tmp_path: Path) -> None:
    """It fixes one combination of three parameters to its scatter, and leaves the others as wide as their priors."""
    shell = Problem(few([64.0]), ("a",))
    one = target(shell, tmp_path / "c.h5")
    chain = SAMPLER.draw(one, replace(Settings.of(shell), max_steps=5000), silent)
    assert chain.converged, (chain.draws.shape, chain.autocorrelation_time, chain.r_hat)
    # The prior's own draws, weighted by the likelihood: no proposal that could leave anything out.
    u = shell.prior_transform(np.random.default_rng(1).uniform(size=(200_000, shell.n_dim)))
    weight = np.exp(shell.log_likelihood(u))
    weight /= weight.sum()
    mean = weight @ u
    sd = np.sqrt(weight @ (u - mean) ** 2)
    assert 1 / np.sum(weight**2) > 1000
    draws = chain.draws.reshape(-1, shell.n_dim)
    assert (draws.mean(axis=0) - mean) / sd == pytest.approx(0, abs=0.2)
    assert draws.std(axis=0) / sd == pytest.approx(1, abs=0.2)


@pytest.fixture
def in_front() -> Iterator[object]:
    """Ctrl-C's usual handler: a shell lets what runs in the background ignore it, these tests among them."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield signal.default_int_handler
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_chain_between_steps_without_a_traceback(  # type: ignore[no-untyped-def]
    tmp_path: Path, capfd, monkeypatch, in_front
) -> None:
    modes, calls = TwoModes(), []
    likelihood = modes.log_posterior

    def interrupted(u: np.ndarray) -> np.ndarray:
        calls.append(len(u))
        if len(calls) > 5:
            os.kill(os.getpid(), signal.SIGINT)
        return likelihood(u)

    monkeypatch.setattr(modes, "log_posterior", interrupted)
    with pytest.raises(KeyboardInterrupt):
        modes.run(tmp_path / "c.h5", Settings(max_steps=500))
    assert signal.getsignal(signal.SIGINT) is in_front
    assert len(calls) < 20 and capfd.readouterr() == ("", "")


@pytest.mark.parametrize("tries", [1, 4])
def test_modes_get_their_own_weights_and_a_stuck_walker_leaves(tries: int, tmp_path: Path) -> None:
    modes = TwoModes()
    begin = np.random.default_rng(0).standard_normal((16, 2))
    begin[0] = [-20.0, -20.0]  # alone where nobody else is
    # Masses 80 times off.
    chain = modes.run(tmp_path / "c.h5", Settings(tuned=0, max_steps=8000), 0.05, 1.0, begin=begin, tries=tries)
    assert chain.converged, (chain.draws.shape, chain.r_hat)
    assert (chain.draws.min(axis=(0, 1)) > [-10.0, -20.0]).all()
    assert np.mean(chain.draws[..., 0] < 6) == pytest.approx(0.8, abs=0.05)


def test_a_thinned_chain_says_what_the_whole_one_does(tmp_path: Path) -> None:
    """Also at the very step after which moves are tuned again, from which nothing is kept yet."""
    # So far off are its independent draws that it has not converged by then.
    usual = Settings(n_walkers=16, tuned=150, max_steps=900, autocorrelation_times=1e6)
    TwoModes().run(tmp_path / "c.h5", replace(usual, max_steps=450), 0.7, 0.3)
    values = 450 * 64 * 2
    whole, thinned = (SAMPLER.look(tmp_path / "c.h5", asdict(usual), 2, values // k) for k in (1, 4))
    assert whole is not None and thinned is not None and whole.steps == thinned.steps == 450
    kept = [p.autocorrelation_times * p.autocorrelation_time for p in (whole, thinned)]
    assert kept[0] == pytest.approx(300, abs=1) and kept[1] == pytest.approx(300, abs=8)
    assert thinned.r_hat == pytest.approx(whole.r_hat, abs=0.02)


def test_a_foreign_checkpoint_is_refused(problem: Problem, tmp_path: Path) -> None:
    one = target(problem, tmp_path / "chain.h5", "a")
    one.path.write_bytes(b"rubbish")
    with pytest.raises(InputError, match="not a chain"):
        SAMPLER.draw(one, SHORT, silent)
    one.path.unlink()
    SAMPLER.draw(one, SHORT, silent)
    with pytest.raises(InputError, match="belongs to another run"):
        SAMPLER.draw(replace(one, identity="b"), SHORT, silent)


@pytest.mark.parametrize("how", ["no random state", "bad random state", "wider", "short", "nan"])
def test_a_damaged_checkpoint_is_refused(how: str, tmp_path: Path) -> None:
    modes = TwoModes()

    def sample(steps: int) -> None:
        modes.run(tmp_path / "c.h5", Settings(chunk=10, max_steps=steps))

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


class Bent:
    """A banana in the plane: the second coordinate follows the square of the first."""

    def log_density(self, u: np.ndarray) -> np.ndarray:
        return -0.5 * (u[:, 0] ** 2 + ((u[:, 1] - u[:, 0] ** 2) / 0.3) ** 2)

    def draw(self, n: int, random: np.random.Generator) -> np.ndarray:
        """Few places, on one side, each several times."""
        return np.repeat(random.normal(1.0, 0.2, (n // 10, 2)), 10, axis=0)


def test_companions_draw_the_emulated_density() -> None:
    """From few places on one side of a bent ridge to all of it."""
    random = np.random.default_rng(1)
    companions = Companions(Bent(), 500, random)  # type: ignore[arg-type]
    found = []
    for k in range(1500):
        companions.walk(random)
        if k >= 500 and k % 10 == 0:
            found.append(companions.places.copy())
    u = np.concatenate(found)
    along, across = u[:, 0], (u[:, 1] - u[:, 0] ** 2) / 0.3
    assert along.mean() == pytest.approx(0.0, abs=0.1) and along.std() == pytest.approx(1.0, abs=0.08)
    assert across.mean() == pytest.approx(0.0, abs=0.05) and across.std() == pytest.approx(1.0, abs=0.05)
    again = Companions(Bent(), 500, random)  # type: ignore[arg-type]
    again.state = companions.state
    assert np.array_equal(again.places, companions.places)
    assert again.state[:, -1] == pytest.approx(Bent().log_density(again.places))


def test_exchanges_draw_the_posterior_however_poor_the_emulator_is() -> None:
    """Walkers that move in no other way have its density, not the emulated one, which lies off it."""

    def log_posterior(u: np.ndarray) -> np.ndarray:
        return -0.5 * (((u - [0.5, 1.0]) / [0.7, 0.5]) ** 2).sum(axis=1)

    random = np.random.default_rng(2)
    companions = Companions(Bent(), 400, random)  # type: ignore[arg-type]
    u = np.tile([0.5, 1.0], (40, 1)) + 0.1 * random.standard_normal((40, 2))
    value, found, moved = log_posterior(u), [], []
    for k in range(3000):
        companions.walk(random)
        before = u
        u, value = companions.exchange(u, value, log_posterior, random)
        moved.append((before != u).any(axis=1).mean())
        if k >= 300:
            found.append(u)
    draws = np.concatenate(found)
    assert np.array_equal(value, log_posterior(u)) and 0.1 < np.mean(moved) < 0.9
    # Where the emulated density is nothing no companion leads: only the ridge's surroundings can be compared.
    near = np.abs(draws[:, 1] - draws[:, 0] ** 2) < 0.2
    exact = np.random.default_rng(3).normal([0.5, 1.0], [0.7, 0.5], (200_000, 2))
    wanted = exact[np.abs(exact[:, 1] - exact[:, 0] ** 2) < 0.2]
    assert draws[near].mean(axis=0) == pytest.approx(wanted.mean(axis=0), abs=0.05)
    assert draws[near].std(axis=0) == pytest.approx(wanted.std(axis=0), rel=0.06)


class Wide:
    """Three quarters of a normal density in the plane, and a quarter that is four times as wide, drawn exactly."""

    def log_density(self, u: np.ndarray) -> np.ndarray:
        squares = (u**2).sum(axis=1)
        return np.logaddexp(np.log(0.75) - squares / 2, np.log(0.25 / 16) - squares / 32)

    def draw(self, n: int, random: np.random.Generator) -> np.ndarray:
        return np.where(random.uniform(size=(n, 1)) < 0.25, 4.0, 1.0) * random.standard_normal((n, 2))


def test_exchanges_leave_the_posterior_as_it_is_from_the_first_step() -> None:
    """A lobe that only the wide part of the emulated density reaches keeps its share of walkers that begin rightly."""

    def log_posterior(u: np.ndarray) -> np.ndarray:
        lobe = ((u - [5.0, 0.0]) ** 2).sum(axis=1)
        return np.logaddexp(np.log(0.8) - (u**2).sum(axis=1) / 2, np.log(0.2) - lobe / 2)

    shares = []
    for seed in range(12):
        random = np.random.default_rng(seed)
        companions = Companions(Wide(), 400, random)  # type: ignore[arg-type]
        u = random.standard_normal((100, 2)) + np.repeat([[0.0, 0.0], [5.0, 0.0]], [80, 20], axis=0)
        value = log_posterior(u)
        for k in range(80):
            companions.walk(random)
            u, value = companions.exchange(u, value, log_posterior, random)
            if k >= 10:
                shares.append(np.mean(u[:, 0] > 2.5))
    assert np.mean(shares) == pytest.approx(0.2, abs=0.02)

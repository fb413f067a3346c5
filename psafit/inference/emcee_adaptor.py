"""Posterior draws by emcee, with a checkpoint that survives anything.

Steps are drawn in memory; after every chunk the whole chain goes to an HDF5 file of emcee's own format, swapped in
by one rename. Whatever kills the run, a consistent chain with its generator's state is there to go on from, and a
resumed run draws what an undisturbed one would have drawn.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import emcee
import h5py
import numpy as np
from numpy.typing import NDArray

from psafit.errors import InputError
from psafit.files import replacing
from psafit.inference import store
from psafit.inference.optimise import Optimum
from psafit.inference.problem import Problem

FloatArray = NDArray[np.float64]
_GROUP = "psafit"


@dataclass(frozen=True)
class Settings:
    """When to stop.

    Parameters
    ----------
    n_walkers : int
    chunk : int
        Steps between checkpoints and checks.
    autocorrelation_times : float
        Length of the chain after burn-in, in units of the slowest parameter's autocorrelation time.
    effective_samples : float
        Wanted of the worst parameter (steps x walkers / autocorrelation time).
    r_hat : float
        Largest split R-hat (ArviZ, every walker a chain) that counts as mixed.
    max_steps : int
        Gives up here, and says so.
    """

    n_walkers: int = 32
    chunk: int = 250
    autocorrelation_times: float = 50.0
    effective_samples: float = 1000.0
    r_hat: float = 1.01
    max_steps: int = 40_000


@dataclass(frozen=True)
class Chain:
    """The ensemble's draws after burn-in.

    Parameters
    ----------
    draws : (n_walkers, n_steps, n_dim) array
        In the sampling coordinate.
    log_posterior : (n_walkers, n_steps) array
    autocorrelation_time : (n_dim,) array
        Steps, from the draws after burn-in.
    burn_in : int
        Steps discarded.
    acceptance : float
        Mean fraction of moves accepted.
    converged : bool
        Whether the stopping rule was met.
    """

    draws: FloatArray
    log_posterior: FloatArray
    autocorrelation_time: FloatArray
    burn_in: int
    acceptance: float
    converged: bool


@dataclass(frozen=True)
class Progress:
    """State of a running chain, for whoever shows it."""

    steps: int
    autocorrelation_times: float
    wanted: float
    acceptance: float


def start_positions(problem: Problem, optimum: Optimum, n_walkers: int, rng: np.random.Generator) -> FloatArray:
    """Walkers around the minima, in proportion to their Laplace masses and twice as wide; (n_walkers, n_dim)."""
    log_mass = np.array([m.log_posterior for m in optimum.minima])
    log_mass = log_mass + 0.5 * np.linalg.slogdet(optimum.covariance)[1]
    mass = np.exp(log_mass - log_mass.max())
    # A Laplace mass may err by a factor of a hundred: no basin is left without a scout.
    share = np.maximum(mass / mass.sum(), 1e-2)
    counts = rng.multinomial(n_walkers, share / share.sum())
    walkers: list[FloatArray] = []
    for minimum, covariance, count in zip(optimum.minima, optimum.covariance, counts, strict=True):
        centre = problem.to_sampling(minimum.values)
        root = 2.0 * np.linalg.cholesky(covariance)
        kept = 0
        for attempt in range(1000):
            u = centre + 0.98**attempt * root @ rng.standard_normal(problem.n_dim)
            if kept == count:
                break
            if np.isfinite(problem.log_posterior(u[None, :])[0]):
                walkers.append(u)
                kept += 1
    while len(walkers) < n_walkers:  # a minimum at a bound may reject too often
        walkers.append(walkers[int(rng.integers(len(walkers)))] + 1e-3 * rng.standard_normal(problem.n_dim))
    return np.array(walkers)


def autocorrelation_time(draws: FloatArray) -> FloatArray:
    """Integrated autocorrelation time of each parameter, steps; `draws` is (n_walkers, n_steps, n_dim)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tau = emcee.autocorr.integrated_time(np.swapaxes(draws, 0, 1), tol=0, quiet=True)
    # A walker that never moved in a short stretch has none: then the stretch is too short to tell.
    return np.where(np.isfinite(tau), np.maximum(tau, 1.0), float(draws.shape[1]))


def _state(chain: FloatArray) -> tuple[int, FloatArray]:
    """Burn-in (steps) and autocorrelation times after it; `chain` is (n_steps, n_walkers, n_dim)."""
    half = np.swapaxes(chain[len(chain) // 2 :], 0, 1)
    burn = min(int(10 * autocorrelation_time(half).max()), len(chain) // 2)
    return burn, autocorrelation_time(np.swapaxes(chain[burn:], 0, 1))


def sample(
    problem: Problem,
    optimum: Optimum,
    *,
    seed: int,
    path: Path,
    identity: str,
    settings: Settings | None = None,
    progress: Callable[[Progress], None] = lambda state: None,
) -> Chain:
    """Draw from the posterior, going on from the checkpoint at `path` where there is one.

    Parameters
    ----------
    problem : Problem
    optimum : Optimum
        Where the walkers start.
    seed : int
    path : Path
        HDF5 checkpoint (`emcee.backends.HDFBackend` reads it).
    identity : str
        What the chain belongs to; a checkpoint of something else is refused.
    settings : Settings, optional
    progress : callable
        Called with a `Progress` after every chunk.

    Returns
    -------
    Chain

    Raises
    ------
    InputError
        If `path` is not a checkpoint of this very run.
    """
    settings = settings or Settings()
    backend = emcee.backends.Backend()
    if path.exists():
        _resume(backend, path, identity)
    else:
        backend.reset(settings.n_walkers, problem.n_dim)
    sampler = emcee.EnsembleSampler(
        settings.n_walkers,
        problem.n_dim,
        problem.log_posterior,
        vectorize=True,
        backend=backend,
        moves=[(emcee.moves.DEMove(), 0.7), (emcee.moves.DEMove(gamma0=1.0), 0.1), (emcee.moves.StretchMove(), 0.2)],
    )  # fmt: skip
    if backend.iteration == 0:
        state = np.random.RandomState(seed).get_state()  # emcee draws from the legacy generator
        start = emcee.State(
            start_positions(problem, optimum, settings.n_walkers, np.random.default_rng([seed, 1])),
            random_state=state,
        )
    else:
        start = backend.get_last_sample()
    while True:
        done, chain = _stop(backend, settings)
        if chain.draws.size:
            progress(
                Progress(
                    int(backend.iteration),
                    float(chain.draws.shape[1] / chain.autocorrelation_time.max()),
                    settings.autocorrelation_times,
                    chain.acceptance,
                )
            )
        if done:
            return chain
        start = sampler.run_mcmc(start, settings.chunk, skip_initial_state_check=True)
        _checkpoint(backend, path, identity)


def _stop(backend: emcee.backends.Backend, settings: Settings) -> tuple[bool, Chain]:
    n = backend.iteration
    if n == 0:
        empty = np.empty((settings.n_walkers, 0, 1))
        return False, Chain(empty, empty[..., 0], np.full(1, np.inf), 0, 0.0, False)
    chain = backend.get_chain()
    burn, tau = _state(chain)
    kept = n - burn
    draws = np.swapaxes(chain[burn:], 0, 1).copy()
    converged = bool(
        kept >= settings.autocorrelation_times * tau.max()
        and kept * settings.n_walkers / tau.max() >= settings.effective_samples
        and store.r_hat(draws).max() < settings.r_hat
    )
    return converged or n >= settings.max_steps, Chain(
        draws,
        backend.get_log_prob(discard=burn).T.copy(),
        tau,
        burn,
        float(np.mean(backend.accepted / n)),
        converged,
    )


def _checkpoint(backend: emcee.backends.Backend, path: Path, identity: str) -> None:
    """Write the chain where `emcee.backends.HDFBackend(path, name="psafit")` finds it, in one step."""
    with replacing(path) as temporary:
        stored = emcee.backends.HDFBackend(str(temporary), name=_GROUP)
        stored.reset(*backend.shape)
        stored.grow(backend.iteration, None)
        with stored.open("a") as f:
            f.attrs["identity"] = identity
            group = f[_GROUP]
            group["chain"][:] = backend.chain
            group["log_prob"][:] = backend.log_prob
            group["accepted"][:] = backend.accepted
            group.attrs["iteration"] = backend.iteration
            for i, part in enumerate(backend.random_state):
                group.attrs[f"random_state_{i}"] = part


def _resume(backend: emcee.backends.Backend, path: Path, identity: str) -> None:
    """Fill an empty back-end from a checkpoint of the same run."""
    try:
        with h5py.File(path, "r") as f:
            found = str(f.attrs["identity"])
        stored = emcee.backends.HDFBackend(str(path), name=_GROUP, read_only=True)
        backend.reset(*stored.shape)
        backend.chain, backend.log_prob = stored.get_chain(), stored.get_log_prob()
        backend.accepted, backend.iteration = stored.accepted, int(stored.iteration)
        backend.random_state = tuple(stored.random_state)
    except (OSError, KeyError, ValueError, RuntimeError, AttributeError) as error:
        raise InputError(
            "not a chain written by psafit, or damaged", "remove it or choose another --out", file=path
        ) from error
    if found != identity:
        raise InputError(
            "belongs to another run (other data, groups, terms, seed or version)",
            "choose another --out, or remove the file to start over",
            file=path,
        )

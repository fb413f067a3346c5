"""Posterior draws by emcee, with a checkpoint that survives anything.

Steps are drawn in memory; after every chunk the whole chain goes to an HDF5 file of emcee's own format, swapped in
by one rename. Whatever kills the run, a consistent chain with its generator's state is there to go on from, and a
resumed run draws what an undisturbed one would have drawn.

emcee's ensemble moves cannot carry a lone walker out of a mode that no other walker shares, so some of
the moves are independent draws from a fixed density that reaches everywhere: see `Proposal`. With causes added,
posteriors are bent and cut; there most moves are strides through an emulated posterior: see
`psafit.inference.evidence.Emulated.wander`.
"""

from __future__ import annotations

import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import emcee
import h5py
import numpy as np
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import read_error, replacing, reserve
from psafit.inference import store
from psafit.inference.candidate import settle_at
from psafit.inference.evidence import Emulated, emulate, student_log_density
from psafit.inference.optimise import Optimum
from psafit.inference.problem import Problem

GROUP = "psafit"

# The proposal's tails (degrees of freedom) and the prior's share in it.
_TAILS, _PRIOR_SHARE = 4.0, 0.1
# Share of strides through an emulated posterior, where causes extend the model.
_STRIDES = 0.7
# A chain is long: its emulator may cost more than one for an evidence.
_CAREFULLY: dict[str, int] = {"rounds": 24, "effective": 1000}
# A Laplace mass may err by a factor of a hundred: no minimum that counts gets less than this share, and one counts
# unless its mass is negligible (log, against the greatest) even so.
_LEAST_SHARE, _NEGLIGIBLE = 0.01, -12.0


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
        Gives up here, and says so. No part of a run's identity: a chain that gave up can be drawn on.
    stored : int
        Pointwise log likelihoods kept in `posterior.nc` (32 MB by default); of more draws, some are left out. No part
        of a run's identity either.
    """

    n_walkers: int = 32
    chunk: int = 250
    autocorrelation_times: float = 50.0
    effective_samples: float = 1000.0
    r_hat: float = 1.01
    max_steps: int = 40_000
    stored: int = 2**23

    @classmethod
    def of(cls, problem: Problem) -> Settings:
        """Twice the walkers where causes add parameters: moves between walkers need a crowd in every direction."""
        return cls(n_walkers=32 if problem.n_dim <= 6 else 64)


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
    r_hat : (n_dim,) array
        Of the draws after burn-in.
    burn_in : int
        Steps discarded.
    acceptance : float
        Mean fraction of moves accepted.
    converged : bool
        Whether the stopping rule was met.
    highest : (n_dim,) array
        The draw of highest posterior, burn-in included.
    height : float
        Its log posterior.
    """

    draws: FloatArray
    log_posterior: FloatArray
    autocorrelation_time: FloatArray
    r_hat: FloatArray
    burn_in: int
    acceptance: float
    converged: bool
    highest: FloatArray
    height: float


@dataclass(frozen=True)
class Progress:
    """State of a running chain, for whoever shows it; `steps_left` is what it would take if nothing changed."""

    steps: int
    steps_left: int
    autocorrelation_times: float
    r_hat: float
    acceptance: float


class Proposal:
    r"""A density near the posterior that reaches every mode from anywhere.

    .. math:: g(u) = \tfrac{1}{10} \pi(u) + \tfrac{9}{10} \sum_k w_k\, t_4(u \mid u_k, C_k),

    the prior and a Student density at each minimum :math:`u_k`, with its Laplace covariance and mass. A Metropolis
    step from `u` to a draw `u'` is accepted with the probability :math:`p(u') g(u) / p(u) g(u')`. Since `g` is at
    least a tenth of the prior, a walker leaves any place whose likelihood is below a tenth of the known modes' evidence
    as soon as a draw lands in one of them; and modes get the weights they have, not those they started with.

    Parameters
    ----------
    problem : Problem
    optimum : Optimum
    """

    def __init__(self, problem: Problem, optimum: Optimum) -> None:
        log_mass = np.array([m.log_posterior for m in optimum.minima])
        log_mass = log_mass + 0.5 * np.linalg.slogdet(optimum.covariance)[1]
        log_mass -= log_mass.max()
        kept = log_mass > _NEGLIGIBLE
        mass = np.exp(log_mass[kept])
        share = np.maximum(mass / mass.sum(), _LEAST_SHARE)
        self._share = np.append((1 - _PRIOR_SHARE) * share / share.sum(), _PRIOR_SHARE)
        self._problem = problem
        self._centre = np.array([problem.to_sampling(m.values) for m in optimum.minima])[kept]
        self._root = np.linalg.cholesky(optimum.covariance[kept])
        self._inverse = np.linalg.inv(self._root)

    def draw(self, n: int, random: np.random.RandomState) -> FloatArray:
        """Draw from it; (n, n_dim)."""
        which = random.choice(self._share.size, n, p=self._share)
        z = random.standard_normal((n, self._problem.n_dim)) / np.sqrt(random.chisquare(_TAILS, (n, 1)) / _TAILS)
        result: FloatArray = self._problem.prior_transform(random.uniform(size=z.shape))
        for k, (centre, root) in enumerate(zip(self._centre, self._root, strict=True)):
            result[which == k] = centre + z[which == k] @ root.T
        return result

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log of `g` at the rows of `u`; (n,)."""
        student = student_log_density(u, self._centre, self._inverse, _TAILS)
        return logsumexp(np.vstack([student, self._problem.log_prior(u)]), b=self._share[:, None], axis=0)

    def move(self, u: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        """A proposal for each walker, and its Metropolis-Hastings factor, as `emcee.moves.MHMove` takes them."""
        proposed = self.draw(len(u), random)
        return proposed, self.log_density(u) - self.log_density(proposed)

    def start(self, n_walkers: int, random: np.random.RandomState) -> FloatArray:
        """Draws where the posterior is finite; (n_walkers, n_dim)."""
        found = np.empty((0, self._problem.n_dim))
        while len(found) < n_walkers:
            draws = self.draw(n_walkers, random)
            found = np.concatenate([found, draws[np.isfinite(self._problem.log_posterior(draws))]])
        return found[:n_walkers]


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


@contextmanager
def _interruptible() -> Iterator[Callable[[], None]]:
    """Put Ctrl-C off until the function handed out is called: emcee prints a traceback of what interrupts it."""
    asked: list[int] = []

    def ask(number: int, frame: FrameType | None) -> None:
        asked.append(number)

    def stop_if_asked() -> None:
        if asked:
            raise KeyboardInterrupt

    previous = signal.getsignal(signal.SIGINT)
    # Only the main thread is interrupted, and a process in the background is not.
    ours = threading.current_thread() is threading.main_thread() and callable(previous)
    if ours:
        signal.signal(signal.SIGINT, ask)
    try:
        yield stop_if_asked
    finally:
        if ours:
            signal.signal(signal.SIGINT, previous)


def sample(
    problem: Problem,
    optimum: Optimum,
    *,
    seed: int,
    path: Path,
    identity: str,
    settings: Settings | None = None,
    progress: Callable[[Progress], None] = lambda state: None,
    ceiling: float = math.inf,
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
    ceiling : float
        A log posterior: a chain that has been higher is handed back as it is.

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
        _resume(backend, path, identity, (settings.n_walkers, problem.n_dim))
    else:
        backend.reset(settings.n_walkers, problem.n_dim)
    proposal = Proposal(problem, optimum)
    moves = [
        (emcee.moves.DEMove(), 0.3),
        (emcee.moves.DEMove(gamma0=1.0), 0.05),
        (emcee.moves.DESnookerMove(), 0.1),
        (emcee.moves.KDEMove(), 0.3),
        (emcee.moves.MHMove(proposal.move), 0.25),
    ]
    emulated = _emulated(problem, optimum, seed) if problem.terms else None
    if emulated is not None:
        moves = [(move, (1 - _STRIDES) * share) for move, share in moves]
        moves.append((emcee.moves.MHMove(_strides(emulated)), _STRIDES))
    sampler = emcee.EnsembleSampler(
        settings.n_walkers, problem.n_dim, problem.log_posterior, vectorize=True, backend=backend, moves=moves
    )
    if backend.iteration == 0:
        random = np.random.RandomState(seed)  # emcee draws from the legacy generator
        # Around a bent ridge the curvature's draws lie thousands of nats below it.
        near = emulated.scattered(settings.n_walkers, random) if emulated is not None else np.empty((0, problem.n_dim))
        others = proposal.start(settings.n_walkers - len(near), random)
        start = emcee.State(np.concatenate([near, others]), random_state=random.get_state())
    else:
        start = backend.get_last_sample()
    with _interruptible() as stop_if_asked:
        while True:
            if backend.iteration:
                chain = chain_of(backend, settings)
                kept, tau = chain.draws.shape[1], float(chain.autocorrelation_time.max())
                left = 0 if chain.converged else steps_left(kept, tau, float(chain.r_hat.max()), settings)
                progress(Progress(int(backend.iteration), left, kept / tau, float(chain.r_hat.max()), chain.acceptance))
                if chain.converged or backend.iteration >= settings.max_steps or chain.height > ceiling:
                    return chain
            for state in sampler.sample(start, iterations=settings.chunk, skip_initial_state_check=True):
                start = state
                stop_if_asked()
            _checkpoint(backend, path, identity)
            stop_if_asked()


def _emulated(problem: Problem, optimum: Optimum, seed: int) -> Emulated:
    """The posterior, emulated around the minima."""
    places = np.array([problem.to_sampling(m.values) for m in optimum.minima])
    return emulate(settle_at(problem, np.clip(places, *problem.bounds.T)), seed=seed, **_CAREFULLY)


def _strides(emulated: Emulated) -> Callable[[FloatArray, np.random.RandomState], tuple[FloatArray, FloatArray]]:
    """Proposals by strides through an emulated posterior, as `emcee.moves.MHMove` takes them."""

    def move(u: FloatArray, random: np.random.RandomState) -> tuple[FloatArray, FloatArray]:
        # Seeded by the chain's own generator, whose state is in the checkpoint.
        return emulated.wander(u, np.random.default_rng(random.randint(0, 2**32, size=4, dtype=np.uint32)))

    return move


def chain_of(backend: emcee.backends.Backend, settings: Settings) -> Chain:
    """The draws in a back-end after burn-in, and whether they suffice."""
    n = backend.iteration
    steps = backend.get_chain()
    burn, tau = _state(steps)
    kept = n - burn
    draws = np.swapaxes(steps[burn:], 0, 1).copy()
    heights = backend.get_log_prob()
    top = np.unravel_index(np.argmax(heights), heights.shape)
    r_hat = store.r_hat(draws)
    converged = bool(
        kept >= settings.autocorrelation_times * tau.max()
        and kept * settings.n_walkers / tau.max() >= settings.effective_samples
        and r_hat.max() < settings.r_hat
    )
    return Chain(
        draws,
        heights[burn:].T.copy(),
        tau,
        r_hat,
        burn,
        float(np.mean(backend.accepted / n)),
        converged,
        steps[top].copy(),
        float(heights[top]),
    )


def steps_left(kept: int, tau: float, r_hat: float, settings: Settings) -> int:
    """Steps that a chain which has not converged would still take, at least a chunk: the later, the better it is known.

    Parameters
    ----------
    kept : int
        Steps after burn-in.
    tau, r_hat : float
        The longest autocorrelation time, steps, and the largest R-hat.
    settings : Settings
    """
    # The excess of R-hat falls as the chain grows, so that its goal is a length, too.
    wanted = max(
        settings.autocorrelation_times * tau,
        settings.effective_samples * tau / settings.n_walkers,
        kept * (r_hat - 1) / (settings.r_hat - 1),
    )
    return settings.chunk * max(math.ceil((wanted - kept) / settings.chunk), 1)


def _checkpoint(backend: emcee.backends.Backend, path: Path, identity: str) -> None:
    """Write the chain where `emcee.backends.HDFBackend(path, name="psafit")` finds it, in one step."""
    with replacing(path) as temporary:
        # Its chunks are allocated whole; the rest is names and the generator's state.
        reserve(temporary, 2 * (backend.chain.nbytes + backend.log_prob.nbytes) + store.HDF5_FRAME)
        stored = emcee.backends.HDFBackend(str(temporary), name=GROUP)
        stored.reset(*backend.shape)
        stored.grow(backend.iteration, None)
        with stored.open("a") as f:
            f.attrs["identity"] = identity
            group = f[GROUP]
            group["chain"][:] = backend.chain
            group["log_prob"][:] = backend.log_prob
            group["accepted"][:] = backend.accepted
            group.attrs["iteration"] = backend.iteration
            for i, part in enumerate(backend.random_state):
                group.attrs[f"random_state_{i}"] = part


def _resume(backend: emcee.backends.Backend, path: Path, identity: str, shape: tuple[int, int]) -> None:
    """Fill an empty back-end from a checkpoint of the same run; `shape` is (n_walkers, n_dim)."""
    try:
        with h5py.File(path, "r") as f:
            found = str(f.attrs["identity"])
        stored = emcee.backends.HDFBackend(str(path), name=GROUP, read_only=True)
        backend.reset(*shape)
        backend.chain, backend.log_prob = stored.get_chain(), stored.get_log_prob()
        backend.accepted, backend.iteration = stored.accepted, int(stored.iteration)
        backend.random_state = tuple(stored.random_state)
        np.random.RandomState().set_state(backend.random_state)  # raises where it is none
        wanted = (backend.iteration, *shape)
        if backend.iteration and (backend.chain.shape, backend.log_prob.shape) != (wanted, wanted[:2]):
            raise ValueError(f"a chain of shape {backend.chain.shape}")
        if not (np.isfinite(backend.chain).all() and np.isfinite(backend.log_prob).all()):
            raise ValueError("values that are not finite")
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError) as error:
        what = "not a chain written by psafit, or damaged"
        raise read_error(error, path, what, "choose another --out, or move it elsewhere to draw anew") from error
    if found != identity:
        raise InputError(
            "belongs to another run (other data, groups, terms, seed or version)",
            "choose another --out, or move it elsewhere to draw anew",
            file=path,
        )

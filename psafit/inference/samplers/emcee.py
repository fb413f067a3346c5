"""Posterior draws by emcee, with a checkpoint that survives anything.

Several ensembles of walkers run side by side, each with its own seed: whether they agree is what R-hat measures. Steps
are drawn in memory; after every chunk all chains go to an HDF5 file of emcee's own format, swapped in by one rename.
Whatever kills the run, consistent chains with their generators' states are there to go on from, and a resumed run draws
what an undisturbed one would have drawn.

Walkers begin at importance draws. emcee's ensemble moves cannot carry a lone walker out of a mode that no other walker
shares, and creep along bent ridges. So in most moves walkers change places with chains in the emulated posterior
(`psafit.inference.surrogate.Companions`), and some are independent draws from a fixed density that reaches everywhere:
see `psafit.inference.surrogate.IndependenceProposal`.
"""

from __future__ import annotations

import math
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TypeAlias, cast

import emcee
import h5py
import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import Refused, read_error, replacing, reserve
from psafit.inference import store
from psafit.inference.problem import Problem
from psafit.inference.sampling import Chain, Progress, SamplerSettings, Target
from psafit.inference.surrogate import Companions, IndependenceProposal, Surrogate

GROUP = "psafit"
_Moves: TypeAlias = Sequence[tuple[emcee.moves.Move, float]]


@dataclass(frozen=True)
class Settings(SamplerSettings):
    """How many walkers, how they move, and when they stop.

    Parameters
    ----------
    n_walkers : int
        Of each ensemble.
    ensembles : int
        With seeds of their own; R-hat is taken over them.
    chunk : int
        Steps between checkpoints and checks.
    autocorrelation_times : float
        Length of the chains after burn-in, in units of the slowest parameter's autocorrelation time.
    effective_samples : float
        Wanted of the worst parameter (steps x all walkers / autocorrelation time).
    r_hat : float
        Largest rank-normalised split R-hat (ArviZ, every ensemble a chain) that counts as mixed.
    tuned : int
        Steps after which the emulated posterior is made anew, of the walkers' own draws, too. So it is after a third of
        them, and whenever three times as many are done: walkers may reach late what importance draws did not show. All
        steps until then are burn-in, and `tuned` of them at least.
    tuned_by : int
        Such draws, the last.
    exchanges, independent : float
        Shares of the moves that change places with companions, and that are independent draws. The others are emcee's:
        differential evolution, of some coordinates mostly (`PartMove`), and snooker.
    companions : int
        Chains in the emulated posterior with which an ensemble changes places, if it has no more walkers.
    batch : int
        Readings up to which a simulation takes hardly longer than its call.
    """

    n_walkers: int = 16
    ensembles: int = 4
    chunk: int = 250
    autocorrelation_times: float = 50.0
    effective_samples: float = 1000.0
    r_hat: float = 1.01
    tuned: int = 150
    tuned_by: int = 1500
    exchanges: float = 0.6
    independent: float = 0.1
    companions: int = 500
    batch: int = 1000

    def tuned_at(self, steps: int) -> int:
        """Steps of those done by which the moves are tuned."""
        return self._tunings(steps)[0]

    def until(self, steps: int) -> int:
        """Steps at which the next chunk ends."""
        return min(n for n in (self._tunings(steps)[1], steps + self.chunk, self.max_steps) if n > steps)

    def _tunings(self, steps: int) -> tuple[int, int]:
        """Steps after which moves were tuned last, if so many are done, and will be next.

        They never are where `tuned` is 0, nor so late that less than half of all steps would be left.
        """
        last, following = 0, math.ceil(self.tuned / 3)
        while 0 < following <= min(steps, self.max_steps // 2):
            last, following = following, 3 * following
        return last, following

    @classmethod
    def of(cls, problem: Problem) -> Settings:
        """Walkers by the number of parameters: moves between walkers need a crowd in every direction."""
        return cls(n_walkers=max(cls.n_walkers, 2 * problem.n_dim + 4))


class ResampledMove(emcee.moves.Move):  # type: ignore[misc]
    """Independent draws of a density, of which one or the place itself is taken by their importance weights.

    Several draws at once leave a place where one would be refused for long (C. Andrieu, A. Lee and M. Vihola, Bernoulli
    24 (2018) 842: the iterated sampling importance resampling).

    Parameters
    ----------
    proposal : IndependenceProposal
    tries : int
        Draws for each walker.
    """

    def __init__(self, proposal: IndependenceProposal, tries: int) -> None:
        self._proposal, self._tries = proposal, tries

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, NDArray[np.bool_]]:
        """Move all walkers; as emcee asks for it."""
        random = _generator(model.random)
        drawn = self._proposal.draw(len(state.coords) * self._tries, random)
        log_posterior, _ = model.compute_log_prob_fn(drawn)
        u, value = self._proposal.resampled(state.coords, state.log_prob, drawn, log_posterior, random)
        return _ended(self, state, u, value)


class ExchangeMove(emcee.moves.Move):  # type: ignore[misc]
    """Companions take a step, and change places with walkers."""

    def __init__(self, companions: Companions) -> None:
        self.companions = companions

    def propose(self, model: Any, state: emcee.State) -> tuple[emcee.State, NDArray[np.bool_]]:
        """Move all walkers; as emcee asks for it."""
        random = _generator(model.random)
        self.companions.walk(random)
        u, value = self.companions.exchange(
            state.coords, state.log_prob, lambda there: np.asarray(model.compute_log_prob_fn(there)[0]), random
        )
        return _ended(self, state, u, value)


def _ended(
    move: emcee.moves.Move, state: emcee.State, u: FloatArray, value: FloatArray
) -> tuple[emcee.State, NDArray[np.bool_]]:
    """What a move returns that has led walkers to `u`, where the log posterior is `value`."""
    moved = (u != state.coords).any(axis=1)
    return move.update(state, emcee.State(u, log_prob=value), moved), moved


class PartMove(emcee.moves.DEMove):  # type: ignore[misc]
    """Differential evolution of some coordinates, the others as they are.

    No difference of two walkers leads along a bent and thin posterior from everywhere. One in a single coordinate, the
    scatter's or one that hardly acts there, may. How many coordinates is drawn for each walker, and then which (J. A.
    Vrugt et al., Int. J. Nonlinear Sci. Numer. Simul. 10 (2009) 273). Where the posterior is narrower than elsewhere,
    only a short step is accepted.

    Parameters
    ----------
    shortest : float
        Least length, as a part of what suits a normal density; its logarithm is drawn evenly up to one.
    """

    def __init__(self, shortest: float = 0.03) -> None:
        super().__init__()
        self._shortest = shortest

    def get_proposal(
        self, s: FloatArray, c: Sequence[FloatArray], random: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray]:
        """A proposal for each walker of `s` by those of `c`, and its Metropolis-Hastings factor."""
        moved, factor = super().get_proposal(s, c, random)
        rank = random.uniform(size=s.shape).argsort(axis=1)
        n_moved = random.randint(1, s.shape[1] + 1, size=(len(s), 1))
        length = np.sqrt(s.shape[1] / n_moved) * self._shortest ** random.uniform(size=(len(s), 1))
        step = (moved - s) * length
        return s + np.where(rank < n_moved, step, 0.0), factor


def tuned(target: Target, settings: Settings, steps: FloatArray) -> Surrogate:
    """The posterior, emulated from the importance draws and the walkers' steps, (n_steps, n_all, n_dim), if any."""
    u, weights = target.draws.draws, target.draws.weights
    if len(steps):
        own = np.unique(steps.reshape(-1, steps.shape[2])[-8 * settings.tuned_by :], axis=0)
        own = own[np.linspace(0, len(own) - 1, min(settings.tuned_by, len(own))).astype(int)]
        # What stands for the posterior now; the others still show what lies around it.
        u, weights = np.concatenate([own, u]), np.repeat([1.0 / len(own), 0.0], [len(own), len(u)])
    return Surrogate(target.found, u, weights, seed=target.seed)


def moves(
    surrogate: Surrogate, settings: Settings, n_readings: int, random: np.random.Generator
) -> list[tuple[emcee.moves.Move, float]]:
    """The moves of an ensemble, each with its share."""
    own = 1 - settings.exchanges - settings.independent
    companions = Companions(surrogate, max(settings.companions, settings.n_walkers), random)
    # As many tries as are worth a draw of the posterior; but together no more sets than the other moves simulate,
    # unless they are so few readings that these cost hardly more than the call.
    as_others = int((1 - settings.independent) / settings.independent)
    tries = min(surrogate.needed, max(as_others, settings.batch // (settings.n_walkers * n_readings), 1))
    return [
        (PartMove(), 0.6 * own),
        (emcee.moves.DEMove(gamma0=1.0), 0.1 * own),
        (emcee.moves.DESnookerMove(), 0.3 * own),
        (ResampledMove(surrogate.everywhere, tries), settings.independent),
        (ExchangeMove(companions), settings.exchanges),
    ]


def _generator(random: np.random.RandomState) -> np.random.Generator:
    """A modern generator, seeded by the chain's own, whose state is in the checkpoint."""
    return np.random.default_rng(random.randint(0, 2**32, size=4, dtype=np.uint32))


def autocorrelation_time(draws: FloatArray) -> FloatArray:
    """Integrated autocorrelation time of each parameter, steps; `draws` is (n_walkers, n_steps, n_dim)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tau = emcee.autocorr.integrated_time(np.swapaxes(draws, 0, 1), tol=0, quiet=True)
    # A walker that never moved in a short stretch has none: then the stretch is too short for one.
    return np.where(np.isfinite(tau), np.maximum(tau, 1.0), float(draws.shape[1]))


def _state(chain: FloatArray, tuned: int) -> tuple[int, FloatArray]:
    """Burn-in (steps) and autocorrelation times after it; `chain` is (n_steps, n_walkers, n_dim)."""
    half = np.swapaxes(chain[len(chain) // 2 :], 0, 1)
    burn = max(min(int(10 * autocorrelation_time(half).max()), len(chain) // 2), tuned)
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


@dataclass(frozen=True, eq=False)
class History:
    """All steps of all ensembles.

    Parameters
    ----------
    chain : (n_steps, n_all, n_dim) array
        Walkers of one ensemble stand together.
    log_prob : (n_steps, n_all) array
    accepted : (n_all,) array
        Moves accepted.
    """

    chain: FloatArray
    log_prob: FloatArray
    accepted: FloatArray

    @classmethod
    def of(cls, backends: Sequence[emcee.backends.Backend]) -> History:
        """What the back-ends of the ensembles hold."""
        return cls(
            np.concatenate([b.get_chain() for b in backends], axis=1),
            np.concatenate([b.get_log_prob() for b in backends], axis=1),
            np.concatenate([b.accepted for b in backends]),
        )


class Emcee:
    """Ensembles of walkers, each with its own seed, until their rule is met."""

    about = "emcee: exchanges with the emulated posterior, independent draws, differential evolution"
    libraries = ("emcee",)
    chained = checked = True

    def settings(self, problem: Problem) -> Settings:
        """Its settings for a problem."""
        return Settings.of(problem)

    def draw(self, target: Target, settings: Settings, progress: Callable[[Progress], None]) -> Chain:
        """Draw from the posterior, going on from the checkpoint where there is one."""
        problem = target.problem
        return run(
            problem.log_posterior,
            lambda random: target.draws.distinct(settings.n_walkers, random),
            lambda steps: partial(moves, tuned(target, settings, steps), settings, problem.observed.size),
            n_dim=problem.n_dim,
            seed=target.seed,
            path=target.path,
            identity=target.identity,
            settings=settings,
            progress=progress,
            ceiling=target.ceiling,
        )

    def look(self, path: Path, settings: Mapping[str, int | float], n_dim: int, values: int) -> Progress | None:
        """Every so many-th step of the checkpoint's chains, and what they say."""
        found = _read(path, n_dim, values)
        if found is None:
            return None
        steps, every, history = found
        own = Settings(**cast(dict[str, Any], settings))
        thinned = replace(own, tuned=own.tuned // every)
        return _progress(chain_of(history, thinned, own.tuned_at(steps - 1) // every), steps, own, every)


SAMPLER = Emcee()


def run(
    log_posterior: Callable[[FloatArray], FloatArray],
    begin: Callable[[np.random.Generator], FloatArray],
    moves: Callable[[FloatArray], Callable[[np.random.Generator], _Moves]],
    *,
    n_dim: int,
    seed: int,
    path: Path,
    identity: str,
    settings: Settings,
    progress: Callable[[Progress], None] = lambda state: None,
    ceiling: float = math.inf,
) -> Chain:
    """Run ensembles until their rule is met, going on from the checkpoint at `path` where there is one.

    Parameters
    ----------
    log_posterior : callable
        Of (n, n_dim) coordinates.
    begin : callable
        Takes a generator and returns where the walkers of an ensemble start, (n_walkers, n_dim).
    moves : callable
        Takes the steps by which moves are tuned, (n_steps, n_all, n_dim), and returns what makes an ensemble's moves
        with their shares, by a generator. Places of the companions among them are a part of the checkpoint.
    n_dim, seed : int
    path : Path
        HDF5 checkpoint (`emcee.backends.HDFBackend` reads it).
    identity : str
        What the chains belong to; a checkpoint of something else is refused.
    settings : Settings
    progress : callable
        Called with a `Progress` after every chunk.
    ceiling : float
        A log posterior: chains that have been higher are handed back as they are.

    Returns
    -------
    Chain

    Raises
    ------
    InputError
        If `path` is not a checkpoint of this very run.
    """
    shape = settings.n_walkers, n_dim
    backends = [emcee.backends.Backend() for _ in range(settings.ensembles)]
    kept: list[FloatArray] = []
    tuned_at = -1
    if path.exists():
        kept, tuned_at = _resume(backends, path, identity, shape)
    else:
        for backend in backends:
            backend.reset(*shape)
    if backends[0].iteration:
        states = [backend.get_last_sample() for backend in backends]
    else:
        states = [_begun(begin, seed, k) for k in range(settings.ensembles)]
    chosen: list[_Moves] = []
    with _interruptible() as stop_if_asked:
        while True:
            done = backends[0].iteration
            if done:
                chain = chain_of(History.of(backends), settings, settings.tuned_at(done - 1))
                progress(_progress(chain, done, settings))
                if chain.converged or done >= settings.max_steps or chain.highest_log_posterior > ceiling:
                    return chain
            if not chosen or tuned_at != settings.tuned_at(done):
                known = kept if tuned_at == settings.tuned_at(done) else []
                tuned_at = settings.tuned_at(done)
                made = moves(History.of(backends).chain[:tuned_at] if tuned_at else np.empty((0, 1, n_dim)))
                # A stream of its own, not that in which walkers begin.
                chosen = _chosen(made, [1, seed, tuned_at], settings.ensembles, known)
            for k, backend in enumerate(backends):
                sampler = emcee.EnsembleSampler(*shape, log_posterior, vectorize=True, backend=backend, moves=chosen[k])
                n = settings.until(done) - done
                for state in sampler.sample(states[k], iterations=n, skip_initial_state_check=True):
                    states[k] = state
                    stop_if_asked()
            _checkpoint(backends, path, identity, [own.state for own in _companions(chosen)], tuned_at)
            stop_if_asked()


def _chosen(
    made: Callable[[np.random.Generator], _Moves], seed: list[int], ensembles: int, kept: Sequence[FloatArray]
) -> list[_Moves]:
    """The moves of each ensemble; companions go on from the states that were kept, if there are any."""
    chosen = [made(np.random.default_rng([*seed, k])) for k in range(ensembles)]
    for own, state in zip(_companions(chosen), kept, strict=bool(kept)):
        own.state = state
    return chosen


def _companions(chosen: Sequence[_Moves]) -> list[Companions]:
    """The companions among the moves of all ensembles."""
    return [move.companions for own in chosen for move, _ in own if isinstance(move, ExchangeMove)]


def _begun(begin: Callable[[np.random.Generator], FloatArray], seed: int, ensemble: int) -> emcee.State:
    """Where an ensemble starts, and its generator."""
    sequence = np.random.SeedSequence([seed, ensemble])
    own = np.random.RandomState(np.random.MT19937(sequence.spawn(1)[0]))
    return emcee.State(begin(np.random.default_rng(sequence)), random_state=own.get_state())


def by_ensemble(draws: FloatArray, ensembles: int) -> FloatArray:
    """Draws of all walkers, (n_all, n_steps, n_dim), as one chain an ensemble, step after step."""
    _, n_steps, n_dim = draws.shape
    return np.swapaxes(draws.reshape(ensembles, -1, n_steps, n_dim), 1, 2).reshape(ensembles, -1, n_dim)


def chain_of(history: History, settings: Settings, tuned: int) -> Chain:
    """The draws after burn-in, and whether they suffice; the moves were tuned by the first `tuned` steps."""
    burn, tau = _state(history.chain, tuned)
    n, n_all = history.log_prob.shape
    kept = n - burn
    draws = np.swapaxes(history.chain[burn:], 0, 1).copy()
    top = np.unravel_index(np.argmax(history.log_prob), history.log_prob.shape)
    r_hat = store.r_hat(by_ensemble(draws, settings.ensembles))
    converged = bool(
        burn >= settings.tuned
        and kept >= settings.autocorrelation_times * tau.max()
        and kept * n_all / tau.max() >= settings.effective_samples
        and r_hat.max() < settings.r_hat
    )
    return Chain(
        draws,
        history.log_prob[burn:].T.copy(),
        tau,
        r_hat,
        burn,
        float(np.mean(history.accepted / n)),
        converged,
        history.chain[top].copy(),
        float(history.log_prob[top]),
    )


def _progress(chain: Chain, steps: int, settings: Settings, every: int = 1) -> Progress:
    """What a chain, of every so many-th step, says of how far it is."""
    kept, n_all = chain.draws.shape[1], chain.draws.shape[0]
    tau, r_hat = float(chain.autocorrelation_time.max()), float(chain.r_hat.max())
    left = 0 if chain.converged else steps_left(every * kept, every * tau, r_hat, settings)
    return Progress(
        steps=steps,
        steps_left=left,
        chunk=settings.chunk,
        converged=chain.converged,
        walkers=n_all,
        acceptance=chain.acceptance,
        autocorrelation_time=every * tau,
        autocorrelation_times=kept / tau,
        wanted_times=settings.autocorrelation_times,
        r_hat=r_hat,
        wanted_r_hat=settings.r_hat,
        log_posterior=chain.highest_log_posterior,
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
        settings.effective_samples * tau / (settings.n_walkers * settings.ensembles),
        kept * (r_hat - 1) / (settings.r_hat - 1),
    )
    return settings.chunk * max(math.ceil((wanted - kept) / settings.chunk), 1)


def _checkpoint(
    backends: Sequence[emcee.backends.Backend],
    path: Path,
    identity: str,
    companions: Sequence[FloatArray],
    tuned_at: int,
) -> None:
    """Write the chains where `emcee.backends.HDFBackend(path, name="psafit")` finds them, in one step."""
    history, n_steps = History.of(backends), backends[0].iteration
    with replacing(path) as temporary:
        # Its chunks are allocated whole; the rest is names and the generators' states.
        size = history.chain.nbytes + history.log_prob.nbytes + sum(own.nbytes for own in companions)
        reserve(temporary, 2 * size + store.HDF5_FRAME)
        stored = emcee.backends.HDFBackend(str(temporary), name=GROUP)
        stored.reset(*history.chain.shape[1:])
        stored.grow(n_steps, None)
        with stored.open("a") as f:
            f.attrs["identity"] = identity
            group = f[GROUP]
            group["chain"][:] = history.chain
            group["log_prob"][:] = history.log_prob
            group["accepted"][:] = history.accepted
            group.attrs["iteration"] = n_steps
            group["companions"] = np.array(companions)
            group.attrs["tuned_at"] = tuned_at
            for k, backend in enumerate(backends):
                for i, part in enumerate(backend.random_state):
                    group.attrs[f"random_state_{i}" if k == 0 else f"random_state_{i}_of_{k}"] = part


def _resume(
    backends: Sequence[emcee.backends.Backend], path: Path, identity: str, shape: tuple[int, int]
) -> tuple[list[FloatArray], int]:
    """Fill empty back-ends from a checkpoint of the same run; `shape` is (n_walkers, n_dim).

    Returns
    -------
    list of arrays, int
        The state of each ensemble's companions, and after how many steps their moves were tuned.
    """
    try:
        with h5py.File(path, "r") as f:
            found, group = str(f.attrs["identity"]), f[GROUP]
            n_steps, tuned_at = (int(group.attrs[name]) for name in ("iteration", "tuned_at"))
            arrays = [np.asarray(group[name]) for name in ("chain", "log_prob", "accepted", "companions")]
            states = [
                tuple(group.attrs[f"random_state_{i}" if k == 0 else f"random_state_{i}_of_{k}"] for i in range(5))
                for k in range(len(backends))
            ]
        n_all = len(backends) * shape[0]
        wanted = [(n_steps, n_all, shape[1]), (n_steps, n_all), (n_all,)]
        companions = arrays[3].shape[::2] in ((len(backends), shape[1] + 1), (0,))
        if n_steps < 1 or [a.shape for a in arrays[:3]] != wanted or not companions:
            raise ValueError(f"chains of shape {arrays[0].shape}")
        if not all(np.isfinite(a).all() for a in arrays):
            raise ValueError("values that are not finite")
        for k, backend in enumerate(backends):
            np.random.RandomState().set_state(states[k])  # raises where it is none
            own = slice(k * shape[0], (k + 1) * shape[0])
            backend.reset(*shape)
            backend.chain, backend.log_prob = arrays[0][:, own].copy(), arrays[1][:, own].copy()
            backend.accepted, backend.iteration = arrays[2][own].copy(), n_steps
            backend.random_state, backend.initialized = states[k], True
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, AttributeError) as error:
        what = "not a chain written by psafit, or damaged"
        raise read_error(error, path, what, "choose another --out, or move it elsewhere to draw anew") from error
    if found != identity:
        raise InputError(
            "belongs to another run (other data, groups, terms, seed or version)",
            "choose another --out, or move it elsewhere to draw anew",
            file=path,
        )
    return list(arrays[3]), tuned_at


def _read(path: Path, n_dim: int, values: int) -> tuple[int, int, History] | None:
    """Steps done, and every so many-th step of a checkpoint, or None where there is none to be read.

    Nothing is locked for it.
    """
    try:
        with h5py.File(path, "r", locking=False) as f:
            group = f[GROUP]
            if group["chain"].dtype.kind != "f" or group["chain"].shape[2] != n_dim:
                return None
            n = int(group.attrs["iteration"])
            every = math.ceil(n * math.prod(group["chain"].shape[1:]) / values) or 1
            arrays = group["chain"][:n:every], group["log_prob"][:n:every], group["accepted"][:] / every
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:  # as h5py says: not there, not yet, or
        refused = read_error(error, path, "", "")  # foreign, or the system does not let us look
        if isinstance(refused, Refused):
            raise refused from error
        return None
    history = History(*arrays)
    sound = n and np.isfinite(history.log_prob).all() and np.isfinite(history.chain).all()
    return (n, every, history) if sound else None

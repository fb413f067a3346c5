"""A whole posterior, emulated from importance draws, and chains in it, which cost no simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import Emulated, Pool, laplace_mixture, on_plateaus, separated
from psafit.inference.mixture import StudentMixture
from psafit.inference.optimiser import log_posteriors
from psafit.inference.problem import Problem


@dataclass(frozen=True, eq=False)
class IndependenceProposal:
    r"""A density near the posterior that reaches every mode from anywhere.

    .. math:: g(u) = s\, \pi(u) + (1 - s) \sum_k w_k\, t(u \mid u_k, C_k),

    the prior with its share and the Student densities of all modes. A walker leaves any place whose likelihood is below
    a tenth of the known modes' evidence as soon as a draw lands in one of them; and modes get the weights they have,
    not those they started with.

    Parameters
    ----------
    problem : Problem
    mixture : StudentMixture
    prior_share : float
    """

    problem: Problem
    mixture: StudentMixture
    prior_share: float = 0.1

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draw from it; (n, n_dim)."""
        found = self.mixture.scatter(n, random)
        of_prior = random.uniform(size=n) < self.prior_share
        found[of_prior] = self.problem.prior_transform(random.uniform(size=(int(of_prior.sum()), found.shape[1])))
        return found

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log of `g` at the rows of `u`; (n,)."""
        prior = math.log(self.prior_share) + self.problem.log_prior(u)
        return np.asarray(np.logaddexp(prior, math.log1p(-self.prior_share) + self.mixture.log_density(u)))

    def resampled(
        self, u: FloatArray, value: FloatArray, drawn: FloatArray, values: FloatArray, random: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Choose one of each row of `u` and its draws by importance weights.

        Reversible in the density whose logarithm is given.

        Parameters
        ----------
        u, value : (n, n_dim) and (n,) array
            Places, and the log density there.
        drawn, values : (n * n_tries, n_dim) and (n * n_tries,) array
            Draws of `g`, those of a place together.
        random : Generator

        Returns
        -------
        (n, n_dim) and (n,) array
        """
        n = len(u)
        weight = np.column_stack(
            [value - self.log_density(u), (values - self.log_density(drawn)).reshape(n, -1)]
        )  # (n, 1 + n_tries)
        chosen = np.argmax(weight + random.gumbel(size=weight.shape), axis=1)
        row = np.arange(n) * (weight.shape[1] - 1) + np.maximum(chosen - 1, 0)
        stays = chosen == 0
        return np.where(stays[:, None], u, drawn[row]), np.where(stays, value, values[row])


class Surrogate:
    """The posterior of a model, emulated on each of its modes from the draws that lie there.

    Parameters
    ----------
    candidate : Candidate
        Its modes.
    draws : (n, n_dim) array
        Sampling coordinates within the bounds at which it is simulated.
    weights : (n,) array
        What each is worth as a draw of the posterior; some may be zero.
    seed : int
    caution : float
        Share of `everywhere` in it: a polynomial does not follow readings that jump, nor a posterior that few readings
        leave nearly as wide as the prior, and no proposal would leave where it is far too low.
    probes : int
        Draws by which `needed` is counted.
    """

    def __init__(
        self,
        candidate: Candidate,
        draws: FloatArray,
        weights: FloatArray,
        *,
        seed: int,
        caution: float = 0.25,
        probes: int = 1024,
    ) -> None:
        self._caution = caution
        problem = candidate.problem
        random = np.random.default_rng([seed, 6])
        modes, self._nearest = separated(candidate)
        of, predicted = self._nearest(draws), problem.predict(draws)
        log_posterior = log_posteriors(problem, draws, predicted, problem.observed)
        self._parts: dict[int, Emulated] = {}
        mixtures = []
        for k, mode in enumerate(modes):
            own = of == k
            if weights[own].any():  # else nothing of the posterior is there
                with np.errstate(divide="ignore"):
                    pool = Pool(draws[own], log_posterior[own], np.log(weights[own]), int(own.sum()))
                plateau = on_plateaus(mode)
                before = laplace_mixture(plateau).around(pool.u, pool.weights, problem.widths)
                self._parts[k] = part = Emulated(plateau, pool, predicted[own], before, random)
                mixtures.append(StudentMixture.joined([before, part.mixture], np.ones(2)))
        log_mass = np.array([part.log_evidence for part in self._parts.values()])
        self._log_evidence = float(np.logaddexp.reduce(log_mass))
        mixture = StudentMixture.joined(mixtures, np.exp(log_mass - log_mass.max()))
        self.everywhere = IndependenceProposal(problem, mixture)
        self.needed = self._needed(self.everywhere.draw(probes, random))

    def _needed(self, u: FloatArray) -> int:
        """How many draws of `everywhere` are worth one of the emulated posterior, from some of them, (n, n_dim)."""
        weight = self.log_density(u) - self.everywhere.log_density(u)
        weight = np.exp(weight - weight.max())
        return math.ceil(len(u) * np.sum(weight**2) / np.sum(weight) ** 2)

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Draws near its density, as a chain in it may begin with; (n, n_dim)."""
        share = np.exp([part.log_evidence - self._log_evidence for part in self._parts.values()])
        wide, *counts = random.multinomial(n, [self._caution, *(1 - self._caution) * share / share.sum()]).tolist()
        each = zip(self._parts.values(), counts, strict=True)
        found = [part.resampled(some, random) for part, some in each if some]
        return random.permutation(np.concatenate([self.everywhere.draw(wide, random), *found]))

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log density, not normalised: each row's emulator, that of its mode, and what reaches everywhere; (n,)."""
        mode = self._nearest(u)
        emulated = np.full(len(u), -np.inf)
        for k, part in self._parts.items():
            own = mode == k
            if own.any():
                emulated[own] = part.log_posterior(u[own])
        wide = self._log_evidence + self.everywhere.log_density(u)
        return np.asarray(np.logaddexp(math.log1p(-self._caution) + emulated, math.log(self._caution) + wide))


class Companions:
    """Chains in an emulated posterior, which change places with those in the posterior itself.

    They step by differential evolution among themselves (C. J. F. ter Braak, Stat. Comput. 16 (2006) 239), which costs
    no simulation, along ridges however bent. A walker at `u` and a companion at `v` change places with probability
    ``p(v) q(u) / p(u) q(v)``, where `p` is the posterior and `q` the emulated one. That leaves both densities as they
    are, as in parallel tempering (C. J. Geyer, Computing Science and Statistics 23 (1991) 156). Whatever the emulator
    is worth, the chain is exact.

    Parameters
    ----------
    surrogate : Surrogate
    n : int
        Number of them.
    random : Generator
        Draws where they begin.
    steps : int
        Taken before any exchange: only companions that have the emulated density leave the posterior as it is.
    """

    def __init__(self, surrogate: Surrogate, n: int, random: np.random.Generator, *, steps: int = 50) -> None:
        self._log_density = surrogate.log_density
        self.places = surrogate.draw(n, random)
        self._values = self._log_density(self.places)
        for _ in range(steps):
            self.walk(random)

    @property
    def state(self) -> FloatArray:
        """Where they are, and the emulated log density there, (n, n_dim + 1)."""
        return np.column_stack([self.places, self._values])

    @state.setter
    def state(self, state: FloatArray) -> None:
        self.places, self._values = state[:, :-1].copy(), state[:, -1].copy()

    def walk(
        self, random: np.random.Generator, *, shortest: float = 0.1, leaps: float = 0.1, jitter: float = 1e-5
    ) -> None:
        """Take one step of each, by differences of two of the other half.

        Parameters
        ----------
        random : Generator
        shortest : float
            Least length, as a part of what suits a normal density; its logarithm is drawn evenly up to one.
        leaps : float
            Share of steps by the whole difference, which lead from mode to mode.
        jitter : float
            Standard deviation of what is added, so that no two stay in one place.
        """
        n, d = self.places.shape
        half = np.array_split(random.permutation(n), 2)
        for own, others in (half, half[::-1]):
            pair = self.places[others[random.integers(others.size, size=(2, own.size))]]
            length = 2.38 / math.sqrt(2 * d) * shortest ** random.uniform(size=(own.size, 1))
            length = np.where(random.uniform(size=(own.size, 1)) < leaps, 1.0, length)
            step = length * (pair[0] - pair[1]) + jitter * random.standard_normal((own.size, d))
            there = self.places[own] + step
            values = self._log_density(there)
            with np.errstate(invalid="ignore"):
                taken = own[moved := np.log(random.uniform(size=own.size)) < values - self._values[own]]
            self.places[taken], self._values[taken] = there[moved], values[moved]

    def exchange(
        self,
        u: FloatArray,
        value: FloatArray,
        log_posterior: Callable[[FloatArray], FloatArray],
        random: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Let each walker change places with one of them, if that is accepted.

        Parameters
        ----------
        u, value : (n, n_dim) and (n,) array
            Walkers, no more than there are companions, and the log posterior there.
        log_posterior : callable
            Of (n, n_dim) coordinates.
        random : Generator

        Returns
        -------
        (n, n_dim) and (n,) array
            Where the walkers are then.
        """
        chosen = random.choice(len(self.places), len(u), replace=False)
        there, emulated = self.places[chosen], self._log_density(u)
        found = log_posterior(there)
        with np.errstate(invalid="ignore"):
            odds = found - value + emulated - self._values[chosen]
            moved = np.log(random.uniform(size=len(u))) < odds
        gone = chosen[moved]
        self.places[gone], self._values[gone] = u[moved], emulated[moved]
        return np.where(moved[:, None], there, u), np.where(moved, found, value)

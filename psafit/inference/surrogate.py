"""A whole posterior, emulated from importance draws: what a Markov chain strides through between two simulations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    strides : sequence of int
        Numbers of Metropolis steps in the emulated posterior between two in the posterior itself, each as likely as the
        others: few where the emulator is poor, many where it is good.
    length : float
        Of such a step, in the emulated posterior's widths over the root of the number of dimensions (G. O. Roberts, A.
        Gelman and W. R. Gilks, Ann. Appl. Probab. 7 (1997) 110).
    caution : float
        Share of `everywhere` in it: a polynomial does not follow readings that jump, nor a posterior that few readings
        leave nearly as wide as the prior, and no proposal would leave where it is far too low.
    tries : int
        Draws of `everywhere` of which a far stride takes one; none is simulated.
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
        strides: Sequence[int] = (1, 3, 10),
        length: float = 1.7,
        caution: float = 0.25,
        tries: int = 64,
        probes: int = 1024,
    ) -> None:
        self._strides, self._caution, self._tries = tuple(strides), caution, tries
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
        self._length = length / math.sqrt(problem.n_dim)
        log_mass = np.array([part.log_evidence for part in self._parts.values()])
        self._log_evidence = float(np.logaddexp.reduce(log_mass))
        mixture = StudentMixture.joined(mixtures, np.exp(log_mass - log_mass.max()))
        self.everywhere = IndependenceProposal(problem, mixture)
        self.needed = self._needed(self.everywhere.draw(probes, random))

    def _needed(self, u: FloatArray) -> int:
        """How many draws of `everywhere` are worth one of the emulated posterior, from some of them, (n, n_dim)."""
        weight = self._log_posterior(u, self._nearest(u)) - self.everywhere.log_density(u)
        weight = np.exp(weight - weight.max())
        return math.ceil(len(u) * np.sum(weight**2) / np.sum(weight) ** 2)

    def wander(self, u: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Take a few steps in the emulated posterior from each row of `u`.

        The steps are reversible in it, so that the end is accepted as a step in the posterior `p` with probability
        ``p(u') q(u) / p(u) q(u')``, where `q` is the emulated density (J. S. Liu, Monte Carlo Strategies in Scientific
        Computing, Springer 2001, section 9.4.3: the surrogate transition method). Whatever the emulator is worth, the
        chain is exact.

        Parameters
        ----------
        u : (n, n_dim) array
        random : Generator

        Returns
        -------
        (n, n_dim) array and (n,) array
            Where the steps end, and ``ln q(u) - ln q(u')``.
        """
        mode = self._nearest(u)
        begun = self._log_posterior(u, mode)
        # One kind of step for all, chosen by chance: a fixed order of kinds would not be reversible. From where the
        # emulated density is far too low, no far end is accepted.
        if random.uniform() < 0.5:
            here, ended = self._walked(u, begun, mode, random)
        else:
            drawn = self.everywhere.draw(len(u) * self._tries, random)
            values = self._log_posterior(drawn, self._nearest(drawn))
            here, ended = self.everywhere.resampled(u, begun, drawn, values, random)
        with np.errstate(invalid="ignore"):
            gone = begun - ended
        return here, np.where(np.isnan(gone), -np.inf, gone)

    def _walked(
        self, here: FloatArray, log_posterior: FloatArray, mode: NDArray[np.intp], random: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Where some near Metropolis steps lead, and the emulated log density there."""
        for _ in range(random.choice(self._strides)):
            there = here + self._jumps(mode, random.standard_normal(here.shape))
            on = self._nearest(there)
            found = self._log_posterior(there, on)
            # Another mode has other widths: no step of this kind leads back.
            with np.errstate(invalid="ignore"):
                accepted = (on == mode) & (np.log(random.uniform(size=len(here))) < found - log_posterior)
            here, log_posterior = np.where(accepted[:, None], there, here), np.where(accepted, found, log_posterior)
        return here, log_posterior

    def _jumps(self, mode: NDArray[np.intp], normal: FloatArray) -> FloatArray:
        """Steps with each mode's own widths; none where no emulator is."""
        steps = np.zeros_like(normal)
        for k, part in self._parts.items():
            steps[mode == k] = self._length * normal[mode == k] @ part.root.T
        return steps

    def _log_posterior(self, u: FloatArray, mode: NDArray[np.intp]) -> FloatArray:
        """Log density, not normalised: each row's emulator, that of its mode, and what reaches everywhere."""
        emulated = np.full(len(u), -np.inf)
        for k, part in self._parts.items():
            own = mode == k
            if own.any():
                emulated[own] = part.log_posterior(u[own])
        wide = self._log_evidence + self.everywhere.log_density(u)
        return np.asarray(np.logaddexp(math.log1p(-self._caution) + emulated, math.log(self._caution) + wide))

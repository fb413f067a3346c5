"""A whole posterior, emulated from importance draws: what a Markov chain strides through between two simulations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import Emulated, Pool, laplace_mixture, on_plateaus, separated
from psafit.inference.mixture import StudentMixture
from psafit.inference.optimiser import log_posteriors


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
        Share of Student densities in it: a polynomial does not follow readings that jump, and no proposal would leave
        where it is far too low.
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
    ) -> None:
        self._strides, self._caution, problem = tuple(strides), caution, candidate.problem
        random = np.random.default_rng([seed, 6])
        modes, self._nearest = separated(candidate)
        of, predicted = self._nearest(draws), problem.predict(draws)
        log_posterior = log_posteriors(problem, draws, predicted, problem.observed)
        self._parts: dict[int, Emulated] = {}
        self._mixtures: dict[int, StudentMixture] = {}
        for k, mode in enumerate(modes):
            own = of == k
            if weights[own].any():  # else nothing of the posterior is there
                with np.errstate(divide="ignore"):
                    pool = Pool(draws[own], log_posterior[own], np.log(weights[own]), int(own.sum()))
                plateau = on_plateaus(mode)
                before = laplace_mixture(plateau).around(pool.u, pool.weights, problem.widths)
                self._parts[k] = part = Emulated(plateau, pool, predicted[own], before, random)
                self._mixtures[k] = StudentMixture.joined([before, part.mixture], np.ones(2))
        self._length = length / math.sqrt(problem.n_dim)

    @cached_property
    def mixture(self) -> StudentMixture:
        """Student densities that resemble it: those of each mode, by what the mode holds."""
        log_mass = np.array([part.log_evidence for part in self._parts.values()])
        return StudentMixture.joined(list(self._mixtures.values()), np.exp(log_mass - log_mass.max()))

    def wander(self, u: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Take a few Metropolis steps in the emulated posterior from each row of `u`.

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
        here, mode = u, self._nearest(u)
        log_posterior = self._log_posterior(u, mode)
        begun = log_posterior
        # Half of the time all steps are near: from where the emulated density is far too low, no far end is accepted.
        near = 1.0 if random.uniform() < 0.5 else 0.5
        for _ in range(random.choice(self._strides)):
            # One kind of step for all, chosen by chance: a fixed order of kinds would not be reversible.
            if random.uniform() < near:
                there = here + self._jumps(mode, random.standard_normal(u.shape))
                on = self._nearest(there)
                # Another mode has other widths: no step of this kind leads back.
                ratio = np.where(on == mode, 0.0, -np.inf)
            else:
                there = self.mixture.scatter(len(u), random)
                on = self._nearest(there)
                ratio = self.mixture.log_density(here) - self.mixture.log_density(there)
            found = self._log_posterior(there, on)
            with np.errstate(invalid="ignore"):
                accepted = np.log(random.uniform(size=len(u))) < found - log_posterior + ratio
            here, log_posterior = np.where(accepted[:, None], there, here), np.where(accepted, found, log_posterior)
            mode = np.where(accepted, on, mode)
        with np.errstate(invalid="ignore"):
            gone = begun - log_posterior
        return here, np.where(np.isnan(gone), -np.inf, gone)

    def _jumps(self, mode: NDArray[np.intp], normal: FloatArray) -> FloatArray:
        """Steps with each mode's own widths; none where no emulator is."""
        steps = np.zeros_like(normal)
        for k, part in self._parts.items():
            steps[mode == k] = self._length * normal[mode == k] @ part.root.T
        return steps

    def _log_posterior(self, u: FloatArray, mode: NDArray[np.intp]) -> FloatArray:
        """Its log density, not normalised: emulator and Student densities of the mode that each row is on."""
        result = np.full(len(u), -np.inf)
        for k, part in self._parts.items():
            own = mode == k
            if own.any():
                wide = part.log_evidence + self._mixtures[k].log_density(u[own])
                emulated = math.log1p(-self._caution) + part.log_posterior(u[own])
                result[own] = np.logaddexp(emulated, math.log(self._caution) + wide)
        return result

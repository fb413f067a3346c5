r"""What a misfit may follow, how probable each is by the readings, and which measurement would distinguish them.

A discrepancy says that something smooth is left (`psafit.diagnose.discrepancy`); it does not say along what. With its
size `a`, its level `b` and its reach :math:`\ell`, each explanation is a normal law of what is left, relative to the
predictions, at two readings:

.. math:: a^2 e^{-\Delta^2/2\ell^2} + b^2 \delta_{gg'},

where :math:`\Delta` is the distance of their frequencies, of their amplitudes or of their predicted sizes (all in the
logarithm), whatever groups `g` they belong to. Of a misfit that belongs to sessions both parts are zero between groups,
and the first in a session to come; of one that is nothing but chance both are zero everywhere. The model's parameters
are integrated out with their priors. Hence each explanation has an evidence, and a normal law of readings that nobody
has made yet, given those that were: where these laws lie apart, a measurement decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.diagnose.discrepancy import Discrepancy, Expansion, prior_widths, stretch
from psafit.experiment import Occasions
from psafit.inference.candidate import Candidate
from psafit.simulate import Design, readings

Kind = Literal["chance", "session", "frequency", "amplitude", "size"]

TO_COME = -1
"""Session of readings to come."""

KINDS: dict[Kind, str] = {
    "chance": "is nothing but chance",
    "session": "belongs to sessions",
    "frequency": "follows the frequency",
    "amplitude": "follows the amplitude",
    "size": "follows the size of what is read",
}
"""What a misfit may do, in words."""


@dataclass(frozen=True)
class Explanation:
    """One thing that a misfit may follow.

    Parameters
    ----------
    kind : {"chance", "session", "frequency", "amplitude", "size"}
    probability : float
        Among these, which are equally probable before any reading.
    """

    kind: Kind
    probability: float


@dataclass(frozen=True, eq=False)
class Conditions:
    """Readings, made or not: what the laws of a discrepancy ask of them."""

    predicted: FloatArray  # (n,)
    free: FloatArray  # what the model's parameters do, in units of their priors' widths, (n, n_model)
    along: dict[Kind, FloatArray]  # logarithms of frequency, amplitude and size
    session: NDArray[np.intp]

    @classmethod
    def of(
        cls,
        design: Design,
        predicted: FloatArray,
        free: FloatArray,
        session: NDArray[np.intp],
        least: tuple[float, float],
    ) -> Conditions:
        """Conditions of a design; amplitudes (V) and readings below the `least` are of one size."""
        along: dict[Kind, FloatArray] = {
            "frequency": np.log(design.frequency),
            "amplitude": np.log(np.maximum(design.amplitude, least[0])),
            "size": np.log(np.maximum(np.abs(predicted), least[1])),
        }
        return cls(predicted, free, along, session)


@dataclass(frozen=True, eq=False)
class Law:
    """One explanation's normal law of what is read, given what was."""

    kind: Kind
    old: Conditions
    sizes: FloatArray  # a, b and reach; nothing for chance
    scatter: tuple[float, float]  # relative and absolute
    root: FloatArray  # Cholesky's, of what was read, in units of its scatter
    scale: FloatArray  # that scatter, (n,)
    white: FloatArray  # what was read, freed of all correlation

    @classmethod
    def of(
        cls, kind: Kind, old: Conditions, residual: FloatArray, sizes: FloatArray, scatter: tuple[float, float],
        scale: FloatArray,
    ) -> Law:  # fmt: skip
        """Given what a model leaves of the readings, and their scatter."""
        covariance = _covariance(kind, sizes, old, old) / np.outer(scale, scale)
        root = cholesky(covariance + np.eye(scale.size), lower=True, check_finite=False)
        white = solve_triangular(root, residual / scale, lower=True, check_finite=False)
        return cls(kind, old, sizes, scatter, root, scale, white)

    @property
    def log_evidence(self) -> float:
        """Log density of what was read."""
        return float(-0.5 * self.white @ self.white - np.log(np.diag(self.root) * self.scale).sum())

    def ahead(self, new: Conditions, known: float) -> tuple[FloatArray, FloatArray]:
        """Mean and root of the covariance of readings to come; `known` is the uncertainty that they state."""
        across = _covariance(self.kind, self.sizes, self.old, new) / self.scale[:, None]
        shared = solve_triangular(self.root, across, lower=True, check_finite=False)
        relative, absolute = self.scatter
        own = (relative * new.predicted) ** 2 + absolute**2 + known**2
        covariance = _covariance(self.kind, self.sizes, new, new) - shared.T @ shared + np.diag(own)
        return new.predicted + shared.T @ self.white, cholesky(covariance, lower=True, check_finite=False)


def _covariance(kind: Kind, sizes: FloatArray, one: Conditions, other: Conditions) -> FloatArray:
    """Covariance of what the parameters and the discrepancy do to two sets of readings; (n, m)."""
    free = one.free @ other.free.T
    if kind == "chance":
        return free
    a, b, reach = sizes
    same = one.session[:, None] == other.session
    # Along one sweep only one of both varies.
    axes: tuple[Kind, ...] = ("frequency", "amplitude") if kind == "session" else (kind,)
    squared = sum((np.square(one.along[k][:, None] - other.along[k]) for k in axes), np.zeros(same.shape))
    smooth = a**2 * np.exp(-0.5 * squared / reach**2)
    if kind == "session":  # what befell one session does not come back in another
        smooth = np.where(same & (other.session != TO_COME), smooth, 0.0)
    return free + (smooth + b**2 * same) * np.outer(one.predicted, other.predicted)


@dataclass(frozen=True, eq=False)
class Explanations:
    """What a misfit may follow, and the law of each.

    Parameters
    ----------
    candidate : Candidate
    laws : tuple of Law
        The most probable first.
    probability : tuple of float
        Of each.
    least : (float, float)
        Amplitude, V, and reading below which all are of one size.
    """

    candidate: Candidate
    laws: tuple[Law, ...]
    probability: tuple[float, ...]
    least: tuple[float, float]

    @classmethod
    def of(cls, candidate: Candidate, left: Discrepancy) -> Explanations | None:
        """Explanations of what a model leaves of the usual observable; None where that is read along traces."""
        problem = candidate.problem
        design = problem.design
        rows = np.flatnonzero((design.measured == design.usually_measured) & ~design.traced)
        if not rows.size:
            return None
        around = Expansion.of(candidate, stretch(candidate))
        fitted, with_it = (
            tuple(float(np.broadcast_to(x, design.n_points)[rows[0]]) for x in around.scatter_at(v))
            for v in (around.scatter, left.hyper)
        )
        predicted, wider = candidate.predicted[rows], around.stretch[rows]
        known = np.broadcast_to(around.known, design.n_points)[rows]
        driven = design.amplitude[rows]
        least = float(driven[driven > 0].min(initial=np.inf)), with_it[1]
        old = Conditions.of(design.points(rows), predicted, around.free[rows], design.session[rows], least)
        kinds: list[Kind] = ["chance", "session", *(k for k, x in old.along.items() if np.ptp(x) > 0)]
        laws = []
        for kind in kinds:
            relative, absolute = fitted if kind == "chance" else with_it
            scale = np.sqrt(wider * ((relative * predicted) ** 2 + absolute**2 + known))
            sizes = np.array([left.amplitude, left.level, left.reach])
            laws.append(Law.of(kind, old, around.residual[rows], sizes, (relative, absolute), scale))
        evidence = np.array([law.log_evidence for law in laws])
        share = np.exp(evidence - logsumexp(evidence))
        order = np.argsort(-share, kind="stable").tolist()
        return cls(candidate, tuple(laws[k] for k in order), tuple(float(share[k]) for k in order), least)

    def worth_distinguishing(self, least: float) -> Explanations:
        """Keep those with a share of `least` or more, and two in any case: the best has to stand against another."""
        n = max(sum(p >= least for p in self.probability), 2)
        return replace(self, laws=self.laws[:n], probability=self.probability[:n])

    @property
    def record(self) -> list[Explanation]:
        """The explanations as a record holds them."""
        return [Explanation(law.kind, p) for law, p in zip(self.laws, self.probability, strict=True)]

    def ahead(self, design: Design, *, by: float = 1e-3) -> list[tuple[FloatArray, FloatArray]]:
        """Each law's mean and root of the covariance for a measurement in a session to come.

        `by` is the step of the differences for the slopes.
        """
        problem, mode = self.candidate.problem, self.candidate.modes[0]
        k = problem.n_model
        step = np.where(mode[:k] + by > problem.bounds[:k, 1], -by, by)
        moved = np.vstack([mode, mode + np.eye(k, mode.size) * step[:, None]])
        found = readings(design, problem.theta(moved, Occasions.one("a session to come")), problem.terms)
        free = ((found[1:] - found[0]) / step[:, None]).T * prior_widths(problem, mode)
        to_come = np.full(design.n_points, TO_COME)
        new = Conditions.of(design, found[0], free, to_come, self.least)
        known = problem.sigma_to_come(int(design.measured[0])) or 0.0
        return [law.ahead(new, known) for law in self.laws]


def compared(
    laws: Sequence[tuple[FloatArray, FloatArray]], truth: int, n_trials: int, random: np.random.Generator
) -> FloatArray:
    """Log ratio of the density of the right law to those of all, where it makes the readings; (n_laws, n_trials)."""
    mean, root = laws[truth]
    drawn = mean + random.standard_normal((n_trials, mean.size)) @ root.T
    density = []
    for centre, own in laws:
        z = solve_triangular(own, (drawn - centre).T, lower=True, check_finite=False)
        density.append(-0.5 * np.square(z).sum(axis=0) - math.fsum(np.log(np.diag(own))))
    return density[truth] - np.array(density)

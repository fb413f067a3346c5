"""Mixtures of Student densities: what importance sampling and Markov chains draw their proposals from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, ndtri
from scipy.stats import chi2, qmc

from psafit.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class StudentMixture:
    """Student densities.

    Parameters
    ----------
    centre : (k, d) array
    root : (k, d, d) array
        Lower roots of their scale matrices.
    share : (k,) array
    tails : float
        Degrees of freedom.
    """

    centre: FloatArray
    root: FloatArray
    share: FloatArray
    tails: float = 6.0

    @classmethod
    def of(cls, parts: Sequence[tuple[FloatArray, FloatArray, float]]) -> StudentMixture:
        """Make a mixture of parts, each (centre, covariance, weight)."""
        centre, covariance, weight = zip(*parts, strict=True)
        share = np.array(weight)
        return cls(np.array(centre), np.linalg.cholesky(np.array(covariance)), share / share.sum())

    @classmethod
    def joined(cls, mixtures: Sequence[StudentMixture], share: FloatArray) -> StudentMixture:
        """Several mixtures as one, each with its share; (n_mixtures,)."""
        parts = [m.share * s for m, s in zip(mixtures, share / share.sum(), strict=True)]
        centre, root = (np.concatenate([getattr(m, name) for m in mixtures]) for name in ("centre", "root"))
        return cls(centre, root, np.concatenate(parts))

    @cached_property
    def inverse(self) -> FloatArray:
        """Inverses of the roots; (k, d, d)."""
        return np.asarray(np.linalg.inv(self.root))

    @property
    def mixture(self) -> StudentMixture:
        """The mixture itself."""
        return self

    @property
    def error(self) -> float:
        """Standard error of the logarithm of its normalisation: none."""
        return 0.0

    def draw(self, n: int, random: np.random.Generator) -> FloatArray:
        """Quasi-random draws."""
        d = self.centre.shape[1]
        points = np.clip(qmc.Sobol(d + 2, rng=random).random(n), 1e-9, 1 - 1e-9)
        which = np.minimum(np.searchsorted(np.cumsum(self.share), points[:, 0]), len(self.share) - 1)
        normal = ndtri(points[:, 2:]) * np.sqrt(self.tails / chi2.ppf(points[:, 1], self.tails))[:, None]
        return np.asarray(self.centre[which] + (self.root[which] @ normal[:, :, None])[:, :, 0])

    def scatter(self, n: int, random: np.random.Generator) -> FloatArray:
        """Independent draws."""
        which = random.choice(len(self.share), n, p=self.share)
        normal = random.standard_normal((n, self.centre.shape[1]))
        normal /= np.sqrt(random.chisquare(self.tails, (n, 1)) / self.tails)
        return np.asarray(self.centre[which] + (self.root[which] @ normal[:, :, None])[:, :, 0])

    def log_density(self, u: FloatArray) -> FloatArray:
        """Log density at the rows of `u`; (n,)."""
        return np.asarray(np.logaddexp.reduce(self.each(u) + np.log(self.share)[:, None], axis=0))

    def each(self, u: FloatArray) -> FloatArray:
        """Log of each Student density at the rows of `u`; (k, n)."""
        k, d = self.centre.shape
        z = (self.inverse.reshape(k * d, d) @ u.T).reshape(k, d, -1)  # one product for all densities
        z -= self.inverse @ self.centre[:, :, None]
        constant = gammaln((self.tails + d) / 2) - gammaln(self.tails / 2) - 0.5 * d * math.log(self.tails * math.pi)
        constant = constant + np.log(np.diagonal(self.inverse, axis1=1, axis2=2)).sum(axis=1)
        distance = np.einsum("kdn,kdn->kn", z, z)
        return np.asarray(constant[:, None] - 0.5 * (self.tails + d) * np.log1p(distance / self.tails))

    def around(self, u: FloatArray, weights: FloatArray, width: FloatArray, most: int = 8) -> StudentMixture:
        """A mixture around weighted draws: all of them, and the heaviest with their neighbours.

        Parameters
        ----------
        u : (n, d) array
        weights : (n,) array
            Normalised.
        width : (d,) array
            Of the bounds.
        most : int
            Densities in it.
        """
        weights = tempered(weights)
        d = u.shape[1]
        wider = widening(d)
        mean, covariance = moments(u, weights, width)
        parts = [(mean, covariance * wider, 1.0)]
        inverse = np.linalg.inv(covariance)
        left = weights.copy()
        for _ in range(3):
            offset = u - u[np.argmax(left)]
            near = np.sum((offset @ inverse) * offset, axis=1) < 0.5 * d
            share = float(weights[near].sum())
            if near.sum() > 4 * d and share > 0.02:
                centre, local = moments(u[near], weights[near] / share, width)
                parts.append((centre, local * wider, share))
            left = np.where(near, 0.0, left)
            if not left.any():
                break
        old = [(c, r @ r.T, 0.1 * float(w)) for c, r, w in zip(self.centre, self.root, self.share, strict=True)]
        return StudentMixture.of([*parts, *old][:most])

    def stretched(self, n: int, width: FloatArray, reach: float = 1 / 6) -> StudentMixture:
        """Half of it, and half its first part drawn out along one of the first `n` coordinates after the other.

        The others go along as they are correlated with it. A polynomial sees no tail where there were no draws.

        Parameters
        ----------
        n : int
        width : (d,) array
            Of the bounds.
        reach : float
            Standard deviation, as a part of the bounds' width, to which one is stretched.
        """
        covariance = self.root[0] @ self.root[0].T
        longer = np.maximum((width * reach) ** 2 / np.diag(covariance) - 1, 0.0)
        along = [
            (self.centre[0], positive(covariance + longer[j] * np.outer(row, row) / row[j], width), 1 / n)
            for j, row in enumerate(covariance[:n])
        ]
        own = [(c, r @ r.T, float(w)) for c, r, w in zip(self.centre, self.root, self.share, strict=True)]
        return StudentMixture.of([*own, *along])


def widening(d: int, wider: float = 1.8) -> float:
    """Factor on a covariance in `d` dimensions by which a proposal is wider than what it is to cover."""
    return (1 + wider / d) ** 2


def tempered(weights: FloatArray) -> FloatArray:
    """Weights to a power at which some tens of draws count: a handful would collapse what is made of them."""
    power, result = 1.0, weights
    while 1 / np.sum(result**2) < min(60, 0.2 * len(weights)) and power > 0.05:
        power *= 0.8
        result = np.where(weights > 0, np.maximum(weights, 1e-300) ** power, 0.0)
        result /= result.sum()
    return result


def moments(u: FloatArray, weights: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of weighted draws, the latter by `positive`."""
    mean = weights @ u
    centred = u - mean
    return mean, positive((centred * weights[:, None]).T @ centred + 1e-9 * np.diag(width**2), width)


def positive(covariance: FloatArray, width: FloatArray) -> FloatArray:
    """Covariance with no direction wider than the bounds and none without any width."""
    scale = width / 3
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    clipped = (vectors * np.clip(values, 1e-10, 1.0)) @ vectors.T
    return np.asarray(clipped * np.outer(scale, scale))

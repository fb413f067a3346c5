r"""How a reading scatters about the truth.

No error is published with the study's ranges, so the scatter is inferred with the physics. A reading `y` of a true
range `L` is

.. math:: y = L + s\,t_\nu, \qquad s^2 = \sigma_{abs}^2 + (\sigma_{rel} L)^2 + \sigma_i^2,

with Student's :math:`t_\nu`, which gives an outlier a bounded pull and tends to the normal law for large
:math:`\nu`; :math:`\sigma_i` is the reading's own uncertainty, where the file has one. Zero is an ordinary reading.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaln, stdtr

from psafit.arrays import FloatArray
from psafit.observables import LAUNCH_RANGE
from psafit.parameters import Parameter

PARAMETERS: tuple[Parameter, ...] = LAUNCH_RANGE.scatter
"""Those of launch ranges; other observables have their own (`psafit.observables.Observable.scatter`)."""


def columns(noise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """sigma_rel, sigma_abs and nu, (n_sets, 1) or (n_sets, n_points) each, of what `scale` takes."""
    each = noise[:, :, None] if noise.ndim == 2 else noise
    return each[:, 0], each[:, 1], each[:, 2]


def scale(predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Scatter `s` of readings, each in its unit.

    Parameters
    ----------
    predicted : (n_sets, n_points) array
    noise : (n_sets, 3) or (n_sets, 3, n_points) array
        sigma_rel, sigma_abs, nu: of all readings, or of each, where they are of several observables.
    known : (n_points,) array, optional
        The readings' own standard uncertainties.
    """
    relative, absolute, _ = columns(noise)
    variance = (relative * predicted) ** 2 + absolute**2
    return np.sqrt(variance if known is None else variance + known**2)


def at_least(noise: FloatArray, margin: float = 1.1) -> NDArray[np.bool_]:
    """Where the relative scatter is as small as it may be, to a factor; (n_sets,).

    What is left is then below what any rig repeats to.
    """
    return np.asarray((columns(noise)[0] <= margin * PARAMETERS[0].bounds.lower).all(axis=1))


def log_density(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Log density of each reading, in its unit inverted; shape (n_sets, n_points). Arguments as in `scale`."""
    s = scale(predicted, noise, known)
    nu = columns(noise)[2]
    constant = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
    return constant - np.log(s) - 0.5 * (nu + 1) * np.log1p(((observed - predicted) / s) ** 2 / nu)


def tail_score(z: FloatArray, nu: FloatArray) -> FloatArray:
    """Derivative of each reading's log density by ``ln nu``.

    Parameters
    ----------
    z : (n_sets, n_points) array
        Residuals in units of the scatter `s`.
    nu : (n_sets, 1) or (n_sets, n_points) array

    Returns
    -------
    (n_sets, n_points) array
    """
    constant = 0.5 * nu * (digamma(0.5 * (nu + 1)) - digamma(0.5 * nu)) - 0.5
    square = z * z
    return constant - 0.5 * nu * np.log1p(square / nu) + 0.5 * (nu + 1) * square / (nu + square)


def cumulative(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Probability of a reading below the observed one; shape (n_sets, n_points)."""
    s = scale(predicted, noise, known)
    return np.asarray(stdtr(columns(noise)[2], (observed - predicted) / s))


def draw(predicted: FloatArray, noise: FloatArray, known: FloatArray | None, rng: np.random.Generator) -> FloatArray:
    """One simulated reading for each prediction; shape (n_sets, n_points)."""
    s = scale(predicted, noise, known)
    return predicted + s * rng.standard_t(np.broadcast_to(columns(noise)[2], s.shape))

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
from psafit.parameters import Bounds, LogNormal, Parameter

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "sigma_rel",
        r"\sigma_{rel}",
        "1",
        Bounds(1e-3, 2.0),
        LogNormal(0.05, 2.5),
        "relative scatter of a reading",
        "repeated launches of small impact drives scatter by some per cent; 2-12 % is one standard deviation",
    ),
    Parameter(
        "sigma_abs",
        r"\sigma_{abs}",
        "um",
        Bounds(1e-3, 20.0),
        LogNormal(0.1, 3.0),
        "absolute scatter of a reading",
        "rest motion of a hanging ball read by a vibrometer: tenths of a micrometre",
    ),
    Parameter(
        "nu",
        r"\nu",
        "1",
        Bounds(2.0, 100.0),
        LogNormal(10.0, 2.5),
        "degrees of freedom of the scatter (small: outliers; large: normal)",
        "between frank outliers (4) and practically normal (25), as in Juarez and Steel, J. Appl. Econom. 25 (2010)",
    ),
)

# A relative scatter so many times its lower bound is at it.
_AT_LEAST = 1.1


def scale(predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Scatter `s` of readings, um.

    Parameters
    ----------
    predicted : (n_sets, n_points) array, um
    noise : (n_sets, 3) array
        sigma_rel, sigma_abs (um), nu.
    known : (n_points,) array, um, optional
        The readings' own standard uncertainties.
    """
    variance = (noise[:, 0:1] * predicted) ** 2 + noise[:, 1:2] ** 2
    return np.sqrt(variance if known is None else variance + known**2)


def at_least(noise: FloatArray) -> NDArray[np.bool_]:
    """Where the relative scatter is as small as it may be: what is left is below what any rig repeats to; (n_sets,)."""
    return np.asarray(noise[:, 0] <= _AT_LEAST * PARAMETERS[0].bounds.lower)


def log_density(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Log density of each reading, 1/um; shape (n_sets, n_points). Arguments as in `scale`."""
    s = scale(predicted, noise, known)
    nu = noise[:, 2:3]
    constant = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
    return constant - np.log(s) - 0.5 * (nu + 1) * np.log1p(((observed - predicted) / s) ** 2 / nu)


def tail_score(z: FloatArray, nu: FloatArray) -> FloatArray:
    """Derivative of each reading's log density by ``ln nu``.

    Parameters
    ----------
    z : (n_sets, n_points) array
        Residuals in units of the scatter `s`.
    nu : (n_sets, 1) array

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
    return np.asarray(stdtr(noise[:, 2:3], (observed - predicted) / s))


def draw(predicted: FloatArray, noise: FloatArray, known: FloatArray | None, rng: np.random.Generator) -> FloatArray:
    """One simulated reading for each prediction, um; shape (n_sets, n_points)."""
    s = scale(predicted, noise, known)
    return predicted + s * rng.standard_t(np.broadcast_to(noise[:, 2:3], s.shape))

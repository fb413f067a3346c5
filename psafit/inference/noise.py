r"""How a reading scatters about the truth.

A reading `y` of a true range `L` is

.. math:: y = L + s\,t_\nu, \qquad s^2 = \sigma_{abs}^2 + (\sigma_{rel} L)^2 + \sigma_i^2,

with Student's :math:`t_\nu`; :math:`\sigma_i` is the reading's own uncertainty, where the file has one. A reading of
exactly zero has the probability :math:`F_\nu(-L/s)` that `y` was zero at most, no density: rows of zeros would
otherwise be taken for readings that repeat to the last digit. (A sample of a trace has either sign, and zero is one of
its values.) With :math:`r = (y - L)/s` each sample of a trace remembers the one before it,

.. math::
    r_i = \rho_i r_{i-1} + \sqrt{1 - \rho_i^2}\, t_\nu, \qquad \rho_i = e^{-(t_i - t_{i-1})/\tau},

so that its innovation :math:`z_i = (r_i - \rho_i r_{i-1})/\sqrt{1 - \rho_i^2}` is independent of all others. The
first sample of a trace, and every reading that is none, has :math:`\rho = 0`. docs/statistics.md says why it is so.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, gammaln, stdtr
from scipy.stats import chi2

from psafit.arrays import FloatArray
from psafit.observables import LAUNCH_RANGE
from psafit.parameters import Parameter
from psafit.simulate import Design

PARAMETERS: tuple[Parameter, ...] = LAUNCH_RANGE.scatter
"""The scatter of launch ranges; other observables have their own (`psafit.observables.Observable.scatter`)."""


def columns(noise: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """sigma_rel, sigma_abs and nu, (n_sets, 1) or (n_sets, n_points) each, of what `scale` takes."""
    each = noise[:, :, None] if noise.ndim == 2 else noise
    return each[:, 0], each[:, 1], each[:, 2]


def remembered(noise: FloatArray) -> FloatArray | None:
    """Correlation of each reading's error with that of the sample before, (n_sets, n_points); None without traces."""
    return np.nan_to_num(noise[:, 3]) if noise.shape[1] > 3 else None


def _before(values: FloatArray) -> FloatArray:
    """What stands at the reading before, along the last axis; zero before the first."""
    return np.concatenate([np.zeros_like(values[..., :1]), values[..., :-1]], axis=-1)


def along(values: FloatArray, elapsed: FloatArray) -> FloatArray:
    """The scatter's parameters of one observable, (n_sets, 3 or 4), as `scale` takes them; along a trace by sample.

    Parameters
    ----------
    values : (n_sets, 3 or 4) array
        sigma_rel, sigma_abs, nu, and of a trace the correlation time, us.
    elapsed : (n_points,) array, s
        Time since the sample before: see `psafit.simulate.Design.elapsed`.
    """
    if values.shape[1] == 3:
        return values
    rho = np.exp(-elapsed / (values[:, 3:] * 1e-6))
    return np.concatenate([np.repeat(values[:, :3, None], rho.shape[1], axis=2), rho[:, None]], axis=1)


def by_reading(values: Mapping[int, FloatArray], design: Design) -> FloatArray:
    """The scatter's parameters of all readings of a design, as `scale` takes them; (n_sets, 3 or 4, n_points).

    Parameters
    ----------
    values : mapping of int to (n_sets, 3 or 4) array
        Of each observable, as `psafit.observables.OBSERVABLES` counts, by `along`.
    design : Design
    """
    n_sets = len(next(iter(values.values())))
    found = np.full((n_sets, 4 if design.traced.any() else 3, design.n_points), np.nan)
    for k, own in values.items():
        here = np.flatnonzero(design.measured == k)
        if here.size:
            rows = along(own, design.elapsed[here])
            found[:, : rows.shape[1], here] = rows if rows.ndim == 3 else rows[:, :, None]
    return found


def whitened(deviation: FloatArray, noise: FloatArray) -> FloatArray:
    """What deviations, in units of the scatter, (..., n_sets, n_points), say beyond those before: their innovations."""
    rho = remembered(noise)
    if rho is None:
        return deviation
    return (deviation - rho * _before(deviation)) / np.sqrt(1.0 - rho * rho)


def correlated(innovation: FloatArray, noise: FloatArray) -> FloatArray:
    """Deviations, in units of the scatter, that have these innovations, (n_sets, n_points): undoes `whitened`."""
    rho = remembered(noise)
    if rho is None:
        return innovation
    found = innovation.copy()
    for i in np.flatnonzero((rho > 0.0).any(axis=0)):
        found[:, i] = rho[:, i] * found[:, i - 1] + np.sqrt(1.0 - rho[:, i] ** 2) * innovation[:, i]
    return found


def carried_back(pull: FloatArray, noise: FloatArray) -> FloatArray:
    """Derivatives by the deviations of what has these by the innovations: the transpose of `whitened`."""
    rho = remembered(noise)
    if rho is None:
        return pull
    own = pull / np.sqrt(1.0 - rho * rho)
    after = np.concatenate([(rho * own)[:, 1:], np.zeros_like(own[:, :1])], axis=1)
    return own - after


def innovations(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Residuals in units of the scatter, those along a trace freed of the ones before; (n_sets, n_points)."""
    return whitened((observed - predicted) / scale(predicted, noise, known), noise)


def memory_score(z: FloatArray, innovation: FloatArray, pull: FloatArray, noise: FloatArray) -> tuple[FloatArray, ...]:
    """How each reading's log density hangs on ``ln tau``; (n_sets, n_points) each.

    Parameters
    ----------
    z, innovation : (n_sets, n_points) arrays
        Residuals in units of the scatter, and their innovations.
    pull : (n_sets, n_points) array
        Negative derivative of the log density by the innovation.
    noise : (n_sets, 4, n_points) array

    Returns
    -------
    score
        The derivative.
    log_scale, location
        Of the width of the innovation's law, in logarithm, and of its place, in widths.
    """
    rho = np.nan_to_num(noise[:, 3])
    rate = -rho * np.log(np.maximum(rho, 1e-300))
    rest = 1.0 - rho * rho
    log_scale, location = -rate * rho / rest, rate * _before(z) / np.sqrt(rest)
    return log_scale * (innovation * pull - 1.0) + location * pull, log_scale, location


def scale(predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Scatter `s` of readings, each in its unit.

    Parameters
    ----------
    predicted : (n_sets, n_points) array
    noise : (n_sets, 3) or (n_sets, 3, n_points) or (n_sets, 4, n_points) array
        sigma_rel, sigma_abs, nu: of all readings, or of each, where they are of several observables; where some are
        samples of a trace, also the correlation with the one before, NaN for readings that are none.
    known : (n_points,) array, optional
        The readings' own standard uncertainties.
    """
    relative, absolute, _ = columns(noise)
    variance = (relative * predicted) ** 2 + absolute**2
    return np.sqrt(variance if known is None else variance + known**2)


def too_fine(noise: FloatArray, scores: FloatArray, level: float, margin: float = 1.1) -> bool:
    """Whether readings scatter less than the least relative scatter makes them, as those of a simulation do.

    Parameters
    ----------
    noise : as of `scale`
        One row.
    scores : (n_points,) array
        Their normal scores.
    level : float
        Probability of squares that are as small together, below which they are.
    margin : float
        Factor up to which the relative scatter is the least. What is left is then below what any rig repeats to.
    """
    least = (columns(noise)[0] <= margin * PARAMETERS[0].bounds.lower).all()
    return bool(least and chi2.cdf(np.sum(scores**2), scores.size) < level)


def log_density(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Log density of each reading, in its unit inverted; shape (n_sets, n_points). Arguments as in `scale`.

    That of a sample of a trace is given those before it.
    """
    s = scale(predicted, noise, known)
    nu, rho = columns(noise)[2], remembered(noise)
    z = whitened((observed - predicted) / s, noise)
    density = _log_pdf(z, nu) - np.log(s)
    if rho is not None:
        density -= 0.5 * np.log(1.0 - rho * rho)
    zero = at_zero(observed, noise)
    if zero.any():
        zero, nu = np.broadcast_to(zero, z.shape), np.broadcast_to(nu, z.shape)
        density[zero] = _log_below(z[zero], nu[zero])
    return density


def at_zero(observed: FloatArray, noise: FloatArray) -> NDArray[np.bool_]:
    """Which readings say no more than zero at most; of the shape of `observed`, or of (n_sets, n_points)."""
    zero = np.asarray(observed) == 0.0
    return zero if noise.shape[1] == 3 else zero & np.isnan(noise[:, 3])


def _log_pdf(z: FloatArray, nu: FloatArray) -> FloatArray:
    """Log density of Student's law."""
    constant = gammaln(0.5 * (nu + 1)) - gammaln(0.5 * nu) - 0.5 * np.log(nu * np.pi)
    return np.asarray(constant - 0.5 * (nu + 1) * np.log1p(z**2 / nu))


def _log_below(z: FloatArray, nu: FloatArray) -> FloatArray:
    """Log of Student's probability below `z`."""
    p = stdtr(nu, z)
    # Where it underflows the law is its own power of z: F = f |z|/nu, to nu/z^2.
    far = p < np.finfo(float).tiny
    tail = _log_pdf(z, nu) + np.log(np.where(far, np.abs(z), 1.0) / nu)
    return np.where(far, tail, np.log(np.where(far, 1.0, p)))


def pull(z: FloatArray, nu: FloatArray, zero: NDArray[np.bool_]) -> FloatArray:
    """Negative derivative of each reading's log density by its innovation; (n_sets, n_points).

    Parameters
    ----------
    z : (n_sets, n_points) array
        Innovations.
    nu : (n_sets, 1) or (n_sets, n_points) array
    zero : bool array
        Readings of which is known that they were zero at most (`at_zero`).
    """
    found = (nu + 1) * z / (nu + z * z)
    if zero.any():
        zero, nu = np.broadcast_to(zero, z.shape), np.broadcast_to(nu, z.shape)
        found[zero] = -np.exp(_log_pdf(z[zero], nu[zero]) - _log_below(z[zero], nu[zero]))
    return np.asarray(found)


def tail_score(z: FloatArray, nu: FloatArray, zero: NDArray[np.bool_], step: float = 1e-4) -> FloatArray:
    """Derivative of each reading's log density by ``ln nu``; arguments as in `pull`.

    That of a probability is a difference over twice `step`.
    """
    constant = 0.5 * nu * (digamma(0.5 * (nu + 1)) - digamma(0.5 * nu)) - 0.5
    square = z * z
    found = constant - 0.5 * nu * np.log1p(square / nu) + 0.5 * (nu + 1) * square / (nu + square)
    if zero.any():
        zero, nu = np.broadcast_to(zero, z.shape), np.broadcast_to(nu, z.shape)
        above, below = (_log_below(z[zero], nu[zero] * np.exp(by)) for by in (step, -step))
        found[zero] = (above - below) / (2 * step)
    return np.asarray(found)


def cumulative(observed: FloatArray, predicted: FloatArray, noise: FloatArray, known: FloatArray | None) -> FloatArray:
    """Probability of a reading below the observed one, along a trace given those before; shape (n_sets, n_points)."""
    return np.asarray(stdtr(columns(noise)[2], innovations(observed, predicted, noise, known)))


def draw(predicted: FloatArray, noise: FloatArray, known: FloatArray | None, rng: np.random.Generator) -> FloatArray:
    """One simulated reading for each prediction; shape (n_sets, n_points)."""
    s = scale(predicted, noise, known)
    return predicted + s * correlated(rng.standard_t(np.broadcast_to(columns(noise)[2], s.shape)), noise)

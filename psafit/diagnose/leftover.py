r"""What is left when the causes have done what they can: an unnamed discrepancy, and its evidence.

Around a fit the readings are, relative to the predictions,

.. math:: y = L(\hat\theta) + J \delta + L g + s\,\varepsilon, \qquad
    g \sim \mathcal{GP}\big(0,\; a^2 e^{-\Delta^2/2\ell^2} \delta_{gg'} + b^2 \delta_{gg'}\big),

a smooth function of each sweep's logarithmic variable, and a level of each group. The fit's own parameters
:math:`\delta` are integrated out with their prior (M. C. Kennedy and A. O'Hagan, J. R. Stat. Soc. B 63 (2001) 425),
so the discrepancy shown is what they cannot imitate. Its evidence against `a = b = 0`, both integrated over the
scatter by Laplace's method, makes "none of my causes" a hypothesis that competes with the causes on equal terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from psafit.diagnose.misfit import sweeps
from psafit.experiment import GroupId
from psafit.inference.candidate import Candidate

FloatArray = NDArray[np.float64]

# Log-normal priors: amplitude of the smooth part and of the levels (a tenth, within a factor of three), and its reach
# in the logarithm of the swept variable (a factor of two in frequency, within a factor of two).
_AMPLITUDE, _REACH = (math.log(0.1), math.log(3.0)), (math.log(0.7), math.log(2.0))
# A reading this many standard deviations off, with neighbours less than half as far, is an outlier.
_LONE = 3.0
# A reading below this many standard deviations of the absolute scatter says nothing of a relative discrepancy.
_SILENT = 1.0


@dataclass(frozen=True, eq=False)
class Leftover:
    """An unnamed discrepancy.

    Parameters
    ----------
    log_bayes : float
        Its evidence over none.
    amplitude, level, reach : float
        Standard deviation of the smooth part and of the groups' levels (relative), and its length in ln units.
    sigma_rel : float
        Relative scatter beside it.
    mean, sd : (n_points,) arrays
        ``ln(reading/prediction)`` that it explains, and its posterior standard deviation.
    hyper, covariance : (5,) and (5, 5) arrays
        Laplace's posterior of the scatter (sampling coordinates: relative, absolute) and of the logarithms of
        `amplitude`, `level` and `reach`.
    """

    log_bayes: float
    amplitude: float
    level: float
    reach: float
    sigma_rel: float
    mean: FloatArray
    sd: FloatArray
    hyper: FloatArray
    covariance: FloatArray

    def elsewhere(self, sigma_rel: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Relative standard deviation of the discrepancy in groups that were not fitted.

        Parameters
        ----------
        sigma_rel : (n,) array
            Draws of the relative scatter of the model without a discrepancy, which had to stand for part of it and is
            not counted twice.
        rng : Generator

        Returns
        -------
        (n,) array
        """
        drawn = rng.multivariate_normal(self.hyper, self.covariance, len(sigma_rel), method="eigh")
        _, a, b, _ = np.exp(np.clip(drawn[:, 1:], -20.0, 1.0)).T
        return np.asarray(np.sqrt(np.maximum(a**2 + b**2 + self.sigma_rel**2 - sigma_rel**2, 0.0)))

    def largest(self, candidate: Candidate) -> list[tuple[GroupId, float, float]]:
        """Each group's mean and largest absolute leftover, in ln units."""
        found = []
        for group_id, _, rows in sweeps(candidate.problem):
            seen = self.mean[rows]
            found.append((group_id, float(seen.mean()), float(np.abs(seen).max())))
        return found


def leftover(candidate: Candidate) -> Leftover:
    """Fit an unnamed discrepancy beside a model."""
    problem = candidate.problem
    predicted = np.maximum(candidate.predicted, 1e-9)
    u = candidate.modes[0]
    residual = problem.observed - candidate.predicted
    # A lone outlier keeps the large variance that Student's law gives it; neighbours that err together do not.
    nu = float(candidate.noise[0, 2])
    score, stretch = residual / candidate.scatter, np.ones(residual.size)
    for _, _, rows in sweeps(problem):
        z = score[rows]
        beside = np.convolve(np.pad(z, 1, mode="reflect"), [0.5, 0.0, 0.5], mode="valid") if z.size > 2 else 0.0 * z
        lone = (np.abs(z) > _LONE) & (np.abs(beside) < 0.5 * _LONE)
        stretch[rows] = np.where(lone, (nu + z**2) / (nu + 1), 1.0)
    slope = candidate.slope.T
    bent = problem.prior_slopes(u[None, :])[1][0, : problem.n_model]
    width = 1.0 / np.sqrt(np.maximum(bent, (4.0 / np.ptp(problem.bounds[: problem.n_model], axis=1)) ** 2))
    free = slope * width  # columns with unit prior variance
    x = np.empty(problem.observed.size)
    group = problem.design.group
    for _, variable, rows in sweeps(problem):
        swept = problem.design.amplitude if variable == "amplitude" else problem.design.frequency
        x[rows] = np.log(np.maximum(swept[rows], 1e-9))
    same = group[:, None] == group[None, :]
    squared = np.where(same, (x[:, None] - x[None, :]) ** 2, 0.0)
    outer = np.outer(predicted, predicted)
    known = 0.0 if problem.known_sigma is None else problem.known_sigma**2
    parameters = problem.parameters[problem.n_model : problem.n_model + 2]
    linear = free @ free.T

    def covariance(v: FloatArray, with_it: bool) -> FloatArray:
        relative, absolute = (float(p.to_physical(c)) for p, c in zip(parameters, v[:2], strict=True))
        total = linear + np.diag(stretch * ((relative * predicted) ** 2 + absolute**2 + known))
        if with_it:
            total += _kernel(v) * outer
        return np.asarray(total)

    def _kernel(v: FloatArray) -> FloatArray:
        a, b, reach = np.exp(v[2:5])
        return np.asarray(np.where(same, a * a * np.exp(-0.5 * squared / reach**2) + b * b, 0.0))

    def loss(v: FloatArray, with_it: bool) -> float:
        density = sum(float(p.log_prior(c)) for p, c in zip(parameters, v[:2], strict=True))
        if with_it:
            for c, (mean, sd) in zip(v[2:], (_AMPLITUDE, _AMPLITUDE, _REACH), strict=True):
                density += -0.5 * ((c - mean) / sd) ** 2 - math.log(sd) - 0.5 * math.log(2 * math.pi)
        if not math.isfinite(density):
            return 1e12
        try:
            factor = cho_factor(covariance(v, with_it), lower=True)
        except np.linalg.LinAlgError:
            return 1e12
        quadratic = float(residual @ cho_solve(factor, residual))
        return 0.5 * quadratic + float(np.log(np.diag(factor[0])).sum()) - density

    def evidence(start: FloatArray, with_it: bool) -> tuple[float, FloatArray, FloatArray]:
        bounds = [(p.sampling_bounds.lower, p.sampling_bounds.upper) for p in parameters]
        bounds += [(m - 4 * sd, m + 4 * sd) for m, sd in (_AMPLITUDE, _AMPLITUDE, _REACH)] if with_it else []
        end = minimize(loss, start, args=(with_it,), method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        v = np.clip(end.x, [b[0] + 2e-2 for b in bounds], [b[1] - 2e-2 for b in bounds])
        n, h = v.size, 1e-2
        curvature = np.empty((n, n))
        for i in range(n):
            for j in range(i, n):
                e, f = h * np.eye(n)[i], h * np.eye(n)[j]
                curvature[i, j] = curvature[j, i] = (
                    loss(v + e + f, with_it) - loss(v + e - f, with_it) - loss(v - e + f, with_it)
                    + loss(v - e - f, with_it)
                ) / (4 * h * h)  # fmt: skip
        # A direction that the readings leave open is as wide as its prior, not wider.
        values, axes = np.linalg.eigh(curvature)
        values = np.maximum(values, 0.3)
        value = -float(end.fun) + 0.5 * n * math.log(2 * math.pi) - 0.5 * float(np.log(values).sum())
        return value, end.x, (axes / values) @ axes.T

    at = u[problem.n_model : problem.n_model + 2]
    without = evidence(at.copy(), False)[0]
    best, where, spread = -math.inf, np.empty(0), np.empty((0, 0))
    low = [p.sampling_bounds.lower for p in parameters]
    # A scatter that had to stand for the discrepancy, too, may be either of its parts.
    usual = np.minimum(at, [float(p.prior_quantile(0.5)) for p in parameters])
    for begin, a, b in (
        (at, 0.02, 0.02),
        (at + np.array([math.log(0.4), 0.0]), 0.3, 0.1),
        (usual, 0.1, 0.3),
        (usual, 0.3, 0.1),
    ):
        start = np.array([*np.maximum(begin, low), math.log(a), math.log(b), math.log(0.7)])
        value, v, around = evidence(start, True)
        if value > best:
            best, where, spread = value, v, around
    kernel = _kernel(where) * outer
    factor = cho_factor(covariance(where, True), lower=True)
    mean = kernel @ cho_solve(factor, residual)
    variance = np.diag(kernel) - np.einsum("ij,ji->i", kernel, cho_solve(factor, kernel))
    absolute = float(parameters[1].to_physical(where[1]))
    heard = predicted > _SILENT * absolute
    return Leftover(
        log_bayes=best - without,
        amplitude=float(np.exp(where[2])),
        level=float(np.exp(where[3])),
        reach=float(np.exp(where[4])),
        sigma_rel=float(parameters[0].to_physical(where[0])),
        mean=np.where(heard, np.log(np.maximum(1 + mean / predicted, 1e-3)), 0.0),
        sd=np.where(heard, np.sqrt(np.maximum(variance, 0.0)) / predicted, np.inf),
        hyper=where,
        covariance=spread,
    )

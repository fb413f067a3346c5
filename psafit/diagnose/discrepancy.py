r"""What is left when the causes have done what they can: a discrepancy, and its evidence.

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
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import minimize

from psafit.arrays import FloatArray
from psafit.diagnose.residuals import sweeps
from psafit.experiment import GroupId
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.problem import Problem
from psafit.observables import OBSERVABLES, recorded_name
from psafit.parameters import Parameter


@dataclass(frozen=True)
class DiscrepancySettings:
    """What is believed of a discrepancy, and which readings show one.

    Parameters
    ----------
    amplitude, level : (float, float)
        Log-normal prior of the smooth part's standard deviation and of the groups' levels, relative to the range: its
        median, and the factor of one standard deviation.
    reach : (float, float)
        The same of the smooth part's length, in the logarithm of the swept variable; 0.7 is a factor of two.
    silent : float
        A reading below this many standard deviations of the absolute scatter says nothing of a relative discrepancy.
    """

    amplitude: tuple[float, float] = (0.1, 3.0)
    level: tuple[float, float] = (0.1, 3.0)
    reach: tuple[float, float] = (0.7, 2.0)
    silent: float = 1.0

    @property
    def priors(self) -> tuple[tuple[float, float], ...]:
        """Mean and standard deviation of each logarithm."""
        return tuple((math.log(m), math.log(f)) for m, f in (self.amplitude, self.level, self.reach))


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """A discrepancy.

    Parameters
    ----------
    log_bayes : float
        Its evidence over none.
    log_evidence : float
        Of model and discrepancy together, comparable with those of other models of the same readings.
    amplitude, level, reach : float
        Standard deviation of the smooth part and of the groups' levels (relative), and its length in ln units.
    sigma_rel : dict of int to float
        Relative scatter given it, by observable as `psafit.observables.OBSERVABLES` counts.
    mean, sd : (n_points,) arrays
        ``ln(reading/prediction)`` that it explains, and its posterior standard deviation.
    hyper, covariance : (5,) and (5, 5) arrays
        Laplace's posterior of the scatter (sampling coordinates: relative, absolute, of each observable) and of the
        logarithms of `amplitude`, `level` and `reach`.
    """

    log_bayes: float
    log_evidence: float
    amplitude: float
    level: float
    reach: float
    sigma_rel: dict[int, float]
    mean: FloatArray
    sd: FloatArray
    hyper: FloatArray
    covariance: FloatArray

    def elsewhere(self, sigma_rel: FloatArray, measured: NDArray[np.int8], rng: np.random.Generator) -> FloatArray:
        """Relative standard deviation of the discrepancy in groups that were not fitted.

        Parameters
        ----------
        sigma_rel : (n, n_points) or (n, 1) array
            Draws of the relative scatter of the model without a discrepancy. Of an observable that was fitted it had to
            stand for part of it, which is not counted twice.
        measured : (n_points,) array
            What is read there, as `psafit.observables.OBSERVABLES` counts.
        rng : Generator

        Returns
        -------
        (n, n_points) array
        """
        drawn = rng.multivariate_normal(self.hyper, self.covariance, len(sigma_rel), method="eigh")
        a, b, _ = np.exp(np.clip(drawn[:, -3:, None], -20.0, 1.0)).swapaxes(0, 1)
        given = np.array([self.sigma_rel.get(k, math.nan) for k in measured.tolist()])
        twice = np.where(np.isnan(given), 0.0, given**2 - sigma_rel**2)
        return np.asarray(np.sqrt(np.maximum(a**2 + b**2 + twice, 0.0)))

    def largest(self, candidate: Candidate) -> list[tuple[GroupId, str | None, float, float]]:
        """Mean and largest absolute discrepancy of each observable of a group, in ln units; NaN where none shows."""
        found, measured = [], candidate.problem.design.measured
        for group_id, _, rows in sweeps(candidate.problem):
            seen = self.mean[rows][np.isfinite(self.sd[rows])]
            sizes = (float(seen.mean()), float(np.abs(seen).max())) if seen.size else (math.nan, math.nan)
            found.append((group_id, recorded_name(OBSERVABLES[int(measured[rows[0]])]), *sizes))
        return found


def discrepancy(candidate: Candidate, outlying: FloatArray | None = None) -> Discrepancy:
    """Fit a discrepancy added to a model.

    Parameters
    ----------
    candidate : Candidate
    outlying : (n_points,) array, optional
        Factor on each reading's variance, from the `stretch` of another model where evidences are to be compared; the
        candidate's own by default.
    """
    around = Expansion.of(candidate, stretch(candidate) if outlying is None else outlying)
    without = around.fitted(around.scatter, with_it=False)
    # A scatter that had to stand for the discrepancy, too, may be either of its parts: there are several modes.
    low = [p.sampling_bounds.lower for p in around.parameters]
    usual = np.minimum(around.scatter, [float(p.prior_quantile(0.5)) for p in around.parameters])
    starts = (
        (around.scatter, 0.02, 0.02),
        (around.scatter + np.tile([math.log(0.4), 0.0], around.scatter.size // 2), 0.3, 0.1),
        (usual, 0.03, 0.03),
        (usual, 0.3, 0.1),
        (usual, 1.0, 0.1),
        (around.scatter, 1.0, 0.1),
    )
    ends = [
        around.fitted(np.array([*np.maximum(begin, low), math.log(a), math.log(b), around.priors[-1][0]]), with_it=True)
        for begin, a, b in starts
    ]
    best = max(ends, key=lambda end: end.log_evidence)
    sigma_rel, sigma_abs = around.scatter_at(best.v)
    measured = candidate.problem.design.measured
    mean, variance = around.discrepancy(best.v)
    heard = np.abs(around.predicted) > DiscrepancySettings.silent * sigma_abs
    amplitude, level, reach = np.exp(best.v[-3:]).tolist()
    return Discrepancy(
        log_bayes=best.log_evidence - without.log_evidence,
        log_evidence=best.log_evidence + around.placed,
        amplitude=amplitude,
        level=level,
        reach=reach,
        sigma_rel=dict(zip(measured.tolist(), np.broadcast_to(sigma_rel, measured.shape).tolist(), strict=True)),
        mean=np.where(heard, np.log(np.maximum(1 + mean / around.predicted, 1e-3)), 0.0),
        sd=np.where(heard, np.sqrt(np.maximum(variance, 0.0)) / np.abs(around.predicted), np.inf),
        hyper=best.v,
        covariance=best.covariance,
    )


@dataclass(frozen=True, eq=False)
class _Fitted:
    """An optimum in the scatter and, with a discrepancy, in the logarithms of its size and reach."""

    v: FloatArray
    log_evidence: float
    covariance: FloatArray


@dataclass(frozen=True, eq=False)
class Expansion:
    """Readings around a fit, linear in the model's parameters, which are integrated out."""

    parameters: tuple[Parameter, ...]  # of the scatter: relative, absolute, of each observable
    kind: NDArray[np.intp]  # which observable each reading is of; one entry where there is one
    scatter: FloatArray  # their sampling coordinates at the fit
    predicted: FloatArray
    residual: FloatArray
    stretch: FloatArray  # of each reading's variance
    free: FloatArray  # what each of the model's parameters does, in units of its prior's width; (n_points, n_model)
    known: FloatArray | float  # variance stated with the readings
    groups: tuple[NDArray[np.intp], ...]  # readings of each, which share one discrepancy
    squared: tuple[FloatArray, ...]  # ... and their squared distances along the sweep
    remembered: tuple[FloatArray | None, ...]  # ... and the correlation of their scatter, along a trace
    priors: tuple[tuple[float, float], ...]  # of the discrepancy's logarithms: mean, standard deviation
    placed: float  # log prior density of the model's parameters at the fit, over the normal one that stands for it

    @classmethod
    def of(cls, candidate: Candidate, outlying: FloatArray) -> Expansion:
        """Expand a model about its best mode; `outlying` widens each reading's scatter."""
        problem = candidate.problem
        n = problem.n_model
        width = prior_widths(problem, candidate.modes[0])
        own = zip(problem.parameters[:n], candidate.modes[0, :n], strict=True)
        density = np.array([float(p.log_prior(c)) for p, c in own])
        free = candidate.slope.T * width  # columns with unit prior variance
        ordered = [(rows, problem.design.along(variable)[rows]) for _, variable, rows in sweeps(problem)]
        scatter = [n + at.start + k for at in problem.scatter_at for k in (0, 1)]
        of = problem.scatter_of(problem.design.measured)
        return cls(
            parameters=tuple(problem.parameters[k] for k in scatter),
            kind=of if len(problem.observables) > 1 else of[:1],
            scatter=candidate.modes[0, scatter],
            predicted=np.copysign(np.maximum(np.abs(candidate.predicted), 1e-9), candidate.predicted),
            residual=problem.observed - candidate.predicted,
            stretch=outlying,
            free=free,
            known=0.0 if problem.known_sigma is None else problem.known_sigma**2,
            groups=tuple(rows for rows, _ in ordered),
            squared=tuple((x[:, None] - x[None, :]) ** 2 for _, x in ordered),
            remembered=tuple(_remembered(candidate, rows) for rows, _ in ordered),
            priors=DiscrepancySettings().priors,
            placed=float(np.sum(density + 0.5 * math.log(2 * math.pi) + np.log(width))),
        )

    def scatter_at(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Relative and absolute scatter of each reading; one entry where all are of one observable."""
        m = len(self.parameters)
        values = np.array([float(p.to_physical(c)) for p, c in zip(self.parameters, v[:m], strict=True)])
        return values[0::2][self.kind], values[1::2][self.kind]

    def kernels(self, v: FloatArray) -> list[FloatArray]:
        """Covariance of the discrepancy in each group, um^2."""
        a, b, reach = np.exp(v[-3:])
        return [
            (a * a * np.exp(-0.5 * squared / reach**2) + b * b) * np.outer(self.predicted[rows], self.predicted[rows])
            for rows, squared in zip(self.groups, self.squared, strict=True)
        ]

    def whitened(self, v: FloatArray) -> _Whitened:
        """What is left of the readings, in units of scatter and discrepancy, which bind readings of one group alone."""
        relative, absolute = self.scatter_at(v)
        variance = self.stretch * ((relative * self.predicted) ** 2 + absolute**2 + self.known)
        columns = np.column_stack([self.residual, self.free])
        with_it = v.size > len(self.parameters)
        if not with_it and all(one is None for one in self.remembered):
            factors, white = None, columns / np.sqrt(variance)[:, None]
            log_size = 0.5 * float(np.log(variance).sum())
        else:
            kernels: Sequence[FloatArray | float] = self.kernels(v) if with_it else [0.0] * len(self.groups)
            factors = [
                cholesky(kernel + _covariance(variance[rows], own), lower=True, check_finite=False)
                for rows, own, kernel in zip(self.groups, self.remembered, kernels, strict=True)
            ]
            white, log_size = np.empty_like(columns), 0.0
            for rows, factor in zip(self.groups, factors, strict=True):
                white[rows] = solve_triangular(factor, columns[rows], lower=True, check_finite=False)
                log_size += float(np.log(np.diag(factor)).sum())
        # The parameters' values given all else, by least squares with their priors: no product of what they do,
        # whose sizes differ by powers of ten.
        k = self.free.shape[1]
        q, r = np.linalg.qr(np.vstack([white[:, 1:], np.eye(k)]))
        target = np.append(white[:, 0], np.zeros(k))
        rest = target - q @ (q.T @ target)
        log_size += float(np.log(np.abs(np.diag(r))).sum())
        return _Whitened(factors, white[:, 1:], rest[:-k] if k else rest, r, float(rest @ rest), log_size)

    def loss(self, v: FloatArray) -> float:
        """Negative log posterior of the hyperparameters, the model's own parameters integrated out."""
        m = len(self.parameters)
        density = sum(float(p.log_prior(c)) for p, c in zip(self.parameters, v[:m], strict=True))
        for c, (mean, sd) in zip(v[m:], self.priors[: v.size - m], strict=True):
            density += -0.5 * ((c - mean) / sd) ** 2 - math.log(sd) - 0.5 * math.log(2 * math.pi)
        if not math.isfinite(density):
            return 1e12
        try:
            found = self.whitened(v)
        except np.linalg.LinAlgError:
            return 1e12
        return 0.5 * found.squares + found.log_size - density

    def fitted(self, start: FloatArray, *, with_it: bool) -> _Fitted:
        """Optimise, and integrate by Laplace's method."""
        bounds = [(p.sampling_bounds.lower, p.sampling_bounds.upper) for p in self.parameters]
        bounds += [(m - 4 * sd, m + 4 * sd) for m, sd in self.priors] if with_it else []
        end = minimize(self.loss, start, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        v = np.clip(end.x, [b[0] + 2e-2 for b in bounds], [b[1] - 2e-2 for b in bounds])
        n, h = v.size, 1e-2
        curvature = np.empty((n, n))
        for i in range(n):
            for j in range(i, n):
                e, f = h * np.eye(n)[i], h * np.eye(n)[j]
                curvature[i, j] = curvature[j, i] = (
                    self.loss(v + e + f) - self.loss(v + e - f) - self.loss(v - e + f) + self.loss(v - e - f)
                ) / (4 * h * h)
        # A direction that the readings leave open is as wide as its prior, not wider.
        values, axes = np.linalg.eigh(curvature)
        values = np.maximum(values, 0.3)
        log_evidence = -float(end.fun) + 0.5 * n * math.log(2 * math.pi) - 0.5 * float(np.log(values).sum())
        return _Fitted(end.x, log_evidence, (axes / values) @ axes.T)

    def discrepancy(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Posterior mean and variance of the discrepancy, um and um^2."""
        found = self.whitened(v)
        mean, variance = np.empty(self.residual.size), np.empty(self.residual.size)
        for rows, kernel, factor in zip(self.groups, self.kernels(v), found.factors or (), strict=True):
            shared = solve_triangular(factor, kernel, lower=True, check_finite=False)
            # What the parameters leave open widens it again.
            open_ = solve_triangular(found.r, found.free[rows].T @ shared, trans=1, check_finite=False)
            mean[rows] = shared.T @ found.rest[rows]
            variance[rows] = np.diag(kernel) - np.square(shared).sum(axis=0) + np.square(open_).sum(axis=0)
        return mean, variance


def prior_widths(problem: Problem, u: FloatArray) -> FloatArray:
    """Standard deviations of the normal laws that stand for the priors of the model's parameters, (n_model,)."""
    n = problem.n_model
    bent = problem.prior_slopes(u[None])[1][0, :n]
    return np.asarray(1.0 / np.sqrt(np.maximum(bent, (4.0 / np.ptp(problem.bounds[:n], axis=1)) ** 2)))


@dataclass(frozen=True, eq=False)
class _Whitened:
    """Readings around a fit in units of their covariance, the model's parameters integrated out."""

    factors: list[FloatArray] | None  # Cholesky's, of each group's scatter and discrepancy
    free: FloatArray  # what the parameters do
    rest: FloatArray  # what they leave
    r: FloatArray  # triangular root of their precision
    squares: float
    log_size: float  # half the log determinant of the covariance


def _remembered(candidate: Candidate, rows: NDArray[np.intp]) -> FloatArray | None:
    """Correlation of the scatter of some readings, (n, n), as fitted along a trace; None where they have none."""
    rho = noise.remembered(candidate.noise)
    if rho is None or not candidate.problem.design.traced[rows[0]]:
        return None
    least = np.finfo(float).tiny  # where a correlation underflows
    decay = np.cumsum(-np.log(np.maximum(rho[0, rows[1:]], least)))  # of that with the first sample, in logarithm
    apart = np.append(0.0, decay)
    return np.exp(-np.abs(apart[:, None] - apart))


def _covariance(variance: FloatArray, correlation: FloatArray | None) -> FloatArray:
    """Covariance of readings with these variances, (n, n)."""
    if correlation is None:
        return np.diag(variance)
    return correlation * np.sqrt(np.outer(variance, variance))


def stretch(candidate: Candidate, *, lone: float = 3.0) -> FloatArray:
    """Factor on each reading's variance.

    An outlier, a reading more than `lone` standard deviations off with neighbours less than half as far, keeps the
    large variance that Student's law gives it; neighbours that err together do not.
    """
    problem = candidate.problem
    score = noise.innovations(problem.observed, candidate.predicted[None], candidate.noise, problem.known_sigma)[0]
    found = np.ones(score.size)
    tails = np.broadcast_to(noise.columns(candidate.noise)[2][0], score.shape)
    for _, _, rows in sweeps(problem):
        z, nu = score[rows], tails[rows]
        sides = np.convolve(np.pad(z, 1, mode="reflect"), [0.5, 0.0, 0.5], mode="valid") if z.size > 2 else 0.0 * z
        alone = (np.abs(z) > lone) & (np.abs(sides) < 0.5 * lone)
        found[rows] = np.where(alone, (nu + z**2) / (nu + 1), 1.0)
    return found

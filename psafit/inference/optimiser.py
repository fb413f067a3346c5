r"""Maximise many log posteriors at once, by Fisher scoring.

A search among models, each with many starts, and a bootstrap with hundreds of refits, need the same thing: many
optimisations of the same kind, whose simulations go through the simulator as one batch. `psafit.inference.polish`
polishes the optimum of one problem with care; this finds good ones of many problems fast, and says how far it came.

With :math:`z = (y - L)/s` and Student's scatter (`psafit.inference.noise`), the expected curvature is

.. math:: \sum_i \frac{\nu+1}{\nu+3} \frac{\partial L_i \partial L_i^T}{s_i^2}
    + \frac{2\nu}{\nu+3}\, \partial\ln s_i\, \partial\ln s_i^T - \partial^2 \ln p(\theta)

(K. L. Lange, R. J. A. Little and J. M. G. Taylor, J. Am. Stat. Assoc. 84 (1989) 881), which is positive whatever the
residuals are. Steps are damped as Levenberg and Marquardt do, each optimisation by its own factor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.inference import noise
from psafit.inference.problem import Problem


@dataclass(frozen=True)
class FisherSettings:
    """How an optimisation steps.

    Parameters
    ----------
    eased, raised : float
        Factors on an optimisation's damping after a step up, and where fresh slopes have led to none.
    first, least, most : float
        Damping with which an optimisation begins, and its limits.
    stuck : float
        Damping at which an optimisation that finds no way up gives up.
    lasting : int
        Steps for which slopes are carried over by secants before they are taken anew.
    still_below : float, nats
        An optimisation stands still when it has gained less than this twice in a row.
    longest : float
        Longest step, in units of the sampling coordinate (a factor of e, or a prior's standard deviation).
    like : float, nats
    indistinct : float
        Optimisations whose log posteriors differ by less than `like`, and all whose ranges by less than `indistinct`
        standard deviations of the scatter, are at one place, or on one ridge.
    """

    eased: float = 0.3
    raised: float = 30.0
    first: float = 1e-2
    least: float = 1e-6
    most: float = 1e8
    stuck: float = 1e4
    lasting: int = 5
    still_below: float = 2e-3
    longest: float = 2.0
    like: float = 0.5
    indistinct: float = 0.1


class Effort(NamedTuple):
    """What optimisations have taken.

    Parameters
    ----------
    begun, failed : int
        Starts followed, and those of them whose posterior is not finite.
    n_sets : int
        Parameter sets simulated.
    """

    begun: int = 0
    failed: int = 0
    n_sets: int = 0

    def __add__(self, other: Effort) -> Effort:  # type: ignore[override]
        return Effort(self.begun + other.begun, self.failed + other.failed, self.n_sets + other.n_sets)


@dataclass(frozen=True)
class Optima:
    """Where optimisations ended; the first axis counts them.

    Parameters
    ----------
    u : (n, n_dim) array
        Sampling coordinates.
    log_posterior : (n,) array
        Log posterior there.
    predicted : (n, n_points) array
        Predictions there, each in the unit of its reading.
    starts : (n,) array of int
        Starts that ended there: optimisations that were united count together.
    effort : Effort
        Those that were given up included.
    """

    u: FloatArray
    log_posterior: FloatArray
    predicted: FloatArray
    starts: NDArray[np.intp]
    effort: Effort

    @property
    def best(self) -> int:
        """Index of the highest."""
        return int(np.argmax(self.log_posterior))

    @property
    def uncounted(self) -> Optima:
        """These optima as places where no optimisation has begun or ended."""
        return replace(self, starts=np.zeros_like(self.starts), effort=Effort(n_sets=self.effort.n_sets))


def log_posteriors(problem: Problem, u: FloatArray, predicted: FloatArray, observed: FloatArray) -> FloatArray:
    """Log posteriors of predictions that are known already; minus infinity outside the bounds. Shape (n,)."""
    scatter = problem.noise_values(np.clip(u, *problem.bounds.T))  # outside of its bounds it may be none
    value = problem.log_prior(u) + noise.log_density(observed, predicted, scatter, problem.known_sigma).sum(axis=1)
    return np.where(np.isfinite(value), value, -np.inf)


def gradient(
    f: Callable[[FloatArray], FloatArray], u: FloatArray, bounds: FloatArray, *, by: float = 1e-4
) -> FloatArray:
    """Central differences of a batched function at one point, in one batch, one-sided at a bound; (n_dim, ...).

    Coordinates are of order one: steps `by` the cube root of the simulator's relative error (1e-12).
    """
    u = np.clip(u, bounds[:, 0], bounds[:, 1])
    steps = by * np.eye(u.size)
    above, below = np.minimum(u + steps, bounds[:, 1]), np.maximum(u - steps, bounds[:, 0])
    both = f(np.concatenate([above, below]))
    width = np.diag(above - below).reshape(-1, *[1] * (both.ndim - 1))
    return (both[: u.size] - both[u.size :]) / width


def slopes(
    problem: Problem, u: FloatArray, predicted: FloatArray, *, by: float = 1e-3, jump: float = 0.1
) -> FloatArray:
    """Derivatives of the launch ranges by the sampling coordinates of the model, um; (n, n_model, n_points).

    Parameters
    ----------
    problem : Problem
    u : (n, n_dim) array
    predicted : (n, n_points) array
        Predictions at `u`, each in the unit of its reading.
    by : float
        Step of the forward differences: far above the jitter of the stepping path (1e-6), far below the width of any
        posterior.
    jump : float
        A difference of this many standard deviations of the scatter may be a jump.
    """
    n, k = len(u), problem.n_model
    step = np.where(u[:, :k] + by > problem.bounds[:k, 1], -by, by)
    moved = np.repeat(u[:, None, :], k, axis=1)
    moved[:, np.arange(k), np.arange(k)] += step
    found = problem.predict(moved.reshape(n * k, -1)).reshape(n, k, -1)
    slope = (found - predicted[:, None, :]) / step[:, :, None]
    # A contact that ends a half wave later makes a range jump. Optima lie at the edges of such jumps, and a difference
    # across one is no slope: the other side's is. Nor is one into where nothing can be simulated.
    scatter = noise.scale(predicted, problem.noise_values(u), problem.known_sigma)
    smooth = np.abs(found - predicted[:, None, :]) <= jump * scatter[:, None, :]
    if smooth.all():
        return slope
    row, column = np.nonzero(~smooth.all(axis=2))
    inside = u[row, column] - step[row, column] > problem.bounds[column, 0]
    row, column = row[inside], column[inside]
    if row.size:
        other = u[row].copy()
        other[np.arange(row.size), column] -= step[row, column]
        behind = (predicted[row] - problem.predict(other)) / step[row, column, None]
        ahead = slope[row, column]
        slope[row, column] = np.where((np.abs(behind) < np.abs(ahead)) | ~np.isfinite(ahead), behind, ahead)
    return np.where(np.isfinite(slope) | ~np.isfinite(predicted)[:, None, :], slope, 0.0)


def expansion(
    problem: Problem, u: FloatArray, predicted: FloatArray, slope: FloatArray, observed: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Gradient, (n, n_dim), and expected curvature, (n, n_dim, n_dim), of the log posterior."""
    n, k, d = len(u), problem.n_model, problem.n_dim
    values = problem.noise_values(u)
    relative, absolute, nu = noise.columns(values)
    s = noise.scale(predicted, values, problem.known_sigma)
    z = (observed - predicted) / s
    innovation = noise.whitened(z, values)
    zero = noise.at_zero(observed, values)
    own_pull = noise.pull(innovation, nu, zero)
    pull = noise.carried_back(own_pull, values)
    # d ln s by every coordinate: the ranges move it through the relative scatter.
    by_range = relative**2 * predicted / s**2
    gradient, curvature = np.zeros((n, d)), np.zeros((n, d, d))
    tails = noise.tail_score(innovation, nu, zero)
    wide, censored = z * pull - ~zero, bool(zero.any())
    if censored:  # what is expected of the squares of both is Student's, but for zeros: their own stand for it
        weight = np.where(zero, np.abs(pull) * np.sqrt((nu + 3) / (nu + 1)), 1.0)
        wide_weight = np.where(zero, np.abs(wide) * np.sqrt((nu + 3) / (2 * nu)), 1.0)
    for j, here in enumerate(problem.rows_of_scatter):  # of each observable, whose scatter is its own
        if not z[:, here].size:
            continue  # of one that these groups do not read, nothing but the prior is known
        own = k + problem.scatter_at[j].start
        at = np.r_[0:k, own, own + 1]
        location = slope[:, :, here] / s[:, None, here]
        log_scale = np.empty((n, k + 2, location.shape[2]))
        log_scale[:, :k] = slope[:, :, here] * by_range[:, None, here]
        log_scale[:, k] = (relative * predicted / s)[:, here] ** 2
        log_scale[:, k + 1] = (absolute / s)[:, here] ** 2
        some = nu[:, here][:, :1] if nu.shape[1] > 1 else nu
        gradient[:, at] += np.einsum("nkp,np->nk", log_scale, wide[:, here])
        gradient[:, :k] += np.einsum("nkp,np->nk", location, pull[:, here])
        if problem.observables[j].traced:
            score, wider, further = (a[:, here] for a in noise.memory_score(z, innovation, own_pull, values))
            gradient[:, own + 3] = score.sum(axis=1)
            at = np.r_[at, own + 3]
            log_scale = np.concatenate([log_scale, wider[:, None]], axis=1)
            location = noise.whitened(location.swapaxes(0, 1), values[:, :, here]).swapaxes(0, 1)
            curvature[:, own + 3, own + 3] += ((some + 1) / (some + 3) * np.square(further)).sum(axis=1)
        if censored:
            log_scale *= wide_weight[:, None, here]
            location = location * weight[:, None, here]
        both = np.einsum("nip,njp->nij", log_scale, log_scale)
        curvature[:, at[:, None], at] += (2 * some / (some + 3))[:, :, None] * both
        both = np.einsum("nip,njp->nij", location, location)
        curvature[:, :k, :k] += ((some + 1) / (some + 3))[:, :, None] * both
        # The degrees of freedom: the readings' own scores, whose squares stand for the curvature.
        gradient[:, own + 2] = tails[:, here].sum(axis=1)
        curvature[:, own + 2, own + 2] = np.square(tails[:, here]).sum(axis=1)
    first, second = problem.prior_slopes(u)
    gradient += first
    curvature[:, np.arange(d), np.arange(d)] += second
    return gradient, curvature


def _steps(
    problem: Problem,
    u: FloatArray,
    gradient: FloatArray,
    curvature: FloatArray,
    damping: FloatArray,
    frozen: NDArray[np.bool_],
    longest: float,
) -> FloatArray:
    """Points tried next; (n, n_dim). A coordinate held by its bound, or frozen, stays there."""
    low, high = problem.bounds[:, 0], problem.bounds[:, 1]
    held = frozen | ((u <= low) & (gradient <= 0)) | ((u >= high) & (gradient >= 0))
    g = np.where(held, 0.0, gradient)
    a = np.where(held[:, :, None] | held[:, None, :], 0.0, curvature)
    d = u.shape[1]
    # In units in which the diagonal is one, the least damping keeps the matrix regular whatever the slopes' sizes are.
    scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", curvature), 1e-3))
    a *= scale[:, :, None] * scale[:, None, :]
    a[:, np.arange(d), np.arange(d)] += damping[:, None] + held
    step = np.linalg.solve(a, (g * scale)[:, :, None])[..., 0] * scale
    farthest = np.abs(step).max(axis=1, keepdims=True)
    step *= np.minimum(1.0, longest / np.maximum(farthest, 1e-300))
    return np.clip(u + step, low, high)


Predict = Callable[[FloatArray, NDArray[np.intp]], FloatArray]
"""Launch ranges, um, of rows of coordinates; the second argument says which optimisation each row belongs to."""


def _optimise(
    problem: Problem,
    starts: FloatArray,
    target: FloatArray,
    predict: Predict,
    slope: Callable[[FloatArray, FloatArray, NDArray[np.intp]], FloatArray],
    schedule: tuple[tuple[int, int], ...],
    frozen: NDArray[np.bool_],
    lasting: int,
    still_below: float,
    unite: bool = False,
    counts: NDArray[np.intp] | None = None,
) -> Optima:
    how = FisherSettings()
    u = np.clip(np.atleast_2d(starts), problem.bounds[:, 0], problem.bounds[:, 1])
    who = np.arange(len(u))
    predicted = predict(u, who)
    log_posterior = log_posteriors(problem, u, predicted, target)
    damping = np.full(len(u), how.first)
    still, n_sets = np.where(np.isfinite(log_posterior), 0, 9), len(u)
    starts_at = np.ones(len(u), np.intp) if counts is None else counts
    begun, failed = len(u), int((~np.isfinite(log_posterior)).sum())
    k = problem.n_model
    slopes_at, age = np.empty((len(u), k, predicted.shape[1])), np.full(len(u), lasting)
    for iterations, survivors in schedule:
        for _ in range(iterations):
            live = np.flatnonzero(still < 2)
            if not live.size:
                break
            old = live[age[live] >= lasting]
            if old.size:
                slopes_at[old] = slope(u[old], predicted[old], who[old])
                age[old] = 0
                n_sets += old.size * k
            gradient, curvature = expansion(problem, u[live], predicted[live], slopes_at[live], target[live])
            usable = np.isfinite(gradient).all(axis=1) & np.isfinite(curvature).all(axis=(1, 2))
            still[live[~usable]] = 9
            live, gradient, curvature = live[usable], gradient[usable], curvature[usable]
            if not live.size:
                break
            rows = _steps(problem, u[live], gradient, curvature, damping[live], frozen[who[live]], how.longest)
            found = predict(rows, who[live])
            n_sets += len(rows)
            value = log_posteriors(problem, rows, found, target[live])
            gain = value - log_posterior[live]
            better = gain > 0
            # What slopes carried over from earlier iterations cannot do, fresh ones may.
            carried = age[live] > 0
            factor = np.where(better, how.eased, np.where(carried, 1.0, how.raised))
            damping[live] = np.clip(damping[live] * factor, how.least, how.most)
            slow = (gain < still_below) & (better | (damping[live] > how.stuck))
            still[live] = np.where(slow, still[live] + ~carried, 0)
            age[live] = np.where(carried & (slow | ~better), lasting, age[live] + better)
            up = live[better]
            step, change = rows[better, :k] - u[up, :k], found[better] - predicted[up]
            u[up], log_posterior[up], predicted[up] = rows[better], value[better], found[better]
            if lasting > 1:
                # Broyden: the least change, in the posterior's own widths, that agrees with the step just taken.
                share = step * np.einsum("nii->ni", curvature)[better, :k]
                share /= np.maximum(np.sum(share * step, axis=1, keepdims=True), 1e-300)
                slopes_at[up] += share[:, :, None] * (change - (step[:, None] @ slopes_at[up])[:, 0])[:, None, :]
        if survivors < len(u) or unite:
            kept, starts_at = _kept(problem, u, log_posterior, predicted, starts_at, survivors, unite)
            u, log_posterior, predicted = u[kept], log_posterior[kept], predicted[kept]
            damping, target = damping[kept], target[kept]
            still, who, slopes_at, age = still[kept], who[kept], slopes_at[kept], age[kept]
    return Optima(u, log_posterior, predicted, starts_at, Effort(begun, failed, n_sets))


def _kept(
    problem: Problem,
    u: FloatArray,
    log_posterior: FloatArray,
    predicted: FloatArray,
    starts: NDArray[np.intp],
    most: int,
    unite: bool,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Optimisations that go on, and the starts of each; of those to be united, the highest alone, for all."""
    order = np.argsort(-log_posterior, kind="stable")
    if not unite:
        kept = np.sort(order[:most])
        return kept, starts[kept]
    how, scatter = FisherSettings(), noise.scale(predicted, problem.noise_values(u), problem.known_sigma)
    total: dict[int, int] = {}
    for k in order:
        for m in total:
            apart = np.abs((predicted[k] - predicted[m]) / scatter[m]).max()
            if log_posterior[m] < log_posterior[k] + how.like and apart < how.indistinct:
                total[m] += int(starts[k])
                break
        else:
            if len(total) < most:
                total[int(k)] = int(starts[k])
    kept = np.sort(np.array(list(total), np.intp))
    return kept, np.array([total[int(k)] for k in kept], np.intp)


def maximise(
    problem: Problem,
    starts: FloatArray,
    observed: FloatArray | None = None,
    *,
    schedule: tuple[tuple[int, int], ...] = ((40, 10**9),),
    still_below: float = FisherSettings.still_below,
    unite: bool = False,
    frozen: NDArray[np.bool_] | None = None,
    counts: NDArray[np.intp] | None = None,
) -> Optima:
    """Optimise from every start.

    Parameters
    ----------
    problem : Problem
    starts : (n, n_dim) array
        Sampling coordinates, within the bounds.
    observed : (n_points,) or (n, n_points) array, um, optional
        Readings, where each optimisation has its own; the problem's by default.
    schedule : tuple of (int, int)
        Iterations, and how many of the highest optimisations go on after them. Optimisations that were left behind are
        not in the result.
    still_below : float, nats
        As of `FisherSettings`.
    unite : bool
        After each part of the schedule, optimisations that predict the same readings at the same log posterior are one.
    frozen : (n, n_dim) array of bool, optional
        Coordinates that stay where each optimisation begins.
    counts : (n,) array of int, optional
        Earlier starts that each of these stands for; one by default.

    Returns
    -------
    Optima
    """
    starts = np.atleast_2d(starts)
    target = np.broadcast_to(problem.observed if observed is None else observed, (len(starts), problem.observed.size))

    def slope(u: FloatArray, here: FloatArray, who: NDArray[np.intp]) -> FloatArray:
        return slopes(problem, u, here)

    held = np.zeros(starts.shape, bool) if frozen is None else frozen
    return _optimise(
        problem, starts, target, lambda u, who: problem.predict(u), slope, schedule, held, FisherSettings.lasting,
        still_below, unite, counts,
    )  # fmt: skip


def maximise_linearly(
    problem: Problem,
    at: FloatArray,
    predicted: FloatArray,
    slope: FloatArray,
    observed: FloatArray | None = None,
    *,
    frozen: Sequence[int] = (),
    iterations: int = 25,
    reach: float = 2.0,
) -> Optima:
    """Optimise in models that are replaced by their logarithmic expansion, which costs no simulation.

    Each optimisation has its own: ``ln L(u) = ln L(at) + (u - at) . slope``, held within `reach` of ``ln L(at)``.
    Samples of a trace, which have either sign, are expanded themselves.

    Parameters
    ----------
    problem : Problem
        Parameters, priors and scatter.
    at : (n, n_dim) array
        Where the optimisations begin, and where the slopes were taken.
    predicted : (n, n_points) array
        Predictions there, each in the unit of its reading.
    slope : (n, n_model, n_points) array, or (n_model, n_points) for all
        Derivatives of ``ln L``, or of the samples of a trace, by the sampling coordinates of the model.
    observed : (n_points,) or (n, n_points) array, um, optional
        Readings; the problem's by default.
    frozen : sequence of int
        Coordinates that stay where they are.
    iterations : int
    reach : float
        Of the expansion in ``ln L``.

    Returns
    -------
    Optima
        Its ranges are those of the expansion; no sets are simulated.
    """
    n, k, traced = len(predicted), problem.n_model, problem.design.traced
    slope = np.broadcast_to(slope, (n, k, predicted.shape[1]))
    target = np.broadcast_to(problem.observed if observed is None else observed, predicted.shape)

    def predict(u: FloatArray, who: NDArray[np.intp]) -> FloatArray:
        change = np.matmul((u[:, None, :k] - at[who][:, None, :k]), slope[who])[:, 0]
        found = predicted[who] * np.exp(np.clip(change, -reach, reach))
        return np.where(traced, predicted[who] + change, found)

    def slopes_of(u: FloatArray, here: FloatArray, who: NDArray[np.intp]) -> FloatArray:
        return np.where(traced, slope[who], here[:, None, :] * slope[who])

    mask = np.zeros((n, problem.n_dim), bool)
    mask[:, list(frozen)] = True
    still_below = FisherSettings.still_below
    result = _optimise(problem, at, target, predict, slopes_of, ((iterations, n),), mask, 1, still_below)
    return replace(result, effort=result.effort._replace(n_sets=0))

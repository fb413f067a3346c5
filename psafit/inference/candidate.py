r"""A model under judgement: the baseline with some causes, fitted to some groups."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, log_ndtr, logsumexp

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference import noise
from psafit.inference.optimiser import Effort, Optima, expansion, log_posteriors, maximise, slopes
from psafit.inference.problem import Problem
from psafit.inference.scan import widened
from psafit.inference.starts import joined_values, starts_of
from psafit.physics import baseline
from psafit.physics.term import Term

Schedule = tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class FitSettings:
    """How a fit divides its work between optimisations.

    A schedule is a tuple of (iterations, how many of the highest optimisations go on after them).

    Parameters
    ----------
    trial, fresh : tuple of (int, int)
        On some of the readings, where they are many: optimisations from what is known, and optimisations from draws of
        the prior.
    full : tuple of (int, int)
        On all readings.
    thorough : tuple of (int, int)
        Of a model of which nothing is known, on the readings of a trial. What remains goes on, on all of them.
    enough : float, nats
        Gain of an optimisation below which it ends: well within the error of Laplace's evidence.
    hopeless : float, nats
        An optimisation whose trial ends this far below the best is given up.
    taken : int
        Of what is known beforehand, so many of the best join the optimisations on all readings; so many modes of the
        same model are begun from; so many are optimised from each plateau's neighbours.
    crossings : int
        Times that a fit goes on from where a parameter without a slope was moved.
    across : tuple of (int, int)
        Optimisations from there.
    readings : int
        Of a trial, about: every so many-th of each group, the least group all of eight.
    rough : float
        Error of a simulator's step in a trial, whatever the number of readings.
    forgotten : float, nats
        Ends this far below the best are left out.
    """

    trial: Schedule = ((3, 12), (5, 6), (12, 3))
    fresh: Schedule = ((8, 8), (16, 4))
    full: Schedule = ((6, 6), (30, 3))
    thorough: Schedule = ((2, 24), (6, 12), (30, 8))
    enough: float = 0.05
    hopeless: float = 15.0
    taken: int = 2
    crossings: int = 4
    across: Schedule = ((6, 6), (30, 3))
    readings: int = 36
    rough: float = 1e-3
    forgotten: float = 12.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fitted model.

    Parameters
    ----------
    problem : Problem
    modes : (n_modes, n_dim) array
        Optima, in sampling coordinates, best first.
    log_posteriors : (n_modes,) array
        Log posteriors there.
    predicted : (n_points,) array
        Predictions at the best, each in the unit of its reading.
    slope : (n_model, n_points) array
        Their derivatives by the sampling coordinates of the model.
    curvature : (n_modes, n_dim, n_dim) array
        Expected curvature of the log posterior at the modes.
    log_width : (n_modes, n_dim) array
        Of parameters of causes without a slope at a mode: logarithm of how wide the plateau around it is, of which the
        curvature knows nothing. nan of others.
    mass : (n_modes,) array
        Logarithm of what each mode holds by Laplace's approximation, bounds respected; along parameters without a slope
        the posterior itself is integrated.
    starts : (n_modes,) array of int
        Starts of optimisations that ended at each.
    effort : Effort
        What finding them has taken, starts that ended elsewhere included.
    """

    problem: Problem
    modes: FloatArray
    log_posteriors: FloatArray
    predicted: FloatArray
    slope: FloatArray
    curvature: FloatArray
    log_width: FloatArray
    mass: FloatArray
    starts: NDArray[np.intp]
    effort: Effort

    def __post_init__(self) -> None:
        object.__setattr__(self, "effort", Effort(*map(int, self.effort)))  # numbers, where it was kept as an array

    @property
    def covariance(self) -> FloatArray:
        """Laplace's approximation of each mode: inverse curvature within the bounds; (n_modes, n_dim, n_dim).

        A parameter without a slope is as wide as a normal density with the plateau's integral.
        """
        curvature = self.curvature.copy()
        of, k = np.nonzero(np.isfinite(self.log_width))
        curvature[of, k, k] = 2 * math.pi * np.exp(-2 * self.log_width[of, k])
        return np.asarray(np.linalg.inv(within_bounds(self.problem, curvature)))

    @property
    def laplace_of_one(self) -> float:
        """Laplace log evidence of the mode that holds most: what compares models whose other modes were not sought."""
        return float(self.mass.max())

    @property
    def laplace_apart(self) -> float:
        """Laplace log evidence; what several ends of one mode have in common counts once.

        Optimisations that end in different places of one mode are listed one by one. Each is counted in the part in
        which its normal is above the others' at its own top.
        """
        away = self.modes[:, None] - self.modes[None]  # (n_at, n_of, n_dim)
        log_posterior = self.log_posteriors - 0.5 * np.einsum("kmi,mij,kmj->km", away, self.curvature, away)
        return float(logsumexp(self.mass + self.log_posteriors - logsumexp(log_posterior, axis=1)))

    @property
    def terms(self) -> tuple[Term, ...]:
        """Causes of the model."""
        return self.problem.terms

    @property
    def ids(self) -> tuple[str, ...]:
        """Their identifiers."""
        return self.problem.ids

    @property
    def log_posterior(self) -> float:
        """Log posterior of the best mode."""
        return float(self.log_posteriors[0])

    @property
    def values(self) -> FloatArray:
        """Parameters of the best mode, in their units."""
        return self.problem.to_physical(self.modes[0])

    @property
    def log_likelihood(self) -> float:
        """Log likelihood of the best mode."""
        return self.log_posterior - float(self.problem.log_prior(self.modes[:1])[0])

    @property
    def noise(self) -> FloatArray:
        """The scatter's parameters at the best mode, as `Problem.noise_values` has them."""
        return self.problem.noise_values(self.modes[:1])

    @cached_property
    def scatter(self) -> FloatArray:
        """Standard width of each reading's scatter, um; (n_points,)."""
        return noise.scale(self.predicted[None, :], self.noise, self.problem.known_sigma)[0]

    @cached_property
    def relative_slope(self) -> FloatArray:
        """Derivatives of the ranges' logarithms, of a trace's samples, by the coordinates; (n_model, n_points)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            relative = np.where(self.predicted > 0, self.slope / self.predicted, 0.0)
        return np.asarray(np.where(self.problem.design.traced, self.slope, relative))

    def whitened(self, effect: FloatArray) -> FloatArray:
        """Changes of the readings, (n, n_points), in units of the scatter; along a trace beyond those before."""
        return noise.whitened((effect / self.scatter)[None], self.noise)[0]

    def project_out(
        self, effect: FloatArray, *, without: Term | None = None, slope: FloatArray | None = None
    ) -> FloatArray:
        """What a refit leaves of changes of the ranges, in units of the scatter.

        Parameters
        ----------
        effect : (n, n_points) array, each in the unit of its reading
        without : Term, optional
            A cause whose own parameters the refit leaves where they are.
        slope : (n_parameters, n_points) array, optional
            Of another model that is refitted instead.

        Returns
        -------
        (n, n_points) array
        """
        whitened = self.whitened(effect)
        if slope is not None:
            basis = self._spanned(slope)
        elif without is not None:
            rows = np.array(self.problem.without(without)[1])
            basis = self._spanned(self.slope[rows[rows < self.problem.n_model]])
        else:
            basis = self._basis
        return np.asarray(whitened - (whitened @ basis) @ basis.T)

    @cached_property
    def _basis(self) -> FloatArray:
        return self._spanned(self.slope)

    def _spanned(self, slope: FloatArray) -> FloatArray:
        """Orthonormal columns that span slopes by some coordinates, in units of the scatter."""
        known = self.whitened(slope)
        return np.linalg.qr(known[np.linalg.norm(known, axis=1) > 1e-9].T)[0]

    def within(self, larger: Problem) -> tuple[FloatArray, NDArray[np.intp]]:
        """The best mode in a larger model's coordinates, the new at its prior's median, and where the old is."""
        shared = np.array([larger.names.index(name) for name in self.problem.names])
        at = larger.medians
        at[shared] = self.modes[0]
        return at, shared

    def placed(self, problem: Problem, n_modes: int = 1) -> FloatArray:
        """The best modes in the coordinates of a model with other causes, which are at neutral values; (n, n_dim)."""
        known = [dict(zip(self.problem.names, self.problem.to_physical(u), strict=True)) for u in self.modes[:n_modes]]
        return np.array([joined_values(problem, values) for values in known])


def roughly(problem: Problem, settings: FitSettings) -> Problem:
    """A problem roughly simulated."""
    return replace(problem, tolerance=max(problem.tolerance, settings.rough))


def subsampled(problem: Problem, settings: FitSettings) -> Problem:
    """A problem roughly simulated, and of many readings with some of them only."""
    return roughly(problem, settings).thinned(max(problem.observed.size // settings.readings, 1))


def fit(
    problem: Problem,
    nested: Sequence[Candidate],
    *,
    seed: int,
    extra: FloatArray | None = None,
    draws: int = 256,
    most: int = 12,
    fresh: bool = True,
    settings: FitSettings | None = None,
) -> Candidate:
    """Fit a model from the optima of smaller ones and from draws of the prior.

    Parameters
    ----------
    problem : Problem
    nested : sequence of Candidate
        Models within this one, on the same readings. Without any, `extra` and `fresh` say nothing.
    seed : int
    extra : (n, n_dim) array, optional
        More starts.
    draws, most : int
        Draws of the prior that are looked at for starts, and starts taken from them, at least two; a model with nothing
        nested in it has no others.
    fresh : bool
        Whether optimisations begin at draws of the prior by themselves, too, and not only crossed with what is known.
    settings : FitSettings, optional

    Returns
    -------
    Candidate
        The problem's own optimum is never below that of a nested model by more than a strength off its neutral value
        costs.
    """
    s = settings or FitSettings()
    trial = subsampled(problem, s)
    if not nested:
        # One optimisation of each mode goes on: eight of the highest would lose a second that holds half of the
        # posterior.
        starts, n_drawn = starts_of(trial, seed, most, draws)
        tried = maximise(trial, starts, schedule=s.thorough, unite=True)
        end = maximise(problem, tried.u, still_below=s.enough, unite=True, counts=tried.starts)
        effort = tried.effort + Effort(n_sets=n_drawn + end.effort.n_sets)
        return candidate_of(problem, across_steps(problem, replace(end, effort=effort), s), forgotten=s.forgotten)
    rows: list[FloatArray] = []
    rough = roughly(problem, s)  # what a cause does may show in a few readings only
    given = np.empty((0, problem.n_dim)) if extra is None else extra
    for c in nested:
        for u in c.placed(rough, s.taken if c.ids == problem.ids else 1):
            # Where more starts are given, these know better than a second scan where to begin.
            new = [] if rows and len(given) else [t for t in problem.terms if t.id not in c.ids]
            rows.append(widened(rough, u, new, seed=seed))
    known = np.vstack([*rows, given])
    crossed, n_drawn = starts_of(trial, seed, most // 2, draws // 2, known)
    races: list[tuple[FloatArray, Schedule]] = [(np.vstack([known, crossed]), s.trial)]
    if fresh:
        # Optimisations from far away begin lower than those from what is known, and may end higher: they have their own
        # race.
        begun, n_fresh = starts_of(trial, seed, most, draws)
        races.append((begun, s.fresh))
        n_drawn += n_fresh
    end, effort = raced(problem, trial, known, races, s)
    effort += Effort(n_sets=n_drawn)
    return candidate_of(problem, replace(across_steps(problem, end, s), effort=effort))


def raced(
    problem: Problem,
    trial: Problem,
    known: FloatArray,
    races: Sequence[tuple[FloatArray, Schedule]],
    settings: FitSettings,
) -> tuple[Optima, Effort]:
    """Optimise from some starts: on a trial, some of the readings, and the best of that on all of them.

    Parameters
    ----------
    problem, trial : Problem
        All the readings, and those of the trial.
    known : (n, n_dim) array
        Some of the readings may mislead where few of them count: the best of these on all readings go on, too. They
        hold the smaller models' optima: no optimisation ends below those.
    races : sequence of (n, n_dim) array and schedule
        Starts of the trial, and how they are optimised; each race has its winners.
    settings : FitSettings

    Returns
    -------
    Optima and Effort
        The ends on all readings, and what all of it has taken.
    """
    s, there = settings, problem.log_posterior(known)
    trials = [
        maximise(trial, starts, schedule=schedule, still_below=s.enough, unite=True) for starts, schedule in races
    ]
    tried, log_posterior = np.vstack([t.u for t in trials]), np.concatenate([t.log_posterior for t in trials])
    best_known = known[np.argsort(-there, kind="stable")[: s.taken]]
    hopeful = log_posterior > log_posterior.max() - s.hopeless
    starts = np.vstack([tried[hopeful], best_known])
    counts = np.concatenate([np.concatenate([t.starts for t in trials])[hopeful], np.ones(len(best_known), np.intp)])
    end = maximise(problem, starts, schedule=s.full, still_below=s.enough, unite=True, counts=counts)
    return end, sum((t.effort for t in trials), Effort(len(best_known), 0, len(known) + end.effort.n_sets))


def built_up(
    problem: Problem, *, seed: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> Candidate:
    """Fit a model by way of smaller ones: from the baseline on, each time with the cause that helps most.

    No draw of the prior comes near the top of a model whose many causes hold each other in place.

    Parameters
    ----------
    problem : Problem
    seed : int
    progress : callable
        Called with (models fitted, models to fit).
    """
    best = fit(replace(problem, terms=()), (), seed=seed)
    left = list(problem.terms)
    total, done = len(left) * (len(left) + 1) // 2, 0
    while left:
        tried = []
        for new in left:
            larger = tuple(t for t in problem.terms if t is new or t in best.terms)
            tried.append(fit(replace(problem, terms=larger), [best], seed=seed))
            done += 1
            progress(done, total)
        best = max(tried, key=lambda c: c.laplace_apart)
        left = [t for t in left if t not in best.terms]
    return best


def refitted(problem: Problem, like: Candidate) -> Candidate:
    """A model on fewer groups, optimised from where it was."""
    return optimised(problem, like.placed(problem))


def optimised(problem: Problem, starts: FloatArray) -> Candidate:
    """A model optimised from some starts, (n, n_dim) in sampling coordinates."""
    return candidate_of(problem, maximise(problem, starts, still_below=FitSettings.enough))


def across_steps(problem: Problem, end: Optima, s: FitSettings) -> Optima:
    """Go on where a parameter has no slope: what acts by thresholds may be better a step away."""
    if not np.isfinite(end.log_posterior).any():
        return end
    for _ in range(s.crossings):
        here, log_posterior = end.predicted[end.best], float(end.log_posterior[end.best])
        rows, width = _steps_away(problem, end.u[end.best], here)
        found = problem.predict(rows)
        value = log_posteriors(problem, rows, found, problem.observed)
        # One row of each step, what holds most first; none of that on which the optimisations have ended.
        steps: dict[bytes, list[int]] = {}
        for k in np.argsort(-value, kind="stable"):
            steps.setdefault(found[k].tobytes(), []).append(int(k))
        steps.pop(here.tobytes(), None)
        held = sorted(steps.values(), key=lambda step: -value[step[0]] - math.log(width[step].sum()))
        starts = [step[0] for step in held if value[step[0]] > log_posterior - s.hopeless][: s.taken]
        if not starts:
            break
        moved = maximise(problem, rows[starts], schedule=s.across, still_below=s.enough, unite=True).uncounted
        names = ("u", "log_posterior", "predicted", "starts")
        both = {name: np.concatenate([getattr(o, name) for o in (end, moved)]) for name in names}
        end = Optima(**both, effort=end.effort + moved.effort)
        if moved.log_posterior.max() < log_posterior + s.enough:
            break
    return end


def _steps_away(problem: Problem, u: FloatArray, predicted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Each parameter without a slope moved to either side, by halves of its prior's width.

    Returns
    -------
    (n, n_dim) and (n,) array
        Rows, and how far each lies from the next one inwards: widths of what they stand for.
    """
    halves = 2.0 ** -np.arange(2, 12)
    slope = slopes(problem, u[None], predicted[None])[0]
    rows, widths = [np.empty((0, u.size))], [np.empty(0)]
    for k in np.flatnonzero(~slope.any(axis=1)):
        width = np.ptp(problem.parameters[k].prior_quantile(np.array([0.05, 0.95])))
        moved = np.repeat(u[None], 2 * halves.size, axis=0)
        moved[:, k] = np.clip(u[k] + width * np.concatenate([-halves, halves]), *problem.bounds[k])
        rows.append(moved)
        widths.append(width * np.tile(halves, 2) / 2)
    return np.vstack(rows), np.concatenate(widths)


def candidate_of(
    problem: Problem, end: Optima, *, forgotten: float = FitSettings.forgotten, same: float = 0.1
) -> Candidate:
    """Turn the ends of optimisations into a candidate; `ConvergenceError` where no posterior there is finite.

    Parameters
    ----------
    problem : Problem
    end : Optima
    forgotten : float, nats
        As of `FitSettings`.
    same : float
        Two are one where all coordinates of the model agree to this.
    """
    if not np.isfinite(end.log_posterior).any():
        raise ConvergenceError("search for a finite posterior", reached=0, required=1)
    order = np.argsort(-end.log_posterior, kind="stable")
    modes: dict[int, int] = {}  # and the starts that ended there
    for k in order:
        known = [m for m in modes if np.abs(end.u[k] - end.u[m])[: problem.n_physical].max() < same]
        if known:
            modes[known[0]] += int(end.starts[k])
        elif end.log_posterior[k] > end.log_posterior[order[0]] - forgotten:
            modes[int(k)] = int(end.starts[k])
    rows = list(modes)
    u, predicted = end.u[rows], end.predicted[rows]
    slope = slopes(problem, u, predicted)
    observed = np.broadcast_to(problem.observed, predicted.shape)
    gradient, curvature = expansion(problem, u, predicted, slope, observed)
    top = end.log_posterior[rows]
    line, width = _along_plateaus(problem, u, top, slope)
    mass = [_laplace(problem, u[k], float(top[k]), gradient[k], curvature[k], line[k]) for k in range(len(rows))]
    return Candidate(
        problem, u, top, predicted[0], slope[0], curvature, width, np.array(mass),
        np.array(list(modes.values()), np.intp), end.effort,
    )  # fmt: skip


def candidate_at(
    problem: Problem, modes: FloatArray, starts: NDArray[np.intp] | None = None, effort: Effort | None = None
) -> Candidate:
    """A candidate with these optima, as they stand.

    Parameters
    ----------
    problem : Problem
    modes : (n, n_dim) array
    starts : (n,) array of int, optional
        Starts that ended at each; none by default.
    effort : Effort, optional
        What finding them has taken.
    """
    predicted, starts = problem.predict(modes), np.zeros(len(modes), np.intp) if starts is None else starts
    log_posterior = log_posteriors(problem, modes, predicted, problem.observed)
    return candidate_of(problem, Optima(modes, log_posterior, predicted, starts, effort or Effort()))


def united(*fits: Candidate) -> Candidate:
    """The modes of several fits of the same model."""
    modes, starts = np.vstack([c.modes for c in fits]), np.concatenate([c.starts for c in fits])
    return candidate_at(fits[0].problem, modes, starts, sum((c.effort for c in fits), Effort()))


def principal(candidate: Candidate) -> Candidate:
    """Leave out modes that hold a negligible part of the posterior: drawn from, they would hide the others."""
    kept = _weighty(candidate)
    return candidate_at(candidate.problem, candidate.modes[kept], candidate.starts[kept], candidate.effort)


def _weighty(candidate: Candidate, minor: float = 5.0) -> NDArray[np.intp]:
    """Modes that have at most `minor` nats less of the posterior than the greatest.

    A high and narrow one may have less than one that is seven nats lower.
    """
    return np.flatnonzero(candidate.mass > candidate.mass.max() - minor)


def separate_modes(candidate: Candidate, *, apart: float = 4.0, valley: float = 2.0, points: int = 7) -> list[int]:
    """Separate modes of the posterior, the best place of each: where other parameters fit as well.

    Parameters
    ----------
    candidate : Candidate
    apart : float
        Standard deviations of either mode by which they lie apart.
    valley : float, nats
        Depth to which the straight way between them leads: else they are on one ridge.
    points : int
        At which that way is looked at.
    """
    problem = candidate.problem
    curvature = within_bounds(problem, candidate.curvature)
    tops, steps = [0], np.arange(1, points + 1)[:, None] / (points + 1)
    for k in _weighty(candidate):
        away = candidate.modes[k] - candidate.modes[tops]
        own = np.sum((away @ curvature[k]) * away, axis=1)
        theirs = np.einsum("mi,mij,mj->m", away, curvature[tops], away)
        if min(own.min(), theirs.min()) < apart**2:
            continue
        way = np.vstack([candidate.modes[m] + steps * (candidate.modes[k] - candidate.modes[m]) for m in tops])
        lowest = problem.log_posterior(way).reshape(len(tops), -1).min(axis=1)
        if (lowest < candidate.log_posteriors[k] - valley).all():
            tops.append(int(k))
    return tops


def within_bounds(problem: Problem, curvature: FloatArray) -> FloatArray:
    """A curvature by which no coordinate is wider than its bounds, though the readings may say nothing of it."""
    return curvature + np.diag((3.5 / np.ptp(problem.bounds, axis=1)) ** 2)


def places_along(problem: Problem, u: FloatArray, k: int, *, halvings: int = 12) -> FloatArray:
    """Coordinate `k` of a place, both bounds, and halves of their width to either side of it; ascending."""
    apart = np.ptp(problem.bounds[k]) * 0.5 ** np.arange(halvings)
    return np.clip(np.concatenate([u[k] - apart, u[k : k + 1], (u[k] + apart)[::-1]]), *problem.bounds[k])


def _along_plateaus(
    problem: Problem, u: FloatArray, log_posterior: FloatArray, slope: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Log integral of the posterior, over its density at the mode, along coordinates without a slope; (n_modes, n_dim).

    Along the whole line, and of the plateau around the mode alone; nan of parameters with a slope. What acts by
    thresholds may be determined a hundred times better than by its prior, or not at all.
    """
    line, width = np.full((2, *u.shape), np.nan)
    for k in range(len(baseline.PARAMETERS), problem.n_physical):
        flat = np.flatnonzero(~slope[:, k].any(axis=1))
        if not flat.size:
            continue
        place = np.array([places_along(problem, u[m], k) for m in flat])
        rows = np.repeat(u[flat], place.shape[1], axis=0)
        rows[:, k] = place.ravel()
        value = log_posteriors(problem, rows, problem.predict(rows), problem.observed).reshape(place.shape)
        value -= log_posterior[flat, None]
        apart, middle = np.diff(place, axis=1), place.shape[1] // 2
        weight = 0.5 * (np.pad(apart, ((0, 0), (1, 0))) + np.pad(apart, ((0, 0), (0, 1))))
        line[flat, k] = logsumexp(value, b=weight, axis=1)
        for side in (value[:, middle:], value[:, middle::-1]):
            side[:] = np.minimum.accumulate(np.minimum(side, 0.0), axis=1)
        width[flat, k] = logsumexp(value, b=weight, axis=1)
    return line, width


def _laplace(
    problem: Problem,
    u: FloatArray,
    log_posterior: float,
    gradient: FloatArray,
    curvature: FloatArray,
    line: FloatArray,
) -> float:
    """Log mass of a mode: normal, cut at the bounds coordinate by coordinate; `line` is as of `_along_plateaus`."""
    low, high = u - problem.bounds[:, 0], problem.bounds[:, 1] - u
    curvature = within_bounds(problem, curvature)
    covariance = np.linalg.inv(curvature)
    total = log_posterior + 0.5 * (u.size * math.log(2 * math.pi) - np.linalg.slogdet(curvature)[1])
    for i in range(u.size):
        c = 1.0 / max(covariance[i, i], 1e-300)
        if math.isfinite(line[i]):  # integrated already, bounds included
            total += float(line[i]) - 0.5 * math.log(2 * math.pi / c)
            continue
        # At a bound the slope is not zero: exp(-g x - c x^2 / 2) over the half line, over the whole normal's mass.
        near, g = (low[i], -gradient[i]) if low[i] < high[i] else (high[i], gradient[i])
        if near < 1e-6:
            total += math.log(0.5 * erfcx(max(g, 0.0) / math.sqrt(2 * c)) + 1e-300)
        else:
            total += float(log_ndtr(near * math.sqrt(c)))
    return total

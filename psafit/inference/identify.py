"""What the data determine, and what they do not."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from psafit.arrays import FloatArray
from psafit.inference.optimiser import Optima, expansion, maximise, slopes
from psafit.inference.problem import Problem
from psafit.parameters import Parameter
from psafit.physics import baseline
from psafit.records import ProfilePoint
from psafit.text import prefixed, resolved, span_text, with_unit

# Half the 90 % point of chi-square with one degree of freedom (Wilks): the drop of log likelihood at either end of a
# 90 % interval, hence at a single limit that holds with 95 %.
DROP_90 = 1.353


@dataclass(frozen=True)
class ProfileSettings:
    """How a profile is walked.

    Parameters
    ----------
    closed : float, nats
        Drop beyond which a side is closed; a little above `DROP_90`, so that the limit can be interpolated.
    smooth : float, nats
    jump : float
        Neighbouring points differ by no more than `smooth`, unless the likelihood jumps between coordinates as close
        as `jump`.
    across : int
        Points across it, at least.
    first : float
        First step, in widths of the likelihood there.
    flattest : float
        Curvature of what the data do not determine at all.
    """

    closed: float = 3.0
    smooth: float = 0.35
    jump: float = 5e-3
    across: int = 12
    first: float = 0.7
    flattest: float = 0.04


class _Likelihood(Problem):
    """A problem with flat priors for the baseline and the scatter.

    Those of a cause, and of what each session has for itself, are a part of what the model says: without them a profile
    of the baseline leads to where a ball leans by centimetres.
    """

    @cached_property
    def _shapes(self) -> FloatArray:
        found = np.tile([[0.0], [np.inf], [0.0], [1.0], [-np.inf]], self.n_dim)
        own = slice(len(baseline.PARAMETERS), self.n_model)
        found[:, own] = super()._shapes[:, own]
        return found

    def profiled(self, ends: Optima, columns: Sequence[int]) -> FloatArray:
        """Log posterior where optimisations ended, each without the prior of the column that it is to profile; (n,)."""
        priors = [
            float(self.parameters[k].log_prior(u[k])) if len(baseline.PARAMETERS) <= k < self.n_model else 0.0
            for k, u in zip(columns, ends.u, strict=True)
        ]
        return ends.log_posterior - np.array(priors)


@dataclass(eq=False)
class _Walk:
    """One parameter's profile while it is walked: its column, and points by its coordinate, ascending."""

    index: int
    points: list[tuple[FloatArray, float]]
    how: ClassVar = ProfileSettings()
    again: set[tuple[float, float, float]] = field(default_factory=set)

    def add(self, u: FloatArray, log_posterior: float) -> None:
        """Add a point; of two at one coordinate the higher stays."""
        place = float(u[self.index])
        known = {float(v[self.index]): (v, value) for v, value in self.points}
        if place not in known or known[place][1] < log_posterior:
            known[place] = (u, log_posterior)
        self.points = [known[at] for at in sorted(known)]

    @property
    def highest(self) -> float:
        return max(log_posterior for _, log_posterior in self.points)

    def profile(self, parameter: Parameter) -> list[ProfilePoint]:
        """Return the points with their values."""
        values = ((float(parameter.to_physical(u[self.index])), value) for u, value in self.points)
        return [ProfilePoint(*pair) for pair in dict.fromkeys((x, self.highest - value) for x, value in values)]

    def next(self, side: int, width: float, low: float, high: float) -> FloatArray | None:
        """Return the next place on one side: along the last step, as far as changes the drop by a part of the rest."""
        last, before = (self.points[0], self.points[1]) if side < 0 else (self.points[-1], self.points[-2])
        at = last[0][self.index]
        if self.highest - last[1] > self.how.closed or at in (low, high):
            return None
        change, step = before[1] - last[1], last[0] - before[0]
        ahead = abs(step[self.index])
        wanted = ahead * (2.0 if change < 0.1 else 1.0 if change < 0.6 else 0.5)
        wanted = min(max(wanted, 0.1 * width), abs((high if side > 0 else low) - at))
        along = step / max(ahead, 1e-12)
        start = last[0] + along * wanted
        start[self.index] = np.clip(at + side * wanted, low, high)
        return start

    def gaps(self) -> list[FloatArray]:
        """Midpoints of what lies too far apart."""
        inside = [
            float(u[self.index]) for u, log_posterior in self.points if log_posterior > self.highest - self.how.closed
        ]
        widest = max((max(inside) - min(inside)) / self.how.across, self.how.jump)
        return [
            0.5 * (a + b)
            for (a, log_posterior), (b, other) in itertools.pairwise(self.points)
            if max(log_posterior, other) > self.highest - self.how.closed
            and (
                b[self.index] - a[self.index] > widest
                or (abs(log_posterior - other) > self.how.smooth and b[self.index] - a[self.index] > self.how.jump)
            )
        ]

    def dips(self) -> list[FloatArray]:
        """Points below what lies on either side of them, once more from each neighbour: refits may have ended early.

        So may the last on a side, which would close it.
        """
        found, starts = [log_posterior for _, log_posterior in self.points], []
        for k in range(len(found)):
            sides = [max(side) for side in (found[:k], found[k + 1 :]) if side]
            if found[k] > min(sides, default=-math.inf) - self.how.smooth:
                continue
            for near in range(max(k - 1, 0), min(k + 2, len(found))):
                start = self.points[near][0].copy()
                tried = (float(self.points[k][0][self.index]), float(start[self.index]), found[near])
                if tried not in self.again and found[near] > found[k]:
                    self.again.add(tried)
                    start[self.index] = tried[0]
                    starts.append(start)
        return starts


def profiles(
    problem: Problem,
    top: FloatArray,
    progress: Callable[[int, int], None] = lambda done, total: None,
    columns: Sequence[int] | None = None,
) -> list[list[ProfilePoint]]:
    """Profile likelihoods, each walked outwards from the top until both sides close or a bound is met.

    All are walked at once: what one step costs is a batch.

    Parameters
    ----------
    problem : Problem
    top : (n_dim,) array
        Sampling coordinates near the highest likelihood.
    progress : callable
        Called with (profiles done, profiles).
    columns : sequence of int, optional
        Columns of the parameters; all physical ones by default.

    Returns
    -------
    list of list of ProfilePoint
        One list a column, ascending in the value; `drop` is zero at the highest of its points. All else is found anew
        at every point; the other parameters of causes, and what each session has for itself, weighted by their priors.
        Empty for a cause that differs by session: its spread and what sessions have in units of it have no top.
    """
    how = ProfileSettings()
    likelihood = _Likelihood(**{f.name: getattr(problem, f.name) for f in fields(problem)})
    columns = range(problem.n_physical) if columns is None else columns
    by_session = {p.name for t in problem.terms if t.latent for p in t.parameters}
    low, high = likelihood.bounds.T

    def optimise(starts: Sequence[tuple[_Walk, FloatArray]]) -> None:
        rows = np.array([start for _, start in starts])
        held = np.zeros(rows.shape, bool)
        held[np.arange(len(rows)), [walk.index for walk, _ in starts]] = True
        end = maximise(likelihood, rows, frozen=held)
        log_posteriors = likelihood.profiled(end, [walk.index for walk, _ in starts])
        for (walk, _), u, log_posterior in zip(starts, end.u, log_posteriors, strict=True):
            walk.add(u, float(log_posterior))

    peak = maximise(likelihood, np.clip(top, low, high))
    slope = slopes(likelihood, peak.u, peak.predicted)
    _, curvature = expansion(likelihood, peak.u, peak.predicted, slope, likelihood.observed[None])
    spread = np.linalg.pinv(curvature[0] + how.flattest * np.eye(likelihood.n_dim))
    width = np.sqrt(np.maximum(np.diag(spread), 1e-12))
    walked = (k for k in columns if problem.names[k] not in by_session)
    walks = [_Walk(k, [(peak.u[0], float(likelihood.profiled(peak, [k])[0]))]) for k in walked]
    first = []
    for walk in walks:
        k = walk.index
        for side in (-1.0, 1.0):
            start = np.clip(peak.u[0] + side * how.first * width[k] * spread[k] / spread[k, k], low, high)
            if start[k] != peak.u[0, k]:
                first.append((walk, start))
    optimise(first)
    while True:
        asked = [
            (walk, np.clip(start, low, high))
            for walk in walks
            for side in (-1, 1)
            if len(walk.points) > 1
            and (start := walk.next(side, width[walk.index], low[walk.index], high[walk.index])) is not None
        ]
        # What has a dip gets no points between before that is sound.
        going = asked or [(walk, start) for walk in walks for start in walk.dips() or walk.gaps()]
        if not going:
            break
        optimise(going)
        busy = {walk.index for walk, _ in going}
        progress(len(walks) - len(busy), len(walks))
    progress(len(walks), len(walks))
    found = {walk.index: walk.profile(problem.parameters[walk.index]) for walk in walks}
    return [found.get(k, []) for k in columns]


def limits(points: list[ProfilePoint]) -> tuple[float | None, float | None]:
    """Values where the profile has dropped by `DROP_90`; None where a side stays open."""
    value = np.array([p.value for p in points])
    drop = np.array([p.drop for p in points])
    top = int(np.argmin(drop))

    def crossing(order: NDArray[np.intp]) -> float | None:
        for inner, outer in itertools.pairwise(order):
            if drop[outer] >= DROP_90 > drop[inner]:
                share = (DROP_90 - drop[inner]) / (drop[outer] - drop[inner])
                return float(value[inner] + share * (value[outer] - value[inner]))
        return None

    return crossing(np.arange(top, -1, -1)), crossing(np.arange(top, len(points)))


def verdict(points: list[ProfilePoint]) -> str:
    """One of "determined", "bounded above", "bounded below", "not determined"."""
    lower, upper = limits(points)
    return _word(lower is not None, upper is not None)


def verdict_of_draws(
    draws: FloatArray,
    parameter: Parameter,
    contraction: float,
    *,
    informed: float = 0.5,
    across: int = 12,
    points: int = 4001,
    least: float = 0.02,
) -> str:
    """Say in a word what the readings say of a parameter without a profile, from its posterior over its prior.

    A side is closed where they make its end less probable, by as much as a profile must drop. Neither a bound at which
    the posterior piles up is a limit of theirs, nor what the prior alone holds back.

    Parameters
    ----------
    draws : (n_draws,) array
        Posterior, in the sampling coordinate.
    parameter : Parameter
    contraction : float
        One minus the ratio of posterior to prior variance.
    informed : float
        Contraction below which the posterior is the prior with another name.
    across : int
        Parts of equal probability in which the posterior is compared with the prior.
    points : int
        Between the bounds.
    least : float
        Share of the posterior that would be expected in an end for that to be looked at.
    """
    if contraction < informed:
        return "not determined"
    edges = np.quantile(draws, np.linspace(0, 1, across + 1))
    prior = np.exp(parameter.log_prior(0.5 * (edges[1:] + edges[:-1])))
    highest = float(np.max(1 / (across * np.maximum(np.diff(edges), 1e-12) * prior)))
    ends = parameter.sampling_bounds
    x = np.linspace(ends.lower, ends.upper, points)
    # Share of the posterior that would lie below each x, and above it, if the readings spoke for that end as for the
    # best.
    below = cumulative_trapezoid(highest * np.exp(parameter.log_prior(x)), x, initial=0)
    closed = []
    for share, inside in ((below, np.less_equal), (below[-1] - below, np.greater_equal)):
        k = int(np.argmin(np.where(share > least, share, np.inf)))
        closed.append(bool(np.mean(inside(draws, x[k])) < math.exp(-DROP_90) * min(share[k], 1.0)))
    return _word(*closed)


def _word(closed_below: bool, closed_above: bool) -> str:
    if closed_below and closed_above:
        return "determined"
    if closed_above:
        return "bounded above"
    return "bounded below" if closed_below else "not determined"


def one_sided(points: list[ProfilePoint], interval: tuple[float, float]) -> tuple[float | None, float | None]:
    """Limits that hold with 95 % each: of the profile, or of the posterior where there is none."""
    return limits(points) if points else interval


def supported(unit: str, points: list[ProfilePoint], interval: tuple[float, float], word: str) -> str:
    """What the data support where that is no interval; nothing where it is one."""
    if word == "determined":
        return ""
    if word == "not determined":
        return "is not determined by these data"
    lower, upper = one_sided(points, interval)
    side, limit = ("most", upper) if word == "bounded above" else ("least", lower)
    assert limit is not None  # bounded on one side
    unit, (limit, spread) = prefixed(unit, limit, min(abs(limit), (interval[1] - interval[0]) / 2))
    return f"at {side} {with_unit(resolved(limit, spread), unit)} (95 %)"


def profiled(unit: str, points: list[ProfilePoint], interval: tuple[float, float], word: str) -> str:
    """Behind a limit of the profile likelihood: that it is one, and what the posterior has, priors included."""
    if not points or not word.startswith("bounded"):
        return ""
    unit, ends = prefixed(unit, *interval)
    lower, upper = (resolved(end, (ends[1] - ends[0]) / 2) for end in ends)
    by_posterior = f"{lower} to {with_unit(upper, unit)}"
    return f"; that is by the profile likelihood; by the posterior, with its priors: {by_posterior} (90 %)"


def not_expected(unit: str, expected: tuple[float, float] | None) -> str:
    """What is added to an implausible value: where its prior expects it."""
    where = f" ({span_text(unit, expected)} expected)" if expected else ""
    return f"; implausible under its prior{where}"


def describe(
    name: str, unit: str, median: float, interval: tuple[float, float], points: list[ProfilePoint], word: str
) -> str:
    """The value as far as the data support it, in words."""
    if word == "determined":
        unit, (median, *ends) = prefixed(unit, median, *interval)
        spread = (ends[1] - ends[0]) / 2
        lower, upper = (resolved(end, spread) for end in ends)
        return f"{name} = {with_unit(resolved(median, spread), unit)} (90 %: {lower} to {upper})"
    if word == "not determined":
        why = "neither side of its profile closes" if points else "its interval is little narrower than the prior's"
    else:
        why = f"these readings give no {'lower' if word == 'bounded above' else 'upper'} limit"
    return f"{name} {supported(unit, points, interval, word)}; {why}"

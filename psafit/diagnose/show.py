r"""Show what is wrong, in the user's language: growth with voltage and frequency, and parameters that had to drift.

*Growth.* Local exponents :math:`\partial\ln L/\partial\ln V` and :math:`\partial\ln L/\partial\ln f` of readings and
predictions, by straight lines through windows of neighbouring readings of one sweep, each reading with its scatter.

*Corners.* Where the exponent changes most: two straight lines in the logarithms of range and swept variable, joined at
the corner. Its interval holds all corners that do nearly as well by the lines' own residuals.

*Drift.* Each of the fit's parameters in turn is let vary along a covariate, as a piecewise linear function with three
free values about the fitted one, in the expansion of the model. The gain says whether letting it drift would mend the
misfit; the slope says which way it must drift. A parameter that must drift points at the mechanism it stands in for.

*Lines.* What a model says at the readings and between them, and what it would say without each of its causes.

*Sessions.* Where two sessions share conditions, the factor between their readings, by what is read: a gain of a
session makes one factor of all that an instrument reads.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.stats import f, norm, t

from psafit.arrays import FloatArray
from psafit.diagnose.residuals import conditions, in_group, sweeps
from psafit.experiment import GroupId, by_part, read_as
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, named, recorded_name
from psafit.physics.term import Term
from psafit.records import ABSENT
from psafit.validate import without_each


@dataclass(frozen=True)
class Growth:
    """Local exponents of one sweep, window by window.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude"}
    at : list of float, Hz or V
        Middle of each window.
    measured, lower, upper, simulated : list of float
        Exponent of the readings with its 90 % interval, and of the predictions.
    """

    group: GroupId
    variable: str
    at: list[float]
    measured: list[float]
    lower: list[float]
    upper: list[float]
    simulated: list[float]


@dataclass(frozen=True)
class Line:
    """A model along one sweep, at the readings and between them.

    Parameters
    ----------
    group : group id
    observable : str, optional
        What is read, by its name; left out for the launch range.
    at : list of float, Hz, V or us
        Ascending.
    value : list of float
        In the unit of the observable; the key is "um".
    without : dict of str to list of float
        By cause: without it, all else left as it is; the key is "without_um".
    """

    group: GroupId
    at: list[float]
    value: list[float] = field(metadata={"key": "um"})
    without: dict[str, list[float]] = field(metadata={"key": "without_um"})
    observable: str | None = field(default=None, metadata=ABSENT)

    @property
    def of(self) -> tuple[str, str]:
        """Which sweep it is: the group's id, and the name of what is read."""
        return str(self.group), self.observable or LAUNCH_RANGE.name


def lines(candidate: Candidate) -> list[Line]:
    """A fitted model along every sweep of one variable."""
    problem, top = candidate.problem, candidate.modes[:1]
    groups = [g.filled() for g in problem.experiment.select(problem.group_ids)]
    n_points = sum(g.n_points for g in groups)
    finer = replace(problem, experiment=replace(problem.experiment, groups=read_as(groups, np.zeros(n_points))))
    each = {id: by_part(groups, um) for id, um in without_each(finer, top, finer.group_ids).items()}
    parts = [part for whole in groups for part in whole.parts]
    return [
        Line(
            g.id,
            g.along.tolist(),
            um.tolist(),
            {id: without[k].tolist() for id, without in each.items()},
            recorded_name(g.observable),
        )
        for k, (g, um) in enumerate(zip(parts, by_part(groups, finer.predict(top)[0]), strict=True))
        if g.along is not None
    ]


@dataclass(frozen=True)
class Corner:
    """Where the growth of one sweep changes.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude"}
    measured, lower, upper : float, Hz or V, optional
        Corner of the readings with its 90 % interval; None where one line does.
    exponents : (float, float), optional
        Of the readings below it and above.
    simulated : float, optional
        Corner of the predictions; None where these readings' scatter would hide it.
    simulated_exponents : (float, float), optional
    """

    group: GroupId
    variable: str
    measured: float | None
    lower: float | None
    upper: float | None
    exponents: tuple[float, float] | None
    simulated: float | None
    simulated_exponents: tuple[float, float] | None


@dataclass(frozen=True)
class Drift:
    """What letting one parameter drift along one covariate would gain.

    Parameters
    ----------
    parameter : str
    variable : {"frequency", "amplitude", "range", "waveform", "order"}
        The last from the first reading of each group to its last; waveform from the first kind of drive, a sine
        where there is one, to the kind that differs most from it.
    gain : float
        Nats, in the expansion, with the scatter refitted.
    factor : float
        Factor by which a scale would have to change from the low end of the covariate to the high end; of other
        parameters, e to the change in its prior's standard deviations. At most e^9.
    """

    parameter: str
    variable: str
    gain: float
    factor: float


@dataclass(frozen=True)
class Offset:
    """How the readings of two sessions differ at the conditions that both have.

    Parameters
    ----------
    first, second : int or str
        The sessions: groups' ids, or their names.
    n_conditions : int
    factor, lower, upper : float
        Of the second over the first, with its 90 % interval by the fitted scatter.
    observable : str, optional
        What is read; None for launch ranges.
    instrument : str, optional
        Name of what reads it, where it has one.
    """

    first: GroupId
    second: GroupId
    n_conditions: int
    factor: float
    lower: float
    upper: float
    observable: str | None = field(default=None, metadata=ABSENT)
    instrument: str | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Unlike:
    """Two sessions that differ by one factor in what is read, and by another in something else.

    Parameters
    ----------
    cause : str
        What would move both by the same factor.
    first, second : Offset
    """

    cause: str
    first: Offset
    second: Offset

    @property
    def chance(self) -> float:
        """Chance that one factor comes out as two that are so far apart, taken to be independent.

        Scatter that is common to both makes them differ less. Student's law with as many degrees of freedom as both
        have conditions.
        """
        both = (self.first, self.second)
        variances = [(math.log(o.upper / o.lower) / (2.0 * norm.ppf(0.95))) ** 2 for o in both]
        apart = abs(math.log(self.first.factor / self.second.factor)) / math.sqrt(sum(variances))
        return float(2.0 * t.sf(apart, sum(o.n_conditions for o in both)))


def unlike(found: Sequence[Offset], causes: Iterable[Term], level: float) -> Unlike | None:
    """The factors of two sessions that differ most between two observables of one instrument, if they do at some level.

    Compared is what a cause multiplies by one factor for each session; all comparisons that were made are counted.
    """
    pairs = [
        Unlike(cause.id, a, b)
        for cause in causes
        for a, b in itertools.combinations(found, 2)
        if cause.latent and cause.reading
        and (a.first, a.second, a.instrument) == (b.first, b.second, b.instrument)
        and {named(a.observable).name, named(b.observable).name} <= {*cause.reads}
    ]  # fmt: skip
    most = min(pairs, key=lambda pair: pair.chance, default=None)
    return most if most and most.chance * len(pairs) < level else None


def offsets(candidate: Candidate) -> list[Offset]:
    """Every pair of sessions that share conditions at which both have readings above zero, by what is read.

    (Samples of a trace are no conditions: their errors are correlated.)
    """
    problem, session = candidate.problem, candidate.problem.design.session
    y, nu = problem.observed, noise.columns(candidate.noise)[2][0]
    # The scale of Student's law is less than its standard deviation.
    wide = np.sqrt(nu / np.maximum(nu - 2, 1e-12))
    relative = np.where(nu > 2, candidate.scatter * wide / np.maximum(y, 1e-9), 1.0)
    found: dict[tuple[int, int, int], list[tuple[float, float]]] = {}
    instruments = dict(problem.experiment.instruments)
    for rows in conditions(problem.design):
        if problem.design.traced[rows[0]]:
            continue
        sessions = {k: rows[(session[rows] == k) & (y[rows] > 0)] for k in np.unique(session[rows]).tolist()}
        for a, b in itertools.combinations([k for k, own in sessions.items() if own.size], 2):
            logs = [float(np.log(y[sessions[k]]).mean()) for k in (a, b)]
            variance = sum(float(np.sum(relative[sessions[k]] ** 2)) / sessions[k].size ** 2 for k in (a, b))
            of = int(problem.design.measured[rows[0]])
            found.setdefault((a, b, of), []).append((logs[1] - logs[0], variance))
    result = []
    for (a, b, of), pairs in found.items():
        ratio, weight = np.array([p[0] for p in pairs]), 1 / np.array([p[1] for p in pairs])
        mean, sd = float(np.average(ratio, weights=weight)), float(1 / np.sqrt(weight.sum()))
        factor, low, high = np.exp(mean + sd * norm.ppf([0.5, 0.05, 0.95])).tolist()
        observable, (first, second) = OBSERVABLES[of], (problem.occasions.sessions[k] for k in (a, b))
        read = recorded_name(observable), instruments.get(observable.column)
        result.append(Offset(first, second, len(pairs), factor, low, high, *read))
    return result


def growth(candidate: Candidate, *, window: int = 9) -> list[Growth]:
    """Exponents of all sweeps of a fit's groups, by straight lines through so many neighbours."""
    wide = float(t.ppf(0.95, window - 2))  # standard errors to either end of a 90 % interval
    result = []
    for group_id, variable, x, y, p, relative in _logarithms(candidate):
        found = Growth(group_id, variable, [], [], [], [], [])
        for k in range(0, x.size - window + 1):
            part = slice(k, k + window)
            if np.ptp(x[part]) < 0.1:
                continue
            slope, error = _line(x[part], y[part], relative[part])
            modelled, _ = _line(x[part], p[part], relative[part])
            found.at.append(float(np.exp(x[part].mean())))
            found.measured.append(slope)
            found.lower.append(slope - wide * error)
            found.upper.append(slope + wide * error)
            found.simulated.append(modelled)
        result.append(found)
    return result


def _logarithms(
    candidate: Candidate,
) -> Iterator[tuple[GroupId, str, FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Each sweep of the first observable, no trace: group, variable, logarithms of it, readings, model; scatter."""
    problem = candidate.problem
    for group_id, variable, rows in sweeps(problem):
        if problem.design.measured[rows[0]] != problem.design.measured.min() or variable == "time":
            continue
        values = problem.design.swept(variable)[rows]
        y, p = problem.observed[rows], candidate.predicted[rows]
        usable = (y > 0) & (p > 0) & (values > 0)
        # Scatter relative to the reading itself: readings far above a poor prediction are no less certain.
        relative = np.clip(candidate.scatter[rows][usable] / np.maximum(y[usable], 1e-9), 1e-3, 2.0)
        yield group_id, variable, np.log(values[usable]), np.log(y[usable]), np.log(p[usable]), relative


@dataclass(frozen=True)
class CornerSettings:
    """Where corners are looked for, and what counts as one.

    Parameters
    ----------
    fewest, each_side : int
        Readings that two lines are drawn through at least, and those on either side of a corner.
    places : int
        Places tried for it.
    neighbours : int
        Readings whose median says how large they are there.
    clear : float
        Readings with more absolute scatter than this, relative to that median, are left out: their logarithms err
        downwards.
    bent : float, nats
        Log likelihood by which two lines must do better than one: the best of all places gains 6 by chance in one or
        two sweeps of a hundred.
    """

    fewest: int = 12
    each_side: int = 3
    places: int = 200
    neighbours: int = 5
    clear: float = 0.3
    bent: float = 6.0


def corners(candidate: Candidate) -> list[Corner]:
    """Corners of the sweeps in which the readings or the predictions have one."""
    s = CornerSettings()
    result = []
    design = candidate.problem.design
    # Of the first observable.
    absolute = np.broadcast_to(noise.columns(candidate.noise)[1][0], design.measured.shape)[design.measured.argmin()]
    for group_id, variable, x, y, p, relative in _logarithms(candidate):
        # By its neighbours, since a reading weighted by itself counts more where it errs upwards.
        usual = median_filter(y, s.neighbours, mode="nearest")
        relative = relative * np.exp(y - usual)
        clear = absolute < s.clear * np.exp(usual)
        x, y, p, relative = x[clear], y[clear], p[clear], relative[clear]
        if x.size < s.fewest or not np.ptp(y) or x[-s.each_side] - x[s.each_side - 1] < 0.1:
            continue
        places = np.linspace(x[s.each_side - 1], x[-s.each_side], s.places)
        weight = 1 / relative
        alone, left, exponents = _two_lines(x, y, weight, places)
        best = int(np.argmin(left))
        corner = Corner(group_id, variable, None, None, None, None, None, None)
        if left[best] > 0 and 0.5 * x.size * np.log(alone / left[best]) > s.bent:
            near = places[left <= left[best] * (1 + f.ppf(0.9, 1, x.size - 4) / (x.size - 4))]
            between = places[1] - places[0]
            middle, low, high = np.exp([places[best], near[0] - between, near[-1] + between]).tolist()
            corner = replace(corner, measured=middle, lower=low, upper=high, exponents=exponents[best])
        # With these readings' own scatter the corner of the predictions would have to be seen.
        of_one, of_two, modelled = _two_lines(x, p, weight, places)
        there = int(np.argmin(of_two))
        if 0.5 * x.size * np.log((of_one + left[best]) / max(of_two[there] + left[best], 1e-300)) > s.bent:
            corner = replace(corner, simulated=float(np.exp(places[there])), simulated_exponents=modelled[there])
        if corner.measured is not None or corner.simulated is not None:
            result.append(corner)
    return result


def _two_lines(
    x: FloatArray, y: FloatArray, weight: FloatArray, places: FloatArray
) -> tuple[float, FloatArray, list[tuple[float, float]]]:
    """Weighted squares left by one line, by two that meet at each of some places, and the slopes of those."""

    def solve(*columns: FloatArray) -> tuple[float, list[float]]:
        a = np.array([np.ones_like(x), *columns]).T * weight[:, None]
        solution = np.linalg.lstsq(a, y * weight, rcond=None)[0]
        return float(np.sum((y * weight - a @ solution) ** 2)), solution.tolist()

    left, slopes = [], []
    for c in places:
        rest, (_, below, above) = solve(np.minimum(x - c, 0.0), np.maximum(x - c, 0.0))
        left.append(rest)
        slopes.append((below, above))
    return solve(x)[0], np.array(left), slopes


def _line(x: FloatArray, y: FloatArray, sd: FloatArray) -> tuple[float, float]:
    """Slope of a weighted straight line and its standard error, by its own residuals."""
    w = 1 / sd**2
    centred = x - np.average(x, weights=w)
    slope = float(np.sum(w * centred * y) / np.sum(w * centred**2))
    rest = y - np.average(y, weights=w) - slope * centred
    variance = float(np.sum(w * rest**2) / max(x.size - 2, 1) / np.sum(w * centred**2))
    return slope, float(np.sqrt(variance))


def drift(candidate: Candidate, *, knots: int = 4, in_order: float = 0.9) -> list[Drift]:
    """What each parameter's drift along each covariate would gain, the most first.

    Parameters
    ----------
    candidate : Candidate
    knots : int
        Of the piecewise linear drift, its ends among them.
    in_order : float
        Rank correlation of the places in a sweep and in the file from which on the sweep was read from end to end.
    """
    problem = candidate.problem
    nu = noise.columns(candidate.noise)[2][0]
    z = noise.innovations(problem.observed, candidate.predicted[None], candidate.noise, problem.known_sigma)[0]
    weight = np.sqrt((nu + 1) / (nu + z * z))  # Student's law as weighted least squares
    target = weight * z
    known = (candidate.whitened(candidate.slope) * weight).T
    n = target.size
    design = problem.design
    covariates = {
        "frequency": design.along("frequency"),
        "amplitude": design.along("amplitude"),
        "range": np.log(np.abs(candidate.predicted) * problem.on_one_axis + 0.05),
    }
    # Sweeps that were read from one end to the other do not separate the time from what was swept.
    if max(_sorted(np.argsort(rows)) for _, _, rows in sweeps(problem)) < in_order:
        covariates["order"] = in_group(design)
    # A weak prior keeps directions that the readings leave open at rest.
    rest, _ = _solve(known, target)
    result = []
    hats = {name: _hats(x, knots) for name, x in covariates.items() if np.ptp(x) >= 0.1}
    if np.ptp(design.kinds):
        hats["waveform"] = np.eye(design.kinds.max() + 1)[design.kinds]
    for i in range(problem.n_model):
        for name, hat in hats.items():
            columns = known[:, i : i + 1] * hat
            wide = np.hstack([np.delete(known, i, axis=1), columns])
            left, solution = _solve(wide, target)
            gain = 0.5 * n * float(np.log(rest / left)) if left > 0 else 0.0
            change = solution[-hat.shape[1] :] - solution[-hat.shape[1]]
            end = change[np.argmax(np.abs(change))] if name == "waveform" else change[-1]
            result.append(Drift(problem.names[i], name, gain, float(np.exp(np.clip(end, -9, 9)))))
    return sorted(result, key=lambda d: -d.gain)


def _hats(x: FloatArray, n: int) -> FloatArray:
    """Piecewise linear functions of a covariate, (n_points, n_knots): a hat on each knot."""
    knots = np.linspace(x.min(), x.max(), n)
    return np.array([np.interp(x, knots, np.eye(n)[k]) for k in range(n)]).T


def _sorted(places: NDArray[np.intp]) -> float:
    """How far places in a sweep follow those in the file: a rank correlation, whatever its sign."""
    return abs(float(np.corrcoef(places, np.arange(places.size))[0, 1])) if places.size > 2 else 1.0


def _solve(a: FloatArray, y: FloatArray, ridge: float = 0.2) -> tuple[float, FloatArray]:
    """Ridge regression (prior standard deviation five on every coefficient): squares left, and coefficients."""
    whole = np.vstack([a, ridge * np.eye(a.shape[1])])
    solution = np.linalg.lstsq(whole, np.concatenate([y, np.zeros(a.shape[1])]), rcond=None)[0]
    return float(np.sum((y - a @ solution) ** 2) + np.sum((ridge * solution) ** 2)), solution

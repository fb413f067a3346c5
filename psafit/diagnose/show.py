r"""Show what is wrong, in the user's language: growth with voltage and frequency, and parameters that had to drift.

*Growth.* Local exponents :math:`\partial\ln L/\partial\ln V` and :math:`\partial\ln L/\partial\ln f` of readings and
predictions, by straight lines through windows of neighbouring readings of one sweep, each reading with its scatter.

*Drift.* Each of the fit's parameters in turn is let vary along a covariate, as a piecewise linear function with three
free values about the fitted one, in the expansion of the model. The gain says whether letting it drift would mend the
misfit; the slope says which way it must drift. A parameter that must drift points at the mechanism it stands in for.

*Sessions.* Where two sessions share conditions, the factor between their readings: no model of the rig can explain it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psafit.diagnose.misfit import conditions, in_session, sweeps
from psafit.experiment import GroupId
from psafit.inference.candidate import Candidate

FloatArray = NDArray[np.float64]

_WINDOW = 9
_KNOTS = 4
_SORTED = 0.9


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
class Drift:
    """What letting one parameter drift along one covariate would gain.

    Parameters
    ----------
    parameter : str
    variable : {"frequency", "amplitude", "range", "waveform", "order"}
        The last from the first reading of each session to its last; waveform from sine to square.
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
    first, second : group id
    n_conditions : int
    factor, lower, upper : float
        Of the second over the first, with its 90 % interval by the fitted scatter.
    """

    first: GroupId
    second: GroupId
    n_conditions: int
    factor: float
    lower: float
    upper: float


def offsets(candidate: Candidate) -> list[Offset]:
    """Every pair of sessions that share conditions at which both have readings above zero."""
    problem, group = candidate.problem, candidate.problem.design.group
    y, relative = problem.observed, candidate.scatter / np.maximum(problem.observed, 1e-9)
    found: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for rows in conditions(problem.design):
        sessions = {k: rows[(group[rows] == k) & (y[rows] > 0)] for k in np.unique(group[rows]).tolist()}
        for a, b in itertools.combinations([k for k, own in sessions.items() if own.size], 2):
            logs = [float(np.log(y[sessions[k]]).mean()) for k in (a, b)]
            variance = sum(float(np.sum(relative[sessions[k]] ** 2)) / sessions[k].size ** 2 for k in (a, b))
            found.setdefault((a, b), []).append((logs[1] - logs[0], variance))
    result = []
    for (a, b), pairs in found.items():
        ratio, weight = np.array([p[0] for p in pairs]), 1 / np.array([p[1] for p in pairs])
        mean, sd = float(np.average(ratio, weights=weight)), float(1 / np.sqrt(weight.sum()))
        ends = np.exp([mean, mean - 1.645 * sd, mean + 1.645 * sd]).tolist()
        result.append(Offset(problem.group_ids[a], problem.group_ids[b], len(pairs), *ends))
    return result


def growth(candidate: Candidate) -> list[Growth]:
    """Exponents of all sweeps of a fit's groups."""
    problem = candidate.problem
    result = []
    for group_id, variable, rows in sweeps(problem):
        values = (problem.design.amplitude if variable == "amplitude" else problem.design.frequency)[rows]
        y, p = problem.observed[rows], candidate.predicted[rows]
        usable = (y > 0) & (p > 0) & (values > 0)
        x, y, p, sd = np.log(values[usable]), y[usable], p[usable], candidate.scatter[rows][usable]
        found = Growth(group_id, variable, [], [], [], [], [])
        for k in range(0, x.size - _WINDOW + 1):
            part = slice(k, k + _WINDOW)
            if np.ptp(x[part]) < 0.1:
                continue
            # Scatter relative to the reading itself: readings far above a poor prediction are no less certain.
            relative = np.clip(sd[part] / np.maximum(y[part], 1e-9), 1e-3, 2.0)
            slope, error = _line(x[part], np.log(y[part]), relative)
            modelled, _ = _line(x[part], np.log(p[part]), relative)
            found.at.append(float(np.exp(x[part].mean())))
            found.measured.append(slope)
            found.lower.append(slope - 1.645 * error)
            found.upper.append(slope + 1.645 * error)
            found.simulated.append(modelled)
        result.append(found)
    return result


def _line(x: FloatArray, y: FloatArray, sd: FloatArray) -> tuple[float, float]:
    """Slope of a weighted straight line and its standard error, by its own residuals."""
    w = 1 / sd**2
    centred = x - np.average(x, weights=w)
    slope = float(np.sum(w * centred * y) / np.sum(w * centred**2))
    rest = y - np.average(y, weights=w) - slope * centred
    variance = float(np.sum(w * rest**2) / max(x.size - 2, 1) / np.sum(w * centred**2))
    return slope, float(np.sqrt(variance))


def drift(candidate: Candidate) -> list[Drift]:
    """What each parameter's drift along each covariate would gain, the most first."""
    problem = candidate.problem
    nu = float(candidate.noise[0, 2])
    z = (problem.observed - candidate.predicted) / candidate.scatter
    weight = np.sqrt((nu + 1) / (nu + z * z))  # Student's law as weighted least squares
    target = weight * z
    known = (candidate.slope / candidate.scatter * weight).T
    n = target.size
    design = problem.design
    covariates = {
        "frequency": np.log(design.frequency),
        "amplitude": np.log(np.maximum(design.amplitude, 1e-9)),
        "range": np.log(candidate.predicted + 0.05),
        "waveform": design.waveform.astype(float),
    }
    # Sweeps that were read from one end to the other do not tell the time from what was swept.
    if max(_sorted(np.argsort(rows)) for _, _, rows in sweeps(problem)) < _SORTED:
        covariates["order"] = in_session(design)
    # A weak prior keeps directions that the readings leave open at rest.
    rest, _ = _solve(known, target)
    result = []
    for i in range(problem.n_model):
        for name, x in covariates.items():
            if np.ptp(x) < 0.1:
                continue
            knots = np.linspace(x.min(), x.max(), _KNOTS)
            hats = np.array([np.interp(x, knots, np.eye(_KNOTS)[k]) for k in range(_KNOTS)]).T
            columns = known[:, i : i + 1] * hats
            wide = np.hstack([np.delete(known, i, axis=1), columns])
            left, solution = _solve(wide, target)
            gain = 0.5 * n * float(np.log(rest / left)) if left > 0 else 0.0
            values = solution[-_KNOTS:]
            result.append(Drift(problem.names[i], name, gain, float(np.exp(np.clip(values[-1] - values[0], -9, 9)))))
    return sorted(result, key=lambda d: -d.gain)


def _sorted(places: NDArray[np.intp]) -> float:
    """How far places in a sweep follow those in the file: a rank correlation, whatever its sign."""
    return abs(float(np.corrcoef(places, np.arange(places.size))[0, 1])) if places.size > 2 else 1.0


def _solve(a: FloatArray, y: FloatArray, ridge: float = 0.2) -> tuple[float, FloatArray]:
    """Ridge regression (prior standard deviation five on every coefficient): squares left, and coefficients."""
    whole = np.vstack([a, ridge * np.eye(a.shape[1])])
    solution = np.linalg.lstsq(whole, np.concatenate([y, np.zeros(a.shape[1])]), rcond=None)[0]
    return float(np.sum((y - a @ solution) ** 2) + np.sum((ridge * solution) ** 2)), solution

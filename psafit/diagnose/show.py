r"""Show what is wrong, in the user's language: growth with voltage and frequency, and parameters that had to drift.

*Growth.* Local exponents :math:`\partial\ln L/\partial\ln V` and :math:`\partial\ln L/\partial\ln f` of readings and
predictions, by straight lines through windows of neighbouring readings of one sweep, each reading with its scatter.

*Drift.* Each of the fit's parameters in turn is let vary along a covariate, as a piecewise linear function with three
free values about the fitted one, in the expansion of the model. The gain says whether letting it drift would mend the
misfit; the slope says which way it must drift. A parameter that must drift points at the mechanism it stands in for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from psafit.diagnose.misfit import sweeps
from psafit.experiment import GroupId
from psafit.inference.candidate import Candidate

FloatArray = NDArray[np.float64]

_WINDOW = 9
_KNOTS = 4


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
    variable : {"frequency", "amplitude", "range"}
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
    }
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


def _solve(a: FloatArray, y: FloatArray, ridge: float = 0.2) -> tuple[float, FloatArray]:
    """Ridge regression (prior standard deviation five on every coefficient): squares left, and coefficients."""
    whole = np.vstack([a, ridge * np.eye(a.shape[1])])
    solution = np.linalg.lstsq(whole, np.concatenate([y, np.zeros(a.shape[1])]), rcond=None)[0]
    return float(np.sum((y - a @ solution) ** 2) + np.sum((ridge * solution) ** 2)), solution

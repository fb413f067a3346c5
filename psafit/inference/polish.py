"""lmfit's part of a fit: the polish of the modes that were found.

A gradient method, and a simplex where a kink has stopped it. Only what polishes imports this module: lmfit's import
takes more than half as long as that of all the rest.
"""

from __future__ import annotations

import warnings
from typing import Any

import lmfit
import numpy as np
from scipy.optimize import minimize

from psafit.arrays import FloatArray
from psafit.inference.optimiser import gradient
from psafit.inference.problem import Problem


def _finite(x: FloatArray, worst: float = 1e12) -> FloatArray:
    """`x`, with `worst` for what is not finite: worse than any, and its square still a number."""
    return np.nan_to_num(x, nan=worst, posinf=worst, neginf=-worst)


def _lmfit_parameters(problem: Problem, u: FloatArray, n: int) -> lmfit.Parameters:
    """The first `n` sampling coordinates as lmfit parameters, with the values themselves as expressions."""
    parameters = lmfit.Parameters()
    for p, value in zip(problem.parameters[:n], u, strict=True):
        b = p.sampling_bounds
        margin = 1e-9 * (b.upper - b.lower)  # lmfit's bound transform is singular at the bound itself
        value = float(np.clip(value, b.lower + margin, b.upper - margin))
        if p.prior.coordinate == "log":
            parameters.add(f"ln_{p.name}", value=value, min=b.lower, max=b.upper)
            parameters.add(p.name, expr=f"exp(ln_{p.name})")
        else:
            parameters.add(p.name, value=value, min=b.lower, max=b.upper)
    return parameters


def _coordinates(parameters: lmfit.Parameters) -> FloatArray:
    return np.array([p.value for p in parameters.values() if p.expr is None])


def _minimize(*arguments: Any, **options: Any) -> lmfit.minimizer.MinimizerResult:
    with warnings.catch_warnings():
        # lmfit ends with roots of an inverse curvature that on a flat top is no covariance; we never read them.
        warnings.filterwarnings("ignore", category=RuntimeWarning, module="lmfit")
        return lmfit.minimize(*arguments, calc_covar=False, **options)


def polish(problem: Problem, start: FloatArray) -> tuple[FloatArray, float, lmfit.minimizer.MinimizerResult]:
    """Top of the posterior near `start`, all parameters free: (coordinates, log_posterior, lmfit's result)."""

    def depth(rows: FloatArray) -> FloatArray:
        return _finite(-problem.log_posterior(rows))

    result = _minimize(
        lambda q: float(depth(_coordinates(q)[None, :])[0]),
        _lmfit_parameters(problem, start, problem.n_dim),
        method="bfgs",
        jac=lambda q: gradient(depth, _coordinates(q), problem.bounds),
        options={"gtol": 1e-4},
    )
    # A simplex goes on where a kink has stopped the gradient.
    u, here = _coordinates(result.params), float(result.residual[0])
    simplex = u + 0.02 * np.vstack([np.zeros(u.size), np.eye(u.size)])
    polished = minimize(
        lambda v: float(depth(v[None, :])[0]),
        u,
        method="Nelder-Mead",
        bounds=problem.bounds,
        options={
            "initial_simplex": np.clip(simplex, *problem.bounds.T),
            "maxfev": 60 * u.size,
            "fatol": 1e-3,
            "xatol": 1e-3,
        },
    )
    if polished.fun < here:
        u = np.asarray(polished.x)
    return u, float(problem.log_posterior(u[None, :])[0]), result


def report(result: lmfit.minimizer.MinimizerResult, top: FloatArray, covariance: FloatArray) -> str:
    """How lmfit's optimisation ended, and its table of the parameters.

    Parameters
    ----------
    result : MinimizerResult
        Of `polish`.
    top : (n_dim,) array
        Where the optimisation went on to from where lmfit's part of it ended.
    covariance : (n_dim, n_dim) array
        Of the sampling coordinates there, for the standard errors.
    """
    free = [p for p in result.params.values() if p.expr is None]
    for p, value, error in zip(free, top, np.sqrt(np.diag(covariance)), strict=True):
        p.value, p.stderr = float(value), float(error)
    for name, p in result.params.items():
        if p.expr is not None:
            p.stderr = p.value * result.params[f"ln_{name}"].stderr
    return f"{result.method}: {result.message}\n{lmfit.fit_report(result.params, show_correl=False)}"

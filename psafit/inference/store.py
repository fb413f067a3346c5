"""The posterior as ArviZ keeps it: `posterior.nc`, and its convergence diagnostics.

ArviZ 0.x hands out `InferenceData`, ArviZ 1.x an xarray `DataTree`; the file is the same, and this is the only module
that knows the difference.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.files import read_error, replacing, reserve

REBUILD = "remove posterior.json and repeat the command that made it: psafit rebuilds both from chain.h5"
"""What to do about a posterior that is not as it was written: the chain is kept elsewhere."""

HDF5_FRAME = 1 << 18
"""Bytes that a file of ours needs in addition to its arrays, at most."""


@dataclass(frozen=True)
class Draws:
    """Posterior draws in the parameters' units; `values` is (n_chains, n_draws, n_dim)."""

    names: tuple[str, ...]
    values: FloatArray
    log_posterior: FloatArray
    identity: str

    @property
    def flat(self) -> FloatArray:
        """All chains one after the other, (n_chains * n_draws, n_dim)."""
        return self.values.reshape(-1, self.values.shape[-1])


def _arviz() -> Any:
    with warnings.catch_warnings():  # its import announces the next version once a day, with a path of this machine
        warnings.simplefilter("ignore", FutureWarning)
        import arviz
    return arviz


def _is_tree(arviz: Any) -> bool:
    return int(arviz.__version__.split(".")[0]) >= 1


def write(
    path: Path,
    draws: Draws,
    log_likelihood: NDArray[np.floating[Any]],
    predicted: NDArray[np.floating[Any]],
    prior: FloatArray,
    log_prior: FloatArray,
    observed: FloatArray,
    columns: Mapping[str, NDArray[np.intp] | slice],
    constant: Mapping[str, Any],
) -> None:
    """Write `posterior.nc` in one step.

    Parameters
    ----------
    path : Path
    draws : Draws
    log_likelihood : (n_chains, n, n_points) array
        Of every fitted reading; of fewer draws, evenly spaced, where the readings are many.
    predicted : (n_chains, n, n_points) array
        Readings drawn from the same draws, each in the unit of its observable, as the observed ones.
    prior : (n, n_dim) array
        Draws of the prior, in the parameters' units.
    log_prior : (n_chains, n_draws, n_dim) array
        Log prior density of each parameter in its sampling coordinate.
    observed : (n_points,) array
    columns : mapping of column to (n,) array of int, or slice
        Readings of each observable; one that has none is left out.
    constant : mapping of name to (n_points,) array
        Conditions of the fitted readings.
    """
    az = _arviz()

    every = {name: np.arange(observed.size)[rows] for name, rows in columns.items()}
    read = {name: rows for name, rows in every.items() if rows.size}
    groups: dict[str, Any] = {
        "posterior": {n: draws.values[..., i] for i, n in enumerate(draws.names)},
        "posterior_predictive": {name: predicted[..., rows] for name, rows in read.items()},
        "prior": {n: prior[None, :, i] for i, n in enumerate(draws.names)},
        "log_prior": {n: log_prior[..., i] for i, n in enumerate(draws.names)},
        "sample_stats": {"lp": draws.log_posterior},
        "log_likelihood": {name: log_likelihood[..., rows] for name, rows in read.items()},
        "observed_data": {name: observed[rows] for name, rows in read.items()},
        "constant_data": dict(constant),
    }
    # Readings of one observable are all readings; of several, each has its own.
    own = {name: "reading" if len(read) == 1 else f"{name}_reading" for name in read}
    layout: dict[str, Any] = {
        "coords": {"reading": np.arange(observed.size)} | {own[name]: rows for name, rows in read.items()},
        "dims": {name: [dimension] for name, dimension in own.items()} | {name: ["reading"] for name in constant},
    }
    with warnings.catch_warnings():  # ArviZ takes many short chains for a transposed array
        warnings.filterwarnings("ignore", message="More chains|Found chain", category=UserWarning)
        if _is_tree(az):
            data = az.from_dict(groups, **layout)
        else:
            apart = {"log_prior": groups.pop("log_prior")}  # ArviZ 0.x's from_dict does not know this group
            data = az.from_dict(**groups, **layout)
            data.add_groups(apart)
    for part in data.subtree if _is_tree(az) else (data[name] for name in data.groups()):
        part.attrs.pop("created_at", None)  # the same draws are the same file
    data.attrs["psafit_identity"] = draws.identity
    with replacing(path) as temporary:
        arrays = (draws.values, draws.log_posterior, log_likelihood, predicted, prior, log_prior, observed)
        arrays = (*arrays, *constant.values())
        reserve(temporary, sum(np.asarray(a).nbytes for a in arrays) + HDF5_FRAME)
        data.to_netcdf(str(temporary), engine="h5netcdf")


def read(path: Path, names: tuple[str, ...]) -> Draws:
    """Read the draws back; `InputError` where the file is missing, damaged, of another model, or refused."""
    import xarray as xr

    if not path.exists():
        raise InputError("is missing", REBUILD, file=path)
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            posterior = tree["posterior"]
            values = np.stack([np.asarray(posterior[n].values, dtype=float) for n in names], axis=-1)
            lp = np.asarray(tree["sample_stats"]["lp"].values, dtype=float)
            identity = str(tree.attrs["psafit_identity"])
    except Exception as error:  # whatever a foreign or damaged HDF5 file raises on its way through three libraries
        what = "is not a posterior written by psafit for this model, or damaged"
        raise read_error(error, path, what, REBUILD) from error
    if values.ndim != 3 or values.size == 0 or not np.isfinite(values).all():
        raise InputError("holds no usable draws", REBUILD, file=path)
    return Draws(names, values, lp, identity)


def _each(function: Any, values: FloatArray, **options: Any) -> FloatArray:
    return np.array([float(function(values[..., i], **options)) for i in range(values.shape[-1])])


def smoothed(log_weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Importance weights smoothed by Pareto's law, and the shape of their tail.

    Parameters
    ----------
    log_weights : (..., n) array
        Of `n` draws each.

    Returns
    -------
    (..., n) array
        Log weights that add up to one.
    (...) array
        Pareto k.

    References
    ----------
    A. Vehtari et al., J. Mach. Learn. Res. 25 (2024) 72.
    """
    az = _arviz()
    # The quantiles of a tail heavier than a float can hold are infinite, and end at the largest weight as others do.
    with np.errstate(over="ignore"):
        if _is_tree(az):
            from arviz_stats.base import array_stats

            # This one takes log likelihoods, whose inverses are weights.
            weights, tail = array_stats.psislw(-log_weights)
        else:
            weights, tail = az.psislw(log_weights)
    return np.asarray(weights), np.asarray(tail)


def pareto_k(log_weights: FloatArray) -> float:
    """Shape of the tail of importance weights, (n,)."""
    return float(smoothed(log_weights)[1])


def rounded_r_hat(value: float, goal: float) -> str:
    """An R-hat rounded up, to as many digits as show whether it is below its goal; at least four."""
    if not math.isfinite(value):
        return "not defined"
    texts = (f"{math.ceil(10**n * value) / 10**n:.{n}f}" for n in range(4, 12))
    return next((text for text in texts if (float(text) < goal) == (value < goal)), f"{value:g}")


def r_hat(values: FloatArray) -> FloatArray:
    """Rank-normalised split R-hat of (n_chains, n_draws, n_dim) draws; (n_dim,). NaN where all draws are the same."""
    az = _arviz()

    with np.errstate(invalid="ignore", divide="ignore"):
        return _each(az.rhat, values)


def diagnostics(values: FloatArray) -> dict[str, FloatArray]:
    """Convergence of (n_chains, n_draws, n_dim) draws: `ess_bulk`, `ess_tail`, each (n_dim,)."""
    az = _arviz()

    return {
        "ess_bulk": _each(az.ess, values, method="bulk"),
        "ess_tail": _each(az.ess, values, method="tail", prob=(0.05, 0.95)),
    }

"""The frozen results of each stage, and how they are stored.

Files are JSON with a schema number, written in one step. Numbers that are not finite become null, so that any
JSON reader can read them.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from psafit.errors import InputError
from psafit.experiment import GroupId
from psafit.files import write_atomically

SCHEMA = 1
Record = TypeVar("Record")


@dataclass(frozen=True)
class ParameterEntry:
    """A parameter as a result names it: see `psafit.parameters.Parameter`."""

    name: str
    symbol: str
    unit: str
    description: str
    lower: float
    upper: float
    prior: str
    source: str


@dataclass(frozen=True)
class MinimumEntry:
    """A local optimum of the posterior: values in the parameters' units, and how many starts ended there."""

    values: dict[str, float]
    log_posterior: float
    starts: int


@dataclass(frozen=True)
class Fit:
    """`fit.json`: what was fitted to what, and the optimum that lmfit found.

    Parameters
    ----------
    identity : str
        SHA-256 over everything that determines the result: data, groups, terms, priors, seed, settings, version.
    title, source : str
        The experiment's.
    fingerprint : str
        SHA-256 of its numbers.
    groups : list of group ids
        What the likelihood saw.
    terms : list of str
        Causes added to the baseline.
    engine : str
        Path of the simulator.
    seed : int
    parameters : list of ParameterEntry
        Physical parameters, then those of the scatter.
    n_physical : int
    minima : list of MinimumEntry
        Best first.
    n_starts, n_failed, n_evaluations : int
    lmfit_report : str
    versions : dict
        Of Python and the libraries that matter.
    """

    identity: str
    title: str
    source: str
    fingerprint: str
    groups: list[GroupId]
    terms: list[str]
    engine: str
    seed: int
    parameters: list[ParameterEntry]
    n_physical: int
    minima: list[MinimumEntry]
    n_starts: int
    n_failed: int
    n_evaluations: int
    lmfit_report: str
    versions: dict[str, str]


@dataclass(frozen=True)
class ProfilePoint:
    """One point of a profile likelihood: a value, and how far the best log likelihood lies below the top."""

    value: float
    drop: float


@dataclass(frozen=True)
class ParameterSummary:
    """What the data say of one parameter.

    Parameters
    ----------
    name : str
    median, lower, upper : float
        Posterior median and central 90 % interval, in the parameter's unit.
    prior_lower, prior_upper : float
        Central 90 % interval of the prior.
    contraction : float
        One minus the ratio of posterior to prior variance, in the sampling coordinate.
    r_hat, ess_bulk, ess_tail : float
        From ArviZ, every walker a chain.
    autocorrelation_time : float
        Steps.
    verdict : {"determined", "bounded above", "bounded below", "not determined"}
        From the profile likelihood for physical parameters, from the contraction for the scatter's.
    text : str
        The value as far as the data support it.
    profile : list of ProfilePoint
        Empty for the scatter's parameters.
    """

    name: str
    median: float
    lower: float
    upper: float
    prior_lower: float
    prior_upper: float
    contraction: float
    r_hat: float
    ess_bulk: float
    ess_tail: float
    autocorrelation_time: float
    verdict: str
    text: str
    profile: list[ProfilePoint]


@dataclass(frozen=True)
class PosteriorSummary:
    """`posterior.json`: the sampler's health and the parameter table; the draws are in `posterior.nc`."""

    identity: str
    converged: bool
    message: str
    n_walkers: int
    n_steps: int
    burn_in: int
    thinning: int
    acceptance: float
    autocorrelation_times: float
    parameters: list[ParameterSummary]


@dataclass(frozen=True)
class GroupScore:
    """How well one group was predicted; see `psafit.validate` for each formula.

    Parameters
    ----------
    group : group id
    role : {"fit", "holdout"}
    n_points : int
    log_rmse : float
        Root mean square of ln((predicted + 0.3 um)/(measured + 0.3 um)), predicted = posterior median.
    log_bias : float
        Mean of the same: positive where the prediction is too large.
    coverage_50, coverage_90 : float
        Fraction of readings inside the central predictive interval.
    crps_um : float
        Mean continuous ranked probability score, um.
    elpd : float
        Expected log predictive density, summed over the readings, nats.
    elpd_per_point : float
    pit_p_value : float
        Kolmogorov-Smirnov test of the probability integral transforms against uniformity.
    verdict : str
        One plain sentence.
    """

    group: GroupId
    role: str
    n_points: int
    log_rmse: float
    log_bias: float
    coverage_50: float
    coverage_90: float
    crps_um: float
    elpd: float
    elpd_per_point: float
    pit_p_value: float
    verdict: str


@dataclass(frozen=True)
class Validation:
    """`validation.json`: the posterior predictive against every group; the table is in `predictions.csv`."""

    identity: str
    n_draws: int
    seed: int
    groups: list[GroupScore]
    holdout_log_rmse: float | None
    pit: dict[str, list[float]]


def plain(value: Any) -> Any:
    """Reduce a record to what JSON holds."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def write_json(path: Path, record: Any) -> None:
    """Write a record as JSON with its schema number, in one step; a list has no place for the number."""
    content = plain(record)
    if isinstance(content, dict):
        content = {"schema": SCHEMA, **content}
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(path, (text + "\n").encode())


def read_json(path: Path, kind: type[Record]) -> Record:
    """Read a record back; `InputError` where the file is missing, foreign or damaged."""
    try:
        content = json.loads(path.read_bytes().decode("utf-8"))
    except FileNotFoundError as error:
        raise InputError("is missing", "give the folder of a finished run of psafit fit", file=path) from error
    except (OSError, ValueError, RecursionError) as error:
        raise InputError("is damaged: not readable as JSON", "run psafit fit again", file=path) from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise InputError(
            f"is not a psafit record of schema {SCHEMA}", "run psafit fit again with this version", file=path
        )
    from pydantic import TypeAdapter, ValidationError  # slow to import, and only readers need it

    try:
        return TypeAdapter(kind).validate_python(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(
            f"does not hold what a {kind.__name__} holds ({place}: {first['msg']})",
            "run psafit fit again with this version",
            file=path,
        ) from error

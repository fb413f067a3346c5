"""The frozen results of each stage, and how they are stored.

Files are JSON with a schema number, written in one step. Numbers that are not finite become null, so that any
JSON reader can read them. The records that a later stage builds on carry a SHA-256 of their own content, checked when
they are read.
"""

from __future__ import annotations

import dataclasses
import json
import math
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from psafit.errors import InputError
from psafit.experiment import GroupId
from psafit.files import digest, encodable, read_bytes, write_atomically
from psafit.text import significant

SCHEMA = 1
Record = TypeVar("Record")
_ANEW = "run psafit fit again with another --out"


ABSENT = {"absent": True}
"""Metadata of a field that may be None, and then has no key in the file; a "key" renames it there."""


def _key(f: dataclasses.Field[Any]) -> str:
    return str(f.metadata.get("key", f.name))


class Brief:
    """A record that prints as what it is and how much it holds, not as all of it."""

    _in_repr: typing.ClassVar[tuple[str, ...]] = ()

    def __repr__(self) -> str:
        shown = [f"{name}={getattr(self, name)!r}" for name in self._in_repr]
        held = {f.name: getattr(self, f.name) for f in dataclasses.fields(self) if f.name not in self._in_repr}  # type: ignore[arg-type]
        sizes = [f"{name}: {len(x)}" for name, x in held.items() if isinstance(x, list | tuple | dict)]
        return f"{type(self).__name__}({', '.join([*shown, *sizes])})"


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
class CauseParameterEntry:
    """A parameter as a cause declares it; `neutral` is None where the cause vanishes by another one."""

    name: str
    symbol: str
    unit: str
    neutral: float | None
    bounds: list[float]
    prior: str
    description: str
    source: str


@dataclass(frozen=True)
class SymptomEntry:
    """What a cause does to the launch range: see `psafit.physics.term.Symptom`."""

    text: str
    sign: int
    frequency: str
    amplitude: str
    waveforms: list[str]


@dataclass(frozen=True)
class CauseEntry:
    """A candidate cause as `psafit terms` lists it: see `psafit.physics.term.Term`.

    Parameters
    ----------
    id, slot, title : str
    equation : str
        LaTeX.
    description : str
        reStructuredText.
    parameters : list of CauseParameterEntry
        The strength first.
    latent : CauseParameterEntry, optional
        What every session has for itself.
    symptom : SymptomEntry
    reference : str
    checks : list of str
        The calculations by hand.
    path : str
        Of the simulator: "closed form" or "stepper".
    probability : float
        That it is at work, before any reading.
    because : str
        Why.
    look : str
        What to look at on the rig to see it without launches.
    drives : str
        On which drives it has a meaning: "every", "stated" or "shifting"; see `psafit.physics.term.DRIVES`.
    reads : list of str
        Observables whose readings it changes, of a cause in the slot of the reading.
    plugin : str
        Leading digits of the SHA-256 of its file, where that is no part of psafit.
    """

    id: str
    slot: str
    title: str
    equation: str
    description: str
    parameters: list[CauseParameterEntry]
    latent: CauseParameterEntry | None
    symptom: SymptomEntry
    reference: str
    checks: list[str]
    path: str
    probability: float = 0.04
    because: str = ""
    look: str = ""
    drives: str = "every"
    reads: list[str] = field(default_factory=list)
    plugin: str = ""


@dataclass(frozen=True)
class MinimumEntry:
    """A local optimum of the posterior: values in the parameters' units, and how many starts ended there."""

    values: dict[str, float]
    log_posterior: float
    starts: int


@dataclass(frozen=True, repr=False)
class Fit(Brief):
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
    engine : {"closed form", "stepper", "mixed"}
        Path of the simulator at the minima.
    seed : int
    parameters : list of ParameterEntry
        Physical parameters, then those of the scatter.
    n_physical : int
    minima : list of MinimumEntry
        Best first.
    n_starts : int
        Starts that were asked for: draws of the prior, for the first two looks together.
    n_followed, n_failed, n_evaluations : int
        Starts followed, those of further looks and places that were known beforehand included; those that failed;
        parameter sets simulated.
    n_missed : int
        Minima that the search had missed and the sampler found; they count no starts.
    sampled_by : str
        Name of the sampler.
    sampler : dict
        Its settings.
    lmfit_report : str
    versions : dict
        Of Python, the libraries that matter, and plugins (SHA-256 of their files).
    command : str
        That made it, if any did; absolute paths are cut to their last part.
    known : list of dict
        Values, by parameter, at which the search had to begin, too: where a diagnosis had found these causes.
    """

    _in_repr = ("title", "groups", "terms", "engine", "seed")

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
    n_followed: int
    n_failed: int
    n_evaluations: int
    n_missed: int
    sampled_by: str
    sampler: dict[str, int | float]
    lmfit_report: str
    versions: dict[str, str]
    command: str
    known: list[dict[str, float]] = field(default_factory=list)


@dataclass(frozen=True)
class ProfilePoint:
    """One point of a profile likelihood: a value, and how far the best log likelihood lies below the top."""

    value: float
    drop: float


@dataclass(frozen=True, repr=False)
class ParameterSummary(Brief):
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
        From ArviZ: R-hat of all steps after burn-in, each ensemble a chain; sample sizes of the draws that are kept,
        each walker a chain.
    autocorrelation_time : float
        Steps.
    verdict : {"determined", "bounded above", "bounded below", "not determined"}
        From the profile likelihood for physical parameters, from contraction and density of the posterior for others.
    text : str
        The value as far as the data support it.
    profile : list of ProfilePoint
        Empty for the scatter's parameters, and for those of causes that differ by session.
    implausible : bool
        Of the median; see `psafit.inference.problem.Problem.implausible`.
    """

    _in_repr = ("text", "verdict", "r_hat")

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
    implausible: bool


@dataclass(frozen=True)
class ImportanceEntry:
    """A parameter by importance sampling: median and central 90 % interval, in its unit.

    `apart` is the largest difference of the three from the sampler's, in widths of the sampler's interval, in the
    sampling coordinate.
    """

    name: str
    median: float
    lower: float
    upper: float
    apart: float


@dataclass(frozen=True)
class ImportanceSummary:
    """The posterior by importance sampling, to be compared with the sampler's.

    Parameters
    ----------
    log_evidence, standard_error : float
        Natural logarithm.
    effective : float
        Effective number of draws.
    pareto_k : float
        Shape of the weights' tail; above 0.7 the draws are not to be trusted.
    by_chance : float
        Difference of a limit that so few draws would make, two standard errors, in the unit of `apart`.
    parameters : list of ImportanceEntry
    """

    log_evidence: float
    standard_error: float
    effective: float
    pareto_k: float
    by_chance: float
    parameters: list[ImportanceEntry]

    @property
    def furthest(self) -> ImportanceEntry:
        """The parameter that differs most."""
        return max(self.parameters, key=lambda p: p.apart)


@dataclass(frozen=True)
class SessionSummary:
    """What a session has by a cause that differs by session, as people know it: median and 90 % interval.

    Parameters
    ----------
    cause : str
    group : group id
        The first that was measured in the session.
    what : str
        "a session's gain", "a session's lean".
    unit : str
    median, lower, upper : float
    session : int or str, optional
        Its name, where it has one.
    instrument : str, optional
        Of what one instrument has in a session, its name.
    """

    cause: str
    group: GroupId
    what: str
    unit: str
    median: float
    lower: float
    upper: float
    session: GroupId | None = field(default=None, metadata=ABSENT)
    instrument: str | None = field(default=None, metadata=ABSENT)

    @property
    def where(self) -> str:
        """The session, as people know it."""
        return occasion(self.group, self.session, self.instrument)


def occasion(group: GroupId, session: GroupId | None, instrument: str | None = None) -> str:
    """A session as people know it: by its name, or its only group; and an instrument in it."""
    when = f"group {group}" if session is None else f"session {session}"
    return when if instrument is None else f"{when} ({instrument})"


@dataclass(frozen=True, repr=False)
class PosteriorSummary(Brief):
    """`posterior.json`: the sampler's health and the parameter table; the draws are in `posterior.nc`.

    `importance` is the same posterior by other draws. `files` holds the SHA-256 of what it belongs to, `fit.json` and
    `posterior.nc`. `sessions` says what each has, by causes that differ by session; absent without such a cause.
    """

    _in_repr = ("converged", "message")

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
    importance: ImportanceSummary
    files: dict[str, str]
    sessions: list[SessionSummary] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Refinement:
    """Predictions at one tolerance of the stepper, against the reference.

    Parameters
    ----------
    tolerance : float
    worst, median : float
        Relative difference of the launch range, over all points and parameter sets.
    """

    tolerance: float
    worst: float
    median: float


@dataclass(frozen=True)
class Numerics:
    """Convergence of a fit's predictions, and what a fixed-step explicit integrator would have needed.

    Parameters
    ----------
    identity : str
    engine : str
        Path that simulated the fit.
    tolerance : float, optional
        That the path used; None for the closed form.
    n_sets, n_points : int
        Parameter sets (the best and posterior draws) and measurement points looked at.
    refinement : list of Refinement
        Against the closed form, or else against the finest steps.
    error : float
        Worst relative error of the predictions as used; for the closed form, its disagreement with the finest steps.
    required : float
    converged : bool
    fastest_rate : float, 1/s
        Largest eigenvalue of the contact phase's linear part at the best parameters.
    stable_step : float, s
        Largest stable step of the classical Runge-Kutta method of order four there.
    common_step : float, s
        A step often taken.
    common_growth : float
        Growth of the fastest mode per such step; above one it diverges.
    """

    identity: str
    engine: str
    tolerance: float | None
    n_sets: int
    n_points: int
    refinement: list[Refinement]
    error: float
    required: float
    converged: bool
    fastest_rate: float
    stable_step: float
    common_step: float
    common_growth: float


Size = Literal["", "predicted well", "fitted well", "followed closely", "roughly followed", "missed", "says nothing"]
"""How well a group is met, in a word or two."""


@dataclass(frozen=True)
class GroupScore:
    """How well one group was predicted; see `psafit.validate` for each formula.

    Parameters
    ----------
    group : group id
    role : {"fit", "holdout"}
    observable : str, optional
        What is read, by its name; left out for the launch range.
    unit : str, optional
        Unit of `crps` where it is not um.
    n_points : int
    log_rmse : float
        Root mean square of ln((predicted + 0.3 um)/(measured + 0.3 um)), predicted = posterior median; other
        observables have an offset of their own.
    log_bias : float
        Mean of the same: positive where the prediction is too large.
    coverage_50, coverage_90 : float
        Fraction of readings inside the central predictive interval.
    crps : float
        Mean continuous ranked probability score, um, or in `unit`; the key is "crps_um".
    elpd : float
        Expected log predictive density, summed over the readings, nats.
    elpd_per_point : float
    pit_p_value : float
        Whether the probability integral transforms are uniform.
    drift_p_value : float
        Whether neighbours in the sweep err to one side more than they should.
    coverage_p_value : float
        Share of groups simulated from the posterior, each from one draw, of which as few readings lie in the 90 %
        interval (as many, where more than usual do); NaN where none was simulated.
    informative : bool
        Whether a prediction can fail here: the drive is on, and some readings are above zero. Others enter no mean.
    verdict : str
        One plain sentence.
    size : str
        Its first words: how well the group is met.
    """

    group: GroupId
    role: str
    n_points: int
    log_rmse: float
    log_bias: float
    coverage_50: float
    coverage_90: float
    crps: float = dataclasses.field(metadata={"key": "crps_um"})
    elpd: float
    elpd_per_point: float
    pit_p_value: float
    drift_p_value: float
    coverage_p_value: float
    informative: bool
    verdict: str
    observable: str | None = dataclasses.field(default=None, metadata=ABSENT)
    unit: str | None = dataclasses.field(default=None, metadata=ABSENT)
    size: Size = ""

    @property
    def of(self) -> str:
        """What is read, behind the group's id; empty for the launch range."""
        return f", {self.observable.replace('_', ' ')}" if self.observable else ""


Law = Literal["carried", "energy"]


@dataclass(frozen=True)
class Overdamped:
    """A damping of the stack that is none: it does not swing, but follows its force with a lag.

    Parameters
    ----------
    critical : float, N s/m
        Damping beyond which it is so.
    lag_us : float, us
    known_us : dict, optional
        Times, us, that the experiment states for causes that the model lacks, by parameter.
    """

    critical: float
    lag_us: float
    known_us: dict[str, float] | None = dataclasses.field(default=None, metadata=ABSENT)

    @property
    def text(self) -> str:
        """The same in words."""
        each = (f"{name} of {significant(us, 2)} us" for name, us in (self.known_us or {}).items())
        known = f", such as {' or '.join(each)}, as the experiment states it" if self.known_us else ""
        return (
            f"the stack does not swing, since c_s is beyond critical damping ({significant(self.critical, 2)} N s/m),"
            f" but lags by c_s/k_s, {significant(self.lag_us, 2)} us, and that may stand for another lag{known}"
        )


@dataclass(frozen=True)
class Broken:
    """One law that a model breaks, where it breaks it most.

    Parameters
    ----------
    law : {"carried", "energy"}
    terms : list of str
        The model's causes.
    group : str or int
    frequency_hz, amplitude_v : float
        Of the reading.
    value, limit : float
        What the model says, and what the law allows: ranges in um ("carried", at least), energies in J ("energy", at
        most).
    readings : int
        At which the law is broken, of those that were asked: all ("carried"), or the farthest launch of each group
        ("energy").
    text : str
        The same in words.
    """

    law: Law
    terms: list[str]
    group: GroupId
    frequency_hz: float
    amplitude_v: float
    value: float
    limit: float
    readings: int
    text: str


Objection = Literal["", "tests", "together", "tails"]
"""What speaks against a model: the family of tests, readings that stand out together, or that it needs heavy tails."""


@dataclass(frozen=True)
class Retested:
    """The tests of misfit of a fit's model, fitted to all groups of its experiment.

    Parameters
    ----------
    objection : Objection
    p_value : float
        Of what speaks against the model, or of the tests.
    n_simulated : int
        Data sets simulated from the fit.
    """

    objection: Objection
    p_value: float
    n_simulated: int


@dataclass(frozen=True, repr=False)
class Validation(Brief):
    """`validation.json`: the posterior predictive against every group; the table is in `predictions.csv`.

    `holdout_log_rmse` is the mean over the informative groups that were held out, None without any; `laws` are those
    that the model breaks at its best values (`psafit.inference.laws`); `all_groups` is None where no test of all of
    them was possible. `coverage_p_value` is that of all groups held out together, as of `GroupScore`.
    """

    _in_repr = ("holdout_log_rmse", "n_draws", "seed")

    identity: str
    n_draws: int
    seed: int
    groups: list[GroupScore]
    holdout_log_rmse: float | None
    pit: dict[str, list[float]]
    coverage_p_value: float
    laws: list[Broken] = field(default_factory=list)
    all_groups: Retested | None = None


def plain(value: Any) -> Any:
    """Reduce a record to what JSON holds."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        held = ((f, getattr(value, f.name)) for f in dataclasses.fields(value))
        return {_key(f): plain(v) for f, v in held if not (v is None and f.metadata.get("absent"))}
    if isinstance(value, Mapping):
        return {encodable(str(k)): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return encodable(value) if isinstance(value, str) else value


def _restored(kind: Any, value: Any) -> Any:
    """What was stored as null where a number was not finite, as NaN; every value under its field's name."""
    if value is None:
        return math.nan if kind is float else None
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Union):
        records = [k for k in inner if dataclasses.is_dataclass(k) or typing.get_origin(k)]
        return _restored(records[0], value) if records else value
    if isinstance(value, list) and origin in (list, tuple):
        each = [inner[0]] * len(value) if origin is list or inner[-1] is Ellipsis else inner
        return [_restored(k, v) for k, v in zip(each, value, strict=False)]
    if isinstance(value, dict) and origin is dict:
        return {k: _restored(inner[1], v) for k, v in value.items()}
    if isinstance(value, dict) and dataclasses.is_dataclass(kind):
        kinds = typing.get_type_hints(kind)
        return {f.name: _restored(kinds[f.name], value[_key(f)]) for f in dataclasses.fields(kind) if _key(f) in value}
    return value


def _seal(content: dict[str, Any]) -> str:
    return digest({**content, "sha256": None})


def write_json(path: Path, record: Any, *, sealed: bool = False) -> None:
    """Write a record as JSON with its schema number, in one step; a list has no place for the number.

    A sealed one holds its own SHA-256, so that `read_json` can say whether somebody has changed it.
    """
    content = plain(record)
    if isinstance(content, dict):
        content = {"schema": SCHEMA, **content}
        if sealed:
            content["sha256"] = _seal(content)
    text = json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)
    write_atomically(path, (text + "\n").encode())


def read_content(path: Path, *, remedy: str | None = None) -> Any:
    """What a JSON file holds; `InputError` where it is missing or damaged."""
    raw = read_bytes(path, remedy or "give the folder of a finished run of psafit fit")
    try:
        return json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError("is damaged: not readable as JSON", remedy or _ANEW, file=path) from error


def read_json(path: Path, kind: type[Record], *, sealed: bool = False, remedy: str | None = None) -> Record:
    """Read a record back; `InputError` where the file is missing, foreign, damaged or, if sealed, changed.

    `remedy` says what to do then, where that is not to run the fit again.
    """

    def refused(what: str) -> InputError:
        return InputError(what, remedy or _ANEW, file=path)

    content = read_content(path, remedy=remedy)
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        raise refused(f"is not a psafit record of schema {SCHEMA}")
    if sealed and content.get("sha256") != _seal(content):
        raise refused("was changed after psafit wrote it")
    from pydantic import TypeAdapter, ValidationError  # slow to import, and only readers need it

    try:
        record = TypeAdapter(kind).validate_python(_restored(kind, content))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise refused(
            f"does not hold what a {kind.__name__} of this version holds ({place}: {first['msg']})"
        ) from error
    return record

"""Two results side by side: what they were given, what they found, and how well they predict the same readings.

A result is the folder of a fit or of a diagnosis; of a diagnosis, the extension it adopted. A change of a score is the
second result's minus the first's, with a central 90 % interval over readings redrawn in blocks of five neighbours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from psafit.arrays import FloatArray
from psafit.diagnose.gain import changes, interval
from psafit.diagnose.record import RESULT, Diagnosis, is_diagnosis
from psafit.drives import Drive
from psafit.errors import InputError
from psafit.experiment import Group, GroupId, read_experiment
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.trace_table import TIME
from psafit.files import encodable, read_error
from psafit.inference.identify import supported
from psafit.inference.run_folder import load
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Observable, recorded_name
from psafit.records import ABSENT, read_json
from psafit.validate import columns_of, log_ratio, predict, root_mean_square, tables_at, why_uninformative

_MEASURED, _ROLES = (*CONDITION_COLUMNS, "measured", "reading"), ("fit", "holdout")


@dataclass(frozen=True, eq=False)
class Predicted:
    """What a result says of one group; arrays (n_points,).

    Parameters
    ----------
    group : Group
        The measurements.
    role : {"fit", "holdout"}
    median, lower, upper : arrays
        Of the prediction, and of the 90 % predictive interval of a reading; in the unit of the group's observable.
    log_density : array
        Log predictive density of each reading, per unit; NaN where it is not on record.
    waveform_alone : bool
        Whether of the group's drive no more than the waveform is known, as from a file of predictions.
    """

    group: Group
    role: str
    median: FloatArray
    lower: FloatArray
    upper: FloatArray
    log_density: FloatArray
    waveform_alone: bool = field(default=False, kw_only=True)

    @property
    def key(self) -> tuple[str, str | None]:
        """Which readings they are: the group's id and what is read."""
        return str(self.group.id), recorded_name(self.group.observable)


@dataclass(frozen=True)
class Estimate:
    """A parameter: its median and central 90 % interval, and what the data say of it.

    `limit` says what they support where that is not an interval.
    """

    median: float
    lower: float
    upper: float
    unit: str
    description: str
    verdict: str = ""
    limit: str = ""


@dataclass(frozen=True)
class Side:
    """One of two results.

    Parameters
    ----------
    name : str
        Of its folder.
    kind : {"fit", "diagnosis"}
    title : str
        Of the experiment.
    groups : list of group ids
        That it was fitted to.
    terms : list of str
        Causes in the model.
    facts : dict of str to str
        All that determined it, each under the word a user knows it by.
    parameters : dict of str to Estimate
    predicted : list of Predicted
    """

    name: str
    kind: str
    title: str
    groups: list[GroupId]
    terms: list[str]
    facts: dict[str, str]
    parameters: dict[str, Estimate]
    predicted: list[Predicted]


@dataclass(frozen=True)
class Fact:
    """What determined both results, "" where one has no such thing."""

    what: str
    first: str
    second: str


@dataclass(frozen=True)
class ParameterPair:
    """A parameter of both results.

    `overlap` is the shared part of the intervals over the shorter one, in the logarithm of values above zero; None
    where a result lacks the parameter.
    """

    name: str
    first: Estimate | None
    second: Estimate | None
    overlap: float | None


@dataclass(frozen=True)
class GroupPair:
    """How well both predict one group; `elpd_change` is None where a density is not on record.

    `observable` is what is read, by its name; it is left out for the launch range.
    """

    group: GroupId
    roles: list[str]
    informative: bool
    n_points: int
    log_rmse: list[float]
    log_rmse_interval: list[float]
    coverage_90: list[float]
    elpd_change: float | None
    elpd_interval: list[float] | None
    observable: str | None = field(default=None, metadata=ABSENT)

    @property
    def judged(self) -> bool:
        """Whether the means are over it: it is informative and fitted by neither."""
        return self.informative and "fit" not in self.roles

    @property
    def key(self) -> tuple[str, str | None]:
        """Which readings they are: the group's id and what is read."""
        return str(self.group), self.observable


@dataclass(frozen=True)
class Comparison:
    """What `psafit report A B` finds.

    Parameters
    ----------
    names : list of str
    facts : list of Fact
    parameters : list of ParameterPair
    groups : list of GroupPair
        With the same readings in both.
    apart : list of group ids
        That only one of them has, or whose readings or drive differ.
    judged : list of group ids
        That the means are over: see `GroupPair.judged`.
    log_rmse : list of float, optional
        Means over the judged groups, None without any.
    log_rmse_interval : list of float, optional
        Of the change of the mean.
    """

    names: list[str]
    facts: list[Fact]
    parameters: list[ParameterPair]
    groups: list[GroupPair]
    apart: list[GroupId]
    judged: list[GroupId]
    log_rmse: list[float] | None
    log_rmse_interval: list[float] | None


def read_side(folder: Path) -> Side:
    """Read a result; `InputError` where the folder holds neither a finished fit nor a diagnosis."""
    if is_diagnosis(folder) and not (folder / "fit.json").exists():
        return _of_diagnosis(folder)
    run = load(folder)
    facts = {
        "data": _data(run.fit.title, run.fit.fingerprint),
        "fitted groups": _listed(run.fit.groups),
        "model": _listed(["baseline", *sorted(run.fit.terms)], " + "),
        "simulator": run.fit.engine,
        "seed": str(run.fit.seed),
        "starts of the search": str(run.fit.n_starts),
        "sampler": ", ".join(f"{name} {value:g}" for name, value in run.fit.sampler.items()),
        "posterior": run.summary.message,
        **{f"prior of {e.name}": f"{e.prior}, within {e.lower:g} to {e.upper:g}" for e in run.fit.parameters},
        **{f"version of {name}": version for name, version in run.fit.versions.items()},
        "command": run.fit.command,
    }
    parameters = {
        e.name: Estimate(
            s.median, s.lower, s.upper, e.unit, e.description, s.verdict,
            supported(e.unit, s.profile, (s.lower, s.upper), s.verdict),
        )
        for e, s in zip(run.fit.parameters, run.summary.parameters, strict=True)
    }  # fmt: skip
    predicted = [Predicted(p.group, p.role, p.median, p.lower, p.upper, p.log_density) for p in predict(run)]
    return Side(_name(folder), "fit", run.fit.title, run.fit.groups, run.fit.terms, facts, parameters, predicted)


def _of_diagnosis(folder: Path) -> Side:
    record = read_json(folder / RESULT, Diagnosis, sealed=True, remedy="run psafit diagnose again")
    facts = {
        "data": _data(record.title, record.fingerprint),
        "fitted groups": _listed(record.groups),
        "model": _listed(["baseline", *sorted(record.named)], " + "),
        "simulator": record.numerics.engine,
        "seed": str(record.seed),
        "verdict": record.verdict,
        **{f"version of {name}": version for name, version in record.versions.items()},
        "command": record.command,
    }
    parameters = {
        name: Estimate(p.median, known(p.lower), known(p.upper), p.unit, p.description)
        for name, p in (record.best_model.parameters if record.best_model else {}).items()
    }
    predicted = read_predictions(record.table(folder, record.predictions))
    if (kept := folder / "experiment").is_dir():
        drives = {str(g.id): g.drive for g in read_experiment(kept).groups}
        predicted = [
            replace(t, group=replace(t.group, drive=drive), waveform_alone=False)
            if (drive := drives.get(t.key[0]))
            else t
            for t in predicted
        ]
    return Side(_name(folder), "diagnosis", record.title, record.groups, record.named, facts, parameters, predicted)


def known(value: object) -> float:
    """A number of the record; what was not finite is None in a record read back."""
    return float(value) if isinstance(value, int | float) else math.nan


def read_predictions(path: Path, model: str | None = None) -> list[Predicted]:
    """Read predictions back, a group after the other, or one model's rows where they have a column `model`.

    Parameters
    ----------
    path : Path
        Of the launch ranges; those of other observables stand next to it.
    model : str, optional

    Raises
    ------
    InputError
        If all are missing, or one is damaged.
    """
    tables = tables_at(path) or {LAUNCH_RANGE: path}
    return [one for o, file in tables.items() for one in _read_table(file, o, model)]


def _read_table(path: Path, observable: Observable, model: str | None) -> list[Predicted]:
    """The predictions of one observable."""
    import pandas as pd

    columns = columns_of(observable)
    _, _, *numeric, _ = columns
    found = numeric[-3:]  # median and band
    try:
        table = pd.read_csv(path, converters={"group": str})  # NA is a name, too
        table = (table if model is None else table[table["model"] == model])[list(columns)].assign(log_density=np.nan)
        numbers = table[numeric].to_numpy(float)
        signed = observable.traced or (numbers >= 0).all()
        if not (np.isfinite(numbers).all() and signed and table["role"].isin(_ROLES).all()):
            raise ValueError("impossible values")
        return [
            Predicted(
                Group(
                    str(id),
                    Drive(rows["waveform"].iloc[0]),
                    path.name,
                    rows["frequency_hz"].to_numpy(float),
                    rows["amplitude_v"].to_numpy(float),
                    reading=rows[observable.column].to_numpy(float),
                    measured=np.full(len(rows), OBSERVABLES.index(observable), np.int8),
                    time_us=rows[TIME].to_numpy(float) if observable.traced else None,
                ),
                str(rows["role"].iloc[0]),
                *(rows[name].to_numpy(float) for name in (*found, "log_density")),
                waveform_alone=True,
            )
            for id, rows in table.groupby("group", sort=False)
        ]
    except (OSError, ValueError, KeyError) as error:
        what = "is missing" if isinstance(error, FileNotFoundError) else "does not hold predictions"
        raise read_error(error, path, what, "run psafit diagnose again") from error


def compare(first: Side, second: Side) -> Comparison:
    """Set two results side by side.

    Raises
    ------
    InputError
        If they have no group in common.
    """
    mates = {t.group.label: t for t in second.predicted}
    pairs = [(t, mates[t.group.label]) for t in first.predicted if _same(t, mates.get(t.group.label))]
    common = {t.group.label for t, _ in pairs}
    if not pairs:
        what = f"{first.name} and {second.name} have no group with the same readings"
        raise InputError(what, "compare results of one experiment")
    rows, redrawn = zip(*(_pair(a, b, seed) for seed, (a, b) in enumerate(pairs)), strict=True)
    judged = [k for k, row in enumerate(rows) if row.judged]
    apart = {t.group.label: t.group.id for t in (*first.predicted, *second.predicted)}
    return Comparison(
        names=[first.name, second.name],
        facts=[
            Fact(what, first.facts.get(what, ""), second.facts.get(what, ""))
            for what in dict.fromkeys([*first.facts, *second.facts])
            if first.kind == second.kind or (what in first.facts and what in second.facts)
        ],
        parameters=[
            _parameter(name, first.parameters.get(name), second.parameters.get(name))
            for name in dict.fromkeys([*first.parameters, *second.parameters])
        ],
        groups=list(rows),
        apart=list(dict.fromkeys(id for name, id in apart.items() if name not in common)),
        judged=list(dict.fromkeys(rows[k].group for k in judged)),
        log_rmse=[float(np.mean([rows[k].log_rmse[i] for k in judged])) for i in (0, 1)] if judged else None,
        log_rmse_interval=interval(np.mean([redrawn[k] for k in judged], axis=0)) if judged else None,
    )


def distinguished(first: Side, second: Side) -> tuple[Side, Side]:
    """Give two results of the same name different ones."""
    if first.name != second.name:
        return first, second
    return replace(first, name=f"first {first.name}"), replace(second, name=f"second {second.name}")


def _name(folder: Path) -> str:
    return encodable(folder.resolve().name)


def _data(title: str, fingerprint: str) -> str:
    return f"{title} (fingerprint {fingerprint[:12]})"


def _listed(words: Sequence[object], between: str = ", ") -> str:
    return between.join(str(w) for w in words)


def _same(one: Predicted, other: Predicted | None) -> bool:
    """Whether both are of the same readings, under the same drive as far as it is known."""
    return (
        other is not None
        and one.group.waveform == other.group.waveform
        and (one.waveform_alone or other.waveform_alone or one.group.drive == other.group.drive)
        and all(np.array_equal(getattr(one.group, name), getattr(other.group, name)) for name in _MEASURED)
        and np.array_equal(one.group.time_us, other.group.time_us)  # type: ignore[arg-type]  # None of launches
    )


def _pair(a: Predicted, b: Predicted, seed: int) -> tuple[GroupPair, FloatArray]:
    """Both scores of a group, and the bootstrap of the change of its log RMSE."""
    measured, n = a.group.reading, a.group.n_points
    errors = [log_ratio(t.median, measured, *a.group.observable.metric) for t in (a, b)]
    rmse, elpd = changes(a.group, errors, [a.log_density, b.log_density], np.random.default_rng(seed))
    gain = float((b.log_density - a.log_density).sum())
    pair = GroupPair(
        group=a.group.id,
        roles=[a.role, b.role],
        informative=not why_uninformative(a.group),
        n_points=n,
        log_rmse=[root_mean_square(error) for error in errors],
        log_rmse_interval=interval(rmse),
        coverage_90=[float(np.mean((measured >= t.lower) & (measured <= t.upper))) for t in (a, b)],
        elpd_change=None if math.isnan(gain) else gain,
        elpd_interval=None if math.isnan(gain) else interval(elpd),
        observable=recorded_name(a.group.observable),
    )
    return pair, rmse


def _parameter(name: str, a: Estimate | None, b: Estimate | None) -> ParameterPair:
    if a is None or b is None:
        return ParameterPair(name, a, b, None)
    ends = np.array([[a.lower, a.upper], [b.lower, b.upper]])
    ends = np.log(ends) if (ends > 0).all() else ends
    shared = ends[:, 1].min() - ends[:, 0].max()
    shortest = float((ends[:, 1] - ends[:, 0]).min())
    overlap = float(np.clip(shared / shortest, 0, 1)) if shortest > 0 else math.nan
    return ParameterPair(name, a, b, overlap)

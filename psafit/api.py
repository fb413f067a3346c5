"""The notebook's way in: thin views of an experiment and of its results.

Everything here calls what the command line calls, and leaves the same files; tables are pandas', plots take an `ax`
and return it. ``import psafit`` loads none of this before it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from psafit.compare import known
from psafit.diagnose import diagnose
from psafit.diagnose.record import RESULT, Diagnosis
from psafit.diagnose.record.models import CauseResult
from psafit.diagnose.retest import once
from psafit.diagnose.words import PLAIN
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, GroupId
from psafit.experiment.records import CONDITION_COLUMNS
from psafit.experiment.trace_table import TIME
from psafit.files import ensure_writable, usual_fit_folder, usual_folder
from psafit.inference.identify import describe, not_expected
from psafit.inference.run import fit
from psafit.inference.run_folder import Run
from psafit.inference.samplers import USUAL
from psafit.model_search.model_set import key_of
from psafit.observables import LAUNCH_RANGE
from psafit.physics import terms as catalogue
from psafit.prior_check import read
from psafit.progress import watcher
from psafit.records import Validation, read_json
from psafit.report import notebook
from psafit.report.notebook import Axes
from psafit.validate import Prediction, columns_of, prediction_rows, validate


class _Shown:
    """What a notebook shows of a view: a headline, remarks, and tables."""

    def _summary_parts(self) -> tuple[str, Sequence[str], list[pd.DataFrame]]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return notebook.text(*self._summary_parts())

    def _repr_html_(self) -> str:
        return notebook.html(*self._summary_parts())


class Rig(_Shown):
    """An experiment: its measurements, and what can be asked of them.

    Parameters
    ----------
    experiment : Experiment
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment

    @property
    def data(self) -> pd.DataFrame:
        """The readings, one a row: each observable in a column of its own, NaN in the others.

        Where there are traces, `time_us` is the time of their samples.
        """
        table = pd.concat(
            [
                pd.DataFrame({
                    "group": g.id, "waveform": g.waveform, "frequency_hz": g.frequency_hz,
                    "amplitude_v": g.amplitude_v, "time_us": math.nan if g.time_us is None else g.time_us,
                    g.observable.column: g.reading,
                })
                for whole in self.experiment.groups
                for g in whole.parts
            ],
            ignore_index=True,
        )  # fmt: skip
        return table.dropna(axis="columns", how="all")  # times, where there are no traces

    def fit(
        self,
        groups: GroupId | Sequence[GroupId],
        *,
        terms: str | Sequence[str] = (),
        out: str | Path | None = None,
        seed: int = 1,
        starts: int = 32,
        sampler: str = USUAL,
        settings: Mapping[str, float] | None = None,
        quiet: bool = False,
    ) -> Fitted:
        """Fit and sample, or take up the run that the folder holds: see `psafit.inference.run.fit`.

        Parameters
        ----------
        groups : group id or sequence of group ids
            What the fit sees.
        terms : str or sequence of str
            Causes that extend the baseline.
        out : path-like, optional
            Run folder; the command line's by default.
        seed, starts : int
        sampler : str
            What draws the posterior; see `psafit.inference.samplers`.
        settings : dict, optional
            Its options by name, such as ``{"max_steps": 100_000}``; those of all samplers are
            `psafit.inference.sampling.SamplerSettings`.
        quiet : bool
            Whether to show no progress.

        Returns
        -------
        Fitted
        """
        ids, causes = _listed(groups), catalogue([terms] if isinstance(terms, str) else terms)
        folder = Path(out) if out else usual_fit_folder(self.experiment.folder, ids, [t.id for t in causes])
        ensure_writable(folder, "out", folder=True, inputs=[self.experiment.folder])
        with watcher(quiet) as show:
            return Fitted(
                fit(
                    self.experiment, ids, folder, terms=causes, seed=seed, n_starts=starts, sampled_by=sampler,
                    settings=settings, watcher=show,
                )
            )  # fmt: skip

    def diagnose(
        self,
        groups: GroupId | Sequence[GroupId] | None = None,
        *,
        causes: str | Sequence[str] | None = None,
        quick: bool = False,
        calibrate: int = 0,
        out: str | Path | None = None,
        seed: int = 1,
        jobs: int | None = None,
        scheduler: str | None = None,
        quiet: bool = False,
    ) -> Diagnosed:
        """Find what the simulation gets wrong, and why: see `psafit.diagnose.diagnose`.

        Parameters
        ----------
        groups : group id or sequence of group ids, optional
            Training groups of the strict gain; the first group by default.
        causes : str or sequence of str, optional
            Candidate causes; all of the catalogue by default. The answer names those that were left out.
        quick : bool
            The verdict alone, by the same search.
        calibrate : int
            Data sets drawn from the answer and diagnosed again, to say how often it is right here.
        out : path-like, optional
            Folder; the command line's by default.
        seed : int
        jobs : int, optional
            Processes that search side by side; one for every core by default.
        scheduler : str, optional
            Address of a Dask scheduler whose workers search instead (extra ``psafit[cluster]``).
        quiet : bool
            Whether to show no progress.

        Returns
        -------
        Diagnosed
        """
        ids = [self.experiment.ids[0]] if groups is None else _listed(groups)
        candidates = None if causes is None else catalogue([causes] if isinstance(causes, str) else causes)
        if candidates == ():
            raise InputError("no cause is given to look at", "name some, or leave causes out to look at all")
        folder = Path(out) if out else usual_folder(self.experiment.folder, "diagnosis")
        ensure_writable(folder, "out", folder=True, inputs=[self.experiment.folder])
        with watcher(quiet) as show:
            record = diagnose(
                self.experiment, ids, folder, quick=quick, calibrate=calibrate, seed=seed, catalogue=candidates,
                jobs=jobs, scheduler=scheduler, watcher=show,
            )  # fmt: skip
        return Diagnosed(record, self.experiment, folder)

    def plot(self, group: GroupId, ax: Axes | None = None, *, observable: str | None = None) -> Axes:
        """Draw the readings of a group, of one observable.

        Parameters
        ----------
        group : group id
        ax : Axes, optional
            New ones by default.
        observable : str, optional
            What was read, such as ``"launch_speed"``; the group's first by default.
        """
        return notebook.plot_group(_part(self.experiment, group, observable), (), ax)

    def _summary_parts(self) -> tuple[str, Sequence[str], list[pd.DataFrame]]:
        rows = [
            {
                "group": str(g.id), "waveform": g.drive.label, "readings": g.n_points,
                "frequency (Hz)": _span(g.frequency_hz), "amplitude (V)": _span(g.amplitude_v),
                "time (us)": math.nan if g.time_us is None else _span(g.time_us),
                **{f"{part.observable.title} ({part.observable.unit})": _span(part.reading) for part in g.parts},
            }
            for g in self.experiment.groups
        ]  # fmt: skip
        return self.experiment.title, [], [pd.DataFrame(rows).set_index("group").dropna(axis="columns", how="all")]


class Fitted(_Shown):
    """A finished fit.

    Parameters
    ----------
    run : Run
    """

    def __init__(self, run: Run) -> None:
        self.run = run

    @cached_property
    def _validated(self) -> tuple[Validation, list[Prediction]]:
        return validate(self.run, retest=once)

    @property
    def parameters(self) -> pd.DataFrame:
        """Posterior medians, central 90 % intervals and what the data say of each."""
        rows = [
            [s.name, s.median, s.lower, s.upper, e.unit, s.verdict, s.r_hat]
            for e, s in zip(self.run.fit.parameters, self.run.summary.parameters, strict=True)
        ]
        columns = ["parameter", "median", "lower_90", "upper_90", "unit", "verdict", "r_hat"]
        return pd.DataFrame(rows, columns=columns).set_index("parameter")

    @property
    def scores(self) -> pd.DataFrame:
        """How well each group is predicted: see `psafit.records.GroupScore`.

        Where not all readings are launch ranges, `observable` and `unit` say of every row what it scores.
        """
        table = pd.DataFrame(self._validated[0].groups).set_index("group")
        if self._only_ranges:
            return table
        return table.fillna({"observable": LAUNCH_RANGE.name, "unit": LAUNCH_RANGE.unit})

    @property
    def _only_ranges(self) -> bool:
        return all(s.observable is None for s in self._validated[0].groups)

    @property
    def predictions(self) -> pd.DataFrame:
        """Posterior median and 90 % predictive interval of every reading.

        The columns are those of `predictions.csv`, where all readings are of one observable: `launch_range_um`,
        `predicted_um` and so on. Where several were read, `observable` and `unit` say of each row what it holds, and
        `measured`, `predicted`, `lower` and `upper` are in that unit. Traces have `time_us`, NaN in other rows.
        """
        tables = []
        for p in self._validated[1]:
            rows = prediction_rows(p.group, p.median, p.lower, p.upper, p.role)
            tables.append(pd.DataFrame(rows, columns=list(columns_of(p.group.observable))))
        read = [p.group.observable for p in self._validated[1]]
        if len(set(read)) == 1:
            return pd.concat(tables, ignore_index=True)
        values = ["measured", "predicted", "lower", "upper"]
        for o, table in zip(read, tables, strict=True):
            table.columns = [*table.columns[:-5], *values, "role"]
            table["observable"], table["unit"] = o.name, o.unit
        found = pd.concat(tables, ignore_index=True)
        order = ["group", "waveform", *CONDITION_COLUMNS, TIME, "observable", "unit", *values, "role"]
        return found[[name for name in order if name in found]]

    def plot(self, group: GroupId | None = None, ax: Axes | None = None, *, observable: str | None = None) -> Axes:
        """Draw a group's readings and prediction; without a group, how far off the prediction is in each.

        Parameters
        ----------
        group : group id, optional
        ax : Axes, optional
            New ones by default.
        observable : str, optional
            What was read, such as ``"launch_speed"``; the group's first by default.
        """
        chosen = _chosen(self.run.problem.experiment, group, observable)
        return notebook.plot_fit(*self._validated, chosen, ax)

    def report(self) -> Path:
        """Write `report.html`."""
        from psafit.numerics import audit
        from psafit.report.fit import write_report

        return write_report(self.run, *self._validated, audit(self.run))

    def _summary_parts(self) -> tuple[str, Sequence[str], list[pd.DataFrame]]:
        record, mean = self.run.fit, self._validated[0].holdout_log_rmse
        model = " + ".join(["baseline", *record.terms])
        unseen = "no group was held out" if mean is None else f"mean log_rmse of unseen groups {mean:.3f}"
        groups = f"group{'s' * (len(record.groups) > 1)} {', '.join(str(g) for g in record.groups)}"
        headline = f"{model}, fitted to {groups} of {record.title}: {unseen}"
        state = "" if self.run.summary.converged else f"; {self.run.summary.message}"
        read = [] if self._only_ranges else ["observable"]
        scores = self.scores[[*read, "role", "n_points", "log_rmse", "coverage_90", "size"]]
        scores = scores.rename(columns={"size": "verdict"})
        # The name is the row's.
        rows = [
            [s.name, s.text.removeprefix(f"{s.name} ").removeprefix("= "), f"{s.r_hat:.4f}"]
            for s in self.run.summary.parameters
        ]
        parameters = pd.DataFrame(rows, columns=["parameter", "what the readings say", "r_hat"]).set_index("parameter")
        return headline + state, [], [parameters, scores]


class Diagnosed(_Shown):
    """A diagnosis.

    Parameters
    ----------
    record : Diagnosis
    experiment : Experiment
        That was diagnosed.
    folder : Path
    """

    def __init__(self, record: Diagnosis, experiment: Experiment, folder: Path) -> None:
        self.record = record
        self.experiment = experiment
        self.folder = folder

    @classmethod
    def of(cls, folder: Path, experiment: Path | None = None) -> Diagnosed:
        """Read it back from its folder.

        Parameters
        ----------
        folder : Path
        experiment : Path, optional
            The measurements; the copy that the folder keeps by default.

        Raises
        ------
        InputError
            If either cannot be read, or the measurements are not those that were diagnosed.
        """
        record = read_json(folder / RESULT, Diagnosis, sealed=True, remedy="run psafit diagnose again")
        kept = folder / "experiment"
        if experiment is None and not kept.is_dir():
            raise InputError(
                "keeps no measurements", "name them with --experiment EXP, from Python experiment=...", file=folder
            )
        data = read(experiment or kept)
        if data.fingerprint != record.fingerprint:
            raise InputError("is not the experiment that was diagnosed", "name the right one", file=experiment or kept)
        return cls(record, data, folder)

    @property
    def verdict(self) -> str:
        """One of adequate, explained, ambiguous and unexplained."""
        return self.record.verdict

    @property
    def named(self) -> list[str]:
        """The adopted extension, best first."""
        return self.record.named

    @property
    def causes(self) -> pd.DataFrame:
        """The models that were compared, the named set first, then the most probable.

        Gain and evidence are over the baseline, in nats. A discrepancy without a name that has a share of the
        probability is the last.
        """
        rows = [[key_of(c.terms), c.probability, c.evidence.gain, c.evidence.over_baseline] for c in self.record.causes]
        if self.record.reports_unnamed:
            rows.append(["a discrepancy without a name", self.record.unnamed, math.nan, math.nan])
        return pd.DataFrame(rows, columns=["model", "probability", "gain", "evidence"]).set_index("model")

    @property
    def parameters(self) -> pd.DataFrame:
        """Parameters of the named model, or of the baseline where none is named; see `parameters_of`."""
        return self.parameters_of(self.named)

    def parameters_of(self, model: str | Sequence[str]) -> pd.DataFrame:
        """Posterior medians and central 90 % intervals of a model; NaN for the ends where it was not sampled.

        Parameters
        ----------
        model : str or sequence of str
            Its causes, as `causes` lists it: "gap + preload" or ["gap", "preload"]; "baseline" or nothing for none.

        Raises
        ------
        InputError
            If it is not among the models of the record.
        """
        found = self._model(model)
        rows = [
            [name, p.median, known(p.lower), known(p.upper), p.unit, name in found.implausible]
            for name, p in found.parameters.items()
        ]
        columns = ["parameter", "median", "lower_90", "upper_90", "unit", "implausible"]
        return pd.DataFrame(rows, columns=columns).set_index("parameter")

    def _model(self, model: str | Sequence[str]) -> CauseResult:
        ids = [id.strip() for id in model.split("+")] if isinstance(model, str) else list(model)
        wanted = set(ids) - {"baseline", ""}
        found = next((c for c in self.record.causes if set(c.terms) == wanted), None)
        if found is None:
            raise InputError(f"no model {' + '.join(ids) or 'baseline'}", "choose one of `causes`")
        return found

    def plot(self, group: GroupId | None = None, ax: Axes | None = None, *, observable: str | None = None) -> Axes:
        """Draw a group's readings and both models, as `Fitted.plot`; without a group, how far off they are in each."""
        chosen = _chosen(self.experiment, group, observable)
        return notebook.plot_diagnosis(self.record, self.experiment, self.folder, chosen, ax)

    def report(self) -> Path:
        """Write `diagnosis.html`."""
        from psafit.report.diagnosis import write_diagnosis

        return write_diagnosis(self.record, self.experiment, self.folder)

    def _summary_parts(self) -> tuple[str, Sequence[str], list[pd.DataFrame]]:
        tables = [self.causes]
        if any(set(c.terms) == set(self.named) for c in self.record.causes):
            name, column = key_of(self.named), "what the readings say"
            rows = list(_sizes(self._model(self.named)))
            tables.append(
                pd.DataFrame(rows, columns=[f"parameter of {name}", column]).set_index(f"parameter of {name}")
            )
        return self.record.headline, self.record.sentences, tables


def _sizes(cause: CauseResult) -> Iterator[tuple[str, str]]:
    """Each parameter of a model, and its value with its interval and unit as the terminal prints it."""
    for name, p in cause.parameters.items():
        if p.interval is None:
            size = f"{PLAIN.value(p.unit, p.median, None)} (not sampled)"
        else:
            size = describe("", p.unit, p.median, p.interval, [], "determined").removeprefix(" = ")
        yield name, size + (not_expected(p.unit, p.prior_interval) if name in cause.implausible else "")


def _listed(given: GroupId | Sequence[GroupId]) -> list[GroupId]:
    return [given] if isinstance(given, str | int) else list(given)


def _part(experiment: Experiment, group: GroupId, observable: str | None) -> Group:
    """The readings of a group that are of one observable; of its first where none is named."""
    parts = {part.observable.name: part for part in experiment.group(group).parts}
    name = next(iter(parts)) if observable is None else observable
    if name not in parts:
        raise InputError(f"group {group} has no {name}", f"choose {' or '.join(parts)}")
    return parts[name]


def _chosen(experiment: Experiment, group: GroupId | None, observable: str | None) -> Group | None:
    if group is None and observable is not None:
        raise InputError(f"{observable} of no group", "name the group, too")
    return None if group is None else _part(experiment, group, observable)


def _span(values: NDArray[np.float64]) -> str:
    low, high = values.min(), values.max()
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"

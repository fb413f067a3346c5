"""How far a running fit or diagnosis has come, from the files it leaves behind; nothing is written, no file is locked.

The checkpoint is replaced in one step, so whatever is opened is whole. It may yet be gone, or be another program's
half-written file: then there is no chain to report.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Literal

from psafit.diagnose.record import MARKER as DIAGNOSED
from psafit.diagnose.record import RESULT, Diagnosis
from psafit.errors import InputError
from psafit.files import in_use
from psafit.forecast import Progress, progress_of
from psafit.inference.run_folder import MARKER
from psafit.inference.samplers import sampler
from psafit.inference.sampling import Convergence
from psafit.inference.store import REBUILD
from psafit.records import Fit, PosteriorSummary, read_json

Stage = Literal["search", "sample", "profile", "done", "gave up"]

_FOREIGN = "give a folder that psafit fit or psafit diagnose writes to"


@dataclass(frozen=True)
class State(Convergence):
    """A run as its folder shows it, with the `Convergence` of its chains; None where there is nothing to say yet.

    Parameters
    ----------
    stage : {"search", "sample", "profile", "done", "gave up"}
    steps : int, optional
    best_minimum : float, optional
        The highest log posterior of the search.
    seconds_per_step, seconds_left : float, optional
        Pace, and a rough estimate of what is left.
    written : float, optional
        When the last checkpoint was, seconds since the epoch.
    running : bool, optional
        Whether a process works in the folder; None where the system cannot say.
    whole_left : float, optional, s
        Of all stages, as the run itself reckons.
    chunk : int, optional
        Steps between checkpoints.
    """

    stage: Stage
    steps: int | None = None
    best_minimum: float | None = None
    seconds_per_step: float | None = None
    seconds_left: float | None = None
    written: float | None = None
    running: bool | None = None
    whole_left: float | None = None
    chunk: int | None = None

    @property
    def finished(self) -> bool:
        """Whether nothing more will come by itself."""
        return self.stage in ("done", "gave up")

    @property
    def stalled(self) -> bool:
        """Whether checkpoints have stayed away for so long that nobody seems to be drawing."""
        return self.silent_for()

    def silent_for(self, *, waits: float = 10.0, seconds: float = 60.0) -> bool:
        """Whether the last checkpoint is older than so many usual waits for one, and than so many seconds."""
        if self.running is not None or self.stage != "sample" or self.written is None:
            return False
        usual = (self.seconds_per_step or 0.0) * (self.chunk or 0)
        return time.time() - self.written > max(waits * usual, seconds)


@dataclass(frozen=True)
class DiagnosisState:
    """A diagnosis as its folder shows it; None where there is nothing to report.

    Parameters
    ----------
    stage : str
        "done", or the stage that it is in; empty where an earlier version has left nothing but its steps.
    done, total : float, optional
        Counts of the stage.
    note : str
        What is counted.
    models : int
        Short fits that are kept so far, of all searches; of a finished one, sets of causes fitted on all readings.
    seconds : float, optional
        Spent so far, interruptions left out.
    whole_left : float, optional, s
        Of all stages.
    written : float, optional
        When that was said, seconds since the epoch.
    headline : str
        The verdict of a finished one.
    running : bool, optional
        Whether a process works in the folder; None where the system cannot say.
    """

    stage: str
    done: float | None = None
    total: float | None = None
    note: str = ""
    models: int = 0
    seconds: float | None = None
    whole_left: float | None = None
    written: float | None = None
    headline: str = ""
    running: bool | None = None

    @property
    def finished(self) -> bool:
        """Whether nothing more will come by itself."""
        return self.stage == "done"


def look(
    folder: Path, before: State | DiagnosisState | None = None, *, values: int = 2_000_000
) -> State | DiagnosisState:
    """How far the fit or the diagnosis in a folder is; where both are, the one that is under way, else the fit.

    Parameters
    ----------
    folder : Path
    before : State or DiagnosisState, optional
        What the last look has shown: the pace is measured from there, and an old checkpoint is not read again.
    values : int
        Numbers of a chain that are read, about a second's work; of a longer one, fewer steps.

    Returns
    -------
    State or DiagnosisState

    Raises
    ------
    InputError
        If neither has been there.
    """
    running, under_way = in_use(folder), progress_of(folder)
    fitted = (folder / "fit.json").exists() or (folder / MARKER).exists()
    diagnosed = any((folder / name).exists() for name in (RESULT, DIAGNOSED, "steps"))
    if diagnosed and (not fitted or (under_way is not None and under_way.kind == "diagnosis")):
        return replace(_diagnosis(folder, under_way), running=running)
    seen = _seen(folder, before if isinstance(before, State) else None, bool(running), values)
    left = under_way.left if under_way is not None and running and not seen.finished else None
    same = (seen.running, seen.whole_left) == (running, left)
    return seen if same else replace(seen, running=running, whole_left=left)


def _diagnosis(folder: Path, under_way: Progress | None) -> DiagnosisState:
    models = sum(1 for _ in (folder / "steps").glob("short-*.npz"))
    if under_way is None and (folder / RESULT).exists():
        record = read_json(folder / RESULT, Diagnosis, sealed=True, remedy="run psafit diagnose again")
        fitted, spent = record.looked_at.fitted, sum(record.seconds.values())
        return DiagnosisState("done", models=fitted, seconds=spent, headline=record.headline)
    if under_way is None:
        return DiagnosisState("", models=models)
    p = under_way
    return DiagnosisState(p.stage, p.done, p.total, p.note, models, sum(p.seconds.values()), p.left, p.written)


def _seen(folder: Path, before: State | None, running: bool, values: int) -> State:
    if not (folder / "fit.json").exists():
        if (folder / MARKER).exists():
            return State("search")
        what = "is not a run folder" if folder.is_dir() else "is no folder"
        raise InputError(what, _FOREIGN, file=folder)
    record = read_json(folder / "fit.json", Fit, sealed=True)
    ended = folder / "posterior.json"
    chain = folder / "chain.h5"
    if ended.exists():
        try:
            summary = read_json(ended, PosteriorSummary, sealed=True, remedy=REBUILD)
        except InputError:
            if ended.exists():  # else it has just been taken away, since the chain goes on
                raise
        else:
            # A run that gave up and is drawn on keeps its summary until it ends again.
            drawn_on = running or (_written(chain) or 0.0) > (_written(ended) or math.inf)
            if summary.converged or not drawn_on:
                return _ended(record, summary)
    return _sampling(record, folder / "fit.json", chain, before, values)


def _written(path: Path) -> float | None:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return None


def _ended(record: Fit, summary: PosteriorSummary) -> State:
    state = State("done" if summary.converged else "gave up", best_minimum=record.minima[0].log_posterior)
    if not sampler(record.sampled_by).chained:
        return state
    return replace(
        state,
        steps=summary.n_steps,
        walkers=summary.n_walkers,
        acceptance=summary.acceptance,
        autocorrelation_time=max(p.autocorrelation_time for p in summary.parameters),
        autocorrelation_times=summary.autocorrelation_times,
        wanted_times=_goal(record, "autocorrelation_times"),
        r_hat=max(p.r_hat for p in summary.parameters),
        wanted_r_hat=_goal(record, "r_hat"),
    )


def _goal(record: Fit, name: str) -> float | None:
    """What a sampler's settings ask for, if they do."""
    return float(record.sampler[name]) if name in record.sampler else None


def _sampling(record: Fit, begun: Path, path: Path, before: State | None, values: int) -> State:
    written = _written(path)  # before it is read: a newer one is then read again
    if before is not None and before.stage in ("sample", "profile") and before.written == written is not None:
        return before
    found = sampler(record.sampled_by).look(path, record.sampler, len(record.parameters), values)
    if found is None or written is None:
        return State("sample", best_minimum=record.minima[0].log_posterior)
    since, done = _written(begun) or written, 0
    if before is not None and before.steps is not None and before.written is not None and before.steps < found.steps:
        since, done = before.written, before.steps
    pace = max(written - since, 0.0) / (found.steps - done)
    return State(
        "profile" if found.converged else "sample",
        steps=found.steps,
        **{f.name: getattr(found, f.name) for f in fields(Convergence)},
        best_minimum=record.minima[0].log_posterior,
        seconds_per_step=pace,
        seconds_left=None if found.converged else pace * found.steps_left,
        written=written,
        chunk=found.chunk,
    )

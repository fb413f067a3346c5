"""From a problem to a fitted, sampled and described posterior in a run folder.

The folder holds `experiment/` (a copy of the data the run saw), `fit.json` once the search is done,
`chain.h5` (the sampler's checkpoint), and at the end `posterior.nc` and `posterior.json`. Each stage that is already
there is taken from the folder, so an interrupted run goes on where it stopped, and one whose chain gave up
before it converged draws on.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

import psafit
from psafit.errors import InputError
from psafit.experiment import Experiment, GroupId, read_experiment, write_experiment
from psafit.files import portable_command
from psafit.inference import emcee_adaptor, identify, store
from psafit.inference.optimise import Minimum, Optimum, laplace_covariance, optimise
from psafit.inference.problem import Problem
from psafit.physics import terms as catalogue
from psafit.physics.term import Term
from psafit.records import (
    Fit,
    MinimumEntry,
    ParameterEntry,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    read_json,
    write_json,
)
from psafit.simulate import path_of

FloatArray = NDArray[np.float64]

# Draws kept in posterior.nc, in units of the autocorrelation time: denser adds bytes, not information.
_THIN = 0.5
LIBRARIES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz", "h5py", "pandas")


class Watcher(Protocol):
    """Whoever shows the progress of a run."""

    def stage(self, name: str) -> None:
        """Begin a stage."""

    def update(self, done: float, total: float | None, note: str = "") -> None:
        """Report how far the stage is; `total` is None where nobody can know."""


class Silent:
    """A watcher that shows nothing."""

    def stage(self, name: str) -> None:
        """Do nothing."""

    def update(self, done: float, total: float | None, note: str = "") -> None:
        """Do nothing."""


@dataclass(frozen=True)
class Run:
    """A finished run, as its folder holds it."""

    folder: Path
    problem: Problem
    fit: Fit
    summary: PosteriorSummary
    draws: store.Draws


def identity_of(problem: Problem, seed: int, settings: emcee_adaptor.Settings, n_starts: int) -> str:
    """SHA-256 over everything that determines a run's result."""
    content = {
        "version": psafit.__version__,
        "fingerprint": problem.experiment.fingerprint,
        "groups": [str(g) for g in problem.group_ids],
        "terms": [t.id for t in problem.terms],
        "parameters": [(p.name, p.bounds.lower, p.bounds.upper, p.prior.describe()) for p in problem.parameters],
        "seed": seed,
        "n_starts": n_starts,
        "settings": {k: v for k, v in asdict(settings).items() if k != "max_steps"},
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def versions() -> dict[str, str]:
    """Versions of psafit, Python and the libraries that shape a result."""
    found = {"psafit": psafit.__version__, "python": platform.python_version()}
    return found | {name: importlib.metadata.version(name) for name in LIBRARIES}


def fit(
    experiment: Experiment,
    group_ids: Sequence[GroupId],
    folder: Path,
    *,
    terms: Sequence[Term] = (),
    seed: int = 1,
    n_starts: int = 32,
    settings: emcee_adaptor.Settings | None = None,
    watcher: Watcher | None = None,
    command: Sequence[object] = (),
) -> Run:
    """Fit the model to some groups, sample its posterior, and say what the data determine.

    Parameters
    ----------
    experiment : Experiment
    group_ids : sequence of group ids
        What the likelihood sees.
    folder : Path
        Run folder; an interrupted run of the same problem there is taken up again, and one that has not converged
        gets `settings.max_steps` more.
    terms : sequence of Term
        Causes that extend the baseline.
    seed : int
        Same seed, same result.
    n_starts : int
        Starts of the search.
    settings : Settings, optional
        Of the sampler; `Settings.of` the problem by default.
    watcher : Watcher, optional
    command : sequence
        Words of the command line to be kept with the result.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        If a group is unknown, or the folder belongs to another run or cannot be written.
    """
    problem = Problem(experiment, tuple(experiment.group(g).id for g in group_ids), tuple(terms))
    settings = settings or emcee_adaptor.Settings.of(problem)
    watcher = watcher or Silent()
    identity = identity_of(problem, seed, settings, n_starts)
    record = _claim(folder, identity)
    if record is None:
        write_experiment(experiment, folder / "experiment")
        watcher.stage("search")
        optimum = optimise(problem, seed=seed, n_starts=n_starts, progress=watcher.update)
        record = _record(problem, optimum, identity, seed, command)
        write_json(folder / "fit.json", record)
    limit = settings.max_steps
    if (folder / "posterior.json").exists():
        finished = load(folder)
        if finished.summary.converged:
            return finished
        limit += finished.summary.n_steps
    # From the record even when fresh: the numbers in the file are the numbers used.
    optimum = _optimum(problem, record)

    watcher.stage("sample")
    chain = emcee_adaptor.sample(
        problem,
        optimum,
        seed=seed,
        path=folder / "chain.h5",
        identity=identity,
        settings=replace(settings, max_steps=limit),
        progress=lambda s: watcher.update(
            s.steps,
            None,
            f"step {s.steps} of at most {limit}, R-hat {s.r_hat:.3f} (goal {settings.r_hat}),"
            f" {s.autocorrelation_times:.0f} autocorrelation times (goal {settings.autocorrelation_times:.0f})",
        ),
    )
    # The summary goes first and comes last: it must never describe other draws than those beside it.
    (folder / "posterior.json").unlink(missing_ok=True)
    thin = max(1, int(_THIN * chain.autocorrelation_time.min()))
    draws = store.Draws(
        problem.names, problem.to_physical(chain.draws[:, ::thin]), chain.log_posterior[:, ::thin], identity
    )
    flat = problem.to_sampling(draws.flat)
    log_likelihood = np.concatenate(
        [problem.pointwise_log_likelihood(part) for part in np.array_split(flat, math.ceil(len(flat) / 2048))]
    )
    design = problem.design
    store.write(
        folder / "posterior.nc",
        draws,
        log_likelihood.reshape(*draws.values.shape[:2], -1),
        problem.observed,
        {"frequency_hz": design.frequency, "amplitude_v": design.amplitude, "square": design.waveform},
    )

    watcher.stage("profile")
    top = flat[np.argmax(draws.log_posterior)]
    profiles = identify.profiles(problem, top, watcher.update)
    summary = _summarise(problem, chain, draws, thin, profiles, identity, settings)
    write_json(folder / "posterior.json", summary)
    return Run(folder, problem, record, summary, draws)


def load(folder: Path) -> Run:
    """Read a finished run; `InputError` where the folder is none, foreign, damaged or interrupted."""
    if not folder.is_dir():
        raise InputError("is not a run folder", "give a folder that psafit fit has written", file=folder)
    record = read_json(folder / "fit.json", Fit)
    if not (folder / "posterior.json").exists():
        raise InputError(
            "holds an interrupted run", "repeat the same psafit fit command: it goes on where it stopped", file=folder
        )
    summary = read_json(folder / "posterior.json", PosteriorSummary)
    experiment = read_experiment(folder / "experiment")
    problem = Problem(experiment, tuple(record.groups), catalogue(record.terms))
    draws = store.read(folder / "posterior.nc", problem.names)
    for name, found in (
        ("posterior.json", summary.identity),
        ("posterior.nc", draws.identity),
    ):
        if found != record.identity:
            raise InputError("belongs to another run than fit.json", "run psafit fit again", file=folder / name)
    if experiment.fingerprint != record.fingerprint:
        raise InputError("was changed after the fit", "run psafit fit again", file=folder / "experiment")
    return Run(folder, problem, record, summary, draws)


def _claim(folder: Path, identity: str) -> Fit | None:
    """The folder's fit if it is of this very run, None if it is free; anything else is refused."""
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file", "choose another --out", file=folder)
    if not (folder / "fit.json").exists():
        foreign = [p.name for p in folder.iterdir()] if folder.is_dir() else []
        if set(foreign) - {"experiment"}:
            raise InputError(
                f"already holds other files ({sorted(foreign)[0]})", "choose an empty folder with --out", file=folder
            )
        return None
    record = read_json(folder / "fit.json", Fit)
    if record.identity != identity:
        raise InputError(
            "holds another run (other data, groups, terms, seed or version)",
            "choose another --out, or remove the folder to start over",
            file=folder,
        )
    return record


def _record(problem: Problem, optimum: Optimum, identity: str, seed: int, command: Sequence[object]) -> Fit:
    return Fit(
        identity=identity,
        title=problem.experiment.title,
        source=problem.experiment.source,
        fingerprint=problem.experiment.fingerprint,
        groups=list(problem.group_ids),
        terms=[t.id for t in problem.terms],
        engine=path_of(problem.terms),
        seed=seed,
        parameters=[
            ParameterEntry(
                p.name, p.symbol, p.unit, p.description, p.bounds.lower, p.bounds.upper, p.prior.describe(), p.source
            )
            for p in problem.parameters
        ],
        n_physical=problem.n_physical,
        minima=[
            MinimumEntry(dict(zip(problem.names, m.values.tolist(), strict=True)), m.log_posterior, m.starts)
            for m in optimum.minima
        ],
        n_starts=optimum.n_starts,
        n_failed=optimum.n_failed,
        n_evaluations=optimum.n_evaluations,
        lmfit_report=optimum.report,
        versions=versions(),
        command=portable_command(command),
    )


def _optimum(problem: Problem, record: Fit) -> Optimum:
    minima = tuple(
        Minimum(np.array([m.values[n] for n in problem.names]), m.log_posterior, m.starts) for m in record.minima
    )
    covariance = np.stack([laplace_covariance(problem, problem.to_sampling(m.values)) for m in minima])
    return Optimum(minima, covariance, record.n_starts, record.n_failed, record.n_evaluations, record.lmfit_report)


def _summarise(
    problem: Problem,
    chain: emcee_adaptor.Chain,
    draws: store.Draws,
    thin: int,
    profiles: list[list[ProfilePoint]],
    identity: str,
    settings: emcee_adaptor.Settings,
) -> PosteriorSummary:
    health = store.diagnostics(draws.values)
    quantiles = np.quantile(draws.flat, [0.05, 0.5, 0.95], axis=0)
    p = np.linspace(0.0005, 0.9995, 1000)
    entries = []
    for i, parameter in enumerate(problem.parameters):
        points = profiles[i] if i < problem.n_physical else []
        prior = parameter.prior_quantile(p)
        contraction = 1 - float(np.var(problem.to_sampling(draws.flat)[:, i]) / np.var(prior))
        word = identify.verdict(points, contraction)
        lower, median, upper = (float(q) for q in quantiles[:, i])
        prior_lower, prior_upper = (float(x) for x in parameter.to_physical(parameter.prior_quantile([0.05, 0.95])))
        entries.append(
            ParameterSummary(
                name=parameter.name,
                median=median,
                lower=lower,
                upper=upper,
                prior_lower=prior_lower,
                prior_upper=prior_upper,
                contraction=contraction,
                r_hat=float(chain.r_hat[i]),
                ess_bulk=float(health["ess_bulk"][i]),
                ess_tail=float(health["ess_tail"][i]),
                autocorrelation_time=float(chain.autocorrelation_time[i]),
                verdict=word,
                text=identify.describe(parameter.name, parameter.unit, median, (lower, upper), points, word),
                profile=points,
            )
        )
    kept = chain.draws.shape[1]
    reached = kept / float(chain.autocorrelation_time.max())
    message = f"{reached:.0f} autocorrelation times, R-hat at most {chain.r_hat.max():.3f}"
    if not chain.converged:
        message = (
            f"not converged after {chain.burn_in + kept} steps ({message}; wanted"
            f" {settings.autocorrelation_times:.0f} and {settings.r_hat}): repeat the command to draw on"
        )
    return PosteriorSummary(
        identity=identity,
        converged=chain.converged,
        message=message,
        n_walkers=chain.draws.shape[0],
        n_steps=chain.burn_in + kept,
        burn_in=chain.burn_in,
        thinning=thin,
        acceptance=chain.acceptance,
        autocorrelation_times=reached,
        parameters=entries,
    )

"""From a problem to a fitted, sampled and described posterior in a run folder.

The folder holds `experiment/` (a copy of the data the run saw), `fit.json` once the search is done,
`chain.h5` (the sampler's checkpoint), and at the end `posterior.nc` and `posterior.json`. Each stage that is already
there is taken from the folder, so an interrupted run goes on where it stopped, and one whose chain gave up
before it converged draws on. A chain that finds a better minimum than the search ends; the minimum is added, and
sampling begins again. The records carry checksums: what somebody has changed is not taken for a result.
"""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import psafit
from psafit.arrays import FloatArray
from psafit.errors import InputError, check_seed
from psafit.experiment import Experiment, GroupId, write_experiment
from psafit.files import (
    digest,
    in_use,
    portable_command,
    refuse_foreign,
    remove_temporaries,
    sha256,
    sole,
    write_atomically,
)
from psafit.inference import emcee_adaptor, identify, store
from psafit.inference.candidate import built_up
from psafit.inference.forecast import COUNTED, FIT, Silent, Watcher, reporting
from psafit.inference.optimise import Minimum, Optimum, improve, laplace_covariance, optimise
from psafit.inference.problem import Problem, refuse_still
from psafit.inference.scale import read
from psafit.parameters import SHARES
from psafit.physics import plugin_versions, recorded, signatures
from psafit.physics.term import Term
from psafit.records import (
    Brief,
    Fit,
    MinimumEntry,
    ParameterEntry,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    read_json,
    write_json,
)
from psafit.simulate import simulate

# Draws kept in posterior.nc, in units of the autocorrelation time: denser adds bytes, not information.
_THIN = 0.5
# A chain this much higher than the best minimum (nats) shows that the search has missed one. Sampling begins again at
# most so many times.
_MISSED, _RESTARTS = 1.0, 5
# From so many causes on, a search from scratch ends on whatever hill is near: it is led there by smaller models.
_MANY = 3
# Minima so far (nats) below the best hold a part of the walkers.
_ALIKE = 5.0
# In a folder whose search is not done yet, with the run's identity.
MARKER = ".psafit-run"
# What posterior.json vouches for.
_SIGNED = ("fit.json", "posterior.nc")
_ANEW = "run psafit fit again with another --out"
LIBRARIES = ("numpy", "scipy", "numba", "lmfit", "emcee", "arviz", "h5py", "pandas")


@dataclass(frozen=True, repr=False)
class Run(Brief):
    """A finished run, as its folder holds it."""

    _told = ("folder", "fit", "summary")

    folder: Path
    problem: Problem
    fit: Fit
    summary: PosteriorSummary
    draws: store.Draws


def _sampler(settings: emcee_adaptor.Settings) -> dict[str, int | float]:
    """The settings that determine a chain; where it gives up, and what is stored of it, are none of them."""
    return {k: v for k, v in asdict(settings).items() if k not in ("max_steps", "stored")}


def _determinants(
    problem: Problem,
    seed: int,
    n_starts: int,
    sampler: Mapping[str, float],
    known: list[dict[str, float]],
    version: str = psafit.__version__,
) -> dict[str, Any]:
    """Everything that determines a run's result, each under the word a user knows it by."""
    return {
        "data": problem.experiment.fingerprint,
        "groups": [str(g) for g in problem.group_ids],
        "terms": [t.signature for t in problem.terms],
        "priors": [p.signature for p in problem.parameters],
        "seed": seed,
        "starts": n_starts,
        "sampler settings": dict(sampler),
        "version": version,
        "known places": known,
    }


def _recorded(record: Fit) -> dict[str, Any]:
    """The same, as a record holds it."""
    return {
        "data": record.fingerprint,
        "groups": [str(g) for g in record.groups],
        "terms": signatures(record.terms, record.versions),
        "priors": [[e.name, e.prior, e.lower, e.upper] for e in record.parameters],
        "seed": record.seed,
        "starts": record.n_starts,
        "sampler settings": record.sampler,
        "version": record.versions.get("psafit"),
        "known places": record.known,
    }


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    return ", ".join(word for word in one if one[word] != other[word])


def _identity(determinants: Mapping[str, Any]) -> str:
    # A run that was given no places is what it was before there were any.
    return digest({word: value for word, value in determinants.items() if word != "known places" or value})


def versions() -> dict[str, str]:
    """Versions of psafit, Python, the libraries and the plugins that shape a result."""
    found = {"psafit": psafit.__version__, "python": platform.python_version()}
    return found | {name: importlib.metadata.version(name) for name in LIBRARIES} | plugin_versions()


def fit(
    experiment: Experiment,
    group_ids: Sequence[GroupId],
    folder: Path,
    *,
    terms: Sequence[Term] = (),
    seed: int = 1,
    n_starts: int = 32,
    known: Sequence[Mapping[str, float]] = (),
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
    known : sequence of dict
        Values of all parameters at which it begins, too.
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
        If a group is unknown, every reading is zero, or the folder belongs to another run or cannot be written.
    """
    check_seed(seed)
    if n_starts < 1:
        raise InputError(f"{n_starts} starts are none", "give a number from 1 on")
    problem = Problem(experiment, tuple(experiment.group(g).id for g in group_ids), tuple(terms))
    refuse_still(experiment.select(group_ids))
    places = _places(problem, known)
    settings = settings or emcee_adaptor.Settings.of(problem)
    watcher = watcher or Silent()
    determinants = _determinants(problem, seed, n_starts, _sampler(settings), places)
    with sole(folder):
        record = _claim(folder, determinants)
        with reporting(watcher, folder, "fit", _identity(determinants), FIT, COUNTED) as watcher:
            return _fitted(problem, folder, record, determinants, seed, n_starts, places, settings, watcher, command)


def _places(problem: Problem, known: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Places as a record keeps them: a number for every parameter, in their order."""
    found = []
    for at in known:
        if set(at) != set(problem.names):
            wrong = ", ".join(sorted(set(at) ^ set(problem.names)))
            raise InputError(f"a known place lacks or does not know {wrong}", f"give {', '.join(problem.names)}")
        place = {name: float(at[name]) for name in problem.names}
        with np.errstate(invalid="ignore", divide="ignore"):
            usable = ~np.isnan(problem.to_sampling(np.array(list(place.values()))))
        for (name, value), good in zip(place.items(), usable, strict=True):
            if not (good and math.isfinite(value)):
                raise InputError(f"a known place has {name} = {value:g}", "give a value that it can have")
        found.append(place)
    return found


def _fitted(
    problem: Problem,
    folder: Path,
    record: Fit | None,
    determinants: Mapping[str, Any],
    seed: int,
    n_starts: int,
    known: list[dict[str, float]],
    settings: emcee_adaptor.Settings,
    watcher: Watcher,
    command: Sequence[object],
) -> Run:
    """What `fit` does once it knows what it is asked for."""
    identity = _identity(determinants)
    if record is None:
        write_experiment(problem.experiment, folder / "experiment")
        watcher.stage("search")
        places = problem.to_sampling(np.array([list(at.values()) for at in known])) if known else None
        if not known and len(problem.terms) >= _MANY:
            places = built_up(
                problem, seed=seed, progress=lambda k, n: watcher.update(k, n, "models with fewer causes")
            ).modes
        optimum = optimise(
            problem,
            seed=seed,
            n_starts=n_starts,
            known=places,
            progress=lambda k, n: watcher.update(k, n, "iterations of climbs"),
        )
        record = _record(problem, optimum, identity, seed, settings, command, known)
        write_json(folder / "fit.json", record, sealed=True)
    (folder / MARKER).unlink(missing_ok=True)
    limit = settings.max_steps
    if (folder / "posterior.json").exists():
        finished = load(folder)
        if finished.summary.converged:
            return finished
        limit += finished.summary.n_steps

    while True:
        # From the record even when fresh: the numbers in the file are the numbers used.
        optimum = _optimum(problem, record)
        ceiling = optimum.best.log_posterior + _MISSED if record.n_missed < _RESTARTS else math.inf
        watcher.stage("sample")
        chain = emcee_adaptor.sample(
            problem,
            optimum,
            seed=seed,
            path=folder / "chain.h5",
            identity=identity,
            settings=replace(settings, max_steps=limit),
            progress=_teller(watcher, settings, limit),
            ceiling=ceiling,
        )
        # The summary goes first and comes last: it must never describe other draws than those beside it.
        (folder / "posterior.json").unlink(missing_ok=True)
        if chain.height <= ceiling:
            break
        watcher.stage("climb")
        optimum = improve(problem, optimum, chain.highest)
        # The record comes last: killed before, the same chain is drawn again and finds the same.
        (folder / "chain.h5").unlink()
        record = replace(
            record,
            minima=_entries(problem, optimum),
            n_evaluations=optimum.n_evaluations,
            n_missed=record.n_missed + 1,
            lmfit_report=optimum.report,
        )
        write_json(folder / "fit.json", record, sealed=True)
        limit = settings.max_steps
    thin = max(1, int(_THIN * chain.autocorrelation_time.min()))
    draws = store.Draws(
        problem.names, problem.to_physical(chain.draws[:, ::thin]), chain.log_posterior[:, ::thin], identity
    )
    flat = problem.to_sampling(draws.flat)
    n_walkers, n_kept = draws.values.shape[:2]
    every = math.ceil(len(flat) * problem.observed.size / settings.stored)
    rows = flat.reshape(n_walkers, n_kept, -1)[:, ::every].reshape(-1, problem.n_dim)
    log_likelihood = np.concatenate(
        [
            problem.pointwise_log_likelihood(part).astype(np.float32)
            for part in np.array_split(rows, math.ceil(len(rows) / 2048))
        ]
    )
    design = problem.design
    store.write(
        folder / "posterior.nc",
        draws,
        log_likelihood.reshape(n_walkers, -1, problem.observed.size),
        problem.observed,
        {"frequency_hz": design.frequency, "amplitude_v": design.amplitude, "square": design.waveform},
    )

    watcher.stage("profile")
    top = flat[np.argmax(draws.log_posterior)]
    profiles = identify.profiles(problem, top, lambda k, n: watcher.update(k, n, "profiles"))
    files = {name: sha256(folder / name) for name in _SIGNED}
    summary = _summarise(problem, chain, draws, thin, profiles, record, settings, files)
    write_json(folder / "posterior.json", summary, sealed=True)
    return Run(folder, problem, record, summary, draws)


def load(folder: Path) -> Run:
    """Read a finished run; `InputError` where the folder is none, foreign, damaged or interrupted."""
    if not folder.is_dir():
        raise InputError("is not a run folder", "give a folder that psafit fit has written", file=folder)
    if not (folder / "fit.json").exists() and (folder / "diagnosis.json").exists():
        remedy = "read it with psafit.load_diagnosis, or give a folder that psafit fit has written"
        raise InputError("holds a diagnosis, not a fit", remedy, file=folder)
    record = read_json(folder / "fit.json", Fit, sealed=True)
    if not (folder / "posterior.json").exists():
        if in_use(folder):
            raise InputError("holds a run under way", "psafit watch shows how far it is; wait for its end", file=folder)
        raise InputError(
            "holds an interrupted run", "repeat the command that began it: it goes on where it stopped", file=folder
        )
    summary = read_json(folder / "posterior.json", PosteriorSummary, sealed=True, remedy=store.REBUILD)
    if summary.identity != record.identity:
        raise InputError("belongs to another run than fit.json", store.REBUILD, file=folder / "posterior.json")
    for name in _SIGNED:
        if not (folder / name).exists():
            raise InputError("is missing", store.REBUILD, file=folder / name)
        if sha256(folder / name) != summary.files.get(name):
            if name == "posterior.nc":  # who holds it open for writing has marked it so: then that is said
                store.read(folder / name, tuple(p.name for p in record.parameters))
            raise InputError("was changed after the fit", store.REBUILD, file=folder / name)
    experiment = read(folder / "experiment")
    chosen = recorded(record.terms, record.versions, folder / "fit.json")
    problem = Problem(experiment, tuple(record.groups), chosen)
    found = _recorded(record)
    expected = _determinants(problem, record.seed, record.n_starts, record.sampler, record.known, found["version"])
    if differing := _differing(expected, found):
        if "data" in differing:
            kept = "put the files back that were fitted, or give another --out"
            raise InputError("was changed after the fit", kept, file=folder / "experiment")
        raise InputError(f"is of another version of psafit ({differing} differ)", _ANEW, file=folder / "fit.json")
    if _identity(found) != record.identity or [p.name for p in summary.parameters] != list(problem.names):
        raise InputError("contradicts itself", _ANEW, file=folder / "fit.json")
    return Run(folder, problem, record, summary, store.read(folder / "posterior.nc", problem.names))


def _claim(folder: Path, determinants: Mapping[str, Any]) -> Fit | None:
    """The folder's fit if it is of this very run, None if it is free and now ours; anything else is refused."""
    identity, marker = _identity(determinants), folder / MARKER
    another = "choose another --out, or move the folder elsewhere to start over"
    record = None
    if (folder / "fit.json").exists():
        record = read_json(folder / "fit.json", Fit, sealed=True)
        if record.identity != identity:
            differing = _differing(determinants, _recorded(record)) or "something"
            raise InputError(f"holds another run (what differs: {differing})", another, file=folder)
    elif marker.exists():
        if marker.read_bytes() != identity.encode():
            raise InputError("holds another run, interrupted in its search", another, file=folder)
    else:
        refuse_foreign(folder)
        write_atomically(marker, identity.encode())
    for part in (folder, folder / "experiment"):
        if part.is_dir():
            remove_temporaries(part)
    return record


def _entries(problem: Problem, optimum: Optimum) -> list[MinimumEntry]:
    return [
        MinimumEntry(dict(zip(problem.names, m.values.tolist(), strict=True)), m.log_posterior, m.starts)
        for m in optimum.minima
    ]


def _engine(problem: Problem, optimum: Optimum) -> str:
    """Path that the simulator takes at the minima."""
    u = problem.to_sampling(np.array([m.values for m in optimum.minima]))
    return simulate(problem.design, problem.theta(u, problem.group_ids), problem.terms).engine


def _teller(watcher: Watcher, settings: emcee_adaptor.Settings, limit: int) -> Callable[[emcee_adaptor.Progress], None]:
    return lambda s: watcher.update(
        s.steps,
        min(s.steps + s.steps_left, limit),
        f"steps (at most {limit}), R-hat {s.r_hat:.5f} (goal: below {settings.r_hat}),"
        f" {s.autocorrelation_times:.0f} autocorrelation times (goal {settings.autocorrelation_times:.0f})",
    )


def _record(
    problem: Problem,
    optimum: Optimum,
    identity: str,
    seed: int,
    settings: emcee_adaptor.Settings,
    command: Sequence[object],
    known: list[dict[str, float]],
) -> Fit:
    return Fit(
        identity=identity,
        title=problem.experiment.title,
        source=problem.experiment.source,
        fingerprint=problem.experiment.fingerprint,
        groups=list(problem.group_ids),
        terms=[t.id for t in problem.terms],
        engine=_engine(problem, optimum),
        seed=seed,
        parameters=[
            ParameterEntry(
                p.name, p.symbol, p.unit, p.description, p.bounds.lower, p.bounds.upper, p.prior.describe(), p.source
            )
            for p in problem.parameters
        ],
        n_physical=problem.n_physical,
        minima=_entries(problem, optimum),
        n_starts=optimum.n_starts,
        n_failed=optimum.n_failed,
        n_evaluations=optimum.n_evaluations,
        n_missed=0,
        sampler=_sampler(settings),
        lmfit_report=optimum.report,
        versions=versions(),
        command=portable_command(command),
        known=known,
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
    record: Fit,
    settings: emcee_adaptor.Settings,
    files: dict[str, str],
) -> PosteriorSummary:
    health = store.diagnostics(draws.values)
    quantiles = np.quantile(draws.flat, [0.05, 0.5, 0.95], axis=0)
    sampled = problem.to_sampling(draws.flat)
    entries = []
    for i, parameter in enumerate(problem.parameters):
        points = profiles[i] if i < problem.n_physical else []
        prior = parameter.prior_quantile(SHARES)
        contraction = 1 - float(np.var(sampled[:, i]) / np.var(prior))
        lower, median, upper = (float(q) for q in quantiles[:, i])
        word = identify.verdict(points) if points else identify.verdict_of_draws(sampled[:, i], parameter, contraction)
        if word == "not determined" and not points and parameter.is_implausible(median):
            word = "determined"  # readings drove it where its prior is not
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
                implausible=parameter.is_implausible(median),
            )
        )
    kept = chain.draws.shape[1]
    reached = kept / float(chain.autocorrelation_time.max())
    # Rounded so that what misses its goal is never told as meeting it.
    mixed = store.told_r_hat(float(chain.r_hat.max()), settings.r_hat)
    message = f"{math.floor(reached)} autocorrelation times, R-hat at most {mixed}"
    if not chain.converged:
        message = (
            f"not converged after {chain.burn_in + kept} steps ({message}; wanted"
            f" {settings.autocorrelation_times:.0f} and {settings.r_hat}): repeat the command to draw on"
        )
        message += _apart(problem.names, [m.log_posterior for m in record.minima], chain.r_hat, settings.r_hat)
    return PosteriorSummary(
        identity=record.identity,
        converged=chain.converged,
        message=message,
        n_walkers=chain.draws.shape[0],
        n_steps=chain.burn_in + kept,
        burn_in=chain.burn_in,
        thinning=thin,
        acceptance=chain.acceptance,
        autocorrelation_times=reached,
        parameters=entries,
        files=files,
    )


def _apart(names: Sequence[str], heights: Sequence[float], r_hat: FloatArray, goal: float) -> str:
    """What keeps walkers apart, where the search ended in several places that are about as high."""
    alike = sum(height > max(heights) - _ALIKE for height in heights)
    if alike < 2 or r_hat.max() < goal:
        return ""
    return (
        f". {names[int(r_hat.argmax())]} mixes least: the search ended in {alike} places within {_ALIKE:g} nats,"
        " between which walkers rarely cross; psafit diagnose weighs such places one by one"
    )

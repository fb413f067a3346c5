"""From a problem to a fitted, sampled and described posterior in a run folder.

The folder holds `experiment/` (a copy of the data the run saw), `fit.json` once the search is done, `importance/`
(draws by importance sampling), `chain.h5` (the sampler's checkpoint), and at the end `posterior.nc` and
`posterior.json`. Each stage that is already there is taken from the folder, so an interrupted run goes on where it
stopped, and one whose sampler gave up before it converged draws on. Draws that find a better mode than the search end;
the mode is added, and sampling begins again. The records carry checksums: what somebody has changed is not taken for a
result.
"""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

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
from psafit.inference import identify, noise, store
from psafit.inference.candidate import Candidate, built_up, candidate_at, principal
from psafit.inference.evidence import ImportanceSample, importance_sample
from psafit.inference.forecast import COUNTED, FIT, Silent, Watcher, reporting
from psafit.inference.memory import Memory
from psafit.inference.optimise import polish, report
from psafit.inference.problem import Problem, refuse_still
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.sampling import Chain, Progress, SamplerSettings, Target
from psafit.inference.scale import read
from psafit.parameters import SHARES
from psafit.physics import plugin_versions, recorded, signatures
from psafit.physics.term import Term
from psafit.records import (
    Brief,
    Fit,
    ImportanceEntry,
    ImportanceSummary,
    MinimumEntry,
    ParameterEntry,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    read_json,
    write_json,
)
from psafit.simulate import simulate

# In a folder whose search is not done yet, with the run's identity.
MARKER = ".psafit-run"
# What posterior.json vouches for.
_SIGNED = ("fit.json", "posterior.nc")
_ANEW = "run psafit fit again with another --out"
LIBRARIES = ("numpy", "scipy", "numba", "lmfit", "arviz", "h5py", "pandas")


@dataclass(frozen=True, repr=False)
class Run(Brief):
    """A finished run, as its folder holds it."""

    _in_repr = ("folder", "fit", "summary")

    folder: Path
    problem: Problem
    fit: Fit
    summary: PosteriorSummary
    draws: store.Draws


def _determinants(
    problem: Problem,
    seed: int,
    n_starts: int,
    sampled_by: str,
    settings: Mapping[str, float],
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
        "sampler": sampled_by,
        "sampler settings": dict(settings),
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
        "sampler": record.sampled_by,
        "sampler settings": record.sampler,
        "version": record.versions.get("psafit"),
        "known places": record.known,
    }


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    return ", ".join(word for word in one if one[word] != other[word])


def _identity(determinants: Mapping[str, Any]) -> str:
    # A run that was given no places is what it was before there were any.
    return digest({word: value for word, value in determinants.items() if word != "known places" or value})


def versions(sampled_by: str = USUAL) -> dict[str, str]:
    """Versions of psafit, Python, the libraries (of a sampler, too) and the plugins that shape a result."""
    found = {"psafit": psafit.__version__, "python": platform.python_version()}
    return (
        found
        | {name: importlib.metadata.version(name) for name in (*LIBRARIES, *sampler(sampled_by).libraries)}
        | plugin_versions()
    )


def fit(
    experiment: Experiment,
    group_ids: Sequence[GroupId],
    folder: Path,
    *,
    terms: Sequence[Term] = (),
    seed: int = 1,
    n_starts: int = 32,
    known: Sequence[Mapping[str, float]] = (),
    sampled_by: str = USUAL,
    settings: SamplerSettings | Mapping[str, float] | None = None,
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
        Starts of the search: half of them for each of two fits that share nothing, one more where they are odd.
    known : sequence of dict
        Values of all parameters at which it begins, too.
    sampled_by : str
        Name of the sampler; see `psafit.inference.samplers`.
    settings : SamplerSettings or dict, optional
        Of that sampler; some of its options by name, or all of them. Its own for the problem by default.
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
    n_starts += n_starts % 2
    if isinstance(settings, SamplerSettings):
        chosen = settings
    else:
        chosen = sampler(sampled_by).settings(problem).with_options(settings or {})
    watcher = watcher or Silent()
    determinants = _determinants(problem, seed, n_starts, sampled_by, chosen.determinants, places)
    with sole(folder):
        record = _claim(folder, determinants)
        with reporting(watcher, folder, "fit", _identity(determinants), FIT, COUNTED) as watcher:
            asked = _Asked(problem, _identity(determinants), seed, n_starts, places, sampled_by, chosen, command)
            return _Work(folder, asked, watcher).run(record)


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


@dataclass(frozen=True)
class _Asked:
    """All that a run is asked for."""

    problem: Problem
    identity: str
    seed: int
    n_starts: int
    known: list[dict[str, float]]
    sampled_by: str
    settings: SamplerSettings
    command: Sequence[object]


@dataclass(frozen=True)
class _Work:
    """One run: what its stages share, and the stages."""

    folder: Path
    asked: _Asked
    watcher: Watcher

    def run(self, record: Fit | None) -> Run:
        """Every stage that is not in the folder yet."""
        folder, settings = self.folder, self.asked.settings
        if record is None:
            write_experiment(self.asked.problem.experiment, folder / "experiment")
            record = self._search()
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
            found = _found(self.asked.problem, record)
            more = record.n_missed < settings.restarts
            ceiling = record.minima[0].log_posterior + settings.missed if more else math.inf
            importance = self._importance_sample(found)
            chain = self._drawn(found, importance, limit, ceiling)
            # The summary goes first and comes last: it must never describe other draws than those next to it.
            (folder / "posterior.json").unlink(missing_ok=True)
            if chain.highest_log_posterior <= ceiling:
                break
            record = self._improved(record, found, chain)
            limit = settings.max_steps
        return self._described(record, importance, chain)

    def _search(self) -> Fit:
        """Look for modes, and let lmfit polish them."""
        asked, problem = self.asked, self.asked.problem
        self.watcher.stage("search")
        if asked.known:
            places = problem.to_sampling(np.array([list(at.values()) for at in asked.known]))
            known = [candidate_at(problem, np.clip(places, *problem.bounds.T))]
        elif problem.terms:
            # From scratch, a search among causes that hold each other in place ends on whatever mode is near.
            known = [
                built_up(
                    problem,
                    seed=asked.seed,
                    progress=lambda k, n: self.watcher.update(k, n, "models with fewer causes"),
                )
            ]
        else:
            known = []
        how = SampleSettings.of(asked.n_starts)
        found, _ = sample(problem, known, seed=asked.seed, settings=how, progress=self.watcher.update)
        tops, evaluations = [], 0
        for k, mode in enumerate(found.modes):
            self.watcher.update(k, len(found.modes), "modes polished")
            top, log_posterior, result = polish(problem, mode)
            tops.append((log_posterior if math.isfinite(log_posterior) else -math.inf, k, top, result))
            evaluations += int(result.nfev) * (1 + 2 * problem.n_dim)
        polished = candidate_at(problem, np.array([top for _, _, top, _ in tops]), found.starts)
        _, _, top, result = max(tops, key=lambda polish: (polish[0], -polish[1]))
        return Fit(
            identity=asked.identity,
            title=problem.experiment.title,
            source=problem.experiment.source,
            fingerprint=problem.experiment.fingerprint,
            groups=list(problem.group_ids),
            terms=[t.id for t in problem.terms],
            engine=simulate(problem.design, problem.theta(polished.modes, problem.group_ids), problem.terms).engine,
            seed=asked.seed,
            parameters=[
                ParameterEntry(
                    p.name, p.symbol, p.unit, p.description, p.bounds.lower, p.bounds.upper, p.prior.describe(),
                    p.source,
                )
                for p in problem.parameters
            ],
            n_physical=problem.n_physical,
            minima=_entries(polished),
            n_starts=asked.n_starts,
            n_followed=found.effort.begun,
            n_failed=found.effort.failed,
            n_evaluations=found.effort.n_sets + evaluations,
            n_missed=0,
            sampled_by=asked.sampled_by,
            sampler=asked.settings.determinants,
            lmfit_report=report(result, top, polished.covariance[0]),
            versions=versions(asked.sampled_by),
            command=portable_command(asked.command),
            known=asked.known,
        )  # fmt: skip

    def _importance_sample(self, found: Candidate) -> ImportanceSample:
        """Draws by importance sampling, kept in the folder."""

        def make() -> dict[str, FloatArray]:
            return {
                name: np.asarray(a, float) for name, a in vars(importance_sample(found, seed=self.asked.seed)).items()
            }

        self.watcher.stage("weigh")
        about = [self.asked.seed, found.modes.tolist()]
        kept = Memory(self.folder / "importance").recall("draws", found.problem, about, make)
        values: dict[str, Any] = {name: a if a.ndim else float(a) for name, a in kept.items()}
        return ImportanceSample(**values)

    def _drawn(self, found: Candidate, importance: ImportanceSample, limit: int, ceiling: float) -> Chain:
        """Draws of the posterior by the sampler."""
        asked = self.asked
        self.watcher.stage("sample")
        target = Target(found, importance, asked.seed, self.folder / "chain.h5", asked.identity, ceiling)
        settings = replace(asked.settings, max_steps=limit)
        return sampler(asked.sampled_by).draw(target, settings, _reporter(self.watcher, limit))

    def _improved(self, record: Fit, found: Candidate, chain: Chain) -> Fit:
        """Add the mode that the search has missed, and begin the chain anew."""
        problem = self.asked.problem
        self.watcher.stage("climb")
        top, log_posterior, result = polish(problem, chain.highest)
        if not log_posterior > chain.highest_log_posterior:
            top = chain.highest
        better = principal(
            candidate_at(problem, np.vstack([top[None], found.modes]), np.concatenate([[0], found.starts]))
        )
        # The record comes last: killed before, the same chain is drawn again and finds the same.
        (self.folder / "chain.h5").unlink(missing_ok=True)
        record = replace(
            record,
            minima=_entries(better),
            n_evaluations=record.n_evaluations + int(result.nfev) * (1 + 2 * problem.n_dim),
            n_missed=record.n_missed + 1,
            lmfit_report=report(result, top, better.covariance[0]),
        )
        write_json(self.folder / "fit.json", record, sealed=True)
        return record

    def _described(self, record: Fit, importance: ImportanceSample, chain: Chain) -> Run:
        """Keep the draws, walk the profiles, and say what the data determine."""
        folder, problem, settings = self.folder, self.asked.problem, self.asked.settings
        thin = max(1, int(settings.thin * chain.autocorrelation_time.min()))
        draws = store.Draws(
            problem.names,
            problem.to_physical(chain.draws[:, ::thin]),
            chain.log_posterior[:, ::thin],
            self.asked.identity,
        )
        _keep(folder / "posterior.nc", problem, draws, settings.stored, record.seed)
        self.watcher.stage("profile")
        flat = problem.to_sampling(draws.flat)
        top = flat[np.argmax(draws.log_posterior)]
        profiles = identify.profiles(problem, top, lambda k, n: self.watcher.update(k, n, "profiles"))
        files = {name: sha256(folder / name) for name in _SIGNED}
        summary = _summarise(problem, chain, draws, importance, thin, profiles, record, files)
        write_json(folder / "posterior.json", summary, sealed=True)
        return Run(folder, problem, record, summary, draws)


def _keep(path: Path, problem: Problem, draws: store.Draws, stored: int, seed: int) -> None:
    """Write `posterior.nc`: with readings and their log likelihood from some of the draws, and as many prior draws."""
    rng = np.random.default_rng([seed, 37])
    n_chains, n_kept = draws.values.shape[:2]
    flat = problem.to_sampling(draws.flat)
    every = math.ceil(len(flat) * problem.observed.size / stored)
    rows = flat.reshape(n_chains, n_kept, -1)[:, ::every].reshape(-1, problem.n_dim)
    likelihood, readings = [], []
    for part in np.array_split(rows, math.ceil(len(rows) / 2048)):
        ranges, scatter, known = problem.predict(part), problem.noise_values(part), problem.known_sigma
        likelihood.append(noise.log_density(problem.observed, ranges, scatter, known).astype(np.float32))
        # An instrument does not show ranges below zero.
        readings.append(np.maximum(noise.draw(ranges, scatter, known, rng), problem.floor).astype(np.float32))
    shape = n_chains, -1, problem.observed.size
    density = np.stack([p.log_prior(flat[:, i]) for i, p in enumerate(problem.parameters)], axis=-1)
    design = problem.design
    store.write(
        path,
        draws,
        np.concatenate(likelihood).reshape(shape),
        np.concatenate(readings).reshape(shape),
        problem.to_physical(problem.prior_transform(rng.random((n_kept, problem.n_dim)))),
        density.reshape(draws.values.shape),
        problem.observed,
        {o.column: rows for o, rows in zip(problem.observables, problem.rows_of_scatter, strict=True)},
        {"frequency_hz": design.frequency, "amplitude_v": design.amplitude, "waveform": design.waveform}
        | ({"time_us": design.time * 1e6} if design.traced.any() else {}),
    )


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
    expected = _determinants(
        problem, record.seed, record.n_starts, record.sampled_by, record.sampler, record.known, found["version"]
    )
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


def _entries(found: Candidate) -> list[MinimumEntry]:
    problem = found.problem
    return [
        MinimumEntry(dict(zip(problem.names, values.tolist(), strict=True)), float(log_posterior), int(starts))
        for values, log_posterior, starts in zip(
            problem.to_physical(found.modes), found.log_posteriors, found.starts, strict=True
        )
    ]


def _found(problem: Problem, record: Fit) -> Candidate:
    """The modes as a record keeps them."""
    values = np.array([[m.values[name] for name in problem.names] for m in record.minima])
    return candidate_at(problem, problem.to_sampling(values), np.array([m.starts for m in record.minima]))


def _reporter(watcher: Watcher, limit: int) -> Callable[[Progress], None]:
    def show(s: Progress) -> None:
        words = [f"steps (at most {limit})"]
        if s.r_hat is not None:
            words.append(f"R-hat {s.r_hat:.5f} (goal: below {s.wanted_r_hat})")
        if s.autocorrelation_times is not None:
            words.append(f"{s.autocorrelation_times:.0f} autocorrelation times (goal {s.wanted_times:.0f})")
        watcher.update(s.steps, min(s.steps + s.steps_left, limit), ", ".join(words))

    return show


def _summarise(
    problem: Problem,
    chain: Chain,
    draws: store.Draws,
    importance: ImportanceSample,
    thin: int,
    profiles: list[list[ProfilePoint]],
    record: Fit,
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
    goal = record.sampler.get("r_hat", math.inf)
    # Rounded so that what misses its goal is never printed as meeting it.
    mixed = store.rounded_r_hat(float(chain.r_hat.max()), goal)
    message = f"{math.floor(reached)} autocorrelation times, R-hat at most {mixed}"
    if not chain.converged:
        wanted = "".join(
            f"; {words} {record.sampler[name]:g} wanted"
            for name, words in (("autocorrelation_times", "of the first"), ("r_hat", "R-hat"))
            if name in record.sampler
        )
        message = f"not converged after {chain.burn_in + kept} steps ({message}{wanted}): repeat the command to draw on"
        message += _apart(problem.names, [m.log_posterior for m in record.minima], chain.r_hat, goal)
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
        importance=_compared(problem, sampled, importance, float(min(health["ess_tail"]))),
        files=files,
    )


def _compared(
    problem: Problem, sampled: FloatArray, importance: ImportanceSample, effective: float
) -> ImportanceSummary:
    """Importance draws next to those of the sampler, (n, n_dim) in the sampling coordinate.

    `effective` is what the latter are worth.
    """
    q = [0.05, 0.5, 0.95]
    own, other = np.quantile(sampled, q, axis=0), importance.quantiles(importance.draws, q)
    width = np.maximum(own[2] - own[0], 1e-12)
    apart = (np.abs(other - own) / width).max(axis=0)
    # Standard error of a limit of a normal distribution, in widths of its interval, times the root of the draws.
    one = math.sqrt(q[0] * q[2]) / norm.pdf(norm.ppf(q[0])) / (norm.ppf(q[2]) - norm.ppf(q[0]))
    values = problem.to_physical(other)
    return ImportanceSummary(
        log_evidence=importance.log_evidence,
        standard_error=importance.standard_error,
        effective=importance.effective,
        pareto_k=importance.pareto_k,
        by_chance=2 * float(one) * math.hypot(importance.effective**-0.5, effective**-0.5),
        parameters=[
            ImportanceEntry(name, float(values[1, k]), float(values[0, k]), float(values[2, k]), float(apart[k]))
            for k, name in enumerate(problem.names)
        ],
    )


def _apart(
    names: Sequence[str], log_posteriors: Sequence[float], r_hat: FloatArray, goal: float, near: float = 5.0
) -> str:
    """What keeps walkers apart, where the search ended in several places within so many nats of the best."""
    near_top = sum(log_posterior > max(log_posteriors) - near for log_posterior in log_posteriors)
    if near_top < 2 or r_hat.max() < goal:
        return ""
    return (
        f". {names[int(r_hat.argmax())]} mixes least: the search ended in {near_top} places within {near:g} nats,"
        " between which walkers rarely cross; psafit diagnose weighs such places one by one"
    )

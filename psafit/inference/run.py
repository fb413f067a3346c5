"""From a problem to a fitted, sampled and described posterior in a run folder.

Each stage that is already in the folder is taken from there, so an interrupted run goes on where it stopped, and one
whose sampler gave up before it converged draws on. Draws that find a better mode than the search end; the mode is
added, and sampling begins again. What a folder holds: see `psafit.inference.run_folder`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError, check_seed
from psafit.experiment import Experiment, GroupId, write_experiment
from psafit.files import locked, portable_command, sha256
from psafit.forecast import COUNTED, FIT, Silent, Watcher, reporting
from psafit.inference import identify, store
from psafit.inference.candidate import Candidate, built_up, candidate_at, principal
from psafit.inference.evidence import ImportanceSample, importance_sample
from psafit.inference.memory import Memory
from psafit.inference.polish import polish, report
from psafit.inference.problem import Problem, refuse_still
from psafit.inference.run_folder import (
    MARKER,
    SIGNED,
    Run,
    claim,
    determinants_of,
    identity_of,
    keep_posterior,
    load,
    modes_of,
    versions,
)
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.sampling import Chain, Progress, SamplerSettings, Target
from psafit.inference.summary import summarise
from psafit.physics.term import Term
from psafit.records import Fit, MinimumEntry, ParameterEntry, write_json
from psafit.simulate import simulate


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
        Starts of the search: half of them for each of the first two looks, one more where they are odd.
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
    determinants = determinants_of(problem, seed, n_starts, sampled_by, chosen.determinants, places)
    with locked(folder):
        record = claim(folder, determinants)
        with reporting(watcher, folder, "fit", identity_of(determinants), FIT, COUNTED) as watcher:
            asked = _Asked(problem, identity_of(determinants), seed, n_starts, places, sampled_by, chosen, command)
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
            found = modes_of(self.asked.problem, record)
            more = record.n_missed < settings.restarts
            ceiling = record.minima[0].log_posterior + settings.missed if more else math.inf
            importance = self._importance_sample(found)
            chain = self._drawn(found, importance, limit, ceiling)
            # The summary goes first and comes last: it must never describe other draws than those of its folder.
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
            engine=simulate(problem.design, problem.theta(polished.modes, problem.occasions), problem.terms).engine,
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
        keep_posterior(folder / "posterior.nc", problem, draws, settings.stored, record.seed)
        self.watcher.stage("profile")
        flat = problem.to_sampling(draws.flat)
        top = flat[np.argmax(draws.log_posterior)]
        profiles = identify.profiles(problem, top, lambda k, n: self.watcher.update(k, n, "profiles"))
        self.watcher.update(0, None, "draws summarised")
        files = {name: sha256(folder / name) for name in SIGNED}
        summary = summarise(problem, chain, draws, importance, thin, profiles, record, files)
        write_json(folder / "posterior.json", summary, sealed=True)
        return Run(folder, problem, record, summary, draws)


def _entries(found: Candidate) -> list[MinimumEntry]:
    problem = found.problem
    return [
        MinimumEntry(dict(zip(problem.names, values.tolist(), strict=True)), float(log_posterior), int(starts))
        for values, log_posterior, starts in zip(
            problem.to_physical(found.modes), found.log_posteriors, found.starts, strict=True
        )
    ]


def _reporter(watcher: Watcher, limit: int) -> Callable[[Progress], None]:
    def show(s: Progress) -> None:
        words = [f"steps (at most {limit})"]
        if s.r_hat is not None:
            words.append(f"R-hat {s.r_hat:.5f} (goal: below {s.wanted_r_hat})")
        if s.autocorrelation_times is not None:
            words.append(f"{s.autocorrelation_times:.0f} autocorrelation times (goal {s.wanted_times:.0f})")
        watcher.update(s.steps, min(s.steps + s.steps_left, limit), ", ".join(words))

    return show

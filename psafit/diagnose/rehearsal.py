"""Readings are drawn from each of some tied models in turn, and all of these models judged by them.

*Repeated*: the whole experiment is measured again, in simulation, and nothing kept of what was measured. If the model
that made the readings does not come out ahead, this design cannot separate them, however often it is measured.

*Rehearsed*: what was measured stays as it is. To it come readings that a draw from the posterior of one model makes
of a proposed sweep; then every tied model is fitted to the whole, and the probabilities among them are computed as
the diagnosis does. A proposal that works leaves the model that made the readings ahead of the others, whichever it was.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from psafit.arrays import FloatArray
from psafit.diagnose.next_experiment import Proposal, Rehearsal, planned
from psafit.experiment import Group, Occasions, read_as
from psafit.inference import noise
from psafit.inference.candidate import Candidate, FitSettings, candidate_of
from psafit.inference.evidence import ImportanceSample
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.simulate import Design, readings

NEW = "the proposed sweep"


@dataclass(frozen=True)
class RehearsalSettings:
    """How often experiments are simulated, and how models are fitted to them.

    Parameters
    ----------
    trials : int
        Simulated experiments for each model that may be the truth.
    starts : int
        Starts of a fit from posterior draws, in addition to the optima.
    schedule : tuple of (int, int)
        Iterations of the fit, and how many of the highest go on after them.
    """

    trials: int = 3
    starts: int = 12
    schedule: tuple[tuple[int, int], ...] = ((6, 12), (24, 3))


Tied = Sequence[tuple[Candidate, ImportanceSample]]
# Measures, with one model as the truth: says which readings any model is then fitted to.
_Measure = Callable[[Candidate, ImportanceSample, np.random.Generator], Callable[[Problem], Problem]]


def repeat(
    tied: Tied,
    log_prior: Sequence[float],
    *,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Rehearsal:
    """Measure the same conditions again in simulation, with each of some models as the truth; see `rehearse`."""

    def measure(truth: Candidate, draws: ImportanceSample, rng: np.random.Generator) -> Callable[[Problem], Problem]:
        problem, u = truth.problem, _drawn(draws, 1, rng)
        made = noise.draw(problem.predict(u), problem.noise_values(u), problem.known_sigma, rng)[0]
        again = problem.experiment.with_readings(np.maximum(made, problem.floor))
        return lambda model: replace(model, experiment=again)

    return _judged("the same conditions again", tied, log_prior, softmax(log_prior), measure, [seed, 31], progress)


def rehearse(
    tied: Tied,
    log_prior: Sequence[float],
    proposal: Proposal,
    *,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Rehearsal:
    """Measure a proposed sweep in simulation, with each of some models as the truth.

    Parameters
    ----------
    tied : sequence of (Candidate, ImportanceSample)
        The models and their posteriors, given the same readings.
    log_prior : sequence of float
        Log prior probability of each.
    proposal : Proposal
    seed : int
    progress : callable
        Called with (rehearsals done, rehearsals).

    Returns
    -------
    Rehearsal
    """

    def measure(truth: Candidate, draws: ImportanceSample, rng: np.random.Generator) -> Callable[[Problem], Problem]:
        new = readings_to_come(truth.problem, _drawn(draws, 1, rng), proposal, rng)

        def with_it(model: Problem) -> Problem:
            experiment = replace(model.experiment, groups=(*model.experiment.groups, new))
            return replace(model, experiment=experiment, group_ids=(*model.group_ids, NEW))

        return with_it

    before = softmax([w.log_evidence + p for (_, w), p in zip(tied, log_prior, strict=True)])
    return _judged(proposal.text, tied, log_prior, before, measure, [seed, 23], progress)


def _judged(
    what: str,
    tied: Tied,
    log_prior: Sequence[float],
    before: FloatArray,
    measure: _Measure,
    stream: list[int],
    progress: Callable[[int, int], None],
) -> Rehearsal:
    """Fit all models to what each of them makes in turn."""
    truth, after, first, trials = [], [], 0, RehearsalSettings.trials
    for k, (candidate, own) in enumerate(tied):
        for trial in range(trials):
            progress(trials * k + trial, trials * len(tied))
            rng = np.random.default_rng([*stream, k, trial])
            measured = measure(candidate, own, rng)
            # The error of Laplace's approximation is taken to be the same before and after, so that it cancels.
            log_posterior = [
                d.log_evidence + _optimised(measured(c.problem), c, d, rng).laplace_of_one - c.laplace_of_one + p
                for (c, d), p in zip(tied, log_prior, strict=True)
            ]
            truth.append(list(candidate.ids))
            after.append(float(softmax(log_posterior)[k]))
            first += int(np.argmax(log_posterior) == k)
    return Rehearsal(what, truth, np.repeat(before, trials).tolist(), after, first)


def _drawn(draws: ImportanceSample, n: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(draws.draws[rng.choice(len(draws.draws), n, p=draws.weights)])


def readings_to_come(problem: Problem, u: FloatArray, proposal: Proposal, rng: np.random.Generator) -> Group:
    """Readings of the proposed sweep, of a truth drawn from a model's posterior."""
    sweep = planned(proposal, NEW, problem.experiment)
    design = Design.of(problem.experiment.constants, [sweep])
    true = readings(design, problem.theta(u, Occasions.one(NEW), rng), problem.terms)
    scatter = noise.along(problem.scatter_to_come(u, int(sweep.measured[0])), design.elapsed)
    made = noise.draw(true, scatter, sweep.sigma, rng)[0]
    read = made if sweep.observable.traced else np.maximum(made, 0.0)
    (new,) = read_as([sweep], read)
    # A cell stays empty where a launch that failed has no such reading.
    return new.at(np.flatnonzero(read > 0)) if sweep.observable.blank and (read > 0).any() else new


def _optimised(problem: Problem, candidate: Candidate, draws: ImportanceSample, rng: np.random.Generator) -> Candidate:
    """A model fitted to other readings, from its optima and draws of its posterior."""
    settings = RehearsalSettings()
    known = np.vstack([candidate.modes, _drawn(draws, settings.starts, rng)])
    at, shared = candidate.within(problem)
    starts = np.tile(at, (len(known), 1))
    starts[:, shared] = known
    found = maximise(problem, starts, schedule=settings.schedule, still_below=FitSettings.enough, unite=True)
    return candidate_of(problem, found)

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

from psafit.diagnose.next_experiment import Proposal
from psafit.experiment import Group, Waveform
from psafit.inference import noise
from psafit.inference.ascent import ascend
from psafit.inference.candidate import ENOUGH, Candidate, settle
from psafit.inference.evidence import Weighed
from psafit.inference.problem import MICRO, Problem
from psafit.simulate import Design, simulate

# Rehearsals for each model that may be the truth; starts from posterior draws beside the optima, and climbs of them.
_TRIALS, _STARTS = 3, 6
_CLIMB = ((6, 12), (24, 3))
NEW = "the proposed sweep"


@dataclass(frozen=True)
class Rehearsal:
    """How a measurement did.

    Parameters
    ----------
    proposal : str
        The measurement.
    truth : list of lists of str
        Causes that made the readings, once for each rehearsal.
    before, after : list of float
        Probability of the truth among the tied models, without and with the new readings, once for each rehearsal.
    first : int
        Rehearsals in which the truth came out first.
    """

    proposal: str
    truth: list[list[str]]
    before: list[float]
    after: list[float]
    first: int


def repeat(
    tied: Sequence[tuple[Candidate, Weighed]],
    log_prior: Sequence[float],
    *,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Rehearsal:
    """Measure the same conditions again in simulation, with each of some models as the truth; see `rehearse`."""
    truth, after, first = [], [], 0
    for k, (candidate, draws) in enumerate(tied):
        for trial in range(_TRIALS):
            progress(_TRIALS * k + trial, _TRIALS * len(tied))
            rng = np.random.default_rng([seed, 31, k, trial])
            problem = candidate.problem
            u = draws.draws[rng.choice(len(draws.draws), p=draws.weights)][None]
            made = noise.draw(problem.predict(u), problem.noise_values(u), problem.known_sigma, rng)[0]
            again = problem.experiment.with_readings(np.maximum(made, 0.0))
            height = [
                d.log_evidence + _climbed(replace(c.problem, experiment=again), c, d, rng).laplace - c.laplace + p
                for (c, d), p in zip(tied, log_prior, strict=True)
            ]
            truth.append(list(candidate.ids))
            after.append(float(softmax(height)[k]))
            first += int(np.argmax(height) == k)
    return Rehearsal("the same conditions again", truth, np.repeat(softmax(log_prior), _TRIALS).tolist(), after, first)


def rehearse(
    tied: Sequence[tuple[Candidate, Weighed]],
    log_prior: Sequence[float],
    proposal: Proposal,
    *,
    seed: int,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Rehearsal:
    """Measure a proposed sweep in simulation, with each of some models as the truth.

    Parameters
    ----------
    tied : sequence of (Candidate, Weighed)
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
    before = softmax([w.log_evidence + p for (_, w), p in zip(tied, log_prior, strict=True)])
    truth, after, first = [], [], 0
    for k, (candidate, draws) in enumerate(tied):
        for trial in range(_TRIALS):
            progress(_TRIALS * k + trial, _TRIALS * len(tied))
            rng = np.random.default_rng([seed, 23, k, trial])
            new = _measured(candidate, draws, proposal, rng)
            # What Laplace's evidence lacks of importance sampling's it lacked before: readings to come do not tell it.
            height = [
                d.log_evidence + _refitted(c, d, new, rng).laplace - c.laplace + p
                for (c, d), p in zip(tied, log_prior, strict=True)
            ]
            truth.append(list(candidate.ids))
            after.append(float(softmax(height)[k]))
            first += int(np.argmax(height) == k)
    return Rehearsal(proposal.text, truth, np.repeat(before, _TRIALS).tolist(), after, first)


def _measured(candidate: Candidate, draws: Weighed, proposal: Proposal, rng: np.random.Generator) -> Group:
    """Readings of the proposed sweep, of a truth drawn from the model's posterior."""
    problem = candidate.problem
    u = draws.draws[rng.choice(len(draws.draws), p=draws.weights)][None]
    frequency, voltage = np.array(proposal.frequency_hz), np.array(proposal.amplitude_v)
    rig = replace(problem.experiment.constants, **proposal.constants)
    design = Design.sweep(rig, proposal.waveform, frequency, voltage)
    ranges = simulate(design, problem.theta(u, [NEW], rng), problem.terms).launch_range * MICRO
    known = None if problem.usual_sigma is None else np.full(frequency.size, problem.usual_sigma)
    readings = np.maximum(noise.draw(ranges, problem.noise_values(u), known, rng), 0.0)[0]
    waveform: Waveform = "square" if proposal.waveform == "square" else "sine"
    changed = tuple(proposal.constants.items())
    return Group(NEW, waveform, "", frequency, voltage, readings, known, changed=changed)


def _refitted(candidate: Candidate, draws: Weighed, new: Group, rng: np.random.Generator) -> Candidate:
    """A model fitted to the old readings and the new ones."""
    old = candidate.problem
    experiment = replace(old.experiment, groups=(*old.experiment.groups, new))
    return _climbed(replace(old, experiment=experiment, group_ids=(*old.group_ids, NEW)), candidate, draws, rng)


def _climbed(problem: Problem, candidate: Candidate, draws: Weighed, rng: np.random.Generator) -> Candidate:
    """A model fitted to other readings, from its optima and draws of its posterior."""
    known = np.vstack([candidate.modes, draws.draws[rng.choice(len(draws.draws), _STARTS, p=draws.weights)]])
    at, shared = candidate.within(problem)
    starts = np.tile(at, (len(known), 1))
    starts[:, shared] = known
    return settle(problem, ascend(problem, starts, schedule=_CLIMB, still_below=ENOUGH, unite=True))

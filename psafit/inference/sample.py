"""From a model to its modes, the draws of its posterior, and its evidence: what all else trusts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate, candidate_at, fit, principal, united
from psafit.inference.evidence import ImportanceSample, RoundSettings, importance_sample
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem


@dataclass(frozen=True)
class SampleSettings:
    """How much work goes into a model that is fitted and sampled; a part of the identity of a result.

    Parameters
    ----------
    draws, starts : int
        Of each of the two fits: draws of the prior that are looked at, and starts taken from them.
    from_prior : int
        Causes up to which fits begin at draws of the prior by themselves, too; where more hold each other in place,
        none comes near a top.
    better : float, nats
        Rise of a log posterior by which a fit counts as another mode.
    rounds, effective : int, float
        Rounds of importance sampling at most on each mode, and effective draws at which it is enough.
    """

    draws: int = 256
    starts: int = 12
    from_prior: int = 2
    better: float = 0.5
    rounds: int = RoundSettings.most
    effective: float = RoundSettings.effective

    @classmethod
    def of(cls, starts: int, draws_per_start: int = 32) -> SampleSettings:
        """So many starts in all, half of them for each of the two fits, from so many draws of the prior for each."""
        return cls(draws=starts // 2 * draws_per_start, starts=starts // 2)


def sample(
    problem: Problem,
    known: Sequence[Candidate] = (),
    *,
    seed: int,
    settings: SampleSettings | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> tuple[Candidate, ImportanceSample]:
    """Fit a model, look for its other modes, and draw from its posterior.

    Two fits look for modes: one from what is known, the other from draws of the prior alone (of a model with many
    causes, from what is known with another seed). What the second adds to the first may be lacking once more, up to as
    much again as was found: it is a part of the error. A draw that lies above every mode says that the fits had not
    arrived: the model is fitted again from there, and drawn from again, as long as that leads higher.

    Parameters
    ----------
    problem : Problem
    known : sequence of Candidate
        Fits of the same model, or of parts of it, to begin from.
    seed : int
    settings : SampleSettings, optional
    progress : callable
        Called with (parts done, parts, which is next).

    Returns
    -------
    Candidate and ImportanceSample
        The candidate counts the starts of both fits. The standard error of the log evidence holds what the second fit
        has added.
    """
    s = settings or SampleSettings()
    progress(0, 3, "fit")
    one = first(problem, known, seed=seed, settings=s)
    progress(1, 3, "fit again")
    other = second(problem, known, seed=seed, settings=s)
    progress(2, 3, "importance sampling")
    return joined(one, other, seed=seed, settings=s)


def first(problem: Problem, known: Sequence[Candidate], *, seed: int, settings: SampleSettings) -> Candidate:
    """Look for modes from what is known; parameters as of `sample`."""
    return fit(problem, known, seed=seed, draws=settings.draws, most=settings.starts)


def second(problem: Problem, known: Sequence[Candidate], *, seed: int, settings: SampleSettings) -> Candidate:
    """Look for modes once more, without `first`; parameters as of `sample`."""
    again = known if len(problem.terms) > settings.from_prior else ()
    return fit(problem, again, seed=seed + 1, draws=settings.draws, most=settings.starts)


def joined(
    one: Candidate, other: Candidate, *, seed: int, settings: SampleSettings
) -> tuple[Candidate, ImportanceSample]:
    """Put two looks for modes together, and draw from the posterior; see `sample`."""
    s, found = settings, principal(united(one, other))
    added = min(max(found.laplace_apart - one.laplace_apart, 0.0), math.log(2.0))
    draws = importance_sample(found, seed=seed, rounds=s.rounds, effective=s.effective)
    while draws.log_posterior > found.log_posterior + s.better:
        higher = principal(_optimised(found, draws.top))
        if higher.log_posterior <= found.log_posterior + s.better:
            added = math.log(2.0)  # that draw is of a mode that cannot be reached
            break
        found, draws = higher, importance_sample(higher, seed=seed, rounds=s.rounds, effective=s.effective)
    return found, replace(draws, error=math.hypot(draws.error, added))


def _optimised(found: Candidate, top: FloatArray) -> Candidate:
    """The same model, optimised on from its modes and from a draw."""
    end = maximise(found.problem, np.vstack([found.modes, top[None]]))
    return candidate_at(found.problem, end.u, np.append(found.starts, 0), found.effort + end.uncounted.effort)

"""From a model to its modes, the draws of its posterior, and its evidence: what all else trusts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate, FitSettings, candidate_at, fit, principal, united
from psafit.inference.evidence import ImportanceSample, RoundSettings, importance_sample
from psafit.inference.hopping import hopped
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem


@dataclass(frozen=True)
class SampleSettings:
    """How much work goes into a model that is fitted and sampled; a part of the identity of a result.

    Parameters
    ----------
    draws, starts : int
        Of a look from what is known: draws of the prior that are looked at, and starts taken from them.
    alone_draws, alone_starts : int
        The same of a look from the prior alone, where one start in ten may lead to the highest mode.
    from_prior : int
        Causes up to which all fits begin at draws of the prior by themselves, too. Where more hold each other in place,
        few of these come near a top: of such a model the second look alone begins there, too.
    better : float, nats
        Rise of a log posterior by which a fit counts as another mode, and difference of the two highest evidences above
        which one more look is taken.
    looks : int
        At a model at most, and two at least. Of four that find the top with even chances each, none does in one model
        of sixteen.
    lacking : float, nats
        What looks may have missed at most: so much do the evidences of other seeds differ at most, where ranges jump at
        hundreds of places (docs/search-yardstick.md).
    rounds, effective : int, float
        Rounds of importance sampling at most on each mode, and effective draws at which it is enough.
    """

    draws: int = 256
    starts: int = 12
    alone_draws: int = 1024
    alone_starts: int = 48
    from_prior: int = 2
    better: float = 0.5
    looks: int = 4
    lacking: float = 2.0
    rounds: int = RoundSettings.most
    effective: float = RoundSettings.effective

    @classmethod
    def of(cls, starts: int = 32, draws_per_start: int = 32) -> SampleSettings:
        """So many starts in the first two looks, half of them in each, from so many draws of the prior for each."""
        half, draws = starts // 2, starts // 2 * draws_per_start
        return cls(draws=draws, starts=half, alone_draws=draws, alone_starts=half)


def sample(
    problem: Problem,
    known: Sequence[Candidate] = (),
    *,
    seed: int,
    settings: SampleSettings | None = None,
    progress: Callable[[int, int, str], None] = lambda done, total, what: None,
) -> tuple[Candidate, ImportanceSample]:
    """Fit a model, look for its other modes, and draw from its posterior.

    Looks for modes are taken until two have come to the same evidence, and two at least: the first from what is known,
    the others from draws of the prior alone. (Of a model with many causes the second begins from what is known, too,
    as well as from the prior, and is the last.) What all of them have above the second highest may be lacking once
    more: it is a part of the error. A draw that lies above every mode says that the looks had not arrived: the model is
    fitted again from there, and drawn from again, as long as that leads higher. (Where it leads nowhere, half of the
    evidence may be lacking.)

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
        The candidate counts the starts of all looks. The standard error of the log evidence holds how far they differ.
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
    few = len(problem.terms) <= settings.from_prior
    return _look(problem, known, seed, settings, settings.draws, settings.starts, fresh=few)


def second(problem: Problem, known: Sequence[Candidate], *, seed: int, settings: SampleSettings) -> Candidate:
    """Look for modes once more, without `first`; parameters as of `sample`."""
    s = settings
    if len(problem.terms) <= s.from_prior:
        return _alone(problem, seed + 1, s)
    # Each by itself: of starts that are optimised together, those that are higher early on displace the others.
    near, far = (_look(problem, some, seed + 1, s, s.draws, s.starts, fresh=False) for some in (known, ()))
    return united(near, far)


def _alone(problem: Problem, seed: int, s: SampleSettings) -> Candidate:
    """Look for modes from the prior alone."""
    return _look(problem, (), seed, s, s.alone_draws, s.alone_starts)


def _look(
    problem: Problem,
    known: Sequence[Candidate],
    seed: int,
    s: SampleSettings,
    draws: int,
    starts: int,
    *,
    fresh: bool = True,
) -> Candidate:
    """Look for modes from what is known, and from the prior by itself where `fresh` or nothing is known."""
    if known:
        return hopped(fit(problem, known, seed=seed, draws=draws, most=starts, fresh=fresh), seed=seed, better=s.better)
    # No end is too low for hops.
    every = FitSettings(forgotten=math.inf)
    return hopped(fit(problem, (), seed=seed, draws=draws, most=starts, settings=every), seed=seed, better=s.better)


def joined(
    one: Candidate, other: Candidate, *, seed: int, settings: SampleSettings
) -> tuple[Candidate, ImportanceSample]:
    """Put looks for modes together, take more where they differ, and draw from the posterior; see `sample`."""
    s, looks = settings, [one, other]
    most = s.looks if len(one.terms) <= s.from_prior else len(looks)
    while True:
        second_best, best = sorted(look.laplace_apart for look in looks)[-2:]
        if len(looks) >= most or best <= second_best + s.better:
            break
        looks.append(_alone(one.problem, seed + len(looks), s))
    found, unreached = principal(united(*looks)), 0.0
    draws = importance_sample(found, seed=seed, rounds=s.rounds, effective=s.effective)
    while draws.log_posterior > found.log_posterior + s.better:
        higher = principal(_optimised(found, draws.top))
        if higher.log_posterior <= found.log_posterior + s.better:
            unreached = math.log(2.0)  # that draw is of a mode that cannot be reached
            break
        found, draws = higher, importance_sample(higher, seed=seed, rounds=s.rounds, effective=s.effective)
    lacking = min(max(found.laplace_apart - second_best, unreached), s.lacking)
    return found, replace(draws, error=math.hypot(draws.error, lacking))


def _optimised(found: Candidate, top: FloatArray) -> Candidate:
    """Optimise a model on from its modes and from a draw."""
    end = maximise(found.problem, np.vstack([found.modes, top[None]]))
    return candidate_at(found.problem, end.u, np.append(found.starts, 0), found.effort + end.uncounted.effort)

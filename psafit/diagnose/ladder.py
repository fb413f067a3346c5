r"""The ladder: from every cause alone to combinations of up to four, and a probability for each model.

1. The baseline is fitted; every cause is screened by expansion (`psafit.diagnose.screening`) and then fitted in
   earnest, alone: expansions at a badly wrong fit may mislead.
2. From the best models so far (the beam: the best, and the best that have no cause in common with it) each of the most
   promising further causes is added, and the larger model fitted. This goes on while a larger model gains more than
   it costs, up to four causes.
3. Each cause of the leader is exchanged for those that promise most in its place: rivals that a beam has dropped.
4. The evidences of all models near the best are computed by importance sampling; posterior probabilities follow from
   them and the prior probabilities below.

*Prior over models.* The number of causes that matter is 0 to 4 with weights 0.4, 0.36, 0.16, 0.06, 0.02, shared
equally by all sets of that size in the catalogue. Half of the weight of "something is wrong" lies on one cause, and
each further cause is about as surprising as the first. Models that were not fitted are counted with the evidence that
the expansion gives them, so that a leader is not certain only because its rivals were not tried.

*What counts as a model.* Beside any truth stand its supersets whose further causes are too weak to be seen; nobody can
refute them, and together they have as much probability as the truth itself. A superset whose evidence is not better by
three nats is therefore counted with the set it is added to: a probability printed for {a, b} is that of "a and b are
at work, and nothing else that these readings show".
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from psafit.diagnose.candidate import Candidate, fit, settle
from psafit.diagnose.evidence import Weighed, weigh
from psafit.diagnose.memory import Memory
from psafit.diagnose.screening import Screened, extended, screen
from psafit.inference.ascent import Ascent, ascend
from psafit.inference.optimise import widened
from psafit.inference.problem import Problem
from psafit.physics.term import Term

FloatArray = NDArray[np.float64]
Ids = tuple[str, ...]

SIZE_WEIGHTS = (0.40, 0.36, 0.16, 0.06, 0.02)
"""Prior probability of 0, 1, 2, 3, 4 causes."""

VISIBLE_EVIDENCE = 3.0
"""Evidence, nats, by which a further cause must improve a model to count as one of its own (20 to 1)."""

MOST_CAUSES = 4
# Models kept at each size, and causes tried on each of them.
_BEAM, _TRIED = 3, 5
# ... of which so many by expansion and alone in any case; more only where the expansion promises this much (nats).
_SURE_BY_BAYES, _SURE_ALONE, _PROMISE = 2, 1, 2.0
# Rounds in which causes of the leader are exchanged, and exchanges tried for each.
_SWAPS, _SWAPPED = 4, 3
# A model this far below the best (nats of evidence and prior) is not weighed.
_HOPELESS = 7.0
_WEIGHED = 4
# A draw this far above the optimum (nats) says that the climb had not arrived.
_HIGHER = 0.5
# A start this far (nats) below a model's optimum may lead above it.
_WITHIN_REACH = 200.0
# Error of Laplace's evidence (nats), as seen against importance sampling; draws over which probabilities are averaged.
_LAPLACE_DOUBT, _SHAKES = 1.0, 400
_DRAWS_BASELINE, _DRAWS_CAUSE, _DRAWS_PAIR = 4096, 256, 128
_STARTS_BASELINE = 48


@dataclass(frozen=True, eq=False)
class Ladder:
    """What the search found.

    Parameters
    ----------
    candidates : tuple of Candidate
        Every model fitted, most probable first.
    probability : dict
        Of each set of causes fitted, by identifiers; with what was not fitted they sum to one.
    unfitted : dict
        Probability that the expansion gives to models that were not fitted.
    log_evidence : dict
    weighed : dict
        Posterior draws and evidence of those models that were weighed; the others have Laplace's.
    screened : tuple of Screened
        The causes beside the baseline.
    """

    candidates: tuple[Candidate, ...]
    probability: dict[Ids, float]
    unfitted: dict[Ids, float]
    log_evidence: dict[Ids, float]
    weighed: dict[Ids, Weighed]
    screened: tuple[Screened, ...]

    def of(self, ids: Ids) -> Candidate:
        """The candidate with these causes."""
        return next(c for c in self.candidates if c.ids == ids)

    @property
    def baseline(self) -> Candidate:
        """The model without causes."""
        return self.of(())

    @property
    def leader(self) -> Candidate:
        """The most probable model."""
        return self.candidates[0]

    def draws(self, ids: Ids, seed: int) -> Weighed:
        """Posterior draws of a model; worked out for one that the search did not weigh."""
        return self.weighed[ids] if ids in self.weighed else weigh(self.of(ids), seed=seed)

    def gain(self, ids: Ids) -> float:
        """Log likelihood of a model above the baseline's, both at their posteriors' tops, nats."""
        return self.of(ids).log_likelihood - self.baseline.log_likelihood


def log_prior(n_causes: int, n_catalogue: int) -> float:
    """Log prior probability of one model with so many causes out of a catalogue."""
    weights = SIZE_WEIGHTS[: min(n_catalogue, MOST_CAUSES) + 1]
    return math.log(weights[n_causes] / sum(weights) / math.comb(n_catalogue, n_causes))


def climb(
    problem: Problem,
    catalogue: Sequence[Term],
    *,
    seed: int,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
    memory: Memory | None = None,
) -> Ladder:
    """Search the catalogue for what explains the readings.

    Parameters
    ----------
    problem : Problem
        The readings, with no cause.
    catalogue : sequence of Term
    seed : int
    progress : callable
        Called with (what, models done, models of this rung).
    memory : Memory, optional
        Where fits are kept; those already there are not repeated.

    Returns
    -------
    Ladder
    """
    n = len(catalogue)
    kept = memory or Memory(None)
    fitted: dict[Ids, Candidate] = {}
    screenings: dict[Ids, tuple[Screened, ...]] = {}
    weighed: dict[Ids, Weighed] = {}

    def weigh_one(c: Candidate) -> Candidate:
        """Weigh a model, and return it fitted from the best draw if that is above what its climbs had found."""
        weighed[c.ids] = _weigh(kept, c, seed)
        better = weighed[c.ids].height > c.height + _HIGHER
        fitted[c.ids] = _climbed_from(kept, c, weighed[c.ids].top[None], seed) if better else c
        return fitted[c.ids]

    baseline = weigh_one(_fit(kept, problem, (), seed, None, _DRAWS_BASELINE, _STARTS_BASELINE))
    screenings[()] = tuple(screen(baseline, catalogue))
    rival = None
    for k, found in enumerate(sorted(screenings[()], key=lambda s: -s.log_bayes)):
        progress(found.term.id, k, n)
        larger = extended(problem, found.term, catalogue)
        one = _fit(kept, larger, (baseline,), seed, found.starts, _DRAWS_CAUSE, 12, rival)
        fitted[one.ids] = one
        rival = _higher(rival, one)

    def worth(c: Candidate) -> float:
        evidence = weighed[c.ids].log_evidence if c.ids in weighed else c.laplace
        return evidence + log_prior(len(c.terms), n)

    def best() -> float:
        return max(worth(c) for c in fitted.values())

    for size in range(1, min(MOST_CAUSES, n)):
        parents = _parents([c for c in fitted.values() if len(c.terms) == size], worth)
        wanted: dict[Ids, tuple[Problem, list[Candidate], list[FloatArray], list[float]]] = {}
        for parent in parents:
            progress(f"{' + '.join(parent.ids)}: what else", 0, 1)
            screenings[parent.ids] = tuple(screen(parent, catalogue))
            for found in _promising(screenings[parent.ids], fitted, worth):
                larger = extended(parent.problem, found.term, catalogue)
                ids = tuple(t.id for t in larger.terms)
                entry = wanted.setdefault(ids, (larger, [], [], []))
                entry[1].append(parent)
                entry[2].append(found.starts)
                entry[3].append(worth(parent) + found.log_bayes)
        before = best()
        rival = None
        # The most promising first: what falls hopelessly behind it is not fitted to the end.
        for k, (ids, (larger, nested, starts, _)) in enumerate(sorted(wanted.items(), key=lambda w: -max(w[1][3]))):
            progress(" + ".join(ids), k, len(wanted))
            singles = [fitted[(t.id,)] for t in larger.terms if (t.id,) in fitted and size > 1]
            extra = np.vstack(starts)
            fitted[ids] = _fit(kept, larger, [*nested, *singles][:4], seed, extra, _DRAWS_PAIR, 6, rival)
            rival = _higher(rival, fitted[ids])
        if not wanted or best() < before + 0.5:
            break

    # The beam grows what it has; each cause of the leader may still be had cheaper from another one. Who leads is
    # said by evidence, of which Laplace's may be off by several nats.
    for turn in range(_SWAPS + 1):
        order = sorted(fitted.values(), key=worth, reverse=True)
        finalists = [c for c in order if worth(c) > best() - _HOPELESS][:_WEIGHED]
        for k, c in enumerate(finalists):
            if c.ids not in weighed:
                progress(f"evidence of {' + '.join(c.ids) or 'the baseline'}", k, len(finalists))
                weigh_one(c)
        leader = max(fitted.values(), key=worth)
        # What the leader does without one of its causes is seen best from where the leader is.
        for smaller in [c for c in fitted.values() if set(c.terms) < set(leader.terms) and c.terms]:
            starts = leader_starts(smaller.problem, leader)[:1]
            if float(smaller.problem.log_posterior(starts)[0]) > smaller.height - _WITHIN_REACH:
                better = _climbed_from(kept, smaller, starts, seed)
                if better.height > smaller.height + _HIGHER:
                    fitted[smaller.ids] = better
                    weighed.pop(smaller.ids, None)
        swaps = _swaps(leader, fitted, screenings, catalogue, worth) if turn < _SWAPS else {}
        for k, (ids, (larger, smaller, extra)) in enumerate(swaps.items()):
            progress(" + ".join(ids), k, len(swaps))
            fitted[ids] = _fit(kept, larger, smaller, seed, extra, _DRAWS_PAIR, 6, leader)
        if not swaps:
            break
    evidence = {ids: weighed[ids].log_evidence if ids in weighed else c.laplace for ids, c in fitted.items()}
    return rank(fitted.values(), evidence, weighed, screenings, n)


def _higher(one: Candidate | None, other: Candidate) -> Candidate:
    return other if one is None or other.height > one.height else one


def _swaps(
    leader: Candidate,
    fitted: dict[Ids, Candidate],
    screenings: dict[Ids, tuple[Screened, ...]],
    catalogue: Sequence[Term],
    worth: Callable[[Candidate], float],
) -> dict[Ids, tuple[Problem, Sequence[Candidate], FloatArray]]:
    """Models not fitted yet in which one cause of the leader gives way to another: what to fit, from where."""
    wanted: dict[Ids, tuple[Problem, Sequence[Candidate], FloatArray]] = {}
    for gone in leader.terms:
        rest = replace(leader.problem, terms=tuple(t for t in leader.terms if t != gone))
        ids = tuple(t.id for t in rest.terms)
        if ids not in fitted:  # the leader without one cause is a model in its own right
            wanted[ids] = (rest, [fitted[()]], leader_starts(rest, leader))
            continue
        if ids not in screenings:
            screenings[ids] = tuple(screen(fitted[ids], catalogue))
        for found in _promising(screenings[ids], fitted, worth)[:_SWAPPED]:
            larger = extended(rest, found.term, catalogue)
            key = tuple(t.id for t in larger.terms)
            if key not in fitted and found.term != gone:
                starts = np.vstack([found.starts, leader_starts(larger, leader)])
                wanted[key] = (larger, [fitted[ids]], starts)
    return wanted


def leader_starts(problem: Problem, leader: Candidate) -> FloatArray:
    """The leader's optimum as starts of a model that shares some of its causes."""
    return widened(problem, leader.values, leader.problem.names)


def _fit(
    memory: Memory,
    problem: Problem,
    nested: Sequence[Candidate],
    seed: int,
    extra: FloatArray | None,
    draws: int,
    most: int,
    rival: Candidate | None = None,
) -> Candidate:
    made: list[Candidate] = []

    def make() -> dict[str, FloatArray]:
        made.append(fit(problem, nested, seed=seed, extra=extra, draws=draws, most=most, rival=rival))
        return {"modes": made[0].modes, "heights": made[0].heights}

    found = memory.recall("fit", problem, seed, make)
    if made:
        return made[0]
    modes = found["modes"]
    return settle(problem, Ascent(modes, found["heights"], problem.predict(modes), 0))


def _weigh(memory: Memory, candidate: Candidate, seed: int) -> Weighed:
    def make() -> dict[str, FloatArray]:
        return {name: np.asarray(value, float) for name, value in vars(weigh(candidate, seed=seed)).items()}

    found = memory.recall("evidence", candidate.problem, seed, make)
    values: dict[str, Any] = {name: a if a.ndim else float(a) for name, a in found.items()}
    return Weighed(**values)


def _climbed_from(memory: Memory, candidate: Candidate, starts: FloatArray, seed: int) -> Candidate:
    """Fit a model anew from its optima and from places that may be above them."""
    whole = np.vstack([candidate.modes, starts])

    def make() -> dict[str, FloatArray]:
        end = ascend(candidate.problem, whole)
        return {"u": end.u, "heights": end.height, "predicted": end.predicted}

    found = memory.recall(f"refit-{zlib.crc32(whole.tobytes()):08x}", candidate.problem, seed, make)
    return settle(candidate.problem, Ascent(found["u"], found["heights"], found["predicted"], 0))


def _parents(candidates: list[Candidate], worth: Callable[[Candidate], float]) -> list[Candidate]:
    """Models to grow: the best, and the best that have no cause in common with those before.

    The best single cause may lead into a valley: of a combination, each part alone may explain little.
    """
    left = sorted(candidates, key=worth, reverse=True)
    chosen: list[Candidate] = []
    while left and len(chosen) < _BEAM:
        used = {t for c in chosen for t in c.terms}
        chosen.append(next((c for c in left if not used & set(c.terms)), left[0]))
        left.remove(chosen[-1])
    return chosen


def _promising(
    screened: Iterable[Screened],
    fitted: dict[Ids, Candidate],
    worth: Callable[[Candidate], float],
) -> list[Screened]:
    """Causes to add to a model: the best by expansion, and the best of those that explain most alone."""
    by_bayes = sorted(screened, key=lambda s: -s.log_bayes)
    alone = sorted(by_bayes, key=lambda s: -worth(fitted[(s.term.id,)]))
    sure = [*by_bayes[:_SURE_BY_BAYES], *alone[:_SURE_ALONE]]
    more = [s for s in by_bayes if s.log_bayes > _PROMISE]
    return list(dict.fromkeys([*sure, *more]))[:_TRIED]


def rank(
    fitted: Iterable[Candidate],
    evidence: dict[Ids, float],
    weighed: dict[Ids, Weighed],
    screenings: dict[Ids, tuple[Screened, ...]],
    n_catalogue: int,
) -> Ladder:
    """Posterior probabilities of the models, what adds nothing visible counted with what it is added to."""
    candidates = list(fitted)
    order = [s.term.id for s in screenings[()]]
    value = dict(evidence)
    for ids, screened in screenings.items():
        for found in screened:
            larger = tuple(id for id in order if id in (*ids, found.term.id))
            if larger not in evidence and len(larger) <= MOST_CAUSES:
                value[larger] = max(evidence[ids] + found.log_bayes, value.get(larger, -math.inf))
    mass = {ids: v + log_prior(len(ids), n_catalogue) for ids, v in value.items()}
    # Evidences are known with an error; probabilities are their mean over it.
    doubt = np.array([weighed[ids].doubt if ids in weighed else _LAPLACE_DOUBT for ids in mass])
    shaken = np.array(list(mass.values())) + doubt * np.random.default_rng(0).standard_normal((_SHAKES, len(mass)))
    chances = np.exp(shaken - logsumexp(shaken, axis=1, keepdims=True)).mean(axis=0)
    share = dict(zip(mass, chances.tolist(), strict=True))
    for ids in sorted(share, key=len, reverse=True):
        within = [i for i in evidence if set(i) < set(ids) and value[ids] < evidence[i] + VISIBLE_EVIDENCE]
        if within:
            share[max(within, key=lambda i: mass[i])] += share[ids]
            share[ids] = 0.0
    candidates.sort(key=lambda c: (-share[c.ids], -mass[c.ids]))
    return Ladder(
        candidates=tuple(candidates),
        probability={c.ids: share[c.ids] for c in candidates},
        unfitted={ids: p for ids, p in share.items() if ids not in evidence and p > 0},
        log_evidence=evidence,
        weighed=weighed,
        screened=screenings[()],
    )

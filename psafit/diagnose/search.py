"""The search: from every cause alone to combinations of up to six.

1. The baseline is fitted; every cause is screened by expansion (`psafit.diagnose.screening`) and then fitted in
   earnest, alone: expansions at a badly wrong fit may mislead.
2. From the best models so far (the beam: the best, and the best that have no cause in common with it) each of the most
   promising further causes is added, and the larger model fitted. This goes on while a larger model gains more than
   it costs, up to four causes; it does not begin where no cause alone gains what is rare by chance. When the first pair
   was worth it, causes are also looked for beside every cause alone, and the most promising of these pairs fitted: of
   two causes, either may show only beside the other.
3. Each cause of the leader is exchanged for those that promise most in its place, rivals that a beam has dropped, and
   what promises most is added to it; so with every model that comes to lead or is as good as the leader, up to six
   causes.
4. Beside a leader of three causes or more the best that has at most half of its causes in common with it is refined
   in the same way: it was behind when models were small. What grows step by step stands where its parts fitted best;
   a thorough search therefore begins once more from above, with all causes at once (`psafit.diagnose.pruning`), and
   from what parts of the readings led to, and refines what it finds. Exchanges in models of five causes or six, which
   hold each other in place, are judged by short climbs instead of expansions.
5. The evidences of all models near the best are computed by importance sampling; posterior probabilities follow from
   them (`psafit.diagnose.ladder`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.diagnose.ladder import LAPLACE_DOUBT, MOST_CAUSES, VISIBLE_EVIDENCE, Ids, Ladder, log_prior, rank
from psafit.diagnose.memory import Arrays, Memory
from psafit.diagnose.pruning import prune
from psafit.diagnose.screening import Screened, extended, screen
from psafit.inference.ascent import Ascent, ascend
from psafit.inference.candidate import Candidate, coarse, fit, scouted, settle, settle_at
from psafit.inference.evidence import EFFECTIVE, ROUNDS, Weighed, weigh
from psafit.inference.optimise import widened
from psafit.inference.problem import Problem
from psafit.physics.term import Term

# Log likelihood (nats) that some cause alone must gain before combinations are tried: with nothing hidden the best of
# two dozen gains more once in fifty times.
_NOTHING = 6.0
# Models kept at each size, and causes tried on each of them.
_BEAM, _TRIED = 3, 5
# Of models of several causes, those this far below the best (nats) are not grown.
_OUTCLASSED = 60.0
# ... of which so many by expansion and alone in any case; more only where the expansion promises this much (nats).
_SURE_BY_BAYES, _SURE_ALONE, _PROMISE = 2, 1, 2.0
# Pairs fitted because one cause promises much beside another that was not worth growing.
_LATE = 6
# Models of which causes are exchanged, at most, and exchanges tried for each cause; those that the expansion sees this
# far behind (nats) are not.
_ROUNDS, _SWAPPED, _UNLIKELY = 6, 3, 15.0
# Starts by the expansion and from fitted parts, and climbs on some of the readings and on all, by which exchanges in
# models of many causes are tried; gain (nats) below which these end.
_TRIED_FROM, _TRIED_PARTS, _GLIMPSE, _TRY, _ROUGHLY = 2, 1, ((8, 1),), ((12, 1),), 0.3
# Fitted models from which a larger one, and one with an exchanged cause, is begun.
_NESTED, _LIKE = 4, 2
# A model this far below the best (nats of evidence and prior) is not weighed.
_HOPELESS = 7.0
_WEIGHED = 4
# Rounds of draws while the search goes on; and a part this far behind the leader (nats) is weighed, too.
_GLANCE, _PART_DOUBT = 4, 30.0
# A draw this far above the optimum (nats) says that the climb had not arrived.
_HIGHER = 0.5
# A single cause that rises by this (nats) after it was fitted was held by cliffs; others that are no further behind may
# be, too: rises of up to 70 nats were seen.
_CLIFF, _BEHIND_CLIFFS = 3.0, 80.0
# A start this far (nats) below a model's optimum may lead above it.
_WITHIN_REACH = 200.0
# Draws of the prior looked at, and starts taken from them: for the baseline, one cause, several.
_DRAWS_BASELINE, _DRAWS_CAUSE, _DRAWS_PAIR = 4096, 256, 128
_STARTS_BASELINE, _STARTS_CAUSE, _STARTS_PAIR = 48, 12, 6
# A rung that gains less than this (nats) is the last.
_WORTH_GROWING = 0.5


def climb(
    problem: Problem,
    catalogue: Sequence[Term],
    *,
    seed: int,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
    memory: Memory | None = None,
    others: Sequence[Candidate] = (),
    thorough: bool = True,
    wide: int = 4,
    tangled: int = 3,
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
    others : sequence of Candidate
        Models that some of these readings led to: they are begun from, too.
    thorough : bool
        Whether to try up to six causes, from all of them at once, too; else up to four. One or two causes are found
        alike; where more are needed the thorough search takes several times as long.
    wide : int
        Causes up to which several models are grown before all else, and every part of the best model is fitted; beyond,
        it alone grows until there is nothing else left to do.
    tangled : int
        Causes of the best model from which on it is not believed that nothing simpler, or better, lies elsewhere.

    Returns
    -------
    Ladder
    """
    most = min(MOST_CAUSES if thorough else wide, len(catalogue))
    search = _Search(problem, catalogue, seed, memory or Memory(None), progress, most, wide, tangled)
    search.begin()
    for size in range(1, min(wide, len(catalogue))):
        if not (search.found_something() and search.grow(size)):
            break
        if size == 1:
            search.look_around()
    search.settle()
    further = [search.think_again]
    if thorough:
        further += [search.from_above, lambda: search.take_over(others)]
    for another in further:
        if another():
            search.settle()
    return search.concluded()


@dataclass(eq=False)
class _Wanted:
    """A model to fit: from where besides the models that are like it, and what it promises."""

    problem: Problem
    starts: list[FloatArray]
    promise: float


class _Search:
    """What is fitted, screened and weighed so far, and the rungs that add to it."""

    def __init__(
        self,
        problem: Problem,
        catalogue: Sequence[Term],
        seed: int,
        memory: Memory,
        progress: Callable[[str, int, int], None],
        most: int = MOST_CAUSES,
        wide: int = 4,
        tangled: int = 3,
    ) -> None:
        self._wide, self._tangled = wide, tangled
        self._most = min(most, len(catalogue))
        self.problem, self.catalogue, self.seed = problem, tuple(catalogue), seed
        self.fitted: dict[Ids, Candidate] = {}
        self.screenings: dict[Ids, tuple[Screened, ...]] = {}
        self.weighed: dict[Ids, Weighed] = {}
        self._rounds: dict[Ids, int] = {}
        self._refined: set[Ids] = set()
        self._scouted: set[Ids] = set()
        self._cliffs = False
        self._alone: dict[str, float] = {}
        self._memory, self._progress = memory, progress

    def begin(self) -> None:
        """Fit the baseline, and every cause alone."""
        self._weigh(self._fit(_Wanted(self.problem, [], 0.0), _DRAWS_BASELINE, _STARTS_BASELINE))
        wanted = [
            _Wanted(extended(self.problem, s.term, self.catalogue), [s.starts], s.log_bayes) for s in self._screen(())
        ]
        self._fit_all(wanted, _DRAWS_CAUSE, _STARTS_CAUSE)
        self._alone = {c.ids[0]: self._worth(c) for c in self.fitted.values() if c.terms}

    def found_something(self) -> bool:
        """Whether any cause gains what the best of so many would rarely gain by chance."""
        least = self.fitted[()].log_likelihood + _NOTHING
        return any(c.log_likelihood > least for c in self.fitted.values())

    def grow(self, size: int) -> bool:
        """Add a cause to the best models of one size; whether that was worth it."""
        before = self._best()
        parents = _parents([c for c in self.fitted.values() if len(c.terms) == size], self._worth)
        larger = self._larger([p.problem for p in parents], _TRIED)
        self._fit_all(larger, _DRAWS_PAIR, _STARTS_PAIR)
        return bool(larger) and self._best() > before + _WORTH_GROWING

    def look_around(self) -> None:
        """Look for a second cause beside every cause alone, also those that explain nothing by themselves."""
        alone = [c for c in self.fitted.values() if len(c.terms) == 1]
        wanted: dict[Ids, _Wanted] = {}
        for k, c in enumerate(alone):
            self._progress(f"{c.ids[0]}: what else", k, len(alone))
            for found in self._glimpsed(c):
                self._enlist_screened(wanted, c.problem, found)
        pairs = sorted(wanted.values(), key=lambda one: -one.promise)[:_LATE]
        self._fit_all([one for one in pairs if one.promise > self._best() - _UNLIKELY], _DRAWS_PAIR, _STARTS_PAIR)

    def _glimpsed(self, c: Candidate) -> list[Screened]:
        """Every other cause beside a model, by a quarter of the readings: enough to see what is worth a fit."""
        few = coarse(c.problem)
        seen = settle_at(few, c.modes[:1])
        weight = c.problem.observed.size / few.observed.size
        return [replace(found, log_bayes=weight * found.log_bayes) for found in self._screened(seen)]

    def settle(self) -> None:
        """Compare and refine until nothing is left: causes that the beam has may be had cheaper from others."""
        for _ in range(_ROUNDS):
            self.compare()
            if not self.refine():
                return
        self.compare()

    def from_above(self) -> bool:
        """Begin from what is left of all causes at once (`psafit.diagnose.pruning`), too; whether that leads."""
        leader = self._leader()
        if len(leader.terms) < self._tangled:
            return False
        for c in self._pruned():
            self._take(c)
        return self._leader().ids != leader.ids

    def _pruned(self) -> list[Candidate]:
        """What one search from above leads through."""
        order = [t.id for t in self.catalogue]

        def make() -> dict[str, FloatArray]:
            kept: dict[str, FloatArray] = {}
            for c in prune(
                self.problem, self.catalogue, seed=self.seed, least=self._wide, most=self._most, progress=self._progress
            ):
                kept[f"{len(kept):03}-" + "-".join(str(order.index(id)) for id in c.ids)] = c.modes
            return kept

        found = self._recall("pruned", self.problem, make, [self._wide, self._most])
        made = []
        for name, modes in found.items():
            terms = tuple(self.catalogue[int(i)] for i in name.split("-")[1:])
            made.append(settle_at(replace(self.problem, terms=terms), modes))
        return made

    def take_over(self, others: Sequence[Candidate]) -> bool:
        """Fit what fewer readings led to; whether that leads.

        A search goes uphill, and what is uphill depends on the readings: a part of them may lead to where all of them
        fit better.
        """
        leader = self._leader()
        others = [c for c in others if c.terms]
        for k, c in enumerate(others):
            whole = replace(self.problem, terms=c.terms)
            self._progress(f"{' + '.join(c.ids)}, as a part of the readings has it", k, len(others))
            self._take(self._climbed(whole, widened(whole, c.values, c.problem.names)[:1]))
        return self._leader().ids != leader.ids

    def compare(self) -> None:
        """Weigh the finalists: who leads is said by evidence, of which Laplace's may be off by several nats."""
        for c in self._finalists():
            self._look_within(c)
        self._weigh_all(self._finalists(), _GLANCE)
        # Climbs stop at cliffs that a cloud of draws steps across: what a part lacks is not believed of a climb alone.
        leader = self._leader()
        own, least = set(leader.terms), self._worth(leader) - _PART_DOUBT
        parts = [c for c in self.fitted.values() if c.terms and set(c.terms) < own and len(c.terms) == len(own) - 1]
        self._weigh_all([c for c in parts if self._worth(c) > least], _GLANCE)

    def _weigh_all(self, candidates: Sequence[Candidate], rounds: int) -> None:
        """Weigh what has not been weighed in so many rounds, nor well enough in fewer."""
        for k, c in enumerate(candidates):
            known = self.weighed.get(c.ids)
            if known is None or (known.effective < EFFECTIVE and self._rounds[c.ids] < rounds):
                self._progress(f"evidence of {' + '.join(c.ids) or 'the baseline'}", k, len(candidates))
                self._weigh(c, rounds)

    def _finalists(self) -> list[Candidate]:
        order = sorted(self.fitted.values(), key=self._worth, reverse=True)
        return [c for c in order if self._worth(c) > self._best() - _HOPELESS and not self._absorbed(c)][:_WEIGHED]

    def _look_within(self, whole: Candidate) -> None:
        """What a model does without some of its causes is seen best from where the model is."""
        for part in [c for c in self.fitted.values() if c.terms and set(c.terms) < set(whole.terms)]:
            start = widened(part.problem, whole.values, whole.problem.names)[:1]
            if float(part.problem.log_posterior(start)[0]) > part.height - _WITHIN_REACH:
                self._take(self._climbed_from(part, start))

    def _take(self, found: Candidate) -> bool:
        """Keep a model fitted anew where it is better; whether it is. What was concluded from the old is forgotten."""
        known = self.fitted.get(found.ids)
        if known is not None and found.height <= known.height + _HIGHER:
            return False
        self._cliffs |= known is not None and len(known.terms) == 1 and found.height > known.height + _CLIFF
        self.fitted[found.ids] = found
        self.weighed.pop(found.ids, None)
        self._refined.discard(found.ids)
        if found.ids:
            self.screenings.pop(found.ids, None)
        return True

    def refine(self) -> bool:
        """Exchange each cause of a model that may lead, and add one, by what promises most; whether one was left."""
        order = sorted(self.fitted.values(), key=self._worth, reverse=True)
        ahead = [c for c in order if c.terms and self._worth(c) > self._best() - VISIBLE_EVIDENCE]
        leader = next((c for c in ahead if c.ids not in self._refined), None)
        if leader is None:
            return False
        self._exchange(leader)
        return True

    def think_again(self) -> bool:
        """Refine what is most unlike the leader, too, as far as it goes; whether that leads.

        A leader of many causes was chosen when it had few, by little; what was behind then was not built upon.
        """
        leader = self._leader()
        if len(leader.terms) < self._tangled:
            return False
        own = set(leader.terms)
        for _ in range(_ROUNDS):
            least = self._best() - _OUTCLASSED
            unlike = [
                c
                for c in self.fitted.values()
                if c.terms and 2 * len(own & set(c.terms)) <= len(c.terms) and self._worth(c) > least
            ]
            rival = max(unlike, key=self._worth, default=leader)
            if rival.ids in self._refined:
                break
            self._exchange(rival)
        return self._leader().ids != leader.ids

    def _exchange(self, leader: Candidate) -> None:
        """Exchange each cause of a model, and add one."""
        self._refined.add(leader.ids)
        rests = [leader.problem.without(gone)[0] for gone in leader.terms]
        # The leader without one cause is a model in its own right, perhaps far from the leader; of many causes, only
        # what lies near the leader is looked at.
        for rest in rests:
            start = widened(rest, leader.values, leader.problem.names)
            if len(rests) > self._wide:
                self._take(self._climbed(rest, start[:1]))
            elif rest.ids not in self.fitted:
                self._fit(_Wanted(rest, [start], 0.0), _DRAWS_PAIR, _STARTS_PAIR)
        wanted = self._larger([*rests, leader.problem], _SWAPPED, by_climbs=len(rests) > self._wide)
        hopeful = [one for one in wanted if one.promise > self._worth(leader) - _UNLIKELY]
        self._fit_all(hopeful, _DRAWS_PAIR, _STARTS_PAIR, leader)

    def _tried(self, smaller: Problem) -> list[tuple[Problem, FloatArray, float]]:
        """Models with one more cause: where short climbs end, and the evidence there, of the most promising."""
        largest = {}
        for s in self._screen(smaller.ids):
            larger = extended(smaller, s.term, self.catalogue)
            if larger.ids not in self.fitted:
                largest[s.term.id] = larger, np.vstack([s.starts[:_TRIED_FROM], *self._from_parts(larger, s.term)])

        def make() -> dict[str, FloatArray]:
            rough = {}
            for id, (larger, starts) in largest.items():
                few = coarse(larger)
                rough[id] = settle(few, ascend(few, starts, schedule=_GLIMPSE, still_below=_ROUGHLY))
            kept: dict[str, FloatArray] = {}
            for id in sorted(rough, key=lambda id: -rough[id].laplace)[:_SWAPPED]:
                larger = largest[id][0]
                end = settle(larger, ascend(larger, rough[id].modes[:1], schedule=_TRY, still_below=_ROUGHLY))
                kept[id] = np.append(end.modes[0], end.laplace)
            return kept

        begun = [starts.tolist() for _, starts in largest.values()]
        found = self._recall("tries", smaller, make, [list(largest), begun])
        return [(largest[id][0], row[:-1], float(row[-1])) for id, row in found.items()]

    def _from_parts(self, larger: Problem, term: Term) -> list[FloatArray]:
        """Starts for a model from the best fitted parts of it that have a certain cause.

        What explains the readings with that cause may stand far from where they are explained without it.
        """
        own = set(larger.terms)
        parts = [c for c in self.fitted.values() if term in c.terms and set(c.terms) < own]
        best = sorted(parts, key=self._worth, reverse=True)[:_TRIED_PARTS]
        return [widened(larger, c.values, c.problem.names)[:1] for c in best]

    def _larger(self, problems: Sequence[Problem], most: int, *, by_climbs: bool = False) -> list[_Wanted]:
        """What is not fitted yet of models with one more cause, at most so many from each.

        Where many causes hold each other in place the expansion sees an exchange up to ninety nats too low: short
        climbs see more.
        """
        wanted: dict[Ids, _Wanted] = {}
        for k, smaller in enumerate(problems):
            if len(smaller.terms) >= self._most:
                continue
            self._progress(f"{' + '.join(smaller.ids) or 'the baseline'}: what else", k, len(problems))
            for found in self._promising(smaller.ids)[:most]:
                self._enlist_screened(wanted, smaller, found)
            for larger, u, evidence in self._tried(smaller) if by_climbs else ():
                self._enlist(wanted, larger, u[None], evidence)
        return list(wanted.values())

    def _enlist_screened(self, wanted: dict[Ids, _Wanted], smaller: Problem, found: Screened) -> None:
        """Note a fitted model with one more cause, as the expansion has it."""
        larger = extended(smaller, found.term, self.catalogue)
        self._enlist(wanted, larger, found.starts, self._evidence(self.fitted[smaller.ids]) + found.log_bayes)

    def _enlist(self, wanted: dict[Ids, _Wanted], larger: Problem, starts: FloatArray, evidence: float) -> None:
        """Note a model and the evidence it may have, unless it is fitted already."""
        if larger.ids not in self.fitted:
            entry = wanted.setdefault(larger.ids, _Wanted(larger, [], -math.inf))
            entry.starts.append(starts)
            entry.promise = max(entry.promise, evidence + log_prior(len(larger.terms), len(self.catalogue)))

    def concluded(self) -> Ladder:
        """Rank the models, when all that would be told beside the leader has been fitted."""
        if self._scout():
            self.settle()
        for _ in range(_ROUNDS):
            self._scout()
            # What is weighed may fall behind what is not.
            for _ in range(_ROUNDS):
                self._weigh_all(self._finalists(), ROUNDS)
                if all(c.ids in self.weighed for c in self._finalists()):
                    break
            found = self._ranked()
            untried = [ids for ids in found.rivals(found.leader.ids) if ids in found.unfitted]
            if not (untried and found.leader.terms):
                break
            self._fit_all(map(self._promised, untried), _DRAWS_PAIR, _STARTS_PAIR)
            self.compare()
        else:
            found = self._ranked()
        return replace(found, beside=tuple(self._screened(found.leader)))

    def _scout(self) -> bool:
        """Look for other hills of the finalists; whether one was higher.

        Where cliffs have held the climb of a single cause, those of others were held, too: to look at the finalists
        alone would crown whichever came across by luck.
        """
        higher = self._looked_over(self._finalists())
        if self._cliffs:
            least = self._best() - _BEHIND_CLIFFS
            alone = [c for c in self.fitted.values() if len(c.terms) == 1 and self._worth(c) > least]
            higher |= self._looked_over(alone)
        return higher

    def _looked_over(self, candidates: Sequence[Candidate]) -> bool:
        """Look for other hills of some models; whether one was higher."""
        higher = False
        for c in candidates:
            if c.ids in self._scouted:
                continue
            self._scouted.add(c.ids)
            modes = self._hills(c)
            if modes.tobytes() != c.modes.tobytes():
                found = settle_at(c.problem, modes)
                if self._take(found):
                    higher = True
                else:
                    self.fitted[c.ids] = found
                    self.weighed.pop(c.ids, None)
        return higher

    def _hills(self, c: Candidate) -> FloatArray:
        def make() -> dict[str, FloatArray]:
            return {"modes": scouted(c, seed=self.seed).modes}

        return self._recall("hills", c.problem, make, c.modes.tolist())["modes"]

    def _ranked(self) -> Ladder:
        """By importance sampling's evidence where there is one, else Laplace's."""
        evidence = {ids: self._evidence(c) for ids, c in self.fitted.items()}
        return rank(self.fitted.values(), evidence, self.weighed, self.screenings, len(self.catalogue), self._most)

    def _promised(self, ids: Ids) -> _Wanted:
        """A model that only screenings have told of."""
        told = [
            (self.fitted[part].problem, s)
            for part, screened in self.screenings.items()
            for s in screened
            if {*part, s.term.id} == set(ids)
        ]
        larger = extended(told[0][0], told[0][1].term, self.catalogue)
        return _Wanted(larger, [s.starts for _, s in told], 0.0)

    def _worth(self, c: Candidate) -> float:
        return self._evidence(c) + log_prior(len(c.terms), len(self.catalogue))

    def _evidence(self, c: Candidate) -> float:
        return self.weighed[c.ids].log_evidence if c.ids in self.weighed else c.laplace

    def _absorbed(self, c: Candidate) -> bool:
        """Whether a model will be counted with a part of it, whatever its evidence is to the last nat."""
        parts = [self._evidence(p) for p in self.fitted.values() if set(p.terms) < set(c.terms)]
        return max(parts, default=-math.inf) + VISIBLE_EVIDENCE - 3 * LAPLACE_DOUBT > self._evidence(c)

    def _best(self) -> float:
        return max(map(self._worth, self.fitted.values()))

    def _leader(self) -> Candidate:
        return max(self.fitted.values(), key=self._worth)

    def _screen(self, ids: Ids) -> tuple[Screened, ...]:
        if ids not in self.screenings:
            look = self._screened if len(ids) <= self._wide else self._glimpsed
            self.screenings[ids] = tuple(look(self.fitted[ids]))
        return self.screenings[ids]

    def _screened(self, candidate: Candidate) -> list[Screened]:
        """Every other cause beside a model."""
        others = [t for t in self.catalogue if t not in candidate.terms]
        told = ("strength", "gain", "log_bayes", "chance", "visible", "starts")

        def make() -> dict[str, FloatArray]:
            found = screen(candidate, self.catalogue)
            return {f"{s.term.id} {name}": np.asarray(getattr(s, name), float) for s in found for name in told}

        kept = self._recall("screening", candidate.problem, make, candidate.modes[:1].tolist())

        def read(term: Term) -> Screened:
            strength, gain, log_bayes, chance, visible, starts = (kept[f"{term.id} {name}"] for name in told)
            return Screened(term, strength, gain, float(log_bayes), float(chance), float(visible), starts)

        return [read(t) for t in others]

    def _promising(self, ids: Ids) -> list[Screened]:
        """Causes to add to a model: the best by expansion, and the best of those that explain most alone."""
        by_bayes = sorted(self._screen(ids), key=lambda s: -s.log_bayes)
        alone = sorted(by_bayes, key=lambda s: -self._alone[s.term.id])
        sure = [*by_bayes[:_SURE_BY_BAYES], *alone[:_SURE_ALONE]]
        more = [s for s in by_bayes if s.log_bayes > _PROMISE]
        return list(dict.fromkeys([*sure, *more]))[:_TRIED]

    def _fit_all(self, wanted: Iterable[_Wanted], draws: int, starts: int, rival: Candidate | None = None) -> None:
        """Fit models, the most promising first: what falls hopelessly behind is not fitted to the end."""
        order = sorted(wanted, key=lambda w: -w.promise)
        for k, one in enumerate(order):
            best = f"{len(self.fitted)} models so far, best: {' + '.join(self._leader().ids) or 'the baseline'}"
            self._progress(f"{' + '.join(one.problem.ids)} ({best})", k, len(order))
            made = self._fit(one, draws, starts, rival)
            rival = made if rival is None or made.height > rival.height else rival

    def _fit(self, one: _Wanted, draws: int, starts: int, rival: Candidate | None = None) -> Candidate:
        problem = one.problem
        made: list[Candidate] = []
        own = set(problem.terms)
        order = sorted(self.fitted.values(), key=lambda c: -c.height)
        nested = [c for c in order if set(c.terms) < own][:_NESTED]
        # What is exchanged for a like cause leaves all else where it is.
        like = [c for c in order if len(c.terms) == len(own) and len(own - set(c.terms)) == 1 < len(own)][:_LIKE]
        more = [*one.starts, *(widened(problem, c.values, c.problem.names) for c in like)]

        def make() -> dict[str, FloatArray]:
            extra = np.vstack(more) if more else None
            made.append(fit(problem, nested, seed=self.seed, extra=extra, draws=draws, most=starts, rival=rival))
            return {"modes": made[0].modes, "heights": made[0].heights}

        # All that a fit is begun from: with other searches behind it, the same model may end elsewhere.
        begun = [[list(c.ids), c.modes[:2].tolist()] for c in [*nested, *([rival] if rival else [])]]
        found = self._recall("fit", problem, make, [draws, starts, begun, [rows.tolist() for rows in more]])
        modes = found["modes"]
        candidate = made[0] if made else settle(problem, Ascent(modes, found["heights"], problem.predict(modes), 0))
        self.fitted[candidate.ids] = candidate
        return candidate

    def _weigh(self, c: Candidate, rounds: int = ROUNDS) -> Candidate:
        """Weigh a model, and return it fitted from the best draw if that is above what its climbs had found."""

        def make() -> dict[str, FloatArray]:
            found = weigh(c, seed=self.seed, rounds=rounds)
            return {name: np.asarray(value, float) for name, value in vars(found).items()}

        found = self._recall(f"evidence-{rounds}", c.problem, make, c.modes.tolist())
        self._rounds[c.ids] = rounds
        values: dict[str, Any] = {name: a if a.ndim else float(a) for name, a in found.items()}
        weighed = Weighed(**values)
        if weighed.height > c.height + _HIGHER:
            self._take(self._climbed_from(c, weighed.top[None]))
        self.weighed[c.ids] = weighed
        return self.fitted[c.ids]

    def _climbed_from(self, candidate: Candidate, starts: FloatArray) -> Candidate:
        """Fit a model anew from its optima and from places that may be above them."""
        return self._climbed(candidate.problem, np.vstack([candidate.modes, starts]))

    def _climbed(self, problem: Problem, starts: FloatArray) -> Candidate:
        def make() -> dict[str, FloatArray]:
            end = ascend(problem, starts)
            return {"u": end.u, "heights": end.height, "predicted": end.predicted}

        found = self._recall("refit", problem, make, starts.tolist())
        return settle(problem, Ascent(found["u"], found["heights"], found["predicted"], 0))

    def _recall(
        self, kind: str, problem: Problem, make: Callable[[], dict[str, FloatArray]], begun: Sequence[Any]
    ) -> Arrays:
        about = [self.seed, [t.determinants for t in self.catalogue], begun]
        return self._memory.recall(kind, problem, about, make)


def _parents(candidates: list[Candidate], worth: Callable[[Candidate], float]) -> list[Candidate]:
    """Models to grow: the best, and the best that have no cause in common with those before.

    The best single cause may lead into a valley: of a combination, each part alone may explain little. What is far
    behind with two causes does not catch up with one more.
    """
    left = sorted(candidates, key=worth, reverse=True)
    if left and len(left[0].terms) > 1:
        left = [c for c in left if worth(c) > worth(left[0]) - _OUTCLASSED]
    chosen: list[Candidate] = []
    while left and len(chosen) < _BEAM:
        used = {t for c in chosen for t in c.terms}
        chosen.append(next((c for c in left if not used & set(c.terms)), left[0]))
        left.remove(chosen[-1])
    return chosen

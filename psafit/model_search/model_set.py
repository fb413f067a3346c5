"""What a search leaves: models, and a probability for each.

*Prior over models.* Causes are at work independently of each other, each with the probability that its file declares
and gives a reason for. Most are surprises: of all these together one or two are expected. A few are not, as that a dry
contact does not pull. Models that were fitted and not sampled are counted with what the fit says, so that a best model
is not certain only because its rivals were not sampled.

*What counts as a model.* A probability printed for {a, b} is that of "a and b are at work, and nothing else that these
readings show". What shows is asked of each draw of a model's posterior (`psafit.model_search.visibility`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample, importance_sample
from psafit.model_search.fitter import Fitted
from psafit.model_search.loop import Ids, Searched
from psafit.model_search.settings import SearchSettings
from psafit.model_search.visibility import Effective, Effects, shown
from psafit.physics.term import Term
from psafit.text import set_name

CREDIBLE = 0.95
"""Probability of the reported set."""
DECISIVE = math.log(CREDIBLE / (1 - CREDIBLE))
"""Such odds, in nats."""
_LEAST = (1 - CREDIBLE) / CREDIBLE  # odds against a set that leave one of more causes 5 % next to it
NEGLIGIBLE = 0.01
"""Probability of all sets that were not sampled below which they may be passed over in silence."""


def key_of(ids: Sequence[str]) -> str:
    """Return a set of causes as the key of a file names it."""
    return set_name(ids, "baseline")


def set_of(key: str) -> list[str]:
    """Return the set of causes that such a key names."""
    return [] if key == "baseline" else key.split(" + ")


@dataclass(frozen=True)
class LookedAt:
    """What a search has looked at, and what it left out.

    Parameters
    ----------
    fitted : int
        Sets of causes that were fitted on all readings.
    estimated : int
        Those of them of which the evidence is a short fit's estimate; the others were sampled.
    mass_not_looked_at : float
        Share of the probability that these estimates add up to. (A set whose cause does not show counts as its part.)
    neighbours : bool
        Whether all sets with a cause more, less or exchanged were fitted of every set that shows within the window; of
        other sets than the best otherwise those that might come near.
    """

    fitted: int
    estimated: int
    mass_not_looked_at: float
    neighbours: bool = False

    def no_other(self, what: str = "set") -> str:
        """Return which sets do not do as well: no other, or none that was looked at."""
        seen = "" if self.neighbours else " that was looked at"
        seen = seen if self.mass_not_looked_at < NEGLIGIBLE else " that was sampled"
        return f"no other {what}{seen}"


@dataclass(frozen=True, eq=False)
class ModelSet:
    """What the search found.

    Parameters
    ----------
    candidates : tuple of Candidate
        Every model fitted, most probable first, after the best.
    probability : dict
        Of each fitted set of causes, by identifiers: that it is at work visibly, and nothing else, if the search has
        missed no set. They sum to one.
    log_evidence : dict
    samples : dict
        Posterior draws and evidence of the models that were sampled; the others have Laplace's.
    beliefs : dict
        Prior probability of each cause that was looked at; see `beliefs`.
    missed : float
        Chance that the search has missed the set that would lead.
    visible : float, nats
        Evidence that a larger set must add for the search to take it for one of its own.
    neighbours : bool
        As of `LookedAt`.
    at_work : dict
        Probability of each set to be at work, whether it shows or not, and nothing else. What is missing to one is of
        sets that were not fitted.
    held : tuple of str
        Causes that somebody holds to be at work, by what is known of this rig, whether they show or not.
    most_causes : int
        Causes that a set may have.
    """

    candidates: tuple[Candidate, ...]
    probability: dict[Ids, float]
    log_evidence: dict[Ids, float]
    samples: dict[Ids, ImportanceSample]
    beliefs: Mapping[str, float]
    missed: float = 0.0
    visible: float = SearchSettings.visible
    neighbours: bool = False
    held: tuple[str, ...] = ()
    most_causes: int = SearchSettings.most_causes
    at_work: Mapping[Ids, float] = field(kw_only=True)

    def of(self, ids: Ids) -> Candidate:
        """The candidate with these causes."""
        return next(c for c in self.candidates if c.ids == ids)

    @property
    def baseline(self) -> Candidate:
        """The model without causes."""
        return self.of(())

    @property
    def best_model(self) -> Candidate:
        """The sampled model that leads where causes that are believed before any reading count as even odds."""
        return self.candidates[0]

    @property
    def share(self) -> dict[Ids, float]:
        """Probability of each set fitted if the catalogue holds the truth: what may have been missed keeps the rest."""
        return {ids: p * (1 - self.missed) for ids, p in self.probability.items()}

    @property
    def looked_at(self) -> LookedAt:
        """What the search has looked at."""
        estimated = [ids for ids in self.probability if ids not in self.samples]
        mass = sum(self.probability[ids] for ids in estimated)
        return LookedAt(len(self.probability), len(estimated), mass, self.neighbours)

    @property
    def likely(self) -> tuple[Ids, ...]:
        """Sets that have so much probability that the others alone would be no answer."""
        return tuple(ids for ids, p in self.probability.items() if p >= 1 - CREDIBLE)

    @property
    def decisive(self) -> tuple[Ids, ...]:
        """Sets on which an answer rests.

        Those that are likely; where a set leads, the first of a tie that estimates alone make, and what may be at work
        as well. With what somebody holds to be at work it may be one that was not fitted.
        """
        best = self.best_model.ids
        tied, more = (self.needed(best), self._favoured(best)) if best else ((), [])
        first = () if any(ids in self.samples for ids in tied) else tied[:1]
        adopted = dict.fromkeys([best, *([()] if () in self.likely else [])])  # the verdict may be that nothing shows
        held = [ids for named in adopted for ids in self._as_held(named)]
        return tuple(dict.fromkeys((*self.likely, *first, *more, *held)))

    def draws(self, ids: Ids, seed: int) -> ImportanceSample:
        """Posterior draws of a model; worked out for one that the search did not sample."""
        return self.samples[ids] if ids in self.samples else importance_sample(self.of(ids), seed=seed)

    def drawn(self, wanted: Iterable[Ids], seed: int) -> dict[Ids, ImportanceSample]:
        """Posterior draws of models, without those of which no draw lies within the bounds."""
        found = {}
        for ids in wanted:
            with suppress(ConvergenceError):
                found[ids] = self.draws(ids, seed)
        return found

    def log_prior(self, ids: Ids) -> float:
        """Log prior probability of a model."""
        return log_prior(ids, self.beliefs)

    @cached_property
    def standing(self) -> dict[Ids, float]:
        """Log posterior of each model, not normalised, where likely causes count as in `at_even_odds`."""
        even = at_even_odds(self.beliefs)
        return {ids: value + log_prior(ids, even) for ids, value in self.log_evidence.items()}

    def without(self, cause: str) -> Ids:
        """The model with the highest standing of those that lack a cause."""
        return max((ids for ids in self.standing if cause not in ids), key=lambda ids: (self.standing[ids], ids))

    def needed(self, named: Ids) -> tuple[Ids, ...]:
        """Sets that are needed, in addition to the named one, for 95 % of the probability; most probable first."""
        held, found = self.probability[named], []
        for ids in self.by_probability(named):
            if held >= CREDIBLE:
                break
            found.append(ids)
            held += self.probability[ids]
        return tuple(found)

    def fitting_as_well(self, named: Ids, absurd: float = 1e-3) -> tuple[Ids, ...]:
        """Fitted sets of no more causes that Akaike's criterion does not put behind a set at odds of 19.

        What is plausible beforehand alone holds them back. None is brought up whose own probability is less than that
        of the set by a factor `absurd`: a value can be found for almost anything. Most probable first.
        """
        own, models = self.of(named), {c.ids: c for c in self.candidates}
        least = absurd * self.probability[named]

        def behind(c: Candidate) -> float:
            return own.log_likelihood - c.log_likelihood - (own.problem.n_dim - c.problem.n_dim)

        rivals = [ids for ids in self.by_probability(named) if ids in models and len(ids) <= len(named)]
        return tuple(ids for ids in rivals if self.probability[ids] > least and behind(models[ids]) < DECISIVE)

    def rivals(self, named: Ids) -> tuple[Ids, ...]:
        """Sets to report with the named one: those needed, and those that fit as well; most probable first."""
        found = {*self.needed(named), *self.fitting_as_well(named)}
        return tuple(ids for ids in self.by_probability(named) if ids in found)

    def by_probability(self, named: Ids | None = None) -> list[Ids]:
        """Sets that have any probability, the most probable first; without the named one."""
        p = self.probability
        return [ids for ids in sorted(p, key=lambda ids: -p[ids]) if ids != named and p[ids] > 0]

    def odds(self, ids: Ids, other: Ids) -> float:
        """Posterior odds of one model against another, each taken by itself."""
        weight = (self.log_evidence[i] + self.log_prior(i) for i in (ids, other))
        return math.exp(next(weight) - next(weight))

    def counted_with(self, named: Ids) -> tuple[Ids, ...]:
        """Sampled sets that hold the named one and more, and that the readings favour over it, by less than is visible.

        By more than the standard error; those that keep 5 % next to the named one alone, most probable first. What is
        reported for its own probability is not among them.
        """
        own, samples = self.log_evidence[named], self.samples
        favoured = (ids for ids in self._favoured(named) if ids in samples)
        return tuple(ids for ids in favoured if samples[ids].standard_error < self.log_evidence[ids] - own)

    def as_held(self, named: Ids) -> tuple[Ids, ...]:
        """Of the named set with causes that are held to be at work the most probable, if it exceeds the named one."""
        found = [ids for ids in self._as_held(named) if ids in self.samples and self.odds(ids, named) > 1.0]
        return tuple(sorted(found, key=lambda ids: -self.odds(ids, named))[:1])

    def _as_held(self, named: Ids) -> list[Ids]:
        """The named set with each cause that is held to be at work, and with all of those that make it more probable.

        Left out is what an estimate says to be improbable, and what is reported by itself. No set has more causes than
        one may have; the likeliest come first.
        """

        def with_them(*more: str) -> Ids:
            return tuple(id for id in self.beliefs if id in {*named, *more})

        def possible(ids: Ids) -> bool:
            least = 1.0 if ids in self.samples else _LEAST
            return ids not in self.log_evidence or self.odds(ids, named) >= least

        held = sorted((id for id in self.held if id not in named), key=lambda id: -self.beliefs[id])
        some = [id for id in held if possible(with_them(id))][: max(self.most_causes - len(named), 0)]
        sets = [with_them(id) for id in some]
        if len(some) > 1 and all(ids in self.samples for ids in sets):
            sets.append(with_them(*some))
        return [ids for ids in sets if possible(ids) and ids not in self._reported(named)]

    def _reported(self, named: Ids) -> tuple[Ids, ...]:
        """Sets that are reported for their own probability, next to the named one."""
        return self.needed(named) if named else self.likely

    def _favoured(self, named: Ids, most: int = 4) -> list[Ids]:
        """As of `counted_with`, those of which an estimate alone says so among them; `most`, the likeliest first."""
        own, reported = self.log_evidence[named], self._reported(named)
        odds = {
            ids: self.odds(ids, named)
            for ids, evidence in self.log_evidence.items()
            if set(ids) > set(named) and ids not in reported and 0.0 < evidence - own < self.visible
        }
        return sorted((ids for ids in odds if odds[ids] >= _LEAST), key=lambda ids: -odds[ids])[:most]

    def quantiles(self, ids: Ids, q: Sequence[float]) -> FloatArray:
        """Quantiles of a model's parameters, (len(q), n_dim), in their units; its mode where it was not sampled."""
        problem, found = self.of(ids).problem, self.samples.get(ids)
        if found is None:
            return np.repeat(problem.to_physical(self.of(ids).modes[:1]), len(q), axis=0)
        return found.quantiles(problem.to_physical(found.draws), q)

    def gain(self, ids: Ids) -> float:
        """Log likelihood of a model above the baseline's, both at their posteriors' tops, nats."""
        return self.of(ids).log_likelihood - self.baseline.log_likelihood


def beliefs(catalogue: Sequence[Term]) -> dict[str, float]:
    """How probable each cause of a catalogue is to be at work, before any reading."""
    return {t.id: t.probability for t in catalogue}


def log_prior(ids: Ids, beliefs: Mapping[str, float]) -> float:
    """Log prior probability of a set: that its causes are at work, and no other of the catalogue."""
    return sum(math.log(p) if id in ids else math.log1p(-p) for id, p in beliefs.items())


def at_even_odds(beliefs: Mapping[str, float]) -> dict[str, float]:
    """Causes that are more probable than not count as even: what is likely before any reading is no find of them."""
    return {id: min(p, 0.5) for id, p in beliefs.items()}


def completed(
    mass: Mapping[Ids, float],
    log_evidence: Mapping[Ids, float],
    beliefs: Mapping[str, float],
    *,
    likely: float = 0.5,
    most: int = 8,
    far: float = 25.0,
) -> dict[Ids, float]:
    """Log masses of sets, each with its supersets that were not fitted: by any cause, and by several that are likely.

    A search fits the neighbours of what leads. Without this, what leads would have the mass of those supersets, and its
    rivals would not. In them a cause is taken to change the evidence as it did in the most similar part that was fitted
    with it and without, and to raise it by nothing. Each superset counts once: with a set that lacks none but likely
    causes, if there is one, and of several with the largest.

    Parameters
    ----------
    mass : mapping
        Log posterior probability of each set that was fitted, not normalised.
    log_evidence : mapping
    beliefs : mapping
        Prior probabilities by which `mass` was worked out.
    likely : float
        Probability from which causes are added together, too.
    most : int
        Of them at most, the likeliest.
    far : float, nats
        Sets this far below the best are left as they are.
    """
    fitted = {frozenset(ids): ids for ids in mass}
    odds = {id: math.log(p) - math.log1p(-p) for id, p in beliefs.items()}
    likely_ones = sorted((id for id, p in beliefs.items() if p >= likely), key=lambda id: -beliefs[id])
    # Of each cause the sets that were fitted with it and without, the largest first.
    pairs: dict[str, list[tuple[frozenset[str], float]]] = {id: [] for id in beliefs}
    for part in sorted(fitted, key=lambda s: (-len(s), -mass[fitted[s]])):
        for id in beliefs:
            if id not in part and (larger := part | {id}) in fitted:
                pairs[id].append((part, min(log_evidence[fitted[larger]] - log_evidence[fitted[part]], 0.0)))
    top, parent = max(mass.values()), dict[frozenset[str], tuple[int, int, float, Ids]]()
    for own, ids in fitted.items():
        if mass[ids] < top - far:
            continue
        # In the catalogue's order: sums in that of a set would end on other last digits in another process.
        left = [id for id in beliefs if id not in own]
        gain = {id: odds[id] + next((c for part, c in pairs[id] if part <= own), 0.0) for id in left}
        together = [id for id in likely_ones[:most] if id in gain]
        added: list[tuple[str, ...]] = [(id,) for id in gain]
        added += [more for n in range(2, len(together) + 1) for more in itertools.combinations(together, n)]
        for more in added:
            larger = own.union(more)
            if larger not in fitted:
                value = mass[ids] + sum(gain[id] for id in more)
                found = (-sum(id not in likely_ones for id in more), -len(more), value, ids)
                parent[larger] = max(parent.get(larger, found), found)
    total = dict(mass)
    for _, _, value, ids in parent.values():
        total[ids] = float(np.logaddexp(total[ids], value))
    return total


def rank(
    searched: Searched[Fitted],
    beliefs: Mapping[str, float],
    settings: SearchSettings,
    effects: Effective = lambda wanted: {},
    *,
    held: Sequence[str] = (),
    shakes: int = 400,
) -> ModelSet:
    """Posterior probabilities of the models; where a cause does not show, they count as the models without it.

    Parameters
    ----------
    searched : Searched
    beliefs : mapping
    settings : SearchSettings
    effects : callable
        Works out what the causes of some of the sets do; without it all of them show.
    held : sequence of str
        As of `ModelSet`.
    shakes : int
        Evidences are known with an error: probabilities are averaged over so many draws of it.
    """
    value = {ids: searched.models[ids].log_evidence for ids in sorted(searched.models, key=sorted)}
    samples = {ids: m.content.draws for ids, m in searched.models.items() if m.content.draws is not None}
    error = np.array([samples[ids].standard_error if ids in samples else settings.doubt for ids in value])
    shaken = error * np.random.default_rng(0).standard_normal((shakes, len(value)))
    seen: dict[Ids, Effects] = {}

    def asked(wanted: Sequence[Ids]) -> dict[Ids, Effects]:
        seen.update(effects([ids for ids in wanted if ids not in seen]))
        return {ids: seen[ids] for ids in wanted if ids in seen}

    def shares(mass: Mapping[Ids, float], believed: Mapping[str, float]) -> tuple[dict[Ids, float], dict[Ids, float]]:
        whole = completed(mass, value, believed)
        each = np.array(list(whole.values())) + shaken
        chances = np.exp(each - logsumexp(each, axis=1, keepdims=True)).mean(axis=0)
        share = dict(zip(whole, chances.tolist(), strict=True))
        own = {ids: p * math.exp(mass[ids] - whole[ids]) for ids, p in share.items()}
        return own, shown(share, whole, asked)

    mass = {ids: v + log_prior(ids, beliefs) for ids, v in value.items()}
    at_work, share = shares(mass, beliefs)
    even = at_even_odds(beliefs)
    _, found = shares({ids: v + log_prior(ids, even) for ids, v in value.items()}, even)
    best = max(samples, key=lambda ids: (found[ids], mass[ids]))
    order = sorted(mass, key=lambda ids: (ids != best, -share[ids], -mass[ids]))
    return ModelSet(
        candidates=tuple(searched.models[ids].content.candidate for ids in order),
        probability={ids: share[ids] for ids in order},
        log_evidence=value,
        samples=samples,
        beliefs=beliefs,
        missed=settings.missed,
        visible=settings.visible,
        neighbours=searched.whole,
        held=tuple(held),
        most_causes=settings.most_causes,
        at_work=at_work,
    )

"""The search itself, which knows nothing of readings: best first, until no model is left within the window.

Every known model has an estimate of its log posterior probability. The model with the highest estimate that was not
sampled yet is sampled, and its neighbours, which have one cause more, one less or one exchanged, are fitted. The search
ends when no model that shows is left whose estimate comes within the window of the best; a model shows that exceeds
every part of itself. (Those that are reported for their probability, though they do not show, are sampled then, too.)

"Step by step" in docs/diagnosis.md says what is fitted when, and what would be missed without.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

from psafit.errors import ConvergenceError
from psafit.model_search.settings import SearchSettings
from psafit.text import count, set_name

Ids = tuple[str, ...]
# Kinds of neighbours: those no larger, and those larger.
_KINDS = 2
Content = TypeVar("Content")


@dataclass(frozen=True)
class Model(Generic[Content]):
    """One set of causes, and what is known of it.

    Parameters
    ----------
    ids : tuple of str
        Its causes, in the catalogue's order.
    log_evidence : float, nats
        Of a short fit by Laplace's approximation of its largest mode, of a sampled model by importance sampling. In the
        result of a search that of a short fit is corrected by what sampling has shown Laplace to be off by in its
        largest sampled part, whose other modes it is taken to have.
    log_posterior : float
        Log posterior density at the highest optimum known: of a model that rises by more than a setting says, the
        neighbours are looked at again.
    sampled : bool
    content : object
        The fit, for whoever made it.
    laplace_off : float, nats
        Of a sampled model: what Laplace's approximation of its largest mode exceeds its evidence by.
    earnest : bool
        Whether it was fitted with the work that a model takes which is sampled.
    least : float, nats
        Of a model that has risen since it was sampled: the log evidence that was found then.
    """

    ids: Ids
    log_evidence: float
    log_posterior: float
    sampled: bool
    content: Content
    laplace_off: float = 0.0
    earnest: bool = False
    least: float = -math.inf


@dataclass(frozen=True)
class Foreseen(Generic[Content]):
    """What a search asks for next if nothing changes; idle processes may begin it.

    Parameters
    ----------
    models : tuple of Model
        Which it samples, the next one first.
    sets : tuple of Ids
        Which are fitted from where others have their optima.
    known : mapping
        Every model fitted.
    """

    models: tuple[Model[Content], ...]
    sets: tuple[Ids, ...]
    known: Mapping[Ids, Model[Content]]


class Fitter(Protocol[Content]):
    """What fits and samples models."""

    def short(self, wanted: Sequence[Ids], known: Mapping[Ids, Model[Content]]) -> list[Model[Content]]:
        """Fit models."""

    def carried(self, wanted: Sequence[Ids], known: Mapping[Ids, Model[Content]]) -> list[Model[Content]]:
        """Fit models from where others have their optima, at a part of the cost."""

    def again(self, known: Sequence[Model[Content]], origin: Model[Content]) -> list[Model[Content]]:
        """Fit known models from where a neighbour has its optimum; only those that rise come back."""

    def earnest(self, model: Model[Content], foreseen: Foreseen[Content] | None = None) -> Model[Content]:
        """Fit a model as one that is sampled. The result does not depend on what is foreseen."""

    def sample(self, model: Model[Content], foreseen: Foreseen[Content] | None = None) -> Model[Content]:
        """Sample a model. The result does not depend on what is foreseen."""


@dataclass(frozen=True)
class Searched(Generic[Content]):
    """What a search has looked at.

    Parameters
    ----------
    models : dict
        Every model fitted, by its causes.
    expanded : frozenset
        Those of which the neighbours were fitted: all of them, or all that may come near.
    whole : bool
        Whether all neighbours were fitted of every model that shows within the window, those beyond the most causes
        that a set may have among them.
    """

    models: Mapping[Ids, Model[Content]]
    expanded: frozenset[Ids]
    whole: bool


def reduced(ids: Ids) -> list[Ids]:
    """Return the sets with one cause less, in the order of what they lack."""
    return [tuple(other for other in ids if other != id) for id in ids]


def exchanged(ids: Ids, catalogue: Sequence[str]) -> list[Ids]:
    """Return the sets with one cause less, and with another in its place, in the catalogue's order."""
    others = [id for id in catalogue if id not in ids]
    less = [{*ids} - {one} for one in ids]
    return _ordered([*less, *(few | {more} for few in less for more in others)], catalogue)


def enlarged(ids: Ids, catalogue: Sequence[str], most: int) -> list[Ids]:
    """Return the sets with one cause more, in the catalogue's order."""
    return _ordered([{*ids, id} for id in catalogue if id not in ids] if len(ids) < most else [], catalogue)


def _ordered(sets: Sequence[set[str]], catalogue: Sequence[str]) -> list[Ids]:
    return [tuple(id for id in catalogue if id in one) for one in sets]


@dataclass(frozen=True, eq=False)
class _Known(Generic[Content]):
    """What a search knows while it goes on; the first four are as of `search`."""

    catalogue: Sequence[str]
    fitter: Fitter[Content]
    log_prior: Callable[[Ids], float]
    settings: SearchSettings
    # Every model fitted, and how many of the kinds of its neighbours were: those no larger, and those larger.
    models: dict[Ids, Model[Content]] = field(default_factory=dict)
    done: dict[Ids, int] = field(default_factory=dict)
    # The same of those without a cause that the best has, the larger first.
    detoured: dict[tuple[str, Ids], int] = field(default_factory=dict)
    # Those that got all neighbours without leading, and those that could not be sampled, and keep their estimate.
    widened: set[Ids] = field(default_factory=set)
    unsampled: set[Ids] = field(default_factory=set)

    def _parts(self, model: Model[Content]) -> list[Model[Content]]:
        subsets = (ids for n in range(len(model.ids)) for ids in itertools.combinations(model.ids, n))
        return [self.models[ids] for ids in subsets if ids in self.models]

    def evidence(self, model: Model[Content]) -> float:
        """Log evidence, nats; that of a short fit is corrected by its largest sampled part."""
        if model.sampled:
            return model.log_evidence
        sampled = [m for m in self._parts(model) if m.sampled]
        known = max(sampled, key=lambda m: (len(m.ids), m.log_evidence), default=None)
        return max(model.log_evidence - (known.laplace_off if known else 0.0), model.least)

    def value(self, model: Model[Content]) -> float:
        """Log posterior probability, nats, not normalised."""
        return self.evidence(model) + self.log_prior(model.ids)

    def shows(self, model: Model[Content], errors: float = 2.0) -> bool:
        """Whether it exceeds every part of itself, if its estimate falls short by so many standard errors."""
        slack = 0.0 if model.sampled else errors * self.settings.doubt
        highest = max(map(self.evidence, self._parts(model)), default=-math.inf)
        return self.evidence(model) + slack > highest + self.settings.visible

    def complete(self, model: Model[Content], best: float) -> bool:
        """Whether it has its neighbours, or need not have them, since it does not come near the best."""
        return self.value(model) < best - self.settings.window or self.done[model.ids] == _KINDS

    def comes_near(self, model: Model[Content], best: float) -> bool:
        """Whether it comes within the window of the best, if its fit falls short by as much as it may."""
        s = self.settings
        slack = 0.0 if model.sampled or model.earnest else s.short_by
        return self.value(model) >= best - s.window - slack

    def keep(self, found: Sequence[Model[Content]]) -> None:
        """Keep models that were fitted."""
        for model in found:
            self.models[model.ids] = model
            self.done[model.ids] = 0

    def expand(self, model: Model[Content], highest: float) -> None:
        """Fit the next kind of a model's neighbours; of all models the best has the value `highest`."""
        s, larger, shows = self.settings, self.done[model.ids] > 0, self.shows(model)
        self.done[model.ids] += 1
        (wanted,) = self.wanted([model], highest, [larger])
        new = [ids for ids in wanted if ids not in self.models]
        self.keep(self.fitter.again([self.models[ids] for ids in wanted if ids in self.models], model))
        few = s.most_causes if self.value(model) >= highest else s.from_prior
        fully = [ids for ids in new if (shows and len(ids) <= few if larger else len(ids) < len(model.ids))]
        carried = self.carry([ids for ids in new if ids not in fully])
        least = max(self.value(m) for m in self.models.values() if self.shows(m)) - s.window - 2.0 * s.short_by
        near = [m for m in carried if self.value(m) >= least and ((shows and not larger) or self.shows(m))]
        self.keep(self.fitter.short([*fully, *(m.ids for m in near)], self.models))

    def wanted(
        self, models: Sequence[Model[Content]], highest: float, larger: Sequence[bool] = (False, True)
    ) -> list[list[Ids]]:
        """Return the neighbours to fit of each model; of one that shows and does not lead those that may come near."""
        most = self.settings.most_causes
        both = [(exchanged(m.ids, self.catalogue), enlarged(m.ids, self.catalogue, most)) for m in models]
        found = [[ids for kind in larger for ids in kinds[kind]] for kinds in both]
        leads = [self.value(m) >= highest or m.ids in self.widened or not self.shows(m) for m in models]
        follow = {ids for sets, first in zip(found, leads, strict=True) if not first for ids in sets}
        left = self.promising(follow, highest)
        return [[ids for ids in sets if first or ids in left] for sets, first in zip(found, leads, strict=True)]

    def promising(self, wanted: set[Ids], highest: float) -> set[Ids]:
        """Sets that show and come near the highest, if a cause does as much there as anywhere it was fitted."""
        if not wanted:
            return wanted
        s, most = self.settings, dict.fromkeys(self.catalogue, -math.inf)
        evidence = {ids: self.evidence(model) for ids, model in self.models.items()}
        for ids, model in self.models.items():
            parts = self._parts(model)
            for id in ids:
                without = max((evidence[part.ids] for part in parts if id not in part.ids), default=math.inf)
                most[id] = max(most[id], evidence[ids] - without)

        def hoped(ids: Ids) -> float:
            parts = zip(ids, reduced(ids), strict=True)
            reached = [evidence[part] + most[id] for id, part in parts if part in evidence]
            return min(reached, default=math.inf) + self.log_prior(ids)

        shows = {id for id in most if most[id] + 2.0 * s.doubt > s.visible}
        return {ids for ids in wanted if shows >= {*ids} and hoped(ids) >= highest - s.window - s.short_by}

    def overlooked(self, near: Sequence[Model[Content]], highest: float) -> list[Model[Content]]:
        """Models of which a neighbour promises more than it did when theirs were fitted."""
        wanted = zip(near, self.wanted(near, highest), strict=True)
        return [model for model, sets in wanted if not self.models.keys() >= {*sets}]

    def worth_pairing(self) -> list[str]:
        """Causes that show by themselves, or are more probable than not before any reading: they may show together."""
        none = self.log_prior(())
        alone = (m for m in self.models.values() if len(m.ids) == 1)
        return [m.ids[0] for m in alone if self.shows(m) or self.log_prior(m.ids) > none]

    def pairs(self, among: Sequence[str]) -> list[Ids]:
        """Pairs of some causes that were not fitted together, where sets may have two."""
        both = _ordered([{*two} for two in itertools.combinations(among, 2)], self.catalogue)
        return [ids for ids in both if ids not in self.models and len(ids) <= self.settings.most_causes]

    def carry(self, wanted: Sequence[Ids]) -> list[Model[Content]]:
        """Fit those that are not known from where others have their optima, and keep them."""
        found = self.fitter.carried([ids for ids in wanted if ids not in self.models], self.models)
        self.keep(found)
        return found

    def carry_up(self, wanted: Sequence[Ids], highest: float = -math.inf) -> None:
        """Carry sets, and fit like others those that show and come as near to the highest as they may fall short."""
        found = self.carry(wanted)
        least = max([highest, *map(self.value, found)]) - self.settings.short_by
        near = [m.ids for m in found if self.shows(m) and self.value(m) >= least]
        self.keep(self.fitter.short(near, self.models))

    def next_wide(self, best: Model[Content]) -> Model[Content] | None:
        """The next model that shows, has no more causes than the best, and may get its neighbours like it."""
        if len(best.ids) > self.settings.from_prior or len(self.widened) >= self.settings.widened:
            return None
        others = [m for m in self.models.values() if m is not best and len(m.ids) <= len(best.ids) and self.shows(m)]
        return max((m for m in others if m.ids and m.ids not in self.widened), key=self.value, default=None)

    def widen(self, model: Model[Content], highest: float) -> None:
        """Fit all neighbours of a model; of all models the best has the value `highest`."""
        self.widened.add(model.ids)
        self.done[model.ids] = 0
        for _ in range(_KINDS):
            self.expand(model, highest)

    def detour(self, best: Model[Content]) -> bool:
        """Go a step up from the best model without a cause of the best of all; False where each way has ended."""
        if len(best.ids) <= self.settings.from_prior:
            return False
        most = min(len(best.ids) + self.settings.detour, self.settings.most_causes)
        small = [m for m in self.models.values() if len(m.ids) <= most]
        without = {id: max((m for m in small if id not in m.ids), key=self.value) for id in best.ids}
        ways = [(id, m, self.detoured.get((id, m.ids), 0)) for id, m in without.items()]
        left = [way for way in ways if way[2] < _KINDS]
        if not left:
            return False
        needed, origin, taken = min(left, key=lambda way: self.value(way[1]))
        self.detoured[needed, origin.ids] = taken + 1
        others = [id for id in self.catalogue if id != needed]
        wanted = exchanged(origin.ids, others) if taken else enlarged(origin.ids, others, most)
        self.carry_up(wanted, self.value(origin))
        return True

    def sample(self, best: Model[Content], others: Sequence[Model[Content]], highest: float) -> None:
        """Sample a model, or fit it in earnest; the others are those of which that is foreseen."""
        within = self.value(best) >= highest - self.settings.window
        later = [m for m in (best, *others) if not self.done[m.ids]]
        wanted = zip(later, self.wanted(later, highest, [False]), strict=True)
        sets = dict.fromkeys(ids for m, theirs in wanted for ids in theirs if len(ids) == len(m.ids))
        new = tuple(ids for ids in sets if ids not in self.models)
        foreseen = Foreseen(tuple(m for m in others if not m.sampled), new, self.models)
        fully = within or best.earnest or len(best.ids) <= self.settings.from_prior
        work = self.fitter.sample if fully else self.fitter.earnest
        self.update(best, work(best, foreseen))

    def update(self, before: Model[Content], found: Model[Content]) -> None:
        """Keep what was found of a model; the neighbours of one that has risen are looked at again."""
        self.models[before.ids] = found
        if found.log_posterior > before.log_posterior + self.settings.better:
            self.done[before.ids] = 0

    def settle(self, wanted: Sequence[Ids]) -> bool:
        """Fit the first of some sets that was not fitted, or sample the first that was not; False where none is left.

        One keeps its estimate if no draw lies within its bounds.
        """
        if new := [ids for ids in wanted if ids not in self.models]:
            self.keep(self.fitter.short(new[:1], self.models))
            return True
        waiting = [self.models[ids] for ids in wanted if not self.models[ids].sampled and ids not in self.unsampled]
        if not waiting:
            return False
        first, *others = waiting
        try:
            self.update(first, self.fitter.sample(first, Foreseen(tuple(others), (), self.models)))
        except ConvergenceError:
            self.unsampled.add(first.ids)
        return True

    def searched(self) -> Searched[Content]:
        """What was looked at."""
        final = {ids: replace(m, log_evidence=self.evidence(m)) for ids, m in self.models.items()}
        shown = [m for m in self.models.values() if self.shows(m)]
        least, names = max(map(self.value, shown)) - self.settings.window, self.catalogue
        near = [m.ids for m in shown if self.value(m) >= least]
        wanted = (s for ids in near for s in (*exchanged(ids, names), *enlarged(ids, names, len(names))))
        expanded = frozenset(ids for ids, done in self.done.items() if done == _KINDS)
        return Searched(final, expanded, all(ids in final for ids in wanted))


def search(
    catalogue: Sequence[str],
    fitter: Fitter[Content],
    log_prior: Callable[[Ids], float],
    settings: SearchSettings | None = None,
    *,
    starts: Sequence[Ids] = (),
    passes: Callable[[Model[Content]], bool] = lambda model: True,
    decisive: Callable[[Searched[Content]], Sequence[Ids]] = lambda found: (),
    progress: Callable[[str], None] = lambda what: None,
) -> Searched[Content]:
    """Search the sets of a catalogue's causes; what is not said here is as of `psafit.model_search.search_models`.

    Parameters
    ----------
    log_prior : callable
        Log prior probability of a set.
    passes : callable
        Asked of one or two causes that lead, where others show or are expected, and of what leads in the end.
    decisive : callable
        Sets on which the answer rests. Asked in the end; those that were not sampled are, and the search goes on.
    """
    settings = settings or SearchSettings()
    known = _Known(catalogue, fitter, log_prior, settings)
    models, passes = known.models, functools.cache(passes)
    known.keep(fitter.short([()], models))
    models[()] = fitter.sample(models[()])
    known.keep(fitter.short([ids for ids in dict.fromkeys(starts) if ids], models))
    while True:
        shown = [m for m in models.values() if known.shows(m)]
        best_model = max(shown, key=known.value)
        highest = known.value(best_model)
        near = [m for m in shown if known.comes_near(m, highest)]
        left = [m for m in near if not m.sampled or not known.complete(m, highest)]
        progress(f"{set_name(best_model.ids)} leads; {count(len(models), 'set')} of causes tried")
        sure = known.shows(best_model, errors=0.0) and (best_model.sampled or len(best_model.ids) > settings.from_prior)
        whole = known.complete(best_model, highest)
        small = len(best_model.ids) == 2 or (len(best_model.ids) == 1 and whole)
        if sure and small and (pairs := known.pairs(known.worth_pairing())) and not passes(best_model):
            known.carry_up(pairs)
            continue
        if sure and not whole:
            known.expand(best_model, highest)
            continue
        if not left:
            within = [m for m in near if known.value(m) >= highest - settings.window]
            if again := known.overlooked(within, highest):
                known.done.update((m.ids, 0) for m in again)
                continue
            if not best_model.ids and (pairs := known.pairs(catalogue)) and not passes(best_model):
                known.carry_up(pairs)
                continue
            if known.detour(best_model):
                continue
            if (other := known.next_wide(best_model)) is not None and not passes(best_model):
                known.widen(other, highest)
                continue
            result = known.searched()
            if known.settle(decisive(result)):
                continue
            return result
        best, *others = sorted(left, key=lambda m: (m.sampled and known.done[m.ids], -known.value(m), m.ids))
        if best.sampled:
            known.expand(best, highest)
        else:
            known.sample(best, others, highest)

"""The search itself, which knows nothing of readings: best first, until no model is left within the window.

Three sentences say what it does. Every known model has an estimate of its log posterior probability. The model with the
highest estimate that was not sampled yet is sampled, and its neighbours, which have one cause more, one less or one
exchanged, are fitted. The search ends when no model that shows is left whose estimate comes within the window of the
best; a model shows that exceeds every part of itself.

What costs much waits. The best of all models gets its neighbours before it is sampled, if it shows for certain: one of
them may leave it behind. Exchanges are many; they wait until no model within the window lacks its neighbours of one
cause more or less. They are fitted from where others have their optima, which is good to a window: those that come
within two of the best are fitted like all others.

Two causes may show together and neither alone. Where no cause shows, and yet the tests of misfit fail, each cause gets
its neighbours, though it does not show.

(Occam's window: D. Madigan and A. E. Raftery, J. Am. Stat. Assoc. 89 (1994) 1535; best-first over neighbours: C. Hans,
A. Dobra and M. West, J. Am. Stat. Assoc. 102 (2007) 507.)
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, Protocol, TypeVar

from psafit.model_search.settings import SearchSettings

Ids = tuple[str, ...]
Content = TypeVar("Content")


@dataclass(frozen=True)
class Model(Generic[Content]):
    """One set of causes, and what is known of it.

    Parameters
    ----------
    ids : tuple of str
        Its causes, in the catalogue's order.
    log_evidence : float, nats
        Of a short fit by Laplace's approximation, of a sampled model by importance sampling. In the result of a search
        that of a short fit is corrected by what sampling has shown Laplace to be off by in its largest sampled part.
    height : float
        Log posterior density at the highest optimum known: of a model that rises by more than a setting says, the
        neighbours are looked at again.
    sampled : bool
    content : object
        The fit, for whoever made it.
    """

    ids: Ids
    log_evidence: float
    height: float
    sampled: bool
    content: Content


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
        Those of which every neighbour was fitted.
    """

    models: Mapping[Ids, Model[Content]]
    expanded: frozenset[Ids]


def search(
    catalogue: Sequence[str],
    fitter: Fitter[Content],
    log_prior: Callable[[Ids], float],
    settings: SearchSettings | None = None,
    *,
    starts: Sequence[Ids] = (),
    passes: Callable[[Model[Content]], bool] = lambda model: True,
    progress: Callable[[str, int, int], None] = lambda what, done, total: None,
) -> Searched[Content]:
    """Search the sets of a catalogue's causes.

    Parameters
    ----------
    catalogue : sequence of str
    fitter : Fitter
    log_prior : callable
        Log prior probability of a set.
    settings : SearchSettings, optional
    starts : sequence of sets
        Models to fit before all else, beside the one without causes.
    passes : callable
        Whether the readings pass the tests of misfit by a model. Asked of the one without causes, if it leads in the
        end.
    progress : callable
        Called with (what, models whose neighbours were fitted, models of which they are to be).
    """
    settings = settings or SearchSettings()
    models: dict[Ids, Model[Content]] = {}
    # How many of the kinds of neighbours of a model were fitted: those of one cause more or less first, then exchanged.
    kinds = (resized, exchanged)
    done: dict[Ids, int] = {}
    passes = functools.cache(passes)

    estimates: dict[Ids, float] = {}

    def parts(model: Model[Content]) -> list[Model[Content]]:
        subsets = (ids for n in range(len(model.ids)) for ids in itertools.combinations(model.ids, n))
        return [models[ids] for ids in subsets if ids in models]

    def evidence(model: Model[Content]) -> float:
        if model.sampled:
            return model.log_evidence
        sampled = [m for m in parts(model) if m.sampled]
        known = max(sampled, key=lambda m: (len(m.ids), m.log_evidence), default=None)
        return model.log_evidence + (known.log_evidence - estimates[known.ids] if known else 0.0)

    def value(model: Model[Content]) -> float:
        return evidence(model) + log_prior(model.ids)

    def shows(model: Model[Content], errors: float = 2.0) -> bool:
        slack = 0.0 if model.sampled else errors * settings.doubt
        return evidence(model) + slack > max(map(evidence, parts(model)), default=-math.inf) + settings.visible

    def keep(found: Sequence[Model[Content]]) -> None:
        for model in found:
            models[model.ids] = model
            estimates[model.ids] = model.log_evidence
            done[model.ids] = 0

    keep(fitter.short([()], models))
    models[()] = fitter.sample(models[()])
    keep(fitter.short([ids for ids in dict.fromkeys(starts) if ids], models))

    def expand(model: Model[Content]) -> None:
        neighbours = kinds[done[model.ids]]
        done[model.ids] += 1
        wanted = neighbours(model.ids, catalogue, settings.most_causes)
        new = [ids for ids in wanted if ids not in models]
        keep(fitter.again([models[ids] for ids in wanted if ids in models], model))
        if neighbours is exchanged:
            found = fitter.carried(new, models)
            least = max(value(m) for m in models.values() if shows(m)) - 2 * settings.window
            new = [m.ids for m in found if value(m) >= least]
            keep(found)
        keep(fitter.short(new, models))

    while True:
        shown = [m for m in models.values() if shows(m)]
        leader = max(shown, key=value)
        least = value(leader) - settings.window
        near = [m for m in shown if value(m) >= least]
        left = [m for m in near if not m.sampled or done[m.ids] < len(kinds)]
        if not left:
            single = [m for m in models.values() if len(m.ids) == 1 and value(m) >= least and not done[m.ids]]
            if leader.ids or not single or passes(leader):
                final = {ids: replace(m, log_evidence=evidence(m)) for ids, m in models.items()}
                return Searched(final, frozenset(ids for ids, n in done.items() if n == len(kinds)))
            left = single
        best, *others = sorted(left, key=lambda m: (m.sampled and done[m.ids], -value(m), m.ids))
        name = " + ".join(best.ids) or "the baseline"
        progress(f"{name}; {len(models)} models fitted", len(near) - len(left), len(near))
        certain = best is leader and shows(best, errors=0.0)
        if best.sampled or (not done[best.ids] and (certain or best not in near)):
            expand(best)
            continue
        later = [m for m in (best, *others) if done[m.ids]]
        sets = dict.fromkeys(ids for m in later for ids in exchanged(m.ids, catalogue, settings.most_causes))
        foreseen = Foreseen(
            tuple(m for m in others if not m.sampled), tuple(ids for ids in sets if ids not in models), models
        )
        models[best.ids] = sampled = fitter.sample(best, foreseen)
        if sampled.height > best.height + settings.better:
            done[best.ids] = 0


def resized(ids: Ids, catalogue: Sequence[str], most: int) -> list[Ids]:
    """Return the sets with one cause more or one less, in the catalogue's order."""
    more = [{*ids, other} for other in catalogue if other not in ids] if len(ids) < most else []
    return _ordered([*more, *({*ids} - {less} for less in ids)], catalogue)


def exchanged(ids: Ids, catalogue: Sequence[str], most: int) -> list[Ids]:
    """Return the sets with another cause in the place of one, in the catalogue's order."""
    others = [id for id in catalogue if id not in ids]
    return _ordered([{*ids} - {less} | {more} for less in ids for more in others], catalogue)


def _ordered(sets: Sequence[set[str]], catalogue: Sequence[str]) -> list[Ids]:
    return [tuple(id for id in catalogue if id in one) for one in sets]

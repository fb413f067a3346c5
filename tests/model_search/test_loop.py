"""The search on models without readings, whose evidences are known."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from psafit.errors import ConvergenceError
from psafit.model_search.loop import Foreseen, Ids, Model, Searched, _Known, enlarged, exchanged, search
from psafit.model_search.settings import SearchSettings

CATALOGUE = tuple("abcdefgh")
Evidence = Callable[[Ids], float]


def flat(ids: Ids) -> float:
    return -2.0 * len(ids)


class Fake:
    """Fits that know the evidence: a short one less or more an error, a sample exactly."""

    def __init__(self, evidence: Evidence, error: Evidence = lambda ids: 0.0, carrying: float = 0.0) -> None:
        self.evidence, self.error, self.carrying = evidence, error, carrying
        self.fitted: list[Ids] = []
        self.carried_over: list[Ids] = []
        self.fitted_in_earnest: list[Ids] = []
        self.sampled: list[Ids] = []

    def short(self, wanted: Sequence[Ids], known: Mapping[Ids, Model[None]]) -> list[Model[None]]:
        assert not set(wanted) & (set(known) - set(self.carried_over))
        self.fitted += wanted
        return [Model(ids, self.evidence(ids) + self.error(ids), 0.0, False, None) for ids in wanted]

    def carried(self, wanted: Sequence[Ids], known: Mapping[Ids, Model[None]]) -> list[Model[None]]:
        assert not set(wanted) & set(known)
        self.carried_over += wanted
        return [Model(ids, self.evidence(ids) + self.error(ids) - self.carrying, 0.0, False, None) for ids in wanted]

    def again(self, known: Sequence[Model[None]], origin: Model[None]) -> list[Model[None]]:
        return []

    def earnest(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
        assert not model.earnest
        self.fitted_in_earnest.append(model.ids)
        return replace(model, log_evidence=self.evidence(model.ids), earnest=True)

    def sample(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
        self.sampled.append(model.ids)
        return Model(model.ids, self.evidence(model.ids), 0.0, True, None, self.error(model.ids))


def every_set(most: int = len(CATALOGUE)) -> list[Ids]:
    return [ids for n in range(most + 1) for ids in itertools.combinations(CATALOGUE, n)]


def additive(gains: Mapping[str, float]) -> Evidence:
    return lambda ids: sum(gains.get(id, -1.0) for id in ids)


def test_nothing_hidden_costs_one_fit_a_cause() -> None:
    fake = Fake(additive({}))
    found = search(CATALOGUE, fake, flat)
    assert fake.sampled == [()]
    assert sorted(fake.fitted) == sorted([(), *((id,) for id in CATALOGUE)])
    assert found.expanded == {()}


def test_causes_that_add_up_are_all_found() -> None:
    fake = Fake(additive({"b": 30.0, "e": 20.0, "g": 15.0}))
    found = search(CATALOGUE, fake, flat)
    best = max(found.models.values(), key=lambda m: m.log_evidence + flat(m.ids))
    assert best.ids == ("b", "e", "g") and best.sampled and best.ids in found.expanded


def test_many_causes_that_do_as_well_as_many_others_are_found() -> None:
    """What leads from the first step on is no part of what leads in the end."""
    families = ({"a": 60.0, "b": 20.0, "c": 15.0}, {"d": 50.0, "e": 15.0, "f": 15.0, "g": 30.0})
    evidence: Evidence = lambda ids: max(additive(gains)(ids) for gains in families)  # noqa: E731
    fake = Fake(evidence)
    found = search(CATALOGUE, fake, flat)
    assert found.models["d", "e", "f", "g"].sampled and ("d", "e", "f", "g") in found.expanded
    small = SearchSettings(from_prior=3)
    assert ("d", "e", "f", "g") not in search(CATALOGUE, Fake(evidence), flat, small).models


def test_what_is_left_behind_on_the_way_up_is_not_sampled() -> None:
    fake = Fake(additive({"b": 40.0, "e": 30.0, "g": 25.0, "h": 20.0}))
    search(CATALOGUE, fake, flat)
    # But where draws of the prior may show what a short fit has missed.
    assert fake.sampled == [(), ("b",), ("b", "e"), ("b", "e", "g", "h")]


def test_what_a_short_fit_is_off_by_is_not_taken_for_a_cause() -> None:
    """Laplace flatters "a", and every set with it, by 4 nats; once "a" is sampled nothing added to it shows."""
    fake = Fake(additive({"a": 1.0}), error=lambda ids: 4.0 * ("a" in ids))
    found = search(CATALOGUE, fake, flat, starts=[("a",), ("a", "b")])
    assert fake.sampled == [(), ("a",)] and found.expanded == {()}
    assert found.models["a", "b"].log_evidence == pytest.approx(0.0)


def test_what_decides_is_sampled_though_the_search_need_not_go_on_from_it() -> None:
    def decisive(found: Searched[None]) -> list[Ids]:
        return [ids for ids, model in found.models.items() if model.log_evidence > 19.5]

    def fake() -> Fake:
        return Fake(additive({"a": 20.0}), error=lambda ids: 1.9 * (ids == ("a", "b")))

    alone, asked = fake(), fake()
    assert search(CATALOGUE, alone, flat).models["a", "b"].log_evidence == pytest.approx(20.9)
    assert search(CATALOGUE, asked, flat, decisive=decisive).models["a", "b"].log_evidence == 19.0
    assert asked.sampled == [*alone.sampled, ("a", "b")]


def test_what_decides_and_was_not_fitted_is_fitted_first() -> None:
    large, fake = ("a", "e", "f", "g"), Fake(additive({"a": 20.0}))
    found = search(CATALOGUE, fake, flat, decisive=lambda found: [("a",), large])
    assert found.models[large].sampled and fake.sampled[-1] == large
    assert large not in search(CATALOGUE, Fake(additive({"a": 20.0})), flat).models


def test_what_decides_and_cannot_be_sampled_keeps_its_estimate() -> None:
    class Stuck(Fake):
        def sample(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
            if model.ids == ("a", "b"):
                raise ConvergenceError("no draw lies within the bounds", reached=0.0, required=1.0)
            return super().sample(model, foreseen)

    fake = Stuck(additive({"a": 20.0}), error=lambda ids: 1.9 * (ids == ("a", "b")))
    found = search(CATALOGUE, fake, flat, decisive=lambda found: [("a", "c"), ("a", "b"), ("a",)])
    assert found.models["a", "c"].sampled and not found.models["a", "b"].sampled
    assert found.models["a", "b"].log_evidence == pytest.approx(20.9)


def test_a_model_that_has_risen_since_it_was_sampled_has_no_less_evidence() -> None:
    """Of a short fit Laplace's error is taken off, of what importance sampling has found nothing is."""
    part = Model(("a",), 20.0, 20.0, True, None, laplace_off=4.0)
    whole = Model(("a", "b"), 10.0, 10.0, False, None)
    known = _Known(CATALOGUE, Fake(additive({})), flat, SearchSettings(), {part.ids: part})
    assert [known.evidence(replace(whole, least=least)) for least in (-math.inf, 5.0, 9.0)] == [6.0, 6.0, 9.0]


def test_a_baseline_that_a_short_fit_missed_makes_no_cause_show() -> None:
    """What the sampled baseline rises by is no error of Laplace's, and its neighbours were fitted from its new top."""

    class Low(Fake):
        def sample(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
            return replace(super().sample(model, foreseen), laplace_off=0.0)

    fake = Low(additive({}), error=lambda ids: 0.0 if ids else -100.0)
    assert search(CATALOGUE, fake, flat).expanded == {()} and fake.sampled == [()]


def test_what_shows_perhaps_is_sampled_before_its_neighbours_are_fitted() -> None:
    perhaps, surely = Fake(additive({"a": 3.9 - 1.0})), Fake(additive({"a": 20.0}))
    for fake in (perhaps, surely):
        search(CATALOGUE, fake, lambda ids: 0.0)
    assert perhaps.sampled == [(), ("a",)] and len(perhaps.fitted) == 1 + len(CATALOGUE)
    assert surely.sampled == [(), ("a",)] and len(surely.fitted) == 2 * len(CATALOGUE)


def test_two_causes_of_which_neither_shows_alone_are_looked_for_where_the_tests_fail() -> None:
    together = {frozenset("cf"): 25.0}
    evidence: Evidence = lambda ids: max((v for s, v in together.items() if s <= {*ids}), default=0.0) - len(ids)  # noqa: E731
    asked: list[Ids] = []

    def passes(model: Model[None]) -> bool:
        asked.append(model.ids)
        return bool(model.ids)

    found = search(CATALOGUE, Fake(evidence), flat, passes=passes)
    assert found.models["c", "f"].sampled and ("c", "f") in found.expanded
    assert asked == [()]  # and no more, once something shows
    assert ("c", "f") not in search(CATALOGUE, Fake(evidence), flat).models


def test_of_all_pairs_those_that_come_near_the_best_of_them_are_fitted_like_others() -> None:
    evidence = {("c", "f"): 20.0, ("b", "g"): 16.0, ("a", "d"): 12.0}
    fake = Fake(lambda ids: evidence.get(ids, -1.0 * len(ids)))
    search(CATALOGUE, fake, flat, passes=lambda model: bool(model.ids))
    assert {*evidence} <= {*fake.carried_over}
    assert {*evidence} & {*fake.fitted} == {("c", "f"), ("b", "g")}


def test_a_search_that_nothing_satisfies_ends() -> None:
    found = search(CATALOGUE, Fake(additive({})), flat, passes=lambda model: False)
    assert set(found.models) == {ids for ids in every_set(2)}
    found = search(CATALOGUE, Fake(additive({"a": 20.0})), flat, passes=lambda model: False)
    assert max(map(len, found.models)) == 2
    single = SearchSettings(most_causes=1)
    found = search(CATALOGUE, Fake(additive({})), flat, single, passes=lambda model: False)
    assert max(map(len, found.models)) == 1


def test_a_model_that_rises_when_it_is_sampled_takes_its_neighbours_along() -> None:
    """Where sampling finds a higher top, neighbours that were fitted before are fitted again from there."""
    again: list[tuple[Ids, Ids]] = []

    class Low(Fake):
        def again(self, known: Sequence[Model[None]], origin: Model[None]) -> list[Model[None]]:
            again.extend((m.ids, origin.ids) for m in known)
            return []

        def sample(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
            return Model(model.ids, self.evidence(model.ids), 1.0 if model.ids == three else 0.0, True, None)

    three = ("a", "b", "c")
    search(CATALOGUE, Low(additive(dict.fromkeys(three, 20.0))), flat)
    assert {((*three, id), three) for id in CATALOGUE[3:]} <= set(again)


@pytest.mark.parametrize("low", [0.0, 7.0])
def test_a_pair_that_shows_only_with_a_third_is_reached_by_an_exchange(low: float) -> None:
    """The first cause is only a stand-in, and where it stands the true one does not help."""
    evidence = {("a",): 20.0, ("b",): 2.0, ("a", "b"): 26.0, ("a", "c"): 21.0, ("b", "c"): 60.0}
    evidence |= {("a", "b", "c"): 26.0}
    held = lambda ids: max((v for s, v in evidence.items() if {*s} <= {*ids}), default=0.0)  # noqa: E731
    fake = Fake(lambda ids: evidence.get(ids, held(ids)), carrying=low)
    found = search(CATALOGUE, fake, flat, SearchSettings(most_causes=2))
    assert max(found.models.values(), key=lambda m: m.log_evidence + flat(m.ids)).ids == ("b", "c")
    assert ("b", "c") in fake.carried_over and ("b", "c") in fake.fitted  # first from what is known, then in earnest
    assert ("c", "h") in found.models and ("c", "h") not in fake.fitted


@pytest.mark.parametrize("seed", range(20))
def test_the_best_of_any_function_whose_best_has_a_way_within_the_window(seed: int) -> None:
    """Random evidences; the way to the best leads through sets that show and lie within the window."""
    rng = np.random.default_rng(seed)
    window = 8.0
    size = int(rng.integers(1, 6))
    way = [tuple(sorted(rng.permutation(CATALOGUE)[:size]))]
    while way[-1]:
        gone = rng.choice(way[-1])
        way.append(tuple(id for id in way[-1] if id != gone))
    level = {ids: 6.0 * len(ids) for ids in way}  # each step shows, and nothing else comes near
    noise = {ids: float(rng.normal(-40, 10)) for ids in every_set()}
    fake = Fake(lambda ids: level.get(ids, min(noise[ids], 0.0)))
    found = search(CATALOGUE, fake, flat, SearchSettings(window=window))
    assert max(found.models.values(), key=lambda m: m.log_evidence + flat(m.ids)).ids == way[0]


@pytest.mark.parametrize("seed", range(10))
def test_all_that_comes_within_the_window_is_sampled_and_nothing_beyond(seed: int) -> None:
    rng = np.random.default_rng(seed)
    settings = SearchSettings(window=6.0, most_causes=4)
    table = {ids: float(rng.normal(4.0 * len(ids), 6.0)) for ids in every_set(4)}
    fake = Fake(table.__getitem__)
    found = search(CATALOGUE, fake, flat, settings)
    value = {ids: m.log_evidence + flat(ids) for ids, m in found.models.items()}
    best = max(value.values())

    def shows(ids: Ids) -> bool:
        parts = [m.log_evidence for m in found.models.values() if set(m.ids) < set(ids)]
        return found.models[ids].log_evidence > max(parts, default=-math.inf) + settings.visible

    within = {ids for ids, v in value.items() if v >= best - settings.window and shows(ids)}
    assert within <= set(fake.sampled)
    # The certificate: every neighbour of the best was fitted, and of what else is within the window those that may come
    # near, if each cause does as much as it does at most anywhere.
    assert within <= found.expanded
    known = {ids: m.log_evidence for ids, m in found.models.items()}
    gains: dict[str, list[float]] = {id: [] for id in CATALOGUE}
    for ids in known:
        for id in ids:
            without = max(v for part, v in known.items() if {*part} < {*ids} and id not in part)
            gains[id].append(known[ids] - without)
    for ids in within:
        for new in {*enlarged(ids, CATALOGUE, 4), *exchanged(ids, CATALOGUE)} - known.keys():
            parts = [(id, tuple(other for other in new if other != id)) for id in new]
            hoped = [known[part] + max(gains[id]) for id, part in parts if part in known]
            shows_everywhere = all(max(gains[id]) > settings.visible for id in new)
            assert value[ids] < best and not (shows_everywhere and min(hoped) + flat(new) > best - settings.window)
    assert max(map(len, found.models)) <= 4
    assert len(fake.sampled) == len(set(fake.sampled)) and len(fake.fitted) == len(set(fake.fitted))


def test_the_order_of_the_catalogue_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    table = {frozenset(ids): float(rng.normal(3.0 * len(ids), 5.0)) for ids in every_set()}

    def run(catalogue: Sequence[str]) -> dict[frozenset[str], float]:
        found = search(catalogue, Fake(lambda ids: table[frozenset(ids)]), flat)
        return {frozenset(ids): m.log_evidence for ids, m in found.models.items()}

    assert run(CATALOGUE) == run(CATALOGUE[::-1]) == run(tuple(rng.permutation(CATALOGUE).tolist()))


def test_what_comes_near_only_if_its_fit_falls_short_is_fitted_in_earnest() -> None:
    """Two are estimated 6 and 8 nats below the best, beyond the window; of one the short fit had missed 6."""
    gains = {"a": 30.0, "c": 24.0, "f": 28.0}

    def fake() -> Fake:
        return Fake(lambda ids: max((gains.get(id, 0.0) for id in ids), default=0.0), lambda ids: -6.0 * ("f" in ids))

    large, small = fake(), fake()
    found = search(CATALOGUE, large, flat, SearchSettings(from_prior=0))  # any set is a large one
    assert large.fitted_in_earnest == [("c",), ("f",)] and large.sampled == [(), ("a",), ("f",)]
    assert found.models["f",].log_evidence == 28.0 and ("c",) not in found.expanded
    search(CATALOGUE, small, flat)
    assert small.fitted_in_earnest == [] and {("c",), ("f",)} < {*small.sampled}


def test_another_cause_in_the_place_of_one_is_looked_for_before_one_more() -> None:
    """ "b" with "c" does more than "a" with "c", which leads first; nothing is added to the latter."""
    evidence = {("a",): 50.0, ("a", "c"): 60.0, ("b", "c"): 90.0}
    fake = Fake(lambda ids: max(v for s, v in ({(): 0.0} | evidence).items() if {*s} <= {*ids}))
    found = search(CATALOGUE, fake, flat)
    assert found.models["b", "c"].sampled
    assert [ids for ids in found.models if len(ids) == 3 and {"a", "c"} < {*ids}] == [("a", "b", "c")]


def test_large_neighbours_of_what_does_not_lead_are_fitted_in_full_where_they_show() -> None:
    """Of "a", "b" and "a", "h", which does nearly as well, and of which "c" adds to both."""
    fake = Fake(lambda ids: 60.0 * ("a" in ids) + max(50.0 * ("b" in ids), 47.0 * ("h" in ids)) + 20.0 * ("c" in ids))
    search(CATALOGUE, fake, flat, SearchSettings(most_causes=4))
    with_c = {ids for ids in every_set(4) if {"a", "c", "h"} < {*ids} and "b" not in ids}
    assert ("a", "c", "h") in fake.fitted and with_c <= {*fake.carried_over} and not with_c & {*fake.fitted}
    assert {ids for ids in every_set(4) if {"a", "b", "c"} < {*ids}} <= {*fake.fitted} - {*fake.carried_over}


def test_two_causes_are_found_behind_one_that_does_much_of_what_they_do() -> None:
    """ "e" leads and fails the tests; "b" and "g" do more together than alone; others look as well as they."""
    alone = {"a": 30.0, "b": 15.0, "c": 28.0, "e": 50.0, "g": 20.0}

    def evidence(ids: Ids) -> float:
        return max(85.0 if {"b", "g"} <= {*ids} else 0.0, *(alone.get(id, 0.0) for id in ids), 0.0)

    fake = Fake(evidence)
    found = search(CATALOGUE, fake, flat, passes=lambda model: {"b", "g"} <= {*model.ids})
    assert found.models["b", "g"].sampled and ("b", "g") in fake.carried_over
    # Nothing was added to what looked as well as they.
    assert not [ids for ids in found.models if len(ids) > 2 and not {"b", "g"} < {*ids}]
    fake = Fake(evidence)
    search(CATALOGUE, fake, flat)  # the tests pass by "e": that is all there is to say
    assert ("b", "g") not in {*fake.fitted, *fake.carried_over}
    fake = Fake(lambda ids: evidence(ids) + 40.0 * ({"e", "h"} <= {*ids}))
    found = search(CATALOGUE, fake, flat, passes=lambda model: {"e", "h"} <= {*model.ids})
    assert found.models["e", "h"].sampled and ("b", "c") not in found.models  # "h" is what "e" lacks: no more pairs


def test_two_causes_that_are_expected_are_found_together_behind_one_that_leads_astray() -> None:
    """ "e" leads and fails the tests; neither "b" nor "f" shows alone, and each is expected of every rig."""

    def evidence(ids: Ids) -> float:
        return max(150.0 if {"b", "f"} <= {*ids} else 0.0, 50.0 if "e" in ids else 0.0)

    def expected(ids: Ids) -> float:
        return float(len({"b", "f"} & {*ids}))

    none = SearchSettings(widened=0)
    found = search(CATALOGUE, Fake(evidence), expected, none, passes=lambda model: {"b", "f"} <= {*model.ids})
    assert found.models["b", "f"].sampled
    assert ("b", "f") not in search(CATALOGUE, Fake(evidence), flat, none, passes=lambda model: False).models


def test_where_the_tests_fail_in_the_end_what_shows_besides_gets_its_neighbours_too() -> None:
    """Here "e" leads, "b" shows and does nothing with any other, but for what it does with "f", which does not show."""
    alone = {"e": 50.0, "b": 20.0, "g": 15.0}

    def evidence(ids: Ids) -> float:
        return max(150.0 if {"b", "f"} <= {*ids} else 0.0, *(alone.get(id, 0.0) for id in ids), 0.0) - 0.1 * len(ids)

    fake = Fake(evidence)
    found = search(CATALOGUE, fake, flat, passes=lambda model: {"b", "f"} <= {*model.ids})
    assert found.models["b", "f"].sampled
    assert [ids for ids in fake.fitted if "g" in ids and len(ids) == 2] == [("e", "g")]  # as all neighbours of the lead
    assert ("b", "f") not in search(CATALOGUE, Fake(evidence), flat).models  # where the tests pass by "e"
    none = SearchSettings(widened=0)
    assert ("b", "f") not in search(CATALOGUE, Fake(evidence), flat, none, passes=lambda model: False).models


def test_errors_of_short_fits_within_the_window_do_no_harm() -> None:
    gains = {"b": 30.0, "e": 12.0, "g": 11.0}
    rng = np.random.default_rng(1)
    error = {ids: -float(rng.uniform(0, 4)) for ids in every_set()}
    found = search(CATALOGUE, Fake(additive(gains), error.__getitem__), flat)
    assert found.models["b", "e", "g"].sampled


def test_a_model_that_rises_is_looked_at_again() -> None:
    """What a neighbour shows of a known model reopens it: it is sampled and its neighbours are looked at."""

    class Rising(Fake):
        def again(self, known: Sequence[Model[None]], origin: Model[None]) -> list[Model[None]]:
            if origin.ids != ("a",):
                return []
            return [Model(m.ids, 40.0, 0.0, False, None) for m in known if m.ids == ("c",) and m.log_evidence < 40]

    truth = {("c",): 40.0}
    fake = Rising(lambda ids: truth[ids] if ids in truth and "c" in fake_seen else additive({"a": 20.0})(ids))
    fake_seen: set[str] = set()
    keep = fake.sample

    def sample(model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
        fake_seen.update(model.ids)
        return keep(model)

    fake.sample = sample  # type: ignore[method-assign]
    found = search(CATALOGUE, fake, flat)
    assert found.models["c",].sampled and found.models["c",].log_evidence == 40.0


def test_starts_are_fitted_first() -> None:
    fake = Fake(additive({}))
    search(CATALOGUE, fake, flat, starts=[("a", "b"), ()])
    assert fake.fitted[:2] == [(), ("a", "b")]


def test_neighbours() -> None:
    assert enlarged(("b",), "abc", 3) == [("a", "b"), ("b", "c")] and enlarged(("a", "b"), "abc", 2) == []
    assert exchanged(("a", "b"), "abcd") == [("b",), ("a",), ("b", "c"), ("b", "d"), ("a", "c"), ("a", "d")]
    assert enlarged((), "ab", 6) == [("a",), ("b",)] and exchanged((), "ab") == []


def test_what_is_foreseen_is_what_follows() -> None:
    """Two that do as well: while one is sampled the other is the next; exchanges are given where they are not known."""
    reported: list[tuple[Ids, list[Ids], list[Ids]]] = []

    class Predicted(Fake):
        def sample(self, model: Model[None], foreseen: Foreseen[None] | None = None) -> Model[None]:
            if foreseen:
                reported.append((model.ids, [m.ids for m in foreseen.models], list(foreseen.sets)))
                assert set(foreseen.known) == {*self.fitted, *self.carried_over}
            return super().sample(model)

    evidence = {"a": 20.0, "b": 19.0, "c": 5.0}
    fake = Predicted(lambda ids: max((evidence.get(id, 0.0) for id in ids), default=0.0))
    search(CATALOGUE, fake, flat)
    assert reported[0] == (("a",), [("b",)], [])
    assert fake.sampled == [(), ("a",), ("b",)]
    fake = Predicted(additive({"a": 20.0, "b": 19.0, "c": 18.0}))
    reported.clear()
    search(CATALOGUE, fake, flat)
    of = {ids: sets for ids, _, sets in reported}
    assert list(of) == [("a",), ("a", "b"), ("a", "b", "c")] and of["a", "b"] and not of["a", "b", "c"]
    exchanges = set(exchanged(("a", "b"), CATALOGUE)) & {*of["a", "b"]}
    assert exchanges == {ids for ids in fake.carried_over if len(ids) == 2 and {"a", "b"} & {*ids}}


def test_neighbours_beyond_the_most_causes_were_not_looked_at() -> None:
    """Whatever leads: here one cause does, and a pair, the largest set allowed, lies within the window or beyond."""
    for gain, whole in ((5.0, False), (-1.0, True)):
        fake = Fake(lambda ids, gain=gain: sum({"a": 30.0, "b": gain}.get(id, -1.0) for id in ids))
        found = search(CATALOGUE, fake, lambda ids: -7.0 * len(ids), SearchSettings(most_causes=2, window=5.0))
        assert found.whole == whole and max(map(len, found.models)) == 2

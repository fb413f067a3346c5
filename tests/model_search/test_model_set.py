"""Probabilities of models."""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import logsumexp
from truths import FEW

from psafit.diagnose.results import without_of
from psafit.errors import ConvergenceError
from psafit.model_search import SearchSettings
from psafit.model_search.fitter import Fitted
from psafit.model_search.loop import Ids, Model, Searched
from psafit.model_search.model_set import ModelSet, beliefs, completed, log_prior, rank
from psafit.model_search.visibility import Effective, Effects
from psafit.physics import TERMS

BELIEFS = dict.fromkeys("abcdefghijklmnopqrstuvwx", 0.04)


def ranked(
    evidence: dict[Ids, float],
    sampled: dict[Ids, float],
    effects: Effective = lambda wanted: {},
    beliefs: dict[str, float] | None = None,
    held: Sequence[str] = (),
) -> ModelSet:
    """A model set with these evidences, some of them sampled, with a standard error."""
    models = {}
    for ids, value in evidence.items():
        draws = SimpleNamespace(standard_error=sampled[ids]) if ids in sampled else None
        fitted = Fitted(SimpleNamespace(ids=ids), draws)  # type: ignore[arg-type]
        models[ids] = Model(ids, value, 0.0, ids in sampled, fitted)
    return rank(Searched(models, frozenset(), whole=True), beliefs or BELIEFS, SearchSettings(), effects, held=held)


def test_prior_probabilities_of_models_sum_to_one_and_expect_few_surprises() -> None:
    some = {"a": 0.9, "b": 0.04, "c": 0.2}
    sets = [ids for k in range(4) for ids in itertools.combinations(some, k)]
    assert sum(math.exp(log_prior(ids, some)) for ids in sets) == pytest.approx(1)
    assert math.exp(log_prior(("a", "c"), some)) == pytest.approx(0.9 * 0.96 * 0.2)
    believed = beliefs(TERMS)
    assert believed["no_tension"] > 0.5 and believed["gap"] < 0.1
    surprises = sum(p for p in believed.values() if p < 0.5)
    assert 0.7 < surprises < 2.5


def test_rivals_have_supersets_though_they_were_not_fitted() -> None:
    """Shares are those of all sets fitted, where causes that are likely beforehand change every set by the same."""
    rng = np.random.default_rng(5)
    some = {"a": 0.04, "b": 0.03, "x": 0.9, "y": 0.8, "z": 0.7}
    sets = [ids for k in range(6) for ids in itertools.combinations(some, k)]
    for _ in range(20):
        own = {ids: float(rng.normal(0, 3)) for ids in [(), ("a",), ("b",), ("a", "b")]}
        change = {id: -float(rng.exponential(1.5)) for id in "xyz"}
        every = {
            ids: own[tuple(i for i in ids if i in "ab")] + sum(change.get(i, 0.0) for i in ids) + log_prior(ids, some)
            for ids in sets
        }
        evidence = {ids: value - log_prior(ids, some) for ids, value in every.items()}
        top = max(own, key=lambda ids: own[ids])
        fitted = {*own, *(ids for ids in sets if len(ids) == 1), *(tuple(sorted((*top, id))) for id in "xyz")}
        fitted |= {ids for ids in sets if rng.uniform() < 0.2}
        mass = {ids: every[ids] for ids in sets if ids in fitted}
        total = completed(mass, {ids: evidence[ids] for ids in mass}, some, far=math.inf)
        found = {ids: logsumexp([v for other, v in total.items() if {*other} & {*"ab"} == {*ids}]) for ids in own}
        exact = {ids: logsumexp([v for other, v in every.items() if {*other} & {*"ab"} == {*ids}]) for ids in own}
        assert found == {ids: pytest.approx(value, abs=1e-9) for ids, value in exact.items()}
        assert completed(every, evidence, some) == every


def test_a_cause_that_some_set_needs_makes_no_other_better_than_it_is() -> None:
    """Nobody knows what it would do there: it counts as one that does nothing."""
    some = {"a": 0.04, "b": 0.04, "x": 0.9}
    evidence = {(): 0.0, ("a",): 20.0, ("a", "x"): 50.0, ("b",): 48.0}
    mass = {ids: value + log_prior(ids, some) for ids, value in evidence.items()}
    total = completed(mass, evidence, some)
    assert total["b",] == pytest.approx(mass["b",] + math.log(1 + 9 + 0.04 / 0.96))
    assert total["a", "x"] == pytest.approx(mass["a", "x"] + math.log1p(0.04 / 0.96))


def test_what_leads_and_refutes_a_likely_cause_says_nothing_of_its_rivals() -> None:
    """Next to nothing at all the cause does nothing, so it does nothing next to a rival."""
    some = {"a": 0.04, "b": 0.04, "x": 0.9}
    evidence = {(): 0.0, ("a",): 30.0, ("b",): 30.0, ("x",): 0.0, ("a", "x"): 20.0}
    mass = {ids: value + log_prior(ids, some) for ids, value in evidence.items()}
    total = completed(mass, evidence, some)
    assert total["b",] - total["a",] == pytest.approx(math.log(10), abs=0.1)


@pytest.mark.slow
def test_sets_are_completed_in_the_same_way_in_every_process() -> None:
    """To the last digit, whatever order a process gives to the members of a set."""
    code = (
        "import itertools; from psafit.model_search.model_set import completed;"
        "some = {id: (i + 1) / 17 for i, id in enumerate('abcdefghijklmnop')};"
        "sets = [ids for n in range(3) for ids in itertools.combinations(some, n)][::3];"
        "mass = {ids: -1.1 * len(ids) - i / 97 for i, ids in enumerate(sets)};"
        "print([value.hex() for value in map(float, completed(mass, mass, some).values())])"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", code], env=os.environ | {"PYTHONHASHSEED": seed}, capture_output=True, check=True
        ).stdout
        for seed in "123"
    }
    assert len(said) == 1


def test_sets_are_completed_by_few_of_many_likely_causes() -> None:
    some = dict.fromkeys("abcdefghijklmnopqrst", 0.9)
    mass = {(): log_prior((), some), ("a",): log_prior(("a",), some)}
    total = completed(mass, dict.fromkeys(mass, 0.0), some, most=3)
    assert total[()] == pytest.approx(mass[()] + math.log(1 + 19 * 9 + 9 * 9))  # any one, and b with c


def test_draws_in_which_a_cause_does_not_show_are_counted_with_the_model_without_it() -> None:
    asked: list[Ids] = []

    def effects(wanted: Sequence[Ids]) -> dict[Ids, Effects]:
        asked.extend(wanted)
        return {
            ids: Effects(np.array([0.25, 0.75]), np.array([[9.0, 9.0], [9.0, 1.0]])[:, : len(ids)]) for ids in wanted
        }

    exact = dict.fromkeys([(), ("a",), ("a", "b"), ("c",)], 0.0)
    found = ranked({(): 0.0, ("a",): 20.0, ("a", "b"): 22.0, ("c",): -30.0}, exact, effects)
    assert set(asked) == {("a",), ("a", "b")}  # nothing hangs on the others
    both = found.at_work["a", "b"]
    price = log_prior(("a", "b"), BELIEFS) - log_prior(("a",), BELIEFS)
    assert math.log(both / found.at_work["a",]) == pytest.approx(2.0 + price)
    more = 1 + 21 * 0.04 / 0.96  # by what was not looked at; ("c",) is refuted
    assert found.probability["a", "b"] == pytest.approx(0.25 * both * more)
    assert found.probability["a",] == pytest.approx((found.at_work["a",] + 0.75 * both) * more)
    assert sum(found.probability.values()) == pytest.approx(1)
    assert found.best_model.ids == ("a",)


def test_what_was_believed_before_any_reading_is_no_find() -> None:
    """It counts as even odds for what is named; its probability is what it is."""
    believed = {"a": 0.04, "b": 0.9}
    exact = dict.fromkeys([(), ("a",), ("a", "b")], 0.0)
    for gained, best in ((2.0, ("a", "b")), (-0.5, ("a",))):
        evidence = {(): 0.0, ("a",): 20.0, ("a", "b"): 20.0 + gained}
        found = ranked(evidence, exact, beliefs=believed)
        assert found.probability["a", "b"] > 0.8
        assert found.best_model.ids == best

        # So it is of the draws in which it does not show, which count as draws without it.
        def effects(wanted: Sequence[Ids]) -> dict[Ids, Effects]:
            weights, size = np.array([0.3, 0.7]), np.array([[9.0, 1.0], [9.0, 9.0]])
            return {ids: Effects(weights, size[:, : len(ids)]) for ids in wanted}

        assert ranked(evidence, exact, effects, believed).best_model.ids == best


def test_what_is_named_was_sampled() -> None:
    found = ranked({(): 0.0, ("a",): 20.0, ("b",): 25.0}, {(): 0.0, ("a",): 0.0})
    assert found.probability["b",] > 0.9 and found.best_model.ids == ("a",)
    assert found.looked_at.mass_not_looked_at > 0.9


def test_a_tie_does_not_rest_on_estimates_alone() -> None:
    evidence = {(): 0.0, ("a",): 20.0, ("b",): 16.5, ("c",): 16.4, ("d",): 16.3}
    found = ranked(evidence, {(): 0.0, ("a",): 0.0})
    assert found.probability["a",] < 0.95 and found.needed(("a",))[0] == ("b",)
    assert found.decisive == (("a",), ("b",))
    # With one that was sampled the tie is real; without a tie, and of a baseline, nothing is asked.
    assert ranked(evidence, {(): 0.0, ("a",): 0.0, ("b",): 0.9}).decisive == (("a",),)
    assert ranked({(): 0.0, ("a",): 20.0, ("b",): 6.0}, {(): 0.0, ("a",): 0.0}).decisive == (("a",),)
    assert ranked({(): 0.0, **{(id,): -0.5 for id in "abc"}}, {(): 0.0}).decisive == ((),)


def test_the_best_without_a_cause_is_no_set_with_what_is_likely_and_does_nothing() -> None:
    believed = BELIEFS | {"x": 0.9}
    evidence = {(): 0.0, ("a", "b"): 40.0, ("a",): 21.0, ("b",): 12.0, ("b", "c"): 29.0, ("x",): -0.1, ("a", "x"): 20.9}
    found = ranked(evidence, {ids: 0.0 for ids in evidence}, beliefs=believed)
    assert [found.without(id) for id in "ab"] == [("b", "c"), ("a",)]
    assert found.standing["a", "b"] - found.standing["b", "c"] == pytest.approx(11.0)
    assert [(w.cause, w.terms, round(w.nats, 1), w.sampled) for w in without_of(found, ("a", "b"))] == [
        ("a", ["b", "c"], 11.0, True), ("b", ["a"], round(19.0 + math.log(0.04 / 0.96), 1), True),
    ]  # fmt: skip


HELD = BELIEFS | {"b": 0.95, "c": 0.7, "d": 0.8}


def held_set(evidence: dict[Ids, float], sampled: Sequence[Ids], alone: Ids = ("a",), **change: Any) -> ModelSet:
    """Sets of which one alone shows, and causes b, c and d that somebody holds to be at work."""
    found = ranked(evidence, dict.fromkeys(sampled, 0.1), beliefs=HELD, held="bcd")
    return replace(found, **{"probability": dict.fromkeys(evidence, 0.0) | {alone: 1.0}, **change})


def test_what_is_named_is_asked_with_what_somebody_holds_to_be_at_work() -> None:
    """One cause after the other, though the readings do not favour it; but not what they speak against."""
    base: list[Ids] = [(), ("a",)]
    evidence: dict[Ids, float] = {(): 0.0, ("a",): 20.0, ("a", "b"): 19.0, ("a", "c"): 10.0}
    assert held_set(evidence, base).decisive == (("a",), ("a", "b"), ("a", "d"))
    assert held_set(evidence, base, held=()).decisive == (("a",),)
    assert held_set(evidence, base, most_causes=1).decisive == (("a",),)
    assert held_set(evidence, base, most_causes=2).decisive == (("a",), ("a", "b"))
    # Together those alone with which the set is more probable.
    both: list[Ids] = [*base, ("a", "b"), ("a", "d")]
    assert held_set(evidence | {("a", "d"): 19.5}, both).decisive[-1] == ("a", "b", "d")
    assert ("a", "b", "d") not in held_set(evidence | {("a", "d"): 18.0}, both).decisive


def test_the_most_probable_set_with_what_is_held_counts() -> None:
    evidence: dict[Ids, float] = {
        (): 0.0, ("a",): 20.0, ("a", "b"): 19.5, ("a", "c"): 10.0, ("a", "d"): 19.5, ("a", "b", "d"): 19.4
    }  # fmt: skip
    found = held_set(evidence, [*evidence])
    assert found.as_held(("a",)) == (("a", "b", "d"),)
    poor = held_set(evidence | {("a", "b", "d"): 12.0}, [*evidence])
    assert poor.as_held(("a",)) == (("a", "b"),)
    assert held_set(evidence, [(), ("a",)]).as_held(("a",)) == (), "an estimate is no finding"
    shared = dict.fromkeys(evidence, 0.0) | {("a",): 0.5, ("a", "b", "d"): 0.5}
    assert ("a", "b", "d") not in replace(found, probability=shared).as_held(("a",)), "it is reported by itself"


def test_where_nothing_may_show_the_baseline_is_asked_with_what_is_held() -> None:
    evidence: dict[Ids, float] = {(): 0.0, ("a",): 8.0, ("b",): -0.5, ("a", "b"): 7.8}
    share = dict.fromkeys(evidence, 0.0)
    for nothing, asked in ((0.14, True), (0.01, False)):
        found = held_set(evidence, [(), ("a",)], probability=share | {(): nothing, ("a",): 1 - nothing})
        assert (("b",) in found.decisive) is asked and ("a", "b") in found.decisive


@pytest.mark.parametrize(
    ("more", "asked"), [(0.5, True), (-0.1, False), (3.1, False)], ids=["favoured", "not favoured", "shows by itself"]
)
def test_what_may_be_at_work_as_well_is_sampled(more: float, asked: bool) -> None:
    """An estimate alone does not say that a further cause, likely beforehand, would move the values."""
    believed = BELIEFS | {"b": 0.3, "c": 0.04}
    evidence = {(): 0.0, ("a",): 20.0, ("a", "b"): 20.0 + more, ("a", "c"): 20.1}
    found = ranked(evidence, {(): 0.0, ("a",): 0.0}, beliefs=believed)
    found = replace(found, probability=dict.fromkeys(evidence, 0.0) | {("a",): 1.0})  # b and c do not show
    assert (("a", "b") in found.decisive) is asked
    assert ("a", "c") not in found.decisive, "too little next to the named set alone"
    assert not found.counted_with(("a",)), "an estimate is no finding"


def test_a_set_that_cannot_be_drawn_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(self: ModelSet, ids: Ids, seed: int) -> str:
        if ids == ("b",):
            raise ConvergenceError("draws within the bounds around a mode", reached=0.0, required=1.0)
        return f"{ids} {seed}"

    found = ranked({(): 0.0, ("a",): 1.0, ("b",): 2.0}, {(): 0.1})
    monkeypatch.setattr(ModelSet, "draws", draw)
    assert found.drawn([(), ("b",), ("a",)], 7) == {(): "() 7", ("a",): "('a',) 7"}


def test_what_was_not_sampled_counts_as_not_looked_at() -> None:
    """Its estimate counts, with the error of an estimate: a rival is not certain to be worse."""
    found = ranked({(): 0.0, ("a",): 20.0, ("b",): 16.0, ("c",): -30.0}, {(): 0.0, ("a",): 0.0})
    said = found.looked_at
    assert (said.fitted, said.estimated) == (4, 2)
    assert said.mass_not_looked_at == pytest.approx(found.probability["b",] + found.probability["c",])
    assert math.exp(-4) < said.mass_not_looked_at < 3 * math.exp(-4)
    assert ranked({(): 0.0, ("a",): 20.0}, {(): 0.0, ("a",): 0.0}).looked_at.mass_not_looked_at == 0


@pytest.mark.parametrize("best", [0.96, 0.5])
def test_sets_are_reported_for_their_probability_or_their_likelihood(best: float) -> None:
    """Sets of no more causes that fit as well are reported however improbable; those between are not, for that."""
    likely = {"a": best, "bc": 0.015, "g": 0.014, "d": 0.013, "ef": 0.001}

    def fitted(ids: str, log_posterior: float) -> SimpleNamespace:
        return SimpleNamespace(
            ids=tuple(ids), log_likelihood=log_posterior, problem=SimpleNamespace(n_dim=3 + len(ids))
        )

    log_posteriors = {"a": -10.0, "bc": -9.0, "g": -30.0, "d": -11.0, "ef": -30.0}
    models = tuple(fitted(ids, log_posterior) for ids, log_posterior in log_posteriors.items())
    probability = {tuple(ids): p for ids, p in likely.items()}
    found = ModelSet(models, probability, {}, {}, BELIEFS, at_work=probability)  # type: ignore[arg-type]
    assert found.fitting_as_well(("a",)) == (("d",),)
    assert found.needed(("a",)) == (() if best > 0.95 else (("b", "c"), ("g",), ("d",), ("e", "f")))
    assert found.rivals(("a",)) == ((("d",),) if best > 0.95 else found.needed(("a",)))


def test_model_set_names_a_hidden_cause(hidden: ModelSet) -> None:
    assert hidden.best_model.ids == ("amplifier_lag",)
    assert hidden.gain(("amplifier_lag",)) > 10  # nats of 72 readings
    # A further cause that nobody can see may be at work, and does not show.
    assert hidden.probability["amplifier_lag",] > 0.9
    assert hidden.at_work["amplifier_lag", "reading_offset"] > 0.02
    assert hidden.probability["amplifier_lag", "reading_offset"] < 0.01
    assert hidden.best_model.values[3] == pytest.approx(4e-5, rel=0.3)
    # Everything next to what leads was fitted: each cause, and each other one added to the best model.
    others = [t.id for t in FEW if t.id != "amplifier_lag"]
    assert {(), *((t.id,) for t in FEW)} <= hidden.probability.keys()
    assert all(any({"amplifier_lag", id} == set(ids) for ids in hidden.probability) for id in others)


def test_a_larger_model_is_never_much_worse_than_one_within_it(hidden: ModelSet) -> None:
    for c in hidden.candidates:
        for smaller in hidden.candidates:
            if set(smaller.ids) < set(c.ids):
                # Densities of parameters at neutral values may cost something; likelihood may not be lost.
                assert c.log_likelihood > smaller.log_likelihood - 3.0

"""The search, on experiments of which the truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import FEW, experiment, problem

from psafit.diagnose import search as rungs
from psafit.diagnose.memory import Memory
from psafit.diagnose.search import climb
from psafit.inference.ascent import ascend
from psafit.inference.candidate import fit, settle, settle_at
from psafit.inference.optimise import widened
from psafit.physics import terms


def test_ladder_names_a_hidden_cause(hidden):
    assert hidden.leader.ids == ("amplifier_lag",)
    assert hidden.gain(("amplifier_lag",)) > 10  # nats of 72 readings
    # Sets with a further cause that nobody can see are counted with it.
    assert hidden.probability[("amplifier_lag",)] > 0.9
    assert hidden.probability[("amplifier_lag", "reading_offset")] == 0
    assert sum(hidden.probability.values()) + sum(hidden.unfitted.values()) == pytest.approx(1)
    tau = hidden.leader.values[3]
    assert tau == pytest.approx(4e-5, rel=0.3)


@pytest.mark.slow
def test_a_thorough_search_begins_from_above_too(three, tmp_path, monkeypatch):
    """Of the small models of a good large one none need be good: here the search has been held to one cause."""

    def begun():
        search = rungs._Search(three, FEW, 1, Memory(tmp_path), lambda what, done, total: None, wide=2, tangled=1)
        search.begin()
        return search

    search = begun()
    assert len(search._leader().ids) == 1
    assert search.from_above()
    assert {"amplifier_lag", "flight_friction"} <= set(search._leader().ids)
    monkeypatch.delattr(rungs, "prune")  # what it led through is kept
    again = begun()
    assert again.from_above() and again._leader().height == search._leader().height
    assert not again.from_above()


@pytest.mark.slow
def test_an_exchange_begins_from_what_has_the_new_cause_too(monkeypatch):
    """Beside the rest of a wrong model the right cause may lead nowhere; from where it is best by itself it does."""
    whole = problem(experiment(["amplifier_lag", "flight_friction"], [4e-5, 0.05]))
    search = rungs._Search(whole, FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    lag = search.fitted["amplifier_lag",]
    begun: dict[tuple[str, ...], list[np.ndarray]] = {}

    def noting(p, starts, **options):
        begun.setdefault(p.ids, []).append(starts)
        return ascend(p, starts, **options)

    monkeypatch.setattr(rungs, "ascend", noting)
    rest = search.fitted["flight_friction",].problem
    both = replace(rest, terms=terms(["amplifier_lag", "flight_friction"]))
    search._tried(rest)
    expected = widened(both, lag.values, lag.problem.names)[0]
    assert any(np.array_equal(row, expected) for row in begun[both.ids][0])


@pytest.mark.slow
def test_a_thorough_search_takes_every_step_of_a_quick_one_first(three, tmp_path, monkeypatch):
    """One that left out the unlike told a single set where the quick one told a tie of three."""
    steps = ["begin", "grow", "look_around", "settle", "think_again", "from_above", "take_over"]
    taken: list[str] = []

    def noting(name, own):
        def step(self, *args):
            taken.append(name)
            return own(self, *args)

        return step

    for name in steps:
        monkeypatch.setattr(rungs._Search, name, noting(name, getattr(rungs._Search, name)))
    quick = climb(three, FEW, seed=1, memory=Memory(tmp_path), thorough=False, tangled=1)
    by_quick, taken[:] = tuple(taken), []
    thorough = climb(three, FEW, seed=1, memory=Memory(tmp_path), others=quick.candidates[:2], tangled=1)
    assert set(by_quick) == set(steps[:5])
    assert tuple(taken[: len(by_quick)]) == by_quick
    assert set(taken[len(by_quick) :]) >= {"from_above", "take_over"}
    assert {c.ids for c in quick.candidates} <= {c.ids for c in thorough.candidates}


@pytest.mark.slow
def test_exchanges_of_many_causes_are_judged_by_climbs(tmp_path, monkeypatch):
    """The expansion promises nothing; short climbs see what belongs in a cause's place, and it is fitted."""
    whole = problem(experiment(["amplifier_lag", "flight_friction"], [4e-5, 0.05], n=60))

    def begun():
        search = rungs._Search(whole, FEW, 1, Memory(tmp_path), lambda what, done, total: None, wide=1)
        search.begin()
        wrong = replace(whole, terms=terms(["stack_stiffness", "flight_friction"]))
        search.fitted = {c.ids: c for c in search.fitted.values() if c.ids in ((), ("flight_friction",))}
        search.fitted[wrong.ids] = fit(wrong, list(search.fitted.values()), seed=1)
        monkeypatch.setattr(search, "_promising", lambda ids: [])
        return search

    search = begun()
    wrong = search.fitted["stack_stiffness", "flight_friction"]
    search._exchange(wrong)
    assert search._leader().ids[:2] == ("amplifier_lag", "flight_friction")[: len(search._leader().ids)]
    assert search._leader().height > wrong.height + 10
    monkeypatch.delattr(rungs, "ascend")  # climbs are kept
    again = begun()
    again._exchange(again.fitted[wrong.ids])
    assert again._leader().height == search._leader().height


@pytest.mark.slow
def test_a_part_is_found_from_the_whole_and_what_was_concluded_from_its_old_place_forgotten():
    """The cause alone stays at its neutral value; the pair, whose second cause does little, is right."""
    whole = problem(experiment(["amplifier_lag"], [4e-5], n=40, seed=3))
    search = rungs._Search(whole, FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    right = search.fitted[("amplifier_lag",)]
    stuck = settle(
        right.problem, ascend(right.problem, search.fitted[()].widened(right.problem)[0][:1], schedule=((0, 1),))
    )
    search.fitted[stuck.ids] = stuck
    assert stuck.height < right.height - 10
    search._screen(stuck.ids)
    search._refined.add(stuck.ids)
    pair = replace(whole, terms=terms(["amplifier_lag", "reading_offset"]))
    search.fitted[pair.ids] = fit(pair, [right], seed=1)
    search.compare()
    assert search.fitted[stuck.ids].height == pytest.approx(right.height, abs=0.1)
    assert stuck.ids not in search.screenings and stuck.ids not in search._refined


@pytest.mark.slow
@pytest.mark.parametrize(("ids", "values"), [((), ()), (("amplifier_lag",), (2e-5,))])
def test_combinations_are_tried_where_a_cause_gains_something(ids, values):
    search = rungs._Search(problem(experiment(ids, values)), FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    assert search.found_something() == bool(ids)


@pytest.mark.slow
def test_a_second_cause_is_looked_for_beside_every_cause_alone(tmp_path, monkeypatch):
    """... on a quarter of the readings, and what was looked at once is kept."""
    both = ("amplifier_lag", "flight_friction")
    whole = problem(experiment(both, [4e-5, 0.05], n=60))

    def begun():
        search = rungs._Search(whole, FEW, 1, Memory(tmp_path), lambda what, done, total: None)
        search.begin()
        search.look_around()
        return search

    first = begun()
    assert first._leader().ids == both
    assert sum(len(ids) == 2 for ids in first.fitted) <= rungs._LATE
    monkeypatch.delattr(rungs, "screen")
    again = begun()
    assert again._leader().height == first._leader().height
    for one, other in zip(first._screen(()), again._screen(()), strict=True):
        assert (one.term, one.log_bayes, one.visible) == (other.term, other.log_bayes, other.visible)
        assert np.array_equal(one.gain, other.gain) and np.array_equal(one.starts, other.starts)


def test_a_larger_model_is_never_much_worse_than_one_within_it(hidden):
    for c in hidden.candidates:
        for smaller in hidden.candidates:
            if set(smaller.ids) < set(c.ids):
                # Densities of parameters at neutral values may cost something; likelihood may not be lost.
                assert c.log_likelihood > smaller.log_likelihood - 3.0


@pytest.mark.slow
def test_a_search_begins_from_what_fewer_readings_led_to(monkeypatch):
    """A search that goes no further than single causes finds the pair that a part of the readings had."""
    ids, values = ["amplifier_lag", "flight_friction"], [4e-5, 0.02]
    e = experiment(ids, values)
    part = replace(problem(e, ("a", "b")), terms=terms(ids))
    known = fit(part, [fit(problem(e, ("a", "b")), (), seed=1)], seed=1)
    monkeypatch.setattr(rungs._Search, "grow", lambda self, size: False)
    monkeypatch.setattr(rungs._Search, "refine", lambda self: False)
    alone, begun = (climb(problem(e), FEW, seed=1, others=others) for others in ((), (known,)))
    assert len(alone.leader.terms) == 1 and begun.leader.ids == tuple(ids)
    whole = fit(replace(problem(e), terms=terms(ids)), [alone.of(())], seed=1)
    assert begun.leader.height == pytest.approx(whole.height, abs=0.5)


@pytest.mark.slow
def test_where_a_cause_was_held_by_cliffs_the_others_are_looked_over(hidden):
    """Else the one that a look had raised would lead over others that nobody looked at."""
    search = rungs._Search(hidden.baseline.problem, FEW, 1, Memory(None), lambda *a: None)
    search.fitted = {c.ids: c for c in hidden.candidates if len(c.terms) < 2}
    truth, rival = (search.fitted[(id,)] for id in ("amplifier_lag", "flight_friction"))

    def held(c):
        moved = c.modes[:1].copy()
        moved[0, 0] += 0.06
        return settle_at(c.problem, moved)

    search.fitted[rival.ids] = held(rival)
    assert search.fitted[rival.ids].height < rival.height - 5
    assert rival.ids not in {c.ids for c in search._finalists()}
    search._scout()
    assert search.fitted[rival.ids].height < rival.height - 5
    search.fitted[truth.ids] = held(truth)
    assert search._take(truth)
    assert search._scout() and search.fitted[rival.ids].height > rival.height - 1

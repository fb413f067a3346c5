"""What a search has found, as the record holds it."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from truths import CHEAP, FEW, experiment, narrow, problem

from psafit.diagnose.answer.besides import Furthest
from psafit.diagnose.discrepancy import discrepancy
from psafit.diagnose.misfit import examine
from psafit.diagnose.record.models import NEAREST, NEXT_BEST, NOT_EXCLUDED, UNSEEN
from psafit.diagnose.results import (
    cause_result,
    counted_of,
    counted_sets,
    misfit_of,
    moved_in,
    screening_of,
    separated,
    sessions_of,
    word_for,
)
from psafit.diagnose.room import Room
from psafit.diagnose.screening import screen
from psafit.diagnose.words import NO_ACTION, PLAIN
from psafit.drives import Drive
from psafit.experiment import Group
from psafit.inference.sample import sample
from psafit.model_search import search_models
from psafit.model_search.visibility import VISIBLE
from psafit.observables import LAUNCH_RANGE, LAUNCH_SPEED
from psafit.parameters import Belief, Normal
from psafit.physics import terms
from psafit.text import significant


def test_how_far_two_best_fits_are_apart(hidden):
    """Half the sum of squares of their difference, in the scatter of the one that is surer."""
    one, other = hidden.best_model, hidden.baseline
    assert separated(one, one) == 0.0
    sd = [np.hypot(c.noise[0, 1], c.noise[0, 0] * c.predicted) for c in (one, other)]
    by_hand = 0.5 * max(np.sum(((other.predicted - one.predicted) / s) ** 2) for s in sd)
    assert separated(one, other) == separated(other, one) == pytest.approx(by_hand) and by_hand > 3
    tied = SimpleNamespace(named=one.ids, probability=hidden.probability, alternatives=(other.ids,))
    assert cause_result(hidden, tied, other).again == pytest.approx(by_hand)
    assert cause_result(hidden, tied, one).again is None


def test_the_word_for_a_cause(hidden):
    """What is named, tied, good for a part, absent, not excluded, or could not have been seen."""
    found = {s.term.id: s for s in screen(hidden.baseline, FEW)}
    seen, unseen = (replace(found["flight_friction"], visible=v, chance=1.0) for v in (2 * VISIBLE, 0.5 * VISIBLE))
    calm = SimpleNamespace(verdict="explained", named=("gap",), alternatives=(), inclusion={"flight_friction": 0.1})
    weak, strong = SimpleNamespace(gain=lambda ids: 0.5), SimpleNamespace(gain=lambda ids: 9.0)
    little, much = (Room(0.01, size, 0) for size in (0.9 * VISIBLE, 1.1 * VISIBLE))
    assert word_for(seen, weak, calm, little) == "not present"
    assert word_for(seen, weak, calm, much) == word_for(seen, weak, calm, None) == NOT_EXCLUDED
    assert word_for(unseen, weak, calm, little) == UNSEEN
    assert word_for(unseen, strong, calm, little) == "explains part alone"
    tied = SimpleNamespace(**vars(calm) | {"alternatives": (("flight_friction", "gap"),)})
    assert word_for(unseen, weak, tied, little) == "as good"
    likely = SimpleNamespace(**vars(calm) | {"inclusion": {"flight_friction": 0.9}})
    assert word_for(unseen, weak, likely, None) == UNSEEN  # believed beforehand, and not named
    named = SimpleNamespace(**vars(likely) | {"named": ("flight_friction", "gap")})
    assert word_for(unseen, weak, named, None) == "present"
    named.verdict = "unexplained"
    assert word_for(unseen, weak, named, None) == NEAREST
    tied.verdict = "unexplained"
    assert word_for(unseen, weak, tied, None) == NEXT_BEST


def test_a_model_that_explains_nothing_bounds_no_cause(hidden):
    """No room is given there, and no cause is called not present."""
    screened = screen(hidden.baseline, FEW)
    seen, verdicts = [replace(s, visible=2 * VISIBLE) for s in screened], {}
    for word in ("explained", "unexplained"):
        said = SimpleNamespace(
            verdict=word, named=("amplifier_lag",), alternatives=(), inclusion={"amplifier_lag": 1.0}
        )
        verdicts[word] = screening_of(seen, [], hidden, said, 1)
    assert any(s.room is not None for s in verdicts["explained"])
    assert all(s.room is None and s.left is None for s in verdicts["unexplained"])
    assert not any(s.verdict == "not present" for s in verdicts["unexplained"])
    assert any(s.verdict == NOT_EXCLUDED for s in verdicts["unexplained"])


@pytest.mark.parametrize(("read", "acts"), [((LAUNCH_SPEED,), False), ((LAUNCH_RANGE, LAUNCH_SPEED), True)])
def test_what_changes_ranges_alone_does_not_act_on_speeds(hidden, read, acts):
    """It is not said that it could not have been seen, and it is left no change of a reading."""
    said = SimpleNamespace(verdict="adequate", named=(), alternatives=(), inclusion={})
    group = SimpleNamespace(drive=Drive("sine"), observables=read)
    one = SimpleNamespace(experiment=SimpleNamespace(select=lambda ids: (group,)), group_ids=("a",))
    models = SimpleNamespace(baseline=SimpleNamespace(problem=one), candidates=[], gain=lambda ids: 0.0)
    screened = [replace(s, visible=0.0) for s in screen(hidden.baseline, FEW)]
    found = {s.id: s for s in screening_of(screened, [], models, said, 1)}
    assert (found["flight_friction"].verdict != NO_ACTION) == acts
    assert found["flight_friction"].room is None
    assert found["amplifier_lag"].verdict == UNSEEN


@pytest.mark.parametrize(
    ("ids", "strengths", "expected", "unit"),
    [
        (["reading_gain"], [0.4], [math.exp(0.4), math.exp(-0.4), 1.0], "1"),
        (["gap", "session_lean"], [1e-6, 2e-3, math.log(2)], [4e-3, 1e-3, 2e-3], "m"),
    ],
)
def test_what_each_session_has_is_reported(ids, strengths, expected, unit):
    """By a cause that differs by session: its factor, its length; of draws the median and 90 %."""
    one = replace(problem(experiment(n=4)), terms=tuple(terms(ids)))
    row = one.to_physical(one.medians[None])[0]
    row[3 : 3 + len(strengths)] = strengths
    row[one.n_physical : one.n_model] = [1.0, -1.0, 0.0]
    here = SimpleNamespace(problem=one, terms=one.terms, ids=one.ids, modes=one.to_sampling(row[None]))
    found = sessions_of(SimpleNamespace(samples={}), here)
    assert [(s.cause, s.group) for s in found] == [(ids[-1], g) for g in "abc"]
    assert [s.value.median for s in found] == pytest.approx(expected)
    assert all(s.value.unit == unit and s.value.interval is None for s in found)
    draws = np.repeat(row[None], 101, axis=0)
    draws[:, one.n_physical] = np.linspace(0.0, 1.0, 101)  # of the first session, in even steps
    sampled = SimpleNamespace(draws=one.to_sampling(draws), quantiles=lambda values, q: np.quantile(values, q))
    first, *others = sessions_of(SimpleNamespace(samples={one.ids: sampled}), here)
    power = expected[0] / expected[2]
    ends = [expected[2] * power**z for z in (0.05, 0.5, 0.95)]
    assert [first.value.lower, first.value.median, first.value.upper] == pytest.approx(ends)
    assert all(s.value.lower == pytest.approx(s.value.upper) for s in others)


@pytest.mark.parametrize(
    ("shift", "sampled", "counted"),
    [(3.0, True, [("amplifier_lag",), ("gap",)]), (0.1, True, [("gap",)]), (3.0, False, [("gap",)])],
    ids=["moves a value", "moves nothing", "nothing to compare with"],
)
def test_what_is_held_to_be_at_work_counts_where_it_moves_a_value(shift, sampled, counted):
    """Before what the readings favour."""
    own = problem(experiment(n=4))
    sets = {ids: replace(own, terms=tuple(terms(ids))) for ids in ((), ("amplifier_lag",), ("gap",))}

    def quantiles(ids, q):
        middle = sets[ids].medians + (shift if ids == ("amplifier_lag",) else 0.0)
        return middle + np.array([2.0 * (p - 0.5) for p in q])[:, None]  # 90 % within 0.9 of the middle

    model_set = SimpleNamespace(
        of=lambda ids: SimpleNamespace(problem=sets[ids]), quantiles=quantiles, samples=[()] if sampled else [],
        as_held=lambda named: (("amplifier_lag",),), counted_with=lambda named: (("gap",),),
    )  # fmt: skip
    assert counted_sets(model_set, ()) == counted
    assert (moved_in(model_set, ("amplifier_lag",), ()) == ["k_c", "c_s", "c_c"]) is (len(counted) == 2)


@pytest.mark.slow
def test_values_that_nobody_expects_are_flagged():
    """A lag far beyond what is believed of it, and nothing else; the wider its prior, the more evidence it has."""
    e = experiment(["amplifier_lag"], [4e-5])
    reported = Belief("amplifier_lag_tau", Normal(0.0, 1.2e-5), "a data sheet")
    verdict = SimpleNamespace(named=("amplifier_lag",), probability={("amplifier_lag",): 1.0}, alternatives=())
    for beliefs, flagged in (((), []), ((reported,), ["amplifier_lag_tau"])):
        one = problem(replace(e, beliefs=beliefs))
        lag = replace(one, terms=terms(["amplifier_lag"])).terms
        model_set = search_models(one, lag, seed=1, settings=CHEAP)
        cause = cause_result(model_set, verdict, model_set.of(("amplifier_lag",)))
        assert cause.implausible == flagged
    widths = cause.evidence.prior_width
    assert widths["twice"] > 1 > 0 > widths["half"]
    wide = problem(replace(e, beliefs=(replace(reported, prior=Normal(0.0, 2.4e-5)),)))
    wider = sample(replace(wide, terms=terms(["amplifier_lag"])), [model_set.baseline], seed=1)[1]
    assert widths["twice"] == pytest.approx(wider.log_evidence - cause.evidence.log_evidence, abs=0.7)


def test_the_readings_furthest_from_what_is_adopted_are_always_reported():
    """And that heavy tails take them up, where they do."""
    e = experiment(spoil=narrow)
    model_set = search_models(problem(e), FEW, seed=1, settings=CHEAP)
    before = examine(model_set.baseline, FEW, seed=1, n_simulated=99)
    left = discrepancy(model_set.baseline)
    misfit = misfit_of(before, None, left, model_set.baseline, model_set.best_model)
    hz = e.group("a").frequency_hz[9]
    assert [r.frequency_hz for r in misfit.baseline.furthest].count(hz) == 2
    assert [w.group for w in misfit.where[:2]] == ["a", "c"] and misfit.where[0].together == ["c"]
    assert "as there in group c" in misfit.where[0].text and misfit.where[0].observable is None
    speeds = replace(before, coincidences=tuple(replace(c, observable="launch_speed") for c in before.coincidences))
    first = misfit_of(speeds, None, left, model_set.baseline, model_set.best_model).where[0]
    assert first.observable == "launch_speed" and " Hz, launch speeds: the prediction is" in first.text
    cause = cause_result(
        model_set, SimpleNamespace(named=(), probability={(): 1.0}, alternatives=()), model_set.baseline
    )
    assert cause.parameters["nu"].upper < 10.0 and cause.evidence.prior_odds == 0.0
    ids = next(ids for ids in model_set.log_evidence if ids)
    one = cause_result(
        model_set, SimpleNamespace(named=(), probability={ids: 0.1}, alternatives=()), model_set.of(ids)
    ).evidence
    odds = sum(math.log(t.probability) - math.log1p(-t.probability) for t in FEW if t.id in ids)
    assert one.prior_odds == pytest.approx(odds)
    assert math.exp(one.prior_odds + one.over_baseline) == pytest.approx(model_set.odds(ids, ()))


def test_a_reading_that_stands_out_is_reported_with_its_repeats():
    """Of the same condition and group; others have none."""
    e = experiment(n=8, groups=("a",))
    a = e.groups[0]
    f, y = (np.concatenate([x, x[3:4]]) for x in (a.frequency_hz, a.reading))
    y[-1] *= 3
    twice = Group("a", a.drive, a.file, f, np.full(f.size, 20.0), y)
    model_set = search_models(problem(replace(e, groups=(twice,))), (), seed=1)
    before = examine(model_set.baseline, (), seed=1, n_simulated=19)
    misfit = misfit_of(before, None, discrepancy(model_set.baseline), model_set.baseline, model_set.best_model)
    read = {r.number: r for r in misfit.baseline.furthest}
    assert read[8].repeats == [y[3]] and {len(r.repeats or ()) for k, r in read.items() if k not in (3, 8)} == {0}
    said = Furthest([], [read[8]], 0, None).say(PLAIN)
    assert f"{significant(y[-1])} um read, {significant(y[3])} um when repeated, " in said


def test_what_is_too_weak_to_show_is_reported_with_what_it_would_change(hidden):
    """As if the lag gained less than it must to count by itself."""
    lag = ("amplifier_lag",)
    assert not counted_of(hidden, hidden.baseline)
    weak = hidden.log_evidence | {lag: hidden.log_evidence[()] + 2.0}
    absorbed = replace(hidden, probability=hidden.probability | {lag: 0.0}, log_evidence=weak)
    (found, *_) = counted_of(absorbed, absorbed.baseline)
    assert found.terms == [*lag] and list(found.parameters) == ["amplifier_lag_tau"]
    assert np.log(found.odds) == pytest.approx(2.0 + hidden.log_prior(lag) - hidden.log_prior(()))
    own = dict(zip(hidden.baseline.problem.names, hidden.quantiles((), (0.05, 0.95)).T, strict=True))
    assert found.moved and all(not own[name][0] <= p.median <= own[name][1] for name, p in found.moved.items())
    for gained, why in ((0.001, "it may be chance"), (3.1, "it counts with another set")):
        other = replace(absorbed, log_evidence=weak | {lag: hidden.log_evidence[()] + gained})
        assert not counted_of(other, other.baseline), why
    assert not counted_of(replace(absorbed, visible=1.0), absorbed.baseline), "by the search's own setting"

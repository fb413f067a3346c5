"""Scores of a campaign, by the book."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from campaigns import result

from psafit.challenge.answer import Place
from psafit.challenge.campaign import PRIOR, Result
from psafit.challenge.conditions import blank, summary
from psafit.challenge.score import SHOWING_NATS, clustered, gained, located, rate, reported_set, score
from psafit.drives import Drive, Table
from psafit.experiment import Constants, Group
from psafit.model_search import SearchSettings
from psafit.observables import OBSERVABLES
from psafit.observables.contact_time import CONTACT_TIME
from psafit.observables.velocity import VELOCITY


def test_binomial_intervals_are_exact() -> None:
    """Clopper and Pearson: none of ten is below 1 - (0.025)^(1/10); symmetric in hits and misses."""
    none, all_of_them = rate([False] * 10), rate([True] * 10)
    assert none.lower == 0.0 and none.upper == pytest.approx(1 - 0.025**0.1)
    assert all_of_them.upper == 1.0 and all_of_them.lower == pytest.approx(0.025**0.1)
    assert rate([]).share is None


def test_a_named_set_that_breaks_a_law_is_not_exact() -> None:
    """As in trials of a calibration."""
    for verdict, why, exact in (
        ("explained", "", True), ("unexplained", "values", True), ("unexplained", "law", False),
        ("ambiguous", "law", False),
    ):  # fmt: skip
        one = result(["a"], verdict=verdict, named=["a"])
        one.diagnosis["unexplained_by"] = why
        assert score([one]).rows[0].exact == exact


def test_the_reported_set_is_named_and_alternatives() -> None:
    assert reported_set(result([], verdict="adequate").diagnosis) == {frozenset()}
    reported = result(["a"], verdict="ambiguous", named=["a"], alternatives=[["b"], ["b", "c"]]).diagnosis
    assert reported_set(reported) == {frozenset("a"), frozenset("b"), frozenset("bc")}
    assert reported_set(result(["a"], verdict="unexplained").diagnosis) == set()


def test_single_causes_are_judged_by_the_set_and_by_the_name() -> None:
    results = [
        result(["a"], named=["a"]),
        result(["a"], verdict="ambiguous", named=["a"], alternatives=[["b"]]),
        result(["a"], verdict="ambiguous", named=["b"], alternatives=[["a"]]),
        result(["a"], named=["b"]),
        result(["a"], named=["b"], alternatives=[["a"]], confusable=["b"]),
        result(["a"], verdict="adequate", gain=3.0),  # an oracle cannot see it: no miss
    ]
    found = score(results)
    assert (found.targets[0].rate.k, found.targets[0].rate.n) == (4, 5)
    assert (found.targets[1].rate.k, found.targets[1].rate.n) == (2, 4)
    assert found.targets[0].holds is False and found.confusion == {"a": {"a": 2, "b": 3}}
    assert found.set_size == {"1": 2, "2": 3}
    assert [(b.detected.k, b.detected.n) for b in found.by_gain] == [(0, 1), (0, 0), (0, 0), (5, 5), (0, 0), (0, 0)]
    assert found.targets[2].holds is None
    assert [row.missed for row in found.rows] == [False, False, True, True, True, False]
    assert found.targets[0].text.startswith("misses so far   80 %  (at least 97 %, 4 of 5)  single cause")


def test_false_alarms_are_counted() -> None:
    quiet, alarm = result([], verdict="adequate"), result([], verdict="unexplained")
    assert score([quiet] * 19 + [alarm]).targets[2].holds is True
    found = score([quiet] * 18 + [alarm] * 2)
    assert found.targets[2].holds is False and (found.false_alarms.k, found.false_alarms.n) == (2, 20)


def test_what_few_data_sets_say_holds_or_misses_so_far() -> None:
    """None in 100 is 3.6 % at most, below the limit; of one in 20 the interval holds the limit."""
    quiet, alarm = result([], verdict="adequate"), result([], verdict="unexplained")
    for calm, alarms, verdict in (
        (100, 0, "holds"),
        (19, 1, "holds so far"),
        (18, 2, "misses so far"),
        (0, 20, "misses"),
    ):
        assert score([quiet] * calm + [alarm] * alarms).targets[2].verdict == verdict


def test_right_answers_are_counted_by_how_designs_are_driven_and_what_they_read() -> None:
    """In words of `summary`, which a challenge writes."""
    drives = Drive("unipolar_sine", bias_v=2.0), Drive("table", table=Table(np.array([0.0, 1.0]), np.ones(2), True))
    time, motion = OBSERVABLES.index(CONTACT_TIME), OBSERVABLES.index(VELOCITY)
    groups = [
        Group(k, drive, "", np.ones(1), np.ones(1), np.ones(1), measured=np.array([read]))
        for k, (drive, read) in enumerate([*zip(drives, (0, time), strict=True), (Drive("sine"), motion)])
    ]
    plain, mixed, traced = (
        summary(blank(Constants(*6 * [1.0]), tuple(some))) for some in ([groups[0]], groups[:2], groups[2:])
    )
    found = score(
        [
            replace(one, answer=replace(one.answer, drawn=design))
            for one, design in (
                (result(["a"], verdict="ambiguous", named=["b"], alternatives=[["a"]]), plain),
                (result(["a"], named=["b"]), mixed),
                (result(["a"], named=["b"], gain=5.0), mixed),  # an oracle cannot see it
                (result([], verdict="adequate"), traced),
                (result([], verdict="adequate"), None),
            )
        ]
    )
    assert {kind: (r.k, r.n) for kind, r in found.by_design.items()} == {
        "contact times": (0, 1), "drives from 0 V": (1, 2), "recorded drives": (0, 1), "traces": (1, 1),
    }  # fmt: skip


def test_pairs_need_both() -> None:
    seen = {"a": 20.0, "b": 20.0}
    results = [
        result(["a", "b"], named=["b", "a"], without=seen),
        result(["a", "b"], named=["a"], alternatives=[["a", "b", "c"]], without=seen),
        result(["a", "b"], named=["a"], without=seen),
        result(["a", "b"], named=["a"], without={"a": 50.0, "b": 1.0}),  # nobody can see b given a
    ]
    target = score(results).targets[6]
    assert (target.rate.k, target.rate.n, target.holds) == (2, 3, False)


def test_outside_effects_are_missed_where_they_are_adequate_or_explained() -> None:
    band = [Place(1, "frequency", 1000.0, 2000.0)]
    here = [{"group": 1, "variable": "frequency", "from": 900.0, "to": 1800.0, "text": ""}]
    there = [{"group": 1, "variable": "frequency", "from": 3000.0, "to": 9000.0, "text": ""}]
    results = [
        result([], outside="x", verdict="unexplained", places=band),
        result([], outside="x", named=["a"], where=here, places=band),
        result([], outside="x", named=["a"], where=there, places=band),
        result([], outside="x", verdict="adequate", where=here, places=band),
        result([], outside="x", named=["a"], places=band, gain=5.0),
    ]
    found = score(results)
    assert (found.targets[3].rate.k, found.targets[3].rate.n) == (3, 4) and found.targets[3].holds is False
    assert found.outside == {"x": {"adequate": 1, "explained": 2, "located": 2, "unexplained": 1}}
    assert [row.missed for row in found.rows] == [False, False, True, True, False]


@pytest.mark.parametrize(
    ("where", "hit"),
    [
        ({"group": 1, "variable": "frequency", "from": 1000.0, "to": 1500.0}, True),
        ({"group": "1", "variable": "frequency", "from": 1200.0, "to": 1200.0}, True),
        ({"group": 2, "variable": "frequency", "from": 1000.0, "to": 1500.0}, False),
        ({"group": 1, "variable": "amplitude", "from": 1000.0, "to": 1500.0}, False),
        ({"group": 1, "variable": "frequency", "from": 10.0, "to": 20000.0}, False),  # everywhere is nowhere
        ({"group": 1, "variable": "frequency", "from": None, "to": None}, False),
    ],
)
def test_located_means_mostly_there(where: dict[str, Any], hit: bool) -> None:
    assert located({"misfit": {"where": [where]}}, [Place(1, "frequency", 1000.0, 2000.0)]) is hit
    wild = {"group": 3, "variable": "frequency", "from": 1.0, "to": 2.0}
    assert not located({"misfit": {"where": [where, wild, wild]}}, [Place(1, "frequency", 1000.0, 2000.0)])
    assert located({"misfit": {"where": [where]}}, [Place(int(where["group"]))])


def test_what_shows_is_what_some_prior_would_count() -> None:
    """A half normal prior of the best width gives 3.8 nats of gain the evidence of a cause, and 3.6 less than that."""
    x, width = np.linspace(0, 12, 2401), np.geomspace(0.5, 20, 60)[:, None]
    prior = np.sqrt(2 / np.pi) / width * np.exp(-0.5 * (x / width) ** 2)

    def most(gain: float) -> float:
        z = np.sqrt(2 * gain)
        return float(np.log((prior * np.exp(0.5 * z**2 - 0.5 * (x - z) ** 2)).sum(axis=1) * (x[1] - x[0])).max())

    assert most(3.8) == pytest.approx(SearchSettings().visible, abs=0.05)
    assert most(SHOWING_NATS) < SearchSettings().visible


def test_probabilities_are_held_against_how_often_they_are_right() -> None:
    def printed(right: bool) -> Result:
        truth = ["a"] if right else ["b"]
        candidates = [{"terms": ["a"], "probability": 0.7}, {"terms": ["b"], "probability": 0.3}]
        return result(truth, named=["a"], causes=candidates)

    honest = score([printed(k % 10 < 7) for k in range(100)])
    (high,) = (b for b in honest.reliability if b.lower <= 0.7 < b.upper)
    assert (high.right.k, high.right.n, high.mean) == (70, 100, pytest.approx(0.7)) and high.holds
    assert honest.targets[4].holds is True and honest.rows[0].probability == 0.7
    boastful = score([printed(k % 10 < 3) for k in range(100)])
    assert boastful.targets[4].holds is False and boastful.targets[5].holds is None
    believed = [replace(r, spec=replace(r.spec, level=PRIOR)) for r in map(printed, [True] * 35 + [False] * 15)]
    both = score([*(printed(False) for _ in range(100)), *believed])
    assert [t.holds for t in both.targets[4:6]] == [False, True]
    certain = result(["a"], named=["a"], causes=[{"terms": ["a"], "probability": 1.0}])
    assert score([certain]).reliability[-1].right.n == 1


def test_probabilities_have_a_proper_score() -> None:
    def printed(truth: list[str], p: float, **more: Any) -> Result:
        causes = [{"terms": ["a"], "probability": p}, {"terms": [], "probability": 0.1}]
        return result(truth, named=["a"], causes=causes, **more)

    listed, other = printed(["a"], 0.7), printed(["b"], 0.7)
    found = score([listed, other, printed(["a"], 0.0), printed(["a"], 0.7, gain=2.0), printed([], 0.7, outside="x")])
    logs = [row.log_score for row in found.rows]
    # Of what is not listed all that is left; no less than is printed; what does not show is nothing.
    assert logs[:4] == pytest.approx(np.log([0.7, 0.2, 1e-4, 0.1])) and logs[4] is None
    assert found.log_score.n == 4 and found.log_score.mean == pytest.approx(np.mean(logs[:4]))
    assert found.log_score.lower is not None and found.log_score.lower < found.log_score.mean
    wrong = score([printed(["b"], 0.97)] * 2 + [printed(["a"], 0.97)] * 48).targets[7]
    assert (wrong.rate.k, wrong.rate.n, wrong.holds) == (2, 50, False)


def test_two_campaigns_are_compared_over_the_data_sets_that_both_have() -> None:
    def campaign(p: float, n: int) -> list[Any]:
        causes = [{"terms": ["a"], "probability": p}]
        results = [result(["a"], named=["a"], causes=causes) for _ in range(n)]
        return score([replace(r, spec=replace(r.spec, id=str(k))) for k, r in enumerate(results)]).rows

    better = gained(campaign(0.8, 6), campaign(0.4, 4))
    assert better.n == 4 and better.mean == better.lower == better.upper == pytest.approx(np.log(2))
    assert gained(campaign(0.8, 3), []).mean is None


def test_recovery_looks_at_what_was_named_right() -> None:
    def reported(truth: str, lower: float, upper: float) -> Result:
        parameters = {"tau": {"median": 0.5 * (lower + upper), "lower": lower, "upper": upper}, "other": 3}
        return result([truth], named=["a"], causes=[{"terms": ["a"], "probability": 1.0, "parameters": parameters}])

    found = score([reported("a", 1.0, 2.5), reported("a", 2.5, 3.5), reported("b", 1.0, 2.5)])
    assert found.coverage_believed.n == 0
    drawn = reported("a", 1.0, 2.5)
    drawn = replace(drawn, spec=replace(drawn.spec, level=PRIOR))
    both = score([drawn, reported("a", 2.5, 3.5)])
    assert (both.coverage.k, both.coverage.n) == (1, 2)
    assert (both.coverage_believed.k, both.coverage_believed.n) == (1, 1)
    # Where another set leads, what both have counts, too.
    other = reported("b", 1.0, 2.5)
    other = replace(other, spec=replace(other.spec, level=PRIOR))
    some = score([drawn, other])
    assert (some.coverage_believed.n, some.targets[8].rate.n, some.coverage.n) == (2, 2, 1)
    (tau,) = found.recovery
    assert tau.name == "tau" and (tau.covered.k, tau.covered.n) == (1, 2) and found.coverage.n == 2
    assert tau.error == pytest.approx(np.median([-0.25 / 0.75, 1.0 / 0.5]))


def test_intervals_of_one_posterior_count_as_what_they_show() -> None:
    """Nine of ten hits, one by one or five at a time that hit or miss together; and all of them."""
    alone = clustered([[k % 10 > 0] for k in range(100)])
    exact = rate(k % 10 > 0 for k in range(100))
    assert (alone.k, alone.n) == (exact.k, exact.n)
    assert [alone.lower, alone.upper] == pytest.approx([exact.lower, exact.upper], abs=0.01)
    fives = clustered([[k % 10 > 0] * 5 for k in range(100)])
    assert (fives.k, fives.n) == (450, 500)
    assert [fives.lower, fives.upper] == pytest.approx([exact.lower, exact.upper], abs=0.01)
    assert clustered([[True] * 5] * 20).lower == rate([True] * 20).lower
    assert clustered([[]]) == rate([])


def test_time_is_reported() -> None:
    found = score([result([], verdict="adequate", seconds=s) for s in (1.0, 2.0, 9.0)])
    assert found.seconds["median"] == 2.0 and found.seconds["p90"] == pytest.approx(7.6)

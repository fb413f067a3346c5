"""What a diagnosis says, from a record made by hand."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest
from diagnoses_by_hand import make_experiment, make_record

from psafit.diagnose.answer import answer, sentences
from psafit.diagnose.answer.besides import BySession, Furthest, Indistinct, Lagging, Redefined, Room, TooWeak
from psafit.diagnose.answer.findings import GainsDiffer, Implausible, Judged, Kind, Named, Replaced, Rival, Sizes
from psafit.diagnose.answer.grounds import ByChance, LivesOn, OneGroup, Searched
from psafit.diagnose.answer.worth import Gained
from psafit.diagnose.influence import Carried
from psafit.diagnose.misfit import Coincidence
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.models import Counted, ParameterResult, SessionResult, Without
from psafit.diagnose.show import Offset
from psafit.diagnose.significance import Significance
from psafit.diagnose.words import PLAIN
from psafit.model_search.model_set import LookedAt
from psafit.parameters import Belief, LogNormal
from psafit.records import Broken, Overdamped
from psafit.report.diagnosis import remaining
from psafit.report.diagnosis.answer import kind
from psafit.report.page_words import PAGE

GAP = ParameterResult(1e-7, None, None, "m", "what it means", 0.5)


def record() -> Diagnosis:
    return make_record(make_experiment())


def of(d: Diagnosis, kind: type) -> list:
    return [one for one in answer(d) if isinstance(one, kind)]


def test_a_statement_holds_the_numbers_that_its_sentence_says() -> None:
    (judged,), (named,) = of(record(), Judged), of(record(), Named)
    assert (judged.adequate, judged.p_value, judged.simulated) == ("no", 0.001, 999)
    assert (named.causes, named.probability) == (["hysteresis"], 0.61)
    assert "hysteresis (probability 61 %); or gap + slew_limit (31 %); or preload." in named.say(PLAIN)
    one_by_one = [statement.say(PLAIN) for statement in answer(record())]
    assert one_by_one == sentences(record())
    assert not any(re.search(r"\b(nan|None)\b|  ", text) for text in one_by_one)


def test_only_what_was_looked_at_does_less_well() -> None:
    alone = replace(record(), verdict="explained", alternatives=[])
    for mass, said in ((0.004, "no other set does as well"), (0.02, "no other set that was sampled does as well")):
        (named,) = of(replace(alone, looked_at=LookedAt(164, 151, mass, neighbours=True)), Named)
        assert said in named.say(PLAIN)
    (named,) = of(replace(alone, looked_at=LookedAt(164, 151, 0.004, neighbours=False)), Named)
    assert "no other set that was looked at does as well" in named.say(PLAIN)
    (named,) = of(replace(alone, unnamed=0.2), Named)
    assert "A discrepancy without a name keeps 20 % of the probability." in named.say(PLAIN)


def test_why_the_best_extension_is_no_explanation() -> None:
    d = replace(record(), verdict="unexplained", alternatives=[])
    law = Broken("energy", d.named, 1, 200.0, 20.0, 2.0, 1.0, 3, "group 1")
    for why, words in (
        ("structure", "but structure remains that no cause describes"),
        ("smooth", "but a smooth curve in its place is more probable"),
        ("law", "but it breaks a law that holds"),
        ("values", "but at values that are implausible"),
    ):
        (named,) = of(replace(d, unexplained_by=why), Named)
        assert words in named.say(PLAIN)
    assert (
        "A ball cannot gain more than the drive gives. hysteresis breaks that law at the farthest launch of 3"
        " groups, most at group 1." in (sentences(replace(d, laws=[law])))
    )


def test_the_scatter_is_not_called_right_where_its_statistics_stand_out() -> None:
    d = record()
    mean, spread = d.misfit.baseline.statistics
    for significant, said in ((False, "so it is systematic, not scatter."), (True, "scatter is off, too.")):
        statistics = [mean, replace(spread, significant=significant)]
        baseline = replace(d.misfit.baseline, statistics=statistics)
        (kind_of,) = of(replace(d, misfit=replace(d.misfit, baseline=baseline)), Kind)
        assert kind_of.say(PLAIN).endswith(said)


def test_what_each_session_has_is_said_in_words_and_on_a_page() -> None:
    d = record()
    values = [
        ParameterResult(m, low, high, "m", "", math.nan) for m, low, high in ((2e-3, 1e-3, 3e-3), (5e-3, None, None))
    ]
    sessions = [SessionResult("session_lean", group, value) for group, value in zip((1, "b"), values, strict=True)]
    causes = [replace(d.causes[0], sessions=sessions), *d.causes[1:]]
    (said,) = of(replace(d, causes=causes), BySession)
    assert (
        said.say(PLAIN)
        == "Session by session: session_lean 0.002 (0.001 to 0.003) m in group 1 and 0.005 m in group b."
    )
    page = "lean that differs by session 0.0020 m (0.0010 to 0.0030) in group 1 and 0.00500 m in group b."
    assert str(said.say(PAGE)).replace("\u00a0", " ") == f"Session by session: {page}"
    assert not of(d, BySession)


def test_sessions_that_differ_by_what_is_read_point_to_two_instruments() -> None:
    ranges, speeds = Offset("mon", "tue", 9, 0.9, 0.88, 0.92), Offset("mon", "tue", 9, 1.0, 0.98, 1.02, "launch_speed")
    d = replace(record(), verdict="unexplained", alternatives=[], unexplained_by="structure")

    def said(*sessions: Offset, **changed) -> list[str]:
        found = replace(d, misfit=replace(d.misfit, sessions=list(sessions)), **changed)
        return [s.say(PLAIN) for s in of(found, GainsDiffer)]

    (text,) = said(ranges, speeds)
    assert "From session mon to session tue the readings change by two factors, launch ranges by 0.9 (0.88" in text
    assert "One reading_gain for both does not do that." in text
    assert not said(ranges, speeds, verdict="explained")
    others = [replace(speeds, observable=name) for name in ("contact_time", "peak_force")]
    for other in (replace(speeds, factor=0.93, lower=0.9, upper=0.96), replace(speeds, second="wed"), *others):
        assert not said(ranges, other), "chance, other sessions, or what no gain acts on"
    # A difference that one pair in 270 shows is none among 21.
    near = replace(speeds, factor=0.95, lower=0.93, upper=0.97)
    assert said(ranges, near)
    others = [replace(o, first=f"a{k}") for k in range(20) for o in (speeds, replace(speeds, observable=None))]
    assert not said(ranges, near, *others)


def test_what_is_left_is_said_of_the_best_extension() -> None:
    d = replace(record(), verdict="unexplained", alternatives=[], unexplained_by="structure")
    odd = replace(d.misfit.extended, p_value=0.005, character="group", odd_groups=[2])
    texts = [s.say(PLAIN) for s in of(replace(d, misfit=replace(d.misfit, extended=odd)), Kind)]
    assert [text.partition(" misses")[0] for text in texts] == ["What the baseline", "What the best extension"]
    assert texts[1].endswith("(group 2).")
    assert len(of(replace(d, verdict="explained", misfit=replace(d.misfit, extended=odd)), Kind)) == 1


def test_what_a_parameter_is_with_a_cause_is_said() -> None:
    assert not of(record(), Redefined)
    (said,) = of(replace(record(), named=["hertz_exponent"]), Redefined)
    assert said.say(PLAIN) == "With hertz_exponent, k_c is the secant stiffness at 1 um of indentation."
    assert "is the secant stiffness at 1 µm" in said.say(PAGE)
    (both,) = of(replace(record(), named=["hertz_exponent", "soft_layer"]), Redefined)
    assert both.say(PLAIN).endswith("k_c only scales the law that these make together.")


def test_a_named_set_is_held_to_what_is_asked_of_the_baseline() -> None:
    d, pair = record(), Coincidence("frequency", ((1, 3), (2, 3)), 200.0, 200.0, 0.2, 3.0, 0.01)
    for change, words in (
        ({"p_value": 0.005}, "but structure remains that no cause describes (family-wise p = 0.005"),
        ({"coincidences": [pair]}, "but readings of several groups still stand out together (p = 0.01"),
        ({"usual_tails": 0.015}, "only because heavy tails take up what stands out (p without them = 0.015"),
    ):
        after = replace(d.misfit.extended, **change)
        left = replace(d, verdict="unexplained", unexplained_by="structure", misfit=replace(d.misfit, extended=after))
        (named,) = of(left, Named)
        assert words in named.say(PLAIN)
    # What is the least that the simulated data sets can give is an upper limit.
    after = replace(d.misfit.extended, p_value=0.005, floor=0.005)
    least = replace(d, verdict="unexplained", unexplained_by="structure", misfit=replace(d.misfit, extended=after))
    (named,) = of(least, Named)
    assert "(family-wise p <= 0.005; " in named.say(PLAIN) and remaining.tests(after)["p"] == "p ≤ 0.005"
    assert remaining.tests(replace(after, p_value=0.01))["p"] == "p = 0.010"
    # The tests alone do not object to a baseline in which readings stand out together, but its verdict does.
    baseline = replace(d.misfit.baseline, p_value=0.4, coincidences=[pair])
    found = replace(d, verdict="explained", alternatives=[], misfit=replace(d.misfit, p_value=0.4, baseline=baseline))
    (named,) = of(found, Named)
    assert "explains the misfit" in named.say(PLAIN)


def test_what_is_held_back_by_what_is_plausible_alone_is_reported() -> None:
    d = record()
    rare = replace(d.causes[1], probability=0.0002)
    rival = replace(d, alternatives=[rare.terms], by_likelihood=[rare.terms], causes=[d.causes[0], rare])
    (named,) = of(rival, Named)
    assert named.say(PLAIN) == (
        "hysteresis (probability 61 %) is most probable, but only by its priors. By likelihood alone, 1 more set fits"
        " as well or better: gap + slew_limit (its priors make it 3100 times less probable: 0.02 %)."
    )
    assert rival.headline == "verdict: ambiguous: hysteresis, or by likelihood alone gap + slew_limit"
    (named,) = of(
        replace(rival, alternatives=[["preload"], rare.terms], by_likelihood=[["preload"], rare.terms]), Named
    )
    assert "By likelihood alone, 2 more sets fit as well or better: preload; gap + slew_limit (" in named.say(PLAIN)
    odd = replace(d, causes=[d.causes[0], replace(d.causes[1], implausible=list(d.causes[1].parameters)[:1])])
    (named,) = of(replace(odd, alternatives=[d.causes[1].terms], by_likelihood=[]), Named)
    assert "gap + slew_limit (31 %, at implausible values)" in named.say(PLAIN)
    both = replace(rival, alternatives=[["preload"], rare.terms])
    (named,) = of(both, Named)
    assert "between 2 sets of causes: hysteresis (probability 61 %); or preload. By likelihood alone" in named.say(
        PLAIN
    )


def test_what_tied_sets_share_is_no_matter_of_the_tie() -> None:
    d = record()
    (named,) = of(d, Named)
    assert "all with" not in named.say(PLAIN)
    rivals = [Rival([*named.causes, id], 0.1, 6.1, False) for id in ("gap", "preload")]
    text = replace(named, alternatives=rivals).say(PLAIN)
    other = replace(named, alternatives=[*rivals, Rival(["slew_limit"], 0.01, 60.0, True)]).say(PLAIN)
    assert ", all with" in other and "By likelihood alone, 1 more set fits as well or better: slew_limit" in other
    assert f"between 3 sets of causes, all with {' + '.join(named.causes)}: " in text and text.count("(10 %)") == 2


def test_a_tied_set_that_fits_better_is_said_to() -> None:
    """Where its further parameters do not account for that."""
    d = replace(record(), verdict="ambiguous")
    own = d.best_model
    assert own is not None

    def said(gain: float, more: int = 0) -> str:
        size = next(iter(own.parameters.values()))
        extra = {f"new{k}": size for k in range(more)}
        fits = replace(own.evidence, gain=own.evidence.gain + gain)
        other = replace(own, terms=["gap"], evidence=fits, parameters=own.parameters | extra)
        (named,) = of(replace(d, causes=[own, other], alternatives=[["gap"]]), Named)
        return named.say(PLAIN)

    better = "; it fits better by 6.9 nats, and its priors hold it back)"
    assert better in said(6.9) and better in said(6.9, more=3)
    assert "fits better" not in said(6.9, more=4) and "fits better" not in said(2.0)


def test_a_chance_has_no_more_digits_than_the_tails_of_priors_deserve() -> None:
    assert [PLAIN.share(p) for p in (0.4, 0.004, 2e-5, 6.5e-16, 0.0)] == [
        "40 %", "0.4 %", "0.002 %", "under 0.001 %", "0 %",
    ]  # fmt: skip


def test_what_would_be_named_without_each_cause_is_said() -> None:
    d = replace(record(), verdict="explained", alternatives=[], named=["gap", "preload"])
    d = replace(
        d,
        without=[
            Without("preload", ["gap", "slew_limit"], 10.74, True), Without("gap", ["preload"], 39.6, False),
            Without("gap", ["hysteresis"], 0.21, False),
        ],
    )  # fmt: skip
    (found,) = of(d, Replaced)
    assert found.say(PLAIN) == (
        "The next best by log posterior: without preload, slew_limit in its place (10.7 nats behind);"
        " without gap, nothing in its place"
        " (about 40 nats behind); without gap, hysteresis (about 0.2 nats behind)."
    )
    tied = replace(d, verdict="ambiguous", alternatives=[["gap", "slew_limit"]])
    (found,) = of(tied, Replaced)
    assert "without preload" not in found.say(PLAIN), "that is what the tie is about"
    assert not of(replace(d, verdict="unexplained"), Replaced)


@pytest.mark.parametrize(("nats", "said"), [(0.41, "would separate the two sets by about 0.4 nats"), (3.1, "")])
def test_sets_that_more_of_the_same_readings_would_not_separate_are_said_to_be_so(nats: float, said: str) -> None:
    d = record()
    causes = [replace(c, again=nats if c.terms == d.alternatives[0] else None) for c in d.causes]
    assert sum(c.again is not None for c in causes) == 1
    d = replace(d, causes=causes)
    assert [said in one.say(PLAIN) for one in of(d, Indistinct)] == ([True] if said else [])
    assert not of(replace(d, verdict="explained"), Indistinct)


def test_a_damping_that_is_none_is_said_to_be_so() -> None:
    d = record()
    lag = Overdamped(990.0, 120.0)
    adopted = [replace(c, overdamped=lag) if c is d.best_model else c for c in d.causes]
    (one,) = of(replace(d, causes=adopted), Lagging)
    assert one.say(PLAIN) == f"The{lag.text.removeprefix('the')}." and "lags by c_s/k_s, 120 us" in lag.text
    assert not of(d, Lagging)


def test_no_set_is_as_good_as_one_that_explains_nothing() -> None:
    left = replace(record(), verdict="unexplained", unexplained_by="structure")
    (named,) = of(left, Named)
    assert named.say(PLAIN).endswith(" Next best: gap + slew_limit (31 %); preload.")
    assert not any("as good" in text.lower() or "as well" in text for text in sentences(left))
    sizes = Sizes([("gap", GAP)], [("preload", GAP)], "unexplained").say(PLAIN)
    assert "; of the next best: " in sizes and "as well" not in sizes


def test_a_set_that_breaks_a_law_is_no_explanation_among_others() -> None:
    d = record()
    law = Broken("energy", d.named, 1, 200.0, 20.0, 2.0, 1.0, 3, "group 1")
    broken = replace(d, unexplained_by="law", laws=[law])
    (named,) = of(broken, Named)
    assert "hysteresis is no explanation: it breaks a law that holds whatever the causes are." in named.say(PLAIN)
    assert broken.headline == "verdict: ambiguous: hysteresis (breaks a law), or gap + slew_limit, or preload"
    assert kind(broken) == "bad"
    other = replace(d, laws=[replace(law, terms=["preload"])])
    assert other.headline.endswith("or gap + slew_limit, or preload (breaks a law)") and kind(other) == "warn"
    odd = replace(d, unexplained_by="values")
    (named,) = of(odd, Named)
    assert "cannot decide" in named.say(PLAIN) and "it fits only at values that are implausible" in named.say(PLAIN)


def test_where_a_reading_was_taken_is_reported() -> None:
    """Of what is furthest, along a trace with its time, and of what may change most."""
    d = record()
    (first, *_) = d.misfit.extended.furthest if d.misfit.extended else d.misfit.baseline.furthest
    late = replace(first, group=4, frequency_hz=6900.0, amplitude_v=60.0, time_us=12000.5)
    assert "group 4, 6900 Hz, 60 V, 12000.5 us (" in Furthest([], [late], 0, None).say(PLAIN)
    bounded = [replace(d.screening[0], id="preload", room=0.19, room_at=late)]
    (left,) = of(replace(d, verdict="explained", screening=bounded), Room)
    assert "preload changes a reading (group 4, 6900 Hz, 60 V, 12000.5 us) by up to 19 %" in left.say(PLAIN)


def test_what_the_tests_alone_would_not_have_asked_for_rests_on_odds() -> None:
    d = record()
    calm = replace(d.misfit, p_value=0.3, baseline=replace(d.misfit.baseline, p_value=0.3))
    (named,) = of(replace(d, verdict="explained", alternatives=[], misfit=calm), Named)
    assert "is far more probable than no cause" in named.say(PLAIN) and "rests on odds and priors" in named.say(PLAIN)


def test_heavy_tails_are_reported_with_the_readings_that_they_take_up() -> None:
    best_model = record().causes[0]
    for ends, reported in (((2.1, 3.4), True), ((2.1, 80.0), False)):
        nu = ParameterResult(3.0, *ends, "1", "tails", 0.1)
        wide = replace(best_model, parameters=best_model.parameters | {"nu": nu})
        (furthest,) = of(replace(record(), causes=[wide]), Furthest)
        assert (furthest.tails == ends) == reported
        assert ("heavy tails (nu 2.1 to 3.4, 90 %)" in furthest.say(PLAIN)) == reported


def test_a_large_set_is_named_once() -> None:
    """What follows calls it the set named first."""
    for ids, called in ((["gap", "preload"], "gap + preload"), (["gap", "preload", "adhesion"], "the set named first")):
        text = Furthest(ids, record().misfit.baseline.furthest, 0, None).say(PLAIN)
        assert text.startswith(f"Furthest from {called}: ")
        assert f"added to {called} and refitted" in Room(ids, "hysteresis", 0.1, [], 3, None).say(PLAIN)


def test_what_carries_several_causes_is_one_sentence() -> None:
    found = [Carried("gap", [], 9.0, 7, [(1, 3.0), (2, 3.0)]), Carried("preload", [], 9.0, 8, [(2, 6.0), (1, 3.0)])]
    assert LivesOn(found, 92).say(PLAIN) == (
        "Half of what speaks for gap comes from 7 of the 92 readings; for preload from 8, most in group 2."
    )


def test_why_tests_that_pass_do_not_make_a_baseline_adequate() -> None:
    d = record()
    pair = Coincidence("frequency", ((1, 3), (2, 3)), 200.0, 200.0, 0.2, 3.0, 0.01)
    for change, adequate, said in (
        ({"usual_tails": 0.005}, "tails", "only because heavy tails take up what stands out; without: of 999"),
        ({"coincidences": [pair]}, "together", "readings of several groups stand out together."),
        ({"usual_tails": 0.5}, "improbable", "it is improbable compared with"),
    ):
        passed = replace(d.misfit, p_value=0.4, baseline=replace(d.misfit.baseline, p_value=0.4, **change))
        (judged,) = of(replace(d, verdict="unexplained", named=[], misfit=passed), Judged)
        assert judged.adequate == adequate and said in judged.say(PLAIN)


def test_what_fits_at_implausible_values_is_not_said_to_explain() -> None:
    d = replace(record(), verdict="unexplained", unexplained_by="values", alternatives=[])
    (named,) = of(d, Named)
    assert "explains" not in named.say(PLAIN) and "does as well, but at values" in named.say(PLAIN)
    assert (
        d.headline == "verdict: unexplained; best of the catalogue: hysteresis (at implausible values)"
        and kind(d) == "warn"
    )
    usual = replace(d, verdict="explained", unexplained_by="")
    (named,) = of(usual, Named)
    assert "hysteresis (probability 61 %) explains the misfit" in named.say(PLAIN)
    assert usual.headline == "verdict: explained: hysteresis" and kind(usual) == "good"


def test_an_implausible_scatter_is_flagged_too() -> None:
    first, *others = record().causes
    wide = replace(first.parameters["sigma_abs"], median=2e-4, lower=1e-4, upper=3e-4, unit="m")
    for ends, expected in (((None, None), ""), ((1e-6, 2e-5), " (its prior expects 1 to 20 um)")):
        scatter = replace(wide, prior_lower=ends[0], prior_upper=ends[1])
        model = replace(first, implausible=["sigma_abs"], parameters=first.parameters | {"sigma_abs": scatter})
        (found,) = of(replace(record(), causes=[model, *others]), Implausible)
        value = "sigma_abs = 200 (100 to 300) um"
        assert found.say(PLAIN) == f"Implausible values: {value}{expected} of hysteresis."
    sharp = replace(wide, prior_lower=1e-3, prior_upper=1e-2)
    model = replace(first, implausible=["sigma_abs"], parameters=first.parameters | {"sigma_abs": sharp})
    assert not of(replace(record(), causes=[model, *others]), Implausible), "a good instrument is no doubt"


def test_groups_that_are_predicted_worse_are_named() -> None:
    """Beyond chance, and where a reading can show it."""
    strict = record().gain["strict"]
    first, second = strict.groups
    rows = [
        replace(first, log_rmse_interval=[0.1, 0.4]), replace(second, log_rmse_interval=[-0.1, 0.4]),
        replace(first, group="quiet", log_rmse_interval=[0.1, 0.4], silent="too quiet"),
        replace(first, group="unknown", log_rmse_interval=[float("nan")] * 2),
    ]  # fmt: skip
    gain = replace(strict, groups=rows)
    assert [g.group for g in gain.worse] == [first.group]
    named = replace(gain, groups=[replace(g, named=["gap", "reading_gain"]) for g in gain.groups])
    value = ParameterResult(0.8, 0.7, 0.9, "1", "a session's gain", 0.5)
    models = [replace(c, sessions=[SessionResult("reading_gain", 1, value)]) for c in record().causes]
    gained = of(replace(record(), causes=models, gain={"strict": named, "nested": gain}), Gained)
    assert [g.by_session for g in gained] == [["reading_gain"], []]
    own = gained[0].say(PLAIN)
    assert "What reading_gain does in a session that was not fitted is not known" in own
    said = Gained(gain, [1], []).say(PLAIN)
    assert said.endswith("Predicted worse than by the baseline: group 2 (0.900 to 0.200).")
    held = Gained(replace(gain, coverage_before=0.81, coverage_after=0.42), [1], []).say(PLAIN)
    assert "The 90 % bands hold 81 % of these readings before, 42 % after." in held


def test_how_often_chance_finds_as_much() -> None:
    def said(**options) -> str:
        return ByChance(replace(Significance(9.2, [-1.0, 2.4], 1 / 3), **options)).say(PLAIN)

    assert said() == (
        "None of 2 searches on simulated baselines found causes that lead the baseline by as much: 2.4 nats of log"
        " posterior odds at most, against 9 here (p <= 0.33, the least that 2 can show)."
    )
    assert "lead the baseline by as much: none put a cause first, against 9 here" in said(null=[-1.0, -2.4])
    where = "with nothing hidden (stored table, this catalogue, designs of 56 to 150 readings, no more than here:"
    assert f"None of 2 searches {where} with more, chance leads less) found causes that lead" in said(
        stored=True, readings=[56, 150]
    )
    beaten = said(lead=2.0, p_value=2 / 3)
    assert beaten.startswith("1 of 2 searches") and beaten.endswith(
        "2.4 nats of log posterior odds at most, against 2 here (p = 0.67)."
    )
    unknown = said(null=[], p_value=None, stored=True, missing="catalogue")
    assert "is not known: the stored searches are of another catalogue (--searches 19" in unknown


@pytest.mark.parametrize(
    ("looked_at", "reported"),
    [
        (LookedAt(1, 0, 0.0), "1 set of causes was fitted on all readings and sampled."),
        (LookedAt(3, 0, 0.0), "3 sets of causes were fitted on all readings, all of them sampled."),
        (
            LookedAt(25, 1, 0.062),
            "25 sets of causes were fitted on all readings, 24 of them sampled; the other has 6.2 % of the"
            " probability.",
        ),
        (
            LookedAt(30, 29, 0.0),
            "30 sets of causes were fitted on all readings, 1 of them sampled; the others have none of the probability"
            " together.",
        ),
        (
            LookedAt(1640, 1627, 1e-5),
            "1,640 sets of causes were fitted on all readings, 13 of them sampled; the others have less than 0.1 % of"
            " the probability together.",
        ),
    ],
)
def test_how_many_sets_were_looked_at_is_said(looked_at: LookedAt, reported: str) -> None:
    allowed = "The probabilities allow for a chance of 3 % that a better set was missed"
    assert Searched(looked_at, 0.03).say(PLAIN) == f"{reported} {allowed} (measured for one or two causes)."


def test_many_causes_without_a_limit_are_counted() -> None:
    room = Room([], "preload", 0.075, [f"cause_{k}" for k in range(6)], 9, None)
    assert room.say(PLAIN).endswith("Of 9 causes, 3 could be bounded; of the others no limit could be computed.")
    assert replace(room, unbounded=[]).say(PLAIN).endswith("and refitted. All 9 causes could be bounded.")
    assert replace(room, unbounded=[], of=1).say(PLAIN).endswith("and refitted. 1 cause could be bounded.")


@pytest.mark.parametrize(
    ("verdict", "named", "said"),
    [
        (
            "adequate",
            [],
            "The most that these readings leave to a further cause: preload changes a reading by up to 7.5 %"
            " (95 % limit), added to the baseline and refitted. Of 3 causes, 1 could be bounded; gap and"
            " swing_drag could not.",
        ),
        (
            "explained",
            ["gap"],
            "The most that these readings leave to a further cause: preload changes a reading by up to 7.5 %"
            " (95 % limit), added to gap and refitted. Of 2 other causes, 1 could be bounded; swing_drag"
            " could not.",
        ),
        ("unexplained", [], None),
    ],
)
def test_what_a_cause_may_change_is_said_of_what_was_bounded(verdict: str, named: list[str], said: str | None) -> None:
    """Given a model that does not explain the readings, no bound means anything."""
    record = make_record(make_experiment())
    shown, other = record.screening[:2]
    bounded = [replace(shown, id="preload", room=0.075), replace(other, room=None), record.screening[2]]
    texts = sentences(replace(record, verdict=verdict, named=named, screening=bounded))
    found = [text for text in texts if "changes a reading" in text]
    assert [text.partition(", with 95 %")[0] for text in found] == ([said] if said else [])


def test_what_may_be_at_work_as_well_is_said_with_what_it_would_change() -> None:
    d = record()
    size = ParameterResult(3.2e-5, 1.8e-5, 4.3e-5, "s", "lag", 0.5)
    own, name = next((c.parameters, "k_c") for c in d.causes if not c.terms)
    moved = replace(own[name], median=2.0, lower=1.0, upper=3.0)
    counted = Counted(["amplifier_lag"], 1.34, {"amplifier_lag_tau": size}, {name: moved})
    adequate = replace(d, verdict="adequate", named=[], alternatives=[], counted=[counted])
    (weak,) = of(adequate, TooWeak)
    said = weak.say(PLAIN)
    assert said.startswith(
        "Perhaps at work as well, but too weak to count by itself: amplifier_lag, with amplifier_lag_tau = 32 "
    )
    both = replace(weak, counted=replace(counted, by_readings=6.7)).say(PLAIN)
    assert "alone: the readings give a factor of 6.7, and what is expected of such rigs 0.2. With it" in both
    assert "1.3 times as probable as the baseline alone. With it, k_c = 2 (1 to 3) N/m, not" in said
    less = replace(weak, counted=replace(counted, odds=0.14)).say(PLAIN)
    assert "7.1 times less probable than the baseline alone." in less
    assert "With it" not in replace(weak, counted=replace(counted, moved={})).say(PLAIN)
    assert not of(replace(adequate, verdict="unexplained", named=["gap"]), TooWeak), "a wrong model says nothing of it"


def test_what_the_rig_is_held_to_have_and_moves_the_values_stands_next_to_them() -> None:
    d = record()
    assert d.best_model
    size, own = ParameterResult(6e-6, 3e-6, 8e-6, "s", "lag", 0.5), d.best_model.parameters["k_c"]
    moved = {"k_c": replace(own, median=41.0, lower=13.0, upper=104.0)}
    counted = Counted([*d.named, "amplifier_lag"], 7.1, {"amplifier_lag_tau": size}, moved, 0.37)
    belief = Belief("amplifier_lag_tau", LogNormal(9e-6, 1.3), "20 ohm", probability=0.95, derived=True)

    def weak(*beliefs: Belief, **change: Any) -> TooWeak:
        given = answer(replace(d, counted=[replace(counted, **change)]), beliefs)
        (found,) = [s for s in given if isinstance(s, TooWeak)]
        return found

    found = weak(belief)
    said = found.say(PLAIN)
    assert found.topic == "wrong" and said.startswith(
        "The values of hysteresis are without amplifier_lag (95 % by [rig]), which the readings do not show. With it"
        " the set is 7.1 times as probable. With it, k_c = 41 (13 to 104) N/m, not "
    )
    assert said.endswith(
        "To see amplifier_lag: the voltage at the stack after a step of the command, on an oscilloscope."
    )
    # What nobody holds, though the catalogue expects it, what moves nothing and what is improbable stands besides.
    for other in (weak(), weak(belief, moved={}), weak(belief, odds=0.8)):
        assert other.topic == "besides" and other.say(PLAIN).startswith("Perhaps at work as well")


@pytest.mark.parametrize(
    ("lower", "said"), [(1.38e-6, "7e+05 V/s (6.76e+05 to 7.25e+05)"), (0.0, "7e+05 V/s (at least 6.76e+05)")]
)
def test_what_is_known_by_its_reciprocal_is_said_so(lower: float, said: str) -> None:
    d = record()
    slew = ParameterResult(1 / 7e5, lower, 1.48e-6, "s/V", "one over the largest rate", 0.5, "V/s")
    counted = Counted(["slew_limit"], 1.34, {"slew_limit_inverse": slew}, {})
    adequate = replace(d, verdict="adequate", named=[], alternatives=[], counted=[counted])
    (weak,) = of(adequate, TooWeak)
    assert f" s/V, that is {said}." in weak.say(PLAIN)


@pytest.mark.parametrize(
    ("p_value", "simulated", "narrow"), [(0.025, 199, True), (0.025, 9999, False), (0.01, 199, False)]
)
def test_a_baseline_that_chance_may_have_passed_is_called_narrow(p_value: float, simulated: int, narrow: bool) -> None:
    (judged,) = of(record(), Judged)
    said = replace(judged, adequate="yes", p_value=p_value, simulated=simulated).say(PLAIN)
    assert ("so it passes narrowly" in said) is narrow


def test_what_cannot_be_tested_is_said_to_be_so() -> None:
    """No share of no data sets; the chance that no cause shows stays."""
    said = Judged("yes", 1.0, 0, 0.9, False).say(PLAIN)
    assert said.startswith("The baseline cannot be tested: ") and said.endswith("no cause shows is 90 %.")
    assert "data sets" not in said
    assert Judged("improbable", 1.0, 0, 0.1, False).say(PLAIN).endswith("improbable compared with an extended model.")


def test_no_part_is_larger_than_its_whole() -> None:
    """Where other groups lose, the one that gains is said to gain, and they to lose."""
    assert OneGroup(1, 7.0, 12.0, None).say(PLAIN) == (
        "The named causes gain 12.0 nats in group 1 and lose 5.0 nats in the others."
    )
    assert OneGroup(1, 7.0, 6.0, 5.0).say(PLAIN) == (
        "Of the 7.0 nats that the named causes gain, group 1 contributes 6.0 nats; fitted to the other groups alone,"
        " they gain 5.0 nats."
    )

"""The report of a diagnosis, built from a made-up record: no simulation, no search."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnoses_by_hand import CONSTANTS, build, growth, make_experiment, make_record
from reader import HOSTILE, Reader

from psafit.diagnose.answer import answer as answer_of
from psafit.diagnose.answer.besides import Against, AtWork
from psafit.diagnose.answer.worth import Next
from psafit.diagnose.confusable import Confounded
from psafit.diagnose.explanations import Explanation
from psafit.diagnose.gain import Choice
from psafit.diagnose.next_experiment import NextExperiment, Pair, Proposal, Purpose
from psafit.diagnose.record import Confusion, Diagnosis
from psafit.diagnose.record.misfit import MisfitResult
from psafit.diagnose.record.models import NOT_EXCLUDED, UNSEEN, Counted, ModelShown
from psafit.diagnose.significance import Significance
from psafit.diagnose.words import NO_ACTION, PLAIN
from psafit.experiment import Experiment, Group, fingerprint
from psafit.model_search.model_set import LookedAt
from psafit.observables import LAUNCH_SPEED, OBSERVABLES
from psafit.parameters import Belief, LogNormal, Normal, Tailed
from psafit.records import Broken, plain, read_json, write_json
from psafit.report.catalogue import model
from psafit.report.diagnosis import causes, gain, misfit, next_experiment
from psafit.report.diagnosis.answer import kind
from psafit.report.page_words import PAGE

pytestmark = pytest.mark.usefixtures("undrawn")  # the page that most tests read is drawn nevertheless

NOT_A_NUMBER = re.compile(r"\b(nan|inf|None)\b(?! proposed)")
SECTIONS = [
    "Measured and simulated", "What is wrong", "Causes", "Alternatives", "What remains", "Gain", "Next experiment",
    "Numerics", "Provenance",
]  # fmt: skip


def quick(record: Diagnosis) -> Diagnosis:
    return replace(record, quick=True, gain={}, next_experiment=NextExperiment(), ledger=record.ledger[:1])


def adequate(record: Diagnosis) -> Diagnosis:
    tests = replace(record.misfit.baseline, p_value=0.44, character="none", odd_groups=[], odd_points=[])
    misfit = MisfitResult(0.44, [], tests, record.misfit.leftover)
    return replace(
        quick(record), verdict="adequate", named=[], alternatives=[], misfit=misfit,
        causes=[replace(record.causes[-1], probability=0.97)],
        show={"baseline": record.show["baseline"]}, sentences=["The tests find nothing wrong with the baseline."],
        screening=[s for s in record.screening if s.verdict != "present"],
    )  # fmt: skip


def doubtful(record: Diagnosis) -> Diagnosis:
    """An adequate baseline that others could replace."""
    found = adequate(record)
    others = [replace(record.causes[1], probability=0.6), replace(record.causes[0], probability=0.03)]
    return replace(found, causes=[replace(found.causes[0], probability=0.37), *others])


def unexplained(record: Diagnosis) -> Diagnosis:
    """No cause helps: nothing is named, and the record has no extension."""
    misfit = replace(record.misfit, extended=None)
    weak = NextExperiment.of(record.next_experiment.proposals[1:], Purpose("narrow", parameter="k_c"))
    return replace(
        record, verdict="unexplained", named=[], alternatives=[], causes=record.causes[-1:], misfit=misfit,
        show={"baseline": record.show["baseline"]}, next_experiment=weak,
    )  # fmt: skip


def unnamed(record: Diagnosis) -> Diagnosis:
    """The tests find nothing, no cause helps, and yet there is something smooth, but in a group that cannot show it."""
    left = record.misfit.leftover
    groups = [*left.groups[:-1], replace(left.groups[-1], mean=None, largest=None)]
    misfit = replace(adequate(record).misfit, leftover=replace(left, groups=groups))
    return replace(unexplained(record), misfit=misfit, unnamed=0.81)


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Reader:
    folder = tmp_path_factory.mktemp("secret-place")
    experiment = make_experiment(HOSTILE)
    return build(make_record(experiment, title=HOSTILE), experiment, folder)


def test_sections_are_there_in_order(page):
    assert page.headings == SECTIONS
    targets = {attrs.get("id") for _, attrs in page.tags}
    links = [attrs["href"] for attrs in page.all("a")]
    assert len(links) > 8 and {link.removeprefix("#") for link in links if link.startswith("#")} <= targets
    assert [link for link in links if not link.startswith("#")] == ["extension/report.html"]


def test_first_screen_answers(page):
    text = page.first_screen
    assert text.index("ambiguous") < text.index("Examined: 42 readings of groups 1, 2 and")
    assert "and 3 candidate causes" in text
    assert "The tests find the baseline wrong: of 999 data sets simulated from the fitted baseline, none look" in text
    assert "hysteresis of the stack (probability 61 %)" in text
    assert "90 % interval: hysteresis of the stack s = 4.10 × 10⁵ (3.80 to 4.40) × 10⁵ and" in text  # sizes
    expected = "(its prior expects 1.00 × 10⁴ to 2.00 × 10⁵ V) of hysteresis of the stack."
    assert f"Implausible values: U = 4.10 × 10⁵ V (3.80 to 4.40) × 10⁵ {expected}" in text
    assert "without a name keeps" not in text
    odd = (
        "group 1, 200 Hz, 20 V (100 µm read, 140 µm predicted). 1 reading is off by more than four standard deviations."
    )
    assert f"Furthest from hysteresis of the stack: {odd}" in text
    assert "goes from a factor of 2.49 to 1.29" in text
    assert "Baseline off by ×" in page.text and "extended model off by ×" in page.text
    missed = "in which the extended model gains most, and of the others the one that the extended model misses most, "
    assert f"Below, group 1, {missed}group {HOSTILE}." in text
    assert "22,000 times" in text
    apart = "separates hysteresis of the stack from gap at rest + slew-limited amplifier"
    assert f"Next, measure sine, 20 V: it best {apart}, with an expected lead of 12.5 ± 0.4 nats." in text
    # The short answer first, and of what is next that which costs least.
    order = ("90 % interval:", "What was gained?", "Without launches,", "Next, measure", "say besides", "Furthest from")
    places = [text.index(part) for part in order]
    assert places == sorted(places)


def test_record_is_shown(page):
    for expected in (
        "10.0 to 20.0 V: predictions too small by a factor of 2.50 (8.1 standard deviations)",
        "+151.2 ± 0.04", "−0.6 / +0.3", "2210 draws, k 0.31", "98.5 %", "Implausible", "1 value",
        "(3.80 to 4.40) × 10⁵ N/m", "not sampled", "90.2 nats", "0.7 nats", "×3.30", "more than ×8000",
        "could not have been seen", "not present", "runs along the sweep", "reading 4 of group 1",
        "−1.2 nats over none", "Mean log RMSE 0.912 before, 0.254 after; change −0.710 to −0.520",
        "change +310.0 to +402.0 nats", "0.900 (×2.46)", "+179.5", "42 % / 91 %", "hysteresis of the stack 80 %",
        "5.00 at 700 nm", "12.5 ± 0.4 nats", "93 %", "−0.800 to −0.610",
        "+179.5 (+150.0 to +210.0)",
        "Without launches, check what the stack does: that shows whether", "Without launches", "62 %",
        "l = 0.0750 m", "0.99", "3.1·10⁻⁷", "causes 12.5 s",
        "psafit diagnose experiments/made-up --group 1", "all other sets of causes", "a discrepancy without a name",
        "164 sets of causes were fitted on all readings, 13 of them sampled; the others have 0.4 % of the probability",
    ):  # fmt: skip
        assert expected in page.text.replace("3.1 × 10⁻⁷", "3.1·10⁻⁷"), expected
    assert not re.search(r"\bu[ms]\b", page.text)
    assert not NOT_A_NUMBER.search(page.text)


def test_hostile_text_is_escaped(page):
    assert page.foreign.lower().count("<script") == 1  # the numbers that the page's own script draws
    assert page.all("script") == [{"type": "application/json"}, {}]
    assert page.html.count("</style>") == 1
    assert HOSTILE in page.text and f"Group {HOSTILE}" in page.text
    allowed = {"class", "id", "href", "src", "alt", "lang", "charset", "name", "content", "scope", "role", "tabindex",
               "aria-label", "open", "http-equiv", "type"}  # fmt: skip
    assert {name for _, attrs in page.tags for name in attrs} <= allowed


def test_growth_says_what_it_leaves_out():
    for zeros, said in (
        ({}, None),
        ({"1": 1}, "without 1 reading of zero, which has"),
        ({"1": 2}, "2 readings of zero"),
    ):
        (picture,) = misfit.growth_pictures(growth(0.5), [], {}, zeros)
        assert said is None or said in picture.caption
        assert ("logarithm" in picture.caption) == bool(zeros)


def test_page_stands_alone(page):
    images = page.all("img")
    assert len(images) == 1 + 3 + 1 + 2 + 3 + 2  # first screen, groups, growth, screening, discrepancy, gain
    assert all(len(i["alt"] or "") > 30 and (i["src"] or "").startswith("data:image/") for i in images)
    assert len({i["alt"] for i in images}) == len(images)
    assert not page.all("link") and not page.all("iframe")
    assert not re.search(r"https?://|url\(|@import", page.foreign)
    assert "secret-place" not in page.html
    assert len(page.html) < 5e6


@pytest.mark.parametrize(
    ("change", "said", "not_said"),
    [
        (
            quick,
            ["was measured: a quick diagnosis", "None proposed"],
            ["every other group scored", "Measured on readings"],
        ),
        (
            adequate,
            [
                "Is the baseline adequate? Yes",
                "No extension was adopted",
                "No cause is needed. What the readings leave",
            ],
            ["No cause of the", "Nor can they exclude", "No other set"],
        ),
        (
            doubtful,
            [
                "Is the baseline adequate? As far as these readings show. The tests find nothing wrong",
                "stays open: more probable than none (37 %) is gap at rest + slew-limited amplifier (60 %). A set is",
            ],
            ["Yes."],
        ),
        (
            unexplained,
            [
                "Check first what psafit takes as given: the waveform,",
                "No cause of the catalogue stands out that would explain what these readings show. What the baseline",
                "standard deviation falls by about 78 %",
                "Narrowing",
            ],
            ["Success", "Extended", "No other set", "changes a reading by"],
        ),
        (
            unnamed,
            [
                "but it is improbable compared with a discrepancy without a name.",
                "would explain what these readings show. A discrepancy without a name keeps 81 % of the probability.",
                "Group 2 ×1.01 ×1.05 Group third – –",
            ],
            ["compared with an extended model", "Of the baseline"],
        ),
    ],
)
def test_empty_parts_are_said(change, said, not_said, tmp_path):
    experiment = make_experiment("third")
    page = build(change(make_record(experiment)), experiment, tmp_path)
    assert page.headings == SECTIONS
    for text in said:
        assert text in page.text
    for text in not_said:
        assert text not in page.text
    assert not NOT_A_NUMBER.search(page.text)


def test_each_cause_can_be_taken_out_of_the_curves(tmp_path):
    experiment = make_experiment()
    html = build(make_record(experiment), experiment, tmp_path).html
    reported = json.loads(re.search(r'<script type="application/json">(.*?)</script>', html, re.DOTALL)[1])
    curves = {c["name"]: c for c in reported[0]["curves"]}
    assert "without: gap at rest" not in curves  # no number everywhere
    out = curves["without: hysteresis of the stack"]
    first = experiment.groups[0].reading
    assert out["off"] and not curves["extended model"]["off"]
    assert sorted(out["middle"]) == pytest.approx(sorted(1.4 * first), rel=1e-4)


def test_what_a_proposal_leaves_tied_and_what_is_confounded_is_reported(tmp_path):
    experiment = make_experiment("a rig")
    record = make_record(experiment)
    sets = [["hysteresis"], ["gap", "slew_limit"], ["swing_drag"]]
    two = ((0, 1), (0, 2), (1, 2))
    proposals = [
        replace(p, pairs=[Pair(sets[i], sets[j], x) for (i, j), x in zip(two, apart, strict=True)])
        for p, apart in zip(record.next_experiment.proposals, ((40.0, 50.0, 45.0), (0.2, 31.0, 30.0)), strict=True)
    ]
    reported = NextExperiment.of(proposals, Purpose("separate", sets))
    scores = record.gain["strict"].groups
    worse = [replace(scores[0], log_rmse_interval=[0.2, 0.4]), *scores[1:]]
    record = replace(
        record,
        next_experiment=reported,
        confusion=Confusion([Confounded("hysteresis", "swing_drag", 3.4)]),
        gain=record.gain | {"strict": replace(record.gain["strict"], groups=worse)},
    )
    page, none = build(record, experiment, tmp_path), "No other cause that could be seen is confounded"
    rivals = "separates hysteresis of the stack from gap at rest + slew-limited amplifier and drag on the swing"
    assert rivals in page.first_screen
    assert "12.5 ± 0.4 nats 93 % none" in page.text
    assert "1.5 ± 0.1 nats – hysteresis of the stack and gap at rest + slew-limited amplifier" in page.text
    assert "hysteresis of the stack drag on the swing 3°" in page.text and none not in page.text
    alone = replace(record, confusion=Confusion([]))
    assert none in build(alone, experiment, tmp_path).text
    assert none not in build(replace(alone, named=[], verdict="adequate"), experiment, tmp_path).text
    assert (
        "Predicted worse than by the baseline: group" in page.first_screen and "worse than by the baseline" in page.text
    )


def test_a_baseline_that_breaks_a_law_is_not_green() -> None:
    passed = adequate(make_record(make_experiment("a rig")))
    law = Broken("carried", [], 1, 200.0, 20.0, 2.0, 3.0, 1, "group 1")
    assert kind(passed) == kind(replace(passed, laws=[replace(law, terms=["gap"])])) == "good"
    assert kind(replace(passed, laws=[law])) == "bad"


def test_only_what_was_looked_at_is_said_to_do_less_well(tmp_path):
    experiment = make_experiment("a rig")
    alone = replace(make_record(experiment), verdict="explained", alternatives=[])
    text = " ".join(build(alone, experiment, tmp_path / "whole").text.split())
    assert "no other set does as well" in text and "No other set of causes does as well." in text
    doubtful = replace(alone, looked_at=LookedAt(164, 151, 0.02))
    text = " ".join(build(doubtful, experiment, tmp_path / "part").text.split())
    assert "no other set that was sampled does as well" in text
    assert "No other set of causes that was sampled does as well." in text
    few = replace(alone, left_out=["gap"])
    text = " ".join(build(few, experiment, tmp_path / "few").text.split())
    assert "no other set of these causes does as well" in text and "No other set of these causes does as well." in text


def test_no_share_is_printed_of_a_cause_that_is_not_needed(tmp_path):
    """It counts with the model without it; that is no evidence against it."""
    experiment = make_experiment("a rig")
    record = make_record(experiment)
    named, gap, drag = record.screening
    found = [named, gap, replace(gap, id="preload", verdict=NOT_EXCLUDED, inclusion=0.0)]
    found += [replace(gap, id="adhesion", verdict=NOT_EXCLUDED), replace(drag, verdict=NO_ACTION, inclusion=0.0)]
    shares = [" ".join(row[-1].split()) for row in causes.screening_rows(found)]
    assert shares == ["64 %", "33 %", "–", "33 %", "–"]
    page = build(replace(record, screening=found), experiment, tmp_path)
    assert "1 does not act on what was read: drag on the swing" in page.first_screen
    assert "could not have been seen" not in page.first_screen
    assert "or changes only what was not read" in page.text
    assert "where a cause does not show, its model counts as the model without it" in page.text


def test_how_alternatives_were_judged() -> None:
    record = make_record(make_experiment())
    nothing = replace(record, alternatives=[*record.alternatives, []])
    assert [row[-1] for row in causes.alternatives(nothing)["rows"]] == ["sampled", "–", "estimated from a short fit"]


def test_a_search_repeated_from_nothing_is_in_the_ledger() -> None:
    audit = Choice(
        "the same search from nothing", [1], [], led_to=["gap"], begun_led_to=["preload"], log_posterior_below_begun=1.5
    )
    ((choice, *_),) = gain.ledger([audit])
    assert choice.striptags() == (
        "the same search from nothing: it leads to gap at rest, the other to ball leans on the tip,"
        " whose log posterior is 1.50 nats higher"
    )
    ((choice, *_),) = gain.ledger([replace(audit, begun_led_to=["gap"])])
    assert choice.endswith(", too")


def test_where_the_p_value_of_a_search_comes_from(tmp_path):
    experiment = make_experiment()
    record = make_record(experiment)
    repeated = Significance(9.2, [-1.0, 2.4], 1 / 3)
    stored = replace(repeated, stored=True, readings=[56, 150])
    unknown = replace(stored, null=[], p_value=None, missing="settings")
    for k, (search, said) in enumerate(
        (
            (repeated, "repeated on 2 sets of readings simulated from the fitted baseline."),
            (repeated, "by at most 2.4 nats in the simulated ones: p ≤ 0.33, the least that 2 can show."),
            (
                stored,
                "2 whole searches, with the same catalogue, on designs of 56 to 150 readings with nothing hidden.",
            ),
            (unknown, "is not known: the stored searches have other settings."),
        )
    ):
        reported = replace(record, misfit=replace(record.misfit, search=search))
        (tmp_path / f"{k}").mkdir()
        assert said in build(reported, experiment, tmp_path / f"{k}").text


def test_one_group(tmp_path):
    """Nothing can be held out, and a single condition has no sweep."""
    group = Group("only one", "sine", "1.csv", [900.0, 900.0], [20.0, 20.0], [3.0, 0.0])
    experiment = Experiment("One", "", CONSTANTS, (group,), Path("x"), fingerprint(CONSTANTS, (group,)))
    record = make_record(experiment)
    show = {k: ModelShown([], [], [], [], [2.0, 2.5], {}, {}) for k in record.show}
    page = build(
        replace(record, gain={}, training=["only one"], show=show, ledger=record.ledger[:1]), experiment, tmp_path
    )  # fmt: skip
    assert page.headings == SECTIONS
    assert "there is no group that could be held out" in page.text
    assert "No sweep has enough neighbouring readings" in page.text


def test_priors_that_follow_are_not_those_that_are_stated(tmp_path):
    lag = Tailed(Normal(7.5e-5, 2e-5))
    beliefs = (
        Belief("amplifier_lag_tau", lag, "50 ohm into 1.5 uF", probability=0.95, derived=True),
        Belief("k_c", LogNormal(4e6, 1.5), "measured"),
    )
    experiment = replace(make_experiment("One"), beliefs=beliefs)
    text = build(make_record(experiment), experiment, tmp_path).text
    followed = f"amplifier_lag_tau (s): {lag.describe()}; at work: 0.95 (50 ohm into 1.5 uF)"
    assert re.search(r"Priors that follow from \[rig\]\s*" + re.escape(followed), text)
    assert re.search(r"Priors that the experiment states\s*k_c \(N/m\): log-normal, median 4e\+06, factor 1.5", text)


def test_what_is_at_work_by_the_rig_is_on_the_first_screen(tmp_path):
    """Of causes that the readings neither show nor exclude; what is stated comes before what follows."""
    experiment = make_experiment()
    record = make_record(experiment)
    record = replace(
        record,
        screening=[
            replace(record.screening[-1], id=id, verdict=verdict, inclusion=0.02, visible=9.0, room=room, left=left)
            for id, verdict, room, left in (
                ("amplifier_lag", UNSEEN, 0.03, None), ("anchored_stroke", NOT_EXCLUDED, None, 2.6),
                ("adhesion", "not present", None, None), ("preload", UNSEEN, None, None),
                ("gap", "not present", None, None),
                ("swing_drag", "explains part alone", None, 2.4), ("hysteresis", "explains", None, None),
            )
        ],
    )  # fmt: skip
    wide = Tailed(Normal(0.0, 1.0))
    known = {"amplifier_lag_tau": 0.95, "anchored_voltage": 0.7, "gap_width": 0.9, "preload_offset": 0.9}
    known |= {"adhesion_force": 0.9, "swing_drag_rate": 0.6, "hysteresis_strength": 0.9}
    follow = [Belief(name, wide, "it follows", derived=True, probability=p) for name, p in known.items()]
    doubted = Belief("preload_offset", wide, "looked at", probability=0.1)
    page = build(record, replace(experiment, beliefs=(*follow, doubted)), tmp_path)
    assert (
        "Probably at work, by what is known of the rig, but not seen in these readings: lagging amplifier (95 % by"
        " [rig]; it may change a reading by up to 3 %), stroke rises to the data sheet's, with its loop (70 % by"
        " [rig]). The values here are without them; those with them are given by psafit fit EXP --group 1,2,3 --terms"
        " hysteresis,amplifier_lag,anchored_stroke. To see" in " ".join(page.first_screen.split())
    )
    assert "<code>psafit fit EXP --group 1,2,3 --terms hysteresis,amplifier_lag,anchored_stroke</code>" in page.html
    assert "Probably at work" not in build(record, experiment, tmp_path).first_screen
    doubted = "(90 % by [rig], 2 % after the readings)"
    needed = "What they leave is shown by psafit fit EXP --group 1,2,3 --terms hysteresis,adhesion,swing_drag."
    drag = "drag on the swing (60 % by [rig], 2 % after the readings)"
    assert f"speak against what is expected of the rig: adhesion {doubted}, {drag}. {needed}" in " ".join(
        page.first_screen.split()
    )
    likely = replace(record, screening=[replace(s, inclusion=0.6) for s in record.screening])
    counted = replace(record, counted=[Counted(["adhesion", "swing_drag"], 1.2, {}, {})])
    for other in (likely, counted):
        assert not any(isinstance(s, Against) for s in answer_of(other, follow))
    (silent,) = [s for s in answer_of(replace(record, verdict="unexplained"), follow) if isinstance(s, AtWork)]
    assert [id for id, *_ in silent.causes] == ["amplifier_lag"], "a model that is wrong bounds nothing"


def test_a_record_read_back_gives_the_same_page(tmp_path):
    """What was not a number is null in the file."""
    experiment = make_experiment()
    record = make_record(experiment)
    record = replace(record, numerics=replace(record.numerics, stable_step=math.nan))
    write_json(tmp_path / "diagnosis.json", record, sealed=True)
    stored = read_json(tmp_path / "diagnosis.json", Diagnosis, sealed=True)
    assert stored.misfit.where == record.misfit.where and math.isnan(stored.numerics.stable_step)
    held = json.loads((tmp_path / "diagnosis.json").read_text("utf-8"))
    assert held["misfit"]["where"][0]["from"] == 10.0 and "search" not in held["misfit"]
    first, second = (build(r, experiment, tmp_path / name) for r, name in ((record, "a"), (stored, "b")))
    assert first.html == second.html


def test_an_adopted_model_that_is_not_listed(tmp_path):
    """Where a discrepancy takes all the probability, the record lists the baseline alone."""
    experiment = make_experiment()
    record = make_record(experiment)
    show = record.show | {"extended": replace(record.show["extended"], parameters={"k_c": 3.21e6})}
    smooth = replace(
        record, verdict="unexplained", unnamed=1.0, causes=record.causes[-1:], show=show,
        unexplained_by="smooth",
    )  # fmt: skip
    page = build(smooth, experiment, tmp_path / "smooth")
    assert "hysteresis of the stack, but a smooth curve in its place is more probable" in page.text
    page = build(replace(smooth, unexplained_by="structure"), experiment, tmp_path / "left")
    assert "The best extension is hysteresis of the stack, but structure remains" in page.text
    assert "3.21 × 10⁶ N/m" in page.text and "The adopted model is not among those listed" in page.text
    assert not NOT_A_NUMBER.search(page.text)


def test_the_headline_names_what_is_tied() -> None:
    record = make_record(make_experiment())

    def said(verdict: str, named: list[str], alternatives: list[list[str]]) -> str:
        return replace(record, verdict=verdict, named=named, alternatives=alternatives).headline

    assert said("adequate", [], []) == "verdict: adequate, though hysteresis is more probable"
    plain = replace(record, verdict="adequate", named=[], causes=[c for c in record.causes if not c.terms])
    assert plain.headline == "verdict: adequate"
    assert said("explained", ["a", "b"], []) == "verdict: explained: a + b"
    assert said("unexplained", ["a"], [["b"]]) == "verdict: unexplained; best of the catalogue: a"
    assert said("ambiguous", ["a"], [["b", "c"], []]) == "verdict: ambiguous: a, or b + c, or nothing"
    assert said("ambiguous", list("abcdef"), [["x"], ["y"]]).endswith("a + b + c + d + e + f, or 2 more sets")


def test_no_set_is_as_good_as_a_best_extension_that_explains_nothing(tmp_path):
    experiment = make_experiment()
    record = replace(make_record(experiment), verdict="unexplained")
    text = build(record, experiment, tmp_path).first_screen
    best_model, other = model(record.named), model(record.alternatives[0])
    assert f"The best extension is {best_model}" in text and f"Next best: {other} (31 %); " in text
    assert "as good" not in text.lower()


def test_large_sets_are_described_by_what_differs():
    _instead = PAGE.instead
    named = ["hysteresis", "gap", "slew_limit"]
    leans = "ball leans on the tip"
    assert _instead(named, ["hysteresis", "gap", "preload"]) == f"{leans} in the place of slew-limited amplifier"
    assert _instead(named, ["hysteresis", "gap"]) == "these without slew-limited amplifier"
    assert _instead(named, [*named, "preload"]) == "these and ball leans on the tip"
    assert _instead(named, ["preload", "gap"]) == model(["preload", "gap"])
    assert _instead(["gap"], ["preload"]) == model(["preload"])
    sets = [["hysteresis", "gap"], ["hysteresis", "preload"], ["hysteresis", "slew_limit"]]
    shared = Purpose("separate", sets).say(PAGE)
    assert (
        "separates gap at rest from ball leans on the tip and slew-limited amplifier (apart from what they share)"
        in shared
    )
    assert "share" not in Purpose("separate", [["hysteresis"], ["hysteresis", "preload"]]).say(PAGE)


def test_a_proposal_that_hardly_separates_is_not_recommended(tmp_path):
    experiment = make_experiment("a rig")
    record = replace(make_record(experiment), looks=[])
    best = replace(record.next_experiment.proposals[0], separation=0.36, error=0.05, success=0.0)
    record = replace(record, next_experiment=replace(record.next_experiment, proposals=[best]))
    text = build(record, experiment, tmp_path).first_screen
    assert (
        "No measurement within the ranges measured, or those of [limits], would show much: sine, 20 V, separates"
        in text
    )
    assert "with an expected lead of 0.4 ± 0.1 nats, hardly worth the measurement." in text
    weak = replace(best, separation=0.05, error=0.02, success=None, pairs=[])
    record = replace(record, next_experiment=NextExperiment.of([weak], Purpose("narrow", parameter="k_c"), weak=True))
    text = build(record, experiment, tmp_path).first_screen
    assert (
        "would show much: sine, 20 V, determines kc (contact stiffness), whose standard deviation falls by about"
        " 5 %, hardly worth the measurement; so far it is known no better than to half its prior's width. More" in text
    )


def test_what_decides_little_or_no_better_than_others_is_said():
    first = replace(make_record(make_experiment()).next_experiment.proposals[0], separation=2.4, error=0.1)
    near, far = replace(first, separation=2.2), replace(first, separation=2.0)
    separates = NextExperiment.of([first, near, far], Purpose("separate", [["gap"], ["preload"]]))
    assert Next(separates, more=False).say(PLAIN) == (
        "Next, measure sine, 20 V: it separates gap from preload, with an expected lead of 2.4 +- 0.1 nats, hardly"
        " enough to decide; 1 other proposal may do as well."
    )
    clear = [replace(first, separation=x) for x in (49.0, 48.0, 40.0)]
    assert NextExperiment.of(clear, separates.purpose).as_good == 1  # beyond 45 nats none is better
    known = NextExperiment.of([first], Purpose("narrow", parameter="k_c"), weak=False)
    assert Next(known, more=False).say(PLAIN) == (
        "Next, measure sine, 20 V: it best determines k_c (contact stiffness), whose standard deviation falls by"
        " about 91 %; so far it is known to less than half its prior's width."
    )


def test_what_is_left_is_to_be_measured_again(tmp_path):
    """Structure that no cause explains: what it may follow so far, and what each outcome would mean."""
    experiment = make_experiment("a rig")
    record = unexplained(make_record(experiment))
    best = Proposal("sine, 20 V, 900 to 2000 Hz", "sine", [900.0, 2000.0], [20.0, 20.0], {}, 6.24, 0.91, 0.2)
    explanations = [Explanation("session", 0.62), Explanation("frequency", 0.3), Explanation("size", 0.08)]
    found = NextExperiment.of([best], Purpose("explain", explanations=explanations))
    assert found.separates and "shows whether what is left belongs to sessions (62 %) or follows" in found.promise(best)
    record = replace(record, next_experiment=found)
    page = build(record, experiment, tmp_path)
    assert (
        "Next, measure sine, 20 V, 900 to 2000 Hz: it best shows whether what is left belongs to sessions (62 %) or"
        " follows the frequency (30 %) or follows the size of what is read (8 %), with an expected lead of 6.2 ± 0.2"
        " nats." in page.first_screen
    )
    section = " ".join(page.text[page.text.index("Ranked by how well") :].split())
    assert "gain of the right explanation in log odds against all the others" in section and "stay tied" not in section
    assert "look at what was changed in between" in section and "something swings along" in section
    assert "look at the drive" not in section  # that it follows the amplitude is excluded
    # A record without the new key is one of before.
    assert "explanations" not in plain(Purpose("narrow", parameter="k_c"))


def test_a_proposal_names_its_drive_and_whose_motion_is_read(tmp_path):
    """The burst and the bias belong to it; a velocity is the ball's."""
    first = make_record(make_experiment()).next_experiment.proposals[0]
    burst = replace(first, waveform="unipolar_sine", drive={"cycles": 5.0, "bias_v": 2.0})
    trace = replace(burst, observable="velocity", time_us=[1.0, 340.0], frequency_hz=[5e3], amplitude_v=[90.0])
    table = replace(first, waveform="table", drive={"drive": "level.csv"}, observable="contact_time")
    tip = replace(trace, observable="tip_displacement", drive={})
    shown = next_experiment.proposals(NextExperiment.of([burst, trace, table, tip], Purpose("narrow", parameter="c_s")))
    assert [" ".join(row[0].split()) for row in shown["rows"]] == [
        "unipolar sine (bias 2 V, 5 periods), 2 readings",
        "unipolar sine (bias 2 V, 5 periods), 2 samples over 340 µs of the ball's velocity".replace("'", "&#39;"),
        "table level.csv, 2 readings of the contact time",
        "unipolar sine, 2 samples over 340 µs of the tip displacement",
    ]
    assert Purpose("narrow", parameter="c_s").say(PLAIN) == "determines c_s (structural damping of the stack)"
    assert Purpose("narrow", parameter="of_a_plugin").say(PLAIN) == "determines of_a_plugin"


def test_provenance_names_the_tables_that_hold_something(tmp_path):
    """Where launch speeds alone are read, the table of ranges has nothing but its heading."""
    speeds, experiment = OBSERVABLES.index(LAUNCH_SPEED), make_experiment()
    fast = [replace(g, measured=np.full(g.n_points, speeds, np.int8)) for g in experiment.groups]
    for groups, tables in (
        (experiment.groups, "predictions-diagnosis.csv"),
        (fast, "predictions-diagnosis-launch_speed.csv"),
        ([*experiment.groups[:2], fast[2]], "predictions-diagnosis.csv, predictions-diagnosis-launch_speed.csv"),
    ):
        record = replace(make_record(experiment), gain={})
        text = build(record, replace(experiment, groups=tuple(groups)), tmp_path).text
        assert f"Predictions of the adopted model{tables} Fingerprint" in " ".join(text.split())


def test_no_gain_is_reported_where_no_cause_was_named(tmp_path):
    """The training groups may name nothing by themselves: that is neither a gain of nothing nor an uncertain one."""
    experiment = make_experiment()
    record = make_record(experiment)
    strict = record.gain["strict"]
    rows = [replace(group, named=[]) for group in strict.groups]
    strict = replace(strict, groups=rows, log_rmse_after=0.9121, log_rmse_interval=[-1e-4, 1e-4])
    page = build(replace(record, gain=record.gain | {"strict": strict}), experiment, tmp_path)
    assert "Gain on unseen data (strict): none; no cause is named by group 1 alone." in page.text
    assert page.text.count("name no cause by themselves") == 1 and "includes zero" not in page.text


def test_a_set_far_ahead_of_each_other_is_not_said_to_tie(tmp_path):
    """Many that are improbable one by one may keep it from a name together."""
    record = make_record(make_experiment())
    own, *others = record.causes
    for p, said in ((0.9, "is far more probable than any other set, but is named alone only from 95 %"),
                    (0.2, "These readings cannot decide between")):  # fmt: skip
        causes = [replace(own, probability=p), *(replace(c, probability=0.02) for c in others)]
        found = replace(
            record, verdict="ambiguous", causes=causes, alternatives=[c.terms for c in others if c.terms][:1]
        )
        assert any(said in s.say(PLAIN) for s in answer_of(found)), p

"""The yardstick of the search: data sets are the same for all, and a comparison says what is worse."""

from __future__ import annotations

import copy
import json
import sys
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from psafit.diagnose.misfit import examine
from psafit.experiment import Experiment, read_experiment
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import TERMS, term, terms
from psafit.physics.term import SLOTS

BENCHMARKS = Path(__file__).resolve().parents[1] / "benchmarks"
sys.path.insert(0, str(BENCHMARKS))

yardstick, search_sets, estimates, null_leads, cases, peers, work_precision, ties, against_version, surprises = map(
    import_module,
    (
        "search",
        "search_sets",
        "estimates",
        "null_leads",
        "cases",
        "peers",
        "work_precision",
        "ties",
        "against_version",
        "surprises",
    ),
)
fit_pages = import_module("fit_pages")


def record(id: str = "one", **changes: Any) -> dict[str, Any]:
    """What a run says of a data set."""
    return {
        "id": id,
        "fingerprint": "f",
        "code": "c",
        "seed": 1,
        "most": 4,
        "truth": ["gap"],
        "truth_found": {"fitted": True, "reported": True},
        "missed": -1.0,
        "best": {"causes": ["gap"], "log_posterior": -500.0, "probability": 0.9},
        "n_fitted": 3,
        "cpu_s": 10.0,
        "wall_s": 11.0,
        "pace_s": 0.2,
        **changes,
    }


def best(log_posterior: float) -> dict[str, Any]:
    return {"causes": ["gap"], "log_posterior": log_posterior, "probability": 0.9}


def test_surprises_are_of_every_slot_and_count_where_enough_shows() -> None:
    strong = [one for one in surprises.wanted() if one.cause in surprises.STRONG]
    assert [term(cause).slot for cause in surprises.STRONG] == list(SLOTS)
    assert len(strong) == 14 and len(surprises.wanted()) == 26
    for one in strong:
        ((cause, ((_, value),)),) = one.hidden
        assert term(cause).strength.is_implausible(value), one.name
    with pytest.raises(AssertionError, match="too far"):
        surprises.Surprise("too far", (("gap", (("gap_width", 5e-5),)),), "gap")
    row = {"cause": "adhesion", "in_the_set": True, "flagged": ["adhesion_force"], "true_gain": 60.0}
    rows = [row, row | {"flagged": []}, row | {"true_gain": 49.0}, row | {"cause": "preload", "true_gain": None}]
    assert surprises.summary(rows, 50.0).endswith("in the set and flagged 1 of 2")


def test_causes_are_dealt_the_same_every_time_and_all_occur() -> None:
    sizes = [2] * 20 + [3] * 10
    hands = search_sets.dealt(1, sizes)
    assert hands == search_sets.dealt(1, sizes) != search_sets.dealt(2, sizes)
    assert [len(set(hand)) for hand in hands] == sizes
    assert all(tuple(t.id for t in terms(hand)) == hand for hand in hands)  # in the registry's order
    often = Counter(id for hand in hands for id in hand)
    assert often.keys() == set(search_sets.CATALOGUE)


def test_a_truth_is_drawn_the_same_every_time(known: Experiment) -> None:
    ids = ["amplifier_lag", "reading_gain"]
    first, again, other = (search_sets.drawn_truth(np.random.default_rng(k), ids, known.ids) for k in (1, 1, 2))
    assert first == again != other
    names = Problem(known, known.ids, terms(ids)).names
    assert set(names) == first.values.keys() | first.scatter.keys()


def test_a_data_set_is_kept_to_the_last_digit(known: Experiment, tmp_path: Path) -> None:
    file = tmp_path / "sets.jsonl"
    made = search_sets.DataSet("a", "pairs", ("gap",), "here", known, parameters={"k_c": 0.1}, gain=20.0)
    search_sets.store(made, file)
    search_sets.store(search_sets.DataSet("b", "limits", None, "there", known), file)
    kept = search_sets.stored(file)
    assert list(kept) == ["a", "b"] and kept["b"].truth is None
    assert search_sets.to_line(kept["a"]) == search_sets.to_line(made)
    assert kept["a"].experiment.fingerprint == known.fingerprint


def test_data_sets_of_the_study_are_its_groups() -> None:
    whole = read_experiment(BENCHMARKS.parent / "experiments" / "psa")
    assert search_sets.get("study").experiment.fingerprint == whole.fingerprint
    assert search_sets.get("study-without-5").experiment.ids == (1, 2, 3, 4, 6)


def test_readings_at_a_narrow_resonance_stand_out_together() -> None:
    """Two sweeps meet it with one reading each; heavy tails take both up, and were once called adequate."""
    experiment = search_sets.stored()["narrow_resonance"].experiment
    baseline = fit(Problem(experiment, experiment.ids), (), seed=1, draws=256, most=6)
    (found,) = examine(baseline, (), seed=1, n_simulated=99).coincidences
    places = [(id, experiment.group(id).frequency_hz[k]) for id, k in found.readings]
    assert places == [("sine10V", 2480.0), ("square12V", 2480.0)] and found.log_bias < -0.2


def test_every_stored_data_set_has_a_maker_or_is_a_case() -> None:
    kept, made = search_sets.stored(), search_sets.makers()
    assert {kept[id].group for id in kept.keys() - made.keys()} <= {"cases", "campaign"}
    assert len(search_sets.wanted(["cases"])) == 6
    everything = search_sets.wanted(search_sets.GROUPS)
    assert len(set(everything)) == len(everything) and kept.keys() <= set(everything)
    for data in kept.values():
        assert data.truth is None or tuple(t.id for t in terms(data.truth)) == data.truth


@pytest.mark.parametrize(
    ("changes", "flags"),
    [
        ({}, ()),
        ({"best": best(-500.4)}, ()),
        ({"best": best(-500.6)}, ("worse",)),
        ({"best": best(-490.0), "cpu_s": 15.1}, ("slower",)),
        ({"cpu_s": 30.0, "pace_s": 0.6}, ()),  # on a machine that others share
        ({"truth_found": {"fitted": True, "reported": False}}, ("lost",)),
        ({"fingerprint": "g", "best": best(-900.0)}, ("not comparable",)),
        ({"most": 6, "cpu_s": 100.0}, ("not comparable",)),
    ],
)
def test_a_comparison_flags_what_changed(changes: dict[str, Any], flags: tuple[str, ...]) -> None:
    (row,) = yardstick.compare({"one": record(), "gone": record("gone")}, {"one": record(**changes)})
    assert row.flags == flags
    assert yardstick.is_worse([row]) == bool({"worse", "lost"} & set(flags))


def test_a_truth_that_is_found_now_is_a_gain() -> None:
    missed = record(truth_found={"fitted": False, "reported": False}, missed=12.0)
    rows = yardstick.compare({"one": missed}, {"one": record()})
    assert yardstick.table([]) == "no data set is in both files"
    assert rows[0].flags == ("gained",) and not yardstick.is_worse(rows)
    text = yardstick.table(rows)
    assert "| one | gap | no -> yes | no -> yes | 12.0 -> -1.0 | +0.0 | 10 -> 10 | x 1.00 | gained |" in text
    assert "fitted 0 -> 1, reported 0 -> 1; CPU 10 -> 10 s, cost x 1.00; 0 worse, 0 lost, 1 gained, 0 slower" in text


def test_the_command_fails_where_a_search_became_worse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [str(tmp_path / name) for name in ("old", "new")]
    for file, records in zip(files, ([record(), record("two")], [record(best=best(-501.0))]), strict=True):
        Path(file).write_text("".join(f"{json.dumps(one)}\n" for one in records))
    for order, status in ((files, 1), (files[::-1], 0)):
        monkeypatch.setattr(sys, "argv", ["search.py", "--compare", *order])
        assert yardstick.main() == status
        assert "in one of the files alone: two" in capsys.readouterr().out


def test_ties_are_also_looked_at_with_a_trace_of_one_launch() -> None:
    """That a plan would try; a table marks what it raises above three nats."""
    *swept, trace = ties.conditions(40, 2700.0).groups
    assert not any(g.time_us is not None for g in swept) and [o.name for o in trace.observables] == ["velocity"]
    assert set(trace.frequency_hz) == {2700.0} and set(trace.amplitude_v) == {20.0} and trace.n_points == 64
    found = [
        ties.Refit("preload", "flight_friction", place, ties.names(kinds), seen, nats + (kinds[-1] == ties.TRACED))
        for place, seen, nats in (("study", 50.0, 2.2), ("hard", 50.0, 7.0), ("damped", 1.0, 0.5))
        for kinds in ties.SETS
    ]
    heads, _, row = ties.table(found, 3.0).splitlines()
    assert heads.endswith("| ranges and forces | ranges and a trace |")
    assert row.endswith("| 2.2 / 7.0 / – | **3.2** / 8.0 / – |")


def test_what_is_not_known_is_left_empty() -> None:
    unknown = record(truth=None, truth_found={}, missed=None)
    assert "| one | ? |  |  |  | +0.0 |" in yardstick.table(yardstick.compare({"one": unknown}, {"one": unknown}))


def test_a_run_goes_on_where_it_stopped(known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    searched: list[tuple[str, int, Any]] = []
    interrupted = ["b"]

    def measure(data: Any, seed: int, *, most: int, jobs: int, known: Any, progress: Any) -> dict[str, Any]:
        if data.id in interrupted:
            interrupted.remove(data.id)
            raise KeyboardInterrupt
        searched.append((data.id, most, known))
        own = {"seed": seed, "most": most, "fingerprint": data.experiment.fingerprint}
        return record(data.id, **own, code=yardstick.code())

    monkeypatch.setattr(yardstick, "measure", measure)
    monkeypatch.setattr(
        yardstick, "get", lambda id: search_sets.DataSet(id, "pairs", ("gap",), "", known, most=6 if id == "c" else 4)
    )
    file, said = tmp_path / "out.jsonl", lambda text: None
    with pytest.raises(KeyboardInterrupt):
        yardstick.run(["a", "b", "c"], file, seed=1, say=said)
    assert list(yardstick.read(file)) == ["a"]
    assert yardstick.run(["a", "b", "c"], file, seed=1, say=said) == 0
    assert searched == [("a", 4, None), ("b", 4, None), ("c", 6, None)]
    # One that fails is counted, and the others are searched.
    monkeypatch.setattr(yardstick, "get", lambda id, get=yardstick.get: get(id) if id != "bad" else 1 / 0)
    assert yardstick.run(["bad", "a"], file, seed=1, say=said) == 1
    # What was asked otherwise is searched anew; a plain fit of the truth is taken over where readings are the same.
    truths = copy.deepcopy(yardstick.read(file))
    for id, fingerprint in (("b", known.fingerprint), ("c", "another")):
        truths[id] |= {"fingerprint": fingerprint, "truth_alone": {"log_posterior": 1.0}}
    assert yardstick.run(["a", "b", "c"], file, seed=1, quick=True, truths=truths, say=said) == 0
    assert searched[3:] == [("c", 4, None)]
    yardstick.run(["b"], file, seed=2, truths=truths, say=said)
    assert searched[4:] == [("b", 4, {"log_posterior": 1.0})]


def test_trajectories_are_counted_by_path(known: Experiment) -> None:
    plain, stepped = (Problem(known, known.ids, terms(ids)) for ids in ([], ["hertz_exponent"]))
    draws = [p.prior_transform(np.random.default_rng(1).uniform(size=(3, p.n_dim))) for p in (plain, stepped)]
    before = yardstick.closed_form.separation, yardstick.stepper.separation
    with yardstick.counted() as count:
        plain.predict(draws[0])
        assert count == {"closed form": 3 * plain.observed.size, "stepper": 0}
        stepped.predict(draws[1])
    assert count["stepper"] == 3 * plain.observed.size
    assert (yardstick.closed_form.separation, yardstick.stepper.separation) == before
    plain.predict(draws[0])
    assert count["closed form"] == 3 * plain.observed.size


@pytest.mark.slow
def test_a_small_data_set_is_measured(known: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """With nothing hidden the baseline is the truth: it is fitted, and the plain fit finds the same evidence."""
    monkeypatch.setattr(yardstick, "TERMS", terms(["amplifier_lag", "gap"]))
    data = search_sets.DataSet("known", "cases", (), "", known)
    found = yardstick.measure(data, 1, most=4)
    assert found["best"]["causes"] == [] and found["truth_found"]["rank"] == 1
    assert found["missed"] == pytest.approx(0.0, abs=0.2)
    assert found["best"]["by_the_search"] == pytest.approx(found["best"]["log_posterior"], abs=0.3)
    assert found["cpu_s"] > 0 and found["trajectories"]["closed form"] > 0
    assert yardstick.compare({"known": found}, {"known": found})[0].flags == ()


def test_estimates_are_described_by_number_of_causes(tmp_path: Path) -> None:
    """What a run has written is read again, and counted where it belongs."""
    rows = [
        {"number": k, "causes": ["gap", "preload"][: 1 + k // 4], "short_below": float(k), "second_top_above": 0.2 * k,
         "evidences_differ": -0.1 * k, "short_s": 1.0, "sample_s": 3.0}
        for k in range(8)
    ]  # fmt: skip
    file = tmp_path / "estimates.jsonl"
    assert estimates.read(file) == {}
    file.write_text("".join(json.dumps(row) + "\n" for row in rows), "utf-8")
    head, one, two = estimates.table(list(estimates.read(file).values())).splitlines()
    assert "evidences within 0.3" in head
    assert one.split() == ["1", "4", "1.50", "2.70", "3.00", "25%", "75%", "1.00", "3.00"]
    assert two.split() == ["2", "4", "5.50", "6.70", "7.00", "100%", "0%", "1.00", "3.00"]


@pytest.mark.slow
def test_a_random_model_is_fitted_and_sampled_twice() -> None:
    """Of the same number the same model; the short fit is no better than the sample, which is of the same readings."""
    found = estimates.measure(0, 1, "gap_and_slew")
    assert {*found["part"]} < {*found["causes"]} and len(found["part"]) + 1 == len(found["causes"]) > 2
    assert found["short_top_below"] > -0.1 and abs(found["evidences_differ"]) < 3
    assert found["short_s"] < found["sample_s"]


def test_searches_where_nothing_is_hidden_go_on_where_they_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each size in turn, one table whatever the order; a search that fails is reported and left out."""
    table = null_leads.blank(1, TERMS, null_leads.SearchSettings())
    calls = null_leads.wanted(table, (60, 150), 2)
    assert [n for n, _ in calls] == [60, 150, 60, 150] and len(set(calls)) == 4
    searched: list[tuple[int, int]] = []

    def search(asked: int, seed: int, catalogue: Any, settings: Any) -> Any:
        searched.append((asked, seed))
        return null_leads.NullLead(seed, asked, asked - 2, 5, -2.0) if seed != calls[1][1] else "nothing launches"

    monkeypatch.setattr(null_leads, "search", search)
    file = tmp_path / "leads.json"
    words = ["null_leads.py", "--sizes", "60,150", "--each", "2", "--out", str(file)]
    null_leads.fill(file, table, calls[2:3], TERMS)
    monkeypatch.setattr(sys, "argv", words)
    assert null_leads.main() == 0
    assert searched == [calls[2], calls[0], calls[1], calls[3]]
    leads = null_leads.read_json(file, null_leads.NullLeads).leads
    assert [(one.asked, one.seed) for one in leads] == sorted((calls[0], calls[2], calls[3]))
    said = capsys.readouterr().out
    assert "nothing launches" in said and "about 60 readings, 2 searches: median -2.00 nats" in said
    monkeypatch.setattr(sys, "argv", [*words, "--seed", "2"])
    with pytest.raises(null_leads.InputError, match="another seed"):
        null_leads.main()
    monkeypatch.setattr(sys, "argv", [*words, "--seed", "2", "--anew"])
    assert null_leads.main() == 0 and null_leads.read_json(file, null_leads.NullLeads).seed == 2


COMPARED = pytest.mark.parametrize(
    "names", [(), ("hertz_exponent",), ("slew_limit", "hunt_crossley", "hysteresis"), ("gap",)], ids="+".join
)


@COMPARED
def test_what_psafit_is_compared_with_solves_the_same_problem(names: tuple[str, ...]) -> None:
    """Another solver's speed counts only if it launches the same balls."""
    case = cases.Case(names, n_sets=2, n_sample=4)
    assert case.reference_gap() < 1e-9
    found = np.array([peers.scipy_launch(cases.RIG, one, "LSODA", 1e-8) for one in case.trajectories])
    assert case.peer_errors(found).max() < 1e-4


@COMPARED
def test_so_does_what_is_compiled(names: tuple[str, ...]) -> None:
    pytest.importorskip("numbalsoda", reason="nothing but its speed is compared, and it has to be built")
    case = cases.Case(names, n_sets=2, n_sample=4)
    assert case.peer_errors(peers.Numbalsoda(cases.RIG, case.trajectories)(1e-8)).max() < 1e-4


@pytest.mark.slow
def test_a_version_is_timed_in_a_process_of_its_own() -> None:
    found = against_version.timed(against_version.ROOT)
    assert [*found] == ["sine, baseline", "sine, Hertz", "square, baseline", "square, Hertz"]
    assert all(0 < cost < 1e-2 for cost in found.values())


def test_the_table_of_speeds_says_what_reaches_the_error() -> None:
    curve = np.array([(1e-3, 1e-6), (1e-6, 4e-6), (1e-9, 9e-6)])  # errors, seconds
    found = {"baseline": {"psafit": curve}, "gap + hysteresis": {"psafit": curve, "other": curve[:1]}}
    text = work_precision.table(found)
    assert text.splitlines()[2:] == [
        "| psafit | 4 | 4 |",
        "| other |  |  |",
        "| psafit: launches a second and core | 250,000 | 250,000 |",
    ]
    page = "# Speed\n\n<!-- make bench -->\nold\n<!-- end -->\n\nrest\n"
    once = work_precision.publish(text, page)
    assert text in once and "old" not in once and once.endswith("rest\n") and work_precision.publish(text, once) == once
    with pytest.raises(ValueError, match="no <!-- make bench"):
        work_precision.publish(text, "# Speed\n")


def test_a_green_page_with_values_that_are_off_is_counted() -> None:
    """Pages that predict and say nothing else; those that warn are counted apart."""

    def page(outside: list[str], predicts: str = "yes", caution: str = "") -> dict[str, Any]:
        return {"predicts": predicts, "caution": caution, "outside": outside}

    done = [
        page([]),
        page(["k_c"]),
        page(["k_c", "c_s"]),
        page(["k_c"], "too sure", "its band"),
        page([], "yes", "drift"),
    ]
    said = fit_pages.summary(done)
    assert said[0] == "pages of 5 rigs: 3 green; 1 too sure of what the fit has not seen"
    assert [row.partition(": ")[2].partition(" (")[0] for row in said[1:4]] == ["2 of 5", "1 of 5", "0 of 5"]
    assert said[4] == "not green, and one or more outside: 1 of 2"

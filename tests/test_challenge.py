"""Challenges: what is hidden stays hidden, is what the answer says, and is judged by the book."""

from __future__ import annotations

import hashlib
import json
import math
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from outside import OUTSIDE, parts

from psafit.challenge import hide
from psafit.challenge.answer import EXPERIMENT, Answer, Place, unseal
from psafit.challenge.campaign import LEVELS, PRIOR, Result, Spec, content_hash, load, plan, read_diagnosis, run
from psafit.challenge.hide import Outside, make, simulate_literally
from psafit.challenge.oracle import Oracle, consult, find_rivals
from psafit.challenge.score import SHOWING_NATS, _clustered, located, rate, reported_set, score
from psafit.challenge.strength import find, lost_nats
from psafit.cli import commands
from psafit.diagnose.ladder import SIZE_WEIGHTS, VISIBLE_EVIDENCE
from psafit.errors import InputError
from psafit.experiment import Experiment, read_experiment
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import TERMS, term, terms
from psafit.report.challenge import write_page
from psafit.simulate import Design, simulate
from psafit.simulate.sensitivity import plausible, share_of


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def lagged(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One cause, of 30 nats as the search expects it."""
    folder = tmp_path_factory.mktemp("challenge") / "lagged"
    make(3, folder, design_of=known, terms=["amplifier_lag"], strength=30.0)
    return folder


# --- hiding -----------------------------------------------------------------------------------------


def test_a_seed_gives_the_same_bytes_however_the_work_is_shared(known: Experiment, tmp_path: Path) -> None:
    for name, seed, jobs in (("one", 7, 1), ("again", 7, 2), ("other", 8, 1)):
        make(seed, tmp_path / name, design_of=known, terms=["start_phase"], jobs=jobs)
    assert files(tmp_path / "one") == files(tmp_path / "again")
    assert files(tmp_path / "one")["experiment/group1.csv"] != files(tmp_path / "other")["experiment/group1.csv"]


def test_the_folder_tells_nothing(known: Experiment, lagged: Path, tmp_path: Path) -> None:
    make(123456, tmp_path, design_of=known, kind="nothing")
    plain, hidden = files(tmp_path / "experiment"), files(lagged / "experiment")
    assert plain.keys() == hidden.keys() == {"experiment.toml", "group1.csv", "group2.csv", "group3.csv"}
    assert plain["experiment.toml"] == hidden["experiment.toml"]
    for text in plain.values():
        assert b"123456" not in text
    for text in hidden.values():
        assert not any(t.id.encode() in text for t in TERMS)
    for g in read_experiment(lagged / "experiment").groups:
        assert np.array_equal(g.launch_range_um, np.round(g.launch_range_um, 2))


def test_data_come_from_the_literal_reference(known: Experiment, lagged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No fast path is called where nothing but the literal reference can know the ranges, and both agree."""
    answer = unseal(lagged)[1]
    lag = term("amplifier_lag")
    names = ["k_c", "c_s", "c_c", "amplifier_lag_tau"]
    design = Design.of(known.constants, known.groups)
    fast = simulate(design, [answer.parameters[n] for n in names], [lag]).launch_range[0] * 1e6
    assert answer.true_um == pytest.approx(fast, rel=1e-8)
    with monkeypatch.context() as patch:
        patch.setattr("psafit.simulate.batch.closed_form.separation", None)
        patch.setattr("psafit.simulate.batch.stepper.separation", None)
        again = simulate_literally(design, answer.parameters, [lag], known.ids, points=np.array([0, 40]))
    assert again.tolist() == [answer.true_um[0], answer.true_um[40]]


def test_sessions_keep_what_they_have_for_themselves(known: Experiment) -> None:
    gain = term("reading_gain")
    values = {"k_c": 4e5, "c_s": 9e3, "c_c": 60.0, "reading_gain_spread": math.log(2)}
    values |= {"reading_gain_z_1": 0.0, "reading_gain_z_2": 1.0, "reading_gain_z_3": -1.0}
    design = Design.of(known.constants, known.groups)
    points = np.array([5, 35, 60])
    without = simulate_literally(design, values, [], known.ids, points=points)
    with_it = simulate_literally(design, values, [gain], known.ids, points=points)
    assert with_it == pytest.approx(without * [1.0, 2.0, 0.5])


def test_readings_scatter_as_the_answer_says(lagged: Path) -> None:
    experiment, answer = unseal(lagged)
    read = np.concatenate([g.launch_range_um for g in experiment.groups])
    true = np.array(answer.true_um)
    relative, absolute = answer.scatter["sigma_rel"], answer.scatter["sigma_abs"]
    assert relative is not None and absolute is not None and answer.scatter["nu"] is None
    assert 0.01 < relative < 0.2 and 0.005 < absolute < 0.5
    z = (read - true) / np.hypot(relative * true, absolute)
    # Five standard errors of mean and variance.
    assert abs(z.mean()) < 5 / math.sqrt(z.size) and abs(z.var() - 1) < 5 * math.sqrt(2 / z.size)


def test_most_readings_of_a_truth_launch(known: Experiment, lagged: Path, tmp_path: Path) -> None:
    made = [make(s, tmp_path / str(s), design_of=known, kind="nothing").answer for s in range(6)]
    for answer in (unseal(lagged)[1], *made):
        assert np.mean(np.array(answer.true_um) > 1.0) >= 0.5


def test_a_weak_truth_that_hardly_launches_is_tried_once(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The strongest of those tried gives way to the next."""
    nats = iter(range(99, 0, -1))

    def weak(*drawn: Any) -> hide._Truth:
        gain = float(next(nats))
        values = {"k_c": gain, "c_s": 9e3, "c_c": 60.0, "swing_drag_coefficient": 1e-3}
        return hide._Truth(values, {"swing_drag": gain}, {"swing_drag": 0.9}, reached=False)

    def ranges(design: Design, parameters: dict[str, float], *rest: Any, jobs: int) -> Any:
        return np.full(design.n_points, 0.0 if parameters["k_c"] == 99.0 else 10.0)

    monkeypatch.setattr(hide, "_draw", weak)
    monkeypatch.setattr(hide, "simulate_literally", ranges)
    answer = make(1, tmp_path / "a", design_of=known, terms=["swing_drag"], strength=500.0).answer
    assert (answer.expected_nats, answer.redraws) == ({"swing_drag": 98.0}, hide._PATIENCE)


def test_a_drawn_design_is_one_of_similar_size(tmp_path: Path) -> None:
    blank = hide._drawn_design(np.random.default_rng(1))
    other = hide._drawn_design(np.random.default_rng(2))
    for e in (blank, other):
        assert 4 <= len(e.groups) <= 7 and 180 <= sum(g.n_points for g in e.groups) <= 350
    assert blank.fingerprint != other.fingerprint


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"kind": "three"}, "no kind"),
        ({"kind": "two", "terms": ["gap"]}, "does not fit"),
        ({"kind": "outside"}, "no outside effect"),
        ({"terms": ["gap"], "outside": OUTSIDE[0]}, "choose one"),
        ({"terms": ["gap", "preload", "adhesion"]}, "at most two"),
        ({"terms": ["gape"]}, "no cause"),
        ({"strength": -1.0}, "nats"),
    ],
)
def test_a_request_that_contradicts_itself_is_refused(
    known: Experiment, tmp_path: Path, options: dict[str, Any], what: str
) -> None:
    with pytest.raises(InputError, match=what):
        make(1, tmp_path / "x", design_of=known, **options)
    assert not (tmp_path / "x").exists()


# --- the seal ---------------------------------------------------------------------------------------


def test_the_answer_is_committed_to_before_the_data(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    write = hide.write_experiment

    def spy(experiment: Experiment, folder: Path) -> None:
        seen.append((tmp_path / "commitment.txt").read_text())
        write(experiment, folder)

    monkeypatch.setattr(hide, "write_experiment", spy)
    made = make(5, tmp_path, design_of=known, kind="nothing")
    digest = hashlib.sha256((tmp_path / "answer.json").read_bytes()).hexdigest()
    assert seen == [f"{digest}  answer.json\n"] and made.commitment == digest
    assert unseal(tmp_path)[1] == made.answer
    with pytest.raises(InputError, match="there already"):
        make(5, tmp_path, design_of=known, kind="nothing")


@pytest.mark.parametrize("victim", ["answer.json", "commitment.txt", "experiment/group2.csv"])
def test_tampering_is_refused(known: Experiment, tmp_path: Path, victim: str) -> None:
    make(5, tmp_path, design_of=known, kind="nothing")
    file = tmp_path / victim
    text = file.read_text()
    changed = {
        "answer.json": text.replace('"kind": "nothing"', '"kind": "one"'),
        "commitment.txt": "0" * 64 + "  answer.json\n",
        "experiment/group2.csv": re.sub(r",(\d+\.\d+)\n", r",9\1\n", text, count=1),
    }[victim]
    assert changed != text
    file.write_text(changed)
    with pytest.raises(InputError, match=r"committed|other data"):
        unseal(tmp_path)


@pytest.mark.parametrize("victim", ["answer.json", "commitment.txt"])
def test_a_seal_that_is_not_there_is_told(known: Experiment, tmp_path: Path, victim: str) -> None:
    make(5, tmp_path, design_of=known, kind="nothing")
    (tmp_path / victim).unlink()
    with pytest.raises(InputError, match="is missing"):
        unseal(tmp_path)
    (tmp_path / victim).mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        unseal(tmp_path)


def test_a_drive_that_launches_nothing_is_told(known: Experiment, tmp_path: Path) -> None:
    still = tuple(replace(g, amplitude_v=np.full(g.n_points, 1e-6)) for g in known.groups)
    with pytest.raises(InputError, match="nothing launches at these conditions"):
        make(5, tmp_path / "x", design_of=replace(known, groups=still), kind="nothing")
    assert not (tmp_path / "x").exists()


def test_the_least_weak_of_few_truths_will_do(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Where most rigs launch nothing, and none shows a cause as strongly as was asked."""
    drawn = hide._draw
    calls: list[None] = []

    def rarely(*words: Any) -> Any:
        calls.append(None)
        truth = drawn(*words) if len(calls) == 2 else None
        return truth and replace(truth, reached=False)

    monkeypatch.setattr(hide, "_draw", rarely)
    made = make(5, tmp_path, design_of=known, terms=["gap"], strength=20.0)
    assert made.answer.terms == ["gap"] and not made.answer.reached and len(calls) == hide._MOST_REDRAWS


@pytest.mark.parametrize(
    ("forge", "what"),
    [
        (lambda a: a["parameters"].pop("k_c"), "does not say k_c"),
        (lambda a: a["scatter"].pop("nu"), "does not say nu"),
        (lambda a: a["true_um"].pop(), "not one true range for every reading"),
        (lambda a: a["terms"].append("no such cause"), "no such cause"),
        (lambda a: a["parameters"].update(k_c=-1e7), "has k_c = -1e[+]07, outside the bounds"),
        (lambda a: a["scatter"].update(sigma_abs=float("nan")), "has sigma_abs = nan, outside the bounds"),
    ],
)
def test_a_forged_answer_with_its_own_hash_is_refused(known: Experiment, tmp_path: Path, forge: Any, what: str) -> None:
    make(5, tmp_path, design_of=known, kind="nothing")
    file = tmp_path / "answer.json"
    content = json.loads(file.read_text())
    forge(content)
    file.write_text(json.dumps(content))
    (tmp_path / "commitment.txt").write_text(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  answer.json\n")
    with pytest.raises(InputError, match=what):
        unseal(tmp_path)


# --- strength and oracle ----------------------------------------------------------------------------


def test_an_even_misfit_costs_what_the_wider_scatter_costs() -> None:
    """Residuals of size 1 all over double the variance: n/2 ln 2."""
    n = 4000
    assert lost_nats(np.where(np.arange(n) % 2, 1.0, -1.0)) == pytest.approx(0.5 * n * math.log(2), rel=0.05)
    assert lost_nats(np.zeros(n)) == 0.0


def test_few_wild_readings_cost_little() -> None:
    """Heavy tails swallow them: far less than the same sum of squares spread evenly."""
    even, wild = np.full(400, 1.0), np.zeros(400)
    wild[:4] = 10.0
    assert lost_nats(wild) < 0.5 * lost_nats(even)


def test_strength_is_what_was_asked_for_or_says_that_it_is_not(known: Experiment) -> None:
    theta = np.array([4e5, 9e3, 60.0])
    design = Design.of(known.constants, known.groups)
    scatter = {"sigma_rel": 0.05, "sigma_abs": 0.05, "nu": None}
    lag = term("amplifier_lag")
    none = np.empty(0)
    weak, strong = (find(lag, 1, none, theta, design, scatter, nats) for nats in (10.0, 60.0))
    assert weak.reached and strong.reached and weak.value < strong.value
    assert weak.nats == pytest.approx(10.0, rel=0.25) and strong.nats == pytest.approx(60.0, rel=0.25)
    # Linear swings do not feel gravity's small part of it: no plausible drag is seen.
    drag = find(term("swing_drag"), 1, none, theta, design, scatter, 500.0)
    assert not drag.reached and drag.nats < 250.0


def test_share_is_the_prior_closer_to_neutral() -> None:
    for t in TERMS:
        assert share_of(t, float(plausible(t, 0.5)[0])) == pytest.approx(0.5, abs=0.01)


def test_an_oracle_sees_what_was_hidden(lagged: Path) -> None:
    experiment, answer = unseal(lagged)
    seen = consult(experiment, answer, seed=1)
    # The logarithm of the likelihood ratio scatters by about sqrt(2 x 30) about what is expected.
    assert abs(seen.gain - answer.expected_nats["amplifier_lag"]) < 5 * math.sqrt(60)
    # It is that of fits by another way.
    plain = fit(Problem(experiment, experiment.ids), (), seed=1, draws=512, most=8)
    right = fit(replace(plain.problem, terms=terms(["amplifier_lag"])), [plain], seed=1)
    assert seen.gain == pytest.approx(right.log_likelihood - plain.log_likelihood, abs=0.5)
    assert seen.gain > 0 and "amplifier_lag_tau" in seen.fitted and seen.without == {}


def test_an_oracle_sees_nothing_where_nothing_is(known: Experiment, tmp_path: Path) -> None:
    made = make(5, tmp_path, design_of=known, kind="nothing")
    assert consult(made.experiment, made.answer, seed=1).gain == 0.0


def test_a_rival_that_does_the_same_is_found(lagged: Path) -> None:
    """A copy of the cause by another name imitates it; a reading's offset does not imitate a lag of 30 nats."""
    experiment, answer = unseal(lagged)
    copy = replace(term("amplifier_lag"), id="lag_by_another_name")
    assert find_rivals(experiment, answer, [copy, term("reading_offset")]) == ["lag_by_another_name"]


@pytest.mark.slow
def test_what_a_cause_adds_is_seen_from_everywhere(tmp_path: Path) -> None:
    """A slew limit alone does as well with another contact: nobody can ask for the stiffness beside it."""
    made = make(2941797860, tmp_path, kind="two", terms=["slew_limit", "stack_stiffness"], strength=60.0)
    found = consult(read_experiment(tmp_path / EXPERIMENT), made.answer, seed=1)
    assert found.gain > 50 and found.without["slew_limit"] > 50
    assert found.without["stack_stiffness"] < 5  # one climb from the truth leaves 36


# --- outside ----------------------------------------------------------------------------------------


def test_there_are_enough_outside_effects() -> None:
    assert len({o.name for o in OUTSIDE}) >= 6 and not {o.name for o in OUTSIDE} & {t.id for t in TERMS}


@pytest.mark.parametrize("effect", OUTSIDE, ids=lambda o: o.name)
def test_outside_effects_act_where_they_say(known: Experiment, tmp_path: Path, effect: Outside) -> None:
    plain = make(11, tmp_path / "plain", design_of=known, kind="nothing").answer
    made = make(11, tmp_path / "hidden", design_of=known, outside=effect)
    assert made.answer.parameters == plain.parameters  # the same rig, and one thing more
    assert made.answer.outside == effect.name and made.answer.terms == []
    changed = np.array(made.answer.true_um) != np.array(plain.true_um)
    assert changed.any()
    for g, s in zip(known.groups, parts(known), strict=True):
        inside = np.zeros(g.n_points, bool)
        for place in made.answer.places:
            if place.group == g.id:
                x = {"frequency": g.frequency_hz, "amplitude": g.amplitude_v, None: np.zeros(g.n_points)}[
                    place.variable
                ]
                low = -math.inf if place.lower is None else place.lower
                inside |= (x >= low) & (x <= (math.inf if place.upper is None else place.upper))
        # What acts everywhere names no place.
        assert not changed[s][~inside].any() or not made.answer.places
    assert effect.name.encode() not in b"".join(files(tmp_path / "hidden" / "experiment").values())
    assert consult(made.experiment, made.answer, seed=1).gain > 10.0


# --- campaign ---------------------------------------------------------------------------------------

SMALL = {"terms": ["amplifier_lag"], "each": 0, "nothing": 3, "pairs": 0, "drawn": 0}


def says(folder: Path, **content: Any) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    told = {"schema": 1, "verdict": "adequate", "named": [], "alternatives": [], "causes": [], "misfit": {}} | content
    (folder / "diagnosis.json").write_text(json.dumps(told))


def deaf(experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
    """A stand-in that finds every simulation adequate."""
    assert quick and tuple(group_ids) == experiment.ids
    assert experiment.title == "Challenge"
    says(folder, misfit={"p_value": float(experiment.groups[0].launch_range_um[0])})


def test_believed_truths_have_the_scatter_that_a_diagnosis_believes_in(known: Experiment, tmp_path: Path) -> None:
    drawn = [make(k, tmp_path / f"b{k}", design_of=known, terms=[], believed=True).answer.scatter for k in range(6)]
    usual = make(1, tmp_path / "u", design_of=known, terms=[]).answer.scatter
    assert usual["nu"] is None and all(2.0 <= (s["nu"] or 0.0) <= 100.0 for s in drawn)
    assert np.std(np.log([s["sigma_rel"] or 0.0 for s in drawn])) > 0.4  # a factor of 2.5 for one standard deviation


class Counting:
    """A stand-in that notes its calls, and gives up when told to."""

    def __init__(self, stop_at: int = -1, error: type[BaseException] = KeyboardInterrupt) -> None:
        self.seeds: list[int] = []
        self.stop_at = stop_at
        self.error = error

    def __call__(self, experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
        self.seeds.append(seed)
        if len(self.seeds) == self.stop_at:
            raise self.error("stop", "go on") if self.error is InputError else self.error
        deaf(experiment, group_ids, folder, quick=quick, seed=seed)


def test_the_full_plan_has_all_that_the_targets_ask_for() -> None:
    specs = plan(1, outside=[o.name for o in OUTSIDE])
    assert len(specs) >= 200 and len({s.id for s in specs}) == len({s.seed for s in specs}) == len(specs)
    for t in TERMS:
        for level, nats in LEVELS.items():
            assert any(s.terms == [t.id] and s.level == level and s.nats == nats for s in specs)
    assert sum(s.kind == "nothing" for s in specs) >= 60
    assert {s.outside for s in specs if s.kind == "outside"} == {o.name for o in OUTSIDE}
    assert sum(s.kind == "two" for s in specs) >= 10 and {s.design for s in specs} == {"given", "drawn"}
    drawn = [s for s in specs if s.level == PRIOR]
    sizes = np.bincount([len(s.terms) for s in drawn], minlength=3) / len(drawn)
    assert sizes == pytest.approx(np.array(SIZE_WEIGHTS[:3]) / sum(SIZE_WEIGHTS[:3]), abs=0.02)
    assert all(s.nats is None and s.outside is None for s in drawn)
    assert not {s.seed for s in specs} & {s.seed for s in plan(2)}
    assert plan(1) == plan(1)


def given(specs: list[Spec]) -> list[Spec]:
    """The same on the small design."""
    return [replace(s, design="given") for s in specs]


def test_an_interrupted_campaign_goes_on_and_runs_nothing_twice(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    whole = run(specs, tmp_path / "whole", design_of=known, diagnose=deaf, jobs=1)
    first = Counting(stop_at=3)
    with pytest.raises(KeyboardInterrupt):
        run(specs, tmp_path / "cut", design_of=known, diagnose=first, jobs=1)
    assert len(list((tmp_path / "cut" / "results").iterdir())) == 2
    rest, told = Counting(), []
    resumed = run(
        specs, tmp_path / "cut", design_of=known, diagnose=rest, jobs=1, progress=lambda *x: told.append(x[:2])
    )
    assert len(rest.seeds) == 1 and rest.seeds[0] == first.seeds[2] and told == [(2, 3), (3, 3)]
    assert [content_hash(r) for r in resumed] == [content_hash(r) for r in whole]
    last = Counting()
    run(specs, tmp_path / "cut", design_of=known, diagnose=last, jobs=1)
    assert last.seeds == []


def test_a_failed_diagnosis_counts_and_is_tried_again(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    results = run(specs, tmp_path, design_of=known, diagnose=Counting(stop_at=2, error=InputError), jobs=1)
    assert [r.status for r in results] == ["done", "failed", "done"]
    found = score(results)
    assert found.n_failed == 1 and found.false_alarms.k == 1
    again = Counting()
    assert [r.status for r in run(specs, tmp_path, design_of=known, diagnose=again, jobs=1)] == ["done"] * 3
    assert len(again.seeds) == 1


def test_a_bug_in_the_diagnosis_is_not_swallowed(known: Experiment, tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        run(
            given(plan(4, **SMALL)),
            tmp_path,
            design_of=known,
            diagnose=Counting(stop_at=1, error=ZeroDivisionError),
            jobs=1,
        )


@pytest.mark.slow
def test_two_workers_give_what_one_gives(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, terms=["gap"], each=0, nothing=2, pairs=0, drawn=0, outside=["unit_error"], outside_each=1))
    one, two = (run(specs, tmp_path / str(n), design_of=known, diagnose=deaf, outside=OUTSIDE, jobs=n) for n in (1, 2))
    assert [content_hash(r) for r in one] == [content_hash(r) for r in two]
    assert {content_hash(r) for r in one} != {content_hash(one[0])}


def test_a_short_campaign_is_part_of_the_whole(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    first, rest = Counting(), Counting()
    assert len(run(specs, tmp_path, design_of=known, diagnose=first, jobs=1, limit=1)) == 1
    assert len(run(specs, tmp_path, design_of=known, diagnose=rest, jobs=1)) == 3
    assert (len(first.seeds), len(rest.seeds)) == (1, 2)


def test_a_cluster_without_dask_is_refused_before_anything_is_written(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"psafit\[cluster\]"):
        run(plan(4, **SMALL), tmp_path / "x", design_of=known, diagnose=deaf, scheduler="tcp://localhost:1")
    assert not (tmp_path / "x").exists()


def test_another_campaign_or_a_damaged_result_is_refused(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    specs = given(plan(4, **{**SMALL, "nothing": 1}))
    run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)
    with pytest.raises(InputError, match="another campaign"):
        run(given(plan(5, **{**SMALL, "nothing": 1})), tmp_path, design_of=known, diagnose=deaf, jobs=1)
    with monkeypatch.context() as m:
        m.setattr("psafit.challenge.campaign.plugin_versions", lambda: {"plugin mine": "another file"})
        with pytest.raises(InputError, match="its plugins differ"):
            run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)
    (file,) = (tmp_path / "results").iterdir()
    file.write_text(file.read_text()[:-20])
    with pytest.raises(InputError, match="damaged"):
        run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)


def test_a_diagnosis_that_breaks_its_contract_is_a_failure(known: Experiment, tmp_path: Path) -> None:
    def broken(experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
        says(folder, verdict="perhaps")

    (result,) = run(given(plan(4, **{**SMALL, "nothing": 1})), tmp_path, design_of=known, diagnose=broken, jobs=1)
    assert result.status == "failed" and "no diagnosis" in result.message


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_what_one_process_gives(known: Experiment, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    specs = given(plan(4, terms=["gap"], each=0, nothing=8, pairs=0, drawn=0))
    serial = run(specs, tmp_path / "serial", design_of=known, diagnose=deaf, jobs=1)
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        killed: list[int] = []

        def kill(done: int, total: int, note: str) -> None:
            if done == 2 and not killed:
                victim = next(iter(cluster.workers.values()))
                killed.append(victim.pid)
                victim.process.process._process.kill()

        found = run(
            specs,
            tmp_path / "cluster",
            design_of=known,
            diagnose=deaf,
            scheduler=cluster.scheduler_address,
            progress=kill,
        )
    assert killed
    assert [content_hash(r) for r in found] == [content_hash(r) for r in serial]


@pytest.mark.slow
def test_workers_leave_with_a_campaign_that_is_killed(known_folder: Path, tmp_path: Path) -> None:
    program = f"""
import os, pathlib, time
from psafit.challenge.campaign import plan, run
from psafit.experiment import read_experiment

def sleep(*args, **options):
    pathlib.Path({str(tmp_path)!r}, f"{{os.getpid()}}.pid").touch()
    time.sleep(600)

if __name__ == "__main__":
    specs = plan(4, terms=["gap"], each=0, nothing=4, pairs=0, drawn=0)
    known = read_experiment({str(known_folder)!r})
    run(specs, pathlib.Path({str(tmp_path / "out")!r}), design_of=known, diagnose=sleep)
"""
    (tmp_path / "campaign.py").write_text(program)

    def until(done: Callable[[], bool], seconds: float) -> bool:
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            time.sleep(0.2)
        return done()

    def works(pid: str) -> bool:
        """Whether a process is there, and not dead and merely not yet buried."""
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        except FileNotFoundError:
            return False

    def alive() -> list[str]:
        return [p.stem for p in tmp_path.glob("*.pid") if works(p.stem)]

    campaign = subprocess.Popen([sys.executable, tmp_path / "campaign.py"], cwd=Path(__file__).parents[1])
    try:
        assert until(lambda: len(alive()) == 2, 120)
    finally:
        campaign.kill()
        campaign.wait()
    assert until(lambda: not alive(), 60)


# --- score ------------------------------------------------------------------------------------------


def result(
    truth: list[str],
    *,
    verdict: str = "explained",
    named: list[str] | None = None,
    alternatives: list[list[str]] | None = None,
    causes: list[dict[str, Any]] | None = None,
    where: list[dict[str, Any]] | None = None,
    gain: float = 40.0,
    outside: str | None = None,
    places: list[Place] | None = None,
    confusable: list[str] | None = None,
    without: dict[str, float] | None = None,
    seconds: float = 1.0,
) -> Result:
    kind = "outside" if outside else ("nothing", "one", "two")[len(truth)]
    spec = Spec("0", 1, kind, truth, outside, "", None, "given")  # type: ignore[arg-type]
    answer = Answer(
        "0", 1, kind, truth, {"tau": 2.0, "k_c": 10.0}, {}, None, {}, True, {}, outside, "", places or [], "given", 0,
        [], "",
    )  # type: ignore[arg-type]  # fmt: skip
    told = {
        "verdict": verdict,
        "named": named or [],
        "alternatives": alternatives or [],
        "causes": causes or [],
        "misfit": {"where": where or []},
    }
    oracle = Oracle(gain, without or {}, {}, confusable, 0.0)
    return Result(spec, "0", "done", "", answer, oracle, told, {"diagnose": seconds})


def test_binomial_intervals_are_exact() -> None:
    """Clopper and Pearson: none of ten is below 1 - (0.025)^(1/10); symmetric in hits and misses."""
    none, all_of_them = rate([False] * 10), rate([True] * 10)
    assert none.lower == 0.0 and none.upper == pytest.approx(1 - 0.025**0.1)
    assert all_of_them.upper == 1.0 and all_of_them.lower == pytest.approx(0.025**0.1)
    assert rate([]).share is None


def test_the_reported_set_is_named_and_alternatives() -> None:
    assert reported_set(result([], verdict="adequate").diagnosis) == {frozenset()}
    told = result(["a"], verdict="ambiguous", named=["a"], alternatives=[["b"], ["b", "c"]]).diagnosis
    assert reported_set(told) == {frozenset("a"), frozenset("b"), frozenset("bc")}
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
    assert found.targets[0].text.startswith("misses      80 %  (at least 95 %, 4 of 5)  single cause")


def test_false_alarms_are_counted() -> None:
    quiet, alarm = result([], verdict="adequate"), result([], verdict="unexplained")
    assert score([quiet] * 19 + [alarm]).targets[2].holds is True
    found = score([quiet] * 18 + [alarm] * 2)
    assert found.targets[2].holds is False and (found.false_alarms.k, found.false_alarms.n) == (2, 20)


def test_pairs_need_both() -> None:
    seen = {"a": 20.0, "b": 20.0}
    results = [
        result(["a", "b"], named=["b", "a"], without=seen),
        result(["a", "b"], named=["a"], alternatives=[["a", "b", "c"]], without=seen),
        result(["a", "b"], named=["a"], without=seen),
        result(["a", "b"], named=["a"], without={"a": 50.0, "b": 1.0}),  # nobody can see b beside a
    ]
    target = score(results).targets[6]
    assert (target.rate.k, target.rate.n, target.holds) == (2, 3, False)


def test_outside_effects_are_unexplained_or_located() -> None:
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
    assert (found.targets[3].rate.k, found.targets[3].rate.n) == (2, 4)
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

    assert most(3.8) == pytest.approx(VISIBLE_EVIDENCE, abs=0.05)
    assert most(SHOWING_NATS) < VISIBLE_EVIDENCE


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


def test_recovery_looks_at_what_was_named_right() -> None:
    def told(truth: str, lower: float, upper: float) -> Result:
        parameters = {"tau": {"median": 0.5 * (lower + upper), "lower": lower, "upper": upper}, "other": 3}
        return result([truth], named=["a"], causes=[{"terms": ["a"], "probability": 1.0, "parameters": parameters}])

    found = score([told("a", 1.0, 2.5), told("a", 2.5, 3.5), told("b", 1.0, 2.5)])
    (tau,) = found.recovery
    assert tau.name == "tau" and (tau.covered.k, tau.covered.n) == (1, 2) and found.coverage.n == 2
    assert tau.error == pytest.approx(np.median([-0.25 / 0.75, 1.0 / 0.5]))


def test_intervals_of_one_posterior_count_as_what_they_tell() -> None:
    """Nine of ten hits, one by one or five at a time that hit or miss together; and all of them."""
    alone = _clustered([[k % 10 > 0] for k in range(100)])
    exact = rate(k % 10 > 0 for k in range(100))
    assert (alone.k, alone.n) == (exact.k, exact.n)
    assert [alone.lower, alone.upper] == pytest.approx([exact.lower, exact.upper], abs=0.01)
    fives = _clustered([[k % 10 > 0] * 5 for k in range(100)])
    assert (fives.k, fives.n) == (450, 500)
    assert [fives.lower, fives.upper] == pytest.approx([exact.lower, exact.upper], abs=0.01)
    assert _clustered([[True] * 5] * 20).lower == rate([True] * 20).lower
    assert _clustered([[]]) == rate([])


def test_time_is_told() -> None:
    found = score([result([], verdict="adequate", seconds=s) for s in (1.0, 2.0, 9.0)])
    assert found.seconds["median"] == 2.0 and found.seconds["p90"] == pytest.approx(7.6)


def test_the_page_holds_the_verdict(tmp_path: Path) -> None:
    results = [
        result(["a"], named=["a"], causes=[{"terms": ["a"], "probability": 0.9, "parameters": {}}]),
        result(["a"], named=["<b>"]),
        result(["a"], named=["$\\bad$"]),
        result([], verdict="adequate"),
        result([], outside="x", verdict="unexplained"),
    ]
    page = write_page(score(results), tmp_path / "score.html", {"Version": "0"}).read_text()
    assert "95 % interval" in page and "misses" in page and "&lt;b&gt;" in page and "<b>" not in page
    assert page.count("<img") == 3
    assert "://" not in re.sub(r'src="data:[^"]*"', "", page)
    empty = write_page(score([result([], verdict="adequate")]), tmp_path / "empty.html").read_text()
    assert "holds where asked" in empty and "1 of 7 targets could be asked, and held" in empty


@pytest.mark.parametrize(
    "change",
    [
        {"named": [["a"]]},
        {"alternatives": [[{"a": 1}]]},
        {"causes": [{"terms": [1], "probability": 1.0}]},
        {
            "causes": [
                {"terms": ["a"], "probability": 1.0, "parameters": {"x": {"median": "1", "lower": 0, "upper": 2}}}
            ]
        },
        {"causes": [{"terms": ["a"], "probability": 1.0, "parameters": ["x"]}]},
        {"causes": [{"terms": ["a"], "probability": 10**400}]},
        {"named": ["\x1b[31mred"]},
        {"misfit": {"where": ["x"]}},
        {"misfit": {"where": 5}},
        {"misfit": {"where": [{"group": 1, "variable": "frequency", "from": "a", "to": 2.0}]}},
    ],
)
def test_a_foreign_diagnosis_must_keep_the_contract(change: dict[str, Any], tmp_path: Path) -> None:
    content = {"verdict": "explained", "named": ["a"], "alternatives": [], "causes": [], "misfit": {}}
    (tmp_path / "d.json").write_text(json.dumps(content))
    assert read_diagnosis(tmp_path / "d.json")["named"] == ["a"]
    (tmp_path / "d.json").write_text(json.dumps(content | change))
    with pytest.raises(InputError, match="is no diagnosis of schema 1"):
        read_diagnosis(tmp_path / "d.json")


@pytest.mark.parametrize(
    "edit",
    [
        lambda r: r["diagnosis"].update(named=5),
        lambda r: r["diagnosis"].update(verdict="explained"),
        lambda r: r["oracle"].update(gain=1e3),
        lambda r: r.update(seconds={}),
    ],
)
def test_an_edited_result_is_one_line(
    known: Experiment, tmp_path: Path, edit: Callable[[dict[str, Any]], None]
) -> None:
    specs = plan(1, **SMALL | {"nothing": 1})
    run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)
    file = tmp_path / "results" / f"{specs[0].id}.json"
    content = json.loads(file.read_text())
    edit(content)
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match="was changed") as told:
        load(tmp_path)
    assert told.value.file == file


# --- commands ---------------------------------------------------------------------------------------


def call(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(commands, ["challenge", *(str(w) for w in words)], standalone_mode=False)
    if done.exception:
        raise done.exception
    return done.return_value, done.output


@pytest.mark.slow
def test_make_and_score_from_the_command_line(known_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "c"
    told = tmp_path / "made.json"
    words = ["--seed", 3, "--out", out, "--experiment", known_folder, "--terms", "amplifier_lag", "--strength", 30]
    code, text = call("make", *words, "--jobs", 1, "--json", told)
    assert code == 0 and "amplifier_lag" not in text + told.read_text()
    assert json.loads(told.read_text())["commitment"] == (out / "commitment.txt").read_text().split()[0]
    says(tmp_path, verdict="explained", named=["amplifier_lag"], fingerprint="another")
    with pytest.raises(InputError, match="of other readings"):
        call("score", out, "--diagnosis", tmp_path / "diagnosis.json")
    says(tmp_path, verdict="explained", named=["amplifier_lag"])
    code, text = call("score", out, "--diagnosis", tmp_path / "diagnosis.json", "--json", tmp_path / "score.json")
    assert code == 0 and "truth in the reported set" in text
    assert json.loads((tmp_path / "score.json").read_text())["rows"][0]["exact"] is True


def test_a_campaign_is_scored_from_its_folder(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, terms=["gap"], each=0, nothing=1, pairs=0, drawn=0, outside=["unit_error"], outside_each=1))
    run(specs, tmp_path, design_of=known, diagnose=deaf, outside=OUTSIDE, jobs=1)
    assert len(load(tmp_path)[1]) == 2
    code, text = call("score", tmp_path)
    assert code == 1 and "misses" in text  # a deaf diagnosis misses the wrong unit
    content = json.loads((tmp_path / "score.json").read_text())
    assert content["n"] == 2 and content["false_alarms"]["k"] == 0 and (tmp_path / "score.html").exists()


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("score {tmp}/none", "campaign.json"),
        ("make --seed 1 --out {tmp}/x --experiment {tmp}/none", "no such experiment"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --terms a,", "not a list"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --drawn-design", "both given"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --kind nothing --strength 30", "of no cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --terms gape", "no cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --terms gap --pairs 3", "pair of one cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --jobs 3 --scheduler tcp://127.0.0.1:1", "both given"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --each 0 --nothing 0 --pairs 0 --drawn 0", "empty"),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path: Path, known_folder: Path, words: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        call(*(w.format(tmp=tmp_path, known=known_folder) for w in words.split()))
    assert "\n" not in str(caught.value) and not (tmp_path / "x" / "experiment").exists()

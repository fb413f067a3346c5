"""What is hidden stays hidden, and is what the answer says."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from outside import OUTSIDE, parts
from rigs import measure

from psafit.challenge import hide
from psafit.challenge.answer import Answer, by_reading, standardised, unseal
from psafit.challenge.conditions import ConditionSettings, drawn
from psafit.challenge.hide import HideSettings, Outside, make, simulate_literally
from psafit.challenge.oracle import consult
from psafit.drives import Drive, Table
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, Occasions, read_experiment, write_experiment
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, OF_LAUNCHES, TIP_DISPLACEMENT, VELOCITY
from psafit.physics import TERMS, term, terms
from psafit.simulate import Design, readings, simulate

# Of the effects outside the catalogue.
FAST = ("unit_error",)


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.slow
def test_a_seed_gives_the_same_bytes_however_the_work_is_shared(known: Experiment, tmp_path: Path) -> None:
    for name, seed, jobs in (("one", 7, 1), ("again", 7, 2), ("other", 8, 1)):
        make(seed, tmp_path / name, design_of=known, terms=["start_phase"], jobs=jobs)
    assert files(tmp_path / "one") == files(tmp_path / "again")
    assert files(tmp_path / "one")["experiment/group1.csv"] != files(tmp_path / "other")["experiment/group1.csv"]
    for name, jobs in (("trace", 1), ("traces", 2)):
        make(5, tmp_path / name, design_of=followed(), terms=["soft_layer"], jobs=jobs)
    assert files(tmp_path / "trace") == files(tmp_path / "traces")


def test_the_folder_reveals_nothing(known: Experiment, lagged: Path, tmp_path: Path) -> None:
    make(123456, tmp_path, design_of=known, kind="nothing")
    plain, hidden = files(tmp_path / "experiment"), files(lagged / "experiment")
    assert plain.keys() == hidden.keys() == {"experiment.toml", "group1.csv", "group2.csv", "group3.csv"}
    assert plain["experiment.toml"] == hidden["experiment.toml"]
    for text in plain.values():
        assert b"123456" not in text
    for text in hidden.values():
        assert not any(t.id.encode() in text for t in TERMS)
    for g in read_experiment(lagged / "experiment").groups:
        assert np.array_equal(g.reading, np.round(g.reading, 2))


def test_data_come_from_the_literal_reference(known: Experiment, lagged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No fast path is called where nothing but the literal reference can know the ranges, and both agree."""
    answer = unseal(lagged)[1]
    lag = term("amplifier_lag")
    names = ["k_c", "c_s", "c_c", "amplifier_lag_tau"]
    design = Design.of(known.constants, known.groups)
    fast = simulate(design, [answer.parameters[n] for n in names], [lag]).launch_range[0] * 1e6
    assert answer.true_readings == pytest.approx(fast, rel=1e-8)
    with monkeypatch.context() as patch:
        patch.setattr("psafit.simulate.batch.closed_form.separation", None)
        patch.setattr("psafit.simulate.batch.stepper.separation", None)
        again = simulate_literally(
            design, answer.parameters, [lag], Occasions.of(known.groups), points=np.array([0, 15])
        )
    assert again.tolist() == [answer.true_readings[0], answer.true_readings[15]]


def test_sessions_keep_what_they_have_for_themselves(known: Experiment) -> None:
    gain = term("reading_gain")
    values = {"k_c": 4e5, "c_s": 9e3, "c_c": 60.0, "reading_gain_spread": math.log(2)}
    values |= {"reading_gain_z_1": 0.0, "reading_gain_z_2": 1.0, "reading_gain_z_3": -1.0}
    design = Design.of(known.constants, known.groups)
    points = np.array([1, 12, 18])  # one of each session
    without = simulate_literally(design, values, [], Occasions.of(known.groups), points=points)
    with_it = simulate_literally(design, values, [gain], Occasions.of(known.groups), points=points)
    assert with_it == pytest.approx(without * [1.0, 2.0, 0.5])


def test_readings_scatter_as_the_answer_says(lagged: Path) -> None:
    experiment, answer = unseal(lagged)
    read = np.concatenate([g.reading for g in experiment.groups])
    true = np.array(answer.true_readings)
    relative, absolute = answer.scatter["sigma_rel"], answer.scatter["sigma_abs"]
    assert relative is not None and absolute is not None and answer.scatter["nu"] is None
    assert 0.01 < relative < 0.2 and 0.005 < absolute < 0.5
    z = (read - true) / np.hypot(relative * true, absolute)
    # Five standard errors of mean and variance.
    assert abs(z.mean()) < 5 / math.sqrt(z.size) and abs(z.var() - 1) < 5 * math.sqrt(2 / z.size)


@pytest.mark.slow
def test_most_readings_of_a_truth_launch(known: Experiment, lagged: Path, tmp_path: Path) -> None:
    made = [make(s, tmp_path / str(s), design_of=known, kind="nothing").answer for s in range(6)]
    for answer in (unseal(lagged)[1], *made):
        assert np.mean(np.array(answer.true_readings) > 1.0) >= 0.5


def test_a_weak_truth_that_hardly_launches_is_tried_once(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The strongest of those tried gives way to the next."""
    nats = iter(range(99, 0, -1))

    def weak(*drawn: Any) -> hide.Truth:
        gain = float(next(nats))
        values = {"k_c": gain, "c_s": 9e3, "c_c": 60.0, "swing_drag_coefficient": 1e-3}
        return hide.Truth(values, {"swing_drag": gain}, {"swing_drag": 0.9}, reached=False)

    def ranges(design: Design, parameters: dict[str, float], *rest: Any, jobs: int) -> Any:
        return np.full(design.n_points, 0.0 if parameters["k_c"] == 99.0 else 10.0)

    monkeypatch.setattr(hide, "draw_challenge", weak)
    monkeypatch.setattr(hide, "simulate_literally", ranges)
    answer = make(
        1, tmp_path / "a", design_of=known, terms=["swing_drag"], strength=500.0, settings=HideSettings(patience=3)
    ).answer
    assert (answer.expected_nats, answer.redraws) == ({"swing_drag": 98.0}, 3)


def test_a_design_like_the_study_is_one_of_similar_size() -> None:
    like = ConditionSettings.like_the_study()
    for e in (drawn(seed, settings=like) for seed in (1, 2)):
        assert 4 <= len(e.groups) <= 7 and 180 <= sum(g.n_points for g in e.groups) <= 350
        assert all(g.drive.plain and g.observables == (LAUNCH_RANGE,) for g in e.groups)
        assert (e.constants.k_s, e.constants.q) == (4.89e7, 1.2e-7)
    assert drawn(1).fingerprint == drawn(1).fingerprint != drawn(2).fingerprint
    for n in (60, 300):
        asked = [drawn(seed, n, settings=like) for seed in range(9)]
        assert all(n - 6 <= sum(g.n_points for g in e.groups) <= n for e in asked)


def test_drawn_designs_have_every_drive_and_observable_and_other_stacks(tmp_path: Path) -> None:
    every = [drawn(seed) for seed in range(120)]
    groups = [g for e in every for g in e.groups]
    assert {g.drive.label.partition(" (")[0].replace(" ", "_") for g in groups} == {
        "sine", "square", "triangle", "unipolar_sine", "unipolar_square", "unipolar_triangle", "table",
        "recorded_drive",
    }  # fmt: skip
    assert all(any(getattr(g.drive, key) not in (0.0, math.inf) for g in groups)
               for key in ("bias_v", "idle_v", "phase_deg", "cycles"))  # fmt: skip
    assert {o for g in groups for o in g.observables} == set(OBSERVABLES)
    with_traces = [e for e in every if any(g.time_us is not None for g in e.groups)]
    # Of 120 with a chance of 0.25 fewer than 15 or more than 46 come in one run of a thousand.
    assert 15 <= len(with_traces) <= 46
    assert all(any(g.time_us is None for g in e.groups) for e in with_traces)  # besides launches
    few = [e for e in every if sum(g.n_points for g in e.groups if g.time_us is None) <= 60]
    # Of 120 with a chance of 0.4 fewer than 30 or more than 66 come in one run of a thousand.
    assert 30 <= len(few) <= 66 and len({e.constants.k_s for e in every}) > 30
    for e in every[:8]:  # the files hold them as they are
        whole = e.with_readings(np.ones(sum(g.n_points for g in e.groups)))
        write_experiment(whole, tmp_path / e.fingerprint)
        assert read_experiment(tmp_path / e.fingerprint).fingerprint == whole.fingerprint


def test_a_design_shows_what_is_hidden_in_it() -> None:
    """Some group is driven so that the cause acts, and reads what it changes."""
    for id in ("start_phase", "swing_drag"):
        cause = term(id)
        for seed in range(40):
            e = drawn(seed, causes=[cause])
            acting = [g for g in e.groups if cause.acts_on(g.drive)]
            assert any(LAUNCH_RANGE in g.observables or not cause.after_launch for g in acting)


def mixed() -> Experiment:
    """Two small sweeps: a unipolar sine whose ranges, times and forces are read, and a recording whose speeds are."""
    rig = measure(np.random.default_rng(5), readings=(8, 4, 3))
    a, b, _ = rig.groups
    rows, kinds = np.tile(np.arange(8), 3), np.repeat([0, 2, 3], 8)
    time = np.linspace(0.0, 1e-3, 40)
    recorded = Drive("table", table=Table(time, 15.0 * np.sin(1e3 * np.pi * time) ** 2, True), file="pulse.csv")
    first = replace(a.at(rows), drive=Drive("unipolar_sine", bias_v=2.0), measured=kinds, row=rows)
    second = replace(b, drive=recorded, frequency_hz=np.full(4, 1e3), measured=np.ones(4))
    return replace(rig, groups=(first, second))


def test_any_drive_and_observable_holds_what_the_reference_makes_of_it(tmp_path: Path) -> None:
    made = make(5, tmp_path, design_of=mixed(), kind="nothing")
    experiment, answer = unseal(tmp_path)
    assert answer.scatter.keys() == {p.name for o in OF_LAUNCHES for p in o.scatter}
    assert [g.observables for g in experiment.groups] == [g.observables for g in mixed().groups]
    design = Design.of(experiment.constants, experiment.groups)
    theta = [answer.parameters[name] for name in ("k_c", "c_s", "c_c")]
    assert answer.true_readings == pytest.approx(readings(design, theta)[0], rel=1e-6)
    relative, absolute, _ = noise.columns(by_reading(answer.scatter, design))
    read = np.concatenate([g.reading for g in experiment.groups])
    z = (read - np.array(answer.true_readings)) / np.hypot(relative * np.array(answer.true_readings), absolute)
    assert np.abs(z).max() < 5.0 and made.experiment.fingerprint == experiment.fingerprint
    assert b"pulse" not in b"".join(files(tmp_path / "experiment").values())


def test_a_launch_that_fails_has_no_time(tmp_path: Path) -> None:
    """Its cell stays empty, its range reads zero."""
    weak = mixed()
    a, b = weak.groups
    a = replace(a, amplitude_v=np.where(a.row < 2, 0.0, a.amplitude_v), drive=Drive("unipolar_sine"))
    make(5, tmp_path, design_of=replace(weak, groups=(a, b)), kind="nothing")
    experiment, answer = unseal(tmp_path)
    first = experiment.groups[0]
    assert [int(np.sum(first.measured == k)) for k in (0, 2, 3)] == [8, 6, 6]
    assert len(answer.true_readings) == first.n_points + experiment.groups[1].n_points


def test_the_answer_says_what_was_drawn(tmp_path: Path) -> None:
    made = make(7, tmp_path / "a", kind="nothing")
    reported = made.answer.drawn
    assert reported is not None and made.answer.design == "drawn"
    assert reported.drives == {str(g.id): g.drive.label for g in made.experiment.groups}
    assert reported.constants["M"] == made.experiment.constants.M
    assert files(tmp_path / "a") == files(make(7, tmp_path / "b", kind="nothing").folder)


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


def followed(samples: int = 40) -> Experiment:
    """A small sweep, and one of its launches over time: the ball's velocity, and the tip's displacement."""
    (sweep, *_), constants = mixed().groups, mixed().constants
    f, v = np.full(samples, 1200.0), np.full(samples, 20.0)
    time_us = np.linspace(0.0, 700.0, samples + 1)[1:]
    traces = [
        Group(k, "sine", f"{k}.csv", f, v, np.zeros(samples), measured=np.full(samples, OBSERVABLES.index(o)),
              time_us=time_us)
        for k, o in ((8, VELOCITY), (9, TIP_DISPLACEMENT))
    ]  # fmt: skip
    return replace(mixed(), constants=constants, groups=(sweep, *traces))


def test_traces_hold_what_the_reference_makes_of_them(tmp_path: Path) -> None:
    """Of either sign, with correlated scatter; a cause acts on them as the simulator has it."""
    make(5, tmp_path, design_of=followed(), terms=["soft_layer"])
    experiment, answer = unseal(tmp_path)
    design = Design.of(experiment.constants, experiment.groups)
    assert {"tau_velocity", "tau_tip_displacement"} < answer.scatter.keys()
    problem = Problem(experiment, experiment.ids, terms(["soft_layer"]))
    theta = [answer.parameters[name] for name in problem.names[: problem.n_physical]]
    true, read = np.array(answer.true_readings), np.concatenate([g.reading for g in experiment.groups])
    exact = readings(design, theta, problem.terms)[0]
    assert np.abs(true - exact)[design.traced].max() < 1e-5 * np.abs(true[design.traced]).max()
    assert read[design.traced].min() < 0.0
    z = standardised(read, answer.scatter, design) - standardised(true, answer.scatter, design)
    assert np.abs(z).max() < 5.0 and 0.7 < z[design.traced].std() < 1.3


def test_scatter_along_a_trace_is_correlated_and_whitening_undoes_that() -> None:
    design = Design.of(mixed().constants, followed(400).groups)
    scatter = {p.name: p.prior_median for o in OBSERVABLES for p in o.scatter} | {"tau_velocity": 50.0}
    one = design.measured == OBSERVABLES.index(VELOCITY)
    read = np.array([
        hide.read_off(design, np.ones(design.n_points), scatter, np.random.default_rng(seed), 4)[one]
        for seed in range(60)
    ]) - 1.0  # fmt: skip
    step = 700.0 / 400
    lag = np.mean(read[:, 10:] * read[:, :-10]) / np.mean(read**2)
    assert lag == pytest.approx(np.exp(-10 * step / 50.0), abs=0.06)


@pytest.mark.slow
def test_a_strength_is_asked_for_in_a_trace(tmp_path: Path) -> None:
    """Nats are counted as the likelihood counts them: the oracle of the data finds about as many."""
    made = make(3, tmp_path, design_of=followed(), terms=["soft_layer"], strength=30.0)
    gain = consult(made.experiment, made.answer, seed=1, starts=8, draws=256).gain
    assert made.answer.reached and 12.0 < gain < 75.0


def test_a_drive_that_launches_nothing_is_reported(known: Experiment, tmp_path: Path) -> None:
    still = tuple(replace(g, amplitude_v=np.full(g.n_points, 1e-6)) for g in known.groups)
    with pytest.raises(InputError, match="nothing launches at these conditions"):
        make(
            5, tmp_path / "x", design_of=replace(known, groups=still), kind="nothing", settings=HideSettings(redraws=5)
        )
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_the_least_weak_of_few_truths_will_do(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Where most rigs launch nothing, and none shows a cause as strongly as was asked."""
    drawn = hide.draw_challenge
    calls: list[None] = []

    def rarely(*words: Any) -> Any:
        calls.append(None)
        truth = drawn(*words) if len(calls) == 2 else None
        return truth and replace(truth, reached=False)

    monkeypatch.setattr(hide, "draw_challenge", rarely)
    made = make(5, tmp_path, design_of=known, terms=["gap"], strength=20.0, settings=HideSettings(redraws=7))
    assert made.answer.terms == ["gap"] and not made.answer.reached and len(calls) == 7


def test_there_are_enough_outside_effects() -> None:
    assert len({o.name for o in OUTSIDE}) >= 6 and not {o.name for o in OUTSIDE} & {t.id for t in TERMS}


@pytest.fixture(scope="module")
def unhidden(tmp_path_factory: pytest.TempPathFactory) -> Callable[[tuple[int, int, int]], tuple[Experiment, Answer]]:
    """A design of so many readings in each group, and a rig on it of which an outside effect is one thing more."""

    @cache
    def made(readings: tuple[int, int, int]) -> tuple[Experiment, Answer]:
        design = measure(np.random.default_rng(5), readings=readings)
        return design, make(11, tmp_path_factory.mktemp("plain"), design_of=design, kind="nothing").answer

    return made


@pytest.mark.parametrize(
    "effect", [pytest.param(o, id=o.name, marks=() if o.name in FAST else pytest.mark.slow) for o in OUTSIDE]
)
def test_outside_effects_act_where_they_say(unhidden: Any, tmp_path: Path, effect: Outside) -> None:
    # What is weaker shows among more readings.
    known, plain = unhidden((10, 7, 5) if effect.name in FAST else (30, 20, 12))
    made = make(11, tmp_path / "hidden", design_of=known, outside=effect)
    assert made.answer.parameters == plain.parameters  # the same rig, and one thing more
    assert made.answer.outside == effect.name and made.answer.terms == []
    changed = np.array(made.answer.true_readings) != np.array(plain.true_readings)
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
    assert consult(made.experiment, made.answer, seed=1, starts=12).gain > 10.0


@pytest.mark.slow
def test_believed_truths_have_the_scatter_that_a_diagnosis_believes_in(known: Experiment, tmp_path: Path) -> None:
    drawn = [make(k, tmp_path / f"b{k}", design_of=known, terms=[], believed=True).answer.scatter for k in range(6)]
    usual = make(1, tmp_path / "u", design_of=known, terms=[]).answer.scatter
    assert usual["nu"] is None and all(2.0 <= (s["nu"] or 0.0) <= 100.0 for s in drawn)
    assert np.std(np.log([s["sigma_rel"] or 0.0 for s in drawn])) > 0.4  # a factor of 2.5 for one standard deviation

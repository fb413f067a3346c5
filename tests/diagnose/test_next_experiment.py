"""Proposals of the next measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs import RIG
from truths import experiment

from psafit.diagnose import next_experiment
from psafit.diagnose.next_experiment import (
    Proposal,
    ProposalSettings,
    determine,
    planned,
    proposed,
    separating,
)
from psafit.diagnose.possible import TraceSettings, proposals
from psafit.drives import Drive, Table
from psafit.experiment import fingerprint, read_experiment, read_plan, write_experiment
from psafit.inference import noise
from psafit.inference.evidence import importance_sample
from psafit.observables import OBSERVABLES
from psafit.simulate import Design, simulate


def test_next_experiment_separates_what_is_tied(hidden):
    best_model = hidden.best_model
    rival = hidden.of(("flight_friction",))
    draws = [importance_sample(c, seed=1) for c in (best_model, rival)]
    found = separating([(best_model, draws[0]), (rival, draws[1])], seed=1)
    assert found[0].separation >= found[-1].separation
    assert found[0].separation > 3
    assert found[0].success > 0.5
    pair = found[0].pairs[0]
    assert (pair.first, pair.second) == (["amplifier_lag"], ["flight_friction"]) and len(found[0].pairs) == 1
    assert pair.separation == pytest.approx(found[0].separation, abs=3 * found[0].error)


def test_next_experiment_narrows_what_it_can(sound, monkeypatch):
    """... and of a parameter that no reading depends on it promises nothing, though the readings are many."""
    draws = importance_sample(sound, seed=1)
    name, found = determine(sound, draws, seed=1)
    assert name in sound.problem.names
    assert found[0].separation >= found[-1].separation >= 0

    monkeypatch.setattr(next_experiment.noise, "scale", lambda ranges, scatter, sigma: np.ones_like(ranges))
    rng = np.random.default_rng(1)

    def falls(reported, u):
        n = len(reported)
        return next_experiment.narrowing(
            next_experiment.PredictedReadings(reported, np.zeros((n, 3)), np.full(n, 1 / n)), u
        )[0]

    # Sixteen readings of unit scatter of a quantity of unit variance leave 1/17 of it.
    x = rng.normal(size=(400, 1))
    assert falls(np.repeat(x, 16, axis=1), x)[0] == pytest.approx(0.5 * np.log(17), abs=0.1)
    # Sixteen free numbers fit anything of forty draws by chance, and nothing is learnt of what is known.
    assert max(falls(10 * rng.normal(size=(40, 16)), rng.normal(size=(40, 8)))) < 0.05
    assert falls(x, np.ones((400, 1))) == [0.0]


def test_nothing_is_built_for_hardly_more():
    """A changed rig is listed where it does more than the rig as it is by a tenth, and by more than both err."""

    def listed(here, changed, error=0.01):
        a = next_experiment.Proposal("as it is", "sine", [1.0], [1.0], {}, here, None, error)
        b = replace(a, text="changed", constants={"l": 0.2}, separation=changed)
        c = replace(b, text="less", separation=0.5 * changed)
        purpose = next_experiment.Purpose("separate", [["gap"], ["preload"]])
        return [p.text for p in next_experiment.NextExperiment.of([b, c, a], purpose).proposals]

    assert listed(0.95, 1.0) == ["as it is"] and listed(0.85, 1.0) == ["changed", "as it is"]
    assert listed(0.85, 1.0, error=0.1) == ["as it is"] and listed(1.1, 1.0) == ["as it is"]
    # Where the rig as it is shows nothing, a changed one may, though both err by much.
    assert listed(0.4, 0.9, error=0.15) == ["changed", "as it is"]


def test_luck_puts_a_measurement_first_but_is_not_reported(sound, monkeypatch):
    """Where nothing but chance distinguishes proposals, the first of twelve promises no more than any other."""
    rng = np.random.default_rng(1)
    monkeypatch.setattr(next_experiment, "narrowing", lambda reported, u: rng.normal(size=(2, u.shape[1])))
    draws = importance_sample(sound, seed=1)
    first = [determine(sound, draws, seed=1)[1][0].separation for _ in range(5)]
    assert abs(np.mean(first)) < 2 / np.sqrt(5)  # two standard errors; the best of twelve has 1.6


def test_proposals_differ_and_stay_where_was_measured(sound):
    e = experiment()
    for low, high in ((1234.0, 1234.0), (1249.0, 1251.0), (1000.0, 1300.0)):
        groups = tuple(replace(g, frequency_hz=np.linspace(low, high, g.n_points)) for g in e.groups)
        possible = proposals(e.constants, groups, e.limits)
        assert len({p.text for p in possible}) == len(possible)
        assert all((low <= p.design.frequency).all() and (p.design.frequency <= high).all() for p in possible)
        swept = [p.text for p in possible if np.ptp(p.design.frequency) > 0]
        assert bool(swept) == (high == 1300.0)
    assert "sine, 1200 Hz, 3 to 20 V" in [p.text for p in possible]


def test_copies_of_a_draw_do_not_judge_what_it_made():
    """Two models of one posterior cannot be distinguished, however few different draws it has."""
    rng = np.random.default_rng(1)
    few = np.repeat(rng.normal(100.0, 30.0, size=(12, 1)), 16, axis=1)
    weight = rng.dirichlet(np.ones(12))
    twin = next_experiment.PredictedReadings(few, np.tile([0.05, 0.1, 30.0], (12, 1)), weight)
    (separation, success, error), _ = next_experiment.separation_of([twin, replace(twin)], rng, ProposalSettings())
    assert separation < 2 * error and success < 0.1
    # What readings state for themselves is part of their scatter.
    known = replace(twin, known=np.array([200.0]))
    other = replace(known, ranges=few + 20.0)
    clear, _ = next_experiment.separation_of([twin, replace(other, known=None)], rng, ProposalSettings())
    assert next_experiment.separation_of([known, other], rng, ProposalSettings())[0][0] < 0.5 < clear[0]


def test_a_measurement_that_settles_one_question_of_two_is_reported_so():
    """Two models that predict the same, and a third far from them: worth ln 2 against the others, and one pair tied."""
    rng = np.random.default_rng(1)
    near = np.repeat(rng.normal(100.0, 1.0, size=(40, 1)), 16, axis=1)
    scatter, weight = np.tile([0.05, 0.1, 30.0], (40, 1)), np.full(40, 1 / 40)
    one, far = (next_experiment.PredictedReadings(x, scatter, weight) for x in (near, near + 100.0))
    (separation, success, error), pairs = next_experiment.separation_of(
        [one, replace(one), far], rng, ProposalSettings()
    )
    assert separation == pytest.approx(np.log(2), abs=3 * error + 0.02) and success < 0.1
    assert abs(pairs[0, 1]) < 0.1 and pairs[0, 2] > 40 and pairs[1, 2] > 40 and (pairs == pairs.T).all()


def test_proposals_keep_to_stated_limits(sound):
    limits = (("frequency_hz", (300.0, 9000.0)), ("amplitude_v", (2.0, 40.0)), ("l", (RIG.l, 0.2)), ("M", (0.01, 0.02)))

    def possible(limits):
        stated = replace(sound.problem.experiment, limits=limits)
        return proposals(stated.constants, stated.groups, stated.limits)

    found = possible(limits)
    assert {300.0, 9000.0} <= {float(f) for p in found for f in p.design.frequency}
    assert all(p.design.frequency.min() >= 300 and p.design.frequency.max() <= 9000 for p in found)
    assert {round(float(v), 6) for p in found for v in (p.design.amplitude.min(), p.design.amplitude.max())} <= {
        2.0, 8.0, 20.0, 40.0,
    }  # fmt: skip
    # A string as long as it is is no other rig.
    assert {tuple(p.changed.items()) for p in found} == {(), (("l", 0.2),), (("M", 0.01),), (("M", 0.02),)}
    assert any("l = 0.2 m" in p.text for p in found)
    assert not any(p.changed for p in possible(limits[:2]))
    assert all(p.design.frequency.tolist() == [5.0] * 16 for p in possible((("frequency_hz", (5.0, 5.0)),)))


def test_each_drive_keeps_to_what_it_was_taken_to():
    """A unipolar 100 V is no sine of 100 V; a bias step without a sweep has no amplitude to vary."""
    e = experiment(n=6, groups=("a", "b"))
    unipolar = replace(e.groups[0], drive=Drive("unipolar_sine"), amplitude_v=np.full(6, 100.0))
    step = replace(e.groups[1], id="c", drive=Drive("square", bias_v=20.0), amplitude_v=np.zeros(6))
    found = proposals(RIG, [unipolar, e.groups[1], step], ())
    most = {
        d: max(p.design.amplitude.max() for p in found if p.design.used == (d,)) for p in found for d in p.design.used
    }
    assert most == {Drive("sine"): 20.0, Drive("square"): 20.0, Drive("unipolar_sine"): 100.0}
    assert proposals(RIG, [step], ()) == []


def test_what_is_read_already_needs_no_instrument(sound):
    """Of a rig that reads contact times only a launch range is new, and so it is to one that takes traces only."""
    e = sound.problem.experiment
    for k in (OBSERVABLES.index(o) for o in OBSERVABLES if o.name in ("contact_time", "velocity")):
        time = 10.0 * (1 + np.arange(24)) if OBSERVABLES[k].traced else None
        at = {"frequency_hz": np.full(24, 900.0), "amplitude_v": np.full(24, 20.0)} if OBSERVABLES[k].traced else {}
        group = replace(e.groups[0], measured=np.full(24, k, np.int8), time_us=time, **at)
        rig = replace(e, groups=(group,), fingerprint=fingerprint(RIG, (group,)))
        here = replace(sound, problem=replace(sound.problem, experiment=rig, group_ids=("a",)))
        here = replace(here, modes=here.problem.medians[None])
        possible = next_experiment.possible_measurements(here, TraceSettings(samples=8))
        assert {p.design.measured[0] for p in possible if not p.other} == {k}
        ranges = [p for p in possible if p.design.measured[0] == 0]
        assert ranges and all(p.other and p.text.endswith("and read launch ranges") for p in ranges)


def test_one_proposal_leaves_the_rig_as_it_is(sound):
    """... though every other string separates more: it is the one that can be rehearsed with what was measured."""
    rng = np.random.default_rng(1)
    e = sound.problem.experiment
    possible = proposals(e.constants, e.groups, e.limits)
    kept = next_experiment.best_of(
        possible, [bool(p.changed) + rng.random() / 2 for p in possible], ProposalSettings.closer
    )
    assert [not possible[k].changed for k in kept] == [False] * 12 + [True]


def test_the_best_of_what_each_needs_is_looked_at_and_listed(sound):
    """Five traces of one launch are one idea; whoever has no vibrometer hangs another ball."""
    possible = next_experiment.possible_measurements(sound, TraceSettings())
    worth = [1.0 + 0.01 * k if p.design.traced.any() else 0.01 for k, p in enumerate(possible)]
    kept = next_experiment.best_of(possible, worth, 4)
    assert all(possible[k].design.traced.any() for k in kept[:4])
    assert sorted({possible[k].needs for k in kept}) == sorted({p.needs for p in possible})
    here = next_experiment.Proposal("here", "sine", [1.0], [1.0], {}, 0.2, None, 0.01)
    ball = replace(here, text="ball", constants={"M": 0.002}, separation=0.5)
    traces = [
        replace(here, text=f"{k}", other=True, observable="velocity", time_us=[1.0, 2.0], separation=1.0 - 0.01 * k)
        for k in range(6)
    ]
    purpose = next_experiment.Purpose("narrow", parameter="c_c")
    found = next_experiment.NextExperiment.of([*traces, ball, here], purpose)
    assert [p.text for p in found.proposals] == ["0", "1", "2", "ball", "here"]
    two = next_experiment.NextExperiment.of([*traces, ball, here], purpose, most=1)
    assert [p.text for p in two.proposals] == ["here"]


def test_what_is_worth_its_measurement_comes_before_what_is_not():
    """Though it takes another rig: the other proposal may do nothing at all."""
    here = next_experiment.Proposal("here", "sine", [1.0], [1.0], {}, 0.07, None, 0.07)
    other = replace(here, text="ball", constants={"M": 0.002}, separation=0.31, error=0.08)
    purpose = next_experiment.Purpose("narrow", parameter="c_c")
    for found, first, worth in (([here, other], "ball", True), ([here, replace(other, error=0.2)], "here", False)):
        one = next_experiment.NextExperiment.of(found, purpose)
        assert one.proposals[0].text == first and bool(one.recommended) is worth
        assert len(one.proposals) == 1 + worth


def test_another_observable_must_do_markedly_more():
    """An instrument that is not there yet has its price, as a rig that must be built has."""
    one = next_experiment.Proposal("ranges", "sine", [1.0], [1.0], {}, 1.0, None, 0.01)
    assert one.as_it_is
    for separation, first in ((1.05, "ranges"), (1.3, "times")):
        other = replace(one, text="times", observable="contact_time", other=True, separation=separation)
        assert not other.as_it_is
        found = next_experiment.NextExperiment.of([other, one], next_experiment.Purpose("narrow", parameter="c_c"))
        assert found.proposals[0].text == first


def test_each_observable_is_tried_on_the_rig_as_it_is(sound):
    possible = next_experiment.possible_measurements(sound, TraceSettings())
    others = [p for p in possible if p.other]
    assert {OBSERVABLES[p.design.measured[0]].name for p in others} == {
        "launch_speed", "contact_time", "peak_force", "displacement", "velocity", "tip_displacement",
    }  # fmt: skip
    assert not any(p.changed for p in others) and any(p.text.endswith(", and read contact times") for p in others)
    assert len({p.text for p in possible}) == len(possible)
    rig = replace(sound.problem.experiment, readable=("contact_time_us", "tip_displacement_um"))
    few = replace(sound, problem=replace(sound.problem, experiment=rig))
    read = {o for p in next_experiment.possible_measurements(few, TraceSettings()) for o in p.design.measured}
    assert {OBSERVABLES[k].name for k in read} == {"launch_range", "contact_time", "tip_displacement"}


def test_no_contact_time_is_expected_of_a_launch_that_fails(sound):
    """A cell is left empty there: whether it is says nothing."""
    reported = next_experiment.PredictedReadings(
        np.array([[0.0, 3.0, 2.0], [1.0, 3.0, 2.0]]), np.ones((2, 3)), np.full(2, 0.5)
    )
    possible = next_experiment.possible_measurements(sound, TraceSettings())
    times = next(p for p in possible if p.other and OBSERVABLES[p.design.measured[0]].blank)
    assert next_experiment.legible([reported, reported], times)[1].ranges.tolist() == [[3.0, 2.0], [3.0, 2.0]]
    assert next_experiment.legible([reported], possible[0])[0].ranges.shape == (2, 3)


def test_a_planned_contact_time_waits_for_its_column(sound):
    """The folder asks for what the proposal reads, whose scatter a fit has not seen: its prior's median."""
    proposal = next_experiment.Proposal(
        "a", "sine", [900.0, 1100.0], [10.0, 10.0], {}, 1.0, None, 0.1, observable="contact_time"
    )
    problem = sound.problem
    sweep = next_experiment.planned(proposal, "next", problem.experiment)
    assert [o.name for o in sweep.observables] == ["contact_time"]
    scatter = problem.scatter_to_come(sound.modes[:1], int(sweep.measured[0]))
    assert scatter[0].tolist() == [p.prior_median for p in sweep.observable.scatter]
    assert problem.scatter_to_come(sound.modes[:1], 0)[0] == pytest.approx(problem.noise_values(sound.modes[:1])[0])


def test_a_trace_is_proposed_with_its_launch_its_length_and_its_samples(sound, tmp_path):
    """Over twice the contact of the best model; the plan waits for its readings, and a simulation knows its times."""
    possible = [
        p for p in next_experiment.possible_measurements(sound, TraceSettings(samples=20)) if p.design.traced.any()
    ]
    assert len({p.text for p in possible}) == len(possible) and all(p.other for p in possible)
    one = next(p for p in possible if p.text.startswith("a trace of the ball's velocity, square, "))
    time = one.design.time
    assert f"20 samples over {time[-1] * 1e6:g} us" in one.text and np.allclose(np.diff(time, prepend=0.0), time[0])
    d, theta = one.design, sound.values[None, :3]
    lasts = simulate(Design.sweep(RIG, "square", d.frequency[0], d.amplitude[0]), theta).separation_time[0, 0]
    assert time[-1] == pytest.approx(2 * lasts, rel=0.06)
    proposal = next_experiment.proposal_of(one, (1.0, None, 0.1))
    assert (proposal.frequency_hz, proposal.n_readings) == ([d.frequency[0]], 20) and not proposal.as_it_is
    sweep = next_experiment.planned(proposal, "next", sound.problem.experiment)
    write_experiment(sound.problem.experiment, tmp_path / "planned", [sweep])
    read = read_plan(tmp_path / "planned").groups[-1]
    assert [o.name for o in read.observables] == ["velocity"] and read.time_us == pytest.approx(time * 1e6, rel=1e-5)


def test_planned_numbers_can_be_set_on_a_generator(sound):
    """Digits that come from a computation go; an end that only they hold is no limit, another is."""
    here = next_experiment.Proposal(
        "x", "sine", [300.0] * 3, [11.840000000000002, 13.3333333333, 38.849999999999994], {}, 1.0, None, 0.1
    )
    plan = next_experiment.planned(here, "next", sound.problem.experiment)
    assert plan.amplitude_v.tolist() == [11.84, 13.33, 38.85]
    near = replace(here, frequency_hz=[19990.0, 19992.5, 19995.0])
    assert next_experiment.planned(near, "next", sound.problem.experiment).frequency_hz.tolist() == [
        19990.0, 19992.0, 19995.0
    ]  # fmt: skip
    plan = next_experiment.planned(
        replace(here, amplitude_v=[2.0, 19.9999994, 19.99]), "next", sound.problem.experiment
    )
    assert plan.amplitude_v.max() == 19.9999994  # twenty is more than was allowed


def test_samples_of_a_proposed_trace_count_with_their_correlation():
    """Densities are those of the likelihood, draw by draw; samples in between say little more."""
    rng, settings = np.random.default_rng(1), ProposalSettings(trials=400)
    separation = []
    for n in (16, 64):
        time = np.linspace(0.0, 6e-4, n + 1)[1:]
        scatter = noise.along(np.tile([0.02, 0.02, 30.0, 200.0], (5, 1)), np.diff(time, prepend=-np.inf))
        motion = 5.0 * (time / time[-1]) ** 2
        shifted = motion + 0.05 * time / time[-1]
        one, other = (
            next_experiment.PredictedReadings(np.tile(x, (5, 1)), scatter, np.full(5, 0.2), None, -np.inf)
            for x in (motion, shifted)
        )
        rows = motion + 0.05 * rng.standard_normal((3, n))
        exact = [noise.log_density(row, one.ranges, scatter, None).sum(axis=1).mean() for row in rows]
        assert one.log_density(rows) == pytest.approx(exact)
        separation.append(next_experiment.separation_of([one, other], rng, settings)[0][0])
    assert separation[0] > 0.3 and separation[1] < 1.5 * separation[0]


def a_table(recorded: bool) -> Drive:
    if recorded:
        time = np.linspace(0, 2e-3, 51)
        return Drive("table", table=Table(time, 10 * np.sin(2 * np.pi * 800 * time) ** 2, True), file="drive.csv")
    return Drive("table", table=Table(np.array([0.0, 0.25, 1.0]), np.array([0.0, 1.0, 0.0]), False), file="drive.csv")


@pytest.mark.parametrize("recorded", [True, False], ids=["recording", "table"])
def test_a_rig_that_has_tables_only_is_offered_them(recorded, tmp_path):
    """A recording again, as it is or for another rig; one period of a table in sweeps. The plan keeps the drive."""
    e, drive = experiment(n=6, groups=("a",)), a_table(recorded)
    group = replace(e.groups[0], drive=drive, frequency_hz=np.full(6, 800.0), amplitude_v=np.full(6, 10.0))
    write_experiment(replace(e, groups=(group,)), tmp_path / "measured")
    measured = read_experiment(tmp_path / "measured")
    possible = proposals(measured.constants, measured.groups, measured.limits)
    assert possible and all(p.design.used == (measured.groups[0].drive,) for p in possible)
    assert recorded == all(np.ptp(p.design.frequency) == np.ptp(p.design.amplitude) == 0.0 for p in possible)
    assert {bool(p.changed) for p in possible} == {True, False}
    sweep = planned(next_experiment.proposal_of(possible[0], (1.0, None, 0.1)), "next", measured)
    write_experiment(measured, tmp_path / "plan", [sweep])
    assert read_plan(tmp_path / "plan").groups[-1].drive == measured.groups[0].drive


def test_a_table_that_no_group_has_is_no_proposal():
    settings = {"drive": "lost.csv"}
    lost = Proposal("", "table", [1.0], [1.0], {}, 1.0, None, 0.1, drive=settings)
    with pytest.raises(ValueError, match="no group has the drive"):
        proposed(lost.waveform, lost.drive, experiment(n=6).groups)


def test_a_rig_whose_limits_are_its_recording_s_narrows_nothing_by_sweeps(sound):
    """Nothing is asked of frequencies and amplitudes that a recording only bears as names."""
    groups = [replace(g, drive=a_table(True)) for g in sound.problem.experiment.groups]
    found = proposals(RIG, groups, [("frequency_hz", (100.0, 200.0)), ("amplitude_v", (1.0, 2.0))])
    assert {p.text for p in found} == {"16 launches by the recording drive.csv"}

"""Instruments that have names: each has a gain of its own in each session."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from folders import CSV, HEADER, TOML, refusal, write
from rigs import RIG, TRUTH

from psafit.challenge.hide import make, simulate_literally
from psafit.cli.fitting import check
from psafit.cli.simulating import completed, of_sessions
from psafit.diagnose.show import Offset, offsets, unlike
from psafit.experiment import (
    Conditions,
    Experiment,
    Occasions,
    Plan,
    describe,
    read_experiment,
    session_name,
    write_experiment,
)
from psafit.inference.candidate import optimised
from psafit.inference.problem import Problem
from psafit.inference.summary import by_session
from psafit.observables import CONTACT_TIME, DISPLACEMENT, LAUNCH_RANGE, LAUNCH_SPEED, OBSERVABLES
from psafit.physics import TERMS, terms
from psafit.records import SessionSummary, plain
from psafit.simulate import Design, readings
from psafit.simulate.sensitivity import sets_with
from psafit.validate import intervals

LASER = (("launch_speed_mm_s", "laser"),)
BOTH = HEADER.replace("launch_range_um", "launch_speed_mm_s,launch_range_um") + "1200,2,0.4,0.37\n1200,20,80,76.0\n"


def with_instruments(folder: Path, lines: str = 'launch_speed_mm_s = "laser"') -> Path:
    return write(folder, f"{TOML}\n[instruments]\n{lines}\n", a=BOTH)


@pytest.mark.parametrize("column", ["launch_range_um", "launch_speed_mm_s", "contact_time_us", "peak_force_n"])
@pytest.mark.parametrize("cause", [t.id for t in TERMS if t.latent])
def test_what_sessions_have_is_predicted_where_nothing_read_shows_it(tmp_path: Path, cause: str, column: str) -> None:
    """No instrument has a gain to be fitted where only contact times or forces were read."""
    read = CSV.replace("launch_range_um", column)
    experiment = read_experiment(write(tmp_path, a=read, b=read))
    problem = Problem(experiment, experiment.ids, terms([cause]))
    u = problem.medians[None]
    assert problem.predict(u).shape == (1, 6) and np.isfinite(problem.log_posterior(u)).all()
    if cause == "reading_gain" and column in ("contact_time_us", "peak_force_n"):
        plain, left = problem.without(*problem.terms)
        assert problem.predict(u) == pytest.approx(plain.predict(u[:, left]), rel=1e-12)


def test_instruments_are_read_written_and_part_of_the_data(tmp_path: Path) -> None:
    plain = read_experiment(write(tmp_path / "plain", a=BOTH))
    experiment = read_experiment(with_instruments(tmp_path / "named"))
    assert experiment.instruments == LASER and plain.instruments == ()
    assert experiment.fingerprint != plain.fingerprint
    assert describe(experiment)["instruments"] == dict(LASER) and "instruments" not in describe(plain)
    # As its definition stands, and as it is written anew under another title.
    for k, given in enumerate((experiment, replace(experiment, title="another"))):
        write_experiment(given, tmp_path / str(k))
        again = read_experiment(tmp_path / str(k))
        assert (again.instruments, again.fingerprint) == (LASER, experiment.fingerprint)


def test_check_says_which_column_has_an_instrument(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = 'launch_speed_mm_s = "laser"\nlaunch_range_um = "Laser"\npeak_force_n = "sensor"'
    check.main([str(with_instruments(tmp_path / "named", lines))], standalone_mode=False)
    out, err = capsys.readouterr()
    assert "  instrument laser: launch speeds\n" in out and "instrument sensor" not in out
    assert "sensor is to read peak_force_n, which no group has" in err
    assert "laser and Laser count as different instruments" in err


@pytest.mark.parametrize(
    ("lines", "what"),
    [
        ('launch_speed = "laser"', "nothing is read as 'launch_speed'"),
        ('launch_speed_mm_s = "the laser"', "'the laser' is no name of an instrument"),
        ("launch_speed_mm_s = 3", "is no name of an instrument"),
    ],
)
def test_what_is_no_column_or_no_name_is_refused(tmp_path: Path, lines: str, what: str) -> None:
    error = refusal(with_instruments(tmp_path / "named", lines))
    assert what in error.what and error.line == TOML.count("\n") + 3


def test_what_no_group_reads_and_the_order_of_the_lines_are_no_data(tmp_path: Path) -> None:
    lines = (
        'launch_speed_mm_s = "laser"\nlaunch_range_um = "camera"',
        'launch_range_um = "camera"\nlaunch_speed_mm_s = "laser"',
    )
    found = [read_experiment(with_instruments(tmp_path / str(k), text)).fingerprint for k, text in enumerate(lines)]
    more = read_experiment(with_instruments(tmp_path / "more", lines[0] + '\nvelocity_mm_s = "laser"'))
    assert {*found, more.fingerprint} == {found[0]}


def test_a_definition_with_other_instruments_is_written_anew(tmp_path: Path) -> None:
    experiment = read_experiment(with_instruments(tmp_path / "named"))
    write_experiment(named(experiment, ()), tmp_path / "again")
    assert read_experiment(tmp_path / "again").instruments == ()
    mixed = replace(experiment, groups=(experiment.groups[0], replace(experiment.groups[1], instruments=())))
    with pytest.raises(ValueError, match="groups of one experiment name different instruments"):
        write_experiment(mixed, tmp_path / "mixed")


def read_of(known: Experiment, kind: int, rows: slice, first: bool) -> Experiment:
    """The first two groups, the first with readings of another observable before or behind its ranges."""
    ranges = known.groups[0]
    more = ranges.at(rows)
    order = (more, ranges) if first else (ranges, more)
    joined = {
        name: np.concatenate([getattr(g, name) for g in order])
        for name in ("frequency_hz", "amplitude_v", "reading", "row")
    }
    measured = np.concatenate([np.full(g.n_points, kind if g is more else 0) for g in order])
    both = replace(ranges, **joined, measured=measured)
    return replace(known, groups=(both, known.groups[1]))


def named(experiment: Experiment, instruments: tuple[tuple[str, str], ...]) -> Experiment:
    return replace(experiment, groups=tuple(replace(g, instruments=instruments) for g in experiment.groups))


@pytest.mark.parametrize("first", [False, True], ids=["behind", "before"])
def test_each_instrument_has_its_gain_in_each_session(known: Experiment, first: bool) -> None:
    """Whichever observable of a launch stands first in the file."""
    speed = OBSERVABLES.index(LAUNCH_SPEED)
    experiment = named(read_of(known, speed, slice(2, 9), first), LASER)
    problem = Problem(experiment, (1, 2), terms(["reading_gain"]))
    readers = Occasions.of(experiment.groups).readers
    assert {*readers} == {1, "1 laser", 2} and problem.n_physical == 4 and problem.n_dim == len(problem.blocks)
    z = {1: 1.0, "1 laser": -2.0, 2: 0.5}
    x = problem.to_physical(problem.medians)[None]
    values = {"reading_gain_spread": 0.2} | {session_name("reading_gain_z", id): z[id] for id in readers}
    x[0, [problem.names.index(name) for name in values]] = [*values.values()]
    plain = Problem(experiment, (1, 2))
    level = plain.predict(plain.medians[None])[0]
    of = [z["1 laser" if k == speed else 1] for k in experiment.groups[0].measured] + [z[2]] * experiment.groups[
        1
    ].n_points
    assert problem.predict(problem.to_sampling(x))[0] == pytest.approx(level * np.exp(0.2 * np.array(of)), rel=1e-9)
    found = {(g.id, problem.named_for(t, g)[1]): float(gain[0]) for t, _, g, gain in by_session(problem, x)}
    gains = {(1, None): 1.0, (1, "laser"): -2.0, (2, None): 0.5}
    assert found == {where: pytest.approx(np.exp(0.2 * own)) for where, own in gains.items()}


def test_a_lean_is_one_for_all_that_is_read_of_a_launch(known: Experiment) -> None:
    experiment = named(read_of(known, OBSERVABLES.index(LAUNCH_SPEED), slice(2, 9), False), LASER)
    problem = Problem(experiment, (1, 2), terms(["session_lean", "reading_gain"]))
    latents = [name for name in problem.names if "_z_" in name]
    assert sum(name.startswith("session_lean") for name in latents) == 2 and len(latents) == 5
    rows = problem.to_physical(problem.medians)[None]
    leans = [problem.named_for(t, g) for t, _, g, _ in by_session(problem, rows) if t.id == "session_lean"]
    assert leans == [(None, None), (None, None)]


@pytest.mark.parametrize("ids", [("reading_gain",), ("session_lean", "reading_gain"), ("gap", "reading_gain")], ids=str)
def test_the_reference_reads_instruments_as_the_simulator_does(ids: tuple[str, ...]) -> None:
    """Speeds before ranges of the same launches, a trace of a third instrument, and another session."""
    f, v = np.geomspace(300, 5e3, 3), np.full(3, 20.0)
    kinds = [OBSERVABLES.index(o) for o in (LAUNCH_SPEED, LAUNCH_RANGE, CONTACT_TIME)]
    instruments = (*LASER, ("displacement_um", "vibrometer"))
    both = Conditions(
        1, "sine", "1.csv", np.tile(f, 3), np.tile(v, 3), measured=np.repeat(kinds, 3),
        session="day", instruments=instruments,
    )  # fmt: skip
    trace = Conditions(
        "t", "sine", "t.csv", np.full(3, 900.0), v, measured=np.full(3, OBSERVABLES.index(DISPLACEMENT)),
        time_us=np.array([100.0, 400.0, 900.0]), session="day", instruments=instruments,
    )  # fmt: skip
    groups = [both, replace(both, id=2, session=None), trace]
    design, chosen, occasions = Design.of(RIG, groups), terms(ids), Occasions.of(groups)
    assert design.counts == (2, 5) and len(occasions.readers) == 5
    own: dict[str, tuple[float, ...]] = {"reading_gain": (0.2,), "session_lean": (3e-3, 0.4), "gap": (2e-7,)}
    row, values = TRUTH.tolist(), dict(zip(("k_c", "c_s", "c_c"), TRUTH.tolist(), strict=True))
    free = itertools.count(1)
    for term in chosen:
        given = dict(zip((p.name for p in term.parameters), own[term.id], strict=True))
        there = getattr(occasions, term.per) if term.latent else ()
        given |= {session_name(term.latent.name, id): 0.3 * (-1) ** k * k for id in there for k in [next(free)]}
        values |= given
        row += [*given.values()]
    fast = readings(design, row, chosen, tolerance=1e-9)[0]
    assert fast == pytest.approx(simulate_literally(design, values, chosen, occasions), rel=1e-6, abs=1e-9)


def test_a_name_for_all_that_is_read_changes_no_prediction(known: Experiment) -> None:
    """One instrument is one, with or without a name."""
    ids, named_ = (1, 2), named(known, ((LAUNCH_RANGE.column, "camera"),))
    problems = [Problem(e, ids, terms(["reading_gain"])) for e in (known, named_)]
    u = np.random.default_rng(0).normal(0.0, 0.1, (5, problems[0].n_dim)) + problems[0].medians
    one, other = (p.predict(np.clip(u, *p.bounds.T)) for p in problems)
    assert np.array_equal(one, other)


def test_gains_that_two_instruments_may_have_are_no_riddle(known: Experiment) -> None:
    """A sweep twice, the second time with ranges by a third higher and speeds as they were."""
    speed = OBSERVABLES.index(LAUNCH_SPEED)
    (first, _), level = read_of(known, speed, slice(0, None), False).groups, 1.02
    more = np.where(first.measured == speed, level, 4 / 3)
    twice = replace(known, groups=(first, replace(first, id=2, reading=first.reading * more)))
    for instruments, asked in (((), True), (LASER, False)):
        problem = Problem(named(twice, instruments), (1, 2))
        found = offsets(optimised(problem, problem.medians[None]))
        assert [o.instrument for o in found] == [None, dict(instruments).get("launch_speed_mm_s")]
        sharp = [replace(o, lower=o.factor * 0.99, upper=o.factor * 1.01) for o in found]
        assert isinstance(sharp[0], Offset) and (unlike(sharp, TERMS, 0.05) is not None) == asked


def test_an_instrument_in_a_session_to_come_is_drawn(known: Experiment, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the second session's laser has is not taken over from the first session's."""
    experiment = named(read_of(known, OBSERVABLES.index(LAUNCH_SPEED), slice(2, 9), False), LASER)
    problem = Problem(experiment, (2,), terms(["reading_gain"]))
    x = np.tile(problem.to_physical(problem.medians), (400, 1))
    x[:, problem.names.index("reading_gain_spread")] = 0.3
    u, rng = problem.to_sampling(x), np.random.default_rng(1)
    speeds, filled = experiment.groups[0].measured > 0, experiment.groups[0].filled()
    assert filled.instruments == LASER
    monkeypatch.setattr("psafit.validate.some_draws", lambda run, n: u)
    run: Any = SimpleNamespace(problem=problem, fit=SimpleNamespace(seed=1))
    low, high = intervals(run, Plan(RIG, (filled,), ()))
    assert low.size == filled.n_points and (np.log(high / low) > 0.8).all()
    found = np.log(problem.predict(u, (1,), rng))
    gains = found[:, ~speeds][:, 0], found[:, speeds][:, 0]
    assert abs(np.corrcoef(gains)[0, 1]) < 0.2 and np.std(gains, axis=1) == pytest.approx([0.3, 0.3], rel=0.15)


def all_read(known: Experiment) -> Experiment:
    """Ranges, speeds and contact times of the first group."""
    speeds, times = (
        read_of(known, OBSERVABLES.index(o), slice(0, None), False).groups[0] for o in (LAUNCH_SPEED, CONTACT_TIME)
    )
    late = times.at(times.measured > 0)
    names = ("frequency_hz", "amplitude_v", "reading", "row", "measured")
    joined = {name: np.concatenate([getattr(speeds, name), getattr(late, name)]) for name in names}
    return replace(known, groups=(replace(speeds, **joined), known.groups[1]))


@pytest.mark.parametrize(
    "instruments",
    [(*LASER, ("launch_range_um", "camera")), (*LASER, ("contact_time_us", "scope")), LASER],
    ids=["two named", "a scope", "the laser alone"],
)
def test_what_no_gain_changes_has_none(known: Experiment, instruments: tuple[tuple[str, str], ...]) -> None:
    """Whatever else has a name: ranges and speeds have a gain each, contact times have none."""
    (gain,), experiment = terms(["reading_gain"]), named(all_read(known), instruments)
    problem = Problem(experiment, (1,), (gain,))
    assert sum("_z_" in name for name in problem.names) == 2
    assert len([*by_session(problem, problem.to_physical(problem.medians)[None])]) == 2
    sets = sets_with(gain, problem.design, TRUTH, [0.1])
    found = readings(problem.design, sets, [gain])
    assert len(sets) == 3 and (np.ptp(found, axis=0) > 0).tolist() == (problem.design.measured < 2).tolist()
    assert np.isfinite(problem.predict(problem.medians[None])).all()


def test_a_run_of_other_instruments_is_of_another_session(known: Experiment) -> None:
    experiment, (gain,) = named(all_read(known), LASER), terms(["reading_gain"])
    laser = session_name("reading_gain_z", "1 laser")
    medians = {"k_c": 1e6, "reading_gain_spread": 0.1, laser: 1.5, "reading_gain_z_1": -0.5}
    for instruments, kept in ((LASER, True), ((("launch_speed_mm_s", "vibrometer"),), False), ((), False)):
        plan = Plan(RIG, named(experiment, instruments).groups, ())
        found = of_sessions(plan, (gain,), medians, experiment.groups, True)
        assert ("reading_gain_z_1" in found) == kept
        assert instruments != LASER or laser in found
    plan = Plan(RIG, experiment.groups, ())
    assert laser in completed(plan, (gain,), {"reading_gain_spread": 0.1}, {}, seed=3)


def test_records_say_which_instrument(tmp_path: Path) -> None:
    found = SessionSummary("reading_gain", 1, "a session's gain", "1", 1.0, 0.9, 1.1, "day", "laser")
    assert found.where == "session day (laser)" and replace(found, instrument=None).where == "session day"
    assert plain(found)["instrument"] == "laser" and "instrument" not in plain(replace(found, instrument=None))


def test_a_reading_without_a_latent_counts_sessions() -> None:
    (gain,) = terms(["reading_gain"])
    assert (gain.per, replace(gain, latent=None, of_session=None).per) == ("readers", "sessions")


def test_a_challenge_has_the_instruments_of_its_conditions(known: Experiment, tmp_path: Path) -> None:
    experiment = named(read_of(known, OBSERVABLES.index(LAUNCH_SPEED), slice(0, None), False), LASER)
    answer = make(1, tmp_path / "a", design_of=experiment, terms=["reading_gain"], strength=30.0).answer
    assert len([name for name in answer.parameters if "_z_" in name]) == 3

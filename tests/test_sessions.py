"""Groups that were measured on one occasion share what that session has for itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from folders import TOML, refusal, write
from rigs import RIG, TRUTH

from psafit.challenge.hide import simulate_literally
from psafit.cli.simulating import completed, of_sessions
from psafit.diagnose.residuals import MisfitSettings, looks
from psafit.diagnose.show import offsets
from psafit.experiment import (
    Conditions,
    Experiment,
    Group,
    GroupId,
    Occasions,
    Plan,
    describe,
    read_experiment,
    session_name,
    sessions_of,
    write_experiment,
)
from psafit.inference.candidate import optimised
from psafit.inference.problem import Problem
from psafit.inference.summary import by_session
from psafit.observables import DISPLACEMENT, OBSERVABLES
from psafit.physics import terms
from psafit.simulate import Design, readings


def test_a_session_is_read_written_and_part_of_the_data(tmp_path: Path) -> None:
    """A name, or another group's id, which means that group's session."""
    plain = read_experiment(write(tmp_path / "plain"))
    first, second = plain.ids
    for k, session in enumerate(('"monday"', f'"{first}"', str(first))):
        experiment = read_experiment(write(tmp_path / str(k), TOML + f"session = {session}\n"))
        assert experiment.fingerprint != plain.fingerprint
        label = session.strip('"')
        assert [str(s) for s in sessions_of(experiment.groups)] == ([str(first), label] if k == 0 else [str(first)])
        assert "session" not in describe(experiment)["groups"][0]
        assert str(describe(experiment)["groups"][1]["session"]) == label
        write_experiment(experiment, tmp_path / f"again{k}")
        again = read_experiment(tmp_path / f"again{k}")
        assert again.fingerprint == experiment.fingerprint and again.groups[1].session == experiment.groups[1].session
    assert sessions_of(plain.groups) == (first, second)


@pytest.mark.parametrize(
    ("session", "what"),
    [
        ("1.5", "session '1.5' cannot be used; use an integer"),
        ('"last week"', "session 'last week' cannot be used"),
        ("true", "session 'true' cannot be used"),
    ],
)
def test_a_session_without_a_name_is_refused(tmp_path: Path, session: str, what: str) -> None:
    assert what in str(refusal(write(tmp_path / "two", TOML + f"session = {session}\n")))


def test_a_session_is_no_group_of_another_session(tmp_path: Path) -> None:
    head, _, last = TOML.rpartition("[[group]]")
    first = read_experiment(write(tmp_path / "plain")).ids[0]
    toml = f'{head}session = "monday"\n[[group]]{last}session = {first}\n'
    said = str(refusal(write(tmp_path / "two", toml)))
    assert f"session {first} is the id of a group that was measured in session monday" in said
    assert 'write session = "monday"' in said


def in_one_session(known: Experiment) -> Experiment:
    """Groups 1 and 3 were measured on monday, group 2 in a session of its own."""
    groups = (replace(known.groups[0], session="monday"), known.groups[1], replace(known.groups[2], session="monday"))
    return replace(known, groups=groups)


def test_groups_of_a_session_share_its_gain(known: Experiment) -> None:
    problem = Problem(in_one_session(known), (1, 2), terms(["reading_gain"]))
    names = ("reading_gain_spread", "reading_gain_z_monday", "reading_gain_z_2")
    assert problem.names[3:6] == names and problem.n_physical == 4 and problem.n_dim == len(problem.blocks)
    at = {name: k for k, name in enumerate(problem.names)}
    x = problem.to_physical(problem.medians)[None]
    x[:, [at[name] for name in names]] = 0.2, 1.0, -1.0
    u = problem.to_sampling(x)
    plain = Problem(known, (1, 2, 3))
    level = plain.predict(plain.to_sampling(plain.to_physical(plain.medians))[None], (1, 2, 3))
    read = problem.predict(u, (1, 2, 3), np.random.default_rng(0))
    gain = np.repeat(np.exp([0.2, -0.2, 0.2]), [g.n_points for g in known.groups])
    # Group 3 was not fitted, but its session was: nothing of it is drawn.
    assert read[0] == pytest.approx(level[0] * gain, rel=1e-9)
    found = [(group.id, group.session, float(value[0])) for _, _, group, value in by_session(problem, x)]
    assert found == [(1, "monday", pytest.approx(np.exp(0.2))), (2, None, pytest.approx(np.exp(-0.2)))]


def test_groups_of_a_session_to_come_share_what_is_drawn(known: Experiment) -> None:
    problem = Problem(in_one_session(known), (2,), terms(["reading_gain"]))
    x = np.tile(problem.to_physical(problem.medians), (6, 1))
    x[:, 3] = 0.3
    read = problem.predict(problem.to_sampling(x), (1, 3), np.random.default_rng(1))
    plain = Problem(known, (2,))
    level = plain.predict(np.tile(plain.medians, (6, 1)), (1, 3))
    gain = read / level
    assert np.ptp(gain, axis=1).max() < 1e-9 and np.ptp(gain[:, 0]) > 0.1


@pytest.mark.parametrize(
    "ids", [("reading_gain",), ("session_lean",), ("gap", "session_lean", "reading_gain")], ids=str
)
def test_the_reference_reads_sessions_as_the_simulator_does(ids: tuple[str, ...]) -> None:
    """A sweep and a trace of one session, between them a sweep of another."""
    f, v = np.geomspace(300, 5e3, 3), np.full(3, 20.0)
    moments = np.array([100.0, 400.0, 900.0])
    trace = Conditions(
        "t", "sine", "t.csv", np.full(3, 900.0), v,
        measured=np.full(3, OBSERVABLES.index(DISPLACEMENT)), time_us=moments, session="day",
    )  # fmt: skip
    groups = [Conditions(1, "sine", "1.csv", f, v, session="day"), Conditions(2, "square", "2.csv", f, v), trace]
    design, chosen, sessions = Design.of(RIG, groups), terms(ids), sessions_of(groups)
    assert design.counts == (2, 2) and design.session.tolist() == [0] * 3 + [1] * 3 + [0] * 3
    own: dict[str, tuple[float, ...]] = {"reading_gain": (0.2,), "session_lean": (3e-3, 0.4), "gap": (2e-7,)}
    row, values = TRUTH.tolist(), dict(zip(("k_c", "c_s", "c_c"), TRUTH.tolist(), strict=True))
    for term in chosen:
        given = zip((p.name for p in term.parameters), own[term.id], strict=True)
        latent = (
            {session_name(term.latent.name, s): z for s, z in zip(sessions, (0.8, -0.5), strict=True)}
            if term.latent
            else {}
        )
        values |= dict(given) | latent
        row += [*own[term.id], *latent.values()]
    fast = readings(design, row, chosen, tolerance=1e-9)[0]
    assert fast == pytest.approx(simulate_literally(design, values, chosen, Occasions.of(groups)), rel=1e-6, abs=1e-9)


def twins(known: Experiment, session: GroupId | None) -> Experiment:
    """One sweep twice, the second read a third too high."""
    first = replace(known.groups[0], session=session)
    return replace(known, groups=(first, replace(first, id=2, reading=first.reading * 4 / 3)))


def test_groups_of_one_session_are_not_compared_as_sessions(known: Experiment) -> None:
    for session, pairs in ((None, [(1, 2)]), ("monday", [])):
        problem = Problem(twins(known, session), (1, 2))
        u = problem.medians[None]
        assert [(o.first, o.second) for o in offsets(optimised(problem, u))] == pairs
        e = np.random.default_rng(0).standard_normal((1, problem.observed.size))
        found = looks(problem, e, problem.predict(u)[0], {}, MisfitSettings())
        kinds = {name for name, *_ in found}
        assert ("one condition in two sessions" in kinds) == (session is None)
        # Readings at one condition of one session are replicates, whichever group they stand in.
        assert ("conditions against their replicates" in kinds) == (session is not None)


def test_a_planned_group_of_a_measured_session_is_of_that_session(known: Experiment) -> None:
    """Where the plan holds a group of it as it was measured; a name alone may be another rig's."""
    experiment, (gain,) = in_one_session(known), terms(["reading_gain"])
    fitted, new = experiment.groups[0], replace(experiment.groups[2], id=9)
    medians = {"k_c": 1e6, "reading_gain_spread": 0.1, "reading_gain_z_monday": 1.5}
    for groups, kept in (((fitted, new), True), ((new,), False)):
        plan = Plan(RIG, tuple(_planned(g) if g is new else g for g in groups), ())
        found = of_sessions(plan, (gain,), medians, [fitted], True)
        assert ("reading_gain_z_monday" in found) == kept
        complete = completed(plan, (gain,), {"reading_gain_spread": 0.1}, {}, seed=3)
        assert [name for name in complete if "_z_" in name] == ["reading_gain_z_monday"]


def _planned(g: Group) -> Conditions:
    return Conditions(g.id, g.drive, g.file, g.frequency_hz, g.amplitude_v, session=g.session)


def test_a_session_named_by_a_group_is_called_a_session(known: Experiment) -> None:
    """Group 3 was measured with group 1, group 2 by itself."""
    groups = (*known.groups[:2], replace(known.groups[2], session=1))
    problem, (gain,) = Problem(replace(known, groups=groups), (1, 2, 3)), terms(["reading_gain"])
    assert [problem.named_for(gain, g) for g in groups] == [(1, None), (None, None), (1, None)]


def test_what_sessions_have_by_two_causes_is_drawn_for_each(known: Experiment) -> None:
    plan = Plan(RIG, known.groups, ())
    given = {"session_lean_offset": 3e-3, "reading_gain_spread": 0.1}
    drawn = completed(plan, terms(["session_lean", "reading_gain"]), given, {}, seed=3)
    assert len({value for name, value in drawn.items() if "_z_" in name}) == 6


def test_another_session_of_the_same_name_is_not_known(known: Experiment) -> None:
    """A plan that says another session of the very readings means another."""
    (first, *_), (gain,) = in_one_session(known).groups, terms(["reading_gain"])
    medians = {"reading_gain_z_monday": 1.5, "reading_gain_z_tuesday": -1.0}
    plan = Plan(RIG, (replace(first, session="tuesday"),), ())
    assert of_sessions(plan, (gain,), medians, [first], True) == {"reading_gain_z_monday": 1.5}

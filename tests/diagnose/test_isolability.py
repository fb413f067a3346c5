"""Which causes a design can distinguish, before anything is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scripts import loaded
from truths import experiment

from psafit.diagnose.isolability import ConfoundedPair, Effects, IsolabilitySettings, isolability
from psafit.diagnose.next_experiment import proposed
from psafit.diagnose.possible import proposals
from psafit.drives import Drive, Table
from psafit.experiment import Conditions, Experiment, read_as
from psafit.inference.problem import Problem
from psafit.observables import CONTACT_TIME, DISPLACEMENT, OBSERVABLES, OF_LAUNCHES, PEAK_FORCE, VELOCITY, Observable
from psafit.physics import terms
from psafit.report.figures.isolability import isolability_figure
from psafit.simulate import Design
from psafit.simulate.sensitivity import RIGS

ROOT = Path(__file__).resolve().parents[2]
FEW = terms(["amplifier_lag", "hunt_crossley", "indentation_damping"])


@pytest.fixture(scope="module")
def found():
    e = experiment()
    limits = (("frequency_hz", (200.0, 2e4)), ("amplitude_v", (2.0, 20.0)))
    return isolability("a rig", e.constants, e.groups, limits, FEW, settings=IsolabilitySettings(readings=(4,)))


def test_dampings_of_one_contact_are_confounded(found):
    nats = np.array(found.nats)
    assert found.causes == [t.id for t in FEW] and np.diag(nats) == pytest.approx(0.0)
    lag, hunt_crossley, indentation = range(3)
    assert max(nats[hunt_crossley, indentation], nats[indentation, hunt_crossley]) < 3.0 < nats[lag, indentation]
    assert all(nats[i, j] <= found.seen[i] + 1e-9 for i in range(3) for j in range(3))


def test_a_sweep_is_offered_for_causes_that_are_confounded(found):
    assert all(
        found.nats[found.causes.index(i)][found.causes.index(j)] < 3.0
        for i, near in found.taken_for.items()
        for j in near
    )
    for block in found.blocks:
        assert len(block.causes) > 1 and block.split is not None and block.split.readings == 4
        assert block.split.splits == (block.split.nats >= found.settings.apart)


def test_nats_are_half_the_least_squares_that_the_rival_leaves():
    """By ordinary least squares on all columns at once, in the place of projections one after the other."""
    e, settings = experiment(), IsolabilitySettings(imitating=(0.5,))
    raw = Effects.at(Design.of(e.constants, e.groups), np.array(RIGS["damped"]), FEW, settings)
    made = raw.rows["amplifier_lag", 0.5][0]
    columns = np.vstack([raw.slopes, raw.rows["indentation_damping", 0.5]]).T
    left = made - columns @ np.linalg.lstsq(columns, made, rcond=None)[0]
    reported = raw.refitted().against(["amplifier_lag"], ["indentation_damping"], settings)
    assert reported == pytest.approx(0.5 * left @ left, rel=1e-6)


def test_a_part_of_a_session_to_come_is_as_in_the_whole_design():
    """Of a cause by session too: what it does to the others it does to that one, at its usual value."""
    e, settings = experiment(), IsolabilitySettings()
    theta, by_session = np.array(RIGS["damped"]), terms(["session_lean", "reading_gain"])
    parts = [Effects.at(Design.of(e.constants, g), theta, by_session, settings) for g in (e.groups[:-1], e.groups[-1:])]
    whole = Effects.at(Design.of(e.constants, e.groups), theta, by_session, settings)
    joined = parts[0].with_part(parts[1], np.arange(e.groups[-1].n_points))
    for key, rows in whole.rows.items():
        assert np.allclose(joined.rows[key], rows, rtol=1e-6, atol=1e-9), key


@pytest.mark.parametrize("table", [False, True], ids=["bias", "recorded"])
def test_a_rig_keeps_its_drives(table):
    """What would split causes is a sweep of the whole drive, or the recording played again."""
    e = experiment()
    time = np.linspace(0, 2e-3, 50)
    recorded = Table(time, 10 * np.sin(2 * np.pi * 800 * time) ** 2, True)
    drive = Drive("table", table=recorded, file="record.csv") if table else Drive("sine", bias_v=10.0, idle_v=10.0)
    groups = [replace(g, drive=drive) for g in e.groups]
    pair = terms(["hunt_crossley", "indentation_damping"])
    found = isolability("a rig", e.constants, groups, (), pair, settings=IsolabilitySettings(apart=1e-3, readings=(4,)))
    splits = [b.split for b in found.blocks if b.split]
    for possible in proposals(e.constants, groups, ()):
        assert possible.design.used == (drive,)
    for split in splits:
        assert proposed(split.waveform, split.drive, groups) == drive
    assert proposed(drive.waveform, drive.settings, groups) == drive


def test_more_scatter_separates_less(found):
    e = experiment()
    wide = isolability(
        "a rig", e.constants, e.groups, (), FEW, settings=replace(found.settings, relative=0.2, absolute=1.2)
    )
    assert all(a < b for a, b in zip(wide.seen, found.seen, strict=True))


def read_of(e: Experiment, kinds: Sequence[int]) -> Experiment:
    """The same launches, of each of which these observables are read."""
    groups = []
    for g in e.groups:
        rows = np.tile(np.arange(g.n_points), len(kinds))
        groups.append(replace(g.at(rows), row=rows, measured=np.repeat(kinds, g.n_points)))
    return replace(e, groups=tuple(groups))


# Causes, the strength at which they are confounded in launch ranges, and what distinguishes them.
TIES = ((("soft_layer", "gap"), 0.07, CONTACT_TIME), (("idle_level", "indentation_damping"), 0.5, PEAK_FORCE))


@pytest.mark.parametrize(("pair", "strength", "other"), TIES, ids=lambda x: getattr(x, "name", None))
def test_another_observable_that_would_distinguish_causes_is_named(pair, strength, other):
    e = experiment(n=16)
    settings = IsolabilitySettings(strength=strength, imitating=(0.5 * strength, strength, min(2 * strength, 0.9)))
    found = isolability("a rig", e.constants, e.groups, (), terms(pair), settings=settings, places=[RIGS["study"]])
    (block,) = found.blocks
    assert set(block.causes) == set(pair) and block.also is not None
    assert (block.also.observable, block.also.splits) == (other.name, True)
    assert [set(two) for two in block.also.pairs] == [set(pair)] and block.also.nats >= settings.apart
    # What the rig's instruments do not read is not asked for.
    for column, asked in ((other.column, other.name), ("launch_range_um", None)):
        how = {"readable": (column,), "settings": settings, "places": [RIGS["study"]]}
        (block,) = isolability("a rig", e.constants, e.groups, (), terms(pair), **how).blocks
        assert (block.also and block.also.observable) == asked


def test_a_trace_that_would_distinguish_causes_is_named():
    """Where a velocity over time does more than a speed, a time or a force of every launch; with its design."""
    e, pair = experiment(n=8), ("hertz_exponent", "soft_layer")
    found = isolability("a rig", e.constants, e.groups, (), terms(pair), places=[RIGS["study"]])
    (block,) = found.blocks
    assert block.also is not None and block.also.trace is not None
    trace = block.also.trace
    assert (block.also.observable, block.also.splits) == ("velocity", True)
    assert len(trace.time_us) == found.settings.trace.samples
    assert trace.text == (
        f"a trace of the ball's velocity, {trace.waveform}, {trace.frequency_hz:g} Hz, {trace.amplitude_v:g} V,"
        f" {len(trace.time_us)} samples over {trace.time_us[-1]:g} us"
    )
    also = Conditions(
        "t", trace.waveform, "", np.full(64, trace.frequency_hz), np.full(64, trace.amplitude_v),
        time_us=np.array(trace.time_us), measured=np.full(64, OBSERVABLES.index(VELOCITY)),
    )  # fmt: skip
    whole = isolability("a rig", e.constants, [*e.groups, also], (), terms(pair), places=[RIGS["study"]])
    assert not whole.blocks and min(whole.nats[0][1], whole.nats[1][0]) == pytest.approx(block.also.nats, rel=1e-6)


def test_what_would_show_an_unseen_cause_shows_it():
    """Each cause once, by the cheapest measurement with which the design shows it; what nothing shows is left out."""
    e, causes = experiment(n=8), terms(["field_dependent_d33", "stack_stiffness", "stroke_tolerance", "swing_drag"])
    how = {"places": [RIGS["study"]]}
    found = isolability("a rig", e.constants, e.groups, (), causes, **how)
    named = [id for one in found.shown for id in one.causes]
    assert len(named) == len({*named}) and {*named} < {*found.unseen} and "swing_drag" not in named
    kinds = ["sweep" if one.sweep else "trace" if one.trace else "observable" for one in found.shown]
    assert kinds == ["sweep", "observable", "trace"]
    for one in found.shown:
        if one.sweep is not None:
            f, v = np.array(one.sweep.frequency_hz), np.array(one.sweep.amplitude_v)
            more = [*e.groups, Conditions("t", one.sweep.waveform, "", f, v)]
        elif one.trace is not None:
            n, t = len(one.trace.time_us), one.trace
            kind = next(k for k, o in enumerate(OBSERVABLES) if o.name == one.observable)
            more = [*e.groups, Conditions(
                "t", t.waveform, "", np.full(n, t.frequency_hz), np.full(n, t.amplitude_v),
                time_us=np.array(t.time_us), measured=np.full(n, kind),
            )]  # fmt: skip
        else:
            kind = next(k for k, o in enumerate(OBSERVABLES) if o.name == one.observable)
            more = read_of(e, (0, kind)).groups
        whole = isolability("a rig", e.constants, more, (), causes, **how)
        seen = [whole.seen[whole.causes.index(id)] for id in one.causes]
        assert seen == pytest.approx(one.nats, rel=1e-6) and min(seen) >= found.settings.apart
        assert not {*one.causes} & {*whole.unseen}


@pytest.mark.slow
@pytest.mark.parametrize(("pair", "strength", "other"), TIES, ids=lambda x: getattr(x, "name", None))
def test_refits_lose_by_that_observable_what_ranges_leave(pair, strength, other):
    """By least squares with the simulator itself, of the side that is harder to show."""
    ties = loaded(ROOT / "benchmarks" / "ties.py")
    e = read_of(experiment(n=16), range(len(OF_LAUNCHES)))
    sides = []
    for truth, rival in (pair, pair[::-1]):
        made = Problem(e, e.ids, terms([truth]))
        exact = made.predict(ties.start(made, RIGS["study"], strength, None)[None])[0]
        wrong = replace(made, terms=terms([rival]))
        near = [ties.start(wrong, RIGS["study"], share, None) for share in (0.2, 0.5, 0.8)]
        whole, end = ties.left(wrong, near, exact, (0, OF_LAUNCHES.index(other)), 30)
        sides.append((ties.left(wrong, [*near, end], exact, (0,), 30)[0], whole))
    (ranges, both) = map(min, zip(*sides, strict=True))
    apart = IsolabilitySettings().apart
    assert ranges < apart < 2 * apart < both


def test_a_design_of_other_readings_is_split_by_sweeps_that_read_them():
    e = read_of(experiment(n=8), [1, 2])
    pair = terms(["hunt_crossley", "indentation_damping"])
    settings = IsolabilitySettings(apart=1e-3, readings=(4,))
    found = isolability("a rig", e.constants, e.groups, (), pair, settings=settings)
    for block in found.blocks:
        assert block.split is not None and "and read" not in block.split.text
        assert block.also is None or block.also.observable in ("launch_range", "peak_force")
    only = isolability("a rig", e.constants, [g.at(g.measured == 1) for g in e.groups], (), pair, settings=settings)
    # What ranges and speeds of the same launches say is nearly the same, and times add to it.
    assert found.readings == 2 * only.readings and all(a > b for a, b in zip(found.seen, only.seen, strict=True))
    ranges = isolability("a rig", e.constants, experiment(n=8).groups, (), pair, settings=settings)
    assert only.seen == pytest.approx(ranges.seen, rel=0.3)


def traced(kind: Observable, samples: int, id: str = "t") -> Conditions:
    """A trace to come, of one launch."""
    f, v, time = np.full(samples, 1200.0), np.full(samples, 20.0), np.linspace(0.0, 950.0, samples + 1)[1:]
    return Conditions(id, "sine", f"{id}.csv", f, v, measured=np.full(samples, OBSERVABLES.index(kind)), time_us=time)


def test_samples_of_a_trace_count_as_their_covariance_says(monkeypatch):
    """By generalised least squares on readings that are not whitened, with the whole correlation matrix."""
    e, settings = experiment(n=6), IsolabilitySettings(imitating=(0.5,))
    trace, theta, pair = traced(VELOCITY, 24), np.array(RIGS["study"]), terms(["idle_level", "indentation_damping"])
    design = Design.of(e.constants, [*e.groups, trace])
    reported = Effects.at(design, theta, pair, settings).refitted().against(["idle_level"], [pair[1].id], settings)
    monkeypatch.setattr("psafit.inference.noise.whitened", lambda deviation, noise: deviation)
    raw = Effects.at(design, theta, pair, settings)
    tau = VELOCITY.scatter[3].prior_median
    assert trace.time_us is not None
    correlation = np.eye(design.n_points)
    correlation[-24:, -24:] = np.exp(-np.abs(trace.time_us[:, None] - trace.time_us) / tau)
    made, columns = raw.rows["idle_level", 0.5][0], np.vstack([raw.slopes, raw.rows[pair[1].id, 0.5]]).T
    inverse = np.linalg.inv(correlation)
    left = made - columns @ np.linalg.lstsq(columns.T @ inverse @ columns, columns.T @ inverse @ made, rcond=None)[0]
    assert reported == pytest.approx(0.5 * left @ inverse @ left, rel=1e-4)


def test_more_samples_of_one_motion_say_little_more():
    """Of a displacement sampled more often than its errors change; independent ones would say four times as much."""
    e, settings, pair = experiment(n=6), IsolabilitySettings(), terms(["preload", "soft_layer"])
    said = []
    for n in (64, 256):
        design = Design.of(e.constants, [*e.groups, traced(DISPLACEMENT, n)])
        effects = Effects.at(design, np.array(RIGS["study"]), pair, settings).refitted()
        said.append(effects.against(["preload"], ["soft_layer"], settings))
    assert said[0] <= said[1] < 1.2 * said[0]


@pytest.mark.slow
def test_refits_lose_by_a_trace_what_is_said_of_it():
    """By least squares with the simulator itself: ranges leave a tie, and a velocity over time breaks it."""
    ties = loaded(ROOT / "benchmarks" / "ties.py")
    e, pair, settings = experiment(n=16), ("idle_level", "indentation_damping"), IsolabilitySettings()
    groups = (*e.groups, traced(VELOCITY, 48))
    both = replace(e, groups=read_as(groups, np.ones(sum(g.n_points for g in groups))))
    linear = Effects.at(Design.of(e.constants, groups), np.array(RIGS["study"]), terms(pair), settings).refitted()
    ranges, refitted, reported = [], [], []
    for truth, rival in (pair, pair[::-1]):
        made, wrong = (Problem(both, both.ids, terms([id])) for id in (truth, rival))
        exact = made.predict(ties.start(made, RIGS["study"], settings.strength, None)[None])[0]
        near = [ties.start(wrong, RIGS["study"], share, None) for share in settings.imitating]
        whole, end = ties.left(wrong, near, exact, (0, OBSERVABLES.index(VELOCITY)), 30)
        ranges.append(ties.left(wrong, [*near, end], exact, (0,), 30)[0])
        refitted.append(whole)
        reported.append(linear.against([truth], [rival], settings))
    assert min(ranges) < settings.apart < 2 * settings.apart < min(refitted)
    assert np.allclose(np.log(refitted), np.log(reported), atol=np.log(2))


def test_pairs_that_look_like_one_cause_are_drawn_on_their_side(found):
    lag, hunt, damping = found.causes
    with_pairs = replace(found, unseen=[], blocks=[], pairs=[
        ConfoundedPair([hunt, damping], [lag], 0.7), ConfoundedPair([lag], [damping, hunt], 1.4),
        ConfoundedPair([hunt, damping], [lag], 2.9),
    ])  # fmt: skip
    first, second, _ = isolability_figure(with_pairs).axes
    assert {t.get_text(): t.get_position() for t in second.texts} == {"0.7": (2, 1), "1.4": (1, 2)}
    assert len(isolability_figure(replace(with_pairs, pairs=[])).axes) == 2 and first.get_ylabel()


def test_what_is_known_of_the_scatter_is_what_a_plan_counts_by():
    design = Design.of(experiment().constants, (*experiment().groups, traced(VELOCITY, 4)))
    known = {"sigma_rel": 0.01, "sigma_abs_velocity": 0.7}
    usual, stated = IsolabilitySettings().scatter(design)[0], IsolabilitySettings(stated=known).scatter(design)[0]
    assert np.unique(stated[0, ~design.traced]) == pytest.approx([0.01])
    assert np.unique(stated[1, design.traced]) == pytest.approx([0.7])
    assert np.array_equal(stated[1, ~design.traced], usual[1, ~design.traced])
    assert np.array_equal(stated[2:], usual[2:], equal_nan=True)

"""Growth, corners and drift."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnoses_by_hand import make_record
from fits_by_hand import make_run, mixed_groups
from rigs import RIG
from truths import experiment, problem

from psafit.diagnose import show
from psafit.diagnose.show import corners, drift, growth, offsets
from psafit.experiment import Group, by_part, fingerprint
from psafit.inference.candidate import candidate_at, fit
from psafit.report.diagnosis.shown import shown_groups
from psafit.simulate import Design, simulate


def test_sessions_are_compared_where_they_share_a_condition(sound):
    """Two sessions of one sweep, the second read a third too high; a third group shares nothing with them."""
    few = experiment(n=8)
    first, other = few.groups[0], few.groups[1]
    twice = replace(first, id="again", reading=first.reading * 1.33)
    groups = (first, twice, other)
    one = fit(problem(replace(few, groups=groups, fingerprint=fingerprint(RIG, groups))), (), seed=1)
    (found,) = offsets(one)
    assert (found.first, found.second, found.n_conditions) == ("a", "again", 8)
    assert found.factor == pytest.approx(1.33, rel=1e-3) and 1 < found.lower < 1.33 < found.upper
    assert offsets(sound) == []
    # Contact times of the same launches are compared by themselves.
    both = [
        replace(g.at(np.r_[0:8, 0:8]), id=g.id, measured=np.repeat([0, 2], 8).astype(np.int8), reading=readings)
        for g, readings in (
            (first, np.r_[first.reading, np.full(8, 90.0)]),
            (twice, np.r_[twice.reading, np.full(8, 91.0)]),
        )
    ]
    mixed = fit(
        problem(replace(few, groups=tuple(both), fingerprint=fingerprint(RIG, both))), (), seed=1, draws=64, most=2
    )
    found, times = offsets(mixed)
    assert found.factor == pytest.approx(1.33, rel=1e-3) and found.observable is None
    assert times.factor == pytest.approx(91 / 90, rel=1e-3) and times.observable == "contact_time"
    # The time that a reading was taken is only known where sweeps went to and fro.
    assert "order" not in {d.variable for d in drift(one)}
    rng = np.random.default_rng(0)
    shuffled = []
    for g in few.groups:
        rows = rng.permutation(g.n_points)
        y = g.reading[rows] * np.linspace(0.6, 1.6, g.n_points)  # the rig warms up
        shuffled.append(Group(g.id, g.waveform, g.file, g.frequency_hz[rows], g.amplitude_v[rows], y))
    warm = fit(problem(replace(few, groups=tuple(shuffled), fingerprint=fingerprint(RIG, shuffled))), (), seed=1)
    assert drift(warm)[0].variable == "order"


def test_curves_hold_what_is_simulated_between_readings(hidden):
    """At the readings what was fitted; between them what the simulator says there, with each cause and without."""
    best_model = hidden.best_model
    (cause,) = best_model.terms
    start = 0
    for g, line in zip(best_model.problem.experiment.groups, show.lines(best_model), strict=True):
        x, part = (g.frequency_hz if g.varied == ("frequency",) else g.amplitude_v), slice(start, start + g.n_points)
        start = part.stop
        assert line.group == g.id and len(line.at) > 2 * g.n_points
        assert np.interp(x, line.at, line.value) == pytest.approx(best_model.predicted[part], rel=1e-9)
        between = simulate(
            Design.of(best_model.problem.experiment.constants, [g.filled()]),
            best_model.values[None, :4],
            best_model.terms,
        )
        assert line.value == pytest.approx(between.launch_range[0] * 1e6, rel=1e-9)
        assert line.without.keys() == {cause.id} and line.without[cause.id] != line.value


def test_growth_is_that_of_the_data(sound):
    found = {g.group: g for g in growth(sound)}
    assert found["b"].variable == "amplitude"
    # The baseline is linear: ranges grow in proportion to the voltage.
    assert found["b"].simulated == pytest.approx(np.ones(len(found["b"].at)), abs=0.02)
    inside = [lo <= 1 <= up for lo, up in zip(found["b"].lower, found["b"].upper, strict=True)]
    assert np.mean(inside) > 0.6


def test_corners_are_where_growth_changes(sound):
    """A right model has its readings' corners, and no sweep in proportion to the voltage has one."""
    for c in corners(sound):
        assert c.variable == "frequency"
        assert c.lower < c.simulated < c.upper
        assert c.exponents == pytest.approx(c.simulated_exponents, abs=0.15)
    assert {c.group for c in corners(sound)} == {"a", "c"}

    def bent(name, y):
        f = np.geomspace(500, 20000, y.size)
        return y * np.minimum(1.0, (f / 4000) ** 1.5) if name == "a" else y

    one = fit(problem(experiment(spoil=bent, n=60)), (), seed=1, draws=512, most=8)
    found = {c.group: c for c in corners(one)}["a"]
    assert found.simulated is None or not found.lower < found.simulated < found.upper
    assert found.exponents[0] - found.exponents[1] > 1.5


def test_drift_is_along_the_covariate_that_is_wrong():
    def steeper(name, y):
        return y * (np.linspace(3, 20, y.size) / 10) ** 0.8 if name == "b" else y

    one = fit(problem(experiment(spoil=steeper)), (), seed=1, draws=512, most=8)
    assert drift(one)[0].variable in ("amplitude", "range")
    assert drift(one)[0].gain > 10


def test_each_observable_has_a_curve_between_its_readings(tmp_path: Path) -> None:
    run = make_run(tmp_path, mixed_groups(), (1, "trace", 2))
    experiment, candidate = run.problem.experiment, candidate_at(run.problem, run.problem.to_sampling(run.best)[None])
    found = show.lines(candidate)
    parts = [part for g in experiment.groups for part in g.parts]
    assert [line.of for line in found] == [(str(p.id), p.observable.name) for p in parts]
    for p, fitted, line in zip(parts, by_part(experiment.groups, candidate.predicted), found, strict=True):
        assert (line.observable is None) == (p.observable.name == "launch_range")
        assert np.interp(p.along, line.at, line.value) == pytest.approx(fitted, rel=1e-9)
    record = make_record(experiment)
    shows = {name: replace(model, predicted=candidate.predicted.tolist(), without={}, lines=found)
             for name, model in record.show.items()}  # fmt: skip
    for shown, line in zip(shown_groups(replace(record, show=shows), experiment, tmp_path), found, strict=True):
        for curve in shown.curves:
            assert curve.line is not None and curve.line[1].tolist() == line.value

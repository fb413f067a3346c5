"""Where causes begin that come to a fitted model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from psafit.experiment import read_experiment
from psafit.inference.candidate import fit, optimised
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.inference.scan import ScanSettings, _Nodes, halved, widened
from psafit.inference.starts import joined_values
from psafit.physics import terms

EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "psa")


@pytest.fixture(scope="module")
def problem():
    return Problem(EXPERIMENT, (EXPERIMENT.group(1).id,))


def test_a_strength_is_halved_from_each_bound_that_is_not_neutral():
    lag, phase, stroke = (terms([id])[0].strength for id in ("amplifier_lag", "start_phase", "stroke_tolerance"))
    assert lag.to_physical(halved(lag, np.arange(3))).tolist() == [[0.01, 0.005, 0.0025]]
    assert phase.to_physical(halved(phase, np.arange(2))) == pytest.approx(np.pi * np.array([[-1, -0.5], [1, 0.5]]))
    assert stroke.to_physical(halved(stroke, np.array([0, 40]))) == pytest.approx(np.array([[0.2, 1], [3, 1]]))


@pytest.mark.parametrize("newtons", [3e-6, 1e-4, 0.03, 0.3])
def test_a_scan_finds_strengths_of_any_size(problem, newtons):
    """Between a thousandth of the prior's width and a hundred of them: what no quantiles of the prior cover."""
    larger = replace(problem, terms=terms(["adhesion"]))
    truth = np.array([5e5, 800.0, 40.0, newtons])
    u = np.append(
        np.array([p.to_sampling(x) for p, x in zip(larger.parameters, truth, strict=False)]), [-6.0, -6.0, 3.0]
    )
    known = u.copy()
    known[3] = 0.0
    read = np.zeros(sum(g.n_points for g in larger.experiment.groups))
    read[: larger.observed.size] = larger.predict(u[None])[0]
    measured = replace(larger, experiment=larger.experiment.with_readings(read))
    assert measured.observed == pytest.approx(larger.predict(u[None])[0])
    # The least of them promises 1e-6 nats.
    rows = widened(measured, known, larger.terms, settings=ScanSettings(least=1e-9))
    assert rows[0] == pytest.approx(known)
    nearest = np.abs(np.log2(larger.to_physical(rows)[1:, 3] / newtons)).min()
    assert nearest <= 1.0
    assert len(rows) <= 3 + 2 * ScanSettings().starts


def test_a_scan_of_what_moves_nothing_by_itself_stays_small(problem):
    """A gain's strength moves no reading while all sessions are at their mean."""
    larger = replace(problem, terms=terms(["reading_gain"]))
    known = larger.prior_transform(np.full(larger.n_dim, 0.5))
    rows = widened(larger, known, larger.terms)
    assert rows[0] == pytest.approx(known)
    assert rows[2, larger.names.index(larger.terms[0].strength.name)] > 0.01
    assert len(rows) == 3


@pytest.mark.parametrize("frequency", [700.0, 2300.0])
def test_a_scan_finds_a_narrow_resonance_that_fits_worse_until_all_else_is_refitted(problem, frequency):
    larger = replace(problem, terms=terms(["frame_compliance"]))
    true = {"k_c": 4e6, "c_s": 60.0, "c_c": 700.0}
    true |= {"frame_compliance": 2.5e-7, "frame_frequency": frequency, "frame_damping": 0.03}
    at_truth = joined_values(larger, true | {"sigma_rel": 0.04, "sigma_abs": 0.1})
    read = np.zeros(sum(g.n_points for g in larger.experiment.groups))
    read[: larger.observed.size] = larger.predict(at_truth[None])[0]
    measured = replace(larger, experiment=larger.experiment.with_readings(read))
    plain = replace(measured, terms=())
    begin = joined_values(plain, {name: 1.5 * value for name, value in true.items()})
    best = maximise(plain, begin[None])
    known = joined_values(measured, dict(zip(plain.names, plain.to_physical(best.u[best.best]), strict=True)))
    rows = widened(measured, known, larger.terms)
    end = maximise(measured, rows[3:], schedule=((30, 1),))
    found = dict(zip(measured.names, measured.to_physical(end.u[0]), strict=True))
    assert found["frame_frequency"] == pytest.approx(frequency, rel=0.02)
    assert found["frame_compliance"] == pytest.approx(true["frame_compliance"], rel=0.3)


@pytest.mark.parametrize(("k_c", "c_s", "c_c", "periods"), [(8.55e6, 3630.0, 5.0, 1.198), (5e6, 900.0, 60.0, 1.27)])
def test_a_fit_finds_a_threshold_between_two_strengths(k_c, c_s, c_c, periods):
    """A few hundredths of a period are right; a little less does nothing, a little more far too much."""
    larger = Problem(EXPERIMENT, EXPERIMENT.ids, terms=terms(["repeat_impacts"]))
    true = {"k_c": k_c, "c_s": c_s, "c_c": c_c, "repeat_cycles": periods, "sigma_rel": 0.05, "sigma_abs": 0.1}
    at_truth = joined_values(larger, true)
    exact = larger.predict(at_truth[None])[0]
    read = exact * (1 + 0.05 * np.random.default_rng(1).standard_normal(exact.size))
    measured = replace(larger, experiment=larger.experiment.with_readings(read))
    plain = replace(measured, terms=())
    known = optimised(plain, joined_values(plain, true)[None])
    truth = optimised(measured, at_truth[None])
    assert truth.log_posterior > known.log_posterior + 20
    found = fit(measured, [known], seed=1, draws=64, most=4, fresh=False)
    assert found.log_posterior > truth.log_posterior - 1


def test_strengths_between_two_are_tried_where_the_change_grows_unevenly():
    """A change that is too little below a strength, too much above another, and right in a hundredth of the way."""
    s, wanted = ScanSettings(edges=0), np.ones(50)
    line, strength = np.zeros(4, int), np.array([0.1, 1.0, 3.0, 6.0])

    def effect(x):
        return np.where(x < 2.0, 0.0, np.where(x < 2.02, 1.0, 9.0))[:, None] * wanted

    def value(x):
        return np.full(x.size, -np.inf)

    scanned, bounds = np.ones(4, bool), np.array([0.0, 100.0])
    for n in range(12):
        nodes = _Nodes(0.0, strength, line, scanned, effect(strength), value(strength))
        of, at = nodes.between(wanted, bounds, s)
        assert (np.abs(at - 2.0) < 1.1).all() and (n == 0 or at.size == 1)
        strength, line = np.append(strength, at), np.append(line, line[of])
        scanned = np.append(scanned, np.zeros(at.size, bool))
        if (effect(strength)[:, 0] == 1.0).any():
            break
    assert 2 < n < 9
    nodes = _Nodes(0.0, strength, line, scanned, effect(strength), value(strength))
    assert nodes.between(wanted, bounds, s)[0].size == 0, "what is right leaves nothing to be tried"


def test_each_line_is_tried_where_its_change_would_be_best_and_not_beyond_a_bound():
    """Lines begin at the neutral strength, and may go on beyond the last; one that was tried there is halved."""
    s, wanted, two = ScanSettings(edges=0), np.ones(50), np.array([1.0, 2.0])
    effect, nothing = np.array([[0.25], [4.0]]) * wanted, np.full(2, -np.inf)
    for tried, end, expected in (
        (False, 100.0, [(0, 4.0), (1, 0.5)]),
        (False, 3.0, [(0, 3.0), (1, 0.5)]),
        (True, 3.0, [(0, 3.0), (1, 1.0)]),
    ):
        nodes = _Nodes(0.0, two, np.arange(2), np.array([True, not tried]), effect, nothing)
        of, at = nodes.between(wanted, np.array([0.0, end]), s)
        assert sorted(zip(of.tolist(), at.tolist(), strict=True)) == expected


def test_what_is_known_stays_where_it_is_and_what_is_new_begins_off_its_neutral_value_too(problem):
    """A posterior may be narrower than any distance from a bound."""
    rig = replace(problem, terms=terms(["sliding_support", "adhesion"]))
    known = {"k_c": 2e5, "c_s": 3e3, "c_c": 50.0, "sliding_support_a": 0.0}
    begun = widened(rig, joined_values(rig, known), terms(["adhesion"]))
    held, strength = (rig.names.index(name) for name in ("sliding_support_a", terms(["adhesion"])[0].strength.name))
    assert (begun[:2, held] == rig.bounds[held, 0]).all()
    assert begun[0, strength] == rig.bounds[strength, 0] and begun[1, strength] == rig.bounds[strength, 0] + 1e-3

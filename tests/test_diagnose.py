"""The diagnosis and its parts, on experiments of which the truth is known."""

from __future__ import annotations

import csv
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from psafit.challenge.hide import make
from psafit.diagnose import diagnose, diagnosis, ladder, next_experiment, pruning, show
from psafit.diagnose import search as rungs
from psafit.diagnose.confusable import confusable
from psafit.diagnose.gain import over_groups, split, summarise, worse
from psafit.diagnose.ladder import SIZE_WEIGHTS, log_prior
from psafit.diagnose.leftover import Leftover, _Expansion, leftover, stretch
from psafit.diagnose.memory import Memory
from psafit.diagnose.misfit import ALPHA, Statistic, _character, examine
from psafit.diagnose.next_experiment import determine, proposals, tell_apart
from psafit.diagnose.pruning import prune
from psafit.diagnose.record import NEAREST, UNSEEN
from psafit.diagnose.rehearsal import rehearse, repeat
from psafit.diagnose.robustness import Robustness, robustness
from psafit.diagnose.screening import PRESENT, VISIBLE, _luck, _unclear, _with_neutral, screen
from psafit.diagnose.search import climb
from psafit.diagnose.show import corners, drift, growth, offsets
from psafit.diagnose.significance import lead, significance
from psafit.diagnose.told import _cause, _word, sentences
from psafit.diagnose.verdict import conclude
from psafit.errors import ConvergenceError, InputError
from psafit.experiment import Constants, Experiment, Group, fingerprint, read_experiment
from psafit.inference import ascent, noise
from psafit.inference.ascent import Ascent, ascend
from psafit.inference.candidate import _across_steps, built_up, fit, hills, scouted, settle, settle_at, thinned
from psafit.inference.emcee_adaptor import Settings
from psafit.inference.evidence import Emulated, _drawn_inside, _laplace_mixture, _Mixture, _Pool, _sample, weigh
from psafit.inference.evolution import evolved
from psafit.inference.nested import nested_evidence, require
from psafit.inference.optimise import widened
from psafit.inference.problem import Problem
from psafit.inference.run import Silent, load
from psafit.inference.run import fit as run_fit
from psafit.inference.store import pareto_k
from psafit.parameters import Belief, Normal
from psafit.physics import TERMS, informed, terms
from psafit.simulate import MICRO, Design, simulate

RIG = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
TRUTH = [1.5e6, 3e3, 60.0]
# Causes with a closed form: cheap, and of different kinds.
FEW = terms(["amplifier_lag", "stack_stiffness", "flight_friction", "reading_offset"])


def experiment(ids=(), values=(), *, seed=0, n=24, spoil=None, relative=0.04, groups=("a", "b", "c")) -> Experiment:
    """Three sweeps of a rig whose truth is the baseline with some causes, and scatter."""
    rng = np.random.default_rng(seed)
    plan = [
        ("sine", np.geomspace(200, 2e4, n), np.full(n, 20.0)),
        ("sine", np.full(n, 1200.0), np.linspace(3, 20, n)),
        ("square", np.geomspace(200, 2e4, n), np.full(n, 12.0)),
    ][: len(groups)]
    made = []
    for name, (waveform, f, v) in zip(groups, plan, strict=True):
        design = Design.sweep(RIG, waveform, f, v)
        true = simulate(design, [*TRUTH, *values], terms(ids)).launch_range[0] * MICRO
        y = true * (1 + relative * rng.standard_normal(n)) + 0.05 * rng.standard_normal(n)
        if spoil:
            y = spoil(name, y)
        made.append(Group(name, waveform, f"{name}.csv", f, v, np.maximum(y, 0.0).round(3)))
    return Experiment("a rig", "a test", RIG, tuple(made), Path(), fingerprint(RIG, tuple(made)))


def problem(e: Experiment, groups=None) -> Problem:
    return Problem(e, groups or e.ids)


@pytest.fixture(scope="module")
def sound():
    return fit(problem(experiment()), (), seed=1, draws=512, most=8)


# --- evidence -------------------------------------------------------------------------------------------------------


def test_evidence_is_that_of_plain_monte_carlo():
    """Few, poor readings leave the prior wide enough for the mean likelihood of its draws to be the evidence."""
    e = experiment(n=4, relative=0.3, groups=("a",))
    one = problem(e)
    found = weigh(fit(one, (), seed=1, draws=256, most=8), seed=1, effective=400)
    draws = one.prior_transform(np.random.default_rng(0).uniform(size=(200_000, one.n_dim)))
    likelihood = one.log_likelihood(draws)
    plain = logsumexp(likelihood) - math.log(len(draws))
    error = math.sqrt(np.exp(logsumexp(2 * likelihood) - 2 * logsumexp(likelihood)))
    assert found.log_evidence == pytest.approx(plain, abs=4 * math.hypot(error, found.error))
    assert error < 0.06 and found.error < 0.1
    mean = found.weights @ found.draws
    weights = np.exp(likelihood - logsumexp(likelihood))
    other = weights @ draws
    spread = np.sqrt(weights @ (draws - other) ** 2)
    assert (np.abs(mean - other) < 6 * math.hypot(error, found.error) * spread).all()
    assert (np.abs(draws.mean(axis=0) - other) > 0.5 * spread).any()  # not the prior's


@pytest.mark.parametrize("place", [2.2, 2.4, 2.5, 4.9])
def test_evidence_knows_of_a_plateau_wherever_the_climb_ended(place):
    """Above 2.4 periods no reading knows how long the drive lasts, from 2.3 downwards many do."""
    e = experiment(["repeat_impacts"], [3.4])
    one = replace(problem(e), terms=terms(["repeat_impacts"]))
    fitted = fit(one, [fit(problem(e), (), seed=1)], seed=1)
    k = one.names.index("repeat_cycles")
    scale = one.parameters[k].scale
    u = fitted.modes[:1].copy()
    u[0, k] = place / scale
    found = weigh(settle(one, Ascent(u, one.log_posterior(u), one.predict(u), 0)), seed=1)
    # Of the other parameters all places above agree, so that a line tells the share of each.
    line = np.repeat(fitted.modes[:1], 501, axis=0)
    line[:, k] = np.linspace(0, 5, 501) / scale
    height = one.log_posterior(line)
    mass = np.exp(height - height.max())
    expected = np.interp([0.05, 0.5, 0.95], np.cumsum(mass) / mass.sum(), np.linspace(0, 5, 501))
    assert found.quantiles(found.draws[:, k] * scale, [0.05, 0.5, 0.95]) == pytest.approx(expected, abs=0.2)
    assert found.effective > 300
    assert found.log_evidence == pytest.approx(weigh(fitted, seed=2).log_evidence, abs=0.2)


def test_evidence_is_that_of_a_nested_sampler(sound):
    """Two ways that share but the simulator: climbs, emulator and weights; and shells from the prior inwards."""
    pytest.importorskip("nautilus")
    ours = weigh(sound, seed=1)
    theirs = nested_evidence(sound.problem, seed=1, n_live=150, effective=150)
    assert ours.log_evidence == pytest.approx(theirs.log_evidence, abs=0.5)


@pytest.mark.filterwarnings("error")
def test_one_draw_far_above_all_others_is_no_width(sound):
    """A first round that misses a narrow posterior but once: the emulator must still say something of other places."""
    mixture, random = _laplace_mixture(sound), np.random.default_rng(0)
    u = np.vstack([sound.modes[:1], mixture.draw(256, random).clip(*sound.problem.bounds.T)])
    height = np.where(np.arange(len(u)) == 0, 0.0, -1e6)
    found = Emulated(sound, _Pool(u, height, height, len(u)), sound.problem.predict(u), mixture, random)
    draws = found.draw(64, random)
    assert np.isfinite(found.log_density(draws)).sum() > 32
    assert np.ptp(draws, axis=0).min() > 0


def test_evidence_of_a_corner():
    """A mode at the bounds of eight parameters: of draws around it one in three hundred lies inside."""
    rate = np.linspace(2, 5, 8)
    bounds, width = np.repeat([[0.0, 1.0]], rate.size, axis=0), np.ones(rate.size)
    first = _Mixture.of([(np.zeros(rate.size), 0.3**2 * np.eye(rate.size), 1.0)])

    def height(u):
        return np.sum(np.log(rate) - rate * u, axis=1)

    def adapted(found, last):
        return last.mixture.around(found, width)

    assert (first.draw(256, np.random.default_rng(3)).min(axis=1) > 0).sum() < 4
    found = _sample(height, bounds, first, adapted, np.random.default_rng(3), 256, 12, 1e9).weighed()
    assert found.log_evidence == pytest.approx(np.log1p(-np.exp(-rate)).sum(), abs=0.5)
    assert found.effective > 60
    with pytest.raises(ConvergenceError, match="within the bounds"):
        _drawn_inside(first, bounds + 100.0, 256, np.random.default_rng(0))


def test_nautilus_is_asked_for_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "nautilus", None)
    with pytest.raises(InputError, match="pip install nautilus-sampler"):
        require()


def test_pareto_k_is_that_of_the_weights():
    """Of weights with a Pareto law of index 2 it is one half; of their inverses, which are bounded, below zero."""
    log_weights = np.random.default_rng(1).exponential(0.5, 4000)
    assert pareto_k(log_weights) == pytest.approx(0.5, abs=0.15)
    assert pareto_k(-log_weights) < 0


def test_resampling_keeps_the_weighted_mean(sound):
    found = weigh(sound, seed=1)
    assert found.effective > 100
    assert found.pareto_k < 0.7
    assert found.resampled(2000).mean(axis=0) == pytest.approx(found.weights @ found.draws, abs=0.02)


# --- tests of misfit ------------------------------------------------------------------------------------------------


def test_a_sound_model_is_not_accused(sound):
    found = examine(sound, FEW, seed=1, n_simulated=199)
    assert found.p_value > 0.05
    assert not found.wrong
    assert found.character == "none"
    assert found.places == ()
    assert leftover(sound).log_bayes < 0


def test_the_level_is_kept():
    """Of ten sound data sets at most three are accused at 5 % (four would come once in a thousand)."""
    p = [
        examine(fit(problem(experiment(seed=s)), (), seed=1, draws=256, most=6), FEW, seed=s, n_simulated=99).p_value
        for s in range(100, 110)
    ]
    assert np.sum(np.array(p) <= 0.05) <= 3
    assert 0.25 < np.mean(p) < 0.8


def bump(name, y):
    """A resonance that no cause describes, in one stretch of one sweep."""
    return y * (1 + 0.8 * np.exp(-(((np.arange(y.size) - 15) / 2.0) ** 2))) if name == "a" else y


def unit(name, y):
    return 2.0 * y if name == "c" else y


def slip(name, y):
    """One misplaced decimal point."""
    z = y.copy()
    z[7] *= 10.0 if name == "b" else 1.0
    return z


@pytest.mark.parametrize(
    ("spoil", "characters", "group"),
    [(bump, {"physics", "group"}, "a"), (unit, {"physics", "group"}, "c"), (slip, {"points"}, "b")],
)
def test_what_is_spoilt_is_found_where_it_is(spoil, characters, group):
    one = fit(problem(experiment(spoil=spoil, seed=3)), (), seed=1, draws=512, most=8)
    found = examine(one, FEW, seed=1, n_simulated=199)
    assert found.p_value < ALPHA
    assert found.character in characters
    if spoil is slip:
        assert found.odd_points == (("b", 7),)
        return
    if found.character == "group":
        assert found.odd_groups == (group,)
    assert group in {p.group for p in found.places}
    assert leftover(one).log_bayes > 3


@pytest.mark.parametrize(
    ("kinds", "odd", "character"),
    [
        (["spread"], (), "scatter"),
        (["point"], (("b", 7),), "points"),
        (["point", "spread"], (("b", 7),), "points"),
        (["point", "spread"], (("b", 1), ("b", 2), ("b", 3), ("b", 4)), "scatter"),
        (["replicate"], (), "sessions"),
        (["replicate", "mean"], (), "physics"),
    ],
)
def test_the_kind_of_what_is_wrong_is_that_of_what_stands_out(sound, kinds, odd, character):
    beyond = [Statistic(kind, kind, None, 9.0, 3.0, 0.001, True) for kind in kinds]
    within = Statistic("mean", "mean", None, 1.0, 0.5, 0.3, False)
    assert _character(sound, FEW, [*beyond, within], 1, False, odd) == (character, ())


def test_a_few_readings_do_not_clear_the_rest():
    """One sweep that errs and two single readings: what finds nothing wrong without the sweep could find nothing."""
    e = experiment(spoil=bump, seed=3)
    columns = ("frequency_hz", "amplitude_v", "launch_range_um")
    short = [replace(g, **{name: getattr(g, name)[:2] for name in columns}) for g in e.groups[1:]]
    groups = (e.groups[0], *short)
    few = replace(e, groups=groups, fingerprint=fingerprint(RIG, groups))
    found = examine(fit(problem(few), (), seed=1, draws=512, most=8), FEW, seed=1, n_simulated=199)
    assert found.wrong and found.character == "physics"


def test_a_reading_without_a_drive_does_not_turn_a_sweep_round():
    """A control at 0 V, of which nothing is launched."""
    e = experiment(spoil=bump, seed=3, groups=("a",))
    (g,) = e.groups
    extra = {"frequency_hz": 1000.0, "amplitude_v": 0.0, "launch_range_um": 0.0}
    more = replace(g, **{name: np.append(getattr(g, name), x) for name, x in extra.items()})
    assert more.swept == g.swept == "frequency"
    design = Design.of(RIG, [more])
    assert np.ptp(design.along("amplitude")) == 0.0
    assert np.exp(design.along("frequency")) == pytest.approx(design.frequency)
    assert np.isfinite(Design.sweep(RIG, "sine", 1e3, 0.0).along("amplitude")).all()
    found = [fit(Problem(replace(e, groups=(one,)), ("a",)), (), seed=1, draws=512, most=8) for one in (g, more)]
    a, b = (leftover(one).log_bayes for one in found)
    assert a > 3 and b == pytest.approx(a, abs=2)


def test_an_unnamed_discrepancy_is_that_of_dense_matrices(sound):
    """By groups and with the parameters as least squares, against the readings' covariance as it is written."""
    around = _Expansion.of(sound, 1 + 0.1 * np.arange(sound.problem.observed.size))
    group = sound.problem.design.group
    x = sound.problem.design.along("frequency").copy()
    x[group == 1] = sound.problem.design.along("amplitude")[group == 1]
    rng = np.random.default_rng(1)
    for _ in range(5):
        v = np.r_[rng.normal(-3, 1, 2), rng.normal(-1.5, 1, 2), rng.normal(-0.3, 0.5)]
        relative, absolute = around.scatter_at(v)
        a, b, reach = np.exp(v[2:])
        p = around.predicted
        noise = np.diag(around.stretch * ((relative * p) ** 2 + absolute**2))
        smooth = a**2 * np.exp(-0.5 * (x[:, None] - x) ** 2 / reach**2) + b**2
        kernel = np.where(group[:, None] == group, smooth, 0.0) * np.outer(p, p)
        whole = noise + kernel + around.free @ around.free.T
        found = around.whitened(v)
        assert found.squares == pytest.approx(around.residual @ np.linalg.solve(whole, around.residual), rel=1e-6)
        assert 2 * found.log_size == pytest.approx(np.linalg.slogdet(whole)[1], abs=1e-6)
        mean, variance = around.discrepancy(v)
        assert mean == pytest.approx(kernel @ np.linalg.solve(whole, around.residual), rel=1e-5, abs=1e-7 * p.max())
        left = np.diag(kernel - kernel @ np.linalg.solve(whole, kernel))
        assert variance == pytest.approx(left, rel=1e-4, abs=1e-8 * np.diag(kernel).max())


@pytest.mark.parametrize("ids", [(), ("flight_friction",)])
def test_the_best_hill_of_an_unnamed_discrepancy_is_found(ids):
    """Its scatter may be most of the misfit or hardly any: climbs from many random places find none higher."""
    one = replace(problem(experiment(["hysteresis"], [0.5, 20.0], relative=0.03, seed=4)), terms=terms(ids))
    candidate = fit(one, [fit(problem(one.experiment), (), seed=1)] if ids else (), seed=1)
    found = leftover(candidate)
    around = _Expansion.of(candidate, stretch(candidate))
    rng = np.random.default_rng(2)
    ends = [
        around.fitted(np.r_[rng.uniform(-6, 0, 2), rng.uniform(-4, 0.7, 2), rng.normal(-0.3, 0.6)], with_it=True)
        for _ in range(24)
    ]
    assert found.log_evidence > max(end.log_evidence for end in ends) + around.placed - 0.1


def test_causes_that_look_alike():
    """A cause and its double under another name do the same; a lag does something else."""
    e = experiment(["flight_friction"], [0.1], relative=0.02)
    (friction,) = terms(["flight_friction"])
    double = replace(friction, id="double", parameters=(replace(friction.strength, name="double_a"),))
    model = fit(replace(problem(e), terms=(friction,)), [fit(problem(e), (), seed=1)], seed=1)
    found = confusable(model, (*terms(["amplifier_lag", "reading_gain"]), friction, double))
    assert [(a.cause, a.other) for a in found] == [("flight_friction", "double")] and 0 <= found[0].degrees < 2
    assert confusable(fit(problem(e), (), seed=1), TERMS) == []


def test_sessions_that_disagree_are_seen():
    """One condition in two sessions, of which one reads a third more."""
    e = experiment(relative=0.01)
    twin = replace(e.groups[0], id="d", launch_range_um=(1.3 * e.groups[0].launch_range_um).round(3))
    groups = (e.groups[0], twin)
    e = replace(e, groups=groups, fingerprint=fingerprint(RIG, groups))
    found = examine(fit(problem(e), (), seed=1, draws=512, most=8), FEW, seed=1, n_simulated=99)
    assert found.wrong
    assert any(s.significant and s.name == "one condition in two sessions" for s in found.statistics)


@pytest.mark.parametrize(("jitter", "wrong"), [(0.0, False), (0.1, True)])
def test_replicates_are_pure_error(jitter, wrong):
    """Conditions off by a tenth without any order look like scatter, unless replicates agree to one per cent."""
    rng = np.random.default_rng(2)
    few = experiment(n=12, relative=1e-4)
    groups = []
    for g in few.groups:
        y = g.launch_range_um * np.exp(jitter * rng.standard_normal(g.n_points))
        rows = np.concatenate([np.arange(g.n_points), [1, 6, 10]])  # three conditions of a sweep are measured twice
        y = y[rows] * (1 + 0.01 * rng.standard_normal(rows.size))
        groups.append(Group(g.id, g.waveform, g.file, g.frequency_hz[rows], g.amplitude_v[rows], y.round(3)))
    e = replace(few, groups=tuple(groups), fingerprint=fingerprint(RIG, groups))
    found = examine(fit(problem(e), (), seed=1, draws=256, most=6), FEW, seed=1, n_simulated=199)
    pure = next(s for s in found.statistics if s.name == "conditions against their replicates")
    assert (pure.significant, found.wrong) == (wrong, wrong)
    if wrong:
        assert found.character == "physics"
        assert found.statistics[0] == pure


def test_places_hold_the_spoilt_stretch():
    e = experiment(spoil=bump, seed=3)
    one = fit(problem(e), (), seed=1, draws=512, most=8)
    places = [p for p in examine(one, FEW, seed=1, n_simulated=199).places if p.group == "a"]
    peak = e.group("a").frequency_hz[15]
    assert any(p.lower <= peak <= p.upper and p.log_bias < 0 for p in places)


# --- causes ---------------------------------------------------------------------------------------------------------


def test_screening_sees_a_hidden_cause_and_offers_starts():
    one = fit(problem(experiment(["amplifier_lag"], [4e-5])), (), seed=1, draws=512, most=8)
    found = {s.term.id: s for s in screen(one, FEW)}
    assert max(found.values(), key=lambda s: s.log_bayes).term.id == "amplifier_lag"
    assert found["amplifier_lag"].gain[found["amplifier_lag"].best] > PRESENT
    assert found["amplifier_lag"].starts.shape[1] == one.problem.n_dim + 1


def test_what_a_fit_has_left_to_climb_is_no_causes_merit(sound):
    """At the edge of a jump a fit ends on a slope: every cause would seem to gain what its expansion gains without."""
    short = sound.modes[:1].copy()
    short[0, 0] += 0.1
    end = ascend(sound.problem, short, schedule=((0, 1),))
    assert end.height[0] < sound.height - 50
    onward = screen(settle(sound.problem, end), FEW)
    for there, here in zip(onward, screen(sound, FEW), strict=True):
        assert there.log_bayes == pytest.approx(here.log_bayes, abs=0.7)


def test_prior_probabilities_of_models_sum_to_one():
    for n in (1, 3, 23):
        sizes = range(min(n, len(SIZE_WEIGHTS) - 1) + 1)
        assert sum(math.comb(n, k) * math.exp(log_prior(k, n)) for k in sizes) == pytest.approx(1)


@pytest.fixture(scope="module")
def hidden():
    return climb(problem(experiment(["amplifier_lag"], [4e-5], n=40, seed=3)), FEW, seed=1)


def test_ladder_names_a_hidden_cause(hidden):
    assert hidden.leader.ids == ("amplifier_lag",)
    assert hidden.gain(("amplifier_lag",)) > 20
    # Sets with a further cause that nobody can see are counted with it.
    assert hidden.probability[("amplifier_lag",)] > 0.9
    assert hidden.probability[("amplifier_lag", "reading_offset")] == 0
    assert sum(hidden.probability.values()) + sum(hidden.unfitted.values()) == pytest.approx(1)
    tau = hidden.leader.values[3]
    assert tau == pytest.approx(4e-5, rel=0.3)


@pytest.fixture(scope="module")
def three():
    """Three causes at once, and readings in which each of them shows."""
    return problem(experiment(["amplifier_lag", "flight_friction", "reading_offset"], [4e-5, 0.05, 5e-6], n=60))


def test_a_search_from_above_leads_through_the_truth(three, monkeypatch):
    monkeypatch.setattr(pruning, "_FEW", 3)  # the first cause goes by a quarter of the readings
    found = {c.ids: c for c in prune(three, FEW, seed=1, least=1, most=3)}
    true = ("amplifier_lag", "flight_friction", "reading_offset")
    assert true in found and {len(ids) for ids in found} == {1, 2, 3}
    right = replace(three, terms=terms(true))
    assert found[true].height > fit(right, [fit(three, (), seed=1)], seed=1).height - 0.5
    # None is worse than a part of it, but for the prior of what it has more.
    for c in found.values():
        for part in found.values():
            if len(part.ids) == len(c.ids) - 1 and set(part.ids) < set(c.ids):
                assert c.log_likelihood > part.log_likelihood - 3
    again = {c.ids: c for c in prune(three, FEW, seed=1, least=1, most=3)}
    assert all(np.array_equal(again[ids].modes, c.modes) for ids, c in found.items())


def test_no_hill_leads_nowhere(three, monkeypatch):
    """Where no draw of the prior can be evaluated, there is nothing from above."""
    monkeypatch.setattr(Problem, "predict", lambda self, u, *_: np.full((len(u), self.observed.size), np.nan))
    assert prune(three, FEW, seed=1, least=1, most=3) == []


def test_what_an_absence_costs_is_told_by_masses_not_heights(three):
    """A cause with a value for each group costs density in every one of them: heights alone would always drop it."""
    gains = {"a": 1.3, "b": 0.8, "c": 1.0}
    whole = problem(experiment(n=40, relative=0.02, spoil=lambda name, y: gains[name] * y))
    both = replace(whole, terms=terms(["amplifier_lag", "reading_gain"]))
    now = fit(both, [fit(whole, (), seed=1)], seed=1)
    without = {t.id: pruning._without(now, t) for t in now.terms}
    assert without["amplifier_lag"].worth > without["reading_gain"].worth
    exact = {id: fit(one.problem, [fit(whole, (), seed=1)], seed=1).laplace for id, one in without.items()}
    # The idle one's mass is told well; what is needed is far behind, however far the expansion has it.
    assert without["amplifier_lag"].worth == pytest.approx(exact["amplifier_lag"], abs=2)
    assert exact["reading_gain"] < exact["amplifier_lag"] - 10
    assert without["reading_gain"].worth < without["amplifier_lag"].worth - 10


def test_a_thorough_search_begins_from_above_too(three, tmp_path, monkeypatch):
    """Of the small models of a good large one none need be good: here the search has been held to one cause."""
    monkeypatch.setattr(rungs, "_TANGLED", 1)
    monkeypatch.setattr(rungs, "_WIDE", 2)

    def begun():
        search = rungs._Search(three, FEW, 1, Memory(tmp_path), lambda what, done, total: None)
        search.begin()
        return search

    search = begun()
    assert len(search._leader().ids) == 1
    assert search.from_above()
    assert {"amplifier_lag", "flight_friction"} <= set(search._leader().ids)
    monkeypatch.delattr(rungs, "prune")  # what it led through is kept
    again = begun()
    assert again.from_above() and again._leader().height == search._leader().height
    assert not again.from_above()


def test_an_exchange_begins_from_what_has_the_new_cause_too(monkeypatch):
    """Beside the rest of a wrong model the right cause may lead nowhere; from where it is best by itself it does."""
    whole = problem(experiment(["amplifier_lag", "flight_friction"], [4e-5, 0.05]))
    search = rungs._Search(whole, FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    lag = search.fitted["amplifier_lag",]
    begun: dict[tuple[str, ...], list[np.ndarray]] = {}

    def noting(p, starts, **options):
        begun.setdefault(p.ids, []).append(starts)
        return ascend(p, starts, **options)

    monkeypatch.setattr(rungs, "ascend", noting)
    rest = search.fitted["flight_friction",].problem
    both = replace(rest, terms=terms(["amplifier_lag", "flight_friction"]))
    search._tried(rest)
    expected = widened(both, lag.values, lag.problem.names)[0]
    assert any(np.array_equal(row, expected) for row in begun[both.ids][0])


def test_a_thorough_search_takes_every_step_of_a_quick_one_first(three, tmp_path, monkeypatch):
    """One that left out the unlike told a single set where the quick one told a tie of three."""
    steps = ["begin", "grow", "look_around", "settle", "think_again", "from_above", "take_over"]
    taken: list[str] = []

    def noting(name, own):
        def step(self, *args):
            taken.append(name)
            return own(self, *args)

        return step

    for name in steps:
        monkeypatch.setattr(rungs._Search, name, noting(name, getattr(rungs._Search, name)))
    monkeypatch.setattr(rungs, "_TANGLED", 1)
    quick = climb(three, FEW, seed=1, memory=Memory(tmp_path), thorough=False)
    by_quick, taken[:] = tuple(taken), []
    thorough = climb(three, FEW, seed=1, memory=Memory(tmp_path), others=quick.candidates[:2])
    assert set(by_quick) == set(steps[:5])
    assert tuple(taken[: len(by_quick)]) == by_quick
    assert set(taken[len(by_quick) :]) >= {"from_above", "take_over"}
    assert {c.ids for c in quick.candidates} <= {c.ids for c in thorough.candidates}


def test_exchanges_of_many_causes_are_judged_by_climbs(tmp_path, monkeypatch):
    """The expansion promises nothing; short climbs see what belongs in a cause's place, and it is fitted."""
    whole = problem(experiment(["amplifier_lag", "flight_friction"], [4e-5, 0.05], n=60))
    monkeypatch.setattr(rungs, "_WIDE", 1)

    def begun():
        search = rungs._Search(whole, FEW, 1, Memory(tmp_path), lambda what, done, total: None)
        search.begin()
        wrong = replace(whole, terms=terms(["stack_stiffness", "flight_friction"]))
        search.fitted = {c.ids: c for c in search.fitted.values() if c.ids in ((), ("flight_friction",))}
        search.fitted[wrong.ids] = fit(wrong, list(search.fitted.values()), seed=1)
        monkeypatch.setattr(search, "_promising", lambda ids: [])
        return search

    search = begun()
    wrong = search.fitted["stack_stiffness", "flight_friction"]
    search._exchange(wrong)
    assert search._leader().ids[:2] == ("amplifier_lag", "flight_friction")[: len(search._leader().ids)]
    assert search._leader().height > wrong.height + 10
    monkeypatch.delattr(rungs, "ascend")  # climbs are kept
    again = begun()
    again._exchange(again.fitted[wrong.ids])
    assert again._leader().height == search._leader().height


def test_a_part_is_found_from_the_whole_and_what_was_concluded_from_its_old_place_forgotten():
    """The cause alone stays at its neutral value; the pair, whose second cause does little, is right."""
    whole = problem(experiment(["amplifier_lag"], [4e-5], n=40, seed=3))
    search = rungs._Search(whole, FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    right = search.fitted[("amplifier_lag",)]
    stuck = settle(
        right.problem, ascend(right.problem, search.fitted[()].widened(right.problem)[0][:1], schedule=((0, 1),))
    )
    search.fitted[stuck.ids] = stuck
    assert stuck.height < right.height - 10
    search._screen(stuck.ids)
    search._refined.add(stuck.ids)
    pair = replace(whole, terms=terms(["amplifier_lag", "reading_offset"]))
    search.fitted[pair.ids] = fit(pair, [right], seed=1)
    search.compare()
    assert search.fitted[stuck.ids].height == pytest.approx(right.height, abs=0.1)
    assert stuck.ids not in search.screenings and stuck.ids not in search._refined


def test_what_acts_by_steps_is_found_a_step_away():
    """Nothing leads uphill from 1.3 periods: ranges stay as they are until the tip strikes once more, or less."""
    repeated = terms(["repeat_impacts"])
    whole = replace(problem(experiment(["repeat_impacts"], [1.05], n=60, relative=0.02)), terms=repeated)
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    for name, value in zip(("k_c", "c_s", "c_c", "repeat_cycles"), (*TRUTH, 1.05), strict=True):
        k = whole.names.index(name)
        truth[k] = whole.parameters[k].to_sampling(value)
    best = ascend(whole, truth[None])
    away = best.u.copy()
    away[0, whole.names.index("repeat_cycles")] = 1.3
    stuck = ascend(whole, away)
    assert stuck.u[0, whole.names.index("repeat_cycles")] == 1.3 and stuck.height[0] < best.height[0] - 10
    assert _across_steps(whole, stuck).height.max() > best.height[0] - 1


@pytest.mark.parametrize(("ids", "values"), [((), ()), (("amplifier_lag",), (2e-5,))])
def test_combinations_are_tried_where_a_cause_gains_something(ids, values):
    search = rungs._Search(problem(experiment(ids, values)), FEW, 1, Memory(None), lambda what, done, total: None)
    search.begin()
    assert search.found_something() == bool(ids)


def test_a_second_cause_is_looked_for_beside_every_cause_alone(tmp_path, monkeypatch):
    """... on a quarter of the readings, and what was looked at once is kept."""
    both = ("amplifier_lag", "flight_friction")
    whole = problem(experiment(both, [4e-5, 0.05], n=60))

    def begun():
        search = rungs._Search(whole, FEW, 1, Memory(tmp_path), lambda what, done, total: None)
        search.begin()
        search.look_around()
        return search

    first = begun()
    assert first._leader().ids == both
    assert sum(len(ids) == 2 for ids in first.fitted) <= rungs._LATE
    monkeypatch.delattr(rungs, "screen")
    again = begun()
    assert again._leader().height == first._leader().height
    for one, other in zip(first._screen(()), again._screen(()), strict=True):
        assert (one.term, one.log_bayes, one.visible) == (other.term, other.log_bayes, other.visible)
        assert np.array_equal(one.gain, other.gain) and np.array_equal(one.starts, other.starts)


def test_a_larger_model_is_never_much_worse_than_one_within_it(hidden):
    for c in hidden.candidates:
        for smaller in hidden.candidates:
            if set(smaller.ids) < set(c.ids):
                # Densities of parameters at neutral values may cost something; likelihood may not be lost.
                assert c.log_likelihood > smaller.log_likelihood - 3.0


def test_sessions_are_compared_where_they_share_a_condition(sound):
    """Two sessions of one sweep, the second read a third too high; a third group shares nothing with them."""
    few = experiment(n=8)
    first, other = few.groups[0], few.groups[1]
    twice = replace(first, id="again", launch_range_um=first.launch_range_um * 1.33)
    groups = (first, twice, other)
    one = fit(problem(replace(few, groups=groups, fingerprint=fingerprint(RIG, groups))), (), seed=1)
    (found,) = offsets(one)
    assert (found.first, found.second, found.n_conditions) == ("a", "again", 8)
    assert found.factor == pytest.approx(1.33, rel=1e-3) and 1 < found.lower < 1.33 < found.upper
    assert offsets(sound) == []
    # The time that a reading was taken is only told where sweeps went to and fro.
    assert "order" not in {d.variable for d in drift(one)}
    rng = np.random.default_rng(0)
    shuffled = []
    for g in few.groups:
        rows = rng.permutation(g.n_points)
        y = g.launch_range_um[rows] * np.linspace(0.6, 1.6, g.n_points)  # the rig warms up
        shuffled.append(Group(g.id, g.waveform, g.file, g.frequency_hz[rows], g.amplitude_v[rows], y))
    warm = fit(problem(replace(few, groups=tuple(shuffled), fingerprint=fingerprint(RIG, shuffled))), (), seed=1)
    assert drift(warm)[0].variable == "order"


def whose(baseline, leader):
    return robustness(baseline, leader, leftover(baseline), leftover(leader))


def test_whose_a_gain_is(hidden, sound):
    """A hidden lag gains in both frequency sweeps, and more than any smooth curve; a bump in one sweep is its own."""
    found = whose(hidden.baseline, hidden.leader)
    assert sum(gain for _, gain in found.groups) == pytest.approx(hidden.gain(("amplifier_lag",)), abs=1e-6)
    assert not found.of_one_group and found.without is not None and found.without > 5
    assert found.over_smooth > 3
    one = fit(problem(experiment(spoil=bump, seed=3)), (), seed=1, draws=512, most=8)
    odd = fit(replace(one.problem, terms=FEW[:1]), [one], seed=1)
    assert whose(one, odd).over_smooth < 0
    assert whose(sound, sound).groups == [("a", 0.0), ("b", 0.0), ("c", 0.0)]


def test_one_group_may_give_it_all():
    alone = Robustness([("a", 90.0), ("b", 5.0), ("c", 5.0)], "a", 3.0, 4.0)
    assert alone.of_one_group
    assert not replace(alone, groups=[("a", 70.0), ("b", 15.0), ("c", 15.0)]).of_one_group
    assert not replace(alone, groups=[("a", 90.0)], strongest=None, without=None).of_one_group


def test_what_is_called_visible_is_what_a_refit_leaves(sound):
    """In standard deviations of the scatter, at the prior's median; a poor experiment shows less than a rich one."""
    poor = fit(problem(experiment(n=8, relative=0.5)), (), seed=1)
    rich = fit(problem(experiment(relative=0.01)), (), seed=1)
    visible = {}
    for name, one in (("poor", poor), ("rich", rich)):
        for found in screen(one, terms(["amplifier_lag", "flight_friction"])):  # they act to one side
            large = replace(one.problem, terms=(found.term,))
            at = one.within(large)[0]
            at[large.names.index(found.term.strength.name)] = found.term.strength.prior_quantile(0.5)
            effect = (large.predict(at[None])[0] - one.predicted) / one.scatter
            own = (one.slope / one.scatter).T
            left = effect - own @ np.linalg.lstsq(own, effect, rcond=None)[0]
            visible[name, found.term.id] = found.visible
            assert found.visible == pytest.approx(np.linalg.norm(left), rel=0.05, abs=0.05), (name, found.term.id)
    assert visible["poor", "flight_friction"] < VISIBLE < visible["rich", "flight_friction"]


def test_curves_hold_what_is_simulated_between_readings(hidden):
    """At the readings what was fitted; between them what the simulator says there, with each cause and without."""
    leader = hidden.leader
    (cause,) = leader.terms
    start = 0
    for g, line in zip(leader.problem.experiment.groups, show.lines(leader), strict=True):
        x, part = (g.frequency_hz if g.varied == ("frequency",) else g.amplitude_v), slice(start, start + g.n_points)
        start = part.stop
        assert line.group == g.id and len(line.at) > 2 * g.n_points
        assert np.interp(x, line.at, line.um) == pytest.approx(leader.predicted[part], rel=1e-9)
        between = simulate(
            Design.of(leader.problem.experiment.constants, [g.filled()]), leader.values[None, :4], leader.terms
        )
        assert line.um == pytest.approx(between.launch_range[0] * 1e6, rel=1e-9)
        assert line.without_um.keys() == {cause.id} and line.without_um[cause.id] != line.um


def test_the_word_for_a_cause(hidden):
    """What is named, tied, good for a part, absent, or could not have been seen."""
    found = {s.term.id: s for s in hidden.screened}
    seen, unseen = (replace(found["flight_friction"], visible=v, chance=1.0) for v in (2 * VISIBLE, 0.5 * VISIBLE))
    calm = SimpleNamespace(verdict="explained", named=("gap",), alternatives=(), inclusion={"flight_friction": 0.1})
    weak, strong = SimpleNamespace(gain=lambda ids: 0.5), SimpleNamespace(gain=lambda ids: 9.0)
    assert _word(seen, weak, calm) == "not present"
    assert _word(unseen, weak, calm) == UNSEEN
    assert _word(unseen, strong, calm) == "explains part alone"
    tied = SimpleNamespace(**vars(calm) | {"alternatives": (("flight_friction", "gap"),)})
    assert _word(unseen, weak, tied) == "as good"
    named = SimpleNamespace(**vars(calm) | {"inclusion": {"flight_friction": 0.9}})
    assert _word(unseen, weak, named) == "present"
    named.verdict = "unexplained"
    assert _word(unseen, weak, named) == NEAREST


def test_values_that_nobody_expects_are_flagged():
    """A lag far beyond what is believed of it, and nothing else; the wider its prior, the more evidence it has."""
    e = experiment(["amplifier_lag"], [4e-5])
    told = Belief("amplifier_lag_tau", Normal(0.0, 1.2e-5), "a data sheet")
    verdict = SimpleNamespace(named=("amplifier_lag",), probability={("amplifier_lag",): 1.0})
    for beliefs, flagged in (((), []), ((told,), ["amplifier_lag_tau"])):
        one = problem(replace(e, beliefs=beliefs))
        lag = replace(one, terms=terms(["amplifier_lag"])).terms
        ladder = climb(one, lag, seed=1)
        cause = _cause(ladder, verdict, ladder.of(("amplifier_lag",)))
        assert cause.implausible == flagged
    widths = cause.evidence["prior_width"]
    assert widths["twice"] > 1 > 0 > widths["half"]
    wide = problem(replace(e, beliefs=(replace(told, prior=Normal(0.0, 2.4e-5)),)))
    wider = weigh(fit(replace(wide, terms=terms(["amplifier_lag"])), [ladder.baseline], seed=1), seed=1)
    assert widths["twice"] == pytest.approx(wider.log_evidence - cause.evidence["log_evidence"], abs=0.5)


def test_what_was_not_fitted_counts_by_what_screening_saw(hidden):
    """A set that screening promises more than the leader has its share, unless it adds too little to be counted."""
    lag, other = (s for s in hidden.screened if s.term.id in ("amplifier_lag", "flight_friction"))
    lag, other = sorted((lag, other), key=lambda s: s.term.id)
    fitted = [SimpleNamespace(ids=()), SimpleNamespace(ids=("amplifier_lag",))]
    evidence = {(): 0.0, ("amplifier_lag",): 20.0}
    for worth, told in ((10.0, True), (2.0, False)):
        screenings = {(): hidden.screened, ("amplifier_lag",): (replace(other, log_bayes=worth),)}
        found = ladder.rank(fitted, evidence, {}, screenings, len(FEW), 4)
        pair = tuple(s.term.id for s in hidden.screened if s.term.id in ("amplifier_lag", "flight_friction"))
        if told:
            price = log_prior(2, len(FEW)) - log_prior(1, len(FEW))
            assert math.log(found.unfitted[pair] / found.probability[("amplifier_lag",)]) == pytest.approx(
                worth + price, abs=1.5
            )
        else:
            assert pair not in found.unfitted and found.probability[("amplifier_lag",)] > 0.95


def test_readings_that_scatter_less_than_any_instrument_accuse_nothing():
    """What a simulation made, as it is or rounded, and a scatter of three in ten thousand; a cause still shows."""
    rng = np.random.default_rng(2)
    e = experiment(relative=0.0)
    design = Design.of(e.constants, e.groups)
    for ids, values in (((), ()), (("gap",), (3e-7,))):
        true = simulate(design, [*TRUTH, *values], terms(ids)).launch_range[0] * MICRO
        for readings in (true, true.round(2), true * (1 + 3e-4 * rng.standard_normal(true.size))):
            one = problem(e.with_readings(readings))
            found = examine(fit(one, (), seed=1, draws=512, most=8), (), seed=1)
            assert found.wrong == bool(ids) and (ids or found.p_value == 1.0)
    # A thousandth is a scatter like another.
    one = problem(e.with_readings(true * (1 + 3e-3 * rng.standard_normal(true.size))))
    assert examine(fit(replace(one, terms=terms(ids)), (), seed=1), (), seed=1).p_value < 1.0


def test_verdicts(hidden, sound):
    # Few readings let a large scatter stand for the cause; more do not.
    more = fit(problem(experiment(["amplifier_lag"], [4e-5], n=60)), (), seed=1, draws=2048, most=24)
    before = examine(more, FEW, seed=1, n_simulated=199)
    after = examine(hidden.leader, FEW, seed=1, n_simulated=199)
    assert before.wrong
    assert not after.wrong
    left = leftover(hidden.leader)
    bare = leftover(hidden.baseline)
    found = conclude(hidden, before, after, left, bare)
    assert found.verdict in ("explained", "ambiguous")
    assert found.named == ("amplifier_lag",)
    assert found.inclusion["amplifier_lag"] > 0.95
    # The same ladder whose leader leaves structure is not an explanation.
    spoilt = replace(after, p_value=ALPHA / 2)
    assert conclude(hidden, before, spoilt, left, bare).verdict == "unexplained"
    # A rival of equal probability makes a tie.
    p = hidden.probability[("amplifier_lag",)]
    tied = replace(hidden, probability=hidden.probability | {("amplifier_lag",): p / 2, ("flight_friction",): p / 2})
    tie = conclude(tied, before, after, left, bare)
    assert tie.verdict == "ambiguous"
    assert tie.alternatives[0] == ("flight_friction",)
    # So does one that fits as well, held back by what is plausible alone; not one that is absurd, or has more causes.
    leader, other = hidden.of(("amplifier_lag",)), hidden.of(("flight_friction",))
    assert leader.log_likelihood - other.log_likelihood > 4.0
    verdicts = {}
    for behind in (2.0, 4.0):
        alike = replace(other, heights=other.heights + leader.log_likelihood - other.log_likelihood - behind)
        for p in (0.02, 1e-4):
            candidates = tuple(alike if c is other else c for c in hidden.candidates)
            share = dict.fromkeys(hidden.probability, 0.0) | {leader.ids: 0.98 - p, other.ids: p}
            verdicts[behind, p] = conclude(
                replace(hidden, candidates=candidates, probability=share, unfitted={}), before, after, left, bare
            )
    assert {key for key, v in verdicts.items() if v.verdict == "ambiguous"} == {(2.0, 0.02)}
    assert verdicts[2.0, 0.02].alternatives == (other.ids,) and "plausible" in verdicts[2.0, 0.02].reasons[0]
    # Causes that share the probability take nothing from what has no name: it has a tenth before the readings.
    doubtful = replace(left, log_bayes=np.log(9 * 1.5))
    hopeless = replace(bare, log_evidence=-np.inf)
    assert conclude(hidden, before, after, doubtful, hopeless).unnamed == pytest.approx(0.6)
    assert conclude(tied, before, after, doubtful, hopeless).unnamed == pytest.approx(0.6)
    assert conclude(tied, before, after, doubtful, hopeless).verdict == "unexplained"
    # So does what has no name in their place: a set of causes is no likelier for being a set of causes.
    none = replace(left, log_bayes=-50.0, log_evidence=left.log_evidence - left.log_bayes - 50.0)
    # (What adds nothing visible is counted with the leader, but has no part in the leader's prior.)
    worth = {ids: value + hidden.log_prior(ids) for ids, value in hidden.log_evidence.items()}
    counted = sum(np.exp(w - worth[leader.ids]) for ids, w in worth.items() if "amplifier_lag" in ids)
    own = hidden.probability[leader.ids] / counted
    odds = own * np.exp(hidden.log_prior(()) - hidden.log_prior(leader.ids)) / 9
    as_good = replace(bare, log_evidence=none.log_evidence + 50.0)
    assert conclude(hidden, before, after, none, as_good).unnamed == pytest.approx(odds / (1 + odds))
    better = conclude(hidden, before, after, none, replace(as_good, log_evidence=as_good.log_evidence + 10))
    assert better.verdict == "unexplained" and "a smooth curve in its place is simpler" in better.reasons[0]
    assert not better.remains
    # What has no name and keeps a part beside an explanation is told with it.
    doubted = conclude(hidden, before, after, replace(left, log_bayes=np.log(9 * 0.25)), hopeless)
    assert doubted.verdict == "explained" and doubted.unnamed == pytest.approx(0.2)
    assert "a discrepancy without a name keeps 20 %" in doubted.reasons[0]
    # Nothing hidden.
    plain = climb(sound.problem, FEW, seed=1)
    quiet = examine(plain.baseline, FEW, seed=1, n_simulated=199)
    assert conclude(plain, quiet, None, leftover(sound), leftover(sound)).verdict == "adequate"


# --- showing, gaining, planning -------------------------------------------------------------------------------------


def test_growth_is_that_of_the_data(sound):
    found = {g.group: g for g in growth(sound)}
    assert found["b"].variable == "amplitude"
    # The baseline is linear: ranges grow in proportion to the voltage.
    assert found["b"].simulated == pytest.approx(np.ones(len(found["b"].at)), abs=0.02)
    inside = [lo <= 1 <= up for lo, up in zip(found["b"].lower, found["b"].upper, strict=True)]
    assert np.mean(inside) > 0.6


def test_what_luck_gains_has_the_known_laws():
    """Of a strength on one side of neutral, on both, and of a quantity drawn anew."""
    nothing = np.random.default_rng(1).standard_normal((20000, 5))
    one_sided = np.linspace(0, 6, 121)[:, None] * np.eye(5)[2]
    found = [
        np.quantile(_luck(effects, [], nothing), 0.95) for effects in (one_sided, np.vstack([one_sided, -one_sided]))
    ]
    assert found == pytest.approx([0.5 * 1.645**2, 0.5 * 1.960**2], rel=0.05)
    drawn = _luck(np.zeros((1, 5)), [3.0 * np.eye(5)[[1]]], nothing)
    assert drawn == pytest.approx(0.5 * 0.9 * nothing[:, 1] ** 2)


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


def test_gain_does_not_see_what_it_scores(tmp_path):
    e = experiment(["amplifier_lag"], [4e-5])
    # Other readings in the groups held out must not change what is predicted for them.
    other = replace(e, groups=(e.groups[0], *(replace(g, launch_range_um=g.launch_range_um + 9) for g in e.groups[1:])))
    found = []
    for data in (e, other):
        ladder = climb(problem(data, ("a",)), FEW, seed=1)
        found.append(split(ladder, ("b", "c"), 1))
    for one, two in zip(found[0].after, found[1].after, strict=True):
        assert one.median == pytest.approx(two.median)
    result = summarise("strict", e, found[:1], tmp_path, 1)
    for g in result.groups:
        assert g.log_rmse_interval[0] < g.log_rmse_after - g.log_rmse_before < g.log_rmse_interval[1]
        assert g.elpd_interval[0] < g.elpd_after - g.elpd_before < g.elpd_interval[1]
    assert result.log_rmse_after < result.log_rmse_before
    assert [g.group for g in result.groups] == ["b", "c"]
    assert all("b" not in entry["saw"] for entry in result.ledger)
    rows = (tmp_path / result.predictions).read_text().splitlines()
    assert rows[0].endswith("role,model")
    assert len(rows) == 1 + 2 * 48


def test_no_protocol_sees_what_it_scores(tmp_path):
    """Readings of a group change nothing of what any protocol predicts for it, the search of all groups or no."""
    e = experiment(["amplifier_lag"], [4e-5], groups=("a", "b"), n=12)
    a, b = e.groups
    groups = (a, replace(b, launch_range_um=3 * b.launch_range_um))
    told = []
    for name, data in (("as read", e), ("changed", replace(e, groups=groups, fingerprint=fingerprint(RIG, groups)))):
        folder = tmp_path / name
        folder.mkdir()
        work = diagnosis._Work(data, ("a",), folder, 1, FEW[:2], 1, Silent(), ())
        work._search(data.ids, work._parts())
        measured = work._gains()
        for scored in measured.values():
            assert all(not set(entry["saw"]) & set(entry["scored_on"]) for entry in scored["ledger"])
        for protocol in ("strict", "nested"):
            with (folder / f"predictions-{protocol}.csv").open() as f:
                rows = [row for row in csv.DictReader(f) if row["group"] == "b"]
            assert len(rows) == 2 * 12
            told.append([{k: v for k, v in row.items() if k != "launch_range_um"} for row in rows])
    assert told[:2] == told[2:]


def test_an_unnamed_discrepancy_widens_and_moves_nothing(monkeypatch):
    """Where a group was not seen; half a unit of the logarithm makes a band about exp(0.8) wide to either side."""
    ladder = climb(problem(experiment(relative=0.01), ("a",)), FEW[:1], seed=1)
    found = []
    for size in (0.0, 0.5):
        monkeypatch.setattr(Leftover, "elsewhere", lambda self, scatter, rng, size=size: np.full(scatter.shape, size))
        found.append(split(ladder, ("b",), 1).before[0])
    exact, vague = found
    assert (exact.median == vague.median).all() and (exact.median > 1).any()
    clear = exact.median > 3  # elsewhere the absolute scatter adds
    assert np.log(vague.upper / vague.median)[clear] == pytest.approx(0.5 * 1.645, rel=0.25)
    assert np.log(vague.median / vague.lower)[clear] == pytest.approx(0.5 * 1.645, rel=0.25)
    assert (np.log(exact.upper / exact.median)[clear] < 0.2).all()
    assert (vague.log_density < exact.log_density)[clear].mean() > 0.8


def test_a_group_that_cannot_tell_is_in_no_mean(tmp_path):
    e = experiment(["amplifier_lag"], [4e-5])
    still = replace(e.groups[1], amplitude_v=np.zeros(24), launch_range_um=np.full(24, 0.02))
    groups = (e.groups[0], still, e.groups[2])
    e = replace(e, groups=groups, fingerprint=fingerprint(RIG, groups))
    result = summarise("strict", e, [split(climb(problem(e, ("a",)), FEW[:1], seed=1), ("b", "c"), 1)], tmp_path, 1)
    b, c = result.groups
    assert (b.silent, c.silent) == ("nothing drives it", "")
    assert (result.log_rmse_before, result.log_rmse_after) == (c.log_rmse_before, c.log_rmse_after)
    assert (result.elpd_after, result.coverage_after) == (c.elpd_after, c.coverage_after)
    assert c.elpd_interval[0] < result.elpd_interval[0] + 5 and c.elpd_interval[1] > result.elpd_interval[1] - 5


@pytest.mark.parametrize("n", [2, 3, 6, 12])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_nine_in_ten_intervals_of_a_gain_hold_it(n, noise):
    """However few the groups are; without the stretch it is half of them for two groups, three quarters for three."""
    rng = np.random.default_rng([n, int(noise)])
    inside = []
    for _ in range(1000):
        truth = rng.standard_normal(n)
        found = truth + noise * rng.standard_normal(n)
        low, high = over_groups(found[:, None] + noise * rng.standard_normal((n, 200)), found, rng)
        inside.append(low < 0.0 < high)
    # Where readings scatter, the groups' spread holds that already.
    assert 0.84 < np.mean(inside) < (0.93 if not noise else 0.98)


def test_of_one_group_the_readings_alone_tell_how_sure_a_gain_is():
    rng = np.random.default_rng(1)
    redrawn = 2.0 + rng.standard_normal((1, 1000))
    assert over_groups(redrawn, np.array([2.0]), rng) == pytest.approx([2.0 - 1.645, 2.0 + 1.645], abs=0.25)


def test_a_search_begins_from_what_fewer_readings_led_to(monkeypatch):
    """A search that goes no further than single causes finds the pair that a part of the readings had."""
    ids, values = ["amplifier_lag", "flight_friction"], [4e-5, 0.02]
    e = experiment(ids, values)
    part = replace(problem(e, ("a", "b")), terms=terms(ids))
    known = fit(part, [fit(problem(e, ("a", "b")), (), seed=1)], seed=1)
    monkeypatch.setattr(rungs._Search, "grow", lambda self, size: False)
    monkeypatch.setattr(rungs._Search, "refine", lambda self: False)
    alone, begun = (climb(problem(e), FEW, seed=1, others=others) for others in ((), (known,)))
    assert len(alone.leader.terms) == 1 and begun.leader.ids == tuple(ids)
    whole = fit(replace(problem(e), terms=terms(ids)), [alone.of(())], seed=1)
    assert begun.leader.height == pytest.approx(whole.height, abs=0.5)


def test_next_experiment_separates_what_is_tied(hidden):
    leader = hidden.leader
    rival = hidden.of(("flight_friction",))
    draws = [weigh(c, seed=1) for c in (leader, rival)]
    found = tell_apart([(leader, draws[0]), (rival, draws[1])], seed=1)
    assert found[0].separation >= found[-1].separation
    assert found[0].separation > 3
    assert found[0].success > 0.5
    pair = found[0].pairs[0]
    assert (pair.first, pair.second) == (["amplifier_lag"], ["flight_friction"]) and len(found[0].pairs) == 1
    assert pair.separation == pytest.approx(found[0].separation, abs=3 * found[0].error)


def test_next_experiment_narrows_what_it_can(sound, monkeypatch):
    """... and of a parameter that no reading depends on it promises nothing, though the readings are many."""
    draws = weigh(sound, seed=1)
    name, found = determine(sound, draws, seed=1)
    assert name in sound.problem.names
    assert found[0].separation >= found[-1].separation >= 0

    monkeypatch.setattr(next_experiment.noise, "scale", lambda ranges, scatter, sigma: np.ones_like(ranges))
    rng = np.random.default_rng(1)

    def falls(told, u):
        n = len(told)
        return next_experiment._narrowing(next_experiment._Forecast(told, np.zeros((n, 3)), np.full(n, 1 / n)), u)[0]

    # Sixteen readings of unit scatter of a quantity of unit variance leave 1/17 of it.
    x = rng.normal(size=(400, 1))
    assert falls(np.repeat(x, 16, axis=1), x)[0] == pytest.approx(0.5 * np.log(17), abs=0.1)
    # Sixteen free numbers fit anything of forty draws by chance, and nothing is learnt of what is known.
    assert max(falls(10 * rng.normal(size=(40, 16)), rng.normal(size=(40, 8)))) < 0.05
    assert falls(x, np.ones((400, 1))) == [0.0]


def test_nothing_is_built_for_hardly_more():
    """A changed rig comes first where it does more than the rig as it is by a tenth, and by more than both err."""

    def first(here, changed, error=0.01):
        a = next_experiment.Proposal("as it is", "sine", [1.0], [1.0], {}, here, None, error)
        b = replace(a, text="changed", constants={"l": 0.2}, separation=changed)
        c = replace(b, text="less", separation=0.5 * changed)
        found = next_experiment._worth_building([b, c, a])
        assert sorted(p.text for p in found) == ["as it is", "changed", "less"]
        return found[0].text

    assert first(0.95, 1.0) == "as it is" and first(0.85, 1.0) == "changed"
    assert first(0.85, 1.0, error=0.1) == "as it is" and first(1.1, 1.0) == "as it is"


def test_luck_puts_a_measurement_first_but_is_not_told(sound, monkeypatch):
    """Where nothing but chance tells proposals apart, the first of twelve promises no more than any other."""
    rng = np.random.default_rng(1)
    monkeypatch.setattr(next_experiment, "_narrowing", lambda told, u: rng.normal(size=(2, u.shape[1])))
    draws = weigh(sound, seed=1)
    first = [determine(sound, draws, seed=1)[1][0].separation for _ in range(5)]
    assert abs(np.mean(first)) < 2 / np.sqrt(5)  # two standard errors; the best of twelve has 1.6


def test_proposals_differ_and_stay_where_was_measured(sound):
    e = experiment()
    for low, high in ((1234.0, 1234.0), (1249.0, 1251.0), (1000.0, 1300.0)):
        groups = (replace(g, frequency_hz=np.linspace(low, high, g.n_points)) for g in e.groups)
        possible = proposals(replace(sound, problem=problem(replace(e, groups=tuple(groups)))))
        assert len({p.text for p in possible}) == len(possible)
        assert all((low <= p.design.frequency).all() and (p.design.frequency <= high).all() for p in possible)
        swept = [p.text for p in possible if np.ptp(p.design.frequency) > 0]
        assert bool(swept) == (high == 1300.0)
    assert "sine, 1200 Hz, 3 to 20 V" in [p.text for p in possible]


def test_copies_of_a_draw_do_not_judge_what_it_made():
    """Two models of one posterior cannot be told apart, however few different draws it has."""
    rng = np.random.default_rng(1)
    few = np.repeat(rng.normal(100.0, 30.0, size=(12, 1)), 16, axis=1)
    weight = rng.dirichlet(np.ones(12))
    twin = next_experiment._Forecast(few, np.tile([0.05, 0.1, 30.0], (12, 1)), weight)
    (separation, success, error), _ = next_experiment._apart([twin, replace(twin)], rng)
    assert separation < 2 * error and success < 0.1
    # What readings state for themselves is part of their scatter.
    known = replace(twin, known=np.array([200.0]))
    other = replace(known, ranges=few + 20.0)
    clear, _ = next_experiment._apart([twin, replace(other, known=None)], rng)
    assert next_experiment._apart([known, other], rng)[0][0] < 0.5 < clear[0]


def test_a_measurement_that_settles_one_question_of_two_is_told_so():
    """Two models that predict the same, and a third far from them: worth ln 2 against the others, and one pair tied."""
    rng = np.random.default_rng(1)
    near = np.repeat(rng.normal(100.0, 1.0, size=(40, 1)), 16, axis=1)
    scatter, weight = np.tile([0.05, 0.1, 30.0], (40, 1)), np.full(40, 1 / 40)
    one, far = (next_experiment._Forecast(x, scatter, weight) for x in (near, near + 100.0))
    (separation, success, error), pairs = next_experiment._apart([one, replace(one), far], rng)
    assert separation == pytest.approx(np.log(2), abs=3 * error + 0.02) and success < 0.1
    assert abs(pairs[0, 1]) < 0.1 and pairs[0, 2] > 40 and pairs[1, 2] > 40 and (pairs == pairs.T).all()


def test_proposals_keep_to_stated_limits(sound):
    limits = (("frequency_hz", (300.0, 9000.0)), ("amplitude_v", (2.0, 40.0)), ("l", (RIG.l, 0.2)), ("M", (0.01, 0.02)))

    def possible(limits):
        stated = replace(sound.problem.experiment, limits=limits)
        return proposals(replace(sound, problem=replace(sound.problem, experiment=stated)))

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


def test_one_proposal_leaves_the_rig_as_it_is(sound):
    """... though every other string tells more: it is the one that can be rehearsed with what was measured."""
    rng = np.random.default_rng(1)
    possible = proposals(sound)
    kept = next_experiment._best(possible, [bool(p.changed) + rng.random() / 2 for p in possible])
    assert [not possible[k].changed for k in kept] == [False] * 11 + [True]


def test_rehearsal_tells_the_truth_whichever_it_is(hidden):
    """Readings from either of two causes, added to what was measured: the cause that made them comes out ahead."""
    models = [(c, weigh(c, seed=1)) for c in (hidden.leader, hidden.of(("flight_friction",)))]
    best = next(p for p in tell_apart(models, seed=1) if not p.constants)
    found = rehearse(models, [0.0, 0.0], best, seed=1)
    assert found.proposal == best.text
    assert found.truth[0] == list(hidden.leader.ids)
    assert found.truth[-1] == ["flight_friction"]
    assert sum(found.before[i] for i in (0, -1)) == pytest.approx(1)
    # What was measured names the leader already; a truth that it refutes needs much to come out first.
    assert all(
        after > 0.9 for ids, after in zip(found.truth, found.after, strict=True) if ids == list(hidden.leader.ids)
    )
    assert np.mean(found.after[-3:]) > found.before[-1]
    assert found == rehearse(models, [0.0, 0.0], best, seed=1)
    # So it is with a constant of the rig changed.
    other = next(p for p in tell_apart(models, seed=1) if p.constants)
    found = rehearse(models, [0.0, 0.0], other, seed=1)
    assert all(
        after > 0.9 for ids, after in zip(found.truth, found.after, strict=True) if ids == list(hidden.leader.ids)
    )


def test_the_same_experiment_again_tells_what_it_can_separate(hidden):
    """A lag and friction, each as fitted to readings that a lag has made; and a model against its own double."""
    models = [(c, weigh(c, seed=1)) for c in (hidden.leader, hidden.of(("flight_friction",)))]
    found = repeat(models, [0.0, 0.0], seed=1)
    assert found.before == pytest.approx([0.5] * 6)
    # Friction that stands for a lag came with a wide scatter, in which a lag may do as well: two of three at most.
    assert min(found.after[:3]) > 0.9 and found.first >= 4
    double = np.array(repeat([models[0], models[0]], [0.0, 0.0], seed=1).after)
    assert np.sqrt(np.mean(np.log(double / (1 - double)) ** 2)) < 0.6  # nats by which evidences err


def test_where_a_cause_was_held_by_cliffs_the_others_are_looked_over(hidden):
    """Else the one that a look had raised would lead over others that nobody looked at."""
    search = rungs._Search(hidden.baseline.problem, FEW, 1, Memory(None), lambda *a: None)
    search.fitted = {c.ids: c for c in hidden.candidates if len(c.terms) < 2}
    truth, rival = (search.fitted[(id,)] for id in ("amplifier_lag", "flight_friction"))

    def held(c):
        moved = c.modes[:1].copy()
        moved[0, 0] += 0.06
        return settle_at(c.problem, moved)

    search.fitted[rival.ids] = held(rival)
    assert search.fitted[rival.ids].height < rival.height - 5
    assert rival.ids not in {c.ids for c in search._finalists()}
    search._scout()
    assert search.fitted[rival.ids].height < rival.height - 5
    search.fitted[truth.ids] = held(truth)
    assert search._take(truth)
    assert search._scout() and search.fitted[rival.ids].height > rival.height - 1


def test_a_baseline_that_fails_is_fitted_where_readings_are_scatter(tmp_path):
    """Friction leads away by 400 nats; the baseline's best hill has 20 um of scatter and another contact."""
    design = read_experiment(Path(__file__).parents[1] / "experiments" / "psa")
    causes = ["hunt_crossley", "flight_friction"]
    make(2886276895, tmp_path, design_of=design, kind="two", terms=causes, believed=True)
    data = read_experiment(tmp_path / "experiment")
    plain = Problem(data, data.ids)
    there = plain.to_sampling(np.array([2.78e7, 4.15e4, 339.0, 0.0169, 19.5, 15.6]))
    top = ascend(plain, there[None]).height[0]
    assert fit(plain, (), seed=1, draws=1024, most=24).height > top - 0.5


def test_ends_of_climbs_on_one_hill_are_one_hill(hidden):
    one = settle_at(hidden.leader.problem, hidden.leader.modes[:1])
    assert one.laplace_apart == pytest.approx(one.laplace)
    width = 1 / np.sqrt(one.curvature[0, 0, 0])
    for steps, counted in ((0.0, 1.0), (0.3, 1.0), (30.0, 2.0)):
        away = np.vstack([one.modes, one.modes])
        away[1, 0] += steps * width
        heights, curvature, mass = (np.concatenate([x, x]) for x in (one.heights, one.curvature, one.mass))
        two = replace(one, modes=away, heights=heights, curvature=curvature, mass=mass)
        assert two.laplace == pytest.approx(one.laplace + math.log(2))
        assert math.exp(two.laplace_apart - one.laplace) == pytest.approx(counted, rel=0.05)


def test_groups_that_are_predicted_worse_are_named(hidden):
    """Beyond chance, and where a reading can tell."""
    rows = [("a", [0.1, 0.4], ""), ("b", [-0.1, 0.4], ""), ("c", [0.1, 0.4], "too quiet"), ("d", [None, None], "")]
    gain = {"groups": [{"group": g, "log_rmse_interval": ends, "silent": why} for g, ends, why in rows]}
    assert [g["group"] for g in worse(gain)] == ["a"]
    scores = {"log_rmse_before": 0.3, "log_rmse_after": 0.6}
    one = {"groups": [{**gain["groups"][0], **scores}], **scores, "log_rmse_interval": [0.1, 0.4]}
    calm = SimpleNamespace(reasons=(), alternatives=(), named=())
    quiet = SimpleNamespace(wrong=False)
    search = {"lead": 9.2, "null": [-1.0, 2.4], "p_value": 1 / 3}
    tied = SimpleNamespace(reasons=(), alternatives=(("c",), ()), named=("a", "b"))
    said = sentences(tied, quiet, hidden, None, [], {}, {}, None)
    assert "Not to be told apart from a + b: c; the baseline." in said
    said = sentences(calm, quiet, hidden, None, [], {"strict": one}, {}, search)
    assert "Predicted worse than by the baseline (strict): group a (0.300 to 0.600)." in said
    assert "Of 2 searches on simulated baselines none led by more than 2 nats; this one leads by 9 (p <= 0.33)." in said
    said = sentences(calm, quiet, hidden, None, [], {}, {}, search | {"null": [-1.0, -2.4]})
    assert any("none put a model with causes first; this one leads by 9" in one for one in said)


def test_what_an_adequate_baseline_does_not_exclude_is_told_apart(tmp_path):
    """Else the parameter of which the readings tell least is what to measure next."""
    found = diagnose(experiment(), ["a"], tmp_path, quick=True, catalogue=FEW)
    assert found.verdict == "adequate" and found.next_experiment["proposals"]
    open_ = [c for c in found.causes if c.terms and c.probability >= 0.05]
    assert found.next_experiment["about"].startswith("tells the baseline from" if open_ else "determines ")
    assert found.confusion == {"alike": []}


def test_the_order_in_which_groups_are_named_does_not_matter(tmp_path, monkeypatch):
    e = experiment(n=8)
    first = diagnose(e, ["c", "a"], tmp_path, quick=True, catalogue=FEW[:1])
    assert first.training == ["a", "c"]
    monkeypatch.delattr(diagnosis._Work, "all")
    assert diagnose(e, ["a", "c"], tmp_path, quick=True, catalogue=FEW[:1]).identity == first.identity


def test_the_search_finds_less_where_nothing_is_hidden(hidden, tmp_path):
    memory = Memory(tmp_path)
    found = significance(hidden, FEW, 3, seed=1, memory=memory)
    assert found.lead == lead(hidden) > 3 > max(found.null)
    assert found.p_value == 0.25
    assert found == significance(hidden, FEW, 3, seed=1, memory=memory)
    strong = replace(hidden, log_evidence={ids: (1e3 if ids == () else e) for ids, e in hidden.log_evidence.items()})
    assert significance(strong, FEW, 3, seed=1, memory=memory).p_value == 1.0


# --- memory and the whole -------------------------------------------------------------------------------------------


def test_memory_is_used_checked_and_repaired(tmp_path):
    memory = Memory(tmp_path)
    one = problem(experiment())
    calls = []

    def make():
        calls.append(1)
        return {"x": np.arange(3.0)}

    for _ in range(2):
        assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 1
    memory.recall("fit", one, 2, make)  # another seed is another thing
    assert len(calls) == 2
    for path in tmp_path.glob("*.npz"):
        path.write_bytes(path.read_bytes()[:40])
    assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 3
    memory.recall("fit", one, 2, make)
    # Whole, but not what was kept.
    for path in tmp_path.glob("*.npz"):
        with np.load(path) as stored:
            kept = dict(stored)
        np.savez(path, **{name: a + (name == "x") for name, a in kept.items()})
    assert memory.recall("fit", one, 1, make)["x"].tolist() == [0, 1, 2]
    assert len(calls) == 5


def few(readings: list[float], amplitude: float = 20.0) -> Experiment:
    n = len(readings)
    one = Group("a", "sine", "a.csv", np.geomspace(500, 2000, n), np.full(n, amplitude), np.array(readings))
    return Experiment("a rig", "a test", RIG, (one,), Path(), fingerprint(RIG, (one,)))


def test_what_meets_every_reading_is_not_tested():
    for e in (few([80.0]), few([80.0, 60.0, 40.0])):
        found = examine(fit(problem(e), (), seed=1, draws=64, most=4), FEW, seed=1, n_simulated=99)
        assert found.p_value == 1 and not found.wrong and not any(s.significant for s in found.statistics)


def test_a_diagnosis_that_makes_no_sense_is_refused(tmp_path):
    for e, groups, seed, said in (
        (few([0.0] * 5), ["a"], 1, "every launch range is zero"),
        (few([50.0] * 5), ["a", "a"], 1, "named twice"),
        (few([50.0] * 5), ["a"], -1, "seed -1"),
    ):
        with pytest.raises(InputError, match=said):
            diagnose(e, groups, tmp_path / "out", quick=True, seed=seed, catalogue=FEW)
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match="named twice"):
        Problem(few([50.0]), ("a", "a"))


def test_without_a_drive_nothing_is_proposed(tmp_path):
    found = diagnose(few([5.0, 0.0, 4.0, 0.0, 6.0], amplitude=0.0), ["a"], tmp_path, quick=True, catalogue=FEW[:1])
    assert found.next_experiment == {}


def rig_with_two_hills(seed: int) -> tuple[Problem, np.ndarray]:
    """A hardly damped stack with a lossy contact, which reads like a damped one with a stiff contact; and its truth."""
    design = read_experiment(Path(__file__).parents[1] / "experiments" / "psa")
    p = Problem(design, design.ids)
    truth = p.to_sampling(np.array([7.7e6, 51.0, 7600.0, 0.16, 0.013, 60.0]))
    readings = noise.draw(p.predict(truth[None]), p.noise_values(truth[None]), None, np.random.default_rng(seed))[0]
    return replace(p, experiment=design.with_readings(np.maximum(readings, 0.0))), truth


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_a_second_hill_of_the_baseline_is_not_lost(seed):
    """A look elsewhere finds it from any one hill; the posterior of all of them holds the truth."""
    rig, truth = rig_with_two_hills(seed)
    found = fit(rig, (), seed=1, draws=4096, most=48)
    assert np.abs(found.modes[:, 1] - truth[1]).min() < 1.5
    apart = found.modes[hills(found)]
    assert len(apart) > 1
    for k in range(len(apart)):
        alone = settle_at(rig, apart[[k]])
        assert hills(alone) == [0]
        again = scouted(alone, seed=1)
        assert np.abs(again.modes[:, :3] - truth[:3]).max(axis=1).min() < 1.5
        assert scouted(alone, seed=1).modes.tobytes() == again.modes.tobytes()
    lower, upper = (w := weigh(found, seed=1)).quantiles(rig.to_physical(w.draws), [0.05, 0.95])
    assert (lower[:3] < rig.to_physical(truth)[:3]).all() and (rig.to_physical(truth)[:3] < upper[:3]).all()


def test_hills_weigh_what_each_weighs_alone():
    """Seven nats lower and far wider, the second hill holds most of the posterior."""
    rig, _ = rig_with_two_hills(1)
    found = fit(rig, (), seed=1, draws=4096, most=48)
    leaders = hills(found)
    alone = [weigh(settle_at(rig, found.modes[[k]]), seed=2).log_evidence for k in leaders]
    assert found.heights[leaders[1]] < found.height - 5 and alone[1] > alone[0] + 1
    assert weigh(found, seed=2).log_evidence == pytest.approx(np.logaddexp.reduce(alone), abs=0.3)


@pytest.mark.parametrize("seed", [1, 4])
def test_a_top_behind_cliffs_is_found_by_a_population(seed):
    """A stack that hardly rings, and a lag that decides when the ball leaves: ranges jump, and climbs stop early."""
    design = read_experiment(Path(__file__).parents[1] / "experiments" / "psa")
    p = Problem(design, design.ids, tuple(t for t in TERMS if t.id == "amplifier_lag"))
    truth = p.to_sampling(np.array([134594.6, 9937.6, 35.3157, 6.4217e-7, 0.0362, 0.0536, 60.0]))
    y = noise.draw(p.predict(truth[None]), p.noise_values(truth[None]), None, np.random.default_rng(seed))[0]
    rig = replace(p, experiment=design.with_readings(np.maximum(y, 0.0)))
    there = float(ascend(rig, truth[None]).height[0])
    plain = fit(replace(rig, terms=()), (), seed=1, draws=4096, most=48)
    (beside,) = screen(plain, rig.terms)
    climbed = fit(rig, [plain], seed=1, extra=beside.starts)
    assert climbed.height < there - 3
    found = scouted(climbed, seed=1)
    assert found.height > there - 0.5
    assert scouted(climbed, seed=1).modes.tobytes() == found.modes.tobytes()


def test_what_a_model_raises_within_a_population_is_not_taken_for_scipys(monkeypatch):
    def fails(self, u):
        raise ValueError("out of the sensor's range")

    rig = problem(experiment(["amplifier_lag"], [8e-5], n=12, seed=3))
    known = rig.prior_transform(np.full((1, rig.n_dim), 0.5))
    monkeypatch.setattr(Problem, "log_posterior", fails)
    with pytest.raises(ValueError, match="sensor's range"):
        evolved(rig, known, seed=1)
    monkeypatch.setattr(Problem, "log_posterior", lambda self, u: np.full(len(u), -np.inf))
    monkeypatch.setattr(ascent, "heights", lambda problem, u, *rest: np.full(len(u), -np.inf))
    with pytest.raises(ConvergenceError, match="finite posterior"):
        fit(replace(rig, terms=()), (), seed=1)


@pytest.mark.slow
def test_hills_weigh_what_the_nested_sampler_finds():
    pytest.importorskip("nautilus")
    rig, _ = rig_with_two_hills(1)
    found = fit(rig, (), seed=1, draws=4096, most=48)
    nested = nested_evidence(rig, seed=2, n_live=300)
    assert weigh(found, seed=2).log_evidence == pytest.approx(nested.log_evidence, abs=0.5)


def test_a_hopeless_model_is_not_told_as_worse_than_what_is_within_it():
    """What falls behind its rival is not fitted to the end; it holds the smaller model's optimum all the same."""
    e = experiment(["amplifier_lag"], [8e-5], n=60, seed=3)  # enough readings for climbs on a quarter of them
    plain = fit(problem(e), (), seed=1, draws=1024, most=16)
    right = fit(replace(plain.problem, terms=FEW[:1]), [plain], seed=1)
    for term in FEW[1:]:
        behind = fit(replace(plain.problem, terms=(term,)), [plain], seed=1, rival=right, draws=32, most=2)
        assert behind.height < right.height - 15
        assert behind.log_likelihood > plain.log_likelihood - 0.5


def test_a_model_of_many_causes_is_built_up():
    """It ends no lower than a climb from the truth, and tells how far it is."""
    ids, values = ["amplifier_lag", "preload", "flight_friction"], [4e-5, 2e-5, 0.02]
    e = experiment(ids, values, n=16)
    whole = replace(problem(e), terms=terms(ids))
    told = []
    found = built_up(whole, seed=1, progress=lambda done, total: told.append((done, total)))
    assert told == [(k, 6) for k in range(1, 7)] and set(found.ids) == set(ids)
    at = dict(zip([p.name for p in whole.parameters[: whole.n_physical]], [*TRUTH, *values], strict=True))
    truth = whole.prior_transform(np.full(whole.n_dim, 0.5))
    truth[: whole.n_physical] = [p.to_sampling(at[p.name]) for p in whole.parameters[: whole.n_physical]]
    assert found.height > ascend(whole, truth[None]).height.max() - 0.5


def test_thinning_keeps_small_groups():
    e = experiment(n=24)
    assert [g.n_points for g in thinned(e, 3).groups] == [8, 8, 8]
    assert [g.n_points for g in thinned(experiment(n=6), 3).groups] == [6, 6, 6]


def test_diagnosis_from_beginning_to_end(tmp_path, monkeypatch):
    e = experiment(["amplifier_lag"], [4e-5])
    result = diagnose(e, ["a"], tmp_path / "one", seed=1, catalogue=FEW, searches=2, jobs=2)
    stored = json.loads((tmp_path / "one" / "diagnosis.json").read_text())
    assert stored["schema"] == 1
    assert stored["verdict"] in ("explained", "ambiguous")
    assert stored["named"] == ["amplifier_lag"]
    assert set(stored["misfit"]) >= {"p_value", "where"}
    for place in stored["misfit"]["where"]:
        assert set(place) == {"group", "variable", "from", "to", "text"}
    assert stored["causes"][0]["terms"] == ["amplifier_lag"]
    assert 0 < stored["causes"][0]["probability"] <= 1
    assert stored["misfit"]["search"]["lead"] > max(stored["misfit"]["search"]["null"])
    # Compared with searches like itself, which have no parts of the readings to begin from.
    plain = climb(Problem(e, e.ids, tolerance=diagnosis._TOLERANCE), FEW, seed=1)
    assert stored["misfit"]["search"]["lead"] == pytest.approx(lead(plain), abs=1e-9)
    assert stored["misfit"]["search"]["p_value"] == pytest.approx(1 / 3)
    tau = stored["causes"][0]["parameters"]["amplifier_lag_tau"]
    assert tau["lower"] < 4e-5 < tau["upper"]
    for protocol, seen in (("strict", {"a"}), ("nested", {"b", "c"})):
        gain = stored["gain"][protocol]
        assert (tmp_path / "one" / gain["predictions"]).exists()
        assert gain["log_rmse_after"] < gain["log_rmse_before"]
        assert seen <= {g for entry in gain["ledger"] for g in entry["saw"]}
    assert (tmp_path / "one" / stored["predictions"]).exists()
    # What the training group names by itself is a run like any other.
    named = {"adopted": stored["named"], "strict": stored["gain"]["strict"]["groups"][0]["named"]}
    seen = {"adopted": ["a", "b", "c"], "strict": ["a"]}
    assert set(stored["extension"]) == {which for which, ids in named.items() if ids} >= {"adopted"}
    for which, told in stored["extension"].items():
        extension = load(tmp_path / "one" / told["folder"])
        assert extension.fit.terms == told["terms"] == named[which]
        # Begun where the search has found these causes, and not left below that.
        place = extension.problem.to_sampling(np.array([list(extension.fit.known[0].values())]))
        assert list(extension.fit.known[0]) == list(extension.problem.names)
        assert extension.fit.minima[0].log_posterior > extension.problem.log_posterior(place)[0] - 0.01
        assert extension.fit.groups == told["groups"] == seen[which]
        assert told["scored_on"] == [g for g in e.ids if g not in seen[which]]
        assert told["converged"] == extension.summary.converged
    # Again from what is kept, and once more from nothing: the same.
    again = diagnose(e, ["a"], tmp_path / "one", seed=1, catalogue=FEW, searches=2)
    quick = diagnose(e, ["a"], tmp_path / "two", seed=1, catalogue=FEW, quick=True)
    assert again.causes == result.causes
    assert quick.causes == result.causes
    assert quick.gain == {} and quick.extension == {} and "search" not in quick.misfit
    # A whole answer is read back; what has lost a part is worked out.
    with monkeypatch.context() as m:
        m.delattr(diagnosis._Work, "all")
        assert diagnose(e, ["a"], tmp_path / "two", seed=1, catalogue=FEW, quick=True).causes == result.causes
        for change in ({"seed": 2}, {"catalogue": FEW[:1]}, {"quick": False}):
            with pytest.raises(AttributeError):
                diagnose(e, ["a"], tmp_path / "two", **{"seed": 1, "catalogue": FEW, "quick": True} | change)
        (tmp_path / "two" / quick.predictions).unlink()
        with pytest.raises(AttributeError):
            diagnose(e, ["a"], tmp_path / "two", seed=1, catalogue=FEW, quick=True)


@pytest.mark.parametrize("jobs", [1, 2])
def test_processes_search_what_one_would(jobs, tmp_path):
    """Two leave nothing to search, and what they leave is what one finds."""
    e = experiment(["amplifier_lag"], [4e-5], groups=("a", "b"), n=12)
    work = diagnosis._Work(e, ("a",), tmp_path, 1, FEW[:2], jobs, Silent(), ())
    with pytest.MonkeyPatch.context() as patch:
        if jobs == 2:
            patch.setattr(rungs, "fit", None)
        parts = work._parts()
    alone = [climb(Problem(e, (g,), tolerance=diagnosis._TOLERANCE), FEW[:2], seed=1).leader for g in ("b", "a")]
    assert [c.ids for c in parts] == [c.ids for c in alone]
    assert all(np.array_equal(c.modes, d.modes) for c, d in zip(parts, alone, strict=True))


def test_a_session_not_seen_may_err_as_the_prior_says():
    """The level of a session is unknown when one was seen; three that agree say that it is small."""
    rng = np.random.default_rng(1)
    spreads = []
    for groups in (("a",), ("a", "b", "c")):
        e = experiment(groups=groups)
        candidate = fit(Problem(e, groups), (), seed=1, draws=256, most=8)
        spreads.append(np.median(leftover(candidate).elsewhere(np.full(2000, 0.04), rng)))
    assert 0.03 < spreads[0] < 0.3
    assert spreads[1] < 0.7 * spreads[0]


def test_readings_that_say_nothing_do_not_dilute_a_leftover(sound):
    n = sound.problem.observed.size
    mean, sd = np.full(n, 0.5), np.full(n, 0.1)
    quiet = sound.problem.design.group == 1
    quiet[:20] = True
    mean[quiet], sd[quiet] = 0.0, np.inf
    found = Leftover(0.0, 0.0, 0.1, 0.1, 0.7, 0.04, mean, sd, np.zeros(5), np.eye(5)).largest(sound)
    assert [g for g, *_ in found] == ["a", "b", "c"]
    assert np.array_equal([told for _, *told in found], [[0.5, 0.5], [np.nan, np.nan], [0.5, 0.5]], equal_nan=True)


@pytest.mark.slow
def test_diagnosis_of_one_group_with_the_whole_catalogue(tmp_path):
    e = experiment(groups=("only",))
    result = diagnose(e, ["only"], tmp_path, seed=1, quick=True)
    assert result.verdict == "adequate"
    assert len(result.screening) == len(TERMS)


def test_prior_width_survives_draws_of_hardly_any_weight():
    """Weights far below the rest, where the other prior is far above the first, are not divided by."""
    found = weigh(fit(problem(experiment(n=8)), (), seed=1, draws=256, most=4), seed=1)
    weights = np.r_[1e-310, np.full(len(found.weights) - 1, 1 / (len(found.weights) - 1))]
    factor = np.r_[700.0, np.zeros(len(weights) - 1)]
    assert replace(found, weights=weights).mean_of(factor) == pytest.approx(0.0, abs=1e-3)


def test_screening_looks_between_where_gains_are_steep():
    """A cause that acts by thresholds helps in a narrow range, beside which it harms."""
    q = np.array([0.1, 0.3, 0.5, 0.9])
    assert _unclear(q, np.array([0.0, 0.0, -30.0, -31.0])) == pytest.approx([0.4])
    assert _unclear(q, np.array([0.0, 1.0, 2.0, 1.0])).size == 0
    # Far below the best nothing is worth a look.
    assert _unclear(q, np.array([40.0, 39.0, 0.0, -30.0])) == pytest.approx([0.4])


def test_what_is_kept_belongs_to_the_priors_it_was_found_with(tmp_path):
    """A prior stated after a first diagnosis: neither screenings nor evidences of the old one may be recalled."""
    one, memory = problem(experiment(n=8)), Memory(tmp_path)
    (wide,) = informed((Belief("amplifier_lag_tau", Normal(0.0, 4e-4), "seen"),), FEW[:1])[1]
    found = {}
    for term in (FEW[0], wide):
        found[term] = climb(one, (term,), seed=1, memory=memory)
        fresh = climb(one, (term,), seed=1)
        assert found[term].probability == fresh.probability
        assert found[term].screened[0].log_bayes == fresh.screened[0].log_bayes
    assert found[FEW[0]].screened[0].log_bayes != found[wide].screened[0].log_bayes


def test_another_rigs_diagnosis_is_not_replaced(tmp_path):
    """Two folders called rig have one usual place for their results."""
    (tmp_path / "diagnosis.json").write_text('{"fingerprint": "of other readings"}')
    with pytest.raises(InputError, match="of other readings"):
        diagnose(experiment(), ["a"], tmp_path, quick=True)
    assert [p.name for p in tmp_path.iterdir() if p.suffix == ".json"] == ["diagnosis.json"]


def test_a_late_kill_does_not_draw_an_extension_on(tmp_path, monkeypatch):
    """A chain that did not converge is drawn on by the command after a finished one, not by one that resumes."""
    monkeypatch.setattr(diagnosis, "_STEPS", 500)
    e = experiment(["amplifier_lag"], [4e-5], n=12, groups=("a", "b"))

    def interrupted(*words):
        raise KeyboardInterrupt

    def again(**options):
        return diagnose(e, ["a"], tmp_path, catalogue=FEW[:1], searches=0, **options).extension["adopted"]

    first = again()
    assert not first["converged"] and "after 500 steps" in first["message"]
    with monkeypatch.context() as m:  # the command that draws on is broken off: what there was stays
        m.setattr(diagnosis._Work, "_extend", interrupted)
        with pytest.raises(KeyboardInterrupt):
            again()
    assert (tmp_path / "diagnosis.json").exists()
    (tmp_path / "diagnosis.json").unlink()  # killed after the extension, before the end
    assert again() == first
    assert again(draw_on=False) == first
    assert again()["message"] != first["message"]


def test_a_diagnosis_lies_beside_the_fit_of_the_same_readings(tmp_path):
    e = experiment(n=8)
    settings = replace(Settings.of(problem(e)), max_steps=60, chunk=20)
    fitted = run_fit(e, ["a"], tmp_path, n_starts=4, settings=settings)
    with pytest.raises(InputError, match="already holds other files"):
        diagnose(experiment(n=8, seed=9), ["a"], tmp_path, quick=True, catalogue=FEW)
    found = diagnose(e, ["a"], tmp_path, quick=True, catalogue=FEW)
    assert found.fingerprint == fitted.fit.fingerprint
    assert load(tmp_path).summary == fitted.summary
    assert diagnose(e, ["a"], tmp_path, quick=True, catalogue=FEW) == found


def test_nothing_that_is_not_a_diagnosis_s_own_is_replaced(tmp_path):
    """Measurements of another rig, a fit, somebody's own notes: told before any work."""
    one, other = experiment(seed=1), experiment(seed=2)
    for name in ("experiment/experiment.toml", "fit.json", "diagnosis.json"):
        folder = tmp_path / name.replace("/", "-")
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text('{"my": "own"}')
        with pytest.raises(InputError, match="already holds other files"):
            diagnose(one, ["a"], folder, quick=True)
        assert [(p, p.read_text()) for p in folder.rglob("*") if p.is_file()] == [(folder / name, '{"my": "own"}')]
    # An interrupted one is known by its mark, and goes on for the same readings alone.
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / ".diagnosis.json.1.tmp").write_text("what a killed process left")
    diagnosis._claim(mine, one)
    (mine / "steps").mkdir()
    diagnosis._claim(mine, one)
    with pytest.raises(InputError, match="of other readings"):
        diagnosis._claim(mine, other)
    (mine / "diagnosis.html").mkdir()
    with pytest.raises(InputError, match="is a folder, where a file of the diagnosis goes"):
        diagnosis._claim(mine, one)


def test_a_stronger_effect_than_any_tried_is_looked_for_towards_neutral():
    """Where the weakest strength of the prior's quantiles is far too much, what helps lies below it."""
    lag = terms(["amplifier_lag"])[0].strength
    q, gain = _with_neutral(lag, np.array([0.02, 0.1]), np.array([-50.0, -90.0]))
    assert (q[0], gain[0]) == (0.0, 0.0) and _unclear(q, gain) == pytest.approx([0.01])
    ratio = terms(["stroke_tolerance"])[0].strength  # neutral in the middle
    q, gain = _with_neutral(ratio, np.array([0.1, 0.9]), np.array([5.0, -9.0]))
    assert q[1] == pytest.approx(ratio.prior_share(ratio.neutral)) and gain.tolist() == [5.0, 0.0, -9.0]
    # A layer of a hundredth of what is plausible shows where ranges are small.
    layer = terms(["soft_layer"])
    depth = float(layer[0].strength.to_physical(layer[0].strength.prior_quantile(0.004)))
    one = fit(problem(experiment(["soft_layer"], [depth], relative=0.005)), (), seed=1, draws=512, most=8)
    found = screen(one, layer)[0]
    assert found.strength[0] < float(layer[0].strength.to_physical(layer[0].strength.prior_quantile(0.02)))
    assert found.gain[found.best] > PRESENT and 0.5 < found.strength[found.best] / depth < 2.0

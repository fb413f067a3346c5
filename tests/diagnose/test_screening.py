"""Screening: what each cause could add."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import FEW, experiment, problem

from psafit.diagnose.screening import (
    PRESENT,
    gains_by_luck,
    screen,
    unclear_strengths,
    with_neutral,
)
from psafit.inference.candidate import candidate_of, fit
from psafit.inference.optimiser import maximise
from psafit.model_search.visibility import VISIBLE
from psafit.physics import terms


def test_screening_sees_a_hidden_cause():
    one = fit(problem(experiment(["amplifier_lag"], [4e-5])), (), seed=1, draws=512, most=8)
    found = {s.term.id: s for s in screen(one, FEW)}
    assert max(found.values(), key=lambda s: s.log_bayes).term.id == "amplifier_lag"
    assert found["amplifier_lag"].gain[found["amplifier_lag"].best] > PRESENT


def test_what_a_fit_has_left_to_optimise_is_no_causes_merit(sound):
    """At the edge of a jump a fit ends on a slope: every cause would seem to gain what its expansion gains without."""
    short = sound.modes[:1].copy()
    short[0, 0] += 0.1
    end = maximise(sound.problem, short, schedule=((0, 1),))
    assert end.log_posterior[0] < sound.log_posterior - 50
    onward = screen(candidate_of(sound.problem, end), FEW)
    for there, here in zip(onward, screen(sound, FEW), strict=True):
        assert there.log_bayes == pytest.approx(here.log_bayes, abs=0.7)


def test_what_is_called_visible_is_what_a_refit_leaves():
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


def test_what_differs_by_session_is_visible_by_its_values_there(sound):
    """Where all sessions have the same it is nothing; drawn from its prior it is so large on average."""
    (gain,) = terms(["reading_gain"])
    found = screen(sound, [gain])[0]
    large = replace(sound.problem, terms=(gain,))
    at, shared = sound.within(large)
    at[large.names.index(gain.strength.name)] = gain.strength.prior_quantile(0.5)
    rows = np.repeat(at[None, :], 400, axis=0)
    latent = [i for i, name in enumerate(large.names) if i not in shared and name != gain.strength.name]
    rows[:, latent] = np.random.default_rng(2).standard_normal((400, len(latent)))
    sizes = np.linalg.norm(sound.project_out(large.predict(rows) - sound.predicted), axis=1)
    assert found.visible == pytest.approx(np.sqrt(np.mean(sizes**2)), rel=0.15)
    assert found.visible > VISIBLE


def test_what_luck_gains_has_the_known_laws():
    """Of a strength on one side of neutral, on both, and of a quantity drawn anew."""
    nothing = np.random.default_rng(1).standard_normal((20000, 5))
    one_sided = np.linspace(0, 6, 121)[:, None] * np.eye(5)[2]
    found = [
        np.quantile(gains_by_luck(effects, [], nothing), 0.95)
        for effects in (one_sided, np.vstack([one_sided, -one_sided]))
    ]
    assert found == pytest.approx([0.5 * 1.645**2, 0.5 * 1.960**2], rel=0.05)
    drawn = gains_by_luck(np.zeros((1, 5)), [3.0 * np.eye(5)[[1]]], nothing)
    assert drawn == pytest.approx(0.5 * 0.9 * nothing[:, 1] ** 2)


def test_screening_looks_between_where_gains_are_steep():
    """A cause that acts by thresholds helps in a narrow range, next to which it harms."""
    q = np.array([0.1, 0.3, 0.5, 0.9])
    assert unclear_strengths(q, np.array([0.0, 0.0, -30.0, -31.0])) == pytest.approx([0.4])
    assert unclear_strengths(q, np.array([0.0, 1.0, 2.0, 1.0])).size == 0
    # Far below the best nothing is worth a look.
    assert unclear_strengths(q, np.array([40.0, 39.0, 0.0, -30.0])) == pytest.approx([0.4])


def test_a_stronger_effect_than_any_tried_is_looked_for_towards_neutral():
    """Where the weakest strength of the prior's quantiles is far too much, what helps lies below it."""
    lag = terms(["amplifier_lag"])[0].strength
    q, gain = with_neutral(lag, np.array([0.02, 0.1]), np.array([-50.0, -90.0]))
    assert (q[0], gain[0]) == (0.0, 0.0) and unclear_strengths(q, gain) == pytest.approx([0.01])
    ratio = terms(["stroke_tolerance"])[0].strength  # neutral in the middle
    q, gain = with_neutral(ratio, np.array([0.1, 0.9]), np.array([5.0, -9.0]))
    assert q[1] == pytest.approx(ratio.prior_share(ratio.neutral)) and gain.tolist() == [5.0, 0.0, -9.0]
    # A layer of a hundredth of what is plausible shows where ranges are small.
    layer = terms(["soft_layer"])
    depth = float(layer[0].strength.to_physical(layer[0].strength.prior_quantile(0.016)))
    one = fit(problem(experiment(["soft_layer"], [depth], relative=0.005)), (), seed=1, draws=512, most=8)
    found = screen(one, layer)[0]
    assert found.strength[0] < float(layer[0].strength.to_physical(layer[0].strength.prior_quantile(0.02)))
    assert found.gain[found.best] > PRESENT and 0.5 < found.strength[found.best] / depth < 2.0

"""Whose a gain is."""

from __future__ import annotations

from dataclasses import replace

import pytest
from truths import FEW, bump, experiment, problem

from psafit.diagnose.discrepancy import discrepancy
from psafit.diagnose.robustness import Robustness, robustness
from psafit.inference.candidate import fit


def whose(baseline, best_model):
    return robustness(baseline, best_model, discrepancy(baseline), discrepancy(best_model))


def test_whose_a_gain_is(hidden, sound):
    """A hidden lag gains in both frequency sweeps, and more than any smooth curve; a bump in one sweep is its own."""
    found = whose(hidden.baseline, hidden.best_model)
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

"""Causes that are confounded."""

from __future__ import annotations

from dataclasses import replace

from truths import experiment, problem

from psafit.diagnose.confusable import confusable
from psafit.inference.candidate import fit
from psafit.physics import TERMS, terms


def test_causes_that_are_confounded():
    """A cause and its double under another name do the same; a lag does something else."""
    e = experiment(["flight_friction"], [0.1], relative=0.02)
    (friction,) = terms(["flight_friction"])
    double = replace(friction, id="double", parameters=(replace(friction.strength, name="double_a"),))
    model = fit(replace(problem(e), terms=(friction,)), [fit(problem(e), (), seed=1)], seed=1)
    found = confusable(model, (*terms(["amplifier_lag", "reading_gain"]), friction, double))
    assert [(a.cause, a.other) for a in found] == [("flight_friction", "double")] and 0 <= found[0].degrees < 2
    assert confusable(fit(problem(e), (), seed=1), TERMS) == []

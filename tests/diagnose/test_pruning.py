"""The search from above."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import FEW, experiment, problem

from psafit.diagnose import pruning
from psafit.diagnose.pruning import prune
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import terms


@pytest.mark.slow
def test_a_search_from_above_leads_through_the_truth(three):
    few = 3  # the first cause goes by a quarter of the readings
    found = {c.ids: c for c in prune(three, FEW, seed=1, least=1, most=3, few=few)}
    true = ("amplifier_lag", "flight_friction", "reading_offset")
    assert true in found and {len(ids) for ids in found} == {1, 2, 3}
    right = replace(three, terms=terms(true))
    assert found[true].height > fit(right, [fit(three, (), seed=1)], seed=1).height - 0.5
    # None is worse than a part of it, but for the prior of what it has more.
    for c in found.values():
        for part in found.values():
            if len(part.ids) == len(c.ids) - 1 and set(part.ids) < set(c.ids):
                assert c.log_likelihood > part.log_likelihood - 3
    again = {c.ids: c for c in prune(three, FEW, seed=1, least=1, most=3, few=few)}
    assert all(np.array_equal(again[ids].modes, c.modes) for ids, c in found.items())


def test_no_hill_leads_nowhere(three, monkeypatch):
    """Where no draw of the prior can be evaluated, there is nothing from above."""
    monkeypatch.setattr(Problem, "predict", lambda self, u, *_: np.full((len(u), self.observed.size), np.nan))
    assert prune(three, FEW, seed=1, least=1, most=3) == []


@pytest.mark.slow
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

"""Probabilities of models."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from truths import FEW

from psafit.diagnose import ladder
from psafit.diagnose.ladder import SIZE_WEIGHTS, log_prior


def test_prior_probabilities_of_models_sum_to_one():
    for n in (1, 3, 23):
        sizes = range(min(n, len(SIZE_WEIGHTS) - 1) + 1)
        assert sum(math.comb(n, k) * math.exp(log_prior(k, n)) for k in sizes) == pytest.approx(1)


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


@pytest.mark.parametrize("best", [0.96, 0.5])
def test_no_set_more_probable_than_a_listed_one_is_left_out(best):
    """Sets of no more causes that fit as well are listed however improbable; then all between them are."""
    likely = {"a": best, "bc": 0.015, "d": 0.013, "ef": 0.001}

    def fitted(ids, height):
        return SimpleNamespace(ids=tuple(ids), log_likelihood=height, problem=SimpleNamespace(n_dim=3 + len(ids)))

    models = [fitted("a", -10.0), fitted("bc", -9.0), fitted("d", -11.0), fitted("ef", -30.0)]
    probability = {tuple(ids): p for ids, p in likely.items()}
    found = ladder.Ladder(tuple(models), probability, {("g",): 0.014}, {}, {}, ()).rivals(("a",))
    assert found[:3] == (("b", "c"), ("g",), ("d",))
    assert len(found) == (3 if best > 0.95 else 4)

"""Verdicts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from truths import FEW, experiment, problem

from psafit.diagnose.discrepancy import discrepancy
from psafit.diagnose.misfit import ALPHA, Coincidence, examine
from psafit.diagnose.verdict import conclude
from psafit.inference.candidate import fit
from psafit.model_search import search_models
from psafit.records import Broken

PAIR = Coincidence("frequency", (("a", 1), ("c", 1)), 200.0, 200.0, 0.2, 3.0, 0.01)
"""Two readings of different groups that stand out together."""
LAW = Broken("carried", ["amplifier_lag"], "a", 200.0, 20.0, 1.0, 2.0, 3, "group a")


def test_verdicts(hidden, sound):
    # Few readings let a large scatter stand for the cause; more do not.
    more = fit(problem(experiment(["amplifier_lag"], [4e-5], n=60)), (), seed=1, draws=2048, most=24)
    before = examine(more, FEW, seed=1, n_simulated=199)
    after = examine(hidden.best_model, FEW, seed=1, n_simulated=199)
    assert before.objection == "tests"
    assert after.objection != "tests"
    left = discrepancy(hidden.best_model)
    bare = discrepancy(hidden.baseline)
    found = conclude(hidden, before, after, left, bare)
    assert found.verdict in ("explained", "ambiguous")
    assert found.named == ("amplifier_lag",)
    assert found.inclusion["amplifier_lag"] > 0.95
    # The same model set whose best model leaves structure is not an explanation.
    spoilt = replace(after, p_value=ALPHA / 2)
    rejected = conclude(hidden, before, spoilt, replace(left, log_bayes=-9.0), replace(bare, log_evidence=-np.inf))
    assert rejected.verdict == "unexplained"
    # Nor are its causes as probable as a test that finds structure allows, be that structure smooth or not.
    odds = 1 / 9 * -1 / (np.e * spoilt.p_value * np.log(spoilt.p_value))
    assert rejected.unnamed == pytest.approx(odds / (1 + odds)) and 0.4 < rejected.unnamed < 0.5
    assert sum(rejected.probability.values()) <= 1 - rejected.unnamed
    # It is held to what is asked of an adequate baseline: no readings together, no need of heavy tails.
    for change, p in (({"coincidences": (PAIR,)}, PAIR.p_value), ({"usual_tails": ALPHA / 4}, ALPHA / 4)):
        leaning = conclude(hidden, before, replace(after, **change), left, replace(bare, log_evidence=-np.inf))
        assert (leaning.verdict, leaning.unexplained_by) == ("unexplained", "structure")
        odds = 1 / 9 * -1 / (np.e * p * np.log(p))
        assert leaning.unnamed == pytest.approx(odds / (1 + odds))
    # A rival of equal probability makes a tie.
    p = hidden.probability[("amplifier_lag",)]
    tied = replace(hidden, probability=hidden.probability | {("amplifier_lag",): p / 2, ("flight_friction",): p / 2})
    tie = conclude(tied, before, after, left, bare)
    assert tie.verdict == "ambiguous"
    assert tie.alternatives[0] == ("flight_friction",) and ("flight_friction",) not in tie.by_likelihood
    # So does one that fits as well, held back by what is plausible alone; not one that is absurd, or has more causes.
    best_model, other = hidden.of(("amplifier_lag",)), hidden.of(("flight_friction",))
    assert best_model.log_likelihood - other.log_likelihood > 4.0
    verdicts = {}
    for behind in (2.0, 4.0):
        close = replace(
            other, log_posteriors=other.log_posteriors + best_model.log_likelihood - other.log_likelihood - behind
        )
        for p in (0.02, 1e-4):
            candidates = tuple(close if c is other else c for c in hidden.candidates)
            share = dict.fromkeys(hidden.probability, 0.0) | {best_model.ids: 0.98 - p, other.ids: p}
            verdicts[behind, p] = conclude(
                replace(hidden, candidates=candidates, probability=share), before, after, left, bare
            )
    assert {key for key, v in verdicts.items() if v.verdict == "ambiguous"} == {(2.0, 0.02)}
    assert verdicts[2.0, 0.02].alternatives == verdicts[2.0, 0.02].by_likelihood == (other.ids,)
    # Causes that share the probability take nothing from what has no name: it has a tenth before the readings.
    doubtful = replace(left, log_bayes=np.log(9 * 1.5))
    hopeless = replace(bare, log_evidence=-np.inf)
    assert conclude(hidden, before, after, doubtful, hopeless).unnamed == pytest.approx(0.6)
    assert conclude(tied, before, after, doubtful, hopeless).unnamed == pytest.approx(0.6)
    assert conclude(tied, before, after, doubtful, hopeless).verdict == "unexplained"
    # The chance that the search has missed a set is a part of every probability.
    sure, unsure = (conclude(replace(tied, missed=m), before, after, left, bare).probability for m in (0.0, 0.1))
    assert all(unsure[ids] == pytest.approx(0.9 * p) for ids, p in sure.items()) and sum(sure.values()) > 0
    # So does what has no name in their place: a set of causes is no likelier for being a set of causes.
    none = replace(left, log_bayes=-50.0, log_evidence=left.log_evidence - left.log_bayes - 50.0)
    # (What does not show is counted with the best model, but has no part in the best model's prior.)
    own = hidden.at_work[best_model.ids]
    odds = own * np.exp(hidden.log_prior(()) - hidden.log_prior(best_model.ids)) / 9
    as_good = replace(bare, log_evidence=none.log_evidence + 50.0)
    assert conclude(hidden, before, after, none, as_good).unnamed == pytest.approx(odds / (1 + odds))
    better = conclude(hidden, before, after, none, replace(as_good, log_evidence=as_good.log_evidence + 10))
    assert (better.verdict, better.unexplained_by) == ("unexplained", "smooth")
    # That part vanishes where larger sets, which do not show, have almost all that is counted with the best.
    small = dict(hidden.at_work) | {best_model.ids: 1e-12}
    assert conclude(replace(hidden, at_work=small), before, after, none, as_good).unnamed < 1e-9
    # A set that fits breaks no law, and none of its values is implausible, or it explains nothing.
    odd = conclude(hidden, before, after, none, hopeless, strange=["amplifier_lag_tau"])
    assert (odd.verdict, odd.unexplained_by, odd.named) == ("unexplained", "values", ("amplifier_lag",))
    # What has no name and keeps a part next to an explanation is reported with it.
    doubted = conclude(hidden, before, after, replace(left, log_bayes=np.log(9 * 0.25)), hopeless)
    assert doubted.verdict == "explained" and doubted.unnamed == pytest.approx(0.2)


def test_a_set_that_breaks_a_law_is_no_explanation_though_others_do_as_well(hidden):
    p = hidden.probability[("amplifier_lag",)] / 2
    tied = replace(hidden, probability=hidden.probability | {("amplifier_lag",): p, ("flight_friction",): p})
    after = replace(examine(hidden.best_model, FEW, seed=1, n_simulated=99), p_value=0.5, coincidences=())
    none = replace(discrepancy(hidden.best_model), log_bayes=-50.0)
    hopeless = replace(discrepancy(hidden.baseline), log_evidence=-np.inf)
    for change, why in (({"laws": [LAW]}, "law"), ({"strange": ["amplifier_lag_tau"]}, "values"), ({}, "")):
        found = conclude(tied, replace(after, p_value=ALPHA / 2), after, none, hopeless, **change)
        assert (found.verdict, found.unexplained_by) == ("ambiguous", why)


def test_verdicts_where_nothing_is_hidden(sound):
    plain = search_models(sound.problem, FEW, seed=1)
    quiet = replace(examine(plain.baseline, FEW, seed=1, n_simulated=199), coincidences=())
    nothing = discrepancy(sound)
    assert conclude(plain, quiet, None, nothing, nothing).verdict == "adequate"
    # A baseline that the tests reject is not held for probable.
    odd = conclude(plain, replace(quiet, p_value=0.005), None, replace(nothing, log_bayes=-9.0), nothing)
    assert odd.verdict == "unexplained" and odd.unnamed > 0.6 and odd.probability[()] < 0.4
    # Nor is it adequate where readings stand out together, or only for heavy tails.
    for change in ({"coincidences": (PAIR,)}, {"usual_tails": ALPHA / 2}):
        doubted = conclude(plain, replace(quiet, **change), None, nothing, nothing)
        assert (doubted.verdict, doubted.named) == ("unexplained", ())

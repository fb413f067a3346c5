"""Words for what a search has found."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from truths import FEW, experiment, narrow, problem

from psafit.diagnose.gain import worse
from psafit.diagnose.leftover import leftover
from psafit.diagnose.misfit import examine
from psafit.diagnose.record import NEAREST, UNSEEN
from psafit.diagnose.screening import VISIBLE, screen
from psafit.diagnose.told import _cause, _word, furthest, misfit_of, sentences
from psafit.inference.sample import sample
from psafit.model_search import search_models
from psafit.parameters import Belief, Normal
from psafit.physics import terms


def test_the_word_for_a_cause(hidden):
    """What is named, tied, good for a part, absent, or could not have been seen."""
    found = {s.term.id: s for s in screen(hidden.baseline, FEW)}
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


@pytest.mark.slow
def test_values_that_nobody_expects_are_flagged():
    """A lag far beyond what is believed of it, and nothing else; the wider its prior, the more evidence it has."""
    e = experiment(["amplifier_lag"], [4e-5])
    told = Belief("amplifier_lag_tau", Normal(0.0, 1.2e-5), "a data sheet")
    verdict = SimpleNamespace(named=("amplifier_lag",), probability={("amplifier_lag",): 1.0})
    for beliefs, flagged in (((), []), ((told,), ["amplifier_lag_tau"])):
        one = problem(replace(e, beliefs=beliefs))
        lag = replace(one, terms=terms(["amplifier_lag"])).terms
        ladder = search_models(one, lag, seed=1)
        cause = _cause(ladder, verdict, ladder.of(("amplifier_lag",)))
        assert cause.implausible == flagged
    widths = cause.evidence["prior_width"]
    assert widths["twice"] > 1 > 0 > widths["half"]
    wide = problem(replace(e, beliefs=(replace(told, prior=Normal(0.0, 2.4e-5)),)))
    wider = sample(replace(wide, terms=terms(["amplifier_lag"])), [ladder.baseline], seed=1)[1]
    assert widths["twice"] == pytest.approx(wider.log_evidence - cause.evidence["log_evidence"], abs=0.7)


def test_groups_that_are_predicted_worse_are_named(hidden):
    """Beyond chance, and where a reading can tell."""
    rows = [("a", [0.1, 0.4], ""), ("b", [-0.1, 0.4], ""), ("c", [0.1, 0.4], "too quiet"), ("d", [None, None], "")]
    gain = {"groups": [{"group": g, "log_rmse_interval": ends, "silent": why} for g, ends, why in rows]}
    assert [g["group"] for g in worse(gain)] == ["a"]
    scores = {"log_rmse_before": 0.3, "log_rmse_after": 0.6}
    one = {"groups": [{**gain["groups"][0], **scores}], **scores, "log_rmse_interval": [0.1, 0.4]}
    calm = SimpleNamespace(reasons=(), alternatives=(), named=())
    quiet = SimpleNamespace(wrong=False)
    search = {"lead": 9.2, "null": [-1.0, 2.4], "p_value": 1 / 3, "stored": False}
    tied = SimpleNamespace(reasons=(), alternatives=(("c",), ()), named=("a", "b"))
    said = sentences(tied, quiet, hidden, None, [], {}, {}, None)
    assert "Not to be told apart from a + b: c; the baseline." in said
    said = sentences(calm, quiet, hidden, None, [], {"strict": one}, {}, search)
    assert "Predicted worse than by the baseline (strict): group a (0.300 to 0.600)." in said
    assert "Of 2 searches on simulated baselines none led by more than 2 nats; this one leads by 9 (p <= 0.33)." in said
    said = sentences(calm, quiet, hidden, None, [], {}, {}, search | {"null": [-1.0, -2.4]})
    assert any("none put a model with causes first; this one leads by 9" in one for one in said)
    stored = search | {"stored": True, "readings": [56, 150]}
    said = sentences(calm, quiet, hidden, None, [], {}, {}, stored)
    where = "designs of 56 to 150 readings with nothing hidden (stored table, this catalogue)"
    assert f"Of 2 searches on {where} none led by more than 2 nats; this one leads by 9 (p <= 0.33)." in said
    unknown = {"lead": 9.2, "null": [], "p_value": None, "stored": True, "readings": [], "missing": "catalogue"}
    said = sentences(calm, quiet, hidden, None, [], {}, {}, unknown)
    assert any("is not known: the stored table is of another catalogue (--searches 19" in one for one in said)


def test_the_readings_furthest_from_what_is_adopted_are_always_told(hidden):
    """And that heavy tails take them up, where they do."""
    e = experiment(spoil=narrow)
    ladder = search_models(problem(e), FEW, seed=1)
    before = examine(ladder.baseline, FEW, seed=1, n_simulated=99)
    misfit = misfit_of(before, None, leftover(ladder.baseline), ladder.baseline, ladder.leader)
    text = furthest(ladder, SimpleNamespace(verdict="adequate"), misfit)
    hz = e.group("a").frequency_hz[9]
    assert text.startswith("Furthest from the baseline: group ") and text.count(f"{hz:.6g} Hz") == 2
    assert "heavy tails (nu 2" in text
    assert [w["group"] for w in misfit["where"][:2]] == ["a", "c"] and "as there in group c" in misfit["where"][0][
        "text"
    ]
    quiet = misfit_of(
        examine(hidden.leader, FEW, seed=1, n_simulated=99), None, leftover(hidden.leader), hidden.leader, hidden.leader
    )
    named = SimpleNamespace(verdict="explained")
    assert "heavy tails" not in furthest(hidden, named, {"extended": quiet["baseline"]})

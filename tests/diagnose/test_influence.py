"""Which readings a cause lives on."""

from __future__ import annotations

import warnings
from dataclasses import replace

import arviz as az
import numpy as np
import pytest
from diagnoses_by_hand import build, make_experiment, make_record

from psafit.diagnose.answer import answer
from psafit.diagnose.answer.grounds import LivesOn
from psafit.diagnose.influence import Carried, Influence, carrying_half, influence
from psafit.diagnose.words import PLAIN
from psafit.model_search import ModelSet


def test_fewest_readings_that_give_half() -> None:
    assert carrying_half([4.0, 1.0, 1.0, 1.0, 1.0]) == 1
    assert carrying_half([1.0, 1.0, 1.0, 1.0]) == 2
    assert carrying_half([1.0, 1.0, 2.0, -50.0]) == 1  # what speaks against it takes nothing from what speaks for it
    assert carrying_half([-1.0, 0.0]) == carrying_half([]) == 0


def test_a_cause_lives_on_the_readings_that_it_changes(hidden: ModelSet) -> None:
    """A lag of 40 us changes the fast readings; and the sum is the difference of ArviZ' LOO."""
    lag = ("amplifier_lag",)
    assert influence(hidden, (), seed=1) is None
    found = influence(hidden, lag, seed=1)
    (carried,) = found.causes
    problem = hidden.best_model.problem
    nats, fast = np.array(carried.nats), problem.design.frequency > 2000
    assert carried.total == pytest.approx(nats.sum()) == pytest.approx(sum(x for _, x in carried.groups))
    assert 0.5 * hidden.gain(lag) < carried.total < 1.2 * hidden.gain(lag)
    assert nats[fast].sum() > 0.6 * carried.total and carried.half < 0.4 * nats.size
    expected = []
    for ids in (lag, ()):
        model = hidden.of(ids).problem
        each = model.pointwise_log_likelihood(hidden.draws(ids, 1).resampled(400))
        stored = az.from_dict(posterior={"x": np.zeros((1, 400))}, log_likelihood={"y": each[None]})
        with warnings.catch_warnings():  # of readings with heavy tails
            warnings.simplefilter("ignore", UserWarning)
            expected.append(az.loo(stored, reff=1.0).elpd_loo)
    assert carried.total == pytest.approx(expected[0] - expected[1], abs=0.05)
    assert len(found.tail) == nats.size and np.mean(np.array(found.tail) < 0.7) > 0.9


@pytest.mark.usefixtures("undrawn")
def test_the_page_shows_them(tmp_path) -> None:
    e = make_experiment()
    n = sum(g.n_points for g in e.groups)
    nats, tail = np.full(n, 0.1), np.full(n, 0.2)
    nats[3], nats[5], tail[3] = 9.0, -2.0, 0.83
    groups = [(1, 9.4), (2, 1.4), (3, 0.3)]
    found = Influence([Carried("hysteresis", nats.tolist(), float(nats.sum()), 1, groups)], tail.tolist())
    record = replace(make_record(e), influence=found)
    (said,) = [s.say(PLAIN) for s in answer(record) if isinstance(s, LivesOn)]
    assert said == "Half of what speaks for hysteresis comes from 1 of the 42 readings, most in group 1."
    page = build(record, e, tmp_path)
    assert "Readings that support a cause" in page.text and "1 reading of 42 gives half" in page.text
    assert "Group 1 200 Hz 20.0 V 0.83" in page.text

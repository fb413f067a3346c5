"""Strength against what an oracle would see."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rigs import measure

from psafit.challenge.strength import find, lost_nats
from psafit.physics import term
from psafit.simulate import Design


@pytest.mark.slow
def test_an_even_misfit_costs_what_the_wider_scatter_costs() -> None:
    """Residuals of size 1 all over double the variance: n/2 ln 2."""
    n = 4000
    assert lost_nats(np.where(np.arange(n) % 2, 1.0, -1.0)) == pytest.approx(0.5 * n * math.log(2), rel=0.05)
    assert lost_nats(np.zeros(n)) == 0.0


def test_few_wild_readings_cost_little() -> None:
    """Heavy tails swallow them: far less than the same sum of squares spread evenly."""
    even, wild = np.full(400, 1.0), np.zeros(400)
    wild[:4] = 10.0
    assert lost_nats(wild) < 0.5 * lost_nats(even)


def test_strength_is_what_was_asked_for_or_says_that_it_is_not() -> None:
    known = measure(np.random.default_rng(5))
    theta = np.array([4e5, 9e3, 60.0])
    design = Design.of(known.constants, known.groups)
    scatter = {"sigma_rel": 0.05, "sigma_abs": 0.05, "nu": None}
    lag = term("amplifier_lag")
    none = np.empty(0)
    weak, strong = (find(lag, 1, none, theta, design, scatter, nats) for nats in (10.0, 60.0))
    assert weak.reached and strong.reached and weak.value < strong.value
    assert weak.nats == pytest.approx(10.0, rel=0.25) and strong.nats == pytest.approx(60.0, rel=0.25)
    # Linear swings do not feel gravity's small part of it: no plausible drag is seen.
    drag = find(term("swing_drag"), 1, none, theta, design, scatter, 500.0)
    assert not drag.reached and drag.nats < 250.0

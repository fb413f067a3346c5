"""The largest stable step, by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from psafit.experiment import read_experiment
from psafit.simulate.reference import ContactParameters
from psafit.simulate.stability import contact_matrix, largest_stable_step, rk4_growth

PSA = Path(__file__).parents[2] / "experiments" / "psa"


def test_growth_and_limit_by_hand() -> None:
    assert rk4_growth(-1.0, 1.0) == pytest.approx(1 - 1 + 0.5 - 1 / 6 + 1 / 24)
    assert rk4_growth(1j, 2.0) == pytest.approx(abs(1 + 2j - 2 - 8j / 6 + 16 / 24))
    # On the imaginary axis the limit is 2 sqrt 2; slightly damped, a little to its left.
    assert largest_stable_step(np.array([-1e-6 + 1j])) == pytest.approx(math.sqrt(8), rel=1e-3)
    assert largest_stable_step(np.array([1.0 + 0j])) == math.inf


def test_contact_matrix_conserves_momentum_between_stack_and_ball() -> None:
    c = read_experiment(PSA).constants
    matrix = contact_matrix(ContactParameters(2e5, 0.0, 30.0), c)
    total = c.m * matrix[1] + c.M * matrix[3]  # only the anchoring spring is left
    assert total == pytest.approx([-c.k_s, 0, 0, 0], abs=1e-6)

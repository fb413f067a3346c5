"""Three causes at once."""

from __future__ import annotations

import pytest
from truths import experiment, problem


@pytest.fixture(scope="session")
def three():
    """Three causes at once, and readings in which each of them shows."""
    return problem(experiment(["amplifier_lag", "flight_friction", "reading_offset"], [4e-5, 0.05, 5e-6], n=60))

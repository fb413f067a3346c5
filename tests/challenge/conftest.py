"""A challenge with one cause hidden."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rigs import measure

from psafit.challenge.hide import make
from psafit.experiment import Experiment


@pytest.fixture(scope="session")
def known() -> Experiment:
    """Fewer readings than elsewhere: the literal reference simulates each of them in tens of milliseconds."""
    return measure(np.random.default_rng(5), readings=(10, 7, 5))


@pytest.fixture(scope="session")
def lagged(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One cause, of 30 nats as the search expects it."""
    folder = tmp_path_factory.mktemp("challenge") / "lagged"
    make(3, folder, design_of=known, terms=["amplifier_lag"], strength=30.0)
    return folder

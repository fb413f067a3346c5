"""The study's scheme."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from psafit.errors import InputError
from psafit.experiment import read_experiment
from psafit.reproduce import convergence
from psafit.simulate.reference import ContactParameters, Point

PSA = Path(__file__).parents[2] / "experiments" / "psa"


def test_a_step_without_any_stable_one_near_it_is_refused() -> None:
    point, parameters = Point("sine", 1200.0, 20.0), ContactParameters(1.425e5, 13991.0, 68.0)
    with pytest.raises(InputError, match="far beyond the stable"):
        convergence(point, parameters, read_experiment(PSA).constants, 1e-3 * np.geomspace(0.98, 0.5, 4), 1e-3)

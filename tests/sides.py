"""One side of a comparison, made by hand."""

from __future__ import annotations

import numpy as np

from psafit.compare import Estimate, Predicted, Side
from psafit.experiment import Group


def made(name: str, factor: float, *, role: str = "holdout", spread: float = 0.1) -> Side:
    """A result whose predictions are all off by a factor."""
    f = np.geomspace(100, 1e4, 30)
    y = 20 * (f / 100) ** -0.3
    reported = [
        Predicted(Group(id, "sine", "x.csv", f, np.full(30, 20.0), y), r, factor * y, factor * y / 2, factor * y * 2,
             np.full(30, -factor))
        for id, r in ((1, "fit"), ("two", role))
    ]  # fmt: skip
    low, high = np.exp(-spread) * factor, np.exp(spread) * factor
    parameters = {"k_c": Estimate(1e6 * factor, 1e6 * low, 1e6 * high, "N/m", "contact stiffness", "determined")}
    return Side(name, "fit", "Made up", [1], [], {"data": "same", "seed": name}, parameters, reported)

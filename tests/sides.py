"""One side of a comparison, made by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.compare import Estimate, Predicted, Side
from psafit.experiment import Group, GroupId


def made(name: str, factor: float, *, role: str = "holdout", spread: float = 0.1) -> Side:
    """A result whose predictions are all off by a factor."""
    f = np.geomspace(100, 1e4, 30)
    y = 20 * (f / 100) ** -0.3
    reported = [
        Predicted(Group(id, "sine", "x.csv", f, np.full(30, 20.0), y), r, factor * y, factor * y / 2, factor * y * 2,
             np.full(30, -factor))
        for id, r in ((1, "fit"), ("two", role))
    ]  # fmt: skip
    return _side(name, factor, spread, reported)


def made_of(name: str, factor: float, groups: Sequence[Group], fitted: GroupId) -> Side:
    """Make a side of given groups, of which one was fitted, each observable by itself."""
    reported = [
        Predicted(g, "fit" if g.id == fitted else "holdout", factor * g.reading, 0.5 * g.reading, 2 * g.reading,
             np.full(g.n_points, -factor))
        for whole in groups for g in whole.parts
    ]  # fmt: skip
    return _side(name, factor, 0.1, reported)


def _side(name: str, factor: float, spread: float, reported: list[Predicted]) -> Side:
    low, high = np.exp(-spread) * factor, np.exp(spread) * factor
    parameters = {"k_c": Estimate(1e6 * factor, 1e6 * low, 1e6 * high, "N/m", "contact stiffness", "determined")}
    return Side(name, "fit", "Made up", [1], [], {"data": "same", "seed": name}, parameters, reported)

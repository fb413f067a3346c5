"""The conditions of a simulation check themselves."""

from __future__ import annotations

from typing import Any

import pytest
from conftest import RIG

from psafit.simulate import Design


@pytest.mark.parametrize(
    "change, argument",
    [
        ({"frequency": float("nan")}, "frequency"),
        ({"frequency": float("inf")}, "frequency"),
        ({"frequency": 0.0}, "frequency"),
        ({"frequency": [100.0, -1.0]}, "frequency"),
        ({"frequency": 1.1e9}, "frequency"),
        ({"amplitude": -1.0}, "amplitude"),
        ({"amplitude": float("nan")}, "amplitude"),
        ({"amplitude": float("inf")}, "amplitude"),
        ({"waveform": "triangle"}, "waveform"),
        ({"waveform": ""}, "waveform"),
    ],
)
def test_impossible_conditions_are_refused_by_name(change: dict[str, Any], argument: str) -> None:
    conditions = {"waveform": "sine", "frequency": 1000.0, "amplitude": 20.0} | change
    with pytest.raises(ValueError, match=f"^{argument} must be"):
        Design.sweep(RIG, **conditions)


def test_limits_themselves_are_possible() -> None:
    assert Design.sweep(RIG, "square", 1e9, 0.0).n_points == 1
    with pytest.raises(ValueError, match=r"^waveform must be"):
        Design(RIG, [2], [1.0], [1.0], [0])  # type: ignore[arg-type]

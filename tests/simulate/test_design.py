"""The conditions of a simulation check themselves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rigs import RIG

from psafit.challenge.hide import simulate_literally
from psafit.experiment import Group, Occasions, session_name
from psafit.physics import terms
from psafit.simulate import Design, columns, simulate


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
        ({"waveform": "wobbly"}, "waveform"),
        ({"waveform": ""}, "waveform"),
    ],
)
def test_impossible_conditions_are_refused_by_name(change: dict[str, Any], argument: str) -> None:
    conditions = {"waveform": "sine", "frequency": 1000.0, "amplitude": 20.0} | change
    with pytest.raises(ValueError, match=f"^{argument} must be"):
        Design.sweep(RIG, **conditions)


def test_limits_themselves_are_possible() -> None:
    assert Design.sweep(RIG, "square", 1e9, 0.0).n_points == 1
    with pytest.raises(ValueError, match=r"^drive must be"):
        Design(RIG, [2], [1.0], [1.0], [0])  # type: ignore[arg-type]


def test_groups_of_other_rigs_are_simulated_as_such() -> None:
    """As each alone, whatever their order, also where sessions have something for themselves, and literally."""
    light = (("M", 0.013), ("l", 0.04))
    f, v = np.array([300.0, 1200.0, 4000.0]), np.array([20.0, 15.0, 10.0])
    groups = [
        Group("a", "sine", "", f, v, np.ones(3), changed=light),
        Group("b", "square", "", f[:2], v[:2], np.ones(2)),
        Group("c", "sine", "", f, v, np.ones(3), changed=light),
    ]
    rig = replace(RIG, M=0.013, l=0.04)
    assert [g.rig(RIG) for g in groups] == [rig, RIG, rig]
    design = Design.of(RIG, groups)
    assert [rows.tolist() for _, rows in design.of_rigs] == [[3, 4], [0, 1, 2, 5, 6, 7]]
    assert design.point(4).constants == RIG and design.point(6).constants == rig
    assert Design.of(RIG, groups[:1]).constants == rig  # all of one rig: it is the rig
    cases: list[tuple[tuple[str, ...], list[float], list[float]]] = [
        ((), [], []),
        (("gap", "reading_gain"), [2e-7, 0.1], [0.5, -1.0, 0.3]),
        (("session_lean",), [3e-3, 0.4], [0.5, -1.0, 0.3]),
        (("gap", "session_lean"), [2e-7, 3e-3, 0.4], [0.5, -1.0, 0.3]),
    ]
    for causes, own, latent in cases:
        chosen = terms(causes)
        sets = np.array([[4e5, 9e3, 60.0, *own, *latent], [1e6, 9e2, 6.0, *own, *latent]])
        together = simulate(design, sets, chosen)
        first = 0
        for k, g in enumerate(groups):
            alone = np.column_stack([sets[:, : 3 + len(own)], sets[:, 3 + len(own) + k]]) if latent else sets
            found = simulate(Design.sweep(g.rig(RIG), g.waveform, g.frequency_hz, g.amplitude_v), alone, chosen)
            span = slice(first, first + g.n_points)
            for name in ("launch_range", "separation_speed", "launched"):
                assert np.array_equal(getattr(together, name)[:, span], getattr(found, name)), name
            first += g.n_points
        names = columns(chosen)[: 3 + len(own)]
        parameters = dict(zip(names, sets[0].tolist(), strict=False))
        parameters |= {session_name(chosen[-1].latent.name, g.id): z for g, z in zip(groups, latent, strict=False)}  # type: ignore[union-attr]
        literal = simulate_literally(design, parameters, chosen, Occasions.of(groups))
        assert together.launch_range[0] * 1e6 == pytest.approx(literal, rel=1e-5)

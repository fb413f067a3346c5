"""Strengths far beyond the plausible: a diagnosis names their cause, and flags the value."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_hidden_effects import blank

from psafit.challenge.campaign import read_diagnosis
from psafit.challenge.hide import simulate_literally
from psafit.challenge.score import reported_set
from psafit.diagnose import diagnose
from psafit.diagnose.settings import Settings
from psafit.experiment import Occasions
from psafit.physics import owner, terms
from psafit.simulate import Design


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "name", "hidden"),
    [
        ({"k_c": 1.1e6, "c_s": 500.0, "c_c": 60.0}, "preload_offset", 12e-3),
        ({"k_c": 1e6, "c_s": 400.0, "c_c": 60.0}, "adhesion_force", 0.25),
    ],
    ids=["a lean of 12 mm", "a bond of 0.25 N"],
)
def test_an_implausible_strength_is_named_and_flagged(
    values: dict[str, float], name: str, hidden: float, tmp_path: Path
) -> None:
    cause = owner(name)
    assert cause
    plan = blank(20)
    design, occasions = Design.of(plan.constants, plan.groups), Occasions.of(plan.groups)
    true = simulate_literally(design, values | {name: hidden}, terms([cause]), occasions)
    scatter = np.hypot(0.05 * true, 0.1) * np.random.default_rng(1).standard_normal(true.size)
    experiment = plan.with_readings(np.round(np.maximum(true + scatter, 0.0), 2))
    catalogue = terms(["amplifier_lag", "flight_friction", "preload", "adhesion"])
    settings = replace(Settings.usual(quick=True), simulated=99)
    diagnose(experiment, experiment.ids, tmp_path, quick=True, seed=1, catalogue=catalogue, settings=settings)
    said = read_diagnosis(tmp_path / "diagnosis.json")
    reported = reported_set(said)
    assert any(cause in ids for ids in reported), said["verdict"]
    flagged = {frozenset(c["terms"]): c["implausible"] for c in said["causes"]}
    assert all(name in flagged[ids] for ids in reported if cause in ids), flagged

"""The peak force on both engines against the reference, and against what is known of it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from rigs import RIG, TRUTH

from psafit.drives import WAVEFORMS, Drive
from psafit.observables import PEAK_FORCE
from psafit.physics import terms
from psafit.simulate import Design, simulate
from psafit.simulate.contact import contact
from psafit.simulate.contract import Draw, draw
from psafit.simulate.literal import literal_launch
from psafit.simulate.reference import Point

CLOSED, STEPPED = 1e-8, 1e-6
CAUSES = ((), ("amplifier_lag",), ("hysteresis",), ("hertz_exponent",), ("preload",), ("adhesion",), ("gap",))


def errors(one: Draw, tolerance: float) -> tuple[float, str]:
    """Relative error of the peak force that the fast path gives, and the path."""
    design = Design.sweep(one.constants, one.point.drive, one.point.frequency, one.point.amplitude)
    row = np.array([*one.theta, *itertools.chain(*one.values)])
    found = simulate(design, row, one.causes, tolerance=tolerance, forces=True)
    pairs = list(zip(one.causes, one.values, strict=True))
    reference = literal_launch(one.point, one.theta, pairs, one.constants, forces=True)
    assert found.peak_force is not None
    fast = float(found.peak_force[0, 0])
    if math.isnan(fast) and math.isnan(reference.peak_force):
        return 0.0, found.engine
    return abs(fast / reference.peak_force - 1), found.engine


@pytest.mark.slow
@pytest.mark.parametrize("causes", CAUSES, ids=lambda c: "+".join(c) or "baseline")
def test_engines_agree_with_the_reference(causes: tuple[str, ...]) -> None:
    rng = np.random.default_rng([3, len(causes)])
    for _ in range(12):
        one = draw(rng, terms(causes))
        drive = Drive(str(rng.choice(list(WAVEFORMS))))
        one = Draw(Point(drive, *one.point[1:]), one.theta, one.causes, one.values, one.constants)
        error, engine = errors(one, 1e-8)
        assert error <= (CLOSED if engine == "closed form" else STEPPED), one


def test_closed_form_and_steps_find_the_same_peak() -> None:
    design = Design.sweep(RIG, "sine", [300.0, 1500.0, 6000.0], 12.0)
    closed = simulate(design, TRUTH, forces=True)
    stepped = simulate(design, TRUTH, path="stepper", forces=True)
    assert closed.peak_force is not None and stepped.peak_force is not None
    assert closed.engine == "closed form"
    assert stepped.peak_force == pytest.approx(closed.peak_force, rel=1e-5)
    seen = [one.peak_force for one in contact(design, TRUTH)]
    assert closed.peak_force[0] == pytest.approx(seen, rel=1e-6)


def test_forces_are_found_only_where_they_are_asked_for() -> None:
    found = simulate(Design.sweep(RIG, "sine", 1000.0, 12.0), TRUTH)
    assert found.peak_force is None
    with pytest.raises(ValueError, match="not asked for forces"):
        PEAK_FORCE.of(found)

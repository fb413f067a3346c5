r"""Launch speed: the ball's speed when it leaves the tip, mm/s.

A range `L` and a speed `v` of one launch are nearly proportional, :math:`v \approx L \sqrt{g/l}`: 0.1 um on a string of
90 mm is 0.001 mm/s. What acts after the launch, in flight or on the reading of ranges, does not touch the speed.
"""

from __future__ import annotations

import numpy as np

from psafit.arrays import FloatArray
from psafit.observables.observable import Launches, Observable, scatter
from psafit.parameters import Bounds, LogNormal

_CALLED = (
    "launch speed", "launch velocity", "speed", "velocity", "geschwindigkeit", "startgeschwindigkeit",
    "abwurfgeschwindigkeit", "abfluggeschwindigkeit", "vitesse", "v",
)  # fmt: skip


def _of(launches: Launches) -> FloatArray:
    """A ball that is not launched has no speed."""
    return np.asarray(np.where(launches.launched, launches.separation_speed, 0.0))


LAUNCH_SPEED = Observable(
    name="launch_speed",
    column="launch_speed_mm_s",
    unit="mm/s",
    scale=1e3,
    title="launch speed",
    called=_CALLED,
    of=_of,
    scatter=scatter(
        "launch_speed",
        "mm/s",
        LogNormal(0.05, 2.5),
        LogNormal(0.003, 3.0),
        Bounds(1e-5, 1.0),
        (
            "as that of the launch range, which is nearly proportional to the speed",
            "velocity noise of a laser vibrometer: micrometres a second",
        ),
    ),
    offset=0.003,
    limits=(0.0, 1e6),
    still=0.03,
    usual=(1e-3, 1e3),
    mistaken=(("m/s",), ("um/s",)),
)

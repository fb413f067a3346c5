"""Launch range: the ball's largest horizontal excursion, um (Eqs. (16)-(17) of the study)."""

from __future__ import annotations

import numpy as np

from psafit.arrays import FloatArray
from psafit.observables.observable import Launches, Observable, scatter
from psafit.parameters import Bounds, LogNormal

_CALLED = (
    "launch range", "range", "launch distance", "distance", "flight distance", "launch", "throw", "wurfweite", "weite",
    "reichweite", "flugweite", "portee", "portée", "alcance",
)  # fmt: skip


def _of(launches: Launches) -> FloatArray:
    """A ball that leans on the tip may leave it behind its place of rest and never come beyond that: it reads zero."""
    return np.maximum(launches.launch_range, 0.0)


LAUNCH_RANGE = Observable(
    name="launch_range",
    column="launch_range_um",
    unit="um",
    scale=1e6,
    title="launch range",
    called=_CALLED,
    of=_of,
    scatter=scatter(
        "",
        "um",
        LogNormal(0.05, 2.5),
        LogNormal(0.1, 3.0),
        Bounds(1e-3, 20.0),
        (
            "repeated launches of small impact drives scatter by some per cent; 2-12 % is one standard deviation",
            "rest motion of a hanging ball read by a vibrometer: tenths of a micrometre",
        ),
    ),
    offset=0.3,
    limits=(0.0, 1e9),
    still=1.0,
    usual=(0.1, 1e5),
    instead="as speeds in mm/s",
    mistaken=(("mm", "m"), ("nm",)),
)

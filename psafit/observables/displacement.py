"""Displacement of the ball from its rest along a trace, um."""

from __future__ import annotations

from psafit.arrays import FloatArray
from psafit.observables.observable import Motion, Observable, along, scatter
from psafit.parameters import Bounds, LogNormal

_CALLED = (
    "displacement", "disp", "position", "vibrometer", "auslenkung", "verschiebung", "weg", "déplacement",
    "deplacement", "x",
)  # fmt: skip


def _of(motion: Motion) -> FloatArray:
    return motion.ball


DISPLACEMENT = Observable(
    name="displacement",
    column="displacement_um",
    unit="um",
    scale=1e6,
    title="displacement",
    called=_CALLED,
    of=_of,
    scatter=along(
        scatter(
            "displacement",
            "um",
            LogNormal(0.02, 2.5),
            LogNormal(0.02, 3.0),
            Bounds(0.0001, 20.0),
            (
                "calibration and alignment of a laser vibrometer: one to some per cent",
                "an interferometer's drift and the rest motion of a hanging ball: hundredths of a micrometre",
            ),
        )
    ),
    offset=0.3,
    limits=(-1e9, 1e9),
    still=0.0,
    usual=(0.01, 100000.0),
    mistaken=(("mm", "m"), ("nm",)),
    traced=True,
)

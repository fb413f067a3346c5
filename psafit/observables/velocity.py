"""Velocity of the ball along a trace, mm/s."""

from __future__ import annotations

from psafit.arrays import FloatArray
from psafit.observables.observable import Motion, Observable, along, scatter
from psafit.parameters import Bounds, LogNormal


def _of(motion: Motion) -> FloatArray:
    return motion.ball_speed


VELOCITY = Observable(
    name="velocity",
    column="velocity_mm_s",
    unit="mm/s",
    scale=1e3,
    title="velocity",
    called=("velocity", "speed", "vibrometer", "geschwindigkeit", "schnelle", "vitesse", "v"),
    of=_of,
    scatter=along(
        scatter(
            "velocity",
            "mm/s",
            LogNormal(0.02, 2.5),
            LogNormal(0.05, 3.0),
            Bounds(1e-05, 20.0),
            (
                "calibration and alignment of a laser vibrometer: one to some per cent",
                "noise of a laser vibrometer of 100 kHz and more bandwidth: hundredths of a mm/s",
            ),
        )
    ),
    offset=0.3,
    limits=(-1e9, 1e9),
    still=0.0,
    usual=(0.01, 10000.0),
    mistaken=(("m/s",), ("um/s",)),
    traced=True,
)

"""Displacement of the tip from its rest along a trace, um."""

from __future__ import annotations

from psafit.arrays import FloatArray
from psafit.observables.displacement import DISPLACEMENT
from psafit.observables.observable import Motion, Observable, along, scatter
from psafit.parameters import Bounds, LogNormal


def _of(motion: Motion) -> FloatArray:
    return motion.tip


TIP_DISPLACEMENT = Observable(
    name="tip_displacement",
    column="tip_displacement_um",
    unit="um",
    scale=1e6,
    title="tip displacement",
    called=(*DISPLACEMENT.called, ""),
    of=_of,
    scatter=along(
        scatter(
            "tip_displacement",
            "um",
            LogNormal(0.02, 2.5),
            LogNormal(0.02, 3.0),
            Bounds(0.0001, 20.0),
            (
                "calibration and alignment of a laser vibrometer: one to some per cent",
                "as that of the ball's displacement: hundredths of a micrometre",
            ),
        )
    ),
    offset=0.3,
    limits=(-1e9, 1e9),
    still=0.0,
    usual=(0.001, 10000.0),
    mistaken=(("mm", "m"), ("nm",)),
    traced=True,
    tip=True,
)

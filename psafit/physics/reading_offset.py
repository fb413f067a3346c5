r"""A reading that never falls below a floor.

.. math:: L_\mathrm{read} = \sqrt{L^2 + b^2}.

The largest excursion within a record contains the ball's rest motion as well as the launch: two motions without a
fixed phase add their energies. Assumed: the same rest motion in every record.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def reading(L: FloatArray, p: FloatArray, group: NDArray[np.int64]) -> FloatArray:
    """Add the floor in quadrature."""
    return np.hypot(L, p[:, :1])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Reading ``sqrt(L^2 + b^2)``."""
    before, b = rig.reading, p[0]
    rig.reading = lambda L, group: math.sqrt(before(L, group) ** 2 + b**2)


def _read(L: float, b: float) -> float:
    return float(reading(np.array([[L]]), np.array([[b]]), np.array([0]))[0, 0])


TERM = Term(
    id="reading_offset",
    slot="reading",
    title="floor of the reading",
    equation=r"L_\mathrm{read} = \sqrt{L^2 + b^2}",
    description=__doc__ or "",
    because="a vibrometer resolves picometres, and whoever waits until the ball hangs still reads no rest motion",
    parameters=(
        Parameter(
            name="reading_offset_b",
            symbol="b",
            unit="m",
            bounds=Bounds(0.0, 1e-5),
            prior=Tailed(Normal(0.0, 3e-7)),
            description="rest motion that adds to every reading",
            source="a ball on a 90 mm string over a laboratory floor moves by 0.1-1 um at 1.7 Hz; the vibrometer's own"
            " resolution (Table 1: 0.05 pm) is far below. A ball that swings by 10 um, four strokes at 20 V, would hang"
            " clear of the tip half of the time",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the smallest readings level off at b, whatever the drive; ranges of some b and more are untouched",
        sign=1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="elementary: sum of two motions without a fixed phase",
    checks=(
        Check("L = 0.4 um, b = 0.3 um: sqrt(0.16 + 0.09) um = 0.5 um", lambda: _read(4e-7, 3e-7), 5e-7),
        Check("L = 12 um, b = 5 um: sqrt(144 + 25) um = 13 um", lambda: _read(12e-6, 5e-6), 13e-6),
    ),
    look="what the instrument reads while the ball hangs at rest",
    literal=literal,
    reading=reading,
)

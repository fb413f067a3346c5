r"""A swing that starts where the ball left the tip, and a ball that stays on it.

.. math:: L_r^2 = v^2 l/g + w\, x_2^2 \quad \text{(small angles)}.

The tip carries the ball some way before they part; there the pendulum already has the potential energy of :math:`x_2`,
which the study neglects (Section 3.3). Mechanics asks for :math:`w = 1` when the string hangs plumb at the contact
plane and the range is read from there; less when the zero of the reading moves along. A ball that makes no hop then
reads :math:`\sqrt w` times the highest place to which the tip carries it. Matters where :math:`x_2`, at most 2.4 um
plus indentation, is comparable with the range.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def swing_offset(p: FloatArray) -> FloatArray:
    """Return the weight ``w``."""
    return p[:, 0]


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Weight ``w`` of the ball's place at separation."""
    rig.offset_weight += p[0]


def _range(v: float, x_2: float, w: float) -> float:
    weight = swing_offset(np.array([[w]]))[0]
    return float(np.sqrt(v**2 * 0.09 / 9.81 + weight * x_2**2))


TERM = Term(
    id="separation_height",
    slot="flight",
    title="height at separation",
    equation=r"L_r^2 = v^2 l/g + w x_2^2",
    description=__doc__ or "",
    probability=0.9,
    because="a vibrometer reads displacement from rest: the place counts, whatever the study's equations neglect",
    parameters=(
        Parameter(
            name="separation_weight",
            symbol="w",
            unit="1",
            bounds=Bounds(0.0, 1.0),
            prior=Tailed(Normal(1.0, 0.1)),
            description="weight of the ball's place at separation in the swing's energy",
            source="1 by conservation of energy, 0 by the study's neglect (Section 3.3); between where the reading's"
            " zero follows the ball",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "launch ranges cannot fall below the distance over which the tip carried the ball. Of ranges far above the"
        " stroke (2.4 um at 20 V) that is a ten-thousandth or less; it is most at low frequency, where the tip carries"
        " the ball furthest",
        sign=1,
        frequency="falls",
        amplitude="flat",
    ),
    reference="elementary: energy of a pendulum",
    checks=(
        Check(
            "v = 10.440 um/s = sqrt(109) um/s, l/g = 0.09/9.81 = s^2/109: v^2 l/g = 1 um^2; x_2 = 2 um, w = 0.5625:"
            " sqrt(1 + 0.5625 x 4) um = 1.8027756 um",
            lambda: _range(1e-6 * np.sqrt(109.0), 2e-6, 0.5625),
            1.8027756377319946e-6,
        ),
    ),
    literal=literal,
    swing_offset=swing_offset,
)

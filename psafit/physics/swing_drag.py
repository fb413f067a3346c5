r"""A swing slowed in proportion to its speed.

.. math:: \ddot x = -\tfrac{g}{l} x - \gamma v.

Air drag on a slow ball, with the viscous layer that oscillates with it (Stokes 1851), and losses in the string. At
small angles the whole swing scales: every range is multiplied by the same factor, about :math:`1 -
(\pi/4)\gamma\sqrt{l/g}`. Assumed: the drag that grows with :math:`v^2` is negligible at some mm/s.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def deceleration(x: float, v: float, p: Any) -> float:
    """Return ``gamma v``."""
    return float(p[0]) * v


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Deceleration ``gamma v``."""
    before, rate = rig.deceleration, p[0]
    rig.deceleration = lambda x, v: before(x, v) + rate * v


TERM = Term(
    id="swing_drag",
    slot="flight",
    title="drag on the swing",
    equation=r"\ddot x = -(g/l) x - \gamma v",
    description=__doc__ or "",
    probability=0.02,
    because="a steel ball in air swings for minutes: the first quarter of a swing loses a thousandth",
    parameters=(
        Parameter(
            name="swing_drag_rate",
            symbol=r"\gamma",
            unit="1/s",
            bounds=Bounds(0.0, 50.0),
            prior=Tailed(Normal(0.0, 0.1)),
            description="drag rate of the swing",
            source="air on a ball of 9.4 mm radius at 1.7 Hz: 6 pi eta R (1 + R/1.7 mm)/M = 8e-4 1/s (Landau and"
            " Lifshitz, Fluid Mechanics, sec. 24); pendulums on strings decay at 0.002-0.02 1/s; paper and cables at"
            " some 0.1 1/s (estimates). At 50 1/s the ball would creep instead of swing",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "every launch range is lowered by the same factor, at all frequencies and voltages, with sine and square",
        sign=-1,
        frequency="flat",
        amplitude="flat",
    ),
    reference="P. T. Squire, Am. J. Phys. 54 (1986) 984; L. D. Landau and E. M. Lifshitz, Fluid Mechanics, sec. 24",
    checks=(
        Check(
            "gamma = 0.5 1/s at 3 mm/s: 1.5 mm/s^2",
            lambda: deceleration(1e-5, 3e-3, [0.5]),
            1.5e-3,
        ),
        Check(
            "force on 27 g at gamma = 4 1/s and 2 mm/s: 0.027 x 8e-3 = 0.216 mN",
            lambda: 0.027 * deceleration(0.0, 2e-3, [4.0]),
            2.16e-4,
        ),
    ),
    look="how a free swing of the ball dies out, away from the tip (by drag each swing loses the same share)",
    literal=literal,
    deceleration=deceleration,
)

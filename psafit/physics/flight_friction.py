r"""A swing slowed by dry friction.

.. math:: \ddot x = -\tfrac{g}{l} x - a_f.

Where a string or its knot slides over its support, the moment of friction :math:`\mu M g r` on the radius `r` of the
support acts like a constant force :math:`\mu M g r/l` on the ball; a dragging wire or tape does the same. With
:math:`a_f` far above :math:`g L/l` the range is :math:`v^2/(2 a_f)`: quadratic in the speed. Assumed: no velocity
dependence; it ends with the swing outwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def deceleration(x: float, v: float, p: Any) -> float:
    """Return ``a_f``."""
    return float(p[0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Constant deceleration ``a_f``."""
    before, friction = rig.deceleration, p[0]
    rig.deceleration = lambda x, v: before(x, v) + friction


TERM = Term(
    id="flight_friction",
    slot="flight",
    title="dry friction on the swing",
    equation=r"\ddot x = -(g/l) x - a_f",
    description=__doc__ or "",
    because="a string that is tied or clamped bends and does not slide; a knot or a wire that rubs is rare",
    parameters=(
        Parameter(
            name="flight_friction_a",
            symbol="a_f",
            unit="m/s^2",
            bounds=Bounds(0.0, 1.0),
            prior=Tailed(Normal(0.0, 0.02)),
            description="constant deceleration of the swing",
            source="mu g r/l with mu = 0.2 and a support of radius 0.1-1 mm: 0.002-0.02 m/s^2; friction terms of real"
            " pendulums in Squire (1986, not read). 1 m/s^2 is mu = 1 on a support of a tenth of the string",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the launch range grows with the square of the speed until g L/l exceeds a_f: weak launches lose most, on both"
        " sides of the peak and at low voltage",
        sign=-1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="P. T. Squire, Am. J. Phys. 54 (1986) 984",
    checks=(
        Check(
            "a ball at 2 mm/s under friction alone, a_f = 0.02 m/s^2: v^2/(2 a_f) = 4e-6/0.04 = 100 um",
            lambda: 2e-3**2 / (2 * deceleration(5e-5, 2e-3, [0.02])),
            1e-4,
        ),
        Check(
            "force on 27 g at a_f = 0.02 m/s^2: 0.54 mN, whatever place and speed",
            lambda: 0.027 * deceleration(-1e-3, 0.3, [0.02]),
            5.4e-4,
        ),
    ),
    look="how a free swing of the ball dies out, away from the tip (by friction each swing loses the same)",
    literal=literal,
    deceleration=deceleration,
)

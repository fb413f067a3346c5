r"""A stroke that falls behind the voltage at its top.

.. math:: F_e = \frac{k_s q u}{\sqrt{1 + (b u)^2}}, \qquad b = 1/U_\mathrm{sat}.

The strain of a ferroelectric saturates once its domains are aligned, and an output stage clips softly near its supply;
either way the stroke tends to :math:`q U_\mathrm{sat}`. Assumed: the same for both signs, without memory. The form is
the smoothest that is linear at first with no second-order term, and is a choice, not a law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def stack_factor(size: float, p: Any) -> float:
    """Return ``1/sqrt(1 + (b u)^2)``."""
    return 1.0 / math.sqrt(1.0 + (size * p[0]) * (size * p[0]))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Stroke ``q u / sqrt(1 + (b u)^2)``."""
    stroke, b = rig.stroke, p[0]
    rig.stroke = lambda u: stroke(u) / math.sqrt(1 + (b * u) ** 2)


TERM = Term(
    id="drive_saturation",
    slot="stack",
    title="stroke saturates",
    equation=r"F_e = k_s q u / \sqrt{1 + (b u)^2}",
    description=__doc__ or "",
    probability=0.02,
    because=("strokes of the data sheet are proportional up to 150 V; only an output stage near its supply would clip"),
    parameters=(
        Parameter(
            name="saturation_b",
            symbol="b",
            unit="1/V",
            bounds=Bounds(0.0, 0.5),
            prior=Tailed(Normal(0.0, 0.005)),
            description="one over the voltage at which the stroke saturates",
            source="the strain of soft PZT is still rising at 1-2 kV/mm (Uchino 1997), 100-200 V on 0.1 mm layers, and"
            " the data sheet's strokes at 100 and 150 V are proportional: U_sat > 150 V; an output stage meant for"
            " +-20 V clips above 25 V. 0.5 1/V is U_sat = 2 V, a fortieth of the coercive voltage (80-120 V): no domain"
            " is aligned there, and an output stage that ends at 2 V drives no stack",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the launch range grows more slowly than the voltage: the top of an amplitude sweep bends down",
        sign=-1,
        frequency="mixed",
        amplitude="grows",
    ),
    reference="K. Uchino, Piezoelectric Actuators and Ultrasonic Motors, 1997 (field-induced strain of ferroelectrics)",
    checks=(
        Check(
            "U_sat = 20 V at 15 V: b u = 0.75, 1/sqrt(1 + 0.5625) = 1/1.25 = 0.8",
            lambda: stack_factor(15.0, [0.05]),
            0.8,
        ),
        Check(
            "far above U_sat = 10 V, at 24 V: stroke/q = 24/sqrt(1 + 5.76) = 24/2.6 = 9.2308 V",
            lambda: 24.0 * stack_factor(24.0, [0.1]),
            240 / 26,
        ),
    ),
    look="the free tip's stroke per volt, at several amplitudes",
    literal=literal,
    stack_factor=stack_factor,
)

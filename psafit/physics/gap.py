r"""A ball that hangs clear of the tip.

.. math:: d = x_1 - x_2 - g_0, \qquad F_c = 0 \text{ until } d \text{ first reaches } 0.

A ball placed by hand rarely hangs just in touch. The tip crosses the gap first and strikes the ball at speed: what
was a push becomes an impact. Beyond the stroke, 2.4 um at 20 V, there is no launch. Assumed: the ball hangs at rest;
the same gap in every launch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Widen the gap."""
    return rig.change(gap=rig.gap + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Gap ``g_0``."""
    rig.gap += p[0]


def _voltage(gap: float) -> float:
    rig = setup(plain_rig(), np.array([[gap]]))
    return float(rig.gap[0] / rig.q[0])


TERM = Term(
    id="gap",
    slot="contact",
    title="gap at rest",
    equation=r"d = x_1 - x_2 - g_0",
    description=__doc__ or "",
    probability=0.05,
    because="a ball is meant to touch; placed by hand, it clears the tip by a micrometre or so now and then",
    parameters=(
        Parameter(
            name="gap_width",
            symbol="g_0",
            unit="m",
            bounds=Bounds(0.0, 2e-5),
            prior=Tailed(Normal(0.0, 1e-6)),
            description="distance of the ball from the tip at rest",
            source="touch is judged by eye or by the vibrometer's first motion, 0.1-2 um; the ball's rest motion is of"
            " the same size; 20 um is more than the stroke at the full 150 V (17.4 um): nothing would ever be launched",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "below a threshold voltage near g_0/q nothing happens; above, part of the stroke is lost, though a stiff"
        " contact gains at slow sines because the tip strikes instead of pushes; it fades as the stroke outgrows the"
        " gap",
        sign=0,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="W. Goldsmith, Impact, 1960 (impact of bodies with clearance)",
    checks=(
        Check(
            "a static stroke of 0.12 um/V closes 0.6 um at 0.6/0.12 = 5 V",
            lambda: _voltage(0.6e-6),
            5.0,
        ),
        Check(
            "gaps add: 0.2 um + 0.6 um = 0.8 um",
            lambda: float(setup(plain_rig(gap=0.2e-6), np.array([[0.6e-6]])).gap[0]),
            0.8e-6,
        ),
    ),
    look="whether ball and tip touch at rest, by electrical contact if both conduct, else under a microscope",
    literal=literal,
    setup=setup,
)

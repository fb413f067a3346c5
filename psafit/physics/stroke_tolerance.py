r"""A free stroke per volt that is not the data sheet's.

.. math:: q \to r_q q.

Data sheets state the stroke at full voltage with a tolerance; at small voltages the piezoelectric coefficient is
lower. An error of the voltage's gain acts in the same way. Assumed: one factor for all voltages and frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Scale the stroke per volt."""
    return rig.change(q=rig.q * p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Stroke per volt ``r_q q``."""
    rig.q *= p[0]


def _stroke(r_q: float, u: float) -> float:
    return float(setup(plain_rig(), np.array([[r_q]])).q[0]) * u


TERM = Term(
    id="stroke_tolerance",
    slot="stack",
    title="tolerance of the free stroke",
    equation=r"q \to r_q q",
    description=__doc__ or "",
    probability=0.1,
    because="a data sheet has a tolerance of 12-17 %, and describes full voltage",
    parameters=(
        Parameter(
            name="stroke_ratio",
            symbol="r_q",
            unit="1",
            bounds=Bounds(0.2, 3.0),
            prior=Tailed(LogNormal(0.85, 1.35)),
            description="stroke per volt over the data sheet's",
            source="AE0505D16DF: 17.4 +- 2.0 um at 150 V, 11.6 +- 2.0 um at 100 V (NEC TOKIN's table, read), that is"
            " 0.97 q +- 12-17 %. At small signals the stroke per volt is 10-40 % lower (from memory; Hall 2001 was"
            " read in its abstract only). Beyond a factor of 3-5 no stack of this length could be meant",
            neutral=1.0,
        ),
    ),
    symptom=Symptom(
        "every launch range is scaled by the same factor, at all frequencies and voltages, with sine and square",
        sign=1,
        frequency="flat",
        amplitude="flat",
    ),
    reference="NEC TOKIN, Multilayer Piezoelectric Actuators, data sheet of AE0505D16DF; D. A. Hall, J. Mater. Sci. 36"
    " (2001) 4575",
    checks=(
        Check(
            "1.2e-7 m/V x 0.9 = 1.08e-7 m/V",
            lambda: float(setup(plain_rig(), np.array([[0.9]])).q[0]),
            1.08e-7,
        ),
        Check("free stroke at 20 V with r_q = 1.15: 2.4 um x 1.15 = 2.76 um", lambda: _stroke(1.15, 20.0), 2.76e-6),
    ),
    look="the free tip's stroke at one known voltage",
    literal=literal,
    setup=setup,
)

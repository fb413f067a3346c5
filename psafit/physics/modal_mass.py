r"""A stack that is a rod, not a lump.

.. math:: m \to r_m m.

The first mode of a uniform rod, one end clamped, has :math:`\omega = (\pi/2)\sqrt{k_s/m}`: at the tip, with the static
stiffness :math:`k_s`, it moves like a lump of :math:`4 m/\pi^2 = 0.41 m` (Rayleigh's estimate with a straight
displacement is :math:`m/3`). The study's lump, :math:`\sqrt{k_s/m}/2\pi` = 15.7 kHz, is far below the 69 kHz of Table
1; halved for clamping one end, 34.5 kHz ask for :math:`r_m = 0.21`; taken as they are, for 0.052. Assumed: higher
modes do not matter, and a wall that does not move.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Scale the mass."""
    return rig.change(m=rig.m * p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Mass ``r_m m``."""
    rig.m *= p[0]


def _resonance(r_m: float) -> float:
    rig = setup(plain_rig(), np.array([[r_m]]))
    return float(np.sqrt(rig.k_s[0] / rig.m[0]) / (2 * np.pi))


TERM = Term(
    id="modal_mass",
    slot="stack",
    title="modal mass of the stack",
    equation=r"m \to r_m m",
    description=__doc__ or "",
    probability=0.1,
    because="a rod is no lump, but a stack that is much faster than the drive shows no mass at all",
    parameters=(
        Parameter(
            name="modal_mass_ratio",
            symbol="r_m",
            unit="1",
            bounds=Bounds(0.02, 3.0),
            prior=Tailed(LogNormal(0.3, 2.0)),
            description="moving mass over the stack's mass",
            source="4/pi^2 = 0.41 for a clamped rod, 1/3 by Rayleigh's estimate (Rao, Mechanical Vibrations, ch. 8);"
            " 0.21 from half of 69 kHz, 0.052 from 69 kHz itself (Table 1); end pieces, coating and wires add some"
            " tenths. Below 0.02 the resonance would exceed 111 kHz, far above Table 1's. No part of a clamped rod"
            " moves further than its tip, so that its own share is at most 1; 3 has end pieces of twice its mass",
            neutral=1.0,
        ),
    ),
    symptom=Symptom(
        "a lighter tip follows the voltage faster: fast sines and the jumps of square waves change, slow sines do not",
        sign=0,
        frequency="mixed",
        amplitude="flat",
    ),
    reference="S. S. Rao, Mechanical Vibrations, ch. 8 (longitudinal vibration of a bar)",
    checks=(
        Check(
            "0.005 kg x 0.5 = 0.0025 kg",
            lambda: float(setup(plain_rig(), np.array([[0.5]])).m[0]),
            0.0025,
        ),
        Check(
            "r_m = 1/4 doubles the lump's sqrt(4.89e7/0.005)/(2 pi) = 15.739 kHz to 31.479 kHz",
            lambda: _resonance(0.25),
            31478.6,
            tolerance=1e-5,
        ),
    ),
    look="the first resonance of the stack without the ball, by its impedance or a vibrometer",
    literal=literal,
    setup=setup,
)

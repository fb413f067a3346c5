r"""A stack that stands on a wall which gives way.

.. math::
    M_w \ddot x_w = -k_w x_w - c_w \dot x_w - R, \qquad
    m \ddot x_1 = R - F_c, \qquad R = k_s\,(q u - x_1 + x_w) - c_s\,(\dot x_1 - \dot x_w).

What pushes the tip forward pushes the holder back. The baseline holds the stack's foot still; a holder of mass
:math:`M_w` on its bolts, its rail or its table, of stiffness :math:`k_w`, swings with the reaction `R` and moves tip
and ball with it. With a resonance :math:`f_w = \sqrt{k_w/M_w}/2\pi` of 1 kHz ranges change by 1-3 % where the wall
has 1 kg, and by 2-9 % where it has 0.25 kg: on a hard contact most at and below the resonance, on one so soft that the
ball stays behind, above it. Sampled as the compliance :math:`1/k_w`, which vanishes where the wall is rigid, with
:math:`f_w` and the damping ratio :math:`\zeta_w`. Assumed: one resonance, along the stack.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Put the stack on the wall; a wall without compliance is none."""
    compliance, frequency, ratio = p.T
    omega = 2 * np.pi * frequency
    soft = compliance > 0.0
    k_w = np.divide(1.0, compliance, out=np.zeros_like(omega), where=soft)
    return rig.change(wall_mass=k_w / omega**2, wall_stiffness=k_w, wall_damping=2 * ratio * k_w / omega)


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Wall of stiffness ``1/p_0`` and the mass that resonates at ``p_1``."""
    compliance, frequency, ratio = p
    if compliance > 0:
        rig.wall_stiffness = 1 / compliance
        rig.wall_mass = rig.wall_stiffness / (2 * math.pi * frequency) ** 2
        rig.wall_damping = 2 * ratio * math.sqrt(rig.wall_stiffness * rig.wall_mass)


def _wall(compliance: float, frequency: float, ratio: float) -> Setup:
    return setup(plain_rig(), np.array([[compliance, frequency, ratio]]))


TERM = Term(
    id="frame_compliance",
    slot="stack",
    title="frame gives way",
    equation=r"M_w \ddot x_w = -k_w x_w - c_w \dot x_w - R",
    description=__doc__ or "",
    because=(
        "every wall gives way, but a holder of a kilogram or more changes ranges by less than they scatter; light "
        "ones are rare"
    ),
    parameters=(
        Parameter(
            name="frame_compliance",
            symbol="1/k_w",
            unit="m/N",
            bounds=Bounds(0.0, 1e-5),
            prior=Tailed(Normal(0.0, 3e-8)),
            description="compliance of the wall behind the stack",
            source="holders of 0.1-2 kg that resonate between 0.5 and 3 kHz have 1e-9 to 1e-7 m/N (an estimate: M6"
            " bolts and steel blocks; no source read). At 1e-5 m/N 0.1 kg would resonate at 160 Hz, which is"
            " no holder any more",
            neutral=0.0,
            reciprocal="N/m",
        ),
        Parameter(
            name="frame_frequency",
            symbol="f_w",
            unit="Hz",
            bounds=Bounds(20.0, 2e4),
            prior=LogNormal(1000.0, 2.5),
            description="resonance of the wall",
            source="optical tables and their posts resonate at 100-500 Hz, blocks on bolts at 1-5 kHz (an estimate). At"
            " 20 Hz a holder gives way to its own weight by 0.6 mm; at 20 kHz, above the stack's 16 kHz, it is a spring"
            " in series with the stack, which is `stack_stiffness`",
        ),
        Parameter(
            name="frame_damping",
            symbol=r"\zeta_w",
            unit="1",
            bounds=Bounds(1e-3, 1.0),
            prior=LogNormal(0.03, 2.0),
            description="damping ratio of the wall",
            source="bolted joints 1-5 % (an estimate). Less than 0.001 is steel without a joint (an estimate); above 1"
            " nothing swings",
        ),
    ),
    symptom=Symptom(
        "every sweep of frequency is lowered by some per cent: on a hard contact most at and below the wall's"
        " resonance, on a soft one above it, where it may be raised a little below; the same for every voltage",
        sign=0,
        frequency="mixed",
        amplitude="flat",
    ),
    reference="J. P. Den Hartog, Mechanical Vibrations, 4th ed., 1956, ch. 3 (two degrees of freedom)",
    checks=(
        Check(
            "1e-8 m/N: 1e8 N/m; at 1 kHz 1e8/(2 pi 1e3)^2 = 2.5330296 kg",
            lambda: float(_wall(1e-8, 1e3, 0.03).wall_mass[0]),
            2.5330295910584444,
        ),
        Check(
            "5 % of critical at 4e7 N/m and 500 Hz: 2 x 0.05 x 4e7/(2 pi 500) = 1273.24 N s/m",
            lambda: float(_wall(2.5e-8, 500.0, 0.05).wall_damping[0]),
            4e6 / (1e3 * math.pi),
        ),
    ),
    look="the motion of the wall behind the stack during a launch, with a vibrometer",
    literal=literal,
    setup=setup,
)

r"""A ball that slides on a support.

.. math:: M \ddot x_2 = F_c - P_0 - w M a_s \operatorname{sgn} \dot x_2, \qquad a_s = \mu N/M, \qquad
    \ddot x = -\tfrac{g}{l} x - a_s \ \text{ in the hop}.

Where something beneath carries the ball, its paper or its cable with a force `N`, Coulomb's friction rubs it in
contact, between strikes and in flight, by :math:`\mu g` if all of the weight is borne. While the tip presses with
newtons, its own friction can carry a part of the weight of 0.26 N: of what the support bears in the hop, a part `w`
is left until then. It holds a ball at rest until
the contact pushes harder: at 100 Hz and 20 V the inertia of 27 g is 26 mN, friction under the whole weight 50 mN. Such
a ball does not swing back. Far above :math:`g L/l` the range is :math:`v^2/(2 a_s)`: quadratic in the speed at every
size, and orders below what the string alone would allow. Assumed: no dependence on the speed, the same friction at
rest as in motion, and a tip that does not rub.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed, Uniform
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Add to the friction, before the hop and in it."""
    return rig.change(grip=rig.grip + p[:, 0] * p[:, 1], rub=rig.rub + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Friction ``a_s`` of what the ball slides on, of which ``w`` acts before the hop."""
    a_s, w = p
    rig.rub += a_s
    rig.grip += w * a_s


def _rub(a_s: float, before: float = 0.0) -> float:
    return float(setup(plain_rig(rub=before), np.array([[a_s, 1.0]])).rub[0])


TERM = Term(
    id="sliding_support",
    slot="flight",
    title="ball slides on a support",
    equation=r"M \ddot x_2 = F_c - w M a_s \operatorname{sgn} \dot x_2, \quad a_s = \mu N/M",
    description=__doc__ or "",
    probability=0.03,
    because="a ball hangs on a string; that something beneath carries it would be seen",
    parameters=(
        Parameter(
            name="sliding_support_a",
            symbol="a_s",
            unit="m/s^2",
            bounds=Bounds(0.0, 10.0),
            prior=Tailed(Normal(0.0, 2.0)),
            description="deceleration by sliding friction",
            source="mu g times the part of the weight that is borne, which is unknown, with mu = 0.1-0.3 of smooth"
            " steel on metal, glass, ceramics, plastics or paper; 10 m/s^2 is mu = 1 under the whole weight",
            neutral=0.0,
        ),
        Parameter(
            name="sliding_support_before",
            symbol="w",
            unit="1",
            bounds=Bounds(0.0, 1.0),
            prior=Uniform(),
            description="part of the friction that acts before the hop",
            source="between nothing, where the tip carries the ball while it presses, and all, where it does not;"
            " nobody measured it",
        ),
    ),
    symptom=Symptom(
        "the launch range grows with the square of the speed at every size, and is far below what string and speed"
        " allow: weak launches lose most, on both sides of the peak and at low voltage",
        sign=-1,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="E. Rabinowicz, Friction and Wear of Materials, 2nd ed., Wiley 1995, ch. 4",
    checks=(
        Check(
            "a ball at 20 mm/s under friction alone, a_s = 2 m/s^2: v^2/(2 a_s) = 4e-4/4 = 100 um",
            lambda: 2e-2**2 / (2 * _rub(2.0)),
            1e-4,
        ),
        Check(
            "0.2 of the weight and 0.5 m/s^2 on 27 g: 0.027 x (1.962 + 0.5) = 66.474 mN",
            lambda: 0.027 * _rub(0.2 * 9.81, 0.5),
            0.066474,
        ),
    ),
    look="whether the ball touches anything but string and tip",
    literal=literal,
    setup=setup,
)

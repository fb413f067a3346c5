r"""A ball that slides on a support.

.. math:: \ddot x = -\tfrac{g}{l} x - a_s, \qquad a_s = \mu N/M.

Where something beneath carries the ball, its paper or its cable with a force `N`, Coulomb's friction decelerates the
swing by :math:`\mu g` if it carries all of the weight. Far above :math:`g L/l` the range is :math:`v^2/(2 a_s)`:
quadratic in the speed at every size, and orders below what the string alone would allow. The law is that of
`flight_friction`, a hundred times stronger; which of the two it is, only its size tells, or a look at the rig. Assumed:
no dependence on the speed; the support's pull during contact, at most :math:`\mu M g`, is small beside the contact
force; it ends with the swing outwards.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, Symptom, Term, World


def deceleration(x: float, v: float, p: Any) -> float:
    """Return ``a_s``."""
    return float(p[0])


def literal(world: World, p: Sequence[float]) -> None:
    """Constant deceleration ``a_s``."""
    before, friction = world.deceleration, p[0]
    world.deceleration = lambda x, v: before(x, v) + friction


TERM = Term(
    id="sliding_support",
    slot="flight",
    title="ball slides on a support",
    equation=r"\ddot x = -(g/l) x - a_s, \quad a_s = \mu N/M",
    description=__doc__ or "",
    probability=0.03,
    because="the study hangs the ball on a string; that something beneath carries it would be said",
    parameters=(
        Parameter(
            "sliding_support_a",
            "a_s",
            "m/s^2",
            Bounds(0.0, 10.0),
            Tailed(Normal(0.0, 2.0)),
            "deceleration by sliding friction",
            "mu g times the part of the weight that is borne, which is unknown, with mu = 0.1-0.3 of smooth steel on"
            " metal, glass, ceramics, plastics or paper; 10 m/s^2 is mu = 1 under the whole weight",
            neutral=0.0,
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
            lambda: 2e-2**2 / (2 * deceleration(5e-5, 2e-2, [2.0])),
            1e-4,
        ),
        Check(
            "force on 27 g at a_s = 0.2 x 9.81 m/s^2: a fifth of its weight, 52.974 mN, whatever place and speed",
            lambda: 0.027 * deceleration(-1e-3, 0.3, [0.2 * 9.81]),
            0.052974,
        ),
    ),
    literal=literal,
    deceleration=deceleration,
)

r"""A ball that leans on the tip.

.. math::
    L_r = \sqrt{(x_0 + x_2)^2 + v^2 l/g} - x_0 \quad \text{(small angles)}.

If the pendulum's equilibrium lies :math:`x_0` behind the ball's place of rest, the string presses the ball on the tip
with :math:`M g x_0/l`. The contact is indented before the drive starts, and the ball swings out against that offset
from its place :math:`x_2` at separation. Places count from the rest, as a vibrometer reads them. Exactly, by energy:
:math:`\cos\theta_m = \cos\theta_s - v^2/(2 g l)`, with :math:`l\sin\theta_s = x_0 + x_2` and :math:`L_r =
l\sin\theta_m - x_0`. For :math:`v^2 l/g \ll x_0^2` the range is :math:`v^2 l/(2 g x_0)`: quadratic in the speed, not
linear. Assumed: the ball rests before every launch. A string at 30 degrees, :math:`x_0 = l/2`, is no pendulum any more:
leans end there, all causes of one together.

As :math:`x_0 \to 0` the place :math:`x_2` stays in the energy, which the baseline neglects (Section 3.3): a small step
separates a vanishing :math:`x_0` from :math:`x_0 = 0`, where the cause is absent.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Lean further, up to half of the string."""
    return rig.change(lean=np.minimum(rig.lean + p[:, 0], 0.5 * rig.l))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Equilibrium ``x_0`` behind the contact plane, of all causes together half of the string at most."""
    rig.lean = min(rig.lean + p[0], rig.l / 2)


def _press(x_0: float) -> float:
    rig = setup(plain_rig(), np.array([[x_0]]))
    return float(rig.M[0] * rig.g[0] * rig.lean[0] / rig.l[0])


TERM = Term(
    id="preload",
    slot="contact",
    title="ball leans on the tip",
    equation=r"F_0 = M g x_0/l, \quad L_r = \sqrt{(x_0 + x_2)^2 + v^2 l/g} - x_0",
    description=__doc__ or "",
    probability=0.15,
    because="a ball that is to touch in every launch is set to lean rather than to clear",
    parameters=(
        Parameter(
            name="preload_offset",
            symbol="x_0",
            unit="m",
            bounds=Bounds(0.0, 0.5),
            prior=Tailed(Normal(0.0, 4e-3)),
            description="distance of the pendulum's equilibrium behind the ball's place of rest",
            source="whoever wants contact at every launch sets the frame some millimetres in; 4 mm is 2.5 degrees of a"
            " 90 mm string (an estimate; a micrometre stage sets 10 um). Leans end at half of the string's"
            " length, 30 degrees, where it is no pendulum any more; 0.5 m is half of a string of a metre",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the launch range grows with the square of the speed until it exceeds x_0: weak launches lose most, on both"
        " sides of the peak and at low voltage",
        sign=-1,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="elementary: energy of a pendulum started off its equilibrium",
    checks=(
        Check(
            "press at x_0 = 0.1 mm: 0.027 x 9.81 x 1e-4/0.09 = 2.943e-4 N",
            lambda: _press(1e-4),
            2.943e-4,
        ),
        Check(
            "leans add: 0.05 mm + 0.15 mm = 0.2 mm",
            lambda: float(setup(plain_rig(lean=5e-5), np.array([[1.5e-4]])).lean[0]),
            2e-4,
        ),
        Check(
            "44 mm + 4 mm on a string of 90 mm: no more than 45 mm",
            lambda: float(setup(plain_rig(lean=4.4e-2), np.array([[4e-3]])).lean[0]),
            4.5e-2,
        ),
    ),
    look="how far the resting ball is from the plumb line below its holder, on a photograph from the side",
    literal=literal,
    setup=setup,
    limit=("separation_height", (1.0,)),
)

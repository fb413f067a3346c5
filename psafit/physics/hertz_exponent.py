r"""A contact stiffer the deeper it is pressed.

.. math:: F = k_c\, d \left(\frac{|d|}{d_0}\right)^{n-1} + c_c \dot d, \qquad d_0 = 1\ \mu\mathrm m.

Hertz's law for a sphere on a flat has :math:`n = 3/2`, a cone :math:`n = 2`; a flat punch, or a film that
spreads the load, :math:`n = 1`. With this form `k_c` keeps its unit: it is the secant stiffness at 1 um.
Assumed: the contact is quasi-static and elastic; the damping force is left as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term

D_0 = 1e-6


def law(d: float, rate: float, p: Any, out: Any) -> None:
    """Multiply the elastic force by ``(|d|/d_0)^(n-1)``."""
    power = p[0] - 1.0
    if power == 0.0:
        return
    if d == 0.0:
        out[0] = out[1] = out[2] = 0.0
        return
    factor = (abs(d) / D_0) ** power
    out[1] = (out[1] + out[0] * power / d) * factor
    out[0] *= factor
    out[2] *= factor


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Elastic force ``k_c d |d/d_0|^(n-1)``."""
    elastic, n = rig.elastic, p[0]
    rig.elastic = lambda d, rate: elastic(d, rate) * abs(d / D_0) ** (n - 1)


def _law(d: float, n: float, k_c: float) -> list[float]:
    out = [k_c * d, k_c, 0.0, 0.0, 0.0, 0.0]
    law(d, 0.0, [n], out)
    return out


TERM = Term(
    id="hertz_exponent",
    slot="contact",
    title="Hertzian contact",
    equation=r"F = k_c d \, (|d|/d_0)^{n-1} + c_c \dot d, \quad d_0 = 1\,\mu\mathrm{m}",
    description=__doc__ or "",
    probability=0.7,
    because="a ball on a flat face is Hertzian by geometry, unless paper or tape lies between",
    redefines=(("k_c", "the secant stiffness at 1 um of indentation"),),
    parameters=(
        Parameter(
            name="hertz_n",
            symbol="n",
            unit="1",
            bounds=Bounds(1.0, 3.0),
            prior=Tailed(Normal(1.5, 0.15)),
            description="exponent of the contact force",
            source="1.5 for a sphere on a flat (Johnson, Contact Mechanics, 1985, eq. 4.23); more where faces are rough"
            " (Greenwood and Tripp 1967 was not read; how much is not verified). 1 is a flat punch, and nothing"
            " elastic is below; 2 is a cone, and 3 is beyond every shape that a ball on a face can have",
            neutral=1.0,
        ),
    ),
    symptom=Symptom(
        "deeper indentation meets a stiffer contact: the launch range grows faster than the voltage",
        sign=0,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="H. Hertz, J. reine angew. Math. 92 (1882) 156; Johnson, Contact Mechanics, 1985, eq. 4.23",
    checks=(
        Check(
            "n = 1.5, k_c = 1 N/um, d = 4 um: F = 4 N (4 um/1 um)^0.5 = 8 N",
            lambda: _law(4e-6, 1.5, 1e6)[0],
            8.0,
        ),
        Check("n = 2, k_c = 1 N/um, d = 0.5 um: F = 0.5 N x 0.5 = 0.25 N", lambda: _law(0.5e-6, 2.0, 1e6)[0], 0.25),
        Check("n = 1.5, k_c = 1 N/um, d = 4 um: dF/dd = 1.5 x 8 N/4 um = 3 N/um", lambda: _law(4e-6, 1.5, 1e6)[1], 3e6),
    ),
    literal=literal,
    law=law,
)

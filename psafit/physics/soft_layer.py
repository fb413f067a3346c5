r"""A rough or padded surface that has to be pressed down before the contact is stiff.

.. math:: F = k_c\, d\, \frac{|d|}{|d| + \delta} + c_c \dot d.

Asperities, speckle paper and tape take up the first micrometre: the tangent stiffness starts at zero, as for a rough
surface whose stiffness is proportional to its load (Greenwood and Williamson), and tends to :math:`k_c` past
:math:`\delta`; far out :math:`F = k_c (d - \delta)`. Unlike a power law (`hertz_exponent`), the stiffness has an end.
Assumed: the layer recovers elastically. The rational form interpolates between these two ends; it is a choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def law(d: float, rate: float, p: Any, out: Any) -> None:
    """Multiply the elastic force by ``|d|/(|d| + delta)``."""
    depth = p[0]
    if depth == 0.0:
        return
    size = abs(d)
    factor = size / (size + depth)
    slope = depth / ((size + depth) * (size + depth))
    if d < 0.0:
        slope = -slope
    out[1] = out[1] * factor + out[0] * slope
    out[0] *= factor
    out[2] *= factor


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Elastic force ``k_c d |d|/(|d| + delta)``."""
    elastic, depth = rig.elastic, p[0]
    if depth > 0:
        rig.elastic = lambda d, rate: elastic(d, rate) * abs(d) / (abs(d) + depth)


def _law(d: float, depth: float, k_c: float) -> list[float]:
    out = [k_c * d, k_c, 0.0, 0.0, 0.0, 0.0]
    law(d, 0.0, [depth], out)
    return out


TERM = Term(
    id="soft_layer",
    slot="contact",
    title="rough or padded surface",
    equation=r"F = k_c d \, |d|/(|d| + \delta) + c_c \dot d",
    description=__doc__ or "",
    probability=0.03,
    because="a ball on a ground face meets asperities of less than a micrometre, which one launch closes",
    redefines=(("k_c", "the tangent stiffness far beyond the layer"),),
    parameters=(
        Parameter(
            name="soft_layer_depth",
            symbol=r"\delta",
            unit="m",
            bounds=Bounds(0.0, 1e-4),
            prior=Tailed(Normal(0.0, 5e-7)),
            description="depth within which the contact becomes stiff",
            source="roughness of ground ceramic and steel 0.05-0.5 um; the speckle and sensitive papers of Section 2.1"
            " are on the side of camera and laser, not at the contact. 0.1 mm is a whole sheet of paper",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "shallow indentations meet a soft contact: weak drives and small strokes lose most, strong ones little",
        sign=0,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="J. A. Greenwood and J. B. P. Williamson, Proc. R. Soc. A 295 (1966) 300; Johnson, Contact Mechanics,"
    " 1985, ch. 13",
    checks=(
        Check("delta = 1 um, k_c = 1 N/um, d = 3 um: F = 3 N x 3/4 = 2.25 N", lambda: _law(3e-6, 1e-6, 1e6)[0], 2.25),
        Check(
            "tangent there: 3/4 N/um + 3 N x 1 um/(4 um)^2 = 0.75 + 0.1875 = 0.9375 N/um",
            lambda: _law(3e-6, 1e-6, 1e6)[1],
            0.9375e6,
        ),
    ),
    literal=literal,
    law=law,
)

r"""A stack that remembers where its voltage came from.

.. math:: F_e - k_s z, \qquad \dot z = s\,q\,\dot u - |\dot u|\, z/U.

Bouc-Wen with exponent 1, :math:`\beta = 1/U` and :math:`\gamma = 0`: the study's :math:`F_0` in Eq. (1). From
rest the stroke per volt starts at :math:`q (1 - s)`, after a turn at the end of a wide loop at :math:`q (1 - 2 s)`, and
recovers to `q` within some `U`; :math:`|z| \le s q U`. Beyond :math:`s = 1/2` the tip would move against the voltage. A
cycle between :math:`\pm V_a` opens by the fraction :math:`s\,(1 - \operatorname{sech} a)/a` of its stroke, :math:`a =
V_a/U`. The state depends on the path of the voltage, not on time (rate-independent), so that it has a closed form
along each branch. Assumed: symmetric loops; the virgin state at first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, LogNormal, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def branch(z0: float, u0: float, u: float, q: float, p: Any) -> float:
    """Follow ``dz/du = s q -+ z/U`` from `u0` to `u`."""
    limit = p[0] * q * p[1]
    if u >= u0:
        return float(z0 + (z0 - limit) * math.expm1((u0 - u) / p[1]))
    return float(z0 + (z0 + limit) * math.expm1((u - u0) / p[1]))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Rate ``s q u' - |u'| z/U``."""
    s, scale = p
    rig.memories.append(lambda z, u, du: s * rig.q * du - abs(du) * z / scale)


TERM = Term(
    id="hysteresis",
    slot="stack",
    title="hysteresis of the stack",
    equation=r"F_e - k_s z, \quad \dot z = s q \dot u - |\dot u| z/U",
    description=__doc__ or "",
    probability=0.1,
    because="every stack has a loop; at 20 of 150 V it is some per cent of the stroke",
    parameters=(
        Parameter(
            name="hysteresis_strength",
            symbol="s",
            unit="1",
            bounds=Bounds(0.0, 0.5),
            prior=Tailed(Normal(0.0, 0.2)),
            description="part of the stroke per volt missing at the first rise",
            source="open loops of piezo stacks: 2 % of the stroke at small signals to 10-15 % at full voltage (Physik"
            " Instrumente, Piezo tutorial, read); at 20 of 150 V 4-7 %, which with V_a/U = 0.7 is s = 0.15-0.25."
            " Above 0.5 the tip would move against the voltage after a turn",
            neutral=0.0,
        ),
        Parameter(
            name="hysteresis_voltage",
            symbol="U",
            unit="V",
            bounds=Bounds(1.0, 1000.0),
            prior=LogNormal(30.0, 3.0),
            description="voltage within which the stroke per volt recovers after a turn",
            source="loops keep widening with the amplitude up to the full 150 V, so U is tens of volts; the coercive"
            " voltage of soft PZT, 0.8-1.2 kV/mm on 0.1 mm layers, is 80-120 V. Within 1 V no loop would widen beyond"
            " the smallest drives; with 1000 V a drive of tens of volts has no loop but a lower stroke",
        ),
    ),
    symptom=Symptom(
        "the first rise loses up to the fraction s of its stroke, most at low voltage, and the return lags behind",
        sign=-1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="Y.-K. Wen, J. Eng. Mech. Div. ASCE 102 (1976) 249; H. J. M. T. A. Adriaens, W. L. de Koning and R."
    " Banning, IEEE/ASME Trans. Mechatronics 5 (2000) 331",
    checks=(
        Check(
            "s = 0.5, U = 10 V, q = 0.1 um/V: limit 0.5 um; from rest to 10 ln 2 V: 0.5 um x (1 - 1/2) = 0.25 um",
            lambda: branch(0.0, 0.0, 10 * math.log(2), 1e-7, [0.5, 10.0]),
            0.25e-6,
        ),
        Check(
            "and back by 10 ln 2 V: -0.5 um + (0.25 + 0.5) um x 1/2 = -0.125 um, not zero",
            lambda: branch(0.25e-6, 10 * math.log(2), 0.0, 1e-7, [0.5, 10.0]),
            -0.125e-6,
        ),
        Check(
            "a step of 1 nV from rest keeps its digits: 0.5 x 0.1 um/V x 1 nV = 5e-17 m",
            lambda: branch(0.0, 0.0, 1e-9, 1e-7, [0.5, 10.0]),
            5e-17,
            tolerance=1e-9,
        ),
    ),
    look="the free tip's displacement against the voltage, over one slow cycle",
    literal=literal,
    branch=branch,
)

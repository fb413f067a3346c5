r"""A contact whose loss scales with its force.

.. math:: F = F_\mathrm{el}\,(1 + \lambda \dot d) + c_c \dot d.

Hunt and Crossley: a damper in proportion to the elastic force starts and ends at zero, as a contact must, and gives
the restitution :math:`e = 1 - \alpha v` seen in experiments, with :math:`\lambda = 3\alpha/2`; Lankarani and
Nikravesh: :math:`\lambda = 3(1 - e^2)/(4 v)`. The study's damper :math:`c_c` stays as well. Assumed: one elastic law
for loading and unloading.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def law(d: float, rate: float, p: Any, out: Any) -> None:
    """Multiply the elastic force by ``1 + lambda d'``."""
    factor = 1.0 + p[0] * rate
    out[2] = out[2] * factor + out[0] * p[0]
    out[1] *= factor
    out[0] *= factor


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Elastic force times ``1 + lambda d'``."""
    elastic, lam = rig.elastic, p[0]
    rig.elastic = lambda d, rate: elastic(d, rate) * (1 + lam * rate)


def _law(d: float, rate: float, lam: float, k_c: float) -> list[float]:
    out = [k_c * d, k_c, 0.0, 0.0, 0.0, 0.0]
    law(d, rate, [lam], out)
    return out


TERM = Term(
    id="hunt_crossley",
    slot="contact",
    title="Hunt-Crossley damping",
    equation=r"F = F_\mathrm{el} (1 + \lambda \dot d) + c_c \dot d",
    description=__doc__ or "",
    because=(
        "between hard faces it adds 1 % to the force at 2 cm/s; a lossy film between ball and stack, where it is "
        "strong, is rare"
    ),
    parameters=(
        Parameter(
            name="hunt_crossley_lambda",
            symbol=r"\lambda",
            unit="s/m",
            bounds=Bounds(0.0, 1000.0),
            prior=Tailed(Normal(0.0, 20.0)),
            description="damping over elastic force, per rate of indentation",
            source="hard metals 0.12-0.5 s/m (alpha = 0.08-0.32 s/m, from memory of Hunt and Crossley 1975); a lossy"
            " film that keeps e = 0.5-0.9 at the tip's 2 cm/s needs 3(1 - e^2)/(4 v) = 7-28 s/m (Lankarani and"
            " Nikravesh 1990). At 1000 s/m nothing would be given back (e = 0) from 0.75 mm/s on, a twenty-seventh of"
            " the tip's speed",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "fast indentations meet a stiffer contact and give less back: the effect grows with voltage and with the"
        " steepness of the drive, and a slow, weak push shows none",
        sign=-1,
        frequency="mixed",
        amplitude="grows",
    ),
    reference="K. H. Hunt and F. R. E. Crossley, J. Appl. Mech. 42 (1975) 440; H. M. Lankarani and P. E. Nikravesh, J."
    " Mech. Des. 112 (1990) 369",
    checks=(
        Check(
            "lambda = 2 s/m, rate 0.05 m/s, k_c d = 1 N/um x 3 um: F = 3 N x 1.1 = 3.3 N",
            lambda: _law(3e-6, 0.05, 2.0, 1e6)[0],
            3.3,
        ),
        Check(
            "dF/d(rate) = 3 N x 2 s/m = 6 N s/m",
            lambda: _law(3e-6, 0.05, 2.0, 1e6)[2],
            6.0,
        ),
        Check(
            "opening at 0.1 m/s: F = 3 N x (1 - 0.2) = 2.4 N",
            lambda: _law(3e-6, -0.1, 2.0, 1e6)[0],
            2.4,
        ),
    ),
    literal=literal,
    law=law,
)

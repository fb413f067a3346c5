r"""A ball that sticks to the tip.

.. math:: F_c = k_c d + c_c \dot d \ \text{ also for } d < 0, \quad \text{until } k_c |d| > F_\mathrm{ad}.

Surface energy, a water meniscus or a trace of glue hold the ball until a pull-off force is exceeded: on a sphere
:math:`\tfrac32 \pi w R` (Johnson, Kendall and Roberts) or :math:`4\pi R\gamma` (meniscus). Assumed: the bond is as
stiff as the contact, breaks for good, and does not care how fast it is pulled.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Add to the bond."""
    return rig.change(bond=rig.bond + p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Bond ``F_ad``."""
    rig.bond += p[0]


def _reach(force: float, bond: float) -> float:
    rig = setup(plain_rig(bond=bond), np.array([[force]]))
    return float(rig.bond[0] / rig.k_c[0])


TERM = Term(
    id="adhesion",
    slot="contact",
    title="adhesion",
    equation=r"F_c \text{ holds for } d < 0 \text{ until } k_c |d| > F_\mathrm{ad}",
    description=__doc__ or "",
    probability=0.03,
    because="macroscopic bodies rarely stick, and a ball that sticks is noticed when it is hung",
    parameters=(
        Parameter(
            name="adhesion_force",
            symbol=r"F_\mathrm{ad}",
            unit="N",
            bounds=Bounds(0.0, 1.0),
            prior=Tailed(Normal(0.0, 5e-3)),
            description="pull-off force",
            source="ball of 9.4 mm radius (27 g of steel): 1.5 pi w R = 2.2 mN at w = 50 mJ/m^2, a water meniscus 4 pi"
            " R gamma = 8.5 mN. Roughness lowers both by ten or more (that macroscopic faces rarely stick was read,"
            " not by how much). The edge of a tape can hold some 0.1 N (an estimate). 1 N carries four such balls:"
            " whoever hangs it would see it stick",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "a fixed force takes back speed at separation: weak launches lose most or do not come off at all, strong ones"
        " little",
        sign=-1,
        frequency="mixed",
        amplitude="falls",
    ),
    reference="K. L. Johnson, K. Kendall and A. D. Roberts, Proc. R. Soc. A 324 (1971) 301; J. N. Israelachvili,"
    " Intermolecular and Surface Forces, 3rd ed., 2011, ch. 17",
    checks=(
        Check(
            "bonds add, 10 mN + 18.5 mN, and reach 28.5 mN/(0.1425 N/um) = 0.2 um past d = 0",
            lambda: _reach(0.0185, 0.01),
            2e-7,
        ),
        Check(
            "pull-off of a 9.4 mm ball at w = 50 mJ/m^2: 1.5 pi x 0.05 x 9.4e-3 = 2.2148 mN",
            lambda: float(setup(plain_rig(), np.array([[1.5 * math.pi * 0.05 * 9.4e-3]])).bond[0]),
            2.2148e-3,
            tolerance=2e-5,
        ),
    ),
    look="the force that lifts the resting ball off the face, by tilting the rig or with a spring",
    literal=literal,
    setup=setup,
)

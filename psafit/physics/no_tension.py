r"""A contact that can push but not pull.

.. math:: F_c \to (1 - s)\, F_c \quad \text{where } F_c < 0 \text{ and } d \ge 0.

A linear spring and damper in parallel pulls the ball back before it lets go: near separation :math:`c_c \dot d` is
negative and exceeds :math:`k_c d`. Two dry bodies cannot do that. At :math:`s = 1` the ball leaves when the force, not
the indentation, reaches zero. Between 0 and 1 part of the pull remains, for instance of a film.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Weaken the pull."""
    return rig.change(pull=rig.pull * (1.0 - p[:, 0]))


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Negative force times ``1 - s``."""
    rig.pull *= 1 - p[0]


def _force(d: float, rate: float, s: float) -> float:
    rig = setup(plain_rig(), np.array([[s]]))
    return float(rig.pull[0] * (rig.k_c[0] * d + rig.c_c[0] * rate))


TERM = Term(
    id="no_tension",
    slot="contact",
    title="contact cannot pull",
    equation=r"F_c \to (1 - s) F_c \text{ where } F_c < 0,\ d \ge 0",
    description=__doc__ or "",
    probability=0.9,
    because="a dry contact does not pull; whoever glues or wets one says so",
    parameters=(
        Parameter(
            name="no_tension_s",
            symbol="s",
            unit="1",
            bounds=Bounds(0.0, 1.0),
            prior=Tailed(Normal(1.0, 0.05)),
            description="part of the contact's pull that is absent",
            source="1 for dry solids (Brogliato, Nonsmooth Mechanics, 2016, ch. 2: the pull of a Kelvin-Voigt contact"
            " is an artefact); less where a film or tape lies between",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the ball keeps the speed that the damper would take back just before separation: more where the contact opens"
        " fast, and the same at every voltage",
        sign=1,
        frequency="grows",
        amplitude="flat",
    ),
    reference="B. Brogliato, Nonsmooth Mechanics, 3rd ed., 2016, ch. 2",
    checks=(
        Check(
            "d = 0.1 um, rate -1 mm/s: k_c d + c_c d' = 0.01425 N - 0.068 N = -0.05375 N; s = 0.6 leaves -0.0215 N",
            lambda: _force(1e-7, -1e-3, 0.6),
            -0.0215,
        ),
        Check(
            "a rig that lost half its pull loses a quarter of the rest: 0.5 x 0.75 = 0.375",
            lambda: float(setup(plain_rig(pull=0.5), np.array([[0.25]])).pull[0]),
            0.375,
        ),
    ),
    literal=literal,
    setup=setup,
)

r"""A stack softer, or stiffer, than its data sheet says.

.. math:: k_s \to r_k k_s, \qquad q \text{ kept}.

The stiffness of a multilayer stack depends on signal, preload and electrical boundary; the glue line and the wall act
as springs in series. Assumed: the free stroke per volt stays as it is, since a spring in series with an unloaded stack
moves with it; so the blocking force scales with :math:`r_k`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Parameter, Tailed
from psafit.physics.checks import plain_rig
from psafit.physics.term import Check, ReferenceRig, Setup, Symptom, Term


def setup(rig: Setup, p: FloatArray) -> Setup:
    """Scale the stiffness."""
    return rig.change(k_s=rig.k_s * p[:, 0])


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Stiffness ``r_k k_s``."""
    rig.k_s *= p[0]


def _blocking_force(r_k: float) -> float:
    rig = setup(plain_rig(), np.array([[r_k]]))
    return float(rig.k_s[0] * rig.q[0] * 20.0)


TERM = Term(
    id="stack_stiffness",
    slot="stack",
    title="stiffness of stack and glue line",
    equation=r"k_s \to r_k k_s, \quad q \text{ kept}",
    description=__doc__ or "",
    because=(
        "data sheets are 20 % off, but a contact ten times softer hides most of that; a glue line thick enough to "
        "show is rare"
    ),
    parameters=(
        Parameter(
            name="stack_stiffness_ratio",
            symbol="r_k",
            unit="1",
            bounds=Bounds(0.05, 5.0),
            prior=Tailed(LogNormal(0.9, 1.3)),
            description="stiffness over the data sheet's",
            source="data sheets give stack stiffness to about 20 % (935 N over 17.4 um would be 53.7 N/um, stated are"
            " 48.9); 20-200 um of cyanoacrylate (1.5 GPa) under 25 mm^2 are 1.9e9-1.9e8 N/m in series: r_k = 0.97-0.8."
            " 0.05 would be 15 mm of that glue; 5, with 48 GPa at 1, a ceramic of 240 GPa, stiffer than steel",
            neutral=1.0,
        ),
    ),
    symptom=Symptom(
        "a stiffer stack follows the voltage faster against its damping: fast sines and jumps change, slow sines do"
        " not",
        sign=0,
        frequency="mixed",
        amplitude="flat",
    ),
    reference="A. Preumont, Vibration Control of Active Structures, 3rd ed., 2011, ch. 3 (piezoelectric transducers)",
    checks=(
        Check(
            "4.89e7 N/m x 0.8 = 3.912e7 N/m",
            lambda: float(setup(plain_rig(), np.array([[0.8]])).k_s[0]),
            3.912e7,
        ),
        Check(
            "blocking force at 20 V, free stroke 2.4 um kept: 0.8 x 4.89e7 N/m x 2.4 um = 93.888 N",
            lambda: _blocking_force(0.8),
            93.888,
        ),
    ),
    look="the way that the tip gives under a known static force",
    literal=literal,
    setup=setup,
)

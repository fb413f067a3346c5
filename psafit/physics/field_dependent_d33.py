r"""A stroke that grows faster than the voltage.

.. math:: F_e = k_s q u\,(1 + \alpha |u|).

Rayleigh's law of ferroelectrics: the field moves domain walls across pinning centres, so that the piezoelectric
coefficient rises linearly with the amplitude, :math:`d_{33}(E) = d_{33}(0) + \alpha_d E`. The growth is of
the irreversible part, whose loop is left out here (see `hysteresis`). Assumed: the same for both signs, no bias field.
`q` is then the coefficient at vanishing voltage.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term


def stack_factor(size: float, p: Any) -> float:
    """Return ``1 + alpha |u|``."""
    return 1.0 + float(p[0]) * size


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Stroke ``q u (1 + alpha |u|)``."""
    stroke, alpha = rig.stroke, p[0]
    rig.stroke = lambda u: stroke(u) * (1 + alpha * abs(u))


TERM = Term(
    id="field_dependent_d33",
    slot="stack",
    title="stroke per volt rises with the voltage",
    equation=r"F_e = k_s q u \, (1 + \alpha |u|)",
    description=__doc__ or "",
    probability=0.08,
    because="soft PZT does this at any field above a threshold; at 20 of 150 V it may be small",
    parameters=(
        Parameter(
            name="field_d33_alpha",
            symbol=r"\alpha",
            unit="1/V",
            bounds=Bounds(0.0, 0.1),
            prior=Tailed(Normal(0.006, 0.004)),
            description="relative growth of the stroke per volt, for each volt",
            source="the loop that belongs to it opens by x/(2 (1 + x)) of the stroke, x = alpha V: loops of 10-15 % at"
            " full voltage (Physik Instrumente, Piezo tutorial, read) are x = 0.25-0.43, or 0.5-0.86 if the drive goes"
            " from 0 V (the loop is x/(4 + 2 x) then), and 2 % at small signals."
            " 0.003-0.015 1/V on layers of 0.11 mm is from memory (Hall 2001 and Li, Cao and Cross 1991, of which only"
            " abstracts were read). At 0.1 1/V the stroke per volt at 150 V would be 16 times that at 1 V; a data"
            " sheet's strokes at 100 and 150 V are proportional",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "the launch range grows faster than the voltage, by the factor 1 + alpha V_a or more, at every frequency",
        sign=1,
        frequency="mixed",
        amplitude="grows",
    ),
    reference="D. A. Hall, J. Mater. Sci. 36 (2001) 4575; S. Li, W. Cao and L. E. Cross, J. Appl. Phys. 69 (1991) 7219",
    checks=(
        Check("alpha = 0.01 1/V at 20 V: 1 + 0.2 = 1.2", lambda: stack_factor(20.0, [0.01]), 1.2),
        Check(
            "stroke at -15 V with q = 0.12 um/V, alpha = 0.02 1/V: -1.8 um x (1 + 0.3) = -2.34 um",
            lambda: 1.2e-7 * -15.0 * stack_factor(15.0, [0.02]),
            -2.34e-6,
        ),
    ),
    look="the free tip's stroke per volt, at several amplitudes",
    literal=literal,
    stack_factor=stack_factor,
)

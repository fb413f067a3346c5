r"""A damper that grows with the indentation.

.. math:: F = k_c d + c_c \dot d \left(\frac{|d|}{d_0}\right)^{p}, \qquad d_0 = 1\ \mu\mathrm m.

The contact area, and with it the material that dissipates, grows with the indentation: :math:`p = 1/4` keeps the
restitution of a Hertzian contact constant (Tsuji et al.). :math:`p = 1/2` follows from the viscoelasticity of the
solid (Kuwabara and Kono). :math:`p = 1` and :math:`3/2` are Hunt and Crossley's for a linear and a Hertzian contact.
The force starts at zero instead of with the jump :math:`c_c \dot d` at first touch. `c_c` keeps its unit: it holds at
1 um.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from psafit.parameters import Bounds, Normal, Parameter, Tailed
from psafit.physics.term import Check, ReferenceRig, Symptom, Term

D_0 = 1e-6


def law(d: float, rate: float, p: Any, out: Any) -> None:
    """Multiply the damping force by ``(|d|/d_0)^p``."""
    power = p[0]
    if power == 0.0:
        return
    if d == 0.0:
        out[3] = out[4] = out[5] = 0.0
        return
    factor = (abs(d) / D_0) ** power
    out[4] = (out[4] + out[3] * power / d) * factor
    out[3] *= factor
    out[5] *= factor


def literal(rig: ReferenceRig, p: Sequence[float]) -> None:
    """Damping force ``c_c d' |d/d_0|^p``."""
    damping, power = rig.damping, p[0]
    rig.damping = lambda d, rate: damping(d, rate) * abs(d / D_0) ** power


def _law(d: float, rate: float, power: float, c_c: float) -> list[float]:
    out = [0.0, 0.0, 0.0, c_c * rate, 0.0, c_c]
    law(d, rate, [power], out)
    return out


TERM = Term(
    id="indentation_damping",
    slot="contact",
    title="damping grows with indentation",
    equation=r"F = k_c d + c_c \dot d \, (|d|/d_0)^p, \quad d_0 = 1\,\mu\mathrm{m}",
    description=__doc__ or "",
    because=(
        "the area that is rubbed and strained does grow with depth, but of a loss of some per cent that change "
        "does not show"
    ),
    redefines=(("c_c", "the damping at 1 um of indentation"),),
    parameters=(
        Parameter(
            name="indentation_damping_p",
            symbol="p",
            unit="1",
            bounds=Bounds(0.0, 1.5),
            prior=Tailed(Normal(0.0, 0.5)),
            description="exponent of the damping's growth with indentation",
            source="1/4 (Tsuji, Tanaka and Ishida 1992), 1/2 (Kuwabara and Kono 1987), 1-3/2 (Hunt and Crossley 1975),"
            " of all of which abstracts at most were read; no law of the literature grows faster than 3/2",
            neutral=0.0,
        ),
    ),
    symptom=Symptom(
        "contacts shallower than 1 um lose their damping, deeper ones gain: weak launches, which the damper held back"
        " at separation, gain most; where little else damps a hard contact, strong square drives lose",
        sign=0,
        frequency="mixed",
        amplitude="mixed",
    ),
    reference="Y. Tsuji, T. Tanaka and T. Ishida, Powder Technol. 71 (1992) 239, doi:10.1016/0032-5910(92)88030-L;"
    " G. Kuwabara and K. Kono, Jpn. J. Appl. Phys. 26 (1987) 1230",
    checks=(
        Check(
            "p = 1/4, c_c = 60 N s/m, rate 0.01 m/s, d = 16 um: 0.6 N x 16^(1/4) = 1.2 N",
            lambda: _law(16e-6, 0.01, 0.25, 60.0)[3],
            1.2,
        ),
        Check(
            "its derivative by d: p F/d = 0.25 x 1.2 N/16 um = 18750 N/m",
            lambda: _law(16e-6, 0.01, 0.25, 60.0)[4],
            18750.0,
        ),
        Check(
            "p = 3/2 at d = 0.25 um: damper 60 N s/m x 0.25^1.5 = 7.5 N s/m",
            lambda: _law(0.25e-6, 0.01, 1.5, 60.0)[5],
            7.5,
        ),
    ),
    literal=literal,
    law=law,
)

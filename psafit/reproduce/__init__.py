r"""Check what a study printed against its own model: with the study's time step, and converged.

Eq. (12) has a fast eigenvalue, about :math:`-(c_s + c_c)/m`. A Runge-Kutta 4 step `h` multiplies
the mode of an eigenvalue :math:`\lambda` by

.. math:: R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, \qquad z = \lambda h,

and the march is stable only while :math:`|R(\lambda h)| \le 1` for all of them. Beyond that a mode
which should vanish in the first microsecond grows until it alone decides when the indentation turns
negative. Everything here follows from that number.
"""

from psafit.reproduce.claims import judge, read_published
from psafit.reproduce.records import (
    NOT_REPRODUCED,
    ONLY_WITH_STEP,
    REPRODUCED,
    Claim,
    Convergence,
    Reproduction,
    Sweep,
)
from psafit.reproduce.scheme import convergence
from psafit.reproduce.study import reproduce

__all__ = [
    "NOT_REPRODUCED",
    "ONLY_WITH_STEP",
    "REPRODUCED",
    "Claim",
    "Convergence",
    "Reproduction",
    "Sweep",
    "convergence",
    "judge",
    "read_published",
    "reproduce",
]

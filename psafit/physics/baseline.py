r"""The study's model: what `psafit` fits before it doubts anything.

.. math::
    m \ddot x_1 = -c_s \dot x_1 - k_s x_1 + k_s q u - F_c, \quad M \ddot x_2 = F_c, \quad
    F_c = k_c d + c_c \dot d, \quad d = x_1 - x_2,

from rest until `d` first turns negative, then the pendulum of Eqs. (16)-(17).

Priors are one standard deviation of a factor of ten wide: they say which order of magnitude would surprise
nobody, and leave the rest to the data.
"""

from psafit.parameters import Bounds, LogNormal, Parameter

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "k_c",
        "k_c",
        "N/m",
        Bounds(1e3, 1e9),
        LogNormal(1e6, 10.0),
        "contact stiffness",
        "Hertz contact of a 27 g steel ball (radius 9.4 mm) on ceramic at 0.1-1 N: (6 E*^2 R F)^(1/3) = 2-5 MN/m"
        " (Johnson, Contact Mechanics, 1985, eq. 4.23-4.24); paper or tape on the ball softens it tenfold or more",
    ),
    Parameter(
        "c_s",
        "c_s",
        "N s/m",
        Bounds(1.0, 1e6),
        LogNormal(1e3, 10.0),
        "structural damping of the stack",
        "2 zeta sqrt(k_s m): 10-50 N s/m for the loss tangent of a soft PZT (0.01-0.05); the study lets it stand in"
        " for hysteresis as well (Section 3.1), hence the wide upper side",
    ),
    Parameter(
        "c_c",
        "c_c",
        "N s/m",
        Bounds(1e-2, 1e5),
        LogNormal(30.0, 10.0),
        "contact damping",
        "2 zeta sqrt(k_c M) with zeta = 0.01-1 at k_c = 1 MN/m: 3-330 N s/m",
    ),
)

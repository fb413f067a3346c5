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
        name="k_c",
        symbol="k_c",
        unit="N/m",
        bounds=Bounds(1e3, 1e9),
        prior=LogNormal(1e6, 10.0),
        description="contact stiffness",
        source="Hertz contact of a 27 g steel ball (radius 9.4 mm) on PZT of 48 GPa: 4/3 E* sqrt(R) = 5.65e9 N/m^1.5,"
        " that is 5.65 MN/m at a micrometre (Johnson, Contact Mechanics, 1985, eq. 4.23-4.24); a rough or glued face"
        " has a third of it, paper or tape a tenth or less. On 1e3 N/m the ball swings at 31 Hz, slower than a drive"
        " that launches it; 1e9 N/m are twenty stacks, and ball and tip are one body",
    ),
    Parameter(
        name="c_s",
        symbol="c_s",
        unit="N s/m",
        bounds=Bounds(1.0, 1e6),
        prior=LogNormal(1e3, 10.0),
        description="structural damping of the stack",
        source="2 zeta sqrt(k_s m), zeta = tan(delta)/2: 5-25 N s/m for the loss tangent of a soft PZT (0.01-0.05),"
        " some hundreds with glue and clamp; the study lets it stand in for hysteresis (Section 3.1) and finds 14,000,"
        " hence the wide prior. Thousands are no damping but a lag c_s/k_s, and stand for something else. 1 N s/m is"
        " a loss tangent of 0.002, less than any soft PZT has; 1e6 N s/m a lag of 20 ms, longer than a launch",
    ),
    Parameter(
        name="c_c",
        symbol="c_c",
        unit="N s/m",
        bounds=Bounds(1e-2, 1e5),
        prior=LogNormal(30.0, 10.0),
        description="contact damping",
        source="2 zeta sqrt(k_c M) with zeta = 0.01-1 at k_c = 1 MN/m: 3-330 N s/m. The bounds are of the search: a"
        " value near one, three standard deviations off, is flagged as implausible",
    ),
)

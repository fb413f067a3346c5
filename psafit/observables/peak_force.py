"""Peak force: the largest force between tip and ball until the ball flies, N.

It weighs stiffness and damping of the contact otherwise than the launch range does, which is the force's impulse.
"""

from __future__ import annotations

import numpy as np

from psafit.arrays import FloatArray
from psafit.observables.observable import Launches, Observable, scatter
from psafit.parameters import Bounds, LogNormal


def _of(launches: Launches) -> FloatArray:
    """A ball that is not launched ends no contact, whose largest force could be known. Zero stands for it."""
    if launches.peak_force is None:
        raise ValueError("the simulation was not asked for forces")
    return np.nan_to_num(launches.peak_force)


PEAK_FORCE = Observable(
    name="peak_force",
    column="peak_force_n",
    unit="N",
    scale=1.0,
    title="peak force",
    called=("peak force", "contact force", "force", "kraft", "kontaktkraft"),
    of=_of,
    scatter=scatter(
        "peak_force",
        "N",
        LogNormal(0.05, 2.5),
        LogNormal(0.005, 3.0),
        Bounds(1e-5, 10.0),
        (
            "as that of the launch range, and a force sensor's linearity: some per cent",
            "charge amplifiers of small force sensors: some millinewtons",
        ),
    ),
    offset=0.01,
    limits=(0.0, 1e6),
    still=0.05,
    usual=(0.01, 1e4),
    mistaken=(("kN",), ("mN",)),
    blank=True,
    force=True,
)

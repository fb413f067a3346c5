"""Compile the simulator ahead of its first use: ``python -m psafit.simulate``.

Numba compiles the two engines when they are first called, and keeps the machine code next to the sources. Processes
that start together would each compile it.
"""

from __future__ import annotations

import numpy as np

from psafit.experiment import Constants
from psafit.physics import terms
from psafit.simulate import Design, simulate


def main() -> None:
    """Simulate launches by the closed form and by the stepper, one set and a batch that several threads share."""
    rig = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
    design = Design.sweep(rig, "sine", np.geomspace(200.0, 2000.0, 64), 20.0)
    for n_sets in (1, 256):
        simulate(design, np.tile([4e5, 9e3, 60.0], (n_sets, 1)))
        simulate(design, np.tile([4e5, 9e3, 60.0, 1.5], (n_sets, 1)), terms(["hertz_exponent"]))


if __name__ == "__main__":
    main()

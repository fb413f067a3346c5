"""Compile the simulator ahead of its first use: ``python -m psafit.simulate``.

Numba compiles the two engines when they are first called, and keeps the machine code next to the sources. Processes
that start together would each compile it.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor

import numpy as np

from psafit.experiment import Constants
from psafit.physics import terms
from psafit.simulate import Design, simulate

# Causes, and values of the parameters: of what the closed form simulates, and of what the stepper does.
ENGINES = (((), (4e5, 9e3, 60.0)), (("hertz_exponent",), (4e5, 9e3, 60.0, 1.5)))


def launch(causes: tuple[str, ...], values: tuple[float, ...]) -> None:
    """Simulate launches of one set of parameters."""
    rig = Constants(M=0.027, m=0.005, q=1.2e-7, l=0.09, k_s=4.89e7, g=9.81)
    design = Design.sweep(rig, "sine", np.geomspace(200.0, 2000.0, 64), 20.0)
    simulate(design, values, terms(causes))


def main() -> None:
    """Compile each engine in a process of its own."""
    with ProcessPoolExecutor(len(ENGINES)) as processes:
        for done in [processes.submit(launch, *engine) for engine in ENGINES]:
            done.result()


if __name__ == "__main__":
    main()

"""When a fixed-step explicit integrator of the contact is stable: the classical Runge-Kutta method of order four."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from psafit.arrays import FloatArray
from psafit.experiment import Constants
from psafit.physics.term import Setup


def contact_matrix(theta: ArrayLike, constants: Constants) -> FloatArray:
    """Matrix of Eq. (14) of the study, (4, 4); `theta` is (3,): k_c (N/m), c_s (N s/m), c_c (N s/m)."""
    return contact_matrix_of(Setup.of(constants, np.asarray(theta, dtype=float)[None, :]))


def contact_matrix_of(rig: Setup) -> FloatArray:
    """Matrix of Eq. (14) for the first parameter set of a rig; a lagging amplifier adds its own rate, (5, 5)."""
    k_c, c_s, c_c, m, ball, k_s = (float(x[0]) for x in (rig.k_c, rig.c_s, rig.c_c, rig.m, rig.M, rig.k_s))
    lag = float(rig.lag[0])
    contact = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-(k_s + k_c) / m, -(c_s + c_c) / m, k_c / m, c_c / m],
            [0.0, 0.0, 0.0, 1.0],
            [k_c / ball, c_c / ball, -k_c / ball, -c_c / ball],
        ]
    )
    if lag == 0.0:
        return contact
    whole = np.zeros((5, 5))
    whole[:4, :4] = contact
    whole[1, 4] = k_s * float(rig.q[0]) / m
    whole[4, 4] = -1.0 / lag
    return whole


def rk4_growth(eigenvalue: Any, step: Any) -> Any:
    r"""Growth of a mode per step, :math:`|R(\lambda h)|` with :math:`R(z) = \sum_{k \le 4} z^k/k!`; broadcasts."""
    z = np.multiply(eigenvalue, step)
    return np.abs(1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4))))


def largest_stable_step(eigenvalues: NDArray[np.complex128]) -> float:
    """First step, s, at which a mode that should decay no longer does; infinite if none.

    Parameters
    ----------
    eigenvalues : (n,) complex array, 1/s
    """
    limit = math.inf
    for value in eigenvalues[eigenvalues.real < 0]:
        unit = value / abs(value)
        # The method's stability region lies within |z| < 4; its boundary is scanned, then refined.
        z = np.linspace(1e-3, 4.0, 4001)
        outside = np.flatnonzero(rk4_growth(unit, z) > 1.0)
        if outside.size and outside[0] > 0:
            edge = outside[0]
            root = brentq(lambda x, u=unit: float(rk4_growth(u, x)) - 1.0, z[edge - 1], z[edge])
            limit = min(limit, root / abs(value))
    return limit

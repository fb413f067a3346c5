"""From parameter sets to launch ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from psafit.simulate import closed_form
from psafit.simulate.design import Design

FloatArray = NDArray[np.float64]

# Contact always ends in the baseline (the integral of the indentation over a transient is zero), in all of the prior
# range within milliseconds to seconds; the horizon only stops a hopeless search.
HORIZON = 100.0


@dataclass(frozen=True)
class Simulation:
    """What the simulator says of a batch; arrays have shape (n_sets, n_points).

    Parameters
    ----------
    launch_range : array, m
        Zero where the ball is not launched.
    separation_time : array, s
        NaN where the ball does not separate within the horizon.
    separation_speed : array, m/s
    launched : bool array
    engine : str
        The path that ran.
    """

    launch_range: FloatArray
    separation_time: FloatArray
    separation_speed: FloatArray
    launched: NDArray[np.bool_]
    engine: str


def launch_range(speed: ArrayLike, length: float, g: float) -> FloatArray:
    r"""Largest horizontal excursion of the pendulum, Eqs. (16)-(17) of the study.

    .. math:: h = v^2/2g, \qquad L_r = l \sin\theta_m = \sqrt{h (2l - h)},

    which keeps its digits for microscopic swings, where :math:`\cos\theta_m` is one to rounding. A ball that
    rises above the string's suspension has passed the horizontal: :math:`L_r = l`.

    Parameters
    ----------
    speed : array, m/s
    length : float
        String, m.
    g : float
        m/s^2.

    Returns
    -------
    array, m
    """
    height = np.minimum(np.square(np.asarray(speed, dtype=float)) / (2 * g), length)
    return np.sqrt(height * (2 * length - height))


def simulate(design: Design, theta: ArrayLike, *, horizon: float = HORIZON) -> Simulation:
    """Launch the ball once for every parameter set and measurement point.

    Parameters
    ----------
    design : Design
        Measurement conditions, (n_points,).
    theta : (n_sets, 3) array
        k_c (N/m), c_s (N s/m), c_c (N s/m) of each set; a single set may be (3,).
    horizon : float, s
        Contact time after which the ball counts as not launched.

    Returns
    -------
    Simulation

    Raises
    ------
    ValueError
        If `theta` has another shape, a stiffness is not positive, or a damping is negative or not finite.
    """
    sets = np.atleast_2d(np.asarray(theta, dtype=float))
    if sets.ndim != 2 or sets.shape[1] != 3:
        raise ValueError(f"theta has shape {np.shape(theta)}, expected (n_sets, 3): k_c, c_s, c_c")
    if not (np.isfinite(sets).all() and (sets[:, 0] > 0).all() and (sets[:, 1:] >= 0).all()):
        raise ValueError("theta needs k_c > 0, c_s >= 0 and c_c >= 0, all finite")
    when, speed, status = closed_form.separation(design, sets, horizon)
    constants = design.constants
    return Simulation(
        launch_range(speed, constants.l, constants.g),
        when,
        speed,
        status == closed_form.LAUNCHED,
        "closed form",
    )

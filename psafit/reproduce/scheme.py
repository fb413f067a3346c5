"""Numerics of the study's scheme: where it is stable, what its fast mode does, and how it converges."""

from __future__ import annotations

import math

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import (
    Constants,
)
from psafit.reproduce.records import (
    Convergence,
    FastMode,
    Stability,
)
from psafit.reproduce.solutions import (
    stepped_path,
)
from psafit.simulate import Design, simulate
from psafit.simulate.reference import (
    ContactParameters,
    Point,
    rk4_launch,
)
from psafit.simulate.stability import contact_matrix, largest_stable_step, rk4_growth


def stability(parameters: ContactParameters, constants: Constants, step: float) -> Stability:
    """Stability of Runge-Kutta 4 on Eq. (12) around the study's step."""
    values = np.linalg.eigvals(contact_matrix(parameters, constants)).astype(complex)
    values = values[np.argsort(-np.abs(values))]
    steps = np.linspace(0.0, 1.2, 241)[1:] * step
    return Stability(
        values,
        steps,
        rk4_growth(values[:, None], steps),
        largest_stable_step(values),
        step,
        rk4_growth(values, step),
    )


def fast_mode(point: Point, parameters: ContactParameters, constants: Constants, step: float, total: float) -> FastMode:
    r"""Follow the fastest mode along one Runge-Kutta march under a sine.

    The left eigenvector `w` of the fastest eigenvalue takes the mode's amplitude out of the state.
    Exactly, it obeys :math:`a' = \lambda a + w \cdot B(t)`, hence

    .. math::
        a(t) = w_2 \frac{k_s q V}{m}
               \operatorname{Im} \frac{e^{i\omega t} - e^{\lambda t}}{i\omega - \lambda} .
    """
    path = stepped_path(rk4_launch(point, parameters, constants, step, total, path=True))
    values, right = np.linalg.eig(contact_matrix(parameters, constants))
    fastest = int(np.argmax(np.abs(values)))
    left = np.linalg.inv(right)[fastest]
    rate, omega = values[fastest], 2.0 * math.pi * point.frequency
    lead = left[1] * constants.k_s * constants.q * point.amplitude / constants.m
    swing = np.exp(1j * omega * path.time) - np.exp(rate * path.time)
    exact = lead * (swing / (1j * omega - rate)).imag
    in_indentation = right[0, fastest] - right[2, fastest]
    error = np.abs((path.state @ left - exact) * in_indentation)
    half = np.arange(path.time.size) >= path.time.size // 2
    growth = math.exp(float(np.polyfit(np.flatnonzero(half), np.log(error[half]), 1)[0]))
    return FastMode(step, path.time, error, path.state[:, 0] - path.state[:, 2], growth)


def convergence(
    point: Point,
    parameters: ContactParameters,
    constants: Constants,
    steps: FloatArray,
    total: float,
) -> Convergence:
    """Launch range at one condition under refinement of the Runge-Kutta step."""
    found = np.array([rk4_launch(point, parameters, constants, float(h), total).launch_range for h in steps])
    exact = float(simulate(Design.sweep(constants, *point), np.array(parameters)).launch_range[0, 0])
    limit = largest_stable_step(np.linalg.eigvals(contact_matrix(parameters, constants)).astype(complex))
    fine = steps < 0.6 * limit
    if fine.sum() < 2:
        raise InputError(
            f"[scheme] step = {steps[0]:g} s is far beyond the stable {limit:.3g} s", "give the step the study used"
        )
    order = float(np.polyfit(np.log(steps[fine]), np.log(np.abs(found[fine] - exact)), 1)[0])
    return Convergence(point.frequency, point.amplitude, steps, found, exact, order)

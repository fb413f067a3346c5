"""The contact in detail: trajectories, forces and impulses from the closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from psafit.arrays import FloatArray
from psafit.physics.term import Setup
from psafit.simulate import closed_form
from psafit.simulate.design import SQUARE, Design


@dataclass(frozen=True)
class Contact:
    """One contact, from rest to separation.

    Parameters
    ----------
    time : (n_times,) array, s
    tip, ball : (n_times,) arrays, m
        Displacements x1 and x2.
    tip_speed, ball_speed : (n_times,) arrays, m/s
    indentation : (n_times,) array, m
    indentation_rate : (n_times,) array, m/s
    force : (n_times,) array, N
        Contact force, Eq. (9).
    peak_force : float, N
        F_m.
    contact_time : float, s
        t_d.
    compression_time : float, s
        When the indentation is largest.
    compression_impulse, restitution_impulse : float, N s
        Impulse of the contact force before and after `compression_time`.
    """

    time: FloatArray
    tip: FloatArray
    ball: FloatArray
    tip_speed: FloatArray
    ball_speed: FloatArray
    indentation: FloatArray
    indentation_rate: FloatArray
    force: FloatArray
    peak_force: float
    contact_time: float
    compression_time: float
    compression_impulse: float
    restitution_impulse: float

    @property
    def restitution(self) -> float:
        """Poisson's coefficient, Eq. (18)."""
        return self.restitution_impulse / self.compression_impulse


class _Motion:
    """Indentation, its derivatives and integrals, at any time of one contact."""

    def __init__(self, design: Design, theta: FloatArray) -> None:
        batch = closed_form.modes(Setup.of(design.constants, theta[None, :]))
        used = batch.weight[0] != 0
        pole, weight = batch.pole[0, used], batch.weight[0, used]
        frequency, volt = float(design.frequency[0]), float(design.amplitude[0])
        self._k_c, _, self._c_c = theta
        self._M = design.constants.M
        self._square = bool(design.waveform[0] == SQUARE)
        self._half = 0.5 / frequency
        if self._square:
            self._pole, self._kick = pole, volt * weight / pole
            self._start = [self._kick]
        else:
            omega = 2 * np.pi * frequency
            drive = 1j * omega
            forced = batch.lead[0] * drive**2 * volt * -1j / np.prod(drive - batch.roots[0])
            self._pole = np.append(pole, drive)
            self._start = [np.append(volt * omega * weight / (pole**2 + omega**2), forced)]
        self._rest = [(0.0, 0.0)]  # integral and double integral of d where each piece starts

    def _pieces(self, index: int) -> None:
        while len(self._start) <= index:
            j, double = self._integrals(len(self._start) - 1, np.array([self._half]))
            self._rest.append((float(j[0]), float(double[0])))
            sign = -2.0 if len(self._start) % 2 else 2.0
            self._start.append(self._start[-1] * np.exp(self._pole * self._half) + sign * self._kick)

    def _integrals(self, index: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, s = self._start[index], self._pole
        first, second = self._rest[index]
        z = s * t[:, None]
        grow = np.expm1(z)
        # The second remainder of exp loses its digits for slow poles, where its series is short.
        series = z * z * (0.5 + z * (1 / 6 + z * (1 / 24 + z / 120)))
        twice = np.where(np.abs(z) < 1e-3, series, grow - z)
        single = first + (grow * (a / s)).sum(axis=1).real
        return single, second + first * t + (twice * (a / s**2)).sum(axis=1).real

    def at(self, time: FloatArray) -> dict[str, FloatArray]:
        time = np.atleast_1d(np.asarray(time, dtype=float))
        index = np.zeros(time.size, int)
        if self._square:
            # A moment at a switch belongs to the piece that ends there.
            index = np.maximum(np.ceil(time / self._half * (1 - 1e-15)).astype(int) - 1, 0)
        d, rate, single, double = (np.empty(time.size) for _ in range(4))
        for piece in np.unique(index):
            here = index == piece
            self._pieces(int(piece))
            t = time[here] - piece * self._half
            wave = self._start[piece] * np.exp(self._pole * t[:, None])
            d[here] = wave.sum(axis=1).real
            rate[here] = (wave * self._pole).sum(axis=1).real
            single[here], double[here] = self._integrals(int(piece), t)
        ball_speed = (self._c_c * d + self._k_c * single) / self._M
        ball = (self._c_c * single + self._k_c * double) / self._M
        return {
            "tip": ball + d,
            "ball": ball,
            "tip_speed": ball_speed + rate,
            "ball_speed": ball_speed,
            "indentation": d,
            "indentation_rate": rate,
            "force": self._k_c * d + self._c_c * rate,
        }


def contact(design: Design, theta: ArrayLike, *, n_times: int = 401) -> list[Contact]:
    """Follow the contact at every measurement point, for one parameter set.

    Parameters
    ----------
    design : Design
        Measurement conditions, (n_points,); amplitudes above zero.
    theta : (3,) array
        k_c (N/m), c_s (N s/m), c_c (N s/m).
    n_times : int
        Moments between rest and separation, both included.

    Returns
    -------
    list of Contact
        One per point.

    Raises
    ------
    ValueError
        Where the ball is not launched.
    """
    values = np.asarray(theta, dtype=float)
    when, _, _, status = closed_form.separation(design, Setup.of(design.constants, values[None, :]))
    contacts = []
    for j in range(design.n_points):
        if status[0, j] != closed_form.LAUNCHED:
            raise ValueError(
                f"no launch at {design.frequency[j]:g} Hz and {design.amplitude[j]:g} V: no contact to follow"
            )
        motion = _Motion(design.point(j), values)
        end = float(when[0, j])
        time = np.linspace(0.0, end, n_times)
        # Extremes are sought on a grid fine enough for the fast transient at the start, too.
        fine = np.unique(np.concatenate([np.linspace(0, end, 2001), np.geomspace(end * 1e-9, end, 2001)]))
        state = motion.at(fine)

        def peak(name: str, slope: object, fine: FloatArray = fine, state: dict[str, FloatArray] = state) -> float:
            top = int(np.argmax(state[name]))
            low, high = fine[max(top - 1, 0)], fine[min(top + 1, fine.size - 1)]
            ends = slope(low), slope(high)  # type: ignore[operator]
            return float(brentq(slope, low, high, xtol=1e-22)) if ends[0] > 0 > ends[1] else float(fine[top])

        turn = peak("indentation", lambda t, m=motion: float(m.at(t)["indentation_rate"][0]))
        at_turn, at_end = motion.at(np.array([turn])), motion.at(np.array([end]))
        top = int(np.argmax(state["force"]))
        near = np.linspace(fine[max(top - 1, 0)], fine[min(top + 1, fine.size - 1)], 401)
        compression = design.constants.M * float(at_turn["ball_speed"][0])
        total = design.constants.M * float(at_end["ball_speed"][0])
        contacts.append(
            Contact(
                time=time,
                **motion.at(time),
                peak_force=float(motion.at(near)["force"].max()),
                contact_time=end,
                compression_time=turn,
                compression_impulse=compression,
                restitution_impulse=total - compression,
            )
        )
    return contacts

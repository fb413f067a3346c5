"""The contact in detail: trajectories, forces and impulses from the closed form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from psafit.arrays import ComplexArray, FloatArray
from psafit.physics.term import Setup
from psafit.simulate import closed_form
from psafit.simulate.command import IDLE, OMEGA, command, first_move, first_row
from psafit.simulate.design import Design


@dataclass(frozen=True)
class Contact:
    """One contact, from rest to separation.

    Parameters
    ----------
    time : (n_times,) array, s
    tip : (n_times,) array, m
        Displacement x1 of the stack's tip.
    ball : (n_times,) array, m
        Displacement x2.
    tip_speed, ball_speed : (n_times,) array, m/s
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
    compression_impulse : float, N s
        Impulse of the contact force before `compression_time`.
    restitution_impulse : float, N s
        Impulse of the contact force after it.
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


def _pieces(rows: FloatArray, point: FloatArray, end: float) -> Iterator[tuple[float, float, float, float, complex]]:
    """Pieces of a command until `end`: beginning, end, level, slope, phasor of the swing."""
    row = first_row(rows, point, 0.0)
    k, now = first_move(rows, point, row, 0.0)
    while now < end:
        anchor, stop, a, b, swing, psi = command(rows, point, row, k, 0.0)
        yield now, stop, a + b * (now - anchor) if b else a, b, swing * np.exp(1j * (psi + point[OMEGA] * now))
        k, now = k + 1, stop


class _Motion:
    """Indentation, its derivatives and integrals, at any time of one contact."""

    def __init__(self, design: Design, theta: FloatArray, end: float) -> None:
        batch = closed_form.modes(Setup.of(design.constants, theta[None, :]))
        used = batch.weight[0] != 0
        pole, weight = batch.pole[0, used], batch.weight[0, used]
        self._k_c, _, self._c_c = theta
        self._M = design.constants.M
        rows, points = design.commands
        self._pieces = list(_pieces(rows, points[0], end))
        omega = float(points[0, OMEGA])
        drive = 1j * omega
        self._pole = np.append(pole, drive)
        forced = batch.lead[0] * drive**2 / np.prod(drive - batch.roots[0]) if omega else 0j
        self._start: list[ComplexArray] = []
        modes, level, rate, phasor, before = np.zeros(pole.size, complex), float(points[0, IDLE]), 0.0, 0j, 0.0
        self._rest = [(0.0, 0.0)]  # integral and double integral of d where each piece starts
        for begin, stop, a, b, C in self._pieces:
            change = (a - level) / pole + (b - rate) / pole**2
            if omega:
                change = change + (omega * (C - phasor).real + pole * (C - phasor).imag) / (pole**2 + omega**2)
            modes = modes * np.exp(pole * before) + weight * change
            self._start.append(np.append(modes, -1j * forced * C))
            before = min(stop, end) - begin
            level, rate, phasor = a + b * before, b, C * np.exp(drive * before)
            j, double = self._integrals(len(self._start) - 1, np.array([before]))
            self._rest.append((float(j[0]), float(double[0])))

    def _integrals(self, index: int, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        a, s = self._start[index], self._pole
        first, second = self._rest[index]
        z = s * t[:, None]
        grow = np.expm1(z)
        # The second remainder of exp loses its digits for slow poles, where its series is short.
        series = z * z * (0.5 + z * (1 / 6 + z * (1 / 24 + z / 120)))
        twice = np.where(np.abs(z) < 1e-3, series, grow - z)
        s = np.where(s == 0.0, 1.0, s)  # the drive's, where it does not swing: of no weight
        single = first + (grow * (a / s)).sum(axis=1).real
        return single, second + first * t + (twice * (a / s**2)).sum(axis=1).real

    def at(self, time: FloatArray) -> dict[str, FloatArray]:
        time = np.atleast_1d(np.asarray(time, dtype=float))
        begins = np.array([piece[0] for piece in self._pieces])
        # A moment at a switch belongs to the piece that ends there.
        index = np.maximum(np.searchsorted(begins, time * (1 - 1e-15), side="right") - 1, 0)
        d, rate, single, double = (np.empty(time.size) for _ in range(4))
        for piece in np.unique(index):
            here = index == piece
            t = np.maximum(time[here] - begins[piece], 0.0)
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
    when, _, _, status, _ = closed_form.separation(design, Setup.of(design.constants, values[None, :]), parted=False)
    contacts = []
    for j in range(design.n_points):
        if status[0, j] != closed_form.LAUNCHED:
            raise ValueError(
                f"no launch at {design.frequency[j]:g} Hz and {design.amplitude[j]:g} V: no contact to follow"
            )
        end = float(when[0, j])
        motion = _Motion(design.point(j), values, end)
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

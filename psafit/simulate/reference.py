r"""Scalar references: what the fast simulator is checked against, one trajectory at a time.

Three levels that share no code with the batch simulator and little with each other:

* `rk4_launch`: the study's Section 3.4, letter by letter; what the study computed.
* `tight_launch`: adaptive integration with SciPy, errors near 1e-13; what Eq. (12) says.
* `mp_launch`: matrix exponentials in 50 and more decimal digits; certifies the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853, OdeSolver, Radau
from scipy.optimize import brentq

from psafit.arrays import FloatArray
from psafit.drives import Drive
from psafit.errors import ConvergenceError
from psafit.experiment import Constants

Outcome = Literal["launched", "no separation", "diverged"]
SquareReading = Literal["half periods", "sign of sine"]


class Point(NamedTuple):
    """One condition: drive (the name of a waveform stands for it alone), its frequency (Hz), voltage amplitude (V)."""

    drive: Drive | str
    frequency: float
    amplitude: float

    @property
    def waveform(self) -> Literal["sine", "square"]:
        """Waveform, of the two that the study has and this module integrates."""
        name = Drive.of(self.drive).waveform
        if name not in ("sine", "square") or not Drive.of(self.drive).plain:
            raise ValueError(f"this reference knows a plain sine and square, not {Drive.of(self.drive).label}")
        return "square" if name == "square" else "sine"


class ContactParameters(NamedTuple):
    """The three fitted parameters: k_c (N/m), c_s (N s/m), c_c (N s/m)."""

    k_c: float
    c_s: float
    c_c: float


@dataclass(frozen=True)
class Path:
    """A contact phase, sampled at every step taken.

    Parameters
    ----------
    time : (n_steps + 1,) array, s
    state : (n_steps + 1, 4) array
        Eq. (13): x1 (m), its rate (m/s), x2 (m), its rate (m/s).
    """

    time: FloatArray
    state: FloatArray


@dataclass(frozen=True)
class Launch:
    """What one trajectory gave.

    Parameters
    ----------
    launch_range : float, m
        Eq. (17); 0 without a separation, NaN when the integration overflowed.
    separation_time : float, s
        NaN unless launched.
    velocity : float, m/s
        Of the ball at the separation; NaN unless launched.
    outcome : {"launched", "no separation", "diverged"}
        "diverged": the numbers overflowed before the indentation turned negative.
    path : Path, optional
        The contact phase, where asked for.
    """

    launch_range: float
    separation_time: float
    velocity: float
    outcome: Outcome
    path: Path | None = None


def pendulum_range(velocity: float, constants: Constants) -> float:
    r"""Launch range of a ball that leaves at `velocity`: Eqs. (16), (17), :math:`h = v^2/2g`.

    Eq. (17) taken literally, :math:`\cos\theta_m = (l-h)/l`, has lost every digit by 1 um: there
    :math:`1-\cos\theta_m` is 6e-11. The half-angle form of the same equation keeps them all,

    .. math:: \theta_m = 2 \arcsin \frac{v}{2\sqrt{g l}}, \qquad L_r = l \sin\theta_m .

    Parameters
    ----------
    velocity : float, m/s
    constants : Constants

    Returns
    -------
    float, m
        Largest horizontal excursion; the string's length once the ball rises above its support.
    """
    if velocity <= 0.0:
        return 0.0
    length, g = constants.l, constants.g
    if velocity * velocity >= 2.0 * g * length:  # h >= l: it passed the horizontal on its way
        return length
    return length * math.sin(2.0 * math.asin(velocity / (2.0 * math.sqrt(g * length))))


# --- the study's scheme ---------------------------------------------------------------------------

_SINE, _HALF_PERIODS, _SIGN = range(3)


@njit(cache=True)
def _wave(kind, cycles):  # type: ignore[no-untyped-def]
    """Unit drive after a number of cycles."""
    if kind == _SINE:
        return math.sin(2.0 * math.pi * cycles)
    if kind == _HALF_PERIODS:
        return 1.0 if cycles % 1.0 < 0.5 else -1.0
    return np.sign(math.sin(2.0 * math.pi * cycles))


@njit(cache=True)
def _slope(y, u, constants, contact):  # type: ignore[no-untyped-def]
    """Right-hand side of Eq. (12), written as Eqs. (9)-(11)."""
    ball, stack, q, k_s = constants
    k_c, c_s, c_c = contact
    force = c_c * (y[1] - y[3]) + k_c * (y[0] - y[2])  # Eq. (9)
    drive = k_s * q * u  # Eq. (8)
    out = np.empty(4)
    out[0] = y[1]
    out[1] = (-c_s * y[1] - k_s * y[0] + drive - force) / stack  # Eq. (10)
    out[2] = y[3]
    out[3] = force / ball  # Eq. (11)
    return out


@njit(cache=True)
def _rk4(kind, interpolate, drive, constants, contact, step, n_steps, store):  # type: ignore[no-untyped-def]
    """March until X1 - X2 < 0; returns (code, steps taken, last state, stored states)."""
    frequency, amplitude = drive
    y = np.zeros(4)  # Section 4: Y(0) = 0
    kept = np.zeros((n_steps + 1 if store else 1, 4))
    for i in range(n_steps):
        u0 = amplitude * _wave(kind, frequency * i * step)
        u2 = amplitude * _wave(kind, frequency * (i + 1) * step)
        u1 = amplitude * _wave(kind, frequency * (i + 0.5) * step)
        if interpolate:
            u1 = (u0 + u2) / 2.0
        k1 = _slope(y, u0, constants, contact)
        k2 = _slope(y + 0.5 * step * k1, u1, constants, contact)
        k3 = _slope(y + 0.5 * step * k2, u1, constants, contact)
        k4 = _slope(y + step * k3, u2, constants, contact)
        y = y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if store:
            kept[i + 1] = y
        if not np.all(np.isfinite(y)):
            return 2, i + 1, y, kept
        if y[0] - y[2] < 0.0:  # text below Eq. (15)
            return 0, i + 1, y, kept
    return 1, n_steps, y, kept


_OUTCOMES: tuple[Outcome, ...] = ("launched", "no separation", "diverged")


def rk4_launch(
    point: Point,
    parameters: ContactParameters,
    constants: Constants,
    step: float = 1e-6,
    total: float = 0.08,
    *,
    square: SquareReading = "half periods",
    interpolate: bool = False,
    path: bool = False,
) -> Launch:
    """Integrate Eq. (12) as the study did: classical Runge-Kutta 4 with a fixed step (Section 3.4).

    The state starts at zero, ``X1 - X2 < 0`` is tested after each step, and the ball's speed is
    that of the first step that ends separated. With the study's parameters and step the scheme is
    unstable, see `psafit.reproduce`; this function reproduces that and must not be used for
    anything else.

    Parameters
    ----------
    point : Point
    parameters : ContactParameters
    constants : Constants
    step : float, s
        The study's is 1 us.
    total : float, s
        Contact time after which the march gives up; the study's is 80 ms.
    square : {"half periods", "sign of sine"}
        How to read the study's square wave: +V from t = 0 on, or the sign of the sine, 0 at t = 0.
        The first value decides with which sign the instability starts.
    interpolate : bool
        Take the voltage half way through a step as the mean of its ends, as if from a table.
    path : bool
        Keep every step.

    Returns
    -------
    Launch
    """
    kind = _SINE
    if point.waveform == "square":
        kind = _SIGN if square == "sign of sine" else _HALF_PERIODS
    c = constants
    code, n, y, kept = _rk4(
        kind, interpolate, (point.frequency, point.amplitude),
        (c.M, c.m, c.q, c.k_s), tuple(parameters), step, round(total / step), path,
    )  # fmt: skip
    outcome = _OUTCOMES[code]
    states = Path(np.arange(n + 1) * step, kept[: n + 1].copy()) if path else None
    if outcome != "launched":
        return Launch(0.0 if code == 1 else math.nan, math.nan, math.nan, outcome, states)
    return Launch(pendulum_range(y[3], c), n * step, float(y[3]), outcome, states)


# --- adaptive integration -------------------------------------------------------------------------

# State of both accurate references: x1, x1', d, d', and J, the integral of d. Carrying d instead of
# x2 avoids the difference of two nearly equal displacements (d/x1 is 1e-8 at the stiffest contact).
# Eq. (11) integrates to M x2' = k_c J + c_c d, and at the separation d = 0: adding up c_c d' step
# by step instead would leave rounding errors far above a small final speed when the damper is
# strong.
_X1, _V1, _D, _W, _J = range(5)
# SciPy controls Radau's fifth-order steps by a third-order estimate, so they are far better than
# they are asked to be.
_RTOL = {DOP853: 1e-13, Radau: 1e-11}
# An explicit method that needs more steps than this, each at its stability limit, is handed to an
# implicit one.
_PATIENCE = 4_000


@njit(cache=True)
def _field(t, y, sine, omega, voltage, coefficient):  # type: ignore[no-untyped-def]
    """Eqs. (8)-(11) in the coordinates of the tight reference."""
    ball, stack, lead, k_s, k_c, c_s, c_c = coefficient
    u = voltage * math.sin(omega * t) if sine else voltage
    force = k_c * y[2] + c_c * y[3]
    a1 = lead * u - (c_s * y[1] + k_s * y[0] + force) / stack
    return np.array([y[1], a1, y[3], a1 - force / ball, y[2]])


def _jacobian(parameters: ContactParameters, c: Constants) -> FloatArray:
    k_c, c_s, c_c = parameters
    a1 = np.array([-c.k_s, -c_s, -k_c, -c_c, 0.0]) / c.m
    a2 = np.array([0.0, 0.0, k_c, c_c, 0.0]) / c.M
    unit = np.eye(5)
    return np.array([unit[_V1], a1, unit[_W], a1 - a2, unit[_D]])


class _Piece:
    """Motion under one analytic piece of the drive: all of a sine, half a period of a square."""

    def __init__(self, point: Point, parameters: ContactParameters, c: Constants, sign: float) -> None:
        self.jacobian = _jacobian(parameters, c)
        self.omega = 2.0 * math.pi * point.frequency
        self.sine = point.waveform == "sine"
        # Largest step: a twelfth of the drive's period, so that no dip of the indentation hides
        # inside a step. Dips made by natural oscillations are resolved by the error control, which
        # takes far smaller steps.
        self.max_step = 1.0 / (12.0 * point.frequency) if self.sine else math.inf
        arguments = (self.sine, self.omega, sign * point.amplitude)
        coefficient = (c.M, c.m, c.k_s * c.q / c.m, c.k_s, *map(float, parameters))
        self.field = lambda t, y: _field(t, y, *arguments, coefficient)

    def solver(
        self,
        kind: type[OdeSolver],
        t: float,
        y: FloatArray,
        end: float,
        step: float,
        size: FloatArray,
    ) -> OdeSolver:
        options: dict[str, Any] = {
            "rtol": _RTOL[kind],
            "atol": _RTOL[kind] * size,
            "first_step": min(step, end - t),
            "max_step": self.max_step,
        }
        if kind is Radau:
            options["jac"] = self.jacobian
        return kind(self.field, t, y, end, **options)

    def state_at(self, kind: type[OdeSolver], t0: float, y0: FloatArray, t: float, size: FloatArray) -> FloatArray:
        """Integrate a fraction of a step again: dense output is less accurate than steps."""
        if t <= t0:
            return y0
        solver = self.solver(kind, t0, y0, t, (t - t0) / 3.0, size)
        while solver.status == "running":
            solver.step()
        return np.asarray(solver.y)


def tight_launch(
    point: Point,
    parameters: ContactParameters,
    constants: Constants,
    total: float = 0.08,
    most_steps: int = 400_000,
) -> Launch:
    """Integrate Eq. (12) adaptively; measured against `mp_launch`, errors stay below 1e-11.

    Dormand-Prince 8(5,3), handed over to Radau IIA once the fast rate of the stack makes explicit
    steps crawl. Square waves are integrated half period by half period, so that no step crosses a
    switch. Every step is searched for the first ``d < 0``, including between its ends: a dip
    (``d'`` changes from negative to positive) counts when its lowest point is negative. Separation
    time and state come from integrating the last step again, not from interpolation.

    Parameters
    ----------
    point : Point
    parameters : ContactParameters
        Zero damping is allowed.
    constants : Constants
    total : float, s
        Contact time after which the ball counts as not launched.
    most_steps : int
        Steps after which the integration gives up.

    Returns
    -------
    Launch

    Raises
    ------
    ConvergenceError
        If the integration needs more steps, or the integrator gives up.
    """
    if point.amplitude == 0.0:
        return Launch(0.0, math.nan, math.nan, "no separation")
    rates = np.linalg.eigvals(_jacobian(parameters, constants))
    first = 1e-2 / max(float(np.abs(rates).max()), 2.0 * math.pi * point.frequency)
    t, y, n_steps = 0.0, np.zeros(5), 0
    half, sign, switches = 0.5 / point.frequency, 1.0, 0
    kind: type[OdeSolver] = DOP853
    size = np.full(5, np.finfo(float).tiny)
    while t < total:
        piece = _Piece(point, parameters, constants, sign)
        end = total if piece.sine else min((switches + 1) * half, total)
        solver = piece.solver(kind, t, y, end, first, size)
        while solver.status == "running":
            before = solver.y.copy()
            message = solver.step()
            n_steps += 1
            if message is not None or n_steps > most_steps:
                raise ConvergenceError("time reached by the tight integration", reached=solver.t, required=total)
            found = _first_zero(piece, kind, solver, before, size)
            if found is not None:
                when, state = found
                speed = parameters.k_c * float(state[_J]) / constants.M
                return Launch(pendulum_range(speed, constants), when, speed, "launched")
            # The tolerances are relative to the largest value each component has had so far.
            size = np.maximum(size, np.abs(solver.y))
            solver.atol = _RTOL[kind] * size
            if kind is DOP853 and n_steps == _PATIENCE:
                kind = Radau
                solver = piece.solver(kind, solver.t, solver.y, end, solver.step_size, size)
        t, y = solver.t, solver.y
        switches, sign = switches + 1, -sign
    return Launch(0.0, math.nan, math.nan, "no separation")


def _first_zero(
    piece: _Piece, kind: type[OdeSolver], solver: OdeSolver, before: FloatArray, size: FloatArray
) -> tuple[float, FloatArray] | None:
    """First downward zero of the indentation within the step just taken, and the state there."""
    t0, t1, after = solver.t_old, solver.t, solver.y
    if t0 == 0.0:
        return None  # d grows from zero like t^3 or t^2: the first step cannot separate

    def state(t: float) -> FloatArray:
        return after if t == t1 else piece.state_at(kind, t0, before, t, size)

    if after[_D] < 0.0:
        low = t1
    elif before[_W] < 0.0 < after[_W]:
        low = brentq(lambda t: float(state(t)[_W]), t0, t1, xtol=1e-15 * t1, rtol=1e-14)
        if state(low)[_D] >= 0.0:
            return None
    else:
        return None
    when = brentq(lambda t: float(state(t)[_D]), t0, low, xtol=1e-17 * t1, rtol=1e-15)
    return when, state(when)


# --- many digits ----------------------------------------------------------------------------------


def _mp_motion(mp: Any, point: Point, parameters: ContactParameters, constants: Constants) -> tuple[Any, Any]:
    """Matrix of the homogeneous system, the drive among its states, and the state it begins in."""
    c = constants
    sine = point.waveform == "sine"
    k_c, c_s, c_c = map(mp.mpf, parameters)
    stack, ball, k_s, omega = mp.mpf(c.m), mp.mpf(c.M), mp.mpf(c.k_s), 2 * mp.pi * point.frequency
    size = 7 if sine else 6
    a = mp.zeros(size)
    a[_X1, _V1] = a[_D, _W] = 1
    for column, value in ((_X1, k_s), (_V1, c_s), (_D, k_c), (_W, c_c)):
        a[_V1, column] = -value / stack
    a[_V1, 5] = k_s * mp.mpf(c.q) / stack
    for column in range(size):
        a[_W, column] = a[_V1, column]
    a[_W, _D] -= k_c / ball
    a[_W, _W] -= c_c / ball
    a[_J, _D] = 1
    if sine:
        a[5, 6], a[6, 5] = omega, -omega
    z = mp.zeros(size, 1)
    z[6 if sine else 5] = mp.mpf(point.amplitude)
    return a, z


def _mp_zero(mp: Any, a: Any, state: Any, component: int, width: Any, digits: int) -> Any:
    """Time after `state` at which a component that changes sign within `width` is zero."""
    low, high = mp.mpf(0), width
    now = mp.expm(a * width) * state
    falling = now[component] < 0
    dt = width
    while high - low > width * mp.mpf(10) ** (-digits):
        newton = dt - now[component] / (a * now)[component]
        # Newton's method inside a bracket; a dip's two zeros may lie too close for it at first.
        following = newton if low < newton < high else (low + high) / 2
        if abs(following - dt) < width * mp.mpf(10) ** (-digits):
            return following
        dt = following
        now = mp.expm(a * dt) * state
        if (now[component] < 0) == falling:
            high = dt
        else:
            low = dt
    return high


def mp_launch(
    point: Point,
    parameters: ContactParameters,
    constants: Constants,
    total: float = 0.08,
    *,
    digits: int = 50,
    step: float | None = None,
) -> Launch:
    r"""Solve Eq. (12) by matrix exponentials in many digits; slow, for certification.

    With the drive appended to the state, :math:`(\sin\omega t, \cos\omega t)` or the constant
    voltage of a half period, the system is homogeneous and :math:`z(t+h) = e^{A h} z(t)` without
    error at any `h`. There are no eigenvalues in this, so critical damping and other degeneracies
    are ordinary cases.

    Parameters
    ----------
    point : Point
    parameters : ContactParameters
    constants : Constants
    total : float, s
        Contact time after which the ball counts as not launched.
    digits : int
        Decimal digits carried.
    step : float, s, optional
        Distance of the samples between which a separation or a dip is sought; default a fortieth of
        the shortest period, of the drive or of a natural oscillation.

    Returns
    -------
    Launch
        Rounded to double precision.
    """
    import mpmath

    mp = mpmath.MPContext()  # its own precision: the global one is left alone
    # The matrix has entries up to c_s/m and k_s/m next to 1: their ratio eats digits in the
    # squarings.
    mp.dps = digits + 40
    rates = np.linalg.eigvals(_jacobian(parameters, constants)).imag
    sine = point.waveform == "sine"
    if step is None:
        fastest = max(float(np.abs(rates).max()), 2.0 * math.pi * point.frequency)
        step = 2.0 * math.pi / fastest / 40.0
    half = mp.mpf(1) / 2 / mp.mpf(point.frequency)
    a, z = _mp_motion(mp, point, parameters, constants)

    def at(state: Any, dt: Any) -> Any:
        return mp.expm(a * dt) * state

    start, switches, h = mp.mpf(0), 0, mp.mpf(0)
    while start < total:
        length = mp.mpf(total) - start if sine else min(half, mp.mpf(total) - start)
        n = max(1, int(mp.ceil(length / step)))
        if length / n != h:  # half periods are of one length: one exponential serves them all
            h = length / n
            propagate = mp.expm(a * h)
        for i in range(n):
            after = propagate * z
            width = h
            if after[_D] > 0 and z[_W] < 0 < after[_W]:
                width = _mp_zero(mp, a, z, _W, h, digits)
            lowest = after if width is h else at(z, width)
            if i + switches > 0 and lowest[_D] < 0:
                dt = _mp_zero(mp, a, z, _D, width, digits)
                speed = mp.mpf(parameters.k_c) * at(z, dt)[_J] / mp.mpf(constants.M)
                g, length_ = mp.mpf(constants.g), mp.mpf(constants.l)
                high_swing = speed**2 >= 2 * g * length_
                reach = length_ * mp.sin(2 * mp.asin(speed / (2 * mp.sqrt(g * length_))))
                when = float(start + i * h + dt)
                return Launch(float(length_ if high_swing else reach), when, float(speed), "launched")
            z = after
        start, switches = start + length, switches + 1
        if not sine:
            z[5] = -z[5]
    return Launch(0.0, math.nan, math.nan, "no separation")

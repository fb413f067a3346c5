"""The peers: the same launches as a careful user of SciPy or diffrax would code them.

Both integrate ``x1, x1', d, d', x2'`` - the indentation and the ball's speed as states of their own, which reaches a
given accuracy at looser tolerances than ``x1, x1', x2, x2'`` - and, with hysteresis, its state z. The voltage is
handed to them: pieces of sines and ramps, found once and outside of every timing. Neither steps across a kink of the
drive: SciPy starts anew there, diffrax is reported of it (`jump_ts`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from psafit.experiment import Constants
from psafit.simulate import drive
from psafit.simulate.command import COMMAND, driven
from psafit.simulate.design import Design

Slope = Callable[[float, Any], list[float]]


@dataclass(frozen=True)
class Piece:
    """Voltage ``offset + slope s + swing sin(omega s + psi)``, with ``s = t - begin``, from `begin` to `end`."""

    begin: float
    end: float
    offset: float
    slope: float
    swing: float
    omega: float
    psi: float


@dataclass(frozen=True)
class Trajectory:
    """One launch: everything a peer is given. Neutral values switch a cause off."""

    k_c: float
    c_s: float
    c_c: float
    pieces: tuple[Piece, ...]
    volt: float
    exponent: float = 1.0
    lam: float = 0.0
    strength: float = 0.0
    memory: float = 1.0
    gap: float = 0.0
    pull: float = 1.0


def pieces(design: Design, j: int, inverse_slew: float, turns: bool, until: float) -> tuple[Piece, ...]:
    """The drive of a point up to a time; with `turns` a piece also ends where a sine turns."""
    rows, points = design.commands
    record, point = np.empty(drive.PIECE), np.empty(COMMAND)
    driven(points[j], 1.0, 0.0, point)
    drive.first_piece(record, rows, point, 0.0, 0.0, inverse_slew, False)
    found = []
    while True:
        begin, end = record[drive.BEGIN], min(record[drive.END], until)
        shape = [float(record[k]) for k in (drive.CONSTANT, drive.SLOPE, drive.SWING, drive.OMEGA, drive.PSI)]
        offset, slope, swing, omega, psi = shape
        cuts = [float(begin)]
        if turns and swing != 0.0:
            first = math.ceil((psi - 0.5 * math.pi) / math.pi + 1e-9)
            many = math.floor((omega * (end - begin) + psi - 0.5 * math.pi) / math.pi)
            cuts += [float(begin + ((k + 0.5) * math.pi - psi) / omega) for k in range(first, many + 1)]
        for a, b in zip(cuts, [*cuts[1:], float(end)], strict=True):
            if b > a * (1.0 + 1e-12):
                ahead = omega * (a - float(begin)) + psi
                found.append(Piece(a, b, offset + slope * (a - float(begin)), slope, swing, omega, ahead))
        if end >= until:
            return tuple(found)
        u = drive.voltage(record, record[drive.END])
        drive.next_piece(record, u, rows, point, 0.0, 0.0, inverse_slew, False)


# Column names of the causes' parameters, and what a peer calls them.
_NAMES = {
    "hertz_n": "exponent",
    "hunt_crossley_lambda": "lam",
    "hysteresis_strength": "strength",
    "hysteresis_voltage": "memory",
    "gap_width": "gap",
    "slew_limit_inverse": "inverse_slew",
    "no_tension_s": "pull",
}


def trajectory(design: Design, j: int, names: list[str], theta: np.ndarray, ends: float) -> Trajectory:
    """Point `j` of a design at one parameter set; the drive is given until a while after the separation at `ends`."""
    values = {_NAMES.get(name, name): float(value) for name, value in zip(names, theta, strict=True)}
    inverse_slew = values.pop("inverse_slew", 0.0)
    if "pull" in values:
        values["pull"] = 1.0 - values["pull"]
    turns = values.get("strength", 0.0) > 0.0
    chain = pieces(design, j, inverse_slew, turns, 1.2 * ends)
    return Trajectory(pieces=chain, volt=float(design.amplitude[j]), **values)


# --- SciPy ------------------------------------------------------------------------------------------------------------


def _voltage(p: Piece) -> tuple[Callable[[float], float], Callable[[float], float]]:
    """Voltage and its rate."""
    sin, cos = math.sin, math.cos
    t0, a, b, swing, omega, psi = p.begin, p.offset, p.slope, p.swing, p.omega, p.psi
    if swing == 0.0:
        return (lambda t: a + b * (t - t0)), (lambda t: b)
    return (lambda t: swing * sin(omega * (t - t0) + psi)), (lambda t: swing * omega * cos(omega * (t - t0) + psi))


def _slope(rig: Constants, one: Trajectory, p: Piece, contact: bool) -> Slope:
    """Right-hand side in plain floats, with nothing in it that the model does not have."""
    k_c, c_s, c_c, m, ball, k_s, q = one.k_c, one.c_s, one.c_c, rig.m, rig.M, rig.k_s, rig.q
    u, du = _voltage(p)
    strength, memory, lam, power, pull = one.strength * q, one.memory, one.lam, one.exponent - 1.0, one.pull
    scale = 1e6**power
    drive_force = k_s * q

    def free(t: float, y: Any) -> list[float]:
        x1, v1, _, _, v2 = y.tolist()
        a1 = (drive_force * u(t) - c_s * v1 - k_s * x1) / m
        return [v1, a1, v1 - v2, a1, 0.0]

    def linear(t: float, y: Any) -> list[float]:
        x1, v1, d, w, _ = y.tolist()
        force = k_c * d + c_c * w
        if force < 0.0:
            force *= pull
        a1 = (drive_force * u(t) - c_s * v1 - k_s * x1 - force) / m
        a2 = force / ball
        return [v1, a1, w, a1 - a2, a2]

    def hertz(t: float, y: Any) -> list[float]:
        x1, v1, d, w, _ = y.tolist()
        force = k_c * scale * d * abs(d) ** power + c_c * w
        a1 = (drive_force * u(t) - c_s * v1 - k_s * x1 - force) / m
        a2 = force / ball
        return [v1, a1, w, a1 - a2, a2]

    def lossy(t: float, y: Any) -> list[float]:
        x1, v1, d, w, _, z = y.tolist()
        force = k_c * d * (1.0 + lam * w) + c_c * w
        a1 = (drive_force * u(t) - k_s * z - c_s * v1 - k_s * x1 - force) / m
        a2 = force / ball
        rate = du(t)
        return [v1, a1, w, a1 - a2, a2, strength * rate - abs(rate) * z / memory]

    if not contact:
        return free
    return lossy if one.strength else hertz if power else linear


def scipy_launch(rig: Constants, one: Trajectory, method: str, rtol: float, absolute: float = 1e-5) -> float:
    """Speed of the ball at the separation, by `solve_ivp` with events; NaN where there is none.

    Tolerances are relative, down to the fraction `absolute` of the motion's own scales.
    """
    stroke = rig.q * one.volt
    rate = stroke * math.sqrt(rig.k_s / rig.m)
    floor = [stroke, rate, stroke, rate, rate, stroke][: 6 if one.strength else 5]
    atol = [rtol * absolute * s for s in floor]

    def apart(t: float, y: Any) -> float:
        return float(y[2])

    def touch(t: float, y: Any) -> float:
        return float(y[2])

    apart.terminal, apart.direction = True, -1  # type: ignore[attr-defined]
    touch.terminal, touch.direction = True, 1  # type: ignore[attr-defined]
    contact = one.gap == 0.0
    y = np.zeros(len(floor))
    y[2] = -one.gap
    for p in one.pieces:
        begin = p.begin
        while begin < p.end:
            found = solve_ivp(
                _slope(rig, one, p, contact), (begin, p.end), y, method, events=apart if contact else touch,
                rtol=rtol, atol=atol,
            )  # fmt: skip
            if not found.success:
                return math.nan
            if found.status == 0:
                y = found.y[:, -1]
                break
            y = found.y_events[0][0]
            if contact:
                return float(y[4])
            contact, begin = True, float(found.t[-1])
            y[2] = 0.0
    return math.nan


# --- numbalsoda -------------------------------------------------------------------------------------------------------


class Numbalsoda:
    """LSODA in machine code, one launch after the other; the tolerance is an argument, so that a scan compiles once.

    It has no events. Each piece of a drive is sampled, a cubic finds where the indentation changes its sign between
    two samples, and the motion is integrated from the sample before up to there. Positions are in strokes and speeds in
    strokes times the stack's frequency, since all states have one absolute tolerance.

    Parameters
    ----------
    rig : Constants
    many : list of Trajectory
        All with the same causes.
    samples : int
        Of a piece.
    """

    def __init__(self, rig: Constants, many: list[Trajectory], samples: int = 200) -> None:
        from numba import njit
        from numbalsoda import lsoda

        # Known by its address: it lives as long as what calls it.
        self._motion = self._compiled(rig, many[0].strength != 0.0)
        motion = int(self._motion.address)
        states = 6 if many[0].strength else 5

        @njit
        def root(a: float, b: float, slope_a: float, slope_b: float) -> float:
            """Where a cubic with these ends, a > 0 >= b, and slopes there is zero, as a share of the step."""
            low, high = 0.0, 1.0
            for _ in range(50):
                s = 0.5 * (low + high)
                c = 1.0 - s
                here = c * c * ((1.0 + 2.0 * s) * a + s * slope_a) + s * s * ((1.0 + 2.0 * c) * b - c * slope_b)
                low, high = (s, high) if here > 0.0 else (low, s)
            return high

        @njit
        def launch(data: Any, chain: Any, gap: float, rate: float, rtol: float, absolute: float) -> float:
            """Speed at the separation, in strokes times the stack's frequency; NaN where there is none."""
            y = np.zeros(states)
            y[2] = -gap
            contact = gap == 0.0
            for piece in chain:
                begin, end = piece[0], piece[1]
                data[0], data[1:6] = begin, piece[2:]
                while begin < end:
                    times = np.linspace(begin, end, samples + 1)
                    data[-1] = 1.0 if contact else 0.0
                    found, _ = lsoda(motion, y, times, data, rtol, rtol * absolute, 100_000)
                    sign = 1.0 if contact else -1.0
                    y, begin = found[-1], end
                    for k in range(1, samples + 1):
                        a, b = sign * found[k - 1, 2], sign * found[k, 2]
                        if a > 0.0 >= b:
                            step = times[k] - times[k - 1]
                            h = sign * step * rate
                            begin = times[k - 1] + step * root(a, b, h * found[k - 1, 3], h * found[k, 3])
                            there = np.array([times[k - 1], begin])
                            y = lsoda(motion, found[k - 1].copy(), there, data, rtol, rtol * absolute, 100_000)[0][1]
                            if contact:
                                return y[4]
                            contact, y[2] = True, 0.0
                            break
            return np.nan

        rate = math.sqrt(rig.k_s / rig.m)
        laws = np.array([[t.k_c, t.c_s, t.c_c, t.exponent, t.lam, t.strength, t.memory, t.pull] for t in many])
        strokes = np.array([rig.q * t.volt for t in many])
        data = np.column_stack([np.zeros((len(many), 6)), laws, strokes, np.zeros(len(many))])
        chains = [np.array([astuple(p) for p in t.pieces]) for t in many]
        gaps = np.array([t.gap for t in many]) / strokes

        def run(rtol: float, absolute: float) -> np.ndarray:
            found = [launch(d, c, gap, rate, rtol, absolute) for d, c, gap in zip(data, chains, gaps, strict=True)]
            return strokes * rate * np.array(found)

        self.run = run

    @staticmethod
    def _compiled(rig: Constants, lossy: bool) -> Any:
        """The right-hand side in machine code."""
        from numba import carray, cfunc
        from numbalsoda import lsoda_sig

        m, ball, k_s, q = rig.m, rig.M, rig.k_s, rig.q
        rate, states = math.sqrt(k_s / m), 6 if lossy else 5

        @cfunc(lsoda_sig)
        def motion(t, at, to, given):  # type: ignore[no-untyped-def]
            y, dy, a = carray(at, (states,)), carray(to, (states,)), carray(given, (16,))
            begin, offset, slope, swing, omega, psi = a[0], a[1], a[2], a[3], a[4], a[5]
            k_c, c_s, c_c, n, lam, strength, memory, pull = a[6], a[7], a[8], a[9], a[10], a[11], a[12], a[13]
            stroke, contact = a[14], a[15]
            speed = stroke * rate
            angle = omega * (t - begin) + psi
            u = offset + slope * (t - begin) + swing * math.sin(angle)
            force = 0.0
            if contact != 0.0:
                d, w = stroke * y[2], speed * y[3]
                size = 1.0 if n == 1.0 else (1e6 * abs(d)) ** (n - 1.0)
                force = k_c * size * d * (1.0 + lam * w) + c_c * w
                if force < 0.0:
                    force *= pull
            z = stroke * y[5] if lossy else 0.0
            a1 = (k_s * (q * u - z - stroke * y[0]) - c_s * speed * y[1] - force) / m
            a2 = force / ball
            dy[0], dy[1], dy[2], dy[3], dy[4] = rate * y[1], a1 / speed, rate * y[3], (a1 - a2) / speed, a2 / speed
            if lossy:
                turn = slope + swing * omega * math.cos(angle)
                dy[5] = (strength * q * turn - abs(turn) * z / memory) / stroke

        return motion

    def __call__(self, rtol: float, absolute: float = 1e-5) -> np.ndarray:
        """Speeds at the separation, in the order of the trajectories given; NaN where there is none."""
        return self.run(rtol, absolute)


# --- diffrax ----------------------------------------------------------------------------------------------------------


class Diffrax:
    """Many launches in one compiled call; the tolerance is an argument of it, so that a scan compiles once.

    Parameters
    ----------
    rig : Constants
    many : list of Trajectory
        All with the same causes.
    solver : str
        Name of diffrax's class.
    lanes : int
        Trajectories integrated side by side (`vmap`); groups of that many follow one another (`jax.lax.map`). A lane
        waits for the slowest of its group, so trajectories are sorted by what decides their number of steps.
    """

    def __init__(self, rig: Constants, many: list[Trajectory], solver: str, lanes: int) -> None:
        import diffrax
        import jax
        import jax.numpy as jnp
        import optimistix

        jax.config.update("jax_enable_x64", True)
        one = many[0]
        hertz, lossy = one.exponent != 1.0, one.strength != 0.0
        gap, weak = one.gap != 0.0, one.pull != 1.0
        jumps = any(len(t.pieces) > 1 for t in many)
        m, ball, k_s, q = rig.m, rig.M, rig.k_s, rig.q
        root = optimistix.Newton(1e-10, 1e-13)

        def voltage(t: Any, a: Any) -> tuple[Any, Any]:
            table = a["pieces"]
            k = jnp.searchsorted(table[:, 0], t, side="right") - 1 if jumps else 0
            begin, offset, slope, swing, omega, psi = table[k]
            angle = omega * (t - begin) + psi
            rate = slope + swing * omega * jnp.cos(angle) if lossy else 0.0
            return offset + slope * (t - begin) + swing * jnp.sin(angle), rate

        def motion(t: Any, y: Any, a: Any, contact: bool) -> Any:
            x1, v1, d, w = y[:4]
            u, du = voltage(t, a)
            elastic = a["k_c"] * d
            if hertz:
                # The inner `where` keeps the derivative finite at d = 0.
                size = jnp.where(d == 0.0, 1.0, jnp.abs(d) * 1e6)
                elastic = jnp.where(d == 0.0, 0.0, elastic * size ** (a["exponent"] - 1.0))
            if lossy:
                elastic = elastic * (1.0 + a["lam"] * w)
            force = elastic + a["c_c"] * w if contact else 0.0 * d
            if weak:
                force = jnp.where(force < 0.0, a["pull"] * force, force)
            push = k_s * q * u - (k_s * y[5] if lossy else 0.0)
            a1 = (push - a["c_s"] * v1 - k_s * x1 - force) / m
            rates = [v1, a1, w, a1 - force / ball, force / ball]
            if lossy:
                rates.append(a["strength"] * q * du - jnp.abs(du) * y[5] / a["memory"])
            return jnp.stack(rates)

        def apart(t: Any, y: Any, args: Any, **_: Any) -> Any:
            # At first the indentation is all rounding.
            return jnp.where(t > args["begin"] + 1e-3 * (args["until"] - args["begin"]), y[2] / args["stroke"], 1.0)

        def touch(t: Any, y: Any, args: Any, **_: Any) -> Any:
            return y[2] / args["stroke"]

        def integrate(a: Any, y: Any, rtol: Any, contact: bool) -> Any:
            rate = a["stroke"] * math.sqrt(k_s / m)
            floor = jnp.stack([a["stroke"], rate, a["stroke"], rate, rate, a["stroke"]][: 6 if lossy else 5])
            controller: Any = diffrax.PIDController(rtol=rtol, atol=1e-5 * rtol * floor)
            if jumps:
                controller = diffrax.ClipStepSizeController(controller, jump_ts=a["jumps"])
            found = diffrax.diffeqsolve(
                diffrax.ODETerm(lambda t, y, a: motion(t, y, a, contact)), getattr(diffrax, solver)(),
                a["begin"], a["until"], a["first"], y, args=a, stepsize_controller=controller,
                event=diffrax.Event(apart if contact else touch, root, direction=not contact),
                max_steps=200_000, throw=False, adjoint=diffrax.ForwardMode(),
            )  # fmt: skip
            return found.ts[-1], found.ys[-1], found.event_mask

        def launch(a: Any, rtol: Any) -> Any:
            y = jnp.zeros(6 if lossy else 5)
            if gap:
                begin, y, _ = integrate(a, y.at[2].set(-a["gap"]), rtol, False)
                a, y = a | {"begin": begin}, y.at[2].set(0.0)
            _, y, launched = integrate(a, y, rtol, True)
            return jnp.where(launched, y[4], jnp.nan)

        self.order, self.args = self._arguments(rig, many, solver)
        run = jax.jit(lambda a, rtol: jax.lax.map(lambda one: launch(one, rtol), a, batch_size=lanes))
        self.run = lambda rtol: run(self.args, rtol).block_until_ready()

    @staticmethod
    def _arguments(rig: Constants, many: list[Trajectory], solver: str) -> tuple[np.ndarray, dict[str, Any]]:
        """What the trajectories differ by, those of like effort side by side; and in which order they are."""
        import jax.numpy as jnp

        most = max(len(t.pieces) for t in many)
        # What an explicit method's steps number, and an implicit one's.
        effort = [t.pieces[-1].end / _first_step(rig, t) if solver == "Tsit5" else len(t.pieces) for t in many]
        order = np.argsort(effort, kind="stable")
        some = [many[k] for k in order]
        table = np.zeros((len(some), most, 6))
        ends = np.full((len(some), most), np.inf)
        for k, one in enumerate(some):
            for i, p in enumerate(one.pieces):
                table[k, i] = p.begin, p.offset, p.slope, p.swing, p.omega, p.psi
                ends[k, i] = p.end
            table[k, len(one.pieces) :, 0] = np.inf
        args = {
            name: jnp.array([getattr(t, name) for t in some])
            for name in ("k_c", "c_s", "c_c", "exponent", "lam", "strength", "memory", "gap", "pull")
        }
        args |= {
            "pieces": jnp.array(table), "jumps": jnp.array(ends), "stroke": jnp.array([rig.q * t.volt for t in some]),
            "until": jnp.array([t.pieces[-1].end for t in some]),
            "begin": jnp.zeros(len(some)), "first": jnp.array([_first_step(rig, t) for t in some]),
        }  # fmt: skip
        return order, args

    def __call__(self, rtol: float) -> np.ndarray:
        """Speeds at the separation, in the order of the trajectories given."""
        speeds = np.empty(len(self.order))
        speeds[self.order] = np.asarray(self.run(rtol))
        return speeds


def _first_step(rig: Constants, one: Trajectory) -> float:
    rate = one.c_s / rig.m + one.c_c * (1 / rig.m + 1 / rig.M) + math.sqrt((rig.k_s + one.k_c) / rig.m)
    return min(0.1 / rate, 0.01 * one.pieces[-1].end)

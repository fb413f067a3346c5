r"""Scalar reference of the extended model: one trajectory at a time, to the last digits.

The causes edit a `ReferenceRig`; this module integrates it literally, as the ordinary differential equations

.. math::
    m \ddot x_1 &= -c_s (\dot x_1 - \dot x_w) - k_s (x_1 - x_w) + k_s (S(u) - \textstyle\sum z) - F_c, \qquad
    M \ddot x_2 = F_c - P_0 - R, \\
    F_c &= F_\mathrm{elastic}(d, \dot d) + F_\mathrm{damping}(d, \dot d), \qquad d = x_1 - x_2 - g_0, \\
    \dot u &= \text{lag and slew of the amplifier}, \qquad \dot z_i = \texttt{memories}_i(z_i, u, \dot u),

with :math:`P_0 = M g x_0/l` and Coulomb's friction :math:`R = M r \operatorname{sgn}\dot x_2`, which holds a ball at
rest by up to :math:`M r`. The wall behind the stack, if it gives way, has :math:`M_w \ddot x_w = -k_w x_w - c_w
\dot x_w - F_c - m \ddot x_1`. The launch range is the apex of the first hop, from the ball's rest: a flight that the
tip ends before its apex is none. A ball that makes no hop reads the highest place to which the tip carried it, where
its place counts at all. It knows no closed form of the motion and shares no code with the batch simulator.

Method: Radau IIA collocation (`psafit.simulate.literal_scheme`), piece by piece. The right-hand side is smooth within
every piece: edges and quarter periods of the command, kinks of the amplifier, zeros of the voltage, of its rate and of
the hysteresis state, of the force where a pull is weakened, and of the indentation each end a piece.

The indentation and its rate are states of their own (at the stiffest contact d/x1 is 1e-8, and a difference would
have lost its digits), and so is the ball's speed less ``c_c d/M``: its rate ``(F_c - c_c d')/M`` does not contain
the damping force, whose impulse over a contact cancels.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from psafit.arrays import FloatArray
from psafit.drives import WAVEFORMS, Drive
from psafit.errors import ConvergenceError
from psafit.experiment import Constants
from psafit.observables import LAUNCH_RANGE
from psafit.physics.term import Memory, ReferenceRig, Term
from psafit.simulate.literal_scheme import EPS, PLACES, TINY, Clock, Monitor, Step, advance
from psafit.simulate.reference import Point

Outcome = Literal["launched", "no launch"]


@dataclass(frozen=True)
class LiteralLaunch:
    """What one trajectory gave.

    Parameters
    ----------
    launch_range : float, m
        As read; without a launch, the reading of a range of 0.
    separation_time : float, s
        NaN unless launched.
    velocity : float, m/s
        Of the ball at the separation; NaN unless launched.
    place : float, m
        x2 from rest at the separation; without one the highest.
    outcome : {"launched", "no launch"}
    peak_force : float, N
        Largest contact force until the separation; NaN unless launched, and unless asked for.
    """

    launch_range: float
    separation_time: float
    velocity: float
    place: float
    outcome: Outcome
    peak_force: float = math.nan


def reference_rig(
    theta: Sequence[float], terms: Sequence[tuple[Term, Sequence[float]]], constants: Constants
) -> ReferenceRig:
    """The rig at ``theta = (k_c, c_s, c_c)``, edited by every cause in the order given."""
    k_c, c_s, c_c = (float(value) for value in theta)
    c = constants
    rig = ReferenceRig(k_c=k_c, c_s=c_s, c_c=c_c, m=c.m, M=c.M, k_s=c.k_s, q=c.q, l=c.l, g=c.g)
    plain = rig.reading
    for term, values in terms:
        own, ranges = [float(value) for value in values], rig.reading
        for name in (name for name in term.reads if name != LAUNCH_RANGE.name):
            rig.reading = rig.readings.get(name, plain)
            term.literal(rig, own)
            rig.readings[name], rig.reading = rig.reading, ranges
        if LAUNCH_RANGE.name in term.reads:
            term.literal(rig, own)
    return rig


def literal_launch(
    point: Point,
    theta: Sequence[float],
    terms: Sequence[tuple[Term, Sequence[float]]],
    constants: Constants,
    *,
    group: int = 0,
    rtol: float = 1e-12,
    most_steps: int = 400_000,
    forces: bool = False,
) -> LiteralLaunch:
    """Integrate the model extended by some causes, from rest to the reading of the launch range.

    Parameters
    ----------
    point : Point
    theta : sequence of float
        k_c (N/m), c_s (N s/m), c_c (N s/m).
    terms : sequence of (Term, values)
        In the order of the registry; `values` are those of the cause's parameters, and last that of its latent
        parameter in this session where it has one.
    constants : Constants
    group : int
        Number of the session.
    rtol : float
        Bound on the last coefficients of every step's Legendre series, relative to the largest value so far.
    most_steps : int
        Steps, repeated ones included, after which the integration until separation gives up.
    forces : bool
        Whether to look for the peak force.

    Returns
    -------
    LiteralLaunch

    Raises
    ------
    ConvergenceError
        If the integration needs more steps, or steps below the resolution of time.
    """
    rig = reference_rig(theta, terms, constants)
    return launch_in(rig, point, group=group, rtol=rtol, most_steps=most_steps, forces=forces)


def energy(
    point: Point, theta: Sequence[float], terms: Sequence[tuple[Term, Sequence[float]]], constants: Constants
) -> tuple[float, float]:
    """What the ball has gained at its launch, and what the drive and the press at rest have given by then, J.

    The work is that of the piezoelectric force, ``k_s (S - sum z) dx1``. Both are zero without a launch. Parameters and
    errors as of `literal_launch`.
    """
    rig = reference_rig(theta, terms, constants)
    drive = _Drive(rig, point, 1e-9, 400_000, counts_work=True)
    launch = drive.run()
    if launch is None:
        return 0.0, 0.0
    _, speed, place = launch
    seat = drive.seat
    give = 1 / rig.k_s + (1 / rig.wall_stiffness if rig.wall_mass > 0.0 else 0.0)
    stored = seat * (seat * give + _seated(rig, seat)) if seat > 0.0 else 0.0
    return 0.5 * rig.M * speed * speed + seat * place, drive.work + stored


def literal_motion(
    point: Point,
    theta: Sequence[float],
    terms: Sequence[tuple[Term, Sequence[float]]],
    constants: Constants,
    times: Sequence[float],
    *,
    rtol: float = 1e-12,
    most_steps: int = 400_000,
) -> FloatArray:
    """Where ball and tip are at some times, s, ascending, from the start of the drive: as a vibrometer sees them.

    The ball is followed in contact, and in flight from the launch that counts on, whatever the tip does then; so is the
    tip. A ball that turns back in flight swings on. Other parameters, and errors, as of `literal_launch`.

    Returns
    -------
    (n_times, 3) array
        Ball (m, from rest), its speed (m/s), tip (m, from rest).
    """
    return motion_in(reference_rig(theta, terms, constants), point, times, rtol=rtol, most_steps=most_steps)


def motion_in(
    rig: ReferenceRig, point: Point, times: Sequence[float], *, rtol: float = 1e-12, most_steps: int = 400_000
) -> FloatArray:
    """Follow a given `ReferenceRig`: see `literal_motion`."""
    rig.frequency, rig.amplitude = point.frequency, point.amplitude
    drive = _Drive(rig, point, rtol, most_steps, times=times)
    launch = drive.run()
    drive.leave_tip_alone()
    if launch is not None:
        when, speed, place = launch
        flown = [t for t in times if t > when]
        drive.seen[len(times) - len(flown) :, :2] = _flight(rig, speed, place, [t - when for t in flown], rtol)
    return drive.seen


def launch_in(
    rig: ReferenceRig,
    point: Point,
    *,
    group: int = 0,
    rtol: float = 1e-12,
    most_steps: int = 400_000,
    forces: bool = False,
) -> LiteralLaunch:
    """Integrate a given `ReferenceRig`: contact, swing, reading; see `literal_launch`."""
    rig.frequency, rig.amplitude = point.frequency, point.amplitude
    drive = _Drive(rig, point, rtol, most_steps)
    if forces:
        drive.clock.watch = drive.look_for_peak
    separation = drive.run()
    if separation is None:
        share = 1.0 if rig.lean > 0.0 else math.sqrt(rig.offset_weight)
        reading = float(rig.reading(share * drive.highest, group))
        return LiteralLaunch(reading, math.nan, math.nan, drive.highest, "no launch")
    when, speed, place = separation
    reach = swing(rig, speed, place, rtol=rtol)
    peak = drive.peak_until_launch if forces else math.nan
    return LiteralLaunch(float(rig.reading(reach, group)), when, speed, place, "launched", peak)


# --- the drive --------------------------------------------------------------------------------------


class _Command:
    """The command voltage, from corner to corner of its waveform, as the waveform's own file or a table has it.

    Times `tau` count from the start of the piece, which may lie behind its corner. Between corners voltage and size of
    its rate are monotonic.
    """

    def __init__(self, point: Point, rig: ReferenceRig) -> None:
        drive = Drive.of(point.drive)
        table = drive.table
        self.idle, self.bias = drive.idle_v + (0.0 if drive.recorded else rig.idle), drive.bias_v
        self.volt, self.frequency = rig.scale * point.amplitude, point.frequency
        self.omega = 2.0 * math.pi * point.frequency
        self.rest, self.length, self.period, self.end = self.idle, 0.0, 1.0, drive.cycles / point.frequency
        self.pace = point.frequency  # phases per second
        turn = drive.phase_deg / 360.0
        if table is None:
            form = WAVEFORMS[drive.waveform]
            self.corners, self.shape, self.slope = list(form.corners), form.value, form.rate
            turn += rig.phase / (2.0 * math.pi) if form.shifts else 0.0
        else:
            rows = list(zip(table.at.tolist(), table.value.tolist(), strict=True))
            if table.recorded and rows[0][0] > 0.0:
                rows = [(0.0, drive.idle_v), (rows[0][0], drive.idle_v), *rows]
            lines = [(p, q) for p, q in itertools.pairwise(rows) if q[0] > p[0]]
            self.corners = [p[0] for p, _ in lines]
            self.shape = lambda k, x: lines[k][0][1] + (lines[k][1][1] - lines[k][0][1]) * x / self.width(k)
            self.slope = lambda k, x: (lines[k][1][1] - lines[k][0][1]) / self.width(k)
            if table.recorded:
                self.pace, self.volt, self.period = 1.0, 1.0, rows[-1][0]
                self.length = self.end = rows[-1][0]
                self.rest = rows[-1][1]
        self.per_period = len(self.corners)
        turn %= 1.0
        if min(turn, 1.0 - turn) <= 4 * EPS * max(1.0, abs(rig.phase)):
            turn = 0.0
        near = [k for k, corner in enumerate(self.corners) if abs(turn - corner) <= 4 * EPS]
        turn = self.corners[near[0]] if near else turn
        self.index = sum(corner <= turn for corner in self.corners) - 1
        self.turned = turn
        self.x = turn - self.corners[self.index]  # of the piece's start behind its corner
        self.time, self.done = 0.0, False
        extremes = [
            self.bias + self.volt * self.shape(k, x) for k in range(self.per_period) for x in (0.0, self.width(k))
        ]
        self.size = max(abs(u) for u in (*extremes, self.idle))
        self.span = max(abs(u - self.idle) for u in extremes)

    def width(self, k: int) -> float:
        """Width of the part behind corner number `k`."""
        return (self.corners[k + 1] if k + 1 < self.per_period else self.period) - self.corners[k]

    def value(self, tau: float) -> float:
        if self.done:
            return self.rest
        return self.bias + self.volt * self.shape(self.index % self.per_period, self.x + self.pace * tau)

    def rate(self, tau: float) -> float:
        if self.done:
            return 0.0
        return self.volt * self.pace * self.slope(self.index % self.per_period, self.x + self.pace * tau)

    def remaining(self) -> float:
        """Time to the next corner, or to the end of the drive."""
        if self.done:
            return math.inf
        return min((self.width(self.index % self.per_period) - self.x) / self.pace, self.end - self.time)

    def _until(self, passes: Callable[[float], float]) -> float:
        """Time to where a monotonic function of `tau` changes its sign before the next corner; infinite if nowhere."""
        last = self.remaining()
        if self.done or passes(0.0) * passes(last) >= 0.0:
            return math.inf
        ahead = float(brentq(passes, 0.0, last, xtol=1e-300, rtol=4 * EPS))
        return ahead if ahead * self.pace > 1e-14 * self.period else math.inf

    def until_rate(self, limit: float) -> float:
        """Time to where the rate's size passes `limit` before the next corner; infinite if it does not."""
        return math.inf if math.isinf(limit) else self._until(lambda tau: abs(self.rate(tau)) - limit)

    def until_zero(self) -> float:
        """Time to where the voltage passes zero before the next corner; infinite if it does not."""
        return self._until(self.value)

    def resting(self) -> bool:
        """Whether this piece stays at the idle voltage."""
        middle = 0.0 if self.done else 0.5 * self.remaining()
        return self.value(0.0) == self.idle == self.value(middle) and self.rate(0.0) == 0.0

    def pass_by(self, tau: float) -> None:
        """Start the next piece, `tau` later before the same corner."""
        self.time += tau
        self.x += self.pace * tau

    def turn(self) -> None:
        """Start the next piece at the next corner, or with the rest after the drive."""
        index = self.index + 1
        periods, k = divmod(index, self.per_period)
        corner = (periods * self.period + self.corners[k] - self.turned) / self.pace
        if corner >= self.end * (1.0 - 4 * EPS):
            self.time, self.done = self.end, True
        else:
            self.index, self.x, self.time = index, 0.0, corner


class _Ramp:
    """Hysteresis state while the voltage jumps: it passes as if the voltage moved evenly from one end to the other."""

    active: list[int]

    def __init__(self, rate: Memory, q: float, start: float, direction: float) -> None:
        self.rate, self.q, self.start, self.direction = rate, q, start, direction
        self.active = [0]

    def field(self, tau: float, y: list[float]) -> list[float]:
        return [self.rate(y[0], self.start + self.direction * tau, self.direction)]

    def jacobian(self, tau: float, y: list[float]) -> list[list[float]]:
        step = max(1e-6 * abs(y[0]), 1e-9 * self.q)
        return [[(self.field(tau, [y[0] + step])[0] - self.field(tau, [y[0] - step])[0]) / (2.0 * step)]]

    def noise(self, size: FloatArray, h: float) -> FloatArray:
        return 4 * EPS * size


def jump(rate: Memory, q: float, z: float, start: float, end: float, rtol: float = 1e-12) -> float:
    """Hysteresis state, m, with this rate, after the voltage jumped from `start` to `end`; `q` (m/V) is its scale."""
    direction = 1.0 if end > start else -1.0
    clock = Clock(0.1 * abs(end - start), np.array([abs(z)]), rtol)
    y = np.array([z])
    stops = [0.0, end] if start * end < 0.0 else [end]
    for stop in stops:
        while start != stop:
            ramp = _Ramp(rate, q, start, direction)
            gone, y, event = advance(
                ramp, y, abs(stop - start), clock, [Monitor("z", lambda tau, row: row[0], noise=1e-14 * clock.size[0])]
            )
            start = start + direction * gone if event else stop
            if event:
                y[0] = 0.0
    return float(y[0])


# --- the motion while the drive acts ------------------------------------------------------------------

_X1, _V1, _D, _W, _P, _U, _E, _XW, _VW, _Z = range(10)
_Amplifier = Literal["follow", "lag", "up", "down"]


class _Drive:
    """The rig from rest to the last separation; also the equations of the piece it is in.

    State: x1, x1', d, d', P, u, the drive's work E (J), the wall's x and x', then every z. In contact P is the ball's
    speed less ``c_c d/M`` (where the damping is ``c_c d'``), otherwise the speed.
    """

    active: list[int]

    def __init__(
        self,
        rig: ReferenceRig,
        point: Point,
        rtol: float,
        most_steps: int,
        *,
        counts_work: bool = False,
        times: Sequence[float] = (),
    ) -> None:
        self.rig, self.counts_work = rig, counts_work
        self.times, self.seen = times, np.zeros((len(times), 3))
        self.work = 0.0  # until the launch
        self.peak = self.peak_until_launch = 0.0
        self.command = _Command(point, rig)
        self.seat = rig.M * rig.g * rig.lean / rig.l
        self.grip = rig.M * rig.grip
        # Held by friction, or sliding this way.
        self.held, self.way = self.grip > 0.0, 0.0
        self.rest = self.highest = 0.0
        self.counts = rig.lean > 0.0 or rig.offset_weight > 0.0
        self.launched, self.rising = False, True
        self.threshold = -rig.bond / rig.k_c
        volt, q = self.command.size, rig.q
        self.volt = volt
        self.settled = 0.0
        # A state z = 0 stays 0 where its rate is 0 whatever the voltage does: then it need not be carried.
        self.memories = [
            rate
            for rate in rig.memories
            if any(
                rate(0.0, share * volt, way * volt) != 0.0
                for share in (-1.0, -0.6, -0.1, 0.0, 0.1, 0.6, 1.0)
                for way in (-1.0, 1.0)
            )
        ]
        # Less c_c d/M, the ball's speed gains digits where the damping force is c_c d', and costs some otherwise.
        plain = all(
            rig.damping(d, w) == rig.c_c * w for d in (-1e-7, -1e-9, 0.0, 1e-9, 3e-7, 1e-5) for w in (-1.0, 1e-3, 0.1)
        )
        self.damper = rig.c_c if plain else 0.0
        self.contact = self.relaxed = self.below = False
        self.amplifier: _Amplifier = "follow"
        damped = (rig.c_s + rig.c_c) / rig.m
        swift = [math.sqrt((rig.k_s + rig.k_c) / rig.m), damped, self.command.omega]
        if rig.lag > 0.0:
            swift.append(1.0 / rig.lag)
        self.first_step = 0.1 / max(swift)
        self.stack_rate = math.sqrt(rig.k_s / rig.m) + rig.c_s / rig.m
        size = np.zeros(_Z + len(self.memories))
        size[_U] = volt
        self.clock = Clock(self.first_step, size, rtol, most_steps=most_steps)
        self.reach = max(abs(rig.stroke(volt)), abs(rig.stroke(-volt)), q * volt)
        self.active = []

    # the equations of a piece

    def voltage(self, tau: float, u: float) -> tuple[float, float]:
        """Voltage and its rate."""
        if self.amplifier == "follow":
            return self.command.value(tau), self.command.rate(tau)
        if self.amplifier == "lag":
            return u, (self.command.value(tau) - u) / self.rig.lag
        return u, self.rig.slew if self.amplifier == "up" else -self.rig.slew

    def raw_force(self, d: float, w: float) -> float:
        return self.rig.elastic(d, w) + self.rig.damping(d, w)

    def bent_force(self, d: float, w: float) -> float:
        """What the contact force has in addition to ``k_c d + c_c d'``: nothing, to the last bit, where it is that."""
        return (self.rig.elastic(d, w) - self.rig.k_c * d) + (self.rig.damping(d, w) - self.rig.c_c * w)

    def field(self, tau: float, y: list[float]) -> list[float]:
        rig = self.rig
        x1, v1, d, w, _, u, _, xw, vw, *states = y
        u, du = self.voltage(tau, u)
        if not self.contact:
            force, effort = 0.0, 0.0
        elif self.relaxed:
            force = rig.pull * self.raw_force(d, w)
            effort = force - self.damper * w
        else:
            elastic, damping = rig.elastic(d, w), rig.damping(d, w)
            force = elastic + damping
            effort = elastic + (damping - self.damper * w)  # exactly the elastic force where the damping is c_c d'
        free = rig.stroke(u) - sum(states) - self.settled
        power = rig.k_s * free * (v1 - vw) if self.counts_work else 0.0
        reaction = rig.k_s * (free - (x1 - xw)) - rig.c_s * (v1 - vw)
        a1 = (reaction - force) / rig.m
        wall = [0.0, 0.0]
        if rig.wall_mass > 0.0:
            wall = [vw, -(rig.wall_stiffness * xw + rig.wall_damping * vw + reaction) / rig.wall_mass]
        rates = [rate(z, u, du) for rate, z in zip(self.memories, states, strict=True)]
        if self.held:
            return [v1, a1, w, a1, (effort - force) / rig.M, du, power, *wall, *rates]
        against = self.seat + self.way * self.grip
        return [v1, a1, w, a1 - (force - against) / rig.M, (effort - against) / rig.M, du, power, *wall, *rates]

    def speed(self, y: Sequence[float] | FloatArray) -> float:
        """The ball's."""
        return float(y[_P] + (self.damper * y[_D] / self.rig.M if self.contact else 0.0))

    def contact_force(self, y: Sequence[float] | FloatArray) -> float:
        force = self.raw_force(float(y[_D]), float(y[_W])) if self.contact else 0.0
        return self.rig.pull * force if self.relaxed else force

    def push(self, y: Sequence[float] | FloatArray) -> float:
        """Force on the ball but friction."""
        return self.contact_force(y) - self.seat

    def look_for_peak(self, step: Step) -> None:
        """Largest contact force within a step: the highest of its values, and what lies next to that."""
        found = [self.contact_force(y) for y in step.values.tolist()]
        top = int(np.argmax(found))
        left, right = max(top - 1, 0), min(top + 1, len(PLACES) - 1)
        # Between two places it rises above the higher one by less than it falls to the lower.
        if 2.0 * found[top] - min(found[left], found[right]) > self.peak:
            near = minimize_scalar(
                lambda theta: -self.contact_force(step.at(theta)),
                bounds=(float(PLACES[left]), float(PLACES[right])), method="bounded", options={"xatol": 1e-9},
            )  # fmt: skip
            self.peak = max(self.peak, found[top], -float(near.fun))

    def see(self, step: Step) -> None:
        """Note where ball and tip are at the wanted times within a step."""
        begin = self.command.time + step.tau
        for k, t in enumerate(self.times):
            theta = (t - begin) / step.h
            if abs(theta - 0.5) <= 0.5 + 1e-9:  # a sum of times may end a rounding before a sample
                y = step.at(min(max(theta, 0.0), 1.0))
                ball = y[_X1] - y[_D] - self.rig.gap - self.rest
                self.seen[k] = ball, self.speed(y), y[_X1] - self.tip_rest

    def leave_tip_alone(self) -> None:
        """Follow the tip to the last of the wanted times, without a ball."""
        if not self.times or self.command.span == 0.0:
            return
        command, clock = self.command, self.clock
        y, self.contact = self.state, False
        while command.time < self.times[-1]:
            quarter = command.remaining()
            end = min(quarter, self.times[-1] - command.time)
            if self.amplifier == "follow":
                end = min(end, command.until_rate(self.rig.slew), command.until_zero())
            self.active = [_X1, _V1, *([] if self.amplifier == "follow" else [_U])]
            self.active += [_XW, _VW] if self.rig.wall_mass > 0.0 else []
            self.active += range(_Z, y.size)
            own = [m for m in self.monitors() if m.name not in ("touch", "rest", "apex")]
            tau, y, event = advance(self, y, end, clock, own)
            if self.amplifier == "follow":
                y[_U] = command.value(tau)
            jumped = False
            if event == "" and end == quarter:
                before = command.value(tau)
                command.turn()
                jumped = abs(command.value(0.0) - before) > 1e-13 * command.size
            else:
                command.pass_by(tau)
            self.bend(y, event, jumped)

    def jacobian(self, tau: float, y: list[float]) -> list[list[float]]:
        rig, size = self.rig, self.clock.size
        _, v1, d, w, _, u, _, _, vw, *states = y
        by_d = by_w = 0.0
        if self.contact:
            e = max(1e-6 * abs(d), 1e-9 * float(size[_D]), 1e-60)
            by_d = rig.k_c + (self.bent_force(d + e, w) - self.bent_force(d - e, w)) / (2.0 * e)
            e = max(1e-6 * abs(w), 1e-9 * float(size[_W]), 1e-60)
            by_w = rig.c_c + (self.bent_force(d, w + e) - self.bent_force(d, w - e)) / (2.0 * e)
            if self.relaxed:
                by_d, by_w = rig.pull * by_d, rig.pull * by_w
        by_u = lag = 0.0
        if self.amplifier != "follow":
            e = 1e-6 * self.volt
            by_u = rig.k_s * (rig.stroke(u + e) - rig.stroke(u - e)) / (2.0 * e)
            lag = -1.0 / rig.lag if self.amplifier == "lag" else 0.0
        n = len(states)
        memory = []
        for k, (rate, z) in enumerate(zip(self.memories, states, strict=True)):
            e = max(1e-6 * abs(z), 1e-9 * self.reach)
            now = self.voltage(tau, u)
            row = [0.0] * (_Z + n)
            row[_Z + k] = (rate(z + e, *now) - rate(z - e, *now)) / (2.0 * e)
            if self.amplifier != "follow":
                e = 1e-6 * self.volt
                ahead, behind = rate(z, *self.voltage(tau, u + e)), rate(z, *self.voltage(tau, u - e))
                row[_U] = (ahead - behind) / (2.0 * e)
            memory.append(row)
        m, ball = rig.m, math.inf if self.held else rig.M
        by_p = (0.0 if self.held else by_w) - self.damper if self.contact else 0.0
        force = rig.k_s * (rig.stroke(self.voltage(tau, u)[0]) - sum(states) - self.settled)
        stiff, damp = rig.k_s / m, rig.c_s / m
        still, by_z = [0.0] * n, [-stiff] * n
        wall = [[0.0] * (_Z + n), [0.0] * (_Z + n)]
        if rig.wall_mass > 0.0:
            share = m / rig.wall_mass
            own = (rig.wall_stiffness / rig.wall_mass, rig.wall_damping / rig.wall_mass)
            wall = [
                [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *still],
                [
                    stiff * share, damp * share, 0.0, 0.0, 0.0, -by_u / rig.wall_mass, 0.0,
                    -own[0] - stiff * share, -own[1] - damp * share, *(-b * share for b in by_z),
                ],
            ]  # fmt: skip
        return [
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *still],
            [-stiff, -damp, -by_d / m, -by_w / m, 0.0, by_u / m, 0.0, stiff, damp, *by_z],
            [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, *still],
            [-stiff, -damp, -by_d / m - by_d / ball, -by_w / m - by_w / ball, 0.0, by_u / m, 0.0, stiff, damp, *by_z],
            [0.0, 0.0, by_d / ball, by_p / rig.M, 0.0, 0.0, 0.0, 0.0, 0.0, *still],
            [0.0, 0.0, 0.0, 0.0, 0.0, lag, 0.0, 0.0, 0.0, *still],
            [0.0, force, 0.0, 0.0, 0.0, by_u * (v1 - vw), 0.0, 0.0, -force, *(m * (v1 - vw) * b for b in by_z)],
            *wall,
            *memory,
        ]  # fmt: skip

    def noise(self, size: FloatArray, h: float) -> FloatArray:
        rig = self.rig
        far = max(float(size[_X1]), self.reach)
        pushes = rig.k_s * far + rig.c_s * size[_V1] + rig.k_c * size[_D] + rig.c_c * size[_W]
        kick = pushes / rig.m * h / (1.0 + h * self.stack_rate)
        # P is a quadrature over the others, as accurate as they are.
        near = min(far, kick * h)
        wall = [near, kick]
        tip = [near, kick, near, kick, math.inf, self.volt, math.inf]
        return 4 * EPS * np.array([*tip, *wall, *[far] * len(self.memories)])

    # what ends a piece

    def monitors(self) -> list[Monitor]:
        rig, command = self.rig, self.command
        found = []
        if not self.contact:
            found.append(Monitor("touch", lambda tau, y: y[_D], -1))
        else:
            found.append(Monitor("end", lambda tau, y: y[_D] - self.threshold, 1))
            if rig.bond > 0.0:
                found.append(Monitor("zero", lambda tau, y: y[_D], -1 if self.below else 1))
            if rig.pull != 1.0 and not self.below:
                found.append(Monitor("pull", lambda tau, y: self.raw_force(y[_D], y[_W]), -1 if self.relaxed else 1))
        if self.held and self.contact:
            found.append(Monitor("forth", lambda tau, y: self.grip - self.push(y), 1))
            found.append(Monitor("back", lambda tau, y: self.grip + self.push(y), 1))
        elif self.grip > 0.0 and not self.held:
            found.append(Monitor("rest", lambda tau, y: self.way * self.speed(y), 1))
        elif self.launched and not self.contact and self.seat > 0.0:
            found.append(Monitor("apex", lambda tau, y: y[_P], 1))
        elif self.contact and self.counts and not self.launched:
            # A turn is where the place is flattest: a little noise in the speed moves it by the square of that.
            noise = 1e-9 * self.reach * command.omega + 1e-12 * self.damper * float(self.clock.size[_D]) / rig.M
            found.append(Monitor("top", lambda tau, y: self.speed(y), 1 if self.rising else -1, noise))
        for k in range(len(self.memories)):
            at = _Z + k
            noise = 1e-14 * max(self.clock.size[at], TINY)
            found.append(Monitor(f"memory {k}", lambda tau, y, at=at: y[at], 0, noise))  # type: ignore[misc]
        if self.amplifier == "follow":
            return found
        noise = 1e-13 * self.volt
        found.append(Monitor("voltage", lambda tau, y: y[_U], 0, noise, True))
        if self.amplifier == "lag":
            found.append(Monitor("turning", lambda tau, y: command.value(tau) - y[_U], 0, noise, True))
            if math.isfinite(rig.slew):
                limit = rig.slew * rig.lag
                found.append(Monitor("limit", lambda tau, y: limit - abs(command.value(tau) - y[_U]), 1, 0.0, True))
            return found
        way = 1 if self.amplifier == "up" else -1
        behind = rig.slew * rig.lag
        found.append(Monitor("limit", lambda tau, y: way * (command.value(tau) - y[_U]) - behind, 1, 0.0, True))
        return found

    def set_amplifier(self, u: float, *, met: bool = False) -> None:
        """What the amplifier does from here on; `met`: the voltage has just met the command."""
        rig, command = self.rig, self.command
        ahead = 0.0 if met else command.value(0.0) - u
        if rig.lag > 0.0:
            limited = abs(ahead) > rig.slew * rig.lag
            self.amplifier = "lag" if not limited else "up" if ahead > 0.0 else "down"
            return
        if not math.isfinite(rig.slew):
            self.amplifier = "follow"
            return
        if abs(ahead) <= 4 * EPS * self.volt:
            # On the command. Its rate just after: half way to where that passes the limit, or in the quarter's middle.
            soon = 0.5 * min(command.remaining(), command.until_rate(rig.slew))
            ahead = command.rate(soon)
            if abs(ahead) <= rig.slew:
                self.amplifier = "follow"
                return
        self.amplifier = "up" if ahead > 0.0 else "down"

    def start(self) -> FloatArray:
        """Rest in static equilibrium under the idle voltage, reached from 0 V; sets whether the ball is in contact."""
        rig, command = self.rig, self.command
        y = np.zeros(_Z + len(self.memories))
        idle = command.idle
        while command.resting() and not command.done:
            command.turn()
        for k, rate in enumerate(self.memories, start=_Z):
            y[k] = jump(rate, rig.q, 0.0, 0.0, idle, self.clock.rtol) if idle else 0.0
        self.settled = rig.stroke(idle) - float(y[_Z:].sum())
        y[_U] = idle
        first = command.value(0.0) - idle
        ahead = first if abs(first) > 64 * EPS * self.volt else 0.0
        ahead = (
            ahead or command.rate(0.0) or command.value(min(0.5 * command.remaining(), 1.0 / command.frequency)) - idle
        )
        if self.seat > 0.0:
            y[_XW] = -self.seat / rig.wall_stiffness if rig.wall_mass > 0.0 else 0.0
            y[_X1] = y[_XW] - self.seat / rig.k_s
            y[_D] = _seated(rig, self.seat)
            self.contact = True
        else:
            y[_D] = -rig.gap
            self.contact = rig.gap == 0.0 and (rig.stroke(self.volt) > 0.0) == (ahead > 0.0)
        self.rest = float(y[_X1] - y[_D]) - rig.gap
        y[_P] = -self.damper * y[_D] / rig.M if self.contact else 0.0
        self.clock.size = np.maximum(self.clock.size, np.abs(y))
        self.set_amplifier(idle)
        if self.amplifier == "follow":
            self.follow(y, 0.0)
        return y

    def follow(self, y: FloatArray, tau: float) -> None:
        """Set the voltage to the command; a jump carries the hysteresis state with it."""
        u = self.command.value(tau)
        if tau == 0.0 and abs(u - y[_U]) > 4 * EPS * self.volt:
            for k, rate in enumerate(self.memories, start=_Z):
                y[k] = jump(rate, self.rig.q, float(y[k]), float(y[_U]), u, self.clock.rtol)
        y[_U] = u

    def run(self, periods: float = 3.0) -> tuple[float, float, float] | None:  # noqa: C901, PLR0915
        """Time, speed and place of the last separation that counts; None without a launch.

        The drive is followed for so many of its periods beyond its end.
        """
        rig, command, clock = self.rig, self.command, self.clock
        if command.span == 0.0:
            return None
        y = self.start()
        self.tip_rest = float(y[_X1])
        if self.times:
            clock.watch = self.see
        patience = max([command.length + periods / command.frequency, *self.times[-1:]])
        # A soft contact lasts many periods of a fast drive.
        hold = max(patience, min(4 * math.pi * math.sqrt(rig.M / rig.k_c), 100.0))
        horizon = rig.cycles / command.frequency
        launch: tuple[float, float, float] | None = None
        before: tuple[FloatArray, object] | None = None
        idle = 0
        while command.time < (limit := hold if self.contact else patience):
            waiting = launch is not None and not self.contact
            if waiting and command.time >= horizon * (1.0 - 4 * EPS):
                break
            quarter = command.remaining()
            end = min(quarter, limit - command.time)
            if waiting:
                end = min(end, horizon - command.time)
            if self.amplifier == "follow":
                end = min(end, command.until_rate(rig.slew), command.until_zero())
            self.active = [_X1, _V1, _D, _W, _P]
            if self.amplifier != "follow":
                self.active.append(_U)
            self.active += [_E] if self.counts_work else []
            self.active += [_XW, _VW] if rig.wall_mass > 0.0 else []
            self.active += range(_Z, y.size)
            tau, y, event = advance(self, y, end, clock, self.monitors())
            idle = idle + 1 if tau == 0.0 else 0
            if idle > 20:
                raise ConvergenceError("pieces without a length, of the literal reference", reached=idle, required=1)
            if self.amplifier == "follow":
                y[_U] = command.value(tau)
            edge = event == "" and end == quarter
            jumped = False
            if edge:
                before_edge = command.value(tau)
                command.turn()
                jumped = abs(command.value(0.0) - before_edge) > 1e-13 * command.size
            else:
                command.pass_by(tau)
            if event == "apex" or (event == "rest" and self.launched and not self.contact):
                break  # the hop is over
            if event in ("touch", "end"):
                before = None
                self.switch(y)
                if event == "end":
                    speed = float(y[_P])
                    if speed > 0.0:
                        launch = command.time, speed, float(y[_X1] - y[_D]) - rig.gap - self.rest
                        self.launched, self.work = True, float(y[_E])
                        self.peak_until_launch = self.peak
                        if command.time >= horizon:
                            break
            if event in ("top", "rest") or command.time >= limit:
                self.highest = max(self.highest, float(y[_X1] - y[_D]) - rig.gap - self.rest)
            self.bend(y, event, jumped)
            if edge and not command.done and launch is None and command.index % command.per_period == 0:
                mode = (self.contact, self.relaxed, self.below, self.amplifier, self.held, self.way)
                if before is not None and before[1] == mode and not self.times:
                    close = 1e-12 * clock.size + self.noise(clock.size, 1.0)
                    close[_P] = math.inf  # the speed is x1' less d'
                    if np.all(np.abs(y - before[0]) <= close):
                        break  # a period without a separation repeats itself: so do all that follow
                before = y.copy(), mode
        self.state = y
        return launch

    def switch(self, y: FloatArray) -> None:
        """Begin or end a contact."""
        rig, size = self.rig, self.clock.size
        self.relaxed = self.below = False
        if self.contact:
            y[_P] += self.damper * self.threshold / rig.M
            y[_D] = self.threshold
        else:
            y[_D] = 0.0
        self.contact = not self.contact
        if self.held:  # it stands still, and not as nearly as the integrator is exact
            y[_P] = -self.damper * y[_D] / rig.M if self.contact else 0.0
        # The new phase has its own scales.
        size[_D], size[_W], size[_P] = abs(y[_D]), abs(y[_W]), abs(y[_P])

    def bend(self, y: FloatArray, event: str, jumped: bool) -> None:
        """Pass a kink that is no change of contact."""
        if event == "zero":
            y[_D] = 0.0
            self.below = not self.below
            self.relaxed = not self.below and self.rig.pull != 1.0 and self.raw_force(0.0, float(y[_W])) < 0.0
        elif event == "rest":
            y[_P] -= self.speed(y)
            y[_W] = y[_V1]
            push = self.push(y)
            self.held, self.way = abs(push) <= self.grip, math.copysign(1.0, push)
        elif event == "top":
            self.rising = not self.rising
        elif event in ("forth", "back"):
            self.held, self.way = False, 1.0 if event == "forth" else -1.0
        elif event == "pull":
            self.relaxed = not self.relaxed
        elif event.startswith("memory"):
            y[_Z + int(event.split()[1])] = 0.0
        elif event == "voltage":
            y[_U] = 0.0
        elif event == "limit":
            if self.rig.lag > 0.0:
                if self.amplifier == "lag":
                    self.amplifier = "up" if self.command.value(0.0) > y[_U] else "down"
                else:
                    self.amplifier = "lag"
            else:
                y[_U] = self.command.value(0.0)
                self.set_amplifier(float(y[_U]), met=True)
        elif jumped:
            self.set_amplifier(float(y[_U]))
            if self.amplifier == "follow":
                self.follow(y, 0.0)
            self.clock.step = self.first_step
        elif self.amplifier == "follow":
            self.set_amplifier(float(y[_U]), met=True)


def _seated(rig: ReferenceRig, seat: float) -> float:
    """Indentation at which the elastic force alone carries the ball's push."""
    high = seat / rig.k_c
    while rig.elastic(high, 0.0) < seat:
        high *= 2.0
    low = high
    while rig.elastic(low, 0.0) > seat:
        low *= 0.5
    if low == high:
        return high
    return float(brentq(lambda d: rig.elastic(d, 0.0) - seat, low, high, xtol=1e-30, rtol=4 * EPS))


# --- the swing ----------------------------------------------------------------------------------------


class _Swing:
    """The pendulum after the separation: distance along the arc from there, and speed."""

    active: list[int]

    def __init__(self, rig: ReferenceRig, start: float) -> None:
        self.rig, self.start = rig, start
        self.active = [0, 1]

    def field(self, tau: float, y: list[float]) -> list[float]:
        rig = self.rig
        return [y[1], -rig.g * math.sin(self.start + y[0] / rig.l) - rig.rub - rig.deceleration(y[0], y[1])]

    def jacobian(self, tau: float, y: list[float]) -> list[list[float]]:
        rig, (x, v) = self.rig, y
        e = max(1e-6 * abs(x), 1e-20)
        by_x = (rig.deceleration(x + e, v) - rig.deceleration(x - e, v)) / (2.0 * e)
        e = max(1e-6 * abs(v), 1e-20)
        by_v = (rig.deceleration(x, v + e) - rig.deceleration(x, v - e)) / (2.0 * e)
        return [[0.0, 1.0], [-rig.g / rig.l * math.cos(self.start + x / rig.l) - by_x, -by_v]]

    def noise(self, size: FloatArray, h: float) -> FloatArray:
        return 4 * EPS * size


def swing(rig: ReferenceRig, speed: float, place: float, *, rtol: float = 1e-12) -> float:
    r"""Launch range, m, of a ball that leaves at `speed` from `place`.

    Without a deceleration the energy gives it. With :math:`\theta_0 = \arcsin(x_0/l)` and the start at
    :math:`\theta_s = \arcsin((x_0 + o)/l)`,

    .. math::
        D = \cos\theta_0 - \cos\theta_m = \frac{o (2 x_0 + o)}{l^2 (\cos\theta_0 + \cos\theta_s)} + \frac{v^2}{2 g l},
        \quad L = l\, \frac{D (\cos\theta_0 + \cos\theta_m)}{\sin\theta_m + \sin\theta_0},

    in which a microscopic swing keeps its digits.
    """
    length, lean = rig.l, rig.lean
    offset = place if lean > 0.0 else math.sqrt(rig.offset_weight) * place if rig.offset_weight > 0.0 else 0.0
    rest, start = lean / length, max(-1.0, min(1.0, (lean + offset) / length))
    cos_rest, cos_start = math.sqrt((1.0 - rest) * (1.0 + rest)), math.sqrt((1.0 - start) * (1.0 + start))
    drop = offset * (2.0 * lean + offset) / length**2 / (cos_rest + cos_start) + speed**2 / (2.0 * rig.g * length)
    cos_top = cos_rest - drop
    if cos_top <= 0.0:
        free = length - lean
    else:
        sin_top = math.sqrt(max(0.0, rest * rest + drop * (cos_rest + cos_top)))
        free = length * drop * (cos_rest + cos_top) / (sin_top + rest) if sin_top + rest > 0.0 else 0.0
    far = max(abs(free), abs(offset))
    if all(
        rig.rub + rig.deceleration(share * far, pace * speed) == 0.0
        for share in (0.0, 1e-3, 0.1, 0.3, 0.7, 1.0)
        for pace in (1.0, 0.7, 0.3, 0.1, 1e-3)
    ):
        return free
    angle = math.asin(start)
    system = _Swing(rig, angle)
    brake = rig.g * abs(start) + rig.rub + abs(rig.deceleration(0.0, speed)) + speed * math.sqrt(rig.g / length)
    clock = Clock(0.1 * speed / brake, np.array([0.0, speed]), rtol)
    monitors = [
        Monitor("top", lambda tau, y: y[1], 1, 0.0),
        Monitor("horizontal", lambda tau, y: math.pi / 2 - (angle + y[0] / length), 1),
    ]
    y = np.array([0.0, speed])
    while True:
        _, y, event = advance(system, y, 1e3 * math.sqrt(length / rig.g), clock, monitors)
        if event:
            break
        if y[1] <= 1e-14 * speed:  # a creeping end
            break
    if event == "horizontal":
        return length - lean
    turn = float(y[0]) / length
    return offset - 2.0 * (lean + offset) * math.sin(0.5 * turn) ** 2 + length * cos_start * math.sin(turn)


def _flight(rig: ReferenceRig, speed: float, place: float, times: Sequence[float], rtol: float) -> FloatArray:
    """Place from rest and speed, (n_times, 2), of a ball that flies, at times after it left at `speed` from `place`.

    Losses oppose the motion. A cause's count the way from the launch, or from where the ball last turned.
    """
    found = np.empty((len(times), 2))
    angle, side, begin, held = math.asin((rig.lean + place) / rig.l), 1.0, 0.0, False
    y, brake = np.array([0.0, speed]), rig.g / rig.l
    clock = Clock(1e-3 / math.sqrt(brake), np.array([speed / math.sqrt(brake), speed]), rtol)
    top = [Monitor("top", lambda tau, row: row[1], 1, 0.0)]
    lossy = rig.rub + rig.deceleration(speed / math.sqrt(brake), speed) != 0.0
    for k, t in enumerate(times):
        while begin < t and not held:
            system = _Swing(rig, angle)
            if not lossy:  # the equation has no kink where the ball turns
                _, y, _ = advance(system, y, t - begin, clock, [])
                begin = t
                break
            gone, y, event = advance(system, y, t - begin, clock, top)
            begin += gone
            if event:
                angle, side = -(angle + float(y[0]) / rig.l), -side
                y = np.zeros(2)
                held = _Swing(rig, angle).field(0.0, [0.0, 0.0])[1] <= 0.0
        now = angle + float(y[0]) / rig.l
        found[k] = side * rig.l * math.sin(now) - rig.lean, side * float(y[1]) * math.cos(now)
    return found

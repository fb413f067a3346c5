r"""The drive voltage, exactly, as a chain of pieces.

Whatever the amplifier does - follow its command, lag behind it, run at its largest rate - within one piece the
voltage is of one family,

.. math:: u(t_0 + s) = a + b s + c\, e^{-r s} + G \sin(\omega s + \psi),

and so is every quantity whose zero ends a piece, but for the ends of the command's own (`command`): the rate against
its limit, the voltage against its command, and, where a cause of the stack needs them apart, the zeros of the voltage
and its turning points. Zeros are found as in `closed_form`: by steps that bounds on the derivatives prove to be safe.
"""

from __future__ import annotations

import math

import numpy as np

from psafit.simulate.closed_form import safe_step
from psafit.simulate.command import IDLE, REACH, command, first_move, first_row, phase_of
from psafit.simulate.command import OMEGA as COMMAND_OMEGA
from psafit.simulate.compiled import WIDTH, compiled, fma, load, store

# Places in the record of a piece: beginning, end, the five coefficients with the two rates, where it stands, and the
# command's piece that it is in: which, from where the first one's period is counted, and when that ends.
BEGIN, END, CONSTANT, SLOPE, DECAY, RATE, SWING, OMEGA, PSI, SIGN, NUMBER, ROW, UNTIL, AWAY, PIECE = range(15)

_NOISE = 8 * np.finfo(float).eps
# A quantity this close to zero at the beginning of a piece is what ended the piece before.
_ENDED = 512 * np.finfo(float).eps


@compiled(borrows=True)
def _value(a, b, c, r, G, w, psi, s):  # type: ignore[no-untyped-def]
    value = a + b * s
    if c != 0.0:
        value += c * math.exp(-r * s)
    if G != 0.0:
        value += G * math.sin(w * s + psi)
    return value


@compiled(borrows=True)
def _first_zero(a, b, c, r, G, w, psi, end, loose=0.0, most=100_000):  # type: ignore[no-untyped-def]
    """First s > 0 at which a member of the family, positive just after 0, is zero; infinity where none before `end`.

    It is looked for in `most` steps. `loose` is what the rounding of the coefficients is worth at the beginning.
    """
    if c == 0.0 and G == 0.0:
        return -a / b if b < 0.0 and a > 0.0 else math.inf
    if a == 0.0 and b == 0.0 and G == 0.0:
        return math.inf  # what only decays does not reach zero
    s = 0.0
    rising = True
    for _ in range(most):
        e = c * math.exp(-r * s)
        sin, cos = math.sin(w * s + psi), math.cos(w * s + psi)
        g0 = a + b * s + e + G * sin
        g1 = b - r * e + w * G * cos
        g2 = r * r * e - w * w * G * sin
        b2 = r * r * abs(e) + w * w * abs(G)
        b3 = r * r * r * abs(e) + w * w * w * abs(G)
        floor = _NOISE * (abs(a) + abs(b * s) + abs(e) + abs(G))
        if b >= 0.0 and a + b * s > abs(e) + abs(G) + floor:
            return math.inf  # what decays and what swings can no longer reach zero
        if rising:
            floor = max(floor * _ENDED / _NOISE, loose)
        if g0 <= floor:
            if g1 <= 0.0 and not rising:
                return s
            g0 = floor
            g1 = max(g1, 0.0)
        else:
            rising = False
        step = safe_step(g0, g1, g2, b2, b3)
        if s + step == s or (g1 < 0.0 and step <= 2e-16 * s):
            return s
        s += step
        if s > end:
            return math.inf
    return math.inf


@compiled(borrows=True)
def _sign(value, noise, otherwise):  # type: ignore[no-untyped-def]
    """Sign of what is more than noise."""
    return math.copysign(1.0, value) if abs(value) > noise else otherwise


@compiled(borrows=True)
def voltage(piece, t):  # type: ignore[no-untyped-def]
    """Voltage at `t`; beyond the piece's end, its formula carried on."""
    return _value(
        piece[CONSTANT], piece[SLOPE], piece[DECAY], piece[RATE], piece[SWING], piece[OMEGA], piece[PSI],
        t - piece[BEGIN],
    )  # fmt: skip


# pi in parts of which a multiple has no rounding, and the number that, added, leaves no digits behind the point.
_PI = (
    math.floor(math.pi * 2.0**31) / 2.0**31,
    math.pi - math.floor(math.pi * 2.0**31) / 2.0**31,
    1.2246467991473532e-16,
)
_ROUND = 1.5 * 2.0**52
_SERIES = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(10, -1, -1))


@compiled(inside=True)
def _sines(x):  # type: ignore[no-untyped-def]
    """Eight sines: Taylor's series about the nearest multiple of pi, exact to rounding within a quarter turn."""
    turns = (x * (1.0 / math.pi) + _ROUND) - _ROUND
    half = turns * 0.5
    odd = half - ((half + _ROUND) - _ROUND)
    rest = ((x - turns * _PI[0]) - turns * _PI[1]) - turns * _PI[2]
    square = rest * rest
    series = fma(square, _SERIES[0], _SERIES[1])
    for coefficient in _SERIES[2:]:
        series = fma(series, square, coefficient)
    return series * rest * (1.0 - odd * odd * 8.0)


@compiled(inside=True)
def voltages(piece, t, scratch):  # type: ignore[no-untyped-def]
    """Return `voltage` at eight times."""
    s = t - piece[BEGIN]
    value = s * piece[SLOPE] + piece[CONSTANT]
    if piece[DECAY] != 0.0:
        store(scratch, 0, s)
        for i in range(WIDTH):
            scratch[i] = math.exp(-piece[RATE] * scratch[i])
        value = value + load(scratch, 0) * piece[DECAY]
    if piece[SWING] != 0.0:
        value = value + _sines(s * piece[OMEGA] + piece[PSI]) * piece[SWING]
    return value


@compiled(borrows=True)
def first_piece(piece, rows, point, phase, lag, inverse_slew, split):  # type: ignore[no-untyped-def]
    """The piece that begins with the drive, at rest under the idle voltage; whether there is one."""
    piece[:] = 0.0
    piece[ROW] = first_row(rows, point, phase_of(point, phase))
    k, begin = first_move(rows, point, int(piece[ROW]), phase_of(point, phase))
    if begin == math.inf:
        return False
    piece[NUMBER] = k - 1.0
    piece[END] = piece[UNTIL] = begin
    next_piece(piece, point[IDLE], rows, point, phase, lag, inverse_slew, split)
    return True


@compiled(borrows=True)
def next_piece(piece, u, rows, point, phase, lag, inverse_slew, split):  # type: ignore[no-untyped-def]  # noqa: PLR0915
    """Replace a piece by the one after it; `u` is the voltage at its end.

    `split` asks for pieces within which voltage and rate keep their signs.
    """
    t = piece[END]
    w = point[COMMAND_OMEGA]
    if t == piece[UNTIL]:
        piece[NUMBER] += 1.0
    anchor, until, level, gain, swing, psi = command(
        rows, point, int(piece[ROW]), int(piece[NUMBER]), phase_of(point, phase)
    )
    piece[UNTIL] = until
    end = until - t
    steady = level + gain * (t - anchor) if gain != 0.0 else level
    psi += w * t
    if swing == 0.0:
        w = psi = 0.0
    sin, cos = math.sin(psi), math.cos(psi)
    now, rate, bend = steady + swing * sin, gain + w * swing * cos, -w * w * swing * sin

    a, b, c, r, G, phi = steady, gain, 0.0, 0.0, swing, psi
    # Which way it goes: as the command's rate or, where that is zero within what a rounding of the time is worth, as it
    # bends; what lags goes after the command.
    size0 = abs(steady) + abs(u) + abs(swing) + point[REACH]
    fastest = abs(gain) + w * abs(swing)
    unsure = _ENDED * fastest * (1.0 + w * t)  # of the rate
    direction = _sign(bend, 0.0, 0.0)
    direction = _sign(rate, unsure, direction)
    limited = inverse_slew > 0.0
    top = 1.0 / inverse_slew if limited else math.inf
    ahead = now - u
    # What a rounding of the time is worth in volts, at the largest rates of both.
    loose = _ENDED * (point[REACH] + abs(point[IDLE]) + (top + fastest) * t) if limited else 0.0
    if lag > 0.0:
        edge = top * lag
        r = 1.0 / lag
        growing = math.copysign(1.0, ahead) * (rate - ahead * r)  # of |ahead| while lagging
        near = abs(abs(ahead) - edge) <= loose
        if not limited or (growing <= 0.0 if near else abs(ahead) < edge):
            shift = math.atan(w * lag)
            G, phi = swing * math.cos(shift), psi - shift
            a = steady - lag * gain
            c = u - a - G * math.sin(phi)
            c = c if abs(c) > _ENDED * size0 else 0.0  # it has caught up, all but for rounding
            direction = _sign(ahead, _ENDED * (size0 + t * fastest), direction)
            if limited:
                # c_cmd - u = lag (b + G w cos(w s + phi)) - c exp(-r s)
                quarter = 0.5 * math.pi
                for side in (1.0, -1.0):
                    end = min(
                        end,
                        _first_zero(
                            edge - side * lag * gain, 0.0, side * c, r, -side * lag * G * w, w, phi + quarter, end
                        ),
                    )
        else:
            side = math.copysign(1.0, ahead)
            end = min(
                end, _first_zero(side * (steady - u) - edge, side * gain - top, 0.0, 0.0, side * swing, w, psi, end)
            )
            a, b, c, r, G = u, side * top, 0.0, 0.0, 0.0
            direction = side
    elif limited:
        met = abs(ahead) <= loose
        fits = abs(rate) < top - unsure or (abs(rate) <= top + unsure and rate * bend <= 0.0)
        if met and fits:
            if abs(gain) + w * abs(swing) > top:
                quarter = 0.5 * math.pi
                for side in (1.0, -1.0):
                    end = min(
                        end, _first_zero(top - side * gain, 0.0, 0.0, 0.0, -side * swing * w, w, psi + quarter, end)
                    )
        else:
            side = math.copysign(1.0, rate if met else ahead)
            end = min(end, _first_zero(side * (steady - u), side * gain - top, 0.0, 0.0, side * swing, w, psi, end))
            a, b, G = u, side * top, 0.0
            direction = side

    piece[BEGIN] = t
    piece[CONSTANT], piece[SLOPE], piece[DECAY], piece[RATE] = a, b, c, r
    piece[SWING], piece[OMEGA], piece[PSI] = G, w, phi
    # What begins at zero, within what a rounding of the time is worth, takes the sign of its rate, however flat it
    # begins.
    v0, v1 = a + c + G * math.sin(phi), b - r * c + w * G * math.cos(phi)
    noise = _ENDED * (size0 + t * abs(v1))
    piece[SIGN] = sign = _sign(v0, noise, direction)
    piece[AWAY] = _sign(v0 - point[IDLE], noise, direction)
    if split:
        if direction != 0.0 and (c != 0.0 or G != 0.0):
            quarter = 0.5 * math.pi
            end = min(
                end,
                _first_zero(
                    direction * b, 0.0, -direction * r * c, r, direction * w * G, w, phi + quarter, end,
                    _ENDED * r * size0,
                ),
            )  # fmt: skip
        # Up to where it turns it passes zero once at most, and only if it is beyond it there: one that only touches
        # zero, as a drive from 0 V does, keeps its sign.
        if sign != 0.0 and (end == math.inf or sign * _value(a, b, c, r, G, w, phi, end) < -noise):
            end = min(end, _first_zero(sign * a, sign * b, sign * c, r, sign * G, w, phi, end))
    piece[END] = until if end == until - t else t + end

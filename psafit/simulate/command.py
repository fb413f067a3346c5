r"""The command voltage of every drive, as a sequence of pieces.

.. math:: u(t) = a + b\,(t - t_0) + G \sin(\omega t + \psi)

within each. The engines ask for one piece after the other; what waveform they come from they need not know. Pieces are
counted, not found from the time, which may be a rounding before the end of one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.drives import WAVEFORMS, Drive, Table
from psafit.simulate.compiled import compiled

# Places in the record of a point's command, and its length.
(
    RATE, SCALE, BIAS, IDLE, REST, TURN, LAST, PERIOD, SHIFTS, FIRST, COUNT, OMEGA, FREQUENCY, REACH, JUMPS, LENGTH,
    LOW, HIGH, COMMAND,
) = range(19)  # fmt: skip
# Places in the record of a piece of a waveform.
BEGIN, LEVEL, SLOPE, SWING, ANGLE = range(5)
# What counts as a jump, as a part of the greatest change of the voltage.
_JUMP = 0.1


@compiled(inside=True)
def driven(point, scale, idle, own):  # type: ignore[no-untyped-def]
    """Write a point's command into `own`, its amplitude and its idle voltage changed; a recording's stay."""
    for k in range(COMMAND):
        own[k] = point[k]
    if (scale == 1.0 and idle == 0.0) or point[LENGTH] > 0.0:
        return
    own[SCALE] *= scale
    own[IDLE] += idle
    own[REST] += idle
    above = own[BIAS] - own[IDLE]
    own[REACH] = max(abs(own[SCALE] * own[HIGH] + above), abs(own[SCALE] * own[LOW] + above))
    if abs(idle) > _JUMP * own[REACH]:
        own[JUMPS] = 1.0


@compiled(inside=True)
def phase_of(point, phase):  # type: ignore[no-untyped-def]
    """What a phase (rad) at the start adds to a command: a recording and a wave of jumps take none."""
    return phase if point[SHIFTS] != 0.0 else 0.0


@compiled(inside=True)
def first_row(rows, point, phase):  # type: ignore[no-untyped-def]
    """Piece of the period within which the command starts."""
    n = int(point[COUNT])
    first = int(point[FIRST])
    turn = point[TURN]
    if phase != 0.0:
        turn = (turn + phase / (2.0 * math.pi)) % 1.0
    row = 0
    while row + 1 < n and rows[first + row + 1, BEGIN] <= turn:
        row += 1
    return row


@compiled(inside=True)
def command(rows, point, row, k, phase):  # type: ignore[no-untyped-def]
    """The piece number `k` from the start, which lies in piece `row` of the period, as (t_0, end, a, b, G, psi).

    The end is infinite where nothing follows; `t_0`, where the level is `a`, may lie before the start.
    """
    n = int(point[COUNT])
    first = int(point[FIRST])
    index = row + k
    period = 0
    if index >= n:
        period = index // n
        index -= period * n
    at = first + index
    scale = point[SCALE]
    psi = 2.0 * math.pi * point[TURN] + phase + rows[at, ANGLE]
    turn = point[TURN]
    if phase != 0.0:
        turn = (turn + phase / (2.0 * math.pi)) % 1.0
    base = period * point[PERIOD]
    begin = (base + rows[at, BEGIN] - turn) / point[RATE]
    if begin >= point[LAST]:
        return point[LAST], math.inf, point[REST], 0.0, 0.0, 0.0
    if n == 1 and rows[at, SLOPE] == 0.0:
        end = math.inf  # a constant or a sine, however many periods
    elif index + 1 < n:
        end = (base + rows[at + 1, BEGIN] - turn) / point[RATE]
    else:
        end = (base + point[PERIOD] - turn) / point[RATE]
    return (
        begin, min(end, point[LAST]), point[BIAS] + scale * rows[at, LEVEL], scale * rows[at, SLOPE] * point[RATE],
        scale * rows[at, SWING], psi,
    )  # fmt: skip


@compiled(inside=True)
def first_move(rows, point, row, phase):  # type: ignore[no-untyped-def]
    """Number of the first piece that does not rest at the idle voltage, and its beginning; infinity if none."""
    k, now = 0, 0.0
    while True:
        _, end, a, b, G, _ = command(rows, point, row, k, phase)
        if a != point[IDLE] or b != 0.0 or G != 0.0:
            return k, now
        if end == math.inf:
            return k, end
        k, now = k + 1, end


def _rows(drive: Drive) -> FloatArray:
    """Pieces of one period, or of a recording, (n_pieces, 5)."""
    table = drive.table
    if table is None:
        if drive.waveform not in WAVEFORMS:
            raise ValueError(f"no waveform {drive.waveform!r}; there are {', '.join(WAVEFORMS)}")
        return WAVEFORMS[drive.waveform].rows
    at, value = table.at, table.value
    if at[0] > 0.0:
        at, value = np.concatenate([[0.0, at[0]], at]), np.concatenate([[drive.idle_v] * 2, value])
    long = np.diff(at) > 0.0
    slope = np.diff(value)[long] / np.diff(at)[long]
    nothing = np.zeros(slope.size)
    return np.column_stack([at[:-1][long], value[:-1][long], slope, nothing, nothing])


def _span(rows: FloatArray, table: Table | None, end: float) -> tuple[float, float, bool]:
    """Least and greatest value of one period, and whether it jumps."""
    begin, level, slope, swing, angle = rows.T
    last = level + slope * (np.append(begin[1:], end) - begin)
    if swing.any():
        return (
            float(level[0] - swing[0]),
            float(level[0] + swing[0]),
            abs(level[0] + swing[0] * np.sin(angle[0])) > _JUMP,
        )
    ends = np.concatenate([level, last])
    jumps = bool((np.abs(np.append(level[0], last[:-1]) - level) > _JUMP * np.ptp(ends)).any())
    return float(ends.min()), float(ends.max()), (jumps or abs(level[0]) > _JUMP) and table is None


def commands(
    drives: Sequence[Drive], drive: NDArray[np.int64], frequency: FloatArray, amplitude: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pieces of all drives, (n_pieces, 5), and the record of each point's command, (n_points, `COMMAND`)."""
    parts = [_rows(d) for d in drives]
    first = np.cumsum([0, *(len(p) for p in parts)])
    points = np.zeros((frequency.size, COMMAND))
    for k, d in enumerate(drives):
        own = drive == k
        f, volt = frequency[own], amplitude[own]
        once = d.table is not None and d.table.recorded
        end = float(d.table.at[-1]) if once and d.table else 1.0
        low, high, jumps = _span(parts[k], d.table, end)
        values = {
            RATE: 1.0 if once else f,
            SCALE: 1.0 if once else volt,
            BIAS: d.bias_v,
            IDLE: d.idle_v,
            REST: d.table.value[-1] if once and d.table else d.idle_v,
            TURN: d.phase_deg / 360.0 % 1.0,
            LAST: end if once else d.cycles / f,
            PERIOD: end,
            SHIFTS: float(d.table is None and WAVEFORMS[d.waveform].shifts) if not once else 0.0,
            FIRST: first[k],
            COUNT: len(parts[k]),
            OMEGA: 2.0 * np.pi * f if parts[k][:, SWING].any() else 0.0,
            FREQUENCY: f,
            REACH: np.maximum(abs(high * (1.0 if once else volt) + d.bias_v - d.idle_v),
                              abs(low * (1.0 if once else volt) + d.bias_v - d.idle_v)),
            JUMPS: float(jumps),
            LENGTH: end if once else 0.0,
            LOW: low,
            HIGH: high,
        }  # fmt: skip
        for place, value in values.items():
            points[own, place] = value
    return np.concatenate(parts), points

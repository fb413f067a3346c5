"""What a waveform declares: one period, once as pieces for the engines and once as formulas for the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from psafit.arrays import FloatArray


@dataclass(frozen=True)
class Piece:
    r"""A part of one period: ``w(x) = level + slope (x - begin) + swing sin(2 pi x + angle)``.

    Parameters
    ----------
    begin : float
        Phase, in periods, at which the piece begins; it ends where the next begins, or with the period.
    level : float
    slope : float
        Per period.
    swing : float
    angle : float, rad
    """

    begin: float
    level: float
    slope: float = 0.0
    swing: float = 0.0
    angle: float = 0.0


@dataclass(frozen=True)
class Waveform:
    """One period of a drive, ``w(x)`` for a phase `x` of 0 to 1, per volt of amplitude.

    Parameters
    ----------
    id : str
        The name in `experiment.toml`.
    title : str
        One line, for a list: the formula in words.
    pieces : tuple of Piece
        For the engines. A waveform with a swing has one piece, without a slope.
    corners : tuple of float
        For the reference: phases between which `value` and the size of `rate` are smooth and monotonic; the first is 0.
    value, rate : callable
        For the reference: ``value(k, x)``, ``rate(k, x)`` of the part that begins at corner number `k`, at `x` periods
        behind that corner; `rate` is per period. Written on their own, not from `pieces`.
    crest_squared : float, optional
        Square of peak over RMS, for the amplitude of volts RMS; None where a reading in RMS has no single meaning.
    shifts : bool
        Whether the cause `start_phase` acts: a waveform of jumps is switched by a trigger and starts where it should.
    names : tuple of str
        What instruments and spreadsheets call it as well.
    """

    id: str
    title: str
    pieces: tuple[Piece, ...]
    corners: tuple[float, ...]
    value: Callable[[int, float], float]
    rate: Callable[[int, float], float]
    crest_squared: float | None = None
    shifts: bool = True
    names: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        begins = [p.begin for p in self.pieces]
        if not begins or begins[0] != 0.0 or sorted(set(begins)) != begins or begins[-1] >= 1.0:
            raise ValueError(f"waveform {self.id}: pieces must begin at 0 and rise to below 1, got {begins}")
        if any(p.swing for p in self.pieces) and (len(begins) > 1 or self.pieces[0].slope):
            raise ValueError(f"waveform {self.id}: a swing takes one piece without a slope")
        if list(self.corners) != sorted(set(self.corners)) or self.corners[0] != 0.0 or self.corners[-1] >= 1.0:
            raise ValueError(f"waveform {self.id}: corners must begin at 0 and rise to below 1, got {self.corners}")

    @property
    def span(self) -> tuple[float, float]:
        """Least and greatest value."""
        ends = zip(self.corners, [*self.corners[1:], 1.0], strict=True)
        values = [self.value(k, x) for k, (low, high) in enumerate(ends) for x in (0.0, high - low)]
        return min(values), max(values)

    @property
    def unipolar(self) -> bool:
        """Whether it goes from nothing to one side."""
        return 0.0 in self.span

    @property
    def rows(self) -> FloatArray:
        """The pieces as the engines take them, (n_pieces, 5): begin, level, slope, swing, angle."""
        return np.array([[p.begin, p.level, p.slope, p.swing, p.angle] for p in self.pieces])

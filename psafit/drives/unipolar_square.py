r"""Pulses: the amplitude for half a period, then zero.

.. math:: w(x) = 1 \ (x < 1/2), \qquad 0 \ (x \ge 1/2).
"""

from psafit.drives.waveform import Piece, Waveform

WAVEFORM = Waveform(
    id="unipolar_square",
    title="1 in the first half of a period, 0 in the second",
    pieces=(Piece(0.0, level=1.0), Piece(0.5, level=0.0)),
    corners=(0.0, 0.5),
    value=lambda k, x: 1.0 if k == 0 else 0.0,
    rate=lambda k, x: 0.0,
    shifts=False,
    names=("unipolar square", "ttl"),
)

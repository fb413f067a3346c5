r"""A triangle between zero and the amplitude, as a stack that must not be driven below 0 V gets it.

.. math:: w(x) = 2x \ (x < 1/2), \qquad 2 - 2x \ (x \ge 1/2).
"""

from psafit.drives.waveform import Piece, Waveform

WAVEFORM = Waveform(
    id="unipolar_triangle",
    title="straight lines 0, 1, 0",
    pieces=(Piece(0.0, level=0.0, slope=2.0), Piece(0.5, level=1.0, slope=-2.0)),
    corners=(0.0, 0.5),
    value=lambda k, x: (2 * x, 1 - 2 * x)[k],
    rate=lambda k, x: (2.0, -2.0)[k],
    names=("unipolar triangle", "unipolar triangular"),
)

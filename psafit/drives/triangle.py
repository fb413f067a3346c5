r"""A triangle that begins at zero and rises first, in phase with a sine.

.. math:: w(x) = 4x \ (x < 1/4), \qquad 2 - 4x \ (1/4 \le x < 3/4), \qquad 4x - 4 \ (x \ge 3/4).
"""

from psafit.drives.waveform import Piece, Waveform

WAVEFORM = Waveform(
    id="triangle",
    title="straight lines 0, +1, -1, 0; rises first",
    pieces=(Piece(0.0, level=0.0, slope=4.0), Piece(0.25, level=1.0, slope=-4.0), Piece(0.75, level=-1.0, slope=4.0)),
    corners=(0.0, 0.25, 0.75),
    value=lambda k, x: (4 * x, 1 - 4 * x, 4 * x - 1)[k],
    rate=lambda k, x: (4.0, -4.0, 4.0)[k],
    crest_squared=3.0,
    names=("tri", "triangular", "triangle wave", "dreieck"),
)

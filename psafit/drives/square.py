r"""A square wave.

.. math:: w(x) = 1 \ (x < 1/2), \qquad -1 \ (x \ge 1/2).
"""

from psafit.drives.waveform import Piece, Waveform

WAVEFORM = Waveform(
    id="square",
    title="+1 in the first half of a period, -1 in the second",
    pieces=(Piece(0.0, level=1.0), Piece(0.5, level=-1.0)),
    corners=(0.0, 0.5),
    value=lambda k, x: 1.0 if k == 0 else -1.0,
    rate=lambda k, x: 0.0,
    crest_squared=1.0,
    shifts=False,
    names=("squ", "rect", "rectangle", "rectangular", "rechteck", "square wave"),
)

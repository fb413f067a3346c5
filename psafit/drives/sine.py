r"""A sine.

.. math:: w(x) = \sin 2\pi x.
"""

import math

from psafit.drives.waveform import Piece, Waveform


def value(k: int, x: float) -> float:
    """The sine in quarter `k`, of an angle below pi/2: no digits are lost near a zero."""
    shape = math.sin(2 * math.pi * x) if k % 2 == 0 else math.cos(2 * math.pi * x)
    return shape if k < 2 else -shape


def rate(k: int, x: float) -> float:
    """The derivative of `value` by `x`."""
    shape = math.cos(2 * math.pi * x) if k % 2 == 0 else -math.sin(2 * math.pi * x)
    return 2 * math.pi * (shape if k < 2 else -shape)


WAVEFORM = Waveform(
    id="sine",
    title="sin(2 pi f t)",
    pieces=(Piece(0.0, level=0.0, swing=1.0),),
    corners=(0.0, 0.25, 0.5, 0.75),
    value=value,
    rate=rate,
    crest_squared=2.0,
    names=("sin", "sinus", "sinusoidal", "sine wave"),
)

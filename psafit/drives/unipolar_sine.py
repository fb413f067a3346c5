r"""A sine between zero and the amplitude, as a stack that must not be driven below 0 V gets it.

.. math:: w(x) = \tfrac{1}{2} (1 - \cos 2\pi x).
"""

import math

from psafit.drives.waveform import Piece, Waveform


def value(k: int, x: float) -> float:
    """Quarter `k`; by the half angle, so that no digits are lost near a zero."""
    if k == 0:
        return math.sin(math.pi * x) ** 2
    if k == 1:
        return 0.5 * (1 + math.sin(2 * math.pi * x))
    return math.cos(math.pi * x) ** 2 if k == 2 else 0.5 * (1 - math.sin(2 * math.pi * x))


def rate(k: int, x: float) -> float:
    """``pi sin 2 pi x`` by quarters."""
    shape = math.sin(2 * math.pi * x) if k % 2 == 0 else math.cos(2 * math.pi * x)
    return math.pi * (shape if k < 2 else -shape)


WAVEFORM = Waveform(
    id="unipolar_sine",
    title="(1 - cos(2 pi f t))/2: from 0 to 1 and back",
    pieces=(Piece(0.0, level=0.5, swing=0.5, angle=-math.pi / 2),),
    corners=(0.0, 0.25, 0.5, 0.75),
    value=value,
    rate=rate,
    names=("unipolar sine", "haversine", "raised cosine"),
)

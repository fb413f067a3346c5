"""Which causes a design can distinguish, as matrices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from psafit.arrays import FloatArray
from psafit.diagnose.isolability import ConfoundedPair, Isolability
from psafit.report.style import PALETTE, figure_style


def isolability_figure(found: Isolability, *, most: float = 30.0) -> Figure:
    """Draw the nats by which readings of each row's cause speak against each column's, and of pairs against singles.

    The second matrix is there where some pair looks like a single cause, or the reverse.

    Parameters
    ----------
    found : Isolability
    most : float
        Nats from which on all have one colour.
    """
    blocks = [id for block in found.blocks for id in block.causes]
    seen = [*blocks, *(id for id in found.causes if id not in blocks and id not in found.unseen)]
    seen = seen or found.causes  # where none would be seen, all of them show how little they do
    order = [found.causes.index(id) for id in seen]
    nats = np.array(found.nats)[np.ix_(order, order)]
    n, limit, panels = len(order), found.settings.apart, 1 + bool(found.pairs)
    with figure_style():
        figure = Figure(figsize=(panels * (2.0 + 0.36 * n) + 0.6, 2.9 + 0.3 * n), layout="constrained")
        axes = figure.subplots(1, panels, squeeze=False)[0]
        image = _matrix(axes[0], seen, nats, limit, most)
        axes[0].set_xlabel("Cause by which they are explained")
        axes[0].set_ylabel("Cause that made the readings")
        if found.pairs:
            _matrix(axes[1], seen, _of_pairs(found.pairs, seen, most), limit, most)
            axes[1].set_xlabel("Above: made by both, explained by one. Below: made by one, explained by both")
        bar = figure.colorbar(image, ax=list(axes), shrink=0.8, pad=0.02)
        bar.set_label(f"Nats against the explanation (numbers: below {limit:g}, hardly distinguished)")
    return figure


def _matrix(axes: Axes, names: Sequence[str], nats: FloatArray, limit: float, most: float) -> AxesImage:
    """A square of causes, dark where little distinguishes them, with the numbers below the limit."""
    colours = LinearSegmentedColormap.from_list("nats", [PALETTE["vermillion"], "#f6e3d7", "#ffffff"])
    n = len(names)
    image = axes.imshow(nats, cmap=colours, vmin=0.0, vmax=most, aspect="auto")
    for i in range(n):
        axes.add_patch(Rectangle((i - 0.5, i - 0.5), 1, 1, facecolor=PALETTE["faint"], edgecolor="none"))
        for j in np.flatnonzero((nats[i] < limit) & (np.arange(n) != i)).tolist():
            axes.text(j, i, f"{nats[i, j]:.1f}", ha="center", va="center", fontsize=7, color="white")
    axes.set_xticks(range(n), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
    axes.set_yticks(range(n), names, fontsize=8)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    return image


def _of_pairs(pairs: Sequence[ConfoundedPair], names: Sequence[str], most: float) -> FloatArray:
    """The least nats of each pair against a single cause, above the diagonal, and of one against the pair, below."""
    nats = np.full((len(names), len(names)), most)
    for one in pairs:
        both = one.truth if len(one.truth) == 2 else one.rival
        low, high = sorted(names.index(id) for id in both)
        at = (low, high) if both is one.truth else (high, low)
        nats[at] = min(nats[at], one.nats)
    return nats

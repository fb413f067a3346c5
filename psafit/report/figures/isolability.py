"""Which causes a design can distinguish, as a matrix."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from psafit.diagnose.isolability import Isolability
from psafit.report.style import PALETTE, figure_style


def isolability_figure(found: Isolability, *, most: float = 30.0) -> Figure:
    """Draw the nats by which readings of each row's cause speak against each column's.

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
    n, limit = len(order), found.settings.apart
    colours = LinearSegmentedColormap.from_list("nats", [PALETTE["vermillion"], "#f6e3d7", "#ffffff"])
    with figure_style():
        figure = Figure(figsize=(2.6 + 0.36 * n, 2.9 + 0.3 * n), layout="constrained")
        axes = figure.subplots()
        image = axes.imshow(nats, cmap=colours, vmin=0.0, vmax=most)
        for i in range(n):
            axes.add_patch(Rectangle((i - 0.5, i - 0.5), 1, 1, facecolor=PALETTE["faint"], edgecolor="none"))
            for j in np.flatnonzero((nats[i] < limit) & (np.arange(n) != i)).tolist():
                axes.text(j, i, f"{nats[i, j]:.1f}", ha="center", va="center", fontsize=7, color="white")
        axes.set_xticks(range(n), seen, rotation=60, ha="right", rotation_mode="anchor", fontsize=8)
        axes.set_yticks(range(n), seen, fontsize=8)
        axes.grid(visible=False)
        axes.tick_params(length=0)
        axes.set_xlabel("Cause by which they are explained")
        axes.set_ylabel("Cause that made the readings")
        bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
        bar.set_label(f"Nats against the column's cause (numbers: below {limit:g}, hardly distinguished)")
    return figure

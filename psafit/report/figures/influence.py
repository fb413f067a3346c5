"""Readings, coloured by what each of them gives a cause."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from psafit.arrays import FloatArray
from psafit.experiment import Group
from psafit.report.figures.axes import range_label, scale_axis, scale_sweep
from psafit.report.figures.curves import view_of
from psafit.report.figures.groups import title
from psafit.report.figures.sweep import Sweep
from psafit.report.style import PALETTE, figure_style


def influence_figure(
    groups: Sequence[Group], sweeps: Sequence[Sweep], nats: Sequence[FloatArray], *, most: float
) -> Figure:
    """Readings of all groups, three groups in a row; what a logarithmic axis does not reach lies on its lower end.

    Parameters
    ----------
    groups : sequence of Group
    sweeps : sequence of Sweep
    nats : sequence of (n_points,) arrays
        What each reading of a group gives the cause.
    most : float
        Nats at either end of the colours.
    """
    columns = min(len(groups), 3)
    rows = math.ceil(len(groups) / columns)
    colours = LinearSegmentedColormap.from_list("nats", [PALETTE["blue"], "#eceff2", PALETTE["vermillion"]])
    norm = Normalize(-most, most)
    with figure_style():
        figure = Figure(figsize=(3.7 * columns + 0.9, 2.6 * rows + 0.3), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for axes, group, sweep, given in zip(panels, groups, sweeps, nats, strict=False):
            low, high, log = view_of(group, ())
            axes.scatter(
                sweep.values, np.maximum(group.reading, low), c=given, cmap=colours, norm=norm, s=30,
                edgecolor=PALETTE["grey"], linewidth=0.5, zorder=3, clip_on=False,
            )  # fmt: skip
            scale_sweep(axes, sweep)
            scale_axis(axes, "y", low, high, log=log)
            title(axes, group.id, sweep.condition)
            axes.set_xlabel(sweep.label)
            axes.set_ylabel(range_label(group))
        for axes in panels[len(groups) :]:
            axes.remove()
        bar = figure.colorbar(ScalarMappable(norm, colours), ax=panels[: len(groups)].tolist(), shrink=0.8, pad=0.02)
        bar.set_label("nats for the cause")
    return figure

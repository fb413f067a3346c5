"""One look for every figure: palette, sizes and the marks of measurement and simulation.

Figures are plain `matplotlib.figure.Figure` objects, never pyplot's: nothing is registered
globally, nothing needs a display and nothing leaks between reports.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import MappingProxyType
from typing import Any, Final, cast

import matplotlib as mpl
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito (2008): distinguishable with every common colour vision deficiency. Their yellow is
# left out, it has too little contrast on white for a thin line.
PALETTE: Final = MappingProxyType(
    {
        "blue": "#0072B2",
        "vermillion": "#D55E00",
        "green": "#009E73",
        "purple": "#CC79A7",
        "sky": "#56B4E9",
        "orange": "#E69F00",
        "ink": "#1f2328",
        "grey": "#6b7280",
        "faint": "#d8dde3",
    }
)
CYCLE: Final = ("blue", "vermillion", "green", "purple", "orange", "sky")

# Width in inches of a figure that the page shows about 420 px wide: 10 pt type is then 13 px tall.
WIDTH: Final = 4.4
HEIGHT: Final = 3.2
WIDE: Final = 8.4

MEASURED: Final[dict[str, Any]] = {
    "linestyle": "none",
    "marker": "o",
    "markersize": 4.2,
    "markerfacecolor": "none",
    "markeredgecolor": PALETTE["ink"],
    "markeredgewidth": 0.9,
    "zorder": 3,
}
"""Keyword arguments of `Axes.plot` for measurements: open dark circles above bands and lines."""

BAND: Final[dict[str, Any]] = {"alpha": 0.22, "linewidth": 0.0, "zorder": 1}
"""Keyword arguments of `Axes.fill_between` for an interval around a simulated line."""

_RC: Final[dict[str, Any]] = {
    "figure.facecolor": "white",
    "figure.dpi": 100,
    "figure.constrained_layout.use": True,
    "savefig.facecolor": "white",
    "axes.facecolor": "white",
    "axes.edgecolor": PALETTE["grey"],
    "axes.labelcolor": PALETTE["ink"],
    "axes.linewidth": 0.8,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlecolor": PALETTE["ink"],
    "axes.labelsize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=[PALETTE[name] for name in CYCLE]),
    "axes.formatter.useoffset": False,
    "grid.color": PALETTE["faint"],
    "grid.linewidth": 0.6,
    "xtick.color": PALETTE["grey"],
    "ytick.color": PALETTE["grey"],
    "xtick.labelcolor": PALETTE["ink"],
    "ytick.labelcolor": PALETTE["ink"],
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "font.family": ["DejaVu Sans"],
    "font.size": 10,
    "legend.fontsize": 9,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.25,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    # Paths instead of fonts: the page looks the same on every machine. The fixed salt makes equal
    # figures equal bytes.
    "svg.fonttype": "path",
    "svg.hashsalt": "psafit",
}


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply the look inside a `with` block; matplotlib's own settings return afterwards."""
    with mpl.rc_context():
        mpl.rcdefaults()  # a user's matplotlibrc must not change the report
        mpl.rcParams.update(cast(Any, _RC))
        yield


def new_figure(*, width: float = WIDTH, height: float = HEIGHT) -> tuple[Figure, Axes]:
    """Return an empty figure of one panel, inches; `WIDE` spans the page."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def plain_log_ticks(axes: Axes, *, x: bool = False, y: bool = False) -> None:
    """Label a logarithmic axis 100, 1000 instead of powers of ten."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    for wanted, axis in ((x, axes.xaxis), (y, axes.yaxis)):
        if wanted:
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())

"""Figures of the pages: results in, figures out; nothing here computes a result.

Each function returns a `matplotlib.figure.Figure` drawn in the package's style, or draws into given axes. Widths are
chosen for a page that shows a figure about 400 px wide.
"""

from psafit.report.figures.axes import range_label
from psafit.report.figures.curves import (
    READING_BAND,
    Band,
    Curve,
    curve_of,
    draw_curves,
    explorable,
    handles,
    has_zeros,
    without_curves,
    zero_mark,
)
from psafit.report.figures.groups import (
    group_figure,
    groups_figure,
    pit_figure,
    residual_figure,
    residual_view,
)
from psafit.report.figures.posterior import (
    Marginal,
    axis_label,
    corner_figure,
    estimates_figure,
    marginal_figure,
    trace_figure,
)
from psafit.report.figures.summary import Example, Mark, Row, draw_factors, row_names, summary_figure
from psafit.report.figures.sweep import Sweep, sweep_of, sweeps_of

__all__ = [
    "READING_BAND",
    "Band",
    "Curve",
    "Example",
    "Marginal",
    "Mark",
    "Row",
    "Sweep",
    "axis_label",
    "corner_figure",
    "curve_of",
    "draw_curves",
    "draw_factors",
    "estimates_figure",
    "explorable",
    "group_figure",
    "groups_figure",
    "handles",
    "has_zeros",
    "marginal_figure",
    "pit_figure",
    "range_label",
    "residual_figure",
    "residual_view",
    "row_names",
    "summary_figure",
    "sweep_of",
    "sweeps_of",
    "trace_figure",
    "without_curves",
    "zero_mark",
]

"""Figures of the fit report: results in, figures out; nothing here computes a result.

Each function returns a `matplotlib.figure.Figure` drawn in the package's style. Widths are chosen for a page that
shows a figure about 400 px wide.
"""

from psafit.report.figures.groups import group_figure, pit_figure, residual_figure, residual_view
from psafit.report.figures.posterior import Marginal, corner_figure, marginal_figure, trace_figure
from psafit.report.figures.summary import summary_figure
from psafit.report.figures.sweep import Sweep, sweep_of

__all__ = [
    "Marginal",
    "Sweep",
    "corner_figure",
    "group_figure",
    "marginal_figure",
    "pit_figure",
    "residual_figure",
    "residual_view",
    "summary_figure",
    "sweep_of",
    "trace_figure",
]

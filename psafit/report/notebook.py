"""What a notebook shows: tables as text or HTML, and plots into given axes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from matplotlib.axes import Axes

from psafit.diagnose.record import Diagnosis
from psafit.errors import InputError
from psafit.experiment import Experiment, Group
from psafit.records import Validation
from psafit.report import figures, fit_pictures
from psafit.report.diagnosis import overview, shown_groups
from psafit.report.figures.groups import title
from psafit.report.style import figure_style
from psafit.text import significant
from psafit.validate import Prediction

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Axes", "html", "plot_diagnosis", "plot_fit", "plot_group", "text"]

_WIDTH = 110  # columns of a terminal that are filled
_FORMAT: dict[str, Any] = {"float_format": significant, "na_rep": "-"}


def text(headline: str, remarks: Sequence[str], tables: Sequence[pd.DataFrame]) -> str:
    """A headline, remarks and tables, for a terminal."""
    said = [textwrap.fill(remark, _WIDTH, initial_indent="- ", subsequent_indent="  ") for remark in remarks]
    parts = ["\n".join(said)] if said else []
    return "\n\n".join([textwrap.fill(headline, _WIDTH), *parts, *(t.to_string(**_FORMAT) for t in tables)])


def html(headline: str, remarks: Sequence[str], tables: Sequence[pd.DataFrame]) -> str:
    """A headline, remarks and tables, for a notebook; everything is escaped."""
    import pandas as pd

    with pd.option_context("display.max_colwidth", None):
        parts = [Markup(t.to_html(**_FORMAT, border=0)) for t in tables]  # pandas escapes
    said = Markup("").join(Markup("<li>{}</li>").format(remark) for remark in remarks)
    listed = Markup("<ul>{}</ul>").format(said) if said else Markup("")
    return str(Markup("<p><strong>{}</strong></p>").format(headline) + listed + Markup("").join(parts))


def _axes(ax: Axes | None) -> Axes:
    """The caller's axes, or new ones of a figure that the notebook will show."""
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.subplots()[1]
    return ax


def plot_group(group: Group, curves: Sequence[figures.Curve], ax: Axes | None, role: str | None = None) -> Axes:
    """A group's readings, of one observable, and what models say of them."""
    sweep = figures.sweep_of(group)
    with figure_style():
        ax = _axes(ax)
        figures.draw_curves(ax, group, sweep, curves)
        title(ax, group.id, sweep.condition, role)
        ax.set_xlabel(sweep.label)
        ax.set_ylabel(figures.range_label(group))
        ax.legend(handles=figures.handles(curves, zeros=figures.zero_mark([(group, curves)])))
    return ax


def _plot_factors(rows: Sequence[figures.Row], ax: Axes | None) -> Axes:
    with figure_style():
        ax = _axes(ax)
        figures.draw_factors(ax, rows)
    return ax


def plot_fit(validation: Validation, predictions: Sequence[Prediction], group: Group | None, ax: Axes | None) -> Axes:
    """The prediction of a group's readings, of one observable; without a group, the error in each."""
    shown = fit_pictures.shown_groups(validation, predictions)
    if group is None:
        return _plot_factors(fit_pictures.factor_rows(shown), ax)
    g = next(g for g in shown if g.prediction.group.label == group.label)
    return plot_group(g.prediction.group, g.curves, ax, g.score.role)


def plot_diagnosis(
    record: Diagnosis, experiment: Experiment, folder: Path, group: Group | None, ax: Axes | None
) -> Axes:
    """Both models of a group's readings, of one observable; without a group, their error in each."""
    shown = shown_groups(record, experiment, folder)
    if group is None:
        return _plot_factors(overview.factor_rows(shown), ax)
    found = next((g for g in shown if g.group.label == group.label), None)
    if found is None:
        groups = ", ".join(str(id) for id in record.groups)
        raise InputError(f"group {group.id} is not of this diagnosis", f"choose one of {groups}")
    return plot_group(found.group, found.curves, ax)

"""One picture of a simulation beside the measurements."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from psafit.experiment import Conditions
from psafit.files import write_atomically
from psafit.report import figures
from psafit.report.page import PNG_DPI
from psafit.report.style import figure_style


def write_picture(groups: Sequence[Conditions], predicted_um: Sequence[NDArray[np.float64]], path: Path) -> None:
    """Draw each group's launch ranges, simulated, and measured where it was.

    Parameters
    ----------
    groups : sequence of Conditions
    predicted_um : sequence of (n_points,) arrays, um
        Of each group.
    path : Path
        Its ending says what kind of picture: .png, .svg or .pdf.
    """
    curves = [[figures.Curve("simulated", "vermillion", predicted)] for predicted in predicted_um]
    figure = figures.groups_figure(groups, [figures.sweep_of(g) for g in groups], curves)
    kind = path.suffix.lower().removeprefix(".")
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)  # equal pictures are equal bytes
    buffer = io.BytesIO()
    with figure_style():
        figure.savefig(buffer, format=kind, dpi=PNG_DPI, metadata=undated)
    write_atomically(path, buffer.getvalue())

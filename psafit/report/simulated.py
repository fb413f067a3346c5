"""One picture of a simulation beside the measurements."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from psafit.experiment import Conditions
from psafit.files import write_atomically
from psafit.report import figures
from psafit.report.page import PNG_DPI
from psafit.report.style import figure_style

_COLORS: Final = ("vermillion", "blue", "green", "purple")


def write_picture(
    groups: Sequence[Conditions], predicted_um: Mapping[str, Sequence[NDArray[np.float64]]], path: Path
) -> None:
    """Draw each group's launch ranges, simulated, and measured where it was.

    Parameters
    ----------
    groups : sequence of Conditions
    predicted_um : mapping of sequences of (n_points,) arrays, um
        By the name of a model, of each group.
    path : Path
        Its ending says what kind of picture: .png, .svg or .pdf.
    """
    looks = {name: (_COLORS[k % len(_COLORS)], k % 2 == 1) for k, name in enumerate(predicted_um)}
    curves = [
        [figures.Curve(name, color, predicted_um[name][g], dashed=dashed) for name, (color, dashed) in looks.items()]
        for g in range(len(groups))
    ]
    figure = figures.groups_figure(groups, [figures.sweep_of(g) for g in groups], curves)
    kind = path.suffix.lower().removeprefix(".")
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)  # equal pictures are equal bytes
    buffer = io.BytesIO()
    with figure_style():
        figure.savefig(buffer, format=kind, dpi=PNG_DPI, metadata=undated)
    write_atomically(path, buffer.getvalue())

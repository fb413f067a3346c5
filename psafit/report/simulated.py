"""One picture of a simulation and the measurements."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from psafit.arrays import FloatArray
from psafit.experiment import Conditions, by_part
from psafit.files import write_atomically
from psafit.report import figures
from psafit.report.style import figure_style

_COLORS: Final = ("vermillion", "blue", "green", "purple")


def write_picture(
    groups: Sequence[Conditions],
    predicted: Mapping[str, Sequence[FloatArray]],
    path: Path,
    ends: FloatArray | None = None,
) -> None:
    """Draw each group's readings, simulated, and measured where it was: a panel for each observable.

    Parameters
    ----------
    groups : sequence of Conditions
    predicted : mapping of pairs of arrays
        By the name of a model, one group after the other: at the groups' conditions, and at those of the groups
        `filled`; each reading in the unit of its observable.
    path : Path
        Its ending says what kind of picture: .png, .svg or .pdf.
    ends : (2, n_points) array, optional
        Of the 90 % intervals of readings, by the only model.
    """
    filled = [g.filled() for g in groups]
    parts, finer = ([part for g in whole for part in g.parts] for whole in (groups, filled))
    curves: list[list[figures.Curve]] = [[] for _ in parts]
    bands = (
        [()] * len(parts)
        if ends is None
        else [
            (figures.Band(figures.READING_BAND, low, high),)
            for low, high in zip(*(by_part(groups, end) for end in ends), strict=True)
        ]
    )
    for k, (name, (at_readings, between)) in enumerate(predicted.items()):
        color, dashed = _COLORS[k % len(_COLORS)], k % 2 == 1
        values = zip(finer, by_part(groups, at_readings), by_part(filled, between), bands, strict=True)
        for drawn, (g, middle, line, band) in zip(curves, values, strict=True):
            smooth = None if g.along is None else (g.along, line)
            drawn.append(figures.Curve(name, color, middle, band, dashed, smooth))
    save(figures.groups_figure(parts, [figures.sweep_of(g) for g in parts], curves), path)


def save(figure: Figure, path: Path, dpi: int = 200) -> None:
    """Write a figure in one step; its ending says what kind of picture: .png (`dpi` dots an inch), .svg or .pdf."""
    kind = path.suffix.lower().removeprefix(".")
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)  # equal pictures are equal bytes
    buffer = io.BytesIO()
    with figure_style():
        figure.savefig(buffer, format=kind, dpi=dpi, metadata=undated)
    write_atomically(path, buffer.getvalue())

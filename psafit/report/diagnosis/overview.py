"""Measured and simulated: the pictures of a diagnosis' groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from psafit.report import figures
from psafit.report.diagnosis.shown import Shown, image
from psafit.report.figures.groups import titled
from psafit.report.page import Picture, figure_data_uri
from psafit.report.wording import number, unit_text


def content(shown: Sequence[Shown], pictured: Sequence[Shown]) -> dict[str, Any]:
    """The first screen's picture, those of the `pictured` groups, and the curves of all groups to explore."""
    return {
        "summary": summary_picture(pictured),
        "explorable": explorable(shown),
        "overview": overview_pictures(pictured),
        "left_out": len(shown) - len(pictured),
        "zeros": any(figures.has_zeros(g.group, g.curves) for g in pictured),
    }


def summary_picture(pictured: Sequence[Shown]) -> Picture:
    """The picture of the first screen: the models' error in each group, and two groups as examples."""
    rows = factor_rows(pictured)
    with_errors = [g for g in pictured if g.errors]
    # The one in which the last model gains most, and of the others the one that it misses most.
    worst = sorted(with_errors, key=_by_gain)[:1] or list(pictured[:1])
    worst += sorted((g for g in with_errors if g is not worst[0]), key=lambda g: -g.errors[-1])[:1]
    examples = [figures.Example(titled(g.group.id), "ink", g.group, g.sweep, g.curves).magnified() for g in worst]
    legend = figures.handles([replace(c, bands=()) for c in pictured[0].curves])
    over = next((e.over for e in examples if e.over), "")
    return Picture(
        figure_data_uri(figures.summary_figure(rows if with_errors else [], examples, legend)),
        "Typical factor between model and reading: "
        + "; ".join(f"group {g.name} {g.text or 'readings alone'}" for g in pictured[:20])
        + ".",
        "Above, how far the fitted models are off in each group: ×1 would be perfect."
        f" Below, {_missed(worst) if with_errors and len(pictured) > 1 else f'group {worst[0].name}'}."
        + (f" Where the curves would lie on one another, all is shown against the {over}." if over else ""),
    )


def _by_gain(g: Shown) -> tuple[float, float]:
    """How much less the last model misses a group than the first, by all its readings; then how much that misses it."""
    first, last = (max(e, 1e-9) for e in (g.errors[0], g.errors[-1]))
    return g.group.n_points * math.log(last / first), -first


def _missed(worst: Sequence[Shown]) -> str:
    """Which groups `summary_picture` has chosen, and why."""
    first, *others = worst
    last, gained = first.curves[-1].name, len(first.curves) > 1
    text = f"group {first.name}, {f'in which the {last} gains most' if gained else f'which the {last} misses most'}"
    return text + "".join(
        f", and of the others the one that the {other.curves[-1].name} misses most, group {other.name}"
        if len(other.curves) > 1
        else f", and group {other.name}, which it misses most of the others"
        for other in others
    )


def factor_rows(shown: Sequence[Shown]) -> list[figures.Row]:
    """Each group's error by both models."""
    return [
        figures.Row(
            g.group.id,
            g.sweep.held,
            [
                figures.Mark(e, c.color, "s" if c.dashed else "o", hollow=c.dashed)
                for c, e in zip(g.curves, g.errors, strict=True)
            ],
        )
        for g in shown
    ]


def overview_pictures(shown: Sequence[Shown]) -> list[Picture]:
    """Measured against baseline and extension: small multiples, one image each so that they reflow."""
    pictures = []
    for g in shown:
        measured, o = g.group.reading, g.group.observable
        alt = (
            f"{o.title.capitalize()} against {g.sweep.over}, group {g.group.id}, {g.sweep.condition}:"
            f" measured {number(float(measured.min()))} to {number(float(measured.max()))} {unit_text(o.unit)};"
            f" {g.text}."
        )
        caption = f"{g.text[:1].upper()}{g.text[1:]}." if g.text else "Readings alone."
        pictures.append(Picture(image(figures.group_figure(g.group, g.sweep, g.curves), len(shown)), alt, caption))
    return pictures


def explorable(shown: Sequence[Shown]) -> list[dict[str, Any]]:
    """The curves of all groups as numbers for the page's script."""
    return [figures.explorable(g.title, g.group, g.sweep, g.curves, g.more) for g in shown]

"""Pages and their images."""

from __future__ import annotations

from pathlib import Path

import jinja2
import pytest

from psafit.report.page import figure_data_uri, render
from psafit.report.style import figure_style, new_figure


def test_a_failing_page_leaves_the_previous_one(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("before", "utf-8")
    with pytest.raises(jinja2.UndefinedError):
        render("reproduction.html.j2", page)
    assert page.read_text("utf-8") == "before"
    assert list(tmp_path.iterdir()) == [page]


def test_large_figures_become_bitmaps_and_equal_figures_equal_bytes() -> None:
    def drawn() -> str:
        with figure_style():
            figure, axes = new_figure()
            axes.plot([0, 1], [0, 1])
            return figure_data_uri(figure)

    assert drawn().startswith("data:image/svg+xml;base64,")
    assert drawn() == drawn()
    with figure_style():
        figure, axes = new_figure()
        axes.plot([0, 1], [0, 1])
        assert figure_data_uri(figure, svg_limit=100).startswith("data:image/png;base64,")

"""The page of two results side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from reader import HOSTILE, Reader
from sides import made

from psafit.compare import compare
from psafit.report.comparison import write_comparison


def test_hostile_names_are_escaped(tmp_path: Path) -> None:
    one, other = made(HOSTILE, 2.0), made(HOSTILE + "2", 1.1)
    for side in (one, other):
        side.predicted[1] = replace(side.predicted[1], group=replace(side.predicted[1].group, id=HOSTILE))
    page = Reader(write_comparison(one, other, compare(one, other), tmp_path / "c.html").read_text("utf-8"))
    assert page.foreign.lower().count("<script") == 1 and page.html.count("</style>") == 1
    assert page.all("script") == [{"type": "application/json"}, {}] and HOSTILE in page.text
    assert len(page.html) < 5e6

"""The page of two results side by side."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from reader import HOSTILE, Reader
from sides import made

from psafit.compare import compare
from psafit.report.comparison import what_differs, write_comparison


def test_hostile_names_are_escaped(tmp_path: Path) -> None:
    one, other = made(HOSTILE, 2.0), made(HOSTILE + "2", 1.1)
    for side in (one, other):
        side.predicted[1] = replace(side.predicted[1], group=replace(side.predicted[1].group, id=HOSTILE))
    page = Reader(write_comparison(one, other, compare(one, other), tmp_path / "c.html").read_text("utf-8"))
    assert page.foreign.lower().count("<script") == 1 and page.html.count("</style>") == 1
    assert page.all("script") == [{"type": "application/json"}, {}] and HOSTILE in page.text
    assert len(page.html) < 5e6


def test_an_interval_of_no_width_does_not_count_as_apart() -> None:
    """Of such intervals nothing says how much they share."""
    one, other = made("one", 1.0, spread=0.0), made("other", 2.0)
    found = compare(one, other)
    assert math.isnan(found.parameters[0].overlap or 0.0)
    assert "share less" not in what_differs(found) and "1 parameter in both" in what_differs(found)
    assert "share less" in what_differs(compare(made("one", 1.0), other))

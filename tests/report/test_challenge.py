"""The challenge page."""

from __future__ import annotations

import re
from pathlib import Path

from campaigns import result

from psafit.challenge.score import score
from psafit.report.challenge import draw, write_page


def test_the_page_holds_the_verdict(tmp_path: Path) -> None:
    results = [
        result(["a"], named=["a"], causes=[{"terms": ["a"], "probability": 0.9, "parameters": {}}]),
        result(["a"], named=["<b>"]),
        result(["a"], named=["$\\bad$"]),
        result([], verdict="adequate"),
        result([], outside="x", verdict="unexplained"),
    ]
    page = write_page(score(results), tmp_path / "score.html", {"Version": "0"}).read_text()
    assert "95 % interval" in page and "misses" in page and "&lt;b&gt;" in page and "<b>" not in page
    assert page.count("<img") == 3
    assert "://" not in re.sub(r'src="data:[^"]*"', "", page)
    empty = write_page(score([result([], verdict="adequate")]), tmp_path / "empty.html").read_text()
    assert "holds where asked" in empty and "1 of 9 targets could be asked, and held so far" in empty


def test_several_causes_are_counted_and_not_read_from_a_label() -> None:
    results = [result(["c"], named=["a", "b"]), result(["c"], named=["p + q"])]
    (axes,) = draw(score(results))["confusion"].axes
    said = [text.get_text() for text in axes.get_xticklabels()]
    assert "two causes" in said and any("p + q" in text for text in said)

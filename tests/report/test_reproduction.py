"""The reproduction page."""

from __future__ import annotations

import re
from pathlib import Path

from psafit.report.reproduction import claims_table, figures, write_reproduction
from psafit.reproduce import NOT_REPRODUCED, ONLY_WITH_STEP, REPRODUCED, Reproduction


def test_page_is_self_contained_and_says_what_was_found(result: Reproduction, tmp_path: Path) -> None:
    page = write_reproduction(result, tmp_path / "new" / "page.html", {"Version": "<1>"})
    text = page.read_text("utf-8")
    assert list(page.parent.iterdir()) == [page]  # nothing temporary is left
    for outside in ('src="http', 'href="http', "@import", "<script", "url("):
        assert outside not in text
    assert text.count('alt=""') == 0
    assert text.count("<img ") == len(figures(result)) == 8
    assert "partly a numerical artefact" in text
    assert "&lt;1&gt;" in text
    assert "gives back 20 of 24 published claims, 19 of them only with that step." in text
    assert "209.75 µm at 300 Hz, a little below the curve" in text
    assert "psafit diagnose" not in text and not re.search(r"\d um\b|0\.25 %", text)
    for verdict in (REPRODUCED, ONLY_WITH_STEP, NOT_REPRODUCED):
        assert verdict.replace("'", "&#39;") in text


def test_the_table_in_the_terminal_has_units_and_no_nan(result: Reproduction) -> None:
    first, *lines = claims_table(result).splitlines()
    assert "20 of 24 published claims" in first
    assert len(lines) == 25 and "nan" not in "".join(lines) and max(map(len, lines)) < 120
    assert any("95.50 µm  none: overflow" in line and line.endswith("no") for line in lines)
    end = lines[0].index("converged") + len("converged")
    assert all(line[end - 1] != " " and line[end : end + 2] == "  " for line in lines)

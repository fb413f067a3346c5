"""The page of two results side by side."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from fits_by_hand import mixed_groups
from reader import HOSTILE, Reader
from sides import made, made_of

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


def test_observables_of_a_group_are_no_groups(tmp_path: Path) -> None:
    """Each is compared with its own readings; the groups are counted, and what is left out is named."""
    groups = mixed_groups()
    one, other = made_of("one", 1.5, groups, "trace"), made_of("other", 1.2, groups, "trace")
    found = compare(one, other)
    assert found.judged == [1, 2] and [g.observable for g in found.groups[:3]] == [None, "launch_speed", "contact_time"]
    page = Reader(write_comparison(one, other, found, tmp_path / "c.html").read_text("utf-8"))
    assert "on 42 readings in 3 groups with the same readings." in page.first_screen
    assert "On groups 1 and 2, which neither has fitted" in page.first_screen
    assert "Group 2 (contact time) unseen" in page.text and "Contact time of group 2" in page.html
    drawn = json.loads(re.findall(r'<script type="application/json"[^>]*>(.*?)</script>', page.html, re.S)[0])
    assert (
        len({g["title"] for g in drawn}) == 7
        and drawn[1]["title"] == "Group 1: launch speed, sine, 20\N{NO-BREAK SPACE}V"
    )
    for g in drawn:
        assert g["curves"][1]["middle"] == pytest.approx([1.2 * y for y in g["measured"]], rel=1e-4)
    for gone, said in (("contact_time",), "group 2 (contact time)"), (None, "group 2"):
        part = [
            replace(t, group=replace(t.group, reading=t.group.reading + 1))
            if t.group.id == 2 and (gone is None or t.group.observable.name in gone) else t
            for t in other.predicted
        ]  # fmt: skip
        changed = replace(other, predicted=part)
        found = compare(one, changed)
        assert found.apart == [2]
        text = Reader(write_comparison(one, changed, found, tmp_path / "c.html").read_text("utf-8")).text
        assert f"with the same readings; without {said}." in text and f"Left out: {said}, which" in text


def test_an_interval_of_no_width_does_not_count_as_apart() -> None:
    """Of such intervals nothing says how much they share."""
    one, other = made("one", 1.0, spread=0.0), made("other", 2.0)
    found = compare(one, other)
    assert math.isnan(found.parameters[0].overlap or 0.0)
    assert "share less" not in what_differs(found) and "1 parameter in both" in what_differs(found)
    assert "share less" in what_differs(compare(made("one", 1.0), other))

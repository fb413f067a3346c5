"""How much the search finds where nothing is hidden."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from truths import CHEAP, FEW

from psafit.diagnose.significance import NULL_LEADS, NullLead, NullLeads, lead, looked_up, significance
from psafit.inference.memory import Memory
from psafit.model_search import SearchSettings
from psafit.physics import TERMS
from psafit.records import plain, read_json, write_json


@pytest.mark.slow
def test_the_search_finds_less_where_nothing_is_hidden(hidden, tmp_path):
    asked = {"seed": 1, "memory": Memory(tmp_path), "settings": CHEAP}
    found = significance(hidden, FEW, 2, **asked)
    assert found.lead == lead(hidden) > 3 > max(found.null)
    assert found.p_value == pytest.approx(1 / 3) and len(set(found.null)) == 2
    assert found == significance(hidden, FEW, 2, **asked)
    strong = replace(hidden, log_evidence={ids: (1e3 if ids == () else e) for ids, e in hidden.log_evidence.items()})
    assert significance(strong, FEW, 2, **asked).p_value == 1.0
    assert found.readings == [72, 72] and not found.stored


def test_a_search_is_compared_with_stored_ones_of_designs_that_are_not_larger(hidden, tmp_path):
    settings, file = SearchSettings(), tmp_path / "leads.json"
    leads = [NullLead(k, 60, n, 5, x) for k, (n, x) in enumerate([(58, -2.0), (60, -1.0), (72, 0.5), (300, 99.0)])]
    table = NullLeads("0", 1, [t.id for t in FEW[::-1]], settings, leads)
    write_json(file, table)
    found = looked_up(hidden, FEW, settings, file)
    assert found.stored and found.missing == "" and found.lead == lead(hidden)
    assert (found.null, found.readings, found.p_value) == ([-2.0, -1.0, 0.5], [58, 72], 0.25)
    # Another catalogue, another search, larger designs alone: it says so, and guesses nothing.
    other = replace(FEW[0], plugin="f" * 64)
    for missing, asked in (
        ("catalogue", (FEW[:2], settings, leads)),
        ("catalogue", ((other, *FEW[1:]), settings, leads)),
        ("settings", (FEW, replace(settings, window=3.0), leads)),
        ("readings", (FEW, settings, leads[3:])),
    ):
        catalogue, searched, rows = asked
        write_json(file, replace(table, leads=rows))
        found = looked_up(hidden, catalogue, searched, file)
        assert (found.missing, found.p_value, found.null) == (missing, None, [])


def test_the_stored_table_is_of_this_catalogue_and_this_search():
    """Where this fails, causes or the search have changed: make null-leads ARGS=--anew."""
    table = read_json(NULL_LEADS, NullLeads)
    settings = json.loads(NULL_LEADS.read_text("utf-8"))["settings"]  # as stored: a field that it lacks has no default
    assert table.catalogue == [t.id for t in TERMS] and settings == plain(SearchSettings())
    sizes = {one.asked for one in table.leads}
    assert len(sizes) == 3 and all(sum(one.asked == n for one in table.leads) >= 5 for n in sizes)
    assert len({(one.asked, one.seed) for one in table.leads}) == len(table.leads)

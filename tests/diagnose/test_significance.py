"""How much the search finds where nothing is hidden."""

from __future__ import annotations

from dataclasses import replace

import pytest
from truths import FEW

from psafit.diagnose.significance import lead, significance
from psafit.inference.memory import Memory


@pytest.mark.slow
def test_the_search_finds_less_where_nothing_is_hidden(hidden, tmp_path):
    memory = Memory(tmp_path)
    found = significance(hidden, FEW, 3, seed=1, memory=memory)
    assert found.lead == lead(hidden) > 3 > max(found.null)
    assert found.p_value == 0.25
    assert found == significance(hidden, FEW, 3, seed=1, memory=memory)
    strong = replace(hidden, log_evidence={ids: (1e3 if ids == () else e) for ids, e in hidden.log_evidence.items()})
    assert significance(strong, FEW, 3, seed=1, memory=memory).p_value == 1.0

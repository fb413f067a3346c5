"""What a diagnosis leaves behind."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnoses_by_hand import make_experiment, make_record

from psafit.diagnose.settings import Settings
from psafit.model_search import SearchSettings
from psafit.model_search.ladder import LookedAt


@pytest.mark.parametrize(
    ("looked_at", "told"),
    [
        (LookedAt(1, 0, 0.0), "1 set of causes was fitted on all readings and sampled."),
        (LookedAt(3, 0, 0.0), "3 sets of causes were fitted on all readings, all of them sampled."),
        (
            LookedAt(25, 1, 0.062),
            "25 sets of causes were fitted on all readings, 24 of them sampled; the other has 6.2 % of the"
            " probability.",
        ),
        (
            LookedAt(1640, 1627, 1e-5),
            "1,640 sets of causes were fitted on all readings, 13 of them sampled; the others have less than 0.1 % of"
            " the probability together.",
        ),
    ],
)
def test_how_many_sets_were_looked_at_is_said(looked_at: LookedAt, told: str) -> None:
    settings = Settings(search=SearchSettings(missed=0.03))
    found = replace(make_record(make_experiment()), looked_at=looked_at, settings=settings).searched
    assert found == f"{told} The chance that a better set was missed is 3 %, a part of every probability."

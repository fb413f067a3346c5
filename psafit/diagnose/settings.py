"""How much work a diagnosis puts into each of its parts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from psafit.inference.laws import LawSettings
from psafit.model_search import SearchSettings


@dataclass(frozen=True)
class Settings:
    """Options of `psafit.diagnose.diagnose`; they belong to the identity of a result.

    Parameters
    ----------
    search : SearchSettings
        How far the search among causes looks.
    simulated : int
        Data sets drawn from a fitted model to calibrate the tests of misfit: the least p value is one over one more.
    draws : int
        Posterior draws behind each predictive interval: of `predictions-diagnosis.csv`, and of the measured gain.
    rehearsed : int
        Tied models, the most probable first, with which a proposed measurement is simulated. A quick diagnosis takes
        two: draws of a model that was not sampled yet are expensive.
    searches : int
        Searches repeated on simulated baselines; 19 allow a p value of one in twenty. At 0 the stored table of such
        searches is looked up (`psafit.diagnose.significance`).
    steps : int
        Steps at which a chain for an adopted extension gives up, if its own rule is not met before; none is drawn at
        0. A chain that needs more is continued by the same command.
    laws : LawSettings
        When a law that holds whatever the causes are counts as broken.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    simulated: int = 499
    draws: int = 400
    rehearsed: int = 4
    searches: int = 0
    steps: int = 40_000
    laws: LawSettings = field(default_factory=LawSettings)

    @classmethod
    def usual(cls, quick: bool) -> Settings:
        """Return the defaults; a quick diagnosis simulates fewer data sets and rehearses with fewer models."""
        return replace(cls(), simulated=199, rehearsed=2) if quick else cls()

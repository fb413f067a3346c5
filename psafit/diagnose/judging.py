"""From a search to a verdict, wherever one is asked for: the tests, what is left, the laws, and what follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from psafit.diagnose.discrepancy import Discrepancy, discrepancy, stretch
from psafit.diagnose.laws import broken
from psafit.diagnose.misfit import Misfit, examine
from psafit.diagnose.settings import Settings
from psafit.diagnose.verdict import Verdict, conclude
from psafit.inference.candidate import Candidate
from psafit.model_search import Ladder
from psafit.physics.term import Term


@dataclass(frozen=True, eq=False)
class Judgement:
    """A verdict and what it rests on.

    Parameters
    ----------
    ladder : Ladder
        What the search has found.
    before, after : Misfit
        Of the baseline, and of the leader where that is another model.
    left, bare : Discrepancy
        Discrepancies beside the leader, and beside the baseline.
    verdict : Verdict
    """

    ladder: Ladder
    before: Misfit
    after: Misfit | None
    left: Discrepancy
    bare: Discrepancy
    verdict: Verdict

    @property
    def adopted(self) -> Candidate:
        """The model that the verdict adopts: where nothing is wrong the baseline, whatever leads."""
        return self.ladder.baseline if self.verdict.verdict == "adequate" else self.ladder.leader


def judge(ladder: Ladder, catalogue: Sequence[Term], settings: Settings, *, seed: int) -> Judgement:
    """Judge what a search has found."""
    leader, n = ladder.leader, settings.simulated
    before = examine(ladder.baseline, catalogue, seed=seed, n_simulated=n)
    after = examine(leader, catalogue, seed=seed, n_simulated=n) if leader.terms else None
    # Also of a baseline in which the tests find nothing: a large scatter may hide what is smooth.
    left = discrepancy(leader)
    bare = discrepancy(ladder.baseline, stretch(leader)) if leader.terms else left
    verdict = conclude(ladder, before, after, left, bare, broken(leader, settings.laws))
    return Judgement(ladder, before, after, left, bare, verdict)

"""From a search to a verdict, wherever one is asked for: the tests, what is left, the laws, and what follows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from psafit.diagnose.discrepancy import Discrepancy, discrepancy, stretch
from psafit.diagnose.misfit import Misfit, examine
from psafit.diagnose.settings import Settings
from psafit.diagnose.verdict import Verdict, conclude
from psafit.inference.candidate import Candidate
from psafit.inference.laws import broken
from psafit.model_search import ModelSet
from psafit.physics.term import Term


@dataclass(frozen=True, eq=False)
class Judgement:
    """A verdict and what it rests on.

    Parameters
    ----------
    model_set : ModelSet
        What the search has found.
    before, after : Misfit
        Of the baseline, and of the best model where that is another model.
    left, bare : Discrepancy
        Discrepancies added to the best model, and to the baseline.
    verdict : Verdict
    """

    model_set: ModelSet
    before: Misfit
    after: Misfit | None
    left: Discrepancy
    bare: Discrepancy
    verdict: Verdict

    @property
    def adopted(self) -> Candidate:
        """The model that the verdict adopts: where nothing is wrong the baseline, whatever leads."""
        return self.model_set.baseline if self.verdict.verdict == "adequate" else self.model_set.best_model


def judge(model_set: ModelSet, catalogue: Sequence[Term], settings: Settings, *, seed: int) -> Judgement:
    """Judge what a search has found."""
    best_model, n = model_set.best_model, settings.simulated
    before = examine(model_set.baseline, catalogue, seed=seed, n_simulated=n)
    after = examine(best_model, catalogue, seed=seed, n_simulated=n) if best_model.terms else None
    # Also of a baseline in which the tests find nothing: a large scatter may hide what is smooth.
    left = discrepancy(best_model)
    bare = discrepancy(model_set.baseline, stretch(best_model)) if best_model.terms else left
    laws, problem = broken(best_model, settings.laws), best_model.problem
    (medians,) = model_set.quantiles(best_model.ids, (0.5,))
    strange = [name for name in problem.implausible(medians) if name in problem.names[: problem.n_physical]]
    verdict = conclude(model_set, before, after, left, bare, laws, strange)
    return Judgement(model_set, before, after, left, bare, verdict)

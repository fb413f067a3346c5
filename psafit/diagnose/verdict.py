"""From the model set, the tests and the discrepancy to a verdict, as "Verdicts" in docs/diagnosis.md defines them.

Probabilities are those of `psafit.model_search.model_set`: a set stands for its supersets where these add nothing
visible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from psafit.diagnose.discrepancy import Discrepancy
from psafit.diagnose.misfit import Misfit
from psafit.diagnose.trials import VerdictWord, Why
from psafit.model_search import Ids, ModelSet
from psafit.model_search.model_set import CREDIBLE
from psafit.records import Broken


@dataclass(frozen=True)
class Verdict:
    """What the diagnosis concludes.

    Parameters
    ----------
    verdict : {"adequate", "explained", "ambiguous", "unexplained"}
    named : tuple of str
        The causes adopted; first the one without which the best model loses most.
    alternatives : tuple of tuples of str
        Sets that do as well: those needed for 95 % of the probability, and those that fit as well.
    probability : dict
        Of each model fitted; what is missing to one is a discrepancy, or of sets that the search may have missed.
    unnamed : float
        Probability of a discrepancy without a name, added to what has one or in its place.
    inclusion : dict
        Probability of each cause to be part of the truth, given that the catalogue holds it; a set that the search may
        have missed counts for none.
    by_likelihood : tuple of tuples of str
        Alternatives that fit as well and are not needed: what is plausible beforehand alone holds them back.
    unexplained_by : {"", "structure", "smooth", "law", "values"}
        Why the named set does not explain the readings: structure remains, a smooth curve in its place is more
        probable, it breaks a law, or its values are implausible. An ambiguous verdict has one of the last two, too.
    """

    verdict: VerdictWord
    named: Ids
    alternatives: tuple[Ids, ...]
    probability: dict[Ids, float]
    unnamed: float
    inclusion: dict[str, float]
    unexplained_by: Why = ""
    by_likelihood: tuple[Ids, ...] = ()

    @property
    def structured(self) -> bool:
        """Whether something is left of the readings that no cause explains."""
        return self.verdict == "unexplained" and self.unexplained_by not in ("law", "values")


def conclude(
    model_set: ModelSet,
    before: Misfit,
    after: Misfit | None,
    left: Discrepancy,
    bare: Discrepancy,
    laws: Sequence[Broken] = (),
    strange: Sequence[str] = (),
    prior_unnamed: float = 0.1,
) -> Verdict:
    """Draw the conclusion.

    Parameters
    ----------
    model_set : ModelSet
    before : Misfit
        Of the baseline.
    after : Misfit, optional
        Of the best model, where that is not the baseline.
    left, bare : Discrepancy
        Of the best model, and of the baseline.
    laws : sequence of Broken
        Laws that the best model breaks.
    strange : sequence of str
        Parameters of the best model whose values are implausible, the scatter's aside.
    prior_unnamed : float
        Prior probability of a discrepancy added to any model.
    """
    added, instead = _odds(model_set, left, bare, prior_unnamed)
    judged = after or before
    if not judged.sound:  # what the tests find need not be smooth
        added = max(added, prior_unnamed / (1 - prior_unnamed) * odds_against(judged.least))
    unnamed = (added + instead) / (1 + added + instead)
    probability = {ids: p * (1 - unnamed) for ids, p in model_set.share.items()}
    inclusion: dict[str, float] = {}
    # Given that the catalogue holds the truth: a discrepancy takes nothing from one cause against another.
    for ids, p in model_set.share.items():
        for id in ids:
            inclusion[id] = inclusion.get(id, 0.0) + p
    nothing, mostly_unnamed = model_set.probability[()], unnamed > 0.5
    best = model_set.best_model.ids
    if before.sound and not mostly_unnamed and (nothing >= 1 - CREDIBLE or not best):
        return Verdict("adequate", (), (), probability, unnamed, inclusion)
    if not best:  # something is wrong, and no cause helps
        return Verdict("unexplained", (), (), probability, unnamed, inclusion)
    alternatives, named = model_set.rivals(best), _best_first(best, model_set)
    likely = tuple(ids for ids in alternatives if ids not in model_set.needed(best))
    residual = after is not None and not after.sound
    if residual or mostly_unnamed:
        why: Why = "structure" if residual or added > instead else "smooth"
        return Verdict("unexplained", named, alternatives, probability, unnamed, inclusion, why, likely)
    why = "law" if laws else "values" if strange else ""
    if alternatives:
        return Verdict("ambiguous", named, alternatives, probability, unnamed, inclusion, why, likely)
    return Verdict("unexplained" if why else "explained", named, (), probability, unnamed, inclusion, why)


def odds_against(p_value: float) -> float:
    """Odds against a hypothesis that a p value stands for at most: ``-1/(e p ln p)``, below ``1/e``.

    (T. Sellke, M. J. Bayarri and J. O. Berger, Am. Stat. 55 (2001) 62.)
    """
    return -1.0 / (math.e * p_value * math.log(p_value))


def _odds(model_set: ModelSet, left: Discrepancy, bare: Discrepancy, probability: float) -> tuple[float, float]:
    """Odds of a discrepancy without a name, added to the causes and in their place, as a part of each model's prior.

    For all models but the baseline the evidence of it, added to the best model, stands for all.
    """
    prior, best = probability / (1 - probability), model_set.best_model.ids
    if not best:
        return prior * math.exp(min(left.log_bayes, 700.0)), 0.0
    # Larger sets are counted with the best model where they do not show, but its prior is its own.
    own = model_set.at_work[best]
    ratio = (
        bare.log_evidence - (left.log_evidence - left.log_bayes) + model_set.log_prior(()) - model_set.log_prior(best)
    )
    added = (1 - model_set.probability[()]) * math.exp(min(left.log_bayes, 700.0))
    return prior * added, prior * own * math.exp(min(ratio, 700.0))


def _best_first(named: Ids, model_set: ModelSet) -> Ids:
    """Causes by what is lost without them: by the standing of the best model fitted that does not have them."""
    return tuple(sorted(named, key=lambda id: model_set.standing[model_set.without(id)]))

"""Whether a gain belongs to the causes: not to one odd group, nor to whatever bends smoothly."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from psafit.diagnose.discrepancy import Discrepancy
from psafit.experiment import GroupId
from psafit.inference.candidate import Candidate, refitted


@dataclass(frozen=True)
class Robustness:
    """Where the best model's gain over the baseline comes from, and what would gain as much.

    Parameters
    ----------
    groups : list of (group id, float)
        Gain of log likelihood in each group, nats; both models as fitted to all.
    strongest : group id, optional
        The group that gives most; None where there is only one.
    without : float, optional
        Gain on the other groups, both models fitted to them alone.
    over_smooth : float
        Evidence, nats, of the best model over that of a smooth discrepancy without a name added to the baseline: a
        richer law of the scatter, whose errors along a sweep and within a session are correlated.
    """

    groups: list[tuple[GroupId, float]]
    strongest: GroupId | None
    without: float | None
    over_smooth: float

    @property
    def of_one_group(self) -> bool:
        """Whether one group gives four fifths of what all gain together."""
        return len(self.groups) > 1 and max(g for _, g in self.groups) > 0.8 * sum(g for _, g in self.groups)


def robustness(baseline: Candidate, best_model: Candidate, bare: Discrepancy, left: Discrepancy) -> Robustness:
    """Ask what a gain rests on.

    Parameters
    ----------
    baseline, best_model : Candidate
        Of the same readings.
    bare, left : Discrepancy
        Discrepancies added to them.
    """
    problem = best_model.problem
    change = np.subtract(*(c.problem.pointwise_log_likelihood(c.modes[:1])[0] for c in (best_model, baseline)))
    ids = problem.group_ids
    groups = [(id, float(change[problem.design.group == k].sum())) for k, id in enumerate(ids)]
    strongest, without = None, None
    if len(ids) > 1:
        strongest = max(groups, key=lambda item: item[1])[0]
        others = tuple(id for id in ids if id != strongest)
        with_it, plain = (refitted(replace(c.problem, group_ids=others), c) for c in (best_model, baseline))
        without = with_it.log_likelihood - plain.log_likelihood
    return Robustness(groups, strongest, without, left.log_evidence - left.log_bayes - bare.log_evidence)

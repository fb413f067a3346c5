"""Which of the reported causes a look at the rig itself settles, without launches."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from scipy.special import entr

from psafit.diagnose.record.models import CauseResult, Look
from psafit.diagnose.verdict import Verdict
from psafit.physics.term import Term


def looks(causes: Sequence[CauseResult], verdict: Verdict, catalogue: Iterable[Term]) -> list[Look]:
    """What to look at: first what separates reported sets, and among these what is least certain.

    A look that shows whether a cause is at work is worth the entropy of its probability.

    Parameters
    ----------
    causes : sequence of CauseResult
        Models with their parameters; the named set first.
    verdict : Verdict
    catalogue : iterable of Term
        Causes that were looked for.

    Returns
    -------
    list of Look
        Of causes that are reported and can be looked at.
    """
    if verdict.verdict == "adequate":
        return []
    reported = [set(verdict.named), *map(set, verdict.alternatives)]
    found = []
    for term in catalogue:
        model = next((c for c in causes if term.id in c.terms and set(c.terms) in reported), None)
        if not (term.look and model):
            continue
        own = {p.name: model.parameters[p.name] for p in term.parameters}
        separates = not all(term.id in ids for ids in reported)
        found.append(Look(term.id, term.look, verdict.inclusion.get(term.id, 0.0), separates, own))
    return sorted(found, key=lambda s: (not s.separates, -_worth(s.probability)))


def _worth(p: float) -> float:
    """What it is worth to know whether something of probability `p` is so, nats."""
    return float(entr(p) + entr(1.0 - p))

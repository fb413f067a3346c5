r"""Causes that this design could hardly distinguish from those of a model.

Around the model's fit, a little of another cause moves the ranges by :math:`e`. Of that, what is fitted can imitate a
part. With :math:`P` the projection on what it cannot, and :math:`P_c` the same where the parameters of one cause `c` of
the model have no part in the imitation,

.. math:: \sin\alpha = \frac{\lVert P e\rVert}{\lVert P_c e\rVert}

is the sine of the angle between the two causes: where it is small, `c` does what the other cause would do, and readings
of these conditions that one of them made are explained by either. (Linear, about one fit: what refits on each other's
readings say is in `psafit.diagnose.rehearsal`.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from psafit.diagnose.screening import extended
from psafit.inference.candidate import Candidate
from psafit.model_search.visibility import VISIBLE
from psafit.physics.term import Term
from psafit.simulate.sensitivity import plausible


@dataclass(frozen=True)
class Confounded:
    """A cause of the model, another one that looks like it, and the angle between them (degrees)."""

    cause: str
    other: str
    degrees: float


def confusable(
    model: Candidate, catalogue: Sequence[Term], *, near: float = 15.0, halvings: int = 11, little: float = 1.0
) -> list[Confounded]:
    """Pairs of a model's causes and others that look like them, the nearest first.

    Of others, those of which a plausible strength could be seen if that cause of the model did not imitate it.

    Parameters
    ----------
    model : Candidate
    catalogue : sequence of Term
    near : float, degrees
        Angle below which two causes are reported.
    halvings : int
        How often a plausible strength is halved.
    little : float
        The largest part that moves no reading by more than so many standard deviations is a little of the cause: more
        of it may bend, where what is fitted is a tangent.
    """
    found, parts = [], 0.5 ** np.arange(1 + halvings)
    for other in catalogue:
        if other in model.terms or other.latent or not model.terms:
            continue
        larger = extended(model.problem, other, catalogue)
        at = np.repeat(model.within(larger)[0][None], len(parts), axis=0)
        for p, value in zip(other.parameters, plausible(other), strict=True):
            rows = value if p.neutral is None else p.neutral + parts * (value - p.neutral)
            at[:, larger.names.index(p.name)] = p.to_sampling(rows)
        effect = larger.predict(at) - model.predicted
        small = effect[int(np.argmax(np.abs(effect / model.scatter).max(axis=1) <= little))]
        left = float(np.linalg.norm(model.project_out(small[None])))
        for cause in model.terms:
            both = np.linalg.norm(model.project_out(np.stack([effect[0], small]), without=cause), axis=1)
            if both[0] < VISIBLE or both[1] == 0.0:
                continue
            degrees = float(np.degrees(np.arcsin(min(left / both[1], 1.0))))
            if degrees < near:
                found.append(Confounded(cause.id, other.id, degrees))
    return sorted(found, key=lambda a: a.degrees)

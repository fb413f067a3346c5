"""Higher tops next to those that optimisations have found, by draws around them.

A contact that ends a half wave later makes a range jump. A rig's posterior may have hundreds of such edges, at which
optimisations stop. So around each top some points are drawn from a Student density somewhat wider than its curvature
says, the best of them is optimised, and from a higher top that follows it begins again (basin hopping: D. J. Wales and
J. P. K. Doye, J. Phys. Chem. A 101 (1997) 5111). Where the posterior is smooth, the draws lead back to where they come
from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference.candidate import Candidate, FitSettings, candidate_at
from psafit.inference.evidence import laplace_mixture
from psafit.inference.optimiser import Effort, maximise


def hopped(
    found: Candidate,
    *,
    seed: int,
    better: float = 0.5,
    n_modes: int = 4,
    n_draws: int = 64,
    most: int = 12,
    iterations: int = 36,
) -> Candidate:
    """Look for higher tops next to the modes of a model; the candidate holds them, too.

    Parameters
    ----------
    found : Candidate
    seed : int
    better : float, nats
        A rise that is worth another hop.
    n_modes : int
        So many of the highest hop, each by itself: the one that leads before need not lead after. Where one of them
        rises, the others hop, too: ranges jump, and an optimisation may have stopped tens of nats below its top.
    n_draws : int
        About each.
    most : int
        Hops of one mode.
    iterations : int
        Of an optimisation, at most.

    Returns
    -------
    Candidate
        No start counts for the modes that hops led to; the sets that they simulated count.
    """
    problem, rng = found.problem, np.random.default_rng([seed, 9])
    tops, others, n_sets = found.modes[:n_modes], found.modes[n_modes:], 0
    higher: list[FloatArray] = []
    for _ in range(most):
        here = [candidate_at(problem, top[None]) for top in tops]
        draws = np.array([np.clip(laplace_mixture(top).draw(n_draws, rng), *problem.bounds.T) for top in here])
        value = problem.log_posterior(draws.reshape(-1, problem.n_dim)).reshape(len(here), -1)
        best = np.argmax(np.where(np.isfinite(value), value, -np.inf), axis=1)
        begun, schedule = draws[np.arange(len(here)), best], ((iterations, len(here)),)
        end = maximise(problem, begun, schedule=schedule, still_below=FitSettings.enough)
        n_sets += n_draws * len(tops) + end.effort.n_sets
        risen = end.log_posterior > np.array([top.log_posterior for top in here]) + better
        if not risen.any():
            break
        higher.append(end.u[risen])
        tops, others = np.vstack([end.u[risen], others]), others[:0]
    effort = found.effort + Effort(n_sets=n_sets)
    if not higher:
        return replace(found, effort=effort)
    modes = np.vstack([found.modes, *higher])
    return candidate_at(problem, modes, np.pad(found.starts, (0, len(modes) - len(found.modes))), effort)

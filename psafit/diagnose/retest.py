"""Tests a fit's model on all the readings that there are.

What a model lacks may show neither in the group that was fitted nor in the bands about the others: one parameter takes
it up here, the scatter there. All groups together leave less room.
"""

from __future__ import annotations

from dataclasses import replace

from psafit.diagnose.misfit import examine
from psafit.inference.candidate import candidate_at, fit
from psafit.inference.run_folder import Run
from psafit.physics import TERMS
from psafit.records import Retested


def retest(run: Run, *, n_simulated: int = 199) -> Retested:
    """Fit a run's model to all groups of its experiment, and test it as a diagnosis does.

    Parameters
    ----------
    run : Run
    n_simulated : int
        Data sets simulated from that fit.
    """
    problem = run.problem
    known = candidate_at(problem, problem.to_sampling(run.best)[None])
    whole = fit(replace(problem, group_ids=problem.experiment.ids), [known], seed=run.fit.seed)
    found = examine(whole, TERMS, seed=run.fit.seed, n_simulated=n_simulated, influence=False)
    return Retested(found.objection, found.least, n_simulated)

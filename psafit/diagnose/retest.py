"""Tests a fit's model on all the readings that there are.

What a model lacks may show neither in the group that was fitted nor in the bands about the others: one parameter takes
it up here, the scatter there. All groups together leave less room.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from psafit.diagnose.misfit import examine
from psafit.errors import ConvergenceError, InputError
from psafit.inference.candidate import candidate_at, fit
from psafit.inference.run_folder import Run
from psafit.physics import TERMS
from psafit.records import Retested, Validation, read_json


def retest(run: Run, *, n_simulated: int = 199, most_readings: int = 5_000) -> Retested | None:
    """Fit a run's model to all groups of its experiment, and test it as a diagnosis does.

    Parameters
    ----------
    run : Run
    n_simulated : int
        Data sets simulated from that fit; more where it is open what they say, as of `examine`.
    most_readings : int
        Samples of traces among them; with more, as many data sets take minutes and gigabytes.

    Returns
    -------
    Retested or None
        None where the model cannot be tested: with too many readings or no more than parameters, without scatter, or
        where the fit fails.
    """
    whole = replace(run.problem, group_ids=run.problem.experiment.ids)
    if whole.observed.size > most_readings:
        return None
    own = whole.ids
    catalogue = replace(whole, terms=(*whole.terms, *(t for t in TERMS if t.id not in own))).terms
    try:
        known = candidate_at(run.problem, run.problem.to_sampling(run.best)[None])
        fitted = fit(whole, [known], seed=run.fit.seed)
        found = examine(fitted, catalogue, seed=run.fit.seed, n_simulated=n_simulated, influence=False)
    except (ConvergenceError, np.linalg.LinAlgError):
        return None
    return Retested(found.objection, found.least, found.n_simulated) if found.least < 1.0 else None


def kept(run: Run) -> Retested | None:
    """Return the test that is on record for a run; None where there is none."""
    try:
        record = read_json(run.folder / "validation.json", Validation)
    except InputError:
        return None
    return record.all_groups if record.identity == run.fit.identity else None


def once(run: Run) -> Retested | None:
    """Return the test that is on record for a run, or make it."""
    return kept(run) or retest(run)

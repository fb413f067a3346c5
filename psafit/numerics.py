r"""Whether the predictions of a fit are converged, and what a fixed-step integrator would have needed.

For a fitted model the predictions are repeated with a tolerance tightened by decades. The closed form has no step to
refine: there the stepper, which shares no formula with it, is refined towards it. In addition, the largest stable step
of the classical Runge-Kutta method at the fitted parameters: where it lies below the step that a simulation of such a
drive commonly takes, its result would be an artefact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psafit.arrays import FloatArray
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.inference.run_folder import Run
from psafit.records import Numerics, Refinement, write_json
from psafit.simulate import rig_of, simulate
from psafit.simulate.stability import contact_matrix_of, largest_stable_step, rk4_growth
from psafit.simulate.stepper import TOLERANCE


def audit(run: Run, *, n_draws: int = 8) -> Numerics:
    """Refine the predictions of a fit, at its best minimum and some posterior draws, over all of its experiment.

    Parameters
    ----------
    run : Run
    n_draws : int
        Posterior draws in addition to the best minimum, evenly spread over the chains.

    Returns
    -------
    Numerics
        Also written to the run's folder as `numerics.json`.
    """
    flat = run.draws.flat
    values = np.vstack([run.best, flat[np.linspace(0, len(flat) - 1, min(n_draws, len(flat))).astype(int)]])
    result = refine(run.problem, run.problem.to_sampling(values), run.fit.identity)
    write_json(run.folder / "numerics.json", result)
    return result


def refine(
    problem: Problem,
    u: FloatArray,
    identity: str,
    *,
    required: float = 1e-5,
    of_scatter: float = 1e-3,
    tolerances: Sequence[float] = (1e-2, 1e-3, 1e-4, TOLERANCE, 1e-6, 1e-7),
    finest: float = 1e-10,
    least_m: float = 1e-9,
    common_step: float = 1e-6,
) -> Numerics:
    """Refine the predictions of any fit over all of its experiment.

    Parameters
    ----------
    problem : Problem
    u : (n_sets, n_dim) array
        Sampling coordinates, the best fit first.
    identity : str
        Of the result they belong to.
    required, of_scatter : float
        Relative error that converged predictions may have, and the same as a part of the fitted relative scatter; the
        larger counts. At the defaults neither a reading nor a sum over some hundred of them shows it.
    tolerances : sequence of float
        Of the stepper, that are compared; the problem's own is among them.
    finest : float
        Of the run that stands for the truth of a model without closed form. Its own error is a hundredth of that of the
        finest of the others, or less.
    least_m : float, m
        Ranges below this are not distinguished from zero by any reading; their relative error says nothing.
    common_step : float, s
        The fixed step that many would take, a round microsecond as in the study.
    """
    experiment, terms = problem.experiment, problem.terms
    theta = problem.theta(u, experiment.occasions)
    design = problem.design_of(experiment.ids)
    found = simulate(design, theta, terms)
    exact = found.engine == "closed form"

    def ranges(tolerance: float) -> FloatArray:
        return simulate(design, theta, terms, path="stepper", tolerance=tolerance).launch_range

    reference = found.launch_range if exact else ranges(finest)
    refinement = []
    for tolerance in sorted({*tolerances, problem.tolerance}, reverse=True):
        error = np.abs(ranges(tolerance) - reference) / np.maximum(np.abs(reference), least_m)
        refinement.append(Refinement(tolerance, float(error.max()), float(np.median(error))))
    used = 0.0 if exact else next(r.worst for r in refinement if r.tolerance == problem.tolerance)
    reached = refinement[-1].worst if exact else used
    allowed = max(required, of_scatter * float(noise.columns(problem.noise_values(u[:1]))[0].min()))

    rigs = [rig_of(c, theta[:1], terms, design.counts) for c in design.rigs]
    eigenvalues = np.concatenate([np.linalg.eigvals(contact_matrix_of(rig)) for rig in rigs]).astype(complex)
    step = largest_stable_step(eigenvalues)
    growth = float(rk4_growth(eigenvalues, common_step).max())
    return Numerics(
        identity=identity,
        engine=found.engine,
        tolerance=None if exact else problem.tolerance,
        n_sets=len(theta),
        n_points=design.n_points,
        refinement=refinement,
        error=reached,
        required=allowed,
        converged=reached <= allowed,
        fastest_rate=float(np.abs(eigenvalues).max()),
        stable_step=float(step),
        common_step=common_step,
        common_growth=growth,
    )

"""The top of a posterior whose readings jump, by differential evolution.

A contact that ends a half wave later makes a range jump, so that a hardly damped rig's posterior is cut by cliffs.
Climbs stop at them; a population steps across (R. Storn and K. Price, J. Global Optim. 11 (1997) 341). It costs more
than climbs and finds one top alone: it comes after them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import differential_evolution

from psafit.arrays import FloatArray
from psafit.inference.ascent import Ascent, Effort, ascend
from psafit.inference.problem import Problem

# Causes up to which a population looks: with more it takes up to a minute a model, and none of the study's rose by it.
_SIMPLE = 2
# Members, a part of which are draws of the prior; the others lie about what is known, this far from it (a factor of e,
# or a prior's standard deviation, is one).
_MEMBERS, _DRAWN, _ABOUT = 60, 30, 0.1
# Generations at most, and spread of the members' heights (nats) at which the rest is a climb's.
_GENERATIONS, _GATHERED = 150, 0.5
# Factor on differences, drawn anew for each generation, and share of coordinates taken from a mutant: much of both,
# since coordinates that hold each other in place must move together.
_FACTOR, _CROSSED = (0.3, 0.9), 0.9
# Height of what cannot be evaluated.
_NOWHERE = -1e12


def evolved(problem: Problem, known: FloatArray, *, seed: int) -> Ascent:
    """Look for a higher top than climbs have found.

    Parameters
    ----------
    problem : Problem
    known : (n, n_dim) array
        Optima that climbs have found, in sampling coordinates.
    seed : int

    Returns
    -------
    Ascent
        The climb from the best member, no start, the population's sets counted; nothing, of a model with more than two
        causes.
    """
    if not len(known) or len(problem.terms) > _SIMPLE:
        return ascend(problem, np.empty((0, problem.n_dim)))
    rng = np.random.default_rng(seed)
    low, high = problem.bounds.T
    drawn = problem.prior_transform(rng.uniform(size=(_DRAWN, problem.n_dim)))
    parents = known[rng.integers(len(known), size=_MEMBERS - _DRAWN)]
    about = parents + _ABOUT * rng.standard_normal(parents.shape)

    def depth(columns: FloatArray) -> FloatArray:
        height = problem.log_posterior(np.clip(columns.T, low, high))
        return np.asarray(-np.where(np.isfinite(height), height, _NOWHERE))

    try:
        found = differential_evolution(
            depth,
            problem.bounds,
            init=np.clip(np.vstack([drawn, about]), low, high),
            strategy="best1bin",
            mutation=_FACTOR,
            recombination=_CROSSED,
            maxiter=_GENERATIONS,
            tol=0.0,
            atol=_GATHERED,
            updating="deferred",
            vectorized=True,
            polish=False,
            rng=np.random.default_rng(seed),
        )
    except RuntimeError as error:
        if error.__cause__ is None:
            raise
        raise error.__cause__ from None  # SciPy blames itself for what the model has raised
    end = ascend(problem, found.x[None]).uncounted
    return replace(end, effort=end.effort + Effort(n_sets=_MEMBERS * found.nfev))

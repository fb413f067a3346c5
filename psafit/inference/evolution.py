"""The top of a posterior whose readings jump, by differential evolution.

A contact that ends a half wave later makes a range jump, so that a hardly damped rig's posterior has discontinuities.
Optimisations stop at them; a population steps across (R. Storn and K. Price, J. Global Optim. 11 (1997) 341). It costs
more than optimisations and finds one top alone: it comes after them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import differential_evolution

from psafit.arrays import FloatArray
from psafit.inference.optimiser import Effort, Optima, maximise
from psafit.inference.problem import Problem


@dataclass(frozen=True)
class EvolutionSettings:
    """How a population looks.

    Parameters
    ----------
    most_causes : int
        Causes up to which it does: with more it takes up to a minute a model, and none of the study's rose by it.
    members, drawn : int
        Members, of which `drawn` are draws of the prior; the others lie about what is known.
    about : float
        How far about it: a factor of e, or a prior's standard deviation, is one.
    generations : int
        At most.
    gathered : float, nats
        Spread of the members' log posteriors at which the rest is an optimisation's.
    factor : tuple of float
        Range of the factor on differences, drawn anew for each generation.
    crossed : float
        Share of coordinates taken from a mutant: much, since coordinates that hold each other in place must move
        together.
    nowhere : float
        Height of what cannot be evaluated.
    """

    most_causes: int = 2
    members: int = 60
    drawn: int = 30
    about: float = 0.1
    generations: int = 150
    gathered: float = 0.5
    factor: tuple[float, float] = (0.3, 0.9)
    crossed: float = 0.9
    nowhere: float = -1e12


def evolved(problem: Problem, known: FloatArray, *, seed: int, settings: EvolutionSettings | None = None) -> Optima:
    """Look for a higher top than optimisations have found.

    Parameters
    ----------
    problem : Problem
    known : (n, n_dim) array
        Optima that optimisations have found, in sampling coordinates.
    seed : int
    settings : EvolutionSettings, optional

    Returns
    -------
    Optima
        The optimisation from the best member, no start, the population's sets counted; nothing, of a model with more
        causes than that.
    """
    s = settings or EvolutionSettings()
    if not len(known) or len(problem.terms) > s.most_causes:
        return maximise(problem, np.empty((0, problem.n_dim)))
    rng = np.random.default_rng(seed)
    low, high = problem.bounds.T
    drawn = problem.prior_transform(rng.uniform(size=(s.drawn, problem.n_dim)))
    parents = known[rng.integers(len(known), size=s.members - s.drawn)]
    about = parents + s.about * rng.standard_normal(parents.shape)

    def depth(columns: FloatArray) -> FloatArray:
        log_posterior = problem.log_posterior(np.clip(columns.T, low, high))
        return np.asarray(-np.where(np.isfinite(log_posterior), log_posterior, s.nowhere))

    try:
        found = differential_evolution(
            depth,
            problem.bounds,
            init=np.clip(np.vstack([drawn, about]), low, high),
            strategy="best1bin",
            mutation=s.factor,
            recombination=s.crossed,
            maxiter=s.generations,
            tol=0.0,
            atol=s.gathered,
            updating="deferred",
            vectorized=True,
            polish=False,
            rng=np.random.default_rng(seed),
        )
    except RuntimeError as error:
        if error.__cause__ is None:
            raise
        raise error.__cause__ from None  # SciPy blames itself for what the model has raised
    end = maximise(problem, found.x[None]).uncounted
    return replace(end, effort=end.effort + Effort(n_sets=s.members * found.nfev))

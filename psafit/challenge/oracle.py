r"""What somebody who knows the answer can see: the oracle's gain.

.. math:: \ln p(y \mid \hat\theta_\mathrm{true}) - \ln p(y \mid \hat\theta_\mathrm{baseline}) \text{ in nats.}

All groups count. Both models are fitted to the top of their *posterior*, since the prior keeps the directions that the
data leave open (tails of the scatter, what every session has for itself) where they can be; what is compared is the
*likelihood* there. The priors of the cause stay out of it: they say how plausible it is, not how much the data hold.

The baseline is searched for from many starts and from the truth. The true model starts from the truth, from which its
top is never far. Of an effect outside the catalogue no model can be fitted: its readings without scatter are known, and
only the scatter is fitted.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from psafit.arrays import FloatArray
from psafit.challenge.answer import Answer, standardised
from psafit.experiment import Experiment
from psafit.inference import noise
from psafit.inference.candidate import fit
from psafit.inference.hopping import hopped
from psafit.inference.optimiser import gradient
from psafit.inference.polish import polish
from psafit.inference.problem import Problem
from psafit.observables import Observable
from psafit.physics import TERMS
from psafit.physics import terms as catalogue
from psafit.physics.term import Term
from psafit.simulate import Design
from psafit.simulate.sensitivity import Side, plausible

Rows = NDArray[np.intp] | slice


@dataclass(frozen=True)
class RivalSettings:
    """How causes are looked for that nobody can distinguish from the truth.

    Parameters
    ----------
    confusable : float, nats
        Distance from the truth, of readings without scatter, below which a cause counts as one of them.
    shares : tuple of float
        Strengths from which a fit begins, as shares of the prior that lie closer to neutral: weak, from where least
        squares find their way, up to as strong as the cause plausibly is.
    evaluations : int
        Of least squares, at most.
    """

    confusable: float = 3.0
    shares: tuple[float, ...] = (0.05, 0.5, 0.95)
    evaluations: int = 20


@dataclass(frozen=True)
class Oracle:
    """How clearly the readings of a challenge show its truth, to someone who knows it.

    Parameters
    ----------
    gain : float
        Of the truth over the baseline, nats; never below 0 where the baseline is a case of the truth.
    without : dict
        Gain of the truth over the truth without one of its causes, nats; for more than one cause.
    fitted : dict
        Parameters of the true model at its top; empty for an effect outside the catalogue.
    confusable : list of str, optional
        Causes that come within 3 nats of the truth on readings without scatter, so that no diagnosis can be asked to
        distinguish them; None where nobody looked. Each was found at work: what is not listed may still be confusable.
    seconds : float
    """

    gain: float
    without: dict[str, float]
    fitted: dict[str, float]
    confusable: list[str] | None
    seconds: float


def consult(
    experiment: Experiment,
    answer: Answer,
    *,
    seed: int,
    rivals_from: float | None = None,
    starts: int = 32,
    draws: int = 1024,
) -> Oracle:
    """Measure the oracle's gain of a challenge.

    Parameters
    ----------
    experiment : Experiment
    answer : Answer
    seed : int
        Of the search for the baseline's top.
    rivals_from : float, nats, optional
        Gain from which to look for causes that nobody can distinguish from the truth (one cause only); never by
        default.
    starts : int
        Of the search for the tops of models that lack something. With eight, a baseline that fails was one time in two
        fitted below its top, and what that lacks would count as strength.
    draws : int
        Of the prior, that are looked at for these starts.
    """
    begun = time.monotonic()
    plain = Problem(experiment, experiment.ids)
    terms = catalogue(answer.terms)
    truth = truth_of(plain, answer)
    best = hopped(fit(plain, (), seed=seed, draws=draws, most=starts), seed=seed)
    tops = [polish(plain, u)[0] for u in (best.modes[0], truth)]
    log_posteriors = [float(plain.log_posterior(u[None, :])[0]) for u in tops]
    base = tops[int(np.argmax(log_posteriors))]
    base_likelihood = _likelihood(plain, base)
    without: dict[str, float] = {}
    fitted: dict[str, float] = {}
    confusable: list[str] | None = None
    if answer.outside is not None:
        gain = _known_readings(plain, np.array(answer.true_readings), truth) - base_likelihood
    elif not terms:
        gain = 0.0
    else:
        problem = Problem(experiment, experiment.ids, terms)
        top = polish(problem, truth_of(problem, answer))[0]
        reached = _likelihood(problem, top)
        # A weak cause may leave the truth's own neighbourhood below the baseline, which is a case of it.
        gain = max(reached - base_likelihood, 0.0)
        fitted = dict(zip(problem.names, problem.to_physical(top).tolist(), strict=True))
        if len(terms) > 1:
            for term in terms:
                rest = Problem(experiment, experiment.ids, tuple(t for t in terms if t is not term))
                # What one cause does in addition to another may as well be done by another contact: far from the truth.
                found = fit(rest, [best], seed=seed, draws=draws, most=starts)
                reduced = [polish(rest, u)[0] for u in (found.modes[0], truth_of(rest, answer))]
                # The baseline is a case of it, too.
                most = max(base_likelihood, *(_likelihood(rest, u) for u in reduced))
                without[term.id] = max(reached - most, 0.0)
        elif rivals_from is not None and gain >= rivals_from:
            confusable = find_rivals(experiment, answer)
    return Oracle(gain, without, fitted, confusable, time.monotonic() - begun)


def truth_of(problem: Problem, answer: Answer) -> FloatArray:
    """The truth as a point of a model, (n_dim,), a little inside its bounds."""
    values: dict[str, float] = dict(answer.parameters)
    for name, given in answer.scatter.items():
        values[name] = 60.0 if given is None else given  # normal, for all that can be seen
    x = [values[p.name] for p in problem.parameters]
    return problem.inside(problem.to_sampling(np.array(x)))


def _likelihood(problem: Problem, u: FloatArray) -> float:
    return float(problem.log_likelihood(u[None, :])[0])


def _known_readings(problem: Problem, true: FloatArray, start: FloatArray) -> float:
    """Log likelihood of readings whose values without scatter are known, at the scatter of the highest posterior."""
    parts = zip(problem.observables, problem.rows_of_scatter, strict=True)  # which share no scatter
    return sum(_best_scatter(problem, o, rows, true, start) for o, rows in parts)


def _best_scatter(problem: Problem, observable: Observable, rows: Rows, true: FloatArray, start: FloatArray) -> float:
    """Log likelihood of the known readings of one observable, at the scatter of the highest posterior."""
    known = None if problem.known_sigma is None else problem.known_sigma[rows]
    parameters = observable.scatter
    own = [problem.names.index(p.name) for p in parameters]

    def likelihood(v: FloatArray) -> float:
        own = np.array([[float(p.to_physical(x)) for p, x in zip(parameters, v, strict=True)]])
        values = noise.along(own, problem.design.elapsed[rows])
        return float(noise.log_density(problem.observed[rows], true[rows][None, :], values, known).sum())

    def depth(v: FloatArray) -> float:
        return -(likelihood(v) + sum(float(p.log_prior(x)) for p, x in zip(parameters, v, strict=True)))

    how = {"fatol": 1e-3, "xatol": 1e-3}
    found = minimize(depth, start[own], method="Nelder-Mead", bounds=problem.bounds[own], options=how)
    return likelihood(np.asarray(found.x))


def find_rivals(experiment: Experiment, answer: Answer, among: Sequence[Term] = TERMS) -> list[str]:
    """Causes that imitate the truth on this design to within `RivalSettings.confusable`.

    Each is fitted, with the baseline, to the true readings without scatter, by least squares in standard deviations of
    the true scatter, from some strengths on both sides of neutral.

    Parameters
    ----------
    experiment : Experiment
    answer : Answer
        Of one cause.
    among : sequence of Term

    Returns
    -------
    list of str
        Identifiers; the true cause is not among them.
    """
    settings = RivalSettings()
    true = np.array(answer.true_readings)
    exact = experiment.with_readings(true)
    design = Design.of(exact.constants, exact.groups)

    def standard(read: FloatArray) -> FloatArray:
        return standardised(read, answer.scatter, design)

    target = standard(true)
    found = []
    for term in among:
        if term.id in answer.terms:
            continue
        problem = Problem(exact, exact.ids, (term,))
        starts = _starts(problem, answer, settings.shares)
        if any(_distance(problem, s, standard, target, settings.evaluations) < settings.confusable for s in starts):
            found.append(term.id)
    return found


def _starts(problem: Problem, answer: Answer, shares: tuple[float, ...]) -> list[FloatArray]:
    """The true baseline with the rival at some strengths, on every side of neutral it has."""
    (term,) = problem.terms
    p = term.strength
    ends: tuple[tuple[Side, float], ...] = ((1, p.bounds.upper), (-1, p.bounds.lower))
    sides = [side for side, end in ends if end != p.neutral]
    u = problem.medians
    n = problem.n_physical - len(term.parameters)
    for i, q in enumerate(problem.parameters[:n]):
        u[i] = float(q.to_sampling(answer.parameters[q.name]))
    starts = []
    for side, share in itertools.product(sides, shares):
        v = u.copy()
        own = plausible(term, share, side)
        v[n : n + len(own)] = [float(q.to_sampling(x)) for q, x in zip(term.parameters, own, strict=True)]
        starts.append(problem.inside(v))
    return starts


def _distance(
    problem: Problem,
    start: FloatArray,
    standard: Callable[[FloatArray], FloatArray],
    target: FloatArray,
    evaluations: int,
) -> float:
    """What an oracle would lose with this model, nats; `standard` turns readings into what the target is in."""
    n = problem.n_model
    bounds = problem.bounds[:n]
    rest = start[n:]

    def residual(u: FloatArray) -> FloatArray:
        rows = np.concatenate([u, np.broadcast_to(rest, (len(u), rest.size))], axis=1)
        misfit = np.nan_to_num(standard(problem.predict(rows)) - target, nan=1e6, posinf=1e6, neginf=-1e6)
        # What a session has for itself is standard normal: a rival does not have it for nothing.
        return np.concatenate([misfit, u[:, problem.n_physical :]], axis=1)

    found = least_squares(
        lambda u: residual(u[None, :])[0],
        start[:n],
        jac=lambda u: gradient(residual, u, bounds).T,
        bounds=(bounds[:, 0], bounds[:, 1]),
        max_nfev=evaluations,
        ftol=1e-3,
        xtol=1e-3,
    )
    return 0.5 * target.size * float(np.log1p(2.0 * found.cost / target.size))

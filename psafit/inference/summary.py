"""What a run says of its posterior: what each parameter is determined by, and whether two ways of drawing agree."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
from scipy.stats import norm

from psafit.arrays import FloatArray
from psafit.experiment import Group, session_name
from psafit.inference import identify, store
from psafit.inference.evidence import ImportanceSample
from psafit.inference.problem import Problem
from psafit.inference.samplers import sampler
from psafit.inference.sampling import Chain
from psafit.parameters import SHARES
from psafit.physics import TERMS, informed
from psafit.physics.term import OfSession, Term
from psafit.records import (
    Fit,
    ImportanceEntry,
    ImportanceSummary,
    Overdamped,
    ParameterSummary,
    PosteriorSummary,
    ProfilePoint,
    SessionSummary,
)
from psafit.simulate import rig_of


def summarise(
    problem: Problem,
    chain: Chain,
    draws: store.Draws,
    importance: ImportanceSample,
    thin: int,
    profiles: list[list[ProfilePoint]],
    record: Fit,
    files: dict[str, str],
) -> PosteriorSummary:
    """What the draws say of every parameter, and how they were made."""
    health = store.diagnostics(draws.values)
    quantiles = np.quantile(draws.flat, [0.05, 0.5, 0.95], axis=0)
    sampled = problem.to_sampling(draws.flat)
    strange, entries = problem.implausible(quantiles[1]), []
    for i, parameter in enumerate(problem.parameters):
        points = profiles[i] if i < problem.n_physical else []
        prior = parameter.prior_quantile(SHARES)
        contraction = 1 - float(np.var(sampled[:, i]) / np.var(prior))
        lower, median, upper = (float(q) for q in quantiles[:, i])
        word = identify.verdict(points) if points else identify.verdict_of_draws(sampled[:, i], parameter, contraction)
        if word == "not determined" and not points and parameter.is_implausible(median):
            word = "determined"  # readings drove it where its prior is not
        prior_lower, prior_upper = parameter.prior_interval
        entries.append(
            ParameterSummary(
                name=parameter.name,
                median=median,
                lower=lower,
                upper=upper,
                prior_lower=prior_lower,
                prior_upper=prior_upper,
                contraction=contraction,
                r_hat=float(chain.r_hat[i]),
                ess_bulk=float(health["ess_bulk"][i]),
                ess_tail=float(health["ess_tail"][i]),
                autocorrelation_time=float(chain.autocorrelation_time[i]),
                verdict=word,
                text=identify.describe(parameter.name, parameter.unit, median, (lower, upper), points, word),
                profile=points,
                implausible=parameter.name in strange,
            )
        )
    kept = chain.draws.shape[1]
    reached = kept / float(chain.autocorrelation_time.max())
    goal = record.sampler.get("r_hat", math.inf)
    # Rounded so that what misses its goal is never printed as meeting it.
    mixed = store.rounded_r_hat(float(chain.r_hat.max()), goal)
    message = f"{math.floor(reached)} autocorrelation times, R-hat at most {mixed}"
    if not sampler(record.sampled_by).chained:
        message = f"{chain.draws.shape[0] * kept} independent draws"
        if not chain.converged:
            message = f"not converged ({message}): repeat the command to draw on, or take another --sampler"
    elif not chain.converged:
        wanted = "".join(
            f"; {words} {record.sampler[name]:g} wanted"
            for name, words in (("autocorrelation_times", "of the first"), ("r_hat", "R-hat"))
            if name in record.sampler
        )
        message = f"not converged after {chain.burn_in + kept} steps ({message}{wanted}): repeat the command to draw on"
        message += held_apart(problem.names, [m.log_posterior for m in record.minima], chain.r_hat, goal)
    return PosteriorSummary(
        identity=record.identity,
        converged=chain.converged,
        message=message,
        n_walkers=chain.draws.shape[0],
        n_steps=chain.burn_in + kept,
        burn_in=chain.burn_in,
        thinning=thin,
        acceptance=chain.acceptance,
        autocorrelation_times=reached,
        parameters=entries,
        importance=compared(problem, sampled, importance, float(min(health["ess_tail"]))),
        files=files,
        sessions=[*_sessions(problem, draws.flat)] or None,
    )


def _sessions(problem: Problem, rows: FloatArray) -> Iterator[SessionSummary]:
    for term, of, group, values in by_session(problem, rows):
        median, low, high = np.quantile(values, [0.5, 0.05, 0.95]).tolist()
        yield SessionSummary(term.id, group.id, of.title, of.unit, median, low, high, *problem.named_for(term, group))


def by_session(problem: Problem, rows: FloatArray) -> Iterator[tuple[Term, OfSession, Group, FloatArray]]:
    """What each session, or reader, has by each cause that differs so and changes what was read there.

    Parameters
    ----------
    problem : Problem
    rows : (n, n_dim) array
        In the parameters' units.

    Yields
    ------
    Term, OfSession, what one observable has in the first group, (n,) array
    """
    parts = [part for g in problem.experiment.select(problem.group_ids) for part in g.parts]
    for term in problem.terms:
        if not (term.latent and term.of_session):
            continue
        for id in term.having(problem.occasions):
            first = next(p for p in parts if id in ([p.session_id] if term.per == "sessions" else p.readers.values()))
            names = [*(p.name for p in term.parameters), session_name(term.latent.name, id)]
            columns = [problem.names.index(name) for name in names]
            yield term, term.of_session, first, term.of_session.value(rows[:, columns])


class Summarised(Protocol):
    """What is known of a parameter, in its unit; the lower end of its interval is None where it has none."""

    @property
    def median(self) -> float: ...  # noqa: D102

    @property
    def lower(self) -> float | None: ...  # noqa: D102


def overdamped(problem: Problem, entries: Sequence[Summarised]) -> Overdamped | None:
    r"""Whether the stack's damping is none; `entries` are of all parameters.

    .. math:: c_s > 2 \sqrt{k_s m}

    Beyond critical damping the stack does not swing: it follows its force with a lag of :math:`c_s/k_s`, more than
    :math:`1/\pi` of its period. It is said where the whole interval of c_s lies there. The rig's numbers are as the
    causes leave them.
    """
    lower = entries[problem.names.index("c_s")].lower
    theta = problem.theta(problem.to_sampling(np.array([[p.median for p in entries]])), problem.occasions)
    rig = rig_of(problem.experiment.constants, theta, problem.terms, problem.design.counts)
    critical = 2.0 * math.sqrt(float(rig.k_s[0] * rig.m[0]))
    if lower is None or lower <= critical:
        return None
    beliefs = problem.experiment.beliefs
    stated = {b.name for b in beliefs if b.prior is not None and (b.probability is None or b.probability > 0.5)}
    lacked = (t for t in informed(beliefs, TERMS)[1] if t.id not in problem.ids)
    times = (p for t in lacked for p in t.parameters if p.unit == "s" and p.name in stated)
    known = {p.name: 1e6 * p.prior_median for p in times}
    return Overdamped(critical, 1e6 * float(rig.c_s[0] / rig.k_s[0]), known or None)


def compared(
    problem: Problem, sampled: FloatArray, importance: ImportanceSample, effective: float
) -> ImportanceSummary:
    """Importance draws compared with those of the sampler, (n, n_dim) in the sampling coordinate.

    `effective` is what the latter are worth.
    """
    q = [0.05, 0.5, 0.95]
    own, other = np.quantile(sampled, q, axis=0), importance.quantiles(importance.draws, q)
    width = np.maximum(own[2] - own[0], 1e-12)
    apart = (np.abs(other - own) / width).max(axis=0)
    # Standard error of a limit of a normal distribution, in widths of its interval, times the root of the draws.
    one = math.sqrt(q[0] * q[2]) / norm.pdf(norm.ppf(q[0])) / (norm.ppf(q[2]) - norm.ppf(q[0]))
    values = problem.to_physical(other)
    return ImportanceSummary(
        log_evidence=importance.log_evidence,
        standard_error=importance.standard_error,
        effective=importance.effective,
        pareto_k=importance.pareto_k,
        by_chance=2 * float(one) * math.hypot(importance.effective**-0.5, effective**-0.5),
        parameters=[
            ImportanceEntry(name, float(values[1, k]), float(values[0, k]), float(values[2, k]), float(apart[k]))
            for k, name in enumerate(problem.names)
        ],
    )


def held_apart(
    names: Sequence[str], log_posteriors: Sequence[float], r_hat: FloatArray, goal: float, near: float = 5.0
) -> str:
    """What keeps walkers apart, where the search ended in several places within so many nats of the best."""
    near_top = sum(log_posterior > max(log_posteriors) - near for log_posterior in log_posteriors)
    if near_top < 2 or r_hat.max() < goal:
        return ""
    return (
        f". {names[int(r_hat.argmax())]} mixes least: the search ended in {near_top} places within {near:g} nats,"
        " between which walkers rarely cross; psafit diagnose samples such places one by one"
    )

"""Is anything wrong? Tests of a fitted model against its own simulated data, refitted.

The statistics of the residuals (`psafit.diagnose.residuals`) have no law from a table, since residuals of a fit are not
independent: data are simulated from the fit, refitted, and give every statistic its own law.

The family has one p-value: every statistic is expressed in units of its own law (how far above the median, against
the distance from there to the 95 % point, as several quantiles together say), the largest is the family's, and its rank
among the same quantity of the simulated data is the p-value. A statistic counts as significant by itself when it
exceeds the family's 95 % point.

A fit is *sound* where the family finds nothing, no readings of several groups stand out together (by the same level),
and heavy tails were not needed to pass. Tails are heavy where a fitted number of degrees of freedom lies in the lower
half of its prior; they were needed where the same tests fail once it is held to the upper half. Each look is taken at
the level of the family; docs/diagnosis.md says how often all of them together object to a sound model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import beta

from psafit.arrays import FloatArray
from psafit.diagnose.residuals import (
    Key,
    MisfitSettings,
    Variable,
    both,
    looks,
    normal_scores,
    numbered,
    shared,
    sweeps,
    windows,
)
from psafit.diagnose.screening import extended
from psafit.experiment import GroupId
from psafit.inference import noise
from psafit.inference.candidate import Candidate, optimised, refitted
from psafit.inference.optimiser import maximise, maximise_linearly
from psafit.inference.problem import Problem
from psafit.observables import OBSERVABLES, recorded_name
from psafit.physics.term import Term
from psafit.records import Objection
from psafit.simulate import Design, path_of
from psafit.validate import log_ratio

ALPHA = 0.02
"""Level of the family: a false alarm in fifty sound models."""

Character = Literal["none", "physics", "scatter", "group", "points", "sessions"]

CHARACTERS: dict[Character, str] = {
    "none": "no particular character",
    "physics": "it follows the conditions or the order of the readings, so it is systematic",
    "scatter": "the mean is right; the law of the scatter is not",
    "group": "it is all due to one group",
    "points": "it is all due to a few odd readings",
    "sessions": "sessions at the same condition disagree",
}
"""What kind of thing a misfit is, in words."""


@dataclass(frozen=True)
class Statistic:
    """One look at the residuals.

    Parameters
    ----------
    name : str
        What it looks at, in words.
    kind : {"mean", "spread", "point", "replicate", "all"}
        What it would show wrong: the physics, the law of the scatter, single readings, the sessions, or any of these.
    group : group id, optional
        Where it looks; None for all.
    value : float
    excess : float
        In units of its own law: 0 at the median, 1 at the 95 % point, as several quantiles together say.
    p_value : float
        By itself.
    significant : bool
        Beyond the 95 % point of the largest of all.
    """

    name: str
    kind: str
    group: GroupId | None
    value: float
    excess: float
    p_value: float
    significant: bool


def described(character: Character, statistics: Sequence[Statistic]) -> str:
    """The character of a misfit in words, and what the statistics say of the scatter where it is systematic."""
    text = CHARACTERS[character]
    if character not in ("physics", "group"):
        return text
    if any(s.significant and s.kind == "spread" for s in statistics):
        return f"{text}, and the law of the scatter is off, too"
    return f"{text}, not scatter" if character == "physics" else text


@dataclass(frozen=True)
class Place:
    """A stretch of a sweep that the model misses.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude", "time"}
        What the sweep varies, or along a trace.
    lower, upper : float, Hz, V or us
    log_bias : float
        Mean of ln(predicted/measured) there.
    score : float
        Sum of the normal scores over the root of their number.
    p_value : float
        Share of simulated data sets with such a stretch anywhere.
    observable : str, optional
        What was read there, if not the launch range.
    """

    group: GroupId
    variable: Variable
    lower: float
    upper: float
    log_bias: float
    score: float
    p_value: float
    observable: str | None = None


@dataclass(frozen=True)
class Coincidence:
    """Readings of several groups that stand out to one side at one frequency or amplitude.

    Heavy tails take up any one of them, since a single odd reading may be an error of reading; an error of reading does
    not come back where another session measures.

    Parameters
    ----------
    variable : {"frequency", "amplitude"}
        What these groups sweep.
    readings : tuple of (group id, int)
        Numbered in the group from 0.
    lower, upper : float, Hz or V
    log_bias : float
        Mean of ln(predicted/measured) there.
    score : float
        That of the second of them that stands out most.
    p_value : float
        Share of simulated data sets with such readings at any condition.
    observable : str, optional
        What was read there, if not the launch range.
    """

    variable: Variable
    readings: tuple[tuple[GroupId, int], ...]
    lower: float
    upper: float
    log_bias: float
    score: float
    p_value: float
    observable: str | None = None


class Tested:
    """A model that was tested, here or on record."""

    p_value: float
    coincidences: Sequence[Coincidence]
    usual_tails: float | None

    @property
    def objection(self) -> Objection:
        """What speaks against the model, if anything does."""
        if self.p_value < ALPHA:
            return "tests"
        if self.coincidences:
            return "together"
        return "tails" if self.usual_tails is not None and self.usual_tails < ALPHA else ""

    @property
    def least(self) -> float:
        """The p value of what speaks against the model, or that of the family."""
        if self.objection == "together":
            return min(c.p_value for c in self.coincidences)
        return self.usual_tails if self.objection == "tails" and self.usual_tails is not None else self.p_value


@dataclass(frozen=True, eq=False)
class Misfit(Tested):
    """What the tests say of one fitted model.

    Parameters
    ----------
    p_value : float
        Of the family.
    statistics : tuple of Statistic
        Most striking first.
    places : tuple of Place
    coincidences : tuple of Coincidence
    character : str
        "none", "physics", "scatter", "group", "points" or "sessions".
    odd_groups : tuple of group ids
        The group whose removal leaves nothing wrong, if there is one.
    odd_points : tuple of (group id, int)
        Readings (by their rows in the group's table, from 0) beyond four standard deviations.
    scores : (n_points,) array
        The residuals.
    n_simulated : int
        Data sets that the tests rest on; none where no test is possible.
    refit : {"exact", "expansion"}
        How simulated data were refitted.
    usual_tails : float, optional
        p value of the same tests where the scatter has no heavier tails than usual; None where the fit has none, or
        where the tests fail anyway.
    """

    p_value: float
    statistics: tuple[Statistic, ...]
    places: tuple[Place, ...]
    coincidences: tuple[Coincidence, ...]
    character: Character
    odd_groups: tuple[GroupId, ...]
    odd_points: tuple[tuple[GroupId, int], ...]
    scores: FloatArray
    n_simulated: int
    refit: str
    usual_tails: float | None = None

    @property
    def stretches(self) -> list[tuple[GroupId, Variable, float, float]]:
        """Where readings stand out, along a sweep or together: a group, what it sweeps, and the two ends there."""
        places = [(p.group, p.variable, p.lower, p.upper) for p in self.places]
        return places + [(c.readings[0][0], c.variable, c.lower, c.upper) for c in self.coincidences]

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong: the tests pass, without heavy tails, and no readings stand out together."""
        return not self.objection


def passes(candidate: Candidate, catalogue: Sequence[Term], *, seed: int) -> bool:
    """Whether the tests find nothing wrong with a fitted model."""
    return examine(candidate, catalogue, seed=seed, influence=False).sound


def examine(
    candidate: Candidate,
    catalogue: Sequence[Term],
    *,
    seed: int,
    n_simulated: int = 199,
    exact: bool | None = None,
    influence: bool = True,
    tails: bool = True,
    level: float = ALPHA,
) -> Misfit:
    """Test a fitted model.

    Parameters
    ----------
    candidate : Candidate
    catalogue : sequence of Term
        Causes whose directions are looked at.
    seed : int
    n_simulated : int
        Data sets simulated from the fit; as many again, and so on, while it is open on which side of `level` the p
        value lies (`MisfitSettings.sure`).
    exact : bool, optional
        Whether they are refitted with the model itself and not with its expansion; by default where the model has a
        closed form.
    influence : bool
        Whether to ask if one group or a few readings are all that is wrong.
    tails : bool
        Whether to ask if heavy tails were needed to pass.
    level : float
        What the p value is held against.
    """
    settings = MisfitSettings()
    problem, u = candidate.problem, candidate.modes[:1]
    if exact is None:
        exact = path_of(candidate.terms) == "closed form"
    observed = normal_scores(problem, u, candidate.predicted[None, :], problem.observed, settings.clip)
    directions = _directions(candidate, catalogue, settings.directions)
    # No test is possible with as many parameters as readings, nor where the readings have no scatter.
    tested = problem.observed.size > problem.n_physical and not noise.too_fine(candidate.noise, observed[0], ALPHA)

    def looked(simulated: FloatArray) -> tuple[list[Key], FloatArray, FloatArray]:
        return _family(problem, np.vstack([observed, simulated]), candidate.predicted, directions, settings)

    def as_large(simulated: FloatArray) -> int:
        largest = looked(simulated)[2].max(axis=0)
        return int(np.sum(largest[1:] >= largest[0]))

    simulate = _simulator(candidate, seed, exact, settings)
    most = settings.most if tested else n_simulated
    simulated = until_decided(simulate, as_large, n_simulated, most=most, level=level, sure=settings.sure)
    names, table, excess = looked(simulated)
    largest, n = excess.max(axis=0), len(simulated)
    p_value = float((1 + np.sum(largest[1:] >= largest[0])) / (1 + n))
    bar = float(np.quantile(largest[1:], 0.95))
    if not tested:
        p_value, bar = 1.0, math.inf
    alone = (1 + (table[:, 1:] >= table[:, :1]).sum(axis=1)) / (1 + n)
    values = zip(names, table[:, 0].tolist(), excess[:, 0].tolist(), alone.tolist(), strict=True)
    statistics = [Statistic(*name, value, far, p, far > bar) for name, value, far, p in values]
    statistics.sort(key=lambda s: -s.excess)
    places = _places(problem, observed[0], simulated, candidate.predicted, settings)
    coincidences = _coincidences(problem, observed[0], simulated, candidate.predicted) if tested else ()
    odd_points = tuple(numbered(problem, int(k)) for k in np.flatnonzero(np.abs(observed[0]) > settings.odd))
    character: Character = "none"
    odd_groups: tuple[GroupId, ...] = ()
    if p_value < ALPHA:
        character, odd_groups = character_of(candidate, catalogue, statistics, seed, odd_points, influence=influence)
    usual = None
    if tails and ALPHA <= p_value < 1.0 and (held := _with_usual_tails(candidate)) is not None:
        how: dict[str, Any] = {"n_simulated": n_simulated, "exact": exact, "influence": False, "tails": False}
        usual = examine(held, catalogue, seed=seed, **how).p_value
    return Misfit(
        p_value, tuple(statistics), places, coincidences, character, odd_groups, odd_points, observed[0],
        n if tested else 0,
        "exact" if exact else "expansion", usual,
    )  # fmt: skip


def _family(
    problem: Problem, e: FloatArray, predicted: FloatArray, directions: dict[str, FloatArray], settings: MisfitSettings
) -> tuple[list[Key], FloatArray, FloatArray]:
    """Every statistic by name, (n_statistics, 1 + n), and the same in units of its law."""
    found = looks(problem, e, predicted, directions, settings)
    table = np.array(list(found.values()))
    table = np.vstack([table, oddness(table)])
    return [*found, ("many of these at once", "all", None)], table, standardised(table, settings.scale)


def _with_usual_tails(candidate: Candidate) -> Candidate | None:
    """The model refitted with no heavier tails than usual; None where its scatter has none."""
    held = replace(candidate.problem, usual_tails=True)
    start = np.clip(candidate.modes[:1], *held.bounds.T)
    return None if (start == candidate.modes[:1]).all() else optimised(held, start)


def _simulator(candidate: Candidate, seed: int, exact: bool, settings: MisfitSettings) -> Callable[[int], FloatArray]:
    """What simulates data sets from a fit: normal scores of the next n under their own refits, (n, n_points)."""
    problem, rng, of_silence = candidate.problem, np.random.default_rng([seed, 7]), np.random.default_rng([seed, 7, 1])

    def simulate(n: int) -> FloatArray:
        predicted = np.repeat(candidate.predicted[None, :], n, axis=0)
        scatter = np.repeat(candidate.noise, n, axis=0)
        # An instrument does not show ranges below zero.
        fake = np.maximum(noise.draw(predicted, scatter, problem.known_sigma, rng), problem.floor)
        fake[_silent(candidate, n, of_silence)] = 0.0
        refit = maximise_linearly(
            problem,
            np.repeat(candidate.modes[:1], n, axis=0),
            np.maximum(predicted, np.where(problem.design.traced, -np.inf, 1e-9)),
            candidate.relative_slope,
            fake,
            iterations=8,
        )
        if exact:
            refit = maximise(problem, refit.u, fake, schedule=((settings.exact_iterations, n),))
        return normal_scores(problem, refit.u, refit.predicted, fake, settings.clip)

    return simulate


def until_decided(
    simulate: Callable[[int], FloatArray],
    as_large: Callable[[FloatArray], int],
    n: int,
    *,
    most: int,
    level: float = ALPHA,
    sure: float = MisfitSettings.sure,
) -> FloatArray:
    """Simulated data sets, `n` and as many again while a p value is open, as long as that makes no more than `most`.

    Parameters
    ----------
    simulate : callable
        Gives the next so many, a row each.
    as_large : callable
        Number of some that are as odd as the readings.
    n, most : int
    level, sure : float
        See `decided`.
    """
    found = simulate(n)
    while 2 * len(found) <= most and not decided(as_large(found), len(found), level, sure):
        found = np.vstack([found, simulate(len(found))])
    return found


def decided(as_large: int, n: int, level: float, sure: float) -> bool:
    """Whether a p value is surely on one side of a level: its interval (Clopper and Pearson) does not hold it."""
    low = beta.ppf(0.5 * (1 - sure), as_large, n - as_large + 1) if as_large else 0.0
    high = beta.ppf(0.5 * (1 + sure), as_large + 1, n - as_large) if as_large < n else 1.0
    return not low <= level <= high


def _silent(candidate: Candidate, n: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which readings of simulated data sets are of an instrument that shows nothing of a launch that fails.

    The scatter puts half of such readings above zero. How many more are zero in the measured ones says how often the
    instrument does so; (n, n_points).
    """
    failed = candidate.predicted <= candidate.problem.floor
    more = 2.0 * np.mean(candidate.problem.observed[failed] == 0.0) - 1.0 if failed.any() else 0.0
    return failed & (rng.random((n, failed.size)) < more)


def standardised(table: FloatArray, levels: tuple[float, ...]) -> FloatArray:
    """How far statistics lie above what simulated data sets show as a rule, in the scale of each; like `table`.

    Parameters
    ----------
    table : (n_statistics, 1 + n) array
        Statistics of the readings, and of the simulated data sets.
    levels : tuple of float
        Upper quantiles of the simulated ones that say how wide they are. The mean of several hangs less on the draws
        than the outermost does, which is the unit.
    """
    null = table[:, 1:]
    middle = np.median(null, axis=1, keepdims=True)
    steps = (np.quantile(null, levels, axis=1) - middle.T) / ndtri(levels)[:, None]  # (n_levels, n_statistics)
    return (table - middle) / np.maximum(steps.mean(axis=0) * ndtri(max(levels)), 1e-9)[:, None]


def oddness(table: FloatArray) -> FloatArray:
    """Fisher's sum over statistics of -ln p, each p the share of the simulated data sets with as much; (1 + n,).

    The statistics are not independent: like theirs, its law is that of the simulated data sets.
    """
    null = np.sort(table[:, 1:], axis=1)
    n = null.shape[1]
    below = np.array([np.searchsorted(row, values, side="left") for row, values in zip(null, table, strict=True)])
    return -np.log((n - below + 1) / (n + 1)).sum(axis=0)


def _directions(candidate: Candidate, catalogue: Sequence[Term], quantiles: tuple[float, ...]) -> dict[str, FloatArray]:
    """Unit directions, (n, n_points), in which each cause moves the whitened ranges, the fit's own projected out."""
    result = {}
    for term in catalogue:
        if term in candidate.terms or term.latent:
            continue
        large = extended(candidate.problem, term, catalogue)
        rows = np.repeat(candidate.within(large)[0][None, :], len(quantiles), axis=0)
        rows[:, large.names.index(term.strength.name)] = term.strength.prior_quantile(np.array(quantiles))
        change = large.predict(rows) - candidate.predicted
        effect = candidate.project_out(np.clip(change, -20 * candidate.scatter, 20 * candidate.scatter))
        size = np.linalg.norm(effect, axis=1)
        if (size > 0.3).any():
            result[term.id] = effect[size > 0.3] / size[size > 0.3, None]
    return result


def _read(design: Design, rows: NDArray[np.intp]) -> str | None:
    """What was read in some rows, all of one observable, as records call it."""
    return recorded_name(OBSERVABLES[int(design.measured[rows[0]])])


def _places(
    problem: Problem, e: FloatArray, simulated: FloatArray, predicted: FloatArray, settings: MisfitSettings
) -> tuple[Place, ...]:
    """Stretches that stand out from those of the simulated data, the strongest of each that overlap."""
    design = problem.design
    ordered = [s for s in sweeps(problem) if s[2].size >= settings.fewest]
    if not ordered:
        return ()
    null = np.max(
        [np.abs(windows(simulated[:, rows], settings.windows)[0]).max(axis=1) for _, _, rows in ordered], axis=0
    )
    bar = float(np.quantile(null, 0.95))
    error = log_ratio(predicted, problem.observed, *problem.metric)
    places = []
    for group_id, variable, rows in ordered:
        score, spans = windows(e[None, rows], settings.windows)
        left = [(abs(float(z)), float(z), a, b) for z, (a, b) in zip(score[0], spans, strict=True) if abs(z) > bar]
        while left:
            _, z, a, b = max(left)
            values = design.swept(variable)[rows]
            places.append(
                Place(
                    group_id, variable, float(values[a]), float(values[b - 1]), float(error[rows[a:b]].mean()), z,
                    float((1 + np.sum(null >= abs(z))) / (1 + len(null))), _read(design, rows),
                )
            )  # fmt: skip
            left = [w for w in left if w[3] <= a or w[2] >= b]
    return tuple(sorted(places, key=lambda p: -abs(p.score)))


def _coincidences(
    problem: Problem, e: FloatArray, simulated: FloatArray, predicted: FloatArray
) -> tuple[Coincidence, ...]:
    """Readings that stand out together further than simulated data sets show at any condition, at the tests' level."""
    design = problem.design
    error = log_ratio(predicted, problem.observed, *problem.metric)
    found = []
    everywhere = shared(problem)
    null = np.max([both(simulated[:, rows]) for meeting in everywhere.values() for rows in meeting], axis=0, initial=0)
    for variable, meeting in everywhere.items():
        for rows in meeting:
            score = float(both(e[None, rows])[0])
            p_value = float((1 + np.sum(null >= score)) / (1 + len(null)))
            if p_value >= ALPHA:
                continue
            side = 1 if np.sort(e[rows])[-2] >= score else -1
            rows = rows[side * e[rows] >= score]
            values = design.swept(variable)[rows]
            found.append(
                Coincidence(
                    variable, tuple(numbered(problem, int(k)) for k in rows),
                    float(values.min()), float(values.max()), float(error[rows].mean()), side * score, p_value,
                    _read(design, rows),
                )
            )  # fmt: skip
    return tuple(sorted(found, key=lambda c: -abs(c.score)))


def character_of(
    candidate: Candidate,
    catalogue: Sequence[Term],
    statistics: Sequence[Statistic],
    seed: int,
    odd_points: tuple[tuple[GroupId, int], ...],
    *,
    influence: bool,
) -> tuple[Character, tuple[GroupId, ...]]:
    """Say what kind of thing is wrong; see `Misfit`. Groups are left out only where their `influence` is asked for."""
    kinds = {s.kind for s in statistics if s.significant}
    problem, settings = candidate.problem, MisfitSettings()
    if influence and "mean" in kinds and len(problem.group_ids) > 2:
        suspects = list(dict.fromkeys(s.group for s in statistics if s.significant and s.group is not None))
        clean = []
        for group_id in suspects[:6]:
            others = replace(problem, group_ids=tuple(g for g in problem.group_ids if g != group_id))
            own = problem.observed.size - others.observed.size
            if others.observed.size < max(settings.others * own, 2 * problem.n_physical):
                continue  # too few to find anything wrong
            without = refitted(others, candidate)
            quick: dict[str, Any] = {"exact": False, "influence": False, "tails": False, "level": settings.clear}
            p = examine(without, catalogue, seed=seed, n_simulated=settings.n_without, **quick).p_value
            if p > settings.clear:
                clean.append((p, group_id))
        if clean:
            return "group", (max(clean, key=lambda c: c[0])[1],)
    if "mean" in kinds:
        return "physics", ()
    if "replicate" in kinds:
        return "sessions", ()
    if kinds == {"all"}:
        return "none", ()
    if odd_points and (kinds == {"point"} or (kinds <= {"point", "spread"} and len(odd_points) <= 3)):
        return "points", ()
    return "scatter", ()

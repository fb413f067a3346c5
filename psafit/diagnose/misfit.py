r"""Is anything wrong? Tests of a fitted model against its own simulated data, refitted.

Residuals are normal scores :math:`e = \Phi^{-1}(F(y))` of the readings under the fitted scatter, along a trace given
the samples before: what its errors have in common is no order. Statistics look for
what a sound fit leaves at random: order along each sweep (runs, lag one, windows), levels of groups and of waveforms,
trends against every covariate, the directions in which any cause of the catalogue would move the ranges, the spread
of groups and of sizes, single readings, readings of several groups that stand out together at one condition, conditions
against the pure error of their replicates, and conditions that two sessions share; and whether many of these are odd at
once. None has a law from a table, since residuals of a fit are not independent: data are simulated from the fit,
refitted, and give every statistic its own law.

The family has one p-value: every statistic is expressed in units of its own law (how far above the median, against
the distance from the median to the 95 % point), the largest is the family's, and its rank among the same quantity
of the simulated data is the p-value. A statistic counts as significant by itself when it exceeds the family's 95 %
point.

A fit is *sound* where the family finds nothing, no readings of several groups stand out together (by the same level),
and heavy tails were not needed to pass. Tails are heavy where a fitted number of degrees of freedom lies in the lower
half of its prior; they were needed where the same tests fail once it is held to the upper half.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from psafit.arrays import FloatArray
from psafit.diagnose.screening import extended
from psafit.experiment import GroupId, Swept
from psafit.inference import noise
from psafit.inference.candidate import Candidate, optimised, refitted
from psafit.inference.optimiser import maximise, maximise_linearly
from psafit.inference.problem import Problem
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.physics.term import Term
from psafit.simulate import Design, path_of
from psafit.validate import log_ratio

ALPHA = 0.02
"""Level of the family: a false alarm in fifty sound models."""

Variable = Swept
Character = Literal["none", "physics", "scatter", "group", "points", "sessions"]
CHARACTERS: dict[Character, str] = {
    "none": "no particular character",
    "physics": "the misfit follows the conditions, or the order of the readings: the physics is wrong, not the scatter",
    "scatter": "the mean is right; the law of the scatter is not",
    "group": "it is all due to one group",
    "points": "it is all due to a few odd readings",
    "sessions": "sessions at the same condition disagree",
}
"""What kind of thing a misfit is, in words."""


@dataclass(frozen=True)
class MisfitSettings:
    """What the tests look at, and from where on it counts.

    Parameters
    ----------
    directions : tuple of float
        Strengths at which causes give directions, as quantiles of their priors.
    windows : tuple of int
        Readings of the stretches of a sweep that are looked at; the whole sweep is one more.
    clip : float
        Normal scores end here, so that one reading decides no statistic of many.
    odd : float
        Normal score beyond which a reading is odd by itself: once in 15,000 readings.
    fewest : int
        Readings of the shortest sweep that is looked at.
    spare : int
        Replicates beyond the first of their conditions from which on they say how a reading scatters.
    exact_iterations : int
        Of a refit by the model itself, which begins where that by the expansion ended.
    others : float
        Readings that the other groups need to clear themselves where one is left out, as a share of that group's own.
    n_without : int
        Data sets simulated for the question whether one group is all that is wrong.
    """

    directions: tuple[float, ...] = (0.1, 0.4, 0.75, 0.95)
    windows: tuple[int, ...] = (3, 5, 9, 17, 33)
    clip: float = 6.0
    odd: float = 4.0
    fewest: int = 5
    spare: int = 3
    exact_iterations: int = 4
    others: float = 0.5
    n_without: int = 149


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
        In units of its own law: 0 at the median, 1 at the 95 % point.
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
    """

    group: GroupId
    variable: Variable
    lower: float
    upper: float
    log_bias: float
    score: float
    p_value: float


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
    """

    variable: Variable
    readings: tuple[tuple[GroupId, int], ...]
    lower: float
    upper: float
    log_bias: float
    score: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Misfit:
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
        Readings (numbered in the group from 0) beyond four standard deviations.
    scores : (n_points,) array
        The residuals.
    n_simulated : int
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
    def wrong(self) -> bool:
        """Whether the tests reject the model."""
        return self.p_value < ALPHA

    @property
    def sound(self) -> bool:
        """Whether nothing is wrong: the tests pass, without heavy tails, and no readings stand out together."""
        leans = self.usual_tails is not None and self.usual_tails < ALPHA
        return not (self.wrong or self.coincidences or leans)


def normal_scores(
    problem: Problem, u: FloatArray, predicted: FloatArray, observed: FloatArray, clip: float = MisfitSettings.clip
) -> FloatArray:
    """Normal scores of readings under fits, cut off at `clip`; (n_sets, n_points)."""
    values = problem.noise_values(u)
    z, nu = noise.innovations(observed, predicted, values, problem.known_sigma), noise.columns(values)[2]
    # The probability integral loses its digits in the tails; there the score grows with the log density instead.
    p = noise.cumulative(observed, predicted, values, problem.known_sigma)
    body = ndtri(np.clip(p, 1e-12, 1 - 1e-12))
    tail = np.sign(z) * np.sqrt((nu + 1) * np.log1p(z * z / nu))
    return np.clip(np.where(np.abs(body) < 5, body, tail), -clip, clip)


def numbered(problem: Problem, row: int) -> tuple[GroupId, int]:
    """The group of a row of the design, and the reading's number in it, from 0."""
    group = problem.design.group
    return problem.group_ids[group[row]], int(row - np.searchsorted(group, group[row]))


def sweeps(problem: Problem) -> list[tuple[GroupId, Variable, NDArray[np.intp]]]:
    """Each group's id, the variable it sweeps, and its rows of the design in the order of the sweep.

    A group of several observables is a sweep of each.
    """
    found: list[tuple[GroupId, Variable, NDArray[np.intp]]] = []
    for k, g in enumerate(problem.experiment.select(problem.group_ids)):
        rows = np.flatnonzero(problem.design.group == k)
        for kind in np.unique(g.measured):
            part = np.flatnonzero(g.measured == kind)
            found.append((g.id, g.swept, rows[part[g.at(part).in_sweep]]))
    return found


def of_what(problem: Problem, rows: NDArray[np.intp]) -> str:
    """What readings of one observable are of, behind a noun; empty for launch ranges."""
    observable = OBSERVABLES[problem.design.measured[rows[0]]]
    return "" if observable is LAUNCH_RANGE else f" of {observable.titles}"


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
    settings: MisfitSettings | None = None,
) -> Misfit:
    """Test a fitted model.

    Parameters
    ----------
    candidate : Candidate
    catalogue : sequence of Term
        Causes whose directions are looked at.
    seed : int
    n_simulated : int
        Data sets simulated from the fit.
    exact : bool, optional
        Whether they are refitted with the model itself and not with its expansion; by default where the model has a
        closed form.
    influence : bool
        Whether to ask if one group or a few readings are all that is wrong.
    tails : bool
        Whether to ask if heavy tails were needed to pass.
    settings : MisfitSettings, optional
    """
    settings = settings or MisfitSettings()
    problem, u = candidate.problem, candidate.modes[:1]
    if exact is None:
        exact = path_of(candidate.terms) == "closed form"
    observed = normal_scores(problem, u, candidate.predicted[None, :], problem.observed, settings.clip)
    simulated = _simulated(candidate, seed, n_simulated, exact, settings)
    directions = _directions(candidate, catalogue, settings.directions)
    looked = _look(problem, np.vstack([observed, simulated]), candidate.predicted, directions, settings)
    names = list(looked)
    table = np.array([looked[name] for name in names])  # (n_statistics, 1 + n)
    names.append(("many of these at once", "all", None))
    table = np.vstack([table, _together(table)])
    null = table[:, 1:]
    middle = np.median(null, axis=1, keepdims=True)
    reach = np.maximum(np.quantile(null, 0.95, axis=1, keepdims=True) - middle, 1e-9)
    excess = (table - middle) / reach
    largest = excess.max(axis=0)
    p_value = float((1 + np.sum(largest[1:] >= largest[0])) / (1 + n_simulated))
    bar = float(np.quantile(largest[1:], 0.95))
    quiet = noise.at_least(candidate.noise)[0] and np.mean(observed[0] ** 2) < 1.0
    if problem.observed.size <= problem.n_physical or quiet:
        # As many parameters as readings meet every reading, or all are met more closely than any instrument reads, as
        # those that a simulation made are: nothing is left to be tested.
        p_value, bar = 1.0, math.inf
    statistics = [
        Statistic(
            name[0], name[1], name[2], float(table[k, 0]), float(excess[k, 0]),
            float((1 + np.sum(null[k] >= table[k, 0])) / (1 + n_simulated)), bool(excess[k, 0] > bar),
        )
        for k, name in enumerate(names)
    ]  # fmt: skip
    statistics.sort(key=lambda s: -s.excess)
    places = _places(problem, observed[0], simulated, candidate.predicted, settings)
    coincidences = _coincidences(problem, observed[0], simulated, candidate.predicted)
    odd_points = tuple(numbered(problem, int(k)) for k in np.flatnonzero(np.abs(observed[0]) > settings.odd))
    character: Character = "none"
    odd_groups: tuple[GroupId, ...] = ()
    if p_value < ALPHA:
        character, odd_groups = _character(
            candidate, catalogue, statistics, seed, odd_points, settings if influence else None
        )
    usual, held = None, _with_usual_tails(candidate) if tails and ALPHA <= p_value < 1.0 else None
    if held is not None:
        how: dict[str, Any] = {"n_simulated": n_simulated, "exact": exact, "influence": False, "tails": False}
        usual = examine(held, catalogue, seed=seed, settings=settings, **how).p_value
    return Misfit(
        p_value, tuple(statistics), places, coincidences, character, odd_groups, odd_points, observed[0], n_simulated,
        "exact" if exact else "expansion", usual,
    )  # fmt: skip


def _with_usual_tails(candidate: Candidate) -> Candidate | None:
    """The model refitted with no heavier tails than usual; None where its scatter has none."""
    held = replace(candidate.problem, usual_tails=True)
    start = np.clip(candidate.modes[:1], *held.bounds.T)
    return None if (start == candidate.modes[:1]).all() else optimised(held, start)


def _simulated(candidate: Candidate, seed: int, n_simulated: int, exact: bool, settings: MisfitSettings) -> FloatArray:
    """Normal scores of data sets simulated from a fit under their own refits; (n_simulated, n_points)."""
    problem, rng = candidate.problem, np.random.default_rng([seed, 7])
    predicted = np.repeat(candidate.predicted[None, :], n_simulated, axis=0)
    scatter = np.repeat(candidate.noise, n_simulated, axis=0)
    # An instrument does not show ranges below zero.
    fake = np.maximum(noise.draw(predicted, scatter, problem.known_sigma, rng), problem.floor)
    starts = np.repeat(candidate.modes[:1], n_simulated, axis=0)
    refit = maximise_linearly(
        problem,
        starts,
        np.maximum(predicted, np.where(problem.design.traced, -np.inf, 1e-9)),
        candidate.relative_slope,
        fake,
        iterations=8,
    )
    if exact:
        refit = maximise(problem, refit.u, fake, schedule=((settings.exact_iterations, n_simulated),))
    return normal_scores(problem, refit.u, refit.predicted, fake, settings.clip)


def _together(table: FloatArray) -> FloatArray:
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


Key = tuple[str, str, GroupId | None]


def _look(
    problem: Problem, e: FloatArray, predicted: FloatArray, directions: dict[str, FloatArray], settings: MisfitSettings
) -> dict[Key, FloatArray]:
    """Every statistic of every row of `e`, larger for worse; each (n_sets,)."""
    found: dict[Key, FloatArray] = {}
    design = problem.design
    scans = []
    for group_id, variable, rows in sweeps(problem):
        x = e[:, rows]
        n, of = rows.size, of_what(problem, rows)
        if n < settings.fewest:
            continue
        found[f"level{of}", "mean", group_id] = np.abs(x.sum(axis=1)) / math.sqrt(n)
        found[f"neighbours{of} along the {variable}", "mean", group_id] = (x[:, 1:] * x[:, :-1]).sum(
            axis=1
        ) / math.sqrt(n)
        signs = (x > 0).astype(int)
        found[f"runs{of} along the {variable}", "mean", group_id] = -np.abs(np.diff(signs, axis=1)).sum(
            axis=1
        ) / math.sqrt(n)
        scan = np.abs(_windows(x, settings.windows)[0]).max(axis=1)
        found[f"stretches of {variable}{of and ',' + of}", "mean", group_id] = scan
        scans.append(scan)
        found[f"spread{of}", "spread", group_id] = np.abs(np.log(np.mean(x**2, axis=1) + 0.05))
    if scans:
        found["stretches of any sweep", "mean", None] = np.max(scans, axis=0)
    for variable, rows_of in shared(problem).items():
        found[f"readings at one {variable}", "mean", None] = np.max([_both(e[:, rows]) for rows in rows_of], axis=0)
    order = np.concatenate([rows for _, _, rows in sweeps(problem)])
    x = e[:, order]
    of = 2**8 * design.group[order] + design.measured[order]
    same = of[1:] == of[:-1]
    found["neighbours in all sweeps", "mean", None] = (x[:, 1:] * x[:, :-1])[:, same].sum(axis=1) / math.sqrt(
        max(same.sum(), 1)
    )
    covariates = {
        "frequency": design.along("frequency"),
        "amplitude": design.along("amplitude"),
        "predicted size": np.log(np.abs(predicted) * problem.per_um + 0.05),
        "order in the file": in_session(design),
    }
    kinds = {"waveform": design.kinds, "observable": problem.scatter_of(design.measured)}
    n = e.shape[1]
    for name, value in covariates.items():
        if np.ptp(value) < 1e-9:
            continue
        t = 2 * (value - value.min()) / np.ptp(value) - 1
        degree = min(5, len(np.unique(value)) - 1)
        basis, _ = np.linalg.qr(np.polynomial.legendre.legvander(t, degree))
        found[f"trend with {name}", "mean", None] = np.sqrt(np.square(e @ basis[:, 1:]).sum(axis=1))
        # Bins see what a polynomial does not: a step, a spike.
        if degree > 1:
            edges = np.quantile(t, np.linspace(0, 1, 13))
            where = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, 11)
            bins = np.array([(where == b) / math.sqrt(max((where == b).sum(), 1)) for b in range(12)])
            found[f"bins of {name}", "mean", None] = np.sqrt(np.square(e @ bins.T).sum(axis=1))
    for name, kind in kinds.items():
        if np.ptp(kind):
            # What is left of each kind's own level once the common one is taken away.
            levels = np.eye(kind.max() + 1)[kind]
            basis = _spanned(levels[:, 1:] - levels[:, 1:].mean(axis=0))
            found[f"trend with {name}", "mean", None] = np.sqrt(np.square(e @ basis).sum(axis=1))
    size = np.log(np.abs(predicted) * problem.per_um + 0.05)
    size = (size - size.mean()) / max(float(size.std()), 1e-9)
    square = np.minimum(e**2, 9.0)
    found["spread against predicted size", "spread", None] = np.abs(
        (square - square.mean(axis=1, keepdims=True)) @ size
    ) / (math.sqrt(n))
    found["tails", "spread", None] = np.abs(np.mean(np.minimum(np.abs(e), 4.0) ** 4, axis=1) - 3.0)
    found["largest residual", "point", None] = np.abs(e).max(axis=1)
    for id, unit in directions.items():
        found[f"direction of {id}", "mean", None] = (e @ unit.T).max(axis=1)
    return found | _repeated(problem, e, settings.spare)


def _repeated(problem: Problem, e: FloatArray, least: int) -> dict[Key, FloatArray]:
    """Statistics of readings at the same conditions, `least` of them beyond the first of each."""
    found: dict[Key, FloatArray] = {}
    design = problem.design
    repeated = conditions(design)
    in_sessions = [rows for rows in repeated if np.ptp(design.group[rows])]
    if in_sessions:
        found["one condition in two sessions", "replicate", None] = np.sqrt(_scattered(e, in_sessions))
    replicates = [rows[design.group[rows] == k] for rows in repeated for k in np.unique(design.group[rows])]
    # What agrees to the last digit is a copy, or an instrument with too few digits.
    replicates = [rows for rows in replicates if rows.size > 1 and np.ptp(problem.observed[rows]) > 0]
    spare = sum(rows.size - 1 for rows in replicates)
    if spare >= least:
        # Pure error: however wide the fitted scatter is, means of replicates must not scatter more than they do.
        means = np.mean([rows.size * np.square(e[:, rows].mean(axis=1)) for rows in replicates], axis=0)
        found["conditions against their replicates", "mean", None] = np.log(
            (means + 1e-9) / (_scattered(e, replicates) / spare + 1e-9)
        )
    return found


def _spanned(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span the given ones, of which some may be zero."""
    directions, size, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(directions[:, size > 1e-9 * size.max(initial=1.0)])


def shared(problem: Problem) -> dict[Variable, list[NDArray[np.intp]]]:
    """Rows of the design at which several groups that sweep the same variable meet, by that variable.

    A row a group. Values meet that are nearer to each other than half the least step of any of these sweeps.
    """
    ordered: dict[tuple[Variable, int], list[NDArray[np.intp]]] = {}
    for _, variable, rows in sweeps(problem):
        if variable != "time":  # two traces at one time are no replicates
            ordered.setdefault((variable, int(problem.design.measured[rows[0]])), []).append(rows)
    found: dict[Variable, list[NDArray[np.intp]]] = {}
    for (variable, _), groups in ordered.items():
        value, group = problem.design.swept(variable), problem.design.group
        steps = np.concatenate([np.diff(np.unique(value[rows])) for rows in groups])
        rows = np.concatenate(groups)
        rows = rows[np.argsort(value[rows], kind="stable")]
        apart = np.flatnonzero(np.diff(value[rows]) >= 0.5 * steps.min(initial=np.inf)) + 1
        meeting = [part[np.unique(group[part], return_index=True)[1]] for part in np.split(rows, apart)]
        if meeting := [part for part in meeting if part.size > 1]:
            found.setdefault(variable, []).extend(meeting)
    return found


def _both(e: FloatArray) -> FloatArray:
    """How far at least two columns stand out to the same side; (n_sets,)."""
    ordered = np.sort(e, axis=1)
    return np.maximum(ordered[:, -2], -ordered[:, 1])


def in_session(design: Design) -> FloatArray:
    """Place of each reading among those of its session and observable, from -1 to 1; (n_points,)."""
    counts = np.bincount(2**8 * design.group + design.measured)
    return np.concatenate([np.linspace(-1, 1, n) for n in counts if n])


def conditions(design: Design) -> list[NDArray[np.intp]]:
    """Rows of every condition of the rig, and of every moment of a trace."""
    seen: dict[tuple[float, ...], list[int]] = {}
    time = np.where(design.traced, design.time, -1.0)
    for i in range(design.n_points):
        rig = int(design.drive[i]), int(design.rig[i]), int(design.measured[i])
        key = (float(design.frequency[i]), float(design.amplitude[i]), float(time[i]), *rig)
        seen.setdefault(key, []).append(i)
    return [np.array(rows) for rows in seen.values()]


def _scattered(e: FloatArray, parts: Sequence[NDArray[np.intp]]) -> FloatArray:
    """Sum of squares about the means of some columns each; (n_sets,)."""
    return np.asarray(sum(np.square(e[:, c] - e[:, c].mean(axis=1, keepdims=True)).sum(axis=1) for c in parts))


def _windows(x: FloatArray, lengths: tuple[int, ...]) -> tuple[FloatArray, list[tuple[int, int]]]:
    """Standardised sums over windows of some lengths; (n_sets, n_windows), and the windows as (begin, end)."""
    n = x.shape[1]
    total = np.concatenate([np.zeros((len(x), 1)), np.cumsum(x, axis=1)], axis=1)
    columns, spans = [], []
    for width in [w for w in lengths if w < n] + [n]:
        columns.append((total[:, width:] - total[:, :-width]) / math.sqrt(width))
        spans += [(k, k + width) for k in range(n - width + 1)]
    return np.concatenate(columns, axis=1), spans


def _places(
    problem: Problem, e: FloatArray, simulated: FloatArray, predicted: FloatArray, settings: MisfitSettings
) -> tuple[Place, ...]:
    """Stretches that stand out from those of the simulated data, the strongest of each that overlap."""
    design = problem.design
    ordered = [s for s in sweeps(problem) if s[2].size >= settings.fewest]
    if not ordered:
        return ()
    null = np.max(
        [np.abs(_windows(simulated[:, rows], settings.windows)[0]).max(axis=1) for _, _, rows in ordered], axis=0
    )
    bar = float(np.quantile(null, 0.95))
    error = log_ratio(predicted, problem.observed, *problem.metric)
    places = []
    for group_id, variable, rows in ordered:
        score, spans = _windows(e[None, rows], settings.windows)
        left = [(abs(float(z)), float(z), a, b) for z, (a, b) in zip(score[0], spans, strict=True) if abs(z) > bar]
        while left:
            _, z, a, b = max(left)
            values = design.swept(variable)[rows]
            places.append(
                Place(
                    group_id, variable, float(values[a]), float(values[b - 1]), float(error[rows[a:b]].mean()), z,
                    float((1 + np.sum(null >= abs(z))) / (1 + len(null))),
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
    null = np.max([_both(simulated[:, rows]) for meeting in everywhere.values() for rows in meeting], axis=0, initial=0)
    for variable, meeting in everywhere.items():
        for rows in meeting:
            score = float(_both(e[None, rows])[0])
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
                )
            )  # fmt: skip
    return tuple(sorted(found, key=lambda c: -abs(c.score)))


def _character(
    candidate: Candidate,
    catalogue: Sequence[Term],
    statistics: Sequence[Statistic],
    seed: int,
    odd_points: tuple[tuple[GroupId, int], ...],
    settings: MisfitSettings | None,
) -> tuple[Character, tuple[GroupId, ...]]:
    """Say what kind of thing is wrong; see `Misfit`. Groups are left out only with settings for that."""
    kinds = {s.kind for s in statistics if s.significant}
    problem = candidate.problem
    if settings and "mean" in kinds and len(problem.group_ids) > 2:
        suspects = list(dict.fromkeys(s.group for s in statistics if s.significant and s.group is not None))
        clean = []
        for group_id in suspects[:6]:
            others = replace(problem, group_ids=tuple(g for g in problem.group_ids if g != group_id))
            own = problem.observed.size - others.observed.size
            if others.observed.size < max(settings.others * own, 2 * problem.n_physical):
                continue  # too few to find anything wrong
            without = refitted(others, candidate)
            p = examine(
                without, catalogue, seed=seed, n_simulated=settings.n_without, exact=False, influence=False,
                tails=False, settings=settings,
            ).p_value  # fmt: skip
            if p > 0.1:
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

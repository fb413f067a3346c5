r"""Residuals of a fit as normal scores, and the statistics that the tests look at.

Residuals are normal scores :math:`e = \Phi^{-1}(F(y))` of the readings under the fitted scatter, along a trace given
the samples before: what its errors have in common is no order. Statistics look for what a sound fit leaves at random:
order along each sweep (runs, lag one, windows), levels of groups and of waveforms, trends against every covariate, the
directions in which any cause of the catalogue would move the ranges, the spread of groups and of sizes, single
readings, readings of several groups that stand out together at one condition, conditions against the pure error of
their replicates, and conditions that two sessions share; and whether many of these are odd at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from psafit.arrays import FloatArray
from psafit.experiment import GroupId, Swept
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.simulate import Design

Variable = Swept


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
    scale : tuple of float
        Quantiles of the simulated data sets that say how wide a statistic scatters.
    sure : float
        How sure it must be on which side of the tests' level a p value lies, for no more data sets to be simulated.
    most : int
        Data sets that are simulated at most to be sure.
    exact_iterations : int
        Of a refit by the model itself, which begins where that by the expansion ended.
    others : float
        Readings that the other groups need to clear themselves where one is left out, as a share of that group's own.
    n_without : int
        Data sets simulated for the question whether one group is all that is wrong.
    clear : float
        P value from which on nothing is wrong with the others.
    """

    directions: tuple[float, ...] = (0.1, 0.4, 0.75, 0.95)
    windows: tuple[int, ...] = (3, 5, 9, 17, 33)
    clip: float = 6.0
    odd: float = 4.0
    fewest: int = 5
    spare: int = 3
    scale: tuple[float, ...] = (0.75, 0.85, 0.9, 0.95)
    sure: float = 0.95
    most: int = 1_999
    exact_iterations: int = 4
    others: float = 0.5
    n_without: int = 149
    clear: float = 0.1


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
    """The group of a row of the design, and the row of the group's table that holds the reading, from 0."""
    group = problem.design.group
    id = problem.group_ids[group[row]]
    return id, int(problem.experiment.group(id).row[row - np.searchsorted(group, group[row])])


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


Key = tuple[str, str, GroupId | None]


def looks(
    problem: Problem, e: FloatArray, predicted: FloatArray, directions: dict[str, FloatArray], settings: MisfitSettings
) -> dict[Key, FloatArray]:
    """Every statistic of every row of `e`, larger for worse; each (n_sets,)."""
    found: dict[Key, FloatArray] = {}
    design, ordered, scans = problem.design, sweeps(problem), []
    for group_id, variable, rows in ordered:
        x = e[:, rows]
        n, of = rows.size, of_what(problem, rows)
        if n < settings.fewest:
            continue
        root, along = math.sqrt(n), f"{of} along the {variable}"
        found[f"level{of}", "mean", group_id] = np.abs(x.sum(axis=1)) / root
        found[f"neighbours{along}", "mean", group_id] = (x[:, 1:] * x[:, :-1]).sum(axis=1) / root
        found[f"runs{along}", "mean", group_id] = -np.abs(np.diff((x > 0).astype(int), axis=1)).sum(axis=1) / root
        scan = np.abs(windows(x, settings.windows)[0]).max(axis=1)
        found[f"stretches of {variable}{of and ',' + of}", "mean", group_id] = scan
        scans.append(scan)
        found[f"spread{of}", "spread", group_id] = np.abs(np.log(np.mean(x**2, axis=1) + 0.05))
    if scans:
        found["stretches of any sweep", "mean", None] = np.max(scans, axis=0)
    for variable, rows_of in shared(problem).items():
        found[f"readings at one {variable}", "mean", None] = np.max([both(e[:, rows]) for rows in rows_of], axis=0)
    order = np.concatenate([rows for _, _, rows in ordered])
    x = e[:, order]
    of = 2**8 * design.group[order] + design.measured[order]
    same = of[1:] == of[:-1]
    found["neighbours in all sweeps", "mean", None] = (x[:, 1:] * x[:, :-1])[:, same].sum(axis=1) / math.sqrt(
        max(same.sum(), 1)
    )
    size = np.log(np.abs(predicted) * problem.on_one_axis + 0.05)
    covariates = {
        "frequency": design.along("frequency"),
        "amplitude": design.along("amplitude"),
        "predicted size": size,
        "order in the file": in_group(design),
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
    in_sessions = [rows for rows in repeated if np.ptp(design.session[rows])]
    if in_sessions:
        found["one condition in two sessions", "replicate", None] = np.sqrt(_scattered(e, in_sessions))
    replicates = [rows[design.session[rows] == k] for rows in repeated for k in np.unique(design.session[rows])]
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
    """Rows of the design at which sweeps of the same variable meet that were measured in several sessions.

    By that variable, a row a session. Values meet that are nearer to each other than half the least step of any of
    these sweeps; where none has a step, equal ones.
    """
    ordered: dict[tuple[Variable, int], list[NDArray[np.intp]]] = {}
    for _, variable, rows in sweeps(problem):
        if variable != "time":  # two traces at one time are no replicates
            ordered.setdefault((variable, int(problem.design.measured[rows[0]])), []).append(rows)
    found: dict[Variable, list[NDArray[np.intp]]] = {}
    for (variable, _), groups in ordered.items():
        value, session = problem.design.swept(variable), problem.design.session
        steps = np.concatenate([np.diff(np.unique(value[rows])) for rows in groups])
        rows = np.concatenate(groups)
        rows = rows[np.argsort(value[rows], kind="stable")]
        step = 0.5 * steps.min() if steps.size else np.finfo(float).tiny
        apart = np.flatnonzero(np.diff(value[rows]) >= step) + 1
        meeting = [part[np.unique(session[part], return_index=True)[1]] for part in np.split(rows, apart)]
        if meeting := [part for part in meeting if part.size > 1]:
            found.setdefault(variable, []).extend(meeting)
    return found


def both(e: FloatArray) -> FloatArray:
    """How far at least two columns stand out to the same side; (n_sets,)."""
    ordered = np.sort(e, axis=1)
    return np.maximum(ordered[:, -2], -ordered[:, 1])


def in_group(design: Design) -> FloatArray:
    """Place of each reading among those of its group and observable, from -1 to 1; (n_points,)."""
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


def windows(x: FloatArray, lengths: tuple[int, ...]) -> tuple[FloatArray, list[tuple[int, int]]]:
    """Standardised sums over windows of some lengths; (n_sets, n_windows), and the windows as (begin, end)."""
    n = x.shape[1]
    total = np.concatenate([np.zeros((len(x), 1)), np.cumsum(x, axis=1)], axis=1)
    columns, spans = [], []
    for width in [w for w in lengths if w < n] + [n]:
        columns.append((total[:, width:] - total[:, :-width]) / math.sqrt(width))
        spans += [(k, k + width) for k in range(n - width + 1)]
    return np.concatenate(columns, axis=1), spans

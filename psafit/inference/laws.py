r"""Laws that hold whatever the causes are: a fitted model that breaks one is wrong, however well it fits.

* *The tip carries the ball.* A ball moves at least as far as the tip takes it before they part, so that a model's range
  cannot be below the highest place of the ball in contact. At the slowest readings this is the law of vanishing
  frequency: what is read tends to the stroke under load, or more. It is asked of conditions that were measured; what a
  model says of others is not held against it.
* *Energy.* What the ball has gained at its launch is at most the work of the drive.

The range meant is that of the ball, before anything a reading does to it. The first law is asked of every reading by
the stepper; the second by the literal reference, of the farthest launch of every group.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import ConvergenceError
from psafit.inference.candidate import Candidate
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.physics import baseline
from psafit.physics.term import Term
from psafit.records import Broken, Law
from psafit.simulate.batch import MICRO, columns, own_columns, simulate
from psafit.simulate.design import Design
from psafit.simulate.literal import energy
from psafit.simulate.reference import Point
from psafit.text import significant


@dataclass(frozen=True)
class LawSettings:
    """When a law counts as broken.

    Parameters
    ----------
    margin : float
        Widths of a reading's scatter by which a range may lie below what the tip carries the ball to.
    energy : float
        Share of the drive's work by which the ball's energy may exceed it: far above the reference's error.
    """

    margin: float = 2.0
    energy: float = 1e-3


def broken(candidate: Candidate, settings: LawSettings | None = None) -> list[Broken]:
    """Hold a fitted model, at its best mode, against every law."""
    settings = settings or LawSettings()
    design = candidate.problem.design
    terms, theta = _without_reading(candidate)
    # The stepper follows the ball's place, whether a cause asks for it or not.
    found = simulate(design, theta, terms, path="stepper")
    ranges, places = found.launch_range[0], np.nan_to_num(found.separation_place[0])
    asked = (_carried(ranges, places, candidate, settings), _energy(ranges, design, theta, terms, candidate, settings))
    return [one for law in asked for one in law]


def _without_reading(candidate: Candidate) -> tuple[tuple[Term, ...], FloatArray]:
    """The causes that act on the ball, and their parameters as the simulator takes them."""
    problem = candidate.problem
    counts, theta = problem.design.counts, problem.theta(candidate.modes[:1], problem.occasions)[0]
    row = dict(zip(columns(problem.terms, counts), theta, strict=True))
    terms = tuple(t for t in problem.terms if t.slot != "reading")
    return terms, np.array([row[name] for name in columns(terms, counts)])


def _carried(ranges: FloatArray, places: FloatArray, candidate: Candidate, settings: LawSettings) -> Iterator[Broken]:
    short = (places - ranges) * MICRO
    read = candidate.problem.design.measured == OBSERVABLES.index(LAUNCH_RANGE)
    over = read & (short > settings.margin * candidate.scatter)
    if over.any():
        i = int(np.argmax(np.where(over, short, -np.inf)))
        value, limit = float(ranges[i] * MICRO), float(places[i] * MICRO)
        yield _broken(
            "carried", i, value, limit, int(over.sum()), candidate,
            f"the tip carries the ball to {significant(limit, 2)} um, and the model reads {significant(value, 2)}",
        )  # fmt: skip


def _energy(
    ranges: FloatArray,
    design: Design,
    theta: FloatArray,
    terms: Sequence[Term],
    candidate: Candidate,
    settings: LawSettings,
) -> Iterator[Broken]:
    worst: tuple[float, int, float, float] | None = None
    count = 0
    for group in np.unique(design.group):
        own = np.flatnonzero(design.group == group)
        i = int(own[np.argmax(ranges[own])])
        one = design.point(i)
        point = Point(one.drives[one.drive[0]], float(one.frequency[0]), float(one.amplitude[0]))
        pairs = _pairs(theta, terms, design, i)
        try:
            gained, given = energy(point, theta[: len(baseline.PARAMETERS)].tolist(), pairs, one.constants)
        except ConvergenceError:  # the reference gives up: nothing was asked
            continue
        if gained > given * (1 + settings.energy):
            count += 1
            excess = gained / given if given > 0 else np.inf
            worst = max(worst or (0.0, 0, 0.0, 0.0), (float(excess), i, gained, given))
    if worst:
        _, i, gained, given = worst
        text = f"the ball gains {significant(gained * 1e9, 2)} nJ, and the drive gives {significant(given * 1e9, 2)}"
        yield _broken("energy", i, gained, given, count, candidate, text)


def _pairs(theta: FloatArray, terms: Sequence[Term], design: Design, i: int) -> list[tuple[Term, list[float]]]:
    """Each cause with its values at one of a design's points."""
    pairs = []
    for term, own in zip(terms, own_columns(terms, design.counts), strict=True):
        values = theta[own].tolist()
        n = len(term.parameters)  # what differs by instrument changes readings alone, and is left out here
        pairs.append((term, [*values[:n], values[n + int(design.session[i])]] if term.latent else values))
    return pairs


def _broken(law: Law, i: int, value: float, limit: float, readings: int, candidate: Candidate, what: str) -> Broken:
    problem = candidate.problem
    design = problem.design
    group = problem.group_ids[int(design.group[i])]
    f, v = float(design.frequency[i]), float(design.amplitude[i])
    where = f"group {group}, {significant(f, 3)} Hz, {significant(v, 3)} V"
    return Broken(law, list(candidate.ids), group, f, v, value, limit, readings, f"{where}: {what}")

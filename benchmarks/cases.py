"""The models and parameter sets on which psafit and its peers are compared, and the launches they must agree on."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import peers

from psafit.experiment import Experiment, read_experiment
from psafit.inference.problem import Problem
from psafit.physics import TERMS, Term
from psafit.simulate import Design, Simulation, columns, simulate
from psafit.simulate.literal import literal_launch
from psafit.simulate.reference import Point

STUDY: Experiment = read_experiment(Path(__file__).resolve().parent.parent / "experiments" / "psa")
RIG = STUDY.constants
TIGHT = 1e-10  # tolerance of the stepper against which all launches of a batch are compared


def terms(*names: str) -> tuple[Term, ...]:
    """Causes by their identifiers."""
    return tuple(next(t for t in TERMS if t.id == name) for name in names)


def problem(*names: str, groups: tuple[object, ...] | None = None) -> Problem:
    """The study's groups, all six unless named, under the baseline and some causes."""
    return Problem(STUDY, tuple(g.id for g in STUDY.groups) if groups is None else groups, terms(*names))  # type: ignore[arg-type]


def draws(of: Problem, n: int, seed: int) -> np.ndarray:
    """Sets drawn from the prior, in the sampling coordinates."""
    return of.prior_transform(np.random.default_rng(seed).uniform(size=(n, of.n_dim)))


@dataclass(frozen=True)
class Case:
    """All points of the study under one model, at sets drawn from the prior.

    Parameters
    ----------
    names : tuple of str
        Identifiers of the causes.
    n_sets : int
    n_sample : int
        Launches, drawn at random and spread evenly over the sets, on which the peers are timed.
    seed : int
    points : tuple of int, optional
        Some of the study's points only.
    everywhere : bool
        Keep only sets that launch the ball at every point; then the sample is the whole batch.
    """

    names: tuple[str, ...]
    n_sets: int = 32
    n_sample: int = 192
    seed: int = 7
    points: tuple[int, ...] | None = None
    everywhere: bool = False

    @cached_property
    def problem(self) -> Problem:
        return problem(*self.names)

    @cached_property
    def design(self) -> Design:
        every = self.problem.design
        return every if self.points is None else every.points(np.array(self.points))

    @cached_property
    def theta(self) -> np.ndarray:
        n = self.n_sets * (16 if self.everywhere else 1)
        sets = self.problem.to_physical(draws(self.problem, n, self.seed))[:, : self.problem.n_physical]
        if self.everywhere:
            sets = sets[simulate(self.design, sets, self.problem.terms).launched.all(axis=1)]
        return sets[: self.n_sets]

    def run(self, tolerance: float) -> np.ndarray:
        """Launch ranges, m, of the whole batch."""
        return simulate(self.design, self.theta, self.problem.terms, tolerance=tolerance).launch_range

    def speed(self, tolerance: float, path: str | None = None) -> np.ndarray:
        """The ball's speeds at the separation, m/s, of the whole batch."""
        return simulate(self.design, self.theta, self.problem.terms, tolerance=tolerance, path=path).separation_speed

    @cached_property
    def tight(self) -> Simulation:
        """The whole batch by the stepper at a tight tolerance, or in closed form."""
        return simulate(self.design, self.theta, self.problem.terms, tolerance=TIGHT)

    @cached_property
    def sample(self) -> list[tuple[int, int]]:
        """(set, point) of launches."""
        launched = self.tight.launched
        if self.everywhere:
            return [(int(i), int(j)) for i, j in np.argwhere(launched)]
        rng = np.random.default_rng(self.seed + 1)
        usable = [i for i in range(self.n_sets) if launched[i].any()]
        chosen = [usable[k % len(usable)] for k in range(self.n_sample)]
        return [(i, int(rng.choice(np.flatnonzero(launched[i])))) for i in chosen]

    @property
    def size(self) -> int:
        """Number of trajectories of the whole batch."""
        return len(self.theta) * self.design.n_points

    @cached_property
    def trajectories(self) -> list[peers.Trajectory]:
        """The sample as the peers take it."""
        names, when = columns(self.problem.terms), self.tight.separation_time
        return [peers.trajectory(self.design, j, names, self.theta[i], when[i, j]) for i, j in self.sample]

    @cached_property
    def literal(self) -> np.ndarray:
        """Speeds of the sample, m/s, by the literal reference, which shares no code with the simulator."""
        design, speeds = self.design, []
        for i, j in self.sample:
            split, first = [], 3
            for term in self.problem.terms:
                split.append((term, self.theta[i, first : first + len(term.parameters)].tolist()))
                first += len(term.parameters)
            point = Point(design.drives[design.drive[j]], design.frequency[j], design.amplitude[j])
            speeds.append(literal_launch(point, self.theta[i, :3].tolist(), split, RIG).velocity)
        return np.array(speeds)

    def errors(self, ranges: np.ndarray) -> np.ndarray:
        """Relative errors of the batch's launch ranges; 1 where one side launches and the other does not."""
        exact = self.tight.launch_range
        either = (exact > 0.0) | (ranges > 0.0)
        return np.abs(ranges - exact)[either] / np.maximum(exact, ranges)[either]

    def peer_errors(self, speeds: np.ndarray) -> np.ndarray:
        """Relative errors of the sample's launch ranges, which go with the speed's square; 1 where none was found."""
        return np.nan_to_num(np.abs(np.square(speeds / self.literal) - 1.0), nan=1.0)

    def reference_gap(self) -> float:
        """Largest relative difference of the two references over the sample, as launch ranges of a free swing."""
        speeds = np.array([self.tight.separation_speed[i, j] for i, j in self.sample])
        return float(np.abs(np.square(speeds / self.literal) - 1.0).max())

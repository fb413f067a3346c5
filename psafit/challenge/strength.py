r"""How strong a cause must be for an oracle to see it.

Asked for a gain in nats, the search moves the cause's strength along its prior, from neutral outwards. For each
strength the baseline is refitted to readings without scatter by robust least squares. What it leaves, `r` in standard
deviations of the scatter, makes an oracle gain about

.. math:: \max_{s, \nu} \sum_i \ln t_\nu(z_i; s) - \max_{s, \nu} \sum_i \ln t_\nu(z_i + r_i; s) \text{ nats,}

with standard normal :math:`z`: the scatter is fitted as well, and heavy tails swallow a misfit of few readings.

Only the strength is chosen with the fast simulator; the data come from the literal reference.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import qmc
from scipy.stats import t as student

from psafit.arrays import FloatArray
from psafit.challenge.answer import Scatter, standardised
from psafit.inference.optimiser import gradient
from psafit.observables import OBSERVABLES
from psafit.physics import baseline
from psafit.physics.term import Term
from psafit.simulate import Design, readings
from psafit.simulate.sensitivity import Side, plausible, share_above


@dataclass(frozen=True)
class StrengthSettings:
    """How strengths are tried, and how the baseline is refitted to each.

    Parameters
    ----------
    shares : tuple of float
        Strengths tried, as the share of the prior that lies closer to neutral. Stronger causes than the last would
        surprise by themselves: of two hundred rigs one has such a strength.
    halvings : int
        Between the first that is enough and the one before it.
    crowd, more_starts : int
        Draws of the baseline's prior, and starts of a refit from the nearest of them: the refitted baseline may lie far
        from the true one, beyond a ridge that least squares do not cross.
    robust : float
        Residual, in standard deviations, from which on it counts in proportion and no more squared.
    evaluations : int
        Of least squares, at most.
    cloud : int
        Points about an optimum that are looked at for each of the `widths`: launches that appear or are lost make kinks
        and shallow traps, which stop gradients but not a shrinking cloud.
    widths : tuple of float
        Standard deviations of the cloud, in the sampling coordinate.
    hopeless : float
        If the strongest gains less than this part of what is asked for, it is taken: a weaker one seldom beats it.
    no_launch : float
        What stands for a reading that is no number, in standard deviations.
    """

    shares: tuple[float, ...] = (0.02, 0.05, 0.1, 0.17, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.92, 0.97, 0.995)
    halvings: int = 5
    crowd: int = 512
    more_starts: int = 1
    robust: float = 3.0
    evaluations: int = 25
    cloud: int = 48
    widths: tuple[float, ...] = (0.8, 0.4, 0.2, 0.1, 0.05)
    hopeless: float = 0.5
    no_launch: float = 1e6


@dataclass(frozen=True)
class Strength:
    """What the search found.

    Parameters
    ----------
    value : float
        Of the cause's first parameter, in its unit.
    share : float
        Of its prior that lies closer to neutral.
    nats : float
        Expected oracle gain of the cause alone.
    reached : bool
        Whether that is what was asked for, to a quarter.
    """

    value: float
    share: float
    nats: float
    reached: bool


def side_of(term: Term, rng: np.random.Generator) -> Side:
    """Below or above neutral, with the odds of the prior."""
    return 1 if rng.uniform() < share_above(term) else -1


def lost_nats(residual: FloatArray, replicates: int = 4) -> float:
    """Expected log likelihood that this misfit costs, the scatter refitted.

    Parameters
    ----------
    residual : (n_points,) array
        In standard deviations of the scatter.
    replicates : int
        Draws of the scatter that are averaged over.
    """
    z = np.random.default_rng(0).standard_normal((replicates, residual.size))
    # Squared misfits reach far: a common factor on the scatter up to their root mean square.
    most = math.sqrt(1.0 + float(np.mean(np.square(residual))))
    s = np.geomspace(0.4, 1.3 * most, 40)[:, None, None, None]
    nu = np.array([2.0, 2.5, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0, 100.0])[:, None, None]

    def best(y: FloatArray) -> FloatArray:
        return np.asarray(student.logpdf(y, nu, scale=s).sum(axis=-1).max(axis=(0, 1)))

    return max(float(np.mean(best(z) - best(z + residual))), 0.0)


def enough(design: Design, true: FloatArray, share: float = 0.5) -> bool:
    """Whether a share of the readings says something, and every session has one to read.

    A reading that scatter about zero might give says nothing. All samples of a trace say what its largest one does.

    Parameters
    ----------
    design : Design
    true : (n_points,) array
        Readings without scatter, each in its unit.
    share : float
    """
    size, still = np.abs(true), np.empty(design.n_points)
    for k in np.unique(design.measured):
        o = OBSERVABLES[k]
        still[design.measured == k] = o.scatter[1].prior_median if o.traced else o.still
    for group in np.unique(design.group[design.traced]):
        size[design.group == group] = size[design.group == group].max()
    read = set(design.group[legible(design, true)]) == set(design.group)
    return read and float(np.mean(size > still)) >= share


def legible(design: Design, true: FloatArray) -> NDArray[np.bool_]:
    """Which readings there are: of a launch that failed some are not, (n_points,)."""
    return (true > 0.0) | ~np.array([OBSERVABLES[k].blank for k in design.measured])


@dataclass(frozen=True, eq=False)
class _Baseline:
    """The baseline at the conditions of a design, refitted by robust least squares; readings are `standardised`."""

    design: Design
    scatter: Scatter
    truth: FloatArray  # (3,), in the sampling coordinate
    settings: StrengthSettings

    @property
    def bounds(self) -> FloatArray:
        return np.array([[p.sampling_bounds.lower, p.sampling_bounds.upper] for p in baseline.PARAMETERS])

    @cached_property
    def crowd(self) -> tuple[FloatArray, FloatArray]:
        """Draws of the prior, and their readings."""
        parameters = baseline.PARAMETERS
        quantiles = qmc.Sobol(len(parameters), rng=np.random.default_rng(0)).random(self.settings.crowd)
        u = np.stack([p.prior_quantile(quantiles[:, i]) for i, p in enumerate(parameters)], axis=1)
        return u, self.readings(u)

    def readings(self, u: FloatArray) -> FloatArray:
        x = np.stack([p.to_physical(u[:, i]) for i, p in enumerate(baseline.PARAMETERS)], axis=1)
        found = standardised(readings(self.design, x), self.scatter, self.design)
        return np.nan_to_num(found, nan=self.settings.no_launch)

    def lost(self, true: FloatArray, start: FloatArray) -> tuple[float, FloatArray]:
        """What a refit to some readings loses, nats, and where it ends."""
        # Where nothing is read, nothing is lost.
        target = np.where(legible(self.design, true), standardised(true, self.scatter, self.design), np.nan)
        u, found_at = self.crowd
        near = np.argsort(np.nansum(np.square(found_at - target), axis=1))[: self.settings.more_starts]
        ends = [self._least_squares(target, begin) for begin in (start, *u[near])]
        found = min(ends, key=lambda end: end[0])[1]
        rng = np.random.default_rng(0)
        reached = [self._shrunk(target, centre, rng) for centre in (found, self.truth)]
        found = min(reached, key=lambda end: end[0])[1]
        left = self.readings(found[None, :])[0] - target
        return lost_nats(left[np.isfinite(left)]), found

    def _least_squares(self, target: FloatArray, start: FloatArray) -> tuple[float, FloatArray]:
        bounds = self.bounds
        end = least_squares(
            lambda u: np.nan_to_num(self.readings(u[None, :])[0] - target),
            np.clip(start, bounds[:, 0] + 1e-6, bounds[:, 1] - 1e-6),
            jac=lambda u: np.where(np.isfinite(target), gradient(self.readings, u, bounds), 0.0).T,
            bounds=(bounds[:, 0], bounds[:, 1]),
            loss="soft_l1",
            f_scale=self.settings.robust,
            max_nfev=self.settings.evaluations,
            ftol=1e-4,
            xtol=1e-4,
        )
        return float(end.cost), np.asarray(end.x)

    def _shrunk(self, target: FloatArray, centre: FloatArray, rng: np.random.Generator) -> tuple[float, FloatArray]:
        """The best of a cloud that shrinks about its best."""
        s, bounds, least = self.settings, self.bounds, math.inf
        for width in s.widths:
            around = centre + width * np.vstack([np.zeros(3), rng.standard_normal((s.cloud, 3))])
            around = np.clip(around, bounds[:, 0], bounds[:, 1])
            costs = np.nansum(np.sqrt(1.0 + np.square((self.readings(around) - target) / s.robust)), axis=1)
            centre, least = around[np.argmin(costs)], float(costs.min())
        return least, np.asarray(centre)


def find(
    term: Term,
    side: Side,
    others: FloatArray,
    theta: FloatArray,
    design: Design,
    scatter: Scatter,
    nats: float,
) -> Strength:
    """Search for the strength at which an oracle gains `nats`.

    Parameters
    ----------
    term : Term
    side : {-1, 1}
        Of neutral.
    others : (n_parameters - 1 + n_latents,) array
        The cause's other values, in their units.
    theta : (3,) array
        The baseline's.
    design : Design
    scatter : mapping
        As `psafit.challenge.answer.Answer.scatter` has it.
    nats : float

    Returns
    -------
    Strength
        The strongest the prior and the launches allow, if that is not enough.
    """
    settings = StrengthSettings()
    truth = np.array([float(p.to_sampling(x)) for p, x in zip(baseline.PARAMETERS, theta, strict=True)])
    refitted = _Baseline(design, scatter, truth, settings)

    def made(shares: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        values = np.array([plausible(term, s, side)[0] for s in shares])
        rows = np.column_stack([np.tile(theta, (len(values), 1)), values, np.tile(others, (len(values), 1))])
        return values, readings(design, rows, (term,))

    values, every = made(settings.shares)
    usable = [k for k, true in enumerate(every) if enough(design, true)]
    if usable:
        k = usable[-1]
        most, _ = refitted.lost(every[k], truth)
        if most < settings.hopeless * nats:
            return Strength(float(values[k]), settings.shares[k], most, False)
    start, best, low = truth, Strength(float(values[0]), settings.shares[0], 0.0, False), 0.0
    for k in usable:
        share, value = settings.shares[k], float(values[k])
        gain, start = refitted.lost(every[k], start)
        if gain >= nats:
            best = Strength(value, share, gain, True)
            for _ in range(settings.halvings):
                middle = 0.5 * (low + best.share)
                (between,), (true_between,) = made([middle])
                gain, start = refitted.lost(true_between, start)
                if gain >= nats:
                    best = Strength(float(between), middle, gain, True)
                else:
                    low = middle
            return replace(best, reached=best.nats <= 1.25 * nats)
        low = share
        if gain > best.nats:
            best = Strength(value, share, gain, gain >= 0.8 * nats)
    return best

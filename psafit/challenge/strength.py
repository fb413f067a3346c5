r"""How strong a cause must be for an oracle to see it.

Asked for a gain in nats, the search moves the cause's strength along its prior, from neutral outwards. For each
strength the baseline is refitted to ranges without scatter by robust least squares. What it leaves, `r` in standard
deviations of the scatter, makes an oracle gain about

.. math:: \max_{s, \nu} \sum_i \ln t_\nu(z_i; s) - \max_{s, \nu} \sum_i \ln t_\nu(z_i + r_i; s) \text{ nats,}

with standard normal :math:`z`: the scatter is fitted as well, and heavy tails swallow a misfit of few readings.

Only the strength is chosen with the fast simulator; the data come from the literal reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc
from scipy.stats import t as student

from psafit.arrays import FloatArray
from psafit.challenge.answer import Scatter, sizes
from psafit.inference.optimise import gradient
from psafit.physics import baseline
from psafit.physics.term import Term
from psafit.simulate import MICRO, Design, simulate
from psafit.simulate.sensitivity import Side, in_scatter, plausible, share_above

# Stronger causes would surprise by themselves: of two hundred rigs one has such a strength.
MOST = 0.995
# A range below this, um, says nothing; a data set needs half of its readings above it.
LEAST_UM = 1.0
_SHARES = np.array([0.02, 0.05, 0.1, 0.17, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.92, 0.97, MOST])
_HALVINGS = 5
_CROWD, _MORE_STARTS = 512, 1
_REPLICATES = 4
_ROBUST = 3.0
_CLOUD, _WIDTHS = 48, (0.8, 0.4, 0.2, 0.1, 0.05)
_HOPELESS = 0.5
_WORST = 1e6


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


def lost_nats(residual: FloatArray) -> float:
    """Expected log likelihood that this misfit costs, the scatter refitted.

    Parameters
    ----------
    residual : (n_points,) array
        In standard deviations of the scatter.
    """
    z = np.random.default_rng(0).standard_normal((_REPLICATES, residual.size))
    # Squared misfits reach far: a common factor on the scatter up to their root mean square.
    most = math.sqrt(1.0 + float(np.mean(np.square(residual))))
    s = np.geomspace(0.4, 1.3 * most, 40)[:, None, None, None]
    nu = np.array([2.0, 2.5, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0, 100.0])[:, None, None]

    def best(y: FloatArray) -> FloatArray:
        return np.asarray(student.logpdf(y, nu, scale=s).sum(axis=-1).max(axis=(0, 1)))

    return max(float(np.mean(best(z) - best(z + residual))), 0.0)


def enough(ranges_um: FloatArray) -> bool:
    """Whether most readings say something."""
    return float(np.mean(ranges_um > LEAST_UM)) >= 0.5


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
        ``sigma_rel``, ``sigma_abs`` (um).
    nats : float

    Returns
    -------
    Strength
        The strongest the prior and the launches allow, if that is not enough.
    """
    scale = sizes(scatter)
    parameters = baseline.PARAMETERS
    bounds = np.array([[p.sampling_bounds.lower, p.sampling_bounds.upper] for p in parameters])
    truth = np.array([float(p.to_sampling(x)) for p, x in zip(parameters, theta, strict=True)])

    def model(u: FloatArray) -> FloatArray:
        x = np.stack([p.to_physical(u[:, i]) for i, p in enumerate(parameters)], axis=1)
        return np.nan_to_num(in_scatter(simulate(design, x).launch_range * MICRO, *scale), nan=_WORST)

    # The refitted baseline may lie far from the true one, beyond a ridge that least squares do not cross.
    quantiles = qmc.Sobol(len(parameters), rng=np.random.default_rng(0)).random(_CROWD)
    crowd = np.stack([p.prior_quantile(quantiles[:, i]) for i, p in enumerate(parameters)], axis=1)
    crowd_model = model(crowd)

    def ranges(shares: FloatArray) -> tuple[FloatArray, FloatArray]:
        values = np.array([plausible(term, float(s), side)[0] for s in shares])
        rows = np.column_stack([np.tile(theta, (len(values), 1)), values, np.tile(others, (len(values), 1))])
        return values, simulate(design, rows, (term,)).launch_range * MICRO

    def expected(um: FloatArray, start: FloatArray) -> tuple[float, FloatArray]:
        target = in_scatter(um, *scale)
        near = np.argsort(np.square(crowd_model - target).sum(axis=1))[:_MORE_STARTS]
        ends = [
            least_squares(
                lambda u: model(u[None, :])[0] - target,
                np.clip(u, bounds[:, 0] + 1e-6, bounds[:, 1] - 1e-6),
                jac=lambda u: gradient(model, u, bounds).T,
                bounds=(bounds[:, 0], bounds[:, 1]),
                loss="soft_l1",
                f_scale=_ROBUST,
                max_nfev=25,
                ftol=1e-4,
                xtol=1e-4,
            )
            for u in (start, *crowd[near])
        ]
        found = min(ends, key=lambda end: float(end.cost)).x

        # Launches that appear or are lost make kinks and shallow traps, which stop gradients but not a shrinking cloud.
        rng = np.random.default_rng(0)
        reached = []
        for centre in (found, truth):
            for width in _WIDTHS:
                around = centre + width * np.vstack([np.zeros(3), rng.standard_normal((_CLOUD, 3))])
                around = np.clip(around, bounds[:, 0], bounds[:, 1])
                costs = np.sqrt(1.0 + np.square((model(around) - target) / _ROBUST)).sum(axis=1)
                centre = around[np.argmin(costs)]
            reached.append((float(costs.min()), centre))
        found = min(reached, key=lambda end: end[0])[1]
        return lost_nats(model(found[None, :])[0] - target), np.asarray(found)

    values, all_um = ranges(_SHARES)
    usable = [k for k, um in enumerate(all_um) if enough(um)]
    if usable:
        k = usable[-1]
        most, _ = expected(all_um[k], truth)
        if most < _HOPELESS * nats:  # the strongest is seldom beaten by a weaker one
            return Strength(float(values[k]), float(_SHARES[k]), most, False)
    start, best, low = truth, Strength(float(values[0]), float(_SHARES[0]), 0.0, False), 0.0
    for share, value, um in zip(_SHARES, values, all_um, strict=True):
        if not enough(um):
            continue
        gain, start = expected(um, start)
        if gain >= nats:
            high = float(share)
            best = Strength(float(value), high, gain, True)
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                (between,), (um_between,) = ranges(np.array([middle]))
                gain, start = expected(um_between, start)
                if gain >= nats:
                    high = middle
                    best = Strength(float(between), middle, gain, True)
                else:
                    low = middle
            return Strength(best.value, best.share, best.nats, best.nats <= 1.25 * nats)
        low = float(share)
        if gain > best.nats:
            best = Strength(float(value), float(share), gain, gain >= 0.8 * nats)
    return best

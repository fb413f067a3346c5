"""A fitting problem: measurements, a model with priors, and the posterior density, for batches of parameter sets."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import Experiment, Group, GroupId, Occasions, session_name
from psafit.experiment.text import listed
from psafit.inference import noise
from psafit.observables import LAUNCH_RANGE, OBSERVABLES, Observable
from psafit.parameters import Bounds, Parameter
from psafit.physics import baseline, informed, informed_scatter
from psafit.physics.term import Term
from psafit.simulate import Design, readings
from psafit.simulate.stepper import TOLERANCE


def refuse_still(groups: Iterable[Group]) -> None:
    """Refuse groups in which the ball was never launched.

    Raises
    ------
    InputError
        If every reading is zero: any model does for that which is weak enough.
    """
    groups = tuple(groups)
    if not any(group.reading.any() for group in groups):
        what = " and every ".join(dict.fromkeys(o.title for g in groups for o in g.observables))
        where = f"group{'s' * (len(groups) > 1)} {listed(str(group.id) for group in groups)}"
        raise InputError(
            f"every {what} is zero in {where}", "choose other groups, or measure where the ball is launched"
        )


@dataclass(frozen=True)
class Problem:
    """The model against some groups of an experiment.

    Parameter sets are rows in the *sampling coordinate* of each parameter (see `psafit.parameters`): the baseline's
    parameters, those of the causes, what each fitted session has for itself, and the scatter's last.

    Parameters
    ----------
    experiment : Experiment
    group_ids : tuple of group ids
        The groups the likelihood sees.
    terms : tuple of Term
        Causes that extend the baseline. They get the priors that the experiment states.
    tolerance : float
        Of the simulator; see `psafit.simulate.simulate`.
    usual_tails : bool
        Whether the scatter's degrees of freedom are held to the upper half of their prior: no heavier tails than are
        usual.
    """

    experiment: Experiment
    group_ids: tuple[GroupId, ...]
    terms: tuple[Term, ...] = ()
    tolerance: float = TOLERANCE
    usual_tails: bool = False

    def __post_init__(self) -> None:
        if not self.group_ids:
            raise InputError("no group to fit", "give at least one group id")
        if len(set(self.group_ids)) < len(self.group_ids):
            raise InputError("a group is named twice", "its readings would count twice: name it once")
        for group_id in self.group_ids:
            self.experiment.group(group_id)
        object.__setattr__(self, "terms", informed(self.experiment.beliefs, self.terms)[1])

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, in the order of the columns."""
        plain, _ = informed(self.experiment.beliefs, ())
        own = tuple(p for term in self.terms for p in term.parameters)
        return plain + own + self._latents + self.scatter

    @cached_property
    def observables(self) -> tuple[Observable, ...]:
        """What the experiment's groups read. Each has a scatter of its own, even where it is not fitted."""
        kinds = np.unique(np.concatenate([g.measured for g in self.experiment.groups]))
        return tuple(OBSERVABLES[k] for k in kinds)

    @cached_property
    def scatter(self) -> tuple[Parameter, ...]:
        """The scatter's parameters: three an observable, and for a trace its correlation time."""
        found = [informed_scatter(self.experiment.beliefs, o) for o in self.observables]
        if self.usual_tails:
            held = [replace(nu, bounds=Bounds(nu.prior_median, nu.bounds.upper)) for _, _, nu, *_ in found]
            found = [(one[0], one[1], nu, *one[3:]) for one, nu in zip(found, held, strict=True)]
        return tuple(p for one in found for p in one)

    @cached_property
    def scatter_at(self) -> tuple[slice, ...]:
        """Where the parameters of each of `observables` are among those of the scatter."""
        ends = np.cumsum([0, *(len(o.scatter) for o in self.observables)]).tolist()
        return tuple(slice(a, b) for a, b in itertools.pairwise(ends))

    @property
    def ids(self) -> tuple[str, ...]:
        """Identifiers of the causes."""
        return tuple(t.id for t in self.terms)

    @cached_property
    def occasions(self) -> Occasions:
        """When the fitted groups were measured, and by what."""
        return self.occasions_of(self.group_ids)

    def occasions_of(self, group_ids: Sequence[GroupId]) -> Occasions:
        """When some groups of the experiment were measured, and by what, as their design numbers it."""
        return Occasions.of(map(self.experiment.group, group_ids))

    def named_for(self, term: Term, part: Group) -> tuple[GroupId | None, str | None]:
        """The names of the session and the instrument that have a latent value of a cause, None where there is none.

        `part` is what one observable has in a group. A session has a name if it is given one, or if several groups of
        the experiment were measured in it.
        """
        n_groups = sum(g.session_id == part.session_id for g in self.experiment.groups)
        session = None if part.session is None and n_groups == 1 else part.session_id
        return session, None if term.per == "sessions" else part.instrument

    @cached_property
    def _latents(self) -> tuple[Parameter, ...]:
        return tuple(
            replace(term.latent, name=session_name(term.latent.name, g), description=f"{term.latent.description}, {g}")
            for term in self.terms
            if term.latent
            for g in term.having(self.occasions)
        )

    @cached_property
    def blocks(self) -> NDArray[np.intp]:
        """Which parameters belong together: each of the baseline's and the scatter's alone, a cause's; (n_dim,)."""
        n = len(baseline.PARAMETERS)
        causes = [n + k for k, term in enumerate(self.terms) for _ in term.parameters]
        of = ((k, term) for k, term in enumerate(self.terms) if term.latent)
        latents = [n + k for k, term in of for _ in term.having(self.occasions)]
        last = n + len(self.terms)
        return np.array([*range(n), *causes, *latents, *range(last, last + len(self.scatter))])

    @property
    def n_physical(self) -> int:
        """Number of parameters of the baseline and the causes."""
        return self.n_model - len(self._latents)

    @property
    def n_model(self) -> int:
        """Number of parameters that the prediction depends on: all but the scatter's."""
        return self.n_dim - len(self.scatter)

    @property
    def names(self) -> tuple[str, ...]:
        """Parameter names, in the order of the columns."""
        return tuple(p.name for p in self.parameters)

    @property
    def n_dim(self) -> int:
        """Number of parameters."""
        return len(self.parameters)

    @cached_property
    def design(self) -> Design:
        """Conditions of the fitted readings."""
        return self.design_of(self.group_ids)

    def design_of(self, group_ids: Sequence[GroupId]) -> Design:
        """Conditions of other groups of the same experiment."""
        return Design.of(self.experiment.constants, [self.experiment.group(g) for g in group_ids])

    def thinned(self, every: int) -> Self:
        """Return the problem with every so many-th reading; see `psafit.experiment.Experiment.thinned`."""
        return replace(self, experiment=self.experiment.thinned(every))

    @cached_property
    def observed(self) -> FloatArray:
        """Readings, each in the unit of its observable, (n_points,)."""
        return np.concatenate([self.experiment.group(g).reading for g in self.group_ids])

    @cached_property
    def known_sigma(self) -> FloatArray | None:
        """The readings' own uncertainties, (n_points,); zero where a group gives none."""
        groups = [self.experiment.group(g) for g in self.group_ids]
        if all(g.sigma is None for g in groups):
            return None
        return np.concatenate([np.zeros(g.reading.size) if g.sigma is None else g.sigma for g in groups])

    @cached_property
    def bounds(self) -> FloatArray:
        """Bounds in the sampling coordinate, (n_dim, 2)."""
        return np.array([[p.sampling_bounds.lower, p.sampling_bounds.upper] for p in self.parameters])

    @cached_property
    def widths(self) -> FloatArray:
        """Distance of the bounds in the sampling coordinate, (n_dim,)."""
        return np.asarray(np.ptp(self.bounds, axis=1))

    def inside(self, u: FloatArray, margin: float = 1e-3) -> FloatArray:
        """A point, in sampling coordinates, moved off the bounds by a margin at least."""
        return np.clip(u, self.bounds[:, 0] + margin, self.bounds[:, 1] - margin)

    def without(self, *gone: Term) -> tuple[Problem, list[int]]:
        """The problem without some of its causes, and which of the coordinates are left."""
        rest = replace(self, terms=tuple(t for t in self.terms if t not in gone))
        return rest, [self.names.index(name) for name in rest.names]

    def to_physical(self, u: FloatArray) -> FloatArray:
        """Parameter values of sampling coordinates; last axis n_dim."""
        return np.stack([p.to_physical(u[..., i]) for i, p in enumerate(self.parameters)], axis=-1)

    def to_sampling(self, x: FloatArray) -> FloatArray:
        """Sampling coordinates of parameter values; last axis n_dim."""
        return np.stack([p.to_sampling(x[..., i]) for i, p in enumerate(self.parameters)], axis=-1)

    def implausible(self, values: FloatArray) -> list[str]:
        """Names of the parameters that come out where their priors are thin: `Parameter.is_implausible`.

        Those of the scatter, too, since one far above its prior hides a misfit; not what sessions have for themselves.

        Parameters
        ----------
        values : (n_dim,) array
            In the parameters' units.
        """
        own = [*range(self.n_physical), *range(self.n_model, self.n_dim)]
        return [self.names[i] for i in own if self.parameters[i].is_implausible(float(values[i]))]

    def prior_transform(self, p: FloatArray) -> FloatArray:
        """Sampling coordinates at which each prior holds the fraction `p`; last axis n_dim."""
        return np.stack([q.prior_quantile(p[..., i]) for i, q in enumerate(self.parameters)], axis=-1)

    @property
    def medians(self) -> FloatArray:
        """Sampling coordinates of the priors' medians, (n_dim,)."""
        return np.array([p.prior_middle[1] for p in self.parameters])

    @property
    def prior_widths(self) -> FloatArray:
        """Widths of the priors' middle 68 % in the sampling coordinates, (n_dim,)."""
        return np.array([p.prior_middle[2] - p.prior_middle[0] for p in self.parameters])

    def predict(
        self, u: FloatArray, group_ids: Sequence[GroupId] | None = None, rng: np.random.Generator | None = None
    ) -> FloatArray:
        """What would be read without scatter, each reading in its unit; (n_sets, n_points).

        Parameters
        ----------
        u : (n_sets, n_dim) array
        group_ids : sequence of group ids, optional
            Which groups to predict; the fitted ones by default.
        rng : Generator, optional
            Draws what a session not fitted has for itself from its prior; the prior's median without one.
        """
        design = self.design if group_ids is None else self.design_of(group_ids)
        occasions = self.occasions if group_ids is None else self.occasions_of(group_ids)
        return readings(design, self.theta(u, occasions, rng), self.terms, tolerance=self.tolerance)

    def theta(self, u: FloatArray, occasions: Occasions, rng: np.random.Generator | None = None) -> FloatArray:
        """Physical values of `u` in the columns that the simulator takes for a design of `occasions`; see `predict`."""
        x = self.to_physical(u)
        n = len(baseline.PARAMETERS)
        blocks, first, latent = [x[:, :n]], n, self.n_physical
        for term in self.terms:
            blocks.append(x[:, first : first + len(term.parameters)])
            first += len(term.parameters)
            if term.latent:
                known = term.having(self.occasions)
                for id in occasions.numbered(term.per):
                    if id in known:
                        blocks.append(x[:, [latent + known.index(id)]])
                    else:
                        p = np.full(len(u), 0.5) if rng is None else rng.uniform(size=len(u))
                        blocks.append(term.latent.to_physical(term.latent.prior_quantile(p))[:, None])
                latent += len(known)
        return np.concatenate(blocks, axis=1)

    def noise_values(self, u: FloatArray, group: Group | None = None) -> FloatArray:
        """The scatter's parameters as `noise.scale` takes them; (n_sets, 3), or (n_sets, 3 or 4, n_points).

        Parameters
        ----------
        u : (n_sets, n_dim) array
        group : Group, optional
            Whose readings scatter; the fitted ones by default.
        """
        design = self.design if group is None else Design.of(self.experiment.constants, [group])
        return self.noise_of(self.to_physical(u)[:, self.n_model :], design)

    def noise_of(self, values: FloatArray, design: Design) -> FloatArray:
        """Values of the scatter's parameters, (n_sets, n_dim - n_model), as `noise_values` has them for a design."""
        if len(self.observables) == 1 and not self.observables[0].traced:
            return values
        own = zip(self.observables, self.scatter_at, strict=True)
        return noise.by_reading({OBSERVABLES.index(o): values[:, at] for o, at in own}, design)

    def scatter_to_come(self, u: FloatArray, measured: int) -> FloatArray:
        """The scatter's parameters of readings to come of one observable, (n_sets, 3).

        Those of an observable that was not read have the medians of their priors.
        """
        observable = OBSERVABLES[measured]
        if observable in self.observables:
            values = self.to_physical(u)[:, self.n_model :]
            return np.asarray(values[:, self.scatter_at[self.observables.index(observable)]])
        known = informed_scatter(self.experiment.beliefs, observable)
        return np.tile([p.prior_median for p in known], (len(u), 1))

    def sigma_to_come(self, measured: int) -> float | None:
        """Usual uncertainty of readings to come of one observable: the median, where most readings of it state one.

        None of others than `Design.usually_measured`.
        """
        if self.known_sigma is None or measured != self.design.usually_measured:
            return None
        known = self.known_sigma[self.design.measured == measured]
        stated = known[known > 0]
        return float(np.median(stated)) if 2 * stated.size > known.size else None

    def scatter_of(self, measured: NDArray[np.int8]) -> NDArray[np.intp]:
        """Which of `observables` each reading is of, (n_points,)."""
        return np.searchsorted([OBSERVABLES.index(o) for o in self.observables], measured)

    @cached_property
    def floor(self) -> FloatArray:
        """What no instrument shows less of at each reading, (n_points,): zero, of launches; nothing, along a trace."""
        groups = (self.experiment.group(g) for g in self.group_ids)
        return np.concatenate([np.full(g.n_points, g.floor) for g in groups])

    @cached_property
    def on_one_axis(self) -> FloatArray:
        """What a reading is multiplied by so that readings of all observables can stand on one axis, (n_points,).

        The offsets of the error metric are the scale: it is one for launch ranges.
        """
        return LAUNCH_RANGE.offset / self.offset

    @cached_property
    def rows_of_scatter(self) -> tuple[NDArray[np.intp] | slice, ...]:
        """Rows of the fitted readings that each of `observables` has; there may be none."""
        if len(self.observables) == 1:
            return (slice(None),)
        of = self.scatter_of(self.design.measured)
        return tuple(np.flatnonzero(of == j) for j in range(len(self.observables)))

    @cached_property
    def offset(self) -> FloatArray:
        """Offset of the error metric at each reading, in its unit, (n_points,)."""
        return np.array([OBSERVABLES[k].offset for k in self.design.measured])

    @cached_property
    def metric(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """What the error metric takes of the fitted readings; see `Observable.metric`."""
        return self.offset, self.design.traced

    @cached_property
    def _shapes(self) -> FloatArray:
        """The shape of each log prior, (5, n_dim), as `Parameter.shape` has it; NaN where it is of another kind."""
        return np.array([p.shape or (np.nan,) * 5 for p in self.parameters]).T

    def log_prior(self, u: FloatArray) -> FloatArray:
        """Log prior density in the sampling coordinate, minus infinity outside the bounds; (n_sets,)."""
        centre, width, top, wide, broad = self._shapes
        away = u - centre
        each = top - 0.5 * np.square(away / width)
        tailed = np.isfinite(broad)
        if tailed.any():
            tail = broad[tailed] - np.log1p(np.square(away[:, tailed] / wide[tailed]))
            each[:, tailed] = np.logaddexp(each[:, tailed], tail)
        for i in np.flatnonzero(np.isnan(top)):
            each[:, i] = self.parameters[i].log_prior(u[:, i])
        inside = ((u >= self.bounds[:, 0]) & (u <= self.bounds[:, 1])).all(axis=1)  # False for NaN too
        return np.where(inside, each.sum(axis=1), -np.inf)

    def prior_slopes(self, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """First derivative, and negative second, of the log prior by each coordinate; (n_sets, n_dim) each.

        Where the log prior bends upwards, in a tail, zero stands for the second.
        """
        centre, width, top, wide, broad = self._shapes
        second = np.broadcast_to(width**-2.0, u.shape).copy()
        first = (centre - u) * second
        tailed = np.isfinite(broad)
        if tailed.any():
            away, half = (u - centre)[:, tailed], wide[tailed]
            bulge = 1.0 + np.square(away / half)
            tail = broad[tailed] - np.log(bulge)
            part = expit(top[tailed] - 0.5 * np.square(away / width[tailed]) - tail)  # the core's share of the density
            flat = -2.0 * away / (half**2 * bulge)
            bent = 2.0 * (1.0 - np.square(away / half)) / np.square(half * bulge)
            steep, curved = first[:, tailed], second[:, tailed]
            slope = part * steep + (1.0 - part) * flat
            first[:, tailed] = slope
            second[:, tailed] = np.maximum(
                part * curved + (1.0 - part) * bent - part * (1.0 - part) * np.square(steep - flat), 0.0
            )
        h = 1e-3
        for i in np.flatnonzero(np.isnan(top)):
            inside = np.clip(u[:, i], self.bounds[i, 0] + h, self.bounds[i, 1] - h)
            low, mid, high = (self.parameters[i].log_prior(inside + d) for d in (-h, 0.0, h))
            second[:, i] = np.maximum((2 * mid - low - high) / h**2, 0.0)
            # Where the point was moved inside, the slope goes on linearly.
            first[:, i] = (high - low) / (2 * h) - second[:, i] * (u[:, i] - inside)
        return first, second

    def pointwise_log_likelihood(self, u: FloatArray) -> FloatArray:
        """Log density of every reading; (n_sets, n_points)."""
        return noise.log_density(self.observed, self.predict(u), self.noise_values(u), self.known_sigma)

    def log_likelihood(self, u: FloatArray) -> FloatArray:
        """Sum of `pointwise_log_likelihood`; (n_sets,)."""
        return self.pointwise_log_likelihood(u).sum(axis=1)

    def log_posterior(self, u: FloatArray) -> FloatArray:
        """Unnormalised log posterior in the sampling coordinate; minus infinity outside the bounds.

        Parameters
        ----------
        u : (n_sets, n_dim) array

        Returns
        -------
        (n_sets,) array
        """
        value = self.log_prior(u)
        inside = np.isfinite(value)
        if inside.any():
            value[inside] += self.log_likelihood(u[inside])
        return value

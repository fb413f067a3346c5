r"""Parameters: what is possible (bounds), what is plausible (prior), and the coordinate they are sampled in.

Every prior is a truncated normal, one with a broad part besides, or a uniform density in the *sampling coordinate*
:math:`u`, which is :math:`\ln x` for scales (stiffness, damping, scatter) and otherwise :math:`x` in units of the
prior's own width, so that steps of searchers and samplers mean the same in every coordinate. Densities are normalised
over the bounds, so that model evidences compare.
"""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import log_ndtr, ndtr, ndtri

from psafit.arrays import FloatArray

Coordinate = Literal["linear", "log"]
SHARES = np.linspace(0.0005, 0.9995, 1000)


@dataclass(frozen=True)
class Bounds:
    """Closed interval of possible values, in the parameter's unit."""

    lower: float
    upper: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper):
            raise ValueError(f"bounds need finite lower < upper, got [{self.lower}, {self.upper}]")


class Prior(Protocol):
    """A density in the value or its logarithm, truncated to an interval."""

    @property
    def coordinate(self) -> Coordinate:
        """The coordinate it lives in."""

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies."""

    def describe(self) -> str:
        """Words for tables."""


def _truncated_normal_log_density(u: FloatArray, mean: float, sd: float, lower: float, upper: float) -> FloatArray:
    a, b = (lower - mean) / sd, (upper - mean) / sd
    if a > 0:  # difference of the smaller tail keeps its digits
        a, b = -b, -a
    log_mass = log_ndtr(b) + math.log1p(-math.exp(log_ndtr(a) - log_ndtr(b)))
    z = (u - mean) / sd
    return -0.5 * z * z - 0.5 * math.log(2 * math.pi) - math.log(sd) - log_mass


def _truncated_normal_quantile(p: FloatArray, mean: float, sd: float, lower: float, upper: float) -> FloatArray:
    a, b = ndtr((lower - mean) / sd), ndtr((upper - mean) / sd)
    return np.clip(mean + sd * ndtri(a + p * (b - a)), lower, upper)


@dataclass(frozen=True)
class Normal:
    """Normal prior on the value itself (half-normal when a bound sits at the mean)."""

    mean: float
    sd: float
    coordinate: Coordinate = field(default="linear", init=False)

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""
        return _truncated_normal_log_density(u, self.mean, self.sd, lower, upper)

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies."""
        return _truncated_normal_quantile(p, self.mean, self.sd, lower, upper)

    def describe(self) -> str:
        """Words for tables."""
        return f"normal, mean {self.mean:g}, sd {self.sd:g}"


@dataclass(frozen=True)
class LogNormal:
    """Normal prior on the logarithm: `median`, and the `factor` that one standard deviation means."""

    median: float
    factor: float
    coordinate: Coordinate = field(default="log", init=False)

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""
        return _truncated_normal_log_density(u, math.log(self.median), math.log(self.factor), lower, upper)

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies."""
        return _truncated_normal_quantile(p, math.log(self.median), math.log(self.factor), lower, upper)

    def describe(self) -> str:
        """Words for tables."""
        return f"log-normal, median {self.median:g}, factor {self.factor:g} for one sd"


@dataclass(frozen=True)
class Uniform:
    """Uniform prior between the bounds, in the value or in its logarithm."""

    coordinate: Coordinate = "linear"

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""
        return np.full(np.shape(u), -math.log(upper - lower))

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies."""
        return lower + np.asarray(p) * (upper - lower)

    def describe(self) -> str:
        """Words for tables."""
        return "uniform" if self.coordinate == "linear" else "uniform in the logarithm"


def _middle(part: Normal | LogNormal) -> tuple[float, float]:
    """Centre and standard deviation, in the coordinate it lives in."""
    if isinstance(part, Normal):
        return part.mean, part.sd
    return math.log(part.median), math.log(part.factor)


def _normal_share(x: FloatArray, mean: float, sd: float, lower: float, upper: float) -> FloatArray:
    """Part of a truncated normal density below `x`."""
    below, above = ndtr((lower - mean) / sd), ndtr((upper - mean) / sd)
    return np.asarray((ndtr((x - mean) / sd) - below) / (above - below))


def _bisected(
    share: Callable[[FloatArray], FloatArray], p: FloatArray, low: FloatArray, high: FloatArray
) -> FloatArray:
    """The place between `low` and `high` where a growing share is `p`, to the last digit."""
    while True:
        middle = 0.5 * (low + high)
        if not ((low < middle) & (middle < high)).any():
            return middle
        short = share(middle) < p
        low, high = np.where(short, middle, low), np.where(short, high, middle)


@dataclass(frozen=True)
class Tailed:
    r"""A normal prior with a broad part: what is far from plausible costs a dozen nats, not a thousand.

    .. math:: (1 - s)\, N(u) + s\, C(u), \qquad C = \text{Cauchy's density about the same middle}.

    A normal density forbids what lies dozens of standard deviations off as surely as a bound does, without the reason
    that a bound needs. Where it stands for a physical quantity, a few per cent belong to all that nobody thought of.
    Both parts are normalised over the bounds.

    Parameters
    ----------
    core : Normal or LogNormal
        What is plausible.
    share : float
        Probability of the broad part.
    widening : float
        Half width at half maximum of the broad part, in standard deviations of the core.
    """

    core: Normal | LogNormal
    share: float = 0.05
    widening: float = 3.0

    @property
    def coordinate(self) -> Coordinate:
        """The coordinate it lives in."""
        return self.core.coordinate

    @property
    def middle(self) -> tuple[float, float]:
        """Centre and standard deviation of the core, in the coordinate it lives in."""
        return _middle(self.core)

    def _broad(self, lower: float, upper: float) -> tuple[float, float, float, float]:
        """Centre and half width of the broad part, and its angles at the bounds."""
        centre, sd = self.middle
        width = self.widening * sd
        return centre, width, math.atan((lower - centre) / width), math.atan((upper - centre) / width)

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""
        centre, width, a, b = self._broad(lower, upper)
        broad = -np.log1p(np.square((u - centre) / width)) - math.log(width * (b - a))
        core = self.core.log_density(u, lower, upper)
        return np.logaddexp(core + math.log1p(-self.share), broad + math.log(self.share))

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies: between the quantiles of the two parts, by bisection."""
        p = np.asarray(p, dtype=float)
        centre, width, a, b = self._broad(lower, upper)
        ends = [
            self.core.quantile(p, lower, upper),
            np.clip(centre + width * np.tan(a + p * (b - a)), lower, upper),
        ]

        def below(x: FloatArray) -> FloatArray:
            core = _normal_share(x, *self.middle, lower, upper)
            broad = (np.arctan((x - centre) / width) - a) / (b - a)
            return (1 - self.share) * core + self.share * broad

        return _bisected(below, p, np.minimum(*ends), np.maximum(*ends))

    def describe(self) -> str:
        """Words for tables."""
        return f"{self.core.describe()}; {100 * self.share:g} % in a Cauchy tail {self.widening:g} times as wide"


@dataclass(frozen=True)
class Mixture:
    """A prior of several parts, as of a factor that is one of a few: each as likely as its weight.

    Parameters
    ----------
    parts : tuple of (float, Normal or LogNormal)
        Weights, which sum to one, and priors that live in one coordinate. Each is normalised over the bounds.
    """

    parts: tuple[tuple[float, Normal | LogNormal], ...]

    def __post_init__(self) -> None:
        if len({p.coordinate for _, p in self.parts}) != 1 or not math.isclose(sum(w for w, _ in self.parts), 1.0):
            raise ValueError("parts of a mixture live in one coordinate, and their weights sum to one")

    @property
    def coordinate(self) -> Coordinate:
        """The coordinate it lives in."""
        return self.parts[0][1].coordinate

    def log_density(self, u: FloatArray, lower: float, upper: float) -> FloatArray:
        """Log density at `u`, normalised over [lower, upper]."""
        each = [math.log(w) + p.log_density(u, lower, upper) for w, p in self.parts]
        return np.logaddexp.reduce(each, axis=0)

    def quantile(self, p: FloatArray, lower: float, upper: float) -> FloatArray:
        """Point below which the fraction `p` of the mass lies: between the quantiles of the parts, by bisection."""
        p = np.asarray(p, dtype=float)
        ends = [part.quantile(p, lower, upper) for _, part in self.parts]

        def below(x: FloatArray) -> FloatArray:
            shares = [w * _normal_share(x, *_middle(part), lower, upper) for w, part in self.parts]
            return np.sum(shares, axis=0)

        return _bisected(below, p, np.min(ends, axis=0), np.max(ends, axis=0))

    def describe(self) -> str:
        """Words for tables."""
        return "; ".join(f"{100 * w:g} % {part.describe()}" for w, part in self.parts)


def broadened(prior: Prior, factor: float) -> Prior | None:
    """A prior about the same middle, so many times as wide; None where it has no middle."""
    if isinstance(prior, Tailed):
        core = broadened(prior.core, factor)
        return replace(prior, core=core)  # type: ignore[arg-type]
    if isinstance(prior, Normal):
        return Normal(prior.mean, prior.sd * factor)
    return LogNormal(prior.median, prior.factor**factor) if isinstance(prior, LogNormal) else None


@dataclass(frozen=True)
class Belief:
    """What is known beforehand of a parameter of a certain rig: its values, whether its cause is at work, or both.

    Parameters
    ----------
    name : str
        Of the parameter.
    prior : Normal, LogNormal or Tailed, or None
        What somebody states is taken as it is stated; what follows from facts has heavy tails. None where no more is
        known of the values than usual, and only `probability` is stated.
    source : str
        How it is known.
    file, line : Path and int, optional
        Where it stands, for messages.
    probability : float, optional
        That the cause of the parameter is at work, in the place of what its file declares. Where several are given for
        one cause, see `leading_belief`.
    derived : bool
        Whether it follows from what the rig is made of, and was not stated itself.
    bounds : Bounds, optional
        What is possible on this rig, in the place of what is possible on any.
    """

    name: str
    prior: Normal | LogNormal | Tailed | None
    source: str
    file: Path | None = field(default=None, compare=False)
    line: int | None = field(default=None, compare=False)
    probability: float | None = None
    derived: bool = False
    bounds: Bounds | None = None

    def describe(self) -> str:
        """Words for tables."""
        said = [] if self.prior is None else [self.prior.describe()]
        return "; ".join([*said, *([] if self.probability is None else [f"at work: {self.probability:g}"])])


def leading_belief(beliefs: Iterable[Belief]) -> Belief | None:
    """Return the belief that says how probable one cause is to be at work; None where none does.

    What is stated comes before what follows from the rig, and the greatest before others.
    """
    said = ((not b.derived, b.probability, b) for b in beliefs if b.probability is not None)
    *_, found = max(said, key=lambda one: one[:2], default=(None,))
    return found


@dataclass(frozen=True)
class Parameter:
    """One quantity to identify.

    Parameters
    ----------
    name : str
        Python identifier, unique within a model.
    symbol : str
        LaTeX, without dollar signs.
    unit : str
        SI unit; "1" for a pure number.
    bounds : Bounds
        What is possible.
    prior : Prior
        What is plausible.
    description : str
        One line for tables.
    source : str
        Where the prior comes from.
    neutral : float, optional
        Value at which the parameter has no effect; None where there is none.
    reciprocal : str
        Unit of its reciprocal, where that is the quantity that people know; else empty.
    """

    name: str
    symbol: str
    unit: str
    bounds: Bounds
    prior: Prior
    description: str
    source: str
    neutral: float | None = None
    reciprocal: str = ""

    def __post_init__(self) -> None:
        if not self.name.isidentifier() or keyword.iskeyword(self.name):
            raise ValueError(f"parameter name {self.name!r} is not an identifier")
        if self.prior.coordinate == "log" and self.bounds.lower <= 0:
            raise ValueError(f"{self.name}: a logarithmic prior needs a positive lower bound")

    def informed(self, belief: Belief, *, narrowest: float = 1e-3, widest: float = 1e2) -> Parameter:
        """The parameter with the prior that an experiment states for it.

        Parameters
        ----------
        belief : Belief
        narrowest, widest : float
            Widths that knowledge of one's own rig may give a prior, in units of the usual one.

        Raises
        ------
        ValueError
            If the prior lives in the other coordinate, has its middle beyond the bounds, or a width that no knowledge
            has.
        """
        prior, bounds = belief.prior, belief.bounds or self.bounds
        if prior is None:
            return self
        if prior.coordinate != self.prior.coordinate:
            words = "median and factor" if self.prior.coordinate == "log" else "mean and sd"
            raise ValueError(f"is given by {words}")
        core = prior.core if isinstance(prior, Tailed) else prior
        middle = core.median if isinstance(core, LogNormal) else core.mean
        if not bounds.lower <= middle <= bounds.upper:
            raise ValueError(f"has its middle within {bounds.lower:g} to {bounds.upper:g} {self.unit}")
        width = math.log(core.factor) if isinstance(core, LogNormal) else core.sd
        own = self.core
        usual = math.log(own.factor) if isinstance(own, LogNormal) else self.scale
        if not narrowest * usual <= width <= widest * usual:
            ends = [narrowest * usual, widest * usual]
            ends, word = ([math.exp(x) for x in ends], "factor") if prior.coordinate == "log" else (ends, "sd")
            raise ValueError(f"has a {word} from {ends[0]:.6g} to {ends[1]:.6g}")
        return replace(self, prior=prior, source=belief.source, bounds=bounds)

    @property
    def signature(self) -> list[str | float]:
        """What determines what it may be, as JSON can say it: keys of kept work are made of it."""
        return [self.name, self.prior.describe(), self.bounds.lower, self.bounds.upper]

    @property
    def core(self) -> Prior:
        """The prior without its broad part."""
        return self.prior.core if isinstance(self.prior, Tailed) else self.prior

    @cached_property
    def scale(self) -> float:
        """What one unit of a linear sampling coordinate means, in the parameter's unit; 1 for a logarithmic one."""
        if self.prior.coordinate == "log":
            return 1.0
        return self.core.sd if isinstance(self.core, Normal) else 0.25 * (self.bounds.upper - self.bounds.lower)

    @cached_property
    def sampling_bounds(self) -> Bounds:
        """Bounds in the sampling coordinate."""
        return Bounds(float(self.to_sampling(self.bounds.lower)), float(self.to_sampling(self.bounds.upper)))

    def to_sampling(self, x: ArrayLike) -> FloatArray:
        """Map a value to the sampling coordinate."""
        x = np.asarray(x, dtype=float)
        return np.log(x) if self.prior.coordinate == "log" else x / self.scale

    def to_physical(self, u: ArrayLike) -> FloatArray:
        """Map a sampling coordinate to the value."""
        u = np.asarray(u, dtype=float)
        if self.prior.coordinate == "log":
            return np.exp(u)
        # The bounds themselves, to the last digit: neutral values often are bounds.
        return np.clip(u * self.scale, self.bounds.lower, self.bounds.upper)

    def log_prior(self, u: ArrayLike) -> FloatArray:
        """Log density in the sampling coordinate; minus infinity outside the bounds."""
        u = np.asarray(u, dtype=float)
        low, high = self.sampling_bounds.lower, self.sampling_bounds.upper
        inside = (u >= low) & (u <= high)  # False for NaN too
        x = np.where(inside, u, low) * self.scale
        density = self.prior.log_density(x, low * self.scale, high * self.scale) + math.log(self.scale)
        return np.where(inside, density, -np.inf)

    @cached_property
    def shape(self) -> tuple[float, float, float, float, float] | None:
        """Centre, width and top of the log prior's parabola, and half width and top of its broad part.

        All in the sampling coordinate; None for a prior of another kind. A uniform prior is a parabola of infinite
        width; without a broad part, the top of that is minus infinity.
        """
        core, broad, wide = self.core, -math.inf, 1.0
        if isinstance(core, Normal):
            centre, width = core.mean / self.scale, core.sd / self.scale
        elif isinstance(core, LogNormal):
            centre, width = math.log(core.median), math.log(core.factor)
        elif isinstance(core, Uniform):
            centre, width = 0.0, math.inf
        else:
            return None
        low, high = self.sampling_bounds.lower, self.sampling_bounds.upper
        at_low = core.log_density(np.asarray(low * self.scale), low * self.scale, high * self.scale)
        top = float(at_low) + math.log(self.scale) + 0.5 * ((low - centre) / width) ** 2
        if isinstance(self.prior, Tailed):
            wide = self.prior.widening * width
            angle = math.atan((high - centre) / wide) - math.atan((low - centre) / wide)
            top += math.log1p(-self.prior.share)
            broad = math.log(self.prior.share / (wide * angle))
        return centre, width, top, wide, broad

    def prior_quantile(self, p: ArrayLike) -> FloatArray:
        """Sampling coordinate below which the prior holds the fraction `p`."""
        low, high = self.sampling_bounds.lower, self.sampling_bounds.upper
        x = self.prior.quantile(np.asarray(p, dtype=float), low * self.scale, high * self.scale)
        return np.clip(x / self.scale, low, high)

    @cached_property
    def prior_middle(self) -> tuple[float, float, float]:
        """Sampling coordinates below which the prior holds 16, 50 and 84 %."""
        low, middle, high = self.prior_quantile(np.array([0.16, 0.5, 0.84]))
        return float(low), float(middle), float(high)

    @property
    def prior_median(self) -> float:
        """Value in the middle of the prior."""
        return float(self.to_physical(self.prior_middle[1]))

    @cached_property
    def prior_interval(self) -> tuple[float, float]:
        """Central 90 % interval of the prior."""
        low, high = self.to_physical(self.prior_quantile([0.05, 0.95]))
        return float(low), float(high)

    def prior_share(self, value: float) -> float:
        """Share of the prior below a value."""
        return float(np.interp(float(self.to_sampling(value)), self.prior_quantile(SHARES), SHARES))

    def is_implausible(self, value: float, *, surprising: float = 0.05) -> bool:
        """Whether a value lies where the prior is thin: as thin or thinner in less than one chance in twenty.

        That is either tail, or the one tail there is, whatever value is neutral. Where all is equally plausible,
        nothing is implausible.

        Parameters
        ----------
        value : float
        surprising : float
            A value is implausible where less than this share of the prior is as thin as at it, or thinner.
        """
        density = self.log_prior(self.prior_quantile(SHARES))
        own = float(self.log_prior(self.to_sampling(value)))
        return bool(np.mean(density <= own + 1e-9) < surprising)

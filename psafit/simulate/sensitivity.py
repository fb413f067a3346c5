r"""What a cause does to the launch range.

Effects are finite and one-sided: from the neutral value to a plausible strength, not a slope at the neutral value,
which is zero for some causes (:math:`\sqrt{L^2 + b^2}` at :math:`b = 0`) and infinite for others (`preload`).

Comparisons are made in units of the scatter, with

.. math:: \eta(L) = \frac1r \operatorname{asinh}\frac{r L}{a}, \qquad
    \frac{\mathrm d\eta}{\mathrm dL} = \frac1{\sqrt{a^2 + r^2 L^2}},

whose differences count standard deviations of a scatter of `r` = 5 % and `a` = 0.3 um in quadrature, for ranges of
any size, zero included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from psafit.arrays import FloatArray
from psafit.drives import Drive
from psafit.experiment import Constants
from psafit.observables import OBSERVABLES
from psafit.parameters import Parameter
from psafit.physics import baseline
from psafit.physics.term import Term, Trend
from psafit.simulate.batch import readings, simulate
from psafit.simulate.design import Design

Side = Literal[-1, 1]

RIGS: Mapping[str, tuple[float, float, float]] = MappingProxyType(
    {
        # The only values published for this rig (Table 3): a soft contact on a stack whose damping stands in for
        # more than friction. They put the peak of the sine sweep and its fall where the readings have them.
        "study": (1.425e5, 13991.0, 68.0),
        # What handbooks lead one to expect instead (sources in `psafit.physics.baseline`): steel on ceramic, a soft
        # PZT with a loss of some per cent, a contact damped to a few per cent.
        "hard": (3e6, 30.0, 30.0),
        # Between them: that contact on a damped stack.
        "damped": (3e6, 3e3, 3.0),
    }
)
"""Places in the space of (k_c in N/m, c_s, c_c in N s/m) that bracket what a fit may find."""

REFERENCE = RIGS["study"]
"""Where effects are shown unless another place is asked for."""

# Part of a normal density below one standard deviation.
_ONE_UP = 0.8413447460685429


@dataclass(frozen=True)
class UsualScatter:
    """Scatter by which effects are judged where no readings state their own.

    Parameters
    ----------
    relative : float
    absolute_m : float, m
    """

    relative: float = 0.05
    absolute_m: float = 0.3e-6


def plausible(term: Term, share: float = 0.5, side: Side | None = None) -> FloatArray:
    """A strength that would surprise nobody.

    Parameters
    ----------
    term : Term
    share : float
        Of the prior of the cause's strength that lies closer to neutral, in the sampling coordinate.
    side : {-1, 1}, optional
        Below or above neutral; by default where the prior has more mass.

    Returns
    -------
    (n_parameters,) array
        The strength, the cause's other parameters at their prior medians; in their units.
    """
    values = [p.prior_median for p in term.parameters]
    values[0] = _away(term, share, side)
    return np.array(values)


def _away(term: Term, share: float, side: Side | None) -> float:
    if side is None:
        side = 1 if share_above(term) >= 0.5 else -1
    p = term.strength
    reach = float(np.quantile(np.abs(_offsets(p)), share))
    bounds = p.sampling_bounds
    return float(p.to_physical(min(max(_neutral(p) + side * reach, bounds.lower), bounds.upper)))


def share_of(term: Term, value: float) -> float:
    """Part of the prior of a cause's strength that lies closer to neutral than `value`: undoes `plausible`."""
    p = term.strength
    return float(np.mean(np.abs(_offsets(p)) < abs(float(p.to_sampling(value)) - _neutral(p))))


def share_above(term: Term) -> float:
    """Part of the prior of a cause's strength that lies above neutral."""
    return float(np.mean(_offsets(term.strength) > 0))


def _offsets(p: Parameter) -> FloatArray:
    """Equally likely strengths, from neutral, in the sampling coordinate."""
    return p.prior_quantile((np.arange(4000) + 0.5) / 4000) - _neutral(p)


def _neutral(p: Parameter) -> float:
    assert p.neutral is not None
    return float(p.to_sampling(p.neutral))


@dataclass(frozen=True)
class Effect:
    """What a cause does to the launch ranges of a design.

    Parameters
    ----------
    id : str
        The cause.
    values : (n_parameters,) array
        Its parameters, in their units.
    neutral : (n_points,) array, m
        Launch ranges without it.
    launch_range : (n_directions, n_points) array, m
        With it. One row; for a cause that every session has for itself, one a session, the others at their medians.
    typical : (n_points,) array, m
        With it, all sessions at their medians.
    """

    id: str
    values: FloatArray
    neutral: FloatArray
    launch_range: FloatArray
    typical: FloatArray

    @property
    def log_change(self) -> FloatArray:
        """``ln L - ln L_neutral``, (n_directions, n_points).

        Minus infinity where the cause prevents the launch, infinity where there is none without it, NaN where there
        is none either way.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log(self.launch_range) - np.log(self.neutral)

    @property
    def deviation(self) -> FloatArray:
        """Change of the launch range in standard deviations of the scatter, (n_directions, n_points); always finite."""
        return in_scatter(self.launch_range) - in_scatter(self.neutral)


def in_scatter(
    reading: ArrayLike,
    relative: float | FloatArray = UsualScatter.relative,
    absolute: float | FloatArray = UsualScatter.absolute_m,
) -> FloatArray:
    """Map launch ranges, or other readings, to the coordinate in which the scatter has standard deviation 1.

    Parameters
    ----------
    reading : (..., n_points) array
        In the unit of `absolute`, m by default.
    relative, absolute : float or (n_points,) array
        The scatter, of all readings or of each.
    """
    return np.asarray(np.arcsinh(relative * np.asarray(reading, dtype=float) / absolute)) / relative


def effect(
    term: Term,
    design: Design,
    theta: ArrayLike = REFERENCE,
    values: ArrayLike | None = None,
    share: float = _ONE_UP,
    tolerance: float = 1e-9,
) -> Effect:
    """The finite effect of a cause.

    Parameters
    ----------
    term : Term
    design : Design
    theta : (3,) array
        The baseline's parameters.
    values : (n_parameters,) array, optional
        The cause's parameters; those of `plausible` by default.
    share : float
        Part of the latent parameter's prior below the value that a session has: one standard deviation up by default.
    tolerance : float
        Of the stepper.
    """
    base = np.asarray(theta, dtype=float)
    own = plausible(term) if values is None else np.asarray(values, dtype=float)
    neutral = simulate(design, base, tolerance=tolerance).launch_range[0]
    found = simulate(design, sets_with(term, design, base, own, share), (term,), tolerance=tolerance).launch_range
    return Effect(term.id, own, neutral, found[1:] if term.latent else found, found[0])


def sets_with(term: Term, design: Design, theta: ArrayLike, values: ArrayLike, share: float = _ONE_UP) -> FloatArray:
    """Parameter sets that have a cause, (n_sets, n_columns): arguments as of `effect`.

    One set; of a cause that every session (or reader) has for itself the first has all at their medians, and in one
    more for each that reads what the cause changes that one has the value at `share`.
    """
    sets = np.concatenate([np.asarray(theta, dtype=float), np.asarray(values, dtype=float)])[None, :]
    if not term.latent:
        return sets
    # A spread has no effect by itself: each session in turn lies off the latent's median.
    usual, one = term.latent.to_physical(term.latent.prior_quantile(np.array([0.5, share])))
    reads = np.isin(design.measured, [k for k, o in enumerate(OBSERVABLES) if o.name in term.reads])
    shows = np.unique(design.occasion(term.per)[reads | (term.per == "sessions")])
    n = design.counts.latents(term)
    sessions = np.vstack([np.zeros(n), np.eye(n)[shows]]) * (one - usual) + usual
    return np.hstack([np.repeat(sets, len(sessions), axis=0), sessions])


def reading_slopes(design: Design, theta: ArrayLike, *, step: float = 1e-4, tolerance: float = 1e-9) -> FloatArray:
    """Slopes of all readings by the sampling coordinate of the baseline's parameters, (3, n_points).

    In the readings' units. Central differences, one-sided at a bound, by a `step` whose digits the stepper's
    `tolerance` leaves.
    """
    sets, widths = [], []
    for i, p in enumerate(baseline.PARAMETERS):
        moved = np.repeat(np.asarray(theta, dtype=float)[None], 2, axis=0)
        u, bounds = float(p.to_sampling(moved[0, i])), p.sampling_bounds
        ends = np.array([max(u - step, bounds.lower), min(u + step, bounds.upper)])
        moved[:, i] = p.to_physical(ends)
        sets.append(moved)
        widths.append(ends[1] - ends[0])
    found = readings(design, np.concatenate(sets), tolerance=tolerance)
    return np.asarray((found[1::2] - found[::2]) / np.array(widths)[:, None])


# --- symptoms ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SymptomSettings:
    """What counts as an effect, a sign and a trend.

    Parameters
    ----------
    least : float
        Launch ranges below this part of the neutral one, and none at all, count as this part.
    nothing : float
        Effects, in ln units, below which a cause does nothing.
    other_sign, other_part : float
        Both signs occur if each exceeds the first, in ln units, or the second, as a part of the largest effect.
    flat : float
        Factor within which effects agree.
    monotone : float
        The same of the middle third of a sweep against the outer ones.
    """

    least: float = 1e-3
    nothing: float = 1e-8
    other_sign: float = 0.01
    other_part: float = 0.05
    flat: float = 1.1
    monotone: float = 1.02


@dataclass(frozen=True)
class ObservedSymptom:
    """What `Symptom` declares, as the simulator has it; see `observe`."""

    sign: int
    frequency: Trend
    amplitude: Trend
    waveforms: tuple[str, ...]


def observe(
    term: Term,
    constants: Constants,
    drives: Sequence[Drive | str] = ("sine", "square"),
    volts: float = 20.0,
) -> ObservedSymptom:
    r"""Work out a cause's symptom, on every rig of `RIGS`.

    The effect is :math:`e = \ln L - \ln L_\mathrm{neutral}`, with each of some drives, at 46 frequencies from 100 Hz to
    25 kHz at 20 V and at 15 voltages from 1 to 20 V at 1.2 and 3 kHz: the ranges of the study's groups, or in
    proportion to another highest amplitude `volts`. A recorded voltage is one reading, and has no trend. Strengths
    are those of `plausible`, on both sides of neutral where there are two.

    - `sign`: +1 or -1 if a larger value has one sign of effect throughout; 0 if both occur at that strength or
      a tenth of it, each beyond 0.01 (0.05 of the largest effect, if that is less).
    - `frequency`, `amplitude`: within one sweep, "flat" if all :math:`|e|` agree within a factor of 1.1; "grows" or
      "falls" if the mean :math:`|e|` of the upper third exceeds that of the lower by more than that factor, or the
      reverse, and the middle third lies between (to 2 %); "mixed" otherwise, or where the sign changes. Over several
      sweeps, what all of them say, or "mixed". Sweeps in which the cause does nothing are not heard.
    - `waveforms`: the drives, as they are called, on which it does something, :math:`|e| > 10^{-8}`.
    """
    how = SymptomSettings()
    sides: list[Side] = [1] if term.strength.neutral == term.strength.bounds.lower else [1, -1]
    heard: dict[str, set[Trend]] = {"frequency": set(), "amplitude": set()}
    signed: list[FloatArray] = []
    both_signs = False
    given = dict.fromkeys(map(Drive.of, drives))
    active = set()
    for theta in RIGS.values():
        at_rig = []
        for drive in given:
            for variable, design in _sweeps(constants, drive, volts):
                for side in sides:
                    strong = plausible(term, side=side)
                    e = _clipped(effect(term, design, theta, strong), how)
                    weak = strong.copy()
                    p = term.strength
                    near = _neutral(p)
                    weak[0] = p.to_physical(near + 0.1 * (float(p.to_sampling(strong[0])) - near))
                    at_rig += [side * e, side * _clipped(effect(term, design, theta, weak), how)]
                    if term.latent:  # which lies below its median as often as above
                        at_rig.append(side * _clipped(effect(term, design, theta, strong, 1 - _ONE_UP), how))
                    if e.any():
                        active.add(drive)
                        if e.size > 1:
                            heard[variable].add(_trend(e, how))
        both_signs |= _has_both_signs(np.concatenate(at_rig), how)
        signed += at_rig
    everything = np.concatenate(signed)
    sign = (
        0 if both_signs or _has_both_signs(everything, how) else int(np.sign(everything[np.argmax(np.abs(everything))]))
    )
    trends: dict[str, Trend] = {name: said.pop() if len(said) == 1 else "mixed" for name, said in heard.items()}
    acting = dict.fromkeys(d.label for d in given if d in active)
    return ObservedSymptom(sign, trends["frequency"], trends["amplitude"], tuple(acting))


def _sweeps(constants: Constants, drive: Drive, volts: float) -> list[tuple[str, Design]]:
    """What a drive is looked at by: the variable swept, and the conditions."""
    if drive.recorded:
        return [("frequency", Design.sweep(constants, drive, 1200.0, volts))]
    steps = np.linspace(0.05, 1.0, 15) * volts
    sweeps = [("frequency", Design.sweep(constants, drive, np.geomspace(100.0, 25e3, 46), volts))]
    return sweeps + [("amplitude", Design.sweep(constants, drive, f, steps)) for f in (1200.0, 3000.0)]


def _clipped(found: Effect, how: SymptomSettings) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        e = np.log(np.maximum(found.launch_range[0], how.least * found.neutral) / found.neutral)
    e = np.where(found.neutral > 0.0, e, 0.0)  # what a rig does not launch has no symptom
    return np.where(np.abs(e) > how.nothing, e, 0.0)


def _has_both_signs(e: FloatArray, how: SymptomSettings) -> bool:
    limit = min(how.other_sign, how.other_part * float(np.abs(e).max()))
    return bool((e > limit).any() and (e < -limit).any())


def _trend(e: FloatArray, how: SymptomSettings) -> Trend:
    size = np.abs(e)
    if _has_both_signs(e, how):
        return "mixed"
    if size.max() <= how.flat * size.min():
        return "flat"
    third = len(e) // 3
    low, middle, high = (float(part.mean()) for part in (size[:third], size[third:-third], size[-third:]))
    if high > how.flat * low and low <= how.monotone * middle and middle <= how.monotone * high:
        return "grows"
    if low > how.flat * high and high <= how.monotone * middle and middle <= how.monotone * low:
        return "falls"
    return "mixed"


__all__ = [
    "REFERENCE", "RIGS", "Effect", "ObservedSymptom", "Side", "SymptomSettings", "UsualScatter", "effect", "in_scatter",
    "observe", "plausible", "reading_slopes", "sets_with", "share_above", "share_of",
]  # fmt: skip

r"""Check what a study printed against its own model: with the study's time step, and converged.

Eq. (12) has a fast eigenvalue, about :math:`-(c_s + c_c)/m`. A Runge-Kutta 4 step `h` multiplies
the mode of an eigenvalue :math:`\lambda` by

.. math:: R(z) = 1 + z + z^2/2 + z^3/6 + z^4/24, \qquad z = \lambda h,

and the march is stable only while :math:`|R(\lambda h)| \le 1` for all of them. Beyond that a mode
which should vanish in the first microsecond grows until it alone decides when the indentation turns
negative. Everything here follows from that number.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import (
    DEFINITION,
    Constants,
    Experiment,
    Group,
    Waveform,
    changes_text,
    read_experiment,
)
from psafit.physics import baseline
from psafit.simulate import Contact, Design, contact, simulate
from psafit.simulate.reference import (
    ContactParameters,
    Launch,
    Point,
    SquareReading,
    rk4_launch,
)
from psafit.simulate.reference import (
    Path as SteppedPath,
)
from psafit.simulate.stability import contact_matrix, largest_stable_step, rk4_growth
from psafit.validate import log_ratio, root_mean_square

Verdict = Literal["reproduced", "reproduced only with the study's time step", "not reproduced"]

REPRODUCED: Verdict = "reproduced"
ONLY_WITH_STEP: Verdict = "reproduced only with the study's time step"
NOT_REPRODUCED: Verdict = "not reproduced"

PUBLISHED = "published.toml"


@dataclass(frozen=True)
class Claim:
    """One printed number and what became of it.

    Parameters
    ----------
    id, place, statement, unit : str
    published : float
    tolerance : float
        Largest difference, in `unit`, that counts as the same number.
    reason : str
        Why that tolerance.
    study_step : float
        Value with the study's scheme and step; NaN where that gives none.
    converged : float
        Value of the exact solution.
    verdict : Verdict
    note : str
    """

    id: str
    place: str
    statement: str
    unit: str
    published: float
    tolerance: float
    reason: str
    study_step: float
    converged: float
    verdict: Verdict
    note: str


@dataclass(frozen=True)
class Stability:
    """Growth of every mode per Runge-Kutta step.

    Parameters
    ----------
    eigenvalues : (4,) complex array, 1/s
        Of the matrix of Eq. (14), fastest first.
    step : (n_steps,) array, s
    growth : (4, n_steps) array
        Modulus of R at each step.
    largest_stable_step : float, s
    study_step : float, s
    study_growth : (4,) array
        Modulus of R at the study's step.
    """

    eigenvalues: NDArray[np.complex128]
    step: FloatArray
    growth: FloatArray
    largest_stable_step: float
    study_step: float
    study_growth: FloatArray


@dataclass(frozen=True)
class FastMode:
    """Error in the fastest mode along one march under a sine, as a part of d = x1 - x2.

    Parameters
    ----------
    step : float, s
    time : (n_steps + 1,) array, s
    error : (n_steps + 1,) array, m
        Modulus of the mode's part of d less the exact part.
    indentation : (n_steps + 1,) array, m
        All of d.
    growth : float
        Factor per step, fitted over the second half of the march.
    """

    step: float
    time: FloatArray
    error: FloatArray
    indentation: FloatArray
    growth: float


@dataclass(frozen=True)
class Convergence:
    """Launch range against the time step, one condition.

    Parameters
    ----------
    frequency, amplitude : float, Hz, V
    step : (n,) array, s
        Largest first.
    launch_range : (n,) array, m
        NaN where the march overflowed.
    exact : float, m
    order : float
        Slope of log error against log step among the stable steps. It is 1, not the method's 4: the
        separation is only noticed at the end of a step, and the ball's speed is still changing.
    """

    frequency: float
    amplitude: float
    step: FloatArray
    launch_range: FloatArray
    exact: float
    order: float


@dataclass(frozen=True)
class Sweep:
    """Launch range against frequency; NaN where a march overflowed.

    Parameters
    ----------
    waveform : str
    amplitude : float, V
    measured_frequency, measured : (n_measured,) array, Hz, um
    frequency : (n,) array, Hz
    study_step, converged : (n,) array, um
    reading : str
        How the study's scheme got its square wave.
    """

    waveform: str
    amplitude: float
    measured_frequency: FloatArray
    measured: FloatArray
    frequency: FloatArray
    study_step: FloatArray
    converged: FloatArray
    reading: str


@dataclass(frozen=True)
class SquareAttempt:
    """One reading of the study's square wave, over the frequencies measured with it.

    Parameters
    ----------
    reading : str
    largest : float, um
        Largest launch range; NaN when every march overflowed.
    diverged : int
        Frequencies at which the march overflowed.
    n_frequencies : int
    sine_check : float, um
        The first Table 4 entry under the same arithmetic: a reading that misses it is not what the
        study did.
    """

    reading: str
    largest: float
    diverged: int
    n_frequencies: int
    sine_check: float


@dataclass(frozen=True)
class Trajectory:
    """One contact, for figures; lengths in um, time in us, force in N."""

    label: str
    frequency: float
    time: FloatArray
    tip: FloatArray
    ball: FloatArray
    force: FloatArray


@dataclass(frozen=True)
class Restitution:
    """Coefficient of restitution against frequency, by definition and by solution.

    Parameters
    ----------
    frequency : (n,) array, Hz
    elastic_study_step, elastic_converged : (n,) array
        Impulses of the spring k_c d alone, parted at the largest indentation; trapezoidal rule.
    elastic_study_sums : (n,) array
        The same from plain sums of the samples, the largest counted as compression.
    force_converged : (n,) array
        Impulses of all of Eq. (9), parted at the largest indentation. Negative: the damper pulls
        the ball back.
    peak_force_converged : (n,) array
        Impulses of all of Eq. (9), parted at the largest force.
    peak_force : (n,) array, N
        Largest contact force, converged.
    contact_time : (n,) array, s
    """

    frequency: FloatArray
    elastic_study_step: FloatArray
    elastic_study_sums: FloatArray
    elastic_converged: FloatArray
    force_converged: FloatArray
    peak_force_converged: FloatArray
    peak_force: FloatArray
    contact_time: FloatArray


@dataclass(frozen=True)
class RoundingRange:
    """Launch range while each parameter moves within the rounding of its printed digits.

    Parameters
    ----------
    condition : str
    study_step, converged : (3,) array, um
        Smallest, nominal and largest value over the corners, edges and centre of the box; NaN
        where a march overflowed.
    """

    condition: str
    study_step: FloatArray
    converged: FloatArray


@dataclass(frozen=True)
class Agreement:
    """Root mean square log error of the published parameters against one measured group."""

    group: str
    study_step: float
    converged: float
    diverged: int  # points at which the study's scheme overflows; with any, `study_step` is NaN
    n_points: int


@dataclass(frozen=True)
class Reproduction:
    """All of it."""

    title: str
    source: str
    parameters: dict[str, float]
    claims: tuple[Claim, ...]
    stability: Stability
    fast_modes: tuple[FastMode, ...]
    convergence: tuple[Convergence, ...]
    sweeps: tuple[Sweep, ...]
    square_attempts: tuple[SquareAttempt, ...]
    trajectories: tuple[Trajectory, ...]
    restitution: Restitution
    rounding: tuple[RoundingRange, ...]
    agreement: tuple[Agreement, ...]

    def count(self, verdict: Verdict) -> int:
        """Number of claims with a verdict."""
        return sum(claim.verdict == verdict for claim in self.claims)

    def to_dict(self) -> dict[str, Any]:
        """The record as plain JSON values; NaN becomes null, complex numbers become [re, im]."""
        plain: dict[str, Any] = _plain(self)
        return {"schema": 1, **plain}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: _plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


# --- numerics of the scheme -----------------------------------------------------------------------


def stability(parameters: ContactParameters, constants: Constants, step: float) -> Stability:
    """Stability of Runge-Kutta 4 on Eq. (12) around the study's step."""
    values = np.linalg.eigvals(contact_matrix(parameters, constants)).astype(complex)
    values = values[np.argsort(-np.abs(values))]
    steps = np.linspace(0.0, 1.2, 241)[1:] * step
    return Stability(
        values,
        steps,
        rk4_growth(values[:, None], steps),
        largest_stable_step(values),
        step,
        rk4_growth(values, step),
    )


def fast_mode(point: Point, parameters: ContactParameters, constants: Constants, step: float, total: float) -> FastMode:
    r"""Follow the fastest mode along one Runge-Kutta march under a sine.

    The left eigenvector `w` of the fastest eigenvalue takes the mode's amplitude out of the state.
    Exactly, it obeys :math:`a' = \lambda a + w \cdot B(t)`, hence

    .. math::
        a(t) = w_2 \frac{k_s q V}{m}
               \operatorname{Im} \frac{e^{i\omega t} - e^{\lambda t}}{i\omega - \lambda} .
    """
    path = _stepped_path(rk4_launch(point, parameters, constants, step, total, path=True))
    values, right = np.linalg.eig(contact_matrix(parameters, constants))
    fastest = int(np.argmax(np.abs(values)))
    left = np.linalg.inv(right)[fastest]
    rate, omega = values[fastest], 2.0 * math.pi * point.frequency
    lead = left[1] * constants.k_s * constants.q * point.amplitude / constants.m
    swing = np.exp(1j * omega * path.time) - np.exp(rate * path.time)
    exact = lead * (swing / (1j * omega - rate)).imag
    in_indentation = right[0, fastest] - right[2, fastest]
    error = np.abs((path.state @ left - exact) * in_indentation)
    half = np.arange(path.time.size) >= path.time.size // 2
    growth = math.exp(float(np.polyfit(np.flatnonzero(half), np.log(error[half]), 1)[0]))
    return FastMode(step, path.time, error, path.state[:, 0] - path.state[:, 2], growth)


def convergence(
    point: Point,
    parameters: ContactParameters,
    constants: Constants,
    steps: FloatArray,
    total: float,
) -> Convergence:
    """Launch range at one condition under refinement of the Runge-Kutta step."""
    found = np.array([rk4_launch(point, parameters, constants, float(h), total).launch_range for h in steps])
    exact = float(simulate(Design.sweep(constants, *point), np.array(parameters)).launch_range[0, 0])
    limit = largest_stable_step(np.linalg.eigvals(contact_matrix(parameters, constants)).astype(complex))
    fine = steps < 0.6 * limit
    if fine.sum() < 2:
        raise InputError(
            f"[scheme] step = {steps[0]:g} s is far beyond the stable {limit:.3g} s", "give the step the study used"
        )
    order = float(np.polyfit(np.log(steps[fine]), np.log(np.abs(found[fine] - exact)), 1)[0])
    return Convergence(point.frequency, point.amplitude, steps, found, exact, order)


def _stepped_path(launch: Launch) -> SteppedPath:
    assert launch.path is not None
    return launch.path


# --- the two solutions ----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Quantities:
    """What the claims need of one contact; SI units, NaN where the march overflowed."""

    launch_range: float
    contact_time: float
    largest_tip_time: float
    peak_force: float
    restitution: float


_NOTHING = _Quantities(*[math.nan] * 5)


class _Solution:
    """One way to solve the model; the claims ask both ways the same questions."""

    def __init__(self, experiment: Experiment, solve: Callable[[Point], _Quantities]) -> None:
        self._experiment = experiment
        self.at = lru_cache(maxsize=None)(solve)

    def over(self, claim: Mapping[str, Any]) -> tuple[FloatArray, list[_Quantities]]:
        """All measured points of the claim's group."""
        group = self._experiment.group(claim["group"])
        keep = group.frequency_hz >= claim.get("minimum_frequency", 0.0)
        frequency = group.frequency_hz[keep]
        return frequency, [
            self.at(Point(group.waveform, float(f), float(v)))
            for f, v in zip(frequency, group.amplitude_v[keep], strict=True)
        ]


def _study_quantities(
    point: Point, parameters: ContactParameters, constants: Constants, step: float, total: float
) -> _Quantities:
    launch = rk4_launch(point, parameters, constants, step, total, path=True)
    if launch.outcome != "launched":
        return _NOTHING
    path = _stepped_path(launch)
    x1, v1, x2, v2 = path.state.T
    d = x1 - x2
    return _Quantities(
        launch.launch_range,
        launch.separation_time,
        float(path.time[np.argmax(x1)]),
        float(np.max(parameters.k_c * d + parameters.c_c * (v1 - v2))),
        _elastic_restitution_of_samples(path.time, d),
    )


def _elastic_restitution_of_samples(time: FloatArray, d: FloatArray) -> float:
    turn = int(np.argmax(d))
    restitution = np.trapezoid(d[turn:], time[turn:])
    return float(restitution / np.trapezoid(d[: turn + 1], time[: turn + 1]))


def _elastic_restitution(found: Contact, parameters: ContactParameters) -> float:
    # M x2' = k_c int d + c_c d, so the spring's impulse is the total less c_c d; at the end d = 0.
    compression = found.compression_impulse - parameters.c_c * float(found.indentation.max())
    return (found.compression_impulse + found.restitution_impulse - compression) / compression


def _exact_contact(point: Point, parameters: ContactParameters, constants: Constants, n_times: int = 2001) -> Contact:
    try:
        return contact(Design.sweep(constants, *point), np.array(parameters), n_times=n_times)[0]
    except ValueError as error:  # no launch
        raise InputError(f"{PUBLISHED}: {error}", "correct the parameters, or the conditions of the claims") from error


def _exact_quantities(point: Point, parameters: ContactParameters, constants: Constants) -> _Quantities:
    launched = simulate(Design.sweep(constants, *point), np.array(parameters))
    found = _exact_contact(point, parameters, constants)
    return _Quantities(
        float(launched.launch_range[0, 0]),
        found.contact_time,
        float(found.time[np.argmax(found.tip)]),
        found.peak_force,
        _elastic_restitution(found, parameters),
    )


# --- claims ---------------------------------------------------------------------------------------


def _highest(values: FloatArray) -> int:
    if np.isnan(values).all():
        remedy = "give the scheme a longer total, and minimum_frequency one that was measured"
        raise InputError(f"{PUBLISHED}: the published scheme launches no ball in a sweep of a claim", remedy)
    return int(np.nanargmax(values))


def _launch_range(s: _Solution, c: Mapping[str, Any]) -> float:
    return 1e6 * s.at(_point(c)).launch_range


def _largest(s: _Solution, c: Mapping[str, Any]) -> tuple[float, float]:
    frequency, found = s.over(c)
    ranges = np.array([q.launch_range for q in found])
    if np.all(np.isnan(ranges)):
        return math.nan, math.nan
    best = _highest(ranges)
    return float(frequency[best]), 1e6 * float(ranges[best])


def _peak_launch_range(s: _Solution, c: Mapping[str, Any]) -> float:
    # A curve with holes where the scheme overflowed has no known maximum.
    _, found = s.over(c)
    return math.nan if any(math.isnan(q.launch_range) for q in found) else _largest(s, c)[1]


def _peak_frequency(s: _Solution, c: Mapping[str, Any]) -> float:
    return _largest(s, c)[0]


def _peak_error(s: _Solution, c: Mapping[str, Any]) -> float:
    measured = float(s._experiment.group(c["group"]).launch_range_um.max())
    return 100.0 * abs(_peak_launch_range(s, c) - measured) / measured


def _largest_tip_time(s: _Solution, c: Mapping[str, Any]) -> float:
    return 1e6 * s.at(_point(c)).largest_tip_time


def _peak_force_frequency(s: _Solution, c: Mapping[str, Any]) -> float:
    frequency, found = s.over(c)
    return float(frequency[_highest(np.array([q.peak_force for q in found]))])


def _contact_time_rises(s: _Solution, c: Mapping[str, Any]) -> float:
    _, found = s.over(c)
    return float(np.count_nonzero(np.diff([q.contact_time for q in found]) > 0))


def _restitution(s: _Solution, c: Mapping[str, Any]) -> float:
    return s.at(_point(c)).restitution


def _restitution_somewhere(s: _Solution, c: Mapping[str, Any]) -> float:
    _, found = s.over(c)
    values = np.array([q.restitution for q in found])
    return float(values[np.nanargmin(np.abs(values - c["published"]))])


def _restitution_ratio(s: _Solution, c: Mapping[str, Any]) -> float:
    point = _point(c)
    other = point._replace(frequency=float(c["other_frequency"]))
    return s.at(point).restitution / s.at(other).restitution


class _Quantity(NamedTuple):
    """How a claimed quantity is computed, and which keys of the claim that takes."""

    value: Callable[[_Solution, Mapping[str, Any]], float]
    needs: tuple[str, ...]


_AT_A_POINT = ("waveform", "frequency", "amplitude")
_QUANTITIES: Mapping[str, _Quantity] = {
    "launch_range": _Quantity(_launch_range, _AT_A_POINT),
    "peak_launch_range": _Quantity(_peak_launch_range, ("group",)),
    "peak_frequency": _Quantity(_peak_frequency, ("group",)),
    "peak_error": _Quantity(_peak_error, ("group",)),
    "largest_tip_time": _Quantity(_largest_tip_time, _AT_A_POINT),
    "peak_force_frequency": _Quantity(_peak_force_frequency, ("group",)),
    "contact_time_rises": _Quantity(_contact_time_rises, ("group",)),
    "restitution": _Quantity(_restitution, _AT_A_POINT),
    "restitution_somewhere": _Quantity(_restitution_somewhere, ("group",)),
    "restitution_ratio": _Quantity(_restitution_ratio, (*_AT_A_POINT, "other_frequency")),
}


def _point(claim: Mapping[str, Any]) -> Point:
    return Point(claim["waveform"], float(claim["frequency"]), float(claim["amplitude"]))


def judge(published: float, tolerance: float, study_step: float, converged: float) -> Verdict:
    """Verdict on one number; a value that is NaN matches nothing."""
    if abs(converged - published) <= tolerance:
        return REPRODUCED
    if abs(study_step - published) <= tolerance:
        return ONLY_WITH_STEP
    return NOT_REPRODUCED


def _judged(claim: Mapping[str, Any], study: _Solution, exact: _Solution) -> Claim:
    value = _QUANTITIES[claim["quantity"]].value
    published = float(claim["published"])
    tolerance = float(claim["tolerance"] if "tolerance" in claim else claim["tolerance_relative"] * published)
    stepped, converged = value(study, claim), value(exact, claim)
    return Claim(
        claim["id"], claim["place"], claim["statement"], claim["unit"], published, tolerance,
        claim["reason"], stepped, converged, judge(published, tolerance, stepped, converged),
        claim.get("note", ""),
    )  # fmt: skip


# What a study may state: as far as the simulator goes, and no longer than one waits.
_LIMITS: Mapping[str, tuple[float, float]] = {
    **{p.name: (p.bounds.lower if p.name == "k_c" else 0.0, p.bounds.upper) for p in baseline.PARAMETERS},
    "step": (1e-9, 1e-4),
    "total": (1e-3, 10.0),
    "frequency": (1e-2, 1e7),
    "amplitude": (1e-3, 1e6),
}
_MOST_STEPS = 1e7


def read_published(folder: str | Path) -> dict[str, Any]:
    """Read ``published.toml`` of an experiment folder.

    Returns
    -------
    dict
        Tables ``parameters`` and ``scheme``, and the list ``claim``.

    Raises
    ------
    InputError
        If the file is missing, is not TOML, or lacks something a claim needs.
    """
    file = Path(folder) / PUBLISHED
    remedy = "see experiments/psa/published.toml for the form"
    try:
        data = tomllib.loads(file.read_text("utf-8"))
    except FileNotFoundError:
        raise InputError("there are no published claims", "add this file to reproduce a study", file=file) from None
    except (OSError, ValueError, RecursionError) as error:  # also of digits or nesting without end
        raise InputError(f"cannot be read: {error}", remedy, file=file) from None
    numbers: tuple[tuple[str, tuple[str, ...]], ...] = (
        ("parameters", ContactParameters._fields),
        ("scheme", ("step", "total")),
    )
    if "rounding" in data:
        numbers += (("rounding", ContactParameters._fields),)
    for table, names in numbers:
        found = data.get(table)
        for name in names:
            low, high = _LIMITS[name]
            if table == "rounding":  # no further than to where a parameter ends
                low, high = 0.0, float(data["parameters"][name]) - low
            value = found.get(name) if isinstance(found, dict) else None
            if not (_usable(value, zero=low == 0) and low <= value <= high):
                raise InputError(f"[{table}] has no valid {name}, from {low:g} to {high:g}", remedy, file=file)
    if data["scheme"]["total"] > _MOST_STEPS * data["scheme"]["step"]:
        raise InputError(f"[scheme] asks for more than {_MOST_STEPS:g} steps", remedy, file=file)
    claims = data.get("claim", [])
    if not (isinstance(claims, list) and all(isinstance(claim, dict) for claim in claims)):
        raise InputError("the claims are not a list of [[claim]] tables", remedy, file=file)
    for position, claim in enumerate(claims, start=1):
        fault = _fault(claim)
        if fault is not None:
            name = claim.get("id", f"number {position}")
            raise InputError(f"claim {name} {fault}", remedy, file=file)
    return data


def _usable(number: object, *, zero: bool) -> TypeGuard[float]:
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    return 0 < number <= sys.float_info.max or (zero and number == 0)


def _fault(claim: Mapping[str, Any]) -> str | None:
    """What is wrong with a claim, or None."""
    for key in ("id", "place", "statement", "quantity", "unit", "reason"):
        if not (isinstance(claim.get(key), str) and claim[key]):
            return f"lacks {key!r}, a text"
    if claim["quantity"] not in _QUANTITIES:
        return f"has the unknown quantity {claim['quantity']!r}, not one of {', '.join(_QUANTITIES)}"
    if ("tolerance" in claim) == ("tolerance_relative" in claim):
        return "needs one of tolerance and tolerance_relative"
    needs = _QUANTITIES[claim["quantity"]].needs
    for key in ("published", *needs):
        if key not in claim:
            return f"lacks {key!r}"
    if claim.get("waveform", "sine") not in ("sine", "square"):
        return f"has the waveform {claim['waveform']!r}, neither sine nor square"
    if not isinstance(claim.get("group", 1), int | str):
        return f"has {claim['group']!r} for a group"
    positive = {"frequency", "other_frequency", "amplitude", "tolerance", "tolerance_relative"}
    for key in sorted(positive & claim.keys()):
        low, high = _LIMITS.get(key.removeprefix("other_"), (0.0, math.inf))
        if not (_usable(claim[key], zero=False) and low <= claim[key] <= high):
            return f"has {claim[key]!r} for {key}"
    if not isinstance(claim.get("note", ""), str):
        return "has a note that is no text"
    for key in ("published", "minimum_frequency"):
        if not _usable(claim.get(key, 0), zero=True):
            return f"has {claim[key]!r} for {key}"
    return None


# --- everything -----------------------------------------------------------------------------------


class _Reading(NamedTuple):
    text: str
    square: SquareReading
    interpolate: bool


_AS_STATED = _Reading("+V from t = 0 on, as stated", "half periods", False)
_INTERPOLATED = _Reading("sign of the sine, from a table with one entry a step, interpolated", "sign of sine", True)
_READINGS = (
    _AS_STATED,
    _Reading("sign of the sine, hence 0 V at t = 0", "sign of sine", False),
    _INTERPOLATED,
)


def reproduce(folder: str | Path) -> Reproduction:
    """Compute every published claim with the study's scheme and exactly, and show why they differ.

    Parameters
    ----------
    folder : path-like
        Experiment folder with ``experiment.toml`` and ``published.toml``.

    Returns
    -------
    Reproduction

    Raises
    ------
    InputError
        If either file cannot be used.
    """
    experiment = read_experiment(folder)
    data = read_published(folder)
    for group in experiment.groups:
        if group.changed:
            raise InputError(
                f"group {group.id} has constants of its own{changes_text(group.changed)}",
                "leave it out: published results are of one rig",
                file=experiment.folder / DEFINITION,
            )
    constants = experiment.constants
    parameters = ContactParameters(*(float(data["parameters"][k]) for k in ContactParameters._fields))
    step, total = float(data["scheme"]["step"]), float(data["scheme"]["total"])
    study = _Solution(experiment, lambda p: _study_quantities(p, parameters, constants, step, total))
    exact = _Solution(experiment, lambda p: _exact_quantities(p, parameters, constants))
    for claim in data.get("claim", []):
        if "group" in claim:
            experiment.group(claim["group"])  # refuses one there is not, before long work
    claims = tuple(_judged(claim, study, exact) for claim in data.get("claim", []))

    point = Point("sine", 1200.0, 20.0)
    steps = step * np.concatenate([[1.0, 0.995, 0.99], np.geomspace(0.98, 0.01, 48)])
    return Reproduction(
        experiment.title,
        experiment.source,
        dict(zip(parameters._fields, parameters, strict=True)),
        claims,
        stability(parameters, constants, step),
        tuple(fast_mode(point, parameters, constants, factor * step, total) for factor in (1.0, 0.98, 0.5)),
        tuple(
            convergence(Point("sine", f, 20.0), parameters, constants, steps, total) for f in (500.0, 1200.0, 3000.0)
        ),
        tuple(
            _sweep(group, waveform, parameters, constants, step, total)
            for waveform in ("sine", "square")
            for group in (_frequency_sweep(experiment, waveform),)
            if group is not None
        ),
        _square_attempts(experiment, parameters, step, total),
        _trajectories(parameters, constants, step, total),
        _restitution_sweep(parameters, constants, step, total),
        _rounding_ranges(data.get("rounding"), parameters, constants, step, total),
        tuple(_agreement(group, parameters, constants, step, total) for group in experiment.groups),
    )


def _frequency_sweep(experiment: Experiment, waveform: Waveform) -> Group | None:
    """The group of a waveform with most frequencies."""
    found = [g for g in experiment.groups if g.waveform == waveform]
    return max(found, key=lambda g: np.unique(g.frequency_hz).size, default=None)


def _study_ranges(
    frequency: FloatArray, amplitude: FloatArray, waveform: Waveform, reading: _Reading,
    parameters: ContactParameters, constants: Constants, step: float, total: float,
) -> FloatArray:  # fmt: skip
    """Launch ranges of the study's scheme, um."""
    return 1e6 * np.array(
        [
            rk4_launch(
                Point(waveform, float(f), float(v)),
                parameters,
                constants,
                step,
                total,
                square=reading.square,
                interpolate=reading.interpolate,
            ).launch_range
            for f, v in zip(frequency, amplitude, strict=True)
        ]
    )


def _sweep(
    group: Group, waveform: Waveform, parameters: ContactParameters, constants: Constants,
    step: float, total: float,
) -> Sweep:  # fmt: skip
    amplitude = float(group.amplitude_v.max())
    frequency = np.unique(
        np.concatenate(
            [
                group.frequency_hz,
                np.geomspace(group.frequency_hz.min(), group.frequency_hz.max(), 161).round(3),
            ]
        )
    )
    reading = _INTERPOLATED if waveform == "square" else _AS_STATED
    stepped = _study_ranges(
        frequency, np.full(frequency.size, amplitude), waveform, reading, parameters, constants,
        step, total,
    )  # fmt: skip
    exact = simulate(Design.sweep(constants, waveform, frequency, amplitude), np.array(parameters)).launch_range[0]
    return Sweep(
        waveform, amplitude, group.frequency_hz, group.launch_range_um, frequency, stepped,
        1e6 * exact, reading.text if waveform == "square" else "",
    )  # fmt: skip


def _square_attempts(
    experiment: Experiment, parameters: ContactParameters, step: float, total: float
) -> tuple[SquareAttempt, ...]:
    group = _frequency_sweep(experiment, "square")
    if group is None:
        return ()
    attempts = []
    for reading in _READINGS:
        found = _study_ranges(
            group.frequency_hz, group.amplitude_v, "square", reading, parameters,
            experiment.constants, step, total,
        )  # fmt: skip
        bad = int(np.isnan(found).sum())
        sine = rk4_launch(
            Point("sine", 1200.0, 16.0), parameters, experiment.constants, step, total,
            interpolate=reading.interpolate,
        ).launch_range  # fmt: skip
        attempts.append(
            SquareAttempt(
                reading.text, math.nan if bad == found.size else float(np.nanmax(found)),
                bad, found.size, 1e6 * sine,
            )
        )  # fmt: skip
    return tuple(attempts)


def _trajectories(
    parameters: ContactParameters, constants: Constants, step: float, total: float
) -> tuple[Trajectory, ...]:
    out = []
    launch = rk4_launch(Point("sine", 1200.0, 20.0), parameters, constants, step, total, path=True)
    path = _stepped_path(launch)
    x1, v1, x2, v2 = path.state.T
    force = parameters.k_c * (x1 - x2) + parameters.c_c * (v1 - v2)
    out.append(Trajectory("study's time step", 1200.0, 1e6 * path.time, 1e6 * x1, 1e6 * x2, force))
    for f in (500.0, 700.0, 1200.0, 3500.0, 5000.0, 10000.0):
        found = _exact_contact(Point("sine", f, 20.0), parameters, constants, 401)
        out.append(Trajectory("converged", f, 1e6 * found.time, 1e6 * found.tip, 1e6 * found.ball, found.force))
    return tuple(out)


def _restitution_sweep(parameters: ContactParameters, constants: Constants, step: float, total: float) -> Restitution:
    named = [500.0, 700.0, 1200.0, 3500.0]  # Fig. 15
    frequency = np.unique(np.concatenate([np.geomspace(400.0, 25000.0, 61), named]))
    rows = []
    for f in frequency:
        point = Point("sine", float(f), 20.0)
        stepped = _study_quantities(point, parameters, constants, step, total)
        march = rk4_launch(point, parameters, constants, step, total, path=True)
        samples = _stepped_path(march).state[:, 0] - _stepped_path(march).state[:, 2]
        turn = int(np.argmax(samples)) + 1
        launched = march.outcome == "launched"
        found = _exact_contact(point, parameters, constants)
        whole = found.compression_impulse + found.restitution_impulse
        top = int(np.argmax(found.force))
        until_peak = constants.M * float(found.ball_speed[top])
        rows.append(
            (
                stepped.restitution,
                samples[turn:].sum() / samples[:turn].sum() if launched else math.nan,
                _elastic_restitution(found, parameters),
                found.restitution,
                whole / until_peak - 1.0,
                found.peak_force,
                found.contact_time,
            )
        )
    return Restitution(frequency, *np.array(rows).T)


def _rounding_ranges(
    rounding: Mapping[str, float] | None,
    parameters: ContactParameters,
    constants: Constants,
    step: float,
    total: float,
) -> tuple[RoundingRange, ...]:
    if rounding is None:
        return ()
    shifts = itertools.product((-1.0, 0.0, 1.0), repeat=len(parameters))
    half_digit = np.array([rounding[name] for name in parameters._fields])
    box = np.array(parameters) + np.array(list(shifts)) * half_digit
    centre = len(box) // 2
    cases = (
        ("sine, 1 kHz, 20 V", Point("sine", 1000.0, 20.0), _AS_STATED),
        ("sine, 1.2 kHz, 20 V", Point("sine", 1200.0, 20.0), _AS_STATED),
        ("sine, 3 kHz, 20 V", Point("sine", 3000.0, 20.0), _AS_STATED),
        ("square, 1 kHz, 20 V, third reading", Point("square", 1000.0, 20.0), _INTERPOLATED),
    )
    out = []
    for text, point, reading in cases:
        stepped = 1e6 * np.array(
            [
                rk4_launch(
                    point,
                    ContactParameters(*map(float, corner)),
                    constants,
                    step,
                    total,
                    square=reading.square,
                    interpolate=reading.interpolate,
                ).launch_range
                for corner in box
            ]
        )
        exact = 1e6 * simulate(Design.sweep(constants, *point), box).launch_range[:, 0]
        ranges = (np.array([x.min(), x[centre], x.max()]) for x in (stepped, exact))
        out.append(RoundingRange(text, *ranges))
    return tuple(out)


def _agreement(
    group: Group, parameters: ContactParameters, constants: Constants, step: float, total: float
) -> Agreement:
    stepped = _study_ranges(
        group.frequency_hz, group.amplitude_v, group.waveform, _AS_STATED, parameters, constants,
        step, total,
    )  # fmt: skip
    exact = 1e6 * simulate(Design.of(constants, [group]), np.array(parameters)).launch_range[0]

    study, converged = (root_mean_square(log_ratio(um, group.launch_range_um)) for um in (stepped, exact))
    return Agreement(str(group.id), study, converged, int(np.isnan(stepped).sum()), stepped.size)

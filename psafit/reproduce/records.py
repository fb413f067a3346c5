"""What a reproduction finds, as frozen records."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray

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
    """The reproduction of a study: its claims, and what explains each."""

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

"""The two solutions of Eq. (12): as the study stepped it, and exact."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import (
    Constants,
    Experiment,
)
from psafit.reproduce.records import (
    PUBLISHED,
)
from psafit.simulate import Contact, Design, contact, simulate
from psafit.simulate.reference import (
    ContactParameters,
    Launch,
    Point,
    rk4_launch,
)
from psafit.simulate.reference import (
    Path as SteppedPath,
)


def stepped_path(launch: Launch) -> SteppedPath:
    """The states of a march that was asked to keep them."""
    assert launch.path is not None
    return launch.path


@dataclass(frozen=True)
class _Quantities:
    """What the claims need of one contact; SI units, NaN where the march overflowed."""

    launch_range: float = math.nan
    contact_time: float = math.nan
    largest_tip_time: float = math.nan
    peak_force: float = math.nan
    restitution: float = math.nan


class Solution:
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


def study_quantities(
    point: Point, parameters: ContactParameters, constants: Constants, step: float, total: float
) -> _Quantities:
    """What the study's march says of one launch."""
    launch = rk4_launch(point, parameters, constants, step, total, path=True)
    if launch.outcome != "launched":
        return _Quantities()
    path = stepped_path(launch)
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


def elastic_restitution(found: Contact, parameters: ContactParameters) -> float:
    # M x2' = k_c int d + c_c d, so the spring's impulse is the total less c_c d; at the end d = 0.
    """Impulses of the spring force alone, parted at the largest indentation."""
    compression = found.compression_impulse - parameters.c_c * float(found.indentation.max())
    return (found.compression_impulse + found.restitution_impulse - compression) / compression


def exact_contact(point: Point, parameters: ContactParameters, constants: Constants, n_times: int = 2001) -> Contact:
    """Motion and impulses of one launch in closed form."""
    try:
        return contact(Design.sweep(constants, *point), np.array(parameters), n_times=n_times)[0]
    except ValueError as error:  # no launch
        raise InputError(f"{PUBLISHED}: {error}", "correct the parameters, or the conditions of the claims") from error


def exact_quantities(point: Point, parameters: ContactParameters, constants: Constants) -> _Quantities:
    """What the closed form says of one launch."""
    launched = simulate(Design.sweep(constants, *point), np.array(parameters))
    found = exact_contact(point, parameters, constants)
    return _Quantities(
        float(launched.launch_range[0, 0]),
        found.contact_time,
        float(found.time[np.argmax(found.tip)]),
        found.peak_force,
        elastic_restitution(found, parameters),
    )

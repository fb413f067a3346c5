"""The whole of it: every published number, sweep and figure computed again."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import (
    DEFINITION,
    Constants,
    Experiment,
    Group,
    changes_text,
    read_experiment,
)
from psafit.reproduce.claims import judged, read_published
from psafit.reproduce.records import (
    Agreement,
    Reproduction,
    Restitution,
    RoundingRange,
    SquareAttempt,
    Sweep,
    Trajectory,
)
from psafit.reproduce.scheme import convergence, fast_mode, stability
from psafit.reproduce.solutions import (
    Solution,
    elastic_restitution,
    exact_contact,
    exact_quantities,
    stepped_path,
    study_quantities,
)
from psafit.simulate import Design, simulate
from psafit.simulate.reference import (
    ContactParameters,
    Point,
    SquareReading,
    rk4_launch,
)
from psafit.validate import log_ratio, root_mean_square


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
    study = Solution(experiment, lambda p: study_quantities(p, parameters, constants, step, total))
    exact = Solution(experiment, lambda p: exact_quantities(p, parameters, constants))
    for claim in data.get("claim", []):
        if "group" in claim:
            experiment.group(claim["group"])  # refuses one there is not, before long work
    claims = tuple(judged(claim, study, exact) for claim in data.get("claim", []))

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


def _frequency_sweep(experiment: Experiment, waveform: str) -> Group | None:
    """The group of a waveform with most frequencies."""
    found = [g for g in experiment.groups if g.waveform == waveform]
    return max(found, key=lambda g: np.unique(g.frequency_hz).size, default=None)


def _study_ranges(
    frequency: FloatArray, amplitude: FloatArray, waveform: str, reading: _Reading,
    parameters: ContactParameters, constants: Constants, step: float, total: float,
) -> FloatArray:  # fmt: skip
    """Launch ranges of the study's scheme, um."""
    points = [Point(waveform, float(f), float(v)) for f, v in zip(frequency, amplitude, strict=True)]
    return np.array([_study_range(p, reading, parameters, constants, step, total) for p in points])


def _study_range(
    point: Point, reading: _Reading, parameters: ContactParameters, constants: Constants, step: float, total: float
) -> float:
    """One of them."""
    launch = rk4_launch(
        point, parameters, constants, step, total, square=reading.square, interpolate=reading.interpolate
    )
    return 1e6 * launch.launch_range


def _sweep(
    group: Group, waveform: str, parameters: ContactParameters, constants: Constants,
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
        waveform, amplitude, group.frequency_hz, group.reading, frequency, stepped,
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
    path = stepped_path(launch)
    x1, v1, x2, v2 = path.state.T
    force = parameters.k_c * (x1 - x2) + parameters.c_c * (v1 - v2)
    out.append(Trajectory("study's time step", 1200.0, 1e6 * path.time, 1e6 * x1, 1e6 * x2, force))
    for f in (500.0, 700.0, 1200.0, 3500.0, 5000.0, 10000.0):
        found = exact_contact(Point("sine", f, 20.0), parameters, constants, 401)
        out.append(Trajectory("converged", f, 1e6 * found.time, 1e6 * found.tip, 1e6 * found.ball, found.force))
    return tuple(out)


def _restitution_sweep(parameters: ContactParameters, constants: Constants, step: float, total: float) -> Restitution:
    named = [500.0, 700.0, 1200.0, 3500.0]  # Fig. 15
    frequency = np.unique(np.concatenate([np.geomspace(400.0, 25000.0, 61), named]))
    rows = []
    for f in frequency:
        point = Point("sine", float(f), 20.0)
        stepped = study_quantities(point, parameters, constants, step, total)
        march = rk4_launch(point, parameters, constants, step, total, path=True)
        samples = stepped_path(march).state[:, 0] - stepped_path(march).state[:, 2]
        turn = int(np.argmax(samples)) + 1
        launched = march.outcome == "launched"
        found = exact_contact(point, parameters, constants)
        whole = found.compression_impulse + found.restitution_impulse
        top = int(np.argmax(found.force))
        until_peak = constants.M * float(found.ball_speed[top])
        rows.append(
            (
                stepped.restitution,
                samples[turn:].sum() / samples[:turn].sum() if launched else math.nan,
                elastic_restitution(found, parameters),
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
        corners = [ContactParameters(*map(float, corner)) for corner in box]
        stepped = np.array([_study_range(point, reading, corner, constants, step, total) for corner in corners])
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

    study, converged = (root_mean_square(log_ratio(um, group.reading)) for um in (stepped, exact))
    return Agreement(str(group.id), study, converged, int(np.isnan(stepped).sum()), stepped.size)

"""What was hidden, sealed: the answer's hash is committed before the data are written."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from psafit.arrays import FloatArray
from psafit.errors import InputError
from psafit.experiment import Experiment, GroupId, read_experiment
from psafit.files import read_bytes, write_atomically
from psafit.inference import noise
from psafit.inference.problem import Problem
from psafit.observables import OBSERVABLES
from psafit.physics import terms
from psafit.records import read_json, write_json
from psafit.simulate import Design
from psafit.simulate.sensitivity import in_scatter

ANSWER, COMMITMENT, EXPERIMENT = "answer.json", "commitment.txt", "experiment"
Kind = Literal["nothing", "one", "two", "outside"]
KINDS: tuple[Kind, ...] = ("nothing", "one", "two", "outside")
Conditions = Literal["given", "drawn"]
Scatter = Mapping[str, float | None]


@dataclass(frozen=True)
class Place:
    """Where an effect acts.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude"}, optional
        None: in the whole group.
    lower, upper : float, Hz or V, optional
        None: without an end on that side.
    """

    group: GroupId
    variable: Literal["frequency", "amplitude"] | None = None
    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True)
class DrawnDesign:
    """What was drawn of a rig and its sweeps.

    Parameters
    ----------
    constants : dict
        Of the rig, SI.
    readings : int
        Planned; of a launch that failed some are not read.
    drives : dict
        By group, in words.
    observables : dict
        What is read, by group.
    """

    constants: dict[str, float]
    readings: int
    drives: dict[str, str]
    observables: dict[str, list[str]]


@dataclass(frozen=True)
class Answer:
    """`answer.json`: the truth behind a challenge.

    Parameters
    ----------
    version : str
        Of psafit.
    seed : int
    kind : {"nothing", "one", "two", "outside"}
    terms : list of str
        Causes of the catalogue that act.
    parameters : dict
        True values of the baseline's and the causes' parameters, in their units; what every session has for itself is
        numbered by the group's id.
    scatter : dict
        Of each observable that is read, by the names of its parameters: ``sigma_rel`` (1), ``sigma_abs`` (um), ``nu``
        (None: normal) for launch ranges; of a trace also its correlation time (us), such as ``tau_velocity``.
    asked_nats : float, optional
        Oracle gain asked for, of each cause alone.
    expected_nats : dict
        What the search for the strength expected of each cause alone; empty where strengths were drawn.
    reached : bool
        Whether every cause could be made as strong as asked for.
    share : dict
        For each cause, the part of its prior that lies closer to neutral.
    outside : str, optional
        Name of an effect outside the catalogue.
    where : str
        Where that acts, in words.
    places : list of Place
    design : {"given", "drawn"}
    redraws : int
        True models drawn as well that launched too little, or in which a cause could not be as strong as asked for.
    true_readings : list of float
        Readings before scatter and rounding, group after group, each in its unit.
    fingerprint : str
        Of the experiment that belongs to this answer.
    drawn : DrawnDesign, optional
        What was drawn, where `design` says so.
    """

    version: str
    seed: int
    kind: Kind
    terms: list[str]
    parameters: dict[str, float]
    scatter: dict[str, float | None]
    asked_nats: float | None
    expected_nats: dict[str, float]
    reached: bool
    share: dict[str, float]
    outside: str | None
    where: str
    places: list[Place]
    design: Conditions
    redraws: int
    true_readings: list[float]
    fingerprint: str
    drawn: DrawnDesign | None = None


def seal(answer: Answer, folder: Path) -> str:
    """Write the answer and commit to it.

    Returns
    -------
    str
        SHA-256 of the answer's bytes, as `commitment.txt` holds it.
    """
    write_json(folder / ANSWER, answer)
    digest = hashlib.sha256((folder / ANSWER).read_bytes()).hexdigest()
    # As `sha256sum --check` reads it.
    write_atomically(folder / COMMITMENT, f"{digest}  {ANSWER}\n".encode())
    return digest


def by_reading(scatter: Scatter, design: Design) -> FloatArray:
    """The scatter of each reading, (1, 3 or 4, n_points), as `psafit.inference.noise.scale` takes it.

    Parameters
    ----------
    scatter : mapping
        As `Answer.scatter` has it; no number of degrees of freedom is NaN.
    design : Design
    """
    known = {k: [scatter[p.name] for p in OBSERVABLES[k].scatter] for k in np.unique(design.measured)}
    return noise.by_reading({k: np.array([own], float) for k, own in known.items()}, design)


def standardised(readings: FloatArray, scatter: Scatter, design: Design) -> FloatArray:
    """Readings of a design, (..., n_points), where their scatter is independent and has standard deviation 1.

    Along a trace they are what a sample says beyond the one before. What is no number stays none.

    Parameters
    ----------
    readings : (..., n_points) array
        Each in its unit.
    scatter : mapping
        As `Answer.scatter` has it.
    design : Design
    """
    values = by_reading(scatter, design)
    relative, absolute, _ = (row[0] for row in noise.columns(values))
    z = in_scatter(readings, relative, absolute)
    there = np.isfinite(z)
    white = noise.whitened(np.where(there, z, 0.0), values)
    return np.where(there, white.reshape(z.shape), z)


def unseal(folder: Path) -> tuple[Experiment, Answer]:
    """Read a challenge back, and hold the answer against its commitment and against the data.

    Raises
    ------
    InputError
        If a file is missing, or the answer is not the one committed to, is incomplete, or belongs to other data.
    """
    remedy = "make the challenge again with psafit challenge make"
    answer_file, commitment = folder / ANSWER, folder / COMMITMENT
    where = "give a folder that psafit challenge make wrote"
    # What is no text is no commitment either.
    words = read_bytes(commitment, where).decode("utf-8", "replace").split()
    digest = hashlib.sha256(read_bytes(answer_file, where)).hexdigest()
    if words != [digest, ANSWER]:
        raise InputError("is not the answer that was committed to", remedy, file=answer_file)
    answer = read_json(answer_file, Answer, remedy=remedy)
    experiment = read_experiment(folder / EXPERIMENT)
    if experiment.fingerprint != answer.fingerprint:
        raise InputError("holds other data than the answer belongs to", remedy, file=folder / EXPERIMENT)
    # A hash does not say that what it belongs to is an answer.
    model = Problem(experiment, experiment.ids, terms(answer.terms))
    missing = set(model.names) - set(answer.parameters) - set(answer.scatter)
    true = np.array(answer.true_readings)
    if missing or true.size != model.observed.size or not np.isfinite(true).all():
        what = f"does not say {', '.join(sorted(missing))}" if missing else "has not one true value for every reading"
        raise InputError(what, remedy, file=answer_file)
    given = {**answer.parameters, **answer.scatter}
    tails = {o.scatter[2].name for o in OBSERVABLES}  # which may be normal
    for p in model.parameters:
        value = given[p.name]
        if value is None and p.name not in tails:
            raise InputError(f"has no number for {p.name}", remedy, file=answer_file)
        if value is not None and not p.bounds.lower <= value <= p.bounds.upper:
            what = f"has {p.name} = {value:g}, outside the bounds of {p.bounds.lower:g} to {p.bounds.upper:g} {p.unit}"
            raise InputError(what.rstrip(), remedy, file=answer_file)
    return experiment, answer


__all__ = [
    "ANSWER", "COMMITMENT", "EXPERIMENT", "KINDS", "Answer", "Conditions", "DrawnDesign", "Kind", "Place", "Scatter",
    "by_reading", "seal", "standardised", "unseal",
]  # fmt: skip

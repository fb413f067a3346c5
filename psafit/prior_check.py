r"""Readings against what rigs of the prior would give: a prior predictive check of their scale.

A wrong unit is a factor of a thousand, and a contact soft or stiff enough can imitate much of it: the fit then looks
adequate, or calls for causes. Draws of the baseline's prior are simulated at the experiment's conditions. Let
:math:`r_g` be the median of :math:`\ln(\mathrm{reading}/\mathrm{prediction})` in a group. Readings are suspicious where
nearly all draws lie on one side of zero, and a group where nearly all say that it is off the middle group by more than
a factor of thirty, whatever the rig is. Of two groups that are off each other, the one whose own readings are
suspicious. What another warning explains is left out: groups of which the constants or the conditions are suspicious
already.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import qmc

from psafit.arrays import FloatArray
from psafit.errors import Faults
from psafit.experiment import Experiment, Group, read_experiment
from psafit.experiment.definition import Definition
from psafit.experiment.plausible import contradicted, suspicious_conditions, suspicious_constants
from psafit.experiment.text import one_line
from psafit.observables import OBSERVABLES, Observable
from psafit.physics import informed
from psafit.simulate import Design, readings
from psafit.text import significant


def read(folder: str | Path) -> Experiment:
    """Read an experiment folder, its warnings extended by `with_scale`; refuse knowledge of what is no parameter."""
    experiment = read_experiment(folder)
    faults = Faults()
    for belief in experiment.beliefs:
        with faults.kept():
            informed([belief], ())
    for doubt in Definition(experiment.folder).doubts() if len(faults) else ():
        faults.add(doubt)
    faults.end()
    return with_scale(experiment)


@dataclass(frozen=True)
class ScaleSettings:
    """From where on the scale of readings is suspicious.

    Parameters
    ----------
    draws : int
        Rigs drawn from the prior.
    readings : int
        Of more readings than this, every second, third or so is looked at.
    nearly_all : float
        Share of the rigs that must agree: of true rigs, drawn from the prior, one in fifty is warned of without need.
    unit : float
        What a wrong unit makes of a reading.
    factor : float
        Between groups, which neither waveform nor frequency explains for nearly any rig; half way to a wrong unit.
    """

    draws: int = 256
    readings: int = 2000
    nearly_all: float = 0.98
    unit: float = 1000.0
    factor: float = 30.0


def with_scale(experiment: Experiment) -> Experiment:
    """The experiment, its warnings extended by what its readings' scale says of their unit.

    Parameters
    ----------
    experiment : Experiment

    Returns
    -------
    Experiment
    """
    found = []
    groups = [g for g in experiment.groups if not _is_explained(experiment, g)]
    for observable in OBSERVABLES:
        parts = (p for g in groups for p in g.parts if p.observable is observable)
        if moving := tuple(filter(None, map(_moving, parts))):
            found += _off_scale(experiment, moving, observable)
    return replace(experiment, warnings=(*experiment.warnings, *map(one_line, found))) if found else experiment


def _is_explained(experiment: Experiment, group: Group) -> bool:
    """Whether the scale of a group's readings hangs on what is suspicious itself."""
    constants = group.rig(experiment.constants)
    facts = contradicted(experiment.rig, constants, experiment.beliefs) if experiment.rig else []
    return bool(facts or suspicious_constants(constants) or suspicious_conditions(group))


def _off_scale(experiment: Experiment, moving: tuple[Group, ...], observable: Observable) -> list[str]:
    """What is suspicious of the readings of one observable; see the module."""
    settings = ScaleSettings()
    nearly_all, far = settings.nearly_all, math.log(settings.factor)
    read = observable.titles
    every = -(-sum(g.n_points for g in moving) // settings.readings)
    groups = replace(experiment, groups=moving).thinned(every).groups
    design = Design.of(experiment.constants, groups)
    parameters, _ = informed(experiment.beliefs, ())
    quantiles = qmc.Sobol(len(parameters), rng=0).random(settings.draws)
    rigs = [p.to_physical(p.prior_quantile(q)) for p, q in zip(parameters, quantiles.T, strict=True)]
    predicted = np.abs(readings(design, np.stack(rigs, axis=1)))
    rows = [design.group == k for k in range(len(moving))]
    still = [np.mean(np.median(predicted[:, mine], axis=1) == 0) > nearly_all for mine in rows]
    if any(still):
        driven = tuple(g for g, rests in zip(moving, still, strict=True) if not rests)
        found = [_undriven(g, nearly_all) for g, rests in zip(moving, still, strict=True) if rests]
        return found + (_off_scale(experiment, driven, observable) if driven else [])
    size = np.abs(np.concatenate([g.reading for g in groups]))
    ratio = np.log(size) - np.log(np.maximum(predicted, 1e-12))
    of_group = np.array([np.median(ratio[:, mine], axis=1) for mine in rows])
    middle = of_group[::-1] if len(moving) == 2 else np.broadcast_to(np.median(of_group, axis=0), of_group.shape)
    off = of_group - middle
    found = []
    for way, sign in (("below", -1), ("above", 1)):
        asked = observable.asked(large=sign > 0)
        alone = np.mean(sign * of_group > 0, axis=1) > nearly_all
        if alone.all():
            own = float(np.median(size))
            low, high = np.quantile(np.median(predicted, axis=1), [1.0 - nearly_all, nearly_all]).tolist()
            # In another unit, readings do not lie beyond all rigs on the other side.
            other = own / settings.unit >= low if sign > 0 else own * settings.unit <= high
            why = f"are they {asked}, are columns swapped, or is a constant" if other else "is a constant or a prior"
            limit = f"most {significant(high, 2)}" if sign > 0 else f"least {significant(low, 2)}"
            found.append(
                f"{read} lie {way} those of {100 * nearly_all:.0f} % of the rigs that the prior holds (median"
                f" {significant(own, 2)} {observable.unit}, theirs at {limit} {observable.unit}); {why} wrong?"
            )
            continue
        for group, apart, odd in zip(moving, off, alone, strict=True):
            # Of two groups, each is off the other.
            if np.mean(sign * apart > far) > nearly_all and (odd or len(moving) != 2):
                found.append(
                    f"{group.file}: group {group.id}: {read} lie {way} the other groups' by a factor of about"
                    f" {_factor(apart)}; {asked}?"
                )
    if len(moving) == 2 and not found and np.mean(np.abs(off[0]) > far) > nearly_all:
        one, two = moving
        found.append(
            f"{one.file}: group {one.id}: {read} differ from those of group {two.id} by a factor of about"
            f" {_factor(off[0])} that hardly any rig explains; is one of them given in another unit?"
        )
    return found


def _undriven(group: Group, nearly_all: float) -> str:
    """What is suspicious of a group of which the simulation never launches the ball."""
    return (
        f"{group.file}: group {group.id}: this drive launches no ball in {100 * nearly_all:.0f} % of the rigs that the"
        " prior holds, but the readings are above zero; is the sign of the voltage right, and waveform, bias_v, idle_v"
        " and drive?"
    )


def _moving(group: Group) -> Group | None:
    """The part of a group that gives a scale: the ball was driven, and moved; along a trace, far."""
    size = np.abs(group.reading)
    rows = (size > (0.5 * size.max() if group.time_us is not None else 0.0)) & group.driven
    return replace(group.at(rows), sigma=None) if rows.any() else None


def _factor(apart: FloatArray) -> str:
    return f"{math.exp(abs(float(np.median(apart)))):.0f}"

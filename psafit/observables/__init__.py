"""What is read of a launch: one file each, and one line in `OBSERVABLES`."""

from __future__ import annotations

from collections.abc import Iterable

from psafit.observables.contact_time import CONTACT_TIME
from psafit.observables.displacement import DISPLACEMENT
from psafit.observables.launch_range import LAUNCH_RANGE
from psafit.observables.launch_speed import LAUNCH_SPEED
from psafit.observables.observable import Launches, Motion, Observable, in_another_unit
from psafit.observables.peak_force import PEAK_FORCE
from psafit.observables.tip_displacement import TIP_DISPLACEMENT
from psafit.observables.velocity import VELOCITY

OBSERVABLES: tuple[Observable, ...] = (
    LAUNCH_RANGE, LAUNCH_SPEED, CONTACT_TIME, PEAK_FORCE, DISPLACEMENT, VELOCITY, TIP_DISPLACEMENT
)  # fmt: skip
"""All observables; a reading's `measured` counts them from 0. New ones go behind: stored numbers keep their meaning."""
NUMBERED = tuple((k, o) for k, o in enumerate(OBSERVABLES) if not o.traced)
"""Observables that are read of a launch as a whole, with their numbers."""
OF_LAUNCHES = tuple(o for _, o in NUMBERED)
"""The same without."""


def named(name: str | None) -> Observable:
    """The observable of a record's name: see `recorded_name`."""
    return next((o for o in OBSERVABLES if o.name == name), LAUNCH_RANGE)


def recorded_name(observable: Observable) -> str | None:
    """What records call it: its name, and nothing for the launch range."""
    return None if observable is LAUNCH_RANGE else observable.name


def aside(name: str | None) -> str:
    """``, launch speeds``, as a text says of a record's name what was read; nothing of the launch range."""
    return next((f", {o.titles}" for o in OBSERVABLES if o.name == name), "")


def names(read: Iterable[tuple[object, str | None]]) -> list[str]:
    """What readings are called: by their group and, unless all are launch ranges, by what is read.

    >>> names([(5, None), (5, "contact_time")])
    ['5 (launch range)', '5 (contact time)']

    Parameters
    ----------
    read : iterable of (group id, str or None)
        The observable as `recorded_name` has it.
    """
    every = list(read)
    if not any(observable for _, observable in every):
        return [str(id) for id, _ in every]
    return [f"{id} ({(observable or LAUNCH_RANGE.name).replace('_', ' ')})" for id, observable in every]


__all__ = [
    "CONTACT_TIME", "DISPLACEMENT", "LAUNCH_RANGE", "LAUNCH_SPEED", "NUMBERED", "OBSERVABLES", "OF_LAUNCHES",
    "PEAK_FORCE", "TIP_DISPLACEMENT", "VELOCITY", "Launches", "Motion", "Observable", "aside", "in_another_unit",
    "named", "names", "recorded_name",
]  # fmt: skip

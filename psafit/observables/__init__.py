"""What is read of a launch: one file each, and one line in `OBSERVABLES`."""

from __future__ import annotations

from psafit.observables.contact_time import CONTACT_TIME
from psafit.observables.launch_range import LAUNCH_RANGE
from psafit.observables.launch_speed import LAUNCH_SPEED
from psafit.observables.observable import Launches, Observable
from psafit.observables.peak_force import PEAK_FORCE

OBSERVABLES: tuple[Observable, ...] = (LAUNCH_RANGE, LAUNCH_SPEED, CONTACT_TIME, PEAK_FORCE)
"""All observables; a reading's `measured` counts them from 0. New ones go behind: stored numbers keep their meaning."""

__all__ = ["CONTACT_TIME", "LAUNCH_RANGE", "LAUNCH_SPEED", "OBSERVABLES", "PEAK_FORCE", "Launches", "Observable"]

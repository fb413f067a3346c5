"""Batch simulator: exact closed form, and the literal references beside it (`reference`)."""

from psafit.simulate.batch import MICRO, Simulation, columns, launch_range, path_of, rig_of, simulate
from psafit.simulate.contact import Contact, contact
from psafit.simulate.design import Design

__all__ = [
    "MICRO",
    "Contact",
    "Design",
    "Simulation",
    "columns",
    "contact",
    "launch_range",
    "path_of",
    "rig_of",
    "simulate",
]

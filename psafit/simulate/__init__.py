"""Batch simulator: exact closed form, and the literal references next to it (`reference`)."""

# First: what follows cannot be imported under settings that this refuses.
from psafit.simulate import environment  # noqa: F401 # isort: split
from psafit.simulate.batch import MICRO, Simulation, columns, launch_range, path_of, readings, rig_of, simulate
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
    "readings",
    "rig_of",
    "simulate",
]

"""Batch simulator: exact closed form, and the literal references beside it (`reference`)."""

from psafit.simulate.batch import Simulation, launch_range, simulate
from psafit.simulate.contact import Contact, contact
from psafit.simulate.design import Design

__all__ = ["Contact", "Design", "Simulation", "contact", "launch_range", "simulate"]

"""Which drive variable a group sweeps, and how the group is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from psafit.arrays import FloatArray
from psafit.experiment import Conditions, changes_text
from psafit.observables import LAUNCH_RANGE

Variable = Literal["frequency", "amplitude", "time", "order"]

SWEPT: Final = {"frequency": "drive frequency", "amplitude": "drive amplitude", "time": "time"}
AXIS: Final = {"frequency": "Drive frequency (Hz)", "amplitude": "Drive amplitude (V)", "time": "Time (µs)"}
UNITS: Final = {"frequency": "Hz", "amplitude": "V", "time": "us"}
NBSP = "\N{NO-BREAK SPACE}"


@dataclass(frozen=True)
class Sweep:
    """The abscissa of a group.

    Parameters
    ----------
    variable : {"frequency", "amplitude", "time", "order"}
        What varies: time along a trace; "order" where both or neither of the others do.
    values : (n_points,) array
        Hz, V, us, or the number of the row.
    label : str
        Of the axis, with unit.
    log : bool
        Whether it spans enough for a logarithmic axis.
    condition : str
        What is held, e.g. ``"sine, 1.2 kHz"``; the ranges of both where nothing is.
    extent : str
        What varies, from where to where.
    read : str
        What is read, where a page shows several observables.
    """

    variable: Variable
    values: FloatArray
    label: str
    log: bool
    condition: str
    extent: str
    read: str = ""

    @property
    def held(self) -> str:
        """What is read, where that is said, and the condition."""
        return f"{self.read}, {self.condition}" if self.read else self.condition

    @property
    def over(self) -> str:
        """What varies, in words."""
        return SWEPT.get(self.variable, "the number of the reading")


def sweeps_of(groups: Sequence[Conditions]) -> list[Sweep]:
    """Sweeps of one observable each; unless all are of launch ranges, with what is read."""
    ranges = all(g.observable is LAUNCH_RANGE for g in groups)
    return [replace(sweep_of(g), read="" if ranges else g.observable.title) for g in groups]


def frequency_text(value: float) -> str:
    """Return a frequency with its unit."""
    return f"{value / 1e3:.4g}{NBSP}kHz" if value >= 1e3 else f"{value:.4g}{NBSP}Hz"


def _volts(value: float) -> str:
    return f"{value:.4g}{NBSP}V"


def _extent(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


def sweep_of(group: Conditions, least: float = 1e-12) -> Sweep:
    """Decide from the data which variable a group sweeps.

    A logarithmic axis is of no use for voltages below this part of the largest.
    """
    f, v = group.frequency_hz, group.amplitude_v
    f_text = _extent(frequency_text(float(f.min())), frequency_text(float(f.max())))
    v_text = _extent(_volts(float(v.min())), _volts(float(v.max())))

    rig = changes_text(group.changed, NBSP)
    if group.varied == ("frequency",):
        log = bool(f.max() >= 3 * f.min())
        held = _volts(float(np.median(v)))
        return Sweep("frequency", f, AXIS["frequency"], log, f"{group.drive.label}, {held}{rig}", f_text)
    if group.varied == ("amplitude",):
        log = bool(v.min() > least * v.max() and v.max() >= 5 * v.min())
        held = frequency_text(float(np.median(f)))
        return Sweep("amplitude", v, AXIS["amplitude"], log, f"{group.drive.label}, {held}{rig}", v_text)
    if group.time_us is not None:
        ends = _extent(*(f"{t:.4g}" for t in (group.time_us.min(), group.time_us.max())))
        held = f"{group.drive.label}, {f_text}, {v_text}{rig}"
        return Sweep("time", group.time_us, AXIS["time"], False, held, f"{ends}{NBSP}µs")
    order = np.arange(1.0, group.n_points + 1)
    held = f"{group.drive.label}, {f_text}, {v_text}{rig}"
    rows = f"{group.n_points} reading{'' if group.n_points == 1 else 's'}"
    return Sweep("order", order, "Reading, in the file's order", False, held, rows)

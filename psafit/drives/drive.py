"""The drive of a group: a waveform and what is done with it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from psafit.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Table:
    """A drive in rows, linear in between.

    Parameters
    ----------
    at : (n_rows,) array
        Phases of one period, from 0 to 1; of a recording times from the start of the drive, s. Two rows at one place
        are a jump.
    value : (n_rows,) array
        Level per volt of amplitude; of a recording V.
    recorded : bool
        Whether it is a voltage that was recorded, which runs once and rests at its last value.
    """

    at: FloatArray
    value: FloatArray
    recorded: bool

    def __post_init__(self) -> None:
        for name in ("at", "value"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        at = self.at
        if at.ndim != 1 or at.size < 2 or at.shape != self.value.shape:
            raise ValueError("a table of a drive has at least two rows, each with a place and a value")
        if not (np.isfinite(at).all() and np.isfinite(self.value).all() and (np.diff(at) >= 0).all() and at[0] >= 0):
            raise ValueError("places in the table of a drive must be finite, begin at 0 or later and never fall")
        if not self.recorded and not (at[0] == 0.0 and at[-1] == 1.0):
            raise ValueError("phases of a period must begin at 0 and end at 1")
        if self.recorded and not at[-1] > 0.0:
            raise ValueError("a recording has no length")

    @property
    def span(self) -> tuple[float, float]:
        """The lowest and the highest voltage per volt of amplitude, which of a recording is its largest voltage."""
        largest = float(np.abs(self.value).max()) if self.recorded else 1.0
        low, high = float(self.value.min()), float(self.value.max())
        return (low / largest, high / largest) if largest else (0.0, 1.0)

    @property
    def key(self) -> tuple[bool, bytes, bytes]:
        """What distinguishes it from others."""
        return self.recorded, self.at.tobytes(), self.value.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Table) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True)
class Drive:
    r"""The voltage of a group of launches.

    .. math:: u(t) = u_b + V w(f t + \varphi/360°), \qquad 0 \le t < n/f,

    and the idle voltage before and after. A recorded voltage is taken as it is.

    Parameters
    ----------
    waveform : str
        Name of a waveform, or ``"table"``.
    bias_v, idle_v : float, V
        Added to the command; and what the drive rests at. Stack and ball rest in equilibrium under the latter.
    phase_deg : float, degrees
        Phase at t = 0.
    cycles : float
        Periods that the drive lasts.
    table : Table, optional
        With ``"table"``; None where only the name is known, as in a file of predictions.
    file : str
        The CSV file of the table, relative to the experiment's folder.
    """

    waveform: str
    bias_v: float = 0.0
    idle_v: float = 0.0
    phase_deg: float = 0.0
    cycles: float = math.inf
    table: Table | None = None
    file: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.waveform != "table" and self.table is not None:
            raise ValueError(f"a table with the waveform {self.waveform}")
        if not (math.isfinite(self.bias_v) and math.isfinite(self.idle_v) and math.isfinite(self.phase_deg)):
            raise ValueError("bias_v, idle_v and phase_deg must be finite")
        if not self.cycles > 0.0:
            raise ValueError("cycles must be positive")
        if self.recorded and (self.bias_v or self.phase_deg or self.cycles < math.inf):
            raise ValueError("a recorded voltage is taken as it is: no bias_v, phase_deg or cycles")

    @classmethod
    def of(cls, given: Drive | str) -> Drive:
        """A drive; the name of a waveform alone is that one with nothing changed."""
        return cls(given) if isinstance(given, str) else given

    @classmethod
    def with_settings(cls, waveform: str, settings: Mapping[str, float]) -> Drive:
        """A periodic drive with `settings` as the property has them."""
        usual = cls(waveform)
        return cls(
            waveform,
            settings.get("bias_v", usual.bias_v),
            settings.get("idle_v", usual.idle_v),
            settings.get("phase_deg", usual.phase_deg),
            settings.get("cycles", usual.cycles),
        )

    @property
    def recorded(self) -> bool:
        """Whether the voltage was recorded."""
        return self.table is not None and self.table.recorded

    @property
    def plain(self) -> bool:
        """Whether it is a waveform from 0 V that runs on, with nothing changed."""
        return self.waveform != "table" and not self.settings

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of a group in `experiment.toml` other than `waveform`, those that are not the usual."""
        usual = Drive("")
        names = ("bias_v", "idle_v", "phase_deg", "cycles")
        changed = {name: getattr(self, name) for name in names if getattr(self, name) != getattr(usual, name)}
        return changed | ({"drive": self.file} if self.table else {})

    @property
    def label(self) -> str:
        """What figures and tables call it."""
        text = "recorded drive" if self.recorded else self.waveform.replace("_", " ")
        parts = [f"{name.removesuffix('_v')} {value:g} V" for name, value in self.settings.items() if name[-2:] == "_v"]
        parts += [f"phase {self.phase_deg:g} deg"] if self.phase_deg else []
        parts += [f"{self.cycles:g} period{'s' * (self.cycles != 1)}"] if self.cycles < math.inf else []
        return " ".join([text, *([f"({', '.join(parts)})"] if parts else [])])

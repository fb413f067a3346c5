"""What an observable is: one quantity that a rig reads of every launch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from psafit.arrays import FloatArray
from psafit.parameters import Bounds, LogNormal, Parameter


class Launches(Protocol):
    """What an observable takes from a simulation: arrays of shape (n_sets, n_points), SI units.

    `psafit.simulate.Simulation` says what each holds.
    """

    @property
    def launch_range(self) -> FloatArray: ...  # noqa: D102
    @property
    def separation_time(self) -> FloatArray: ...  # noqa: D102
    @property
    def separation_speed(self) -> FloatArray: ...  # noqa: D102
    @property
    def launched(self) -> NDArray[np.bool_]: ...  # noqa: D102
    @property
    def peak_force(self) -> FloatArray | None: ...  # noqa: D102


class Motion(NamedTuple):
    """What a trace takes from a simulation: arrays of shape (n_sets, n_samples).

    Parameters
    ----------
    ball, tip : array, m
        Displacements from where ball and tip rest before the drive begins.
    ball_speed : array, m/s
    """

    ball: FloatArray
    ball_speed: FloatArray
    tip: FloatArray


@dataclass(frozen=True, kw_only=True)
class Observable:
    """One quantity that is read of a launch, or along its trace.

    Parameters
    ----------
    name : str
        As in file names: ``predictions-<name>.csv``.
    column : str
        Of a group's CSV file: the name and the unit.
    unit : str
        Unit of the column, for people.
    scale : float
        Number of that unit in one of the SI.
    title : str
        What it is called in sentences and figures.
    called : tuple of str
        What instruments and spreadsheets call it, in small letters; its title where nothing is said.
    of : callable
        ``of(launches)``, or ``of(motion)`` of a trace, is the reading without scatter, SI units; (n_sets, n_points).
    scatter : tuple of Parameter
        Relative scatter, absolute scatter and degrees of freedom, and of a trace the correlation time; see
        `psafit.inference.noise`.
    offset : float
        Of the error metric, in the column's unit; see `log_ratio`.
    limits : (float, float)
        Hard limits of a reading, far beyond any rig.
    still : float
        A reading at most so far below zero is put down to scatter about zero. It is what the prior of a fit holds the
        absolute scatter to, with 98 %.
    usual : (float, float)
        Readings of a group that are all below the first, or reach beyond the second, look like another unit.
    mistaken : (tuple of str, tuple of str)
        Units that may be meant: larger ones, the first by a thousand, and smaller ones, the first by a thousandth.
    instead : str
        What else readings that are too small may be, in words.
    blank : bool
        Whether a launch that failed has no such reading. Others read zero then.
    grows : bool
        Whether it is larger by about the factor of the drive's voltage; a time is not.
    force : bool
        Whether it asks the simulation for the peak force, which takes longer.
    traced : bool
        Whether it is read along the motion, at moments, and has either sign.
    tip : bool
        Whether it is the tip's, which moves on after the launch.
    """

    name: str
    column: str
    unit: str
    scale: float
    title: str
    of: Callable[[Any], FloatArray]
    scatter: tuple[Parameter, ...]
    offset: float
    limits: tuple[float, float]
    still: float
    usual: tuple[float, float]
    mistaken: tuple[tuple[str, ...], tuple[str, ...]]
    called: tuple[str, ...] = ()
    blank: bool = False
    grows: bool = True
    force: bool = False
    traced: bool = False
    tip: bool = False
    instead: str = ""

    def __post_init__(self) -> None:
        if not self.column.startswith(f"{self.name}_"):
            raise ValueError(f"column {self.column} is not {self.name} and a unit")
        if not self.offset > 0:
            raise ValueError(f"{self.name}: the offset must be positive, got {self.offset}")

    @property
    def metric(self) -> tuple[float, bool]:
        """What the error metric takes: the offset, and whether readings have either sign."""
        return self.offset, self.traced

    @property
    def titles(self) -> str:
        """More than one of them, in sentences."""
        return f"{self.title.removesuffix('y')}ies" if self.title.endswith("y") else f"{self.title}s"

    @property
    def plural(self) -> str:
        """What several readings are called, in one word."""
        return self.titles.split()[-1]

    def asked(self, *, large: bool) -> str:
        """What is asked of readings that are too large, or too small, for their unit: see `in_another_unit`."""
        return in_another_unit(self.unit, *self.mistaken, large=large, instead=self.instead)

    @property
    def sigma_column(self) -> str:
        """Column of the readings' own standard uncertainties."""
        return f"sigma_{self.column.removeprefix(self.name + '_')}"


def in_another_unit(unit: str, larger: Sequence[str], smaller: Sequence[str], *, large: bool, instead: str = "") -> str:
    """How numbers come to be too large for their unit, or too small; the first of the other units are 1000 times off.

    Either they are in another unit, or they were right and converted as if they were.
    """
    if large:
        return f"given in {unit} and taken for {larger[0]}, 1000 times too large, or given in {' or '.join(smaller)}"
    others = [" or ".join(larger), *([instead] if instead else [])]
    return f"given in {', or '.join(others)}, or in {unit} and taken for {smaller[0]}, 1000 times too small"


def scatter(
    suffix: str, unit: str, relative: LogNormal, absolute: LogNormal, bounds: Bounds, why: tuple[str, str]
) -> tuple[Parameter, Parameter, Parameter]:
    """The scatter's three parameters of one observable.

    Parameters
    ----------
    suffix : str
        Behind each parameter's name; empty for the launch range.
    unit : str
    relative, absolute : LogNormal
        Priors of the relative scatter and of the absolute one.
    bounds : Bounds
        Of the absolute scatter.
    why : (str, str)
        Where the two priors come from.
    """
    of = f" of the {suffix.replace('_', ' ')}" if suffix else " of a reading"
    behind = f"_{suffix}" if suffix else ""
    sub = rf",\mathrm{{{suffix.replace('_', chr(92) + ' ')}}}" if suffix else ""
    return (
        Parameter(
            name=f"sigma_rel{behind}", symbol=rf"\sigma_{{rel{sub}}}", unit="1", bounds=Bounds(1e-3, 2.0),
            prior=relative, description=f"relative scatter{of}", source=why[0],
        ),
        Parameter(
            name=f"sigma_abs{behind}", symbol=rf"\sigma_{{abs{sub}}}", unit=unit, bounds=bounds,
            prior=absolute, description=f"absolute scatter{of}", source=why[1],
        ),
        Parameter(
            name=f"nu{behind}",
            symbol=rf"\nu_{{{sub.lstrip(',')}}}" if suffix else r"\nu",
            unit="1",
            bounds=Bounds(2.0, 100.0),
            prior=LogNormal(10.0, 2.5),
            description=f"degrees of freedom of the scatter{of if suffix else ''} (small: outliers; large: normal)",
            source="between frank outliers (4) and practically normal (25), as in Juarez and Steel, J. Appl. Econom. 25"
            " (2010)",
        ),
    )  # fmt: skip


def along(three: tuple[Parameter, Parameter, Parameter]) -> tuple[Parameter, ...]:
    """The parameters of a scatter and, behind them, its correlation time along a trace."""
    of = three[1].name.removeprefix("sigma_abs_")
    sub = of.replace("_", chr(92) + " ")
    return (
        *three,
        Parameter(
            name=f"tau_{of}", symbol=rf"\tau_{{\mathrm{{{sub}}}}}", unit="us", bounds=Bounds(1e-2, 1e5),
            prior=LogNormal(20.0, 5.0),
            description=f"correlation time of the scatter of the {of.replace('_', ' ')} along a trace",
            source="between the filter of a vibrometer (1 us at 200 kHz) and the rest motion of a ball (milliseconds)",
        ),
    )  # fmt: skip

"""What is wrong, as a record holds it: tests, places, readings, what is left, and laws that are broken."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from psafit.diagnose.misfit import Character, Coincidence, Statistic, Tested
from psafit.diagnose.robustness import Robustness
from psafit.diagnose.show import Offset
from psafit.diagnose.significance import Significance
from psafit.experiment import GroupId, Swept
from psafit.observables import named
from psafit.records import ABSENT


@dataclass(frozen=True)
class Where:
    """Where predictions err to one side.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude", "time"}
        What the group's sweep varies, or along a trace.
    start, to : float, Hz, V or us
        The stretch; the key of `start` is "from".
    text : str
        The same in words.
    log_bias : float
        Mean of ln(predicted/measured) there.
    score : float
        By how many standard deviations.
    together : list of group ids
        Other groups whose readings stand out at the same condition.
    observable : str, optional
        What was read there, if not the launch range.
    """

    group: GroupId
    variable: Swept
    start: float = field(metadata={"key": "from"})
    to: float
    text: str
    log_bias: float
    score: float
    together: list[GroupId]
    observable: str | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Condition:
    """Where a reading was taken.

    Parameters
    ----------
    group : group id
    number : int
        Row of the group's table, from 0.
    frequency_hz, amplitude_v : float
    time_us : float, optional
        Of a sample of a trace, from the start of the drive.
    """

    group: GroupId
    number: int
    frequency_hz: float
    amplitude_v: float
    time_us: float | None = field(default=None, metadata=ABSENT, kw_only=True)


@dataclass(frozen=True)
class Reading(Condition):
    """One reading far from a model.

    Parameters
    ----------
    group, number, frequency_hz, amplitude_v, time_us
        As of `Condition`.
    reading, predicted : float
        In the unit of what was read; the keys end with `_um`.
    score : float
        In standard deviations of the scatter.
    observable : str, optional
        What was read, by its name; left out for the launch range.
    repeats : list of float, optional
        Other readings of the group at the same condition, in that unit; left out where there are none.
    """

    reading: float = field(metadata={"key": "reading_um"})
    predicted: float = field(metadata={"key": "predicted_um"})
    score: float
    observable: str | None = field(default=None, metadata=ABSENT)
    repeats: list[float] | None = field(default=None, metadata=ABSENT)

    @property
    def unit(self) -> str:
        """Unit of the reading."""
        return named(self.observable).unit


@dataclass(frozen=True)
class Tests(Tested):
    """What the tests say of one model: see `psafit.diagnose.misfit.Misfit`; `where` of the extension only.

    `floor` is the least p value that so many simulated data sets can give: one at it means "at most".
    """

    p_value: float
    character: Character
    furthest: list[Reading]
    odd_groups: list[GroupId]
    odd_points: list[tuple[GroupId, int]]
    coincidences: list[Coincidence]
    statistics: list[Statistic]
    n_simulated: int
    refit: str
    usual_tails: float | None = field(default=None, metadata=ABSENT)
    where: list[Where] | None = field(default=None, metadata=ABSENT)
    floor: float = 0.0


@dataclass(frozen=True)
class GroupDiscrepancy:
    """Mean and largest absolute discrepancy of a group, in ln units; None where no reading shows one.

    `observable` is what was read, if not the launch range.
    """

    group: GroupId
    mean: float | None
    largest: float | None
    observable: str | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class DiscrepancyResult:
    """A discrepancy added to the best model: see `psafit.diagnose.discrepancy.Discrepancy`."""

    log_bayes: float
    amplitude: float
    level: float
    reach: float
    sigma_rel: float
    groups: list[GroupDiscrepancy]
    mean: list[float]
    sd: list[float | None]


@dataclass(frozen=True)
class MisfitResult:
    """Where and how the baseline fails, by the tests and by what is left of the readings.

    Parameters
    ----------
    p_value : float
        Of the baseline's tests.
    where : list of Where
    baseline, extended : Tests
        The second where the best model has causes.
    leftover : DiscrepancyResult
    sessions : list of Offset
    robustness : Robustness, optional
    search : Significance, optional
    """

    p_value: float
    where: list[Where]
    baseline: Tests
    leftover: DiscrepancyResult
    sessions: list[Offset] = field(default_factory=list)
    extended: Tests | None = field(default=None, metadata=ABSENT)
    robustness: Robustness | None = field(default=None, metadata=ABSENT)
    search: Significance | None = field(default=None, metadata=ABSENT)


Axis = Literal["frequency", "amplitude", "range"]


@dataclass(frozen=True)
class Draft:
    """The draft that was written.

    Parameters
    ----------
    file : str
        In the folder of the diagnosis.
    axis : {"frequency", "amplitude", "range"}
        What the factor depends on; the last is what is predicted of the observable.
    place : float, Hz, V or the unit of the observable
        Where it departs most from one.
    factor : float
        By how much, there.
    width : float
        Of the departure, in the logarithm.
    share : float
        Of the discrepancy's squares at all readings that it takes up, a factor common to each observable aside.
    added : bool
        Whether it is for what the named causes leave; else it stands in their place.
    observable : str, optional
        On which the factor is, where that is not the launch range.
    """

    file: str
    axis: Axis
    place: float
    factor: float
    width: float
    share: float
    added: bool = True
    observable: str | None = field(default=None, metadata=ABSENT)

"""The models of a diagnosis: their parameters and evidence, what is drawn of them, and what each cause could add."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final, Literal

from psafit.diagnose.record.misfit import Condition
from psafit.diagnose.show import Corner, Drift, Growth, Line
from psafit.experiment import GroupId
from psafit.inference.samplers.nautilus import NestedEvidence
from psafit.records import ABSENT, Brief, Overdamped, occasion


@dataclass(frozen=True)
class ParameterResult:
    """A parameter of one model.

    Parameters
    ----------
    median, lower, upper : float
        In `unit`; the ends of the 90 % interval are None where the model was not sampled.
    unit, description : str
    prior_share : float
        Quantile of the prior at which the median lies; nan where that is not known.
    reciprocal : str, optional
        Unit of its reciprocal, where that is the quantity that people know.
    prior_lower, prior_upper : float, optional
        Central 90 % interval of the prior.
    """

    median: float
    lower: float | None
    upper: float | None
    unit: str
    description: str
    prior_share: float
    reciprocal: str | None = field(default=None, metadata=ABSENT)
    prior_lower: float | None = field(default=None, metadata=ABSENT)
    prior_upper: float | None = field(default=None, metadata=ABSENT)

    @property
    def prior_interval(self) -> tuple[float, float] | None:
        """The ends of the prior's 90 % interval; None where that is not known."""
        return None if self.prior_lower is None or self.prior_upper is None else (self.prior_lower, self.prior_upper)

    @property
    def interval(self) -> tuple[float, float] | None:
        """The ends of the 90 % interval; None where the model was not sampled."""
        return None if self.lower is None or self.upper is None else (self.lower, self.upper)


@dataclass(frozen=True)
class Evidence:
    """Evidence of one model, nats.

    Parameters
    ----------
    log_evidence, over_baseline : float
    gain : float
        Of the log likelihood at the top, over the baseline's.
    share : float
        Probability if the catalogue holds the truth; that the search has missed the set that leads is counted.
    method : {"adaptive importance sampling", "Laplace"}
        The second where a short fit's estimate is all that is known.
    error, effective_draws, pareto_k : float, optional
        Of importance sampling.
    prior_width : dict, optional
        Change of the log evidence when the priors of the causes' parameters are "half" and "twice" as wide.
    nautilus : NestedEvidence, optional
    prior_odds : float, optional
        Log odds of the set against no cause at all before any reading, nats; `over_baseline` is added by the readings.
    """

    log_evidence: float
    over_baseline: float
    gain: float
    share: float
    method: Literal["adaptive importance sampling", "Laplace"]
    error: float | None = field(default=None, metadata=ABSENT)
    effective_draws: float | None = field(default=None, metadata=ABSENT)
    pareto_k: float | None = field(default=None, metadata=ABSENT)
    prior_width: dict[str, float] | None = field(default=None, metadata=ABSENT)
    nautilus: NestedEvidence | None = field(default=None, metadata=ABSENT)
    prior_odds: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class SessionResult:
    """What a session has by a cause: a gain, a lean.

    Parameters
    ----------
    cause : str
    group : int or str
        The first that was measured in the session.
    value : ParameterResult
    session : int or str, optional
        Its name, where it has one.
    instrument : str, optional
        Of what one instrument has in a session, its name.
    """

    cause: str
    group: GroupId
    value: ParameterResult
    session: GroupId | None = field(default=None, metadata=ABSENT)
    instrument: str | None = field(default=None, metadata=ABSENT)

    @property
    def where(self) -> str:
        """The session, as people know it."""
        return occasion(self.group, self.session, self.instrument)


@dataclass(frozen=True, repr=False)
class CauseResult(Brief):
    """One model of the model set.

    Parameters
    ----------
    terms : list of str
        Its causes; empty for the baseline.
    probability : float
        Posterior probability that these causes are at work and no other that shows: see
        `psafit.model_search.visibility`.
    parameters : dict of str to ParameterResult
    evidence : Evidence
    implausible : list of str
        Parameters whose median lies where less than one twentieth of the prior is as thin; never those whose prior is
        uniform.
    sessions : list of SessionResult, optional
        What each session has, by causes that differ by session.
    overdamped : Overdamped, optional
        Where the whole interval of the stack's damping is beyond the critical one.
    again : float, optional, nats
        Of a tied set: by how much all these readings, measured once more, would separate its best fit from that of the
        best model, on average.
    """

    _in_repr = ("terms", "probability")

    terms: list[str]
    probability: float
    parameters: dict[str, ParameterResult]
    evidence: Evidence
    implausible: list[str]
    sessions: list[SessionResult] | None = field(default=None, metadata=ABSENT)
    overdamped: Overdamped | None = field(default=None, metadata=ABSENT)
    again: float | None = field(default=None, metadata=ABSENT)

    @property
    def sampled(self) -> bool:
        """Whether the model was sampled, and not only fitted."""
        return self.evidence.method != "Laplace"


@dataclass(frozen=True)
class Counted:
    """A set with more causes than the adopted one: the readings speak for it by little, or the rig does.

    Parameters
    ----------
    terms : list of str
        Its causes, those of the adopted set among them.
    odds : float
        Against the adopted set alone, priors included.
    by_readings : float, optional
        The factor of these odds that comes from the readings.
    parameters : dict of str to ParameterResult
        Of the causes that it has more.
    moved : dict of str to ParameterResult
        Parameters that the adopted set has, too, and that would lie outside their interval there.
    """

    terms: list[str]
    odds: float
    parameters: dict[str, ParameterResult]
    moved: dict[str, ParameterResult]
    by_readings: float | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class Without:
    """The best set of all fitted that lacks a cause of the named one.

    Parameters
    ----------
    cause : str
    terms : list of str
        The set; none for the baseline.
    nats : float
        Log posterior that the named set has more, where causes that are likely beforehand count as even odds.
    sampled : bool
        Whether the evidence of the set was sampled; otherwise it is the estimate of a short fit.
    """

    cause: str
    terms: list[str]
    nats: float
    sampled: bool


@dataclass(frozen=True)
class Look:
    """A reported cause that a look at the rig itself shows, without launches.

    Parameters
    ----------
    cause : str
    at : str
        What to look at, and with what: see `psafit.physics.term.Term`.
    probability : float
        That the cause is at work, given that the catalogue holds the truth.
    separates : bool
        Whether some reported set has the cause and another has not.
    parameters : dict of str to ParameterResult
        What the readings say of its parameters, by the most probable reported set that has it.
    """

    cause: str
    at: str
    probability: float
    separates: bool
    parameters: dict[str, ParameterResult]


ScreeningWord = Literal[
    "present",
    "in the best extension",
    "as good",
    "among the next best",
    "explains part alone",
    "not present",
    "not excluded",
    "could not have been seen",
    "does not act on what was read",
]
"""What the whole model set says of one cause."""


NOT_PRESENT: Final = "not present"
"""What is said of a cause of which the readings leave less than would be seen."""

NOT_EXCLUDED: Final = "not excluded"
"""What is said of a cause that does not show, where the readings leave it more than would be seen."""


UNSEEN: Final = "could not have been seen"
"""What is said of a cause of which even a plausible strength would not show."""


NEAREST: Final = "in the best extension"
"""What is said of a cause by which readings that no cause explains are explained best."""


NEXT_BEST: Final = "among the next best"
"""What is said of a cause of the sets that come next, where no set explains the readings."""


@dataclass(frozen=True)
class ScreeningResult:
    """What one cause could add; see `psafit.diagnose.screening`.

    Parameters
    ----------
    id : str
        The cause.
    verdict : str
        In words; "could not have been seen" is said given the adopted model.
    gain, refit_gain : float, nats
        By it alone, added to the baseline: of the log posterior in the expansion, of the log likelihood when fitted.
    chance : float, nats
        What scatter alone gains in the expansion once in twenty times.
    log_bayes : float
        Evidence that it adds to the baseline, by the expansion.
    strength : float
        At which it gains that, in `unit`.
    unit : str
    visible : float
        Size of a plausible effect given the adopted model, in standard deviations of its scatter.
    inclusion : float
        Probability that it is among the causes, given that the catalogue holds the truth.
    plausible : float
        The strength meant there, in `unit`: as far from neutral as the prior is in the median, on the likelier side;
        nan in records of earlier versions.
    room : float or None
        Largest change of a range, as a share of it, that the readings leave it given the adopted model (95 %); see
        `psafit.diagnose.room`. None where it is not known, as given a model that does not explain the readings.
    left : float or None
        What they leave it of an effect (95 %), measured as `visible` is.
    room_at : Condition, optional
        The reading that may change so.
    """

    id: str
    verdict: ScreeningWord
    gain: float
    refit_gain: float
    chance: float
    log_bayes: float
    strength: float
    unit: str
    visible: float
    inclusion: float
    plausible: float = math.nan
    room: float | None = None
    left: float | None = None
    room_at: Condition | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class ModelShown:
    """What is drawn of one model: see `psafit.diagnose.show`.

    Parameters
    ----------
    growth, corners, drift, lines : lists
    predicted : list of float
        At all readings, one group after the other, each in its unit; the key ends with `_um`, as that of `without`.
    without : dict of str to list of float
        By cause: the same without it.
    parameters : dict
        Values of the best fit.
    """

    growth: list[Growth]
    corners: list[Corner]
    drift: list[Drift]
    lines: list[Line]
    predicted: list[float] = field(metadata={"key": "predicted_um"})
    without: dict[str, list[float]] = field(metadata={"key": "without_um"})
    parameters: dict[str, float]


@dataclass(frozen=True)
class Apart:
    """How far a chain and importance draws are apart: see `psafit.records.ImportanceSummary`."""

    parameter: str
    apart: float
    by_chance: float
    effective: float


@dataclass(frozen=True)
class ExtensionRun:
    """Causes that were fitted and sampled like any run.

    Parameters
    ----------
    folder : str
    groups : list of group ids
        Fitted.
    terms : list of str
    scored_on : list of group ids
    converged : bool
    message : str
    importance : Apart
    holdout_log_rmse : float, optional
    """

    folder: str
    groups: list[GroupId]
    terms: list[str]
    scored_on: list[GroupId]
    converged: bool
    message: str
    importance: Apart
    holdout_log_rmse: float | None

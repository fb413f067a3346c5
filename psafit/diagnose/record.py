"""What a diagnosis leaves behind: `diagnosis.json`, as frozen records."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from psafit.diagnose.confusable import Confounded
from psafit.diagnose.gain import Choice, Gain
from psafit.diagnose.influence import Influence
from psafit.diagnose.misfit import Character, Coincidence, Statistic
from psafit.diagnose.next_experiment import NextExperiment, Rehearsal
from psafit.diagnose.robustness import Robustness
from psafit.diagnose.settings import Settings
from psafit.diagnose.show import Corner, Drift, Growth, Line, Offset
from psafit.diagnose.significance import Significance
from psafit.diagnose.trials import Calibration, VerdictWord
from psafit.errors import InputError
from psafit.experiment import GroupId
from psafit.files import sha256
from psafit.inference.samplers.nautilus import NestedEvidence
from psafit.model_search.model_set import LookedAt
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.records import ABSENT, Brief, Numerics

RESULT, PAGE, PREDICTIONS = "diagnosis.json", "diagnosis.html", "predictions-diagnosis.csv"
# Names of causes in a headline.
_NAMES = 6
MARKER = ".psafit-diagnosis"
"""In a folder that a diagnosis has made its own, and of which readings."""


def is_diagnosis(folder: Path) -> bool:
    """Whether a folder holds a diagnosis; `InputError` where it holds neither that nor a fit."""
    found = (folder / RESULT).exists()
    if not found and not (folder / "fit.json").exists():
        what = "holds neither a finished fit nor a finished diagnosis" if folder.is_dir() else "is not a run folder"
        raise InputError(what, "give a folder that psafit fit or psafit diagnose has written", file=folder)
    return found


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
    """

    median: float
    lower: float | None
    upper: float | None
    unit: str
    description: str
    prior_share: float


@dataclass(frozen=True)
class Evidence:
    """Evidence of one model, nats.

    Parameters
    ----------
    log_evidence, over_baseline : float
    gain : float
        Of the log likelihood at the top, over the baseline's.
    share : float
        Probability if the catalogue holds the truth and the search has missed nothing.
    method : {"adaptive importance sampling", "Laplace"}
        The second where a short fit's estimate is all that is known.
    error, effective_draws, pareto_k : float, optional
        Of importance sampling.
    prior_width : dict, optional
        Change of the log evidence when the priors of the causes' parameters are "half" and "twice" as wide.
    nautilus : NestedEvidence, optional
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


@dataclass(frozen=True, repr=False)
class CauseResult(Brief):
    """One model of the model set.

    Parameters
    ----------
    terms : list of str
        Its causes; empty for the baseline.
    probability : float
        Posterior probability that these causes are at work and no other that can be seen: larger sets whose evidence
        is not better by three nats are counted with it.
    parameters : dict of str to ParameterResult
    evidence : Evidence
    implausible : list of str
        Parameters whose median lies where the prior has less than one chance in twenty, or at a bound; never those
        whose prior is uniform.
    """

    _in_repr = ("terms", "probability")

    terms: list[str]
    probability: float
    parameters: dict[str, ParameterResult]
    evidence: Evidence
    implausible: list[str]

    @property
    def sampled(self) -> bool:
        """Whether the model was sampled, and not only fitted."""
        return self.evidence.method != "Laplace"

    @property
    def strange(self) -> list[str]:
        """Its implausible parameters, the scatter's aside."""
        scatter = {p.name for o in OBSERVABLES for p in o.scatter}
        return [name for name in self.implausible if name not in scatter]


# Probability of a discrepancy without a name from which on it is told.
_TOLD = 0.001

NOT_EXCLUDED = "not excluded"
"""What is said of a cause that does not show, where the readings leave it more than would be seen."""

UNSEEN = "could not have been seen"
"""What is said of a cause of which even a plausible strength would not show."""

NEAREST = "in the best extension"
"""What is said of a cause by which readings that no cause explains are explained best."""


@dataclass(frozen=True)
class ScreeningResult:
    """What one cause could add; see `psafit.diagnose.screening`.

    Parameters
    ----------
    id : str
        The cause.
    verdict : str
        In words; "could not have been seen" is said beside the adopted model.
    gain, refit_gain : float, nats
        By it alone beside the baseline: of the log posterior in the expansion, of the log likelihood when fitted.
    chance : float, nats
        What scatter alone gains in the expansion once in twenty times.
    log_bayes : float
        Evidence that it adds to the baseline, by the expansion.
    strength : float
        At which it gains that, in `unit`.
    unit : str
    visible : float
        Size of a plausible effect beside the adopted model, in standard deviations of its scatter.
    inclusion : float
        Probability that it is among the causes, given that the catalogue holds the truth.
    plausible : float
        The strength meant there, in `unit`: as far from neutral as the prior is in the median, on the likelier side;
        nan in records of earlier versions.
    room : float or None
        Largest change of a range, as a share of it, that the readings leave it beside the adopted model (95 %); see
        `psafit.diagnose.room`.
    left : float or None
        What they leave it of an effect (95 %), measured as `visible` is.
    """

    id: str
    verdict: str
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


@dataclass(frozen=True)
class Where:
    """Where predictions err to one side.

    Parameters
    ----------
    group : group id
    variable : {"frequency", "amplitude"}
        What the group's sweep varies.
    start, to : float, Hz or V
        The stretch; the key of `start` is "from".
    text : str
        The same in words.
    log_bias : float
        Mean of ln(predicted/measured) there.
    score : float
        By how many standard deviations.
    together : list of group ids
        Other groups whose readings stand out at the same condition.
    """

    group: GroupId
    variable: Literal["frequency", "amplitude"]
    start: float = field(metadata={"key": "from"})
    to: float
    text: str
    log_bias: float
    score: float
    together: list[GroupId]


@dataclass(frozen=True)
class Reading:
    """One reading far from a model.

    Parameters
    ----------
    group : group id
    number : int
        In the group, from 0.
    frequency_hz, amplitude_v, reading_um, predicted_um : float
        In the unit of another observable than the launch range where `observable` names one.
    score : float
        In standard deviations of the scatter.
    observable : str, optional
        What was read, by its name; left out for the launch range.
    """

    group: GroupId
    number: int
    frequency_hz: float
    amplitude_v: float
    reading_um: float
    predicted_um: float
    score: float
    observable: str | None = field(default=None, metadata=ABSENT)

    @property
    def unit(self) -> str:
        """Of the reading."""
        return next((o.unit for o in OBSERVABLES if o.name == self.observable), LAUNCH_RANGE.unit)


@dataclass(frozen=True)
class Tests:
    """What the tests say of one model: see `psafit.diagnose.misfit.Misfit`; `where` of the extension only."""

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


@dataclass(frozen=True)
class GroupDiscrepancy:
    """Mean and largest absolute discrepancy of a group, in ln units; None where no reading tells of one."""

    group: GroupId
    mean: float | None
    largest: float | None


@dataclass(frozen=True)
class DiscrepancyResult:
    """An unnamed discrepancy beside the best model: see `psafit.diagnose.discrepancy.Discrepancy`."""

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
    """What is wrong.

    Parameters
    ----------
    p_value : float
        Of the baseline's tests.
    where : list of Where
    baseline, extended : Tests
        The second where the best model has causes.
    leftover : DiscrepancyResult
    sessions : list of Offset
    remains : bool, optional
        Whether structure remains beside the causes of an extension that does not explain the readings.
    robustness : Robustness, optional
    search : Significance, optional
    """

    p_value: float
    where: list[Where]
    baseline: Tests
    leftover: DiscrepancyResult
    sessions: list[Offset] = field(default_factory=list)
    extended: Tests | None = field(default=None, metadata=ABSENT)
    remains: bool | None = field(default=None, metadata=ABSENT)
    robustness: Robustness | None = field(default=None, metadata=ABSENT)
    search: Significance | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class ModelShown:
    """What is drawn of one model: see `psafit.diagnose.show`.

    Parameters
    ----------
    growth, corners, drift, lines : lists
    predicted_um : list of float
        At all readings, one group after the other.
    without_um : dict of str to list of float
        By cause: the same without it.
    parameters : dict
        Values of the best fit.
    """

    growth: list[Growth]
    corners: list[Corner]
    drift: list[Drift]
    lines: list[Line]
    predicted_um: list[float]
    without_um: dict[str, list[float]]
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


@dataclass(frozen=True)
class Confusion:
    """What these conditions could tell apart.

    Parameters
    ----------
    alike : list of Confounded
    proposal, truth, before, after, first
        Of tied models: `psafit.diagnose.next_experiment.Rehearsal` of the same conditions again.
    """

    alike: list[Confounded] = field(default_factory=list)
    proposal: str | None = field(default=None, metadata=ABSENT)
    truth: list[list[str]] | None = field(default=None, metadata=ABSENT)
    before: list[float] | None = field(default=None, metadata=ABSENT)
    after: list[float] | None = field(default=None, metadata=ABSENT)
    first: int | None = field(default=None, metadata=ABSENT)

    @property
    def repeated(self) -> Rehearsal | None:
        """The experiments repeated, if any were."""
        if self.proposal is None or self.first is None:
            return None
        return Rehearsal(self.proposal, self.truth or [], self.before or [], self.after or [], self.first)


Axis = Literal["frequency", "amplitude", "range"]


@dataclass(frozen=True)
class Draft:
    """The draft that was written.

    Parameters
    ----------
    file : str
        In the folder of the diagnosis.
    axis : {"frequency", "amplitude", "range"}
        What the factor depends on.
    place : float, Hz, V or um
        Where it departs most from one.
    factor : float
        By how much, there.
    width : float
        Of the departure, in the logarithm.
    share : float
        Of the discrepancy's squares that it takes up, a factor common to all readings aside.
    """

    file: str
    axis: Axis
    place: float
    factor: float
    width: float
    share: float


Law = Literal["carried", "energy"]


@dataclass(frozen=True)
class Broken:
    """One law that a model breaks, where it breaks it most.

    Parameters
    ----------
    law : {"carried", "energy"}
    terms : list of str
        The model's causes.
    group : str or int
    frequency_hz, amplitude_v : float
        Of the reading.
    value, limit : float
        What the model says, and what the law allows: ranges in um ("carried", at least), energies in J ("energy", at
        most).
    readings : int
        At which the law is broken, of those that were asked.
    text : str
        The same in words.
    """

    law: Law
    terms: list[str]
    group: GroupId
    frequency_hz: float
    amplitude_v: float
    value: float
    limit: float
    readings: int
    text: str


@dataclass(frozen=True, repr=False)
class Diagnosis(Brief):
    """`diagnosis.json`.

    Parameters
    ----------
    schema : int
    verdict : {"adequate", "explained", "ambiguous", "unexplained"}
    named : list of str
        The adopted extension.
    alternatives : list of lists of str
        Sets that fit as well; an empty one is the baseline.
    causes : list of CauseResult
        Most probable first.
    looked_at : LookedAt
        Sets of causes that were fitted on all readings, those of them of which the evidence is an estimate, and the
        probability that these estimates add up to.
    misfit : MisfitResult
    numerics : Numerics
        Refinement of the predictions at the fitted parameters.
    gain : dict of str to Gain
        "strict" and "nested"; empty after `--quick`.
    next_experiment : NextExperiment
    predictions : str
        CSV of the extension fitted to everything the verdict used.
    sentences : list of str
        The answer in words.
    unnamed : float
        Probability that something is wrong which no cause describes.
    screening : list of ScreeningResult
    show : dict of str to ModelShown
        "baseline", and "extended" where the best model has causes.
    ledger : list of Choice
    extension : dict of str to ExtensionRun
        Causes fitted with lmfit and emcee like any run, each with its folder, groups, terms, whether the chain has
        converged, and the score on other groups: "adopted", those named, fitted to all groups; "strict", those that the
        training groups name by themselves, fitted to these alone. Empty after `--quick`; nothing named, nothing fitted.
    title, fingerprint, groups, training, seed, quick, versions, command, seconds
        Where it comes from.
    files : dict
        SHA-256 of each table of predictions.
    confusion : Confusion
    identity : str
        SHA-256 of all that determines the result.
    left_out : list of str
        Causes of the catalogue that the diagnosis was asked not to look at.
    settings : Settings
        How much work went into each part.
    laws : list of Broken
        Laws that hold whatever the causes are, and that the model adopted, or one of the first alternatives, breaks.
    calibration : Calibration, optional
        How often such a verdict is right at these conditions, where that was asked for.
    influence : Influence, optional
        Which readings the causes live on, where some are named.
    draft : Draft, optional
        What no cause explains, described as a cause: see `psafit.diagnose.draft`.
    """

    _in_repr = ("verdict", "named", "title", "quick")

    schema: int
    verdict: VerdictWord
    named: list[str]
    alternatives: list[list[str]]
    causes: list[CauseResult]
    looked_at: LookedAt
    misfit: MisfitResult
    numerics: Numerics
    gain: dict[str, Gain]
    next_experiment: NextExperiment
    predictions: str
    sentences: list[str]
    unnamed: float
    screening: list[ScreeningResult]
    show: dict[str, ModelShown]
    extension: dict[str, ExtensionRun]
    ledger: list[Choice]
    title: str
    fingerprint: str
    groups: list[GroupId]
    training: list[GroupId]
    seed: int
    quick: bool
    versions: dict[str, str]
    command: str
    seconds: dict[str, float]
    files: dict[str, str] = field(default_factory=dict)
    confusion: Confusion = field(default_factory=Confusion)
    identity: str = ""
    left_out: list[str] = field(default_factory=list)
    settings: Settings = field(default_factory=Settings)
    laws: list[Broken] = field(default_factory=list)
    calibration: Calibration | None = field(default=None, metadata=ABSENT)
    influence: Influence | None = field(default=None, metadata=ABSENT)
    draft: Draft | None = field(default=None, metadata=ABSENT)

    @property
    def best_model(self) -> CauseResult | None:
        """The adopted model, where it is among the models of the record."""
        return next((c for c in self.causes if c.terms == self.named), None)

    @property
    def strange(self) -> list[str]:
        """Parameters of what is named whose values are implausible, the scatter's aside."""
        return self.best_model.strange if self.best_model and self.named else []

    @property
    def headline(self) -> str:
        """The verdict in a line: the named set, and those that do as well, by name as long as these are few."""
        sets = [self.named] if self.named else []
        if self.verdict == "ambiguous":
            sets += self.alternatives
        listed = [ids for k, ids in enumerate(sets) if k == 0 or sum(map(len, sets[: k + 1])) <= _NAMES]
        words = [" + ".join(ids) or "nothing" for ids in listed]
        if more := len(sets) - len(listed):
            words.append(f"{more} more set{'' if more == 1 else 's'}")
        n = len(self.screening)
        restricted = f" (of {n} cause{'' if n == 1 else 's'} looked at)" if self.left_out else ""
        strange = " (at implausible values)" if self.verdict == "explained" and self.strange else ""
        return f"verdict: {self.verdict}" + (f": {', or '.join(words)}" if words else "") + strange + restricted

    def table(self, folder: Path, name: str) -> Path:
        """A table of predictions, refused where somebody has changed it."""
        seal = self.files.get(name)
        if seal and (folder / name).is_file() and sha256(folder / name) != seal:
            raise InputError("was changed after the diagnosis", "run psafit diagnose again", file=folder / name)
        return folder / name

    @property
    def mostly_unnamed(self) -> bool:
        """Whether a discrepancy without a name is more probable than all that has one."""
        return self.unnamed > 0.5

    @property
    def reports_unnamed(self) -> bool:
        """Whether a discrepancy without a name is probable enough to stand among the models."""
        return self.unnamed >= _TOLD

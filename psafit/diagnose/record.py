"""What a diagnosis leaves behind: `diagnosis.json`, as frozen records."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from psafit.diagnose.settings import Settings
from psafit.errors import InputError
from psafit.experiment import GroupId
from psafit.experiment.text import listed
from psafit.files import sha256
from psafit.model_search.ladder import LookedAt
from psafit.records import Brief
from psafit.text import fixed

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


@dataclass(frozen=True, repr=False)
class CauseResult(Brief):
    """One model of the ladder.

    Parameters
    ----------
    terms : list of str
        Its causes; empty for the baseline.
    probability : float
        Posterior probability that these causes are at work and no other that can be seen: larger sets whose evidence
        is not better by three nats are counted with it.
    parameters : dict
        By name: median, lower and upper (90 % interval), unit, and the quantile of the prior at which the median lies.
    evidence : dict
        log_evidence, over_baseline (nats), gain (of the log likelihood at the top), error, effective draws, pareto_k,
        method ("Laplace" where a short fit's estimate is all that is known), and how the evidence changes when the
        priors of the strengths are half and twice as wide.
    implausible : list of str
        Parameters whose median lies where the prior has less than one chance in twenty, or at a bound; never those
        whose prior is uniform.
    """

    _told = ("terms", "probability")

    terms: list[str]
    probability: float
    parameters: dict[str, dict[str, Any]]
    evidence: dict[str, Any]
    implausible: list[str]


# Probability of a discrepancy without a name from which on it is told.
_TOLD = 0.001

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
    misfit : dict
        p_value, where, what the tests say of the baseline and of the extension, and whether structure remains beside
        the causes of an extension that does not explain the readings.
    numerics : dict
        Refinement of the predictions at the fitted parameters.
    gain : dict
        "strict" and "nested"; empty after `--quick`.
    next_experiment : dict
    predictions : str
        CSV of the extension fitted to everything the verdict used.
    sentences : list of str
        The answer in words.
    unnamed : float
        Probability that something is wrong which no cause describes.
    screening : list of ScreeningResult
    show : dict
        Growth and drift of baseline and extension.
    ledger : list of dict
        Which data each choice saw.
    extension : dict
        Causes fitted with lmfit and emcee like any run, each with its folder, groups, terms, whether the chain has
        converged, and the score on other groups: "adopted", those named, fitted to all groups; "strict", those that the
        training groups name by themselves, fitted to these alone. Empty after `--quick`; nothing named, nothing fitted.
    title, fingerprint, groups, training, seed, quick, versions, command, seconds
        Where it comes from.
    files : dict
        SHA-256 of each table of predictions.
    confusion : dict
        Of tied models: how often the one that made the readings comes out first when the same conditions are measured
        again in simulation (`psafit.diagnose.rehearsal.Rehearsal`). Empty where nothing is tied, and after `--quick`.
    identity : str
        SHA-256 of all that determines the result.
    left_out : list of str
        Causes of the catalogue that the diagnosis was asked not to look at.
    settings : Settings
        How much work went into each part.
    laws : list of Broken
        Laws that hold whatever the causes are, and that the model adopted, or one of the first alternatives, breaks.
    """

    _told = ("verdict", "named", "title", "quick")

    schema: int
    verdict: str
    named: list[str]
    alternatives: list[list[str]]
    causes: list[CauseResult]
    looked_at: LookedAt
    misfit: dict[str, Any]
    numerics: dict[str, Any]
    gain: dict[str, Any]
    next_experiment: dict[str, Any]
    predictions: str
    sentences: list[str]
    unnamed: float
    screening: list[ScreeningResult]
    show: dict[str, Any]
    extension: dict[str, Any]
    ledger: list[dict[str, Any]]
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
    confusion: dict[str, Any] = field(default_factory=dict)
    identity: str = ""
    left_out: list[str] = field(default_factory=list)
    settings: Settings = field(default_factory=Settings)
    laws: list[Broken] = field(default_factory=list)

    @property
    def breaks(self) -> list[str]:
        """Return a sentence for each law that is broken."""
        laws = {
            "carried": "A ball cannot move less than the tip carries it",
            "energy": "A ball cannot gain more than the drive gives",
        }
        return [
            f"{laws[b.law]}. {' + '.join(b.terms) or 'The baseline'} breaks that law at"
            f" {b.readings} reading{'' if b.readings == 1 else 's'}, most at {b.text}."
            for b in self.laws
        ]

    @property
    def restricted(self) -> str:
        """Return the sentence that says to which causes the diagnosis was restricted; empty where to none."""
        if not self.left_out:
            return ""
        looked_at = listed([s.id for s in self.screening])
        return (
            f"Only {looked_at} {'was' if len(self.screening) == 1 else 'were'} looked at, as asked:"
            f" the verdict says nothing of the catalogue's {len(self.left_out)} other"
            f" cause{'' if len(self.left_out) == 1 else 's'}."
        )

    @property
    def searched(self) -> str:
        """Return what says how many sets of causes were looked at, and what the others may hold."""
        missed = fixed(self.settings.search.missed, 0, per_cent=True)
        return f"{self._counted} The chance that a better set was missed is {missed} %, a part of every probability."

    @property
    def _counted(self) -> str:
        fitted, estimated = self.looked_at.fitted, self.looked_at.estimated
        head = f"{fitted:,} set{' of causes was' if fitted == 1 else 's of causes were'} fitted on all readings"
        if not estimated:
            return f"{head}{' and' if fitted == 1 else ', all of them'} sampled."
        mass = self.looked_at.mass_not_looked_at
        share = fixed(mass, 1, per_cent=True)
        share = "less than 0.1" if share == "0.0" and mass > 0 else share
        others = "the other has" if estimated == 1 else "the others have"
        together = "" if estimated == 1 else " together"
        return f"{head}, {fitted - estimated:,} of them sampled; {others} {share} % of the probability{together}."

    @property
    def headline(self) -> str:
        """The verdict in a line: the named set, and those that do as well, by name as long as these are few."""
        sets = [self.named] if self.named else []
        if self.verdict == "ambiguous":
            sets += self.alternatives
        told = [ids for k, ids in enumerate(sets) if k == 0 or sum(map(len, sets[: k + 1])) <= _NAMES]
        words = [" + ".join(ids) or "nothing" for ids in told]
        if more := len(sets) - len(told):
            words.append(f"{more} more set{'' if more == 1 else 's'}")
        n = len(self.screening)
        restricted = f" (of {n} cause{'' if n == 1 else 's'} looked at)" if self.left_out else ""
        return f"verdict: {self.verdict}" + (f": {', or '.join(words)}" if words else "") + restricted

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
    def tells_unnamed(self) -> bool:
        """Whether a discrepancy without a name is probable enough to stand among the models."""
        return self.unnamed >= _TOLD

"""What a diagnosis leaves behind: `diagnosis.json`, as frozen records."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from psafit.diagnose.confusable import Confounded
from psafit.diagnose.gain import Choice, Gain
from psafit.diagnose.influence import Influence
from psafit.diagnose.next_experiment import NextExperiment, Rehearsal
from psafit.diagnose.record.misfit import Draft, MisfitResult
from psafit.diagnose.record.models import CauseResult, Counted, ExtensionRun, Look, ModelShown, ScreeningResult, Without
from psafit.diagnose.settings import Settings
from psafit.diagnose.trials import Calibration, VerdictWord, Why, stands
from psafit.errors import InputError
from psafit.experiment import GroupId
from psafit.files import sha256
from psafit.model_search.model_set import LookedAt
from psafit.records import ABSENT, Brief, Broken, Numerics
from psafit.text import set_name

RESULT, PAGE, PREDICTIONS = "diagnosis.json", "diagnosis.html", "predictions-diagnosis.csv"
PREVIOUS = "previous"
"""The folder within that of a diagnosis that keeps the answer before, to another question about the same readings."""


# Names of causes in a headline.
_NAMES = 6


MARKER = ".psafit-diagnosis"
"""In a folder that a diagnosis has made its own, and of which readings."""


def is_diagnosis(folder: Path) -> bool:
    """Whether a folder holds a diagnosis; `InputError` where it holds neither that nor a fit."""
    found = (folder / RESULT).exists()
    if not found and not (folder / "fit.json").exists():
        what = "holds neither a finished fit nor a finished diagnosis" if folder.is_dir() else "is not a run folder"
        remedy = "give a folder that psafit fit or psafit diagnose has written"
        if (folder / MARKER).is_file():
            what, remedy = "holds a diagnosis that has not ended", "wait for it, or repeat its command, which goes on"
            if (folder / PREVIOUS / RESULT).is_file():
                remedy = f"{remedy}; the answer before is in {PREVIOUS}/"
        raise InputError(what, remedy, file=folder)
    return found


# Probability of a discrepancy without a name from which on it is reported.
_REPORTED = 0.001


@dataclass(frozen=True)
class Confusion:
    """What these conditions could distinguish.

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
        Sets that do as well: needed for 95 % of the probability, or fitting as well; an empty one is the baseline.
    causes : list of CauseResult
        The named set first, then the most probable.
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
    by_likelihood : list of lists of str
        Alternatives that fit as well, and that are not needed for 95 % of the probability.
    unexplained_by : {"", "structure", "smooth", "law", "values"}
        Why what is named does not explain the readings: structure remains, a smooth curve in its place is more
        probable, it breaks a law, or it has implausible values. An ambiguous verdict has one of the last two, too.
    counted : list of Counted
        Larger sets than what is named, or than the baseline of an adequate verdict, for which the readings speak by
        too little to go on from, or which are more probable by what is known of the rig.
    without : list of Without
        Of each named cause the best set that lacks it, the nearest first.
    looks : list of Look
        What a look at the rig itself would show of the reported causes, without launches; see `psafit.diagnose.looks`.
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
    unexplained_by: Why = ""
    by_likelihood: list[list[str]] = field(default_factory=list)
    counted: list[Counted] = field(default_factory=list)
    without: list[Without] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    calibration: Calibration | None = field(default=None, metadata=ABSENT)
    influence: Influence | None = field(default=None, metadata=ABSENT)
    draft: Draft | None = field(default=None, metadata=ABSENT)

    @property
    def best_model(self) -> CauseResult | None:
        """The adopted model, where it is among the models of the record."""
        return next((c for c in self.causes if c.terms == self.named), None)

    @property
    def explains(self) -> bool:
        """Whether what it says is put forward as the truth: see `psafit.diagnose.trials.stands`."""
        return stands(self.verdict, self.unexplained_by)

    @property
    def headline(self) -> str:
        """The verdict in a line: the named set, and those that do as well, by name as long as these are few."""
        sets = [self.named] if self.named else []
        if self.verdict == "ambiguous":
            sets += sorted(self.alternatives, key=lambda ids: ids in self.by_likelihood)
        listed = [ids for k, ids in enumerate(sets) if k == 0 or sum(map(len, sets[: k + 1])) <= _NAMES]
        words = [("by likelihood alone " if ids in self.by_likelihood else "") + self._marked(ids) for ids in listed]
        if more := len(sets) - len(listed):
            words.append(f"{more} more set{'' if more == 1 else 's'}")
        n = len(self.screening)
        restricted = f" (of {n} cause{'' if n == 1 else 's'} looked at)" if self.left_out else ""
        head = "; best of the catalogue: " if self.verdict == "unexplained" else ": "
        first = max(self.causes, key=lambda c: c.probability, default=None)
        if self.verdict == "adequate" and first and first.terms:
            return f"verdict: adequate, though {' + '.join(first.terms)} is more probable{restricted}"
        return f"verdict: {self.verdict}" + (f"{head}{', or '.join(words)}" if words else "") + restricted

    def _marked(self, ids: list[str]) -> str:
        """A set by its causes, marked where it is no explanation whatever its probability."""
        text = set_name(ids, "nothing")
        if any({*law.terms} == {*ids} for law in self.laws):
            return f"{text} (breaks a law)"
        return f"{text} (at implausible values)" if ids == self.named and self.unexplained_by == "values" else text

    def table(self, folder: Path, name: str) -> Path:
        """A table of predictions, refused where somebody has changed it."""
        seal = self.files.get(name)
        if seal and (folder / name).is_file() and sha256(folder / name) != seal:
            raise InputError("was changed after the diagnosis", "run psafit diagnose again", file=folder / name)
        return folder / name

    @property
    def leaves_tied(self) -> bool:
        """Whether more sets are tied than the proposals of a quick diagnosis distinguish."""
        purpose = self.next_experiment.purpose
        of_sets = purpose is not None and purpose.kind == "separate"
        return self.quick and of_sets and len(self.alternatives) > 1

    @property
    def mostly_unnamed(self) -> bool:
        """Whether a discrepancy without a name is more probable than all that has one."""
        return self.unnamed > 0.5

    @property
    def reports_unnamed(self) -> bool:
        """Whether a discrepancy without a name is probable enough to stand among the models."""
        return self.unnamed >= _REPORTED

"""The answer of a diagnosis: statements with their numbers, and for each the one sentence that says it.

`answer` reads the record and chooses what may be said. Each statement knows its sentence, and takes the words for
causes, groups and numbers from `psafit.diagnose.words.Words`: the record's plain ones, or a page's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from psafit.diagnose.gain import Gain
from psafit.diagnose.influence import Carried
from psafit.diagnose.misfit import ALPHA, CHARACTERS, Character
from psafit.diagnose.next_experiment import CLEAR, NextExperiment, Purpose
from psafit.diagnose.record import UNSEEN, Broken, CauseResult, Diagnosis, Draft, ParameterResult, Reading
from psafit.diagnose.significance import OTHERWISE, Significance
from psafit.diagnose.trials import Calibration, VerdictWord
from psafit.diagnose.words import PLAIN, Words
from psafit.experiment import GroupId
from psafit.inference import noise
from psafit.model_search.model_set import CREDIBLE, LookedAt
from psafit.physics import owner
from psafit.text import fixed, significant

Topic = Literal["scope", "adequate", "wrong", "detail", "trust", "gained", "next", "searched"]
"""Part of the answer to which a statement belongs."""

# Probability of a discrepancy without a name, or of another set, from which on it is worth a sentence.
_WORTH_SAYING = 0.05
# Sets that do as well as what is named, and are told by name.
_TIED = 6
_TAILS = noise.PARAMETERS[-1]


@dataclass(frozen=True)
class Statement:
    """One thing that a diagnosis says."""

    topic: ClassVar[Topic]

    def say(self, words: Words) -> str:
        """Return the sentence."""
        raise NotImplementedError


@dataclass(frozen=True)
class Restricted(Statement):
    """The causes that were looked at, where the catalogue has others."""

    topic = "scope"
    looked_at: list[str]
    left_out: int

    def say(self, words: Words) -> str:
        """Return the sentence."""
        return words.put(
            "Only {} {} looked at, as asked: the verdict says nothing of the catalogue's {} other cause{}.",
            words.listed(self.looked_at), "was" if len(self.looked_at) == 1 else "were", self.left_out,
            "" if self.left_out == 1 else "s",
        )  # fmt: skip


@dataclass(frozen=True)
class Judged(Statement):
    """Whether the baseline is adequate.

    Parameters
    ----------
    adequate : {"yes", "so far", "no", "together", "tails", "improbable"}
        Whether it is; only as far as the readings tell, where something else is more probable; not rejected by the
        tests, but by readings that stand out together, or only for the heavy tails of its scatter; not rejected, but
        improbable.
    p_value : float
        Family-wise; with no heavier tails than usual where these were needed.
    simulated : int
        Data sets that gave it.
    share : float
        What the baseline keeps of the probability of all sets of the catalogue.
    unnamed : bool
        Whether what is more probable has no name.
    """

    topic = "adequate"
    adequate: Literal["yes", "so far", "no", "together", "tails", "improbable"]
    p_value: float
    simulated: int
    share: float
    unnamed: bool

    def say(self, words: Words) -> str:
        """Return the sentence."""
        heads = {
            "no": "The tests find the baseline wrong: {}.",
            "together": "The tests do not reject the baseline ({}), but readings of {} stand out together.",
            "tails": "The tests pass the baseline only because heavy tails take up what stands out; without: {}.",
            "improbable": "The tests do not reject the baseline ({}), but it is improbable beside {}.",
            "yes": "The tests find nothing wrong with the baseline: {}. It keeps {} of the probability.",
            "so far": "The tests find nothing wrong with the baseline: {}. It keeps only {} of the probability.",
        }
        least = self.p_value <= 1 / (self.simulated + 1)
        few = "none" if least else words.fraction(self.p_value) if self.p_value < 0.1 else words.per_cent(self.p_value)
        how = words.put(
            "of {} data sets made by the fitted baseline itself, {} look at least as odd; below {} it counts as wrong",
            self.simulated, few, words.per_cent(ALPHA),
        )  # fmt: skip
        rest = words.per_cent(self.share)
        if self.adequate == "together":
            rest = "several groups"
        elif self.adequate == "improbable":
            rest = "a discrepancy without a name" if self.unnamed else "an extended model"
        return words.put(heads[self.adequate], how, rest)


@dataclass(frozen=True)
class NothingShows(Statement):
    """No cause is needed; which sets are not excluded, with their probabilities."""

    topic = "wrong"
    not_excluded: list[tuple[list[str], float]]

    def say(self, words: Words) -> str:
        """Return the sentence."""
        others = [words.put("{} ({})", words.causes(ids), words.per_cent(p)) for ids, p in self.not_excluded]
        text = "No cause is needed to explain these readings."
        return words.put(text + " Nor can they exclude {}.", words.listed(others)) if others else text


@dataclass(frozen=True)
class Named(Statement):
    """What is named, and what does as well.

    Parameters
    ----------
    verdict : {"explained", "ambiguous", "unexplained"}
    causes : list of str
        Best first; empty where no cause helps.
    probability : float, optional
        None where it says nothing.
    alternatives : list of lists of str
    fits_alike : bool
        Whether only what is plausible beforehand speaks for the first of several.
    rejected : bool
        Whether the tests reject the baseline.
    left : {"", "structure", "smooth", "law"}
        Why the best extension does not explain the readings: structure remains, a smooth curve in its place is more
        probable, or it breaks a law that holds whatever the causes are.
    p_after : float, optional
        Family-wise p value beside the extension.
    unnamed : float
        Probability of a discrepancy without a name.
    looked_at : LookedAt
    restricted : bool
    strange : bool
        Whether what is named has implausible values: then it explains nothing, however well it fits.
    """

    topic = "wrong"
    verdict: VerdictWord
    causes: list[str]
    probability: float | None
    alternatives: list[list[str]]
    fits_alike: bool
    rejected: bool
    left: Literal["", "structure", "smooth", "law"]
    p_after: float | None
    unnamed: float
    looked_at: LookedAt
    restricted: bool
    strange: bool

    def say(self, words: Words) -> str:
        """Return the sentence."""
        what = words.causes(self.causes)
        if self.probability is not None:
            what = words.put("{} (probability {})", what, words.per_cent(self.probability))
        texts = [words.instead(self.causes, ids) for ids in self.alternatives[:_TIED]]
        if more := len(self.alternatives) - len(texts):
            texts.append(f"{more} more set{'' if more == 1 else 's'}")
        tied = words.joined("; or ", texts)
        unnamed = words.put(" A discrepancy without a name keeps {} of the probability.", words.per_cent(self.unnamed))
        rest = unnamed if self.unnamed >= _WORTH_SAYING else ""
        if self.verdict == "explained":
            other = self.looked_at.no_other("set of these causes" if self.restricted else "set")
            how = "{} explains the misfit; the tests find nothing left of it, and {} does as well.{}"
            if not self.rejected:
                how = "{} fits far better, and {} does as well; the tests alone would not have objected.{}"
            if self.strange:
                how = "{} takes up what is wrong, and {} does as well, but at values that are implausible: that is the"
                how += " shape of what is missing, and perhaps not the mechanism.{}"
            return words.put(how, what, other, rest)
        if self.verdict == "ambiguous":
            if self.fits_alike:
                how = "{} is most plausible, but these readings cannot separate it from what fits as well: {}.{}"
                return words.put(how, what, tied, rest)
            how = "These readings cannot tell which of {} sets of causes it is: {}; or {}.{}"
            return words.put(how, len(self.alternatives) + 1, what, tied, rest)
        if not self.causes:
            looked = "that was looked at" if self.restricted else "of the catalogue"
            return words.put("No cause {} explains what these readings show.{}", looked, rest)
        why = {
            "structure": "structure remains that no cause describes",
            "smooth": "a smooth curve in its place is more probable",
            "law": "it breaks a law that holds whatever the causes are",
        }[self.left or "structure"]
        odd = "" if self.p_after is None else f"family-wise p = {significant(self.p_after, 2)}; "
        also = words.put(" Not to be told apart from {}: {}.", words.causes(self.causes), tied) if texts else ""
        return words.put(
            "The best extension is {}, but {} ({}probability of an unnamed discrepancy {}).{}",
            what, why, odd, words.per_cent(self.unnamed), also,
        )  # fmt: skip


@dataclass(frozen=True)
class Kind(Statement):
    """What kind of thing is wrong with the baseline."""

    topic = "wrong"
    character: Character
    groups: list[GroupId]
    points: int

    def say(self, words: Words) -> str:
        """Return the sentence."""
        which = {"group": f": {', '.join(map(str, self.groups))}", "points": f": {self.points} of them"}
        return words.put("Of the baseline: {}{}.", CHARACTERS[self.character], which.get(self.character, ""))


@dataclass(frozen=True)
class Sizes(Statement):
    """How large the causes are: each parameter with its value, of what is named and of what does as well."""

    topic = "wrong"
    named: list[tuple[str, ParameterResult]]
    others: list[tuple[str, ParameterResult]]

    def say(self, words: Words) -> str:
        """Return the sentence."""
        own, others = (self._by_cause(words, values) for values in (self.named, self.others))
        if not (own and others):
            return words.put("Size, with 90 % interval: {}.", own or others)
        return words.put("Size, with 90 % interval: {}; of the others that do as well: {}.", own, others)

    @staticmethod
    def _by_cause(words: Words, values: list[tuple[str, ParameterResult]]) -> str:
        found: dict[str, list[str]] = {}
        for name, p in values:
            ends = None if p.lower is None or p.upper is None else (p.lower, p.upper)
            found.setdefault(owner(name) or "", []).append(words.size(name, p.unit, p.median, ends))
        each = (words.put("{} {}", words.cause(id), words.listed(texts)) for id, texts in found.items())
        return words.joined("; ", each)


@dataclass(frozen=True)
class Implausible(Statement):
    """Values that whoever knows such rigs would not believe, by the set that has them; what is named first."""

    topic = "wrong"
    values: list[tuple[list[str], list[str]]]

    def say(self, words: Words) -> str:
        """Return the sentence."""
        each = (
            words.put("{} of {}", words.listed(map(words.parameter, names)), words.causes(terms))
            for terms, names in self.values
        )
        return words.put("Values that would surprise whoever knows such rigs: {}.", words.joined("; ", each))


@dataclass(frozen=True)
class BreaksLaw(Statement):
    """A law that holds whatever the causes are, and that a model breaks."""

    topic = "wrong"
    broken: Broken

    def say(self, words: Words) -> str:
        """Return the sentence."""
        laws = {
            "carried": "A ball cannot move less than the tip carries it.",
            "energy": "A ball cannot gain more than the drive gives.",
        }
        b = self.broken
        return words.put(
            "{} {} breaks that law at {} reading{}, most at {}.", laws[b.law], words.causes(b.terms), b.readings,
            "" if b.readings == 1 else "s", words.number(b.text),
        )  # fmt: skip


@dataclass(frozen=True)
class Furthest(Statement):
    """The readings furthest from a model, how many are beyond four standard deviations, and the scatter's tails.

    `tails` is the 90 % interval of Student's nu, where the readings ask for heavier tails than is usual.
    """

    topic = "wrong"
    causes: list[str]
    readings: list[Reading]
    odd: int
    tails: tuple[float, float] | None

    def say(self, words: Words) -> str:
        """Return the sentence."""
        far = (
            words.put(
                "{}, {} (reads {} for {})", words.groups([r.group]),
                words.number(f"{r.frequency_hz:.6g} Hz, {r.amplitude_v:.4g} V"),
                words.number(f"{significant(r.reading_um)} {r.unit}"),
                words.number(f"{significant(r.predicted_um)} {r.unit}"),
            )
            for r in self.readings
        )  # fmt: skip
        text = words.put("Furthest from {}: {}.", words.causes(self.causes), words.joined("; ", far))
        beyond = f" {self.odd} reading{' is' if self.odd == 1 else 's are'} off by more than four standard deviations."
        text = words.put("{}{}", text, beyond if self.odd else "")
        if self.tails is None:
            return text
        return words.put(
            "{} The scatter has heavy tails (nu {} to {}, 90 %): such readings count little.",
            text, *(f"{x:.2g}" for x in self.tails),
        )  # fmt: skip


@dataclass(frozen=True)
class Unseen(Statement):
    """Causes of which even a plausible strength would not show."""

    topic = "wrong"
    causes: list[str]
    of: int

    def say(self, words: Words) -> str:
        """Return the sentence."""
        return words.put(
            "Of {} candidate causes, {} could not have been seen in these readings: {}.",
            self.of, len(self.causes), words.joined(", ", map(words.cause, self.causes)),
        )  # fmt: skip


@dataclass(frozen=True)
class Room(Statement):
    """The largest change of a range that the readings leave a cause which is not named (95 %)."""

    topic = "wrong"
    cause: str
    share: float

    def say(self, words: Words) -> str:
        """Return the sentence."""
        return words.put(
            "What is not named may change a launch range by {} at most and stay unseen ({}; 95 %).",
            words.fraction(self.share), words.cause(self.cause),
        )  # fmt: skip


@dataclass(frozen=True)
class OneGroup(Statement):
    """The gain of what is named rests on one group; nats."""

    topic = "detail"
    group: GroupId
    gain: float
    most: float
    without: float | None

    def say(self, words: Words) -> str:
        """Return the sentence."""
        return words.put(
            "Of their gain of {} {} gives {}{}.", words.nats(self.gain), words.groups([self.group]),
            words.nats(self.most),
            "" if self.without is None else words.put("; without it they gain {}", words.nats(self.without)),
        )  # fmt: skip


@dataclass(frozen=True)
class LivesOn(Statement):
    """On how many readings half of what speaks for each cause rests, and the group that gives most."""

    topic = "detail"
    causes: list[Carried]
    readings: int

    def say(self, words: Words) -> str:
        """Return the sentence."""
        each = (
            words.put(
                "{} on {} of {} readings, most in {}", words.cause(c.cause), c.half, self.readings,
                words.groups([c.groups[0][0]]),
            )
            for c in self.causes
        )  # fmt: skip
        return words.put("Half of what speaks for a cause rests: {}.", words.joined("; ", each))


@dataclass(frozen=True)
class SmoothIsBetter(Statement):
    """A smooth discrepancy has so many nats more evidence than the named causes."""

    topic = "detail"
    nats: float

    def say(self, words: Words) -> str:
        """Return the sentence."""
        how = "A smooth discrepancy without a name, in the place of these causes, has {} more evidence than they."
        return words.put(how, words.nats(self.nats))


@dataclass(frozen=True)
class ByChance(Statement):
    """How often a search finds as much where nothing is hidden."""

    topic = "detail"
    found: Significance

    def say(self, words: Words) -> str:
        """Return the sentence."""
        s = self.found
        if s.p_value is None:
            missing = OTHERWISE[s.missing] if s.missing else "nothing"
            return words.put(
                "How often a search finds as much where nothing is hidden is not known: the stored table is of {}"
                " (--searches 19 repeats the search on simulated baselines).",
                missing,
            )
        n, most = len(s.null), max(s.null)
        none = (
            f"none led by more than {fixed(math.ceil(10 * most) / 10, 1)} nats"
            if most > 0
            else "none put a model with causes first"
        )
        where = "simulated baselines"
        if s.stored:
            sizes = " to ".join(map(str, s.readings))
            where = f"designs of {sizes} readings with nothing hidden (stored table, this catalogue)"
        p = f"p {'<=' if s.p_value <= 1 / (n + 1) else '='} {significant(s.p_value, 2)}"
        return words.put("Of {} searches on {} {}; this one leads by {} ({}).", n, where, none, fixed(s.lead), p)


@dataclass(frozen=True)
class Calibrated(Statement):
    """How often diagnoses of data sets that are drawn from this answer are right."""

    topic = "trust"
    found: Calibration

    def say(self, words: Words) -> str:
        """Return the sentence."""
        c = self.found
        ends = words.put("{} to {}, 90 %", words.per_cent(c.exact.lower), words.per_cent(c.exact.upper))
        text = words.put(
            "Of {} data set{} drawn from this answer and diagnosed again, the set that made it was named in {}"
            " ({}) and reported in {}.",
            c.exact.of, "" if c.exact.of == 1 else "s", c.exact.n, ends, c.reported.n,
        )  # fmt: skip
        if c.printed is not None:
            how = "{} What was named had a probability of {} on average, and was right in {} of {}."
            text = words.put(how, text, words.per_cent(c.printed), c.right.n, c.right.of)
        if not c.intervals:
            return text
        how = "{} 90 % intervals held {} of the {} true values ({})."
        return words.put(how, text, c.held, c.intervals, words.per_cent(c.held / c.intervals))


@dataclass(frozen=True)
class NoGain(Statement):
    """Why no gain on unseen data was measured."""

    topic = "gained"
    quick: bool

    def say(self, words: Words) -> str:
        """Return the sentence."""
        why = "a quick diagnosis gives the verdict alone" if self.quick else "there is no group that could be held out"
        return words.put("No gain on data unseen was measured: {}.", why)


@dataclass(frozen=True)
class Gained(Statement):
    """What naming the causes is worth on readings that no choice has seen."""

    topic = "gained"
    gain: Gain
    training: list[GroupId]

    def say(self, words: Words) -> str:
        """Return the sentence."""
        g = self.gain
        seen = words.groups(self.training) if g.protocol == "strict" else "all other groups"
        if g.names_nothing:
            how = "Gain on data unseen ({}): none; no cause is named by {} alone."
            return words.put(how, g.protocol, seen)
        text = words.put(
            "Gain on data unseen ({}; causes and parameters chosen on {}): the typical error goes from a factor of {}"
            " to {} (mean log_rmse {} before, {} after; change {} to {}, 90 %).",
            g.protocol, seen, *(f"{math.exp(min(x, 99.0)):.3g}" for x in (g.log_rmse_before, g.log_rmse_after)),
            f"{g.log_rmse_before:.3f}", f"{g.log_rmse_after:.3f}",
            *(words.number(fixed(x, 3, sign=True)) for x in g.log_rmse_interval),
        )  # fmt: skip
        if not g.worse:
            return text
        worse = (
            words.put("{} ({} to {})", words.groups([w.group]), f"{w.log_rmse_before:.3f}", f"{w.log_rmse_after:.3f}")
            for w in g.worse
        )
        return words.put("{} Predicted worse than by the baseline: {}.", text, words.joined(", ", worse))


@dataclass(frozen=True)
class Drafted(Statement):
    """What no cause explains, described as a cause of one's own."""

    topic = "next"
    found: Draft

    def say(self, words: Words) -> str:
        """Return the sentence."""
        d = self.found
        unit = {"frequency": "Hz", "amplitude": "V", "range": "um"}[d.axis]
        return words.put(
            "A factor of {} at a {} of {} describes {} of what is left. {} has it as a cause: a description and no"
            " mechanism, to be scored with --plugin.",
            f"{d.factor:.2f}", "predicted range" if d.axis == "range" else d.axis,
            words.number(f"{float(f'{d.place:.3g}'):g} {unit}"), words.per_cent(d.share), d.file,
        )  # fmt: skip


@dataclass(frozen=True)
class Next(Statement):
    """What to measure next; `more` where a quick diagnosis has not looked at all sets that are tied."""

    topic = "next"
    found: NextExperiment
    more: bool

    def say(self, words: Words) -> str:
        """Return the sentence."""
        first, purpose = self.found.proposals[0], self.found.purpose
        about, text = purpose_text(purpose, words), words.number(first.text)
        if self.found.separates:
            lead = f"over {0.9 * CLEAR:.0f} nats"
            if first.separation <= 0.9 * CLEAR:
                lead = f"{fixed(first.separation, 1)} +- {fixed(first.error, 1)} nats"
            by = words.number(lead)
        else:
            by = words.put("narrower by {}", words.per_cent(-math.expm1(-first.separation)))
        if self.found.recommended:
            does = "{}: it best {}, with an expected lead of {}." if self.found.separates else "{}: it best {}, {}."
            rest = " The other sets are not looked at: without --quick the four likeliest are."
            return words.put("Next, measure " + does + "{}", text, about, by, rest if self.more else "")
        if self.found.separates:
            return words.put("No sweep that the rig allows {}: the best, {}, by {}.", about, text, by)
        return words.put("No sweep that the rig allows would tell much more: the best, {}, {}, {}.", text, about, by)


@dataclass(frozen=True)
class Searched(Statement):
    """How many sets of causes were looked at, and what the others may hold."""

    topic = "searched"
    looked_at: LookedAt
    missed: float

    def say(self, words: Words) -> str:
        """Return the sentence."""
        how = "{} The chance that a better set was missed is {}, a part of every probability."
        return words.put(how, self._counted, words.per_cent(self.missed))

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


def purpose_text(purpose: Purpose | None, words: Words) -> str:
    """Return what proposals are for, without what the sets to be told apart share."""
    if purpose is None:
        return ""
    if purpose.kind == "narrow":
        return words.put("determines {}", words.parameter(purpose.parameter))
    shared = set.intersection(*map(set, purpose.sets))
    if any(shared.issuperset(ids) for ids in purpose.sets):  # one holds nothing else
        shared = set()
    one, *rest = (words.causes([id for id in ids if id not in shared]) for ids in purpose.sets)
    beside = " (beside what they share)" if shared else ""
    return words.put("tells {} from {}{}", one, words.listed(rest), beside)


def answer(d: Diagnosis) -> tuple[Statement, ...]:
    """Return what a diagnosis says, in the order in which it is told.

    Parameters
    ----------
    d : Diagnosis

    Returns
    -------
    tuple of Statement
        Chosen from the record's numbers alone.
    """
    found: list[Statement] = []
    if d.left_out:
        found.append(Restricted([s.id for s in d.screening], len(d.left_out)))
    found += [_judged(d), _named(d)]
    tests = d.misfit.baseline
    if d.misfit.p_value < ALPHA and tests.character != "none":
        found.append(Kind(tests.character, tests.odd_groups, len(tests.odd_points)))
    found += [*_values(d), *map(BreaksLaw, d.laws), *_unseen(d), *_robust(d)]
    if d.influence and (carried := [c for c in d.influence.causes if c.half]):
        found.append(LivesOn(carried, len(d.influence.tail)))
    if d.misfit.search:
        found.append(ByChance(d.misfit.search))
    if d.calibration:
        found.append(Calibrated(d.calibration))
    found += [Gained(gain, d.training) for gain in d.gain.values()] or [NoGain(d.quick)]
    if d.draft:
        found.append(Drafted(d.draft))
    if d.next_experiment.proposals:
        found.append(Next(d.next_experiment, d.quick and len(d.alternatives) > 1))
    return (*found, Searched(d.looked_at, d.settings.search.missed))


def sentences(d: Diagnosis) -> list[str]:
    """Return the answer in plain words, as the record and the terminal tell it."""
    return [statement.say(PLAIN) for statement in answer(d)]


def kept(d: Diagnosis) -> float:
    """Return the probability of the baseline alone."""
    return next((c.probability for c in d.causes if not c.terms), 1.0)


def _judged(d: Diagnosis) -> Judged:
    verdict: Literal["yes", "so far", "no", "together", "tails", "improbable"] = "improbable"
    tests, p_value = d.misfit.baseline, d.misfit.p_value
    if p_value < ALPHA:
        verdict = "no"
    elif d.verdict == "adequate":
        verdict = "so far" if kept(d) < 0.5 else "yes"
    elif tests.coincidences:
        verdict = "together"
    elif tests.usual_tails is not None and tests.usual_tails < ALPHA:
        verdict, p_value = "tails", tests.usual_tails
    return Judged(verdict, p_value, tests.n_simulated, kept(d), d.mostly_unnamed)


def _named(d: Diagnosis) -> Statement:
    if d.verdict == "adequate":
        return NothingShows([(c.terms, c.probability) for c in d.causes if c.terms and c.probability >= _WORTH_SAYING])
    best_model, after = d.best_model, d.misfit.extended
    left: Literal["", "structure", "smooth", "law"] = ""
    if d.verdict == "unexplained" and d.named:
        breaks = any(set(b.terms) == set(d.named) for b in d.laws)
        left = "structure" if d.misfit.remains else "law" if breaks and not d.mostly_unnamed else "smooth"
    return Named(
        verdict=d.verdict,
        causes=d.named,
        # Where an unnamed discrepancy takes it all, a share of what is left says nothing.
        probability=None if best_model is None or d.mostly_unnamed or not d.named else best_model.probability,
        alternatives=d.alternatives,
        fits_alike=best_model is not None and best_model.evidence.share >= CREDIBLE,
        rejected=d.misfit.p_value < ALPHA,
        left=left,
        p_after=after.p_value if after and left and after.p_value < ALPHA else None,
        unnamed=d.unnamed,
        looked_at=d.looked_at,
        restricted=bool(d.left_out),
        strange=bool(d.strange),
    )


def _values(d: Diagnosis) -> Iterator[Statement]:
    """How large the causes are, and what of that is implausible."""
    tied = [c for ids in d.alternatives[:2] for c in d.causes if c.terms == ids]
    own = _sized([d.best_model] if d.best_model else [])
    others = {name: p for name, p in _sized(tied).items() if name not in own}
    if own or others:
        yield Sizes(list(own.items()), list(others.items()))
    named = [d.best_model] if d.best_model and d.named else []
    if odd := [(c.terms, c.strange) for c in [*named, *tied] if c.strange]:
        yield Implausible(odd)


def _sized(causes: list[CauseResult]) -> dict[str, ParameterResult]:
    """The values of models' own causes; where several have one, the first's."""
    found: dict[str, ParameterResult] = {}
    for c in causes:
        for name, p in c.parameters.items():
            if owner(name) in c.terms:
                found.setdefault(name, p)
    return found


def _unseen(d: Diagnosis) -> Iterator[Statement]:
    """The readings that the model misses most, and the causes that could hide."""
    adopted = d.misfit.extended if d.verdict != "adequate" and d.misfit.extended else d.misfit.baseline
    terms = d.named if adopted is d.misfit.extended else []
    if adopted.furthest:
        yield Furthest(terms, adopted.furthest, len(adopted.odd_points), _tails(d, terms))
    if unseen := [s.id for s in d.screening if s.verdict == UNSEEN]:
        yield Unseen(unseen, len(d.screening))
    if left := {s.id: s.room for s in d.screening if s.room is not None}:
        widest = max(left, key=lambda id: left[id])
        yield Room(widest, left[widest])


def _tails(d: Diagnosis, terms: list[str]) -> tuple[float, float] | None:
    """The interval of Student's nu, where all of it lies below the median of its prior."""
    model = next((c for c in d.causes if set(c.terms) == set(terms)), None)
    nu = model.parameters.get(_TAILS.name) if model else None
    if nu is None or nu.lower is None or nu.upper is None:
        return None
    return (nu.lower, nu.upper) if nu.upper < float(_TAILS.to_physical(_TAILS.prior_quantile(0.5))) else None


def _robust(d: Diagnosis) -> Iterator[Statement]:
    """What the gain of the named causes rests on."""
    firm = d.misfit.robustness
    if not (firm and d.named):
        return
    if firm.of_one_group and firm.strongest is not None:
        each = dict(firm.groups)
        yield OneGroup(firm.strongest, sum(each.values()), max(each.values()), firm.without)
    if firm.over_smooth < 0:
        yield SmoothIsBetter(-firm.over_smooth)

"""What was found: whether the baseline will do, what is wrong, and which causes are named, with their sizes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from psafit.diagnose.answer.statement import Statement
from psafit.diagnose.misfit import ALPHA, Character, Statistic, described
from psafit.diagnose.record.models import ParameterResult, Without
from psafit.diagnose.show import Unlike
from psafit.diagnose.trials import VerdictWord, Why
from psafit.diagnose.words import Words
from psafit.experiment import GroupId
from psafit.model_search.model_set import CREDIBLE, LookedAt
from psafit.observables import named
from psafit.physics import owner
from psafit.records import Broken, Objection
from psafit.text import count, p_text, significant

WORTH_SAYING = 0.05
"""Probability of a discrepancy without a name, or of another set, from which on it is worth a sentence."""

# What remains of the readings given the best extension, by what speaks against it.
_REMAINS: dict[Objection, str] = {
    "": "structure remains that no cause describes",
    "tests": "structure remains that no cause describes",
    "together": "readings of several groups still stand out together",
    "tails": "it passes the tests only because heavy tails take up what stands out",
}
# Why a set is no explanation though nothing remains of the readings.
_NONE: dict[Why, str] = {
    "smooth": "a smooth curve in its place is more probable",
    "law": "it breaks a law that holds whatever the causes are",
    "values": "it fits only at values that are implausible",
}
_P_VALUE: dict[Objection, str] = {"tests": "family-wise p", "together": "p", "tails": "p without them"}
# Sets that do as well as what is named, and are named one by one.
_TIED = 6
# Nats from which an estimate is given without a digit behind the point.
_ROUNDED = 3.0


@dataclass(frozen=True)
class Restricted(Statement):
    """The causes that were looked at, where the catalogue has others."""

    topic = "scope"
    looked_at: list[str]
    left_out: int

    def say(self, words: Words) -> str:
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
        Whether it is; only as far as the readings show, where something else is more probable; not rejected by the
        tests, but by readings that stand out together, or only for the heavy tails of its scatter; not rejected, but
        improbable.
    p_value : float
        Family-wise; with no heavier tails than usual where these were needed.
    simulated : int
        Data sets that gave it.
    share : float
        Probability that no cause shows: of the baseline, with all sets that these readings cannot see.
    unnamed : bool
        Whether what is more probable has no name.
    """

    topic = "adequate"
    adequate: Literal["yes", "so far", "no", "together", "tails", "improbable"]
    p_value: float
    simulated: int
    share: float
    unnamed: bool

    @property
    def narrow(self) -> bool:
        """Whether it is not rejected, and two standard errors of a share at the level might have changed that."""
        return 0 <= self.p_value - ALPHA < 2.0 * math.sqrt(ALPHA * (1.0 - ALPHA) / self.simulated)

    def say(self, words: Words) -> str:
        rest = words.per_cent(self.share)
        if self.adequate == "together":
            rest = "several groups"
        elif self.adequate == "improbable":
            rest = "a discrepancy without a name" if self.unnamed else "an extended model"
        if not self.simulated:
            how = "The baseline cannot be tested: there are too few readings, or they scatter less than any rig's do. "
            improbable = self.adequate == "improbable"
            rest_of = "It is improbable compared with {}." if improbable else "The chance that no cause shows is {}."
            return words.put(how + rest_of, rest)
        heads = {
            "no": "The tests find the baseline wrong: {}.",
            "together": "The tests do not reject the baseline ({}), but readings of {} stand out together.",
            "tails": "The tests pass the baseline only because heavy tails take up what stands out; without: {}.",
            "improbable": "The tests do not reject the baseline ({}), but it is improbable compared with {}.",
            "yes": "The tests find nothing wrong with the baseline: {}. The chance that no cause shows is {}.",
            "so far": "The tests find nothing wrong with the baseline: {}. The chance that no cause shows is only {}.",
        }
        least = self.p_value <= 1 / (self.simulated + 1)
        few = "none" if least else words.fraction(self.p_value) if self.p_value < 0.1 else words.per_cent(self.p_value)
        how = words.put(
            "of {} data sets simulated from the fitted baseline, {} look as odd; below {} it is rejected{}",
            self.simulated, few, words.per_cent(ALPHA), ", so it passes narrowly" if self.narrow else "",
        )  # fmt: skip
        return words.put(heads[self.adequate], how, rest)


@dataclass(frozen=True)
class NothingShows(Statement):
    """No cause is needed; which sets are not excluded, with their probabilities and what no cause `keeps`."""

    topic = "wrong"
    not_excluded: list[tuple[list[str], float]]
    keeps: float

    def say(self, words: Words) -> str:
        others = [words.put("{} ({})", words.causes(ids), words.per_cent(p)) for ids, p in self.not_excluded]
        if likelier := [text for text, (_, p) in zip(others, self.not_excluded, strict=True) if p > self.keeps]:
            return words.put(
                "Whether a cause is needed stays open: more probable than none ({}) {} {}. A set is named that has {}"
                " of what the catalogue's sets have together.",
                words.per_cent(self.keeps), "is" if len(likelier) == 1 else "are", words.listed(likelier),
                words.per_cent(CREDIBLE),
            )  # fmt: skip
        text = "No cause is needed to explain these readings."
        return words.put(text + " Nor can they exclude {}.", words.listed(others)) if others else text


@dataclass(frozen=True)
class Rival:
    """A set that is reported with what is named.

    Parameters
    ----------
    causes : list of str
    probability : float, optional
        None where it says nothing, or is not on record.
    times : float, optional
        By how much it is less probable than what is named.
    by_likelihood : bool
        Whether it is reported only because it fits as well.
    implausible : bool
        Whether its values are.
    better : float, optional, nats
        Log likelihood that it has more than what is named, where parameters that it has more do not account for that.
    """

    causes: list[str]
    probability: float | None
    times: float | None
    by_likelihood: bool
    implausible: bool = False
    better: float | None = None


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
    alternatives : list of Rival
    rejected : bool
        Whether the tests reject the baseline, or readings that stand out together, or its need of heavy tails, do.
    left : {"", "structure", "smooth", "law", "values"}
        Why the best extension does not explain the readings: structure remains, a smooth curve in its place is more
        probable, it breaks a law that holds whatever the causes are, or its values are implausible.
    objection : {"", "tests", "together", "tails"}
        What speaks against the best extension: the tests, readings that stand out together, or that it needs heavy
        tails.
    p_after : float
        Its p value.
    floor : float
        The least that the simulated data sets can give.
    unnamed : float
        Probability of a discrepancy without a name.
    looked_at : LookedAt
    restricted : bool
    """

    topic = "wrong"
    verdict: VerdictWord
    causes: list[str]
    probability: float | None
    alternatives: list[Rival]
    rejected: bool
    left: Why
    objection: Objection
    p_after: float
    floor: float
    unnamed: float
    looked_at: LookedAt
    restricted: bool

    def say(self, words: Words) -> str:
        what = words.causes(self.causes)
        if self.probability is not None:
            what = words.put("{} (probability {})", what, words.per_cent(self.probability))
        unnamed = words.put(" A discrepancy without a name keeps {} of the probability.", words.per_cent(self.unnamed))
        rest = unnamed if self.unnamed >= WORTH_SAYING else ""
        other = self.looked_at.no_other("set of these causes" if self.restricted else "set")
        if self.verdict == "explained":
            how = "{} explains the misfit; the tests find nothing left of it, and {} does as well.{}"
            if not self.rejected:
                how = "{} is far more probable than no cause, and {} does as well.{} The tests alone would not have"
                how += " objected to the baseline: this name rests on odds and priors."
            return words.put(how, what, other, rest)
        if self.verdict == "unexplained" and self.left == "values":
            how = "{} takes up what is wrong, and {} does as well, but at values that are implausible: that is the"
            return words.put(how + " shape of what is missing, and perhaps not the mechanism.{}", what, other, rest)
        if self.verdict == "ambiguous":
            likely, no = self._by_likelihood(words), ""
            tied = [r for r in self.alternatives if not r.by_likelihood]
            if self.left:
                no = words.put(f" {{}} is no explanation: {_NONE[self.left]}.", words.causes(self.causes))
            if not tied:
                return words.put("{} is most probable, but only by its priors.{}{}{}", what, likely, no, rest)
            held = [id for id in self.causes if all(id in r.causes for r in tied)]
            sure = words.put(", all with {}", words.causes(held)) if held else ""
            rivals = _first(self._in_words(tied, words))
            if all(r.times is not None and r.times / (1 + r.times) >= CREDIBLE for r in tied):
                how = "{} is far more probable than any other set, but is named alone only from {} on. The next{}: {}"
                sure, next_ones = sure if len(tied) > 1 else "", words.choices(rivals)
                return words.put(how + "{}{}{}", what, words.per_cent(CREDIBLE), sure, next_ones, likely, no, rest)
            how = "These readings cannot decide between {} sets of causes{}: {}{}{}{}"
            return words.put(how, len(tied) + 1, sure, words.choices([what, *rivals]), likely, no, rest)
        if not self.causes:
            looked = "that was looked at" if self.restricted else "of the catalogue"
            how = "No cause {} stands out that would explain what these readings show.{}"
            return words.put(how, looked, rest)
        why = _NONE[self.left] if self.left in ("law", "smooth") else _REMAINS[self.objection]
        odd = ""
        if self.objection:
            odd = f"{_P_VALUE[self.objection]} {words.number(p_text(self.p_after, self.floor))}; "
        others = self._in_words(self.alternatives, words)
        also = words.put(" Next best: {}.", words.joined("; ", _first(others))) if others else ""
        sharper = ""
        if self.objection == "tests" and not self.rejected:
            sharper = " (The tests pass the baseline: what has more scatter passes more easily.)"
        return words.put(
            "The best extension is {}, but {} ({}probability of a discrepancy {}).{}{}",
            what, why, odd, words.per_cent(self.unnamed), sharper, also,
        )  # fmt: skip

    def _in_words(self, rivals: Sequence[Rival], words: Words) -> list[str]:
        """Other sets, each by its difference from what is named, with its probability."""
        return [
            words.instead(self.causes, r.causes)
            if r.probability is None
            else words.put(
                "{} ({}{}{})",
                words.instead(self.causes, r.causes),
                words.share(r.probability),
                ", at implausible values" if r.implausible else "",
                ""
                if r.better is None
                else words.put("; it fits better by {}, and its priors hold it back", words.nats(r.better)),
            )
            for r in rivals
        ]

    def _by_likelihood(self, words: Words) -> str:
        """What fits as well, and by how much it is less probable."""
        found = []
        for r in (r for r in self.alternatives if r.by_likelihood):
            why = ""
            if r.probability is not None and r.times is not None:
                how = " (its priors make it {} times less probable: {})"
                why = words.put(how, words.number(significant(r.times, 2)), words.share(r.probability))
            found.append(words.put("{}{}", words.instead(self.causes, r.causes), why))
        if not found:
            return ""
        how = " By likelihood alone, {} {} as well or better: {}."
        fit = "fits" if len(found) == 1 else "fit"
        return words.put(how, count(len(found), "more set"), fit, words.joined("; ", _first(found)))


@dataclass(frozen=True)
class Replaced(Statement):
    """What would be named without each of the named causes, and how far behind that is."""

    topic = "wrong"
    without: list[Without]
    named: list[str]

    def say(self, words: Words) -> str:
        each = (
            words.put("without {}, {} ({})", words.cause(w.cause), self._other(w, words), self._behind(w, words))
            for w in self.without[:_TIED]
        )
        return words.put("The next best by log posterior: {}.", words.joined("; ", each))

    def _other(self, w: Without, words: Words) -> str:
        """The set, by what it has in the place of the cause, if that is all in which it differs."""
        new = [id for id in w.terms if id not in self.named]
        if {*w.terms} - {*new} != {*self.named} - {w.cause}:
            return words.causes(w.terms)
        return words.put("{} in its place", words.causes(new) if new else "nothing")

    def _behind(self, w: Without, words: Words) -> str:
        """How far behind it is; by a short fit that is an estimate."""
        if w.sampled:
            return words.put("{} behind", words.nats(w.nats))
        about = words.number(f"{w.nats:.0f} nats") if w.nats >= _ROUNDED else words.nats(w.nats)
        return words.put("about {} behind", about)


def _first(texts: list[str]) -> list[str]:
    """The first of some sets in words, and how many more there are."""
    more = len(texts) - _TIED
    return texts if more <= 0 else [*texts[:_TIED], f"{more} more set{'' if more == 1 else 's'}"]


@dataclass(frozen=True)
class Kind(Statement):
    """What kind of thing is wrong with the baseline, or with its best extension."""

    topic = "wrong"
    model: Literal["baseline", "best extension"]
    character: Character
    groups: list[GroupId]
    points: int
    statistics: list[Statistic]

    def say(self, words: Words) -> str:
        which: dict[str, str] = {
            "group": words.put(" ({})", words.groups(self.groups)),
            "points": f": {self.points} of them",
        }
        return words.put(
            "What the {} misses: {}{}.",
            self.model,
            described(self.character, self.statistics),
            which.get(self.character, ""),
        )


@dataclass(frozen=True)
class Sizes(Statement):
    """How large the causes are: each parameter with its value, of what is named and of the sets reported with it."""

    topic = "wrong"
    named: list[tuple[str, ParameterResult]]
    others: list[tuple[str, ParameterResult]]
    verdict: VerdictWord

    def say(self, words: Words) -> str:
        own, others = (
            by_cause(words, [(owner(name) or "", sized(words, name, p)) for name, p in values])
            for values in (self.named, self.others)
        )
        if not (own and others):
            return words.put("Size, with 90 % interval: {}.", own or others)
        whose = "the next best" if self.verdict == "unexplained" else "the others"
        return words.put("Size, with 90 % interval: {}; of {}: {}.", own, whose, others)


@dataclass(frozen=True)
class Implausible(Statement):
    """Values that whoever knows such rigs would not believe, by the set that has them; what is named first.

    A scatter that is too wide is among them: it does not change the verdict, but may hide a misfit.
    """

    topic = "wrong"
    values: list[tuple[list[str], list[tuple[str, ParameterResult]]]]

    def say(self, words: Words) -> str:
        each = (
            words.put("{} of {}", words.listed(_against_prior(words, *value) for value in values), words.causes(terms))
            for terms, values in self.values
        )
        return words.put("Implausible values: {}.", words.joined("; ", each))


def _against_prior(words: Words, name: str, p: ParameterResult) -> str:
    """A value, and where its prior expects it."""
    value = words.size(name, p.unit, p.median, p.interval)
    if p.prior_interval is None:
        return value
    return words.put("{} (its prior expects {})", value, words.span(p.unit, p.prior_interval))


@dataclass(frozen=True)
class GainsDiffer(Statement):
    """Two sessions that differ by one factor in what is read, and by another in something else that is read."""

    topic = "wrong"
    found: Unlike

    def say(self, words: Words) -> str:
        f, pair = self.found, (self.found.first, self.found.second)
        each = (
            words.put("{} by {}", named(o.observable).titles, words.value("1", o.factor, (o.lower, o.upper)))
            for o in pair
        )
        how = " Two instruments do, each with a factor of its own: then name them in experiment.toml, under"
        how += " [instruments]. So does a lean or a drive that differs."
        return words.put(
            "From session {} to session {} the readings change by two factors, {}. One {} for both does not do that."
            + (how if f.first.instrument is None else " A lean or a drive that differs does."),
            f.first.first, f.first.second, words.listed(each), words.cause(f.cause),
        )  # fmt: skip


@dataclass(frozen=True)
class BreaksLaw(Statement):
    """A law that holds whatever the causes are, and that a model breaks."""

    topic = "wrong"
    broken: Broken

    def say(self, words: Words) -> str:
        laws = {
            "carried": "A ball cannot move less than the tip carries it.",
            "energy": "A ball cannot gain more than the drive gives.",
        }
        b, many = self.broken, "" if self.broken.readings == 1 else "s"
        asked = {
            "carried": f"at {b.readings} reading{many}",
            "energy": f"at the farthest launch of {b.readings} group{many}",
        }
        return words.put(
            "{} {} breaks that law {}, most at {}.", laws[b.law], words.causes(b.terms), asked[b.law],
            words.number(b.text),
        )  # fmt: skip


def by_cause(words: Words, texts: Iterable[tuple[str, str]]) -> str:
    """What is said of each cause, in the order of the first of it."""
    found: dict[str, list[str]] = {}
    for id, text in texts:
        found.setdefault(id, []).append(text)
    each = (words.put("{} {}", words.cause(id), words.listed(own)) for id, own in found.items())
    return words.joined("; ", each)


def sized(words: Words, name: str, p: ParameterResult) -> str:
    """A parameter with its value, and with its reciprocal where people know that."""
    text = words.size(name, p.unit, p.median, p.interval)
    if not (p.reciprocal and p.median):
        return text
    low, high = ("" if not x else f"{significant(1 / x)}" for x in (p.upper, p.lower))
    ends = f" ({low} to {high})" if low and high else f" (at least {low})" if low else ""
    return words.put("{}, that is {}", text, words.number(f"{significant(1 / p.median)} {p.reciprocal}{ends}"))

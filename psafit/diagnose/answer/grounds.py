"""What the findings rest on: readings, chance, how often such answers are right, and how far was looked."""

from __future__ import annotations

import math
from dataclasses import dataclass

from psafit.diagnose.answer.statement import Statement
from psafit.diagnose.influence import Carried
from psafit.diagnose.significance import OTHERWISE, Significance
from psafit.diagnose.trials import Calibration, VerdictWord
from psafit.diagnose.words import Words
from psafit.experiment import GroupId
from psafit.model_search.model_set import LookedAt
from psafit.text import fixed, significant

_TRUTHS = 4
"""Sets that are listed of those that have made such answers."""


@dataclass(frozen=True)
class OneGroup(Statement):
    """The gain of what is named rests on one group; nats."""

    topic = "detail"
    group: GroupId
    gain: float
    most: float
    without: float | None

    def say(self, words: Words) -> str:
        where, most = words.groups([self.group]), words.nats(self.most)
        alone = "" if self.without is None else words.nats(self.without)
        alone = alone and words.put("; fitted to the other groups alone, they gain {}", alone)
        if self.most > self.gain:
            lost = words.nats(self.most - self.gain)
            return words.put("The named causes gain {} in {} and lose {} in the others{}.", most, where, lost, alone)
        how = "Of the {} that the named causes gain, {} contributes {}{}."
        return words.put(how, words.nats(self.gain), where, most, alone)


@dataclass(frozen=True)
class LivesOn(Statement):
    """On how many readings half of what speaks for each cause rests, and the group that gives more than half."""

    topic = "detail"
    causes: list[Carried]
    readings: int

    def say(self, words: Words) -> str:
        def most(cause: Carried) -> str:
            group, nats = cause.groups[0]
            alone = len(cause.groups) == 1 or nats <= 0.5 * cause.total
            return "" if alone else words.put(", most in {}", words.groups([group]))

        first, *others = self.causes
        how = "Half of what speaks for {} comes from {} of the {} readings{}"
        text = words.put(how, words.cause(first.cause), first.half, self.readings, most(first))
        more = (words.put("for {} from {}{}", words.cause(c.cause), c.half, most(c)) for c in others)
        return words.put("{}.", words.joined("; ", [text, *more]))


@dataclass(frozen=True)
class SmoothIsBetter(Statement):
    """A smooth discrepancy has so many nats more evidence than the named causes."""

    topic = "detail"
    nats: float

    def say(self, words: Words) -> str:
        how = "A smooth discrepancy without a name, in the place of these causes, has {} more evidence than they."
        return words.put(how, words.nats(self.nats))


@dataclass(frozen=True)
class ByChance(Statement):
    """How often a search finds as much where nothing is hidden."""

    topic = "detail"
    found: Significance

    def say(self, words: Words) -> str:
        s = self.found
        if s.p_value is None:
            return words.put(
                "How often a search finds as much where nothing is hidden is not known: {} (--searches 19 repeats the"
                " search on simulated baselines).",
                OTHERWISE[s.missing],
            )
        n, most = len(s.null), max(s.null)
        as_much = sum(lead >= s.lead for lead in s.null)
        highest = f"{fixed(math.ceil(10 * most) / 10, 1)} nats of log posterior odds at most"
        most_text = highest if most > 0 else "none put a cause first"
        where = "on simulated baselines"
        if s.stored:
            sizes = " to ".join(map(str, s.readings))
            where = (
                f"with nothing hidden (stored table, this catalogue, designs of {sizes} readings, no more than here:"
                " with more, chance leads less)"
            )
        p = f"p {'=' if as_much else '<='} {significant(s.p_value, 2)}"
        if not as_much:
            p += f", the least that {n} can show"
        return words.put(
            "{} of {} search{} {} found causes that lead the baseline by as much: {}, against {} here ({}).",
            as_much or "None", n, "" if n == 1 else "es", where, most_text, fixed(s.lead), words.number(p),
        )  # fmt: skip


@dataclass(frozen=True)
class Calibrated(Statement):
    """How often diagnoses of data sets that are drawn from this answer are right."""

    topic = "trust"
    found: Calibration
    explains: bool
    verdict: VerdictWord
    named: list[str]

    def say(self, words: Words) -> str:
        c = self.found
        drawn = "from this answer"
        if not self.explains:
            drawn = "from the best models of the catalogue, none of which explains these readings,"
        ends = words.put("{} to {}, 90 %", words.per_cent(c.exact.lower), words.per_cent(c.exact.upper))
        text = words.put(
            "Of {} data set{} drawn {} and diagnosed again, the set that made it was named in {}"
            " ({}) and reported in {}.",
            c.exact.of, "" if c.exact.of == 1 else "s", drawn, c.exact.n, ends, c.reported.n,
        )  # fmt: skip
        if not self.explains:
            text = words.put(
                "{} That is how well these conditions distinguish causes, not how often none is right.", text
            )
        if c.printed is not None:
            how = "{} What was named had a probability of {} on average, and was right in {} of {}."
            text = words.put(how, text, words.per_cent(c.printed), c.right.n, c.right.of)
            if c.overstated:
                text = words.put("{} Chance does not explain that: the probabilities here are too high.", text)
        made = c.behind(self.verdict, self.named) if self.explains else []
        if made:
            each = [words.put("{} ({})", words.causes(truth), n) for truth, n in made[:_TRUTHS]]
            rest = [f"others ({n})"] if (n := sum(n for _, n in made[_TRUTHS:])) else []
            how = "{} Those with the verdict{} given here ({}) were made by {}."
            name = " and the name" if self.named else ""
            text = words.put(how, text, name, sum(n for _, n in made), words.listed([*each, *rest]))
        if c.intervals:
            how = "{} 90 % intervals held {} of the {} true values ({}){}."
            narrow = ": they are too narrow here" if c.narrow else ""
            text = words.put(how, text, c.held, c.intervals, words.per_cent(c.held / c.intervals), narrow)
        return text


@dataclass(frozen=True)
class Searched(Statement):
    """How many sets of causes were looked at, and what the others may hold."""

    topic = "searched"
    looked_at: LookedAt
    missed: float

    def say(self, words: Words) -> str:
        return words.put(
            "{} The probabilities allow for a chance of {} that a better set was missed"
            " (measured for one or two causes).", self._counted, words.per_cent(self.missed),
        )  # fmt: skip

    @property
    def _counted(self) -> str:
        fitted, estimated = self.looked_at.fitted, self.looked_at.estimated
        head = f"{fitted:,} set{' of causes was' if fitted == 1 else 's of causes were'} fitted on all readings"
        if not estimated:
            return f"{head}{' and' if fitted == 1 else ', all of them'} sampled."
        mass = self.looked_at.mass_not_looked_at
        share = f"{fixed(mass, 1, per_cent=True)} %"
        share = {"0.0 %": "less than 0.1 %" if mass > 0 else "none"}.get(share, share)
        others = "the other has" if estimated == 1 else "the others have"
        together = "" if estimated == 1 else " together"
        return f"{head}, {fitted - estimated:,} of them sampled; {others} {share} of the probability{together}."

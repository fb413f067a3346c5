"""What naming causes is worth on unseen readings, and what to do next."""

from __future__ import annotations

import math
from dataclasses import dataclass

from psafit.diagnose.answer.findings import sized
from psafit.diagnose.answer.statement import Statement
from psafit.diagnose.gain import Gain
from psafit.diagnose.next_experiment import NextExperiment
from psafit.diagnose.record.misfit import Draft
from psafit.diagnose.record.models import Look
from psafit.diagnose.words import Words
from psafit.experiment import GroupId
from psafit.observables import named
from psafit.text import count, fixed


@dataclass(frozen=True)
class NoGain(Statement):
    """Why no gain on unseen data was measured."""

    topic = "gained"
    quick: bool

    def say(self, words: Words) -> str:
        why = "a quick diagnosis gives the verdict alone" if self.quick else "there is no group that could be held out"
        return words.put("No gain on unseen data was measured: {}.", why)


@dataclass(frozen=True)
class Gained(Statement):
    """What naming the causes is worth on readings that no choice has seen; those named that differ by session."""

    topic = "gained"
    gain: Gain
    training: list[GroupId]
    by_session: list[str]

    def say(self, words: Words) -> str:
        g = self.gain
        seen = words.groups(self.training) if g.protocol == "strict" else "all other groups"
        if g.names_nothing:
            how = "Gain on unseen data ({}): none; no cause is named by {} alone."
            return words.put(how, g.protocol, seen)
        text = words.put(
            "Gain on unseen data ({}; causes and parameters chosen on {}): the typical error goes from a factor of {}"
            " to {} (mean log_rmse {} before, {} after; change {} to {}, 90 %)."
            " The 90 % bands hold {} of these readings before, {} after.",
            g.protocol, seen, *(f"{math.exp(min(x, 99.0)):.3g}" for x in (g.log_rmse_before, g.log_rmse_after)),
            f"{g.log_rmse_before:.3f}", f"{g.log_rmse_after:.3f}",
            *(words.number(fixed(x, 3, sign=True)) for x in g.log_rmse_interval),
            *map(words.per_cent, (g.coverage_before, g.coverage_after)),
        )  # fmt: skip
        if self.by_session:
            own = "{} What {} does in a session that was not fitted is not known: the band of such a session is wider."
            text = words.put(own, text, words.listed(map(words.cause, self.by_session)))
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
        d, o = self.found, named(self.found.observable)
        places = {
            "frequency": ("Hz", "a frequency"),
            "amplitude": ("V", "an amplitude"),
            "range": (o.unit, f"a predicted {o.title}"),
        }
        unit, what = places[d.axis]
        return words.put(
            "A factor of {}{} at {} of {} describes {} of what {}. {} has it as a cause: a description and no"
            " mechanism, to be scored with --plugin.",
            f"{d.factor:.2f}", "" if d.observable is None else f" on {o.titles}", what,
            words.number(f"{float(f'{d.place:.3g}'):g} {unit}"), words.per_cent(d.share),
            "is left" if d.added else "the baseline leaves", d.file,
        )  # fmt: skip


@dataclass(frozen=True)
class CheckFirst(Statement):
    """What no search can find, to be looked at where nothing explains the readings."""

    topic = "next"

    def say(self, words: Words) -> str:
        return words.put(
            "Check first what psafit takes as given: the waveform, how volts are counted, bias and idle voltage, units,"
            " which groups were measured in one session, the rig's constants, and what [rig] says of materials."
        )


@dataclass(frozen=True)
class LookAt(Statement):
    """A cause that the rig itself shows, without launches."""

    topic = "next"
    found: Look

    def say(self, words: Words) -> str:
        how = "Without launches, check {}: that shows whether {} is at work{}."
        sizes = [sized(words, name, p) for name, p in self.found.parameters.items()]
        size = words.put(", by these readings with {}", words.listed(sizes)) if sizes else ""
        return words.put(how, self.found.at, words.cause(self.found.cause), size)


@dataclass(frozen=True)
class Next(Statement):
    """What to measure next; `more` where more sets are tied than a quick diagnosis has distinguished."""

    topic = "next"
    found: NextExperiment
    more: bool

    def say(self, words: Words) -> str:
        first, equal = self.found.proposals[0], self.found.as_good
        how = "No measurement within the ranges measured, or those of [limits], would show much: {}, {}"
        if self.found.recommended:
            how = "Next, measure {}: it {}" if equal else "Next, measure {}: it best {}"
        others = f"; {count(equal, 'other proposal')} may do as well." if equal else "."
        if self.more:
            others += " It separates the two likeliest sets."
            others += " Without --quick, which takes many times as long, up to four are compared."
        return words.put(how + others, words.number(first.text), self.found.promise(first, words))

"""What the readings say besides: of values, of single readings, and of causes that are not named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from psafit.diagnose.answer.findings import by_cause, sized
from psafit.diagnose.answer.statement import Statement, Topic
from psafit.diagnose.record.misfit import Condition, Reading
from psafit.diagnose.record.models import Counted, ParameterResult, SessionResult
from psafit.diagnose.words import Words
from psafit.experiment import GroupId
from psafit.physics import TERMS
from psafit.records import Overdamped
from psafit.text import count, fixed, significant


@dataclass(frozen=True)
class Redefined(Statement):
    """What parameters of the baseline are with the causes that are reported: by parameter and cause."""

    topic = "besides"
    values: dict[str, dict[str, str]]

    def say(self, words: Words) -> str:
        each = (
            words.put(
                "With {}, {} {}.", words.listed(map(words.cause, causes)), words.parameter(name),
                words.number(f"is {next(iter(causes.values()))}")
                if len(causes) == 1
                else "only scales the law that these make together",
            )
            for name, causes in self.values.items()
        )  # fmt: skip
        return words.joined(" ", each)


@dataclass(frozen=True)
class BySession(Statement):
    """What each session has, by a cause that differs by session."""

    topic = "besides"
    sessions: list[SessionResult]

    def say(self, words: Words) -> str:
        values = ((s, words.value(s.value.unit, s.value.median, s.value.interval)) for s in self.sessions)
        texts = ((s.cause, words.put("{} in {}", value, s.where)) for s, value in values)
        return words.put("Session by session: {}.", by_cause(words, texts))


@dataclass(frozen=True)
class Indistinct(Statement):
    """Tied sets whose best fits to these readings are the same: more of them would not decide."""

    topic = "besides"
    nats: float
    others: int

    def say(self, words: Words) -> str:
        them = "the two sets" if self.others == 1 else "the set named first from the others"
        return words.put(
            "To measure the same once more would not decide: by their best fits it would separate {} by about {}.",
            them, words.number(f"{fixed(self.nats, 1)} nats"),
        )  # fmt: skip


@dataclass(frozen=True)
class Lagging(Statement):
    """A damping of the stack that is none; what may stand for it has no name here."""

    topic = "besides"
    found: Overdamped

    def say(self, words: Words) -> str:
        text = words.number(self.found.text)
        return words.put("{}{}.", text[:1].upper(), text[1:])


def _place(at: Condition, words: Words) -> str:
    """Where a reading was taken: its group and condition, along a trace also when."""
    when = "" if at.time_us is None else f", {at.time_us:.6g} us"
    condition = words.number(f"{at.frequency_hz:.6g} Hz, {at.amplitude_v:.4g} V{when}")
    return words.put("{}, {}", words.groups([at.group]), condition)


@dataclass(frozen=True)
class Furthest(Statement):
    """The readings furthest from a model, how many are beyond four standard deviations, and the scatter's tails.

    `tails` is the 90 % interval of Student's nu, where the readings ask for heavier tails than is usual.
    """

    topic = "besides"
    causes: list[str]
    readings: list[Reading]
    odd: int
    tails: tuple[float, float] | None

    def say(self, words: Words) -> str:
        far = (
            words.put(
                "{} ({} read{}, {} predicted)", _place(r, words),
                words.number(f"{significant(r.reading)} {r.unit}"),
                words.put(", {} when repeated", words.number(f"{', '.join(map(significant, r.repeats))} {r.unit}"))
                if r.repeats
                else "",
                words.number(f"{significant(r.predicted)} {r.unit}"),
            )
            for r in self.readings
        )  # fmt: skip
        text = words.put("Furthest from {}: {}.", words.named_before(self.causes), words.joined("; ", far))
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
    """Causes of which even a plausible strength would not show, and those that act on nothing that was read."""

    topic = "besides"
    causes: list[str]
    idle: list[str]
    of: int

    def say(self, words: Words) -> str:
        acts = "does not act" if len(self.idle) == 1 else "do not act"
        each = (
            words.put("{} {}: {}", len(ids), what, words.joined(", ", map(words.cause, ids)))
            for ids, what in (
                (self.causes, "could not have been seen in these readings"), (self.idle, f"{acts} on what was read"),
            )
            if ids
        )  # fmt: skip
        return words.put("Of {} candidate cause{}, {}.", self.of, "" if self.of == 1 else "s", words.joined("; ", each))


@dataclass(frozen=True)
class TooWeak(Statement):
    """What may be at work as well, by too little to show, and what it would change of the values."""

    topic: ClassVar[Topic] = "besides"
    adopted: list[str]
    counted: Counted
    values: dict[str, ParameterResult]

    def say(self, words: Words) -> str:
        c = self.counted
        more = [id for id in c.terms if id not in self.adopted]
        text = words.put(
            "Perhaps at work as well, but too weak to count by itself: {}, with {}. {} times {} {} alone{}.",
            words.listed(map(words.cause, more)),
            words.listed(sized(words, name, p) for name, p in c.parameters.items()),
            words.number(significant(max(c.odds, 1 / c.odds), 2)),
            "as probable as" if c.odds >= 1 else "less probable than",
            words.named_before(self.adopted),
            "" if c.by_readings is None or c.odds < 1 else words.put(
                ": the readings give a factor of {}, and what is expected of such rigs {}",
                *(words.number(significant(x, 2)) for x in (c.by_readings, c.odds / c.by_readings)),
            ),
        )  # fmt: skip
        return words.put("{} {}", text, self._moved(words)) if c.moved else text

    def _moved(self, words: Words) -> str:
        """What the values are with more causes."""
        more = len(self.counted.terms) - len(self.adopted)
        moved = (
            words.put("{}, not {}", sized(words, name, p), words.number(significant(self.values[name].median)))
            for name, p in self.counted.moved.items()
        )
        return words.put("With {}, {}.", "it" if more == 1 else "them", words.joined("; ", moved))


@dataclass(frozen=True)
class WithHeld(TooWeak):
    """The same of what the experiment holds to be at work, with its probability and the table that says so.

    It does not show, and with it the set is more probable: what it does to the values belongs to these.
    """

    topic = "wrong"
    held: list[tuple[str, float, str]]

    def say(self, words: Words) -> str:
        each = (words.put("{} ({} by {})", words.cause(id), words.per_cent(p), by) for id, p, by in self.held)
        return words.put(
            "The values of {} are without {}, which the readings do not show. With {} the set is {} times as probable."
            " {}{}",
            words.named_before(self.adopted), words.listed(each), "it" if len(self.held) == 1 else "them",
            words.number(significant(self.counted.odds, 2)), self._moved(words),
            to_see(words, [id for id, *_ in self.held]),
        )  # fmt: skip


@dataclass(frozen=True)
class AtWork(Statement):
    """Causes that are likely before any reading and do not show.

    With the table of the experiment that makes them likely, how probable they are, and how much the readings leave them
    at most.
    """

    topic = "besides"
    causes: list[tuple[str, str, float, float | None]]
    named: list[str]
    groups: list[GroupId]

    def say(self, words: Words) -> str:

        def left(room: float | None) -> str:
            return "" if room is None else words.put("; it may change a reading by up to {}", words.fraction(room))

        each = (
            words.put("{} ({} by {}{})", words.cause(c), words.per_cent(p), by, left(room))
            for c, by, p, room in self.causes
        )
        it = "it" if len(self.causes) == 1 else "them"
        return words.put(
            "Probably at work, by what is known of the rig, but not seen in these readings: {}. The values here are"
            " without {}; those with {} are given by {}.{}",
            words.joined(", ", each), it, it,
            words.fit_command(self.groups, [*self.named, *(c for c, *_ in self.causes)]),
            to_see(words, [c for c, *_ in self.causes]),
        )  # fmt: skip


@dataclass(frozen=True)
class Against(Statement):
    """Causes that are likely before any reading and are not after them; with both probabilities."""

    topic = "besides"
    causes: list[tuple[str, str, float, float]]
    named: list[str]
    groups: list[GroupId]

    def say(self, words: Words) -> str:
        each = (
            words.put(
                "{} ({} by {}, {} after the readings)", words.cause(c), words.per_cent(before), by, words.share(after)
            )
            for c, by, before, after in self.causes
        )
        return words.put(
            "The readings speak against what is expected of the rig: {}. What they leave is shown by {}.",
            words.joined(", ", each), words.fit_command(self.groups, [*self.named, *(c for c, *_ in self.causes)]),
        )  # fmt: skip


def to_see(words: Words, ids: Sequence[str]) -> str:
    """What to look at on the rig to see some causes, a sentence each, behind another."""
    seen = (t for id in ids for t in TERMS if t.look and t.id == id)
    return words.joined("", (words.put(" To see {}: {}.", words.cause(t.id), t.look) for t in seen))


@dataclass(frozen=True)
class Room(Statement):
    """The largest change of a reading that the readings leave a cause added to what is adopted (95 %).

    It holds of all other causes but the `unbounded`, only if what is adopted is right, and of what no other parameter
    could do in the cause's place. Less than `least` is not worth a number, more names than `few` are not listed.
    """

    topic = "besides"
    adopted: list[str]
    cause: str
    share: float
    unbounded: list[str]
    of: int
    place: Condition | None
    least: float = 0.001
    few: int = 5

    def say(self, words: Words) -> str:
        where = _place(self.place, words) if self.place else ""
        causes = count(self.of, "other cause" if self.adopted else "cause")
        if not self.unbounded:
            bounded = words.put("All {} could be bounded" if self.of > 1 else "{} could be bounded", causes)
        else:
            free = words.put("{} could not", words.listed(map(words.cause, self.unbounded)))
            if len(self.unbounded) > self.few:
                free = "of the others no limit could be computed"
            bounded = words.put("Of {}, {} could be bounded; {}", causes, self.of - len(self.unbounded), free)
        return words.put(
            "The most that these readings leave to a further cause: {} changes a reading{} by up to {} (95 % limit),"
            " added to {} and refitted. {}.",
            words.cause(self.cause), words.put(" ({})", where) if where else "",
            words.fraction(max(self.share, self.least)), words.named_before(self.adopted), bounded,
        )  # fmt: skip

"""Data sets of known truth that were diagnosed, and how often what was said of them is right."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.stats import binomtest, norm

VerdictWord = Literal["adequate", "explained", "ambiguous", "unexplained"]

Why = Literal["", "structure", "smooth", "law", "values"]
"""Why a set of causes does not explain the readings."""


def stands(verdict: str, why: str) -> bool:
    """Whether what a verdict names is put forward as the truth.

    A set that explains nothing, or that breaks a law, is not. One that fits at implausible values alone is named all
    the same.
    """
    return why == "values" or (verdict != "unexplained" and not why)


@dataclass(frozen=True)
class Trial:
    """One data set drawn from the answer, and what a diagnosis says of it.

    Parameters
    ----------
    truth : list of str
        Causes of the model that made it.
    verdict : {"adequate", "explained", "ambiguous", "unexplained"}
    named : list of str
    alternatives : list of lists of str
    printed : float, optional
        Probability printed of what is named; None where that is not put forward as the truth (`stands`).
    held, intervals : int
        90 % intervals that hold the truth, of those of parameters that the truth has, too.
    why : {"", "structure", "smooth", "law", "values"}
        Why what is named does not explain the readings.
    """

    truth: list[str]
    verdict: VerdictWord
    named: list[str]
    alternatives: list[list[str]]
    printed: float | None
    held: int
    intervals: int
    why: Why = ""

    @property
    def exact(self) -> bool:
        """Whether the truth is what is named."""
        return stands(self.verdict, self.why) and {*self.named} == {*self.truth}

    @property
    def reported(self) -> bool:
        """Whether the truth is among what is named and what does as well."""
        sets = [*self.alternatives, *([self.named] if self.named or self.verdict == "adequate" else [])]
        return any({*ids} == {*self.truth} for ids in sets)


@dataclass(frozen=True)
class Rate:
    """How often something was so: a count `n` of some `of`, and the 90 % interval of the rate (Clopper-Pearson)."""

    n: int
    of: int
    lower: float
    upper: float

    @classmethod
    def counted(cls, found: Iterable[bool]) -> Rate:
        """Count the trials that are true."""
        rows = list(found)
        if not rows:
            return cls(0, 0, 0.0, 1.0)
        ends = binomtest(sum(rows), len(rows)).proportion_ci(0.9)
        return cls(sum(rows), len(rows), float(ends.low), float(ends.high))


@dataclass(frozen=True)
class Reliability:
    """How often what was named at a probability from `lower` to `upper` was the truth, and the mean probability."""

    lower: float
    upper: float
    mean: float
    right: Rate


@dataclass(frozen=True)
class OfTruth:
    """Data sets that one set of causes has made."""

    truth: list[str]
    exact: Rate
    reported: Rate


@dataclass(frozen=True)
class Calibration:
    """How often such a verdict is right at these conditions.

    Parameters
    ----------
    exact, reported : Rate
        Data sets of which the truth was named, and was in the reported set.
    printed : float, optional
        Mean probability printed of what was named.
    right : Rate
        Data sets with such a probability of which the truth was named.
    held, intervals : int
        90 % intervals that held the truth, and all of them. Those of one data set are not independent.
    reliability : list of Reliability
    truths : list of OfTruth
        Most frequent first.
    trials : list of Trial
    """

    exact: Rate
    reported: Rate
    printed: float | None
    right: Rate
    held: int
    intervals: int
    reliability: list[Reliability]
    truths: list[OfTruth]
    trials: list[Trial]

    @property
    def overstated(self) -> bool:
        """Whether what was named is right less often than its printed probability says, beyond chance."""
        return self.printed is not None and self.printed > self.right.upper

    @property
    def narrow(self) -> bool:
        """Whether fewer than 90 % of the intervals hold the truth, beyond chance.

        Those of one data set hang together: the standard error is that of their sums, and at least that of as many
        independent ones.
        """
        share = self.held / max(self.intervals, 1)
        between = math.hypot(*(t.held - share * t.intervals for t in self.trials))
        error = max(between, math.sqrt(0.9 * 0.1 * self.intervals)) / max(self.intervals, 1)
        return bool(share + norm.ppf(0.95) * error < 0.9) and self.intervals > 0

    def behind(self, verdict: str, named: Sequence[str]) -> list[tuple[list[str], int]]:
        """What made the data sets that got this verdict and this name, and how many; most frequent first."""
        made = Counter(tuple(t.truth) for t in self.trials if t.verdict == verdict and {*t.named} == {*named})
        return [(list(truth), n) for truth, n in sorted(made.items(), key=lambda item: (-item[1], item[0]))]


def summed(trials: Sequence[Trial], *, edges: Sequence[float] = (0.0, 0.5, 0.8, 0.95, 1.0)) -> Calibration:
    """Count over data sets; probabilities are binned between `edges`, of which each bin holds the upper."""
    sure = [(t.printed, t.exact) for t in trials if t.printed is not None]
    reliability = []
    for lower, upper in itertools.pairwise(edges):
        within = [(p, right) for p, right in sure if lower < p <= upper]
        if within:
            mean = float(np.mean([p for p, _ in within]))
            reliability.append(Reliability(lower, upper, mean, Rate.counted(right for _, right in within)))
    made: dict[tuple[str, ...], list[Trial]] = {}
    for t in trials:
        made.setdefault(tuple(t.truth), []).append(t)
    return Calibration(
        exact=Rate.counted(t.exact for t in trials),
        reported=Rate.counted(t.reported for t in trials),
        printed=float(np.mean([p for p, _ in sure])) if sure else None,
        right=Rate.counted(right for _, right in sure),
        held=sum(t.held for t in trials),
        intervals=sum(t.intervals for t in trials),
        reliability=reliability,
        truths=[
            OfTruth(list(ids), Rate.counted(t.exact for t in rows), Rate.counted(t.reported for t in rows))
            for ids, rows in sorted(made.items(), key=lambda item: (-len(item[1]), item[0]))
        ],
        trials=list(trials),
    )

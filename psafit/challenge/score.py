"""How well a campaign's verdicts agree with what was hidden.

The *reported set* of a diagnosis is what it named and each of its alternatives. Intervals of rates are exact binomial
(Clopper and Pearson), 95 %. Printed probabilities are judged by the logarithmic score, which is highest on average for
who prints what they are (I. J. Good, J. R. Stat. Soc. B 14 (1952) 107).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import beta, bootstrap

from psafit.challenge.answer import DrawnDesign, Place
from psafit.challenge.campaign import PRIOR, SEEN_NATS, Result
from psafit.diagnose.trials import stands
from psafit.drives import WAVEFORMS, Drive
from psafit.observables import LAUNCH_RANGE, OBSERVABLES
from psafit.text import fixed, set_name

Ids = frozenset[str]

# Of two causes, each must add so much to the other to be asked for.
SEEN_EACH_NATS = 10.0
SHOWING_NATS = 3.6
"""An oracle gain (log likelihood) below which no prior of the catalogue's kinds gives a cause the evidence of one.

Which is `psafit.model_search.SearchSettings.visible`: a search goes on from what has more. At its best width a
log-normal prior gives that to a gain of 3.6 nats, a half normal one to 3.8, a normal one to 4.6.
"""
GAIN_EDGES = (0.0, 5.0, 10.0, 25.0, 50.0, 100.0, math.inf)
PROBABILITY_EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)


@dataclass(frozen=True)
class Rate:
    """A share of data sets: `k` of `n`, with its interval; None without any."""

    k: int
    n: int
    share: float | None
    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class Mean:
    """A mean over `n` data sets with its 95 % interval, by bootstrap over them; None of too few."""

    n: int
    mean: float | None
    lower: float | None
    upper: float | None


@dataclass(frozen=True)
class Row:
    """The verdict on one data set.

    Parameters
    ----------
    id, kind, level, design : str
    truth : str
        Causes joined by " + ", "nothing", or the name of an outside effect.
    gain : float
        Of the oracle, nats.
    verdict : str
        Of the diagnosis; "failed" without one.
    named : str
        Causes joined by " + ", or "nothing".
    in_set : bool
        Whether the truth is in the reported set.
    exact : bool
        Whether exactly the truth is named.
    located : bool
        Of an outside effect: whether the misfit points where it acts.
    confusable : list of str
        Causes that nobody can distinguish from the truth here.
    set_size : int
    probability : float, optional
        Printed for exactly the truth.
    log_score : float, optional, nats
        Logarithm of the probability printed for the causes that show; of what is left where they are not listed. None
        of an outside effect, without a diagnosis, and where no set of causes alone is right.
    seconds : float
        Of the diagnosis.
    seed : int
        Replays the data set.
    n_named : int
        Causes that are named.
    """

    id: str
    kind: str
    level: str
    design: str
    truth: str
    gain: float
    verdict: str
    named: str
    in_set: bool
    exact: bool
    located: bool
    confusable: list[str]
    set_size: int
    probability: float | None
    log_score: float | None
    seconds: float
    seed: int
    n_named: int = 0

    @property
    def detected(self) -> bool:
        """Whether the verdict finds something wrong."""
        return self.verdict not in ("adequate", "failed")

    @property
    def noticed(self) -> bool:
        """Whether an outside effect is unexplained, or found where it acts."""
        return self.verdict == "unexplained" or (self.detected and self.located)

    @property
    def missed(self) -> bool:
        """Whether it is a false alarm, or not named though an oracle sees it."""
        if self.kind == "nothing":
            return self.verdict != "adequate"
        return self.gain >= SEEN_NATS and not (self.noticed if self.kind == "outside" else self.exact)

    @property
    def right(self) -> bool:
        """Whether the answer is right: adequate, an outside effect noticed, or the truth in the reported set."""
        if self.kind == "nothing":
            return self.verdict == "adequate"
        return self.noticed if self.kind == "outside" else self.in_set


@dataclass(frozen=True)
class GainBin:
    """Rates of single causes whose oracle gain lies in [lower, upper) nats."""

    lower: float
    upper: float | None
    detected: Rate
    named: Rate
    in_set: Rate


@dataclass(frozen=True)
class ProbabilityBin:
    """Printed probabilities in [lower, upper) and how often they were right.

    `holds`: the mean lies within the interval that would contain it in all bins at once 95 times of 100.
    """

    lower: float
    upper: float
    mean: float | None
    right: Rate
    holds: bool


@dataclass(frozen=True)
class Recovery:
    """One parameter of causes that were named exactly.

    `error` is the median of (reported median - truth)/(half the width of the interval).
    """

    name: str
    covered: Rate
    error: float | None


def so_far(sure: bool) -> str:
    """What is added to a verdict that more data sets may change."""
    return "" if sure else " so far"


@dataclass(frozen=True)
class Target:
    """One line of the table of targets.

    `holds` is None where no data set asks for it. `sure` is whether the whole 95 % interval lies on the side that the
    rate does. That bins agree with the diagonal is a test, which only a miss makes sure.
    """

    what: str
    value: float | None
    target: str
    holds: bool | None
    rate: Rate
    sure: bool = True

    @property
    def verdict(self) -> str:
        """Whether it holds, in words."""
        if self.holds is None:
            return "not asked"
        return ("holds" if self.holds else "misses") + so_far(self.sure)

    @property
    def text(self) -> str:
        """The line for a terminal."""
        count = f"{self.rate.k} of {self.rate.n}"
        return f"{self.verdict:13}  {percent(self.value):>5}  ({self.target}, {count})  {self.what}"


@dataclass(frozen=True)
class Score:
    """`score.json`.

    Parameters
    ----------
    n, n_failed : int
        Data sets, and those without a diagnosis.
    targets : list of Target
    false_alarms : Rate
        Of data sets with nothing hidden.
    by_gain : list of GainBin
    by_design : dict
        How drawn designs are driven and what they read, then the share of right answers; of data sets with nothing
        hidden, or of 25 nats or more.
    confusion : dict
        Truth, then what was named, then how often; single causes of 25 nats or more, nothing, and outside effects.
    set_size : dict
        Size of the reported set, then how often; single causes of 25 nats or more.
    reliability, believed : list of ProbabilityBin
        Of all data sets, and of those whose truth was drawn from the diagnosis's own priors.
    log_score : Mean
        Of the data sets' scores, nats.
    recovery : list of Recovery
    coverage, coverage_believed : Rate
        Of all intervals of parameters of causes that were named exactly; and of those whose truth was drawn from the
        diagnosis's own priors, whatever was named, of parameters that the truth has: of these alone a sound posterior's
        intervals hold as many as they say. The rate's own interval knows that those of one data set hit or miss
        together.
    outside : dict
        Effect, then verdict (or "located"), then how often.
    seconds : dict
        ``median`` and ``p90`` of the time of one diagnosis.
    rows : list of Row
    """

    n: int
    n_failed: int
    targets: list[Target]
    false_alarms: Rate
    by_gain: list[GainBin]
    by_design: dict[str, Rate]
    confusion: dict[str, dict[str, int]]
    set_size: dict[str, int]
    reliability: list[ProbabilityBin]
    believed: list[ProbabilityBin]
    log_score: Mean
    recovery: list[Recovery]
    coverage: Rate
    coverage_believed: Rate
    outside: dict[str, dict[str, int]]
    seconds: dict[str, float | None]
    rows: list[Row]


def percent(share: float | None) -> str:
    """A share in whole per cent; a dash for none."""
    return "-" if share is None else f"{fixed(share, per_cent=True)} %"


def rate(hits: Iterable[bool], confidence: float = 0.95) -> Rate:
    """Share of hits with its exact binomial interval."""
    listed = list(hits)
    k, n = sum(listed), len(listed)
    if n == 0:
        return Rate(0, 0, None, None, None)
    return Rate(k, n, k / n, *_exact(k, n, confidence))


def _exact(k: float, n: float, confidence: float = 0.95) -> tuple[float, float]:
    """Clopper and Pearson's interval of a share."""
    tail = 0.5 * (1.0 - confidence)
    lower = 0.0 if k == 0 else float(beta.ppf(tail, k, n - k + 1))
    upper = 1.0 if k == n else float(beta.ppf(1.0 - tail, k + 1, n - k))
    return lower, upper


def clustered(hits: Sequence[Sequence[bool]]) -> Rate:
    """Share of hits that come in clusters, which hit or miss together: the intervals of one posterior.

    The interval is that of as many independent hits as have the same variance (E. L. Korn and B. I. Graubard, Survey
    Methodology 24 (1998) 193); where all hit or all miss, of one for each cluster.
    """
    clusters = [c for c in hits if c]
    k, n = sum(map(sum, clusters)), sum(map(len, clusters))
    if n == 0:
        return rate([])
    share, m = k / n, len(clusters)
    spread = sum((sum(c) - share * len(c)) ** 2 for c in clusters) * m / max(m - 1, 1)
    effective = m if k in (0, n) else n / max(spread / (n * share * (1 - share)), 1.0)
    return Rate(k, n, share, *_exact(share * effective, effective))


def mean(values: Sequence[float], seed: int = 0) -> Mean:
    """Mean with its interval by bootstrap (percentiles)."""
    if len(values) < 2:
        return Mean(len(values), values[0] if values else None, None, None)
    found = bootstrap((values,), np.mean, method="percentile", rng=np.random.default_rng(seed))
    low, high = found.confidence_interval
    return Mean(len(values), float(np.mean(values)), float(low), float(high))


def gained(now: Sequence[Row], before: Sequence[Row]) -> Mean:
    """What one campaign's logarithmic score has above another's, nats, over the data sets that both have.

    Parameters
    ----------
    now, before : sequence of Row
    """
    old = {(row.id, row.seed): row.log_score for row in before}
    pairs = [(row.log_score, old.get((row.id, row.seed))) for row in now]
    return mean([a - b for a, b in pairs if a is not None and b is not None])


def reported_set(diagnosis: dict[str, Any]) -> set[Ids]:
    """What a diagnosis named and each of its alternatives; nothing at all is a member if it says so."""
    if not diagnosis:
        return set()
    found = {frozenset(ids) for ids in diagnosis["alternatives"]}
    if diagnosis["named"] or diagnosis["verdict"] == "adequate":
        found.add(frozenset(diagnosis["named"]))
    return found


def located(diagnosis: dict[str, Any], places: Sequence[Place], share: float = 0.5) -> bool:
    """Whether at least this share of what the misfit points at lies where the effect acts."""
    pointed = (diagnosis.get("misfit") or {}).get("where") or []
    hits = [any(_within(where, place, share) for place in places) for where in pointed]
    return bool(hits) and sum(hits) >= share * len(hits)


def _within(where: dict[str, Any], place: Place, share: float) -> bool:
    if str(where.get("group")) != str(place.group):
        return False
    if place.variable is None:
        return True
    low, high = where.get("from"), where.get("to")
    if where.get("variable") != place.variable or low is None or high is None:
        return False
    left = max(low, -math.inf if place.lower is None else place.lower)
    right = min(high, math.inf if place.upper is None else place.upper)
    if right < left:
        return False
    if low <= 0 or high <= low:  # a single condition: it lies inside
        return high <= low or (right - left) >= share * (high - low)
    return math.log(right / left) >= share * math.log(high / low)


def _label(ids: Iterable[str]) -> str:
    return set_name(sorted(ids), "nothing")


def _row(result: Result) -> Row:
    truth = frozenset(result.answer.terms)
    diagnosis = result.diagnosis
    outside = result.spec.kind == "outside"
    members = reported_set(diagnosis)
    verdict = diagnosis["verdict"] if diagnosis else "failed"
    printed = [c.get("probability") for c in diagnosis.get("causes", []) if frozenset(c["terms"]) == truth]
    named = bool(diagnosis) and stands(verdict, diagnosis.get("unexplained_by", ""))
    exact = not outside and named and frozenset(diagnosis["named"]) == truth
    return Row(
        id=result.spec.id,
        kind=result.spec.kind,
        level=result.spec.level,
        design=result.spec.design,
        truth=result.answer.outside or _label(truth),
        gain=result.oracle.gain,
        verdict=verdict,
        named=_label(diagnosis["named"]) if diagnosis else "failed",
        n_named=len(diagnosis["named"]) if diagnosis else 0,
        in_set=not outside and truth in members,
        exact=exact,
        located=outside and located(diagnosis, result.answer.places),
        confusable=list(result.oracle.confusable or []),
        set_size=len(members),
        probability=printed[0] if printed and not outside else None,
        log_score=_log_score(result),
        seconds=result.seconds["diagnose"],
        seed=result.spec.seed,
    )


def score(results: Sequence[Result]) -> Score:
    """Judge the verdicts of a campaign, or of any part of it.

    Parameters
    ----------
    results : sequence of Result

    Returns
    -------
    Score
    """
    rows = [_row(r) for r in results]
    single, nothing, seen, outside = _kinds(rows)
    drawn = [r for r in results if r.spec.level == PRIOR]
    reliability, believed = _reliability(results), _reliability(drawn)
    recovery, coverage = _recovery(results)
    unselected = clustered([_covered(r) for r in drawn])
    seconds = [row.seconds for row in rows if row.verdict != "failed" and math.isfinite(row.seconds)]
    return Score(
        n=len(rows),
        n_failed=sum(row.verdict == "failed" for row in rows),
        targets=_targets(results, rows, reliability, believed, unselected),
        false_alarms=_alarms(nothing),
        by_gain=_by_gain(single),
        by_design=_by_design(results, rows),
        confusion=_table((row.truth, row.named) for row in [*seen, *nothing, *outside]),
        set_size={str(k): n for k, n in sorted(Counter(row.set_size for row in seen).items())},
        reliability=reliability,
        believed=believed,
        log_score=mean([row.log_score for row in rows if row.log_score is not None]),
        recovery=recovery,
        coverage=coverage,
        coverage_believed=unselected,
        outside=_table(
            (row.truth, said) for row in outside for said in (row.verdict, *(["located"] if row.located else []))
        ),
        seconds={
            "median": float(np.median(seconds)) if seconds else None,
            "p90": float(np.quantile(seconds, 0.9)) if seconds else None,
        },
        rows=rows,
    )


def _kinds(rows: Sequence[Row]) -> tuple[list[Row], list[Row], list[Row], list[Row]]:
    """Single causes, nothing, and what an oracle sees of single causes and of outside effects."""
    single, nothing = ([row for row in rows if row.kind == kind] for kind in ("one", "nothing"))
    seen, outside = ([r for r in rows if r.kind == kind and r.gain >= SEEN_NATS] for kind in ("one", "outside"))
    return single, nothing, seen, outside


def _alarms(nothing: Sequence[Row]) -> Rate:
    return rate(row.verdict != "adequate" for row in nothing)


def _targets(
    results: Sequence[Result],
    rows: Sequence[Row],
    reliability: Sequence[ProbabilityBin],
    believed: Sequence[ProbabilityBin],
    unselected: Rate,
) -> list[Target]:
    """The targets of a campaign, and what was found."""
    _, nothing, seen, outside = _kinds(rows)
    return [
        _at_least(
            f"single cause of {SEEN_NATS:g} nats or more: truth within the reported set", 0.97, (r.in_set for r in seen)
        ),
        _at_least(
            "the same, not provably confusable: truth named by itself, or first of an ambiguous set",
            0.90,
            (r.exact for r in seen if not r.confusable),
        ),
        _at_most("nothing hidden: verdict other than adequate", 0.05, _alarms(nothing)),
        _at_most(
            f"outside effect of {SEEN_NATS:g} nats or more: adequate or explained",
            0.08,
            rate(row.verdict in ("adequate", "explained") for row in outside),
        ),
        _reliable(reliability, "all data sets"),
        _reliable(believed, "those drawn from the priors"),
        _at_least(
            "two causes that both can be seen: both named, or both within the set",
            0.85,
            (_both(r) for r in results if _both_seen(r)),
        ),
        _at_most(
            f"probabilities printed above {PROBABILITY_EDGES[-2]:g}: wrong",
            0.03,
            _opposite(reliability[-1].right),
        ),
        _between(
            "90 % intervals, truths of at most two causes drawn from the priors, whatever is named: hold the truth",
            "87 to 93 %",
            unselected,
            0.87,
            0.93,
        ),
    ]


def _at_least(what: str, least: float, hits: Iterable[bool]) -> Target:
    return _between(what, f"at least {100 * least:g} %", rate(hits), least, 1.0)


def _at_most(what: str, most: float, found: Rate) -> Target:
    return _between(what, f"at most {100 * most:g} %", found, 0.0, most)


def _between(what: str, target: str, found: Rate, least: float, most: float) -> Target:
    if found.share is None or found.lower is None or found.upper is None:
        return Target(what, None, target, None, found)
    inside = least <= found.lower and found.upper <= most
    outside = found.upper < least or found.lower > most
    return Target(what, found.share, target, least <= found.share <= most, found, inside or outside)


def _opposite(found: Rate) -> Rate:
    """Share of what does not hit."""
    return rate([True] * (found.n - found.k) + [False] * found.k)


def _both_seen(result: Result) -> bool:
    each = result.oracle.without.values()
    return result.spec.kind == "two" and result.oracle.gain >= SEEN_NATS and min(each, default=0.0) >= SEEN_EACH_NATS


def _both(result: Result) -> bool:
    truth = frozenset(result.answer.terms)
    return any(truth <= member for member in reported_set(result.diagnosis))


def _by_gain(single: Sequence[Row]) -> list[GainBin]:
    bins = []
    for low, high in pairwise(GAIN_EDGES):
        inside = [row for row in single if low <= row.gain < high]
        bins.append(
            GainBin(
                low,
                high if math.isfinite(high) else None,
                rate(row.detected for row in inside),
                rate(row.exact for row in inside),
                rate(row.in_set for row in inside),
            )
        )
    return bins


def _by_design(results: Sequence[Result], rows: Sequence[Row]) -> dict[str, Rate]:
    """Right answers by how designs are driven and what they read, of those that say so."""
    hits: dict[str, list[bool]] = {}
    for result, row in zip(results, rows, strict=True):
        if result.answer.drawn is not None and (row.kind == "nothing" or row.gain >= SEEN_NATS):
            for kind in _kinds_of(result.answer.drawn):
                hits.setdefault(kind, []).append(row.right)
    return {kind: rate(found) for kind, found in sorted(hits.items())}


def _kinds_of(design: DrawnDesign) -> set[str]:
    """What of a design stacks of today have, and the study's has not; see `psafit.drives.Drive.label`."""
    drives = {label.partition(" (")[0] for label in design.drives.values()}
    read = {name for names in design.observables.values() for name in names} - {LAUNCH_RANGE.name}
    found = {"traces" if o.traced else o.titles for o in OBSERVABLES if o.name in read}
    found |= {"recorded drives"} & {f"{name}s" for name in drives}
    unipolar = {Drive(w.id).label for w in WAVEFORMS.values() if w.unipolar}
    return found | ({"drives from 0 V"} if drives & unipolar else set())


def _table(pairs: Iterable[tuple[str, str]]) -> dict[str, dict[str, int]]:
    table: dict[str, dict[str, int]] = {}
    for (truth, said), n in sorted(Counter(pairs).items()):
        table.setdefault(truth, {})[said] = n
    return table


def _showing(result: Result) -> frozenset[str] | None:
    """The true causes that an oracle gains by: a printed probability is that of what the readings show.

    None where causes show together and each alone does for the other: no set is then wrong that has one of them.
    """
    gains = result.oracle.without or dict.fromkeys(result.answer.terms, result.oracle.gain)
    shown = frozenset(id for id in result.answer.terms if gains.get(id, 0.0) >= SHOWING_NATS)
    return shown if shown or result.oracle.gain < SHOWING_NATS else None


def _log_score(result: Result, least: float = 1e-4) -> float | None:
    """Logarithm of the probability printed for what shows; `least`, since no more digits are printed."""
    truth = None if result.spec.kind == "outside" else _showing(result)
    if truth is None or not result.diagnosis:
        return None
    printed = {frozenset(c["terms"]): float(c["probability"]) for c in result.diagnosis.get("causes", [])}
    return math.log(max(printed.get(truth, 1.0 - sum(printed.values())), least))


def _reliability(results: Iterable[Result]) -> list[ProbabilityBin]:
    """Every printed probability against whether its set of causes is exactly the truth, as far as that shows."""
    printed: list[tuple[float, bool]] = []
    for result in results:
        if result.spec.kind == "outside":
            continue  # none of the candidates can be right
        truth = _showing(result)
        if truth is None:
            continue
        for cause in result.diagnosis.get("causes", []):
            p = cause.get("probability")
            if isinstance(p, int | float) and math.isfinite(p):
                printed.append((float(p), frozenset(cause["terms"]) == truth))
    pairs = list(pairwise(PROBABILITY_EDGES))
    bins = []
    for low, high in pairs:
        inside = [(p, hit) for p, hit in printed if low <= p < high or (high == 1.0 and p >= 1.0)]
        mean = float(np.mean([p for p, _ in inside])) if inside else None
        wide = rate((hit for _, hit in inside), 1.0 - 0.05 / len(pairs))
        holds = mean is None or (wide.lower or 0.0) <= mean <= (1.0 if wide.upper is None else wide.upper)
        bins.append(ProbabilityBin(low, high, mean, rate(hit for _, hit in inside), holds))
    return bins


def _reliable(bins: Sequence[ProbabilityBin], of: str) -> Target:
    filled = [b for b in bins if b.right.n]
    good = rate(b.holds for b in filled)
    holds = all(b.holds for b in filled) if filled else None
    what = f"printed probabilities, {of}: bins within sampling error of the diagonal"
    return Target(what, good.share, "all of them", holds, good, sure=not holds)


def _known(result: Result) -> list[tuple[str, float, dict[str, Any]]]:
    """Parameters of the leading candidate that the truth has: name, truth, and what was printed."""
    truth, causes = result.answer.parameters, result.diagnosis.get("causes") or [{}]
    printed = (causes[0].get("parameters") or {}).items()
    known = [(name, entry) for name, entry in printed if truth.get(name) is not None and isinstance(entry, dict)]
    return [
        (name, truth[name], entry)
        for name, entry in known
        if all(entry.get(k) is not None for k in ("median", "lower", "upper"))
    ]


def _covered(result: Result) -> list[bool]:
    """Whether each interval of the leading candidate holds the truth."""
    return [entry["lower"] <= true <= entry["upper"] for _, true, entry in _known(result)]


def _recovery(results: Sequence[Result]) -> tuple[list[Recovery], Rate]:
    """Intervals of the leading candidate's parameters, where it is exactly the truth."""
    found: dict[str, list[tuple[bool, float]]] = {}
    together: list[list[bool]] = []
    for result in results:
        together.append([])
        causes = result.diagnosis.get("causes") or [{"terms": [], "parameters": {}}]
        truth = frozenset(result.answer.terms)
        named = frozenset(result.diagnosis.get("named", []))
        if not truth or named != truth or frozenset(causes[0]["terms"]) != truth:
            continue
        for name, true, entry in _known(result):
            half = 0.5 * (entry["upper"] - entry["lower"])
            error = (entry["median"] - true) / half if half > 0 else math.nan
            together[-1].append(entry["lower"] <= true <= entry["upper"])
            found.setdefault(name, []).append((together[-1][-1], error))
    recovery = []
    for name, pairs in sorted(found.items()):
        errors = [e for _, e in pairs if math.isfinite(e)]
        recovery.append(Recovery(name, rate(hit for hit, _ in pairs), float(np.median(errors)) if errors else None))
    return recovery, clustered(together)


__all__ = [
    "SEEN_EACH_NATS", "SEEN_NATS", "GainBin", "Mean", "ProbabilityBin", "Rate", "Recovery", "Row", "Score", "Target",
    "gained", "located", "mean", "percent", "rate", "reported_set", "score",
]  # fmt: skip

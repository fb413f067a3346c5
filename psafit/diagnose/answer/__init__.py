"""The answer of a diagnosis: statements with their numbers, and for each the one sentence that says it.

`answer` reads the record and chooses what may be said. Each statement knows its sentence, and takes the words for
causes, groups and numbers from `psafit.diagnose.words.Words`: the record's plain ones, or a page's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

from psafit.diagnose.answer.besides import (
    Against,
    AtWork,
    BySession,
    Furthest,
    Indistinct,
    Lagging,
    Redefined,
    Room,
    TooWeak,
    Unseen,
    WithHeld,
)
from psafit.diagnose.answer.findings import (
    WORTH_SAYING,
    BreaksLaw,
    GainsDiffer,
    Implausible,
    Judged,
    Kind,
    Named,
    NothingShows,
    Replaced,
    Restricted,
    Rival,
    Sizes,
)
from psafit.diagnose.answer.grounds import ByChance, Calibrated, LivesOn, OneGroup, Searched, SmoothIsBetter
from psafit.diagnose.answer.statement import Statement
from psafit.diagnose.answer.worth import CheckFirst, Drafted, Gained, LookAt, Next, NoGain
from psafit.diagnose.gain import Gain
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.misfit import Tests
from psafit.diagnose.record.models import NOT_EXCLUDED, NOT_PRESENT, UNSEEN, CauseResult, ParameterResult
from psafit.diagnose.show import unlike
from psafit.diagnose.words import NO_ACTION, PLAIN
from psafit.inference import noise
from psafit.model_search.model_set import DECISIVE
from psafit.model_search.visibility import VISIBLE
from psafit.observables import OBSERVABLES
from psafit.parameters import Belief
from psafit.physics import TERMS, held_at_work, owner, redefined

_TAILS = noise.PARAMETERS[-1]
_WIDTHS = {parameter.name for o in OBSERVABLES for parameter in o.scatter[:2]}


def answer(d: Diagnosis, beliefs: Sequence[Belief] = ()) -> tuple[Statement, ...]:
    """Return what a diagnosis says, in the order in which it is reported.

    Parameters
    ----------
    d : Diagnosis
    beliefs : sequence of Belief
        What the experiment states, or what follows from its rig.

    Returns
    -------
    tuple of Statement
        Chosen from numbers alone.
    """
    found: list[Statement] = []
    if d.left_out:
        found.append(Restricted([s.id for s in d.screening], len(d.left_out)))
    found += [_judged(d), _named(d)]
    if d.calibration:  # what all the rest is worth
        found.append(Calibrated(d.calibration, d.explains, d.verdict, d.named))
    found += _without(d)
    found += _kinds(d)
    if d.verdict == "unexplained" and (both := unlike(d.misfit.sessions, TERMS, ALPHA)):
        found.append(GainsDiffer(both))
    held = held_at_work(beliefs)
    found += [*_values(d), *map(BreaksLaw, d.laws), *_too_weak(d, held), *_unseen(d), *_at_work(d, held), *_robust(d)]
    if d.influence and (carried := [c for c in d.influence.causes if c.half]):
        found.append(LivesOn(carried, len(d.influence.tail)))
    if d.misfit.search:
        found.append(ByChance(d.misfit.search))
    by_session = {s.cause for c in d.causes for s in c.sessions or []}
    found += [Gained(gain, d.training, _named_in(gain, by_session)) for gain in d.gain.values()] or [NoGain(d.quick)]
    if d.verdict == "unexplained":
        found.append(CheckFirst())
    if d.draft:
        found.append(Drafted(d.draft))
    found += map(LookAt, d.looks[:1])  # which costs least
    if d.next_experiment.proposals:
        found.append(Next(d.next_experiment, d.leaves_tied))
    return (*found, Searched(d.looked_at, d.settings.search.missed))


def sentences(d: Diagnosis, beliefs: Sequence[Belief] = ()) -> list[str]:
    """Return the answer in plain words, as the record and the terminal give it; see `answer`."""
    return [statement.say(PLAIN) for statement in answer(d, beliefs)]


def kept(d: Diagnosis) -> float:
    """Return the probability of the baseline alone."""
    return next((c.probability for c in d.causes if not c.terms), 1.0)


def _judged(d: Diagnosis) -> Judged:
    verdict: Literal["yes", "so far", "no", "together", "tails", "improbable"] = "improbable"
    tests, p_value = d.misfit.baseline, d.misfit.p_value
    if tests.objection == "tests":
        verdict = "no"
    elif d.verdict == "adequate":
        verdict = "so far" if kept(d) < 0.5 else "yes"
    elif tests.objection == "together":
        verdict = "together"
    elif tests.objection == "tails":
        verdict, p_value = "tails", tests.least
    return Judged(verdict, p_value, tests.n_simulated, kept(d), d.mostly_unnamed)


def _named(d: Diagnosis) -> Statement:
    if d.verdict == "adequate":
        others = [(c.terms, c.probability) for c in d.causes if c.terms and c.probability >= WORTH_SAYING]
        return NothingShows(others, kept(d))
    best_model, after = d.best_model, d.misfit.extended
    return Named(
        verdict=d.verdict,
        causes=d.named,
        # Where a discrepancy takes it all, a share of what is left says nothing.
        probability=None if best_model is None or d.mostly_unnamed or not d.named else best_model.probability,
        alternatives=list(_rivals(d)),
        rejected=bool(d.misfit.baseline.objection),
        left=d.unexplained_by,
        objection=after.objection if after and d.unexplained_by else "",
        p_after=after.least if after else 1.0,
        floor=after.floor if after else 0.0,
        unnamed=d.unnamed,
        looked_at=d.looked_at,
        restricted=bool(d.left_out),
    )


def _without(d: Diagnosis) -> Iterator[Statement]:
    """What would be named without each cause that all reported sets have."""
    reported = [d.named, *d.alternatives]
    sure = [w for w in d.without if all(w.cause in ids for ids in reported)]
    if sure and d.verdict in ("explained", "ambiguous"):
        yield Replaced(sure, d.named)


def _kinds(d: Diagnosis) -> Iterator[Statement]:
    """What kind of thing is wrong with the baseline, and still is where nothing explains it."""

    def kind(model: Literal["baseline", "best extension"], t: Tests) -> Iterator[Statement]:
        if t.p_value < ALPHA and t.character != "none":
            yield Kind(model, t.character, t.odd_groups, len(t.odd_points), t.statistics)

    yield from kind("baseline", d.misfit.baseline)
    if d.verdict == "unexplained" and d.misfit.extended:
        yield from kind("best extension", d.misfit.extended)


def _rivals(d: Diagnosis) -> Iterator[Rival]:
    """The alternatives, each with how probable it is."""
    models = {tuple(c.terms): c for c in d.causes}
    named = d.best_model
    for ids in d.alternatives:
        model = models.get(tuple(ids))
        if named is None or model is None:
            yield Rival(ids, None, None, ids in d.by_likelihood)
            continue
        own, p, better = named.probability, model.probability, model.evidence.gain - named.evidence.gain
        more = max(len(model.parameters) - len(named.parameters), 0)
        yield Rival(
            ids,
            # Where a discrepancy takes it all, a share of what is left says nothing.
            None if d.mostly_unnamed else p,
            own / p if own and p else None,
            ids in d.by_likelihood,
            bool(_doubtful(model)),
            better if better - more > DECISIVE else None,
        )


def _values(d: Diagnosis) -> Iterator[Statement]:
    """How large the causes are, and what of that is implausible."""
    tied = [c for ids in d.alternatives[:2] for c in d.causes if c.terms == ids]
    own = _sized([d.best_model] if d.best_model else [])
    others = {name: p for name, p in _sized(tied).items() if name not in own}
    if own or others:
        yield Sizes(list(own.items()), list(others.items()), d.verdict)
    if d.named and (other := redefined(d.named)):
        yield Redefined(other)
    if d.best_model and d.best_model.sessions:
        yield BySession(d.best_model.sessions)
    # Of a baseline that is wrong no value is believed anyway.
    named = [d.best_model] if d.best_model and (d.named or d.verdict == "adequate") else []
    if odd := [(c.terms, values) for c in [*named, *tied] if (values := _doubtful(c))]:
        yield Implausible(odd)
    if named and (lag := named[0].overdamped):
        yield Lagging(lag)
    again = [c.again for c in d.causes if c.again is not None]
    if d.verdict == "ambiguous" and again and max(again) < d.settings.search.visible:
        yield Indistinct(max(again), len(again))


def _doubtful(c: CauseResult) -> list[tuple[str, ParameterResult]]:
    """The implausible values of a model, but for a scatter narrower than its prior expects, which hides nothing."""

    def sharper(name: str, p: ParameterResult) -> bool:
        return name in _WIDTHS and p.prior_interval is not None and p.median < p.prior_interval[0]

    return [(name, p) for name in c.implausible if not sharper(name, p := c.parameters[name])]


def _sized(causes: list[CauseResult]) -> dict[str, ParameterResult]:
    """The values of models' own causes; where several have one, the first's."""
    found: dict[str, ParameterResult] = {}
    for c in causes:
        for name, p in c.parameters.items():
            if owner(name) in c.terms:
                found.setdefault(name, p)
    return found


def _too_weak(d: Diagnosis, held: Mapping[str, tuple[float, str]]) -> Iterator[Statement]:
    """Larger sets that count, though not all of them shows: given a model that is wrong they say nothing.

    With what the experiment holds to be at work the values belong to the short answer.
    """
    if not d.best_model or d.verdict == "unexplained":
        return
    for counted in d.counted:
        more = [id for id in counted.terms if id not in d.named]
        if counted.odds > 1.0 and counted.moved and held.keys() >= {*more}:
            yield WithHeld(d.named, counted, d.best_model.parameters, [(id, *held[id]) for id in more])
        else:
            yield TooWeak(d.named, counted, d.best_model.parameters)


def _unseen(d: Diagnosis) -> Iterator[Statement]:
    """The readings that the model misses most, and the causes that could hide."""
    adopted = d.misfit.extended if d.verdict != "adequate" and d.misfit.extended else d.misfit.baseline
    terms = d.named if adopted is d.misfit.extended else []
    if adopted.furthest:
        yield Furthest(terms, adopted.furthest, len(adopted.odd_points), _tails(d, terms))
    unseen, idle = ([s.id for s in d.screening if s.verdict == word] for word in (UNSEEN, NO_ACTION))
    if unseen or idle:
        yield Unseen(unseen, idle, len(d.screening))
    left = [(s.room, s) for s in d.screening if s.room is not None]
    if left and d.verdict != "unexplained":  # given a model that is wrong it bounds nothing
        share, widest = max(left, key=lambda one: one[0])
        others = [s for s in d.screening if s.id not in {*d.named, *idle}]
        unbounded = [s.id for s in others if s.room is None]
        yield Room(d.named, widest.id, share, unbounded, len(others), widest.room_at)


def _at_work(d: Diagnosis, held: Mapping[str, tuple[float, str]]) -> Iterator[Statement]:
    """The causes that the experiment holds to be at work: those the readings do not show, or speak against.

    They speak against a cause of which they leave less than would be seen, and which they would have shown. Given a
    model that is wrong they bound nothing: of what they would have shown nothing is said then.
    """
    silent, against, bounds = [], [], d.verdict != "unexplained"
    said_of = {id for ids in (d.named, *d.alternatives, *(c.terms for c in d.counted)) for id in ids}
    for s in d.screening:
        if s.id in said_of or s.id not in held:
            continue
        (probability, by), unseen = held[s.id], s.verdict in (UNSEEN, NO_ACTION)
        little = s.verdict == NOT_PRESENT or (s.left is not None and s.left < VISIBLE <= s.visible)
        if unseen or (bounds and s.verdict == NOT_EXCLUDED and s.inclusion < 0.5):
            silent.append((s.id, by, probability, s.room))
        elif little and s.inclusion < 0.5:
            against.append((s.id, by, probability, s.inclusion))
    if silent:
        yield AtWork(silent, d.named, d.groups)
    if against:
        yield Against(against, d.named, d.groups)


def _named_in(gain: Gain, causes: set[str]) -> list[str]:
    """Those of some causes that a choice has named."""
    return sorted(causes & {id for group in gain.groups for id in group.named})


def _tails(d: Diagnosis, terms: list[str]) -> tuple[float, float] | None:
    """The interval of Student's nu, where all of it lies below the median of its prior."""
    model = next((c for c in d.causes if set(c.terms) == set(terms)), None)
    nu = model.parameters.get(_TAILS.name) if model else None
    if nu is None or nu.interval is None:
        return None
    return nu.interval if nu.interval[1] < float(_TAILS.to_physical(_TAILS.prior_quantile(0.5))) else None


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

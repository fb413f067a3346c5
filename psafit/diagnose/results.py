"""What a search has found, as the record holds it: models, tests, screening, and what is drawn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from psafit.diagnose import show
from psafit.diagnose.discrepancy import Discrepancy
from psafit.diagnose.misfit import Coincidence, Misfit, Place
from psafit.diagnose.record.misfit import (
    Condition,
    DiscrepancyResult,
    GroupDiscrepancy,
    MisfitResult,
    Reading,
    Tests,
    Where,
)
from psafit.diagnose.record.models import (
    NEAREST,
    NEXT_BEST,
    NOT_EXCLUDED,
    NOT_PRESENT,
    UNSEEN,
    CauseResult,
    Counted,
    Evidence,
    ModelShown,
    ParameterResult,
    ScreeningResult,
    ScreeningWord,
    SessionResult,
    Without,
)
from psafit.diagnose.residuals import numbered
from psafit.diagnose.robustness import Robustness
from psafit.diagnose.room import Room, room
from psafit.diagnose.screening import PRESENT, Screened
from psafit.diagnose.verdict import Verdict
from psafit.diagnose.words import NO_ACTION
from psafit.experiment import GroupId
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import ImportanceSample
from psafit.inference.problem import Problem
from psafit.inference.summary import by_session, overdamped
from psafit.model_search import Ids
from psafit.model_search.model_set import ModelSet
from psafit.model_search.visibility import VISIBLE
from psafit.observables import OBSERVABLES, aside, recorded_name
from psafit.parameters import broadened
from psafit.physics.term import idle
from psafit.simulate.sensitivity import plausible
from psafit.validate import without_each


def causes_of(model_set: ModelSet, verdict: Verdict, most: int = 12, least: float = 1e-4) -> list[CauseResult]:
    """The models of the record, the most probable first: `most` of them, none below the probability `least`.

    Best model, alternatives and baseline are there in any case, and the best without a named cause if that was sampled.
    """
    likely = [ids for ids in model_set.by_probability() if model_set.probability[ids] >= least]
    shown = [model_set.of(ids) for ids in likely[:most]]
    named = {model_set.without(cause) for cause in verdict.named} & model_set.samples.keys()
    asked = [c for c in model_set.candidates if c.ids in verdict.alternatives or c.ids in named]
    for always in (model_set.best_model, model_set.baseline, *asked):
        if always not in shown:
            shown.append(always)
    # What the verdict names comes first.
    shown.sort(key=lambda c: (set(c.ids) != set(verdict.named), -model_set.probability[c.ids]))
    return [cause_result(model_set, verdict, c) for c in shown]


def _parameters(model_set: ModelSet, candidate: Candidate) -> dict[str, ParameterResult]:
    parameters: dict[str, ParameterResult] = {}
    quantiles = model_set.quantiles(candidate.ids, (0.05, 0.5, 0.95))
    for p, (lower, median, upper) in zip(candidate.problem.parameters, quantiles.T.tolist(), strict=True):
        low, high = (lower, upper) if candidate.ids in model_set.samples else (None, None)
        known = p.prior_share(median), p.reciprocal or None, *p.prior_interval
        parameters[p.name] = ParameterResult(median, low, high, p.unit, p.description, *known)
    return parameters


def sessions_of(model_set: ModelSet, candidate: Candidate) -> list[SessionResult]:
    """What each session has, by causes that differ by session."""
    problem, sampled, found = candidate.problem, model_set.samples.get(candidate.ids), []
    rows = problem.to_physical(sampled.draws if sampled else candidate.modes[:1])
    for term, of, group, values in by_session(problem, rows):
        low, median, high = (
            sampled.quantiles(values, (0.05, 0.5, 0.95)).tolist() if sampled else (None, values[0], None)
        )
        value = ParameterResult(median, low, high, of.unit, of.title, math.nan)
        found.append(SessionResult(term.id, group.id, value, *problem.named_for(term, group)))
    return found


def moved_in(model_set: ModelSet, ids: Ids, named: Ids) -> list[str]:
    """Physical parameters of a sampled set that leave their 90 % intervals in a larger one."""
    if named not in model_set.samples:
        return []
    own, there = model_set.of(named).problem, model_set.of(ids).problem.names
    low, high = model_set.quantiles(named, (0.05, 0.95))
    (median,) = model_set.quantiles(ids, (0.5,))
    return [
        name for k, name in enumerate(own.names[: own.n_physical]) if not low[k] <= median[there.index(name)] <= high[k]
    ]


def counted_sets(model_set: ModelSet, named: Ids) -> list[Ids]:
    """Larger sets that count, though not all of their causes show.

    The one with what is held to be at work, if it moves a value, and then those for which the readings speak.
    """
    held = [ids for ids in model_set.as_held(named) if moved_in(model_set, ids, named)]
    return [*held, *(ids for ids in model_set.counted_with(named) if ids not in held)]


def counted_of(model_set: ModelSet, adopted: Candidate) -> list[Counted]:
    """What `counted_sets` would change of what is adopted."""
    found = []
    for ids in counted_sets(model_set, adopted.ids):
        larger = model_set.of(ids)
        values = _parameters(model_set, larger)
        added = {p.name for t in larger.terms if t.id not in adopted.ids for p in t.parameters}
        moved = {name: values[name] for name in moved_in(model_set, ids, adopted.ids)}
        more = {name: p for name, p in values.items() if name in added}
        by_readings = math.exp(model_set.log_evidence[ids] - model_set.log_evidence[adopted.ids])
        found.append(Counted(list(ids), model_set.odds(ids, adopted.ids), more, moved, by_readings))
    return found


def without_of(model_set: ModelSet, named: Sequence[str]) -> list[Without]:
    """Of each named cause the best set that was fitted without it, the nearest first."""
    own, others = model_set.standing[model_set.best_model.ids], {cause: model_set.without(cause) for cause in named}
    found = [
        Without(cause, list(ids), own - model_set.standing[ids], ids in model_set.samples)
        for cause, ids in others.items()
    ]
    return sorted(found, key=lambda w: w.nats)


def cause_result(model_set: ModelSet, verdict: Verdict, candidate: Candidate) -> CauseResult:
    """What the record says of one model."""
    found = model_set.samples.get(candidate.ids)
    parameters = _parameters(model_set, candidate)
    evidence = Evidence(
        log_evidence=model_set.log_evidence[candidate.ids],
        over_baseline=model_set.log_evidence[candidate.ids] - model_set.log_evidence[()],
        gain=model_set.gain(candidate.ids),
        share=model_set.share[candidate.ids],
        # Laplace's evidence is corrected by its error in a neighbouring model, where sampling has shown it.
        method="adaptive importance sampling" if found else "Laplace",
        prior_odds=model_set.log_prior(candidate.ids) - model_set.log_prior(()),
    )
    if found:
        evidence = replace(
            evidence, error=found.standard_error, effective_draws=found.effective, pareto_k=found.pareto_k,
            prior_width=_sensitivity(candidate, found),
        )  # fmt: skip
    ids = verdict.named if set(candidate.ids) == set(verdict.named) else candidate.ids
    strange = candidate.problem.implausible(np.array([p.median for p in parameters.values()]))
    sessions = sessions_of(model_set, candidate) or None
    return CauseResult(
        list(ids), verdict.probability[candidate.ids], parameters, evidence, strange, sessions,
        overdamped(candidate.problem, list(parameters.values())),
        separated(model_set.best_model, candidate) if candidate.ids in verdict.alternatives else None,
    )  # fmt: skip


def separated(one: Candidate, other: Candidate) -> float:
    """Nats by which the readings, measured once more, would separate two best fits, whichever has made them."""
    known = one.problem.known_sigma
    there = noise.innovations(other.predicted[None], one.predicted[None], one.noise, known)
    back = noise.innovations(one.predicted[None], other.predicted[None], other.noise, known)
    return 0.5 * max(float(np.sum(np.square(apart))) for apart in (there, back))


def _sensitivity(candidate: Candidate, found: ImportanceSample) -> dict[str, float]:
    """Change of the log evidence when the priors of the causes' parameters are half and twice as wide.

    Nothing where all of them are uniform: what is possible is not what is thought plausible.
    """
    problem = candidate.problem
    names = {p.name for t in candidate.terms for p in t.parameters}
    changes = {}
    for word, factor in (("half", 0.5), ("twice", 2.0)):
        shifts = []
        for i, p in enumerate(problem.parameters):
            if p.name in names and (other := broadened(p.prior, factor)):
                ends = p.sampling_bounds.lower * p.scale, p.sampling_bounds.upper * p.scale
                x = found.draws[:, i] * p.scale
                shifts.append(other.log_density(x, *ends) - p.prior.log_density(x, *ends))
        if shifts:
            changes[word] = found.mean_of(np.sum(shifts, axis=0))
    return changes


def screening_of(
    screened: Sequence[Screened], given_best: Sequence[Screened], model_set: ModelSet, verdict: Verdict, seed: int
) -> list[ScreeningResult]:
    """Every cause: what it gains, and what is made of it.

    What could have been seen is asked given the model that is adopted: a baseline that fails has a large scatter.
    """
    visible = {s.term.id: s.visible for s in given_best}
    adopted, found = () if verdict.verdict == "adequate" else model_set.best_model.ids, []
    bounds = verdict.verdict != "unexplained"  # a model that is wrong bounds nothing
    problem = model_set.baseline.problem
    without = idle([s.term for s in screened], problem.experiment.select(problem.group_ids))
    for s in screened:
        s = replace(s, visible=visible.get(s.term.id, s.visible))
        acts = s.term.id not in without
        asked = acts and bounds and s.term.id not in adopted
        left = room(model_set, adopted, s.term, seed=seed) if asked else None
        found.append(
            ScreeningResult(
                s.term.id,
                word_for(s, model_set, verdict, left) if acts else NO_ACTION,
                float(s.gain[s.best]), model_set.gain((s.term.id,)), s.chance, s.log_bayes,
                float(s.strength[s.best]), s.term.strength.unit, s.visible, verdict.inclusion.get(s.term.id, 0.0),
                plausible(s.term)[0],
                None if left is None else left.share,
                None if left is None else left.size,
                None if left is None else condition_of(model_set.baseline.problem, left.row),
            )
        )  # fmt: skip
    return sorted(found, key=lambda s: -s.refit_gain)


def word_for(found: Screened, model_set: ModelSet, verdict: Verdict, left: Room | None) -> ScreeningWord:
    """What the whole model set says of one cause; the refit knows better than the expansion what it can do.

    Not present is what would have been seen, and has less `left` to it than what would be; a verdict that explains
    nothing says it of no cause.
    """
    if found.term.id in verdict.named and verdict.inclusion.get(found.term.id, 0.0) > 0.5:
        return "present" if verdict.verdict != "unexplained" else NEAREST
    if any(found.term.id in ids for ids in verdict.alternatives):
        return "as good" if verdict.verdict != "unexplained" else NEXT_BEST
    if model_set.gain((found.term.id,)) >= max(PRESENT, found.chance):
        return "explains part alone"
    if found.visible < VISIBLE:
        return UNSEEN
    return NOT_PRESENT if left is not None and left.size < VISIBLE else NOT_EXCLUDED


def _tests(misfit: Misfit, candidate: Candidate, where: list[Where] | None = None) -> Tests:
    return Tests(
        p_value=misfit.p_value,
        character=misfit.character,
        furthest=_furthest(misfit, candidate),
        odd_groups=list(misfit.odd_groups),
        odd_points=list(misfit.odd_points),
        coincidences=list(misfit.coincidences),
        statistics=list(misfit.statistics),
        n_simulated=misfit.n_simulated,
        refit=misfit.refit,
        usual_tails=misfit.usual_tails,
        where=where,
        floor=1 / (misfit.n_simulated + 1),
    )


def _where(misfit: Misfit) -> list[Where]:
    """Where readings are missed: those of several groups that stand out together, then stretches of sweeps."""
    unit = {"frequency": "Hz", "amplitude": "V", "time": "us"}
    found = []

    def place(group: GroupId, p: Coincidence | Place, together: list[GroupId]) -> None:
        ends = dict.fromkeys((f"{p.lower:.6g}", f"{p.upper:.6g}"))
        side = "too large" if p.log_bias > 0 else "too small"
        elsewhere = f"the prediction is {side}, as there in group {', '.join(map(str, together))}," if together else ""
        what = elsewhere or f"predictions {side}"
        text = f"group {group}, {' to '.join(ends)} {unit[p.variable]}{aside(p.observable)}: {what} by a factor of"
        text += f" {np.exp(abs(p.log_bias)):.2f} ({abs(p.score):.1f} standard deviations)"
        found.append(Where(group, p.variable, p.lower, p.upper, text, p.log_bias, p.score, together, p.observable))

    for c in misfit.coincidences:
        groups = [group for group, _ in c.readings]
        for group in groups:
            place(group, c, [g for g in groups if g != group])
    for p in misfit.places:
        place(p.group, p, [])
    return found


def condition_of(problem: Problem, row: int) -> Condition:
    """Where a row of the design was read."""
    design, (group, number) = problem.design, numbered(problem, row)
    time = float(design.time[row])
    when = None if math.isnan(time) else 1e6 * time
    return Condition(group, number, float(design.frequency[row]), float(design.amplitude[row]), time_us=when)


def _furthest(misfit: Misfit, candidate: Candidate, most: int = 3) -> list[Reading]:
    """The readings furthest from a model, `most` of them, whatever the tests say of them."""
    design, observed = candidate.problem.design, candidate.problem.observed
    time = np.nan_to_num(design.time, nan=-1.0)
    conditions = np.column_stack([design.group, design.measured, design.frequency, design.amplitude, time])
    return [
        Reading(
            **vars(condition_of(candidate.problem, int(k))), reading=float(observed[k]),
            predicted=float(candidate.predicted[k]), score=float(misfit.scores[k]),
            observable=recorded_name(OBSERVABLES[int(design.measured[k])]),
            repeats=observed[same[same != k]].tolist() or None,
        )
        for k in np.argsort(-np.abs(misfit.scores), kind="stable")[:most]
        for same in [np.flatnonzero((conditions == conditions[k]).all(axis=1))]
    ]  # fmt: skip


def misfit_of(
    before: Misfit,
    after: Misfit | None,
    left: Discrepancy,
    baseline: Candidate,
    best_model: Candidate,
    *,
    firm: Robustness | None = None,
) -> MisfitResult:
    """Return what the tests say of baseline and best model, and what a smooth curve finds given the best model."""
    first = int(best_model.problem.design.measured.min())
    return MisfitResult(
        p_value=before.p_value,
        where=_where(before),
        baseline=_tests(before, baseline),
        extended=None if after is None else _tests(after, best_model, _where(after)),
        leftover=DiscrepancyResult(
            left.log_bayes, left.amplitude, left.level, left.reach, left.sigma_rel[first],
            [GroupDiscrepancy(g, _finite(m), _finite(x), read) for g, read, m, x in left.largest(best_model)],
            left.mean.tolist(),
            [_finite(s) for s in left.sd],
        ),
        sessions=show.offsets(best_model),
        robustness=firm,
    )  # fmt: skip


def _finite(x: float) -> float | None:
    """A number that JSON has; None for what is not known."""
    return float(x) if np.isfinite(x) else None


def shown(model_set: ModelSet, most: int = 8) -> dict[str, ModelShown]:
    """What is drawn of baseline and extension: growth, corners and drift, `most` drifts of each."""
    models = {"baseline": model_set.baseline} | (
        {"extended": model_set.best_model} if model_set.best_model.terms else {}
    )
    drifts = {name: show.drift(c) for name, c in models.items()}
    # What stands out in either is reported of both.
    striking = {(d.parameter, d.variable) for found in drifts.values() for d in found[:most]}
    return {
        name: ModelShown(
            growth=show.growth(c),
            corners=show.corners(c),
            drift=[d for d in drifts[name] if (d.parameter, d.variable) in striking],
            lines=show.lines(c),
            predicted=c.predicted.tolist(),
            without={
                id: ranges.tolist() for id, ranges in without_each(c.problem, c.modes[:1], c.problem.group_ids).items()
            },
            parameters=dict(zip(c.problem.names, c.values.tolist(), strict=True)),
        )
        for name, c in models.items()
    }

"""What a search has found, as the record tells it: models, tests, screening, and the answer in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from psafit.diagnose import gain as gains
from psafit.diagnose import next_experiment, show
from psafit.diagnose.leftover import Leftover
from psafit.diagnose.misfit import CHARACTERS, Coincidence, Misfit, Place, numbered
from psafit.diagnose.record import (
    NEAREST,
    UNSEEN,
    CauseResult,
    ScreeningResult,
)
from psafit.diagnose.robustness import Robustness
from psafit.diagnose.room import room
from psafit.diagnose.screening import PRESENT, VISIBLE, Screened
from psafit.diagnose.significance import OTHERWISE
from psafit.diagnose.verdict import Verdict
from psafit.experiment import GroupId
from psafit.inference import noise
from psafit.inference.candidate import Candidate
from psafit.inference.evidence import Weighed
from psafit.model_search.ladder import Ladder
from psafit.parameters import broadened
from psafit.simulate.sensitivity import plausible
from psafit.text import fixed, significant
from psafit.validate import without_each

# Drifts of a model that are told.
_DRIFTS = 8
# Models in the result; the rest of the ladder has less than this share.
_SHOWN, _LEAST = 12, 1e-4
# Readings that are told as the furthest from a model.
_FURTHEST = 3


def causes_of(ladder: Ladder, verdict: Verdict) -> list[CauseResult]:
    """The models of the record, the most probable first; leader, alternatives and baseline in any case."""
    shown = [c for c in ladder.candidates if ladder.probability[c.ids] >= _LEAST][:_SHOWN]
    tied = [c for c in ladder.candidates if c.ids in verdict.alternatives]
    for always in (ladder.leader, ladder.baseline, *tied):
        if always not in shown:
            shown.append(always)
    # What the verdict names comes first.
    shown.sort(key=lambda c: (set(c.ids) != set(verdict.named), -ladder.probability[c.ids]))
    return [_cause(ladder, verdict, c) for c in shown]


def _cause(ladder: Ladder, verdict: Verdict, candidate: Candidate) -> CauseResult:
    problem = candidate.problem
    found = ladder.weighed.get(candidate.ids)
    parameters: dict[str, dict[str, Any]] = {}
    implausible = []
    values = problem.to_physical(found.draws) if found else problem.to_physical(candidate.modes[:1])
    quantiles = found.quantiles(values, (0.05, 0.5, 0.95)) if found else None
    for i, p in enumerate(problem.parameters):
        ends: list[float | None] = [None, None]  # of a model that was not sampled
        median = float(values[0, i])
        if quantiles is not None:
            lower, median, upper = (float(q) for q in quantiles[:, i])
            ends = [lower, upper]
        parameters[p.name] = {
            "median": median, "lower": ends[0], "upper": ends[1], "unit": p.unit, "description": p.description,
            "prior_share": p.prior_share(median),
        }  # fmt: skip
        # The scatter, too: one far above its prior hides a misfit.
        if (i < problem.n_physical or i >= problem.n_model) and p.is_implausible(median):
            implausible.append(p.name)
    evidence: dict[str, Any] = {
        "log_evidence": ladder.log_evidence[candidate.ids],
        "over_baseline": ladder.log_evidence[candidate.ids] - ladder.log_evidence[()],
        "gain": ladder.gain(candidate.ids),
        "share": ladder.probability[candidate.ids],
        # Laplace's evidence is corrected by what sampling showed it to be off by in the model next to it.
        "method": "adaptive importance sampling" if found else "Laplace",
    }
    if found:
        evidence |= {"error": found.doubt, "effective_draws": found.effective, "pareto_k": found.pareto_k}
        evidence["prior_width"] = _sensitivity(candidate, found)
    ids = verdict.named if set(candidate.ids) == set(verdict.named) else candidate.ids
    return CauseResult(list(ids), verdict.probability[candidate.ids], parameters, evidence, implausible)


def _sensitivity(candidate: Candidate, found: Weighed) -> dict[str, float]:
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
    screened: Sequence[Screened], beside: Sequence[Screened], ladder: Ladder, verdict: Verdict, seed: int
) -> list[ScreeningResult]:
    """Every cause: what it gains, and what is made of it.

    What could have been seen is asked `beside` the model that is adopted: a baseline that fails has a large scatter.
    """
    visible = {s.term.id: s.visible for s in beside}
    adopted, found = () if verdict.verdict == "adequate" else ladder.leader.ids, []
    for s in screened:
        s = replace(s, visible=visible.get(s.term.id, s.visible))
        found.append(
            ScreeningResult(
                s.term.id,
                _word(s, ladder, verdict),
                float(s.gain[s.best]), ladder.gain((s.term.id,)), s.chance, s.log_bayes,
                float(s.strength[s.best]), s.term.strength.unit, s.visible, verdict.inclusion.get(s.term.id, 0.0),
                plausible(s.term)[0],
                None if s.term.id in adopted else room(ladder, adopted, s.term, seed=seed),
            )
        )  # fmt: skip
    return sorted(found, key=lambda s: -s.refit_gain)


def _word(found: Screened, ladder: Ladder, verdict: Verdict) -> str:
    """What the whole ladder says of one cause; the refit knows better than the expansion what it can do."""
    if verdict.named and verdict.inclusion.get(found.term.id, 0.0) > 0.5:
        return "present" if verdict.verdict != "unexplained" else NEAREST
    if any(found.term.id in ids for ids in verdict.alternatives):
        return "as good"
    if ladder.gain((found.term.id,)) >= max(PRESENT, found.chance):
        return "explains part alone"
    return "not present" if found.visible >= VISIBLE else UNSEEN


def _tests(misfit: Misfit, candidate: Candidate) -> dict[str, Any]:
    return {
        "furthest": _furthest(misfit, candidate),
        "p_value": misfit.p_value,
        "character": misfit.character,
        "odd_groups": list(misfit.odd_groups),
        "odd_points": [[g, k] for g, k in misfit.odd_points],
        "coincidences": [asdict(c) for c in misfit.coincidences],
        "statistics": [asdict(s) for s in misfit.statistics],
        "n_simulated": misfit.n_simulated,
        "refit": misfit.refit,
    }


def _where(misfit: Misfit) -> list[dict[str, Any]]:
    """Where readings are missed: those of several groups that stand out together, then stretches of sweeps."""
    unit = {"frequency": "Hz", "amplitude": "V"}
    found: list[dict[str, Any]] = []

    def place(group: GroupId, p: Coincidence | Place, told: str) -> None:
        ends = dict.fromkeys((f"{p.lower:.6g}", f"{p.upper:.6g}"))
        text = f"group {group}, {' to '.join(ends)} {unit[p.variable]}: {told} by a factor of"
        text += f" {np.exp(abs(p.log_bias)):.2f} ({abs(p.score):.1f} standard deviations)"
        found.append({"group": group, "variable": p.variable, "from": p.lower, "to": p.upper, "text": text})

    for c in misfit.coincidences:
        groups = [group for group, _ in c.readings]
        for group in groups:
            others = ", ".join(str(g) for g in groups if g != group)
            place(group, c, f"the prediction is {_side(c.log_bias)}, as there in group {others},")
    for p in misfit.places:
        place(p.group, p, f"predictions {_side(p.log_bias)}")
    return found


def _side(log_bias: float) -> str:
    return "too large" if log_bias > 0 else "too small"


def _furthest(misfit: Misfit, candidate: Candidate) -> list[dict[str, Any]]:
    """The readings furthest from a model, whatever the tests say of them."""
    design, observed = candidate.problem.design, candidate.problem.observed
    found = []
    for k in np.argsort(-np.abs(misfit.scores), kind="stable")[:_FURTHEST]:
        group, number = numbered(candidate.problem, int(k))
        found.append(
            {
                "group": group,
                "number": number,
                "frequency_hz": float(design.frequency[k]),
                "amplitude_v": float(design.amplitude[k]),
                "reading_um": float(observed[k]),
                "predicted_um": float(candidate.predicted[k]),
                "score": float(misfit.scores[k]),
            }
        )
    return found


def misfit_of(
    before: Misfit, after: Misfit | None, left: Leftover, baseline: Candidate, leader: Candidate
) -> dict[str, Any]:
    """The tests of baseline and extension, and what a smooth curve finds."""
    result: dict[str, Any] = {"p_value": before.p_value, "where": _where(before), "baseline": _tests(before, baseline)}
    if after is not None:
        result["extended"] = _tests(after, leader) | {"where": _where(after)}
    result["leftover"] = {
        "log_bayes": left.log_bayes,
        "amplitude": left.amplitude,
        "level": left.level,
        "reach": left.reach,
        "sigma_rel": left.sigma_rel,
        "groups": [{"group": g, "mean": _finite(m), "largest": _finite(x)} for g, m, x in left.largest(leader)],
        "mean": left.mean.tolist(),
        "sd": [_finite(s) for s in left.sd],
    }
    return result


def _finite(x: float) -> float | None:
    """A number that JSON has; None for what is not known."""
    return float(x) if np.isfinite(x) else None


def shown(ladder: Ladder) -> dict[str, Any]:
    """What is drawn of baseline and extension: growth, corners and drift."""
    models = {"baseline": ladder.baseline} | ({"extended": ladder.leader} if ladder.leader.terms else {})
    drifts = {name: show.drift(c) for name, c in models.items()}
    # What stands out in either is told of both.
    told = {(d.parameter, d.variable) for found in drifts.values() for d in found[:_DRIFTS]}
    return {
        name: {
            "growth": [asdict(g) for g in show.growth(c)],
            "corners": [asdict(corner) for corner in show.corners(c)],
            "drift": [asdict(d) for d in drifts[name] if (d.parameter, d.variable) in told],
            "lines": [asdict(line) for line in show.lines(c)],
            "predicted_um": c.predicted.tolist(),
            "without_um": {
                id: ranges.tolist() for id, ranges in without_each(c.problem, c.modes[:1], c.problem.group_ids).items()
            },
            "parameters": dict(zip(c.problem.names, c.values.tolist(), strict=True)),
        }
        for name, c in models.items()
    }


def words_of(ids: Sequence[str]) -> str:
    """A set of causes in words."""
    return " + ".join(ids) if ids else "the baseline"


def furthest(ladder: Ladder, verdict: Verdict, misfit: Mapping[str, Any]) -> str:
    """The readings furthest from what is adopted, and whether heavy tails take them up."""
    adopted = () if verdict.verdict == "adequate" else ladder.leader.ids
    far = [
        f"group {r['group']}, {r['frequency_hz']:.6g} Hz, {r['amplitude_v']:.4g} V"
        f" (reads {significant(r['reading_um'], 3)} um for {significant(r['predicted_um'], 3)})"
        for r in misfit["extended" if adopted else "baseline"]["furthest"]
    ]
    text = f"Furthest from {words_of(adopted)}: {'; '.join(far)}."
    found, tails = ladder.weighed.get(adopted), noise.PARAMETERS[-1]
    if found is None:
        return text
    low, high = tails.to_physical(found.quantiles(found.draws[:, -1], (0.05, 0.95)))
    if high >= tails.to_physical(tails.prior_quantile(np.array(0.5))):
        return text
    return f"{text} The scatter has heavy tails (nu {low:.2g} to {high:.2g}, 90 %): such readings count little."


def sentences(
    verdict: Verdict,
    before: Misfit,
    ladder: Ladder,
    firm: Robustness | None,
    screening: Sequence[ScreeningResult],
    measured: Mapping[str, Any],
    proposal: Mapping[str, Any],
    search: Mapping[str, Any] | None,
    quick: bool = False,
    *,
    furthest: str = "",
) -> list[str]:
    """The answer in words."""
    result = list(verdict.reasons)
    if before.wrong and before.character != "none":
        which = {
            "group": f": {', '.join(str(g) for g in before.odd_groups)}",
            "points": f": {len(before.odd_points)} of them",
        }
        what = CHARACTERS[before.character] + which.get(before.character, "")
        result.append(f"Of the baseline: {what}.")
    if verdict.alternatives:
        others = "; ".join(words_of(ids) for ids in verdict.alternatives[:6])
        result.append(f"Not to be told apart from {words_of(verdict.named)}: {others}.")
    if firm and verdict.named:
        if firm.of_one_group:
            gain, most = ladder.gain(ladder.leader.ids), max(g for _, g in firm.groups)
            without = "–" if firm.without is None else fixed(firm.without)
            result.append(
                f"Of their gain of {fixed(gain)} nats group {firm.strongest} gives {fixed(most)};"
                f" without it they gain {without}."
            )
        if firm.over_smooth < 0:
            result.append(
                f"A smooth discrepancy without a name, in the place of these causes, has"
                f" {fixed(-firm.over_smooth)} nats more evidence than they."
            )
    if search:
        result.append(_chance(search))
    if furthest:
        result.append(furthest)
    if unseen := [s.id for s in screening if s.verdict == UNSEEN]:
        result.append(
            f"Of {len(screening)} candidate causes, {len(unseen)} could not have been seen in these readings:"
            f" {', '.join(unseen)}."
        )
    if left := {s.id: s.room for s in screening if s.room is not None}:
        widest = max(left, key=lambda id: left[id])
        result.append(
            f"What is not named may change a launch range by {significant(left[widest], 2, per_cent=True)} % at most"
            f" and stay unseen ({widest}; 95 %)."
        )
    if not (measured or quick):
        result.append("No gain on data unseen: there is no group that could be held out.")
    for protocol, one in measured.items():
        if gains.names_nothing(one):
            result.append(
                f"Gain on data unseen ({protocol}): none; the groups that were seen name no cause by themselves."
            )
            continue
        change = " to ".join(fixed(x, 3, sign=True) for x in one["log_rmse_interval"])
        result.append(
            f"Gain on data unseen ({protocol}): mean log_rmse {one['log_rmse_before']:.3f} before,"
            f" {one['log_rmse_after']:.3f} after (change {change}, 90 %)."
        )
        if worse := gains.worse(one):
            told = ", ".join(f"{g['group']} ({g['log_rmse_before']:.3f} to {g['log_rmse_after']:.3f})" for g in worse)
            result.append(f"Predicted worse than by the baseline ({protocol}): group {told}.")
    if best := next_experiment.recommended(proposal):
        more = quick and len(verdict.alternatives) > 1
        result.append(
            f"Next, measure {best['text']}: it best {proposal['about']}."
            + (" The other sets are not looked at: without --quick the four likeliest are." if more else "")
        )
    elif next_experiment.tells_apart(proposal):
        told = proposal["proposals"][0]
        result.append(
            f"No sweep that the rig allows {proposal['about']}:"
            f" the best, {told['text']}, by {fixed(told['separation'], 1)} nats."
        )
    elif proposal.get("proposals"):
        result.append(
            f"No sweep that the rig allows would tell much more: {proposal['proposals'][0]['text']}"
            f" {next_experiment.promise(proposal, 0)}."
        )
    return result


def _chance(search: Mapping[str, Any]) -> str:
    """How often a search finds as much where nothing is hidden; `psafit.diagnose.significance.Significance`."""
    if search["p_value"] is None:
        return (
            "How often a search finds as much where nothing is hidden is not known: the stored table is of"
            f" {OTHERWISE[search['missing']]} (--searches 19 repeats the search on simulated baselines)."
        )
    n, most = len(search["null"]), max(search["null"])
    none = f"none led by more than {fixed(most)} nats" if most > 0 else "none put a model with causes first"
    p = f"p {'<=' if search['p_value'] <= 1 / (n + 1) else '='} {significant(search['p_value'], 2)}"
    where = "simulated baselines"
    if search["stored"]:
        least, most_readings = search["readings"]
        where = f"designs of {least} to {most_readings} readings with nothing hidden (stored table, this catalogue)"
    return f"Of {n} searches on {where} {none}; this one leads by {fixed(search['lead'])} ({p})."

"""The tables of a diagnosis' page, as rows of cells, section by section."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from scipy.stats import norm

from psafit.compare import known
from psafit.diagnose.answer import purpose_text
from psafit.diagnose.confusable import Confounded
from psafit.diagnose.gain import Choice, Gain
from psafit.diagnose.misfit import ALPHA, CHARACTERS
from psafit.diagnose.next_experiment import NextExperiment, Pair, Proposal, Rehearsal
from psafit.diagnose.record import (
    NEAREST,
    NOT_EXCLUDED,
    UNSEEN,
    CauseResult,
    Diagnosis,
    Evidence,
    ScreeningResult,
    Tests,
    Where,
)
from psafit.diagnose.show import Corner, Offset
from psafit.diagnose.significance import OTHERWISE, Significance
from psafit.diagnose.trials import Calibration, Rate
from psafit.experiment import CONSTANT_UNITS, Experiment
from psafit.inference.evidence import TRUSTED
from psafit.model_search.model_set import set_of
from psafit.observables import OBSERVABLES
from psafit.report import diagnosis_pictures, figures
from psafit.report import diagnosis_words as words
from psafit.report.catalogue import cause, declared, model, parameter
from psafit.report.diagnosis_answer import PAGE
from psafit.report.diagnosis_pictures import Shown
from psafit.report.figures.axes import shown_unit
from psafit.report.figures.sweep import SWEPT, UNITS
from psafit.report.page import Picture, first
from psafit.report.wording import (
    NBSP,
    count,
    exact,
    factor,
    interval,
    listed,
    noted,
    number,
    p_value,
    percent,
    symbol_html,
    typeset,
    with_unit,
)
from psafit.text import fixed, significant

_COVARIATES: Final = {**SWEPT, "range": "predicted reading", "order": "order in each session"}
_SCREENED: Final = {
    "present": "bad",
    NEAREST: "warn",
    "as good": "bad",
    "explains part alone": "warn",
    "not present": "good",
    NOT_EXCLUDED: "warn",
    UNSEEN: "warn",
}
_LOOKS_AT: Final = {
    "mean": "the physics",
    "spread": "the law of the scatter",
    "point": "single readings",
    "replicate": "sessions at the same condition",
    "all": "anything",
}
_PROTOCOLS: Final = {
    "strict": "Causes and parameters chosen on the training groups alone, every other group scored.",
    "nested": "For each group, causes and parameters chosen on all the others, then that group scored.",
}


# What is wrong --------------------------------------------------------------------------------------------------


def where(places: Sequence[Where]) -> list[Markup]:
    """Stretches of sweeps in which a model errs to one side."""
    return [_place(w) for w in places]


def _place(w: Where) -> Markup:
    side = "too large" if w.log_bias > 0 else "too small"
    others = Markup("the prediction is {}, as there in {},").format(side, words.group_ids(w.together))
    return Markup("<strong>Group {}</strong>: {}: {} by a factor of {} ({:.1f} standard deviations)").format(
        w.group, words.span([w.start, w.to], shown_unit(UNITS[w.variable])),
        others if w.together else f"predictions {side}", factor(abs(w.log_bias)), abs(w.score),
    )  # fmt: skip


def growth(result: Diagnosis, experiment: Experiment) -> list[Picture]:
    """Pictures of local exponents."""
    before = first(result.show["baseline"].growth)
    after = result.show["extended"].growth if "extended" in result.show else []
    conditions = {str(g.id): figures.sweep_of(g).condition for g in experiment.groups}
    zeros = {str(g.id): int(np.count_nonzero(g.reading == 0)) for g in experiment.groups}
    return diagnosis_pictures.growth_pictures(before, after, conditions, zeros)


def without_growth(result: Diagnosis) -> Markup | None:
    """Groups of which no local exponent can be known."""
    none = [g.group for g in result.show["baseline"].growth if not g.at]
    return words.group_ids(none) if none else None


def scatter(result: Diagnosis, much: float = 0.9) -> str | None:
    """The relative scatter of the fitted baseline, where this share of its prior or more lies below it."""
    p = next((c.parameters.get("sigma_rel") for c in result.causes if not c.terms), None)
    return percent(p.median) if p and p.prior_share > much else None


def drift_rows(result: Diagnosis, most: int = 8) -> list[list[Any]]:
    """What letting one parameter drift would gain, `most` rows."""
    extended = result.show.get("extended")
    rest = {(d.parameter, d.variable): d.gain for d in (extended.drift if extended else [])}
    rows = []
    for d in result.show["baseline"].drift[:most]:
        p = declared(d.parameter)
        row = [
            parameter(d.parameter, p.description if p else ""),
            _COVARIATES.get(d.variable, d.variable),
            f"{words.nats(d.gain)} nats",
            _change(d.factor),
        ]
        if extended:
            left = rest.get((d.parameter, d.variable))
            row.append("–" if left is None else f"{words.nats(left)} nats")
        rows.append(row)
    return rows


def corner_rows(result: Diagnosis) -> list[list[Any]]:
    """Where growth changes: readings as the better model weighs them, baseline, and extension if there is one."""
    models = [
        {str(c.group): c for c in result.show[name].corners} for name in ("baseline", "extended") if name in result.show
    ]

    def cells(c: Corner | None, *, measured: bool) -> list[str]:
        at = None if c is None else c.measured if measured else c.simulated
        exponents = None if c is None else c.exponents if measured else c.simulated_exponents
        if c is None or at is None or exponents is None:
            return ["one line", "–"]
        text = number(at)
        if measured and c.lower is not None and c.upper is not None:
            text = f"{number(at, c.upper - c.lower)} ({interval(c.lower, c.upper)})"
        below, above = (fixed(x, 2).replace("-", "\N{MINUS SIGN}") for x in exponents)
        return [with_unit(text, "Hz" if c.variable == "frequency" else "V"), f"{below} → {above}"]

    rows = []
    for group in dict.fromkeys(id for of_model in models for id in of_model):
        found = [of_model.get(group) for of_model in models]
        measured = next((c for c in reversed(found) if c and c.measured is not None), None)
        row = [group, *cells(measured, measured=True)]
        for c in found:
            row += cells(c, measured=False)
        rows.append(row)
    return rows


def session_rows(sessions: Sequence[Offset]) -> list[list[Any]]:
    """How two sessions differ where both have readings."""
    rows = []
    for s in sessions:
        middle, low, high = s.factor, s.lower, s.upper
        # Of many pairs some lie outside their 90 % interval: half of a 99 % one by the width of that.
        apart = abs(math.log(middle)) > norm.ppf(0.995) / (2 * norm.ppf(0.95)) * math.log(high / low)
        badge = {"text": "differ", "kind": "warn"} if apart else {"text": "agree", "kind": "good"}
        where = count(s.n_conditions, "condition")
        rows.append([f"{s.second} over {s.first}", where, f"×{middle:.2f}", f"×{low:.2f} to ×{high:.2f}", badge])
    return rows


def _change(value: float) -> str:
    """A factor of drift; the search for it ends at e to the power of nine."""
    if not value > 0:
        return "–"
    if abs(math.log(value)) > 8.9:
        return f"more than ×{exact(8000)}" if value > 1 else f"less than ×{exact(1 / 8000)}"
    return f"×{number(value)}"


# Causes ---------------------------------------------------------------------------------------------------------


def model_rows(result: Diagnosis) -> list[list[Any]]:
    """The models of the record, and what is left for others."""
    rows: list[list[Any]] = []
    for c in result.causes:
        e = c.evidence
        over = words.signed(e.over_baseline)
        if e.error is not None:
            over += f" ± {e.error:.2f}"
        strange: Any = "none"
        if c.implausible:
            strange = {"text": f"{count(len(c.implausible), 'value')} implausible", "kind": "bad"}
        width = e.prior_width or {}
        rows.append(
            [
                model(c.terms),
                f"{words.share(c.probability)} ({words.share(e.share)})",
                words.signed(e.gain),
                over,
                f"{words.signed(width['half'])} / {words.signed(width['twice'])}" if width and c.terms else "–",
                strange,
                _method(e),
            ]
        )
    if rows:
        listed_ones = sum(known(c.probability) for c in result.causes)
        others = max(1 - listed_ones - known(result.unnamed), 0.0)
        for name, share in (("all other sets of causes", others), ("a discrepancy without a name", result.unnamed)):
            rows.append([Markup("<em>{}</em>").format(name), words.share(share), *["–"] * 5])
    return rows


def _method(evidence: Evidence) -> str:
    text = "Laplace" if evidence.method == "Laplace" else "importance sampling"
    if evidence.effective_draws is not None:
        text += f": {evidence.effective_draws:.0f} draws"
    if evidence.nautilus:
        text += f"; by nautilus {words.signed(evidence.nautilus.log_evidence - evidence.log_evidence)}"
    if (k := evidence.pareto_k) is not None:
        text += typeset(f", k {fixed(k, 2)}") + (" (the error is a guess)" if k > TRUSTED else "")
    return text


def parameter_rows(cause: CauseResult) -> list[list[Any]]:
    """A model's parameters."""
    rows: list[list[Any]] = []
    for name, p in cause.parameters.items():
        unit, (median, low, high) = words.estimate(p)
        spread = (high - low) / 2
        share = p.prior_share
        rows.append(
            [
                parameter(name, p.description),
                with_unit(number(median, spread if spread > 0 else None), unit),
                with_unit(interval(low, high, spread), unit) if high > low else "not sampled",
                _at_prior(share),
                {"text": "implausible", "kind": "bad"}
                if name in cause.implausible
                else "plausible"
                if math.isfinite(share)
                else "–",
            ]
        )
    return rows


def robustness(result: Diagnosis, best_model: CauseResult | None) -> dict[str, Any] | None:
    """Whose the best model's gain is; None where there is none."""
    found = result.misfit.robustness
    if found is None or best_model is None or not best_model.terms:
        return None
    return {
        "strongest": "" if found.strongest is None else str(found.strongest),
        "without": words.nats(found.without),
        "over_smooth": words.nats(abs(found.over_smooth)),
        "less": found.over_smooth >= 0,
        "rows": [[str(group), words.nats(gain)] for group, gain in found.groups],
    }


def _at_prior(share: float) -> str:
    if not math.isfinite(share):
        return "–"
    if share <= 0.0006:
        return f"under 0.1{NBSP}%"
    return f"over 99.9{NBSP}%" if share >= 0.9994 else f"{fixed(share, 1, per_cent=True)}{NBSP}%"


def screening_rows(screening: Sequence[ScreeningResult]) -> list[list[Any]]:
    """What each cause gains, alone and with others."""
    return [
        [
            cause(s.id),
            {"text": s.verdict, "kind": _SCREENED.get(s.verdict, "")},
            words.nats(s.refit_gain),
            words.nats(s.gain),
            words.nats(s.chance),
            words.signed(s.log_bayes),
            words.quantity(known(s.strength), s.unit),
            noted(number(known(s.visible)), f"at {words.quantity(s.plausible, s.unit)}")
            if math.isfinite(s.plausible)
            else number(known(s.visible)),
            "–" if s.left is None else number(s.left),
            "–" if s.room is None else f"{significant(s.room, 2, per_cent=True)}{NBSP}%",
            "–" if s.verdict == UNSEEN else words.share(s.inclusion),
        ]
        for s in screening
    ]


def alternatives(result: Diagnosis, most: int = 12) -> dict[str, Any]:
    """Sets that do as well as the named one, `most` of them."""
    listed_ones = {tuple(c.terms): c for c in result.causes}
    rows = []
    for ids in result.alternatives[:most]:
        c = listed_ones.get(tuple(ids))
        rows.append(
            [
                model(ids),
                words.share(c.probability) if c else "–",
                words.signed(c.evidence.over_baseline) if c else "–",
                words.signed(c.evidence.gain) if c else "–",
                ("sampled" if c.sampled else "estimated from a short fit") if c else "–",
            ]
        )
    return {
        "named": model(result.named) if result.named else None,
        "rows": rows,
        "more": max(0, len(result.alternatives) - most),
    }


# What remains ---------------------------------------------------------------------------------------------------


def tests(tests: Tests, most: int = 10) -> dict[str, Any]:
    """What the tests of one model found, `most` of them, the most striking first."""
    odd = [Markup("reading {} of group {}").format(k + 1, g) for g, k in tests.odd_points]
    return {
        "p": words.p_text(tests.p_value),
        "wrong": tests.p_value < ALPHA,
        "character": CHARACTERS[tests.character],
        "n_simulated": tests.n_simulated,
        "refit": "refitted with the model itself" if tests.refit == "exact" else "refitted with its expansion",
        "odd_groups": words.group_ids(tests.odd_groups) if tests.odd_groups else None,
        "odd_points": listed(odd) if odd else None,
        "n_statistics": len(tests.statistics),
        "rows": [
            [
                s.name,
                "all" if s.group is None else Markup("group {}").format(s.group),
                _LOOKS_AT.get(s.kind, s.kind),
                typeset(fixed(s.excess, 2)),
                p_value(s.p_value),
                {"text": "yes", "kind": "bad" if tests.p_value < ALPHA else "warn"} if s.significant else "no",
            ]
            for s in tests.statistics[:most]
        ],
    }


def discrepancy(result: Diagnosis, shown: Sequence[Shown]) -> dict[str, Any]:
    """What a smooth curve finds given the causes, with its pictures."""
    left = result.misfit.leftover
    mean, sd = np.array(left.mean), np.array([known(x) for x in left.sd])
    whole = mean.size == sd.size == sum(g.group.n_points for g in shown)
    return {
        "log_bayes": words.signed(left.log_bayes),
        "present": left.log_bayes > 0,
        "amplitude": percent(left.amplitude),
        "level": percent(left.level),
        "reach": factor(left.reach),
        "sigma_rel": f"{fixed(left.sigma_rel, 1, per_cent=True)}{NBSP}%",
        "rows": [
            [
                Markup("Group {}").format(g.group),
                *("–" if x is None else f"×{factor(x)}" for x in (g.mean, g.largest)),
            ]
            for g in left.groups
        ],
        "pictures": diagnosis_pictures.discrepancy_pictures(first(shown), mean, sd) if whole else [],
    }


# Gain -----------------------------------------------------------------------------------------------------------


def gain(gain: Gain) -> dict[str, Any]:
    """One protocol's gain, group by group."""
    change, elpd, before, after = gain.log_rmse_interval, gain.elpd_interval, gain.log_rmse_before, gain.log_rmse_after
    return {
        "name": gain.protocol,
        "text": _PROTOCOLS[gain.protocol],
        "sentence": (
            f"Mean log RMSE {before:.3f} before, {after:.3f} after; change {typeset(fixed(change[0], 3, sign=True))} to"
            f" {typeset(fixed(change[1], 3, sign=True))} (90 % interval), that is a typical factor of"
            f" ×{factor(before)} before and ×{factor(after)} after. Log predictive density, summed over the unseen"
            f" readings: {words.nats(gain.elpd_before)} nats before, {words.nats(gain.elpd_after)} nats after;"
            f" change {words.signed(elpd[0])} to {words.signed(elpd[1])} nats (90 % interval). Inside their 90 %"
            f" predictive intervals: {words.share(gain.coverage_before)} of the readings before,"
            f" {words.share(gain.coverage_after)} after."
        ),
        "nothing": gain.names_nothing,
        "better": change[1] < 0,
        "worse": change[0] > 0,
        "rows": [
            [
                noted(f"Group {g.group}", f"{g.silent}; left out of the mean")
                if g.silent
                else noted(f"Group {g.group}", "worse than by the baseline")
                if g in gain.worse
                else f"Group {g.group}",
                words.group_ids(g.seen),
                model(g.named),
                f"{g.log_rmse_before:.3f} (×{factor(g.log_rmse_before)})",
                f"{g.log_rmse_after:.3f} (×{factor(g.log_rmse_after)})",
                " to ".join(typeset(fixed(x, 3, sign=True)) for x in g.log_rmse_interval),
                f"{words.signed(g.elpd_after - g.elpd_before)}"
                f" ({' to '.join(words.signed(x) for x in g.elpd_interval)})",
                f"{words.share(g.coverage_before)} / {words.share(g.coverage_after)}",
            ]
            for g in gain.groups
        ],
        "picture": diagnosis_pictures.gain_picture(gain),
        "predictions": gain.predictions,
    }


def ledger(ledger: Sequence[Choice]) -> list[list[Any]]:
    """Which data each choice saw."""
    rows: list[list[Any]] = []
    for entry in ledger:
        shares = sorted((entry.models or {}).items(), key=lambda item: -item[1])
        parts = (Markup("{} {}").format(model(set_of(name)), words.share(share)) for name, share in shares)
        averaged = listed(parts)
        rows.append([_choice(entry), words.group_ids(entry.saw), words.group_ids(entry.scored_on), averaged or "–"])
    return rows


def _choice(entry: Choice) -> Markup:
    """A choice; of a search that was repeated from nothing also what that has changed."""
    choice = Markup("{}").format(entry.choice)
    if entry.led_to is None or entry.begun_led_to is None:
        return choice
    anew, begun = model(entry.led_to), model(entry.begun_led_to)
    if set(entry.led_to) == set(entry.begun_led_to):
        return choice + Markup(": it leads to {}, too").format(anew)
    below = known(entry.log_posterior_below_begun)
    side = "higher" if below > 0 else "lower"
    return choice + Markup(": it leads to {}, the other to {}, whose log posterior is {} nats {}").format(
        anew, begun, number(abs(below)), side
    )


# Next experiment ------------------------------------------------------------------------------------------------


def proposals(found: NextExperiment) -> dict[str, Any] | None:
    """Measurements to make next, best first."""
    if not found.proposals:
        return None
    rows = []
    for p in found.proposals:
        changed = [
            Markup("{} = {}").format(symbol_html(name), with_unit(number(value), CONSTANT_UNITS.get(name, "1")))
            for name, value in p.constants.items()
        ]
        rows.append(
            [
                Markup("{}, {}{}").format(p.waveform, _readings(p), _read_as(p)),
                words.span(p.frequency_hz, "Hz"),
                words.span(p.amplitude_v, "V"),
                listed(changed) if changed else "as it is",
                words.lead(p) if found.separates else words.narrowing(p),
                words.share(p.success),
                _left_tied(p.pairs),
            ]
        )
    several = any(len(p.pairs) > 1 for p in found.proposals)
    if not several:
        rows = [row[: -1 if found.separates else -2] for row in rows]
    about = purpose_text(found.purpose, PAGE)
    return {"about": about, "separates": found.separates, "several": several, "rows": rows}


def _readings(proposal: Proposal) -> str:
    """How many they are, of launches or along a trace."""
    if proposal.time_us is None:
        return count(proposal.n_readings, "reading")
    return f"{count(proposal.n_readings, 'sample')} over {proposal.time_us[-1]:g} us"


def _read_as(proposal: Proposal) -> str:
    """Of which observable the readings are, where that is not what was read so far."""
    named = next((o for o in OBSERVABLES if o.name == proposal.observable), None)
    return f" of the {named.title}" if named else ""


def _left_tied(pairs: Sequence[Pair], hardly: float = 3.0) -> Markup | str:
    """The pairs of models that a measurement would hardly separate, by fewer nats than this."""
    tied = [
        Markup("{} and {}").format(model(pair.first), model(pair.second)) for pair in pairs if pair.separation < hardly
    ]
    return Markup("; ").join(tied) if tied else "none"


def search(found: Significance | None) -> dict[str, Any] | None:
    """How often a search finds as much where nothing is hidden."""
    if not found:
        return None
    p, n = found.p_value, len(found.null)
    if p is None:
        return {"n": 0, "missing": OTHERWISE[found.missing] if found.missing else ""}
    return {
        "n": n,
        "lead": words.nats(found.lead),
        "most": words.nats(max(found.null)),
        "p": f"{'≤' if p <= 1 / (n + 1) else '='} {significant(p, 2)}",
        "readings": " to ".join(str(m) for m in found.readings) if found.stored else "",
    }


def calibration(found: Calibration | None) -> dict[str, Any] | None:
    """How often such a verdict is right here: by what made the readings, and by the probability printed."""
    if not found:
        return None
    return {
        "n": found.exact.of,
        "truths": [
            [model(one.truth), str(one.exact.of), str(one.exact.n), str(one.reported.n)] for one in found.truths
        ],
        "reliability": [
            [f"{percent(r.lower)} to {percent(r.upper)}", str(r.right.of), percent(r.mean), _rate(r.right)]
            for r in found.reliability
        ],
        "exact": _rate(found.exact),
        "reported": _rate(found.reported),
    }


def _rate(found: Rate) -> str:
    return f"{found.n} of {found.of} ({percent(found.lower)} to {percent(found.upper)})"


def leaning(result: Diagnosis, shown: Sequence[Shown], most: int = 12) -> list[list[Any]]:
    """Readings, `most` of them, on which alone the adopted model leans, by the tail of their weights."""
    tail = np.array(result.influence.tail if result.influence else [], dtype=float)
    if tail.size != sum(g.group.n_points for g in shown):
        return []
    far = [(float(tail[row]), g, k) for g in shown for k, row in enumerate(g.rows) if tail[row] > TRUSTED]
    return [
        [
            Markup("Group {}").format(g.group.id),
            words.quantity(float(g.group.frequency_hz[k]), "Hz"),
            words.quantity(float(g.group.amplitude_v[k]), "V"),
            fixed(value, 2),
        ]
        for value, g, k in sorted(far, key=lambda row: -row[0])[:most]
    ]


def confounded(pairs: Sequence[Confounded], most: int = 12) -> list[list[Any]]:
    """Pairs of causes that are confounded, `most` of them, and by which angle they differ."""
    return [[model([pair.cause]), model([pair.other]), f"{pair.degrees:.0f}°"] for pair in pairs[:most]]


def rehearsal(found: Rehearsal) -> dict[str, Any]:
    """Probability of the truth before and after a simulated measurement."""
    rows = [
        [model(ids), words.share(before), words.share(after)]
        for ids, before, after in zip(found.truth, found.before, found.after, strict=True)
    ]
    return {"text": found.proposal, "first": found.first, "n": len(rows), "rows": rows}

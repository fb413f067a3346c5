"""The tables of a diagnosis' page, as rows of cells, section by section."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from psafit.compare import known
from psafit.diagnose.gain import names_nothing, worse
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.next_experiment import tells_apart
from psafit.diagnose.record import NEAREST, UNSEEN, CauseResult, Diagnosis, ScreeningResult
from psafit.diagnose.significance import OTHERWISE
from psafit.experiment import CONSTANT_UNITS, Experiment
from psafit.inference.evidence import TRUSTED
from psafit.report import diagnosis_pictures, figures
from psafit.report import diagnosis_words as words
from psafit.report.catalogue import cause, declared, model, parameter
from psafit.report.diagnosis_pictures import Shown
from psafit.report.figures.sweep import SWEPT
from psafit.report.page import MAX_PICTURED, Picture
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

_MAX_TESTS, _MAX_DRIFTS, _MAX_ALTERNATIVES = 10, 8, 12
_COVARIATES: Final = {**SWEPT, "range": "launch range", "order": "order in each session"}
# Share of its prior below a relative scatter from which on it is told as widened.
_WIDENED = 0.9
_SURELY: Final = 2.576 / (2 * 1.645)  # half of a 99 % interval by the width of a 90 % one
_SCREENED: Final = {
    "present": "bad",
    NEAREST: "warn",
    "as good": "bad",
    "explains part alone": "warn",
    "not present": "good",
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
# Nats of separation below which a pair stays tied.
_HARDLY = 3.0


# What is wrong --------------------------------------------------------------------------------------------------


def where(misfit: Mapping[str, Any]) -> list[Markup]:
    """Stretches of sweeps in which a model errs to one side."""
    return [words.of_group(w["group"], str(w["text"])) for w in misfit.get("where", [])]


def growth(result: Diagnosis, experiment: Experiment) -> list[Picture]:
    """Pictures of local exponents."""
    before = result.show.get("baseline", {}).get("growth", [])[:MAX_PICTURED]
    after = result.show.get("extended", {}).get("growth", [])
    conditions = {str(g.id): figures.sweep_of(g).condition for g in experiment.groups}
    zeros = {str(g.id): int(np.count_nonzero(g.launch_range_um == 0)) for g in experiment.groups}
    return diagnosis_pictures.growth_pictures(before, after, conditions, zeros)


def without_growth(result: Diagnosis) -> Markup | None:
    """Groups of which no local exponent can be told."""
    none = [g["group"] for g in result.show.get("baseline", {}).get("growth", []) if not g["at"]]
    return words.group_ids(none) if none else None


def scatter(result: Diagnosis) -> str | None:
    """The relative scatter with which the baseline was fitted, where its prior finds that much."""
    p = next((c.parameters.get("sigma_rel") for c in result.causes if not c.terms), None)
    return percent(p["median"]) if p and known(p.get("prior_share")) > _WIDENED else None


def drift_rows(result: Diagnosis) -> list[list[Any]]:
    """What letting one parameter drift would gain."""
    rest = {(d["parameter"], d["variable"]): d["gain"] for d in result.show.get("extended", {}).get("drift", [])}
    extended = "extended" in result.show
    rows = []
    for d in result.show.get("baseline", {}).get("drift", [])[:_MAX_DRIFTS]:
        p = declared(d["parameter"])
        row = [
            parameter(d["parameter"], p.description if p else ""),
            _COVARIATES.get(d["variable"], d["variable"]),
            f"{words.nats(d['gain'])} nats",
            _change(known(d["factor"])),
        ]
        if extended:
            left = rest.get((d["parameter"], d["variable"]))
            row.append("–" if left is None else f"{words.nats(left)} nats")
        rows.append(row)
    return rows


def corner_rows(result: Diagnosis) -> list[list[Any]]:
    """Where growth changes: readings as the better model weighs them, baseline, and extension if there is one."""
    models = [
        {str(c["group"]): c for c in result.show[name].get("corners", [])}
        for name in ("baseline", "extended")
        if name in result.show
    ]

    def told(c: Mapping[str, Any] | None, at: str, exponents: str) -> list[str]:
        if c is None or c[at] is None:
            return ["one line", "–"]
        unit, ends = ("Hz", []) if c["variable"] == "frequency" else ("V", [])
        if at == "measured":
            ends = [c["lower"], c["upper"]]
        text = number(c[at], ends[1] - ends[0] if ends else None)
        text += f" ({interval(*ends)})" if ends else ""
        below, above = (fixed(x, 2).replace("-", "\N{MINUS SIGN}") for x in c[exponents])
        return [with_unit(text, unit), f"{below} → {above}"]

    rows = []
    for group in dict.fromkeys(id for of_model in models for id in of_model):
        found = [of_model.get(group) for of_model in models]
        measured = next((c for c in reversed(found) if c and c["measured"] is not None), None)
        row = [group, *told(measured, "measured", "exponents")]
        for c in found:
            row += told(c, "simulated", "simulated_exponents")
        rows.append(row)
    return rows


def session_rows(sessions: Sequence[dict[str, Any]]) -> list[list[Any]]:
    """How two sessions differ where both have readings."""
    rows = []
    for s in sessions:
        middle, low, high = (known(s[k]) for k in ("factor", "lower", "upper"))
        # Of many pairs some lie outside their 90 % interval.
        apart = abs(math.log(middle)) > _SURELY * math.log(high / low)
        told = {"text": "differ", "kind": "warn"} if apart else {"text": "agree", "kind": "good"}
        where = count(s["n_conditions"], "condition")
        rows.append([f"{s['second']} over {s['first']}", where, f"×{middle:.2f}", f"×{low:.2f} to ×{high:.2f}", told])
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
        over = words.signed(e.get("over_baseline"))
        if e.get("error") is not None:
            over += f" ± {known(e['error']):.2f}"
        strange: Any = "none"
        if c.implausible:
            strange = {"text": f"{count(len(c.implausible), 'value')} implausible", "kind": "bad"}
        width = e.get("prior_width") or {}
        within = e.get("share")
        rows.append(
            [
                model(c.terms),
                words.share(c.probability) + (f" ({words.share(within)})" if within is not None else ""),
                words.signed(e.get("gain")),
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


def _method(evidence: Mapping[str, Any]) -> str:
    text = str(evidence.get("method", "–")).removeprefix("adaptive ")
    if evidence.get("effective_draws") is not None:
        text += f": {known(evidence['effective_draws']):.0f} draws"
    if evidence.get("nautilus"):
        other = known(evidence["nautilus"]["log_evidence"]) - known(evidence["log_evidence"])
        text += f"; by nautilus {words.signed(other)}"
    if evidence.get("pareto_k") is not None:
        k = known(evidence["pareto_k"])
        text += typeset(f", k {fixed(k, 2)}") + (" (the error is a guess)" if k > TRUSTED else "")
    return text


def parameter_rows(cause: CauseResult) -> list[list[Any]]:
    """A model's parameters."""
    rows: list[list[Any]] = []
    for name, p in cause.parameters.items():
        unit, (median, low, high) = words.estimate(p)
        spread = (high - low) / 2
        share = known(p.get("prior_share"))
        rows.append(
            [
                parameter(name, str(p.get("description", ""))),
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


def robustness(result: Diagnosis, leader: CauseResult | None) -> dict[str, Any] | None:
    """Whose the leader's gain is; None where there is none."""
    told = result.misfit.get("robustness")
    if told is None or leader is None or not leader.terms:
        return None
    return {
        "strongest": "" if told["strongest"] is None else str(told["strongest"]),
        "without": words.nats(told["without"]),
        "over_smooth": words.nats(abs(told["over_smooth"])),
        "less": told["over_smooth"] >= 0,
        "rows": [[str(group), words.nats(gain)] for group, gain in told["groups"]],
    }


def _at_prior(share: float) -> str:
    if not math.isfinite(share):
        return "–"
    if share <= 0.0006:
        return f"under 0.1{NBSP}%"
    return f"over 99.9{NBSP}%" if share >= 0.9994 else f"{fixed(share, 1, per_cent=True)}{NBSP}%"


def screening_rows(screening: Sequence[ScreeningResult]) -> list[list[Any]]:
    """What each cause gains, alone and beside others."""
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
            "–" if s.room is None else f"{significant(s.room, 2, per_cent=True)}{NBSP}%",
            "–" if s.verdict == UNSEEN else words.share(s.inclusion),
        ]
        for s in screening
    ]


def _judged(evidence: Mapping[str, Any]) -> str:
    """Whether a model was sampled."""
    return "estimated from a short fit" if evidence.get("method") == "Laplace" else "sampled"


def alternatives(result: Diagnosis) -> dict[str, Any]:
    """Sets that do as well as the named one."""
    listed_ones = {tuple(c.terms): c for c in result.causes}
    rows = []
    for ids in result.alternatives[:_MAX_ALTERNATIVES]:
        c = listed_ones.get(tuple(ids))
        rows.append(
            [
                model(ids),
                words.share(c.probability) if c else "–",
                words.signed(c.evidence.get("over_baseline")) if c else "–",
                words.signed(c.evidence.get("gain")) if c else "–",
                _judged(c.evidence) if c else "–",
            ]
        )
    return {
        "named": model(result.named) if result.named else None,
        "rows": rows,
        "more": max(0, len(result.alternatives) - _MAX_ALTERNATIVES),
    }


# What remains ---------------------------------------------------------------------------------------------------


def tests(tests: Mapping[str, Any]) -> dict[str, Any] | None:
    """What the tests of one model found, the most striking first."""
    if not tests:
        return None
    statistics = tests.get("statistics", [])
    odd = [Markup("reading {} of group {}").format(k + 1, g) for g, k in tests.get("odd_points", [])]
    p = known(tests.get("p_value"))
    return {
        "p": words.p_text(p),
        "wrong": p < ALPHA,
        "character": words.character(tests),
        "n_simulated": tests.get("n_simulated", 0),
        "refit": "refitted with the model itself" if tests.get("refit") == "exact" else "refitted with its expansion",
        "odd_groups": words.group_ids(tests["odd_groups"]) if tests.get("odd_groups") else None,
        "odd_points": listed(odd) if odd else None,
        "n_statistics": len(statistics),
        "rows": [
            [
                str(s["name"]),
                "all" if s.get("group") is None else Markup("group {}").format(s["group"]),
                _LOOKS_AT.get(s["kind"], s["kind"]),
                typeset(fixed(known(s["excess"]), 2)),
                p_value(known(s["p_value"])),
                {"text": "significant", "kind": "bad"} if s["significant"] else "no",
            ]
            for s in statistics[:_MAX_TESTS]
        ],
    }


def leftover(result: Diagnosis, shown: Sequence[Shown]) -> dict[str, Any] | None:
    """What a smooth curve finds beside the causes, with its pictures."""
    left = result.misfit.get("leftover")
    if not left:
        return None
    mean = np.array([known(x) for x in left.get("mean", [])])
    sd = np.array([known(x) for x in left.get("sd", [])])
    whole = mean.size == sd.size == sum(g.group.n_points for g in shown)
    return {
        "log_bayes": words.signed(left["log_bayes"]),
        "present": known(left["log_bayes"]) > 0,
        "amplitude": percent(known(left["amplitude"])),
        "level": percent(known(left["level"])),
        "reach": factor(known(left["reach"])),
        "sigma_rel": f"{fixed(known(left['sigma_rel']), 1, per_cent=True)}{NBSP}%",
        "rows": [
            [
                Markup("Group {}").format(g["group"]),
                *(f"×{factor(x)}" if math.isfinite(x) else "–" for x in (known(g["mean"]), known(g["largest"]))),
            ]
            for g in left.get("groups", [])
        ],
        "pictures": diagnosis_pictures.leftover_pictures(shown[:MAX_PICTURED], mean, sd) if whole else [],
    }


# Gain -----------------------------------------------------------------------------------------------------------


def gain(name: str, gain: Mapping[str, Any]) -> dict[str, Any]:
    """One protocol's gain, group by group."""
    change, elpd = ([known(x) for x in gain[k]] for k in ("log_rmse_interval", "elpd_interval"))
    before, after = known(gain["log_rmse_before"]), known(gain["log_rmse_after"])
    return {
        "name": name,
        "text": _PROTOCOLS[name],
        "sentence": (
            f"Mean log RMSE {before:.3f} before, {after:.3f} after; change {typeset(fixed(change[0], 3, sign=True))} to"
            f" {typeset(fixed(change[1], 3, sign=True))} (90 % interval), that is a typical factor of"
            f" ×{factor(before)} before and ×{factor(after)} after. Log predictive density, summed over the unseen"
            f" readings: {words.nats(gain['elpd_before'])} nats before, {words.nats(gain['elpd_after'])} nats after;"
            f" change {words.signed(elpd[0])} to {words.signed(elpd[1])} nats (90 % interval). Inside their 90 %"
            f" predictive intervals: {words.share(gain['coverage_before'])} of the readings before,"
            f" {words.share(gain['coverage_after'])} after."
        ),
        "nothing": names_nothing(gain),
        "better": change[1] < 0,
        "worse": change[0] > 0,
        "rows": [
            [
                noted(f"Group {g['group']}", f"{g['silent']}; left out of the mean")
                if g["silent"]
                else noted(f"Group {g['group']}", "worse than by the baseline")
                if g in worse(gain)
                else f"Group {g['group']}",
                words.group_ids(g["seen"]),
                model(g["named"]),
                f"{known(g['log_rmse_before']):.3f} (×{factor(known(g['log_rmse_before']))})",
                f"{known(g['log_rmse_after']):.3f} (×{factor(known(g['log_rmse_after']))})",
                " to ".join(typeset(fixed(known(x), 3, sign=True)) for x in g["log_rmse_interval"]),
                f"{words.signed(known(g['elpd_after']) - known(g['elpd_before']))}"
                f" ({' to '.join(words.signed(x) for x in g['elpd_interval'])})",
                f"{words.share(g['coverage_before'])} / {words.share(g['coverage_after'])}",
            ]
            for g in gain["groups"]
        ],
        "picture": diagnosis_pictures.gain_picture(name, gain),
        "predictions": gain["predictions"],
    }


def ledger(ledger: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
    """Which data each choice saw."""
    rows: list[list[Any]] = []
    for entry in ledger:
        models = entry.get("models") or {}
        shares = sorted(models.items(), key=lambda item: -known(item[1]))
        parts = (Markup("{} {}").format(model(words.split(name)), words.share(share)) for name, share in shares)
        averaged = listed(parts)
        rows.append(
            [_choice(entry), words.group_ids(entry["saw"]), words.group_ids(entry["scored_on"]), averaged or "–"]
        )
    return rows


def _choice(entry: Mapping[str, Any]) -> Markup:
    """A choice; of a search that was repeated from nothing also what that has changed."""
    choice = Markup("{}").format(str(entry["choice"]))
    if "led_to" not in entry:
        return choice
    anew, begun = model(entry["led_to"]), model(entry["begun_led_to"])
    if set(entry["led_to"]) == set(entry["begun_led_to"]):
        return choice + Markup(": it leads to {}, too").format(anew)
    below = known(entry["log_posterior_below_begun"])
    side = "higher" if below > 0 else "lower"
    return choice + Markup(": it leads to {}, the other to {}, whose log posterior is {} nats {}").format(
        anew, begun, number(abs(below)), side
    )


# Next experiment ------------------------------------------------------------------------------------------------


def proposals(found: Mapping[str, Any]) -> dict[str, Any] | None:
    """Measurements to make next, best first."""
    if not found.get("proposals"):
        return None
    tells = tells_apart(found)
    rows = []
    for p in found["proposals"]:
        changed = [
            Markup("{} = {}").format(symbol_html(name), with_unit(number(value), CONSTANT_UNITS.get(name, "1")))
            for name, value in p.get("constants", {}).items()
        ]
        success = known(p.get("success"))
        rows.append(
            [
                Markup("{}, {}").format(p["waveform"], count(len(p["frequency_hz"]), "reading")),
                words.span(p["frequency_hz"], "Hz"),
                words.span(p["amplitude_v"], "V"),
                listed(changed) if changed else "as it is",
                words.lead(p) if tells else words.narrowing(p["separation"], p["error"]),
                words.share(success),
                _left_tied(p.get("pairs", [])),
            ]
        )
    several = any(len(p.get("pairs", [])) > 1 for p in found["proposals"])
    if not several:
        rows = [row[: -1 if tells else -2] for row in rows]
    return {"about": words.about(str(found.get("about", ""))), "tells": tells, "several": several, "rows": rows}


def _left_tied(pairs: Sequence[Mapping[str, Any]]) -> Markup | str:
    """The pairs of models that a measurement would hardly separate."""
    tied = [
        Markup("{} and {}").format(model(pair["first"]), model(pair["second"]))
        for pair in pairs
        if known(pair["separation"]) < _HARDLY
    ]
    return Markup("; ").join(tied) if tied else "none"


def search(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """How often a search finds as much where nothing is hidden."""
    if not found:
        return None
    p, n = found["p_value"], len(found["null"])
    if p is None:
        return {"n": 0, "missing": OTHERWISE[found["missing"]]}
    return {
        "n": n,
        "lead": words.nats(found["lead"]),
        "most": words.nats(max(found["null"])),
        "p": f"{'≤' if p <= 1 / (n + 1) else '='} {significant(p, 2)}",
        "readings": " to ".join(str(m) for m in found["readings"]) if found.get("stored") else "",
    }


def alike(confusion: Mapping[str, Any]) -> list[list[Any]]:
    """Pairs of causes whose effects look alike, and by which angle they differ."""
    return [
        [model([pair["cause"]]), model([pair["other"]]), typeset(f"{known(pair['degrees']):.0f}°")]
        for pair in confusion.get("alike", [])[:_MAX_ALTERNATIVES]
    ]


def rehearsal(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Probability of the truth before and after a simulated measurement."""
    if not found or "truth" not in found:
        return None
    rows = [
        [model(ids), words.share(before), words.share(after)]
        for ids, before, after in zip(found["truth"], found["before"], found["after"], strict=True)
    ]
    return {"text": found["proposal"], "first": found["first"], "n": len(rows), "rows": rows}

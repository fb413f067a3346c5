"""The report of a diagnosis: what is wrong, which causes it has, what naming them is worth, what to measure next."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from psafit.compare import Told, known, read_predictions
from psafit.diagnose.gain import worse
from psafit.diagnose.ladder import CREDIBLE
from psafit.diagnose.misfit import ALPHA, CHARACTERS
from psafit.diagnose.next_experiment import CLEAR, recommended, tells_apart
from psafit.diagnose.record import NEAREST, PAGE, UNSEEN, CauseResult, Diagnosis, ScreeningResult
from psafit.experiment import CONSTANT_UNITS, Experiment, GroupId
from psafit.inference.evidence import TRUSTED
from psafit.inference.run import load
from psafit.numerics import audit
from psafit.physics import owner
from psafit.records import Numerics, Refinement
from psafit.report import diagnosis_pictures, figures
from psafit.report.catalogue import TITLES, cause, declared, model, parameter, symbol
from psafit.report.diagnosis_pictures import Shown
from psafit.report.figures.sweep import SWEPT
from psafit.report.fit import told_numerics, write_report
from psafit.report.page import MAX_PICTURED, Picture, render, worst
from psafit.report.wording import (
    NBSP,
    count,
    exact,
    factor,
    groups,
    interval,
    listed,
    noted,
    number,
    p_value,
    percent,
    prefixed,
    symbol_html,
    typeset,
    with_unit,
)
from psafit.validate import log_ratio, root_mean_square, validate

# Probability of a discrepancy without a name from which on the first screen tells it.
_WORTH_SAYING = 0.05

# Causes of a set from which on one like it is told by what differs.
_LARGE = 3
# Nats of separation below which a pair stays tied.
_HARDLY = 3.0
_MAX_TESTS, _MAX_DRIFTS, _MAX_ALTERNATIVES = 10, 8, 12
_KINDS: Final = {"adequate": "good", "explained": "good", "ambiguous": "warn", "unexplained": "bad"}
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
}
_LOOKS: Final = {"baseline": ("baseline", "grey"), "extended": ("extended model", "vermillion")}
_SURELY: Final = 2.576 / (2 * 1.645)  # half of a 99 % interval by the width of a 90 % one
_COVARIATES: Final = {**SWEPT, "range": "launch range", "order": "order in each session"}
_PROTOCOLS: Final = {
    "strict": "Causes and parameters chosen on the training groups alone, every other group scored.",
    "nested": "For each group, causes and parameters chosen on all the others, then that group scored.",
}


def write_diagnosis(result: Diagnosis, experiment: Experiment, folder: Path) -> Path:
    """Write `diagnosis.html`, and the pages of the extension's runs beside it.

    Parameters
    ----------
    result : Diagnosis
    experiment : Experiment
        That was diagnosed.
    folder : Path
        Where the page goes.

    Returns
    -------
    Path
        Of the page.
    """
    for place in {run["folder"] for run in result.extension.values()}:
        if (folder / place).is_dir():
            extension = load(folder / place)
            write_report(extension, *validate(extension), audit(extension))
    shown = shown_groups(result, experiment, folder)
    # Those that the baseline misses most.
    pictured = [shown[i] for i in worst([max(g.errors, default=0.0) for g in shown])]
    leader = _leader(result)
    content = {
        "title": f"Diagnosis: {result.title}",
        "verdict": {"text": result.verdict, "kind": _kind(result)},
        "sentences": [
            _examined(result, experiment) + " " + _adequate(result),
            _wrong(result),
            _gained(result),
            *_what_next(result.next_experiment),
        ],
        "own_sentences": result.sentences,
        "tiles": _tiles(result, shown),
        "summary": diagnosis_pictures.summary_picture(pictured),
        "explorable": diagnosis_pictures.explorable(shown),
        "overview": diagnosis_pictures.overview_pictures(pictured),
        "left_out": len(shown) - len(pictured),
        "zeros": any(figures.has_zeros(g.group, g.curves) for g in pictured),
        "extended": "extended" in result.show,
        "where": _where(result.misfit),
        "where_after": _where(result.misfit.get("extended", {})),
        "growth": _growth(result, experiment),
        "drift": _drift_rows(result),
        "corners": _corner_rows(result),
        "sessions": _session_rows(result.misfit.get("sessions", [])),
        "models": _model_rows(result),
        "all_groups": ",".join(str(g) for g in result.groups),
        "leader": None
        if leader is None
        else {"name": model(leader.terms), "rows": _parameter_rows(leader), "options": ",".join(leader.terms)},
        "other_models": [
            {"name": model(c.terms), "rows": _parameter_rows(c)} for c in result.causes if c is not leader
        ],
        "robustness": _robustness(result, leader),
        "leader_listed": leader is _listed_leader(result),
        "mostly_unnamed": result.mostly_unnamed,
        "screening_pictures": diagnosis_pictures.screening_pictures(result.screening, TITLES, result.named),
        "screening": _screening_rows(result.screening),
        "alternatives": _alternatives(result),
        "tests_before": _tests(result.misfit.get("baseline", {})),
        "search": _search(result.misfit.get("search")),
        "tests_after": _tests(result.misfit.get("extended", {})),
        "leftover": _leftover(result, shown),
        "quick": result.quick,
        "gains": [_gain(name, result.gain[name]) for name in ("strict", "nested") if result.gain.get(name)],
        "extension": {"adopted": None, "strict": None}
        | {which: run | {"model": model(run["terms"])} for which, run in result.extension.items()},
        "ledger": _ledger(result.ledger),
        "proposals": _proposals(result.next_experiment),
        "confusion": _rehearsal(result.confusion),
        "alike": [
            [model([pair["cause"]]), model([pair["other"]]), typeset(f"{known(pair['degrees']):.0f}°")]
            for pair in result.confusion.get("alike", [])[:_MAX_ALTERNATIVES]
        ],
        "rehearsals": [_rehearsal(one) for one in result.next_experiment.get("rehearsals", [])],
        "numerics": _numerics(result.numerics),
        "data_warnings": experiment.warnings,
        "facts": _facts(result, experiment),
        "alpha": percent(ALPHA),
        "provenance": {
            "psafit": result.versions.get("psafit", "?"),
            "seed": result.seed,
            "data": result.fingerprint[:12],
        },
    }
    return render("diagnosis.html.j2", folder / PAGE, **content)


# Words ----------------------------------------------------------------------------------------------------------


def _nats(value: object) -> str:
    """A log likelihood or evidence with one digit behind the point, as far as there is something to say."""
    x = known(value)
    if not math.isfinite(x):
        return "–"
    text = f"{x:.1f}" if abs(x) < 1e5 else f"{x:.3g}"
    return typeset("0.0" if text == "-0.0" else text)


def _signed(value: object) -> str:
    text = _nats(value)
    return text if text[0] in "–\N{MINUS SIGN}" or text == "0.0" else f"+{text}"


def _share(value: object) -> str:
    x = known(value)
    return percent(x) if math.isfinite(x) else "–"


def _ids(ids: Iterable[GroupId]) -> Markup:
    found = list(ids)
    return groups(found) if found else Markup("none")


def _of_group(group: GroupId, text: str) -> Markup:
    """A place in the record's words, the group's own name left as it is."""
    rest = text.removeprefix(f"group {group}, ")
    rest = re.sub(r"\b\d(?:\.\d+)?e\+04\b", lambda m: f"{float(m[0]):.0f}", rest)
    return Markup("<strong>Group {}</strong>: {}").format(group, typeset(rest))


def _listed_leader(result: Diagnosis) -> CauseResult | None:
    """The adopted model, where it is among the models of the record."""
    return next((c for c in result.causes if c.terms == result.named), None)


def _leader(result: Diagnosis) -> CauseResult | None:
    """The adopted model; its best fit alone, where it is not among the models of the record."""
    if listed_one := _listed_leader(result):
        return listed_one
    values = result.show.get("extended" if result.named else "baseline", {}).get("parameters", {})
    found = {}
    for name, value in values.items():
        p = declared(name)
        about = {"unit": p.unit, "description": p.description} if p else {}
        found[name] = {"median": value, **about}
    return CauseResult(result.named, math.nan, found, {}, []) if found else None


# The first screen -----------------------------------------------------------------------------------------------


def _told(path: Path, model: str | None = None) -> dict[str, Told]:
    """What a table beside the record says of each group; nothing where it is not there."""
    return {str(t.group.id): t for t in read_predictions(path, model)} if path.is_file() else {}


def _band(told: Told | None, n: int) -> tuple[figures.Band, ...]:
    return (figures.Band(figures.READING_BAND, told.lower, told.upper),) if told and told.lower.size == n else ()


def shown_groups(result: Diagnosis, experiment: Experiment, folder: Path) -> list[Shown]:
    """The groups of the record with the models' predictions, which the record holds one group after the other."""
    members = experiment.select(result.groups)
    n = sum(g.n_points for g in members)
    told = {name: np.asarray(model.get("predicted_um", []), dtype=float) for name, model in result.show.items()}
    adopted = _told(result.table(folder, result.predictions))
    strict = result.gain.get("strict")
    unseen = _told(result.table(folder, strict["predictions"]), "extended") if strict else {}
    each = {id: np.asarray(v, dtype=float) for id, v in result.show.get("extended", {}).get("without_um", {}).items()}
    without = {id: ranges for id, ranges in each.items() if ranges.size == n}
    found, start = [], 0
    for group in members:
        part = slice(start, start + group.n_points)
        start, name = part.stop, str(group.id)
        looks = {model: _LOOKS.get(model, (model, "purple")) for model, values in told.items() if values.size == n}
        last = "extended" if "extended" in looks and result.verdict != "adequate" else "baseline"
        curves = {
            model: figures.Curve(
                *look,
                told[model][part],
                _band(adopted.get(name), group.n_points) if model == last else (),
                dashed=model == "baseline",
            )
            for model, look in looks.items()
        }
        shown = [curve for model, curve in curves.items() if model in _LOOKS]
        more = [curve for model, curve in curves.items() if model not in _LOOKS]
        if band := _band(unseen.get(name), group.n_points):
            more.append(figures.Curve("extended model without this group", "blue", unseen[name].median, band))
        more += figures.without_curves({id: ranges[part] for id, ranges in without.items()}, TITLES)
        errors = [root_mean_square(log_ratio(c.middle, group.launch_range_um)) for c in shown]
        found.append(Shown(group, figures.sweep_of(group), shown, errors, more))
    return found


def _examined(result: Diagnosis, experiment: Experiment) -> Markup:
    readings = sum(g.n_points for g in experiment.select(result.groups))
    return Markup("<strong>Examined:</strong> {} of {}, against the baseline and {}.").format(
        count(readings, "reading"), _ids(result.groups), count(len(result.screening), "candidate cause")
    )


def _adequate(result: Diagnosis) -> Markup:
    p, n = known(result.misfit.get("p_value")), result.misfit.get("baseline", {}).get("n_simulated", 0)
    how = Markup(
        "of {} made by the fitted baseline itself, {} look at least as odd; below {} it counts as wrong"
    ).format(count(n, "data set") if n else "data sets", _few(p, n), percent(ALPHA))
    if p < ALPHA:
        return Markup("<strong>Is the baseline adequate?</strong> No: {}.").format(how)
    if result.verdict == "adequate":
        so_far = "As far as these readings tell" if _in_doubt(result) else "Yes"
        return Markup("<strong>Is the baseline adequate?</strong> {}: {}.").format(so_far, how)
    beside = "a discrepancy without a name" if result.mostly_unnamed else "an extended model"
    return Markup(
        "<strong>Is the baseline adequate?</strong> The tests do not reject it ({}), but it is improbable beside {}."
    ).format(how, beside)


def _p(p: float) -> str:
    text = p_value(p)
    return f"p {text}" if text.startswith("≤") else f"p = {text}"


def _in_doubt(result: Diagnosis) -> bool:
    """Whether a baseline that nothing refutes is less probable than what could stand in its place."""
    kept = next((c.probability for c in result.causes if not c.terms), 1.0)
    return result.verdict == "adequate" and kept < 0.5


def _kind(result: Diagnosis) -> str:
    return "warn" if _in_doubt(result) else _KINDS.get(result.verdict, "warn")


def _few(p: float, n: int = 0) -> str:
    """A p value as a share, with the digits that decide; of `n` simulated data sets the least possible is none."""
    if not math.isfinite(p):
        return "–"
    if n and p <= 1 / (n + 1):
        return "none"
    return f"at most 0.1{NBSP}%" if p <= 1e-3 else f"{100 * p:.2g}{NBSP}%" if p < 0.1 else percent(p)


def _wrong(result: Diagnosis) -> Markup:
    head = Markup("<strong>What is wrong, and why?</strong> ")
    named = Markup(" + ").join(Markup("<strong>{}</strong>").format(TITLES.get(t, t)) for t in result.named)
    tied = Markup("; or ").join(_instead(result.named, ids) for ids in result.alternatives[:3])
    more = len(result.alternatives) - 3
    if more > 0:
        tied += Markup(" (and {} more)").format(count(more, "set"))
    listed_one = _listed_leader(result)
    # Where an unnamed discrepancy takes it all, a share of what is left says nothing.
    share = f" (probability {_share(listed_one.probability)})" if listed_one and not result.mostly_unnamed else ""
    if result.verdict == "adequate":
        unseen = sum(s.verdict == UNSEEN for s in result.screening)
        but = Markup(" Of {}, {} could not have been seen in them.").format(
            count(len(result.screening), "candidate cause"), unseen
        )
        kept = [c for c in result.causes if c.terms and c.probability >= _WORTH_SAYING]
        others = Markup(" Nor can they exclude {}.").format(
            listed(Markup("{} ({})").format(model(c.terms), _share(c.probability)) for c in kept)
        )
        return head + "Nothing that these readings show." + (others if kept else "") + (but if unseen else "")
    if result.verdict == "explained":
        how = "{} explains it{}; nothing is left of the misfit, and no other set does as well.{}"
        if known(result.misfit.get("p_value")) >= ALPHA:
            how = "{}{} fits far better, and no other set does as well; the tests alone would not have objected.{}"
        return head + Markup(how).format(named, share, _reservations(result))
    if result.verdict == "ambiguous":
        how = "These readings cannot tell which of several sets of causes it is: {}{}; or {}.{}"
        if listed_one and listed_one.probability >= CREDIBLE:
            how = "{}{} is most plausible, but these readings cannot separate it from what fits as well: {}.{}"
        return head + Markup(how).format(named, share, tied, _reservations(result))
    if not result.named:
        what = Markup(" Of the baseline: {}.").format(_character(result.misfit.get("baseline", {})))
        odd = known(result.misfit.get("p_value")) < ALPHA
        return head + "No cause of the catalogue explains it." + (what if odd else "") + _unnamed(result)
    also = Markup(" Not to be told apart from {}: {}.").format(model(result.named), tied) if result.alternatives else ""
    # Nothing may be left beside the causes, and yet something smooth in their place be likelier than so many of them.
    simpler = any("a smooth curve in its place is simpler" in told for told in result.sentences)
    remains = result.misfit.get("remains", not simpler)  # an older record says so in its sentences alone
    why = "structure remains that no cause describes" if remains else "a smooth curve in its place is more probable"
    return head + Markup("The best extension is {}{}, but {} (probability of an unnamed discrepancy {}).{}{}").format(
        named, share, why, _share(result.unnamed), _sizes(result) + _implausible(result), also
    )


def _instead(named: Sequence[str], ids: Sequence[str]) -> Markup | str:
    """A set that does as well as a large one: by what is exchanged, where that is shorter."""
    gone, new = ([id for id in one if id not in other] for one, other in ((named, ids), (ids, named)))
    if len(named) < _LARGE or len(gone) + len(new) > 2 or not ids:
        return model(ids)
    if not gone:
        return Markup("these and {}").format(model(new))
    rest = Markup("these without {}").format(model(gone))
    return Markup("{} in the place of {}").format(model(new), model(gone)) if new else rest


def _implausible(result: Diagnosis) -> Markup:
    leader = _listed_leader(result)
    if not leader or not leader.implausible:
        return Markup("")
    return Markup(" <strong>{}</strong> of what is named first would surprise whoever knows such rigs: {}.").format(
        count(len(leader.implausible), "value"), _by_cause({name: symbol(name) for name in leader.implausible})
    )


def _sizes(result: Diagnosis) -> Markup:
    """How large the causes are that are named, and those of the first sets that do as well."""
    leader = _listed_leader(result)
    tied = [c for ids in result.alternatives[:2] for c in result.causes if c.terms == ids]
    own = _sized([leader] if leader else [])
    other = {name: text for name, text in _sized(tied).items() if name not in own}
    if not own:
        own, other = other, own
    words = Markup("; of the others that do as well: {}").format(_by_cause(other)) if other else ""
    return Markup(" Size, with 90{}% interval: {}{}.").format(NBSP, _by_cause(own), words) if own else Markup("")


def _sized(causes: Sequence[CauseResult]) -> dict[str, Markup]:
    """The values of models' own causes; where several have one, the first's."""
    found: dict[str, Markup] = {}
    told = [(c.terms, name, p) for c in causes for name, p in c.parameters.items()]
    for terms, name, p in told:
        if owner(name) in terms and name not in found:
            unit, (median, low, high) = _estimate(p)
            spread = (high - low) / 2
            size = with_unit(number(median, spread if spread > 0 else None), unit)
            ends = interval(low, high, spread) if high > low else ""
            ends = f"({ends})" if ends and not ends.startswith("(") else ends
            found[name] = Markup("{} = {} {}").format(symbol(name), size, ends).strip()
    return found


def _by_cause(told: Mapping[str, Markup]) -> Markup:
    """What is told of parameters, each cause's behind its title."""
    found: dict[str, list[Markup]] = {}
    for name, text in told.items():
        found.setdefault(TITLES.get(owner(name) or "", ""), []).append(text)
    return Markup("; ").join(Markup("{} {}").format(title, listed(texts)).strip() for title, texts in found.items())


def _reservations(result: Diagnosis) -> Markup:
    """What a reader must know who would take the name for the mechanism."""
    return _sizes(result) + _implausible(result) + _unnamed(result)


def _unnamed(result: Diagnosis) -> Markup:
    if result.unnamed < _WORTH_SAYING:
        return Markup("")
    return Markup(" A discrepancy without a name keeps {} of the probability.").format(_share(result.unnamed))


def _character(tests: Mapping[str, Any]) -> str:
    found = str(tests.get("character", "none"))
    return CHARACTERS.get(found, found)


def _gained(result: Diagnosis) -> Markup:
    head = Markup("<strong>What was gained?</strong> ")
    if not result.gain:
        return head + (
            "Not measured: a quick diagnosis gives the verdict alone."
            if result.quick
            else "Not measured: there is no group that could be held out."
        )
    parts = []
    for name, text in (("strict", "chosen on {} only"), ("nested", "chosen on all other groups")):
        one = result.gain.get(name)
        if one:
            parts.append(
                Markup("{}, the typical error on unseen groups goes from ×{} to ×{}"
                    " (change of log RMSE {} to {}, 90 %)"
                ).format(
                    Markup(text).format(_ids(result.training)),
                    factor(known(one["log_rmse_before"])), factor(known(one["log_rmse_after"])),
                    *(typeset(f"{known(x):+.2f}") for x in one["log_rmse_interval"]),
                )
            )  # fmt: skip
            if lost := worse(one):
                parts[-1] += Markup(", but worse on {}").format(groups([g["group"] for g in lost]))
    text = Markup("; ").join(parts)
    return head + Markup("With causes and parameters ") + text + "."


def _what_next(found: Mapping[str, Any]) -> list[Markup]:
    """The best proposal in a sentence, if it is worth the work."""
    best = recommended(found)
    about = _about(str(found.get("about", "")))
    if best is None:
        if not (tells_apart(found) and found["proposals"]):
            return []
        return [
            Markup("<strong>What next?</strong> No sweep that the rig allows {}: the best by {}. {}").format(
                about, _lead(found["proposals"][0]), Markup("<a href='#next'>More</a>")
            )
        ]
    if tells_apart(found):
        what = Markup("{} with an expected lead of {}").format(about, _lead(best))
    else:
        known_so_far = "of which these readings tell little" if found.get("weak", True) else "which is known least"
        what = Markup("{}, {}: it would narrow it by {}").format(about, known_so_far, _narrowing(best["separation"]))
    return [
        Markup("<strong>What next?</strong> Measure <em>{}</em>: that best {}. <a href='#next'>More</a>").format(
            typeset(best["text"]), what
        )
    ]


def _lead(proposal: Mapping[str, Any]) -> str:
    """An expected separation with its error; single log ratios count up to a limit."""
    x, error = known(proposal["separation"]), known(proposal["error"])
    return typeset(f"over {0.9 * CLEAR:.0f} nats" if x > 0.9 * CLEAR else f"{x:.1f} ± {error:.1f} nats")


def _narrowing(separation: object) -> str:
    """A fall of the log standard deviation as a share of it."""
    return _share(-math.expm1(-known(separation)))


def _tiles(result: Diagnosis, shown: Sequence[Shown]) -> list[dict[str, str]]:
    tiles = [{"value": p_value(known(result.misfit.get("p_value"))), "label": "p value: baseline against the readings"}]
    if "extended" in result.misfit:
        after = p_value(known(result.misfit["extended"].get("p_value")))
        what = "best causes, not adopted," if result.verdict == "adequate" else "extension"
        tiles.append({"value": after, "label": f"p value: {what} against the readings"})
    for k, curve in enumerate(shown[0].curves):
        errors = [g.errors[k] for g in shown]
        label = f"typical factor between {curve.name} and reading, fitted to all groups"
        if len(errors) > 1:
            label += f"; ×{factor(min(errors))} to ×{factor(max(errors))}"
        tiles.append({"value": f"×{factor(float(np.mean(errors)))}", "label": label})
    return tiles


# What is wrong --------------------------------------------------------------------------------------------------


def _where(misfit: Mapping[str, Any]) -> list[Markup]:
    return [_of_group(w["group"], str(w["text"])) for w in misfit.get("where", [])]


def _growth(result: Diagnosis, experiment: Experiment) -> list[Picture]:
    before = result.show.get("baseline", {}).get("growth", [])[:MAX_PICTURED]
    after = result.show.get("extended", {}).get("growth", [])
    conditions = {str(g.id): figures.sweep_of(g).condition for g in experiment.groups}
    zeros = {str(g.id): int(np.count_nonzero(g.launch_range_um == 0)) for g in experiment.groups}
    return diagnosis_pictures.growth_pictures(before, after, conditions, zeros)


def _drift_rows(result: Diagnosis) -> list[list[Any]]:
    rest = {(d["parameter"], d["variable"]): d["gain"] for d in result.show.get("extended", {}).get("drift", [])}
    extended = "extended" in result.show
    rows = []
    for d in result.show.get("baseline", {}).get("drift", [])[:_MAX_DRIFTS]:
        p = declared(d["parameter"])
        row = [
            parameter(d["parameter"], p.description if p else ""),
            _COVARIATES.get(d["variable"], d["variable"]),
            f"{_nats(d['gain'])} nats",
            _change(known(d["factor"])),
        ]
        if extended:
            left = rest.get((d["parameter"], d["variable"]))
            row.append("–" if left is None else f"{_nats(left)} nats")
        rows.append(row)
    return rows


def _corner_rows(result: Diagnosis) -> list[list[Any]]:
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
        below, above = (f"{round(x, 2) + 0.0:.2f}".replace("-", "\N{MINUS SIGN}") for x in c[exponents])
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


def _session_rows(sessions: Sequence[dict[str, Any]]) -> list[list[Any]]:
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


def _model_rows(result: Diagnosis) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for c in result.causes:
        e = c.evidence
        over = _signed(e.get("over_baseline"))
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
                _share(c.probability) + (f" ({_share(within)})" if within is not None else ""),
                _signed(e.get("gain")),
                over,
                f"{_signed(width['half'])} / {_signed(width['twice'])}" if width and c.terms else "–",
                strange,
                _method(e),
            ]
        )
    if rows:
        listed_ones = sum(known(c.probability) for c in result.causes)
        others = max(1 - listed_ones - known(result.unnamed), 0.0)
        for name, share in (("all other sets of causes", others), ("a discrepancy without a name", result.unnamed)):
            rows.append([Markup("<em>{}</em>").format(name), _share(share), *["–"] * 5])
    return rows


def _method(evidence: Mapping[str, Any]) -> str:
    text = str(evidence.get("method", "–")).removeprefix("adaptive ")
    if evidence.get("effective_draws") is not None:
        text += f": {known(evidence['effective_draws']):.0f} draws"
    if evidence.get("nautilus"):
        other = known(evidence["nautilus"]["log_evidence"]) - known(evidence["log_evidence"])
        text += f"; by nautilus {_signed(other)}"
    if evidence.get("pareto_k") is not None:
        k = known(evidence["pareto_k"])
        text += typeset(f", k {k:.2f}") + (" (the error is a guess)" if k > TRUSTED else "")
    return text


def _parameter_rows(cause: CauseResult) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for name, p in cause.parameters.items():
        unit, (median, low, high) = _estimate(p)
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


def _robustness(result: Diagnosis, leader: CauseResult | None) -> dict[str, Any] | None:
    """Whose the leader's gain is; None where there is none."""
    told = result.misfit.get("robustness")
    if told is None or leader is None or not leader.terms:
        return None
    return {
        "strongest": "" if told["strongest"] is None else str(told["strongest"]),
        "without": _nats(told["without"]),
        "over_smooth": _nats(abs(told["over_smooth"])),
        "less": told["over_smooth"] >= 0,
        "rows": [[str(group), _nats(gain)] for group, gain in told["groups"]],
    }


def _estimate(p: Mapping[str, Any]) -> tuple[str, list[float]]:
    """Unit, and median, lower and upper end in it."""
    return prefixed(str(p.get("unit", "1")), *(known(p.get(k)) for k in ("median", "lower", "upper")))


def _quantity(value: float, unit: str) -> str:
    unit, (value,) = prefixed(unit, value)
    return with_unit(number(value), unit)


def _at_prior(share: float) -> str:
    if not math.isfinite(share):
        return "–"
    if share <= 0.0006:
        return f"under 0.1{NBSP}%"
    return f"over 99.9{NBSP}%" if share >= 0.9994 else f"{100 * share:.1f}{NBSP}%"


def _screening_rows(screening: Sequence[ScreeningResult]) -> list[list[Any]]:
    return [
        [
            cause(s.id),
            {"text": s.verdict, "kind": _SCREENED.get(s.verdict, "")},
            _nats(s.refit_gain),
            _nats(s.gain),
            _nats(s.chance),
            _signed(s.log_bayes),
            _quantity(known(s.strength), s.unit),
            number(known(s.visible)),
            _share(s.inclusion),
        ]
        for s in screening
    ]


def _alternatives(result: Diagnosis) -> dict[str, Any]:
    listed_ones = {tuple(c.terms): c for c in result.causes}
    rows = []
    for ids in result.alternatives[:_MAX_ALTERNATIVES]:
        c = listed_ones.get(tuple(ids))
        rows.append(
            [
                model(ids),
                _share(c.probability) if c else "–",
                _signed(c.evidence.get("over_baseline")) if c else "–",
                _signed(c.evidence.get("gain")) if c else "–",
                ("refitted" if c else "judged by the expansion only, not refitted"),
            ]
        )
    return {
        "named": model(result.named) if result.named else None,
        "rows": rows,
        "more": max(0, len(result.alternatives) - _MAX_ALTERNATIVES),
    }


# What remains ---------------------------------------------------------------------------------------------------


def _tests(tests: Mapping[str, Any]) -> dict[str, Any] | None:
    if not tests:
        return None
    statistics = tests.get("statistics", [])
    odd = [Markup("reading {} of group {}").format(k + 1, g) for g, k in tests.get("odd_points", [])]
    p = known(tests.get("p_value"))
    return {
        "p": _p(p),
        "wrong": p < ALPHA,
        "character": _character(tests),
        "n_simulated": tests.get("n_simulated", 0),
        "refit": "refitted with the model itself" if tests.get("refit") == "exact" else "refitted with its expansion",
        "odd_groups": _ids(tests["odd_groups"]) if tests.get("odd_groups") else None,
        "odd_points": listed(odd) if odd else None,
        "n_statistics": len(statistics),
        "rows": [
            [
                str(s["name"]),
                "all" if s.get("group") is None else Markup("group {}").format(s["group"]),
                _LOOKS_AT.get(s["kind"], s["kind"]),
                typeset(f"{known(s['excess']):.2f}"),
                p_value(known(s["p_value"])),
                {"text": "significant", "kind": "bad"} if s["significant"] else "no",
            ]
            for s in statistics[:_MAX_TESTS]
        ],
    }


def _leftover(result: Diagnosis, shown: Sequence[Shown]) -> dict[str, Any] | None:
    left = result.misfit.get("leftover")
    if not left:
        return None
    mean = np.array([known(x) for x in left.get("mean", [])])
    sd = np.array([known(x) for x in left.get("sd", [])])
    whole = mean.size == sd.size == sum(g.group.n_points for g in shown)
    return {
        "log_bayes": _signed(left["log_bayes"]),
        "present": known(left["log_bayes"]) > 0,
        "amplitude": percent(known(left["amplitude"])),
        "level": percent(known(left["level"])),
        "reach": factor(known(left["reach"])),
        "sigma_rel": f"{100 * known(left['sigma_rel']):.1f}{NBSP}%",
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


def _gain(name: str, gain: Mapping[str, Any]) -> dict[str, Any]:
    change, elpd = ([known(x) for x in gain[k]] for k in ("log_rmse_interval", "elpd_interval"))
    before, after = known(gain["log_rmse_before"]), known(gain["log_rmse_after"])
    return {
        "name": name,
        "text": _PROTOCOLS[name],
        "sentence": (
            f"Mean log RMSE {before:.3f} before, {after:.3f} after; change {typeset(f'{change[0]:+.3f}')} to"
            f" {typeset(f'{change[1]:+.3f}')} (90 % interval), that is a typical factor of ×{factor(before)} before and"
            f" ×{factor(after)} after. Log predictive density, summed over the unseen readings:"
            f" {_nats(gain['elpd_before'])} nats before, {_nats(gain['elpd_after'])} nats after; change"
            f" {_signed(elpd[0])} to {_signed(elpd[1])} nats (90 % interval). Inside their 90 % predictive intervals:"
            f" {_share(gain['coverage_before'])} of the readings before, {_share(gain['coverage_after'])} after."
        ),
        "better": change[1] < 0,
        "worse": change[0] > 0,
        "rows": [
            [
                noted(f"Group {g['group']}", f"{g['silent']}; left out of the mean")
                if g["silent"]
                else noted(f"Group {g['group']}", "worse than by the baseline")
                if g in worse(gain)
                else f"Group {g['group']}",
                _ids(g["seen"]),
                model(g["named"]),
                f"{known(g['log_rmse_before']):.3f} (×{factor(known(g['log_rmse_before']))})",
                f"{known(g['log_rmse_after']):.3f} (×{factor(known(g['log_rmse_after']))})",
                " to ".join(typeset(f"{known(x):+.3f}") for x in g["log_rmse_interval"]),
                f"{_signed(known(g['elpd_after']) - known(g['elpd_before']))}"
                f" ({' to '.join(_signed(x) for x in g['elpd_interval'])})",
                f"{_share(g['coverage_before'])} / {_share(g['coverage_after'])}",
            ]
            for g in gain["groups"]
        ],
        "picture": diagnosis_pictures.gain_picture(name, gain),
        "predictions": gain["predictions"],
    }


def _ledger(ledger: Sequence[Mapping[str, Any]]) -> list[list[Any]]:
    rows: list[list[Any]] = []
    for entry in ledger:
        models = entry.get("models") or {}
        shares = sorted(models.items(), key=lambda item: -known(item[1]))
        words = listed(Markup("{} {}").format(model(_split(name)), _share(share)) for name, share in shares)
        rows.append([str(entry["choice"]), _ids(entry["saw"]), _ids(entry["scored_on"]), words or "–"])
    return rows


# Next experiment ------------------------------------------------------------------------------------------------


def _proposals(found: Mapping[str, Any]) -> dict[str, Any] | None:
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
                _span(p["frequency_hz"], "Hz"),
                _span(p["amplitude_v"], "V"),
                listed(changed) if changed else "as it is",
                _lead(p) if tells else _narrowing(p["separation"]),
                _share(success),
                _left_tied(p.get("pairs", [])),
            ]
        )
    several = any(len(p.get("pairs", [])) > 1 for p in found["proposals"])
    if not several:
        rows = [row[: -1 if tells else -2] for row in rows]
    return {"about": _about(str(found.get("about", ""))), "tells": tells, "several": several, "rows": rows}


def _left_tied(pairs: Sequence[Mapping[str, Any]]) -> Markup | str:
    """The pairs of models that a measurement would hardly separate."""
    tied = [
        Markup("{} and {}").format(model(pair["first"]), model(pair["second"]))
        for pair in pairs
        if known(pair["separation"]) < _HARDLY
    ]
    return Markup("; ").join(tied) if tied else "none"


def _search(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if not found or not found["null"]:
        return None
    p, n = found["p_value"], len(found["null"])
    return {
        "n": n,
        "lead": _nats(found["lead"]),
        "most": _nats(max(found["null"])),
        "p": f"{'≤' if p <= 1 / (n + 1) else '='} {p:.2g}",
    }


def _rehearsal(found: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if not found or "truth" not in found:
        return None
    rows = [
        [model(ids), _share(before), _share(after)]
        for ids, before, after in zip(found["truth"], found["before"], found["after"], strict=True)
    ]
    return {"text": found["proposal"], "first": found["first"], "n": len(rows), "rows": rows}


def _about(text: str) -> Markup | str:
    """What proposals are for: the record names causes and parameters by their ids."""
    verb, _, what = text.partition(" ")
    if verb == "tells" and " from " in what:
        first, others = what.split(" from ", 1)
        sets = [_split(ids) for ids in (first, *others.split(", "))]
        shared = set.intersection(*map(set, sets))
        if any(shared.issuperset(ids) for ids in sets):  # one holds nothing else
            shared = set()
        one, *rest = (model([id for id in ids if id not in shared]) for ids in sets)
        beside = " (beside what they share)" if shared else ""
        return Markup("tells {} from {}{}").format(one, listed(rest), beside)
    p = declared(what)
    return Markup("determines {}").format(parameter(what, p.description)) if verb and p else text


def _split(ids: str) -> list[str]:
    """A set of causes as the record writes it in words."""
    return [] if ids in ("baseline", "the baseline") else ids.split(" + ")


def _span(values: Sequence[float], unit: str) -> str:
    low, high = min(values), max(values)
    text = number(low) if math.isclose(low, high) else interval(low, high)
    return with_unit(text, unit)


# Numerics and provenance ----------------------------------------------------------------------------------------


def _numerics(n: Mapping[str, Any]) -> dict[str, Any] | None:
    if not n:
        return None
    found: dict[str, Any] = {k: math.nan if v is None and k != "tolerance" else v for k, v in n.items()}
    found["refinement"] = [Refinement(**{k: known(v) for k, v in step.items()}) for step in n["refinement"]]
    return told_numerics(Numerics(**found))


def _facts(result: Diagnosis, experiment: Experiment) -> list[list[Any]]:
    facts: list[list[Any]] = [
        ["Data", result.title],
        ["Source", experiment.source or "not given"],
        ["Groups", _ids(result.groups)],
        ["Training groups of the strict protocol", _ids(result.training)],
        ["Seed", str(result.seed)],
        ["Kind of run", "quick: the verdict alone" if result.quick else "full"],
        ["Predictions of the adopted model", result.predictions],
        ["Fingerprint of the data (SHA-256)", result.fingerprint],
        ["Versions", ", ".join(f"{name} {version}" for name, version in result.versions.items())],
        ["Time taken", ", ".join(f"{name} {known(s):.1f}{NBSP}s" for name, s in result.seconds.items()) or "–"],
    ]
    if result.command:
        facts.insert(2, ["Command", result.command])
    if experiment.beliefs:
        stated = (f"{b.name}: {b.prior.describe()} ({b.source})" for b in experiment.beliefs)
        facts.insert(2, ["Priors that the experiment states", "; ".join(stated)])
    return facts

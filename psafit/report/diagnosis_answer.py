"""The first screen of a diagnosis' page: its answer in sentences, and the key numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from psafit.compare import known
from psafit.diagnose.gain import names_nothing, worse
from psafit.diagnose.misfit import ALPHA
from psafit.diagnose.next_experiment import recommended, tells_apart
from psafit.diagnose.record import UNSEEN, CauseResult, Diagnosis
from psafit.experiment import Experiment, Group
from psafit.inference import noise
from psafit.model_search.ladder import CREDIBLE
from psafit.physics import owner
from psafit.report import diagnosis_words as words
from psafit.report.catalogue import TITLES, model, symbol
from psafit.report.diagnosis_pictures import Shown
from psafit.report.figures.sweep import frequency_text
from psafit.report.wording import (
    NBSP,
    count,
    factor,
    groups,
    interval,
    listed,
    number,
    p_value,
    percent,
    typeset,
    with_unit,
)
from psafit.text import fixed, significant

_KINDS: Final = {"adequate": "good", "explained": "good", "ambiguous": "warn", "unexplained": "bad"}
# Probability of a discrepancy without a name from which on the first screen tells it.
_WORTH_SAYING = 0.05
# Causes of a set from which on one like it is told by what differs.
_LARGE = 3
_SCATTER = frozenset(p.name for p in noise.PARAMETERS)


def examined(result: Diagnosis, experiment: Experiment) -> Markup:
    """What was looked at."""
    readings = sum(g.n_points for g in experiment.select(result.groups))
    return Markup("<strong>Examined:</strong> {} of {}, against the baseline and {}.").format(
        count(readings, "reading"), words.group_ids(result.groups), count(len(result.screening), "candidate cause")
    )


def adequate(result: Diagnosis) -> Markup:
    """Whether the baseline explains the readings, and how that was judged."""
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


def _in_doubt(result: Diagnosis) -> bool:
    """Whether a baseline that nothing refutes is less probable than what could stand in its place."""
    kept = next((c.probability for c in result.causes if not c.terms), 1.0)
    return result.verdict == "adequate" and kept < 0.5


def kind(result: Diagnosis) -> str:
    """Colour of the verdict."""
    return "warn" if _in_doubt(result) else _KINDS.get(result.verdict, "warn")


def _few(p: float, n: int = 0) -> str:
    """A p value as a share, with the digits that decide; of `n` simulated data sets the least possible is none."""
    if not math.isfinite(p):
        return "–"
    if n and p <= 1 / (n + 1):
        return "none"
    return (
        f"at most 0.1{NBSP}%" if p <= 1e-3 else f"{significant(p, 2, per_cent=True)}{NBSP}%" if p < 0.1 else percent(p)
    )


def wrong(result: Diagnosis, experiment: Experiment) -> Markup:
    """What is wrong, and why: the causes, how sure that is, how large they are; and readings that stand out."""
    laws = Markup("").join(
        Markup(" <strong>{}</strong>").format(told.replace(" um,", f"{NBSP}µm,")) for told in result.breaks
    )
    return _why(result) + laws + _outliers(result, experiment) + Markup(" {}").format(result.restricted)


def _outliers(result: Diagnosis, experiment: Experiment) -> Markup:
    """Readings far from the model that is adopted."""
    which = "extended" if result.verdict != "adequate" and result.misfit.get("extended") else "baseline"
    members = {str(g.id): g for g in experiment.groups}
    tests = result.misfit.get(which, {})
    odd = [(members[str(id)], k) for id, k in tests.get("odd_points", []) if str(id) in members]
    far = [(members[str(r["group"])], r["number"]) for r in tests.get("furthest", []) if str(r["group"]) in members]

    def each(readings: Sequence[tuple[Group, int]]) -> Markup:
        return listed(
            Markup("number {} of group {} ({}, {:.4g}{}V)").format(
                k + 1, g.id, frequency_text(float(g.frequency_hz[k])), float(g.amplitude_v[k]), NBSP
            )
            for g, k in readings
        )

    if not odd:
        none = Markup(" No reading stands out by more than four standard deviations; the furthest are {}.")
        return none.format(each(far)) if far else Markup("")
    of, are = ("extension" if which == "extended" else which), "is" if len(odd) == 1 else "are"
    return Markup(" Beside the {}, {} {} off by more than four standard deviations of the scatter: {}.").format(
        of, count(len(odd), "reading"), are, each(odd)
    )


def _why(result: Diagnosis) -> Markup:
    """The causes, how sure that is, and how large they are."""
    head = Markup("<strong>What is wrong, and why?</strong> ")
    named = Markup(" + ").join(Markup("<strong>{}</strong>").format(TITLES.get(t, t)) for t in result.named)
    tied = Markup("; or ").join(_instead(result.named, ids) for ids in result.alternatives[:3])
    more = len(result.alternatives) - 3
    if more > 0:
        tied += Markup(" (and {} more)").format(count(more, "set"))
    listed_one = words.listed_leader(result)
    # Where an unnamed discrepancy takes it all, a share of what is left says nothing.
    share = f" (probability {words.share(listed_one.probability)})" if listed_one and not result.mostly_unnamed else ""
    if result.verdict == "adequate":
        unseen = sum(s.verdict == UNSEEN for s in result.screening)
        but = Markup(" Of {}, {} could not have been seen in them.").format(
            count(len(result.screening), "candidate cause"), unseen
        )
        kept = [c for c in result.causes if c.terms and c.probability >= _WORTH_SAYING]
        others = Markup(" Nor can they exclude {}.").format(
            listed(Markup("{} ({})").format(model(c.terms), words.share(c.probability)) for c in kept)
        )
        return head + "Nothing that these readings show." + (others if kept else "") + (but if unseen else "")
    if result.verdict == "explained":
        other = result.looked_at.no_other("set of these causes" if result.left_out else "set")
        how = "{} explains it{}; nothing is left of the misfit, and " + other + " does as well.{}"
        if known(result.misfit.get("p_value")) >= ALPHA:
            how = "{}{} fits far better, and " + other + " does as well; the tests alone would not have objected.{}"
        return head + Markup(how).format(named, share, _reservations(result))
    if result.verdict == "ambiguous":
        how = "These readings cannot tell which of several sets of causes it is: {}{}; or {}.{}"
        if listed_one and listed_one.probability >= CREDIBLE:
            how = "{}{} is most plausible, but these readings cannot separate it from what fits as well: {}.{}"
        return head + Markup(how).format(named, share, tied, _reservations(result))
    if not result.named:
        what = Markup(" Of the baseline: {}.").format(words.character(result.misfit.get("baseline", {})))
        odd = known(result.misfit.get("p_value")) < ALPHA
        return (
            head
            + f"No cause {'that was looked at' if result.left_out else 'of the catalogue'} explains it."
            + (what if odd else "")
            + _unnamed(result)
        )
    also = Markup(" Not to be told apart from {}: {}.").format(model(result.named), tied) if result.alternatives else ""
    # Nothing may be left beside the causes, and yet something smooth in their place be likelier than so many of them.
    simpler = any("a smooth curve in its place is simpler" in told for told in result.sentences)
    remains = result.misfit.get("remains", not simpler)  # an older record says so in its sentences alone
    why = "structure remains that no cause describes" if remains else "a smooth curve in its place is more probable"
    if not remains and any(set(b.terms) == set(result.named) for b in result.laws):
        why = "it breaks a law that holds whatever the causes are"
    return head + Markup("The best extension is {}{}, but {} (probability of an unnamed discrepancy {}).{}{}").format(
        named, share, why, words.share(result.unnamed), _sizes(result) + _implausible(result), also
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
    """Values that whoever knows such rigs would not believe, of what is named first and of what does as well."""
    leader = words.listed_leader(result)
    text = Markup("")
    if leader and (odd := _odd(leader)):
        text = Markup(" <strong>{}</strong> of what is named first would surprise whoever knows such rigs: {}.").format(
            count(len(odd), "value"), _by_cause({name: symbol(name) for name in odd})
        )
    tied = [c for ids in result.alternatives[:3] for c in result.causes if c.terms == ids and _odd(c)]
    if tied and result.verdict == "ambiguous":
        each = listed(Markup("{} of {}").format(listed(map(symbol, _odd(c))), model(c.terms)) for c in tied)
        text += Markup(" {}: {}.").format("So would" if text else "Of the others these would surprise", each)
    return text


def _odd(cause: CauseResult) -> list[str]:
    """Implausible values of a rig; the scatter is the readings', not the rig's."""
    return [name for name in cause.implausible if name not in _SCATTER]


def _sizes(result: Diagnosis) -> Markup:
    """How large the causes are that are named, and those of the first sets that do as well."""
    leader = words.listed_leader(result)
    tied = [c for ids in result.alternatives[:2] for c in result.causes if c.terms == ids]
    own = _sized([leader] if leader else [])
    other = {name: text for name, text in _sized(tied).items() if name not in own}
    if not own:
        own, other = other, own
    more = Markup("; of the others that do as well: {}").format(_by_cause(other)) if other else ""
    return Markup(" Size, with 90{}% interval: {}{}.").format(NBSP, _by_cause(own), more) if own else Markup("")


def _sized(causes: Sequence[CauseResult]) -> dict[str, Markup]:
    """The values of models' own causes; where several have one, the first's."""
    found: dict[str, Markup] = {}
    told = [(c.terms, name, p) for c in causes for name, p in c.parameters.items()]
    for terms, name, p in told:
        if owner(name) in terms and name not in found:
            unit, (median, low, high) = words.estimate(p)
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
    return Markup(" A discrepancy without a name keeps {} of the probability.").format(words.share(result.unnamed))


def gained(result: Diagnosis) -> Markup:
    """What naming the causes is worth on readings that no choice has seen."""
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
        chosen = Markup(text).format(words.group_ids(result.training))
        if one and names_nothing(one):
            parts.append(chosen + ", no cause is named and nothing changes")
        elif one:
            parts.append(
                Markup("{}, the typical error on unseen groups goes from ×{} to ×{}"
                    " (change of log RMSE {} to {}, 90 %)"
                ).format(
                    chosen,
                    factor(known(one["log_rmse_before"])), factor(known(one["log_rmse_after"])),
                    *(typeset(fixed(known(x), 2, sign=True)) for x in one["log_rmse_interval"]),
                )
            )  # fmt: skip
            if lost := worse(one):
                parts[-1] += Markup(", but worse on {}").format(groups([g["group"] for g in lost]))
    text = Markup("; ").join(parts)
    return head + Markup("With causes and parameters ") + text + "."


def what_next(found: Mapping[str, Any]) -> list[Markup]:
    """The best proposal in a sentence, if it is worth the work."""
    best = recommended(found)
    about, more = words.about(str(found.get("about", ""))), Markup("<a href='#next'>More</a>")
    head = Markup("<strong>What next?</strong> ")
    if best is None and not found.get("proposals"):
        return []
    if best is None:
        first = found["proposals"][0]
        none = "No sweep that the rig allows {}: the best by {}. {}"
        if tells_apart(found):
            return [head + Markup(none).format(about, words.lead(first), more)]
        none = "No sweep that the rig allows would tell much more: the best {}, narrower by {}. {}"
        return [head + Markup(none).format(about, words.narrowing(first["separation"], first["error"]), more)]
    if tells_apart(found):
        what = Markup("{} with an expected lead of {}").format(about, words.lead(best))
    else:
        told = (
            "of which these readings tell little" if found.get("weak", True) else "of which a measurement can tell most"
        )
        what = Markup("{}, {}: it would narrow it by {}").format(about, told, words.narrowing(best["separation"]))
    return [head + Markup("Measure <em>{}</em>: that best {}. {}").format(typeset(best["text"]), what, more)]


def tiles(result: Diagnosis, shown: Sequence[Shown]) -> list[dict[str, str]]:
    """The key numbers: p values, and how far the models are off."""
    found = [{"value": p_value(known(result.misfit.get("p_value"))), "label": "p value: baseline against the readings"}]
    if "extended" in result.misfit:
        after = p_value(known(result.misfit["extended"].get("p_value")))
        what = "best causes, not adopted," if result.verdict == "adequate" else "extension"
        found.append({"value": after, "label": f"p value: {what} against the readings"})
    for k, curve in enumerate(shown[0].curves):
        errors = [g.errors[k] for g in shown]
        label = f"typical factor between {curve.name} and reading, fitted to all groups"
        if len(errors) > 1:
            label += f"; ×{factor(min(errors))} to ×{factor(max(errors))}"
        found.append({"value": f"×{factor(float(np.mean(errors)))}", "label": label})
    return found

"""Models, their parameters, what each cause gains, and which sets do as well: sections of a diagnosis' page."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from psafit.compare import known
from psafit.diagnose.confusable import Confounded
from psafit.diagnose.influence import Influence
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.models import (
    NEAREST,
    NEXT_BEST,
    NOT_EXCLUDED,
    NOT_PRESENT,
    UNSEEN,
    CauseResult,
    Evidence,
    ParameterResult,
    ScreeningResult,
)
from psafit.diagnose.words import NO_ACTION
from psafit.experiment import Group
from psafit.inference.evidence import TRUSTED
from psafit.report.catalogue import TITLES, cause, model, parameter
from psafit.report.diagnosis import words
from psafit.report.diagnosis.shown import Shown, image
from psafit.report.diagnosis.words import share
from psafit.report.figures.axes import label, scale_axis
from psafit.report.figures.influence import influence_figure
from psafit.report.page import Picture, figure_data_uri
from psafit.report.page_words import PAGE
from psafit.report.style import PALETTE, figure_style, new_figure
from psafit.report.wording import NBSP, interval, noted, number, span, typeset, with_unit
from psafit.text import count, fixed, significant

_SCREENED: Final = {
    "present": "bad",
    NEAREST: "warn",
    "as good": "bad",
    NEXT_BEST: "warn",
    "explains part alone": "warn",
    NOT_PRESENT: "good",
    NOT_EXCLUDED: "warn",
    UNSEEN: "warn",
    NO_ACTION: "",
}

_VERDICT_COLOR: Final = {
    "present": PALETTE["vermillion"],
    NEAREST: PALETTE["vermillion"],
    "as good": PALETTE["vermillion"],
    NEXT_BEST: PALETTE["vermillion"],
    "explains part alone": PALETTE["orange"],
    NOT_PRESENT: PALETTE["grey"],
    NOT_EXCLUDED: PALETTE["sky"],
    UNSEEN: PALETTE["sky"],
    NO_ACTION: PALETTE["faint"],
}

_HATCH: Final = {UNSEEN: "////", "as good": "....", NEXT_BEST: "...."}


def content(result: Diagnosis, shown: Sequence[Shown], pictured: Sequence[Shown]) -> dict[str, Any]:
    """The models of the record, what each cause gains, and the sets that do as well."""
    best = words.best_model_of(result)
    return {
        "models": model_rows(result),
        "best_model": None
        if best is None
        else _parameters(best) | {"fit": best.terms and PAGE.fit_command(result.groups, best.terms)},
        "other_models": [_parameters(c) for c in result.causes if c is not best],
        "best_model_listed": best is result.best_model,
        "influence": influence_pictures(result.influence, pictured) if result.influence else [],
        "leaning": leaning(result, shown),
        "robustness": robustness(result, best),
        "screening_pictures": screening_pictures(result.screening, TITLES, result.named),
        "screening": screening_rows(result.screening),
        "idle": any(s.verdict == NO_ACTION for s in result.screening),
        "alternatives": alternatives(result),
        "confounded": confounded(result.confusion.alike),
        "compared": bool(result.named),
    }


def model_rows(result: Diagnosis) -> list[list[Any]]:
    """The models of the record, and what is left for others."""
    rows: list[list[Any]] = []
    nothing = next((c.evidence for c in result.causes if not c.terms), None)
    for c in result.causes:
        e = c.evidence
        over = words.signed(e.over_baseline)
        if e.error is not None:
            over += f" ± {e.error:.2f}"
        strange: Any = "none"
        if c.implausible:
            strange = {"text": count(len(c.implausible), "value"), "kind": "bad"}
        width = e.prior_width or {}
        rows.append(
            [
                model(c.terms),
                f"{words.share(c.probability)} ({words.share(e.share)})",
                "–" if e.prior_odds is None else words.signed(e.prior_odds),
                over,
                words.signed(_by_sharing(e, nothing)),
                words.signed(e.gain),
                f"{words.signed(width['half'])} / {words.signed(width['twice'])}" if width and c.terms else "–",
                strange,
                _method(e),
            ]
        )
    if rows:
        listed_ones = sum(known(c.probability) for c in result.causes)
        others = max(1 - listed_ones - known(result.unnamed), 0.0)
        for name, share in (
            ("all other sets of causes, missed ones too", others),
            ("a discrepancy without a name", result.unnamed),
        ):
            rows.append([Markup("<em>{}</em>").format(name), words.share(share), *["–"] * 7])
    return rows


def _by_sharing(e: Evidence, nothing: Evidence | None) -> float:
    """What a set's log odds against no cause have from other sets, by causes that do not show, and by errors."""
    if nothing is None or e.prior_odds is None or not min(e.share, nothing.share) > 0:
        return math.nan
    return math.log(e.share / nothing.share) - e.prior_odds - e.over_baseline


def _method(evidence: Evidence) -> str:
    text = "Laplace" if evidence.effective_draws is None else f"{evidence.effective_draws:.0f}{NBSP}draws"
    if evidence.nautilus:
        text += f"; by nautilus {words.signed(evidence.nautilus.log_evidence - evidence.log_evidence)}"
    if (k := evidence.pareto_k) is not None:
        text += typeset(f", k{NBSP}{fixed(k, 2)}") + (" (the error is a guess)" if k > TRUSTED else "")
    return text


def _parameters(cause: CauseResult) -> dict[str, Any]:
    """A model's parameters, with its name."""
    rows: list[list[Any]] = []
    for name, p in cause.parameters.items():
        unit, (median, low, high) = words.estimate(p)
        spread = (high - low) / 2
        share = p.prior_share
        rows.append(
            [
                parameter(name, p.description),
                with_unit(number(median, spread if spread > 0 else None), unit),
                with_unit(interval(low, high, spread), unit) if high > low else "its optimum: not sampled",
                _at_prior(share),
                {"text": _not_expected(p), "kind": "bad"}
                if name in cause.implausible
                else "plausible"
                if math.isfinite(share)
                else "–",
            ]
        )
    return {"name": model(cause.terms), "rows": rows}


def _not_expected(p: ParameterResult) -> str:
    return "implausible" + (f": {span(p.prior_interval, p.unit)} expected" if p.prior_interval else "")


def _at_prior(share: float) -> str:
    if not math.isfinite(share):
        return "–"
    if share <= 0.0006:
        return f"under 0.1{NBSP}%"
    return f"over 99.9{NBSP}%" if share >= 0.9994 else f"{fixed(share, 1, per_cent=True)}{NBSP}%"


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


def influence_pictures(found: Influence, shown: Sequence[Shown]) -> list[Picture]:
    """For each cause, the readings by what they give it."""
    pictures = []
    for c in found.causes:
        nats = np.array([known(x) for x in c.nats])
        given = [nats[g.rows] for g in shown]
        alt = f"Readings of {count(len(shown), 'sweep')} coloured by what they give {TITLES.get(c.cause, c.cause)}."
        groups = "; ".join(f"group {g} {fixed(x, 1, sign=True)}" for g, x in c.groups)
        caption = f"{TITLES.get(c.cause, c.cause)}: {fixed(c.total, 1)} nats ({groups}). {count(c.half, 'reading')}"
        verb = "gives" if c.half == 1 else "give"
        caption += f" of {nats.size} {verb} half of what speaks for it. Blue readings speak against it."
        most = float(np.nanmax(np.abs(nats)))
        figure = influence_figure([g.group for g in shown], [g.sweep for g in shown], given, most=max(most, 1e-9))
        pictures.append(Picture(image(figure, len(found.causes)), alt, typeset(caption)))
    return pictures


def leaning(result: Diagnosis, shown: Sequence[Shown], most: int = 12) -> list[list[Any]]:
    """Readings, `most` of them, on which alone the adopted model leans, by the tail of their weights."""
    tail = np.array(result.influence.tail if result.influence else [], dtype=float)
    if tail.size != sum(g.group.n_points for g in shown):
        return []
    far = [(float(tail[row]), g, k) for g in shown for k, row in enumerate(g.rows) if tail[row] > TRUSTED]
    return [
        [
            Markup("Group {}{}").format(g.group.id, _moment(g.group, k)),
            words.quantity(float(g.group.frequency_hz[k]), "Hz"),
            words.quantity(float(g.group.amplitude_v[k]), "V"),
            fixed(value, 2),
        ]
        for value, g, k in sorted(far, key=lambda row: -row[0])[:most]
    ]


def _moment(group: Group, row: int) -> str:
    """Which sample of a trace a reading is; nothing of a launch as a whole."""
    return "" if group.time_us is None else f", at {words.quantity(float(group.time_us[row]), 'us')}"


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
            words.share(included(s)),
        ]
        for s in screening
    ]


def included(s: ScreeningResult) -> float:
    """Probability that it is part of the truth; nan where the readings say nothing of that.

    Where it does not show, its model counts as the model without it: unless it is excluded, nothing of it is no share.
    """
    unknown = s.verdict in (UNSEEN, NO_ACTION) or (s.verdict != NOT_PRESENT and s.inclusion == 0.0)
    return math.nan if unknown else s.inclusion


def screening_pictures(
    screening: Sequence[ScreeningResult], titles: Mapping[str, str], named: Sequence[str]
) -> list[Picture]:
    """What each cause gains alone, and how probable it is that it is part of the truth: two bar charts.

    Parameters
    ----------
    screening : sequence of ScreeningResult
    titles : dict
        Of causes, by id.
    named : sequence of str
        Causes that were adopted.
    """
    if not screening:
        return []
    names = [titles.get(s.id, s.id) for s in screening]
    present = [name for name, s in zip(names, screening, strict=True) if s.verdict in ("present", NEAREST)]
    shares = [included(s) for s in screening]
    gains = _bars(names, [s.refit_gain for s in screening], screening, named, "Gain, refitted (nats)", _nats, None)
    inclusion = _bars(names, shares, screening, named, "Inclusion probability", share, (0.0, 1.0))
    return [
        Picture(
            figure_data_uri(gains),
            f"Gain of the log likelihood when the baseline is refitted with one cause: most,"
            f" {number(screening[0].refit_gain)} nats, for {names[0]}; {len(screening)} causes.",
            "What each cause alone makes of the baseline, refitted. Bold: adopted.",
        ),
        Picture(
            figure_data_uri(inclusion),
            "Inclusion probability of each cause over all models: above one half for"
            f" {', '.join(present) if present else 'none'}.",
            "Summed over all models that contain the cause. A cause may gain much alone and yet not be needed with"
            " another one. Where it does not show, its model counts as the model without it. Little, or a dash: not"
            " needed, or not to be seen; these readings do not say whether it is at work.",
        ),
    ]


def _nats(value: float) -> str:
    text = fixed(value, 0 if abs(value) >= 100 else 1).replace("-", "\N{MINUS SIGN}")
    return text if np.isfinite(value) else "–"


def _bars(
    names: Sequence[str], values: Sequence[float], screening: Sequence[ScreeningResult], adopted: Sequence[str],
    quantity: str,
    text: Callable[[float], str],
    limits: tuple[float, float] | None,
    stub: float = 0.02,
) -> Figure:  # fmt: skip
    with figure_style():
        wrapped = [textwrap.fill(n, 31, max_lines=2, placeholder="…", break_on_hyphens=False) for n in names]
        rooms = np.array([1.0 + 0.5 * n.count("\n") for n in wrapped])  # a name of two lines takes more
        figure, axes = new_figure(height=1.45 + 0.235 * float(rooms.sum()))
        at = rooms.sum() - np.cumsum(rooms) + rooms / 2
        lengths = np.nan_to_num(np.asarray(values, dtype=float))
        low, high = limits or (min(0.0, float(lengths.min())), max(float(lengths.max()), 1.0))
        span = high - low
        # A bar of no length still shows the colour of its verdict: it takes this share of the axis.
        drawn = np.where(np.abs(lengths) < stub * span, stub * span, lengths)
        for word, color in _VERDICT_COLOR.items():
            mine = np.array([s.verdict == word for s in screening])
            if mine.any():
                axes.barh(
                    at[mine], drawn[mine], height=0.68, color=color, hatch=_HATCH.get(word), edgecolor="white", lw=0
                )
        for y, value, length in zip(at, values, lengths, strict=True):
            axes.annotate(
                text(float(value)), (max(float(length), 0.0), float(y)), (3, 0), textcoords="offset points",
                va="center", fontsize=8.5, color=PALETTE["ink"],
            )  # fmt: skip
        scale_axis(axes, "x", low, high + 0.22 * span, log=False, few=True)
        axes.set_ylim(-0.2, rooms.sum() + 0.2)
        axes.set_yticks(at, [label(n, 64) for n in wrapped], fontsize=8.5, linespacing=0.9)
        for tick, s in zip(axes.get_yticklabels(), screening, strict=True):
            tick.set_fontweight("bold" if s.id in adopted else "normal")
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel(quantity)
        handles = [
            Patch(facecolor=c, hatch=_HATCH.get(w), edgecolor="white", lw=0, label=w)
            for w, c in _VERDICT_COLOR.items()
            if any(s.verdict == w for s in screening)
        ]
        figure.legend(handles=handles, loc="outside upper left", ncols=2, fontsize=8.5)
    return figure


def alternatives(result: Diagnosis, most: int = 12) -> dict[str, Any]:
    """Sets that are reported with the named one, `most` of them."""
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
                "it fits as well" if ids in result.by_likelihood else "its probability",
                ("sampled" if c.sampled else "estimated from a short fit") if c else "–",
            ]
        )
    return {
        "named": model(result.named) if result.named else None,
        "tied": result.verdict != "unexplained",
        "rows": rows,
        "more": max(0, len(result.alternatives) - most),
    }


def no_alternative(result: Diagnosis) -> str:
    """What is said where no set is tied with what is named; of other sets it claims no more than was looked at."""
    if result.verdict == "adequate":
        return "No cause is needed. What the readings leave the other sets stands in the table of models."
    if not result.named:
        return "No set of causes that was fitted stands out from the baseline, which does not explain the readings."
    what = "set of these causes" if result.left_out else "set of causes"
    other = result.looked_at.no_other(what)
    best = " as the best, which does not explain the readings" if result.verdict == "unexplained" else ""
    return f"{other.capitalize()} does as well{best}."


def confounded(pairs: Sequence[Confounded], most: int = 12) -> list[list[Any]]:
    """Pairs of causes that are confounded, `most` of them, and by which angle they differ."""
    return [[model([pair.cause]), model([pair.other]), f"{pair.degrees:.0f}°"] for pair in pairs[:most]]

"""What the causes leave unexplained: a section of a diagnosis' page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from psafit.arrays import FloatArray
from psafit.compare import known
from psafit.diagnose.misfit import ALPHA, described
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.misfit import Tests
from psafit.diagnose.significance import OTHERWISE, Significance
from psafit.observables import aside
from psafit.records import Objection
from psafit.report.diagnosis import words
from psafit.report.diagnosis.shown import Shown, image
from psafit.report.figures.axes import scale_axis, scale_sweep
from psafit.report.figures.groups import title
from psafit.report.page import Picture, first
from psafit.report.style import BAND, PALETTE, figure_style, new_figure
from psafit.report.wording import NBSP, factor, listed, p_value, percent, typeset
from psafit.text import fixed, significant

_OBJECTS: Final[dict[Objection, str]] = {
    "": "",
    "tests": "",
    "together": "But readings of several groups stand out together, so the model is not sound",
    "tails": "But they do so only because heavy tails take up what stands out, so the model is not sound",
}

_LOOKS_AT: Final = {
    "mean": "the physics",
    "spread": "the law of the scatter",
    "point": "single readings",
    "replicate": "sessions at the same condition",
    "all": "anything",
}


def content(result: Diagnosis, shown: Sequence[Shown]) -> dict[str, Any]:
    """The tests of both models, the searches where nothing is hidden, and the discrepancy."""
    return {
        "tests_before": tests(result.misfit.baseline),
        "search": search(result.misfit.search),
        "tests_after": tests(result.misfit.extended) if result.misfit.extended else None,
        "discrepancy": discrepancy(result, shown),
    }


def tests(tests: Tests, most: int = 10, small: float = 0.05) -> dict[str, Any]:
    """What the tests of one model found, `most` of them, the most striking first; how often a p value is `small`."""
    odd = [Markup("reading {} of group {}").format(k + 1, g) for g, k in tests.odd_points]
    return {
        "p": words.p_text(tests.p_value, tests.floor),
        "wrong": tests.p_value < ALPHA,
        "sound": not tests.objection,
        "objection": _OBJECTS[tests.objection],
        "least": words.p_text(tests.least, tests.floor),
        "character": described(tests.character, tests.statistics),
        "n_simulated": tests.n_simulated,
        "refit": "refitted with the model itself" if tests.refit == "exact" else "refitted with its expansion",
        "odd_groups": words.group_ids(tests.odd_groups) if tests.odd_groups else None,
        "odd_points": listed(odd) if odd else None,
        "n_statistics": len(tests.statistics),
        "small": f"{small:g}",
        "expected": significant(small * len(tests.statistics), 1),
        "rows": [
            [
                s.name,
                "all" if s.group is None else Markup("group {}").format(s.group),
                _LOOKS_AT.get(s.kind, s.kind),
                typeset(fixed(s.excess, 2)),
                p_value(s.p_value, tests.floor),
                {"text": "yes", "kind": "bad" if tests.p_value < ALPHA else "warn"} if s.significant else "no",
            ]
            for s in tests.statistics[:most]
        ],
    }


def search(found: Significance | None) -> dict[str, Any] | None:
    """How often a search finds as much where nothing is hidden."""
    if not found:
        return None
    p, n = found.p_value, len(found.null)
    if p is None:
        return {"n": 0, "missing": OTHERWISE[found.missing]}
    least = p <= 1 / (n + 1)
    return {
        "n": n,
        "lead": words.nats(found.lead),
        "most": words.nats(max(found.null)),
        "p": f"{'≤' if least else '='} {significant(p, 2)}" + (f", the least that {n} can show" if least else ""),
        "readings": " to ".join(str(m) for m in found.readings) if found.stored else "",
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
                Markup("Group {}{}").format(g.group, aside(g.observable)),
                *("–" if x is None else f"×{factor(x)}" for x in (g.mean, g.largest)),
            ]
            for g in left.groups
        ],
        "pictures": discrepancy_pictures(first(shown), mean, sd) if whole else [],
    }


def discrepancy_pictures(shown: Sequence[Shown], mean: FloatArray, sd: FloatArray) -> list[Picture]:
    """What no named cause describes, group by group.

    Parameters
    ----------
    shown : sequence of Shown
        All groups of the record, in its order.
    mean, sd : (n_points,) arrays
        ``ln(reading/prediction)`` of the discrepancy; `sd` is NaN where the readings say nothing.
    """
    parts = [(g, mean[g.rows], sd[g.rows]) for g in shown if np.isfinite(sd[g.rows]).any()]
    if not parts:
        return []
    reach = float(np.clip(max(np.nanmax(np.abs(m) + 1.645 * s) for _, m, s in parts), 0.05, 3.0))
    return [_discrepancy(g, m, s, reach, len(parts)) for g, m, s in parts]


def _discrepancy(g: Shown, mean: FloatArray, sd: FloatArray, reach: float, n: int) -> Picture:
    heard = np.isfinite(sd)
    order = np.argsort(g.sweep.values[heard], kind="stable")
    x, m, s = (a[heard][order] for a in (g.sweep.values, mean, sd))
    with figure_style():
        figure, axes = new_figure(height=2.5)
        axes.axhline(1.0, color=PALETTE["grey"], lw=1.0)
        axes.fill_between(x, np.exp(m - 1.645 * s), np.exp(m + 1.645 * s), color=PALETTE["purple"], **BAND)
        axes.plot(x, np.exp(m), color=PALETTE["purple"], marker="." if x.size < 3 else None)
        scale_axis(axes, "y", float(np.exp(-reach)), float(np.exp(reach)), log=True)
        scale_sweep(axes, g.sweep)
        axes.set_xlabel(g.sweep.label)
        axes.set_ylabel("Reading / prediction")
        title(axes, g.group.id, g.sweep.held)
    low, high = factor(float(m.min())), factor(float(m.max()))
    return Picture(
        image(figure, n),
        f"Discrepancy against {g.sweep.over}, group {g.name}: readings ×{low} to ×{high} of the prediction.",
        f"×{low} to ×{high}; band: 90 %.",
    )

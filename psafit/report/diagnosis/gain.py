"""What naming the causes is worth on unseen readings: a section of a diagnosis' page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from psafit.compare import known
from psafit.diagnose.gain import Choice, Gain
from psafit.diagnose.record import Diagnosis
from psafit.model_search.model_set import set_of
from psafit.report.catalogue import model
from psafit.report.diagnosis import words
from psafit.report.figures.axes import label, scale_axis
from psafit.report.figures.groups import short
from psafit.report.page import Picture, figure_data_uri
from psafit.report.style import PALETTE, figure_style, new_figure
from psafit.report.wording import compared, factor, listed, noted, number, typeset
from psafit.text import fixed

_PROTOCOLS: Final = {
    "strict": "Causes and parameters chosen on the training groups alone, every other group scored.",
    "nested": "For each group, causes and parameters chosen on all the others, then that group scored.",
}


def content(result: Diagnosis) -> dict[str, Any]:
    """Both protocols' gains, the runs of the extension, and which data each choice saw."""
    return {
        "gains": [protocol(one) for one in result.gain.values()],
        "extension": {"adopted": None, "strict": None}
        | {
            which: vars(run) | {"model": model(run.terms), "compared": typeset(compared(**vars(run.importance)))}
            for which, run in result.extension.items()
        },
        "ledger": ledger(result.ledger),
        "begun": any(entry.led_to is not None for entry in result.ledger),
    }


def protocol(gain: Gain) -> dict[str, Any]:
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
        "picture": gain_picture(gain),
        "predictions": gain.predictions,
    }


def gain_picture(gain: Gain) -> Picture:
    """Error of each unseen group, before and after."""
    rows, protocol = gain.groups, gain.protocol
    before = np.array([r.log_rmse_before for r in rows])
    after = np.array([r.log_rmse_after for r in rows])
    with figure_style():
        figure, axes = new_figure(height=1.35 + 0.32 * (len(rows) + 1))
        at = np.arange(len(rows) + 1)[::-1]
        means = (gain.log_rmse_before, gain.log_rmse_after)
        b, a = np.append(before, means[0]), np.append(after, means[1])
        axes.hlines(at, np.minimum(a, b), np.maximum(a, b), color=PALETTE["faint"], lw=3, zorder=1)
        axes.plot(b, at, "s", ms=6.5, mfc="white", mec=PALETTE["grey"], mew=1.6, label="before: baseline", zorder=3)
        axes.plot(a, at, "o", ms=7, color=PALETTE["vermillion"], label="after: extended", zorder=3)
        low, high = (means[0] + c for c in gain.log_rmse_interval)
        axes.plot([low, high], [0, 0], color=PALETTE["vermillion"], lw=2.2, alpha=0.5, zorder=2)
        axes.axhline(0.5, color=PALETTE["grey"], lw=0.8)
        axes.set_yticks(at, [*(label(f"group {short(r.group)}") for r in rows), "mean, 90 %"])
        axes.set_ylim(-0.6, len(rows) + 0.4)
        most = max(float(b.max()), float(a.max()), 0.1)
        scale_axis(axes, "x", 0.0, 1.08 * max(most, min(high, 1.5 * most)), log=False)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("Log RMSE of readings not seen (0 is perfect)")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    each = "; ".join(
        f"group {r.group} {b:.3f} before, {a:.3f} after" for r, b, a in zip(rows, before, after, strict=True)
    )
    return Picture(
        figure_data_uri(figure),
        f"Log RMSE on unseen groups, {protocol} protocol: {each}.",
        f"The {protocol} protocol: error of each group that no choice had seen. Bar: 90 % interval of the mean after,"
        " from the bootstrap of the change.",
    )


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

"""The challenge page: how far the verdicts can be trusted. Results in, page out; nothing here computes a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from psafit.challenge.score import SEEN_NATS, GainBin, Mean, ProbabilityBin, Rate, Recovery, Score, so_far
from psafit.report.figures.axes import label as tick
from psafit.report.page import figure_data_uri, render
from psafit.report.style import PALETTE, WIDE, figure_style, new_figure
from psafit.report.wording import NBSP, percent, typeset
from psafit.text import count, fixed


def write_page(score: Score, out_path: Path, provenance: Mapping[str, str] | None = None) -> Path:
    """Write the page of a score.

    Parameters
    ----------
    score : Score
    out_path : Path
        The HTML file.
    provenance : mapping of str to str, optional
        Footer: version, command and the like.

    Returns
    -------
    Path
    """
    with figure_style():
        drawn = draw(score)
    sections = [("targets", "Targets"), ("finding", "Finding and naming")]
    sections += [("confusion", "What is taken for what")] if score.confusion else []
    sections += [("parameters", "Parameters")] if score.recovery else []
    sections += [("outside", "Effects outside the catalogue")] if score.outside else []
    return render(
        "challenge.html.j2",
        out_path,
        provenance=dict(provenance or {}),
        score=score,
        verdict=_verdict(score),
        sentences=_sentences(score),
        tiles=_tiles(score),
        sections=[*sections, ("misses", "Misses")],
        uris={name: figure_data_uri(figure) for name, figure in drawn.items()},
        targets=[
            [
                t.what,
                _held(t.target),
                _share(t.value),
                _interval(t.rate),
                f"{t.rate.k} of {t.rate.n}",
                {"text": t.verdict, "kind": _KINDS[t.holds] if t.sure else "warn"},
            ]
            for t in score.targets
        ],
        gains=[
            [
                f"{b.lower:g} or more" if b.upper is None else f"{b.lower:g} to {b.upper:g}",
                str(b.named.n),
                *(f"{_share(r.share)} ({_interval(r)})" if r.n else "–" for r in (b.detected, b.named, b.in_set)),
            ]
            for b in score.by_gain
        ],
        designs=[[kind, str(r.n), f"{_share(r.share)} ({_interval(r)})"] for kind, r in score.by_design.items()],
        outside=[[name, ", ".join(f"{v}: {n}" for v, n in said.items())] for name, said in score.outside.items()],
        misses=[
            [r.id, r.truth, f"{r.gain:.0f}", r.verdict, r.named, "yes" if r.in_set else "no", str(r.seed)]
            for r in score.rows
            if r.missed
        ],
        seen_nats=f"{SEEN_NATS:g}",
    )


def draw(score: Score) -> dict[str, Figure]:
    """The page's figures, those for which there is something to draw: gain, reliability, confusion, recovery."""
    drawn = {"gain": _gain_figure(score.by_gain), "reliability": _reliability_figure(score)}
    if score.confusion:
        drawn["confusion"] = _confusion_figure(score.confusion, {r.named: r.n_named for r in score.rows})
    if score.recovery:
        drawn["recovery"] = _recovery_figure(score.recovery)
    return drawn


_KINDS = {True: "good", False: "bad", None: "warn"}


def _share(share: float | None) -> str:
    return "–" if share is None else percent(share)


def _interval(r: Rate) -> str:
    return (
        "–"
        if r.lower is None or r.upper is None
        else f"{fixed(r.lower, per_cent=True)} to {fixed(r.upper, per_cent=True)}{NBSP}%"
    )


def _wanted(r: Rate) -> str:
    return f"; 95{NBSP}%: {_interval(r)}" if r.n else ""


def _between(m: Mean) -> str:
    if m.lower is None or m.upper is None:
        return ""
    return typeset(f"; 95{NBSP}%: {fixed(m.lower, 2)} to {fixed(m.upper, 2)}")


def _held(text: str) -> str:
    """Keep a number and its sign on one line."""
    return text.replace(" %", f"{NBSP}%")


def _verdict(score: Score) -> dict[str, str]:
    asked = [t for t in score.targets if t.holds is not None]
    missed = [t for t in asked if not t.holds]
    if missed:
        sure = any(t.sure for t in missed)
        return {"text": f"misses {len(missed)} of {len(asked)}{so_far(sure)}", "kind": "bad" if sure else "warn"}
    if len(asked) < len(score.targets):
        return {"text": "holds where asked" if asked else "not asked", "kind": "warn"}
    sure = all(t.sure for t in asked)
    return {"text": f"holds{so_far(sure)}", "kind": "good" if sure else "warn"}


def _every(score: Score) -> str:
    asked = [t for t in score.targets if t.holds is not None]
    of = f"{len(asked)} of {count(len(score.targets), 'target')}"
    return f"{of} could be asked, and held{so_far(all(t.sure for t in asked))}; the table says of how many."


def _sentences(score: Score) -> list[Markup]:
    failed = f"; {score.n_failed} without a verdict, which count as misses" if score.n_failed else ""
    missed = [t for t in score.targets if t.holds is False]
    listing = Markup("; ").join(
        Markup("{} (wanted {}, found {}{})").format(t.what, _held(t.target), _share(t.value), so_far(t.sure))
        for t in missed
    )
    alarms, seen = score.false_alarms, [r for r in score.rows if r.kind != "nothing" and r.gain >= SEEN_NATS]
    inexact = [r for r in seen if r.missed]
    return [
        Markup(
            "<strong>Asked:</strong> {} with a known truth {} diagnosed{}. Strength is what an oracle gains, in nats:"
            " the log likelihood of the true model, fitted, less that of the baseline, refitted."
        ).format(count(score.n, "data set"), "was" if score.n == 1 else "were", failed),
        Markup("<strong>Can the verdicts be trusted?</strong> {}").format(
            Markup("Not in: {}.").format(listing) if missed else _every(score)
        ),
        Markup(
            "<strong>What goes wrong?</strong> False alarms: {} of {} with nothing hidden. Of {} effects that an oracle"
            " sees with {} nats or more {} were not named exactly; of these {} had the truth in the set."
        ).format(alarms.k, alarms.n, len(seen), f"{SEEN_NATS:g}", len(inexact), sum(r.in_set for r in inexact)),
    ]


def _tiles(score: Score) -> list[dict[str, str]]:
    def seconds(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f}{NBSP}s"

    alarms, covered, drawn, printed = score.false_alarms, score.coverage, score.coverage_believed, score.log_score
    return [
        {"value": _share(alarms.share),
         "label": f"false alarms of {count(alarms.n, 'data set')} with nothing hidden{_wanted(alarms)}"},
        {"value": _share(covered.share),
         "label": f"of {count(covered.n, 'parameter interval')} hold the truth{_wanted(covered)}"},
        {"value": _share(drawn.share),
         "label": f"of {count(drawn.n, 'interval')} whose truth was drawn from the priors{_wanted(drawn)}"},
        {"value": "–" if printed.mean is None else f"{typeset(fixed(printed.mean, 2))}{NBSP}nats",
         "label": f"log score of the probabilities, of {count(printed.n, 'data set')}"
         + _between(printed)},
        {"value": seconds(score.seconds["median"]), "label": "median time of a diagnosis"},
        {"value": seconds(score.seconds["p90"]), "label": "nine of ten are done by"},
    ]  # fmt: skip


def _bars(axes: Axes, x: Sequence[float], rates: Sequence[Rate], color: str, label: str, marker: str) -> None:
    """Rates with their intervals."""
    for at, r in zip(x, rates, strict=True):
        if r.lower is not None and r.upper is not None:
            axes.plot([at, at], [r.lower, r.upper], color=color, lw=1.3, alpha=0.6)
    shown = [(at, r.share) for at, r in zip(x, rates, strict=True) if r.share is not None]
    axes.plot([at for at, _ in shown], [y for _, y in shown], marker=marker, color=color, ms=5.5, lw=1.2, label=label)


def _gain_figure(bins: Sequence[GainBin]) -> Figure:
    figure, axes = new_figure()
    x = np.arange(len(bins), dtype=float)
    kinds: tuple[tuple[str, Callable[[GainBin], Rate], str, str], ...] = (
        ("verdict not adequate", lambda b: b.detected, "blue", "o"),
        ("truth in the set", lambda b: b.in_set, "green", "s"),
        ("named, or first of a tie", lambda b: b.named, "vermillion", "^"),
    )
    for k, (label, pick, color, marker) in enumerate(kinds):
        _bars(axes, list(x + 0.14 * (k - 1)), [pick(b) for b in bins], PALETTE[color], label, marker)
    names = [f"≥{b.lower:g}" if b.upper is None else f"{b.lower:g}–{b.upper:g}" for b in bins]
    axes.set_xticks(list(x), [f"{name}\n(n={b.named.n})" for name, b in zip(names, bins, strict=True)], fontsize=8)
    axes.set_ylim(-0.03, 1.03)
    axes.set_xlabel("Oracle gain (nats)")
    axes.set_ylabel("Share of data sets")
    axes.set_title("One cause hidden")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _reliability_figure(score: Score) -> Figure:
    figure, axes = new_figure()
    axes.plot([0, 1], [0, 1], color=PALETTE["grey"], lw=1.0, ls="--", label="perfect")
    kinds: tuple[tuple[str, Sequence[ProbabilityBin], str, str, float], ...] = (
        ("all data sets", score.reliability, "blue", "o", 0.0),
        ("truths drawn from the priors", score.believed, "vermillion", "s", 0.012),
    )
    for label, bins, color, marker, aside in kinds:
        filled = [b for b in bins if b.mean is not None]
        at = [(b.mean or 0.0) + aside for b in filled]
        _bars(axes, at, [b.right for b in filled], PALETTE[color], label, marker)
        # How many, in a row for each kind below all that is drawn; neighbours take turns.
        for k, (x, b) in enumerate(zip(at, filled, strict=True)):
            row = (-0.075 if aside == 0.0 else -0.19) - 0.045 * (k % 2)
            axes.annotate(f"{b.right.n}", (x, row), ha="center", va="center", fontsize=8, color=PALETTE[color])
    axes.set_xlim(-0.03, 1.05)
    axes.set_ylim(-0.27, 1.03)
    axes.set_yticks(np.linspace(0, 1, 6))
    axes.set_xlabel("Printed probability")
    axes.set_ylabel("Share that was the truth")
    axes.set_title("Reliability of the probabilities")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def _confusion_figure(table: Mapping[str, Mapping[str, int]], causes: Mapping[str, int]) -> Figure:
    truths = list(table)
    # What takes several causes together is no name: how many they are says enough.
    several = {2: "two causes", 3: "three causes", 4: "four or more"}
    short = {
        name: name if name in truths or causes.get(name, 0) < 2 else several[min(causes[name], 4)]
        for row in table.values()
        for name in row
    }
    last = ["", *several.values()]
    said = sorted(set(short.values()), key=lambda n: (n not in truths, last.index(n) if n in last else 0, n))
    counts = np.zeros((len(truths), len(said)))
    for i, row in enumerate(table.values()):
        for name, n in row.items():
            counts[i, said.index(short[name])] += n
    share = counts / counts.sum(axis=1, keepdims=True)
    figure, axes = new_figure(width=WIDE, height=2.2 + 0.24 * len(truths))
    axes.imshow(share, cmap="Blues", vmin=0, vmax=1.2, aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        axes.text(
            j,
            i,
            f"{counts[i, j]:.0f}",
            ha="center",
            va="center",
            fontsize=8,
            color="white" if share[i, j] > 0.6 else PALETTE["ink"],
        )
    axes.set_xticks(range(len(said)), [tick(name) for name in said], rotation=60, ha="right", fontsize=8)
    axes.set_yticks(range(len(truths)), [tick(name) for name in truths], fontsize=8)
    axes.grid(visible=False)
    axes.set_xlabel("Named")
    axes.set_ylabel("Hidden")
    return figure


def _recovery_figure(recovery: Sequence[Recovery]) -> Figure:
    figure, axes = new_figure(height=1.4 + 0.2 * len(recovery))
    rows = np.arange(len(recovery))
    for row, r in zip(rows, recovery, strict=True):
        if r.covered.lower is not None and r.covered.upper is not None:
            axes.plot([r.covered.lower, r.covered.upper], [row, row], color=PALETTE["blue"], lw=1.4, alpha=0.6)
    axes.plot([r.covered.share or 0.0 for r in recovery], rows, "o", color=PALETTE["blue"], ms=5)
    axes.axvline(0.9, color=PALETTE["grey"], lw=1.0, ls="--")
    axes.set_yticks(list(rows), [r.name for r in recovery], fontsize=8)
    axes.set_ylim(len(recovery) - 0.5, -0.5)
    axes.set_xlim(-0.03, 1.03)
    axes.set_xlabel("Intervals that hold the truth")
    axes.set_title("Parameters of named causes")
    return figure


__all__ = ["draw", "write_page"]

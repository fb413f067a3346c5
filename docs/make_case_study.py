"""Draw the case study's figures from the diagnosis that `make diagnose GROUP=1` leaves in fits/psa-diagnosis."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "fits" / "psa-diagnosis"
OUT = ROOT / "docs" / "figures"


def unseen(table: Path) -> Figure:
    """Measured against both models, each group predicted without having been seen."""
    from psafit.compare import read_predictions
    from psafit.report import figures
    from psafit.validate import log_ratio, root_mean_square

    reported = [read_predictions(table, model) for model in ("extended", "baseline")]
    curves, titles = [], []
    for e, b in zip(*reported, strict=True):
        band = figures.Band(figures.READING_BAND, e.lower, e.upper)
        extended = figures.Curve("extended", "vermillion", e.median, (band,))
        curves.append([extended, figures.Curve("baseline", "grey", b.median, dashed=True)])
        after, before = (root_mean_square(log_ratio(t.median, t.group.reading)) for t in (e, b))
        titles.append(f"Group {e.group.id}: log RMSE {before:.2f} → {after:.2f}")
    groups = [t.group for t in reported[0]]
    figure = figures.groups_figure(groups, [figures.sweep_of(g) for g in groups], curves)
    for axes, title in zip(figure.axes, titles, strict=True):
        axes.set_title(title)
    return figure


def main() -> int:
    if not (RUN / "diagnosis.json").exists():
        print("no fits/psa-diagnosis: run make diagnose GROUP=1 first; the case study's figures stay as they are")
        return 0
    from psafit.report.style import PALETTE, figure_style

    result = json.loads((RUN / "diagnosis.json").read_text())
    with figure_style():
        for protocol, gain in result["gain"].items():
            figure = unseen(RUN / gain["predictions"])
            figure.savefig(OUT / f"case-{protocol}.png", dpi=150)
        figure = Figure(figsize=(10.5, 3.4), layout="constrained")
        growth = [g for g in result["show"]["baseline"]["growth"] if g["variable"] == "amplitude"]
        extended = {g["group"]: g for g in result["show"].get("extended", {}).get("growth", [])}
        for axes, g in zip(figure.subplots(1, len(growth), squeeze=False, sharey=True)[0], growth, strict=True):
            axes.fill_between(g["at"], g["lower"], g["upper"], color=PALETTE["ink"], alpha=0.15, lw=0)
            axes.plot(g["at"], g["measured"], color=PALETTE["ink"], label="measured, 90 % band")
            axes.plot(g["at"], g["simulated"], color=PALETTE["grey"], linestyle="--", label="baseline")
            if g["group"] in extended:
                e = extended[g["group"]]
                axes.plot(e["at"], e["simulated"], color=PALETTE["vermillion"], label="extended")
            axes.set(title=f"Group {g['group']}", xlabel="Drive amplitude (V)")
        figure.axes[0].set_ylabel("Growth d ln L / d ln V")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.savefig(OUT / "case-growth.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())

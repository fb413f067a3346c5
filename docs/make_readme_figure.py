"""Draw the README's picture of a found cause, from a diagnosis of the data set gap_and_slew.

Its readings come from a simulation that shares no code with psafit; a gap and a slew limit were hidden in them:

    python benchmarks/search.py --only gap_and_slew --write fits/sets
    psafit diagnose fits/sets/gap_and_slew --quick
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "docs" / "figures" / "found.png"
# By group: what to point at (a place, where the words stand), and what is said of it, from the parameters.
NOTES = {
    2: ((2.3, 33.0), (6.0, 24.0), "gap at rest: {gap_width:.2f} µm"),
    3: ((13500.0, 270.0), (400.0, 190.0), "amplifier's slew limit: {slew:.2f} V/µs"),
}


def draw(folder: Path, file: Path) -> None:
    """One panel a cause: readings, the baseline before, and the model with the causes after."""
    from matplotlib.figure import Figure

    import psafit
    from psafit.report import figures
    from psafit.report.diagnosis import shown_groups
    from psafit.report.style import PALETTE, figure_style

    found = psafit.load_diagnosis(folder)
    median = found.parameters["median"]
    values = {"gap_width": 1e6 * median["gap_width"], "slew": 1e-6 / median["slew_limit_inverse"]}
    shown = {g.group.id: g for g in shown_groups(found.record, found.experiment, folder)}
    share = found.causes["probability"].iloc[0]
    with figure_style():
        figure = Figure(figsize=(9.0, 3.9), layout="constrained")
        for axes, (group, (place, words, text)) in zip(figure.subplots(1, 2), NOTES.items(), strict=True):
            g = shown[group]
            before, after = g.curves
            curves = [replace(before, name="before: fitted simulation"), replace(after, name="after: with both causes")]
            figures.draw_curves(axes, g.group, g.sweep, curves)
            look = {"arrowstyle": "->", "color": PALETTE["ink"], "shrinkA": 2, "shrinkB": 3}
            axes.annotate(text.format(**values), place, words, arrowprops=look, color=PALETTE["ink"], fontsize=10)
            axes.set(title=g.title, xlabel=g.sweep.label, ylabel="Launch range (µm)")
        figure.suptitle(
            f"Found: {' + '.join(found.named).replace('_', ' ')}, probability {100 * share:.0f} %",
            x=0.01, ha="left", fontsize=12, fontweight="bold", color=PALETTE["vermillion"],
        )  # fmt: skip
        legend = figures.handles(curves[::-1])
        legend[0].set_label("readings")  # another program's, not measured
        figure.legend(handles=legend, loc="outside lower center", ncols=4)
        figure.savefig(file, dpi=150)


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "fits" / "gap_and_slew-diagnosis"
    if not (folder / "diagnosis.json").exists():
        print(f"no {folder}: the commands above make it; the picture stays as it is")
        return 0
    draw(folder, FILE)
    return 0


if __name__ == "__main__":
    sys.exit(main())

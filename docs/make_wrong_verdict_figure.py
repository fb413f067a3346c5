"""Draw the picture of docs/wrong-verdict.md: readings over prediction, at the parameters that version 0.1.0 fitted.

It needs the readings in fits/sets/narrow_resonance:

    python benchmarks/search.py --only narrow_resonance --write fits/sets
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "docs" / "figures" / "wrong-verdict.png"
FITTED = {"k_c": 5.6e5, "c_s": 7700.0, "c_c": 65.0}
SWEEPS = {"sine10V": ("blue", "o"), "square12V": ("green", "s")}
ODD_HZ, TRUE_HZ, HALF_HZ = 2480.0, 2500.0, 250.0  # the readings that stand out; middle and half width of what is hidden


def draw(folder: Path, file: Path) -> None:
    """The ratio over frequency in both sweeps, the hidden resonance in grey."""
    from matplotlib.figure import Figure

    from psafit.experiment import read_experiment
    from psafit.report.style import PALETTE, figure_style, plain_log_ticks
    from psafit.simulate import Design, simulate

    experiment = read_experiment(folder)
    with figure_style():
        figure = Figure(figsize=(8.4, 3.6), layout="constrained")
        axes = figure.subplots()
        for name, (color, marker) in SWEEPS.items():
            group = experiment.group(name)
            design = Design.of(experiment.constants, [group])
            predicted = 1e6 * simulate(design, [list(FITTED.values())]).launch_range[0]
            ratio = group.reading / predicted
            axes.plot(group.frequency_hz, ratio, marker, color=PALETTE[color], label=f"{name}, readings", mfc="none")
            odd = int(np.argmin(np.abs(group.frequency_hz - ODD_HZ)))
            axes.plot(
                group.frequency_hz[odd], ratio[odd], marker, color=PALETTE["vermillion"], ms=11, mfc="none", mew=2
            )
        axes.axhline(1.0, color=PALETTE["grey"], lw=1)
        axes.axvspan(
            TRUE_HZ - HALF_HZ, TRUE_HZ + HALF_HZ, color=PALETTE["faint"], label="hidden: a resonance of the frame"
        )
        axes.annotate(
            "one reading of each sweep,\nat the same frequency", (2620, 1.3), (4000, 1.27),
            arrowprops={"arrowstyle": "->", "color": PALETTE["ink"]}, color=PALETTE["vermillion"],
        )  # fmt: skip
        axes.set(xscale="log", xlabel="Drive frequency (Hz)", ylabel="Reading over prediction")
        axes.set_ylim(0.8, 1.45)
        plain_log_ticks(axes, x=True)
        axes.legend(loc="upper left")
        figure.savefig(file, dpi=140)


def main() -> int:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "fits" / "sets" / "narrow_resonance"
    if not folder.exists():
        print(f"no {folder}: the command above makes it; the picture stays as it is")
        return 0
    draw(folder, FILE)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Draw the README's picture from the run that `make fit GROUP=1` leaves in fits/psa-group1."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "fits" / "psa-group1"


def main() -> int:
    if not (RUN / "posterior.json").exists():
        print("no fits/psa-group1: run make fit GROUP=1 first; the README's picture stays as it is")
        return 0
    from matplotlib.figure import Figure

    from psafit.inference.run import load
    from psafit.report.figures.groups import draw_group
    from psafit.report.figures.sweep import sweep_of
    from psafit.report.style import figure_style
    from psafit.validate import predict

    predictions = predict(load(RUN))
    with figure_style():
        figure = Figure(figsize=(10.5, 5.8), layout="constrained")
        for axes, p in zip(figure.subplots(2, 3).flat, predictions, strict=False):
            sweep = sweep_of(p.group)
            draw_group(axes, p, sweep, small=True)
            seen = "fitted" if p.role == "fit" else "never seen"
            axes.set_title(f"Group {p.group.id}, {p.group.waveform}: {seen}", fontsize=11, loc="left")
            varies = p.group.frequency_hz.min() < p.group.frequency_hz.max()
            axes.set_xlabel("Drive frequency (Hz)" if varies else "Drive amplitude (V)")
            axes.set_ylabel("Launch range (µm)")
        figure.savefig(ROOT / "docs" / "figures" / "fit-group1.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Draw the README's picture from the run that `make fit GROUP=1` leaves in fits/psa-group1."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "fits" / "psa-group1"


def main() -> int:
    if not (RUN / "posterior.json").exists():
        print("no fits/psa-group1: run make fit GROUP=1 first; the README's picture stays as it is")
        return 0
    from psafit.inference.run import load
    from psafit.report import figures
    from psafit.report.style import figure_style
    from psafit.validate import predict

    predictions = predict(load(RUN))
    curves = [figures.curve_of(p) for p in predictions]
    groups = [p.group for p in predictions]
    sweeps = [figures.sweep_of(g) for g in groups]
    figure = figures.groups_figure(groups, sweeps, [[c] for c in curves])
    fitted = next(c for c, p in zip(curves, predictions, strict=True) if p.role == "fit")
    predicted = next(c for c, p in zip(curves, predictions, strict=True) if p.role != "fit")
    figure.legends[0].remove()
    entries = figures.handles([replace(fitted, name="fitted", bands=())])
    zeros = figures.zero_mark((g, [c]) for g, c in zip(groups, curves, strict=True))
    entries += figures.handles([replace(predicted, name="predicted, never seen")], measured=False, zeros=zeros)
    with figure_style():
        for axes, p, sweep in zip(figure.axes, predictions, sweeps, strict=True):
            seen = "fitted" if p.role == "fit" else "never seen"
            axes.set_title(f"{p.group.id}: {sweep.condition}, {seen}")
        figure.legend(handles=entries, loc="outside lower center", ncols=6)
        figure.savefig(ROOT / "docs" / "figures" / "fit-group1.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())

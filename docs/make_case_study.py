"""Draw the case study's figures from the diagnosis that `make diagnose GROUP=1` leaves in fits/psa-diagnosis."""

from __future__ import annotations

import csv
import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "fits" / "psa-diagnosis"
OUT = ROOT / "docs" / "figures"
SCALES = {"frequency": "Drive frequency (Hz)", "amplitude": "Drive amplitude (V)"}


def read(path: Path) -> dict[tuple[str, str], np.ndarray]:
    """(group, model) to rows of x, measured, predicted, lower, upper."""
    found = defaultdict(list)
    with path.open(newline="") as file:
        for r in csv.DictReader(file):
            row = [r["frequency_hz"], r["amplitude_v"], r["launch_range_um"]]
            row += [r["predicted_um"], r["lower_um"], r["upper_um"]]
            found[r["group"], r["model"]].append([float(x) for x in row])
    return {key: np.array(rows) for key, rows in found.items()}


def unseen(axes_of, rows) -> None:
    """Measured against both models, each group predicted without having been seen."""
    from psafit.report.style import BAND, MEASURED, PALETTE

    groups = sorted({g for g, _ in rows}, key=int)
    for axes, g in zip(axes_of, groups, strict=False):
        base, ext = rows[g, "baseline"], rows[g, "extended"]
        swept = 0 if np.ptp(base[:, 0]) > 0 else 1
        base, ext = (a[np.argsort(a[:, swept])] for a in (base, ext))
        x = base[:, swept]
        axes.fill_between(x, ext[:, 4] + 0.05, ext[:, 5] + 0.05, color=PALETTE["vermillion"], **BAND)
        axes.plot(x, base[:, 3] + 0.05, color=PALETTE["grey"], linestyle="--", label="baseline")
        axes.plot(x, ext[:, 3] + 0.05, color=PALETTE["vermillion"], label="extended, with 90 % band")
        axes.plot(x, base[:, 2] + 0.05, label="measured", **MEASURED)
        axes.set(xscale="log" if swept == 0 else "linear", yscale="log", ylabel="Launch range + 0.05 (µm)")
        axes.set(xlabel=SCALES["frequency" if swept == 0 else "amplitude"])
        error = [np.sqrt(np.mean(np.log((a[:, 3] + 0.3) / (a[:, 2] + 0.3)) ** 2)) for a in (base, ext)]
        axes.set_title(f"Group {g}: log_rmse {error[0]:.2f}, {error[1]:.2f}")


def main() -> int:
    if not (RUN / "diagnosis.json").exists():
        print("no fits/psa-diagnosis: run make diagnose GROUP=1 first; the case study's figures stay as they are")
        return 0
    from matplotlib.figure import Figure

    from psafit.report.style import PALETTE, figure_style

    result = json.loads((RUN / "diagnosis.json").read_text())
    with figure_style():
        for protocol, gain in result["gain"].items():
            rows = read(RUN / gain["predictions"])
            figure = Figure(figsize=(10.5, 6.0), layout="constrained")
            axes = figure.subplots(2, 3).ravel()
            unseen(axes, rows)
            n = len({g for g, _ in rows})
            for empty in axes[n:]:
                empty.set_axis_off()
            handles = axes[0].get_legend_handles_labels()
            if n < len(axes):
                axes[-1].legend(*handles, loc="center")
            else:
                figure.legend(*handles, loc="outside lower center", ncols=3)
            figure.savefig(OUT / f"case-{protocol}.png", dpi=150)
        figure = Figure(figsize=(10.5, 3.4), layout="constrained")
        growth = [g for g in result["show"]["baseline"]["growth"] if g["variable"] == "amplitude"]
        extended = {g["group"]: g for g in result["show"].get("extended", {}).get("growth", [])}
        for axes, g in zip(figure.subplots(1, len(growth), squeeze=False)[0], growth, strict=True):
            axes.fill_between(g["at"], g["lower"], g["upper"], color=PALETTE["ink"], alpha=0.15, lw=0)
            axes.plot(g["at"], g["measured"], color=PALETTE["ink"], label="measured, 90 % band")
            axes.plot(g["at"], g["simulated"], color=PALETTE["grey"], linestyle="--", label="baseline")
            if g["group"] in extended:
                e = extended[g["group"]]
                axes.plot(e["at"], e["simulated"], color=PALETTE["vermillion"], label="extended")
            axes.set(title=f"Group {g['group']}", xlabel="Drive amplitude (V)", ylabel="Growth d ln L / d ln V")
        axes.legend()
        figure.savefig(OUT / "case-growth.png", dpi=150)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Run the commands that the tutorial and docs/own-causes.md show, and put in what they print.

A block of the kind ``console`` holds a command after ``$`` and below it what the command said. `--quick` leaves out the
commands that take minutes. `--measure FOLDER` plays the bench instead: it replaces the readings in an experiment
folder's place by those of a rig that is simulated, with something hidden in it.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "docs" / "own-causes.md", ROOT / "docs" / "tutorial.md")
FIGURE = ROOT / "docs" / "figures" / "tutorial.png"
BLOCK = re.compile(r"(?<=```console\n)(\$ .*\n)((?:(?!```).*\n)*)")
# By their second word: those that take minutes, and what reads their results.
SLOW = ("fit", "diagnose", "-c", "plan")

# --- the bench ------------------------------------------------------------------------------------------

RIG = """\
title = "Short stack, brass ball"
source = "docs/make_tutorial.py: simulated, no bench"

[constants]
M = 0.012   # kg
m = 0.012   # kg
q = 1.5e-7  # m/V
l = 0.15    # m
k_s = 3.0e7 # N/m
g = 9.81    # m/s^2

[[group]]
id = "sine40V"
waveform = "sine"
file = "sine40V.csv"

[[group]]
id = "sine20V"
waveform = "sine"
file = "sine20V.csv"

[[group]]
id = "sine700Hz"
waveform = "sine"
file = "sine700Hz.csv"

[[group]]
id = "square700Hz"
waveform = "square"
file = "square700Hz.csv"
"""
SWEEPS = {
    "sine40V": (np.geomspace(150, 12000, 26), 40.0),
    "sine20V": (np.geomspace(150, 12000, 18), 20.0),
    "sine700Hz": (700.0, np.linspace(4, 40, 14)),
    "square700Hz": (700.0, np.linspace(4, 40, 14)),
}
TRUTH = {"k_c": 3e5, "c_s": 9000, "c_c": 60, "sensor_kappa": 2500}


def measure(folder: Path) -> None:
    """Simulate the launch ranges, read them with a sensor that compresses, and scatter them by 5 % and 0.2 um."""
    rng = np.random.default_rng(7)
    conditions = {name: np.broadcast_arrays(np.round(f), np.round(v, 1)) for name, (f, v) in SWEEPS.items()}
    values = [word for name, value in TRUTH.items() for word in ("--set", f"{name}={value}")]
    with tempfile.TemporaryDirectory() as place:
        # The folder itself is touched when all is simulated.
        bench, cause = Path(place) / "rig", Path(place) / "sensor_compression.py"
        bench.mkdir()
        cause.write_text(example())
        (bench / "experiment.toml").write_text(RIG)
        for name, (f, v) in conditions.items():
            write(bench / f"{name}.csv", f, v, np.ones(f.size))
        plugin = ["--plugin", str(cause), "--terms", "sensor_compression"]
        command = [sys.executable, "-m", "psafit", "simulate", str(bench), *plugin, *values]
        table = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[1:]
    for old in folder.glob("*.csv"):
        old.unlink()
    (folder / "experiment.toml").write_text(RIG)
    exact = [float(row.split(",")[-1]) for row in table]
    for name, (f, v) in conditions.items():
        own, exact = np.array(exact[: f.size]), exact[f.size :]
        read = own * (1 + 0.05 * rng.standard_normal(f.size)) + 0.2 * rng.standard_normal(f.size)
        write(folder / f"{name}.csv", f, v, np.maximum(read, 0))


def write(file: Path, f: np.ndarray, v: np.ndarray, y: np.ndarray) -> None:
    rows = [f"{a:g},{b:g},{c:.2f}" for a, b, c in zip(f, v, y, strict=True)]
    file.write_text("\n".join(["frequency_hz,amplitude_v,launch_range_um", *rows]) + "\n")


# --- the pages ------------------------------------------------------------------------------------------


def example() -> str:
    """The cause that docs/own-causes.md shows."""
    return PAGES[0].read_text("utf-8").split("```python\n")[1].split("```")[0]


def prepare(folder: Path) -> None:
    """The files that the pages take for granted."""
    cause = example()
    (folder / "sensor_compression.py").write_text(cause)
    mistaken = cause.replace("sign=-1", "sign=1").replace("1.0 + kappa * seen", "1.0 + seen")
    (folder / "sensor_mistaken.py").write_text(mistaken)
    (folder / "docs").mkdir()
    (folder / "docs" / "make_tutorial.py").symlink_to(Path(__file__).resolve())


def said(words: list[str], folder: Path) -> str:
    """What a command prints."""
    if words[0] == "psafit":
        words = [sys.executable, "-m", *words]
    elif words[0] == "python":
        words[0] = sys.executable
    environment = {k: v for k, v in os.environ.items() if k != "PSAFIT_PLUGINS"} | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False, env=environment)
    if done.returncode == 2 or "Traceback" in done.stderr:
        raise RuntimeError(f"{' '.join(words)}\n{done.stderr}")
    return done.stdout


def fill(page: str, folder: Path, quick: bool = False) -> str:
    """A page with what its commands print now."""

    def reported(found: re.Match[str]) -> str:
        words = shlex.split(found[1])[1:]
        if quick and words[1] in SLOW:
            return found[0]
        print(found[1], end="", flush=True)
        return f"{found[1]}{said(words, folder)}"

    return BLOCK.sub(reported, page)


def main() -> int:
    arguments = sys.argv[1:]
    if arguments[:1] == ["--measure"]:
        measure(Path(arguments[1]))
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder)
        for page in PAGES:
            page.write_text(fill(page.read_text("utf-8"), folder, quick="--quick" in arguments), "utf-8")
        if "--quick" not in arguments:
            draw(folder / "fits", FIGURE)
    return 0


def draw(fits: Path, file: Path) -> None:
    """Measured and predicted ranges of every group, with the cause and without."""
    import pandas as pd
    from matplotlib.figure import Figure

    from psafit.report.figures.axes import scale_axis, widened
    from psafit.report.style import BAND, MEASURED, PALETTE, figure_style

    models = {"baseline": "grey", "with the sensor": "vermillion"}
    tables = [pd.read_csv(fits / run / "predictions.csv") for run in ("rig-groupsine40V-sine700Hz", "with-sensor")]
    with figure_style():
        figure = Figure(figsize=(9.0, 6.2), layout="constrained")
        # One scale for all readings: how far a model is off can be compared.
        least, most = (pick(pick(t.launch_range_um) for t in tables) for pick in (min, max))
        for axes, name in zip(figure.subplots(2, 2).flat, SWEEPS, strict=True):
            swept = "frequency_hz" if np.ndim(SWEEPS[name][0]) else "amplitude_v"
            for table, (model, color) in zip(tables, models.items(), strict=True):
                own = table[table.group == name].sort_values(swept)
                axes.plot(own[swept], own.predicted_um, color=PALETTE[color], label=model)
                band = f"90 % of readings, {model}"
                axes.fill_between(own[swept], own.lower_um, own.upper_um, color=PALETTE[color], label=band, **BAND)
            axes.plot(own[swept], own.launch_range_um, label="readings", **MEASURED)
            scale_axis(axes, "y", *widened(least, most, 0.1, log=True), log=True)
            log = swept == "frequency_hz"
            scale_axis(axes, "x", *widened(own[swept].min(), own[swept].max(), 0.03, log=log), log=log)
            axes.set_xlabel("Drive frequency (Hz)" if swept == "frequency_hz" else "Drive amplitude (V)")
            seen = "fitted" if own.role.iloc[0] == "fit" else "never seen"
            axes.set_title(f"{name}: {seen}", fontsize=10, loc="left")
        for axes in figure.axes[::2]:
            axes.set_ylabel("Launch range (µm)")
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.savefig(file, dpi=130)


if __name__ == "__main__":
    sys.exit(main())

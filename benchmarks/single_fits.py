"""Do short fits find a single cause that is hidden? Above all one that acts by thresholds.

``python benchmarks/single_fits.py --data fits/singles`` hides each cause below in simulated readings, at an expected
gain of 40 nats, under the study's conditions and under drawn ones. The baseline is fitted, then the cause that is
hidden, as a search fits it: from the baseline's optimum and from draws of its prior. A plain optimisation from the
hidden values says how high it should come. Data sets stay in the folder, and are made once.

- *short*, *carried*: log posterior of the search's two kinds of fits less that of the plain one, nats.
- *CPU*: seconds of both, on one thread.
"""

from __future__ import annotations

import argparse
import os

if __name__ == "__main__":  # before the libraries load: seconds of CPU are those of one thread
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"

import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from psafit.challenge.answer import EXPERIMENT, unseal
from psafit.challenge.hide import make
from psafit.errors import PsafitError
from psafit.experiment import read_experiment
from psafit.inference.candidate import optimised
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.inference.starts import joined_values
from psafit.model_search import SearchSettings
from psafit.model_search.fitter import ProblemFitter
from psafit.physics import TERMS

ROOT = Path(__file__).resolve().parent.parent
HIDDEN = {
    "repeat_impacts": 5, "gap": 3, "slew_limit": 2, "drive_saturation": 2, "idle_level": 2, "start_phase": 2,
    "frame_compliance": 2, "adhesion": 1, "hysteresis": 1, "sliding_support": 1, "preload": 1,
}  # fmt: skip
NATS = 40.0  # hidden
MISSED = SearchSettings.short_by  # nats below the plain fit, beyond what a search allows for


def made(cause: str, number: int, drawn: bool, data: Path) -> Path:
    """A data set with one cause, of the study's or of drawn conditions."""
    folder = data / f"{cause}-{number}-{'drawn' if drawn else 'given'}"
    if not (folder / EXPERIMENT).is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        design = None if drawn else read_experiment(ROOT / "experiments" / "psa")
        make(9000 + 17 * number + drawn, folder, design_of=design, kind="one", terms=[cause], strength=NATS)
    return folder


def fitted(folder: Path) -> tuple[float, float, float, float, float]:
    """Gain of the plain fit, what the short and the carried one are above it, nats, and their seconds of CPU."""
    experiment, answer = unseal(folder)
    with TemporaryDirectory() as steps:
        fitter = ProblemFitter(Problem(experiment, experiment.ids), TERMS, SearchSettings(), 1, Memory(Path(steps)))
        (baseline,) = fitter.short([()], {})
        ids, known = tuple(answer.terms), {(): baseline}
        times = [time.process_time()]
        found = []
        for fit in (fitter.short, fitter.carried):
            found += fit([ids], known)
            times.append(time.process_time())
    at_baseline = baseline.content.candidate
    scatter = dict(zip(at_baseline.problem.names, at_baseline.values.tolist(), strict=True))
    problem = found[0].content.candidate.problem
    plain = optimised(problem, joined_values(problem, scatter | dict(answer.parameters))[None])
    above = [one.log_posterior - plain.log_posterior for one in found]
    return plain.log_posterior - baseline.log_posterior, *above, *np.diff(times).tolist()


def main() -> None:
    """Print a line for each data set, and what was missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--data", type=Path, default=Path("fits/singles"))
    chosen, rows = parser.parse_args(), []
    for cause, n in HIDDEN.items():
        for number, drawn in ((number, drawn) for number in range(n) for drawn in (False, True)):
            try:
                folder = made(cause, number, drawn, chosen.data)
            except PsafitError as error:
                print(f"{cause} {number}: {error}")
                continue
            rows.append(fitted(folder))
            gain, *above = rows[-1]
            print(
                f"{folder.name:28} gain {gain:6.1f}  short {above[0]:7.2f}  carried {above[1]:7.2f}"
                f"  CPU {above[2]:.2f} {above[3]:.2f}",
                flush=True,
            )
    _, short, carried, *cpu = np.array(rows).T
    missed = [int((a < -MISSED).sum()) for a in (short, carried)]
    print(f"of {len(rows)} more than {MISSED:g} nats below: {missed[0]} short, {missed[1]} carried")
    print("CPU, s: " + ", ".join(f"{x.sum():.1f}" for x in cpu))


if __name__ == "__main__":
    main()

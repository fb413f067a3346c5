"""Are launches lost? Random sets of up to four causes over their priors, against hundredfold finer steps.

``python benchmarks/finer_steps.py --seconds 240 --seed 5`` prints every trajectory whose range differs by more than a
thousandth, with all that repeats it, and counts those that use all the steps there are.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from unittest import mock

import numpy as np

from psafit.experiment import read_experiment
from psafit.physics import TERMS, baseline
from psafit.simulate import Design, simulate, stepper

STUDY = Path(__file__).resolve().parents[1] / "experiments" / "psa"
SETS = 4


def main() -> int:
    """Compare until the time is over; 1 if more than one trajectory in 100,000 differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=240.0)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--tolerance", type=float, default=stepper.TOLERANCE)
    given = parser.parse_args()
    experiment = read_experiment(STUDY)
    design = Design.of(experiment.constants, experiment.groups)
    pool = [t for t in TERMS if not t.latent]
    rng = np.random.default_rng(given.seed)
    taken: list[np.ndarray] = []
    most = stepper.StepSettings().most_steps
    separation = stepper.separation

    def counted(*args: object, **options: object) -> object:
        found = separation(*args, **options)  # type: ignore[arg-type]
        taken.append(found[-1])
        return found

    n = differ = exhausted = 0
    ends = time.monotonic() + given.seconds
    while time.monotonic() < ends:
        chosen = tuple(pool[i] for i in sorted(rng.choice(len(pool), rng.integers(1, 5), replace=False)))
        parameters = [*baseline.PARAMETERS, *(p for t in chosen for p in t.parameters)]
        theta = np.stack([p.to_physical(p.prior_quantile(rng.uniform(size=SETS))) for p in parameters], axis=1)
        taken.clear()
        with mock.patch.object(stepper, "separation", counted):
            found = simulate(design, theta, chosen, tolerance=given.tolerance).launch_range
        if not taken:
            continue  # the closed form has no steps
        exhausted += sum(int((steps >= most - 1).sum()) for steps in taken)
        finer = simulate(design, theta, chosen, path="stepper", tolerance=0.01 * given.tolerance).launch_range
        n += found.size
        for k, j in np.argwhere(np.abs(found - finer) > 1e-3 * np.abs(finer) + 1e-11):
            differ += 1
            where = f"{design.frequency[j]} Hz, {design.amplitude[j]} V, waveform {design.waveform[j]}"
            print([t.id for t in chosen], theta[k].tolist(), where, found[k, j], finer[k, j], flush=True)
    print(f"{n} trajectories, {differ} differ by more than a thousandth; {exhausted} used all {most} steps")
    return int(differ > 1e-5 * n)


if __name__ == "__main__":
    raise SystemExit(main())

"""Do the tests of misfit accuse a sound model as often as they say? Data with nothing hidden.

``python benchmarks/level.py -n 100 --seed 1`` draws rigs from the priors, simulates readings at the study's conditions
with the literal reference, fits, and counts p-values of the whole family: of the baseline with simulated data refitted
exactly and in the expansion, and of a model that takes steps and holds the truth (`hertz_exponent`), which is refitted
in the expansion.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from psafit.challenge.hide import make
from psafit.diagnose.misfit import examine
from psafit.experiment import read_experiment
from psafit.inference.candidate import fit
from psafit.inference.problem import Problem
from psafit.physics import TERMS, terms

STUDY = Path(__file__).resolve().parents[1] / "experiments" / "psa"
LEVELS = (0.02, 0.05, 0.1, 0.5)


def p_values(seed: int, n_simulated: int) -> dict[str, float]:
    """The family's p-value of each model, for one data set."""
    with tempfile.TemporaryDirectory() as folder:
        made = make(seed, Path(folder) / "made", design_of=read_experiment(STUDY), kind="nothing")
    problem = Problem(made.experiment, made.experiment.ids, tolerance=1e-4)
    plain = fit(problem, (), seed=1)
    larger = fit(replace(problem, terms=terms(["hertz_exponent"])), [plain], seed=1)
    models = {"exact": (plain, True), "expansion": (plain, False), "stepped": (larger, None)}
    return {
        name: examine(model, TERMS, seed=seed, n_simulated=n_simulated, exact=exact, influence=False).p_value
        for name, (model, exact) in models.items()
    }


def main() -> None:
    """Count, and print after every tenth data set."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=100, help="data sets")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--simulated", type=int, default=199, help="as a quick diagnosis does")
    given = parser.parse_args()
    found: dict[str, list[float]] = {}
    begun = time.monotonic()
    for k in range(given.n):
        for name, p in p_values(1000 * given.seed + k, given.simulated).items():
            found.setdefault(name, []).append(p)
        if (k + 1) % 10 == 0 or k + 1 == given.n:
            print(f"{k + 1} data sets, {time.monotonic() - begun:.0f} s")
            for name, p in found.items():
                reported = []
                for level in LEVELS:
                    count = int(np.sum(np.array(p) <= level))
                    low, high = binomtest(count, len(p)).proportion_ci()
                    reported.append(f"{level:g}: {count} ({100 * low:.0f}-{100 * high:.0f} %)")
                print(f"  {name:10} p at most {', '.join(reported)}", flush=True)


if __name__ == "__main__":
    main()

"""How often do optimisations stop below the top of a posterior, and how often is it found behind discontinuities?

``python benchmarks/discontinuities.py --seed 25`` hides every cause at three strengths. It fits the model that made the
readings from the baseline's optimum, samples it as the search does (looks from that fit and from draws of the prior,
and hops), and optimises from the truth. It prints, for each data set, how far these are above the first optimisations
(nats), and counts.
"""

from __future__ import annotations

import argparse
import os

# A data set on each core.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np

from psafit.challenge.campaign import Spec, plan
from psafit.challenge.conditions import ConditionSettings
from psafit.challenge.hide import make
from psafit.challenge.oracle import truth_of
from psafit.experiment import read_experiment
from psafit.inference.candidate import fit
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.inference.sample import sample
from psafit.physics import terms

STUDY = Path(__file__).resolve().parents[1] / "experiments" / "psa"
# As a diagnosis has them; nats by which a top is another.
TOLERANCE, HIGHER = 1e-4, 0.5


def log_posteriors(spec: Spec) -> tuple[str, float, float, float]:
    """How far a sample and an optimisation from the truth lead above the first ones, nats; seconds."""
    design = read_experiment(STUDY) if spec.design == "given" else None
    with tempfile.TemporaryDirectory() as folder:
        made = make(
            spec.seed,
            Path(folder) / "made",
            design_of=design,
            kind=spec.kind,
            terms=spec.terms,
            strength=spec.nats,
            conditions=ConditionSettings.like_the_study(),
        )
    hidden = terms(made.answer.terms)
    problem = Problem(made.experiment, made.experiment.ids, hidden, tolerance=TOLERANCE)
    plain = fit(replace(problem, terms=()), (), seed=1, draws=4096, most=48)
    optimised = fit(problem, [plain], seed=1)
    begun = time.perf_counter()
    found = sample(problem, [optimised], seed=1)[0]
    seconds = time.perf_counter() - begun
    top = float(maximise(problem, truth_of(problem, made.answer)[None]).log_posterior[0])
    return spec.id, found.log_posterior - optimised.log_posterior, top - optimised.log_posterior, seconds


def main() -> None:
    """Fit them all, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=25, help="of the campaign's plan")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    specs = [s for s in plan(given.seed, nothing=10, pairs=0, drawn=0) if s.kind == "one"]
    rows = []
    calls = (joblib.delayed(log_posteriors)(s) for s in specs)
    for row in joblib.Parallel(n_jobs=given.jobs, return_as="generator", batch_size=1)(calls):
        rows.append(row)
        print(f"{row[0]:36} sample {row[1]:+7.2f}  truth {row[2]:+7.2f}  {row[3]:5.1f} s", flush=True)
    look, truth, seconds = np.array([row[1:] for row in rows]).T
    print(
        f"{len(rows)} data sets; the first optimisations end below the truth's top in {np.sum(truth > HIGHER)},"
        f" after a sample {np.sum(truth - look > HIGHER)} do; a sample takes {np.median(seconds):.1f} s (median),"
        f" {seconds.max():.1f} at most"
    )


if __name__ == "__main__":
    main()

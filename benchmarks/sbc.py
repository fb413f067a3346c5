"""`make sbc`: simulation-based calibration of the posteriors (Talts et al., arXiv:1804.06788).

Parameters are drawn from their priors, readings simulated from them at an experiment's conditions, the model fitted
and its posterior drawn, and the rank of the truth among the draws recorded. If fit, evidence and draws are sound the
ranks are uniform. ``--sampler emcee`` draws as `psafit fit` does, by emcee until the chain has
converged or has taken ``--steps``; the default draws as `psafit diagnose` samples its models. ``--terms any`` takes the
catalogue's causes in turn, one a data set, and counts their strengths together. Writes docs/figures/sbc.png and prints,
for every parameter, a chi-square p-value and how many 90 % intervals hold the truth; exits with 1 if a p-value is below
0.05 divided by their number. Ranks are kept in fits/sbc, for this state of the sources: what was interrupted goes on
where it stopped.
"""

from __future__ import annotations

import argparse
import hashlib
import os

# A data set on each core.
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
from scipy.stats import binom, chisquare

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from psafit.experiment import read_experiment
from psafit.inference import noise
from psafit.inference.candidate import built_up
from psafit.inference.problem import Problem
from psafit.inference.sample import sample
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.sampling import Target
from psafit.model_search import SearchSettings
from psafit.physics import TERMS, baseline, terms
from psafit.report.style import PALETTE, figure_style

DRAWS, BINS = 99, 10
TOLERANCE = SearchSettings().tolerance  # of the simulator, as a diagnosis has it
# A chain that has not converged then is used as it is, and counted.
STEPS = 8000


def weighed(problem: Problem, seed: int, steps: int) -> tuple[np.ndarray, bool]:
    """Draws as a diagnosis makes them, (DRAWS, n_dim)."""
    known = [built_up(problem, seed=seed)] if problem.terms else []
    _, found = sample(problem, known, seed=seed)
    return found.resampled(DRAWS), True


def sampled(problem: Problem, seed: int, steps: int) -> tuple[np.ndarray, bool]:
    """Draws as `psafit fit` makes them, (DRAWS, n_dim), and whether the chain has converged."""
    known, own = [built_up(problem, seed=seed)] if problem.terms else [], sampler(USUAL)
    found, weighed = sample(problem, known, seed=seed)
    with tempfile.TemporaryDirectory() as folder:
        chain = own.draw(
            Target(found, weighed, seed, Path(folder) / "chain.h5", ""),
            replace(own.settings(problem), max_steps=steps),
            lambda state: None,
        )
    flat = chain.draws.reshape(-1, problem.n_dim)
    return flat[np.random.default_rng(seed).choice(len(flat), DRAWS, replace=False)], chain.converged


SAMPLERS = {"evidence": weighed, "emcee": sampled}


def posed(ids: list[str], group: str) -> Problem:
    """Groups of the study under the baseline and some causes."""
    experiment = read_experiment(ROOT / "experiments" / "psa")
    experiment = replace(experiment, groups=tuple(experiment.group(g) for g in group.split(",")))
    return Problem(experiment, experiment.ids, terms(ids), tolerance=TOLERANCE)


def rank(ids: list[str], group: str, u: np.ndarray, y: np.ndarray, seed: int, sampler: str, steps: int):
    """Rank of a truth among the draws of its posterior, (n_dim,), and whether these have converged."""
    problem = posed(ids, group)
    one = replace(problem, experiment=problem.experiment.with_readings(np.abs(y)))
    # The likelihood is that of readings of either sign; what an instrument clips is tested by the challenges. (For a
    # first look at some of them the magnitudes do.)
    vars(one)["observed"] = y
    draws, converged = SAMPLERS[sampler](one, seed, steps)
    return (draws < u).sum(axis=0), converged


def truth(problem: Problem, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Parameters drawn from their priors, and readings that they make."""
    while True:
        u = problem.prior_transform(rng.uniform(size=(1, problem.n_dim)))
        y = noise.draw(problem.predict(u), problem.noise_values(u), None, rng)[0]
        if np.isfinite(y).all() and np.abs(y).max() < 1e5:
            return u[0], y


def ranks(given: argparse.Namespace) -> tuple[np.ndarray, list[str]]:
    """Ranks of the truths among posterior draws; (n, n_parameters), and the parameters' names."""
    sets = [[t.id] for t in TERMS] if given.terms == "any" else [[t for t in given.terms.split(",") if t]]
    problems = [posed(ids, given.group) for ids in sets]
    rng = np.random.default_rng(given.seed)
    sources = b"".join(path.read_bytes() for path in [*sorted((ROOT / "psafit").rglob("*.py")), Path(__file__)])
    kept = joblib.Memory(ROOT / "fits" / "sbc" / hashlib.sha256(sources).hexdigest()[:12], verbose=0).cache(rank)
    calls = (
        joblib.delayed(kept)(sets[k % len(sets)], given.group, *truth(problems[k % len(sets)], rng), k, given.sampler,
                             given.steps)
        for k in range(given.n)
    )  # fmt: skip
    names, columns = list(problems[0].names), slice(None)
    if len(sets) > 1:
        # What all of them have: the baseline's parameters, a strength, the scatter.
        names = [*names[: len(baseline.PARAMETERS)], "strength", *names[-len(noise.PARAMETERS) :]]
        columns = np.r_[: len(baseline.PARAMETERS) + 1, -len(noise.PARAMETERS) : 0]
    found, converged = [], 0
    for one, done in joblib.Parallel(n_jobs=given.jobs, return_as="generator", batch_size=1)(calls):
        found.append(one[columns])
        converged += done
        print(f"\r{len(found)} of {given.n}", end="", file=sys.stderr, flush=True)
    if converged < given.n:
        print(
            f"\n{given.n - converged} of {given.n} chains had not converged after {given.steps} steps", file=sys.stderr
        )
    return np.array(found), names


def main() -> int:
    """Calibrate, draw, judge."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--terms", default="", help="causes beside the baseline, or any")
    options.add_argument("--group", default="1", help="or several: 1,2,3")
    options.add_argument("--sampler", choices=list(SAMPLERS), default="evidence")
    options.add_argument("-n", type=int, default=200, help="data sets")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--steps", type=int, default=STEPS, help="of emcee, at most")
    options.add_argument("--jobs", type=int, default=2)
    options.add_argument("--out", type=Path, default=ROOT / "docs" / "figures" / "sbc.png")
    given = options.parse_args()
    found, names = ranks(given)
    edges = np.linspace(-0.5, DRAWS + 0.5, BINS + 1)
    low, high = binom.ppf([0.005, 0.995], given.n, 1 / BINS)
    worst = 1.0
    with figure_style():
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.4, 2.2 * ((len(names) + 2) // 3)), layout="constrained")
        for axes, name, column in zip(
            figure.subplots((len(names) + 2) // 3, 3, squeeze=False).flat, names, found.T, strict=False
        ):
            counts, _ = np.histogram(column, edges)
            p = float(chisquare(counts).pvalue)
            worst = min(worst, p)
            held = int(np.sum((column >= 0.05 * (DRAWS + 1)) & (column < 0.95 * (DRAWS + 1))))
            print(f"\n{name:24} p = {p:.3f}  {counts.tolist()}  90 % intervals: {held} of {given.n}", end="")
            axes.axhspan(low, high, color=PALETTE["faint"])
            axes.stairs(counts, edges, color=PALETTE["blue"], fill=False, linewidth=1.8)
            axes.set(title=f"{name}, p = {p:.2f}", xlabel=f"rank of the truth among {DRAWS} draws", ylabel="data sets")
            axes.set_ylim(bottom=0)
        given.out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(given.out, dpi=150)
    sound = worst > 0.05 / len(names)
    print(f"\n{'sound' if sound else 'NOT sound'}: smallest p = {worst:.3f}; grey band: 99 % of sound counts")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())

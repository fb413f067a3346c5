"""How long a chain takes until it has converged: `python benchmarks/chains.py`, or with names of cases.

For each case the model is fitted and sampled as `psafit fit` does (lmfit polishes nothing here), and its ensembles run
until their rule is met, or for ``--seconds`` of processor time. One line a case: parameters, steps, R-hat over the
ensembles, autocorrelation times, seconds of the search and of the chain, and how far chain and importance draws are
apart. Exits with 1 if a chain has not converged.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import numpy as np
from search_sets import STUDY, get

from psafit.experiment import read_experiment
from psafit.inference.candidate import built_up
from psafit.inference.problem import Problem
from psafit.inference.sample import SampleSettings, sample
from psafit.inference.samplers import USUAL, sampler
from psafit.inference.sampling import Progress, Target
from psafit.physics import terms

ADOPTED = ("amplifier_lag", "hertz_exponent", "no_tension", "repeat_impacts", "sliding_support", "reading_gain")
CASES: dict[str, tuple[str, tuple[str, ...]]] = {
    "group 1": ("group", ()),
    "group 1, preload": ("group", ("preload",)),
    "group 1, a pair": ("group", ("preload", "hertz_exponent")),
    "group 1, three causes": ("group", ("amplifier_lag", "repeat_impacts", "sliding_support")),
    "lag_and_adhesion": ("lag_and_adhesion", ("amplifier_lag", "adhesion")),
    "the study's set": ("study", ADOPTED),
}


class _Over(Exception):
    """The time is over."""


def posed(where: str, ids: tuple[str, ...]) -> Problem:
    """Readings under the baseline and some causes."""
    study = read_experiment(STUDY)
    data = get(where).experiment if where not in ("group", "study") else study
    return Problem(data, (data.ids[0],) if where == "group" else data.ids, terms(ids))


def measured(name: str, seed: int, seconds: float) -> bool:
    """Fit, sample, print; whether the chain has converged."""
    problem, last = posed(*CASES[name]), [Progress(steps=0, steps_left=0, chunk=0, converged=False)]
    begun = time.process_time()
    known = [built_up(problem, seed=seed)] if problem.terms else []
    found, draws = sample(problem, known, seed=seed, settings=SampleSettings.of())
    searched = time.process_time()

    def say(state: Progress) -> None:
        last[0] = state
        if time.process_time() - searched > seconds and not state.converged:
            raise _Over

    own, apart = sampler(USUAL), ""
    with tempfile.TemporaryDirectory() as folder:
        try:
            target = Target(found, draws, seed, Path(folder) / "chain.h5", name)
            chain = own.draw(target, own.settings(problem), say)
            flat, q = chain.draws.reshape(-1, problem.n_dim), [0.05, 0.5, 0.95]
            ours, other = np.quantile(flat, q, axis=0), draws.quantiles(draws.draws, q)
            off = (np.abs(ours - other) / (ours[2] - ours[0])).max(axis=0)
            apart = f"; {problem.names[int(off.argmax())]} {off.max():.2f} off {draws.effective:.0f} importance draws"
        except _Over:
            pass
    state = last[0]
    print(
        f"{name}: {problem.n_dim} parameters, {state.steps} steps of {state.walkers} walkers, R-hat {state.r_hat:.4f},"
        f" {state.autocorrelation_times:.0f} autocorrelation times; search {searched - begun:.0f} s,"
        f" chain {time.process_time() - searched:.0f} s{apart}{'' if state.converged else '; NOT CONVERGED'}",
        flush=True,
    )
    return state.converged


def main() -> int:
    """Measure the cases."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all by default")
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--seconds", type=float, default=360.0, help="of processor time at most for a chain")
    given = options.parse_args()
    return 0 if all([measured(name, given.seed, given.seconds) for name in given.cases or CASES]) else 1


if __name__ == "__main__":
    sys.exit(main())

"""`python benchmarks/strict.py`: choose and fit on some groups of the study, score on the others.

Nothing of the scored groups is seen: neither by the search, nor by the fit. It prints the most probable sets with their
values at the highest mode, what is implausible of them, the laws that they break, and the scores.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from psafit.diagnose.gain import split, summarise
from psafit.diagnose.searching import searched
from psafit.experiment import read_experiment
from psafit.inference.laws import broken
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.physics import TERMS


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--groups", default="1", metavar="ID[,ID...]", help="groups that are seen")
    parser.add_argument("--experiment", type=Path, default=ROOT / "experiments" / "psa")
    parser.add_argument("--seed", type=int, default=20250101)
    parser.add_argument("--memory", type=Path, help="keeps fits, so that the same command goes on")
    words = parser.parse_args()
    experiment = read_experiment(words.experiment)
    seen = tuple(experiment.group(name).id for name in words.groups.split(","))
    begun = time.process_time()
    memory = Memory(words.memory)
    memory.begin()
    found = searched(Problem(experiment, seen), TERMS, seed=words.seed, memory=memory)
    print(f"{len(found.log_evidence)} sets fitted in {time.process_time() - begun:.0f} CPU s")
    for ids in (ids for ids, share in found.probability.items() if share > 0.01):
        candidate = found.of(ids)
        print(f"{100 * found.probability[ids]:.1f} %  {' + '.join(ids) or 'no cause'}")
        strange = candidate.problem.implausible(candidate.values)
        for p, value in zip(candidate.problem.parameters, candidate.values.tolist(), strict=True):
            print(f"    {p.name} = {value:.4g} {p.unit}{'; implausible' if p.name in strange else ''}")
        for law in broken(candidate):
            print(f"    breaks a law: {law.text}")
    others = tuple(g for g in experiment.ids if g not in seen)
    with tempfile.TemporaryDirectory() as folder:
        gain = summarise("strict", [split(found, others, words.seed)], Path(folder), words.seed)
    print(f"mean log_rmse of the others: baseline {gain.log_rmse_before:.3f}, extended {gain.log_rmse_after:.3f}")
    for g in gain.groups:
        print(
            f"  group {g.group}: {g.log_rmse_before:.3f}, {g.log_rmse_after:.3f};"
            f" in the 90 % band {g.coverage_before:.2f}, {g.coverage_after:.2f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())

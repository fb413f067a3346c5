"""What a launch costs now and in an earlier version: `python benchmarks/against_version.py REVISION`.

Sines and squares, with no cause and with Hertz' law, 64 sets of parameters at 64 frequencies. Both versions run in
turns, each in a process of its own, since machines are noisy. One line a case: CPU microseconds a launch, the least of
the turns, and the ratio of now to then.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TIMED = """
import json, sys, time
import numpy as np
sys.path[:0] = [sys.argv[1], sys.argv[1] + "/benchmarks"]
from cases import RIG
from psafit.physics import terms
from psafit.simulate import Design, simulate
assert simulate.__code__.co_filename.startswith(sys.argv[1])
sets = np.exp(np.random.default_rng(1).uniform(np.log([1e5, 1e3, 10]), np.log([1e7, 3e4, 300]), (64, 3)))
found = {}
for waveform in ("sine", "square"):
    design = Design.sweep(RIG, waveform, np.geomspace(100, 25_000, 64), 20.0)
    for ids in ((), ("hertz_exponent",)):
        theta = np.hstack([sets, np.full((64, len(ids)), 1.5)])
        simulate(design, theta, terms(ids))
        begun = time.process_time()
        simulate(design, theta, terms(ids))
        found[f"{waveform}, {'Hertz' if ids else 'baseline'}"] = (time.process_time() - begun) / 64**2
print(json.dumps(found))
"""


@contextmanager
def worktree(revision: str) -> Iterator[Path]:
    """Lend a folder with an earlier version."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name).resolve() / "tree"
        subprocess.run(["git", "worktree", "add", "--detach", "--quiet", place, revision], cwd=ROOT, check=True)
        try:
            yield place
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", place], cwd=ROOT, check=True)


def timed(tree: Path) -> dict[str, float]:
    """CPU seconds of a launch in a tree, by case."""
    one = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
    without = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-c", TIMED, str(tree)]
    done = subprocess.run(command, cwd=tree, env=without | one, check=True, capture_output=True, text=True)
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="commit or tag of the earlier version")
    parser.add_argument("--turns", type=int, default=5)
    asked = parser.parse_args()
    with worktree(asked.revision) as tree:
        turns = [(timed(tree), timed(ROOT)) for _ in range(asked.turns)]
    print(f"{'case':<20} {asked.revision:>10}  {'now':>8}  ratio   (CPU us a launch)")
    for case in turns[0][0]:
        then, now = (1e6 * min(turn[k][case] for turn in turns) for k in (0, 1))
        print(f"{case:<20} {then:>10.2f}  {now:>8.2f}  {now / then:5.2f}")


if __name__ == "__main__":
    main()

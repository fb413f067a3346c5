"""The fast path against the scalar reference, which shares no code with it: sets of two to five causes at random.

``python benchmarks/against_literal.py --seconds 300 --seed 11`` draws conditions and parameters from the priors, prints
every launch whose range differs by more than a test allows (1e-6 stepped, 1e-9 in closed form), with all that repeats
it, and says how far off the worst was, with usual steps and with finer ones.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from psafit.physics import TERMS
from psafit.simulate.contract import AGREEMENT, draw

FINE = 1e-8


def main() -> int:
    """Compare until the time is over; 1 if finer steps do not agree either."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--seed", type=int, default=11)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    n = apart = 0
    worst = finest = 0.0
    ends = time.monotonic() + given.seconds
    while time.monotonic() < ends:
        chosen = sorted(rng.choice(len(TERMS), int(rng.integers(2, 6)), replace=False))
        one = draw(rng, tuple(TERMS[i] for i in chosen))
        n += 1
        size = one.disagreement()
        if not size <= 1:
            allowed = AGREEMENT[one.fast()[1]]
            finer = one.disagreement(FINE)
            apart, worst, finest = apart + 1, max(worst, size * allowed), max(finest, finer * allowed)
            print(f"{size * allowed:.2g}, with finer steps {finer * allowed:.2g}: {one}", flush=True)
    print(
        f"{n} launches, {apart} apart by more than is allowed, the worst by {worst:.2g}; with finer steps {finest:.2g}"
    )
    return int(finest > max(AGREEMENT.values()))


if __name__ == "__main__":
    raise SystemExit(main())

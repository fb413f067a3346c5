"""How often is a diagnosis right about what `test_hidden_effects` hides? What the chances of its rule rest on.

``python tests/hidden_rates.py --each 20 --seed 1`` hides and diagnoses so many data sets of every kind just as the test
does, and says how often the test would fail by chance at the rates found.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.special import betaln
from scipy.stats import binomtest
from test_hidden_effects import FAST, RIGHT, SLOW, Asked, answer_to, hide_one, is_right, tries


def is_found(kind: str, asked: Asked, seed: int) -> bool:
    """Whether one data set of a kind is answered rightly; what was said of it is printed."""
    rng = np.random.default_rng(seed)
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        hidden = hide_one(kind, rng, Path(name), asked)
        said = answer_to(hidden, Path(name) / "diagnosis", asked)
        answer, right = hidden.made.answer, is_right(hidden.made.answer, said)
    truth = answer.outside or " + ".join(answer.terms) or "nothing"
    print(
        f"{'right' if right else 'WRONG'}: {kind}, {truth} (seed {seed}, {hidden.oracle.gain:.0f} nats): "
        f"{said['verdict']} {said['named']}, {len(said['alternatives'])} alternatives, "
        f"{time.monotonic() - begun:.0f} s",
        flush=True,
    )
    return right


def main() -> None:
    """Count every kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=20, help="data sets of every kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--slow", action="store_true", help="as the slow test hides: more readings, all causes")
    given = parser.parse_args()
    wanted = [(kind, 1000 * given.seed + n) for n in range(given.each) for kind in RIGHT]
    which = SLOW if given.slow else FAST
    found = Parallel(given.jobs)(delayed(is_found)(kind, which, seed) for kind, seed in wanted)
    chance = 0.0
    for kind, assumed in RIGHT.items():
        right = [good for (of, _), good in zip(wanted, found, strict=True) if of == kind]
        low, high = binomtest(sum(right), len(right)).proportion_ci()
        # Not the rate found, which may be 1, but what it leaves open (Jeffreys' prior).
        a, b = sum(right) + 0.5, len(right) - sum(right) + 0.5
        missed = float(np.exp(betaln(a, b + tries(assumed)) - betaln(a, b)))
        chance += missed
        print(
            f"{kind:8} right {sum(right)} of {len(right)} ({100 * low:.0f}-{100 * high:.0f} %), assumed {assumed:g}; "
            f"missed by all of {tries(assumed)}: {missed:.1e}"
        )
    print(f"the test fails by chance in {chance:.1e} of its runs, as far as these counts show")


if __name__ == "__main__":
    main()

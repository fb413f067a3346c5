"""`python benchmarks/fit_pages.py`: are pages of fits green where the model is wrong and its values are off?

Rigs with one hidden cause are made, every second one with a rig and sweeps of its own. The baseline, which lacks the
cause, is fitted to the first group and predicts the others. A page is green if the fit predicts (`psafit.validate`) and
nothing speaks for caution. The parameters that it calls determined are then held against those that made the readings.
Ninety of a hundred intervals should hold the truth: of three, one or more miss it by chance on 27 pages of 100, two or
more on 3. Results are appended to a file; those in it are not repeated.

With ``--kind nothing`` no cause is hidden, and what a page warns of is wrong.
"""

from __future__ import annotations

import argparse
import json
import os

if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from psafit.api import Rig
from psafit.challenge.hide import make
from psafit.challenge.score import percent, rate
from psafit.diagnose.retest import retest
from psafit.experiment import read_experiment
from psafit.physics.baseline import PARAMETERS
from psafit.validate import caution, predicts, validate

STUDY = ROOT / "experiments" / "psa"


def measure(seed: int, kind: str, least: float, most: float) -> dict[str, Any]:
    """Hide a cause of `least` to `most` nats, or nothing, fit the baseline to the first group, and compare."""
    begun = time.process_time()
    nats = float(np.exp(np.random.default_rng([seed, 1]).uniform(np.log(least), np.log(most))))
    with tempfile.TemporaryDirectory() as folder:
        design = None if seed % 2 else read_experiment(STUDY)
        strength = {"strength": nats} if kind == "one" else {}
        made = make(seed, Path(folder) / "made", design_of=design, kind=kind, **strength)
        first = made.experiment.ids[0]
        run = Rig(made.experiment).fit(first, sampler="importance", out=Path(folder) / "fit", seed=seed, quiet=True).run
        validation, _ = validate(run, retest=retest)
    outside, determined = [], []
    for s in run.summary.parameters:
        if s.name in {p.name for p in PARAMETERS} and s.verdict == "determined":
            determined.append(s.name)
            if not s.lower <= made.answer.parameters[s.name] <= s.upper:
                outside.append(s.name)
    return {
        "seed": seed,
        "kind": kind,
        "terms": list(made.answer.terms),
        "nats": nats,
        "predicts": predicts(validation)[0],
        "caution": caution(validation),
        "determined": determined,
        "outside": outside,
        "cpu_s": time.process_time() - begun,
    }


def summary(done: list[dict[str, Any]]) -> list[str]:
    """How many pages are green, and on how many of these determined parameters are off."""
    green = [row for row in done if row["predicts"] == "yes" and not row["caution"]]
    sure = sum(row["predicts"] == "too sure" for row in done)
    said = [f"pages of {len(done)} rigs: {len(green)} green; {sure} too sure of what the fit has not seen"]
    for n in (1, 2, 3):
        found = rate([row in green and len(row["outside"]) >= n for row in done])
        low, high = (percent(x) for x in (found.lower, found.upper))
        said.append(f"green, and {n} or more determined parameters outside: {found.k} of {found.n} ({low} to {high})")
    others = [row for row in done if row not in green]
    said.append(f"not green, and one or more outside: {sum(bool(row['outside']) for row in others)} of {len(others)}")
    return said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=40, help="rigs")
    parser.add_argument("--seed", type=int, default=1, help="of the first rig; the others follow")
    parser.add_argument("--kind", choices=("one", "nothing"), default="one", help="what is hidden")
    parser.add_argument("--least", type=float, default=15.0, help="nats that a cause gains at least")
    parser.add_argument("--most", type=float, default=150.0, help="and at most")
    parser.add_argument("--out", type=Path, default=Path("fit_pages.jsonl"))
    words = parser.parse_args()
    done = [json.loads(row) for row in words.out.read_text().splitlines()] if words.out.exists() else []
    for seed in range(words.seed, words.seed + words.n):
        if seed in {row["seed"] for row in done if row.get("kind", "one") == words.kind}:
            continue
        row = measure(seed, words.kind, words.least, words.most)
        done.append(row)
        with words.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{seed}: {' + '.join(row['terms']) or 'nothing'}, {row['nats']:.0f} nats; predicts: {row['predicts']};"
              f" {row['caution'] or 'nothing speaks for caution'}; outside: {', '.join(row['outside']) or 'none'};"
              f" {row['cpu_s']:.0f} s", flush=True)  # fmt: skip
    print("\n".join(summary([row for row in done if row.get("kind", "one") == words.kind])))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""What the fits of the search are worth: short fits against samples, and samples of two seeds against each other.

``python benchmarks/estimates.py --models 200 --out benchmarks/estimates.jsonl`` draws sets of causes from the prior on
sets, a true model of each from the priors, and readings from it. Each set is fitted as the search does it: cause after
cause by short fits, in an order that is drawn; the part that lacks the last is sampled, the set gets a short fit from
there, and is sampled with two seeds. One line of JSON a model; a run that was broken off goes on with the same command.
The table at the end is by number of causes.

- *short*: log evidence of the sample above the short fit's estimate, nats. `SearchSettings.short_by` must cover it, and
  its spread is `SearchSettings.doubt`.
- *top*: how far the second seed's top lies above the first's, nats.
- *evidence*: how far the evidences of the two seeds differ, nats, and the standard error that the first one states.
"""

from __future__ import annotations

import argparse
import os

if __name__ == "__main__":  # before the libraries load: seconds of CPU are those of one thread
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from search_sets import get

from psafit.files import write_atomically
from psafit.inference import noise
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.model_search import SearchSettings
from psafit.model_search.fitter import ProblemFitter
from psafit.physics import TERMS, terms

LEAST_UM = 1.0  # median of the readings: a ball that hardly moves shows nothing


def drawn(rng: np.random.Generator, ids: tuple[str, ...], rig: str) -> Problem:
    """Readings of a true model with these causes, drawn from the priors, under a rig's conditions."""
    conditions = get(rig).experiment
    problem = Problem(conditions, conditions.ids, terms(ids))
    while True:
        u = problem.prior_transform(rng.uniform(size=(1, problem.n_dim)))
        true = problem.predict(u)
        read = noise.draw(true, problem.noise_values(u), None, rng)[0]
        if np.isfinite(read).all() and np.median(true) > LEAST_UM:
            return replace(problem, experiment=conditions.with_readings(np.maximum(np.round(read, 2), 0.0) + 0.0))


def at_work(rng: np.random.Generator, most: int) -> tuple[str, ...]:
    """Causes drawn by how probable each is to be at work: one at least, and `most` at most."""
    while True:
        ids = tuple(t.id for t in TERMS if rng.uniform() < t.probability)
        if 0 < len(ids) <= most:
            return ids


def measure(number: int, seed: int, rig: str) -> dict[str, Any]:
    """One random model: its short fit, and two samples."""
    rng, settings = np.random.default_rng([seed, number]), SearchSettings()
    ids = at_work(rng, settings.most_causes)
    whole = drawn(rng, ids, rig)
    plain = replace(whole, terms=())
    fitters = [ProblemFitter(plain, TERMS, settings, s, Memory(None)) for s in (1, 2)]
    order = rng.permutation(ids).tolist()
    begun, known = time.process_time(), {}
    for n in range(len(ids)):
        part = tuple(id for id in ids if id in order[:n])
        (known[part],) = fitters[0].short([part], known)
    known[part] = fitters[0].sample(known[part])
    begun_short = time.process_time()
    (short,) = fitters[0].short([ids], known)
    begun_sample = time.process_time()
    one, two = (f.sample(short) for f in fitters)
    ended = time.process_time()
    tops = [m.content.candidate.log_posterior for m in (short, one, two)]
    return {
        "number": number,
        "seed": seed,
        "causes": list(ids),
        "part": list(part),
        "short_below": one.log_evidence - short.log_evidence,
        "short_top_below": tops[1] - tops[0],
        "second_top_above": tops[2] - tops[1],
        "evidences_differ": two.log_evidence - one.log_evidence,
        "stated_error": one.content.draws.standard_error if one.content.draws else None,
        "part_s": round(begun_short - begun, 2),
        "short_s": round(begun_sample - begun_short, 2),
        "sample_s": round(0.5 * (ended - begun_sample), 2),
    }


def read(file: Path) -> dict[int, dict[str, Any]]:
    """Records of a file by number; none if there is no file."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return {record["number"]: record for record in map(json.loads, lines)}


def table(records: list[dict[str, Any]]) -> str:
    """What was measured, by number of causes."""
    lines = [
        "causes  models  short below (median, 90 %, most)  second top > 0.5  evidences within 0.3  short s  sample s"
    ]
    for size in sorted({len(r["causes"]) for r in records}):
        some = [r for r in records if len(r["causes"]) == size]
        below = np.array([r["short_below"] for r in some])
        higher = np.mean([r["second_top_above"] > 0.5 for r in some])
        near = np.mean([abs(r["evidences_differ"]) < 0.3 for r in some])
        short, sample = (np.mean([r[name] for r in some]) for name in ("short_s", "sample_s"))
        lines.append(
            f"{size:6}  {len(some):6}  {np.median(below):8.2f} {np.quantile(below, 0.9):8.2f} {below.max():8.2f}"
            f"  {higher:20.0%}  {near:20.0%}  {short:7.2f}  {sample:8.2f}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rig", default="gap_and_slew", help="data set whose conditions are used")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "estimates.jsonl")
    asked = parser.parse_args()
    records = read(asked.out)
    for number in range(asked.models):
        if number not in records:
            records[number] = measure(number, asked.seed, asked.rig)
            write_atomically(asked.out, "".join(f"{json.dumps(r)}\n" for r in records.values()).encode())
    print(table([records[n] for n in range(asked.models)]))


if __name__ == "__main__":
    main()

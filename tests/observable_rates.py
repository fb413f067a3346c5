"""How often is a diagnosis right about one cause of 30 nats, or none, with other drives and other observables?

``python tests/observable_rates.py --each 10`` hides and diagnoses so many data sets of every case as the tests of
hidden observables and traces do, and of a stack driven from 0 V; ``--all`` lets a diagnosis choose among the whole
catalogue, not the few causes of the tests. Results are appended to a file; those in it are not repeated.
"""

from __future__ import annotations

import argparse
import json
import os

if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(variable, "1")

import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import test_hidden_observables as launches
import test_hidden_traces as traces
from joblib import Parallel, delayed
from scipy.stats import binomtest
from test_hidden_effects import WEAK, answer_to, hide_one

from psafit.physics import TERMS, term, terms

FROM_0_V = replace(WEAK, waveforms=("unipolar_sine", "unipolar_square"))
CASES: dict[str, Any] = {}
for read, hidden in launches.CASES:
    make: Any = partial(launches.measured, read, hidden and term(hidden))
    CASES[f"{' + '.join(read)}, {hidden or 'nothing'}"] = make, hidden, launches.FEW
for drive in traces.DRIVES:
    make = partial(traces.measured, None, drive=traces.DRIVES[drive])
    CASES[f"traces, {drive}, nothing"] = make, None, traces.FEW
for drive, swept, cause in traces.CASES:
    make = partial(traces.measured, term(cause), drive=traces.DRIVES[drive], swept=swept)
    CASES[f"traces{' and ranges' if swept else ''}, {drive}, {cause}"] = make, cause, traces.FEW
for kind in ("nothing", "one"):
    CASES[f"ranges from 0 V, {kind}"] = kind, None, ()


def answered(case: str, seed: int, every: bool) -> dict[str, Any]:
    """Hide and diagnose one data set of a case."""
    make, hidden, few = CASES[case]
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if isinstance(make, str):
            asked = replace(FROM_0_V, causes=None) if every else FROM_0_V
            made = hide_one(make, np.random.default_rng(seed), folder / "made", asked)
            said, hidden = answer_to(made, folder / "run", asked), next(iter(made.made.answer.terms), None)
        else:
            try:
                experiment = make(seed=seed, folder=folder / "rig")
            except AssertionError as weak:
                print(f"{case}, seed {seed}: {weak}", flush=True)
                return {"case": case, "seed": seed, "all": every, "right": None}
            said = launches.said_of(experiment, folder / "run", TERMS if every else terms(few))
    right, reported = launches.is_right(hidden, said), [said["named"], *said["alternatives"]]
    row = {"case": case, "seed": seed, "all": every, "hidden": hidden, "right": right, "verdict": said["verdict"]}
    row |= {"reported": reported, "named": said["named"] == [hidden], "cpu_s": round(time.process_time() - begun)}
    print(row, flush=True)
    return row


def main() -> None:
    """Count every case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", type=int, default=10, help="data sets of every case")
    parser.add_argument("--seed", type=int, default=1, help="of the first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", default="", help="cases whose name contains this")
    parser.add_argument("--all", action="store_true", help="the whole catalogue")
    parser.add_argument("--out", type=Path, default=Path("observable-rates.jsonl"))
    given = parser.parse_args()
    done = [json.loads(line) for line in given.out.read_text().splitlines()] if given.out.exists() else []
    known = {(row["case"], row["seed"]) for row in done if row["all"] == given.all}
    cases = [case for case in CASES if given.only in case]
    wanted = [(case, seed) for seed in range(given.seed, given.seed + given.each) for case in cases]
    left = [one for one in wanted if one not in known]
    for row in Parallel(given.jobs, return_as="generator")(delayed(answered)(*one, given.all) for one in left):
        done.append(row)
        with given.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
    for case in cases:
        found = [row for row in done if row["case"] == case and row["all"] == given.all]
        rows = [row for row in found if row["right"] is not None]  # the others' cause is too weak in those readings
        if not rows:
            continue
        right, named = (sum(row[key] for row in rows) for key in ("right", "named"))
        low, high = binomtest(right, len(rows)).proportion_ci()
        alone = "" if rows[0]["hidden"] is None else f", {named} named first"
        print(f"{case}: right {right} of {len(rows)} ({100 * low:.0f}-{100 * high:.0f} %){alone}")


if __name__ == "__main__":
    main()

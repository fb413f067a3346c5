"""`python benchmarks/surprises.py`: strengths far beyond the plausible, and balls that lean.

Readings are simulated by the literal reference in the study's design, and leans in another rig's, too (12 g on 150 mm),
with 5 % scatter and 0.1 um. Each is searched with the whole catalogue. What counts: the cause is in a reported set, and
where its strength is implausible, that is flagged there. Results are appended to a file; those in it are not repeated.
"""

from __future__ import annotations

import argparse
import json
import os

if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")

import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from psafit.challenge.hide import simulate_literally
from psafit.diagnose.searching import searched
from psafit.experiment import Experiment, fingerprint, read_as, read_experiment
from psafit.inference.problem import Problem
from psafit.physics import TERMS, terms
from psafit.simulate import Design

CONTACT = {"k_c": 1.1e6, "c_s": 500.0, "c_c": 60.0}


@dataclass(frozen=True)
class Surprise:
    """What is hidden: causes with their values, in one of two rigs."""

    name: str
    hidden: tuple[tuple[str, tuple[tuple[str, float], ...]], ...]
    cause: str
    other_rig: bool = False


def wanted() -> list[Surprise]:
    """Twelve leans, and fifteen strengths of 3, 10 and 50 times the plausible."""
    leans = []
    for other in (False, True):
        for hertz in (False, True):
            for x_0 in (3e-3, 6e-3, 12e-3):
                more = (("hertz_exponent", (("hertz_n", 1.5),)),) if hertz else ()
                name = f"lean of {1e3 * x_0:g} mm{', Hertz' * hertz}{', other rig' * other}"
                leans.append(Surprise(name, (("preload", (("preload_offset", x_0),)), *more), "preload", other))
    plausible = {
        "amplifier_lag": ("amplifier_lag_tau", 1e-4),
        "adhesion": ("adhesion_force", 5e-3),
        "gap": ("gap_width", 1e-6),
        "swing_drag": ("swing_drag_rate", 0.1),
        "reading_offset": ("reading_offset_b", 3e-7),
    }
    strengths = [
        Surprise(f"{cause}, {factor} times", ((cause, ((parameter, factor * sd),)),), cause)
        for cause, (parameter, sd) in plausible.items()
        for factor in (3, 10, 50)
    ]
    return [*leans, *strengths]


def readings(one: Surprise, seed: int) -> Experiment:
    """Readings of the study's conditions, or of the other rig's, with causes hidden in them."""
    study = read_experiment(ROOT / "experiments" / "psa")
    constants = replace(study.constants, M=0.012, l=0.15) if one.other_rig else study.constants
    chosen = terms([id for id, _ in one.hidden])
    values = dict(CONTACT) | {name: value for _, pairs in one.hidden for name, value in pairs}
    design = Design.of(constants, study.groups)
    true = simulate_literally(design, values, chosen, study.ids)
    rng = np.random.default_rng(seed)
    read = np.maximum(true + np.hypot(0.05 * true, 0.1) * rng.standard_normal(true.size), 0.0)
    groups = read_as(study.groups, np.round(read, 2))
    return Experiment(one.name, "simulated", constants, groups, Path(), fingerprint(constants, groups))


def measure(one: Surprise, seed: int) -> dict[str, Any]:
    """Search the readings of one."""
    experiment = readings(one, seed)
    problem = Problem(experiment, experiment.ids)
    begun = time.process_time()
    found = searched(problem, TERMS, seed=seed)
    sets = [found.best_model.ids, *found.rivals(found.best_model.ids)]
    best = next((ids for ids in sets if one.cause in ids), None)
    flagged = []
    if best is not None:
        candidate = found.of(best)
        flagged = candidate.problem.implausible(candidate.values)
    return {
        "name": one.name,
        "cause": one.cause,
        "reported": sets,
        "in_the_set": best is not None,
        "first": one.cause in found.best_model.ids,
        "flagged": flagged,
        "gain": found.gain(found.best_model.ids),
        "cpu_s": time.process_time() - begun,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="those whose name contains this")
    parser.add_argument("--out", type=Path, default=Path("surprises.jsonl"))
    words = parser.parse_args()
    done = [json.loads(row) for row in words.out.read_text().splitlines()] if words.out.exists() else []
    for one in wanted():
        if words.only not in one.name or one.name in {row["name"] for row in done}:
            continue
        row = measure(one, words.seed)
        done.append(row)
        with words.out.open("a") as file:
            file.write(json.dumps(row) + "\n")
        sets = "; ".join(" + ".join(ids) or "nothing" for ids in row["reported"])
        print(f"{one.name}: {'in' if row['in_the_set'] else 'NOT IN'} {sets}; implausible: {row['flagged']};"
              f" gain {row['gain']:.0f} nats; {row['cpu_s']:.0f} s", flush=True)  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())

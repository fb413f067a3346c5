"""Which ties of launch ranges another observable breaks, by refits (table in `docs/limits.md`).

For each tie one side makes readings without scatter, at a plausible strength, and the other side is fitted to them with
the baseline, by least squares in units of the scatter. What is left, in nats, is what readings would speak against the
wrong side: of launch ranges alone, with another observable read of the same launches, and with the ball's velocity
over time in one launch more. Every refit that is done is kept in a file, and not done again.

    python benchmarks/ties.py --out fits/ties.jsonl
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from psafit.arrays import FloatArray
from psafit.diagnose.isolability import IsolabilitySettings
from psafit.diagnose.possible import TraceSettings, contact_times, traces
from psafit.experiment import Experiment, Group, read_experiment
from psafit.inference import noise
from psafit.inference.optimiser import gradient
from psafit.inference.problem import Problem
from psafit.observables import OBSERVABLES, OF_LAUNCHES, VELOCITY
from psafit.physics import baseline, terms
from psafit.simulate import Design, simulate
from psafit.simulate.sensitivity import RIGS, in_scatter, plausible

STUDY = Path(__file__).resolve().parents[1] / "experiments" / "psa"
TIES = (
    ("preload", "flight_friction"),
    ("amplitude_scale", "stroke_tolerance"),
    ("session_lean", "preload"),
    ("session_lean", "sliding_support"),
    ("flight_friction", "sliding_support"),
    ("flight_friction", "adhesion"),
    ("reading_offset", "amplifier_lag"),
    ("stack_stiffness", "modal_mass"),
    ("soft_layer", "gap"),
    ("hunt_crossley", "indentation_damping"),
    ("hunt_crossley", "no_tension"),
    ("hysteresis+stroke_tolerance", "hysteresis+amplifier_lag"),
)
TRACED = OBSERVABLES.index(VELOCITY)
SETS = tuple(tuple(sorted({0, k})) for k in (*range(len(OF_LAUNCHES)), TRACED))


@dataclass(frozen=True)
class Refit:
    """What a rival leaves of the truth's readings.

    Parameters
    ----------
    truth, rival : str
        Causes.
    place : str
        Of the baseline, as `psafit.simulate.sensitivity.RIGS` names it.
    observables : list of str
    seen : float, nats
        What the baseline leaves.
    nats : float
        What the rival leaves.
    """

    truth: str
    rival: str
    place: str
    observables: list[str]
    seen: float
    nats: float


def conditions(every: int, traced_hz: float) -> Experiment:
    """The study's conditions, one in so many of them, with all observables read of each launch, and one more traced."""
    study = read_experiment(STUDY)
    groups = []
    for g in study.groups:
        g = replace(g.at(np.arange(g.n_points)[::every]), sigma=None)
        rows, kinds = np.tile(np.arange(g.n_points), len(OF_LAUNCHES)), np.repeat(range(len(OF_LAUNCHES)), g.n_points)
        g = g.at(rows)
        groups.append(replace(g, row=rows, measured=kinds))
    return replace(study, groups=(*groups, traced(study, traced_hz)))


def traced(study: Experiment, near: float) -> Group:
    """The ball's velocity in the launch that `psafit plan --isolability` would try at the frequency nearest to this."""

    def contact(design: Design) -> FloatArray:
        return np.asarray(np.fmax.reduce([contact_times(simulate(design, theta))[0] for theta in RIGS.values()]))

    possible = traces(study.constants, study.groups, study.limits, contact, TraceSettings())
    designs = [p.design for p in possible if p.design.measured[0] == TRACED]
    d = min(designs, key=lambda d: abs(np.log(d.frequency[0] / near)))
    return Group(
        len(study.groups) + 1, d.drives[0], "trace.csv", d.frequency, d.amplitude, time_us=1e6 * d.time,
        measured=d.measured, reading=np.ones(d.n_points),
    )  # fmt: skip


def start(problem: Problem, theta: Sequence[float], share: float, rng: np.random.Generator | None) -> np.ndarray:
    """A point of a model: its causes at a plausible strength; what sessions have for themselves drawn, or usual."""
    x = problem.to_physical(problem.prior_transform(np.full((1, problem.n_dim), 0.5)))[0]
    n = len(baseline.PARAMETERS)
    x[:n] = theta
    for term in problem.terms:
        own = plausible(term, share)
        x[n : n + own.size] = own
        n += own.size
    u = problem.to_sampling(x)
    if rng is not None:
        sessions = slice(problem.n_physical, problem.n_model)
        u[sessions] = rng.standard_normal(problem.n_model - problem.n_physical)
    return np.clip(u, problem.bounds[:, 0] + 1e-6, problem.bounds[:, 1] - 1e-6)


def left(
    problem: Problem, starts: Sequence[np.ndarray], exact: np.ndarray, kinds: Sequence[int], evaluations: int
) -> tuple[float, np.ndarray]:
    """What a model leaves of readings without scatter, refitted from some starts, nats; and where that is."""
    measured = problem.design.measured
    scatter = IsolabilitySettings().scatter(problem.design)
    scale = [row[0] for row in noise.columns(scatter)[:2]]
    blank = np.array([OBSERVABLES[k].blank for k in measured])
    used = np.isin(measured, kinds) & ~(blank & (exact == 0.0))
    target, n = in_scatter(exact, *scale), problem.n_model
    bounds = problem.bounds[:n]

    def residual(u: np.ndarray) -> np.ndarray:
        rows = np.hstack([u, np.tile(starts[0][n:], (len(u), 1))])
        off = noise.whitened(in_scatter(problem.predict(rows), *scale) - target, scatter)[:, used]
        # What a session has for itself is standard normal: a rival does not have it for nothing.
        return np.hstack([np.nan_to_num(off, nan=1e3), u[:, problem.n_physical :]])

    ends = [
        least_squares(
            lambda u: residual(u[None])[0], u[:n], jac=lambda u: gradient(residual, u, bounds).T,
            bounds=(bounds[:, 0], bounds[:, 1]), max_nfev=evaluations, ftol=1e-4, xtol=1e-4,
        )
        for u in starts
    ]  # fmt: skip
    best = min(ends, key=lambda end: float(end.cost))
    return float(best.cost), np.concatenate([best.x, starts[0][n:]])


def refits(words: argparse.Namespace, done: set[tuple[str, ...]]) -> Iterator[Refit]:
    """Return what is not done yet."""
    experiment = conditions(words.every, words.traced)
    for (one, other), place in itertools.product(TIES, words.places):
        for truth, rival in ((one, other), (other, one)):
            if (truth, rival, place) in done:
                continue
            true = Problem(experiment, experiment.ids, terms(truth.split("+")))
            rng = np.random.default_rng(words.seed)
            exact = true.predict(start(true, RIGS[place], words.share, rng)[None])[0]
            plain, wrong = replace(true, terms=()), replace(true, terms=terms(rival.split("+")))
            near = [start(wrong, RIGS[place], share, None) for share in words.starts]
            least = dict.fromkeys(SETS, np.inf)
            # What fits more readings may fit fewer of them better than was found: from there again.
            for kinds in (*SETS, SETS[0]):
                nats, end = left(wrong, near, exact, kinds, words.evaluations)
                near, least[kinds] = [*near, end], min(nats, least[kinds])
            for kinds, nats in least.items():
                seen, _ = left(plain, [start(plain, RIGS[place], 0.0, None)], exact, kinds, words.evaluations)
                yield Refit(truth, rival, place, names(kinds), seen, min(nats, seen))


def key(one: Refit) -> tuple[str, str, str, str]:
    return one.truth, one.rival, one.place, one.observables[-1]


def names(kinds: Sequence[int]) -> list[str]:
    return [OBSERVABLES[k].name for k in kinds]


def table(found: Sequence[Refit], apart: float) -> str:
    """A row for each side of a tie that launch ranges leave at some place, and in a cell the places one by one.

    A dash stands where the cause shows in no launch range.
    """
    also = [("" if k == 0 else " and a trace" if k == TRACED else f" and {OBSERVABLES[k].plural}") for *_, k in SETS]
    heads = [f"ranges{what}" for what in also]
    lines = [f"| readings of | fitted by | {' | '.join(heads)} |", "|---|---|" + "---|" * len(SETS)]
    for truth, rival in (side for pair in TIES for side in (pair, pair[::-1])):
        by = {(r.place, *r.observables): r for r in found if (r.truth, r.rival) == (truth, rival)}
        places = [p for p in RIGS if (p, *names(SETS[0])) in by and by[p, *names(SETS[0])].seen >= apart]
        if not any(by[p, *names(SETS[0])].nats < apart for p in places):
            continue
        each = [{p: by[p, *names(kinds)].nats for p in places} for kinds in SETS]
        cells = [" / ".join(said(nats[p], each[0][p], apart) if p in nats else "–" for p in RIGS) for nats in each]
        lines.append(f"| `{truth}` | `{rival}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def said(nats: float, ranges: float, apart: float) -> str:
    """What is left, in nats; bold where ranges alone leave too little."""
    text = f"{nats:.1f}" if nats < 10 else f"{nats:.0f}"
    return f"**{text}**" if ranges < apart <= nats else text


def main() -> int:
    """Refit what is not done yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="keeps the refits, one a line")
    parser.add_argument("--every", type=int, default=7, help="one in so many of the study's conditions")
    parser.add_argument("--traced", type=float, default=2700.0, help="the launch that is traced is nearest to it, Hz")
    parser.add_argument("--share", type=float, default=0.7, help="strength of the truth, as a share of its prior")
    parser.add_argument("--starts", type=float, nargs="+", default=[0.2, 0.7], help="strengths a rival starts from")
    parser.add_argument("--evaluations", type=int, default=20, help="of least squares, at most")
    parser.add_argument("--places", nargs="+", choices=list(RIGS), default=list(RIGS), help="of the baseline")
    parser.add_argument("--seed", type=int, default=1, help="what sessions have for themselves is drawn from it")
    words = parser.parse_args()
    words.out.parent.mkdir(parents=True, exist_ok=True)
    lines = words.out.read_text("utf-8").splitlines() if words.out.exists() else []
    found = [Refit(**json.loads(line)) for line in lines]
    # A side at a place is done as a whole.
    count = Counter((truth, rival, place) for truth, rival, place, _ in {key(r) for r in found})
    done = {side for side, n in count.items() if n == len(SETS)}
    found = [r for r in found if key(r)[:3] in done]
    total, begun = 2 * len(TIES) * len(words.places) * len(SETS), time.process_time()
    with words.out.open("a", encoding="utf-8") as file:
        for one in refits(words, done):
            found.append(one)
            file.write(json.dumps(vars(one)) + "\n")
            file.flush()
            print(f"{len(found)} of {total}, {time.process_time() - begun:.0f} s of CPU", file=sys.stderr, flush=True)
    print(table(found, IsolabilitySettings().apart))
    return 0


if __name__ == "__main__":
    sys.exit(main())

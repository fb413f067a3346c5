"""The yardstick of the search among causes: what it finds on data sets with known answers, and what that costs.

``python benchmarks/search.py --out benchmarks/search.jsonl`` searches every data set of `search_sets.py`, one after the
other in one thread, and writes one line of JSON for each. A run that was broken off goes on with the same command.
``python benchmarks/search.py --compare OLD NEW`` puts two such files side by side, and exits with 1 where the new one
is worse.

For each data set:

- *the best*: the set that the search puts first. Its log posterior is the log evidence plus the log prior over sets.
  The yardstick computes that evidence itself, from the modes that the search has found, and so does not believe it.
- *the truth*: whether the search fitted that set, at which rank and probability, and whether it reports it. The log
  posterior of the truth comes from a plain fit from many draws of its prior, which the search does not help.
- *missed*: log posterior of the truth above the best's, nats. Above zero, the search has missed a better set.
- *cost*: models fitted, trajectories simulated, and seconds of CPU of the search alone. A fixed piece of work is timed
  before and after it, since a core that others share is slower.

All that depends on the search is in `search`; all that depends on how a model is fitted is in `evidence_of` and
`from_scratch`.
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
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from search_sets import GROUPS, DataSet, get, wanted

from psafit.diagnose.searching import searched
from psafit.experiment import write_experiment
from psafit.files import write_atomically
from psafit.inference.candidate import Candidate, candidate_at, candidate_of, fit
from psafit.inference.evidence import importance_sample
from psafit.inference.memory import code
from psafit.inference.optimiser import maximise
from psafit.inference.problem import Problem
from psafit.model_search import SearchSettings, model_set
from psafit.physics import TERMS, terms
from psafit.simulate import closed_form, stepper

Ids = tuple[str, ...]


# --- what depends on the search and on how models are fitted --------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Found:
    """What a search says of some readings.

    Parameters
    ----------
    log_posterior : dict
        Of every set fitted: log evidence, as the search has it, plus log prior over sets.
    probability : dict
        Of every set that the search gives one, fitted or not.
    order : tuple of Ids
        Sets fitted, the best first.
    reported : tuple of Ids
        The best, and those that are reported with it as doing as well.
    modes : (n_modes, n_dim) array
        Of the best, in the sampling coordinates of its problem.
    """

    log_posterior: dict[Ids, float]
    probability: dict[Ids, float]
    order: tuple[Ids, ...]
    reported: tuple[Ids, ...]
    modes: np.ndarray


def search(problem: Problem, seed: int, most: int, progress: Callable[[str], None], jobs: int = 1) -> Found:
    """Search all causes, in sets of at most `most`, in so many processes; `problem` has none."""
    settings = SearchSettings(most_causes=most)
    found = searched(problem, TERMS, seed=seed, progress=progress, settings=settings, jobs=jobs)
    return Found(
        {ids: value + found.log_prior(ids) for ids, value in found.log_evidence.items()},
        found.probability,
        tuple(c.ids for c in found.candidates),
        (found.best_model.ids, *found.rivals(found.best_model.ids)),
        found.best_model.modes,
    )


def log_prior(ids: Ids) -> float:
    """Log prior probability of a set of causes."""
    return model_set.log_prior(ids, model_set.beliefs(TERMS))


def evidence_of(candidate: Candidate, seed: int, rounds: int = 3) -> tuple[float, float, Candidate]:
    """Log evidence of a fitted model by importance sampling, its standard error, and the model.

    It is fitted again from the best draw while that is higher than the best mode.
    """
    sampled = importance_sample(candidate, seed=seed)
    for _ in range(rounds):
        if sampled.log_posterior < candidate.log_posterior + 0.5:
            break
        problem = candidate.problem
        candidate = candidate_of(problem, maximise(problem, np.vstack([candidate.modes, sampled.top])))
        sampled = importance_sample(candidate, seed=seed)
    return sampled.log_evidence, sampled.standard_error, candidate


def from_scratch(problem: Problem, seeds: Sequence[int]) -> tuple[Candidate, list[float]]:
    """Fit a model from draws of its prior alone, and the log posterior density at the top that each seed leads to."""
    draws, most = (1024, 24) if problem.terms else (4096, 48)
    fits = [fit(problem, (), seed=seed, draws=draws, most=most) for seed in seeds]
    return candidate_at(problem, np.vstack([c.modes for c in fits])), [c.log_posterior for c in fits]


@contextmanager
def counted() -> Iterator[dict[str, int]]:
    """Count the trajectories that are simulated meanwhile, by the path that simulates them.

    A contact that several parameter sets have in common is simulated once, and counted once.
    """
    count = {"closed form": 0, "stepper": 0}
    exact, steps = closed_form.separation, stepper.separation

    def counted_exact(design: Any, rig: Any, *rest: Any) -> Any:
        count["closed form"] += len(rig.k_c) * design.n_points
        return exact(design, rig, *rest)

    def counted_steps(design: Any, rig: Any, sets: Any, calls: Any, tolerance: float, wanted: Any, **more: Any) -> Any:
        count["stepper"] += int(np.count_nonzero(wanted))
        return steps(design, rig, sets, calls, tolerance, wanted, **more)

    closed_form.separation, stepper.separation = counted_exact, counted_steps
    try:
        yield count
    finally:
        closed_form.separation, stepper.separation = exact, steps


# --- one data set ---------------------------------------------------------------------------------------------------


def _leading(found: Found, n: int) -> list[dict[str, Any]]:
    """The best models of a search, for the record."""
    best = sorted(found.log_posterior, key=lambda ids: -found.log_posterior[ids])[:n]
    return [
        {
            "causes": list(ids),
            "log_posterior": round(found.log_posterior[ids], 3),
            "probability": float(f"{found.probability.get(ids, 0.0):.3g}"),
        }
        for ids in best
    ]


def measure(
    data: DataSet,
    seed: int,
    *,
    most: int,
    jobs: int = 1,
    known: Mapping[str, Any] | None = None,
    tolerance: float = 1e-4,
    shown: int = 10,
    progress: Callable[[str], None] = lambda what: None,
) -> dict[str, Any]:
    """Search one data set, and compare what is found with what is hidden.

    Parameters
    ----------
    data : DataSet
    seed : int
        Of the search.
    most : int
        Causes up to which it must look.
    jobs : int
        Processes of the search. Of several, trajectories are those of this one alone; seconds of CPU are of all.
    known : dict, optional
        What `truth_alone` found before.
    tolerance : float
        Of the simulator, as a diagnosis has it.
    shown : int
        Models that are kept in the record.
    progress : callable
        Called with what is being done.
    """
    problem = Problem(data.experiment, data.experiment.ids, tolerance=tolerance)
    warm_up(problem)
    before = pace()
    wall, cpu = time.monotonic(), cpu_s()
    with counted() as trajectories:
        found = search(problem, seed, most, progress, jobs)
    cpu, wall = cpu_s() - cpu, time.monotonic() - wall
    work = 0.5 * (before + pace())
    best = found.order[0]
    evidence, error, _ = evidence_of(candidate_at(replace(problem, terms=terms(best)), found.modes), seed=1)
    progress("the truth alone")
    alone = dict(known) if known else truth_alone(data, problem)
    log_posterior = evidence + log_prior(best)
    return {
        "id": data.id,
        "group": data.group,
        "about": data.about,
        "fingerprint": data.experiment.fingerprint,
        "code": code(),
        "seed": seed,
        "most": most,
        "jobs": jobs,
        "n_readings": int(problem.observed.size),
        "gain": data.gain,
        "truth": None if data.truth is None else list(data.truth),
        "truth_alone": alone,
        "truth_found": _truth_found(data.truth, found),
        "missed": alone["log_posterior"] - log_posterior if alone else None,
        "best": {
            "causes": list(best),
            "log_posterior": log_posterior,
            "standard_error": error,
            "by_the_search": found.log_posterior[best],
            "probability": found.probability.get(best, 0.0),
        },
        "reported": [list(ids) for ids in found.reported],
        "leading": _leading(found, shown),
        "nothing": found.log_posterior.get(()),
        "n_fitted": len(found.log_posterior),
        "trajectories": trajectories,
        "cpu_s": round(cpu, 2),
        "wall_s": round(wall, 2),
        "pace_s": round(work, 4),
    }


def _truth_found(truth: Ids | None, found: Found) -> dict[str, Any]:
    """What a search has made of the truth; nothing where that is not known."""
    if truth is None:
        return {}
    fitted = truth in found.log_posterior
    return {
        "fitted": fitted,
        "reported": truth in found.reported,
        "rank": found.order.index(truth) + 1 if fitted else None,
        "probability": found.probability.get(truth),
        "log_posterior": found.log_posterior.get(truth),
    }


def truth_alone(data: DataSet, problem: Problem, seeds: Sequence[int] = (1, 2)) -> dict[str, Any]:
    """Log posterior of the truth from a plain fit of it alone; nothing where it is not known."""
    if data.truth is None:
        return {}
    cpu = time.process_time()
    candidate, tops = from_scratch(replace(problem, terms=terms(data.truth)), seeds)
    evidence, error, candidate = evidence_of(candidate, seed=1)
    return {
        "log_posterior": evidence + log_prior(data.truth),
        "standard_error": error,
        "log_likelihood": candidate.log_likelihood,
        "tops": [round(top, 3) for top in tops],
        "cpu_s": round(time.process_time() - cpu, 2),
    }


def cpu_s() -> float:
    """Seconds of CPU of this process, and of those that it has started and that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def pace(repeats: int = 400) -> float:
    """Seconds of CPU that a fixed piece of work takes, of which psafit is no part: how slow the machine is just now."""
    rng = np.random.default_rng(0)
    matrices, numbers = rng.standard_normal((200, 12, 12)), rng.standard_normal(100_000)
    begun = time.process_time()
    for _ in range(repeats):
        np.linalg.solve(matrices, matrices)
        np.exp(numbers).sum()
    return time.process_time() - begun


def warm_up(problem: Problem) -> None:
    """Compile what a search will need: it is no part of its cost."""
    for some in [(), *((t,) for t in TERMS), TERMS]:
        whole = replace(problem, terms=some)
        whole.predict(whole.prior_transform(np.full((1, whole.n_dim), 0.5)))


# --- many data sets -------------------------------------------------------------------------------------------------


def read(file: Path) -> dict[str, dict[str, Any]]:
    """Records of a file, by data set; none if there is no file."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return {record["id"]: record for record in map(json.loads, lines)}


def run(
    ids: Sequence[str],
    file: Path,
    *,
    seed: int,
    quick: bool = False,
    jobs: int = 1,
    truths: Mapping[str, Mapping[str, Any]] | None = None,
    say: Callable[[str], None] = print,
) -> int:
    """Search the data sets that the file has no record of, and add theirs; how many could not be searched.

    A record of other readings, another seed or another state of the sources is replaced.
    """
    failed = 0
    for k, id in enumerate(ids, 1):
        say(f"{k} of {len(ids)}: {id}")
        try:
            data = get(id)
            most = 4 if quick else data.most
            records = read(file)
            if _is_of(records.get(id), data, seed, most, jobs):
                continue
            before = (truths or {}).get(id, {})
            known = before.get("truth_alone") if before.get("fingerprint") == data.experiment.fingerprint else None
            record = measure(data, seed, most=most, jobs=jobs, known=known, progress=_shown)
        except Exception:  # hours of other searches do not end with one that fails
            failed += 1
            say(traceback.format_exc())
            continue
        records[id] = record
        lines = (json.dumps(one) for one in records.values())
        write_atomically(file, "".join(f"{line}\n" for line in lines).encode())
        say(f"  {in_words(record)}")
    return failed


def _is_of(record: Mapping[str, Any] | None, data: DataSet, seed: int, most: int, jobs: int) -> bool:
    """Whether a record is what the same command would give."""
    asked = {"fingerprint": data.experiment.fingerprint, "seed": seed, "most": most, "jobs": jobs, "code": code()}
    return record is not None and all(record.get(key, 1) == value for key, value in asked.items())


def _shown(what: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K  {what}"[:150], end="", file=sys.stderr, flush=True)


def in_words(record: Mapping[str, Any]) -> str:
    """One line on what was found."""
    best, truth = record["best"], record["truth_found"]
    parts = [
        f"best {named(best['causes'])} ({best['probability']:.2f})",
        f"{record['cpu_s']:.0f} s of CPU, {record['wall_s']:.0f} s",
    ]
    parts.append(f"{record['n_fitted']} models")
    if truth:
        how = "reported" if truth["reported"] else "fitted" if truth["fitted"] else "NOT FITTED"
        parts.append(f"truth {named(record['truth'])} {how}, {record['missed']:+.1f} nats above the best")
    return ", ".join(parts)


def named(causes: Sequence[str]) -> str:
    return " + ".join(causes) or "nothing"


# --- two runs -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One data set in two runs.

    Parameters
    ----------
    id : str
    truth : str
        In words; empty where it is not known.
    fitted, reported : pair of bool or None
        Whether the truth was, before and now.
    missed : pair of float or None
        Log posterior of the truth above the best's, nats.
    log_posterior : pair of float
        Of the best.
    cpu_s : pair of float
    cost : pair of float
        Seconds of CPU over those of the fixed piece of work.
    flags : tuple of str
        "worse": the best has a log posterior lower by more than is allowed; "lost": the truth was reported and is no
        longer; "slower"; "gained": the truth is reported and was not; "not comparable": other readings, or sets of
        other sizes looked at.
    """

    id: str
    truth: str
    fitted: tuple[bool | None, bool | None]
    reported: tuple[bool | None, bool | None]
    missed: tuple[float | None, float | None]
    log_posterior: tuple[float, float]
    cpu_s: tuple[float, float]
    cost: tuple[float, float]
    flags: tuple[str, ...]


def compare(
    old: Mapping[str, Mapping[str, Any]],
    new: Mapping[str, Mapping[str, Any]],
    *,
    lower: float = 0.5,
    slower: float = 1.5,
) -> list[Row]:
    """Compare the data sets that both runs have.

    Parameters
    ----------
    old, new : dict
        Records by data set, as `read` gives them.
    lower : float, nats
        Log posterior that the best may lose.
    slower : float
        Factor by which the cost may grow.
    """
    rows = []
    for id in (id for id in old if id in new):
        a, b = old[id], new[id]
        best = a["best"]["log_posterior"], b["best"]["log_posterior"]
        reported = a["truth_found"].get("reported"), b["truth_found"].get("reported")
        cost = a["cpu_s"] / a["pace_s"], b["cpu_s"] / b["pace_s"]
        flags = []
        if any(a[key] != b[key] for key in ("fingerprint", "most")):
            flags.append("not comparable")
        else:
            flags += ["worse"] if best[1] < best[0] - lower else []
            flags += {(True, False): ["lost"], (False, True): ["gained"]}.get(reported, [])
            flags += ["slower"] if cost[1] > slower * cost[0] else []
        rows.append(
            Row(
                id,
                "" if a["truth"] is None else named(a["truth"]),
                (a["truth_found"].get("fitted"), b["truth_found"].get("fitted")),
                reported,
                (a["missed"], b["missed"]),
                best,
                (a["cpu_s"], b["cpu_s"]),
                cost,
                tuple(flags),
            )
        )
    return rows


def is_worse(rows: Sequence[Row]) -> bool:
    """Whether a new search must not take an old one's place."""
    return any({"worse", "lost"} & set(row.flags) for row in rows)


def table(rows: Sequence[Row]) -> str:
    """Format a comparison as a table in Markdown, with what it comes to in all."""
    if not rows:
        return "no data set is in both files"
    titles = ["data set", "truth", "fitted", "reported", "missed, nats", "best, nats", "CPU, s", "cost", ""]
    lines = [titles, ["---"] * len(titles)]
    for row in rows:
        change = row.log_posterior[1] - row.log_posterior[0]
        cells = [row.id, row.truth or "?", *(_both(pair, _yes) for pair in (row.fitted, row.reported))]
        cells += [_both(row.missed, lambda x: f"{x:.1f}"), "" if "not comparable" in row.flags else f"{change:+.1f}"]
        cells += [_both(row.cpu_s, lambda x: f"{x:.0f}"), f"x {row.cost[1] / row.cost[0]:.2f}", ", ".join(row.flags)]
        lines.append(cells)
    known = [row for row in rows if row.truth]
    count = [[sum(bool(getattr(row, what)[k]) for row in known) for k in (0, 1)] for what in ("fitted", "reported")]
    seconds, cost = ([sum(getattr(row, what)[k] for row in rows) for k in (0, 1)] for what in ("cpu_s", "cost"))
    flagged = {flag: sum(flag in row.flags for row in rows) for flag in ("worse", "lost", "gained", "slower")}
    return "\n".join(
        [
            *("| " + " | ".join(cells) + " |" for cells in lines),
            "",
            f"{len(rows)} data sets, the truth of {len(known)} known: fitted {count[0][0]} -> {count[0][1]},"
            f" reported {count[1][0]} -> {count[1][1]}; CPU {seconds[0]:.0f} -> {seconds[1]:.0f} s,"
            f" cost x {cost[1] / cost[0]:.2f};"
            f" {', '.join(f'{n} {flag}' for flag, n in flagged.items())}",
        ]
    )


def _both(pair: tuple[Any, Any], form: Callable[[Any], str]) -> str:
    return " -> ".join("" if x is None else form(x) for x in pair) if any(x is not None for x in pair) else ""


def _yes(x: bool) -> str:
    return "yes" if x else "no"


def positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="ID,...", help="these data sets alone")
    parser.add_argument("--group", metavar="GROUP,...", default=",".join(GROUPS), help=f"of {', '.join(GROUPS)}; all")
    parser.add_argument("--limit", type=positive, metavar="N", help="the first so many of them alone")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/search.jsonl"), help="receives the records")
    parser.add_argument("--quick", action="store_true", help="at most four causes everywhere, in the study, too")
    parser.add_argument("--seed", type=int, default=1, help="of the searches")
    parser.add_argument("--jobs", type=positive, default=1, metavar="N", help="processes of each search")
    parser.add_argument("--truths", type=Path, metavar="FILE", help="take the plain fits of the truths from this file")
    parser.add_argument("--list", action="store_true", help="list the data sets, and search none")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write them as experiments, and search none")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("OLD", "NEW"), help="compare two files of records")
    words = parser.parse_args()
    if words.compare:
        for file in words.compare:
            if not file.is_file():
                parser.error(f"{file} is missing: give two files that --out has written")
        old, new = map(read, words.compare)
        rows = compare(old, new)
        print(table(rows))
        if alone := sorted(old.keys() ^ new.keys()):
            print(f"in one of the files alone: {', '.join(alone)}")
        return int(is_worse(rows))
    groups = words.group.split(",")
    if unknown := set(groups) - set(GROUPS):
        parser.error(f"there is no group {', '.join(sorted(unknown))}: choose from {', '.join(GROUPS)}")
    ids = wanted(groups)
    if words.only:
        there = wanted(GROUPS)
        ids = words.only.split(",")
        if unknown := set(ids) - set(there):
            parser.error(f"there is no data set {', '.join(sorted(unknown))}: --list lists them")
    ids = ids[: words.limit]
    if words.list:
        print("\n".join(ids))
        return 0
    if words.write:
        for id in ids:
            write_experiment(get(id).experiment, words.write / id)
        return 0
    try:
        failed = run(
            ids,
            words.out,
            seed=words.seed,
            quick=words.quick,
            jobs=words.jobs,
            truths=read(words.truths) if words.truths else None,
            say=lambda text: print(text, flush=True),
        )
    except KeyboardInterrupt:
        print("interrupted; repeat the same command to go on where it stopped", file=sys.stderr)
        return 2
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())

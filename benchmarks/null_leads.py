"""`make null-leads`: how far chance leads, in searches of readings with nothing hidden.

A design is drawn with about so many readings, a baseline and its scatter from the priors of a diagnosis, the readings
are simulated by the literal reference, and the search of a diagnosis looks at the whole catalogue. What its best model
with causes leads the baseline by goes into psafit/diagnose/null_leads.json, from which `psafit diagnose` reads how
often a search finds as much by chance.

Sizes are taken in turn, and each search is written when it is done: what was interrupted goes on without ``--anew``,
which begins a new table.
"""

from __future__ import annotations

import argparse
import os

# A search on each core.
if __name__ == "__main__":
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import psafit
from psafit.challenge.conditions import ConditionSettings
from psafit.challenge.hide import make
from psafit.diagnose.searching import searched
from psafit.diagnose.significance import NULL_LEADS, NullLead, NullLeads, lead
from psafit.errors import InputError, PsafitError
from psafit.inference.problem import Problem
from psafit.model_search import SearchSettings
from psafit.physics import TERMS
from psafit.physics.term import Term
from psafit.records import plain, read_json, write_json
from psafit.workers import processes, reach, scratch, unordered

SIZES, EACH = (60, 150, 300), 20


def blank(seed: int, catalogue: Sequence[Term], settings: SearchSettings) -> NullLeads:
    """A table without a search."""
    return NullLeads(psafit.__version__, seed, [t.id for t in catalogue], settings, [])


def wanted(table: NullLeads, sizes: Sequence[int], each: int) -> list[tuple[int, int]]:
    """Size and seed of the searches that a table lacks, one of each size in turn."""
    done = {(one.asked, one.seed) for one in table.leads}
    drawn = {n: np.random.default_rng([table.seed, 19, n]).integers(2**31, size=each).tolist() for n in sizes}
    return [(n, drawn[n][k]) for k in range(each) for n in sizes if (n, drawn[n][k]) not in done]


def search(asked: int, seed: int, catalogue: Sequence[Term], settings: SearchSettings) -> NullLead | str:
    """Search readings with nothing hidden; what a search says that fails."""
    try:
        with scratch() as folder:
            like = ConditionSettings.like_the_study()
            made = make(seed, folder, readings=asked, kind="nothing", believed=True, conditions=like)
        problem = Problem(made.experiment, made.experiment.ids)
        found = searched(problem, catalogue, seed=seed, settings=settings)
    except PsafitError as error:
        return f"{asked} readings, seed {seed}: {error}"
    return NullLead(seed, asked, int(problem.observed.size), len(made.experiment.groups), lead(found))


def fill(
    file: Path,
    table: NullLeads,
    calls: Sequence[tuple[int, int]],
    catalogue: Sequence[Term],
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    say: Callable[[str], None] = print,
) -> NullLeads:
    """Make searches that a table lacks, and write it after each.

    Parameters
    ----------
    file : Path
    table : NullLeads
    calls : sequence of (int, int)
        As of `wanted`.
    catalogue : sequence of Term
    jobs : int
        Processes.
    scheduler : str, optional
        Address of a Dask scheduler whose workers search instead.
    say : callable
        Called with a line for each.
    """
    with processes(jobs, scheduler) as usable:
        for k, one in enumerate(unordered(usable, search, [(*c, catalogue, table.settings) for c in calls]), 1):
            if isinstance(one, str):
                say(f"{k} of {len(calls)}: {one}")
                continue
            # In one order, whoever was done first.
            leads = sorted([*table.leads, one], key=lambda lead: (lead.asked, lead.seed))
            table = replace(table, leads=leads)
            write_json(file, table)
            say(f"{k} of {len(calls)}: {one.readings} readings, {one.sessions} sessions, lead {one.lead:+.2f} nats")
    return table


def summary(table: NullLeads) -> str:
    """The leads of each size in words."""
    lines = []
    for n in sorted({one.asked for one in table.leads}):
        leads = np.array([one.lead for one in table.leads if one.asked == n])
        low, middle, high = np.quantile(leads, (0.05, 0.5, 0.95))
        lines.append(
            f"about {n} readings, {leads.size} searches: median {middle:+.2f} nats, 90 % from {low:+.2f}"
            f" to {high:+.2f}, highest {leads.max():+.2f}"
        )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)), metavar="N[,N...]", help="readings of a design")
    parser.add_argument("--each", type=int, default=EACH, help="searches of each size")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--scheduler", metavar="ADDRESS", help="Dask scheduler that shares the work out")
    parser.add_argument("--out", type=Path, default=NULL_LEADS)
    parser.add_argument("--anew", action="store_true", help="begin a new table")
    words = parser.parse_args()
    if words.scheduler:
        reach(words.scheduler)
    table = new = blank(words.seed, TERMS, SearchSettings())
    if words.out.exists() and not words.anew:
        table = read_json(words.out, NullLeads)
        if plain(replace(table, leads=[], version="")) != plain(replace(new, leads=[], version="")):
            raise InputError("is of other causes, settings or another seed", "begin again: --anew", file=words.out)
    calls = wanted(table, [int(n) for n in words.sizes.split(",")], words.each)
    print(summary(fill(words.out, table, calls, TERMS, jobs=words.jobs, scheduler=words.scheduler)))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"{error}")

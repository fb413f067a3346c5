"""Fits and samples of models, and the search over readings of which the truth is known."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from clusters import two_workers
from joblib.externals.loky import get_reusable_executor
from truths import CHEAP, FEW, RIG, TRUTH, experiment, few, problem

from psafit.errors import ConvergenceError, InputError
from psafit.experiment import Group
from psafit.inference.candidate import Candidate, candidate_at
from psafit.inference.memory import Memory
from psafit.inference.problem import Problem
from psafit.model_search import ModelSet, SearchSettings, search_models
from psafit.model_search import fitter as fitting
from psafit.model_search.fitter import Fitted, ProblemFitter
from psafit.model_search.loop import Foreseen, Model
from psafit.physics import terms
from psafit.simulate import MICRO, Design, simulate

PAIR = ("amplifier_lag", "flight_friction")
SETTINGS = SearchSettings(most_causes=2)
LITTLE: Any = {"catalogue": FEW[:3], "seed": 1, "settings": CHEAP}


@pytest.fixture(scope="module")
def alone() -> ModelSet:
    """What one process finds in a few readings."""
    return search_models(few_readings(), **LITTLE)


def few_readings() -> Problem:
    return problem(experiment(["amplifier_lag"], [4e-5], n=8))


def test_a_cause_that_does_nothing_has_its_parts_evidence() -> None:
    """Though the sampled part was found at many ends of one flat ridge, and a short fit finds one of them."""
    n, v = 12, np.geomspace(3, 60, 12)
    true = simulate(Design.sweep(RIG, "square", np.full(n, 5e3), v), TRUTH, ()).launch_range[0] * MICRO
    read = true * (1 + 0.04 * np.random.default_rng(0).standard_normal(n))
    squares = replace(few([1.0]), groups=(Group("a", "square", "a.csv", np.full(n, 5e3), v, read),))
    fitter = ProblemFitter(problem(squares), terms(["start_phase"]), SETTINGS, 1, Memory(None))
    (short,) = fitter.short([()], {})
    part = fitter.sample(short)
    assert len(part.content.candidate.modes) > 2
    for fit in (fitter.short, fitter.carried):
        (larger,) = fit([("start_phase",)], {(): part})
        assert larger.log_evidence - part.laplace_off == pytest.approx(part.log_evidence, abs=0.1)


def test_a_short_fit_comes_near_the_evidence(hidden: ModelSet) -> None:
    lag = hidden.of(("amplifier_lag",))
    fitter = ProblemFitter(hidden.baseline.problem, FEW, SETTINGS, 1, Memory(None))
    known = {(): Model((), hidden.log_evidence[()], hidden.baseline.log_posterior, True, Fitted(hidden.baseline))}
    (found,) = fitter.short([lag.ids], known)
    assert found.log_evidence == pytest.approx(hidden.log_evidence[lag.ids], abs=1.0)


def test_a_model_held_below_its_top_rises_from_where_a_neighbour_is(hidden: ModelSet) -> None:
    fitter = ProblemFitter(hidden.baseline.problem, FEW, SETTINGS, 1, Memory(None))
    lag = hidden.of(("amplifier_lag",))
    moved = lag.modes[:1].copy()
    moved[0, 0] += 0.1
    held = Model(lag.ids, 0.0, lag.log_posterior, False, Fitted(candidate_at(lag.problem, moved)))
    pair = hidden.of(("amplifier_lag", "reading_offset"))
    origin = Model(pair.ids, hidden.log_evidence[pair.ids], pair.log_posterior, True, Fitted(pair))
    (risen,) = fitter.again([held], origin)
    assert (
        held.content.candidate.log_posterior < lag.log_posterior - 1
        and risen.content.candidate.log_posterior > lag.log_posterior - 0.5
    )
    assert risen.log_evidence >= held.log_evidence and risen.content.top == risen.content.candidate.log_posterior
    assert fitter.again([Model(lag.ids, 0.0, lag.log_posterior, False, Fitted(lag))], origin) == []
    # What was seen before is no news, though a sample has not kept it: two models would raise each other for ever.
    seen = replace(held, content=replace(held.content, top=risen.content.top))
    assert fitter.again([seen], origin) == []
    # What a sample has found before is kept apart: Laplace's error is no part of it.
    (again,) = fitter.again([replace(held, sampled=True, log_evidence=risen.log_evidence + 5.0)], origin)
    assert again.least == risen.log_evidence + 5.0 and again.log_evidence == again.content.candidate.laplace_of_one


@pytest.mark.parametrize("reached", [True, False])
def test_hops_are_taken_where_no_start_reached_a_mode_of_the_neighbour(
    reached: bool, hidden: ModelSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each result is kept by itself."""
    hopped: list[int] = []

    def hop(found: Candidate, *, seed: int, better: float) -> Candidate:
        hopped.append(seed)
        return found

    monkeypatch.setattr(fitting, "hopped", hop)
    memory = Memory(None)
    fitter = ProblemFitter(hidden.baseline.problem, FEW, SETTINGS, 7, memory)
    lag, pair = hidden.of(("amplifier_lag",)), hidden.of(("amplifier_lag", "reading_offset"))
    known = [Model(lag.ids, 0.0, lag.log_posterior, False, Fitted(lag))]
    for starts in (np.ones(len(pair.modes), int), np.full(len(pair.modes), int(reached))):
        there = replace(pair, starts=starts)
        fitter.again(known, Model(pair.ids, hidden.log_evidence[pair.ids], pair.log_posterior, True, Fitted(there)))
    assert hopped == ([] if reached else [7])


def test_what_a_neighbour_lacks_stays_where_a_model_has_it(hidden: ModelSet) -> None:
    pair, lag = hidden.of(("amplifier_lag", "flight_friction")), hidden.of(("amplifier_lag",))
    start = pair.problem.to_physical(fitting.merged(pair.problem, pair, lag)[None])[0]
    friction = len(lag.problem.names) - 3  # after the lag, before the scatter
    assert start[friction] == pytest.approx(pair.values[friction], abs=1e-3)
    assert start[0] == pytest.approx(lag.values[0], rel=0.01)


def test_an_exchange_is_fitted_from_the_two_models_that_know_its_parts(hidden: ModelSet) -> None:
    fitter = ProblemFitter(hidden.baseline.problem, FEW, SETTINGS, 1, Memory(None))
    whole = hidden.of(PAIR)
    known = {
        c.ids: Model(c.ids, hidden.log_evidence[c.ids], c.log_posterior, False, Fitted(c))
        for c in hidden.candidates
        if c.ids != PAIR
    }
    (found,) = fitter.carried([PAIR], known)
    assert found.log_posterior > whole.log_posterior - 0.1 and not found.sampled
    # Where nobody knows all that is lacking, what is known is used.
    few = {ids: known[ids] for ids in ((), ("reading_offset",))}
    (low,) = fitter.carried([PAIR], few)
    assert low.log_posterior > few[()].log_posterior - 3.0


def test_where_two_optima_meet_in_nothing_one_of_them_is_the_start(
    hidden: ModelSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where their values together are those of no rig that can be simulated; here they are out of bounds."""
    fitter = ProblemFitter(hidden.baseline.problem, FEW, SETTINGS, 1, Memory(None))
    parts = [hidden.of(ids) for ids in ((), PAIR[:1], PAIR[1:])]
    known = {c.ids: Model(c.ids, hidden.log_evidence[c.ids], c.log_posterior, False, Fitted(c)) for c in parts}
    monkeypatch.setattr(fitting, "merged", lambda problem, *pair: problem.bounds[:, 1] + 1.0)
    (found,) = fitter.carried([PAIR], known)
    assert found.log_posterior > max(c.log_posterior for c in parts) - 3.0


def test_what_was_fitted_is_kept(hidden: ModelSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = hidden.baseline.problem
    news: list[str] = []
    asked: Any = {"seed": 1, "settings": CHEAP}
    first = search_models(one, FEW[:1], **asked, memory=Memory(tmp_path), progress=news.append)
    assert all(any(work in what for what in news) for work in ("1 of 1 short fits", "the baseline sampled"))
    with monkeypatch.context() as patch:
        patch.delattr(fitting, "fit")
        patch.delattr(fitting, "joined")
        again = search_models(one, FEW[:1], **asked, memory=Memory(tmp_path))
    assert again.log_evidence == first.log_evidence and again.probability == first.probability


def test_a_search_of_no_causes_is_refused(hidden: ModelSet) -> None:
    with pytest.raises(InputError, match="choose 1 or more"):
        search_models(hidden.baseline.problem, FEW, seed=1, settings=SearchSettings(most_causes=0))


@pytest.mark.slow
def test_processes_search_what_one_would(alone: ModelSet, tmp_path: Path) -> None:
    for memory in (Memory(None), Memory(tmp_path)):
        shared = search_models(few_readings(), **LITTLE, jobs=2, memory=memory)
        assert shared.log_evidence == alone.log_evidence
        assert all(np.array_equal(c.modes, d.modes) for c, d in zip(shared.candidates, alone.candidates, strict=True))


@pytest.fixture(scope="module")
def paired() -> ModelSet:
    """What is found where two causes are hidden."""
    return search_models(problem(experiment(PAIR, [4e-5, 0.05], n=60)), FEW, seed=1)


@pytest.mark.slow
def test_a_pair_is_found_whatever_the_order_of_the_catalogue(paired: ModelSet) -> None:
    for found in (paired, search_models(paired.baseline.problem, FEW[::-1], seed=1)):
        assert set(found.best_model.ids) == set(PAIR) and found.probability[found.best_model.ids] > 0.9


@pytest.mark.slow
def test_a_search_goes_on_from_where_it_has_to_begin(paired: ModelSet) -> None:
    """A model that fewer readings led to is fitted in addition to the baseline, and its neighbours if it leads."""
    whole, plain = paired.baseline.problem, paired
    part = replace(plain.best_model.problem, group_ids=("a", "b"))
    known = candidate_at(part, plain.best_model.modes)
    begun = search_models(whole, FEW, seed=1, starts=[known])
    assert () in begun.samples
    assert len(begun.log_evidence) < len(plain.log_evidence)  # single causes were not asked
    assert begun.best_model.ids == plain.best_model.ids == PAIR
    assert begun.log_evidence[PAIR] == pytest.approx(plain.log_evidence[PAIR], abs=1.0)


def test_idle_processes_work_ahead_and_what_is_not_needed_yet_may_fail(
    hidden: ModelSet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was foreseen is looked up later; the sample itself is that of one process."""
    one, lag = hidden.baseline.problem, hidden.of(("amplifier_lag",))
    known = {(): Model((), hidden.log_evidence[()], hidden.baseline.log_posterior, True, Fitted(hidden.baseline))}
    alone = ProblemFitter(one, FEW, SETTINGS, 1, Memory(None))
    (model,) = alone.short([lag.ids], known)
    several = ProblemFitter(one, FEW, SETTINGS, 1, Memory(None), jobs=2)
    vars(several)["_starting"] = iter(())  # no process is needed here
    made: list[tuple[str, bool]] = []

    def eagerly(jobs: int, work: Any, calls: Any, *, waiting: int = 1) -> Any:
        """Processes that take all there is before the first result."""
        for task, needed in list(calls) if work is fitting.worked else ():
            made.append((task.key.partition("-")[0], needed))
            yield work(task, needed)

    known |= {model.ids: model} | {m.ids: m for m in alone.short([("reading_offset",)], known)}
    pair = ("amplifier_lag", "reading_offset")
    (plain,) = alone.carried([pair], known)
    with monkeypatch.context() as patch:
        patch.setattr(fitting, "unordered", eagerly)
        sampled = several.sample(model, Foreseen((), (pair,), known))
    assert made == [("second", True), ("first", True), ("optimised", False), ("sample", True)]
    assert sampled.log_evidence == alone.sample(model).log_evidence
    with monkeypatch.context() as patch:
        patch.delattr(fitting, "unordered")
        assert several.carried([pair], known)[0].log_evidence == plain.log_evidence

    def fails(problem: Any) -> Any:
        raise ConvergenceError("an optimisation", reached=0, required=1)

    task = fitting.Task("key", one, fails, ())
    assert fitting.worked(task, False) == ("key", None)
    with pytest.raises(ConvergenceError):
        fitting.worked(task, True)


def killing(memory: Memory, pids: Callable[[], Sequence[int]], dead: list[int]) -> threading.Thread:
    """A thread that kills one of some processes as soon as a few models are fitted."""

    def kill() -> None:
        while memory.count("short") < 3:
            time.sleep(0.01)
        dead.append(pids()[0])
        os.kill(dead[0], signal.SIGKILL)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_search_whose_worker_is_killed_goes_on_with_the_same_command(alone: ModelSet, tmp_path: Path) -> None:
    one, memory, dead = few_readings(), Memory(tmp_path), []  # type: ignore[var-annotated]
    killer = killing(memory, lambda: list(get_reusable_executor(reuse=True)._processes), dead)
    with pytest.raises(InputError, match=r"ended from outside.*repeat the same command"):
        search_models(one, **LITTLE, jobs=2, memory=memory)
    killer.join()
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert dead and len(kept) >= 3
    again = search_models(one, **LITTLE, jobs=2, memory=memory)
    assert again.log_evidence == alone.log_evidence
    assert {path: path.stat().st_mtime_ns for path in kept} == kept  # nothing that was done is done again


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_in_mid_search_finds_what_one_process_finds(
    alone: ModelSet, tmp_path: Path
) -> None:
    one, memory, dead = few_readings(), Memory(tmp_path), []  # type: ignore[var-annotated]
    with two_workers() as cluster:
        killer = killing(memory, lambda: [w.pid for w in cluster.workers.values()], dead)
        found = search_models(one, **LITTLE, scheduler=cluster.scheduler_address, memory=memory)
        killer.join()
    assert dead
    assert found.log_evidence == alone.log_evidence and found.probability == alone.probability
    assert all(np.array_equal(c.modes, d.modes) for c, d in zip(found.candidates, alone.candidates, strict=True))

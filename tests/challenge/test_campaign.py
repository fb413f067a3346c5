"""Campaigns: interrupted, shared out, damaged."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from campaigns import SMALL, deaf, given, says
from clusters import two_workers
from commands import call
from outside import OUTSIDE

from psafit.challenge import campaign
from psafit.challenge.campaign import LEVELS, PRIOR, content_hash, load, plan, read_diagnosis, run
from psafit.challenge.oracle import Oracle
from psafit.challenge.score import score
from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.physics import TERMS


class Counting:
    """A stand-in that notes its calls, and gives up when asked to."""

    def __init__(self, stop_at: int = -1, error: type[BaseException] = KeyboardInterrupt) -> None:
        self.seeds: list[int] = []
        self.stop_at = stop_at
        self.error = error

    def __call__(self, experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
        self.seeds.append(seed)
        if len(self.seeds) == self.stop_at:
            raise self.error("stop", "go on") if self.error is InputError else self.error
        deaf(experiment, group_ids, folder, quick=quick, seed=seed)


@pytest.fixture
def unasked(monkeypatch: pytest.MonkeyPatch) -> None:
    """The oracle says nothing: for tests of what is run, and of what is kept."""
    monkeypatch.setattr(campaign, "consult", lambda *given, **options: Oracle(0.0, {}, {}, None, 0.0))


def test_the_full_plan_has_all_that_the_targets_ask_for() -> None:
    specs = plan(1, outside=[o.name for o in OUTSIDE])
    assert len(specs) >= 200 and len({s.id for s in specs}) == len({s.seed for s in specs}) == len(specs)
    for t in TERMS:
        for level, nats in LEVELS.items():
            assert any(s.terms == [t.id] and s.level == level and s.nats == nats for s in specs)
    assert sum(s.kind == "nothing" for s in specs) >= 40
    assert {s.outside for s in specs if s.kind == "outside"} == {o.name for o in OUTSIDE}
    assert sum(s.kind == "two" for s in specs) >= 10 and {s.design for s in specs} == {"given", "drawn"}
    drawn = [s for s in specs if s.level == PRIOR]
    likely = {t.id for t in TERMS if t.probability > 0.5}
    assert drawn and max(len(s.terms) for s in drawn) == 2
    assert np.mean([id in likely for s in drawn for id in s.terms]) > 0.7
    assert all(s.nats is None and s.outside is None for s in drawn)
    assert not {s.seed for s in specs} & {s.seed for s in plan(2)}
    assert plan(1) == plan(1)


@pytest.mark.slow
@pytest.mark.usefixtures("unasked")
def test_an_interrupted_campaign_goes_on_and_runs_nothing_twice(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    whole = run(specs, tmp_path / "whole", design_of=known, diagnose=deaf, jobs=1)
    first = Counting(stop_at=3)
    with pytest.raises(KeyboardInterrupt):
        run(specs, tmp_path / "cut", design_of=known, diagnose=first, jobs=1)
    assert len(list((tmp_path / "cut" / "results").iterdir())) == 2
    rest, reported = Counting(), []
    resumed = run(
        specs, tmp_path / "cut", design_of=known, diagnose=rest, jobs=1, progress=lambda *x: reported.append(x[:2])
    )
    assert len(rest.seeds) == 1 and rest.seeds[0] == first.seeds[2] and reported == [(2, 3), (3, 3)]
    assert [content_hash(r) for r in resumed] == [content_hash(r) for r in whole]
    last = Counting()
    run(specs, tmp_path / "cut", design_of=known, diagnose=last, jobs=1)
    assert last.seeds == []


@pytest.mark.slow
@pytest.mark.usefixtures("unasked")
def test_a_failed_diagnosis_counts_and_is_tried_again(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    results = run(specs, tmp_path, design_of=known, diagnose=Counting(stop_at=2, error=InputError), jobs=1)
    assert [r.status for r in results] == ["done", "failed", "done"]
    found = score(results)
    assert found.n_failed == 1 and found.false_alarms.k == 1
    again = Counting()
    assert [r.status for r in run(specs, tmp_path, design_of=known, diagnose=again, jobs=1)] == ["done"] * 3
    assert len(again.seeds) == 1


def test_a_bug_in_the_diagnosis_is_not_swallowed(known: Experiment, tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        run(
            given(plan(4, **SMALL)),
            tmp_path,
            design_of=known,
            diagnose=Counting(stop_at=1, error=ZeroDivisionError),
            jobs=1,
        )


@pytest.mark.slow
def test_two_workers_give_what_one_gives(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, terms=["gap"], each=0, nothing=2, pairs=0, drawn=0, outside=["unit_error"], outside_each=1))
    one, two = (run(specs, tmp_path / str(n), design_of=known, diagnose=deaf, outside=OUTSIDE, jobs=n) for n in (1, 2))
    assert [content_hash(r) for r in one] == [content_hash(r) for r in two]
    assert {content_hash(r) for r in one} != {content_hash(one[0])}


@pytest.mark.slow
@pytest.mark.usefixtures("unasked")
def test_a_short_campaign_is_part_of_the_whole(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, **SMALL))
    first, rest = Counting(), Counting()
    assert len(run(specs, tmp_path, design_of=known, diagnose=first, jobs=1, limit=1)) == 1
    more = [replace(specs[0], id="one", kind="one"), *specs]
    found = run(more, tmp_path / "kind", design_of=known, diagnose=deaf, jobs=1, kinds=["nothing"])
    assert [result.spec for result in found] == specs
    assert len(run(specs, tmp_path, design_of=known, diagnose=rest, jobs=1)) == 3
    assert (len(first.seeds), len(rest.seeds)) == (1, 2)


def test_a_cluster_without_dask_is_refused_before_anything_is_written(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"psafit\[cluster\]"):
        run(plan(4, **SMALL), tmp_path / "x", design_of=known, diagnose=deaf, scheduler="tcp://localhost:1")
    assert not (tmp_path / "x").exists()


def test_a_scheduler_that_does_not_answer_leaves_no_client_behind(known: Experiment, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler answers at foo://bar"):
        run(plan(4, **SMALL), tmp_path / "x", design_of=known, diagnose=deaf, scheduler="foo://bar")
    with pytest.raises(ValueError, match="No client"):
        distributed.default_client()


def test_another_campaign_or_a_damaged_result_is_refused(known: Experiment, tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    specs = given(plan(4, **{**SMALL, "nothing": 1}))
    run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)
    with pytest.raises(InputError, match="another campaign"):
        run(given(plan(5, **{**SMALL, "nothing": 1})), tmp_path, design_of=known, diagnose=deaf, jobs=1)
    with monkeypatch.context() as m:
        m.setattr("psafit.challenge.campaign.plugin_versions", lambda: {"plugin mine": "another file"})
        with pytest.raises(InputError, match="its plugins differ"):
            run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)
    (file,) = (tmp_path / "results").iterdir()
    file.write_text(file.read_text()[:-20])
    with pytest.raises(InputError, match="damaged"):
        run(specs, tmp_path, design_of=known, diagnose=deaf, jobs=1)


def test_a_diagnosis_that_breaks_its_contract_is_a_failure(known: Experiment, tmp_path: Path) -> None:
    def broken(experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
        says(folder, verdict="perhaps")

    (result,) = run(given(plan(4, **{**SMALL, "nothing": 1})), tmp_path, design_of=known, diagnose=broken, jobs=1)
    assert result.status == "failed" and "no diagnosis" in result.message


@pytest.mark.slow
def test_a_cluster_that_loses_a_worker_gives_what_one_process_gives(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, terms=["gap"], each=0, nothing=4, pairs=0, drawn=0))
    serial = run(specs, tmp_path / "serial", design_of=known, diagnose=deaf, jobs=1)
    with two_workers() as cluster:
        killed: list[int] = []

        def kill(done: int, total: int, note: str) -> None:
            if done == 2 and not killed:
                victim = next(iter(cluster.workers.values()))
                killed.append(victim.pid)
                victim.process.process._process.kill()

        found = run(
            specs,
            tmp_path / "cluster",
            design_of=known,
            diagnose=deaf,
            scheduler=cluster.scheduler_address,
            progress=kill,
        )
    assert killed
    assert [content_hash(r) for r in found] == [content_hash(r) for r in serial]


@pytest.mark.slow
def test_workers_leave_with_a_campaign_that_is_killed(known_folder: Path, tmp_path: Path) -> None:
    program = f"""
import os, pathlib, time
from psafit.challenge.campaign import plan, run
from psafit.experiment import read_experiment

def sleep(*args, **options):
    pathlib.Path({str(tmp_path)!r}, f"{{os.getpid()}}.pid").touch()
    time.sleep(600)

if __name__ == "__main__":
    specs = plan(4, terms=["gap"], each=0, nothing=4, pairs=0, drawn=0)
    known = read_experiment({str(known_folder)!r})
    run(specs, pathlib.Path({str(tmp_path / "out")!r}), design_of=known, diagnose=sleep)
"""
    (tmp_path / "campaign.py").write_text(program)

    def until(done: Callable[[], bool], seconds: float) -> bool:
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            time.sleep(0.2)
        return done()

    def works(pid: str) -> bool:
        """Whether a process is there, and not dead and merely not yet buried."""
        try:
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
        except FileNotFoundError:
            return False

    def alive() -> list[str]:
        return [p.stem for p in tmp_path.glob("*.pid") if works(p.stem)]

    campaign = subprocess.Popen([sys.executable, tmp_path / "campaign.py"], cwd=Path(__file__).parents[2])
    try:
        assert until(lambda: len(alive()) == 2, 120)
    finally:
        campaign.kill()
        campaign.wait()
    assert until(lambda: not alive(), 60)


@pytest.mark.parametrize(
    "change",
    [
        {"named": [["a"]]},
        {"alternatives": [[{"a": 1}]]},
        {"causes": [{"terms": [1], "probability": 1.0}]},
        {
            "causes": [
                {"terms": ["a"], "probability": 1.0, "parameters": {"x": {"median": "1", "lower": 0, "upper": 2}}}
            ]
        },
        {"causes": [{"terms": ["a"], "probability": 1.0, "parameters": ["x"]}]},
        {"causes": [{"terms": ["a"], "probability": 10**400}]},
        {"named": ["\x1b[31mred"]},
        {"misfit": {"where": ["x"]}},
        {"misfit": {"where": 5}},
        {"misfit": {"where": [{"group": 1, "variable": "frequency", "from": "a", "to": 2.0}]}},
    ],
)
def test_a_foreign_diagnosis_must_keep_the_contract(change: dict[str, Any], tmp_path: Path) -> None:
    content = {"verdict": "explained", "named": ["a"], "alternatives": [], "causes": [], "misfit": {}}
    (tmp_path / "d.json").write_text(json.dumps(content))
    assert read_diagnosis(tmp_path / "d.json")["named"] == ["a"]
    (tmp_path / "d.json").write_text(json.dumps(content | change))
    with pytest.raises(InputError, match="is no diagnosis of schema 1"):
        read_diagnosis(tmp_path / "d.json")


@pytest.fixture(scope="module")
def ended(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign of one data set."""
    folder = tmp_path_factory.mktemp("campaign")
    run(plan(1, **SMALL | {"nothing": 1}), folder, design_of=known, diagnose=deaf, jobs=1)
    return folder


@pytest.mark.parametrize(
    "edit",
    [
        lambda r: r["diagnosis"].update(named=5),
        lambda r: r["diagnosis"].update(verdict="explained"),
        lambda r: r["oracle"].update(gain=1e3),
        lambda r: r.update(seconds={}),
    ],
)
def test_an_edited_result_is_one_line(ended: Path, tmp_path: Path, edit: Callable[[dict[str, Any]], None]) -> None:
    shutil.copytree(ended, tmp_path, dirs_exist_ok=True)
    (file,) = (tmp_path / "results").iterdir()
    content = json.loads(file.read_text())
    edit(content)
    file.write_text(json.dumps(content))
    with pytest.raises(InputError, match="was changed") as reported:
        load(tmp_path)
    assert reported.value.file == file


@pytest.mark.slow
def test_a_campaign_is_scored_from_its_folder(known: Experiment, tmp_path: Path) -> None:
    specs = given(plan(4, terms=["gap"], each=0, nothing=1, pairs=0, drawn=0, outside=["unit_error"], outside_each=1))
    run(specs, tmp_path, design_of=known, diagnose=deaf, outside=OUTSIDE, jobs=1)
    assert len(load(tmp_path)[1]) == 2
    code, text = call("score", tmp_path)
    assert code == 1 and "misses" in text  # a deaf diagnosis misses the wrong unit
    content = json.loads((tmp_path / "score.json").read_text())
    assert content["n"] == 2 and content["false_alarms"]["k"] == 0 and (tmp_path / "score.html").exists()

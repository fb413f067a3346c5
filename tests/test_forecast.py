"""Time left of long work, and the file that says it."""

from __future__ import annotations

from pathlib import Path

import pytest

from psafit import forecast
from psafit.errors import InputError
from psafit.forecast import Forecast, Reporter, Silent, progress_of, reporting

PLAN = {"search": 1.0, "sample": 4.0, "profile": 2.0}


class Heard(Silent):
    """What a watcher was given."""

    def __init__(self) -> None:
        self.left: list[float | None] = []
        self.stages: list[str] = []

    def stage(self, name: str) -> None:
        self.stages.append(name)

    def whole(self, seconds: float | None, *, at_least: bool = False) -> None:
        self.left.append(seconds)


def test_nothing_is_said_before_anything_was_measured() -> None:
    plan = Forecast(PLAN)
    assert plan.left(0.0) is None
    plan.begin("search", 0.0)
    assert plan.left(5.0) is None
    plan.begin("something else", 5.0)
    assert plan.left(6.0) is None


def test_what_was_done_says_how_long_the_rest_takes() -> None:
    plan = Forecast(PLAN)
    plan.begin("search", 0.0)
    plan.begin("sample", 10.0)
    assert plan.left(10.0) == pytest.approx(60.0)
    assert plan.left(30.0) == pytest.approx(40.0)
    plan.reach(0.0, 10.0)
    plan.reach(0.5, 50.0)  # twice as slow as its share promised: 40 s more, and 50 s for a work of 3 before
    assert plan.left(50.0) == pytest.approx(40.0 + 2 * 50 / 3)
    plan.begin("profile", 90.0)
    assert plan.left(90.0) == pytest.approx(2 * 90 / 5)
    plan.reach(0.0, 90.0)
    plan.reach(1.0, 130.0)
    assert plan.left(130.0) == pytest.approx(0.0)
    assert plan.seconds(130.0) == {"search": 10.0, "sample": 80.0, "profile": 40.0}


def test_what_a_session_finds_done_is_not_its_pace() -> None:
    """A chain that is drawn on begins at nine tenths; one whose earlier time is on record counts that."""
    plan = Forecast(PLAN)
    plan.begin("sample", 0.0)
    plan.reach(0.9, 1.0)
    assert plan.left(1.0) is None
    plan.reach(0.95, 11.0)
    assert plan.left(11.0) == pytest.approx(10.0 + 2 * 10 / (4 * 0.05))
    plan = Forecast(PLAN, {"search": 10.0, "sample": 30.0})
    plan.begin("sample", 0.0)
    plan.reach(0.75, 2.0)
    assert plan.left(2.0) == pytest.approx(32 / 3 + 2 * (10 + 32) / (1 + 3))


def test_a_total_that_grows_takes_longer() -> None:
    """A chain learns how long its autocorrelation time is: what was nearly done is not, any more."""
    plan = Forecast(PLAN)
    plan.begin("sample", 0.0)
    plan.reach(0, 0.0, 700)
    plan.reach(600, 60.0, 700)
    assert plan.left(60.0) == pytest.approx(10.0 + 2 * 60 / (4 * 6 / 7)) and plan.is_open
    plan.reach(900, 90.0, 2900)
    assert plan.left(90.0) == pytest.approx(200.0 + 2 * 90 / (4 * 9 / 29))
    plan.begin("profile", 300.0)
    assert not plan.is_open


def test_a_part_of_several_counts_goes_on() -> None:
    """A chain of ten thousand steps, then 48 profiles: an extension is one part of a diagnosis."""
    plan = Forecast({"adopted extension": 4.0, "rest": 1.0})
    plan.begin("adopted extension", 0.0)
    assert plan.is_open
    for done, total, now in ((0, 10_000, 0.0), (10_000, 10_000, 100.0), (0, 48, 101.0), (24, 48, 110.0)):
        plan.reach(done, now, total)
    assert plan.left(110.0) == pytest.approx(110.0 / 4)
    plan.begin("rest", 120.0)
    assert plan.left(120.0) == pytest.approx(120.0 / 4) and not plan.is_open


def test_counts_that_begin_again_take_nothing_back() -> None:
    plan = Forecast(PLAN)
    plan.begin("profile", 0.0)
    for fraction, now in ((0.0, 0.0), (1.0, 10.0), (0.0, 10.0)):
        plan.reach(fraction, now)
    assert plan.left(10.0) == 0.0


def test_progress_is_kept_and_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(float(t) for t in range(1000))
    monkeypatch.setattr(forecast.time, "monotonic", lambda: next(clock))
    with pytest.raises(KeyboardInterrupt), reporting(Silent(), tmp_path, "fit", "a", PLAN, ("sample",)) as watcher:
        watcher.stage("search")
        watcher.stage("sample")
        watcher.update(3, 12, "steps")
        watcher.update(6, 12, "steps")
        raise KeyboardInterrupt
    stopped = progress_of(tmp_path)
    assert stopped is not None and (stopped.stage, stopped.kind) == ("sample", "fit") and stopped.left is not None
    assert stopped.seconds.keys() == {"search", "sample"} and (stopped.done, stopped.total) == (6, 12)
    heard = Heard()
    with reporting(heard, tmp_path, "fit", "a", PLAN, ("sample",)) as watcher:
        assert isinstance(watcher, Reporter)
        with reporting(watcher, tmp_path, "fit", "b", PLAN) as same:  # a part of larger work
            assert same is watcher
        watcher.stage("sample")
        assert heard.left[-1] is not None and heard.stages == ["sample"]
    assert progress_of(tmp_path) is None and not list(tmp_path.iterdir())


def test_another_work_begins_anew(tmp_path: Path) -> None:
    Reporter(Silent(), tmp_path, "fit", "a", PLAN).stage("search")
    heard = Heard()
    for kind, identity in (("fit", "b"), ("diagnosis", "a")):
        Reporter(heard, tmp_path, kind, identity, PLAN).stage("sample")
    assert heard.left == [None, None]


def test_a_full_disk_does_not_end_the_work_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*a: object) -> None:
        raise InputError("cannot be written (No space left on device)", "make room")

    monkeypatch.setattr(forecast, "write_json", full)
    Reporter(Silent(), tmp_path, "fit", "a", PLAN).stage("search")
    assert not list(tmp_path.iterdir())
    (tmp_path / "progress.json").write_text("{")
    assert progress_of(tmp_path) is None

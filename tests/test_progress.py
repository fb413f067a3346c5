"""Progress, as a log shows it."""

from __future__ import annotations

import threading

from psafit import progress


def test_progress_in_a_log_says_what_is_awaited(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    now = 0.0
    monkeypatch.setattr(progress.time, "monotonic", lambda: now)
    with progress.watcher(quiet=False, every=3600.0) as lines:
        lines.say()  # nothing has begun
        now = 11.0
        lines.update(500, None, "step 500 of at most 40000, R-hat 1.030 (goal 1.01)")
        lines.say()
        now = 30.0
        lines.stage("profile")
        now = 31.0
        lines.say()
        lines.update(3, 48, "profiles")
        now = 42.0
        lines.update(8, 48, "profiles")
        lines.say()
        now = 600.0
        lines.update(0, 4, "of a second count")
        lines.say()
        now = 620.0
        lines.update(1, 4, "of a second count")
        lines.say()
        now = 640.0
        lines.update(4, 4, "of a second count")
        lines.say()
        lines.whole(0.3)
        now = 660.0
        lines.say()
        lines.whole(44.0)
        now = 680.0
        lines.stage("report")
        lines.say()
        now = 710.0
        lines.say()
        lines.whole(130.0, at_least=True)
        lines.say()
    assert capsys.readouterr().err.splitlines() == [
        "[ 11.0 s]   step 500 of at most 40000, R-hat 1.030 (goal 1.01)", "[ 30.0 s] profile the likelihood",
        "[ 31.0 s]   profile the likelihood", "[ 42.0 s]   8 of 48 profiles; about 88 s left of this",
        "[600.0 s]   0 of 4 of a second count", "[620.0 s]   1 of 4 of a second count; about 60 s left of this",
        "[640.0 s]   4 of 4 of a second count", "[660.0 s]   4 of 4 of a second count",
        "[680.0 s] write the report", "[680.0 s]   write the report; about 24 s left in all",
        "[710.0 s]   write the report", "[710.0 s]   write the report; at least 2 min left in all",
    ]  # fmt: skip


def test_a_log_shows_signs_of_life_while_nothing_is_reported(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    said = threading.Event()
    monkeypatch.setattr(progress._Lines, "say", lambda self: said.set())
    with progress.watcher(quiet=False, every=0.01):
        assert said.wait(30)
    assert not [t for t in threading.enumerate() if t.name == "heartbeat"]

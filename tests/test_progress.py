"""Progress, as a log shows it."""

from __future__ import annotations

from psafit import progress


def test_progress_in_a_log_says_what_is_awaited(monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    clock = iter([0.0, 11.0, 12.0, 30.0, 31.0, 42.0, 600.0, 620.0, 640.0, 660.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    with progress.watcher(quiet=False) as lines:
        lines.update(500, None, "step 500 of at most 40000, R-hat 1.030 (goal 1.01)")
        lines.update(750, None, "too soon")
        lines.stage("profile")
        lines.update(3, 48, "profiles")
        lines.update(8, 48, "profiles")
        lines.update(0, 4, "of a second count")
        lines.update(1, 4, "of a second count")
        lines.update(4, 4, "of a second count")
        lines.whole(0.3)
        lines.update(4, 4, "of a second count")
    assert capsys.readouterr().err.splitlines() == [
        "[ 11.0 s]   step 500 of at most 40000, R-hat 1.030 (goal 1.01)", "[ 30.0 s] profile the likelihood",
        "[ 42.0 s]   8 of 48 profiles; about 88 s left of this", "[600.0 s]   0 of 4 of a second count",
        "[620.0 s]   1 of 4 of a second count; about 60 s left of this",
        "[640.0 s]   4 of 4 of a second count", "[660.0 s]   4 of 4 of a second count",
    ]  # fmt: skip

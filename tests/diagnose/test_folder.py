"""The folder of a diagnosis: what becomes of an answer when another question is asked there."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from truths import experiment

from psafit.diagnose.folder import claim, set_aside
from psafit.diagnose.record import is_diagnosis
from psafit.errors import InputError


def test_an_answer_gives_way_to_another_and_is_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """With its page and its own tables; those of a fit in the same folder stay where they are."""
    own = {"diagnosis.json": '{"files": {"predictions-diagnosis.csv": "..."}}', "predictions-diagnosis.csv": "1"}
    for name, text in {**own, "diagnosis.html": "page", "predictions-launch_speed.csv": "of a fit"}.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "experiment").mkdir()
    with caplog.at_level(logging.INFO, "psafit"):
        set_aside(tmp_path)
    kept = tmp_path / "previous"
    assert {p.name for p in kept.iterdir()} == {*own, "diagnosis.html", "experiment"}
    assert {p.name for p in tmp_path.iterdir()} == {"previous", "experiment", "predictions-launch_speed.csv"}
    assert caplog.messages == [f"the answer that was here before is kept in {kept}"]
    # What was interrupted before it had an answer of its own leaves the kept one alone.
    (tmp_path / "diagnosis.html").write_text("of nothing")
    set_aside(tmp_path)
    assert not (tmp_path / "diagnosis.html").exists() and (kept / "diagnosis.html").read_text() == "page"
    for name, text in own.items():
        (tmp_path / name).write_text(text.replace("1", "2"))
    set_aside(tmp_path)
    assert (kept / "predictions-diagnosis.csv").read_text() == "2" and not (kept / "diagnosis.html").exists()


def test_a_diagnosis_that_has_not_ended_says_where_the_answer_before_is(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="neither a finished fit nor"):
        is_diagnosis(tmp_path)
    claim(tmp_path, experiment())
    with pytest.raises(InputError, match=r"has not ended; wait for it, or repeat its command, which goes on$"):
        is_diagnosis(tmp_path)
    (tmp_path / "diagnosis.json").write_text('{"files": {}}')
    assert is_diagnosis(tmp_path)
    set_aside(tmp_path)
    with pytest.raises(InputError, match=r"which goes on; the answer before is in previous/$"):
        is_diagnosis(tmp_path)


def test_what_somebody_calls_previous_is_not_replaced(tmp_path: Path) -> None:
    claim(tmp_path, experiment())
    (tmp_path / "previous").mkdir()
    with pytest.raises(InputError, match="previous: is none that a diagnosis made"):
        claim(tmp_path, experiment())


@pytest.mark.parametrize("files", ["null", '{"../beyond.csv": ""}', '["predictions-diagnosis.csv"]'])
def test_a_record_that_was_edited_moves_nothing_of_others(tmp_path: Path, files: str) -> None:
    place, beyond = tmp_path / "answer", tmp_path / "beyond.csv"
    place.mkdir()
    beyond.write_text("somebody's")
    (place / "diagnosis.json").write_text(f'{{"files": {files}}}')
    set_aside(place)
    assert beyond.exists() and [p.name for p in place.iterdir()] == ["previous"]

"""Names of folders and commands."""

from __future__ import annotations

import errno
import io
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from psafit.challenge.answer import unseal
from psafit.compare import read_predictions
from psafit.diagnose.folder import held_in
from psafit.files import Refused, portable_command, read_error, sha256, usual_fit_folder
from psafit.records import read_content
from psafit.reproduce.claims import read_published


def test_no_two_choices_of_groups_share_a_folder() -> None:
    choices = ([1, 2], ["1-2"], ["1-", 2], ["1--2"], ["a-b", "c"], ["a", "b-c"], ["a", "b", "c"], ["a-b-c"])
    names = [usual_fit_folder(Path("rig"), ids, []).name for ids in choices]
    assert len(set(names)) == len(choices) and names[0] == "rig-group1-2" and names[1] == "rig-group1--2"


def test_paths_are_cut():
    assert portable_command(["psafit", "fit", "/a/b/psa", "--out=/x/y"]) == "psafit fit psa --out=y"
    assert portable_command(["psafit", "fit", r"C:\Users\me\psa"]) == "psafit fit psa"
    assert portable_command(["fit", "~/psa", Path("experiments/psa"), "a b"]) == "fit psa experiments/psa 'a b'"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (PermissionError(errno.EACCES, "no"), "Permission denied); check its permissions"),
        (BlockingIOError(errno.EAGAIN, "a library's\nparagraph"), "wait until the process that holds it open"),
        (IsADirectoryError(errno.EISDIR, "no"), "Is a directory); move the folder"),
        (OSError(errno.EIO, "no"), "Input/output error); check the disk"),
        (OSError(errno.ESTALE, "no"), "check the disk"),
    ],
)
def test_what_the_system_refuses_is_not_called_damaged(error: OSError, said: str) -> None:
    found = read_error(error, Path("chain.h5"), "is damaged", "remove it")
    assert isinstance(found, Refused) and said in str(found)
    assert "damaged" not in str(found) and "remove" not in str(found) and "\n" not in str(found)


def test_content_that_a_library_cannot_read_is_damaged() -> None:
    for error in (OSError("file signature not found"), ValueError("no"), FileNotFoundError(errno.ENOENT, "no")):
        found = read_error(error, Path("chain.h5"), "is damaged", "move it elsewhere")
        assert not isinstance(found, Refused) and "is damaged; move it elsewhere" in str(found)


def test_every_reader_of_records_reports_what_the_system_refuses(tmp_path: Path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    """Also those that would work everything out anew where there is nothing to read."""
    for name in ("fit.json", "diagnosis.json", "answer.json", "commitment.txt", "predictions.csv", "published.toml"):
        (tmp_path / name).write_text("{}")

    def refused(*a: object, **k: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(io, "open", refused)  # what pathlib opens with
    monkeypatch.setattr("builtins.open", refused)
    monkeypatch.setattr(Path, "read_bytes", refused)
    monkeypatch.setattr(Path, "read_text", refused)
    monkeypatch.setattr(pd, "read_csv", refused)
    readers: list[Callable[[], object]] = [
        lambda: read_content(tmp_path / "fit.json"),
        lambda: sha256(tmp_path / "fit.json"),
        lambda: read_predictions(tmp_path / "predictions.csv"),
        lambda: unseal(tmp_path),
        lambda: read_published(tmp_path),
        lambda: held_in(tmp_path, ""),
    ]
    for read in readers:
        with pytest.raises(Refused, match=r"cannot be read \(Permission denied\); check its permissions"):
            read()

"""The seal."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from psafit.challenge import hide
from psafit.challenge.answer import unseal
from psafit.challenge.hide import make
from psafit.errors import InputError
from psafit.experiment import Experiment


@pytest.fixture(scope="module")
def sealed(known: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sealed")
    make(5, folder, design_of=known, kind="nothing")
    return folder


def test_the_answer_is_committed_to_before_the_data(
    known: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    write = hide.write_experiment

    def spy(experiment: Experiment, folder: Path) -> None:
        seen.append((tmp_path / "commitment.txt").read_text())
        write(experiment, folder)

    monkeypatch.setattr(hide, "write_experiment", spy)
    made = make(5, tmp_path, design_of=known, kind="nothing")
    digest = hashlib.sha256((tmp_path / "answer.json").read_bytes()).hexdigest()
    assert seen == [f"{digest}  answer.json\n"] and made.commitment == digest
    assert unseal(tmp_path)[1] == made.answer
    with pytest.raises(InputError, match="there already"):
        make(5, tmp_path, design_of=known, kind="nothing")


@pytest.mark.parametrize("victim", ["answer.json", "commitment.txt", "experiment/group2.csv"])
def test_tampering_is_refused(sealed: Path, tmp_path: Path, victim: str) -> None:
    shutil.copytree(sealed, tmp_path, dirs_exist_ok=True)
    file = tmp_path / victim
    text = file.read_text()
    changed = {
        "answer.json": text.replace('"kind": "nothing"', '"kind": "one"'),
        "commitment.txt": "0" * 64 + "  answer.json\n",
        "experiment/group2.csv": re.sub(r",(\d+\.\d+)\n", r",9\1\n", text, count=1),
    }[victim]
    assert changed != text
    file.write_text(changed)
    with pytest.raises(InputError, match=r"committed|other data"):
        unseal(tmp_path)


@pytest.mark.parametrize("victim", ["answer.json", "commitment.txt"])
def test_a_seal_that_is_not_there_is_reported(sealed: Path, tmp_path: Path, victim: str) -> None:
    shutil.copytree(sealed, tmp_path, dirs_exist_ok=True)
    (tmp_path / victim).unlink()
    with pytest.raises(InputError, match="is missing"):
        unseal(tmp_path)
    (tmp_path / victim).mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        unseal(tmp_path)


@pytest.mark.parametrize(
    ("forge", "what"),
    [
        (lambda a: a["parameters"].pop("k_c"), "does not say k_c"),
        (lambda a: a["scatter"].pop("nu"), "does not say nu"),
        (lambda a: a["true_readings"].pop(), "not one true value for every reading"),
        (lambda a: a["terms"].append("no such cause"), "no such cause"),
        (lambda a: a["parameters"].update(k_c=-1e7), "has k_c = -1e[+]07, outside the bounds"),
        (lambda a: a["scatter"].update(sigma_abs=float("nan")), "has sigma_abs = nan, outside the bounds"),
    ],
)
def test_a_forged_answer_with_its_own_hash_is_refused(sealed: Path, tmp_path: Path, forge: Any, what: str) -> None:
    shutil.copytree(sealed, tmp_path, dirs_exist_ok=True)
    file = tmp_path / "answer.json"
    content = json.loads(file.read_text())
    forge(content)
    file.write_text(json.dumps(content))
    (tmp_path / "commitment.txt").write_text(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  answer.json\n")
    with pytest.raises(InputError, match=what):
        unseal(tmp_path)

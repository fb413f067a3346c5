"""Challenges by command."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from campaigns import says
from commands import call, run
from truths import CHEAP

from psafit.challenge import campaign, oracle
from psafit.diagnose import diagnose
from psafit.diagnose.settings import Settings
from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.physics import terms


@pytest.mark.slow
def test_make_and_score_from_the_command_line(known_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "c"
    printed = tmp_path / "made.json"
    words = ["--seed", 3, "--out", out, "--experiment", known_folder, "--terms", "amplifier_lag", "--strength", 30]
    code, text = call("make", *words, "--jobs", 1, "--json", printed)
    assert code == 0 and "amplifier_lag" not in text + printed.read_text()
    assert json.loads(printed.read_text())["commitment"] == (out / "commitment.txt").read_text().split()[0]
    says(tmp_path, verdict="explained", named=["amplifier_lag"], fingerprint="another")
    with pytest.raises(InputError, match="of other readings"):
        call("score", out, "--diagnosis", tmp_path / "diagnosis.json")
    says(tmp_path, verdict="explained", named=["amplifier_lag"])
    code, text = call("score", out, "--diagnosis", tmp_path / "diagnosis.json", "--json", tmp_path / "score.json")
    assert code == 0 and "truth in the reported set" in text
    assert json.loads((tmp_path / "score.json").read_text())["rows"][0]["exact"] is True


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("score {tmp}/none", "campaign.json"),
        ("make --seed 1 --out {tmp}/x --experiment {tmp}/none", "no such experiment"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --terms a,", "not a list"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --drawn-design", "both given"),
        ("make --seed 1 --out {tmp}/x --experiment {known} --kind nothing --strength 30", "of no cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --terms gape", "no cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --terms gap --pairs 3", "pair of one cause"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --jobs 3 --scheduler tcp://127.0.0.1:1", "both given"),
        ("run --seed 1 --out {tmp}/x --experiment {known} --each 0 --nothing 0 --pairs 0 --drawn 0", "empty"),
    ],
)
def test_bad_input_is_one_clear_line(tmp_path: Path, known_folder: Path, words: str, what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        call(*(w.format(tmp=tmp_path, known=known_folder) for w in words.split()))
    assert "\n" not in str(caught.value) and not (tmp_path / "x" / "experiment").exists()


@pytest.mark.slow
def test_a_campaign_by_command(known_folder: Path, tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    """Run, taken up again without a second diagnosis, scored, shown."""
    diagnosed: list[int] = []
    few, little = terms(["start_phase", "reading_gain"]), replace(Settings.usual(quick=True), search=CHEAP)

    def among_few(experiment: Experiment, ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
        diagnosed.append(seed)
        diagnose(experiment, ids, folder, quick=quick, seed=seed, catalogue=few, settings=little)

    monkeypatch.setattr(campaign, "LEVELS", {"strong": 100.0})
    monkeypatch.setattr(campaign, "run", partial(campaign.run, diagnose=among_few))
    monkeypatch.setattr(oracle, "find_rivals", partial(oracle.find_rivals, among=few))
    out = tmp_path / "c"
    words = ["challenge", "run", "--seed", 5, "--experiment", known_folder, "--terms", "start_phase", "--each", 1]
    words += ["--nothing", 1, "--pairs", 0, "--drawn", 0, "--designs", 0, "--jobs", 1, "--out", out]
    assert run(monkeypatch, *words, "--json", tmp_path / "run.json") == 0
    printed = capsys.readouterr()
    n = json.loads((tmp_path / "run.json").read_text())["n"]
    assert n == 2 and f"{n} of {n} data sets" in printed.err and "results: " in printed.out
    kept = {file: file.read_bytes() for file in (out / "results").iterdir()}
    assert len(kept) == len(set(diagnosed)) == n
    assert run(monkeypatch, *words) == 0
    assert len(diagnosed) == n and {file: file.read_bytes() for file in (out / "results").iterdir()} == kept
    capsys.readouterr()
    assert run(monkeypatch, "challenge", "score", out, "--json", tmp_path / "score.json") in (0, 1)
    assert "page: " in capsys.readouterr().out
    assert run(monkeypatch, "challenge", "score", out, "--against", out) in (0, 1)
    assert "above that campaign's: 0.00 nats, 0.00 to 0.00 (2 data sets)" in capsys.readouterr().out
    score = json.loads((tmp_path / "score.json").read_text())
    assert len(score["rows"]) == n and {row["truth"] for row in score["rows"]} == {"nothing", "start_phase"}
    assert (out / "score.html").stat().st_size > 10_000

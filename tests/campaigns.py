"""Stand-ins for a diagnosis, and results of a campaign, made by hand."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from psafit.challenge.answer import Answer, Place
from psafit.challenge.campaign import Result, Spec
from psafit.challenge.oracle import Oracle
from psafit.experiment import Experiment

SMALL = {"terms": ["amplifier_lag"], "each": 0, "nothing": 3, "pairs": 0, "drawn": 0}


def says(folder: Path, **content: Any) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    reported = {
        "schema": 1,
        "verdict": "adequate",
        "named": [],
        "alternatives": [],
        "causes": [],
        "misfit": {},
    } | content
    (folder / "diagnosis.json").write_text(json.dumps(reported))


def deaf(experiment: Experiment, group_ids: Any, folder: Path, *, quick: bool, seed: int) -> None:
    """A stand-in that finds every simulation adequate."""
    assert quick and tuple(group_ids) == experiment.ids
    assert experiment.title == "Challenge"
    says(folder, misfit={"p_value": float(experiment.groups[0].reading[0])})


def given(specs: list[Spec]) -> list[Spec]:
    """The same on the small design."""
    return [replace(s, design="given") for s in specs]


def result(
    truth: list[str],
    *,
    verdict: str = "explained",
    named: list[str] | None = None,
    alternatives: list[list[str]] | None = None,
    causes: list[dict[str, Any]] | None = None,
    where: list[dict[str, Any]] | None = None,
    gain: float = 40.0,
    outside: str | None = None,
    places: list[Place] | None = None,
    confusable: list[str] | None = None,
    without: dict[str, float] | None = None,
    seconds: float = 1.0,
) -> Result:
    kind = "outside" if outside else ("nothing", "one", "two")[len(truth)]
    spec = Spec("0", 1, kind, truth, outside, "", None, "given")  # type: ignore[arg-type]
    answer = Answer(
        "0", 1, kind, truth, {"tau": 2.0, "k_c": 10.0}, {}, None, {}, True, {}, outside, "", places or [], "given", 0,
        [], "",
    )  # type: ignore[arg-type]  # fmt: skip
    reported = {
        "verdict": verdict,
        "named": named or [],
        "alternatives": alternatives or [],
        "causes": causes or [],
        "misfit": {"where": where or []},
    }
    oracle = Oracle(gain, without or {}, {}, confusable, 0.0)
    return Result(spec, "0", "done", "", answer, oracle, reported, {"diagnose": seconds})

"""What a look at the rig itself would show of the reported causes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from diagnoses_by_hand import make_experiment, make_record

from psafit.diagnose.answer import answer, sentences
from psafit.diagnose.answer.worth import LookAt
from psafit.diagnose.looks import looks
from psafit.diagnose.record.models import Look, ParameterResult
from psafit.diagnose.words import PLAIN
from psafit.physics import terms

CATALOGUE = terms(("gap", "idle_level", "no_tension", "preload"))


def value(median: float) -> ParameterResult:
    return ParameterResult(median, 0.5 * median, 2 * median, "V", "what it means", 0.5)


def model(*ids: str) -> Any:
    found = {p.name: value(k + 1.0) for k, t in enumerate(CATALOGUE) if t.id in ids for p in t.parameters}
    return SimpleNamespace(terms=list(ids), parameters=found)


def verdict(word: str, *sets: tuple[str, ...], **inclusion: float) -> Any:
    return SimpleNamespace(verdict=word, named=sets[0], alternatives=sets[1:], inclusion=inclusion)


def test_what_separates_sets_comes_first_and_the_least_certain_of_that() -> None:
    """Not what no look shows, and not what is fitted but not reported."""
    models = [model("preload", "gap"), model("preload", "idle_level"), model("no_tension"), model("preload")]
    said = verdict(
        "ambiguous",
        ("preload", "gap"),
        ("preload", "idle_level"),
        ("no_tension",),
        gap=0.9,
        idle_level=0.4,
        preload=0.5,
    )
    found = looks(models, said, CATALOGUE)
    assert [(one.cause, one.separates) for one in found] == [("preload", True), ("idle_level", True), ("gap", True)]
    both = verdict("ambiguous", ("preload", "gap"), ("preload", "idle_level"), gap=0.9, idle_level=0.4, preload=0.5)
    found = looks(models, both, CATALOGUE)
    assert [(one.cause, one.separates) for one in found] == [("idle_level", True), ("gap", True), ("preload", False)]
    assert [list(one.parameters) for one in found] == [["idle_u0"], ["gap_width"], ["preload_offset"]]
    assert looks(models, verdict("adequate", (), gap=0.4), CATALOGUE) == []


def test_the_first_look_is_said_with_what_it_shows() -> None:
    d = make_record(make_experiment())
    seen = [Look("gap", "what is there", 0.4, True, {}), Look("preload", "the string", 0.4, True, {})]
    (statement,) = (s for s in answer(replace(d, looks=seen)) if isinstance(s, LookAt))
    assert statement.found is seen[0]
    said = "Without launches, check what is there: that shows whether gap is at work."
    known = LookAt(replace(seen[0], parameters={"gap_width": ParameterResult(2e-6, 1e-6, 3e-6, "m", "gap", 0.5)}))
    assert known.say(PLAIN) == said.replace(".", ", by these readings with gap_width = 2 (1 to 3) um.")
    assert said in sentences(replace(d, looks=seen))
    assert not any(isinstance(s, LookAt) for s in answer(replace(d, looks=[])))

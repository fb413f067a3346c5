"""The first screen of a diagnosis' page: its answer in the page's words, and the key numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from markupsafe import Markup, escape

from psafit.diagnose.answer import answer, kept
from psafit.diagnose.answer.findings import Judged
from psafit.diagnose.answer.statement import Statement, Topic
from psafit.diagnose.record import Diagnosis
from psafit.parameters import Belief
from psafit.records import Objection
from psafit.report.diagnosis import words
from psafit.report.diagnosis.shown import Shown
from psafit.report.page_words import PAGE
from psafit.report.wording import (
    factor,
    p_value,
)
from psafit.text import count

_KINDS: Final = {"adequate": "good", "explained": "good", "ambiguous": "warn", "unexplained": "bad"}
# Behind a p value that is not of all tests: what speaks against the model.
_AGAINST: Final[dict[Objection, str]] = {
    "": "",
    "tests": "",
    "together": ", where those of several groups stand out together",
    "tails": ", without heavier tails than usual",
}
_QUESTIONS: Final[dict[Topic, str]] = {
    "scope": "",
    "adequate": "Is the baseline adequate?",
    "wrong": "What is wrong, and why?",
    "trust": "How often is such a verdict right here?",
    "gained": "What was gained?",
    "next": "What next?",
}
_JUDGED: Final = {
    "yes": "Yes.",
    "so far": "As far as these readings show.",
    "no": "No.",
    "together": "No.",
    "tails": "Not without heavy tails.",
    "improbable": "Improbable.",
}


@dataclass(frozen=True)
class Paragraph:
    """An answer: a paragraph, and what is listed below it."""

    text: Markup
    points: tuple[Markup, ...] = ()


def content(result: Diagnosis, beliefs: Sequence[Belief], shown: Sequence[Shown]) -> dict[str, Any]:
    """The verdict, the short answer, what the readings say besides, and the key numbers."""
    found: dict[Topic, list[Statement]] = {}
    for statement in answer(result, beliefs):
        found.setdefault(statement.topic, []).append(statement)
    return {
        "verdict": {"text": result.verdict, "kind": kind(result)},
        "sentences": paragraphs(result, found),
        "besides": [_said(statement) for statement in found.get("besides", ())],
        "tiles": tiles(result, shown),
    }


def paragraphs(result: Diagnosis, found: Mapping[Topic, list[Statement]], together: int = 2) -> list[Paragraph]:
    """The short answer, a paragraph a question; sentences beyond so many `together` are listed below it."""
    readings = sum(len(model.predicted) for name, model in result.show.items() if name == "baseline")
    examined = Markup("<strong>Examined:</strong> {} of {}, against the baseline and {}.").format(
        count(readings, "reading"), words.group_ids(result.groups), count(len(result.screening), "candidate cause")
    )
    answers = [Paragraph(examined)]
    for topic, question in _QUESTIONS.items():
        if statements := found.get(topic):
            head = Markup("<strong>{}</strong> ").format(question) if question else Markup("")
            judged = [Markup(_JUDGED[s.adequate]) for s in statements if isinstance(s, Judged)]
            said = [_said(s) for s in statements]
            first, points = Markup(" ").join([*judged, *said[:together]]), tuple(said[together:])
            link = Markup(" <a href='#next'>More</a>") if topic == "next" else ""
            answers.append(Paragraph(head + first + link, points))
    return answers


def _said(statement: Statement) -> Markup:
    text = escape(statement.say(PAGE))
    return text[:1].upper() + text[1:]  # a cause's title may begin it


def kind(result: Diagnosis) -> str:
    """The colour of the verdict.

    A baseline that nothing refutes may be less probable than others, or break a law; what fits may do so at
    implausible values; and at these conditions such names may be wrong more often than they say.
    """
    doubtful = result.verdict == "adequate" and kept(result) < 0.5
    if result.calibration and result.verdict in ("adequate", "explained"):
        doubtful = doubtful or result.calibration.overstated
    if result.unexplained_by == "law" or (result.verdict == "adequate" and any(not b.terms for b in result.laws)):
        return "bad"
    return "warn" if doubtful or result.unexplained_by == "values" else _KINDS[result.verdict]


def tiles(result: Diagnosis, shown: Sequence[Shown]) -> list[dict[str, str]]:
    """The key numbers: p values, and how far the models are off."""
    extension = "best causes, not adopted," if result.verdict == "adequate" else "extension"
    tested = (("baseline", result.misfit.baseline), (extension, result.misfit.extended))
    found = [
        {"value": p_value(t.least, t.floor), "label": f"p value: {what} against the readings{_AGAINST[t.objection]}"}
        for what, t in tested
        if t
    ]
    for k, curve in enumerate(shown[0].curves):
        errors = [g.errors[k] for g in shown]
        label = f"typical factor between {curve.name} and reading, fitted to all groups"
        if len(errors) > 1:
            label += f"; ×{factor(min(errors))} to ×{factor(max(errors))}"
        found.append({"value": f"×{factor(float(np.mean(errors)))}", "label": label})
    return found

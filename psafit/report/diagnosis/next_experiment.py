"""What to measure next, and how often such a verdict is right: sections of a diagnosis' page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from markupsafe import Markup

from psafit.diagnose.answer.findings import sized
from psafit.diagnose.next_experiment import NextExperiment, Pair, Proposal, ProposalSettings, Rehearsal
from psafit.diagnose.record import Diagnosis
from psafit.diagnose.record.models import Look
from psafit.diagnose.trials import Calibration, Rate
from psafit.drives import Drive
from psafit.experiment import CONSTANT_UNITS
from psafit.observables import OBSERVABLES
from psafit.report.catalogue import cause, model
from psafit.report.diagnosis import words
from psafit.report.page_words import PAGE
from psafit.report.wording import NBSP, listed, number, percent, span, symbol_html, with_unit
from psafit.text import count


def content(result: Diagnosis) -> dict[str, Any]:
    """What to measure next, how that would go, and how often such a verdict is right."""
    return {
        "proposals": proposals(result.next_experiment),
        "looks": looks(result.looks),
        "confusion": rehearsal(result.confusion.repeated) if result.confusion.repeated else None,
        "rehearsals": [rehearsal(one) for one in result.next_experiment.rehearsals or []],
        "calibration": calibration(result.calibration, result.explains),
    }


def proposals(found: NextExperiment) -> dict[str, Any] | None:
    """Measurements to make next, best first."""
    if not found.proposals:
        return None
    rows = []
    for p in found.proposals:
        changed = [
            Markup("{} = {}").format(symbol_html(name), with_unit(number(value), CONSTANT_UNITS.get(name, "1")))
            for name, value in p.constants.items()
        ]
        rows.append(
            [
                Markup("{}, {}{}").format(_drive(p), _readings(p), _read_as(p)),
                span(p.frequency_hz, "Hz"),
                span(p.amplitude_v, "V"),
                listed(changed) if changed else "as it is",
                PAGE.number(p.lead) if found.separates else words.narrowing(p),
                words.share(p.success),
                _left_tied(p.pairs),
            ]
        )
    several = any(len(p.pairs) > 1 for p in found.proposals)
    if not several:
        rows = [row[: -1 if found.separates else -2] for row in rows]
    about = found.purpose.say(PAGE) if found.purpose else ""
    explanations = (found.purpose.explanations if found.purpose else None) or []
    return {
        "about": about, "separates": found.separates, "several": several, "rows": rows,
        "explains": [words.KINDS_MEAN[e.kind] for e in explanations], "others": several or len(explanations) > 2,
    }  # fmt: skip


def looks(found: Sequence[Look]) -> list[list[Any]]:
    """What to look at on the rig, by cause, with what the readings say that would be seen."""
    rows = []
    for look in found:
        sizes = [sized(PAGE, name, p) for name, p in look.parameters.items()]
        rows.append([cause(look.cause), look.at, percent(look.probability), listed(sizes)])
    return rows


def _drive(proposal: Proposal) -> str:
    """The drive as groups are labelled, or the table of its voltage."""
    if "drive" in proposal.drive:
        return f"table {proposal.drive['drive']}"
    return Drive.with_settings(proposal.waveform, proposal.drive).label


def _readings(proposal: Proposal) -> str:
    """How many they are, of launches or along a trace."""
    if proposal.time_us is None:
        return count(proposal.n_readings, "reading")
    return f"{count(proposal.n_readings, 'sample')} over {proposal.time_us[-1]:g}{NBSP}µs"


def _read_as(proposal: Proposal) -> str:
    """The observable of the readings, where it is not the one read so far."""
    named = next((o for o in OBSERVABLES if o.name == proposal.observable), None)
    if named is None:
        return ""
    whose = "the ball's" if named.traced and not named.tip else "the"
    return f" of {whose} {named.title}"


def _left_tied(pairs: Sequence[Pair], hardly: float = ProposalSettings.wins) -> Markup | str:
    """The pairs of models that a measurement would hardly separate, by fewer nats than this."""
    tied = [
        Markup("{} and {}").format(model(pair.first), model(pair.second)) for pair in pairs if pair.separation < hardly
    ]
    return Markup("; ").join(tied) if tied else "none"


def rehearsal(found: Rehearsal) -> dict[str, Any]:
    """Probability of the truth before and after a simulated measurement."""
    rows = [
        [model(ids), words.share(before), words.share(after)]
        for ids, before, after in zip(found.truth, found.before, found.after, strict=True)
    ]
    return {"text": found.proposal, "first": found.first, "n": len(rows), "rows": rows}


def calibration(found: Calibration | None, explains: bool) -> dict[str, Any] | None:
    """How often such a verdict is right here: by what made the readings, and by the probability printed."""
    if not found:
        return None
    return {
        "explains": explains,
        "n": found.exact.of,
        "truths": [
            [model(one.truth), str(one.exact.of), str(one.exact.n), str(one.reported.n)] for one in found.truths
        ],
        "reliability": [
            [f"{percent(r.lower)} to {percent(r.upper)}", str(r.right.of), percent(r.mean), _rate(r.right)]
            for r in found.reliability
        ],
        "exact": _rate(found.exact),
        "reported": _rate(found.reported),
    }


def _rate(found: Rate) -> str:
    return f"{found.n} of {found.of} ({percent(found.lower)} to {percent(found.upper)})"

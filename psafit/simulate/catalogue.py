"""The causes' declarations as records: what `psafit terms` lists and docs/causes.md is made from."""

from __future__ import annotations

from psafit.parameters import Parameter
from psafit.physics.term import Term
from psafit.records import CauseEntry, CauseParameterEntry, SymptomEntry
from psafit.simulate.batch import path_of


def declaration(term: Term) -> CauseEntry:
    """Everything a cause declares but its functions."""
    symptom = term.symptom
    return CauseEntry(
        id=term.id,
        slot=term.slot,
        title=term.title,
        equation=term.equation,
        description=term.description.strip(),
        parameters=[entry(p) for p in term.parameters],
        latent=entry(term.latent) if term.latent else None,
        symptom=SymptomEntry(
            symptom.text, symptom.sign, symptom.frequency, symptom.amplitude, list(symptom.waveforms)
        ),
        reference=term.reference,
        checks=[check.working for check in term.checks],
        path=path_of([term]),
        probability=term.probability,
        because=term.because,
        look=term.look,
        drives=term.drives,
        reads=list(term.reads) if term.slot == "reading" else [],
        plugin=term.plugin,
    )  # fmt: skip


def entry(p: Parameter) -> CauseParameterEntry:
    """Everything a parameter declares."""
    bounds = [p.bounds.lower, p.bounds.upper]
    return CauseParameterEntry(p.name, p.symbol, p.unit, p.neutral, bounds, p.prior.describe(), p.description, p.source)

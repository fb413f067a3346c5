"""`psafit terms`: the catalogue in a terminal."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from psafit.cli.common import (
    DONE,
    JSON,
    PLUGIN,
    QUIET,
    Command,
    write_result,
)

if TYPE_CHECKING:
    from psafit.records import CauseEntry, CauseParameterEntry


@click.command(cls=Command, short_help="List causes and parameters, or describe one in full.")
@click.argument("id", metavar="[ID]", required=False)
@PLUGIN
@QUIET
@JSON
def terms(id: str | None, quiet: bool, json_file: Path | None) -> int:
    """List the baseline's parameters and the causes that can be added to it, or say all that ID declares.

    ID is a cause or a parameter.
    """
    from psafit.inference import noise
    from psafit.observables import OBSERVABLES
    from psafit.physics import TERMS, baseline, owner, term
    from psafit.simulate.catalogue import declaration, entry

    plain = [entry(p) for p in (*baseline.PARAMETERS, *noise.PARAMETERS)]
    of_scatter = (entry(p) for o in OBSERVABLES for p in o.scatter)
    if own := [p for p in (*plain, *of_scatter) if p.name == id][:1]:
        write_result(json_file, own)
        if not quiet:
            click.echo("\n".join(_parameter(own[0])))
        return DONE
    sessions = {t.latent.name: t.id for t in TERMS if t.latent}
    id = (owner(id) or sessions.get(id, id)) if id else id
    entries = [declaration(t) for t in ([term(id)] if id else TERMS)]
    write_result(json_file, entries)
    if not quiet:
        click.echo(_declaration(entries[0]) if id else _listing(entries, plain))
    return DONE


def _listing(entries: Sequence[CauseEntry], plain: Sequence[CauseParameterEntry]) -> str:
    """The baseline's parameters, and the causes slot by slot, one parameter a line."""
    rows: list[tuple[str, str, str]] = [("baseline", "", "")]
    rows += [("", p.description.partition(" (")[0], f"{p.name} ({p.unit})") for p in plain]
    for slot, members in itertools.groupby(entries, key=lambda e: e.slot):
        rows.append((slot, "", ""))
        for entry in members:
            # A parameter without a neutral value of its own does nothing where the first is neutral.
            wrapped = [
                f"{p.name} ({p.unit})" + ("" if p.neutral is None else f", neutral {p.neutral:g}")
                for p in entry.parameters
            ]
            rows.append((f"  {entry.id}", entry.title + (" (plugin)" if entry.plugin else ""), wrapped[0]))
            rows += [("", "", more) for more in wrapped[1:]]
    widths = [max(len(row[i]) for row in rows) for i in range(2)]
    lines = [f"{a:{widths[0]}}  {b:{widths[1]}}  {c}".rstrip() for a, b, c in rows]
    return "\n".join([*lines, "", "psafit terms ID says all about one of them, cause or parameter."])


def _declaration(entry: CauseEntry) -> str:
    """A cause's declaration for a terminal 88 columns wide."""
    from psafit.physics.term import DRIVES

    lines = [f"{entry.id}: {entry.title} ({entry.slot})", ""]
    for block in re.sub(r":math:`([^`]*)`", r"\1", entry.description).replace("``", "`").split("\n\n"):
        # A displayed formula stays LaTeX, which a terminal cannot set; the catalogue's page does.
        formula = block.removeprefix(".. math::")
        shown = (
            textwrap.fill(block, 88, break_on_hyphens=False)
            if formula == block
            else textwrap.indent(textwrap.dedent(formula).strip(), "    ")
        )
        lines += [shown, ""]
    named = [("", p) for p in entry.parameters] + [("each session: ", p) for p in [entry.latent] if p]
    for kind, p in named:
        lines += _parameter(p, kind)
    s = entry.symptom
    sign = {1: "raises the range", -1: "lowers the range", 0: "raises or lowers the range"}[s.sign]
    lines.append(_wrapped("symptom", s.text))
    on = " and ".join(f"{name}s" for name in s.waveforms)
    trends = f"effect with frequency: {s.frequency}, with amplitude: {s.amplitude}"
    lines.append(_wrapped("", f"on {on}: {sign}; {trends}"))
    lines.append(_wrapped("drives", DRIVES[entry.drives]))
    lines += [_wrapped("reads", ", ".join(entry.reads))] if entry.reads else []
    lines.append(
        _wrapped("at work", f"probability {entry.probability:g} before any reading; {entry.because or 'a surprise'}")
    )
    lines += [_wrapped("check", entry.look)] if entry.look else []
    lines.append(_wrapped("reference", entry.reference))
    lines += [_wrapped("by hand" if i == 0 else "", check) for i, check in enumerate(entry.checks)]
    lines.append(_wrapped("simulated", f"by the {entry.path}"))
    lines += [_wrapped("plugin", f"SHA-256 {entry.plugin}...")] if entry.plugin else []
    return "\n".join(lines)


def _parameter(p: CauseParameterEntry, kind: str = "") -> list[str]:
    neutral = "" if p.neutral is None else f"neutral {p.neutral:g}; "
    return [
        _wrapped("parameter", f"{kind}{p.name} ({p.unit}): {p.description}"),
        _wrapped("", f"{neutral}possible {p.bounds[0]:g} to {p.bounds[1]:g}; prior {p.prior}"),
        _wrapped("", p.source),
    ]


def _wrapped(label: str, text: str) -> str:
    first = f"{label:<11}"
    return textwrap.fill(text, 88, initial_indent=first, subsequent_indent=11 * " ", break_on_hyphens=False)

"""The physics: the baseline and, one file each, the candidate causes. This is their registry.

To add a cause to psafit, write its file, import it here and put it in its slot's line. Causes from elsewhere
(`psafit.physics.plugin`) join the registry when it is imported.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from psafit.errors import InputError
from psafit.experiment.plausible import doubt, valued
from psafit.experiment.rig import Followed
from psafit.experiment.text import did_you_mean, shown
from psafit.observables import OBSERVABLES, Observable
from psafit.parameters import Belief, Parameter, leading_belief
from psafit.physics import (
    adhesion,
    amplifier_lag,
    amplitude_scale,
    anchored_stroke,
    baseline,
    drive_saturation,
    field_dependent_d33,
    flight_friction,
    frame_compliance,
    gap,
    hertz_exponent,
    hunt_crossley,
    hysteresis,
    idle_level,
    indentation_damping,
    modal_mass,
    no_tension,
    plugin,
    preload,
    reading_gain,
    reading_offset,
    repeat_impacts,
    separation_height,
    session_lean,
    slew_limit,
    sliding_support,
    soft_layer,
    stack_stiffness,
    start_phase,
    stroke_tolerance,
    swing_drag,
)
from psafit.physics.term import SLOTS, Term, signature

__all__ = [
    "TERMS", "baseline", "informed", "informed_scatter", "label", "meaning",
    "owner", "plugin_versions", "recorded", "signatures", "term", "terms",
]  # fmt: skip

_BUILT_IN: tuple[Term, ...] = tuple(
    module.TERM
    for module in (
        amplifier_lag, slew_limit, start_phase, amplitude_scale, idle_level,  # drive
        anchored_stroke, field_dependent_d33, drive_saturation, hysteresis,  # stack: its stroke
        modal_mass, stack_stiffness, stroke_tolerance, frame_compliance,  # stack: its body
        hertz_exponent, soft_layer, hunt_crossley, indentation_damping,  # contact: its law
        no_tension, adhesion, gap, preload, session_lean, repeat_impacts,  # contact: its begin and end
        flight_friction, sliding_support, swing_drag, separation_height,  # flight
        reading_offset, reading_gain,  # reading
    )
)  # fmt: skip


def _refuse_clashes(registry: tuple[Term, ...]) -> None:
    ids = [t.id for t in registry]
    names = [p.name for p in baseline.PARAMETERS]
    for t in registry:
        names += plugin.names(t)
    twice = [name for kind in (ids, names) for name, count in Counter(kind).items() if count > 1]
    if twice:
        raise ValueError(f"the registry of causes has names twice: {', '.join(twice)}")
    if ids != [t.id for t in sorted(registry, key=lambda t: SLOTS.index(t.slot))]:
        raise ValueError(f"the registry of causes is not in the order of the slots {', '.join(SLOTS)}")


_refuse_clashes(_BUILT_IN)


def term(id: str) -> Term:
    """Look up a cause.

    Raises
    ------
    InputError
        If there is none of that identifier.
    """
    for known in TERMS:
        if known.id == id:
            return known
    ids = [t.id for t in TERMS]
    close = difflib.get_close_matches(id, ids, n=3, cutoff=0.4)
    remedy = f"did you mean {' or '.join(close)}?" if close else f"known are {', '.join(ids)}"
    if _of_scatter(id):
        remedy = "that is a parameter of the scatter, which psafit fits with any causes"
    raise InputError(f"there is no cause {id!r}", f"{remedy} (a cause of your own: --plugin FILE)")


def _of_scatter(name: str) -> bool:
    """Whether a name that is no cause's is one of the scatter's parameters."""
    return name.startswith(("sigma_", "nu_", "tau_")) or name in ("nu", "tau")


def terms(ids: Iterable[str]) -> tuple[Term, ...]:
    """Look up causes; the result is in the registry's order, whatever the order of `ids`.

    Raises
    ------
    InputError
        If an identifier is unknown or occurs twice.
    """
    asked = list(ids)
    chosen = {term(id).id for id in asked}
    if len(chosen) < len(asked):
        twice = [id for id, count in Counter(asked).items() if count > 1]
        raise InputError(f"cause {', '.join(twice)} is named twice", "name each cause once")
    return tuple(t for t in TERMS if t.id in chosen)


def recorded(ids: Iterable[str], versions: Mapping[str, str], file: Path) -> tuple[Term, ...]:
    """Look up the causes of a stored result, of which plugins must be the very files of then.

    Parameters
    ----------
    ids : iterable of str
    versions : mapping
        What the result says it was made with; see `plugin_versions`.
    file : Path
        The result.

    Raises
    ------
    InputError
        If a cause is unknown, or a plugin is missing or has changed.
    """
    here = {t.id: t.plugin for t in TERMS}
    for id in ids:
        then = versions.get(_VERSION.format(id), "")
        if then and id not in here:
            remedy = "name its file with --plugin or in PSAFIT_PLUGINS"
            raise InputError(f"was made with the plugin {id} (SHA-256 {then}), which is not here", remedy, file=file)
        if id in here and then != here[id]:
            was, now = (f"a plugin of SHA-256 {h}" if h else "built in" for h in (then, here[id]))
            what = f"was made with another cause {id}: it was {was} and is now {now}"
            raise InputError(what, "name the file of then, or fit again", file=file)
    return terms(ids)


def plugin_versions() -> dict[str, str]:
    """The causes that are plugins, as a result lists them among versions."""
    return {_VERSION.format(t.id): t.plugin for t in TERMS if t.plugin}


def signatures(ids: Iterable[str], versions: Mapping[str, str]) -> list[str]:
    """See `Term.signature`, for the causes of a stored result."""
    return [signature(id, versions.get(_VERSION.format(id), "")) for id in ids]


def with_plugins(built_in: tuple[Term, ...]) -> tuple[Term, ...]:
    """Return built-in causes, and those of installed plugins, which have other names."""
    known = built_in
    for file, found in plugin.discover():
        plugin.refuse_clash(file, found, known)
        known += (found,)
    return tuple(sorted(known, key=lambda t: SLOTS.index(t.slot)))


_VERSION = "plugin {}"
# Last: a plugin that imports what builds on the registry fails, instead of leaving it without plugins.
TERMS = with_plugins(_BUILT_IN)
_OWNERS = {p.name: t.id for t in TERMS for p in t.parameters}
_KNOWN = {p.name: p for p in (*baseline.PARAMETERS, *(p for t in TERMS for p in t.parameters))}


def owner(name: str) -> str | None:
    """The cause that a parameter belongs to; None for the baseline's, a session's own and the scatter's."""
    return _OWNERS.get(name)


def meaning(name: str) -> str:
    """What a parameter of the baseline or of a cause of the catalogue stands for; empty where it is unknown."""
    return _KNOWN[name].description if name in _KNOWN else ""


def held_at_work(beliefs: Iterable[Belief]) -> dict[str, tuple[float, str]]:
    """Causes that an experiment holds to be at work rather than not: how probable they are, and the table that says so.

    >>> held_at_work([Belief("gap_width", None, "seen", probability=0.8)])
    {'gap': (0.8, '[prior]')}
    """
    every = list(beliefs)
    said = {t.id: leading_belief(b for b in every if owner(b.name) == t.id) for t in TERMS}
    return {
        id: (b.probability, "[rig]" if b.derived else "[prior]")
        for id, b in said.items() if b is not None and b.probability is not None and b.probability > 0.5
    }  # fmt: skip


def redefined(ids: Iterable[str]) -> dict[str, dict[str, str]]:
    """Parameters of the baseline that are something else with some causes: by parameter and cause, what it is."""
    chosen, found = {*ids}, dict[str, dict[str, str]]()
    for t in TERMS:
        for name, what in t.redefines if t.id in chosen else ():
            found.setdefault(name, {})[t.id] = what
    return found


def _refused(belief: Followed, reason: str) -> tuple[str, str]:
    """What is wrong with facts from which no prior can follow, and the remedy."""
    for key, value in belief.facts:
        if said := doubt(key, value):
            return said
    facts = " and ".join(valued(key, value) for key, value in belief.facts)
    what = f"{belief.name} cannot be what follows from {facts}"
    return what, f"correct the fact or its unit, or leave it out; a prior {reason}"


def label(name: str) -> str:
    """A parameter of the baseline or of a cause with its unit, if it has one.

    Examples
    --------
    >>> label("k_c"), label("no_tension_s")
    ('k_c (N/m)', 'no_tension_s')
    """
    unit = _KNOWN[name].unit if name in _KNOWN else "1"
    return name if unit == "1" else f"{name} ({unit})"


def _unknown(name: str, known: Iterable[str], causes: Iterable[Term]) -> tuple[str, str]:
    """What is wrong with the name of a prior that no parameter has, and what to do."""
    for cause in causes:
        if cause.latent and (name == cause.latent.name or name.startswith(f"{cause.latent.name}_")):
            what = f"{name} is what each session has by {cause.id}"
            return what, f"state the prior of its spread, as psafit terms {cause.id} lists it"
    remedy = f"{did_you_mean(name, known)}; of a cause of your own give its file, too: --plugin FILE"
    return f"there is no parameter {shown(name)} to know of", remedy


def informed(beliefs: Sequence[Belief], causes: Iterable[Term]) -> tuple[tuple[Parameter, ...], tuple[Term, ...]]:
    """The baseline's parameters and some causes, with what is known of their values in the place of usual priors.

    Raises
    ------
    InputError
        If something is said to be known of what is no parameter, or what cannot be.
    """
    causes = tuple(causes)
    if not beliefs:
        return baseline.PARAMETERS, causes
    found = _informed(beliefs, causes)

    def known_of(parameters: Iterable[Parameter]) -> tuple[Parameter, ...]:
        return tuple(found.get(p.name, p) for p in parameters)

    def known_cause(cause: Term) -> Term:
        names = [p.name for p in cause.parameters]
        said = leading_belief(b for b in beliefs if b.name in names)
        probability = cause.probability if said is None or said.probability is None else said.probability
        return replace(cause, parameters=known_of(cause.parameters), probability=probability)

    return known_of(baseline.PARAMETERS), tuple(map(known_cause, causes))


def informed_scatter(beliefs: Sequence[Belief], observable: Observable) -> tuple[Parameter, ...]:
    """The parameters of an observable's scatter, with what is known of them in the place of usual priors."""
    if not beliefs:
        return observable.scatter
    found = _informed(beliefs, ())
    return tuple(found.get(p.name, p) for p in observable.scatter)


def _informed(beliefs: Sequence[Belief], causes: Sequence[Term]) -> dict[str, Parameter]:
    """The parameters of which something is known, with what is known of them."""
    own = {p.name: p for t in (*TERMS, *causes) for p in t.parameters}
    known = {p.name: p for p in (*baseline.PARAMETERS, *(p for o in OBSERVABLES for p in o.scatter))} | own
    found: dict[str, Parameter] = {}
    for b in beliefs:
        if b.name not in known:
            what, remedy = _unknown(b.name, known, (*TERMS, *causes))
            raise InputError(what, remedy, file=b.file, line=b.line)
        try:
            found[b.name] = found.get(b.name, known[b.name]).informed(b)
        except ValueError as error:
            what, remedy = f"prior of {b.name} ({b.describe()}) cannot be", f"it {error}"
            if isinstance(b, Followed):
                what, remedy = _refused(b, str(error))
            raise InputError(what, remedy, file=b.file, line=b.line) from None
        if b.probability is not None and b.name not in own:
            what, remedy = f"{b.name} is of the model itself, which is always at work", "leave its probability out"
            raise InputError(what, remedy, file=b.file, line=b.line)
    return found

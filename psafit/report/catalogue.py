"""Causes and parameters as a page names them: a record knows them by their identifiers only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from markupsafe import Markup, escape

from psafit.observables import OBSERVABLES
from psafit.parameters import Parameter
from psafit.physics import TERMS, baseline
from psafit.report.wording import noted, symbol_html

TITLES: Final[dict[str, str]] = {t.id: t.title for t in TERMS}
_PARAMETERS: Final[dict[str, Parameter]] = {
    p.name: p
    for p in (
        *baseline.PARAMETERS,
        *(p for t in TERMS for p in t.parameters),
        *(p for o in OBSERVABLES for p in o.scatter),
    )
}
_LATENTS: Final[dict[str, Parameter]] = {t.latent.name: t.latent for t in TERMS if t.latent}


def cause(id: str) -> Markup:
    """A cause with its identifier behind it."""
    title = TITLES.get(id)
    return noted(title, f"({id})") if title else escape(id)


def model(terms: Sequence[str]) -> Markup:
    """A set of causes in words."""
    return Markup(" + ").join(TITLES.get(t, t) for t in terms) if terms else Markup("the baseline alone")


def declared(name: str) -> Parameter | None:
    """The declaration of a parameter, if this version has one; of a session's own, that of all sessions."""
    return _PARAMETERS.get(name) or next((p for own, p in _LATENTS.items() if name.startswith(f"{own}_")), None)


def symbol(name: str) -> Markup:
    """A parameter's symbol; its name where this version does not know it."""
    found = declared(name)
    return symbol_html(found.symbol) if found else Markup("<code>{}</code>").format(name)


def parameter(name: str, description: str) -> Markup:
    """A parameter's symbol with what it means."""
    return noted(symbol(name), description)

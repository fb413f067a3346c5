"""Causes from outside the package: files named in the environment, and entry points of installed packages.

A cause is known by the SHA-256 of its file, without any path. A file is compiled from the very bytes that were hashed,
so that no stale byte code stands in for it, as a module of this package whose name follows from them: a process that is
sent one of its functions imports this package first, and so reads the same file, or finds that it has changed.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import itertools
import sys
from collections.abc import Iterable, Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from psafit import plugins
from psafit.errors import InputError
from psafit.files import read_error
from psafit.physics import baseline
from psafit.physics.term import Term

ENTRY_POINTS = "psafit.causes"
SCATTER = ("sigma_rel", "sigma_abs", "nu")
"""Names of the scatter's parameters, which every fit has besides those of its causes."""

_REMEDY = "correct the file; docs/own-causes.md says what a cause declares"


def read(file: Path) -> Term:
    """Read the cause that a file declares as ``TERM``.

    Raises
    ------
    InputError
        If the file cannot be read or run, or declares none.
    """
    source = _bytes(file)
    digest = _digest(source)
    name = f"{__package__}.plugin_{digest}"
    if name not in sys.modules:
        module = ModuleType(name)
        module.__file__, module.__package__ = str(file), __package__
        sys.modules[name] = module
        try:
            with contextlib.redirect_stdout(sys.stderr):  # standard output is for results
                exec(compile(source, str(file), "exec", dont_inherit=True), module.__dict__)
        except (Exception, SystemExit) as error:
            del sys.modules[name]
            line = plugins.place(error, file)
            raise InputError(
                f"cannot be loaded ({plugins.message_of(error)})", _REMEDY, file=file, line=line
            ) from error
    return _declared(sys.modules[name], file, digest)


def discover() -> Iterator[tuple[Path, Term]]:
    """Every plugin, with the file it was read from; copies of one file count once."""
    seen = set()
    installed = map(_installed, sorted(entry_points(group=ENTRY_POINTS)))
    for file, term in itertools.chain(installed, ((f, read(f)) for f in plugins.files())):
        if term.plugin not in seen:
            seen.add(term.plugin)
            yield file, term


def refuse_clash(file: Path, new: Term, known: Iterable[Term]) -> None:
    """Refuse a plugin that takes a name which something else has.

    Raises
    ------
    InputError
        With the line on which the file says the name.
    """
    owners = dict.fromkeys(SCATTER, "the scatter") | {p.name: "the baseline" for p in baseline.PARAMETERS}
    ids = {}
    known = tuple(known)
    for term in known:
        whose = f"the {'plugin' if term.plugin else 'built-in cause'} {term.id}"
        ids[term.id] = whose
        owners |= dict.fromkeys(names(term), whose)
    for latent in [term.latent.name for term in (*known, new) if term.latent]:
        sessions = f"what each session has for itself ({latent}_...)"
        owners |= {name: sessions for name in names(new) if name.startswith(f"{latent}_")}
    clashes = [("identifier", new.id, ids)] + [("parameter name", name, owners) for name in names(new)]
    for kind, name, taken in clashes:
        if name in taken:
            line = _line_of(name, file)
            raise InputError(f"the {kind} {name!r} is that of {taken[name]}", "choose another", file=file, line=line)
    own = names(new)
    if len(set(own)) < len(own):
        raise InputError("a parameter name occurs twice", "name each parameter differently", file=file)


def names(term: Term) -> list[str]:
    """Names that a cause brings into a model."""
    return [p.name for p in (*term.parameters, *([term.latent] if term.latent else []))]


def _installed(point: EntryPoint) -> tuple[Path, Term]:
    package = f"the package {point.dist.name}" if point.dist else "a package"
    remedy = f"correct or uninstall {package}"
    try:
        with contextlib.redirect_stdout(sys.stderr):
            found = point.load()
    except (Exception, SystemExit) as error:
        raise InputError(f"the plugin {point.name} cannot be loaded ({plugins.message_of(error)})", remedy) from error
    file = getattr(sys.modules[point.module], "__file__", None)
    if not file:
        raise InputError(f"the plugin {point.name} is no file", remedy)
    return Path(file), _declared(found, Path(file), _digest(_bytes(Path(file))))


def _declared(found: Any, file: Path, digest: str) -> Term:
    """The cause, marked as a plugin; `found` is its module or itself."""
    term = found if isinstance(found, Term) else getattr(found, "TERM", None)
    if term is None:
        raise InputError("declares no TERM", _REMEDY, file=file)
    if not isinstance(term, Term):
        what = f"TERM is a {type(term).__name__}, not a Term"
        raise InputError(what, _REMEDY, file=file, line=_line_of("TERM", file))
    return replace(term, plugin=digest)


def _bytes(file: Path) -> bytes:
    try:
        if not file.is_file():  # a pipe would wait for ever
            raise InputError("no such plugin file", "give the Python file of a cause", file=file)
        return file.read_bytes()
    except (OSError, ValueError) as error:  # a NUL in its name
        raise read_error(error, file, f"cannot be read ({error})", "give the Python file of a cause") from error


def _digest(source: bytes, digits: int = 16) -> str:
    """Return the first `digits` hexadecimal digits of the SHA-256: enough to distinguish two files."""
    return hashlib.sha256(source).hexdigest()[:digits]


def _line_of(name: str, file: Path) -> int | None:
    """Line on which a file first says a name, as text or as a variable."""
    lines = [
        node.lineno
        for node in ast.walk(ast.parse(_bytes(file)))
        if (isinstance(node, ast.Constant) and node.value == name) or (isinstance(node, ast.Name) and node.id == name)
    ]
    return min(lines, default=None)

"""The folder of a diagnosis: whose it is, and the answer that it already holds."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from psafit.diagnose.record import MARKER, PAGE, PREDICTIONS, PREVIOUS, RESULT, Diagnosis
from psafit.diagnose.significance import NULL_LEADS
from psafit.errors import InputError
from psafit.experiment import Experiment
from psafit.files import Refused, digest, refuse_foreign, sha256, write_atomically
from psafit.inference.memory import code
from psafit.inference.problem import Problem
from psafit.inference.run_folder import load, versions
from psafit.records import read_content, read_json

_Held = TypeVar("_Held")


def identity_of(everything: Problem, asked: list[Any]) -> str:
    """Digest of all that a result depends on: the program, the experiment, what is asked for, and the catalogue."""
    experiment = everything.experiment
    return digest(
        [
            code(), sha256(NULL_LEADS), versions(), experiment.title, experiment.limits, experiment.readable,
            experiment.fingerprint, *asked,
            [t.determinants for t in everything.terms], *(p.signature for p in everything.parameters),
        ]
    )  # fmt: skip


def claim(folder: Path, experiment: Experiment) -> None:
    """Make a folder ours, or see that it is: nobody's files are replaced, nor the diagnosis of another rig."""
    marker, another = folder / MARKER, "choose another --out, or move it elsewhere"
    record, fitted = _record(folder), (folder / "fit.json").exists()
    if not (fitted and _is_fit_of(experiment, folder)):
        if fitted and marker.is_file():
            raise InputError("holds a fit of other readings or priors", another, file=folder)
        if not (marker.is_file() or "fingerprint" in record):
            refuse_foreign(folder)
    mine = experiment.fingerprint
    kept = record.get("fingerprint", mine)
    if kept != mine or (marker.is_file() and marker.read_bytes() != mine.encode()):
        raise InputError("holds the diagnosis of other readings", another, file=folder)
    for name in (RESULT, PAGE, PREDICTIONS):
        if (folder / name).is_dir():
            raise InputError("is a folder, where a file of the diagnosis goes", another, file=folder / name)
    if (kept_before := folder / PREVIOUS).exists() and not (kept_before / RESULT).is_file():
        raise InputError("is none that a diagnosis made, where it keeps the answer before", another, file=kept_before)
    write_atomically(marker, mine.encode())


def _is_fit_of(experiment: Experiment, folder: Path) -> bool:
    """Whether a folder holds a fit of the same readings, with which a diagnosis may share it."""
    if (run := _readable(lambda: load(folder))) is None:
        return False
    of = run.problem.experiment
    return all(getattr(of, name) == getattr(experiment, name) for name in ("fingerprint", "title", "beliefs"))


def set_aside(folder: Path) -> None:
    """Move an answer into `previous/`, in the place of an older one: the tables that follow belong to another.

    It is copied before anything is removed, so that what was interrupted is repeated.
    """
    record = _record(folder)
    names = [RESULT, PAGE, *(name for name in map(str, record.get("files") or ()) if Path(name).name == name)]
    if record:
        place, copy = folder / PREVIOUS, folder / f".{PREVIOUS}.tmp"
        if copy.exists():
            shutil.rmtree(copy)
        copy.mkdir()
        for file in (folder / name for name in names):
            if file.is_file():
                shutil.copy2(file, copy)
        if (folder / "experiment").is_dir():
            shutil.copytree(folder / "experiment", copy / "experiment")
        if place.exists():
            shutil.rmtree(place)
        copy.rename(place)
        logging.getLogger(__name__).info("the answer that was here before is kept in %s", place)
    for name in names:
        (folder / name).unlink(missing_ok=True)


def _record(folder: Path) -> dict[str, Any]:
    """What a folder holds of an answer, of any version; nothing where nobody can use it."""
    held = _readable(lambda: read_content(folder / RESULT)) if (folder / RESULT).is_file() else None
    return held if isinstance(held, dict) else {}


def _readable(read: Callable[[], _Held]) -> _Held | None:
    """What `read` gives; None where nothing can be made of it. What may not be opened is refused all the same."""
    try:
        return read()
    except Refused:
        raise
    except InputError:
        return None


def held_in(folder: Path, identity: str) -> Diagnosis | None:
    """What the same command has found before, unless some of it is gone."""
    held = _readable(lambda: read_json(folder / RESULT, Diagnosis, sealed=True))
    if held is None:
        return None
    parts = [held.predictions, *(gain.predictions for gain in held.gain.values())]
    parts += [run.folder for run in held.extension.values()]
    whole = all((folder / part).exists() for part in parts)
    unchanged = whole and all(sha256(folder / name) == seal for name, seal in held.files.items())
    return held if unchanged and held.identity == identity else None

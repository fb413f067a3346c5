"""What a diagnosis has worked out already, so that an interrupted one goes on where it stopped."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from psafit.files import digest, read_bytes, sha256, write_atomically
from psafit.inference.problem import Problem

_SEAL = "sha256"
# Parts of the package that work nothing out.
_TELLERS = ("report", "challenge", "cli", "api", "progress", "compare", "reproduce")
Arrays = Mapping[str, NDArray[np.float64]]


@cache
def code() -> str:
    """What the code was that works a diagnosis out: SHA-256 of its sources."""
    package = Path(__file__).parents[1]
    files = {path.relative_to(package).as_posix(): path for path in package.rglob("*.py")}
    told = [[name, sha256(files[name])] for name in sorted(files) if not name.startswith(_TELLERS)]
    return digest(told)


class Memory:
    """Arrays by what determines them, in a folder; without a folder nothing is kept.

    A file that is damaged, was changed, or was worked out by other code, is worked out anew. One that the system
    refuses is not: hours of work may be in it.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    @property
    def lasts(self) -> bool:
        """Whether another process finds what is kept."""
        return self._folder is not None

    def count(self, kind: str) -> int:
        """Number of things of a kind that are kept."""
        return 0 if self._folder is None else sum(1 for _ in self._folder.glob(f"{kind}-*.npz"))

    def recall(self, kind: str, problem: Problem, about: object, make: Callable[[], Arrays]) -> Arrays:
        """Look up what `make` would give, or make and keep it.

        Parameters
        ----------
        kind : str
            What it is.
        problem : Problem
        about : object
            What else determines it, as JSON can say it.
        make : callable
            Returns named arrays.
        """
        if self._folder is None:
            return make()
        determinants = [
            kind, code(), problem.experiment.fingerprint, [str(g) for g in problem.group_ids],
            [t.signature for t in problem.terms], problem.tolerance, about,
            [p.signature for p in problem.parameters],
        ]  # fmt: skip
        key = digest(determinants)[:24]
        path = self._folder / f"{kind}-{key}.npz"
        if path.exists():
            raw = read_bytes(path, "repeat the diagnosis")
            with suppress(Exception):  # a damaged archive raises what zipfile and zlib please
                # From memory: np.load leaves a damaged file open.
                with np.load(io.BytesIO(raw), allow_pickle=False) as stored:
                    found = dict(stored)
                if bytes(found.pop(_SEAL)) == _sealed(found):
                    return found
        made = {name: np.asarray(a) for name, a in make().items()}
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **made, **{_SEAL: np.frombuffer(_sealed(made), np.uint8)})
        write_atomically(path, buffer.getvalue())
        return made


def _sealed(arrays: Arrays) -> bytes:
    """What tells whether arrays are those that were kept."""
    found = hashlib.sha256()
    for name in sorted(arrays):
        a = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {a.dtype.str} {a.shape}\n".encode() + a.tobytes())
    return found.digest()

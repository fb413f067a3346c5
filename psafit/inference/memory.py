"""What a diagnosis has worked out already, so that an interrupted one goes on where it stopped."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from psafit.files import digest, read_bytes, sha256, write_atomically
from psafit.inference.problem import Problem
from psafit.workers import precompute, scratch

_SEAL = "sha256"
# Parts of the package that work nothing out.
_REPORTERS = ("report", "challenge", "cli", "api", "progress", "compare", "reproduce")
Arrays = Mapping[str, NDArray[np.float64]]
Result = TypeVar("Result")


@cache
def code() -> str:
    """What the code was that works a diagnosis out: SHA-256 of its sources."""
    package = Path(__file__).parents[1]
    files = {path.relative_to(package).as_posix(): path for path in package.rglob("*.py")}
    hashes = [[name, sha256(files[name])] for name in sorted(files) if not name.startswith(_REPORTERS)]
    return digest(hashes)


class Memory:
    """Arrays by what determines them, in a folder; without a folder they are kept as long as the object lives.

    A file that is damaged, was changed, or was worked out by other code, is worked out anew. One that the system
    refuses is not: hours of work may be in it.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._held: dict[str, Arrays] = {}

    @property
    def within_reach(self) -> bool:
        """Whether its folder is here; a process of another machine may not see it."""
        return self._folder is not None and self._folder.is_dir()

    def begin(self) -> None:
        """Make the folder, so that other processes find it."""
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)

    def count(self, kind: str) -> int:
        """Number of things of a kind that are kept."""
        return 0 if self._folder is None else sum(1 for _ in self._folder.glob(f"{kind}-*.npz"))

    def key(self, kind: str, problem: Problem, about: object) -> str:
        """Name of something by what determines it; parameters as of `recall`."""
        determinants = [
            kind, code(), problem.experiment.fingerprint, [str(g) for g in problem.group_ids],
            [t.signature for t in problem.terms], problem.tolerance, about,
            [p.signature for p in problem.parameters],
        ]  # fmt: skip
        return f"{kind}-{digest(determinants)[:24]}"

    def holds(self, key: str) -> bool:
        """Whether something of this name is kept, sound or not."""
        return key in self._held if self._folder is None else (self._folder / f"{key}.npz").exists()

    def look(self, key: str) -> Arrays | None:
        """Read what is kept under a name; None where there is nothing sound."""
        if self._folder is None:
            return self._held.get(key)
        path = self._folder / f"{key}.npz"
        if path.exists():
            raw = read_bytes(path, "repeat the diagnosis")
            with suppress(Exception):  # a damaged archive raises what zipfile and zlib please
                # From memory: np.load leaves a damaged file open.
                with np.load(io.BytesIO(raw), allow_pickle=False) as stored:
                    found = dict(stored)
                if bytes(found.pop(_SEAL)) == _sealed(found):
                    return found
        return None

    def keep(self, key: str, made: Arrays) -> Arrays:
        """Keep arrays under a name, and return them."""
        made = {name: np.asarray(a) for name, a in made.items()}
        if self._folder is None:
            self._held[key] = made
            return made
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **made, **{_SEAL: np.frombuffer(_sealed(made), np.uint8)})
        write_atomically(self._folder / f"{key}.npz", buffer.getvalue())
        return made

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
        key = self.key(kind, problem, about)
        found = self.look(key)
        return self.keep(key, make()) if found is None else found

    def receive(self, files: Mapping[str, bytes]) -> None:
        """Keep files that another memory has sent: see `lent`."""
        if self._folder is not None:
            for name, content in files.items():
                write_atomically(self._folder / name, content)


def lent(work: Callable[..., object], memory: Memory, *call: Any) -> dict[str, bytes]:
    """Do work, in whatever process, for what it leaves in a memory.

    Parameters
    ----------
    work : callable
        Called with the memory and `call`.
    memory : Memory
    *call : objects

    Returns
    -------
    dict of str to bytes
        What it has left, where the memory's folder is on another machine; see `Memory.receive`.
    """
    if memory.within_reach:
        work(memory, *call)
        return {}
    with scratch() as folder:
        work(Memory(folder), *call)
        return {path.name: path.read_bytes() for path in sorted(folder.glob("*.npz"))}


def shared_out(
    work: Callable[..., Result],
    memory: Memory,
    things: Sequence[object],
    *,
    jobs: int,
    scheduler: str | None,
    progress: Callable[[int, int], None],
) -> list[Result]:
    """Results of work on each of some things, which other processes do first.

    Parameters
    ----------
    work : callable
        Called with the memory, which keeps what it finds, and one thing.
    memory : Memory
        In a folder.
    things : sequence
    jobs : int
    scheduler : str, optional
        As of `psafit.workers.precompute`.
    progress : callable
        Called with (things done, things).
    """
    memory.begin()
    calls = [(work, memory, thing) for thing in things]
    precompute(lent, calls, jobs, progress, scheduler=scheduler, take=memory.receive)
    found = []
    for k, thing in enumerate(things):
        progress(k, len(things))
        found.append(work(memory, thing))
    return found


def _sealed(arrays: Arrays) -> bytes:
    """What shows whether arrays are those that were kept."""
    found = hashlib.sha256()
    for name in sorted(arrays):
        a = np.ascontiguousarray(arrays[name])
        found.update(f"{name} {a.dtype.str} {a.shape}\n".encode() + a.tobytes())
    return found.digest()

"""Exceptions that carry the numbers needed to act on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class PsafitError(Exception):
    """Base of every error psafit raises on purpose; the command line turns it into one line."""

    def __reduce__(self) -> tuple[Any, ...]:
        # From a worker process as it was raised there: what __init__ was given is not what it says.
        return type(self).__new__, (type(self), *self.args), self.__dict__


class InputError(PsafitError):
    """Something the user gave cannot be used.

    Parameters
    ----------
    what : str
        What is wrong, with the offending value.
    remedy : str
        What to do about it.
    file : path-like, optional
        The file at fault.
    line : int, optional
        Line in that file, counted from 1.
    """

    def __init__(self, what: str, remedy: str, *, file: str | Path | None = None, line: int | None = None) -> None:
        self.what = what
        self.remedy = remedy
        self.file = None if file is None else Path(file)
        self.line = line
        place = "" if file is None else f"{file}: " if line is None else f"{file}:{line}: "
        # A hostile file name or cell must not break the promise of one line.
        text = f"{place}{what}; {remedy}"
        super().__init__(printable(text))

    @property
    def faults(self) -> tuple[InputError, ...]:
        """Each fault by itself."""
        return (self,)


class InputErrors(InputError):
    """Several faults of one input, a line each; `what`, `remedy`, `file` and `line` are those of the first.

    Parameters
    ----------
    faults : sequence of InputError
        Those that are named.
    more : int
        How many were found in addition to them.
    """

    def __init__(self, faults: Sequence[InputError], more: int = 0) -> None:
        first = faults[0]
        super().__init__(first.what, first.remedy, file=first.file, line=first.line)
        self._faults = tuple(faults)
        self.more = more
        self.args = ("\n".join([*map(str, faults), *([f"and {more} more"] if more else [])]),)

    @property
    def faults(self) -> tuple[InputError, ...]:
        """The faults that the message names, each by itself."""
        return self._faults


class Faults:
    """Collects faults that do not depend on each other, to raise them together; the same one twice counts once.

    Parameters
    ----------
    most : int
        Faults that are named; all others are counted.
    """

    def __init__(self, most: int = 10) -> None:
        self.most = most
        self._found: dict[str, InputError] = {}
        self._more = 0

    def __len__(self) -> int:
        return len(self._found) + self._more

    def add(self, fault: InputError, more: int = 0) -> None:
        """Keep a fault, or those that it consists of; `more` were found in addition."""
        self._found |= {str(one): one for one in fault.faults}
        self._more += more + (fault.more if isinstance(fault, InputErrors) else 0)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Keep a fault that ends the block."""
        try:
            yield
        except InputError as fault:
            self.add(fault)

    def end(self) -> None:
        """Raise what was kept, if anything, in the order of the lines of each file."""
        if not self._found:
            return
        files = list(dict.fromkeys(fault.file for fault in self._found.values()))
        found = sorted(self._found.values(), key=lambda fault: (files.index(fault.file), fault.line or 0))
        if len(self) == 1:
            raise found[0]
        raise InputErrors(found[: self.most], len(self) - len(found[: self.most]))


def printable(text: str) -> str:
    """Replace what would steer a terminal or break a line."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


class ConvergenceError(PsafitError):
    """An iteration ended before it met its criterion.

    Parameters
    ----------
    what : str
        The iteration.
    reached : float
        Where it stands.
    required : float
        Where it should be.
    """

    def __init__(self, what: str, *, reached: float, required: float) -> None:
        self.reached = reached
        self.required = required
        super().__init__(f"{what}: reached {reached:.4g}, required {required:.4g}")


LARGEST_SEED = 2**32 - 1
"""The largest seed that every random generator takes."""


def check_seed(seed: int) -> None:
    """Refuse a seed that no generator takes."""
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"seed {seed} is not from 0 to {LARGEST_SEED}", "give a whole number in that range")

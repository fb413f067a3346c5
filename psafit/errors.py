"""Exceptions that carry the numbers needed to act on them."""

from __future__ import annotations

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


def printable(text: str) -> str:
    """Replace what would steer a terminal or break a line."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


class ConvergenceError(PsafitError):
    """An iteration ended before it met its criterion.

    Parameters
    ----------
    what : str
        The iteration.
    reached, required : float
        Where it stands and where it should be.
    """

    def __init__(self, what: str, *, reached: float, required: float) -> None:
        self.reached = reached
        self.required = required
        super().__init__(f"{what}: reached {reached:.4g}, required {required:.4g}")


LARGEST_SEED = 2**32 - 1
"""Of those that every generator takes."""


def check_seed(seed: int) -> None:
    """Refuse a seed that no generator takes."""
    if not 0 <= seed <= LARGEST_SEED:
        raise InputError(f"seed {seed} is not from 0 to {LARGEST_SEED}", "give a whole number in that range")

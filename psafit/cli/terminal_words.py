"""Words of sentences in a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from psafit.diagnose.words import Words


class TerminalWords(Words):
    """Plain text, in which what excludes each other stands line by line.

    Parameters
    ----------
    experiment, options : str
        As of `Words`, as they are typed.
    """

    def __init__(self, experiment: str = Words.experiment, options: str = "") -> None:
        self.experiment, self.options = experiment, options

    def choices(self, items: Sequence[object]) -> str:
        """Return a line each; what follows begins another."""
        return "".join(f"\n    - {item}" for item in items) + "\n "

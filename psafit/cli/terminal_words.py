"""Words of sentences in a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from psafit.diagnose.words import Words


class TerminalWords(Words):
    """Plain text, in which what excludes each other stands line by line.

    Parameters
    ----------
    experiment : str
        The experiment's folder, as it is typed.
    """

    def __init__(self, experiment: str = Words.experiment) -> None:
        self.experiment = experiment

    def choices(self, items: Sequence[object]) -> str:
        """Return a line each; what follows begins another."""
        return "".join(f"\n    - {item}" for item in items) + "\n "

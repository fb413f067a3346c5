"""Words of sentences in a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from psafit.diagnose.words import Words


class TerminalWords(Words):
    """Plain text, in which what excludes each other stands line by line."""

    def choices(self, items: Sequence[object]) -> str:
        """Return a line each; what follows begins another."""
        return "".join(f"\n    - {item}" for item in items) + "\n "


TERMINAL = TerminalWords()

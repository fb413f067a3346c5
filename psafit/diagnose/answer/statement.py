"""What a diagnosis says is made of: one statement with its numbers, and the one sentence that says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from psafit.diagnose.words import Words

Topic = Literal["scope", "adequate", "wrong", "besides", "detail", "trust", "gained", "next", "searched"]
"""Part of the answer to which a statement belongs; a short answer does without what stands besides."""


@dataclass(frozen=True)
class Statement:
    """One thing that a diagnosis says."""

    topic: ClassVar[Topic]

    def say(self, words: Words) -> str:
        """The sentence, in the words of a page or of a terminal."""
        raise NotImplementedError

"""What a diagnosis says is made of: one statement with its numbers, and the one sentence that says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from psafit.diagnose.words import Words

Topic = Literal["scope", "adequate", "wrong", "detail", "trust", "gained", "next", "searched"]
"""Part of the answer to which a statement belongs."""


@dataclass(frozen=True)
class Statement:
    """One thing that a diagnosis says; `aside` where a short answer does without it."""

    topic: ClassVar[Topic]
    aside: ClassVar[bool] = False

    def say(self, words: Words) -> str:
        """The sentence, in the words of a page or of a terminal."""
        raise NotImplementedError

"""Choices: what was chosen for the stages, said at once and kept for the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field


@dataclass
class Choices:
    """Sentences by the name of the stage."""

    say: Callable[[str], None]
    """Receives each line."""
    by_stage: dict[str, str] = field(default_factory=dict)

    def choose(self, stage: str, text: str) -> None:
        """Keep a sentence, and say it."""
        self.by_stage[stage] = text
        self.say(text)

"""Promise: one expectation of gsfw, checked by a function, and the outcome of the check."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.testing.subject import Subject

RAISED = "Look at this line; pytest shows the whole traceback."
"""Remedy of an unexpected error, of which only the message is known."""


class BrokenPromise(AssertionError):
    """A part does not keep a promise: the observation, and the remedy."""

    def __init__(self, happened: str, change: str) -> None:
        super().__init__(f"{happened}\n{change}")
        self.happened = happened
        """The observation, as a sentence."""
        self.change = change
        """The remedy, as a sentence."""


class NotApplicable(Exception):
    """A promise does not concern this part, such as times for a static method."""


class Verdict(Enum):
    """Result of one check."""

    KEPT = "kept"
    BROKEN = "broken"
    NOT_APPLICABLE = "not applicable"


def require(condition: bool, happened: str, change: str) -> None:
    """Fail the check unless a condition holds.

    Raises:
        BrokenPromise: it does not hold.
    """
    if not condition:
        raise BrokenPromise(happened, change)


@dataclass(frozen=True)
class Promise:
    """One expectation of all parts of a kind."""

    name: str
    """Words with dashes, such as "resumes-to-the-same-bits"; unique within a kind."""
    sentence: str
    """The promise, in a sentence."""
    function: Callable[[Subject], None]
    """Raises ``BrokenPromise`` or ``NotApplicable``; any other error breaks the promise too."""
    is_required: bool = False
    """True if no other promise can be checked once this one is broken."""
    raised: str = RAISED
    """Remedy of an unexpected error."""

    def check(self, subject: Subject) -> Outcome:
        """Check the promise for one part; never raises."""
        started = time.perf_counter()
        outcome = Outcome(self, str(subject), Verdict.KEPT)
        try:
            self.function(subject)
        except NotApplicable as reason:
            outcome = replace(outcome, verdict=Verdict.NOT_APPLICABLE, happened=str(reason))
        except Exception as error:
            if isinstance(error, BrokenPromise):
                happened, change = error.happened, error.change
            else:
                happened, change = _told(error), self.raised
            outcome = Outcome(self, str(subject), Verdict.BROKEN, happened, change, error=error)
        return replace(outcome, seconds=time.perf_counter() - started)


@dataclass(frozen=True)
class Outcome:
    """Result of checking one promise for one part."""

    promise: Promise
    subject: str
    """The part: "method 'my-method' (gsfw-my-method 0.1)"."""
    verdict: Verdict
    happened: str = ""
    """The observation; the reason if the promise is not applicable; empty if it is kept."""
    change: str = ""
    """The remedy; empty unless the promise is broken."""
    seconds: float = 0.0
    error: BaseException | None = None
    """The error of a broken promise."""

    def __str__(self) -> str:
        """Three lines for a broken promise: what was promised, what happened, what to change."""
        if self.verdict is not Verdict.BROKEN:
            reason = f": {self.happened}" if self.happened else ""
            return f"{self.subject}: {self.promise.name}: {self.verdict.value}{reason}"
        return (
            f"{self.subject} breaks the promise {self.promise.name!r}.\n"
            f"  promised: {self.promise.sentence}\n"
            f"  happened: {self.happened}\n"
            f"  change:   {self.change}"
        )


def _told(error: BaseException) -> str:
    """An unexpected error as a sentence, with the innermost line of code."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    message = " ".join(str(error).split()) or "without a message"
    return f"{type(error).__name__}: {message}{place}"

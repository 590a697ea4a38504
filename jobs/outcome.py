"""Outcome: the end of a job."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Outcome:
    """The end of a job."""

    finished: bool
    """True if its work is done."""
    seconds: float
    """Since its process was started."""
    resumed: bool = False
    """True if it went on from a checkpoint, so that these are not all its seconds."""
    stopped: bool = False
    """True if it was asked to end; it continues from its checkpoint another time."""
    error: str = ""
    """Cause of a failure in a sentence; empty for none."""
    advice: str = ""
    """Remedy of a failure; may be empty."""
    resumable: bool = False
    """True if it was cut off from outside and can go on."""
    document: Mapping[str, Any] = field(default_factory=dict)
    """JSON document that the command line has printed; empty for none."""
    value: Any = None
    """The value that a finished call has returned."""

"""Edit: a change of what is edited, made from the text of its value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import SplatFile
from gsfw.editing.capture import Capture
from gsfw.editing.editable import Editable


@dataclass(frozen=True)
class Surroundings:
    """Functions that edits need besides their input."""

    read: Callable[[Path], SplatFile]
    """Reads a file of splats."""
    num_bytes: Callable[[Editable], int]
    """Size of the file that would be written, in bytes."""


@dataclass(frozen=True)
class Edited:
    """The result of an edit."""

    piece: Editable
    note: str = ""
    """Findings besides the number of Gaussians; empty for none."""


Edit = Callable[[Editable, Surroundings], Edited]


def keeping(rows: Callable[[Editable], Bool[Tensor, " n"]]) -> Edit:
    """The edit that keeps some rows."""
    return lambda piece, _: Edited(piece.keep(rows(piece)))


def real_capture(piece: Editable, name: str) -> Capture:
    """The capture, whose cameras somebody stood at.

    Raises:
        ConfigError: nobody did.
    """
    capture = piece.capture()
    if capture.invented:
        raise ConfigError(
            f"{name}: {capture.source} holds splats, and no cameras that saw them.",
            "Give a run that has them, in the same world: views=RUN",
        )
    return capture

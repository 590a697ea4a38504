"""Part state: the state of a part of a run in a checkpoint, and errors that name the part."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import torch

from gsfw.core.errors import UserError

LOADING_ERRORS = (LookupError, TypeError, ValueError, AttributeError, RuntimeError)
"""Errors of a part that gets a state of another form than its own."""


@runtime_checkable
class Stateful(Protocol):
    """A part of a run with a state."""

    def load_state_dict(self, state: Any, /) -> object:  # noqa: ANN401 - a form of its own
        """Continue from ``state``."""


class UnfitStateError(ValueError):
    """A state that does not fit its part; the message names the class of the part."""

    def __init__(self, part: Stateful, error: Exception) -> None:
        module = type(part).__module__.partition(".")[0]
        self.package = "" if module == "gsfw" else module
        """Package or module of the part if it is a plugin's; else empty."""
        origin = f" of {self.package}" if self.package else ""
        super().__init__(
            f"{type(part).__name__}{origin} cannot take its state: {type(error).__name__}: {error}"
        )


def load_part(part: Stateful, state: Any) -> None:  # noqa: ANN401 - a form of the part's own
    """Give a part the state that a checkpoint has for it.

    Raises:
        UnfitStateError: the state is not that of such a part.
        UserError: the part's own message.
        torch.OutOfMemoryError: memory is full.
    """
    try:
        part.load_state_dict(state)
    except (UserError, UnfitStateError, torch.OutOfMemoryError):
        raise
    except LOADING_ERRORS as error:
        raise UnfitStateError(part, error) from error

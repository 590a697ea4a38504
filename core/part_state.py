"""Part state: the state of a part of a run in a checkpoint, and errors that name the part."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Iterator, Mapping
from types import NoneType
from typing import Any, Protocol, runtime_checkable

import torch

from gsfw.core.errors import ConfigError, UserError

LOADING_ERRORS = (LookupError, TypeError, ValueError, AttributeError, RuntimeError)
"""Errors of a part that gets a state of another form than its own."""


PLAIN = frozenset(
    {NoneType, bool, int, float, complex, str, bytes, torch.device, torch.dtype, torch.Size}
)
"""Types of values that a checkpoint can hold besides tensors: those that torch reads without code.

Types derived from them, such as those of numpy's numbers, are not read."""
DICTIONARIES, SEQUENCES = frozenset({dict, OrderedDict, Counter}), frozenset({list, tuple, set})


@runtime_checkable
class Stateful(Protocol):
    """A part of a run with a state."""

    def state_dict(self) -> Mapping[str, Any]:
        """Tensors and plain data."""

    def load_state_dict(self, state: Any, /) -> object:  # noqa: ANN401 - a form of its own
        """Continue from ``state``."""


class UnfitStateError(ValueError):
    """A state that does not fit its part; the message names the class of the part."""

    def __init__(self, part: Stateful, error: Exception) -> None:
        self.package = _package(part)
        """Package or module of the part if it is a plugin's; else empty."""
        super().__init__(f"{_source(part)} cannot take its state: {type(error).__name__}: {error}")


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


def state_of(part: Stateful) -> dict[str, Any]:
    """The state of a part, for a checkpoint.

    Raises:
        ConfigError: it has a value that cannot be read from a checkpoint again; names its place.
    """
    found: object = part.state_dict()
    advice = (
        "Return tensors, numbers, text, and dictionaries and lists of these; make everything else "
        "anew in load_state_dict."
    )
    if not isinstance(found, Mapping):
        raise ConfigError(
            f"{_source(part)}: state_dict returned {type(found).__name__}, expected a dictionary.",
            advice,
        )
    state = dict(found)
    for place, value in _unreadable(state, ""):
        kind = type(value)
        name = (
            kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
        )
        raise ConfigError(
            f"{_source(part)}: state_dict has an object of the class {name} as {place}, which no "
            "checkpoint can hold.",
            advice,
        )
    return state


def _unreadable(value: object, place: str) -> Iterator[tuple[str, object]]:
    """Values that cannot be read again, with their places, such as ``['cache'][0]``."""
    if type(value) in DICTIONARIES:
        assert isinstance(value, dict)
        for key, item in value.items():
            inner = f"{place}[{key!r:.60}]"
            yield from _unreadable(key, f"a key of {place or 'the state'}")
            yield from _unreadable(item, inner)
    elif type(value) in SEQUENCES:
        assert isinstance(value, list | tuple | set)
        for index, item in enumerate(value):
            yield from _unreadable(item, f"{place}[{index}]")
    elif type(value) not in PLAIN and not isinstance(value, torch.Tensor):
        yield place, value


def _package(part: object) -> str:
    """Package or module of a part if it is a plugin's; else empty."""
    module = type(part).__module__.partition(".")[0]
    return "" if module == "gsfw" else module


def _source(part: object) -> str:
    """Class and package of a part."""
    package = _package(part)
    return f"{type(part).__name__} of {package}" if package else type(part).__name__

"""Named settings: a setting that is given as an argument of its own says where it belongs."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import ParamSpec, TypeVar

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import did_you_mean

Given = ParamSpec("Given")
Answer = TypeVar("Answer")


class ArgumentError(ConfigError, TypeError):
    """A function has no argument of this name."""


def without_settings_as_arguments(function: Callable[Given, Answer]) -> Callable[Given, Answer]:
    """Decorate a function whose argument ``settings`` takes all settings without an argument.

    Raises:
        ArgumentError: in place of Python's own error, which does not name ``settings``.
    """
    known = signature(function).parameters

    @wraps(function)
    def called(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
        unknown = {name: value for name, value in kwargs.items() if name not in known}
        if unknown:
            name = next(iter(unknown))
            raise ArgumentError(
                f"{function.__name__} has no argument {name!r}.{did_you_mean(name, known)}",
                f"If {name} is a setting, write settings={unknown!r}.",
            )
        return function(*args, **kwargs)

    return called

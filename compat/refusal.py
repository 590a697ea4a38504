"""Refusals: an argument that these interfaces do not serve is named, never ignored."""

from __future__ import annotations

from collections.abc import Mapping

from gsfw.api import ConfigError

ELSEWHERE = "Leave it out, or run this part of the code on the original package."


class UnservedArgument(ConfigError, TypeError):
    """A call has an argument that gsfw does not serve."""


def refuse(function: str, argument: str, advice: str = ELSEWHERE) -> UnservedArgument:
    """The error for one argument.

    Args:
        function: as its users write it.
        argument: its name, with the value where only some values are refused.
        advice: the next step of the user.
    """
    return UnservedArgument(f"{function}: gsfw.compat does not support {argument}.", advice)


def refuse_unknown(function: str, given: Mapping[str, object]) -> None:
    """Refuse arguments that a function has no parameter for.

    Args:
        function: as its users write it.
        given: the arguments, by name.

    Raises:
        UnservedArgument: there is one.
    """
    for name in given:
        raise refuse(function, name)

"""Checks of functions by the import hook of jaxtyping, at a small part of their usual price.

* Each function is checked in its first calls of each test. Further calls repeat themselves: finite
  differences, steps of a training.
* jaxtyping makes two empty functions for each of gsfw's: one is called with the arguments before
  the call, the other with the arguments and the result after it. The second need not look at the
  arguments again: the sizes that the first has found are still remembered.
* Most functions are never called by one worker's tests, so that the checks of a function are made
  when it is first called.
"""

import dataclasses
import functools
import types
from collections.abc import Callable
from typing import Any, ClassVar

import jaxtyping
from beartype import beartype

CHECKED_CALLS = 10
"""Calls that are checked, of one function in one test."""


class Checks:
    """The calls that the present test has checked, by the identity of the function's code.

    Functions within functions are made again at every call of the outer one: their code is the
    same. Codes are not keys themselves: those that two dataclasses have generated may be equal.
    """

    limit = CHECKED_CALLS
    calls: ClassVar[dict[int, int]] = {}

    @classmethod
    def start(cls, limit: int) -> None:
        """Begin a test that checks so many calls of each function."""
        cls.limit = limit
        cls.calls.clear()


_DECORATE = jaxtyping.jaxtyped


def jaxtyped(*, typechecker: Callable[..., Any]) -> Callable[[Any], Any]:
    """``jaxtyping.jaxtyped``, whose functions check some of their calls."""

    def decorate(defined: Any) -> Any:
        if isinstance(defined, types.FunctionType):
            return checked_at_first(defined, typechecker)
        if not isinstance(defined, type):
            return _DECORATE(defined, typechecker=typechecker)
        if dataclasses.is_dataclass(defined) and "__init__" in vars(defined):
            defined.__init__ = checked_at_first(defined.__init__, typechecker)
        return defined

    return decorate


jaxtyping.jaxtyped = jaxtyped  # The hook writes this name above every definition.


def checked_at_first(function: types.FunctionType, typechecker: Callable[..., Any]) -> Any:
    """Check the function in its first calls of each test."""
    code, calls = id(function.__code__), Checks.calls
    made: list[Callable[..., Any]] = []

    @functools.wraps(function)
    def called(*args: Any, **kwargs: Any) -> Any:
        count = calls.get(code, 0)
        if count >= Checks.limit:
            return function(*args, **kwargs)
        calls[code] = count + 1
        if not made:
            made.append(_DECORATE(function, typechecker=typechecker))
        return made[0](*args, **kwargs)

    return called


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check what a function is given, or what it returns where it says so.

    Args:
        function: made by jaxtyping from a signature; does nothing, or returns an argument.
    """
    annotations = function.__annotations__
    if annotations.get("return", Any) is not Any:
        function.__annotations__ = {"return": annotations["return"]}
    return beartype(function)

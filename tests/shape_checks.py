"""How the import hook of jaxtyping checks functions, at less than half the price of beartype alone.

jaxtyping makes two empty functions for each of gsfw's: one is called with the arguments before the
call, the other with the arguments and the result after it. The second need not look at the
arguments again: the sizes that the first has found are still remembered. Most functions are never
called by one worker's tests, so that the checks of a function are compiled when it is first called.
Functions within functions are made again at every call of the outer one, and with them their
checks: this takes longer than most of them do, so that it is left out where nothing is checked.
"""

from collections.abc import Callable
from typing import Any

import jaxtyping
from beartype import beartype

MOST_CHECKS = 5000
"""Of one test. Those that make more repeat themselves: finite differences, steps of a training."""


class Budget:
    """Checks that the present test has left; while tests are collected there is no end to them."""

    left = -1

    @classmethod
    def start(cls, checks: int) -> None:
        """Begin a test that may make so many checks, or none."""
        cls.left = checks
        jaxtyping.config.update("jaxtyping_disable", checks == 0)

    @classmethod
    def spend(cls) -> None:
        """Make one; after the last, calls go straight to their functions."""
        cls.left -= 1
        if cls.left == 0:
            jaxtyping.config.update("jaxtyping_disable", True)


_DECORATE = jaxtyping.jaxtyped


def jaxtyped(*, typechecker: Callable[..., Any]) -> Callable[[Any], Any]:
    """``jaxtyping.jaxtyped``, but for what functions define while nothing is checked."""

    def decorate(defined: Any) -> Any:
        inner = "<locals>" in getattr(defined, "__qualname__", "")
        unchecked = inner and jaxtyping.config.jaxtyping_disable
        return defined if unchecked else _DECORATE(defined, typechecker=typechecker)

    return decorate


jaxtyping.jaxtyped = jaxtyped  # The hook writes this name above every definition.


def checked(function: Callable[..., Any]) -> Callable[..., Any]:
    """Check what a function is given, or what it returns where it says so.

    Args:
        function: made by jaxtyping from a signature; does nothing, or returns an argument.
    """
    annotations = function.__annotations__
    if annotations.get("return", Any) is not Any:
        function.__annotations__ = {"return": annotations["return"]}
    compiled: list[Callable[..., Any]] = []

    def check(*args: Any, **kwargs: Any) -> Any:
        Budget.spend()
        if not compiled:
            compiled.append(beartype(function))
        return compiled[0](*args, **kwargs)

    return check

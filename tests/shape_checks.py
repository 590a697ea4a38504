"""How the import hook of jaxtyping checks a function, at half the price of beartype alone.

jaxtyping makes two empty functions for each of gsfw's: one is called with the arguments before the
call, the other with the arguments and the result after it. The second need not look at the
arguments again: the sizes that the first has found are still remembered. Most functions are never
called by one worker's tests, so that the checks of a function are compiled when it is first called.
"""

from collections.abc import Callable
from typing import Any

from beartype import beartype


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
        if not compiled:
            compiled.append(beartype(function))
        return compiled[0](*args, **kwargs)

    return check

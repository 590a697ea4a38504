"""Registration of KIND my-part.

Every command of gsfw imports this module: import nothing heavy here.
"""

from __future__ import annotations

from gsfw.api import Spec, hookimpl


@hookimpl
def gsfw_requires_api() -> str:
    """The versions of gsfw.api that this package is written for."""
    return ">=1.0,<2"


@hookimpl
def gsfw_parts() -> list[Spec]:
    """The KIND of this package."""
    return [
        Spec(
            "my-part",
            "SUMMARY",
            "my_part.TARGET",
            # TAGS
        )
    ]

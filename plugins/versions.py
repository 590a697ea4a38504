"""Versions: the version of the public interface, and the range of versions that a plugin asks for.

The policy is stated in ``gsfw.api``.
"""

from __future__ import annotations

from importlib import metadata

from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import Version

from gsfw.plugins.specs import PROJECT

API_VERSION = "1.0"
"""Version of gsfw.api: a new name raises the second number, a removed or changed one the first."""

TOO_OLD_FOR = (">=", ">", "==", "~=", "===")
"""Operators of ranges that a version may be too old for."""

EXAMPLE = '">=1.0,<2"'


class RangeError(ValueError):
    """A plugin asks for other versions of gsfw.api; a phrase without a period."""

    def __init__(self, reason: str, needs_newer: bool = False) -> None:
        super().__init__(reason)
        self.needs_newer = needs_newer
        """True if a newer gsfw has what the plugin asks for."""


def check_range(asked: object) -> str:
    """The range of API versions that a plugin asks for, such as ">=1.0,<2".

    Raises:
        RangeError: it is no range, or it does not allow this gsfw.
    """
    if not isinstance(asked, str):
        raise RangeError(f"its gsfw_requires_api returned {asked!r}, expected a text: {EXAMPLE}")
    try:
        allowed = SpecifierSet(asked)
    except InvalidSpecifier:
        raise RangeError(
            f"its gsfw_requires_api returned {asked!r}, expected a range such as {EXAMPLE}"
        ) from None
    if not allowed.contains(API_VERSION, prereleases=True):
        raise RangeError(
            f"it asks for gsfw.api {asked}, and gsfw {metadata.version(PROJECT)} has {API_VERSION}",
            any(
                item.operator in TOO_OLD_FOR
                and Version(item.version.removesuffix(".*")) > Version(API_VERSION)
                for item in allowed
            ),
        )
    return asked

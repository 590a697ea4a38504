"""TOML text: project files of plugins, and calibrations."""

from __future__ import annotations

import sys
from typing import Any


def parsed_toml(text: str) -> dict[str, Any]:
    """Read a TOML document.

    Raises:
        ValueError: the text is no TOML.
    """
    if sys.version_info >= (3, 11):
        import tomllib
    else:  # The same, as a package.
        import tomli as tomllib
    return tomllib.loads(text)

"""Spec records and hook markers: the requirements of a plugin's registration. Light to import."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import pluggy

PROJECT = "gsfw"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@dataclass(frozen=True)
class Spec:
    """A part that can be chosen by name."""

    name: str
    """Name on the command line: ``method=NAME``. Letters, digits, and "_.+-"."""
    description: str
    """One line, for lists."""
    target: str
    """Import string "package.module:Name" of the config class (or, for commands, the function)."""
    paper: str = ""
    """Citation, for lists; empty when there is none."""
    tags: frozenset[str] = frozenset()
    """Tags such as "static", "dynamic"."""
    distribution: str = PROJECT
    """Package of the part, or "from PLACE" for a part of GSFW_PLUGIN_PATH; set by discovery."""
    version: str = ""
    """Version of that package; empty for a part of GSFW_PLUGIN_PATH. Set by discovery."""
    requires_api: str = ""
    """Range of API versions that its plugin states; empty if it states none. Set by discovery."""

    def load(self) -> Any:  # noqa: ANN401 - whatever the slot holds
        """Import the target.

        Raises:
            ImportError: its module, or one that this imports, is missing.
            AttributeError: the module has no such name.
        """
        module, _, name = self.target.partition(":")
        return getattr(import_module(module), name)

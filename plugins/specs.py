"""Spec records and hook markers: all that a plugin's registration needs. Imports nothing heavy."""

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
    """One thing that can be chosen by name."""

    name: str
    """What the user types: ``method=NAME``."""
    description: str
    """One line, for lists."""
    target: str
    """Import string "package.module:Name" of the config class (or, for commands, the function)."""
    paper: str = ""
    """Citation, for lists; empty when there is none."""
    tags: frozenset[str] = frozenset()
    """Such as "static", "dynamic"."""
    distribution: str = PROJECT
    """Who brings it; filled in by discovery."""
    version: str = ""
    """Of that distribution; filled in by discovery."""

    def load(self) -> Any:  # noqa: ANN401 - whatever the slot holds
        """Import the target."""
        module, _, name = self.target.partition(":")
        return getattr(import_module(module), name)

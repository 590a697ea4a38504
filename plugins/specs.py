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
    """Name on the command line: ``method=NAME``."""
    description: str
    """One line, for lists."""
    target: str
    """Import string "package.module:Name" of the config class (or, for commands, the function)."""
    paper: str = ""
    """Citation, for lists; empty when there is none."""
    tags: frozenset[str] = frozenset()
    """Tags such as "static", "dynamic"."""
    distribution: str = PROJECT
    """Package of the part; set by discovery."""
    version: str = ""
    """Version of that package; set by discovery."""

    def load(self) -> Any:  # noqa: ANN401 - whatever the slot holds
        """Import the target."""
        module, _, name = self.target.partition(":")
        return getattr(import_module(module), name)

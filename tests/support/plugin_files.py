"""Plugins in files, found by GSFW_PLUGIN_PATH, in the process of the tests."""

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gsfw.plugins.plugin_path import VARIABLE
from gsfw.plugins.registry import installed

HEAD = "from gsfw.api import Spec, hookimpl\n\n"


def hook(name: str, body: str) -> str:
    """The source of one hook."""
    return f"@hookimpl\ndef {name}():\n    {body}\n\n"


@pytest.fixture
def plugin_path(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Sets GSFW_PLUGIN_PATH for one test; what it imports is forgotten afterwards."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)

    def use(*places: Path) -> None:
        monkeypatch.setenv(VARIABLE, os.pathsep.join(map(str, places)))
        installed.cache_clear()

    yield use
    monkeypatch.delenv(VARIABLE, raising=False)
    installed.cache_clear()
    for name in set(sys.modules) - before:
        if not name.startswith(("gsfw", "torch")):
            del sys.modules[name]

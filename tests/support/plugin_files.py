"""Plugins in files, found by GSFW_PLUGIN_PATH, in the process of the tests."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator
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
    before, used = set(sys.modules), set[str]()

    def use(*places: Path) -> None:
        used.update(str(place.parent) for place in places)
        monkeypatch.setenv(VARIABLE, os.pathsep.join(map(str, places)))
        installed.cache_clear()

    yield use
    monkeypatch.delenv(VARIABLE, raising=False)
    installed.cache_clear()
    for name in set(sys.modules) - before:
        # No library that they brought along: those with native code load once in a process.
        module = sys.modules[name]
        file, folders = getattr(module, "__file__", None), getattr(module, "__path__", None)
        files = [file, *(folders if isinstance(folders, Iterable) else ())]
        if any(str(path).startswith(tuple(used)) for path in files):
            del sys.modules[name]

"""Folders that are made once for all workers of a test session: runs, models, captures."""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

fcntl: ModuleType | None
try:
    import fcntl
except ImportError:  # Windows: each worker makes its own.
    fcntl = None


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """The folder that all workers of this session see; without xdist, that of the session."""
    base = factory.getbasetemp()
    alone = "PYTEST_XDIST_WORKER" not in os.environ or fcntl is None
    folder = (base if alone else base.parent) / "made_once"
    folder.mkdir(exist_ok=True)
    return folder


class MadeOnce:
    """Makes folders, each once for all workers; every worker gets a copy of its own."""

    def __init__(self, factory: pytest.TempPathFactory) -> None:
        """Take where temporary folders of this session go."""
        self._shared, self._factory = shared_folder(factory), factory
        self._copies: dict[str, Path] = {}

    def __call__(self, make: Callable[[Path], None], *key: str) -> Path:
        """This worker's copy of a folder; tests must not change it.

        Args:
            make: fills the folder at a path where nothing is yet; called by the first worker.
            key: all that decides about the content. The first word names the folder.
        """
        name = f"{key[0]}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}"
        if name not in self._copies:
            copy = self._factory.mktemp(key[0]) / key[0]
            shutil.copytree(self._made(name, make), copy)
            self._copies[name] = copy
        return self._copies[name]

    def _made(self, name: str, make: Callable[[Path], None]) -> Path:
        path, unfinished = self._shared / name, self._shared / f"{name}-unfinished"
        with _alone(self._shared / f"{name}.lock"):
            if not path.exists():
                shutil.rmtree(unfinished, ignore_errors=True)  # The one that failed before.
                make(unfinished)
                unfinished.rename(path)
        return path


@contextmanager
def _alone(lock: Path) -> Iterator[None]:
    """Wait for the worker that holds the lock."""
    with lock.open("w") as handle:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield

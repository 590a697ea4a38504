"""Journal: which stages of a preparation are finished, so that the same command continues.

A stage is the same as before when its settings are, and those of all stages before it. Where they
are not, what it and all later ones have left is removed before it starts again.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, parsed_json

SCHEMA = 1
"""Number of the file's layout; a file of another number is as good as none."""

Document = dict[str, Any]
"""Plain data."""


ENTRY = {"key": str, "finished": bool, "seconds": int | float, "result": dict}
"""Facts that the file states of each stage, with their types."""


class Journal:
    """The stages, in the order in which they are asked for."""

    def __init__(self, path: Path) -> None:
        """Read the file; one that is missing or damaged knows of no stage."""
        self._path = path
        self._stages = _read(path)
        self._key = f"gsfw prepare {SCHEMA}"
        self._asked: list[str] = []

    @property
    def seconds(self) -> dict[str, float]:
        """Duration of each finished stage in seconds, over all runs."""
        return {
            name: self._stages[name]["seconds"]
            for name in self._asked
            if self._stages[name]["finished"]
        }

    def stage(
        self,
        name: str,
        settings: Mapping[str, Any],
        make: Callable[[], Document],
        clear: Callable[[], None] = lambda: None,
        is_there: Callable[[Document], bool] = lambda result: True,
    ) -> Document:
        """The result of a stage, made only where it is not there.

        Args:
            name: unique among the stages.
            settings: plain data that the result depends on, besides the stages before.
            make: does the work, going on with what an interrupted run left; its result is plain
                data.
            clear: removes what the stage left under other settings.
            is_there: whether the files that a finished stage has left are still there, by its
                result.

        Raises:
            OutputError: the journal cannot be written.
        """
        content = json.dumps([self._key, name, settings], sort_keys=True, default=str)
        self._key = hashlib.sha256(content.encode()).hexdigest()
        self._asked.append(name)
        entry = self._stages.get(name)
        if (
            entry is None
            or entry["key"] != self._key
            or (entry["finished"] and not is_there(entry["result"]))
        ):
            clear()
            self._stages = {known: self._stages[known] for known in self._asked[:-1]}
            entry = {"key": self._key, "finished": False, "seconds": 0.0, "result": {}}
            self._stages[name] = entry
            self._write()
        if not entry["finished"]:
            start = time.perf_counter()
            try:
                entry["result"] = parsed_json(json_text(make()))
                entry["finished"] = True
            finally:
                entry["seconds"] += time.perf_counter() - start
                self._write()
        result: Document = entry["result"]
        return result

    def _write(self) -> None:
        document = {"schema": SCHEMA, "stages": self._stages}
        write_atomically(self._path, json_text(document, indent=1).encode())


def identity_of(path: Path) -> list[Any]:
    """Identity of a file's content, as plain data."""
    status = path.stat()
    return [str(path.resolve()), status.st_size, status.st_mtime_ns]


def short_key(identity: list[Any]) -> str:
    """A name, unique in practice, for files made of a file: 24 hexadecimal digits.

    Args:
        identity: ``identity_of`` the file, and all else that the made files depend on.
    """
    return hashlib.blake2b(repr(identity).encode(), digest_size=12).hexdigest()


def _read(path: Path) -> dict[str, Document]:
    """The stages of a file that are whole."""
    try:
        document = parsed_json(path.read_text("utf-8"))
        stages = dict(document["stages"]) if document["schema"] == SCHEMA else {}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return {name: entry for name, entry in stages.items() if _is_whole(entry)}


def _is_whole(entry: object) -> bool:
    return isinstance(entry, dict) and all(
        isinstance(entry.get(name), kind) and (kind is bool or not isinstance(entry[name], bool))
        for name, kind in ENTRY.items()
    )

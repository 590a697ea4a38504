"""Final outputs: what a command has left in a folder, without times, to compare bit for bit."""

from __future__ import annotations

import csv
import hashlib
import json
import re
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import torch

from gsfw.core.files.folder_lock import CLAIM, LOCK
from gsfw.core.loop.checkpoint_file import read_checkpoint

TIMES = re.compile(
    r"seconds|_ms|_mb|^(date|commit|when|readings|parallel|on_front|recommended|command|text|findings|remarks)$"
)
"""Keys of plain data that hold times, memory, or what follows from them."""

ONLY_THERE = re.compile(
    r"(report\.html|report/.*|log\.txt|.*\.png|.*stages\.json|work/features\.jsonl"
    r"|work/database\.db.*|work/models/.*)$"
)
"""Files that hold times, or another program's own; they only have to be there."""

NUMBERED = re.compile(r"(.*tb/|.*work/log/)(.*/)?(events\.out\.tfevents|colmap-).*")
"""Event files of TensorBoard, and COLMAP's logs: a command that goes on has one more."""

CHECKPOINT = re.compile(r"(.*checkpoints/)step_\d+\.pt$")


def final_outputs(folder: Path) -> dict[str, Any]:
    """Content of each file below a folder, by its relative path.

    Returns:
        Plain data of JSON, states of checkpoints, digests of the other files.
    """
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_dir() or path.name in (LOCK, CLAIM):
            continue
        if several := NUMBERED.match(name):
            found[several[1]] = "there"
        else:
            found[name] = _content(path, name)
    return found


def differences(expected: Mapping[str, Any], found: Mapping[str, Any]) -> Iterator[str]:
    """Sentences on the files that differ.

    A run that was stopped may have another checkpoint in place of one before the last, and one
    more: a kill may come before an old one is removed.
    """
    last = {folder[1]: name for name in sorted(expected) if (folder := CHECKPOINT.match(name))}

    def earlier(names: Iterable[str], others: Container[str]) -> list[str]:
        """Checkpoints before the last one of their folder, which others lack."""
        numbered = [name for name in names if name not in others and CHECKPOINT.match(name)]
        return [name for name in numbered if name < last.get(CHECKPOINT.sub(r"\1", name), "")]

    more, fewer = earlier(found, expected), earlier(expected, found)
    ignored = {*more, *fewer[: len(more)]}
    for name in sorted((expected.keys() | found.keys()) - ignored):
        if name not in found:
            yield f"{name} is missing"
        elif name not in expected:
            yield f"{name} is left behind"
        elif expected[name] != found[name]:
            yield f"{name} differs at {_where(expected[name], found[name])}"


def negative_times(folder: Path) -> Iterator[str]:
    """Names of the negative times in the JSON files below a folder."""
    for path in sorted(folder.rglob("*.json*")):
        for line in (
            path.read_text().splitlines() if path.suffix == ".jsonl" else [path.read_text()]
        ):
            for key, value in _numbers(json.loads(line)):
                if value < 0 and re.search(r"seconds|_ms", key):
                    yield f"{path.relative_to(folder)}: {key}"


def _numbers(value: Any, key: str = "") -> Iterator[tuple[str, float]]:  # noqa: ANN401
    if isinstance(value, dict):
        for name, item in value.items():
            yield from _numbers(item, name)
    elif isinstance(value, list):
        for item in value:
            yield from _numbers(item, key)
    elif isinstance(value, int | float):
        yield key, value


def _where(expected: object, found: object) -> str:
    """The first place in plain data that differs."""
    keys: list[Any] = []
    if isinstance(expected, dict) and isinstance(found, dict):
        keys = sorted(expected.keys() | found.keys(), key=str)
    elif isinstance(expected, list) and isinstance(found, list) and len(expected) == len(found):
        keys = list(range(len(expected)))
    for key in keys:
        if isinstance(expected, dict) and isinstance(found, dict):
            one, other = expected.get(key), found.get(key)
        else:
            one, other = expected[key], found[key]  # type: ignore[index]
        if one != other:
            return f".{key}{_where(one, other)}"
    return f": {str(expected)[:80]} is {str(found)[:80]}"


def _content(path: Path, name: str) -> Any:  # noqa: ANN401 - plain data
    if ONLY_THERE.match(name) or ONLY_THERE.search(f"/{name}"):
        return "there"
    read = READERS.get(path.suffix)
    return hashlib.sha256(path.read_bytes()).hexdigest() if read is None else read(path)


def _state(path: Path) -> dict[str, str]:
    state = read_checkpoint(path)
    return {key: _digest(value) for key, value in state.items() if key != "train_seconds"}


def _rows(path: Path) -> Any:  # noqa: ANN401
    with path.open(newline="") as file:
        return [_timeless(row) for row in csv.DictReader(file)]


READERS: Mapping[str, Callable[[Path], Any]] = {
    ".pt": _state,
    ".csv": _rows,
    ".json": lambda path: _timeless(json.loads(path.read_text())),
    ".jsonl": lambda path: [_timeless(json.loads(x)) for x in path.read_text().splitlines()],
    ".md": lambda path: [x for x in path.read_text().splitlines() if not x.startswith("- gsfw ")],
}
"""Part of a file that is compared, by suffix; of other files all bytes are."""


def _timeless(value: Any) -> Any:  # noqa: ANN401 - plain data
    if isinstance(value, dict):
        return {key: _timeless(item) for key, item in value.items() if not TIMES.search(key)}
    return [_timeless(item) for item in value] if isinstance(value, list) else value


def _digest(value: object) -> str:
    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(part)
    return digest.hexdigest()


def _parts(value: object) -> Iterator[bytes]:
    if isinstance(value, torch.Tensor):
        yield f"{value.dtype}{tuple(value.shape)}".encode()
        yield value.contiguous().numpy().tobytes()
    elif isinstance(value, Mapping):
        for key in value:
            yield repr(key).encode()
            yield from _parts(value[key])
    elif isinstance(value, list | tuple):
        for item in value:
            yield b","
            yield from _parts(item)
    else:
        yield repr(value).encode()

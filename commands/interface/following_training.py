"""Training that follows a preparation: `gsfw prepare photos out=scene train=true minutes=3`.

Words before ``train=true`` are for ``gsfw prepare``, and words after it for ``gsfw train``. All of
them are checked before the first image is read.
"""

from __future__ import annotations

import hashlib
import os
import shlex
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

from gsfw.commands.interface.arguments import (
    Arguments,
    full_key,
    layers,
    parse,
    read_options,
)
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.prepare_options import PrepareOptions
from gsfw.commands.interface.progress import load_torch
from gsfw.core.errors import ConfigError, OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text, parsed_json
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import shell_argument

RUN = "run"
"""Folder of the training, in that of the data set."""
SIZE = "downscale"
"""The suggested setting that a run chooses for itself if it ends in a time."""
PLACES = ("data", "out")
"""Settings whose words differ for the same run: the record goes by its path and by the data."""
VIEWER = "callbacks.viewer."
"""Beginning of settings that change how a run is shown, and not the run."""
METHOD = "3dgs"
"""Method that settings are checked with as long as the data set suggests none."""
DATA = ("sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin", "transforms.json")
"""Files that differ when a data set does."""
ORDER = (
    "Keys of gsfw prepare stand before train=true, those of gsfw train after it: see "
    "gsfw prepare --help and gsfw train method=3dgs --help."
)
KEYS = {item.name for item in fields(PrepareOptions)}
"""Keys of ``gsfw prepare``."""
BEFORE = "Keys of gsfw prepare stand before train=true: gsfw prepare --help"

Verb = Callable[[list[str]], int]


def split(tokens: Sequence[str]) -> tuple[list[str], list[str] | None]:
    """The words up to ``train=true``, and those after it; ``None`` without it.

    Raises:
        ConfigError: its value is neither true nor false.
    """
    for place, token in enumerate(tokens):
        end = place + 1 if token.startswith(("train=", "--train=")) else 0
        end = place + 2 if token == "--train" else end
        if end and parse(tokens[:end]).flag("train"):
            return list(tokens[:end]), list(tokens[end:])
    return list(tokens), None


def read_both(tokens: Sequence[str]) -> tuple[PrepareOptions, list[str] | None]:
    """The options of ``gsfw prepare``, and the words for ``gsfw train``, if any.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: as of ``read_options``; says where keys of the two commands belong.
    """
    own, following = split(tokens)
    try:
        options = read_options("prepare", PrepareOptions, own)
    except ConfigError as error:
        if parse(own).values.keys() <= {"help", *KEYS}:
            raise
        raise ConfigError(error.message, ORDER) from None
    if following is not None:
        _check(parse(following))
    return options, following


def _check(arguments: Arguments) -> None:
    """Check what is meant for the training.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: a key is unknown, or a value wrong.
    """
    from gsfw.commands.train import read_settings
    from gsfw.planning.asked import asked_of
    from gsfw.plugins.registry import installed

    load_torch()
    if arguments.words:
        raise ConfigError(f"{arguments.words[0]!r} after train=true is not key=value.", ORDER)
    if "data" in arguments.values:
        raise ConfigError(
            "data= after train=true: the data set is the one that is prepared.", "Leave it out."
        )
    try:
        chosen = _given(arguments)
        usual = (("method", METHOD), ("datamanager", "colmap"))
        added = [pair for pair in usual if pair[0] not in chosen]  # They would override a file.
        given = Arguments((), (*added, *arguments.pairs))
        asked_of(read_settings(given, installed()), layers(given))
    except ConfigError as error:
        if arguments.values.keys() & KEYS - {"out", "json", "debug"}:
            raise ConfigError(error.message, ORDER) from None
        raise ConfigError(error.message, f"{error.advice}\n{BEFORE}".strip()) from None


def method_for_motion(words: Sequence[str]) -> str:
    """The method of words for ``gsfw train`` if it trains on images with times alone; else empty.

    Raises:
        ConfigError: a file of settings cannot be read, or there is no such method.
    """
    from gsfw.plugins.registry import installed

    named = [layer.values["method"] for layer in layers(parse(words)) if "method" in layer.values]
    if not named:
        return ""
    spec = installed().find("method", str(named[-1]))
    return spec.name if "dynamic" in spec.tags and "static" not in spec.tags else ""


def _given(arguments: Arguments) -> set[str]:
    """Keys of settings that were typed, or are in a file that was typed as ``config=FILE``.

    Raises:
        ConfigError: a file cannot be read, or keys contradict each other.
    """
    from gsfw.planning.asked import spelled_out

    return {key for layer in spelled_out(layers(arguments)) for key in layer.values}


@dataclass(frozen=True)
class FollowingTraining:
    """The training of a prepared data set, once."""

    data: Path
    """The folder of the data set."""
    words: tuple[str, ...]
    """Words that were typed for ``gsfw train``."""
    suggested: Mapping[str, str]
    """Settings that the check of the data set suggests, and its path."""

    @property
    def run(self) -> Path:
        """The folder of the training."""
        out = parse(self.words).values.get("out")
        return Path(out) if out else self.data / RUN

    @property
    def command(self) -> list[str]:
        """The words for ``gsfw train``.

        The suggested size of images is left out: a run that ends in a time chooses its own.
        """
        typed = parse(self.words)
        given = _given(typed) - {"data"}  # That of a file is another run's.
        left_out = {*given, SIZE} if _ends_in_a_time(given) else given
        usual = [f"{key}={text}" for key, text in self.suggested.items() if key not in left_out]
        out = [] if "out" in typed.values else [f"out={self.run}"]
        return [*usual, *out, *self.words]

    def train(self, start: Verb, go_on: Verb, console: Console) -> int:
        """Train, or go on with what was interrupted, or say that it is done.

        Args:
            start: ``gsfw train``.
            go_on: ``gsfw resume``.
            console: to say what is done.

        Raises:
            OutputError: the folder of the run holds another one.
        """
        folder = RunFolder(self.run)
        console.say(f"\ntraining: gsfw train {shlex.join(self.command)}")
        if parse(self.words).flag("dry_run"):
            return start(self.command)
        if not folder.config.is_file():
            write_atomically(self._record, json_text(self._identity()).encode())
            return start(self.command)
        if not self._record.is_file():
            raise OutputError(
                f"{self.run} is a run, and {self._record}, which says what it was trained with, is "
                "missing: this command cannot continue it.",
                f"gsfw resume {shell_argument(self.run)} continues a run that is not finished. "
                "For a new one give another folder (out=DIR after train=true), or remove this "
                "one; the data set is done.",
            )
        if not self._is_same():
            raise OutputError(
                f"{self.run} was trained with other settings, or on an earlier data set.",
                "Give another folder (out=DIR after train=true), or remove this one; the data set "
                "is done.",
            )
        if not folder.is_finished:
            return go_on([str(self.run), *self._shown(console)])
        if folder.splats.is_file():
            console.say(f"{self.run} is finished already: {folder.splats}")
        else:
            run = shell_argument(self.run)
            console.say(
                f"{self.run} is finished already, but has no {folder.splats.name}. "
                f"Write it with: gsfw export {run}"
            )
        console.result({"run": str(self.run), "completed": True})
        return 0

    def _shown(self, console: Console) -> list[str]:
        """Words that say how a run is shown, for ``gsfw resume``."""
        pairs = parse(self.words).pairs
        viewer = [f"{key}={text}" for key, text in pairs if full_key(key).startswith(VIEWER)]
        return [*viewer, *(["json=true"] if console.json_only else [])]

    @property
    def _record(self) -> Path:
        """The identity of this run, by its path from the data set."""
        path = os.path.relpath(self.run.resolve(), self.data.resolve())
        name = hashlib.sha256(path.encode()).hexdigest()[:16]
        return self.data / "work" / f"training_{name}.json"

    def _identity(self) -> dict[str, object]:
        """Settings and data of the training, as plain data: equal if another start does the same.

        The order and form of the words does not count.
        """
        from gsfw.plugins.values import as_text

        content = hashlib.sha256()
        for path in (self.data / name for name in DATA):
            content.update(path.read_bytes() if path.is_file() else b"none")
        settings = {
            key: as_text(value)
            for layer in layers(parse(self.command))
            for key, value in layer.values.items()
            if key not in PLACES and not key.startswith(VIEWER)
        }
        return {"settings": settings, "data": content.hexdigest()}

    def _is_same(self) -> bool:
        try:
            return bool(parsed_json(self._record.read_text("utf-8")) == self._identity())
        except (OSError, ValueError):
            return False


def _ends_in_a_time(given: Collection[str]) -> bool:
    """True if a run with these settings is planned, as ``planning.asked.asked_of`` says."""
    from gsfw.planning.asked import LENGTHS
    from gsfw.plugins.settings import PLANNED_BY

    if "steps" in given or "pace" in given:
        return "until" in given and "pace" not in given
    return not set(PLANNED_BY).isdisjoint(given) or set(LENGTHS).isdisjoint(given)

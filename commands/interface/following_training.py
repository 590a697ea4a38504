"""Training that follows a preparation: `gsfw prepare photos out=scene train=true minutes=3`.

What stands before ``train=true`` is for ``gsfw prepare``, and what stands after it for ``gsfw
train``. All of it is checked before the first image is read.
"""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from gsfw.commands.interface.arguments import Arguments, Options, layers, parse, read
from gsfw.commands.interface.console import Console
from gsfw.core.errors import ConfigError, OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.files.json_text import json_text
from gsfw.core.loop.run_folder import RunFolder

RUN = "run"
"""Folder of the training, in that of the data set."""
METHOD = "3dgs"
"""Method that settings are checked with as long as the data set suggests none."""
DATA = ("sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin", "transforms.json")
"""Files that differ when a data set does."""
ORDER = (
    "Keys of gsfw prepare stand before train=true, those of gsfw train after it: see "
    "gsfw prepare --help and gsfw train method=3dgs --help."
)
BEFORE = "Keys of gsfw prepare stand before train=true: gsfw prepare --help"

Verb = Callable[[list[str]], int]
VerbOptions = TypeVar("VerbOptions", bound=Options)


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


def read_both(
    verb: str, kind: type[VerbOptions], tokens: Sequence[str]
) -> tuple[VerbOptions, list[str] | None]:
    """The options of a verb, and the words for ``gsfw train``, if any.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: as of ``read``; says where keys of the two commands belong.
    """
    own, following = split(tokens)
    try:
        options = read(verb, kind, own)
    except ConfigError as error:
        if parse(own).values.keys() <= {"help", *_names(kind)}:
            raise
        raise ConfigError(error.message, ORDER) from None
    if following is not None:
        _check(parse(following), _names(kind))
    return options, following


def _names(kind: type[Options]) -> set[str]:
    return {item.name for item in fields(kind)}


def _check(arguments: Arguments, of_prepare: set[str]) -> None:
    """Check what is meant for the training.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: a key is unknown, or a value wrong.
    """
    from gsfw.commands.train import read_settings
    from gsfw.planning.asked import asked_of
    from gsfw.plugins.registry import installed

    if arguments.words:
        raise ConfigError(f"{arguments.words[0]!r} after train=true is not key=value.", ORDER)
    if "data" in arguments.values:
        raise ConfigError(
            "data= after train=true: the data set is the one that is prepared.", "Leave it out."
        )
    given = Arguments((), (("method", METHOD), ("datamanager", "colmap"), *arguments.pairs))
    try:
        asked_of(read_settings("train", given, installed()), layers(given))
    except ConfigError as error:
        if arguments.values.keys() & of_prepare - {"out", "json", "debug"}:
            raise ConfigError(error.message, ORDER) from None
        raise ConfigError(error.message, f"{error.advice}\n{BEFORE}".strip()) from None


@dataclass(frozen=True)
class FollowingTraining:
    """The training of a prepared data set, once."""

    data: Path
    """The folder of the data set."""
    words: tuple[str, ...]
    """Words that were typed for ``gsfw train``."""
    suggested: str
    """The command that the check of the data set suggests."""

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
        typed = parse(self.words).values
        usual = [word for word in shlex.split(self.suggested)[2:] if not _gives(word, typed)]
        if "steps" not in typed and "preset" not in typed:
            usual = [word for word in usual if not word.startswith("downscale=")]
        out = [] if "out" in typed else [f"out={self.run}"]
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
        if not folder.config.is_file():
            self._remember()
            return start(self.command)
        if not self._is_same():
            raise OutputError(
                f"{self.run} was trained with other settings, or on an earlier data set.",
                "Give another folder (out=DIR after train=true), or remove this one; the data set "
                "is done.",
            )
        if not folder.summary.is_file():
            return go_on([str(self.run), *(["json=true"] if console.json_only else [])])
        console.say(f"{self.run} is finished already: {folder.splats}")
        console.result({"run": str(self.run), "completed": True})
        return 0

    @property
    def _record(self) -> Path:
        return self.data / "work" / "training.json"

    def _identity(self) -> dict[str, object]:
        """Command and data of the training, as plain data."""
        content = hashlib.sha256()
        for path in (self.data / name for name in DATA):
            content.update(path.read_bytes() if path.is_file() else b"none")
        return {"command": self.command, "data": content.hexdigest()}

    def _remember(self) -> None:
        write_atomically(self._record, json_text(self._identity()).encode())

    def _is_same(self) -> bool:
        try:
            return bool(json.loads(self._record.read_text("utf-8")) == self._identity())
        except (OSError, ValueError):
            return False


def _gives(word: str, typed: Collection[str]) -> bool:
    """True if a suggested setting is among those that were typed."""
    return word.partition("=")[0] in typed

"""Arguments: ``key=value``, ``--key value`` and bare words in any order, read into options."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from gsfw.core.config import replace_at
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import check_ranges, number

if TYPE_CHECKING:
    from gsfw.commands.interface.detail import Detail
    from gsfw.plugins.settings import Layer

FLAGS = ("help", "json", "debug", "dry_run")
"""Keys of flags for every verb: true as ``--key`` alone."""

_PAIR = re.compile(r"(?:--)?([A-Za-z_][\w.\-]*)=(.*)", re.DOTALL)
_OPTION = re.compile(r"--([A-Za-z_][\w.\-]*)")


class HelpRequested(Exception):
    """``--help`` was given; carries the help text, and the options that it explains."""

    def __init__(self, text: str, options: tuple[type[Options], ...] = ()) -> None:
        super().__init__(text)
        self.options = options


@dataclass(frozen=True)
class Arguments:
    """The words after the verb."""

    words: tuple[str, ...]
    """Words that are neither keys nor values, such as RUN."""
    pairs: tuple[tuple[str, str], ...]
    """Keys (with underscores) and texts, in order."""

    @property
    def values(self) -> Mapping[str, str]:
        """Texts by key; the last one of a repeated key."""
        return dict(self.pairs)

    def flag(self, name: str) -> bool:
        """True if a flag is on.

        Raises:
            ConfigError: its value is neither true nor false.
        """
        text = self.values.get(name, "false").lower()
        if text not in ("true", "1", "yes", "on", "false", "0", "no", "off"):
            raise ConfigError(f"{name}={text}: expected true or false, found {text!r}.")
        return text in ("true", "1", "yes", "on")


def parse(tokens: Sequence[str]) -> Arguments:
    """Separate keys, values and words; after ``--`` all are words.

    Raises:
        ConfigError: ``--key`` is not followed by a value.
    """
    words: list[str] = []
    pairs: list[tuple[str, str]] = []
    remaining = list(tokens)
    while remaining:
        token = "--help" if remaining[0] == "-h" else remaining[0]
        del remaining[0]
        if token == "--":
            words += remaining
            break
        if pair := _PAIR.fullmatch(token):
            pairs.append((_key(pair[1]), expanded(pair[2])))
        elif option := _OPTION.fullmatch(token):
            key = _key(option[1])
            if key in FLAGS:
                pairs.append((key, "true"))
            elif not remaining or _OPTION.match(remaining[0]):
                raise ConfigError(f"{token}: a value is missing.", f"Write {key}=VALUE.")
            else:
                pairs.append((key, expanded(remaining.pop(0))))
        else:
            words.append(token)
    return Arguments(tuple(words), tuple(pairs))


def _key(text: str) -> str:
    return text.replace("-", "_")


def expanded(text: str) -> str:
    """Expand ``~/`` after a key, since most shells do not."""
    return str(Path(text).expanduser()) if text == "~" or text.startswith("~/") else text


def layers(arguments: Arguments) -> list[Layer]:
    """Layers of the given settings: each ``config=FILE``, then the command line.

    Raises:
        ConfigError: a word is no ``key=value``, or a file cannot be read.
    """
    from gsfw.plugins.config_file import read_config
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    files = [read_config(Path(text)) for key, text in arguments.pairs if key == "config"]
    typed = {
        full_key(key): text for key, text in arguments.pairs if key != "config" and key not in FLAGS
    }
    return [*files, Layer(COMMAND_LINE, typed)]


def full_key(key: str) -> str:
    """The dotted key of a setting; the viewer's have short forms: ``viewer``, ``viewer.port``."""
    head, _, rest = key.partition(".")
    return f"callbacks.viewer.{rest or 'enabled'}" if head == "viewer" else key


def changed_place(data: str, device: str) -> Layer | None:
    """A run's data set and device, where they differ from its own; ``None`` for none."""
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    given = {key: text for key, text in (("data", data), ("device", device)) if text}
    return Layer(COMMAND_LINE, given) if given else None


def positional(name: str, default: str | None = None) -> Any:  # noqa: ANN401 - a dataclass field
    """An option as a bare word; required, unless it has a default."""
    metadata = {"word": name}
    if default is None:
        return field(metadata=metadata)
    return field(default=default, metadata=metadata)


def positionals(name: str, least: int = 1) -> Any:  # noqa: ANN401 - a dataclass field
    """An option as ``least`` or more bare words, after all other words of its verb."""
    return field(default=(), metadata={"word": name, "many": True, "least": least})


@dataclass(kw_only=True)
class Options:
    """Options of a verb; the docstring's first line is the summary of the verb.

    A verb derives from it (``@dataclass(kw_only=True)``). A field is an option KEY=VALUE, whose
    docstring is its help; ``positional`` makes it a bare word, ``number`` bounds it.
    """

    examples: ClassVar[tuple[str, ...]] = ()
    """Command lines for the help."""

    json: bool = False
    """Print one JSON document on standard output, and nothing else there."""
    debug: bool = False
    """Show the traceback of an error."""


VerbOptions = TypeVar("VerbOptions", bound=Options)


def read_options(verb: str, kind: type[VerbOptions], tokens: Sequence[str]) -> VerbOptions:
    """Parse the options of a verb without settings of a method.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: a key is unknown, a value has the wrong type or is out of its range, a word is
            missing or too many.
    """
    from gsfw.commands.interface.help import options_help

    arguments = parse(tokens)
    if arguments.flag("help"):
        raise HelpRequested(options_help(verb, kind), (kind,))
    places = [item for item in fields(kind) if "word" in item.metadata]
    given = _placed(verb, kind, arguments.words)
    for item in places[len(given) :]:
        required = item.default is MISSING or item.metadata.get("least", 0) > 0
        if required and item.name not in arguments.values:
            raise ConfigError(
                f"gsfw {verb}: {item.metadata['word']} is missing.", f"See gsfw {verb} --help."
            )
        if item.default is MISSING:
            given[item.name] = ""
    options = _with_values(verb, kind(**given), arguments.values)
    check_ranges(options)
    return options


def _placed(verb: str, kind: type[Options], found: Sequence[Any]) -> dict[str, Any]:
    """Assign bare words to the names of their options.

    Raises:
        ConfigError: there are too many words.
    """
    places = [item for item in fields(kind) if "word" in item.metadata]
    if places and places[-1].metadata.get("many") and len(found) >= len(places):
        found = [*found[: len(places) - 1], tuple(found[len(places) - 1 :])]
    for extra in found[len(places) :]:
        raise ConfigError(*_stray_word(verb, kind, extra))
    return dict(zip([item.name for item in places], found, strict=False))


def _with_values(verb: str, options: VerbOptions, values: Mapping[str, str]) -> VerbOptions:
    from gsfw.plugins.keys import keys, suggest_key
    from gsfw.plugins.values import describe
    from gsfw.plugins.values import parse as parse_value

    known = {key.name: key for key in keys(options)}
    for name, text in values.items():
        if name == "help":
            continue
        if name not in known:
            raise ConfigError(
                f"gsfw {verb}: unknown key {name!r}.{suggest_key(name, known)}",
                f"All keys: gsfw {verb} --help",
            )
        try:
            options = replace_at(options, name, parse_value(known[name].kind, text))
        except ValueError:
            raise ConfigError(
                f"{name}={text}: expected {describe(known[name].kind)}, found {text!r}.",
                f"{name}: {known[name].help}",
            ) from None
    return options


def _stray_word(verb: str, kind: type[Options], text: str) -> tuple[str, str]:
    if text in (item.name for item in fields(kind)):
        return f"gsfw {verb}: {text} is given without a value.", f"Write {text}=VALUE."
    return f"gsfw {verb}: unexpected {text!r}.", f"See gsfw {verb} --help."


@dataclass(kw_only=True)
class RunOptions(Options):
    """Options of every verb that opens a run."""

    run: str = positional("RUN")
    """A run folder, a checkpoint, a model file (.gsfw), or latest."""
    data: str = ""
    """Place of the data set, if it was moved. Empty: that of the training; a model file needs
    none."""
    device: str = ""
    """Device: auto, cpu, cuda or cuda:N. Empty: that of the training; auto for a file."""

    def changed(self) -> Layer | None:
        """Settings that differ from the run's own; ``None`` for none."""
        return changed_place(self.data, self.device)


@dataclass(kw_only=True)
class DetailOptions(Options):
    """Options of every verb that can draw a static model within a budget."""

    budget: str = ""
    """Maximum number of Gaussians in a view, such as 200000, or megabytes of them, such as 200MB,
    chosen by levels of detail. Empty: all; for a .lod file, what half of memory holds."""
    detail: float = number(0.0, at_least=0, below=math.inf)
    """Size in pixels below which Gaussians are drawn as one. 0: none are, as far as the budget
    goes."""
    memory: str = ""
    """Memory limit for the Gaussians of a .lod file, such as 256MB or 2GB. Empty: 512MB."""

    def drawn(self) -> Detail:
        """The options as a whole.

        Raises:
            ConfigError: one is no number, or out of range.
        """
        from gsfw.commands.interface.detail import Detail

        return Detail.parse(self.budget, self.detail, self.memory)

"""Completion table: what may follow on a command line, as lines that a shell looks up.

A line is ``context|word|values``. The context is a verb, or a verb and a word that is on the line
("train strategy=mcmc"), or that is not ("train strategy=": no strategy is chosen); ``-`` stands for
the place of the verb. The word is a key with "=", or a bare word. Values are separated by spaces;
``@`` stands for a file.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import MISSING, fields, replace
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from gsfw.commands.interface.arguments import HelpRequested, Options
from gsfw.commands.interface.runs import LATEST
from gsfw.core.config import AUTO
from gsfw.core.errors import EndedBySignal
from gsfw.plugins.exporters import exporter_options
from gsfw.plugins.keys import SLOT_KEYS, Key, keys
from gsfw.plugins.loading import callback_configs, load_all
from gsfw.plugins.registry import SLOTS, Registry
from gsfw.plugins.resolving import preset_names
from gsfw.rendering.channels import CHANNELS
from gsfw.scaffold.kinds import BASES, KINDS

START, FILE = "-", "@"
FILES = ("data", "out", "config", "init", "images", "masks")
"""Keys of text that is a path."""
FLAG_KEYS = ("json", "debug")
SETTINGS_VERBS = ("train", "config")
"""Verbs that take every setting of a method."""
FORMAT_VERBS = ("export", "convert", "edit")
"""Verbs that take the options of a format."""
VALUES = {
    "device": (AUTO, "cpu", "cuda"),
    "slot": tuple(SLOTS),
    "like": tuple(BASES),
    "channel": tuple(CHANNELS),
}
"""Values of keys of text, by name."""
VERB_SLOTS = {
    ("export", "format"): "exporter",
    ("convert", "format"): "exporter",
    ("edit", "format"): "exporter",
    ("info", "format"): "datamanager",
}
"""Keys of verbs whose values are names of a slot of another name."""
ACTIONS = {"config": ("show",), "completion": ("bash", "zsh", "fish"), "new": tuple(KINDS)}
"""Bare words of verbs that take no run."""


def completion_table(registry: Registry) -> list[str]:
    """All lines, each once: verbs, their keys and words, and the settings of every part."""
    verbs = registry.slot("command")
    lines = [f"{START}|{verb}|" for verb in (*verbs, "--help", "--version")]
    for verb, run in load_all("command", registry).items():
        for word in ACTIONS.get(verb, ()):
            lines.append(f"{verb}|{word}|")
        for kind in _options(run):
            lines += _option_lines(verb, kind, registry)
        lines.append(f"{verb}|--help|")
    for verb in FORMAT_VERBS:
        lines += _format_lines(verb, registry)
    for verb in SETTINGS_VERBS:
        lines += _setting_lines(verb, registry)
    lines += [*_resume_lines(lines), *_following_lines(lines)]
    return list(dict.fromkeys(lines))


def _options(run: Any) -> tuple[type[Options], ...]:  # noqa: ANN401 - a function of a plugin
    """The options of a verb, which it names when it is asked for help; none if it has others."""
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            run(["--help"])
    except HelpRequested as wanted:
        return wanted.options
    except EndedBySignal:
        raise
    except (Exception, SystemExit):  # Of another plugin: its verb is completed without keys.
        return ()
    return ()


def _option_lines(verb: str, kind: type[Options], registry: Registry) -> Iterator[str]:
    """The keys and words of a verb with options of its own."""
    words = {item.name: item.metadata["word"] for item in fields(kind) if "word" in item.metadata}
    blank: Any = kind
    made = blank(
        **{item.name: "" for item in fields(kind) if item.name in words and item.default is MISSING}
    )
    for name in words.values():
        if "RUN" in name:
            yield f"{verb}|{LATEST}|"
        for action in re.findall(r"[a-z]+", name):
            yield f"{verb}|{action}|"
        if re.search("[A-Z]", name):
            yield f"{verb}|{FILE}|"
    for key in keys(made):
        if key.name not in words:
            slot = VERB_SLOTS.get((verb, key.name), key.name)
            yield f"{verb}|{key.name}=|{' '.join(_values(key, slot, registry))}"


def _format_lines(verb: str, registry: Registry) -> Iterator[str]:
    """The options of each format."""
    for name, kind in load_all("exporter", registry).items():
        for key in exporter_options(kind):
            yield f"{verb} format={name}|{_line(key, registry)}"


def _setting_lines(verb: str, registry: Registry) -> Iterator[str]:
    """The settings of methods and of their parts."""
    yield f"{verb}|method=|{' '.join(registry.slot('method'))}"
    yield f"{verb}|config=|{FILE}"
    for name in FLAG_KEYS if verb == "config" else (*FLAG_KEYS, "dry_run"):
        yield f"{verb}|{name}=|true false"
    for slot in SLOT_KEYS:
        yield f"{verb}|{slot}=|{' '.join((AUTO, *registry.slot(slot)))}"
    callbacks = callback_configs(registry)
    configs = {
        name: replace(kind(), callbacks=callbacks)
        for name, kind in load_all("method", registry).items()
    }
    settings = {name: _by_name(config, registry) for name, config in configs.items()}
    if viewer := getattr(callbacks, "viewer", None):  # Its settings have short forms.
        yield f"{verb}|viewer=|true false"
        for key in keys(viewer, "viewer."):
            yield f"{verb}|{_line(key, registry)}"
    everywhere = set.intersection(*(set(found.values()) for found in settings.values()))
    for line in sorted(everywhere):
        yield f"{verb}|{line}"
    for name, found in settings.items():
        yield f"{verb} method={name}|preset=|{' '.join(preset_names(configs[name]))}"
        for line in found.values():
            if line not in everywhere:
                yield f"{verb} method={name}|{line}"
    for slot in SLOT_KEYS:
        for name, kind in load_all(slot, registry).items():
            for key in keys(kind(), f"{slot}."):
                for context in (f"{slot}={name}", f"{slot}={AUTO}", f"{slot}="):
                    yield f"{verb} {context}|{_line(key, registry)}"


def _by_name(config: object, registry: Registry) -> dict[str, str]:
    return {key.name: _line(key, registry) for key in keys(config)}


def _line(key: Key, registry: Registry) -> str:
    """A line without its context."""
    return f"{key.name}=|{' '.join(_values(key, '', registry))}"


def _resume_lines(lines: Iterable[str]) -> Iterator[str]:
    """The settings that may change when a run goes on: those of every method."""
    from gsfw.commands.resume import CHANGEABLE

    yield f"resume|{LATEST}|"
    yield f"resume|{FILE}|"
    for line in tuple(lines):
        context, key, values = line.split("|")
        if context == "train" and key.rstrip("=").partition(".")[0] in (*CHANGEABLE, *FLAG_KEYS):
            yield f"resume|{key}|{values}"


def _following_lines(lines: Iterable[str]) -> Iterator[str]:
    """Settings of training after ``gsfw prepare ... train=true``; its data are not among them."""
    for line in lines:
        context, key, _ = line.split("|")
        verb, _, chosen = context.partition(" ")
        if verb == "train" and not chosen.endswith("=") and key not in ("data=", "--help"):
            yield line.replace(context, f"prepare {chosen or 'train=true'}", 1)


def _values(key: Key, slot: str, registry: Registry) -> tuple[str, ...]:
    """The values that a key may have; empty if they cannot be listed."""
    found = _values_of_type(key.kind)
    if found:
        return found
    if key.name in FILES:
        return (FILE,)
    if key.name in VALUES:
        return VALUES[key.name]
    return tuple(registry.slot(slot)) if slot in SLOTS else ()


def _values_of_type(kind: Any) -> tuple[str, ...]:  # noqa: ANN401 - any annotation
    """The values of a type, of an optional one, or of the items of a list."""
    choices = get_args(kind) if get_origin(kind) is Literal else ()
    if not choices:
        parts = [part for part in get_args(kind) if part not in (type(None), Ellipsis)]
        if parts:
            return _values_of_type(parts[0])
    if isinstance(kind, type) and issubclass(kind, Enum):
        choices = tuple(item.name for item in kind)
    known = {bool: ("true", "false"), Path: (FILE,)}
    return tuple(str(value) for value in choices if value != "") or known.get(kind, ())

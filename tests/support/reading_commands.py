"""Reads a command line of gsfw as its verb does, without doing what it says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gsfw.commands import blocks, check, partition, resume
from gsfw.commands.interface.arguments import (
    HelpRequested,
    Options,
    layers,
    parse,
    read_options,
)
from gsfw.commands.interface.following_training import read_both
from gsfw.commands.interface.format_options import read_with_format
from gsfw.commands.tradeoff import training, verb
from gsfw.commands.tradeoff.model import ModelOptions
from gsfw.commands.train import read_settings
from gsfw.core.errors import ConfigError
from gsfw.planning.asked import asked_of
from gsfw.plugins.exporters import format_of, make_exporter
from gsfw.plugins.registry import installed
from gsfw.plugins.specs import Spec

GLOBAL = ("--help", "--version")
"""Words in the place of the verb."""


def read_command(words: Sequence[str]) -> None:
    """Read the words behind ``gsfw``: the verb exists, and so does every key, with such a value.

    Raises:
        ConfigError: as the verb raises it.
    """
    name, *tokens = words
    if name in GLOBAL:
        return
    spec = installed().find("command", name)
    match name:
        case "train":
            _read_settings(tokens)
        case "config":
            assert tokens[:1] == ["show"]
            _read_settings(tokens[1:])
        case "prepare":
            read_both(tokens)
        case "check":
            _read_check(tokens)
        case "resume":
            resume._changed(parse(tokens))
        case "tradeoff" | "blocks" | "partition":
            _read_both(name, tokens)
        case "export" | "convert" | "edit":
            _read_with_format(spec, tokens)
        case _:
            kind = _options(spec)
            if tokens and (other := _options(spec, tokens[0])) is not kind:
                read_options(f"{name} {tokens[0]}", other, tokens[1:])
            else:
                read_options(name, kind, tokens)


def _read_settings(tokens: Sequence[str]) -> None:
    """Resolve settings as ``gsfw train`` does."""
    arguments = parse(tokens)
    try:
        asked_of(read_settings(arguments, installed()), layers(arguments))
    except HelpRequested:
        if unknown := set(arguments.values) - {"help", "method"}:
            raise ConfigError(f"help with {unknown} is not read here") from None


def _read_with_format(spec: Spec, tokens: Sequence[str]) -> None:
    """Read the options of the format, too, if the line names it."""
    kind = _options(spec)
    try:
        options, given = read_with_format(spec.name, kind, tokens)
    except HelpRequested:
        return
    form = options.format or format_of(Path(options.out), installed())
    if form:
        make_exporter(form, installed(), given)


def _read_check(tokens: Sequence[str]) -> None:
    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if key in check.OWN]
    given = [(key, text) for key, text in arguments.pairs if key not in check.OWN]
    options = read_options("check", check.CheckOptions, [*own, *arguments.words])
    check._settings(options, given)


def _read_both(name: str, tokens: Sequence[str]) -> None:
    """Read the options of a verb, and the settings of its trainings."""
    if name == "tradeoff":
        _read_tradeoff(tokens)
        return
    _, given = {"blocks": blocks, "partition": partition}[name].read(list(tokens))
    _read_settings(["method=3dgs", *(f"{key}={text}" for key, text in given.items())])


def _read_tradeoff(tokens: Sequence[str]) -> None:
    arguments = parse(tokens)
    if verb.names_a_run(arguments):
        read_options("tradeoff", ModelOptions, tokens)
        return
    _, given = training._split(arguments)
    _read_settings([f"{key}={value}" for key, value in given.items()])


def _options(spec: Spec, *words: str) -> type[Options]:
    """The options of a verb, or of its form with these words, named when it is asked for help."""
    try:
        spec.load()([*words, "--help"])
    except HelpRequested as wanted:
        (kind,) = wanted.options
        return kind
    raise AssertionError(f"gsfw {spec.name} --help gives no help")

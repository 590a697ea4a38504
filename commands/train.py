"""The verb ``train``: settings, checks, a run folder, the loop."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gsfw.commands.interface.arguments import FLAGS, Arguments, HelpRequested, layers, parse
from gsfw.commands.interface.caller import Caller
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.progress import loading_torch
from gsfw.commands.interface.team import (
    console_of,
    joined,
    run_left,
    run_workers,
    starts_workers,
    together,
    with_processes,
)
from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError, UserError
from gsfw.parallel.environment import world
from gsfw.plugins.registry import Registry, did_you_mean, installed

if TYPE_CHECKING:
    from gsfw.commands.interface.new_training import NewTraining
    from gsfw.core.team import Team
    from gsfw.plugins.settings import Layer, Settings

USAGE = "usage: gsfw train method=NAME [key=value ...]\n"
EXAMPLES = (
    "Without data= a method trains on the built-in scene.",
    "--dry-run checks data and settings, and estimates time, memory and disk space.",
    "",
    "examples:",
    "  gsfw train method=3dgs",
    "  gsfw train method=3dgs data=DIR minutes=5",
    "  gsfw train method=3dgs data=DIR out=runs/first viewer=true",
    "  gsfw train method=3dgs data=DIR --dry-run",
)
"""The end of the help without a method."""


def run(tokens: list[str]) -> int:
    """Train a method on a data set."""
    began = time.perf_counter()
    arguments = with_processes(parse(tokens))
    registry = installed()
    console = console_of(arguments)
    if not arguments.flag("help") and world() is None:
        announce(layers(arguments), registry, console)
    with loading_torch(" and the method"):
        settings = read_settings(arguments, registry)
    processes = settings.config.processes
    if starts_workers(processes) and not arguments.flag("dry_run"):
        from gsfw.commands.interface.new_run import check_free
        from gsfw.planning.asked import asked_of, spelled_out

        asked_of(settings, spelled_out(layers(arguments)))
        check_free(settings.config.out)
        return run_workers(["train", *tokens], processes)
    from gsfw.commands.interface.new_training import new_training
    from gsfw.commands.interface.training import run_training
    from gsfw.planning.asked import spelled_out

    given, command = spelled_out(layers(arguments)), ["train", *tokens]
    caller = Caller(console, run_training)
    with joined(processes, settings.config.shards, settings.config.device) as team:
        if (left := run_left(team)) is not None:
            return _go_on(left, processes, caller, began, team)
        new = together(team, lambda: new_training(settings, given, registry, command, began, team))
        console.say(str(new))
        if arguments.flag("dry_run"):
            return _tell_dry_run(new, time.perf_counter() - began, console)
        code, _ = new.train(caller, registry, team)
    return code


def _go_on(run: Path, processes: int, caller: Caller, began: float, team: Team) -> int:
    """Continue the run that earlier processes of torchrun have begun; return the exit code."""
    from gsfw.commands.interface.runs import find_run
    from gsfw.commands.resume import resume_together

    caller.console.say(f"the processes were started again: continuing {run}")
    changed = {"processes": str(processes)}
    command = ["resume", str(run), f"processes={processes}"]
    return resume_together(
        find_run(str(run), caller.console.say), changed, command, caller, began, team
    )


def _tell_dry_run(new: NewTraining, seconds: float, console: Console) -> int:
    """Print whether a run would train, and its cost; return the exit code, as ``gsfw check``.

    Args:
        new: the run.
        seconds: time since the start of the process.
        console: console to print on.
    """
    from gsfw.commands.interface.fitness import hopeless
    from gsfw.preparation.check.report import finding_lines
    from gsfw.studies.expectation import expect

    composition, plan = new.composition, new.plan
    for note in composition.notes():
        console.say(f"note: {note}")
    findings = hopeless(composition.parts.data)
    expected = expect(composition, installed(), seconds)
    if plan is not None:
        expected = replace(expected, seconds=60 * plan.asked.minutes)
    composition.parts.data.close()
    console.say(str(expected))
    document = {"fits": not findings, "run": str(new.path), "settings": composition.settings.flat()}
    for line in (line for finding in findings for line in finding_lines(finding.document())):
        console.say(line)
    if findings:
        console.say("the parts fit together, but this data set will not train: see gsfw check")
    else:
        console.say(f"everything fits; without --dry-run the run would go to {new.path}")
    documents = [finding.document() for finding in findings]
    console.result({**document, "findings": documents, "expected": expected.document()})
    return 1 if findings else 0


def announce(given: Sequence[Layer], registry: Registry, console: Console) -> None:
    """Print method and data before torch is loaded; wrong settings are reported later."""
    values = {key: value for layer in given for key, value in layer.values.items()}
    if values.get("method") in registry.slot("method"):
        data = values.get("data") or "the built-in scene"
        device = values.get("device", AUTO)
        console.say(f"preparing method {values['method']} on {data}, device {device}")


def read_settings(arguments: Arguments, registry: Registry) -> Settings:
    """Resolve the given settings, or raise help on them.

    Raises:
        HelpRequested: ``--help`` was given.
        ConfigError: no method was chosen, or a setting is wrong.
    """
    from gsfw.planning.asked import spelled_out
    from gsfw.plugins.settings import resolve

    wanted = arguments.flag("help")
    given = spelled_out(layers(arguments))
    _check_words(arguments.words, registry)
    if not any("method" in layer.values for layer in given):
        if wanted:
            lines = [USAGE, *_methods(registry), "", *EXAMPLES]
            raise HelpRequested("\n".join(lines))
        raise ConfigError(_no_method(given), "\n".join(_methods(registry)))
    if wanted:
        from gsfw.commands.interface.help import settings_help

        settings, problem = _settings_to_explain(given, registry)
        raise HelpRequested(settings_help(settings, registry, problem))
    return resolve(registry, given)


def _settings_to_explain(given: Sequence[Layer], registry: Registry) -> tuple[Settings, str]:
    """The settings of the run, or what is wrong with them and those of the choices alone.

    Help is asked for when a line is wrong, so that a mistake in it is no reason to refuse.
    """
    from gsfw.plugins.settings import CHOICE_KEYS, COMMAND_LINE, Layer, resolve

    try:
        return resolve(registry, given), ""
    except UserError as error:
        chosen = {
            key: text for layer in given for key, text in layer.values.items() if key in CHOICE_KEYS
        }
        return resolve(registry, [Layer(COMMAND_LINE, chosen)]), error.message


def _no_method(given: Sequence[Layer]) -> str:
    """The message on settings without a method; names the key that was meant for one, if any."""
    from gsfw.plugins.settings import where

    for layer in given:
        for key in layer.values:
            if meant := did_you_mean(key, ["method"]):
                return f"{where(layer.source)}unknown key {key!r}.{meant}"
    return "no method is chosen."


def _methods(registry: Registry) -> list[str]:
    methods = registry.slot("method")
    width = max((len(name) for name in methods), default=0)
    first = next(iter(methods), "NAME")
    return [
        "Methods:",
        *(f"  {name:{width}}  {spec.description}" for name, spec in methods.items()),
        f"Next: gsfw train method={first} (with --help: every setting).",
    ]


def _check_words(words: Sequence[str], registry: Registry) -> None:
    """Explain a word that is not ``key=value``."""
    for word in words:
        if word in registry.slot("method"):
            advice = f"Write method={word}."
        elif Path(word).exists():
            advice = f"Write data={word}."
        elif word in FLAGS:
            advice = f"Write {word}=true, or --{word.replace('_', '-')}."
        else:
            advice = f"Write {word}=VALUE; all keys: gsfw train --help."
        raise ConfigError(f"{word!r} is not key=value.", advice)

"""The verb ``config``: every setting of a run, and its source."""

from __future__ import annotations

from dataclasses import replace

from gsfw.commands.interface.arguments import HelpRequested, layers, parse
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.page import paragraphs
from gsfw.commands.train import read_settings
from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import installed

HELP = """usage: gsfw config show method=NAME [key=value ...]

Show every setting that gsfw train would use, and where each came from. Nothing is run.

examples:
  gsfw config show method=3dgs
  gsfw config show method=3dgs preset=fast strategy=mcmc json=true
  gsfw config show config=runs/first/config.yaml"""


def run(tokens: list[str]) -> int:
    """Show settings."""
    arguments = parse(tokens)
    if arguments.flag("help"):
        raise HelpRequested(paragraphs(HELP))
    if arguments.words[:1] != ("show",):
        cause = f"no action {arguments.words[0]!r}" if arguments.words else "no action is given"
        raise ConfigError(f"gsfw config: {cause}.", "Write gsfw config show method=NAME.")
    arguments = replace(arguments, words=arguments.words[1:])
    settings = read_settings(arguments, installed())
    from gsfw.planning.asked import asked_of, spelled_out
    from gsfw.plugins.values import as_text

    console, values = Console(arguments.flag("json")), settings.flat()
    console.table(
        ["setting", "source"],
        [[f"{key}={as_text(value)}", settings.sources[key]] for key, value in values.items()],
    )
    for note in settings.notes:
        console.say(f"note: {note}")
    given = spelled_out(layers(arguments))
    if (asked := asked_of(settings, given)) is not None:
        console.say(f"note: {asked}: steps, and what follows from them, are planned at the start.")
    console.result(
        {key: {"value": value, "source": settings.sources[key]} for key, value in values.items()}
    )
    return 0

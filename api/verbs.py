"""Verbs: the options and the terminal of a command, and the runs that it opens.

A verb is a function ``(arguments: list[str]) -> int`` (the exit code). It reads its options into a
dataclass that derives from ``Options`` or ``RunOptions``, and writes through ``Console``.
"""

from gsfw.commands.interface.arguments import (
    Options,
    RunOptions,
    positional,
    positionals,
    read_options,
)
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.opened_run import OpenedRun, open_run

__all__ = [
    "Console",
    "OpenedRun",
    "Options",
    "RunOptions",
    "open_run",
    "positional",
    "positionals",
    "read_options",
]

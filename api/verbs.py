"""Verbs: the options and the terminal of a command, and the runs that it opens."""

from gsfw.commands.interface.arguments import Options, RunOptions, read
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.runs import find_run, open_run
from gsfw.plugins.registry import installed

__all__ = ["Console", "Options", "RunOptions", "find_run", "installed", "open_run", "read"]

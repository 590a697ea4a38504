"""Verbs: the options and the terminal of a command, and the runs that it opens."""

from gsfw.commands.interface.arguments import Options, RunOptions, read
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.runs import open_run

__all__ = ["Console", "Options", "RunOptions", "open_run", "read"]

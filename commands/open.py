"""`gsfw open`: shows a run in the browser as `gsfw view` does, the latest one if none is named."""

from __future__ import annotations

from gsfw.commands.interface.arguments import parse
from gsfw.commands.interface.runs import LATEST


def run(arguments: list[str]) -> int:
    """Start the viewer."""
    from gsfw.commands.view import run as view

    given = parse(arguments)
    is_named = given.words or "runs" in given.values or given.flag("help")
    return view(arguments if is_named else [LATEST, *arguments])

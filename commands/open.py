"""`gsfw open`: shows a run in the browser as `gsfw view` does, the latest one if none is named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from gsfw.commands.interface.arguments import positionals, read_options
from gsfw.commands.interface.runs import LATEST
from gsfw.commands.view import ViewOptions


@dataclass(kw_only=True)
class OpenOptions(ViewOptions):
    """Show the latest run in the browser, or the given RUN or FILE, as gsfw view does."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw open",
        "gsfw open browser=true",
        "gsfw open runs/first",
    )

    runs: tuple[str, ...] = positionals("[RUN|FILE ...]", least=0)
    """Left out: the latest run. One or two: what gsfw view opens."""


def run(arguments: list[str]) -> int:
    """Start the viewer."""
    options = read_options("open", OpenOptions, arguments)
    from gsfw.commands import view

    return view.show("open", replace(options, runs=options.runs or (LATEST,)))

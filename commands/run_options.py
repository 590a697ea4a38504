"""RunOptions: what every verb that looks at a run takes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.commands.arguments import Options, word

if TYPE_CHECKING:
    from gsfw.plugins.settings import Layer


@dataclass(kw_only=True)
class RunOptions(Options):
    """What every verb that looks at a run takes: a run may be looked at elsewhere."""

    run: str = word("RUN")
    """A run folder, a checkpoint, a model file (.gsfw), or latest."""
    data: str = ""
    """Where the data set is now. Empty: where it was in training; a model file needs none."""
    device: str = ""
    """Where to draw: auto, cpu, cuda or cuda:N. Empty: where it was trained; auto for a file."""

    def changed(self) -> Layer | None:
        """Settings that differ from the run's own; ``None`` for none."""
        from gsfw.plugins.settings import COMMAND_LINE, Layer

        given = {key: text for key in ("data", "device") if (text := getattr(self, key))}
        return Layer(COMMAND_LINE, given) if given else None

"""Join: add the splats of another file."""

from __future__ import annotations

from pathlib import Path

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.splats import Splats
from gsfw.editing.editable import Editable
from gsfw.editing.operations.edit import Edit, Edited, Surroundings


def merge(text: str) -> Edit:
    """Add the splats of a file."""
    if not text:
        raise ValueError("expected a file of splats")

    def edit(piece: Editable, around: Surroundings) -> Edited:
        if piece.in_place:
            raise ConfigError(
                f"merge={text}: the rows of a model can only be left out, not added.",
                "Write a splat format instead: out=FILE.ply",
            )
        if not Path(text).exists():
            raise DataError(
                f"merge={text}: there is no such file.",
                f"Give the path of a file of splats, absolute or from {Path.cwd()}.",
            )
        own, other = piece.splats(), around.read(Path(text)).splats
        return Edited(piece.with_splats(Splats.cat([own, other])), f"{len(other):,} of {text}")

    return edit

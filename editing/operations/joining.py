"""Join: add the splats of another file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.splats import Sh, Splats
from gsfw.editing import colors
from gsfw.editing.editable import Editable
from gsfw.editing.merging import joined
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
        assert isinstance(own.colors, Sh)
        assert isinstance(other.colors, Sh)
        degree = max(own.colors.degree, other.colors.degree)
        both = [_of_degree(splats, degree) for splats in (own, other)]
        return Edited(piece.with_splats(joined(*both)), f"{len(other):,} of {text}")

    return edit


def _of_degree(splats: Splats, degree: int) -> Splats:
    assert isinstance(splats.colors, Sh)
    return replace(splats, colors=colors.of_degree(splats.colors, degree))

"""Reduce: fewer SH bands, and as many Gaussians as there is room for."""

from __future__ import annotations

from gsfw.core.errors import ConfigError
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.core.words import size
from gsfw.editing.decimation import decimate
from gsfw.editing.editable import Editable
from gsfw.editing.operations.edit import Edit, Edited, Surroundings
from gsfw.editing.operations.values import number, whole


def sh_degree(text: str) -> Edit:
    """Leave out SH bands."""
    if text not in {str(degree) for degree in range(MAX_DEGREE + 1)}:
        raise ValueError(f"expected a degree from 0 to {MAX_DEGREE}, found {text!r}")

    def edit(piece: Editable, _: Surroundings) -> Edited:
        before = piece.degree
        return Edited(piece.truncated(int(text)), f"SH degree {before} -> {min(before, int(text))}")

    return edit


def decimate_count(text: str) -> Edit:
    """Decimate to a number of Gaussians."""
    count = whole(text, "a number of Gaussians, at least 1")
    return lambda piece, _: _decimated(piece, count)


def _decimated(piece: Editable, count: int) -> Edited:
    if count >= len(piece):
        return Edited(piece, "there are no more")
    found = decimate(piece, count)
    if found.psnr is None:
        return Edited(found.piece, "by contribution, colours as they were")
    return Edited(
        found.piece,
        f"{found.psnr:.1f} dB against what it was, {found.before_refit:.1f} before colours were "
        "refitted",
    )


TRIES = 4
"""Decimations until a file is small enough: what compresses well differs between splats."""


def decimate_mb(text: str) -> Edit:
    """Decimate to a size of the file."""
    budget = 1e6 * number(text, "a size in MB above 0", 1e-6)

    def edit(piece: Editable, around: Surroundings) -> Edited:
        edited, found, room = Edited(piece), 0, _room(piece, around, budget)
        for attempt in range(TRIES):
            edited = _decimated(piece, min(len(piece), room))
            if attempt and piece.in_place:
                edited = Edited(edited.piece, "in several rounds")
            found = around.num_bytes(edited.piece)
            if found <= budget:
                return edited
            room = max(1, int(0.99 * len(edited.piece) * budget / found))
        raise ConfigError(
            f"decimate.mb={text}: a file with {len(edited.piece):,} of the Gaussians still has "
            f"{size(found)}.",
            "Give a larger size, or a format that needs fewer bytes.",
        )

    return edit


def _room(piece: Editable, around: Surroundings, budget: float) -> int:
    """Number of Gaussians whose file has the size, by the bytes of each; at least 1."""
    fixed, each = piece.file_bytes(around.num_bytes)
    return max(1, int((budget - fixed) / each)) if each > 0 else len(piece)

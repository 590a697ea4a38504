"""Looks: brightness, contrast, saturation and white balance."""

from __future__ import annotations

from collections.abc import Callable

from gsfw.editing import colors
from gsfw.editing.operations.edit import Edit, Edited
from gsfw.editing.operations.values import number, numbers


def factor(of: Callable[[float], colors.ColorMap]) -> Callable[[str], Edit]:
    """Change colours by a factor."""

    def parse(text: str) -> Edit:
        change = of(number(text, "a factor of at least 0", 0.0))
        return lambda piece, _: Edited(piece.recolored(change))

    return parse


def white(text: str) -> Edit:
    """Make a colour grey."""
    change = colors.white_balance(*numbers(text, "red,green,blue"))
    return lambda piece, _: Edited(piece.recolored(change))

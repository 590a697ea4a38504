"""Arrangement: several images of one view as one image: with a line between, or beside another."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

LINE = 0.95
"""Brightness of the line of a wipe."""
GAP = 2
"""Pixels between images beside one another."""


def fitted(width: int, height: int, inside: tuple[int, int]) -> tuple[int, int]:
    """Largest size in the shape of ``width`` by ``height`` that fits inside; at least one pixel."""
    factor = min(inside[0] / width, inside[1] / height)
    return max(round(width * factor), 1), max(round(height * factor), 1)


def slots(width: int, height: int, count: int) -> list[tuple[int, int]]:
    """Sizes of ``count`` images beside one another, with gaps, that fill ``width`` together."""
    room = width - GAP * (count - 1)
    edges = [round(room * place / count) for place in range(count + 1)]
    return [(max(last - first, 1), height) for first, last in pairwise(edges)]


def best_columns(count: int, size: tuple[int, int], aspect: int | float) -> int:
    """Number of columns in which ``count`` images of one shape are largest within ``size``."""

    def width(columns: int) -> float:
        rows = -(-count // columns)
        return min(size[0] / columns, size[1] / rows * aspect)

    return max(range(count, 0, -1), key=width)


def below(images: Sequence[Float[Tensor, "_ w 3"]], behind: float) -> Float[Tensor, "h w 3"]:
    """Images of one width below one another, with grey between them."""
    return beside([image.transpose(0, 1) for image in images], behind).transpose(0, 1)


def centred(
    image: Float[Tensor, "h w 3"], size: tuple[int, int], behind: float
) -> Float[Tensor, "h2 w2 3"]:
    """An image in the middle of a grey one of ``size`` (width, height), which is not smaller."""
    height, width = image.shape[:2]
    if (width, height) == size:
        return image
    canvas = image.new_full((size[1], size[0], 3), behind)
    top, left = (size[1] - height) // 2, (size[0] - width) // 2
    canvas[top : top + height, left : left + width] = image
    return canvas


def beside(images: Sequence[Float[Tensor, "h _ 3"]], behind: float) -> Float[Tensor, "h w 3"]:
    """Images of one height beside one another, with grey between them."""
    gap = images[0].new_full((images[0].shape[0], GAP, 3), behind)
    parts = [images[0]]
    for image in images[1:]:
        parts += [gap, image]
    return torch.cat(parts, dim=1)


def wiped(
    first: Float[Tensor, "h w 3"], second: Float[Tensor, "h w 3"], place: float
) -> Float[Tensor, "h w 3"]:
    """The first image left of ``place`` in [0, 1], the second one right of it."""
    width = first.shape[1]
    column = min(max(round(place * width), 0), width)
    image = torch.cat([first[:, :column], second[:, column:]], dim=1)
    if 0 < column < width:
        half = max(width // 960, 1)
        image[:, max(column - half, 0) : column + half] = LINE
    return image

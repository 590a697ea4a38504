"""Area filter: each pixel of a smaller image is the mean of the area that it covers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy  # Its parts are loaded when they are first used: most runs shrink nothing.
from jaxtyping import Bool, Float32, Shaped, UInt8

STRIP = 256
"""Rows of an image that are floating-point numbers at a time."""


def shrink(
    pixels: UInt8[np.ndarray, "h w d"], width: int, height: int
) -> UInt8[np.ndarray, "h2 w2 d"]:
    """An image at a smaller size; with alpha (d = 4) colours are averaged by their coverage."""
    if pixels.shape[:2] == (height, width):
        return pixels
    # Columns first: the layout decides the last bits of later matrix products, as for features.
    small = np.empty((width, height, pixels.shape[2]), np.uint8).transpose(1, 0, 2)
    shrink_into(small, lambda top, bottom: to_values(pixels[top:bottom]), pixels.shape[:2])
    return small


def shrink_into(
    small: UInt8[np.ndarray, "h2 w2 d"],
    values: Callable[[int, int], Float32[np.ndarray, "rows w d"]],
    size: tuple[int, int],
) -> None:
    """``to_pixels(shrink_values(...))`` bit for bit, with few rows of numbers at a time.

    Args:
        small: the result.
        values: the colours of the rows from the first to before the last, as of ``to_values``.
        size: all rows, and columns.
    """
    height, width = small.shape[:2]
    down = _weights(size[0], height)
    step = max(1, STRIP * height // size[0])
    for top in range(0, height, step):
        weights = down[top : top + step]
        first, last = int(weights.indices.min()), int(weights.indices.max()) + 1
        strip = values(first, last)
        if size != (height, width):
            strip = weights[:, first:last] @ strip.reshape(last - first, -1)
            strip = strip.reshape(len(strip), size[1], -1)
            strip = shrink_values(strip, width, len(strip))
        small[top : top + step] = to_pixels(strip)


def to_values(pixels: UInt8[np.ndarray, "h w d"]) -> Float32[np.ndarray, "h w d"]:
    """Colours that may be mixed: in [0, 255], multiplied by alpha where there is one (d = 4)."""
    values = pixels.astype(np.float32)
    if pixels.shape[2] == 4:
        values[..., :3] *= values[..., 3:] / 255
    return values


def to_pixels(values: Float32[np.ndarray, "h w d"]) -> UInt8[np.ndarray, "h w d"]:
    """Mixed colours as 8-bit straight ones."""
    if values.shape[2] == 4:
        coverage = values[..., 3:] / 255
        colors = values[..., :3] / np.where(coverage > 0, coverage, 1)
        values = np.concatenate([colors, values[..., 3:]], axis=2)
    return np.rint(values.clip(0, 255)).astype(np.uint8)


def shrink_mask(
    mask: Bool[np.ndarray, "h w"], width: int, height: int
) -> Bool[np.ndarray, "h2 w2"]:
    """A mask at a smaller size: true only where every pixel beneath is, as colours are mixed."""
    if mask.shape == (height, width):
        return mask
    return shrink_values(mask[..., None].astype(np.float32), width, height)[..., 0] > 1 - 1e-4


def shrink_values(
    values: Float32[np.ndarray, "h w d"], width: int, height: int
) -> Float32[np.ndarray, "h2 w2 d"]:
    """Means over the areas that the pixels of a smaller image cover."""
    if values.shape[:2] == (height, width):
        return values
    rows, columns, channels = values.shape
    values = _weights(rows, height) @ values.reshape(rows, columns * channels)
    values = values.reshape(height, columns, channels).transpose(1, 0, 2)
    values = _weights(columns, width) @ values.reshape(columns, height * channels)
    return values.reshape(width, height, channels).transpose(1, 0, 2)


def shrink_in_strips(
    pixels: UInt8[np.ndarray, "h w d"], width: int, height: int
) -> Float32[np.ndarray, "h2 w2 d"]:
    """``shrink_values(to_values(pixels))``, with few rows as floating-point numbers at a time."""
    rows, columns, channels = pixels.shape
    weights = _weights(rows, height).tocsc()
    found = np.zeros((height, columns * channels), np.float32)
    for top in range(0, rows, STRIP):
        strip = to_values(pixels[top : top + STRIP])
        part = weights[:, top : top + STRIP].tocsr()
        touched = np.flatnonzero(np.diff(part.indptr))
        found[touched] += part[touched] @ strip.reshape(len(strip), columns * channels)
    return shrink_values(found.reshape(height, columns, channels), width, height)


def pick_nearest(
    values: Shaped[np.ndarray, "h w *d"], width: int, height: int
) -> Shaped[np.ndarray, "h2 w2 *d"]:
    """The values at another size, larger or smaller: each pixel gets the nearest one."""
    if values.shape[:2] == (height, width):
        return values
    y, x = (
        ((np.arange(new) + 0.5) * old / new).astype(np.int64)
        for old, new in zip(values.shape[:2], (height, width), strict=True)
    )
    return values[y[:, None], x]


def _weights(size: int, smaller: int) -> scipy.sparse.csr_matrix:
    """[smaller, size]: which part of each small pixel each pixel of a row covers."""
    cuts = np.union1d(np.arange(size + 1), np.linspace(0, size, smaller + 1))
    middles = (cuts[:-1] + cuts[1:]) / 2
    into = np.minimum(middles * smaller / size, smaller - 1).astype(np.int64)
    share = np.diff(cuts) * smaller / size
    return scipy.sparse.csr_matrix(
        (share.astype(np.float32), (into, middles.astype(np.int64))), shape=(smaller, size)
    )

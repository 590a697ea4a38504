"""Morton order: splats that are near to one another in space are near in the file.

G. M. Morton, A Computer Oriented Geodetic Data Base (IBM, 1966). Formats that store blocks of
splats relative to their bounds, or images of values, need it for small errors or small files.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int, UInt64
from torch import Tensor

BITS = 21
"""Bits of each coordinate, so that the three fit in 63."""
PART = 1 << 16
"""Rows whose places on the curve are computed at once."""


def morton_order(means: Float[Tensor, "n 3"]) -> Int[Tensor, " n"]:
    """The rows along the Morton curve over the bounding box; ties in the order of the rows."""
    points = means.double().numpy()
    low = points.min(axis=0)
    size = np.maximum(points.max(axis=0) - low, np.finfo(np.float64).tiny)
    code = np.empty(len(points), dtype=np.uint64)
    for first in range(0, len(points), PART):
        part = slice(first, first + PART)
        with np.errstate(invalid="ignore"):  # Writers refuse rows that are not finite, by name.
            places = (points[part] - low) / size * (1 << BITS)
            cells = np.minimum(places, (1 << BITS) - 1).astype(np.uint64)
        code[part] = morton_codes(cells)
    return torch.from_numpy(np.argsort(code, kind="stable"))


def morton_codes(cells: UInt64[np.ndarray, "n 3"]) -> UInt64[np.ndarray, " n"]:
    """Places of cells, whose coordinates have ``BITS`` bits, along the Morton curve."""
    x, y, z = (_spread(cells[:, axis]) for axis in range(3))
    return x | (y << np.uint64(1)) | (z << np.uint64(2))


def morton_cells(codes: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, "n 3"]:
    """The cells at places along the Morton curve."""
    return np.stack([_gathered(codes >> np.uint64(axis)) for axis in range(3)], axis=1)


SHIFTS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts that put two zeros after each of 21 bits, and the bits that are in use after each."""


def _spread(values: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """The bits of numbers below 2^21, with two zeros after each."""
    for shift, mask in SHIFTS:
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values


def _gathered(values: UInt64[np.ndarray, " n"]) -> UInt64[np.ndarray, " n"]:
    """Every third bit: the inverse of ``_spread``."""
    masks = [(1 << BITS) - 1, *(mask for _, mask in SHIFTS)]
    values = values & np.uint64(masks.pop())
    for shift, _ in reversed(SHIFTS):
        values = (values | (values >> np.uint64(shift))) & np.uint64(masks.pop())
    return values

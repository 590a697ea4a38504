"""Blocks: a sparse grid of voxels, only where depth images show a surface.

Nießner et al. 2013, "Real-time 3D Reconstruction at Scale using Voxel Hashing": blocks of 8 x 8 x 8
voxels around the seen points. Here they are a sorted list of keys, as nothing is added later.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

SIDE = 8
"""Voxels of a block along each axis."""
AXIS_BITS = 21
"""Bits of a coordinate of a key, so that three fit in 63."""
HALF_RANGE = 1 << (AXIS_BITS - 1)


def keys_of(cells: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
    """One number for each cell; cells of coordinates in [-2^20, 2^20)."""
    shifted = cells + HALF_RANGE
    return (shifted[:, 0] << 2 * AXIS_BITS) | (shifted[:, 1] << AXIS_BITS) | shifted[:, 2]


def cells_of(keys: Int[np.ndarray, " n"]) -> Int[np.ndarray, "n 3"]:
    """The opposite of ``keys_of``."""
    mask = (1 << AXIS_BITS) - 1
    parts = [keys >> 2 * AXIS_BITS, (keys >> AXIS_BITS) & mask, keys & mask]
    return np.stack(parts, axis=1) - HALF_RANGE


@dataclass(frozen=True)
class Blocks:
    """The places of voxels."""

    origin: Float[np.ndarray, " 3"]
    """Position of voxel (0, 0, 0), in the world of the data."""
    voxel: float
    """Distance of neighbours."""
    keys: Int[np.ndarray, " b"]
    """Sorted keys of the blocks."""

    @staticmethod
    def around(
        points: Iterable[Float[np.ndarray, "_ 3"]],
        origin: Float[np.ndarray, " 3"],
        voxel: float,
        most: int,
    ) -> Blocks:
        """All blocks that contain one of the points.

        Args:
            points: part by part.
            origin: of the grid.
            voxel: distance of neighbours.
            most: number of voxels.

        Raises:
            ValueError: there would be more voxels.
        """
        known = np.zeros(0, np.int64)
        for part in points:
            cells = np.floor((part - origin) / (voxel * SIDE))
            cells = cells[(np.abs(cells) < HALF_RANGE).all(axis=1)]
            known = np.union1d(known, keys_of(cells.astype(np.int64)))
            if len(known) * SIDE**3 > most:
                raise ValueError(f"the surface takes more than {most:,} voxels of {voxel:g}")
        return Blocks(origin, voxel, known)

    def __len__(self) -> int:
        return len(self.keys)

    def cells(self, blocks: slice) -> Int[np.ndarray, "v 3"]:
        """Integer coordinates of the voxels of some blocks, block by block."""
        axis = np.arange(SIDE)
        inner = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        return (cells_of(self.keys[blocks])[:, None] * SIDE + inner).reshape(-1, 3)

    def places(self, cells: Float[np.ndarray, "n 3"] | Int[np.ndarray, "n 3"]) -> np.ndarray:
        """Positions of voxels, or of points between them: [n, 3], in float64."""
        return self.origin + self.voxel * cells

    @cached_property
    def _inner(self) -> Int[np.ndarray, " 3"]:
        return np.array([SIDE * SIDE, SIDE, 1])

    def index(self, cells: Int[np.ndarray, "n 3"]) -> Int[np.ndarray, " n"]:
        """Number of the voxel at each cell, in the order of ``cells``; -1 where there is none."""
        if len(self.keys) == 0:
            return np.full(len(cells), -1)
        block = np.floor_divide(cells, SIDE)
        keys = keys_of(block)
        found = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        inner = (cells - block * SIDE) @ self._inner
        return np.where(self.keys[found] == keys, found * SIDE**3 + inner, -1)

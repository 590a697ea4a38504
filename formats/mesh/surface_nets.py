"""Surface nets: the zero surface of a sparse grid as triangles.

Gibson 1998, "Constrained Elastic Surface Nets", in its plain form: each cell of eight voxels with
both signs has one vertex, the mean of the crossings of its edges; each edge with both signs has a
face between the vertices of its four cells. Triangles are more even than those of marching cubes,
and there is no table of cases.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int

from gsfw.formats.mesh.blocks import Blocks

CORNERS = np.array(list(product((0, 1), repeat=3)))
"""Corners of a cell; corner number 4 x + 2 y + z."""
EDGES = [
    (low, high)
    for low in range(8)
    for high in range(8)
    if high > low and bin(low ^ high).count("1") == 1
]
"""The twelve pairs of corners that differ along one axis."""


@dataclass(frozen=True)
class Mesh:
    """Triangles, counter-clockwise from outside."""

    vertices: Float[np.ndarray, "n 3"]
    """In the world of the data, float64."""
    triangles: Int[np.ndarray, "t 3"]
    colors: Float[np.ndarray, "n 3"]
    """In [0, 1]."""

    def take(self, kept: Bool[np.ndarray, " t"]) -> Mesh:
        """Some of the triangles, and the vertices that they use."""
        used, triangles = np.unique(self.triangles[kept], return_inverse=True)
        return Mesh(self.vertices[used], triangles.reshape(-1, 3), self.colors[used])


def surface_net(
    blocks: Blocks,
    distances: Float[np.ndarray, " v"],
    known: Bool[np.ndarray, " v"],
    colors: Float[np.ndarray, "v 3"],
) -> Mesh:
    """The surface where distances pass through zero.

    Args:
        blocks: the voxels.
        distances: of each voxel; positive outside.
        known: voxels whose distance is known; there is no surface beside the others.
        colors: of each voxel; NaN where it is unknown.
    """
    cells = blocks.cells(slice(None))
    corners = np.empty((len(cells), 8), np.int32)
    for number, corner in enumerate(CORNERS):
        corners[:, number] = blocks.index(cells + corner)
    complete = (corners >= 0).all(axis=1) & known[corners].all(axis=1)
    inside = distances[corners[complete]] < 0
    mixed = inside.any(axis=1) & ~inside.all(axis=1)
    active = complete.nonzero()[0][mixed]
    vertex_of = np.full(len(cells), -1)
    vertex_of[active] = np.arange(len(active))
    places = cells[active] + _crossings(distances[corners[active]].astype(np.float64))
    return Mesh(
        blocks.places(places),
        _faces(blocks, cells, distances < 0, corners, vertex_of),
        _mean_colors(colors[corners[active]]),
    )


def _crossings(distances: Float[np.ndarray, "n 8"]) -> Float[np.ndarray, "n 3"]:
    """Mean of the crossings of each cell's edges, in [0, 1]."""
    total, count = np.zeros((len(distances), 3)), np.zeros((len(distances), 1))
    for low, high in EDGES:
        start, end = distances[:, low], distances[:, high]
        crosses = (start < 0) != (end < 0)
        share = np.where(crosses, start / np.where(crosses, start - end, 1.0), 0.0)
        place = CORNERS[low] + share[:, None] * (CORNERS[high] - CORNERS[low])
        total += place * crosses[:, None]
        count += crosses[:, None]
    return total / np.maximum(count, 1)


def _mean_colors(colors: Float[np.ndarray, "n 8 3"]) -> Float[np.ndarray, "n 3"]:
    """Mean colour of the corners that have one; grey for none."""
    there = np.isfinite(colors[..., :1])
    total = np.where(there, colors, 0.0).sum(axis=1)
    count = there.sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), 0.5)


def _faces(
    blocks: Blocks,
    cells: Int[np.ndarray, "v 3"],
    inside: Bool[np.ndarray, " v"],
    corners: Int[np.ndarray, "v 8"],
    vertex_of: Int[np.ndarray, " v"],
) -> Int[np.ndarray, "t 3"]:
    """Two triangles for each edge along an axis whose four cells all have a vertex."""
    found = []
    for axis, (right, up) in ((0, (1, 2)), (1, (2, 0)), (2, (0, 1))):
        end = corners[:, 4 >> axis]
        start = ((end >= 0) & (inside != inside[end])).nonzero()[0]
        around = []
        for back_right, back_up in ((0, 0), (1, 0), (1, 1), (0, 1)):
            neighbor = cells[start].copy()
            neighbor[:, right] -= back_right
            neighbor[:, up] -= back_up
            place = blocks.index(neighbor)
            around.append(np.where(place >= 0, vertex_of[place], -1))
        quads = np.stack(around, axis=1)
        whole = (quads >= 0).all(axis=1)
        quads, outwards = quads[whole], inside[start[whole]]
        quads = np.where(outwards[:, None], quads, quads[:, ::-1])
        found += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return np.concatenate(found)

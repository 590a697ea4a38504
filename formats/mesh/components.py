"""Components of a mesh: connected parts, of which the small ones are floating debris."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gsfw.formats.mesh.surface_nets import Mesh


def large_parts(mesh: Mesh, least: float) -> Bool[np.ndarray, " t"]:
    """True for triangles of parts with at least ``least`` times the triangles of the largest one.

    Args:
        mesh: at least one triangle.
        least: 0 for all parts, 1 for the largest alone.
    """
    first, second, third = mesh.triangles.T
    rows, columns = np.concatenate([first, second]), np.concatenate([second, third])
    count = len(mesh.vertices)
    graph = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(count, count))
    _, part_of_vertex = connected_components(graph, directed=False)
    part = part_of_vertex[first]
    sizes = np.bincount(part)
    return sizes[part] >= least * sizes.max()

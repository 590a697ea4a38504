"""Places of meshes: the global transforms of the nodes of a glTF scene."""

from __future__ import annotations

import numpy as np
import torch

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.formats.placement import Matrix

MOST_NODES = 20_000


def placed_meshes(root: JsonFields) -> list[tuple[int, Matrix]]:
    """The number of each mesh of the scene, with its global transform; once for each use.

    A file without nodes shows all of its meshes where they are.

    Raises:
        DataError: nodes are damaged, or one is below two others or below itself.
    """
    nodes, meshes = root.objects("nodes", default=[]), root.objects("meshes", default=[])
    if len(nodes) > MOST_NODES:
        raise DataError(
            f"{root.path} has {len(nodes)} nodes, and {MOST_NODES} are read.",
            "Export the splats alone from the tool that made it.",
        )
    if not nodes:
        return [(index, np.eye(4)) for index in range(len(meshes))]
    waiting = [(index, np.eye(4)) for index in _roots(root, nodes)]
    seen: set[int] = set()
    found = []
    while waiting:
        index, parent = waiting.pop()
        node = nodes[index]
        if index in seen:
            raise DataError(
                f"{root.path}: {node.where} is below two nodes, or below itself.", COPY_AGAIN
            )
        seen.add(index)
        # A damaged file may hold numbers whose product overflows: refused where it is applied.
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = parent @ _local(node)
        if "mesh" in node:
            node.pick("mesh", meshes)
            found.append((node.count("mesh"), matrix))
        below = node.indices("children", len(nodes), default=[])
        waiting += [(child, matrix) for child in reversed(below)]
    return found


def _roots(root: JsonFields, nodes: list[JsonFields]) -> list[int]:
    """The nodes of the scene, last one first; those below no other if no scene is stated."""
    scenes = root.objects("scenes", default=[])
    if scenes:
        scene = root.pick("scene", scenes) if "scene" in root else scenes[0]
        return scene.indices("nodes", len(nodes), default=[])[::-1]
    below = {child for node in nodes for child in node.indices("children", len(nodes), default=[])}
    return [index for index in reversed(range(len(nodes))) if index not in below]


def _local(node: JsonFields) -> Matrix:
    """The transform of a node relative to the one above it."""
    if "matrix" in node:
        return node.numbers("matrix", 16).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = node.numbers("rotation", 4)
        turn = rotation_matrices(torch.tensor([[w, x, y, z]], dtype=torch.float64))
        matrix[:3, :3] = turn[0].numpy()
    matrix[:3, :3] *= node.numbers("scale", 3, default=[1.0, 1.0, 1.0])
    matrix[:3, 3] = node.numbers("translation", 3, default=[0.0, 0.0, 0.0])
    return matrix

"""Places of meshes: the global transforms of the nodes of a glTF scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float64

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.maths.frame import transform_splats, with_axes
from gsfw.core.maths.rotations import rotation_matrices, unit_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Splats
from gsfw.formats.stored_rows import MAX_COORDINATE

Matrix = Float64[np.ndarray, "4 4"]

MOST_NODES = 20_000
UNIFORM = 1e-6
"""Relative difference of axes that float32 transforms have by rounding."""


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


def place(splats: Splats, matrix: Matrix, where: str) -> Splats:
    """Splats after an affine transform; SH colours turn with its rotation.

    Args:
        splats: in quats and scales form, float64.
        matrix: the transform, in the frame of the splats.
        where: the mesh, for messages.

    Raises:
        DataError: the transform is beyond float32, mirrors, or makes flat.
    """
    if np.array_equal(matrix, np.eye(4)):
        return splats
    if not np.abs(matrix).max() <= MAX_COORDINATE:  # NaN is refused too.
        raise DataError(
            f"{where}: the transforms of its nodes are beyond {MAX_COORDINATE:.2g}, where float32 "
            "ends.",
            "Apply the transforms in the tool that made the file.",
        )
    linear, moved = torch.from_numpy(matrix[:3, :3]), torch.from_numpy(matrix[:3, 3])
    if not float(linear.det()) > 0:
        raise DataError(
            f"{where}: its node mirrors it, or makes it flat, which no splats can be drawn with.",
            "Apply the transform in the tool that made the file.",
        )
    left, stretches, right = torch.linalg.svd(linear)
    rotation, scale = left @ right, float(stretches.mean())
    if float(stretches.max() - stretches.min()) <= UNIFORM * scale:
        return transform_splats(splats, Similarity(scale, rotation, moved))
    turned = transform_splats(splats, Similarity(rotation=rotation))
    assert splats.quats is not None and splats.scales is not None  # noqa: PT018
    axes = linear @ unit_matrices(splats.quats) * splats.scales[:, None]
    stretched = replace(
        turned,
        means=splats.means @ linear.T + moved,
        quats=None,
        scales=None,
        covariances=axes @ axes.mT,
    )
    return with_axes(stretched)

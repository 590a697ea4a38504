"""Placement: splats of files that put them into a scene by transforms of nodes or prims."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64

from gsfw.core.errors import DataError
from gsfw.core.maths.frame import transform_splats, with_axes
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Splats
from gsfw.formats.stored_rows import MAX_COORDINATE, StoredRows, activated

Matrix = Float64[np.ndarray, "4 4"]

UNIFORM = 1e-6
"""Relative difference of axes that float32 transforms have by rounding."""


def placed(path: Path, rows: StoredRows, matrix: Matrix, where: str) -> tuple[Splats, int]:
    """The splats of stored values after an affine transform, and the number of dropped rows.

    Rows are dropped that are not finite, before or after the transform. SH colours turn with its
    rotation.

    Args:
        path: the file, for messages.
        rows: rows of the file.
        matrix: the transform, in the frame of the rows.
        where: the node or prim, for messages.

    Raises:
        DataError: no row is finite, or the transform is beyond float32, mirrors, or makes flat.
    """
    # Numbers of damaged files that are no numbers give rows that are dropped.
    with np.errstate(over="ignore", invalid="ignore"):
        splats, _ = activated(path, rows)
    moved = _moved(splats, matrix, f"{path}: {where}")
    held = moved.held_by_float32()
    if not held.any():
        raise DataError(
            f"{path} contains no splats: the transforms of {where} move all of its rows beyond "
            "float32.",
            "Apply the transforms in the tool that made the file.",
        )
    kept = moved if held.all() else moved.take(held.nonzero()[:, 0])
    return kept, len(rows) - len(kept)


def _moved(splats: Splats, matrix: Matrix, where: str) -> Splats:
    """Splats after an affine transform; SH colours turn with its rotation.

    Args:
        splats: in quats and scales form, float64.
        matrix: the transform, in the frame of the splats.
        where: the file and the place in it, for messages.

    Raises:
        DataError: the transform is beyond float32, mirrors, or makes flat.
    """
    if np.array_equal(matrix, np.eye(4)):
        return splats
    if not np.abs(matrix).max() <= MAX_COORDINATE:  # NaN is refused too.
        raise DataError(
            f"{where}: its transforms are beyond {MAX_COORDINATE:.2g}, where float32 ends.",
            "Apply the transforms in the tool that made the file.",
        )
    linear, moved = torch.from_numpy(matrix[:3, :3]), torch.from_numpy(matrix[:3, 3])
    if not float(linear.det()) > 0:
        raise DataError(
            f"{where}: its transform mirrors it, or makes it flat, which no splats can be drawn "
            "with.",
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

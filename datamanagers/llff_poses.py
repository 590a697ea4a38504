"""poses_bounds.npy: the cameras of LLFF (Mildenhall et al. 2019), one row of 17 numbers each.

A row is a 3x5 matrix [R | t | (h, w, f)] camera-to-world, whose axes are down, right and back, then
the nearest and the farthest depth. The principal point is the middle of the picture.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import from_center

FILE = "poses_bounds.npy"


def read_rows(file: Path) -> Float64[np.ndarray, "v 17"]:
    """The rows of a poses_bounds.npy.

    Raises:
        DataError: it does not hold them.
    """
    try:
        table = np.load(file, allow_pickle=False)
        rows = table.astype(np.float64)
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{file} cannot be read: {error}", "Copy it again.") from error
    if rows.ndim != 2 or rows.shape[1] != 17 or len(rows) == 0:
        raise DataError(
            f"{file} holds numbers of the shape {list(rows.shape)}.",
            "Expected one row of 17 numbers for each camera, as LLFF writes them.",
        )
    return rows


def row_camera(row: Float64[np.ndarray, " 17"], where: str) -> tuple[Lens, Float64[Tensor, "4 4"]]:
    """The lens of a row, and its camera's pose (world-to-camera, OpenCV axes).

    Raises:
        DataError: the numbers are not those of a camera; begins with ``where``.
    """
    pose = torch.from_numpy(row[:15].reshape(3, 5))
    height, width, focal = pose[:, 4].tolist()
    if not np.isfinite([height, width]).all():
        raise DataError(f"{where}: its size is {width:g}x{height:g} pixels.", "Copy it again.")
    lens = Lens(focal, focal, width / 2, height / 2, round(width), round(height), where)
    lens.check()
    down, right, back = pose[:, 0], pose[:, 1], pose[:, 2]
    rotation = torch.stack([right, down, -back])
    return lens, from_center(rotation, pose[:, 3], where)

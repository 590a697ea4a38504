"""PLY files of points, to start from."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64, Num
from plyfile import PlyData, PlyElement
from torch import Tensor

from gsfw.core.errors import DataError

Points = tuple[Float64[Tensor, "p 3"], Float[Tensor, "p 3"]]


def read_ply(path: Path, setting: str) -> Points:
    """Points, and their colours in [0, 1]; grey where the file has none.

    Args:
        path: the file.
        setting: what names it, for messages.

    Raises:
        DataError: it does not hold points.
    """
    try:
        vertices = PlyData.read(path)["vertex"]
        points = _columns(vertices, "xyz").astype(np.float64)
        colors = np.full(points.shape, 0.5)
        if "red" in vertices.data.dtype.names:
            colors = _columns(vertices, ("red", "green", "blue"))
            colors = colors / 255 if colors.dtype == np.uint8 else colors.clip(0, 1)
    except Exception as error:  # plyfile raises whatever a broken file makes it.
        raise DataError(
            f"{path} does not hold points: {error}",
            f"Expected a PLY with x, y, z; remove {setting} to train without points.",
        ) from error
    return check_points(torch.from_numpy(points), torch.from_numpy(colors).float(), path)


def check_points(
    points: Float64[Tensor, "p 3"], colors: Float[Tensor, "p 3"], path: Path
) -> Points:
    """The points and colours as they are.

    Raises:
        DataError: some are not finite.
    """
    if not (points.isfinite().all() and colors.isfinite().all()):
        raise DataError(f"{path}: some of its points are not finite.", "Remove them.")
    return points, colors


def _columns(vertices: PlyElement, names: Iterable[str]) -> Num[np.ndarray, "p 3"]:
    return np.stack([np.asarray(vertices[name]) for name in names], axis=1)

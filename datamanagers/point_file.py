"""PLY files of points, to start from."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64, Num
from plyfile import PlyData, PlyElement
from torch import Tensor

from gsfw.core.errors import DataError

COLORS = ("red", "green", "blue")
Points = tuple[Float64[Tensor, "p 3"], Float[Tensor, "p 3"]]


def read_points(path: Path, setting: str) -> Points:
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
            colors = _columns(vertices, COLORS)
            colors = colors / 255 if colors.dtype == np.uint8 else colors.clip(0, 1)
    except Exception as error:  # plyfile raises whatever a broken file makes it.
        raise DataError(
            f"{path} does not hold points: {error}",
            f"Expected a PLY with x, y, z; remove {setting} to train without points.",
        ) from error
    return check_points(torch.from_numpy(points), torch.from_numpy(colors).float(), path)


def ply_of(points: Float64[Tensor, "p 3"], colors: Float[Tensor, "p 3"]) -> bytes:
    """A file of positions in double precision, and colours in [0, 1] as 8 bits."""
    layout = [(axis, "<f8") for axis in "xyz"] + [(name, "u1") for name in COLORS]
    vertices = np.zeros(len(points), np.dtype(layout))
    stored = (colors.clamp(0, 1) * 255).round().byte()
    for number, (axis, name) in enumerate(zip("xyz", COLORS, strict=True)):
        vertices[axis] = points[:, number].numpy()
        vertices[name] = stored[:, number].numpy()
    buffer = io.BytesIO()
    PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(buffer)
    return buffer.getvalue()


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

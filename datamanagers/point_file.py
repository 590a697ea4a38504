"""PLY files of points, to start from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.color_bytes import color_bytes
from gsfw.core.errors import DataError
from gsfw.core.files.ply_file import ply_header, read_ply_header

AXES, COLORS = ("x", "y", "z"), ("red", "green", "blue")
Points = tuple[Float64[Tensor, "p 3"], Float[Tensor, "p 3"]]


def read_points(path: Path, setting: str) -> Points:
    """Points, and their colours in [0, 1]; grey where the file has none.

    Args:
        path: the file.
        setting: the setting that names the file, for messages.

    Raises:
        DataError: it does not hold points.
    """
    try:
        points, colors = _vertices(path)
    except DataError as error:
        remedy = f"Expected a PLY with x, y, z; remove {setting} to train without points."
        raise DataError(error.message, remedy) from error
    return check_points(torch.from_numpy(points), torch.from_numpy(colors).float(), path)


def ply_of(points: Float64[Tensor, "p 3"], colors: Float[Tensor, "p 3"]) -> bytes:
    """A file of positions in double precision, and colours in [0, 1] as 8 bits."""
    kinds = [*(("double", axis) for axis in AXES), *(("uchar", name) for name in COLORS)]
    header = ply_header((), {"vertex": (len(points), kinds)})
    layout = [("position", "<f8", 3), ("color", "u1", 3)]
    vertices = np.empty(len(points), np.dtype(layout))
    vertices["position"] = points.numpy()
    vertices["color"] = color_bytes(colors).numpy()
    return header + vertices.tobytes()


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


def _vertices(path: Path) -> tuple[Float64[np.ndarray, "p 3"], Float64[np.ndarray, "p 3"]]:
    """Positions, and colours in [0, 1]; grey where the file has none.

    Raises:
        DataError: the file is damaged, or contains no points.
    """
    header = read_ply_header(path)
    names = header.names("vertex")
    colored = "red" in names
    missing = [name for name in (*AXES, *(COLORS if colored else ())) if name not in names]
    if missing:
        raise DataError(f"{path} does not hold points: it has no vertices with {missing[0]}.")
    vertices, parts = header.elements["vertex"], header.rows("vertex")
    points, colors = np.empty((vertices.count, 3)), np.full((vertices.count, 3), 0.5)
    end = 0
    with np.errstate(invalid="ignore"):  # What is not finite is refused afterwards.
        for rows in parts:
            first, end = end, end + len(rows)
            for column, (axis, channel) in enumerate(zip(AXES, COLORS, strict=True)):
                points[first:end, column] = rows[axis]
                if colored:
                    colors[first:end, column] = rows[channel]
    if colored:
        colors = colors / 255 if vertices.kinds["red"] == "u1" else colors.clip(0, 1)
    return points, colors

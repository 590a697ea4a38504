"""DepthMap: the measured depths of a picture, as files beside it have them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from gsfw.core.errors import DataError
from gsfw.datamanagers.area import shrink_values
from gsfw.datamanagers.pictures import Header, decode_numbers
from gsfw.datamanagers.warp import Warp

KNOWN = 0.5
"""Least part of a shrunk pixel whose depth has to be known."""


@dataclass(frozen=True)
class DepthMap:
    """A file of depths along the camera's axis (z); 0 where unknown."""

    path: Path
    unit: float
    """What its numbers are multiplied by to be in units of the data's world."""

    def load(
        self, header: Header, width: int, height: int, warp: Warp | None
    ) -> Float32[np.ndarray, "h w"]:
        """The depths of an undistorted and shrunk picture, in units of the data's world.

        Depths are never mixed with unknown ones, nor across sizes: a map of another size than its
        picture gives each pixel the nearest of its own.

        Args:
            header: of the picture.
            width: of the picture that is asked for.
            height: likewise.
            warp: what undistorts the picture.

        Raises:
            DataError: the file does not decode, or its shape is not the picture's.
        """
        depths = self._read()
        if abs(depths.shape[1] * header.height - depths.shape[0] * header.width) > max(
            header.height, header.width
        ):
            raise DataError(
                f"{self.path}: the depths are {depths.shape[1]}x{depths.shape[0]}, their picture "
                f"is {header}.",
                "A depth map needs the shape of its (upright) picture; its size may be another.",
            )
        rows = (np.arange(header.height) + 0.5) * depths.shape[0] / header.height
        columns = (np.arange(header.width) + 0.5) * depths.shape[1] / header.width
        depths = depths[rows.astype(np.int64)[:, None], columns.astype(np.int64)]
        if warp is not None:
            depths = warp.nearest(depths)
        known = (depths > 0).astype(np.float32)
        means = shrink_values(np.stack([depths, known], axis=2), width, height)
        return np.where(means[..., 1] >= KNOWN, means[..., 0] / means[..., 1].clip(1e-6), 0)

    def _read(self) -> Float32[np.ndarray, "h w"]:
        if self.path.suffix.lower() != ".npy":
            values = decode_numbers(self.path)
        else:
            try:
                values = np.squeeze(np.load(self.path, allow_pickle=False)).astype(np.float32)
            except (OSError, ValueError, EOFError) as error:
                raise DataError(f"{self.path} cannot be read: {error}", "Copy it again.") from error
        if values.ndim != 2 or values.size == 0:
            raise DataError(
                f"{self.path} holds numbers of the shape {list(values.shape)}.",
                "Expected one depth for each pixel.",
            )
        depths = self.unit * values
        return np.where(np.isfinite(depths) & (depths > 0), depths, 0).astype(np.float32)

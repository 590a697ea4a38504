"""Values of a field of Gaussians at one time, in the axes of a stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float32, Float64

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import MotionFile
from gsfw.core.maths.axes import stated_axis, turned_to_y
from gsfw.core.maths.frame import in_frame
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.motion.evaluation import all_splats_at, in_world
from gsfw.formats.stored_rows import StoredRows, stored_parts

REACH = 3.0
"""Standard deviations of a Gaussian that the extent contains, as UsdVol describes the kernel."""
FLOAT32 = 2.0**-24
"""Largest relative rounding error of float32."""
UNSEEN = 0.01
"""Rounding of positions that nobody sees, as a part of the median scale."""


@dataclass(frozen=True)
class FieldValues:
    """Values of ``n`` Gaussians at one time."""

    positions: Float32[np.ndarray, "n 3"]
    orientations: Float32[np.ndarray, "n 4"]
    """Unit quaternions, xyzw, as arrays of USD hold them."""
    scales: Float32[np.ndarray, "n 3"]
    """Standard deviations along the axes of each Gaussian."""
    opacities: Float32[np.ndarray, " n"]
    extent: Float32[np.ndarray, "2 3"]
    """Lowest and highest corner of a box around all Gaussians."""


def upright(
    file: MotionFile, cameras: Sequence[Cameras]
) -> tuple[MotionFile, Sequence[Cameras], str]:
    """The file and cameras in axes of a stage, and which of them is up: "Y" or "Z".

    Worlds with y or z up keep their axes. Others are turned; one of which nothing is known as
    COLMAP's, in which y leads down.
    """
    up = stated_axis(file.content.up).removeprefix("+")
    if up in ("y", "z"):
        return file, cameras, up.upper()
    turn = Similarity(rotation=turned_to_y(up))
    return in_world(file, turn), [in_frame(camera, turn) for camera in cameras], "Y"


def origin_of(file: MotionFile) -> Float64[np.ndarray, " 3"]:
    """A point near all splats, if float32 would round their positions; else 0.

    Georeferenced worlds have coordinates of millions, which float32 holds to half a unit.
    """
    splats = file.content.splats
    if not len(splats) or splats.scales is None:
        return np.zeros(3)
    rounding = float(splats.means.abs().max()) * FLOAT32
    if rounding <= UNSEEN * float(splats.scales.median()):
        return np.zeros(3)
    return splats.means.median(dim=0).values.round().numpy()


def field_values(file: MotionFile, time: float, origin: Float64[np.ndarray, " 3"]) -> FieldValues:
    """The values at a time in [0, 1], with positions relative to a point, without colours.

    Raises:
        ValueError: a value is not finite, or out of range; names the field and the row; or there
            are no splats.
    """
    splats = file.content.splats if file.is_still else all_splats_at(file, time)
    stored = StoredRows.cat(list(stored_parts(splats.up_to(0))))
    stored = replace(stored, means=stored.means - origin)
    scales = np.exp(stored.log_scales)
    return FieldValues(
        positions=stored.means.astype(np.float32),
        orientations=np.roll(stored.quats, -1, axis=1),
        scales=scales,
        opacities=stored.opacities.astype(np.float32),
        extent=_extent(stored, scales),
    )


def coefficients_of(file: MotionFile) -> Float32[np.ndarray, "n k 3"]:
    """The SH coefficients of all Gaussians, which are the same at all times.

    Raises:
        ValueError: one is not finite; names the row; or there are no splats.
    """
    parts = stored_parts(file.content.splats)
    return np.concatenate([np.concatenate([part.dc[:, None], part.rest], axis=1) for part in parts])


def _extent(stored: StoredRows, scales: Float32[np.ndarray, "n 3"]) -> Float32[np.ndarray, "2 3"]:
    """The box around the ellipsoids of ``REACH`` standard deviations."""
    axes = unit_matrices(torch.from_numpy(stored.quats)).numpy()
    reach = REACH * np.sqrt(((axes * scales[:, None]) ** 2).sum(axis=2))
    low, high = (stored.means - reach).min(axis=0), (stored.means + reach).max(axis=0)
    return np.stack([low, high]).astype(np.float32)

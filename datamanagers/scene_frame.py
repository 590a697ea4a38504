"""The scene frame: the world of the data, moved and scaled to lie around the origin at size 1."""

from __future__ import annotations

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import DataError
from gsfw.core.maths.similarity import Similarity

EXTENT_FACTOR = 1.1
"""Margin around the training cameras (``getNerfppNorm`` of Kerbl et al. 2023's code)."""
COINCIDENT = 1e-12
"""Camera positions nearer than this fraction of their coordinates differ by rounding only."""
LARGEST = 1e15
"""Largest coordinate: beyond it float64 does not resolve a tenth of a unit."""


def camera_centers(world_to_camera: Float64[Tensor, "v 4 4"]) -> Float64[Tensor, "v 3"]:
    """Positions of rigid cameras in their world."""
    rotation, translation = world_to_camera[:, :3, :3], world_to_camera[:, :3, 3]
    return -(rotation.transpose(1, 2) @ translation[:, :, None])[:, :, 0]


def scene_frame(
    world_to_camera: Float64[Tensor, "v 4 4"],
    points: Float64[Tensor, "p 3"],
    held_out: Float64[Tensor, "h 4 4"] | None = None,
) -> tuple[Similarity, float]:
    """The similarity from the world of the data to the scene frame, and the extent there.

    The frame is moved and scaled uniformly, never rotated: its origin is the mean of the camera
    centres, and the extent (1.1 times the largest distance of a camera from their mean) becomes 1.
    Cameras that all stand at one place say nothing about size; then the median distance of the
    points from there becomes 1, and without points the scale stays the data's own.

    Args:
        world_to_camera: rigid transforms of the training views; at least one.
        points: surface points of the world; may be none.
        held_out: rigid transforms of other views, whose coordinates are checked alone.

    Raises:
        DataError: coordinates are too large to compute with.
    """
    centers = camera_centers(world_to_camera)
    others = points[:0] if held_out is None else camera_centers(held_out)
    reach = float(torch.cat([centers, others, points]).abs().max())
    if not reach <= LARGEST:  # Not a number, where the largest ones are subtracted.
        raise DataError(
            f"coordinates of cameras or points reach {reach:.3g}; expected at most {LARGEST:g}.",
            "The file may be damaged; if not, scale its coordinates down.",
        )
    origin = centers.mean(dim=0)
    size = EXTENT_FACTOR * float((centers - origin).norm(dim=1).max())
    if size <= COINCIDENT * float(centers.abs().max()):
        distances = (points - origin).norm(dim=1)
        size = float(distances.median()) if len(points) else 0.0
    scale = 1.0 / size if size > 0 else 1.0
    return Similarity(scale=scale, translation=-scale * origin), 1.0

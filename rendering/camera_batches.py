"""Camera batches: cameras of a user's own, joined, grouped by time, and moved between frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.maths.similarity import Similarity


def one_batch(cameras: Cameras | Sequence[Cameras]) -> Cameras:
    """All cameras in one batch.

    Raises:
        ConfigError: there are none, they differ in size or model, or something else was given.
    """
    if isinstance(cameras, Cameras):
        return cameras
    items = cameras if isinstance(cameras, Sequence) and not isinstance(cameras, str) else [cameras]
    for item in items:
        if not isinstance(item, Cameras):
            raise ConfigError(
                f"cameras: expected Cameras, found {type(item).__name__}.",
                "model.camera_path('orbit'), model.cameras() and Cameras.look_at make them.",
            )
    if len(cameras) == 0:
        raise ConfigError("render: expected at least one camera, found none.")
    try:
        return Cameras.cat(list(cameras))
    except ValueError as error:
        raise ConfigError(
            f"render: {error}.", "Render them one at a time: [render(it, camera) for camera in ...]"
        ) from None


def in_frame(cameras: Cameras, frame: Similarity) -> Cameras:
    """The cameras in the frame that a similarity leads to, float64, on the CPU."""
    cameras = cameras.to("cpu", torch.float64)
    intrinsics = cameras.intrinsics.clone()
    if cameras.model is CameraModel.ORTHOGRAPHIC:  # In pixels per unit of length.
        intrinsics[:, [0, 1], [0, 1]] /= frame.scale
    poses = frame.camera(cameras.world_to_camera)
    return replace(cameras, world_to_camera=poses, intrinsics=intrinsics)

"""Stereo: the images of two eyes, side by side, the left one at the left."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.rendering.panorama import Shoot

PART_OF_DISTANCE = 30
"""Distance of what is looked at, over that of the eyes: the rule of thumb of stereo photographers,
at which near things are still seen as one."""


def eye_distance(camera: Cameras, target: Float[Tensor, " 3"]) -> float:
    """A distance of the eyes that suits what is looked at, in scene units."""
    return float((camera.centers[0].double() - target).norm()) / PART_OF_DISTANCE


def stereo_images(shoot: Shoot, camera: Cameras, distance: float) -> list[Tensor]:
    """Each channel of both eyes as one image, twice as wide; the axes of the eyes are parallel.

    Args:
        shoot: renders the channels of one camera.
        camera: between the eyes.
        distance: of the eyes, in scene units.
    """
    eyes = [shoot(_moved(camera, side * distance / 2)) for side in (-1, 1)]
    return [torch.cat([left, right], dim=1) for left, right in zip(*eyes, strict=True)]


def _moved(camera: Cameras, shift: float) -> Cameras:
    """A camera further to its right."""
    pose = camera.world_to_camera.clone()
    pose[:, 0, 3] -= shift
    return replace(camera, world_to_camera=pose)

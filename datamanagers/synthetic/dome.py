"""The dome of cameras that look at the built-in scene."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.maths.camera_path import look_at

TARGET = (0.0, 0.0, 0.1)
"""Target of the cameras, in the world; z is up."""
DISTANCE = 4.6
"""Distance of every camera from the target, in world units."""
ELEVATIONS = (15.0, 65.0)
"""Lowest and highest camera, in degrees above the table."""
FIELD_OF_VIEW = 50.0
"""Across the wider side of an image, in degrees: the whole table fits."""
GOLDEN = (math.sqrt(5) - 1) / 2
"""Turns from one camera to the next, so that any few in a row surround the scene."""
HELD_OUT = 0.25
"""First number of the held-out cameras: between those of training, 6 to 9 degrees from them."""


def dome(count: int, first: float, width: int, height: int, seed: int) -> Cameras:
    """Cameras on a dome around the scene, in the world, in float64.

    Neighbours in the order are far apart in direction and in height.

    Args:
        count: how many.
        first: number of the first one; the others follow in steps of 1.
        width: of the image, in pixels.
        height: of the image, in pixels.
        seed: turns the dome.
    """
    generator = torch.Generator().manual_seed(seed)
    start = torch.rand(2, generator=generator, dtype=torch.float64)
    number = first + torch.arange(count, dtype=torch.float64)
    azimuth = 2 * math.pi * (start[0] + GOLDEN * number)
    low, high = (math.sin(math.radians(angle)) for angle in ELEVATIONS)
    # Equal areas of a sphere have equal heights; sqrt(3) is another irrational turn.
    rise = low + (high - low) * ((start[1] + math.sqrt(3) * number) % 1)
    level = (1 - rise.square()).sqrt()
    target = torch.tensor(TARGET, dtype=torch.float64)
    offsets = torch.stack([level * azimuth.cos(), level * azimuth.sin(), rise], dim=1)
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    poses = look_at(target + DISTANCE * offsets, target, up)
    return Cameras(poses, _intrinsics(width, height).expand(count, 3, 3), width, height)


def _intrinsics(width: int, height: int) -> Float[Tensor, "1 3 3"]:
    focal = 0.5 * max(width, height) / math.tan(math.radians(FIELD_OF_VIEW) / 2)
    matrix = [[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]
    return torch.tensor([matrix], dtype=torch.float64)

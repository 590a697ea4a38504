"""Regions: parts of space that say which points are inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras


@dataclass(frozen=True)
class Box:
    """A box along the axes; its faces are inside."""

    corner: tuple[float, float, float]
    """One corner, in the units of the points."""
    opposite: tuple[float, float, float]
    """The opposite corner."""

    def contains(self, points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """True for points inside."""
        ends = torch.tensor([self.corner, self.opposite]).to(points)
        return ((points >= ends.amin(0)) & (points <= ends.amax(0))).all(1)


@dataclass(frozen=True)
class Sphere:
    """A ball; its surface is inside."""

    center: tuple[float, float, float]
    """In the units of the points."""
    radius: float
    """Not negative."""

    def contains(self, points: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """True for points inside."""
        return (points - torch.tensor(self.center).to(points)).norm(dim=1) <= self.radius


def num_cameras_around(
    points: Float[Tensor, "n 3"], cameras: Sequence[Cameras]
) -> Int[Tensor, " n"]:
    """Number of cameras in whose image each point lies, in front of the camera.

    What hides a point does not matter: this is the cameras' frustums.

    Args:
        points: in the frame of the cameras.
        cameras: one each (c = 1).
    """
    found = torch.zeros(len(points), dtype=torch.int64, device=points.device)
    for camera in cameras:
        found += _in_image(points, camera.to(points.device, torch.float64))
    return found


def _in_image(points: Float[Tensor, "n 3"], camera: Cameras) -> Bool[Tensor, " n"]:
    pose, lens = camera.world_to_camera[0], camera.intrinsics[0]
    seen = points.double() @ pose[:3, :3].T + pose[:3, 3]
    depths, across = seen[:, 2], seen[:, :2]
    if camera.model is CameraModel.FISHEYE:
        radii = across.norm(dim=1).clamp_min(1e-12)
        across = across * (torch.atan2(radii, depths) / radii)[:, None]
    elif camera.model is CameraModel.PINHOLE:
        across = across / depths.clamp_min(1e-12)[:, None]
    pixels = across * lens.diagonal()[:2] + lens[:2, 2]
    size = pixels.new_tensor([camera.width, camera.height])
    return (depths > 0) & (pixels >= 0).all(1) & (pixels <= size).all(1)

"""Camera paths: viewpoints that have no photo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Float64
from torch import Tensor

from gsfw.core.cameras import Cameras

CLOSED_GAP = math.pi / 2
"""Cameras surround the scene if no gap between neighbours is wider than this, in radians."""

MIN_SPREAD = 1e-3
"""Least eigenvalue (per camera) below which viewing axes count as parallel."""

MOST_HEIGHTS = (0.05, 0.95)
"""Part of the cameras below the lowest and the highest place of a spiral."""

SPIRAL_REACH = 0.9
"""Part of the cameras within the circles of a spiral before a scene (LLFF has the same)."""


def viewing_center(cameras: Cameras) -> Float[Tensor, " 3"]:
    """The point nearest to all viewing axes, in the least-squares sense; float64, scene units.

    For nearly parallel axes: the point at distance 1 in front of the mean camera.
    """
    centers = cameras.centers.double()
    axes = cameras.world_to_camera[:, 2, :3].double()
    across = torch.eye(3, dtype=torch.float64) - axes[:, :, None] * axes[:, None, :]
    matrix = across.mean(0)
    if float(torch.linalg.eigvalsh(matrix)[0]) < MIN_SPREAD:
        return centers.mean(0) + axes.mean(0)
    return torch.linalg.solve(matrix, (across @ centers[:, :, None]).mean(0)[:, 0])


def up_direction(cameras: Cameras) -> Float[Tensor, " 3"]:
    """The mean of the cameras' upward directions, unit length, float64."""
    up = -cameras.world_to_camera[:, 1, :3].double().mean(0)
    length = float(up.norm())
    return up / length if length > 1e-6 else torch.tensor([0.0, -1.0, 0.0], dtype=torch.float64)


def look_at(
    centers: Float[Tensor, "c 3"], target: Float[Tensor, " 3"], up: Float[Tensor, " 3"]
) -> Float[Tensor, "c 4 4"]:
    """World-to-camera transforms at ``centers`` that look at ``target`` with ``up`` upwards.

    Raises:
        ValueError: a camera is at the target, or looks along ``up``.
    """
    forward = target - centers
    right = torch.linalg.cross(forward, up.expand_as(forward))
    if bool((forward.norm(dim=1) < 1e-12).any()) or bool((right.norm(dim=1) < 1e-12).any()):
        raise ValueError("a camera cannot look at its own position, nor straight along up")
    forward = forward / forward.norm(dim=1, keepdim=True)
    right = right / right.norm(dim=1, keepdim=True)
    down = torch.linalg.cross(forward, right)
    pose = torch.eye(4, dtype=centers.dtype).repeat(len(centers), 1, 1)
    pose[:, :3, :3] = torch.stack([right, down, forward], dim=1)
    pose[:, :3, 3] = -(pose[:, :3, :3] @ centers[:, :, None])[:, :, 0]
    return pose


def covered_arc(angles: Float64[Tensor, " c"]) -> tuple[float, float]:
    """Start and length, in radians, of the arc that contains ``angles``.

    The largest gap between neighbours is left out; below ``CLOSED_GAP`` the arc is a full circle.
    """
    ordered = angles.sort().values
    gaps = torch.cat([ordered[1:], ordered[:1] + 2 * math.pi]) - ordered
    widest = int(gaps.argmax())
    if float(gaps[widest]) < CLOSED_GAP:
        return 0.0, 2 * math.pi
    return float(ordered[(widest + 1) % len(ordered)]), 2 * math.pi - float(gaps[widest])


@dataclass(frozen=True)
class _Ring:
    """The cameras as a ring around the scene; all float64."""

    target: Float[Tensor, " 3"]
    """The viewing centre."""
    up: Float[Tensor, " 3"]
    first: Float[Tensor, " 3"]
    """Unit vector across ``up``, at angle 0."""
    second: Float[Tensor, " 3"]
    """Unit vector at a right angle to both."""
    radius: float
    """Mean distance from the axis."""
    heights: Float[Tensor, " c"]
    """Height of the cameras above the target."""
    start: float
    """Angle where the covered arc begins."""
    span: float
    """Length of the covered arc; a full circle if the cameras surround the scene."""

    @property
    def is_closed(self) -> bool:
        """True if the cameras surround the scene."""
        return self.span >= 2 * math.pi

    def around(
        self, angles: Float[Tensor, " f"], heights: Float[Tensor, " f"]
    ) -> Float[Tensor, "f 4 4"]:
        """Poses on the ring that look at the target."""
        circle = angles.cos()[:, None] * self.first + angles.sin()[:, None] * self.second
        places = self.target + self.radius * circle + heights[:, None] * self.up
        return look_at(places, self.target, self.up)


def _ring(cameras: Cameras) -> _Ring:
    target, up = viewing_center(cameras), up_direction(cameras)
    offsets = cameras.centers.double() - target
    heights = offsets @ up
    level = offsets - heights[:, None] * up
    first = level[0] if float(level[0].norm()) > 1e-9 else torch.linalg.cross(up, up.roll(1))
    first = first / first.norm()
    second = torch.linalg.cross(up, first)
    start, span = covered_arc(torch.atan2(level @ second, level @ first))
    radius = max(float(level.norm(dim=1).mean()), 1e-3)
    return _Ring(target, up, first, second, radius, heights, start, span)


def orbit(cameras: Cameras, frames: int) -> Cameras:
    """Orbit around the viewing centre of ``cameras``, at their mean height, distance and arc.

    A full circle if the cameras surround the scene; otherwise to and fro along their arc, since the
    rest is unseen. Lens and image size are those of the first camera.
    """
    ring = _ring(cameras)
    turns = torch.arange(frames, dtype=torch.float64) * (2 * math.pi / frames)
    angles = turns if ring.is_closed else ring.start + ring.span * (1 - turns.cos()) / 2
    heights = ring.heights.mean().expand(frames)
    return posed(cameras, ring.around(angles, heights))


def spiral(cameras: Cameras, frames: int) -> Cameras:
    """A spiral of two turns that shows a scene from all heights of ``cameras``.

    Around the scene if they surround it, from their lowest to their highest; otherwise circles
    before their mean place that come nearer and go back (Mildenhall et al. 2019, LLFF). Lens and
    image size are those of the first camera.
    """
    ring = _ring(cameras)
    turns = torch.arange(frames, dtype=torch.float64) * (4 * math.pi / frames)
    if ring.is_closed:
        low, high = torch.quantile(ring.heights, ring.heights.new_tensor(MOST_HEIGHTS))
        # Up and down again, so that the film can be repeated.
        return posed(cameras, ring.around(turns, low + (high - low) * (1 - (turns / 2).cos()) / 2))
    centers = cameras.centers.double()
    middle = centers.mean(0)
    axes = look_at(middle[None], ring.target, ring.up)[0, :3, :3]
    reach = torch.quantile(((centers - middle) @ axes.T).abs(), SPIRAL_REACH, dim=0)
    waves = torch.stack([turns.cos(), turns.sin(), (turns / 2).cos()], dim=1)
    return posed(cameras, look_at(middle + (waves * reach) @ axes, ring.target, ring.up))


def posed(cameras: Cameras, poses: Float[Tensor, "f 4 4"]) -> Cameras:
    """Cameras with the lens and size of the first one at other poses (world to camera)."""
    return replace(
        cameras.select([0]),
        world_to_camera=poses.to(cameras.world_to_camera),
        intrinsics=cameras.intrinsics[:1].expand(len(poses), 3, 3),
        time=None,
        camera_index=None,
    )


def gathered(cameras: Sequence[Cameras]) -> Cameras:
    """The poses of all cameras, with the lens and size of the first one; on the CPU."""
    poses = torch.cat([camera.world_to_camera.detach().cpu() for camera in cameras])
    return posed(cameras[0].to("cpu"), poses)


def at_times(cameras: Cameras, times: Sequence[float]) -> Cameras:
    """The cameras, each at its time in [0, 1]; a single camera is repeated for all of them."""
    count = len(times)
    if len(cameras) == 1:
        cameras = cameras.select([0] * count)
    time = torch.tensor(times).to(cameras.world_to_camera)
    return replace(cameras, time=time)

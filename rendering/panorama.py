"""Panorama: an equirectangular image of all directions, from six cameras and a resampling.

Splatting is made for pinhole cameras. The six faces of a cube reach a little over its edges, and
fade into one another there: the projection of a Gaussian differs from face to face, and an edge
would be seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import grid_sample

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.rendering.channels import Channel

REACH = 1.12
"""Half of the side of a face, at distance 1: 1 would be the cube itself."""

FACES = ((0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (1.5, 0.0), (0.0, 0.5), (0.0, -0.5))
"""Turn about the vertical and about the horizontal axis of each face, in units of pi."""

Shoot = Callable[[Cameras], Sequence[Tensor]]
"""Renders the channels of one camera."""


def panorama_width(camera: Cameras) -> int:
    """Width of a panorama of the resolution of a camera, in pixels; even."""
    return max(2 * round(math.pi * float(camera.intrinsics[0, 0, 0])), 4)


def panorama_images(
    shoot: Shoot,
    channels: Sequence[Channel],
    camera: Cameras,
    width: int,
    up: Float[Tensor, " 3"] | None = None,
) -> list[Tensor]:
    """Images of all directions around a camera, twice as wide as high.

    The middle of the image is where the camera looks, turned to the horizon; the top is up. Depth
    is the distance from the camera, and normals are in the axes of the panorama.

    Args:
        shoot: renders the channels of one pinhole camera.
        channels: what ``shoot`` renders.
        camera: place and direction.
        width: of the images, in pixels.
        up: unit vector, in scene axes; ``None`` for that of the camera.
    """
    level = _level(camera.world_to_camera[0], up)
    directions = _directions(width).to(level)
    sums: list[Tensor] = []
    weights: list[Tensor] = []
    for across, along in FACES:
        turn = _turn(across * math.pi, along * math.pi).to(level)
        face = _face(camera, level, turn, max(width // 4, 1))
        inside, place = _places(directions @ turn.T, face)
        for number, image in enumerate(shoot(face)):
            values, known = _in_panorama(channels[number], image, turn, face)
            found, weight = _sampled(values, known, place, inside)
            if len(sums) == number:
                sums.append(torch.zeros_like(found))
                weights.append(torch.zeros_like(weight))
            sums[number] += found * weight
            weights[number] += weight
    return [
        _finished(channel, total, weight)
        for channel, total, weight in zip(channels, sums, weights, strict=True)
    ]


def _level(pose: Float[Tensor, "4 4"], up: Float[Tensor, " 3"] | None) -> Float[Tensor, "4 4"]:
    """World-to-camera transform at the same place that looks to the horizon."""
    up = -pose[1, :3] if up is None else up.to(pose)
    forward = pose[2, :3] - (pose[2, :3] @ up) * up
    if float(forward.norm()) < 1e-3:  # It looks straight up or down.
        forward = pose[1, :3] - (pose[1, :3] @ up) * up
    forward = forward / forward.norm()
    right = torch.linalg.cross(forward, up)
    rotation = torch.stack([right, -up, forward])
    level = torch.eye(4).to(pose)
    level[:3, :3] = rotation
    level[:3, 3] = rotation @ pose[:3, :3].T @ pose[:3, 3]
    return level


def _directions(width: int) -> Float[Tensor, "h w 3"]:
    """Unit direction of each pixel: x right, y down, z forward."""
    height = max(width // 2, 1)
    longitude = ((torch.arange(width) + 0.5) / width - 0.5) * (2 * math.pi)
    latitude = (0.5 - (torch.arange(height) + 0.5) / height)[:, None] * math.pi
    x, z = latitude.cos() * longitude.sin(), latitude.cos() * longitude.cos()
    return torch.stack([x, -latitude.sin().expand_as(x), z], dim=2)


def _turn(across: float, along: float) -> Float[Tensor, "3 3"]:
    """From the axes of the panorama to those of a face: about y, then about x."""
    c, s = math.cos(across), math.sin(across)
    about_y = torch.tensor([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    c, s = math.cos(along), math.sin(along)
    about_x = torch.tensor([[1, 0, 0], [0, c, s], [0, -s, c]])
    return about_x @ about_y


def _face(
    camera: Cameras, level: Float[Tensor, "4 4"], turn: Float[Tensor, "3 3"], side: int
) -> Cameras:
    """The camera of a face, which has ``side`` pixels from edge to edge of the cube."""
    pose = torch.eye(4).to(level)
    pose[:3] = turn @ level[:3]
    pixels = math.ceil(side * REACH)
    focal, middle = side / 2, pixels / 2
    intrinsics = torch.tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]]).to(level)
    return replace(
        camera,
        world_to_camera=pose[None],
        intrinsics=intrinsics[None],
        width=pixels,
        height=pixels,
        model=CameraModel.PINHOLE,
    )


def _places(
    local: Float[Tensor, "h w 3"], face: Cameras
) -> tuple[Float[Tensor, "h w"], Float[Tensor, "h w 2"]]:
    """Weight of a face at each pixel, 0 beyond it; and the place there, from -1 to 1."""
    depth = local[..., 2]
    ahead = depth > 0.1
    place = local[..., :2] / torch.where(ahead, depth, 1.0)[..., None]
    edge = (REACH - place.abs().amax(2)) / (REACH - 1)
    # Whole pixels reach a little further than REACH.
    reach = face.width / 2 / float(face.intrinsics[0, 0, 0])
    return torch.where(ahead, edge, 0.0).clamp(0, 1), place / reach


def _in_panorama(
    channel: Channel, image: Tensor, turn: Float[Tensor, "3 3"], face: Cameras
) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w 1"]]:
    """Values of a face in the terms of the panorama, and where they are known (1) or not (0)."""
    if channel.kind == "scalar":
        known = image.isfinite()
        values = image.nan_to_num(0.0)
        if channel.name == "depth":
            values = values * _ray_lengths(face).to(values)
        return values[..., None], known[..., None].to(values)
    if channel.name == "normals":
        known = (image.sum(2, keepdim=True) > 0).to(image)
        # Shown with y up and z to the camera; turned with y down and z forward.
        flip = image.new_tensor([1.0, -1.0, -1.0])
        normals = ((2 * image - 1) * flip) @ turn.to(image)
        return 0.5 + 0.5 * normals * flip, known
    return image, torch.ones_like(image[..., :1])


def _ray_lengths(face: Cameras) -> Float[Tensor, "h w"]:
    """Distance of a point at depth 1, for each pixel."""
    side, focal = face.width, float(face.intrinsics[0, 0, 0])
    steps = (torch.arange(side) + 0.5 - side / 2) / focal
    return (1 + steps[None] ** 2 + steps[:, None] ** 2).sqrt()


def _sampled(
    values: Float[Tensor, "s s d"],
    known: Float[Tensor, "s s 1"],
    place: Float[Tensor, "h w 2"],
    inside: Float[Tensor, "h w"],
) -> tuple[Float[Tensor, "h w d"], Float[Tensor, "h w 1"]]:
    """Values of a face at the pixels of the panorama, and their weights."""
    both = torch.cat([values * known, known], dim=2).movedim(2, 0)[None]
    found = grid_sample(both, place[None].to(both), padding_mode="border", align_corners=False)
    found = found[0].movedim(0, 2)
    share = found[..., -1:]
    weight = inside[..., None].to(found) * (share >= 0.5)
    return found[..., :-1] / share.clamp_min(1e-6), weight


def _finished(channel: Channel, total: Tensor, weight: Tensor) -> Tensor:
    mean = total / weight.clamp_min(1e-6)
    if channel.kind == "scalar":
        return torch.where(weight > 0, mean, torch.nan)[..., 0]
    return torch.where(weight > 0, mean, 0.0)

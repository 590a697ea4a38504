"""Views of three coloured balls, for the small trainers."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

SIZE, FIELD, DISTANCE = 32, 0.9, 4.0
BALLS = (((-0.6, 0.0, 0.0), (1.0, 0.2, 0.1)), ((0.5, 0.3, 0.2), (0.1, 0.9, 0.3)))


@dataclass
class Camera:
    """A camera with the original's fields."""

    size: int
    field: float
    world_view_transform: Tensor
    full_proj_transform: Tensor
    camera_center: Tensor


def cameras() -> list[Camera]:
    """Four cameras around the origin."""
    found = []
    for turn in range(4):
        angle = 0.5 * math.pi * turn + 0.3
        view = torch.eye(4)
        view[0, 0] = view[2, 2] = math.cos(angle)
        view[0, 2], view[2, 0] = math.sin(angle), -math.sin(angle)
        view[2, 3] = DISTANCE
        clip = torch.zeros(4, 4)
        clip[0, 0] = clip[1, 1] = 1 / math.tan(0.5 * FIELD)
        clip[2, 2], clip[2, 3], clip[3, 2] = 1.0001, -0.01, 1.0
        centre = view.inverse()[:3, 3]
        found.append(Camera(SIZE, FIELD, view.T, view.T @ clip.T, centre))
    return found


def targets() -> list[Tensor]:
    """The image [3, h, w] of each camera: soft discs, the nearer one in front."""
    y, x = torch.meshgrid(torch.arange(SIZE) + 0.5, torch.arange(SIZE) + 0.5, indexing="ij")
    images = []
    for camera in cameras():
        places = []
        for centre, color in BALLS:
            seen = torch.tensor([*centre, 1.0]) @ camera.world_view_transform
            places.append((float(seen[2]), seen, torch.tensor(color)))
        image = torch.zeros(3, SIZE, SIZE)
        for depth, seen, color in sorted(places, key=lambda place: -place[0]):
            focal = SIZE / (2 * math.tan(0.5 * FIELD))
            u, v = (focal * seen[:2] / depth + SIZE / 2).tolist()
            radius = 0.5 * focal / depth
            cover = torch.sigmoid(2 * (radius - ((x - u) ** 2 + (y - v) ** 2).sqrt()))
            image = color[:, None, None] * cover + image * (1 - cover)
        images.append(image)
    return images

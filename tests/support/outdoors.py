"""A small capture under a sky: a patterned wall in front of it, seen by cameras in a row."""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from gsfw.core.stereo.views import StereoViews

WIDTH, HEIGHT, FOCAL = 48, 36, 40.0
WALL = 3.0
"""Depth of the wall, whose upper edge is in the middle of the images; the sky is above it."""
APART = 0.2
"""Distance of neighbouring cameras, which see the wall 2 radians of its waves further."""


def sky_color(directions: np.ndarray) -> np.ndarray:
    """Smooth colours of unit vectors; y is down."""
    x, y, _ = np.moveaxis(directions, -1, 0)
    return np.stack([0.5 + 0.3 * x, 0.6 - 0.3 * y, 0.9 + 0.05 * x], axis=-1)


def images(count: int, horizon: float = 0.0) -> list[np.ndarray]:
    """Images of cameras at (APART * i, 0, 0) that look along z; the sky is above ``horizon``."""
    column, row = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack(
        [(column - WIDTH / 2) / FOCAL, (row - HEIGHT / 2) / FOCAL, np.ones_like(row)], axis=-1
    )
    sky = sky_color(rays / np.linalg.norm(rays, axis=-1, keepdims=True))
    found = []
    for number in range(count):
        x, y = WALL * rays[..., 0] + APART * number, WALL * rays[..., 1]
        wave = 0.5 + 0.4 * np.sin(2.0 * x / APART + 3.0 * y)
        found.append(np.where(rays[..., 1:2] < horizon, sky, wave[..., None] * [1.0, 0.6, 0.3]))
    return found


def views_of_the_sky(count: int = 8) -> StereoViews:
    poses = torch.eye(4, dtype=torch.float64).repeat(count, 1, 1)
    poses[:, 0, 3] = -APART * torch.arange(count)
    lens = [[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]]
    nothing = torch.zeros(HEIGHT, WIDTH, dtype=torch.bool)
    return StereoViews(
        tuple(torch.from_numpy(image).float() for image in images(count)),
        poses,
        torch.tensor(lens, dtype=torch.float64).repeat(count, 1, 1),
        (nothing,) * count,
        (nothing,) * count,
    )


def write_outdoors(
    folder: Path, count: int = 8, *, times: bool = False, alpha: bool = False, horizon: float = 0.0
) -> Path:
    """Write the capture as a transforms.json."""
    frames = []
    for number, image in enumerate(images(count, horizon)):
        name, pose = f"{number:03}.png", np.diag([1.0, -1.0, -1.0, 1.0])
        pose[0, 3] = APART * number
        pixels = (255 * image + 0.5).astype(np.uint8)
        if alpha:
            pixels = np.concatenate([pixels, np.full_like(pixels[..., :1], 200)], axis=-1)
        Image.fromarray(pixels).save(folder / name)
        time = {"time": number // 2} if times else {}
        frames.append({"file_path": name, "transform_matrix": pose.tolist(), **time})
    lens = {"fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    size = {"w": WIDTH, "h": HEIGHT}
    (folder / "transforms.json").write_text(json.dumps({**lens, **size, "frames": frames}))
    return folder

"""A small room with a ball and two crates, ray-cast as an RGB-D sequence in the TUM format."""

from __future__ import annotations

import math

import numpy as np
from PIL import Image

ROOM = ((-2.0, -1.5, 0.0), (2.0, 1.5, 2.4))
CRATES = (((-0.9, 0.3, 0.0), (-0.3, 0.9, 0.7)), ((0.5, 0.5, 0.0), (1.2, 1.1, 0.45)))
BALL = ((0.15, 0.1, 0.35), 0.35)
DEPTH_SCALE = 5000
RATE = 30.0
"""Images in a second."""


def write_room(folder, frames, width, noise):
    """Write rgb/, depth/, the three lists and intrinsics.txt."""
    height, focal = width * 3 // 4, 0.8 * width
    lens = (focal, focal, width / 2, height / 2)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True)
    lists = {"rgb": [], "depth": [], "groundtruth": []}
    random = np.random.default_rng(0)
    for number in range(frames):
        place, axes = _camera(number / max(frames - 1, 1))
        colors, depth = cast(place, axes, lens, width, height)
        depth = depth * (1 + noise * random.standard_normal(depth.shape))
        time, name = f"{number / RATE:.6f}", f"{number:04d}.png"
        Image.fromarray((255 * colors + 0.5).astype(np.uint8)).save(folder / "rgb" / name)
        stored = (DEPTH_SCALE * depth + 0.5).astype(np.uint16)
        Image.fromarray(stored).save(folder / "depth" / name)
        lists["rgb"].append(f"{time} rgb/{name}")
        lists["depth"].append(f"{time} depth/{name}")
        numbers = (*place, *_quaternion(axes))
        lists["groundtruth"].append(f"{time} {' '.join(f'{value:.9f}' for value in numbers)}")
    for name, lines in lists.items():
        text = "\n".join(["# a synthetic room", *lines, ""])
        (folder / f"{name}.txt").write_text(text, encoding="utf-8")
    (folder / "intrinsics.txt").write_text(" ".join(map(str, lens)), encoding="utf-8")


def _camera(share):
    """Place and axes (rows: right, down, ahead) of the camera at a share of its way."""
    angle = math.radians(-150 + 120 * share)
    place = np.array(
        [1.5 * math.cos(angle), 1.1 * math.sin(angle), 1.3 + 0.3 * math.sin(9 * share)]
    )
    ahead = np.array([0.1, 0.5, 0.6]) - place
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    return place, np.stack([right, np.cross(ahead, right), ahead])


def _quaternion(axes):
    """x, y, z, w of the rotation from camera to world."""
    m = axes.T
    w = math.sqrt(max(1 + m[0, 0] + m[1, 1] + m[2, 2], 1e-12)) / 2
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    return x / (4 * w), y / (4 * w), z / (4 * w), w


def cast(place, axes, lens, width, height, fine=3):
    """Colours [h, w, 3] in [0, 1], each the mean of fine x fine rays, and depths [h, w] along z."""
    fx, fy, cx, cy = lens
    v, u = np.mgrid[0 : height * fine, 0 : width * fine] / fine + 0.5 / fine
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1) @ axes
    colors, depth = _trace(place, rays)
    split = (height, fine, width, fine)
    # The mean of a pixel's rays would float between surfaces; a sensor reports one of them.
    return colors.reshape(*split, 3).mean((1, 3)), depth.reshape(split)[:, 1, :, 1]


def _trace(place, rays):
    """Colour and depth of each ray; rays have length 1 along the camera's axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = (np.array(ROOM)[:, None, None] - place) / rays
        depth, kind = np.max(steps, 0).min(-1), np.zeros(rays.shape[:2], int)
        for number, crate in enumerate(CRATES, start=1):
            steps = (np.array(crate)[:, None, None] - place) / rays
            enter, leave = steps.min(0).max(-1), steps.max(0).min(-1)
            hit = (enter < leave) & (enter > 0) & (enter < depth)
            depth, kind = np.where(hit, enter, depth), np.where(hit, number, kind)
        offset = place - np.array(BALL[0])
        a, b = (rays**2).sum(-1), (rays * offset).sum(-1)
        root = np.sqrt(b**2 - a * (offset @ offset - BALL[1] ** 2))
        enter = (-b - root) / a
        hit = (enter > 0) & (enter < depth)
        depth, kind = np.where(hit, enter, depth), np.where(hit, 3, kind)
    return _colors(place + depth[..., None] * rays, kind), depth


def _colors(points, kind):
    """Procedural textures: broad waves on all things, each in a colour of its own."""
    base = np.array([[0.75, 0.7, 0.6], [0.75, 0.25, 0.2], [0.2, 0.45, 0.75], [0.3, 0.7, 0.3]])
    x, y, z = np.moveaxis(points, -1, 0)
    waves = np.sin(5 * x + 2 * z) * np.sin(6 * y - 3 * x) + 0.7 * np.sin(11 * z + 4 * y)
    shade = 0.8 + 0.13 * waves + 0.08 * z
    plain = (kind == 0) & (z > 1.0)  # Upper walls are nearly blank, as in many rooms.
    shade = np.where(plain, 0.9 + 0.01 * waves, shade)
    return np.clip(base[kind] * shade[..., None], 0, 1)
